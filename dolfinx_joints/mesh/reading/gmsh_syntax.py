# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a ``.msh`` file before Gmsh opens it: the file is a mesh, with plausible counts.

Gmsh reports most damage. But Gmsh crashes, or allocates memory without limit, if dimensions of
physical names or counts of nodes and elements are wrong. Formats 4.1 and 2.2 of the Gmsh reference
manual are checked; in format 4.0 only the first counts.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from dolfinx_joints.common.errors import MeshError

_NAMES = re.compile(rb'\s*\d+\s*\n(\s*[0-3]\s+\d{1,9}\s+"[^"\n]*"\s*\n)*\s*\$EndPhysicalNames')
_NAME = re.compile(r'([0-3])\s+(\d+)\s+"([^"\n]*)"')


def check_msh(path: Path) -> dict[tuple[int, int], str]:
    """Check that a file is a mesh with plausible counts, and return its physical names.

    Gmsh reads a file as a mesh if the file begins with a mesh or a section of comments. Gmsh runs
    any other file as a script.

    Returns:
        Name of each physical group by dimension and tag. Gmsh keeps only one group per name.
    """
    data = path.read_bytes()
    if path.suffix != ".msh" or not data.startswith((b"$MeshFormat", b"$Comments")):
        reason = "is empty" if not data else "does not begin with '$MeshFormat'"
        if path.suffix != ".msh":
            reason = "has a name that does not end in '.msh'"
        raise MeshError(f"{str(path)!r} is not a Gmsh mesh file: it {reason}.")
    options = Path(f"{path}.opt")
    if options.exists():
        raise MeshError(
            f"Gmsh would run the file {options.name!r} in the folder of {str(path)!r}; remove it."
        )
    head = _section(data, b"MeshFormat").split(None, 2)[:2]
    binary, current = head[1:] == [b"1"], head[:1] == [b"4.1"]
    for name, content in ((n, _section(data, n.encode())) for n in ("Nodes", "Elements")):
        try:
            fits = not content or (
                _blocks_fit(content, len(data), binary, nodes=current and name == "Nodes")
                if head[0].startswith(b"4")
                else int(content.split(None, 1)[0]) <= len(data)
            )
        except (ValueError, IndexError):
            fits = False
        if not fits:
            raise MeshError(f"{str(path)!r} is damaged: ${name} does not match its header.")
    names = _section(data, b"PhysicalNames")
    match = _NAMES.match(names)
    if names and not (match and match[0].decode(errors="replace").encode() == match[0]):
        raise MeshError(
            f"{str(path)!r} is damaged: lines of $PhysicalNames must be a dimension, a tag and "
            "a name in UTF-8."
        )
    lines = _NAME.findall(match[0].decode()) if match else []
    return {(int(dim), int(tag)): name for dim, tag, name in lines}


def _section(data: bytes, name: bytes) -> bytes:
    """Return the file from the start of a section's content; empty if there is no section."""
    mark = re.search(rb"^\$" + name + rb"[ \t\r]*\n", data, re.MULTILINE)
    return data[mark.end() :] if mark else b""


def _blocks_fit(content: bytes, limit: int, binary: bool, *, nodes: bool) -> bool:
    """Return True if no count exceeds ``limit`` and the node blocks add up to the node count."""
    text = [] if binary else content[: content.find(b"$")].split()
    counts = np.frombuffer(content, "<u8", 2) if binary else text[:2]
    blocks, total = (int(count) for count in counts)
    if max(blocks, total) > limit or not nodes:
        return max(blocks, total) <= limit
    place, counted = 32 if binary else 4, 0
    for _ in range(blocks):
        if binary:
            dim, _, parametric = (int(n) for n in np.frombuffer(content, "<i4", 3, place))
            count = int(np.frombuffer(content, "<u8", 1, place + 12)[0])
        else:
            dim, _, parametric, count = (int(word) for word in text[place : place + 4])
        numbers = count * (4 + dim * parametric)
        place += 20 + 8 * numbers if binary else 4 + numbers
        counted += count
    return counted == total
