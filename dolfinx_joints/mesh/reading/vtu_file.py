# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of VTK files of unstructured grids (``.vtu``) into a `FileMesh`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.reading.named_sets import FileMesh

_KINDS = {  # by the numbers of the linear, quadratic and Lagrange cells of VTK
    **dict.fromkeys((3, 21, 68), "line"),
    **dict.fromkeys((5, 22, 69), "triangle"),
    **dict.fromkeys((9, 23, 28, 70), "quadrilateral"),
    **dict.fromkeys((10, 24, 71), "tetrahedron"),
    **dict.fromkeys((12, 25, 29, 72), "hexahedron"),
    **dict.fromkeys((13, 26, 32, 73), "wedge"),
    **dict.fromkeys((14, 27, 37, 74), "pyramid"),
}


def load_vtu(path: Path) -> FileMesh:
    """Read the grid, and a set for each value of each integer array of cells or points."""
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader
    except ImportError:
        raise MeshError(
            "VTK reads .vtu files and is not installed; install it by python3 -m pip install vtk."
        ) from None
    reader, errors = vtkXMLUnstructuredGridReader(), []
    reader.AddObserver("ErrorEvent", lambda *_: errors.append(True))
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    if errors or not grid.GetNumberOfCells():
        raise MeshError("VTK cannot read the file, or it has no cells.")
    kinds = vtk_to_numpy(grid.GetCellTypesArray()).astype(np.int64)
    offsets = vtk_to_numpy(grid.GetCells().GetOffsetsArray())
    nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).astype(np.int64)
    width = np.diff(offsets)
    blocks = []
    for kind, count in np.unique(np.column_stack([kinds, width]), axis=0):
        chosen = np.flatnonzero((kinds == kind) & (width == count))
        rows = nodes[offsets[chosen][:, None] + np.arange(count)]
        name = _KINDS.get(int(kind), f"VTK cell type {kind}")
        blocks.append((name, np.column_stack([chosen, rows])))
    x = vtk_to_numpy(grid.GetPoints().GetData()).astype(np.float64)
    node_sets = _sets(grid.GetPointData(), vtk_to_numpy, without=0)
    element_sets = _sets(grid.GetCellData(), vtk_to_numpy)
    return FileMesh(x, blocks, np.arange(len(x)), node_sets, element_sets)


def _sets(data: Any, array_of: Any, without: int | None = None) -> dict[str, Ints]:
    """Return the members of each set: NAME if the array has 0 and 1 only, otherwise NAME_VALUE.

    An array with a distinct value for each cell or point is a numbering, and has no sets. Arrays
    of floats have sets only if all values are whole numbers.
    """
    sets = {}
    for k in range(data.GetNumberOfArrays()):
        name, values = data.GetArrayName(k), data.GetArray(k)
        values = np.empty(0) if values is None else array_of(values)
        if values.dtype.kind == "f" and values.any() and (values == np.round(values)).all():
            values = values.astype(np.int64)  # some programs write numbers of groups as floats
        if name.startswith("vtk") or values.ndim != 1 or values.dtype.kind not in "iu":
            continue
        distinct = np.unique(values)
        if set(distinct.tolist()) <= {0, 1}:
            sets[name] = np.flatnonzero(values)
        elif len(distinct) < len(values):
            chosen = distinct[distinct != without]
            sets |= {f"{name}_{value}": np.flatnonzero(values == value) for value in chosen}
    return sets
