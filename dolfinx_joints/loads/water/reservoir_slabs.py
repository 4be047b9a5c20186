# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water upstream of a face of lines or triangles, as a stack of slabs of extruded face elements.

In oblique coordinates (position on the face, distance s upstream) all slabs have the same matrix.
Eliminating the nodes between two equal stacks doubles the length. The pressure has decayed after 10
to 20 doublings. The result is a matrix for the nodes of the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import coo_array

from dolfinx_joints.mesh.blocks import connected
from dolfinx_joints.mesh.cells import Floats, Ints

# Thickness of the first slab relative to the mean edge of the face, whose error is far larger.
THINNEST = 0.1

# Ratio of a stack's coupling to its end matrix, below which the stack counts as infinite.
ENDLESS = 1e-14

# Number of a corner on the level, which is not a corner of the uncut line or triangle.
SURFACE = -1


@dataclass(frozen=True, kw_only=True)
class WaterFace:
    """Face of the water, made of lines (in 2-D) or triangles.

    Attributes:
        below: Number of nodes below the level; the other nodes are on the level.
        count: Number of nodes with a pressure: nodes below the level, or all nodes.
        nodes: Nodes of the parts, shape (parts, gdim).
        corners: Coordinates of these nodes, shape (parts, gdim, gdim), [m].
    """

    below: int
    count: int
    nodes: Ints
    corners: Floats

    def matrix(self, nodes: Ints, elements: Floats) -> coo_array:
        """Assemble element matrices (n, k, k) at ``nodes`` (n, k); omit nodes without pressure."""
        rows = np.broadcast_to(nodes[:, :, None], elements.shape)
        columns = np.broadcast_to(nodes[:, None, :], elements.shape)
        has_pressure = (rows < self.count) & (columns < self.count)
        entries = (elements[has_pressure], (rows[has_pressure], columns[has_pressure]))
        return coo_array(entries, shape=(self.count, self.count))


def cut_at_level(depths: Floats) -> tuple[Ints, Floats, Ints]:
    """Cut lines or triangles at the level and return the parts below it.

    Args:
        depths: Depths of the corners, shape (n, corners), [m]; exactly zero on the level.

    Returns:
        Line or triangle of each part, shape (parts,); barycentric coordinates of the corners of the
        parts, shape (parts, corners, corners); corner of the uncut line or triangle, `SURFACE` for
        corners on the level, shape (parts, corners).
    """
    count = depths.shape[1]
    deepest_first = np.argsort(-depths, axis=1, kind="stable")
    below = (depths > 0.0).sum(axis=1)
    uncut, places, corners = [], [], []
    for wet_corners in range(1, count + 1):
        chosen = np.flatnonzero(below == wet_corners)
        order = deepest_first[chosen]
        sorted_depths = np.take_along_axis(depths[chosen], order, axis=1)
        cuts = np.zeros((len(chosen), count, count, count))
        for a in range(wet_corners):
            for b in range(wet_corners, count):
                share = sorted_depths[:, a] / (sorted_depths[:, a] - sorted_depths[:, b])
                cuts[:, a, b, a], cuts[:, a, b, b] = 1.0 - share, share
        for a in range(count):
            cuts[:, a, a, a] = 1.0
        for part in _PARTS[count][wet_corners]:
            sorted_places = np.stack([cuts[:, a, b] for a, b in part], axis=1)
            place = np.empty_like(sorted_places)
            np.put_along_axis(place, order[:, None, :].repeat(count, 1), sorted_places, 2)
            corner = [order[:, a] if a == b else np.full(len(order), SURFACE) for a, b in part]
            uncut.append(chosen)
            places.append(place)
            corners.append(np.stack(corner, axis=1))
    return np.concatenate(uncut), np.concatenate(places), np.concatenate(corners)


# Corners of the parts below the level, by number of corners and number of wet corners: (a, a) is
# the a-th deepest corner, (a, b) is the point where the level cuts the edge between a and b.
_PARTS: dict[int, dict[int, list[list[tuple[int, int]]]]] = {
    2: {1: [[(0, 0), (0, 1)]], 2: [[(0, 0), (1, 1)]]},
    3: {
        1: [[(0, 0), (0, 1), (0, 2)]],
        2: [[(0, 0), (1, 1), (1, 2)], [(0, 0), (1, 2), (0, 2)]],
        3: [[(0, 0), (1, 1), (2, 2)]],
    },
}


def regions_below_level(face: WaterFace) -> int:
    """Count the regions of the face that do not reach the level, where p is undetermined."""
    ends = np.minimum(face.nodes, face.below)
    return int(connected(np.repeat(ends[:, 0], ends.shape[1]), ends.ravel(), face.below + 1).max())


def resistance(
    face: WaterFace, upstream: Floats, length: float | None, wavenumber: float = 0.0
) -> Floats:
    """Compute S, where p S p is the integral of (grad p)^2 - k^2 p^2 for pressures p at the face.

    The wavenumber k is zero for incompressible water. S p is the flux of grad p at the face.

    Args:
        face: The face; each of its regions must reach the level.
        upstream: Horizontal unit vector, shape (gdim,).
        length: Length of the water up to a rigid wall [m]; None for infinite length.
        wavenumber: Wavenumber of sound at the frequency [1/m]; zero for incompressible water.

    Returns:
        Shape (count, count), [m], in 2-D [-]; symmetric, positive definite.
    """
    in_face, mixed, across, mass = (m.toarray() for m in face_matrices(face, upstream))
    in_face -= wavenumber**2 * mass
    edges = np.linalg.norm(face.corners - np.roll(face.corners, 1, axis=1), axis=2)
    thickness = THINNEST * float(edges.mean())
    doublings = None
    if length is not None:
        doublings = max(0, int(np.ceil(np.log2(length / thickness))))
        thickness = length / 2**doublings
    even, odd = (mixed + mixed.T) / 2, (mixed - mixed.T) / 2
    at_face = in_face * (thickness / 3) - even + across / thickness
    at_end = in_face * (thickness / 3) + even + across / thickness
    coupling = in_face * (thickness / 6) + odd - across / thickness
    doubled_times = 0
    while doubled_times != doublings and (
        doublings is not None or np.abs(coupling).max() > ENDLESS * np.abs(at_face).max()
    ):
        at_face, coupling, at_end = _double(at_face, coupling, at_end)
        doubled_times += 1
    if length is None:
        return at_face
    half = half_of_inverse(at_end, coupling.T)
    return at_face - half.T @ half


def half_of_inverse(matrix: Floats, columns: Floats) -> Floats:
    """Return Y with Y^T Y = R^T S^-1 R for the columns R and the positive definite matrix S."""
    return solve_triangular(cholesky(matrix, lower=True), columns, lower=True)


def _double(at_face: Floats, coupling: Floats, at_end: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the matrix of two equal stacks in series, for the nodes at both ends."""
    lower = cholesky(at_face + at_end, lower=True)
    back, forth = (solve_triangular(lower, b, lower=True) for b in (coupling.T, coupling))
    return at_face - back.T @ back, -back.T @ forth, at_end - forth.T @ forth


def face_matrices(face: WaterFace, upstream: Floats) -> list[coo_array]:
    """Return the matrices A, B, C and D of a face, per length of water.

    The integral of (grad p)^2 is p A p + 2 p B p' + p' C p', with p' the derivative along upstream.
    The integral of p^2 is p D p; D is also the mass matrix of the face projected along upstream.
    """
    corners = face.corners
    axes = corners.shape[2]
    sides = corners[:, 1:] - corners[:, :1]
    jacobian = np.concatenate([sides, np.broadcast_to(upstream, (len(sides), 1, axes))], axis=1)
    # Columns of the inverse are the gradients of the oblique coordinates.
    gradients = np.linalg.inv(jacobian)
    slopes = np.concatenate(
        [-gradients[:, :, :-1].sum(axis=2, keepdims=True), gradients[:, :, :-1]], axis=2
    )
    along = gradients[:, :, -1]
    volume = np.abs(np.linalg.det(jacobian)) / (1 if axes == 2 else 2)
    mass_pattern = (np.ones((axes, axes)) + np.eye(axes)) / (axes * (axes + 1))
    in_face = np.einsum("t,tdi,tdj->tij", volume, slopes, slopes)
    mixed = np.einsum("t,tdi,td->ti", volume / axes, slopes, along)
    mass = np.einsum("t,ij->tij", volume, mass_pattern)
    across = np.einsum("td,td,tij->tij", along, along, mass)
    matrices = (in_face, np.repeat(mixed[:, :, None], axes, axis=2), across, mass)
    return [face.matrix(face.nodes, elements) for elements in matrices]
