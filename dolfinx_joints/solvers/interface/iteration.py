# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Semi-smooth Newton iteration on the joint forces of one step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.solvers.interface.corrections import Correction
from dolfinx_joints.solvers.interface.joint_step import Iterate, JointStep
from dolfinx_joints.solvers.line_search import LineSearch

Floats = NDArray[np.float64]

# Corrections add the rounding error of single precision to S f. If it exceeds STALE of the
# residual, S f is computed anew; if it will exceed NEXT of the next residual, were convergence
# quadratic, the next S f is computed in double precision. Both are omitted if the error is below
# LITTLE of the target residual; with W the true error was up to eight times the estimate.
STALE, NEXT, LITTLE = 0.1, 0.3, 0.03


class NotConvergedError(Exception):
    """The iteration has ended without a solution.

    Attributes:
        at: Last iterate.
        before: The iterate before it.
        iterations: Iterations.
        relative: Residual of the last iterate, relative to the largest force.
    """

    def __init__(self, at: Iterate, before: Iterate, iterations: int, relative: float) -> None:
        """Keep the iterates."""
        super().__init__()
        self.at, self.before, self.iterations, self.relative = at, before, iterations, relative


class Iteration:
    """Newton iterations with their tolerances.

    Args:
        step: The step.
        tolerance: Largest residual accepted, relative to the largest force.
        enough: Residual at which the iteration ends at once, relative likewise.
        inner: Residual of the corrections, relative to their right-hand sides, at first.
        max_iterations: Largest number of iterations.
        max_cuts: Largest number of halvings of a correction.
    """

    def __init__(
        self,
        step: JointStep,
        *,
        tolerance: float,
        enough: float,
        inner: float,
        max_iterations: int,
        max_cuts: int,
    ) -> None:
        """Keep them."""
        self._step, self._corrections = step, step.condensed.corrections
        self._tolerance, self._enough, self._inner = tolerance, enough, inner
        self._max_iterations, self._max_cuts = max_iterations, max_cuts

    def solve(self, starts: Sequence[tuple[Floats, Floats]]) -> tuple[Iterate, int, float]:
        """Solve r(f) = 0 from the best start, f and S f (collective).

        Returns:
            The solution, iterations, and residual relative to the largest force.

        Raises:
            NotConvergedError: No solution was found.
        """
        tried = [self._step.evaluate(*start) for start in starts]
        before = at = min(tried, key=lambda each: each.norm)
        iteration, last, inner = 0, np.inf, self._inner
        line_search = LineSearch(self._max_cuts)
        while True:
            little = LITTLE * self._enough * (at.largest or at.worst)
            if at.error > max(STALE * at.worst, little):
                at = self._step.evaluate(at.force, self._corrections.product(at.force))
            if at.worst and not at.largest:
                # The laws give no force at all: without any, nothing is left of rounding either.
                nothing = np.zeros_like(at.force)
                at = min(at, self._step.evaluate(nothing, nothing), key=lambda each: each.norm)
            size, scale = at.worst, at.largest or at.worst or 1.0
            relative, accepted = self._step.judged(at, scale, self._tolerance)
            if relative <= self._enough or (relative <= accepted and size >= 0.5 * last):
                return at, iteration, relative
            if iteration == self._max_iterations or not 0.0 < size < np.inf:
                if relative <= accepted:
                    return at, iteration, relative
                raise NotConvergedError(at, before, iteration, relative)
            if iteration:
                inner = min(self._inner, (size / last) ** 2)
            # Entries of r that are already converged are left out: they cost no product.
            least = 0.1 * self._enough * scale
            tolerance = max(inner, 0.3 * self._enough / relative)
            error = at.error + self._corrections.rough * size
            exactly = error > max(NEXT * relative * size, little)
            correction = self._corrections.solve(
                at.residual, at.tangent, least, tolerance, couples=not exactly
            )
            if exactly:
                coupled = at.coupled - self._corrections.product(at.force - correction.step)
                correction = Correction(correction.step, coupled, -at.error)
            before, at = at, self._search(at, correction, line_search.cuts(at.norm))
            iteration, last = iteration + 1, size

    def _search(self, at: Iterate, correction: Correction, cuts: int) -> Iterate:
        """Take the correction, halved until it makes the residual smaller (collective)."""
        best = at
        for cut in range(cuts + 1):
            share = 0.5**cut
            trial = self._step.evaluate(
                at.force - share * correction.step,
                at.coupled - share * correction.coupled,
                at.error + share * correction.error,
            )
            if cut == 0 or trial.norm < best.norm:
                best = trial
            if trial.norm < at.norm:
                break
        return best
