# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facet pairs of the joints as interior facets of DOLFINx's forms.

An interior-facet integral takes two cells with a facet of each. Nothing in DOLFINx asks these
facets to be one and the same, but for the order of quadrature points: on each side they are
permuted by a code that follows from the global numbers of the facet's vertices, so that the two
sides agree on it. The two faces of a joint have vertices of their own. So the code of the + facet
is replaced by the one that puts its points where those of the - facet are. It is an exterior
facet, whose code matters only where an integral over the + side has functions on a submesh of
facets: they go under an interior-facet integral instead.
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
    """The facet pairs of this rank, over which it integrates.

    Attributes:
        entities: Local cell and facet on the + side, then on the - side, shape (n, 4); the first
            side of an interior-facet integral is the ``+`` of UFL.
        turned: Where the points of the - facet's permutation stand: for each vertex of the
            reference facet as integrals see it, the vertex of the - facet, shape
            (n, vertices per facet).
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
    """Find the pairs of this rank, and make the quadrature points of their two sides meet.

    The cells across the joints are ghosts on the rank of the - side; ``minus`` and ``plus`` are the
    local numbers of each pair's cells.
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
    """Where each code of DOLFINx takes the vertices of a facet, shape (codes, vertices)."""
    corners = basix.cell.geometry(facet_cell_type(facet_vertices))
    moved = [
        dolfinx_versions.permuted_points(facet_vertices, corners, code)
        for code in range(2 if facet_vertices == 2 else 2 * facet_vertices)
    ]
    apart = np.linalg.norm(np.array(moved)[:, :, None] - corners, axis=3)
    return apart.argmin(axis=2)
