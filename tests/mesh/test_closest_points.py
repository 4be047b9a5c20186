# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closest points of facets.

Expected: a point at a small distance along the normal of a surface has its foot as closest point;
elsewhere the distance is that of a flat square, or that of the nearest of many points on the facet.
"""

import itertools

import basix
import numpy as np
import pytest

from dolfinx_joints.mesh import closest_points
from dolfinx_joints.mesh.closest_points import FacetSurface

KINDS = {2: basix.CellType.interval, 3: basix.CellType.triangle, 4: basix.CellType.quadrilateral}
FACETS = [(vertices, degree) for vertices in KINDS for degree in (1, 2)]


def element(vertices, degree):
    return basix.create_element(
        basix.ElementFamily.P, KINDS[vertices], degree, basix.LagrangeVariant.gll_warped
    )


def bent(reference):
    """A surface over a plane (n, 2), or a curve over a line (n, 1), about 3 m large."""
    height = 0.3 * np.sin(1.1 * reference).sum(axis=1) + 0.2 * reference.prod(axis=1)
    return np.column_stack([3.0 * reference, height])


def patch(vertices, degree, cells=4):
    """Nodes of facets that cover the surface over the unit square, or the unit interval."""
    nodes = element(vertices, degree).points
    steps = np.arange(cells) / cells
    corners = np.stack(np.meshgrid(*[steps] * nodes.shape[1], indexing="ij"), axis=-1)
    corners = corners.reshape(-1, 1, nodes.shape[1])
    facets = corners + nodes / cells
    if vertices == 3:
        facets = np.concatenate([facets, corners + (1.0 - nodes) / cells])
    return np.array([bent(each) for each in facets])


def on_facets(vertices, degree, x, count):
    """Random facets and local places, their points, and unit normals there."""
    rng = np.random.default_rng(3)
    facet = rng.integers(len(x), size=count)
    local = rng.uniform(size=(count, x.shape[2] - 1))
    if vertices == 3:
        outside = local.sum(axis=1) > 1.0
        local[outside] = 1.0 - local[outside]
    middle = 1 / 3 if vertices == 3 else 1 / 2
    local = middle + 0.9 * (local - middle)  # at a kink the facet beside may be nearer
    table = element(vertices, degree).tabulate(1, local)[..., 0]
    places = np.einsum("nk,nki->ni", table[0], x[facet])
    tangents = np.einsum("dnk,nki->nid", table[1:], x[facet])
    if vertices == 2:
        normals = tangents[:, ::-1, 0] * [1.0, -1.0]
    else:
        normals = np.cross(tangents[..., 0], tangents[..., 1])
    return facet, local, places, normals / np.linalg.norm(normals, axis=1)[:, None]


@pytest.mark.parametrize("origin", [0.0, 5e6])
@pytest.mark.parametrize("distance", [0.0, 0.03, -0.03])
@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_foot_of_a_normal(vertices, degree, distance, origin):
    """Among facets of a bent surface; coordinates of maps have seven digits before the point."""
    x = patch(vertices, degree) + origin
    facet, local, places, normals = on_facets(vertices, degree, x, 400)
    found = FacetSurface(x, vertices, degree).closest(places + distance * normals)
    near = np.finfo(float).eps * origin  # rounding of the points given
    assert found.converged.all()
    np.testing.assert_allclose(found.distance, abs(distance), atol=1e-9 + 10 * near)
    np.testing.assert_array_equal(found.facet, facet)
    np.testing.assert_allclose(found.local, local, atol=1e-7 + 100 * near)


@pytest.mark.parametrize("vertices", [3, 4])
def test_distance_of_a_square_in_space(vertices):
    """Inside, beyond its sides and corners, however far."""
    square = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]])
    x = square[None] if vertices == 4 else square[[[0, 1, 2], [3, 1, 2]]]
    points = np.random.default_rng(1).uniform(-30.0, 30.0, (500, 3))
    points[:250] /= 10.0
    exact = np.linalg.norm(points - np.clip(points, 0.0, [2.0, 2.0, 0.0]), axis=1)
    found = FacetSurface(x, vertices, 1).closest(points)
    np.testing.assert_allclose(found.distance, exact, atol=1e-12)


@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_no_place_on_the_facets_is_nearer(vertices, degree):
    """Points up to twice the surface's size away; feet on sides, corners and inside."""
    x = patch(vertices, degree, cells=2)
    lattice = basix.create_lattice(KINDS[vertices], 100, basix.LatticeType.equispaced, True)
    table = element(vertices, degree).tabulate(0, lattice)[0, :, :, 0]
    places = np.einsum("sk,fki->fsi", table, x).reshape(-1, x.shape[2])
    points = np.random.default_rng(2).uniform(-6.0, 9.0, (100, x.shape[2]))
    nearest = np.linalg.norm(points[:, None] - places, axis=2).min(axis=1)
    found = FacetSurface(x, vertices, degree).closest(points)
    assert found.converged.all()
    assert np.all(found.distance <= nearest + 1e-9)
    assert np.all(found.distance >= nearest - 0.03)  # places are 0.015 m apart, 0.03 m across


def test_large_facet_beside_small_ones():
    """A point on the large one, nearer to all samples of the small ones than to its own."""
    steps = np.linspace(0.0, 0.5, 51)
    small = np.array([[[a, 0.0], [b, 0.0]] for a, b in itertools.pairwise(steps)])
    x = np.concatenate([small, [[[0.5, 0.0], [100.5, 0.0]]]])
    found = FacetSurface(x, 2, 1).closest(np.array([[2.5, 0.1], [0.25, 0.01]]))
    np.testing.assert_allclose(found.distance, [0.1, 0.01])
    assert found.facet[0] == 50
    np.testing.assert_allclose(found.local[0], 0.02)


def test_a_search_that_does_not_end_is_reported(monkeypatch):
    monkeypatch.setattr(closest_points, "ITERATIONS", 1)
    x = patch(4, 2, cells=1)
    found = FacetSurface(x, 4, 2).closest(np.array([[1.1, 0.7, 1.0]]))
    assert not found.converged.any()
    assert found.distance[0] > 0.0
