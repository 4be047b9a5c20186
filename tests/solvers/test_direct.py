# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of the effective matrices: what they return is put back into the equations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from mpi4py import MPI

from petsc4py import PETSc

from dolfinx_joints.common import memory
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import direct as linear
from dolfinx_joints.solvers.direct import DirectSolver
from dolfinx_joints.solvers.effective_matrix import (
    STATIC,
    Cache,
    EffectiveMatrix,
    MatrixCoefficients,
)
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

pytestmark = pytest.mark.mpi


def chain(
    comm: Any, size: int = 40, *, held: bool = True, skew: float = 0.0, empty: bool = False
) -> PETSc.Mat:
    """Springs in a row between walls, or free at both ends; ``empty``: all on the last rank."""
    rows = (size if comm.rank == comm.size - 1 else 0) if empty else PETSc.DECIDE
    matrix = PETSc.Mat().createAIJ(((rows, size), (rows, size)), nnz=3, comm=comm)
    for i in range(*matrix.getOwnershipRange()):
        ends = (i == 0) + (i == size - 1)
        matrix[i, i] = 2.0 if held else 2.0 - ends
        if i > 0:
            matrix[i, i - 1] = -1.0 - skew
        if i < size - 1:
            matrix[i, i + 1] = -1.0 + skew
    matrix.assemble()
    return matrix


def columns(matrix: PETSc.Mat, number: int) -> np.ndarray:
    """Owned rows of right-hand sides that do not depend on the number of ranks."""
    whole = np.random.default_rng(1).standard_normal((matrix.getSize()[0], number))
    return whole[slice(*matrix.getOwnershipRange())]


def product(matrix: PETSc.Mat, block: np.ndarray) -> np.ndarray:
    """A X, one column after the other."""
    x, y = matrix.createVecRight(), matrix.createVecLeft()
    out = np.empty_like(block)
    for k in range(block.shape[1]):
        x.setArray(block[:, k])
        matrix.mult(x, y)
        out[:, k] = y.getArray(readonly=True)
    return out


@pytest.mark.parametrize(("symmetric", "skew"), [(True, 0.0), (False, 0.3)])
@pytest.mark.parametrize("empty", [False, True])
@pytest.mark.parametrize("number", [1, 7])
def test_a_block_solves_every_column(comm, symmetric, skew, empty, number):
    # A X = B is the definition; the chain's inverse is at most size^2/8 = 200.
    matrix = chain(comm, skew=skew, empty=empty)
    solver = DirectSolver(matrix, symmetric=symmetric)
    right = columns(matrix, number)
    given = right.copy()
    found = solver.solve_block(right)
    assert found.shape == right.shape
    np.testing.assert_array_equal(right, given)
    np.testing.assert_allclose(product(matrix, found), right, rtol=0, atol=1e-12)


def test_block_and_single_solves_share_a_factor(comm):
    matrix = chain(comm)
    solver = DirectSolver(matrix, symmetric=True)
    right = columns(matrix, 3)
    block = solver.solve_block(right)
    b, x = matrix.createVecLeft(), matrix.createVecRight()
    b.setArray(right[:, 1])
    assert not solver.solve(b, x)  # the block has factored the matrix
    np.testing.assert_allclose(x.getArray(readonly=True), block[:, 1], rtol=0, atol=1e-11)


def test_sparse_right_hand_sides(comm):
    """Unit forces anywhere, also two in one column, against the block that is not sparse."""
    matrix, size = chain(comm), 40
    whole = np.zeros((size, 4))
    whole[[0, 13, 39, 20, 21], [0, 1, 2, 3, 3]] = [1.0, 2.0, 1.0, 1.0, -1.0]
    own, dofs = (4, size) if comm.rank == 0 else (0, 0)
    rows = PETSc.Mat().createAIJ(((own, 4), (dofs, size)), nnz=2, comm=comm)
    for i, j in np.argwhere(whole.T) if own else ():
        rows[i, j] = whole[j, i]
    rows.assemble()
    solver = DirectSolver(matrix, symmetric=True, mumps=True)
    found = solver.solve_sparse(rows)
    mine = whole[slice(*matrix.getOwnershipRange())]
    np.testing.assert_allclose(found, solver.solve_block(mine), rtol=0, atol=1e-13)
    np.testing.assert_allclose(product(matrix, found), mine, rtol=0, atol=1e-13)


def test_no_columns_are_no_work(comm):
    matrix = chain(comm)
    solver = DirectSolver(matrix, symmetric=True)
    rows = matrix.getLocalSize()[0]
    assert solver.solve_block(np.empty((rows, 0))).shape == (rows, 0)


def test_a_changed_matrix_is_factored_anew(comm):
    matrix = chain(comm)
    solver = DirectSolver(matrix, symmetric=True)
    right = columns(matrix, 2)
    before = solver.solve_block(right)
    matrix.scale(2.0)
    solver.refresh()
    np.testing.assert_allclose(solver.solve_block(right), 0.5 * before, rtol=0, atol=1e-11)


@pytest.mark.parametrize("symmetric", [True, False])
def test_free_bodies_are_refused(comm, symmetric):
    # Springs without a wall: moving all of them costs nothing, and the columns push them.
    matrix = chain(comm, held=False)
    solver = DirectSolver(matrix, symmetric=symmetric)
    with pytest.raises(JointsError, match="restrained by supports"):
        solver.solve_block(columns(matrix, 2))
    b, x = matrix.createVecLeft(), matrix.createVecRight()
    b.set(1.0)
    with pytest.raises(JointsError, match="restrained by supports"):
        solver.solve(b, x)


def box(comm: Any, size: int = 8) -> PETSc.Mat:
    """The 7-point Laplacian of a cube, whose factor fills in."""
    matrix = PETSc.Mat().createAIJ((size**3, size**3), nnz=7, comm=comm)
    for row in range(*matrix.getOwnershipRange()):
        matrix[row, row] = 6.0
        for step in (1, size, size**2):
            place = row // step % size
            if place > 0:
                matrix[row, row - step] = -1.0
            if place < size - 1:
                matrix[row, row + step] = -1.0
    matrix.assemble()
    return matrix


def test_workspace_too_small_is_asked_for_again(comm):
    # MUMPS is given 5 % of the workspace that it estimates, which fails (see the next test).
    matrix = box(comm)
    options = {"pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": -95}
    solver = DirectSolver(matrix, symmetric=True, options=options)
    right = columns(matrix, 2)
    np.testing.assert_allclose(
        product(matrix, solver.solve_block(right)), right, rtol=0, atol=1e-12
    )


def test_memory_that_does_not_suffice_is_said(comm, monkeypatch):
    monkeypatch.setattr(linear, "MORE_WORKSPACE", -95)
    matrix = box(comm)
    options = {"pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": -95}
    solver = DirectSolver(matrix, symmetric=True, options=options)
    with pytest.raises(JointsError, match="does not fit into memory"):
        solver.solve_block(columns(matrix, 2))


def test_a_failure_without_words_gives_petscs_reason(comm, monkeypatch):
    monkeypatch.setattr(DirectSolver, "_factor", lambda self: 6)  # neither memory nor a pivot
    solver = DirectSolver(box(comm), symmetric=True, options={"pc_factor_mat_solver_type": "petsc"})
    with pytest.raises(JointsError, match=r"^The matrix could not be .*; PETSc's reason is 6\.$"):
        solver.solve_block(np.zeros((1, 1)))


def test_options_do_not_leak(comm):
    matrix = chain(comm)
    before = PETSc.Options().getAll()
    solver = DirectSolver(matrix, symmetric=True)
    solver.solve_block(columns(matrix, 2))
    assert PETSc.Options().getAll() == before


STEP = MatrixCoefficients(
    mass=8e4, damping=200.0, stiffness=0.5
)  # of 0.01 s by average acceleration


@pytest.fixture(scope="module")
def wall(wall_file, read):
    """A clamped elastic wall of four blocks that touch nothing, in space."""
    import shaken_wall

    return shaken_wall.wall(read(wall_file(divisions=(8, 3, 6)))).system()


def load(matrix: PETSc.Mat) -> PETSc.Vec:
    b = matrix.createVecLeft()
    b.setArray(1e6 * columns(matrix, 1)[:, 0])
    return b


@pytest.mark.parametrize("kind", ["mumps", "iterative"])
@pytest.mark.parametrize("effective", [STEP, STATIC])
def test_solvers_agree(wall, effective, kind):
    # A step, and statics, whose matrix has a condition number of some ten thousand: both leave
    # residuals near rounding, so that solutions agree but for that number times rounding.
    direct, other = (EffectiveMatrix(wall, effective, linear=each) for each in ("direct", kind))
    b = load(wall.stiffness)
    found = []
    for matrix in (direct, other):
        x, residual = b.duplicate(), b.duplicate()
        assert matrix.solver.solve(b, x)
        assert not matrix.solver.solve(b, x)
        matrix.constrained.mult(x, residual)
        residual.axpy(-1.0, b)
        assert residual.norm() <= 1e-12 * b.norm()
        found.append(x)
    assert (found[1] - found[0]).norm() <= 1e-10 * found[0].norm()
    cholmod = wall.stiffness.comm.size == 1 and PETSc.Sys.hasExternalPackage("cholmod")
    assert direct.solver.package == ("cholmod" if cholmod else "mumps")
    assert kind == "iterative" or other.solver.package == "mumps"


def test_rigid_modes_spare_iterations(wall):
    # In statics a slender wall is hard for multigrid that knows translations only.
    matrix = EffectiveMatrix(wall, STATIC)
    b = load(matrix.constrained)
    x, counts = b.duplicate(), []
    for modes in (None, wall.stiffness.getNearNullSpace()):
        if modes is not None:
            matrix.constrained.setNearNullSpace(modes)
        solver = IterativeSolver(matrix.constrained)
        solver.solve(b, x)
        counts.append(solver.iterations)
    assert 3 <= counts[1] <= 0.8 * counts[0], counts


def test_an_iterative_block_is_its_columns(wall):
    matrix = EffectiveMatrix(wall, STEP, linear="iterative")
    right = columns(matrix.constrained, 2)
    found = matrix.solver.solve_block(right)
    np.testing.assert_allclose(product(matrix.constrained, found), right, rtol=0, atol=1e-11)


def test_iterative_solver_of_single_unknowns(comm):
    # Without blocks, without near null space, and a rank may own nothing.
    matrix = chain(comm, empty=True)
    solver = IterativeSolver(matrix)
    right = columns(matrix, 2)
    np.testing.assert_allclose(
        product(matrix, solver.solve_block(right)), right, rtol=0, atol=1e-11
    )
    matrix.scale(2.0)
    solver.refresh()
    half = solver.solve_block(right)
    np.testing.assert_allclose(product(matrix, half), right, rtol=0, atol=1e-11)


def test_an_iterative_solver_needs_no_mesh():
    # Two masses in a row: K u = F with u = (1, 1.5) by hand.
    system = MatrixSystem.from_arrays(mass=np.eye(2), stiffness=[[3.0, -2.0], [-2.0, 2.0]])
    matrix = EffectiveMatrix(system, STATIC, linear="iterative")
    found = matrix.solver.solve_block(np.array([[0.0], [1.0]]))
    np.testing.assert_allclose(found[:, 0], [1.0, 1.5], rtol=1e-12)


def test_no_load_no_displacement(wall):
    matrix = EffectiveMatrix(wall, STEP, linear="iterative")
    b = wall.stiffness.createVecLeft()
    x = b.duplicate()
    x.set(1.0)
    matrix.solver.solve(b, x)
    assert x.norm() == 0.0


def test_an_iteration_that_fails_says_so(comm):
    # -1 is no diagonal of a positive definite matrix.
    matrix = chain(comm)
    matrix.shift(-3.0)
    solver = IterativeSolver(matrix)
    with pytest.raises(JointsError, match="iterative linear solver did not converge"):
        solver.solve_block(columns(matrix, 1))


def test_what_rounding_of_a_product_leaves_is_accepted(comm):
    # Entries of 1e9: the direct solution's residual is some 1e9 times 1e-16 of x, far above 1e-16
    # of x itself; that of a solution wrong in the sixth digit is not rounding.
    matrix = chain(comm)
    matrix.scale(1e9)
    b, x = matrix.createVecLeft(), matrix.createVecRight()
    b.setArray(columns(matrix, 1)[:, 0])
    solver, direct = IterativeSolver(matrix), DirectSolver(matrix, symmetric=True)
    direct.solve(b, x)
    assert solver._is_solved_to_rounding(b, x)
    x.scale(1.0 + 1e-6)
    assert not solver._is_solved_to_rounding(b, x)


def test_auto_goes_by_memory(wall, monkeypatch):
    assert isinstance(EffectiveMatrix(wall, STEP).solver, DirectSolver)
    monkeypatch.setattr(memory, "_free_in_groups", lambda: [1e4])
    assert isinstance(EffectiveMatrix(wall, STEP).solver, IterativeSolver)
    assert isinstance(EffectiveMatrix(wall, STEP, linear="direct").solver, DirectSolver)
    unsymmetric = replace(wall, symmetric=False)
    assert isinstance(EffectiveMatrix(unsymmetric, STEP).solver, DirectSolver)


def test_estimate_of_the_factor(comm):
    # CHOLMOD's factors: of a cube of 24 x 24 x 24 elements 31.2e6 entries, of a square of 240 x
    # 240 nodes 9.2e6; the estimate holds half as much again for the making.
    assert memory.factor_bytes(46875, 3) == pytest.approx(12.0 * 31.2e6, rel=0.1)
    assert memory.factor_bytes(115200, 2) == pytest.approx(12.0 * 9.16e6, rel=0.1)
    # Each machine counts once, however many ranks it has.
    free = comm.bcast(memory.available_bytes(MPI.COMM_SELF))
    assert 0.5 * free < memory.available_bytes(comm) < 2.0 * free


def group(folder, limit, used, cached):
    """A control group as the kernel shows it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "memory.max").write_text(f"{limit}\n")
    (folder / "memory.current").write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 5\ninactive_file {cached}\n")


def test_limits_of_containers_count(tmp_path):
    # What is left: limit - used + cached files, of every group around the process.
    mounted, process = tmp_path / "cgroup", tmp_path / "self"
    process.write_text("0::/outer/inner\n")
    group(mounted / "outer" / "inner", 3000, 1000, 200)
    group(mounted / "outer", "max", 5000, 200)
    group(mounted, 9000, 5500, 300)
    assert memory._free_in_groups(process, mounted) == [2200.0, 3800.0]
    assert memory._free_in_groups(tmp_path / "none", mounted) == []


def test_iterative_solvers_need_symmetric_matrices(wall):
    with pytest.raises(ValueError, match="needs symmetric matrices"):
        EffectiveMatrix(replace(wall, symmetric=False), STEP, linear="iterative")


def test_what_was_not_used_for_longest_is_pushed_out():
    class Made:
        def __init__(self, key: str) -> None:
            self.key, self.gone = key, False

        def destroy(self) -> None:
            self.gone = True

    kept = Cache(Made, size=2)
    first, second = kept("a"), kept("b")
    assert kept("a") is first
    third = kept("c")
    assert [thing.gone for thing in (first, second, third)] == [False, True, False]
    assert kept.items() == [("a", first), ("c", third)]
    assert kept("b") is not second
