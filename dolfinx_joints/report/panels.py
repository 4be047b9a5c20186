# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves in stacked panels: data and layout for plotly, and the picture of the same data."""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Sequence
from html import escape, unescape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.postprocessing.palette import RUNS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Curve = tuple[str, ArrayLike, ArrayLike]  # name, abscissas, ordinates

_WIDTHS = (2.2, 1.2, *(1.4,) * 6)  # of lines, thick behind thin
_LINES = ("solid", "solid", "dash", "dot", "dashdot", "solid", "dash", "dot")
_SHOWN = 2  # number of runs that are visible at first
_WIDTH, _LEFT = 6.7, 0.9  # of a picture and of the space at its left [inch]
_COLUMNS = 4  # of a legend
_LABEL = 18  # letters in a line of a picture's ordinate
_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}  # matplotlib's of plotly's


def floats(values: ArrayLike) -> dict[str, str]:
    """Return an array for the page's script, in single precision."""
    return {"f4": base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()}


def integers(values: ArrayLike) -> dict[str, str]:
    """Return an array of integers for the page's script."""
    return {"i4": base64.b64encode(np.ascontiguousarray(values, dtype="<i4").tobytes()).decode()}


def panels(
    curves: Sequence[Sequence[Curve]],
    ordinates: Sequence[str],
    abscissa: str,
    *,
    limit: float | None = None,
    logarithmic: bool = False,
    shown: int = _SHOWN,
    shaded: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """Return stacked panels with a common abscissa; a curve's name determines its colour.

    ``ordinates`` and ``abscissa`` are axis titles with units, ``limit`` is the end of the abscissa,
    ``shown`` is the number of names visible at first, ``shaded`` is a range of the abscissa.
    """
    names = list(dict.fromkeys(name for panel in curves for name, _, _ in panel))
    count = len(curves)
    height = 1.0 / count
    layout: dict[str, Any] = {
        "height": 90 + 220 * count,
        "margin": {"l": 70, "r": 45, "t": 40, "b": 55},
        "modebar": {"orientation": "v"},
        "paper_bgcolor": "#fff",
        "plot_bgcolor": "#fff",
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0},
        "xaxis": {
            "title": {"text": abscissa},
            "anchor": "y" if count == 1 else f"y{count}",
            **_axis(),
        },
    }
    if limit is not None:
        layout["xaxis"]["range"] = [0.0, limit]
    if logarithmic:
        layout["xaxis"]["type"] = "log"
    if shaded is not None:
        where = {"x0": shaded[0], "x1": shaded[1], "y0": 0.0, "y1": 1.0, "yref": "paper"}
        style = {"fillcolor": "#ececec", "line": {"width": 0}, "layer": "below"}
        layout["shapes"] = [{"type": "rect", "xref": "x", **where, **style}]
    data = []
    for row, (panel, ordinate) in enumerate(zip(curves, ordinates, strict=True)):
        number = "" if row == 0 else str(row + 1)
        top = 1.0 - row * height
        layout[f"yaxis{number}"] = {
            "title": {"text": ordinate},
            "domain": [top - 0.9 * height, top],
            **_axis(),
        }
        for name, x, y in panel:
            place = names.index(name)
            data.append(_trace(name, x, y, place, f"y{number}", first=row == 0, shown=shown))
    return {"data": data, "layout": layout}


def picture(spec: dict[str, Any]) -> Figure:
    """Return a figure of the data and layout of `panels`, with the hidden curves."""
    from dolfinx_joints.postprocessing.axes import decorate, new_figure, plain_periods

    layout, lines = spec["layout"], {}
    abscissa = layout["xaxis"]
    ordinates = [axis["title"]["text"] for key, axis in layout.items() if key.startswith("yaxis")]
    names = [trace["name"] for trace in spec["data"] if trace["showlegend"]]
    # In inches; a layout engine of Matplotlib would take as long as all the rest.
    above, below, height = 0.25 + 0.2 * (len(names) // _COLUMNS), 0.5, 1.15 * len(ordinates)
    total = above + height + below
    figure = new_figure(figsize=(_WIDTH, total))
    figure.subplots_adjust(_LEFT / _WIDTH, below / total, 0.97, 1.0 - above / total, hspace=0.15)
    axes = figure.subplots(len(ordinates), sharex=True, squeeze=False)[:, 0]
    for trace in spec["data"]:
        ax, line = axes[int(trace["yaxis"][1:] or 1) - 1], trace["line"]
        style = {"color": line["color"], "linestyle": _DASHES[line["dash"]]}
        x, y = (np.frombuffer(base64.b64decode(trace[k]["f4"]), dtype="<f4") for k in "xy")
        (drawn,) = ax.plot(x, y, linewidth=0.6 * line["width"], **style)
        if trace["showlegend"]:
            lines[unescape(trace["name"]).replace("$", r"\$")] = drawn
    for number, (ax, ordinate) in enumerate(zip(axes, ordinates, strict=True), 1):
        ax.margins(x=0.0)
        decorate(ax, abscissa["title"]["text"] if ax is axes[-1] else "", ordinate)
        words, _, unit = ordinate.partition(" [")
        label = "\n".join([*textwrap.wrap(words, _LABEL), *[f"[{unit}"] * bool(unit)])
        ax.yaxis.label.set(text=label, fontsize="small")
        ax.yaxis.set_label_coords(-0.09, 0.5)
        ax.set_ylim(layout[f"yaxis{number if number > 1 else ''}"].get("range"))
        for shape in layout.get("shapes", ()):
            ax.axvspan(shape["x0"], shape["x1"], color=shape["fillcolor"], zorder=0)
    axes[-1].set(xscale=abscissa.get("type", "linear"), xlim=abscissa.get("range"))
    if "type" in abscissa:
        plain_periods(axes[-1])
        axes[-1].minorticks_off()
    style = {"ncols": _COLUMNS, "fontsize": "small", "frameon": False, "borderaxespad": 0.2}
    figure.legend(lines.values(), lines, loc="upper left", **style)
    return figure


def _trace(
    name: str, x: ArrayLike, y: ArrayLike, place: int, axis: str, *, first: bool, shown: int
) -> dict[str, Any]:
    style = {"width": _WIDTHS[place % 8], "dash": _LINES[place % 8]}
    return {
        "type": "scatter",
        "mode": "lines",
        "name": escape(name, quote=False),
        "legendgroup": name,
        "showlegend": first,
        "visible": True if place < shown else "legendonly",
        "x": floats(np.asarray(x)),
        "y": floats(np.asarray(y)),
        "xaxis": "x",
        "yaxis": axis,
        "line": {"color": RUNS[place % len(RUNS)], **style},
        "hovertemplate": "%{y:.4g}",
    }


def _axis() -> dict[str, Any]:
    return {
        "gridcolor": "#e3e3e3",
        "zerolinecolor": "#999",
        "linecolor": "#999",
        "ticks": "outside",
        "exponentformat": "power",
        "automargin": True,
    }
