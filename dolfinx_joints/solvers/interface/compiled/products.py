# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products with S, the scaled compliance less the identity, and with stored parts of S.

S is `Dense` or `LowRank`; compiled functions are specialised for each type. Stored parts are in
single precision. Vectors have the m local unknowns; all ranks together have M unknowns.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.blocks_between_ranks import (
    add_at_places,
    expand_and_return,
    reduce,
)
from dolfinx_joints.solvers.compliance.own_blocks import multiply_blocks
from dolfinx_joints.solvers.compliance.row_matrix import add_rows, multiply_lower
from dolfinx_joints.solvers.interface.compiled.ranks import (
    Lengths,
    Ranks,
    allgather_parts,
    allgather_values,
    exchange,
    lengths_of,
)

Singles = NDArray[np.float32]


class Dense(NamedTuple):
    """S as a dense matrix.

    Attributes:
        ranks: The ranks.
        columns: Columns of the local rows of S, one per array row, shape (M, m).
        by_half: True if products read only half of S, which is symmetric and on one rank.
        work: Work array for a vector and a product, shape (2, m), of the type of the columns.
        nonzero: Work array for numbers of unknowns, shape (M,).
        lengths: Lengths of the ranks' vectors.
        gathered: Work array for a vector of all ranks, shape (M,), empty on one rank.
    """

    ranks: Ranks
    columns: NDArray[Any]
    by_half: bool
    work: NDArray[Any]
    nonzero: Ints
    lengths: Lengths
    gathered: Floats


class LowRank(NamedTuple):
    """S in the blocks of a `LowRankMatrix`, which store I + S.

    Attributes:
        ranks: The ranks.
        blocks: Table of the blocks between points of this rank.
        data: Entries of the blocks between points of this rank.
        table: Table of the blocks with points of other ranks, as in `LowRankMatrix`.
        shares: Entries that this rank stores for the blocks with points of other ranks.
        lengths: Lengths of the values exchanged with each other rank.
        passing: Work array for the exchanged values, shape (2, n).
        order: Unknowns in the order of the blocks, shape (m,).
        rows: Position of each unknown in ``order``, shape (m,).
        live: True for each unknown that can move, shape (m,).
        work: Work array for a vector and a product, shape (2, m), of the type of the entries.
        entries: Number of entries of all ranks.
        whole: Columns of S as in `Dense`, for sets that are so small that their columns have fewer
            entries than the blocks; shape (M, m) or (0, 0).
    """

    ranks: Ranks
    blocks: Ints
    data: NDArray[Any]
    table: Ints
    shares: NDArray[Any]
    lengths: Lengths
    passing: NDArray[Any]
    order: Ints
    rows: Ints
    live: NDArray[np.bool_]
    work: NDArray[Any]
    entries: float
    whole: Singles


class Kept(NamedTuple):
    """Set of points with its part of S, reused as long as the set contains the required points.

    Attributes:
        points: Local numbers of this rank's points, sorted, in the first entries, shape (points,).
        number: Count of local points (-1 before the first set) and of all points, shape (2,).
        lengths: Lengths of the ranks' single-precision vectors of the set.
        gathered: Work array for a vector of the set on all ranks, shape (M,), empty if not needed.
        numbers: Global numbers of all points of the set, shape (M / 3,), empty if not needed.
        part: Columns of the set in the local rows of the set, in the first entries. With a
            `LowRank` S only if they are no more than the entries of S.
    """

    points: Ints
    number: Ints
    lengths: Lengths
    gathered: Singles
    numbers: Ints
    part: Singles


def kept_of(points: int, all_points: int, split: Dense | LowRank) -> Kept:
    """Return an empty set for at most ``points`` local points and ``all_points`` of all ranks."""
    largest, ranks = all_points, split.ranks.size
    if isinstance(split, LowRank):
        largest = min(all_points, int(np.sqrt(split.entries) / 3.0)) if len(split.whole) else 0
    several = all_points if ranks > 1 and largest > 0 else 0
    return Kept(
        np.zeros(points, dtype=np.int64),
        np.array([-1, 0]),
        lengths_of(np.zeros(ranks)),
        np.empty(3 * several, dtype=np.float32),
        np.empty(several, dtype=np.int64),
        np.empty(9 * largest * min(points, largest), dtype=np.float32),
    )


def _dense_product(split: Dense, values: Floats, out: Floats) -> None:
    vector = allgather_parts(split.ranks, values, split.lengths, split.gathered)
    count, product = 0, split.work[1]
    for k in range(len(vector)):
        if vector[k] != 0.0:
            split.nonzero[count] = k
            count += 1
    if split.by_half and count > limits.NONZERO_SHARE * len(vector):
        for k in range(len(values)):
            split.work[0, k] = values[k]
        multiply_lower(split.columns, split.work[0], product)
    else:
        for k in range(len(product)):
            product[k] = 0.0
        add_rows(split.columns, split.nonzero[:count], vector, product)
    for k in range(len(product)):
        out[k] = product[k]


@part
def _multiply_blocks(split: LowRank) -> None:
    """Multiply the matrix with the first row of ``work``; write to the second row (collective).

    Dense blocks with other ranks are read once: receive the other ranks' vectors, multiply, and
    send the products back.
    """
    x, y = split.work[0], split.work[1]
    for k in range(len(y)):
        y[k] = 0.0
    multiply_blocks(split.blocks, split.data, x, y)
    if split.ranks.size > 1:
        sent, received = split.passing[0], split.passing[1]
        sent[:] = 0.0
        reduce(split.table, split.shares, x, sent, False)
        exchange(split.ranks, sent, split.lengths, received)
        sent[:] = 0.0
        expand_and_return(split.table, split.shares, received, x, y, sent)
        exchange(split.ranks, sent, split.lengths, received)
        add_at_places(split.table, received, y)


def _low_rank_product(split: LowRank, values: Floats, out: Floats) -> None:
    x, y = split.work[0], split.work[1]
    for k in range(len(values)):
        x[k] = values[split.order[k]]
    _multiply_blocks(split)
    for k in range(len(values)):
        at = split.order[k]
        out[at] = y[k] - values[at] if split.live[at] else 0.0


def multiply(split: Any, values: Floats, out: Floats) -> None:
    """Write S times values to ``out``, shape (m,) (collective)."""
    (_dense_product if isinstance(split, Dense) else _low_rank_product)(split, values, out)


@overload(multiply, strict=False)
def _(split: Any, values: Any, out: Any) -> Any:
    return _dense_product if split.instance_class is Dense else _low_rank_product


def _dense_cost(split: Dense, unknowns: int) -> float:
    return float(unknowns) * len(split.columns)


def _low_rank_cost(split: LowRank, unknowns: int) -> float:
    return split.entries


def cost(split: Any, unknowns: int) -> float:
    """Return the number of entries that a product with ``unknowns`` nonzero values reads."""
    return (_dense_cost if isinstance(split, Dense) else _low_rank_cost)(split, unknowns)


@overload(cost, strict=False)
def _(split: Any, unknowns: Any) -> Any:
    return _dense_cost if split.instance_class is Dense else _low_rank_cost


@part
def apply_blocks(blocks: Singles, values: NDArray[Any], out: NDArray[Any]) -> None:
    """Write the blocks times a vector (3 n,) to ``out``; blocks beyond n are ignored."""
    for i in range(len(values) // 3):
        t, a, b, c = blocks[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c


def _store_dense_part(split: Dense, kept: Kept) -> None:
    _copy_part(split.columns, kept, split.ranks, split.by_half)


def _store_low_rank_part(split: LowRank, kept: Kept) -> None:
    if _part_is_stored(split, kept):
        _copy_part(split.whole, kept, split.ranks, split.ranks.size == 1)


@part
def _part_is_stored(split: LowRank, kept: Kept) -> bool:
    """Return True if the part of S of a set is stored."""
    return len(split.whole) > 0 and 9.0 * float(kept.number[1]) ** 2 <= split.entries


@part
def _copy_part(matrix: NDArray[Any], kept: Kept, ranks: Ranks, by_half: bool) -> None:
    """Copy the set's columns for the local rows, only the lower half if ``by_half`` is True."""
    count, points = kept.number[0], kept.points
    all_points = kept.points if ranks.size == 1 else kept.numbers
    columns = kept.part[: 9 * kept.number[1] * count].reshape(3 * kept.number[1], 3 * count)
    for i in range(kept.number[1]):
        for a in range(3):
            line, out = matrix[3 * all_points[i] + a], columns[3 * i + a]
            for j in range(i + 1 if by_half else count):
                for b in range(3):
                    out[3 * j + b] = line[3 * points[j] + b]


def _store_part(split: Any, kept: Kept) -> None:
    (_store_dense_part if isinstance(split, Dense) else _store_low_rank_part)(split, kept)


@overload(_store_part, strict=False)
def _(split: Any, kept: Any) -> Any:
    return _store_dense_part if split.instance_class is Dense else _store_low_rank_part


@part
def keep(split: Any, kept: Kept, wanted: Ints, count: int) -> None:
    """Store the part of S of a set that contains the sorted ``wanted`` points (collective).

    A set that contains these points is kept. Otherwise the points are added to the set, or replace
    it if the set would become too large.
    """
    points, last_count, both, place = kept.points, kept.number[0], 0, 0
    for k in range(count):
        while place < last_count and points[place] < wanted[k]:
            place += 1
        both += place < last_count and points[place] == wanted[k]
    union = last_count + count - both
    if last_count >= 0:
        local_counts = np.array([float(last_count), float(count), float(both)])
        by_rank = allgather_values(split.ranks, local_counts)
        last_counts, counts, boths = by_rank[:, 0].sum(), by_rank[:, 1].sum(), by_rank[:, 2].sum()
        if boths == counts and last_counts <= limits.SET_EXCESS * counts + limits.SET_SPARE:
            return
        if last_counts + counts - boths > limits.SET_EXCESS * counts + limits.SET_SPARE:
            last_count = -1
    if last_count < 0:
        store(split, kept, wanted, count)
        return
    old, new = last_count - 1, count - 1
    for k in range(union - 1, -1, -1):
        if new < 0 or (old >= 0 and points[old] > wanted[new]):
            points[k], old = points[old], old - 1
        else:
            old -= old >= 0 and points[old] == wanted[new]
            points[k], new = wanted[new], new - 1
    store(split, kept, points, union)


@njit(cache=True)
def store(split: Any, kept: Kept, points: Ints, count: int) -> None:
    """Store the part of S of the given points (collective)."""
    kept.number[0], kept.number[1] = count, count
    for k in range(count):
        kept.points[k] = points[k]
    if split.ranks.size > 1:
        _gather_numbers(split, kept, count)
    _store_part(split, kept)


@part
def _gather_numbers(split: Any, kept: Kept, count: int) -> None:
    """Gather the numbers of the set's points on all ranks (collective)."""
    ranks = split.ranks
    by_rank = allgather_values(ranks, np.array([float(count), float(len(kept.points))]))
    counts, starts, total, before = kept.lengths.counts, kept.lengths.starts, 0, 0
    for r in range(ranks.size):
        counts[r], starts[r] = np.int32(8 * by_rank[r, 0]), np.int32(8 * total)
        before += int(by_rank[r, 1]) if r < ranks.rank else 0
        total += int(by_rank[r, 0])
    kept.number[1] = total
    if len(kept.numbers):
        allgather_parts(ranks, kept.points[:count] + before, kept.lengths, kept.numbers)
    for r in range(ranks.size):  # bytes of three float32 values instead of one int64 per point
        counts[r], starts[r] = counts[r] // 2 * 3, starts[r] // 2 * 3


@part
def _multiply_stored(
    ranks: Ranks, kept: Kept, values: Singles, out: Singles, by_half: bool
) -> None:
    """Write the stored part of S times values to ``out`` (collective)."""
    vector = allgather_parts(ranks, values, kept.lengths, kept.gathered)[: 3 * kept.number[1]]
    if len(values):
        size = len(vector) * len(values)
        columns = kept.part[:size].reshape(len(vector), len(values))
        if by_half:
            multiply_lower(columns, values, out)
        else:
            np.dot(vector, columns, out)


def _dense_part(split: Dense, kept: Kept, values: Singles, out: Singles) -> None:
    _multiply_stored(split.ranks, kept, values, out, split.by_half)


def _low_rank_part(split: LowRank, kept: Kept, values: Singles, out: Singles) -> None:
    if _part_is_stored(split, kept):
        _multiply_stored(split.ranks, kept, values, out, split.ranks.size == 1)
        return
    x, y, rows = split.work[0], split.work[1], split.rows
    for k in range(len(x)):
        x[k] = 0.0
    for i in range(kept.number[0]):
        for a in range(3):
            x[rows[3 * kept.points[i] + a]] = values[3 * i + a]
    _multiply_blocks(split)
    for i in range(kept.number[0]):
        for a in range(3):
            k = 3 * kept.points[i] + a
            out[3 * i + a] = y[rows[k]] - values[3 * i + a] if split.live[k] else 0.0


def multiply_part(split: Any, kept: Kept, values: Singles, out: Singles) -> None:
    """Write the part of S of the set times values to ``out``, shape (3 number,) (collective)."""
    (_dense_part if isinstance(split, Dense) else _low_rank_part)(split, kept, values, out)


@overload(multiply_part, strict=False)
def _(split: Any, kept: Any, values: Any, out: Any) -> Any:
    return _dense_part if split.instance_class is Dense else _low_rank_part


@njit(cache=True, no_cfunc_wrapper=True)
def multiply_whole(split: Any, values: Floats, out: Floats) -> None:
    """Write S times values to ``out``, for calls from Python (collective)."""
    multiply(split, values, out)
