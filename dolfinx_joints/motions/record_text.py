# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parsing and checking of record files: lines, numbers, counts, units and directions.

Every message names the file, the line, its content and the expected content.
"""

import lzma
import math
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import shown

MAX_PEAK_G = 20.0
"""Largest acceleration that is accepted, in units of g."""

FILLER_JUMP = 3.0
"""Least jump to a single filler value, relative to the largest other difference of neighbours."""

UNITS = {"m/s^2": 1.0, "cm/s^2": 0.01, "mm/s^2": 0.001, "gal": 0.01}
UNITS |= {"g": STANDARD_GRAVITY, "mg": 0.001 * STANDARD_GRAVITY}
"""Units of acceleration by name, in m/s^2."""

Direction = float | Literal["up", "down", "x", "y"]
"""Azimuth clockwise from north in [0, 360) degrees, up, down, or an axis of the dam."""

Source = Path | zipfile.Path
"""A file or folder, on disk or in a zip archive."""

# Errors of files that are missing, damaged or encrypted.
UNREADABLE = OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error, lzma.LZMAError

_OTHER_QUANTITY = re.compile(
    r"^\W*(?:\w+\s*[:=]\s*)?(?:ground\s+)?(?:velocity|displacement)\s*(?:$|[\[(,;])"
    r"|\b(?:velocity|displ(?:acement)?)\s+(?:time\W*)?(?:series|history|record)",
    re.I,
)
# A unit in brackets, after "in", "of" or "unit", or with a slash after a word; not after a number.
_UNIT = re.compile(
    r"(?:(?<!\d)(?<!\d\s)[\[(]\s*|\b(?:in|of|units?)\b\W*|[^\W\d][.,:]?\s+(?=\w+\s*/))"
    r"([cm]?m\s*/\s*s[\w/^*²]*|[cm]?m|m?g|gals?)(?![\w/^*²])(?!\W*\d)",
    re.I,
)
_OTHER_UNIT = re.compile(r"[cm]?m(\s*/\s*s(ec(ond)?)?)?", re.I)
_OF_PLACES = re.compile(r"\b(elev|alti|depth|dist|heig|hypo|epi|coord|vs[_ ]?\d)", re.I)
_BEARING = re.compile(r"([NS])(\d{1,2}(?:\.\d*)?)([EW])")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(E[+-]?\d+)?", re.I)
_FORTRAN = re.compile(r"(?<=[\d.])D(?=[+-]?\d)", re.I)  # exponent of double precision
_NAMES: dict[str, Direction] = {
    **dict.fromkeys(("UP", "V", "VER", "VERT", "UD", "U", "Z"), "up"),
    **dict.fromkeys(("DWN", "DOWN", "DN"), "down"),
    **dict.fromkeys(("N", "NS"), 0.0),
    **dict.fromkeys(("E", "EW"), 90.0),
    **dict.fromkeys(("S", "SN"), 180.0),
    **dict.fromkeys(("W", "WE"), 270.0),
    **{"X": "x", "Y": "y"},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Component:
    """One component of a record as read from its file, converted to m/s^2.

    Attributes:
        acceleration: shape (n,), [m/s^2].
        dt: time between samples [s].
        unit: name of the unit in the file.
        record: name of the record.
        path: the file, possibly in a zip archive.
        stated: direction of positive values according to the content of the file, or None.
        suggested: direction according to the name of the file, or None.
        start: time of the first sample [s], since 1970 or from the time column, or None.
    """

    acceleration: Floats
    dt: float
    unit: str
    record: str
    path: Source
    stated: Direction | None = None
    suggested: Direction | None = None
    start: float | None = None

    @property
    def direction(self) -> Direction | None:
        """Direction of positive values, from the content of the file or else from its name."""
        return self.suggested if self.stated is None else self.stated


class Samples(NamedTuple):
    """Numbers of a file, the number of their first line, and the count per line."""

    values: Floats
    first: int
    per_line: int = 1


class RecordText:
    """Lines of a text file, or of its first ``head`` bytes if given."""

    def __init__(self, path: str | Source, *, head: int = -1) -> None:
        self.path: Source = Path(path) if isinstance(path, str) else path
        try:
            with self.path.open("rb") as file:
                data = file.read(head)
        except UNREADABLE as error:
            reason = getattr(error, "strerror", None) or error
            raise RecordError(f"{self.path} cannot be read: {reason}.") from error
        if not data.strip():
            raise RecordError(f"{self.path} is empty.")
        wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
        try:
            decoded = data.decode("utf-16" if wide else "utf-8-sig")
        except UnicodeDecodeError:
            decoded = data.decode("latin-1")
        if "\0" in decoded:
            raise RecordError(f"{self.path} is not a text file.")
        plain = decoded.replace("\r\n", "\n").replace("\r", "\n").rstrip()
        self.lines = [line.rstrip() for line in plain.split("\n")]

    def fail(self, number: int, text: str) -> NoReturn:
        """Raise an error about a line; lines are numbered from 1."""
        raise RecordError(f"{self.path}, line {number}: {text}")

    def line(self, number: int, content: str) -> str:
        """Return a line by its number from 1, or raise an error with the expected content."""
        if number > len(self.lines):
            raise RecordError(
                f"{self.path} ends after line {len(self.lines)}; line {number} must have {content}."
            )
        return self.lines[number - 1]

    def number(self, number: int, text: str, name: str = "") -> float:
        """Return the finite number in a text, or raise an error about the quantity ``name``."""
        value = float(text) if _NUMBER.fullmatch(text) else math.nan
        if not math.isfinite(value):
            self.fail(number, f"{name}{' ' if name else ''}{shown(text)} is not a finite number.")
        return value

    def positive(self, number: int, text: str, name: str) -> float:
        """Return the positive finite number in a text."""
        value = self.number(number, text, name)
        if value <= 0.0:
            self.fail(number, f"{name} must be positive, got {shown(text, str)}.")
        return value

    def count(self, number: int, text: str, name: str = "the number of values") -> int:
        """Return the number of values in a text, at least 2."""
        if not re.fullmatch(r"\d{1,18}", text) or int(text) < 2:
            self.fail(number, f"{name} must be an integer of 2 or more, got {shown(text)}.")
        return int(text)

    def values(
        self, first: int, count: int = 0, announced: int = 0, *, width: int = 0, last: int = 0
    ) -> Samples:
        """Return the numbers on several lines with equal counts, except for the last line.

        Args:
            first: number of the first line.
            count: required number of values; not checked by default.
            announced: number of the line with this count.
            width: characters per number in a fixed format; free format by default.
            last: number of the last line; by default the end of the file.
        """
        last = min(last or len(self.lines), len(self.lines))
        numbers = np.fromiter(self._numbers(first, last, width), dtype=np.float64)
        if count and len(numbers) != count:
            self.fail(
                max(first - 1, last),
                f"{len(numbers)} values up to this line, but line {announced} states {count}.",
            )
        return Samples(numbers, first, len(self.words(first, width)))

    def rows(self, first: int, columns: int) -> Floats:
        """Return the numbers from a line to the end of the file, shape (lines, columns)."""
        for number in range(first, len(self.lines) + 1):
            count = len(self.words(number))
            if count != columns:
                self.fail(number, f"{count} values; the file has {columns} columns.")
        values = np.fromiter(self._numbers(first, len(self.lines), 0), dtype=np.float64)
        return values.reshape(-1, columns)

    def words(self, number: int, width: int = 0) -> list[str]:
        """Split a line at blanks, commas or semicolons, or into words of a fixed width."""
        line = self.lines[number - 1]
        if "D" in line or "d" in line:
            line = _FORTRAN.sub("E", line)
        if width:
            return [line[i : i + width].strip() for i in range(0, len(line), width)]
        return line.replace(",", " ").replace(";", " ").split()

    def _numbers(self, first: int, last: int, width: int) -> Iterator[float]:
        per_line = len(self.words(first, width)) if first <= last else 0
        for number in range(first, last + 1):
            words = self.words(number, width)
            if len(words) > per_line or (len(words) < per_line and number < last):
                self.fail(number, f"{len(words)} values; the lines before have {per_line} each.")
            for word in words:
                yield self.number(number, word)


class Format(NamedTuple):
    """File format: how to recognise a file, name its record and read its components.

    ``matches`` and ``record`` need the first lines of a file only. ``record`` returns None if the
    file cannot be part of a record.
    """

    name: str
    matches: Callable[[RecordText], bool]
    record: Callable[[RecordText], str | None]
    read: Callable[[RecordText], Iterable[Component]]


def unit_named(text: str, where: str) -> str:
    """Return the name in ``UNITS`` of a unit such as ``cm/sec2``, ``cm/s/s``, ``gal`` or ``G``."""
    plain = str(text).strip().lower().replace(" ", "").replace("**", "^").replace("sec", "s")
    plain = re.sub(r"/s(/s|/?\^?2|²)$", "/s^2", plain)
    plain = {"gals": "gal", "milli-g": "mg"}.get(plain, plain)
    if plain not in UNITS:
        raise RecordError(
            f"{where}: {shown(str(text).strip())} is not a unit of acceleration; use one of "
            f"{', '.join(UNITS)}."
        )
    return plain


def direction_named(text: str) -> Direction | None:
    """Return the direction of a name such as ``N``, ``E-W``, ``N55W``, ``UP``, ``270``; or None."""
    plain = text.strip().upper()
    if bearing := _BEARING.fullmatch(plain):
        sign = 1.0 if bearing[1] + bearing[3] in ("NE", "SW") else -1.0
        return (180.0 * (bearing[1] == "S") + sign * float(bearing[2])) % 360.0
    if re.fullmatch(r"\d{1,3}(\.\d*)?", plain) and float(plain) <= 360.0:
        return float(plain) % 360.0
    return _NAMES.get(plain.replace("-", ""))


def units_in(line: str) -> list[str]:
    """Return the units in a line, except units of coordinates, of distances and after numbers."""
    return [] if _OF_PLACES.search(line) else _UNIT.findall(line)


def other_quantity(line: str) -> bool:
    """Return True if a line states that the values are velocities or displacements."""
    return any(map(_OTHER_UNIT.fullmatch, units_in(line))) or bool(_OTHER_QUANTITY.search(line))


def refuse_other_quantity(text: RecordText, number: int, line: str) -> None:
    """Raise an error if a line states that the values are velocities or displacements."""
    if other_quantity(line):
        text.fail(number, f"velocities or displacements, not accelerations: {shown(line)}.")


def start_time(text: RecordText, number: int, pattern: re.Pattern[str], written: str) -> float:
    """Convert a date and time to seconds since 1970.

    The groups of ``pattern`` are named like the arguments of `datetime`; seconds may have decimals.
    """
    match = pattern.match(written)
    try:
        parts = {} if match is None else match.groupdict()
        second = float(parts.pop("second"))
        return datetime(**{k: int(v) for k, v in parts.items()}, tzinfo=UTC).timestamp() + second
    except (KeyError, ValueError):
        text.fail(number, f"{shown(written)} is not a valid date and time of the first sample.")


def record_named(*parts: str) -> str:
    """Join words to a record name that is valid in file names, without / and : of times."""
    words = (re.sub(r"[/:]", "", part) for part in parts)
    return "_".join(filter(None, re.split(r"[^\w.+-]+", " ".join(words))))


def component(
    text: RecordText,
    samples: Samples,
    *,
    unit: str,
    scale: float = 1.0,
    unknown: float | None = None,
    **facts: Any,
) -> Component:
    """Return a component whose samples times ``scale`` are in ``unit``, after checking them."""
    values, first, per_line = samples
    if (place := _filler(values, unknown)) is not None:
        missing = f"{values[place]:.9g} marks a missing sample"
        text.fail(first + place // per_line, f"{missing}; cut or fill the record.")
    values = scale * values
    acceleration = UNITS[unit] * values
    place = int(np.argmax(np.abs(acceleration)))
    if abs(acceleration[place]) > MAX_PEAK_G * STANDARD_GRAVITY:
        text.fail(
            first + place // per_line,
            f"value {place + 1} is {values[place]:.6g} {unit}; the limit is {MAX_PEAK_G:g} g. "
            "Check the unit.",
        )
    return Component(acceleration=acceleration, unit=unit, path=text.path, **facts)


def _filler(values: Floats, unknown: float | None) -> int | None:
    """Return the index of a filler, the value ``unknown`` or nines that repeat or jump, or None."""
    if unknown is not None and (values == unknown).any():
        return int(np.argmax(values == unknown))
    size, steps = np.abs(values), np.abs(np.diff(values))
    powers = 10.0 ** np.floor(np.log10(np.where(size > 0.0, size, 1.0)))
    sizes, counts = np.unique(size[size > 0.0], return_counts=True)
    for value in np.unique(size[size > 9.89 * powers]):
        if not re.fullmatch("0*9{2,}", f"{value:.9g}".replace(".", "")):
            continue
        is_value = size == value
        if is_value.sum() > max(2, counts[sizes != value].max(initial=0)):  # most frequent value
            return int(np.argmax(is_value))
        factor = FILLER_JUMP if is_value.sum() == 1 else 1.0
        between = steps[~is_value[1:] & ~is_value[:-1]]
        jumps = steps[is_value[1:] != is_value[:-1]]
        if jumps.min(initial=np.inf) > factor * between.max(initial=0.0):
            return int(np.argmax(is_value))
    return None
