# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks and command-line parsing of the names, points and planes passed to `from_step`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from dolfinx_joints.common.parameters import real, shown

Plane = tuple[str, float | str]  # axis "x", "y" or "z"; its value [m], "min" or "max"

UNNAMED_SURFACE = "outside"
FARTHEST = 1e9  # limit of coordinates [m]; in a STEP file, in the unit of the file


def is_point(point: Any) -> bool:
    """Return True if ``point`` is three coordinates."""
    sequence = isinstance(point, Sequence | np.ndarray) and not isinstance(point, str | bytes)
    return sequence and len(point) == 3 and all(abs(real(x)) < FARTHEST for x in point)


def is_plane(plane: Any) -> bool:
    """Return True if ``plane`` is an axis and a coordinate on it."""
    if isinstance(plane, str) or not isinstance(plane, Sequence) or len(plane) != 2:
        return False
    axis, where = plane
    if not isinstance(axis, str) or axis not in ("x", "y", "z"):
        return False
    if isinstance(where, str):
        return where in ("min", "max")
    return abs(real(where)) < FARTHEST


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


def named_point(text: str) -> tuple[str, tuple[float, ...]]:
    """Return the name and the point of the text NAME=X,Y,Z."""
    name, _, point = text.partition("=")
    try:
        return name, tuple(float(word) for word in point.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=X,Y,Z") from None


def named_plane(text: str) -> tuple[str, Plane]:
    """Return the name and the plane of the text NAME:AXIS=VALUE."""
    name, _, plane = text.partition(":")
    axis, _, value = plane.partition("=")
    try:
        return name, (axis, value if value in ("min", "max") else float(value))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME:AXIS=VALUE with a number, min or max"
        ) from None
