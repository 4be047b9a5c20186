# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertically propagating waves in horizontal layers, in time and in frequency (deconvolution)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.body.damping import Ratio, Rayleigh
from dolfinx_joints.common.constants import LARGE_LOSS
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError, warn
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.loads.wave_levels import cubic
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.mesh.cells import Floats
from dolfinx_joints.motions.motion import Hertz, Motion
from dolfinx_joints.motions.processing import fall

# Least number of samples per travel time of a layer: cubic interpolation reads two samples ahead.
FEWEST = 3

# Number of zero samples before time zero, for cubic interpolation at time zero.
BEFORE = 4

# Largest motion of the base over that of the surface: noise of 1 % of the peak stays below 10 %.
LARGEST_AMPLIFICATION = 10.0

Kind = Literal["outcrop", "within"]


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


@dataclass(frozen=True, kw_only=True)
@checked
class RockLayer:
    """Horizontal layer of rock or soil.

    Attributes:
        thickness: Thickness of the layer.
        material: `Elastic` material with mass.
        damping_ratio: Damping ratio, equal at all frequencies (hysteretic).
    """

    thickness: Annotated[float, at.Gt(0), at.Unit("m")]
    material: Elastic
    damping_ratio: Ratio = 0.0


@dataclass(frozen=True, kw_only=True)
@checked
class RockColumn:
    """Layers of rock over an undamped half space, in which S and P waves travel vertically.

    Attributes:
        layers: Layers from the surface down.
        half_space: `Elastic` material below the layers.
        damping: Damping of the model (`stiffness_proportional`), in addition to that of layers.
    """

    layers: Annotated[Sequence[RockLayer], at.MinLen(1)]
    half_space: Elastic
    damping: Rayleigh = field(default_factory=Rayleigh)

    def __post_init__(self) -> None:
        good = all(isinstance(layer, RockLayer) for layer in self.layers)
        check_kind_of("layers", self.layers, good, "a list of RockLayer")
        for rock in (*(layer.material for layer in self.layers), self.half_space):
            good = isinstance(rock, Elastic) and rock.density > 0.0
            check_kind_of("A material of RockColumn", rock, good, "an Elastic with mass")
        good = isinstance(self.damping, Rayleigh) and not self.damping.mass_factor
        check_kind_of("damping", self.damping, good, "proportional to stiffness")

    @checked
    def transfer(
        self, frequency: ArrayLike, *, wave: Literal["S", "P"] = "S", kind: Kind = "outcrop"
    ) -> NDArray[np.complex128]:
        """Return the motion of the base over that of the surface, shape (n,), equations (12ah).

        An ``"outcrop"`` moves twice as much as the rising wave, as the half space would without the
        layers. ``"within"`` is the motion of the base below the layers, the sum of the rising and
        the falling wave. Frequencies have shape (n,), [Hz].
        """
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=np.float64)
        check_kind_of("frequency", frequency, bool((omega >= 0.0).all()), "0 or more")
        viscous = self.damping.stiffness_factor * omega
        losses: list[Any] = [1.0 + 1.0j * (2.0 * la.damping_ratio + viscous) for la in self.layers]
        rocks = [*(layer.material for layer in self.layers), self.half_space]
        impedances = []
        for rock, loss in zip(rocks, [*losses, 1.0], strict=True):
            pressure = rock.first_lame("strain") + 2.0 * rock.shear_modulus
            modulus = pressure if wave == "P" else rock.shear_modulus
            impedances.append(np.sqrt(rock.density * modulus * loss))
        rising: Any = np.full(omega.shape, 0.5 + 0.0j)
        falling = rising
        for layer, own, below in zip(self.layers, impedances, impedances[1:], strict=False):
            phase = 1.0j * omega * layer.thickness * layer.material.density / own  # rho / Z = 1 / c
            up, down, ratio = rising * np.exp(phase), falling * np.exp(-phase), own / below
            rising = 0.5 * ((1.0 + ratio) * up + (1.0 - ratio) * down)
            falling = 0.5 * ((1.0 - ratio) * up + (1.0 + ratio) * down)
        return np.asarray(2.0 * rising if kind == "outcrop" else rising + falling)

    @checked
    def deconvolved(self, surface: Motion, *, kind: Kind, highest_frequency: Hertz) -> Motion:
        """Return the motion of the base, the top of the half space, from that of the surface.

        x and y are S waves, z is a P wave. Frequencies above ``highest_frequency`` are removed, by
        half a cosine from 80 % of it; a warning states the share if it matters. Waves leave the
        base before they reach the surface and come back later: the result is longer than the
        record, by equal times at both ends.

        Args:
            surface: Acceleration of the free surface [m/s^2]; taper it first.
            kind: ``"outcrop"`` for `incident_wave`, ``"within"`` to move the base; see `transfer`.
            highest_frequency: Highest frequency that is kept.

        Raises:
            RecordError: The highest frequency is outside the band of the record, or the base moves
                more than LARGEST_AMPLIFICATION times as much as the surface, so that noise grows.
        """
        from scipy.fft import next_fast_len

        check_kind_of("surface", surface, isinstance(surface, Motion), "a Motion")
        dt, lowest = surface.dt, 1.0 / surface.duration
        if not lowest <= highest_frequency <= 0.5 / dt:
            band = f"{lowest:.4g} Hz (1/duration) to {0.5 / dt:.6g} Hz (half the sampling rate)"
            raise RecordError(f"highest_frequency must be {band}, got {highest_frequency:g} Hz.")
        rocks = [(layer.thickness, layer.material) for layer in self.layers]
        travel = sum(h * np.sqrt(rock.density / rock.shear_modulus) for h, rock in rocks)
        # The low-pass ripples for about ten of its periods.
        pad = int(np.ceil((travel + 10.0 / highest_frequency) / dt))
        padded = np.pad(surface.acceleration, ((pad, pad), (0, 0)))
        period = next_fast_len(2 * len(padded), real=True)
        frequency = np.fft.rfftfreq(period, dt)
        kept = frequency <= highest_frequency
        spectrum = np.fft.rfft(padded, n=period, axis=0)
        total = np.sum(np.abs(spectrum) ** 2)
        spectrum *= fall(frequency, 0.8 * highest_frequency, highest_frequency)[:, None]
        if (removed := total - np.sum(np.abs(spectrum) ** 2)) > LARGE_LOSS * total:
            share = f"{100.0 * removed / total:.3g} % of the integral of its squared acceleration"
            text = f"highest_frequency={highest_frequency:g} removes {share}."
            warn(f"The motion {shown(surface.name)}: {text}", PlausibilityWarning)
        for axis in range(3):
            transfer = self.transfer(frequency[kept], wave="P" if axis == 2 else "S", kind=kind)
            large = np.abs(transfer) > LARGEST_AMPLIFICATION
            if large.any():
                limit = frequency[np.argmax(large)]
                factor = f"{LARGEST_AMPLIFICATION:g} times as much as the surface"
                raise RecordError(
                    f"From {limit:.3g} Hz the base would move more than {factor} along "
                    f"{'xyz'[axis]}: use highest_frequency below {limit:.3g} Hz, less damping or a "
                    "stiffer half space."
                )
            spectrum[kept, axis] *= transfer
        values = np.fft.irfft(spectrum, n=period, axis=0)[: len(padded)]
        return replace(surface, acceleration=values, name=f"{surface.name}, base ({kind})")
