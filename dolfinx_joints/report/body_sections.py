# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report sections on the whole body: the 3-D view, stresses, mesh."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats, Ints
from dolfinx_joints.postprocessing import measures, views
from dolfinx_joints.postprocessing.body import Body
from dolfinx_joints.postprocessing.envelopes import PLANE_STRESS, EnvelopeName
from dolfinx_joints.postprocessing.frames import common_frame, nodal_displacement
from dolfinx_joints.postprocessing.joints.surface import facets_of_joint
from dolfinx_joints.postprocessing.palette import colours
from dolfinx_joints.postprocessing.rendering import round_scale
from dolfinx_joints.report.page import Html, Section, details, figure, paragraph, table, text
from dolfinx_joints.report.panels import floats, integers
from dolfinx_joints.report.runs import Content, Run, largest_moment, nothing
from dolfinx_joints.results.joint_points import gaps
from dolfinx_joints.results.reader import Results

MOMENTS = 40
_BLOCK = 2**21  # numbers that are read at once: 16 MB
_CONTROLS = (
    '<div class="controls"><label>Run <select name="run">{options}</select></label>'
    '<label>Time <input type="range" name="time" min="0" max="0" value="0"/></label>'
    '<output name="moment"></output>'
    '<label>Displacements × <input type="number" name="scale" min="0" step="any"/></label>'
    '<label><input type="checkbox" name="through"/> Show the joints through the body</label></div>'
)


def space(content: Content) -> Section | None:
    """Return the section with a 3-D view of the deformed body at chosen times; None in 2-D."""
    title = "3-D view of the body"
    runs = [run for run in content.runs if not run.plane]
    if not runs:
        return None
    runs = [run for run in runs if run.drawable and run.has("states", "displacement")]
    if not runs and all(run.static_alone for run in content.runs):
        words = "The files have only static stages; the section Statics shows the body after each."
        return Section("space", title, [paragraph(words)])
    if not runs:
        return nothing("space", title, "states of a body")
    if content.reference:
        runs = [run for run in (content.main, content.reference) if run in runs] or runs
    runs.sort(key=lambda run: run is not content.main)
    if content.drawings.printed:
        return Section("space", title, [_start(content, run) for run in runs])
    scenes = [scene(run) for run in runs]
    content.drawings.scene.extend(scenes)
    options = "".join(
        f'<option value="{number}">{text(run.label)}</option>' for number, run in enumerate(runs)
    )
    recorded = ", ".join(
        f"{len(s['frames'])} of the {s['records']} recorded states of {s['label']}" for s in scenes
    )
    frames = common_frame({run.label: nodal_displacement(run.results, 0)[1] for run in runs})
    factors = common_frame({s["label"]: f"× {s['scale']:g}" for s in scenes})
    groups = {run.label: ", ".join(run.groups or ["the whole body"]) for run in runs}
    caption = (
        f"Boundary of {common_frame(groups)} from downstream, with displacements {factors} unless "
        f"changed above. Colours show the displacement {frames}. The view has {recorded}: at most "
        f"{MOMENTS} evenly spaced states, and the states with the largest displacement and opening."
        " It starts at the largest displacement. If the joints are shown through the body, "
        "colours show their opening."
    )
    view = Html(
        f'<figure id="scene">{_CONTROLS.format(options=options)}'
        '<div class="plot" style="height:520px" role="img" aria-label="3-D view of the '
        f'deformed body"></div><figcaption>{text(caption)}</figcaption></figure>'
    )
    return Section("space", title, [view])


def _start(content: Content, run: Run) -> Html:
    """Return a picture of the first state of the 3-D view."""
    view = scene(run)
    time, scale = view["frames"][view["start"]]["time"], view["scale"]
    drawn = views.deformed(run.results, time=time, scale=scale, groups=run.groups)
    caption = f"{run.label} at t = {time:.3f} s, displacements enlarged {scale:g} times."
    png = content.save(f"space_{content.runs.index(run) + 1}", drawn)
    return figure([content.drawings.picture(png, caption)], caption)


def stresses(content: Content) -> Section:
    """Return the section on extreme stresses at the boundary, with pictures of the main run."""
    title = "Stresses"
    runs = [run for run in content.runs if run.has("envelopes")]
    crosses = _crosses(content, content.main)
    if not runs:
        empty = nothing("stresses", title, "stress envelopes")
        return Section("stresses", title, crosses) if crosses else empty
    extremes = [measures.stress_extremes(run.results) for run in runs]
    rows = [
        [name.replace("_", ", "), *(1e-6 * e[name] for e in extremes)]
        for name in extremes[0]
        if not all(np.isnan(e[name]) for e in extremes)
    ]
    head = ["[MPa]", *(run.label for run in runs)]
    run = content.main if content.main in runs else runs[0]
    where = "in the body" if run.plane else "at the boundary"
    pieces = [table(f"Extreme stresses of the run {where}, tension > 0", head, rows)]
    recorded = [name for name, value in extremes[runs.index(run)].items() if not np.isnan(value)]
    if run.drawable:
        shown = [_envelope(content, run, name) for name in recorded]
        pieces += shown[:2]
        if shown[2:]:
            title_of_others = "Vertical stresses" if run.plane else "Arch and cantilever stresses"
            pieces.append(details(title_of_others, shown[2:]))
    return Section("stresses", title, pieces + crosses)


def _crosses(content: Content, run: Run) -> list[Html]:
    """Return pictures of the principal directions of a plane run in statics and dynamics."""
    states: list[tuple[str, dict[str, Any]]] = []
    if run.has("statics", PLANE_STRESS):
        states.append(("after the last static stage", {"stage": -1}))
    if run.has("states", PLANE_STRESS):
        time, moment = largest_moment(run)
        states.append((f"at {moment}", {"time": time}))
    pictures = []
    for words, state in states if run.drawable else []:
        drawn = views.principal_stresses(run.results, groups=run.groups, **state)
        path = content.save(f"principal_{'_'.join(state)}", drawn)
        caption = f"Principal stresses in the plane {words}, {run.label}."
        pictures.append(figure([content.drawings.picture(path, caption)], caption, wide=True))
    return pictures


def _envelope(content: Content, run: Run, name: str) -> Html:
    quantity, end = name.split("_")
    extreme = {"max": "Largest", "min": "Smallest"}[end]
    where = "body" if run.plane else "boundary"
    caption = f"{extreme} {quantity} stress over the run at each point of the {where}, {run.label}."
    drawn = views.envelope(run.results, cast(EnvelopeName, name), groups=run.groups)
    path = content.save(name, drawn, dpi=130)
    return figure([content.drawings.picture(path, caption)], caption, wide=True)


def mesh(content: Content) -> Section:
    """Return the section with the mesh of the main run and the names of its joints."""
    run = content.main
    if not run.drawable:
        return nothing("mesh", "Mesh", "mesh of the body")
    caption = f"Finite-element mesh of {run.label}, with the names of its joints."
    path = content.save("mesh", views.mesh(run.results), dpi=130)
    picture = content.drawings.picture(path, caption)
    return Section("mesh", "Mesh", [figure([picture], caption, wide=True)])


def scene(run: Run) -> dict[str, Any]:
    """Return data of one run for the page's script: the boundary of its groups, chosen states.

    The states are at most ``MOMENTS`` evenly spaced states, and the states with the largest
    displacement and opening.
    """
    results = run.results
    surface = results.static("mesh/surface")
    shown: Flags = np.asarray(np.isin(surface, Body(results, run.groups).seen).all(axis=1))
    used = np.unique(surface[shown])
    surface = np.where(shown[:, None], np.searchsorted(used, surface), -1)
    nodes = results.static("mesh/nodes")[used]
    sizes, openings = _sizes(results, used), _openings(results)
    largest = openings.max(axis=1, initial=0.0)
    start, widest = int(np.argmax(sizes)), int(np.argmax(largest))
    rows = len(sizes)
    moments = np.unique([*np.linspace(0, rows - 1, min(rows, MOMENTS)).astype(int), start, widest])
    faces, cells = _joint_faces(results, surface)
    surface = surface[shown]
    body, _ = _triangles(surface, np.arange(len(surface)))
    return {
        "label": run.label,
        "nodes": floats(nodes),
        "facets": integers(surface),
        "corners": surface.shape[1],
        "triangles": body,
        "joints": {**faces, "cells": integers(cells)},
        "frames": [_frame(results, used, int(row), openings[row]) for row in moments],
        "start": int(np.searchsorted(moments, start)),
        "scale": round_scale(nodes, float(sizes.max())),
        "largest": 1e3 * float(sizes.max()) or 1.0,
        "widest": 1e3 * float(largest.max()) or 1.0,
        "records": rows,
        "colours": _colour_scale(),
    }


def _colour_scale() -> list[list[Any]]:
    """Return the colour scale of the pictures for the page's script."""
    from matplotlib.colors import to_hex

    places = [float(place) for place in np.linspace(0.0, 1.0, 11)]
    return [[place, to_hex(colours()(place))] for place in places]


def _frame(results: Results, used: Ints, number: int, opening: Floats) -> dict[str, Any]:
    """Return displacements of boundary vertices [m] and openings of joint facets [mm]."""
    return {
        "time": float(results.time("states")[number]),
        "displacement": floats(nodal_displacement(results, number)[0][used]),
        "opening": floats(1e3 * opening),
    }


def _sizes(results: Results, used: Ints) -> Floats:
    """Return the largest displacement of each record, shape (records,), [m]; read in blocks."""
    rows = results.rows("states")
    count = max(1, _BLOCK // results.static("mesh/nodes").size)
    blocks = [slice(first, first + count) for first in range(0, rows, count)]
    moved = (nodal_displacement(results, block)[0][:, used] for block in blocks)
    sizes = [np.linalg.norm(u, axis=-1).max(axis=-1, initial=0.0) for u in moved]
    return np.concatenate([np.zeros(0), *sizes])


def _openings(results: Results) -> Floats:
    """Return the largest opening of the points of each joint facet, 0 if closed.

    The shape is (records, facets of all joints), [m].
    """
    openings = [np.zeros((results.rows("states"), 0))]
    for joint in results.joints:
        gap = gaps(results, "states", joint)[..., 0]
        _, facet = np.unique(results.static(f"joints/{joint}/facet"), return_inverse=True)
        order = np.argsort(facet, kind="stable")
        starts = np.searchsorted(facet[order], np.arange(facet.max(initial=-1) + 1))
        openings.append(np.maximum(np.maximum.reduceat(gap[:, order], starts, axis=1), 0.0))
    return np.concatenate(openings, axis=1)


def _joint_faces(results: Results, surface: Ints) -> tuple[dict[str, dict[str, str]], Ints]:
    """Return triangles of the joint faces, and the number of each triangle's joint facet.

    Facets of ``surface`` that are not shown have the vertices -1.
    """
    sides = [facets_of_joint(results, joint)[1].ravel() for joint in results.joints]
    chosen = np.concatenate([np.zeros(0, dtype=np.int64), *sides])
    shown = surface[chosen, 0] >= 0
    return _triangles(surface[chosen[shown]], np.repeat(np.arange(len(chosen) // 2), 2)[shown])


def _triangles(facets: Ints, cells: Ints) -> tuple[dict[str, dict[str, str]], Ints]:
    """Split facets with 3 or 4 corners into triangles; return triangles and their cells."""
    parts = [facets[:, [0, 1, 2]]]
    if facets.shape[1] == 4:
        parts.append(facets[:, [0, 2, 3]])
    corners = np.concatenate(parts)
    return (
        {axis: integers(corners[:, n]) for n, axis in enumerate("ijk")},
        np.tile(cells, len(parts)),
    )
