# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of a STEP file before Open CASCADE reads it, which crashes on invalid files."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

from dolfinx_joints.common.parameters import check_file, shown
from dolfinx_joints.geometry.meshing.step_options import FARTHEST

_BEGIN, _END = b"ISO-10303-21;", b"END-ISO-10303-21;"
# Points of a STEP file with their coordinates; units of length.
_POINT = re.compile(r"CARTESIAN_POINT\s*\(\s*'[^']*'\s*,\s*\(([^()]*)\)")
_LENGTH = re.compile(r"LENGTH_UNIT\s*\(\s*\)[^;]*SI_UNIT\s*\([^()]*\.METRE\.|CONVERSION_BASED_UNIT")
# Solids with the number of their shell, shells with their faces, faces with their names.
_SOLID = re.compile(
    r"\b(?:MANIFOLD_SOLID_BREP|FACETED_BREP|BREP_WITH_VOIDS)\s*\(\s*'(?:[^']|'')*'\s*,\s*#(\d+)"
)
_SHELL = re.compile(r"#(\d+)\s*=\s*CLOSED_SHELL\s*\(\s*'(?:[^']|'')*'\s*,\s*\(([^)]*)")
_FACE = re.compile(r"#(\d+)\s*=\s*ADVANCED_FACE\s*\(\s*'((?:[^']|'')*)'")
_TRIAL = """import os, sys, gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
try:
    gmsh.model.occ.importShapes(sys.argv[1])
    gmsh.model.occ.synchronize()
except Exception:  # raised again when the file is read for meshing
    pass
os._exit(0)
"""


def check_step_file(step: Path) -> int:
    """Check a STEP file, and return the number of solids that it describes.

    Raises:
        ValueError: if the file is not a complete STEP file.
        RuntimeError: if the file could not be read in a separate process.
    """
    check_file(step, f"The STEP file {str(step)!r} does not exist.")
    with step.open("rb") as file:
        head = file.read(200).lstrip()
        file.seek(max(0, step.stat().st_size - 200))
        tail = file.read().rstrip()
    if not head:
        raise ValueError(f"{step} is empty.")
    if not head.startswith(_BEGIN):
        raise ValueError(f"{step} is not a STEP file: it does not begin with 'ISO-10303-21;'.")
    if not tail.endswith(_END):
        raise ValueError(f"{step} is truncated: it does not end with 'END-ISO-10303-21;'.")
    solids = _check_content(step)
    _try_reading(step)
    return solids


def face_names(step: Path) -> list[str]:
    """Return the names of the faces of all solids, in the order in which Open CASCADE reads them.

    Gmsh has the names of solids only.
    """
    text = step.read_text("latin-1")
    names, faces = dict(_FACE.findall(text)), dict(_SHELL.findall(text))
    numbers = re.findall(r"#(\d+)", "".join(faces.get(n, "") for n in _SOLID.findall(text)))
    return [names.get(number, "") for number in numbers]


def _try_reading(step: Path) -> None:
    """Read the file in a separate process, because Open CASCADE may crash.

    Raises:
        ValueError: if this process crashed or was ended.
        RuntimeError: if this process failed for another reason.
    """
    # Do not import from the working folder, and do not start the process as an MPI rank.
    env = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMI", "PRTE_"))}
    env["PYTHONPATH"] = os.pathsep.join(p for p in map(str, sys.path) if p not in ("", os.curdir))
    command = [sys.executable, "-P", "-c", _TRIAL, str(step)]
    try:
        run = subprocess.run(command, env=env, stdin=subprocess.DEVNULL, capture_output=True)
    except OSError as error:
        raise RuntimeError(f"{step} could not be read in a separate process: {error}.") from None
    if run.returncode in (-signal.SIGSEGV, -signal.SIGBUS, -signal.SIGFPE, -signal.SIGABRT):
        raise ValueError(
            f"{step} cannot be read: Open CASCADE crashes on it (signal {-run.returncode})."
        )
    if run.returncode < 0:
        raise ValueError(
            f"{step} cannot be read: the process that tried it was ended by signal "
            f"{-run.returncode}, perhaps for lack of memory."
        )
    if run.returncode > 0:
        last = shown(run.stderr.decode(errors="replace").rstrip().rpartition("\n")[2], str)
        raise RuntimeError(f"{step} could not be read in a separate process: {last}.")


def _check_content(step: Path) -> int:
    """Check the coordinates and the unit of length, and return the number of solids.

    Open CASCADE itself reads invalid coordinates and a missing unit without an error.
    """
    text = step.read_text("latin-1")
    points = list(_POINT.finditer(text))
    for match in points:
        try:
            valid = all(abs(float(number)) < FARTHEST for number in match[1].split(","))
        except ValueError:
            valid = False
        if not valid:
            raise ValueError(
                f"{step} has a point at ({shown(match[1].strip(), str)}); coordinates must be "
                f"numbers below {FARTHEST:g}."
            )
    if points and not _LENGTH.search(text):
        raise ValueError(f"{step} has no unit of length based on the metre.")
    return len(_SOLID.findall(text))
