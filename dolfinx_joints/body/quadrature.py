# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature degrees of the package's own volume integrals. Forms of users keep UFL's estimate."""

from __future__ import annotations

from typing import Any

import basix
import ufl

from dolfinx_joints.mesh.cells import CellShape

# Degree for matrices on curved hexahedra: 64 points instead of the 216 of UFL's estimate, 10.
# With it the first frequencies and the static energy of the dam of demo 03 change by less than
# 1e-6 (docs/theory/materials.md); degree 5, with 27 points, changes them by up to 6e-5.
CURVED_HEXAHEDRA = 7


def volume_measure(shape: CellShape, measure: ufl.Measure = ufl.dx) -> Any:
    """Return the measure for matrices such as K and M, of the whole mesh or of ``measure``.

    Other cells keep UFL's estimate: straight ones are integrated exactly at little cost, and on
    curved tetrahedra one degree less saves a tenth of the time and changes K by 1e-5.
    """
    if shape.type == basix.CellType.hexahedron and shape.degree == 2:
        return measure(degree=CURVED_HEXAHEDRA)
    return measure


def law_degree(shape: CellShape, degree: int) -> int:
    """Return the degree of the quadrature rule at whose points plastic laws are evaluated.

    It is the lowest that integrates the stiffness of straight cells exactly: ``degree`` + 1 points
    per axis of quadrilaterals and hexahedra, ``degree`` being that of the displacement.
    """
    simplex = shape.type in (basix.CellType.triangle, basix.CellType.tetrahedron)
    return 2 * (degree - 1) if simplex else 2 * degree + 1
