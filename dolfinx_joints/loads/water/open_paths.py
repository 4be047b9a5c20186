# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which open points of a joint are connected, by open points, with a face of the body."""

from __future__ import annotations

from typing import Any

import basix
import numpy as np

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import RowsAt, blocks_of, of_ranks, rows_at, sent_to, set_rows
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.blocks import connected, first_at_places
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type

# Of the shortest edge: nodes at the same place.
SAME_PLACE = 1e-6


class OpenPaths:
    """Paths from a facet group along the open points of a joint.

    With a nodal rule, points of one facet and points at the same place are neighbours, and paths
    begin at points on the group. With a Gauss rule, points of facets with a common edge (a common
    vertex in 2-D) are neighbours, those of one facet as well, and paths begin in facets with an
    edge (a vertex) on the group. Places count, not nodes: where another joint crosses, nodes are
    double and water passes.

    Neighbours are linked by what they have in common, a hub: a facet, an edge or a place. Each rank
    has some of the hubs, with all their points.
    """

    def __init__(self, model: LoadedBody, joint: str, group: str) -> None:
        """Link points with their neighbours (collective)."""
        assert model.operator is not None
        self._comm = comm = model.operator.comm
        layout, number = model.operator.layout, model.jointed.joint_names.index(joint)
        least = float(layout.sizes.min(initial=np.inf))
        near = SAME_PLACE * float(of_ranks(comm, np.array(least)).min())
        wet = model.V.tabulate_dof_coordinates()[model.nodes(group)]
        facets = np.flatnonzero(model.jointed.pairs.joint == number)
        self._starts: Flags = np.zeros(len(layout.areas), dtype=bool)
        if bool((layout.rule < 1e-9).any()):  # points on the edge of a facet: a nodal rule
            here = layout.joint == number
            place, is_wet = _places(comm, layout.points[here], wet, near)
            self._starts[here] = is_wet
            points = blocks_of(comm, len(here))[comm.rank] + np.flatnonzero(here)
            hub = layout.facet[facets][:, None]
            links = [
                _links(layout.number[facets], np.stack([np.full_like(hub, -1), hub], axis=2)),
                _links(points[:, None], np.column_stack([place, place])[:, None]),
            ]
        else:
            corners = _corners(model, facets)
            place, is_wet = _places(comm, corners.reshape(-1, 3), wet, near)
            place, is_wet = place.reshape(corners.shape[:2]), is_wet.reshape(corners.shape[:2])
            begin = layout.number[facets[is_wet.sum(axis=1) >= model.gdim - 1]].ravel()
            set_rows(comm, self._starts, begin, np.ones(len(begin), dtype=bool))
            links = [_links(layout.number[facets], _edges(place))]
        if not comm.allreduce(int(self._starts.sum())):
            raise MeshError(f"The facet group {group!r} touches no point of the joint {joint!r}.")
        every = np.concatenate(links)
        every = sent_to(comm, every[:, 1] % comm.size, every)
        points, self._point = np.unique(every[:, 2], return_inverse=True)
        hubs, self._hub = np.unique(every[:, :2], axis=0, return_inverse=True)
        self._point, self._hub = self._point.ravel(), len(points) + self._hub.ravel()
        self._size = len(points) + len(hubs)
        self._linked = RowsAt(comm, len(self._starts), points)

    def reached(self, open_points: Flags) -> Flags:
        """Which of the local open points are reached (collective)."""
        passable = self._linked(open_points)
        kept = passable[self._point]
        label = connected(self._point[kept], self._hub[kept], self._size)[: len(passable)]
        found = np.asarray(open_points & self._starts)
        grows = True
        while grows:  # through the links of this rank, then on through those of others
            before = self._linked(found)
            after = passable & np.isin(label, label[before])
            self._linked.mark(after, found)
            grows = self._comm.allreduce(int(np.count_nonzero(after & ~before))) > 0
        return found


def _places(comm: Any, points: Floats, wet: Floats, near: float) -> tuple[Ints, Flags]:
    """Number of the place of each point, and whether a wet node is there (collective)."""
    place = first_at_places(comm, np.concatenate([points, wet]), near)
    is_wet = np.zeros(len(place), dtype=bool)
    set_rows(comm, is_wet, place[len(points) :], np.ones(len(wet), dtype=bool))
    here = place[: len(points)]
    return here, rows_at(comm, is_wet, here)


def _corners(model: LoadedBody, facets: Ints) -> Floats:
    """Corners of facets of this rank, shape (n, corners, 3), [m]."""
    pairs = model.jointed.pairs
    found = np.zeros((len(facets), pairs.match.shape[1], 3))
    found[..., : model.gdim] = pairs.nodes[facets, : found.shape[1]]
    return found


def _links(points: Ints, hubs: Ints) -> Ints:
    """Rows of two numbers of a hub and one of a point, of points (n, q) and hubs (n, m, 2)."""
    shape = (*points.shape, hubs.shape[1])
    point = np.broadcast_to(points[:, :, None], shape)
    first, second = (np.broadcast_to(hubs[:, None, :, i], shape) for i in (0, 1))
    return np.stack([first.ravel(), second.ravel(), point.ravel()], axis=1)


def _edges(places: Ints) -> Ints:
    """Both ends of the edges of facets (vertices in 2-D, twice), shape (num_facets, edges, 2)."""
    corners = places.shape[1]
    edges = np.array(basix.topology(facet_cell_type(corners))[min(1, corners - 2)])
    return np.sort(places[:, edges], axis=2)[:, :, [0, -1]]
