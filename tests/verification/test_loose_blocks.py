# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics of blocks that nothing but joints holds, and of joints without compliance.

      z  | |_____|          column: a block stands on another, the lowest on a clamped base. Without
         | |_____| joint_2  lateral contraction, and turned gravity left out, the traction on a
         | |_____| joint_1  joint is the weight above it per area, rho g (H - z), whatever its
         | ///////          stiffness; it follows from balance alone and so is rounding.

      bar on a wall: pushed by u at its end against a joint with the gap g_0 in its middle,
      -t_n = <u - g_0> / (L/E + 1/k_n): that of a rigid joint has no 1/k_n, and its gap is zero.

      incline: gravity turned by theta. A block on a joint with the friction mu stands up to
      tan(theta) = mu whatever the distribution of the tractions (their sums are its weight), and
      there is no equilibrium beyond. It is flat enough not to tilt.

The condensed solver puts springs across the joints where blocks are loose; what it finds must not
depend on them. Without them the matrix is singular, and a mechanism must not pass for a solution.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import box, difference, largest
from shaken_wall import swaying

import dolfinx_joints as dj
from dolfinx_joints.solvers.interface import condensed
from dolfinx_joints.solvers.interface.springs import JointSprings

COMM = MPI.COMM_WORLD
YOUNG, DENSITY, G = 30e9, 2400.0, 9.80665  # Pa, kg/m^3, m/s^2
HEIGHT = 0.5  # of a block of the column [m]
MU = math.tan(math.radians(30.0))

RIGID = dj.RigidJoint(friction_angle_deg=30.0)
RIGID_SMOOTH = dj.RigidJoint(friction_angle_deg=0.0)


def friction(k_n: float = 1e11, angle: float = 30.0) -> dj.FrictionNoTension:
    return dj.FrictionNoTension(
        normal_stiffness=k_n, shear_stiffness=0.4 * k_n, friction_angle_deg=angle
    )


@cache
def stack(blocks: int, size: tuple[float, float], height: float, cells: int = 2) -> Any:
    """Blocks of a length, width and height [m], one on the other, with a group for base and top."""
    top = blocks * height
    return box(
        [*size, top],
        [2 * cells, cells, 2 * blocks],
        joints={f"joint_{i}": (2, i * height) for i in range(1, blocks)},
        groups={"base": (2, 0.0), "top": (2, top)},
    )


def column(
    law: Any,
    *,
    blocks: int = 4,
    loads: tuple[Any, ...] = (),
    poisson: float = 0.0,
    young: float = YOUNG,
) -> Any:
    """A column under its own weight; only the lowest block is held."""
    return dj.Model(
        stack(blocks, (0.5, 0.5), HEIGHT),
        material=dj.Elastic(young=young, poisson=poisson, density=DENSITY),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), *loads],
    )


def statics(model: Any, solver: str = "condensed", **options: Any) -> Any:
    return dj.Simulation(model, solver=solver, options=dj.SolverOptions(**options)).statics()


LAWS = {
    "soft": friction(1e8),
    "medium": friction(1e11),
    "stiff": friction(1e14),
    "smooth": friction(1e11, 0.0),
    "keyed": dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11),
    "rigid": RIGID,
    "rigid and smooth": RIGID_SMOOTH,
}


@pytest.mark.mpi
@pytest.mark.parametrize("blocks", [2, 4, 9])
@pytest.mark.parametrize("name", LAWS)
def test_a_column_of_loose_blocks(name, blocks):
    model = column(LAWS[name], blocks=blocks)
    found = statics(model)
    weight = DENSITY * G * (blocks * HEIGHT - model.operator.points[:, 2])
    size = DENSITY * G * blocks * HEIGHT
    expected = np.column_stack([-weight, np.zeros((len(weight), 2))])
    stiffness = LAWS[name].closed_stiffness()[0]
    # Cells of E/h, moved by the overlap of all joints, are rounded by this; the condition of a
    # chain grows with the square of its length.
    moved = np.finfo(float).eps * (YOUNG / (0.5 * HEIGHT)) * blocks * size / stiffness
    assert largest(found.joints.traction - expected) <= 1e-11 * size + blocks**2 * moved
    gap = found.joints.state.gap[:, 0]
    assert largest(gap + weight / stiffness) <= 1e-10 * size / min(stiffness, 1e11)
    if math.isinf(stiffness):
        assert not gap.any()
    u = found.displacement.array.reshape(-1, 3)
    assert largest(u[:, :2]) <= 1e-9 * largest(u)  # smooth blocks could rest anywhere
    counts = model.contact.counts(found.joints.status)
    rests = counts.frictionless if "smooth" in name else counts.stick
    assert rests == model.operator.num_points


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["soft", "medium", "stiff", "keyed"])
def test_loose_blocks_as_the_monolithic_solver_finds_them(name):
    """With contraction the joints rub, and an eccentric load opens them in part.

    The stiff joint is k_n h/E = 1e3 times stiffer than its cells: rounding of monolithic tractions.
    """
    push = dj.Traction(group="top", value=(5e3, 2e3, -2e3))
    model = column(LAWS[name], blocks=3, loads=(push,), poisson=0.2)
    one, two = statics(model), statics(model, "monolithic")
    assert difference(one.displacement, two.displacement) <= 1e-9
    tolerance = 1e-7 if name == "stiff" else 1e-9
    size = largest(two.joints.traction)
    assert largest(one.joints.traction - two.joints.traction) <= tolerance * size
    counts = [model.contact.counts(s.joints.status) for s in (one, two)]
    assert counts[0] == counts[1]
    assert counts[0].open > 0


@pytest.mark.parametrize("kind", ["dense", "compressed", "matrix-free"])
@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_loose_blocks_with_every_compliance(kind, linear):
    push = dj.Traction(group="top", value=(5e3, 2e3, -2e3))
    for law in (LAWS["medium"], RIGID):
        model = column(law, blocks=3, loads=(push,), poisson=0.2)
        reference = statics(model, compliance="dense", linear="direct")
        found = statics(model, compliance=kind, linear=linear)
        assert difference(found.displacement, reference.displacement) <= 1e-9
        size = largest(reference.joints.traction)
        assert largest(found.joints.traction - reference.joints.traction) <= 1e-9 * size


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["dense", "compressed", "matrix-free"])
def test_a_soft_joint_among_stiff_ones(kind):
    """It moves a million times as far, and the rounding of that is none of the stiff ones' forces.

    On each the weight above it; rounding as in a column of loose blocks.
    """
    young, soft, size = 1e12, 1e8, DENSITY * G * 5 * HEIGHT
    stiff = friction(1e14)
    laws = {"joint_1": stiff, "joint_2": stiff, "joint_3": friction(soft), "joint_4": stiff}
    model = column(laws, blocks=5, young=young)
    weight = DENSITY * G * (5 * HEIGHT - model.operator.points[:, 2])
    found = statics(model, compliance=kind).joints.traction
    moved = np.finfo(float).eps * (young / (0.5 * HEIGHT)) * 5 * size / soft
    expected = np.column_stack([-weight, np.zeros((len(weight), 2))])
    assert largest(found - expected) <= 1e-11 * size + 5**2 * moved


@pytest.mark.mpi
@pytest.mark.parametrize("factor", [0.1, 30.0])
@pytest.mark.parametrize("name", ["soft", "medium", "rigid"])
def test_the_springs_leave_no_trace(name, factor, monkeypatch):
    def other(system):
        springs = JointSprings(system)
        springs.stiffness = factor * springs.stiffness
        springs.matrix.scale(factor)
        springs.largest_compliance = springs.largest_compliance / factor
        return springs

    push = dj.Traction(group="top", value=(5e3, 2e3, -2e3))
    model = column(LAWS[name], blocks=3, loads=(push,), poisson=0.2)
    reference = statics(model)
    monkeypatch.setattr(condensed, "JointSprings", other)
    found = statics(model)
    assert difference(found.displacement, reference.displacement) <= 1e-9
    size = largest(reference.joints.traction)
    assert largest(found.joints.traction - reference.joints.traction) <= 1e-9 * size


@pytest.mark.parametrize("solver", ["condensed", "monolithic"])
@pytest.mark.parametrize("steps", [1, 5])
def test_held_blocks(wall_file, read, solver, steps):
    """A wall whose blocks all stand on the base, pressed at its ends: both solvers, any steps."""
    model = dj.Model(
        read(wall_file(divisions=(8, 2, 3))),
        material=dj.Elastic(young=24e9, poisson=0.2, density=DENSITY),
        joints=friction(),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), dj.Pressure(group="crest", value=3e5)],
    )
    one = dj.Simulation(model, solver="condensed").statics(steps=steps)
    two = dj.Simulation(model, solver=solver).statics(steps=steps)
    assert difference(one.displacement, two.displacement) <= 1e-9
    counts = model.contact.counts(two.joints.status)
    assert min(counts.open, counts.slip) > 0
    assert counts == model.contact.counts(one.joints.status)


# What cannot stand.


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["medium", "smooth", "rigid", "rigid and smooth"])
@pytest.mark.parametrize(
    "pull", [(0.0, 0.0, 1e6), (1e5, 0.0, 0.0), (0.0, 0.0, 1.01 * DENSITY * G * HEIGHT)]
)
def test_a_mechanism_is_not_returned(name, pull):
    # Lifted; pushed over and away; lifted by one per cent more than the weight of the upper block.
    model = column(LAWS[name], blocks=2, loads=(dj.Traction(group="top", value=pull),))
    with pytest.raises(dj.JointsError):
        statics(model)


@pytest.mark.parametrize("name", ["smooth", "rigid and smooth"])
def test_nothing_holds_a_smooth_block_sideways(name):
    # 1 N/m^2 of shear, 1e-5 of its weight, and no friction.
    model = column(LAWS[name], blocks=2, loads=(dj.Traction(group="top", value=(1.0, 0.0, 0.0)),))
    with pytest.raises(dj.JointsError):
        statics(model)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("young", "solver", "linear"),
    [
        (YOUNG, "condensed", "direct"),
        (1e15, "condensed", "direct"),
        (YOUNG, "monolithic", "direct"),
        (1e15, "monolithic", "direct"),
        (1e15, "auto", "iterative"),
    ],
)
def test_rounding_holds_no_block(young, solver, linear):
    """Of products with A it grows as a block goes, until it is more than what pushes the block.

    0.001 N/m^2, 1e-7 of the weight: without friction nothing holds it. With friction it stands,
    under its weight, however stiff it is and however much rounding is left then.
    """
    push = dj.Traction(group="top", value=(1e-3, 0.0, 0.0))
    smooth, rough = (
        column(friction(1e9, angle), blocks=2, loads=(push,), poisson=0.2, young=young)
        for angle in (0.0, 30.0)
    )
    with pytest.raises(dj.JointsError):
        statics(smooth, solver, linear=linear)
    found = statics(rough, solver, linear=linear)
    total = COMM.allreduce(rough.operator.areas @ found.joints.traction)
    assert total[0] == pytest.approx(-DENSITY * G * HEIGHT * 0.5**2, rel=1e-6)


@pytest.mark.parametrize("name", ["smooth", "rigid and smooth"])
def test_smooth_blocks_stay_where_they_were(name):
    # They could rest anywhere; the joint rubs none of the lateral strain back.
    model = column(LAWS[name], blocks=3, poisson=0.2)
    u = model.function(statics(model).displacement).x.array.reshape(-1, 3)
    height = model.V.tabulate_dof_coordinates()[: len(u), 2]
    for middle in (1.5 * HEIGHT, 2.5 * HEIGHT):
        mean = u[np.isclose(height, middle)].mean(axis=0)
        assert np.abs(mean[:2]).max() <= 1e-6 * np.abs(u).max()


def slope(law: Any, share: float) -> Any:
    """A flat slab on another, gravity turned by tan(theta) = share mu along a diagonal."""
    theta, c = math.atan(share * MU), math.sqrt(0.5)
    down = G * math.sin(theta)
    return dj.Model(
        stack(2, (2.0, 2.0), 0.2, cells=4),
        material=dj.Elastic(young=YOUNG, poisson=0.2, density=DENSITY),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=(c * down, c * down, -G * math.cos(theta)))],
    )


@pytest.mark.mpi
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("law", [RIGID, friction()], ids=["rigid", "elastic"])
def test_a_block_stands_on_an_incline(law, share):
    model = slope(law, share)
    found = statics(model)
    traction, areas = found.joints.traction, model.operator.areas
    total = COMM.allreduce(areas @ traction)
    weight, theta = DENSITY * G * 2.0 * 2.0 * 0.2, math.atan(share * MU)
    assert total[0] == pytest.approx(-weight * math.cos(theta), rel=1e-11)
    along = weight * math.sin(theta)
    assert math.hypot(total[1], total[2]) == pytest.approx(along, rel=1e-11, abs=1e-11 * weight)
    shear = np.hypot(traction[:, 1], traction[:, 2])
    assert largest(np.maximum(shear + MU * traction[:, 0], 0.0)) <= 1e-11 * largest(traction)
    assert largest(np.maximum(traction[:, 0], 0.0)) == 0.0
    if law is RIGID:
        assert largest(np.minimum(found.joints.state.gap[:, 0], 0.0)) == 0.0
    counts = model.contact.counts(found.joints.status)
    assert counts.open == 0
    assert (counts.slip > 0) == (share >= 0.9)


@pytest.mark.mpi
@pytest.mark.parametrize("share", [1.001, 1.01, 1.5])
@pytest.mark.parametrize("law", [RIGID, friction()], ids=["rigid", "elastic"])
def test_a_block_slides_from_an_incline(law, share):
    with pytest.raises(dj.JointsError):
        statics(slope(law, share))


# Rigid joints of held blocks.


def pushed_bar(laws: Any, gaps: Any, push: float) -> Any:
    """Blocks without weight and lateral contraction, pushed from above by ``push`` at time 1."""
    return dj.Model(
        stack(len(laws) + 1, (0.5, 0.5), HEIGHT),
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=0.0),
        joints=dj.Joints(laws, initial_gaps=gaps),
        supports=[
            dj.Fixed(group="base"),
            dj.Fixed(group="top", components="xy"),
            dj.Prescribed(group="top", component="z", value=lambda time: -push * time),
        ],
    )


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["dense", "compressed", "matrix-free"])
def test_a_bar_pressed_on_a_wall(kind):
    """Pushed until it touches, beyond, back until it opens, and pulled."""
    length, gap, push = 4 * HEIGHT, 4e-4, 1e-3
    laws = {"joint_1": friction(1e16), "joint_2": RIGID, "joint_3": friction(1e16)}
    model = pushed_bar(laws, {"joint_2": gap}, push)
    middle = model.operator.joint == 1
    run = dj.Simulation(model, solver="condensed", options=dj.SolverOptions(compliance=kind))
    compliance = length / YOUNG + 2.0 / 1e16
    for time in (1.0, 0.6, 0.9):
        found = run.quasi_statics([time])
        expected = -(push * time - gap) / compliance
        assert largest(found.joints.traction[:, 0] - expected) <= 1e-9 * abs(expected)
        assert largest(found.joints.traction[:, 1:]) <= 1e-9 * abs(expected)
        assert largest(found.joints.state.gap[middle, 0]) <= 1e-9 * gap


@pytest.mark.mpi
def test_a_rigid_joint_that_closes_and_opens():
    """One joint, half of the bar held by each end: touching is t = 0, and pulling leaves a gap."""
    length, gap, push = 2 * HEIGHT, 4e-4, 1e-3
    model = pushed_bar({"joint_1": RIGID}, {"joint_1": gap}, push)
    run = dj.Simulation(model)
    size = YOUNG * push / length
    for time in (0.3, 0.5, 1.0, 0.7, 0.2, -0.5, 0.8):
        found = run.quasi_statics([time])
        over = push * time - gap
        expected = -YOUNG * max(over, 0.0) / length
        assert largest(found.joints.traction - [expected, 0.0, 0.0]) <= 1e-12 * size
        assert largest(found.joints.state.gap[:, 0] - max(-over, 0.0)) <= 1e-12 * push
        if over > 0.0:
            assert not found.joints.state.gap[:, 0].any()


def test_a_rigid_joint_is_the_limit_of_stiff_ones():
    """The difference falls with 1/k_n: of the order of E/(k_n h), h the cell size."""
    push = dj.Traction(group="top", value=(5e3, 2e3, -2e3))
    rigid = statics(column(RIGID, blocks=3, loads=(push,), poisson=0.2))
    errors = []
    for k_n in (1e13, 1e14, 1e15):
        law = dj.FrictionNoTension(
            normal_stiffness=k_n, shear_stiffness=k_n, friction_angle_deg=30.0
        )
        stiff = statics(column(law, blocks=3, loads=(push,), poisson=0.2))
        errors.append(difference(stiff.displacement, rigid.displacement))
    assert errors[1] == pytest.approx(0.1 * errors[0], rel=0.1)
    assert errors[2] == pytest.approx(0.01 * errors[0], rel=0.1)
    assert errors[2] <= 1e-3


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
@pytest.mark.parametrize("name", ["medium", "rigid"])
def test_dynamics_from_a_static_state(name):
    """At rest nothing moves; shaken, the lines of the ledger add up."""
    model = column(LAWS[name], blocks=3, poisson=0.2)
    run = dj.Simulation(
        model, solver="condensed", options=dj.SolverOptions(relative_tolerance=1e-12)
    )
    static = run.statics()
    still = run.dynamics(dt=0.002, steps=10)
    assert difference(still.state.displacement, static.displacement) <= 1e-9
    shaken = run.dynamics(dt=0.002, steps=50, motion=swaying)
    counts = model.contact.counts(shaken.state.joints.status)
    assert counts.total == model.operator.num_points
    assert shaken.energy.friction > 0.0
    assert max(still.imbalance, shaken.imbalance) <= 1e-10


def wall_on_a_wall(law: Any) -> Any:
    """Two blocks side by side on a third: three joints' ends meet in a line, of which two tie."""
    joints = {
        "upright": lambda x: np.isclose(x[0], 0.5) & (x[2] > 0.5 - 1e-9),
        "level": (2, 0.5),
    }
    return dj.Model(
        box([1.0, 1.0, 1.0], [4, 2, 4], joints=joints, groups={"base": (2, 0.0)}),
        material=dj.Elastic(young=YOUNG, poisson=0.2, density=DENSITY),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
@pytest.mark.parametrize("k_n", [1e11, 1e13])
def test_stiff_joints_that_meet_take_no_more_iterations(k_n):
    """With W than without: it is another way to solve the same system."""
    taken = {}
    for kind in ("matrix-free", "dense", "compressed"):
        options = dj.SolverOptions(compliance=kind)
        run = dj.Simulation(wall_on_a_wall(friction(k_n)), solver="condensed", options=options)
        run.statics()
        taken[kind] = run.dynamics(dt=0.002, steps=40, motion=lambda time: 3.0 * swaying(time))
    for outcome in taken.values():
        assert outcome.counts.rejected <= 1
        assert outcome.iterations <= 1.3 * taken["matrix-free"].iterations


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
@pytest.mark.parametrize("kind", ["dense", "matrix-free"])
def test_rigid_joints_that_meet(kind):
    """Where they meet, forces of points that stick are not unique, but nothing else depends on it.

    At rest no step is cut, and nothing moves; shaken, the lines of the ledger add up.
    """
    options = dj.SolverOptions(compliance=kind)
    run = dj.Simulation(wall_on_a_wall(RIGID), options=options)
    static = run.statics()
    still = run.dynamics(dt=0.002, steps=30)
    assert still.counts.rejected == 0
    assert difference(still.state.displacement, static.displacement) <= 1e-8
    run = dj.Simulation(wall_on_a_wall(dj.RigidJoint(friction_angle_deg=80.0)), options=options)
    run.statics()
    shaken = run.dynamics(dt=0.002, steps=30, motion=swaying)
    assert shaken.energy.friction > 0.0
    assert max(still.imbalance, shaken.imbalance) <= 1e-10


def test_load_steps_of_a_rigid_joint():
    # Nothing slides at half of the limit: all loads are in proportion and the path is a line.
    one, four = (dj.Simulation(slope(RIGID, 0.5)).statics(steps=steps) for steps in (1, 4))
    assert difference(four.displacement, one.displacement) <= 1e-9
    size = largest(one.joints.traction)
    assert largest(four.joints.traction - one.joints.traction) <= 1e-9 * size
