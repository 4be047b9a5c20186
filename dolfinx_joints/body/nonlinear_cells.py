# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells with nonlinear materials, combined with the joints for the monolithic solver.

The stiffness matrix contains the elastic part of these cells. Their force adds the excess stress,
the stress minus C eps: -C eps_p for a plastic strain eps_p.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.strain_operator import SIZE, StrainOperator, StrainTangent
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import finite
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.internal_forces import JointInternalForces
from dolfinx_joints.joints.operator import TangentMatrix
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Response, Rule, StatusCounts
from dolfinx_joints.materials.bulk_law import BulkLaw, BulkState, BulkStatus, product
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.jointed_mesh import JointedMesh


@dataclass(frozen=True, kw_only=True)
class BodyState(JointState):
    """State of the joints (zero points without joints) and of the nonlinear cells."""

    bulk: BulkState


@dataclass(frozen=True, kw_only=True)
class CellResponse:
    """Response of the n points of the nonlinear cells.

    Attributes:
        stress: Stress that acts in the step, shape (n, 6), [Pa].
        excess: ``stress`` minus C times the strain to which K x belongs, shape (n, 6), [Pa].
        softening: Tangent minus elastic tangent, shape (n, 6, 6), [Pa].
        dissipation, numerical, status: See `BulkResponse`.
    """

    stress: Floats
    excess: Floats
    softening: Floats
    dissipation: Floats
    numerical: Floats
    status: NDArray[np.int8]


@dataclass(frozen=True, kw_only=True)
class BodyResponse(Response):
    """Response of the joints (zero points without joints) and of the nonlinear cells.

    Attributes:
        state: New state, which becomes the committed state if the step is accepted.
        bulk: Response of the nonlinear cells.
    """

    state: BodyState
    bulk: CellResponse


class _Zone:
    """Local points of a law, number of columns of its variables, and columns of the scalar ones."""

    def __init__(self, law: BulkLaw, points: NDArray[np.int64]) -> None:
        self.law, self.points, self.width = law, points, 0
        self.columns: dict[str, int] = {}
        for name, shape in law.internal_variables.items():
            if shape == ():
                self.columns[name] = self.width
            self.width += int(np.prod(shape))


class NonlinearBulk:
    """Internal forces of the cells with nonlinear materials and of the joints.

    ``laws`` are given by cell group; the empty name means all cells. ``kinds`` are the class names
    of the laws, ``variables`` the names of their scalar internal variables, and ``initial`` all
    variables at rest, shape (n, m).
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
        cells = self.operator.cells
        sizes = np.bincount(cells, self.operator.volumes)[cells] ** (1.0 / topology.dim)
        self._elastic = np.zeros((len(sizes), SIZE, SIZE))
        with raised_together(self.operator.comm):
            self._zones = [
                _Zone(law, np.flatnonzero(np.isin(cells, groups[name])))
                for name, law in laws.items()
            ]
            # Laws with fewer variables than others use the first columns.
            self.initial = np.zeros((len(sizes), max(zone.width for zone in self._zones)))
            for zone in self._zones:
                self._elastic[zone.points] = zone.law.elastic.stiffness_matrix()
                initial = zone.law.initial_variables(sizes[zone.points])
                self.initial[zone.points, : zone.width] = initial
        self.variables = tuple(dict.fromkeys(name for zone in self._zones for name in zone.columns))

    def with_joints(self, contact: Contact) -> NonlinearBulk:
        """Return a copy with other joints."""
        other = copy(self)
        other._joints = JointInternalForces(contact)
        return other

    def at_rest(self, u: PETSc.Vec) -> BodyState:
        """Return the state without history, elastic in the bulk (collective)."""
        joints = self._joints.at_rest(u) if self._joints else JointState.at_rest(np.zeros((0, 3)))
        strain = self.operator.strain(u)
        return BodyState(
            **vars(joints), bulk=BulkState.elastic(strain, self._elastic, self.initial)
        )

    def trial(self, u: PETSc.Vec, state: BodyState) -> BodyResponse:
        """Return the response at the end of a step from ``state`` to ``u`` (collective)."""
        joints = self._joints.trial(u, state) if self._joints else _no_joints()
        return self._combine(joints, BACKWARD_EULER, self.operator.strain(u), state.bulk)

    def respond(self, change: PETSc.Vec, state: BodyState, rule: Rule) -> BodyResponse:
        """Return the response to a displacement change [m] since ``state`` (collective)."""
        joints = self._joints.respond(change, state, rule) if self._joints else _no_joints()
        strain = state.bulk.strain + self.operator.strain(change)
        return self._combine(joints, rule, strain, state.bulk)

    def _combine(
        self, joints: Response, rule: Rule, strain: Floats, before: BulkState
    ) -> BodyResponse:
        """Return the combined response of joints and bulk (collective)."""
        after = {name: field.copy() for name, field in vars(before).items()}
        acting: dict[str, Any] = {
            "stress": np.zeros((len(strain), SIZE)),
            "tangent": np.zeros_like(self._elastic),
        }
        acting |= {name: np.zeros(len(strain)) for name in ("dissipation", "numerical")}
        acting["status"] = np.zeros(len(strain), dtype=np.int8)
        with raised_together(self.operator.comm):
            for zone in self._zones:
                points = zone.points
                start = {name: field[points] for name, field in vars(before).items()}
                start["internal"] = start["internal"][:, : zone.width]
                method = getattr(zone.law, rule.name)
                part = method(strain[points], BulkState(**start), rule.elapsed)
                for name in ("strain", "stress", "energy"):
                    after[name][points] = getattr(part.state, name)
                after["internal"][points, : zone.width] = part.state.internal
                for name, values in acting.items():
                    values[points] = getattr(part, name)
        # The rule over a whole step uses the mean strain, so its elastic tangent is half of C.
        in_stiffness = before.strain + rule.weight * (strain - before.strain)
        bulk = CellResponse(
            excess=acting["stress"] - self._stress(in_stiffness),
            softening=acting.pop("tangent") - rule.weight * self._elastic,
            **acting,
        )
        state = BodyState(**vars(joints.state), bulk=BulkState(**after))
        return BodyResponse(**vars(joints) | {"state": state}, bulk=bulk)

    def force(self, response: BodyResponse, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the nodal forces of joints and excess stresses in a step, [N] (collective)."""
        return self._force(response, response.bulk.excess, out)

    def force_at_end(self, response: BodyResponse, out: PETSc.Vec) -> PETSc.Vec:
        """Compute the forces with the excess stresses at the end, [N] (collective)."""
        end = response.state.bulk
        return self._force(response, end.stress - self._stress(end.strain), out)

    def _force(self, response: Response, excess: Floats, out: PETSc.Vec) -> PETSc.Vec:
        self.operator.force(excess, out)
        if self._joints is not None:
            joints = out.duplicate()
            out.axpy(1.0, self._joints.force(response, joints))
        return out

    def _stress(self, strain: Floats) -> Floats:
        """Return the elastic stress of strains at the local points, shape (n, 6), [Pa]."""
        return np.einsum("nij,nj->ni", self._elastic, strain)

    def excess_energy(self, state: Any) -> float:
        """Return the stored energy minus the elastic energy in u.K u / 2 [J] (collective)."""
        bulk = state.bulk
        elastic = 0.5 * product(self._stress(bulk.strain), bulk.strain)
        return self.operator.integral(bulk.energy - elastic)

    def losses(self, response: Any) -> tuple[float, float]:
        """Return dissipation and numerical loss of a step, see `BulkResponse`, [J] (collective)."""
        bulk = response.bulk
        return self.operator.integral(bulk.dissipation), self.operator.integral(bulk.numerical)

    def yielding(self, response: BodyResponse) -> int:
        """Return the number of yielding bulk points on all ranks (collective)."""
        yielding = int(np.count_nonzero(response.bulk.status != BulkStatus.ELASTIC))
        return int(self.operator.comm.allreduce(yielding))

    def tangent(self, response: BodyResponse, part: float = 0.0) -> Floats:
        """Return the tangents of joints and bulk (minus elastic tangent) in one array [SI].

        ``part`` times the stiffness of closed joints and of the elastic body is added.
        """
        bulk = response.bulk.softening
        bulk = bulk + part * self._elastic if part else bulk
        if self._joints is None:
            return bulk.ravel()
        return np.concatenate([self._joints.tangent(response, part).ravel(), bulk.ravel()])

    def tangent_matrix(self, unconstrained: PETSc.Vec) -> BodyTangent:
        """Return the assembler of the tangent matrix (collective)."""
        joints = None if self._joints is None else self._joints.tangent_matrix(unconstrained)
        return BodyTangent(StrainTangent(self.operator, unconstrained), joints)

    def counts(self, response: BodyResponse) -> StatusCounts | None:
        """Return the number of joint points by status, None without joints (collective)."""
        return None if self._joints is None else self._joints.counts(response)

    def rounding(self, response: BodyResponse, change: float) -> float:
        """Return the rounding error of the joint forces, divided by eps [N] (collective)."""
        return 0.0 if self._joints is None else self._joints.rounding(response, change)

    def failure(self, response: BodyResponse, state: BodyState) -> dict[str, Any]:
        """Return keyword arguments of the error for a failed solve (collective)."""
        details = {} if self._joints is None else self._joints.failure(response, state)
        stress = response.bulk.stress
        kinds = [type(z.law).__name__ for z in self._zones if not finite(stress[z.points])]
        faulty = sorted(kind for part in self.operator.comm.allgather(kinds) for kind in part)
        if faulty and not details.get("law"):
            details |= {"law": faulty[0], "joint": None}
        return details | {"yielding": self.yielding(response)}

    def cell_means(self, values: Floats) -> tuple[Ints, Floats]:
        """Return the nonlinear cells, (cells,), and cell means of values (n, m), (cells, m)."""
        cells, place = np.unique(self.operator.cells, return_inverse=True)
        volumes = self.operator.volumes
        shares = volumes / np.bincount(place, volumes)[place]
        means = np.zeros((len(cells), values.shape[1]))
        np.add.at(means, place, shares[:, None] * values)
        return cells, means

    def variable(self, name: str, state: BodyState) -> Any:
        """Return cell means of a scalar internal variable as a DOLFINx function (collective).

        The value is zero in cells whose law does not have the variable.
        """
        if name not in self.variables:
            raise ValueError(
                f"There is no scalar internal variable {name!r}; there are: "
                f"{', '.join(self.variables) or 'none'}."
            )
        values = np.zeros((len(self.operator.volumes), 1))
        for zone in self._zones:
            if name in zone.columns:
                values[zone.points, 0] = state.bulk.internal[zone.points, zone.columns[name]]
        field = fem.Function(fem.functionspace(self._mesh, ("DG", 0)), name=name)
        cells, means = self.cell_means(values)
        field.x.array[field.function_space.dofmap.list[cells, 0]] = means[:, 0]
        field.x.scatter_forward()
        return field


class BodyTangent:
    """Assembler of the tangent of joints and nonlinear cells; reuses the sparsity pattern."""

    def __init__(self, bulk: StrainTangent, joints: TangentMatrix | None) -> None:
        """Store the assemblers of both parts, None without joints."""
        self.comm, self._bulk, self._joints = bulk.comm, bulk, joints
        self.joints = None if joints is None else joints.joints
        self._sums: dict[bool, PETSc.Mat] = {}

    def assemble(self, tangent: Floats, *, coupled: bool = True) -> PETSc.Mat:
        """Return the matrix of the array from `NonlinearBulk.tangent`, [N/m] (collective)."""
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


def _no_joints() -> Response:
    none = np.zeros((0, 3))
    return Response(
        traction=none,
        tangent=np.zeros((0, 3, 3)),
        state=JointState.at_rest(none),
        dissipation=np.zeros(0),
        status=np.zeros(0, dtype=np.int8),
    )
