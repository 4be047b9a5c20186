# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Axes of figures: creation, labels, legends and the style that all figures share.

Matplotlib's global state is not used. Notebooks display the figures and new axes.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.motions.spectra import DampingRatio as DampingRatio
from dolfinx_joints.postprocessing.palette import BLUE, ORANGE
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Inches = Annotated[float, at.Interval(ge=0.5, le=100.0), at.Unit("inch")]
_BELOW = 0.45  # distance from the axes to a legend below ticks and label [inch]
Periods = Annotated[Sequence[float], at.MinLen(1), at.Gt(0.0), at.Unit("s")]


@checked
def new_axes(*, width: Inches = 6.3, height: Inches = 3.2) -> Axes:
    """Return the axes of a new figure."""
    figure = new_figure(figsize=(width, height), layout="compressed")
    return figure.add_subplot(axes_class=_shown_classes()[1])


def new_figure(**options: Any) -> Figure:
    """Return a figure that notebooks display; the options are those of matplotlib's ``Figure``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure: Figure = _shown_classes()[0](**options)
    FigureCanvasAgg(figure)  # measures texts at once; the usual canvas prepares a file for each
    return figure


def pixels(figure: Figure, dpi: float) -> NDArray[np.uint8]:
    """Draw a figure once; return red, green, blue and opacity, shape (height, width, 4)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    usual, figure.dpi = figure.dpi, dpi
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    figure.dpi = usual
    return np.asarray(canvas.buffer_rgba())


@cache
def _shown_classes() -> tuple[type, type]:
    """Return the classes of figures and axes that notebooks display as pictures."""
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        def _repr_png_(self) -> bytes:
            file = io.BytesIO()
            self.savefig(file, format="png", dpi=110)
            return file.getvalue()

    class ShownAxes(Axes):
        def _repr_png_(self) -> bytes:
            return self.figure.figure._repr_png_()  # type: ignore[attr-defined]

    return ShownFigure, ShownAxes


def decorate(ax: Axes, xlabel: str, ylabel: str, *, grid: bool = True) -> None:
    """Label the axes and apply the common style."""
    ax.set(xlabel=xlabel, ylabel=ylabel)
    for side, spine in ax.spines.items():
        spine.set_visible(side not in ("top", "right"))
        spine.set_in_layout(False)  # labels extend farther, and measuring a spine is slow
    if grid:
        ax.grid(color="0.9", linewidth=0.6)
        ax.set_axisbelow(True)


def entitle(ax: Axes, text: str, *, over_legend: bool = False) -> None:
    """Write a title at the left; with ``over_legend``, higher than a legend ``above`` the axes."""
    ax.set_title(text, loc="left", fontsize="medium", pad=24.0 if over_legend else None)


def legend(ax: Axes, where: str = "inside") -> None:
    """Draw a legend ``inside``, ``above`` (right) or ``below`` the axes."""
    from matplotlib.transforms import ScaledTranslation

    places: dict[str, dict[str, Any]] = {
        "inside": {"framealpha": 0.85, "edgecolor": "none"},
        "above": {"frameon": False, "ncols": 2, "loc": "lower right", "bbox_to_anchor": (1, 1)},
        "below": {"frameon": False, "ncols": 2, "loc": "upper left", "bbox_to_anchor": (0, 0)},
    }
    if where == "below":  # ticks and label have the same height for axes of any height
        down = ScaledTranslation(0.0, -_BELOW, ax.figure.figure.dpi_scale_trans)
        places[where]["bbox_transform"] = ax.transAxes + down
    ax.legend(fontsize="small", **places[where])


def plain_periods(ax: Axes) -> None:
    """Write periods as decimal numbers."""
    from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

    ax.xaxis.set_major_locator(FixedLocator([0.03, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0]))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def runs(
    results: Results, reference: Results | None, labels: tuple[str, str] | None = None
) -> list[tuple[Results, dict[str, Any]]]:
    """Return the runs in drawing order, each with the style of its line."""
    check_results(results)
    labels = labels or _names_of(results, reference)
    run = (results, {"color": BLUE, "linewidth": 0.9, "label": labels[0]})
    if reference is None:
        return [run]
    return [(reference, {"color": ORANGE, "linewidth": 1.3, "label": labels[1]}), run]


def _names_of(results: Results, reference: Results | None) -> tuple[str, str]:
    """Return labels of a run and its reference: file names, unless only one of them has joints."""
    kind = "with joints" if results.joints else "linear"
    if reference is None:
        return kind, ""
    if bool(results.joints) != bool(reference.joints):
        return kind, "with joints" if reference.joints else "linear"
    name, reference_name = Path(results.path).stem, Path(reference.path).stem
    return name, reference_name if reference_name != name else f"{reference_name}, reference"
