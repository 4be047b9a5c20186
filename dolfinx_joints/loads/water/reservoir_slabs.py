# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water behind a face made of lines or triangles: a stack of slabs, each the face moved upstream.

With oblique coordinates (place on the face, way s upstream) all slabs have the same matrix. Two of
them, or two stacks, make one of twice the length by eliminating the nodes between them: ten to
twenty doublings reach from a tenth of a cell to where the pressure has died away, and what is left
is a matrix over the nodes of the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import coo_array

from dolfinx_joints.mesh.blocks import connected
from dolfinx_joints.mesh.cells import Floats, Ints

# Thickness of the first slab, of the mean edge of the face: its error is far below the face's own.
THINNEST = 0.1

# What reaches through a stack of slabs, of what stays at its ends, where it counts as endless.
ENDLESS = 1e-14

# Number of a corner at the level, which is none of the whole.
SURFACE = -1


@dataclass(frozen=True, kw_only=True)
class WaterFace:
    """A face of water made of lines (in 2-D) or triangles.

    Attributes:
        below: Number of its nodes below the level; the others are on it.
        count: Number of nodes with a pressure: those below the level, or all.
        nodes: Nodes of the parts, shape (parts, gdim).
        corners: Coordinates of these nodes, shape (parts, gdim, gdim), [m].
    """

    below: int
    count: int
    nodes: Ints
    corners: Floats

    def matrix(self, nodes: Ints, elements: Floats) -> coo_array:
        """The matrix of elements, shape (n, k, k), of their nodes with a pressure, shape (n, k)."""
        rows = np.broadcast_to(nodes[:, :, None], elements.shape)
        columns = np.broadcast_to(nodes[:, None, :], elements.shape)
        kept = (rows < self.count) & (columns < self.count)
        entries = (elements[kept], (rows[kept], columns[kept]))
        return coo_array(entries, shape=(self.count, self.count))


def clipped(depths: Floats) -> tuple[Ints, Floats, Ints]:
    """The parts of lines or triangles below the level.

    Args:
        depths: Of the corners, shape (n, corners), [m]; a corner of exactly zero is on the level.

    Returns:
        Which line or triangle each part is of, shape (parts,); barycentric coordinates of the
        part's corners, shape (parts, corners, corners); and which corner of the whole each of them
        is, `SURFACE` for those on the level, shape (parts, corners).
    """
    count = depths.shape[1]
    deepest_first = np.argsort(-depths, axis=1, kind="stable")
    below = (depths > 0.0).sum(axis=1)
    whole, places, corners = [], [], []
    for wet in range(1, count + 1):
        chosen = np.flatnonzero(below == wet)
        order = deepest_first[chosen]
        sorted_depths = np.take_along_axis(depths[chosen], order, axis=1)
        cuts = np.zeros((len(chosen), count, count, count))
        for a in range(wet):
            for b in range(wet, count):
                share = sorted_depths[:, a] / (sorted_depths[:, a] - sorted_depths[:, b])
                cuts[:, a, b, a], cuts[:, a, b, b] = 1.0 - share, share
        for a in range(count):
            cuts[:, a, a, a] = 1.0
        for part in _PARTS[count][wet]:
            sorted_places = np.stack([cuts[:, a, b] for a, b in part], axis=1)
            place = np.empty_like(sorted_places)
            np.put_along_axis(place, order[:, None, :].repeat(count, 1), sorted_places, 2)
            corner = [order[:, a] if a == b else np.full(len(order), SURFACE) for a, b in part]
            whole.append(chosen)
            places.append(place)
            corners.append(np.stack(corner, axis=1))
    return np.concatenate(whole), np.concatenate(places), np.concatenate(corners)


# Corners of the parts below the level, by the number of corners of the whole and of those that are
# wet: (a, a) is the a-th deepest corner, (a, b) where the level cuts the edge between two.
_PARTS: dict[int, dict[int, list[list[tuple[int, int]]]]] = {
    2: {1: [[(0, 0), (0, 1)]], 2: [[(0, 0), (1, 1)]]},
    3: {
        1: [[(0, 0), (0, 1), (0, 2)]],
        2: [[(0, 0), (1, 1), (1, 2)], [(0, 0), (1, 2), (0, 2)]],
        3: [[(0, 0), (1, 1), (2, 2)]],
    },
}


def lidded(face: WaterFace) -> int:
    """Number of the face's separate regions that do not reach the level, so have no solution."""
    ends = np.minimum(face.nodes, face.below)
    return int(connected(np.repeat(ends[:, 0], ends.shape[1]), ends.ravel(), face.below + 1).max())


def resistance(
    face: WaterFace, upstream: Floats, length: float | None, wavenumber: float = 0.0
) -> Floats:
    """The energy of water in motion by the pressures p at its face, S in 1/2 p S p.

    Per density and with the pressure as potential: S p are the fluxes of grad p into the water.

    Args:
        face: The face; each of its regions reaches the level.
        upstream: Unit vector, horizontal, shape (gdim,).
        length: Where a rigid wall ends the water [m]; None for endless water.
        wavenumber: Of sound at the frequency of the motion [1/m]; zero for incompressible water.

    Returns:
        Shape (count, count), [m] in space, [-] in the plane; symmetric, positive definite.
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
    near = in_face * (thickness / 3) - even + across / thickness
    far = in_face * (thickness / 3) + even + across / thickness
    between = in_face * (thickness / 6) + odd - across / thickness
    done = 0
    while done != doublings and (
        doublings is not None or np.abs(between).max() > ENDLESS * np.abs(near).max()
    ):
        near, between, far = _doubled(near, between, far)
        done += 1
    if length is None:
        return near
    half = half_of_inverse(far, between.T)
    return near - half.T @ half


def half_of_inverse(matrix: Floats, right: Floats) -> Floats:
    """Y with Y^T Y = R^T S^-1 R for S symmetric, positive definite."""
    return solve_triangular(cholesky(matrix, lower=True), right, lower=True)


def _doubled(near: Floats, between: Floats, far: Floats) -> tuple[Floats, Floats, Floats]:
    """Matrix of two equal stacks of slabs behind each other, over the nodes at their ends."""
    lower = cholesky(near + far, lower=True)
    back, forth = (solve_triangular(lower, b, lower=True) for b in (between.T, between))
    return near - back.T @ back, -back.T @ forth, far - forth.T @ forth


def face_matrices(face: WaterFace, upstream: Floats) -> list[coo_array]:
    """Integrals per length of water: p A p + 2 p B p' + p' C p' of grad p squared, p D p of p.

    D is also the mass matrix of the face as seen from upstream.
    """
    corners = face.corners
    axes = corners.shape[2]
    sides = corners[:, 1:] - corners[:, :1]
    jacobian = np.concatenate([sides, np.broadcast_to(upstream, (len(sides), 1, axes))], axis=1)
    # Columns of the inverse are the gradients of the coordinates.
    gradients = np.linalg.inv(jacobian)
    slopes = np.concatenate(
        [-gradients[:, :, :-1].sum(axis=2, keepdims=True), gradients[:, :, :-1]], axis=2
    )
    along = gradients[:, :, -1]
    volume = np.abs(np.linalg.det(jacobian)) / (1 if axes == 2 else 2)
    same = (np.ones((axes, axes)) + np.eye(axes)) / (axes * (axes + 1))
    in_face = np.einsum("t,tdi,tdj->tij", volume, slopes, slopes)
    mixed = np.einsum("t,tdi,td->ti", volume / axes, slopes, along)
    mass = np.einsum("t,ij->tij", volume, same)
    across = np.einsum("td,td,tij->tij", along, along, mass)
    each = (in_face, np.repeat(mixed[:, :, None], axes, axis=2), across, mass)
    return [face.matrix(face.nodes, elements) for elements in each]
