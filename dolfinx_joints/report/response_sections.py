# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections of a report on the response: displacements of points, response spectra, joints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.motions.spectra import (
    Floats,
    equally_spaced,
    fourier_amplitude,
    response_spectrum,
)
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.frames import (
    common_frame,
    frame_name,
    ground_motion,
    ground_name,
    has_ground_motion,
    reference_displacement,
)
from dolfinx_joints.report.page import (
    Curve,
    Html,
    Section,
    details,
    figure,
    heading,
    panels,
    paragraph,
    plain,
    table,
)
from dolfinx_joints.report.runs import Content, Run, components, nothing
from dolfinx_joints.results.arguments import Component

FREQUENCIES = 15.0  # end of the frequency axes [Hz]
PERIODS = np.geomspace(0.03, 3.0, 80)
SPECTRUM_DAMPING = 0.05


def displacements(content: Content) -> Section:
    """Histories and Fourier amplitudes of each point, with their peaks."""
    runs = [run for run in content.runs if run.moves]
    if not runs:
        return nothing("displacements", "Displacements", "histories of two records or more")
    pieces = [
        paragraph(
            f"Displacements are {_frames(runs)} and counted from the static state, the "
            "first record. Click a name in a legend to show or hide a run; runs after the second "
            "start hidden.",
            "note",
        ),
        table(
            "Largest displacements and Fourier peaks",
            [
                "point, component, run",
                "strong phase ends [s]",
                "largest until then [mm]",
                "largest after it [mm]",
                "Fourier peak at [Hz]",
                "± [Hz]",
                "Fourier peak [mm s]",
            ],
            [row for name in _points(runs) for row in _peak_rows(runs, name)],
        ),
        paragraph(
            "The strong phase lasts until 95 % of the ground's Arias intensity, all components "
            "together, have arrived; where a file holds no ground acceleration it is the whole "
            "run. A Fourier peak is known to half the distance of two frequencies.",
            "note",
        ),
    ]
    for number, name in enumerate(_points(runs)):
        having = _having(runs, name)
        plotted = []
        for kind, draw in (("history", _histories), ("fourier", _spectra)):
            spec, caption = draw(having, name)
            pictures = _pictures(content, kind, name, number)
            plotted.append(content.drawings.plot(f"{kind}-{number + 1}", spec, caption, pictures))
        pieces.append(details(f"Plots of {name}", plotted, opened=number == 0))
    return Section("displacements", "Displacements", pieces)


def response_spectra(content: Content) -> Section:
    """Absolute accelerations and response spectra of points and ground."""
    runs = [run for run in content.runs if run.has("histories", "acceleration")]
    runs = [run for run in runs if run.results.rows("histories") > 3]
    title = "Accelerations and response spectra"
    if not runs:
        return nothing("accelerations", title, "accelerations")
    rows: list[list[Any]] = []
    pieces: list[Html] = []
    ground = {}
    if has_ground_motion(runs[0].results):
        ground = {ground_name(runs[0].results): _spectrum(runs[0], None)}
    for number, name in enumerate(_points(runs)):
        having = _having(runs, name)
        rows += [_acceleration_row(run, name) for run in having]
        spectra = {run.label: _spectrum(run, name) for run in having}
        spectra |= ground
        names = components(having)
        curves = [
            [(label, PERIODS, v[:, column]) for label, v in spectra.items() if column < v.shape[1]]
            for column in range(len(names))
        ]
        titles = [f"{component} [m/s²]" for component in names]
        spec = panels(curves, titles, "period [s]", logarithmic=True)
        caption = (
            f"Pseudo-acceleration of oscillators with {100 * SPECTRUM_DAMPING:g} % damping on "
            f"{name}"
        )
        for what in ground:
            caption += f", and on the {what} of {runs[0].label} (hidden at first)"
        caption += "."
        plotted = content.drawings.plot(f"response-{number + 1}", spec, caption)
        pieces.append(details(f"Response spectra at {name}", [plotted], opened=number == 0))
    head = ["point, run", *(f"{c} [m/s²]" for c in components(runs))]
    rows = [[*row, *[None] * (len(head) - len(row))] for row in rows]
    pieces.insert(0, table("Largest absolute accelerations", head, rows))
    return Section("accelerations", title, pieces)


def joints(content: Content) -> Section:
    """Table of the joints' measures and maps of their tractions."""
    runs = [run for run in content.runs if run.results.joints and run.has("states")]
    if not runs:
        return nothing("joints", "Joints", "joints with recorded states")
    pieces: list[Html] = []
    head = ["joint", *(title for title, _, _ in _JOINT_COLUMNS)]
    for run in runs:
        rows = [
            [name, *(factor * found[key] for _, factor, key in _JOINT_COLUMNS)]
            for name, found in measures.joint_measures(run.results).items()
        ]
        pieces.append(table(f"Joints of {run.label}", head, rows))
    pieces.append(
        paragraph(
            "Opening is the positive part of the normal gap. Slip is the tangential displacement "
            "of the two sides against each other from the static state, whether they touch or "
            "not. Residual values are what the last second's mean adds to the static state. "
            "Shares are of area and time.",
            "note",
        )
    )
    run = content.main if content.main in runs else runs[0]
    pieces += _maps(content, run)
    return Section("joints", "Joints", pieces)


# Title, factor and name of each measure of a joint.
_JOINT_COLUMNS = (
    ("static opening [mm]", 1e3, "opening_static"),
    ("largest opening [mm]", 1e3, "opening_max"),
    ("residual opening [mm]", 1e3, "opening_residual"),
    ("widest at [s]", 1.0, "opening_time"),
    ("largest slip [mm]", 1e3, "slip_max"),
    ("residual slip [mm]", 1e3, "slip_residual"),
    ("largest slip at [s]", 1.0, "slip_time"),
    ("open [%]", 100.0, "share_open"),
    ("sliding [%]", 100.0, "share_sliding"),
    ("largest pressure [MPa]", 1e-6, "pressure_max"),
)


def _maps(content: Content, run: Run) -> list[Html]:
    """Maps of the tractions on all joints at the largest displacement of the first point."""
    if run.plane:
        return [paragraph("The model is plane: its joints are lines, of which no maps are drawn.")]
    time = largest_moment(run)
    pieces = [heading(f"Tractions of {run.label} at t = {time:.3f} s")]
    pieces.append(
        paragraph(
            "The moment of the largest recorded displacement of the first point. Compression is "
            "negative; open areas are black.",
            "note",
        )
    )
    for number, joint in enumerate(run.results.joints):
        pictures = []
        for quantity in ("normal", "tangential", "ratio"):
            drawn = plots.joint_traction(run.results, joint, quantity, time=time)
            path = content.save(f"joint_{number + 1}_{quantity}", drawn, dpi=80)
            alt = f"Map of the {quantity} traction on {joint}, with open areas black"
            if quantity == "ratio":
                alt = f"Map of the ratio of shear to normal traction on {joint}"
            pictures.append(content.drawings.picture(path, alt))
        shown = figure(
            pictures, f"{joint}: normal and tangential traction, and their ratio with its sign."
        )
        pieces.append(details(joint, [shown]))
    return pieces


def largest_moment(run: Run) -> float:
    """Time of the state nearest to the largest displacement of the first point [s]."""
    moments = run.results.time("states")
    if not run.has("histories", "displacement"):
        return float(moments[-1])
    u = _moved(run)[:, 0]
    largest = int(np.argmax(np.linalg.norm(u - u[0], axis=1)))
    time = float(run.results.time("histories")[largest])
    return float(moments[run.results.nearest("states", time)])


def largest_displacement(run: Run) -> str | None:
    """Text on the largest displacement of a monitor point."""
    if not run.has("histories", "displacement"):
        return None
    u = _moved(run)
    size = np.linalg.norm(u - u[:1], axis=2)
    row, point = np.unravel_index(int(np.argmax(size)), size.shape)
    time = float(run.results.time("histories")[row])
    name = run.results.point_names[int(point)]
    frame = "" if run.results.relative else f", {frame_name(run.results, run.relative_to)}"
    return f"{plain(1e3 * float(size[row, point]))} mm at {name}, t = {plain(time)} s{frame}"


def _moved(run: Run) -> Floats:
    """Displacements of the monitor points as the report shows them, (records, points, 3), [m]."""
    u = run.results.series("histories", "displacement")
    moved: Floats = u - reference_displacement(run.results, run.relative_to)[:, None]
    return moved


def widest_opening(run: Run) -> str | None:
    """Text on the largest opening of a joint."""
    if not run.results.joints:
        return "has no joints"
    if not run.has("states"):
        return None
    found = measures.joint_measures(run.results)
    name = max(found, key=lambda joint: found[joint]["opening_max"])
    most = found[name]
    return (
        f"{plain(1e3 * most['opening_max'])} mm on {name}, t = {plain(most['opening_time'])} s, "
        f"and a slip of up to {plain(1e3 * max(m['slip_max'] for m in found.values()))} mm"
    )


def _points(runs: Iterable[Run]) -> list[str]:
    return list(dict.fromkeys(name for run in runs for name in run.results.point_names))


def _having(runs: Iterable[Run], name: str) -> list[Run]:
    return [run for run in runs if name in run.results.point_names]


def _peak_rows(runs: Sequence[Run], name: str) -> list[list[Any]]:
    rows = []
    for component in components(runs):
        for run in _having(runs, name):
            if component in run.components:
                until, base = measures.strong_phase_end(run.results), run.relative_to
                peaks = measures.peaks(run.results, name, strong_until=until, relative_to=base)
                peak = peaks[component]
                found = measures.fourier_peaks(run.results, name, component, relative_to=base)
                largest = [until, 1e3 * peak["strong"], 1e3 * peak["later"]]
                spectrum = [found.frequency, 0.5 * found.bin_width, 1e3 * found.amplitude]
                rows.append([f"{name}, {component}, {run.label}", *largest, *spectrum])
    return rows


def _frames(runs: Sequence[Run]) -> str:
    """What the displacements of the runs are relative to."""
    return common_frame({run.label: frame_name(run.results, run.relative_to) for run in runs})


def _curves(runs: Sequence[Run], name: str, of: Callable[..., Any]) -> list[list[Curve]]:
    """Panels of a quantity of a point, by component."""
    return [
        [(run.label, *of(run, name, c)) for run in runs if c in run.components]
        for c in components(runs)
    ]


def _histories(runs: Sequence[Run], name: str) -> tuple[dict[str, Any], str]:
    def history(run: Run, name: str, component: Component) -> tuple[Floats, Floats]:
        time, u = measures.displacement_history(run.results, name, component, run.relative_to)
        return time, 1e3 * u

    titles = [f"{component} [mm]" for component in components(runs)]
    caption = f"Displacement of {name} from the static state over time."
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


def _pictures(content: Content, kind: str, name: str, number: int) -> list[Path]:
    """Pictures of a point's histories or spectra, of the main run and its reference."""
    main, reference = content.main, content.reference
    if not main.moves or name not in main.results.point_names:
        return []
    draw: Callable[..., Any] = plots.history if kind == "history" else plots.fourier
    options: dict[str, Any] = {"relative_to": main.relative_to}
    if reference is not None and reference.moves and name in reference.results.point_names:
        options |= {"reference": reference.results, "labels": (main.label, reference.label)}
    return [
        content.save(f"{kind}_{number + 1}_{c}", draw(main.results, name, c, **options))
        for c in main.components
    ]


def _acceleration_row(run: Run, name: str) -> list[Any]:
    largest = []
    for component in run.components:
        _, a = measures.acceleration_history(run.results, name, component)
        largest.append(float(np.abs(a).max()))
    return [f"{name}, {run.label}", *largest]


def _spectrum(run: Run, name: str | None) -> Floats:
    """Pseudo-accelerations of a point or, without a name, of the ground.

    Shape (periods, components), [m/s^2].
    """
    if name is None:
        times, values = ground_motion(run.results)
        values = values[:, : len(run.components)]
    else:
        each = [measures.acceleration_history(run.results, name, c) for c in run.components]
        times, values = each[0][0], np.stack([a for _, a in each], axis=1)
    dt, values = equally_spaced(times, values)
    return response_spectrum(values, dt, PERIODS, SPECTRUM_DAMPING).pseudo_acceleration
