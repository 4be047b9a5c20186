# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a report shows, in order: unfinished runs, five lines, and the sections."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dolfinx_joints.report import body_sections, response_sections, run_sections
from dolfinx_joints.report.page import Html, Section, bullets, paragraph, plain
from dolfinx_joints.report.response_sections import largest_displacement, widest_opening
from dolfinx_joints.report.runs import Addition, Content, Run

SECTIONS: tuple[Callable[[Content], Section], ...] = (
    run_sections.parameters,
    run_sections.cost,
    run_sections.energies,
    run_sections.convergence,
    response_sections.displacements,
    response_sections.response_spectra,
    response_sections.joints,
)
SECTIONS_OF_BODY = (body_sections.space, body_sections.envelopes)
CLOSING_SECTIONS = (run_sections.warnings, run_sections.versions)


def ordered(content: Content, added: Addition, *, of_body: bool) -> list[Section]:
    """All sections of a report, with those that the caller adds."""
    made = [make(content) for make in (*SECTIONS, *(SECTIONS_OF_BODY if of_body else ()))]
    closing = [make(content) for make in CLOSING_SECTIONS]
    return [*added.first, *made, *added.last, *closing]


def alerts(runs: Sequence[Run]) -> list[Html]:
    """Runs that did not reach their end, above everything else."""
    unfinished = [paragraph(run_sections.ending(run)) for run in runs if not run.results.complete]
    return (
        [Html(f'<div class="alert" role="alert">{"".join(unfinished)}</div>')] if unfinished else []
    )


def summary(content: Content, note: str) -> list[Html]:
    """Five lines, on the runs that are compared where there are such."""
    runs = content.compared
    others = len(content.runs) - len(runs)
    further = f"; {others} further run{'s' if others > 1 else ''}" if others else ""
    lines = [
        f"Duration: {_each(runs, lambda run: f'{plain(run.end)} s')}{further}.",
        f"Largest displacement from the static state: {_each(runs, largest_displacement)}.",
        f"Largest energy error, as a share of the largest energy: {_each(runs, _energy_error)}.",
        f"Widest joint: {_each(runs, widest_opening)}.",
        f"Cost: {_each(runs, _cost)}. {note}".rstrip(),
    ]
    return [Html(f'<div class="summary">{bullets(lines, ordered=True)}</div>')]


def _each(runs: Sequence[Run], of: Callable[[Run], str | None]) -> str:
    return "; ".join(f"{run.label} {of(run) or 'not recorded'}" for run in runs)


def _energy_error(run: Run) -> str | None:
    value = run.results.summary.get("energy_error")
    return None if value is None else plain(float(value))


def _cost(run: Run) -> str | None:
    seconds = run.seconds
    if seconds is None:
        return None
    peak = run.results.summary.get("peak_mb")
    return f"{plain(seconds)} s" + (f", {plain(peak)} MB" if peak is not None else "")
