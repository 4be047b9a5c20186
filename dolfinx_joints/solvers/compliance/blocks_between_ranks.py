# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loops over the blocks between a rank's points and the points of other ranks.

The table has a row per block: first unknown, number of unknowns, rows of the factor, kind, and
position of the block's values in the exchanged array. The factors are stored one after the other.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers.compliance.own_blocks import SUMS, dense_and_mirror

# Kind of data that a rank stores for a block shared with another rank: a factor; the whole dense
# block, transposed; or only the position of the unknowns.
FACTOR, DENSE, PLACE = 0, 1, 2


@njit(cache=True, fastmath=SUMS)
def reduce(
    table: Ints, data: NDArray[Any], x: NDArray[Any], out: NDArray[Any], dense: bool
) -> None:
    """Write the values to be sent: factors times the blocks' parts of x, or these parts of x.

    Products with factors are added to ``out``. Dense blocks are included only if ``dense`` is True.
    """
    start = 0
    for b in range(len(table)):
        first, unknowns, rows, kind, at = table[b]
        if kind == PLACE:
            out[at : at + unknowns] = x[first : first + unknowns]
            continue
        if kind == FACTOR or dense:
            factor = data[start : start + rows * unknowns].reshape(rows, unknowns)
            x_block, sums = x[first : first + unknowns], out[at : at + rows]
            for k in range(rows):
                row, total = factor[k], data.dtype.type(0.0)
                for j in range(row.size):
                    total += row[j] * x_block[j]
                sums[k] += total
        start += rows * unknowns


@njit(cache=True, fastmath=SUMS)
def expand(table: Ints, data: NDArray[Any], values: NDArray[Any], y: NDArray[Any]) -> None:
    """Add the received values to y, multiplied by the transposed factors where they exist."""
    start = 0
    for b in range(len(table)):
        first, unknowns, rows, kind, at = table[b]
        if kind == PLACE:
            y[first : first + unknowns] += values[at : at + unknowns]
            continue
        factor = data[start : start + rows * unknowns].reshape(rows, unknowns)
        _add_transposed(factor, values[at : at + rows], y[first : first + unknowns])
        start += rows * unknowns


@njit(cache=True, fastmath=SUMS)
def _add_transposed(factor: NDArray[Any], values: NDArray[Any], y: NDArray[Any]) -> None:
    for k in range(len(factor)):
        row, value = factor[k], values[k]
        for j in range(row.size):
            y[j] += row[j] * value


@njit(cache=True, fastmath=SUMS)
def expand_and_return(
    table: Ints,
    data: NDArray[Any],
    values: NDArray[Any],
    x: NDArray[Any],
    y: NDArray[Any],
    back: NDArray[Any],
) -> None:
    """Do `expand` except for `PLACE`, and add products of dense blocks with x to ``back``."""
    start = 0
    for b in range(len(table)):
        first, unknowns, rows, kind, at = table[b]
        if kind == PLACE:
            continue
        factor = data[start : start + rows * unknowns].reshape(rows, unknowns)
        x_rows, out = values[at : at + rows], y[first : first + unknowns]
        if kind == DENSE:
            dense_and_mirror(factor, x[first : first + unknowns], x_rows, back[at : at + rows], out)
        else:
            _add_transposed(factor, x_rows, out)
        start += rows * unknowns


@njit(cache=True)
def add_at_places(table: Ints, values: NDArray[Any], y: NDArray[Any]) -> None:
    """Add the returned values of blocks of kind `PLACE` to y."""
    for b in range(len(table)):
        first, unknowns, _, kind, at = table[b]
        if kind == PLACE:
            y[first : first + unknowns] += values[at : at + unknowns]
