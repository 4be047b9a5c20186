# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""File formats with all channels of a recorder in one file: CSMIP/CDMG, GeoNet, AFAD text.

Layouts: A. F. Shakal and M. J. Huang, Standard tape format for CSMIP strong-motion data tapes,
OSMS 85-03, 1985; GeoNet, Strong motion file formats. AFAD files have lines ``KEY : value`` above
three columns. Channels of a file start together.
"""

import re
from collections.abc import Iterator

from dolfinx_joints.common.parameters import shown
from dolfinx_joints.motions.record_text import (
    Component,
    Format,
    RecordText,
    Samples,
    component,
    direction_named,
    record_named,
    start_time,
    unit_named,
)

_CSMIP_TITLE = re.compile(r"\s*(UN)?CORRECTED ACCELEROGRAM\b", re.I)
_CSMIP_LINES = {True: (3, 6, 27), False: (4, 7, 45)}
"""Lines after the title with record, channel and block of values; True: uncorrected."""
_CSMIP_BLOCK = re.compile(
    r"\s*(\d+) (?:accelerogram points at\s+(?P<rate>[\d.]+) pts/sec in units of"
    r"|points of accel data equally spaced at\s+(?P<step>[\d.]+) sec[.,\s]*(?:in|\(units:))"
    r"\s+(?P<unit>[\w/]+)",
    re.I,
)
_CSMIP_WIDTH = re.compile(r"\((\d+)F(\d+)\.\d+\)", re.I)
_CHANNEL = re.compile(r"\s*(?:chan\s*\d+:|component)\s*(\w+)", re.I)
_GEONET_TITLE = re.compile(r"(un)?corrected accelerogram\s+(\S+).*\bGNS Science", re.I)
_AFAD_TITLE = "STRONG GROUND MOTION RECORDS OF TURK"
_AFAD_KEY = re.compile(r"([A-Z ]+?)\s*(?:\((\w+)\))?\s*:\s*(.*)")
_AFAD_START = re.compile(
    r"(?P<day>\d\d?)/(?P<month>\d\d?)/(?P<year>\d{4}) "
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d(?:\.\d*)?)"
)


def _named(record: str, uncorrected: str | None) -> str:
    """Return the name of a record, different for corrected and uncorrected values."""
    return record_named(record, "uncorrected" if uncorrected else "")


def _csmip_record(text: RecordText) -> str:
    title = _CSMIP_TITLE.match(text.lines[0])
    uncorrected = title and title[1]
    line = text.line(1 + _CSMIP_LINES[bool(uncorrected)][0], "the number of the record")
    return _named((line.split() or [text.path.stem])[0], uncorrected)


def _csmip_channels(text: RecordText) -> Iterator[Component]:
    number = 1
    while number <= len(text.lines):
        title = _CSMIP_TITLE.match(text.lines[number - 1])
        if title is None:
            number += 1  # a line of velocities or displacements, or the end of a channel
            continue
        _, channel_line, block_line = _CSMIP_LINES[bool(title[1])]
        line = text.line(number + block_line, "number, time step and unit of the accelerations")
        block, channel = _CSMIP_BLOCK.match(line), text.lines[number + channel_line - 1]
        number += block_line
        if block is None:
            text.fail(
                number,
                "must state number, time step and unit of the accelerations, got "
                f"{shown(line.strip())}. Values at unequal times are not read; use volume 2.",
            )
        count, width = text.count(number, block[1]), _CSMIP_WIDTH.search(line)
        usual = (8, 9 if title[1] else 10)
        per_line, digits = usual if width is None else (int(width[1]), int(width[2]))
        last = number + -(-count // per_line)
        stated = _CHANNEL.match(channel)
        step = block["step"] or block["rate"]
        interval = text.positive(number, step, "the time step or rate")
        yield component(
            text,
            text.values(number + 1, count, number, width=digits, last=last),
            dt=interval if block["step"] else 1.0 / interval,
            unit=unit_named(block["unit"], f"{text.path}, line {number}"),
            stated=None if stated is None else direction_named(stated[1]),
            record=_csmip_record(text),
        )
        number = last + 1


def _geonet_record(text: RecordText) -> str | None:
    title = _GEONET_TITLE.match(text.lines[0])
    return None if title is None else _named(title[2], title[1])


def _geonet_channels(text: RecordText) -> Iterator[Component]:
    """Read the channels: 16 lines of text, 40 integers, 60 real numbers, and values, all 8 wide."""
    first = 1
    while first <= len(text.lines):
        if not _GEONET_TITLE.match(text.lines[first - 1]):
            text.fail(first, f"a channel must begin here, got {shown(text.lines[first - 1])}.")
        text.line(first + 26, "the first values")
        counts = text.words(first + 19, 8)[3:6]  # accelerations, velocities, displacements
        reals = text.words(first + 22, 8)
        if len(counts) < 3 or len(reals) < 6:
            text.fail(first + 19, "the numbers of values or the time step are missing.")
        count = text.count(first + 19, counts[0])
        lines = [-(-int(text.number(first + 19, word)) // 10) for word in counts]
        stated = _CHANNEL.match(text.lines[first + 11])
        last = first + 25 + lines[0]
        yield component(
            text,
            text.values(first + 26, count, first + 19, width=8, last=last),
            dt=text.positive(first + 22, reals[5], "the time step"),
            unit="mm/s^2",
            stated=None if stated is None else direction_named(stated[1]),
            record=_geonet_record(text),
        )
        first += 26 + sum(lines)


def _afad_keys(text: RecordText) -> dict[str, tuple[int, str, str]]:
    """Return line number, unit and value by key."""
    matches = [(n, _AFAD_KEY.match(line)) for n, line in enumerate(text.lines[:20], start=1)]
    return {m[1]: (n, m[2] or "", m[3].strip()) for n, m in matches if m}


def _afad_record(text: RecordText) -> str:
    keys, none = _afad_keys(text), (0, "", "")
    time = keys.get("RECORD TIME", none)[2].partition("(")[0]
    return record_named(keys.get("STATION ID", none)[2], time) or text.path.stem


def _read_afad(text: RecordText) -> list[Component]:
    keys = _afad_keys(text)
    for key in ("NUMBER OF DATA", "SAMPLING INTERVAL", "RAW PGA VALUES", "RECORD TIME"):
        if key not in keys:
            text.fail(1, f"the header of an AFAD file must have the key {key}.")
    heading = next((n for n, line in enumerate(text.lines[:25], 1) if "N-S  " in line), 0)
    names = [direction_named(word) for word in text.words(heading)] if heading else []
    if None in names or len(names) != 3:
        text.fail(1, "a line 'N-S E-W U-D' must be above the columns of an AFAD file.")
    number, _, stated = keys["NUMBER OF DATA"]
    values = text.rows(heading + 1, 3)
    if len(values) != text.count(number, stated):
        text.fail(len(text.lines), f"{len(values)} rows, but line {number} states {stated}.")
    pga, unit, _ = keys["RAW PGA VALUES"]
    line, _, step = keys["SAMPLING INTERVAL"]
    begin, _, began = keys["RECORD TIME"]
    return [
        component(
            text,
            Samples(column, heading + 1),
            dt=text.positive(line, step, "the sampling interval"),
            unit=unit_named(unit, f"{text.path}, line {pga}"),
            stated=name,
            record=_afad_record(text),
            start=start_time(text, begin, _AFAD_START, began),
        )
        for name, column in zip(names, values.T, strict=True)
    ]


RECORDERS = (
    Format(
        "GeoNet",
        lambda text: _GEONET_TITLE.match(text.lines[0]) is not None,
        _geonet_record,
        lambda text: list(_geonet_channels(text)),
    ),
    Format(
        "CSMIP",
        lambda text: _CSMIP_TITLE.match(text.lines[0]) is not None,
        _csmip_record,
        lambda text: list(_csmip_channels(text)),
    ),
    Format("AFAD", lambda text: text.lines[0].startswith(_AFAD_TITLE), _afad_record, _read_afad),
)
