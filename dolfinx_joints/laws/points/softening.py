# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bond of one point that softens: functions of one mode, and the bond in both modes.

The load r = (<g_n>/g_0)^2 + (|s|/s_0)^2 is 1 where softening starts, with the opening and the slip
g_0 and s_0 there. The largest load so far is R. The bond keeps the share f(R) of its stiffness in
each mode, see (9d) of docs/theory. A step follows a path on which the squares of opening and slip
change in proportion. On it r changes at a constant rate, so the mean of f over the path is an
integral over r in closed form, and the work is exact. Very short steps lose no digits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dolfinx_joints.common.kernels import inline

# A change of r below this part of r has the slope of f at its end instead of a difference quotient.
SHORT_CHANGE = 1e-6


class Softening(NamedTuple):
    """Softening of one mode.

    Attributes:
        ductility: Fracture energy divided by the elastic energy where softening starts, above 1.
        exponential: True for exponential, False for linear softening.
    """

    ductility: float
    exponential: bool


class Mean(NamedTuple):
    """Share f of the stiffness in a step.

    Attributes:
        share: Mean over the step, or value at its end.
        slope: Derivative of ``share`` by r at the end.
        end: Value at the end of the step.
        end_slope: Derivative of ``end`` by r at the end.
        lost: Decrease of f in the step.
        moment: Integral of R - r over d f, from the largest load R at the start.
    """

    share: float
    slope: float
    end: float
    end_slope: float
    lost: float
    moment: float


@inline
def unchanged(share: float) -> Mean:
    """Return the share of a step in which the bond does not soften."""
    return Mean(share, 0.0, share, 0.0, 0.0, 0.0)


@inline
def intact_share(load: Any, curve: Softening) -> Any:
    """Return the share f of the stiffness at a largest load R, (9d); a number or an array."""
    x = np.sqrt(np.maximum(load, 1.0))
    excess = curve.ductility - 1.0
    if curve.exponential:
        return np.exp(-2.0 * (x - 1.0) / excess) / x
    return np.maximum((curve.ductility / x - 1.0) / excess, 0.0)


@inline
def _slope(load: float, curve: Softening) -> float:
    """Return d f / d R at a load of at least 1."""
    x, excess = np.sqrt(load), curve.ductility - 1.0
    if curve.exponential:
        return -np.exp(-2.0 * (x - 1.0) / excess) / x * (1.0 / x + 2.0 / excess) / (2.0 * x)
    return -curve.ductility / (2.0 * excess * x * load) if x < curve.ductility else 0.0 * x


@inline
def _mean_share(start: float, end: float, curve: Softening) -> float:
    """Return the mean of f over the loads from start to end, start at least 1."""
    a, b, excess = np.sqrt(start), np.sqrt(end), curve.ductility - 1.0
    if curve.exponential:
        z = 2.0 * (b - a) / excess
        falls = -np.expm1(-z) / z if z > 0.0 else 1.0
        return 2.0 / (a + b) * np.exp(-2.0 * (a - 1.0) / excess) * falls
    if a >= curve.ductility:
        return 0.0 * a
    covered = 1.0
    if b > curve.ductility:
        b = curve.ductility
        covered = (b * b - start) / (end - start)
    return covered * (2.0 * curve.ductility / (a + b) - 1.0) / excess


@inline
def mean_over(
    loads: tuple[float, float, float], before: float, curve: Softening, whole: bool
) -> Mean:
    """Return the share of a step in which the bond softens.

    Args:
        loads: r at the start, R at the start, and r at the end, which is the largest.
        before: f(R) at the start.
        curve: Softening of the mode.
        whole: True for the mean over the step, False for the value at its end.
    """
    begin, largest, end = loads
    after, mean, length = intact_share(end, curve), _mean_share(largest, end, curve), end - largest
    end_slope, lost, moment = _slope(end, curve), before - after, (mean - after) * length
    if not whole:
        return Mean(after, end_slope, after, end_slope, lost, moment)
    change = end - begin
    share = before * ((largest - begin) / change) + mean * (length / change)
    slope = 0.5 * end_slope if change < SHORT_CHANGE * end else (after - share) / change
    return Mean(share, slope, after, end_slope, lost, moment)


class Bond(NamedTuple):
    """Parameters of a cohesive point, in the order of `CohesiveJoint.loop_start`.

    Attributes:
        normal_stiffness: k_n [Pa/m].
        shear_stiffness: k_s [Pa/m].
        friction: mu.
        opening: g_0 [m].
        slip: s_0 [m].
        normal: Ductility in mode I.
        shear: Ductility in mode II.
        exponential: 1 for exponential, 0 for linear softening.
    """

    normal_stiffness: float
    shear_stiffness: float
    friction: float
    opening: float
    slip: float
    normal: float
    shear: float
    exponential: float


@inline
def broken_energy(start: float, end: float, elastic: float, change: float, mean: Mean) -> float:
    """Return the energy that a step breaks in one mode (9f), divided by the energy at r = 1.

    Args:
        start: Part of the mode in r at the start.
        end: Part of the mode in r at the end.
        elastic: Increase of r before damage grows.
        change: Increase of r in the step.
        mean: Share of the bond.
    """
    rate = (end - start) / change
    return (start + rate * elastic) * mean.lost + rate * mean.moment


@inline
def mean_opening(start: float, end: float, whole: bool) -> tuple[float, float]:
    """Return the opening that multiplies k_n, and its derivative by the gap at the end.

    Over a whole step the opening is the difference of <g>^2/2 divided by that of the gap.

    Args:
        start: Normal gap at the start [m].
        end: Normal gap at the end [m].
        whole: True for the mean over the step, False for the value at its end.
    """
    if not whole:
        return (end, 1.0) if end >= 0.0 else (0.0 * end, 0.0)
    if start >= 0.0 and end >= 0.0:
        return 0.5 * (start + end), 0.5
    if start <= 0.0 and end <= 0.0:
        return 0.0 * end, 0.0
    if end > 0.0:
        open_share = end / (end - start)
        return 0.5 * end * open_share, open_share * (1.0 - 0.5 * open_share)
    open_share = start / (start - end)
    return 0.5 * start * open_share, 0.5 * open_share * open_share
