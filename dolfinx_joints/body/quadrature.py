# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature degrees of the package's own matrices. Forms of users keep UFL's estimate."""

from __future__ import annotations

from typing import Any

import basix
import ufl

from dolfinx_joints.mesh.cells import CellShape

# Degree for matrices on 27-node hexahedra: 64 points instead of the 216 of UFL's estimate, 10, and
# 16 points on facets instead of 100. The bound is 1e-6 on the first frequencies and the energy of
# self weight of the dam of demo 03: degree 7 changes them by up to 1.1e-7, degree 5 by up to 3e-5,
# with cells of 5.5 and 8 m (docs/theory/materials.md). Cells that taper by 60 degrees reach 1.5e-5.
CURVED_HEXAHEDRA = 7


def matrix_measure(shape: CellShape, measure: ufl.Measure = ufl.dx) -> Any:
    """Return ``measure`` with the degree for matrices such as K and M on cells of this shape.

    Cells other than 27-node hexahedra keep UFL's estimate; cells with a constant Jacobian are
    integrated exactly. On curved tetrahedra one degree less saves a tenth of the time and changes
    energies by 1e-5. Load vectors keep UFL's estimate too: they take a hundredth of the time of K.
    """
    if shape.type == basix.CellType.hexahedron and shape.degree == 2:
        return measure(degree=CURVED_HEXAHEDRA)
    return measure


def law_degree(shape: CellShape, degree: int) -> int:
    """Return the degree of the quadrature rule at whose points nonlinear materials are evaluated.

    It is the lowest that integrates the stiffness of straight cells exactly: ``degree`` + 1 points
    per axis of quadrilaterals and hexahedra, ``degree`` being that of the displacement.
    """
    simplex = shape.type in (basix.CellType.triangle, basix.CellType.tetrahedron)
    return 2 * (degree - 1) if simplex else 2 * degree + 1
