# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature rules on joint facets: Gauss points, or the nodes themselves."""

from __future__ import annotations

import basix
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SIMPSON = np.array([1.0, 1.0, 4.0]) / 6.0
RULES = ("auto", "nodal", "gauss")


def facet_cell_type(facet_vertices: int) -> basix.CellType:
    """Reference cell of a facet with 2, 3 or 4 vertices."""
    return {
        2: basix.CellType.interval,
        3: basix.CellType.triangle,
        4: basix.CellType.quadrilateral,
    }[facet_vertices]


def facet_rule(facet_vertices: int, degree: int, rule: str = "auto") -> tuple[Floats, Floats]:
    """Points and weights on the reference facet.

    Nodal rules (one point per pair of nodes) keep contact tractions free of oscillation; they
    exist for 2- and 3-node lines, 3-node triangles and 4- and 9-node quadrilaterals. The vertices
    of a 6-node triangle would get zero weight.

    Args:
        facet_vertices: 2, 3 or 4.
        degree: Degree of the displacement on the facet, 1 or 2.
        rule: ``nodal``, ``gauss`` (exact for polynomials of twice the degree), or ``auto``: nodal
            where that exists, else Gauss.

    Returns:
        Points, shape (n, facet dimension), and weights, shape (n,), on the basix reference facet.

    Raises:
        ValueError: The rule is unknown or does not exist for this facet.
    """
    kind = facet_cell_type(facet_vertices)
    if not is_nodal(facet_vertices, degree, rule):
        points, weights = basix.make_quadrature(kind, 2 * degree)
        return points, weights
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    if facet_vertices == 3:
        return element.points, np.full(3, 1.0 / 6.0)
    line = np.array([0.5, 0.5]) if degree == 1 else _SIMPSON[[0, 1, 2]]
    position = {0.0: line[0], 1.0: line[1], 0.5: line[-1]}
    weights = np.array([np.prod([position[round(c, 6)] for c in p]) for p in element.points])
    return element.points, weights


def is_nodal(facet_vertices: int, degree: int, rule: str) -> bool:
    """Whether `facet_rule` places the points at the nodes.

    Raises:
        ValueError: The rule is unknown or does not exist for this facet.
    """
    if rule not in RULES:
        raise ValueError(f"quadrature is {rule!r}; it must be one of {', '.join(RULES)}.")
    exists = degree == 1 or (degree == 2 and facet_vertices != 3)
    if rule == "nodal" and not exists:
        raise ValueError(
            f"quadrature 'nodal' does not exist for {facet_vertices}-vertex facets of degree "
            f"{degree} (some nodes would get zero weight); use 'gauss'."
        )
    return exists and rule != "gauss"
