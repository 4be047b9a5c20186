# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products with S, the compliance less its diagonal, and with parts of it kept in single precision.

S is `Dense` or `LowRank`; which, is settled when a function that multiplies is compiled. Vectors
are those of the rank's unknowns, m of them; of all ranks there are M.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

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
    each_of_ranks,
    exchange,
    lengths_of,
    put_together,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Singles = NDArray[np.float32]


class Dense(NamedTuple):
    """S as it stands.

    Attributes:
        ranks: The ranks.
        columns: Columns of the rank's rows, one after the other, shape (M, m).
        by_half: Whether products read half of it: it is symmetric, and of one rank.
        work: Room for a vector and a product, shape (2, m), of the type of the columns.
        nonzero: Room for numbers of unknowns, shape (M,).
        lengths: Of vectors.
        every: Room for one of all ranks, shape (M,), on several.
    """

    ranks: Ranks
    columns: NDArray[Any]
    by_half: bool
    work: NDArray[Any]
    nonzero: Ints
    lengths: Lengths
    every: Floats


class LowRank(NamedTuple):
    """S in the blocks of a `LowRankMatrix`, which have its unit diagonal as well.

    Attributes:
        ranks: The ranks.
        blocks: Table of the blocks of the rank's points among themselves.
        data: Their entries.
        table: Of the blocks with points of other ranks, as of `LowRankMatrix`.
        shares: Entries that the rank has of those.
        lengths: Of what passes between it and each other.
        passing: Room for that, shape (2, n).
        order: Unknowns in the order of the blocks, shape (m,).
        rows: Place of each unknown in that order, shape (m,).
        live: Whether an unknown can move, shape (m,).
        work: Room for a vector and a product, shape (2, m), of the type of the entries.
        entries: Of all ranks.
        whole: S as it stands for small sets, which read less of it than the blocks have, as the
            columns of `Dense`; shape (M, m) or (0, 0).
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
    """A set of points with its part of S, kept while the points asked for are among them.

    Attributes:
        points: Numbers of the rank's, in order, the first entries, shape (points,).
        number: How many, -1 before the first set, and of all ranks, shape (2,).
        lengths: Of vectors over the set, in single precision.
        every: Room for such a vector of all ranks, shape (M,), where there is a part and more than
            one of them.
        numbers: Numbers of their points among all, likewise, shape (M / 3,).
        part: Columns of the set, of the rank's rows in it, the first entries; of a `LowRank` S
            where those are no more than it has.
    """

    points: Ints
    number: Ints
    lengths: Lengths
    every: Singles
    numbers: Ints
    part: Singles


def kept_of(points: int, every: int, split: Dense | LowRank) -> Kept:
    """Room for sets of so many points of the rank, and of all."""
    most, ranks = every, split.ranks.size
    if isinstance(split, LowRank):
        most = min(every, int(np.sqrt(split.entries) / 3.0)) if len(split.whole) else 0
    several = every if ranks > 1 and most > 0 else 0
    return Kept(
        np.zeros(points, dtype=np.int64),
        np.array([-1, 0]),
        lengths_of(np.zeros(ranks)),
        np.empty(3 * several, dtype=np.float32),
        np.empty(several, dtype=np.int64),
        np.empty(9 * most * min(points, most), dtype=np.float32),
    )


def _dense_product(split: Dense, values: Floats, out: Floats) -> None:
    every = put_together(split.ranks, values, split.lengths, split.every)
    count, product = 0, split.work[1]
    for k in range(len(every)):
        if every[k] != 0.0:
            split.nonzero[count] = k
            count += 1
    if split.by_half and count > limits.NONZERO_SHARE * len(every):
        for k in range(len(values)):
            split.work[0, k] = values[k]
        multiply_lower(split.columns, split.work[0], product)
    else:
        for k in range(len(product)):
            product[k] = 0.0
        add_rows(split.columns, split.nonzero[:count], every, product)
    for k in range(len(product)):
        out[k] = product[k]


@part
def _multiply_blocks(split: LowRank) -> None:
    """The matrix times the first row of the room, to the second (collective).

    Dense blocks with other ranks are read once: what they are multiplied with comes first, and what
    they give goes back.
    """
    x, y = split.work[0], split.work[1]
    for k in range(len(y)):
        y[k] = 0.0
    multiply_blocks(split.blocks, split.data, x, y)
    if split.ranks.size > 1:
        gone, come = split.passing[0], split.passing[1]
        gone[:] = 0.0
        reduce(split.table, split.shares, x, gone, False)
        exchange(split.ranks, gone, split.lengths, come)
        gone[:] = 0.0
        expand_and_return(split.table, split.shares, come, x, y, gone)
        exchange(split.ranks, gone, split.lengths, come)
        add_at_places(split.table, come, y)


def _low_rank_product(split: LowRank, values: Floats, out: Floats) -> None:
    x, y = split.work[0], split.work[1]
    for k in range(len(values)):
        x[k] = values[split.order[k]]
    _multiply_blocks(split)
    for k in range(len(values)):
        at = split.order[k]
        out[at] = y[k] - values[at] if split.live[at] else 0.0


def multiply(split: Any, values: Floats, out: Floats) -> None:
    """S times values, shape (m,) (collective)."""
    (_dense_product if isinstance(split, Dense) else _low_rank_product)(split, values, out)


@overload(multiply, strict=False)
def _(split: Any, values: Any, out: Any) -> Any:
    return _dense_product if split.instance_class is Dense else _low_rank_product


def _dense_cost(split: Dense, unknowns: int) -> float:
    return float(unknowns) * len(split.columns)


def _low_rank_cost(split: LowRank, unknowns: int) -> float:
    return split.entries


def cost(split: Any, unknowns: int) -> float:
    """Entries that a product with so many nonzero values reads, both of all ranks."""
    return (_dense_cost if isinstance(split, Dense) else _low_rank_cost)(split, unknowns)


@overload(cost, strict=False)
def _(split: Any, unknowns: Any) -> Any:
    return _dense_cost if split.instance_class is Dense else _low_rank_cost


@part
def turn(blocks: Singles, values: NDArray[Any], out: NDArray[Any]) -> None:
    """Blocks, of which there may be more, times a vector (3 n,)."""
    for i in range(len(values) // 3):
        t, a, b, c = blocks[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c


def _hold_dense(split: Dense, kept: Kept) -> None:
    _pick(split.columns, kept, split.ranks, split.by_half)


def _hold_low_rank(split: LowRank, kept: Kept) -> None:
    if _is_held(split, kept):
        _pick(split.whole, kept, split.ranks, split.ranks.size == 1)


@part
def _is_held(split: LowRank, kept: Kept) -> bool:
    """Whether the part of a set is kept."""
    return len(split.whole) > 0 and 9.0 * float(kept.number[1]) ** 2 <= split.entries


@part
def _pick(matrix: NDArray[Any], kept: Kept, ranks: Ranks, by_half: bool) -> None:
    """Columns of the points kept, of the rank's rows among them; the lower half if that will do."""
    count, points = kept.number[0], kept.points
    every = kept.points if ranks.size == 1 else kept.numbers
    columns = kept.part[: 9 * kept.number[1] * count].reshape(3 * kept.number[1], 3 * count)
    for i in range(kept.number[1]):
        for a in range(3):
            line, out = matrix[3 * every[i] + a], columns[3 * i + a]
            for j in range(i + 1 if by_half else count):
                for b in range(3):
                    out[3 * j + b] = line[3 * points[j] + b]


def _hold(split: Any, kept: Kept) -> None:
    (_hold_dense if isinstance(split, Dense) else _hold_low_rank)(split, kept)


@overload(_hold, strict=False)
def _(split: Any, kept: Any) -> Any:
    return _hold_dense if split.instance_class is Dense else _hold_low_rank


@part
def hold(split: Any, kept: Kept, wanted: Ints, count: int) -> None:
    """Keep the parts of a set that contains the wanted points, which are sorted.

    The kept set stays if it contains them; else they join it, or replace it if it grows too large.

    (Collective.)
    """
    points, known, both, place = kept.points, kept.number[0], 0, 0
    for k in range(count):
        while place < known and points[place] < wanted[k]:
            place += 1
        both += place < known and points[place] == wanted[k]
    union = known + count - both
    if known >= 0:
        mine = np.array([float(known), float(count), float(both)])
        every = each_of_ranks(split.ranks, mine)
        knowns, counts, boths = every[:, 0].sum(), every[:, 1].sum(), every[:, 2].sum()
        if boths == counts and knowns <= limits.SET_EXCESS * counts + limits.SET_SPARE:
            return
        if knowns + counts - boths > limits.SET_EXCESS * counts + limits.SET_SPARE:
            known = -1
    if known < 0:
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
    """Keep these points (collective)."""
    kept.number[0], kept.number[1] = count, count
    for k in range(count):
        kept.points[k] = points[k]
    if split.ranks.size > 1:
        _tell(split, kept, count)
    _hold(split, kept)


@part
def _tell(split: Any, kept: Kept, count: int) -> None:
    """Numbers of the points kept, to all ranks (collective)."""
    ranks = split.ranks
    every = each_of_ranks(ranks, np.array([float(count), float(len(kept.points))]))
    counts, starts, total, before = kept.lengths.counts, kept.lengths.starts, 0, 0
    for r in range(ranks.size):
        counts[r], starts[r] = np.int32(8 * every[r, 0]), np.int32(8 * total)
        before += int(every[r, 1]) if r < ranks.rank else 0
        total += int(every[r, 0])
    kept.number[1] = total
    if len(kept.numbers):
        put_together(ranks, kept.points[:count] + before, kept.lengths, kept.numbers)
    for r in range(ranks.size):  # of three numbers of four bytes instead of one of eight
        counts[r], starts[r] = counts[r] // 2 * 3, starts[r] // 2 * 3


@part
def _multiply_kept(ranks: Ranks, kept: Kept, values: Singles, out: Singles, by_half: bool) -> None:
    """The part that is kept times values."""
    every = put_together(ranks, values, kept.lengths, kept.every)[: 3 * kept.number[1]]
    if len(values):
        size = len(every) * len(values)
        columns = kept.part[:size].reshape(len(every), len(values))
        if by_half:
            multiply_lower(columns, values, out)
        else:
            np.dot(every, columns, out)


def _dense_part(split: Dense, kept: Kept, values: Singles, out: Singles) -> None:
    _multiply_kept(split.ranks, kept, values, out, split.by_half)


def _low_rank_part(split: LowRank, kept: Kept, values: Singles, out: Singles) -> None:
    if _is_held(split, kept):
        _multiply_kept(split.ranks, kept, values, out, split.ranks.size == 1)
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
    """The kept part of S times values, shape (3 number,) (collective)."""
    (_dense_part if isinstance(split, Dense) else _low_rank_part)(split, kept, values, out)


@overload(multiply_part, strict=False)
def _(split: Any, kept: Any, values: Any, out: Any) -> Any:
    return _dense_part if split.instance_class is Dense else _low_rank_part


@njit(cache=True, no_cfunc_wrapper=True)
def multiply_whole(split: Any, values: Floats, out: Floats) -> None:
    """Write S times values to ``out``, for calls from Python (collective)."""
    multiply(split, values, out)
