# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Multigrid levels for bodies with joints: the levels of the tied body, cut at the joints.

A coarse basis function (below: function) that extends across joints is cut into one function per
side; both have the same values at the joint. On a coarse level the stiffness of the joints then
couples matching functions, and open joints are represented as well as closed ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import csr_array

from dolfinx_joints.common.arrays import Ints
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import blocks_of, rank_of, rows_at, sent_to
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.multigrid.bulk import OPTIONS, made_once, options_set
from dolfinx_joints.solvers.multigrid.coincident import tie


@dataclass(frozen=True, kw_only=True)
class CutLevel:
    """Coarse level.

    Attributes:
        interpolation: P, to the next finer level.
        matrix: P^T A P.
        blocks: Number of unknowns of each block of this rank; a block is one function's parts.
    """

    interpolation: PETSc.Mat
    matrix: PETSc.Mat
    blocks: Ints


def cut_levels(matrix: PETSc.Mat, tied: Ints, count: int, near: PETSc.NullSpace) -> list[CutLevel]:
    """Return the coarse levels, from fine to coarse (collective).

    Args:
        matrix: A, in PETSc's AIJ format.
        tied: Global number of the tied node of each local node.
        count: Number of this rank's tied nodes.
        near: Rigid-body motions.
    """
    size, levels = matrix.getBlockSize(), []
    ties = tie(tied, count, size, matrix.comm)
    with made_once(matrix.comm):
        prolongations = _tied_prolongations(matrix, ties, near)
    for prolongation in prolongations:
        interpolation, functions = _cut(matrix, ties, prolongation)
        ties.destroy()
        with made_once(matrix.comm):
            matrix = matrix.PtAP(interpolation)
        size = prolongation.getBlockSizes()[1]
        _regularise(matrix, size, np.repeat(functions, functions))
        levels.append(CutLevel(interpolation=interpolation, matrix=matrix, blocks=size * functions))
        first = matrix.comm.tompi4py().scan(len(functions)) - len(functions)
        tied_functions = np.repeat(np.arange(first, first + len(functions)), functions)
        ties = tie(tied_functions, len(functions), size, matrix.comm)
    ties.destroy()
    return levels


def _tied_prolongations(
    matrix: PETSc.Mat, ties: PETSc.Mat, near: PETSc.NullSpace
) -> list[PETSc.Mat]:
    """Return the prolongations of T^T A T by smoothed aggregation, fine to coarse (collective)."""
    tied = matrix.PtAP(ties)
    tied.setBlockSize(ties.getBlockSizes()[1])
    tied.setNearNullSpace(_tied_motions(near, ties))
    pc = PETSc.PC().create(matrix.comm)
    pc.setOptionsPrefix("dolfinx_joints_tied_")
    of_levels = {key: value for key, value in OPTIONS.items() if key.startswith("mg_")}
    with options_set("dolfinx_joints_tied_", {"pc_type": "gamg", **of_levels}):
        pc.setOperators(tied)
        pc.setFromOptions()
        pc.setUp()
        pc.viewFromOptions("-pc_view")
    prolongations = [pc.getMGInterpolation(i) for i in range(pc.getMGLevels() - 1, 0, -1)]
    pc.destroy()
    tied.destroy()
    return prolongations


def _tied_motions(near: PETSc.NullSpace, ties: PETSc.Mat) -> PETSc.NullSpace:
    """Return orthonormal rigid-body motions of tied nodes, as means of their nodes (collective)."""
    count, nodes = ties.createVecs()
    nodes.set(1.0)
    ties.multTranspose(nodes, count)
    motions: list[PETSc.Vec] = []
    for motion in near.getVecs():
        tied_motion = count.duplicate()
        ties.multTranspose(motion, tied_motion)
        tied_motion.pointwiseDivide(tied_motion, count)
        for _ in range(2):
            for other in motions:
                tied_motion.axpy(-tied_motion.dot(other), other)
        tied_motion.normalize()
        motions.append(tied_motion)
    return PETSc.NullSpace().create(vectors=motions, comm=ties.comm)


def _cut(matrix: PETSc.Mat, ties: PETSc.Mat, prolongation: PETSc.Mat) -> tuple[PETSc.Mat, Ints]:
    """Return P of the cut functions, and the number of parts of each of this rank's functions.

    A function with joint nodes is cut into parts that A connects on each rank (collective).
    """
    comm, size = matrix.comm.tompi4py(), ties.getBlockSizes()[0]
    width = prolongation.getBlockSizes()[1]
    (rows, total_rows), columns = matrix.getSizes()[0], prolongation.getSizes()[1]
    whole = ties.matMult(prolongation)
    starts, entries, values = whole.getValuesCSR()
    whole.destroy()
    ends, function = _pairs(starts[::size].copy(), entries // width, columns[1] // width)
    node = np.repeat(np.arange(rows // size), np.diff(ends))
    joint = _is_tied(ties)[node]
    blocks = blocks_of(comm, columns[0] // width)
    touched = np.zeros(columns[0] // width, dtype=bool)
    owner = rank_of(blocks, function)
    touched[sent_to(comm, owner[joint], function[joint]) - blocks[comm.rank]] = True
    cut = np.flatnonzero(rows_at(comm, touched, function))
    part = np.zeros(len(function), dtype=np.int64)
    part[cut] = _parts(matrix, size, node[cut], function[cut])
    first, functions = _numbered(comm, blocks, touched, function, part)
    entries = _renumbered(starts, entries, size, width, ends, function, first + part)
    sizes = ((rows, total_rows), (int(functions.sum()) * width, None))
    cut_matrix = PETSc.Mat().createAIJ(sizes, csr=(starts, entries, values), comm=matrix.comm)
    cut_matrix.setBlockSizes(size, width)
    return cut_matrix, functions


def _pairs(starts: NDArray[Any], functions: NDArray[Any], count: int) -> tuple[Ints, Ints]:
    """Return the functions of each local node, sorted and without duplicates, node after node.

    Args:
        starts: First entry of each node, shape (n + 1,).
        functions: Function of each entry.
        count: Number of functions.

    Returns:
        First pair of each node, shape (n + 1,), and function of each pair.
    """
    ones = np.ones(len(functions), dtype=np.int8)
    pattern = csr_array((ones, functions, starts), shape=(len(starts) - 1, count))
    pattern.sum_duplicates()
    return pattern.indptr.astype(np.int64), pattern.indices.astype(np.int64)


@njit(cache=True)
def _renumbered(
    starts: NDArray[Any],
    entries: NDArray[Any],
    size: int,
    width: int,
    ends: Ints,
    function: Ints,
    number: Ints,
) -> NDArray[Any]:  # pragma: no cover
    """Return the columns of the entries after renumbering the functions, in the same order."""
    renumbered = np.empty_like(entries)
    for row in range(len(starts) - 1):
        p = ends[row // size]
        for k in range(starts[row], starts[row + 1]):
            while function[p] < entries[k] // width:
                p += 1
            renumbered[k] = number[p] * width + entries[k] % width
    return renumbered


def _numbered(
    comm: Any, blocks: Ints, touched: NDArray[np.bool_], function: Ints, part: Ints
) -> tuple[Ints, Ints]:
    """Return the first local part of each pair's function, and the rank's part counts (collective).

    The part counts are the numbers of parts of the functions that this rank owns. The parts of a
    function are numbered on its owner, in the order of the ranks. A function that is not cut has a
    single part for all ranks.
    """
    local_functions, place = np.unique(function, return_inverse=True)
    part_counts = np.zeros(len(local_functions), dtype=np.int64)
    np.maximum.at(part_counts, place, part + 1)
    owner = rank_of(blocks, local_functions)
    ends = np.searchsorted(owner, np.arange(1, comm.size))
    requests = comm.alltoall(np.split(np.stack([local_functions, part_counts], axis=1), ends))
    functions = np.ones(len(touched), dtype=np.int64)
    functions[touched] = 0
    before = []
    for request in requests:
        at = request[:, 0] - blocks[comm.rank]
        before.append(np.where(touched[at], functions[at], 0))
        functions[at] += np.where(touched[at], request[:, 1], 0)
    start = np.cumsum(functions) - functions + blocks_of(comm, int(functions.sum()))[comm.rank]
    replies = [
        start[request[:, 0] - blocks[comm.rank]] + earlier
        for request, earlier in zip(requests, before, strict=True)
    ]
    first = np.concatenate(comm.alltoall(replies))
    return first[place], functions


def _is_tied(ties: PETSc.Mat) -> NDArray[np.bool_]:
    """Return True for each local node that is tied to other nodes (collective)."""
    tied, nodes = ties.createVecs()
    nodes.set(1.0)
    ties.multTranspose(nodes, tied)
    ties.mult(tied, nodes)
    shared: NDArray[np.bool_] = nodes.getArray(readonly=True)[:: ties.getBlockSizes()[0]] > 1.5
    for temporary in (tied, nodes):
        temporary.destroy()
    return shared


def _parts(matrix: PETSc.Mat, size: int, node: Ints, function: Ints) -> Ints:
    """Return the number of the part to which each pair (local node, function) belongs.

    The pairs are sorted by nodes, then by functions; parts are numbered within a function.
    """
    starts, columns = matrix.getDiagonalBlock().getRowIJ()[:2]
    rows = matrix.getLocalSize()[0] // size
    ends = np.searchsorted(node, np.arange(rows + 1))
    root = _roots(starts[::size], columns // size, ends, function)
    order = np.lexsort((root, function))
    new = np.diff(root[order], prepend=-1) != 0
    other = np.diff(function[order], prepend=-1) != 0
    count = np.cumsum(new | other) - 1
    part = np.empty_like(root)
    part[order] = count - np.maximum.accumulate(np.where(other, count, 0))
    return part


@njit(cache=True)
def _roots(starts: Any, neighbours: Any, ends: Ints, function: Ints) -> Ints:  # pragma: no cover
    """Return, for each pair, the first pair of the same function that the matrix connects to it."""
    root = np.arange(len(function))
    for i in range(len(ends) - 1):
        if ends[i] == ends[i + 1]:
            continue
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            if j >= i:
                continue
            p, q = ends[i], ends[j]
            while p < ends[i + 1] and q < ends[j + 1]:
                if function[p] < function[q]:
                    p += 1
                elif function[p] > function[q]:
                    q += 1
                else:
                    a, b = p, q
                    while root[a] != a:
                        root[a] = root[root[a]]
                        a = root[a]
                    while root[b] != b:
                        root[b] = root[root[b]]
                        b = root[b]
                    root[max(a, b)] = min(a, b)
                    p += 1
                    q += 1
    for p in range(len(root)):
        root[p] = root[root[p]]
    return root


def _regularise(matrix: PETSc.Mat, size: int, parts: Ints) -> None:
    """Increase the diagonal of cut functions by a small share (collective)."""
    diagonal = matrix.getDiagonal()
    blocks = diagonal.getArray().reshape(-1, size)
    share = np.where(parts > 1, limits.CUT_REGULARISATION, 0.0)
    blocks += (share * blocks.max(axis=1, initial=0.0))[:, None]
    blocks[blocks == 0.0] = 1.0
    matrix.setDiagonal(diagonal)
    matrix.assemble()
    diagonal.destroy()
