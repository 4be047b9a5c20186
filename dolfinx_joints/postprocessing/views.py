# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of the body from a results file: mesh, deformed shape, joint maps, stress envelopes.

Every function returns a matplotlib figure, for ``plots.save``. VTK renders the bodies in parallel
projection and needs no screen. The viewpoint is given by its elevation above the horizon and an
azimuth from downstream (x) towards y (left bank); several azimuths give several pictures. Arrows in
a corner show the coordinate axes at the scale of the picture. Plane bodies are seen along z.

The state nearest to ``time`` [s] is drawn; without a time, the state number ``index`` or the static
``stage`` of this name or number (from 0). Tractions and stresses are positive in tension (red),
negative in compression (blue).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.postprocessing.body import (
    MESH,
    OUTLINE,
    Body,
    Deformed,
    data_limits,
    face_areas,
    short_names,
    top,
)
from dolfinx_joints.postprocessing.envelopes import (
    DYNAMIC_TENSILE,
    PLANE_STRESS,
    EnvelopeName,
    principal_directions,
)
from dolfinx_joints.postprocessing.frames import nodal_displacement
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
from dolfinx_joints.postprocessing.palette import (
    BLUE,
    CONCRETE,
    OPEN,
    RED,
    TIED,
    colour_limits,
    signed_colours,
)
from dolfinx_joints.postprocessing.rendering import (
    Camera,
    Scene,
    colour_bar,
    contour_levels,
    draw,
    legend,
    round_down,
    round_scale,
    write_names,
)
from dolfinx_joints.results.arguments import chosen_state
from dolfinx_joints.results.joint_points import gaps, tied_points
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Azimuths = Annotated[Sequence[float], at.Len(1, 8), at.Unit("degrees")]  # one per picture
Elevation = Annotated[float, at.Interval(ge=-90.0, le=90.0), at.Unit("degrees")]

_LINE = "#4d4d4d"
_CROSSES = 600  # largest number of crosses, approximately
_USUAL = 0.95  # share of the stresses whose lines are shorter than the mean distance of crosses
_UPRIGHT = 0.7  # a joint is upright if the vertical component of its second axis exceeds this
UPSTREAM, DOWNSTREAM = 160.0, -25.0  # azimuths of the viewpoint


@checked
def mesh(
    results: Results,
    *,
    groups: Collection[str] | None = None,
    azimuths_deg: Azimuths = (UPSTREAM, DOWNSTREAM),
    elevation_deg: Elevation = 24.0,
) -> Figure:
    """Draw the finite-element mesh with joints as lines, and their names.

    The common beginning of the joint names is omitted. Cell ``groups`` such as ``["dam"]`` are
    opaque and fill the picture; others are translucent.
    """
    body = Body(results, groups)
    style: dict[str, Any] = {"ambient": 0.45, "diffuse": 0.6}
    style |= {"edge_visibility": True, "edge_color": _LINE}
    figure, _ = _sketch(body, azimuths_deg, elevation_deg, **style)
    count = f"{len(body.nodes)} nodes"
    if "cells" in results.metadata or "mesh/cells" in results.statics:
        cells = results.metadata.get("cells") or len(results.static("mesh/cells"))
        count = f"{cells} cells, {count}"
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
    from_static: bool = False,
    groups: Collection[str] | None = None,
    azimuths_deg: Azimuths = (DOWNSTREAM,),
    elevation_deg: Elevation = 24.0,
) -> Figure:
    """Draw the deformed body, coloured by the magnitude of the displacement, with its joints.

    Thin lines are the outline of the undeformed body. Opening and slip uncover faces of joints; the
    title gives the largest of each; the slip is the tangential gap. Displacements are multiplied by
    ``scale``, by default a round number that draws the largest at about 6 % of the model's size.

    Displacements are measured from the unloaded body, so that open joints are drawn open. With
    ``from_static`` they are measured from the static state, and joints show the change of their
    opening since then. If the file has absolute displacements, the mean of the lowest nodes is
    subtracted. ``relative_to`` subtracts the displacement of a monitor point or of
    the ``"ground"`` instead (`frames`). The colour bar names zero and reference.

    Cell ``groups`` such as ``["dam"]`` are opaque and fill the picture; others are translucent.
    """
    chosen, number, moment = chosen_state(results, time, index, stage)
    from_static, results = from_static and chosen is results, chosen
    body = Body(results, groups)
    cameras = body.cameras(azimuths_deg, elevation_deg)
    displacement, frame = nodal_displacement(results, number, relative_to, from_static=from_static)
    largest = float(np.linalg.norm(displacement[body.seen], axis=1).max(initial=0.0))
    factor = round_scale(body.nodes[body.seen], largest) if scale is None else scale
    shape = Deformed(body, displacement, factor)
    lines = _largest(results, number, slip=True)
    title = f"deformed shape {moment}, displacements x {factor:g}{lines}"
    return shape.draw(cameras, frame, title)


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
    groups: Collection[str] | None = None,
    azimuth_deg: float = 0.0,
    elevation_deg: Elevation = 15.0,
) -> Figure:
    """Draw values on the joints, one patch per joint point, within the outline of the body.

    With cell ``groups`` such as ``["dam"]``, only their outline is drawn.

    From any viewpoint most joints of a dam are seen nearly edge-on. Therefore each upright joint is
    rotated about the vertical through its middle until it faces the viewer, upstream edge to the
    left; ``turned=False`` disables this. In maps of tractions and states, open points are grey.
    Tied points, at the end of a joint inside a body, are grey in every map. The mobilised friction
    is 1 at sliding points, the slip is the tangential gap. Quantities ``largest_...`` are the
    largest values of each point over all steps. `plots.joint_maps` draws one panel per joint.
    """
    camera = Camera(azimuth_deg, elevation_deg)
    results, number, moment = state_of_map(results, quantity, time, index, stage)
    body = Body(results, groups)
    joints = results.joints if joint is None else [joint]
    if not joints:
        raise ValueError(f"{results.path} has no joints to draw.")
    for name in joints:
        results.check_joint(name)
    values = {name: map_value(results, name, quantity, number) for name in joints}
    all_values = np.concatenate(list(values.values()))
    tied = {name: tied_points(results, name) for name in joints}
    some_tied = {"tied": TIED} if any(flags.any() for flags in tied.values()) else {}
    limits = map_limits(quantity, all_values)
    cmap = map_colours(quantity, limits)
    scene, tops, note = Scene(), {}, ""
    scene.edges(body.nodes, body.shown, **OUTLINE)
    for name, of_points in values.items():
        joint_surface = JointSurface(results, name)
        patches = joint_surface.patches_in_space()
        points, ends = np.concatenate(patches), np.cumsum([len(patch) for patch in patches])
        faces = np.split(np.arange(len(points)), ends[:-1])
        if turned and joint_surface.axes[1, 2] >= _UPRIGHT:
            points = _face_viewer(points, joint_surface.axes, camera)
            note = "\neach upright joint rotated in its place to show its face"
        edges: dict[str, Any] = {"edge_visibility": True, "edge_color": "#b3b3b3"}
        free = ~tied[name]
        by_value: dict[str, Any] = {"of_faces": of_points[free], "clim": limits, "cmap": cmap}
        plain: dict[str, Any] = {"color": TIED, "lighting": False}
        for shown, style in ((free, by_value), (tied[name], plain)):
            chosen = [face for face, is_shown in zip(faces, shown, strict=True) if is_shown]
            if chosen:
                scene.surface(points, chosen, **style, **edges)
        tops[name] = top(points, camera)
    figure, axes = draw(scene, [camera])
    labels = short_names(joints)
    black = dict.fromkeys(labels.values(), "black")
    write_names(axes[0], {labels[name]: top for name, top in tops.items()}, black)
    if quantity == "state":
        legend(axes[0], STATES | some_tied)
    else:
        some_open = np.isnan(all_values[~np.concatenate(list(tied.values()))]).any()
        if some_open or some_tied:
            legend(axes[0], ({"open": OPEN} if some_open else {}) | some_tied)
        colour_bar(figure, axes, cmap, limits, MAP_LABELS[quantity])
    subject = "joints" if joint is None else joint
    widest = _largest(results, number) if quantity == "opening" else ""
    figure.suptitle(f"{subject} {moment}{widest}{note}", fontsize="medium")
    return figure


@checked
def envelope(
    results: Results,
    name: EnvelopeName = "principal_max",
    *,
    groups: Collection[str] | None = None,
    azimuths_deg: Azimuths = (UPSTREAM, DOWNSTREAM),
    elevation_deg: Elevation = 24.0,
) -> Figure:
    """Draw the envelope of a stress over the run on the boundary, in 2-D in the whole body.

    Nodes without a value, such as crest nodes for arch stresses, are grey. The run must have
    recorded the stream ``envelopes``. Cell ``groups`` such as ``["dam"]`` are drawn opaque and fill
    the picture; colours and title refer to their values. The other cells are translucent. If the
    file has strengths, a green line is where ``principal_max`` is the dynamic tensile strength.
    """
    body = Body(results, groups)
    cameras = body.cameras(azimuths_deg, elevation_deg)
    nodes, values = body.nodes, np.full(len(body.nodes), np.nan)
    values[results.static("envelopes/nodes")] = 1e-6 * results.series("envelopes", name, -1)
    low, high = data_limits(values[body.seen])
    limits = colour_limits(values[body.seen])
    cmap = signed_colours(limits)
    scene = Scene()
    style: dict[str, Any] = {"cmap": cmap, "clim": limits, "nan_color": CONCRETE}
    scene.surface(nodes, body.shown, nodal=values, **style, **MESH)
    levels = contour_levels(limits)
    scene.contours(nodes, body.shown, values, levels)
    line = ""
    if name == "principal_max" and DYNAMIC_TENSILE in results.statics:
        strength = np.full(len(nodes), np.inf)
        strength[results.static("envelopes/nodes")] = 1e-6 * results.static(DYNAMIC_TENSILE)
        strength[np.isinf(strength)] = np.nan
        scene.contours(nodes, body.shown, values / strength, [1.0], color="#1b7837", line_width=8.0)
        ends = [f"{end(strength[body.seen]):.3g}" for end in (np.nanmin, np.nanmax)]
        line = f"\ngreen line: dynamic tensile strength, {' to '.join(dict.fromkeys(ends))} MPa"
    scene.edges(nodes, body.shown, **OUTLINE)
    body.draw_translucent(scene, nodes)
    figure, axes = draw(scene, cameras)
    colour_bar(figure, axes, cmap, limits, "stress [MPa], tension > 0", levels)
    stress, end = name.split("_")
    where = "" if groups is None else f" of {', '.join(groups)}"
    title = f"{'largest' if end == 'max' else 'smallest'} {stress} stress{where}"
    figure.suptitle(f"{title}: {low:.2f} to {high:.2f} MPa{line}", fontsize="medium")
    return figure


@checked
def principal_stresses(
    results: Results,
    *,
    time: float | None = None,
    index: int = -1,
    stage: int | str | None = None,
    groups: Collection[str] | None = None,
) -> Figure:
    """Draw the in-plane principal stresses of a plane body as crosses.

    The lines of a cross have the principal directions and lengths proportional to the stresses:
    red in tension, blue in compression. Crosses are at vertices, in fine meshes at about 600 of
    them. The run must have ``envelopes=True``. Cell ``groups`` such as ``["dam"]`` fill the
    picture.
    """
    from matplotlib.collections import LineCollection

    results, number, moment = chosen_state(results, time, index, stage)
    body = Body(results, groups)
    if not body.plane:
        raise ValueError(f"{results.path} is a 3-D run; principal directions are drawn in 2-D.")
    recorded = results.static("envelopes/nodes")
    seen = np.isin(recorded, body.seen)
    stresses, first = principal_directions(results.series("states", PLANE_STRESS, number)[seen])
    low, high = data_limits(1e-6 * stresses)
    body.paint_joints("black")
    body.legend |= {"tension": RED, "compression": BLUE}
    figure, axes = _sketch(body, (), 0.0, lighting=False)
    places, area = body.nodes[recorded[seen], :2], face_areas(body.nodes, body.shown).sum()
    _, drawn = np.unique(np.floor(places / np.sqrt(area / _CROSSES)), axis=0, return_index=True)
    usual = 1e-6 * float(np.quantile(np.abs(stresses[:, drawn]), _USUAL)) or 1.0
    metres = round_down(np.sqrt(area / len(drawn)) / usual)  # per MPa
    for row, direction in enumerate((first, first[:, ::-1] * [-1.0, 1.0])):
        stress = stresses[row, drawn]
        half = 0.5e-6 * metres * stress[:, None] * direction[drawn]
        lines = np.stack([places[drawn] - half, places[drawn] + half], axis=1)
        colours = np.where(stress > 0.0, RED, BLUE).tolist()
        axes[0].add_collection(LineCollection(list(lines), colors=colours, linewidths=0.9))
    title = f"principal stresses {moment}: {low:.2f} to {high:.2f} MPa"
    figure.suptitle(f"{title}\nlength of lines: {metres:g} m per MPa", fontsize="medium")
    return figure


def _sketch(
    body: Body, azimuths_deg: Sequence[float], elevation_deg: float, **style: Any
) -> tuple[Figure, list[Axes]]:
    """Draw a body without values, and explain its joints."""
    nodes, cameras, scene = body.nodes, body.cameras(azimuths_deg, elevation_deg), Scene()
    scene.surface(nodes, body.shown, color=CONCRETE, **style)
    body.draw_translucent(scene, nodes)
    scene.edges(nodes, body.shown, **OUTLINE)
    body.draw_joints(scene, nodes)
    figure, axes = draw(scene, cameras)
    body.explain_joints(axes, cameras, nodes)
    return figure, axes


def _face_viewer(points: Floats, axes: Floats, camera: Camera) -> Floats:
    """Return points of a joint, rotated about the vertical until the joint faces the viewer."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    old, new = axes[0, :2], camera.right[:2]
    cosine, sine = old @ new, old[0] * new[1] - old[1] * new[0]
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return (points - middle) @ rotation.T + middle


def _largest(results: Results, number: int, *, slip: bool = False) -> str:
    """Return lines for a title: largest opening, and slip, at a record, with their joints."""
    gap = {joint: gaps(results, "states", joint, number) for joint in results.joints}
    sizes = {"widest opening": {joint: values[:, 0] for joint, values in gap.items()}}
    if slip:
        sizes["largest slip"] = {j: np.linalg.norm(v[:, 1:], axis=1) for j, v in gap.items()}
    text = ""
    for name, of_joints in sizes.items():
        size, joint = max(((v.max(initial=0.0), j) for j, v in of_joints.items()), default=(0, ""))
        value = round(1e3 * size, 4)  # [mm]; smaller values are rounding errors
        text += f"\n{name} {value:.3g} mm, {joint}" if value > 0.0 else ""
    return text
