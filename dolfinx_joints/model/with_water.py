# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coupled system of a body and the waves in its reservoir, unknowns [u; y] with y = phi / c.

    [M     ] [u'']   [C         -rho c Q] [u']   [K     ] [u]   [F                     ]
    [   M_w] [y''] + [rho c Q^T  C_w    ] [y'] + [   K_w] [y] = [rho c (n . v_ground)  ]    (12v)

phi is the velocity potential, rho and c are the water's density and sound speed, Q the coupling.
M and K are symmetric and positive semidefinite. The coupling is skew and does no work, so the time
schemes for a body apply. With negated water rows, a step's matrix is symmetric but indefinite.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_array, csr_array

from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.body.matrices import from_rows
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.loads.ground_motion import BaseMotion
from dolfinx_joints.loads.load import VaryingLoad
from dolfinx_joints.loads.water.far_field import FarField
from dolfinx_joints.loads.water.water import Water
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.model.system import MatrixSystem, as_aij


class BodyAndWater:
    """Order of the unknowns [u; y]: on each rank first the body's, then the water's.

    Attributes:
        water: The water.
        dry: Number of body unknowns on this rank.
        numbers: Numbers of this rank's water unknowns, in the order of ``water``.
        signs: 1 at the body's unknowns, -1 at the water's.
    """

    def __init__(self, body: PETSc.Vec, water: Water, gdim: int) -> None:
        """Split the water evenly among the ranks; ``body`` is a vector of the body (collective)."""
        self.water, self._comm = water, body.comm
        self._of_body = np.asarray(body.getOwnershipRanges(), dtype=np.int64)
        ranks = len(self._of_body) - 1
        self._of_water = np.linspace(0, water.size, ranks + 1).astype(np.int64)
        this_rank = slice(self._comm.rank, self._comm.rank + 2)
        self.dry = body.getLocalSize()
        self._body_rows, self._water_rows = self._of_body[this_rank], self._of_water[this_rank]
        self.numbers: Ints = np.arange(*self._water_rows)
        dofs = np.tile(np.eye(gdim), (water.coupling.shape[1] // gdim, 1))
        self._normals = water.coupling[water.face] @ dofs
        self.signs = self.joined(None, np.full(len(self.numbers), -1.0))
        self.signs.getArray()[: self.dry] = 1.0

    @property
    def _sizes(self) -> tuple[int, int]:
        """Number of unknowns of body and water on this rank, and on all ranks."""
        return self.dry + len(self.numbers), int(self._of_body[-1] + self._of_water[-1])

    def joined(self, body: PETSc.Vec | None, water: Floats | None = None) -> PETSc.Vec:
        """Return a vector of body and water; a part that is not given is zero (collective).

        ``water`` has this rank's unknowns. A ``body`` that already has both parts is returned.
        """
        if body is not None and self.has_water(body):
            return body
        both = PETSc.Vec().createMPI((self.dry + len(self.numbers), None), comm=self._comm)
        both.set(0.0)
        if body is not None:
            both.getArray()[: self.dry] = body.getArray(readonly=True)
        if water is not None:
            both.getArray()[self.dry :] = water
        return both

    def has_water(self, vector: PETSc.Vec) -> bool:
        """Return True if a vector has both body and water unknowns."""
        return bool(vector.getSize() != self._of_body[-1])

    def body(self, both: PETSc.Vec) -> PETSc.Vec:
        """Return the body's part of a vector of body and water (collective)."""
        body = PETSc.Vec().createMPI((self.dry, None), comm=self._comm)
        body.setArray(both.getArray(readonly=True)[: self.dry])
        return body

    def of_water(self, both: PETSc.Vec) -> Floats:
        """Return this rank's water unknowns."""
        return np.array(both.array_r[self.dry :])

    def pressure(self, velocity: PETSc.Vec) -> Floats:
        """Return pressures p = -rho c y' at the face's water nodes, shape (n,), [Pa] (collective).

        ``velocity`` is [u'; y'] [m/s]. The hydrostatic pressure is not included.
        """
        rates = np.zeros(len(self.water.face))
        local_numbers = self.water.face - self._water_rows[0]
        on_rank = (local_numbers >= 0) & (local_numbers < len(self.numbers))
        rates[on_rank] = velocity.getArray(readonly=True)[self.dry :][local_numbers[on_rank]]
        total = np.sum(self._comm.tompi4py().allgather(rates), axis=0)
        return np.asarray(-self.water.impedance * total)

    def pressures(self, velocity: PETSc.Vec) -> Floats:
        """Return the wave pressures at this rank's water unknowns, shape (n,), [Pa]."""
        return np.asarray(-self.water.impedance * self.of_water(velocity))

    def force(self, velocity: PETSc.Vec) -> Floats:
        """Return the wave force -(integral of p n) on the face, (gdim,), [N] (collective)."""
        return np.asarray(-self.pressure(velocity) @ self._normals)

    def harmonic_force(self, omega: float, along: Floats) -> NDArray[np.complex128]:
        """Return the forces on this rank's water in steady vibration [N].

        The ground acceleration ``along`` (gdim,) [m/s^2] has the circular frequency omega [rad/s].
        """
        water, velocity = self.water, np.asarray(along / (1j * omega), dtype=np.complex128)
        push = water.impedance * (water.driven @ velocity)
        if water.section is not None:
            push = push + water.section.harmonic_force(omega, velocity)
        return np.asarray(push[self.numbers])

    def energy(self, one: PETSc.Vec, other: PETSc.Vec) -> float:
        """Return half the dot product of the water parts of two vectors (collective)."""
        part = one.getArray(readonly=True)[self.dry :] @ other.getArray(readonly=True)[self.dry :]
        return 0.5 * float(np.sum(self._comm.tompi4py().allgather(float(part))))

    def system(self, dry: MatrixSystem, loads: Mapping[str, Any], step: float) -> MatrixSystem:
        """Return the coupled system for a time step [s] (collective).

        ``loads`` are the body's loads by name. A `BaseMotion` also moves the water's boundaries.

        Raises:
            JointsError: The body has nonlinear cells.
        """
        if dry.bulk is not None:
            raise JointsError(
                "Reservoir waves need a linear body, but this body has nonlinear cells. Use an "
                "added mass instead."
            )
        patterns = [(self.joined(vector), factor) for vector, factor in dry.patterns]
        names = list(dry.load_names)
        driven = self.water.impedance * self.water.driven[self.numbers]
        gdim, velocities = driven.shape[1], []
        for name, load in loads.items():
            if isinstance(load, BaseMotion):
                velocities.append(load.velocities(gdim))
                for axis, velocity in enumerate(velocities[-1]):
                    patterns.append((self.joined(None, driven[:, axis]), velocity))
                    names.append(name)
        section = self.water.section
        far_field: list[VaryingLoad] = []
        if section is not None and velocities:
            force = FarField(section, velocities, step).force
            rows = slice(self.dry, None)
            far_field.append(
                VaryingLoad("FarField_reservoir", rows, lambda time: force(time)[self.numbers])
            )
        water = self.water.rows(*(int(n) for n in self._water_rows))
        return replace(
            dry,
            mass=self.matrix(dry.mass, water.mass),
            stiffness=self.matrix(dry.stiffness, water.stiffness),
            rayleigh=Rayleigh(),  # the dashpots include the body's
            dashpots=self.matrix(dry.damping, water.losses, coupled=True),
            absorption=self.matrix(dry.absorption, water.losses),
            contact=None if dry.contact is None else self._contact(dry.contact),
            patterns=patterns,
            load_names=names,
            varying_loads=far_field,
            coupled=self,
        )

    def matrix(
        self, body: PETSc.Mat | None, water: csr_array | None = None, *, coupled: bool = False
    ) -> PETSc.Mat:
        """Return a matrix of body and water from their rows on this rank (collective)."""
        own = coo_array((len(self.numbers), self.water.size)) if water is None else water.tocoo()
        parts = [(self.dry + own.row, self._water_columns(own.col), own.data)]
        if body is not None:
            starts, columns, values = _csr(body)
            lines = np.repeat(np.arange(self.dry), np.diff(starts))
            parts.append((lines, self._body_columns(columns), values))
        if coupled:
            forces = (self.water.impedance * self.water.coupling).tocoo()
            rows, dofs, values = forces.row, forces.col, forces.data
            at_body, at_water = (
                (numbers >= first) & (numbers < last)
                for numbers, (first, last) in ((dofs, self._body_rows), (rows, self._water_rows))
            )
            lines = dofs[at_body] - self._body_rows[0]
            parts.append((lines, self._water_columns(rows[at_body]), -values[at_body]))
            lines = self.dry + rows[at_water] - self._water_rows[0]
            parts.append((lines, self._body_columns(dofs[at_water]), values[at_water]))
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        local, total = self._sizes
        both = csr_array(coo_array((values, (rows, columns)), shape=(local, total)))
        both.sort_indices()
        return from_rows([self._sizes] * 2, (both.indptr, both.indices, both.data), self._comm)

    def _contact(self, contact: Contact) -> Contact:
        """Return the joints with B extended to the water unknowns (collective)."""
        dry = contact.operator
        starts, columns, values = _csr(dry.matrix)
        shape = (len(starts) - 1, self._sizes[1])
        lines = csr_array((values, self._body_columns(columns), starts), shape=shape)
        lines.sort_indices()
        sizes = (dry.matrix.getSizes()[0], self._sizes)
        matrix = from_rows(sizes, (lines.indptr, lines.indices, lines.data), self._comm)
        operator = GapOperator(matrix, dry.areas, dry.joint, dry.names)
        operator.initial_gap, operator.points = dry.initial_gap, dry.points
        operator.sizes = dry.sizes
        return contact.with_operator(operator)

    def _body_columns(self, dofs: Ints) -> Ints:
        """Return the column numbers of body dofs in the coupled system."""
        rank = np.searchsorted(self._of_body, dofs, side="right") - 1
        return np.asarray(dofs + self._of_water[rank])

    def _water_columns(self, numbers: Ints) -> Ints:
        """Return the column numbers of water unknowns in the coupled system."""
        rank = np.searchsorted(self._of_water, numbers, side="right") - 1
        return np.asarray(numbers + self._of_body[rank + 1])


def _csr(matrix: PETSc.Mat) -> tuple[Ints, Ints, Floats]:
    """Return this rank's rows of a matrix: starts, columns, values."""
    plain = as_aij(matrix)
    starts, columns, values = plain.getValuesCSR()
    plain.destroy()
    return starts, columns, values
