# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors, values at points and resultants of a body that moves in few shapes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.time_integration.states import DynamicState

if TYPE_CHECKING:
    from dolfinx_joints.solvers.reduced.basis import ReducedBasis

Floats = NDArray[np.float64]


class Points(Protocol):
    """Points of the body whose displacements are read."""

    def units(self, local: int) -> Floats:
        """A unit vector for each component of each, owned rows, shape (local, 3 points)."""


class BodyValues:
    """What linear functions of the body's vectors are in coordinates, kept by what asks.

    Args:
        basis: The basis.
        system: The system.
        factors: Of M and K in the matrix of the steps.
    """

    def __init__(
        self, basis: ReducedBasis, system: MatrixSystem, factors: tuple[float, float]
    ) -> None:
        """Nothing is asked for yet."""
        self.basis, self.system, self.factors = basis, system, factors
        self._kept: dict[Any, tuple[int, list[Floats]]] = {}

    def of_points(self, points: Points) -> Floats:
        """Components of the displacements of points, shape (3 points, size) (collective)."""
        return self._known(points, lambda: [self.basis.images(points.units(self._local)).T])[0]

    def of_group(self, name: str, nodes: NDArray[np.int64]) -> tuple[Floats, ...]:
        """Sums over the constrained dofs of nodes, component by component (collective).

        Of M V and K V, shape (components, size), of B^T, shape (components, 3 points of all
        ranks), and of the patterns of the loads, shape (components, patterns).
        """
        return tuple(self._known(name, lambda: self._sums(nodes)))

    def _sums(self, nodes: NDArray[np.int64]) -> list[Floats]:
        system, count = self.system, self.system.components
        held = np.zeros(self._local)
        held[system.constrained] = 1.0
        chosen = np.zeros((self._local // count, count, count))
        chosen[nodes] = np.eye(count)
        columns = chosen.reshape(-1, count) * held[:, None]
        vectors = [self.basis.body.vector(column) for column in columns.T]
        weighted, pulled = (
            self.basis.images(np.column_stack([(matrix * v).array_r for v in vectors])).T
            for matrix in (system.mass, system.stiffness)
        )
        assert system.contact is not None
        comm, jump = self.basis.body.comm, system.contact.operator.matrix
        gaps = np.array([np.concatenate(comm.allgather((jump * v).array_r)) for v in vectors])
        loads = np.array([[v.dot(pattern) for pattern, _ in system.patterns] for v in vectors])
        return [weighted, pulled, gaps, loads]

    def _known(self, key: Any, make: Callable[[], list[Floats]]) -> list[Floats]:
        size = self.basis.size
        if key not in self._kept or self._kept[key][0] != size:
            self._kept[key] = size, make()
        return self._kept[key][1]

    @property
    def _local(self) -> int:
        return int(self.system.mass.getLocalSize()[0])


class Expanded:
    """Vectors and values of the body after a step in coordinates, made when they are asked for.

    To be asked before the next step; vectors cost a back-substitution.

    Args:
        values: Linear functions of the body's vectors.
        before: State of coordinates before the step.
        state: That after it.
    """

    def __init__(self, values: BodyValues, before: DynamicState, state: DynamicState) -> None:
        """Keep the states."""
        self._values, self._before, self._state = values, before, state

    @cached_property
    def _both(self) -> list[PETSc.Vec]:
        return self._expanded(self._state.displacement, self._state.velocity)

    @property
    def displacement(self) -> PETSc.Vec:
        """Displacements u [m] (collective)."""
        return self._both[0]

    @property
    def velocity(self) -> PETSc.Vec:
        """Velocities v [m/s] (collective)."""
        return self._both[1]

    @property
    def acceleration(self) -> PETSc.Vec:
        """Accelerations a [m/s^2] (collective)."""
        return self._expanded(self._state.acceleration)[0]

    @cached_property
    def reaction(self) -> PETSc.Vec:
        """Mean forces of the supports over the step, zero at other dofs [N] (collective)."""
        system, before, after = self._values.system, self._before, self._state
        parts = self._values.basis.expand(np.column_stack(self._moved))
        force, work = parts[0].duplicate(), parts[0].duplicate()
        assert system.contact is not None
        assert after.joints is not None
        system.contact.operator.force(after.joints.traction, force)
        for matrix, part in zip((system.mass, system.stiffness), parts, strict=True):
            matrix.mult(part, work)
            force.axpy(1.0, work)
        for time in (before.time, after.time):
            force.axpy(-0.5, system.load(time, work))
        there = np.zeros(force.getLocalSize())
        there[system.constrained] = force.array_r[system.constrained]
        force.setArray(there)
        return force

    def read(self, points: Points) -> tuple[Floats, Floats]:
        """Displacements and velocities of points, shape (points, 3) each (collective)."""
        rows = self._values.of_points(points)
        u, v = self._state.displacement, self._state.velocity
        found = (rows @ self._values.basis.whole(each) for each in (u, v))
        u_there, v_there = (each.reshape(-1, 3) for each in found)
        return u_there, v_there

    def resultant(self, name: str, nodes: NDArray[np.int64]) -> Floats:
        """Sum of the reactions over the rank's nodes of a group and those of others (collective).

        Shape (components,), [N].
        """
        weighted, pulled, gaps, loads = self._values.of_group(name, nodes)
        system, joints = self._values.system, self._state.joints
        assert system.contact is not None
        assert joints is not None
        operator = system.contact.operator
        forces = (operator.areas[:, None] * joints.traction).ravel()
        every = np.concatenate(operator.comm.allgather(forces))
        inertia, stretch = self._moved
        found: Floats = weighted @ inertia + pulled @ stretch + gaps @ every
        return found - loads @ system.mean_factors(self._before.time, self._state.time)

    @property
    def _moved(self) -> tuple[Floats, Floats]:
        """Coordinates that M and K are multiplied with in the step's equation."""
        (of_mass, of_stiffness), whole = self._values.factors, self._values.basis.whole
        start = whole(self._before.displacement)
        x = whole(self._state.displacement) - start
        inertia = of_mass * x - self._state.rate * whole(self._before.velocity)
        return inertia, of_stiffness * x + start

    def _expanded(self, *vectors: PETSc.Vec) -> list[PETSc.Vec]:
        basis = self._values.basis
        return basis.expand(np.column_stack([basis.whole(each) for each in vectors]))
