# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices A = m M + c C + k K of a system with constraints, cached by their coefficients."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.memory import factor_fits
from dolfinx_joints.model.exact_modes import ModalStep, lowest_modes
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.batch import BatchScheduler
from dolfinx_joints.solvers.direct import DirectSolver, SignedSolver
from dolfinx_joints.solvers.modal_change import ChangedSolver, ModalChange
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

LinearSolver = Literal["auto", "direct", "mumps", "iterative"]


@dataclass(frozen=True, kw_only=True)
class MatrixCoefficients:
    """Coefficients of A = mass M + damping C + stiffness K.

    Attributes:
        mass: Coefficient of M.
        damping: Coefficient of C.
        stiffness: Coefficient of K.
        exact_modes: Number of lowest modes with the mass and damping of a `ModalStep`. Only for
            midpoint steps, in which ``damping`` is 1 / dt.
    """

    mass: float
    damping: float
    stiffness: float
    exact_modes: int = 0

    def modal_step(self, system: MatrixSystem) -> ModalStep | None:
        """Return the mass and damping of the exact modes, None without exact modes (collective)."""
        if not self.exact_modes:
            return None
        step = lowest_modes(system, self.exact_modes).step(2.0 * self.damping)
        return step if step.used else None


# Coefficients of statics: A = K.
STATIC = MatrixCoefficients(mass=0.0, damping=0.0, stiffness=1.0)


class EffectiveMatrix:
    """Matrix A = m M + c C + k K of a system, with and without its constraints.

    Args:
        system: System with M, C, K and the constraints.
        effective: The coefficients.
        linear: ``direct``, ``mumps`` (direct, without CHOLMOD), ``iterative``, or ``auto``:
            iterative if A is symmetric and its factor may not fit into memory, else direct.
        added: Matrix added to A.

    Attributes:
        full: A, without the change by exact and damped modes.
        constrained: A with rows and columns of constrained dofs replaced by a diagonal.
        change: Change of both matrices by exact and damped modes, None without such modes.
        norm: Infinity norm of A.
        inertia: True if A is the matrix of a time step.
        symmetric: True if A is symmetric after changing the sign of the rows of waves in water.
        scheduler: Scheduler of the runs that share this matrix (`SharedBulk`), None for one run.
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        *,
        linear: LinearSolver = "auto",
        added: PETSc.Mat | None = None,
    ) -> None:
        """Sum the matrices (collective)."""
        if linear == "iterative" and not system.symmetric:
            raise ValueError("linear='iterative' needs symmetric matrices; use 'direct' or 'auto'.")
        if linear == "iterative" and system.coupled is not None:
            raise ValueError(
                "linear='iterative' needs positive definite matrices and does not support waves in "
                "water; use 'direct' or 'auto'."
            )
        self.full = system.combined(effective.mass, effective.damping, effective.stiffness)
        if added is not None:
            self.full.axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.constrained = self.full.copy()
        rows = (system.constrained + self.constrained.getOwnershipRange()[0]).astype(PETSc.IntType)
        self.constrained.zeroRowsColumns(rows, diag=_mean_diagonal(self.full))
        self.norm = float(self.full.norm(PETSc.NormType.NORM_INFINITY))
        self.inertia = effective.mass > 0.0
        self.symmetric, self._supports_move = system.symmetric, system.values is not None
        self._linear, self._iterates = linear, iterates(system, linear)
        self._signs = None if system.coupled is None else system.coupled.signs
        self.scheduler: BatchScheduler | None = (
            None if system.shared is None else system.shared.scheduler
        )
        self._started = False
        self._rigid_body_modes = system.stiffness.getNearNullSpace()
        self._solver: DirectSolver | IterativeSolver | None = None
        self.change = _modal_change(system, effective)
        self._changed: ChangedSolver | None = None

    @classmethod
    def of(
        cls, system: MatrixSystem, effective: MatrixCoefficients, *, linear: LinearSolver = "auto"
    ) -> EffectiveMatrix:
        """Return the matrix of a system, shared between the runs of a batch (collective)."""
        if system.shared is None:
            return cls(system, effective, linear=linear)
        key = ("matrix", effective, linear)
        made: EffectiveMatrix = system.shared.once(
            key, lambda: cls(system, effective, linear=linear), cls._free
        )
        return made

    @property
    def solver(self) -> DirectSolver | IterativeSolver:
        """Solver of ``constrained``, made on first use (collective).

        `solve` and `solve_block` also include the change by exact and damped modes.
        """
        if self._solver is None:
            self._solver = self._new_solver()
        return self._solver

    def _new_solver(self) -> DirectSolver | IterativeSolver:
        if not self._iterates:
            mumps = self._linear == "mumps"
            if self._signs is not None and self.symmetric:
                return SignedSolver(self.constrained, self._signs)
            often = self.inertia and self.scheduler is None
            return DirectSolver(
                self.constrained, symmetric=self.symmetric, mumps=mumps, often=often
            )
        self.constrained.setNearNullSpace(self._rigid_body_modes)
        return IterativeSolver(self.constrained)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, **options: float) -> bool:
        """Solve A x = b, x = 0 at constrained dofs; return True if A was factored (collective)."""
        if self.scheduler is None or options:
            return bool(self._complete.solve(b, x, **options))
        right_hand_side = b.getArray(readonly=True).copy()
        x.setArray(self.scheduler.request(self, self._solve_all, right_hand_side, deferrable=True))
        factored, self._started = not self._started, True
        return factored

    def _solve_all(self, right_hand_sides: list[Floats]) -> Sequence[Floats]:
        """Return the solutions for the right-hand sides of several runs (collective)."""
        return list(np.ascontiguousarray(self.solve_block(np.column_stack(right_hand_sides)).T))

    def solve_block(self, right_hand_sides: Floats) -> Floats:
        """Return the owned rows of X with A X = B for several right-hand sides (collective)."""
        return self._complete.solve_block(right_hand_sides)

    @property
    def positive(self) -> bool:
        """True if A is symmetric and solved directly, without water, whose rows change sign."""
        return self.symmetric and self._signs is None and not self._iterates

    def modal_parts(self) -> tuple[Floats, Floats] | None:
        """Return Z and W of `ChangedSolver`, None without exact or damped modes (collective)."""
        complete = self._complete
        return complete.parts() if isinstance(complete, ChangedSolver) else None

    def multiply(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """Write A x to ``out`` (collective)."""
        self.full.mult(x, out)
        if self.change is not None:
            self.change.add_product(x, out)

    @property
    def _complete(self) -> DirectSolver | IterativeSolver | ChangedSolver:
        if self.change is None:
            return self.solver
        if self._changed is None:
            self._changed = ChangedSolver(self.solver, self.change)
        return self._changed

    def refine(self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec) -> PETSc.Vec:
        """Refine x in place by a solve for its residual; return the change of x (collective)."""
        residual, change = b.duplicate(), x.duplicate()
        self.full.mult(x, residual)
        residual.aypx(-1.0, b)
        residual.pointwiseMult(residual, unconstrained)
        self.solve(residual, change)
        change.pointwiseMult(change, unconstrained)
        x.axpy(1.0, change)
        return change

    def solve_linear(
        self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec, **options: float
    ) -> bool:
        """Solve A x = b in place for given values of x at the constrained dofs (collective).

        Args:
            b: Right-hand side [N].
            x: Given values at the constrained dofs, solution at the others [m].
            unconstrained: 1 for unconstrained and 0 for constrained dofs.
            options: Options of an iterative solver.

        Returns:
            True if the matrix was factored for this solve.
        """
        right_hand_side = b.duplicate()
        right_hand_side.pointwiseMult(b, unconstrained)
        if not self._supports_move:
            x.set(0.0)
            factored = self.solve(right_hand_side, x, **options)
            # Iterative solvers leave small values at constrained dofs; reset them to zero.
            x.pointwiseMult(x, unconstrained)
            return factored
        prescribed, forces = x.duplicate(), b.duplicate()
        prescribed.pointwiseMult(x, unconstrained)
        prescribed.aypx(-1.0, x)
        self.multiply(prescribed, forces)
        forces.pointwiseMult(forces, unconstrained)
        right_hand_side.axpy(-1.0, forces)
        factored = self.solve(right_hand_side, x, **options)
        x.pointwiseMult(x, unconstrained)
        x.axpy(1.0, prescribed)
        return factored

    def destroy(self) -> None:
        """Free the matrices and the factor, unless other runs use them."""
        if self.scheduler is None:
            self._free()

    def _free(self) -> None:
        if self._solver is not None:
            self._solver.destroy()
        self.full.destroy()
        self.constrained.destroy()


def _modal_change(system: MatrixSystem, effective: MatrixCoefficients) -> ModalChange | None:
    """Return the change of A by exact and damped modes, None without such modes (collective)."""
    changes, comm = [], system.mass.comm.tompi4py()
    step = effective.modal_step(system)
    if step is not None:
        changes.append(
            ModalChange(
                step.modes.weighted(step.used),
                step.change(effective.mass, effective.damping),
                lambda x: effective.mass * step.of_supports(x),
                comm,
            )
        )
    damped = system.damped_modes
    if damped is not None and effective.damping:
        columns = damped.columns(system.mass.createVecRight())
        delta = effective.damping * damped.rates
        changes.append(ModalChange(columns, delta, lambda _: np.zeros_like(delta), comm))
    if len(changes) == 2:
        return changes[0].joined_with(changes[1])
    return changes[0] if changes else None


class Cache:
    """Cache of the last few objects by key; the oldest one is destroyed when the cache is full."""

    def __init__(self, make: Any, *, size: int) -> None:
        """Store the size and ``make``, which returns the object of a key."""
        self._make, self._size = make, size
        self._kept: OrderedDict[Any, Any] = OrderedDict()

    def __call__(self, key: Any) -> Any:
        """Return the object of a key; make the object if it is not in the cache."""
        if key not in self._kept:
            while len(self._kept) >= self._size:
                self._kept.popitem(last=False)[1].destroy()
            self._kept[key] = self._make(key)
        self._kept.move_to_end(key)
        return self._kept[key]

    def items(self) -> list[tuple[Any, Any]]:
        """Return the keys and objects in the order of their last use."""
        return list(self._kept.items())


def iterates(system: MatrixSystem, linear: LinearSolver) -> bool:
    """Return True if linear systems with the matrices are solved by iteration (collective)."""
    if linear != "auto":
        return linear == "iterative"
    if not system.symmetric or system.coupled is not None:
        return False
    comm, dofs = system.stiffness.comm.tompi4py(), system.stiffness.getSize()[0]
    return not factor_fits(comm, dofs, system.components)


def unconstrained_dofs(system: MatrixSystem) -> PETSc.Vec:
    """Return a vector that is 1 at unconstrained and 0 at constrained dofs."""
    mask = system.stiffness.createVecRight()
    mask.set(1.0)
    mask.getArray()[system.constrained] = 0.0
    return mask


def _mean_diagonal(matrix: PETSc.Mat) -> float:
    diagonal = matrix.getDiagonal()
    return float(diagonal.norm(PETSc.NormType.NORM_1) / max(matrix.getSize()[0], 1)) or 1.0
