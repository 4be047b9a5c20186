# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The algebraic step condensed onto the joints: factor the bulk once, iterate on the joints only.

With A factored, the joint gaps follow from the joint forces, g = g_trial - G F, where G = B A^-1
B^T is the compliance (Delassus) matrix and F = w t. Each step is one response without joints, an
iteration on F alone, and one expansion. F solves

    r(F) = F - w Res(g_trial - G F + diag(G) F) = 0,

Res being the law solved at each point on the point's own compliance: closed and regular however
stiff the joint is. The semi-smooth Newton matrix is I + w T (G - diag G) with T = dRes/dh. All of
it is done in the scaled forces f and gaps of `compliance`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.dealt import Dealt
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.internal_forces import JointInternalForces
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers.effective_matrix import (
    Cache,
    MatrixCoefficients,
    unconstrained_dofs,
)
from dolfinx_joints.solvers.interface.compiled.iteration import Limits
from dolfinx_joints.solvers.interface.compiled.steps import Solved
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.corrections import Correction
from dolfinx_joints.solvers.interface.residual import (
    STATIC_TOLERANCE,
    AcceptedForces,
    Colours,
    Iterate,
    JointStep,
    tractions_of,
)
from dolfinx_joints.solvers.line_search import LineSearch
from dolfinx_joints.solvers.newton import SETTLED
from dolfinx_joints.solvers.step_solver import SolveReport, SolverOptions, solve_failure

Floats = NDArray[np.float64]

# What dense compliances, one per step length, may take together.
KEPT_BYTES = 2_000_000_000

# The linear systems inside are solved to this part of their right-hand sides at first; later as
# well as the iteration converges (Eisenstat and Walker 1996). The iteration goes on to `ENOUGH` of
# the tolerance if rounding lets it: the energy balance sees what is left.
INNER_TOLERANCE, ENOUGH = 0.03, 0.01

# After a step of so many iterations, and as long as steps take so many, iterates whose residual is
# larger than this part of the largest force are swept point by point, in so many colours. A sweep
# takes the time of two iterations and saves one: it is for steps too long for the last to tell of
# the next. With fewer colours it does less (measured in docs/decisions).
HARD, EASY = 7, 4
POOR, COLOURS = 0.03, 32

# Times that a static solution is corrected by the gaps of the body itself.
REFINEMENTS = 3


class InterfaceSolver:
    """Semi-smooth Newton on the joint forces.

    Gives what `NewtonSolver` gives. The compliance costs one back-substitution per joint unknown
    for each set of coefficients; after that a step costs two of them, however many iterations the
    joints need. Where blocks are supported by nothing but joints, statics put springs across the
    joints; what they carry is taken off the law's tractions again, so that the solution does not
    depend on them.

    Args:
        system: The system, with joints whose laws all offer ``condensed_backward_euler``.
        options: Tolerances and limits.

    Attributes:
        carried: Tractions of the accepted state that static solves start from, shape (n, 3), [Pa].
            Those of its gaps unless given; rigid joints, whose tractions do not follow from gaps,
            start without.
        follows_path: Whether static solves start from the elastic predictor alone. Else they
            start from the forces of the last solve, or from open joints, and may find another
            branch of equilibria.
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
        self.follows_path = True
        self.carried: Floats | None = None
        self._accepted = AcceptedForces()
        self._last: tuple[Condensed | None, Floats, Floats] = (None, nothing, nothing)
        self._before: tuple[Condensed | None, Floats, Floats] = self._last
        operator, newton = self._operator, self.options  # a reference to self would keep it alive
        self._sweeps, self._enough = False, ENOUGH * newton.relative_tolerance
        self._condensed = Cache(
            lambda key: Condensed(system, key[0], operator, key[1], newton),
            size=int(min(8, max(2, KEPT_BYTES // (8 * size**2 or 1)))),
        )

    def solve(
        self,
        effective: MatrixCoefficients,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = BACKWARD_EULER,
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place; see `NewtonSolver.solve` (collective)."""
        assert state is not None
        condensed: Condensed = self._condensed((effective, 1.0 / rule.weight))
        factored, condensed.used = not condensed.used, True
        condensed.matrix.solve_linear(b, x, self._unconstrained)
        if condensed.static:
            condensed.matrix.refine(b, x, self._unconstrained)
        trial_gap = state.gap + self._contact.operator.jump(x)
        step = JointStep(self._contact, condensed, trial_gap, state, rule)
        if condensed.static and self.follows_path:
            traction = tractions_of(self._contact, state, self.carried)
            found = self._in_python(step, [self._accepted.start(step, traction)], b, x)
            self._accepted.solved(found.response.traction, *self._last[1:])
        else:
            found = self._from_last_steps(step, b, x)
        self._sweeps = found.iterations >= (EASY if self._sweeps else HARD)
        condensed.close(found)
        return found.response, SolveReport(
            iterations=found.iterations,
            factorizations=int(factored),
            residual=found.relative,
            counts=self._contact.counts(found.response.status),
            solver=self.name,
        )

    def _from_last_steps(self, step: JointStep, b: PETSc.Vec, x: PETSc.Vec) -> Solved:
        """Solve from the forces of the last steps, compiled if possible (collective)."""
        condensed, starts = step.condensed, self._starts(step.condensed)
        if condensed.static:
            starts.append((np.zeros_like(starts[0][0]), np.zeros_like(starts[0][1])))
        found = self._compiled(condensed, step.trial_gap, step.state, step.rule, starts)
        if found is None:
            return self._in_python(step, starts, b, x)
        self._expand_all(condensed, found.force, x)
        return found

    def _compiled(
        self,
        condensed: Condensed,
        trial_gap: Floats,
        state: JointState,
        rule: Rule,
        starts: list[tuple[Floats, Floats]],
    ) -> Solved | None:
        """The joint forces by the compiled iteration.

        None where it does not serve, and where it does not converge: in Python it says why.
        """
        if condensed.compiled is None:
            return None
        sweeps = self._sweeps and condensed.compliance.kind == "dense"
        limits = Limits(
            tolerance=self.options.relative_tolerance,
            enough=self._enough,
            iterations=self.options.max_iterations,
            cuts=self.options.max_cuts,
            inner=INNER_TOLERANCE,
            rough=0.0,
            poor=POOR if sweeps else np.inf,
            colours=COLOURS,
        )
        return condensed.compiled.solve(trial_gap, state, rule, starts, limits)

    def _in_python(
        self, step: JointStep, starts: list[tuple[Floats, Floats]], b: PETSc.Vec, x: PETSc.Vec
    ) -> Solved:
        """The joint forces, and x with what they cause (collective)."""
        condensed = step.condensed
        tried = [step.evaluate(*start) for start in starts]
        start = min(tried, key=lambda at: at.norm)
        found, iterations, relative = self._iterate(step, self._smoothed(step, start))
        self._expand_all(condensed, found.force - found.residual, x)
        for _ in range(REFINEMENTS * condensed.static):
            # From the gaps of the body as it stands: stiff joints turn their rounding to forces.
            if condensed.springs is not None:
                self._balance(condensed, b, x)
            at = step.evaluate(*self._last[1:])
            if condensed.springs is not None and step.is_balanced(at):
                found, relative = at, at.worst / (at.largest or 1.0)
                break
            found, more, relative = self._iterate(step, at)
            if more == 0:
                break
            iterations += more
            moved = found.force - found.residual - self._last[1]
            self._expand(condensed, found.force - found.residual, x)
        else:
            if condensed.springs is not None and not self._settled(moved):
                joints = JointInternalForces(self._contact)
                state, options = step.state, self.options
                raise solve_failure(joints, found.response, state, iterations, relative, options)
        return Solved(
            force=found.force - found.residual,
            response=found.response,
            iterations=iterations,
            relative=relative,
        )

    def _settled(self, moved: Floats) -> bool:
        """Whether forces changed little: those of a block that nothing holds go on (collective)."""
        sizes = [np.abs(each).max(initial=0.0) for each in (moved, self._last[1])]
        most, largest = of_ranks(self._contact.operator.comm, np.array(sizes)).max(axis=0)
        return bool(most <= SETTLED * largest)

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
        return {"matrices": matrices, "sweeps": self._sweeps, **known}

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
        self._sweeps = state_dict["sweeps"]

    def _starts(self, condensed: Condensed) -> list[tuple[Floats, Floats]]:
        """Forces of the last step, and on the line through the last two, each with S f."""
        known, force, coupled = self._last
        if known is not condensed:
            if known is not None:
                force = force / known.compliance.scale * condensed.compliance.scale
            coupled = condensed.compliance.split.product(force, np.flatnonzero(force))
            return [(force, coupled)]
        before, self._before = self._before, self._last
        if before[0] is not known:
            return [(force, coupled)]
        return [(force, coupled), (2.0 * force - before[1], 2.0 * coupled - before[2])]

    def _smoothed(self, step: JointStep, at: Iterate) -> Iterate:
        """A sweep over the points, where the last steps were hard (collective)."""
        helps = self._sweeps and not step.condensed.static
        poor = at.worst > POOR * at.largest
        if not (helps and poor and step.condensed.compliance.kind == "dense"):
            return at
        swept = step.sweep(at, self._colours)
        return min(at, swept, key=lambda tried: tried.norm)

    @cached_property
    def _colours(self) -> Colours:
        """Points of equal numbers modulo `COLOURS` (collective when first asked for)."""
        first, stop = (row // 3 for row in self._operator.getOwnershipRange())
        colour = np.repeat(np.arange(first, stop) % COLOURS, 3)
        rows = [np.flatnonzero(colour == c) for c in range(COLOURS)]
        return list(zip(self._contact.colours(COLOURS), rows, strict=True))

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

    def _iterate(self, step: JointStep, at: Iterate) -> tuple[Iterate, int, float]:
        """The solution, iterations, and residual relative to the largest force."""
        iteration, last, tolerance = 0, np.inf, self.options.relative_tolerance
        enough = step.enough if step.condensed.static else self._enough
        before, line_search = at, LineSearch(self.options.max_cuts)
        first = inner = STATIC_TOLERANCE if step.condensed.static else INNER_TOLERANCE
        while True:
            size = at.worst
            scale = at.largest or size or 1.0
            relative, accepted = step.judged(at, size / scale, scale, tolerance)
            if relative <= enough or (relative <= accepted and size >= 0.5 * last):
                return at, iteration, relative
            given_up = iteration == self.options.max_iterations or not 0.0 < size < np.inf
            if given_up and relative <= accepted:
                return at, iteration, relative
            if given_up:
                # A tangent that is not finite shows in the iterate after the one that has it.
                tried = (at.response, before.response)
                spoilt = next((r for r in tried if self._contact.not_finite(r)), at.response)
                joints = JointInternalForces(self._contact)
                raise solve_failure(joints, spoilt, step.state, iteration, relative, self.options)
            if iteration:
                inner = min(first, (size / last) ** 2)
            # What is done already costs no product.
            left = np.where(np.abs(at.residual) > 0.1 * enough * scale, at.residual, 0.0)
            correction = step.condensed.corrections.solve(
                left, at.tangent, max(inner, 0.3 * enough / relative)
            )
            before, at = at, self._smoothed(step, self._search(step, at, correction, line_search))
            iteration, last = iteration + 1, size

    def _search(
        self, step: JointStep, at: Iterate, correction: Correction, line_search: LineSearch
    ) -> Iterate:
        """Take the correction, halved while it does not make the residual smaller."""
        smallest = np.inf
        for cut in range(line_search.cuts(at.norm) + 1):
            share = 0.5**cut
            trial = step.evaluate(
                at.force - share * correction.step, at.coupled - share * correction.coupled
            )
            if trial.norm < smallest or cut == 0:
                smallest, best = trial.norm, trial
            if trial.norm < at.norm:
                break
        return best
