# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of safety against closed forms of rigid blocks, with any stiffness of the joints.

Block on an incline, block in a groove of two planes (Hoek and Bray 1981; Wyllie and Mah 2004) and
overturning block are statically determinate at failure. The roof wedge, whose factor depends on
k_n/k_s, is in `test_static_paths`, the arch in `test_voussoir_arch`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import box, largest

import dolfinx_joints as dj
from dolfinx_joints.laws.strength import divided

G = 9.80665  # [m/s^2]
ROCK = dj.Elastic(young=20e9, poisson=0.2, density=2400.0)
STIFF = {"normal_stiffness": 1e10, "shear_stiffness": 5e9}
TOLERANCE = 1e-3  # of F: the default


def exactly(expected):
    """F is the lower end of an interval with a relative width of `TOLERANCE`."""
    return pytest.approx(expected * (1.0 - 0.5 * TOLERANCE), rel=0.6 * TOLERANCE)


def rotated(axes, angle_deg):
    """Return a function that rotates points in the plane of two axes, the first one downwards."""
    i, k = axes
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))

    def turn(x):
        y = x.copy()
        y[:, i], y[:, k] = c * x[:, i] + s * x[:, k], c * x[:, k] - s * x[:, i]
        return y

    return turn


# A block of 4 m x 1 m on a plane of 30 degrees, which slides along x.
SLOPE, LENGTH, HEIGHT = 30.0, 4.0, 1.0
WEIGHT = LENGTH * HEIGHT * ROCK.density * G
DRIVING, PRESSING = (WEIGHT * f(math.radians(SLOPE)) for f in (math.sin, math.cos))


def slope_mesh(slope):
    ends = {"base": (1, 0.0), "back": lambda x: np.isclose(x[0], 0.0) & (x[1] >= 1.0)}
    joints, place = {"joint": (1, 1.0)}, rotated((0, 1), slope)
    return box([LENGTH, 1.0 + HEIGHT], [8, 4], joints=joints, groups=ends, place=place)


def on_slope(law, pressures=(), young=20e9, solver="auto", slope=SLOPE, push=None, mesh=None):
    """Return the block with water pressures [Pa] in the joint, each a load of its own."""
    water = [dj.Uplift(joint="joint", pressure=p) for p in pressures]
    pushed = [] if push is None else [dj.Traction(group="back", value=push)]
    model = dj.Model(
        mesh or slope_mesh(slope),
        material=dj.Elastic(young=young, poisson=0.2, density=ROCK.density),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), *water, *pushed],
    )
    return dj.Simulation(model, solver=solver)


def planar(cohesion, mu, pressure):
    """Return (c A + (W cos a - U) tan phi) / (W sin a)."""
    return (cohesion * LENGTH + (PRESSING - pressure * LENGTH) * mu) / DRIVING


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({}, marks=pytest.mark.mpi),
        {"solver": "monolithic"},
        {"young": 1e9},
        {"normal_stiffness": 1e9},
        {"shear_stiffness": 2e8},
        {"steps": 5},
    ],
)
def test_block_on_a_plane_with_cohesion_and_water(options):
    options = dict(options)
    steps = options.pop("steps", 1)
    stiff = {name: options.pop(name, k) for name, k in STIFF.items()}
    cohesion, pressure = 5e3, 4e3
    law = dj.AdhesiveJoint(**stiff, friction_angle_deg=40.0, adhesion=cohesion)
    run = on_slope(law, [pressure], **options)
    before = run.statics(steps=steps)
    safety = dj.factor_of_safety(run)
    expected = planar(cohesion, law.friction_coefficient, pressure)
    assert safety.factor == exactly(expected)
    assert safety.factor < expected < safety.upper * (1.0 + 1e-9)
    # At failure the strength of the joint is F times its shear.
    assert float(safety.resultants["joint"].sliding_safety) == pytest.approx(expected, rel=1e-6)
    water = np.linalg.norm(safety.resultants["joint"].water_force)
    assert water == pytest.approx(pressure * LENGTH, rel=1e-9)  # 1 m thick
    assert safety.state.energy.relative_error < 1e-8
    assert run.static is before
    assert [s.name for s in run.stages] == ["statics 1"]


class Stages(dj.Monitor):
    def static_stage(self, model, stages):
        self.stages = list(stages)


# F of the block with phi = 40 degrees and without cohesion.
RATIO = math.tan(math.radians(40.0)) / math.tan(math.radians(SLOPE))


@pytest.mark.parametrize("law", [dj.FrictionNoTension, dj.MohrCoulombJoint, dj.RigidJoint])
def test_mechanism_slides_down_the_plane(law):
    stiff = {} if law is dj.RigidJoint else STIFF
    run = on_slope(law(friction_angle_deg=40.0, **stiff))
    run.statics()
    monitor = Stages()
    safety = dj.factor_of_safety(run, monitors=[monitor])
    assert safety.factor == exactly(RATIO)
    at_limit, mechanism = monitor.stages
    assert (at_limit.name, mechanism.name) == ("factor of safety", "mechanism")
    moved = mechanism.state.displacement - at_limit.state.displacement
    np.testing.assert_allclose(moved.array, 0.5 * safety.acceleration.array, atol=1e-12)
    # The last trial is beyond the limit by e: the block accelerates with e g sin a, nearly rigid.
    acceleration = safety.acceleration.array.reshape(-1, 2)
    sine, cosine = math.sin(math.radians(SLOPE)), math.cos(math.radians(SLOPE))
    along = acceleration @ [cosine, -sine]
    excess = 1.0 - float(safety.resultants["joint"].sliding_safety) / safety.upper
    assert largest(along) == pytest.approx(excess * G * sine, rel=0.02)
    assert largest(acceleration @ [sine, cosine]) < 0.01 * largest(along)


@pytest.mark.parametrize("slip", [0.7, 0.9, 1.001])
def test_damaged_bond_is_not_healed(slip):
    """Linear softening leaves the share 1 - slip of c, for a slip relative to that of a break."""
    bond = {"tensile_strength": 1e4, "cohesion": 2e4, "softening": "linear"}
    energies = {"fracture_energy": 5.0, "shear_fracture_energy": 20.0}
    law = dj.CohesiveJoint(**STIFF, friction_angle_deg=40.0, **bond, **energies)
    ductility = 2.0 * 20.0 * STIFF["shear_stiffness"] / 2e4**2
    run = on_slope(law)
    intact = run.statics()
    internal = intact.joints.state.internal.copy()
    internal[:, :4] = 1.0, (slip * ductility) ** 2, 0.0, 0.0
    state = replace(intact.joints.state, internal=internal)
    safety = dj.factor_of_safety(
        run, start=replace(intact, joints=replace(intact.joints, state=state))
    )
    if slip > 1.0:
        assert safety.factor == exactly(RATIO)
    # Friction has at most the strength of the broken joint.
    remaining = max(1.0 - slip, 0.0) * ductility / (ductility - 1.0) * 2e4 * LENGTH / DRIVING
    assert 0.9 * RATIO < safety.factor < RATIO + remaining
    assert np.all(safety.state.joints.state.internal[:, 1] >= internal[:, 1])


@pytest.mark.filterwarnings("ignore:Joint 'joint'")
def test_after_an_earthquake_with_full_uplift_and_residual_strength():
    """The block slides in the motion; then it has more water below it and less friction."""
    mesh = slope_mesh(SLOPE)
    intact = dj.AdhesiveJoint(**STIFF, friction_angle_deg=35.0, adhesion=500.0)
    run = on_slope(intact, [1e3], mesh=mesh)
    before = run.statics()
    outcome = run.dynamics(dt=2e-3, steps=150, motion=lambda t: (-4.0 * (t < 0.1), 0.0))
    assert max(outcome.energy_error, outcome.imbalance) < 1e-11
    residual = dj.FrictionNoTension(**STIFF, friction_angle_deg=33.0)
    after = on_slope(residual, [4e3], mesh=mesh)
    expected = planar(0.0, residual.friction_coefficient, 4e3)
    assert expected < 1.0  # it would slide on
    for start in (before, outcome.state):
        assert dj.factor_of_safety(after, start=start).factor == exactly(expected)
    assert largest(outcome.state.joints.state.gap[:, 1]) > 0.005  # it slid in the motion


def test_overturning_block_by_multiplied_load():
    """A traction p on the back of height h overturns a block of length b if p h^2 / 2 = W b / 2."""
    pressure = 0.2 * WEIGHT
    law = dj.FrictionNoTension(**STIFF, friction_angle_deg=80.0)
    run = on_slope(law, slope=0.0, push=(pressure, 0.0), young=1e12)
    push = run.model.loads[1]
    run.statics()
    safety = dj.factor_of_safety(run, method="load", multiplied=[push])
    assert safety.factor == exactly(WEIGHT * LENGTH / (pressure * HEIGHT**2))
    assert safety.of == ("Traction_back",)


def test_multiplied_uplift():
    """Contact force and water pressure at F balance the weight; F is that of the planar slide."""
    law = dj.FrictionNoTension(**STIFF, friction_angle_deg=40.0)
    run = on_slope(law, [1e3])
    uplift = next(load for load in run.model.loads if isinstance(load, dj.Uplift))
    run.statics()
    safety = dj.factor_of_safety(run, method="load", multiplied=[uplift])
    assert planar(0.0, law.friction_coefficient, safety.factor * 1e3) == pytest.approx(
        1.0, rel=2e-3
    )
    joint = safety.resultants["joint"]
    np.testing.assert_allclose(
        joint.force + joint.water_force, [0.0, WEIGHT, 0.0], atol=1e-6 * WEIGHT
    )


def test_multiplied_temperature_is_not_recorded(tmp_path):
    """Results have thermal stresses without the factor, so that monitors are refused."""
    warmth = dj.Temperature(value=1.0, reference=0.0, expansion=1e-5)
    model = dj.Model(
        slope_mesh(0.0),
        material=ROCK,
        joints=dj.FrictionNoTension(**STIFF, friction_angle_deg=40.0),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), warmth],
    )
    run = dj.Simulation(model)
    run.statics()
    monitor = dj.ResultsMonitor(tmp_path / "limit.h5", points={"top": (0.0, 1.0 + HEIGHT)})
    with pytest.raises(ValueError, match="multiplied= without Temperature"):
        dj.factor_of_safety(run, method="load", monitors=[monitor])


# A block in a groove: planes that dip from the line x = 0 to both sides, which plunges along y.
GROOVE, PLUNGE, SIDE, LONG = (50.0, 35.0), 25.0, 2.0, 3.0


def groove(laws, pressures, slope=GROOVE, plunge=PLUNGE):
    rise = [math.tan(math.radians(a)) for a in slope]

    def fold(x):
        y = x.copy()
        y[:, 2] += np.abs(x[:, 0]) * np.where(x[:, 0] < 0.0, *rise) * np.minimum(x[:, 2], 1.0)
        top = 1.0 + SIDE * max(rise) + 0.5
        above = x[:, 2] > 1.0
        floor = 1.0 + np.abs(x[:, 0]) * np.where(x[:, 0] < 0.0, *rise)
        y[above, 2] = (floor + (x[:, 2] - 1.0) * (top - floor))[above]
        return rotated((1, 2), plunge)(y)

    def side(sign):
        return lambda x: np.isclose(x[2], 1.0) & (sign * x[0] > -1e-9)

    mesh = box(
        [[-SIDE, 0.0, 0.0], [SIDE, LONG, 2.0]],
        [4, 3, 3 + 1],
        joints={"left": side(-1.0), "right": side(1.0)},
        groups={"base": (2, 0.0)},
        place=fold,
    )
    model = dj.Model(
        mesh,
        material=ROCK,
        joints=laws,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), *(dj.Uplift(joint=n, pressure=p) for n, p in pressures.items())],
    )
    return dj.Simulation(model)


@pytest.mark.parametrize(
    ("ratio", "wet", "joints"),
    [
        (1.0, False, None),
        (5.0, False, None),
        (5.0, False, ["left"]),
        pytest.param(1.0, True, None, marks=pytest.mark.mpi),
        (5.0, True, None),
    ],
)
def test_block_on_two_planes(ratio, wet, joints):
    """Weight and water across the line of intersection are carried by the two normal forces."""
    angle, cohesion = {"left": 30.0, "right": 24.0}, {"left": 2e3, "right": 6e3}
    pressures = {"left": 6e3, "right": 3e3} if wet else {}
    laws = {
        name: dj.AdhesiveJoint(
            normal_stiffness=1e10,
            shear_stiffness=1e10 / ratio,
            friction_angle_deg=angle[name],
            adhesion=cohesion[name],
        )
        for name in angle
    }
    run = groove(laws, pressures)
    run.statics()
    geometry = dict(zip(laws, dj.JointForces(run.model).geometry, strict=True))
    normals = {n: g.normal * np.sign(g.normal[2]) for n, g in geometry.items()}
    line = np.cross(normals["left"], normals["right"])
    line *= -np.sign(line[2]) / np.linalg.norm(line)
    volume = 2.0 * SIDE * LONG * (SIDE * max(math.tan(math.radians(a)) for a in GROOVE) + 0.5)
    volume -= LONG * SIDE**2 / 2 * sum(math.tan(math.radians(a)) for a in GROOVE)
    weight = np.array([0.0, 0.0, -volume * ROCK.density * G])
    water = {n: pressures.get(n, 0.0) * g.area for n, g in geometry.items()}
    load = weight + sum(water[n] * normals[n] for n in normals)
    matrix = np.column_stack([*normals.values(), line])
    *pressed, driving = np.linalg.solve(matrix, -load)
    strength = {
        n: force * laws[n].friction_coefficient + cohesion[n] * geometry[n].area
        for n, force in zip(normals, pressed, strict=True)
    }
    kept = sum(strength[n] for n in strength if n not in (joints or strength))
    divided_strength = sum(strength.values()) - kept
    safety = dj.factor_of_safety(run, joints=joints)
    assert safety.factor == exactly(divided_strength / (-driving - kept))


def test_no_failure_and_refusals():
    run = on_slope(dj.FrictionNoTension(**STIFF, friction_angle_deg=40.0), slope=0.0)
    with pytest.raises(dj.JointsError, match="needs a static state"):
        dj.factor_of_safety(run)
    run.statics()
    safety = dj.factor_of_safety(run)
    assert (safety.factor, safety.upper, safety.acceleration) == (64.0, math.inf, None)
    assert "none up to 64" in repr(safety)
    with pytest.raises(ValueError, match="Gravity cannot be multiplied"):
        dj.factor_of_safety(run, method="load", multiplied=[dj.Gravity()])
    for message, wrong in {
        "multiplied is .* None with the method 'strength'": {"multiplied": run.model.loads},
        "joints is .* None with the method 'load'": {"method": "load", "joints": ["joint"]},
        "multiplied is .* at least one load": {"method": "load", "multiplied": []},
        "loads is .* at least one load": {"loads": []},
        "joints is .* different names": {"joints": ["joint", "joint"]},
        "start is 3; it must be a StaticState": {"start": 3},
    }.items():
        with pytest.raises(ValueError, match=message):
            dj.factor_of_safety(run, **wrong)
    with pytest.raises(ValueError, match="no joint whose strength"):
        dj.factor_of_safety(run, joints=[])
    other = groove(dj.FrictionNoTension(**STIFF, friction_angle_deg=40.0), {})
    with pytest.raises(ValueError, match="The state is of another mesh"):
        dj.factor_of_safety(other, start=run.static)
    with pytest.raises(dj.JointsError, match="no equilibrium at any factor"):
        dj.factor_of_safety(on_slope(dj.frictionless(normal_stiffness=1e10)), start=run.static)


def test_divided_strength():
    """tan(phi), c and f_t are divided; the apex of the cone of an adhesive joint stays."""
    bond = dj.MohrCoulombJoint(
        **STIFF,
        friction_angle_deg=45.0,
        cohesion=3e5,
        tensile_strength=2e5,
        dilatancy_angle_deg=30.0,
    )
    half = divided(bond, 2.0, "joint")
    assert half.friction_coefficient == pytest.approx(0.5)
    assert (half.cohesion, half.tensile_strength) == (1.5e5, 1e5)
    assert half.dilatancy_angle_deg == pytest.approx(half.friction_angle_deg)
    assert divided(bond, 0.5, "joint").tensile_strength == pytest.approx(3e5)  # c / tan(phi)
    adhesive = dj.AdhesiveJoint(**STIFF, friction_angle_deg=45.0, adhesion=3e5)
    assert divided(adhesive, 2.0, "joint").largest_tension == pytest.approx(
        adhesive.largest_tension
    )
    inner = dj.FrictionNoTension(**STIFF, friction_angle_deg=45.0)
    dashpot = divided(dj.ViscousJoint(law=inner, normal_viscosity=1e5), 2.0, "joint")
    assert dashpot.law.friction_coefficient == pytest.approx(0.5)
    with pytest.raises(ValueError, match="'joint': KeyedJoint has no strength that can be divided"):
        divided(dj.KeyedJoint(**STIFF), 2.0, "joint")
