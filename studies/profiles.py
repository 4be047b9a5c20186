# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tractions along the height of a joint, drawn as in the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints import Results
from dolfinx_joints.postprocessing.axes import decorate, legend, new_axes
from dolfinx_joints.postprocessing.joints.surface import (
    MAP_LABELS,
    JointSurface,
    Quantity,
    map_value,
)
from dolfinx_joints.postprocessing.palette import BLUE, GREY, RED
from dolfinx_joints.results.arguments import record_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def traction_profile(
    results: Results,
    joint: str,
    quantity: Literal["tractions", "mobilised"] = "tractions",
    *,
    time: float | None = None,
    index: int = -1,
    position: float = 0.5,
) -> Axes:
    """Draw tractions along the height of a joint, at a relative width.

    It shows the joint points closest to this line: normal and tangential traction, or the
    mobilised friction. Open points are black, at zero.

    Args:
        results: The run.
        joint: Name of the joint.
        quantity: ``"tractions"`` or ``"mobilised"``.
        time: Time of the record of ``states``; the nearest one is drawn [s].
        index: Number of the record, if no time is given.
        position: 0 at the upstream (left) edge of the joint, 1 at the other edge.
    """
    number = record_number(results, time, index)
    surface = JointSurface(results, joint)
    ax = new_axes(width=4.6, height=4.6)
    chosen = points_along(surface, position)
    chosen = chosen[~surface.tied[chosen]]  # tied points transmit nothing
    height = surface.points[chosen, 1]
    curves: tuple[tuple[Quantity, str, str], ...] = (("mobilised", BLUE, "o"),)
    if quantity == "tractions":
        curves = (("normal", BLUE, "o"), ("tangential", RED, "s"))
    for name, colour, marker in curves:
        values = map_value(results, joint, name, number)[chosen]
        is_open = np.isnan(values)
        values[is_open] = 0.0
        label = MAP_LABELS[name].replace(" [MPa]", "").replace(" [-]", "")
        ax.plot(values, height, marker=marker, markersize=4, color=colour, label=label)
        ax.plot(values[is_open], height[is_open], marker, markersize=4.5, color="black")
    ax.plot([], [], "o", color="black", markersize=4.5, label="open")
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    is_traction = quantity == "tractions"
    decorate(ax, "traction [MPa]" if is_traction else "mobilised friction [-]", surface.labels[1])
    ax.set_title(
        f"{joint} at t = {results.time('states')[number]:.3f} s, {position:.0%} of width",
        fontsize="medium",
    )
    legend(ax, "below")
    return ax


def points_along(joint: JointSurface, position: float) -> NDArray[np.integer[Any]]:
    """Return the points whose patches a line at a relative width meets, from bottom to top."""
    from matplotlib.path import Path as Outline

    height = np.linspace(joint.facets[..., 1].min(), joint.facets[..., 1].max(), 801)[1::2, None]
    start = joint.facets.reshape(-1, 2)
    end = np.roll(joint.facets, -1, axis=1).reshape(-1, 2)
    rise = end[:, 1] - start[:, 1]
    share = (height - start[:, 1]) / np.where(rise == 0.0, np.inf, rise)
    crossed = (start[:, 1] - height) * (end[:, 1] - height) <= 0.0
    across = start[:, 0] + share * (end[:, 0] - start[:, 0])
    left_edge = np.where(crossed, across, np.inf).min(axis=1)
    right_edge = np.where(crossed, across, -np.inf).max(axis=1)
    # Between two columns of patches, choose the left one.
    inner = np.clip(position - 1e-6, 1e-6, 1.0 - 1e-6)
    line = np.stack([left_edge + inner * (right_edge - left_edge), height[:, 0]], axis=1)
    met = [Outline(patch).contains_points(line).any() for patch in joint.patches()]
    numbers = np.flatnonzero(met)
    return numbers[np.argsort(joint.points[numbers, 1], kind="stable")]
