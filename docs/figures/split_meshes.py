#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Draw split meshes with their joints pulled apart, to docs/images/split_meshes.png.

./with-dolfinx python3 docs/figures/split_meshes.py
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from dolfinx_joints.mesh.cells import CellShape, Floats, Ints
from dolfinx_joints.mesh.splitting import SplitMesh, split_cells

OUT = Path(__file__).resolve().parents[1] / "images" / "split_meshes.png"
OPENING = 0.2  # distance by which a duplicated node moves towards the middle of its cells
BODY, CUT, MINUS, PLUS = "#dfe3e8", "#f6f1e4", "#e8853a", "#3b78b5"
COPIES = {1: "white", 2: "#222222", 3: "#d81b8c", 4: "#34b35a"}
LABELS = {1: "front: node stays single", 2: "node made two", 3: "three (T)", 4: "four (X)"}

Surface = Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One picture: a grid, its joints, and in 3-D the cells that are hidden to show the inside.

    Attributes:
        title: Title of the picture.
        shape: Cells of the grid, ``triangle``, ``quadrilateral``, ``tetrahedron``, ``hexahedron``.
        divisions: Cells along each axis; the grid is centred on the origin, cells have size 1.
        joints: Surfaces of each joint: functions that are true for vertices (n, gdim) on the
            surface.
        round: Whether squares about the origin become circles.
        hidden: Function that is true for cells, given by their centres (n, 3), that are not drawn.
        view: Elevation and azimuth [degrees].
    """

    title: str
    shape: str
    divisions: tuple[int, ...]
    joints: list[list[Surface]]
    round: bool = False
    hidden: Surface | None = None
    view: tuple[float, float] = (24.0, -55.0)


def plane(axis: int, value: float, *limits: tuple[int, float, float]) -> Surface:
    """Return the plane of one value of a coordinate, within limits (axis, lowest, highest)."""

    def on(x: Floats) -> Floats:
        inside = np.abs(x[:, axis] - value) < 1e-9
        for k, low, high in limits:
            inside &= (x[:, k] > low - 1e-9) & (x[:, k] < high + 1e-9)
        return inside

    return on


def ring(radius: float) -> list[Surface]:
    """Return the four sides of a square about the origin, which `Panel.round` makes a circle."""
    return [
        plane(axis, side * radius, (1 - axis, -radius, radius))
        for axis in range(2)
        for side in (-1, 1)
    ]


def perimeter(up: int) -> list[Surface]:
    """Return a U with its bottom at -1 along the axis ``up`` and its arms at x = -2 and 2."""
    arms = [plane(0, side, (up, -1, 9)) for side in (-2, 2)]
    return [plane(up, -1, (0, -2, 2)), *arms]


def ribs(up: int) -> list[list[Surface]]:
    """Return three joints that end on the bottom of the U."""
    return [[plane(0, place, (up, -1, 9))] for place in (-1, 0, 1)]


PANELS = [
    Panel(
        title="ends inside the body",
        shape="triangle",
        divisions=(6, 6),
        joints=[[plane(0, 0, (1, -1, 9))]],
    ),
    Panel(
        title="T",
        shape="quadrilateral",
        divisions=(6, 6),
        joints=[[plane(1, 0)], [plane(0, 0, (1, 0, 9))]],
    ),
    Panel(
        title="X, one arm ends inside",
        shape="triangle",
        divisions=(6, 6),
        joints=[[plane(0, 0)], [plane(1, 0, (0, -9, 2))]],
    ),
    Panel(
        title="three joints on a perimetral one",
        shape="quadrilateral",
        divisions=(6, 6),
        joints=[perimeter(1), *ribs(1)],
    ),
    Panel(
        title="closed (annular)",
        shape="triangle",
        divisions=(8, 8),
        joints=[ring(2)],
        round=True,
    ),
    Panel(
        title="ends inside the body",
        shape="hexahedron",
        divisions=(4, 4, 4),
        joints=[[plane(0, 0, (2, 0, 9))]],
    ),
    Panel(
        title="T",
        shape="tetrahedron",
        divisions=(4, 4, 4),
        joints=[[plane(2, 0)], [plane(0, 0, (2, 0, 9))]],
    ),
    Panel(
        title="three planes",
        shape="hexahedron",
        divisions=(4, 4, 4),
        joints=[[plane(axis, 0)] for axis in range(3)],
        hidden=lambda x: (x[:, 0] > 0) & (x[:, 1] < 0) & (x[:, 2] > 0),
    ),
    Panel(
        title="three joints on a perimetral one",
        shape="tetrahedron",
        divisions=(6, 2, 4),
        joints=[perimeter(2), *ribs(2)],
    ),
    Panel(
        title="closed, cut open",
        shape="hexahedron",
        divisions=(8, 8, 3),
        joints=[ring(2)],
        round=True,
        hidden=lambda x: (x[:, 0] > 0) & (x[:, 1] < 0),
    ),
]


def grid(shape: CellShape, divisions: tuple[int, ...]) -> tuple[Ints, Floats]:
    """Return cells and vertices of a grid about the origin; Kuhn's simplices cut each unit cell."""
    dim = shape.dim
    if shape.name in ("quadrilateral", "hexahedron"):
        corners = [[c[::-1] for c in itertools.product((0, 1), repeat=dim)]]
    else:
        steps = [np.eye(dim, dtype=int)[list(axes)] for axes in itertools.permutations(range(dim))]
        corners = [np.vstack([np.zeros((1, dim), dtype=int), s.cumsum(axis=0)]) for s in steps]
    origins = np.array(list(itertools.product(*(range(n) for n in divisions))))
    vertices = origins[:, None, None, :] + np.array(corners)[None]
    x, cells = np.unique(vertices.reshape(-1, dim), axis=0, return_inverse=True)
    cells = cells.reshape(-1, vertices.shape[2])
    return cells.astype(np.int64), x - 0.5 * np.array(divisions)


def interior_facets(shape: CellShape, cells: Ints) -> Ints:
    """Return the vertices of interior facets, shape (n, vertices per facet)."""
    facets = np.sort(cells[:, shape.facet_vertices], axis=2)
    facets, count = np.unique(facets.reshape(-1, facets.shape[2]), axis=0, return_counts=True)
    return facets[count == 2]


def rounded(x: Floats) -> Floats:
    """Turn squares about the origin of the first two axes into circles."""
    longest, length = np.abs(x[:, :2]).max(axis=1), np.linalg.norm(x[:, :2], axis=1)
    y = x.copy()
    y[:, :2] *= (longest / np.where(length > 0, length, 1.0))[:, None]
    return y


def pulled_apart(split: SplitMesh, x: Floats) -> tuple[Floats, Ints]:
    """Move duplicated nodes into their cells; return coordinates and number of copies of nodes."""
    x = x[split.parent]
    copies = np.bincount(split.parent)[split.parent]
    middle = x[split.cells].mean(axis=1)
    size = split.cells.shape[1]
    number = np.bincount(split.cells.ravel())
    own = np.column_stack(
        [np.bincount(split.cells.ravel(), np.repeat(m, size)) / number for m in middle.T]
    )
    shift = own - x
    split_up = copies > 1
    shift[~split_up] = 0.0
    shift[split_up] *= OPENING / np.linalg.norm(shift[split_up], axis=1, keepdims=True)
    return x + shift, copies


def outer_faces(shape: CellShape, split: SplitMesh, shown: Ints) -> tuple[Ints, list[str]]:
    """Return the outer faces of the shown cells, in cyclic vertex order, and their colours."""
    slots = np.array(list(itertools.product(shown, range(len(shape.facet_vertices)))))
    faces = split.cells[slots[:, :1], shape.facet_vertices[slots[:, 1]]]
    every = np.sort(split.cells[:, shape.facet_vertices], axis=2).reshape(-1, faces.shape[1])
    surface, count = np.unique(every, axis=0, return_counts=True)
    on_body = {tuple(f) for f in surface[count == 1].tolist()}
    _, inverse, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    once = count[inverse.ravel()] == 1
    minus, plus = ({tuple(s) for s in side.tolist()} for side in (split.minus, split.plus))
    colours = []
    for slot, face in zip(slots[once].tolist(), faces[once].tolist(), strict=True):
        if tuple(slot) in minus:
            colours.append(MINUS)
        elif tuple(slot) in plus:
            colours.append(PLUS)
        else:
            colours.append(BODY if tuple(sorted(face)) in on_body else CUT)
    return faces[once][:, shape.facet_cycle], colours


def draw(axes: Axes, panel: Panel) -> None:
    """Split the mesh of a panel and draw it."""
    shape = CellShape(name=panel.shape, degree=1)
    cells, x = grid(shape, panel.divisions)
    facets = interior_facets(shape, cells)
    joints = [
        (f"joint_{i}", facets[np.any([np.all(on(x)[facets], axis=1) for on in surfaces], axis=0)])
        for i, surfaces in enumerate(panel.joints)
    ]
    if panel.round:
        x = rounded(x)
    split = split_cells(shape, cells, x, joints)
    moved, copies = pulled_apart(split, x)
    if shape.dim == 2:
        draw_plane(axes, shape, split, moved, copies)
    else:
        draw_solid(axes, shape, split, moved, panel)
    axes.set_title(f"{panel.title}\n{panel.shape}s", fontsize=9)
    axes.set_axis_off()


def draw_plane(axes: Axes, shape: CellShape, split: SplitMesh, x: Floats, copies: Ints) -> None:
    """Draw cells, the two sides of the joints, and the nodes on the joints."""
    cycle = [0, 1, 3, 2] if shape.name == "quadrilateral" else [0, 1, 2]
    axes.add_collection(
        PolyCollection(x[split.cells][:, cycle], facecolor=BODY, edgecolor="#8a929b", lw=0.5)
    )
    on_joint = set()
    for slots, colour in ((split.minus, MINUS), (split.plus, PLUS)):
        edges = split.cells[slots[:, :1], shape.facet_vertices[slots[:, 1]]]
        on_joint |= set(edges.ravel().tolist())
        for edge in x[edges]:
            axes.plot(*edge.T, color=colour, lw=2.0, solid_capstyle="round")
    for node in on_joint:
        axes.plot(*x[node], "o", ms=4.5, mfc=COPIES[copies[node]], mec="black", mew=0.6, zorder=5)
    axes.set_aspect("equal")
    axes.autoscale_view()


def draw_solid(axes: Axes, shape: CellShape, split: SplitMesh, x: Floats, panel: Panel) -> None:
    """Draw the faces of the shown cells."""
    middle = x[split.cells].mean(axis=1)
    hidden = np.zeros(len(middle), dtype=bool) if panel.hidden is None else panel.hidden(middle)
    faces, colours = outer_faces(shape, split, np.flatnonzero(~hidden))
    axes.add_collection3d(
        Poly3DCollection(x[faces], facecolors=colours, edgecolor="#5c646d", lw=0.35)
    )
    span = np.ptp(x, axis=0)
    for set_limits, low, high in zip(
        (axes.set_xlim, axes.set_ylim, axes.set_zlim), x.min(axis=0), x.max(axis=0), strict=True
    ):
        set_limits(low, high)
    axes.set_box_aspect(span, zoom=1.06)
    axes.set_proj_type("ortho")
    axes.view_init(*panel.view)


def main() -> None:
    """Draw all panels."""
    figure = plt.figure(figsize=(13.5, 6.4))
    for number, panel in enumerate(PANELS, start=1):
        dim = len(panel.divisions)
        axes = figure.add_subplot(2, 5, number, projection="3d" if dim == 3 else None)
        draw(axes, panel)
    marks = [
        Line2D([], [], ls="", marker="o", ms=4.5, mfc=COPIES[n], mec="black", label=LABELS[n])
        for n in (1, 2, 3, 4)
    ]
    sides = [
        Line2D([], [], color=c, lw=3, label=f"{name} side")
        for c, name in ((MINUS, "−"), (PLUS, "+"))
    ]
    figure.legend(handles=marks + sides, loc="lower center", ncol=6, fontsize=9, frameon=False)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.93, bottom=0.06, wspace=0.05, hspace=0.2)
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, dpi=110)
    print(OUT)


if __name__ == "__main__":
    main()
