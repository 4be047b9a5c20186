# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of a results file as text: an overview, or a table of all arrays."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.results.joint_points import joint_area
from dolfinx_joints.results.reader import Results, listing
from dolfinx_joints.results.resolved import resolved_frequencies

_WIDTH = 100
_LABEL = 13

# Facts that are shown on separate lines and must not appear again under "settings".
_SHOWN = (
    *("stage", "steps", "displacements", "point_names", "points", "dofs", "joint_points"),
    *("ranks", "units", "laws", "manifest"),
)
_COSTS = ("steps", "iterations", "solver", "energy_error", "imbalance", "local_error", "seconds")


def overview(path: str | Path) -> str:
    """Return an overview of a results file: the run, its accuracy, the stored series.

    ``joints/*/gap`` denotes the gaps of all joints. `describe` lists every array.
    """
    with Results(path) as results:
        facts, summary = results.metadata, results.summary
        lines = [f"{results.path}: {results.status}, created {results.created}"]
        lines += _line("run", _facts(facts, ("stage", "steps", "dofs", "joint_points", "ranks")))
        lines += _line("motions are", [str(facts[k]) for k in ("displacements",) if k in facts])
        lines += _line("solution", _facts(summary, _COSTS[1:-1]))
        seconds = summary.get("seconds", {})
        lines += _line("seconds", [f"{phase}={s:.3g}" for phase, s in seconds.items()])
        lines += _line("error", [str(summary["error"])] if "error" in summary else [])
        lines += _line("static energy", _static_energies(results))
        counts = {k: v for k, v in summary.items() if k not in (*_COSTS, "error")}
        lines += _line("counts", _facts(counts, counts))
        settings = {k: v for k, v in facts.items() if k not in _SHOWN}
        lines += _line("settings", _facts(settings, settings))
        lines += _manifest_lines(facts.get("manifest"))
        limits = resolved_frequencies(results)._asdict().items()
        finite = [f"{f:.3g} Hz by the {name}" for name, f in limits if f < np.inf]
        lines += _line("resolved to", finite)
        lines += _line("points", _points(results))
        for law, joints in _joints_by_law_text(results).items():
            lines += _line("joints", [*joints[:-1], joints[-1] + law])
        lines += _line("joint area", [joint_area(results)] if results.joints else [])
        for stream, names in results.streams.items():
            lines.append(_records(results, stream))
            lines += _line("", _unique_names((n, results.unit(stream, n)) for n in names))
        arrays = _unique_names((name, results.unit(name)) for name in results.statics)
        lines += _line("written once", arrays)
    return "\n".join(lines)


def describe(path: str | Path) -> str:
    """Return a table of all arrays in a results file."""
    with Results(path) as results:
        lines = [f"{results.path}: {results.status}, created {results.created}"]
        lines += _nested_lines(results.metadata) + _nested_lines(results.summary)
        rows: list[tuple[str, tuple[str, ...], tuple[int, ...]]] = [
            ("static", (name,), results.static(name).shape) for name in results.statics
        ]
        for stream, names in results.streams.items():
            lines.append(f"  {_records(results, stream)}")
            for name in names:
                shape = results.series(stream, name, slice(0)).shape[1:]
                rows.append((stream, (stream, name), shape))
        width = max((len(where[-1]) for _, where, _ in rows), default=0)
        for group, where, shape in rows:
            unit, text = results.unit(*where), results.description(*where)
            lines.append(f"  {group:<10} {where[-1]:<{width}} {shape!s:<16} {unit:<4} {text}")
    return "\n".join(lines)


def _records(results: Results, stream: str) -> str:
    times = results.time(stream)
    if stream == "statics":
        return f"stream statics: {listing(results.stage_names)}"
    span = f", {times[0]:.6g} to {times[-1]:.6g} s" if times.size else ""
    return f"stream {stream}: {times.size} record{'' if times.size == 1 else 's'}{span}"


def _static_energies(results: Results) -> list[str]:
    """Return the energy balance of the static stages and their jumps; empty for older files."""
    rows = results.rows("statics") if "jump_energy" in results.streams.get("statics", ()) else 0
    if not rows:
        return []
    error, scale, count, energy = (
        results.series("statics", name, slice(rows))
        for name in ("energy/error", "energy/scale", "jumps", "jump_energy")
    )
    largest = float(np.max(np.abs(error[scale > 0.0]) / scale[scale > 0.0], initial=0.0))
    jumps = [
        f"{n} jump{'s' if n > 1 else ''} in {name!r} ({joules:.4g} J)"
        for name, n, joules in zip(results.stage_names[:rows], count, energy, strict=True)
        if n
    ]
    return [f"energies balance to {largest:.2g} of the largest", *(jumps or ["no jumps"])]


def _nested_lines(facts: Mapping[str, Any], indent: str = "  ") -> list[str]:
    """Return one line per fact; the items of a dictionary are indented below its key."""
    lines = []
    for key, value in facts.items():
        inner = isinstance(value, dict) and len(indent) < 8
        lines.append(f"{indent}{key}:" if inner else f"{indent}{key}: {value}")
        lines += _nested_lines(value, indent + "  ") if inner else []
    return lines


def _manifest_lines(manifest: Any) -> list[str]:
    """Return the lines of the manifest, one line for all joints with equal laws."""
    lines: list[str] = []
    for label, value in manifest.items() if isinstance(manifest, dict) else ():
        if label == "resolved_hz":
            continue
        if label == "joint_laws" and isinstance(value, dict):
            for i, (joints, law) in enumerate(joints_by_law(value)):
                lines += _line("" if i else label, [f"{joints}: {law}"])
        elif label == "static_stages" and isinstance(value, dict):
            for i, (stage, acting) in enumerate(value.items()):
                lines += _line("" if i else label, [f"{stage}: {acting}"])
        elif isinstance(value, dict):
            lines += _line(label, _facts(value, value))
        else:
            lines += _line(label, map(str, value) if isinstance(value, list) else [str(value)])
    return lines


def joints_by_law(laws: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return each law with the names of its joints, as pairs (names in one text, law)."""
    joints: dict[str, list[str]] = {}
    for joint, law in laws.items():
        joints.setdefault(str(law), []).append(joint)
    return [(", ".join(names), law) for law, names in joints.items()]


def _joints_by_law_text(results: Results) -> dict[str, list[str]]:
    joints: dict[str, list[str]] = {}
    for name in results.joints:
        law, text = results.law(name), ""
        if law:
            angle = law["friction_angle_deg"]
            text = f": {law['kind']}{'' if angle is None else f', {angle:g} degrees'}"
        joints.setdefault(text, []).append(name)
    return joints


def _points(results: Results) -> list[str]:
    """Return texts of the monitor points: place, side of a joint, distance from given place."""
    requested, names = results.metadata.get("points"), results.metadata.get("point_names", [])
    if not isinstance(requested, dict) or "histories/points" not in results.statics:
        return names
    texts, points = [], results.static("histories/points")
    # Use the body's length scale if the body is stored: all points may be at the origin.
    nodes = results.static("mesh/nodes") if "mesh/nodes" in results.statics else points
    scale = float(np.abs(nodes).max())
    for name, actual in zip(names, points, strict=False):
        probe = requested.get(name, {})
        place, sides = probe.get("place", ()), probe.get("sides", ())
        dist = float(np.linalg.norm(actual[: len(place)] - np.array(place)))
        rounded = [0.0 if abs(x) < 1e-9 * scale else x for x in actual]
        text = f"{name} at ({' '.join(f'{x:.4g}' for x in rounded)}) m"
        text += f" on {' and '.join(sides)}" if sides else ""
        texts.append(text + (f" {dist:.3g} m from the place given" if dist > 1e-6 * scale else ""))
    return texts


def _facts(values: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Return texts ``name=value`` for the names that have a value."""
    texts = []
    for name in names:
        if name in values:
            value = values[name]
            shown = f"{value:.4g}" if isinstance(value, float) else str(value)
            texts.append(f"{name}={shown}")
    return texts


def _unique_names(names: Iterable[tuple[str, str]]) -> list[str]:
    """Return names with units, with ``*`` for the name of a joint, without duplicates."""
    units = {}
    for name, unit in names:
        short = re.sub(r"^((?:energy/)?joints/)[^/]+(/.*)$", r"\1*\2", name)
        units[short] = "" if unit == "-" else f" [{unit}]"
    return [name + unit for name, unit in units.items()]


def _line(label: str, parts: Iterable[str]) -> list[str]:
    """Return a labelled line of parts, wrapped; an empty list without parts."""
    text = ", ".join(parts)
    if not text:
        return []
    first, indent = f"{label:<{_LABEL}} ", " " * (_LABEL + 1)
    return textwrap.wrap(
        text, _WIDTH, initial_indent=first, subsequent_indent=indent, break_on_hyphens=False
    )
