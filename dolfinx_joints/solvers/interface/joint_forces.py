# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint forces of one step as a problem of the semi-smooth Newton method.

The symbols f, r, S, and the equations (23) and (24), are those of `joint_step`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.corrections import Correction
from dolfinx_joints.solvers.interface.joint_step import Iterate, JointStep
from dolfinx_joints.solvers.newton_loop import forcing
from dolfinx_joints.solvers.step_solver import StepSolver

Floats = NDArray[np.float64]


class JointForces:
    """Equation r(f) = 0 for the scaled joint forces f of a step (23).

    Args:
        solver: Solver of the step.
        step: The step.
        starts: Pairs (f, S f); the iteration starts from the pair with the smallest residual.
    """

    def __init__(
        self, solver: StepSolver, step: JointStep, starts: Sequence[tuple[Floats, Floats]]
    ) -> None:
        """Set the target residual and the forcing term of the first correction."""
        self._solver, self._step, self._starts = solver, step, starts
        condensed, self._tolerance = step.condensed, solver.options.relative_tolerance
        self._corrections = condensed.corrections
        self._target, self._forcing = limits.END_OF_STEPS * self._tolerance, limits.JOINT_FORCING
        if condensed.static:
            self._target = limits.END_OF_STATICS if condensed.springs is None else limits.BALANCED
            self._forcing = limits.STATIC_FORCING

    def start(self) -> Iterate:
        """Return the start with the smallest residual (collective)."""
        iterates = [self._step.evaluate(*start) for start in self._starts]
        return min(iterates, key=lambda iterate: iterate.norm)

    def accepted(self, at: Iterate) -> Iterate:
        """Return the iterate, with S f recomputed if its error matters (collective)."""
        if at.error > max(limits.STALE * at.max_residual, self._negligible_error(at)):
            at = self._step.evaluate(at.force, self._corrections.product(at.force))
        if at.max_residual and not at.max_force:
            # All forces of the laws are zero: f = 0 then has a residual without rounding error.
            zero = np.zeros_like(at.force)
            at = min(at, self._step.evaluate(zero, zero), key=lambda iterate: iterate.norm)
        return at

    def solved(self, at: Iterate, before: Iterate | None, *, last: bool) -> bool:
        """Return True if the residual is below the target, or accepted and no longer falling."""
        relative, accepted = self._step.residual_and_limit(at, self._tolerance)
        ends = last or (
            before is not None and at.max_residual >= limits.STALLED * before.max_residual
        )
        return relative <= self._target or (relative <= accepted and ends)

    def correction(self, at: Iterate, before: Iterate | None) -> Correction:
        """Return Newton's correction of f (collective)."""
        relative, size = self.relative(at), at.max_residual
        reduction = size / before.max_residual if before and before.max_residual else 1.0
        tolerance = forcing(self._forcing, reduction, self._target / relative)
        # Drop converged entries of r, so that they cost no product with S.
        smallest = limits.CONVERGED_ENTRIES * self._target * at.reference_force
        error = at.error + self._corrections.rough * size
        exactly = error > max(limits.STALE_NEXT * relative * size, self._negligible_error(at))
        correction = self._corrections.solve(
            at.residual, at.tangent, smallest, tolerance, couples=not exactly
        )
        if exactly:
            coupled = at.coupled - self._corrections.product(at.force - correction.step)
            return Correction(correction.step, coupled, -at.error)
        return correction

    def trial(self, at: Iterate, correction: Correction, share: float) -> Iterate:
        """Return the iterate after subtracting a share of a correction (collective)."""
        return self._step.evaluate(
            at.force - share * correction.step,
            at.coupled - share * correction.coupled,
            at.error + share * correction.error,
        )

    def failure(self, at: Iterate, before: Iterate | None, iterations: int) -> ConvergenceError:
        """Return the error of an iteration that did not converge (collective)."""
        # A NaN in the tangent appears only in the next iterate, so check both.
        responses = [self._step.response(iterate) for iterate in (at, before or at)]
        not_finite = (item for item in responses if self._step.contact.not_finite(item))
        response = next(not_finite, responses[0])
        return self._solver.failure(response, self._step.state, iterations, self.relative(at))

    def relative(self, at: Iterate) -> float:
        """Return the residual relative to the largest force."""
        return self._step.residual_and_limit(at, self._tolerance)[0]

    def _negligible_error(self, at: Iterate) -> float:
        """Return the largest error of S f that is negligible."""
        return limits.NEGLIGIBLE * self._target * (at.max_force or at.max_residual)
