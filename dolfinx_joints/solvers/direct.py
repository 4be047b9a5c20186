# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Direct solvers of a matrix, with error messages for failed factorizations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.diagnosis import NO_MEMORY, of_error, reported_by_package, why_singular
from dolfinx_joints.solvers.multigrid.bulk import options_set

# Block sizes (dofs per node) for which PETSc has unrolled loops.
BLOCKS = (2, 3)


class NodeBlocks:
    """Cholesky factor in node blocks, for one right-hand side at a time.

    PETSc's factor of a symmetric block matrix (SBAIJ) reads one index for the four or nine entries
    of a block and has no dense panels. If the columns of the factor are short, PETSc solves up to
    twice as fast as CHOLMOD.

    Args:
        matrix: Symmetric positive definite AIJ matrix on one rank; block size: dofs per node.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Order the nodes by minimum degree and factor the matrix."""
        blocks = matrix.convert("baij", PETSc.Mat())
        nodes, _ = blocks.getOrdering("amd")
        size = matrix.getBlockSize()
        dofs = PETSc.IS().createBlock(size, nodes.getIndices(), comm=matrix.comm)
        ordered = matrix.permute(dofs, dofs)
        ordered.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        half = ordered.convert("sbaij", PETSc.Mat())
        self._pc = PETSc.PC().create(matrix.comm)
        self._pc.setOptionsPrefix("dolfinx_joints_node_blocks_")
        self._pc.setOperators(half)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("petsc")
        self._pc.setFactorOrdering("natural")
        self._pc.setUp()
        self._pc.viewFromOptions("-pc_view")
        self._factor = self._pc.getFactorMatrix()
        self._dofs = dofs.getIndices().astype(np.intp)
        self._places = np.argsort(self._dofs)
        self._right_hand_side, self._half, self._solution = (half.createVecLeft() for _ in range(3))
        for temporary in (blocks, nodes, dofs, ordered, half):
            temporary.destroy()

    @staticmethod
    def serves(matrix: PETSc.Mat, entries: float) -> bool:
        """Return True if node blocks are faster than a supernodal factor with so many entries."""
        size = matrix.getSize()[0]
        short = entries <= limits.NODE_BLOCK_COLUMN * size and size <= limits.NODE_BLOCK_ROWS
        return short and matrix.getBlockSize() in BLOCKS

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve A x = b."""
        self._solve(b.getArray(readonly=True), x.getArray())

    def solve_block(self, right_hand_sides: Floats, solutions: Floats) -> None:
        """Solve A X = B, shape (rows, columns), one column after the other."""
        for i in range(right_hand_sides.shape[1]):
            self._solve(right_hand_sides[:, i], solutions[:, i])

    def _solve(self, b: Floats, x: Floats) -> None:
        self._right_hand_side.setArray(b[self._dofs])
        # Separate forward and backward substitutions take two thirds of the time of PETSc's solve.
        self._factor.solveForward(self._right_hand_side, self._half)
        self._factor.solveBackward(self._half, self._solution)
        x[:] = self._solution.getArray(readonly=True)[self._places]

    def destroy(self) -> None:
        """Free the factor."""
        for owned in (self._factor, self._pc, self._right_hand_side, self._half, self._solution):
            owned.destroy()


# MUMPS' option for the per cent by which its workspace exceeds the estimate.
WORKSPACE = "mat_mumps_icntl_14"

MORE_WORKSPACE = 300

OUT_OF_MEMORY = int(PETSc.PC.FailedReason.FACTOR_OUTMEMORY)

ZERO_PIVOT = (
    int(PETSc.PC.FailedReason.FACTOR_STRUCT_ZEROPIVOT),
    int(PETSc.PC.FailedReason.FACTOR_NUMERIC_ZEROPIVOT),
)


class DirectSolver:
    """PETSc direct solver; the solver's options are removed from PETSc's database after use.

    Args:
        matrix: Matrix to be factored.
        symmetric: Use Cholesky (CHOLMOD on one rank if PETSc has it, else MUMPS) instead of LU.
        mumps: Use MUMPS also on one rank.
        often: True if many right-hand sides will be solved one after the other. With CHOLMOD, a
            second factor in node blocks is then kept if that factor is faster (`NodeBlocks`).
        options: PETSc options that replace the defaults, without prefix.
        name: Name of the system; the options prefix is ``dolfinx_joints_NAME_``.

    Attributes:
        package: PETSc's name of the package that factors the matrix.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        *,
        symmetric: bool,
        mumps: bool = False,
        often: bool = False,
        options: Mapping[str, Any] | None = None,
        name: str = "bulk",
    ) -> None:
        """Choose the package; the matrix is factored at the first solve."""
        self._matrix = matrix
        serial = symmetric and not mumps and matrix.comm.size == 1
        package = "cholmod" if serial and PETSc.Sys.hasExternalPackage("cholmod") else "mumps"
        self._options: dict[str, Any] = {
            "ksp_type": "preonly",
            "pc_type": "cholesky" if symmetric else "lu",
            "pc_factor_mat_solver_type": package,
        }
        if package == "cholmod":
            self._options["mat_cholmod_print"] = 0  # failures are raised, not printed
        if package == "mumps":
            self._options[WORKSPACE] = 60
        self._options |= dict(options or {})
        self.package = str(self._options["pc_factor_mat_solver_type"])
        self._often, self._name = often, name
        self._blocks: NodeBlocks | None = None
        self._create_ksp()
        self._stale = True

    def _create_ksp(self) -> None:
        self._ksp = PETSc.KSP().create(self._matrix.comm)
        self._ksp.setOptionsPrefix(f"dolfinx_joints_{self._name}_")

    def refresh(self) -> None:
        """Factor the matrix anew at the next solve."""
        self._stale = True

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; return True if this call factored the matrix (collective)."""
        factored = self._factor_if_stale()
        with self._errors_converted():
            (self._blocks or self._ksp).solve(b, x)
        if self._ksp.getConvergedReason() < 0 or (factored and not self._solves(b, x)):
            self._stale = True
            raise JointsError(why_singular(self._matrix))
        return factored

    def solve_block(self, right_hand_sides: Floats) -> Floats:
        """Solve A X = B for several right-hand sides at once (collective).

        The factor is read once per block instead of once per column. A column is then several times
        cheaper; `BLOCK_COLUMNS` is a good number of columns.

        Args:
            right_hand_sides: Owned rows of B, shape (local rows, columns), [N]; the number of
                columns is the same on all ranks.

        Returns:
            Owned rows of X, of the same shape, each column contiguous, [m].
        """
        factored = self._factor_if_stale()
        if right_hand_sides.shape[1] == 0:
            return right_hand_sides.copy()
        b = _dense(right_hand_sides, self._matrix.getSizes()[0], self._matrix.comm)
        x = self._empty(right_hand_sides.shape[1])
        with self._errors_converted():
            if self._blocks is None:
                self._ksp.getPC().getFactorMatrix().matSolve(b, x)
            else:
                # Use the factor of the steps: for a nearly singular matrix the solutions of two
                # factors differ.
                self._blocks.solve_block(right_hand_sides, x.getDenseArray())
        if factored and not self._solves_block(b, x):
            self._stale = True
            raise JointsError(why_singular(self._matrix))
        solution = x.getDenseArray(readonly=True).copy(order="F")
        b.destroy()
        x.destroy()
        return solution

    def solve_sparse(self, rows: PETSc.Mat) -> Floats:
        """Solve A X = B for right-hand sides with few entries, by MUMPS (collective).

        MUMPS reads only the part of the factor that depends on these entries, and the ranks
        exchange only entries. This method is two to three times as fast as `solve_block`.

        Args:
            rows: B^T, sparse, with all rows on rank 0, [N].

        Returns:
            Owned rows of X, shape (local rows, columns), each column contiguous, [m].
        """
        if self._stale:
            load, response = self._matrix.createVecs()
            load.setRandom()
            self.solve(load, response)  # factor, and check that the factor is valid
        right_hand_sides, x = PETSc.Mat().createTranspose(rows), self._empty(rows.getSize()[0])
        with self._errors_converted():
            self._ksp.getPC().getFactorMatrix().matSolve(right_hand_sides, x)
        solution: Floats = x.getDenseArray(readonly=True).copy(order="F")
        right_hand_sides.destroy()
        x.destroy()
        return solution

    def _empty(self, columns: int) -> PETSc.Mat:
        """Return an empty dense matrix for the solutions."""
        rows = self._matrix.getSizes()[0]
        dense = PETSc.Mat().createDense((rows, (PETSc.DECIDE, columns)), comm=self._matrix.comm)
        return dense.setUp()

    def _solves(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Return True if a new factor is valid. LU may not report that a matrix is singular."""
        residual = b.duplicate()
        self._matrix.mult(x, residual)
        residual.axpy(-1.0, b)
        return bool(residual.norm() <= limits.FACTOR_RESIDUAL * b.norm())

    def _solves_block(self, b: PETSc.Mat, x: PETSc.Mat) -> bool:
        """Return True if a new factor is valid, judged by the solutions of a block."""
        residual = self._matrix.matMult(x)
        residual.axpy(-1.0, b)
        solves = bool(residual.norm() <= limits.FACTOR_RESIDUAL * b.norm())
        residual.destroy()
        return solves

    def _factor_if_stale(self) -> bool:
        """Factor the matrix if it has changed; return True if a factor was computed."""
        if not self._stale:
            return False
        failure = self._factor()
        if failure == OUT_OF_MEMORY:
            # MUMPS estimates its workspace before pivoting: repeat once with a far larger one.
            self._ksp.destroy()
            self._create_ksp()
            self._options[WORKSPACE] = MORE_WORKSPACE
            failure = self._factor()
        if failure:
            self._raise_failure(failure)
        self._stale = False
        self._add_node_blocks()
        return True

    def _add_node_blocks(self) -> None:
        """Add a factor in node blocks if that factor is faster."""
        if self._blocks is not None:
            self._blocks.destroy()
            self._blocks = None
        if self._often and self.package == "cholmod":
            entries = self._ksp.getPC().getFactorMatrix().getInfo()["nz_used"]
            if NodeBlocks.serves(self._matrix, entries):
                self._blocks = NodeBlocks(self._matrix)

    def _raise_failure(self, failure: int) -> None:
        """Raise an error that explains the failed factorization, and reset MUMPS' error state."""
        reported = reported_by_package(self._ksp.getPC())
        self._ksp.destroy()
        self._create_ksp()
        if failure == OUT_OF_MEMORY:
            raise JointsError(f"{NO_MEMORY}{reported}.")
        if failure in ZERO_PIVOT:
            why = why_singular(self._matrix)
            raise JointsError(why[:-1] + reported + why[-1])
        reason = reported or f"; PETSc's reason is {failure}"
        raise JointsError(f"The matrix could not be factored{reason}.")

    def _factor(self) -> int:
        """Factor the matrix; return PETSc's reason for a failure, or 0."""
        with options_set(self._ksp.getOptionsPrefix(), self._options):
            self._ksp.setOperators(self._matrix)
            with self._errors_converted():
                self._ksp.setFromOptions()
                self._ksp.setUp()
                self._ksp.getPC().viewFromOptions("-pc_view")
        return int(self._ksp.getPC().getFailedReason())

    @contextmanager
    def _errors_converted(self) -> Iterator[None]:
        """Convert an error of PETSc into a `JointsError` (collective)."""
        try:
            yield
        except PETSc.Error as exc:
            self._stale = True
            raise JointsError(of_error(exc, self._matrix)) from None

    def destroy(self) -> None:
        """Free the factors."""
        self._ksp.destroy()
        if self._blocks is not None:
            self._blocks.destroy()


class SignedSolver(DirectSolver):
    """Solver that factors D_s A = L D L^T instead of A = L U; D_s is the diagonal of row signs.

    L D L^T takes half the memory and factorization time. The symmetric part of A is positive
    definite; the skew part couples the two kinds of rows. D_s A is therefore quasi-definite, so its
    factors exist for any order of the unknowns (Vanderbei 1995).

    Args:
        matrix: A.
        signs: 1 or -1 for each row.
    """

    def __init__(self, matrix: PETSc.Mat, signs: PETSc.Vec) -> None:
        """Change the signs of the rows in a copy of the matrix (collective)."""
        signed = matrix.copy()
        signed.diagonalScale(L=signs)
        self._signs = signs
        super().__init__(signed, symmetric=True, mumps=True)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve A x = b; return True if this call factored the matrix (collective)."""
        right_hand_side = b.duplicate()
        right_hand_side.pointwiseMult(b, self._signs)
        return super().solve(right_hand_side, x)

    def solve_block(self, right_hand_sides: Floats) -> Floats:
        """Solve A X = B for several right-hand sides at once (collective)."""
        return super().solve_block(self._signs.getArray(readonly=True)[:, None] * right_hand_sides)

    def destroy(self) -> None:
        """Free the factor and the copy."""
        super().destroy()
        self._matrix.destroy()


def multiplied(matrix: PETSc.Mat, columns: Floats) -> Floats:
    """Return a matrix times the owned rows of columns, each column contiguous (collective)."""
    if not columns.shape[1]:
        return np.zeros((matrix.getLocalSize()[0], 0))
    factor = _dense(columns, matrix.getSizes()[1], matrix.comm)
    product = matrix.matMult(factor)
    result: Floats = product.getDenseArray(readonly=True).copy(order="F")
    product.destroy()
    factor.destroy()
    return result


def _dense(rows: Floats, sizes: tuple[int, int], comm: PETSc.Comm) -> PETSc.Mat:
    """Return a dense matrix of the ranks' rows; ``sizes`` are the local and global row counts."""
    size = (sizes, (PETSc.DECIDE, rows.shape[1]))
    return PETSc.Mat().createDense(size, array=np.asfortranarray(rows), comm=comm)
