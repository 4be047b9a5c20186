# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A quarter of a thick ring with a joint around it, as arrays."""

import numpy as np

from dolfinx_joints.mesh.cells import CellShape

INSIDE, JOINT, OUTSIDE = 1.0, 2.0, 3.0  # radii [m]
HEIGHT = 0.5  # in 3-D, along z [m]

# Simplices of a box, by its corners; all boxes are divided along the same diagonals.
_SIMPLICES = {
    "triangle": [[0, 1, 3], [0, 2, 3]],
    "tetrahedron": [
        [0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]
    ],
}  # fmt: skip


def quarter_ring(cell, boxes, degree=2):
    """Return arguments of `mesh_from_arrays`, with ``boxes`` boxes across and around the wall.

    Facet groups are ``joint``, ``inside``, ``outside``, ``flat`` (y = 0), ``upright`` (x = 0), in
    3-D ``bottom`` and ``top``; the cells inside of the joint are the group ``core``.
    """
    shape = CellShape(name=cell, degree=degree)
    counts = degree * np.array([boxes, boxes, 1][: shape.dim])  # along radius, angle, height
    place = np.stack(np.meshgrid(*(np.arange(n + 1) for n in counts), indexing="ij"), axis=-1)
    number = np.arange(place[..., 0].size).reshape(counts + 1)
    place = place.reshape(-1, shape.dim)
    first = place[np.all((place % degree == 0) & (place < counts), axis=1)]
    cells = np.concatenate(
        [number[tuple(np.moveaxis(first[:, None] + own, -1, 0))] for own in nodes_of_boxes(shape)]
    )
    facets = cells[:, shape.facet_vertices].reshape(-1, shape.facet_vertices.shape[1])
    ends = {"inside": (0, 0), "joint": (0, counts[0] // 2), "outside": (0, counts[0])}
    ends |= {"flat": (1, 0), "upright": (1, counts[1]), "bottom": (2, 0), "top": (2, degree)}
    groups = {
        name: np.unique(np.sort(facets[np.all(place[facets, axis] == at, axis=1)]), axis=0)
        for name, (axis, at) in ends.items()
        if axis < shape.dim
    }
    radius = INSIDE + (OUTSIDE - INSIDE) * place[:, 0] / counts[0]
    angle = np.pi / 2 * place[:, 1] / counts[1]
    plane = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return {
        "cell": cell,
        "x": np.column_stack([plane, HEIGHT / degree * place[:, 2:]]),
        "cells": cells,
        "facet_groups": groups,
        "cell_groups": {"core": np.flatnonzero(radius[cells].max(axis=1) < JOINT + 1e-9)},
    }


def nodes_of_boxes(shape):
    """Return integer coordinates of the nodes of the cells in a box of width ``degree``."""
    dim, points = shape.dim, shape.element().points
    corners = np.array([[(c >> k) & 1 for k in range(dim)] for c in range(2**dim)])
    if shape.name in _SIMPLICES:
        weights = np.column_stack([1.0 - points.sum(axis=1), points])
        parts = corners[_SIMPLICES[shape.name]]
    else:
        weights, parts = points, np.eye(dim, dtype=int)[None]
    return np.rint(shape.degree * weights @ parts).astype(int)
