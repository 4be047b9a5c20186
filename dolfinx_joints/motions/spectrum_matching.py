# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Match ground motions to a target response spectrum by adding wavelets in the time domain.

First the Fourier amplitudes are brought near the target, with unchanged phases. Then tapered
cosines are added at the times of the peak responses of oscillators, after Al Atik and Abrahamson
(Earthquake Spectra 26, 2010, 601-617). Final velocity and displacement do not change.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve
from scipy.ndimage import gaussian_filter1d

from dolfinx_joints.common.arrays import Flags, Floats, Ints
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.processing import ROUNDING, fall, without_drift
from dolfinx_joints.motions.spectra import (
    arias_intensity,
    response_history,
    response_spectrum,
    significant_duration,
)

Whole = NDArray[np.intp]

SAMPLES = 10
"""Least number of samples in the shortest matched period; peaks between samples are then at most
5 % higher. Wavelets correct peaks at samples; misfits include peaks between samples."""

LENGTHS = 4
"""Least duration of the motion, in longest matched periods."""

_PERIOD_RATIO = 1.01  # largest ratio of neighbouring periods where spectrum and target are compared
_INTERVAL_RATIO = 1.02  # ratio of the ends of a period interval; wavelets are for its first period
_LARGE_RATIO = 2.0  # ratio of spectrum and target above which Fourier amplitudes are changed
_PASSES = 4  # largest number of passes that change Fourier amplitudes
_SMOOTHING = 5  # smoothing width of the factors of the amplitudes, in steps of 1 % of the period
_PEAKS = 12  # largest number of peaks of an oscillator that are controlled at the same time
_LEAST_PEAK = 0.5  # least height of a controlled peak, relative to the target
_SWAPS = 8  # largest number of updates of the active peaks in a fit
_DAMPING = 1e-2  # weight of squared amplitudes relative to squared misfits
_EMPHASIS_DECAY = 0.9  # exponent by which the emphasis on periods decays from round to round
_NORM = 8  # exponent of the misfit norm that selects the share of a correction
_PARTS = (1.0, 0.6, 0.3)  # shares of a correction that are tried


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectrumMatch:
    """Motion that was matched to a response spectrum, with a record of the changes.

    Attributes:
        motion: Matched motion.
        record: Original motion.
        components: The k matched components of ``x``, ``y``, ``z``.
        periods: Periods where the spectra are compared, shape (p,), [s].
        target: Target pseudo-acceleration at these periods, shape (p,), [m/s^2].
        damping_ratio: Damping ratio of the oscillators.
        tolerance: Allowed misfit.
        factors: Initial scale factor of each component, shape (k,).
        passes: Number of passes that changed Fourier amplitudes, shape (k,).
        rounds: Number of rounds that added wavelets, shape (k,).
    """

    motion: Motion
    record: Motion
    components: str
    periods: Floats
    target: Floats
    damping_ratio: float
    tolerance: float
    factors: Floats
    passes: Ints
    rounds: Ints

    @property
    def misfit_before(self) -> Floats:
        """Spectrum of the original motion divided by the target, minus 1, shape (p, k)."""
        return self._misfit(self.record)

    @property
    def misfit(self) -> Floats:
        """Spectrum of the matched motion divided by the target, minus 1, shape (p, k)."""
        return self._misfit(self.motion)

    def report(self) -> str:
        """Return a table of misfits, peaks, intensity and duration before and after matching."""
        lines = [
            f"{self.record.name}: spectra matched from {self.periods[0]:.4g} to "
            f"{self.periods[-1]:.4g} s, {self.damping_ratio:.3g} damping ratio",
            f"{'':18s}{'misfit %':>10s} {'at s':>8s} {'PGA g':>8s} {'PGV m/s':>8s} {'PGD m':>8s} "
            f"{'Arias m/s':>10s} {'5-95 % s':>9s}",
        ]
        before, after = self.misfit_before, self.misfit
        for k, name in enumerate(self.components):
            lines.append(_line(f"{name} as given", self.record, name, self.periods, before[:, k]))
            lines.append(_line(f"{name} matched", self.motion, name, self.periods, after[:, k]))
            lines.append(
                f"{name}: scaled by {self.factors[k]:.4g}, Fourier amplitudes changed in "
                f"{self.passes[k]} passes, wavelets added in {self.rounds[k]} rounds"
            )
        return "\n".join(lines)

    def with_rest(self, motion: Motion) -> Motion:
        """Append zeros to a motion, for the peaks of free vibrations after the motion."""
        after = _free_vibration_samples(motion.dt, self.periods, self.damping_ratio)
        return replace(motion, acceleration=np.pad(motion.acceleration, ((0, after), (0, 0))))

    def _misfit(self, motion: Motion) -> Floats:
        values = self.with_rest(motion).acceleration[:, component_numbers(self.components)]
        spectrum = response_spectrum(values, motion.dt, self.periods, self.damping_ratio)
        return spectrum.pseudo_acceleration / self.target[:, None] - 1.0


@checked
def match_spectrum(
    motion: Motion,
    target: tuple[ArrayLike, ArrayLike] | NDArray[Any],
    *,
    components: str = "xy",
    damping_ratio: Annotated[float, at.Interval(ge=0.005, le=0.3)] = 0.05,
    tolerance: Annotated[float, at.Interval(ge=0.02, le=0.5)] = 0.1,
    rounds: Annotated[int, at.Ge(1)] = 40,
) -> SpectrumMatch:
    """Match the response spectrum of a motion to a target.

    Each component is scaled to the level of the target (geometric mean). If its spectrum is then
    less than half or more than double the target, Fourier amplitudes are changed by smooth factors.
    Then wavelets, which fade at both ends of the motion, are added until all misfits are within the
    tolerance. Free vibrations after the motion are included. The target is interpolated linearly in
    log-log axes and compared at period steps of 1 %.

    Args:
        motion: the motion, with its baseline corrected.
        target: increasing periods [s] and pseudo-accelerations [m/s^2], at least 2 of each. The
            shortest period must have 10 samples; the motion must have 4 of the longest periods.
        components: letters of the components ``x``, ``y``, ``z`` to match; others do not change.
        damping_ratio: damping ratio of the oscillators, from 0.005 to 0.3.
        tolerance: misfit allowed at any period, 0.02 to 0.5 of the target.
        rounds: largest number of rounds that add wavelets.
    """
    columns = component_numbers(components)
    periods, wanted = _refine(*_target(motion, target))
    matcher = _Matcher(len(motion.acceleration), motion.dt, periods, wanted, damping_ratio)
    values, factors, counts_used = motion.acceleration.copy(), [], []
    for component, column in zip(components, columns, strict=True):
        if not values[:, column].any():
            raise RecordError(f"Component {component} of {motion.name!r} is zero throughout.")
        matched, factor, counts, worst = matcher.match(values[:, column], tolerance, rounds)
        if abs(worst[0]) > tolerance:
            raise RecordError(
                f"The spectrum of component {component} of {motion.name!r} was not matched within "
                f"{rounds} rounds: its largest misfit is {worst[0]:+.2%} at {worst[1]:.4g} s, the "
                f"tolerance is {tolerance:.2%}. Use a record whose spectrum is closer to the "
                "target, fewer periods, or a larger tolerance."
            )
        values[:, column] = matched
        factors.append(factor)
        counts_used.append(counts)
    return SpectrumMatch(
        motion=replace(motion, acceleration=values),
        record=motion,
        components=components,
        periods=periods,
        target=wanted,
        damping_ratio=damping_ratio,
        tolerance=tolerance,
        factors=np.array(factors),
        passes=np.array(counts_used, dtype=np.int64)[:, 0],
        rounds=np.array(counts_used, dtype=np.int64)[:, 1],
    )


def component_numbers(components: str) -> list[int]:
    """Return the columns of components."""
    if not components or len(components) != len(set(components) & set("xyz")):
        got = shown(components)
        raise ValueError(f"components is {got}; it must be different letters of xyz, such as 'xy'.")
    return ["xyz".index(letter) for letter in components]


class _Matcher:
    """Oscillators of a target, their impulse responses, and wavelets that change their peaks.

    Responses are pseudo-accelerations divided by the target.
    """

    def __init__(self, count: int, dt: float, periods: Floats, target: Floats, zeta: float) -> None:
        self.given, self.count = count, count + _free_vibration_samples(dt, periods, zeta)
        self.dt, self.periods, self.zeta = dt, periods, zeta
        omega = 2.0 * np.pi / periods
        self.scale = omega**2 / target
        self.damped = omega * np.sqrt(1.0 - zeta**2)
        # Delay between the middle of a wavelet and the largest response of its oscillator.
        self.lag = np.arctan(np.sqrt(1.0 - zeta**2) / zeta) / self.damped
        self.width = 1.178 * periods**0.93  # after Al Atik and Abrahamson
        steps = np.log(periods / periods[0]) / np.log(_INTERVAL_RATIO)
        self.matched = np.unique(np.floor(steps + ROUNDING), return_index=True)[1]
        self.even = np.geomspace(periods[0], periods[-1], 2 + 2 * int(steps[-1]))
        impulses = np.zeros((self.count, 2))
        impulses[1, 0] = impulses[0, 1] = 1.0
        responses = response_history(impulses, dt, periods[self.matched], zeta)
        self.to_inner = responses[1:, :, 0].T.copy()  # response to a unit sample, from this sample
        self.to_first = responses[:, :, 1].T.copy()  # the first sample has no ramp before it

    def match(
        self, values: Floats, tolerance: float, rounds: int
    ) -> tuple[Floats, float, tuple[int, int], tuple[float, float]]:
        """Return best acceleration, factor, passes and rounds, and worst misfit with its period."""
        values = np.append(values, np.zeros(self.count - self.given))
        factor = float(np.exp(self._log_misfit(values).mean()))
        values, passes = self._with_scaled_amplitudes(factor * values)
        responses = self._responses(values)
        best, best_round, least = values, 0, self._ratio(values) - 1.0
        misfit, emphasis = least, np.ones(len(self.matched))
        for number in range(1, rounds + 1):
            if np.abs(least).max() <= tolerance:
                break
            # Increase the weight of peaks that remain off the target because of their neighbours.
            emphasis *= 1.0 + np.minimum(np.abs(misfit[self.matched]) / tolerance, 1.0) ** 2
            emphasis = (emphasis / np.exp(np.log(emphasis).mean())) ** _EMPHASIS_DECAY
            correction = self._correction(responses, emphasis)
            change = self._responses(correction)
            misfits = self._ratio(values[:, None] + np.outer(correction, _PARTS)) - 1.0
            chosen = int(np.argmin(np.sum(misfits**_NORM, axis=0)))
            part, misfit = _PARTS[chosen], misfits[:, chosen]
            values, responses = values + part * correction, responses + part * change
            if np.abs(misfit).max() < np.abs(least).max():
                best, best_round, least = values, number, misfit
        worst = int(np.argmax(np.abs(least)))
        nearest = float(least[worst]), float(self.periods[worst])
        return best[: self.given], factor, (passes, best_round), nearest

    def _responses(self, values: Floats) -> Floats:
        """Return the responses of all oscillators to an acceleration (n,), shape (n, p)."""
        history = response_history(values, self.dt, self.periods, self.zeta)
        return np.asarray(self.scale * history)

    def _ratio(self, values: Floats) -> Floats:
        """Return the spectrum of accelerations (n, ...) divided by the target, shape (p, ...)."""
        largest = response_spectrum(values, self.dt, self.periods, self.zeta).displacement
        return np.asarray((self.scale * largest.T).T)

    def _log_misfit(self, values: Floats) -> Floats:
        """Return log(target / spectrum) at even steps of log(period)."""
        return np.interp(self.even, self.periods, -np.log(self._ratio(values)))

    def _with_scaled_amplitudes(self, values: Floats) -> tuple[Floats, int]:
        """Scale the Fourier amplitudes of a motion; return the motion and the number of passes."""
        padded = 2 * self.count  # avoids wrap-around between the two ends
        spectrum, frequency = np.fft.rfft(values, padded), np.fft.rfftfreq(padded, self.dt)
        # The gain is 1 from twice the longest period on, to keep the long-period displacement.
        nodes = np.append(0.5 / self.periods[-1], 1.0 / self.even[::-1])
        envelope = self._window(self.periods[0])
        changed, logarithms = values, np.zeros(len(self.even))
        for number in range(_PASSES):
            log_misfit = self._log_misfit(changed)
            if np.abs(log_misfit).max() <= np.log(_LARGE_RATIO):
                return changed, number
            logarithms += gaussian_filter1d(log_misfit, _SMOOTHING, mode="nearest")  # (12ag)
            gain = np.exp(np.interp(frequency, nodes, np.append(0.0, logarithms[::-1])))
            change = envelope * np.fft.irfft(spectrum * (gain - 1.0), padded)[: self.count]
            changed = values + without_drift(change[:, None], envelope, self.dt)[:, 0]
        return changed, _PASSES

    def _correction(self, responses: Floats, emphasis: Floats) -> Floats:
        """Return the sum of wavelets that brings the peaks to the target, shape (n,)."""
        rows, places, highest = self._peaks(responses)
        oscillators = self.matched[rows]
        peaks = responses[places, oscillators]
        deficit = 1.0 - np.abs(peaks)
        sampled = np.zeros((len(rows), self.count))
        for k, (row, place) in enumerate(zip(rows, places, strict=True)):
            sampled[k, 1 : place + 1] = self.to_inner[row, :place][::-1]
            sampled[k, 0] = self.to_first[row, place]
        sampled *= (np.sign(peaks) * self.scale[oscillators])[:, None]
        chosen = np.flatnonzero(highest | (deficit < 0.0))  # peaks that have a wavelet
        wavelets = np.array([self._wavelet(int(oscillators[k]), int(places[k])) for k in chosen]).T
        effects = sampled @ wavelets
        size = np.abs(effects).max(axis=0)
        amplitudes = _amplitudes(effects / size, deficit, highest, emphasis[rows])
        return np.asarray(wavelets @ (amplitudes / size))

    def _peaks(self, responses: Floats) -> tuple[Whole, Whole, Flags]:
        """Return oscillator and sample of each controlled peak, and True for the highest peaks."""
        controlled: list[tuple[int, int, bool]] = []
        for row, oscillator in enumerate(self.matched):
            size = np.abs(responses[:, oscillator])
            after = np.append(size[2:], 0.0)  # the last sample may be a peak
            peaks = 1 + np.flatnonzero((size[1:] >= size[:-1]) & (size[1:] > after))
            order = peaks[np.argsort(-size[peaks], kind="stable")][:_PEAKS]
            controlled.append((row, int(order[0]), True))
            controlled.extend(
                (row, int(place), False) for place in order[1:] if size[place] > _LEAST_PEAK
            )
        rows, places, highest = zip(*controlled, strict=True)
        return np.array(rows), np.array(places), np.array(highest)

    def _wavelet(self, oscillator: int, place: int) -> Floats:
        """Return the tapered cosine with its peak response at a sample, without final drift."""
        time = self.dt * (np.arange(self.count) - place) + self.lag[oscillator]
        width = self.width[oscillator]
        envelope = np.exp(-((time / width) ** 2)) * self._window(width)
        wave = np.cos(self.damped[oscillator] * time) * envelope
        return without_drift(wave[:, None], envelope, self.dt)[:, 0]  # (12ai)

    def _window(self, length: float) -> Floats:
        """Return a window that falls to zero over a length [s] at both ends of the motion."""
        sample = np.arange(self.count)
        inside = self.dt * np.minimum(sample, self.given - 1 - sample)
        return 1.0 - fall(inside, 0.0, length)


def _amplitudes(effects: Floats, deficit: Floats, highest: Flags, weight: Floats) -> Floats:
    """Fit the amplitudes of wavelets by least squares, shape (w,).

    The highest peaks are fitted to the target; other peaks must not exceed it. ``effects``, shape
    (m, w), are the changes of peaks by unit wavelets; ``deficit`` is target minus peak, shape (m,).
    """
    active = highest | (deficit < 0.0)
    for _ in range(_SWAPS):  # (12aj)
        weighted = (weight[:, None] * effects)[active]
        matrix = weighted.T @ weighted + _DAMPING * np.eye(effects.shape[1])
        amplitudes: Floats = solve(matrix, weighted.T @ (weight * deficit)[active], assume_a="pos")
        previous, active = active, highest | (effects @ amplitudes > deficit)
        if (active == previous).all():
            break
    return amplitudes


def _free_vibration_samples(dt: float, periods: Floats, zeta: float) -> int:
    """Return the number of samples after a motion that cover the peaks of free vibrations."""
    return int(np.ceil(0.5 * periods[-1] / np.sqrt(1.0 - zeta**2) / dt)) + 1


def _target(motion: Motion, target: Any) -> tuple[Floats, Floats]:
    """Check a target, and return its periods and accelerations."""
    pair = numbers_of(target)
    if (
        pair is None
        or pair.ndim != 2
        or len(pair) != 2
        or pair.shape[1] < 2
        or not ((pair > 0.0) & np.isfinite(pair)).all()
        or not (np.diff(pair[0]) > 0.0).all()
    ):
        raise RecordError(
            "target must be a pair: 2 or more increasing periods [s] and the same number of "
            f"pseudo-accelerations [m/s^2], all positive and finite, got {shown(target)}."
        )
    periods, values = pair
    if periods[0] < SAMPLES * motion.dt * (1.0 - ROUNDING):
        raise RecordError(
            f"The target begins at {periods[0]:.6g} s; with samples every {motion.dt:.6g} s the "
            f"limit is {SAMPLES * motion.dt:.6g} s. Resample the motion, or shorten the target."
        )
    if periods[-1] * LENGTHS > motion.duration * (1.0 + ROUNDING):
        raise RecordError(
            f"The target ends at {periods[-1]:.6g} s; for a motion of {motion.duration:.6g} s the "
            f"limit is {motion.duration / LENGTHS:.6g} s. Shorten the target."
        )
    return periods, values


def _refine(periods: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the target with periods inserted, so that neighbours differ by at most 1 %."""
    parts = np.ceil(np.log(periods[1:] / periods[:-1]) / np.log(_PERIOD_RATIO) - ROUNDING)
    parts_of = [
        np.geomspace(a, b, int(max(count, 1.0)), endpoint=False)
        for a, b, count in zip(periods[:-1], periods[1:], parts, strict=True)
    ]
    refined = np.concatenate([*parts_of, periods[-1:]])
    return refined, np.exp(np.interp(np.log(refined), np.log(periods), np.log(values)))


def _line(label: str, motion: Motion, name: str, periods: Floats, misfit: Floats) -> str:
    """Return the row of the report for a component of a motion."""
    column = "xyz".index(name)
    values = motion.acceleration[:, column]
    velocity, displacement = (np.abs(part[:, column]).max() for part in motion.integrated())
    start, end = significant_duration(values, motion.dt)
    worst = int(np.argmax(np.abs(misfit)))
    return (
        f"{label:18s}{100.0 * misfit[worst]:10.1f} {periods[worst]:8.3g} "
        f"{np.abs(values).max() / STANDARD_GRAVITY:8.3f} {velocity:8.3f} {displacement:8.3f} "
        f"{float(arias_intensity(values, motion.dt)[-1]):10.3f} {end - start:9.2f}"
    )
