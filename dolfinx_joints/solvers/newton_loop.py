# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method with a line search, for any problem that evaluates and corrects its iterates."""

from __future__ import annotations

import math
from typing import Protocol, TypeVar

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.step_solver import SolverOptions


class Iterate(Protocol):
    """An iterate of a problem; all that its residual and tangent need, none of it changed later."""

    @property
    def norm(self) -> float:
        """Norm of the residual, which the line search makes smaller."""


AnyIterate = TypeVar("AnyIterate", bound=Iterate)
AnyCorrection = TypeVar("AnyCorrection")


class Problem(Protocol[AnyIterate, AnyCorrection]):
    """Equations that `newton` solves; all methods are collective."""

    def start(self) -> AnyIterate:
        """Return the first iterate."""

    def trial(self, at: AnyIterate, correction: AnyCorrection, share: float) -> AnyIterate:
        """Return the iterate that a share of a correction leads to."""

    def accepted(self, at: AnyIterate) -> AnyIterate:
        """Return the iterate to continue with from the start, or from the best trial."""

    def solved(self, at: AnyIterate, before: AnyIterate | None, *, last: bool) -> bool:
        """Return True if an iterate is the solution.

        Args:
            at: The iterate.
            before: The iterate before it, None at the start.
            last: Whether no iteration can follow.
        """

    def correction(self, at: AnyIterate, before: AnyIterate | None) -> AnyCorrection | None:
        """Return Newton's correction, to be subtracted; None if the iterate needs no correction."""

    def failure(
        self, at: AnyIterate, before: AnyIterate | None, iterations: int
    ) -> ConvergenceError:
        """Return the error of an iteration that did not converge."""


def newton(
    problem: Problem[AnyIterate, AnyCorrection], options: SolverOptions, *, leaps: bool = True
) -> tuple[AnyIterate, list[float]]:
    """Return the solution, and the norms of the residual at the start and after each iteration.

    Corrections are halved while the residual does not fall. It has kinks where points open or
    slide. Corrections halved until it falls may creep towards a kink that is no solution; a few
    whole ones leave it.

    Args:
        problem: The equations.
        options: Limits of iterations and halvings.
        leaps: Whether corrections may be taken whole. Beyond the limit of plastic cells they run
            away, until the residual is little beside the stiffness times the displacement.

    Raises:
        ConvergenceError: No solution was found.
    """
    before, at = None, problem.accepted(problem.start())
    norms, whole, first = [at.norm], 0, 0
    while True:
        last = len(norms) > options.max_iterations or not math.isfinite(at.norm)
        if problem.solved(at, before, last=last):
            return at, norms
        if last:
            raise problem.failure(at, before, len(norms) - 1)
        correction = problem.correction(at, before)
        if correction is None:
            return at, norms
        if leaps and len(norms) - first > limits.PATIENCE:
            slow = norms[-1] > limits.LEAST_FALL * norms[-1 - limits.PATIENCE]
            whole = limits.WHOLE_CORRECTIONS if slow else whole
        cuts = 0 if whole else options.max_cuts
        if whole:
            whole, first = whole - 1, len(norms)
        before, at = at, problem.accepted(_best(problem, at, correction, cuts))
        norms.append(at.norm)


def _best(
    problem: Problem[AnyIterate, AnyCorrection],
    at: AnyIterate,
    correction: AnyCorrection,
    cuts: int,
) -> AnyIterate:
    """Return the first trial with a smaller residual, else the best of all (collective)."""
    best = problem.trial(at, correction, 1.0)
    for cut in range(1, cuts + 1):
        if best.norm < at.norm:
            break
        trial = problem.trial(at, correction, 0.5**cut)
        if not best.norm <= trial.norm:  # true of a best trial that is NaN
            best = trial
    return best


def forcing(first: float, fallen: float, target: float) -> float:
    """Return the part of the residual that a correction may leave (Eisenstat and Walker 1996).

    Args:
        first: Part that the first correction may leave.
        fallen: Residual over that of the iterate before, 1 at the start.
        target: Residual accepted over the residual.
    """
    return max(min(first, fallen**2), limits.FORCING_MARGIN * target)
