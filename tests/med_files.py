# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""MED files as Salome writes them: layout of the HDF5 groups and node orders of the MED manual."""

import h5py
import numpy as np

from dolfinx_joints.mesh.cells import vtk_layout

# MED numbers the vertices of a cell the other way round than VTK. Positions in VTK's order.
_BRICK = [0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17]
ORDER = {
    "TE4": [0, 2, 1, 3],
    "T10": [0, 2, 1, 3, 6, 5, 4, 7, 9, 8],
    "HE8": _BRICK[:8],
    "H20": _BRICK,
    "H27": [*_BRICK, 24, 20, 23, 21, 22, 25, 26],
    "PE6": [0, 2, 1, 3, 5, 4],
}
CELLS = {(3, 4): "TE4", (3, 10): "T10", (3, 8): "HE8", (3, 20): "H20", (3, 27): "H27"}
CELLS |= {(2, 3): "TR3", (2, 6): "TR6", (2, 4): "QU4", (2, 9): "QU9"}
FACES = {2: "SE2", 3: "TR3", 4: "QU4"}
STEP = "-0000000000000000001-0000000000000000001"


def in_vtk_order(raw):
    """Return the cells of a `RawMesh` with their nodes in VTK's order."""
    return raw.cells[:, vtk_layout(raw.shape, raw.cells.shape[1])[1]]


def _text(name):
    return np.frombuffer(name.encode().ljust(80, b"\0"), dtype=np.int8)


def _families(file, mesh, part, sign, members, count):
    """Write the families of nodes or elements, and return the family of each of them.

    A node or element has one family, and a family belongs to all groups of its members.
    """
    numbers = np.zeros(count, dtype=np.int64)
    table = np.zeros((count, len(members)), dtype=bool)
    for column, own in enumerate(members.values()):
        table[own, column] = True
    combinations, of = np.unique(table, axis=0, return_inverse=True)
    for k, row in enumerate(combinations):
        if row.any():
            family = file.create_group(f"FAS/{mesh}/{part}/F_{k}")
            family.attrs["NUM"] = sign * (k + 1)
            names = [_text(name) for name, chosen in zip(members, row, strict=True) if chosen]
            groups = family.create_group("GRO")
            groups.attrs["NBR"] = len(names)
            groups["NOM"] = np.array(names)
            numbers[of.ravel() == k] = sign * (k + 1)
    return numbers


def write_med(path, x, blocks, element_sets, node_sets=None, mesh="dam"):
    """Write nodes (n, 3), blocks of elements by MED's type with VTK's order, and sets."""
    node_sets, count = node_sets or {}, sum(len(nodes) for nodes in blocks.values())
    with h5py.File(path, "w") as file:
        of_elements = _families(file, mesh, "ELEME", -1, element_sets, count)
        of_nodes = _families(file, mesh, "NOEUD", 1, node_sets, len(x))
        step = file.create_group(f"ENS_MAA/{mesh}/{STEP}")
        step["NOE/COO"] = x.T.ravel()
        step["NOE/COO"].attrs["NBR"] = len(x)
        step["NOE/FAM"] = of_nodes
        start = 0
        for kind, nodes in blocks.items():
            order = ORDER.get(kind, range(nodes.shape[1]))
            step[f"MAI/{kind}/NOD"] = nodes[:, list(order)].T.ravel() + 1
            step[f"MAI/{kind}/NOD"].attrs["NBR"] = len(nodes)
            step[f"MAI/{kind}/FAM"] = of_elements[start : start + len(nodes)]
            start += len(nodes)


def med_of(raw, path, *, serendipity=False):
    """Write a `RawMesh` as a MED file, with bricks of 20 nodes for those of 27 if wanted."""
    cells, facets = in_vtk_order(raw), list(raw.facet_groups.values())
    cells = cells[:, :20] if serendipity else cells
    x = np.pad(raw.x, ((0, 0), (0, 3 - raw.x.shape[1])))
    blocks = {
        CELLS[raw.shape.dim, cells.shape[1]]: cells,
        FACES[facets[0].shape[1]]: np.concatenate(facets),
    }
    sets, start = dict(raw.cell_groups), len(cells)
    for name, own in raw.facet_groups.items():
        sets[name] = np.arange(start, start := start + len(own))
    write_med(path, x, blocks, sets)
