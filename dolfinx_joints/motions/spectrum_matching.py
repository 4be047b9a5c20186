# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Match ground motions to a target response spectrum by wavelets that are added in time.

After Al Atik and Abrahamson (Earthquake Spectra 26, 2010, 601-617): at the times when oscillators
answer most, tapered cosines of their periods are added that bring these answers to the target.
Final velocity and displacement are left as they are.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike, NDArray

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

Floats = NDArray[np.float64]
Whole = NDArray[np.intp]

SAMPLES = 10
"""In the shortest period that is matched; a peak between two samples is then 5 % higher at most."""

LENGTHS = 4
"""How often the longest period that is matched must fit into the motion."""

_CHECKED = 1.01  # ratio of neighbouring periods where the spectrum is compared with the target
_MATCHED = 1.02  # and of those that wavelets are made for
_PEAKS = 6  # of an oscillator that are looked after at once, above this part of the target:
_NEAR = 0.8
_WEIGHT = 0.5  # of leaving a peak below the target where it is
_REGULARISATION = 1e-3  # in units of the largest singular value
_NORM = 4  # of the misfit that decides how much of a correction is added
_FADE = 1.0  # of wavelets at the end of the motion, in their widths
_PARTS = (1.0, 0.7, 0.5, 0.35, 0.2)


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
        factors: By which components were scaled before wavelets were added, shape (k,).
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
    rounds: NDArray[np.int64]

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
                f"{name}: scaled by {self.factors[k]:.4g}, then wavelets in {self.rounds[k]} rounds"
            )
        return "\n".join(lines)

    def with_rest(self, motion: Motion) -> Motion:
        """A motion and rest after it, in which free vibrations have their peaks."""
        after = _free(motion.dt, self.periods, self.damping_ratio)
        return replace(motion, acceleration=np.pad(motion.acceleration, ((0, after), (0, 0))))

    def _misfit(self, motion: Motion) -> Floats:
        values = self.with_rest(motion).acceleration[:, component_numbers(self.components)]
        found = response_spectrum(values, motion.dt, self.periods, self.damping_ratio)
        misfit: Floats = found.pseudo_acceleration / self.target[:, None] - 1.0
        return misfit


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

    Each component is scaled so that its spectrum has the level of the target (geometric mean),
    then wavelets, which fade at the end of the motion, are added until all misfits are within the
    tolerance, those of free vibrations after the motion as well. A component that is there
    already after scaling gets none. Between the periods of the target it lies on
    straight lines in a plot with both axes logarithmic, and is compared at steps of 1 %.

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
        matched, factor, count, worst = matcher.match(values[:, column], tolerance, rounds)
        if abs(worst[0]) > tolerance:
            raise RecordError(
                f"The spectrum of component {component} of {motion.name!r} came no nearer to the "
                f"target than {worst[0]:+.1%}, at {worst[1]:.4g} s, in {rounds} rounds; tolerance "
                f"is {tolerance:.1%}. Take a record whose spectrum is more like the target, fewer "
                "periods, or a wider tolerance."
            )
        values[:, column] = matched
        factors.append(factor)
        used.append(count)
    return SpectrumMatch(
        motion=replace(motion, acceleration=values),
        record=motion,
        components=components,
        periods=periods,
        target=wanted,
        damping_ratio=damping_ratio,
        tolerance=tolerance,
        factors=np.array(factors),
        rounds=np.array(used, dtype=np.int64),
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
        self.matched = _thinned(periods)
        impulses = np.zeros((self.count, 2))
        impulses[1, 0] = impulses[0, 1] = 1.0
        answers = response_history(impulses, dt, periods[self.matched], zeta)
        self.to_inner = answers[1:, :, 0].T.copy()  # to a sample, from its own time on
        self.to_first = answers[:, :, 1].T.copy()  # the first one rises from nothing

    def match(
        self, values: Floats, tolerance: float, rounds: int
    ) -> tuple[Floats, float, int, tuple[float, float]]:
        """The nearest acceleration found, its factor, rounds, and its worst misfit and period."""
        values = np.append(values, np.zeros(self.count - self.given))
        answers = self._answers(values)
        factor = float(np.exp(-np.log(np.abs(answers).max(axis=0)).mean()))
        values, answers = factor * values, factor * answers
        best, best_round, least = values, 0, _misfit(answers)
        misfit, emphasis = least, np.ones(len(self.matched))
        for number in range(1, rounds + 1):
            if np.abs(least).max() <= tolerance:
                break
            # Peaks that stay behind because of their neighbours count more and more.
            emphasis *= 1.0 + np.minimum(np.abs(misfit[self.matched]) / tolerance, 1.0) ** 2
            emphasis /= np.exp(np.log(emphasis).mean())
            correction = self._correction(answers, emphasis)
            change = self._answers(correction)
            norms = [float(np.sum(_misfit(answers + p * change) ** _NORM)) for p in _PARTS]
            part = _PARTS[int(np.argmin(norms))]
            values, answers = values + part * correction, answers + part * change
            misfit = _misfit(answers)
            if np.abs(misfit).max() < np.abs(least).max():
                best, best_round, least = values, number, misfit
        worst = int(np.argmax(np.abs(least)))
        return (
            best[: self.given],
            factor,
            best_round,
            (float(least[worst]), float(self.periods[worst])),
        )

    def _answers(self, values: Floats) -> Floats:
        """Of all oscillators to an acceleration (n,), shape (n, p)."""
        history = response_history(values, self.dt, self.periods, self.zeta)
        answers: Floats = self.scale * history
        return answers

    def _correction(self, answers: Floats, emphasis: Floats) -> Floats:
        """Sum of wavelets that would bring the peaks to the target, shape (n,)."""
        rows, places, wanted, weight = self._peaks(answers)
        weight = weight * emphasis[rows]
        oscillators = self.matched[rows]
        sampled = np.zeros((len(rows), self.count))
        wavelets = np.empty((self.count, len(rows)))
        for k, (row, oscillator, place) in enumerate(zip(rows, oscillators, places, strict=True)):
            sampled[k, 1 : place + 1] = self.to_inner[row, :place][::-1]
            sampled[k, 0] = self.to_first[row, place]
            wavelets[:, k] = self._wavelet(int(oscillator), int(place))
        signs = np.sign(answers[places, oscillators])
        sampled *= (signs * self.scale[oscillators])[:, None]
        effects = sampled @ wavelets
        size = np.abs(effects).max(axis=0)
        left, values, right = np.linalg.svd(weight[:, None] * effects / size, full_matrices=False)
        damped = values / (values**2 + (_REGULARISATION * values[0]) ** 2)
        amplitudes = right.T @ (damped * (left.T @ (weight * wanted))) / size
        correction: Floats = wavelets @ amplitudes
        return correction

    def _peaks(self, answers: Floats) -> tuple[Whole, Whole, Floats, Floats]:
        """Matched oscillator, sample, wanted change and weight of each peak to look after.

        The highest of an oscillator must reach the target, all above it come down to it, and those
        not far below it should stay there.
        """
        found: list[tuple[int, int, float, float]] = []
        for row, oscillator in enumerate(self.matched):
            size = np.abs(answers[:, oscillator])
            after = np.append(size[2:], 0.0)  # the last sample may be a peak
            peaks = 1 + np.flatnonzero((size[1:] >= size[:-1]) & (size[1:] > after))
            highest = peaks[np.argsort(-size[peaks], kind="stable")][:_PEAKS]
            for rank, place in enumerate(highest):
                above = rank == 0 or size[place] > 1.0
                if above or size[place] > _NEAR:
                    wanted, weight = (1.0 - size[place], 1.0) if above else (0.0, _WEIGHT)
                    found.append((row, int(place), float(wanted), weight))
        rows, places, changes, weights = zip(*found, strict=True)
        return np.array(rows), np.array(places), np.array(changes), np.array(weights)

    def _wavelet(self, oscillator: int, place: int) -> Floats:
        """Tapered cosine whose largest answer is at a sample; it ends at rest where it began."""
        time = self.dt * (np.arange(self.count) - place) + self.lag[oscillator]
        envelope = np.exp(-((time / self.width[oscillator]) ** 2))
        left = self.dt * (self.given - 1 - np.arange(self.count))  # until the end, where it is zero
        envelope *= 1.0 - fall(left, 0.0, _FADE * self.width[oscillator])
        wave = np.cos(self.damped[oscillator] * time) * envelope
        return without_drift(wave[:, None], envelope, self.dt)[:, 0]


def _free(dt: float, periods: Floats, zeta: float) -> int:
    """Samples after a motion in which free vibrations of all oscillators have their peaks."""
    return int(np.ceil(0.5 * periods[-1] / np.sqrt(1.0 - zeta**2) / dt)) + 1


def _misfit(answers: Floats) -> Floats:
    """Largest answers over the target, less 1, shape (p,)."""
    misfit: Floats = np.abs(answers).max(axis=0) - 1.0
    return misfit


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
    values = np.exp(np.interp(np.log(filled), np.log(periods), np.log(wanted)))
    return filled, values


def _thinned(periods: Floats) -> Whole:
    """Places of the first period, of the next one 2 % longer, and so on."""
    chosen = [0]
    for place in range(1, len(periods)):
        if periods[place] >= periods[chosen[-1]] * _MATCHED * (1.0 - 1e-3):
            chosen.append(place)
    return np.array(chosen)


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
