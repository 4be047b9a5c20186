# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facet pairs of the joints as interior facets of DOLFINx's forms.

An interior-facet integral uses two cells and one facet of each cell. DOLFINx does not require that
the two facets are identical; only the order of their quadrature points must agree. DOLFINx orders
the points of each facet by a permutation code, which it derives from the global vertex numbers. The
two faces of a joint have different vertices, so their codes differ. This module replaces the code
of the + facet by the code that gives the points the same order as on the - facet. The new code also
affects ``ds`` integrals over the + side with functions on a submesh of facets. Use interior-facet
integrals for these functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import dolfinx.mesh
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import CellShape, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type
from dolfinx_joints.mesh.joint_pairs import JointPairs


@dataclass(frozen=True, kw_only=True)
class IntegratedPairs:
    """Facet pairs over which this rank integrates.

    Attributes:
        entities: Local cell and facet on the + side, then on the - side, shape (n, 4). The first
            side of an interior-facet integral is ``+`` in UFL.
        vertex_order: Vertices of the - facet in the order in which integrals use them, shape
            (n, vertices per facet).
    """

    entities: Ints
    vertex_order: Ints


def integrated_pairs(
    mesh: dolfinx.mesh.Mesh,
    shape: CellShape,
    pairs: JointPairs,
    minus_cells: NDArray[np.int32],
    plus_cells: NDArray[np.int32],
) -> IntegratedPairs:
    """Return this rank's facet pairs; give both facets the same order of quadrature points.

    ``minus_cells`` and ``plus_cells`` are the local numbers of the cells of each pair. The + cells
    may be ghosts.
    """
    entities = np.column_stack([plus_cells, pairs.plus[:, 1], minus_cells, pairs.minus[:, 1]])
    codes = dolfinx_versions.facet_permutations(mesh)
    facets = len(shape.facet_vertices) * entities[:, [0, 2]] + entities[:, [1, 3]]
    permutations = vertex_permutations(shape.facet_vertices.shape[1])
    vertex_order = permutations[codes[facets[:, 1]]]
    plus_order = np.take_along_axis(pairs.match, vertex_order, axis=1)
    fits = (permutations == plus_order[:, None]).all(axis=2)
    codes[facets[:, 0]] = fits.argmax(axis=1)
    return IntegratedPairs(entities=entities.astype(np.int32), vertex_order=vertex_order)


def vertex_permutations(num_vertices: int) -> Ints:
    """Return the vertex permutation of each DOLFINx facet code, shape (codes, num_vertices)."""
    corners = basix.cell.geometry(facet_cell_type(num_vertices))
    permuted = [
        dolfinx_versions.permuted_points(num_vertices, corners, code)
        for code in range(2 if num_vertices == 2 else 2 * num_vertices)
    ]
    distances = np.linalg.norm(np.array(permuted)[:, :, None] - corners, axis=3)
    return distances.argmin(axis=2)
