# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unrolling of a curved surface into a plane, such as the joint between a dam and its valley."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints

_SAME = 1e-6  # distance of points to merge, divided by the size of the surface


class Unrolled(NamedTuple):
    """Surface unrolled into a plane.

    Attributes:
        corners: Corners of the facets in the plane, shape (facets, 3 or 4, 2), [m].
        upright: True if the ordinate points upwards, as for a wall. Otherwise the ordinate points
            upstream, and the abscissa from the right bank to the left bank.
    """

    corners: Floats
    upright: bool


def unrolled(corners: Floats, normals: Floats) -> Unrolled | None:
    """Unroll facets into a plane by the least-squares conformal map.

    The map of each triangle is as close as possible to a rotation and a scaling, which preserves
    angles. The total area is preserved. A surface curved in one direction keeps all lengths.

    Args:
        corners: Corners of the facets in cyclic order, shape (facets, 3 or 4, 3), [m].
        normals: Normals of the facets, all to the same side, shape (facets, 3).

    Returns:
        The plane surface; None for several parts, or if the map folds, as for a closed surface.
    """
    points, number = _vertices(corners)
    triangles, flat = _triangles(corners, number, normals)
    if _count_parts(triangles, len(points)) > 1:
        return None
    plane_points = _conformal_map(triangles, flat, points)
    areas, plane_areas = _doubled_areas(flat), _doubled_areas(plane_points[triangles])
    if np.any(areas * plane_areas <= 0.0):
        return None
    plane_points *= np.sqrt(np.abs(areas).sum() / np.abs(plane_areas).sum())
    placed, upright = _orient(plane_points, points)
    return Unrolled(placed[number], upright)


def tangent_axes(corners: Floats) -> Floats:
    """Return two orthonormal vectors in each facet, shape (facets, 2, 3).

    Corners are in cyclic order. For a warped facet the vectors are in its mean plane.
    """
    first = corners[:, 1] - corners[:, 0]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    first = first - normal * (np.sum(first * normal, axis=1) / np.sum(normal**2, axis=1))[:, None]
    second = np.cross(normal, first)
    axes = np.stack([first, second], axis=1)
    return axes / np.linalg.norm(axes, axis=2, keepdims=True)


def _vertices(corners: Floats) -> tuple[Floats, Ints]:
    """Return distinct points (n, 3), and the point number of each corner."""
    flat = corners.reshape(-1, 3)
    grid = np.round(flat / (_SAME * np.ptp(flat, axis=0).max()))
    _, first, number = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return flat[first], number.reshape(corners.shape[:2])


def _triangles(corners: Floats, number: Ints, normals: Floats) -> tuple[Ints, Floats]:
    """Return point numbers of triangles (t, 3), and their corners in their planes (t, 3, 2).

    All triangles are viewed from the same side of the surface.
    """
    parts = [[0, 1, 2]] if corners.shape[1] == 3 else [[0, 1, 2], [0, 2, 3]]
    vertices = np.concatenate([number[:, part] for part in parts])
    places = np.concatenate([corners[:, part] for part in parts])
    axes = tangent_axes(places)
    flat = np.einsum("tci,tki->tck", places, axes)
    below = np.sum(np.cross(axes[:, 0], axes[:, 1]) * np.tile(normals, (len(parts), 1)), axis=1) < 0
    flat[below, :, 1] *= -1.0
    return vertices, flat


def _count_parts(triangles: Ints, count: int) -> int:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows, columns = triangles.ravel(), np.roll(triangles, 1, axis=1).ravel()
    graph = coo_array((np.ones(rows.size), (rows, columns)), shape=(count, count))
    return int(connected_components(graph, directed=False, return_labels=False))


def _conformal_map(triangles: Ints, flat: Floats, points: Floats) -> Floats:
    """Return the points mapped to the plane, (n, 2); two distant points are fixed."""
    from scipy.sparse import bmat, coo_array
    from scipy.sparse.linalg import spsolve

    first_pin = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    second_pin = int(np.argmax(np.linalg.norm(points - points[first_pin], axis=1)))
    edges = np.roll(flat, 1, axis=1) - np.roll(flat, -1, axis=1)  # edge opposite to each corner
    edges /= np.sqrt(np.abs(_doubled_areas(flat)))[:, None, None]
    rows = np.repeat(np.arange(len(triangles)), 3)
    shape = (len(triangles), len(points))
    real, imaginary = (
        coo_array((edges[..., k].ravel(), (rows, triangles.ravel())), shape=shape) for k in (0, 1)
    )
    system = bmat([[real, -imaginary], [imaginary, real]], format="csc")
    count = len(points)
    pins = np.array([first_pin, second_pin, first_pin + count, second_pin + count])
    values = np.array([0.0, np.linalg.norm(points[second_pin] - points[first_pin]), 0.0, 0.0])
    free = np.setdiff1d(np.arange(2 * count), pins)
    places = np.zeros(2 * count)
    places[pins] = values
    matrix = system[:, free]
    places[free] = spsolve((matrix.T @ matrix).tocsc(), -matrix.T @ (system[:, pins] @ values))
    return places.reshape(2, count).T


def _orient(plane_points: Floats, points: Floats) -> tuple[Floats, bool]:
    """Return the points rotated or mirrored in the plane, with minima at 0, and ``upright``.

    The ordinate points upwards if a linear function in the plane fits the elevation better than the
    stream coordinate; the abscissa then points downstream. Otherwise the ordinate points upstream,
    the abscissa to the left bank.
    """
    centred, places = plane_points - plane_points.mean(axis=0), points - points.mean(axis=0)
    slope, *_ = np.linalg.lstsq(centred, places, rcond=None)  # rows: plane axes, columns: x, y, z
    unexplained = np.sum((places - centred @ slope) ** 2, axis=0) / np.sum(centred**2)
    upright = bool(unexplained[2] <= unexplained[0])
    up = slope[:, 2] if upright else -slope[:, 0]
    up = up / np.linalg.norm(up)
    across = np.array([up[1], -up[0]])
    if across @ slope[:, 0 if upright else 1] < 0.0:
        across = -across
    placed = centred @ np.stack([across, up], axis=1)
    return placed - placed.min(axis=0), upright


def _doubled_areas(triangles: Floats) -> Floats:
    """Return twice the areas of triangles in the plane (t, 3, 2), negative if clockwise."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
