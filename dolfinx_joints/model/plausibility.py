# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of values that are implausible for a dam, mostly because of wrong units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx_joints.common.errors import doubt
from dolfinx_joints.common.parameters import numbers_of
from dolfinx_joints.materials.bulk_law import elastic_part
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


@dataclass(frozen=True)
class Range:
    """Smallest, typical and largest value of a parameter in models of dams, rigid parts included.

    Zero is always plausible. ``others`` are other units that the user may have meant, expressed in
    ``unit``.
    """

    low: float
    usual: float
    high: float
    unit: str
    others: Mapping[str, float] = field(default_factory=dict)


_MODULUS = Range(1e6, 25e9, 1e17, "Pa", {"GPa": 1e9, "MPa": 1e6})
_STIFFNESS = Range(1e6, 1e11, 1e20, "Pa/m", {"GPa/m": 1e9, "MPa/m": 1e6})
_STRENGTH = Range(1e2, 1e6, 1e9, "Pa", {"MPa": 1e6, "kPa": 1e3})
_FRACTURE = Range(0.1, 200.0, 1e5, "J/m^2", {"N/mm": 1e3})
_WEIGHTS = {"kN/m^3": 1e3 / 9.81, "N/m^3": 1.0 / 9.81}

# Ranges by parameter name, which is the same in all materials, laws and loads.
RANGES = {
    "young": _MODULUS,
    "shear": _MODULUS,
    "density": Range(100.0, 2400.0, 12e3, "kg/m^3", {"t/m^3": 1e3, **_WEIGHTS}),
    "normal_stiffness": _STIFFNESS,
    "shear_stiffness": _STIFFNESS,
    "cohesion": _STRENGTH,
    "adhesion": _STRENGTH,
    "tooth_cohesion": _STRENGTH,
    "tensile_strength": _STRENGTH,
    "tensile": Range(1e4, 2e6, 3e7, "Pa", {"MPa": 1e6, "kPa": 1e3}),
    "compressive": Range(1e5, 25e6, 3e8, "Pa", {"MPa": 1e6, "kPa": 1e3}),
    "fracture_energy": _FRACTURE,
    "shear_fracture_energy": _FRACTURE,
    "friction_angle_deg": Range(2.0, 35.0, 90.0, "degrees", {"radians": 180.0 / np.pi}),
    "friction_coefficient": Range(0.0, 0.7, 10.0, "", {"degrees": np.pi / 180.0}),
    "expansion": Range(1e-7, 1e-5, 1e-4, "1/K", {"1e-6/K": 1e-6}),
    "gravity": Range(1.0, 9.81, 30.0, "m/s^2"),
    "sound_speed": Range(300.0, 1440.0, 6000.0, "m/s", {"km/s": 1e3}),
}
GROUT_PRESSURE = Range(1e3, 5e5, 3e7, "Pa", {"MPa": 1e6, "bar": 1e5, "kPa": 1e3})
KELVIN = 273.15
# Length of the process zone divided by E G / f^2 (Rice 1980), and the least number of cells in it
# (Turon et al. 2007).
ZONE_LENGTH, CELLS_PER_ZONE = 9.0 * np.pi / 32.0, 3.0
EXTENT = Range(0.01, 100.0, 2e4, "m", {"mm": 1e-3, "cm": 1e-2})


def warn_of_implausible_values(
    jointed: JointedMesh, materials: Mapping[str, Any], laws: Any, loads: Sequence[Any]
) -> list[str]:
    """Warn once of each implausible value, and return the warnings; on rank 0 (collective).

    ``materials`` are by cell group, with an empty name for all cells. ``laws`` is one law, or laws
    by joint. ``loads`` include added masses.
    """
    x, comm = jointed.mesh.geometry.x, jointed.mesh.comm
    feet = {id(load): _lowest_height(jointed, load) for load in loads}
    kelvin = [text for load in loads for text in _in_kelvin(comm, load)]
    zones = _process_zones(jointed, materials, laws)
    boxes = comm.gather((x.min(axis=0), x.max(axis=0)) if len(x) else None, root=0)
    if boxes is None:
        return []
    low, high = zip(*(box for box in boxes if box is not None), strict=True)
    lowest, highest = np.min(low, axis=0), np.max(high, axis=0)
    size, up = float((highest - lowest).max()), jointed.mesh.geometry.dim - 1
    by_joint = laws if isinstance(laws, Mapping) else {"": laws}
    named = [*materials.items(), *by_joint.items(), *(("", load) for load in loads)]
    owners = {id(given): (given, [n for n, other in named if other is given]) for _, given in named}
    texts = [*_out_of_range("The mesh: extent", size, EXTENT)]
    for given, (first, *further) in owners.values():
        suffix = f" and {len(further)} more" if further else ""
        owner = f"{type(given).__name__}{f' of {first}' if first else ''}{suffix}"
        for name, value in _parameters(given):
            texts += (
                _out_of_range(f"{owner}: {name}", value, RANGES[name]) if name in RANGES else []
            )
        ends = float(lowest[up]), float(highest[up])
        texts += _level(owner, given, *ends, feet.get(id(given), -np.inf))
    texts += _water_twice(loads) + kelvin + zones
    doubt(comm, *texts)
    return texts


def warn_of_overlaps(comm: Any, overlaps: Mapping[str, float]) -> list[str]:
    """Warn of negative initial gaps [m] by joint, and return the warnings; on rank 0."""
    texts = [
        f"Joint {name!r}: the initial gap is {gap:g} m; the faces overlap. A positive gap is open."
        for name, gap in (overlaps.items() if comm.rank == 0 else ())
    ]
    doubt(comm, *texts)
    return texts


def warn_of_grout(comm: Any, pressure: float) -> None:
    """Warn of an implausible grouting pressure [Pa], on rank 0."""
    doubt(comm, *_out_of_range("grout: pressure", pressure, GROUT_PRESSURE))


def warn_of_strengths(comm: Any, strengths: Mapping[str, Any]) -> list[str]:
    """Warn of implausible strengths by cell group, and return the texts; on rank 0."""
    texts = []
    for group, given in strengths.items():
        owner = f"Strength of {group}".removesuffix(" of ")
        for name in ("tensile", "compressive"):
            texts += _out_of_range(f"{owner}: {name}", getattr(given, name), RANGES[name])
        if given.compressive < given.tensile:
            numbers = f"{given.compressive:g} Pa, less than tensile {given.tensile:g} Pa"
            texts.append(f"{owner}: compressive is {numbers}; are they interchanged?")
    doubt(comm, *texts)
    return texts


def _parameters(given: Any) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the parameters of a dataclass, nested dataclasses included."""
    for parameter in fields(given) if is_dataclass(given) else ():
        value = getattr(given, parameter.name, None)
        yield parameter.name, value
        yield from _parameters(value)


def _process_zones(jointed: JointedMesh, materials: Mapping[str, Any], laws: Any) -> list[str]:
    """Return a warning for each joint whose cells do not resolve its process zone (collective)."""
    texts, topology, comm = [], jointed.mesh.topology, jointed.mesh.comm
    for joint in jointed.joint_names:
        law: Any = laws.get(joint) if isinstance(laws, Mapping) else laws
        law = getattr(law, "law", law)
        if not hasattr(law, "shear_fracture_energy"):
            continue
        cells = topology.connectivity(topology.dim - 1, topology.dim)
        facets = np.concatenate([jointed.facets(joint + side) for side in "-+"])
        young = [
            np.min(elastic_part(material).young)
            for group, material in materials.items()
            if not group or np.isin(cells.array[cells.offsets[facets]], jointed.cells(group)).any()
        ]
        modulus = comm.allreduce(float(np.min(young, initial=np.inf)), MPI.MIN)
        corners = jointed.corners(f"{joint}-")
        sides = np.linalg.norm(corners - corners[:, :1], axis=2).max(axis=1)
        total, number = comm.allreduce(np.array([sides.sum(), len(sides)]))
        for mode, energy, strength in (
            ("tension", law.fracture_energy, law.tensile_strength),
            ("shear", law.shear_fracture_energy, law.cohesion),
        ):
            zone = ZONE_LENGTH * modulus * energy / strength**2
            if CELLS_PER_ZONE * total > zone * number:
                texts.append(
                    f"Joint {joint!r}: the fracture process zone in {mode} is {zone:.3g} m long, "
                    f"and the mean facet {total / number:.3g} m; use facets of at most "
                    f"{zone / CELLS_PER_ZONE:.3g} m, or a larger fracture energy."
                )
    return texts


def _water_twice(loads: Sequence[Any]) -> list[str]:
    """Return a warning for each face on which water has both waves and an added mass."""
    placed = [load for load in loads if hasattr(load, "group")]
    waves = {load.group for load in placed if hasattr(load, "water")}
    return [
        f"{type(mass).__name__} on {mass.group!r}: the mass of this water is counted twice, as the "
        "group also has reservoir waves."
        for mass in placed
        if hasattr(mass, "matrix") and mass.group in waves
    ]


def _in_kelvin(comm: Any, load: Any) -> list[str]:
    """Return a warning if only one of temperature and reference is in kelvin (collective)."""
    value: Any = getattr(load, "value", None)
    reference = getattr(load, "reference", None)
    given = list(reference.values()) if isinstance(reference, Mapping) else reference
    local, t_0 = numbers_of(value.x.array if hasattr(value, "x") else value), numbers_of(given)
    if local is None or t_0 is None or not t_0.size:
        return []
    t = np.concatenate(comm.allgather(local.ravel()))
    if (np.abs(np.abs(np.subtract.outer([t.min(), t.max()], t_0)) - KELVIN) > 70.0).any():
        return []
    text = f"is {t.min():.4g} to {t.max():.4g} with a reference of {t_0.flat[0]:g}"
    return [f"{type(load).__name__}: value {text}; is one of them in kelvin?"]


def _lowest_height(jointed: JointedMesh, load: Any) -> float:
    """Return the height of the lowest vertex of a load's face or joint [m] (collective)."""
    group = getattr(load, "group", None)
    if getattr(load, "joint", None) in jointed.joint_names:
        group = f"{load.joint}-"
    elif not hasattr(load, "level") or group not in jointed.facet_groups:
        return -np.inf
    lowest = float(jointed.corners(group)[..., -1].min(initial=np.inf))
    return jointed.mesh.comm.allreduce(lowest, MPI.MIN)


def _level(owner: str, load: Any, bottom: float, top: float, foot: float) -> list[str]:
    """Return a warning if water does not reach its face or exceeds 4/3 of the body's height."""
    level = getattr(load, "level", None)
    if not isinstance(level, int | float):
        return []
    if not bottom < level <= top + (top - bottom) / 3.0:
        return [f"{owner}: level is {level:g} m; the body extends from {bottom:g} to {top:g} m."]
    if level <= foot:
        place = f"joint {load.joint!r}" if hasattr(load, "joint") else f"group {load.group!r}"
        return [f"{owner}: level is {level:g} m; the lowest point of {place} is at {foot:g} m."]
    return []


def _out_of_range(quantity: str, value: Any, plausible: Range) -> list[str]:
    """Return a warning if a value is out of its range, with a unit that would explain it."""
    numbers = numbers_of(value)
    if numbers is None:
        return []
    outside = [float(x) for x in numbers.ravel() if x and not plausible.low <= x <= plausible.high]
    if not outside:
        return []
    x, unit = outside[0], f" {plausible.unit}".rstrip()
    meant = {n: x * scale for n, scale in plausible.others.items()}
    meant = {n: value for n, value in meant.items() if plausible.low <= value <= plausible.high}
    nearest = min(meant, key=lambda n: abs(np.log(meant[n] / plausible.usual)), default=None)
    hint = f"; is it in {nearest}?" if nearest else "."
    return [
        f"{quantity} is {x:g}{unit}; usual: {plausible.low:g} to {plausible.high:g}{unit}{hint}"
    ]
