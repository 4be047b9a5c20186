# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fourier amplitude, response spectra and Arias intensity, as pure functions of arrays.

Time is the first axis of a signal; other axes are components.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import annotated_types as at
import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.motions.processing import ROUNDING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Seconds = Annotated[float, at.Gt(0.0), at.Unit("s")]
DampingRatio = Annotated[float, at.Interval(ge=0.0, lt=1.0)]
Share = Annotated[float, at.Interval(ge=0.0, le=1.0)]

# Parts into which a period is divided, so that each has at most one peak; steps in a block.
PARTS, BLOCK = 12, 256


class ResponseSpectrum(NamedTuple):
    """Largest response of damped oscillators to a motion.

    ``periods`` has shape (p,) [s]. The other arrays have shape (p, ...), with the components of the
    motion last: ``displacement`` relative to the ground [m], ``pseudo_velocity``, omega times the
    displacement [m/s], ``pseudo_acceleration``, omega^2 times the displacement [m/s^2].
    """

    periods: Floats
    displacement: Floats
    pseudo_velocity: Floats
    pseudo_acceleration: Floats


def equally_spaced(time: ArrayLike, values: ArrayLike) -> tuple[float, Floats]:
    """Interpolate values to equal steps of the shortest step, if the steps differ.

    Args:
        time: increasing times, shape (n,), n at least 2, [s].
        values: shape (n, ...).

    Returns:
        The step [s] and the values, unchanged if the steps are equal already.
    """
    t, v = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    steps = np.diff(t)
    if len(t) < 2 or len(t) != len(v) or not (steps > 0.0).all():
        raise ValueError(f"Values at 2 or more increasing times are needed, got times {t}.")
    count = round((t[-1] - t[0]) / steps.min())
    dt = float((t[-1] - t[0]) / count)
    if np.allclose(steps, dt, rtol=1e-6, atol=0.0):
        return dt, v
    equal_times = np.linspace(t[0], t[-1], count + 1)
    columns_in = v.reshape(len(v), -1)
    columns = [np.interp(equal_times, t, column) for column in columns_in.T]
    return dt, np.stack(columns, axis=1).reshape(count + 1, *v.shape[1:])


@checked
def fourier_amplitude(signal: ArrayLike, dt: Seconds) -> tuple[Floats, Floats]:
    """Compute the Fourier amplitude, |integral of s(t) exp(-2 pi i f t) dt|.

    The integral is dt times the sum over the samples, without window or padding. A sine of
    amplitude A with a whole number of periods in the length T has the peak A T / 2.

    Args:
        signal: shape (n, ...).
        dt: time between samples [s].

    Returns:
        Frequencies 0, 1/(n dt), ... up to the Nyquist frequency [Hz], shape (n // 2 + 1,), and
        amplitudes, shape (n // 2 + 1, ...), in the unit of the signal times s.
    """
    values = _signal(signal)
    frequencies = np.asarray(np.fft.rfftfreq(len(values), dt))
    return frequencies, dt * np.abs(np.fft.rfft(values, axis=0))


def highest_peak(
    frequencies: Floats, amplitude: Floats, *, below: float = np.inf
) -> tuple[float, float]:
    """Return frequency and amplitude of the highest peak, NaN if there is no peak.

    A peak is higher than both neighbours. The mean of the signal (at zero frequency) and its flank
    are excluded: they may exceed all peaks if the signal does not end at its initial value.

    Args:
        frequencies: increasing from 0, shape (n,), [Hz].
        amplitude: shape (n,).
        below: upper bound of the frequency of a peak [Hz].
    """
    inner = amplitude[1:-1]
    is_peak = (inner > amplitude[:-2]) & (inner >= amplitude[2:]) & (frequencies[1:-1] < below)
    if not is_peak.any():
        return np.nan, np.nan
    where = 1 + int(np.argmax(np.where(is_peak, inner, -1.0)))
    return float(frequencies[where]), float(amplitude[where])


@checked
def response_spectrum(
    acceleration: ArrayLike, dt: Seconds, periods: ArrayLike, damping_ratio: DampingRatio
) -> ResponseSpectrum:
    """Return the response spectrum of a piecewise linear ground acceleration.

    Each oscillator obeys u'' + 2 zeta omega u' + omega^2 u = -a(t) from rest, solved in closed form
    between samples (Nigam and Jennings, Bull. Seism. Soc. Am. 59, 1969, 909-922). Peaks between
    samples and after the motion are included. A step is divided into parts h of at most a twelfth
    of the period; the peak in a part is computed from the cubic through both end states. The error
    is about (omega h)^4 / 384 of the largest accelerations of oscillator and ground, below 0.1 %.

    Args:
        acceleration: ground acceleration, shape (n, ...), [m/s^2].
        dt: time between samples [s].
        periods: natural periods, shape (p,), [s].
        damping_ratio: zeta, 0 <= zeta < 1.
    """
    values, natural = _signal(acceleration), _periods(periods)
    flat = values.reshape(len(values), -1)
    largest: Floats = np.zeros((len(natural), flat.shape[1]))
    parts = np.ceil(PARTS * dt / natural * (1.0 - ROUNDING)).astype(int)
    for states, loads in _oscillators(flat, dt, natural, damping_ratio):
        for count in np.unique(parts):
            rows = parts == count
            start = before = states[:-1, rows]
            for part in range(1, count + 1):
                end = states[1:, rows]
                if part < count:
                    by_state, by_load = _recursion(natural[rows], damping_ratio, dt, part / count)
                    end = by_state @ before + by_load @ loads
                largest[rows] = np.maximum(largest[rows], _highest(start, end, dt / count))
                start = end
    largest = np.maximum(largest, _free_vibration(states[-1], natural, damping_ratio))
    shaped = largest.reshape(len(natural), *values.shape[1:])
    factor = (2.0 * np.pi / natural).reshape(-1, *[1] * (values.ndim - 1))
    return ResponseSpectrum(natural, shaped, factor * shaped, factor**2 * shaped)


@checked
def response_history(
    acceleration: ArrayLike, dt: Seconds, periods: ArrayLike, damping_ratio: DampingRatio
) -> Floats:
    """Compute the displacement of oscillators relative to the ground, shape (n, p, ...), [m].

    The displacement is zero at the first sample. Arguments: see :func:`response_spectrum`.
    """
    values, natural = _signal(acceleration), _periods(periods)
    flat = values.reshape(len(values), -1)
    history: Floats = np.zeros((len(flat), len(natural), flat.shape[1]))
    blocks = _oscillators(flat, dt, natural, damping_ratio)
    np.concatenate([states[1:, :, 0] for states, _ in blocks], out=history[1:])
    return history.reshape(len(flat), len(natural), *values.shape[1:])


@checked
def arias_intensity(acceleration: ArrayLike, dt: Seconds) -> Floats:
    """Compute the cumulative Arias intensity pi / (2 g) * integral of a^2 dt, by trapezoids.

    Args:
        acceleration: shape (n, ...), [m/s^2].
        dt: time between samples [s].

    Returns:
        Shape (n, ...), [m/s]; zero at the first sample, the intensity of the motion at the last.
    """
    squares = _signal(acceleration) ** 2
    cumulative = np.zeros_like(squares)
    np.cumsum(0.5 * dt * (squares[:-1] + squares[1:]), axis=0, out=cumulative[1:])
    return np.pi / (2.0 * STANDARD_GRAVITY) * cumulative


@checked
def significant_duration(
    acceleration: ArrayLike, dt: Seconds, *, lower: Share = 0.05, upper: Share = 0.95
) -> tuple[float, float]:
    """Return the times when the Arias intensity reaches two shares of its final value.

    Args:
        acceleration: shape (n,) or (n, components), whose intensities are added, [m/s^2].
        dt: time between samples [s].
        lower: share at the first time.
        upper: share at the second time.

    Returns:
        Both times [s], interpolated linearly; their difference is the significant duration.
    """
    if lower >= upper:
        raise ValueError(f"lower is {lower}; it must be below upper, {upper}.")
    intensity = arias_intensity(acceleration, dt)
    total = intensity.reshape(len(intensity), -1).sum(axis=1)
    if total[-1] == 0.0:
        raise ValueError("A motion that is zero throughout has no significant duration.")
    shares = total / total[-1]
    return _first_reached(shares, lower) * dt, _first_reached(shares, upper) * dt


def _first_reached(shares: Floats, share: float) -> float:
    """Return the position, in samples, where an increasing sequence first reaches a value."""
    after = int(np.searchsorted(shares, share))
    if after == 0:
        return 0.0
    before = shares[after - 1]
    return float(after - 1 + (share - before) / (shares[after] - before))


def _periods(periods: ArrayLike) -> Floats:
    numbers = numbers_of(periods)
    natural: Floats = np.atleast_1d(np.nan if numbers is None else numbers)
    if natural.ndim != 1 or not ((natural > 0.0) & np.isfinite(natural)).all():
        raise ValueError(f"periods must be positive numbers of seconds, got {shown(periods, str)}.")
    return natural


def _oscillators(
    acceleration: Floats, dt: float, periods: Floats, damping_ratio: float
) -> Iterator[tuple[Floats, Floats]]:
    """Yield states (steps + 1, p, 2, columns) and loads (steps, 1, 2, columns) of each block."""
    homogeneous, by_load = _recursion(periods, damping_ratio, dt)
    state: Floats = np.zeros((len(periods), 2, acceleration.shape[1]))
    for first in range(0, len(acceleration) - 1, BLOCK):
        block = acceleration[first : first + BLOCK + 1]
        loads = np.stack([block[:-1], block[1:]], axis=1)[:, None]
        states = np.empty((len(block), *state.shape))
        states[0], states[1:] = state, by_load @ loads
        for i in range(1, len(states)):
            states[i] += homogeneous @ states[i - 1]
        state = states[-1]
        yield states, loads


def _highest(start: Floats, end: Floats, length: float) -> Floats:
    """Return the largest |u| of the cubics u + s (d + s (b + s c)) through both end states."""
    highest: Floats = np.abs(end[:, :, 0]).max(axis=0)
    turns = np.nonzero(start[:, :, 1] * end[:, :, 1] < 0.0)
    u, v = (np.moveaxis(start, 2, -1)[turns].T, np.moveaxis(end, 2, -1)[turns].T)
    d, rise = length * u[1], v[0] - u[0]
    c = d + length * v[1] - 2.0 * rise
    b = rise - d - c
    s = -d / (b - np.sign(d) * np.sqrt(np.maximum(b**2 - 3.0 * c * d, 0.0)))  # the slope is zero
    np.maximum.at(highest, turns[1:], np.abs(u[0] + s * (d + s * (b + s * c))))
    return highest


def _free_vibration(state: Floats, periods: Floats, zeta: float) -> Floats:
    """Return the largest free-vibration displacement from a state (p, 2, columns), (p, columns)."""
    omega = (2.0 * np.pi / periods)[:, None]
    u, v, ratio = state[:, 0], state[:, 1] / omega, np.sqrt(1.0 - zeta**2)
    angle = np.arctan2(ratio * v, u + zeta * v) % np.pi  # omega_d t of the first peak
    size: Floats = np.sqrt(u**2 + 2.0 * zeta * u * v + v**2)
    return np.exp(-zeta / ratio * angle) * size


def _recursion(periods: Floats, zeta: float, dt: float, part: float = 1.0) -> tuple[Floats, Floats]:
    """Return A and B of x1 = A x0 + B (a0, a1), x = (u, u'), for a part of a step, (p, 2, 2)."""
    omega, time = 2.0 * np.pi / periods, part * dt
    damped = omega * np.sqrt(1.0 - zeta**2)
    decay = np.exp(-zeta * omega * time)
    c, s = decay * np.cos(damped * time), decay * np.sin(damped * time) / damped
    homogeneous = _matrices([[c + zeta * omega * s, s], [-(omega**2) * s, c - zeta * omega * s]])
    # u = -(a0 + r t) / omega^2 + 2 zeta r / omega^3 with r = (a1 - a0) / dt satisfies the equation.
    rate = 1.0 / (omega**2 * dt)
    lag, static = 2.0 * zeta * rate / omega, omega**-2.0
    start = _matrices([[-static - lag, lag], [rate, -rate]])
    end = _matrices([[-(1.0 - part) * static - lag, lag - part * static], [rate, -rate]])
    return homogeneous, end - homogeneous @ start


def _matrices(entries: list[list[Any]]) -> Floats:
    """Return one matrix per period; the entries are arrays over the periods."""
    return np.moveaxis(np.array(entries), -1, 0)


def _signal(signal: ArrayLike) -> Floats:
    values = numbers_of(signal)
    if values is None or values.ndim < 1 or len(values) < 2 or not np.isfinite(values).all():
        got = shown(signal, str)
        raise ValueError(f"A signal must have at least 2 samples, finite numbers, got {got}.")
    if values.ndim == 2 and len(values) <= 3 < values.shape[1]:
        shape = f"{values.shape}, with samples along the second axis"
        raise ValueError(f"A signal must have shape (n, components), got {shape}; transpose it.")
    return values
