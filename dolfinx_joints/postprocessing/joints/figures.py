# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of all joints of a run: maps, histories, and values along the joints of a plane model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.axes import decorate, legend, new_figure
from dolfinx_joints.postprocessing.joints.extremes import drawn_series, joint_extremes
from dolfinx_joints.postprocessing.joints.surface import (
    MAP_LABELS,
    STATES,
    JointSurface,
    MapQuantity,
    is_plane,
    map_colours,
    map_limits,
    map_value,
    state_of_map,
)
from dolfinx_joints.postprocessing.palette import BLUE, GREY, OPEN, TIED, signed_colours
from dolfinx_joints.results.arguments import check_results, chosen_state
from dolfinx_joints.results.joint_points import since
from dolfinx_joints.results.quantities import JOINT_SERIES
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    JointQuantity = str
else:
    JointQuantity = Literal[tuple(row.key for row in JOINT_SERIES)]

_COLUMNS = 4  # of `joint_panels`
PROFILES: tuple[MapQuantity, ...] = ("normal", "tangential", "opening", "slip")

# Dimensions of the figure of maps [inch], and the largest number of upright joints in a row.
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


def signed_point_maps(parts: Mapping[str, Sequence[Floats]], title: str, unit: str) -> Figure:
    """Draw signed values at joint points as discs of their areas, one panel per joint.

    ``parts`` are, by joint, the areas, shape (n,), [m^2], values, (n,), coordinates, (n, 3), [m],
    and frames of the points, (n, 3, 3).
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import Normalize

    largest = max(float(np.abs(part[1]).max()) for part in parts.values()) or 1.0
    colours = ScalarMappable(Normalize(-largest, largest), signed_colours((-largest, largest)))
    rows = -(-len(parts) // _IN_A_ROW)
    columns = -(-len(parts) // rows)
    figure = new_figure(layout="compressed")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, (joint, (areas, values, points, frames)) in zip(panels, parts.items(), strict=False):
        axes = np.einsum("n,nij->ij", areas, frames)[1:]
        places = points @ (axes / np.linalg.norm(axes, axis=1, keepdims=True)).T
        places, size = places - [places[:, 0].min(), 0.0], np.sqrt(areas)
        style: dict[str, Any] = {"array": values, "cmap": colours.cmap, "norm": colours.norm}
        style |= {"units": "xy", "offsets": places, "offset_transform": ax.transData}
        ax.add_collection(EllipseCollection(size, size, [0.0], edgecolor=GREY, lw=0.3, **style))
        ax.update_datalim(np.vstack([places - 0.5 * size[:, None], places + 0.5 * size[:, None]]))
        ax.set(aspect="equal", title=joint)
        decorate(ax, "s1 [m]", "s2 [m]", grid=False)
        ax.label_outer()
    for ax in panels[len(parts) :]:
        ax.set_visible(False)
    ax.autoscale_view()  # of all panels
    ratio = np.ptp(ax.get_ylim()) / np.ptp(ax.get_xlim())
    width = min(2.8 / ratio, (_WIDTH - 1.5) / columns - 0.2)
    figure.set_size_inches(
        max(5.0, columns * (width + 0.2) + 1.5), rows * (width * ratio + 0.4) + 0.9
    )
    figure.colorbar(colours, ax=panels, label=f"[{unit}]")
    figure.suptitle(title, x=0.01, ha="left", fontsize="medium")
    return figure
