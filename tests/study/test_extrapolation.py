# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Estimated errors of sequences whose error is known, and the cheapest run by hand."""

import numpy as np
import pytest

from dolfinx_joints.study.extrapolation import Cost, Estimate, cheapest, estimated_error

STEPS = np.array([1.0, 2.0, 4.0])
CELLS = np.array([1.0, 1.26, 1.6])


@pytest.mark.parametrize("sizes", [STEPS, CELLS])
@pytest.mark.parametrize("order", [0.6, 1.0, 2.0])
def test_a_power_of_the_size_is_estimated_exactly(sizes, order):
    # v = 5 - 0.3 h^p: the error at h = 1 is 0.3.
    estimate = estimated_error(sizes, 5.0 - 0.3 * sizes**order, formal_order=2.0)
    assert estimate.kind == "order"
    assert estimate.order == pytest.approx(order, rel=1e-4)
    assert estimate.error == pytest.approx(0.3, rel=1e-4)


def test_finer_runs_give_the_error_of_the_given_one():
    # The three finest are 0.25, 0.5, 1; that of 8 does not follow the power.
    sizes = np.array([1.0, 8.0, 0.5, 0.25])
    values = 5.0 - 0.3 * sizes**2
    values[1] = 17.0
    estimate = estimated_error(sizes, values, formal_order=2.0)
    assert estimate.error == pytest.approx(0.3, rel=1e-4)


def test_an_order_above_the_formal_one_is_limited():
    # v = h^2.5 with the formal order 2: differences 2^2.5 - 1, of which (2^2 - 1) is a part.
    estimate = estimated_error(STEPS, STEPS**2.5, formal_order=2.0)
    assert (estimate.order, estimate.rate) == pytest.approx((2.5, 2.0), rel=1e-4)
    assert estimate.error == pytest.approx((2.0**2.5 - 1.0) / 3.0, rel=1e-9)


@pytest.mark.parametrize(
    ("sizes", "values", "bound"),
    [
        (STEPS, [1.0, 1.3, 1.1], 3.0 * 0.3 / (1.0 + 2.0)),  # not monotone
        (STEPS, [1.0, 1.01, 1.81], 3.0 * 0.81 / (1.0 + 4.0)),  # of order 6.3, by chance
        (CELLS, [1.0, 1.26, 1.53], 1.25),  # of order 0.02; of first order the limit would be 0
        ([0.25, 0.5, 1.0], [1.1, 1.3, 1.0], 0.1 + 0.25 * 3.0 * 0.2 / 0.75),  # finer runs
    ],
)
def test_values_without_an_order_have_a_bound(sizes, values, bound):
    estimate = estimated_error(sizes, values, formal_order=2.0)
    assert (estimate.kind, estimate.rate) == ("no order", 1.0)
    assert np.isnan(estimate.order)
    assert estimate.error == pytest.approx(bound)


@pytest.mark.parametrize("power", [0.455, 0.2])
def test_a_peak_at_a_corner_grows(power):
    # h^(lambda - 1); lambda is 0.545 at a re-entrant corner of 90 degrees (Williams 1952).
    values = 2.0 * CELLS**-power
    estimate = estimated_error(CELLS, values, formal_order=2.0, may_grow=True)
    assert (estimate.kind, estimate.error) == ("growth", np.inf)
    # Of a displacement it is a sequence without order, and so is a peak that falls.
    assert estimated_error(CELLS, values, formal_order=2.0).kind == "no order"
    falling = estimated_error(CELLS, 5.0 - values, formal_order=2.0, may_grow=True)
    assert falling.kind == "no order"


def test_a_peak_that_converges_does_not_grow():
    values = 2.0 - 0.3 * CELLS
    assert estimated_error(CELLS, values, formal_order=2.0, may_grow=True).kind == "order"


def test_equal_values_and_a_single_run_have_no_error():
    equal = estimated_error(STEPS, 3.0 + 1e-12 * STEPS, formal_order=2.0)
    alone = estimated_error([1.0], [3.0], formal_order=2.0)
    assert (equal.kind, equal.error) == ("constant", 0.0)
    assert (alone.kind, alone.error) == ("not varied", 0.0)


def test_the_cost_of_runs_is_fitted():
    # (2 + 6 / x) y^-3 seconds
    steps = {x: 2.0 + 6.0 / x for x in (1.0, 2.0, 4.0)}
    cells = {y: 8.0 * y**-3 for y in (1.0, 1.26, 1.6)}
    cost = Cost.fitted(steps, cells)
    assert (cost.fixed, cost.per_step, cost.power) == pytest.approx((2.0, 6.0, 3.0))
    assert cost(0.5, 0.5) == pytest.approx(14.0 * 8.0)
    assert Cost.fitted(steps, {1.0: 8.0}).power == 0.0


def order_two(error):
    return Estimate(kind="order", error=error, order=2.9, rate=2.0)


def test_the_cheapest_run():
    # Least x^-1 y^-3 with e x^2 + f y^2 = a: e x^2 = a / 4, f y^2 = 3 a / 4 (Lagrange).
    cost = Cost(fixed=0.0, per_step=7.0, power=3.0)
    x, y, seconds = cheapest(0.01, [order_two(0.02), order_two(0.05)], (4.0, 1.6), cost)
    assert (x, y) == pytest.approx((np.sqrt(0.0025 / 0.02), np.sqrt(0.0075 / 0.05)), rel=1e-9)
    assert seconds == pytest.approx(7.0 / x / y**3)


def test_limits_of_the_cheapest_run():
    cost = Cost(fixed=0.0, per_step=7.0, power=3.0)
    zero = Estimate(kind="constant", error=0.0)
    assert cheapest(0.0, [zero, zero], (4.0, 1.0), cost) == pytest.approx((4.0, 1.0, 1.75))
    growth = Estimate(kind="growth", error=np.inf)
    for errors in ([zero, growth], [order_two(10.0), zero]):  # the step would be 1/32
        assert np.isnan(cheapest(0.01, errors, (4.0, 1.6), cost)).all()
