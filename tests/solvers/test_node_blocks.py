# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The factor in blocks of a node: its solutions are put back into the equations."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from petsc4py import PETSc
from scipy import sparse

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.direct import DirectSolver, NodeBlocks

pytestmark = pytest.mark.skipif(
    not PETSc.Sys.hasExternalPackage("cholmod"), reason="kept beside CHOLMOD alone"
)


def strip(dim: int, *, held: bool = True) -> PETSc.Mat:
    """A positive matrix of a strip of 30 x 4 nodes, the last nodes held as on a foundation."""
    near = [sparse.diags([1, 1, 1], [-1, 0, 1], shape=(n, n)) for n in (30, 4)]
    pattern = sparse.kron(sparse.kron(*near), np.ones((dim, dim))).tocsr()
    pattern.data = np.random.default_rng(3).uniform(-1.0, 1.0, pattern.nnz)
    whole = (pattern + pattern.T + 40.0 * sparse.eye(pattern.shape[0])).tocsr()
    rows = (whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data)
    matrix = PETSc.Mat().createAIJ(whole.shape, bsize=dim, csr=rows, comm=PETSc.COMM_SELF)
    if held:
        last = np.arange(whole.shape[0] - 4 * dim, whole.shape[0], dtype=PETSc.IntType)
        matrix.zeroRowsColumns(last, diag=40.0)
    return matrix


def solved(solver: DirectSolver | NodeBlocks, matrix: PETSc.Mat) -> np.ndarray:
    """The solution for some right-hand side, once its residual is seen to be rounding."""
    b, x, residual = (matrix.createVecLeft() for _ in range(3))
    b.setArray(np.random.default_rng(4).standard_normal(b.getSize()))
    solver.solve(b, x)
    matrix.mult(x, residual)
    residual.axpy(-1.0, b)
    assert residual.norm() <= 1e-14 * b.norm()
    return x.getArray().copy()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("held", [True, False])
def test_solution(dim, held):
    # Well conditioned, by a dominant diagonal: residuals are a few units of rounding.
    matrix = strip(dim, held=held)
    blocks = NodeBlocks(matrix)
    solved(blocks, matrix)


def test_freed_when_destroyed():
    blocks = NodeBlocks(strip(3))
    factor = blocks._factor
    blocks.destroy()
    assert not factor  # the last reference to it, whoever holds the solver still


def test_solves_one_at_a_time_where_it_is_faster(monkeypatch):
    matrix = strip(3)
    found = {}
    for largest in (limits.NODE_BLOCK_ROWS, 0):
        monkeypatch.setattr(limits, "NODE_BLOCK_ROWS", largest)
        solver = DirectSolver(matrix, symmetric=True, often=True)
        found[largest] = solved(solver, matrix)
        solver.destroy()
    mine, cholmod = found.values()
    assert (mine != cholmod).any()  # rounding tells them apart
    np.testing.assert_allclose(mine, cholmod, rtol=1e-11)
    monkeypatch.undo()
    assert NodeBlocks.serves(matrix, entries=100.0 * matrix.getSize()[0])
    assert not NodeBlocks.serves(matrix, entries=200.0 * matrix.getSize()[0])


def test_columns_of_a_free_body_are_refused():
    # Springs between nodes in a row that nothing holds, coupled in each node: rounding decides
    # whether a factor of this singular matrix has a negative pivot.
    springs = np.random.default_rng(3).uniform(0.5, 2.0, 39)
    differences = sparse.diags([-1.0, 1.0], [0, 1], shape=(39, 40))
    row = differences.T @ sparse.diags(springs) @ differences
    node = np.array([[2.0, 0.3, 0.1], [0.3, 3.0, 0.2], [0.1, 0.2, 1.5]])
    whole = sparse.kron(row, node).tocsr()
    rows = (whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data)
    matrix = PETSc.Mat().createAIJ(whole.shape, bsize=3, csr=rows, comm=PETSc.COMM_SELF)
    solver = DirectSolver(matrix, symmetric=True, often=True)
    with pytest.raises(JointsError, match="restrained by supports"):
        solver.solve_block(np.random.default_rng(4).standard_normal((120, 2)))
    solver.destroy()


def test_new_values_are_factored_anew():
    matrix = strip(3)
    solver = DirectSolver(matrix, symmetric=True, often=True)
    before = solved(solver, matrix)
    matrix.scale(2.0)
    solver.refresh()
    np.testing.assert_allclose(solved(solver, matrix), 0.5 * before, rtol=1e-12)
    solver.destroy()
