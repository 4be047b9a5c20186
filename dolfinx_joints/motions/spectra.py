# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fourier amplitude, spectrogram, response spectra, Arias intensity: pure functions of arrays.

Signals run along the first axis; further axes (components) are kept.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.parameters import LARGEST, SMALLEST, finite, numbers_of, real, shown
from dolfinx_joints.motions.motion import MOST_SAMPLES

Floats = NDArray[np.floating[Any]]


class ResponseSpectrum(NamedTuple):
    """Largest response of damped oscillators to one motion.

    Arrays have the shape of the motion's components after that of the periods, (p, ...):
    ``displacement`` relative to the ground [m], ``pseudo_velocity`` omega times it [m/s],
    ``pseudo_acceleration`` omega^2 times it [m/s^2]; ``periods`` (p,) [s].
    """

    periods: Floats
    displacement: Floats
    pseudo_velocity: Floats
    pseudo_acceleration: Floats


class Spectrogram(NamedTuple):
    """Amplitude of a signal's frequencies in a window that moves along it.

    Attributes:
        times: Middles of the windows, shape (windows,), counted from the first sample [s].
        frequencies: Shape (frequencies,), [Hz].
        amplitude: Shape (windows, frequencies); a sine of amplitude A shows A at its frequency.
    """

    times: Floats
    frequencies: Floats
    amplitude: Floats


def equally_spaced(time: ArrayLike, values: ArrayLike) -> tuple[float, Floats]:
    """Values at equal steps, interpolated to the shortest one where the steps differ.

    Args:
        time: rising, shape (n,), n at least 2, [s].
        values: shape (n, ...).

    Returns:
        The step [s] and the values, those given where the steps are equal already.
    """
    t, v = numbers_of(time), numbers_of(values)
    if t is None or v is None or t.ndim != 1 or v.ndim < 1 or len(t) < 2 or len(v) != len(t):
        raise ValueError(
            "At least 2 records with a time each are needed, got times "
            f"{shown(time, str)} and values {shown(values, str)}."
        )
    if not (finite(t) and (np.diff(t) > 0.0).all()):
        raise ValueError(f"Times must be finite and rise, got {shown(time, str)}.")
    steps = np.diff(t)
    if (t[-1] - t[0]) / steps.min() > MOST_SAMPLES:
        raise ValueError(
            f"Steps from {steps.min():.3g} to {steps.max():.3g} s make more than "
            f"{MOST_SAMPLES:.0e} equal ones."
        )
    count = round((t[-1] - t[0]) / steps.min())
    dt = float((t[-1] - t[0]) / count)
    if np.allclose(steps, dt, rtol=1e-6, atol=0.0):
        return dt, v
    equal = np.linspace(t[0], t[-1], count + 1)
    flat = v.reshape(len(v), -1)
    columns = [np.interp(equal, t, column) for column in flat.T]
    return dt, np.stack(columns, axis=1).reshape(count + 1, *v.shape[1:])


def windows(
    signal: ArrayLike, dt: float, window: float, hop: float | None
) -> tuple[Floats, Floats]:
    """Cut a signal into overlapping windows, all of them whole.

    Args:
        signal: shape (n,).
        dt: time between samples [s].
        window: length of a window [s], at least 8 samples and at most the signal.
        hop: time between windows [s], at least a sample; an eighth of a window unless given.

    Returns:
        Middles of the windows from the first sample on, shape (windows,), [s], and the samples,
        shape (windows, samples of a window).
    """
    values, dt = _signal(signal, dt)
    if values.ndim != 1:
        raise ValueError(f"A signal for windows must have shape (n,), got {values.shape}.")
    if not 7.5 * dt <= real(window) <= (len(values) + 0.5) * dt:
        raise ValueError(
            f"window must be from 8 samples, {8 * dt:.4g} s, to the whole signal, "
            f"{len(values) * dt:.4g} s, got {shown(window, str)} s."
        )
    if hop is not None and not 0.0 < real(hop) <= LARGEST:
        raise ValueError(f"hop must be a positive number of seconds, got {shown(hop, str)}.")
    size = min(max(round(window / dt), 8), len(values))
    stride = min(max(1, round((window / 8.0 if hop is None else hop) / dt)), len(values))
    parts: Floats = np.lib.stride_tricks.sliding_window_view(values, size)[::stride]
    return (0.5 * (size - 1) + stride * np.arange(len(parts))) * dt, parts


def spectrogram(
    signal: ArrayLike, dt: float, window: float, *, hop: float | None = None
) -> Spectrogram:
    """Amplitude against time and frequency, by Fourier transforms of Hann windows.

    The mean of each window is taken off, and it is padded with zeros to 8 times its length, which
    draws its spectrum finely but separates nothing closer than about 2 / window.

    Args:
        signal: shape (n,).
        dt: time between samples [s].
        window: length of a window [s].
        hop: time between windows [s], an eighth of one unless given.
    """
    middles, parts = windows(signal, dt, window, hop)
    size, dt = parts.shape[1], float(dt)
    weights = np.hanning(size + 1)[:-1]  # periodic: sines of whole periods do not leak into it
    centred = parts - (parts @ weights / weights.sum())[:, None]
    amplitude = 2.0 * np.abs(np.fft.rfft(weights * centred, 8 * size, axis=1)) / weights.sum()
    return Spectrogram(middles, np.fft.rfftfreq(8 * size, dt), amplitude)


def running_frequency(
    signal: ArrayLike,
    dt: float,
    window: float,
    *,
    band: tuple[float, float] | None = None,
    hop: float | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Main frequency and damping ratio of a signal in a window that moves along it.

    The frequency is that of the largest amplitude of :func:`spectrogram`, between its bins by a
    parabola through the logarithms. The damping ratio is the logarithmic decrement at that
    frequency from the first half of the window to the second. Of a freely decaying oscillation both
    are right within 1 % where half a window holds 4 periods or more. While the ground moves they
    tell of the ground as well: the damping is apparent, and negative where the motion grows.

    Args:
        signal: shape (n,).
        dt: time between samples [s].
        window: length of the window [s].
        band: lowest and highest frequency looked at [Hz]; from two periods in a window up to
            Nyquist's unless given.
        hop: time between windows [s], an eighth of one unless given.

    Returns:
        Middles of the windows from the first sample on [s], frequencies [Hz] and damping ratios,
        all of shape (windows,); NaN where nothing moves.
    """
    drawn = spectrogram(signal, dt, window, hop=hop)
    dt, window = float(dt), float(window)
    edges = numbers_of((2.0 / window, 0.5 / dt) if band is None else band)
    if edges is None or edges.shape != (2,):
        raise ValueError(f"band must be two frequencies, got {shown(band, str)}.")
    low, high = edges
    inner = slice(1, -1)
    allowed = (drawn.frequencies[inner] >= low) & (drawn.frequencies[inner] <= high)
    if not allowed.any():
        raise ValueError(f"band must hold frequencies, got {low:.4g} to {high:.4g} Hz.")
    top = 1 + np.argmax(np.where(allowed, drawn.amplitude[:, inner], -1.0), axis=1)
    moves = drawn.amplitude[np.arange(len(top)), top] > 1e-12 * np.abs(signal).max()
    frequency = np.where(moves, _between_bins(drawn, top), np.nan)
    _, parts = windows(signal, dt, window, hop)
    size = parts.shape[1] // 2
    first = _amplitude_at(parts[:, :size], dt, frequency)
    second = _amplitude_at(parts[:, size : 2 * size], dt, frequency)
    both = (first > 0.0) & (second > 0.0)
    ratio = np.divide(first, second, out=np.full_like(first, np.nan), where=both)
    decrement = np.log(ratio) / (2.0 * np.pi * frequency * size * dt)
    return drawn.times, frequency, decrement / np.sqrt(1.0 + decrement**2)


def fourier_amplitude(signal: ArrayLike, dt: float) -> tuple[Floats, Floats]:
    """Modulus of the Fourier transform, |integral of s(t) exp(-2 pi i f t) dt|.

    The integral is dt times the sum over the samples, without window or padding; a sine of
    amplitude A that fills the length T with whole periods has the peak A T / 2.

    Args:
        signal: shape (n, ...).
        dt: time between samples [s].

    Returns:
        The frequencies 0, 1/(n dt), ... up to Nyquist's [Hz], shape (n // 2 + 1,), and the
        amplitudes, shape (n // 2 + 1, ...), in the unit of the signal times s.
    """
    values, dt = _signal(signal, dt)
    frequencies: Floats = np.fft.rfftfreq(len(values), dt)
    return frequencies, dt * np.abs(np.fft.rfft(values, axis=0))


def highest_peak(
    frequencies: Floats, amplitude: Floats, *, below: float = np.inf
) -> tuple[float, float]:
    """Frequency and amplitude of the highest peak, NaN if there is none.

    A peak is above both its neighbours. The amplitude at zero, a signal's mean, is none, and
    neither is its flank: where a signal ends elsewhere than it began both may exceed all peaks.

    Args:
        frequencies: rising from 0, shape (n,), [Hz].
        amplitude: shape (n,).
        below: peaks at this frequency and above do not count [Hz].
    """
    inner = amplitude[1:-1]
    is_peak = (inner > amplitude[:-2]) & (inner >= amplitude[2:]) & (frequencies[1:-1] < below)
    if not is_peak.any():
        return np.nan, np.nan
    where = 1 + int(np.argmax(np.where(is_peak, inner, -1.0)))
    return float(frequencies[where]), float(amplitude[where])


def response_spectrum(
    acceleration: ArrayLike, dt: float, periods: ArrayLike, damping_ratio: float
) -> ResponseSpectrum:
    """Response spectrum by the exact recursion for piecewise linear ground acceleration.

    Each oscillator obeys u'' + 2 zeta omega u' + omega^2 u = -a(t) from rest. Between samples
    the solution is known in closed form (Nigam and Jennings, Bull. Seism. Soc. Am. 59, 1969,
    909-922), so the step brings no error at any period; the largest value is looked for at the
    samples, up to the end of the motion.

    Args:
        acceleration: of the ground, shape (n, ...), [m/s^2].
        dt: time between samples [s].
        periods: natural periods, shape (p,), [s].
        damping_ratio: zeta, from 0 to less than 1.

    Raises:
        ValueError: a period or the damping ratio is out of range.
    """
    (values, dt), natural = _signal(acceleration, dt), _periods(periods)
    flat = values.reshape(len(values), -1)
    largest = np.zeros((len(natural), flat.shape[1]))
    for displacement in _oscillators(flat, dt, natural, damping_ratio):
        np.maximum(largest, np.abs(displacement), out=largest)
    shaped = largest.reshape(len(natural), *values.shape[1:])
    factor = (2.0 * np.pi / natural).reshape(-1, *[1] * (values.ndim - 1))
    return ResponseSpectrum(natural, shaped, factor * shaped, factor**2 * shaped)


def response_history(
    acceleration: ArrayLike, dt: float, periods: ArrayLike, damping_ratio: float
) -> Floats:
    """Displacement of the oscillators of :func:`response_spectrum` relative to the ground.

    Args:
        acceleration: of the ground, shape (n, ...), [m/s^2].
        dt: time between samples [s].
        periods: natural periods, shape (p,), [s].
        damping_ratio: zeta, from 0 to less than 1.

    Returns:
        Shape (n, p, ...), zero at the first sample, [m].

    Raises:
        ValueError: a period or the damping ratio is out of range.
    """
    (values, dt), natural = _signal(acceleration, dt), _periods(periods)
    flat = values.reshape(len(values), -1)
    history: Floats = np.zeros((len(flat), len(natural), flat.shape[1]))
    for row, displacement in enumerate(_oscillators(flat, dt, natural, damping_ratio), start=1):
        history[row] = displacement
    return history.reshape(len(flat), len(natural), *values.shape[1:])


def arias_intensity(acceleration: ArrayLike, dt: float) -> Floats:
    """Cumulative Arias intensity pi / (2 g) * integral of a^2 dt, by trapezoids.

    Args:
        acceleration: shape (n, ...), [m/s^2].
        dt: time between samples [s].

    Returns:
        Shape (n, ...), [m/s]; zero at the first sample, the intensity of the motion at the last.
    """
    values, dt = _signal(acceleration, dt)
    square = values**2
    cumulative = np.zeros_like(square)
    np.cumsum(0.5 * dt * (square[1:] + square[:-1]), axis=0, out=cumulative[1:])
    return np.pi / (2.0 * STANDARD_GRAVITY) * cumulative


def significant_duration(
    acceleration: ArrayLike, dt: float, *, lower: float = 0.05, upper: float = 0.95
) -> tuple[float, float]:
    """Times between which the Arias intensity grows from one share of its end value to another.

    Args:
        acceleration: shape (n,), or (n, components) of which the intensities are added, [m/s^2].
        dt: time between samples [s].
        lower: share reached at the first time.
        upper: share reached at the second time.

    Returns:
        Both times [s], linear between samples; their difference is the significant duration.
    """
    if not 0.0 <= real(lower) < real(upper) <= 1.0:
        got = f"{shown(lower, str)} and {shown(upper, str)}"
        raise ValueError(f"lower and upper must rise within 0 to 1, got {got}.")
    intensity = arias_intensity(acceleration, dt)
    total = intensity.reshape(len(intensity), -1).sum(axis=1)
    if total[-1] == 0.0:
        raise ValueError("A motion that is zero throughout has no significant duration.")
    shares = total / total[-1]
    return _first_reached(shares, lower) * dt, _first_reached(shares, upper) * dt


def _between_bins(drawn: Spectrogram, top: NDArray[np.integer[Any]]) -> Floats:
    """Frequency at the top of the parabola through the logarithms of a bin and its neighbours."""
    rows, tiny = np.arange(len(top)), np.finfo(np.float64).tiny
    left, middle, right = (np.log(drawn.amplitude[rows, top + k] + tiny) for k in (-1, 0, 1))
    curvature = left - 2.0 * middle + right
    offset = np.zeros_like(middle)
    np.divide(0.5 * (left - right), curvature, out=offset, where=curvature < 0.0)
    found: Floats = drawn.frequencies[top] + np.clip(offset, -0.5, 0.5) * drawn.frequencies[1]
    return found


def _amplitude_at(parts: Floats, dt: float, frequency: Floats) -> Floats:
    """Modulus of the transform of each Hann window, at a frequency of its own."""
    weights = np.hanning(parts.shape[1] + 1)[:-1]
    centred = parts - (parts @ weights / weights.sum())[:, None]
    phase = np.exp(-2j * np.pi * frequency[:, None] * dt * np.arange(parts.shape[1]))
    amplitude: Floats = np.abs((weights * centred * phase).sum(axis=1))
    return amplitude


def _first_reached(shares: Floats, share: float) -> float:
    """Where a rising sequence first reaches a value, in samples, linear between them."""
    after = int(np.searchsorted(shares, share))
    if after == 0:
        return 0.0
    before = shares[after - 1]
    return float(after - 1 + (share - before) / (shares[after] - before))


def _periods(periods: ArrayLike) -> Floats:
    numbers = numbers_of(periods)
    natural: Floats = np.atleast_1d(np.nan if numbers is None else numbers)
    if natural.ndim != 1 or not ((natural >= SMALLEST) & (natural <= LARGEST)).all():
        raise ValueError(f"periods must be positive numbers of seconds, got {shown(periods, str)}.")
    return natural


def _oscillators(
    acceleration: Floats, dt: float, periods: Floats, damping_ratio: float
) -> Iterator[Floats]:
    """Displacements at the second sample, the third, ..., each of shape (p, columns), [m]."""
    if not 0.0 <= real(damping_ratio) < 1.0:
        got = shown(damping_ratio, str)
        raise ValueError(f"damping_ratio must be at least 0 and below 1, got {got}.")
    homogeneous, by_load = _recursion(2.0 * np.pi / periods, float(damping_ratio), dt)
    state: Floats = np.zeros((len(periods), 2, acceleration.shape[1]))
    for before, after in pairwise(acceleration):
        state = homogeneous @ state + by_load @ np.stack([before, after])
        yield state[:, 0]


def _recursion(omega: Floats, zeta: float, dt: float) -> tuple[Floats, Floats]:
    """Matrices of x1 = A x0 + B (a0, a1) with x = (u, u'), both of shape (p, 2, 2)."""
    damped = omega * np.sqrt(1.0 - zeta**2)
    decay = np.exp(-zeta * omega * dt)
    c, s = decay * np.cos(damped * dt), decay * np.sin(damped * dt) / damped
    homogeneous = _matrices([[c + zeta * omega * s, s], [-(omega**2) * s, c - zeta * omega * s]])
    # u = -(a0 + r t) / omega^2 + 2 zeta r / omega^3 with r = (a1 - a0) / dt satisfies the equation.
    rate = 1.0 / (omega**2 * dt)
    lag = 2.0 * zeta * rate / omega
    start = _matrices([[-(omega**-2.0) - lag, lag], [rate, -rate]])
    end = _matrices([[-lag, lag - omega**-2.0], [rate, -rate]])
    return homogeneous, end - homogeneous @ start


def _matrices(entries: list[list[Floats]]) -> Floats:
    """One matrix per period from entries that are arrays over the periods."""
    return np.moveaxis(np.array(entries), -1, 0)


def _signal(signal: ArrayLike, dt: float) -> tuple[Floats, float]:
    values = numbers_of(signal)
    if values is None:
        raise ValueError(f"A signal must be real numbers, got {shown(signal)}.")
    if values.ndim < 1 or len(values) < 2:
        raise ValueError(f"A signal must have at least 2 samples, got shape {values.shape}.")
    if not finite(values):
        raise ValueError(f"A signal must be finite, got NaN, infinity or more than {LARGEST:g}.")
    if not SMALLEST <= real(dt) <= LARGEST:
        raise ValueError(f"dt must be a positive number of seconds, got {shown(dt, str)}.")
    return values, float(dt)
