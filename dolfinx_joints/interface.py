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

from dolfinx_joints.contact import Contact
from dolfinx_joints.errors import JointsError
from dolfinx_joints.laws import JointState, Response
from dolfinx_joints.linear import Cache, Effective, EffectiveMatrix, free_dofs, split_residual
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
    system: MatrixSystem, options: NewtonOptions | None = None, kind: str = "auto"
) -> StepSolver:
    """A solver of the steps of a system.

    Args:
        system: The system.
        options: Tolerances and limits.
        kind: ``condensed``, ``monolithic``, or ``auto``: condensed where all laws offer
            ``local_solve`` and the compliance fits, monolithic elsewhere.

    Raises:
        ValueError: The kind is unknown.
        JointsError: ``condensed`` was asked for and a law cannot be solved locally.
    """
    check_kind(kind)
    contact = system.contact
    if kind == "monolithic" or contact is None:
        return NewtonSolver(system, options)
    fits = 3 * contact.operator.num_points <= LARGEST_DENSE
    if kind == "condensed" and not contact.solves_locally:
        raise JointsError("A law without local_solve needs the monolithic solver.")
    if kind == "condensed" or (contact.solves_locally and fits):
        return InterfaceSolver(system, options)
    return NewtonSolver(system, options)


class _Compliance:
    """The factored bulk and the dense compliance of the joint points, the same on every rank.

    Attributes:
        effective: The bulk.
        split: G less the points' own compliances on its diagonal, shape (m, m), [m/N], m three
            times the number of joint points.
        own: Compliance of each local point on its own area, normal and tangential (the mean of
            the two directions), shape (n, 2), [m/Pa].
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
        each = self.split.diagonal()[start:stop].reshape(-1, 3)
        own = np.column_stack([each[:, 0], 0.5 * (each[:, 1] + each[:, 2])])
        self.own = areas[:, None] * own
        spread = np.repeat(own, (1, 2), axis=1).ravel()
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
        self, effective: Effective, b: PETSc.Vec, u: PETSc.Vec, state: JointState | None
    ) -> tuple[Response | None, PETSc.Vec, SolveReport]:
        """Solve for ``u`` in place; see `NewtonSolver.solve` (collective)."""
        state = state or self._contact.at_rest(u)
        compliance: _Compliance = self._compliances(effective)
        matrix = compliance.effective
        factored = matrix.solve_linear(b, u, self._free)
        free_gap = self._contact.gap(u).ravel()
        force, iterations, residual = self._iterate(compliance, free_gap, state)
        self._expand(matrix, force, u)
        response = self._contact.trial(u, state)
        balance = b.duplicate()
        matrix.full.mult(u, balance)
        balance.axpy(-1.0, b)
        work = b.duplicate()
        balance.axpy(1.0, self._contact.operator.force(response.traction, work))
        _, reaction = split_residual(balance, self._free)
        if not residual <= self.options.relative_tolerance:
            raise joint_failure(self._contact, response, state, iterations, residual, self.options)
        self._force = force
        report = SolveReport(
            iterations=iterations,
            factorizations=int(factored),
            residual=residual,
            counts=self._contact.counts(response.status),
        )
        return response, reaction, report

    def _expand(self, matrix: EffectiveMatrix, force: Floats, u: PETSc.Vec) -> None:
        """Add the displacements that the joint forces cause, -A^-1 B^T F."""
        points, nodal, moved = self._operator.createVecLeft(), u.duplicate(), u.duplicate()
        points.setArray(force[self._mine])
        self._operator.multTranspose(points, nodal)
        matrix.solver.solve(nodal, moved)
        u.axpy(-1.0, moved)

    def _residual(
        self, compliance: _Compliance, free_gap: Floats, force: Floats, state: JointState
    ) -> tuple[Floats, Floats]:
        """r(F) and w T of all points, shapes (m,) and (n, 3, 3)."""
        trial = free_gap - compliance.split[self._mine] @ force
        traction, tangent, _ = self._contact.local_solve(
            trial.reshape(-1, 3), compliance.own, state
        )
        if self._comm.size > 1:
            traction = np.concatenate(self._comm.allgather(traction))
            tangent = np.concatenate(self._comm.allgather(tangent))
        residual = force - (self._areas[:, None] * traction).ravel()
        return residual, self._areas[:, None, None] * tangent

    def _iterate(
        self, compliance: _Compliance, free_gap: Floats, state: JointState
    ) -> tuple[Floats, int, float]:
        """Joint forces, iterations, and residual relative to the largest force."""
        force = self._force
        residual, tangent = self._residual(compliance, free_gap, force, state)
        iteration = 0
        while True:
            size = float(np.abs(residual).max(initial=0.0))
            scale = max(float(np.abs(force).max(initial=0.0)), size) or 1.0
            relative = size / scale
            done = relative <= 0.1 * self.options.relative_tolerance
            if done or iteration == self.options.max_iterations or not np.isfinite(size):
                return force, iteration, relative
            step = _correction(compliance.split, residual, tangent)
            force, residual, tangent = self._search(
                compliance, free_gap, state, force, residual, step
            )
            iteration += 1

    def _search(
        self,
        compliance: _Compliance,
        free_gap: Floats,
        state: JointState,
        force: Floats,
        residual: Floats,
        step: Floats,
    ) -> tuple[Floats, Floats, Floats]:
        """Take the correction, halved while it does not make the residual smaller."""
        norm, smallest = float(np.linalg.norm(residual)), np.inf
        for cut in range(self.options.max_cuts + 1):
            trial = force - 0.5**cut * step
            answer = self._residual(compliance, free_gap, trial, state)
            size = float(np.linalg.norm(answer[0]))
            if size < smallest or cut == 0:
                smallest, best = size, (trial, *answer)
            if size < norm:
                break
        return best


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
