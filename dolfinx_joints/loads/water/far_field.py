# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wave that ground motion excites equally along a reservoir; the far end must not absorb it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from dolfinx_joints.loads.load import TimeFactor
from dolfinx_joints.mesh.cells import Floats

# Tolerance for a time at the end of a step, relative to the step.
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Section:
    """Cross-section of a reservoir, with matrices and forces per length.

    Attributes:
        mass: Mass matrix [kg/m].
        stiffness: Stiffness matrix [N/m^2].
        losses: Dashpots of floor and banks [N s/m^2].
        driven: Forces per velocity of the ground along each axis, shape (n, gdim), [N s/m^2].
        by_rate: Forces on the absorbing far end per dy/dt of the uniform wave y = phi / c, shape
            (unknowns of the water, unknowns of the section), [N s/m].
        by_place: Forces on the far end per y of the uniform wave, shaped like ``by_rate``, [N/m].
    """

    mass: csr_array
    stiffness: csr_array
    losses: csr_array
    driven: Floats
    by_rate: csr_array
    by_place: csr_array

    def harmonic_force(
        self, omega: float, velocity: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Return the force on the far end [N] for a harmonic ground velocity [m/s]."""
        matrix = self.stiffness + 1j * omega * self.losses - omega**2 * self.mass
        place = splu(csc_array(matrix)).solve(self.driven @ velocity)
        return np.asarray(self.by_place @ place + 1j * omega * (self.by_rate @ place))


class FarField:
    """Forces that cancel the far-end dashpot forces for the uniform wave of the cross-section.

    The midpoint rule integrates the section from rest; within a step, its motion is a cubic.

    Args:
        section: The cross-section.
        velocities: Ground velocity along each axis [m/s] at a time [s], for each motion.
        step: Time step of the section [s].
    """

    def __init__(
        self, section: Section, velocities: Sequence[Sequence[TimeFactor]], step: float
    ) -> None:
        self._section, self._velocities, self._step = section, velocities, step
        matrix = 2.0 / step**2 * section.mass + section.losses / step + 0.5 * section.stiffness
        self._factor = splu(csc_array(matrix))
        zeros = np.zeros(section.mass.shape[0])
        self._initial = zeros, zeros, self._driving_force(0.0)
        self._cache = {0: self._initial}

    def force(self, time: float) -> Floats:
        """Return the forces at a time [s], shape (unknowns of the water,), [N]."""
        h = self._step
        number = int(np.floor(time / h + ROUNDING))
        place, rate, _ = self._state_after(number)
        part = time / h - number
        if part > ROUNDING:
            end, end_rate, _ = self._state_after(number + 1)
            from scipy.interpolate import CubicHermiteSpline  # imported only where it is needed

            spline = CubicHermiteSpline([0.0, h], [place, end], [rate, end_rate])
            place, rate = spline(part * h), spline(part * h, 1)
        section = self._section
        return np.asarray(section.by_rate @ rate + section.by_place @ place)

    def _state_after(self, number: int) -> tuple[Floats, Floats, Floats]:
        """Return y, dy/dt and force after a step number, computed from the last cached step."""
        cached_steps = [cached for cached in self._cache if cached <= number]
        start_step = max(cached_steps) if cached_steps else 0
        state = self._cache[start_step] if cached_steps else self._initial
        for n in range(start_step, number):
            state = self._next_state(*state, (n + 1) * self._step)
            self._cache[n + 1] = state
            self._cache.pop(n - 2, None)
        return state

    def _next_state(
        self, place: Floats, rate: Floats, force: Floats, time: float
    ) -> tuple[Floats, Floats, Floats]:
        """Compute a step of the midpoint rule that ends at a time [s]."""
        section, h, end = self._section, self._step, self._driving_force(time)
        load = 0.5 * (force + end) + 2.0 / h * (section.mass @ rate) - section.stiffness @ place
        x = self._factor.solve(load)
        return place + x, 2.0 / h * x - rate, end

    def _driving_force(self, time: float) -> Floats:
        axes = [[velocity(time) for velocity in motion] for motion in self._velocities]
        return np.asarray(self._section.driven @ np.sum(axes, axis=0))
