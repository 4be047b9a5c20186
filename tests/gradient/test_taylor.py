# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of jointed runs: remainders of the Taylor expansion are of second order.

Expected: |J(h) - J(0) - h J'| is a multiple of h^2 as long as no point changes its
status. The reference is the run itself, repeated with changed parameters.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI

from boxes import box
from recorded_blocks import CONCRETE, LAW, blocks, integral, recorded, shaken

import dolfinx_joints as dj
from dolfinx_joints.laws.law import Status

QUANTITIES = {
    "residual slip": dj.Quantity.at_end("middle", 1),
    "opening at the end": dj.Quantity.at_end("corner", 0),
    "squared displacement": integral("top", 0),
    "squared slip": integral("corner", 1),
}
# Changes of the parameters: large enough for remainders above rounding, without flips.
CHANGES = {
    "normal_stiffness": 2e5,
    "shear_stiffness": 2e6,
    "friction_coefficient": 5e-5,
    "initial_gap": 1e-9,
    "BaseMotion": 3e-5,
    "Gravity": 3e-5,
}
SCHEMES = [dj.EnergyConsistent(), dj.Newmark()]


def second_order(run, tape, quantity, change, gradient, sizes=(1.0, 0.5), **options):
    """Check the orders for a change, divided by 4 as long as statuses differ."""
    for part in 0.25 ** np.arange(6):
        parts = part * np.array(sizes)
        test = dj.taylor_test(
            run, tape, quantity, change, gradient=gradient, sizes=parts, **options
        )
        if not test.flipped.any():
            break
    assert not test.flipped.any()
    rounding = 1e-12 * abs(gradient.value)
    orders = test.orders[test.remainders[1:] > 30.0 * rounding]
    assert test.remainders[0] < 0.1 * part * abs(test.linear) + 100.0 * rounding
    assert orders == pytest.approx(2.0, abs=0.15)
    return len(orders)


@pytest.mark.parametrize(
    "names",
    [
        ("residual slip", "squared displacement"),
        pytest.param(("opening at the end", "squared slip"), marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_motion(scheme, names):
    law = dj.Joints(LAW, initial_gaps={"j": 2e-5})
    run, model = shaken(scheme), blocks(law)
    tape, checked = check_all(run, model, CHANGES, names)
    statuses = {Status(value) for value in np.unique(tape.status)}
    assert statuses >= {Status.OPEN, Status.STICK, Status.SLIP}
    assert checked > 5


def check_all(run, model, changes, names=("residual slip", "squared displacement")):
    """Check the orders for some parameters; return the tape and the number of orders."""
    tape = recorded(run, model)
    count, checked = len(tape.contact.operator.areas), 0
    random = np.random.default_rng(2)
    for quantity in (QUANTITIES[name] for name in names):
        gradient = dj.gradient_of(tape, quantity)
        for name, size in changes.items():
            points = name in gradient.by_point
            change = size * random.uniform(0.5, 1.0, count) if points else size
            checked += second_order(run, tape, quantity, {name: change}, gradient)
    return tape, checked


def push(load):
    """Return a function that loads blocks in static steps until their joint slides."""

    def run(model, tape):
        simulation = dj.Simulation(model, monitors=[tape])
        simulation.statics(loads=[model.loads[0]])
        simulation.statics(steps=4)
        simulation.quasi_statics([1.0, 2.0, 3.0])

    traction = dj.Traction(
        group="right", value=(-35e3, 0.0), factor=lambda t: 1.0 + load * np.sin(t)
    )
    return run, blocks(loads=[dj.Gravity(), traction], supports=[dj.Fixed(group="base"), SPRING])


SPRING = dj.Spring(group="left", normal_stiffness=1e7)
STATIC = {"normal_stiffness": 2e7, "shear_stiffness": 2e7, "friction_coefficient": 1e-3}
STATIC |= {"initial_gap": -1e-8, "Gravity": 1e-3, "Traction_right": 1e-3}


@pytest.mark.parametrize("load", [0.2, -1.5], ids=["slides on", "slides back"])
def test_static_steps(load):
    """Friction depends on the path: the sweep passes all increments, with their partial loads."""
    run, model = push(load)
    tape, checked = check_all(run, model, STATIC)
    assert tape.history().static == len(tape.steps) == 8
    assert (np.array(tape.status) == Status.SLIP).any()
    assert checked > 4


def test_substeps():
    """Steps in which points open or close are cut; slips are scaled to the length of a step."""
    control = dj.StepControl(landing=True, max_halvings=3)
    law = dj.Joints(LAW, initial_gaps={"j": 2e-5})
    tape, checked = check_all(shaken(control=control), blocks(law), CHANGES)
    assert len({step.dt for step in tape.steps}) > 2
    assert checked > 4


def test_adhesion():
    law = dj.AdhesiveJoint(
        normal_stiffness=5e9, shear_stiffness=3e9, friction_coefficient=0.5, adhesion=2e3
    )
    changes = {"adhesion": 40.0, "friction_coefficient": 1e-3, "normal_stiffness": 2e7}
    _, checked = check_all(shaken(steps=40), blocks(law), changes)
    assert checked > 4


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_from_rest_with_a_jump_of_the_motion(scheme):
    """Newmark's first acceleration depends on the loads, but not on the joints."""

    def jump(time):
        return (5.0 * np.cos(20.0 * time), 0.0, 0.0)

    def run(model, tape):
        simulation = dj.Simulation(model, monitors=[tape])
        simulation.dynamics(dt=2e-3, steps=10, motion=jump, scheme=scheme)

    law = dj.Joints(LAW, initial_gaps={"j": 1e-5})
    _, checked = check_all(run, blocks(law), {"BaseMotion": 1e-3, "Gravity": 1e-3})
    assert checked > 2


@pytest.mark.parametrize("scheme", [None, *SCHEMES], ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("name", ["friction_coefficient", "adhesion"])
def test_parameters_of_zero(name, scheme):
    """Compare with the quotient of a small growth: the derivative is one-sided."""
    size = {"friction_coefficient": 1e-6, "adhesion": 1.0}[name]
    traction = dj.Traction(group="right", value=(-35e3, 0.0))

    def value(growth):
        given = {"normal_stiffness": 5e9, "shear_stiffness": 3e9, "friction_coefficient": 0.5}
        kind = dj.AdhesiveJoint if name == "adhesion" else dj.FrictionNoTension
        law = kind(**(given | {name: growth}))
        loads, supports = [dj.Gravity(), traction], [dj.Fixed(group="base"), SPRING]
        tape = dj.Tape(gaps={"middle": "j"})
        simulation = dj.Simulation(blocks(law, loads=loads, supports=supports), monitors=[tape])
        simulation.statics()
        if scheme is not None:
            simulation.dynamics(dt=2e-3, steps=5, scheme=scheme, motion=lambda t: (t, 0.0, 0.0))
        return tape, tape.history().values["middle"][-1, 1]

    (tape, start), (_, end) = value(0.0), value(size)
    gradient = dj.gradient_of(tape, dj.Quantity.at_end("middle", 1))
    assert gradient.by_joint[name]["j"] == pytest.approx((end - start) / size, rel=1e-4)


def test_two_laws_and_whole_joints():
    """Derivatives by the parameters of whole joints, of two joints with different laws."""
    two = box((2.0, 3.0), (2, 6), joints={"j": (1, 1.0), "k": (1, 2.0)}, groups={"base": (1, 0.0)})
    laws = {"j": LAW, "k": dj.frictionless(normal_stiffness=3e9)}
    model = dj.Model(
        two,
        material=CONCRETE,
        joints=laws,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=20.0),
    )
    run = shaken(steps=50)
    tape = recorded(run, model)
    quantity = QUANTITIES["squared displacement"]
    gradient = dj.gradient_of(tape, quantity)
    assert gradient.by_joint["friction_coefficient"]["k"] == 0.0
    for change in (
        {"friction_coefficient": {"j": 1e-3}},
        {"normal_stiffness": {"j": 1e5, "k": 3e5}},
    ):
        assert second_order(run, tape, quantity, change, gradient) > 0


def test_range_ends_where_statuses_flip():
    """Change the friction until statuses flip; the test reports this and the range."""
    run, model = shaken(dj.Newmark()), blocks()
    tape = recorded(run, model)
    quantity = QUANTITIES["residual slip"]
    sizes = 0.25 ** np.arange(9)
    test = dj.taylor_test(run, tape, quantity, {"friction_coefficient": {"j": 0.5}}, sizes=sizes)
    assert test.flipped[0] > 0
    assert 0.0 < test.range_without_flips < 1.0
    assert 0.0 < test.linear_range < 1.0
    inside = test.sizes <= test.linear_range
    prediction = test.sizes[inside] * test.linear
    assert test.changes[inside] == pytest.approx(prediction, rel=0.1)


@pytest.mark.mpi
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_ranks(scheme):
    """Compare ranks with one process; rounding errors grow in a run."""
    law, run = dj.Joints(LAW, initial_gaps={"j": 2e-5}), shaken(scheme, steps=30)
    alone, together = (recorded(run, blocks(law, comm)) for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
    for quantity in QUANTITIES.values():
        one, other = dj.gradient_of(alone, quantity), dj.gradient_of(together, quantity)
        assert other.value == pytest.approx(one.value, rel=1e-9)
        for name, of_joints in one.by_joint.items():
            scale = np.abs(one.by_point[name]).sum()
            assert other.by_joint[name]["j"] == pytest.approx(of_joints["j"], abs=1e-7 * scale)
        assert other.by_load == pytest.approx(one.by_load, rel=1e-7)
