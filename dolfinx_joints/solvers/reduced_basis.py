# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A body that moves in few shapes: responses to every joint force, modes, and what steps add.

With A = m M + k K of one length of step, Z = A^-1 B^T and shapes Phi, the displacement is

    u = V y,   V = [Z, Phi] L^-T,   L L^T = [Z, Phi]^T A [Z, Phi],   V^T A V = 1.               (1)

The joints' compliance B V V^T B^T = B A^-1 B^T is that of the whole body. Z is not kept: a product
with it is a back-substitution, and [Z, Phi]^T A u = [B u, Phi^T A u]. A step

    A x + B^T f = F - K u0 + r M v0

of V y_u and V y_v has, as A = m M + k K and f responds within V, the error

    e = P A^-1 (M V s + F),   s = r y_v + (m/k) y_u,   P = 1 - V V^T A,                         (2)

so that e . A e is a quadratic form of s and the factors of F, of the size of y.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import LinAlgError, cholesky, eigh, solve_triangular

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.progress import Progress
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.model.system import MatrixSystem, as_aij
from dolfinx_joints.solvers.direct import BLOCK, DirectSolver
from dolfinx_joints.solvers.interface.compliance import Compliance
from dolfinx_joints.solvers.interface.condensed import Condensed

Floats = NDArray[np.float64]

# Part of a shape's energy below which the others hold it: of those that a basis begins with, and
# of what steps add, but for rounding.
INDEPENDENT, HELD = 1e-8, 1e-12


class ReducedBasis:
    """V with all that steps in it need.

    Args:
        system: The system, with joints, without moving supports and dashpots.
        condensed: The bulk with the coefficients of the steps.
        coefficients: m and k.
        shapes: Phi, owned rows, shape (local dofs, k). Responses to the loads are added.

    Attributes:
        size: Number of shapes.
        mass: V^T M V, shape (size, size), on every rank as all that follows.
        loads: V^T times the patterns of the loads, shape (size, patterns).

    Raises:
        JointsError: The bulk is not factored, or gaps of joint points depend on each other.
    """

    def __init__(
        self,
        system: MatrixSystem,
        condensed: Condensed,
        coefficients: tuple[float, float],
        shapes: Floats,
    ) -> None:
        """Solve for unit forces and shapes (collective)."""
        self._system, self._bulk, self._condensed = system, condensed.matrix, condensed
        self._m, self._k = coefficients
        if not isinstance(self._bulk.solver, DirectSolver):
            raise JointsError(
                "reduced needs a factor of the body, for which there is not memory enough; run "
                "without it."
            )
        self._fixed, self._inertia = system.constrained, as_aij(system.mass)
        self.comm: Any = system.mass.comm.tompi4py()
        assert system.contact is not None
        self._jump = system.contact.operator.matrix
        self._pushed = self._jump.transpose(PETSc.Mat())
        forces = _unit_forces(condensed.compliance)
        self._live = np.flatnonzero(forces.diagonal() > 0.0)
        self._root = _root(forces[np.ix_(self._live, self._live)])
        vectors = [vector.array_r for vector, _ in system.patterns]
        loads = np.column_stack(vectors) if vectors else np.zeros((len(shapes), 0))
        self._nodal = self._unconstrained(loads)
        self._responses = self._solved(self._nodal)
        self._begin(np.hstack([shapes, self._responses]))

    @property
    def size(self) -> int:
        """Number of shapes."""
        return len(self._lower)

    # ------------------------------------------------------------ vectors

    def coordinates(self, u: PETSc.Vec) -> Floats:
        """V^T A u, y of a u in the basis, shape (size,) (collective)."""
        image = u.duplicate()
        self._bulk.multiply(u, image)
        return self._seen(self._gaps(u.array_r[:, None]), image.array_r[:, None])[:, 0]

    def expand(self, coordinates: Floats) -> list[PETSc.Vec]:
        """V y of columns of y, shape (size, k) (collective)."""
        raw = solve_triangular(self._lower, coordinates, lower=True, trans=1)
        rows = self._solved(self._of_forces(raw[: len(self._live)]))
        rows += self._shapes @ raw[len(self._live) :]
        return [self.vector(row) for row in rows.T]

    def images(self, forces: Floats) -> Floats:
        """V^T of nodal forces, owned rows of columns, shape (size, k) (collective)."""
        forces = self._unconstrained(forces.copy())
        return self._seen(self._gaps(self._solved(forces)), forces)

    def vector(self, rows: Floats) -> PETSc.Vec:
        """A vector of the body from the rank's rows."""
        vector = self._system.mass.createVecRight()
        vector.setArray(rows)
        return vector

    def missed(self, x: PETSc.Vec) -> float:
        """Energy of what the basis has not of a displacement, x . A x - |V^T A x|^2 [J]."""
        image = x.duplicate()
        self._bulk.multiply(x, image)
        seen = self.coordinates(x)
        return max(float(x.dot(image)) - float(seen @ seen), 0.0)

    # ------------------------------------------------------------ steps

    def error(self, inertia: Floats, loads: Floats) -> float:
        """Energy e . A e of the error of a step, (2) [J].

        Args:
            inertia: s, shape (size,).
            loads: Factors of the patterns.
        """
        squared = inertia @ (self._missed @ inertia) + loads @ (self._missed_loads @ loads)
        return max(float(squared + 2.0 * inertia @ (self._missed_mixed @ loads)), 0.0)

    @property
    def stiffness(self) -> Floats:
        """V^T K V, shape (size, size)."""
        found: Floats = self.mass * (-self._m / self._k)
        found[np.diag_indices(self.size)] += 1.0 / self._k
        return found

    def system(self) -> MatrixSystem:
        """The system of y: its M, K and C, loads, and joints with the same points (collective)."""
        system, full = self._system, self._system.contact
        assert full is not None
        given, mass = full.operator, self._square(self.mass)
        operator = GapOperator(self._gap_matrix(), given.areas, given.joint, given.names)
        return replace(
            system,
            mass=mass,
            stiffness=self._square(self.stiffness),
            contact=full.on(operator),
            patterns=[
                (self.coordinate_vector(self.loads[:, i]), factor)
                for i, (_, factor) in enumerate(system.patterns)
            ],
            constrained=np.empty(0, dtype=np.int64),
            components=1,
            shared=_Known(self._condensed),
        )

    def coordinate_vector(self, whole: Floats) -> PETSc.Vec:
        """A vector of coordinates that every rank has as a whole (collective)."""
        vector = PETSc.Vec().createMPI((PETSc.DECIDE, self.size), comm=self._system.mass.comm)
        vector.setArray(whole[slice(*vector.getOwnershipRange())])
        return vector

    def whole(self, vector: PETSc.Vec) -> Floats:
        """Coordinates on every rank, with zeros for what the basis has grown by (collective)."""
        every = np.concatenate(self.comm.allgather(vector.array_r))
        return np.append(every, np.zeros(self.size - len(every)))

    def _square(self, whole: Floats) -> PETSc.Mat:
        """A matrix of coordinates (collective)."""
        rows = slice(*self.coordinate_vector(whole[:, 0]).getOwnershipRange())
        size, comm = (PETSc.DECIDE, self.size), self._system.mass.comm
        part = np.asfortranarray(whole[rows])
        matrix = PETSc.Mat().createDense((size, size), array=part, comm=comm)
        matrix.assemble()
        return matrix

    def _gap_matrix(self) -> PETSc.Mat:
        """B V = [root of the compliance, 0] (collective)."""
        first, last = self._jump.getOwnershipRange()
        here = np.flatnonzero((self._live >= first) & (self._live < last))
        counts = np.zeros(last - first + 1, dtype=PETSc.IntType)
        counts[self._live[here] - first + 1] = here + 1
        columns = [np.arange(i + 1) for i in here] or [np.empty(0)]
        values = [self._root[i, : i + 1] for i in here] or [np.empty(0)]
        matrix = PETSc.Mat().createAIJ(
            ((last - first, None), (PETSc.DECIDE, self.size)),
            csr=(
                np.cumsum(counts, dtype=PETSc.IntType),
                np.concatenate(columns).astype(PETSc.IntType),
                np.concatenate(values),
            ),
            comm=self._system.mass.comm,
        )
        matrix.assemble()
        return matrix

    # ------------------------------------------------------------ basis

    def _begin(self, shapes: Floats) -> None:
        """Choose independent shapes, and multiply (collective)."""
        energies, gaps = self._beside(shapes)
        scale = (energies.diagonal() + np.sum(gaps**2, axis=0)) ** -0.5
        squares, turn = eigh(scale[:, None] * energies * scale)
        there = squares > INDEPENDENT
        self._shapes = np.asfortranarray(
            shapes @ (scale[:, None] * turn[:, there] / np.sqrt(squares[there]))
        )
        energies, gaps = self._beside(self._shapes)
        points, count = len(self._live), self._shapes.shape[1]
        self._lower = np.zeros((points + count, points + count))
        self._lower[:points, :points] = self._root
        self._lower[points:, :points] = gaps.T
        self._lower[points:, points:] = cholesky(energies, lower=True)
        raw_mass, raw_twice = np.empty((2, points + count, points + count))
        for first in range(0, count, BLOCK):
            part = slice(first, min(first + BLOCK, count))
            here = slice(points + part.start, points + part.stop)
            raw_mass[:, here], raw_twice[:, here] = self._products(self._shapes[:, part])
        progress = Progress("responses to joint forces", points, "columns", self.comm.rank)
        for first in range(0, points, BLOCK):
            here = slice(first, min(first + BLOCK, points))
            unit = np.zeros((points, here.stop - here.start))
            unit[here] = np.eye(here.stop - here.start)
            responses = self._solved(self._of_forces(unit))
            raw_mass[:, here], raw_twice[:, here] = self._products(responses)
            progress.advance(here.stop - here.start)
        progress.finish()
        self.mass = self._in_basis(raw_mass)
        self.loads = self._seen(self._gaps(self._responses), self._nodal)
        self._missed = self._in_basis(raw_twice) - self.mass @ self.mass
        weighted = self._multiplied(self._inertia, self._responses)
        self._missed_mixed = self.images(weighted) - self.mass @ self.loads
        self._missed_loads = self._sum(self._nodal.T @ self._responses)
        self._missed_loads -= self.loads.T @ self.loads

    def _beside(self, shapes: Floats) -> tuple[Floats, Floats]:
        """Shapes' energies beside responses to joint forces, and amounts of these (collective)."""
        gaps = solve_triangular(self._root, self._gaps(shapes), lower=True)
        energies = self._sum(shapes.T @ self._multiplied(self._bulk.full, shapes))
        return energies - gaps.T @ gaps, gaps

    def add(self, x: PETSc.Vec) -> None:
        """Take in a displacement; coordinates stay and are followed by one more (collective)."""
        shape, image = x, x.duplicate()
        self._bulk.multiply(x, image)
        largest = float(x.dot(image))
        for _ in range(2):  # once more for what rounding leaves along the basis
            (held,) = self.expand(self.coordinates(shape)[:, None])
            shape = shape.copy()
            shape.axpy(-1.0, held)
            self._bulk.multiply(shape, image)
            energy = float(shape.dot(image))
            if energy <= HELD * largest:
                return
        shape.scale(energy**-0.5)
        row = self.coordinates(shape)
        column = shape.array_r[:, None]
        self._shapes = np.asfortranarray(np.hstack([self._shapes, column]))
        size = self.size
        lower = np.zeros((size + 1, size + 1))
        lower[:size, :size] = self._lower
        lower[size, :size], lower[size, size] = row, np.sqrt(1.0 - row @ row)
        self._lower = lower
        raw_mass, raw_twice = self._products(column)
        mass, twice = (
            solve_triangular(lower, raw[:, 0], lower=True) for raw in (raw_mass, raw_twice)
        )
        self.mass = _bordered(self.mass, mass)
        pattern = self._sum(self._nodal.T @ column)[:, 0]
        self._missed -= np.outer(mass[:size], mass[:size])
        self._missed = _bordered(self._missed, twice - self.mass @ mass)
        self.loads = np.vstack([self.loads, pattern])
        mixed = self._sum(self._multiplied(self._inertia, column).T @ self._responses)[0]
        self._missed_mixed -= np.outer(mass[:size], pattern)
        self._missed_mixed = np.vstack([self._missed_mixed, mixed - mass @ self.loads])
        self._missed_loads -= np.outer(pattern, pattern)

    def _products(self, columns: Floats) -> tuple[Floats, Floats]:
        """[Z, Phi]^T M and [Z, Phi]^T M A^-1 M of columns (collective)."""
        found = []
        for _ in range(2):
            weighted = self._unconstrained(self._multiplied(self._inertia, columns))
            columns = self._solved(weighted)
            found.append(np.vstack([self._gaps(columns), self._sum(self._shapes.T @ weighted)]))
        return found[0], found[1]

    def _in_basis(self, raw: Floats) -> Floats:
        """L^-1 of a symmetric matrix L^-T."""
        half = solve_triangular(self._lower, raw, lower=True, overwrite_b=True)
        whole = solve_triangular(self._lower, half.T, lower=True)
        found: Floats = 0.5 * (whole + whole.T)
        return found

    def _seen(self, gaps: Floats, forces: Floats) -> Floats:
        """V^T of nodal forces with the gaps that they cause (collective)."""
        raw = np.vstack([gaps, self._sum(self._shapes.T @ forces)])
        seen: Floats = solve_triangular(self._lower, raw, lower=True)
        return seen

    # ------------------------------------------------------------ parts

    def _gaps(self, columns: Floats) -> Floats:
        """Gaps of all points that can move (collective)."""
        mine = self._multiplied(self._jump, columns)
        every = mine if self.comm.size == 1 else np.concatenate(self.comm.allgather(mine))
        found: Floats = every[self._live]
        return found

    def _of_forces(self, forces: Floats) -> Floats:
        """Nodal forces of joint forces of all points that can move (collective)."""
        every = np.zeros((self._jump.getSize()[0], forces.shape[1]))
        every[self._live] = forces
        rows = every[slice(*self._jump.getOwnershipRange())]
        return self._unconstrained(self._multiplied(self._pushed, rows))

    def _multiplied(self, matrix: PETSc.Mat, columns: Floats) -> Floats:
        """A matrix times owned rows of columns (collective)."""
        size = (matrix.getSizes()[1], (PETSc.DECIDE, columns.shape[1]))
        if not columns.shape[1]:
            return np.zeros((matrix.getLocalSize()[0], 0))
        dense = PETSc.Mat().createDense(size, array=np.asfortranarray(columns), comm=matrix.comm)
        product = matrix.matMult(dense)
        found: Floats = product.getDenseArray(readonly=True).copy()
        product.destroy()
        dense.destroy()
        return found

    def _solved(self, right: Floats) -> Floats:
        """A^-1 of columns (collective)."""
        found = np.empty_like(right, order="F")
        for first in range(0, right.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            found[:, part] = self._bulk.solve_block(right[:, part])
        return self._unconstrained(found)

    def _unconstrained(self, columns: Floats) -> Floats:
        """The columns, made zero at constrained dofs."""
        columns = columns if columns.flags.writeable else columns.copy()
        columns[self._fixed] = 0.0
        return columns

    def _sum(self, parts: Floats) -> Floats:
        """Sum over the ranks, the same on each (collective)."""
        return parts if self.comm.size == 1 else np.sum(self.comm.allgather(parts), axis=0)


class _Known:
    """In the place of a `SharedBulk`: A is 1, and the joints' compliance that of the whole body."""

    rounds = None

    def __init__(self, condensed: Condensed) -> None:
        """Keep what is known."""
        self._condensed = condensed
        self.lowest_modes: dict[int, Any] = {}

    def matrix(self, key: Hashable, make: Callable[[], Any]) -> _Identity:
        """A in the basis."""
        return _Identity()

    def compliance(self, key: Hashable, make: Callable[[], Compliance]) -> Compliance:
        """That of the whole body."""
        return self._condensed.compliance


class _Identity:
    """What the joints' iteration asks of an `EffectiveMatrix`, of A = 1."""

    rounds = None

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """X = b; nothing is factored."""
        b.copy(x)
        return False

    def solve_linear(self, b: PETSc.Vec, x: PETSc.Vec, unconstrained: PETSc.Vec) -> bool:
        """The same."""
        return self.solve(b, x)

    def destroy(self) -> None:
        """Nothing to free."""


def _unit_forces(compliance: Compliance) -> Floats:
    """B A^-1 B^T from its scaled form (collective)."""
    split = compliance.split.whole()
    assert split is not None
    scale = np.where(compliance.dead.ravel(), 0.0, compliance.scale)
    forces = split * scale
    forces[np.diag_indices(len(forces))] += scale
    forces *= scale[:, None]
    return forces


def _root(forces: Floats) -> Floats:
    """Lower triangle R with R R^T the compliance."""
    try:
        root: Floats = cholesky(0.5 * (forces + forces.T), lower=True)
    except LinAlgError:
        raise JointsError(
            "reduced needs joint points whose gaps do not depend on each other; these do, as where "
            "there are more quadrature points than nodes: take quadrature='nodal'."
        ) from None
    return root


def _bordered(matrix: Floats, column: Floats) -> Floats:
    """A symmetric matrix with one more row and column."""
    size = len(matrix)
    found = np.empty((size + 1, size + 1))
    found[:size, :size] = matrix
    found[size], found[:, size] = column, column
    return found


def as_columns(vectors: Iterable[PETSc.Vec]) -> Floats:
    """Owned rows of vectors, shape (local dofs, k)."""
    return np.column_stack([vector.array_r for vector in vectors])
