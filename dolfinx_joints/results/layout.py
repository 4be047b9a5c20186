# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh and joints in a results file, and declaration of series from the table of quantities."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.arrays import Dealt
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.results.quantities import row_of
from dolfinx_joints.results.reader import STAGE_NAME_BYTES
from dolfinx_joints.results.writer import ResultsWriter

Array = ArrayLike | Dealt

# Prefix of the description of a jump, among the texts on a static stage in the manifest.
JUMP = "jump: "


class Cells(NamedTuple):
    """Cells of the body.

    Attributes:
        kind: VTK cell type; a Lagrange type for degrees of 2 and higher.
        nodes: Nodes of each cell in VTK order, shape (num_cells, nodes per cell).
        groups: Rows of ``nodes`` in each cell group, by its name.
    """

    kind: int
    nodes: Array
    groups: Mapping[str, Array]


def declare(
    writer: ResultsWriter,
    stream: str,
    values: Mapping[str, Any],
    *,
    frame: str = "",
    single: bool = False,
) -> None:
    """Declare series of a stream, with units and descriptions from `quantities`.

    The values by name are one record, or arrays with the shapes of a record. The frame names the
    reference of displacements and accelerations; ``single`` stores numbers in single precision.

    Raises:
        ResultsError: A name is missing in the table.
    """
    for name, value in values.items():
        row, of = row_of(stream, name)
        text = (row.text or row.label).format(of, frame=frame)
        dtype = np.float32 if single and row.dtype == np.float64 else row.dtype
        writer.series(stream, name, np.shape(value), row.unit, text, dtype=dtype)


def declare_points(writer: ResultsWriter, points: ArrayLike) -> None:
    """Write the monitor points, shape (num_points, 3), [m].

    Put their names into the metadata as ``point_names``. Put ``relative to the ground`` or
    ``absolute`` there as ``displacements``.
    """
    places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    writer.static("histories/points", places, "m", "monitor points")


def declare_body(
    writer: ResultsWriter,
    nodes: Array,
    surface: Array,
    joints: Mapping[str, Mapping[str, Array]],
    cells: Cells | None = None,
) -> None:
    """Write mesh and joints.

    Args:
        writer: Writer whose method `start` was not called yet.
        nodes: Shape (num_nodes, 3), [m]. The two sides of a joint have separate nodes.
        surface: Vertices of the boundary facets in cyclic order, shape (num_facets, 3 or 4). The
            facets on both sides of the joints are included.
        joints: By joint name, the arrays ``points`` (n, 3) [m], ``frames`` (n, 3, 3) with rows n,
            s1, s2, ``areas`` (n,) [m^2] and ``facet`` (n,), the facet number of each point.
            Optional: ``tied`` (n,), 1 at tied points and 0 at others.
        cells: Cells of the body.
    """
    writer.static("mesh/nodes", nodes, "m", "nodes", dtype=np.float64)
    writer.static("mesh/surface", surface, "-", "vertices of the boundary facets")
    if cells is not None:
        text = "nodes of the cells, VTK's order"
        writer.static("mesh/cells", cells.nodes, "-", text, dtype=np.int32)
        text = "VTK's number of the cell shape"
        writer.static("mesh/cell_kind", np.array([cells.kind]), "-", text)
        for name, rows in cells.groups.items():
            text = f"rows of mesh/cells in the group {name}"
            writer.static(f"mesh/groups/{name}", rows, "-", text, dtype=np.int32)
    for name, joint in joints.items():
        where = f"joints/{name}"
        writer.static(f"{where}/points", joint["points"], "m", "joint points")
        writer.static(f"{where}/frames", joint["frames"], "-", "local axes, rows n, s1, s2")
        writer.static(f"{where}/areas", joint["areas"], "m^2", "area of each point")
        writer.static(f"{where}/facet", joint["facet"], "-", "facet number of each point")
        if "tied" in joint:
            text = "1 where both sides share their nodes, at the end of the joint inside the body"
            writer.static(f"{where}/tied", joint["tied"], "-", text, dtype=np.int8)


def stage_bytes(name: str) -> NDArray[np.uint8]:
    """Return the name of a static stage as bytes padded with zeros, shape (STAGE_NAME_BYTES,)."""
    encoded = np.frombuffer(name.encode(), dtype=np.uint8)
    if not 0 < encoded.size <= STAGE_NAME_BYTES:
        raise ResultsError(
            f"The name of a static stage must have 1 to {STAGE_NAME_BYTES} bytes in UTF-8, "
            f"got {name!r}."
        )
    return np.pad(encoded, (0, STAGE_NAME_BYTES - encoded.size))
