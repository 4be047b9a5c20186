# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodal vectors of functions of position, and products of matrices with them."""

from __future__ import annotations

import numpy as np


def field(model, values):
    """Nodal vector of ``values(x)``, shape (n, gdim), at the owned nodes x (n, 3)."""
    u = model.mass.createVecRight()
    x = model.V.tabulate_dof_coordinates()[: u.getLocalSize() // model.gdim]
    u.setArray(np.broadcast_to(values(x), (len(x), model.gdim)).ravel())
    return u


def along(axis, profile=lambda x: np.ones(len(x)), gdim=3):
    """Displacements along an axis, of a size (n,) that may depend on position."""
    return lambda x: profile(x)[:, None] * np.eye(gdim)[axis]


def energy(model, matrix, one, other):
    """one . A other for two displacement fields."""
    product = matrix.createVecLeft()
    matrix.mult(field(model, other), product)
    return product.dot(field(model, one))
