# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The algebraic step condensed onto the joints: factor the bulk once, iterate on the joints only.

With A factored, the joint gaps follow from the joint forces, g = g_free - G F, where
G = B A^-1 B^T is the compliance (Delassus) matrix and F = w t. Each step is one free response, an
iteration on F alone, and one expansion. F solves

    r(F) = F - w Res(g_free - G F + diag(G) F) = 0,

Res being the law solved at each point on the point's own compliance: closed and regular however
stiff the joint is. The semi-smooth Newton matrix is I + w T (G - diag G) with T = dRes/dh.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.contact import Contact, Rule
from dolfinx_joints.errors import JointsError
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

# A dense G of this many unknowns takes 0.8 GB on every rank.
LARGEST_DENSE = 10_000

# What several of them, one per step length, may take together.
KEPT_BYTES = 2_000_000_000

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
) -> StepSolver:
    """A solver of the steps of a system.

    Args:
        system: The system.
        options: Tolerances and limits.
        kind: ``condensed``, ``monolithic``, or ``auto``: condensed where all laws offer a local
            solution and the compliance fits, monolithic elsewhere.
        rule: What the time scheme will ask the laws for.

    Raises:
        ValueError: The kind is unknown.
        JointsError: ``condensed`` was asked for and a law cannot be solved locally.
    """
    check_kind(kind)
    contact = system.contact
    if kind == "monolithic" or contact is None:
        return NewtonSolver(system, options)
    missing = contact.without_local(rule)
    fits = 3 * contact.operator.num_points <= LARGEST_DENSE
    if kind == "condensed" and missing:
        raise JointsError(
            f"The condensed solver needs laws with a local solution; {missing[0]} has none."
        )
    if kind == "condensed" or (fits and not missing):
        return InterfaceSolver(system, options)
    return NewtonSolver(system, options)


class _Compliance:
    """The factored bulk and the dense compliance of the joint points, the same on every rank.

    Attributes:
        effective: The bulk.
        split: G less the points' own compliances on its diagonal, shape (m, m), [m/N], m three
            times the number of joint points.
        own: Compliance of each local point on its own area, normal and tangential (the mean of
            the directions in which it can move), shape (n, 2), [m/Pa].
        dead: Directions in which a point cannot move, such as the third in a plane, (n, 3).
    """

    def __init__(self, effective: EffectiveMatrix, contact: Contact, operator: PETSc.Mat) -> None:
        self.effective = effective
        areas = contact.operator.areas
        size = operator.getSize()[0]
        start, stop = operator.getOwnershipRange()
        unit, gap = operator.createVecLeft(), operator.createVecLeft()
        force, moved = operator.createVecRight(), operator.createVecRight()
        local = np.empty((stop - start, size))
        for column in range(size):
            unit.set(0.0)
            if start <= column < stop:
                unit.getArray()[column - start] = 1.0
            operator.multTranspose(unit, force)
            effective.solver.solve(force, moved)
            operator.mult(moved, gap)
            local[:, column] = gap.getArray(readonly=True)
        self.split = np.vstack(operator.comm.tompi4py().allgather(local))
        self.dead = (self.split.diagonal() == 0.0).reshape(-1, 3)
        each = self.split.diagonal()[start:stop].reshape(-1, 3)
        live = np.maximum(np.count_nonzero(each[:, 1:], axis=1), 1)
        own = np.column_stack([each[:, 0], (each[:, 1] + each[:, 2]) / live])
        self.own = areas[:, None] * own
        spread = np.where(each > 0.0, np.repeat(own, (1, 2), axis=1), 0.0).ravel()
        every = np.concatenate(operator.comm.tompi4py().allgather(spread))
        self.split[np.diag_indices(size)] -= every

    def destroy(self) -> None:
        """Free the bulk's matrices and factor."""
        self.effective.destroy()


class InterfaceSolver:
    """Semi-smooth Newton on the joint forces with a dense compliance.

    Gives what `NewtonSolver` gives. The compliance costs one back-substitution per joint unknown
    for each set of coefficients; after that a step costs two of them, however many iterations the
    joints need.

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
        self._comm = self._contact.operator.comm
        self._free = free_dofs(system)
        self._operator = self._contact.operator.constrained(self._free)
        self._areas = np.concatenate(self._comm.allgather(self._contact.operator.areas))
        start, stop = self._operator.getOwnershipRange()
        self._mine = slice(start, stop)
        self._force = np.zeros(self._operator.getSize()[0])
        self._compliances = Cache(
            lambda key: _Compliance(
                EffectiveMatrix(self.system, key), self._contact, self._operator
            ),
            size=int(min(8, max(2, KEPT_BYTES // (8 * len(self._force) ** 2 or 1)))),
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
        compliance: _Compliance = self._compliances(effective)
        matrix = compliance.effective
        factored = matrix.solve_linear(b, x, self._free)
        free_gap = state.gap + self._contact.operator.gap(x)
        step = _Step(self, compliance, free_gap, state, rule)
        force, response, iterations, residual = self._iterate(step)
        if not residual <= self.options.relative_tolerance:
            raise joint_failure(self._contact, response, state, iterations, residual, self.options)
        self._expand(matrix, force, x)
        self._force = force
        return response, SolveReport(
            iterations=iterations,
            factorizations=int(factored),
            residual=residual,
            counts=self._contact.counts(response.status),
        )

    def _expand(self, matrix: EffectiveMatrix, force: Floats, x: PETSc.Vec) -> None:
        """Add the displacements that the joint forces cause, -A^-1 B^T F."""
        points, nodal, moved = self._operator.createVecLeft(), x.duplicate(), x.duplicate()
        points.setArray(force[self._mine])
        self._operator.multTranspose(points, nodal)
        matrix.solver.solve(nodal, moved)
        x.axpy(-1.0, moved)

    def _iterate(self, step: _Step) -> tuple[Floats, Response, int, float]:
        """Joint forces, response, iterations, and residual relative to the largest force."""
        force = self._force
        residual, tangent, response = step.evaluate(force)
        iteration, last, tolerance = 0, np.inf, self.options.relative_tolerance
        while True:
            size = float(np.abs(residual).max(initial=0.0))
            scale = max(float(np.abs(force).max(initial=0.0)), size) or 1.0
            relative = size / scale
            # Beyond the tolerance as far as rounding lets it: the energy balance sees what is left.
            done = relative <= 0.01 * tolerance or (relative <= tolerance and size >= last)
            if done or iteration == self.options.max_iterations or not np.isfinite(size):
                return force - residual, response, iteration, relative
            last = size
            correction = _correction(step.split, residual, tangent)
            force, residual, tangent, response = self._search(step, force, residual, correction)
            iteration += 1

    def _search(
        self, step: _Step, force: Floats, residual: Floats, correction: Floats
    ) -> tuple[Floats, Floats, Floats, Response]:
        """Take the correction, halved while it does not make the residual smaller."""
        norm, smallest = float(np.linalg.norm(residual)), np.inf
        for cut in range(self.options.max_cuts + 1):
            trial = force - 0.5**cut * correction
            answer = step.evaluate(trial)
            size = float(np.linalg.norm(answer[0]))
            if size < smallest or cut == 0:
                smallest, best = size, (trial, *answer)
            if size < norm:
                break
        return best


class _Step:
    """The residual r(F) of one step.

    Attributes:
        split: Compliance less the points' own, shape (m, m), [m/N].
    """

    def __init__(
        self,
        solver: InterfaceSolver,
        compliance: _Compliance,
        free_gap: Floats,
        state: JointState,
        rule: Rule,
    ) -> None:
        self.split = compliance.split
        self._mine, self._areas = solver._mine, solver._areas
        self._contact, self._own, self._dead = solver._contact, compliance.own, compliance.dead
        self._free_gap, self._state, self._rule = free_gap, state, rule

    def evaluate(self, force: Floats) -> tuple[Floats, Floats, Response]:
        """r(F) and w T of all points, shapes (m,) and (n, 3, 3), and the local response."""
        comm = self._contact.operator.comm
        coupled = (self.split[self._mine] @ force).reshape(-1, 3)
        response = self._contact.respond_locally(
            self._free_gap - coupled, self._own, self._state, self._rule
        )
        traction, tangent = response.traction, response.tangent
        if comm.size > 1:
            traction = np.concatenate(comm.allgather(traction))
            tangent = np.concatenate(comm.allgather(tangent))
        residual = force - (self._areas[:, None] * traction).ravel()
        # Nothing can change there, whatever a rigid joint answers.
        tangent = np.where(self._dead[:, :, None] | self._dead[:, None, :], 0.0, tangent)
        return residual, self._areas[:, None, None] * tangent, response


def _correction(split: Floats, residual: Floats, tangent: Floats) -> Floats:
    """Solve (I + w T (G - diag G)) d = r on the points that carry force or would."""
    active = np.flatnonzero(tangent.any(axis=(1, 2)))
    rows = (3 * active[:, None] + np.arange(3)).ravel()
    step = residual.copy()
    if len(rows) == 0:
        return step
    others = np.ones(len(residual), dtype=bool)
    others[rows] = False
    coupled = split[rows]
    known = (coupled[:, others] @ residual[others]).reshape(-1, 3, 1)
    right = residual[rows] - (tangent[active] @ known).ravel()
    block = coupled[:, rows].reshape(len(active), 3, -1)
    matrix = (tangent[active] @ block).reshape(len(rows), -1)
    matrix[np.diag_indices(len(rows))] += 1.0
    try:
        step[rows] = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        step[:] = np.nan  # the iteration ends as not converged
    return step
