# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A report on runs: one HTML file that needs no other and no net, and pictures beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import annotated_types as at

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.hdf5 import damage_reported
from dolfinx_joints.report import body_sections, response_sections, run_sections
from dolfinx_joints.report.page import Drawings, Html, Section, bullets, page, paragraph, plain
from dolfinx_joints.report.response_sections import largest_displacement, widest_opening
from dolfinx_joints.report.runs import Addition, Content, Run, linear_and_jointed, opened

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


@checked
def write(
    results: Annotated[Sequence[str | Path], at.MinLen(1)],
    out: str | Path = "report.html",
    *,
    with_3d: bool = True,
    add: Callable[[Sequence[Run]], Addition] | None = None,
) -> Path:
    """Write a report on the runs of one or several results files.

    The file ``out`` holds everything; the pictures of its plots are written into a folder beside
    it, named like it.

    Args:
        results: The files, in the order in which the report is to name them.
        out: The HTML file; replaced if it exists.
        with_3d: Include the view in space and the pictures of the body, most of the file's size.
        add: Gives further sections on the runs, and which of them are compared.

    Returns:
        The path of the HTML file.

    Raises:
        ResultsError: A file cannot be read, a package is missing, or ``out`` cannot be written.
    """
    target = Path(out)
    if target.suffix.lower() not in (".html", ".htm"):
        raise ResultsError(f"A report is written to a file that ends in .html, got {target}.")
    _check_packages()
    damage = damage_reported(target, ResultsError, "cannot be made of what the files hold")
    with opened(results) as runs, damage, _written(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        added = add(runs) if add else Addition()
        reference, main = linear_and_jointed(runs)
        if added.main:
            reference, main = added.reference, added.main
        first = [reference, main] if reference else []
        ordered = [*first, *(run for run in runs if run not in first)]
        drawings = Drawings(picture_folder(target))
        content = Content(ordered, drawings, main, reference)
        made = [make(content) for make in (*SECTIONS, *(SECTIONS_OF_BODY if with_3d else ()))]
        closing = [run_sections.warnings(content), run_sections.versions(content)]
        sections = [*added.first, *made, *added.last, *closing]
        top = [*_alerts(runs), *_summary(content, added.note)]
        html = page(_title(runs), top, sections, drawings)
        partial = target.with_name(f"{target.name}.partial")
        partial.write_text(html, encoding="utf-8")
        partial.replace(target)
    return target


def picture_folder(out: Path) -> Path:
    """Folder of the pictures of a report."""
    return out.with_name(f"{out.stem}_files")


def _title(runs: Sequence[Run]) -> str:
    cases = dict.fromkeys(
        str(r.results.metadata["case"]) for r in runs if "case" in r.results.metadata
    )
    return f"Report: {', '.join(cases or [run.label for run in runs])}"


def _alerts(runs: Sequence[Run]) -> list[Html]:
    """Runs that did not reach their end, above everything else."""
    unfinished = [paragraph(run_sections.ending(run)) for run in runs if not run.results.complete]
    return (
        [Html(f'<div class="alert" role="alert">{"".join(unfinished)}</div>')] if unfinished else []
    )


def _summary(content: Content, note: str) -> list[Html]:
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


def _check_packages() -> None:
    for package in ("matplotlib", "plotly"):
        try:
            __import__(package)
        except ImportError as error:
            raise ResultsError(f"Reports need {package}, which is not installed.") from error


@contextmanager
def _written(target: Path) -> Iterator[None]:
    """Report that a file cannot be written."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"The report {target} cannot be written: {error}.") from error
