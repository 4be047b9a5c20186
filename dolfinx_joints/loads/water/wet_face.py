# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wet part of a face as lines or triangles of water, and its coupling with the body.

A reservoir is this face extruded horizontally upstream; the edges of the face form floor and banks.
The water conforms to the face and needs no separate mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import basix
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.mpi import on_root, summed
from dolfinx_joints.common.parameters import check_vector, shown
from dolfinx_joints.loads.load import LoadedBody, Vector
from dolfinx_joints.loads.water.reservoir_slabs import (
    SURFACE,
    WaterFace,
    cut_at_level,
    regions_below_level,
)
from dolfinx_joints.loads.water.wetted_facets import (
    WettedFacets,
    WettedPoints,
    sizes,
    wetted_facets,
)
from dolfinx_joints.mesh.blocks import same_places
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.node_numbering import NodeNumbering

# Distance from the level, relative to the height of the face, of nodes that count as on the level.
ON_LEVEL = 1e-6

# Distance, relative to the shortest edge, of nodes of two blocks that form one node of the water.
SAME_NODE = 0.01

# Distance, relative to the shortest side of the cut parts, of corners on the level that are merged.
SAME_CORNER = 0.01

# Least cosine of the angle between the normal of the face and the upstream direction.
STEEPEST = 0.05

# Degree of the quadrature on parts of facets, for quadratic shapes, normals and pressures.
DEGREE = 8

# Lines or triangles into which a facet is divided, by dimension and number of nodes.
_RING = (0, 4, 1, 6, 3, 7, 2, 5)
PARTS: dict[tuple[int, int], list[list[int]]] = {
    (2, 2): [[0, 1]],
    (2, 3): [[0, 2], [2, 1]],
    (3, 3): [[0, 1, 2]],
    (3, 4): [[0, 1, 2], [3, 2, 1]],
    (3, 6): [[0, 5, 4], [1, 3, 5], [2, 4, 3], [3, 4, 5]],
    (3, 9): [[8, _RING[i - 1], _RING[i]] for i in range(8)],
}


class Extruded(Protocol):
    """Reservoir extruded from its wet face; `str` returns its name for messages."""

    @property
    def group(self) -> str:
        """Name of the facet group."""

    @property
    def level(self) -> float:
        """Height of the water level [m]."""

    @property
    def upstream(self) -> Vector | None:
        """Horizontal direction of the reservoir; None for the mean normal of the face."""


@dataclass(frozen=True, kw_only=True)
class WetFace:
    """Wet part of a face.

    Attributes:
        face: Lines or triangles of the water; complete on rank 0, empty on other ranks.
        upstream: Horizontal unit vector, shape (gdim,).
        coupling: Water nodes, dofs of the body and forces of unit pressures [m^2] along the normal
            of the body; complete on rank 0, empty on other ranks.
    """

    face: WaterFace
    upstream: Floats
    coupling: tuple[Ints, Ints, Floats]


def check_upstream(water: Extruded) -> None:
    """Check that the upstream direction is horizontal."""
    if water.upstream is not None and not (water.upstream[-1] == 0.0 and np.any(water.upstream)):
        raise ValueError(
            f"{water}: upstream is {shown(water.upstream)}; it must be a horizontal vector, with "
            "zero as last number."
        )


def wet_face(
    model: LoadedBody,
    water: Extruded,
    order: NodeNumbering | None = None,
    *,
    surface_moves: bool = False,
) -> WetFace:
    """Build the wet face of a reservoir (collective).

    Water nodes below the level come first, then nodes on the level. With ``order``, they are in the
    order of the body's nodes. If ``surface_moves``, nodes on the level have a pressure.

    Raises:
        ValueError: The face ends below the level, or part of the face does not face upstream.
        MeshError: The group does not exist, or some of its facets are inside the body.
    """
    comm = model.jointed.mesh.comm
    face = _Face(wetted_facets(model.V, model.jointed, water.group, float(water.level)))
    numbers, below = face.numbers(comm, water)
    if order is not None:
        numbers = face.in_order(comm, numbers, below, order)
    parts, total_count = face.wet_parts(comm, numbers, below, order)
    count = total_count if surface_moves else below
    areas = parts.points.areas.sum(axis=1)
    upstream = _direction(water, summed(comm, areas.sum(axis=0)))
    _check_faces_upstream(water, comm, areas, upstream)
    nodes, corners = _gather(comm, parts.nodes), _gather(comm, parts.corners)
    rows, dofs, values = (_gather(comm, part) for part in parts.coupling(model, count))
    return WetFace(
        face=WaterFace(below=below, count=count, nodes=nodes, corners=corners),
        upstream=upstream,
        coupling=(rows, dofs, values),
    )


def check_reaches_level(water: Extruded, face: WaterFace) -> None:
    """Check that each region of a face reaches the level, so that the pressure is determined."""
    if lids := regions_below_level(face):
        raise ValueError(
            f"{water}: {lids} separate regions of the face do not reach up to the level of "
            f"{water.level:g} m. All regions must, because they are the cross-section of the water."
        )


def _direction(water: Extruded, area: Floats) -> Floats:
    """Return the upstream unit vector; ``area`` is the area vector of the wet face [m^2]."""
    vector = np.append(area[:-1], 0.0)
    if water.upstream is not None:
        vector = check_vector(f"{water}: upstream", water.upstream, (len(area),))
    size = float(np.linalg.norm(vector))
    if water.upstream is None and size <= STEEPEST * float(np.linalg.norm(area)):
        if not area.any():
            return np.eye(len(area))[0]
        raise ValueError(
            f"{water}: the mean normal of the wet face has no horizontal part, so the "
            "upstream direction is undetermined; give upstream=, or a group that is one face."
        )
    return np.asarray(vector / size)


def _check_top(water: Extruded, highest: float, lowest: float) -> None:
    if lowest < water.level and highest < water.level - ON_LEVEL * (highest - lowest):
        raise ValueError(
            f"{water}: the level is {water.level:g} m, but the face ends at {highest:g} m; it must "
            "reach up to the level, because it is the cross-section of the reservoir."
        )


def _check_faces_upstream(water: Extruded, comm: Any, areas: Floats, upstream: Floats) -> None:
    """Check that the normals of all parts point upstream (collective)."""
    size = np.linalg.norm(areas, axis=1)
    turned_away = areas @ upstream < STEEPEST * size
    sums = summed(comm, np.array([size[turned_away].sum(), size.sum()]))
    if sums[0] > 0.0:
        shown = ", ".join(f"{x:.3g}" for x in upstream)
        raise ValueError(
            f"{water}: {100 * sums[0] / sums[1]:.3g} % of the wet face does not face upstream: its "
            f"normal differs by more than 87 degrees from ({shown}). Remove these facets from the "
            "group, give another upstream=, or use a WestergaardMass."
        )


class _Face:
    """Facets of this rank, divided into lines or triangles at their nodes."""

    def __init__(self, facets: WettedFacets) -> None:
        self._facets = facets
        count, nodes = facets.nodes.shape
        gdim = facets.places.shape[2]
        parts = np.array(PARTS[gdim, nodes])
        self._of = np.tile(np.arange(count), len(parts))
        local = np.repeat(parts, count, axis=0)
        self._nodes = np.take_along_axis(facets.nodes[self._of], local, axis=1)
        self._places = np.take_along_axis(facets.places[self._of], local[:, :, None], axis=1)
        at = facets.at(self._of, self._places, np.zeros(self._nodes.shape))
        self._corners = at.positions

    def numbers(self, comm: Any, water: Extruded) -> tuple[Ints, int]:
        """Return the node numbers of this rank's corners, and the number of nodes (collective).

        Corners at or above the level have the number `SURFACE`.
        """
        level = float(water.level)
        local_nodes, first = np.unique(self._nodes, return_index=True)
        points = self._corners.reshape(-1, self._corners.shape[2])[first]
        sides = self._corners - np.roll(self._corners, 1, axis=1)
        shortest = float(np.linalg.norm(sides, axis=2).min(initial=np.inf))
        shortest = min(comm.allgather(shortest))
        lowest = min(comm.allgather(points[:, -1].min(initial=np.inf)))
        highest = max(comm.allgather(points[:, -1].max(initial=-np.inf)))
        _check_top(water, highest, lowest)
        self._on_level = ON_LEVEL * max(highest - lowest, 0.0)
        self._level = level
        all_x = comm.gather(points, root=0)

        def work() -> tuple[list[Ints], int]:
            wet = level - np.concatenate(all_x)[:, -1] > self._on_level
            numbers = np.full(len(wet), SURFACE)
            _, numbers[wet] = np.unique(
                same_places(np.concatenate(all_x)[wet], SAME_NODE * shortest), return_inverse=True
            )
            splits = np.cumsum([len(p) for p in all_x])[:-1]
            return np.split(numbers, splits), int(numbers.max(initial=SURFACE)) + 1

        by_rank, count = on_root(comm, work)
        return by_rank[comm.rank][np.searchsorted(local_nodes, self._nodes)], count

    def in_order(self, comm: Any, numbers: Ints, count: int, nodes: NodeNumbering) -> Ints:
        """Renumber the nodes in the order of the body's nodes, for any rank count (collective)."""
        is_wet = numbers != SURFACE
        pairs = np.column_stack([numbers[is_wet], nodes.number[self._nodes[is_wet]]])
        place = _places_by_key(count, *np.concatenate(comm.allgather(pairs)).T)
        return np.append(place, SURFACE)[numbers]

    def wet_parts(
        self, comm: Any, numbers: Ints, below: int, order: NodeNumbering | None
    ) -> tuple[_WetParts, int]:
        """Cut the face at the level; return the wet parts and their number of nodes (collective).

        Corners keep the numbers from `numbers` or `in_order`; nodes on the level follow.
        """
        depths = self._level - self._corners[:, :, -1]
        depths = np.where(numbers == SURFACE, np.minimum(depths, 0.0), depths)
        depths[np.abs(depths) <= self._on_level] = 0.0
        uncut, shares, sources = cut_at_level(depths)
        corners = np.einsum("pab,pbi->pai", shares, self._corners[uncut])
        places = np.einsum("pab,pbi->pai", shares, self._places[uncut])
        size = sizes(places)
        kept = size > 1e-12
        uncut, corners, places, sources = uncut[kept], corners[kept], places[kept], sources[kept]
        nodes = np.take_along_axis(numbers[uncut], np.maximum(sources, 0), axis=1)
        at_level = sources == SURFACE
        keys = _edge_keys(self._nodes[uncut[at_level.nonzero()[0]]], shares[kept][at_level], order)
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        shortest = float(sides[at_level | np.roll(at_level, 1, axis=1)].min(initial=np.inf))
        on_level, count = _level_numbers(comm, corners[at_level], keys, shortest)
        nodes[at_level] = below + on_level
        cell = (basix.CellType.interval, basix.CellType.triangle)[places.shape[1] - 2]
        points, weights = basix.make_quadrature(cell, DEGREE)
        pressures = np.column_stack([1.0 - points.sum(axis=1), points])
        parts = _WetParts(
            nodes=nodes,
            corners=corners,
            pressures=pressures,
            points=self._facets.at(
                self._of[uncut],
                np.einsum("qa,pai->pqi", pressures, places),
                size[kept][:, None] * weights,
            ),
        )
        return parts, below + count


def _places_by_key(count: int, label: Ints, keys: Ints) -> Ints:
    """Return the position of each label when sorted by its least key, shape (count,)."""
    least = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(least, label, keys)
    place = np.empty(count, dtype=np.int64)
    place[np.argsort(least, kind="stable")] = np.arange(count)
    return place


def _edge_keys(nodes: Ints, shares: Floats, order: NodeNumbering | None) -> Ints:
    """Return keys that sort corners on the level in the order of the body's nodes, shape (n,).

    Without an order all keys are zero. Nodes and barycentric coordinates (``shares``) refer to the
    uncut part. Shares are zero except at the ends of the cut edge, or at a node on the level.
    """
    if order is None:
        return np.zeros(len(nodes), dtype=np.int64)
    ends, at_cut = order.number[nodes], shares > 0.0
    least = np.where(at_cut, ends, order.count).min(axis=1)
    return np.asarray(least * order.count + np.where(at_cut, ends, 0).max(axis=1))


def _level_numbers(comm: Any, points: Floats, keys: Ints, shortest: float) -> tuple[Ints, int]:
    """Return numbers of the corners on the level, ordered by keys, and their count (collective).

    Points are this rank's corners; ``shortest`` is the shortest side of a part there [m].
    """
    all_corners = comm.gather((points, keys, shortest), root=0)

    def work() -> tuple[list[Ints], int]:
        places, keys = (np.concatenate([of_rank[i] for of_rank in all_corners]) for i in (0, 1))
        distance = SAME_CORNER * min(of_rank[2] for of_rank in all_corners)
        _, label = np.unique(same_places(places, distance), return_inverse=True)
        number = _places_by_key(int(label.max(initial=-1)) + 1, label, keys)
        ends = np.cumsum([len(of_rank[0]) for of_rank in all_corners])
        return np.split(number[label], ends[:-1]), len(number)

    by_rank, count = on_root(comm, work)
    return by_rank[comm.rank], count


@dataclass(frozen=True, kw_only=True)
class _WetParts:
    """Lines or triangles of this rank below the level.

    Attributes:
        nodes: Water nodes at the corners, shape (parts, gdim).
        corners: Coordinates, shape (parts, gdim, gdim), [m].
        pressures: Shape functions of the corners at quadrature points, shape (points, gdim).
        points: Quadrature points with the shape functions of the body.
    """

    nodes: Ints
    corners: Floats
    pressures: Floats
    points: WettedPoints

    def coupling(self, model: LoadedBody, count: int) -> tuple[Ints, Ints, Floats]:
        """Return nodes, dofs and forces [m^2] of unit pressures at the first ``count`` nodes."""
        gdim = model.gdim
        nodes = self.points.nodes
        blocks = model.V.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
        dofs = gdim * blocks.reshape(nodes.shape)[:, :, None] + np.arange(gdim)
        values = np.einsum(
            "qc,pqn,pqi->pcni", self.pressures, self.points.shapes, self.points.areas
        )
        rows = np.broadcast_to(self.nodes[:, :, None, None], values.shape)
        columns = np.broadcast_to(dofs[:, None], values.shape)
        has_pressure = rows < count
        return rows[has_pressure], columns[has_pressure], values[has_pressure]


def _gather(comm: Any, part: NDArray[Any]) -> NDArray[Any]:
    """Gather the rows of all ranks on rank 0; other ranks receive no rows (collective)."""
    of_ranks = comm.gather(part, root=0)
    return part[:0] if of_ranks is None else np.concatenate(of_ranks)
