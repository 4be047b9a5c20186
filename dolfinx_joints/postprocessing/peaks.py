# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Largest values of a run, with their times and places, from its results file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import ACCELERATION_BAND
from dolfinx_joints.postprocessing.envelopes import EnvelopeName
from dolfinx_joints.postprocessing.frames import usual_reference
from dolfinx_joints.postprocessing.joints.extremes import joint_extremes
from dolfinx_joints.postprocessing.measures import (
    acceleration_history,
    common_band,
    displacement_history,
)
from dolfinx_joints.postprocessing.static_stages import static_stages
from dolfinx_joints.results.arguments import COMPONENTS
from dolfinx_joints.results.reader import Results

_CREST = 0.01  # largest depth of crest points below the highest point, relative to all heights

# Names of values of `main_values`, with their units.
CREST_DISPLACEMENT = "crest displacement [m]"
CREST_ACCELERATION = "crest acceleration below {:.3g} Hz [m/s^2]"
STRESSES: dict[EnvelopeName, str] = {
    "principal_max": "largest tension [Pa]",
    "principal_min": "largest compression [Pa]",
}
JOINT_VALUES = {"opening": "opening [m]", "slip": "slip [m]", "safety": "safety [-]"}
JOINT_FORCES = {
    "pressure": "pressure [Pa]",
    "compression": "compressive force [N]",
    "shear_sum": "shear force [N]",
}


@dataclass(frozen=True, kw_only=True)
class Peak:
    """Largest value of a quantity.

    Attributes:
        value: Value in SI units, with its sign.
        time: Time of the value, or NaN [s].
        name: Monitor point and component, such as ``crest x``; empty for other quantities.
        place: Coordinates, shape (3,), NaN if the value does not belong to a point [m].
    """

    value: float
    time: float = np.nan
    name: str = ""
    place: Floats = field(default_factory=lambda: np.full(3, np.nan))


def crest_points(results: Results) -> list[str]:
    """Return the names of the highest monitor points, within 1 % of the height of all points."""
    if "histories/points" not in results.statics or not results.point_names:
        return []
    points = results.static("histories/points")
    nodes = results.static("mesh/nodes") if "mesh/nodes" in results.statics else points
    up = 2 if np.ptp(nodes[:, 2]) > 0.0 else 1  # y is upwards in plane models
    height = points[:, up]
    # The second tolerance allows for rounding errors of points at the same height.
    high = height >= height.max() - max(_CREST * np.ptp(height), 1e-9 * np.ptp(nodes))
    return [name for name, is_high in zip(results.point_names, high, strict=True) if is_high]


def displacement_peak(
    results: Results, points: Sequence[str], relative_to: str | None = None
) -> Peak:
    """Return the largest component of the displacement of points (`displacement_history`) [m]."""
    history = partial(displacement_history, relative_to=relative_to)
    return _largest(results, points, history)


def acceleration_peak(
    results: Results, points: Sequence[str], *, band: float | None = ACCELERATION_BAND
) -> Peak:
    """Return the largest component of the absolute acceleration of points [m/s^2].

    `acceleration_history` computes it, low-passed at ``band`` [Hz], or raw for None.
    """
    return _largest(results, points, partial(acceleration_history, band=band))


def joint_peaks(results: Results, joint: str) -> dict[str, Peak]:
    """Return the largest ``opening`` and ``slip`` of a joint [m] and its smallest ``safety``.

    The values cover all steps of `joint_extremes`. The safety is NaN if it is never defined.
    """
    extremes = joint_extremes(results, joint)
    peaks = {}
    for name in ("opening", "slip"):
        values, places = getattr(extremes, name), getattr(extremes, f"{name}_at")
        at = int(np.argmax(values))
        peaks[name] = Peak(value=float(values[at]), time=float(extremes.time[at]), place=places[at])
    safety = np.where(np.isnan(extremes.safety), np.inf, extremes.safety)
    least = int(np.argmin(safety))
    peaks["safety"] = Peak(value=np.nan)
    if np.isfinite(safety[least]):
        peaks["safety"] = Peak(value=float(safety[least]), time=float(extremes.time[least]))
    return peaks


def stress_peak(results: Results, name: EnvelopeName) -> Peak:
    """Return the largest value of an envelope ``.._max``, or the smallest of ``.._min``, or NaN."""
    if name not in results.streams.get("envelopes", []) or not results.rows("envelopes"):
        return Peak(value=np.nan)
    values = results.series("envelopes", name, -1)
    if np.isnan(values).all():
        return Peak(value=np.nan)
    at = int(np.nanargmax(values) if name.endswith("max") else np.nanargmin(values))
    place = results.static("mesh/nodes")[results.static("envelopes/nodes")[at]]
    return Peak(value=float(values[at]), place=place)


def _largest(
    results: Results, points: Sequence[str], history: Callable[..., tuple[Floats, Floats]]
) -> Peak:
    """Return the largest absolute value of all components of all points."""
    largest = Peak(value=np.nan)
    places = results.static("histories/points")
    for point in points:
        for component in COMPONENTS:
            time, values = history(results, point, component)
            if values.size and not abs(values).max() <= abs(largest.value):
                at = int(np.argmax(np.abs(values)))
                place = places[results.point_index(point)]
                value, instant = float(values[at]), float(time[at])
                largest = Peak(value=value, time=instant, name=f"{point} {component}", place=place)
    return largest


def main_values(results: Results, *, band: float = ACCELERATION_BAND) -> dict[str, float]:
    """Return the main values of a run without signs, by name with unit.

    The values are those of the first page of a report, pressures and forces of the joints, and
    energies. Values of a joint begin with its name and a colon. If a run has only static stages,
    they are those at the end of the last one. Values that the file does not contain are left out.

    Args:
        results: The run.
        band: Cut-off frequency of the accelerations [Hz], at most that of `common_band`; the name
            of the value contains it.
    """
    is_dynamic = "histories" in results.streams
    values = _dynamic_values(results, band) if is_dynamic else _static_values(results)
    for name, worst in zip(JOINT_VALUES.values(), (max, max, min), strict=True):
        of_joints = [value for key, value in values.items() if key.endswith(f": {name}")]
        if len(of_joints) > 1:
            values[f"{name.replace(' [', ' of all joints [')}"] = worst(of_joints)
    return {name: abs(float(value)) for name, value in values.items() if np.isfinite(value)}


def _dynamic_values(results: Results, band: float) -> dict[str, float]:
    from dolfinx_joints.postprocessing.energy_lines import energy_lines

    values: dict[str, float] = {}
    points, recorded = crest_points(results), set(results.streams["histories"])
    if points:
        peak = displacement_peak(results, points, usual_reference(results))
        values[CREST_DISPLACEMENT] = peak.value
    if points and {"acceleration", *["ground_acceleration"] * results.relative} <= recorded:
        band = common_band(results, band=band)
        peak = acceleration_peak(results, points, band=band)
        values[CREST_ACCELERATION.format(band)] = peak.value
    values |= {title: stress_peak(results, name).value for name, title in STRESSES.items()}
    for joint in results.joints:
        largest, series = joint_peaks(results, joint), joint_extremes(results, joint).values
        values |= {f"{joint}: {JOINT_VALUES[name]}": peak.value for name, peak in largest.items()}
        of_series = {title: name for name, title in JOINT_FORCES.items() if name in series}
        values |= {f"{joint}: {title}": series[n].max() for title, n in of_series.items()}
    if "energy" in results.streams and results.rows("energy"):
        lines = energy_lines(results)
        values |= {
            f"largest {name} energy [J]": lines[name].max() for name in ("kinetic", "strain")
        }
        losses = {"viscous": "work against damping [J]", "friction": "work against friction [J]"}
        values |= {title: lines[name][-1] for name, title in losses.items()}
    return values


def _static_values(results: Results) -> dict[str, float]:
    """Return the values at the end of the last static stage."""
    stage, points = static_stages(results)[-1], crest_points(results)
    values: dict[str, float] = {}
    if points:
        values[CREST_DISPLACEMENT] = max(np.abs(stage.displacement[p]).max() for p in points)
    values |= {title: stage.stresses[name] for name, title in STRESSES.items()}
    for joint, state in stage.joints.items():
        moved = (state.opening_max, state.slip_max, state.sliding_safety)
        forces = (state.pressure_max, state.normal_force, state.shear_force)
        titles = [*JOINT_VALUES.values(), *JOINT_FORCES.values()]
        pairs = zip(titles, [*moved, *forces], strict=True)
        values |= {f"{joint}: {title}": value for title, value in pairs}
    if stage.energy:
        values["strain energy [J]"] = stage.energy.strain
    return values
