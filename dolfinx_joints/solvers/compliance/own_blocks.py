# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance matrix between the joint points of one rank in zero, low-rank and dense blocks.

The displacement due to a joint force is smooth far away, and zero on bodies that the point does not
touch. The columns of one cluster of points (a panel) are computed together, so the whole matrix is
never stored. The rows of a panel are bisected until each part is zero, of low rank or small.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers import limits

DENSE = -1

# Allow sums in any order, so that the compiler can vectorise them; NaN stays NaN.
SUMS = {"reassoc", "contract", "nsz"}


@dataclass(frozen=True, eq=False)
class Cluster:
    """Points ``start`` to ``stop`` of an order, their bounding box, and no or two halves."""

    start: int
    stop: int
    low: Floats
    high: Floats
    halves: tuple[Cluster, ...] = ()

    @property
    def unknowns(self) -> slice:
        """Unknowns of the points."""
        return slice(3 * self.start, 3 * self.stop)

    def leaves(self) -> Iterator[Cluster]:
        """Yield the clusters without halves, in order."""
        if not self.halves:
            yield self
        for half in self.halves:
            yield from half.leaves()


def clusters(
    points: Floats, leaf: int = limits.CLUSTER_POINTS, joint: NDArray[Any] | None = None
) -> tuple[Ints, list[Cluster]]:
    """Bisect points across the longest edge of their box until a cluster has at most ``leaf``.

    Args:
        points: Coordinates, shape (n, 3), [m].
        leaf: Largest number of points in a cluster that is not bisected.
        joint: Number of the joint of each point, shape (n,); each joint is a separate tree.

    Returns:
        Numbers of the points in the order of the trees, shape (n,), and the roots of the trees.
    """
    labels = np.zeros(len(points), dtype=np.int64) if joint is None else np.asarray(joint)
    order = np.argsort(labels, kind="stable")
    bounds = np.flatnonzero(np.diff(labels[order], prepend=-1, append=-1))
    trees = [
        _bisected(points, order, int(start), int(stop), leaf) for start, stop in pairwise(bounds)
    ]
    return order, trees


def _bisected(points: Floats, order: Ints, start: int, stop: int, leaf: int) -> Cluster:
    """Return the tree of a range of the order, which is sorted in place."""
    inside = points[order[start:stop]]
    low, high = inside.min(axis=0), inside.max(axis=0)
    if stop - start <= leaf:
        return Cluster(start, stop, low, high)
    axis = int((high - low).argmax())
    order[start:stop] = order[start:stop][np.argsort(inside[:, axis], kind="stable")]
    middle = (start + stop) // 2
    halves = (
        _bisected(points, order, start, middle, leaf),
        _bisected(points, order, middle, stop, leaf),
    )
    return Cluster(start, stop, low, high, halves)


class OwnBlocks:
    """Blocks of the points of one rank.

    The blocks store the matrix scaled to a unit diagonal, diag(1/scale) G diag(1/scale) = I + S.
    The tolerance is absolute for each block, in the spectral norm.

    Args:
        points: Coordinates of the points, shape (n, 3), [m].
        scale: Square roots of the diagonal or an estimate of them, shape (3 n,).
        joint: Number of the joint of each point, shape (n,).
        tolerance: Largest error of a block relative to the unit diagonal.
        dtype: Type of the blocks and products, float64 or float32.
        leaf: Largest number of points in a cluster that is not bisected.
        symmetric: True if the matrix is symmetric; then only one of two mirrored blocks is stored.

    Attributes:
        size: Number of rows and columns.
        nbytes: Memory of the blocks [bytes].
        symmetric: True if only one of two mirrored blocks is stored.
        order: Unknowns in the order of the columns, shape (3 n,).
        scale: Scale in this order, 1 where a point cannot move.
        panels: Clusters whose columns are computed together.
        blocks: Table with first row, first column, height, width, rank, 1 if mirrored, and first
            entry of each block.
        data: Entries of the blocks, one after the other.
    """

    def __init__(
        self,
        points: Floats,
        *,
        scale: Floats,
        joint: NDArray[Any] | None,
        tolerance: float,
        dtype: Any,
        leaf: int,
        symmetric: bool,
    ) -> None:
        """Cut the points into panels; call `add_panel` for each panel, then `finish`."""
        self.symmetric, self.size = symmetric, 3 * len(points)
        self.tolerance, self.dtype = tolerance, np.dtype(dtype)
        order, self._trees = clusters(points, leaf, joint)
        self.order = unknowns_of(order)
        self.scale = np.where(scale > 0.0, scale, 1.0)[self.order]  # zero rows and columns
        self.panels = [panel for tree in self._trees for panel in tree.leaves()]
        self._clear_blocks()

    def _clear_blocks(self) -> None:
        """Remove all blocks."""
        self._table: list[tuple[int, ...]] = []
        self.data, self._filled = np.empty(0, self.dtype), 0

    def finish(self) -> None:
        """Free unused memory and store the table of the blocks."""
        self.data.resize(self._filled, refcheck=False)
        self.nbytes = self.data.nbytes
        self.blocks = np.array(self._table, dtype=np.int64).reshape(-1, 7)

    def add_panel(self, panel: Cluster, columns: Floats) -> None:
        """Cut the rows of a panel into blocks, and store the blocks."""
        for rows, *parts in self.row_blocks(panel, self.scale[panel.unknowns], columns, own=True):
            mirrored = self.symmetric and rows.start >= panel.stop
            at = (3 * rows.start, 3 * panel.start, 3 * (rows.stop - rows.start))
            width = 3 * (panel.stop - panel.start)
            rank = len(parts[0]) if len(parts) == 2 else DENSE
            self._table.append((*at, width, rank, int(mirrored), self._filled))
            self._store(parts)

    def row_blocks(
        self, panel: Cluster, scale: Floats, columns: Floats, *, own: bool = False
    ) -> Iterator[tuple[Any, ...]]:
        """Yield clusters of rows, each with L and R of a block L^T R, or with a dense block.

        Args:
            panel: The panel.
            scale: Scale of the panel's unknowns.
            columns: Columns of the panel, shape (3 n, k).
            own: True if the panel has points of this rank.
        """
        scaled = columns[self.order] / self.scale[:, None] / scale
        for tree in self._trees:
            yield from self._blocks_in_rows(tree, panel, scaled, own)

    def _blocks_in_rows(
        self, rows: Cluster, panel: Cluster, scaled: Floats, own: bool
    ) -> Iterator[tuple[Any, ...]]:
        """Yield a cluster of rows with its block, or the blocks of its halves."""
        meets = own and self.symmetric and rows.start < panel.stop
        if meets and rows.stop <= panel.start:
            return  # mirrors a block of an earlier panel
        block = scaled[rows.unknowns]
        if not block.any():
            return
        if not meets and _admissible(rows, panel):
            factors = factors_if_worth(block, self.tolerance)
            if factors is not None:
                yield rows, *factors
                return
        if rows.halves and not (meets and rows.start == panel.start and rows.stop == panel.stop):
            for half in rows.halves:
                yield from self._blocks_in_rows(half, panel, scaled, own)
        else:
            yield rows, block

    def _store(self, parts: Sequence[Floats]) -> None:
        """Append the entries of a block."""
        for part in parts:
            end = self._filled + part.size
            if end > len(self.data):
                # Enlarge in place: a copy of all blocks would double their memory.
                self.data.resize(end + limits.STORE_GROWTH, refcheck=False)
            self.data[self._filled : end] = part.ravel()
            self._filled = end

    def rougher(self, tolerance: float, dtype: Any = np.float32) -> OwnBlocks:
        """Return this matrix with a larger tolerance, computed from its blocks."""
        rough = copy(self)
        rough.tolerance, rough.dtype = tolerance, np.dtype(dtype)
        rough._clear_blocks()
        for row, column, height, width, rank, mirrored, start in self.blocks:
            down, across = self._block(height, width, rank, start)
            parts: tuple[Floats, ...] = (across,)
            factors = factors_if_worth(across, tolerance) if rank == DENSE else None
            if rank != DENSE:
                rank = rank_of(down, tolerance)
                parts = down[:rank], across[:rank]
            elif factors is not None:
                parts, rank = factors, len(factors[0])
            rough._table.append((row, column, height, width, rank, mirrored, rough._filled))
            rough._store(parts)
        rough.finish()
        return rough

    def products(self, vectors: list[Floats]) -> list[Floats]:
        """Return the matrix times several vectors, reading the blocks once."""
        x = (self.scale[:, None] * np.column_stack(vectors)[self.order]).astype(self.dtype)
        y = np.zeros((self.size, len(vectors)), dtype=self.dtype)
        _multiply_all(self.blocks, self.data, x, y)
        out = np.empty((len(vectors), self.size))
        out[:, self.order] = (self.scale[:, None] * y).T
        return list(out)

    def whole(self) -> Floats:
        """Return the matrix, shape (3 n, 3 n)."""
        out = np.zeros((self.size, self.size))
        for row, column, height, width, rank, mirrored, start in self.blocks:
            down, across = self._block(height, width, rank, start)
            block = down.T @ across
            out[row : row + height, column : column + width] = block
            if mirrored:
                out[column : column + width, row : row + height] = block.T
        result = np.empty_like(out)
        result[np.ix_(self.order, self.order)] = out * self.scale[:, None] * self.scale
        return result

    def _block(self, height: int, width: int, rank: int, start: int) -> tuple[Any, Any]:
        """Return the factors L, R of a block L^T R."""
        if rank == DENSE:
            dense = self.data[start : start + height * width].reshape(height, width)
            return np.eye(height, dtype=self.dtype), dense
        down = self.data[start : start + rank * height].reshape(rank, height)
        start += rank * height
        return down, self.data[start : start + rank * width].reshape(rank, width)


def unknowns_of(points: Ints) -> Ints:
    """Return the numbers of the three unknowns of each point."""
    return (3 * points[:, None] + np.arange(3)).ravel()


def _admissible(a: Cluster, b: Cluster) -> bool:
    """Return True if two clusters are far from each other compared with their size."""
    gap = np.maximum(0.0, np.maximum(a.low - b.high, b.low - a.high))
    size = min(float(np.linalg.norm(c.high - c.low)) for c in (a, b))
    return size <= limits.ADMISSIBLE_SIZE * float(np.linalg.norm(gap))


def factors_if_worth(block: Floats, tolerance: float) -> tuple[Floats, Floats] | None:
    """Return L, R with the fewest rows so that L^T R equals the block within the tolerance.

    The error is measured in the spectral norm. Return None if L and R do not save enough memory.
    """
    left_vectors, values, right_vectors = np.linalg.svd(block, full_matrices=False)
    rank = int(np.count_nonzero(values > tolerance))
    root = np.sqrt(values[:rank])
    factors = (left_vectors[:, :rank] * root).T, root[:, None] * right_vectors[:rank]
    return factors if sum(f.size for f in factors) <= limits.LOW_RANK_SHARE * block.size else None


def rank_of(factor: Floats, tolerance: float) -> int:
    """Return the number of singular values (squared row norms of a factor) above a tolerance."""
    return int(np.count_nonzero(np.einsum("ij,ij->i", factor, factor) > tolerance))


@njit(cache=True, fastmath=SUMS)
def multiply_blocks(blocks: Ints, data: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> None:
    """Add the blocks and the mirrored blocks, times x, to y."""
    for b in range(len(blocks)):
        row, column, height, width, rank, mirrored, start = blocks[b]
        x_across, y_down = x[column : column + width], y[row : row + height]
        if rank < 0:
            dense = data[start : start + height * width].reshape(height, width)
            if mirrored:
                dense_and_mirror(
                    dense, x_across, x[row : row + height], y_down, y[column : column + width]
                )
            else:
                _dense(dense, x_across, y_down)
            continue
        middle = start + rank * height
        down = data[start:middle].reshape(rank, height)
        across = data[middle : middle + rank * width].reshape(rank, width)
        _low_rank(down, across, x_across, y_down)
        if mirrored:
            _low_rank(across, down, x[row : row + height], y[column : column + width])


@njit(cache=True)
def _multiply_all(blocks: Ints, data: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> None:
    """Add the blocks and the mirrored blocks, times the columns of x, to y."""
    for b in range(len(blocks)):
        row, column, height, width, rank, mirrored, start = blocks[b]
        x_across, x_down = x[column : column + width], x[row : row + height]
        if rank < 0:
            dense = data[start : start + height * width].reshape(height, width)
            y[row : row + height] += np.dot(dense, x_across)
            if mirrored:
                y[column : column + width] += np.dot(dense.T, x_down)
            continue
        middle = start + rank * height
        down = data[start:middle].reshape(rank, height)
        across = data[middle : middle + rank * width].reshape(rank, width)
        y[row : row + height] += np.dot(down.T, np.dot(across, x_across))
        if mirrored:
            y[column : column + width] += np.dot(across.T, np.dot(down, x_down))


@njit(cache=True, fastmath=SUMS)
def _dense(dense: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> None:
    for i in range(dense.shape[0]):
        total = dense.dtype.type(0.0)
        row = dense[i]
        for j in range(row.size):
            total += row[j] * x[j]
        y[i] += total


@njit(cache=True, fastmath=SUMS)
def dense_and_mirror(
    dense: NDArray[Any],
    x_across: NDArray[Any],
    x_down: NDArray[Any],
    y_down: NDArray[Any],
    y_across: NDArray[Any],
) -> None:
    """Add a dense block and the mirrored block, times parts of x, to y in one pass."""
    for i in range(dense.shape[0]):
        total = dense.dtype.type(0.0)
        row, factor = dense[i], x_down[i]
        for j in range(row.size):
            total += row[j] * x_across[j]
            y_across[j] += row[j] * factor
        y_down[i] += total


@njit(cache=True, fastmath=SUMS)
def _low_rank(left: NDArray[Any], right: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> None:
    """Add left^T right x to y."""
    for k in range(left.shape[0]):
        weight = left.dtype.type(0.0)
        row = right[k]
        for j in range(row.size):
            weight += row[j] * x[j]
        row = left[k]
        for i in range(row.size):
            y[i] += row[i] * weight
