# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solution of the transposed linearised equation of a step, with the factor of the forward run.

With the tangents D of the laws, (A + B^T w D^T B) z = b (42) is condensed onto the joints in the
same way as the step itself: q = B z are the adjoint gaps, and the adjoint forces solve (43), which
has the form (24) of Newton's corrections with transposed tangents.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.gradient.tape import Step
from dolfinx_joints.solvers.effective_matrix import unconstrained_dofs
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.solver import InterfaceSolver

# Target residual relative to the right-hand side, of adjoint forces and of (42) in statics; largest
# accepted residual; most corrections of the forces, which gain the digits of single precision each.
TARGET, ACCEPTED, CORRECTIONS = 1e-11, 1e-8, 12


class TransposedStep:
    """Transposed equations of the steps of one stage.

    Args:
        solver: Solver of the stage.
    """

    def __init__(self, solver: InterfaceSolver) -> None:
        """Create the work vectors (collective)."""
        assert solver.system.contact is not None
        self._solver, self._operator = solver, solver.system.contact.operator
        self._free = unconstrained_dofs(solver.system)
        self._nodal, self._change = self._free.duplicate(), self._free.duplicate()

    def add_gaps(self, gaps: Floats, out: PETSc.Vec) -> None:
        """Add B^T times values of the points, shape (n, 3), to a nodal vector (collective)."""
        out.axpy(1.0, self._operator.force(gaps / self._operator.areas[:, None], self._nodal))

    def solve(self, step: Step, tangent: Floats, b: PETSc.Vec) -> tuple[PETSc.Vec, Floats]:
        """Return z, zero at constrained dofs, and q = B z of shape (n, 3) (collective).

        Args:
            step: Recorded step.
            tangent: D^T of the points, shape (n, 3, 3), [Pa/m].
            b: Right-hand side.

        Raises:
            JointsError: The equation is singular.
        """
        condensed = self._solver.condensed(step.coefficients, step.rule)
        own = np.repeat(condensed.compliance.own, (1, 2), axis=1)
        if condensed.springs is not None:
            stiffness = np.repeat(condensed.springs.stiffness, (1, 2), axis=1)
            tangent = tangent - stiffness[:, :, None] * np.eye(3)
        on_compliance = np.linalg.solve(np.eye(3) + tangent * own[:, None, :], tangent)
        scaled = condensed.force_scale.reshape(-1, 3, 1) * on_compliance
        scaled = scaled * condensed.scale.reshape(-1, 1, 3)
        z, relative = self._response(condensed, scaled, b)
        if condensed.static:
            # Soft springs and large rigid motions amplify rounding errors: refine z. If a block can
            # move freely, this may fail although the part of z that matters is determined.
            self._nodal.pointwiseMult(b, self._free)
            size, last, trial = self._nodal.norm() or 1.0, np.inf, z
            while (norm := (r := self._residual(condensed, tangent, b, trial)).norm()) < 0.5 * last:
                z, last, relative = trial, norm, norm / size
                if relative <= TARGET:
                    break
                trial = z + self._response(condensed, scaled, r)[0]
        if not relative <= ACCEPTED:
            raise JointsError(
                f"The linearised equation of a step at t = {step.times[1]:.6g} s is singular or "
                "nearly singular: a block can move freely, and the quantity has no derivative "
                f"(relative residual {relative:.1e}). Springs or friction can support the block."
            )
        return z, self._operator.jump(z)

    def _response(
        self, condensed: Condensed, scaled: Floats, b: PETSc.Vec
    ) -> tuple[PETSc.Vec, float]:
        """Return z for a right-hand side, and the relative residual of the forces (collective)."""
        z, matrix, scale = b.duplicate(), condensed.matrix, condensed.compliance.scale
        self._nodal.pointwiseMult(b, self._free)
        matrix.solve(self._nodal, z)
        gaps = self._operator.jump(z).ravel() / scale
        force, relative = self._forces(condensed, scaled, _times(scaled, gaps))
        tractions = (force / scale).reshape(-1, 3) / self._operator.areas[:, None]
        self._operator.force(tractions, self._nodal)
        self._nodal.pointwiseMult(self._nodal, self._free)
        matrix.solve(self._nodal, self._change)
        z.axpy(-1.0, self._change)
        z.pointwiseMult(z, self._free)
        return z, relative

    def _residual(
        self, condensed: Condensed, tangent: Floats, b: PETSc.Vec, z: PETSc.Vec
    ) -> PETSc.Vec:
        """Return b minus the left-hand side at the unconstrained dofs (collective)."""
        residual = b.duplicate()
        condensed.matrix.multiply(z, residual)
        residual.aypx(-1.0, b)
        traction = _times(tangent, self._operator.jump(z)).reshape(-1, 3)
        residual.axpy(-1.0, self._operator.force(traction, self._nodal))
        residual.pointwiseMult(residual, self._free)
        return residual

    def _forces(self, condensed: Condensed, scaled: Floats, target: Floats) -> tuple[Floats, float]:
        """Return f of (I + T S) f = target, shape (m,), and its relative residual (collective)."""
        corrections, comm = condensed.corrections, self._operator.comm
        force, residual, last = np.zeros_like(target), target, np.inf
        largest = size = _largest(comm, target)
        trial = force
        for _ in range(CORRECTIONS):
            if not size < last:
                break
            force, last = trial, size
            if size <= TARGET * largest:
                break
            trial = force + corrections.solve(residual, scaled, 0.0, 1e-6, couples=False).step
            residual = target - trial - _times(scaled, corrections.product(trial))
            size = _largest(comm, residual)
        return force, last / (largest or 1.0)


def _times(blocks: Floats, values: Floats) -> Floats:
    """Return blocks (n, 3, 3) times values of the points, shape (3 n,)."""
    return np.einsum("nij,nj->ni", blocks, values.reshape(-1, 3)).ravel()


def _largest(comm: Any, values: Floats) -> float:
    """Return the largest absolute value of all ranks (collective)."""
    return float(of_ranks(comm, np.array([np.abs(values).max(initial=0.0)])).max())
