# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Waves that rise through level layers, and what each interface sends back."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dolfinx_joints.loads.wave_levels import cubic
from dolfinx_joints.mesh.cells import Floats

# Samples of the shortest delay between interfaces, at least: cubics need the one after the next.
FEWEST = 3

# Samples of nothing before time zero, as many as cubics there need.
BEFORE = 4


class Column:
    """Rising and falling wave of each layer, equations (12ac).

    From rest at time zero. In one layer they are the incident wave itself; in more, waves at the
    interfaces are sampled from there on as far as they are asked for, with cubics between samples.

    Args:
        incident: Velocity of the rising wave at the bottom at a time [s], [m/s].
        impedances: Rho c of each layer from the bottom up [Pa s/m].
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
        # Above and below each interface.
        self._rising: list[Floats] = [np.zeros(BEFORE) for _ in range(interfaces)]
        self._falling: list[Floats] = [np.zeros(BEFORE) for _ in range(interfaces)]

    def rising(self, layer: int, time: float) -> float:
        """Velocity of the rising wave at the bottom of a layer [m/s]."""
        if layer == 0:
            return self._incident(time)
        self._go_on(time)
        return float(self._sampled(self._rising[layer - 1], np.array([time]))[0])

    def falling(self, layer: int, time: float) -> float:
        """Velocity of the falling wave at the top of a layer [m/s]."""
        if layer == len(self._z) - 1:
            return self.rising(layer, time - self._travels[layer])
        self._go_on(time)
        return float(self._sampled(self._falling[layer], np.array([time]))[0])

    def _go_on(self, time: float) -> None:
        """Sample the waves at the interfaces as far as cubics at a time need."""
        while self._spacing * (len(self._rising[0]) - BEFORE - FEWEST) < time:
            self._sample()

    def _sample(self) -> None:
        """The next samples: as many as depend on waves before them alone."""
        start = len(self._rising[0]) - BEFORE
        times: Floats = self._spacing * np.arange(start, start + self._block, dtype=np.float64)
        sent = []
        for i, (below, above) in enumerate(zip(self._z, self._z[1:], strict=False)):
            up, down = self._risen(i, times - self._travels[i]), self._from_above(i + 1, times)
            through = (2.0 * below * up + (above - below) * down) / (below + above)
            sent.append((through, through + down - up))
        for i, (risen, fallen) in enumerate(sent):
            self._rising[i] = np.append(self._rising[i], risen)
            self._falling[i] = np.append(self._falling[i], fallen)

    def _risen(self, layer: int, times: Floats) -> Floats:
        """Rising wave at the bottom of a layer."""
        if layer == 0:
            return np.array([self._incident(float(time)) for time in times])
        return self._sampled(self._rising[layer - 1], times)

    def _from_above(self, layer: int, times: Floats) -> Floats:
        """Falling wave at the bottom of a layer."""
        late = times - self._travels[layer]
        if layer == len(self._z) - 1:
            return self._risen(layer, late - self._travels[layer])
        return self._sampled(self._falling[layer], late)

    def _sampled(self, samples: Floats, times: Floats) -> Floats:
        """Samples between which a wave is cubic, zero before the first."""
        place = np.maximum(times, -float(FEWEST) * self._spacing) / self._spacing
        i = np.floor(place).astype(int)
        near = np.arange(-1, 3)
        weights = cubic((place - i)[:, None] - near)
        return np.asarray(np.sum(samples[i[:, None] + BEFORE + near] * weights, axis=1))
