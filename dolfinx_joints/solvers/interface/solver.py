# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The algebraic step condensed onto the joints: factor the bulk once, iterate on the joints only.

With A factored, the joint gaps follow from the joint forces, g = g_free - G F, where G = B A^-1
B^T is the compliance (Delassus) matrix and F = w t. Each step is one response without joints, an
iteration on F alone, and one expansion. F solves

    r(F) = F - w Res(g_free - G F + diag(G) F) = 0,

Res being the law solved at each point on the point's own compliance: closed and regular however
stiff the joint is. The semi-smooth Newton matrix is I + w T (G - diag G) with T = dRes/dh. All of
it is done in the scaled forces f and gaps of `compliance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Dealt
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.effective_matrix import (
    Cache,
    MatrixCoefficients,
    unconstrained_dofs,
)
from dolfinx_joints.solvers.interface.condensed import Condensed, Solved
from dolfinx_joints.solvers.interface.joint_forces import JointForces
from dolfinx_joints.solvers.interface.joint_step import JointStep
from dolfinx_joints.solvers.interface.predictor import AcceptedForces, tractions_of
from dolfinx_joints.solvers.newton_loop import newton
from dolfinx_joints.solvers.step_solver import (
    Solution,
    SolveReport,
    SolverOptions,
    StepEquation,
    StepSolver,
)

Floats = NDArray[np.float64]


class InterfaceSolver(StepSolver):
    """Semi-smooth Newton on the joint forces.

    The result equals that of `NewtonSolver`. The compliance matrix is computed once per set of
    coefficients and takes one back-substitution per joint unknown. Each step then takes two
    back-substitutions, regardless of the number of Newton iterations.

    In statics, blocks that are supported by joints alone are stabilised by artificial springs
    across the joints. The spring forces are subtracted from the joint tractions, so that the
    solution does not depend on the springs.

    Args:
        system: The system, with joints.
        options: Tolerances and limits.

    Attributes:
        carried: Tractions of the accepted state that static solves start from, shape (n, 3), [Pa].
            Those of its gaps unless given; rigid joints, whose tractions do not follow from gaps,
            start without.
    """

    def __init__(self, system: MatrixSystem, options: SolverOptions | None = None) -> None:
        """Constrain B (collective)."""
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
        nothing = np.zeros(local)
        self.carried: Floats | None = None
        self._accepted = AcceptedForces()
        self._last: tuple[Condensed | None, Floats, Floats] = (None, nothing, nothing)
        self._before: tuple[Condensed | None, Floats, Floats] = self._last
        operator, chosen = self._operator, self.options  # a reference to self would keep it alive
        fitting = limits.KEPT_BYTES // (8 * size**2 or 1)
        self._condensed = Cache(
            lambda key: Condensed(system, key[0], operator, key[1], chosen),
            size=int(min(limits.MOST_KEPT, max(limits.FEWEST_KEPT, fitting))),
        )

    def _solve(self, equation: StepEquation) -> Solution:
        """Solve the equation of a step (collective)."""
        effective, b, x, state, rule = equation
        assert state is not None
        condensed: Condensed = self._condensed((effective, 1.0 / rule.weight))
        factored, condensed.used = not condensed.used, True
        condensed.matrix.solve_linear(b, x, self._unconstrained)
        if condensed.static:
            condensed.matrix.refine(b, x, self._unconstrained)
        free_gap = state.gap + self._contact.operator.jump(x)
        step = JointStep(self._contact, condensed, free_gap, state, rule)
        if condensed.static:
            found = self._static(step, b, x)
        else:
            found = self._iterate(step, self._starts(condensed))
            self._expand_all(condensed, found.force, x)
        condensed.close(found)
        return found.response, SolveReport(
            iterations=found.iterations,
            factorizations=int(factored),
            residual=found.relative,
            counts=self._contact.counts(found.response.status),
            solver=self.name,
        )

    def _static(self, step: JointStep, b: PETSc.Vec, x: PETSc.Vec) -> Solved:
        """Return the joint forces of a static step, and add what they cause to x (collective)."""
        condensed = step.condensed
        if self.follows_path:
            traction = tractions_of(self._contact, step.state, self.carried)
            starts = [self._accepted.start(step, traction)]
        else:
            nothing = np.zeros(condensed.compliance.split.local)
            starts = [*self._starts(condensed), (nothing, nothing)]
        found = self._iterate(step, starts)
        self._expand_all(condensed, found.force, x)
        for _ in range(limits.REFINEMENTS):
            # Start from the gaps of the body: stiff joints turn their rounding errors to forces.
            if condensed.springs is not None:
                self._balance(condensed, b, x)
            start = self._last[1:]
            if condensed.springs is not None and step.is_balanced(at := step.evaluate(*start)):
                response, relative = step.response(at), at.worst / (at.largest or 1.0)
                found = replace(found, response=response, relative=relative)
                break
            more = self._iterate(step, [start])
            found = replace(more, iterations=found.iterations + more.iterations)
            if more.iterations == 0:
                break
            moved = found.force - self._last[1]
            self._expand(condensed, found.force, x)
        else:
            if condensed.springs is not None and not self._settled(moved):
                raise self.failure(found.response, step.state, found.iterations, found.relative)
        if self.follows_path:
            self._accepted.solved(found.response.traction, *self._last[1:])
        return found

    def _iterate(self, step: JointStep, starts: Sequence[tuple[Floats, Floats]]) -> Solved:
        """Return the joint forces of a step from the best of the starts (collective).

        Raises:
            ConvergenceError: No solution was found.
        """
        problem = JointForces(self, step, starts)
        at, norms = newton(problem, self.options)
        return Solved(
            force=at.force - at.residual,
            response=step.response(at),
            iterations=len(norms) - 1,
            relative=problem.relative(at),
        )

    def _settled(self, moved: Floats) -> bool:
        """Whether forces changed little: those of a block that nothing holds go on (collective)."""
        sizes = [np.abs(each).max(initial=0.0) for each in (moved, self._last[1])]
        most, largest = of_ranks(self._contact.operator.comm, np.array(sizes)).max(axis=0)
        return bool(most <= limits.SETTLED * largest)

    def state_dict(self) -> dict[str, Any]:
        """State that the next steps start from: matrices, forces of the last step and before.

        (Collective.)
        """
        comm, kept = self._contact.operator.comm, self._condensed.items()
        matrices = {
            str(i): {**asdict(key[0]), "weight": key[1], "corrections": condensed.state_dict()}
            for i, (key, condensed) in enumerate(kept)
        }
        objects = [condensed for _, condensed in kept]
        starts = ("last", self._last), ("before", self._before)
        known = {
            name: {
                "matrix": objects.index(condensed) if condensed in objects else None,
                "force": Dealt(comm, force.reshape(-1, 3)),
                "coupled": Dealt(comm, coupled.reshape(-1, 3)),
            }
            for name, (condensed, force, coupled) in starts
        }
        return {"matrices": matrices, **known}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Go on from what another's ``state_dict`` gave (collective)."""
        kept = []
        for i in range(len(state_dict["matrices"])):
            one = state_dict["matrices"][str(i)]
            effective = MatrixCoefficients(
                mass=one["mass"],
                damping=one["damping"],
                stiffness=one["stiffness"],
                exact_modes=one.get("exact_modes", 0),
            )
            kept.append(self._condensed((effective, one["weight"])))
            kept[-1].load_state_dict(one["corrections"])

        def start(name: str) -> tuple[Condensed | None, Floats, Floats]:
            known = state_dict[name]["matrix"]
            found = None if known is None else kept[known]
            force, coupled = (state_dict[name][part].ravel() for part in ("force", "coupled"))
            return found, force, coupled

        self._last, self._before = start("last"), start("before")

    def _starts(self, condensed: Condensed) -> list[tuple[Floats, Floats]]:
        """Forces of the last step, and on the line through the last two, each with S f."""
        known, force, coupled = self._last
        if known is not condensed:
            if known is not None:
                force = force / known.compliance.scale * condensed.compliance.scale
            coupled = condensed.corrections.product(force)
            return [(force, coupled)]
        before, self._before = self._before, self._last
        if before[0] is not known:
            return [(force, coupled)]
        return [(force, coupled), (2.0 * force - before[1], 2.0 * coupled - before[2])]

    def _expand_all(self, condensed: Condensed, force: Floats, x: PETSc.Vec) -> None:
        """Add the displacements that the joint forces cause (collective)."""
        nothing = np.zeros_like(force)
        self._last = (condensed, nothing, nothing)
        self._expand(condensed, force, x)

    def _expand(self, condensed: Condensed, force: Floats, x: PETSc.Vec) -> None:
        """Add the displacements that a change of the joint forces causes, -A^-1 B^T F.

        The gaps they cause give S f without the rounding of the iteration's sums.
        """
        _, known, coupled = self._last
        scale, change = condensed.compliance.scale, force - known
        self._points.setArray(change / scale)
        self._operator.multTranspose(self._points, self._nodal)
        condensed.matrix.solve(self._nodal, self._moved)
        if condensed.static:
            condensed.matrix.refine(self._nodal, self._moved, self._unconstrained)
        self._moved.pointwiseMult(self._moved, self._unconstrained)
        x.axpy(-1.0, self._moved)
        self._operator.mult(self._moved, self._points)
        gaps = self._points.getArray(readonly=True)
        caused = np.where(condensed.compliance.dead.ravel(), 0.0, gaps / scale - change)
        self._last = (condensed, force, coupled + caused)

    def _balance(self, condensed: Condensed, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Correct x for what rounding left of equilibrium (collective).

        Loose blocks on soft springs move far without joint forces, and these bring them back.
        """
        _, force, coupled = self._last
        scale, right = condensed.compliance.scale, b.copy()
        self._points.setArray(force / scale)
        self._operator.multTranspose(self._points, self._nodal)
        right.axpy(-1.0, self._nodal)
        change = condensed.matrix.refine(right, x, self._unconstrained)
        self._operator.mult(change, self._points)
        gaps = self._points.getArray(readonly=True) / scale
        gaps = np.where(condensed.compliance.dead.ravel(), 0.0, gaps)
        self._last = (condensed, force, coupled - gaps)
