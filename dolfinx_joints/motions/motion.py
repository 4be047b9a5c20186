# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions: synthetic accelerograms, rotation, correction, filters, resampling, tapers.

Accelerations are in m/s^2 and in the axes of the dam: x stream, y cross-valley, z up, right-handed.
Files are read by :mod:`~dolfinx_joints.motions.reading`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Self

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.common.summary import Rows, Summarised
from dolfinx_joints.motions.processing import (
    ROUNDING,
    band_pass,
    fall,
    integrate,
    low_pass,
    resample,
    without_baseline,
    without_drift,
)
from dolfinx_joints.motions.spectra import Seconds as Seconds

Hertz = Annotated[float, at.Gt(0.0), at.Unit("Hz")]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
@checked
class Motion(Summarised):
    """Ground acceleration, sampled at equal steps from t = 0 and linear between samples.

    Args:
        acceleration: along x (stream), y (cross-valley), z (up), shape (n, 3), n >= 2, [m/s^2];
            stored as a read-only copy.
        dt: time between samples [s].
        name: name in logs and titles.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> t = np.linspace(0.0, 2.0, 201)
        >>> acceleration = np.zeros((201, 3))
        >>> acceleration[:, 0] = 3.0 * np.sin(2.0 * np.pi * 2.5 * t)  # stream, 2.5 Hz [m/s^2]
        >>> motion = dj.Motion(acceleration=acceleration, dt=0.01)
        >>> motion.duration, motion.peak.round(6)  # [s], [m/s^2]
        (2.0, array([3., 0., 0.]))
    """

    acceleration: Floats
    dt: Seconds
    name: str = "motion"

    def __post_init__(self) -> None:
        values = numbers_of(self.acceleration)
        if values is None or values.ndim != 2 or len(values) < 2 or values.shape[1] != 3:
            got = shown(self.acceleration) if values is None else values.shape
            raise RecordError(f"acceleration must be real numbers of shape (n >= 2, 3), got {got}.")
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise RecordError(f"acceleration must be finite, got {values[row]} at sample {row}.")
        values.flags.writeable = False
        object.__setattr__(self, "acceleration", values)

    def _summary(self) -> Rows:
        yield "name", self.name
        yield "duration", f"{self.duration:g} s in steps of {self.dt:g} s"
        for axis, peak in zip("xyz", self.peak, strict=True):
            yield f"peak {axis}", f"{peak:.3g} m/s², {peak / STANDARD_GRAVITY:.3g} g"

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return (len(self.acceleration) - 1) * self.dt

    @property
    def time(self) -> Floats:
        """Times of the samples, shape (n,), [s]."""
        return np.arange(len(self.acceleration), dtype=np.float64) * self.dt

    @property
    def peak(self) -> Floats:
        """Largest absolute value of each component, shape (3,), [m/s^2]."""
        return np.abs(self.acceleration).max(axis=0)

    def __call__(self, time: ArrayLike) -> Floats:
        """Return the acceleration (..., 3) [m/s^2] at times (...) [s], zero outside the motion."""
        if isinstance(time, float) and 0.0 <= time <= self.duration:  # fast path for time steps
            passed = time / self.dt
            last = min(int(passed), len(self.acceleration) - 2)
            before, after = self.acceleration[last : last + 2]
            return before + (passed - last) * (after - before)
        times, samples = np.asarray(time, dtype=np.float64), self.time
        columns = [np.interp(times, samples, c, left=0.0, right=0.0) for c in self.acceleration.T]
        return np.stack(columns, axis=-1)

    def integrated(self) -> tuple[Floats, Floats]:
        """Return velocity [m/s] and displacement [m] from rest, each of shape (n, 3)."""
        return integrate(self.acceleration, self.dt)

    @checked
    def rotated(self, angle_deg: float) -> Self:
        """Rotate the horizontal axes counterclockwise, as seen from above.

        With c and s the cosine and sine of the angle, ``x' = c x + s y`` and ``y' = c y - s x``.
        Azimuths are clockwise, so x' has the azimuth of x minus ``angle_deg``.
        """
        angle = np.deg2rad(angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        if angle_deg % 90.0 == 0.0:  # exchange the components without rounding error
            c, s = np.round(c), np.round(s)
        x, y, z = self.acceleration.T
        return replace(self, acceleration=np.stack([c * x + s * y, c * y - s * x, z], axis=1))

    @checked
    def resampled(self, dt: Seconds) -> Self:
        """Resample by band-limited interpolation at 0, dt, 2 dt, ... up to the duration.

        The samples, padded by an equal number of zeros, are one period of a Fourier series. For a
        longer step, a half-cosine low-pass from 80 % of the new Nyquist frequency prevents
        aliasing. Taper a motion whose ends are not zero, because the series oscillates there.

        Args:
            dt: new time between samples [s].
        """
        if dt == self.dt:
            return self
        count = int(np.floor(self.duration / dt + ROUNDING)) + 1
        values = resample(self.acceleration, self.dt, dt, count)
        return replace(self, acceleration=values, dt=dt)

    @checked
    def for_steps(self, step: Seconds) -> Self:
        """Remove the frequencies that time steps of length ``step`` [s] would alias.

        The gain is 1 / (1 + (2.5 f step)^8): 98 % at half the Nyquist frequency of the step, 14 %
        at the Nyquist frequency, 0.07 % at its double. Steps up to ``dt`` change nothing.
        """
        if step <= self.dt * (1.0 + ROUNDING):
            return self
        return replace(self, acceleration=low_pass(self.acceleration, self.dt, 0.4 / step))

    @checked
    def trimmed(
        self, duration: Seconds, *, start: Annotated[float, at.Ge(0.0), at.Unit("s")] = 0.0
    ) -> Self:
        """Return the samples from ``start`` to ``start + duration`` [s]; time starts again at 0.

        A bound between two samples is moved inwards to the next sample.
        """
        if start + duration > self.duration + ROUNDING * self.dt:
            raise RecordError(
                f"The part to keep must lie within 0 to {self.duration:.6g} s, got a duration of "
                f"{duration} s from {start} s."
            )
        first = int(np.ceil(start / self.dt - ROUNDING))
        last = int(np.floor((start + duration) / self.dt + ROUNDING))
        return replace(self, acceleration=self.acceleration[first : last + 1])

    def detrended(self) -> Self:
        """Subtract the straight line that fits each component best (least squares)."""
        from scipy.signal import detrend

        return replace(self, acceleration=detrend(self.acceleration, axis=0))

    @checked
    def baseline_corrected(self, degree: Annotated[int, at.Interval(ge=0, le=6)] = 2) -> Self:
        """Subtract the polynomial baseline that makes the velocity drift.

        The integral of the polynomial, zero at the start, is the least-squares fit of the velocity.
        The motion should start at rest; it need not end at rest.

        Args:
            degree: degree of the polynomial: 0 an offset, 1 a line, 2 a parabola, ... up to 6.
        """
        return replace(self, acceleration=without_baseline(self.acceleration, degree))

    @checked
    def band_passed(
        self,
        low: Hertz | None = None,
        high: Hertz | None = None,
        *,
        order: Annotated[int, at.Interval(ge=1, le=8)] = 4,
    ) -> Self:
        """Apply a Butterworth filter forwards and backwards, without phase shift.

        The gain of both passes is 1/2 at the corners and falls twice as steeply as for one pass.
        The motion is padded by zeros: correct its baseline and taper it first. The response beyond
        the ends is cut off, so the displacement can drift: correct the baseline again.

        Args:
            low: lower corner [Hz]; no high-pass by default.
            high: upper corner [Hz]; no low-pass by default.
            order: filter order of one pass, from 1 to 8.
        """
        nyquist = 0.5 / self.dt
        corners = [corner for corner in (low, high) if corner is not None]
        if not corners or sorted({*corners, nyquist}) != [*corners, nyquist]:
            raise RecordError(
                f"Give one corner, or two with low < high, below {nyquist:.6g} Hz, half the "
                f"sampling rate; got low={low} and high={high}."
            )
        if corners[0] * self.duration < 1.0:
            raise RecordError(
                f"The corner of {corners[0]:.6g} Hz must be at least {1.0 / self.duration:.6g} Hz: "
                f"one period in the {self.duration:.6g} s of the motion."
            )
        values = band_pass(self.acceleration, self.dt, low, high, order)
        return replace(self, acceleration=values)

    @checked
    def tapered(self, *, seconds: float | None = None, fraction: float | None = None) -> Self:
        """Taper the motion to zero at both ends by half a cosine.

        Args:
            seconds: length of each ramp [s]; or
            fraction: length of each ramp as a share of the duration, at most half.
        """
        if (seconds is None) == (fraction is None):
            raise RecordError("Give the length of the taper either in seconds or as a fraction.")
        ramp = (fraction or 0.0) * self.duration if seconds is None else seconds
        if not 0.0 < ramp <= 0.5 * self.duration:
            raise RecordError(
                f"Each ramp must last more than 0 s and at most half the duration, "
                f"{0.5 * self.duration:.6g} s, got {ramp:.6g} s."
            )
        to_end = np.minimum(self.time, self.time[::-1])
        window = 1.0 - fall(to_end, 0.0, ramp)
        return replace(self, acceleration=window[:, None] * self.acceleration)

    @checked
    def scaled(self, factor: float | Sequence[float]) -> Self:
        """Multiply all components by one factor, or each component by a separate factor."""
        factors = np.asarray(factor, dtype=np.float64)
        if factors.shape not in ((), (3,)):
            raise RecordError(f"factor must be one number or three, got {shown(factor, str)}.")
        return replace(self, acceleration=factors * self.acceleration)


@checked
def synthetic_motion(
    *,
    seed: Annotated[int, at.Ge(0)] = 1,
    duration: Seconds = 11.165,
    dt: Seconds = 0.005,
    peaks_g: Annotated[Sequence[float], at.Len(3, 3), at.Ge(0.0)] = (0.4, 0.4, 0.3),
    band: tuple[float, float] | None = None,
) -> Motion:
    """Make a reproducible synthetic accelerogram.

    Each component is a sum of sines at multiples of 1/duration, times an envelope. The phases are
    random and the amplitudes fade in the outer quarters of the band. The envelope rises over 15 %
    of the duration, is 1 until 45 % and decays to zero. Then the envelope times a linear function
    of time is subtracted, so that velocity and displacement return to zero. Finally each component
    is scaled to its peak. The phases use the raw PCG64 stream, the same in all versions of NumPy.

    Args:
        seed: integer that selects the phases.
        duration: time of the last sample [s], rounded to a whole number of steps.
        dt: time between samples [s].
        peaks_g: largest absolute value of x, y, z, in units of standard gravity.
        band: lowest and highest frequency of the sines [Hz]; by default 0.5 and 15 Hz, at
            least 1/duration and at most 0.5/dt.

    Example:
        >>> import dolfinx_joints as dj
        >>> motion = dj.synthetic_motion(duration=2.0, peaks_g=(0.2, 0.2, 0.1))
        >>> (motion.peak / 9.80665).round(6)
        array([0.2, 0.2, 0.1])
    """
    low, high = band = band or (max(0.5, 1.0 / duration), min(15.0, 0.5 / dt))
    if not 1.0 / duration <= low < high <= 0.5 / dt:
        raise RecordError(
            f"band must rise from {1.0 / duration:.4g} Hz (1/duration) or more to at most "
            f"{0.5 / dt:.4g} Hz (0.5/dt), got {shown(band)}. Change band, duration or dt."
        )
    time = np.arange(round(duration / dt) + 1) * dt
    frequency = np.arange(np.ceil(low * duration), np.floor(high * duration) + 1) / duration
    edge = 0.25 * (high - low)
    amplitude = fall(frequency, high - edge, high) * (1.0 - fall(frequency, low, low + edge))
    if not amplitude.any():
        raise RecordError(f"The band {shown(band)} Hz has no sine; increase band or duration.")
    raw = np.random.PCG64(seed).random_raw((3, frequency.size))
    phase = 2.0 * np.pi * (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
    blocks = np.array_split(time, 1 + time.size * frequency.size // 10_000_000)
    waves = np.concatenate(
        [np.sin(2.0 * np.pi * t[:, None, None] * frequency + phase) @ amplitude for t in blocks]
    )
    share = time / time[-1]
    envelope = (1.0 - fall(share, 0.0, 0.15)) * fall(share, 0.45, 1.0)
    values = without_drift(envelope[:, None] * waves, envelope, dt)
    values *= STANDARD_GRAVITY * np.asarray(peaks_g) / np.abs(values).max(axis=0)
    return Motion(acceleration=values, dt=dt, name=f"synthetic motion {seed}")
