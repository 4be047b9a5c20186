# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocols of loads: patterns with factors, on faces, in joints, following joints, varying."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import count
from typing import Annotated, Any, Protocol, runtime_checkable

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.parameters import check_kind_of, offers
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

Codes = NDArray[np.int8]
TimeFactor = Callable[[float], float]
Vector = Annotated[Sequence[float], at.Len(2, 3)]


class Load(Protocol):
    """Something that becomes nodal patterns with time factors."""

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Nodal forces [N] (or forces per unit of the factor) and their factors (collective)."""


@runtime_checkable
class FaceLoad(Load, Protocol):
    """A load with a ``group``, a facet group that is looked up when the model is made."""

    group: str


@runtime_checkable
class CellLoad(Load, Protocol):
    """A load with ``cells``, a cell group that is looked up when the model is made, or None."""

    cells: str | None


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
    """Pressure at the local joint points by codes, zero and code 0 in other joints."""

    name: str

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


class VaryingLoad:
    """Load whose pattern varies in time, kept at the last times.

    Args:
        name: Its name in the ledger.
        rows: Rows of the rank's unknowns that it acts on.
        force: Forces of these rows at a time [s], [N] (collective).
    """

    def __init__(self, name: str, rows: slice, force: Callable[[float], Floats]) -> None:
        """Evaluate nothing yet."""
        self.names, self._rows = (name,), rows
        self._at = lru_cache(maxsize=4)(force)

    def add(self, out: PETSc.Vec, time: float) -> None:
        """Add the forces at a time [s] to those of all unknowns [N] (collective)."""
        out.getArray()[self._rows] += self._at(time)

    def work(self, x: PETSc.Vec, start: float, end: float) -> dict[str, float]:
        """Return the work on a change of the unknowns by the mean of its ends, [J] (collective)."""
        mine = 0.5 * float(x.array_r[self._rows] @ (self._at(start) + self._at(end)))
        return {self.names[0]: float(np.sum(x.comm.tompi4py().allgather(mine)))}


def always(_time: float) -> float:
    """The factor of a constant load."""
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
    """A name for each load: its kind and where it acts, with a number where that is not enough."""
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
