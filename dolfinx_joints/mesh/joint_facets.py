# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facet pairs of the joints as interior facets of DOLFINx's forms.

An interior-facet integral uses two cells and one facet of each cell. DOLFINx does not require that
the two facets are identical; only the order of their quadrature points must agree. On each side a
code derived from the global vertex numbers permutes the points. The two faces of a joint have
different vertices, so their codes differ. This module replaces the code of the + facet by the code
that maps the points of the + facet to the points of the - facet. The + facet is an exterior facet,
so its code has no other effect, except in ``ds`` integrals over the + side with functions on a
submesh of facets. Use interior-facet integrals for these functions.
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
    """Facet pairs that this rank integrates over.

    Attributes:
        entities: Local cell and facet on the + side, then on the - side, shape (n, 4). The first
            side of an interior-facet integral is ``+`` in UFL.
        turned: Vertex of the - facet at each vertex of the permuted reference facet of integrals,
            shape (n, vertices per facet).
    """

    entities: Ints
    turned: Ints


def integrated_pairs(
    mesh: dolfinx.mesh.Mesh,
    shape: CellShape,
    pairs: JointPairs,
    minus: NDArray[np.int32],
    plus: NDArray[np.int32],
) -> IntegratedPairs:
    """Return the pairs of this rank, and align the quadrature points of their two sides.

    ``minus`` and ``plus`` are the local numbers of the cells of each pair. The + cells may be
    ghosts.
    """
    entities = np.column_stack([plus, pairs.plus[:, 1], minus, pairs.minus[:, 1]])
    codes = dolfinx_versions.facet_permutations(mesh)
    facets = len(shape.facet_vertices) * entities[:, [0, 2]] + entities[:, [1, 3]]
    permutations = vertex_permutations(shape.facet_vertices.shape[1])
    turned = permutations[codes[facets[:, 1]]]
    wanted = np.take_along_axis(pairs.match, turned, axis=1)
    fits = (permutations == wanted[:, None]).all(axis=2)
    codes[facets[:, 0]] = fits.argmax(axis=1)
    return IntegratedPairs(entities=entities.astype(np.int32), turned=turned)


def vertex_permutations(facet_vertices: int) -> Ints:
    """Return the vertex permutation of each DOLFINx facet code, shape (codes, vertices)."""
    corners = basix.cell.geometry(facet_cell_type(facet_vertices))
    permuted = [
        dolfinx_versions.permuted_points(facet_vertices, corners, code)
        for code in range(2 if facet_vertices == 2 else 2 * facet_vertices)
    ]
    distances = np.linalg.norm(np.array(permuted)[:, :, None] - corners, axis=3)
    return distances.argmin(axis=2)
