# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is drawn on a joint: tractions, gaps and states of its points, with labels and colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.postprocessing.measures import open_points
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap

Quantity = Literal["normal", "tangential", "ratio"]
MapQuantity = Literal["normal", "tangential", "ratio", "opening", "slip", "state"]
Floats = NDArray[np.floating[Any]]

LABELS = {
    "normal": r"normal traction $t_n$ [MPa], compression $< 0$",
    "tangential": r"tangential traction $|t_s|$ [MPa]",
    "ratio": r"$-|t_s|/|t_n|$ [-]",
}
MAP_LABELS = LABELS | {
    "opening": "opening [mm]",
    "slip": "tangential gap [mm]",
    "state": "state of the points",
}


def tractions(results: Results, joint: str, number: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Tractions (n, 3) [MPa] and which points are open (positive gap, no traction)."""
    traction = 1e-6 * results.series("states", f"joints/{joint}/traction", number)
    gap = results.series("states", f"joints/{joint}/gap", number)
    return traction, open_points(gap, traction)


def traction_value(traction: Floats, quantity: Quantity) -> Floats:
    """Quantity of each point; the ratio is 0 where there is no normal traction."""
    normal, shear = traction[:, 0].copy(), np.hypot(traction[:, 1], traction[:, 2])
    if quantity == "ratio":
        loaded = normal != 0.0
        ratio: Floats = np.divide(shear, np.abs(normal), out=np.zeros_like(shear), where=loaded)
        return -ratio
    return normal if quantity == "normal" else shear


def map_value(results: Results, joint: str, quantity: MapQuantity, number: int) -> Floats:
    """Value of each point in the unit of its label, shape (n,).

    Tractions and their ratio are NaN where the joint is open; the state is 0 open, 1 sticking,
    2 sliding, as the file has it.
    """
    if quantity == "state":
        status: Floats = results.series("states", f"joints/{joint}/status", number).astype(float)
        return status
    if quantity == "opening" or quantity == "slip":
        gap = 1e3 * results.series("states", f"joints/{joint}/gap", number)
        opening: Floats = np.maximum(gap[:, 0], 0.0)
        return opening if quantity == "opening" else np.hypot(gap[:, 1], gap[:, 2])
    traction, is_open = tractions(results, joint, number)
    return np.where(is_open, np.nan, traction_value(traction, quantity))


def colours(*, dark_is_low: bool = False) -> ListedColormap:
    """Light to dark, also in grey, never near black, which means open.

    Args:
        dark_is_low: the small values are the dark ones, for what is largest where it is most
            negative.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    shades = colormaps["viridis"](np.linspace(0.12, 1.0, 256))
    chosen = ListedColormap(shades if dark_is_low else shades[::-1])
    chosen.set_bad("black")
    return chosen


def colour_limits(values: Floats) -> tuple[float, float]:
    """Range of the values that are not NaN, zero included."""
    closed = values[np.isfinite(values)]
    low, high = float(closed.min(initial=0.0)), float(closed.max(initial=0.0))
    return (low, high) if high > low else (-1.0, 0.0)
