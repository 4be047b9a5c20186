# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of MED files of Salome and code_aster (``.med``) into a `FileMesh`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.reading.named_sets import FileMesh

_KINDS = {"SE": "line", "TR": "triangle", "QU": "quadrilateral", "TE": "tetrahedron"}
_KINDS |= {"T1": "tetrahedron", "PY": "pyramid", "PE": "wedge", "HE": "hexahedron"}
_KINDS |= {"H2": "hexahedron", "P13": "pyramid", "P1": "wedge"}
_H27 = [*range(20), 24, 22, 21, 23, 20, 25, 26]  # in MED the lower face is the first


def load_med(path: Path) -> FileMesh:
    """Read the mesh and the groups of a file with one mesh at one time."""
    with h5py.File(path, "r") as file:
        meshes = file["ENS_MAA"]
        times = [time for mesh in meshes.values() for time in mesh.values()]
        if len(times) != 1:
            raise MeshError(f"the file has {len(times)} meshes ({', '.join(meshes)}); write one.")
        families = file.get("FAS", {}).get(next(iter(meshes)), {})
        nodes, blocks = times[0]["NOE"], []
        family: Ints = np.empty(0, dtype=np.int64)
        x = nodes["COO"][()].reshape(-1, nodes["COO"].attrs["NBR"]).T
        for name, block in times[0].get("MAI", {}).items():
            rows = block["NOD"][()].reshape(-1, block["NOD"].attrs["NBR"]).T
            labels = len(family) + np.arange(1, len(rows) + 1)
            rows = np.column_stack([labels, rows[:, _H27] if name == "H27" else rows])
            blocks.append((_KINDS.get(name, _KINDS.get(name[:2], name)), rows))
            family = np.append(family, _families(block, len(rows)))
        node_sets = _groups(families.get("NOEUD", {}), _families(nodes, len(x)))
        element_sets = _groups(families.get("ELEME", {}), family)
        return FileMesh(x, blocks, np.arange(1, len(x) + 1), node_sets, element_sets)


def _families(entities: Any, count: int) -> Ints:
    """Return the family number of each node or element, 0 for no family."""
    return entities["FAM"][()] if "FAM" in entities else np.zeros(count, dtype=np.int64)


def _groups(families: Any, family_of: Ints) -> dict[str, Ints]:
    """Return the labels from 1 of the members of each group, which consists of families."""
    numbers: dict[str, list[int]] = {}
    for family in families.values():
        for letters in family["GRO/NOM"][()] if "GRO" in family else ():
            name = bytes(letters.astype(np.uint8)).partition(b"\0")[0].decode().strip()
            numbers.setdefault(name, []).append(family.attrs["NUM"])
    return {name: 1 + np.flatnonzero(np.isin(family_of, own)) for name, own in numbers.items()}
