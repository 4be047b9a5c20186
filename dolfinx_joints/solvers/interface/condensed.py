# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A system condensed onto its joints for one set of coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

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
from dolfinx_joints.solvers.interface.corrections import CompiledCorrections
from dolfinx_joints.solvers.interface.krylov_corrections import KrylovCorrections
from dolfinx_joints.solvers.interface.springs import JointSprings
from dolfinx_joints.solvers.step_solver import SolverOptions

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Solved:
    """The joint forces of a step.

    Attributes:
        force: Scaled forces f - r, shape (m,).
        response: Of the points.
        iterations: Iterations.
        relative: Residual relative to the largest force.
    """

    force: Floats
    response: Response
    iterations: int
    relative: float


class Condensed:
    """The bulk factored for one set of coefficients, with its compliance at the joints.

    Args:
        system: The system.
        effective: The coefficients.
        operator: B with the columns of constrained dofs empty.
        weight: Factor of 1/k of a sticking point in the law, 1 / `Rule.weight`.
        options: How the bulk is solved, and what is kept of the compliance.

    Attributes:
        static: Whether there is no inertia.
        loose: Whether there are blocks that nothing but joints supports.
        used: Whether a step has been solved with it.
    """

    def __init__(
        self,
        system: MatrixSystem,
        effective: MatrixCoefficients,
        operator: PETSc.Mat,
        weight: float,
        options: SolverOptions,
    ) -> None:
        """Factor (collective)."""
        assert system.contact is not None
        self._system, self._contact, self._options = system, system.contact, options
        self._operator, self._weight = operator, weight
        self.static, self.used = not effective.mass, False
        self._restored: Mapping[str, Any] = {}
        self._effective = effective
        self._body = EffectiveMatrix.of(system, effective, linear=options.linear)
        self.loose = self.static and not _is_regular(self._body, unconstrained_dofs(system))
        if self.loose:
            # Do not destroy the failed factor, leave it to PETSc's collector: every rank must take
            # part in the destruction, and on three ranks two were seen to wait for the third.
            del self._body
            free_petsc_garbage(self._contact.operator.comm)

    @cached_property
    def springs(self) -> JointSprings | None:
        """Springs across the joints in statics of loose blocks, else None (collective)."""
        return JointSprings(self._system) if self.loose else None

    @cached_property
    def matrix(self) -> EffectiveMatrix:
        """The bulk, with these springs (collective when first asked for)."""
        if self.springs is None:
            return self._body
        return EffectiveMatrix(
            self._system,
            self._effective,
            linear=self._options.linear,
            added=self.springs.matrix,
        )

    @cached_property
    def compliance(self) -> Compliance:
        """G, scaled, made when first asked for (collective)."""
        shared = self._system.shared
        if shared is None or self.springs is not None:
            return self._made()
        key = ("compliance", self._effective, self._options.compliance)
        made: Compliance = shared.once(key, self._made, Compliance.destroy)
        return made

    def _made(self) -> Compliance:
        return Compliance(
            self.matrix,
            self._operator,
            self._contact.operator,
            kind=self._options.compliance,
            largest=None if self.springs is None else self.springs.largest_compliance,
        )

    @cached_property
    def scale(self) -> Floats:
        """s, zero in directions in which a point cannot move, shape (m,), [(m/N)^(1/2)]."""
        return np.where(self.compliance.dead.ravel(), 0.0, self.compliance.scale)

    @cached_property
    def root(self) -> Floats:
        """Scaled force of a traction of 1 Pa, s w, shape (m,)."""
        return np.repeat(self._contact.operator.areas, 3) * self.scale

    @cached_property
    def corrections(self) -> CompiledCorrections | KrylovCorrections:
        """Solver of Newton's corrections (collective when first asked for)."""
        contact, comm = self._contact, self._operator.comm.tompi4py()
        meets = contact.rigid and self._tied_twice()
        if self.static or meets or not CompiledCorrections.serves(self.compliance):
            return KrylovCorrections(self.compliance, contact.rigid, comm)
        stuck = self._stuck() if self._system.symmetric else None
        corrections = CompiledCorrections(self.compliance, stuck, comm)
        if self._restored:
            corrections.load_state_dict(self._restored)
        return corrections

    def _tied_twice(self) -> bool:
        """Whether a node is at several rigid points, which may then tie each other (collective)."""
        rigid = np.isinf(np.repeat(self._contact.closed_stiffness(), (1, 2), axis=1))
        squares = self._operator.copy()
        points, nodes = squares.createVecLeft(), squares.createVecRight()
        start, columns, values = squares.getValuesCSR()
        squares.setValuesCSR(start, columns, values**2)
        squares.assemble()
        points.setArray(rigid.ravel().astype(float))
        squares.multTranspose(points, nodes)  # of a node's direction the three rows of a point: 1
        twice = bool(nodes.max()[1] > 1.5)
        for each in (squares, points, nodes):
            each.destroy()
        return twice

    def state_dict(self) -> dict[str, Any]:
        """Return the state that later corrections depend on, empty before the first."""
        if "corrections" not in self.__dict__:
            return dict(self._restored)
        return self.corrections.state_dict()

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave, once corrections are asked for."""
        self._restored = state_dict

    def close(self, found: Solved) -> None:
        """Set rigid-point openings below the step's resolution to zero (collective).

        Where rigid joints meet, points that stick determine whether others are open: such an
        opening would contradict them in later steps, by more the shorter these are.
        """
        if not self._contact.rigid:
            return
        comm, compliance = self._contact.operator.comm, self.compliance
        largest = comm.allreduce(float(np.abs(found.force).max(initial=0.0)), MPI.MAX)
        resolved = limits.RIGID_OPENING * max(found.relative, limits.COMPRESSION) * largest
        rigid = np.isinf(self._contact.closed_stiffness()[:, 0]) & ~compliance.dead[:, 0]
        gap = found.response.state.gap[:, 0]
        gap[rigid & (gap > 0.0) & (gap <= resolved * compliance.scale[::3])] = 0.0

    def _stuck(self) -> Floats:
        """T0 of sticking points, shape (n, 3): c / (c + weight / k)."""
        contact = self._contact
        own = np.repeat(self.compliance.own, (1, 2), axis=1)
        stiffness = np.repeat(contact.closed_stiffness(), (1, 2), axis=1)
        with np.errstate(divide="ignore"):
            total = own + self._weight / stiffness
        ratio = np.divide(own, total, out=np.zeros_like(own), where=total > 0.0)
        return np.where(self.compliance.dead, 0.0, ratio)

    def destroy(self) -> None:
        """Free matrices and factor."""
        if isinstance(corrections := self.__dict__.get("corrections"), KrylovCorrections):
            corrections.free()
        if "compliance" in self.__dict__ and self.matrix.scheduler is None:
            self.compliance.destroy()
        if not self.loose or "matrix" in self.__dict__:
            self.matrix.destroy()


def _is_regular(matrix: EffectiveMatrix, unconstrained: PETSc.Vec) -> bool:
    """Whether a matrix of statics is regular: no block that nothing but joints supports."""
    load, moved = unconstrained.duplicate(), unconstrained.duplicate()
    load.setRandom()
    load.pointwiseMult(load, unconstrained)
    try:
        matrix.solve(load, moved)
    except JointsError:
        return False
    rest = load.duplicate()
    matrix.constrained.mult(moved, rest)
    rest.axpy(-1.0, load)
    return bool(rest.norm() <= limits.SUPPORTED_RESIDUAL * load.norm())
