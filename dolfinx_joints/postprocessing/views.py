# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures in space from a results file: mesh, deformed shape, maps on joints, stress envelopes.

Every function returns a figure of matplotlib, for ``plots.save``. Bodies are drawn off screen by
VTK without perspective; no screen is needed. The eye stands at an azimuth from downstream (x)
towards y (left bank), one for each picture, and an elevation above the horizon. The arrows in a
corner are the axes, to the scale of the picture. Of the states that is drawn which is nearest to
``time`` [s] or, without it, has the number ``index``, or the static ``stage`` of a name or number.
Tractions and stresses are positive where they pull, and drawn in red there, in blue where they
press.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.postprocessing.envelopes import EnvelopeName
from dolfinx_joints.postprocessing.frames import nodal_displacement
from dolfinx_joints.postprocessing.joints.surface import (
    MAP_LABELS,
    STATES,
    JointSurface,
    MapQuantity,
    map_colours,
    map_limits,
    map_value,
)
from dolfinx_joints.postprocessing.palette import (
    CONCRETE,
    OPEN,
    RED,
    colour_limits,
    colours,
    signed_colours,
)
from dolfinx_joints.postprocessing.rendering import (
    Camera,
    Scene,
    colour_bar,
    contour_levels,
    draw,
    legend,
    round_scale,
    write_names,
)
from dolfinx_joints.results.arguments import check_results, chosen_state, rows_of_groups
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Azimuths = Annotated[Sequence[float], at.Len(1, 8), at.Unit("degrees")]  # a picture each
Elevation = Annotated[float, at.Interval(ge=-90.0, le=90.0), at.Unit("degrees")]

_LINE = "#4d4d4d"
_MESH: dict[str, Any] = {"show_edges": True, "edge_color": "#8c8c8c", "edge_opacity": 0.35}
_OUTLINE: dict[str, Any] = {"color": "#737373", "line_width": 3.0}
UPSTREAM, DOWNSTREAM = 160.0, -25.0  # azimuths of the eye


@checked
def mesh(
    results: Results,
    *,
    azimuths_deg: Azimuths = (UPSTREAM, DOWNSTREAM),
    elevation_deg: Elevation = 24.0,
) -> Figure:
    """Finite-element mesh with the outlines of its joints, named by their distinct parts."""
    nodes, surface = _boundary(results)
    cameras = [Camera(azimuth, elevation_deg) for azimuth in azimuths_deg]
    scene, names = Scene(), _short_names(results.joints)
    shade: dict[str, Any] = {
        "ambient": 0.45,
        "diffuse": 0.6,
        "show_edges": True,
        "edge_color": _LINE,
    }
    scene.surface(nodes, surface, color=CONCRETE, line_width=2.0, **shade)
    points = {}
    for joint in results.joints:
        points[joint], faces = _separate(JointSurface(results, joint).corners)
        radius = 2.5e-3 * _size(nodes)
        scene.edges(points[joint], faces, sharper_than_deg=None, radius=radius, color=RED)
    figure, axes = draw(scene, cameras)
    for ax, camera in zip(axes, cameras, strict=True):
        tops = {name: _top(points[joint], camera) for joint, name in names.items()}
        write_names(ax, tops, RED)
    count = f"{len(surface)} facets on the boundary, {len(nodes)} nodes"
    if "cells" in results.metadata:
        count = f"{results.metadata['cells']} cells, {len(nodes)} nodes"
    title = f"finite-element mesh: {count}, {len(results.joints)} joints"
    figure.suptitle(title, fontsize="medium")
    return figure


@checked
def deformed(
    results: Results,
    *,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
    scale: float | None = None,
    relative_to: str | None = None,
    groups: Collection[str] | None = None,
    azimuths_deg: Azimuths = (DOWNSTREAM,),
    elevation_deg: Elevation = 24.0,
) -> Figure:
    """Deformed surface coloured by the size of its displacement, faces and names of joints red.

    Thin lines are the outline of the undeformed body. Displacements are multiplied by ``scale``, or
    by a round number by which the largest becomes about 6 % of the model's size. They are those
    that the file holds, of absolute ones what is left without the mean of the lowest nodes, or
    ``relative_to`` a monitor point or the ``"ground"`` (`frames`); the colour bar says which.

    Cell ``groups`` such as ``["dam"]`` fill the picture, and the rest of the body, its rock, is
    translucent.
    """
    results, number, moment = chosen_state(results, time, index, stage)
    cameras = [Camera(azimuth, elevation_deg) for azimuth in azimuths_deg]
    nodes, _ = _boundary(results)
    displacement, frame = nodal_displacement(results, number, relative_to)
    largest = float(np.linalg.norm(displacement, axis=1).max(initial=0.0))
    factor = round_scale(nodes, largest) if scale is None else scale
    shape = Deformed(results, displacement, factor, groups)
    title = f"deformed shape {moment}, displacements x {factor:g}" + _widest(results, number)
    return shape.draw(cameras, f"displacement [mm], {frame}", title)


class Deformed:
    """A body whose nodes have moved, its displacements enlarged.

    Args:
        results: The run.
        displacement: Of the nodes, shape (nodes, 3), [m].
        factor: Displacements are multiplied by it.
        groups: Cell groups that fill the picture, the rest being translucent; all unless given.

    Attributes:
        places: Where the nodes of the faces that fill the picture are, shape (n, 3), [m].
    """

    def __init__(
        self,
        results: Results,
        displacement: Floats,
        factor: float,
        groups: Collection[str] | None = None,
    ) -> None:
        """Read the boundary and the joints."""
        self._results = results
        self._nodes, self._surface = _boundary(results)
        self._moved = self._nodes + factor * displacement
        self._size = 1e3 * np.linalg.norm(displacement, axis=1)
        outer, self._joint_faces = _outer(results, self._surface), _sides(results)
        shown: Ints = np.arange(len(outer))
        if groups is not None:
            cells = results.static("mesh/cells")[rows_of_groups(results, groups)]
            shown = np.flatnonzero(np.isin(outer, cells).all(axis=1))
        self._outer_faces, self._rest = outer[shown], np.delete(outer, shown, axis=0)
        self.places: Floats = self._moved[np.unique(self._outer_faces)]

    def draw(
        self,
        cameras: Sequence[Camera],
        label: str,
        title: str,
        *,
        limits: tuple[float, float] | None = None,
        room: Floats | None = None,
    ) -> Figure:
        """A picture from each camera.

        Args:
            cameras: Where the eye is.
            label: Of the colour bar.
            title: Of the figure.
            limits: Range of the colours [mm], that of the state unless given.
            room: Points, shape (n, 3), [m], that the pictures have room for besides the body.
        """
        outer, moved = self._outer_faces, self._moved
        limits = limits or _data_limits(self._size[outer])
        scene = Scene(room)
        colour: dict[str, Any] = {"cmap": colours(), "clim": limits}
        levels = contour_levels(limits)
        scene.surface(moved, outer, nodal=self._size, **colour, **_MESH)
        scene.contours(moved, outer, self._size, levels)
        if self._joint_faces.size:
            scene.surface(moved, self._surface[self._joint_faces], color=RED, lighting=False)
        scene.edges(self._nodes, outer, **_OUTLINE)
        if len(self._rest):
            scene.surface(moved, self._rest, color=CONCRETE, opacity=0.25, framed=False)
        figure, axes = draw(scene, cameras)
        corners = {
            name: moved[self._surface[JointSurface(self._results, joint).sides()]].reshape(-1, 3)
            for joint, name in _short_names(self._results.joints).items()
        }
        for ax, camera in zip(axes, cameras, strict=True):
            write_names(ax, {name: _top(places, camera) for name, places in corners.items()}, RED)
        colour_bar(figure, axes, colours(), limits, label, levels)
        figure.suptitle(title, fontsize="medium")
        return figure


@checked
def joint_map(
    results: Results,
    quantity: MapQuantity = "normal",
    *,
    joint: str | None = None,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
    turned: bool = True,
    azimuth_deg: float = 0.0,
    elevation_deg: Elevation = 15.0,
) -> Figure:
    """Values on the joints, a patch for each joint point, inside the outline of the body.

    The joints of a dam are seen nearly from the edge wherever the eye is. So each upright joint is
    rotated about the vertical through its middle until its face is seen, upstream edge to the
    left; not with ``turned=False``. In maps of tractions and states, open points are black. The
    ratio is -|t_s|/|t_n|, the slip the tangential gap. `plots.joint_maps` has a panel for each.
    """
    camera = Camera(azimuth_deg, elevation_deg)
    results, number, moment = chosen_state(results, time, index, stage)
    nodes, surface = _boundary(results)
    joints = results.joints if joint is None else [joint]
    if not joints:
        raise ValueError(f"{results.path} has no joints to draw.")
    for name in joints:
        results.check_joint(name)
    values = {name: map_value(results, name, quantity, number) for name in joints}
    together = np.concatenate(list(values.values()))
    limits = map_limits(quantity, together)
    cmap = map_colours(quantity, limits)
    scene, tops = Scene(), {}
    scene.edges(nodes, _outer(results, surface), **_OUTLINE)
    for name, of_points in values.items():
        joint_surface = JointSurface(results, name)
        points, faces = _separate(joint_surface.patches_in_space())
        if turned:
            points = _turned(points, joint_surface.axes, camera)
        edges: dict[str, Any] = {"show_edges": True, "edge_color": "#b3b3b3"}
        scene.surface(points, faces, of_faces=of_points, clim=limits, cmap=cmap, **edges)
        tops[name] = _top(points, camera)
    figure, axes = draw(scene, [camera])
    labels = _short_names(joints)
    write_names(axes[0], {labels[name]: top for name, top in tops.items()}, "black")
    if quantity == "state":
        legend(axes[0], dict(STATES))
    else:
        if np.isnan(together).any():
            legend(axes[0], {"open": OPEN})
        colour_bar(figure, axes, cmap, limits, MAP_LABELS[quantity])
    what = "joints" if joint is None else joint
    how = "\neach upright joint rotated in its place to show its face" if turned else ""
    figure.suptitle(f"{what} {moment}{_widest(results, number)}{how}", fontsize="medium")
    return figure


@checked
def envelope(
    results: Results,
    name: EnvelopeName = "principal_max",
    *,
    azimuths_deg: Azimuths = (UPSTREAM, DOWNSTREAM),
    elevation_deg: Elevation = 24.0,
) -> Figure:
    """Envelope of a stress over the run on the boundary, seen from upstream and downstream.

    Nodes without a value, such as those of a crest for arch stresses, are grey. The run must have
    recorded the stream ``envelopes``.
    """
    cameras = [Camera(azimuth, elevation_deg) for azimuth in azimuths_deg]
    nodes, surface = _boundary(results)
    values = np.full(len(nodes), np.nan)
    values[results.static("envelopes/nodes")] = 1e-6 * results.series("envelopes", name, -1)
    low, high = _data_limits(values)
    limits = colour_limits(values)
    cmap = signed_colours(limits)
    scene = Scene()
    style: dict[str, Any] = {"cmap": cmap, "clim": limits, "nan_color": CONCRETE}
    scene.surface(nodes, surface, nodal=values, **style, **_MESH)
    levels = contour_levels(limits)
    scene.contours(nodes, surface, values, levels)
    scene.edges(nodes, _outer(results, surface), **_OUTLINE)
    figure, axes = draw(scene, cameras)
    colour_bar(figure, axes, cmap, limits, "stress [MPa], tension > 0", levels)
    stress, end = name.split("_")
    what = f"{'largest' if end == 'max' else 'smallest'} {stress} stress"
    figure.suptitle(f"{what}: {low:.2f} to {high:.2f} MPa", fontsize="medium")
    return figure


def _boundary(results: Results) -> tuple[Floats, Ints]:
    """Nodes [m] and vertices of the boundary facets of a body in space."""
    check_results(results)
    nodes, surface = results.static("mesh/nodes"), results.static("mesh/surface")
    if surface.shape[1] < 3:
        raise ValueError(
            f"Pictures in space need a body in space; that of {results.path} is plane."
        )
    return nodes, surface


def _sides(results: Results) -> Ints:
    """Numbers of the boundary facets on both sides of the joints."""
    sides = [JointSurface(results, joint).sides() for joint in results.joints]
    return np.unique(np.concatenate(sides)) if sides else np.empty(0, dtype=np.int64)


def _outer(results: Results, surface: Ints) -> Ints:
    """Vertices of the boundary facets of no joint."""
    outer: Ints = np.delete(surface, _sides(results), axis=0)
    return outer


def _turned(points: Floats, axes: Floats, camera: Camera) -> Floats:
    """Points of a joint turned about the vertical through their middle until it faces the eye.

    A joint whose second axis is not upright stays as it is.
    """
    if axes[1, 2] < 0.7:
        return points
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    old, new = axes[0, :2], camera.right[:2]
    cosine, sine = old @ new, old[0] * new[1] - old[1] * new[0]
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    turned: Floats = (points - middle) @ rotation.T + middle
    return turned


def _top(points: Floats, camera: Camera) -> Floats:
    """The rightmost of the highest points, in the picture."""
    size = _size(points)
    highest = camera.project(points[points[:, 2] >= points[:, 2].max() - 0.01 * size])
    top: Floats = highest[np.argmax(highest[:, 0])]
    return top


def _separate(polygons: Sequence[Floats] | Floats) -> tuple[Floats, list[Ints]]:
    """Points of polygons one after the other, and the numbers of each polygon's points."""
    lengths = [len(polygon) for polygon in polygons]
    return np.concatenate(list(polygons)), np.split(
        np.arange(sum(lengths)), np.cumsum(lengths)[:-1]
    )


def _size(nodes: Floats) -> float:
    """Diagonal of the box around the body [m]."""
    return float(np.linalg.norm(np.ptp(nodes, axis=0)))


def _data_limits(values: Floats) -> tuple[float, float]:
    """Range of the values that are not NaN, widened where it is a point."""
    known = values[np.isfinite(values)]
    if not known.size:
        raise ValueError("There is nothing to draw: all values are missing.")
    low, high = float(known.min()), float(known.max())
    return (low, high) if high > low else (low, low + 1.0)


def _short_names(joints: Sequence[str]) -> dict[str, str]:
    """Names without what all of them begin with."""
    if len(joints) < 2:
        return {joint: joint for joint in joints}
    start = 0
    while len({joint[: start + 1] for joint in joints}) == 1:
        start += 1
    return {joint: joint[start:] or joint for joint in joints}


def _widest(results: Results, number: int) -> str:
    """Which joint is open most at a record, to go on in a title."""
    widest = {
        joint: 1e3 * results.series("states", f"joints/{joint}/gap", number)[:, 0].max(initial=0.0)
        for joint in results.joints
    }
    if not widest:
        return ""
    joint = max(widest, key=lambda name: widest[name])
    return f"\nwidest opening {widest[joint]:.2f} mm, {joint}" if widest[joint] > 0.0 else ""
