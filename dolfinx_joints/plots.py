# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures from a results file: histories, Fourier amplitudes, joint tractions, energies.

Every function draws on the axes it is given, or on new ones, and returns them; nothing here uses
matplotlib's global state. Tractions keep the sign of the files: compression is negative.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.joint_surface import JointSurface
from dolfinx_joints.joint_values import (
    LABELS,
    Quantity,
    check_name,
    colour_limits,
    colours,
    record_number,
    traction_value,
    tractions,
)
from dolfinx_joints.measures import Component, displacement_history
from dolfinx_joints.results import ENERGY_TERMS, Results
from dolfinx_joints.spectra import equally_spaced, fourier_amplitude, highest_peak

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Floats = NDArray[np.floating[Any]]

BLUE, RED, GREY = "#08519c", "#b2182b", "#8c8c8c"


def new_axes(*, width: float = 6.3, height: float = 3.2) -> Axes:
    """Axes of a new figure of their own.

    Args:
        width: of the figure [inch].
        height: of the figure [inch].
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="compressed")
    ax: Axes = figure.add_subplot()
    return ax


def save(figure: Figure | SubFigure, path: str | Path, *, dpi: int = 200) -> Path:
    """Write a figure to a file whose ending says the format, and return its path.

    Args:
        figure: for example ``ax.figure``.
        path: for example ``crest.pdf``.
        dpi: dots per inch of pixel formats.
    """
    figure.figure.savefig(path, dpi=dpi)
    return Path(path)


def history(
    results: Results,
    point: int | str,
    component: Component,
    *,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] = ("with joints", "linear"),
) -> Axes:
    """Displacement of a monitor point against time [1e-3 m].

    Args:
        results: the run.
        point: name or number of the monitor point.
        component: ``"x"`` stream, ``"y"`` cross-valley or ``"z"`` up.
        ax: where to draw.
        reference: another run to draw behind it, with a monitor point of the same name.
        labels: what to call the run and the reference.
    """
    ax = new_axes() if ax is None else ax
    for run, style in runs(results, reference, labels):
        time, displacement = _history(run, point, component)
        ax.plot(time, 1e3 * displacement, **style)
    decorate(ax, "time [s]", rf"displacement {component} [$10^{{-3}}$ m]")
    ax.set_title(f"{point_name(results, point)}: displacement {component}", loc="left")
    ax.margins(x=0.0)
    if reference is not None:
        legend(ax, "above")
    return ax


def fourier(
    results: Results,
    point: int | str,
    component: Component,
    *,
    ax: Axes | None = None,
    reference: Results | None = None,
    labels: tuple[str, str] = ("with joints", "linear"),
    max_frequency: float = 15.0,
) -> Axes:
    """Fourier amplitude of a monitor point's displacement against frequency [1e-3 m s].

    The displacement at the first record, that of the static state, is taken off. Records at
    unequal steps are first interpolated to the shortest step. The legend gives the frequency of
    the highest peak.

    Args:
        results: the run.
        point: name or number of the monitor point.
        component: ``"x"`` stream, ``"y"`` cross-valley or ``"z"`` up.
        ax: where to draw.
        reference: another run to draw behind it.
        labels: what to call the run and the reference.
        max_frequency: end of the frequency axis [Hz].
    """
    ax = new_axes() if ax is None else ax
    for run, style in runs(results, reference, labels):
        dt, values = equally_spaced(*displacement_history(run, point, component))
        frequency, amplitude = fourier_amplitude(values, dt)
        shown = frequency <= max_frequency
        frequency, amplitude = frequency[shown], amplitude[shown]
        peak, _ = highest_peak(frequency, amplitude)
        if np.isfinite(peak):
            style["label"] = f"{style['label']}, peak at {peak:.2f} Hz"
        ax.plot(frequency, 1e3 * amplitude, **style)
    decorate(ax, "frequency [Hz]", rf"amplitude of {component} [$10^{{-3}}$ m s]")
    name = point_name(results, point)
    ax.set_title(f"{name}: Fourier amplitude of displacement {component}", loc="left")
    ax.set_xlim(0.0, max_frequency)
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return ax


def joint_traction(
    results: Results,
    joint: str,
    quantity: Quantity = "normal",
    *,
    time: float | None = None,
    index: int = -1,
    ax: Axes | None = None,
) -> Axes:
    """Map of the traction over a joint, one patch for each joint point, open ones black.

    A joint is drawn in its mean plane, horizontal distance (growing downstream) against
    elevation. The ratio is -|t_s|/|t_n|, which is -tan(friction angle) where the joint slides.

    Args:
        results: the run.
        joint: name of the joint.
        quantity: ``"normal"``, ``"tangential"`` or ``"ratio"``.
        time: draw the record of the stream ``states`` nearest to it [s].
        index: number of the record where no time is given.
        ax: where to draw.
    """
    from matplotlib.collections import LineCollection, PolyCollection

    check_name(quantity, "quantity", LABELS)
    ax = new_axes(width=4.6, height=5.6) if ax is None else ax
    number = record_number(results, time, index)
    surface = JointSurface(results, joint)
    traction, is_open = tractions(results, joint, number)
    values = np.where(is_open, np.nan, traction_value(traction, quantity))
    patches = PolyCollection(
        surface.patches(), array=values, cmap=colours(dark_is_low=quantity != "tangential")
    )
    patches.set(edgecolor="face", linewidth=0.3)
    patches.set_clim(*colour_limits(values))
    ax.add_collection(patches)
    ax.add_collection(LineCollection(list(surface.outlines()), colors=GREY, linewidths=0.3))
    ax.set_aspect("equal")
    ax.autoscale_view()
    decorate(ax, *surface.labels, grid=False)
    ax.set_title(f"{joint} at t = {results.time('states')[number]:.3f} s")
    colour_bar = ax.figure.colorbar(patches, ax=ax, shrink=0.85)
    colour_bar.set_label(LABELS[quantity])
    areas = results.static(f"joints/{joint}/areas")
    _open_legend(ax, float(areas[is_open].sum() / areas.sum()))
    return ax


def traction_profile(
    results: Results,
    joint: str,
    quantity: Literal["tractions", "ratio"] = "tractions",
    *,
    time: float | None = None,
    index: int = -1,
    position: float = 0.5,
    ax: Axes | None = None,
) -> Axes:
    """Tractions along the height of a joint, at a share of its width.

    Draws the joint points nearest to the line, normal and tangential traction or their ratio
    -|t_s|/|t_n|; open points are black, at zero or, as a ratio, at 1.

    Args:
        results: the run.
        joint: name of the joint.
        quantity: ``"tractions"`` or ``"ratio"``.
        time: draw the record of the stream ``states`` nearest to it [s].
        index: number of the record where no time is given.
        position: 0 at the upstream (left) edge of the joint, 1 at the other.
        ax: where to draw.
    """
    check_name(quantity, "quantity", ("tractions", "ratio"))
    if not 0.0 <= position <= 1.0:
        raise ValueError(f"position must lie within 0 to 1, got {position}.")
    ax = new_axes(width=4.6, height=4.6) if ax is None else ax
    number = record_number(results, time, index)
    surface = JointSurface(results, joint)
    chosen = surface.points_along(position)
    height = surface.points[chosen, 1]
    traction, is_open = (array[chosen] for array in tractions(results, joint, number))
    curves: tuple[tuple[Quantity, str, str], ...] = (("ratio", BLUE, "o"),)
    if quantity == "tractions":
        curves = (("normal", BLUE, "o"), ("tangential", RED, "s"))
    for name, colour, marker in curves:
        values = traction_value(traction, name)
        values[is_open] = 1.0 if name == "ratio" else 0.0
        label = LABELS[name].replace(" [MPa]", "").replace(" [-]", "")
        ax.plot(values, height, marker=marker, markersize=4, color=colour, label=label)
        ax.plot(values[is_open], height[is_open], marker, markersize=4.5, color="black")
    ax.plot([], [], "o", color="black", markersize=4.5, label="open")
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    unit = "[-], 1: open" if quantity == "ratio" else "[MPa]"
    decorate(ax, f"{'ratio' if quantity == 'ratio' else 'traction'} {unit}", surface.labels[1])
    ax.set_title(f"{joint} at t = {results.time('states')[number]:.3f} s, {position:.0%} of width")
    legend(ax, "below")
    return ax


def energies(results: Results, *, ax: Axes | None = None) -> Axes:
    """Energies of the ledger against time, with the largest error as a share in the legend."""
    ax = new_axes(height=3.6) if ax is None else ax
    time = results.time("energy")
    terms = {term: results.series("energy", term) for term in ENERGY_TERMS}
    largest = max(
        (float(np.abs(values).max(initial=0.0)) for values in terms.values()), default=0.0
    )
    factor, unit = next(((f, u) for f, u in ((1e6, "MJ"), (1e3, "kJ")) if largest >= f), (1.0, "J"))
    styles = ("-", "-", "-", "-", "--", "--", "-.", ":")
    hues = ("#4292c6", BLUE, "#41ab5d", "black", "#fd8d3c", RED, "#807dba", GREY)
    for (term, values), style, colour in zip(terms.items(), styles, hues, strict=True):
        label = term
        if term == "error" and largest > 0.0:
            label = f"error, within {np.abs(values).max() / largest:.1e} of the largest"
        ax.plot(time, values / factor, linestyle=style, color=colour, linewidth=1.2, label=label)
    decorate(ax, "time [s]", f"energy [{unit}]")
    ax.set_title("energy balance", loc="left")
    ax.margins(x=0.0)
    legend(ax, "below")
    return ax


def joint_states(results: Results, *, ax: Axes | None = None) -> Axes:
    """Shares of the joint points that are open and that slide, against time [%]."""
    ax = new_axes() if ax is None else ax
    time = results.time("histories")
    for state, colour, label in (("open", "black", "open"), ("slip", RED, "sliding")):
        share = 100.0 * results.series("histories", f"joint_{state}")
        ax.plot(time, share, color=colour, linewidth=1.0, label=label)
    decorate(ax, "time [s]", "share of joint points [%]")
    ax.set_title("state of the joints", loc="left")
    ax.set_ylim(bottom=0.0)
    ax.margins(x=0.0)
    legend(ax, "above")
    return ax


def runs(
    results: Results, reference: Results | None, labels: tuple[str, str]
) -> list[tuple[Results, dict[str, Any]]]:
    """Runs in drawing order, each with the style of its line."""
    own = (results, {"color": BLUE, "linewidth": 0.9, "label": labels[0]})
    if reference is None:
        return [own]
    return [(reference, {"color": "#f4a261", "linewidth": 1.3, "label": labels[1]}), own]


def _history(results: Results, point: int | str, component: Component) -> tuple[Floats, Floats]:
    """Times [s] and one displacement component [m] of a monitor point."""
    check_name(component, "component", ("x", "y", "z"))
    column = ("x", "y", "z").index(component)
    displacement = results.series("histories", "displacement")
    return results.time("histories"), displacement[:, results.point_index(point), column]


def point_name(results: Results, point: int | str) -> str:
    """Name of a monitor point given by its name or number."""
    return results.point_names[results.point_index(point)]


def decorate(ax: Axes, xlabel: str, ylabel: str, *, grid: bool = True) -> None:
    """Label the axes and give them the look of all figures here."""
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.title.set_fontsize("medium")
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    if grid:
        ax.grid(color="0.9", linewidth=0.6)
        ax.set_axisbelow(True)


def legend(ax: Axes, where: str = "inside") -> None:
    """A legend ``inside``, ``above`` (right) or ``below`` the axes."""
    places: dict[str, dict[str, Any]] = {
        "inside": {"framealpha": 0.85, "edgecolor": "none"},
        "above": {"frameon": False, "ncols": 2, "loc": "lower right", "bbox_to_anchor": (1, 1)},
        "below": {
            "frameon": False,
            "ncols": 2,
            "loc": "upper left",
            "bbox_to_anchor": (0.0, -0.14),
        },
    }
    ax.legend(fontsize="small", **places[where])


def _open_legend(ax: Axes, share: float) -> None:
    from matplotlib.patches import Patch

    patch = Patch(color="black", label=f"open, {share:.0%} of the area")
    place = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.12), "borderaxespad": 0.0}
    ax.legend(handles=[patch], frameon=False, fontsize="small", **place)
