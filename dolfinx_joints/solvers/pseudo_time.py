# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pseudo-time steps to static equilibria that Newton's method does not reach in one step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.step_solver import Solution, SolverAround, StepEquation


class PseudoTime(SolverAround):
    """Solver of a static step by increasingly long steps in pseudo-time.

    Each step is a backward Euler step from rest,

        M (x - x0) / dt^2 + K x + B^T w t(g + B x) = b,                                       (28a)

    from the solution x0 of the previous one, until the inertia is negligible. The laws start from
    the state at the start of the static step, so that the result solves the static equations.

    Near the limit load of the joints, and where rigid joints open, Newton's method may cycle
    between sets of open and sliding points. Inertia limits how many points change at a time. On a
    mechanism the inertia never vanishes, and the solve fails. Nonlinear cells are not supported: in
    yielding cells K x grows without bound, and all other forces become negligible.

    Args:
        inner: Solver of the steps.
    """

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a static step (collective)."""
        b, x, state = equation.b, equation.x, equation.state
        stiffness, mass = self.system.stiffness, self.system.mass
        start, right_hand_side, force = x.copy(), b.duplicate(), b.duplicate()
        stiffness_over_mass = float(stiffness.norm()) / (float(mass.norm()) or np.inf)
        rate, share = limits.PSEUDO_FIRST * stiffness_over_mass, limits.PSEUDO_FALL
        tries, iterations, factorizations = 0, 0, 0
        moving: ConvergenceError | None = None
        while True:
            mass.mult(start, right_hand_side)
            right_hand_side.aypx(rate, b)
            tries += 1
            try:
                effective = replace(equation.effective, mass=rate)
                response, report = self.inner.solve(
                    effective, right_hand_side, x, state, equation.rule
                )
            except ConvergenceError as failure:
                if failure.law is not None or tries == limits.PSEUDO_STEPS or not rate > 0.0:
                    raise
                start.copy(x)
                share **= 0.5
                rate /= share
                continue
            except JointsError as failure:
                # With negligible inertia the matrix of a mechanism is singular.
                raise moving or failure from None
            iterations += report.iterations
            factorizations += report.factorizations
            stiffness.mult(x, force)
            forces = max(float(force.norm()), float(b.norm()))
            start.axpy(-1.0, x)
            mass.mult(start, right_hand_side)
            inertia = rate * float(right_hand_side.norm()) / (forces or 1.0)
            within_rounding = start.norm() <= limits.PSEUDO_SETTLED * x.norm()
            within_rounding = within_rounding and inertia <= report.residual
            if inertia <= self.options.relative_tolerance or within_rounding:
                return response, replace(
                    report,
                    iterations=iterations,
                    factorizations=factorizations,
                    residual=max(report.residual, inertia),
                    residuals=(),
                )
            moving = self.failure(response, state, iterations, inertia)
            if rate <= limits.PSEUDO_LAST * stiffness_over_mass or tries == limits.PSEUDO_STEPS:
                raise moving
            x.copy(start)
            rate *= share
