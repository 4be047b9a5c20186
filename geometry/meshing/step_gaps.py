# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Size of the body of a STEP file, and gaps between its solids, before the body is meshed."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import gmsh
import numpy as np

from dolfinx_joints.common.errors import PlausibilityWarning, warn

JOINED = 1e-6  # of the size of the body: faces that are nearer are joined
NEAR = 2e-3  # wider gaps between faces are taken as meant [m]
_EXTENT = (1.0, 2e4)  # of bodies [m]


def check_extent(step: Path, size: float) -> float:
    """Return the largest extent of the body [m], and compare it with the size of the cells."""
    low, high = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    extent = float((high - low).max())
    if size > extent:
        raise ValueError(
            f"size is {size:g} m, but the body is {extent:.3g} m long: choose a smaller size, or "
            f"correct the unit of length in {step}."
        )
    if not _EXTENT[0] <= extent <= _EXTENT[1]:
        warn(
            f"{step}: the body is {extent:.3g} m long; usual is {_EXTENT[0]:g} to "
            f"{_EXTENT[1]:g} m. Is the unit of length in the file right?",
            PlausibilityWarning,
        )
    return extent


def warn_of_gaps(step: Path, owner: dict[int, str]) -> None:
    """Warn of two solids whose faces are so near that a joint may be meant there."""
    faces = [
        (tag, face, np.reshape(gmsh.model.getBoundingBox(2, face), (2, 3)))
        for tag in owner
        for face in faces_of(tag)
        if len(sides_of(face)) == 1
    ]
    corners = {f: set(gmsh.model.getBoundary([(2, f)], recursive=True)) for _, f, _ in faces}
    gaps: dict[tuple[int, int], float] = {}
    for (one, f, a), (two, g, b) in combinations(faces, 2):
        apart = np.maximum(a[0] - b[1], b[0] - a[1]).max() > NEAR
        if one == two or apart or corners[f] & corners[g]:
            continue
        distance = gmsh.model.occ.getDistance(2, f, 2, g)[0]
        if 0.0 < distance <= NEAR:
            gaps[one, two] = min(distance, gaps.get((one, two), NEAR))
    for (one, two), gap in gaps.items():
        warn(
            f"{step}: faces of the solids {owner[one]!r} and {owner[two]!r} are {gap:.3g} m "
            "apart, without a joint between them; let them touch in the CAD model if a joint is meant."
        )


def faces_of(volume: int) -> list[int]:
    """Return the faces of a volume."""
    return [int(face) for face in gmsh.model.getAdjacencies(3, volume)[1]]


def sides_of(face: int) -> list[int]:
    """Return the volumes on the sides of a face."""
    return [int(volume) for volume in gmsh.model.getAdjacencies(2, face)[0]]
