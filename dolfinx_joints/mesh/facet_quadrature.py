# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature rules on joint facets: at Gauss points, at nodes, or at nodes and the centre."""

from __future__ import annotations

import operator
from typing import Any

import basix
import numpy as np

from dolfinx_joints.common.parameters import shown
from dolfinx_joints.mesh.cells import Floats, lagrange

_SIMPSON = np.array([1.0, 1.0, 4.0]) / 6.0
_NODES_AND_CENTRE = np.array([3.0, 8.0, 27.0]) / 120.0  # a vertex, an edge, the centre
RULES = ("auto", "nodal", "gauss")
GAUSS_DEGREES = (2, 20)  # with degree 1 (one point per facet) the facet could rotate freely


def facet_cell_type(facet_vertices: int) -> basix.CellType:
    """Return the reference cell of a facet with 2, 3 or 4 vertices."""
    return {
        2: basix.CellType.interval,
        3: basix.CellType.triangle,
        4: basix.CellType.quadrilateral,
    }[facet_vertices]


def vertex_functions(facet_vertices: int, places: Floats) -> Floats:
    """Return the linear vertex functions of a facet at reference points, (q, vertices)."""
    return lagrange(facet_cell_type(facet_vertices), 1).tabulate(0, places)[0, :, :, 0]


def facet_rule(facet_vertices: int, degree: int, rule: str | int = "auto") -> tuple[Floats, Floats]:
    """Return the points and weights of a quadrature rule on the reference facet.

    A nodal rule has one point per node pair. Contact tractions then do not oscillate, regardless
    of the joint stiffness. The weights are the integrals of the shape functions, so a uniform
    traction gives the correct nodal forces.

    On 6-node triangles these integrals are zero at the vertices. ``nodal`` then uses only the
    nodes on the edges, so vertex pairs can open and overlap without resistance. ``auto`` also uses
    the vertices and the centre; it is exact to degree 3, with a positive weight at each node.

    Args:
        facet_vertices: 2, 3 or 4.
        degree: Degree of the displacement on the facet, 1 or 2.
        rule: ``nodal``; ``gauss``, exact for polynomials of twice ``degree``; or the degree to
            which a Gauss rule is exact, from 2 to 20. ``auto`` uses nodes and centre on 6-node
            triangles, ``gauss`` above degree 2, and ``nodal`` otherwise.

    Returns:
        Points, shape (n, facet dimension), and weights, shape (n,), on the basix reference facet.

    Raises:
        ValueError: The rule is unknown or does not exist for this degree.
    """
    check_rule(rule)
    kind = facet_cell_type(facet_vertices)
    if rule == "nodal" and degree not in (1, 2):
        raise ValueError(
            f"quadrature 'nodal' exists only for degrees 1 and 2, not for {degree}; use 'gauss'."
        )
    if rule not in ("auto", "nodal") or degree not in (1, 2):
        exact_to = 2 * degree if isinstance(rule, str) else operator.index(rule)
        points, weights = basix.make_quadrature(kind, exact_to)
        return points, weights
    nodes = lagrange(kind, degree).points
    if facet_vertices == 3 and degree == 1:
        return nodes, np.full(3, 1.0 / 6.0)
    if facet_vertices == 3 and rule == "nodal":
        return nodes[3:], np.full(3, 1.0 / 6.0)
    if facet_vertices == 3:
        return np.vstack([nodes, nodes.mean(axis=0)]), np.repeat(_NODES_AND_CENTRE, [3, 3, 1])
    line = np.array([0.5, 0.5]) if degree == 1 else _SIMPSON
    position = {0.0: line[0], 1.0: line[1], 0.5: line[-1]}
    weights = np.array([np.prod([position[round(c, 6)] for c in p]) for p in nodes])
    return nodes, weights


def check_rule(rule: Any) -> None:
    """Raise ValueError unless ``rule`` is the name or the degree of a quadrature rule."""
    lowest, highest = GAUSS_DEGREES
    if rule not in (RULES if isinstance(rule, str) else range(lowest, highest + 1)):
        raise ValueError(
            f"quadrature is {shown(rule)}; it must be one of {', '.join(RULES)}, or the degree of "
            f"a Gauss rule, a whole number from {lowest} to {highest}."
        )
