# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fast products with the symmetric M and K of a 3-D body, of which the upper halves are stored.

One pass over the matrices computes both products. Memory access limits their speed: 84 bytes are
read for two blocks of K and M, compared with 224 in PETSc. Reading less also keeps the factor in
the processor's cache. Blocks between nodes of two ranks are stored on both ranks.
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

# Bound of the rounding error of an assembled entry, relative to the diagonal of its nodes (symmetry
# of M: to the largest entry). An entry is a sum of up to some hundred terms, in an order that
# depends on processor and ranks. Each term has an error of 1.1e-16, the sum at most about 1e-14. A
# real asymmetry of 1e-13 changes a product by no more than rounding error.
ROUNDING = 1e-13

# With more entries of K, products are a small part of a step and the copy needs much memory.
MOST_ENTRIES = 10_000_000


class Halves:
    """Upper halves of M and K, diagonal included, as 3 x 3 blocks of nodes.

    Args:
        starts: First block of each node of this rank, and the number of blocks, (nodes + 1,).
        columns: Node that each block multiplies, diagonal block first, shape (blocks,).
        blocks: Nine entries of K and the diagonal entry of M, shape (blocks, 10).
        others: Blocks between nodes of this rank and other ranks; None on one rank.
        remainder: Anisotropic blocks of M, such as added masses on inclined faces, or None.
    """

    def __init__(
        self,
        starts: Indices,
        columns: Indices,
        blocks: Floats,
        others: Others | None,
        remainder: PETSc.Mat | None,
    ) -> None:
        self._arrays, self._others, self._remainder = (starts, columns, blocks), others, remainder

    @classmethod
    def of(cls, mass: PETSc.Mat, stiffness: PETSc.Mat) -> Self | None:
        """Return the halves of two matrices (collective).

        Return None in 2-D, above `MOST_ENTRIES`, and if K or M is not symmetric; PETSc then
        computes the products.
        """
        comm = stiffness.comm.tompi4py()
        entries = stiffness.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"]
        if stiffness.getBlockSize() != 3 or entries > MOST_ENTRIES:
            return None
        k, m = _by_nodes(stiffness), _by_nodes(mass)
        mass_entries, places, of_mass = m.data[:, 0, 0], _places(k), _places(m)
        at = np.minimum(np.searchsorted(places, of_mass), len(places) - 1)
        nodes, first = k.shape[0] // 3, stiffness.getOwnershipRange()[0] // 3
        isotropic = _is_isotropic(m, of_mass, nodes, first) & (places[at] == of_mass)
        blocks = np.zeros((len(places), 10))
        blocks[:, :9] = k.data.reshape(-1, 9)
        blocks[at[isotropic], 9] = mass_entries[isotropic]
        rows, columns = np.divmod(places, k.shape[1] // 3)
        columns -= first
        owned = (columns >= 0) & (columns < nodes)
        inner = rows[owned], columns[owned], blocks[owned]
        if not all(comm.allgather(_is_symmetric(*inner, nodes, mass_entries.max(initial=0.0)))):
            return None
        m.data[isotropic] = 0.0
        others = None
        if comm.size > 1:
            outer = rows[~owned], columns[~owned] + first, blocks[~owned]
            others = Others(*outer, nodes, stiffness.createVecRight())
        upper = owned & (columns >= rows)
        return cls(
            _starts(rows[upper], nodes),
            columns[upper].astype(np.uint32),
            blocks[upper],
            others,
            _nonzero(m, mass),
        )

    def multiply(self, x: PETSc.Vec, mass: PETSc.Vec, stiffness: PETSc.Vec) -> None:
        """Write M x to ``mass`` and K x to ``stiffness`` (collective)."""
        mass.set(0.0)
        stiffness.set(0.0)
        arrays = (x.getArray(readonly=True), mass.getArray(), stiffness.getArray())
        x_nodes, mass_x, stiffness_x = (values.reshape(-1, 3) for values in arrays)
        if self._others is not None:
            self._others.begin(x)
        _multiply(*self._arrays, x_nodes, mass_x, stiffness_x)
        if self._others is not None:
            self._others.add(x, mass_x, stiffness_x)
        if self._remainder is not None:
            self._remainder.multAdd(x, mass, mass)


class Others:
    """Blocks between nodes of this rank and of other ranks, as in `Halves`.

    ``rows`` are local nodes, ascending, and ``columns`` global nodes, both of shape (blocks,).
    ``nodes`` is the number of nodes of this rank, ``like`` a vector with the layout of x.
    """

    def __init__(
        self, rows: Ints, columns: Ints, blocks: Floats, nodes: int, like: PETSc.Vec
    ) -> None:
        """Set up the exchange between the ranks (collective)."""
        numbers, place = np.unique(columns, return_inverse=True)
        self._arrays = _starts(rows, nodes), place.ravel().astype(np.uint32), blocks
        self._values = PETSc.Vec().createSeq(3 * len(numbers), comm=PETSc.COMM_SELF)
        indices = PETSc.IS().createBlock(3, numbers.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(like, indices, self._values, None)

    def begin(self, x: PETSc.Vec) -> None:
        """Begin the exchange of values with other ranks (collective)."""
        self._scatter.begin(x, self._values)

    def add(self, x: PETSc.Vec, mass: Floats, stiffness: Floats) -> None:
        """Finish the exchange and add the products, shape (nodes, 3) (collective)."""
        self._scatter.end(x, self._values)
        values = self._values.getArray(readonly=True).reshape(-1, 3)
        _multiply_others(*self._arrays, values, mass, stiffness)


def _is_isotropic(blocks: Any, places: Ints, nodes: int, first: int) -> NDArray[np.bool_]:
    """Return True for blocks of M that are a multiple of the identity to rounding, (blocks,).

    ``first`` is the first of the ``nodes`` nodes of the rank; `_places` returns ``places``.
    """
    rows, columns = np.divmod(places, blocks.shape[1] // 3)
    diagonal, sizes = columns - first == rows, np.abs(blocks.data).max(axis=(1, 2))
    of_node = np.zeros(nodes)
    of_node[rows[diagonal]] = sizes[diagonal]
    error = np.abs(blocks.data - blocks.data[:, :1, :1] * np.eye(3)).max(axis=(1, 2))
    isotropic: NDArray[np.bool_] = error <= ROUNDING * of_node[rows]
    return isotropic


def _is_symmetric(rows: Ints, columns: Ints, blocks: Floats, nodes: int, largest: float) -> bool:
    """Return True if K and M are symmetric to rounding, given the sorted blocks of a rank.

    ``largest`` is the largest entry of M.
    """
    places = rows * nodes + columns
    transposed = np.searchsorted(places, columns * nodes + rows)
    exists = np.append(places, -1)[transposed] == columns * nodes + rows
    flipped = [0, 3, 6, 1, 4, 7, 2, 5, 8, 9]
    if not np.all(exists) or np.count_nonzero(rows == columns) < nodes:
        return False
    error = np.abs(blocks[transposed][:, flipped] - blocks)
    size = np.sqrt(np.abs(blocks[rows == columns, :9]).max(axis=1))
    if np.any(error[:, :9].max(axis=1) > ROUNDING * size[rows] * size[columns]):
        return False
    return bool(error[:, 9].max(initial=0.0) <= ROUNDING * largest)


def _by_nodes(matrix: PETSc.Mat) -> Any:
    """Return the rows of this rank as sorted blocks of three rows and columns."""
    single = matrix.convert("aij", PETSc.Mat())
    starts, columns, values = single.getValuesCSR()
    single.destroy()
    shape = matrix.getLocalSize()[0], matrix.getSize()[1]
    blocks = sp.csr_matrix((values, columns, starts), shape=shape).tobsr((3, 3))
    blocks.sort_indices()
    return blocks


def _places(blocks: Any) -> Ints:
    """Return the ascending keys of the blocks: row times number of columns, plus column."""
    rows = np.repeat(np.arange(len(blocks.indptr) - 1), np.diff(blocks.indptr))
    return rows * (blocks.shape[1] // 3) + blocks.indices


def _starts(rows: Ints, nodes: int) -> Indices:
    """Return the first block of each row, and the number of blocks at the end."""
    return np.append(0, np.cumsum(np.bincount(rows, minlength=nodes))).astype(np.uint32)


def _nonzero(blocks: Any, like: PETSc.Mat) -> PETSc.Mat | None:
    """Return a matrix of the nonzero entries, None if all are zero (collective)."""
    single = blocks.tocsr()
    single.eliminate_zeros()
    if not any(like.comm.tompi4py().allgather(single.nnz)):
        return None
    return from_rows(like.getSizes(), (single.indptr, single.indices, single.data), like.comm)


@njit(cache=True, fastmath={"contract"})
def _multiply(
    starts: Indices, columns: Indices, blocks: Floats, x: Floats, mass: Floats, stiffness: Floats
) -> None:
    """Add M x and K x; blocks off the diagonal also act transposed."""
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
    """Add M x and K x of blocks that do not act transposed; x has the values at the columns."""
    for i in range(len(starts) - 1):
        for at in range(starts[i], starts[i + 1]):
            k, j = blocks[at], columns[at]
            for a in range(3):
                total = k[3 * a] * x[j, 0] + k[3 * a + 1] * x[j, 1] + k[3 * a + 2] * x[j, 2]
                stiffness[i, a] += total
                mass[i, a] += k[9] * x[j, a]
