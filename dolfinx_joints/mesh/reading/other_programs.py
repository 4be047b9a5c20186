# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Readers of mesh files of other programs, by the ending of the file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_file, real, shown
from dolfinx_joints.mesh.cells import RawMesh
from dolfinx_joints.mesh.reading.abaqus_file import load_inp
from dolfinx_joints.mesh.reading.exodus_file import load_exodus
from dolfinx_joints.mesh.reading.med_file import load_med
from dolfinx_joints.mesh.reading.named_sets import named_mesh
from dolfinx_joints.mesh.reading.unv_file import load_unv
from dolfinx_joints.mesh.reading.vtu_file import load_vtu

FORMATS = {".inp": load_inp, ".med": load_med, ".unv": load_unv, ".vtu": load_vtu}
FORMATS |= dict.fromkeys((".exo", ".e", ".ex2", ".g"), load_exodus)
_DAMAGED: tuple[type[Exception], ...] = (ArithmeticError, LookupError, OSError, RecursionError)
_DAMAGED += (StopIteration, TypeError, ValueError)
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}


def load_mesh(
    path: Path, unit: str | float, joints: list[str] | None
) -> tuple[RawMesh, list[str] | None]:
    """Return the mesh of a file in metres, and the names of the joints for `prepare`."""
    scale = UNITS.get(unit, math.nan) if isinstance(unit, str) else real(unit)
    if not 0.0 < scale < math.inf:
        wanted = f"one of {', '.join(UNITS)}, or the length of the unit in metres"
        raise ValueError(f"unit is {shown(unit)}; it must be {wanted}.")
    check_file(path, f"Mesh file {str(path)!r} does not exist.", MeshError)
    if (suffix := path.suffix.lower()) not in FORMATS:
        raise MeshError(
            f"{str(path)!r} has no known format; the formats are {', '.join(FORMATS)}, and .msh "
            "and .xdmf by read_msh and read_xdmf."
        )
    try:
        try:
            file = FORMATS[suffix](path)
        except MeshError:
            raise
        except _DAMAGED as error:
            reason = f"{type(error).__name__}, {error}"
            raise MeshError(f"the file is damaged, or not a {suffix} file: {reason}.") from error
        raw, names = named_mesh(file, joints)
    except MeshError as error:
        raise MeshError(f"{str(path)!r}: {error}") from error
    return replace(raw, x=scale * raw.x), names
