# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mesh of quadrilaterals between vertical lines of decreasing height: elevation of half a dam.

The lines extend from a horizontal top down to a rising foundation. Between two lines with n and
n - d rows of cells, n - d rows are continuous. The other d rows end at the foundation, in a
triangle that is filled by three blocks of quadrilaterals. Cells therefore keep their size and
shape as the height decreases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dolfinx_joints.geometry.meshing.arguments import check_fine
from dolfinx_joints.geometry.meshing.extrusion import FloatArray, IntArray


@dataclass(frozen=True)
class Elevation:
    """Elevation of half a dam, in the coordinates a (across) and z (up).

    Args:
        lines: a of the vertical lines that cells must not cross, increasing from 0, shape
            (num_lines,), [m]. The last line is the end of the body: the point where the foundation
            meets the top, or a vertical abutment.
        foundation: function that returns z of the foundation at a, not decreasing [m].
        top: z of the top [m].
        level: z of a horizontal row of nodes on all lines that `reaches` accepts [m].
        size: cell size [m].
    """

    lines: FloatArray
    foundation: Callable[[FloatArray], FloatArray]
    top: float
    level: float
    size: float

    def reaches(self, a: float) -> bool:
        """Return True if the line at ``a`` reaches at least half a cell below the level."""
        return bool(self.level - self.foundation(np.array(a)) >= 0.5 * self.size)

    def mesh(self) -> tuple[FloatArray, IntArray]:
        """Return the points (num_points, 2) and the quadrilaterals (num_cells, 4).

        Raises:
            ValueError: if there would be too many cells.
        """
        high = max(1.0, float(self.top - self.foundation(np.zeros(1))[0]) / self.size)
        check_fine(high * max(len(self.lines), float(self.lines[-1]) / self.size))
        lines = _with_more_lines(self.lines, 2 * self.size)
        rows = self._rows(lines)
        node_lines = [self._line_nodes(float(a), n) for a, n in zip(lines, rows, strict=True)]
        patches = []
        for left_line, right_line in pairwise(node_lines):
            patches += self._patches_of(left_line, right_line)
        return _join(patches)

    def _rows(self, lines: FloatArray) -> list[int]:
        """Return the number of rows on each line: constant, or lower by two or more."""
        rows: list[int] = []
        upright = float(self.foundation(lines[-1:])[0]) < self.top
        for a in lines if upright else lines[:-1]:
            base = float(self.foundation(np.array(a)))
            above = max(1, round((self.top - self.level) / self.size)) if self._has_level(a) else 0
            bottom = self.level if above else self.top
            ideal = above + (bottom - base) / self.size
            least = max(2, above + 1)
            allowed = [max(least, round(ideal))]
            if rows:
                allowed = [n for n in range(least, rows[-1] + 1) if n != rows[-1] - 1]
            rows.append(min(allowed, key=lambda n: abs(np.log(n / ideal)), default=least))
        return rows if upright else [*rows, 0]

    def _has_level(self, a: float) -> bool:
        """Return True if the line at ``a`` has a node at the level."""
        return self.level < self.top and self.reaches(a)

    def _line_nodes(self, a: float, rows: int) -> FloatArray:
        """Return the nodes of a line from the top down, shape (rows + 1, 2)."""
        if rows == 0:
            return np.array([[a, self.top]])
        base = float(self.foundation(np.array(a)))
        if self._has_level(a):
            above = max(1, round((self.top - self.level) / self.size))
            upper = np.linspace(self.top, self.level, above + 1)
            z = np.concatenate([upper, np.linspace(self.level, base, rows - above + 1)[1:]])
        else:
            z = np.linspace(self.top, base, rows + 1)
        return np.column_stack([np.full(rows + 1, a), z])

    def _on_ground(self, a0: float, a1: float, count: int) -> FloatArray:
        """Return count + 1 points on the foundation at equal arc lengths, with exact ends."""
        a = np.linspace(a0, a1, 201)
        arc = np.concatenate([[0], np.cumsum(np.hypot(np.diff(a), np.diff(self.foundation(a))))])
        a = np.interp(np.linspace(0, arc[-1], count + 1), arc, a)
        a[[0, -1]] = a0, a1
        return np.column_stack([a, self.foundation(a)])

    def _patches_of(self, left: FloatArray, right: FloatArray) -> list[FloatArray]:
        """Return the patches of the block between two lines, each of shape (i + 1, j + 1, 2)."""
        through, drop = len(right) - 1, len(left) - len(right)
        width = right[0, 0] - left[0, 0]
        across = max(2 if drop else 1, round(width / self.size))
        ground = self._on_ground(left[0, 0], right[0, 0], across)
        upper = np.linspace(left[0], right[0], across + 1)
        if not drop:
            ground[0], ground[-1] = left[-1], right[-1]
            return [_patch(left, right, upper, ground)]
        lower = np.linspace(left[through], right[-1], across + 1)
        patches = []
        if through:
            patches = [_patch(left[: through + 1], right, upper, lower)]
        length = np.hypot(*np.diff(self._on_ground(left[0, 0], right[0, 0], 100), axis=0).T).sum()
        least, most = abs(across - drop) + 2, across + drop - 2
        count = least + 2 * round((min(max(length / self.size, least), most) - least) / 2)
        ground = self._on_ground(left[0, 0], right[0, 0], count)
        ground[0], ground[-1] = left[-1], right[-1]
        return patches + _triangle(lower, left[through:], ground)


def _with_more_lines(lines: FloatArray, width: float) -> FloatArray:
    """Insert lines at distances of about ``width``, and return all lines."""
    parts = [np.linspace(a, b, max(1, round((b - a) / width)) + 1)[:-1] for a, b in pairwise(lines)]
    return np.concatenate([*parts, lines[-1:]])


def _triangle(top: FloatArray, side: FloatArray, ground: FloatArray) -> list[FloatArray]:
    """Return three blocks of cells that fill a triangle and meet inside it.

    The sides have m = alpha + gamma, d = beta + gamma and c = alpha + beta cells. The blocks at the
    corners top-left, bottom and right have alpha x beta, alpha x gamma and beta x gamma cells.

    Args:
        top: points from the top-left corner to the right corner, shape (m + 1, 2).
        side: points from the top-left corner to the bottom corner, shape (d + 1, 2).
        ground: points from the bottom corner to the right corner, shape (c + 1, 2).
    """
    m, d, c = len(top) - 1, len(side) - 1, len(ground) - 1
    alpha, beta, gamma = (m + c - d) // 2, (d + c - m) // 2, (m + d - c) // 2

    def blocks(weights: FloatArray) -> list[FloatArray]:
        centre = weights @ [top[alpha], side[beta], ground[alpha]]
        from_top = np.linspace(top[alpha], centre, beta + 1)
        from_side = np.linspace(side[beta], centre, alpha + 1)
        from_ground = np.linspace(ground[alpha], centre, gamma + 1)
        return [
            _patch(side[: beta + 1], from_top, top[: alpha + 1], from_side),
            _patch(side[beta:], from_ground[::-1], from_side, ground[: alpha + 1]),
            _patch(from_top, ground[alpha:][::-1], top[alpha:], from_ground[::-1]),
        ]

    steps = np.arange(1, 16) / 16
    trials = [np.array([u, v, 1 - u - v]) for u in steps for v in steps if u + v < 0.99]
    return max(map(blocks, trials), key=lambda parts: min(map(_quality, parts)))


def _quality(patch: FloatArray) -> float:
    """Return the smallest corner quality in a patch: 1 in a square, negative if folded.

    A corner between sides of lengths e and f at the angle beta has 2 e f sin(beta)/(e^2 + f^2).
    """
    along, down = np.diff(patch, axis=1), np.diff(patch, axis=0)
    smallest = np.inf
    for e in (along[:-1], along[1:]):
        for f in (down[:, :-1], down[:, 1:]):
            twice = 2 * (e[..., 1] * f[..., 0] - e[..., 0] * f[..., 1])
            smallest = min(smallest, float((twice / (e**2 + f**2).sum(axis=-1)).min()))
    return smallest


def _patch(left: FloatArray, right: FloatArray, upper: FloatArray, lower: FloatArray) -> FloatArray:
    """Return points interpolated between four sides, which are kept exactly.

    ``left`` and ``right`` begin at the top, ``upper`` and ``lower`` at the left. The shape is
    (rows + 1, columns + 1, 2).
    """
    u = np.linspace(0, 1, len(upper))[None, :, None]
    v = np.linspace(0, 1, len(left))[:, None, None]
    x = (1 - u) * left[:, None] + u * right[:, None] + (1 - v) * upper[None] + v * lower[None]
    x -= (1 - v) * ((1 - u) * upper[0] + u * upper[-1]) + v * ((1 - u) * lower[0] + u * lower[-1])
    x[0], x[-1], x[:, 0], x[:, -1] = upper, lower, left, right
    return x


def _join(patches: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Return points and counter-clockwise quadrilaterals of patches merged at equal points."""
    cells, start = [], 0
    for patch in patches:
        number = start + np.arange(patch[..., 0].size).reshape(patch.shape[:2])
        corners = [number[1:, :-1], number[1:, 1:], number[:-1, 1:], number[:-1, :-1]]
        cells.append(np.stack(corners, axis=-1).reshape(-1, 4))
        start += number.size
    points = np.concatenate([patch.reshape(-1, 2) for patch in patches])
    points, unique = np.unique(points, axis=0, return_inverse=True)
    return points, unique.reshape(-1)[np.concatenate(cells)]
