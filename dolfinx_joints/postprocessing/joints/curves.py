# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves of all joints in one figure: histories, and values along the joints of a plane model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.axes import decorate, legend, new_figure
from dolfinx_joints.postprocessing.joints.extremes import drawn_series, joint_extremes
from dolfinx_joints.postprocessing.joints.surface import (
    MAP_LABELS,
    MapQuantity,
    is_plane,
    map_value,
)
from dolfinx_joints.postprocessing.palette import BLUE
from dolfinx_joints.results.arguments import check_results, chosen_state
from dolfinx_joints.results.joint_points import since
from dolfinx_joints.results.quantities import JOINT_SERIES
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    JointQuantity = str
else:
    JointQuantity = Literal[tuple(row.key for row in JOINT_SERIES)]

_COLUMNS = 4
PROFILES: tuple[MapQuantity, ...] = ("normal", "tangential", "opening", "slip")


@checked
def joint_panels(results: Results, quantity: JointQuantity = "opening") -> Figure:
    """Draw a series of each joint against time: largest opening or slip [mm], or pressure [MPa].

    All panels have the same axes. The number in a panel is the largest value of the joint.
    """
    check_results(results)
    if not results.joints:
        raise ResultsError(f"{results.path} has no joints to draw.")
    curves = {joint: joint_extremes(results, joint) for joint in results.joints}
    series = next((row for row in drawn_series(curves.values()) if row.key == quantity), None)
    if series is None:
        raise ResultsError(f"{results.path} lacks the {quantity} of joints; repeat the run.")
    rows = -(-len(results.joints) // _COLUMNS)
    columns = min(_COLUMNS, len(results.joints))
    figure = new_figure(figsize=(1.9 * columns + 0.5, 1.25 * rows + 0.5), layout="compressed")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, (joint, extremes) in zip(panels, curves.items(), strict=False):
        values = series.factor * extremes.values[quantity]
        ax.fill_between(extremes.time, values, color=BLUE, alpha=0.25, linewidth=0.0)
        ax.plot(extremes.time, values, color=BLUE, linewidth=0.8)
        decorate(ax, "", "")
        ax.set_title(
            f"{joint}: {np.max(values):.3g} {series.shown}", fontsize="small", loc="left", pad=3.0
        )
        ax.tick_params(labelsize="x-small")
        ax.margins(x=0.0)
    panels[0].set_ylim(bottom=min(0.0, *(ax.dataLim.ymin for ax in panels[: len(curves)])))
    for ax in panels[len(results.joints) :]:
        ax.set_visible(False)
    for ax in panels[max(0, len(results.joints) - columns) : len(results.joints)]:
        ax.tick_params(labelbottom=True)  # the lowest panel of a column may be above the last row
    figure.supxlabel("time [s]", fontsize="small")
    heading = series.heading.replace(" [", f"{since(results, quantity)} [")
    figure.supylabel(heading, fontsize="small")
    return figure


@checked
def joint_profiles(
    results: Results,
    *,
    joints: Sequence[str] | None = None,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
) -> Figure:
    """Draw tractions, opening and slip along the joints of a plane model, one line per joint.

    The distance is measured along the joint, from its lower end, for a horizontal joint from its
    end of smaller x. Tractions have gaps at open points. The slip is the tangential gap.

    The state nearest to ``time`` [s] is drawn; without a time, the state number ``index`` or the
    static ``stage`` of this name or number (from 0).
    """
    results, number, moment = chosen_state(results, time, index, stage)
    names = results.joints if joints is None else list(joints)
    if not names:
        raise ValueError(f"{results.path} has no joints to draw.")
    if not is_plane(results):
        raise ValueError(f"{results.path} is a 3-D run; plots.joint_maps draws its joints.")
    figure = new_figure(figsize=(7.2, 8.0), layout="compressed")
    axes = figure.subplots(len(PROFILES), 1, sharex=True)
    for name in names:
        results.check_joint(name)
        order, distance = along(results.static(f"joints/{name}/points"))
        for ax, quantity in zip(axes, PROFILES, strict=True):
            values = map_value(results, name, quantity, number)[order]
            ax.plot(distance, values, ".-", markersize=3.0, linewidth=1.0, label=name)
    for ax, quantity in zip(axes, PROFILES, strict=True):
        decorate(ax, "", MAP_LABELS[quantity].replace(", ", "\n").replace(" [", "\n["))
        ax.margins(x=0.0)
    axes[-1].set_xlabel("distance along the joint [m]")
    axes[0].set_title(f"values along the joints {moment}", loc="left", fontsize="medium")
    if len(names) > 1:
        legend(axes[-1], "below")
    return figure


def along(points: Floats) -> tuple[Ints, Floats]:
    """Return the order of points along a line, and their distances from the first in this order.

    Args:
        points: Joint points, shape (n, 3), z = 0, [m].

    Returns:
        Point numbers, and distances along the polygon through the points [m], both of shape (n,).
    """
    centred = points[:, :2] - points[:, :2].mean(axis=0)
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    is_level = abs(direction[1]) < 0.1 * abs(direction[0])
    direction = direction * np.sign(direction[0] if is_level else direction[1])
    following = int(np.argmin(centred @ direction))
    unused, chain = np.ones(len(points), dtype=bool), []
    for _ in range(len(points)):  # the nearest point that is left, also where the line turns back
        chain.append(following)
        unused[following] = False
        distances = np.linalg.norm(points - points[following], axis=1)
        following = int(np.argmin(np.where(unused, distances, np.inf)))
    order: Ints = np.array(chain)
    steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    return order, np.append(0.0, np.cumsum(steps))
