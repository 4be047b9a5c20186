# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Cantilevers that carry their weight alone, joints grouted afterwards, loads that come later.

A wall of blocks side by side on a clamped base. Expected: each block carries its own weight
(volume times density times g), joints nothing; and, bodies and tied joints being linear,

    u(weight on loose blocks, grout, then the rest) = u(weight on blocks alone) + u(the rest, tied),

where each part is a run of its own and the blocks alone are meshes of their own.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from whole_vectors import relative_difference

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.laws.law import Status
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.surface_stress import SurfaceStress

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=35.0)
BONDED = dj.MohrCoulombJoint(
    normal_stiffness=1e11,
    shear_stiffness=4e10,
    friction_angle_deg=35.0,
    cohesion=2e6,
    tensile_strength=1e6,
)
LENGTH, THICKNESS, HEIGHT = 12.0, 2.0, 6.0
WEIGHT = LENGTH * THICKNESS * HEIGHT * 2400.0 * STANDARD_GRAVITY
CLAMPED = (dj.Fixed(group="base"),)
# Pressed from both ends, so that joints stay closed and stick: the structure is linear.
PRESSED = [
    dj.Traction(group="x_min", value=(4e6, 0.0, 0.0)),
    dj.Traction(group="x_max", value=(-4e6, 0.0, 0.0)),
]


@pytest.fixture
def wall(wall_file, read):
    """``wall(loads, **options)``: three blocks of 4 m side by side, clamped at the base."""
    path = wall_file(
        length=LENGTH, thickness=THICKNESS, height=HEIGHT, divisions=(6, 1, 3), joints=2
    )

    def make(loads, *, law=LAW, supports=CLAMPED, **options):
        return dj.Model(
            read(path),
            material=CONCRETE,
            joints=law,
            supports=list(supports),
            loads=loads,
            **options,
        )

    return make


def largest(comm, values):
    """Largest absolute value on all ranks."""
    return max(comm.allgather(float(np.abs(values).max(initial=0.0))))


def test_blocks_carry_their_own_weight(comm, wall):
    model = wall([dj.Gravity()])
    state = dj.Simulation(model).statics(joints="inactive")
    assert state.inactive == ("joint_1", "joint_2")
    assert not state.joints.traction.any()
    # Nodes on a joint are double: those of a block are the nodes of its cells.
    cells = model.V.dofmap.list
    x = model.V.tabulate_dof_coordinates()[:, 0]
    block = (x[cells].mean(axis=1) // (LENGTH / 3)).astype(int)
    base = model.nodes("base")
    forces = state.reaction.getArray(readonly=True).reshape(-1, 3)
    for i in range(3):
        mine = np.intersect1d(base, cells[block == i])
        total = comm.allreduce(forces[mine].sum(axis=0))
        np.testing.assert_allclose(total, [0.0, 0.0, WEIGHT / 3], rtol=1e-10, atol=1e-10 * WEIGHT)


def test_a_failure_blames_a_joint_that_acts(wall):
    """Joint 2, which moves more, carries nothing yet."""
    contact = wall([dj.Gravity()]).contact
    joint = contact.operator.joint
    assert contact.worst_joint(1.0 + joint) == "joint_2"
    assert contact.without(joint == 1).worst_joint(1.0 + joint) == "joint_1"


@pytest.mark.parametrize("solver", ["condensed", "monolithic"])
def test_tractions_are_those_of_the_later_load(comm, wall, solver):
    weight = dj.Gravity()
    both = wall([weight, *PRESSED])
    run = dj.Simulation(both, solver=solver)
    alone = run.statics(joints="inactive", loads=[weight])
    run.grout()
    after = run.statics(steps=2)
    later = wall(PRESSED)
    tied = dj.Simulation(later, solver=solver).statics()
    counts = later.contact.counts(tied.joints.status)
    assert (counts.open, counts.slip) == (0, 0)  # else nothing could be superposed
    scale = largest(comm, tied.joints.traction)
    assert scale > 1e6
    np.testing.assert_allclose(after.joints.traction, tied.joints.traction, atol=1e-9 * scale)
    np.testing.assert_allclose(
        after.joints.state.gap, tied.joints.state.gap, atol=1e-9 * scale / 4e10
    )
    assert relative_difference(alone.displacement + tied.displacement, after.displacement) < 1e-9
    # Stresses of the cantilevers stay in the results.
    stress = SurfaceStress(both, NodeNumbering(both.V))
    parts = [stress(s.displacement, 0.0).copy() for s in (alone, tied, after)]
    error = largest(comm, parts[0] + parts[1] - parts[2])
    assert error < 1e-9 * largest(comm, parts[2])
    assert largest(comm, parts[0]) > 0.9 * 2400.0 * STANDARD_GRAVITY * HEIGHT * 0.5


def test_joints_left_open(comm, wall):
    """Cold blocks part by alpha 8 K 4 m between centres; one joint is grouted, one is not."""
    cold = dj.Temperature(value=4.0, reference=12.0, expansion=1e-5)
    sides = [dj.Fixed(group=g, components=c) for g, c in (("base", "z"), ("y_min", "y"))]
    # Free to shrink along x about springs, too weak to matter beside the body's stiffness.
    held = dj.Spring(group="base", normal_stiffness=0.0, tangential_stiffness=1e3)
    model = wall([cold], supports=[*sides, held])
    run = dj.Simulation(model)
    parted = run.statics(joints="inactive")
    np.testing.assert_allclose(parted.joints.state.gap[:, 0], 1e-5 * 8.0 * 4.0, rtol=1e-6)
    grouted = run.grout(["joint_2"], gap=2e-5)
    first = model.operator.joint == model.jointed.joint_names.index("joint_1")
    gap = grouted.joints.state.gap[:, 0]
    np.testing.assert_allclose(gap[first], 1e-5 * 8.0 * 4.0, rtol=1e-6)
    np.testing.assert_array_equal(gap[~first], 2e-5)
    np.testing.assert_array_equal(grouted.joints.traction, 0.0)  # nothing across what is open
    later = run.grout().joints.state.gap  # the rest, another day
    assert largest(comm, later) == 0.0


def test_a_bond_in_ufl_holds_from_the_grout_on(comm, wall):
    """Blocks part in the cold by alpha 8 K 4 m = 0.32 mm; where no grout is, no bond pulls.

    Then both joints, grouted one after the other, are at rest: nothing has come since.
    """

    def energy(g):  # bond of 0.5 MPa at 0.3 mm
        apart = (ufl.max_value(g[0], 0.0) ** 2 + g[1] ** 2 + g[2] ** 2) / (2.0 * 3e-4**2)
        return 0.5e11 * ufl.min_value(g[0], 0.0) ** 2 + 250.0 * (1.0 - ufl.exp(-apart))

    law = dj.PotentialJoint(energy, normal_stiffness=1e11, shear_stiffness=250.0 / 3e-4**2)
    cold = dj.Temperature(value=4.0, reference=12.0, expansion=1e-5)
    sides = [dj.Fixed(group=g, components=c) for g, c in (("base", "z"), ("y_min", "y"))]
    held = dj.Spring(group="base", normal_stiffness=0.0, tangential_stiffness=1e4)
    run = dj.Simulation(wall([cold], law=law, supports=[*sides, held]))
    parted = run.statics(joints="inactive").displacement
    first = run.model.operator.joint == run.model.jointed.joint_names.index("joint_1")
    with pytest.raises(dj.JointsError, match=r"'joint_2' \(PotentialJoint\) would have a traction"):
        run.grout(["joint_2"], gap=1e-5)
    for state in (run.grout(["joint_2"]), run.statics(joints=["joint_2"])):
        assert state.inactive == ("joint_1",)
        assert not state.joints.traction[first].any()
        assert largest(comm, state.joints.traction) < 1.0
        np.testing.assert_allclose(state.joints.state.gap[first, 0], 1e-5 * 8.0 * 4.0, rtol=1e-6)
    with pytest.raises(dj.JointsError, match="still inactive: joint_1"):
        run.statics()
    run.grout(["joint_1"])
    assert relative_difference(run.statics().displacement, parted) < 1e-9


@pytest.mark.parametrize("law", [LAW, "ufl"])
def test_blocks_that_moved_into_each_other_touch(comm, wall, law):
    """Warm blocks overlap while they stand alone; a joint not grouted begins closed and idle."""
    if law == "ufl":
        law = dj.PotentialJoint(
            lambda g: 0.5e11 * ufl.min_value(g[0], 0.0) ** 2,
            normal_stiffness=1e11,
            shear_stiffness=0.0,
        )
    warm = dj.Temperature(value=20.0, reference=12.0, expansion=1e-5)
    model = wall([warm], law=law)
    run = dj.Simulation(model)
    overlap = run.statics(joints="inactive").joints.state.gap[:, 0] < 0.0
    assert comm.allreduce(int(overlap.sum())) > 0
    state = run.grout([]).joints
    assert min(comm.allgather(state.state.gap[:, 0].min(initial=0.0))) == 0.0
    assert not state.traction.any()


@pytest.mark.parametrize(
    "law",
    [
        LAW,
        dj.RigidJoint(friction_angle_deg=35.0),
        dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=4e10),
        BONDED,
        {"joint_1": LAW, "joint_2": BONDED},
    ],
)
def test_a_run_stays_at_rest_after_grouting(comm, wall, law):
    """Nothing acts but the weight, which the blocks carry alone: nothing moves."""
    model = wall([dj.Gravity()], law=law)
    run = dj.Simulation(model)
    run.statics(joints="inactive")
    start = run.grout().displacement
    outcome = run.dynamics(dt=1e-3, steps=5)
    assert relative_difference(outcome.state.displacement, start) < 1e-11
    assert outcome.imbalance is None or outcome.imbalance < 1e-12


def test_weight_carried_before_is_no_load_later(comm, wall):
    """A shaken wall moves about its weighed state as one without weight does about zero."""

    def shaking(time):
        return 3.0 * np.array([np.sin(40.0 * time), np.sin(25.0 * time), 0.0])

    moves = []
    for loads in ([], [dj.Gravity()]):
        model = wall(loads)
        run = dj.Simulation(model)
        if loads:
            run.statics(joints="inactive")
            run.grout()
        outcome = run.dynamics(dt=2e-3, steps=20, motion=shaking)
        moved = outcome.state.displacement.copy()
        if loads:
            moved.axpy(-1.0, run.static.displacement)
        moves.append((moved, outcome.state.joints.state.gap))
    (one, gap), (other, same_gap) = moves
    assert comm.allreduce(int((gap[:, 0] > 1e-7).sum())) > 0  # joints have opened
    np.testing.assert_allclose(same_gap, gap, rtol=0, atol=1e-9 * largest(comm, gap))
    assert relative_difference(other, one) < 1e-9


def test_grouted_gaps_that_opened_in_the_cold(comm, wall):
    """Active joints: points that carry nothing are closed, tractions of the others stay."""
    pull = [dj.Traction(group="x_max", value=(1e5, 0.0, 0.0))]
    model = wall(pull)
    run = dj.Simulation(model)
    before = run.statics()
    open_ = before.joints.state.gap[:, 0] > 0.0
    assert comm.allreduce(int(open_.sum())) > 0
    assert comm.allreduce(int((~open_).sum())) > 0
    after = run.grout()
    np.testing.assert_array_equal(after.joints.state.gap[open_], 0.0)
    np.testing.assert_array_equal(after.joints.state.gap[~open_], before.joints.state.gap[~open_])
    np.testing.assert_array_equal(after.joints.traction, before.joints.traction)
    # In balance: another stage with the same loads does not move it.
    there = after.displacement.copy()
    assert relative_difference(there, run.statics().displacement) < 1e-9


@pytest.fixture
def bars(comm, wall_file, read):
    """``bars(law, loads)``: two bars of 6 m between walls, without Poisson's ratio, one joint."""
    path = wall_file(length=12.0, thickness=2.0, height=2.0, divisions=(4, 1, 1), joints=1)

    def make(law, loads=()):
        return dj.Model(
            read(path),
            material=dj.Elastic(young=YOUNG, poisson=0.0, density=2400.0),
            joints=law,
            supports=[dj.Fixed(group="x_min"), dj.Fixed(group="x_max")],
            loads=list(loads),
        )

    return make


YOUNG, BAR, GROUT = 25e9, 6.0, 1e6
LAWS = [
    LAW,
    dj.RigidJoint(friction_angle_deg=35.0),
    dj.RigidJoint(friction_angle_deg=0.0),
    dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=4e10),
    dj.ViscousJoint(law=LAW, normal_viscosity=1e6),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_grout_under_pressure(comm, bars, law):
    """The bars give way by p L / E each; p stays, less what their shrinking takes off.

    Bars that would shrink by d in all let the traction fall by d / (2 L / E + 1 / k), until it is
    none; from there on the joint opens by the rest.
    """
    shrink = GROUT * BAR / YOUNG  # of both bars by each of two loads
    cold = [
        dj.Temperature(value=0.0, reference=shrink / (2 * BAR * 1e-5) * part, expansion=1e-5)
        for part in (1.0, 4.0)
    ]
    run = dj.Simulation(bars(law, cold))
    run.statics(joints="inactive", loads=[])
    state = run.grout(pressure=GROUT)
    side = np.sign(bar_displacements(run.model, state)) * GROUT * BAR / YOUNG
    np.testing.assert_allclose(bar_displacements(run.model, state), side, rtol=1e-9)
    np.testing.assert_allclose(state.joints.traction[:, 0], -GROUT, rtol=1e-9)
    np.testing.assert_allclose(state.joints.traction[:, 1:], 0.0, atol=1e-9 * GROUT)
    frictionless = getattr(law, "friction_angle_deg", None) == 0.0
    assert set(state.joints.status) <= {Status.FRICTIONLESS if frictionless else Status.STICK}
    soft = 2 * BAR / YOUNG + (0.0 if isinstance(law, dj.RigidJoint) else 1e-11)
    less = run.statics(loads=cold[:1]).joints
    np.testing.assert_allclose(less.traction[:, 0], shrink / soft - GROUT, rtol=1e-8)
    np.testing.assert_allclose(
        run.statics().joints.state.gap[:, 0], 5.0 * shrink - GROUT * soft, rtol=1e-6
    )
    # Filled again as it stands open: the faces part by the same as the first time.
    before = bar_displacements(run.model, run.static)
    again = run.grout(["joint_1"], pressure=GROUT)
    np.testing.assert_allclose(again.joints.traction[:, 0], -GROUT, rtol=1e-9)
    np.testing.assert_allclose(bar_displacements(run.model, again) - before, side, rtol=1e-8)


@pytest.mark.parametrize("pressure", [0.0, GROUT])
def test_keys_of_an_open_joint_keep_their_shear_in_the_grout(comm, bars, pressure):
    """Bars shrink apart and the right one bears on the keys; then they swell in the grout.

    Swelling by d in all presses with d / (2 L / E + 1 / k) on top of the pressure, and no force
    along the joint changes.
    """
    cold, warm = (
        dj.Temperature(value=value, reference=0.0, expansion=1e-5) for value in (-10.0, 4.0)
    )
    push = dj.FormLoad(form=lambda v: 3e4 * v[2] * _place(v)[0] * ufl.dx)
    keys = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=4e10)
    run = dj.Simulation(bars(keys, [cold, warm, push]))
    apart = run.statics(loads=[cold, push]).joints
    shear = dj.JointForces(run.model)(apart)["joint_1"].shear_force
    assert comm.allreduce(int((apart.state.gap[:, 0] <= 0.0).sum())) == 0
    assert shear > 1e4
    grouted = run.grout(pressure=pressure)
    np.testing.assert_allclose(grouted.joints.traction[:, 0], -pressure, rtol=1e-9)
    np.testing.assert_allclose(
        grouted.joints.traction[:, 1:], apart.traction[:, 1:], atol=1e-9 * shear
    )
    assert (
        relative_difference(run.statics(loads=[cold, push]).displacement, grouted.displacement)
        < 1e-9
    )
    normal = dj.JointForces(run.model)(run.statics().joints)["joint_1"].normal_force
    swell = 2 * BAR * 1e-5 * 4.0 / (2 * BAR / YOUNG + 1e-11)
    assert normal == pytest.approx(4.0 * (pressure + swell), rel=1e-8)  # 2 m by 2 m


def _place(v):
    """Coordinates on the mesh of a test function (UFL)."""
    return ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(v))


def test_a_law_that_stiffens_bears_the_grout(bars):
    """t = -k m (1 + m / d) at an overlap m: k m = p (sqrt 5 - 1) / 2 where d = p / k."""

    def energy(gap):
        m = ufl.max_value(-gap[0], 0.0)
        return 1e11 * (m**2 / 2.0 + m**3 / (3.0 * GROUT / 1e11))

    law = dj.PotentialJoint(energy, normal_stiffness=1e11, shear_stiffness=0.0)
    run = dj.Simulation(bars(law))
    run.statics(joints="inactive")
    state = run.grout(pressure=GROUT).joints
    np.testing.assert_allclose(state.traction[:, 0], -GROUT, rtol=1e-9)
    np.testing.assert_allclose(state.state.gap[:, 0], -0.5e-5 * (np.sqrt(5.0) - 1.0), rtol=1e-9)


def test_grout_in_keys_that_push_sideways_is_refused(bars):
    """Overlapping by p / k, keys with one flank carry shear that nothing balances.

    By hand, at 45 degrees and without play a flank bears as much along the joint as across it, half
    of the pressure of the base; with two flanks the shears cancel.
    """
    keys = {"depth": 0.1, "flank_angle_deg": 45.0, "spacing": 0.6, "tooth_cohesion": 1e8}
    for back, refused in ((None, True), (0.0, False)):
        law = dj.ShearKeyJoint(
            normal_stiffness=1e11,
            shear_stiffness=4e10,
            friction_angle_deg=35.0,
            backward_play=back,
            **keys,
        )
        run = dj.Simulation(bars(law))
        run.statics(joints="inactive")
        if refused:
            with pytest.raises(
                dj.JointsError, match="'joint_1' .* has a shear traction under 1e.06 Pa of grout"
            ):
                run.grout(pressure=GROUT)
        else:
            start = run.grout(pressure=GROUT).displacement
            assert relative_difference(start, run.statics().displacement) < 1e-11


def bar_displacements(model, state):
    """Displacements along the bars of the joint's nodes on this rank [m]."""
    values = state.displacement.getArray(readonly=True).reshape(-1, 3)[:, 0]
    return np.concatenate([values[model.nodes(side)] for side in ("joint_1-", "joint_1+")])


@pytest.mark.parametrize("law", LAWS[:3], ids=lambda law: type(law).__name__)
def test_pressed_joints_stay_at_rest_and_balance(wall, law):
    """The pressure remains as an initial stress: no motion without a cause, energies close."""
    run = dj.Simulation(wall([dj.Gravity()], law=law))
    run.statics(joints="inactive")
    start = run.grout(pressure=5e4).displacement
    pressed = run.model.contact.integrals(-run.static.joints.traction[:, 0])
    np.testing.assert_allclose(pressed, 5e4 * THICKNESS * HEIGHT, rtol=1e-9)
    outcome = run.dynamics(dt=1e-3, steps=5)
    assert relative_difference(outcome.state.displacement, start) < 1e-11
    motion = dj.synthetic_motion()
    outcome = run.dynamics(dt=2e-3, steps=20, motion=lambda t: 5.0 * motion(t + 2.0))
    assert outcome.imbalance < 1e-11


def test_saved_and_taken_up_again(comm, wall, new_path):
    weight, water = dj.Gravity(), dj.HydrostaticPressure(group="y_min", level=5.0)
    model, path = wall([weight, water]), new_path("weight.static")
    run = dj.Simulation(model)
    run.statics(joints="inactive", loads=[weight])
    run.save_static(path)
    run.grout()
    end = run.statics()
    other = dj.Simulation(model)
    found = other.load_static(path)
    assert found.inactive == ("joint_1", "joint_2")
    assert found.missing == ("HydrostaticPressure_y_min",)
    other.grout()
    resumed = other.statics()
    rounding = 0.0 if comm.size == 1 else 1e-12  # on several ranks MUMPS sums in any order
    assert relative_difference(resumed.displacement, end.displacement) <= rounding
    traction = end.joints.traction
    np.testing.assert_allclose(
        resumed.joints.traction, traction, rtol=0.0, atol=rounding * largest(comm, traction)
    )
    with pytest.raises(
        dj.CheckpointError, match=r"another model or run, .*; load HydrostaticPressure"
    ):
        dj.Simulation(wall([weight])).load_static(path)
    with pytest.raises(dj.CheckpointError, match="There is no checkpoint"):
        other.load_static(new_path("none.static"))
    if comm.rank == 0:
        path.write_bytes(path.read_bytes()[:-40])
    comm.barrier()
    with pytest.raises(dj.CheckpointError, match="or is damaged"):
        other.load_static(path)


def test_a_block_that_does_not_stand_is_refused(wall):
    """Supports on one side of the wall leave two blocks loose; rollers leave all three."""
    message = (
        r"The block around \(6, 1, 3\) m is restrained by supports only, which prevent 0 of 6 "
        r"rigid motions"
    )
    with pytest.raises(dj.JointsError, match=message):
        dj.Simulation(
            wall([dj.Gravity()], supports=[dj.Fixed(group="x_min"), dj.Fixed(group="x_max")])
        ).statics(joints="inactive")
    # Upright and sideways motion and two rotations are restrained, sliding along x, y and turning
    # not.
    with pytest.raises(dj.JointsError, match=r"is restrained .* which prevent 3 of 6"):
        dj.Simulation(
            wall([dj.Gravity()], supports=[dj.Fixed(group="base", components="z")])
        ).statics(joints="inactive")
    springs = [dj.Spring(group="base", normal_stiffness=1e9, tangential_stiffness=1e8)]
    dj.Simulation(wall([dj.Gravity()], supports=springs)).statics(joints="inactive")


@pytest.mark.parametrize("order", [1, 2])
def test_a_plane_block_that_does_not_stand_is_refused(read, two_rectangles_file, order):
    """The upper of two blocks rests on the joint alone."""
    model = dj.Model(
        read(two_rectangles_file(order=order)),
        material=CONCRETE,
        joints=LAW,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    with pytest.raises(dj.JointsError, match=r"is restrained .* which prevent 0 of 3 rigid"):
        dj.Simulation(model).statics(joints="inactive")


def test_without_joints_grouting_is_nothing(read, wall_file):
    path = wall_file(length=4.0, thickness=THICKNESS, height=HEIGHT, divisions=(2, 1, 3), joints=0)
    model = dj.Model(
        read(path), material=CONCRETE, supports=[dj.Fixed(group="base")], loads=[dj.Gravity()]
    )
    run = dj.Simulation(model)
    alone = run.statics(joints="inactive").displacement
    run.grout()
    # Sums of ranks come in any order.
    assert relative_difference(dj.Simulation(model).statics().displacement, alone) <= 1e-13


def test_refusals(wall):
    """One sentence each, on all ranks."""
    weight, water = dj.Gravity(), dj.HydrostaticPressure(group="y_min", level=5.0)
    model = wall([weight, water])
    run = dj.Simulation(model)
    with pytest.raises(dj.JointsError, match="needs a static stage: run statics"):
        run.grout()
    with pytest.raises(dj.JointsError, match="needs a static stage: run statics\\(\\) first"):
        run.save_static("nothing")
    with pytest.raises(ValueError, match="A Gravity of this static stage is not a load"):
        run.statics(loads=[dj.Gravity(acceleration=(0.0, 0.0, -9.0))])
    run.statics(loads=[weight], joints="inactive")
    for stage in (
        run.statics,
        lambda: run.quasi_statics([0.0]),
        lambda: run.dynamics(dt=1e-3, steps=1),
    ):
        with pytest.raises(dj.JointsError, match="still inactive: joint_1, joint_2; call grout"):
            stage()
    with pytest.raises(dj.MeshError, match="There is no joint 'joint_9'; the joints are: joint_1"):
        run.grout(["joint_9"])
    with pytest.raises(ValueError, match="gap is 0.001 m and pressure 1000 Pa; at least"):
        run.grout(gap=1e-3, pressure=1e3)
    run.grout()
    with pytest.raises(
        dj.JointsError, match="does not include HydrostaticPressure_y_min as it acts"
    ):
        run.dynamics(dt=1e-3, steps=1)
    run.statics()
    with pytest.raises(dj.JointsError, match="The joint 'joint_1' cannot become inactive: it has"):
        run.statics(joints="inactive")


def test_water_in_a_joint_is_looked_at_again_after_the_grout(wall):
    """Grouting an open joint takes its water away: that is no start for an earthquake."""
    weight, water = dj.Gravity(), dj.JointWater(joint="joint_1", level=5.0)
    run = dj.Simulation(wall([weight, water]))
    with pytest.raises(
        dj.JointsError, match="JointWater acts in the joint 'joint_1', which is inactive"
    ):
        run.statics(joints="inactive")
    run.statics(joints="inactive", loads=[weight])
    run.grout()
    run.statics(loads=[weight, water])
    run.grout(["joint_1"])
    with pytest.raises(
        dj.JointsError, match="does not include JointWater_joint_1 as it acts in the dynamic"
    ):
        run.dynamics(dt=1e-3, steps=1)
    state = run.statics()
    end = run.dynamics(dt=1e-3, steps=5).state.displacement
    assert relative_difference(end, state.displacement) <= 1e-8
