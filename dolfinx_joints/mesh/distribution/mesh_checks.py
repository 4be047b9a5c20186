# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the cells of a mesh, before and after the DOLFINx mesh is created.

Cells and facets are compared by 64-bit sums of hashed vertex numbers, which do not depend on the
order of the vertices. In a mesh of 1e7 facets, two sums coincide by chance with probability 1/4e5.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.errors import MeshError, warn
from dolfinx_joints.common.mpi import blocks_of, raised_together, sent_to
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, facet_slots, middle
from dolfinx_joints.mesh.dolfinx_versions import geometry_nodes
from dolfinx_joints.mesh.jointed_mesh import JointedMesh
from dolfinx_joints.mesh.orientation import facet_normals

# A cell has no volume if its volume divided by the cube (2-D: square) of its size is below this
# limit. Rounding errors of coordinates up to 1e6 times the size are below the limit. A layer with a
# thickness of 1e-9 of its width is above the limit.
NO_VOLUME = 1e-10
TOUCHING = 1e-6  # facets touch if distance / facet size is below this limit


def check_cells(comm: Any, shape: CellShape, cells: Ints, x: Floats) -> None:
    """Check that cells have a volume and are distinct, with at most two per facet (collective).

    ``cells`` are global node numbers of this rank's cells, ``x`` the coordinates of the nodes [m].

    Raises:
        MeshError: A coordinate is not finite, or a cell or facet is invalid.
    """
    start, local = blocks_of(comm, len(cells))[comm.rank], shape.facet_vertices

    def reject(invalid: Ints, fault: str) -> None:
        first = [(start + cell, middle(x[cell])) for cell in invalid[:1]]
        by_rank = comm.allgather((len(invalid), first))
        if count := sum(number for number, _ in by_rank):
            number, place = min(first for _, firsts in by_rank for first in firsts)
            raise MeshError(f"{count} cells {fault}; the first is cell {number} around {place}.")

    with raised_together(comm):
        if not np.isfinite(x).all():
            raise MeshError("The mesh has coordinates that are not finite numbers.")
    jacobian = _jacobians(shape, x)
    volume, size = np.abs(np.linalg.det(jacobian)), np.abs(jacobian).max(axis=(1, 2))
    flat = volume <= NO_VOLUME * size**shape.dim
    extent = "volume" if shape.dim == 3 else "area"
    reject(np.flatnonzero(flat), f"have no {extent}: move their nodes, or remove the cells")
    mixed = _hashes(cells[:, : int(local.max()) + 1])
    twice = _repeated_keys(comm, mixed.sum(axis=1), 1)
    reject(twice, "have all vertices of another cell: keep one of each (copied volumes in Gmsh)")
    crowded = _repeated_keys(comm, mixed[:, local].sum(axis=2).ravel(), 2) // len(local)
    reject(np.unique(crowded), "have a facet that belongs to more than two cells: they overlap")


def warn_of_touching_facets(jointed: JointedMesh) -> None:
    """Warn on rank 0 of touching boundary facets that are not a joint (collective)."""
    mesh, shape = jointed.mesh, jointed.shape
    outer = exterior_facet_indices(mesh.topology)
    groups, other = jointed._facet_groups, {"-": "+", "+": "-"}
    faces = [name for name in groups if name[:-1] + other.get(name[-1:], "?") in groups]
    outer = np.setdiff1d(outer, np.concatenate([outer[:0], *map(jointed.facets, faces)]))
    cell, facet = facet_slots(mesh, outer)
    x = mesh.geometry.x[geometry_nodes(mesh)[cell], : shape.dim]
    vertices = shape.facet_vertices[facet][:, shape.facet_cycle, None]
    corners = np.take_along_axis(x, vertices, axis=1)
    inner = x[:, : int(shape.facet_vertices.max()) + 1].mean(axis=1)
    touching = _touching_facets(*_with_neighbours(mesh.comm, corners, inner))
    by_rank = mesh.comm.gather(
        (len(touching), sorted(tuple(map(float, row)) for row in touching)[:1])
    )
    if by_rank is not None and (count := sum(number for number, _ in by_rank)):
        first = min(place for _, places in by_rank for place in places)
        warn(
            f"{count} boundary facets touch others, the first around {middle(np.array([first]))}: "
            "the parts of the body are not connected there and can pass through each other. Make "
            "the mesh conforming (in Gmsh occ.fragment), or name joint faces NAME- and NAME+."
        )


def _with_neighbours(comm: Any, x: Floats, inner: Floats) -> tuple[Floats, Floats, Flags]:
    """Return the arguments of `_touching_facets` for this rank's cubes of a grid (collective).

    A hash assigns the cubes to the ranks, so that no rank receives the whole surface. A rank
    receives all facets that reach into its cubes and owns the facets with their centre in a cube.
    """
    if comm.size == 1:
        return x, inner, np.ones(len(x), dtype=bool)
    centres, (_, vertices, gdim) = x.mean(axis=1), x.shape
    size = np.linalg.norm(x - centres[:, None], axis=2).max(axis=1)
    width = 2.0 * comm.allreduce(float(size.max(initial=0.0)), MPI.MAX) or 1.0
    # A facet is narrower than a cube and fits in two neighbouring cubes along each axis.
    cube = np.floor((centres - size[:, None]) / width).astype(np.int64)
    steps = np.stack(np.meshgrid(*[[0, 1]] * gdim), axis=-1).reshape(-1, gdim)
    ranks = _rank_of(comm, cube[:, None] + steps)
    facet, rank = np.unique(np.argwhere(ranks[..., None] == np.arange(comm.size))[:, ::2], axis=0).T
    rows = np.hstack([x.reshape(len(x), vertices * gdim), inner])[facet]
    rows = sent_to(comm, rank, rows)
    x, inner = rows[:, :-gdim].reshape(-1, vertices, gdim), rows[:, -gdim:]
    is_own = _rank_of(comm, np.floor(x.mean(axis=1) / width).astype(np.int64)) == comm.rank
    return x, inner, is_own


def _rank_of(comm: Any, cube: Ints) -> Ints:
    """Return the rank of each cube, given by its integer coordinates along the last axis."""
    key = (_hashes(cube) * np.arange(1, 2 * cube.shape[-1], 2, dtype=np.uint64)).sum(axis=-1)
    return (key % np.uint64(comm.size)).astype(np.int64)


def _touching_facets(x: Floats, inner: Floats, is_own: Flags) -> Floats:
    """Return the centres of this rank's facets that lie on a facet with the opposite normal.

    Args:
        x: Vertices of boundary facets in cyclic order, shape (n, vertices, gdim), [m].
        inner: A point inside the cell of each facet, shape (n, gdim), [m].
        is_own: True for facets that this rank owns, shape (n,).
    """
    if not len(x):
        return inner
    centres, normals = x.mean(axis=1), facet_normals(x)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[np.einsum("ij,ij->i", normals, inner - centres) > 0] *= -1.0
    sizes = np.linalg.norm(x - centres[:, None], axis=2).max(axis=1)
    # Append the scaled normals, so that only facets with opposite normals are close together.
    far = sizes.max()
    tree = KDTree(np.hstack([centres, far * normals]))
    near = tree.query_ball_point(np.hstack([centres, -far * normals]), sizes)
    facet = np.repeat(np.arange(len(x)), [len(facets) for facets in near])
    point = np.concatenate(near).astype(np.int64)
    offset = centres[point] - centres[facet]
    on = np.abs(np.einsum("ij,ij->i", offset, normals[facet])) < TOUCHING * sizes[facet]
    for k in range(x.shape[1] if x.shape[2] == 3 else 0):
        start, end = x[facet, k], x[facet, (k + 1) % x.shape[1]]
        sides = (np.cross(end - start, c - start) for c in (centres[facet], centres[point]))
        on &= np.einsum("ij,ij->i", *sides) > 0
    return centres[np.unique(point[on & is_own[point]])]


def _jacobians(shape: CellShape, x: Floats) -> Floats:
    """Return the derivatives of the coordinates at the centre of each cell, (n, gdim, dim)."""
    element = shape.element()
    centre = element.points[: int(shape.facet_vertices.max()) + 1].mean(axis=0)
    return np.tensordot(x, element.tabulate(1, centre[None])[1:, 0, :, 0], axes=(1, 1))


def _hashes(nodes: Ints) -> NDArray[np.uint64]:
    """Return the SplitMix64 hashes of node numbers."""
    z = (nodes.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _repeated_keys(comm: Any, keys: NDArray[np.uint64], limit: int) -> Ints:
    """Return the positions of keys that occur more than ``limit`` times in total (collective)."""
    rank = (keys % np.uint64(comm.size)).astype(np.int64)
    received = np.sort(keys if comm.size == 1 else sent_to(comm, rank, keys))
    extra = np.concatenate(comm.allgather(received[limit:][received[limit:] == received[:-limit]]))
    return np.flatnonzero(np.isin(keys, extra)) if len(extra) else np.empty(0, dtype=np.int64)
