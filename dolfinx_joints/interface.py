# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The algebraic step condensed onto the joints: factor the bulk once, iterate on the joints only.

With A factored, the joint gaps follow from the joint forces, g = g_free - G F, where
G = B A^-1 B^T is the compliance (Delassus) matrix and F = w t. Each step is one free response, an
iteration on F alone, and one expansion. F solves

    r(F) = F - w Res(g_free - G F + diag(G) F) = 0,

Res being the law solved at each point on the point's own compliance: closed and regular however
stiff the joint is. The semi-smooth Newton matrix is I + w T (G - diag G) with T = dRes/dh. All of
it is done in the scaled forces f and gaps of `compliance`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from numba import njit
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.compliance import Compliance
from dolfinx_joints.contact import Contact, Rule
from dolfinx_joints.corrections import Correction, Corrections
from dolfinx_joints.errors import JointsError
from dolfinx_joints.joint_springs import JointSprings
from dolfinx_joints.laws import JointState, Response
from dolfinx_joints.linear import Cache, Effective, EffectiveMatrix, free_dofs
from dolfinx_joints.solver import (
    NewtonOptions,
    NewtonSolver,
    SolveReport,
    StepSolver,
    joint_failure,
)
from dolfinx_joints.system import MatrixSystem

Floats = NDArray[np.float64]

# What several of them, one per step length, may take together.
KEPT_BYTES = 2_000_000_000

# The linear systems inside are solved to this part of their right-hand sides at first; later as
# well as the iteration converges (Eisenstat and Walker 1996).
INNER_TOLERANCE = 0.03

# Times that a static solution is corrected by the gaps of the body itself.
REFINEMENTS = 3

KINDS = ("auto", "condensed", "monolithic")


def check_kind(kind: str) -> None:
    """Refuse a kind of solver that does not exist.

    Raises:
        ValueError: It is not one of `KINDS`.
    """
    if kind not in KINDS:
        raise ValueError(f"solver is {kind!r}; it must be one of {', '.join(KINDS)}.")


def make_solver(
    system: MatrixSystem,
    options: NewtonOptions | None = None,
    kind: str = "auto",
    rule: Rule = "end_point",
    *,
    static_steps: int = 0,
) -> StepSolver:
    """A solver of the steps of a system (collective).

    Args:
        system: The system.
        options: Tolerances and limits.
        kind: ``condensed``, ``monolithic``, or ``auto``: condensed where all laws offer a local
            solution, monolithic elsewhere, and in statics where blocks are held by nothing but
            joints of finite stiffness: near the limit of what they carry it goes further.
        rule: What the time scheme will ask the laws for.
        static_steps: Number of solves with K alone that are to come; 0 in dynamics.

    Raises:
        ValueError: The kind is unknown.
        JointsError: ``condensed`` was asked for and a law cannot be solved locally.
    """
    check_kind(kind)
    contact = system.contact
    if kind == "monolithic" or contact is None:
        return NewtonSolver(system, options)
    missing = contact.without_local(rule)
    if kind == "condensed" and missing:
        raise JointsError(
            f"The condensed solver needs laws with a local solution; {missing[0]} has none."
        )
    if kind == "condensed" or not missing:
        loose = static_steps and kind == "auto" and not contact.rigid and _is_loose(system, options)
        if not loose:
            return InterfaceSolver(system, _for_steps(options, contact, static_steps))
    return NewtonSolver(system, options)


def _for_steps(options: NewtonOptions | None, contact: Contact, static_steps: int) -> NewtonOptions:
    """Options with no compliance kept where few solves do not pay for it.

    A static solve takes some 150 products, and a column of the compliance in a block of them a
    seventh of a back-substitution.
    """
    options = options or NewtonOptions()
    few = 0 < 7 * 150 * static_steps < 3 * contact.operator.num_points
    return replace(options, compliance="free") if few and options.compliance == "auto" else options


class _Condensed:
    """The bulk factored for one set of coefficients, with its compliance at the joints.

    Attributes:
        matrix: The bulk, in statics with springs across the joints.
        springs: These springs, None in dynamics.
        compliance: G, scaled.
        corrections: Solver of Newton's corrections.
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: Effective,
        operator: PETSc.Mat,
        weight: float,
        options: NewtonOptions,
    ) -> None:
        """Factor, and find the compliance; ``weight`` is that of 1/k in the law (collective)."""
        assert system.contact is not None
        linear = options.linear
        self.springs: JointSprings | None = None
        self.matrix = EffectiveMatrix(system, effective, linear=linear)
        if not effective.mass and not _is_held(self.matrix, free_dofs(system)):
            self.matrix.destroy()
            self.springs = JointSprings(system)
            self.matrix = EffectiveMatrix(
                system, effective, linear=linear, added=self.springs.matrix
            )
        largest = None if self.springs is None else self.springs.largest_compliance
        self.compliance = Compliance(
            self.matrix,
            operator,
            system.contact.operator,
            kind=options.compliance,
            largest=largest,
        )
        stuck = None
        if self.springs is None:
            stuck = self._stuck(system.contact, weight)
        self.corrections = Corrections(
            self.compliance.split, self.compliance.rough, stuck, operator.comm.tompi4py()
        )

    def _stuck(self, contact: Contact, weight: float) -> Floats:
        """T0 of sticking points of all ranks, shape (points, 3): c / (c + weight / k)."""
        own = np.repeat(self.compliance.own, (1, 2), axis=1)
        stiffness = np.repeat(contact.closed_stiffness(), (1, 2), axis=1)
        with np.errstate(divide="ignore"):
            total = own + weight / stiffness
        ratio = np.divide(own, total, out=np.zeros_like(own), where=total > 0.0)
        every = np.concatenate(contact.operator.comm.allgather(ratio))
        return np.where(self.compliance.dead, 0.0, every)

    def destroy(self) -> None:
        """Free matrices and factor."""
        self.compliance.destroy()


def _is_loose(system: MatrixSystem, options: NewtonOptions | None) -> bool:
    """Whether K is singular: there are blocks that nothing but joints holds (collective)."""
    linear = (options or NewtonOptions()).linear
    effective = Effective(mass=0.0, damping=0.0, stiffness=1.0)
    matrix = EffectiveMatrix(system, effective, linear=linear)
    held = _is_held(matrix, free_dofs(system))
    matrix.destroy()
    return not held


def _is_held(matrix: EffectiveMatrix, free: PETSc.Vec) -> bool:
    """Whether a matrix of statics is regular: no block that nothing but joints supports."""
    load, moved = free.duplicate(), free.duplicate()
    load.setRandom()
    load.pointwiseMult(load, free)
    try:
        matrix.solver.solve(load, moved)
    except JointsError:
        return False
    rest = load.duplicate()
    matrix.held.mult(moved, rest)
    rest.axpy(-1.0, load)
    return bool(rest.norm() <= 1e-6 * load.norm())


@dataclass(frozen=True, kw_only=True)
class _Iterate:
    """Scaled forces with what follows from them.

    Attributes:
        force: f, shape (m,), the same on every rank.
        coupled: S f.
        residual: r.
        tangent: T, shape (points, 3, 3).
        largest: Largest scaled force that the law gives.
        response: Of the rank's points.
    """

    force: Floats
    coupled: Floats
    residual: Floats
    tangent: Floats
    largest: float
    response: Response


class InterfaceSolver:
    """Semi-smooth Newton on the joint forces.

    Gives what `NewtonSolver` gives. The compliance costs one back-substitution per joint unknown
    for each set of coefficients; after that a step costs two of them, however many iterations the
    joints need. Where blocks are held by nothing but joints, statics put springs across the joints;
    what they carry is taken off the law's tractions again, so that the solution does not depend on
    them.

    Args:
        system: What is to be solved; all its laws offer ``local_solve``.
        options: Tolerances and limits.
    """

    def __init__(self, system: MatrixSystem, options: NewtonOptions | None = None) -> None:
        """Constrain B (collective)."""
        self.system = system
        self.name = "condensed"
        self.options = options or NewtonOptions()
        if system.contact is None:
            raise ValueError("A system without joints has nothing to condense onto.")
        self._contact: Contact = system.contact
        comm = self._contact.operator.comm
        self._free = free_dofs(system)
        self._operator = self._contact.operator.constrained(self._free)
        self._areas = np.repeat(np.concatenate(comm.allgather(self._contact.operator.areas)), 3)
        start, stop = self._operator.getOwnershipRange()
        self._mine = slice(start, stop)
        size = self._operator.getSize()[0]
        self._points = self._operator.createVecLeft()
        self._nodal, self._moved = (self._operator.createVecRight() for _ in range(2))
        nothing = np.zeros(size)
        self._last: tuple[_Condensed | None, Floats, Floats] = (None, nothing, nothing)
        self._before: tuple[_Condensed | None, Floats, Floats] = self._last
        self._condensed = Cache(
            lambda key: _Condensed(self.system, key[0], self._operator, key[1], self.options),
            size=int(min(8, max(2, KEPT_BYTES // (8 * size**2 or 1)))),
        )

    def solve(
        self,
        effective: Effective,
        b: PETSc.Vec,
        x: PETSc.Vec,
        state: JointState | None,
        rule: Rule = "end_point",
    ) -> tuple[Response | None, SolveReport]:
        """Solve for ``x`` in place; see `NewtonSolver.solve` (collective)."""
        if state is None:
            raise ValueError("The state of the joints is missing.")
        condensed: _Condensed = self._condensed((effective, 2.0 if rule == "step" else 1.0))
        factored = condensed.matrix.solve_linear(b, x, self._free)
        if condensed.springs is not None:
            self._refine(condensed.matrix, b, x)
        free_gap = state.gap + self._contact.operator.gap(x)
        step = _Step(self._contact, condensed, self._areas, self._mine, free_gap, state, rule)
        found, iterations, relative = self._iterate(step, *self._start(condensed))
        nothing = np.zeros_like(found.force)
        self._last = (condensed, nothing, nothing)
        for _ in range(1 if condensed.springs is None else 1 + REFINEMENTS):
            if not relative <= self.options.relative_tolerance:
                raise joint_failure(
                    self._contact, found.response, state, iterations, relative, self.options
                )
            self._expand(condensed, found.force - found.residual, x)
            if condensed.springs is None:
                break
            # From the gaps of the body as it now stands: springs turn their rounding into forces.
            found, more, relative = self._iterate(step, *self._last[1:])
            if more == 0:
                break
            iterations += more
        return found.response, SolveReport(
            iterations=iterations,
            factorizations=int(factored),
            residual=relative,
            counts=self._contact.counts(found.response.status),
        )

    def _start(self, condensed: _Condensed) -> tuple[Floats, Floats]:
        """Forces f to start from, and S f: on the line through those of the last two steps."""
        known, force, coupled = self._last
        if known is condensed:
            before, self._before = self._before, (condensed, force, coupled)
            if before[0] is condensed:
                return 2.0 * force - before[1], 2.0 * coupled - before[2]
            return force, coupled
        if known is not None:
            force = force / known.compliance.scale * condensed.compliance.scale
        return force, condensed.compliance.split.product(force, np.flatnonzero(force))

    def _expand(self, condensed: _Condensed, force: Floats, x: PETSc.Vec) -> None:
        """Add the displacements that a change of the joint forces causes, -A^-1 B^T F.

        The gaps they cause give S f without the rounding of the iteration's sums.
        """
        _, known, coupled = self._last
        scale, change = condensed.compliance.scale, force - known
        self._points.setArray((change / scale)[self._mine])
        self._operator.multTranspose(self._points, self._nodal)
        condensed.matrix.solver.solve(self._nodal, self._moved)
        if condensed.springs is not None:
            self._refine(condensed.matrix, self._nodal, self._moved)
        self._moved.pointwiseMult(self._moved, self._free)
        x.axpy(-1.0, self._moved)
        self._operator.mult(self._moved, self._points)
        comm = self._contact.operator.comm
        gaps = self._points.getArray(readonly=True)
        every = gaps.copy() if comm.size == 1 else np.concatenate(comm.allgather(gaps))
        caused = np.where(condensed.compliance.dead.ravel(), 0.0, every / scale - change)
        self._last = (condensed, force, coupled + caused)

    def _refine(self, matrix: EffectiveMatrix, right: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve A x = b again for what rounding left: loose blocks on soft springs move far."""
        rest, change = right.duplicate(), x.duplicate()
        matrix.full.mult(x, rest)
        rest.aypx(-1.0, right)
        rest.pointwiseMult(rest, self._free)
        matrix.solver.solve(rest, change)
        change.pointwiseMult(change, self._free)
        x.axpy(1.0, change)

    def _iterate(self, step: _Step, force: Floats, coupled: Floats) -> tuple[_Iterate, int, float]:
        """The solution, iterations, and residual relative to the largest force."""
        at = step.evaluate(force, coupled)
        iteration, last, tolerance = 0, np.inf, self.options.relative_tolerance
        # What springs carry may be far more than what joints do.
        enough = 0.01 * tolerance if step.condensed.springs is None else 0.0
        inner = INNER_TOLERANCE
        while True:
            size = float(np.abs(at.residual).max(initial=0.0))
            scale = at.largest or size or 1.0
            relative = size / scale
            if step.condensed.springs is not None:
                # What springs carry on a mechanism drowns the joints' forces.
                relative = max(relative, 1e-14 * float(np.abs(at.force).max(initial=0.0)) / scale)
            # Beyond the tolerance as far as rounding lets it: the energy balance sees what is left.
            done = relative <= enough or (relative <= tolerance and size >= 0.5 * last)
            if done or iteration == self.options.max_iterations or not np.isfinite(size):
                return at, iteration, relative
            if iteration:
                inner = min(INNER_TOLERANCE, (size / last) ** 2)
            last = size
            # What is done already costs no product.
            left = np.where(np.abs(at.residual) > 0.1 * enough * scale, at.residual, 0.0)
            correction = step.condensed.corrections.solve(
                left, at.tangent, max(inner, 0.3 * max(enough, 1e-15) / relative)
            )
            at = self._search(step, at, correction)
            iteration += 1

    def _search(self, step: _Step, at: _Iterate, correction: Correction) -> _Iterate:
        """Take the correction, halved while it does not make the residual smaller."""
        norm, smallest = float(np.linalg.norm(at.residual)), np.inf
        for cut in range(self.options.max_cuts + 1):
            share = 0.5**cut
            trial = step.evaluate(
                at.force - share * correction.step, at.coupled - share * correction.coupled
            )
            size = float(np.linalg.norm(trial.residual))
            if size < smallest or cut == 0:
                smallest, best = size, trial
            if size < norm:
                break
        return best


class _Step:
    """The residual r(f) of one step."""

    def __init__(
        self,
        contact: Contact,
        condensed: _Condensed,
        areas: Floats,
        mine: slice,
        free_gap: Floats,
        state: JointState,
        rule: Rule,
    ) -> None:
        self.condensed, self._contact, self._mine = condensed, contact, mine
        self._compliance, self._areas = condensed.compliance, areas
        self._free_gap, self._state, self._rule = free_gap, state, rule

    def evaluate(self, force: Floats, coupled: Floats) -> _Iterate:
        """Residual and tangent of all points, response of the rank's (collective)."""
        scale, comm = self._compliance.scale, self._contact.operator.comm
        gap = self._free_gap - (scale * coupled)[self._mine].reshape(-1, 3)
        own, springs = self._compliance.own, self.condensed.springs
        if springs is None:
            response = self._contact.respond_locally(gap, own, self._state, self._rule)
            traction, tangent = response.traction, response.tangent
        else:
            response = self._contact.respond_locally(
                *springs.without(gap, own, self._state.gap), self._state, self._rule
            )
            traction, tangent = springs.taken_off(response, own, self._state.gap)
        forces = self._areas[self._mine] * scale[self._mine] * response.traction.ravel()
        largest = float(np.abs(forces).max(initial=0.0))
        if comm.size > 1:
            largest = comm.allreduce(largest, MPI.MAX)
            traction = np.concatenate(comm.allgather(traction))
            tangent = np.concatenate(comm.allgather(tangent))
        residual, scaled = _scaled(
            force, traction, tangent, scale, self._areas, self._compliance.dead
        )
        return _Iterate(
            force=force,
            coupled=coupled,
            residual=residual,
            tangent=scaled,
            largest=largest,
            response=response,
        )


@njit(cache=True)
def _scaled(
    force: Floats,
    traction: Floats,
    tangent: Floats,
    scale: Floats,
    areas: Floats,
    dead: NDArray[np.bool_],
) -> tuple[Floats, Floats]:
    """Scaled residual f - s w t and tangent s w T s, which is zero where a point cannot move."""
    residual, scaled = force.copy(), np.zeros_like(tangent)
    for i in range(len(tangent)):
        for a in range(3):
            k = 3 * i + a
            root = scale[k] * areas[k]
            residual[k] -= root * traction[i, a]
            for b in range(3):
                if not (dead[i, a] or dead[i, b]):
                    scaled[i, a, b] = root * tangent[i, a, b] * scale[3 * i + b]
    return residual, scaled
