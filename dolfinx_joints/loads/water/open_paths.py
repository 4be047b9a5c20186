# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which open points of a joint are connected, by open points, with a face of the body."""

from __future__ import annotations

import basix
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.mesh.blocks import connected, same_places
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type

Mask = NDArray[np.bool_]

# Of the shortest edge: nodes at the same place.
SAME_PLACE = 1e-6


class OpenPaths:
    """Paths from a facet group along the open points of a joint.

    With a nodal rule, points of one facet and points at the same place are neighbours, and paths
    begin at points on the group. With a Gauss rule, points of facets with a common edge (a common
    vertex in 2-D) are neighbours, those of one facet as well, and paths begin in facets with an
    edge (a vertex) on the group. Places count, not nodes: where another joint crosses, nodes are
    double and water passes. All of it is known to all ranks.
    """

    def __init__(self, model: LoadedBody, joint: str, group: str) -> None:
        """Link points with their neighbours (collective)."""
        assert model.operator is not None
        self._comm = model.operator.comm
        layout = model.operator.layout.gathered(self._comm, everywhere=True)
        pairs = model.jointed.pairs.gathered(self._comm)
        facets = np.flatnonzero(pairs.joint == pairs.names.index(joint))
        number, corners = layout.number[facets], pairs.match.shape[1]
        own = model.V.tabulate_dof_coordinates()[model.nodes(group)]
        wet = np.concatenate(model.jointed.mesh.comm.allgather(own))
        near = SAME_PLACE * float(layout.sizes.min())
        if bool((layout.rule < 1e-9).any()):  # points on the edge of a facet: a nodal rule
            hubs: Ints = np.arange(len(facets))[:, None]
            here = layout.joint == pairs.names.index(joint)
            starts = here & _close(layout.points, wet, near)
            same = len(facets) + same_places(layout.points, near)[number][..., None]
        else:
            at = np.zeros((len(facets), corners, 3))
            at[..., : model.gdim] = pairs.nodes[facets, :corners]
            hubs = _edges(same_places(at.reshape(-1, 3), near).reshape(at.shape[:2]))
            same = None
            touching = _close(at.reshape(-1, 3), wet, near).reshape(at.shape[:2])
            starts = np.zeros(len(layout.areas), dtype=bool)
            starts[number[touching.sum(axis=1) >= model.gdim - 1]] = True
        if not starts.any():
            raise MeshError(f"The facet group {group!r} touches no point of the joint {joint!r}.")
        self._starts = starts
        shared = np.broadcast_to(hubs[:, None, :], (*number.shape, hubs.shape[1]))
        every = shared if same is None else np.concatenate([shared, same], axis=2)
        links = np.broadcast_arrays(number[:, :, None], every)
        self._point, self._hub = (each.ravel() for each in links)

    def reached(self, open_points: Mask) -> Mask:
        """Which of the local open points are reached (collective)."""
        parts = self._comm.allgather(open_points)
        every = np.concatenate(parts)
        first = sum(len(part) for part in parts[: self._comm.rank])
        return self._reached(every)[first : first + len(open_points)]

    def _reached(self, every: Mask) -> Mask:
        passable = every[self._point]
        count, hubs = len(every), int(self._hub.max()) + 1
        label = connected(self._point[passable], count + self._hub[passable], count + hubs)[:count]
        return np.asarray(every & np.isin(label, label[every & self._starts]))


def _close(points: Floats, places: Floats, near: float) -> Mask:
    """Which points lie at one of the places."""
    return np.asarray(KDTree(places).query(points)[0] <= near)


def _edges(vertices: Ints) -> Ints:
    """Numbers of the edges of facets (of the vertices in 2-D), shape (num_facets, edges)."""
    corners = vertices.shape[1]
    edges = np.array(basix.topology(facet_cell_type(corners))[min(1, corners - 2)])
    ends = np.sort(vertices[:, edges], axis=2)
    return np.unique(ends.reshape(-1, ends.shape[2]), axis=0, return_inverse=True)[1].reshape(
        ends.shape[:2]
    )
