# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lowest modes of a system, with modal mass and damping for which the midpoint rule is exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.model.modes import SAME_FREQUENCY, too_few, whole_groups
from dolfinx_joints.model.system import MatrixSystem

# Largest omega dt of a mode that is integrated exactly: about four steps per period. Limits from 1
# to 2 give nearly the same errors for bars in impact and for dams.
LARGEST_ANGLE = 1.5


class LowestModes:
    """Modes of a body without its joints, and the products of modes that time steps use.

    A group of equal frequencies is left out if ``count`` would split it.

    Attributes:
        frequencies: omega, ascending, shape (n,), [rad/s].
        damping: phi.C phi with phi.M phi = 1, shape (n,), [1/s].
        loads: phi times the patterns of the loads, shape (n, patterns).
    """

    def __init__(self, system: MatrixSystem, count: int) -> None:
        """Compute the modes (collective)."""
        if system.coupled is not None:
            raise JointsError(
                "exact_modes cannot be used with reservoir waves; omit exact_modes or use an added "
                "mass."
            )
        if not system.symmetric:
            raise JointsError("exact_modes needs symmetric matrices; this system's are not.")
        body = replace(system, contact=None)
        modes = whole_groups(body, count)
        self.comm: Any = system.mass.comm.tompi4py()
        self.frequencies: Floats = 2.0 * np.pi * modes.frequencies
        if not modes.shapes:
            raise too_few(body, count)
        shapes = _columns(modes.shapes)
        shapes[system.constrained] = 0.0
        weighted = _columns([system.mass * system.vector(shape) for shape in shapes.T])
        self._fixed, self._moves = system.constrained, system.values is not None
        at_supports = weighted[system.constrained]
        weighted[system.constrained] = 0.0
        # Orthonormalise to rounding: the energy balance depends on it.
        factor = np.linalg.inv(np.linalg.cholesky(summed(self.comm, shapes.T @ weighted))).T
        factor = factor @ self._uncoupling_rotation(system, shapes @ factor)
        self._shapes = np.asfortranarray(shapes @ factor)
        self._weighted = np.asfortranarray(weighted @ factor)
        self._at_supports = at_supports @ factor
        vectors = [system.vector(shape) for shape in self._shapes.T]
        work = system.mass.createVecRight()
        self.damping = np.array([v.dot(system.damping_force(v, work)) for v in vectors])
        self.loads = np.array([[v.dot(p) for p, _ in system.patterns] for v in vectors])
        self.step: Callable[[float], ModalStep] = lru_cache(maxsize=32)(self._step)

    def _uncoupling_rotation(self, system: MatrixSystem, shapes: Floats) -> Floats:
        """Return the rotation of modes of equal frequency that diagonalises damping (collective).

        Rotated modes of equal frequency are modes too; SLEPc's depend on rounding and ranks.
        """
        vectors = [system.damping_force(system.vector(s), system.vector()) for s in shapes.T]
        forces = _columns(vectors)
        forces[system.constrained] = 0.0
        damping = summed(self.comm, shapes.T @ forces)
        distinct = np.diff(self.frequencies) > SAME_FREQUENCY * self.frequencies[1:]
        rotation = np.zeros_like(damping)
        for group in np.split(np.arange(len(rotation)), np.flatnonzero(distinct) + 1):
            block = np.ix_(group, group)
            rotation[block] = np.linalg.eigh(0.5 * (damping[block] + damping[block].T))[1]
        return rotation

    def _step(self, rate: float) -> ModalStep:
        """Return the modal quantities of a step with the rate 2 / dt [1/s]."""
        used = int(np.count_nonzero(self.frequencies * 2.0 / rate <= LARGEST_ANGLE))
        return ModalStep(self, used, rate)

    def amounts(self, used: int, vector: PETSc.Vec) -> Floats:
        """Return phi.M u over unconstrained dofs, shape (used,) (collective)."""
        return summed(self.comm, self._weighted[:, :used].T @ vector.array_r)

    def combined(self, amounts: Floats) -> Floats:
        """Return the owned rows of phi times the modal amounts."""
        shape: Floats = self._shapes[:, : len(amounts)] @ amounts
        return shape

    def mass_times_modes(self, amounts: Floats) -> Floats:
        """Return the owned rows of M phi times the modal amounts, zero at constrained dofs."""
        product: Floats = self._weighted[:, : len(amounts)] @ amounts
        return product

    def support_amounts(self, used: int, vector: PETSc.Vec) -> Floats:
        """Return phi.M u over the dofs of moving supports, shape (used,) (collective)."""
        if not self._moves:
            return np.zeros(used)
        return summed(self.comm, vector.array_r[self._fixed] @ self._at_supports[:, :used])

    def add_at_supports(self, amounts: Floats, to: Floats) -> None:
        """Add M phi times the modal amounts to the owned rows of supports."""
        to[self._fixed] += self._at_supports[:, : len(amounts)] @ amounts

    def weighted(self, used: int) -> Floats:
        """Return M phi at unconstrained dofs, zero elsewhere, shape (local dofs, used)."""
        return self._weighted[:, :used]


class ModalStep:
    """Modal mass m', damping c' and velocity corrections that make the midpoint rule exact.

    A mode of damping c moves as exp(lambda t) with lambda^2 + c lambda + omega^2 = 0. The midpoint
    rule multiplies it by (1 + mu/rate)/(1 - mu/rate) per step; mu1 and mu2 solve
    m' mu^2 + c' mu + omega^2 = 0. This factor equals exp(lambda dt) if

        mu = rate tanh(lambda/rate),   m' = omega^2/(mu1 mu2),   c' = -m' (mu1 + mu2).

    Attributes:
        modes: The modes.
        used: Number of modes that the step integrates exactly.
        mass: m', shape (used,).
        damping: c', shape (used,), [1/s].
        kick: Correction of the modal velocity per unit change of the modal force over the step,
            which makes the step exact for this force, shape (used,), [s].
    """

    def __init__(self, modes: LowestModes, used: int, rate: float) -> None:
        """Compute the modal quantities for a rate 2 / dt [1/s]."""
        self.modes, self.used = modes, used
        omega, c = modes.frequencies[:used], modes.damping[:used]
        root = np.sqrt((0.25 * c**2 - omega**2).astype(complex))
        z = np.array([-0.5 * c + root, -0.5 * c - root]) / rate
        small = np.abs(z) < 1e-6
        ratio = np.where(small, 1.0 + z**2 / 3.0, z / np.tanh(np.where(small, 1.0, z)))
        self.mass: Floats = np.prod(ratio, axis=0).real
        turned = np.where(small, z - z**3 / 3.0, np.tanh(z))
        self.damping: Floats = -rate * self.mass * turned.sum(axis=0).real
        half = omega / rate  # omega dt / 2
        small = half < 1e-3
        tangent = np.tan(np.where(small, 1.0, half))
        kick = tangent * (1.0 - half / tangent) / np.where(small, 1.0, half**3)
        self.kick: Floats = np.where(small, 1.0 / 3.0 + 2.0 * half**2 / 15.0, kick) / rate

    @property
    def root(self) -> Floats:
        """Ratio of body velocity to step velocity of each mode, sqrt(m'), shape (used,)."""
        return np.sqrt(self.mass)

    @property
    def more_damping(self) -> Floats:
        """Change of the modal damping, c' - c, shape (used,), [1/s]."""
        return self.damping - self.modes.damping[: self.used]

    def change(self, mass: float, damping: float) -> Floats:
        """Return the change of mass M + damping C in the modes, shape (used,)."""
        return mass * (self.mass - 1.0) + damping * self.more_damping

    def of_supports(self, u: PETSc.Vec) -> Floats:
        """Return the contribution of moving supports to the change of M u, (used,) (collective).

        The step velocity v gives the body velocity S v, with S = 1 + phi (sqrt(m') - 1) phi.M at
        unconstrained dofs. The step's mass is S^T M S, so its kinetic energy is the body's.
        """
        return (self.root - 1.0) * self.modes.support_amounts(self.used, u)


def lowest_modes(system: MatrixSystem, count: int) -> LowestModes:
    """Return the modes of a system, computed once and cached in the system (collective)."""
    kept = system.lowest_modes if system.shared is None else system.shared.lowest_modes
    if count not in kept:
        kept[count] = LowestModes(system, count)
    modes: LowestModes = kept[count]
    return modes


def _columns(vectors: list[PETSc.Vec]) -> Floats:
    return np.column_stack([v.array_r for v in vectors])
