# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lowest modes of a system with the mass and damping that make a midpoint step exact in them."""

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

# Largest omega dt of a mode that is taken: four steps in its period. Errors of bars that strike and
# of dams hardly change between 1 and 2.
LARGEST_ANGLE = 1.5


class LowestModes:
    """Modes of a body cut at its joints, and what steps need of them.

    A group of equal frequencies that the ``count`` would cut is left out.

    Attributes:
        frequencies: omega, ascending, shape (n,), [rad/s].
        damping: phi.C phi with phi.M phi = 1, shape (n,), [1/s].
        loads: phi times the patterns of the loads, shape (n, patterns).
    """

    def __init__(self, system: MatrixSystem, count: int) -> None:
        """Find the modes (collective)."""
        if system.coupled is not None:
            raise JointsError(
                "exact_modes are those of a body by itself; with ReservoirWaves they are coupled "
                "with the water."
            )
        if not system.symmetric:
            raise JointsError("exact_modes needs symmetric matrices; this system has others.")
        body = replace(system, contact=None)
        found = whole_groups(body, count)
        self.comm: Any = system.mass.comm.tompi4py()
        self.frequencies: Floats = 2.0 * np.pi * found.frequencies
        if not found.shapes:
            raise too_few(body, count)
        shapes = _columns(found.shapes)
        shapes[system.constrained] = 0.0
        weighted = _columns([system.mass * system.vector(shape) for shape in shapes.T])
        self._fixed, self._moves = system.constrained, system.values is not None
        at_supports = weighted[system.constrained]
        weighted[system.constrained] = 0.0
        # Orthonormal to rounding, on which the balance of energies depends.
        factor = np.linalg.inv(np.linalg.cholesky(summed(self.comm, shapes.T @ weighted))).T
        factor = factor @ self._uncoupled(system, shapes @ factor)
        self._shapes = np.asfortranarray(shapes @ factor)
        self._weighted = np.asfortranarray(weighted @ factor)
        self._at_supports = at_supports @ factor
        vectors = [system.vector(shape) for shape in self._shapes.T]
        work = system.mass.createVecRight()
        self.damping = np.array([v.dot(system.damping_force(v, work)) for v in vectors])
        self.loads = np.array([[v.dot(p) for p, _ in system.patterns] for v in vectors])
        self.step: Callable[[float], ModalStep] = lru_cache(maxsize=32)(self._step)

    def _uncoupled(self, system: MatrixSystem, shapes: Floats) -> Floats:
        """Turn of modes of equal frequencies that uncouples their damping (collective).

        Any turn of them are modes too, and which are found depends on rounding and ranks.
        """
        each = [system.damping_force(system.vector(s), system.vector()) for s in shapes.T]
        forces = _columns(each)
        forces[system.constrained] = 0.0
        damping = summed(self.comm, shapes.T @ forces)
        apart = np.diff(self.frequencies) > SAME_FREQUENCY * self.frequencies[1:]
        turn = np.zeros_like(damping)
        for group in np.split(np.arange(len(turn)), np.flatnonzero(apart) + 1):
            at = np.ix_(group, group)
            turn[at] = np.linalg.eigh(0.5 * (damping[at] + damping[at].T))[1]
        return turn

    def _step(self, rate: float) -> ModalStep:
        """What a step needs, by its rate 2 / dt."""
        used = int(np.count_nonzero(self.frequencies * 2.0 / rate <= LARGEST_ANGLE))
        return ModalStep(self, used, rate)

    def amounts(self, used: int, vector: PETSc.Vec) -> Floats:
        """Phi.M u of unconstrained dofs, shape (used,) (collective)."""
        return summed(self.comm, self._weighted[:, :used].T @ vector.array_r)

    def combined(self, amounts: Floats) -> Floats:
        """Owned rows of phi times amounts."""
        shape: Floats = self._shapes[:, : len(amounts)] @ amounts
        return shape

    def weighed(self, amounts: Floats) -> Floats:
        """Owned rows of M phi times amounts, zero at constrained dofs."""
        product: Floats = self._weighted[:, : len(amounts)] @ amounts
        return product

    def carried(self, used: int, vector: PETSc.Vec) -> Floats:
        """Phi.M u of moving supports alone, shape (used,) (collective)."""
        if not self._moves:
            return np.zeros(used)
        return summed(self.comm, vector.array_r[self._fixed] @ self._at_supports[:, :used])

    def add_at_supports(self, amounts: Floats, to: Floats) -> None:
        """Add M phi times amounts to the owned rows of supports."""
        to[self._fixed] += self._at_supports[:, : len(amounts)] @ amounts

    def weighted(self, used: int) -> Floats:
        """M phi at unconstrained dofs, zero elsewhere, shape (local dofs, used)."""
        return self._weighted[:, :used]


class ModalStep:
    """Mass m', damping c' and kicks of the modes with which the midpoint rule is exact.

    A mode has exp(lambda t), lambda^2 + c lambda + omega^2 = 0; the midpoint rule multiplies by
    (1 + mu/rate)/(1 - mu/rate) in a step, m' mu^2 + c' mu + omega^2 = 0, which is exp(lambda dt) if

        mu = rate tanh(lambda/rate),   m' = omega^2/(mu1 mu2),   c' = -m' (mu1 + mu2).

    Attributes:
        modes: The modes.
        used: How many of them the step takes.
        mass: m', shape (used,).
        damping: c', shape (used,), [1/s].
        kick: Change of the modal velocity for a modal force that changes by 1 along the step, with
            which the step is exact under it, shape (used,), [s].
    """

    def __init__(self, modes: LowestModes, used: int, rate: float) -> None:
        """Find them for a rate 2 / dt [1/s]."""
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
        """Velocity of the body for one of the step, sqrt(m'), shape (used,)."""
        return np.sqrt(self.mass)

    @property
    def more_damping(self) -> Floats:
        """Damping that a step adds, c' - c, shape (used,), [1/s]."""
        return self.damping - self.modes.damping[: self.used]

    def change(self, mass: float, damping: float) -> Floats:
        """Return the change of the modes' part of mass M + damping C, shape (used,)."""
        return mass * (self.mass - 1.0) + damping * self.more_damping

    def of_supports(self, u: PETSc.Vec) -> Floats:
        """What moving supports add to the change of M u, shape (used,) (collective).

        Velocities v of the step are S v in the body, S = 1 + phi (sqrt(m') - 1) phi.M at
        unconstrained dofs; its mass is S^T M S, so that the kinetic energy is that of the body.
        """
        return (self.root - 1.0) * self.modes.carried(self.used, u)


def lowest_modes(system: MatrixSystem, count: int) -> LowestModes:
    """Modes of a system, found when first asked for and then kept with it (collective)."""
    kept = system.lowest_modes if system.shared is None else system.shared.lowest_modes
    if count not in kept:
        kept[count] = LowestModes(system, count)
    found: LowestModes = kept[count]
    return found


def _columns(vectors: list[PETSc.Vec]) -> Floats:
    return np.column_stack([v.array_r for v in vectors])
