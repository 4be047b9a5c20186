# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Names, points and planes that `from_step` is given, checked, and read from the command line."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from dolfinx_joints.common.parameters import real, shown

Plane = tuple[str, float | str]  # axis "x", "y" or "z"; its value [m], "min" or "max"

UNNAMED_SURFACE = "outside"
FARTHEST = 1e9  # of coordinates [m], of the file's own unit where it is read


def is_point(point: Any) -> bool:
    """Tell whether these are three coordinates."""
    good = isinstance(point, Sequence | np.ndarray) and not isinstance(point, str | bytes)
    return good and len(point) == 3 and all(abs(real(x)) < FARTHEST for x in point)


def is_plane(plane: Any) -> bool:
    """Tell whether this is an axis and a place on it."""
    if isinstance(plane, str) or not isinstance(plane, Sequence) or len(plane) != 2:
        return False
    axis, where = plane
    if not isinstance(axis, str) or axis not in ("x", "y", "z"):
        return False
    if isinstance(where, str):
        return where in ("min", "max")
    return abs(real(where)) < FARTHEST


def check_word(what: str, name: str) -> None:
    """Raise ValueError unless a name is a word."""
    if not re.fullmatch(r"\w+", name) or name == UNNAMED_SURFACE:
        raise ValueError(
            f"{what} is called {shown(name)}, but its name must be of letters, digits and '_', and "
            f"not '{UNNAMED_SURFACE}'."
        )


def pair_of(text: str) -> tuple[str, str]:
    """Read A,B."""
    one, comma, two = text.partition(",")
    if not comma or not one or not two or "," in two:
        raise argparse.ArgumentTypeError(f"{text!r} is not A,B")
    return one, two


def named_pair(text: str) -> tuple[str, tuple[str, str]]:
    """Read NAME=A,B."""
    name, _, pair = text.partition("=")
    return name, pair_of(pair)


def named_point(text: str) -> tuple[str, tuple[float, ...]]:
    """Read NAME=X,Y,Z."""
    name, _, point = text.partition("=")
    try:
        return name, tuple(float(word) for word in point.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=X,Y,Z") from None


def named_plane(text: str) -> tuple[str, Plane]:
    """Read NAME:AXIS=VALUE."""
    name, _, plane = text.partition(":")
    axis, _, value = plane.partition("=")
    try:
        return name, (axis, value if value in ("min", "max") else float(value))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not NAME:AXIS=VALUE with a number, min or max"
        ) from None
