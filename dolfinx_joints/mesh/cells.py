# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reference cells with their facets and nodes, search for facets, and checks of cell shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import dolfinx.cpp.io
import dolfinx.mesh
import numpy as np
from dolfinx.cpp.mesh import cell_num_entities
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats as Floats
from dolfinx_joints.common.arrays import Ints as Ints
from dolfinx_joints.common.errors import MeshError

# VTK numbers of the linear and the Lagrange cell types.
_VTK = {
    "triangle": (5, 69),
    "quadrilateral": (9, 70),
    "tetrahedron": (10, 71),
    "hexahedron": (12, 72),
}


def lagrange(kind: basix.CellType, degree: int) -> basix.finite_element.FiniteElement:
    """Return the scalar Lagrange element of a reference cell or facet."""
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, kind, degree, variant)


@dataclass(frozen=True, kw_only=True)
class CellShape:
    """Reference cell with its Lagrange nodes (basix numbering).

    Attributes:
        name: ``triangle``, ``quadrilateral``, ``tetrahedron`` or ``hexahedron``.
        degree: Polynomial degree of the geometry, 1 or 2.
    """

    name: str
    degree: int

    @property
    def type(self) -> basix.CellType:
        """Cell type in basix."""
        return getattr(basix.CellType, self.name)

    @property
    def dim(self) -> int:
        """Topological dimension."""
        return len(basix.topology(self.type)) - 1

    @property
    def facet_vertices(self) -> Ints:
        """Local vertices of each local facet, shape (facets, vertices per facet)."""
        return np.array(basix.topology(self.type)[self.dim - 1], dtype=np.int64)

    @property
    def facet_cycle(self) -> Ints:
        """Positions of a facet's vertices in cyclic order."""
        count = self.facet_vertices.shape[1]
        return np.array([0, 1, 3, 2] if count == 4 else range(count), dtype=np.int64)

    def element(self) -> basix.finite_element.FiniteElement:
        """Return the scalar Lagrange element whose dofs are the geometry nodes."""
        return lagrange(self.type, self.degree)

    @property
    def facet_nodes(self) -> Ints:
        """Local nodes of each local facet, in the order of the facet's Lagrange element.

        Shape (facets, nodes per facet).
        """
        closure = self.element().entity_closure_dofs[self.dim - 1]
        return np.array(closure, dtype=np.int64)


def vtk_layout(shape: CellShape, count: int) -> tuple[int, Ints]:
    """Return the VTK number of a Lagrange cell, and its nodes in VTK order."""
    kind = getattr(dolfinx.mesh.CellType, shape.name)
    order = np.argsort(dolfinx.cpp.io.perm_vtk(kind, count))
    is_linear = count == len(basix.geometry(shape.type))
    return _VTK[shape.name][0 if is_linear else 1], order


@dataclass(frozen=True, kw_only=True)
class RawMesh:
    """Conforming mesh with named groups, complete on one process.

    Attributes:
        shape: Reference cell.
        cells: Cell nodes in basix order, shape (num_cells, nodes per cell).
        x: Node coordinates, shape (num_nodes, gdim), [m].
        cell_groups: Cell numbers of each named group.
        facet_groups: Facet vertices of each named group, shape (n, vertices per facet).
    """

    shape: CellShape
    cells: Ints
    x: Floats
    cell_groups: dict[str, Ints]
    facet_groups: dict[str, Ints]


def find_facets(shape: CellShape, cells: Ints, facets: Ints) -> tuple[Ints, Ints]:
    """Find the cells at facets; a facet is given by vertices in any order, (n, vertices per facet).

    Returns:
        ``owner``, shape (n, 2, 2): (cell, local facet) of the first and second cell, -1 for a
        missing cell. ``count``, shape (n,): number of cells at each facet.
    """
    local = shape.facet_vertices
    is_wanted = np.zeros(int(max(cells.max(initial=-1), facets.max(initial=-1))) + 1, dtype=bool)
    is_wanted[facets] = True
    all_facets = cells[:, local].reshape(-1, local.shape[1])
    candidates = np.flatnonzero(is_wanted[all_facets].all(axis=1))
    wanted = np.sort(facets, axis=1)
    stacked = np.vstack([wanted, np.sort(all_facets[candidates], axis=1)])
    _, inverse = np.unique(stacked, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    key_of_wanted, key_of_all = inverse[: len(wanted)], inverse[len(wanted) :]
    order = np.argsort(key_of_all, kind="stable")
    sorted_keys = key_of_all[order]
    first = np.searchsorted(sorted_keys, key_of_wanted, side="left")
    count = np.searchsorted(sorted_keys, key_of_wanted, side="right") - first
    owner = np.full((len(wanted), 2, 2), -1, dtype=np.int64)
    for side in range(2):
        present = count > side
        slot = candidates[order[first[present] + side]]
        owner[present, side, 0] = slot // len(local)
        owner[present, side, 1] = slot % len(local)
    return owner, count


def inside_out(shape: CellShape, x: Floats, cells: NDArray[Any]) -> Ints:
    """Return the cells whose Jacobian determinant changes sign: they are partly inside out."""
    element = shape.element()
    derivatives = element.tabulate(1, element.points)[1:, :, :, 0]
    if np.ptp(derivatives, axis=1).max() < 1e-12:  # the determinant is equal at all nodes
        return np.empty(0, dtype=np.int64)
    smallest, largest_volume = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    for at_node in np.moveaxis(derivatives, 1, 0):
        volume = np.linalg.det(np.einsum("da,cai->cdi", at_node, x[cells]))
        smallest, largest_volume = np.minimum(smallest, volume), np.maximum(largest_volume, volume)
    largest = np.maximum(largest_volume, -smallest)
    return np.flatnonzero(np.minimum(largest_volume, -smallest) > 1e-6 * largest)


def check_curves(shape: CellShape, x: Floats, cells: NDArray[Any], source: str) -> None:
    """Check that no cell is partly inside out. Gmsh makes such curved cells in thin parts."""
    inverted = inside_out(shape, x, cells)
    if len(inverted):
        remedy = "refine the mesh there, or use straight edges (Mesh.SecondOrderLinear in Gmsh)"
        if shape.degree == 1:
            remedy = "such cells have a re-entrant corner, or their nodes are in the wrong order"
        raise MeshError(
            f"{source}: {len(inverted)} cells are partly inside out, the first one around "
            f"{middle(x[cells[inverted[0]]])}; {remedy}."
        )


def middle(x: Floats) -> str:
    """Return the mean of points, shape (n, gdim), as text for messages."""
    return f"({', '.join(f'{value:.4g}' for value in x.mean(axis=0))})"


def facet_slots(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.integer[Any]]) -> tuple[Any, Ints]:
    """Return the first local cell of each given local facet, and its position in that cell."""
    topology, tdim = mesh.topology, mesh.topology.dim
    topology.create_connectivity(tdim - 1, tdim)
    topology.create_connectivity(tdim, tdim - 1)
    to_cell = topology.connectivity(tdim - 1, tdim)
    to_facet = topology.connectivity(tdim, tdim - 1)
    cells = to_cell.array[to_cell.offsets[facets]]
    count = cell_num_entities(topology.cell_type, tdim - 1)
    per_cell = to_facet.array.reshape(-1, count)  # a rank may have no cells
    return cells, np.argmax(per_cell[cells] == facets[:, None], axis=1)
