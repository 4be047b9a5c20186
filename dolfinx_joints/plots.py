# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures from a results file: histories, Fourier amplitudes, joint tractions, deformed shapes.

Every function draws on the axes it is given, or on new ones, and returns them; nothing here uses
matplotlib's global state. Tractions keep the sign of the files: compression is negative.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.joint_surface import JointSurface
from dolfinx_joints.measures import Component, displacement_history, open_points
from dolfinx_joints.results import ENERGY_TERMS, Results
from dolfinx_joints.spectra import equally_spaced, fourier_amplitude

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure, SubFigure

Quantity = Literal["normal", "tangential", "ratio"]
Floats = NDArray[np.floating[Any]]

BLUE, RED, GREY = "#08519c", "#b2182b", "#8c8c8c"
_CONCRETE, _JOINT = "#d9d5cc", "#b2182b"
_LABELS = {
    "normal": r"normal traction $t_n$ [MPa], compression $< 0$",
    "tangential": r"tangential traction $|t_s|$ [MPa]",
    "ratio": r"$-|t_s|/|t_n|$ [-]",
}


def new_axes(*, width: float = 6.3, height: float = 3.2, projection: str | None = None) -> Axes:
    """Axes of a new figure of their own.

    Args:
        width: of the figure [inch].
        height: of the figure [inch].
        projection: ``"3d"`` for :func:`deformed`.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="compressed")
    ax: Axes = figure.add_subplot(projection=projection)
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
    the largest amplitude.

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
        style["label"] = f"{style['label']}, peak at {frequency[np.argmax(amplitude)]:.2f} Hz"
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

    _check(quantity, "quantity", _LABELS)
    ax = new_axes(width=4.6, height=5.6) if ax is None else ax
    number = _record(results, time, index)
    surface = JointSurface(results, joint)
    traction, is_open = _tractions(results, joint, number)
    values = np.where(is_open, np.nan, _value(traction, quantity))
    patches = PolyCollection(surface.patches(), array=values, cmap=_colours(quantity))
    patches.set(edgecolor="face", linewidth=0.3)
    patches.set_clim(*_colour_limits(values))
    ax.add_collection(patches)
    ax.add_collection(LineCollection(list(surface.outlines()), colors=GREY, linewidths=0.3))
    ax.set_aspect("equal")
    ax.autoscale_view()
    decorate(ax, *surface.labels, grid=False)
    ax.set_title(f"{joint} at t = {results.time('states')[number]:.3f} s")
    colour_bar = ax.figure.colorbar(patches, ax=ax, shrink=0.85)
    colour_bar.set_label(_LABELS[quantity])
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
    _check(quantity, "quantity", ("tractions", "ratio"))
    if not 0.0 <= position <= 1.0:
        raise ValueError(f"position must lie within 0 to 1, got {position}.")
    ax = new_axes(width=4.6, height=4.6) if ax is None else ax
    number = _record(results, time, index)
    surface = JointSurface(results, joint)
    chosen = surface.points_along(position)
    height = surface.points[chosen, 1]
    traction, is_open = (array[chosen] for array in _tractions(results, joint, number))
    curves: tuple[tuple[Quantity, str, str], ...] = (("ratio", BLUE, "o"),)
    if quantity == "tractions":
        curves = (("normal", BLUE, "o"), ("tangential", RED, "s"))
    for name, colour, marker in curves:
        values = _value(traction, name)
        values[is_open] = 1.0 if name == "ratio" else 0.0
        label = _LABELS[name].replace(" [MPa]", "").replace(" [-]", "")
        ax.plot(values, height, marker=marker, markersize=4, color=colour, label=label)
        ax.plot(values[is_open], height[is_open], marker, markersize=4.5, color="black")
    ax.plot([], [], "o", color="black", markersize=4.5, label="open")
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    unit = "[-], 1: open" if quantity == "ratio" else "[MPa]"
    decorate(ax, f"{'ratio' if quantity == 'ratio' else 'traction'} {unit}", surface.labels[1])
    ax.set_title(f"{joint} at t = {results.time('states')[number]:.3f} s, {position:.0%} of width")
    legend(ax, "below")
    return ax


def deformed(
    results: Results,
    *,
    time: float | None = None,
    index: int = -1,
    scale: float | None = None,
    elevation_deg: float = 24.0,
    azimuth_deg: float = -28.0,
    ax: Axes | None = None,
) -> Axes:
    """Deformed boundary surface in space, seen from downstream, joint faces red.

    Args:
        results: the run.
        time: draw the record of the stream ``states`` nearest to it [s].
        index: number of the record where no time is given.
        scale: factor on the displacements; by default a round one by which the largest becomes
            about 6 % of the model's size.
        elevation_deg: of the eye above the horizon.
        azimuth_deg: of the eye, from downstream (x) towards y.
        ax: where to draw; must have the projection ``"3d"``.
    """
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    space: Any = new_axes(height=4.6, projection="3d") if ax is None else ax
    if space.name != "3d":
        raise ValueError("deformed draws on axes with projection='3d', got flat ones.")
    number = _record(results, time, index)
    displacement = results.series("states", "displacement", number)
    nodes, surface = results.static("mesh/nodes"), results.static("mesh/surface")
    factor = _round_scale(nodes, displacement) if scale is None else scale
    moved = nodes + factor * displacement
    colours = np.full(len(surface), _CONCRETE, dtype=object)
    for joint in results.joints:
        colours[JointSurface(results, joint).sides()] = _JOINT
    shaded = _shaded(moved[surface], list(colours), azimuth_deg)
    faces = Poly3DCollection(moved[surface], facecolors=shaded, edgecolors="black", linewidths=0.25)
    space.add_collection3d(faces)
    low, high = moved[surface].min(axis=(0, 1)), moved[surface].max(axis=(0, 1))
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    size = high - low
    room = float(np.clip(1.1 - 0.4 * size[2] / max(size[:2]), 0.6, 1.0))  # tall bodies: smaller
    space.set_box_aspect(size, zoom=room)  # one scale for all axes
    space.view_init(elev=elevation_deg, azim=azimuth_deg)
    space.set_xlabel("x [m]")
    space.set_ylabel("y [m]", labelpad=9)
    space.set_zlabel("z [m]")
    for axis, length in zip((space.xaxis, space.yaxis, space.zaxis), size, strict=True):
        axis.set_major_locator(MaxNLocator(max(1, round(6 * length / max(size)))))
        axis.set_tick_params(labelsize="small")
    moment = results.time("states")[number]
    title = f"deformed shape at t = {moment:.3f} s, displacements x {factor:g}"
    space.set_title(title, fontsize="medium")
    flat: Axes = space
    return flat


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


def _tractions(results: Results, joint: str, number: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Tractions (n, 3) [MPa] and which points are open (positive gap, no traction)."""
    traction = 1e-6 * results.series("states", f"joints/{joint}/traction", number)
    gap = results.series("states", f"joints/{joint}/gap", number)
    return traction, open_points(gap, traction)


def _value(traction: Floats, quantity: Quantity) -> Floats:
    """Quantity of each point; the ratio is 0 where there is no normal traction."""
    normal, shear = traction[:, 0].copy(), np.hypot(traction[:, 1], traction[:, 2])
    if quantity == "ratio":
        loaded = normal != 0.0
        ratio: Floats = np.divide(shear, np.abs(normal), out=np.zeros_like(shear), where=loaded)
        return -ratio
    return normal if quantity == "normal" else shear


def _colours(quantity: Quantity) -> Colormap:
    """Light to dark as the size grows, never near black, which means open."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    shades = colormaps["YlGnBu"](np.linspace(0.05, 0.85, 256))
    colours = ListedColormap(shades if quantity == "tangential" else shades[::-1])
    colours.set_bad("black")
    return colours


def _colour_limits(values: Floats) -> tuple[float, float]:
    closed = values[np.isfinite(values)]
    low, high = float(closed.min(initial=0.0)), float(closed.max(initial=0.0))
    return (low, high) if high > low else (-1.0, 0.0)


def _shaded(polygons: Floats, colours: list[str], azimuth_deg: float) -> list[Any]:
    """Colours brightened by a light above the eye's left shoulder, both sides of a facet alike."""
    from matplotlib.colors import to_rgb

    normals = np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    azimuth = np.deg2rad(azimuth_deg - 40.0)
    light = np.array([0.75 * np.cos(azimuth), 0.75 * np.sin(azimuth), 0.66])
    brightness = 0.55 + 0.45 * np.abs(normals @ light)
    return [
        tuple(b * np.array(to_rgb(colour))) for b, colour in zip(brightness, colours, strict=True)
    ]


def _round_scale(nodes: Floats, displacement: Floats) -> float:
    """1, 2 or 5 times a power of ten, by which the largest displacement becomes visible."""
    largest = float(np.linalg.norm(displacement, axis=1).max(initial=0.0))
    if largest == 0.0:
        return 1.0
    wanted = 0.06 * float(np.linalg.norm(np.ptp(nodes, axis=0))) / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted))


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
    _check(component, "component", ("x", "y", "z"))
    column = ("x", "y", "z").index(component)
    displacement = results.series("histories", "displacement")
    return results.time("histories"), displacement[:, results.point_index(point), column]


def point_name(results: Results, point: int | str) -> str:
    """Name of a monitor point given by its name or number."""
    return results.point_names[results.point_index(point)]


def _record(results: Results, time: float | None, index: int) -> int:
    """Number of a record of the states, from 0."""
    if time is not None:
        return results.nearest("states", time)
    rows = results.rows("states")
    if not -rows <= index < rows:
        raise ValueError(f"index must be that of one of {rows} recorded states, got {index}.")
    return index % rows


def _check(value: str, name: str, allowed: Any) -> None:
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(allowed)}, got {value!r}.")


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
