# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics in pseudo-time: the way to an equilibrium that Newton's method does not find at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dolfinx_joints.common.errors import ConvergenceError, JointsError
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.step_solver import Solution, SolverAround, StepEquation


class PseudoTime(SolverAround):
    """Solves a static step by ever longer steps in pseudo-time.

    Each is a backward Euler step from rest,

        M (x - x0) / dt^2 + K x + B^T w t(g + B x) = b,                                       (28a)

    from the x0 of the last one, until the inertia is next to nothing. Laws are asked from the state
    at the start of the static step: the solution is one of the static equations, whatever the way.
    Near the limit of what joints carry, and where rigid joints open, Newton's method may
    go round in circles between sets of open and sliding points; inertia lets few of them change at
    a time. A mechanism moves on and on, and fails in the end. Not for plastic cells: beside the K x
    of what flows without end, no force is too large to be neglected.

    Args:
        inner: Takes the steps.
    """

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a static step (collective)."""
        b, x, state = equation.b, equation.x, equation.state
        stiffness, mass = self.system.stiffness, self.system.mass
        known, right, force = x.copy(), b.duplicate(), b.duplicate()
        unit = float(stiffness.norm()) / (float(mass.norm()) or np.inf)
        rate, share = limits.PSEUDO_FIRST * unit, limits.PSEUDO_FALL
        tries, iterations, factorizations = 0, 0, 0
        moving: ConvergenceError | None = None
        while True:
            mass.mult(known, right)
            right.aypx(rate, b)
            tries += 1
            try:
                effective = replace(equation.effective, mass=rate)
                response, report = self.inner.solve(effective, right, x, state, equation.rule)
            except ConvergenceError as failure:
                if failure.law is not None or tries == limits.PSEUDO_STEPS or not rate > 0.0:
                    raise
                known.copy(x)
                share **= 0.5
                rate /= share
                continue
            except JointsError as failure:
                # With next to no inertia the matrix of what moves on is singular.
                raise moving or failure from None
            iterations += report.iterations
            factorizations += report.factorizations
            stiffness.mult(x, force)
            forces = max(float(force.norm()), float(b.norm()))
            known.axpy(-1.0, x)
            mass.mult(known, right)
            inertia = rate * float(right.norm()) / (forces or 1.0)
            rounded = known.norm() <= limits.PSEUDO_SETTLED * x.norm()
            rounded = rounded and inertia <= report.residual
            if inertia <= self.options.relative_tolerance or rounded:
                return response, replace(
                    report,
                    iterations=iterations,
                    factorizations=factorizations,
                    residual=max(report.residual, inertia),
                    residuals=(),
                )
            moving = self.failure(response, state, iterations, inertia)
            if rate <= limits.PSEUDO_LAST * unit or tries == limits.PSEUDO_STEPS:
                raise moving
            x.copy(known)
            rate *= share
