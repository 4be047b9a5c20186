# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Temperatures at points from a file, interpolated to a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from dolfinx import fem
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import KDTree

from dolfinx_joints.body.places import extent
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import TemperatureError, doubt
from dolfinx_joints.common.mpi import on_root, raised_together
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

_FILLER = 99.0  # a value of nines only, at least this large, such as -999, marks a missing value
_LARGE = 50.0  # ratio of the extents of points and mesh, above which the unit may be wrong


def _read_points(path: str | Path, axes: int) -> tuple[Floats, Floats]:
    """Read points, shape (n, axes), [m], and their temperatures, shape (n,), from a file."""
    columns = ",".join([*"xyz"[:axes], "T"])
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TemperatureError(f"{path} cannot be read as text: {error}.") from None
    counted = enumerate(lines, start=1)
    rows = [(n, line) for n, line in counted if line.strip() and line.lstrip()[0] != "#"]
    head = rows[0][1] if rows else "missing"
    if head.replace(" ", "").replace(";", ",") != columns:
        raise TemperatureError(
            f"{path}: the columns are {head[:60]}; they must be {columns}, in m and the "
            "temperature unit of the references."
        )
    table = [_row(f"{path}, line {n}", line, ";" in head, axes + 1) for n, line in rows[1:]]
    points, values = np.hsplit(np.reshape(table, (-1, axes + 1)), [axes])
    offsets = points - points[:1]
    span = np.linalg.matrix_rank(offsets, tol=1e-9 * np.linalg.norm(offsets)) if len(points) else 0
    if span < axes:
        raise TemperatureError(
            f"{path} has {len(points)} points that span {span} of {axes} dimensions; they must "
            "surround the body."
        )
    _, counts = np.unique(points, axis=0, return_counts=True)
    if counts.max() > 1:
        raise TemperatureError(f"{path} has {int((counts > 1).sum())} points more than once.")
    return points, values[:, 0]


def _row(place: str, line: str, semicolons: bool, count: int) -> list[float]:
    """Return the numbers of a line, with decimal commas if semicolons separate them."""
    words = line.replace(",", ".").split(";") if semicolons else line.split(",")
    try:
        row = [float(word) for word in words]
    except ValueError:
        row = []
    filler = not set(words[-1].strip().rstrip("0")) - set("-9.")
    if len(row) != count or not np.isfinite(row).all() or (filler and abs(row[-1]) >= _FILLER):
        expected = f"{count} finite numbers, without a filler for a missing temperature"
        raise TemperatureError(f"{place} must have {expected}, got {shown(line)}.")
    return row


@checked
def temperature_from_file(
    path: str | Path, jointed: JointedMesh, *, reach: Annotated[float, at.Ge(0), at.Unit("m")] = 1.0
) -> Any:
    """Interpolate the temperatures of a file to the nodes of a mesh (collective).

    Interpolation is linear between the points. A node outside their convex hull, for example on a
    curved face, is given the value of the nearest point.

    Args:
        path: File of comma-separated values, or with semicolons and decimal commas. The first line
            is ``x,y,z,T`` (``x,y,T`` in 2-D); each further line is a point [m] and its temperature.
            Empty lines and lines that begin with # are skipped.
        jointed: The mesh.
        reach: Largest distance of a node outside the convex hull from the nearest point [m].

    Returns:
        DOLFINx function of the degree of the mesh, for `Temperature.value`.

    Raises:
        TemperatureError: The file is not valid, or a node is too far from the points.
    """
    mesh = jointed.mesh
    axes = mesh.geometry.dim
    points, values = on_root(mesh.comm, lambda: _read_points(path, axes))
    space = fem.functionspace(mesh, ("Lagrange", jointed.shape.degree))
    field = fem.Function(space, name="temperature")
    size, spread = extent(space), float(np.ptp(points, axis=0).max())
    if spread > _LARGE * size:
        extents = f"extend over {spread:.4g} m, the mesh over {size:.4g} m"
        doubt(mesh.comm, f"The points of {path} {extents}; check the unit of the points.")
    with raised_together(mesh.comm):
        nodes = space.tabulate_dof_coordinates()[:, :axes]
        field.x.array[:] = _interpolate(path, points, values, nodes, reach)
    return field


def _interpolate(
    path: str | Path, points: Floats, values: Floats, nodes: Floats, reach: float
) -> Floats:
    """Return the values at nodes: linear between points, nearest value outside."""
    if not len(nodes):
        return np.zeros(0)
    result: Floats = LinearNDInterpolator(points, values)(nodes)
    outside = np.flatnonzero(~np.isfinite(result))
    if len(outside):
        distance, nearest = KDTree(points).query(nodes[outside])
        farthest = int(np.argmax(distance))
        if distance[farthest] > reach:
            place = ", ".join(f"{c:.4g}" for c in nodes[outside[farthest]])
            raise TemperatureError(
                f"{path} has no point within {reach:g} m of the node at ({place}) m, which is "
                f"outside the convex hull; the nearest point is {distance[farthest]:.3g} m away."
            )
        result[outside] = values[nearest]
    return result
