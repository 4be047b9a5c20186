# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report section on the input of the runs, as tables: materials, laws, loads, steps, mesh."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from typing import Any

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report.page import Cell, Html, Section, plain, table
from dolfinx_joints.report.runs import Content, Run
from dolfinx_joints.results.overview import joints_by_law

Named = tuple[str, dict[str, Any]]  # class and parameters
Groups = dict[str, dict[str, Any]]  # values by heading and parameter

# Title and factor from SI units of each parameter.
_UNITS = {
    "young": ("Young's modulus [GPa]", 1e-9),
    "poisson": ("Poisson's ratio", 1.0),
    "shear": ("shear modulus [GPa]", 1e-9),
    "density": ("density [kg/m³]", 1.0),
    "normal_stiffness": ("normal stiffness k_n [GPa/m]", 1e-9),
    "shear_stiffness": ("shear stiffness k_s [GPa/m]", 1e-9),
    "tangential_stiffness": ("tangential stiffness [GPa/m]", 1e-9),
    "normal_viscosity": ("normal viscosity [MPa s/m]", 1e-6),
    "shear_viscosity": ("shear viscosity [MPa s/m]", 1e-6),
    "friction_angle_deg": ("friction angle [°]", 1.0),
    "dilatancy_angle_deg": ("dilatancy angle [°]", 1.0),
    "cohesion": ("cohesion [MPa]", 1e-6),
    "adhesion": ("adhesion [MPa]", 1e-6),
    "flank_angle_deg": ("angle of the flanks [°]", 1.0),
    "spacing": ("spacing of the teeth [m]", 1.0),
    "tooth_width": ("width of the teeth [m]", 1.0),
    "tooth_cohesion": ("cohesion of the teeth [MPa]", 1e-6),
    "tooth_friction_angle_deg": ("friction angle of the teeth [°]", 1.0),
    "forward_play": ("forward play [m]", 1.0),
    "backward_play": ("backward play [m]", 1.0),
    "tensile_strength": ("tensile strength [MPa]", 1e-6),
    "fracture_energy": ("fracture energy G_I [J/m²]", 1.0),
    "shear_fracture_energy": ("fracture energy G_II [J/m²]", 1.0),
    "mean": ("mean [°C]", 1.0),
    "surface_mean": ("mean at the surface [°C]", 1.0),
    "deep_mean": ("mean at depth [°C]", 1.0),
    "amplitude": ("amplitude [K]", 1.0),
    "surface_amplitude": ("amplitude at the surface [K]", 1.0),
    "expansion": ("thermal expansion [1/K]", 1.0),
    "diffusivity": ("diffusivity [m²/s]", 1.0),
    "level": ("level [m]", 1.0),
    "depth": ("depth [m]", 1.0),
    "length": ("length [m]", 1.0),
    "absorbing_length": ("absorbing length [m]", 1.0),
    "sound_speed": ("speed of sound [m/s]", 1.0),
    "ReservoirMass.frequency": ("frequency [Hz]", 1.0),
    "aperture": ("aperture [m]", 1.0),
    "JointWater.closed": ("pressure in closed joints [MPa]", 1e-6),
    "Uplift.pressure": ("pressure [MPa]", 1e-6),
    "Pressure.value": ("value [MPa]", 1e-6),
    "Traction.value": ("value [MPa]", 1e-6),
    "point": ("point [m]", 1.0),
    "SeepageLine.start": ("start of the line [m]", 1.0),
    "SeepageLine.end": ("end of the line [m]", 1.0),
    "SeepageLine.upstream": ("level upstream [m]", 1.0),
    "SeepageLine.downstream": ("level downstream [m]", 1.0),
    "SeepageLine.drain": ("drain: place on the line, remaining fraction", 1.0),
    "Gravity.acceleration": ("acceleration [m/s²]", 1.0),
    "FreeField.surface": ("height of the surface [m]", 1.0),
    "FreeField.base": ("height of the base [m]", 1.0),
    "ObliqueFreeField.surface": ("height of the surface [m]", 1.0),
    "highest_frequency": ("highest frequency [Hz]", 1.0),
    "angle_deg": ("angle from the vertical [°]", 1.0),
    "azimuth_deg": ("azimuth [°]", 1.0),
    "gravity": ("gravity [m/s²]", 1.0),
    "mass_factor": ("factor of the mass in damping [1/s]", 1.0),
    "stiffness_factor": ("factor of the stiffness in damping [s]", 1.0),
    "start at": ("start time [s]", 1.0),
    "time step": ("time step [s]", 1.0),
    "time_step": ("time step [s]", 1.0),
    "size": ("cell size [m]", 1.0),
    "order": ("degree of the elements", 1.0),
    "active_height": ("joints active below this share of the height", 1.0),
    "shear_ratio": ("k_s / k_n", 1.0),
    "gap": ("initial gap [m]", 1.0),
    "scale": ("factor on the motion", 1.0),
    "displacements": ("displacements in the file", 1.0),
    "rotate": ("rotation of the horizontal axes [°]", 1.0),
}
_MESH = {"dofs": "degrees of freedom", "cells": "cells", "joint_points": "joint points"}
_ELSEWHERE = {"point_names", "points", "units", "laws", "manifest", *_MESH}


def parameters(content: Content) -> Section:
    """Return the section with all input of the runs, one column per run."""
    runs = content.runs
    made = [run.results.metadata.get("manifest") or {} for run in runs]
    tables = {
        "Materials": [_objects(m.get("material", {}).items()) for m in made],
        "Laws of the joints": [_objects(joints_by_law(m.get("joint_laws", {}))) for m in made],
        "Loads": [_objects(_numbered(m.get("loads", []))) for m in made],
        "Added mass": [_objects(_numbered(m.get("added_mass", []))) for m in made],
        "Reservoir": [
            _objects([("", water)] if (water := m.get("reservoir")) else []) for m in made
        ],
        "Static stages": [_objects(m.get("static_stages", {}).items()) for m in made],
        "Supports": [_objects(_numbered(m.get("supports", []))) for m in made],
        "Damping": [_objects([("", m.get("damping"))]) for m in made],
        "Steps and solver": [_objects(m.get("settings", {}).items()) for m in made],
        "Data of the run": [
            {"": {k: v for k, v in run.results.metadata.items() if k not in _ELSEWHERE}}
            for run in runs
        ],
        "Highest resolved frequency [Hz]": [{"": _resolved(run)} for run in runs],
        "Mesh": [{"": _mesh(run)} for run in runs],
        "Programs and machine": [{"": _programs(m)} for m in made],
    }
    head = ["", *(run.label for run in runs)]
    pieces = [_table(title, head, groups) for title, groups in tables.items()]
    return Section("parameters", "Parameters", [piece for piece in pieces if piece])


def parsed(text: Any) -> Named:
    """Return class and parameters from the repr of an object; other values have no parameters."""
    flat, nested = str(text), 1
    while nested:  # a repr such as <function <lambda>>
        flat, nested = re.subn(r"(<\w[^<>]*)<([^<>]*)>", r"\1\2", flat)
    try:
        call = ast.parse(re.sub(r"<(\w[^<>]*)>", r"'\1'", flat), mode="eval").body
    except (SyntaxError, ValueError):
        return str(text), {}
    if not isinstance(call, ast.Call):
        return str(text), {}
    values: dict[str, Any] = {}
    for word in call.keywords:
        value = _value(word.value)
        kind, inner = parsed(value) if isinstance(word.value, ast.Call) else ("", {})
        if not inner or "argument 1" in inner:
            values[str(word.arg)] = value
        else:  # an object such as SeepageLine
            values[str(word.arg)] = kind
            values |= {f"{kind}.{key.rpartition('.')[2]}": v for key, v in inner.items()}
    if ast.unparse(call.func) == "Gravity" and values.get("acceleration") is None:
        values["acceleration"] = f"{plain(STANDARD_GRAVITY)} downwards"
    values |= {f"argument {i}": _value(node) for i, node in enumerate(call.args, 1)}
    return ast.unparse(call.func), values


def _value(node: ast.expr) -> Any:
    """Return the number, numbers or text of a parameter."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "array":
        node = node.args[0]
    try:
        value = ast.literal_eval(node)
    except (ValueError, TypeError):
        return ast.unparse(node)
    if isinstance(value, list | tuple) and all(isinstance(one, int | float) for one in value):
        return tuple(value)
    return value if isinstance(value, int | float | str | None) else ast.unparse(node)


def _objects(named: Iterable[tuple[str, Any]]) -> Groups:
    """Return parameters by heading; an object without parameters is listed as a parameter."""
    groups: Groups = {}
    for name, value in named:
        if isinstance(value, str):
            kind, values = parsed(value)
            given = {k: v for k, v in values.items() if v is not None}
            if given:
                groups.setdefault(f"{name}: {kind}" if name else kind, {}).update(given)
            else:
                groups.setdefault("", {})[name or kind] = kind if name else "yes"
        elif value is not None:
            groups.setdefault("", {})[name] = value
    return groups


def _numbered(things: Iterable[Any]) -> list[tuple[str, Any]]:
    """Return objects with their numbers, empty if only one object is of the class."""
    listed = list(things)
    kinds = [parsed(thing)[0] for thing in listed]
    numbers = [str(kinds[: i + 1].count(kind)) for i, kind in enumerate(kinds)]
    return [
        (number if kinds.count(kind) > 1 else "", thing)
        for number, kind, thing in zip(numbers, kinds, listed, strict=True)
    ]


def _mesh(run: Run) -> dict[str, Any]:
    facts, statics = run.results.metadata, run.results.statics
    values = {title: facts.get(key) for key, title in _MESH.items()}
    for title, name in (("nodes in the file", "mesh/nodes"), ("boundary facets", "mesh/surface")):
        values[title] = len(run.results.static(name)) if name in statics else None
    body = (facts.get("manifest") or {}).get("body") or {}
    values |= {"degree of the elements": body.get("degree"), "plane": body.get("plane")}
    return values | {"joints": len(run.results.joints)}


def _resolved(run: Run) -> dict[str, Any]:
    limits = measures.resolved_frequencies(run.results).as_json()
    titles = (
        "time step, 10 steps per period",
        "mesh, 10 nodes per shear wavelength",
        "closed joints, which transmit half of the wave energy",
    )
    return dict(zip(titles, limits.values(), strict=True))


def _programs(made: Mapping[str, Any]) -> dict[str, Any]:
    values = dict(made.get("versions", {}))
    values |= {key: made[key] for key in ("system", "host") if key in made}
    if "command" in made:
        values["command"] = " ".join(map(str, made["command"]))
    return values | made.get("petsc_options", {})


def _table(title: str, head: list[Cell], groups: list[Groups]) -> Html | None:
    """Return a table of the values of all runs, or None if there are no values."""
    rows: list[list[Cell]] = []
    for heading in dict.fromkeys(h for run in groups for h in run):
        # Insert a name before the next name of the same run, to keep the order of static stages.
        names: list[str] = []
        for run in groups:
            place = len(names)
            for name in reversed(run.get(heading, {})):
                if name in names:
                    place = names.index(name)
                else:
                    names.insert(place, name)
        values = [[name, *(run.get(heading, {}).get(name) for run in groups)] for name in names]
        kind = heading.split(": ")[-1]
        scaled_rows = [_in_unit(kind, row) for row in values if any(c is not None for c in row[1:])]
        if scaled_rows:
            rows += [[heading]] * bool(heading) + scaled_rows
    return table(title, head, rows) if rows else None


def _in_unit(kind: str, row: list[Any]) -> list[Cell]:
    """Return a parameter's row with its title, converted to the unit in the title."""
    title, factor = unit(kind, row[0])
    if all(isinstance(cell, str | None) for cell in row[1:]) and kind != "Gravity":
        title = title.partition(" [")[0]
    return [title, *(_scaled(cell, factor) for cell in row[1:])]


def unit(kind: str, name: str) -> tuple[str, float]:
    """Return the title of a parameter, and the factor from SI to the unit in the title."""
    names = (f"{kind}.{name}", name, last := name.rpartition(".")[2])
    return next((_UNITS[n] for n in names if n in _UNITS), (last.replace("_", " "), 1.0))


def _scaled(cell: Any, factor: float) -> Any:
    """Return numbers times a factor, texts and lists unchanged, anything else as text."""
    if isinstance(cell, Mapping):
        return ", ".join(f"{name}: {plain(value)}" for name, value in cell.items())
    if isinstance(cell, tuple):
        return tuple(_scaled(item, factor) for item in cell)
    if factor != 1.0 and isinstance(cell, int | float):
        return cell * factor
    return cell if isinstance(cell, int | float | str | list | None) else str(cell)
