# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checked meshes from arrays of nodes, cells and groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_choice, check_named, finite, numbers_of, shown
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints, RawMesh, inside_out

_DIMENSION = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


def mesh_of_arrays(
    cell: str, x: Any, cells: Any, facet_groups: Mapping[str, Any], cell_groups: Mapping[str, Any]
) -> RawMesh:
    """Return the mesh of the arguments of `mesh_from_arrays`."""
    check_choice("cell", cell, _DIMENSION)
    for argument, given in (("facet_groups", facet_groups), ("cell_groups", cell_groups)):
        check_named(argument, given, "an array by name")
    points, gdim = numbers_of(x), _DIMENSION[cell]
    if points is None or points.ndim != 2 or points.shape[1] != gdim or not finite(points):
        wanted = f"a {cell} mesh needs finite numbers of shape (n, {gdim})"
        raise MeshError(f"x is {_text_of(x, points)}; {wanted}.")
    shapes = {s.element().dim: s for s in (CellShape(name=cell, degree=d) for d in (1, 2))}
    nodes = _indices("cells", cells, "nodes", len(points), tuple(shapes))
    shape = shapes[nodes.shape[1]]
    corners = shape.facet_vertices.shape[1]
    inverted = inside_out(shape, points, nodes)
    if len(inverted):
        raise MeshError(
            f"{len(inverted)} cells are partly inside out, the first is cell {inverted[0]}; nodes "
            "must be in the order of DOLFINx, see the docstring of mesh_from_arrays."
        )
    return RawMesh(
        shape=shape,
        cells=nodes,
        x=points,
        cell_groups={
            name: _indices(f"The cell group {name!r}", numbers, "cells", len(nodes))
            for name, numbers in cell_groups.items()
        },
        facet_groups={
            name: _indices(f"The facet group {name!r}", numbers, "nodes", len(points), (corners,))
            for name, numbers in facet_groups.items()
        },
    )


def _text_of(given: Any, array: Floats | None) -> str:
    return shown(given) if array is None else f"an array of shape {array.shape}"


def _indices(name: str, given: Any, of: str, count: int, columns: tuple[int, ...] = ()) -> Ints:
    """Return numbers of nodes or cells, shape (n,) or (n, one of ``columns``)."""
    array = numbers_of(given)
    fits = array is not None and array.ndim == (2 if columns else 1) and array.size > 0
    if array is None or not fits or (columns and array.shape[1] not in columns):
        wanted = f"(n, {' or '.join(map(str, columns))})" if columns else "(n,)"
        raise MeshError(
            f"{name} is {_text_of(given, array)}; numbers of {of} of shape {wanted} are needed."
        )
    if array.min() < 0 or array.max() >= count or np.any(array != np.rint(array)):
        raise MeshError(
            f"{name} has numbers from {array.min():.15g} to {array.max():.15g}; the {of} are "
            f"numbered from 0 to {count - 1}."
        )
    return array.astype(np.int64)
