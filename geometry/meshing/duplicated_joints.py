# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Duplication of the joint faces of a Gmsh model: group NAME becomes NAME- and NAME+.

`split_cells` selects the nodes to duplicate and the - side of each joint, as in `read_msh`. A
duplicated and a conforming file therefore give the same split mesh. Gmsh's plugin Crack is not
used, because it leaves blocks connected where joints cross.
"""

from __future__ import annotations

from collections.abc import Iterable

import gmsh
import numpy as np

from dolfinx_joints.geometry.meshing.extrusion import IntArray
from dolfinx_joints.mesh.cells import find_facets
from dolfinx_joints.mesh.dolfinx_versions import gmsh_permutation
from dolfinx_joints.mesh.reading.gmsh_file import cell_shape
from dolfinx_joints.mesh.splitting import split_cells


def duplicate_joints() -> None:
    """Duplicate the faces of all groups of the current model whose names start with ``joint``.

    Cells and nodes keep their order. Each group of facets gets a separate entity.

    Raises:
        MeshError: if a joint facet does not have one cell on each side, or a joint cannot open.
    """
    model, mesh = gmsh.model, gmsh.model.mesh
    dim = model.getDimension()
    groups = {group: model.getPhysicalName(*group) for group in model.getPhysicalGroups(dim - 1)}
    joints = [group for group, name in groups.items() if name.lower().startswith("joint")]
    if not joints:
        return
    bodies = {tag: _elements(dim, [tag]) for _, tag in model.getEntities(dim)}
    facets = {g: _elements(dim - 1, model.getEntitiesForPhysicalGroup(*g)) for g in groups}
    shape = cell_shape({kind for kind, _ in bodies.values()}, "the model")
    per_cell, corners = shape.facet_vertices.shape
    nodes = np.vstack([rows for _, rows in bodies.values()])
    order = gmsh_permutation(shape.name, nodes.shape[1])
    cells = nodes[:, order]
    tags, points, _ = mesh.getNodes()
    x = np.zeros((int(tags.max()) + 1, 3))
    x[tags] = points.reshape(-1, 3)
    surfaces = [(groups[group], facets[group][1][:, :corners]) for group in joints]
    split = split_cells(shape, cells, x[:, :dim], surfaces)
    added = np.arange(len(x), len(split.parent))
    mesh.addNodes(dim, next(iter(bodies)), added, x[split.parent[added]].ravel())
    nodes[:, order] = split.cells
    for tag, (kind, rows) in bodies.items():
        mesh.removeElements(dim, tag)
        mesh.addElementsByType(tag, kind, [], nodes[: len(rows)].ravel())
        nodes = nodes[len(rows) :]
    for _, tag in model.getEntities(dim - 1):
        mesh.removeElements(dim - 1, tag)
    model.removePhysicalGroups(list(groups))
    for group, name in groups.items():
        kind, rows = facets[group]
        owner, _ = find_facets(shape, cells, rows[:, :corners])
        slots = owner @ [per_cell, 1]  # unique number of each facet of each cell
        sides = {name: slots[:, 0]}
        if group in joints:
            slots_by_side = {f"{name}-": split.minus, f"{name}+": split.plus}
            sides = {side: chosen @ [per_cell, 1] for side, chosen in slots_by_side.items()}
        for side, chosen in sides.items():
            row, facet = np.nonzero(np.isin(slots, chosen))
            cell = owner[row, facet, 0]
            place = np.argmax(cells[cell][:, None, :] == rows[row][:, :, None], axis=2)
            entity = model.addDiscreteEntity(dim - 1)
            flat = np.take_along_axis(split.cells[cell], place, axis=1).ravel()
            mesh.addElementsByType(entity, kind, [], flat)
            model.addPhysicalGroup(dim - 1, [entity], -1, side)


def _elements(dim: int, entities: Iterable[int]) -> tuple[int, IntArray]:
    """Return the type and the nodes of the elements of some entities, all of one type."""
    elements = [gmsh.model.mesh.getElements(dim, entity) for entity in entities]
    rows = [nodes[0].reshape(len(tags[0]), -1) for _, tags, nodes in elements]
    return int(elements[0][0][0]), np.vstack(rows).astype(np.int64)
