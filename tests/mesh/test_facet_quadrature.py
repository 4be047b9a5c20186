# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rules on the reference facets: [0, 1], the unit triangle, the unit square.

Exact integrals: x^a y^b over the square is 1/((a + 1)(b + 1)), over the triangle
a! b!/(a + b + 2)!, x^a over the line 1/(a + 1).
"""

import itertools
from math import factorial

import numpy as np
import pytest

pytest.importorskip("basix")

import basix

from dolfinx_joints.mesh.facet_quadrature import GAUSS_DEGREES, facet_cell_type, facet_rule

FACETS = [(vertices, degree) for vertices in (2, 3, 4) for degree in (1, 2)]
AREA = {2: 1.0, 3: 0.5, 4: 1.0}
# Trapezoidal rule and vertex rule: 1; Simpson: 3; the mid-side rule of the triangle: 2.
NODAL_DEGREE = {(2, 1): 1, (3, 1): 1, (4, 1): 1, (2, 2): 3, (3, 2): 2, (4, 2): 3}


def integral(vertices: int, powers: tuple[int, ...]) -> float:
    """Exact integral of a monomial."""
    if vertices == 3:
        a, b = powers
        return factorial(a) * factorial(b) / factorial(a + b + 2)
    return float(np.prod([1.0 / (p + 1) for p in powers]))


def monomials(vertices: int, degree: int) -> list[tuple[int, ...]]:
    """Powers of the polynomials of a degree: total on triangles, in each direction on squares."""
    powers = itertools.product(range(degree + 1), repeat=1 if vertices == 2 else 2)
    return [p for p in powers if vertices != 3 or sum(p) <= degree]


def errors(vertices: int, degree: int, points: np.ndarray, weights: np.ndarray) -> list[float]:
    """Errors of the monomials of a degree."""
    return [
        abs(weights @ np.prod(points**powers, axis=1) - integral(vertices, powers))
        for powers in monomials(vertices, degree)
    ]


@pytest.mark.parametrize("rule", ["auto", "nodal", "gauss", 2, 3, 7, GAUSS_DEGREES[1]])
@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_weights_are_positive_and_sum_to_the_area(vertices, degree, rule):
    points, weights = facet_rule(vertices, degree, rule)
    assert points.shape == (len(weights), 1 if vertices == 2 else 2)
    assert (weights > 0.0).all()
    assert weights.sum() == pytest.approx(AREA[vertices], rel=1e-14)


@pytest.mark.parametrize("exact_to", range(GAUSS_DEGREES[0], GAUSS_DEGREES[1] + 1))
@pytest.mark.parametrize("vertices", [2, 3, 4])
def test_gauss_rules_are_exact_to_their_degree(vertices, exact_to):
    points, weights = facet_rule(vertices, 1, exact_to)
    assert max(errors(vertices, exact_to, points, weights)) < 1e-14
    # Every point lies inside, so that it belongs to its facet alone.
    assert (points > 0.0).all()
    assert (points < 1.0).all()
    if vertices == 3:
        assert (points.sum(axis=1) < 1.0).all()


@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_gauss_by_name_is_exact_to_twice_the_degree(vertices, degree):
    named, number = (facet_rule(vertices, degree, rule) for rule in ("gauss", 2 * degree))
    for a, b in zip(named, number, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_nodal_rules_are_exact_to_their_degree_and_no_further(vertices, degree):
    points, weights = facet_rule(vertices, degree, "nodal")
    exact_to = NODAL_DEGREE[vertices, degree]
    assert max(errors(vertices, exact_to, points, weights)) < 1e-15
    assert max(errors(vertices, exact_to + 1, points, weights)) > 1e-3


@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_nodal_points_are_nodes_with_the_integrals_of_their_shape_functions(vertices, degree):
    """A uniform traction then makes the same nodal forces as the exact integral."""
    kind = facet_cell_type(vertices)
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    exact_points, exact_weights = basix.make_quadrature(kind, 6)
    forces = exact_weights @ element.tabulate(0, exact_points)[0, :, :, 0]
    points, weights = facet_rule(vertices, degree, "nodal")
    here = slice(3, 6) if (vertices, degree) == (3, 2) else slice(None)
    np.testing.assert_allclose(points, element.points[here], atol=1e-15)
    np.testing.assert_allclose(weights, forces[here], atol=1e-15)
    # No force is left out: nodes without a point get none.
    np.testing.assert_allclose(forces.sum(), weights.sum(), atol=1e-15)
    assert (forces > -1e-15).all()
    # At each point one shape function is 1, the others vanish: one pair of nodes per point.
    values = element.tabulate(0, points)[0, :, :, 0]
    np.testing.assert_allclose(values, np.eye(element.dim)[here], atol=1e-14)


@pytest.mark.parametrize(("vertices", "degree"), [*FACETS, (3, 3), (4, 3)])
def test_auto_ties_every_pair_of_a_facet(vertices, degree):
    """The sum of w phi phi^T is positive definite: only gaps of zero have no tractions.

    Its least eigenvalue, for a facet of unit area: of diagonal matrices the least weight, 1/36 in
    the corners of a 9-node quadrilateral; 1/20, the weight of a vertex, with nodes and centre,
    where ``nodal`` has 0.
    """
    points, weights = facet_rule(vertices, degree, "auto")
    element = basix.create_element(
        basix.ElementFamily.P, facet_cell_type(vertices), degree, basix.LagrangeVariant.gll_warped
    )
    values = element.tabulate(0, points)[0, :, :, 0]
    mass = values.T @ (weights[:, None] / weights.sum() * values)
    least = np.linalg.eigvalsh(mass)[0]
    assert least > 1e-3
    if degree == 2:
        assert least == pytest.approx({2: 1 / 6, 3: 1 / 20, 4: 1 / 36}[vertices], rel=1e-12)


@pytest.mark.parametrize(("vertices", "degree"), FACETS)
def test_auto_is_nodal_but_on_six_node_triangles(vertices, degree):
    (points, weights), nodal = (facet_rule(vertices, degree, r) for r in ("auto", "nodal"))
    if (vertices, degree) == (3, 2):
        # Degree 3 with points at nodes and centre has these weights alone: x y (1 - x - y), 1/27 in
        # the centre and 0 at the nodes, integrates to 1/120, so the centre has 27/120.
        assert max(errors(3, 3, points, weights)) < 1e-15
        assert max(errors(3, 4, points, weights)) > 1e-4
        np.testing.assert_allclose(120 * weights, [3, 3, 3, 8, 8, 8, 27], rtol=1e-14)
    else:
        np.testing.assert_array_equal(points, nodal[0])
        np.testing.assert_array_equal(weights, nodal[1])


@pytest.mark.parametrize("rule", ["lobatto", 0, 21, 2.5])
def test_unknown_rules_are_refused(rule):
    with pytest.raises(ValueError, match="must be one of auto, nodal, gauss, or the degree"):
        facet_rule(4, 1, rule)


def test_nodal_is_refused_beyond_degree_two():
    with pytest.raises(ValueError, match="'nodal' exists only for degrees 1 and 2, not for 3"):
        facet_rule(4, 3, "nodal")
