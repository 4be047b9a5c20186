# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform motion of the ground, as forces on a body whose displacements are relative to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import (
    finite,
    numbers_of,
    shown,
)
from dolfinx_joints.loads.load import TimeFactor
from dolfinx_joints.loads.loaded_body import LoadedBody


@dataclass(frozen=True, kw_only=True)
@checked
class BaseMotion:
    """Uniform acceleration of the ground; displacements are then relative to the ground.

    F = -M iota a_g(t) for each axis.

    Attributes:
        acceleration: Ground acceleration at a time [s], shape (3,), [m/s^2]; a `Motion` is one.
            In 2-D x and z of it move the model along x and y; two numbers are taken as they are.
    """

    acceleration: Callable[[float], Any]

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """One inertia pattern per axis."""
        latest = lru_cache(maxsize=1)(in_axes(self.acceleration, model.gdim, "acceleration"))

        def factor(axis: int) -> TimeFactor:
            return lambda time: float(latest(time)[axis])

        return [
            (model.inertia_pattern(-np.eye(model.gdim)[axis]), factor(axis))
            for axis in range(model.gdim)
        ]


def in_axes(
    motion: Callable[[float], Any], gdim: int, name: str = "motion"
) -> Callable[[float], NDArray[np.float64]]:
    """The components of a motion that move a model: in the plane x and z, z along its axis y.

    Args:
        motion: Function of time; of two numbers (x, up) in the plane all are taken.
        gdim: Axes of the model.
        name: Name of the motion in error messages.
    """

    def moved(time: float) -> NDArray[np.float64]:
        given = motion(time)
        values = numbers_of(given)
        if values is None or values.ndim != 1 or len(values) < gdim or not finite(values):
            raise ValueError(
                f"{name}({time:g}) is {shown(given)}; it must be at least {gdim} finite numbers."
            )
        return values[[0, 2]] if gdim == 2 and len(values) > 2 else values[:gdim]

    return moved
