# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertically propagating waves in horizontal layers, with reflections at each interface."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dolfinx_joints.loads.wave_levels import cubic
from dolfinx_joints.mesh.cells import Floats

# Least number of samples per travel time of a layer: cubic interpolation reads two samples ahead.
FEWEST = 3

# Number of zero samples before time zero, for cubic interpolation at time zero.
BEFORE = 4


class Column:
    """Rising and falling wave of each layer, from rest at time zero, equations (12ac).

    In a single layer, the rising wave is the incident wave. With several layers, the waves at the
    interfaces are sampled up to the requested time and interpolated by cubics.

    Args:
        incident: Velocity of the rising wave at the bottom at a time [s], [m/s].
        impedances: Impedance rho c of each layer, from the bottom up [Pa s/m].
        travels: Travel time through each layer [s].
        spacing: Longest time between samples [s].
    """

    def __init__(
        self,
        incident: Callable[[float], float],
        impedances: Sequence[float],
        travels: Sequence[float],
        spacing: float,
    ) -> None:
        self._incident, self._z, self._travels = incident, list(impedances), list(travels)
        self._spacing = min(spacing, min(travels) / FEWEST)
        self._block = max(int(min(travels) / self._spacing) - FEWEST + 1, 1)
        interfaces = len(self._z) - 1
        # Samples just above each interface (rising wave) and just below (falling wave).
        self._rising: list[Floats] = [np.zeros(BEFORE) for _ in range(interfaces)]
        self._falling: list[Floats] = [np.zeros(BEFORE) for _ in range(interfaces)]

    def rising(self, layer: int, time: float) -> float:
        """Return the velocity of the rising wave at the bottom of a layer [m/s]."""
        if layer == 0:
            return self._incident(time)
        self._extend_to(time)
        return float(self._interpolate(self._rising[layer - 1], np.array([time]))[0])

    def falling(self, layer: int, time: float) -> float:
        """Return the velocity of the falling wave at the top of a layer [m/s]."""
        if layer == len(self._z) - 1:
            return self.rising(layer, time - self._travels[layer])
        self._extend_to(time)
        return float(self._interpolate(self._falling[layer], np.array([time]))[0])

    def _extend_to(self, time: float) -> None:
        """Extend the samples until cubic interpolation is possible at a time [s]."""
        while self._spacing * (len(self._rising[0]) - BEFORE - FEWEST) < time:
            self._append_block()

    def _append_block(self) -> None:
        """Append the next block of samples, short enough to depend on earlier samples only."""
        start = len(self._rising[0]) - BEFORE
        times: Floats = self._spacing * np.arange(start, start + self._block, dtype=np.float64)
        new_samples = []
        for i, (below, above) in enumerate(zip(self._z, self._z[1:], strict=False)):
            up, down = self._rising_in(i, times - self._travels[i]), self._falling_in(i + 1, times)
            transmitted = (2.0 * below * up + (above - below) * down) / (below + above)
            new_samples.append((transmitted, transmitted + down - up))
        for i, (rising, falling) in enumerate(new_samples):
            self._rising[i] = np.append(self._rising[i], rising)
            self._falling[i] = np.append(self._falling[i], falling)

    def _rising_in(self, layer: int, times: Floats) -> Floats:
        """Return the rising wave at the bottom of a layer."""
        if layer == 0:
            return np.array([self._incident(float(time)) for time in times])
        return self._interpolate(self._rising[layer - 1], times)

    def _falling_in(self, layer: int, times: Floats) -> Floats:
        """Return the falling wave at the bottom of a layer."""
        at_top = times - self._travels[layer]
        if layer == len(self._z) - 1:
            return self._rising_in(layer, at_top - self._travels[layer])
        return self._interpolate(self._falling[layer], at_top)

    def _interpolate(self, samples: Floats, times: Floats) -> Floats:
        """Interpolate the samples by cubics; the wave is zero before the first sample."""
        position = np.maximum(times, -float(FEWEST) * self._spacing) / self._spacing
        i = np.floor(position).astype(int)
        neighbours = np.arange(-1, 3)
        weights = cubic((position - i)[:, None] - neighbours)
        return np.asarray(np.sum(samples[i[:, None] + BEFORE + neighbours] * weights, axis=1))
