# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solver of a step condensed onto the joints: factor the bulk once, iterate only on the joints.

A is the matrix of a step, B the gap operator. Tractions t on the areas w are forces F = w t, and
the gaps are g = g_free - G F (20) of docs/theory. The compliance (Delassus) matrix is G = B A^-1
B^T, and g_free are the gaps without joint forces. A step consists of one response without joint
forces, an iteration on F, and one solve for the displacements due to F. F solves

    r(F) = F - w Res(g_free - G F + diag(G) F) = 0.

Res is the law solved at each point on the point's own compliance (21). It has a closed form and is
bounded at any joint stiffness. The semi-smooth Newton matrix is I + w dRes/dh (G - diag G). The
iteration works on scaled forces f and the scaled compliance I + S (22) to (24), see `compliance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Dealt, Floats
from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import Rule
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.effective_matrix import Cache, MatrixCoefficients, unconstrained_dofs
from dolfinx_joints.solvers.interface.condensed import Condensed, Solved
from dolfinx_joints.solvers.interface.corrections import Correction
from dolfinx_joints.solvers.interface.joint_step import (
    AcceptedForces,
    Iterate,
    JointStep,
    tractions_of,
)
from dolfinx_joints.solvers.newton_loop import forcing, newton
from dolfinx_joints.solvers.step_solver import (
    Solution,
    SolveReport,
    SolverOptions,
    StepEquation,
    StepSolver,
)


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


class InterfaceSolver(StepSolver):
    """Solver that iterates only on the joint forces, by a semi-smooth Newton method.

    The result equals the `NewtonSolver` result. The compliance matrix is computed once per set of
    coefficients and costs one back-substitution per joint unknown. Each step then costs two
    back-substitutions, regardless of the number of Newton iterations.

    In statics, artificial springs across the joints stabilise blocks that only joints support. The
    spring forces are subtracted from the joint tractions, so that the solution does not depend on
    the springs.

    Args:
        system: The system, with joints.
        options: Tolerances and limits.

    Attributes:
        carried: Tractions of the accepted state from which static solves start, shape (n, 3), [Pa].
            If None, the laws give the tractions at the gaps of the state. With rigid joints, whose
            tractions do not depend on gaps, they are then zero.
    """

    def __init__(self, system: MatrixSystem, options: SolverOptions | None = None) -> None:
        """Constrain B, and prepare the cache of condensed systems (collective)."""
        self.system = system
        self.name = "condensed"
        self.options = options or SolverOptions()
        assert system.contact is not None
        self._contact: Contact = system.contact
        self._unconstrained = unconstrained_dofs(system)
        self._operator = self._contact.operator.constrained(self._unconstrained)
        size, local = self._operator.getSize()[0], self._operator.getLocalSize()[0]
        self._points = self._operator.createVecLeft()
        self._nodal, self._moved = (self._operator.createVecRight() for _ in range(2))
        zero = np.zeros(local)
        self.carried: Floats | None = None
        self._accepted, self._largest_force = AcceptedForces(), 0.0
        self._last: tuple[Condensed | None, Floats, Floats] = (None, zero, zero)
        self._before: tuple[Condensed | None, Floats, Floats] = self._last
        operator, chosen = self._operator, self.options  # capturing self would create a cycle
        fitting = limits.KEPT_BYTES // (8 * size**2 or 1)
        self._condensed = Cache(
            lambda key: Condensed(system, key[0], operator, key[1], chosen),
            size=int(min(limits.MOST_KEPT, max(limits.FEWEST_KEPT, fitting))),
        )

    def condensed(self, effective: MatrixCoefficients, rule: Rule) -> Condensed:
        """Return the condensed system of a set of coefficients, made on first use (collective)."""
        return self._condensed((effective, 1.0 / rule.weight))

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective)."""
        effective, b, x, state, rule = equation
        assert state is not None
        condensed = self.condensed(effective, rule)
        factored, condensed.used = not condensed.used, True
        condensed.solver.solve_linear(b, x, self._unconstrained)
        if condensed.static:
            condensed.solver.refine(b, x, self._unconstrained)
        free_gap = state.gap + self._contact.operator.jump(x)
        # Controlled joints may break completely: a residual relative to their forces stays large.
        least_force = 0.0 if self.system.control is None else self._largest_force
        step = JointStep(self._contact, condensed, free_gap, state, rule, least_force)
        if condensed.static:
            solved = self._static(step, b, x)
        else:
            solved = self._iterate(step, self._starts(condensed))
            self._set_forces(condensed, solved.force, x)
        condensed.close_unresolved_openings(solved)
        return solved.response, SolveReport(
            iterations=solved.iterations,
            factorizations=int(factored),
            residual=solved.relative,
            counts=self._contact.counts(solved.response.status),
            solver=self.name,
        )

    def _static(self, step: JointStep, b: PETSc.Vec, x: PETSc.Vec) -> Solved:
        """Return the joint forces of a static step; add their displacements to x (collective)."""
        condensed = step.condensed
        if self.follows_path:
            traction = tractions_of(self._contact, step.state, self.carried)
            starts = [self._accepted.start(step, traction)]
        else:
            zero = np.zeros(condensed.compliance.split.local)
            starts = [*self._starts(condensed), (zero, zero)]
        solved = self._iterate(step, starts)
        self._set_forces(condensed, solved.force, x)
        for _ in range(limits.REFINEMENTS):
            # Repeat from the gaps of the body: stiff joints turn rounding errors into forces.
            if condensed.springs is not None:
                self._refine_displacement(condensed, b, x)
            start = self._last[1:]
            if condensed.springs is not None and step.is_balanced(at := step.evaluate(*start)):
                response, relative = step.response(at), at.max_residual / (at.max_force or 1.0)
                solved = replace(solved, response=response, relative=relative)
                break
            refined = self._iterate(step, [start])
            solved = replace(refined, iterations=solved.iterations + refined.iterations)
            if refined.iterations == 0:
                break
            force_change = solved.force - self._last[1]
            self._change_forces(condensed, solved.force, x)
        else:
            if condensed.springs is not None and not self._is_settled(force_change):
                raise self.failure(solved.response, step.state, solved.iterations, solved.relative)
        if self.follows_path:
            self._accepted.solved(solved.response.traction, *self._last[1:])
        return solved

    def _iterate(self, step: JointStep, starts: Sequence[tuple[Floats, Floats]]) -> Solved:
        """Return the joint forces of a step, iterated from the best start (collective).

        Raises:
            ConvergenceError: No solution was found.
        """
        problem = JointForces(self, step, starts)
        at, norms = newton(problem, self.options)
        self._largest_force = max(self._largest_force, at.max_force)
        return Solved(
            force=at.force - at.residual,
            response=step.response(at),
            iterations=len(norms) - 1,
            relative=problem.relative(at),
        )

    def _is_settled(self, force_change: Floats) -> bool:
        """Return True if the forces hardly changed; on a mechanism they change (collective)."""
        sizes = [np.abs(force).max(initial=0.0) for force in (force_change, self._last[1])]
        largest_change, largest = of_ranks(self._contact.operator.comm, np.array(sizes)).max(axis=0)
        return bool(largest_change <= limits.SETTLED * largest)

    def state_dict(self) -> dict[str, Any]:
        """Return the matrices, and the last two joint forces as starts (collective)."""
        comm, kept = self._contact.operator.comm, self._condensed.items()
        matrices = {
            str(i): {**asdict(key[0]), "weight": key[1], "corrections": condensed.state_dict()}
            for i, (key, condensed) in enumerate(kept)
        }
        objects = [condensed for _, condensed in kept]
        starts = ("last", self._last), ("before", self._before)
        forces = {
            name: {
                "matrix": objects.index(condensed) if condensed in objects else None,
                "force": Dealt(comm, force.reshape(-1, 3)),
                "coupled": Dealt(comm, coupled.reshape(-1, 3)),
            }
            for name, (condensed, force, coupled) in starts
        }
        return {"matrices": matrices, **forces}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the ``state_dict`` of another solver of the same system (collective)."""
        kept = []
        for i in range(len(state_dict["matrices"])):
            entry = state_dict["matrices"][str(i)]
            effective = MatrixCoefficients(
                mass=entry["mass"],
                damping=entry["damping"],
                stiffness=entry["stiffness"],
                exact_modes=entry.get("exact_modes", 0),
            )
            kept.append(self._condensed((effective, entry["weight"])))
            kept[-1].load_state_dict(entry["corrections"])

        def start(name: str) -> tuple[Condensed | None, Floats, Floats]:
            number = state_dict[name]["matrix"]
            condensed = None if number is None else kept[number]
            force, coupled = (state_dict[name][part].ravel() for part in ("force", "coupled"))
            return condensed, force, coupled

        self._last, self._before = start("last"), start("before")

    def _starts(self, condensed: Condensed) -> list[tuple[Floats, Floats]]:
        """Return pairs (f, S f): the last forces and the line through the last two forces."""
        last_condensed, force, coupled = self._last
        if last_condensed is not condensed:
            if last_condensed is not None:
                force = force / last_condensed.compliance.scale * condensed.compliance.scale
            coupled = condensed.corrections.product(force)
            return [(force, coupled)]
        before, self._before = self._before, self._last
        if before[0] is not last_condensed:
            return [(force, coupled)]
        return [(force, coupled), (2.0 * force - before[1], 2.0 * coupled - before[2])]

    def _set_forces(self, condensed: Condensed, force: Floats, x: PETSc.Vec) -> None:
        """Add the displacements due to the joint forces to x, -A^-1 B^T F (collective)."""
        zero = np.zeros_like(force)
        self._last = (condensed, zero, zero)
        self._change_forces(condensed, force, x)

    def _change_forces(self, condensed: Condensed, force: Floats, x: PETSc.Vec) -> None:
        """Add the displacements due to a change of the joint forces to x (collective).

        The gaps of these displacements give S f without the rounding errors of the iteration.
        """
        _, last_force, coupled = self._last
        scale, change = condensed.compliance.scale, force - last_force
        self._points.setArray(change / scale)
        self._operator.multTranspose(self._points, self._nodal)
        condensed.solver.solve(self._nodal, self._moved)
        if condensed.static:
            condensed.solver.refine(self._nodal, self._moved, self._unconstrained)
        self._moved.pointwiseMult(self._moved, self._unconstrained)
        x.axpy(-1.0, self._moved)
        self._operator.mult(self._moved, self._points)
        gaps = self._points.getArray(readonly=True)
        coupled_change = np.where(condensed.compliance.dead.ravel(), 0.0, gaps / scale - change)
        self._last = (condensed, force, coupled + coupled_change)

    def _refine_displacement(self, condensed: Condensed, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Refine x by a solve for the residual of equilibrium (collective).

        On soft springs, the load moves unsupported blocks far and the joint forces move them back.
        The sum of both displacements has a large rounding error.
        """
        _, force, coupled = self._last
        scale, right_hand_side = condensed.compliance.scale, b.copy()
        self._points.setArray(force / scale)
        self._operator.multTranspose(self._points, self._nodal)
        right_hand_side.axpy(-1.0, self._nodal)
        change = condensed.solver.refine(right_hand_side, x, self._unconstrained)
        self._operator.mult(change, self._points)
        gaps = self._points.getArray(readonly=True) / scale
        gaps = np.where(condensed.compliance.dead.ravel(), 0.0, gaps)
        self._last = (condensed, force, coupled - gaps)
