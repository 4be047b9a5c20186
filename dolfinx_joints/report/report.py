# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A report on runs: one HTML file that needs no other and no net, and pictures beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.hdf5 import DamageTold
from dolfinx_joints.common.parameters import check_flag, check_kind_of, check_path
from dolfinx_joints.report import body_sections as report_body
from dolfinx_joints.report import paper_statements
from dolfinx_joints.report import response_sections as report_response
from dolfinx_joints.report import run_sections as report_sections
from dolfinx_joints.report.page import Drawings, Html, Section, bullets, page, paragraph, plain
from dolfinx_joints.report.response_sections import largest_displacement, widest_opening
from dolfinx_joints.report.run_sections import Content, ending
from dolfinx_joints.report.runs import Run, opened, pairs

SECTIONS: tuple[Callable[[Content], Section], ...] = (
    report_sections.parameters,
    report_sections.cost,
    report_sections.energies,
    report_sections.convergence,
    report_response.displacements,
    report_response.response_spectra,
    report_response.joints,
)


def write(
    results: Sequence[str | Path], out: str | Path = "report.html", *, with_3d: bool = True
) -> Path:
    """Write a report on the runs of one or several results files.

    The file ``out`` holds everything; the pictures of its plots are written into a folder beside
    it, named like it. Where the files hold the case of the paper, without and with joints, its
    statements are judged; further files of that case on another mesh or with another step
    estimate the error.

    Args:
        results: the files, in the order in which the report is to name them.
        out: the HTML file; replaced if it exists.
        with_3d: include the view in space and the pictures of the body, most of the file's size.

    Returns:
        The path of the HTML file.

    Raises:
        ResultsError: a file cannot be read, a package is missing, or ``out`` cannot be written.
        ValueError: an argument is of another kind.
    """
    several = isinstance(results, Sequence) and not isinstance(results, str | bytes)
    check_kind_of("results", results, several, "a list of paths of results files")
    for path in results:
        check_path("A results file", path)
    check_path("out", out)
    check_flag("with_3d", with_3d)
    target = Path(out)
    if target.suffix.lower() not in (".html", ".htm"):
        raise ResultsError(f"A report is written to a file that ends in .html, got {target}.")
    _check_packages()
    damage = DamageTold(target, ResultsError, "cannot be made of what the files hold")
    with opened(results) as runs, damage, _written(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        found = pairs(runs, paper_statements.CASE)
        first = list(found[0]) if found else []
        ordered = [*first, *(run for run in runs if run not in first)]
        content = Content(ordered, Drawings(picture_folder(target)), found[0] if found else None)
        sections = [make(content) for make in SECTIONS]
        if with_3d:
            sections.append(report_body.space(content))
            sections.append(report_body.envelopes(content))
        comparison = [paper_statements.judged(pair) for pair in found]
        if comparison:
            sections[:0] = [paper_statements.section(found, comparison)]
            sections.append(paper_statements.departures())
        sections += [report_sections.warnings(content), report_sections.versions(content)]
        top = [*_alerts(runs), *_summary(content, comparison)]
        html = page(_title(runs), top, sections, content.drawings)
        partial = target.with_name(f"{target.name}.partial")
        partial.write_text(html, encoding="utf-8")
        partial.replace(target)
    return target


def picture_folder(out: Path) -> Path:
    """Where the pictures of a report are."""
    return out.with_name(f"{out.stem}_files")


def _title(runs: Sequence[Run]) -> str:
    cases = dict.fromkeys(
        str(r.results.metadata["case"]) for r in runs if "case" in r.results.metadata
    )
    return f"Report: {', '.join(cases or [run.label for run in runs])}"


def _alerts(runs: Sequence[Run]) -> list[Html]:
    """What must be known before anything is read: runs that did not reach their end."""
    unfinished = [paragraph(ending(run)) for run in runs if not run.results.complete]
    return (
        [Html(f'<div class="alert" role="alert">{"".join(unfinished)}</div>')] if unfinished else []
    )


def _summary(content: Content, comparison: Sequence[Any]) -> list[Html]:
    """Five lines, on the runs that are compared where there are such."""
    runs = list(content.pair) if content.pair else content.runs
    others = len(content.runs) - len(runs)
    further = f"; {others} further run{'s' if others > 1 else ''}" if others else ""
    lines = [
        f"Duration: {_each(runs, lambda run: f'{plain(run.end)} s')}{further}.",
        f"Largest displacement from the static state: {_each(runs, largest_displacement)}.",
        f"Largest energy error, as a share of the largest energy: {_each(runs, _energy_error)}.",
        f"Widest joint: {_each(runs, widest_opening)}.",
        f"Cost: {_each(runs, _cost)}.",
    ]
    if comparison:
        lines[-1] = f"{lines[-1]} {paper_statements.count(comparison[0])}"
    return [Html(f'<div class="summary">{bullets(lines, ordered=True)}</div>')]


def _each(runs: Sequence[Run], say: Callable[[Run], str | None]) -> str:
    return "; ".join(f"{run.label} {say(run) or 'not recorded'}" for run in runs)


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
def _written(target: Path) -> Any:
    """Say in one sentence that a file cannot be written."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"The report {target} cannot be written: {error}.") from error
