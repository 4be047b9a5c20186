# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of the body and values on them, in the order of the input mesh, for files."""

from __future__ import annotations

from typing import Any

import basix
import dolfinx.cpp.io
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.results.layout import Cells

Floats = NDArray[np.float64]

# VTK's numbers of linear and of Lagrange cells.
_KINDS = {
    "triangle": (5, 69),
    "quadrilateral": (9, 70),
    "tetrahedron": (10, 71),
    "hexahedron": (12, 72),
}


class CellGather:
    """Values on cells gathered on rank 0 in the order of the input mesh.

    Args:
        model: The model.
    """

    def __init__(self, model: Model) -> None:
        """Exchange the order once (collective)."""
        mesh = model.jointed.mesh
        self._comm = mesh.comm
        self.owned = mesh.topology.index_map(mesh.topology.dim).size_local
        parts = self._comm.gather(np.asarray(mesh.topology.original_cell_index)[: self.owned])
        self._order = None if parts is None else np.argsort(np.concatenate(parts), kind="stable")

    def __call__(self, values: NDArray[Any]) -> NDArray[Any] | None:
        """Values of all cells on rank 0, None elsewhere (collective).

        Args:
            values: Of the owned cells, shape (owned, ...).
        """
        parts = self._comm.gather(values)
        return None if parts is None else np.concatenate(parts)[self._order]


def body_cells(model: Model, nodes: NodeNumbering) -> Cells | None:
    """The cells of a model on rank 0, None elsewhere (collective).

    Args:
        model: The model.
        nodes: Numbers the nodes.
    """
    jointed, V = model.jointed, model.V
    gather = CellGather(model)
    table = V.dofmap.list[: gather.owned]
    kind = jointed.mesh.topology.cell_type
    order = np.argsort(dolfinx.cpp.io.perm_vtk(kind, table.shape[1]))
    every = gather(nodes.number[table][:, order])
    groups = {}
    for name in jointed.cell_groups:
        inside = np.zeros(gather.owned, dtype=bool)
        cells = jointed.cells(name)
        inside[cells[cells < gather.owned]] = True
        groups[name] = gather(inside)
    if every is None:
        return None
    found = {k: np.flatnonzero(inside) for k, inside in groups.items() if inside is not None}
    is_linear = table.shape[1] == len(basix.geometry(jointed.shape.type))
    return Cells(_KINDS[jointed.shape.name][0 if is_linear else 1], every, found)
