# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""File formats with all channels of a recorder: COSMOS version 1.20, CSMIP/CDMG, GeoNet.

A channel of COSMOS has text, 100 integers, 100 real numbers, comments, and blocks of values. Each
part states its number of lines or values and their format. V1 (uncorrected) and V2 (corrected)
accelerations are read; velocity and displacement of a V2 channel are skipped. Raw counts (V0) raise
an error. Layouts of the others: Shakal and Huang, Standard tape format for CSMIP strong-motion data
tapes, OSMS 85-03, 1985; GeoNet, Strong motion file formats. Their channels start together.
"""

import re
from collections.abc import Callable, Iterator

from dolfinx_joints.common.parameters import shown
from dolfinx_joints.motions.record_text import (
    Component,
    Direction,
    Format,
    RecordText,
    Samples,
    component,
    direction_named,
    record_named,
    start_time,
    unit_named,
)

_TITLE = re.compile(r".*\(Format\s+v[\d.]+\s+with\s+(\d{1,3})\s+text\s+lines", re.I)
_PART = re.compile(r"\s*(\d+)\s+(?:Integer|Real)-header values follow on\s+(\d+)", re.I)
_COMMENTS = re.compile(r"\s*(\d{1,4})\s+Comment line", re.I)
_START = re.compile(
    r".*\btime:\s*(?P<month>\d\d?)/(?P<day>\d\d?)/(?P<year>\d{4})[,\s]+"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d(?:\.\d*)?)"
)
_NUMBERS = re.compile(
    r"(?P<year>\d{4}) (?P<month>\d+) (?P<day>\d+) "
    r"(?P<hour>\d+) (?P<minute>\d+) (?P<second>\d*\.?\d+)$"
)
_BLOCK = re.compile(r"\s*(\d+)\s+(\w+)\s+pts", re.I)
_END = re.compile(r"\bEnd.of.data\b", re.I)
_WIDTH = re.compile(r"Format\s*=\s*\(\s*([1-9]\d{0,2})\s*[IFEGD]([1-9]\d?)", re.I)
_UNKNOWN = re.compile(r"\bunknown\b.*:[^,]*,\s*([+-]?\d+\.?\d*(?:E[+-]?\d+)?)", re.I)
_CSMIP_TITLE = re.compile(r"\s*(UN)?CORRECTED ACCELEROGRAM\b", re.I)
# Lines from the title to record, channel and block of values; True: uncorrected (volume 1).
_CSMIP_LINES = {True: (3, 6, 27), False: (4, 7, 45)}
_CSMIP_BLOCK = re.compile(
    r"\s*(\d+) (?:accelerogram points at\s+(?P<rate>[\d.]+) pts/sec in units of"
    r"|points of accel data equally spaced at\s+(?P<step>[\d.]+) sec[.,\s]*(?:in|\(units:))"
    r"\s+(?P<unit>[\w/]+)(?:.*\((?P<per_line>[1-9]\d?)F(?P<width>[1-9]\d?)\.)?",
    re.I,
)
_CHANNEL = re.compile(
    r"\s*(?:chan\s*\d+:|component)\s*"
    r"([NS]\s*\d+(?:\.\d+)?\s*[EW]\b|\d+\.\d+|\w+\b(?!\s*\.?\d))",  # also N 28 W, but not E 10 N
    re.I,
)
_GEONET_TITLE = re.compile(r"(un)?corrected accelerogram\s+(\S+).*\bGNS Science", re.I)
_UNIT_CODES = {"2": "g", "4": "cm/s^2", "10": "gal", "11": "mg"}


def _record(text: RecordText) -> str:
    """Return the name of the record: station (line 5) and start time (line 8)."""
    station, start = text.line(5, "the station"), text.line(8, "the starting time")
    code = re.search(r"Code:\s*(\S+)", station) or re.search(r"Statn No:\s*(\S+)", station)
    time = re.search(r"time:\s*([\d/]+)[,\s]+([\d:.]+)", start)
    place = text.path.stem if code is None else code[1]
    return place if time is None else record_named(place, time[1], time[2])


def _channels(text: RecordText) -> Iterator[Component]:
    line = 1
    while line <= len(text.lines) and (title := _TITLE.match(text.lines[line - 1])):
        head, first = line + 7, line + int(title[1])
        integers, second = _header(text, first)
        real, after = _header(text, second)
        unit = _unit(text, first + 1, integers)
        step = text.positive(second + 1, real[61], "the time step [ms] (62nd real number)")
        after = _after_comments(text, after)
        stated = map(_UNKNOWN.search, text.lines[line - 1 : first - 1])
        unknown = next((float(match[1]) for match in stated if match), None)
        samples, line = _blocks(text, after)
        yield component(
            text,
            samples,
            dt=1e-3 * step,
            unit=unit,
            stated=_coded_direction(integers[53]),
            record=_record(text),
            start=_start(text, head, integers, real),
            unknown=unknown,
        )


def _start(text: RecordText, number: int, integers: list[str], real: list[str]) -> float | None:
    """Return the time of the first sample.

    Integers 40 and 42 to 45 are year, month, day, hour and minute; real number 30 is the seconds.
    If one of these is missing (-999), use the text line ``number``, if it states the time.
    """
    numbers = " ".join((integers[39], *integers[41:45], real[29]))
    if _NUMBERS.match(numbers):
        return start_time(text, number, _NUMBERS, numbers)
    line = text.line(number, "the starting time")
    return start_time(text, number, _START, line) if _START.match(line) else None


def _unit(text: RecordText, number: int, integers: list[str]) -> str:
    """Return the name of the unit from the second and third integer, in the line ``number``."""
    if integers[1] not in ("1", "-999"):  # acceleration or not specified
        text.fail(number, f"the channel must have acceleration, code 1, got {integers[1]}.")
    if integers[2] not in _UNIT_CODES:
        codes = ", ".join(f"{code} ({name})" for code, name in _UNIT_CODES.items())
        text.fail(number, f"the unit code is {integers[2]}; use {codes}.")
    return _UNIT_CODES[integers[2]]


def _header(text: RecordText, number: int) -> tuple[list[str], int]:
    """Return the numbers of a header as text, and the number of the line after it."""
    line = text.line(number, "'100 ...-header values follow on ... lines'")
    part, width = _PART.match(line), _WIDTH.search(line)
    if part is None or width is None:
        text.fail(
            number,
            f"must state the number of header values and their format, got {shown(line.strip())}.",
        )
    count, lines = text.count(number, part[1]), text.count(number, part[2], "the number of lines")
    text.line(number + lines, "the end of the header")
    rows = range(number + 1, number + lines + 1)
    words = [word for row in rows for word in text.words(row, int(width[2])) if word]
    if len(words) != 100 or count != 100:
        text.fail(
            number + lines,
            f"{len(words)} header values, but line {number} states {count}; 100 are needed.",
        )
    return words, number + lines + 1


def _after_comments(text: RecordText, number: int) -> int:
    line = text.line(number, "the number of comments")
    match = _COMMENTS.match(line)
    if match is None:
        text.fail(number, f"must state the number of comment lines, got {shown(line.strip())}.")
    return number + int(match[1]) + 1


def _blocks(text: RecordText, first: int) -> tuple[Samples, int]:
    """Return the accelerations of a channel, and the number of the line after its last block."""
    acceleration, number = None, first
    while number <= len(text.lines) and not _TITLE.match(text.lines[number - 1]):
        line = text.lines[number - 1]
        if _END.search(line):
            number += 1
            continue
        block, width = _BLOCK.match(line), _WIDTH.search(line)
        if block is None or width is None:
            text.fail(number, f"must state count and format of values, got {shown(line.strip())}.")
        count = text.count(number, block[1])
        last = number + -(-count // int(width[1]))
        values = text.values(number + 1, count, number, width=int(width[2]), last=last)
        if block[2].lower() == "acceleration" and acceleration is None:
            acceleration = values
        number = last + 1
    if acceleration is None:
        text.fail(
            number - 1, "the channel ends here without accelerations; one block must have them."
        )
    return acceleration, number


def _coded_direction(code: str) -> Direction | None:
    """Return the direction for the 54th integer: azimuth 1 to 360, 400 up, 401 down."""
    azimuth = int(code) if re.fullmatch(r"\d{1,4}", code) else 0
    if 1 <= azimuth <= 360:
        return float(azimuth % 360)
    vertical: dict[int, Direction] = {400: "up", 401: "down"}
    return vertical.get(azimuth)


def _direction_in(text: RecordText, number: int) -> Direction | None:
    channel = _CHANNEL.match(text.lines[number - 1])
    return None if channel is None else direction_named("".join(channel[1].split()))


def _csmip_record(text: RecordText) -> str:
    """Return the name of the record; uncorrected records are separate from corrected ones."""
    title = _CSMIP_TITLE.match(text.lines[0])
    uncorrected = bool(title and title[1])
    words = text.line(1 + _CSMIP_LINES[uncorrected][0], "the number of the record").split()
    return record_named(*words[:1] or [text.path.stem], "uncorrected" if uncorrected else "")


def _csmip_channels(text: RecordText) -> Iterator[Component]:
    number = 1
    while number <= len(text.lines):
        title = _CSMIP_TITLE.match(text.lines[number - 1])
        if title is None:
            if _CSMIP_BLOCK.match(text.lines[number - 1]):
                text.fail(number, "accelerations of a channel without 'Corrected accelerogram'.")
            number += 1  # a line of velocities or displacements, or the end of a channel
            continue
        _, channel_line, block_line = _CSMIP_LINES[bool(title[1])]
        first, number = number, number + block_line
        line = text.line(number, "number, time step and unit of the accelerations")
        block = _CSMIP_BLOCK.match(line)
        if block is None:
            got = f"got {shown(line.strip())}. Values at unequal times are not read; use volume 2."
            text.fail(number, f"must state number, time step and unit of the accelerations, {got}")
        count = text.count(number, block[1])
        interval = text.positive(number, block["step"] or block["rate"], "the time step or rate")
        width = int(block["width"] or (9 if title[1] else 10))
        last = number + -(-count // int(block["per_line"] or 8))
        yield component(
            text,
            text.values(number + 1, count, number, width=width, last=last),
            dt=interval if block["step"] else 1.0 / interval,
            unit=unit_named(block["unit"], f"{text.path}, line {number}"),
            stated=_direction_in(text, first + channel_line),
            record=_csmip_record(text),
        )
        number = last + 1


def _geonet_record(text: RecordText) -> str | None:
    title = _GEONET_TITLE.match(text.lines[0])
    return title and record_named(title[2], "uncorrected" if title[1] else "")


def _geonet_channels(text: RecordText) -> Iterator[Component]:
    """Read the channels: 16 lines of text, 40 integers, 60 real numbers, and values, all 8 wide."""
    first = 1
    while first <= len(text.lines):
        if not _GEONET_TITLE.match(text.lines[first - 1]):
            text.fail(first, f"a channel must begin here, got {shown(text.lines[first - 1])}.")
        text.line(first + 26, "the first values")
        counts, reals = text.words(first + 19, 8)[3:6], text.words(first + 22, 8)
        if len(counts) < 3 or len(reals) < 6 or "-" in "".join(counts[1:]):
            text.fail(first + 19, "numbers of values or the time step are missing or negative.")
        count = text.count(first + 19, counts[0])
        # Accelerations, velocities and displacements, ten in a line.
        lines = [-(-int(text.number(first + 19, word)) // 10) for word in counts]
        values = text.values(first + 26, count, first + 19, width=8, last=first + 25 + lines[0])
        yield component(
            text,
            values,
            dt=text.positive(first + 22, reals[5], "the time step"),
            unit="mm/s^2",
            stated=_direction_in(text, first + 12),
            record=_geonet_record(text),
        )
        first += 26 + sum(lines)


def _titled(pattern: re.Pattern[str]) -> Callable[[RecordText], bool]:
    return lambda text: pattern.match(text.lines[0]) is not None


RECORDERS = (
    Format("COSMOS", _titled(_TITLE), _record, _channels),
    Format("GeoNet", _titled(_GEONET_TITLE), _geonet_record, _geonet_channels),
    Format("CSMIP", _titled(_CSMIP_TITLE), _csmip_record, _csmip_channels),
)
