# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads: fixed nodal patterns, each times a factor of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import ufl

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.parameters import (
    check_function,
    check_name,
    check_number,
    check_vector,
    hold_floats,
    shown,
)

if TYPE_CHECKING:
    from petsc4py import PETSc

    from dolfinx_joints.loads.loaded_body import LoadedBody

TimeFactor = Callable[[float], float]


class Load(Protocol):
    """Something that becomes nodal patterns with time factors."""

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Nodal forces [N] (or forces per unit of the factor) and their factors (collective)."""


class AddedMass(Protocol):
    """Something that moves with the body and has no weight."""

    def matrix(self, model: LoadedBody) -> PETSc.Mat:
        """Its mass in the layout of the model's matrices [kg] (collective)."""


def always(_time: float) -> float:
    """The factor of a constant load."""
    return 1.0


@dataclass(frozen=True, kw_only=True)
class Gravity:
    """Self weight, rho g per volume.

    Attributes:
        acceleration: g as a vector [m/s^2]; standard gravity along -z (-y in 2-D) unless given.

    Raises:
        ValueError: It is no vector.
    """

    acceleration: Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Check the vector."""
        if self.acceleration is not None:
            check_vector("Gravity: acceleration", self.acceleration, (2, 3))

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """M g with the mass of the body; an extra mass form has no weight."""
        gdim = model.gdim
        vector = np.zeros(gdim)
        if self.acceleration is None:
            vector[-1] = -STANDARD_GRAVITY
        else:
            vector[:] = check_vector("Gravity: acceleration", self.acceleration, (gdim,))
        return [(model.inertia_pattern(vector, body_only=True), always)]


@dataclass(frozen=True, kw_only=True)
class Traction:
    """Surface traction on a facet group.

    Attributes:
        group: Name of the facet group.
        value: Traction vector [Pa].
        factor: Multiplier at a time [s]; 1 unless given.

    Raises:
        ValueError: A parameter is of another kind.
    """

    group: str
    value: Sequence[float]
    factor: TimeFactor = always

    def __post_init__(self) -> None:
        """Check group, vector and factor."""
        check_on_group(self)
        check_vector(f"Traction on {shown(self.group)}: value", self.value, (2, 3))

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its consistent nodal forces."""
        from dolfinx import fem

        name = f"Traction on {shown(self.group)}: value"
        vector = check_vector(name, self.value, (model.gdim,))
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

    Raises:
        ValueError: A parameter is of another kind, or the pressure is not finite.
    """

    group: str
    value: float
    factor: TimeFactor = always

    def __post_init__(self) -> None:
        """Check group, pressure and factor."""
        hold_floats(self)
        check_on_group(self)
        name = f"Pressure on {shown(self.group)}: value"
        check_number(name, self.value, lambda _: True, "finite", unit="Pa")

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its consistent nodal forces."""
        from dolfinx import fem

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

    Raises:
        ValueError: One of them is no function.
    """

    form: Callable[[Any], Any]
    factor: TimeFactor = always

    def __post_init__(self) -> None:
        """Check the functions."""
        check_function("FormLoad: form", self.form, "the test function")
        check_function("FormLoad: factor", self.factor)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its nodal forces."""
        return [(model.assemble(self.form(ufl.TestFunction(model.V))), self.factor)]


def check_on_group(load: Any) -> None:
    """Refuse a load whose group is no name, or whose factor is no function.

    Raises:
        ValueError: It is.
    """
    check_name("group", load.group)
    check_function(f"{on_group(load)}: factor", load.factor)


def on_group(load: Any) -> str:
    """What messages call a load on a facet group."""
    return f"{type(load).__name__} on {shown(load.group)}"
