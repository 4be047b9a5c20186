# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""M and K of a body in space as half of their blocks, read once for the products of both.

Steps wait for these products, which take what reading the matrices takes: 84 bytes for two blocks
of K and of M, where PETSc reads 224. What is not read leaves the factor in the processor's cache.
Blocks between nodes of two ranks are on both, as they are multiplied.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.matrices import from_rows
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.mesh.cells import Floats, Ints

Indices = NDArray[np.uint32]

# Rounding error that assembly may leave in an entry, relative to the diagonal of its nodes (in the
# symmetry of M: to the largest entry). An entry sums the shares of up to some hundred cells in an
# order that depends on processor and ranks, each rounded to 1.1e-16: the sum errs by about 1e-14 at
# most. A real difference of 1e-13 would change a product by no more than rounding does.
ROUNDING = 1e-13

# Entries of K above which products are a small part of a step, and copies of K take memory.
MOST_ENTRIES = 10_000_000


class Halves:
    """Blocks of M and K on their diagonals and right of them, by nodes.

    Args:
        starts: First block of each node of this rank, and their number at the end, shape
            (nodes + 1,).
        columns: Node that each block multiplies, that of the diagonal first, shape (blocks,).
        blocks: Nine entries of K and the one that M has three times, shape (blocks, 10).
        others: Blocks with nodes of other ranks; None on one rank.
        rest: What M has besides, as added masses on inclined faces; None for nothing.
    """

    def __init__(
        self,
        starts: Indices,
        columns: Indices,
        blocks: Floats,
        others: Others | None,
        rest: PETSc.Mat | None,
    ) -> None:
        """Keep the arrays."""
        self._arrays, self._others, self._rest = (starts, columns, blocks), others, rest

    @classmethod
    def of(cls, mass: PETSc.Mat, stiffness: PETSc.Mat) -> Self | None:
        """Halves of two matrices (collective).

        None where they have none, or are to be left to PETSc: in the plane, above `MOST_ENTRIES`,
        and where K or M is not symmetric.
        """
        comm = stiffness.comm.tompi4py()
        entries = stiffness.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
        if stiffness.getBlockSize() != 3 or entries > MOST_ENTRIES:
            return None
        k, m = _by_nodes(stiffness), _by_nodes(mass)
        once, places, of_mass = m.data[:, 0, 0], _places(k), _places(m)
        at = np.minimum(np.searchsorted(places, of_mass), len(places) - 1)
        nodes, first = k.shape[0] // 3, stiffness.getOwnershipRange()[0] // 3
        taken = _is_isotropic(m, of_mass, nodes, first) & (places[at] == of_mass)
        blocks = np.zeros((len(places), 10))
        blocks[:, :9] = k.data.reshape(-1, 9)
        blocks[at[taken], 9] = once[taken]
        rows, columns = np.divmod(places, k.shape[1] // 3)
        columns -= first
        here = (columns >= 0) & (columns < nodes)
        inner = rows[here], columns[here], blocks[here]
        if not all(comm.allgather(_is_symmetric(*inner, nodes, once.max(initial=0.0)))):
            return None
        m.data[taken] = 0.0
        others = None
        if comm.size > 1:
            outer = rows[~here], columns[~here] + first, blocks[~here]
            others = Others(*outer, nodes, stiffness.createVecRight())
        right = here & (columns >= rows)
        return cls(
            _starts(rows[right], nodes),
            columns[right].astype(np.uint32),
            blocks[right],
            others,
            _rest(m, mass),
        )

    def multiply(self, x: PETSc.Vec, mass: PETSc.Vec, stiffness: PETSc.Vec) -> None:
        """M x and K x written to ``mass`` and ``stiffness`` (collective)."""
        mass.set(0.0)
        stiffness.set(0.0)
        each = (x.getArray(readonly=True), mass.getArray(), stiffness.getArray())
        own, into_mass, into_stiffness = (values.reshape(-1, 3) for values in each)
        if self._others is not None:
            self._others.ask(x)
        _multiply(*self._arrays, own, into_mass, into_stiffness)
        if self._others is not None:
            self._others.add(x, into_mass, into_stiffness)
        if self._rest is not None:
            self._rest.multAdd(x, mass, mass)


class Others:
    """Blocks of this rank's nodes with those of other ranks, as in `Halves`.

    Rows are nodes of this rank, in order, and columns nodes among those of all ranks, both of
    shape (blocks,); ``nodes`` is the number of this rank's nodes, ``like`` a vector of values.
    """

    def __init__(
        self,
        rows: Ints,
        columns: Ints,
        blocks: Floats,
        nodes: int,
        like: PETSc.Vec,
    ) -> None:
        """Settle what comes from which rank (collective)."""
        asked, place = np.unique(columns, return_inverse=True)
        self._arrays = _starts(rows, nodes), place.ravel().astype(np.uint32), blocks
        self._values = PETSc.Vec().createSeq(3 * len(asked), comm=PETSc.COMM_SELF)
        wanted = PETSc.IS().createBlock(3, asked.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(like, wanted, self._values, None)

    def ask(self, x: PETSc.Vec) -> None:
        """Ask other ranks for their values (collective)."""
        self._scatter.begin(x, self._values)

    def add(self, x: PETSc.Vec, mass: Floats, stiffness: Floats) -> None:
        """Add the products with them, shape (nodes, 3) (collective)."""
        self._scatter.end(x, self._values)
        values = self._values.getArray(readonly=True).reshape(-1, 3)
        _multiply_others(*self._arrays, values, mass, stiffness)


def _is_isotropic(blocks: Any, places: Ints, nodes: int, first: int) -> NDArray[np.bool_]:
    """Return True for each block of M that is a multiple of the identity to rounding.

    The rank has so many ``nodes`` from the ``first`` on; ``places`` are those of `_places`.
    """
    rows, columns = np.divmod(places, blocks.shape[1] // 3)
    diagonal, sizes = columns - first == rows, np.abs(blocks.data).max(axis=(1, 2))
    of_node = np.zeros(nodes)
    of_node[rows[diagonal]] = sizes[diagonal]
    error = np.abs(blocks.data - blocks.data[:, :1, :1] * np.eye(3)).max(axis=(1, 2))
    isotropic: NDArray[np.bool_] = error <= ROUNDING * of_node[rows]
    return isotropic


def _is_symmetric(rows: Ints, columns: Ints, blocks: Floats, nodes: int, largest: float) -> bool:
    """Whether blocks of a rank's nodes, sorted, are those of symmetric K and M to rounding.

    The largest entry of M is given.
    """
    places = rows * nodes + columns
    turned = np.searchsorted(places, columns * nodes + rows)
    there = np.append(places, -1)[turned] == columns * nodes + rows
    flipped = [0, 3, 6, 1, 4, 7, 2, 5, 8, 9]
    if not np.all(there) or np.count_nonzero(rows == columns) < nodes:
        return False
    error = np.abs(blocks[turned][:, flipped] - blocks)
    own = np.sqrt(np.abs(blocks[rows == columns, :9]).max(axis=1))
    if np.any(error[:, :9].max(axis=1) > ROUNDING * own[rows] * own[columns]):
        return False
    return bool(error[:, 9].max(initial=0.0) <= ROUNDING * largest)


def _by_nodes(matrix: PETSc.Mat) -> Any:
    """The rows of this rank in blocks of three, sorted."""
    single = matrix.convert("aij", PETSc.Mat())
    starts, columns, values = single.getValuesCSR()
    single.destroy()
    shape = matrix.getLocalSize()[0], matrix.getSize()[1]
    blocks = sp.csr_matrix((values, columns, starts), shape=shape).tobsr((3, 3))
    blocks.sort_indices()
    return blocks


def _places(blocks: Any) -> Ints:
    """Row times the number of columns, plus column, of each block; they grow."""
    rows = np.repeat(np.arange(len(blocks.indptr) - 1), np.diff(blocks.indptr))
    return rows * (blocks.shape[1] // 3) + blocks.indices


def _starts(rows: Ints, nodes: int) -> Indices:
    """First block of each row, and their number at the end."""
    return np.append(0, np.cumsum(np.bincount(rows, minlength=nodes))).astype(np.uint32)


def _rest(blocks: Any, like: PETSc.Mat) -> PETSc.Mat | None:
    """A matrix of the entries that are not zero, if there are any (collective)."""
    single = blocks.tocsr()
    single.eliminate_zeros()
    if not any(like.comm.tompi4py().allgather(single.nnz)):
        return None
    return from_rows(like.getSizes(), (single.indptr, single.indices, single.data), like.comm)


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


@njit(cache=True, fastmath={"contract"})
def _multiply_others(
    starts: Indices, columns: Indices, blocks: Floats, x: Floats, mass: Floats, stiffness: Floats
) -> None:
    """Add M x and K x of blocks that multiply once, x of the columns."""
    for i in range(len(starts) - 1):
        for at in range(starts[i], starts[i + 1]):
            k, j = blocks[at], columns[at]
            for a in range(3):
                total = k[3 * a] * x[j, 0] + k[3 * a + 1] * x[j, 1] + k[3 * a + 2] * x[j, 2]
                stiffness[i, a] += total
                mass[i, a] += k[9] * x[j, a]
