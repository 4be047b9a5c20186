# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""XDMF files with their HDF5 files as plain arrays (one process): grids are found by what they are.

DOLFINx's own reader drops facets that are not found in the mesh and all but one tag of a facet.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import dolfinx.cpp.io
import dolfinx.mesh
import h5py
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_file, shown
from dolfinx_joints.mesh.cells import Floats, Ints, RawMesh
from dolfinx_joints.mesh.reading.arrays import mesh_of_arrays

# Dimension by the first word of TopologyType.
_DIMENSION = {
    "polyline": 1,
    "edge": 1,
    "triangle": 2,
    "quadrilateral": 2,
    "tetrahedron": 3,
    "hexahedron": 3,
}
_SAME = 1e-9  # of the extent: coordinates in two files agree to the digits that are written


class XdmfGrids:
    """The grids of one file."""

    def __init__(self, path: Path) -> None:
        """Read what is in the file itself."""
        check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
        try:
            domain = ElementTree.parse(path).find("Domain")
        except ElementTree.ParseError as failure:
            raise MeshError(f"{path} is no XDMF file: {failure}.") from None
        self._path = path
        self._grids: list[tuple[str, int, ElementTree.Element]] = []
        for grid in domain.findall("Grid") if domain is not None else ():
            kind = _kind(grid)
            if kind == "mixed":
                raise MeshError(
                    f"{path}: the grid {grid.get('Name', '')!r} is of the topology 'Mixed', "
                    "several kinds of cells in one; write the cells to one file and the facets to "
                    "another, facet_file= (with meshio a Mesh of one cell block each)."
                )
            if kind in _DIMENSION:
                self._grids.append((grid.get("Name", ""), _DIMENSION[kind], grid))

    def load(
        self,
        facets: XdmfGrids,
        groups: Mapping[str, int],
        cell_groups: Mapping[str, int],
        mesh: str | None,
        facet_tags: str | None,
        cell_tags: str | None,
    ) -> RawMesh:
        """Read a mesh and groups by their tags; the facets may be in another file."""
        meshes = [each for each in self._grids if each[2].find("Geometry") is not None]
        top = max((dim for _, dim, _ in meshes), default=0)
        bodies = [each for each in meshes if mesh is not None or each[1] == top]
        grid, dim = self._choose("mesh", "mesh", bodies, mesh)
        x, nodes = self._array(grid, "Geometry"), self._topology(grid)
        name, count = _kind(grid), nodes.shape[1] if nodes.ndim == 2 else 0
        try:
            order = dolfinx.cpp.io.perm_vtk(getattr(dolfinx.mesh.CellType, name), count)
        except (AttributeError, RuntimeError):
            raise MeshError(f"{self._path}: {name}s of {count} nodes cannot be read.") from None
        of_facets, of_cells = {}, {}
        if groups:
            found, vertices, tags = facets._tagged(dim - 1, "facet", facet_tags)
            facets._check_nodes(found, x)
            corners = max(dim, 4 if name == "hexahedron" else 0)
            of_facets = {
                key: vertices[each, :corners]
                for key, each in _by_tag("facet", groups, tags).items()
            }
        if cell_groups:
            found, cells, tags = self._tagged(dim, "cell", cell_tags)
            number = np.arange(len(nodes)) if found is grid else self._positions(cells, nodes)
            of_cells = {
                key: number[each] for key, each in _by_tag("cell", cell_groups, tags).items()
            }
        if x.ndim == 2 and x.shape[1] > dim:
            raise MeshError(
                f"A mesh of dimension {dim} in {x.shape[1]}-D space cannot be split; solids, or "
                "plane meshes in 2-D, can."
            )
        try:
            return mesh_of_arrays(name, x, nodes[:, order], of_facets, of_cells)
        except MeshError as error:
            raise MeshError(f"{self._path}: {error}") from None

    def _tagged(self, dim: int, kind: str, name: str | None) -> tuple[Any, Ints, Ints]:
        """A grid with tags, the nodes of its entities and their tags."""
        tagged = [
            each for each in self._grids if each[1] == dim and each[2].find("Attribute") is not None
        ]
        grid, _ = self._choose(f"{kind} tags", f"{kind}_tags", tagged, name)
        nodes, tags = self._topology(grid), self._array(grid, "Attribute").ravel()
        if len(tags) != len(nodes):
            raise MeshError(f"{self._path} has {len(tags)} {kind} tags for {len(nodes)} {kind}s.")
        return grid, nodes, tags

    def _check_nodes(self, grid: ElementTree.Element, x: Floats) -> None:
        """Check that the nodes of tagged facets are those of the mesh."""
        if grid.find("Geometry/DataItem") is None:  # those of the mesh by reference
            return
        own = self._array(grid, "Geometry")
        alike = own.shape == x.shape and np.allclose(own, x, rtol=0.0, atol=_SAME * np.ptp(x))
        if not alike:
            raise MeshError(
                f"{self._path}: the facets have other nodes ({len(own)}) than the mesh ({len(x)}), "
                "so that their numbers have another meaning; write both with the same points (with "
                "meshio without prune_z_0 and remove_orphaned_nodes)."
            )

    def _positions(self, cells: Ints, nodes: Ints) -> Ints:
        """Position of each cell with a tag among the cells of the mesh."""
        rows = np.sort(np.vstack([nodes, cells]), axis=1)
        _, first, of = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        position = first[of.ravel()[len(nodes) :]]
        lost = np.count_nonzero(position >= len(nodes))
        if lost:
            raise MeshError(f"{self._path}: {lost} cells with a tag are no cells of the mesh.")
        return position

    def _choose(
        self, what: str, argument: str, grids: list[tuple[str, int, Any]], name: str | None
    ) -> tuple[Any, int]:
        """Grid and dimension of the name that is asked for, or of the only grid."""
        there = ", ".join(repr(each[0]) for each in grids) or "none"
        if name is not None and name not in [each[0] for each in grids]:
            raise MeshError(f"{self._path} has no {what} {shown(name)}; it has: {there}.")
        if not grids:
            raise MeshError(f"{self._path} has no {what}.")
        if name is None and len(grids) > 1:
            raise MeshError(f"{self._path} has {what} {there}; choose one by {argument}=.")
        _, dim, grid = next(each for each in grids if name in (None, each[0]))
        return grid, dim

    def _topology(self, grid: ElementTree.Element) -> Ints:
        """Nodes of the cells of a grid in the order of the file, shape (n, nodes of a cell)."""
        nodes = self._array(grid, "Topology")
        if nodes.dtype.kind not in "iu":
            raise MeshError(f"{self._path}: the nodes of cells must be whole numbers.")
        return nodes.astype(np.int64)

    def _array(self, grid: ElementTree.Element, part: str) -> NDArray[Any]:
        """Numbers of a part of a grid, in the file itself or in its HDF5 file."""
        item = grid.find(f"{part}/DataItem")
        try:
            if item is None:
                raise ValueError(f"the grid {grid.get('Name', '')!r} has no numbers of {part}")
            text = item.text or ""
            if item.get("Format") != "HDF":
                kind = float if part == "Geometry" else np.int64
                shape = [int(n) for n in item.get("Dimensions", "").split()]
                return np.array(text.split(), dtype=kind).reshape(shape)
            name, _, place = text.strip().partition(":")
            with h5py.File(self._path.parent / name, "r") as file:
                return np.asarray(file[place][()])
        except (OSError, KeyError, ValueError) as failure:
            reason = " ".join(str(failure).split())
            raise MeshError(f"{self._path} cannot be read: {reason}") from None


def _kind(grid: ElementTree.Element) -> str:
    """First word of the type of the cells of a grid."""
    topology = grid.find("Topology")
    kind = "" if topology is None else topology.get("TopologyType", "")
    return kind.lower().split("_")[0]


def _by_tag(kind: str, groups: Mapping[str, int], tags: Ints) -> dict[str, NDArray[np.bool_]]:
    """Which entities carry the tag of each group."""
    found = {name: tags == tag for name, tag in groups.items()}
    for name, members in found.items():
        if not members.any():
            there = shown(np.unique(tags).tolist(), lambda values: ", ".join(map(str, values)))
            raise MeshError(
                f"No {kind} carries the tag {groups[name]} of the group {name!r}; the tags of "
                f"{kind}s are: {there or 'none'}."
            )
    return found
