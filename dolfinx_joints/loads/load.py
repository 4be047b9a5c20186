# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocols of loads, patterns times time factors on faces, cells, joints; and of loaded bodies."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import count
from typing import Annotated, Any, Protocol, runtime_checkable

import annotated_types as at
import numpy as np
from dolfinx.fem import FunctionSpace
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.elasticity import ElasticBody
from dolfinx_joints.body.supports import Constraints
from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.parameters import check_kind_of, offers
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import JointOperator
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


class LoadedBody(Protocol):
    """Body on a split mesh, its matrices and its joints.

    Forces and added masses have the layout of the mass matrix ``mass``. ``absorbing`` names the
    groups with a viscous boundary. Without joints, operator and contact are None.
    """

    jointed: JointedMesh
    gdim: int
    V: FunctionSpace
    body: ElasticBody
    mass: PETSc.Mat
    constraints: Constraints
    absorbing: tuple[str, ...]
    operator: JointOperator | None
    contact: Contact | None

    def assemble(self, form: Any) -> PETSc.Vec:
        """Return the nodal forces of a linear form, [N] (collective)."""

    def inertia_pattern(self, acceleration: Floats, *, body_only: bool = False) -> PETSc.Vec:
        """Return M times a uniform acceleration [m/s^2], [N] (collective).

        With ``body_only``, added masses are excluded, because they have no weight.
        """

    def joined(self, force: PETSc.Vec) -> PETSc.Vec:
        """Extend a body vector to all unknowns of a dynamic stage, such as water (collective)."""

    def nodes(self, group: str) -> Ints:
        """Return the owned nodes of a facet group as local numbers (collective)."""


Codes = NDArray[np.int8]
TimeFactor = Callable[[float], float]
Vector = Annotated[Sequence[float], at.Len(2, 3)]


class Load(Protocol):
    """Load that consists of nodal patterns with time factors."""

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return nodal forces and their time factors; force times factor is in N (collective)."""


@runtime_checkable
class FaceLoad(Load, Protocol):
    """Load on the facet group ``group``; the model checks that the group exists."""

    group: str


@runtime_checkable
class CellLoad(Load, Protocol):
    """Load on the cell group ``cells`` or None; the model checks that the group exists."""

    cells: str | None


@runtime_checkable
class JointLoad(Load, Protocol):
    """Load in a joint."""

    @property
    def joint(self) -> str:
        """Name of the joint."""


@runtime_checkable
class FollowsJoints(JointLoad, Protocol):
    """Pressure in a joint that depends on the gaps; it has no fixed patterns."""

    def in_joint(self, name: str, model: LoadedBody) -> JointPressure:
        """Return the pressures for a model; ``name`` is the name of the load (collective)."""


class JointPressure(Protocol):
    """Pressure at the joint points of this rank, selected by a code per point.

    The codes are values of `Wetness`, shape (n,). Code and pressure are zero in all other joints.
    """

    name: str

    def pressure(self, codes: Codes) -> Floats:
        """Return the pressure of each point, shape (n,), [Pa]."""

    def factor(self, time: float) -> float:
        """Return the multiplier of the pressures at a time [s]."""

    def by_opening(self, gap: Floats) -> Codes:
        """Return the codes (`Wetness`) for a gap (n, 3) [m] in statics (collective)."""

    def in_step(self, codes: Codes, gap: Floats) -> Codes:
        """Return the codes at the end of a step from codes and gap at its start (collective)."""


class AddedMass(Protocol):
    """Mass that moves with the body and has no weight."""

    def matrix(self, model: LoadedBody) -> PETSc.Mat:
        """Return the mass in the layout of the model's matrices [kg] (collective)."""


class VaryingLoad:
    """Load whose pattern varies in time; the forces at the last four times are cached.

    Args:
        name: Name in the energy ledger.
        rows: Loaded rows of the rank's unknowns.
        force: Forces on these rows at a time [s], [N] (collective).
    """

    def __init__(self, name: str, rows: slice, force: Callable[[float], Floats]) -> None:
        """Store the arguments; the forces are evaluated when they are needed."""
        self.names, self._rows = (name,), rows
        self._at = lru_cache(maxsize=4)(force)

    def add(self, out: PETSc.Vec, time: float) -> None:
        """Add the forces at a time [s] to the force vector ``out`` [N] (collective)."""
        out.getArray()[self._rows] += self._at(time)

    def work(self, x: PETSc.Vec, start: float, end: float) -> dict[str, float]:
        """Return the work of the mean of start and end force along x, [J] (collective)."""
        local_work = 0.5 * float(x.array_r[self._rows] @ (self._at(start) + self._at(end)))
        return {self.names[0]: float(np.sum(x.comm.tompi4py().allgather(local_work)))}


def always(_time: float) -> float:
    """Return 1, the factor of a constant load."""
    return 1.0


def check_loads(jointed: JointedMesh, loads: Any) -> None:
    """Check that the loads are loads and act on groups of the mesh."""
    for load in loads:
        check_kind_of(
            "A load", load, offers(load, "patterns"), "a load such as Gravity or Traction"
        )
        if isinstance(load, FaceLoad):
            jointed.facets(load.group)
        elif isinstance(load, CellLoad) and load.cells:
            jointed.cells(load.cells)


def load_names(loads: Sequence[Load]) -> list[str]:
    """Return a unique name for each load: its type, its group or joint, a number if necessary."""
    plain = []
    for load in loads:
        where = load.group if isinstance(load, FaceLoad) else ""
        where = load.joint if isinstance(load, JointLoad) else where
        where = load.cells or "" if isinstance(load, CellLoad) else where
        plain.append(re.sub(r"[^\w.+-]", "_", f"{type(load).__name__}_{where}".rstrip("_")))
    names: list[str] = []
    for name in plain:
        unused = (n for i in count(1) if (n := f"{name}_{i}") not in (*plain, *names))
        names.append(name if plain.count(name) == 1 else next(unused))
    return names
