# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes as figures of matplotlib: pictures side by side, axes, names, colour bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.postprocessing.rendering import Camera, Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

Floats = NDArray[np.floating[Any]]


def draw(scene: Scene, cameras: Sequence[Camera]) -> tuple[Figure, list[Axes]]:
    """Make a figure with a picture from each camera, side by side to the same scale.

    Returns:
        The figure and the axes of its pictures, in metres across and up each picture.
    """
    from matplotlib.figure import Figure

    extents = [scene.extent(camera) for camera in cameras]
    widths = [right - left for left, right, _, _ in extents]
    height = max(top - bottom for _, _, bottom, top in extents)
    inches = 6.3 if len(cameras) == 1 else 3.6 * len(cameras)
    shape = (inches, 0.7 + 0.85 * inches * height / sum(widths))
    figure = Figure(figsize=shape, layout="compressed")
    axes = list(figure.subplots(1, len(cameras), width_ratios=widths, squeeze=False)[0])
    for ax, camera, extent in zip(axes, cameras, extents, strict=True):
        ax.imshow(scene.render(camera), extent=extent, interpolation="antialiased")
        ax.set_axis_off()
        _triad(ax, camera, extent)
    return figure, axes


def _triad(ax: Axes, camera: Camera, extent: tuple[float, float, float, float]) -> None:
    """Draw the axes below the left corner of the picture, all of the same round length."""
    left, right, bottom, top = extent
    arrow = {"arrowstyle": "-|>", "facecolor": "black", "shrinkA": 0, "shrinkB": 0}
    small: dict[str, Any] = {"fontsize": "small"}
    length = round_down(0.12 * max(right - left, top - bottom))
    ends = camera.project(length * np.eye(3))
    start = np.array([left, bottom]) - np.minimum(ends.min(axis=0), 0.0)
    start[1] -= 0.5 * length
    for name, end in zip("xyz", ends, strict=True):
        if np.linalg.norm(end) < 0.1 * length:
            continue
        tip, beyond = start + end, start + end + 0.3 * length * end / np.linalg.norm(end)
        ax.annotate("", _pair(tip), _pair(start), arrowprops=arrow, annotation_clip=False)
        ax.text(beyond[0], beyond[1], name, ha="center", va="center", fontstyle="italic", **small)
    corner = (start[0] + max(float(ends[:, 0].max()), 0.3 * length), start[1])
    offset: dict[str, Any] = {"xytext": (20, 0), "textcoords": "offset points", "va": "center"}
    ax.annotate(f"axes: {length:g} m", corner, **small, **offset)
    ax.set_ylim(min(bottom, float((start + ends.min(axis=0))[1]) - 0.4 * length), top)


def write(ax: Axes, place: Floats, text: str, colour: str) -> None:
    """Write a word above a place of the picture, readable on anything."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.0, foreground="white")]
    style: dict[str, Any] = {"fontsize": "small", "ha": "center", "va": "bottom"}
    offset: dict[str, Any] = {"xytext": (0, 3), "textcoords": "offset points"}
    ax.annotate(text, _pair(place), color=colour, path_effects=halo, **style, **offset)


def colour_bar(
    figure: Figure, axes: Sequence[Axes], cmap: Colormap, limits: tuple[float, float], label: str
) -> None:
    """Explain colours by a bar to the right of the pictures."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    shown = ScalarMappable(Normalize(*limits), cmap)
    bar = figure.colorbar(shown, ax=list(axes), shrink=0.8, aspect=25, pad=0.02)
    bar.set_label(label)


def legend(ax: Axes, colours: Mapping[str, str]) -> None:
    """Explain plain colours, given by what they mean."""
    from matplotlib.patches import Patch

    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    place: dict[str, Any] = {"loc": "lower right", "ncols": len(handles), "borderaxespad": 0.0}
    ax.legend(handles=handles, frameon=False, fontsize="small", **place)


def _pair(place: Floats) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def round_down(wanted: float) -> float:
    """Largest of 1, 2 and 5 times powers of ten that is not above a number."""
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted))


def round_scale(nodes: Floats, largest: float) -> float:
    """A round factor by which the largest displacement becomes some 6 % of the body's size.

    Args:
        nodes: of the body, shape (n, 3), [m].
        largest: displacement [m].
    """
    size = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    return 1.0 if largest == 0.0 else round_down(0.06 * size / largest)
