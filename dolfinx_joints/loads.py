# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads: fixed nodal patterns, each times a factor of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import ufl
from numpy.typing import NDArray

from dolfinx_joints.checks import check_kind_of, check_number
from dolfinx_joints.records import STANDARD_GRAVITY

if TYPE_CHECKING:
    from petsc4py import PETSc

    from dolfinx_joints.model import Model

TimeFactor = Callable[[float], float]


class Load(Protocol):
    """Something that becomes nodal patterns with time factors."""

    def patterns(self, model: Model) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Nodal forces [N] (or forces per unit of the factor) and their factors (collective)."""


class AddedMass(Protocol):
    """Something that moves with the body and has no weight."""

    def matrix(self, model: Model) -> PETSc.Mat:
        """Its mass in the layout of the model's matrices [kg] (collective)."""


def in_axes(motion: Callable[[float], Any], gdim: int) -> Callable[[float], Any]:
    """What moves a model, of a motion in space: in the plane x and z, the vertical axis there is y.

    Args:
        motion: Function of time; of two numbers (x, up) in the plane all are taken.
        gdim: Axes of the model.
    """
    if gdim == 3:
        return motion

    def in_plane(time: float) -> Any:
        values = np.asarray(motion(time))
        return values[[0, 2]] if len(values) > 2 else values

    return in_plane


def always(_time: float) -> float:
    """The factor of a constant load."""
    return 1.0


@dataclass(frozen=True, kw_only=True)
class Gravity:
    """Self weight, rho g per volume.

    Attributes:
        acceleration: g as a vector [m/s^2]; standard gravity along -z (-y in 2-D) unless given.
    """

    acceleration: Sequence[float] | None = None

    def patterns(self, model: Model) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """M g with the mass of the body; an extra mass form has no weight."""
        gdim = model.gdim
        vector = np.zeros(gdim)
        if self.acceleration is None:
            vector[-1] = -STANDARD_GRAVITY
        else:
            vector[:] = _vector(self.acceleration, gdim, "acceleration")
        return [(model.inertia_pattern(vector, body_only=True), always)]


@dataclass(frozen=True, kw_only=True)
class Traction:
    """Surface traction on a facet group.

    Attributes:
        group: Name of the facet group.
        value: Traction vector [Pa].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    group: str
    value: Sequence[float]
    factor: TimeFactor = always

    def patterns(self, model: Model) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its consistent nodal forces."""
        from dolfinx import fem

        vector = _vector(self.value, model.gdim, f"Traction on {self.group!r}: value")
        v = ufl.TestFunction(model.V)
        constant = fem.Constant(model.jointed.mesh, vector)
        return [
            (model.assemble(ufl.inner(constant, v) * model.jointed.ds(self.group)), self.factor)
        ]


@dataclass(frozen=True, kw_only=True)
class Pressure:
    """Pressure on a facet group, positive towards the body.

    Attributes:
        group: Name of the facet group.
        value: Pressure [Pa].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    group: str
    value: float
    factor: TimeFactor = always

    def patterns(self, model: Model) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its consistent nodal forces."""
        from dolfinx import fem

        check_number(f"Pressure on {self.group!r}: value", self.value, lambda _: True, "finite")
        v = ufl.TestFunction(model.V)
        n = ufl.FacetNormal(model.jointed.mesh)
        constant = fem.Constant(model.jointed.mesh, float(-self.value))
        form = constant * ufl.inner(n, v) * model.jointed.ds(self.group)
        return [(model.assemble(form), self.factor)]


@dataclass(frozen=True, kw_only=True)
class FormLoad:
    """A linear form of the user's own.

    Attributes:
        form: Given the test function, the UFL form of the load [N].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    form: Callable[[Any], Any]
    factor: TimeFactor = always

    def patterns(self, model: Model) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its nodal forces."""
        return [(model.assemble(self.form(ufl.TestFunction(model.V))), self.factor)]


@dataclass(frozen=True, kw_only=True)
class BaseMotion:
    """Uniform acceleration of the ground; displacements are then relative to the ground.

    F = -M iota a_g(t) for each axis.

    Attributes:
        acceleration: Ground acceleration at a time [s], shape (3,), [m/s^2]; a `Motion` is one.
            In 2-D x and z of it move the model along x and y; two numbers are taken as they are.
    """

    acceleration: Callable[[float], Any]

    def patterns(self, model: Model) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """One inertia pattern per axis."""
        latest = lru_cache(maxsize=1)(in_axes(self.acceleration, model.gdim))

        def factor(axis: int) -> TimeFactor:
            return lambda time: float(latest(time)[axis])

        return [
            (model.inertia_pattern(-np.eye(model.gdim)[axis]), factor(axis))
            for axis in range(model.gdim)
        ]


def _vector(value: Sequence[float], gdim: int, name: str) -> NDArray[np.float64]:
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.full(1, np.nan)
    if vector.shape != (gdim,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"{name} is {value}; it must hold {gdim} finite numbers.")
    return vector


def check_motion(motion: Any, gdim: int) -> None:
    """Refuse a ground motion that gives no acceleration vector.

    Raises:
        ValueError: It is no function, or gives fewer than ``gdim`` numbers.
    """
    wanted = f"a function of time that gives at least {gdim} numbers"
    check_kind_of("motion", motion, callable(motion), wanted)
    first = np.asarray(motion(0.0))
    good = first.ndim == 1 and len(first) >= gdim and first.dtype.kind in "if"
    check_kind_of("motion(0)", first.tolist(), good, f"at least {gdim} numbers")
