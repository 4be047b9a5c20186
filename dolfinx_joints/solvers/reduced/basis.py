# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A body that moves in few shapes: responses to every joint force, modes, and what steps add.

With A = m M + k K of one length of step, Z = A^-1 B^T and shapes Phi, the displacement is

    u = V y,   V = [Z, Phi] L^-T,   L L^T = [Z, Phi]^T A [Z, Phi],   V^T A V = 1.             (28b)

The joints' compliance B V V^T B^T = B A^-1 B^T is that of the whole body. Z is not kept: a product
with it is a back-substitution, and [Z, Phi]^T A u = [B u, Phi^T A u]. A step

    A x + B^T f = F - K u0 + r M v0

of V y_u and V y_v misses, as K = (A - m M)/k and f acts through Z,

    x_e = (1 - V V^T A) A^-1 (M V y_s + F),   y_s = r y_v + (m/k) y_u,                        (28c)

whose energy x_e . A x_e is a quadratic form of y_s and the factors of F.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import cholesky, eigh, solve_triangular

from dolfinx_joints.common.progress import Progress
from dolfinx_joints.solvers.direct import BLOCK, multiplied
from dolfinx_joints.solvers.reduced.whole_body import WholeBody

Floats = NDArray[np.float64]

# Part of a shape's energy below which the others hold it: of those that a basis begins with, and
# of what steps add, but for rounding.
INDEPENDENT, HELD = 1e-8, 1e-12


class ReducedBasis:
    """V with all that steps in it need.

    Args:
        body: The body, without moving supports and dashpots.
        coefficients: m and k.
        patterns: Of the loads, owned rows, shape (local dofs, patterns).
        shapes: Phi, shape (local dofs, k). Responses to the loads are added.

    Attributes:
        mass: V^T M V, shape (size, size), on every rank as all that follows.
        loads: V^T times the patterns of the loads, shape (size, patterns).
        body: The body.
    """

    def __init__(
        self,
        body: WholeBody,
        coefficients: tuple[float, float],
        patterns: Floats,
        shapes: Floats,
    ) -> None:
        """Solve for unit forces and shapes (collective)."""
        self.body, (self._m, self._k) = body, coefficients
        self._nodal = body.unconstrained(patterns)
        self._responses = body.solved(self._nodal)
        self._begin(np.hstack([shapes, self._responses]))

    @property
    def size(self) -> int:
        """Number of shapes."""
        return len(self._lower)

    # ------------------------------------------------------------ vectors

    def coordinates(self, u: PETSc.Vec) -> Floats:
        """V^T A u, y of a u in the basis, shape (size,) (collective)."""
        image = u.duplicate()
        self.body.matrix.mult(u, image)
        return self._seen(self.body.gaps(u.array_r[:, None]), image.array_r[:, None])[:, 0]

    def expand(self, coordinates: Floats) -> list[PETSc.Vec]:
        """V y of columns of y, shape (size, k) (collective)."""
        raw = solve_triangular(self._lower, coordinates, lower=True, trans=1)
        rows = self.body.solved(self.body.of_forces(raw[: len(self.body.live)]))
        rows += self._shapes @ raw[len(self.body.live) :]
        return [self.body.vector(row) for row in rows.T]

    def images(self, forces: Floats) -> Floats:
        """V^T of nodal forces, owned rows of columns, shape (size, k) (collective)."""
        forces = self.body.unconstrained(forces.copy())
        return self._seen(self.body.gaps(self.body.solved(forces)), forces)

    def missed(self, x: PETSc.Vec) -> float:
        """Energy of what the basis has not of a displacement, x . A x - |V^T A x|^2 [J]."""
        image = x.duplicate()
        self.body.matrix.mult(x, image)
        seen = self.coordinates(x)
        return max(float(x.dot(image)) - float(seen @ seen), 0.0)

    # ------------------------------------------------------------ steps

    def error(self, inertia: Floats, loads: Floats) -> float:
        """Energy x_e . A x_e of the error of a step, (28d) [J].

        Args:
            inertia: y_s, shape (size,).
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

    def coordinate_vector(self, whole: Floats) -> PETSc.Vec:
        """A vector of coordinates that every rank has as a whole (collective)."""
        vector = PETSc.Vec().createMPI((PETSc.DECIDE, self.size), comm=self.body.mass.comm)
        vector.setArray(whole[slice(*vector.getOwnershipRange())])
        return vector

    def whole(self, vector: PETSc.Vec) -> Floats:
        """Coordinates on every rank, with zeros for what the basis has grown by (collective)."""
        every = np.concatenate(self.body.comm.allgather(vector.array_r))
        return np.append(every, np.zeros(self.size - len(every)))

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
        points, count = len(self.body.live), self._shapes.shape[1]
        self._lower = np.zeros((points + count, points + count))
        self._lower[:points, :points] = self.body.root
        self._lower[points:, :points] = gaps.T
        self._lower[points:, points:] = cholesky(energies, lower=True)
        raw_mass, raw_twice = np.empty((2, points + count, points + count))
        for first in range(0, count, BLOCK):
            part = slice(first, min(first + BLOCK, count))
            here = slice(points + part.start, points + part.stop)
            raw_mass[:, here], raw_twice[:, here] = self._products(self._shapes[:, part])
        progress = Progress("responses to joint forces", points, "columns", self.body.comm.rank)
        for first in range(0, points, BLOCK):
            here = slice(first, min(first + BLOCK, points))
            unit = np.zeros((points, here.stop - here.start))
            unit[here] = np.eye(here.stop - here.start)
            responses = self.body.solved(self.body.of_forces(unit))
            raw_mass[:, here], raw_twice[:, here] = self._products(responses)
            progress.advance(here.stop - here.start)
        progress.finish()
        self.mass = self._in_basis(raw_mass)
        self.loads = self._seen(self.body.gaps(self._responses), self._nodal)
        self._missed = self._in_basis(raw_twice) - self.mass @ self.mass
        weighted = multiplied(self.body.mass, self._responses)
        self._missed_mixed = self.images(weighted) - self.mass @ self.loads
        self._missed_loads = self.body.sum(self._nodal.T @ self._responses)
        self._missed_loads -= self.loads.T @ self.loads

    def _beside(self, shapes: Floats) -> tuple[Floats, Floats]:
        """Shapes' energies beside responses to joint forces, and amounts of these (collective)."""
        gaps = solve_triangular(self.body.root, self.body.gaps(shapes), lower=True)
        energies = self.body.sum(shapes.T @ multiplied(self.body.matrix, shapes))
        return energies - gaps.T @ gaps, gaps

    def add(self, x: PETSc.Vec) -> None:
        """Take in a displacement; coordinates stay and are followed by one more (collective)."""
        shape, image = x, x.duplicate()
        self.body.matrix.mult(x, image)
        largest = float(x.dot(image))
        for _ in range(2):  # once more for what rounding leaves along the basis
            (held,) = self.expand(self.coordinates(shape)[:, None])
            shape = shape.copy()
            shape.axpy(-1.0, held)
            self.body.matrix.mult(shape, image)
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
        pattern = self.body.sum(self._nodal.T @ column)[:, 0]
        self._missed -= np.outer(mass[:size], mass[:size])
        self._missed = _bordered(self._missed, twice - self.mass @ mass)
        self.loads = np.vstack([self.loads, pattern])
        weighted = multiplied(self.body.mass, column)
        mixed = self.body.sum(weighted.T @ self._responses)[0]
        self._missed_mixed -= np.outer(mass[:size], pattern)
        self._missed_mixed = np.vstack([self._missed_mixed, mixed - mass @ self.loads])
        self._missed_loads -= np.outer(pattern, pattern)

    def _products(self, columns: Floats) -> tuple[Floats, Floats]:
        """[Z, Phi]^T M and [Z, Phi]^T M A^-1 M of columns (collective)."""
        found, body = [], self.body
        for _ in range(2):
            weighted = body.unconstrained(multiplied(body.mass, columns))
            columns = body.solved(weighted)
            found.append(np.vstack([body.gaps(columns), body.sum(self._shapes.T @ weighted)]))
        return found[0], found[1]

    def _in_basis(self, raw: Floats) -> Floats:
        """L^-1 of a symmetric matrix L^-T."""
        half = solve_triangular(self._lower, raw, lower=True, overwrite_b=True)
        whole = solve_triangular(self._lower, half.T, lower=True)
        found: Floats = 0.5 * (whole + whole.T)
        return found

    def _seen(self, gaps: Floats, forces: Floats) -> Floats:
        """V^T of nodal forces with the gaps that they cause (collective)."""
        raw = np.vstack([gaps, self.body.sum(self._shapes.T @ forces)])
        seen: Floats = solve_triangular(self._lower, raw, lower=True)
        return seen


def _bordered(matrix: Floats, column: Floats) -> Floats:
    """A symmetric matrix with one more row and column."""
    size = len(matrix)
    found = np.empty((size + 1, size + 1))
    found[:size, :size] = matrix
    found[size], found[:, size] = column, column
    return found
