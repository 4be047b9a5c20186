# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections of a report on the whole body: the view in space, envelopes of its stresses."""

from __future__ import annotations

from typing import Any

from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report.page import Html, Section, details, figure, paragraph, table, text
from dolfinx_joints.report.response_sections import largest_moment
from dolfinx_joints.report.run_sections import Content, nothing
from dolfinx_joints.report.runs import Run
from dolfinx_joints.report.scene import MOMENTS, scene

_CONTROLS = (
    '<div class="controls"><label>Run <select name="run">{options}</select></label>'
    '<label>Time <input type="range" name="time" min="0" max="0" value="0"/></label>'
    '<output name="moment"></output>'
    '<label>Displacements × <input type="number" name="scale" min="0" step="any"/></label>'
    '<label><input type="checkbox" name="through"/> See through to the joints</label></div>'
)


def space(content: Content) -> Section:
    """The deformed body in space, at chosen times."""
    title = "The body in space"
    needed = {"mesh/nodes", "mesh/surface"}
    runs = [
        run
        for run in content.runs
        if needed <= set(run.results.statics) and run.has("states", "displacement")
    ]
    if not runs:
        return nothing("space", title, "states of a body")
    runs = [run for run in runs if not run.plane]
    if not runs:
        return Section("space", title, [paragraph("The models are plane: no view in space.")])
    if content.pair:
        runs = [content.pair.joints, content.pair.linear]
    scenes = [scene(run) for run in runs]
    content.drawings.scene.extend(scenes)
    options = "".join(
        f'<option value="{number}">{text(run.label)}</option>' for number, run in enumerate(runs)
    )
    recorded = ", ".join(
        f"{len(s['frames'])} of the {s['records']} recorded states of {s['label']}" for s in scenes
    )
    caption = (
        f"Boundary of the body, displacements enlarged by the factor above, coloured by their "
        f"size from the unloaded shape. It shows {recorded}: at most {MOMENTS} at equal distances, "
        "and those of the largest displacement and opening; it starts at the largest "
        "displacement. Seen through, the joints are coloured by their opening."
    )
    view = Html(
        f'<figure id="scene">{_CONTROLS.format(options=options)}'
        '<div class="plot" style="height:520px" role="img" aria-label="The deformed body in '
        f'space"></div><figcaption>{text(caption)}</figcaption></figure>'
    )
    return Section("space", title, [view, *_pictures(content, runs[0])])


def _pictures(content: Content, run: Run) -> list[Html]:
    """Mesh and largest deformation of a run, for print."""
    from dolfinx_joints.postprocessing import views

    time, moment = largest_moment(run), "the last record"
    if run.has("histories", "displacement"):
        moment = f"the largest displacement of {run.results.point_names[0]} from the static state"
    drawn = {
        "mesh": (views.mesh(run.results), f"Finite-element mesh of {run.label}."),
        "deformed": (
            views.deformed(run.results, time=time),
            f"Deformed shape of {run.label} at t = {time:.3f} s, {moment}.",
        ),
    }
    if run.results.joints:
        drawn["openings"] = (
            views.joint_map(run.results, "opening", time=time),
            f"Opening of the joints of {run.label} at t = {time:.3f} s.",
        )
    return [_picture(content, name, *each) for name, each in drawn.items()]


def _picture(content: Content, name: str, drawn: Any, caption: str) -> Html:
    path = content.save(name, drawn, dpi=100)
    return figure([content.drawings.picture(path, caption)], caption)


def envelopes(content: Content) -> Section:
    """Largest stresses over time at the boundary."""
    title = "Stress envelopes"
    runs = [run for run in content.runs if run.has("envelopes")]
    if not runs:
        return nothing("envelopes", title, "stress envelopes")
    each = [measures.stress_extremes(run.results) for run in runs]
    rows = [[name.replace("_", ", "), *(1e-6 * e[name] for e in each)] for name in each[0]]
    head = ["largest over time and boundary [MPa]", *(run.label for run in runs)]
    pieces = [table("Extremes of the stresses", head, rows)]
    for run in list(content.pair or runs):
        if run in runs:
            known = [name for name, value in each[runs.index(run)].items() if value == value]
            drawn = [_envelope(content, run, name) for name in known]
            pieces.append(details(f"Envelopes of {run.label}", drawn))
    return Section("envelopes", title, pieces)


def _envelope(content: Content, run: Run, name: str) -> Html:
    from dolfinx_joints.postprocessing import views

    number = list(content.runs).index(run) + 1
    caption = f"Envelope {name.replace('_', ', ')} of {run.label}, from upstream and downstream."
    return _picture(content, f"{name}_{number}", views.envelope(run.results, name), caption)
