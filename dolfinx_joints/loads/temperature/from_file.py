# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Temperatures at points from a file, brought onto a mesh."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import TemperatureError

if TYPE_CHECKING:
    from dolfinx_joints.mesh.jointed_mesh import JointedMesh

Floats = NDArray[np.float64]

# Largest file, so that another kind of file does not fill the memory.
LARGEST_FILE = 500_000_000  # bytes
LARGEST_NUMBER = 1e9  # of coordinates [m] and temperatures, where squares lose no point


def read_temperature_points(path: str | Path, axes: int = 3) -> tuple[Floats, Floats]:
    """Points and their temperatures from a file of comma-separated values.

    The first line is ``x,y,z,T`` (``x,y,T`` in the plane), every other a point [m] and its
    temperature; empty lines and those that begin with # do not count.

    Args:
        path: The file.
        axes: Coordinates of a point, 3 or 2.

    Returns:
        Points, shape (n, axes), [m], and temperatures, shape (n,).

    Raises:
        TemperatureError: There is no such file, it is no text of this kind, or its points span no
            body.
    """
    path = Path(path)
    columns = [*"xyz"[:axes], "T"]
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise TemperatureError(
                f"{path} has {size} bytes; a file of temperatures may have {LARGEST_FILE}."
            )
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TemperatureError(f"{path} cannot be read as text: {error}.") from None
    rows, started = [], False
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            fields = [field.strip() for field in next(csv.reader([line]))]
        except csv.Error as error:
            raise TemperatureError(f"{path}, line {number}: {error}.") from None
        if not started:
            started = True
            if fields != columns:
                raise TemperatureError(
                    f"{path}, line {number}: the columns are {','.join(fields)[:60]}; they must be "
                    f"{','.join(columns)}, in m and the degrees of the references."
                )
            continue
        rows.append(_row(path, number, fields, columns))
    if not started:
        raise TemperatureError(f"{path} is empty; its first line must be {','.join(columns)}.")
    table = np.array(rows, dtype=np.float64).reshape(-1, axes + 1)
    points = table[:, :axes]
    spread = np.linalg.matrix_rank(points - points[:1], tol=1e-9) if len(points) else 0
    if spread < axes:
        raise TemperatureError(
            f"{path} has {len(points)} points that span {spread} of {axes} dimensions; they must "
            "surround the body."
        )
    _, counts = np.unique(points, axis=0, return_counts=True)
    if counts.max() > 1:
        raise TemperatureError(f"{path} names {int((counts > 1).sum())} points more than once.")
    return points, table[:, axes]


def _row(path: Path, number: int, fields: list[str], columns: list[str]) -> list[float]:
    """Numbers of a line."""
    if len(fields) != len(columns):
        raise TemperatureError(
            f"{path}, line {number}: {len(fields)} values, the columns are {','.join(columns)}."
        )
    values = []
    for name, text in zip(columns, fields, strict=True):
        try:  # Python itself reads 1_0 and digits of any script
            value = float(text if text.isascii() and "_" not in text else "")
        except ValueError:
            raise TemperatureError(
                f"{path}, line {number}: {name} is {text[:40]!r}; it must be a number."
            ) from None
        if not abs(value) <= LARGEST_NUMBER:
            raise TemperatureError(
                f"{path}, line {number}: {name} is {text[:40]}; it must be finite, and "
                f"{LARGEST_NUMBER:g} at most."
            )
        values.append(value)
    return values


@checked
def temperature_from_file(
    path: str | Path,
    jointed: JointedMesh,
    *,
    reach: Annotated[float, at.Ge(0), at.Unit("m")] = 1.0,
) -> Any:
    """Temperatures of a file at the nodes of a mesh (collective).

    Linear between the points; a node outside of what they span takes the value of the nearest one,
    which curved faces need.

    Args:
        path: The file; see `read_temperature_points`.
        jointed: The mesh.
        reach: How far outside a node may lie from the nearest point [m].

    Returns:
        A DOLFINx function of the degree of the mesh, a `Temperature.value`.

    Raises:
        TemperatureError: The file cannot be used, or a node lies too far outside its points.
    """
    from dolfinx import fem

    from dolfinx_joints.common.mpi import on_root, raised_together

    mesh = jointed.mesh
    axes = mesh.geometry.dim
    points, values = on_root(mesh.comm, lambda: read_temperature_points(path, axes))
    space = fem.functionspace(mesh, ("Lagrange", jointed.shape.degree))
    field = fem.Function(space, name="temperature")
    with raised_together(mesh.comm):
        nodes = space.tabulate_dof_coordinates()[:, :axes]
        field.x.array[:] = _interpolated(path, points, values, nodes, reach)
    return field


def _interpolated(
    path: str | Path, points: Floats, values: Floats, nodes: Floats, reach: float
) -> Floats:
    """Values at nodes, linear between points, of the nearest one outside."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import KDTree

    if not len(nodes):
        return np.zeros(0)
    found: Floats = LinearNDInterpolator(points, values)(nodes)
    outside = np.flatnonzero(~np.isfinite(found))
    if len(outside):
        distance, nearest = KDTree(points).query(nodes[outside])
        far = int(np.argmax(distance))
        if distance[far] > reach:
            place = ", ".join(f"{c:.4g}" for c in nodes[outside[far]])
            raise TemperatureError(
                f"{path} has no point within {reach:g} m of the node at ({place}) m, which lies "
                f"outside of what its points span; the nearest is {distance[far]:.3g} m away."
            )
        found[outside] = values[nearest]
    return found
