# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of a foundation block that follows the valley of an arch dam.

In the elevation (a, z) the block lies between the ground and its image, enlarged about the middle
of the crest. It consists of rings that are enlarged step by step, so that cells grow outwards and
never fold. In 3-D each node has the same distance from the axis of the crest's arch as its image
on the ground. Beyond the faces of the dam, the block continues in the radial direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dolfinx_joints.geometry.arch import Sector
from dolfinx_joints.geometry.meshing.extrusion import (
    BoolArray,
    FloatArray,
    IntArray,
    PlaneMesh,
    SolidMesh,
    extrude,
    split_quadrilaterals,
)

_GROWTH = 1.5  # ratio of the sizes of neighbouring rings of cells
_MAX_TURN = 170.0  # [degrees]; the ends of the block must not meet downstream


@dataclass(frozen=True)
class Block:
    """Foundation block of an arch dam.

    Args:
        sectors: both halves of the dam, by side.
        depth: depth below the base [m].
        spread: extent beyond the faces of the dam [m]; None for the depth.
        size: size of the cells at the dam [m].

    Raises:
        ValueError: if a length is not allowed for this dam.
    """

    sectors: dict[int, Sector]
    depth: float
    spread: float | None
    size: float

    def __post_init__(self) -> None:
        sector = self.sectors[1]
        turn = float(np.degrees(max(s.half_angle for s in self.sectors.values())))
        deepest = (_MAX_TURN / turn - 1) * sector.dam.height
        if self.depth > deepest:
            raise ValueError(
                f"foundation is {self.depth!r}, but with a crest of {turn:.4g} degrees to one side "
                f"it must be at most {deepest:.4g} m; otherwise its ends meet downstream."
            )
        zeta = np.linspace(0, 1, 201)
        nearest = min(
            float(np.hypot(p[..., 0] - s.axis, p[..., 1]).min())
            for s in self.sectors.values()
            for p in [s.dam.point(np.array([[0.0], [1.0]]), 1.0, zeta)]
        )
        if self.reach >= nearest:
            raise ValueError(
                f"spread is {self.reach:g} m, but it must be below {nearest:.4g} m, the distance "
                "of the downstream face from the axis of the crest's arch."
            )

    @property
    def reach(self) -> float:
        """Extent of the block beyond the faces of the dam [m]."""
        return float(self.depth if self.spread is None else self.spread)

    def factors(self) -> FloatArray:
        """Return the enlargement factors of the rings, starting from 1."""
        height = self.sectors[1].dam.height
        return 1 + self.depth / height * _graded(self.depth, self.size)

    def levels(self, through: FloatArray) -> FloatArray:
        """Return the relative positions ta of all layers; [-1, 0] and [1, 2] are the block."""
        if self.reach == 0:
            return through
        outside = _graded(self.reach, self.size)[1:]
        return np.concatenate([-outside[::-1], through, 1 + outside])

    def place(
        self, sector: Sector, reference: FloatArray, ground: BoolArray, dam: FloatArray
    ) -> FloatArray:
        """Return the positions of the nodes, in the block computed from (a >= 0, z, ta).

        Args:
            sector: half of the dam.
            reference: coordinates (a, z, ta) of all nodes of this half, shape (num_nodes, 3).
            ground: True at nodes on the ground under the dam, shape (num_nodes,).
            dam: positions of the nodes of the dam, z from the base, shape (num_nodes, 3), [m].
        """
        a, z, ta = reference.T
        factor = np.where(ground, 1.0, self._factor(sector, a, z))
        in_block = (factor > 1) | (ta < -1e-12) | (ta > 1 + 1e-12)
        a, z, ta, factor = a[in_block], z[in_block], ta[in_block], factor[in_block]
        height = sector.dam.height
        theta, through = a / factor / sector.radius, np.clip(ta, 0, 1)
        if sector.upright:
            zeta = 1 - (1 - z / height) / factor
        else:
            zeta = sector.foundation(theta, through)
        foot = sector.dam.point(sector.across(theta, through, zeta), through, zeta)
        radius = np.hypot(foot[:, 0] - sector.axis, foot[:, 1]) - self.reach * (ta - through)
        angle = factor * theta
        top = height - factor * (height - foot[:, 2])
        top = np.where(np.abs(z - height) < 1e-9 * height, height, top)
        xyz = dam.copy()
        x = sector.axis - radius * np.cos(angle)
        xyz[in_block] = np.column_stack([x, radius * np.sin(angle), top])
        return xyz

    def _factor(self, sector: Sector, a: FloatArray, z: FloatArray) -> FloatArray:
        """Return the enlargement factor of each point by bisection, 1 inside the dam, (n,)."""
        height, end = sector.dam.height, sector.radius * sector.half_angle

        def inside(factor: FloatArray) -> BoolArray:
            zeta = 1 - (1 - z / height) / factor
            across = a / factor
            limit = sector.radius * sector.abutment_angle(0.5, np.clip(zeta, 0, 1))
            slack = 1e-12 * end
            return (zeta >= -1e-12) & (across <= limit + slack) & (across <= end + slack)

        low, high = np.ones(a.shape), np.full(a.shape, 2 * float(self.factors()[-1]))
        inside_dam = inside(low)
        for _ in range(60):
            middle = 0.5 * (low + high)
            is_inside = inside(middle)
            low, high = np.where(is_inside, low, middle), np.where(is_inside, middle, high)
        return np.where(inside_dam, 1.0, high)


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
    foot, factors = plane.points[nodes], block.factors()
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
    quads = _counter_clockwise(all_points, quads)
    ends = np.flatnonzero(foot[:, 1] == top)
    rim = [np.column_stack([i[ends], o[ends]]) for i, o in pairwise(rings)]
    edges = {k: v for k, v in plane.edges.items() if k not in ("base", "abutments")}
    edges |= {"ground": ground, "outer": rings[-1][local], "rim": np.concatenate(rim)}
    ring_cells = split_quadrilaterals(all_points, quads) if cell == "tet" else quads
    return PlaneMesh(all_points, {**plane.cells, "foundation": ring_cells}, edges)


def _counter_clockwise(points: FloatArray, quads: IntArray) -> IntArray:
    """Return the quadrilaterals with the clockwise ones reversed."""
    p = points[quads]
    diagonal, other_diagonal = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
    clockwise = diagonal[:, 0] * other_diagonal[:, 1] - diagonal[:, 1] * other_diagonal[:, 0] < 0
    return np.where(clockwise[:, None], quads[:, ::-1], quads)


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
    levels = block.levels(through)
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
