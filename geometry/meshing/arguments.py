# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parameters of the models, and limits of meshes and files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import annotated_types as at

MAX_CELLS = 5_000_000
MAX_JOINTS = 1000

Length = Annotated[float, at.Gt(0), at.Unit("m")]
Order = Literal[1, 2]
Cell = Literal["hex", "tet"]
NumberOfJoints = Annotated[int, at.Interval(ge=0, le=MAX_JOINTS)]
NumberOfLayers = Annotated[int, at.Interval(ge=1, le=100)]
Share = Annotated[float, at.Interval(gt=0, le=1)]


def cells_along(length: float, size: float) -> int:
    """Return the number of cells of approximately the given size that fill a length.

    The result is at most `MAX_CELLS` + 1, which `check_fine` rejects.
    """
    return max(1, round(min(length / size, MAX_CELLS + 1.0)))


def check_fine(count: float) -> None:
    """Raise ValueError if a mesh would have more than `MAX_CELLS` cells."""
    if not count <= MAX_CELLS:
        raise ValueError(
            f"The mesh would have {count:.3g} cells, but at most {MAX_CELLS} are allowed: choose a "
            "larger size, or fewer divisions."
        )


def mesh_path(out: str | os.PathLike[str]) -> Path:
    """Return the path of a .msh file to be written.

    Raises:
        ValueError: if the path does not end in ".msh", its folder is missing, or it is a folder.
    """
    path = Path(out)
    if path.suffix != ".msh":
        raise ValueError(f"out is {str(out)!r}, but its name must end in '.msh'.")
    if not path.parent.is_dir():
        raise ValueError(f"out is {str(out)!r}, but the folder {str(path.parent)!r} is missing.")
    if path.is_dir():
        raise ValueError(f"out is {str(out)!r}, but that is a folder.")
    return path
