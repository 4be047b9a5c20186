# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series that every run with a results file has, declared with a writer.

Monitors declare others where they record them, such as reactions, resultants and envelopes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.dealt import Dealt
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.results.reader import (
    ABSOLUTE,
    ENERGY_TERMS,
    JOINT_ENERGY_TERMS,
    RELATIVE,
    STAGE_NAME_BYTES,
)
from dolfinx_joints.results.writer import ResultsWriter

Array = ArrayLike | Dealt

# Series of the histories by the last part of their names, with what the joint points do.
JOINT_SHARES = {
    "open": "are open",
    "stick": "stick",
    "slip": "slip",
    "frictionless": "are closed without friction",
}

# Start of the text on a jump among those on a static stage in the manifest.
JUMP = "jump: "

# Energies after a static stage, by name with descriptions: of the whole model and of each joint.
STAGE_ENERGIES = {
    "strain": "elastic energy of the bulk and of springs",
    "supports": "work of supports and prescribed displacements",
    "plastic": "plastic work of the bulk",
    "water_released": "energy released in increments in which water entered or left joint points",
    "error": "stored energy plus losses minus work, zero but for rounding and solver tolerance",
    "scale": "largest of stored energy, input and losses so far",
}
STAGE_JOINT_ENERGIES = {
    "elastic": "elastic energy of",
    "friction": "work against friction in",
    "numerical": "loss because increments of the loads are straight paths, gain if negative, in",
    "bonds": "energy lost with broken bonds in",
    "released": "energy released by jumps, part of friction and numerical, in",
}


class Cells(NamedTuple):
    """Cells of the body.

    Attributes:
        kind: VTK's number of the cell's shape, of Lagrange cells from the second degree on.
        nodes: Nodes of each cell in VTK's order, shape (num_cells, nodes per cell).
        groups: Rows of ``nodes`` that make up each named cell group.
    """

    kind: int
    nodes: Array
    groups: Mapping[str, Array]


def declare_histories(
    writer: ResultsWriter,
    points: ArrayLike,
    *,
    accelerations: bool = False,
    relative: bool = True,
    free_surface: bool = False,
) -> None:
    """Declare the stream ``histories``, one record per step.

    The names of the points belong in the metadata as ``point_names``, and so does whether
    displacements are ``relative to the ground`` or ``absolute``, as ``displacements``.

    Args:
        writer: a writer not started yet.
        points: monitor points, shape (num_points, 3), [m].
        accelerations: Declare ``acceleration`` of the points as well, and ``ground_acceleration``
            unless there is a free surface.
        relative: Whether displacements and accelerations are relative to the ground.
        free_surface: Declare ``free_surface_velocity``: that of the level surface under the
            incident waves alone.
    """
    points = declare_points(writer, points)
    frame = RELATIVE if relative else ABSOLUTE
    text = f"displacement of monitor points, {frame}"
    writer.series("histories", "displacement", points.shape, "m", text)
    if accelerations:
        text = f"acceleration of monitor points, {frame}, mean of the step ending here"
        writer.series("histories", "acceleration", points.shape, "m/s^2", text)
    if free_surface:
        text = "velocity of the level free surface under the incident waves alone"
        writer.series("histories", "free_surface_velocity", (3,), "m/s", text)
    elif accelerations:
        text = "acceleration of the ground at the time of the record"
        writer.series("histories", "ground_acceleration", (3,), "m/s^2", text)
    for state, text in JOINT_SHARES.items():
        text = f"share of the joint points that {text}; tied ones do not count"
        writer.series("histories", f"joint_{state}", (), "-", text)
    text = "iterations of the step's solve"
    writer.series("histories", "iterations", (), "-", text, dtype=np.int64)


def declare_points(writer: ResultsWriter, points: ArrayLike) -> NDArray[np.float64]:
    """Write the monitor points, shape (num_points, 3), [m]."""
    places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    writer.static("histories/points", places, "m", "monitor points")
    return places


def declare_energy(
    writer: ResultsWriter, joints: Sequence[str] = (), loads: Iterable[str] = ()
) -> None:
    """Declare the stream ``energy``, one record per step, a number [J] per ledger line.

    The lines of joints are there for each joint as well; the works of the loads make up the input
    together with those of moving supports.
    """
    for term in ENERGY_TERMS:
        writer.series("energy", term, (), "J", f"{term} energy" if term != "error" else "residual")
    for joint in joints:
        for term in JOINT_ENERGY_TERMS:
            name = f"joints/{joint}/{term}"
            writer.series("energy", name, (), "J", f"{term} energy of {joint}")
    for load in loads:
        writer.series("energy", f"loads/{load}", (), "J", f"work of {load}")


def declare_states(
    writer: ResultsWriter,
    nodes: Array,
    surface: Array,
    joints: Mapping[str, Mapping[str, Array]],
    cells: Cells | None = None,
    *,
    status: bool = False,
) -> None:
    """Declare the stream ``states``, recorded at chosen times.

    Args:
        writer: a writer not started yet.
        nodes: shape (num_nodes, 3), [m]; the two sides of a joint have their own.
        surface: vertices of the boundary facets in cyclic order, shape (num_facets, 3 or 4); the
            sides of the joints belong to them.
        joints: by joint name, the arrays ``points`` (n, 3) [m], ``frames`` (n, 3, 3) with rows n,
            s1, s2, ``areas`` (n,) [m^2] and ``facet`` (n,), the facet number of each point;
            ``tied`` (n,), 1 at tied points and 0 at others, may be missing.
        cells: Cells of the body.
        status: Declare the ``status`` of the joint points as well.
    """
    declare_body(writer, nodes, surface, joints, cells)
    _declare_fields(writer, "states", nodes, joints, status=status)


def declare_body(
    writer: ResultsWriter,
    nodes: Array,
    surface: Array,
    joints: Mapping[str, Mapping[str, Array]],
    cells: Cells | None = None,
) -> None:
    """Write mesh and joints; arguments as in `declare_states`."""
    writer.static("mesh/nodes", nodes, "m", "nodes", dtype=np.float64)
    writer.static("mesh/surface", surface, "-", "vertices of the boundary facets")
    if cells is not None:
        declare_cells(writer, cells)
    for name, joint in joints.items():
        where = f"joints/{name}"
        writer.static(f"{where}/points", joint["points"], "m", "joint points")
        writer.static(f"{where}/frames", joint["frames"], "-", "local axes, rows n, s1, s2")
        writer.static(f"{where}/areas", joint["areas"], "m^2", "area of each point")
        writer.static(f"{where}/facet", joint["facet"], "-", "facet number of each point")
        if "tied" in joint:
            text = "1 where both sides share their nodes, at the end of the joint inside the body"
            writer.static(f"{where}/tied", joint["tied"], "-", text, dtype=np.int8)


def declare_cells(writer: ResultsWriter, cells: Cells) -> None:
    """Write the cells of the body and their groups."""
    text = "nodes of the cells, VTK's order"
    writer.static("mesh/cells", cells.nodes, "-", text, dtype=np.int32)
    writer.static("mesh/cell_kind", np.array([cells.kind]), "-", "VTK's number of the cell shape")
    for name, rows in cells.groups.items():
        text = f"rows of mesh/cells in the group {name}"
        writer.static(f"mesh/groups/{name}", rows, "-", text, dtype=np.int32)


def declare_static_stages(
    writer: ResultsWriter,
    points: ArrayLike,
    nodes: Array,
    joints: Mapping[str, Mapping[str, Array]],
) -> None:
    """Declare the stream ``statics``, one record per static stage, its time the stage's number.

    Displacements are counted from the unloaded body. Points, nodes and joints are those of
    `declare_histories` and `declare_states`, which, or `declare_points` and `declare_body`, write
    them.
    """
    text = "name of the stage, UTF-8 padded with zeros; see `stage_bytes`"
    writer.series("statics", "name", (STAGE_NAME_BYTES,), "-", text, dtype=np.uint8)
    writer.series("statics", "load_time", (), "s", "time at which the loads are taken")
    shape = np.asarray(points).reshape(-1, 3).shape
    writer.series("statics", "point_displacement", shape, "m", "displacement of monitor points")
    _declare_fields(writer, "statics", nodes, joints, status=True)


def declare_static_energies(
    writer: ResultsWriter, joints: Sequence[str], loads: Iterable[str]
) -> None:
    """Declare energies and jumps in the stream ``statics``.

    Energies count from the unloaded body. The works of the loads and of the supports make up the
    input.

    Args:
        writer: A writer not started yet.
        joints: Names of the joints.
        loads: Names of the loads.
    """
    for term, text in STAGE_ENERGIES.items():
        writer.series("statics", f"energy/{term}", (), "J", text)
    for joint in joints:
        for term, text in STAGE_JOINT_ENERGIES.items():
            writer.series("statics", f"energy/joints/{joint}/{term}", (), "J", f"{text} {joint}")
    for load in loads:
        writer.series("statics", f"energy/loads/{load}", (), "J", f"work of {load}")
    writer.series("statics", "jumps", (), "-", "number of jumps in the stage", dtype=np.int64)
    writer.series("statics", "jump_energy", (), "J", "energy that the jumps of the stage released")


def stage_bytes(name: str) -> NDArray[np.uint8]:
    """Name of a static stage as the stream ``statics`` holds it, shape (STAGE_NAME_BYTES,)."""
    encoded = np.frombuffer(name.encode(), dtype=np.uint8)
    if not 0 < encoded.size <= STAGE_NAME_BYTES:
        raise ResultsError(
            f"The name of a static stage takes 1 to {STAGE_NAME_BYTES} bytes as UTF-8, "
            f"got {name!r}."
        )
    return np.pad(encoded, (0, STAGE_NAME_BYTES - encoded.size))


def _declare_fields(
    writer: ResultsWriter,
    stream: str,
    nodes: Array,
    joints: Mapping[str, Mapping[str, Array]],
    *,
    status: bool,
) -> None:
    """Declare displacements of the nodes, gaps and tractions of the joints."""
    text = "displacement of the nodes"
    writer.series(stream, "displacement", np.shape(nodes), "m", text)
    for name, joint in joints.items():
        where = f"joints/{name}"
        shape = np.shape(joint["points"])
        writer.series(stream, f"{where}/gap", shape, "m", "gap (n, s1, s2), open if n > 0")
        text = "traction (n, s1, s2), compression if n < 0"
        writer.series(stream, f"{where}/traction", shape, "Pa", text)
        if status:
            text = (
                "0 open, 1 sticking, 2 sliding in the step ending here, 3 closed without friction, "
                "4 tied"
            )
            writer.series(stream, f"{where}/status", shape[:1], "-", text, dtype=np.int8)
