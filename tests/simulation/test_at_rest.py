# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A block that slides as the motion ends comes to rest; then the uplift below it changes."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.geometry.two_blocks import two_blocks

pytestmark = [pytest.mark.mpi, pytest.mark.filterwarnings("ignore:Joint .* slip or opening")]

ROCK = dj.Elastic(young=30e9, poisson=0.2, density=2400.0)
G, PULSE, TIME, ANGLE, AREA = 10.0, 4.0, 0.25, math.radians(20.0), 2.0 / math.cos(math.radians(20))
WEIGHT = 2400.0 * 2.0 * 0.6 * G  # of the block of 2 m x 1 m x 0.6 m [N]
MU = math.tan(math.radians(30.0))
DAMPING = dj.Rayleigh(stiffness_factor=2e-4)
STIFF = {"normal_stiffness": 1e10, "shear_stiffness": 4e9}
LAW = dj.FrictionNoTension(**STIFF, friction_angle_deg=30.0)


@pytest.fixture(scope="module")
def mesh():
    heights = {"lower_height": 0.6, "upper_height": 0.6}
    return mesh_of(two_blocks, length=2.0, size=0.5, angle=20.0, **heights)


def model(mesh, *loads, damping=DAMPING, law=LAW):
    base, weight = dj.Fixed(group="base"), dj.Gravity(acceleration=(0.0, 0.0, -G))
    options = {"material": ROCK, "joints": law, "supports": [base], "damping": damping}
    return dj.Model(mesh, loads=[weight, *loads], **options)


def shaken(body):
    """Weight, then the ground accelerates with 4 m/s^2 for 0.25 s; the block still slides."""
    simulation = dj.Simulation(body)
    simulation.statics()
    push = {"motion": lambda t: (PULSE, 0.0, 0.0), "dt": 2.5e-3, "steps": 100}
    return simulation, simulation.dynamics(**push).state


def mean_gap(body, joints):
    """Mean gap (n, s1, s2) of the joint [m] (collective)."""
    gap = joints.state.gap
    return np.array([body.contact.integral(gap[:, k]) for k in range(3)]) / AREA


def test_slip_and_forces_at_rest_and_after_a_change_of_the_uplift(mesh):
    body = model(mesh)
    simulation, state = shaken(body)
    after = dj.to_rest(simulation, state, dt=2.5e-3)
    # A rigid block accelerates by a while it is pushed, and is braked by b until it stops.
    sin, cos = math.sin(ANGLE), math.cos(ANGLE)
    a = G * sin + PULSE * cos - MU * (G * cos - PULSE * sin)
    b = G * (MU * cos - sin)
    slip = 0.5 * a * TIME**2 * (1.0 + a / b)
    before = mean_gap(body, simulation.static.joints)
    moved = mean_gap(body, after.static.joints) - before
    assert abs(moved[2]) == pytest.approx(slip, rel=0.01)
    np.testing.assert_allclose(moved[:2], 0.0, atol=1e-3 * slip)
    force = dj.JointForces(body)(after.static.joints)["joint_1"].force
    np.testing.assert_allclose(force, [0.0, 0.0, WEIGHT], atol=1e-6 * WEIGHT)
    assert after.static.energy.relative_error < 1e-9
    assert [stage.name for stage in after.stages] == ["at rest"]
    # Uplift of a fifth of the weight: the effective force falls, the slip stays.
    pressure = 0.2 * WEIGHT / AREA
    wet = model(mesh, dj.Uplift(joint="joint_1", pressure=pressure))
    lifted = dj.to_rest(simulation, state, dt=2.5e-3, model=wet).static
    joint = dj.JointForces(wet)(lifted.joints)["joint_1"]
    assert joint.normal_force == pytest.approx(WEIGHT * (cos - 0.2), rel=1e-6)
    assert joint.plane_safety == pytest.approx(MU * (cos - 0.2) / sin, rel=1e-6)
    assert (mean_gap(wet, lifted.joints) - before)[2] == pytest.approx(moved[2], rel=1e-3)
    # The stage can be continued, here by a motion of the ground at rest.
    assert after.dynamics(dt=2.5e-3, steps=2).state.kinetic_energy < 1e-9 * WEIGHT


@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
def test_loads_are_those_at_the_time_of_rest(mesh):
    """If a traction fades in the motion, only the weight acts at rest."""
    fading = {"value": (-2e3, 0.0, 0.0), "factor": lambda t: max(1.0 - t / 0.05, 0.0)}
    body = model(mesh, dj.Traction(group="top", **fading))
    simulation = dj.Simulation(body)
    simulation.statics()
    state = simulation.dynamics(dt=2.5e-3, steps=24).state
    after = dj.to_rest(simulation, state, dt=2.5e-3)
    force = dj.JointForces(body)(after.static.joints)["joint_1"].force
    np.testing.assert_allclose(force, [0.0, 0.0, WEIGHT], atol=1e-6 * WEIGHT)
    assert after.stages[0].time > state.time
    for run, start in ((after, None), (simulation, state)):
        factor = dj.factor_of_safety(run, start=start).factor
        assert factor == pytest.approx(MU / math.tan(ANGLE), rel=1.1e-3)


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_what_cannot_come_to_rest_is_refused(mesh, monkeypatch):
    monkeypatch.setattr("dolfinx_joints.simulation.at_rest.MOST_RUNS", 2)
    simulation, state = shaken(model(mesh, damping=None))
    with pytest.raises(dj.JointsError, match="does not come to rest.*Give the model damping"):
        dj.to_rest(simulation, state, dt=2.5e-3)
    base = dj.ViscousBoundary(group="base")
    options = {"material": ROCK, "joints": LAW, "damping": DAMPING}
    on_dashpots = dj.Model(mesh, supports=[base], loads=[dj.Gravity()], **options)
    falling = dj.Simulation(on_dashpots)  # without statics nothing balances the weight
    state = falling.dynamics(dt=2.5e-3, steps=100).state
    with pytest.raises(dj.JointsError, match="It drifts: dashpots balance only the loads of stati"):
        dj.to_rest(falling, state, dt=2.5e-3)
    simulation, state = shaken(model(mesh))
    other = mesh_of(two_blocks, size=1.0)
    with pytest.raises(ValueError, match="model has another mesh"):
        dj.to_rest(simulation, state, dt=2.5e-3, model=model(other))
    bonded = dj.MohrCoulombJoint(**STIFF, friction_angle_deg=30.0, cohesion=1e5)
    softer = dj.FrictionNoTension(**STIFF | {"shear_stiffness": 1e9}, friction_angle_deg=30.0)
    for law in (bonded, softer):
        with pytest.raises(ValueError, match="law of joint 'joint_1' is .* of the class and stiff"):
            dj.to_rest(simulation, state, dt=2.5e-3, model=model(mesh, law=law))
