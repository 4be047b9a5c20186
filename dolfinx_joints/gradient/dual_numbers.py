# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of many joint points with their first derivatives (forward automatic differentiation)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats, Ints


class Branches(Exception):  # noqa: N818 - not an error, but a request to divide the points
    """A condition is true for some points and false for others.

    Attributes:
        true: True for points that fulfil the condition, shape (n,).
    """

    def __init__(self, true: Flags) -> None:
        """Store the flags."""
        self.true = true


def _comparison(compare: Any) -> Any:
    """Return a comparison of values; it raises `Branches` if the result differs between points."""

    def decide(self: Dual, other: Any) -> bool:
        flags = compare(self.value, other.value if isinstance(other, Dual) else other)
        if (flags != flags[0]).any():
            raise Branches(flags)
        return bool(flags[0])

    return decide


class Dual:
    """Value of a scalar at ``n`` points, and its derivatives by ``k`` inputs.

    The functions of one point in `laws` accept dual numbers in place of numbers. If a condition is
    not the same for all points, `Branches` is raised, and the caller divides the points.

    Attributes:
        value: Value at each point, shape (n,).
        slope: Derivatives, shape (k, n).
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: Floats, slope: Floats) -> None:
        """Store the arguments."""
        self.value, self.slope = value, slope

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slope + other.slope)
        if isinstance(other, np.ndarray):  # NumPy then adds each entry of the array.
            return NotImplemented
        return Dual(self.value + other, self.slope)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            slope = self.slope * other.value + other.slope * self.value
            return Dual(self.value * other.value, slope)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Dual(self.value * other, self.slope * other)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __rtruediv__(self, other: Any) -> Dual:
        value = other / self.value
        return Dual(value, self.slope * (-value / self.value))

    def __truediv__(self, other: Any) -> Any:
        return self * (1.0 / other)

    def __pow__(self, power: int) -> Dual:
        return Dual(self.value**power, power * self.value ** (power - 1) * self.slope)

    def sqrt(self) -> Dual:
        """Return the square root; its slope is zero where the value is zero."""
        root = np.sqrt(self.value)
        factor = np.divide(0.5, root, out=np.zeros_like(root), where=root > 0.0)
        return Dual(root, self.slope * factor)

    def __abs__(self) -> Dual:
        return -self if self < 0.0 else self

    def __bool__(self) -> bool:
        return self != 0.0

    __radd__, __rmul__, __hash__ = __add__, __mul__, None  # type: ignore[assignment]
    __lt__, __le__ = _comparison(np.less), _comparison(np.less_equal)
    __gt__, __ge__ = _comparison(np.greater), _comparison(np.greater_equal)
    __eq__ = _comparison(np.equal)


def evaluate_by_branch(count: int, evaluate: Callable[[Ints], None]) -> None:
    """Evaluate ``count`` points, in groups that take the same branches.

    ``evaluate`` receives numbers of points, and raises `Branches` if a condition differs.
    """
    parts: list[Ints] = [np.arange(count)] if count else []
    while parts:
        points = parts.pop()
        try:
            evaluate(points)
        except Branches as branches:
            parts += [points[branches.true], points[~branches.true]]
