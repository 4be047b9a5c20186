# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes and tags in an XDMF file: found by what they are, read by DOLFINx."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import dolfinx.mesh
from dolfinx.io import XDMFFile

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import check_file, shown

# Dimension by the first word of TopologyType.
_DIMENSION = {
    "polyline": 1,
    "edge": 1,
    "triangle": 2,
    "quadrilateral": 2,
    "tetrahedron": 3,
    "hexahedron": 3,
}


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """A grid of the file: its name, topological dimension, and whether it has nodes and tags."""

    name: str
    dim: int
    is_mesh: bool
    is_tags: bool


class XdmfGrids:
    """The grids of one file."""

    def __init__(self, comm: Any, path: Path) -> None:
        """Read their names (collective)."""
        self._comm, self._path = comm, path
        self._grids, self._inline = on_root(comm, lambda: _grids(path))

    def mesh(self, name: str | None) -> dolfinx.mesh.Mesh:
        """Read a mesh (collective), that of the largest dimension unless named."""
        meshes = [grid for grid in self._grids if grid.is_mesh]
        top = max((grid.dim for grid in meshes), default=0)
        bodies = [grid.name for grid in meshes if name is not None or grid.dim == top]
        chosen = self._choose("mesh", "mesh", bodies, name)
        return self._read(lambda file: file.read_mesh(name=chosen))

    def tags(self, mesh: dolfinx.mesh.Mesh, dim: int, name: str | None) -> dolfinx.mesh.MeshTags:
        """Read the tags of the facets or cells of a mesh (collective)."""
        kind = "cell" if dim == mesh.topology.dim else "facet"
        names = [grid.name for grid in self._grids if grid.is_tags and grid.dim == dim]
        chosen = self._choose(f"{kind} tags", f"{kind}_tags", names, name)
        mesh.topology.create_entities(dim)
        return self._read(lambda file: file.read_meshtags(mesh, chosen))

    def _choose(self, what: str, argument: str, names: list[str], name: str | None) -> str:
        """The name that is asked for, or the only one."""
        there = ", ".join(repr(each) for each in names) or "none"
        if name is not None and name not in names:
            raise MeshError(f"{self._path} has no {what} {shown(name)}; it has: {there}.")
        if not names:
            raise MeshError(f"{self._path} has no {what}.")
        if name is None and len(names) > 1:
            raise MeshError(f"{self._path} has {what} {there}; choose one by {argument}=.")
        return names[0] if name is None else name

    def _read(self, read: Any) -> Any:
        encoding = XDMFFile.Encoding.ASCII if self._inline else XDMFFile.Encoding.HDF5
        try:
            with XDMFFile(self._comm, self._path, "r", encoding=encoding) as file:
                return read(file)
        except RuntimeError as failure:
            raise MeshError(f"{self._path} cannot be read: {failure}") from None


def _grids(path: Path) -> tuple[list[_Grid], bool]:
    """Grids with cells in a file, and whether their numbers are in the file itself."""
    check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
    try:
        domain = ElementTree.parse(path).find("Domain")
    except ElementTree.ParseError as failure:
        raise MeshError(f"{path} is no XDMF file: {failure}.") from None
    grids = []
    for grid in domain.findall("Grid") if domain is not None else ():
        topology = grid.find("Topology")
        kind = "" if topology is None else topology.get("TopologyType", "")
        dim = _DIMENSION.get(kind.lower().split("_")[0])
        if dim is not None:
            grids.append(
                _Grid(
                    name=grid.get("Name", ""),
                    dim=dim,
                    is_mesh=grid.find("Geometry") is not None,
                    is_tags=grid.find("Attribute") is not None,
                )
            )
    items = [] if domain is None else list(domain.iter("DataItem"))
    return grids, all(item.get("Format") != "HDF" for item in items)
