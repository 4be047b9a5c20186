# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plots of the table of `follow_ups`: influence of each parameter on response and joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dolfinx_joints.postprocessing import plots
from dolfinx_joints.study import Table

Rows = NDArray[np.int64]

# Axis label, factor from SI to its unit, whether the axis is logarithmic.
SWEPT = {
    "active_height": ("height up to which the joints are active / H [-]", 1.0, False),
    "gap": ("initial gap [mm]", 1e3, False),
    "friction_angle_deg": ("friction angle [degrees]", 1.0, False),
    "normal_stiffness": ("normal stiffness of the joints [Pa/m]", 1.0, True),
    "shear_ratio": ("$k_s/k_n$ [-]", 1.0, False),
    "joints": ("number of joints", 1.0, False),
    "scale": ("factor on the motion", 1.0, False),
}
PEAK = "mid-crest/{}/peak_strong"
COLOURS = dict(zip("xyz", ("#08519c", "#41ab5d", "#fd8d3c"), strict=True))
BLACK, RED = "black", "#b2182b"


def row_of(table: Table, name: str) -> int | None:
    """Return the row number of a complete case, None if the case is not in the table."""
    matches = np.flatnonzero((table["case"] == name) & (table["status"] == "complete"))
    return int(matches[0]) if len(matches) else None


def sweep(table: Table, name: str, prefix: str = "") -> Rows:
    """Return the rows of a parameter's cases and of their base case, in ascending order."""
    start = f"{prefix}{name}="
    bases = {prefix.rstrip("_") or "paper"}
    if name == "active_height":
        bases.add(f"{prefix}crest_joints")  # active up to 1.0
    rows = [
        row
        for row, case in enumerate(table["case"])
        if (case.startswith(start) or case in bases) and table["status"][row] == "complete"
    ]
    return np.array(sorted(rows, key=lambda row: table[name][row]), dtype=np.int64)


def ratios(table: Table, rows: Rows, column: str) -> NDArray[np.float64]:
    """Return a column divided by the linear run's of the same motion and body, NaN without it."""
    return np.array([_ratio(table, int(row), column) for row in rows])


def _ratio(table: Table, row: int, column: str) -> float:
    name = table["case"][row]
    if "record=" in name:
        reference = f"record={name.split('record=')[1]}_linear"
    else:
        reference = "no_crest_arch_linear" if name == "no_crest_arch" else "paper_linear"
    linear = row_of(table, reference)
    if linear is None:
        return float("nan")
    # The linear response is proportional to the motion.
    factor = table["scale"][row] / table["scale"][linear]
    return float(table[column][row] / (factor * table[column][linear]))


def draw_sweep(table: Table, name: str, path: Path) -> Path:
    """Plot peaks at the mid-crest over the linear ones, and joint extremes, by one parameter.

    Solid lines: joints below the crest arch, as in the paper. Dashed: joints up to the crest.
    Dotted: joints closed after self weight. Openings include the initial gap.
    """
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    peak_axes, joint_axes = figure.subplots(1, 2)
    label, factor, logarithmic = SWEPT[name]
    for prefix, line, note in (
        ("", "-", ""),
        ("crest_joints_", "--", ", joints to the crest"),
        ("grouted_", ":", ", closed after weight"),
    ):
        rows = sweep(table, name, prefix)
        if len(rows) < 2:
            continue
        x = factor * table[name][rows]
        for component, colour in COLOURS.items():
            y = ratios(table, rows, PEAK.format(component))
            peak_axes.plot(x, y, line, marker="o", ms=4, color=colour, label=f"{component}{note}")
        for column, colour, measure in (
            ("joints/opening_max", BLACK, "opening"),
            ("joints/slip_max", RED, "slip"),
        ):
            y = 1e3 * table[column][rows]
            joint_axes.plot(x, y, line, marker="o", ms=4, color=colour, label=f"{measure}{note}")
    peak_axes.axhline(1.0, color="#8c8c8c", linewidth=0.8)
    peak_axes.set_ylabel("peak at the mid-crest / linear [-]")
    joint_axes.set_ylabel("largest of all joints [mm]")
    peak_axes.set_yscale("log")
    peak_axes.yaxis.set_major_formatter("{x:g}")
    joint_axes.set_ylim(bottom=0.0)
    for ax in (peak_axes, joint_axes):
        if logarithmic:
            ax.set_xscale("log")
        ax.set_xlabel(label)
        ax.grid(linewidth=0.3)
        ax.legend(fontsize="x-small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return plots.save(figure, path)


def draw_cases(table: Table, names: dict[str, str], path: Path) -> Path:
    """Draw the quantities of `draw_sweep` as bars, one group per case.

    Args:
        table: The table.
        names: Label of each case in the picture.
        path: The picture file.
    """
    complete = [name for name in names if row_of(table, name) is not None]
    rows = np.array([row_of(table, name) for name in complete], dtype=np.int64)
    figure = Figure(figsize=(7.4, 0.9 + 0.55 * len(complete)), layout="constrained")
    peak_axes, joint_axes = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(complete), dtype=float)
    for k, (component, colour) in enumerate(COLOURS.items()):
        values = ratios(table, rows, PEAK.format(component))
        peak_axes.barh(places + 0.26 * (k - 1), values, height=0.24, color=colour, label=component)
    peak_axes.axvline(1.0, color="#8c8c8c", linewidth=0.8)
    peak_axes.set_xlabel("peak at the mid-crest / linear [-]")
    peak_axes.set_xscale("log")
    peak_axes.xaxis.set_major_formatter("{x:g}")
    for k, (column, colour, measure) in enumerate(
        (("joints/opening_max", BLACK, "opening"), ("joints/slip_max", RED, "slip"))
    ):
        values = 1e3 * table[column][rows]
        joint_axes.barh(places + 0.36 * (k - 0.5), values, height=0.34, color=colour, label=measure)
    joint_axes.set_xlabel("largest of all joints [mm]")
    peak_axes.set_yticks(places, [names[name] for name in complete])
    peak_axes.invert_yaxis()
    for ax in (peak_axes, joint_axes):
        _finish_bars(ax)
    return plots.save(figure, path)


def _finish_bars(ax: Axes) -> None:
    ax.grid(axis="x", linewidth=0.3)
    ax.set_axisbelow(True)
    ax.legend(fontsize="x-small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


def question_names() -> dict[str, str]:
    """Return the labels of the cases that answer the paper's questions."""
    return {
        "paper": "paper: joints to 0.75 H",
        "grouted": "closed after self weight",
        "crest_joints": "joints to the crest",
        "grouted_crest_joints": "the same, closed after self weight",
        "no_crest_arch": "no crest arch",
        "gap=0.005": "gap 5 mm, to 0.75 H",
        "crest_joints_gap=0.005": "gap 5 mm, to the crest",
    }


def record_cases(table: Table) -> dict[str, str]:
    """Return the labels of the cases of all motions."""
    labels = {"paper": "paper", "crest_joints": "paper, to the crest"}
    for name in table["case"]:
        if "record=" in name and not name.endswith("_linear"):
            place = ", to the crest" if name.startswith("crest_joints") else ""
            labels[name] = name.split("record=")[1].replace("_", " ") + place
    return labels


def draw_all(table: Table, out: Path) -> list[Path]:
    """Draw every plot for which the table has at least two cases."""
    written = [
        draw_sweep(table, name, out / f"sweep_{name}.png")
        for name in SWEPT
        if len(sweep(table, name)) > 1
    ]
    for stem, names in (("questions", question_names()), ("records", record_cases(table))):
        if sum(row_of(table, name) is not None for name in names) > 1:
            written.append(draw_cases(table, names, out / f"{stem}.png"))
    return written
