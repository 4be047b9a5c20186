# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform wave along a reservoir excited by the ground, which the far end must not absorb."""

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
        by_rate: Force on the absorbing far end per rate of y of the uniform wave, shape (unknowns
            of the water, unknowns of the section), [N s/m].
        by_place: The same per y [N/m].
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
    """Forces that compensate the far-end dashpots for the uniform wave of the cross-section.

    The section is integrated by the midpoint rule from rest; its motion within a step is a cubic.

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
        rest = np.zeros(section.mass.shape[0])
        self._rest = rest, rest, self._driving_force(0.0)
        self._cache = {0: self._rest}

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
        """Return motion, velocity and force after a step, starting from the last cached step."""
        before = [cached for cached in self._cache if cached <= number]
        last = max(before) if before else 0
        state = self._cache[last] if before else self._rest
        for n in range(last, number):
            state = self._next_state(*state, (n + 1) * self._step)
            self._cache[n + 1] = state
            self._cache.pop(n - 2, None)
        return state

    def _next_state(
        self, place: Floats, rate: Floats, force: Floats, time: float
    ) -> tuple[Floats, Floats, Floats]:
        """Take a step of the midpoint rule that ends at a time [s]."""
        section, h, end = self._section, self._step, self._driving_force(time)
        load = 0.5 * (force + end) + 2.0 / h * (section.mass @ rate) - section.stiffness @ place
        x = self._factor.solve(load)
        return place + x, 2.0 / h * x - rate, end

    def _driving_force(self, time: float) -> Floats:
        axes = [[velocity(time) for velocity in motion] for motion in self._velocities]
        return np.asarray(self._section.driven @ np.sum(axes, axis=0))
