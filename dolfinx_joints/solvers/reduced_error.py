# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a step in a basis misses of the full step, by the residual of the full equation.

A step A x + B^T f = F - K u0 + rate M v0 whose x, u0 and v0 are V times coordinates has the error

    e = A^-1 (F - K u0 + rate M v0 - B^T f) - x = P A^-1 N z,   P = 1 - V (V^T A V)^-1 V^T A,   (1)

with N = [M V, K V, patterns, B^T]: e . A e = z . H z with H = N^T P A^-1 N, which is small. In the
midpoint rule e . A e = |2 e / dt|^2_M / 2 + |e|^2_K / 2 and what damping takes: the energy of the
error that the step makes, joint forces being as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.model.reduced_system import Projection, as_columns, multiplied
from dolfinx_joints.solvers.direct import BLOCK, DirectSolver
from dolfinx_joints.solvers.interface.compliance import Compliance
from dolfinx_joints.solvers.interface.condensed import Condensed

Floats = NDArray[np.float64]


class ReducedError:
    """Energies of the errors of reduced steps with one set of coefficients.

    Without dashpots K V = (A V - m' M V)/k' with A = m' M + k' K: one back-substitution per column
    of V is enough, besides the joints' compliance.

    Args:
        projection: Of the system in the basis.
        condensed: The full bulk with these coefficients.
        coefficients: m' and k'.

    Raises:
        JointsError: The bulk is not factored.
    """

    def __init__(
        self, projection: Projection, condensed: Condensed, coefficients: tuple[float, float]
    ) -> None:
        """Solve for the loads (collective)."""
        self._projection, self._bulk = projection, condensed.matrix
        self._of_mass, self._of_stiffness = coefficients
        if not isinstance(self._bulk.solver, DirectSolver):
            raise JointsError(
                "reduced needs a factor of the body, for which there is not memory enough; run "
                "without it."
            )
        self.forces = _unit_forces(condensed.compliance)  # B A^-1 B^T
        system = projection.system
        self._fixed = system.constrained
        assert system.contact is not None
        self._jump, self._comm = system.contact.operator.matrix, projection.basis.comm
        patterns = as_columns(v for v, _ in system.patterns) if system.patterns else None
        size = len(projection.basis.columns)
        self._patterns = np.zeros((size, 0)) if patterns is None else patterns.copy()
        self._patterns[self._fixed] = 0.0
        self.load_responses = self._solved(self._patterns)
        self._loads = projection.basis.sum(self._patterns.T @ self.load_responses)
        self._loads_gaps = self._gaps(self.load_responses)
        count, points = self._patterns.shape[1], len(self.forces)
        self._mass = np.zeros((0, 0))  # (M V)^T A^-1 M V
        self._mass_loads = np.zeros((0, count))
        self._mass_gaps = np.zeros((points, 0))
        self._whole = np.zeros((0, 0))

    def update(self) -> None:
        """Bring H up to the basis (collective)."""
        projection = self._projection
        projection.update()
        basis, known = projection.basis, len(self._mass)
        if basis.size == known and len(self._whole):
            return
        for first in range(known, basis.size, BLOCK):
            self._extend(slice(first, min(first + BLOCK, basis.size)))
        self._whole = self._deflated()

    def _extend(self, new: slice) -> None:
        """Solve for some columns of the basis that follow those known (collective)."""
        system, basis = self._projection.system, self._projection.basis
        weighted = multiplied(system.mass, basis.columns[:, new])
        weighted[self._fixed] = 0.0
        responses = self._solved(weighted)
        columns = basis.coordinates(multiplied(system.mass, responses))
        whole = np.zeros((new.stop, new.stop))
        whole[: new.start, : new.start] = self._mass
        whole[:, new], whole[new, :] = columns[: new.stop], columns[: new.stop].T
        self._mass = whole
        loads = basis.sum(responses.T @ self._patterns)
        self._mass_loads = np.vstack([self._mass_loads, loads])
        self._mass_gaps = np.hstack([self._mass_gaps, self._gaps(responses)])

    def _deflated(self) -> Floats:
        """H, over M V, K V, patterns and joint forces."""
        mass, stiffness = self._projection.mass, self._projection.stiffness
        m, k = self._of_mass, self._of_stiffness
        loads, gaps = self._projection.loads, self._every(self._projection.gaps)
        mixed = (mass - m * self._mass) / k  # (M V)^T A^-1 K V
        stiff = (stiffness - m * mixed) / k
        stiff_loads = (loads - m * self._mass_loads) / k
        stiff_gaps = (gaps - m * self._mass_gaps) / k
        whole = np.block(
            [
                [self._mass, mixed, self._mass_loads, self._mass_gaps.T],
                [mixed.T, stiff, stiff_loads, stiff_gaps.T],
                [self._mass_loads.T, stiff_loads.T, self._loads, self._loads_gaps.T],
                [self._mass_gaps, stiff_gaps, self._loads_gaps, self.forces],
            ]
        )
        seen = np.hstack([mass, stiffness, loads, gaps.T])  # V^T N
        whole -= seen.T @ self._in_basis(seen)
        return whole

    def energy(self, inertia: Floats, stretch: Floats, loads: Floats, forces: Floats) -> float:
        """e . A e [J].

        Args:
            inertia: Coordinates of rate v0, shape (r,).
            stretch: Coordinates of u0.
            loads: Factors of the patterns, means of the step.
            forces: w t of all joint points, shape (3 points,), [N].
        """
        z = np.concatenate([inertia, -stretch, loads, -forces])
        return float(z @ (self._whole @ z))

    @property
    def of_forces(self) -> Floats:
        """Part of H of the joint forces: what of the compliance the basis has not."""
        return self._whole[-len(self.forces) :, -len(self.forces) :]

    def responses(self, forces: Floats) -> Floats:
        """A^-1 B^T of joint forces, shape (3 points, k); owned rows (collective)."""
        operator = self._jump.transpose(PETSc.Mat())
        start, stop = self._jump.getOwnershipRange()
        right = multiplied(operator, forces[start:stop])
        right[self._fixed] = 0.0
        return self._solved(right)

    def _solved(self, right: Floats) -> Floats:
        """A^-1 of columns (collective)."""
        found = np.empty_like(right)
        for first in range(0, right.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            found[:, part] = self._bulk.solve_block(right[:, part])
        found[self._fixed] = 0.0
        return found

    def _gaps(self, columns: Floats) -> Floats:
        return self._every(multiplied(self._jump, columns))

    def _every(self, rows: Floats) -> Floats:
        """Rows of all ranks (collective)."""
        return rows if self._comm.size == 1 else np.concatenate(self._comm.allgather(rows))

    def missed(self, x: PETSc.Vec) -> float:
        """Energy of what the basis, and no step in it, could not give of a full step's x [J]."""
        image = x.duplicate()
        self._bulk.multiply(x, image)
        seen = self._projection.basis.coordinates(image.array_r)
        self._projection.update()
        return float(x.dot(image)) - float(seen @ self._in_basis(seen))

    def _in_basis(self, right: Floats) -> Floats:
        """(V^T A V)^-1 of columns of coordinates."""
        projection, m, k = self._projection, self._of_mass, self._of_stiffness
        found: Floats = cho_solve(
            cho_factor(m * projection.mass + k * projection.stiffness), right
        )
        return found


def _unit_forces(compliance: Compliance) -> Floats:
    """B A^-1 B^T from its scaled form (collective)."""
    split = compliance.split.whole()
    assert split is not None
    scale = np.where(compliance.dead.ravel(), 0.0, compliance.scale)
    forces = split * scale
    forces[np.diag_indices(len(forces))] += scale
    forces *= scale[:, None]
    return forces
