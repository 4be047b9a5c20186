# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Input of `from_step`: names, points, planes and faces, and the STEP file.

The file is checked before Open CASCADE reads it, which crashes on invalid files.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from dolfinx_joints.common.parameters import check_file, real, shown

# Plane such as ("z", "min"), direction such as ("-x", 40.0), point [m], or name of a face.
Where = tuple[str, float | str] | Sequence[float] | str

UNNAMED_SURFACE = "outside"
PLANE_FORM = "NAME=DIP,DIRECTION,X,Y,Z"
_NEAR = 1e-4  # largest distance of a point from its face, relative to the body's extent
_AXES = ("x", "y", "z")
_DIRECTIONS = ("+x", "-x", "+y", "-y", "+z", "-z")
FARTHEST = 1e9  # limit of coordinates [m]; in a STEP file, in the unit of the file


def is_point(point: Any) -> bool:
    """Return True if ``point`` is three coordinates."""
    sequence = isinstance(point, Sequence | np.ndarray) and not isinstance(point, str | bytes)
    return sequence and len(point) == 3 and all(abs(real(x)) < FARTHEST for x in point)


def _is_at_axis(where: Any, axes: Sequence[str]) -> bool:
    """Return True if ``where`` is one of the axes with a number, or with "min" or "max"."""
    if isinstance(where, str) or not isinstance(where, Sequence) or len(where) != 2:
        return False
    axis, value = where
    if not isinstance(axis, str) or axis not in axes:
        return False
    return value in ("min", "max") if isinstance(value, str) else abs(real(value)) < FARTHEST


def check_word(subject: str, name: str) -> None:
    """Raise ValueError unless a name consists of letters, digits and '_'."""
    if not re.fullmatch(r"\w+", name) or name == UNNAMED_SURFACE:
        raise ValueError(
            f"{subject} is called {shown(name)}, but names may have only letters, digits and '_', "
            f"and must not be '{UNNAMED_SURFACE}'."
        )


def pair_of(text: str) -> tuple[str, str]:
    """Return the two names of the text A,B."""
    first, comma, second = text.partition(",")
    if not comma or not first or not second or "," in second:
        raise argparse.ArgumentTypeError(f"{text!r} is not A,B")
    return first, second


def named_pair(text: str) -> tuple[str, tuple[str, str]]:
    """Return the name and the pair of the text NAME=A,B."""
    name, _, pair = text.partition("=")
    return name, pair_of(pair)


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of the text A,B,..."""
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not numbers such as 1,2,3") from None


def named_point(text: str, form: str = "NAME=X,Y,Z") -> tuple[str, tuple[float, ...]]:
    """Return the name and the numbers of the text NAME=A,B,..."""
    name, _, values = text.partition("=")
    try:
        return name, numbers(values)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"{text!r} is not {form}") from None


named_plane = partial(named_point, form=PLANE_FORM)


def by_name(option: str, pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the values of an option by name; raise ValueError if a name is given twice."""
    if len(dict(pairs)) < len(pairs):
        raise ValueError(f"two of the {option} have the same name, but names must differ.")
    return dict(pairs)


def named_where(text: str) -> tuple[str, Where]:
    """Return the name and the place of the text NAME:AXIS=VALUE, NAME:X,Y,Z or NAME:FACE."""
    name, _, place = text.partition(":")
    axis, equals, value = place.partition("=")
    try:
        if equals:
            return name, (axis, value if value in ("min", "max") else float(value))
        return name, numbers(place) if place.count(",") == 2 else place
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME:AXIS=VALUE with a number, min or max"
        ) from None


def outer_surfaces(
    solid_of: Mapping[int, int], surfaces: Mapping[str, Where], labels: Mapping[int, str]
) -> dict[str, list[int]]:
    """Return the outer faces of each name; unnamed faces are ``outside``.

    Args:
        solid_of: solid of each outer face.
        surfaces: places by name, see `from_step`.
        labels: names of the faces in the file.
    """
    named: dict[int, str] = {}
    for name, where in surfaces.items():
        check_word("A surface", name)
        if where == "" or name.startswith("joint_"):
            raise ValueError(
                f"The surface {name!r} needs a place, and a name that does not begin with joint_."
            )
        faces, failure = _search(where, [f for f in solid_of if f not in named], solid_of, labels)
        if renamed := [face for face in faces if face in named]:
            faces, failure = [], f"this face is already {named[renamed[0]]!r}"
        if not faces:
            place = "=".join(map(str, where)) if _is_at_axis(where, _AXES) else shown(where)
            raise ValueError(f"The surface {name!r} is at {place}, but {failure}.")
        named |= dict.fromkeys(faces, name)
    groups: dict[str, list[int]] = {}
    for face in solid_of:
        groups.setdefault(named.get(face, UNNAMED_SURFACE), []).append(face)
    return groups


def _search(
    where: Where, unnamed: list[int], solid_of: Mapping[int, int], labels: Mapping[int, str]
) -> tuple[list[int], str]:
    """Return the outer faces at a place, and the reason for an empty list."""
    box = {f: np.reshape(gmsh.model.getBoundingBox(2, f), (2, 3)) for f in solid_of}
    limits = np.array(list(box.values()))
    low, high = limits[:, 0].min(axis=0).round(6) + 0.0, limits[:, 1].max(axis=0).round(6) + 0.0
    near = _NEAR * float(np.max(high - low))
    if isinstance(where, str):
        in_file = ", ".join(sorted(set(labels.values()) - {""})) or "none"
        faces = [face for face in solid_of if labels.get(face) == where]
        return faces, f"no outer face has this name; names in the file: {in_file}"
    if _is_at_axis(where, _AXES):
        k, value = _AXES.index(str(where[0])), where[1]
        level = float({"min": low[k], "max": high[k]}.get(str(value), value))
        return [f for f in unnamed if np.abs(box[f][:, k] - level).max() < 1e-2 * near], (
            f"no unnamed outer face lies in that plane; the body reaches from {where[0]} = "
            f"{low[k]:.6g} to {high[k]:.6g} m. A direction with an angle has a sign, such as "
            f"'+{where[0]}'"
        )
    if _is_at_axis(where, _DIRECTIONS) and 0.0 < real(where[1]) < 90.0:
        angle = {face: _angle(face, solid_of[face], str(where[0]), near) for face in unnamed}
        faces = [face for face in unnamed if angle[face] <= real(where[1])]
        return faces, "no mean normal of an unnamed outer face is within the angle"
    if not is_point(where):
        return [], (
            "it must be x, y or z at a number, 'min' or 'max'; a direction such as '-x' with an "
            "angle between 0 and 90 degrees; a point (x, y, z); or the name of a face in the file"
        )
    tag = gmsh.model.occ.addPoint(*map(float, where))
    distance = {face: gmsh.model.occ.getDistance(0, tag, 2, face)[0] for face in solid_of}
    gmsh.model.occ.remove([(0, tag)])
    faces = [face for face in solid_of if distance[face] < near]
    if len(faces) > 1:
        return [], f"{len(faces)} outer faces meet there; move it into one face"
    return faces, f"the nearest outer face is at a distance of {min(distance.values()):.3g} m"


def _angle(face: int, solid: int, direction: str, step: float) -> float:
    """Return the angle between a direction and the mean outward normal of a face [degrees]."""
    low, high = gmsh.model.getParametrizationBounds(2, face)
    grid = np.stack(np.meshgrid(*2 * [np.arange(0.5, 20) / 20]), axis=-1).reshape(-1, 2)
    uv = low + (high - low) * grid
    uv = uv[[gmsh.model.isInside(2, face, pair, parametric=True) == 1 for pair in uv]]
    tangents = gmsh.model.getDerivative(2, face, uv.ravel()).reshape(-1, 2, 3)
    normals = np.cross(tangents[:, 0], tangents[:, 1])  # their length is an area
    point = gmsh.model.getValue(2, face, uv[0]) + step * normals[0] / np.linalg.norm(normals[0])
    mean = normals.sum(axis=0) * (-1.0 if gmsh.model.isInside(3, solid, point) else 1.0)
    cosine = float(direction[0] + "1") * mean["xyz".index(direction[1])] / np.linalg.norm(mean)
    return float(np.degrees(np.arccos(cosine)))


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
