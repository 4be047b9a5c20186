# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products with S, the compliance less its diagonal, and with parts of it kept in single precision.

S is `Dense` or `LowRank`; which, is settled when a function that multiplies is compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers.interface.low_rank import multiply_blocks
from dolfinx_joints.solvers.interface.row_matrix import add_rows

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]


# Sets grow to so many times the points wanted and some more before they are taken anew.
GROWN, SPARE = 1.25, 20


class Dense(NamedTuple):
    """S as it stands.

    Attributes:
        rows: Shape (m, m), symmetric.
        work: Room for a product, shape (m,), of the type of the rows.
    """

    rows: NDArray[Any]
    work: NDArray[Any]


class LowRank(NamedTuple):
    """S in the blocks of a `LowRankMatrix`, which have its unit diagonal as well.

    Attributes:
        blocks: Table of the blocks.
        data: Their entries.
        order: Unknowns in the order of the blocks, shape (m,).
        live: Whether an unknown can move, shape (m,).
        work: Room for a vector and a product, shape (2, m), of the type of the entries.
        whole: S as it stands for small sets, which read less of it than the blocks have; shape
            (m, m) or (0, 0).
    """

    blocks: Ints
    data: NDArray[Any]
    order: Ints
    live: NDArray[np.bool_]
    work: NDArray[Any]
    whole: Singles


class Kept(NamedTuple):
    """A set of points with its part of S, kept while the points asked for are among them.

    Attributes:
        points: Their numbers, in order, the first ``number`` entries, shape (points,).
        number: How many, -1 before the first set, shape (1,).
        part: Their rows and columns of S, the first 9 number^2 entries; of a `LowRank` S where that
            is no more than it has.
    """

    points: Ints
    number: Ints
    part: Singles


def kept_of(points: int, split: Dense | LowRank) -> Kept:
    """Room for sets of so many points."""
    entries = 9 * points**2
    if isinstance(split, LowRank):
        entries = len(split.data) if len(split.whole) else 0
    return Kept(
        np.zeros(points, dtype=np.int64),
        np.full(1, -1),
        np.empty(entries, dtype=np.float32),
    )


def _dense_product(split: Dense, values: Floats, nonzero: Ints, out: Floats) -> None:
    count, product = 0, split.work
    for k in range(len(values)):
        product[k] = 0.0
        if values[k] != 0.0:
            nonzero[count] = k
            count += 1
    add_rows(split.rows, nonzero[:count], values, product)
    for k in range(len(values)):
        out[k] = product[k]


def _low_rank_product(split: LowRank, values: Floats, nonzero: Ints, out: Floats) -> None:
    x, y = split.work[0], split.work[1]
    for k in range(len(values)):
        x[k], y[k] = values[split.order[k]], 0.0
    multiply_blocks(split.blocks, split.data, x, y)
    for k in range(len(values)):
        at = split.order[k]
        out[at] = y[k] - values[at] if split.live[at] else 0.0


def multiply(split: Any, values: Floats, nonzero: Ints, out: Floats) -> None:
    """S times values, shape (m,), with room for as many numbers of rows."""
    chosen = _dense_product if isinstance(split, Dense) else _low_rank_product
    chosen(split, values, nonzero, out)


@overload(multiply, strict=False)
def _(split: Any, values: Any, nonzero: Any, out: Any) -> Any:
    return _dense_product if split.instance_class is Dense else _low_rank_product


def _dense_cost(split: Dense, unknowns: int) -> float:
    return float(unknowns) * len(split.rows)


def _low_rank_cost(split: LowRank, unknowns: int) -> float:
    return float(len(split.data))


def cost(split: Any, unknowns: int) -> float:
    """Entries that a product with so many nonzero values reads."""
    return (_dense_cost if isinstance(split, Dense) else _low_rank_cost)(split, unknowns)


@overload(cost, strict=False)
def _(split: Any, unknowns: Any) -> Any:
    return _dense_cost if split.instance_class is Dense else _low_rank_cost


def _hold_dense(split: Dense, kept: Kept) -> None:
    _pick(split.rows, kept)


def _hold_low_rank(split: LowRank, kept: Kept) -> None:
    if _is_held(kept):
        _pick(split.whole, kept)


@part
def _is_held(kept: Kept) -> bool:
    """Whether the part of a set fits into its room."""
    return bool(9 * kept.number[0] ** 2 <= len(kept.part))


@part
def _pick(matrix: NDArray[Any], kept: Kept) -> None:
    """Rows and columns of the points kept."""
    count, points = kept.number[0], kept.points
    rows = kept.part[: 9 * count * count].reshape(3 * count, 3 * count)
    for i in range(count):
        for a in range(3):
            line, out = matrix[3 * points[i] + a], rows[3 * i + a]
            for j in range(count):
                for b in range(3):
                    out[3 * j + b] = line[3 * points[j] + b]


def _hold(split: Any, kept: Kept) -> None:
    (_hold_dense if isinstance(split, Dense) else _hold_low_rank)(split, kept)


@overload(_hold, strict=False)
def _(split: Any, kept: Any) -> Any:
    return _hold_dense if split.instance_class is Dense else _hold_low_rank


@part
def hold(split: Any, kept: Kept, wanted: Ints, count: int) -> None:
    """Keep a set that holds the points wanted, sorted: that kept, with these, or these alone."""
    points, known, both, place = kept.points, kept.number[0], 0, 0
    for k in range(count):
        while place < known and points[place] < wanted[k]:
            place += 1
        both += place < known and points[place] == wanted[k]
    union = known + count - both
    if known >= 0 and both == count and known <= 2 * count + SPARE:
        return
    if known < 0 or union > GROWN * count + SPARE:
        take(split, kept, wanted, count)
        return
    old, new = known - 1, count - 1
    for k in range(union - 1, -1, -1):
        if new < 0 or (old >= 0 and points[old] > wanted[new]):
            points[k], old = points[old], old - 1
        else:
            old -= old >= 0 and points[old] == wanted[new]
            points[k], new = wanted[new], new - 1
    take(split, kept, points, union)


@njit(cache=True)
def take(split: Any, kept: Kept, points: Ints, count: int) -> None:
    """Keep these points."""
    kept.number[0] = count
    for k in range(count):
        kept.points[k] = points[k]
    _hold(split, kept)


def _dense_part(split: Dense, kept: Kept, values: Singles, every: Singles, out: Singles) -> None:
    size = 3 * kept.number[0]
    np.dot(values, kept.part[: size * size].reshape(size, size), out)


def _low_rank_part(
    split: LowRank, kept: Kept, values: Singles, every: Singles, out: Singles
) -> None:
    if _is_held(kept):
        size = 3 * kept.number[0]
        np.dot(values, kept.part[: size * size].reshape(size, size), out)
        return
    for k in range(len(every)):
        every[k] = np.float32(0.0)
    for i in range(kept.number[0]):
        for a in range(3):
            every[3 * kept.points[i] + a] = values[3 * i + a]
    x, y = split.work[0], split.work[1]
    for k in range(len(every)):
        x[k], y[k] = every[split.order[k]], 0.0
    multiply_blocks(split.blocks, split.data, x, y)
    for k in range(len(every)):
        at = split.order[k]
        every[at] = y[k] - every[at] if split.live[at] else 0.0
    for i in range(kept.number[0]):
        for a in range(3):
            out[3 * i + a] = every[3 * kept.points[i] + a]


def multiply_part(split: Any, kept: Kept, values: Singles, every: Singles, out: Singles) -> None:
    """The kept part of S times values, shape (3 number,); ``every`` is room for all unknowns."""
    chosen = _dense_part if isinstance(split, Dense) else _low_rank_part
    chosen(split, kept, values, every, out)


@overload(multiply_part, strict=False)
def _(split: Any, kept: Any, values: Any, every: Any, out: Any) -> Any:
    return _dense_part if split.instance_class is Dense else _low_rank_part
