# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady-state response of a linear body and its water to a harmonic ground motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.body.places import extent, nearest_nodes
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import JointsError, MeshError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.common.parameters import check_kind_of, check_vector, shown
from dolfinx_joints.loads.load import Vector
from dolfinx_joints.loads.wave_levels import warn_of_sides
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.modal_damping import modal_damping
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.modes import closed_stiffness
from dolfinx_joints.model.modes import modes as lowest
from dolfinx_joints.model.system import MatrixSystem, as_aij
from dolfinx_joints.solvers.direct import DirectSolver

Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class FrequencyResponse:
    """Vibration u e^{i omega t} relative to the ground, per unit of ground acceleration.

    Attributes:
        frequencies: Frequencies omega / (2 pi), shape (n,), [Hz].
        direction: Unit vector of the ground acceleration, shape (gdim,).
        displacement: Complex amplitude u by name of the point, shape (n, gdim), [s^2].
        reservoir_force: Force of the waves in the water on the face, shape (n, gdim), [kg]; None
            without waves.
    """

    frequencies: Floats
    direction: Floats
    displacement: Mapping[str, Complex]
    reservoir_force: Complex | None = None

    def relative_acceleration(self, point: str) -> Complex:
        """Return the acceleration relative to the ground per ground acceleration, (n, gdim)."""
        omega = 2.0 * np.pi * self.frequencies
        return np.asarray(-(omega**2)[:, None] * self.displacement[point])

    def acceleration(self, point: str) -> Complex:
        """Return the absolute acceleration per ground acceleration, shape (n, gdim)."""
        return self.relative_acceleration(point) + self.direction


@checked
def frequency_response(
    model: Model,
    frequencies: Annotated[Sequence[float], at.MinLen(1), at.Gt(0), at.Unit("Hz")],
    *,
    points: Mapping[str, Sequence[float]],
    direction: Vector | None = None,
    hysteretic_ratio: Annotated[float, at.Ge(0), at.Lt(1)] = 0.0,
    modes: Annotated[int, at.Ge(1)] | None = None,
) -> FrequencyResponse:
    """Compute the response to a harmonic ground acceleration, all joints tied (collective).

    Equation (34c): (-omega^2 M + i omega C + (1 + 2 i zeta) K) u = -M iota, where iota is the unit
    motion along ``direction``. Waves of a `reservoir` add unknowns. Each frequency needs one
    factorization. Dashpots of joint laws are neglected.

    Args:
        model: The model; its loads are not used.
        frequencies: Frequencies [Hz].
        points: Points by name, evaluated at the nearest nodes, [m].
        direction: Direction of the ground acceleration, x by default.
        hysteretic_ratio: Damping ratio zeta of K with joints and springs, not of the water, at all
            frequencies. Time integration does not support hysteretic damping.
        modes: Number of lowest modes for modal superposition; by default solve directly.

    Raises:
        JointsError: Supports move, or ``modes`` is given with waves.
        MeshError: A point is far from the body.
    """
    vector = np.eye(model.gdim)[0] if direction is None else direction
    along = check_vector("direction", vector, (model.gdim,))
    if not np.any(along):
        raise ValueError("direction is zero; give a direction of the ground motion.")
    named = isinstance(points, Mapping)
    check_kind_of("points", points, named, "coordinates by name")
    system = model.system(only=())
    if system.values is not None:
        raise JointsError(
            "frequency_response moves the ground; supports must not move relative to the ground."
        )
    if modes is not None and model.coupled is not None:
        raise JointsError("modes= is not available for a reservoir with waves; omit modes=.")
    warn_of_sides(model)
    along = along / np.linalg.norm(along)
    hertz = np.array(frequencies, dtype=np.float64)
    omegas: Floats = 2.0 * np.pi * hertz
    reader = _Points(model, points)
    if modes is None:
        amplitudes, forces = _solve_directly(model, system, omegas, along, hysteretic_ratio, reader)
    else:
        amplitudes = _superpose(system, omegas, along, hysteretic_ratio, reader, modes)
        forces = None
    return FrequencyResponse(
        frequencies=hertz,
        direction=along,
        displacement={name: amplitudes[:, i] for i, name in enumerate(points)},
        reservoir_force=forces,
    )


def _superpose(
    system: MatrixSystem, omegas: Floats, along: Floats, zeta: float, reader: _Points, count: int
) -> Complex:
    """Return the displacements of the points by modal superposition, coupled by C (collective)."""
    lowest_modes = lowest(system, count)
    squares = (2.0 * np.pi * lowest_modes.frequencies) ** 2
    stiffness = np.diag((1.0 + 2j * zeta) * squares)
    damping = modal_damping(system, lowest_modes).matrix
    force = -lowest_modes.participation @ along
    shapes = np.array([reader.read(shape.array_r) for shape in lowest_modes.shapes])
    amplitudes = [
        np.linalg.solve(stiffness + 1j * w * damping - w**2 * np.eye(count), force) for w in omegas
    ]
    return np.einsum("nm,mpd->npd", amplitudes, shapes)


def _solve_directly(
    model: Model, dry: MatrixSystem, omegas: Floats, along: Floats, zeta: float, reader: _Points
) -> tuple[Complex, Complex | None]:
    """Return point displacements and water forces by direct solution (collective)."""
    coupled = model.coupled
    system = dry if coupled is None else coupled.system(dry, {}, 1.0)
    matrix = _DynamicStiffness(dry, system, coupled, zeta)
    force = model.joined(model.inertia_pattern(-along)).array_r.astype(complex)
    displacements, forces = [], []
    for omega in omegas:
        rhs = force.copy()
        if coupled is not None:
            rhs[coupled.dry :] = coupled.harmonic_force(omega, along)
        x = matrix.solve(omega, rhs)
        displacements.append(reader.read(x))
        if coupled is not None:
            rates = 1j * omega * x
            parts = [coupled.force(system.vector(part)) for part in (rates.real, rates.imag)]
            forces.append(parts[0] + 1j * parts[1])
    matrix.destroy()
    return np.array(displacements), np.array(forces) if forces else None


class _DynamicStiffness:
    """-omega^2 M + i omega C + K + 2 i zeta K_body as a real matrix of twice the size.

    The complex matrix A + i B becomes [[A, -B], [B, A]], applied to real and imaginary parts. The
    low-rank term of damped modes is included by the Woodbury formula, see `ChangedSolver`.
    """

    def __init__(self, dry: MatrixSystem, system: MatrixSystem, coupled: Any, zeta: float) -> None:
        """Assemble the parts that do not depend on the frequency (collective)."""
        body = closed_stiffness(dry.stiffness, dry.contact)
        lossy = body if coupled is None else coupled.matrix(body)
        stiffness = closed_stiffness(system.stiffness, system.contact)
        mass, damping = as_aij(system.mass), system.damping
        self._parts = [
            _pairs(stiffness, 2.0 * zeta * lossy if zeta else None),
            _pairs(None, damping),
            _pairs(mass, None),
        ]
        self._total = self._parts[0].copy()
        for part in self._parts[1:]:
            self._total.axpy(1.0, part, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        local = system.mass.getLocalSize()[0]
        fixed = np.append(system.constrained, local + system.constrained)
        self._rows = (fixed + self._total.getOwnershipRange()[0]).astype(PETSc.IntType)
        self._fixed, self._system = system.constrained, system
        self._solver = DirectSolver(self._total, symmetric=False, name="frequency")

    def solve(self, omega: float, rhs: Complex) -> Complex:
        """Solve for a right-hand side; both vectors contain the owned rows (collective)."""
        self._total.zeroEntries()
        for factor, part in zip((1.0, omega, -(omega**2)), self._parts, strict=True):
            self._total.axpy(factor, part, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._total.zeroRowsColumns(self._rows, diag=float(self._total.norm()) or 1.0)
        self._solver.refresh()
        rhs[self._fixed] = 0.0
        modes = self._system.damped_modes
        if modes is None:
            return self._block(rhs[:, None])[:, 0]
        columns = modes.columns(self._system.mass.createVecRight())
        solutions = self._block(np.column_stack([rhs, columns]))
        amounts = summed(self._system.mass.comm.tompi4py(), columns.T @ solutions)
        rates = 1j * omega * modes.rates
        small = np.eye(len(rates)) + amounts[:, 1:] * rates
        return solutions[:, 0] - solutions[:, 1:] @ (rates * np.linalg.solve(small, amounts[:, 0]))

    def _block(self, rhs: Complex) -> Complex:
        """Solve the sparse part for complex columns (collective)."""
        both = self._solver.solve_block(np.concatenate([rhs.real, rhs.imag]))
        real, imaginary = np.split(both, 2)
        return real + 1j * imaginary

    def destroy(self) -> None:
        """Free the matrices and the factor."""
        for item in (self._solver, self._total, *self._parts):
            item.destroy()


class _Points:
    """Reads vectors at the node nearest to each point, the first of several at one position."""

    def __init__(self, model: Model, points: Mapping[str, Sequence[float]]) -> None:
        """Find the nodes (collective)."""
        self._comm, self._gdim = model.jointed.mesh.comm, model.gdim
        numbers = NodeNumbering(model.V).number
        self._nodes: list[int | None] = []
        for name, point in points.items():
            place = [float(x) for x in check_vector(f"The point {shown(name)}", point, (2, 3))]
            distance, near = nearest_nodes(model.jointed, model.V, place)
            if not distance <= 0.1 * extent(model.V):
                raise MeshError(
                    f"The point {shown(name)} is {distance:.3g} m from the nearest node."
                )
            local = {int(numbers[node]): int(node) for node in near}
            first = min(number for part in self._comm.allgather(list(local)) for number in part)
            self._nodes.append(local.get(first))

    def read(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values at the points, shape (points, gdim), from owned rows (collective)."""
        at_points = np.zeros((len(self._nodes), self._gdim), dtype=values.dtype)
        for i, node in enumerate(self._nodes):
            if node is not None:
                at_points[i] = values[self._gdim * node : self._gdim * (node + 1)]
        return summed(self._comm, at_points)


def _pairs(real: PETSc.Mat | None, imaginary: PETSc.Mat | None) -> PETSc.Mat:
    """Return [[A, -B], [B, A]] for A + i B; A or B may be None, which is zero (collective)."""
    negative = None
    if imaginary is not None:
        negative = imaginary.copy()
        negative.scale(-1.0)
    comm = next(matrix.comm for matrix in (real, imaginary) if matrix is not None)
    return as_aij(PETSc.Mat().createNest([[real, negative], [imaginary, real]], comm=comm))
