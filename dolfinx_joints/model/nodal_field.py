# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodal vectors of user-defined fields: a function, an expression, or numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc
from ufl.core.expr import Expr
from ufl.domain import extract_domains

from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_kind_of, check_vector, finite, numbers_of, shown
from dolfinx_joints.mesh.dolfinx_versions import interpolation_points
from dolfinx_joints.model.model import Model

NodalField: TypeAlias = PETSc.Vec | Expr | Callable[[NDArray[np.float64]], Any] | Sequence[float]


def nodal_vector(model: Model, name: str, field: NodalField) -> PETSc.Vec:
    """Return a field as a new vector of the model's unknowns (collective).

    The field may be a vector of the unknowns, or a DOLFINx function or UFL expression on the mesh
    with one component per axis. It may also be a function of the nodes (n, 3) [m] that returns
    (n, gdim), or one uniform value per axis. Otherwise a ValueError names the field by ``name``.
    """
    vector = model.stiffness.createVecRight()
    if isinstance(field, PETSc.Vec):
        fits = field.getSizes() == vector.getSizes()
        check_kind_of(name, field, fits, f"a vector of the model's {model.num_dofs} unknowns")
        field.copy(vector)
    elif isinstance(field, Expr):
        vector.setArray(_interpolated(model, name, field)[: vector.getLocalSize()])
    elif callable(field):
        vector.setArray(_at_nodes(model, name, field).ravel())
    else:
        owned = vector.getLocalSize() // model.gdim
        vector.setArray(np.tile(check_vector(name, field, (model.gdim,)), owned))
    return vector


def _interpolated(model: Model, name: str, field: Any) -> NDArray[np.float64]:
    """Return the values of an expression at the nodes, ghosts included."""
    shape, domains = field.ufl_shape, extract_domains(field)
    if shape != (model.gdim,) or list(domains) != [model.jointed.mesh.ufl_domain()]:
        raise ValueError(
            f"{name} is {shown(field, str)}, of shape {shape}; it must be a UFL expression or "
            f"function on the model's mesh (model.jointed.mesh) of shape ({model.gdim},)."
        )
    u = fem.Function(model.V)
    u.interpolate(fem.Expression(field, interpolation_points(model.V)))
    values: NDArray[np.float64] = u.x.array
    with raised_together(model.jointed.mesh.comm):
        check_kind_of(name, field, finite(values), "finite at all nodes")
    return values


def _at_nodes(model: Model, name: str, field: Callable[..., Any]) -> NDArray[np.float64]:
    """Return the values of a function at the owned nodes, shape (n, gdim)."""
    owned = model.V.dofmap.index_map.size_local
    x, shape = model.V.tabulate_dof_coordinates()[:owned], (owned, model.gdim)
    with raised_together(model.jointed.mesh.comm):
        values = numbers_of(field(x)) if owned else np.zeros(shape)
        if values is None or values.shape != shape or not finite(values):
            returned = "no numbers" if values is None else f"an array of shape {values.shape}"
            raise ValueError(
                f"{name} returned {returned} for {owned} nodes; it must return {model.gdim} finite "
                "numbers per node."
            )
    return values
