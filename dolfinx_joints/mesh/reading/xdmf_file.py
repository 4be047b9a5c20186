# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes and tags in an XDMF file as plain arrays (one process): found by what they are.

DOLFINx's own reader drops facets that are not in the mesh, and all but one tag of a facet.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import dolfinx.mesh
import numpy as np
from dolfinx.cpp.io import perm_vtk
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
_SAME = 1e-9  # of the extent: nodes of two files agree to the digits that are written

Grid = ElementTree.Element


class XdmfGrids:
    """The grids of one file."""

    def __init__(self, path: Path) -> None:
        """Read what is in the file itself."""
        check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
        try:
            domain = ElementTree.parse(path).find("Domain")
        except ElementTree.ParseError as failure:
            raise MeshError(f"{path} is no XDMF file: {failure}.") from None
        self._path, grids = path, [] if domain is None else domain.findall("Grid")
        if mixed := [grid.get("Name") for grid in grids if _kind(grid) == "mixed"]:
            raise MeshError(
                f"{path}: the grid {mixed[0]!r} mixes several kinds of cells; write the cells to "
                "one file and the facets to another, facet_file= (with meshio a Mesh of each)."
            )
        self._grids = [grid for grid in grids if _kind(grid) in _DIMENSION]

    def mesh(
        self,
        facets: XdmfGrids,
        groups: Mapping[str, int],
        cell_groups: Mapping[str, int],
        names: tuple[str | None, str | None, str | None],
    ) -> RawMesh:
        """Read the mesh of the largest dimension, unless named, and groups by their tags.

        Args:
            facets: The file of the facet tags.
            groups: Tag of each facet group.
            cell_groups: Tag of each cell group.
            names: Names of mesh, facet tags and cell tags.
        """
        meshes = [grid for grid in self._grids if grid.find("Geometry") is not None]
        top = max((_dim(grid) for grid in meshes), default=0)
        bodies = [grid for grid in meshes if names[0] is not None or _dim(grid) == top]
        grid = self._choose("mesh", "mesh", bodies, names[0])
        kind, dim = _kind(grid), _dim(grid)
        x, cells = self._array(grid, "Geometry"), self._array(grid, "Topology")
        of_facets, of_cells = {}, {}
        if groups:
            tagged = facets._tagged("facet", dim - 1, names[1])
            facets._check_nodes(tagged, x)
            corners = facets._array(tagged, "Topology")[:, : 4 if kind == "hexahedron" else dim]
            of_facets = facets._by_tag("facet", groups, tagged, corners)
        if cell_groups:
            tagged = self._tagged("cell", dim, names[2])
            numbers = self._numbers(self._array(tagged, "Topology"), cells)
            of_cells = self._by_tag("cell", cell_groups, tagged, numbers)
        try:
            order = perm_vtk(getattr(dolfinx.mesh.CellType, kind), cells.shape[1])
            return mesh_of_arrays(kind, x, cells[:, order], of_facets, of_cells)
        except (AttributeError, RuntimeError, ValueError) as error:
            raise MeshError(f"{self._path}: the {kind} mesh cannot be used: {error}") from None

    def _tagged(self, kind: str, dim: int, name: str | None) -> Grid:
        """Find the grid of the tags of facets or cells."""
        found = [g for g in self._grids if g.find("Attribute") is not None and _dim(g) == dim]
        return self._choose(f"{kind} tags", f"{kind}_tags", found, name)

    def _choose(self, what: str, argument: str, grids: list[Grid], name: str | None) -> Grid:
        """Return the grid that is asked for, or the only one."""
        names = [grid.get("Name", "") for grid in grids]
        there = ", ".join(map(repr, names)) or "none"
        if name is not None and name not in names:
            raise MeshError(f"{self._path} has no {what} {shown(name)}; it has: {there}.")
        if not names:
            raise MeshError(f"{self._path} has no {what}.")
        if name is None and len(names) > 1:
            raise MeshError(f"{self._path} has {what} {there}; choose one by {argument}=.")
        return grids[0 if name is None else names.index(name)]

    def _check_nodes(self, grid: Grid, x: Floats) -> None:
        """Check that the nodes of tagged facets, unless referred to, are those of the mesh."""
        own = x if grid.find("Geometry/DataItem") is None else self._array(grid, "Geometry")
        if own.shape != x.shape or np.abs(own - x).max(initial=0.0) > _SAME * np.ptp(x):
            raise MeshError(
                f"{self._path}: the {len(own)} nodes of the facets are not the {len(x)} nodes of "
                "the mesh; write cells and facets with the same points."
            )

    def _numbers(self, tagged: Ints, cells: Ints) -> Ints:
        """Number of each cell with a tag in the mesh."""
        rows = np.sort(np.vstack([cells, tagged]), axis=1)
        _, first, of = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        numbers = first[of.ravel()[len(cells) :]]
        if lost := np.count_nonzero(numbers >= len(cells)):
            raise MeshError(f"{self._path}: {lost} cells with tags are not in the mesh.")
        return numbers

    def _by_tag(
        self, kind: str, groups: Mapping[str, int], grid: Grid, entities: Ints
    ) -> dict[str, Ints]:
        """Facets or cells of each group."""
        tags = self._array(grid, "Attribute").ravel()
        if len(tags) != len(entities):
            raise MeshError(f"{self._path}: {len(entities)} {kind}s have {len(tags)} tags.")
        for name, tag in groups.items():
            if tag not in tags:
                known = shown(np.unique(tags).tolist(), lambda each: ", ".join(map(str, each)))
                raise MeshError(
                    f"No {kind} carries the tag {tag} of the group {name!r}; the tags of {kind}s "
                    f"are: {known}."
                )
        return {name: entities[tags == tag] for name, tag in groups.items()}

    def _array(self, grid: Grid, part: str) -> NDArray[Any]:
        """Numbers of a part of a grid, in the file itself or in its HDF5 file."""
        item = grid.find(f"{part}/DataItem")
        try:
            if item is None:
                raise ValueError(f"the grid {grid.get('Name')!r} has no DataItem of its {part}")
            kind, text = float if part == "Geometry" else np.int64, item.text or ""
            if item.get("Format") != "HDF":
                shape = [int(count) for count in item.get("Dimensions", "").split()]
                return np.array(text.split(), dtype=kind).reshape(shape)
            name, _, place = text.strip().partition(":")
            import h5py

            with h5py.File(self._path.parent / name, "r") as file:
                return np.asarray(file[place][()], dtype=kind)
        except (OSError, KeyError, TypeError, ValueError) as failure:
            reason = " ".join(str(failure).split())
            raise MeshError(f"{self._path} cannot be read: {reason}.") from None


def _kind(grid: Grid) -> str:
    """First word of the type of the cells of a grid."""
    topology = grid.find("Topology")
    return "" if topology is None else topology.get("TopologyType", "").lower().split("_")[0]


def _dim(grid: Grid) -> int:
    return _DIMENSION[_kind(grid)]
