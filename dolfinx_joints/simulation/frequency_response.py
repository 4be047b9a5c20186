# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steady vibration of a linear body and its water under a harmonic motion of the ground."""

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
    """Vibration u e^{i omega t} relative to the ground, per unit of its acceleration.

    Attributes:
        frequencies: [Hz], shape (n,).
        direction: Acceleration of the ground along each axis, of length 1, shape (gdim,).
        displacement: By name of the point, shape (n, gdim), [s^2].
        reservoir_force: Force of the waves in the water on the face, shape (n, gdim), [kg]; None
            without any.
    """

    frequencies: Floats
    direction: Floats
    displacement: Mapping[str, Complex]
    reservoir_force: Complex | None = None

    def relative_acceleration(self, point: str) -> Complex:
        """Acceleration relative to the ground over that of the ground, shape (n, gdim)."""
        omega = 2.0 * np.pi * self.frequencies
        return np.asarray(-(omega**2)[:, None] * self.displacement[point])

    def acceleration(self, point: str) -> Complex:
        """Acceleration in space over that of the ground, shape (n, gdim)."""
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
    """Answer to a harmonic acceleration of the ground, all joints closed and sticking (collective).

    (-omega^2 M + i omega C + (1 + 2 i zeta) K) u = -M iota, (34c), with the waves of a `reservoir`
    among the unknowns; each frequency is one factorisation. Dashpots of joint laws are left out.

    Args:
        model: The model; its loads have no part in it.
        frequencies: [Hz].
        points: Places whose nearest nodes are reported, by name, [m].
        direction: Of the acceleration of the ground, along x unless given.
        hysteretic_ratio: zeta of K, joints and springs included, at all frequencies; water has
            none. There is no such damping in time.
        modes: Sum up so many of the lowest modes of a body without waves, instead of solving.

    Raises:
        JointsError: Supports move, or modes are asked for with waves.
        MeshError: A point is far from the body.
    """
    wanted = np.eye(model.gdim)[0] if direction is None else direction
    along = check_vector("direction", wanted, (model.gdim,))
    if not np.any(along):
        raise ValueError("direction is zero; the ground must move along some axis.")
    named = isinstance(points, Mapping)
    check_kind_of("points", points, named, "coordinates by name")
    system = model.system(only=())
    if system.values is not None:
        raise JointsError("frequency_response moves the ground; supports must not move on it.")
    if modes is not None and model.coupled is not None:
        raise JointsError("modes are those of a body; one with waves in its water is solved for.")
    warn_of_sides(model)
    along = along / np.linalg.norm(along)
    hertz = np.array(frequencies, dtype=np.float64)
    omegas: Floats = 2.0 * np.pi * hertz
    reader = _Points(model, points)
    if modes is None:
        found, forces = _solved(model, system, omegas, along, hysteretic_ratio, reader)
    else:
        found = _summed(system, omegas, along, hysteretic_ratio, reader, modes)
        forces = None
    return FrequencyResponse(
        frequencies=hertz,
        direction=along,
        displacement={name: found[:, i] for i, name in enumerate(points)},
        reservoir_force=forces,
    )


def _summed(
    system: MatrixSystem, omegas: Floats, along: Floats, zeta: float, reader: _Points, count: int
) -> Complex:
    """Displacements of the points as sums over modes, coupled by C (collective)."""
    found = lowest(system, count)
    own = (2.0 * np.pi * found.frequencies) ** 2
    of_stiffness = np.diag((1.0 + 2j * zeta) * own)
    damping = modal_damping(system, found).matrix
    push = -found.participation @ along
    shapes = np.array([reader.read(shape.array_r) for shape in found.shapes])
    amounts = [
        np.linalg.solve(of_stiffness + 1j * w * damping - w**2 * np.eye(count), push)
        for w in omegas
    ]
    return np.einsum("nm,mpd->npd", amounts, shapes)


def _solved(
    model: Model, dry: MatrixSystem, omegas: Floats, along: Floats, zeta: float, reader: _Points
) -> tuple[Complex, Complex | None]:
    """Displacements of the points and forces of the water by direct solution (collective)."""
    coupled = model.coupled
    system = dry if coupled is None else coupled.system(dry, {}, 1.0)
    matrix = _DynamicStiffness(dry, system, coupled, zeta)
    push = model.joined(model.inertia_pattern(-along)).array_r.astype(complex)
    found, forces = [], []
    for omega in omegas:
        right = push.copy()
        if coupled is not None:
            right[coupled.dry :] = coupled.harmonic_push(omega, along)
        x = matrix.solve(omega, right)
        found.append(reader.read(x))
        if coupled is not None:
            rates = 1j * omega * x
            parts = [coupled.force(system.vector(part)) for part in (rates.real, rates.imag)]
            forces.append(parts[0] + 1j * parts[1])
    matrix.destroy()
    return np.array(found), np.array(forces) if forces else None


class _DynamicStiffness:
    """-omega^2 M + i omega C + K + 2 i zeta K_body as a real matrix of twice as many unknowns.

    A complex matrix A + i B is [[A, -B], [B, A]] for real and imaginary parts. What damped modes
    add to it, of low rank, is taken by Woodbury's formula, see `ChangedSolver`.
    """

    def __init__(self, dry: MatrixSystem, system: MatrixSystem, coupled: Any, zeta: float) -> None:
        """Add up what does not depend on the frequency (collective)."""
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

    def solve(self, omega: float, right: Complex) -> Complex:
        """Owned rows of the solution for those of the right-hand side (collective)."""
        self._total.zeroEntries()
        for factor, part in zip((1.0, omega, -(omega**2)), self._parts, strict=True):
            self._total.axpy(factor, part, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._total.zeroRowsColumns(self._rows, diag=float(self._total.norm()) or 1.0)
        self._solver.refresh()
        right[self._fixed] = 0.0
        modes = self._system.damped_modes
        if modes is None:
            return self._block(right[:, None])[:, 0]
        columns = modes.columns(self._system.mass.createVecRight())
        found = self._block(np.column_stack([right, columns]))
        amounts = summed(self._system.mass.comm.tompi4py(), columns.T @ found)
        rates = 1j * omega * modes.rates
        small = np.eye(len(rates)) + amounts[:, 1:] * rates
        return found[:, 0] - found[:, 1:] @ (rates * np.linalg.solve(small, amounts[:, 0]))

    def _block(self, right: Complex) -> Complex:
        """Solutions of the sparse part for complex columns (collective)."""
        both = self._solver.solve_block(np.concatenate([right.real, right.imag]))
        real, imaginary = np.split(both, 2)
        return real + 1j * imaginary

    def destroy(self) -> None:
        """Free matrices and factor."""
        for each in (self._solver, self._total, *self._parts):
            each.destroy()


class _Points:
    """Reads vectors of the body at the nodes nearest to points, the first of several."""

    def __init__(self, model: Model, points: Mapping[str, Sequence[float]]) -> None:
        """Find the nodes (collective)."""
        self._comm, self._gdim = model.jointed.mesh.comm, model.gdim
        numbers = NodeNumbering(model.V).number
        self._nodes: list[int | None] = []
        for name, given in points.items():
            place = [float(x) for x in check_vector(f"The point {shown(name)}", given, (2, 3))]
            distance, near = nearest_nodes(model.jointed, model.V, place)
            if not distance <= 0.1 * extent(model.V):
                raise MeshError(
                    f"The point {shown(name)} lies {distance:.3g} m from the nearest node."
                )
            here = {int(numbers[node]): int(node) for node in near}
            first = min(number for each in self._comm.allgather(list(here)) for number in each)
            self._nodes.append(here.get(first))

    def read(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of the points, shape (points, gdim), from owned rows (collective)."""
        found = np.zeros((len(self._nodes), self._gdim), dtype=values.dtype)
        for i, node in enumerate(self._nodes):
            if node is not None:
                found[i] = values[self._gdim * node : self._gdim * (node + 1)]
        return summed(self._comm, found)


def _pairs(real: PETSc.Mat | None, imaginary: PETSc.Mat | None) -> PETSc.Mat:
    """[[A, -B], [B, A]] of A + i B, one of which may be missing (collective)."""
    negative = None
    if imaginary is not None:
        negative = imaginary.copy()
        negative.scale(-1.0)
    comm = next(each.comm for each in (real, imaginary) if each is not None)
    return as_aij(PETSc.Mat().createNest([[real, negative], [imaginary, real]], comm=comm))
