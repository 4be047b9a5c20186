# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Estimated errors from runs at several sizes, and the cheapest sizes for an allowed error.

Richardson extrapolation with the observed order, limited to a range, follows the methods of Roache
(1994, J. Fluids Eng. 116) and Eça and Hoekstra (2014, J. Comput. Phys. 262). A size is a time step
or a cell size, relative to that of the given run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats

Kind = Literal["order", "no order", "growth", "constant", "not varied"]

LEAST_ORDER = 0.5  # lower observed orders do not show convergence
BEYOND = 1.0  # an observed order may exceed the formal one by this much
_SAFETY = 1.25  # Roache's factor for monotone values of three runs
_SAFETY_WITHOUT_ORDER = 3.0  # his factor for other values
REACH = 0.1  # least size, relative to the given run, to which errors are extrapolated
_GROWTH_ORDER = 0.25  # a change of such an order has no limit, within the scatter of three values
_GROWTH = 0.05  # least relative change that counts as growth
_ROUNDING = 1e-9  # relative difference of equal values
_ORDERS = np.linspace(-4.0, 10.0, 2800)  # an even number of orders leaves out zero


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Estimated error of the given run in one direction, of the step or of the cells.

    Attributes:
        kind: "order": the values converge at the observed order. "no order": they do not; the error
            is a cautious bound. "growth": a peak grows with refinement and has no limit; the error
            is infinite. "constant": all values are equal. "not varied": there is a single run.
        error: Estimated error, at least zero.
        order: Observed order, NaN without one.
        rate: Order with which the error at other sizes is predicted.
    """

    kind: Kind
    error: float
    order: float = np.nan
    rate: float = 1.0


def estimated_error(
    sizes: ArrayLike, values: ArrayLike, *, formal_order: float, may_grow: bool = False
) -> Estimate:
    """Estimate the error of the run of size 1 from the three finest runs.

    With h1 < h2 < h3, the observed order p solves
    (v3 - v2) / (v2 - v1) = (h3^p - h2^p) / (h2^p - h1^p).
    If it is in the accepted range, the limit is v1 - (v2 - v1) h1^p / (h2^p - h1^p), with p at most
    the formal order. Otherwise the errors are bounded by C h, where C is the largest
    |vi - vj| / (hi + hj) times a factor of safety; of monotone values also by the extrapolation
    with first order.

    Args:
        sizes: Relative sizes, one of them 1, different from each other, shape (n,).
        values: Values of the runs, shape (n,).
        formal_order: Order of the scheme, or of the elements.
        may_grow: True for peaks of stress, which may be singular.
    """
    h, v = np.asarray(sizes, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if len(h) == 1:
        return Estimate(kind="not varied", error=0.0)
    if np.ptp(v) <= _ROUNDING * np.abs(v).max():
        return Estimate(kind="constant", error=0.0)
    given = v[h == 1.0][0]
    fine = np.argsort(h)[:3]
    h, v = h[fine], v[fine]
    order = _observed_order(h, v)
    grows = abs(v[0]) - abs(v[-1]) > _GROWTH * abs(v[0])
    if may_grow and grows and order < _GROWTH_ORDER:
        return Estimate(kind="growth", error=np.inf)
    if LEAST_ORDER <= order <= formal_order + BEYOND:
        used = min(order, formal_order)
        limit = v[0] - (v[1] - v[0]) / ((h[1] / h[0]) ** used - 1.0)
        return Estimate(kind="order", error=float(abs(given - limit)), order=order, rate=used)
    differences = np.abs(np.subtract.outer(v, v)) / np.add.outer(h, h)
    bound = _SAFETY_WITHOUT_ORDER * differences.max()
    if np.isfinite(order):  # monotone: the limit may be farther away than all values
        bound = max(bound, _SAFETY * abs(v[1] - v[0]) / (h[1] - h[0]))
    return Estimate(kind="no order", error=float(abs(given - v[0]) + h[0] * bound))


def _observed_order(h: Floats, v: Floats) -> float:
    """Return the observed order of three runs; NaN if their values are not monotone."""
    if len(h) < 3:
        return np.nan
    fine, coarse = np.diff(v)
    if fine * coarse <= 0.0:
        return np.nan
    far, near = np.log(h[2] / h[1]), np.log(h[1] / h[0])
    ratio = np.exp(_ORDERS * near) * np.expm1(_ORDERS * far) / np.expm1(_ORDERS * near)
    return float(np.interp(coarse / fine, ratio, _ORDERS))


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Model of a run's processor time, (fixed + per_step / x) y^-power [s].

    x is the step and y the cell size, both relative to the given run.
    """

    fixed: float
    per_step: float
    power: float

    @classmethod
    def fitted(cls, steps: Mapping[float, float], cells: Mapping[float, float]) -> Cost:
        """Fit the processor times [s] of runs by relative step and by relative cell size."""
        from scipy.optimize import nnls

        x, seconds = np.array([*steps]), np.array([*steps.values()])
        (fixed, per_step), _ = nnls(np.column_stack([1.0 / seconds, 1.0 / (x * seconds)]), x**0)
        power = 0.0
        if len(cells) > 1:
            power = -np.polyfit(np.log([*cells]), np.log([*cells.values()]), 1)[0]
        return cls(fixed=float(fixed), per_step=float(per_step), power=max(float(power), 0.0))

    def __call__(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the processor times at relative steps and cell sizes [s]."""
        seconds = self.fixed + self.per_step / np.asarray(x, dtype=np.float64)
        return np.asarray(seconds * np.asarray(y, dtype=np.float64) ** -self.power)


def cheapest(
    allowed: float, errors: Sequence[Estimate], coarsest: Sequence[float], cost: Cost
) -> tuple[float, float, float]:
    """Return relative step, relative cell size and seconds of the cheapest run in an allowed error.

    The error of each direction is proportional to the size to the power of its rate. Sizes are at
    most the coarsest that were run. The result is NaN if a value grows without limit, or if a size
    is below `REACH`.
    """
    if any(estimate.kind == "growth" for estimate in errors):
        return np.nan, np.nan, np.nan
    share = np.linspace(0.01, 0.99, 99)  # of the allowed error, for the step
    sizes = []
    for estimate, part, most in zip(errors, (share, 1.0 - share), coarsest, strict=True):
        size = np.full_like(share, most)
        if estimate.error > 0.0:
            size = np.minimum(most, (part * allowed / estimate.error) ** (1.0 / estimate.rate))
        sizes.append(size)
    x, y = sizes
    seconds = cost(np.maximum(x, REACH), np.maximum(y, REACH))
    seconds[np.minimum(x, y) < REACH] = np.inf
    if not np.isfinite(seconds).any():
        return np.nan, np.nan, np.nan
    best = int(np.argmin(seconds))
    return float(x[best]), float(y[best]), float(seconds[best])
