# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A curved surface laid flat, such as the joint between a dam and its valley."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints

_SAME = 1e-6  # of the size: nearer points are one


class Unrolled(NamedTuple):
    """A surface laid flat.

    Attributes:
        corners: of the facets in the plane, shape (facets, 3 or 4, 2), [m].
        upright: whether the ordinate is upwards, as in a wall. Else upstream is above, and the
            abscissa goes from the right bank to the left one.
    """

    corners: Floats
    upright: bool


def unrolled(corners: Floats, normals: Floats) -> Unrolled | None:
    """Facets laid flat so that all angles are kept as well as they can, and the area in all.

    A surface that is bent in one direction keeps all lengths. It is the least-squares conformal
    map: each triangle wants to be turned and scaled alone.

    Args:
        corners: of the facets in cyclic order, shape (facets, 3 or 4, 3), [m].
        normals: of the facets, all to the same side, shape (facets, 3).

    Returns:
        None where the surface has several parts or closes on itself.
    """
    points, number = _vertices(corners)
    triangles, flat = _triangles(corners, number, normals)
    if _parts(triangles, len(points)) > 1:
        return None
    laid = _conformal(triangles, flat, points)
    areas, laid_areas = _doubled_areas(flat), _doubled_areas(laid[triangles])
    if np.any(areas * laid_areas <= 0.0):
        return None
    laid *= np.sqrt(np.abs(areas).sum() / np.abs(laid_areas).sum())
    placed, upright = _placed(laid, points)
    return Unrolled(placed[number], upright)


def tangent_axes(corners: Floats) -> Floats:
    """Two orthonormal vectors in each facet, shape (facets, 2, 3), of its corners in cyclic order.

    The mean plane of a facet whose corners are not in one.
    """
    first = corners[:, 1] - corners[:, 0]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    first = first - normal * (np.sum(first * normal, axis=1) / np.sum(normal**2, axis=1))[:, None]
    second = np.cross(normal, first)
    axes = np.stack([first, second], axis=1)
    return axes / np.linalg.norm(axes, axis=2, keepdims=True)


def _vertices(corners: Floats) -> tuple[Floats, Ints]:
    """Distinct points (n, 3), and the number of each corner."""
    flat = corners.reshape(-1, 3)
    grid = np.round(flat / (_SAME * np.ptp(flat, axis=0).max()))
    _, first, number = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return flat[first], number.reshape(corners.shape[:2])


def _triangles(corners: Floats, number: Ints, normals: Floats) -> tuple[Ints, Floats]:
    """Points of triangles (t, 3), and their corners in their planes (t, 3, 2).

    All are seen from the same side of the surface.
    """
    parts = [[0, 1, 2]] if corners.shape[1] == 3 else [[0, 1, 2], [0, 2, 3]]
    vertices = np.concatenate([number[:, part] for part in parts])
    places = np.concatenate([corners[:, part] for part in parts])
    axes = tangent_axes(places)
    flat = np.einsum("tci,tki->tck", places, axes)
    below = np.sum(np.cross(axes[:, 0], axes[:, 1]) * np.tile(normals, (len(parts), 1)), axis=1) < 0
    flat[below, :, 1] *= -1.0
    return vertices, flat


def _parts(triangles: Ints, count: int) -> int:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows, columns = triangles.ravel(), np.roll(triangles, 1, axis=1).ravel()
    graph = coo_array((np.ones(rows.size), (rows, columns)), shape=(count, count))
    return int(connected_components(graph, directed=False, return_labels=False))


def _conformal(triangles: Ints, flat: Floats, points: Floats) -> Floats:
    """Places of the points in the plane, two far ones of them at their distance, shape (n, 2)."""
    from scipy.sparse import bmat, coo_array
    from scipy.sparse.linalg import spsolve

    one = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    other = int(np.argmax(np.linalg.norm(points - points[one], axis=1)))
    edges = np.roll(flat, 1, axis=1) - np.roll(flat, -1, axis=1)  # opposite to each corner
    edges /= np.sqrt(np.abs(_doubled_areas(flat)))[:, None, None]
    rows = np.repeat(np.arange(len(triangles)), 3)
    shape = (len(triangles), len(points))
    real, imaginary = (
        coo_array((edges[..., k].ravel(), (rows, triangles.ravel())), shape=shape) for k in (0, 1)
    )
    system = bmat([[real, -imaginary], [imaginary, real]], format="csc")
    count = len(points)
    pins = np.array([one, other, one + count, other + count])
    values = np.array([0.0, np.linalg.norm(points[other] - points[one]), 0.0, 0.0])
    free = np.setdiff1d(np.arange(2 * count), pins)
    found = np.zeros(2 * count)
    found[pins] = values
    matrix = system[:, free]
    found[free] = spsolve((matrix.T @ matrix).tocsc(), -matrix.T @ (system[:, pins] @ values))
    return found.reshape(2, count).T


def _placed(laid: Floats, points: Floats) -> tuple[Floats, bool]:
    """The same turned or mirrored, from (0, 0), and whether the ordinate is upwards.

    Upwards if the height grows evenly in the plane, else upstream. The abscissa of the first
    grows downstream, that of the other to the left bank.
    """
    centred, places = laid - laid.mean(axis=0), points - points.mean(axis=0)
    slope, *_ = np.linalg.lstsq(centred, places, rcond=None)  # (2, 3), by x, y, z
    unexplained = np.sum((places - centred @ slope) ** 2, axis=0) / np.sum(centred**2)
    upright = bool(unexplained[2] <= unexplained[0])
    up = slope[:, 2] if upright else -slope[:, 0]
    up = up / np.linalg.norm(up)
    right = np.array([up[1], -up[0]])
    if right @ slope[:, 0 if upright else 1] < 0.0:
        right = -right
    placed = centred @ np.stack([right, up], axis=1)
    return placed - placed.min(axis=0), upright


def _doubled_areas(triangles: Floats) -> Floats:
    """Twice the areas of triangles in the plane (t, 3, 2), negative of clockwise ones."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
