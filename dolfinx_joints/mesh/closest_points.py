# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closest points of straight and curved facets, by a constrained Gauss-Newton method.

Distances are physical distances in metres. The unknowns are the reference coordinates of a facet,
so the result depends on neither the shape nor the size of the cell behind the facet.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
from scipy.spatial import KDTree

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.mesh.cells import Floats, Ints, lagrange
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type

# Samples along a side of a facet; the iteration starts from the nearest sample.
DIVISIONS = 4

# The iteration ends if a step is shorter than STEP times the facet's longest side plus STEP_FAR
# times the distance. At the minimum the distance is stationary: rounding halves the digits.
STEP, STEP_FAR = 1e-10, 1e-6

# Rounding error of a distance, relative to the sum of the coordinates and the distance.
ROUNDING = 1e-14

# If a facet's radius of curvature is at least ten times the distance, each iteration gains a digit.
# Points as far away as the radius of curvature need halved steps.
ITERATIONS, HALVINGS = 100, 12

# Two directions are parallel if determinant / trace^2 of the facet's metric is below this value.
SINGULAR = 1e-14


@dataclass(frozen=True, kw_only=True)
class ClosestPoints:
    """Points on facets that are closest to n given points.

    Attributes:
        facet: Facet number, the lowest if several facets are equally near, shape (n,).
        local: Reference coordinates on the facet, shape (n, dim of the facet).
        distance: Distance from the given point, shape (n,), [m].
        converged: False if the iteration did not reach a minimum, shape (n,).
    """

    facet: Ints
    local: Floats
    distance: Floats
    converged: Flags


def longest_sides(vertices: Floats) -> Floats:
    """Return the longest side of each facet, (facets,), from (facets, vertices, gdim), [m]."""
    ends = np.array(basix.topology(facet_cell_type(vertices.shape[1]))[1])
    sides = vertices[:, ends[:, 1]] - vertices[:, ends[:, 0]]
    return np.asarray(np.linalg.norm(sides, axis=2).max(axis=1))


class FacetSurface:
    """Facets of cells of degree 1 or 2: lines in 2-D or surfaces in 3-D.

    Args:
        x: Coordinates of the nodes of each facet in the order of its Lagrange element, shape
            (facets, nodes, gdim), [m].
        vertices: Number of vertices of a facet. The vertices are its first nodes.
        degree: Polynomial degree of the geometry.

    Attributes:
        sizes: Longest side of each facet, between vertices, shape (facets,), [m].
    """

    def __init__(self, x: Floats, vertices: int, degree: int) -> None:
        kind = facet_cell_type(vertices)
        # Geographic coordinates reach millions of metres: subtract the mean against rounding error.
        self._origin: Floats = x.reshape(-1, x.shape[2]).mean(axis=0)
        self._x, self._dim = x - self._origin, x.shape[2] - 1
        self._extent = float(np.abs(self._x).max())
        self._element = lagrange(kind, degree)
        self._edges: Floats = basix.geometry(kind)[np.array(basix.topology(kind)[1])]
        self.sizes: Floats = longest_sides(x[:, :vertices])
        lattice = basix.create_lattice(kind, DIVISIONS, basix.LatticeType.equispaced, True)
        self._lattice: Floats = lattice
        table = self._element.tabulate(1, lattice)[..., 0]
        samples = np.einsum("sk,fki->fsi", table[0], self._x)
        slopes = np.linalg.norm(np.einsum("dsk,fki->fsid", table[1:], x), axis=(2, 3)).max(axis=1)
        # The nearest sample is at most half the diagonal of a grid square away.
        reach = slopes * np.sqrt(self._dim) / (2 * DIVISIONS)
        # One tree per facet size, so that small facets are not searched with a large radius.
        octaves = np.floor(np.log2(np.maximum(reach, np.finfo(float).tiny)))
        self._trees = [
            (np.flatnonzero(octaves == n), KDTree(samples[octaves == n].reshape(-1, x.shape[2])))
            for n in np.unique(octaves)
        ]
        self._reach: Floats = reach

    def sample_distances(self, points: Floats) -> Floats:
        """Return the distance from each point (n, gdim) to the nearest sample, shape (n,), [m]."""
        return self._nearest(points - self._origin)

    def _nearest(self, points: Floats) -> Floats:
        return np.asarray(np.min([tree.query(points)[0] for _, tree in self._trees], axis=0))

    def shape_functions(self, local: Floats) -> Floats:
        """Return the nodal shape functions of a facet at reference coordinates, (n, nodes)."""
        return self._element.tabulate(0, local)[0, :, :, 0]

    def closest(self, points: Floats) -> ClosestPoints:
        """Return the points on the facets closest to given points, shape (n, gdim), [m]."""
        shifted = points - self._origin
        point, facet, start = self._candidates(shifted)
        local, distance, converged = self._project(shifted[point], facet, start)
        order = np.lexsort((distance, point))
        best = order[np.append(True, np.diff(point[order]) > 0)]
        return ClosestPoints(
            facet=facet[best], local=local[best], distance=distance[best], converged=converged[best]
        )

    def _candidates(self, points: Floats) -> tuple[Ints, Ints, Floats]:
        """Return candidate pairs (point, facet), with a starting point on each facet."""
        nearest = self._nearest(points)
        pairs = []
        for facets, tree in self._trees:
            radii = nearest + (1.0 + 1e-9) * self._reach[facets].max()
            lists = tree.query_ball_point(points, radii)
            point = np.repeat(np.arange(len(points)), [len(hits) for hits in lists])
            samples = np.concatenate([np.asarray(hits, dtype=np.int64) for hits in lists])
            place, sample = np.divmod(samples, len(self._lattice))
            dist = np.linalg.norm(points[point] - tree.data[samples], axis=1)
            pairs.append((point, facets[place], sample, dist))
        point, facet, sample, dist = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        order = np.lexsort((dist, facet, point))
        point, facet, sample = point[order], facet[order], sample[order]
        other = (np.diff(point) > 0) | (np.diff(facet) != 0)
        first = np.flatnonzero(np.append(True, other))
        return point[first], facet[first], self._lattice[sample[first]]

    def _project(self, points: Floats, facet: Ints, local: Floats) -> tuple[Floats, Floats, Flags]:
        """Return the closest point on one facet per point, the distance, and convergence flags."""
        local, distance = local.copy(), np.zeros(len(points))
        active = np.arange(len(points))
        for _ in range(ITERATIONS):
            table = self._element.tabulate(1, local[active])[..., 0]
            x = self._x[facet[active]]
            offset = points[active] - np.einsum("pk,pki->pi", table[0], x)
            jacobian = np.einsum("dpk,pki->pid", table[1:], x)
            distance[active] = np.linalg.norm(offset, axis=1)
            step = self._linear_minimum(jacobian, offset, local[active]) - local[active]
            length = np.linalg.norm(np.einsum("pid,pd->pi", jacobian, step), axis=1)
            tolerance = STEP * self.sizes[facet[active]] + STEP_FAR * distance[active]
            active, step = active[length > tolerance], step[length > tolerance]
            if not len(active):
                break
            local[active] = self._best_part(points[active], facet[active], local[active], step)
        converged = np.ones(len(points), dtype=bool)
        converged[active] = False
        return local, distance, converged

    def _best_part(self, points: Floats, facet: Ints, local: Floats, step: Floats) -> Floats:
        """Return the best point after the full step or after halved steps."""

        def distance(at: Floats, which: Ints) -> Floats:
            x = np.einsum("pk,pki->pi", self.shape_functions(at), self._x[facet[which]])
            return np.linalg.norm(points[which] - x, axis=1)

        which = np.arange(len(points))
        before, best = distance(local, which), local + step
        closest, rounding = distance(best, which), ROUNDING * (self._extent + before)
        for halving in range(1, HALVINGS + 1):
            shorter = local[which] + 0.5**halving * step[which]
            trial_distance = distance(shorter, which)
            better = trial_distance < (closest - rounding)[which]
            best[which[better]], closest[which[better]] = shorter[better], trial_distance[better]
            which = which[better | (closest > before + rounding)[which]]
            if not len(which):
                break
        farther = closest > before + rounding
        best[farther] = local[farther]
        return best

    def _linear_minimum(self, jacobian: Floats, offset: Floats, local: Floats) -> Floats:
        """Return the point in the reference facet that minimises |offset - J (point - local)|.

        If the unconstrained minimum is outside the facet, return the minimum on the edges.
        """
        least, place = np.full(len(local), np.inf), local.copy()
        for start, end in self._edges:
            from_start = offset - np.einsum("pid,pd->pi", jacobian, start - local)
            edge = jacobian @ (end - start)
            square = (edge**2).sum(axis=1)
            ratio = np.zeros(len(local))
            np.divide((edge * from_start).sum(axis=1), square, out=ratio, where=square > 0.0)
            share = np.clip(ratio, 0.0, 1.0)[:, None]
            residual = np.linalg.norm(from_start - share * edge, axis=1)
            nearer = residual < least
            least[nearer], place[nearer] = residual[nearer], (start + share * (end - start))[nearer]
        if self._dim == 2:
            a, b = jacobian[:, :, 0], jacobian[:, :, 1]
            aa, ab, bb = ((u * v).sum(axis=1) for u, v in ((a, a), (a, b), (b, b)))
            ar, br = (a * offset).sum(axis=1), (b * offset).sum(axis=1)
            determinant = aa * bb - ab**2
            regular = determinant > SINGULAR * (aa + bb) ** 2
            step = np.zeros_like(local)
            numerator = np.stack([bb * ar - ab * br, aa * br - ab * ar], axis=1)
            np.divide(numerator, determinant[:, None], out=step, where=regular[:, None])
            inner = local + step
            beyond = inner.sum(axis=1) if len(self._edges) == 3 else inner.max(axis=1)
            inside = regular & (inner.min(axis=1) >= 0.0) & (beyond <= 1.0)
            place[inside] = inner[inside]
        return place
