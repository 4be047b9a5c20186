# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics follow the path of equilibria that the last state is on, and report where it ends.

With friction a structure has many equilibria. A wedge squeezed between two walls, wider below, is
held by friction while a load pulls it down:

      \\   |  wedge  |   /       all points stick up to the limit load; above it there is no
       \\ /___________\\ /        equilibrium but on a soft spring, metres below

Blocks pushed on a joint, an arch of voussoirs, and blocks that meet in a T or an X are the others.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import box, largest
from scipy.optimize import brentq

import dolfinx_joints as dj

G = 9.80665  # [m/s^2]
CONCRETE = dj.Elastic(young=20e9, poisson=0.2, density=2400.0)
ANGLE, LEAN = np.radians(35.0), np.radians(10.0)  # of friction, and of the wedge's flanks
HEIGHT = 2.0  # of the wedge [m]
SOLVERS = {
    "auto": ("auto", "auto"),
    "condensed": ("condensed", "auto"),
    "matrix-free": ("condensed", "matrix-free"),
    "monolithic": ("monolithic", "auto"),
    "forms": ("forms", "auto"),
}


def simulation(model, solver):
    kind, compliance = SOLVERS[solver]
    return dj.Simulation(model, solver=kind, options=dj.SolverOptions(compliance=compliance))


def friction(ratio, normal=1e10):
    return dj.FrictionNoTension(
        normal_stiffness=normal, shear_stiffness=normal / ratio, friction_angle_deg=35.0
    )


@cache
def wedge_mesh():
    def leaning(x):
        half, size = 1.0 + (HEIGHT - x[:, 1]) * np.tan(LEAN), np.abs(x[:, 0])
        places = np.where(size <= 1.0, size * half, half + (size - 1.0) / 2.0 * (3.0 - half))
        return np.column_stack([np.sign(x[:, 0]) * places, x[:, 1:]])

    def bottom(x):
        return np.isclose(x[1], 0.0) & (np.abs(x[0]) < 1.0 + 1e-9)

    return box(
        [[-3.0, 0.0], [3.0, HEIGHT]],
        [12, 8],
        joints={"left_joint": (0, -1.0), "right_joint": (0, 1.0)},
        groups={"left": (0, -3.0), "right": (0, 3.0), "bottom": bottom},
        place=leaning,
    )


def wedge(law, young, spring=0.0, squeeze=1.0):
    """The wedge, squeezed by mm from each side; its load is time [s] in N per m of its width."""
    push = {"left": 1e-3 * squeeze, "right": -1e-3 * squeeze}
    supports = [
        dj.Prescribed(group=g, component="x", value=lambda _, u=u: u) for g, u in push.items()
    ]
    supports += [dj.Fixed(group=group, components="y") for group in push]
    if spring:
        supports.append(
            dj.Spring(group="bottom", normal_stiffness=spring, tangential_stiffness=spring)
        )
    load = dj.Traction(group="bottom", value=(0.0, -1.0), factor=lambda t: t)
    material = dj.Elastic(young=young, poisson=0.0, density=0.0)
    return dj.Model(wedge_mesh(), material=material, joints=law, supports=supports, loads=[load])


WIDTH = 2.0 * (1.0 + HEIGHT * np.tan(LEAN))  # of the wedge's bottom [m]


def limit_and_stiffness(model, squeezed, normal, shear, angle=ANGLE):
    """Limit load [N/m] and stiffness [N/m^2] of a rigid wedge that sticks on elastic joints."""
    forces = dj.JointForces(model)(squeezed.joints).values()
    force = np.mean([np.hypot(each.normal_force, each.shear_force) for each in forces])
    stiff = shear * np.cos(LEAN) ** 2 + normal * np.sin(LEAN) ** 2
    rate = shear * np.cos(LEAN) * np.cos(angle) + normal * np.sin(LEAN) * np.sin(angle)
    limit = 2.0 * force * stiff * np.sin(angle - LEAN) / rate
    return limit, 2.0 * HEIGHT / np.cos(LEAN) * stiff


def settlement(model, state):
    """Mean settlement of the wedge's bottom [m], from the work of its load."""
    load = model.system().loads_by_name(1.0, 1.0)["Traction_bottom"]
    return float(load.dot(state.displacement)) / WIDTH


@pytest.mark.mpi
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("ratio", "spring"), [(1.0, 0.0), (5.0, 0.0), (5.0, 1e5)])
def test_a_wedge_sticks_up_to_its_limit(solver, ratio, spring):
    """Expected: rigid blocks on elastic joints; the rock is 1e4 times as stiff as the joints."""
    normal = 1e9
    model = wedge(friction(ratio, normal), 1e13, spring)
    run = simulation(model, solver)
    squeezed = run.quasi_statics([0.0])
    limit, stiffness = limit_and_stiffness(model, squeezed, normal, normal / ratio)
    stiffness += spring * WIDTH
    for share in (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97):
        state = run.quasi_statics([share * limit / WIDTH])
        moved = settlement(model, state) - settlement(model, squeezed)
        assert moved == pytest.approx(share * limit / stiffness, rel=2e-3)
        counts = model.contact.counts(state.joints.status)
        assert (counts.open, counts.stick, counts.slip) == (0, 18, 0)
        assert state.cuts == 0


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:Joint .* slip or opening reached")
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("share", "before"), [(1.2, None), (1.01, 0.97), (3.0, None)])
def test_a_wedge_beyond_its_limit_jumps(solver, share, before):
    """It falls onto the spring under its limit load P, up to where k u = P.

    The work P u of the load less the energy k u^2 / 2 of the spring is P^2 / (2 k).
    """
    normal, spring = 1e9, 2e5
    model = wedge(friction(5.0, normal), 1e10, spring)

    def pulled(**options):
        run = simulation(model, solver)
        squeezed = run.quasi_statics([0.0])
        limit, _ = limit_and_stiffness(model, squeezed, normal, normal / 5.0)
        if before is not None:
            run.quasi_statics([before * limit / WIDTH])
        return limit, run.quasi_statics([share * limit / WIDTH], **options)

    with pytest.raises(dj.JumpError, match=r"jumps beyond the load factor .* J in '") as error:
        pulled()
    assert set(error.value.joints) == {"left_joint", "right_joint"}
    limit, state = pulled(allow_jumps=True)
    (jump,) = state.jumps
    first, last = ((before or 0.0) * (1.0 - s) + share * s for s in (jump.start, jump.end))
    assert first - 0.02 <= 1.0 <= last + 0.02  # loads over the limit
    expected = limit**2 / (2.0 * spring * WIDTH)
    assert jump.energy == pytest.approx(expected, rel=0.01)
    assert error.value.released == pytest.approx(jump.energy, rel=1e-6)  # of another run
    assert state.energy.released == pytest.approx(jump.energy, rel=1e-3)
    assert settlement(model, state) == pytest.approx(share * limit / (spring * WIDTH), rel=0.01)
    counts = model.contact.counts(state.joints.status)
    assert (counts.open, counts.stick, counts.slip) == (18, 0, 0)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_wedge_without_a_spring_has_no_equilibrium_beyond_its_limit(solver):
    model = wedge(friction(5.0, 1e9), 1e10)
    run = simulation(model, solver)
    limit, _ = limit_and_stiffness(model, run.quasi_statics([0.0]), 1e9, 2e8)
    run.quasi_statics([0.97 * limit / WIDTH])
    with pytest.raises(dj.ConvergenceError) as error:
        run.quasi_statics([1.2 * limit / WIDTH])
    assert 0.97 + 0.23 * error.value.reached == pytest.approx(1.0, abs=0.02)


# Strength factor of a wedge under 0.3 of the limit load for k_n/k_s = 1, by k_n/k_s and squeeze
# relative to 1 mm: the squeezed wedge is statically indeterminate.
ROOF = [(1.0, 1.0), (5.0, 1.0), (20.0, 1.0), (1.0, 2.0), (20.0, 2.0)]


@pytest.mark.parametrize(("ratio", "squeeze"), ROOF)
def test_factor_of_safety_of_a_wedge_depends_on_stiffness_and_prestress(ratio, squeeze):
    """The load at which the closed form with tan(phi) / F has its limit; the rock is nearly rigid.

    Relaxation of the squeeze as the wedge settles: with softer shear springs it settles more.
    """
    normal = 1e9
    model = wedge(friction(ratio, normal), 1e13, squeeze=squeeze)
    reference = wedge(friction(1.0, normal), 1e13)
    squeezed = dj.Simulation(reference).quasi_statics([0.0])
    limit, _ = limit_and_stiffness(reference, squeezed, normal, normal)
    load = 0.3 * limit / WIDTH
    run = dj.Simulation(model)
    start = run.quasi_statics([0.0])

    def excess(factor):
        angle = np.arctan(np.tan(ANGLE) / factor)
        return limit_and_stiffness(model, start, normal, normal / ratio, angle)[0] - 0.3 * limit

    expected = brentq(excess, 0.5, 8.0)
    strength = dj.factor_of_safety(run, time=load)
    print(f"k_n/k_s {ratio:g}, squeeze {squeeze:g}: F {strength.factor:.4f}, exact {expected:.4f}")
    assert strength.factor == pytest.approx(expected, rel=1.2e-3)
    if squeeze == 1.0:  # as in docs/theory/energy.md
        assert strength.factor == pytest.approx({1: 2.16, 5: 1.94, 20: 1.12}[ratio], abs=0.005)
    loaded = dj.factor_of_safety(run, method="load", multiplied=model.loads, time=load)
    own_limit, _ = limit_and_stiffness(model, start, normal, normal / ratio)
    assert loaded.factor == pytest.approx(own_limit / (0.3 * limit), rel=1.2e-3)


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:Joint .* slip or opening reached")
def test_factor_of_safety_ends_at_a_jump():
    """On a soft spring the wedge has an equilibrium far below, which is not accepted."""
    model = wedge(friction(5.0, 1e9), 1e10, spring=2e5)
    run = dj.Simulation(model)
    limit, _ = limit_and_stiffness(model, run.quasi_statics([0.0]), 1e9, 2e8)
    safety = dj.factor_of_safety(run, method="load", multiplied=model.loads, time=limit / 2 / WIDTH)
    assert safety.factor == pytest.approx(2.0, rel=1.2e-3)
    assert safety.trials[-1].outcome == "jump"


def block(ratio):
    """A block on a level joint, pushed by 0.9 of what friction takes at t = 1 s."""
    push = 0.9 * np.tan(ANGLE) * CONCRETE.density * G
    ends = {"base": (1, 0.0), "top": (1, 3.0)}
    split = box([4.0, 3.0], [8, 6], joints={"joint": (1, 2.0)}, groups=ends)
    load = dj.Traction(group="top", value=(push, 0.0), factor=lambda t: t)
    return model_of(split, ratio, ["base"], [dj.Gravity(), load])


def arch(ratio, voussoirs=5):
    """A fixed arch of voussoirs under its weight and a growing pressure from above."""

    def bent(x):
        angle, radius = np.pi * (0.95 - 0.9 * x[:, 0]), 4.0 + x[:, 1]
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), x[:, 2]])

    split = box(
        [1.0, 1.0],
        [4 * voussoirs, 3],
        joints={f"joint_{i}": (0, i / voussoirs) for i in range(1, voussoirs)},
        groups={"left": (0, 0.0), "right": (0, 1.0), "top": (1, 1.0)},
        place=bent,
    )
    load = dj.Traction(group="top", value=(0.0, -3e5), factor=lambda t: t)
    return model_of(split, ratio, ["left", "right"], [dj.Gravity(), load])


def crossing(ratio, whole):
    """Joints that meet in an X (``whole``) or a T, the top pressed and pushed."""
    lowest = 0.0 if whole else 2.0 - 1e-9
    joints = {"upright": lambda x: np.isclose(x[0], 2.0) & (x[1] >= lowest), "level": (1, 2.0)}
    split = box([4.0, 4.0], [8, 8], joints=joints, groups={"base": (1, 0.0), "top": (1, 4.0)})
    load = dj.Traction(group="top", value=(0.9e5, -3e5), factor=lambda t: t)
    return model_of(split, ratio, ["base"], [dj.Gravity(), load], normal=1e11)


def model_of(split, ratio, fixed, loads, normal=1e10):
    supports = [dj.Fixed(group=group) for group in fixed]
    law = friction(ratio, normal)
    return dj.Model(split, material=CONCRETE, joints=law, supports=supports, loads=loads)


SCENES = {
    "wedge": lambda ratio: wedge(friction(ratio), 20e9),
    "block": block,
    "arch": arch,
    "T": lambda ratio: crossing(ratio, whole=False),
    "X": lambda ratio: crossing(ratio, whole=True),
}
LARGEST_LOAD = {"wedge": 0.6e6}  # of the time of the load, 1 s unless given


def difference(one, two):
    """Of two states in displacements and tractions, each relative to the largest."""
    pairs = [(s.displacement.array, s.joints.traction) for s in (one, two)]
    return max(largest(a - b) / largest(b) for a, b in zip(*pairs, strict=True))


@pytest.mark.mpi
@pytest.mark.parametrize("ratio", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("scene", SCENES)
def test_all_solvers_find_the_same_equilibria(scene, ratio):
    model, end = SCENES[scene](ratio), LARGEST_LOAD.get(scene, 1.0)
    paths = []
    for solver in SOLVERS:
        run = simulation(model, solver)
        paths.append([run.quasi_statics([end * share]) for share in (0.0, 0.25, 0.5, 0.75, 1.0)])
    for path in paths[1:]:
        assert max(difference(*ends) for ends in zip(path, paths[0], strict=True)) <= 1e-8


@pytest.mark.mpi
@pytest.mark.parametrize("scene", SCENES)
def test_increments_do_not_matter_while_slip_keeps_its_direction(scene):
    """In the plane it is one line; the return mapping is then exact however long the increment."""
    model, end, found = SCENES[scene](5.0), LARGEST_LOAD.get(scene, 1.0), []
    for count in (1, 2, 5, 20):
        run = dj.Simulation(model)
        run.quasi_statics([0.0])
        found.append(run.quasi_statics([end * i / count for i in range(1, count + 1)]))
    assert max(difference(state, found[-1]) for state in found[:-1]) <= 1e-8


@pytest.mark.mpi
def test_increments_converge_with_first_order_where_slip_turns():
    """A block pushed to 0.8 of its friction along x, then along y as well, to 0.9 in all."""
    ends = {"base": (2, 0.0), "top": (2, 2.0)}
    split = box([4.0, 4.0, 2.0], [4, 4, 4], joints={"joint": (2, 1.0)}, groups=ends)
    push = np.tan(ANGLE) * CONCRETE.density * G
    loads = [
        dj.Gravity(),
        dj.Traction(group="top", value=(push, 0, 0), factor=lambda t: 0.8 * min(t, 1.0)),
        dj.Traction(group="top", value=(0, push, 0), factor=lambda t: 0.4 * max(t - 1.0, 0.0)),
    ]
    model, found = model_of(split, 1.0, ["base"], loads), {}
    for count in (4, 8, 16, 128):
        run = dj.Simulation(model)
        run.quasi_statics([0.0, 1.0])
        found[count] = run.quasi_statics([1.0 + i / count for i in range(1, count + 1)])
    errors = [difference(found[count], found[128]) for count in (4, 8, 16)]
    assert errors[0] > 1e-5
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((orders > 0.8) & (orders < 1.4))


STIFF = {"normal_stiffness": 1e10, "shear_stiffness": 1e10}
SMOOTH = {
    "smooth": dj.FrictionNoTension(friction_angle_deg=0.0, **STIFF),
    "no shear": dj.FrictionNoTension(friction_angle_deg=30.0, **STIFF | {"shear_stiffness": 0.0}),
    "Mohr-Coulomb": dj.MohrCoulombJoint(friction_angle_deg=0.0, **STIFF),
}
SMOOTH_CASES = [
    (kind, solver)
    for kind in SMOOTH
    for solver in SOLVERS
    if kind != "Mohr-Coulomb" or "condensed" not in SOLVERS[solver]  # it has no condensed form
]


@pytest.mark.mpi
@pytest.mark.parametrize("gap", [0.0, 1e-3])
@pytest.mark.parametrize(("kind", "solver"), SMOOTH_CASES)
def test_a_block_without_friction_does_not_drift(kind, solver, gap):
    """Nothing but friction or rounding can move it along the level joint, its own strain apart.

    Poisson's ratio is zero, so that gravity alone strains nothing across. With a gap the block
    falls at once: its loads grow from zero, so that it releases nothing.
    """
    joints, base = {"joint": (2, 1.0)}, {"base": (2, 0.0)}
    model = dj.Model(
        box([1.0, 1.0, 2.0], [3, 3, 4], joints=joints, groups=base),
        material=dj.Elastic(young=30e9, poisson=0.0, density=2400.0),
        joints=dj.Joints(SMOOTH[kind], initial_gaps={"joint": gap}),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    run = simulation(model, solver)
    state = run.statics()
    moved = state.joints.state.gap - model.contact.initial_gap
    settled = CONCRETE.density * G / 1e10
    assert largest(moved[:, 1:]) <= 1e-5 * gap + 1e-6 * settled
    assert largest(moved[:, 0] + gap + settled) <= 1e-6 * settled
