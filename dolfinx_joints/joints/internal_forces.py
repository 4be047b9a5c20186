# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What Newton's method asks of the parts of a body that are not linear: joints, plastic cells."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import TangentMatrix
from dolfinx_joints.laws.law import JointState, Response, Rule, StatusCounts


class InternalForces(Protocol):
    """Forces that follow from displacements by laws; every method is collective.

    States and responses are a `JointState` and a `Response`, or kinds of these that hold more.
    """

    def at_rest(self, u: PETSc.Vec) -> Any:
        """State at a displacement that has no history."""

    def trial(self, u: PETSc.Vec, state: Any) -> Any:
        """End-point answer at the displacement ``u`` from ``state``."""

    def respond(self, change: PETSc.Vec, state: Any, rule: Rule) -> Any:
        """Answer to a change of the displacement since ``state``."""

    def force(self, response: Any, out: PETSc.Vec) -> PETSc.Vec:
        """Nodal forces that act in a step, [N]."""

    def force_at_end(self, response: Any, out: PETSc.Vec) -> PETSc.Vec:
        """Nodal forces that a motion starts with after the step, [N]."""

    def tangent(self, response: Any, part: float = 0.0) -> Floats:
        """Point tangents, with a part of the stiffness of closed joints and elastic cells added."""

    def tangent_matrix(self, free: PETSc.Vec) -> TangentMatrix:
        """What makes a matrix of point tangents; ``free`` is 1 for free dofs, 0 for others."""

    def counts(self, response: Any) -> StatusCounts | None:
        """Joint points by status, None without joints."""

    def rounding(self, response: Any, change: float) -> float:
        """What rounding may leave of the forces over eps, ``change`` the largest of the step."""

    def failure(self, response: Any, state: Any) -> dict[str, Any]:
        """What `ConvergenceError` is to say of a solve that did not converge."""


class JointInternalForces:
    """The joints."""

    def __init__(self, contact: Contact) -> None:
        self.contact = contact
        self.at_rest, self.trial, self.respond = contact.at_rest, contact.trial, contact.respond

    def force(self, response: Response, out: PETSc.Vec) -> PETSc.Vec:
        """B^T (w t), [N] (collective)."""
        return self.contact.operator.force(response.traction, out)

    force_at_end = force

    def tangent(self, response: Response, part: float = 0.0) -> Floats:
        """Tangent of each point, shape (n, 3, 3), [Pa/m]."""
        tangent = response.tangent
        return tangent + part * self.contact.closed_tangent(firm=True) if part else tangent

    def tangent_matrix(self, free: PETSc.Vec) -> TangentMatrix:
        """What makes B^T (w D) B of point tangents D (collective)."""
        return self.contact.operator.tangent_matrix(free)

    def counts(self, response: Response) -> StatusCounts:
        """Count points by what they do, on all ranks (collective)."""
        return self.contact.counts(response.status)

    def rounding(self, response: Response, change: float) -> float:
        """What rounding may leave of joint forces that follow from the gaps, over eps [N].

        Args:
            response: The answer that made them.
            change: Largest displacement of the step [m].
        """
        operator = self.contact.operator
        largest = np.abs(response.state.gap).max(axis=1, initial=0.0)
        stiffness = operator.areas * np.abs(response.tangent).max(axis=(1, 2), initial=0.0)
        error = stiffness * np.maximum(largest, change)
        return float(sum(operator.comm.allgather(error @ error)) ** 0.5)

    def failure(self, response: Response, state: JointState) -> dict[str, Any]:
        """Counts, and the joint that moved most (collective)."""
        moved = np.abs(response.state.gap - state.gap).sum(axis=1)
        counts = vars(self.counts(response)).copy()
        del counts["tied"]
        blamed = self.contact.not_finite(response)
        if blamed is not None:
            return {**counts, "joint": blamed[0], "law": blamed[1]}
        return {**counts, "joint": self.contact.worst_joint(moved)}
