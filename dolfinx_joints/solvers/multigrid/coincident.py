# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tied nodes: nodes on both sides of joints that become one node, and inverses of their blocks.

A stiff closed joint couples the two nodes of a joint point. Smoothers that treat the nodes one by
one hardly move the pair; smoothers that treat the pair as a block are not affected.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.mpi import blocks_of, rank_of, rows_at, sent_to


def tied_nodes(matrix: PETSc.Mat, joints: PETSc.Mat | None) -> tuple[Ints, int]:
    """Return the global number of each local node's tied node, and this rank's count (collective).

    The nodes on both sides of a joint point become one tied node, also where several joints meet.
    Quadrature points lie between more than two nodes; these nodes stay separate.

    Args:
        matrix: A, with the dofs of a node as blocks.
        joints: B, whose columns of constrained dofs are zero; None without joints.
    """
    comm, size = matrix.comm.tompi4py(), matrix.getBlockSize()
    start, stop = (dof // size for dof in matrix.getOwnershipRange())
    if joints is None:
        return np.arange(start, stop), stop - start
    first, second = _pairs(joints, size)
    lowest = np.arange(start, stop)
    nodes, blocks = np.concatenate([first, second]), blocks_of(comm, stop - start)
    owners = rank_of(blocks, nodes)
    local, changed = sent_to(comm, owners, nodes) - start, True
    while changed:
        lower = np.minimum(rows_at(comm, lowest, first), rows_at(comm, lowest, second))
        before = lowest.copy()
        np.minimum.at(lowest, local, sent_to(comm, owners, np.tile(lower, 2)))
        changed = bool(comm.allreduce(int(np.any(lowest != before))))
    kept = lowest == np.arange(start, stop)
    count = int(kept.sum())
    number = comm.scan(count) - count + np.cumsum(kept) - 1
    return rows_at(comm, number, lowest), count


def _pairs(joints: PETSc.Mat, size: int) -> tuple[Ints, Ints]:
    """Return the two nodes of each local point that has exactly two nodes."""
    starts, columns, values = joints.getValuesCSR()
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))[values != 0.0]
    node_of_point = np.stack([row // 3, columns[values != 0.0] // size], axis=1)
    point, node = np.unique(node_of_point, axis=0).T.astype(np.int64)
    count = np.bincount(point)
    first = np.flatnonzero(np.diff(point, prepend=-1) > 0)
    first = first[count[point[first]] == 2]
    return node[first], node[first + 1]


def tie(tied: Ints, count: int, size: int, comm: Any) -> PETSc.Mat:
    """Return T, which maps unknowns of tied nodes to unknowns of nodes, with one 1 per row.

    Args:
        tied: Tied node of each local node.
        count: Number of tied nodes of this rank.
        size: Number of unknowns per node.
        comm: Communicator; the function is collective.
    """
    columns = (size * tied[:, None] + np.arange(size)).ravel().astype(PETSc.IntType)
    starts = np.arange(len(columns) + 1, dtype=PETSc.IntType)
    sizes = ((len(columns), None), (size * count, None))
    matrix = PETSc.Mat().createAIJ(sizes, csr=(starts, columns, np.ones(len(columns))), comm=comm)
    matrix.setBlockSizes(size, size)
    return matrix


class BlockInverse:
    """Inverse of the diagonal blocks of A + K, one block per tied node with entries of K.

    Args:
        matrix: A, in PETSc's AIJ format.
        added: K, the tangent of the joints; only the sparsity pattern is used.
        ties: T, from `tie`.

    Attributes:
        matrix: The inverse.
    """

    def __init__(self, matrix: PETSc.Mat, added: PETSc.Mat, ties: PETSc.Mat) -> None:
        """Determine the blocks, and invert the blocks of A (collective)."""
        size = ties.getBlockSizes()[0]
        self._dofs = _dofs_of_tied_nodes(added, ties, size)
        self._positions = _BlockPositions(self._dofs)
        rows = self._positions.all_dofs.astype(PETSc.IntType)
        self._rows = PETSc.IS().createGeneral(rows, comm=matrix.comm)
        self._bulk = self._blocks(matrix)
        self.matrix = _empty_matrix(ties, size)
        start, stop = matrix.getOwnershipRange()
        # PETSc gives blocks column by column.
        blocks = np.asarray(matrix.invertBlockDiagonal()).reshape(-1, size, size)
        _insert(self.matrix, np.arange(start, stop).reshape(-1, size), blocks.transpose(0, 2, 1))
        for dofs, block in zip(self._dofs, self._bulk, strict=True):
            _insert(self.matrix, dofs, np.zeros_like(block))
        self.matrix.assemble()

    def update(self, added: PETSc.Mat) -> None:
        """Invert the blocks for new values of K (collective)."""
        for dofs, bulk, joint in zip(self._dofs, self._bulk, self._blocks(added), strict=True):
            _insert(self.matrix, dofs, np.asarray(np.linalg.inv(bulk + joint), np.float64))
        self.matrix.assemble()

    def _blocks(self, matrix: PETSc.Mat) -> list[Floats]:
        """Return the blocks of a matrix, one array per number of nodes per block (collective)."""
        (part,) = matrix.createSubMatrices([self._rows], [self._rows])
        blocks = self._positions.blocks(part)
        part.destroy()
        return blocks

    def destroy(self) -> None:
        """Free the matrix."""
        self._rows.destroy()
        self.matrix.destroy()


class _BlockPositions:
    """Positions of the entries of blocks in a matrix of all their dofs.

    Attributes:
        all_dofs: Sorted dofs of all blocks.
    """

    def __init__(self, dofs: list[Ints]) -> None:
        self._shapes = [(len(group), group.shape[1], group.shape[1]) for group in dofs]
        block: list[Ints] = [np.zeros(0, np.int64)]
        place: list[Ints] = [np.zeros(0, np.int64)]
        width: list[int] = []
        for group in dofs:
            count, block_size = group.shape
            block.append(np.repeat(np.arange(count) + len(width), block_size))
            place.append(np.tile(np.arange(block_size), count))
            width += [block_size] * count
        flat = np.concatenate([np.zeros(0, np.int64), *(group.ravel() for group in dofs)])
        order = np.argsort(flat)
        self.all_dofs = flat[order]
        self._block, self._place = np.concatenate(block)[order], np.concatenate(place)[order]
        self._width = np.array(width, dtype=np.int64)
        self._first = np.cumsum(self._width**2) - self._width**2

    def blocks(self, part: PETSc.Mat) -> list[Floats]:
        """Return the blocks, one array per number of nodes per block."""
        starts, columns, values = part.getValuesCSR()
        rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        block = self._block[rows]
        inside = block == self._block[columns]
        block, rows, columns = block[inside], rows[inside], columns[inside]
        entries = np.zeros(int(np.sum(self._width**2)))
        place = self._place[rows] * self._width[block] + self._place[columns]
        entries[self._first[block] + place] = values[inside]
        ends = np.cumsum([np.prod(shape) for shape in self._shapes])[:-1].astype(np.int64)
        parts = np.split(entries, ends) if self._shapes else []
        return [values.reshape(shape) for values, shape in zip(parts, self._shapes, strict=True)]


def _dofs_of_tied_nodes(added: PETSc.Mat, ties: PETSc.Mat, size: int) -> list[Ints]:
    """Return the dofs of the rank's tied nodes with entries of K, one array per node count."""
    marked, touched_nodes = ties.createVecs()
    rows = np.diff(added.getValuesCSR()[0]).reshape(-1, size).max(axis=1, initial=0)
    touched_nodes.setArray(np.repeat((rows > 0).astype(float), size))
    ties.multTranspose(touched_nodes, marked)
    transposed = ties.transpose(PETSc.Mat())
    starts, columns, _ = transposed.getValuesCSR()
    first, count = starts[:-1:size], np.diff(starts)[::size]
    touched = marked.getArray(readonly=True)[::size] > 0.0
    members = []
    for nodes in np.unique(count[touched]):
        chosen = first[touched & (count == nodes)]
        # The first row of a tied node contains the first dof of each node.
        dofs = columns[chosen[:, None] + np.arange(nodes)][..., None] + np.arange(size)
        members.append(dofs.reshape(len(chosen), -1).astype(np.int64))
    for temporary in (marked, touched_nodes, transposed):
        temporary.destroy()
    return members


def _empty_matrix(ties: PETSc.Mat, size: int) -> PETSc.Mat:
    """Return an empty matrix with space for blocks of tied nodes."""
    tied, count = ties.createVecs()
    count.set(1.0)
    ties.multTranspose(count, tied)
    ties.mult(tied, count)
    nodes = np.rint(count.getArray(readonly=True)).astype(PETSc.IntType)
    local = count.getSizes()
    off_rank = np.where(nodes > 1, size * nodes, 0).astype(PETSc.IntType)
    matrix = PETSc.Mat().createAIJ((local, local), nnz=(size * nodes, off_rank), comm=ties.comm)
    for used in (tied, count):
        used.destroy()
    return matrix


def _insert(matrix: PETSc.Mat, dofs: Ints, blocks: Floats) -> None:
    """Set blocks of a matrix, each with the dofs of one row of ``dofs``."""
    width = dofs.shape[1]
    matrix.setValuesIJV(
        np.arange(0, dofs.size * width + 1, width, dtype=PETSc.IntType),
        np.repeat(dofs, width, axis=0).ravel().astype(PETSc.IntType),
        blocks.ravel(),
        rowmap=dofs.ravel().astype(PETSc.IntType),
    )
