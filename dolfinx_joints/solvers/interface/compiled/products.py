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


class Dense(NamedTuple):
    """S as it stands.

    Attributes:
        rows: Shape (m, m), symmetric.
    """

    rows: Floats


class LowRank(NamedTuple):
    """S in the blocks of a `LowRankMatrix`, which have its unit diagonal as well.

    Attributes:
        blocks: Table of the blocks.
        data: Their entries.
        order: Unknowns in the order of the blocks, shape (m,).
        live: Whether an unknown can move, shape (m,).
        work: Room for a vector and a product, shape (2, m), of the type of the entries.
    """

    blocks: Ints
    data: NDArray[Any]
    order: Ints
    live: NDArray[np.bool_]
    work: NDArray[Any]


class Kept(NamedTuple):
    """A set of points with its part of S, kept while the points asked for are among them.

    Attributes:
        points: Their numbers, in order, the first ``count`` entries, shape (points,).
        count: Their number, -1 before the first set, shape (1,).
        part: Their rows and columns of a `Dense` S, the first 9 count^2 entries; not used otherwise.
    """

    points: Ints
    count: Ints
    part: NDArray[np.float32]


def kept_of(points: int, split: Dense | LowRank) -> Kept:
    """Room for sets of so many points."""
    entries = 9 * points**2 if isinstance(split, Dense) else 0
    return Kept(
        np.zeros(points, dtype=np.int64),
        np.full(1, -1),
        np.empty(entries, dtype=np.float32),
    )


def _dense_product(split: Dense, values: Floats, nonzero: Ints, out: Floats) -> None:
    count = 0
    for k in range(len(values)):
        out[k] = 0.0
        if values[k] != 0.0:
            nonzero[count] = k
            count += 1
    add_rows(split.rows, nonzero[:count], values, out)


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
    count = kept.count[0]
    size = 3 * count
    rows = kept.part[: size * size].reshape(size, size)
    for i in range(count):
        for a in range(3):
            line, out = split.rows[3 * kept.points[i] + a], rows[3 * i + a]
            for j in range(count):
                first, at = 3 * kept.points[j], 3 * j
                out[at] = line[first]
                out[at + 1] = line[first + 1]
                out[at + 2] = line[first + 2]


def _hold_nothing(split: LowRank, kept: Kept) -> None:
    pass


def _hold(split: Any, kept: Kept) -> None:
    (_hold_dense if isinstance(split, Dense) else _hold_nothing)(split, kept)


@overload(_hold, strict=False)
def _(split: Any, kept: Any) -> Any:
    return _hold_dense if split.instance_class is Dense else _hold_nothing


@part
def hold(split: Any, kept: Kept, wanted: Ints, count: int) -> None:
    """Keep a set that holds the points wanted, sorted: the one that is kept, or these."""
    place, known = 0, kept.count[0]
    for k in range(count):
        while place < known and kept.points[place] < wanted[k]:
            place += 1
        if place >= known or kept.points[place] != wanted[k]:
            place = known + 1
            break
    if place > known or known < 0 or known > 2 * count + 20:
        take(split, kept, wanted, count)


@njit(cache=True)
def take(split: Any, kept: Kept, points: Ints, count: int) -> None:
    """Keep these points."""
    kept.count[0] = count
    for k in range(count):
        kept.points[k] = points[k]
    _hold(split, kept)


def _dense_part(split: Dense, kept: Kept, values: Floats, every: Floats, out: Floats) -> None:
    size = 3 * kept.count[0]
    rows = kept.part[: size * size].reshape(size, size)
    for j in range(size):
        out[j] = 0.0
    k = 0
    while k + 4 <= size:
        r_0, r_1, r_2, r_3 = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
        v_0, v_1, v_2, v_3 = values[k], values[k + 1], values[k + 2], values[k + 3]
        for j in range(size):
            out[j] += v_0 * r_0[j] + v_1 * r_1[j] + v_2 * r_2[j] + v_3 * r_3[j]
        k += 4
    while k < size:
        row, value = rows[k], values[k]
        for j in range(size):
            out[j] += value * row[j]
        k += 1


def _low_rank_part(split: LowRank, kept: Kept, values: Floats, every: Floats, out: Floats) -> None:
    for k in range(len(every)):
        every[k] = 0.0
    for i in range(kept.count[0]):
        for a in range(3):
            every[3 * kept.points[i] + a] = values[3 * i + a]
    x, y = split.work[0], split.work[1]
    for k in range(len(every)):
        x[k], y[k] = every[split.order[k]], 0.0
    multiply_blocks(split.blocks, split.data, x, y)
    for k in range(len(every)):
        at = split.order[k]
        every[at] = y[k] - every[at] if split.live[at] else 0.0
    for i in range(kept.count[0]):
        for a in range(3):
            out[3 * i + a] = every[3 * kept.points[i] + a]


def multiply_part(split: Any, kept: Kept, values: Floats, every: Floats, out: Floats) -> None:
    """The kept part of S times values, shape (3 count,), with room for a vector of all unknowns."""
    chosen = _dense_part if isinstance(split, Dense) else _low_rank_part
    chosen(split, kept, values, every, out)


@overload(multiply_part, strict=False)
def _(split: Any, kept: Any, values: Any, every: Any, out: Any) -> Any:
    return _dense_part if split.instance_class is Dense else _low_rank_part
