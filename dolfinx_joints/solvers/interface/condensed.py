# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""System condensed onto the joints, (20) to (22) of docs/theory, for one set of coefficients of A.

A = mass M + damping C + stiffness K is the matrix of a step (`MatrixCoefficients`), B the gap
operator, c the own compliance of a joint point and w its area.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import free_petsc_garbage
from dolfinx_joints.laws.law import Response
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.compliance import Compliance
from dolfinx_joints.solvers.effective_matrix import (
    EffectiveMatrix,
    MatrixCoefficients,
    unconstrained_dofs,
)
from dolfinx_joints.solvers.interface.corrections import CompiledCorrections, KrylovCorrections
from dolfinx_joints.solvers.interface.springs import JointSprings
from dolfinx_joints.solvers.step_solver import SolverOptions

if TYPE_CHECKING:
    from dolfinx_joints.solvers.interface.load_control import ControlledMatrix


@dataclass(frozen=True, kw_only=True)
class Solved:
    """Joint forces of a step.

    Attributes:
        force: Scaled forces f - r, the forces of the laws, shape (m,).
        response: Response of the joint points.
        iterations: Number of Newton iterations.
        relative: Residual relative to the largest force.
    """

    force: Floats
    response: Response
    iterations: int
    relative: float


class Condensed:
    """Bulk factored for one set of coefficients, with its compliance at the joints.

    Args:
        system: The system.
        effective: The coefficients.
        operator: B with the columns of constrained dofs empty.
        weight: Factor of 1/k of a sticking point in the law, 1 / `Rule.weight`.
        options: Options for the solver of the bulk and for the compliance.

    Attributes:
        static: True in statics (no inertia).
        unsupported: True if only joints support a block, in statics.
        used: True if a step has been solved with this object.
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        operator: PETSc.Mat,
        weight: float,
        options: SolverOptions,
    ) -> None:
        """Factor the bulk (collective)."""
        assert system.contact is not None
        self._system, self._contact, self._options = system, system.contact, options
        self._operator, self._weight = operator, weight
        self.static, self.used = not effective.mass, False
        self._restored: Mapping[str, Any] = {}
        self._effective = effective
        self._body = EffectiveMatrix.of(system, effective, linear=options.linear)
        self.unsupported = self.static and not _is_regular(self._body, unconstrained_dofs(system))
        if self.unsupported:
            # Leave the failed factor to PETSc's garbage collector: all ranks must destroy it
            # together, and a direct call has blocked two of three ranks.
            del self._body
            free_petsc_garbage(self._contact.operator.comm)

    @cached_property
    def springs(self) -> JointSprings | None:
        """Springs across the joints if a block is unsupported, else None (collective)."""
        return JointSprings(self._system) if self.unsupported else None

    @cached_property
    def matrix(self) -> EffectiveMatrix:
        """Matrix of the bulk, including the springs (collective on first use)."""
        if self.springs is None:
            return self._body
        return EffectiveMatrix(
            self._system,
            self._effective,
            linear=self._options.linear,
            added=self.springs.matrix,
        )

    @cached_property
    def controlled(self) -> ControlledMatrix | None:
        """Matrix with a controlled load, None without such a load (collective on first use)."""
        if self._system.control is None:
            return None
        from dolfinx_joints.solvers.interface.load_control import ControlledMatrix

        free = unconstrained_dofs(self._system)
        return ControlledMatrix(self.matrix, *self._system.control, free)

    @property
    def solver(self) -> EffectiveMatrix | ControlledMatrix:
        """Solver of a step for displacements (collective on first use)."""
        return self.controlled or self.matrix

    @cached_property
    def compliance(self) -> Compliance:
        """Scaled compliance of the joints, made on first use (collective)."""
        shared = self._system.shared
        if shared is None or self.springs is not None:
            return self._new_compliance()
        key = ("compliance", self._effective, self._options.compliance)
        made: Compliance = shared.once(key, self._new_compliance, Compliance.destroy)
        return made

    def _new_compliance(self) -> Compliance:
        return Compliance(
            self.matrix,
            self._operator,
            self._contact.operator,
            kind=self._options.compliance,
            largest=self._largest_compliance(),
        )

    def _largest_compliance(self) -> Floats | None:
        """Return the largest c at which softening points are unique, (n, 2), [m/Pa], or None."""
        springs, softens = self.springs, self._contact.softens
        if not softens:
            return None if springs is None else springs.largest_compliance
        stiffness = self._contact.steepest_softening()
        stiffness /= self._weight * limits.SOFTENING_COMPLIANCE
        if springs is not None:
            stiffness = np.maximum(stiffness + springs.stiffness, 1.0 / springs.largest_compliance)
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / stiffness)

    @cached_property
    def scale(self) -> Floats:
        """Scale s = sqrt(c / w), zero in constrained directions, (m,), [(m/N)^(1/2)]."""
        return np.where(self.compliance.dead.ravel(), 0.0, self.compliance.scale)

    @cached_property
    def force_scale(self) -> Floats:
        """Scaled force of a traction of 1 Pa, s w, shape (m,)."""
        return np.repeat(self._contact.operator.areas, 3) * self.scale

    @cached_property
    def corrections(self) -> CompiledCorrections | KrylovCorrections:
        """Solver of Newton's corrections (collective on first use)."""
        contact, comm = self._contact, self._operator.comm.tompi4py()
        rigid_points_meet = contact.rigid and self._rigid_points_meet()
        if self.static or rigid_points_meet or not CompiledCorrections.serves(self.compliance):
            corrections = KrylovCorrections(self.compliance, contact.rigid, comm)
            if self.controlled is not None:
                corrections.controlled = self.controlled.gaps(self._operator, self.compliance)
            return corrections
        stuck = self._sticking_tangent() if self._system.symmetric else None
        compiled = CompiledCorrections(self.compliance, stuck, comm)
        if self._restored:
            compiled.load_state_dict(self._restored)
        return compiled

    def _rigid_points_meet(self) -> bool:
        """Return True if rigid points share a node and may tie each other (collective)."""
        rigid = np.isinf(np.repeat(self._contact.closed_stiffness(), (1, 2), axis=1))
        squares = self._operator.copy()
        points, nodes = squares.createVecLeft(), squares.createVecRight()
        start, columns, values = squares.getValuesCSR()
        squares.setValuesCSR(start, columns, values**2)
        squares.assemble()
        points.setArray(rigid.ravel().astype(float))
        squares.multTranspose(points, nodes)  # a point's rows add 1 per direction of a node
        meet = bool(nodes.max()[1] > 1.5)
        for temporary in (squares, points, nodes):
            temporary.destroy()
        return meet

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the corrections, empty before the first correction."""
        if "corrections" not in self.__dict__:
            return dict(self._restored)
        return self.corrections.state_dict()

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Store the ``state_dict`` of another object until the corrections are made."""
        self._restored = state_dict

    def close_unresolved_openings(self, solved: Solved) -> None:
        """Set rigid-point openings below the step's resolution to zero (collective).

        Where rigid joints meet, sticking points determine whether other points are open. An opening
        within the resolution would contradict these points in later steps, especially short steps.
        """
        if not self._contact.rigid:
            return
        comm, compliance = self._contact.operator.comm, self.compliance
        largest = comm.allreduce(float(np.abs(solved.force).max(initial=0.0)), MPI.MAX)
        resolved = limits.RIGID_OPENING * max(solved.relative, limits.COMPRESSION) * largest
        rigid = np.isinf(self._contact.closed_stiffness()[:, 0]) & ~compliance.dead[:, 0]
        gap = solved.response.state.gap[:, 0]
        gap[rigid & (gap > 0.0) & (gap <= resolved * compliance.scale[::3])] = 0.0

    def _sticking_tangent(self) -> Floats:
        """Return T0, the diagonal tangent c / (c + weight / k) of sticking points, shape (n, 3)."""
        contact = self._contact
        compliance = np.repeat(self.compliance.own, (1, 2), axis=1)
        stiffness = np.repeat(contact.closed_stiffness(), (1, 2), axis=1)
        with np.errstate(divide="ignore"):
            total = compliance + self._weight / stiffness
        ratio = np.divide(compliance, total, out=np.zeros_like(compliance), where=total > 0.0)
        return np.where(self.compliance.dead, 0.0, ratio)

    def destroy(self) -> None:
        """Free the matrices and the factor."""
        if isinstance(corrections := self.__dict__.get("corrections"), KrylovCorrections):
            corrections.free()
        if "compliance" in self.__dict__ and self.matrix.scheduler is None:
            self.compliance.destroy()
        if not self.unsupported or "matrix" in self.__dict__:
            self.matrix.destroy()


def _is_regular(matrix: EffectiveMatrix, unconstrained: PETSc.Vec) -> bool:
    """Return True if a static matrix is regular: no block is supported only by joints."""
    load, displacement = unconstrained.duplicate(), unconstrained.duplicate()
    load.setRandom()
    load.pointwiseMult(load, unconstrained)
    try:
        matrix.solve(load, displacement)
    except JointsError:
        return False
    residual = load.duplicate()
    matrix.constrained.mult(displacement, residual)
    residual.axpy(-1.0, load)
    return bool(residual.norm() <= limits.SUPPORTED_RESIDUAL * load.norm())
