# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature rules on joint facets: Gauss points, the nodes, or nodes and centre."""

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
GAUSS_DEGREES = (2, 20)  # one point per facet, degree 1, would let it turn


def facet_cell_type(facet_vertices: int) -> basix.CellType:
    """Reference cell of a facet with 2, 3 or 4 vertices."""
    return {
        2: basix.CellType.interval,
        3: basix.CellType.triangle,
        4: basix.CellType.quadrilateral,
    }[facet_vertices]


def vertex_functions(facet_vertices: int, places: Floats) -> Floats:
    """Linear functions of a facet's vertices at places on it, shape (q, vertices)."""
    return lagrange(facet_cell_type(facet_vertices), 1).tabulate(0, places)[0, :, :, 0]


def facet_rule(facet_vertices: int, degree: int, rule: str | int = "auto") -> tuple[Floats, Floats]:
    """Points and weights on the reference facet.

    A nodal rule has one point per pair of nodes, which keeps contact tractions free of
    oscillation however stiff the joint is. Its weights are the integrals of the shape functions,
    so that a uniform traction makes the right nodal forces. On 6-node triangles these integrals
    vanish at the vertices: the points of ``nodal`` are the nodes on the edges there, and it leaves
    pairs of vertices untied, free to part and to overlap however stiff the joint is. ``auto``
    adds vertices and centre there; a rule exact to degree 3 with positive weights, which ties
    every pair.

    Args:
        facet_vertices: 2, 3 or 4.
        degree: Degree of the displacement on the facet, 1 or 2.
        rule: ``nodal``; ``gauss``, exact for polynomials of twice the degree; a whole number
            from 2 to 20, the degree of polynomials that a Gauss rule is exact for; or ``auto``:
            nodes and centre on 6-node triangles, beyond degree 2 ``gauss``, otherwise ``nodal``.

    Returns:
        Points, shape (n, facet dimension), and weights, shape (n,), on the basix reference facet.

    Raises:
        ValueError: The rule is unknown or does not exist for this degree.
    """
    check_rule(rule)
    kind = facet_cell_type(facet_vertices)
    if rule == "nodal" and degree not in (1, 2):
        raise ValueError(
            f"quadrature 'nodal' exists for degree 1 and 2, not {degree}; use 'gauss'."
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
    """Refuse what is neither the name of a rule nor the degree of one."""
    least, most = GAUSS_DEGREES
    if rule not in (RULES if isinstance(rule, str) else range(least, most + 1)):
        raise ValueError(
            f"quadrature is {shown(rule)}; it must be one of {', '.join(RULES)}, or the degree of "
            f"a Gauss rule, a whole number from {least} to {most}."
        )
