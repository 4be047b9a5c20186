# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Colours of all figures: lines, magnitudes (light to dark) and signed values (around zero)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dolfinx_joints.common.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap


BLUE, ORANGE, GREEN, RED, GREY = "#08519c", "#e69f00", "#238b45", "#b2182b", "#8c8c8c"

# Reference run, run, further runs; lightness differs too, for print and colour-blind readers.
RUNS = (ORANGE, BLUE, GREEN, RED, "#7b3294", "#56b4e9", "#8c6d00", "#444444")

PERIMETRAL = "#7b3294"  # joints of the drawn groups to others; joints within the groups are red
CONCRETE, OPEN, TIED = "#d9d5cc", "#969696", "#bdb8ac"


def colours() -> ListedColormap:
    """Return colours from nearly white to dark blue, also monotonic in grey; NaN is grey."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    chosen = ListedColormap(colormaps["GnBu"](np.linspace(0.0, 1.0, 256)))
    chosen.set_bad(OPEN)
    return chosen


def signed_colours(limits: tuple[float, float]) -> ListedColormap:
    """Return colours blue below zero, nearly white at zero, red above, as dark at -a as at a.

    Args:
        limits: Smallest and largest value, with zero between them.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    low, high = limits
    largest = max(abs(low), abs(high)) or 1.0
    places = 0.5 + 0.5 * np.linspace(low, high, 256) / largest
    chosen = ListedColormap(colormaps["RdBu_r"](places))
    chosen.set_bad(OPEN)
    return chosen


def colour_limits(values: Floats) -> tuple[float, float]:
    """Return the range of the finite values and zero."""
    closed = values[np.isfinite(values)]
    low, high = float(closed.min(initial=0.0)), float(closed.max(initial=0.0))
    return (low, high) if high > low else (-1.0, 0.0)
