# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""File formats with one component per file: AT2, ESM/ITACA, K-NET, SMC, AFAD; all formats.

Each format is recognised by its first lines and read according to its published description. Values
are not corrected; K-NET records, for example, have an offset.
"""

import re
from datetime import UTC, datetime, timedelta

from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.motions.columns import read_columns
from dolfinx_joints.motions.record_text import (
    Component,
    Direction,
    Format,
    RecordText,
    Source,
    component,
    direction_named,
    other_quantity,
    record_named,
    refuse_other_quantity,
    start_time,
    unit_named,
)
from dolfinx_joints.motions.recorders import RECORDERS

_COUNT_AND_STEP = (
    re.compile(r"\bNPTS\s*=\s*(\d+)\s*,\s*DT\s*=\s*([\d.]+(?:E[+-]?\d+)?)\s*([A-Z]*)", re.I),
    re.compile(r"^\s*(\d+)\s+([\d.]+(?:E[+-]?\d+)?)\s+NPTS\s*,\s*DT\b\W*([A-Z]*)", re.I),
)
_SECONDS = {"": 1.0, "S": 1.0, "SEC": 1.0, "SECS": 1.0, "SECONDS": 1.0, "MS": 1e-3, "MSEC": 1e-3}
_UNIT_IS_G = re.compile(r"\bUNITS?\s+OF\s+G(?![\w/*^])", re.I)
_AT2_STEM = re.compile(
    # The last two digits of NET.STATION.BHE.00 are the location of the sensor, not an azimuth. In
    # EW1 and EW2 the digit separates the sensor in the borehole from that at the surface. L and T
    # (longitudinal, transverse) and the digits of BH1, BH2 name components of unknown azimuth.
    r"(.+?)(?:[-_.]?(UP|DWN|DOWN|VERT?|[NS]\d\d?[EW]|(?:NS|EW|UD)[12]?|\d{3})"
    r"|\.[A-Z]{2}([NEZ12])(?:\.\d\d)?"
    r"|(?:[-_.]|(?<=\d))(V|[NESW])|[-_.](?:([LTVH])\d?|((?<!\.[A-Z]{2}\d\.)\d{1,2})))",
    re.I,
)
_ESM_KEY = re.compile(r"([A-Z][A-Z0-9_/^]*):(.*)")
_SCALE = re.compile(r"([\d.]+)\(([^)]*)\)/([\d.]+)")
_ESM_START = re.compile(
    r"(?P<year>\d{4})(?P<month>\d\d)(?P<day>\d\d)_"
    r"(?P<hour>\d\d)(?P<minute>\d\d)(?P<second>\d\d(?:\.\d*)?)$"
)
_KNET_START = re.compile(
    r"(?P<year>\d{4})/(?P<month>\d\d?)/(?P<day>\d\d?)\s+"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d(?:\.\d*)?)$"
)
_ESM_DIRECTIONS: dict[str, Direction] = {"N": 0.0, "E": 90.0, "Z": "up"}
_ESM_DIRECTIONS |= {"NS": 0.0, "WE": 90.0, "EW": 90.0, "UP": "up"}  # ITACA until 2010
_AFAD = "STRONG GROUND MOTION RECORDS OF TURK"
_AFAD_HEADER = re.compile(
    r".*^NUMBER OF DATA\s*: (\d{1,9})$.*^SAMPLING INTERVAL\s*\(sec\)\s*: (\S+)$"
    r".*^RAW PGA VALUES\s*\((\S+)\).*^(\s*N-S\s.*?)$",
    re.M | re.S,
)
_KNET_DIRECTIONS: dict[str, Direction] = {
    **dict.fromkeys(("N-S", "1", "4"), 0.0),
    **dict.fromkeys(("E-W", "2", "5"), 90.0),
    **dict.fromkeys(("U-D", "3", "6"), "up"),
}


def _at2_matches(text: RecordText) -> bool:
    head = " ".join(x for x in text.lines[:4] if x.lstrip()[:1] not in "#%").upper()
    return "NPTS" in head or "UNITS OF G" in head or head.startswith("PEER ")


def at2_parts(path: Source) -> tuple[str | None, Direction | None]:
    """Return the record, None without a component in the name of the file, and the direction."""
    match = _AT2_STEM.fullmatch(path.stem)
    if match is None:
        return None, None
    word = next(filter(None, match.groups()[1:]))
    below = "_underground" if re.fullmatch("(NS|EW|UD)1", word, re.I) else ""
    bare = word if len(word) > 1 and word[0].isdigit() else word.rstrip("12")
    return match[1] + below, direction_named(bare)  # None for BH1 and BH2


def _at2_record(text: RecordText) -> str | None:
    """Return the name of the record; None for files of velocities (VT2) and displacements (DT2)."""
    kind = text.lines[2] if len(text.lines) > 2 else ""
    return None if other_quantity(kind) else at2_parts(text.path)[0]


def _read_at2(text: RecordText) -> list[Component]:
    unit_line = text.line(3, "the unit, 'UNITS OF G'")
    refuse_other_quantity(text, 3, unit_line)
    if not _UNIT_IS_G.search(unit_line):
        text.fail(3, f"must have 'UNITS OF G', got {shown(unit_line.strip())}.")
    line = text.line(4, "'NPTS= count, DT= step SEC'")
    match = next(filter(None, (pattern.search(line) for pattern in _COUNT_AND_STEP)), None)
    if match is None:
        text.fail(4, f"must have 'NPTS= count, DT= step SEC', got {shown(line.strip())}.")
    count, dt = text.count(4, match[1]), text.positive(4, match[2], "the time step")
    if match[3].upper() not in _SECONDS:
        text.fail(4, f"the unit of DT must be SEC or MSEC, got {shown(match[3])}.")
    record, suggested = at2_parts(text.path)
    return [
        component(
            text,
            text.values(5, count, 4),
            dt=_SECONDS[match[3].upper()] * dt,
            unit="g",
            stated=direction_named(text.lines[1].rpartition(",")[2]),
            suggested=suggested,
            record=record or text.path.stem,
        )
    ]


def _keys(text: RecordText) -> dict[str, tuple[int, str]]:
    keys = {}
    for number, line in enumerate(text.lines, start=1):
        match = _ESM_KEY.match(line)
        if match is None:
            break
        keys[match[1]] = (number, match[2].strip())
    return keys


def _esm_matches(text: RecordText) -> bool:
    keys = _keys(text)
    return "EVENT_NAME" in keys or "SAMPLING_INTERVAL_S" in keys


def _esm_record(text: RecordText) -> str | None:
    keys = _keys(text)
    if not keys.get("DATA_TYPE", (0, ""))[1].endswith("ACCELERATION"):
        return None
    network, station, day, time = (
        keys.get(key, (0, ""))[1]
        for key in ("NETWORK", "STATION_CODE", "EVENT_DATE_YYYYMMDD", "EVENT_TIME_HHMMSS")
    )
    return record_named(f"{network}.{station}".strip("."), day, time)


def _read_esm(text: RecordText) -> list[Component]:
    keys = _keys(text)
    stream = "COMPONENT" if "COMPONENT" in keys else "STREAM"  # the former in ITACA until 2010
    for key in ("SAMPLING_INTERVAL_S", "NDATA", "UNITS", "DATA_TYPE", stream):
        if key not in keys:
            raise RecordError(f"{text.path}: the header of an ESM file must have the key {key}.")
    number, kind = keys["DATA_TYPE"]
    if not kind.endswith("ACCELERATION"):  # also PROCESSED and UNPROCESSED
        text.fail(number, f"DATA_TYPE must be ACCELERATION, got {shown(kind)}.")
    dt = text.positive(*keys["SAMPLING_INTERVAL_S"], "SAMPLING_INTERVAL_S")
    count = text.count(*keys["NDATA"], "NDATA")
    number, unit = keys["UNITS"]
    unit = unit_named(unit, f"{text.path}, line {number}")
    number, first = keys.get("DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS", (0, ""))
    if "TIME_FIRST_SAMPLE_S" in keys:  # ITACA until 2010
        number, first = keys["TIME_FIRST_SAMPLE_S"]
        first = first and f"{keys.get('EVENT_DATE_YYYYMMDD', (0, ''))[1]}_{first}"
    way = keys[stream][1]
    return [
        component(
            text,
            text.values(len(keys) + 1, count, keys["NDATA"][0]),
            dt=dt,
            unit=unit,
            stated=_ESM_DIRECTIONS.get(way, _ESM_DIRECTIONS.get(way[-1:])),
            record=_esm_record(text) or text.path.stem,
            start=start_time(text, number, _ESM_START, first) if first else None,
        )
    ]


def _knet(text: RecordText, key: str) -> tuple[int, str]:
    for number, line in enumerate(text.lines[:17], start=1):
        if line.startswith(key):
            return number, line[len(key) :].strip()
    raise RecordError(f"{text.path}: the header of a K-NET file must have the line {key!r}.")


def _knet_record(text: RecordText) -> str:
    station, time = _knet(text, "Station Code")[1], _knet(text, "Origin Time")[1]
    below = "underground" if _knet(text, "Dir.")[1] in ("1", "2", "3") else ""
    return record_named(station, time, below)


def _read_knet(text: RecordText) -> list[Component]:
    text.line(18, "the first values")
    number, rate = _knet(text, "Sampling Freq(Hz)")
    frequency = text.positive(number, rate.removesuffix("Hz").strip(), "the sampling frequency")
    number, seconds = _knet(text, "Duration Time")
    seconds = seconds.removeprefix("(s)").strip()
    duration = text.positive(number, seconds, "the duration")
    count = text.count(number, f"{duration * frequency:.0f}", "duration times sampling frequency")
    line, scale = _knet(text, "Scale Factor")
    match = _SCALE.fullmatch(scale)
    if match is None:
        text.fail(line, f"Scale Factor must have the form 3920(gal)/6182761, got {shown(scale)}.")
    unit = unit_named(match[2], f"{text.path}, line {line}")
    first, began = _knet(text, "Record Time")
    factor = text.positive(line, match[1], "scale") / text.positive(line, match[3], "scale")
    return [
        component(
            text,
            text.values(18, count, number),
            scale=factor,
            dt=1.0 / frequency,
            unit=unit,
            stated=_KNET_DIRECTIONS.get(_knet(text, "Dir.")[1]),
            record=_knet_record(text),
            start=start_time(text, first, _KNET_START, began),
        )
    ]


def _smc_matches(text: RecordText) -> bool:
    return re.match(r"\s*\d\s+[A-Z ]+$", text.lines[0]) is not None and text.lines[1:2] == ["*"]


def _smc_record(text: RecordText) -> str:
    day = "-".join(text.line(4, "the date of the event").split()[:3])
    station = text.line(6, "the station").partition("component")[0]
    return record_named(station.removeprefix("station ="), day)


def _smc_start(integers: list[str]) -> float | None:
    """Return the time from integers 2 to 7: year, day of the year, hour, minute, s, ms; or None."""
    missing, *parts = integers[:7]
    if missing in parts or not all(part.isdigit() for part in parts) or not int(parts[0]):
        return None
    year, day, hour, minute, second, ms = (int(part) for part in parts)
    since = timedelta(days=day - 1, hours=hour, minutes=minute, seconds=second, milliseconds=ms)
    return (datetime(year, 1, 1, tzinfo=UTC) + since).timestamp()


def _read_smc(text: RecordText) -> list[Component]:
    kind = text.lines[0].strip()
    if kind != "2 CORRECTED ACCELEROGRAM":
        text.fail(
            1, f"must be '2 CORRECTED ACCELEROGRAM', sampled at equal steps, got {shown(kind)}."
        )
    text.line(27, "the end of the headers")
    integers = [word for number in range(12, 18) for word in text.words(number, 10)]
    if len(integers) != 48:
        text.fail(17, f"lines 12 to 17 must have 48 integers, got {len(integers)}.")
    if integers[17] == "1":
        text.fail(14, "the file flags a problem of the record (18th integer is 1).")
    rate = text.positive(18, (*text.words(18, 15), "", "")[1], "the sampling rate")
    count = text.count(14, integers[16])
    comments = int(text.number(13, integers[15], "the number of comments"))
    tilt, azimuth = (text.number(13, word, "orientation") for word in integers[12:14])
    sideways = direction_named(f"{azimuth:g}") if tilt == 90.0 else None
    vertical: dict[float, Direction] = {0.0: "up", 180.0: "down"}
    return [
        component(
            text,
            text.values(28 + comments, count, 14, width=10),
            dt=1.0 / rate,
            unit="cm/s^2",
            stated=vertical.get(tilt, sideways),
            record=_smc_record(text),
            start=_smc_start(integers),
        )
    ]


def _read_afad(text: RecordText) -> list[Component]:
    header = _AFAD_HEADER.match("\n".join(text.lines[:25]))
    if header is None:
        needed = "NUMBER OF DATA, SAMPLING INTERVAL (sec), RAW PGA VALUES (gal) and N-S E-W U-D"
        text.fail(1, f"the header of an AFAD file must have {needed}, in this order.")
    count, step, unit, names = header.groups()
    number = header[0].count("\n") + 1
    text.lines[:number] = ["#"] * number  # a file in plain columns is left
    parts = read_columns(text, unit, text.positive(number, step, "the step"), names.split())
    if (rows := len(parts[0].acceleration)) != int(count):
        text.fail(len(text.lines), f"{rows} rows, but the header states {count}.")
    return parts


# The first format that matches is used. AT2 is last, because only words in its header identify it.
FORMATS = (
    Format("K-NET", lambda text: text.lines[0].startswith("Origin Time"), _knet_record, _read_knet),
    *RECORDERS,
    Format("SMC", _smc_matches, _smc_record, _read_smc),
    Format("ESM/ITACA", _esm_matches, _esm_record, _read_esm),
    Format("AFAD", lambda text: _AFAD in text.lines[0], lambda text: text.path.stem, _read_afad),
    Format("PEER AT2", _at2_matches, _at2_record, _read_at2),
)
