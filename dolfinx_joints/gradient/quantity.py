# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quantities of a run, smooth functions of its observed values, with their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.parameters import (
    check_kind_of,
    check_named,
    check_number,
    finite,
    numbers_of,
    shown,
)


@dataclass(frozen=True, kw_only=True)
class History:
    """Observed values after each accepted step of a run.

    Attributes:
        times: Times [s], shape (steps,); in static stages the time of the loads.
        static: Number of static increments, which come before the time steps.
        values: Displacements (x, y, z) of the points and gaps (n, s1, s2) in the joints by name,
            each of shape (steps, 3), [m].
    """

    times: Floats
    static: int
    values: Mapping[str, Floats]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Smooth function of a `History`, with its derivative.

    Attributes:
        value: Function that returns the quantity.
        derivative: Function that returns the derivatives of the quantity by the observed values,
            arrays of shape (steps, 3) by name.
    """

    value: Callable[[History], float]
    derivative: Callable[[History], Mapping[str, Floats]]

    def value_of(self, history: History) -> float:
        """Return the quantity, or raise a ValueError if it is not a finite number."""
        value = self.value(history)
        check_number("The value of the quantity", value, lambda _: True, "a finite number")
        return float(value)

    def derivative_of(self, history: History) -> dict[str, Floats]:
        """Return the derivatives by the observed values, or raise a ValueError."""
        given = self.derivative(history)
        check_named("The derivative of the quantity", given, "arrays by name")
        weights = {}
        for name, array in given.items():
            if name not in history.values:
                raise ValueError(not_observed(name, history.values))
            values, shape = numbers_of(array), history.values[name].shape
            fits = values is not None and values.shape == shape and finite(values)
            wanted = f"finite numbers of shape {shape}"
            check_kind_of(f"The derivative by {name!r}", array, fits, wanted)
            weights[name] = np.asarray(array, dtype=np.float64)
        return weights

    @classmethod
    def at_end(cls, name: str, component: int) -> Quantity:
        """Return a component of an observed value at the end of the run, such as residual slip."""
        if component not in (0, 1, 2):
            raise ValueError(f"component is {shown(component)}; it must be 0, 1 or 2.")

        def value(history: History) -> float:
            if name not in history.values:
                raise ValueError(not_observed(name, history.values))
            return float(history.values[name][-1, component])

        def derivative(history: History) -> dict[str, Floats]:
            weights = np.zeros_like(history.values[name])
            weights[-1, component] = 1.0
            return {name: weights}

        return cls(value=value, derivative=derivative)


def not_observed(name: str, names: Iterable[str]) -> str:
    """Return the message for a name that is not observed."""
    return f"{name!r} is not observed; the names are {', '.join(names)}."
