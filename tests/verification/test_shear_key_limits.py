# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A block on a keyed joint under its weight and a horizontal body force: where it gives way.

On flanks every point bears tan(alpha + phi) times its pressure and no more, however the pressure is
distributed, so that this is the ratio of the resultants at which the block goes; along the keys it
is tan(phi), friction alone.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from shaken_wall import DT, shaking, wall

import dolfinx_joints as dj

pytestmark = pytest.mark.mpi

PHI, ALPHA = 15.0, 10.0
STIFF = {"normal_stiffness": 1e10, "shear_stiffness": 1e10, "friction_angle_deg": PHI}
KEYS = dj.ShearKeyJoint(
    **STIFF,
    depth=0.05,
    flank_angle_deg=ALPHA,
    spacing=1.0,
    tooth_cohesion=50e6,
)


@pytest.fixture
def meshes(two_rectangles_file, blocks_file, read):
    """Two blocks on each other, the joint level, by the number of dimensions."""
    files = {2: two_rectangles_file, 3: blocks_file}
    return lambda dim: read(files[dim](angle=0.0))


def pushed(jointed, law, ratio, solver, axis=0):
    """Shear over pressure of the joint under a body force of a ratio of the weight."""
    dim = jointed.mesh.geometry.dim
    force = np.zeros(dim)
    force[axis], force[-1] = 9.81 * ratio, -9.81
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=30e9, poisson=0.2, density=2400.0),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=tuple(force))],
    )
    state = dj.Simulation(model, solver=solver).statics(steps=4)
    sums = [model.contact.integral(each) for each in state.joints.traction.T]
    return math.hypot(*sums[1:]) / -sums[0]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("solver", "play"), [("monolithic", 1e-4), ("condensed", 0.0)])
def test_keys_hold_what_friction_cannot(meshes, dim, solver, play):
    """At 97 % of tan(alpha + phi), far above tan(phi); not at 103 %."""
    keys = replace(KEYS, forward_play=play, backward_play=play)
    limit = math.tan(math.radians(ALPHA + PHI))
    held = pushed(meshes(dim), keys, 0.97 * limit, solver)
    assert held == pytest.approx(0.97 * limit, rel=1e-6)
    with pytest.raises(dj.ConvergenceError):
        pushed(meshes(dim), dj.FrictionNoTension(**STIFF), 0.97 * limit, solver)
    with pytest.raises(dj.ConvergenceError):
        pushed(meshes(dim), keys, 1.03 * limit, solver)


def test_keys_do_not_hold_along_themselves(meshes):
    limit = math.tan(math.radians(PHI))
    keys = replace(KEYS, forward_play=1e-4, backward_play=1e-4)
    held = pushed(meshes(3), keys, 0.97 * limit, "condensed", axis=1)
    assert held == pytest.approx(0.97 * limit, rel=1e-6)
    with pytest.raises(dj.ConvergenceError):
        pushed(meshes(3), keys, 1.03 * limit, "condensed", axis=1)


@pytest.mark.parametrize("solver", ["monolithic", "condensed"])
@pytest.mark.parametrize("step", [1e-3, 5e-4, 5e-5])
def test_teeth_that_can_stay_stay(meshes, solver, step):
    """The upper face is pushed onto the flanks, which bear p tan(alpha + phi), however long steps.

    Before it rides up, a flank overlaps by step sin(alpha), under k_n times which teeth of half
    this strength would not stand. Weak teeth go and leave the friction of the base, p tan(phi).
    """
    pressure, shears = 2e5, []
    for cohesion in (2e5, 1e4):
        model = dj.Model(
            meshes(2),
            material=dj.Elastic(young=30e9, poisson=0.0, density=2400.0),
            joints=replace(KEYS, forward_play=5e-5, backward_play=5e-5, tooth_cohesion=cohesion),
            supports=[
                dj.Fixed(group="base"),
                dj.Prescribed(group="joint_1+", component="x", value=lambda time: time),
            ],
            loads=[dj.Pressure(group="top", value=pressure)],
        )
        simulation = dj.Simulation(model, solver=solver)
        simulation.statics()
        for time in np.arange(1, round(1e-3 / step) + 1) * step:
            state = simulation.quasi_statics([time])
        shears.append(abs(model.contact.integral(state.joints.traction[:, 1])))  # of 1 m
        assert np.all(state.joints.state.internal[:, 0] == (cohesion == 1e4))
    limits = [pressure * math.tan(math.radians(angle)) for angle in (ALPHA + PHI, PHI)]
    assert shears == pytest.approx(limits, rel=1e-6)


def test_a_wall_that_slides_on_shear_keys_by_both_solvers(wall_file, read):
    """The steps of two iterations that share nothing but the law: none is cut, energies agree.

    Gravity leaves points on the limit of friction on base and flanks, and from the fourth step on
    they slide along the keys. The condensed solver asks the law on the compliance of the wall, the
    monolithic one at gaps.
    """
    stiff = {"normal_stiffness": 1e11, "shear_stiffness": 1e11, "friction_angle_deg": 30.0}
    teeth = {"depth": 0.2, "flank_angle_deg": 45.0, "spacing": 1.0, "tooth_cohesion": 2e5}
    keys = dj.ShearKeyJoint(**stiff, **teeth)
    found = []
    for solver in ("condensed", "monolithic"):
        simulation = dj.Simulation(wall(read(wall_file()), keys), solver=solver)
        simulation.statics()
        outcome = simulation.dynamics(dt=DT, steps=6, motion=shaking)
        assert outcome.counts.rejected == 0
        found.append(outcome.energy)
    one, two = found
    assert one.friction == pytest.approx(two.friction, rel=1e-9)
    assert one.strain == pytest.approx(two.strain, rel=1e-9)
