# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body for pictures, undeformed and deformed: the boundary of a 3-D body, the cells of a plane."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.postprocessing.joints.surface import facets_of_joint, is_plane
from dolfinx_joints.postprocessing.palette import CONCRETE, PERIMETRAL, RED, colours
from dolfinx_joints.postprocessing.rendering import (
    Camera,
    Scene,
    colour_bar,
    contour_levels,
    draw,
    legend,
    write_names,
)
from dolfinx_joints.results.arguments import check_results, rows_of_groups
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MESH: dict[str, Any] = {"edge_visibility": True, "edge_color": "#8c8c8c", "edge_opacity": 0.35}
OUTLINE: dict[str, Any] = {"color": "#737373", "line_width": 3.0}
VTK_TRIANGLES = (5, 22, 69)  # VTK's linear, quadratic and Lagrange triangle
_JOINT_LINE = 5.0  # width of the lines of joints


class Body:
    """Drawn faces of a body: an opaque part that fills the picture, and a translucent part.

    They are the boundary facets of a 3-D body, and the cells of a plane body. A joint with one side
    in the groups is perimetral: its facets in the groups are drawn like the boundary.

    Args:
        results: The run.
        groups: Cell groups that are opaque; the whole body by default.

    Attributes:
        nodes: Positions of all nodes, shape (n, 3), [m].
        plane: True if the body is plane.
        free: Vertices of the opaque faces outside joints.
        shown: Vertices of the opaque faces.
        translucent: Vertices of the translucent faces.
        seen: Node numbers of the opaque cells.
        legend: Colours of the joints by label.
    """

    def __init__(self, results: Results, groups: Collection[str] | None = None) -> None:
        check_results(results)
        self.nodes: Floats = results.static("mesh/nodes")
        surface, self.plane = results.static("mesh/surface"), is_plane(results)
        sides = [facets_of_joint(results, joint)[1].ravel() for joint in results.joints]
        every = np.unique(np.concatenate(sides)) if sides else np.empty(0, dtype=np.int64)
        if self.plane:
            vertices = 3 if results.static("mesh/cell_kind")[0] in VTK_TRIANGLES else 4
            outer: Ints = results.static("mesh/cells")[:, :vertices]
        else:
            outer = np.delete(surface, every, axis=0)
        self.seen: Ints = np.arange(len(self.nodes))
        inside: Ints = np.arange(len(outer))
        if groups is not None:
            rows = rows_of_groups(results, groups)
            self.seen = np.unique(results.static("mesh/cells")[rows])
            inside = np.flatnonzero(np.isin(outer, self.seen).all(axis=1))
        self.free: Ints = outer[inside]
        self.shown, self.translucent = self.free, np.delete(outer, inside, axis=0)
        self.legend: dict[str, str] = {}
        self._corners: dict[str, Ints] = {}
        self._colours: dict[str, str] = {}
        self._layers: list[tuple[Ints, str]] = []
        for name, own in zip(short_names(results.joints).values(), sides, strict=True):
            faces = surface[own]
            is_seen = np.isin(faces, self.seen).all(axis=1)
            if is_seen.any():
                self._add_joint(name, faces[is_seen], perimetral=not is_seen.all())

    def _add_joint(self, name: str, faces: Ints, *, perimetral: bool) -> None:
        """Add a joint, whose facets in the groups have the given vertices."""
        label, colour = ("perimetral joints", PERIMETRAL) if perimetral else ("joints", RED)
        self.legend[label] = self._colours[name] = colour
        self._corners[name] = faces.ravel()
        lines = faces if self.plane else _common_edges(faces, self.free)
        self._layers.append((lines, colour))
        if perimetral and not self.plane:
            self.shown = np.concatenate([self.shown, faces])
        elif not self.plane:
            self._layers.append((faces, colour))  # visible if the joint is open

    def cameras(self, azimuths_deg: Sequence[float], elevation_deg: float) -> list[Camera]:
        """Return the viewpoints of pictures; a plane body is seen along z, with y upwards."""
        if self.plane:
            return [Camera(-90.0, 90.0)]
        return [Camera(azimuth, elevation_deg) for azimuth in azimuths_deg]

    def paint_joints(self, colour: str) -> None:
        """Give all joints one colour."""
        self.legend = {"joints": colour} if self._layers else {}
        self._colours = dict.fromkeys(self._colours, colour)
        self._layers = [(faces, colour) for faces, _ in self._layers]

    def draw_joints(self, scene: Scene, nodes: Floats) -> None:
        """Add the joints to a scene as lines on the opaque faces, with nodes at (n, 3) [m].

        Both sides have a line. The faces of open joints within the groups are filled.
        """
        for faces, colour in self._layers:
            scene.surface(nodes, faces, color=colour, lighting=False, line_width=_JOINT_LINE)

    def explain_joints(self, axes: Sequence[Axes], cameras: Sequence[Camera], at: Floats) -> None:
        """Write the names of the joints into pictures and a legend below the last one.

        The nodes are at positions ``at``, shape (n, 3), [m].
        """
        for ax, camera in zip(axes, cameras, strict=True):
            tops = {name: top(at[corners], camera) for name, corners in self._corners.items()}
            write_names(ax, tops, self._colours)
        if self.legend:
            legend(axes[-1], dict(sorted(self.legend.items())))

    def draw_translucent(self, scene: Scene, nodes: Floats) -> None:
        """Add the translucent facets to a scene, with all nodes at positions (n, 3) [m]."""
        if len(self.translucent):
            scene.surface(nodes, self.translucent, color=CONCRETE, opacity=0.25, framed=False)


class Deformed:
    """Body whose nodes are moved by a factor times their displacements.

    ``places`` are the positions of the nodes of the opaque facets, shape (n, 3), [m].
    """

    def __init__(self, body: Body, displacement: Floats, factor: float) -> None:
        self._body = body
        self._moved = self._body.nodes + factor * displacement
        self._size = 1e3 * np.linalg.norm(displacement, axis=1)
        self.places: Floats = self._moved[np.unique(self._body.shown)]

    def draw(
        self,
        cameras: Sequence[Camera],
        frame: str,
        title: str,
        *,
        limits: tuple[float, float] | None = None,
        room: Floats | None = None,
    ) -> Figure:
        """Draw a figure with one picture per camera.

        Args:
            cameras: Viewpoints.
            frame: Zero and reference of the displacements, in words.
            title: Title of the figure.
            limits: Range of the colours [mm]; the range of this state by default.
            room: Additional points, shape (n, 3), [m], that must be within the picture.
        """
        body, positions = self._body, self._moved
        limits = limits or data_limits(self._size[body.shown])
        scene, levels = Scene(room), contour_levels(limits)
        colour: dict[str, Any] = {"cmap": colours(), "clim": limits}
        scene.surface(positions, body.shown, nodal=self._size, **colour, **MESH)
        scene.contours(positions, body.shown, self._size, levels)
        body.draw_joints(scene, positions)
        scene.edges(body.nodes, body.shown, **OUTLINE)
        body.draw_translucent(scene, positions)
        figure, axes = draw(scene, cameras)
        body.explain_joints(axes, cameras, positions)
        label = f"displacement [mm], {frame}"
        colour_bar(figure, axes, colours(), limits, label, levels)
        figure.suptitle(title, fontsize="medium")
        return figure


def face_areas(nodes: Floats, faces: Ints) -> Floats:
    """Return the areas of triangles or plane quadrilaterals, shape (faces,), [m^2]."""
    a, b, c, d = (nodes[faces[:, column]] for column in (0, 1, 2, -1))
    return np.asarray(0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1))


def _common_edges(first: Ints, second: Ints) -> Ints:
    """Return the edges, shape (n, 2), that occur in both of two sets of faces."""
    both = []
    for faces in (first, second):
        pairs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        both.append(np.unique(np.sort(pairs, axis=1), axis=0))
    edges, count = np.unique(np.concatenate(both), axis=0, return_counts=True)
    return edges[count == 2]


def jointed_groups(results: Results) -> list[str] | None:
    """Return the cell groups that contain both faces of a joint; None without such a group.

    For a dam on rock this is the group of the dam, unless there are joints in the rock.
    """
    start = "mesh/groups/"
    names = [n.removeprefix(start) for n in results.statics if n.startswith(start)]
    surface = results.static("mesh/surface")
    faces = [surface[facets_of_joint(results, joint)[1]] for joint in results.joints]
    jointed = []
    for name in names:
        group_nodes = np.unique(results.static("mesh/cells")[results.static(start + name)])
        if any(np.isin(face, group_nodes).all() for face in faces):
            jointed.append(name)
    return jointed or None


def top(points: Floats, camera: Camera) -> Floats:
    """Return the picture coordinates of the rightmost of the highest points."""
    size = np.linalg.norm(np.ptp(points, axis=0))
    height = points[:, 2 if points[:, 2].any() else 1]  # y is upwards in plane models
    highest = camera.project(points[height >= height.max() - 0.01 * size])
    return highest[np.argmax(highest[:, 0])]


def data_limits(values: Floats) -> tuple[float, float]:
    """Return the range of the finite values; a range of zero width is widened."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        raise ValueError("There is nothing to draw: all values are missing.")
    low, high = float(finite.min()), float(finite.max())
    return (low, high) if high > low else (low, low + 1.0)


def short_names(joints: Sequence[str]) -> dict[str, str]:
    """Return the joint names without their common beginning, by full name."""
    if len(joints) < 2:
        return {joint: joint for joint in joints}
    start = 0
    while len({joint[: start + 1] for joint in joints}) == 1:
        start += 1
    return {joint: joint[start:] or joint for joint in joints}
