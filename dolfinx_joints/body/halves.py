# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""M and K of a body in space as half of their blocks, read once for the products of both.

Steps wait for these products, which take what reading the matrices takes: 84 bytes for two blocks
of K and of M, where PETSc reads 224. What is not read leaves the factor in the processor's cache.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.kernels import njit

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]

# What assembly may leave of the symmetry of K, of the diagonal of both nodes, and of M, of all.
ROUNDING = 1e-13

# Entries of K above which products are a small part of a step, and copies of K take memory.
MOST_ENTRIES = 10_000_000


class Halves:
    """Blocks of M and K on their diagonals and right of them, by nodes.

    Args:
        starts: First block of each node, and their number at the end, shape (nodes + 1,).
        columns: Node that each block multiplies, that of the diagonal first, shape (blocks,).
        blocks: Nine entries of K and the one that M has three times, shape (blocks, 10).
        rest: What M has besides, as added masses on inclined faces; None for nothing.
    """

    def __init__(
        self, starts: Indices, columns: Indices, blocks: Floats, rest: PETSc.Mat | None
    ) -> None:
        """Keep the arrays."""
        self._arrays, self._rest = (starts, columns, blocks), rest

    @classmethod
    def of(cls, mass: PETSc.Mat, stiffness: PETSc.Mat) -> Self | None:
        """Halves of two matrices; None where they have none, or are to be left to PETSc.

        That is on several ranks, in the plane, above `MOST_ENTRIES`, and where K or M is not
        symmetric.
        """
        several = stiffness.comm.size > 1 or stiffness.getBlockSize() != 3
        if several or stiffness.getInfo()["nz_used"] > MOST_ENTRIES:
            return None
        k, m = _by_nodes(stiffness), _by_nodes(mass)
        once, places, of_mass = m.data[:, 0, 0], _places(k), _places(m)
        at = np.minimum(np.searchsorted(places, of_mass), len(places) - 1)
        alike = np.all(m.data == once[:, None, None] * np.eye(3), axis=(1, 2))
        taken = alike & (places[at] == of_mass)
        blocks = np.zeros((len(places), 10))
        blocks[:, :9] = k.data.reshape(-1, 9)
        blocks[at[taken], 9] = once[taken]
        nodes = k.shape[0] // 3
        rows, columns = np.divmod(places, nodes)
        turned = np.searchsorted(places, columns * nodes + rows)
        there = np.append(places, -1)[turned] == columns * nodes + rows
        flipped = [0, 3, 6, 1, 4, 7, 2, 5, 8, 9]
        if not np.all(there) or np.count_nonzero(rows == columns) < nodes:
            return None
        error = np.abs(blocks[turned][:, flipped] - blocks)
        own = np.sqrt(np.abs(blocks[rows == columns, :9]).max(axis=1))
        if np.any(error[:, :9].max(axis=1) > ROUNDING * own[rows] * own[columns]):
            return None
        if error[:, 9].max() > ROUNDING * once.max():
            return None
        right = columns >= rows
        starts = np.append(0, np.cumsum(np.bincount(rows[right], minlength=nodes)))
        m.data[taken] = 0.0
        return cls(
            starts.astype(np.uint32), columns[right].astype(np.uint32), blocks[right], _rest(m)
        )

    def multiply(self, x: PETSc.Vec, mass: PETSc.Vec, stiffness: PETSc.Vec) -> None:
        """M x and K x written to ``mass`` and ``stiffness``."""
        mass.set(0.0)
        stiffness.set(0.0)
        each = (x.getArray(readonly=True), mass.getArray(), stiffness.getArray())
        _multiply(*self._arrays, *(values.reshape(-1, 3) for values in each))
        if self._rest is not None:
            self._rest.multAdd(x, mass, mass)


def _by_nodes(matrix: PETSc.Mat) -> Any:
    """The matrix of this process in blocks of three, sorted."""
    single = matrix.convert("aij", PETSc.Mat())
    starts, columns, values = single.getValuesCSR()
    single.destroy()
    blocks = sp.csr_matrix((values, columns, starts), shape=matrix.getSize()).tobsr((3, 3))
    blocks.sort_indices()
    return blocks


def _places(blocks: Any) -> NDArray[np.int64]:
    """Row times the number of nodes, plus column, of each block; they grow."""
    nodes = len(blocks.indptr) - 1
    return np.repeat(np.arange(nodes), np.diff(blocks.indptr)) * nodes + blocks.indices


def _rest(blocks: Any) -> PETSc.Mat | None:
    """A matrix of the entries that are not zero, if there are any."""
    single = blocks.tocsr()
    single.eliminate_zeros()
    if not single.nnz:
        return None
    parts = single.indptr.astype(PETSc.IntType), single.indices.astype(PETSc.IntType), single.data
    rest = PETSc.Mat().createAIJ(single.shape, csr=parts, comm=PETSc.COMM_SELF)
    rest.assemble()
    return rest


@njit(cache=True, fastmath={"contract"})
def _multiply(
    starts: Indices, columns: Indices, blocks: Floats, x: Floats, mass: Floats, stiffness: Floats
) -> None:
    """Add M x and K x: each block multiplies, and off the diagonal its transpose as well."""
    for i in range(len(starts) - 1):
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        first = starts[i]
        k, m = blocks[first], blocks[first, 9]
        s0 = stiffness[i, 0] + k[0] * x0 + k[1] * x1 + k[2] * x2
        s1 = stiffness[i, 1] + k[3] * x0 + k[4] * x1 + k[5] * x2
        s2 = stiffness[i, 2] + k[6] * x0 + k[7] * x1 + k[8] * x2
        m0, m1, m2 = mass[i, 0] + m * x0, mass[i, 1] + m * x1, mass[i, 2] + m * x2
        for at in range(first + np.uint32(1), starts[i + 1]):
            j = columns[at]
            k, m = blocks[at], blocks[at, 9]
            y0, y1, y2 = x[j, 0], x[j, 1], x[j, 2]
            s0 += k[0] * y0 + k[1] * y1 + k[2] * y2
            s1 += k[3] * y0 + k[4] * y1 + k[5] * y2
            s2 += k[6] * y0 + k[7] * y1 + k[8] * y2
            stiffness[j, 0] += k[0] * x0 + k[3] * x1 + k[6] * x2
            stiffness[j, 1] += k[1] * x0 + k[4] * x1 + k[7] * x2
            stiffness[j, 2] += k[2] * x0 + k[5] * x1 + k[8] * x2
            m0, m1, m2 = m0 + m * y0, m1 + m * y1, m2 + m * y2
            mass[j, 0] += m * x0
            mass[j, 1] += m * x1
            mass[j, 2] += m * x2
        stiffness[i, 0], stiffness[i, 1], stiffness[i, 2] = s0, s1, s2
        mass[i, 0], mass[i, 1], mass[i, 2] = m0, m1, m2
