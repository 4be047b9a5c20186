# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion at the base of layered rock from a record at its surface, by vertical S and P waves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.body.damping import Ratio, Rayleigh
from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import check_kind_of, finite, numbers_of, shown
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.motions.motion import Hertz, Motion
from dolfinx_joints.motions.processing import fall

LARGEST_AMPLIFICATION = 10.0
"""Largest allowed motion of the base relative to that of the surface. The noise of a record, about
1 % of its peak at high frequencies, then stays below 10 %."""

RIPPLES = 10.0
"""Periods of the highest frequency that are added at both ends for the ripples of the low-pass."""

Kind = Literal["outcrop", "within"]


@dataclass(frozen=True, kw_only=True)
@checked
class RockLayer:
    """Horizontal layer of rock or soil.

    Attributes:
        thickness: Thickness of the layer.
        material: Isotropic elastic material with mass.
        damping_ratio: Damping ratio, equal at all frequencies (hysteretic).
    """

    thickness: Annotated[float, at.Gt(0), at.Unit("m")]
    material: Elastic
    damping_ratio: Ratio = 0.0

    def __post_init__(self) -> None:
        check_kind_of("material", self.material, isinstance(self.material, Elastic), "an Elastic")


@dataclass(frozen=True, kw_only=True)
@checked
class RockColumn:
    """Layers of rock over an undamped half space, in which S and P waves travel vertically.

    Damping makes the modulus complex: G* = G (1 + 2 i xi + i omega b), with the damping ratio xi
    of the layer and the stiffness factor b of ``damping``, equations (12ad).

    Attributes:
        layers: Layers from the surface down.
        half_space: Material below the layers.
        damping: Damping of the model, proportional to stiffness; see `stiffness_proportional`.
    """

    layers: Annotated[Sequence[RockLayer], at.MinLen(1)]
    half_space: Elastic
    damping: Rayleigh = field(default_factory=Rayleigh)

    def __post_init__(self) -> None:
        for layer in self.layers:
            check_kind_of("Each layer", layer, isinstance(layer, RockLayer), "a RockLayer")
        rock, damping = self.half_space, self.damping
        check_kind_of("half_space", rock, isinstance(rock, Elastic), "an Elastic")
        check_kind_of("damping", damping, isinstance(damping, Rayleigh), "a Rayleigh")
        if damping.mass_factor:
            raise ValueError(
                "RockColumn: damping must be proportional to stiffness, because mass damping "
                f"resists the absolute motion; got mass_factor {damping.mass_factor:g} 1/s."
            )
        if not all(material.density for material in (*(la.material for la in self.layers), rock)):
            raise ValueError("RockColumn: all layers and the half space must have mass.")

    @checked
    def transfer(
        self, frequency: ArrayLike, *, wave: Literal["S", "P"] = "S", kind: Kind = "outcrop"
    ) -> NDArray[np.complex128]:
        """Return the motion of the base over that of the surface at frequencies [Hz], shape (n,).

        Args:
            frequency: Frequencies, shape (n,), [Hz].
            wave: ``"S"`` for horizontal motions, ``"P"`` for vertical ones.
            kind: ``"outcrop"``: twice the rising wave, the motion of the half space if its surface
                were free. ``"within"``: sum of rising and falling wave, the motion of the base
                below the layers.
        """
        frequencies = numbers_of(frequency)
        if frequencies is None or not finite(frequencies) or (frequencies < 0.0).any():
            raise ValueError(f"frequency must be finite numbers >= 0, got {shown(frequency)}.")
        omega = 2.0 * np.pi * frequencies
        rising = falling = np.full(omega.shape, 0.5 + 0.0j)
        impedances: list[Any] = [self._impedance(layer, omega, wave) for layer in self.layers]
        impedances.append(np.sqrt(self.half_space.density * _modulus(self.half_space, wave)))
        for layer, own, below in zip(self.layers, impedances, impedances[1:], strict=False):
            # The complex slowness is the density over the impedance.
            phase = 1.0j * omega * layer.thickness * layer.material.density / own
            up, down, ratio = rising * np.exp(phase), falling * np.exp(-phase), own / below
            rising = 0.5 * ((1.0 + ratio) * up + (1.0 - ratio) * down)
            falling = 0.5 * ((1.0 - ratio) * up + (1.0 + ratio) * down)
        return 2.0 * rising if kind == "outcrop" else rising + falling

    def _impedance(self, layer: RockLayer, omega: Floats, wave: str) -> NDArray[np.complex128]:
        """Return rho c* = sqrt(rho G*) [Pa s/m] at circular frequencies [1/s]."""
        loss = 2.0 * layer.damping_ratio + self.damping.stiffness_factor * omega
        modulus = _modulus(layer.material, wave) * (1.0 + 1.0j * loss)
        return np.asarray(np.sqrt(layer.material.density * modulus))

    @checked
    def deconvolved(self, surface: Motion, *, kind: Kind, highest_frequency: Hertz) -> Motion:
        """Return the motion at the base, the top of the half space, that moves the surface so.

        x and y are S waves, z is a P wave. Frequencies above ``highest_frequency`` are removed, by
        half a cosine from 80 % of it. The waves leave the base before they reach the surface, and
        return to it later: the result is longer than the record by equal times at both ends.

        Args:
            surface: Acceleration of the free surface [m/s^2]; taper it first.
            kind: Motion of an ``"outcrop"`` of the base, for `incident_wave`, or ``"within"`` the
                rock, for a base that is moved; see `transfer`.
            highest_frequency: Highest frequency that is kept.

        Raises:
            RecordError: The highest frequency is outside the band of the record, or the base would
                move more than LARGEST_AMPLIFICATION times as much as the surface, because damping
                weakens rising waves and deconvolution amplifies the noise of the record.
        """
        from scipy.fft import next_fast_len

        check_kind_of("surface", surface, isinstance(surface, Motion), "a Motion")
        lowest, nyquist = 1.0 / surface.duration, 0.5 / surface.dt
        if not lowest <= highest_frequency <= nyquist:
            raise RecordError(
                f"highest_frequency must be from {lowest:.4g} Hz (1/duration) to {nyquist:.6g} Hz "
                f"(half the sampling rate), got {highest_frequency:g} Hz."
            )
        longest = sum(
            layer.thickness * np.sqrt(layer.material.density / layer.material.shear_modulus)
            for layer in self.layers
        )
        pad = int(np.ceil((longest + RIPPLES / highest_frequency) / surface.dt))
        padded = np.pad(surface.acceleration, ((pad, pad), (0, 0)))
        period = next_fast_len(2 * len(padded), real=True)
        frequency = np.fft.rfftfreq(period, surface.dt)
        kept = frequency <= highest_frequency
        spectrum = np.fft.rfft(padded, n=period, axis=0) * np.where(kept, 1.0, 0.0)[:, None]
        gain = fall(frequency[kept], 0.8 * highest_frequency, highest_frequency)
        for axis, wave in enumerate(("S", "S", "P")):
            transfer = self.transfer(frequency[kept], wave=wave, kind=kind)
            _check_amplification(frequency[kept], np.abs(transfer), wave)
            spectrum[kept, axis] *= gain * transfer
        values: Floats = np.fft.irfft(spectrum, n=period, axis=0)[: len(padded)]
        return replace(surface, acceleration=values, name=f"{surface.name}, {kind} of the base")


def _modulus(material: Elastic, wave: str) -> float:
    """Return G for S waves, lambda + 2 G for P waves [Pa]."""
    mu = material.shear_modulus
    return mu if wave == "S" else material.first_lame("strain") + 2.0 * mu


def _check_amplification(frequency: Floats, amplification: Floats, wave: str) -> None:
    if amplification.max() > LARGEST_AMPLIFICATION:
        first = frequency[np.argmax(amplification > LARGEST_AMPLIFICATION)]
        raise RecordError(
            f"From {first:.3g} Hz the base would move more than {LARGEST_AMPLIFICATION:g} times as "
            f"much as the surface ({wave} waves): damping weakens the rising wave, and the noise "
            f"of the record would grow. Use highest_frequency below {first:.3g} Hz."
        )
