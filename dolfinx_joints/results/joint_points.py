# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Areas and gaps of the joint points in a file, and the points that are tied.

If a joint ends inside a body, both sides share the nodes at this end. The joint points there are
tied: they neither open nor slide and transmit no traction. Area shares exclude tied points.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Flags, Floats
from dolfinx_joints.results.reader import Results


class Statics(Protocol):
    """Protocol of the arrays of mesh and joints, which `Results` implements."""

    @property
    def statics(self) -> Collection[str]:
        """Names of the arrays."""

    def static(self, name: str) -> NDArray[Any]:
        """Return the array with this name."""


def tied_points(results: Statics, joint: str) -> Flags:
    """Return flags of the tied points, shape (n,); all False in files of earlier versions."""
    where = f"joints/{joint}/tied"
    if where in results.statics:
        return np.asarray(results.static(where) != 0)
    return np.zeros(len(results.static(f"joints/{joint}/areas")), dtype=bool)


def free_areas(results: Statics, joint: str) -> Floats:
    """Return the area of each point of a joint, zero at tied points, shape (n,), [m^2]."""
    areas = results.static(f"joints/{joint}/areas")
    return np.where(tied_points(results, joint), 0.0, areas)


def gaps(results: Results, stream: str, joint: str, index: int | slice = slice(None)) -> Floats:
    """Return the gaps of the points of a joint, zero at tied points, shape (..., n, 3), [m].

    The stream is ``states`` or ``statics``, the index one record or a slice of records.
    """
    gap = results.series(stream, f"joints/{joint}/gap", index)
    return np.where(tied_points(results, joint)[:, None], 0.0, gap)


def zero_of(results: Results) -> str:
    """Return "static state", from which displacements count, or else "first record"."""
    return "static state" if results.stage_names else "first record"


def slip_zero(results: Results) -> str:
    """Return the state from which slips count: `zero_of`, or "first record" in layout 1."""
    if results.layout == 1 and "states" in results.streams and results.rows("states"):
        return "first record"
    return zero_of(results)


def since(results: Results, name: str) -> str:
    """Return `slip_zero` in words to follow the name of a slip, an empty text for other names."""
    return f" from the {slip_zero(results)}" if name.endswith("slip") else ""


def zero_gap(results: Results, joint: str) -> Floats:
    """Return the gaps of `slip_zero`, shape (1, n, 3), or (0, n, 3) without records, [m]."""
    if slip_zero(results) == "first record":
        return gaps(results, "states", joint, slice(1))
    return gaps(results, "statics", joint, slice(-1, None))


def joint_area(results: Results) -> str:
    """Return the area of all joints as text, with the tied share if it is not zero."""
    area, free = 0.0, 0.0
    for joint in results.joints:
        area += float(results.static(f"joints/{joint}/areas").sum())
        free += float(free_areas(results, joint).sum())
    if free == area:
        return f"{area:.4g} m^2"
    return f"{area:.4g} m^2, {100.0 * (1.0 - free / area):.2g} % of it tied"
