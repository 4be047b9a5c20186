# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Streams of results files that tests write by hand, declared from the table of quantities."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES, declare_directions
from dolfinx_joints.results.layout import declare, declare_body, declare_points, stage_bytes
from dolfinx_joints.results.quantities import ENERGY_TERMS, rows_below
from dolfinx_joints.results.writer import ResultsWriter

SHARES = tuple(row.name for row in rows_below("histories", "joint_"))


def declare_histories(
    writer: ResultsWriter,
    points: Any,
    *,
    accelerations: bool = False,
    free_surface: bool = False,
) -> None:
    """Declare histories of points, optionally with accelerations of points and ground.

    Under waves the ground motion is the velocity of the free surface.
    """
    declare_points(writer, points)
    moved = np.reshape(points, (-1, 3))
    names = {"displacement": moved} | ({"acceleration": moved} if accelerations else {})
    if free_surface or accelerations:
        names["free_surface_velocity" if free_surface else "ground_acceleration"] = np.zeros(3)
    declare(writer, "histories", names | dict.fromkeys((*SHARES, "iterations"), 0.0))


def declare_energy(
    writer: ResultsWriter, joints: Iterable[str] = (), loads: Iterable[str] = ()
) -> None:
    """Declare the energies of a run, of its joints and of its loads."""
    of_joints = [
        row.name.replace("*", joint)
        for joint in joints
        for row in rows_below("energy", "joints/*/")
    ]
    names = [*ENERGY_TERMS, *of_joints, *(f"loads/{load}" for load in loads)]
    declare(writer, "energy", dict.fromkeys(names, 0.0))


def declare_states(
    writer: ResultsWriter,
    nodes: Any,
    surface: Any,
    joints: Mapping[str, Mapping[str, Any]],
    cells: Any = None,
    *,
    status: bool = False,
) -> None:
    """Write a body and declare its states, optionally with the status of joint points."""
    declare_body(writer, nodes, surface, joints, cells)
    declare(writer, "states", _fields(nodes, joints, status=status))


def write_states(
    path: Path,
    nodes: Any,
    surface: Any,
    joints: Mapping[str, Mapping[str, Any]],
    *states: tuple[float, Mapping[str, Any]],
    cells: Any = None,
    **facts: Any,
) -> Path:
    """Write a run of states, each a time and values by name; fields without a value are zero."""
    with ResultsWriter(path, facts) as writer:
        declare_states(writer, nodes, surface, joints, cells)
        writer.start()
        for time, values in states:
            fields = _fields(nodes, joints, status=False)
            zeros = {name: np.zeros_like(field, dtype=float) for name, field in fields.items()}
            writer.append("states", time, zeros | dict(values))
        writer.finish("complete", {})
    return path


def declare_static_stages(
    writer: ResultsWriter, points: Any, nodes: Any, joints: Mapping[str, Mapping[str, Any]]
) -> None:
    """Declare static stages without energies."""
    stage = {"name": stage_bytes("none"), "load_time": 0.0, "point_displacement": points}
    declare(writer, "statics", stage | _fields(nodes, joints, status=True))


def declare_envelopes(writer: ResultsWriter, nodes: Any, arch: Any, cantilever: Any) -> None:
    """Write nodes and directions of envelopes, and declare the envelopes."""
    declare_directions(writer, None, nodes, arch, cantilever)
    declare(writer, "envelopes", dict.fromkeys(ENVELOPE_NAMES, nodes))


def _fields(nodes: Any, joints: Mapping[str, Mapping[str, Any]], *, status: bool) -> dict[str, Any]:
    """Return arrays with the shapes of the displacement and of the fields of joint points."""
    fields = {"displacement": nodes}
    for name, joint in joints.items():
        fields |= dict.fromkeys(
            [f"joints/{name}/{k}" for k in ("gap", "traction")], joint["points"]
        )
        if status:
            fields[f"joints/{name}/status"] = joint["areas"]
    return fields
