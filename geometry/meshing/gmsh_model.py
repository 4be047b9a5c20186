# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gmsh sessions, named groups, mesh files, mesh quality, and flags of the scripts."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from dolfinx_joints.common.parameters import check_file
from dolfinx_joints.common.progress import LOGGER
from dolfinx_joints.geometry.meshing.arguments import mesh_path
from dolfinx_joints.geometry.meshing.extrusion import (
    BoolArray,
    FloatArray,
    IntArray,
    PlaneMesh,
    SolidMesh,
)
from dolfinx_joints.mesh.reading.gmsh_syntax import check_msh

Placement = Callable[[FloatArray, dict[str, BoolArray]], FloatArray]
Section = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

# Gmsh's element types by dimension and number of nodes.
_TYPES = {(3, 8): 5, (3, 4): 4, (2, 4): 3, (2, 3): 2, (1, 2): 1}
_NAMES = {5: "hex8", 12: "hex27", 4: "tet4", 11: "tet10"}
_HEXAHEDRA = (5, 12)

_OPTIONS = {
    "General.Terminal": 0,
    "Mesh.Binary": 1,
    "Mesh.ElementOrder": 1,  # the order is raised once, by write_mesh
    "Mesh.MshFileVersion": 4.1,
    "Mesh.RandomSeed": 1,
    "Mesh.SaveAll": 0,
    "Mesh.SaveParametric": 0,
    "Mesh.SecondOrderIncomplete": 0,  # 27-node hexahedra, 9-node faces
    "Mesh.SecondOrderLinear": 1,  # nodes are moved to their exact places afterwards
}


@contextmanager
def gmsh_session() -> Iterator[None]:
    """Open a new, current Gmsh model with the options of this package.

    If the caller has already initialised Gmsh, its options and its current model are restored on
    exit. Otherwise Gmsh is initialised here and finalised on exit, also after an error.
    """
    is_first = not gmsh.isInitialized()
    if is_first:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    previous = "" if is_first else gmsh.model.getCurrent()
    saved = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
    try:
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
        gmsh.model.add("dolfinx_joints_geometry")
        yield
    finally:
        if is_first:
            gmsh.clear()  # after a failed read Gmsh stays locked, even in a new session
            gmsh.finalize()
        else:
            gmsh.model.remove()
            if previous in gmsh.model.list():
                gmsh.model.setCurrent(previous)
            for name, value in saved.items():
                gmsh.option.setNumber(name, value)


def raise_order(order: int) -> None:
    """Raise the order of the elements of the current mesh from 1 to ``order``.

    Raises:
        RuntimeError: if Gmsh does not raise the order; Gmsh itself reports no error.
    """
    if order == 1:
        return
    gmsh.model.mesh.setOrder(order)
    properties = map(gmsh.model.mesh.getElementProperties, gmsh.model.mesh.getElementTypes())
    if any(dim > 0 and element_order != order for _, dim, element_order, *_ in properties):
        raise RuntimeError(
            f"Gmsh made no elements of order {order}: it has been locked since a file could not be "
            "read in this session; call gmsh.clear() and try again."
        )


@contextmanager
def writing(path: Path) -> Iterator[str]:
    """Yield a temporary file name for Gmsh, and move the complete file to ``path`` afterwards.

    Raises:
        ValueError: if the file cannot be written; the temporary file is removed.
    """
    part = path.with_name(f".{path.stem}.{os.getpid()}.partial.msh")  # of this rank
    try:
        yield str(part)
        # Gmsh does not report a full disk.
        if not _ends_with(part, b"$EndElements\n"):
            raise ValueError(f"{str(path)!r} cannot be written completely: is the disk full?")
        part.replace(path)
    except OSError as error:
        raise ValueError(f"{str(path)!r} cannot be written: {error.strerror}.") from None
    finally:
        with suppress(OSError):
            part.unlink()


def _ends_with(path: Path, end: bytes) -> bool:
    """Return True if the file exists and ends with these bytes."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - len(end)))
        return file.read() == end


def save(path: Path, gui: bool, duplicated: bool) -> None:
    """Write the current model to a file, with duplicated joint faces if requested, and show it.

    Raises:
        ValueError: if the file cannot be written.
        MeshError: if joint faces cannot be duplicated.
    """
    if duplicated:
        # DOLFINx, which other meshes do not need, starts PETSc together on all ranks.
        from dolfinx_joints.geometry.meshing.duplicated_joints import duplicate_joints

        duplicate_joints()
    with writing(path) as part:
        try:
            gmsh.write(part)
        except Exception as error:  # Gmsh has no other kind
            raise ValueError(f"{str(path)!r} cannot be written: {error}.") from None
    LOGGER.info("mesh written to %s", path)
    if gui:
        gmsh.fltk.run()


def check_window(gui: Any) -> None:
    """Raise ValueError if Gmsh's window is requested but cannot be opened."""
    if gui and not any(name in os.environ for name in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise ValueError("gui is True, but there is no screen to show a window on.")


def write_mesh(
    out: str | os.PathLike[str],
    solid: SolidMesh,
    order: int,
    *,
    place: Placement | None = None,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Raise the order, move nodes to their exact positions, check the cells, write the file.

    Args:
        out: path of the file; ".msh" is the only format.
        solid: mesh of order 1, in (x, y, z) or in the reference coordinates of ``place``.
        order: order of the elements, 1 or 2 (complete: 27-node hexahedra, 10-node tetrahedra).
        place: map from the reference coordinates of all nodes, shape (num_nodes, 3), to (x, y, z)
            [m]; its second argument has, per surface group, True at the nodes of the group. None
            if the mesh already has its final coordinates and straight edges.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces.

    Returns:
        The path written.

    Raises:
        ValueError: if the name does not end in ".msh", its folder does not exist, or the file
            cannot be written.
        RuntimeError: if a cell is turned inside out (scaled Jacobian not above zero).
    """
    path = mesh_path(out)
    with gmsh_session():
        entities = _add_mesh(solid.points, solid.cells, solid.facets, 3)
        raise_order(order)
        if place is not None:
            _move_nodes(place, {name: entities[name] for name in solid.facets})
        report = _report()
        if not report.min_scaled_jacobian > 0:  # also true for NaN
            raise RuntimeError(
                f"the smallest scaled Jacobian of the mesh is {report.min_scaled_jacobian:.3g}, "
                "but it must be positive: choose a smaller size, or a less extreme shape."
            )
        save(path, gui, duplicated)
    return path


def write_plane(
    out: str | os.PathLike[str],
    plane: PlaneMesh,
    order: int,
    *,
    section: Section | None = None,
    gui: bool = False,
    duplicated: bool = False,
) -> Path:
    """Raise the order of a plane mesh, move nodes to their exact positions and write the file.

    Args:
        out: path of the .msh file.
        plane: mesh of order 1, in (x, y) or in the reference coordinates of ``section``.
        order: order of the elements, 1 or 2.
        section: map from the reference coordinates (p, q) of all nodes to (x, y) [m]; None if the
            mesh already has its final coordinates and straight edges.
        gui: show the mesh in Gmsh's window afterwards.
        duplicated: duplicate the joint faces.

    Raises:
        ValueError: if the name does not end in ".msh", its folder does not exist, or the file
            cannot be written.
    """
    path = mesh_path(out)
    with gmsh_session():
        points = np.column_stack([plane.points, np.zeros(len(plane.points))])
        _add_mesh(points, plane.cells, plane.edges, 2)
        raise_order(order)
        if section is not None:
            tags, reference, _ = gmsh.model.mesh.getNodes()
            p, q, _ = reference.reshape(-1, 3).T
            for tag, x, y in zip(tags, *section(p, q), strict=True):
                gmsh.model.mesh.setNode(tag, [x, y, 0.0], [])
        save(path, gui, duplicated)
    return path


def _add_mesh(
    points: FloatArray, cells: dict[str, IntArray], facets: dict[str, IntArray], dim: int
) -> dict[str, int]:
    """Add named cells and facets to the current model as discrete entities; return their tags."""
    groups = [(dim, *group) for group in cells.items()]
    groups += [(dim - 1, *group) for group in facets.items()]
    entities = {name: gmsh.model.addDiscreteEntity(d) for d, name, _ in groups}
    tags = np.arange(1, len(points) + 1)
    gmsh.model.mesh.addNodes(dim, entities[groups[0][1]], tags, points.ravel())
    for number, (d, name, nodes) in enumerate(groups, start=1):
        kind = _TYPES[d, nodes.shape[1]]
        gmsh.model.mesh.addElementsByType(entities[name], kind, [], nodes.ravel() + 1)
        gmsh.model.addPhysicalGroup(d, [entities[name]], number, name)
    return entities


def _move_nodes(place: Placement, surfaces: dict[str, int]) -> None:
    """Move every node of the current model from its reference to its final coordinates."""
    tags, reference, _ = gmsh.model.mesh.getNodes()
    groups = {}
    for name, entity in surfaces.items():
        _, _, nodes = gmsh.model.mesh.getElements(2, entity)
        groups[name] = np.isin(tags, np.concatenate(nodes))
    for tag, xyz in zip(tags, place(reference.reshape(-1, 3), groups), strict=True):
        gmsh.model.mesh.setNode(tag, xyz, [])


@dataclass(frozen=True)
class MeshReport:
    """Size and quality of a mesh.

    Args:
        element: "hex8", "hex27", "tet4" or "tet10".
        num_nodes: number of nodes in the file.
        num_cells: number of cells.
        num_facets: number of facets of each surface group.
        min_scaled_jacobian: smallest of all cells; 1 for a cube or a regular tetrahedron.
        volume: volume of each volume group [m^3].
    """

    element: str
    num_nodes: int
    num_cells: int
    num_facets: dict[str, int]
    min_scaled_jacobian: float
    volume: dict[str, float]

    def __str__(self) -> str:
        groups = self.num_facets.items()
        joints = {k.rstrip("+-"): n for k, n in groups if k.lower().startswith("joint")}
        return (
            f"{self.num_cells} {self.element} cells, {self.num_nodes} nodes "
            f"({3 * self.num_nodes} unknowns), {len(joints)} joints with {sum(joints.values())} "
            f"facets, volume {sum(self.volume.values()):.6g} m^3, "
            f"smallest scaled Jacobian {self.min_scaled_jacobian:.3f}"
        )


def describe(path: str | os.PathLike[str]) -> MeshReport:
    """Return the size, the groups and the cell quality of a mesh file of solids.

    Raises:
        ValueError: if the file does not exist or has no named solids.
    """
    file = Path(path)
    check_file(file, f"There is no mesh file {str(file)!r}.")
    check_msh(file)
    with gmsh_session():
        try:
            gmsh.merge(str(file))
        except Exception as error:  # Gmsh has no other kind
            raise ValueError(f"{str(file)!r} cannot be read: {error}.") from None
        if not gmsh.model.getPhysicalGroups(3):
            raise ValueError(f"{str(file)!r} has no named solids.")
        return _report()


def _report() -> MeshReport:
    """Return the report of the current model."""
    names = {(d, t): gmsh.model.getPhysicalName(d, t) for d, t in gmsh.model.getPhysicalGroups()}
    facets, volume, least, num_cells, kind = {}, {}, np.inf, 0, 0
    for (dim, tag), name in names.items():
        entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
        if dim == 2:
            facets[name] = sum(len(gmsh.model.mesh.getElements(2, e)[1][0]) for e in entities)
            continue
        volume[name] = 0.0
        for entity in entities:
            (kind,), (cells,), _ = gmsh.model.mesh.getElements(3, entity)
            num_cells += len(cells)
            points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
            _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points, entity)
            volume[name] += float((determinants.reshape(-1, weights.size) @ weights).sum())
            least = float(np.minimum(least, scaled_jacobians(kind, entity).min()))  # NaN stays
    num_nodes = len(gmsh.model.mesh.getNodes()[0])
    return MeshReport(_NAMES[kind], num_nodes, num_cells, facets, least, volume)


def scaled_jacobians(kind: int, entity: int) -> FloatArray:
    """Return the smallest scaled Jacobian of each cell of a volume of the current model.

    The scaled Jacobian is det J divided by the product of the lengths of its three columns. On
    tetrahedra it is multiplied by sqrt 2, to be 1 for a regular tetrahedron. It is sampled at the
    Gauss points of degree 6 and at the nodes of the cell.

    Args:
        kind: Gmsh's element type.
        entity: tag of the volume.

    Returns:
        Array of shape (num_cells,).
    """
    gauss, _ = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
    nodes = gmsh.model.mesh.getElementProperties(kind)[4]
    samples = np.concatenate([gauss, nodes])
    jacobians, determinants, _ = gmsh.model.mesh.getJacobians(kind, samples, entity)
    columns = np.linalg.norm(jacobians.reshape(-1, 3, 3), axis=2).prod(axis=1)
    factor = 1.0 if kind in _HEXAHEDRA else np.sqrt(2.0)
    with np.errstate(invalid="ignore"):  # NaN in a cell without volume
        return (factor * determinants / columns).reshape(-1, samples.size // 3).min(axis=1)


def run_script(
    parser: argparse.ArgumentParser, model: Callable[..., Path], argv: list[str] | None
) -> None:
    """Call the model with the parsed flags, and print the path and a report of the mesh.

    Errors in the user's input end the script with one sentence and exit code 2.
    """
    options = vars(parser.parse_args(argv))
    try:
        path = model(options.pop("out"), **options)
    except (ValueError, RuntimeError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    report = ""
    with suppress(ValueError):  # a plane mesh has no solids
        report = f": {describe(path)}"
    print(f"{path}{report}")
