# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signal processing of ground motions: integration, resampling, filters, baseline correction.

Accelerations [m/s^2] have shape (n, k), with time along the first axis and ``dt`` [s] between
samples, and are linear in between. The methods of :class:`~dolfinx_joints.motions.motion.Motion`
check and explain the parameters.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.arrays import Floats

ROUNDING = 1e-9
"""Tolerance of sample times, relative to the time between samples."""


def fall(x: ArrayLike, start: float, end: float) -> Floats:
    """Return half a cosine that falls from 1 at ``start`` to 0 at ``end``."""
    share = np.clip((np.asarray(x) - start) / (end - start), 0.0, 1.0)
    values = np.cos(0.5 * np.pi * share) ** 2
    return np.where(share == 1.0, 0.0, values)


def integrate(acceleration: Floats, dt: float) -> tuple[Floats, Floats]:
    """Integrate a piecewise linear acceleration exactly to velocity [m/s] and displacement [m]."""
    before, after = acceleration[:-1], acceleration[1:]
    velocity, displacement = np.zeros_like(acceleration), np.zeros_like(acceleration)
    np.cumsum(0.5 * dt * (before + after), axis=0, out=velocity[1:])
    steps = dt * velocity[:-1] + dt**2 / 6.0 * (2.0 * before + after)
    np.cumsum(steps, axis=0, out=displacement[1:])
    return velocity, displacement


def resample(acceleration: Floats, old_dt: float, dt: float, count: int) -> Floats:
    """Resample by band-limited interpolation at the times 0, dt, ..., (count - 1) dt."""
    from scipy.fft import next_fast_len

    period = next_fast_len(2 * len(acceleration), real=True)
    spectrum = np.fft.rfft(acceleration, n=period, axis=0) / period
    frequency = np.fft.rfftfreq(period, old_dt)
    # Terms count twice, because of their conjugates, except for the mean and the Nyquist frequency.
    weight = np.where((frequency == 0.0) | (2 * frequency * old_dt >= 1.0), 1.0, 2.0)
    if dt > old_dt:
        weight = weight * fall(frequency, 0.8 * 0.5 / dt, 0.5 / dt)
    return _chirp_z(weight[:, None] * spectrum, dt / (period * old_dt), count).real


def _chirp_z(values: Floats, frequency: float, count: int) -> NDArray[np.complex128]:
    """Return the sums over n of ``values[n] exp(2 pi i frequency n k)`` for k < ``count``.

    Bluestein's method: 2 n k = n^2 + k^2 - (k - n)^2 makes each sum a convolution. `scipy.signal`
    has it as well, but takes 0.7 s to import.
    """
    from scipy.fft import next_fast_len

    terms = len(values)
    squares = np.arange(max(terms, count)) ** 2.0
    chirp = np.exp(1j * np.pi * np.remainder(frequency * squares, 2.0))
    length = next_fast_len(terms + count - 1)
    kernel = np.fft.fft(np.append(chirp[terms - 1 : 0 : -1], chirp[:count]).conj(), length)
    spectrum = np.fft.fft((values.T * chirp[:terms]), length)
    sums = np.fft.ifft(kernel * spectrum)[:, terms - 1 : terms - 1 + count]
    return (chirp[:count] * sums).T


def without_baseline(acceleration: Floats, degree: int) -> Floats:
    """Subtract the polynomial whose integral is the least-squares fit of the velocity."""
    place = np.linspace(-1.0, 1.0, len(acceleration))
    shapes: Floats = np.polynomial.legendre.legvander(place, degree)
    # Integrate both by trapezoids, so that a polynomial baseline is removed exactly.
    velocities, velocity = integrate(shapes, 1.0)[0], integrate(acceleration, 1.0)[0]
    coefficients = np.linalg.lstsq(velocities, velocity, rcond=None)[0]
    return acceleration - shapes @ coefficients


def band_pass(
    acceleration: Floats, dt: float, low: float | None, high: float | None, order: int
) -> Floats:
    """Apply a Butterworth filter forwards and backwards, without phase shift.

    The signal is padded at both ends by zeros, for 1.5 ``order`` periods of the lowest corner.
    """
    from scipy.signal import butter, sosfilt

    corner: Any = (low, high) if low and high else low or high
    kind = "bandpass" if low and high else "highpass" if low else "lowpass"
    sections = butter(order, corner, btype=kind, fs=1.0 / dt, output="sos")
    pad = int(np.ceil(1.5 * order / (low or high or 1.0) / dt))
    padded = np.pad(acceleration, ((pad, pad), (0, 0)))
    forwards = sosfilt(sections, padded, axis=0)
    filtered: Floats = sosfilt(sections, forwards[::-1], axis=0)[::-1]
    return filtered[pad:-pad]


def low_pass(acceleration: Floats, dt: float, band: float) -> Floats:
    """Apply the gain 1 / (1 + (f / band)^8) at the frequency f, without phase shift.

    The gain does not depend on ``dt``. The cosine transform mirrors the signal at its first and
    last value, so even a signal that alternates at each sample is removed up to the ends. The
    mirror image affects two periods of the band next to each end.
    """
    from scipy.fft import dct, idct

    values = np.asarray(acceleration, dtype=np.float64)
    frequency = np.arange(len(values)) / (2.0 * dt * (len(values) - 1))
    gain = 1.0 / (1.0 + (frequency / band) ** 8)
    return idct((gain * dct(values, type=1, axis=0).T).T, type=1, axis=0)


def without_drift(values: Floats, envelope: Floats, dt: float) -> Floats:
    """Subtract (b + c t) envelope (n,) so that the final velocity and displacement vanish."""
    time = np.arange(len(values)) * dt
    shapes = envelope[:, None] * np.stack([np.ones_like(time), time], axis=1)
    # Weights of the integrals of a and t a for piecewise linear a: trapezoids and hat functions.
    ends = np.full(len(values), dt)
    ends[[0, -1]] *= 0.5
    moments = time * dt
    moments[0], moments[-1] = dt**2 / 6.0, (0.5 * time[-1] - dt / 6.0) * dt
    integrals = np.stack([ends, moments])
    coefficients = np.linalg.solve(integrals @ shapes, integrals @ values)
    return values - shapes @ coefficients
