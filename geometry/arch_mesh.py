# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elevation of half an arch dam as a plane mesh, and a foundation block that follows the valley.

In the elevation (a, z) the block lies between the ground and its image, enlarged about the middle
of the crest. It consists of rings that are enlarged step by step, so that cells grow outwards and
never fold.

In 3-D the valley continues straight upstream and downstream of the dam. In planes x = constant the
rings move from the ground to an outline at the distance ``depth`` from the rectangle of the dam's
height and width, so that the banks never meet. Without a spread the block is a saddle under the
dam: each node has the same distance from the axis of the crest's arch as its image on the ground.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dolfinx_joints.common.errors import PlausibilityWarning, warn
from dolfinx_joints.geometry.arch import Sector
from dolfinx_joints.geometry.meshing.columns import Elevation
from dolfinx_joints.geometry.meshing.extrusion import (
    BoolArray,
    FloatArray,
    IntArray,
    PlaneMesh,
    SolidMesh,
    boundary_edges,
    edges_between,
    extrude,
    split_quadrilaterals,
)

_MIDDLE = 0.5  # ta of the elevation, a surface halfway between the faces


def half_elevation(
    sector: Sector, size: float, cell: str, joints: Mapping[str, float], active: float
) -> PlaneMesh:
    """Return the mesh of half the surface halfway between the faces, developed about the axis.

    Args:
        sector: the body and the axis of its top arch.
        size: cell size [m].
        cell: "hex" or "tet".
        joints: coordinate a of each joint by name, at least 0 [m].
        active: relative height up to which the joints are active.

    Returns:
        Mesh in the coordinates a = (radius of the top's upstream edge) theta and z [m], with the
        edges ``crest``, ``base``, ``abutments`` and the joints with at least half a cell.
    """
    height, radius = sector.dam.height, sector.radius

    def ground(a: FloatArray) -> FloatArray:
        return height * sector.foundation(a / radius, _MIDDLE)

    lines = np.unique([0.0, *joints.values(), radius * sector.half_angle])
    half = Elevation(lines, ground, height * sector.top, height * active, size)
    points, quads = half.mesh()
    cells = split_quadrilaterals(points, quads) if cell == "tet" else quads

    outline = boundary_edges(quads)
    a, z = points[outline].transpose(2, 0, 1)
    on_top, on_axis = (z == half.top).all(axis=1), (a == 0).all(axis=1)
    flat = radius * sector.abutment_angle(_MIDDLE, 0.0)
    on_base = ~on_top & ~on_axis & ((a.mean(axis=1) < flat) | (a == 0).any(axis=1))
    if sector.upright:
        on_base = (z == 0).all(axis=1)
    edges: dict[str, IntArray] = {
        "crest": outline[on_top],
        "base": outline[on_base],
        "abutments": outline[~on_top & ~on_axis & ~on_base],
    }
    for name, line in joints.items():
        if half.reaches(line):
            below = (points[:, 0] == line) & (points[:, 1] <= half.level)
            edges[name] = edges_between(cells, below)
    return PlaneMesh(points, {"concrete": cells}, edges)


def fitted_level(
    sector: Sector, theta: FloatArray, ta: FloatArray, zeta: FloatArray, active: float, depth: float
) -> FloatArray:
    """Return the levels of the elevation, shifted so that they fit the foundation at ta.

    The shift decreases linearly from the foundation to zero at the active height, which therefore
    does not move. If the foundation is near or above the active height, the shift decreases to
    zero within ``depth``.

    Args:
        sector: the body and the axis of its top arch.
        theta: angles about the axis [radians], shape (num_nodes,).
        ta: relative positions between the faces, shape (num_nodes,).
        zeta: relative heights in the elevation, shape (num_nodes,).
        active: relative height up to which the joints are active.
        depth: least difference of relative heights in which the shift decreases to zero.

    Returns:
        Relative heights, shape (num_nodes,).
    """
    elevation_level = sector.foundation(theta, _MIDDLE)
    shift = sector.foundation(theta, ta) - elevation_level
    reach = np.maximum(active - elevation_level, np.minimum(depth, sector.top - elevation_level))
    fade = np.clip(1 - (zeta - elevation_level) / np.maximum(reach, 1e-12), 0, 1)
    return zeta + shift * fade


_GROWTH = 1.5  # ratio of the sizes of neighbouring rings of cells
_MAX_FALL = 0.5  # slope of the ground towards the abutment in a cell across its edge
_MAX_TURN = 170.0  # [degrees]; the ends of the saddle must not meet downstream


@dataclass(frozen=True)
class Block:
    """Foundation block of an arch dam.

    Args:
        sectors: both halves of the dam, by side.
        depth: extent below the base and beyond the widest part of the dam on both banks [m].
        spread: extent upstream and downstream of the dam [m]; 0 for a saddle.
        size: size of the cells at the dam [m].

    Raises:
        ValueError: if a saddle is too deep for this dam.
    """

    sectors: dict[int, Sector]
    depth: float
    spread: float
    size: float

    def __post_init__(self) -> None:
        height = self.sectors[1].dam.height
        turn = float(np.degrees(max(s.half_angle for s in self.sectors.values())))
        deepest = (_MAX_TURN / turn - 1) * height
        if self.spread == 0 and self.depth > deepest:
            raise ValueError(
                f"foundation is {self.depth!r}, but with spread 0 and a crest of {turn:.4g} "
                f"degrees to one side it must be at most {deepest:.4g} m; otherwise its ends meet "
                "downstream."
            )
        if self.spread > 0 and min(self.depth, self.spread) < height:
            warn(
                f"The foundation extends {min(self.depth, self.spread):g} m beyond the dam, but "
                f"usually by at least its height of {height:g} m; 0 as spread makes a saddle.",
                PlausibilityWarning,
            )

    def place(
        self,
        sector: Sector,
        reference: FloatArray,
        ground: BoolArray,
        vertices: FloatArray,
        dam: FloatArray,
    ) -> FloatArray:
        """Return the positions of the nodes, in the block computed from (a >= 0, z, ta).

        A node lies on the ray from the middle of the crest through a point of the ground. The
        ground has an edge between base and abutment. A midside node near this edge is moved towards
        the chord of the vertices if the parabola through the three nodes would turn into the rock.

        Args:
            sector: half of the dam.
            reference: coordinates (a, z, ta) of all nodes of this half, shape (num_nodes, 3).
            ground: True at nodes on the ground under the dam, shape (num_nodes,).
            vertices: coordinates (a, z) of the vertices on the ground, shape (num_vertices, 2).
            dam: positions of the nodes of the dam, z from the base, shape (num_nodes, 3), [m].
        """
        height = sector.dam.height
        line = vertices[:, 0] + 1j * (height - vertices[:, 1])
        line = line[np.argsort(np.angle(line))]
        node = reference[:, 0] + 1j * (height - reference[:, 1])
        k = np.clip(np.searchsorted(np.angle(line), np.angle(node)) - 1, 0, len(line) - 2)
        along = line[k + 1] - line[k]
        factor = (node.conj() * along).imag / (line[k].conj() * along).imag
        factor = np.where(ground | (factor < 1 + 1e-9), 1.0, factor)
        ta = reference[:, 2]
        in_block = ground | (factor > 1) | (ta < -1e-12) | (ta > 1 + 1e-12)
        node, k, along, ta, factor = (v[in_block] for v in (node, k, along, ta, factor))
        image, through = node / factor, np.clip(ta, 0, 1)
        t, theta = ((image - line[k]) / along).real, image.real / sector.radius

        def level(vertex: IntArray) -> FloatArray:
            if sector.upright:
                return 1 - line[vertex].imag / height
            return sector.foundation(line[vertex].real / sector.radius, through)

        low, high = level(k), level(k + 1)
        zeta = (1 - t) * low + t * high
        if not sector.upright:
            most = 0.25 * np.abs(high - low) + _MAX_FALL / 4 * np.abs(along.real) / height
            zeta += np.clip(sector.foundation(theta, through) - zeta, -most, most)
        foot = sector.dam.point(sector.across(theta, through, zeta), through, zeta)
        if self.spread == 0:
            radius = np.hypot(foot[:, 0] - sector.axis, foot[:, 1])
            x = sector.axis - radius * np.cos(factor * theta)
            z = height - factor * (height - foot[:, 2])
            moved = np.column_stack([x, radius * np.sin(factor * theta), z])
        else:
            share = (factor - 1) * height / self.depth
            moved = self._moved(sector, foot, share, ta - through)
        moved[np.abs(node.imag) < 1e-9 * height, 2] = height
        xyz = dam.copy()
        xyz[in_block] = moved
        return xyz

    def _moved(
        self, sector: Sector, foot: FloatArray, share: FloatArray, beyond: FloatArray
    ) -> FloatArray:
        """Return ground points moved by shares of the ways to the outline and beyond the faces.

        With p = y / width and q = (height - z) / height, a point moves by l (p, -q) in (y, z).
        Lines of different points do not cross, because p decreases from the crest to the base
        while q increases. The bisection finds the l of the outline.
        """
        height = sector.dam.height
        zeta = np.linspace(0, 1, 201)
        width = float(sector.dam.point(1.0, [[0.0], [1.0]], zeta)[..., 1].max())
        p, q = foot[:, 1] / width, 1 - foot[:, 2] / height
        sides = ((p, width), (q, height))
        low = np.zeros(p.shape)
        high = np.min([(self.depth + w) / np.maximum(r, 1e-9) - w for r, w in sides], axis=0)
        for _ in range(60):
            middle = 0.5 * (low + high)
            distance = np.hypot(*(np.maximum(r * (w + middle) - w, 0) for r, w in sides))
            is_inside = distance < self.depth
            low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
        way, s = share * high, np.linspace(0, 1, 41)[:, None, None]
        dam = [half.dam.point(s, [[0.0], [1.0]], zeta)[..., 0] for half in self.sectors.values()]
        end = np.where(beyond > 0, np.max(dam) + self.spread, np.min(dam) - self.spread)
        x = foot[:, 0] + np.abs(beyond) * (end - foot[:, 0])
        return np.column_stack([x, foot[:, 1] + way * p, foot[:, 2] - way * q])


def _graded(length: float, first: float) -> FloatArray:
    """Return relative positions from 0 to 1 with steps that grow from about ``first``."""
    count = max(1, round(float(np.log1p(length / first * (_GROWTH - 1)) / np.log(_GROWTH))))
    return (_GROWTH ** np.arange(count + 1) - 1) / (_GROWTH**count - 1)


def ground_ring(plane: PlaneMesh, block: Block, cell: str) -> PlaneMesh:
    """Return the elevation of a dam with the cells ``foundation`` of the block added.

    The edges ``base`` and ``abutments`` become ``ground``. The edges ``outer`` and ``rim`` (at the
    level of the crest) are new.
    """
    ground = np.concatenate([plane.edges["base"], plane.edges["abutments"]])
    nodes, local = np.unique(ground, return_inverse=True)
    local = local.reshape(-1, 2)
    top = plane.points[:, 1].max()
    foot, factors = plane.points[nodes], 1 + block.depth / top * _graded(block.depth, block.size)
    angle = np.arctan2(foot[:, 0], top - foot[:, 1])
    local = np.take_along_axis(local, np.argsort(-angle[local], axis=1), axis=1)
    rings = [nodes]
    points = [plane.points]
    for ring, factor in enumerate(factors[1:]):
        points.append(np.column_stack([factor * foot[:, 0], top - factor * (top - foot[:, 1])]))
        points[-1][foot[:, 1] == top, 1] = top
        rings.append(len(plane.points) + ring * len(nodes) + np.arange(len(nodes)))
    all_points = np.concatenate(points)
    quads = np.concatenate(
        [np.hstack([inner[local], outer[local][:, ::-1]]) for inner, outer in pairwise(rings)]
    )
    ends = np.flatnonzero(foot[:, 1] == top)
    rim = [np.column_stack([i[ends], o[ends]]) for i, o in pairwise(rings)]
    edges = {k: v for k, v in plane.edges.items() if k not in ("base", "abutments")}
    edges |= {"ground": ground, "outer": rings[-1][local], "rim": np.concatenate(rim)}
    ring_cells = split_quadrilaterals(all_points, quads) if cell == "tet" else quads
    return PlaneMesh(all_points, {**plane.cells, "foundation": ring_cells}, edges)


def solid_with_foundation(
    plane: PlaneMesh, through: FloatArray, block: Block, contact: str
) -> SolidMesh:
    """Extrude the dam through its thickness, and the block beyond it on both sides.

    Args:
        plane: mesh from ``ground_ring``.
        through: relative positions of the dam's layers, from 0 to 1, shape (num_layers + 1,).
        block: the block.
        contact: name of the surface between dam and block.
    """
    levels = through
    if block.spread > 0:
        outside = _graded(block.spread, block.size)[1:]
        levels = np.concatenate([-outside[::-1], through, 1 + outside])
    before = (len(levels) - len(through)) // 2
    shift = before * len(plane.points)
    concrete, rock = plane.cells["concrete"], plane.cells["foundation"]
    edges = {k: v for k, v in plane.edges.items() if k not in ("ground", "outer", "rim")}
    dam = extrude(
        PlaneMesh(plane.points, {"concrete": concrete}, edges), through, ("upstream", "downstream")
    )
    block_edges = {k: plane.edges[k] for k in ("ground", "outer", "rim")}
    ends = "outer" if before else "rim"
    base = extrude(PlaneMesh(plane.points, {"foundation": rock}, block_edges), levels, (ends, ends))
    ground = base.facets["ground"]
    layers = ground.reshape(len(levels) - 1, -1, ground.shape[1])
    inside = slice(before, before + len(through) - 1)
    free = [base.facets["rim"], layers[:before], layers[inside.stop :]]
    facets = {name: nodes + shift for name, nodes in dam.facets.items()}
    facets[contact] = layers[inside].reshape(-1, ground.shape[1])
    facets["foundation_outer"] = base.facets["outer"]
    facets["foundation_free"] = np.concatenate([f.reshape(-1, ground.shape[1]) for f in free])
    cells = {"concrete": dam.cells["concrete"] + shift, "foundation": base.cells["foundation"]}
    node_tags = np.unique(np.concatenate([nodes.ravel() for nodes in cells.values()]))
    number = np.zeros(len(base.points), dtype=np.int64)
    number[node_tags] = np.arange(len(node_tags))
    return SolidMesh(
        base.points[node_tags],
        {name: number[nodes] for name, nodes in cells.items()},
        {name: number[nodes] for name, nodes in facets.items()},
    )
