# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""All code that depends on the DOLFINx version (0.9 to 0.11)."""

from __future__ import annotations

import ctypes
import inspect
import logging
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import JointsError


def create_mesh(
    comm: Any, cells: Ints, x: Floats, element: Any, partitioner: Callable[..., Any] | None = None
) -> Any:
    """Create and distribute a mesh (collective). 0.10 swapped the arguments x and element."""
    from dolfinx import mesh

    parameters = list(inspect.signature(mesh.create_mesh).parameters)
    third, fourth = (x, element) if parameters[2] == "x" else (element, x)
    return mesh.create_mesh(comm, cells, third, fourth, partitioner)


def cell_partitioner() -> Callable[..., Any]:
    """Return DOLFINx's partitioner without ghosts. 0.10 added an argument, cells per facet."""
    from dolfinx.mesh import GhostMode, create_cell_partitioner

    try:
        return create_cell_partitioner(GhostMode.none)
    except TypeError:
        return create_cell_partitioner(GhostMode.none, 2)


def adjacency_list(links: NDArray[Any], offsets: NDArray[Any]) -> Any:
    """Return an adjacency list for partitioners. Since 0.10 a Python object wraps the list."""
    from dolfinx.graph import adjacencylist

    made = adjacencylist(links.astype(np.int32), offsets.astype(np.int32))
    return getattr(made, "_cpp_object", made)


def facet_permutations(mesh: Any) -> NDArray[np.uint8]:
    """Return the codes that permute facet quadrature points, (cells * facets per cell,).

    The result is a writable view of the codes that DOLFINx uses in assembly. DOLFINx's Python
    interface only gives read access.

    Raises:
        JointsError: This version of DOLFINx returns a copy.
    """
    mesh.topology.create_entity_permutations()
    codes, second_call = (mesh.topology.get_facet_permutations() for _ in range(2))
    if not codes.size:  # a rank without cells
        return np.empty(0, dtype=np.uint8)
    if codes.ctypes.data != second_call.ctypes.data:
        raise JointsError("This DOLFINx version copies facet permutations; dS cannot be used.")
    first = ctypes.cast(codes.ctypes.data, ctypes.POINTER(ctypes.c_uint8))
    return np.ctypeslib.as_array(first, codes.shape)


def create_submesh(mesh: Any, dim: int, entities: NDArray[np.int32]) -> tuple[Any, Any]:
    """Return the mesh of given entities, and the entity of each cell (since 0.10 from a map)."""
    from dolfinx import mesh as dolfinx_mesh

    made, entity, *_ = dolfinx_mesh.create_submesh(mesh, dim, entities.astype(np.int32))
    if hasattr(entity, "sub_topology_to_topology"):
        cells = made.topology.index_map(dim)
        numbers = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        entity = entity.sub_topology_to_topology(numbers, False)
    return made, np.asarray(entity)


def surface_entity_maps(body: Any, surface: Any, facets: NDArray[Any], cells: NDArray[Any]) -> Any:
    """Return the entity maps for `fem.form` from facets of the body to cells of the surface.

    Since 0.10 an entity map is one to one, from cells of a submesh to entities of a mesh, and
    works in both directions. Here several facets have the same cell, so the surface is passed as
    the mesh and the body as the submesh.
    """
    from dolfinx import mesh

    facet_map = body.topology.index_map(body.topology.dim - 1)
    cell_of_facet = np.full(facet_map.size_local + facet_map.num_ghosts, -1, dtype=np.int32)
    cell_of_facet[facets] = cells
    if not hasattr(mesh, "entity_map"):
        return {surface: cell_of_facet}
    return [mesh.entity_map(surface.topology, body.topology, surface.topology.dim, cell_of_facet)]


def merged_entity_maps(maps: Sequence[Any]) -> Any:
    """Merge several `surface_entity_maps` for `fem.form`; None if there are no maps (0.10)."""
    if maps and isinstance(maps[0], dict):
        return {mesh: cells for one_map in maps for mesh, cells in one_map.items()}
    return [entity_map for one_map in maps for entity_map in one_map] or None


def permuted_points(facet_vertices: int, points: Floats, code: int) -> Floats:
    """Return the points of a reference facet permuted by an FFCx code, (n, facet dimension)."""
    from ffcx.ir import elementtables

    if facet_vertices == 2:
        permuted = elementtables.permute_quadrature_interval(points, code)
    else:
        kind = {3: "triangle", 4: "quadrilateral"}[facet_vertices]
        permute = getattr(elementtables, f"permute_quadrature_{kind}")
        permuted = permute(points, code % 2, code // 2)
    return np.asarray(permuted)


def geometry_nodes(mesh: Any) -> NDArray[np.int32]:
    """Return the nodes of the local cells, (cells, nodes of a cell). 0.11 has a list of dofmaps."""
    geometry = mesh.geometry
    dofmap = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    return np.asarray(dofmap, dtype=np.int32)


def geometry_degree(mesh: Any) -> int:
    """Return the degree of the cell geometry. 0.11 has a list of coordinate maps."""
    geometry = mesh.geometry
    coordinate_map = geometry.cmaps[0] if hasattr(geometry, "cmaps") else geometry.cmap
    return int(coordinate_map.degree)


def gmsh_permutation(cell_name: str, num_nodes: int) -> Ints:
    """Return the map from Gmsh's node order to DOLFINx's; 0.10 renamed the module."""
    from dolfinx.mesh import CellType

    try:
        from dolfinx.io.gmsh import cell_perm_array
    except ImportError:
        from dolfinx.io.gmshio import cell_perm_array
    return np.asarray(cell_perm_array(getattr(CellType, cell_name), num_nodes), dtype=np.int64)


def petsc_code(error: Exception) -> int:
    """Return the PETSc code of a SLEPc error. slepc4py 3.25 wraps the error in a SystemError."""
    cause = error.__cause__ if isinstance(error, SystemError) else error
    code = getattr(cause, "ierr", None)
    if code is None:
        raise error
    return int(code)


def interpolation_points(V: Any) -> Floats:
    """Return the reference points of interpolation, a property instead of a method since 0.10."""
    points = V.element.interpolation_points
    return np.asarray(points() if callable(points) else points)


def _show_warnings() -> None:
    """Undo FFCx 0.9's redirection of warnings to logging, unless a handler shows them."""
    import ffcx  # noqa: F401, redirects the warnings on import

    loggers = (logging.getLogger(), logging.getLogger("py.warnings"))
    handlers = [h for logger in loggers for h in logger.handlers]
    unseen = all(isinstance(h, logging.NullHandler) for h in handlers)
    if unseen and warnings.showwarning is getattr(logging, "_showwarning", None):
        logging.captureWarnings(False)


_show_warnings()
