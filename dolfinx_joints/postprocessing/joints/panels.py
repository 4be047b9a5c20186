# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Histories of all joints in one figure, one panel per joint."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.axes import decorate, new_figure
from dolfinx_joints.postprocessing.joints.extremes import drawn_series, joint_extremes
from dolfinx_joints.postprocessing.palette import BLUE
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.joint_points import since
from dolfinx_joints.results.quantities import JOINT_SERIES
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    JointQuantity = str
else:
    JointQuantity = Literal[tuple(row.key for row in JOINT_SERIES)]

_COLUMNS = 4


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
