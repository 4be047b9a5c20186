# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interactive plots of a report as plotly's data and layout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.report.page import floats

# The first runs differ in darkness and width as well, for print and colour-blind readers.
_LINES: tuple[dict[str, Any], ...] = (
    {"color": "#e69f00", "width": 2.2},
    {"color": "#08306b", "width": 1.2},
    {"color": "#009e73", "width": 1.4, "dash": "dash"},
    {"color": "#b2182b", "width": 1.4, "dash": "dot"},
    {"color": "#7b3294", "width": 1.4, "dash": "dashdot"},
    {"color": "#56b4e9", "width": 1.4},
    {"color": "#8c6d00", "width": 1.4, "dash": "dash"},
    {"color": "#444444", "width": 1.4, "dash": "dot"},
)
_SHOWN = 2  # runs beyond these start hidden

Curve = tuple[str, ArrayLike, ArrayLike]  # name, abscissas, ordinates


def panels(
    curves: Sequence[Sequence[Curve]],
    ordinates: Sequence[str],
    abscissa: str,
    *,
    limit: float | None = None,
    logarithmic: bool = False,
    shown: int = _SHOWN,
) -> dict[str, Any]:
    """Panels one above the other over one abscissa; a name has one colour in all of them.

    Args:
        curves: of each panel.
        ordinates: title of each panel's ordinate, with its unit.
        abscissa: title of the abscissa, with its unit.
        limit: end of the abscissa.
        logarithmic: draw the abscissa so.
        shown: how many names are visible at first.
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


def _trace(
    name: str, x: ArrayLike, y: ArrayLike, place: int, axis: str, *, first: bool, shown: int
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": _literal(name),
        "legendgroup": name,
        "showlegend": first,
        "visible": True if place < shown else "legendonly",
        "x": floats(np.asarray(x)),
        "y": floats(np.asarray(y)),
        "xaxis": "x",
        "yaxis": axis,
        "line": _LINES[place % len(_LINES)],
        "hovertemplate": "%{y:.4g}",
    }


def _literal(name: str) -> str:
    """A name whose mark-up plotly is not to read."""
    return name.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _axis() -> dict[str, Any]:
    return {
        "gridcolor": "#e3e3e3",
        "zerolinecolor": "#999",
        "linecolor": "#999",
        "ticks": "outside",
        "exponentformat": "power",
    }
