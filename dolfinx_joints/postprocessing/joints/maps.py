# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Maps of all joints of a run in one figure, one panel per joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.postprocessing.axes import decorate, new_figure
from dolfinx_joints.postprocessing.joints.surface import (
    MAP_LABELS,
    STATES,
    JointSurface,
    MapQuantity,
    map_colours,
    map_limits,
    map_value,
    state_of_map,
)
from dolfinx_joints.postprocessing.palette import GREY, OPEN, TIED
from dolfinx_joints.results.arguments import check_results
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure


# Dimensions of the figure [inch], and the largest number of upright joints in a row.
_WIDTH, _LEFT, _RIGHT = 8.0, 0.65, 0.1
_GAP, _TITLE, _BELOW = 0.25, 0.3, 0.7
_BAR, _HIGHEST = 0.85, 3.4
_IN_A_ROW = 6
Limits = tuple[float, float]  # of the colours

TIED_STYLE: dict[str, Any] = {"facecolor": TIED, "edgecolor": GREY, "hatch": "////", "linewidth": 0}


@checked
def joint_maps(
    results: Results,
    quantity: MapQuantity = "normal",
    *,
    joints: Sequence[str] | None = None,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
) -> Figure:
    """Draw values on joints with one colour bar, one panel per joint, one patch per joint point.

    Vertical plane joints are side by side at the same scale, upstream to the left, and share the
    elevation axis. Other joints are below; curved joints are unrolled.

    The state nearest to ``time`` [s] is drawn; without a time, the state number ``index`` or the
    static ``stage`` of this name or number (from 0). In maps of tractions open points are grey.
    The slip is the tangential gap. Tied points, at the end of a joint inside a body, are hatched.
    Quantities ``largest_...`` are the largest values of each point over all steps, without a state.
    """
    return JointMaps(results, joints).draw(quantity, time, index, stage)


class JointMaps:
    """Figure of `joint_maps`, made once for several quantities and states."""

    def __init__(self, results: Results, joints: Sequence[str] | None = None) -> None:
        check_results(results)
        names = results.joints if joints is None else list(joints)
        if not names:
            raise ValueError(f"{results.path} has no joints to draw.")
        self._results = results
        self._surfaces = {name: JointSurface(results, name) for name in names}
        self._figure, self._panels, self._bar = _layout(self._surfaces)

    def draw(
        self, quantity: MapQuantity, time: float | None, index: int = -1, stage: Any = None
    ) -> Figure:
        """Return the figure with the values of a quantity in a state, as in `joint_maps`."""
        results, number, moment = state_of_map(self._results, quantity, time, index, stage)
        values = {name: map_value(results, name, quantity, number) for name in self._surfaces}
        limits = map_limits(quantity, np.concatenate(list(values.values())))
        tied = np.concatenate([surface.tied for surface in self._surfaces.values()])
        is_open = np.isnan(np.concatenate(list(values.values()))) & ~tied
        for name, ax in self._panels.items():
            if ax.collections:
                colour = {"cmap": map_colours(quantity, limits), "clim": limits}
                ax.collections[0].set(array=values[name][~self._surfaces[name].tied], **colour)
            else:
                draw_map(ax, self._surfaces[name], values[name], quantity, limits)
                ax.set_title(name, fontsize="medium", loc="left", y=1.0)
                if self._surfaces[name].upright:
                    ax.set_xlabel("[m]")
                if not ax.yaxis.get_tick_params()["labelleft"]:
                    ax.set_ylabel("")
        place: Any = self._bar.get_position(original=True)
        self._bar.remove()
        self._bar = self._figure.add_axes(place)
        name = MAP_LABELS[quantity].split(" $")[0].split(" [")[0]
        self._figure.suptitle(f"{name} {moment}", x=0.01, ha="left", y=0.995, fontsize="large")
        some_open, some_tied = bool(is_open.any()), bool(tied.any())
        _draw_key(self._bar, quantity, limits, some_open=some_open, some_tied=some_tied)
        return self._figure


def draw_map(
    ax: Axes, surface: JointSurface, values: Floats, quantity: MapQuantity, limits: Limits
) -> PolyCollection:
    """Draw the patches of a joint's points, and the names of its ends.

    Tied points are hatched; other points with a NaN are grey.
    """
    from matplotlib.collections import LineCollection, PolyCollection

    all_patches, tied = surface.patches(), surface.tied
    free = [patch for patch, hatched in zip(all_patches, tied, strict=True) if not hatched]
    patches = PolyCollection(free, array=values[~tied], cmap=map_colours(quantity, limits))
    patches.set(edgecolor="face", linewidth=0.3)
    patches.set_clim(*limits)
    ax.add_collection(patches)
    if tied.any():
        hatched = [patch for patch, is_tied in zip(all_patches, tied, strict=True) if is_tied]
        ax.add_collection(PolyCollection(hatched, **TIED_STYLE))
    ax.add_collection(LineCollection(list(surface.outlines()), colors=GREY, linewidths=0.3))
    ax.set_aspect("equal")
    ax.autoscale_view()
    decorate(ax, *surface.labels, grid=False)
    for end, (x, y, aside, above, across) in zip(surface.ends, _ENDS, strict=True):
        style: dict[str, Any] = {"ha": across, "fontsize": "x-small", "fontstyle": "italic"}
        ax.annotate(end, (x, y), (aside, above), "axes fraction", "offset points", **style)
    return patches


# Places of the names of the ends: position in shares of the axes, offset to the right and upwards
# in points, alignment. Side names extend beyond the axes, which may be narrow.
_ENDS = (
    (0.0, 0.0, -6, -38, "left"),
    (1.0, 0.0, 6, -38, "right"),
    (0.5, 0.0, 0, -38, "center"),
    (0.5, 1.0, 0, 3, "center"),
)


def _layout(surfaces: Mapping[str, JointSurface]) -> tuple[Figure, dict[str, Axes], Axes]:
    """Return a figure, the axes of each joint, and the axes of the colour bar."""
    rows = list(_rows(surfaces))
    boxes = {name: _box(surface) for name, surface in surfaces.items()}
    heights = []
    for row in rows:
        low = min(boxes[name][1][0] for name in row)
        high = max(boxes[name][1][1] for name in row)
        width = max(x_max - x_min for x_min, x_max in (boxes[name][0] for name in row))
        room = (_WIDTH - _LEFT - _RIGHT + _GAP) / len(row) - _GAP
        heights.append((low, high, min(room / width, _HIGHEST / (high - low))))
    total = 0.3 + _BAR + sum(_TITLE + (b - a) * scale + _BELOW for a, b, scale in heights)
    figure = new_figure(figsize=(_WIDTH, total))
    panels, top = {}, total - 0.3
    for row, (low, high, scale) in zip(rows, heights, strict=True):
        height = (high - low) * scale
        bottom = top - _TITLE - height
        width = (_WIDTH - _LEFT - _RIGHT + _GAP) / len(row) - _GAP
        for column, name in enumerate(row):
            x = _LEFT + column * (width + _GAP)
            place = (x / _WIDTH, bottom / total, width / _WIDTH, height / total)
            ax = panels[name] = figure.add_axes(place)
            middle, half = 0.5 * sum(boxes[name][0]), 0.5 * width / scale
            ax.set(xlim=(middle - half, middle + half), ylim=(low, high), autoscale_on=False)
            ax.tick_params(labelleft=column == 0)
        top = bottom - _BELOW
    bar = figure.add_axes((_LEFT / _WIDTH, 0.5 / total, 0.5, 0.15 / total))
    return figure, panels, bar


def _rows(surfaces: Mapping[str, JointSurface]) -> Iterator[list[str]]:
    """Yield rows of joint names: several upright joints per row, other joints one per row."""
    upright = [name for name, surface in surfaces.items() if surface.upright]
    count = -(-len(upright) // _IN_A_ROW)
    if upright:
        yield from (list(part) for part in np.array_split(np.array(upright, dtype=object), count))
    yield from ([name] for name in surfaces if name not in upright)


def _box(surface: JointSurface) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of the two coordinates with a small margin [m]."""
    low, high = (f(surface.facets.reshape(-1, 2), axis=0) for f in (np.min, np.max))
    margin = 0.02 * float((high - low).max())
    (left, bottom), (right, top) = low - margin, high + margin
    return (float(left), float(right)), (float(bottom), float(top))


def _draw_key(
    bar: Axes, quantity: MapQuantity, limits: Limits, *, some_open: bool, some_tied: bool
) -> None:
    """Draw the colour bar or the legend of the states, with entries for open and tied points."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    plain = dict(STATES) if quantity == "state" else {"open": OPEN} if some_open else {}
    handles = [Patch(color=colour, label=label) for label, colour in plain.items()]
    handles += [Patch(label="tied", **TIED_STYLE)] if some_tied else []
    if quantity == "state":
        bar.set_axis_off()
        bar.legend(handles=handles, loc="center left", frameon=False, ncols=len(handles))
        return
    shown = ScalarMappable(Normalize(*limits), map_colours(quantity, limits))
    bar.figure.colorbar(shown, cax=bar, orientation="horizontal", label=MAP_LABELS[quantity])
    if handles:
        bar.legend(handles=handles, loc="center left", bbox_to_anchor=(1.05, 0.5), frameon=False)
