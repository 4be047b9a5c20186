# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water in joints against balances done by hand.

        ____________
       |   upper    |  4 m x 2 m (x 1 m), loose or held at its top
    x0 |____________| x1
       |____________|  <- joint at z = 1 m
       |   lower    |
       //////////////

A pressure p pushes the faces apart; tractions of the joint are effective ones, so that the upper
block is in balance with integral t = (its loads) + integral p n, n pointing up.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from dolfinx.mesh import CellType, create_box, create_rectangle, locate_entities
from shaken_wall import Killed
from whole_vectors import relative_difference

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.loads.water.joint_water import Wetness
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
LENGTH, HEIGHT, FOOT = 4.0, 2.0, 1.0  # of the upper block, height of the lower one [m]
CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
WEIGHT = CONCRETE.density * STANDARD_GRAVITY * LENGTH * HEIGHT  # per metre [N]
GAMMA = 1000.0 * STANDARD_GRAVITY  # of water [N/m^3]
# What ranks can change, the partition, is the same for all cells.
CELLS = ["quadrilateral", "tetrahedron", "triangle", "hexahedron"]
CELLS = CELLS[: 4 if COMM.size == 1 else 2]
OPTIONS = ["follows", "drained", "frozen"][: 3 if COMM.size == 1 else 1]
SOLVERS = ["condensed", "monolithic"][: 2 if COMM.size == 1 else 1]
FRICTION = dj.FrictionNoTension(
    normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=45.0
)


@cache
def blocks(cell="quadrilateral", across=4, cut=False):
    """Groups ``base``, ``top``, and ``x0`` and ``x1`` of the upper block; 1 m thick.

    With ``cut`` another joint, ``cut``, parts the upper block in halves.
    """
    kind, top = getattr(CellType, cell), FOOT + HEIGHT
    if cell in ("hexahedron", "tetrahedron"):
        mesh = create_box(COMM, [[0, 0, 0], [LENGTH, 1, top]], [across, across // 2, 3], kind)
    else:
        mesh = create_rectangle(COMM, [[0, 0], [LENGTH, top]], [across, 3], kind)
    dim, up = mesh.topology.dim, mesh.topology.dim - 1
    mesh.topology.create_connectivity(dim - 1, dim)
    places = {
        "joint": lambda x: np.isclose(x[up], FOOT),
        "base": lambda x: np.isclose(x[up], 0.0),
        "top": lambda x: np.isclose(x[up], top),
        "x0": lambda x: np.isclose(x[0], 0.0) & (x[up] > FOOT - 1e-9),
        "x1": lambda x: np.isclose(x[0], LENGTH) & (x[up] > FOOT - 1e-9),
    }
    if cut:
        places["cut"] = lambda x: np.isclose(x[0], LENGTH / 2) & (x[up] > FOOT - 1e-9)
    groups = {name: locate_entities(mesh, dim - 1, where) for name, where in places.items()}
    joints = {name: groups.pop(name) for name in ("joint", "cut") if name in groups}
    return dj.split_mesh(mesh, joints=joints, groups=groups)


def model_of(jointed, *loads, held=("base",), law=FRICTION, gaps=None, rule="auto", **options):
    supports = [dj.Fixed(group=group) for group in held]
    joints = dj.Joints(law, initial_gaps=gaps or {}, quadrature=rule)
    given = {"material": CONCRETE, "joints": joints, "supports": supports, **options}
    return dj.Model(jointed, loads=list(loads), **given)


def over_joint(model, values):
    """Integral over the joint of values at the rank's points (n,)."""
    return model.contact.integral(values)


def global_traction(model, joints):
    """Integral of the traction, in x, y, z [N]."""
    t = np.einsum("nij,ni->nj", model.operator.frames, joints.traction)
    return np.array([over_joint(model, t[:, i]) for i in range(3)])


def gap_where(where):
    """An initial gap of 1 cm where ``where(points)``, of -1 cm elsewhere."""
    return lambda x: np.where(where(x), 0.01, -0.01)


# Uplift that is given.


@pytest.mark.parametrize("rule", ["nodal", "gauss"])
@pytest.mark.parametrize("cell", CELLS)
def test_uplift_takes_weight_off_the_joint(cell, rule):
    """Contact force = weight - uplift; under the base the reaction is the weight, water or not."""
    pressure = 0.4 * WEIGHT / LENGTH
    model = model_of(
        blocks(cell), dj.Gravity(), dj.Uplift(joint="joint", pressure=pressure), rule=rule
    )
    state = dj.Simulation(model).statics()
    found = global_traction(model, state.joints)
    expected = np.zeros(3)
    expected[model.gdim - 1] = -0.6 * WEIGHT
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * WEIGHT)
    weight = WEIGHT * (HEIGHT + FOOT) / HEIGHT
    reaction = model.resultant(state.reaction, "base")
    np.testing.assert_allclose(reaction[-1], weight, rtol=1e-10)


def test_a_rigid_joint_with_water():
    """The loose block again, at first in statics and then shaken; the joint takes W - U."""
    model = model_of(blocks(), dj.Gravity(), base_water(), law=dj.RigidJoint(friction_angle_deg=45))
    simulation = dj.Simulation(model)
    state = simulation.statics()
    uplift = 0.5 * GAMMA * (2.5 - FOOT) * LENGTH
    found = global_traction(model, state.joints)[1]
    assert found == pytest.approx(uplift - WEIGHT, rel=1e-10)
    outcome = simulation.dynamics(dt=0.002, steps=60, motion=shaking)
    assert outcome.energy_error < 1e-9


def test_total_stress_is_effective_stress_less_pressure():
    """A column between fixed ends, no weight: the pressure only presses the halves apart.

    With nu = 0 the joint carries t where t (1/k_n + L/E) = p L/E, the total stress is t - p.
    """
    pressure, young, stiffness = 1e6, 24e9, 1e9
    law = dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=30.0
    )
    model = model_of(
        blocks(),
        dj.Uplift(joint="joint", pressure=pressure),
        held=("base", "top"),
        law=law,
        material=dj.Elastic(young=young, poisson=0.0, density=0.0),
        gaps={"joint": -0.01},
    )
    state = dj.Simulation(model).statics()
    series = (HEIGHT + FOOT) / young
    closed = -0.01 / (1.0 / stiffness + series)  # of the interference alone
    effective = closed + pressure * series / (1.0 / stiffness + series)
    np.testing.assert_allclose(state.joints.traction[:, 0], effective, rtol=1e-10)
    top = model.resultant(state.reaction, "top")[1]
    assert top == pytest.approx((effective - pressure) * LENGTH, rel=1e-10)


@pytest.mark.parametrize("angle", [0.0, 20.0])
@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_a_block_under_water_weighs_less_by_the_water_displaced(blocks_file, read, cell, angle):
    """Water on its top, its sides and in the joint: rho g V upwards and nothing sideways."""
    level = 2.7

    def pore(x):
        return GAMMA * (level - x[:, 2])

    model = model_of(
        read(blocks_file(cell=cell, angle=angle)),
        dj.Gravity(),
        dj.HydrostaticPressure(group="top", level=level),
        dj.HydrostaticPressure(group="sides", level=level),
        dj.Uplift(joint="joint_1", pressure=pore),
    )
    state = dj.Simulation(model).statics()
    weight, buoyancy = CONCRETE.density * STANDARD_GRAVITY, GAMMA  # V = 1 m^3
    np.testing.assert_allclose(
        global_traction(model, state.joints), [0, 0, buoyancy - weight], atol=1e-10 * weight
    )


def test_sliding_begins_where_friction_ends():
    """mu (W - U) = H: the block rests with 0.5 % more friction and slides with 0.5 % less."""
    level = FOOT + HEIGHT
    thrust = 0.5 * GAMMA * HEIGHT**2
    line = dj.SeepageLine(start=(0, FOOT), end=(LENGTH, FOOT), upstream=level, downstream=FOOT)
    uplift = 0.5 * GAMMA * HEIGHT * LENGTH  # a triangle
    for share, rests in ((1.005, True), (0.995, False)):
        angle = math.degrees(math.atan(share * thrust / (WEIGHT - uplift)))
        law = dj.FrictionNoTension(
            normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=angle
        )
        model = model_of(
            blocks(),
            dj.Gravity(),
            dj.HydrostaticPressure(group="x0", level=level),
            dj.Uplift(joint="joint", pressure=line),
            law=law,
        )
        if rests:
            state = dj.Simulation(model).statics()
            np.testing.assert_allclose(
                global_traction(model, state.joints)[:2], [thrust, uplift - WEIGHT], rtol=1e-9
            )
        else:
            with pytest.raises(dj.ConvergenceError):
                dj.Simulation(model).statics()


def test_levels_along_a_seepage_line():
    """By hand: 10 m upstream, 2 m downstream, at a drain after 20 % of the way 2 + 8/4 = 4 m."""
    line = dj.SeepageLine(
        start=(0.0, 0.0), end=(10.0, 0.0), upstream=10.0, downstream=2.0, drain=(0.2, 0.25)
    )
    x = np.array([[-1, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [6, 0, 0], [10, 1, 0], [12, 3, 0]])
    levels = np.array([10.0, 10.0, 7.0, 4.0, 3.0, 1.0, 0.0])  # less the height y
    np.testing.assert_allclose(line(x.astype(float)), GAMMA * levels, rtol=1e-14)
    plain = dj.SeepageLine(start=(0, 0), end=(10, 0), upstream=10.0, downstream=2.0)
    assert plain(x[4:5].astype(float))[0] == pytest.approx(GAMMA * 5.2, rel=1e-14)


def test_a_pressure_below_zero_by_rounding_is_zero():
    """A triangle that ends 1e-16 m before the downstream end, 4e-12 Pa of 4e4 below zero there.

    Also on ranks that have none but that end; 1e-9 of the largest is no rounding.
    """
    model = model_of(blocks(), rule="nodal")

    def water(past):
        def pressure(x):
            return GAMMA * (LENGTH - x[:, 0]) - np.where(x[:, 0] > LENGTH - 1e-9, past, 0.0)

        return dj.JointWater(joint="joint", level=0.0, closed=pressure).in_joint("water", model)

    closed = water(4e-12).pressure(np.zeros(len(model.operator.points), dtype=np.int8))
    expected = GAMMA * (LENGTH - model.operator.points[:, 0])
    np.testing.assert_array_equal(closed, np.maximum(expected, 0.0))
    with pytest.raises(ValueError, match="it must be one finite number of zero or more"):
        water(4e-5)


# Water that follows the joint, statics.


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(("rule", "area"), [("gauss", 2.0), ("nodal", 1.5)])
def test_half_open_joint(cell, rule, area):
    """Pressure times open area: the facets with Gauss points, the shares of open nodes else.

    Of 4 facets along x, those below x = 2 are open; with nodes those at 0 and 1 m, which hold 1/2
    and 1 facet. The upper block hangs on its top: reaction + p A + contact = 0.
    """
    level, closed = 30.0, 5e4
    water = dj.JointWater(joint="joint", level=level, closed=closed)
    model = model_of(
        blocks(cell),
        water,
        held=("base", "top"),
        rule=rule,
        gaps={"joint": gap_where(lambda x: x[:, 0] < 2.0 - 1e-6)},
    )
    simulation = dj.Simulation(model)
    state = simulation.statics()
    p = GAMMA * (level - FOOT)
    resultant = p * area + closed * (LENGTH - area)
    assert over_joint(model, water.at_points(model, state.joints)) == pytest.approx(
        resultant, rel=1e-12
    )
    contact = global_traction(model, state.joints)[model.gdim - 1]
    top = model.resultant(state.reaction, "top")[-1]
    scale = abs(contact) + resultant
    assert abs(top + resultant - contact) < 1e-10 * scale


def test_pressure_follows_its_factor_of_time():
    """The halves are apart by 1 mm, and by f p L/E more, nu = 0."""
    young = 24e9
    water = dj.JointWater(joint="joint", level=FOOT + 10.0, factor=lambda t: t)
    model = model_of(
        blocks(),
        water,
        held=("base", "top"),
        material=dj.Elastic(young=young, poisson=0.0, density=0.0),
        gaps={"joint": 1e-3},
    )
    simulation = dj.Simulation(model)
    for factor in (1.0, 0.25):
        gap = simulation.quasi_statics([factor]).joints.state.gap[:, 0]
        wider = factor * 10.0 * GAMMA * (HEIGHT + FOOT) / young
        np.testing.assert_allclose(gap, 1e-3 + wider, rtol=1e-12)


def test_a_user_defined_load_may_follow_the_joints():
    """All that such a load needs is `FollowsJoints`."""
    water = dj.JointWater(joint="joint", level=30.0)

    class Follower:
        joint = "joint"

        def patterns(self, model):
            return []

        def in_joint(self, name, model):
            return water.in_joint(name, model)

    forces = []
    for load in (water, Follower()):
        model = model_of(
            blocks(),
            load,
            held=("base", "top"),
            gaps={"joint": gap_where(lambda x: x[:, 0] < 2)},
        )
        system = model.system()
        assert system.water.names == [f"{type(load).__name__}_joint"]
        assert list(system.in_joints) == [load]
        forces.append(dj.Simulation(model).statics().displacement)
    # To rounding: on several ranks MUMPS adds in the order in which messages come.
    assert relative_difference(*forces) <= 1e-12


def test_water_keeps_a_joint_open_that_it_does_not_open():
    """The halves are pulled apart by U against an interference of 0.1 mm, nu = 0.

    Dry the gap is U - 0.1 mm; wet it is wider by p L/E = 0.01225 mm. At U = 0.095 mm both closed
    and open are in balance: closed on the way up, open on the way down.
    """
    interference, young = 1e-4, 24e9
    wider = GAMMA * 10.0 * (HEIGHT + FOOT) / young
    water = dj.JointWater(joint="joint", level=FOOT + 10.0)
    model = model_of(
        blocks(),
        water,
        held=(),
        material=dj.Elastic(young=young, poisson=0.0, density=0.0),
        gaps={"joint": -interference},
        supports=[
            dj.Fixed(group="base"),
            dj.Fixed(group="top", components="x"),
            dj.Prescribed(group="top", component="y", value=lambda t: t),
        ],
    )
    simulation = dj.Simulation(model)
    for pull, wet in ((0.95e-4, False), (1.2e-4, True), (0.95e-4, True), (0.8e-4, False)):
        state = simulation.quasi_statics([pull])
        gap = state.joints.state.gap[:, 0]
        pressure = water.at_points(model, state.joints)
        if wet:
            np.testing.assert_allclose(gap, pull - interference + wider, rtol=1e-9)
            np.testing.assert_allclose(pressure, GAMMA * 10.0, rtol=1e-14)
        else:
            assert (gap < 0.0).all()
            assert not pressure.any()


@pytest.mark.parametrize("rule", ["nodal", "gauss"])
@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_water_reaches_what_is_connected(cell, rule):
    """8 facets of 0.5 m; open but for [1.4, 2.1], where two facets or the nodes 1.5 and 2 close.

    A closed mouth keeps the water out.
    """
    ends = gap_where(lambda x: (x[:, 0] < 1.4) | (x[:, 0] > 2.1))
    for group, where, side in (
        ("x0", ends, lambda x: x < 1.4),
        ("x1", ends, lambda x: x > 2.1),
        ("x0", gap_where(lambda x: x[:, 0] > 0.7), lambda x: x < 0.0),
    ):
        water = dj.JointWater(joint="joint", level=5.0, reached_from=group)
        model = model_of(
            blocks(cell, 8),
            water,
            held=("base", "top"),
            rule=rule,
            gaps={"joint": where},
        )
        state = dj.Simulation(model).statics()
        wet = water.at_points(model, state.joints) > 0.0
        np.testing.assert_array_equal(wet, side(model.operator.points[:, 0]))


@pytest.mark.parametrize("rule", ["nodal", "gauss"])
@pytest.mark.parametrize("cell", CELLS)
def test_water_passes_where_another_joint_crosses(cell, rule):
    """All of an open joint bears gamma (level - FOOT), also beyond a joint that ends at it."""
    water = dj.JointWater(joint="joint", level=5.0, reached_from="x0")
    model = model_of(
        blocks(cell, cut=True),
        water,
        held=("base", "top"),
        rule=rule,
        gaps={"joint": 0.01, "cut": 0.01},
    )
    state = dj.Simulation(model).statics()
    pushed = over_joint(model, water.at_points(model, state.joints))
    assert pushed == pytest.approx(GAMMA * (5.0 - FOOT) * LENGTH, rel=1e-12)


@pytest.mark.parametrize("rule", ["nodal", "gauss"])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_water_goes_round_corners(cell, rule):
    """Round a wall across the joint, from 1.4 to 2.1 m, that has a way through beside y = 1."""

    def open_there(x, gate):
        return (x[:, 0] < 1.4) | (x[:, 0] > 2.1) | (x[:, 1] > gate)

    for gate, everywhere in ((0.7, True), (2.0, False)):
        water = dj.JointWater(joint="joint", level=5.0, reached_from="x0")
        model = model_of(
            blocks(cell, 8),
            water,
            held=("base", "top"),
            rule=rule,
            gaps={"joint": gap_where(lambda x, gate=gate: open_there(x, gate))},
        )
        state = dj.Simulation(model).statics()
        wet = water.at_points(model, state.joints) > 0.0
        x = model.operator.points
        expected = open_there(x, gate) & (everywhere | (x[:, 0] < 1.4))
        np.testing.assert_array_equal(wet, expected)


@pytest.mark.parametrize("wet", [False, True])
def test_a_crack_that_water_drives_on(wet):
    """A stiff block on a soft joint without tension, W in its middle and a couple M on its top.

    With the crack a, full of water of pressure p, the contact is a triangle over L - a:

        N = W - p a,   M = W L/2 - p a (L - a/2) - N (L - a)/3   about the toe.

    M is taken for a = L/4 under water; dry the same M cracks L - 3 (L/2 - M/W). The front lies
    between two points, and what a facet of pressure turns is passed on 3.5 times over.
    """
    pressure, crack, across = 2e4, LENGTH / 4.0, 80 if COMM.size == 1 else 16
    contact = (WEIGHT - pressure * crack) * (LENGTH - crack) / 3.0
    couple = WEIGHT * LENGTH / 2.0 - pressure * crack * (LENGTH - crack / 2.0) - contact
    if not wet:
        crack = LENGTH - 3.0 * (LENGTH / 2.0 - couple / WEIGHT)
    jointed = blocks(across=across)
    x = ufl.SpatialCoordinate(jointed.mesh)
    twist = 12.0 * couple / LENGTH**3
    loads = [
        dj.Gravity(),
        dj.FormLoad(form=lambda v: -twist * (x[0] - LENGTH / 2.0) * v[1] * jointed.ds("top")),
    ]
    water = dj.JointWater(joint="joint", level=FOOT + pressure / GAMMA, reached_from="x0")
    soft = dj.FrictionNoTension(normal_stiffness=1e8, shear_stiffness=1e8, friction_angle_deg=45.0)
    model = model_of(
        jointed,
        *loads,
        *([water] if wet else []),
        law=soft,
        material=dj.Elastic(young=1e12, poisson=0.0, density=CONCRETE.density),
    )
    state = dj.Simulation(model).statics()
    opened = over_joint(model, 1.0 * (state.joints.state.gap[:, 0] > 0.0))
    assert opened == pytest.approx(crack, abs=3.5 * LENGTH / across if wet else LENGTH / across)
    resultant = over_joint(model, water.at_points(model, state.joints))
    assert resultant == pytest.approx(pressure * opened, rel=1e-12)
    uplift = resultant if wet else 0.0
    assert global_traction(model, state.joints)[1] == pytest.approx(uplift - WEIGHT, rel=1e-8)


def test_water_that_does_not_settle_is_said():
    """Closed, the joint has a pressure that opens it; open, it has none and closes."""
    water = dj.JointWater(joint="joint", level=0.0, closed=1e6)
    model = model_of(blocks(), water, held=("base", "top"))
    points = model.operator.num_points
    sentence = (
        rf"water in the joint 'joint' does not converge in a static stage: after 2 "
        rf"iterations {points} joint points still change between wet and dry"
    )
    with pytest.raises(dj.JointsError, match=sentence) as error:
        dj.Simulation(model).statics(steps=2, name="filling")
    assert error.value.__notes__ == ["In the static stage 'filling'."]


# Dynamics.


def shaking(time):
    """Strong enough to open and close the joint of the block several times, [m/s^2]."""
    return 9.0 * np.sin(2 * np.pi * 8.0 * time), 12.0 * np.sin(2 * np.pi * 10.4 * time)


class History(Monitor):
    """Gap, water pressure and work of the water at each step."""

    def __init__(self, water):
        self.water = water

    def start(self, model, stage, steps, first):
        self.model, self.gap, self.pressure, self.work, self.cuts = model, [], [], [], 0
        self.record(first)

    def record(self, record):
        self.gap.append(record.joints.state.gap[:, 0])
        self.pressure.append(self.water.at_points(self.model, record.joints))
        self.work.append(record.energy.input_by_load["JointWater_joint"])
        self.cuts += max(record.substeps - 1, 0)


def shaken(water, scheme=None, steps=120, solver="auto", **options):
    """The loose block under its weight and the reservoir, then shaken."""
    model = model_of(
        blocks(),
        dj.Gravity(),
        dj.HydrostaticPressure(group="x0", level=2.5),
        water,
        damping=dj.stiffness_proportional(ratio=0.02, frequency=20.0),
    )
    history = History(water)
    simulation = dj.Simulation(model, monitors=[history], solver=solver)
    simulation.statics()
    outcome = simulation.dynamics(
        dt=0.002, steps=steps, motion=shaking, scheme=scheme or dj.EnergyConsistent(), **options
    )
    return model, history, outcome


def base_water(**options):
    """Half of the triangle where the joint is closed, the whole head where it opens."""
    line = dj.SeepageLine(start=(0, FOOT), end=(LENGTH, FOOT), upstream=2.5, downstream=FOOT)
    return dj.JointWater(joint="joint", level=2.5, closed=line, **options)


@pytest.mark.parametrize("solver", SOLVERS)
def test_work_of_water_that_follows(solver):
    """Pressures of a step's end are those of the state at its start, and act by their mean.

    So the work is the sum over steps of (p_{n-2} + p_{n-1}) / 2 times the change of the gap to
    g_n, from the states alone, and the ledger closes.
    """
    model, history, outcome = shaken(base_water(), solver=solver)
    assert history.cuts == 0
    p = [history.pressure[0], *history.pressure]
    works = [
        over_joint(model, 0.5 * (p[n - 1] + p[n]) * (history.gap[n] - history.gap[n - 1]))
        for n in range(1, len(history.gap))
    ]
    largest = np.abs(history.work).max()
    assert largest > 1.0
    np.testing.assert_allclose(history.work[1:], np.cumsum(works), atol=1e-9 * largest)
    assert outcome.energy_error < 1e-9
    # The water came and went: fails if the joint did not open at all.
    wet = [over_joint(model, q > history.pressure[0] + 1.0) for q in history.pressure]
    assert max(wet) > 0.2 * LENGTH
    assert min(wet[wet.index(max(wet)) :]) < 0.5 * max(wet)


@pytest.mark.filterwarnings("ignore:The energy error is")  # Newmark's, at impacts
@pytest.mark.parametrize("in_dynamics", OPTIONS)
@pytest.mark.parametrize("scheme", [dj.EnergyConsistent(), dj.Newmark()])
def test_every_line_of_the_ledger_adds_up(scheme, in_dynamics):
    _, _, outcome = shaken(base_water(in_dynamics=in_dynamics), scheme, steps=60)
    assert outcome.imbalance < 1e-9


def test_frozen_water_is_a_given_uplift():
    water = base_water(in_dynamics="frozen")
    _, history, outcome = shaken(water, steps=60)
    model = model_of(
        blocks(),
        dj.Gravity(),
        dj.HydrostaticPressure(group="x0", level=2.5),
        dj.Uplift(joint="joint", pressure=water.closed),
        damping=dj.stiffness_proportional(ratio=0.02, frequency=20.0),
    )
    # The joint is closed at the start.
    np.testing.assert_allclose(
        history.pressure[0], model.loads[2].at_points(model), rtol=1e-12, atol=1e-9
    )
    simulation = dj.Simulation(model)
    simulation.statics()
    same = simulation.dynamics(dt=0.002, steps=60, motion=shaking)
    assert relative_difference(same.state.displacement, outcome.state.displacement) < 1e-9
    assert outcome.energy.input_by_load["JointWater_joint"] == pytest.approx(
        same.energy.input_by_load["Uplift_joint"], rel=1e-8
    )


@pytest.mark.parametrize("in_dynamics", OPTIONS)
def test_a_continued_run_keeps_its_water(new_path, in_dynamics):
    """Stopped in the middle of the opening; bit for bit on one rank.

    On several the direct solver adds up in the order in which messages come.
    """

    class Killer(History):
        def record(self, record):
            super().record(record)
            if record.step == kill:
                raise Killed

    def run(kept=None):
        water = base_water(in_dynamics=in_dynamics)
        model = model_of(blocks(), dj.Gravity(), water)
        simulation = dj.Simulation(model, monitors=[Killer(water)])
        if kept is None or not kept.resume:
            simulation.statics()
        return simulation.dynamics(dt=0.002, steps=60, motion=shaking, checkpoint=kept).state

    kill = None
    whole = run()
    kept = dj.Checkpoints(new_path("water.ckpt"), every=7)
    kill = 45
    with pytest.raises(Killed):
        run(kept)
    kill = None
    resumed = run(replace(kept, resume=True))
    np.testing.assert_array_equal(resumed.water, whole.water)
    found, expected = resumed.displacement.array, whole.displacement.array
    rounding = 0.0 if COMM.size == 1 else 1e-10 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=rounding)


@pytest.mark.parametrize("in_dynamics", OPTIONS[:2])
def test_a_stage_that_goes_on_keeps_its_water(in_dynamics):
    """Two stages of 34 steps are one of 68; the second begins with the joint open."""

    def run(*stages):
        water = base_water(in_dynamics=in_dynamics)
        model = model_of(blocks(), dj.Gravity(), water)
        simulation = dj.Simulation(model)
        simulation.statics()
        state, waters = None, []
        for steps in stages:
            state = simulation.dynamics(dt=0.002, steps=steps, motion=shaking, start=state).state
            waters.append(set(np.concatenate(COMM.allgather(state.water))))
        return state, waters

    whole, _ = run(68)
    parts, waters = run(34, 34)
    code = Wetness.FULL if in_dynamics == "follows" else Wetness.DRAINED
    assert code in waters[0]
    np.testing.assert_array_equal(parts.water, whole.water)
    assert relative_difference(parts.displacement, whole.displacement) < 1e-9


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_water_given_to_a_stage_alone():
    """Its work is in the ledger as that of a load of the model is."""
    model = model_of(blocks(), dj.Gravity())
    simulation = dj.Simulation(model)
    simulation.statics()
    outcome = simulation.dynamics(dt=0.002, steps=60, motion=shaking, loads=[base_water()])
    assert abs(outcome.energy.input_by_load["JointWater_joint"]) > 1.0
    assert outcome.imbalance < 1e-9


# What is refused.


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: dj.Uplift(joint="joint", pressure=-1.0),
            "Uplift: pressure is -1 Pa; it must be zero or more.",
        ),
        (
            lambda: dj.SeepageLine(start=(0, 0), end=(0, 0), upstream=1.0, downstream=0.0),
            "SeepageLine: end is (0, 0); it must be another point than start (0, 0), with the same "
            "number of coordinates.",
        ),
        (
            lambda: dj.SeepageLine(
                start=(0, 0), end=(1, 0), upstream=1.0, downstream=0.0, drain=(1.5, 0.3)
            ),
            "SeepageLine: drain is (1.5, 0.3); its position must be between 0 and 1 (exclusive) "
            "and the remaining share from 0 to 1.",
        ),
    ],
)
def test_bad_parameters(make, sentence):
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        make()
    assert str(refused.value) == sentence


@pytest.mark.parametrize(
    ("loads", "sentence"),
    [
        (
            [dj.Uplift(joint="lift", pressure=1.0)],
            "Uplift in 'lift': this joint does not exist; the joints are: joint.",
        ),
        (
            [dj.Uplift(joint="joint", pressure=lambda x: np.ones((len(x), 2)))],
            "Uplift in 'joint': pressure is an array of shape",
        ),
        (
            [dj.JointWater(joint="joint", level=1.0, closed=lambda x: np.full(len(x), -4.0))],
            "it must be one finite number of zero or more for each of the",
        ),
        (
            [dj.JointWater(joint="joint", level=1.0, reached_from="top")],
            "The facet group 'top' does not touch the joint 'joint'.",
        ),
        (
            [dj.JointWater(joint="joint", level=1.0, reached_from="dry")],
            "The mesh has no facet group 'dry'",
        ),
        (
            [dj.JointWater(joint="joint", level=level) for level in (1.0, 2.0)],
            "2 loads depend on the gap of joint 'joint'; give one.",
        ),
        (
            [dj.JointWater(joint="joint", level=1.0, factor=lambda _: math.inf)],
            "JointWater_joint: factor at t = 0 s is inf; it must be a finite number",
        ),
    ],
)
def test_bad_loads(loads, sentence):
    model = model_of(blocks(), *loads, held=("base", "top"))
    with pytest.raises(ValueError, match=".") as refused:
        dj.Simulation(model).statics()
    assert sentence in str(refused.value)
