# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a STEP file before Open CASCADE reads it, which crashes on wrong ones."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from dolfinx_joints.common.parameters import check_file, shown
from dolfinx_joints.geometry.meshing.step_options import FARTHEST

_BEGIN, _END = b"ISO-10303-21;", b"END-ISO-10303-21;"
# Points of a STEP file and their numbers; the unit that lengths are given in.
_POINT = re.compile(r"CARTESIAN_POINT\s*\(\s*'[^']*'\s*,\s*\(([^()]*)\)")
_LENGTH = re.compile(r"LENGTH_UNIT\s*\(\s*\)[^;]*SI_UNIT\s*\([^()]*\.METRE\.|CONVERSION_BASED_UNIT")
# Texts and comments; entities; lists without lists inside, or several entities in one.
_ASIDE = re.compile(r"'(?:[^']|'')*'|/\*.*?\*/", re.S)
_ENTITY = re.compile(r"\s*#0*([1-9]\d{0,8})\s*=(.*)", re.S)
_ATOM = r"\s*(?:\$|\*|#\d+|[+-]?\d+(?:\.\d*)?(?:[Ee][+-]?\d+)?|\.\w+\.|\"\w*\")\s*"
_LIST = re.compile(rf"(?:!?[A-Z]\w*\s*)?\((?:{_ATOM}(?:,{_ATOM})*|\s*)\)|\((?:\s*\$){{2,}}\s*\)")
_REFERENCE = re.compile(r"#0*(\d+)")
_TYPED = re.compile(r"\s*!?[A-Z]\w*\s*\(.*\)\s*|\s*\(\s*!?[A-Z]\w*\s*\(.*\)\s*\)\s*", re.S)
_SOLID = re.compile(r"\b(?:MANIFOLD_SOLID_BREP|FACETED_BREP|BREP_WITH_VOIDS)\s*\(")
_TRIAL = """import os, sys, gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
try:
    gmsh.model.occ.importShapes(sys.argv[1])
    gmsh.model.occ.synchronize()
except Exception:  # raised where it is read again
    pass
os._exit(0)
"""


def check_step_file(step: Path) -> int:
    """Return how many solids the file describes.

    Raises:
        ValueError: if it does not look like a whole STEP file.
        RuntimeError: if it could not be read in a process of its own.
    """
    check_file(step, f"The STEP file {str(step)!r} does not exist.")
    with step.open("rb") as file:
        head = file.read(200).lstrip()
        file.seek(max(0, step.stat().st_size - 200))
        tail = file.read().rstrip()
    if not head:
        raise ValueError(f"{step} is empty.")
    if not head.startswith(_BEGIN):
        raise ValueError(f"{step} is no STEP file: it does not begin with 'ISO-10303-21;'.")
    if not tail.endswith(_END):
        raise ValueError(f"{step} is truncated: it does not end with 'END-ISO-10303-21;'.")
    solids = _check_content(step)
    _try_reading(step)
    return solids


def _try_reading(step: Path) -> None:
    """Read the file in a process of its own, which Open CASCADE may take with it.

    Raises:
        ValueError: if that process crashed or was ended.
        RuntimeError: if it could not read anything.
    """
    # Nothing in the working folder is imported; under mpirun the other process is no rank.
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMI", "PRTE_"))}
    kept["PYTHONPATH"] = os.pathsep.join(p for p in map(str, sys.path) if p not in ("", os.curdir))
    command = [sys.executable, "-P", "-c", _TRIAL, str(step)]
    try:
        tried = subprocess.run(command, env=kept, stdin=subprocess.DEVNULL, capture_output=True)
    except OSError as error:
        raise RuntimeError(f"{step} could not be tried in a process of its own: {error}.") from None
    if tried.returncode in (-signal.SIGSEGV, -signal.SIGBUS, -signal.SIGFPE, -signal.SIGABRT):
        raise ValueError(
            f"{step} cannot be read: Open CASCADE crashes on it (signal {-tried.returncode})."
        )
    if tried.returncode < 0:
        raise ValueError(
            f"{step} cannot be read: the process that tried it was ended by signal "
            f"{-tried.returncode}, as where memory does not suffice."
        )
    if tried.returncode > 0:
        last = shown(tried.stderr.decode(errors="replace").rstrip().rpartition("\n")[2], str)
        raise RuntimeError(f"{step} could not be tried in a process of its own: {last}.")


def _check_content(step: Path) -> int:
    """Raise ValueError on what Open CASCADE reads in silence: no numbers, no unit of length.

    Returns the number of solids.
    """
    text = step.read_text("latin-1")
    points = list(_POINT.finditer(text))
    for found in points:
        try:
            good = all(abs(float(number)) < FARTHEST for number in found[1].split(","))
        except ValueError:
            good = False
        if not good:
            raise ValueError(
                f"{step} has a point at ({shown(found[1].strip(), str)}); coordinates must be "
                f"numbers below {FARTHEST:g}."
            )
    if points and not _LENGTH.search(text):
        raise ValueError(f"{step} names no unit of length in metres or a part or multiple of them.")
    return _check_entities(step, text)


def _check_entities(step: Path, text: str) -> int:
    """Raise ValueError where Open CASCADE might crash: entities that are none, or form a ring.

    Returns the number of solids.
    """
    _, begin, rest = _ASIDE.sub(lambda found: "$" if found[0][0] == "'" else " ", text).partition(
        "DATA;"
    )
    data, end, _ = rest.partition("ENDSEC;")
    if not (begin and end):
        raise ValueError(f"{step} has no section 'DATA;' that ends with 'ENDSEC;'.")
    *entities, last = data.split(";")
    entities += [last] if last.strip() else []
    refers: dict[str, list[str]] = {}
    for entity in entities:
        found = _ENTITY.fullmatch(entity)
        if found is None or found[1] in refers or not _is_value(found[2]):
            raise ValueError(
                f"{step} has {shown(entity, str)!r}, which is no entity '#number = NAME(...)' with "
                "a number of its own."
            )
        refers[found[1]] = _REFERENCE.findall(found[2])
    lost = {number for numbers in refers.values() for number in numbers} - refers.keys()
    if lost:
        raise ValueError(f"{step} refers to #{min(lost)}, which it does not hold.")
    try:
        TopologicalSorter(refers).prepare()
    except CycleError as error:
        raise ValueError(
            f"{step} has an entity #{error.args[1][0]} that refers to itself."
        ) from None
    return sum(_SOLID.search(entity) is not None for entity in entities)


def _is_value(text: str) -> bool:
    """Whether a text is NAME(...), or several of them in brackets, with lists in them."""
    if not _TYPED.fullmatch(text):
        return False
    before = ""
    while text != before:
        before, text = text, _LIST.sub("$", text)
    return text.strip() == "$"
