# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Connectivity of open joint points with a face of the body, for water entering a joint."""

from __future__ import annotations

from typing import Any

import basix
import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats, Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import RowsAt, blocks_of, of_ranks, rows_at, sent_to, set_rows
from dolfinx_joints.loads.load import LoadedBody
from dolfinx_joints.mesh.blocks import connected, first_at_places
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type

# Distance, relative to the shortest edge, within which nodes count as coincident.
SAME_PLACE = 1e-6


class OpenPaths:
    """Paths from a facet group along the open points of a joint.

    With a nodal rule, points of the same facet and coincident points are neighbours. Paths begin at
    points on the group. With a Gauss rule, points of the same facet and of facets with a common
    edge (in 2-D: vertex) are neighbours. Paths begin in facets with an edge (vertex) on the group.
    Water passes another joint that crosses, although nodes are duplicated there. Points are
    therefore compared by coordinates instead of node numbers.

    Neighbours are linked by a common hub: a facet, an edge or a place. One rank stores each hub.
    """

    def __init__(self, model: LoadedBody, joint: str, group: str) -> None:
        """Link the points with their neighbours (collective)."""
        assert model.operator is not None
        self._comm = comm = model.operator.comm
        layout, number = model.operator.layout, model.jointed.joint_names.index(joint)
        shortest_edge = float(layout.sizes.min(initial=np.inf))
        tolerance = SAME_PLACE * float(of_ranks(comm, np.array(shortest_edge)).min())
        wet_nodes = model.V.tabulate_dof_coordinates()[model.nodes(group)]
        facets = np.flatnonzero(model.jointed.pairs.joint == number)
        self._starts: Flags = np.zeros(len(layout.areas), dtype=bool)
        if bool((layout.rule < 1e-9).any()):  # a nodal rule has points on the edges of facets
            in_joint = layout.joint == number
            place, is_wet = _places(comm, layout.points[in_joint], wet_nodes, tolerance)
            self._starts[in_joint] = is_wet
            points = blocks_of(comm, len(in_joint))[comm.rank] + np.flatnonzero(in_joint)
            hub = layout.facet[facets][:, None]
            links = [
                _links(layout.number[facets], np.stack([np.full_like(hub, -1), hub], axis=2)),
                _links(points[:, None], np.column_stack([place, place])[:, None]),
            ]
        else:
            corners = _corners(model, facets)
            place, is_wet = _places(comm, corners.reshape(-1, 3), wet_nodes, tolerance)
            place, is_wet = place.reshape(corners.shape[:2]), is_wet.reshape(corners.shape[:2])
            begin = layout.number[facets[is_wet.sum(axis=1) >= model.gdim - 1]].ravel()
            set_rows(comm, self._starts, begin, np.ones(len(begin), dtype=bool))
            links = [_links(layout.number[facets], _edges(place))]
        if not comm.allreduce(int(self._starts.sum())):
            raise MeshError(f"The facet group {group!r} does not touch the joint {joint!r}.")
        all_links = np.concatenate(links)
        all_links = sent_to(comm, all_links[:, 1] % comm.size, all_links)
        points, self._point = np.unique(all_links[:, 2], return_inverse=True)
        hubs, self._hub = np.unique(all_links[:, :2], axis=0, return_inverse=True)
        self._point, self._hub = self._point.ravel(), len(points) + self._hub.ravel()
        self._size = len(points) + len(hubs)
        self._linked = RowsAt(comm, len(self._starts), points)

    def reached(self, open_points: Flags) -> Flags:
        """Return True for the rank's open points that are connected with the group (collective)."""
        passable = self._linked(open_points)
        link_open = passable[self._point]
        label = connected(self._point[link_open], self._hub[link_open], self._size)[: len(passable)]
        reached = np.asarray(open_points & self._starts)
        grows = True
        while grows:  # each pass follows this rank's links, then exchanges the reached points
            reached_before = self._linked(reached)
            reached_after = passable & np.isin(label, label[reached_before])
            self._linked.mark(reached_after, reached)
            grows = self._comm.allreduce(int(np.count_nonzero(reached_after & ~reached_before))) > 0
        return reached


def _places(comm: Any, points: Floats, wet_nodes: Floats, tolerance: float) -> tuple[Ints, Flags]:
    """Return the number of each point's place, and True if a wet node is there (collective)."""
    place = first_at_places(comm, np.concatenate([points, wet_nodes]), tolerance)
    is_wet = np.zeros(len(place), dtype=bool)
    set_rows(comm, is_wet, place[len(points) :], np.ones(len(wet_nodes), dtype=bool))
    of_points = place[: len(points)]
    return of_points, rows_at(comm, is_wet, of_points)


def _corners(model: LoadedBody, facets: Ints) -> Floats:
    """Return the corners of facets of this rank, shape (n, corners, 3), [m]."""
    pairs = model.jointed.pairs
    corners = np.zeros((len(facets), pairs.match.shape[1], 3))
    corners[..., : model.gdim] = pairs.nodes[facets, : corners.shape[1]]
    return corners


def _links(points: Ints, hubs: Ints) -> Ints:
    """Return rows that link points (n, q) with hubs of two numbers (n, m, 2): hub, hub, point."""
    shape = (*points.shape, hubs.shape[1])
    point = np.broadcast_to(points[:, :, None], shape)
    first, second = (np.broadcast_to(hubs[:, None, :, i], shape) for i in (0, 1))
    return np.stack([first.ravel(), second.ravel(), point.ravel()], axis=1)


def _edges(places: Ints) -> Ints:
    """Return both ends of the edges of facets, shape (facets, edges, 2); in 2-D vertices twice."""
    corners = places.shape[1]
    edges = np.array(basix.topology(facet_cell_type(corners))[min(1, corners - 2)])
    return np.sort(places[:, edges], axis=2)[:, :, [0, -1]]
