# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions: read PEER AT2 files, make synthetic ones, turn, resample, cut and taper them.

Files hold g; everything behind this door is in m/s^2 and in the axes of the dam: x stream, y
cross-valley, z up, right-handed. :func:`read_record` puts x on the horizontal component whose
azimuth is 90 degrees more (clockwise, seen from above) than the other's; :meth:`Motion.rotated`
then turns the pair onto the dam.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dolfinx_joints.errors import RecordError

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2] (3rd CGPM, 1901): the g in which records are given."""

_COUNT_AND_STEP = (
    re.compile(r"\bNPTS\s*=\s*(\d+)\s*,\s*DT\s*=\s*([\d.]+(?:E[+-]?\d+)?)(?:\s|,|SEC|$)", re.I),
    re.compile(r"^\s*(\d+)\s+([\d.]+(?:E[+-]?\d+)?)\s+NPTS\s*,\s*DT\b", re.I),
)
_UNIT_IS_G = re.compile(r"\bUNITS?\s+OF\s+G(?![\w/*^])", re.I)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(E[+-]?\d+)?", re.I)
_COMPONENT = re.compile(
    r"(.+?)(?:[-_.]?(UP|DWN|DOWN|VERT?|\d{3})|[-_.](V|NS|EW|[NESW]|\d{1,2}))", re.I
)
_UP, _DOWN = -1, -2  # told from azimuths, which are 0 to 359
_DIRECTIONS = {
    **dict.fromkeys(("UP", "V", "VER", "VERT"), _UP),
    **dict.fromkeys(("DWN", "DOWN"), _DOWN),
    **{"N": 0, "NS": 0, "E": 90, "EW": 90, "S": 180, "W": 270},
}
_ROUNDING = 1e-9  # part of a sample by which a time may miss a sample and still mean it


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Ground acceleration sampled at equal steps from t = 0, linear between samples.

    Args:
        acceleration: along x (stream), y (cross-valley), z (up), shape (n, 3), n >= 2, [m/s^2];
            kept as a read-only copy.
        dt: time between samples [s].
        name: what to call it in logs and titles.

    Raises:
        RecordError: the array has another shape or is not finite, or ``dt`` is not positive.
    """

    acceleration: NDArray[np.float64]
    dt: float
    name: str = "motion"

    def __post_init__(self) -> None:
        """Check the values."""
        values = np.array(self.acceleration, dtype=np.float64)
        if values.ndim != 2 or values.shape[0] < 2 or values.shape[1] != 3:
            raise RecordError(f"acceleration must have shape (n >= 2, 3), got {values.shape}.")
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).all(axis=1)))
            raise RecordError(f"acceleration must be finite, got {values[row]} at sample {row}.")
        if not (np.isfinite(self.dt) and self.dt > 0.0):
            raise RecordError(f"dt must be a positive number of seconds, got {self.dt}.")
        values.flags.writeable = False
        object.__setattr__(self, "acceleration", values)

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return (len(self.acceleration) - 1) * self.dt

    @property
    def time(self) -> NDArray[np.float64]:
        """Times of the samples, shape (n,), [s]."""
        return np.arange(len(self.acceleration), dtype=np.float64) * self.dt

    @property
    def peak(self) -> NDArray[np.float64]:
        """Largest absolute value of each component, shape (3,), [m/s^2]."""
        peaks: NDArray[np.float64] = np.abs(self.acceleration).max(axis=0)
        return peaks

    def __call__(self, time: ArrayLike) -> NDArray[np.float64]:
        """Acceleration at any time, linear between samples and zero outside.

        Args:
            time: one time or several, shape (...), [s].

        Returns:
            Shape (..., 3), [m/s^2].
        """
        times, samples = np.asarray(time, dtype=np.float64), self.time
        columns = [np.interp(times, samples, c, left=0.0, right=0.0) for c in self.acceleration.T]
        return np.stack(columns, axis=-1)

    def rotated(self, angle_deg: float) -> Self:
        """Components along horizontal axes turned counterclockwise, seen from above.

        With c, s the cosine and sine of the angle, ``x' = c x + s y`` and ``y' = c y - s x``: the
        ground moves as before, the axes that describe it are turned. As azimuths count
        clockwise, x' has the azimuth of x less ``angle_deg``. For the Tolmezzo record of 6 May
        1976 as :func:`read_record` returns it (x on azimuth 0, y on 270), 25 degrees puts the
        largest horizontal peak of any angle, 0.395 g, on x'.
        """
        if not np.isfinite(angle_deg):
            raise RecordError(f"angle_deg must be a finite number, got {angle_deg}.")
        c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
        x, y, z = self.acceleration.T
        return replace(self, acceleration=np.stack([c * x + s * y, c * y - s * x, z], axis=1))

    def resampled(self, dt: float) -> Self:
        """Band-limited interpolation at the times 0, dt, 2 dt, ... up to the duration.

        The samples, followed by as many zeros, are taken as one period of a Fourier series,
        which is evaluated at the new times; any ratio of steps will do. With a coarser step the
        series is first cut at the new Nyquist frequency, by half a cosine from 80 % of it, so
        that nothing folds back. The series rings where the motion starts or ends away from
        zero: taper it first. The last new sample is at or before the last old one.

        Args:
            dt: new time between samples [s].
        """
        if not 0.0 < dt <= self.duration:
            raise RecordError(f"dt must be positive and at most {self.duration:.6g} s, got {dt}.")
        if dt == self.dt:
            return self
        from scipy.fft import next_fast_len
        from scipy.signal import czt

        period = next_fast_len(2 * len(self.acceleration), real=True)
        spectrum = np.fft.rfft(self.acceleration, n=period, axis=0) / period
        frequency = np.fft.rfftfreq(period, self.dt)
        # Each term but the mean, and the one at Nyquist, stands for its conjugate as well.
        weight = np.where((frequency == 0.0) | (2 * frequency * self.dt >= 1.0), 1.0, 2.0)
        if dt > self.dt:
            weight = weight * _fall(frequency, 0.8 * 0.5 / dt, 0.5 / dt)
        count = int(np.floor(self.duration / dt + _ROUNDING)) + 1
        turn = np.exp(2j * np.pi * dt / (period * self.dt))
        values = czt(weight[:, None] * spectrum, m=count, w=turn, axis=0).real
        return replace(self, acceleration=values, dt=float(dt))

    def trimmed(self, duration: float, *, start: float = 0.0) -> Self:
        """Samples from ``start`` to ``start + duration``, both included; time starts again at 0.

        A bound between two samples is moved inwards to the next one.

        Args:
            duration: length to keep [s].
            start: time of the present motion where to begin [s].
        """
        if not (
            start >= 0.0
            and duration > 0.0
            and start + duration <= self.duration + _ROUNDING * self.dt
        ):
            raise RecordError(
                f"The part to keep must lie within 0 to {self.duration:.6g} s, got {start:.6g} to "
                f"{start + duration:.6g} s."
            )
        first = int(np.ceil(start / self.dt - _ROUNDING))
        last = int(np.floor((start + duration) / self.dt + _ROUNDING))
        return replace(self, acceleration=self.acceleration[first : last + 1])

    def detrended(self) -> Self:
        """The motion less the straight line that fits each component best (least squares)."""
        centred = self.time - self.time.mean()
        slope = centred @ self.acceleration / (centred @ centred)
        line = self.acceleration.mean(axis=0) + np.outer(centred, slope)
        return replace(self, acceleration=self.acceleration - line)

    def tapered(self, *, seconds: float | None = None, fraction: float | None = None) -> Self:
        """Bring the motion to zero at both ends by half a cosine.

        Args:
            seconds: length of each ramp [s], or
            fraction: length of each ramp as a share of the duration; at most half.
        """
        if (seconds is None) == (fraction is None):
            raise RecordError("Give the taper either in seconds or as a fraction.")
        ramp = seconds if seconds is not None else (fraction or 0.0) * self.duration
        if not 0.0 < ramp <= 0.5 * self.duration:
            raise RecordError(
                f"Each ramp must last more than 0 s and at most half the duration, "
                f"{0.5 * self.duration:.6g} s, got {ramp:.6g} s."
            )
        to_end = np.minimum(self.time, self.time[::-1])
        window = 1.0 - _fall(to_end, 0.0, ramp)
        return replace(self, acceleration=window[:, None] * self.acceleration)

    def scaled(self, factor: float | Sequence[float]) -> Self:
        """Multiply by one factor, or by one for each component."""
        factors = np.asarray(factor, dtype=np.float64)
        if factors.shape not in ((), (3,)) or not np.isfinite(factors).all():
            raise RecordError(f"factor must be one finite number or three, got {factor}.")
        return replace(self, acceleration=factors * self.acceleration)


class At2(NamedTuple):
    """Contents of an AT2 file: acceleration (n,) [m/s^2], time step [s], the header lines."""

    acceleration: NDArray[np.float64]
    dt: float
    header: tuple[str, ...]


def read_at2(path: str | Path) -> At2:
    """Read one component from a PEER AT2 file.

    Four header lines, of which the third says that the unit is g and the fourth gives the count
    and the time step (``NPTS= 4000, DT= .0100 SEC`` or ``4000 .0100 NPTS, DT``), then the values,
    the same number on every line but the last.

    Args:
        path: the file.

    Returns:
        The acceleration [m/s^2], the time step [s] and the header.

    Raises:
        RecordError: with file, line and reason, where the file is anything else.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="latin-1").rstrip().splitlines()
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror}.") from error
    if len(lines) < 5:
        raise RecordError(f"{path} has {len(lines)} lines, fewer than a header of 4 and values.")
    if not _UNIT_IS_G.search(lines[2]):
        raise RecordError(f"{path}, line 3: must say 'UNITS OF G', got {lines[2].strip()!r}.")
    match = next(filter(None, (pattern.search(lines[3]) for pattern in _COUNT_AND_STEP)), None)
    if match is None:
        raise RecordError(
            f"{path}, line 4: must give 'NPTS= count, DT= step SEC', got {lines[3].strip()!r}."
        )
    count, dt = int(match[1]), _number(match[2], f"{path}, line 4")
    if dt <= 0.0:
        raise RecordError(f"{path}, line 4: the time step must be positive, got {match[2]}.")
    values = np.fromiter(_values(path, lines), dtype=np.float64)
    if len(values) != count:
        raise RecordError(
            f"{path}, line {len(lines)}: the file ends after {len(values)} values, line 4 "
            f"announces {count}."
        )
    return At2(STANDARD_GRAVITY * values, dt, tuple(line.strip() for line in lines[:4]))


def read_record(directory: str | Path, *, name: str | None = None) -> Motion:
    """Read the three components of one record from the AT2 files of a directory.

    Files belong together when their names differ only in the component at the end (``-UP``,
    ``DWN``, ``000``, ``270``, ...); subdirectories are not searched. Where the second line of a
    header ends with a component, it must be the same one. A downward component changes its sign.
    Of the horizontal ones x is the one that has y at a right angle to its left, seen from above,
    which makes x, y, z right-handed: azimuths 0 and 270 become x and y. Components of different
    length are cut to the shortest.

    Args:
        directory: where the files are.
        name: part of the file names, needed where there are several records.

    Raises:
        RecordError: no record, or several, or one that is not two horizontal components at right
            angles and a vertical one, or with different time steps.
    """
    stem, files = _find_record(Path(directory), name)
    parts = {direction: read_at2(path) for direction, path in files.items()}
    for direction, path in files.items():
        said = _direction(parts[direction].header[1].rpartition(",")[2])
        if said not in (None, direction):
            raise RecordError(f"{path}, line 2: names another component than the file name does.")
    vertical = [direction for direction in files if direction in (_UP, _DOWN)]
    along_x = [
        direction for direction in files if direction >= 0 and (direction - 90) % 360 in files
    ]
    if len(files) != 3 or len(vertical) != 1 or len(along_x) != 1:
        raise RecordError(
            f"A record is a vertical component and two horizontal ones at right angles, {stem!r} "
            f"is {', '.join(path.name for path in files.values())}."
        )
    steps = {part.dt for part in parts.values()}
    if len(steps) != 1:
        raise RecordError(f"The components of {stem!r} have different time steps, {steps} s.")
    order = (along_x[0], (along_x[0] - 90) % 360, vertical[0])
    length = min(len(part.acceleration) for part in parts.values())
    columns = np.stack([parts[direction].acceleration[:length] for direction in order], axis=1)
    if vertical[0] == _DOWN:
        columns[:, 2] *= -1.0
    return Motion(acceleration=columns, dt=steps.pop(), name=stem)


def synthetic_motion(
    *,
    seed: int = 1,
    duration: float = 11.165,
    dt: float = 0.005,
    peaks_g: Sequence[float] = (0.4, 0.4, 0.3),
    band: tuple[float, float] = (0.5, 15.0),
) -> Motion:
    """Make a motion that looks like an earthquake and is the same everywhere.

    Each component is a sum of sines at multiples of 1/duration with random phases and equal
    amplitudes that fade within the outer quarter of the band, times an envelope: a rise over
    15 % of the duration, strong motion until 45 %, a decay to zero at the end. A small multiple
    of the envelope, linear in time, is taken off so that velocity and displacement of the
    (piecewise linear) motion return to zero; then each component is scaled to its peak.
    The phases come from the raw stream of PCG64, which NumPy promises not to change.

    Args:
        seed: whole number that selects the phases.
        duration: time of the last sample [s], rounded to a whole number of steps.
        dt: time between samples [s].
        peaks_g: largest absolute value of x, y, z, in units of standard gravity.
        band: lowest and highest frequency of the sines [Hz].
    """
    low, high = band
    if not (0.0 < 100.0 * dt <= duration and np.isfinite(duration)):
        raise RecordError(f"dt must be positive and at most duration / 100, got {dt} s.")
    if not (1.0 / duration <= low < high <= 0.5 / dt):
        raise RecordError(
            f"band must rise within {1.0 / duration:.4g} to {0.5 / dt:.4g} Hz, got {band}."
        )
    if len(peaks_g) != 3 or not np.all(np.isfinite(peaks_g)) or min(peaks_g) < 0.0:
        raise RecordError(f"peaks_g must be three numbers of at least 0, got {peaks_g}.")
    time = np.arange(round(duration / dt) + 1) * dt
    frequency = np.arange(np.ceil(low * duration), np.floor(high * duration) + 1) / duration
    edge = 0.25 * (high - low)
    amplitude = _fall(frequency, high - edge, high) * (1.0 - _fall(frequency, low, low + edge))
    raw = np.random.PCG64(seed).random_raw((3, frequency.size))
    phase = 2.0 * np.pi * (raw >> np.uint64(11)).astype(np.float64) * 2.0**-53
    waves = np.sin(2.0 * np.pi * time[:, None, None] * frequency + phase) @ amplitude
    share = time / time[-1]
    envelope = (1.0 - _fall(share, 0.0, 0.15)) * _fall(share, 0.45, 1.0)
    values = _without_drift(envelope[:, None] * waves, envelope, dt)
    values *= STANDARD_GRAVITY * np.asarray(peaks_g) / np.abs(values).max(axis=0)
    return Motion(acceleration=values, dt=dt, name=f"synthetic motion {seed}")


def _fall(x: NDArray[np.floating[Any]], start: float, end: float) -> NDArray[np.float64]:
    """Half a cosine that falls from 1 at ``start`` to 0 at ``end``."""
    share = np.clip((x - start) / (end - start), 0.0, 1.0)
    values: NDArray[np.float64] = np.cos(0.5 * np.pi * share) ** 2
    return np.where(share == 1.0, 0.0, values)


def _without_drift(
    values: NDArray[np.float64], envelope: NDArray[np.float64], dt: float
) -> NDArray[np.float64]:
    """Take off (b + c t) envelope so that the final velocity and displacement vanish."""
    time = np.arange(len(values)) * dt
    shapes = envelope[:, None] * np.stack([np.ones_like(time), time], axis=1)
    # Integrals of a and of t a over a piecewise linear a: trapezoids, and t's own hat functions.
    ends = np.full(len(values), dt)
    ends[[0, -1]] *= 0.5
    moments = time * dt
    moments[0], moments[-1] = dt**2 / 6.0, (0.5 * time[-1] - dt / 6.0) * dt
    integrals = np.stack([ends, moments])
    coefficients = np.linalg.solve(integrals @ shapes, integrals @ values)
    corrected: NDArray[np.float64] = values - shapes @ coefficients
    return corrected


def _number(text: str, where: str) -> float:
    value = float(text) if _NUMBER.fullmatch(text) else np.nan
    if not np.isfinite(value):
        raise RecordError(f"{where}: {text!r} is not a finite number.")
    return value


def _values(path: Path, lines: Sequence[str]) -> Iterator[float]:
    """Values of an AT2 file [g], refusing a line that is short of some."""
    per_line = len(lines[4].split())
    for number, line in enumerate(lines[4:], start=5):
        words = line.split()
        if len(words) > per_line or (len(words) < per_line and number < len(lines)):
            raise RecordError(
                f"{path}, line {number}: {len(words)} values where the lines before have "
                f"{per_line}."
            )
        for word in words:
            yield _number(word, f"{path}, line {number}")


def record_names(directory: str | Path) -> list[str]:
    """Names of the records whose AT2 files are in a directory, subdirectories left out.

    Raises:
        RecordError: there is no such directory.
    """
    return list(_records_in(Path(directory)))


def _records_in(directory: Path) -> dict[str, dict[int, Path]]:
    """Files of each record by direction."""
    if not directory.is_dir():
        raise RecordError(f"There is no directory {directory}.")
    records: dict[str, dict[int, Path]] = {}
    for path in sorted(directory.iterdir()):
        match = _COMPONENT.fullmatch(path.stem)
        if path.suffix.upper() == ".AT2" and match:
            direction = _direction(match[2] or match[3])
            if direction is not None:
                records.setdefault(match[1], {})[direction] = path
    return records


def _find_record(directory: Path, name: str | None) -> tuple[str, dict[int, Path]]:
    """Name of the record and its files by direction."""
    records = _records_in(directory)
    chosen = [stem for stem in records if name is None or name.lower() in stem.lower()]
    if not chosen:
        known = ", ".join(records) or "none"
        wanted = "" if name is None else f" with {name!r} in its name"
        raise RecordError(f"{directory} has no record{wanted}; it has {known}.")
    if len(chosen) > 1:
        raise RecordError(f"{directory} has several records, choose by name=: {', '.join(chosen)}.")
    return chosen[0], records[chosen[0]]


def _direction(component: str) -> int | None:
    """Azimuth 0 to 359 [degrees], ``_UP`` or ``_DOWN``; None if it is not known."""
    text = component.strip().upper()
    if text.isdigit() and len(text) <= 3:
        return int(text) % 360
    return _DIRECTIONS.get(text)
