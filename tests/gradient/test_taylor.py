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
from recorded_blocks import LAW, blocks, integral, recorded, shaken

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


def second_order(run, tape, quantity, change, gradient, sizes=(1.0, 0.5, 0.25)):
    """Check the orders for a change, divided by 4 as long as statuses differ."""
    for part in 0.25 ** np.arange(6):
        halved = {name: part * np.asarray(value) for name, value in change.items()}
        halved = {n: float(v) if v.ndim == 0 else v for n, v in halved.items()}
        test = dj.taylor_test(run, tape, quantity, halved, gradient=gradient, sizes=sizes)
        if not test.flipped.any():
            break
    assert not test.flipped.any()
    rounding = 1e-13 * abs(gradient.value) + 1e-16
    orders = test.orders[test.remainders[1:] > 30.0 * rounding]
    assert abs(test.remainders[0]) < 0.1 * abs(test.linear) + 100.0 * rounding
    assert orders == pytest.approx(2.0, abs=0.15)
    return len(orders)


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_motion(scheme):
    law = dj.Joints(LAW, initial_gaps={"j": 2e-5})
    run, model = shaken(scheme), blocks(law)
    tape = recorded(run, model)
    statuses = {Status(value) for value in np.unique(tape.status)}
    assert statuses >= {Status.OPEN, Status.STICK, Status.SLIP}
    random, count = np.random.default_rng(1), len(tape.contact.operator.areas)
    checked = 0
    for quantity in QUANTITIES.values():
        gradient = tape.gradient(quantity)
        for name, size in CHANGES.items():
            points = name in gradient.by_point
            change = size * random.uniform(0.5, 1.0, count) if points else size
            checked += second_order(run, tape, quantity, {name: change}, gradient)
    assert checked > 20
