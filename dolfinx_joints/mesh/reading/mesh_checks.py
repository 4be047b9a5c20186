# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the arrays of a mesh, the same for all readers, before DOLFINx is called.

Facets and cells are compared by a 64-bit sum of mixed numbers of their vertices. A sum does not
depend on the order of the vertices, and for 1e7 facets two sums coincide by chance once in 1e5
meshes.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dolfinx_joints.common.errors import MeshError, warn
from dolfinx_joints.common.mpi import raised_together, sent_to
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, RawMesh
from dolfinx_joints.mesh.distribution.shares import PreparedMesh
from dolfinx_joints.mesh.orientation import facet_normals
from dolfinx_joints.mesh.preparation import prepare

# Cells have no volume below this part of the cube (square in 2-D) of their extent. Rounding of
# coordinates up to 1e6 times the extent stays below; layers of 1e-6 of their width are above.
NO_VOLUME = 1e-10
# Facets touch if they are closer than this part of their size.
TOUCHING = 1e-6
_OPPOSITE = -0.99  # cosine of the angle between the outward normals of facets that touch


def prepare_checked(raw: RawMesh, joints: list[str] | None) -> PreparedMesh:
    """Check a mesh on rank 0, split it and tag its groups."""
    groups = raw.facet_groups
    pairs = [groups[name] for name in two_faces(groups)]
    numbers = np.arange(len(raw.cells))
    boundary = check_cells(MPI.COMM_SELF, raw.shape, numbers, raw.cells, raw.x[raw.cells])
    made = prepare(raw, joints)
    warn_of_untied(MPI.COMM_SELF, raw.shape, raw.cells, raw.x[raw.cells], boundary, pairs)
    return made


def two_faces(names: Any) -> list[str]:
    """Return the names of groups that are the two faces ``NAME-`` and ``NAME+`` of a joint."""
    other = {"-": "+", "+": "-"}
    return [name for name in names if name[-1:] in other and name[:-1] + other[name[-1]] in names]


def check_cells(comm: Any, shape: CellShape, numbers: Ints, cells: Ints, x: Floats) -> Ints:
    """Check that cells have a volume and stand once, and facets belong to two cells (collective).

    Args:
        comm: Communicator of the mesh.
        shape: Reference cell.
        numbers: Number of each cell of this rank among those of all ranks, shape (n,).
        cells: Nodes of these cells, numbered over all ranks, shape (n, nodes of a cell).
        x: Coordinates of these nodes, shape (n, nodes of a cell, gdim), [m].

    Returns:
        The boundary facets of these cells: their position among all facets of these cells.

    Raises:
        MeshError: A coordinate is not finite, or a cell or facet is wrong.
    """

    def refuse(wrong: Ints, what: str) -> None:
        first = (int(numbers[wrong[0]]), _place(x[wrong[0]])) if len(wrong) else None
        found = comm.allgather((len(wrong), first))
        count = sum(number for number, _ in found)
        if count:
            number, place = min(first for _, first in found if first is not None)
            raise MeshError(f"{count} {what.format(number=number, place=place)}")

    with raised_together(comm):
        if not np.isfinite(x).all():
            raise MeshError("The mesh has coordinates that are not finite numbers.")
    extent = np.ptp(x[:, : int(shape.facet_vertices.max()) + 1], axis=1).max(axis=1)
    flat = np.abs(_volumes(shape, x)) <= NO_VOLUME * extent**shape.dim
    refuse(
        np.flatnonzero(flat),
        "cells have no volume, the first (cell {number}) around {place}; remove them, or move "
        "their nodes.",
    )
    mixed = _mixed(cells[:, : int(shape.facet_vertices.max()) + 1])
    count = _counts(comm, mixed.sum(axis=1))
    refuse(
        np.flatnonzero(count > 1),
        "cells stand twice in the mesh, the first (cell {number}) around {place}; keep one of each "
        "(in Gmsh a volume that was copied onto another: occ.removeAllDuplicates, "
        "mesh.removeDuplicateElements).",
    )
    count = _counts(comm, mixed[:, shape.facet_vertices].sum(axis=2).ravel())
    crowded = np.flatnonzero(count > 2)
    refuse(
        np.unique(crowded // len(shape.facet_vertices)),
        "cells have a facet that belongs to more than two cells, the first (cell {number}) around "
        "{place}; the cells overlap there.",
    )
    return np.flatnonzero(count == 1)


def warn_of_untied(
    comm: Any, shape: CellShape, cells: Ints, x: Floats, boundary: Ints, pairs: list[Ints]
) -> None:
    """Warn of boundary facets that touch others, on rank 0 (collective).

    Args:
        comm: Communicator of the mesh.
        shape: Reference cell.
        cells: Nodes of the cells of this rank, numbered over all ranks.
        x: Coordinates of these nodes, shape (n, nodes of a cell, gdim), [m].
        boundary: Boundary facets, as `check_cells` returns them.
        pairs: Vertices of the facets of joints whose faces are duplicated: they may touch.
    """
    cell, facet = np.divmod(boundary, len(shape.facet_vertices))
    vertices = shape.facet_vertices[facet]
    if pairs:
        keys = _mixed(np.take_along_axis(cells[cell], vertices, axis=1)).sum(axis=1)
        other = ~np.isin(keys, _mixed(np.concatenate(pairs)).sum(axis=1))
        cell, vertices = cell[other], vertices[other]
    corners = np.take_along_axis(x[cell], vertices[:, shape.facet_cycle, None], axis=1)
    middles = x[cell, : int(shape.facet_vertices.max()) + 1].mean(axis=1)
    found = comm.gather((corners, middles), root=0)
    if found is None:
        return
    centres = _touching(*(np.concatenate(each) for each in zip(*found, strict=True)))
    if len(centres):
        warn(
            f"{len(centres)} boundary facets touch others, the first around {_place(centres[:1])}: "
            "the parts of the body are not connected there and can pass through each other. Mesh "
            "them conforming (in Gmsh occ.fragment), or name the two faces of a joint NAME- and "
            "NAME+."
        )


def _touching(x: Floats, middles: Floats) -> Floats:
    """Centres of the facets whose centre lies on another facet with the opposite normal.

    Args:
        x: Vertices of boundary facets in cyclic order, shape (n, vertices, gdim), [m].
        middles: Middle of the cell of each, shape (n, gdim), [m].
    """
    if not len(x):
        return middles
    centres = x.mean(axis=1)
    normals = facet_normals(x)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    inward = np.einsum("ij,ij->i", normals, middles - centres) > 0
    normals[inward] *= -1.0
    sizes = np.linalg.norm(x - centres[:, None], axis=2).max(axis=1)
    near = KDTree(centres).query_ball_point(centres, sizes, return_sorted=False)
    wide = np.repeat(np.arange(len(x)), [len(each) for each in near])
    point = np.concatenate(near).astype(np.int64)
    opposite = np.einsum("ij,ij->i", normals[wide], normals[point]) < _OPPOSITE
    wide, point = wide[opposite], point[opposite]
    away = centres[point] - centres[wide]
    on_plane = np.abs(np.einsum("ij,ij->i", away, normals[wide])) < TOUCHING * sizes[wide]
    wide, point = wide[on_plane], point[on_plane]
    inside = np.ones(len(wide), dtype=bool)
    for k in range(x.shape[1] if x.shape[2] == 3 else 0):
        edge = x[wide, (k + 1) % x.shape[1]] - x[wide, k]
        sides = [
            np.cross(edge, each[at] - x[wide, k])
            for each, at in ((centres, wide), (centres, point))
        ]
        inside &= np.einsum("ij,ij->i", *sides) > 0
    return centres[np.unique(point[inside])]


def _volumes(shape: CellShape, x: Floats) -> Floats:
    """Volume at the middle of each cell, times that of the reference cell, shape (n,)."""
    element = shape.element()
    middle = element.points[: int(shape.facet_vertices.max()) + 1].mean(axis=0)[None]
    derivatives = element.tabulate(1, middle)[1:, 0, :, 0]
    edges = np.tensordot(x, derivatives, axes=(1, 1))  # (n, gdim, dim)
    if shape.dim == 2:
        return edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    across = np.cross(edges[:, :, 0], edges[:, :, 1])
    return np.einsum("ij,ij->i", across, edges[:, :, 2])


def _mixed(nodes: Ints) -> NDArray[np.uint64]:
    """Numbers of nodes with their bits mixed (SplitMix64), modulo 2^64."""
    z = (nodes.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _counts(comm: Any, keys: NDArray[np.uint64]) -> Ints:
    """Return how often each key occurs on all ranks, shape (n,) (collective)."""
    if comm.size == 1:
        order = np.argsort(keys)
        ordered = keys[order]
        first = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1])[: len(keys)])
        number = np.diff(np.append(first, len(keys)))
        count = np.empty(len(keys), dtype=np.int64)
        count[order] = np.repeat(number, number)
        return count
    rank = (keys % np.uint64(comm.size)).astype(np.int64)
    mine = np.full(len(keys), comm.rank)
    rows = sent_to(comm, rank, np.column_stack([keys.view(np.int64), mine, np.arange(len(keys))]))
    of_rows = _counts(MPI.COMM_SELF, rows[:, 0].copy().view(np.uint64))
    back = sent_to(comm, rows[:, 1], np.column_stack([rows[:, 2], of_rows]))
    count = np.empty(len(keys), dtype=np.int64)
    count[back[:, 0]] = back[:, 1]
    return count


def _place(x: Floats) -> str:
    """Mean of some points, for messages."""
    return f"({', '.join(f'{value:.4g}' for value in x.mean(axis=0))})"
