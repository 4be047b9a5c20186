# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Box meshes of DOLFINx with joints and groups by position; records and norms on all ranks."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box, create_rectangle, locate_entities

from dolfinx_joints import split_mesh
from dolfinx_joints.simulation.monitor import Monitor

COMM = MPI.COMM_WORLD


def box(
    size, counts, cell=None, *, joints=(), groups=(), cells=(), place=None, comm=COMM, **options
):
    """Return a rectangle or box, of quadrilaterals or hexahedra by default (collective).

    Args:
        size: Corner opposite to the origin, or two opposite corners.
        counts: Cells along each axis.
        cell: Type of the cells, or its name.
        joints: Joints by name: a plane (axis, value), or a function of points (3, n) that is true
            on the joint.
        groups: Groups of facets, in the same form.
        cells: Groups of cells by name: limits (low, high) along the last axis.
        place: Function that moves the nodes (n, 3) after the groups have been located.
        comm: MPI communicator.
        options: Options of DOLFINx's function that creates the mesh.
    """
    dim = len(counts)
    corners = size if np.ndim(size) == 2 else [np.zeros(dim), size]
    if isinstance(cell, str):
        cell = CellType[cell]
    if dim == 2:
        mesh = create_rectangle(comm, corners, counts, cell or CellType.quadrilateral, **options)
    else:
        mesh = create_box(comm, corners, counts, cell or CellType.hexahedron, **options)
    mesh.topology.create_connectivity(dim - 1, dim)

    def on(where):
        return where if callable(where) else lambda x: np.isclose(x[where[0]], where[1])

    def between(ends):
        low, high = ends
        return lambda x: (x[dim - 1] > low - 1e-9) & (x[dim - 1] < high + 1e-9)

    joints, groups = (
        {name: locate_entities(mesh, dim - 1, on(where)) for name, where in dict(named).items()}
        for named in (joints, groups)
    )
    cells = {name: locate_entities(mesh, dim, between(ends)) for name, ends in dict(cells).items()}
    if place is not None:
        mesh.geometry.x[:] = place(mesh.geometry.x)
    return split_mesh(mesh, joints=joints, groups=groups, cell_groups=cells)


class Rows(Monitor):
    """Monitor that collects the value of a function for the first record and for each step."""

    def __init__(self, make):
        self._make = make

    def start(self, model, stage, steps, first):
        self.rows = [self._make(first)]

    def record(self, record):
        self.rows.append(self._make(record))


def largest(values):
    """Return the largest absolute value on all ranks (collective)."""
    return COMM.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


def difference(one, two):
    """Return the largest difference of two vectors, relative to the largest entry (collective)."""
    change = one.copy()
    change.axpy(-1.0, two)
    return float(change.norm(3) / two.norm(3))
