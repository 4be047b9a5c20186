# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices A = m M + c C + k K of a system with its constraints, kept by their coefficients."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.memory import factor_fits
from dolfinx_joints.model.exact_modes import ModalStep, lowest_modes
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.batch import Rounds
from dolfinx_joints.solvers.direct import DirectSolver, SignedSolver
from dolfinx_joints.solvers.modal_change import ChangedSolver, ModalChange
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver

Floats = NDArray[np.float64]
LinearSolver = Literal["auto", "direct", "mumps", "iterative"]


@dataclass(frozen=True, kw_only=True)
class MatrixCoefficients:
    """Coefficients of A = mass M + damping C + stiffness K.

    Attributes:
        mass: Of M.
        damping: Of C.
        stiffness: Of K.
        exact_modes: Number of lowest modes with the mass and damping of a `ModalStep`, in a
            midpoint step, whose ``damping`` is 1 / dt.
    """

    mass: float
    damping: float
    stiffness: float
    exact_modes: int = 0

    def modal_step(self, system: MatrixSystem) -> ModalStep | None:
        """Mass and damping of the exact modes, None without any (collective)."""
        if not self.exact_modes:
            return None
        step = lowest_modes(system, self.exact_modes).step(2.0 * self.damping)
        return step if step.used else None


# K alone.
STATIC = MatrixCoefficients(mass=0.0, damping=0.0, stiffness=1.0)


class EffectiveMatrix:
    """A = m M + c C + k K of a system, without and with its constraints.

    Args:
        system: Where M, C, K and the constraints come from.
        effective: The coefficients.
        linear: ``direct``, ``mumps`` (direct, without CHOLMOD), ``iterative``, or ``auto``:
            iterative where A is symmetric and its factor is not expected to fit into memory,
            direct elsewhere.
        added: Matrix added to A.

    Attributes:
        full: A, without what exact and damped modes add.
        constrained: A with rows and columns of constrained dofs replaced by a diagonal.
        change: What exact and damped modes add to both, None without any.
        norm: Infinity norm of A.
        inertia: Whether A is that of a time step.
        symmetric: Whether A is, with the sign of the rows of waves in water changed.
        rounds: Through which several runs solve with it, None for one run (`SharedBulk`).
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        *,
        linear: LinearSolver = "auto",
        added: PETSc.Mat | None = None,
    ) -> None:
        """Add the matrices up (collective)."""
        if linear == "iterative" and not system.symmetric:
            raise ValueError(
                "linear is 'iterative', which needs symmetric matrices; take 'direct' or 'auto'."
            )
        if linear == "iterative" and system.coupled is not None:
            raise ValueError(
                "linear is 'iterative', which needs positive matrices, without waves in water; "
                "take 'direct' or 'auto'."
            )
        self.full = system.combined(effective.mass, effective.damping, effective.stiffness)
        if added is not None:
            self.full.axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self.constrained = self.full.copy()
        rows = (system.constrained + self.constrained.getOwnershipRange()[0]).astype(PETSc.IntType)
        self.constrained.zeroRowsColumns(rows, diag=_mean_diagonal(self.full))
        self.norm = float(self.full.norm(PETSc.NormType.NORM_INFINITY))
        self.inertia = effective.mass > 0.0
        self.symmetric, self._moves = system.symmetric, system.values is not None
        self._linear, self._iterates = linear, iterates(system, linear)
        self._signs = None if system.coupled is None else system.coupled.signs
        self.rounds: Rounds | None = None if system.shared is None else system.shared.rounds
        self._answered = False
        self._near = system.stiffness.getNearNullSpace()
        self._solver: DirectSolver | IterativeSolver | None = None
        self.change = _modal_change(system, effective)
        self._changed: ChangedSolver | None = None

    @classmethod
    def of(
        cls, system: MatrixSystem, effective: MatrixCoefficients, *, linear: LinearSolver = "auto"
    ) -> EffectiveMatrix:
        """That of a system, or what it shares with others (collective)."""
        if system.shared is None:
            return cls(system, effective, linear=linear)
        key = ("matrix", effective, linear)
        made: EffectiveMatrix = system.shared.once(
            key, lambda: cls(system, effective, linear=linear), cls._free
        )
        return made

    @property
    def solver(self) -> DirectSolver | IterativeSolver:
        """Solver of ``constrained``, made when first asked for and then kept (collective).

        `solve` and `solve_block` add what exact and damped modes change.
        """
        if self._solver is None:
            self._solver = self._made()
        return self._solver

    def _made(self) -> DirectSolver | IterativeSolver:
        if not self._iterates:
            mumps = self._linear == "mumps"
            if self._signs is not None and self.symmetric:
                return SignedSolver(self.constrained, self._signs)
            often = self.inertia and self.rounds is None
            return DirectSolver(
                self.constrained, symmetric=self.symmetric, mumps=mumps, often=often
            )
        self.constrained.setNearNullSpace(self._near)
        return IterativeSolver(self.constrained)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, **options: float) -> bool:
        """Solve A x = b with zero at constrained dofs; whether A was factored (collective)."""
        if self.rounds is None or options:
            return bool(self._complete.solve(b, x, **options))
        right = b.getArray(readonly=True).copy()
        x.setArray(self.rounds.ask(self, self._solve_all, right, dear=True))
        factored, self._answered = not self._answered, True
        return factored

    def _solve_all(self, rights: list[Floats]) -> Sequence[Floats]:
        """Solutions of several runs (collective)."""
        return list(np.ascontiguousarray(self.solve_block(np.column_stack(rights)).T))

    def solve_block(self, right: Floats) -> Floats:
        """Solve A X = B for the owned rows of many right-hand sides (collective)."""
        return self._complete.solve_block(right)

    @property
    def positive(self) -> bool:
        """Whether A is symmetric and factored, and has no rows of water, which change its sign."""
        return self.symmetric and self._signs is None and not self._iterates

    def modal_parts(self) -> tuple[Floats, Floats] | None:
        """Z and W of `ChangedSolver`, beside `solver`; None without modes (collective)."""
        complete = self._complete
        return complete.parts() if isinstance(complete, ChangedSolver) else None

    def multiply(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """A x written to ``out`` (collective)."""
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

    def refine(self, right: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec) -> PETSc.Vec:
        """Solve A x = b again for the residual of x, corrected in place; return the change of x."""
        rest, change = right.duplicate(), x.duplicate()
        self.full.mult(x, rest)
        rest.aypx(-1.0, right)
        rest.pointwiseMult(rest, unconstrained)
        self.solve(rest, change)
        change.pointwiseMult(change, unconstrained)
        x.axpy(1.0, change)
        return change

    def solve_linear(
        self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec, **options: float
    ) -> bool:
        """Solve A x = b in place, x holding the values of the constrained dofs (collective).

        Args:
            b: Right-hand side [N].
            x: Values of the constrained dofs, the others replaced by the solution [m].
            unconstrained: 1 for unconstrained and 0 for constrained dofs.
            options: Those of an iterative solver.

        Returns:
            Whether the matrix was factored for it.
        """
        right = b.duplicate()
        right.pointwiseMult(b, unconstrained)
        if not self._moves:
            x.set(0.0)
            factored = self.solve(right, x, **options)
            # Iterations leave rounding there: clamped points would open.
            x.pointwiseMult(x, unconstrained)
            return factored
        prescribed, pushed = x.duplicate(), b.duplicate()
        prescribed.pointwiseMult(x, unconstrained)
        prescribed.aypx(-1.0, x)
        self.multiply(prescribed, pushed)
        pushed.pointwiseMult(pushed, unconstrained)
        right.axpy(-1.0, pushed)
        factored = self.solve(right, x, **options)
        x.pointwiseMult(x, unconstrained)
        x.axpy(1.0, prescribed)
        return factored

    def destroy(self) -> None:
        """Free matrices and factor, unless other runs use them."""
        if self.rounds is None:
            self._free()

    def _free(self) -> None:
        if self._solver is not None:
            self._solver.destroy()
        self.full.destroy()
        self.constrained.destroy()


def _modal_change(system: MatrixSystem, effective: MatrixCoefficients) -> ModalChange | None:
    """What exact and damped modes add to A, None without any (collective)."""
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
    """The last few things made, by key; what is pushed out is destroyed."""

    def __init__(self, make: Any, *, size: int) -> None:
        """``make`` gives the thing for a key."""
        self._make, self._size = make, size
        self._kept: OrderedDict[Any, Any] = OrderedDict()

    def __call__(self, key: Any) -> Any:
        """The thing for a key, made if need be."""
        if key not in self._kept:
            while len(self._kept) >= self._size:
                self._kept.popitem(last=False)[1].destroy()
            self._kept[key] = self._make(key)
        self._kept.move_to_end(key)
        return self._kept[key]

    def items(self) -> list[tuple[Any, Any]]:
        """Keys and things kept, the one used last at the end."""
        return list(self._kept.items())


def iterates(system: MatrixSystem, linear: LinearSolver) -> bool:
    """Whether matrices of a system are solved by iteration (collective)."""
    if linear != "auto":
        return linear == "iterative"
    if not system.symmetric or system.coupled is not None:
        return False
    comm, dofs = system.stiffness.comm.tompi4py(), system.stiffness.getSize()[0]
    return not factor_fits(comm, dofs, system.components)


def unconstrained_dofs(system: MatrixSystem) -> PETSc.Vec:
    """1 for unconstrained and 0 for constrained dofs."""
    mask = system.stiffness.createVecRight()
    mask.set(1.0)
    mask.getArray()[system.constrained] = 0.0
    return mask


def _mean_diagonal(matrix: PETSc.Mat) -> float:
    diagonal = matrix.getDiagonal()
    return float(diagonal.norm(PETSc.NormType.NORM_1) / max(matrix.getSize()[0], 1)) or 1.0
