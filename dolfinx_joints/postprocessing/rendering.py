# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces and lines in space, drawn off screen by VTK without perspective, as figures."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.postprocessing.axes import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

Faces = Sequence[Sequence[int]] | Sequence[Ints] | Ints

_MARGIN = 0.02  # of the larger side of a picture
_DARK = "#262626"
_CONTOUR: dict[str, Any] = {"color": _DARK, "line_width": 2.5, "lighting": False, "scalars": None}
_RAISED = 4e-3  # of the larger side of a picture: lines towards the eye, out of their surface
_HIGHEST = 1.4  # height of a figure over its width
_LONGEST_LINE = 26  # of the text beside a colour bar [characters]


class Camera:
    """A direction to look from, infinitely far away.

    Args:
        azimuth_deg: Of the eye, from x (downstream) towards y.
        elevation_deg: Of the eye above the horizon, from -90 to 90.

    Attributes:
        towards: unit vector to the eye, shape (3,).
        right: unit vector to the right in the picture, shape (3,).
        up: unit vector upwards in the picture, shape (3,).
    """

    def __init__(self, azimuth_deg: float, elevation_deg: float) -> None:
        azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        self.right: Floats = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        up = np.array([0.0, 0.0, np.sin(elevation)])
        self.towards: Floats = np.asarray(np.cos(elevation) * flat + up)
        self.up: Floats = np.asarray(np.cross(self.towards, self.right))

    def project(self, points: ArrayLike) -> Floats:
        """Coordinates in the picture of points (..., 3), shape (..., 2), [m]."""
        return np.asarray(points) @ np.stack([self.right, self.up], axis=1)

    @property
    def side(self) -> str:
        """Where the eye is: x points downstream, y to the left bank."""
        x, y, z = self.towards
        if abs(z) > 0.9:
            return "above" if z > 0.0 else "below"
        if abs(x) >= abs(y):
            return "downstream" if x > 0.0 else "upstream"
        return "the left bank" if y > 0.0 else "the right bank"


class Scene:
    """Layers of surfaces and lines, rendered together.

    Args:
        room: Points, shape (n, 3), [m], that pictures have room for although nothing may be there.

    Attributes:
        layers: the layers in the order in which they were added, pairs of a ``pyvista.PolyData``
            and the options it is drawn with.
    """

    def __init__(self, room: Floats | None = None) -> None:
        self._framed = [] if room is None else [room]
        self.layers: list[tuple[Any, dict[str, Any]]] = []

    def surface(
        self,
        points: ArrayLike,
        faces: Faces,
        *,
        nodal: ArrayLike | None = None,
        of_faces: ArrayLike | None = None,
        framed: bool = True,
        **style: Any,
    ) -> None:
        """Add polygons: points (n, 3) [m], and their numbers in cyclic order.

        Values of points or of polygons are drawn in the colours ``cmap`` over the range ``clim``.
        What is not ``framed`` may reach beyond the edges of the picture.
        """
        data = polygons(points, faces)
        if framed and len(faces):
            self._framed.append(data.points[np.unique(np.concatenate(faces))])
        if nodal is not None:
            data.point_data["value"] = np.asarray(nodal)
        if of_faces is not None:
            data.cell_data["value"] = np.asarray(of_faces)
        if nodal is not None or of_faces is not None:
            # Colours without light and shade are those of the colour bar.
            style = {"scalars": "value", "lighting": False, "nan_color": "black"} | style
        self.layers.append((data, style))

    def contours(
        self, points: ArrayLike, faces: Ints, nodal: ArrayLike, levels: Sequence[float]
    ) -> None:
        """Add lines of equal value at levels, from values of points; none where one is NaN."""
        values = np.asarray(nodal)
        data = polygons(points, faces[np.isfinite(values[faces]).all(axis=1)]).triangulate()
        data.point_data["value"] = values
        lines = data.contour(list(levels), scalars="value") if levels and data.n_cells else data
        if levels and lines.n_cells:
            self.layers.append((lines, dict(_CONTOUR)))

    def edges(
        self,
        points: ArrayLike,
        faces: Faces,
        *,
        sharper_than_deg: float | None = 30.0,
        radius: float | None = None,
        **style: Any,
    ) -> None:
        """Add the outline of polygons, whose points count as one where they coincide.

        They coincide within 1e-6 of the size of all. To the outline belong edges with one polygon
        and, unless it is None, those sharper than an angle, whichever way round polygons are
        given. Tubes of a radius [m] are drawn instead of lines.
        """
        if not len(faces):
            return
        lines = (
            polygons(points, faces)
            .clean(tolerance=1e-6, absolute=False)
            .compute_normals(point_normals=False, consistent_normals=True)
            .extract_feature_edges(
                feature_angle=180.0 if sharper_than_deg is None else sharper_than_deg,
                boundary_edges=True,
                feature_edges=sharper_than_deg is not None,
                manifold_edges=False,
                non_manifold_edges=False,
            )
        )
        if lines.n_cells:
            if radius is not None:
                lines = lines.strip().tube(radius=radius)
            self.layers.append((lines, {"lighting": False} | style))
            self._framed.append(lines.points)

    def extent(self, camera: Camera) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of everything in the picture, with a margin [m]."""
        corners = np.concatenate([camera.project(points) for points in self._framed])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = _MARGIN * (float((high - low).max()) or 1.0)
        return (low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin)

    def render(self, camera: Camera, *, pixels: int = 1600) -> NDArray[np.uint8]:
        """Draw the layers on white, the longer side of so many pixels, edges as `extent` says.

        Returns:
            Red, green and blue, shape (height, width, 3), from the top left.
        """
        pyvista = load_pyvista()
        left, right, bottom, top = self.extent(camera)
        per_metre = pixels / max(right - left, top - bottom)
        size = [max(2, round((b - a) * per_metre)) for a, b in ((left, right), (bottom, top))]
        plotter = pyvista.Plotter(off_screen=True, window_size=size)
        try:
            plotter.set_background("white")
            plotter.enable_anti_aliasing("ssaa")
            raised = _RAISED * max(right - left, top - bottom) * camera.towards
            for data, style in self.layers:
                shown = data.translate(raised) if data.n_lines else data
                plotter.add_mesh(shown, show_scalar_bar=False, **style)
            depth = np.concatenate([data.points @ camera.towards for data, _ in self.layers])
            place = np.array([(left + right) / 2.0, (bottom + top) / 2.0])
            focus = place @ np.stack([camera.right, camera.up]) + depth.mean() * camera.towards
            distance = 2.0 * (float(np.ptp(depth)) + right - left + top - bottom)
            plotter.camera.focal_point = focus
            plotter.camera.position = focus + distance * camera.towards
            plotter.camera.up = camera.up
            plotter.camera.parallel_projection = True
            plotter.camera.parallel_scale = (top - bottom) / 2.0
            plotter.renderer.ResetCameraClippingRange()
            image: NDArray[np.uint8] = np.array(plotter.screenshot(return_img=True))[..., :3]
        finally:
            plotter.close()
        return image


def polygons(points: ArrayLike, faces: Faces) -> Any:
    """Polygons as a ``pyvista.PolyData``; the points are copied."""
    pyvista = load_pyvista()
    counted = [np.concatenate([[len(face)], face]) for face in faces]
    cells = np.concatenate(counted) if counted else np.empty(0, dtype=np.int64)
    return pyvista.PolyData(np.array(points, dtype=np.float64), faces=cells.astype(np.int64))


def load_pyvista() -> Any:
    """Import pyvista and see to it that it can draw without a screen.

    Raises:
        JointsError: pyvista or VTK is missing or too old, or nothing is there to draw with.
    """
    try:
        import pyvista
        import vtkmodules
    except ImportError as error:
        raise JointsError(
            f"Pictures in space need pyvista and VTK 9.5 or later ({error}); install them with "
            "pip or conda, as DOLFINx was, or set DOLFINX_JOINTS_PRIVATE=1 for ./with-dolfinx."
        ) from error
    if "DISPLAY" in os.environ or "VTK_DEFAULT_OPENGL_WINDOW" in os.environ:
        return pyvista
    version = tuple(int(part) for part in vtkmodules.__version__.split(".")[:2])
    if version < (9, 5):
        raise JointsError(
            f"Without a screen, pictures in space need VTK 9.5 or later, got {version[0]}."
            f"{version[1]}."
        )
    # VTK would end the process where it finds none of them.
    windows = {"libEGL.so.1": "vtkEGLRenderWindow", "libOSMesa.so.8": "vtkOSOpenGLRenderWindow"}
    for library, window in windows.items():
        if _is_loadable(library):
            os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window
            return pyvista
    raise JointsError(
        "Without a screen, pictures in space need the library EGL or OSMesa; on Debian install "
        "libegl1."
    )


def _is_loadable(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def draw(scene: Scene, cameras: Sequence[Camera]) -> tuple[Figure, list[Axes]]:
    """Make a figure with a picture from each camera, side by side to the same scale.

    Slender bodies leave room beside them: the figure is at most 1.4 times as high as wide.

    Returns:
        The figure and the axes of its pictures, in metres across and up each picture.
    """
    extents = [scene.extent(camera) for camera in cameras]
    widths = [right - left for left, right, _, _ in extents]
    height = max(top - bottom for _, _, bottom, top in extents)
    inches = 6.3 if len(cameras) == 1 else 3.6 * len(cameras)
    wanted = 0.7 + 0.85 * inches * height / sum(widths)
    figure = new_figure(figsize=(inches, min(wanted, _HIGHEST * inches)), layout="compressed")
    axes = list(figure.subplots(1, len(cameras), width_ratios=widths, squeeze=False)[0])
    for ax, camera, extent in zip(axes, cameras, extents, strict=True):
        ax.imshow(scene.render(camera), extent=extent, interpolation="antialiased")
        ax.set_axis_off()
        ax.set_title(f"from {camera.side}", fontsize="small", fontstyle="italic", pad=12.0)
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
    farthest = start[0] + 0.3 * length  # to the right, of arrows and letters
    for name, end in zip("xyz", ends, strict=True):
        if np.linalg.norm(end) < 0.1 * length:
            continue
        tip, beyond = start + end, start + end + 0.3 * length * end / np.linalg.norm(end)
        farthest = max(farthest, float(beyond[0]))
        ax.annotate("", _pair(tip), _pair(start), arrowprops=arrow, annotation_clip=False)
        ax.text(beyond[0], beyond[1], name, ha="center", va="center", fontstyle="italic", **small)
    offset: dict[str, Any] = {"xytext": (8, 0), "textcoords": "offset points", "va": "center"}
    offset["annotation_clip"] = False
    ax.annotate(f"axes: {length:g} m", (farthest, start[1]), **small, **offset)
    ax.set_ylim(min(bottom, float((start + ends.min(axis=0))[1]) - 0.4 * length), top)


def write_names(ax: Axes, places: Mapping[str, Floats], colour: str) -> None:
    """Write each name above its place in the picture, readable on anything, none upon another."""
    from matplotlib.patheffects import withStroke
    from matplotlib.text import Annotation

    style: dict[str, Any] = {"fontsize": "small", "ha": "center", "va": "bottom", "color": colour}
    style["path_effects"] = [withStroke(linewidth=2.0, foreground="white")]
    written: list[Annotation] = []
    for name, place in places.items():
        x, y = _pair(place)
        note = ax.annotate(name, (x, y), xytext=(0, 3), textcoords="offset points", **style)
        while any(note.get_window_extent().overlaps(w.get_window_extent()) for w in written):
            note.xyann = (0, note.xyann[1] + 4)
        written.append(note)


def colour_bar(
    figure: Figure,
    axes: Sequence[Axes],
    cmap: Colormap,
    limits: tuple[float, float],
    label: str,
    levels: Sequence[float] = (),
) -> None:
    """Explain colours by a bar to the right of the pictures, contour lines with them."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    shown = ScalarMappable(Normalize(*limits), cmap)
    bar = figure.colorbar(shown, ax=list(axes), shrink=0.9, aspect=25, pad=0.02)
    if levels:
        bar.set_ticks(list(levels))
        bar.ax.hlines(levels, 0.0, 1.0, transform=bar.ax.get_yaxis_transform(), color=_DARK)
    lines = [line for part in label.split(", ") for line in wrap(part, _LONGEST_LINE)]
    bar.set_label("\n".join(lines))


def contour_levels(limits: tuple[float, float]) -> list[float]:
    """Some round values between limits."""
    from matplotlib.ticker import MaxNLocator

    low, high = limits
    return [float(v) for v in MaxNLocator(8).tick_values(low, high) if low < v < high]


def legend(ax: Axes, colours: Mapping[str, str]) -> None:
    """Explain plain colours, given by what they mean, below the picture."""
    from matplotlib.patches import Patch

    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    place: dict[str, Any] = {"loc": "upper right", "bbox_to_anchor": (1.0, 0.0)}
    ax.legend(handles=handles, ncols=len(handles), frameon=False, fontsize="small", **place)


def _pair(place: Floats) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def round_down(wanted: float) -> float:
    """Largest of 1, 2 and 5 times powers of ten that is not above a number."""
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted))


def round_scale(nodes: Floats, largest: float) -> float:
    """A round factor by which the largest displacement becomes some 6 % of the body's size."""
    size = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    return 1.0 if largest == 0.0 else round_down(0.06 * size / largest)
