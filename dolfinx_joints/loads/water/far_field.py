# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The wave that a moving ground makes all along a reservoir, which must not end at its far end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from dolfinx_joints.loads.load import TimeFactor
from dolfinx_joints.mesh.cells import Floats

# Part of a step that a time may miss its end by.
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Section:
    """The cross-section of a reservoir, its matrices and forces per length of it.

    Attributes:
        mass: [kg/m].
        stiffness: [N/m^2].
        losses: Dashpots of floor and banks [N s/m^2].
        driven: Forces per velocity of the ground along each axis, shape (n, gdim), [N s/m^2].
        by_rate: What the same wave all along exerts on the far end, by its velocity: unknowns of
            the water times those of the section [N s/m].
        by_place: The same by its y [N/m].
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
        """Force on the far end in steady vibration, by the ground's complex velocity [m/s], [N]."""
        matrix = self.stiffness + 1j * omega * self.losses - omega**2 * self.mass
        place = splu(csc_array(matrix)).solve(self.driven @ velocity)
        return np.asarray(self.by_place @ place + 1j * omega * (self.by_rate @ place))


class FarField:
    """Forces of the far end's dashpots on the section's own wave, by which they leave it alone.

    The section is marched by the midpoint rule from rest at time zero; between its steps its motion
    is the cubic of both ends.

    Args:
        section: The cross-section.
        velocities: Of the ground along each axis [m/s] at a time [s], of every motion.
        step: Step of the march [s].
    """

    def __init__(
        self, section: Section, velocities: Sequence[Sequence[TimeFactor]], step: float
    ) -> None:
        self._section, self._velocities, self._step = section, velocities, step
        matrix = 2.0 / step**2 * section.mass + section.losses / step + 0.5 * section.stiffness
        self._factor = splu(csc_array(matrix))
        rest = np.zeros(section.mass.shape[0])
        self._rest = rest, rest, self._pushed(0.0)
        self._known = {0: self._rest}

    def force(self, time: float) -> Floats:
        """Forces at a time, shape (unknowns of the water,), [N]."""
        h = self._step
        number = int(np.floor(time / h + ROUNDING))
        place, rate, _ = self._at(number)
        part = time / h - number
        if part > ROUNDING:
            end, end_rate, _ = self._at(number + 1)
            course = CubicHermiteSpline([0.0, h], [place, end], [rate, end_rate])
            place, rate = course(part * h), course(part * h, 1)
        section = self._section
        return np.asarray(section.by_rate @ rate + section.by_place @ place)

    def _at(self, number: int) -> tuple[Floats, Floats, Floats]:
        """Motion, velocity and force at the end of a step, from the nearest one known before."""
        before = [known for known in self._known if known <= number]
        last = max(before) if before else 0
        state = self._known[last] if before else self._rest
        for n in range(last, number):
            state = self._after(*state, (n + 1) * self._step)
            self._known[n + 1] = state
            self._known.pop(n - 2, None)
        return state

    def _after(
        self, place: Floats, rate: Floats, force: Floats, time: float
    ) -> tuple[Floats, Floats, Floats]:
        """A step of the midpoint rule that ends at a time."""
        section, h, end = self._section, self._step, self._pushed(time)
        known = 0.5 * (force + end) + 2.0 / h * (section.mass @ rate) - section.stiffness @ place
        x = self._factor.solve(known)
        return place + x, 2.0 / h * x - rate, end

    def _pushed(self, time: float) -> Floats:
        axes = [[velocity(time) for velocity in each] for each in self._velocities]
        return np.asarray(self._section.driven @ np.sum(axes, axis=0))
