# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Response measures of a run, from its results file: histories, peaks, spectra, joints.

Displacements and slips count from the last static stage or, in files without stages, from the
first record (`frames.zero_name`); both are called the static state here. Displacements are relative
to the ground or, if the ground moves within the model, absolute (``results.relative``).
``relative_to`` subtracts the displacement of a monitor point or of the ``"ground"`` (`frames`).
Points are given by name or number. Components are x (stream), y (cross-valley) and z (up). Missing
data raise a :class:`ResultsError`.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import ACCELERATION_BAND
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.motions.motion import Hertz, Motion
from dolfinx_joints.motions.processing import low_pass
from dolfinx_joints.motions.spectra import (
    equally_spaced,
    fourier_amplitude,
    highest_peak,
    significant_duration,
)
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES, extreme_of
from dolfinx_joints.postprocessing.frames import (
    ground_in_steps,
    ground_motion,
    has_ground_motion,
    reference_displacement,
    static_displacement,
)
from dolfinx_joints.postprocessing.joints.extremes import JointExtremes as JointExtremes
from dolfinx_joints.postprocessing.joints.extremes import joint_extremes as joint_extremes
from dolfinx_joints.postprocessing.joints.extremes import open_points as open_points
from dolfinx_joints.postprocessing.static_stages import StageEnergy as StageEnergy
from dolfinx_joints.postprocessing.static_stages import StageJoint as StageJoint
from dolfinx_joints.postprocessing.static_stages import StaticStage as StaticStage
from dolfinx_joints.postprocessing.static_stages import static_stages as static_stages
from dolfinx_joints.results.arguments import COMPONENTS, Component, check_results
from dolfinx_joints.results.joint_points import free_areas, gaps, zero_gap
from dolfinx_joints.results.quantities import JOINT_SERIES, TABLE, Quantity, rows_below
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.resolved import Resolved as Resolved
from dolfinx_joints.results.resolved import beyond
from dolfinx_joints.results.resolved import resolved_frequencies as resolved_frequencies

NotNegative = Annotated[float, at.Ge(0.0), at.Unit("s")]

JOINT_MEASURES = tuple(row.name for row in TABLE["measures"])
OPEN, SLIDING, FRICTIONLESS = 0, 2, 3  # values of `laws.law.Status` in results files


class FourierPeaks(NamedTuple):
    """Peaks of a Fourier amplitude; NaN without a peak.

    Attributes:
        frequency: Frequency of the highest peak [Hz].
        amplitude: Amplitude of the highest peak [m s].
        bin_width: Spacing of the frequencies, 1 / duration [Hz]. The uncertainty of a frequency
            is half the spacing.
        frequency_below: Frequency of the highest peak below the chosen frequency [Hz].
        amplitude_below: Amplitude of this second peak [m s].
    """

    frequency: float
    amplitude: float
    bin_width: float
    frequency_below: float
    amplitude_below: float


@checked
def displacement_history(
    results: Results,
    point: int | str,
    component: Component,
    relative_to: str | None = None,
    *,
    from_static: bool = True,
) -> tuple[Floats, Floats]:
    """Return the displacement of a point since the static state.

    With ``from_static=False`` the displacement of the static state is included.

    Returns:
        Times [s] and displacements [m], both of shape (records,).
    """
    check_results(results)
    column = COMPONENTS.index(component)
    index = results.point_index(point)
    u = results.series("histories", "displacement")[:, index, column]
    if from_static:
        u = u - static_displacement(results, "point_displacement", relative_to)[index, column]
    reference = reference_displacement(results, relative_to, from_static=from_static)
    return results.time("histories"), u - reference[:, column]


@checked
def acceleration_history(
    results: Results,
    point: int | str,
    component: Component,
    *,
    absolute: bool = True,
    band: Hertz | None = ACCELERATION_BAND,
) -> tuple[Floats, Floats]:
    """Return the mean acceleration of a point in each step, at the middle of the step.

    It is absolute, or relative to the ground with ``absolute=False``. Accelerations in a file have
    the reference of the displacements. For the other reference, the mean ground acceleration of the
    step is added or subtracted (`frames.ground_motion`).

    If joints close with impact, raw accelerations do not converge with shorter steps. A zero-phase
    low-pass filter (`processing.low_pass`) removes frequencies above ``band`` [Hz], at most
    `common_band`; with None, raw values are returned. Compare runs in the same band. A warning is
    raised if the band exceeds the resolved frequencies (`resolved_frequencies`).

    Returns:
        Times [s] and accelerations [m/s^2], both of shape (records - 1,). With a band, the steps
        are equal to the shortest step of the run.
    """
    check_results(results)
    column, time = COMPONENTS.index(component), results.time("histories")
    index = results.point_index(point)
    a = results.series("histories", "acceleration", slice(1, None))[:, index, column]
    if absolute and results.relative:
        a = a + ground_in_steps(results)[:, column]
    elif not absolute and not results.relative:
        a = a - ground_in_steps(results)[:, column]
    if band is None or len(a) < 2:
        return 0.5 * (time[1:] + time[:-1]), a
    dt, a = _equal_means(time, a)
    band = common_band(results, band=band)
    if warning := beyond(band, resolved_frequencies(results)):
        warn(f"{results.path}: {warning}", PlausibilityWarning)
    return time[0] + dt * (0.5 + np.arange(len(a))), low_pass(a, dt, band)


def common_band(*runs: Results, band: float = ACCELERATION_BAND) -> float:
    """Return the band in which accelerations of runs can be compared [Hz].

    This is the smaller of ``band`` and the Nyquist frequency of the longest step of all runs.
    """
    longest = [np.diff(results.time("histories")).max(initial=0.0) for results in runs]
    return float(min(band, *(0.5 / step for step in longest if step > 0.0), band))


def band_name(band: float | None, *runs: Results) -> str:
    """Return words for the filter of accelerations, and for the frequency that the runs resolve."""
    name = "raw" if band is None else f"low-passed at {band:.3g} Hz"
    frequency, by = resolved_frequencies(*runs).lowest if runs else (np.inf, "")
    return name + (f", resolved to {frequency:.3g} Hz by the {by}" if frequency < np.inf else "")


def _equal_means(time: Floats, means: Floats) -> tuple[float, Floats]:
    """Convert means over steps to means over equal steps; return the equal step [s] and means."""
    steps = np.diff(time)
    count = round((time[-1] - time[0]) / steps.min())
    dt = float((time[-1] - time[0]) / count)
    if np.allclose(steps, dt, rtol=1e-6, atol=0.0):
        return dt, means
    integral = np.append(0.0, np.cumsum(steps * means))
    return dt, np.diff(np.interp(np.linspace(time[0], time[-1], count + 1), time, integral)) / dt


@checked
def peaks(
    results: Results, point: int | str, *, strong_until: float, relative_to: str | None = None
) -> dict[str, dict[str, float]]:
    """Return the largest absolute displacement of a point since the static state [m].

    Returns:
        By component: ``"strong"`` up to ``strong_until`` [s], and ``"later"``; NaN without records.
    """
    largest: dict[str, dict[str, float]] = {}
    for component in COMPONENTS:
        time, u = displacement_history(results, point, component, relative_to)
        strong = time <= strong_until
        largest[component] = {"strong": _largest(u[strong]), "later": _largest(u[~strong])}
    return largest


def strong_motion_end(source: Motion | Results, share: float = 0.95) -> float:
    """Return the time at which the Arias intensity, summed over components, reaches a share [s].

    Args:
        source: A ground motion, or a run whose file contains the ground motion (`ground_motion`).
        share: Share of the final intensity, above 0 and at most 1.
    """
    if isinstance(source, Motion):
        return significant_duration(source.acceleration, source.dt, lower=0.0, upper=share)[1]
    time, values = ground_motion(source)
    dt, ground = equally_spaced(time, values)
    return float(time[0]) + significant_duration(ground, dt, lower=0.0, upper=share)[1]


def strong_phase_end(results: Results) -> float:
    """Return `strong_motion_end`, or the end of the run if the file has no ground motion [s]."""
    if has_ground_motion(results):
        return strong_motion_end(results)
    return float(results.time("histories")[-1])


@checked
def fourier_peaks(
    results: Results,
    point: int | str,
    component: Component,
    *,
    below: Hertz | None = None,
    relative_to: str | None = None,
) -> FourierPeaks:
    """Return the highest peak of the Fourier amplitude of a point's displacement.

    The amplitude is drawn by `plots.fourier`. A peak exceeds both its neighbours, so the mean value
    (with any residual displacement) is not a peak. A second peak is sought ``below`` a frequency.
    """
    dt, values = equally_spaced(*displacement_history(results, point, component, relative_to))
    frequency, amplitude = fourier_amplitude(values, dt)
    highest = highest_peak(frequency, amplitude)
    second = (np.nan, np.nan) if below is None else highest_peak(frequency, amplitude, below=below)
    return FourierPeaks(*highest, float(frequency[1]), *second)


def joint_history(results: Results, joint: str) -> tuple[Floats, Floats, Floats]:
    """Return opening and slip of the points of a joint at the stored states.

    The opening is the positive part of the normal gap. The slip is the relative tangential
    displacement of the sides since the static state, with the elastic part, at all points.

    Returns:
        Times of the stream ``states``, shape (records,), [s]; opening and slip, both of shape
        (records, points), [m].
    """
    results.check_joint(joint)
    gap = gaps(results, "states", joint)
    opening = np.maximum(gap[..., 0], 0.0)
    slip = np.linalg.norm((gap - zero_gap(results, joint))[..., 1:], axis=-1)
    return results.time("states"), opening, slip


@checked
def joint_measures(results: Results, *, tail: NotNegative = 1.0) -> dict[str, dict[str, float]]:
    """Return extremes of the motion of each joint.

    By joint, over all steps as in :func:`joint_extremes`:

    - ``opening_max``, ``slip_max`` [m] and ``pressure_max`` [Pa]: the largest value of all points
      and times; and ``mean_pressure_max`` [Pa]; with their times ``opening_time``, ... [s];

    By joint, over the records of ``states``, with opening and slip as in :func:`joint_history`:

    - ``opening_static`` [m]: the largest opening in the static state;
    - ``opening_residual`` and ``slip_residual`` [m]: the largest change since the static state,
      averaged at each point over the last ``tail`` seconds, the slip as a vector. It is residual
      only if the motion has ended (`slip_in_tail`); `to_rest` leads to the state at rest;
    - ``share_open``, ``share_sliding`` and ``share_frictionless`` (closed without friction): the
      share of the joint area with this ``status``, averaged over the records. In a file without
      ``status``, points without traction are open and the other two shares are NaN;
    - ``share_broken``: the share of the cohesion that is lost at the last record, zero for joints
      without bonds.

    Tied points, at the end of a joint inside a body, and their area are excluded.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.frictionless(normal_stiffness=1e11)
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=[dj.Fixed(group="base")])
        >>> monitor = dj.ResultsMonitor("blocks.h5", points={"top": (0.5, 0.5, 2.0)})
        >>> run = dj.Simulation(model, monitors=[monitor])
        >>> outcome = run.dynamics(dt=0.01, steps=10, motion=lambda t: (1.0, 0.0, 0.0))
        >>> joint = dj.measures.joint_measures(dj.Results("blocks.h5"))["joint_1"]
        >>> round(joint["slip_max"], 5)  # 0.5 * 1 m/s^2 * (0.1 s)^2 [m]
        0.005
    """
    check_results(results)
    return {joint: _measures_of(results, joint, tail) for joint in results.joints}


def _measures_of(results: Results, joint: str, tail: float) -> dict[str, float]:
    time, opening, _ = joint_history(results, joint)
    gap, zero = gaps(results, "states", joint), zero_gap(results, joint)
    static = np.maximum(zero[0, :, 0], 0.0)
    traction = results.series("states", f"joints/{joint}/traction")
    areas = free_areas(results, joint)
    shares = areas / areas.sum()
    is_late = time >= time[-1] - tail
    measures = {
        "opening_static": float(static.max()),
        "opening_residual": float((opening[is_late].mean(axis=0) - static).max()),
        "slip_residual": slip_in_tail(results, joint, tail=tail)[0],
        "share_broken": 0.0,
    }
    if has_bonds(results, joint):
        measures["share_broken"] = float(
            results.series("states", f"joints/{joint}/broken", -1) @ shares
        )
    extremes = joint_extremes(results, joint)
    for key in extremes.values.keys() & {row.key for row in JOINT_SERIES}:
        largest = extremes.values[key]
        measures[f"{key}_max"] = float(largest.max())
        measures[f"{key}_time"] = float(extremes.time[np.argmax(largest)])
    if f"joints/{joint}/status" in results.streams["states"]:
        status = results.series("states", f"joints/{joint}/status")
        flags_of_states = [status == kind for kind in (OPEN, SLIDING, FRICTIONLESS)]
    else:
        unknown = np.full(gap.shape[:-1], np.nan)
        flags_of_states = [open_points(gap, traction), unknown, unknown]
    for name, flags in zip(("open", "sliding", "frictionless"), flags_of_states, strict=True):
        measures[f"share_{name}"] = float((flags @ shares).mean())
    return {name: measures.get(name, np.nan) for name in JOINT_MEASURES}  # NaN in older files


def slip_in_tail(results: Results, joint: str, *, tail: float = 1.0) -> tuple[float, float]:
    """Return mean (``slip_residual``) and variation of the slip over the last seconds [m].

    The variation is the largest distance of a point's slip from its mean in the stored states.
    """
    time = results.time("states")
    rows = slice(int(np.searchsorted(time, time[-1] - tail)), len(time))
    slip = (gaps(results, "states", joint, rows) - zero_gap(results, joint))[..., 1:]
    mean = slip.mean(axis=0)
    size, variation = (float(np.linalg.norm(x, axis=-1).max()) for x in (mean, slip - mean))
    return size, variation


def joint_shares(*runs: Results) -> list[Quantity]:
    """Return the rows of shares of joint points, without ``joint_frictionless`` if it is zero."""
    name, shares = "joint_frictionless", rows_below("histories", "joint_")
    recorded_runs = (run for run in runs if name in run.streams.get("histories", []))
    any_frictionless = any(run.series("histories", name).any() for run in recorded_runs)
    return [row for row in shares if any_frictionless or row.name != name]


def has_bonds(results: Results, joint: str) -> bool:
    """Return True if the points of a joint have bonds, intact or broken."""
    return f"joints/{joint}/broken" in results.streams.get("states", ())


def stress_extremes(results: Results) -> dict[str, float]:
    """Return the largest value of each envelope ``.._max`` and the smallest of ``.._min`` [Pa].

    Keys are the names of the stream ``envelopes``. A value is NaN if the envelope was not recorded,
    or if no point has this direction.
    """
    check_results(results)
    if "envelopes" not in results.streams or not results.rows("envelopes"):
        return dict.fromkeys(ENVELOPE_NAMES, np.nan)
    return {n: extreme_of(n, results.series("envelopes", n, -1)) for n in ENVELOPE_NAMES}


def _largest(values: Floats) -> float:
    return float(np.abs(values).max()) if values.size else np.nan
