# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thermal loads: nodal forces equivalent to free thermal strains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc
from ufl.core.expr import Expr

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import real, shown
from dolfinx_joints.loads.load import Load, LoadedBody, TimeFactor, always
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


@dataclass(frozen=True, kw_only=True)
@checked
class Temperature:
    """Temperature of a body or a cell group, with the free strain alpha (T - T_0) f(t).

    Several temperatures add up, such as a mean and a seasonal part.

    Attributes:
        value: T [degrees C or K]: a number, a function of the coordinates x that returns a UFL
            expression, or a scalar DOLFINx function on the model's mesh.
        reference: Stress-free temperature T_0, at which the joints are closed [unit of T]; one
            number, or one per cell group, such as the closure temperatures of blocks.
        expansion: Coefficient of linear thermal expansion alpha [1/K].
        cells: Name of the loaded cell group; the whole body by default.
        factor: Multiplier f of T - T_0 at a time [s]; 1 by default.
    """

    value: Any
    reference: float | Mapping[str, float]
    expansion: Annotated[float, at.Ge(0), at.Unit("1/K")]
    cells: str | None = None
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the nodal forces equivalent to the free thermal strain (collective)."""
        where = ufl.dx if self.cells is None else model.jointed.dx(self.cells)
        v = ufl.TestFunction(model.V)
        force = model.assemble(self.blocked_stress(model) * ufl.div(v) * where)
        if not np.isfinite(force.norm()):
            raise ValueError("Temperature: value is not finite in all of its cells.")
        return [(force, self.factor)]

    def blocked_stress(self, model: LoadedBody) -> Any:
        """Return the pressure that the temperature causes in a fully restrained body (UFL) [Pa]."""
        expansion = fem.Constant(model.jointed.mesh, float(self.expansion))
        return model.body.blocked_stress(expansion * self.change(model))

    def change(self, model: LoadedBody) -> Any:
        """Return T - T_0 (UFL) [K]."""
        return self._field(model) - self._reference(model)

    def _reference(self, model: LoadedBody) -> Any:
        """Return T_0 as a constant, or as a function of degree 0."""
        if not isinstance(self.reference, Mapping):
            return fem.Constant(model.jointed.mesh, float(self.reference))
        jointed = model.jointed
        space = fem.functionspace(jointed.mesh, ("DG", 0))
        field, count = fem.Function(space), np.zeros(len(space.dofmap.list), dtype=np.int64)
        for group, value in self.reference.items():
            cells = jointed.cells(group)
            field.x.array[space.dofmap.list[cells, 0]] = value
            count[cells] += 1
        owned = jointed.mesh.topology.index_map(model.gdim).size_local
        loaded_cells = np.arange(owned) if self.cells is None else jointed.cells(self.cells)
        invalid = int((count[loaded_cells[loaded_cells < owned]] != 1).sum())
        if invalid := int(sum(jointed.mesh.comm.allgather(invalid))):
            where = "the mesh" if self.cells is None else repr(self.cells)
            raise ValueError(
                f"Temperature: {invalid} cells have no reference or several; the reference groups "
                f"({', '.join(self.reference) or 'none'}) must cover {where} without overlap."
            )
        return field

    def _field(self, model: LoadedBody) -> Any:
        """Return T as a UFL constant or expression."""
        mesh, value = model.jointed.mesh, self.value
        if callable(value) and not isinstance(value, Expr):  # UFL expressions are callable too
            value = value(ufl.SpatialCoordinate(mesh))
        if not isinstance(value, Expr) and math.isfinite(real(value)):
            return fem.Constant(mesh, float(value))
        if not (isinstance(value, Expr) and value.ufl_shape == ()):
            raise ValueError(
                f"Temperature: value is {shown(value, str)}; it must be a number or a scalar UFL "
                "expression."
            )
        if ufl.domain.extract_unique_domain(value) not in (None, mesh.ufl_domain()):
            raise ValueError("Temperature: value is defined on another mesh than jointed.mesh.")
        return value


def check_temperatures(
    jointed: JointedMesh, materials: Mapping[str, Any], loads: Sequence[Load]
) -> None:
    """Check that temperatures act on Elastic cells only, where the thermal stress is isotropic."""
    for load in loads:
        if not isinstance(load, Temperature):
            continue
        for name, material in materials.items():
            if not isinstance(material, Elastic) and _share_cells(jointed, load.cells, name):
                raise ValueError(
                    f"A Temperature acts on cells of {type(material).__name__}; it may act on "
                    "Elastic cells only. Select them with cells=."
                )


def _share_cells(jointed: JointedMesh, a: str | None, b: str) -> bool:
    """Return True if two cell groups, or a group and the body, share cells (collective)."""
    common = np.intersect1d(jointed.cells(a), jointed.cells(b)) if a and b else [0]
    return bool(jointed.mesh.comm.allreduce(len(common)))
