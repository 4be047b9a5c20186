# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of Exodus II files (``.exo``, ``.e``, ``.ex2``, ``.g``) into a `FileMesh`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import netcdf_file

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.reading.named_sets import FileMesh

_KINDS = {"TRI": "triangle", "QUA": "quadrilateral", "SHE": "quadrilateral", "HEX": "hexahedron"}
_KINDS |= {"TET": "tetrahedron", "PYR": "pyramid", "WED": "wedge"}
_KINDS |= dict.fromkeys(("BAR", "BEA", "TRU", "EDG"), "line")
# The nodes of VTK in the order of Exodus: vertical edges before the upper ones, centre first.
_HEX = [*range(12), *range(16, 20), *range(12, 16), 23, 24, 25, 26, 21, 22, 20]
_USED = re.compile("coord[xyz]?$|connect|(elem|side)_ss|node_ns|(eb|ss|ns)_(names|prop1)")
_SIDES = {
    "triangle": {-1: "123", 0: "123", 1: "12", 2: "23", 3: "31"},
    "quadrilateral": {-1: "1234", 0: "1234", 1: "12", 2: "23", 3: "34", 4: "41"},
    "tetrahedron": {1: "124", 2: "234", 3: "143", 4: "132"},
    "hexahedron": {1: "1265", 2: "2376", 3: "3487", 4: "1584", 5: "1432", 6: "5678"},
}


def load_exodus(path: Path) -> FileMesh:
    """Read the mesh, the blocks, the side sets and the node sets of a file."""
    with path.open("rb") as stream:
        start = stream.read(4)
    if start == b"CDF\5":
        raise MeshError("the file has 64-bit data (CDF-5); convert it by nccopy -k nc4 OLD NEW.")
    if start[:3] == b"CDF":
        with netcdf_file(path, "r", mmap=False) as file:
            return _mesh(file.variables)
    with h5py.File(path, "r") as file:
        return _mesh(file)


def _mesh(variables: Mapping[str, Any]) -> FileMesh:
    """Return the content of variables of SciPy or h5py."""
    used = [name for name in variables if _USED.match(name)]
    values = {name: np.asarray(variables[name][...]) for name in used}
    axes = [values[f"coord{axis}"] for axis in "xyz" if f"coord{axis}" in values]
    x = np.stack(axes, axis=1) if axes else values["coord"].T
    blocks, element_sets, shells, start = [], {}, [], 1
    for k, name in _names(values, "eb", "block").items():
        if f"connect{k}" in values:
            kind, letters, nodes = _block(variables[f"connect{k}"], values[f"connect{k}"])
            element_sets[name] = np.arange(start, start := start + len(nodes))
            blocks.append((kind, np.column_stack([element_sets[name], nodes])))
            if letters == "SHE" or (letters == "TRI" and x.shape[1] == 3):
                shells.append(element_sets[name])
    none = np.empty(0, dtype=np.int64)
    node_sets = {
        name: values.get(f"node_ns{k}", none) for k, name in _names(values, "ns", "nodeset").items()
    }
    mesh = FileMesh(x, blocks, np.arange(1, len(x) + 1), node_sets, element_sets)
    for k, name in _names(values, "ss", "sideset").items():
        sides, own = (values.get(f"{part}_ss{k}", none) for part in ("side", "elem"))
        # Sides 1 and 2 of a shell are its faces; its edges have the numbers from 3.
        sides = sides - 2 * np.isin(own, np.concatenate([none, *shells]))
        mesh.facets[name] = []
        for side in np.unique(sides):
            mesh.add_sides(name, own[sides == side], int(side), _SIDES)
    return mesh


def _block(variable: Any, nodes: Ints) -> tuple[str, str, Ints]:
    """Return the kind, the first letters of the type, and the nodes of a block of elements."""
    attributes = variable.attrs if hasattr(variable, "attrs") else variable._attributes
    name = attributes["elem_type"]
    name = name.decode() if isinstance(name, bytes) else str(name)
    letters = name[:3].upper()
    kind = _KINDS.get(letters, name)
    if kind == "quadrilateral" and nodes.shape[1] in (3, 6):
        kind = "triangle"  # SHELL3
    order = _HEX[: nodes.shape[1]] if kind == "hexahedron" else range(nodes.shape[1])
    return kind, letters, nodes[:, list(order)]


def _names(values: Mapping[str, Any], part: str, word: str) -> dict[int, str]:
    """Return the names of blocks or sets by their position from 1; the default is WORD_ID."""
    ids = values.get(f"{part}_prop1", np.empty(0, dtype=np.int64)).tolist()
    letters = values.get(f"{part}_names", [[b""]] * len(ids))
    ids = ids or range(1, len(letters) + 1)
    texts = [b"".join(row).partition(b"\0")[0].decode().strip() for row in letters]
    names = [text or f"{word}_{number}" for text, number in zip(texts, ids, strict=True)]
    if len(set(names)) < len(names):
        raise MeshError(f"several {word}s have the same name: {', '.join(names)}.")
    return dict(enumerate(names, 1))
