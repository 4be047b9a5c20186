# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method with a line search, for any `Problem`."""

from __future__ import annotations

import math
from typing import Protocol, TypeVar

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.step_solver import SolverOptions


class Iterate(Protocol):
    """Immutable iterate of a problem, with all data of its residual and tangent."""

    @property
    def norm(self) -> float:
        """Norm of the residual, which the line search reduces."""


AnyIterate = TypeVar("AnyIterate", bound=Iterate)
AnyCorrection = TypeVar("AnyCorrection")


class Problem(Protocol[AnyIterate, AnyCorrection]):
    """Equations that `newton` solves; all methods are collective."""

    def start(self) -> AnyIterate:
        """Return the first iterate."""

    def trial(self, at: AnyIterate, correction: AnyCorrection, share: float) -> AnyIterate:
        """Return the iterate after subtracting a share of a correction."""

    def accepted(self, at: AnyIterate) -> AnyIterate:
        """Return the iterate that replaces the start or the best trial."""

    def solved(self, at: AnyIterate, before: AnyIterate | None, *, last: bool) -> bool:
        """Return True if an iterate is the solution.

        Args:
            at: The iterate.
            before: The previous iterate, None at the start.
            last: True if this is the last iteration.
        """

    def correction(self, at: AnyIterate, before: AnyIterate | None) -> AnyCorrection | None:
        """Return Newton's correction, to be subtracted; None if no correction is needed."""

    def failure(
        self, at: AnyIterate, before: AnyIterate | None, iterations: int
    ) -> ConvergenceError:
        """Return the error of an iteration that did not converge."""


def newton(
    problem: Problem[AnyIterate, AnyCorrection], options: SolverOptions, *, leaps: bool = True
) -> tuple[AnyIterate, list[float]]:
    """Return the solution, and the norms of the residual at the start and after each iteration.

    Corrections are halved until the residual falls. The residual has kinks where points open or
    slide. Halved corrections may creep towards a kink that is not a solution; a few full
    corrections then move away from the kink.

    Args:
        problem: The equations.
        options: Limits of iterations and halvings.
        leaps: True if full corrections may increase the residual. With nonlinear cells they diverge
            beyond the limit load, until the residual is small compared with K x.

    Raises:
        ConvergenceError: No solution was found.
    """
    before, at = None, problem.accepted(problem.start())
    norms, full_corrections, since = [at.norm], 0, 0
    while True:
        last = len(norms) > options.max_iterations or not math.isfinite(at.norm)
        if problem.solved(at, before, last=last):
            return at, norms
        if last:
            raise problem.failure(at, before, len(norms) - 1)
        correction = problem.correction(at, before)
        if correction is None:
            return at, norms
        if leaps and len(norms) - since > limits.PATIENCE:
            slow = norms[-1] > limits.LEAST_FALL * norms[-1 - limits.PATIENCE]
            full_corrections = limits.WHOLE_CORRECTIONS if slow else full_corrections
        cuts = 0 if full_corrections else options.max_cuts
        if full_corrections:
            full_corrections, since = full_corrections - 1, len(norms)
        before, at = at, problem.accepted(_best(problem, at, correction, cuts))
        norms.append(at.norm)


def _best(
    problem: Problem[AnyIterate, AnyCorrection],
    at: AnyIterate,
    correction: AnyCorrection,
    cuts: int,
) -> AnyIterate:
    """Return the first trial with a smaller residual, else the best trial (collective)."""
    best = problem.trial(at, correction, 1.0)
    for cut in range(1, cuts + 1):
        if best.norm < at.norm:
            break
        trial = problem.trial(at, correction, 0.5**cut)
        if not best.norm <= trial.norm:  # also if the best norm is NaN
            best = trial
    return best


def forcing(first: float, reduction: float, target: float) -> float:
    """Return the share of the residual allowed after a correction (Eisenstat and Walker 1996).

    Args:
        first: Share for the first correction.
        reduction: Residual divided by the residual of the previous iterate, 1 at the start.
        target: Accepted residual divided by the present residual.
    """
    return max(min(first, reduction**2), limits.FORCING_MARGIN * target)
