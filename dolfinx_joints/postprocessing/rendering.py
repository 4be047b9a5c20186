# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces and lines in space, drawn off screen by VTK without perspective, as arrays of pixels."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_number

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Faces = Sequence[Sequence[int]] | Sequence[Ints] | Ints

_MARGIN = 0.02  # of the larger side of a picture


class Camera:
    """A direction to look from, infinitely far away.

    Args:
        azimuth_deg: of the eye, from x (downstream) towards y.
        elevation_deg: of the eye above the horizon, between -90 and 90.

    Attributes:
        towards: unit vector to the eye, shape (3,).
        right: unit vector to the right in the picture, shape (3,).
        up: unit vector upwards in the picture, shape (3,).
    """

    def __init__(self, azimuth_deg: float, elevation_deg: float) -> None:
        """Take the axes of the picture from the angles."""
        check_number("azimuth_deg", azimuth_deg, lambda v: abs(v) <= 3600.0, "an angle in degrees")
        check_number("elevation_deg", elevation_deg, lambda v: abs(v) <= 90.0, "from -90 to 90")
        azimuth_deg, elevation_deg = float(azimuth_deg), float(elevation_deg)
        azimuth, elevation = np.deg2rad([azimuth_deg, elevation_deg])
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        self.right: Floats = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        self.towards: Floats = np.cos(elevation) * flat + np.array([0.0, 0.0, np.sin(elevation)])
        self.up: Floats = np.cross(self.towards, self.right)

    def project(self, points: ArrayLike) -> Floats:
        """Coordinates in the picture of points (..., 3), shape (..., 2), [m]."""
        placed: Floats = np.asarray(points) @ np.stack([self.right, self.up], axis=1)
        return placed


class Scene:
    """Layers of surfaces and lines, rendered together.

    Attributes:
        layers: the layers in the order in which they were added, pairs of a ``pyvista.PolyData``
            and the options it is drawn with.
    """

    def __init__(self) -> None:
        """Start with nothing."""
        self.layers: list[tuple[Any, dict[str, Any]]] = []

    def surface(
        self,
        points: ArrayLike,
        faces: Faces,
        *,
        nodal: ArrayLike | None = None,
        of_faces: ArrayLike | None = None,
        **style: Any,
    ) -> None:
        """Add polygons.

        Args:
            points: shape (n, 3), [m].
            faces: numbers of the points of each polygon, in cyclic order.
            nodal: a value for each point, drawn in the colours ``cmap`` over the range ``clim``.
            of_faces: a value for each polygon, drawn likewise.
            style: options of ``pyvista.Plotter.add_mesh``.
        """
        data = polygons(points, faces)
        if nodal is not None:
            data.point_data["value"] = np.asarray(nodal)
        if of_faces is not None:
            data.cell_data["value"] = np.asarray(of_faces)
        if nodal is not None or of_faces is not None:
            # Colours without light and shade are those of the colour bar.
            style = {"scalars": "value", "lighting": False, "nan_color": "black"} | style
        self.layers.append((data, style))

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

        They coincide within 1e-6 of the size of all.

        Args:
            points: shape (n, 3), [m].
            faces: numbers of the points of each polygon, in cyclic order.
            sharper_than_deg: edges with a larger angle between their polygons belong to the
                outline, and edges with one polygon; None for the latter alone.
            radius: draw tubes of this radius [m] instead of lines.
            style: options of ``pyvista.Plotter.add_mesh``.
        """
        lines = (
            polygons(points, faces)
            .clean(tolerance=1e-6, absolute=False)
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

    def extent(self, camera: Camera) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of everything in the picture, with a margin [m]."""
        corners = np.concatenate([camera.project(data.points) for data, _ in self.layers])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = _MARGIN * max(float((high - low).max()), 1e-9)
        return (low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin)

    def render(self, camera: Camera, *, pixels: int = 1600) -> NDArray[np.uint8]:
        """Draw the layers on white.

        Args:
            camera: where to look from.
            pixels: length of the longer side.

        Returns:
            Red, green and blue, shape (height, width, 3), from the top left; it shows what
            :meth:`extent` says.
        """
        pyvista = load_pyvista()
        left, right, bottom, top = self.extent(camera)
        per_metre = pixels / max(right - left, top - bottom)
        size = [max(2, round((b - a) * per_metre)) for a, b in ((left, right), (bottom, top))]
        plotter = pyvista.Plotter(off_screen=True, window_size=size)
        try:
            plotter.set_background("white")
            plotter.enable_anti_aliasing("ssaa")
            for data, style in self.layers:
                plotter.add_mesh(data, show_scalar_bar=False, **style)
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
