# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of meshes and tags in XDMF files into arrays, on one process.

DOLFINx's reader is not used: it drops facets outside the mesh and additional tags of a facet.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar
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
_PHYSICAL = "gmsh:physical"  # name of Gmsh's groups in meshio
_SAME = 1e-9  # nodes of two files are equal if they differ by less than this share of the extent

Grid = ElementTree.Element
T = TypeVar("T")


class XdmfGrids:
    """Grids of one file."""

    def __init__(self, path: Path) -> None:
        check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
        try:
            domain = ElementTree.parse(path).find("Domain")
        except ElementTree.ParseError as failure:
            raise MeshError(f"{path} is not an XDMF file: {failure}.") from None
        self._path, grids = path, [] if domain is None else domain.findall("Grid")
        if mixed := [grid.get("Name") for grid in grids if _kind(grid) == "mixed"]:
            raise MeshError(
                f"{path}: the grid {mixed[0]!r} mixes several kinds of cells; write cells and "
                "facets to two files (in meshio one Mesh each), and pass the second as facet_file=."
            )
        self._grids = [grid for grid in grids if _kind(grid) in _DIMENSION]

    def mesh(
        self,
        facets: XdmfGrids,
        groups: Mapping[str, int],
        cell_groups: Mapping[str, int],
        names: tuple[str | None, str | None, str | None],
    ) -> RawMesh:
        """Return the named mesh, or the mesh of the largest dimension, with groups by tags.

        ``names`` are the names of the mesh, of the facet tags in ``facets`` and of the cell tags.
        """
        meshes = [grid for grid in self._grids if grid.find("Geometry") is not None]
        top = max((_dim(grid) for grid in meshes), default=0)
        bodies = [grid for grid in meshes if names[0] is not None or _dim(grid) == top]
        candidates = [(name := grid.get("Name", ""), {name}, grid) for grid in bodies]
        grid = self._choose("mesh", "mesh", candidates, names[0])
        kind, dim = _kind(grid), _dim(grid)
        x, cells = self._nodes(grid, dim), self._array(grid, "Topology")
        of_facets, of_cells = {}, {}
        if groups:
            tagged, tags = facets._grid_of_tags("facet", dim - 1, names[1])
            facets._check_nodes(tagged, x)
            corners = facets._array(tagged, "Topology")[:, : 4 if kind == "hexahedron" else dim]
            of_facets = facets._by_tag("facet", groups, tags, corners)
        if cell_groups:
            tagged, tags = self._grid_of_tags("cell", dim, names[2])
            numbers = self._numbers(self._array(tagged, "Topology"), cells)
            of_cells = self._by_tag("cell", cell_groups, tags, numbers)
        try:
            order = perm_vtk(getattr(dolfinx.mesh.CellType, kind), cells.shape[1])
            return mesh_of_arrays(kind, x, cells[:, order], of_facets, of_cells)
        except (AttributeError, RuntimeError, ValueError) as error:
            raise MeshError(f"{self._path}: the {kind} mesh cannot be used: {error}") from None

    def _grid_of_tags(self, kind: str, dim: int, name: str | None) -> tuple[Grid, Ints]:
        """Return the grid of the tags of facets or cells, and the tags."""
        candidates = []
        for grid in (grid for grid in self._grids if _dim(grid) == dim):
            items, of_grid = enumerate(grid.findall("Attribute"), start=1), grid.get("Name", "")
            tags = [(k, a.get("Name", "")) for k, a in items if a.get("Center", "Cell") == "Cell"]
            for number, own_name in tags:
                label = own_name if len(tags) > 1 else of_grid
                candidates.append((label, {own_name, of_grid}, (grid, number)))
        grid, number = self._choose(f"{kind} tags", f"{kind}_tags", candidates, name)
        return grid, self._array(grid, f"Attribute[{number}]").ravel()

    def _choose(
        self, kind: str, argument: str, candidates: list[tuple[str, set[str], T]], name: str | None
    ) -> T:
        """Return the value of the only candidate (label, names, value), or ``gmsh:physical``."""
        available = ", ".join(repr(label) for label, *_ in candidates) or "none"
        chosen = [candidate for candidate in candidates if name in (None, *candidate[1])]
        if name is not None and not chosen:
            raise MeshError(f"{self._path} has no {kind} {shown(name)}; it has: {available}.")
        if not candidates:
            raise MeshError(f"{self._path} has no {kind}; grids in a Collection are not read.")
        if len(chosen) > 1:
            chosen = [candidate for candidate in chosen if _PHYSICAL in candidate[1]]
        if len(chosen) != 1:
            raise MeshError(f"{self._path} has {kind} {available}; choose one by {argument}=.")
        return chosen[0][2]

    def _nodes(self, grid: Grid, dim: int) -> Floats:
        """Return the node coordinates; in a plane mesh drop a constant z."""
        x = self._array(grid, "Geometry")
        flat = x.shape[1] == dim + 1 == 3 and np.ptp(x[:, 2]) <= _SAME * np.ptp(x)
        return x[:, :dim] if flat else x

    def _check_nodes(self, grid: Grid, x: Floats) -> None:
        """Check that tagged facets refer to the nodes of the mesh, or have equal nodes."""
        refers = grid.find("Geometry/DataItem") is None
        nodes = x if refers else self._nodes(grid, x.shape[1])
        if nodes.shape != x.shape or np.abs(nodes - x).max(initial=0.0) > _SAME * np.ptp(x):
            raise MeshError(
                f"{self._path}: the {len(nodes)} nodes of the facets are not the {len(x)} nodes of "
                "the mesh; write cells and facets with the same points."
            )

    def _numbers(self, tagged: Ints, cells: Ints) -> Ints:
        """Return the number in the mesh of each tagged cell."""
        rows = np.sort(np.vstack([cells, tagged]), axis=1)
        _, first, of = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        numbers = first[of.ravel()[len(cells) :]]
        if lost := np.count_nonzero(numbers >= len(cells)):
            raise MeshError(f"{self._path}: {lost} cells with tags are not in the mesh.")
        return numbers

    def _by_tag(
        self, kind: str, groups: Mapping[str, int], tags: Ints, entities: Ints
    ) -> dict[str, Ints]:
        """Return the facets or cells of each group."""
        if len(tags) != len(entities):
            raise MeshError(f"{self._path}: {len(entities)} {kind}s have {len(tags)} tags.")
        for name, tag in groups.items():
            if tag not in tags:
                listed = shown(np.unique(tags).tolist(), lambda values: ", ".join(map(str, values)))
                raise MeshError(
                    f"No {kind} has the tag {tag} of the group {name!r}; the tags of {kind}s "
                    f"are: {listed}."
                )
        return {name: entities[tags == tag] for name, tag in groups.items()}

    def _array(self, grid: Grid, part: str) -> NDArray[Any]:
        """Return the numbers of a part of a grid, from the XDMF file or its HDF5 file."""
        item = grid.find(f"{part}/DataItem")
        try:
            if item is None:
                raise ValueError(f"the grid {grid.get('Name')!r} has no DataItem for its {part}")
            if item.get("Format") == "HDF":
                import h5py

                name, _, place = (item.text or "").strip().partition(":")
                with h5py.File(self._path.parent / name, "r") as file:
                    numbers = np.asarray(file[place][()], dtype=np.float64)
            else:
                shape = [int(count) for count in item.get("Dimensions", "").split()]
                numbers = np.array((item.text or "").split(), dtype=np.float64).reshape(shape)
            if part == "Geometry":
                return numbers
            if wrong := numbers[numbers != np.rint(numbers)].tolist():
                raise ValueError(f"{wrong[0]} in {part} is not a whole number")
            return numbers.astype(np.int64)
        except (OSError, KeyError, TypeError, ValueError) as failure:
            reason = " ".join(str(failure).split())
            raise MeshError(f"{self._path} cannot be read: {reason}.") from None


def _kind(grid: Grid) -> str:
    """Return the first word of the type of the cells of a grid."""
    topology = grid.find("Topology")
    return "" if topology is None else topology.get("TopologyType", "").lower().split("_")[0]


def _dim(grid: Grid) -> int:
    return _DIMENSION[_kind(grid)]
