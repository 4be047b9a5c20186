# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""First part of a report: the dam, the main results, warnings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from dolfinx_joints.common.constants import LARGE_ENERGY_ERROR, LARGE_LOCAL_ERROR, STANDARD_GRAVITY
from dolfinx_joints.postprocessing import measures, peaks, views
from dolfinx_joints.postprocessing.energy_lines import energy_lines, joint_losses
from dolfinx_joints.postprocessing.envelopes import EnvelopeName
from dolfinx_joints.postprocessing.frames import common_frame, frame_name, zero_name
from dolfinx_joints.postprocessing.peaks import Peak
from dolfinx_joints.report.check_section import unmet
from dolfinx_joints.report.page import (
    Cell,
    Html,
    bullets,
    figure,
    heading,
    paragraph,
    plain,
    table,
    valued,
)
from dolfinx_joints.report.runs import Content, Run, components, grouped, largest_moment, zeros
from dolfinx_joints.report.static_section import gaps_note, jump_warnings
from dolfinx_joints.results.quantities import ENERGY_TERMS
from dolfinx_joints.results.resolved import beyond

JOINT_NOTE = (
    "Opening is the positive part of the normal gap. Slip is the relative tangential displacement "
    "of the two sides {zero}. Safety against sliding is the resistance by friction "
    "and bond divided by the shear force, each summed over the joint; a dash means undefined."
)
_AXES = {2: "x (downstream) and y (up).", 3: "x (downstream), y (left bank) and z (up)."}


def opening(content: Content, note: str, *, of_body: bool) -> list[Html]:
    """Return alerts, a picture of the dam, the main results, and warnings, in this order."""
    runs = content.compared
    pieces = alerts(content.runs)
    pieces.append(paragraph(f"{_runs(content)} {note}".rstrip(), "note"))
    if of_body:
        pieces += _dam(content)
    band = content.band
    rows = [[title, *(of(run) for run in runs)] for title, of in _rows(band, runs)]
    rows = [row for row in rows if any(cell is not None for cell in row[1:])]
    if rows:
        pieces.append(table("Main results", ["", *(run.label for run in runs)], rows))
    pieces += [_joints(run) for run in runs if run.results.joints and run.has("states")]
    if any(run.results.joints and run.has("states") for run in runs):
        axes = _AXES[len(components(runs))]
        note = JOINT_NOTE.format(zero=common_frame({r.label: zero_name(r.results) for r in runs}))
        pieces.append(paragraph(f"{note} Coordinates are {axes}", "note"))
    unfinished = [run for run in content.runs if not run.results.complete]
    failures = [(run.label, ending(run).removeprefix(f"{run.label} ")) for run in unfinished]
    texts = [(run.label, (*doubts(run), *_unresolved(run, band))) for run in content.runs]
    warnings = [(label, text) for label, of_run in texts for text in of_run]
    pieces.append(heading("Warnings"))
    pieces.append(bullets(grouped([*failures, *warnings]) or ["None."]))
    pieces.append(paragraph(_BOUNDS, "note"))
    return [Html(f'<div class="opening">{"".join(pieces)}</div>')]


_BOUNDS = (
    f"Warnings appear if the energy error exceeds {100 * LARGE_ENERGY_ERROR:g} % of the largest "
    f"energy, if the error of a single step exceeds {100 * LARGE_LOCAL_ERROR:g} % of the largest "
    "displacement, or if a run is incomplete. They also appear if the numerical energy loss in a "
    f"joint exceeds {100 * LARGE_ENERGY_ERROR:g} % of its friction work and 0.1 % of the largest "
    "energy."
)


_ERRORS = (
    ("energy_error", "energy error", LARGE_ENERGY_ERROR, "energy"),
    ("local_error", "error of a single step", LARGE_LOCAL_ERROR, "displacement"),
)


def alerts(runs: Sequence[Run]) -> list[Html]:
    """Return an alert for each incomplete run."""
    unfinished = [paragraph(ending(run)) for run in runs if not run.results.complete]
    return (
        [Html(f'<div class="alert" role="alert">{"".join(unfinished)}</div>')] if unfinished else []
    )


def doubts(run: Run) -> list[str]:
    """Return the warnings of a run, without its label and ending."""
    warnings = []
    recorded: list[str] = run.results.summary.get("warnings", [])
    for key, name, limit, scale in _ERRORS:
        value = float(run.results.summary.get(key) or 0.0)
        if value > limit and not any(name in text for text in recorded):
            warnings.append(f"the {name} is {100 * value:.3g} % of the largest {scale}.")
    return [*warnings, *jump_warnings(run), *_loss_warnings(run), *recorded]


def _unresolved(run: Run, band: float) -> list[str]:
    """Return a warning if accelerations are shown at frequencies that the run does not resolve."""
    shown = run.moves and run.has("histories", "acceleration")
    text = beyond(band, measures.resolved_frequencies(run.results)) if shown else ""
    return [text] if text else []


def _loss_warnings(run: Run) -> list[str]:
    """Return a warning if the numerical loss of joints is not small compared with their friction.

    Comparing with the largest energy is not enough, as most of it may be in the rock.
    """
    if not run.has("energy", *ENERGY_TERMS):
        return []
    joints = []
    lines = energy_lines(run.results)
    largest = max(float(np.abs(line).max(initial=0.0)) for line in lines.values())
    for joint, (friction, lost) in joint_losses(run.results).items():
        if abs(lost) > LARGE_ENERGY_ERROR * max(friction, 0.02 * largest):
            joints.append(
                f"{plain(1e-3 * abs(lost))} kJ {'lost' if lost > 0.0 else 'gained'} in {joint!r}, "
                f"where friction dissipated {plain(1e-3 * friction)} kJ"
            )
    if not joints:
        return []
    return [f"the time scheme changes the energy: {'; '.join(joints)}. Use a smaller time step."]


def ending(run: Run) -> str:
    """Return a sentence on how an incomplete run ended."""
    steps = run.results.metadata.get("steps")
    done = f"at t = {run.end:.4g} s"
    if run.static_alone:
        done = f"after the static stage {run.results.stage_names[-1]}"
    elif list(run.results.streams) == ["statics"]:
        done = "in the first static stage"
    if steps is not None and run.has("histories"):
        done += f", after {run.results.rows('histories') - 1} of {steps} steps"
    words = {
        "running": f"is still running or was killed; its last record is {done}",
        "stopped": f"was stopped {done}",
        "failed": f"failed {done}",
    }
    reason = run.results.summary.get("error")
    return f"{run.label} {words[run.results.status]}{f' ({reason})' if reason else ''}."


def _runs(content: Content) -> str:
    others = len(content.runs) - len(content.compared)
    further = f" and {others} further run{'s' if others > 1 else ''}" if others else ""
    compared = ", ".join(f"{run.label} ({_span(run)})" for run in content.compared)
    shown = f" Pictures show {content.main.label}." if len(content.runs) > 1 else ""
    return f"Runs: {compared}{further}.{shown}"


def _span(run: Run) -> str:
    if run.static_alone:
        count = len(run.results.stage_names)
        return f"{count} static stage{'s' if count > 1 else ''}"
    return f"{plain(run.end)} s"


def _dam(content: Content) -> list[Html]:
    """Return the dam at its largest displacement, seen from upstream and downstream."""
    run = content.main
    if not run.drawable or not run.has("states", "displacement"):
        return []
    time, moment = largest_moment(run)
    both = (views.UPSTREAM, views.DOWNSTREAM)
    drawn = views.deformed(run.results, time=time, groups=run.groups, azimuths_deg=both)
    caption = f"{run.label} at t = {time:.3f} s, {moment}.{gaps_note(run)}"
    path = content.save("dam", drawn, dpi=140)
    return [figure([content.drawings.picture(path, caption)], caption, wide=True)]


def _crest_displacement(run: Run) -> Cell:
    """Return the largest displacement of the highest monitor points."""
    points = peaks.crest_points(run.results)
    if not points or not run.moves:
        return None
    peak = peaks.displacement_peak(run.results, points, run.relative_to)
    frame = "" if run.results.relative else f", {frame_name(run.results, run.relative_to)}"
    bar = run.bar(peaks.CREST_DISPLACEMENT, peak.value, 1e3)
    return valued(1e3 * peak.value, f"{bar}{peak.name}, {plain(peak.time)} s{frame}")


def _crest_acceleration(run: Run, *, band: float) -> Cell:
    """Return the largest absolute acceleration of the highest points, up to a band [Hz]."""
    points = peaks.crest_points(run.results)
    needed = ["acceleration"] + ["ground_acceleration"] * run.results.relative
    if not points or not run.moves or not run.has("histories", *needed):
        return None
    peak = peaks.acceleration_peak(run.results, points, band=band)
    share = plain(abs(peak.value) / STANDARD_GRAVITY)
    bar = run.bar(peaks.CREST_ACCELERATION.format(band), peak.value)
    return valued(peak.value, f"{bar}{peak.name}, {plain(peak.time)} s, {share} g")


def _stress(name: EnvelopeName) -> Callable[[Run], Cell]:

    def cell(run: Run) -> Cell:
        peak = peaks.stress_peak(run.results, name)
        if np.isnan(peak.value):
            return None
        bar = run.bar(peaks.STRESSES[name], peak.value, 1e-6)
        return valued(1e-6 * peak.value, f"{bar}at {place(peak, len(run.components))}")

    return cell


def _energy_error(run: Run) -> Cell:
    value = run.results.summary.get("energy_error")
    return None if value is None else valued(100.0 * float(value), "of the largest energy")


_SINCE = "since the first record"


def _rows(band: float, runs: Sequence[Run]) -> Sequence[tuple[str, Callable[[Run], Cell]]]:
    """Return row titles and the functions of their cells; accelerations are up to a band [Hz]."""
    named = measures.band_name(band, *(run.results for run in runs))
    acceleration = f"crest acceleration, absolute, {named} [m/s²]"
    return (
        (f"crest displacement {zeros(run for run in runs if run.moves)} [mm]", _crest_displacement),
        (acceleration, partial(_crest_acceleration, band=band)),
        (f"largest tension {_SINCE} [MPa]", _stress("principal_max")),
        (f"largest compression {_SINCE} [MPa]", _stress("principal_min")),
        ("energy error [%]", _energy_error),
        ("checks that are not met", unmet),
    )


def _joints(run: Run) -> Html:
    rows: list[list[Cell]] = []
    for joint in run.results.joints:
        largest = peaks.joint_peaks(run.results, joint)
        moved = [_millimetres(run, joint, name, largest[name]) for name in ("opening", "slip")]
        safety = largest["safety"]
        bar = run.bar(f"{joint}: {peaks.JOINT_VALUES['safety']}", safety.value)
        least = None
        if not np.isnan(safety.value):
            least = valued(safety.value, f"{bar}{plain(safety.time)} s")
        rows.append([joint, *moved, least])
    head = ["joint", "largest opening [mm]", "largest slip [mm]", "smallest safety [-]"]
    return table(f"Joints ({run.label})", head, rows)


def _millimetres(run: Run, joint: str, name: str, peak: Peak) -> Cell:
    """Return an opening or slip [mm] with its time and place, 0 if the joint never moved."""
    if not peak.value:
        return 0
    bar = run.bar(f"{joint}: {peaks.JOINT_VALUES[name]}", peak.value, 1e3)
    where = place(peak, len(run.components))
    return valued(1e3 * peak.value, f"{bar}{plain(peak.time)} s at {where}")


def place(peak: Peak, axes: int) -> str:
    """Return the coordinates along the first axes as text."""
    return f"({', '.join(plain(round(float(x), 1) + 0.0) for x in peak.place[:axes])}) m"
