# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reader of Abaqus and CalculiX input files (``.inp``) into a `FileMesh`."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_file, shown
from dolfinx_joints.mesh.reading.named_sets import FileMesh

_SOLIDS = {5: "pyramid", 13: "pyramid", 6: "wedge", 15: "wedge"}
_SOLIDS |= dict.fromkeys((4, 10), "tetrahedron") | dict.fromkeys((8, 20, 27), "hexahedron")
_TYPES = {  # kinds by the number of nodes, which is in the name of a type
    r"D?C3D(\d+)": _SOLIDS,
    r"COH[23]D(\d)(?!P)": dict.fromkeys((4, 6, 8), "cohesive"),
    r"(?:CP[SE]G?|DC2D|D?S|STRI|M3D|SFM3D|R3D)([34689])": dict.fromkeys((3, 6), "triangle")
    | dict.fromkeys((4, 8, 9), "quadrilateral"),
    r"(?:T[23]D|R2D)([23])": dict.fromkeys((2, 3), "line"),
}
_C3D27 = [*range(21), 27, 25, 24, 26, 22, 23, 21]  # in Abaqus the centre is before the faces
_SIDES = {
    "triangle": dict(S1="12", S2="23", S3="31", SPOS="123", SNEG="123"),
    "quadrilateral": dict(S1="12", S2="23", S3="34", S4="41", SPOS="1234", SNEG="1234"),
    "tetrahedron": dict(S1="123", S2="142", S3="243", S4="341"),
    "hexahedron": dict(S1="1234", S2="5876", S3="1562", S4="2673", S5="3784", S6="4851"),
}
_QUOTES = " \t\"'"
_GENERATED = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM"}

Sets = dict[str, tuple[str, list[int | str]]]  # name, and labels or names of other sets


def load_inp(path: Path) -> FileMesh:
    """Read nodes, elements, sets and surfaces of a file with at most one instance of a part."""
    content = _Content()
    for keyword, options, lines in _sections(path):
        content.add(keyword, options, lines)
    return content.mesh()


class _Content:
    """Nodes, elements, sets and surfaces of the sections that were added, with their labels."""

    def __init__(self) -> None:
        self.x: list[list[float]] = []
        self.blocks: list[tuple[str, Ints]] = []
        self.nodes: list[Any] = []
        self.sets: dict[str, Sets] = {"NSET": {}, "ELSET": {}}
        self.internal: set[str] = set()
        self.surfaces: list[tuple[dict[str, str], list[str]]] = []
        self.instances = 0
        self.of_part: set[tuple[str, str]] = set()  # sets of the part, if there is an assembly

    def add(self, keyword: str, options: dict[str, str], lines: list[str]) -> None:
        """Add a section."""
        self._check_position(keyword, options, lines)
        entity = "NSET" if keyword in ("NODE", "NSET") else "ELSET"
        members: list[Any] = []
        if keyword == "NODE":
            rows = [line.upper().replace("D", "E").split(",") for line in lines]
            self.x += [
                [float(item.strip() or 0) for item in [*row[1:], "", ""][:3]] for row in rows
            ]
            members = [int(row[0]) for row in rows]
            self.nodes += members
        elif keyword == "ELEMENT":
            self.blocks.append(_elements(options.get("TYPE", "").upper(), lines))
            members = list(map(int, self.blocks[-1][1][:, 0]))
        elif keyword in ("NSET", "ELSET"):
            members = _members(options, lines)
            self.internal |= {options.get(entity, "").upper()} if "INTERNAL" in options else set()
        elif keyword == "SURFACE" and "INTERNAL" not in options:
            self.surfaces.append((options, lines))
        if keyword in ("NODE", "ELEMENT", "NSET", "ELSET") and (name := options.get(entity)):
            self.sets[entity].setdefault(name.upper(), (name, []))[1].extend(members)

    def _check_position(self, keyword: str, options: dict[str, str], lines: list[str]) -> None:
        """Check that nodes are listed in global coordinates, and that names have one meaning."""
        self.instances += keyword == "INSTANCE"
        if keyword == "ASSEMBLY":
            self.of_part = {(entity, name) for entity in self.sets for name in self.sets[entity]}
        if keyword == "NODE" and options.get("SYSTEM", "R").upper() != "R":
            problem = f"nodes with SYSTEM={options['SYSTEM']} are not in Cartesian coordinates"
        elif keyword in _GENERATED or self.instances > 1 or (keyword == "INSTANCE" and lines):
            problem = f"*{keyword} moves or generates nodes and is not read"
        elif (keyword, options.get(keyword, "").upper()) in self.of_part:
            problem = f"the part and the assembly have a set {options[keyword]!r}"
        elif keyword == "NODE" and self.instances and lines and self.x:
            problem = "the assembly has additional nodes, for example reference points"
        else:
            return
        raise MeshError(
            f"{problem}; write the file without parts and instances (noPartsInputFile=ON in "
            "Abaqus/CAE)."
        )

    def mesh(self) -> FileMesh:
        """Return the mesh with numbers instead of labels."""
        nodes, elements = (
            {
                name: _labels(self.sets[entity], key)
                for key, (name, _) in self.sets[entity].items()
                if key not in self.internal
            }
            for entity in ("NSET", "ELSET")
        )
        x = np.array(self.x).reshape(-1, 3)
        mesh = FileMesh(x, self.blocks, self.nodes, nodes, elements)
        for options, lines in self.surfaces:
            name = options.get("NAME", "")
            mesh.facets.setdefault(name, [])
            if options.get("TYPE", "ELEMENT").upper() != "ELEMENT" or "COMBINE" in options:
                continue  # a surface of nodes or of other surfaces
            for line in lines:
                item, face = [*line.split(","), ""][:2]
                members = _labels(self.sets["ELSET"], _member(item))
                mesh.add_sides(name, members, face.strip().upper(), _SIDES)
        return mesh


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file and of its included files, without comments."""
    check_file(path, f"the included file {str(path)!r} does not exist.", MeshError)
    for raw in path.read_text(encoding="utf-8-sig", errors="replace").splitlines():
        line = raw.strip()
        if line.upper().replace(" ", "").startswith("*INCLUDE,"):
            yield from _lines(path.parent / _options(line)["INPUT"])
        elif line and not line.startswith("**"):
            yield line


def _options(header: str) -> dict[str, str]:
    """Return the parameters of a keyword line."""
    pairs = [parameter.partition("=") for parameter in header.split(",")[1:]]
    return {key.strip().upper(): value.strip(_QUOTES) for key, _, value in pairs}


def _sections(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Yield the keyword, the parameters and the data lines of each section."""
    header, lines = "", []
    for line in itertools.chain(_lines(path), ["*END"]):
        if header.endswith(",") and not line.startswith("*") and not line[0].isdigit():
            header += line
        elif not line.startswith("*"):
            lines.append(line)
        else:
            keyword, options = " ".join(header[1:].split(",")[0].upper().split()), _options(header)
            if keyword in ("NODE", "ELEMENT") and "INPUT" in options:
                lines += _lines(path.parent / options["INPUT"])
            yield keyword, options, lines
            header, lines = line, []


def _elements(name: str, lines: list[str]) -> tuple[str, Ints]:
    """Return the kind, and the label and nodes of the elements of a section."""
    for pattern, kinds in _TYPES.items():
        if (found := re.match(pattern, name)) and (count := int(found[1])) in kinds:
            items = [int(item) for item in ",".join(lines).split(",") if item.strip()]
            table = np.array(items, dtype=np.int64).reshape(-1, count + 1)
            return kinds[count], table[:, _C3D27] if count == 27 else table
    # The nodes are not needed; an element continues after a line that ends with a comma.
    starts = [k == 0 or not lines[k - 1].endswith(",") for k in range(len(lines))]
    labels = [int(line.split(",")[0]) for line, start in zip(lines, starts, strict=True) if start]
    return name or "element without a type", np.array(labels).reshape(-1, 1)


def _members(options: dict[str, str], lines: list[str]) -> list[int | str]:
    """Return the labels, and the names of other sets, in the lines of a set."""
    rows = [[item for item in line.split(",") if item.strip()] for line in lines]
    if "NSET" in options and "ELSET" in options:
        raise MeshError(f"the node set {options['NSET']!r} is given by elements; list its nodes.")
    if "GENERATE" not in options:
        return [_member(item) for row in rows for item in row]
    ranges = [(*map(int, row), 1)[:3] for row in rows]
    return [label for first, last, step in ranges for label in range(first, last + 1, step)]


def _member(item: str) -> int | str:
    """Return a label, or the name of a set."""
    name = item.strip(_QUOTES)
    return int(name) if name.isdigit() else name


def _labels(sets: Sets, item: int | str, within: tuple[str, ...] = ()) -> list[int]:
    """Return the distinct labels of a label or of the set of a name, which may contain sets."""
    if isinstance(item, int):
        return [item]
    name = item.upper()
    key = name if name in sets else name.rpartition(".")[2]  # INSTANCE.NAME or INSTANCE.LABEL
    if key.isdigit() and key not in sets:
        return [int(key)]
    if key not in sets or key in within:
        raise MeshError(f"the set {shown(item)} is used, but the file does not define it.")
    inner = (_labels(sets, member, (*within, key)) for member in sets[key][1])
    return sorted({label for labels in inner for label in labels})
