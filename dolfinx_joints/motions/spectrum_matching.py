# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Match ground motions to a target response spectrum by wavelets that are added in time.

Amplitudes of frequencies are brought near the target first, their phases kept. Then, after Al Atik
and Abrahamson (Earthquake Spectra 26, 2010, 601-617), tapered cosines are added at the times when
oscillators answer most. Final velocity and displacement are left as they are.
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
"""In the shortest period that is matched; a peak between two samples is then 5 % higher at most.
Wavelets are made for samples, misfits count peaks between samples too."""

LENGTHS = 4
"""How often the longest period that is matched must fit into the motion."""

_CHECKED = 1.01  # ratio of neighbouring periods where the spectrum is compared with the target
_MATCHED = 1.02  # wavelets are made for the first period in each step by this
_FAR = 2.0  # ratio of spectrum and target from which on amplitudes of frequencies are changed,
_PASSES = 4  # so often at most, by factors that are
_SMOOTHED = 5  # smoothed over so many steps of 1 %
_PEAKS = 12  # of an oscillator that are looked after at once, above this part of the target:
_NEAR = 0.5
_SWAPS = 8  # of peaks below the target that would rise above it
_DAMPED = 1e-2  # weight of squares of amplitudes, to squares of misfits
_FORGOTTEN = 0.9  # power by which emphasis on periods fades from round to round
_NORM = 8  # of the misfit that decides how much of a correction is added
_PARTS = (1.0, 0.6, 0.3)


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectrumMatch:
    """A motion that was matched to a response spectrum, and the changes.

    Attributes:
        motion: The matched motion.
        record: The motion as it was given.
        components: Which of ``x``, ``y``, ``z`` were matched, k of them.
        periods: Where the spectra were compared, shape (p,), [s].
        target: Pseudo-acceleration wanted there, shape (p,), [m/s^2].
        damping_ratio: Of the oscillators.
        tolerance: Misfit that was allowed.
        factors: By which components were scaled at first, shape (k,).
        passes: How often amplitudes of frequencies were changed then, shape (k,).
        rounds: How often wavelets were added, shape (k,).
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
        """Spectrum of the record, as it was given, over the target, less 1, shape (p, k)."""
        return self._misfit(self.record)

    @property
    def misfit(self) -> Floats:
        """Spectrum of the matched motion over the target, less 1, shape (p, k)."""
        return self._misfit(self.motion)

    def report(self) -> str:
        """Misfits, factors, peaks, intensity and duration of each component before and after."""
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
                f"{name}: scaled by {self.factors[k]:.4g}, frequencies in {self.passes[k]} passes, "
                f"then wavelets in {self.rounds[k]} rounds"
            )
        return "\n".join(lines)

    def with_rest(self, motion: Motion) -> Motion:
        """A motion and rest after it, in which free vibrations have their peaks."""
        after = _free(motion.dt, self.periods, self.damping_ratio)
        return replace(motion, acceleration=np.pad(motion.acceleration, ((0, after), (0, 0))))

    def _misfit(self, motion: Motion) -> Floats:
        values = self.with_rest(motion).acceleration[:, component_numbers(self.components)]
        found = response_spectrum(values, motion.dt, self.periods, self.damping_ratio)
        return found.pseudo_acceleration / self.target[:, None] - 1.0


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
    """Change a motion until its response spectrum is a given one.

    Each component is scaled so that its spectrum has the level of the target (geometric mean).
    Where it is then less than half or more than double the target, amplitudes of frequencies are
    changed by smooth factors. Then wavelets, which fade at both ends of the motion, are added until
    all misfits are within the tolerance, those of free vibrations after the motion as well.
    Between the periods of the target it lies on straight lines in a plot with both axes
    logarithmic, and is compared at steps of 1 %.

    Args:
        motion: the motion, with its baseline corrected.
        target: rising periods [s] and pseudo-accelerations [m/s^2], 2 or more of each. Periods
            have 10 samples or more and fit 4 times or more into the motion.
        components: which of ``x``, ``y``, ``z`` to match; the others stay as they are.
        damping_ratio: of the oscillators, from 0.005 to 0.3.
        tolerance: misfit allowed at any period, 0.02 to 0.5 of the target.
        rounds: of adding wavelets, at most.
    """
    columns = component_numbers(components)
    periods, wanted = _filled(*_target(motion, target))
    matcher = _Matcher(len(motion.acceleration), motion.dt, periods, wanted, damping_ratio)
    values, factors, used = motion.acceleration.copy(), [], []
    for component, column in zip(components, columns, strict=True):
        if not values[:, column].any():
            raise RecordError(f"Component {component} of {motion.name!r} is zero throughout.")
        matched, factor, counts, worst = matcher.match(values[:, column], tolerance, rounds)
        if abs(worst[0]) > tolerance:
            raise RecordError(
                f"The spectrum of component {component} of {motion.name!r} came no nearer to the "
                f"target than {worst[0]:+.2%}, at {worst[1]:.4g} s, in {rounds} rounds; tolerance "
                f"is {tolerance:.2%}. Take a record whose spectrum is more like the target, fewer "
                "periods, or a wider tolerance."
            )
        values[:, column] = matched
        factors.append(factor)
        used.append(counts)
    return SpectrumMatch(
        motion=replace(motion, acceleration=values),
        record=motion,
        components=components,
        periods=periods,
        target=wanted,
        damping_ratio=damping_ratio,
        tolerance=tolerance,
        factors=np.array(factors),
        passes=np.array(used, dtype=np.int64)[:, 0],
        rounds=np.array(used, dtype=np.int64)[:, 1],
    )


def component_numbers(components: str) -> list[int]:
    """Columns of components."""
    if not components or len(components) != len(set(components) & set("xyz")):
        got = shown(components)
        raise ValueError(f"components is {got}; it must be different ones of x, y, z, as 'xy'.")
    return ["xyz".index(each) for each in components]


class _Matcher:
    """Oscillators of a target, their answers to single samples, and wavelets for their peaks.

    Displacements of oscillators are kept as pseudo-accelerations in units of the target.
    """

    def __init__(self, count: int, dt: float, periods: Floats, target: Floats, zeta: float) -> None:
        self.given, self.count = count, count + _free(dt, periods, zeta)
        self.dt, self.periods, self.zeta = dt, periods, zeta
        omega = 2.0 * np.pi / periods
        self.scale = omega**2 / target
        self.damped = omega * np.sqrt(1.0 - zeta**2)
        # From the middle of a wavelet to the largest answer of its oscillator.
        self.lag = np.arctan(np.sqrt(1.0 - zeta**2) / zeta) / self.damped
        self.width = 1.178 * periods**0.93  # after Al Atik and Abrahamson
        steps = np.log(periods / periods[0]) / np.log(_MATCHED)
        self.matched = np.unique(np.floor(steps + ROUNDING), return_index=True)[1]
        self.even = np.geomspace(periods[0], periods[-1], 2 + 2 * int(steps[-1]))
        impulses = np.zeros((self.count, 2))
        impulses[1, 0] = impulses[0, 1] = 1.0
        answers = response_history(impulses, dt, periods[self.matched], zeta)
        self.to_inner = answers[1:, :, 0].T.copy()  # to a sample, from its own time on
        self.to_first = answers[:, :, 1].T.copy()  # the first one rises from nothing

    def match(
        self, values: Floats, tolerance: float, rounds: int
    ) -> tuple[Floats, float, tuple[int, int], tuple[float, float]]:
        """The nearest acceleration found, its factor, passes, rounds, worst misfit and period."""
        values = np.append(values, np.zeros(self.count - self.given))
        factor = float(np.exp(self._missing(values).mean()))
        values, passes = self._coloured(factor * values)
        answers = self._answers(values)
        best, best_round, least = values, 0, self._ratio(values) - 1.0
        misfit, emphasis = least, np.ones(len(self.matched))
        for number in range(1, rounds + 1):
            if np.abs(least).max() <= tolerance:
                break
            # Peaks that stay behind because of their neighbours count more and more.
            emphasis *= 1.0 + np.minimum(np.abs(misfit[self.matched]) / tolerance, 1.0) ** 2
            emphasis = (emphasis / np.exp(np.log(emphasis).mean())) ** _FORGOTTEN
            correction = self._correction(answers, emphasis)
            change = self._answers(correction)
            misfits = self._ratio(values[:, None] + np.outer(correction, _PARTS)) - 1.0
            chosen = int(np.argmin(np.sum(misfits**_NORM, axis=0)))
            part, misfit = _PARTS[chosen], misfits[:, chosen]
            values, answers = values + part * correction, answers + part * change
            if np.abs(misfit).max() < np.abs(least).max():
                best, best_round, least = values, number, misfit
        worst = int(np.argmax(np.abs(least)))
        nearest = float(least[worst]), float(self.periods[worst])
        return best[: self.given], factor, (passes, best_round), nearest

    def _answers(self, values: Floats) -> Floats:
        """Of all oscillators to an acceleration (n,), shape (n, p)."""
        history = response_history(values, self.dt, self.periods, self.zeta)
        return np.asarray(self.scale * history)

    def _ratio(self, values: Floats) -> Floats:
        """Spectrum over target of accelerations (n, ...), shape (p, ...)."""
        largest = response_spectrum(values, self.dt, self.periods, self.zeta).displacement
        return np.asarray((self.scale * largest.T).T)

    def _missing(self, values: Floats) -> Floats:
        """Logarithm of target over spectrum at even steps, however dense the target is given."""
        return np.interp(self.even, self.periods, -np.log(self._ratio(values)))

    def _coloured(self, values: Floats) -> tuple[Floats, int]:
        """The motion with other amplitudes of its frequencies, and passes it took."""
        padded = 2 * self.count  # long enough that nothing comes round from one end to the other
        spectrum, frequency = np.fft.rfft(values, padded), np.fft.rfftfreq(padded, self.dt)
        # Twice the longest period and longer ones keep theirs, and displacements what is in them.
        known = np.append(0.5 / self.periods[-1], 1.0 / self.even[::-1])
        envelope = self._faded(self.periods[0])
        changed, logarithms = values, np.zeros(len(self.even))
        for number in range(_PASSES):
            missing = self._missing(changed)
            if np.abs(missing).max() <= np.log(_FAR):
                return changed, number
            logarithms += gaussian_filter1d(missing, _SMOOTHED, mode="nearest")  # (12ag)
            gain = np.exp(np.interp(frequency, known, np.append(0.0, logarithms[::-1])))
            change = envelope * np.fft.irfft(spectrum * (gain - 1.0), padded)[: self.count]
            changed = values + without_drift(change[:, None], envelope, self.dt)[:, 0]
        return changed, _PASSES

    def _correction(self, answers: Floats, emphasis: Floats) -> Floats:
        """Sum of wavelets that would bring the peaks to the target, shape (n,)."""
        rows, places, highest = self._peaks(answers)
        oscillators = self.matched[rows]
        peaks = answers[places, oscillators]
        lacking = 1.0 - np.abs(peaks)
        sampled = np.zeros((len(rows), self.count))
        for k, (row, place) in enumerate(zip(rows, places, strict=True)):
            sampled[k, 1 : place + 1] = self.to_inner[row, :place][::-1]
            sampled[k, 0] = self.to_first[row, place]
        sampled *= (np.sign(peaks) * self.scale[oscillators])[:, None]
        own = np.flatnonzero(highest | (lacking < 0.0))  # peaks that have a wavelet
        wavelets = np.array([self._wavelet(int(oscillators[k]), int(places[k])) for k in own]).T
        effects = sampled @ wavelets
        size = np.abs(effects).max(axis=0)
        amplitudes = _amplitudes(effects / size, lacking, highest, emphasis[rows])
        return np.asarray(wavelets @ (amplitudes / size))

    def _peaks(self, answers: Floats) -> tuple[Whole, Whole, Flags]:
        """Matched oscillator and sample of each peak to look after; is it the highest of it?"""
        found: list[tuple[int, int, bool]] = []
        for row, oscillator in enumerate(self.matched):
            size = np.abs(answers[:, oscillator])
            after = np.append(size[2:], 0.0)  # the last sample may be a peak
            peaks = 1 + np.flatnonzero((size[1:] >= size[:-1]) & (size[1:] > after))
            order = peaks[np.argsort(-size[peaks], kind="stable")][:_PEAKS]
            found.append((row, int(order[0]), True))
            found.extend((row, int(place), False) for place in order[1:] if size[place] > _NEAR)
        rows, places, highest = zip(*found, strict=True)
        return np.array(rows), np.array(places), np.array(highest)

    def _wavelet(self, oscillator: int, place: int) -> Floats:
        """Tapered cosine whose largest answer is at a sample; it ends at rest where it began."""
        time = self.dt * (np.arange(self.count) - place) + self.lag[oscillator]
        width = self.width[oscillator]
        envelope = np.exp(-((time / width) ** 2)) * self._faded(width)
        wave = np.cos(self.damped[oscillator] * time) * envelope
        return without_drift(wave[:, None], envelope, self.dt)[:, 0]  # (12ai)

    def _faded(self, length: float) -> Floats:
        """One within the motion, falling over a length [s] to zero at both ends and after it."""
        sample = np.arange(self.count)
        inside = self.dt * np.minimum(sample, self.given - 1 - sample)
        return 1.0 - fall(inside, 0.0, length)


def _amplitudes(effects: Floats, lacking: Floats, highest: Flags, weight: Floats) -> Floats:
    """Least squares: the highest peaks reach the target, others do not rise above it; shape (w,).

    Effects, shape (m, w), are those of wavelets of amplitude one on peaks, ``lacking`` is what
    these lack to the target, negative above it.
    """
    active = highest | (lacking < 0.0)
    for _ in range(_SWAPS):  # (12aj)
        weighted = (weight[:, None] * effects)[active]
        matrix = weighted.T @ weighted + _DAMPED * np.eye(effects.shape[1])
        amplitudes: Floats = solve(matrix, weighted.T @ (weight * lacking)[active], assume_a="pos")
        before, active = active, highest | (effects @ amplitudes > lacking)
        if (active == before).all():
            break
    return amplitudes


def _free(dt: float, periods: Floats, zeta: float) -> int:
    """Samples after a motion in which free vibrations of all oscillators have their peaks."""
    return int(np.ceil(0.5 * periods[-1] / np.sqrt(1.0 - zeta**2) / dt)) + 1


def _target(motion: Motion, target: Any) -> tuple[Floats, Floats]:
    """Periods and accelerations of a target that a motion can be matched to."""
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
            "target must be a pair, 2 or more periods [s] that rise and as many "
            f"pseudo-accelerations [m/s^2], all positive and finite, got {shown(target)}."
        )
    periods, wanted = pair
    if periods[0] < SAMPLES * motion.dt * (1.0 - ROUNDING):
        raise RecordError(
            f"The target begins at {periods[0]:.6g} s; with samples every {motion.dt:.6g} s it may "
            f"begin at {SAMPLES * motion.dt:.6g} s. Resample the motion, or cut the target."
        )
    if periods[-1] * LENGTHS > motion.duration * (1.0 + ROUNDING):
        raise RecordError(
            f"The target ends at {periods[-1]:.6g} s; in a motion of {motion.duration:.6g} s it "
            f"may end at {motion.duration / LENGTHS:.6g} s."
        )
    return periods, wanted


def _filled(periods: Floats, wanted: Floats) -> tuple[Floats, Floats]:
    """The target with periods in between, so that neighbours are not more than 1 % apart."""
    parts = np.ceil(np.log(periods[1:] / periods[:-1]) / np.log(_CHECKED) - ROUNDING)
    parts_of = [
        np.geomspace(a, b, int(max(count, 1.0)), endpoint=False)
        for a, b, count in zip(periods[:-1], periods[1:], parts, strict=True)
    ]
    filled = np.concatenate([*parts_of, periods[-1:]])
    return filled, np.exp(np.interp(np.log(filled), np.log(periods), np.log(wanted)))


def _line(what: str, motion: Motion, name: str, periods: Floats, misfit: Floats) -> str:
    """Row of the report: a component of a motion."""
    column = "xyz".index(name)
    values = motion.acceleration[:, column]
    velocity, displacement = (np.abs(each[:, column]).max() for each in motion.integrated())
    start, end = significant_duration(values, motion.dt)
    worst = int(np.argmax(np.abs(misfit)))
    return (
        f"{what:18s}{100.0 * misfit[worst]:10.1f} {periods[worst]:8.3g} "
        f"{np.abs(values).max() / STANDARD_GRAVITY:8.3f} {velocity:8.3f} {displacement:8.3f} "
        f"{float(arias_intensity(values, motion.dt)[-1]):10.3f} {end - start:9.2f}"
    )
