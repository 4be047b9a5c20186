# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report sections on the earthquake: displacements of points, accelerations, spectra."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.motions.processing import low_pass
from dolfinx_joints.motions.spectra import equally_spaced, fourier_amplitude, response_spectrum
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing.frames import (
    common_frame,
    frame_name,
    ground_motion,
    ground_name,
    has_ground_motion,
)
from dolfinx_joints.report.page import Html, Section, details, paragraph, table
from dolfinx_joints.report.panels import Curve, panels
from dolfinx_joints.report.runs import Content, Run, components, nothing, zeros
from dolfinx_joints.results.arguments import Component

FREQUENCIES = 15.0  # end of the frequency axes [Hz]
PERIODS = np.geomspace(0.03, 3.0, 80)
SPECTRUM_DAMPING = 0.05

_DISPLACEMENTS = "Earthquake: displacements"


def ground(content: Content) -> Section | None:
    """Return the section with the ground's acceleration and its peaks, None without a ground."""
    runs = [run for run in content.runs if has_ground_motion(run.results)]
    if not runs:
        return None
    names, rows = components(runs), []
    curves: list[list[Curve]] = [[] for _ in names]
    for run in runs:
        time, acceleration = ground_motion(run.results)
        for panel, series in zip(curves, acceleration[:, : len(run.components)].T, strict=False):
            panel.append((run.label, time, series))
        largest = np.abs(acceleration).max(axis=0)[: len(names)] / STANDARD_GRAVITY
        until = measures.strong_phase_end(run.results)
        rows.append([run.label, float(time[-1] - time[0]), until, *largest.tolist()])
    head = ["run", "duration [s]", "strong phase ends [s]", *(f"largest {c} [g]" for c in names)]
    spec = panels(curves, [f"{component} [m/s²]" for component in names], "time [s]")
    where = common_frame({run.label: ground_name(run.results) for run in runs})
    caption = f"Acceleration of the {where} against time, not filtered."
    plotted = content.drawings.plot("ground-motion", spec, caption)
    pieces = [table("Largest accelerations of the ground", head, rows), plotted]
    return Section("ground", "Earthquake: ground motion", pieces)


def displacements(content: Content) -> Section:
    """Return the section with histories, Fourier amplitudes and peaks of each point."""
    runs = [run for run in content.runs if run.moves]
    if not runs:
        return nothing("displacements", _DISPLACEMENTS, "histories of two records or more")
    pieces = [
        paragraph(f"Displacements are {_frames(runs)}, {zeros(runs)}.", "note"),
        paragraph(
            "Click a name in a legend to show or hide a run; only two runs are visible at first.",
            "note screen",
        ),
        table(
            "Largest displacements and Fourier peaks",
            [
                "point, component, run",
                "strong phase ends [s]",
                "largest before this end [mm]",
                "largest after this end [mm]",
                "Fourier peak at [Hz]",
                "± [Hz]",
                "Fourier peak [mm s]",
            ],
            [row for name in _points(runs) for row in _peak_rows(runs, name)],
        ),
        paragraph(
            "The strong phase ends at 95 % of the ground's Arias intensity, summed over the "
            "components. If the file has no ground acceleration, it is the whole run. The "
            "frequency of a Fourier peak is accurate to half the frequency spacing (±). Peaks are "
            "sought above 0 Hz and exceed both neighbours: residual displacements are no peak.",
            "note",
        ),
    ]
    for number, name in enumerate(_points(runs)):
        with_point = _runs_with_point(runs, name)
        plotted = []
        for kind, draw in (("history", _histories), ("fourier", _spectra)):
            spec, caption = draw(with_point, name)
            plotted.append(content.drawings.plot(f"{kind}-{number + 1}", spec, caption))
        pieces.append(details(f"Plots of {name}", plotted, opened=number == 0))
    return Section("displacements", _DISPLACEMENTS, pieces)


def response_spectra(content: Content) -> Section:
    """Return the section on absolute accelerations and response spectra, with one cut-off."""
    runs = [run for run in content.runs if run.has("histories", "acceleration")]
    runs = [run for run in runs if run.results.rows("histories") > 3]
    title = "Earthquake: accelerations and response spectra"
    if not runs:
        return nothing("accelerations", title, "accelerations")
    rows: list[list[Any]] = []
    pieces: list[Html] = []
    ground, band = {}, content.band
    if has_ground_motion(runs[0].results):
        ground = {ground_name(runs[0].results): _spectrum(runs[0], None, band)}
    for number, name in enumerate(_points(runs)):
        with_point = _runs_with_point(runs, name)
        rows += [_acceleration_row(run, name, band) for run in with_point]
        spectra = {run.label: _spectrum(run, name, band) for run in with_point}
        spectra |= ground
        names = components(with_point)
        curves = [
            [(label, PERIODS, v[:, column]) for label, v in spectra.items() if column < v.shape[1]]
            for column in range(len(names))
        ]
        titles = [f"{component} [m/s²]" for component in names]
        shaded = _unresolved_periods(with_point)
        spec = panels(curves, titles, "period [s]", logarithmic=True, shaded=shaded)
        caption = (
            f"Pseudo-acceleration of oscillators with {100 * SPECTRUM_DAMPING:g} % damping on "
            f"{name}"
        )
        for ground_label in ground:
            caption += f", and on the {ground_label} of {runs[0].label}"
        caption += "."
        named = measures.band_name(band, *(run.results for run in with_point))
        caption += (
            f" Accelerations are {named}{'; unresolved periods are shaded' if shaded else ''}."
        )
        plotted = content.drawings.plot(f"response-{number + 1}", spec, caption)
        pieces.append(details(f"Response spectra at {name}", [plotted], opened=number == 0))
    head = ["point, run", *(f"{c} [m/s²]" for c in components(runs))]
    rows = [[*row, *[None] * (len(head) - len(row))] for row in rows]
    named = measures.band_name(band, *(run.results for run in runs))
    pieces.insert(0, table(f"Largest absolute accelerations, {named}", head, rows))
    return Section("accelerations", title, pieces)


def _points(runs: Iterable[Run]) -> list[str]:
    return list(dict.fromkeys(name for run in runs for name in run.results.point_names))


def _runs_with_point(runs: Iterable[Run], name: str) -> list[Run]:
    return [run for run in runs if name in run.results.point_names]


def _peak_rows(runs: Sequence[Run], name: str) -> list[list[Any]]:
    rows = []
    for component in components(runs):
        for run in _runs_with_point(runs, name):
            if component in run.components:
                until, base = measures.strong_phase_end(run.results), run.relative_to
                peaks = measures.peaks(run.results, name, strong_until=until, relative_to=base)
                peak = peaks[component]
                fourier = measures.fourier_peaks(run.results, name, component, relative_to=base)
                largest = [until, 1e3 * peak["strong"], 1e3 * peak["later"]]
                spectrum = [fourier.frequency, 0.5 * fourier.bin_width, 1e3 * fourier.amplitude]
                rows.append([f"{name}, {component}, {run.label}", *largest, *spectrum])
    return rows


def _frames(runs: Sequence[Run]) -> str:
    """Return a text on the reference frame of the runs' displacements."""
    return common_frame({run.label: frame_name(run.results, run.relative_to) for run in runs})


def _curves(runs: Sequence[Run], name: str, of: Callable[..., Any]) -> list[list[Curve]]:
    """Return the curves of a quantity of a point, one panel per component."""
    return [
        [(run.label, *of(run, name, c)) for run in runs if c in run.components]
        for c in components(runs)
    ]


def _histories(runs: Sequence[Run], name: str) -> tuple[dict[str, Any], str]:
    def history(run: Run, name: str, component: Component) -> tuple[Floats, Floats]:
        time, u = measures.displacement_history(run.results, name, component, run.relative_to)
        return time, 1e3 * u

    titles = [f"{component} [mm]" for component in components(runs)]
    caption = f"Displacement of {name} {zeros(runs)} against time."
    return panels(_curves(runs, name, history), titles, "time [s]"), caption


def _spectra(runs: Sequence[Run], name: str) -> tuple[dict[str, Any], str]:
    def spectrum(run: Run, name: str, component: Component) -> tuple[Floats, Floats]:
        moved = measures.displacement_history(run.results, name, component, run.relative_to)
        dt, u = equally_spaced(*moved)
        frequency, amplitude = fourier_amplitude(u, dt)
        shown = frequency <= FREQUENCIES
        return frequency[shown], 1e3 * amplitude[shown]

    titles = [f"{component} [mm s]" for component in components(runs)]
    caption = f"Fourier amplitude of the displacement of {name}, up to {FREQUENCIES:g} Hz."
    curves = _curves(runs, name, spectrum)
    return panels(curves, titles, "frequency [Hz]", limit=FREQUENCIES), caption


def _unresolved_periods(runs: Sequence[Run]) -> tuple[float, float] | None:
    """Return the range of periods that at least one run does not resolve [s], or None."""
    lowest, _ = measures.resolved_frequencies(*(run.results for run in runs)).lowest
    ends = float(PERIODS[0]), float(min(1.0 / lowest, PERIODS[-1]))
    return ends if ends[0] < ends[1] else None


def _acceleration_row(run: Run, name: str, band: float) -> list[Any]:
    largest = []
    for component in run.components:
        _, a = measures.acceleration_history(run.results, name, component, band=band)
        largest.append(float(np.abs(a).max()))
    return [f"{name}, {run.label}", *largest]


def _spectrum(run: Run, name: str | None, band: float) -> Floats:
    """Return pseudo-accelerations (periods, components) [m/s^2] of a point, or of the ground."""
    if name is None:
        times, values = ground_motion(run.results)
        dt, values = equally_spaced(times, values[:, : len(run.components)])
        values = low_pass(values, dt, band)
    else:
        history = partial(measures.acceleration_history, run.results, name, band=band)
        series = [history(c) for c in run.components]
        dt, values = equally_spaced(series[0][0], np.stack([a for _, a in series], axis=1))
    return response_spectrum(values, dt, PERIODS, SPECTRUM_DAMPING).pseudo_acceleration
