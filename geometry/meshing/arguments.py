# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arguments of the geometry scripts checked where they enter, each refusal one sentence."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.parameters import is_path, real, shown

CELLS = ("hex", "tet")
ORDERS = (1, 2)

MAX_CELLS = 5_000_000
MAX_JOINTS = 1000
MAX_LAYERS = 100
_LEAST_SHARE = 1e-3
SHORTEST, LONGEST = 1e-6, 1e9  # of lengths [m]: beyond them products leave the range of numbers


def finite(what: str, value: Any, least: float, most: float, unit: str) -> float:
    """Return a real number within bounds.

    Raises:
        ValueError: if it is none; a truth value is no number.
    """
    if not least <= real(value) <= most:
        raise ValueError(
            f"{what} is {shown(value)}, but it must be a number from {least:g} to {most:g} "
            f"[{unit}]."
        )
    return real(value)


def positive(what: str, value: Any, unit: str = "m") -> float:
    """Return a positive number of a size that can be computed with.

    Raises:
        ValueError: if it is none.
    """
    if not 0 < real(value) < math.inf:
        raise ValueError(f"{what} is {shown(value)}, but it must be a positive number [{unit}].")
    return finite(what, value, SHORTEST, LONGEST, unit)


def share(what: str, value: Any) -> float:
    """Return a number above 0 and at most 1, and not so near to either that cells are lost.

    Raises:
        ValueError: if it is none.
    """
    if not 0 < real(value) <= 1:
        raise ValueError(f"{what} is {shown(value)}, but it must be in (0, 1].")
    if real(value) != 1 and not _LEAST_SHARE <= real(value) <= 1 - _LEAST_SHARE:
        raise ValueError(
            f"{what} is {shown(value)}, but it must be 1, or from {_LEAST_SHARE:g} to "
            f"{1 - _LEAST_SHARE:g}."
        )
    return real(value)


def whole(what: str, value: Any, least: int, most: int = MAX_CELLS) -> int:
    """Return a whole number within bounds.

    Raises:
        ValueError: if it is none; a truth value is no number.
    """
    good = isinstance(value, Integral) and not isinstance(value, bool)
    if not good or value < least:
        raise ValueError(
            f"{what} is {shown(value)}, but it must be a whole number of at least {least}."
        )
    if value > most:
        raise ValueError(f"{what} is {shown(value)}, but it must be at most {most}.")
    return int(value)


def flag(what: str, value: Any) -> None:
    """Raise ValueError unless the value is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{what} is {shown(value)}, but it must be True or False.")


def triple(what: str, value: Any) -> tuple[int, int, int]:
    """Return three numbers of cells.

    Raises:
        ValueError: if it is anything else.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, str | bytes) or not isinstance(value, Sequence) or len(value) != 3:
        raise ValueError(f"{what} is {shown(value)}, but it must be three whole numbers.")
    one, two, three = (whole(f"each of {what}", n, 1) for n in value)
    return one, two, three


def mapping(what: str, value: Any) -> Mapping[str, Any]:
    """Return a mapping of names, empty for None.

    Raises:
        ValueError: if it is anything else.
    """
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise ValueError(f"{what} is {shown(value)}, but it must be a mapping of names.")
    return value


def check_elements(order: Any, cell: Any, cells: Sequence[str] = CELLS) -> None:
    """Raise ValueError unless the element order and the cell shape are among those offered."""
    if isinstance(order, bool) or not isinstance(order, Integral) or order not in ORDERS:
        raise ValueError(f"order is {shown(order)}, but it must be 1 or 2.")
    if not isinstance(cell, str) or cell not in cells:
        names = ", ".join(map(repr, cells[:-1])) + f" or {cells[-1]!r}"
        raise ValueError(f"cell is {shown(cell)}, but it must be {names}.")


def cells_along(length: float, size: float) -> int:
    """Return how many cells of about a size fill a length, at most one more than a mesh may have.

    More make no difference: `check_fine` refuses the mesh.
    """
    return max(1, round(min(length / size, MAX_CELLS + 1.0)))


def check_fine(count: float) -> None:
    """Raise ValueError if a mesh would have more cells than one can be made of."""
    if not count <= MAX_CELLS:
        raise ValueError(
            f"The mesh would have {count:.3g} cells, but at most {MAX_CELLS} are made: choose a "
            "larger size, or fewer divisions."
        )


def mesh_path(out: Any) -> Path:
    """Return the path of a .msh file to be written.

    Raises:
        ValueError: if it is no path, does not end in ".msh", its folder is missing, or it is one.
    """
    if not is_path(out):
        raise ValueError(f"out is {shown(out)}, but it must be the path of a file.")
    path, text = Path(out), shown(str(out))
    if path.suffix != ".msh":
        raise ValueError(f"out is {text}, but its name must end in '.msh'.")
    if not os.path.isdir(path.parent):
        raise ValueError(f"out is {text}, but the folder {str(path.parent)!r} is missing.")
    if os.path.isdir(path):
        raise ValueError(f"out is {text}, but that is a folder.")
    return path


def input_path(what: str, path: Any) -> Path:
    """Return the path of a file to be read.

    Raises:
        ValueError: if it is no path.
    """
    if not is_path(path):
        raise ValueError(f"{what} is {shown(path)}, but it must be the path of a file.")
    return Path(path)
