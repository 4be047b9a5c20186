# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report of a calibration: tables of parameters and fits, and readings against computed values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.report.page import Drawings, Html, Section, figure, page, paragraph, table
from dolfinx_joints.report.writing import picture_folder

DAY = 86400.0
COLUMNS = 3  # panels side by side


def write(calibration: Any, out: Path) -> Path:
    """Write the report of a `Calibration`, an HTML file, with its picture in a folder."""
    drawings = Drawings(picture_folder(out))
    sections = [
        Section("parameters", "Parameters", _parameters(calibration)),
        Section("readings", "Readings", _readings(calibration, drawings)),
        Section("determined", "What the readings determine", _determined(calibration)),
    ]
    distance = f"{calibration.distance:.2f} posterior deviations from the minimum"
    facts = {"Runs": str(calibration.misfit.runs), "Search": distance}
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page("Calibration", facts, (), sections, drawings), encoding="utf-8")
    return out


def _parameters(calibration: Any) -> list[Html]:
    rows: list[list[Any]] = []
    for row in calibration.rows():
        before, after = row["prior deviation"], row["deviation"]
        numbers = [f"{row['prior']:.5g} ± {before:.2g}", f"{row['calibrated']:.5g} ± {after:.2g}"]
        unit = f" [{row['unit']}]" if row["unit"] else ""
        cells = [f"{row['parameter']}{unit}", *numbers, f"{after / before:.2f}"]
        cells = [cell.replace(" ", "\N{NO-BREAK SPACE}") for cell in cells]
        rows.append([*cells, "yes" if row["at bound"] else ""])
    head = ("parameter", "before", "calibrated", "ratio of deviations", "at a bound")
    return [
        table("Parameters before and after the calibration", head, rows),
        paragraph(
            "Numbers after ± are standard deviations. A ratio near 1 means that the readings say "
            "little about the parameter."
        ),
    ]


def _readings(calibration: Any, drawings: Drawings) -> list[Html]:
    """Return the table of fits, and a picture with one panel per instrument."""
    from dolfinx_joints.postprocessing.axes import decorate, legend, new_figure
    from dolfinx_joints.postprocessing.palette import BLUE

    misfit = calibration.misfit
    fits = zip(calibration.fits.items(), misfit.sizes, strict=True)
    rows = [[name, size, f"{fit:.2f}"] for (name, fit), size in fits]
    pieces = [table("Errors in units of the deviation", ("instrument", "readings", "error"), rows)]
    pieces.append(
        paragraph(
            "The error is a root mean square and should be about 1. If it is much larger, the "
            "model cannot follow the readings, and the deviations of the parameters are too small."
        )
    )
    if not misfit.readings:
        return pieces
    height = -(-len(misfit.readings) // COLUMNS)
    drawn = new_figure(figsize=(10.0, 2.3 * height), layout="constrained")
    panels = np.ravel(drawn.subplots(height, min(COLUMNS, len(misfit.readings)), squeeze=False))
    computed = np.split(calibration.computed, np.cumsum(misfit.sizes)[:-1])
    for ax, reading, values, group in zip(
        panels, misfit.readings, computed, misfit.groups, strict=False
    ):
        times, measured = reading.series
        values = values + (measured - reading.measured)  # the constant of relative readings
        errors = 1e3 * np.ravel(reading.deviation)
        ax.errorbar(times / DAY, 1e3 * measured, errors, fmt=".", color="0.6", label="measured")
        ax.plot(times / DAY, 1e3 * values, color=BLUE, label="computed")
        decorate(ax, "time [d]", "[mm]")
        ax.set_title(group, fontsize="medium", loc="left")
    for ax in panels[len(misfit.readings) :]:
        ax.remove()
    legend(panels[0])
    caption = "Readings with their deviations, and values computed with the calibrated parameters"
    return [*pieces, figure([drawings.picture(drawings.save("readings", drawn), caption)], caption)]


def _determined(calibration: Any) -> list[Html]:
    values = calibration.singular_values
    rows = [[i, f"{s:.3g}", f"{1.0 / np.hypot(1.0, s):.3f}"] for i, s in enumerate(values, 1)]
    pieces = [
        table(
            "Combinations of parameters, the best known first",
            ("combination", "singular value", "deviation after / before"),
            rows,
        )
    ]
    for combination in calibration.undetermined:
        terms = " ".join(f"{factor:+.2f} {name}" for name, factor in combination.items())
        pieces.append(paragraph(f"Not determined by the readings: {terms}"))
    pieces.append(paragraph("Parameters are divided by their deviations before the calibration."))
    return pieces
