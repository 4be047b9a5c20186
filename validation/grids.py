# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells and facets of grids of nodes, for `mesh_from_arrays`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Nodes = NDArray[np.int64]


def quads(grid: Nodes) -> Nodes:
    """Quadrilaterals between the nodes (rows upwards, columns along x), shape (cells, 4)."""
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    return np.column_stack([corner.ravel() for corner in corners])


def line(nodes: Nodes) -> Nodes:
    """Facets between consecutive nodes, shape (facets, 2)."""
    return np.column_stack([nodes[:-1], nodes[1:]])
