# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writing of a report: one HTML or PDF file, and a folder of its pictures."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, ResultsError
from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.report import (
    assumption_section,
    body_sections,
    check_section,
    joint_sections,
    opening,
    parameter_sections,
    response_sections,
    run_sections,
    static_section,
)
from dolfinx_joints.report.page import Drawings, Section, page
from dolfinx_joints.report.runs import Addition, Content, Run, linear_and_jointed, opened


@checked
def write(
    results: Annotated[Sequence[str | Path], at.MinLen(1)],
    out: str | Path = "report.html",
    *,
    with_3d: bool = True,
    add: Callable[[Sequence[Run]], Addition] | None = None,
    bars: Mapping[str, tuple[float, float]] | None = None,
    dam: str | None = None,
    client: str | None = None,
    author: str | None = None,
    date: Annotated[str | None, at.doc("a text such as 2026-11-29")] = None,
) -> Path:
    """Write a report on the runs of one or several results files.

    The file ``out`` needs no other file. Pictures of its plots are also written to the folder
    `picture_folder` next to it. A PDF file has these pictures in place of the interactive plots.

    Args:
        results: The files, in the order of the report.
        out: The HTML file, or the PDF file if the name ends in .pdf; replaced if it exists.
        with_3d: Include the 3-D view and pictures of the body, the largest part of the file.
        add: Function that returns further sections and the runs to compare.
        bars: Error bars of the main results, `Accuracy.bars`. An error is shown next to each value
            that equals a value of the study; a warning names the others.
        dam: Name of the dam, the title; by default the names of the runs.
        client: Client on the title page.
        author: Author on the title page.
        date: Date on the title page; no date by default, so that the same files give the same HTML
            file.

    Returns:
        The path of the file.

    Raises:
        ResultsError: A file cannot be read, a package is missing, or ``out`` cannot be written.
    """
    good = bars is None or (
        isinstance(bars, Mapping)
        and all(np.shape(b) == (2,) and np.isfinite(b[0]) and b[1] >= 0.0 for b in bars.values())
    )
    wanted = "pairs of a number and an error of 0 or more by name, as in Accuracy.bars"
    check_kind_of("bars", bars, good, wanted)
    target = Path(out)
    printed = target.suffix.lower() == ".pdf"
    if not printed and target.suffix.lower() not in (".html", ".htm"):
        raise ResultsError(f"A report needs a file name that ends in .html or .pdf, got {target}.")
    _check_packages("matplotlib", "weasyprint" if printed else "plotly")
    muted = warnings.catch_warnings(action="ignore", category=PlausibilityWarning)
    with muted, opened(results, bars) as runs, _written(target):  # the report lists the warnings
        target.parent.mkdir(parents=True, exist_ok=True)
        added = add(runs) if add else Addition()
        reference, main = linear_and_jointed(runs)
        if added.main:
            reference, main = added.reference, added.main
        first = [reference, main] if reference else []
        ordered = [*first, *(run for run in runs if run not in first)]
        drawings = Drawings(picture_folder(target), printed)
        content = Content(ordered, drawings, main, reference)
        shown = _ordered(content, added, of_body=with_3d)
        top = opening.opening(content, added.note, of_body=with_3d)
        facts = {"Client": client, "Author": author, "Date": date}
        html = page(_title(runs, dam), facts, top, shown, drawings)
        with replacing(target) as part:
            if printed:
                _print(html, part)
            else:
                part.write_text(html, encoding="utf-8")
    return target


def picture_folder(out: Path) -> Path:
    """Return the folder of the pictures of a report."""
    return out.with_name(f"{out.stem}_files")


def _title(runs: Sequence[Run], dam: str | None) -> str:
    if dam:
        return f"Report: {dam}"
    cases = dict.fromkeys(
        str(r.results.metadata["case"]) for r in runs if "case" in r.results.metadata
    )
    return f"Report: {', '.join(cases or [run.label for run in runs])}"


def _print(html: str, path: Path) -> None:
    """Write a page to a PDF file."""
    from weasyprint import HTML

    HTML(string=html).write_pdf(path)


def _check_packages(*packages: str) -> None:
    for package in packages:
        try:
            __import__(package)
        except ImportError as error:
            raise ResultsError(f"Reports need {package}, which is not installed.") from error
        except OSError as error:  # WeasyPrint without Pango
            raise ResultsError(
                f"Reports need {package}, which cannot be loaded: {error}"
            ) from error


@contextmanager
def _written(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ResultsError(f"The report {target} cannot be written: {error}.") from error


SECTIONS: tuple[Callable[[Content], Section | None], ...] = (
    static_section.statics,
    response_sections.ground,
    response_sections.displacements,
    response_sections.response_spectra,
    body_sections.space,
    joint_sections.joints,
    body_sections.stresses,
    check_section.checks,
    check_section.sliding,
    parameter_sections.parameters,
    body_sections.mesh,
    run_sections.energies,
    run_sections.cost,
    run_sections.convergence,
    run_sections.versions,
)
SECTIONS_OF_BODY = (body_sections.space, body_sections.stresses, body_sections.mesh)


def _ordered(content: Content, added: Addition, *, of_body: bool) -> list[Section]:
    """Return all sections of a report, with the caller's sections first and last."""
    chosen = [make for make in SECTIONS if of_body or make not in SECTIONS_OF_BODY]
    progress, made = Progress("report", len(chosen), "sections"), []
    for make in chosen:
        if (section := make(content)) is not None:
            made.append(section)
        progress.advance()
    progress.finish()
    first = assumption_section.assumptions(content, made)
    return [*added.first, first, *(section for section in made if section.pieces), *added.last]
