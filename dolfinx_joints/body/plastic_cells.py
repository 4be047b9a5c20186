# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells with plastic materials, combined with the joints for the monolithic solver.

The stiffness matrix contains the elastic part of these cells. The plastic force adds the stress
-C eps_p, which is zero unless a point has yielded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from dolfinx_joints.body.strain_operator import SIZE, StrainOperator, StrainTangent
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.internal_forces import JointInternalForces
from dolfinx_joints.joints.operator import TangentMatrix
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule, StatusCounts
from dolfinx_joints.materials.bulk_law import BulkLaw, BulkResponse, BulkState, BulkStatus
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


@dataclass(frozen=True, kw_only=True)
class PlasticState(JointState):
    """State of the joints (zero points without joints) and of the plastic cells."""

    bulk: BulkState


@dataclass(frozen=True, kw_only=True)
class PlasticResponse(Response):
    """Response of the joints (zero points without joints) and of the plastic cells.

    Attributes:
        state: New state, which becomes the committed state if the step is accepted.
        bulk: Response of the plastic cells.
        softening: Tangent of the plastic cells minus elastic tangent, shape (n, 6, 6), [Pa].
    """

    state: PlasticState
    bulk: BulkResponse
    softening: Floats


class PlasticBulk:
    """Internal forces of the cells with plastic materials and of the joints.

    ``laws`` are given by cell group; the empty name means all cells. ``kinds`` are the class names
    of the laws.
    """

    def __init__(
        self,
        jointed: JointedMesh,
        V: Any,
        laws: Mapping[str, BulkLaw],
        stiffness: PETSc.Mat,
        contact: Contact | None,
    ) -> None:
        """Build the strain operator (collective)."""
        topology = jointed.mesh.topology
        owned = np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)
        of_group = {name: jointed.cells(name) if name else owned for name in laws}
        groups = {name: cells[cells < len(owned)] for name, cells in of_group.items()}
        self.kinds = tuple(sorted({type(law).__name__ for law in laws.values()}))
        self._joints = None if contact is None else JointInternalForces(contact)
        self._mesh = jointed.mesh
        self.operator = StrainOperator(jointed, V, np.concatenate(list(groups.values())), stiffness)
        self._laws = [
            (laws[name], np.flatnonzero(np.isin(self.operator.cells, cells)))
            for name, cells in groups.items()
        ]
        self._elastic = np.zeros((len(self.operator.volumes), SIZE, SIZE))
        for law, points in self._laws:
            self._elastic[points] = law.elastic.stiffness_matrix()

    def with_joints(self, contact: Contact) -> PlasticBulk:
        """Return a copy with other joints."""
        other = copy(self)
        other._joints = JointInternalForces(contact)
        return other

    def at_rest(self, u: PETSc.Vec) -> PlasticState:
        """Return the state without shear traction and plastic strain (collective)."""
        joints = self._joints.at_rest(u) if self._joints else JointState.at_rest(np.zeros((0, 3)))
        return PlasticState(**vars(joints), bulk=BulkState.at_rest(self.operator.strain(u)))

    def trial(self, u: PETSc.Vec, state: PlasticState) -> PlasticResponse:
        """Return the response at the end of a step from ``state`` to ``u`` (collective)."""
        joints = self._joints.trial(u, state) if self._joints else _no_joints()
        return self._combine(joints, BACKWARD_EULER, self.operator.strain(u), state.bulk)

    def respond(self, change: PETSc.Vec, state: PlasticState, rule: Rule) -> PlasticResponse:
        """Return the response to a displacement change [m] since ``state`` (collective)."""
        joints = self._joints.respond(change, state, rule) if self._joints else _no_joints()
        strain = state.bulk.strain + self.operator.strain(change)
        return self._combine(joints, rule, strain, state.bulk)

    def _evaluate(self, rule: Rule, strain: Floats, state: BulkState) -> BulkResponse:
        """Return the response of the material laws at the local points (collective)."""
        with raised_together(self.operator.comm):
            if len(self._laws) == 1:
                return _method(self._laws[0][0], rule)(strain, state)
            answer = _empty_response(len(strain))
            for law, points in self._laws:
                before = BulkState(**{name: field[points] for name, field in vars(state).items()})
                part = _method(law, rule)(strain[points], before)
                for name in ("stress", "plastic_strain", "tangent", "dissipation", "status"):
                    getattr(answer, name)[points] = getattr(part, name)
                for name in vars(state):
                    getattr(answer.state, name)[points] = getattr(part.state, name)
        return answer

    def _combine(
        self, joints: Response, rule: Rule, strain: Floats, before: BulkState
    ) -> PlasticResponse:
        """Return the combined response of joints and bulk."""
        bulk = self._evaluate(rule, strain, before)
        fields = vars(joints) | {"state": PlasticState(**vars(joints.state), bulk=bulk.state)}
        # The rule over a whole step uses the mean strain, so its elastic tangent is half of C.
        softening = bulk.tangent - rule.weight * self._elastic
        return PlasticResponse(**fields, bulk=bulk, softening=softening)

    def force(self, response: PlasticResponse, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal forces of joints and plastic strains in a step, [N] (collective)."""
        return self._force(response, response.bulk.plastic_strain, out)

    def force_at_end(self, response: PlasticResponse, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the forces with the plastic strains at the end, [N] (collective)."""
        return self._force(response, response.state.bulk.plastic_strain, out)

    def _force(self, response: Response, plastic: Floats, out: PETSc.Vec) -> PETSc.Vec:
        self.operator.force(-self._stress(plastic), out)
        if self._joints is not None:
            joints = out.duplicate()
            out.axpy(1.0, self._joints.force(response, joints))
        return out

    def _stress(self, strain: Floats) -> Floats:
        """Return the elastic stress of strains at the local points, shape (n, 6), [Pa]."""
        return np.einsum("nij,nj->ni", self._elastic, strain)

    def elastic_correction(self, state: Any) -> float:
        """Return the change of the elastic energy u.K u / 2 by plastic strains [J] (collective).

        The change is the integral of (eps - eps_p).C (eps - eps_p) / 2 - eps.C eps / 2.
        """
        plastic = state.bulk.plastic_strain
        both = 0.5 * plastic - state.bulk.strain
        return self.operator.integral(np.einsum("ni,ni->n", both, self._stress(plastic)))

    def dissipation(self, response: Any) -> float:
        """Return the plastic work of a step [J] (collective)."""
        return self.operator.integral(response.bulk.dissipation)

    def yielding(self, response: PlasticResponse) -> int:
        """Return the number of yielding bulk points on all ranks (collective)."""
        yielding = int(np.count_nonzero(response.bulk.status != BulkStatus.ELASTIC))
        return int(self.operator.comm.allreduce(yielding))

    def tangent(self, response: PlasticResponse, part: float = 0.0) -> Floats:
        """Return the tangents of joints and bulk (minus elastic tangent) in one array [SI].

        ``part`` times the stiffness of closed joints and of the elastic body is added.
        """
        bulk = response.softening + part * self._elastic if part else response.softening
        if self._joints is None:
            return bulk.ravel()
        return np.concatenate([self._joints.tangent(response, part).ravel(), bulk.ravel()])

    def tangent_matrix(self, unconstrained: PETSc.Vec) -> PlasticTangent:
        """Return the assembler of the tangent matrix (collective)."""
        joints = None if self._joints is None else self._joints.tangent_matrix(unconstrained)
        return PlasticTangent(StrainTangent(self.operator, unconstrained), joints)

    def counts(self, response: PlasticResponse) -> StatusCounts | None:
        """Return the number of joint points by status, None without joints (collective)."""
        return None if self._joints is None else self._joints.counts(response)

    def rounding(self, response: PlasticResponse, change: float) -> float:
        """Return the rounding error of the joint forces, divided by eps [N] (collective)."""
        return 0.0 if self._joints is None else self._joints.rounding(response, change)

    def failure(self, response: PlasticResponse, state: PlasticState) -> dict[str, Any]:
        """Return keyword arguments of the error for a failed solve (collective)."""
        details = {} if self._joints is None else self._joints.failure(response, state)
        return details | {"yielding": self.yielding(response)}

    def stress(self, state: PlasticState) -> Floats:
        """Return the stress at the local points, shape (n, 6), [Pa]."""
        return self._stress(state.bulk.strain - state.bulk.plastic_strain)

    def cell_means(self, values: Floats) -> tuple[Ints, Floats]:
        """Return the plastic cells, (cells,), and cell means of values (n, m), (cells, m)."""
        cells, place = np.unique(self.operator.cells, return_inverse=True)
        volumes = self.operator.volumes
        shares = volumes / np.bincount(place, volumes)[place]
        means = np.zeros((len(cells), values.shape[1]))
        np.add.at(means, place, shares[:, None] * values)
        return cells, means

    def accumulated(self, state: PlasticState) -> Any:
        """Return the mean accumulated plastic strain per cell as a DOLFINx function."""
        field = fem.Function(fem.functionspace(self._mesh, ("DG", 0)), name="plastic strain")
        cells, means = self.cell_means(state.bulk.accumulated[:, None])
        field.x.array[field.function_space.dofmap.list[cells, 0]] = means[:, 0]
        field.x.scatter_forward()
        return field


class PlasticTangent:
    """Assembler of the tangent of joints and plastic cells; reuses the sparsity pattern."""

    def __init__(self, bulk: StrainTangent, joints: TangentMatrix | None) -> None:
        """Store the assemblers of both parts, None without joints."""
        self.comm, self._bulk, self._joints = bulk.comm, bulk, joints
        self.joints = None if joints is None else joints.joints
        self._sums: dict[bool, PETSc.Mat] = {}

    def assemble(self, tangent: Floats, *, coupled: bool = True) -> PETSc.Mat:
        """Return the matrix of the array from `PlasticBulk.tangent`, [N/m] (collective)."""
        count = len(tangent) - SIZE**2 * self._bulk.num_points
        added = self._bulk.assemble(tangent[count:].reshape(-1, SIZE, SIZE))
        if self._joints is None:
            return added
        joints = self._joints.assemble(tangent[:count].reshape(-1, 3, 3), coupled=coupled)
        if coupled not in self._sums:
            self._sums[coupled] = joints.copy()
            self._sums[coupled].axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            return self._sums[coupled]
        total = self._sums[coupled]
        total.zeroEntries()
        total.axpy(1.0, joints, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        total.axpy(1.0, added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return total


def _method(law: BulkLaw, rule: Rule) -> Callable[[Floats, BulkState], BulkResponse]:
    """Return the method of a law for a rule."""
    methods = {"backward_euler": law.backward_euler, "discrete_gradient": law.discrete_gradient}
    return methods[rule.name]


def _empty_response(count: int) -> BulkResponse:
    return BulkResponse(
        stress=np.zeros((count, SIZE)),
        plastic_strain=np.zeros((count, SIZE)),
        tangent=np.zeros((count, SIZE, SIZE)),
        state=BulkState.at_rest(np.zeros((count, SIZE))),
        dissipation=np.zeros(count),
        status=np.zeros(count, dtype=np.int8),
    )


def _no_joints() -> Response:
    none = np.zeros((0, 3))
    return Response(
        traction=none,
        tangent=np.zeros((0, 3, 3)),
        state=JointState.at_rest(none),
        dissipation=np.zeros(0),
        status=np.zeros(0, dtype=np.int8),
    )
