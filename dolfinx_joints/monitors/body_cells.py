# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of the body and cell values in the order of the input mesh, for files."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Dealt, Flags, Ints
from dolfinx_joints.common.mpi import RowsAt, across, blocks_of, dealt, equal_blocks
from dolfinx_joints.mesh.cells import vtk_layout
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.monitors.manifest import mesh_hash
from dolfinx_joints.monitors.probes import boundary_facets
from dolfinx_joints.results.layout import Cells


class CellOrder:
    """Reorders cell values to the order of the input mesh, in equal blocks, one per rank.

    Attributes:
        owned: Number of cells that this rank owns.
    """

    def __init__(self, model: Model) -> None:
        """Set up the exchange between ranks (collective)."""
        mesh = model.jointed.mesh
        index_map = mesh.topology.index_map(mesh.topology.dim)
        self.owned, self._count = index_map.size_local, index_map.size_global
        self._comm, owned = mesh.comm, np.arange(self.owned) + index_map.local_range[0]
        number = np.asarray(mesh.topology.original_cell_index, dtype=np.int64)[: self.owned]
        self._rows = RowsAt(
            self._comm, self.owned, dealt(self._comm, self._count, number, owned.astype(np.int64))
        )

    def dealt(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of this rank's block of cells, from values of the cells it owns."""
        return self._rows(values)

    def across(self, rows: NDArray[Any]) -> NDArray[Any] | Dealt:
        """Return the blocks of all ranks as one array."""
        return across(self._comm, rows, equal_blocks(self._count, self._comm.size))


def cells_of_rank(
    model: Model, nodes: NodeNumbering, cells: CellOrder
) -> tuple[int, Ints, dict[str, Flags]]:
    """Return the cells of a model in this rank's block (collective).

    Returns:
        VTK's number of the cell shape; nodes of each cell in VTK's order, shape (n, nodes per
        cell); and for each cell group True for its cells, shape (n,).
    """
    jointed, V = model.jointed, model.V
    cell_nodes = V.dofmap.list[: cells.owned]
    kind, order = vtk_layout(jointed.shape, cell_nodes.shape[1])
    members = {}
    for name in jointed.cell_groups:
        marks = np.zeros(cells.owned, dtype=bool)
        of_group = jointed.cells(name)
        marks[of_group[of_group < cells.owned]] = True
        members[name] = cells.dealt(marks)
    return kind, cells.dealt(nodes.number[cell_nodes][:, order]), members


def body_cells(model: Model, nodes: NodeNumbering) -> Cells:
    """Return the cells of a model for a results file (collective)."""
    order, comm = CellOrder(model), model.jointed.mesh.comm
    kind, cells, members = cells_of_rank(model, nodes, order)
    first = blocks_of(comm, len(cells))[comm.rank]
    groups = {name: across(comm, first + np.flatnonzero(marks)) for name, marks in members.items()}
    return Cells(kind, order.across(cells), groups)


def body_mesh(
    model: Model, nodes: NodeNumbering, rows: JointRows | None
) -> tuple[tuple[Any, ...], str]:
    """Return the arguments of `declare_body` and, on rank 0, the mesh hash (collective)."""
    comm, surface = model.jointed.mesh.comm, boundary_facets(model, nodes)
    joints = {} if rows is None else rows.constant_arrays()
    mesh = nodes.across(nodes.positions), across(comm, surface), joints, body_cells(model, nodes)
    return mesh, mesh_hash(comm, nodes.positions, surface)
