# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of Newton's method to the nonlinear internal forces: joints, nonlinear cells."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import TangentMatrix
from dolfinx_joints.laws.law import JointState, Response, Rule, StatusCounts


class InternalForces(Protocol):
    """Nonlinear forces that depend on displacements; every method is collective.

    States and responses are `JointState` and `Response`, or types with additional fields.
    """

    def at_rest(self, u: PETSc.Vec) -> Any:
        """Return the state without history at a displacement."""

    def trial(self, u: PETSc.Vec, state: Any) -> Any:
        """Return the response at the end of a step from ``state`` to the displacement ``u``."""

    def respond(self, change: PETSc.Vec, state: Any, rule: Rule) -> Any:
        """Return the response to a change of the displacement, relative to ``state``."""

    def force(self, response: Any, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal forces that act in a step, [N]."""

    def force_at_end(self, response: Any, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal forces at the end of the step, with which a motion starts, [N]."""

    def tangent(self, response: Any, part: float = 0.0) -> Floats:
        """Return the point tangents plus ``part`` times the elastic stiffness."""

    def tangent_matrix(self, free: PETSc.Vec) -> TangentMatrix:
        """Return the assembler of the tangent matrix; ``free`` is 1 for free dofs, else 0."""

    def counts(self, response: Any) -> StatusCounts | None:
        """Return the number of joint points by status, None without joints."""

    def rounding(self, response: Any, change: float) -> float:
        """Return the rounding error of the forces / eps for a largest displacement ``change``."""

    def failure(self, response: Any, state: Any) -> dict[str, Any]:
        """Return keyword arguments of the `ConvergenceError` for a failed solve."""


class JointInternalForces:
    """Internal forces of the joints."""

    def __init__(self, contact: Contact) -> None:
        self.contact = contact
        self.at_rest, self.trial, self.respond = contact.at_rest, contact.trial, contact.respond

    def force(self, response: Response, out: PETSc.Vec) -> PETSc.Vec:
        """Compute B^T (w t), [N] (collective)."""
        return self.contact.operator.force(response.traction, out)

    force_at_end = force

    def tangent(self, response: Response, part: float = 0.0) -> Floats:
        """Return the tangent of each point, shape (n, 3, 3), [Pa/m]."""
        tangent = response.tangent
        return tangent + part * self.contact.closed_tangent(firm=True) if part else tangent

    def tangent_matrix(self, free: PETSc.Vec) -> TangentMatrix:
        """Return the assembler of B^T (w D) B from point tangents D (collective)."""
        return self.contact.operator.tangent_matrix(free)

    def counts(self, response: Response) -> StatusCounts:
        """Return the number of points of each status on all ranks (collective)."""
        return self.contact.counts(response.status)

    def rounding(self, response: Response, change: float) -> float:
        """Return the error of the joint forces due to rounding of the gaps, divided by eps [N].

        Args:
            response: Response with the joint forces.
            change: Largest displacement change of the step [m].
        """
        operator = self.contact.operator
        largest = np.abs(response.state.gap).max(axis=1, initial=0.0)
        stiffness = operator.areas * np.abs(response.tangent).max(axis=(1, 2), initial=0.0)
        error = stiffness * np.maximum(largest, change)
        return float(sum(operator.comm.allgather(error @ error)) ** 0.5)

    def failure(self, response: Response, state: JointState) -> dict[str, Any]:
        """Return point counts and the joint with the largest gap change (collective)."""
        gap_change = np.abs(response.state.gap - state.gap).sum(axis=1)
        counts = vars(self.counts(response)).copy()
        del counts["tied"]
        not_finite = self.contact.not_finite(response)
        if not_finite is not None:
            return {**counts, "joint": not_finite[0], "law": not_finite[1]}
        return {**counts, "joint": self.contact.worst_joint(gap_change)}
