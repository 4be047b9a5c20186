# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report section on the joints: measures, histories, maps."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.joints.extremes import drawn_series, joint_extremes, strength_of
from dolfinx_joints.postprocessing.joints.figures import JointMaps
from dolfinx_joints.report.page import Html, Section, details, figure, paragraph, table
from dolfinx_joints.report.panels import Curve, panels
from dolfinx_joints.report.runs import Content, Run, largest_moment, nothing
from dolfinx_joints.results.joint_points import joint_area, since, slip_zero, zero_of
from dolfinx_joints.results.quantities import TABLE

# File name, quantity and caption of each map after a static stage.
_OF_STAGE: tuple[tuple[str, Any, str], ...] = (
    ("normal", "normal", "Normal traction"),
    ("opening", "opening", "Opening"),
    ("tangential_gap", "slip", "Tangential gap"),
    ("tangential", "tangential", "Tangential traction"),
    ("state", "state", "State of the points"),
)


def joints(content: Content) -> Section | None:
    """Return the section with the joints' measures, histories and maps; None without joints."""
    if not any(run.results.joints for run in content.runs):
        return None
    runs = [run for run in content.runs if run.results.joints and run.has("states")]
    if not runs and content.main.static_alone and content.main.results.joints:
        return Section("joints", "Joints", _of_last_stage(content))
    if not runs:
        return nothing("joints", "Joints", "joints with recorded states")
    pieces: list[Html] = []
    bonds = any(
        measures.has_bonds(run.results, name) for run in runs for name in run.results.joints
    )
    free = len(measures.joint_shares(*(run.results for run in runs))) == 4
    without = {"share_frictionless": free, "share_broken": bonds}
    columns = [row for row in TABLE["measures"] if row.label and without.get(row.name, True)]
    for run in runs:
        zero = slip_zero(run.results)
        head = ["joint", *(row.heading.format(zero=zero) for row in columns)]
        rows = [
            [name, *(row.factor * values[row.name] for row in columns)]
            for name, values in measures.joint_measures(run.results).items()
        ]
        pieces.append(table(f"Motion of the joints ({run.label})", head, rows))
        text = (
            f"Slips count from the {zero}. Residual values are the mean over the last second (or "
            f"over the whole run, if shorter) minus the value in the {zero}. Shares are "
            "percentages of area and time."
        )
        pieces.append(paragraph(text, "note"))
    pieces += [_area(run) for run in runs]
    run = content.main if content.main in runs else runs[0]
    pieces.append(_histories(content, run))
    return Section("joints", "Joints", pieces + _maps(content, run))


def _area(run: Run) -> Html:
    """Return a paragraph on the joints' area, with a note on tied points if there are any."""
    text, note = joint_area(run.results), "."
    if "tied" in text:
        note = (
            ": at tied points the joint ends inside the body and its sides share nodes. Shares do "
            "not include tied points."
        )
    return paragraph(f"Area of the joints ({run.label}): {text.replace('^2', '²')}{note}", "note")


def _histories(content: Content, run: Run) -> Html:
    """Return a plot of each joint's histories, with the mobilised friction in the last panel."""
    extremes = {joint: joint_extremes(run.results, joint) for joint in run.results.joints}
    rows = drawn_series(extremes.values())
    curves: list[list[Curve]] = [[] for _ in rows]
    for joint, joint_values in extremes.items():
        for panel, row in zip(curves, rows, strict=True):
            values = row.factor * joint_values.values[row.key]
            panel.append((joint, joint_values.time, np.where(np.isinf(values), np.nan, values)))
    titles = [row.heading.replace(" [", f"{since(run.results, row.key)} [") for row in rows]
    spec = panels(curves, titles, "time [s]", shown=len(run.results.joints))
    spec["layout"][f"yaxis{len(rows)}"]["rangemode"] = "tozero"
    caption = (
        f"{', '.join(row.label for row in rows).capitalize()} of each joint of {run.label} against "
        "time. The mobilised friction is 1 / sliding safety: a joint slides at 1."
    )
    return content.drawings.plot("joint-histories", spec, caption)


def _maps(content: Content, run: Run) -> list[Html]:
    """Return maps of all joints: traction in statics and in the earthquake, opening, slip."""
    time, moment = largest_moment(run)
    if run.plane:
        return [
            _profiles(content, run, "joints_largest", moment, time=time),
            _profiles(content, run, "joints_opening", *_time_of_largest(run, "opening")),
        ]
    shown, maps, zero = [], JointMaps(run.results), zero_of(run.results)
    stage = -1 if run.results.stage_names else None
    words = f"Normal traction in the {zero}, {run.label}."
    shown.append(_map(content, "static", maps.draw("normal", None, 0, stage), words))
    drawn: list[tuple[str, Any, float | None, str]] = [
        ("normal", "normal", time, f"Normal traction at {moment}"),
        _largest(run, "opening", "opening"),
        _largest(run, "slip", "tangential_gap"),
        ("tangential", "tangential", time, f"Tangential traction at {moment}"),
        ("state", "state", time, f"State of the points at {moment}"),
    ]
    if "status" not in {n.split("/")[-1] for n in run.results.streams["states"]}:
        drawn.pop()
    frictions = {name: strength_of(run.results, name, None)[0] for name in run.results.joints}
    with_friction = [name for name, friction in frictions.items() if not np.isnan(friction)]
    if with_friction:
        drawn.append(("mobilised", "mobilised", time, f"Mobilised friction at {moment}"))
    for name, quantity, at, words in drawn:
        if quantity == "mobilised" and len(with_friction) < len(frictions):
            maps = JointMaps(run.results, with_friction)
        picture = maps.draw(quantity, at)
        words += f", {run.label}"
        if at is not None:
            recorded = run.results.time("states")[run.results.nearest("states", at)]
            words += f" at t = {recorded:.3f} s"
        shown.append(_map(content, name, picture, f"{words}."))
    return [*shown[:3], details("Further maps", shown[3:])]


def _largest(run: Run, kind: str, name: str) -> tuple[str, Any, float | None, str]:
    """Return the map of opening or slip over all steps, or at a record if the run has not ended."""
    if run.has("joint_maxima"):
        words = f"Largest {kind} of each point over all steps{since(run.results, kind)}"
        return name, f"largest_{kind}", None, words
    moment, time = _time_of_largest(run, kind)
    return name, kind, time, f"{name.replace('_', ' ').capitalize()} at {moment}"


def _time_of_largest(run: Run, kind: str) -> tuple[str, float]:
    """Return the record closest to the largest opening or slip in words, and its time [s]."""
    measured = measures.joint_measures(run.results).values()
    time = max((joint[f"{kind}_max"], joint[f"{kind}_time"]) for joint in measured)[1]
    return f"the record closest to the largest {kind}", time


def _of_last_stage(content: Content) -> list[Html]:
    """Return maps of all joints after the last static stage, for files without dynamics."""
    run = content.main
    tables = paragraph(
        "The section Statics lists openings, forces and safeties after each static stage."
    )
    area = _area(run)
    if run.plane:
        moment = f"the end of {run.results.stage_names[-1]}"
        return [tables, area, _profiles(content, run, "joints_static", moment, stage=-1)]
    shown, maps = [], JointMaps(run.results)
    for name, quantity, words in _OF_STAGE:
        picture = maps.draw(quantity, None, stage=-1)
        caption = f"{words}, {run.label} after {run.results.stage_names[-1]}."
        shown.append(_map(content, name, picture, caption))
    return [tables, area, *shown[:2], details("Further maps", shown[2:])]


def _profiles(
    content: Content, run: Run, name: str, moment: str, time: float | None = None, **stage: Any
) -> Html:
    """Return values along the joints of a plane run at a moment, described in words."""
    drawn = plots.joint_profiles(run.results, time=time, **stage)
    caption = f"Values along the joints at {moment}, {run.label}."
    path = content.save(name, drawn, dpi=100)
    return figure([content.drawings.picture(path, caption)], caption)


def _map(content: Content, name: str, picture: Any, caption: str) -> Html:
    path = content.save(f"joints_{name}", picture, dpi=100)
    return figure([content.drawings.picture(path, caption)], caption, wide=True)
