# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocols of loads, and the plain ones: gravity, traction, pressure, a UFL form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Protocol, runtime_checkable

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import check_vector, shown
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.cells import Floats

Codes = NDArray[np.int8]
TimeFactor = Callable[[float], float]
Vector = Annotated[Sequence[float], at.Len(2, 3)]


class Load(Protocol):
    """Something that becomes nodal patterns with time factors."""

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Nodal forces [N] (or forces per unit of the factor) and their factors (collective)."""


@runtime_checkable
class FaceLoad(Load, Protocol):
    """A load on a facet group, whose name is looked up when the model is made."""

    group: str


@runtime_checkable
class JointLoad(Load, Protocol):
    """A load in a joint."""

    @property
    def joint(self) -> str:
        """Name of the joint."""


@runtime_checkable
class FollowsJoints(JointLoad, Protocol):
    """A pressure in a joint that depends on the gaps; it has no fixed patterns."""

    def in_joint(self, name: str, model: LoadedBody) -> JointPressure:
        """Its pressures in a model, under the name of the load (collective)."""


class JointPressure(Protocol):
    """Pressure at the local joint points by codes, zero and code 0 in other joints.

    ``settings`` distinguishes it from loads of equal pressures, for checkpoints.
    """

    name: str
    settings: str

    def pressure(self, codes: Codes) -> Floats:
        """Pressure of each point, shape (n,), [Pa]."""

    def factor(self, time: float) -> float:
        """Multiplier of the pressures at a time [s]."""

    def by_opening(self, gap: Floats) -> Codes:
        """Codes (`Wetness`) that a gap (n, 3) [m] leads to in statics (collective)."""

    def in_step(self, codes: Codes, gap: Floats) -> Codes:
        """Codes that a time step from a state leads to (collective)."""


class AddedMass(Protocol):
    """Something that moves with the body and has no weight."""

    def matrix(self, model: LoadedBody) -> PETSc.Mat:
        """Its mass in the layout of the model's matrices [kg] (collective)."""


def always(_time: float) -> float:
    """The factor of a constant load."""
    return 1.0


@dataclass(frozen=True, kw_only=True)
@checked
class Gravity:
    """Self weight, rho g per volume.

    Attributes:
        acceleration: g as a vector [m/s^2]; standard gravity along -z (-y in 2-D) unless given.
    """

    acceleration: Vector | None = None

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
@checked
class Traction:
    """Surface traction on a facet group.

    Attributes:
        group: Name of the facet group.
        value: Traction vector [Pa].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    group: str
    value: Vector
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its consistent nodal forces."""
        name = f"Traction on {shown(self.group)}: value"
        vector = check_vector(name, self.value, (model.gdim,))
        v = ufl.TestFunction(model.V)
        constant = fem.Constant(model.jointed.mesh, vector)
        return [
            (model.assemble(ufl.inner(constant, v) * model.jointed.ds(self.group)), self.factor)
        ]


@dataclass(frozen=True, kw_only=True)
@checked
class Pressure:
    """Pressure on a facet group, positive towards the body.

    Attributes:
        group: Name of the facet group.
        value: Pressure [Pa].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    group: str
    value: Annotated[float, at.Unit("Pa")]
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its consistent nodal forces."""
        v = ufl.TestFunction(model.V)
        n = ufl.FacetNormal(model.jointed.mesh)
        constant = fem.Constant(model.jointed.mesh, float(-self.value))
        form = constant * ufl.inner(n, v) * model.jointed.ds(self.group)
        return [(model.assemble(form), self.factor)]


@dataclass(frozen=True, kw_only=True)
@checked
class FormLoad:
    """A user-defined linear form.

    Attributes:
        form: Given the test function, the UFL form of the load [N].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    form: Callable[[Any], Any]
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Its nodal forces."""
        return [(model.assemble(self.form(ufl.TestFunction(model.V))), self.factor)]
