# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of the report's view in space: boundary surface, its motion, opening of the joints."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.postprocessing.joint_surface import JointSurface
from dolfinx_joints.postprocessing.pictures import round_scale
from dolfinx_joints.report.page import floats, integers
from dolfinx_joints.report.runs import Run
from dolfinx_joints.results.reader import Results

Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.integer[Any]]

MOMENTS = 40


def scene(run: Run) -> dict[str, Any]:
    """What the page's script draws of one run.

    All vertices and facets of the boundary are taken. Of the recorded states it takes at most
    ``MOMENTS`` at equal distances, and those of the largest displacement and opening.

    Args:
        run: a run whose file holds states of a body in space.
    """
    results = run.results
    used, surface = np.unique(results.static("mesh/surface"), return_inverse=True)
    surface = surface.reshape(results.static("mesh/surface").shape)
    nodes = results.static("mesh/nodes")[used]
    sizes, openings = _extremes(results, used)
    start, widest = int(np.argmax(sizes)), int(np.argmax(openings))
    rows = len(sizes)
    moments = np.unique([*np.linspace(0, rows - 1, min(rows, MOMENTS)).astype(int), start, widest])
    body, _ = _triangles(surface, np.arange(len(surface)))
    faces, cells = _joint_faces(results, surface)
    return {
        "label": run.label,
        "nodes": floats(nodes),
        "facets": integers(surface),
        "corners": surface.shape[1],
        "triangles": body,
        "joints": {**faces, "cells": integers(cells)},
        "frames": [_frame(results, used, int(number)) for number in moments],
        "start": int(np.searchsorted(moments, start)),
        "scale": round_scale(nodes, float(sizes.max())),
        "largest": 1e3 * float(sizes.max()) or 1.0,
        "widest": 1e3 * float(openings.max()) or 1.0,
        "records": rows,
    }


def _frame(results: Results, used: Integers, number: int) -> dict[str, Any]:
    """Displacements of the boundary's vertices [m] and openings of the joint facets [mm]."""
    displacement = results.series("states", "displacement", number)[used]
    openings = [_opening(results, joint, number) for joint in results.joints]
    return {
        "time": float(results.time("states")[number]),
        "displacement": floats(displacement),
        "opening": floats(1e3 * np.concatenate(openings) if openings else []),
    }


def _extremes(results: Results, used: Integers) -> tuple[Floats, Floats]:
    """Largest displacement and opening of each record [m], read one at a time."""
    rows = results.rows("states")
    sizes, openings = np.zeros(rows), np.zeros(rows)
    for number in range(rows):
        displacement = results.series("states", "displacement", number)[used]
        sizes[number] = np.linalg.norm(displacement, axis=1).max(initial=0.0)
        openings[number] = max(
            (_opening(results, joint, number).max(initial=0.0) for joint in results.joints),
            default=0.0,
        )
    return sizes, openings


def _opening(results: Results, joint: str, number: int) -> Floats:
    """Largest opening among the points of each facet of a joint [m], 0 where closed."""
    gap = results.series("states", f"joints/{joint}/gap", number)[:, 0]
    _, facet = np.unique(results.static(f"joints/{joint}/facet"), return_inverse=True)
    largest = np.zeros(facet.max(initial=-1) + 1)
    np.maximum.at(largest, facet, gap)
    return largest


def _joint_faces(results: Results, surface: Integers) -> tuple[dict[str, dict[str, str]], Integers]:
    """Triangles of the joints' faces, and the number of the joint facet of each triangle."""
    facets: list[Integers] = []
    cells: list[Integers] = []
    count = 0
    for joint in results.joints:
        sides = JointSurface(results, joint).sides()
        numbers = count + np.repeat(np.arange(len(sides) // 2), 2)
        facets.append(sides)
        cells.append(numbers)
        count += len(sides) // 2
    empty = np.zeros(0, dtype=np.int64)
    chosen = np.concatenate([empty, *facets])
    return _triangles(surface[chosen], np.concatenate([empty, *cells]))


def _triangles(facets: Integers, cells: Integers) -> tuple[dict[str, dict[str, str]], Integers]:
    """Facets with three or four corners cut into triangles, and the cell of each."""
    parts = [facets[:, [0, 1, 2]]]
    if facets.shape[1] == 4:
        parts.append(facets[:, [0, 2, 3]])
    corners = np.concatenate(parts)
    return (
        {axis: integers(corners[:, n]) for n, axis in enumerate("ijk")},
        np.tile(cells, len(parts)),
    )
