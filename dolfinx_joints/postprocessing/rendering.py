# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of surfaces and lines, rendered off screen by VTK in parallel projection."""

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

_MARGIN = 0.02  # share of the larger side of a picture
_DARK = "#262626"
_CONTOUR: dict[str, Any] = {"color": _DARK, "line_width": 1.5, "lighting": False}
_RAISED = 4e-3  # offset of lines from their surface towards the eye, relative to the larger side
_HIGHEST = 1.4  # largest ratio of height to width of a figure
_LONGEST_LINE = 26  # longest line of the label of a colour bar [characters]


class Camera:
    """Direction of view, from an eye at infinite distance.

    Args:
        azimuth_deg: Azimuth of the eye, from x (downstream) towards y.
        elevation_deg: Elevation of the eye above the horizon, from -90 to 90.

    Attributes:
        towards: Unit vector to the eye, shape (3,).
        right: Unit vector to the right in the picture, shape (3,).
        up: Unit vector upwards in the picture, shape (3,).
    """

    def __init__(self, azimuth_deg: float, elevation_deg: float) -> None:
        azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        self.right: Floats = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        up = np.array([0.0, 0.0, np.sin(elevation)])
        self.towards: Floats = np.asarray(np.cos(elevation) * flat + up)
        self.up: Floats = np.asarray(np.cross(self.towards, self.right))

    def project(self, points: ArrayLike) -> Floats:
        """Return the picture coordinates of points (..., 3), shape (..., 2), [m]."""
        return np.asarray(points) @ np.stack([self.right, self.up], axis=1)

    @property
    def side(self) -> str:
        """Position of the eye in words; x points downstream, y to the left bank."""
        x, y, z = self.towards
        if abs(z) > 0.9:
            return "above" if z > 0.0 else "below"
        if abs(x) >= abs(y):
            return "downstream" if x > 0.0 else "upstream"
        return "the left bank" if y > 0.0 else "the right bank"


class Scene:
    """Layers of surfaces and lines that are rendered together.

    Args:
        room: Additional points, shape (n, 3), [m], that must be within the picture.

    Attributes:
        layers: Layers in the order of drawing, each a ``pyvista.PolyData`` with its drawing
            options.
    """

    _window: Any = None  # of all scenes

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
        """Add polygons or lines, given by points (n, 3) [m] and point numbers in cyclic order.

        Values of points or of polygons are drawn in the colours ``cmap`` for the range ``clim``.
        Polygons with ``framed=False`` may extend beyond the picture.
        """
        data = polygons(points, faces)
        if framed and len(faces):
            self._framed.append(data.points[np.unique(np.concatenate(faces))])
        if nodal is not None:
            data.point_data["value"] = np.asarray(nodal)
        if of_faces is not None:
            data.cell_data["value"] = np.asarray(of_faces)
        if nodal is not None or of_faces is not None:
            # Without lighting the colours match the colour bar.
            style = {"lighting": False} | style
        self.layers.append((data, style))

    def contours(
        self, points: ArrayLike, faces: Ints, nodal: ArrayLike, levels: list[float], **style: Any
    ) -> None:
        """Add contour lines of values of points; polygons with a NaN have no lines."""
        values = np.asarray(nodal)
        data = polygons(points, faces[np.isfinite(values[faces]).all(axis=1)]).triangulate()
        data.point_data["value"] = values
        lines = data.contour(levels, scalars="value") if levels and data.n_cells else data
        if levels and lines.n_cells:
            self.layers.append((lines, _CONTOUR | style))

    def edges(self, points: ArrayLike, faces: Faces, **style: Any) -> None:
        """Add the outline of polygons; points within 1e-6 of the total size are merged.

        The outline consists of edges with one polygon and of edges sharper than 30 degrees. The
        orientation of the polygons does not matter.
        """
        if not len(faces):
            return
        lines = (
            polygons(points, faces)
            .clean(tolerance=1e-6, absolute=False)
            .compute_normals(point_normals=False, consistent_normals=True)
            .extract_feature_edges(30.0, manifold_edges=False, non_manifold_edges=False)
        )
        if lines.n_cells:
            self.layers.append((lines, {"lighting": False} | style))
            self._framed.append(lines.points)

    @property
    def is_plane(self) -> bool:
        """True if all points are at z = 0."""
        return not any(points[:, 2].any() for points in self._framed)

    def extent(self, camera: Camera) -> tuple[float, float, float, float]:
        """Return left, right, bottom and top of the picture, with a margin [m]."""
        corners = np.concatenate([camera.project(points) for points in self._framed])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = _MARGIN * (float((high - low).max()) or 1.0)
        return (low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin)

    def render(self, camera: Camera, *, pixels: int = 1600) -> NDArray[np.uint8]:
        """Render the layers on white within `extent`; the longer side has ``pixels`` pixels.

        Returns:
            Red, green and blue, shape (height, width, 3), from the top left.
        """
        load_pyvista()
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
        from vtkmodules.vtkRenderingCore import vtkLightKit, vtkRenderer, vtkRenderWindow

        # Pixels are averaged when the figure is drawn, so take one sample of each.
        kept = Scene._window or vtkRenderWindow(off_screen_rendering=True, multi_samples=0)
        Scene._window = window = kept
        x_min, x_max, bottom, top = self.extent(camera)
        sides = (x_max - x_min, top - bottom)
        width, height = (max(2, round(side * pixels / max(sides))) for side in sides)
        renderer = vtkRenderer(background=(1.0, 1.0, 1.0))
        values: Any = vtkUnsignedCharArray()  # its type hints lack the buffer protocol
        vtkLightKit().AddLightsToRenderer(renderer)
        for data, style in self.layers:
            raised = _RAISED * max(sides) * camera.towards if data.n_lines else (0.0, 0.0, 0.0)
            renderer.AddActor(_actor(data, raised, **style))
        depth = np.concatenate([data.points @ camera.towards for data, _ in self.layers])
        place = np.array([(x_min + x_max) / 2.0, (bottom + top) / 2.0])
        focus = place @ np.stack([camera.right, camera.up]) + depth.mean() * camera.towards
        eye = renderer.GetActiveCamera()
        eye.focal_point, eye.view_up = focus, camera.up
        eye.position = focus + 2.0 * (float(np.ptp(depth)) + sum(sides)) * camera.towards
        eye.parallel_projection, eye.parallel_scale = True, (top - bottom) / 2.0
        window.SetSize(width, height)
        window.AddRenderer(renderer)
        renderer.ResetCameraClippingRange()
        window.Render()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, values, 0)
        window.RemoveRenderer(renderer)
        return np.frombuffer(values, np.uint8).reshape(height, width, 3)[::-1]


def _actor(data: Any, place: Any, cmap: Any = None, clim: Any = (0.0, 1.0), **look: Any) -> Any:
    """Return a layer for VTK, with ``look`` of a ``vtkProperty``; ``cmap`` colours its values."""
    from matplotlib.colors import to_rgb, to_rgba
    from vtkmodules.vtkCommonCore import vtkLookupTable
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    nan_color = to_rgba(look.pop("nan_color", "black"))
    mapper = vtkPolyDataMapper(scalar_visibility=cmap is not None, scalar_range=clim)
    mapper.SetInputData(data)
    mapper.InterpolateScalarsBeforeMappingOn()
    if cmap is not None:
        mapper.lookup_table = vtkLookupTable(nan_color=nan_color, number_of_table_values=256)
        for number, shade in enumerate(cmap(np.linspace(0.0, 1.0, 256))):
            mapper.lookup_table.SetTableValue(number, shade)
    actor = vtkActor(mapper=mapper, position=place)
    for name, value in look.items():
        setattr(actor.property, name, to_rgb(value) if name.endswith("color") else value)
    return actor


def polygons(points: ArrayLike, faces: Faces) -> Any:
    """Return polygons, or lines of two points, as a ``pyvista.PolyData``; points are copied."""
    pyvista = load_pyvista()
    counted = [np.concatenate([[len(face)], face]) for face in faces]
    cells = np.concatenate(counted) if counted else np.empty(0, dtype=np.int64)
    kind = "lines" if counted and len(faces[0]) == 2 else "faces"
    return pyvista.PolyData(np.array(points, dtype=np.float64), **{kind: cells.astype(np.int64)})


def load_pyvista() -> Any:
    """Import pyvista, and set VTK up for rendering without a screen if necessary.

    Raises:
        JointsError: pyvista or VTK is missing or too old, or there is no rendering library.
    """
    try:
        import pyvista
        import vtkmodules.vtkRenderingOpenGL2  # selects the kind of window
    except ImportError as error:
        raise JointsError(
            f"3-D pictures need pyvista and VTK 9.5 or later ({error}); install them in the "
            "same way as DOLFINx (pip, conda), or set DOLFINX_JOINTS_PRIVATE=1 for ./with-dolfinx."
        ) from error
    if "DISPLAY" in os.environ or "VTK_DEFAULT_OPENGL_WINDOW" in os.environ:
        return pyvista
    version = tuple(int(part) for part in vtkmodules.__version__.split(".")[:2])
    if version < (9, 5):
        raise JointsError(
            f"Without a screen, 3-D pictures need VTK 9.5 or later, got {version[0]}.{version[1]}."
        )
    # Check for a library first: without a library, VTK would abort the process.
    windows = {"libEGL.so.1": "vtkEGLRenderWindow", "libOSMesa.so.8": "vtkOSOpenGLRenderWindow"}
    for library, window in windows.items():
        if _is_loadable(library):
            os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window
            return pyvista
    raise JointsError(
        "Without a screen, 3-D pictures need the library EGL or OSMesa; on Debian install libegl1."
    )


def _is_loadable(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def draw(scene: Scene, cameras: Sequence[Camera]) -> tuple[Figure, list[Axes]]:
    """Draw a figure with one picture per camera, side by side at the same scale.

    The height of the figure is at most 1.4 times its width.

    Returns:
        The figure and the axes of its pictures, in metres to the right and upwards.
    """
    extents = [scene.extent(camera) for camera in cameras]
    widths = [x_max - x_min for x_min, x_max, _, _ in extents]
    height = max(top - bottom for _, _, bottom, top in extents)
    inches = 6.3 if len(cameras) == 1 else 3.6 * len(cameras)
    full_height = 0.7 + 0.85 * inches * height / sum(widths)
    figure = new_figure(figsize=(inches, min(full_height, _HIGHEST * inches)), layout="compressed")
    axes = list(figure.subplots(1, len(cameras), width_ratios=widths, squeeze=False)[0])
    for ax, camera, extent in zip(axes, cameras, extents, strict=True):
        ax.imshow(scene.render(camera), extent=extent, interpolation="antialiased")
        ax.set_axis_off()
        if not scene.is_plane:
            ax.set_title(f"from {camera.side}", fontsize="small", style="italic", y=1.0, pad=12.0)
        _triad(ax, camera, extent)
    return figure, axes


def _triad(ax: Axes, camera: Camera, extent: tuple[float, float, float, float]) -> None:
    """Draw the coordinate axes below the left corner of the picture, with a round length."""
    x_min, x_max, bottom, top = extent
    arrow = {"arrowstyle": "-|>", "facecolor": "black", "shrinkA": 0, "shrinkB": 0}
    small: dict[str, Any] = {"fontsize": "small"}
    length = round_down(0.12 * max(x_max - x_min, top - bottom))
    ends = camera.project(length * np.eye(3))
    start = np.array([x_min, bottom]) - np.minimum(ends.min(axis=0), 0.0)
    start[1] -= 0.5 * length
    farthest = start[0] + 0.3 * length  # rightmost end of arrows and letters
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


def write_names(ax: Axes, places: Mapping[str, Floats], colours: Mapping[str, str]) -> None:
    """Write each name in its colour above its place, with a white outline and without overlaps."""
    from matplotlib.patheffects import withStroke

    style: dict[str, Any] = {"fontsize": "small", "ha": "center", "va": "bottom"}
    style["path_effects"] = [withStroke(linewidth=2.0, foreground="white")]
    written: list[Any] = []
    for name, place in places.items():
        (x, y), style["color"] = _pair(place), colours[name]
        note = ax.annotate(name, (x, y), xytext=(0, 3), textcoords="offset points", **style)
        while any(note.get_window_extent().overlaps(other) for other in written):
            note.xyann = (0, note.xyann[1] + 4)
        written.append(note.get_window_extent())


def colour_bar(
    figure: Figure,
    axes: Sequence[Axes],
    cmap: Colormap,
    limits: tuple[float, float],
    label: str,
    levels: Sequence[float] = (),
) -> None:
    """Draw a colour bar to the right of the pictures, with lines at the contour levels."""
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
    """Return about eight round values between limits."""
    from matplotlib.ticker import MaxNLocator

    low, high = limits
    return [float(v) for v in MaxNLocator(8).tick_values(low, high) if low < v < high]


def legend(ax: Axes, colours: Mapping[str, str]) -> None:
    """Draw a legend of plain colours, given by their labels, below the picture."""
    from matplotlib.patches import Patch

    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    place: dict[str, Any] = {"loc": "upper right", "bbox_to_anchor": (1.0, 0.0)}
    ax.legend(handles=handles, ncols=len(handles), frameon=False, fontsize="small", **place)


def _pair(place: Floats) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def round_down(limit: float) -> float:
    """Return the largest number 1, 2 or 5 times a power of ten that does not exceed ``limit``."""
    power = 10.0 ** np.floor(np.log10(limit))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= limit))


def round_scale(nodes: Floats, largest: float) -> float:
    """Return a round factor that scales the largest displacement to about 6 % of the body size."""
    size = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    return 1.0 if largest == 0.0 else round_down(0.06 * size / largest)
