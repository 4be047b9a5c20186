# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of I-DEAS universal files (``.unv``) into a `FileMesh`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

import numpy as np

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.reading.named_sets import FileMesh

_GROUPS, _OLD_GROUPS = {2435, 2452, 2467, 2477}, {752, 2417, 2429, 2430, 2432}
_BEAMS = (11, 21, 22, 23, 24)  # these elements have an additional line in the file
_SOLIDS = {111: "tetrahedron", 118: "tetrahedron", 112: "wedge", 113: "wedge"}
_SOLIDS |= {115: "hexahedron", 116: "hexahedron"} | dict.fromkeys(_BEAMS, "line")
_PLANES = {1: "triangle", 2: "triangle", 4: "quadrilateral", 5: "quadrilateral"}  # last digit
# The nodes of VTK by kind and number of nodes: I-DEAS goes around a face, corner by corner.
_ORDER = {
    ("line", 3): [0, 2, 1],
    ("triangle", 6): [0, 2, 4, 1, 3, 5],
    ("quadrilateral", 8): [0, 2, 4, 6, 1, 3, 5, 7],
    ("tetrahedron", 10): [0, 2, 4, 9, 1, 3, 5, 6, 7, 8],
    ("hexahedron", 20): [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11],
}


def load_unv(path: Path) -> FileMesh:
    """Read nodes (dataset 2411), elements (2412) and groups (2435, 2452, 2467, 2477)."""
    nodes, x, local_systems = [], [], set()
    rows: dict[tuple[str, int], list[list[int]]] = {}  # label and nodes
    node_sets: dict[str, Ints] = {}
    element_sets: dict[str, Ints] = {}
    for number, lines in _datasets(path):
        if number == 2411:
            for header in lines:
                nodes.append([int(item) for item in header.split()[:2]])  # label, system
                x.append(_floats(next(lines)))
        elif number == 2412:
            for header in lines:
                label, code, *_, count = map(int, header.split())
                if code in _BEAMS:
                    next(lines)
                is_plane = code // 10 in (4, 5, 6, 7, 9)  # elements 81 to 85 are axisymmetric
                kind = _PLANES.get(code % 10) if is_plane else _SOLIDS.get(code)
                kind = kind or f"type {code}"
                own = [int(n) for _ in range(-(-count // 8)) for n in next(lines).split()]
                order = _ORDER.get((kind, count), range(count))
                rows.setdefault((kind, count), []).append([label, *(own[k] for k in order)])
        elif number == 2420:
            part = list(lines)[2:]
            for header, _, *matrix in (part[k : k + 6] for k in range(0, len(part), 6)):
                label, kind_of_system = map(int, header.split()[:2])
                if kind_of_system or not np.array_equal([*map(_floats, matrix)], np.eye(4, 3)):
                    local_systems.add(label)
        elif number in _OLD_GROUPS:
            raise MeshError(f"groups in the dataset {number} are not read; write dataset 2467.")
        elif number in _GROUPS:
            for header in lines:
                count, name = int(header.split()[7]), next(lines).strip()
                entries = [next(lines).split() for _ in range(-(-count // 2))]
                table = np.array([int(n) for row in entries for n in row]).reshape(count, 4)
                if name in node_sets or name in element_sets:
                    raise MeshError(f"two groups have the name {name!r}.")
                members, of_nodes = (np.unique(table[table[:, 0] == code, 1]) for code in (8, 7))
                if len(members) or not len(of_nodes):
                    element_sets[name] = members
                if len(of_nodes):
                    node_sets[name] = of_nodes
    if used := local_systems & {system for _, system in nodes}:
        raise MeshError(
            f"nodes are in the local coordinate system {min(used)}; write the file in global "
            "Cartesian coordinates."
        )
    blocks = [(kind, np.array(own)) for (kind, _), own in rows.items()]
    labels = [label for label, _ in nodes]
    return FileMesh(np.reshape(x, (-1, 3)), blocks, labels, node_sets, element_sets)


def _floats(line: str) -> list[float]:
    return [float(value) for value in line.upper().replace("D", "E").split()]


def _datasets(path: Path) -> Iterator[tuple[int, Iterator[str]]]:
    """Yield the number and the lines of each dataset, which is between two lines with -1."""
    lines = iter(path.read_text(encoding="utf-8-sig", errors="replace").splitlines())
    for line in lines:
        if line.strip() == "-1":
            number, *content = [*takewhile(lambda line: line.strip() != "-1", lines)] or ["0"]
            yield int(number.split()[0].rstrip("b")), iter(content)
