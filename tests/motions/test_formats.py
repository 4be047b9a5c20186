# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record files of every format: what they hold, and what is said of malformed ones.

The files are made here after the published descriptions of the formats. The values of every file
are those of ``WAVE``, in cm/s^2, to the digits of the format.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.reading import read_components, read_record, record_names
from dolfinx_joints.motions.record_text import direction_named, unit_named

WAVE = np.round(25.0 * np.sin(0.7 * np.arange(37)), 3)
"""Accelerations [cm/s^2]."""


def rows(values: Sequence[float], per_line: int, form: str) -> list[str]:
    """Values in lines of a fixed format."""
    cells = [form.format(value) for value in values]
    return ["".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]


def at2(count: str = "37", unit: str = "G", values: Sequence[float] = WAVE, **_: object) -> str:
    """PEER AT2: four header lines, the unit g."""
    header = ["PEER NGA STRONG MOTION DATABASE RECORD", "Somewhere, 1/1/2000, Station, 0"]
    header += [f"ACCELERATION TIME SERIES IN UNITS OF {unit}", f"NPTS= {count}, DT= .0100 SEC"]
    in_g = np.asarray(values) / (100.0 * STANDARD_GRAVITY)
    return "\n".join(header + rows(in_g, 5, " {:15.9E}")) + "\n"


def esm(
    count: str = "37",
    unit: str = "cm/s^2",
    values: Sequence[float] = WAVE,
    stream: str = "HNN",
    kind: str = "ACCELERATION",
    start: str = "10:20:46.000",
) -> str:
    """ESM and ITACA: lines ``KEY: value``, then one value on each line."""
    header = ["EVENT_NAME: SOMEWHERE", "EVENT_DATE_YYYYMMDD: 20000101", "EVENT_TIME_HHMMSS: 102030"]
    header += ["NETWORK: XX", "STATION_CODE: ABC", "VS30_M/S: ", "SAMPLING_INTERVAL_S: 0.010000"]
    header += [f"NDATA: {count}", f"STREAM: {stream}", f"UNITS: {unit}", "PGA_CM/S^2: 25.0"]
    header += [f"DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS: 20000101_{start.replace(':', '')}"]
    header += [f"DATA_TYPE: {kind}", "USER1: some.py --le 0.1", "USER5: "]
    return "\n".join(header + rows(values, 1, "{:.6f}")) + "\n"


def knet(
    count: str = "0.37",
    unit: str = "gal",
    values: Sequence[float] = WAVE,
    direction: str = "N-S",
    start: str = "10:20:46",
) -> str:
    """K-NET and KiK-net: 17 header lines, then counts; here 1000 of them are one gal."""
    names = ["Origin Time", "Lat.", "Long.", "Depth. (km)", "Mag.", "Station Code", "Station Lat."]
    names += ["Station Long.", "Station Height(m)", "Record Time", "Sampling Freq(Hz)"]
    names += ["Duration Time(s)", "Dir.", "Scale Factor", "Max. Acc. (gal)", "Last Correction"]
    words = ["2000/01/01 10:20:00", "37.798", "142.2", "36", "5.7", "ABC001", "38.7", "141.5", "79"]
    words += [f"2000/01/01 {start}", "100Hz", count, direction, f"2000({unit})/2000000", "25.0"]
    words += ["2000/01/01 10:20:31"]
    header = [f"{name:<18s}{word}" for name, word in zip(names, words, strict=True)]
    counts = np.round(1000.0 * np.asarray(values))
    return "\n".join([*header, "Memo.", *rows(counts, 8, "{:9.0f}")]) + "\n"


def smc(
    count: str = "37",
    unit: str = "",
    values: Sequence[float] = WAVE,
    tilt: int = 90,
    azimuth: int = 360,
    kind: str = "2 CORRECTED ACCELEROGRAM",
    start: str = "",
) -> str:
    """SMC: 11 lines of text, 48 whole and 50 real numbers, comments, values 10 wide."""
    text = [kind, "*", "ABC", "     2000  1  1    1020 Somewhere", "Moment Mag= 6.0"]
    text += ["station = Town, Street  component= 360", *["*"] * 5]
    whole = [-32768] * 48
    if start:
        hour, minute, second = start.split(":")
        ms = round(1000 * float(second))
        whole[1:7] = [2000, 1, int(hour), int(minute), ms // 1000, ms % 1000]
    whole[12], whole[13], whole[15], whole[17] = tilt, azimuth, 2, 0
    cells = [f"{number:10d}" for number in whole]
    cells[16] = f"{count:>10s}"
    real = [1.7e38] * 50
    real[1] = 100.0
    middle = ["".join(cells[i : i + 8]) for i in range(0, 48, 8)] + rows(real, 5, "{:15.7E}")
    data = [f"{value:10.4E}".replace("E+0", "E+").replace("E-0", "E-") for value in values]
    lines = ["".join(f"{c:>10s}" for c in data[i : i + 8]) for i in range(0, len(data), 8)]
    return "\n".join([*text, *middle, "|", "|two comments", *lines]) + "\n"


def cosmos(
    count: str = "37",
    unit: str = "4",
    values: Sequence[float] = WAVE,
    azimuth: int = 360,
    said: str = "04",
    start: str = "10:20:46.0",
) -> str:
    """COSMOS V2: text, 100 whole and 100 real numbers, comments, blocks of values 10 wide."""
    text = ["Corrected acceleration    (Format v01.20 with 13 text lines) Src: made up"]
    text += ["Record of Somewhere", "Hypocenter:", "Origin:", "Statn No: 01-1  Code:CE-ABC  Town"]
    text += ["Coords:", "Recorder:", f"Rcrd start time:01/01/2000, {start} UTC (Q=2) RcrdId: 1"]
    text += ["line"] * 5
    whole = [2, 1, 0, 120, *[-999] * 96]
    whole[53] = azimuth
    cells = [f"{number:8d}" for number in whole]
    cells[2] = f"{unit:>8s}"
    real = [-999.0] * 100
    real[33], real[61] = 0.02, 10.0
    middle = [" 100 Integer-header values follow on  10 lines, Format= (10I8)"]
    middle += ["".join(cells[i : i + 10]) for i in range(0, 100, 10)]
    middle += [" 100 Real-header values follow on  17 lines, Format= (6F13.6)"]
    middle += rows(real, 6, "{:13.6f}")
    middle += ['   2 Comment line(s) follow, each starting with a "|":', "| one", "| two"]
    block = f"  {count}  acceleration pts, approx 0 secs, units=cm/sec2({said}),Format=(8F10.5)"
    speed = "  3  velocity pts, approx 0 secs, units=cm/sec(05),Format=(8F10.5)"
    end = "End-of-data for Chan  1 acceleration"
    data = rows(values, 8, "{:10.5f}")
    return "\n".join([*text, *middle, block, *data, speed, *rows([0, 1, 2], 8, "{:10.5f}"), end])


def columns(
    count: str = "",
    unit: str = "cm/s^2",
    values: Sequence[float] = WAVE,
    direction: str = "N",
    start: str = "0:0:0",
) -> str:
    """Plain columns: time and one component."""
    first = float(start.split(":")[2])
    lines = [f"{first + 0.01 * i:.3f}, {value:.3f}" for i, value in enumerate(values)]
    return "\n".join([f"# unit: {unit}", f"# columns: time {direction}", *lines]) + "\n"


FORMATS: dict[str, Callable[..., str]] = {
    "at2": at2,
    "esm": esm,
    "knet": knet,
    "smc": smc,
    "cosmos": cosmos,
    "columns": columns,
}
# Every value to half of the last digit that the format keeps, in cm/s^2.
DIGITS = {"at2": 1e-6, "esm": 1e-9, "knet": 1e-9, "smc": 5e-4, "cosmos": 1e-9, "columns": 1e-9}


def write(directory: Path, content: str | bytes, name: str = "file.txt") -> Path:
    """Write a file."""
    path = directory / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return path


def error_message(path: Path) -> str:
    """The error message on a file, without the file's name."""
    with pytest.raises(RecordError) as caught:
        read_components(path)
    sentence = str(caught.value)
    assert sentence.startswith(str(path))
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence.removeprefix(str(path))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_every_format_is_found_by_content_and_converted(
    tmp_path: Path, name: str, newline: str
) -> None:
    path = write(tmp_path, FORMATS[name]().replace("\n", newline), "no_telling_name")
    (found,) = read_components(path)
    np.testing.assert_allclose(100.0 * found.acceleration, WAVE, atol=DIGITS[name], rtol=0.0)
    assert found.dt == pytest.approx(0.01, rel=1e-12)
    assert found.direction == 0.0
    assert found.path == path


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_that_ends_in_its_header_is_an_error(tmp_path: Path, name: str) -> None:
    lines = FORMATS[name]().splitlines()
    error_message(write(tmp_path, "\n".join(lines[: 1 if name == "columns" else 3])))


@pytest.mark.parametrize(
    ("name", "count", "message"),
    [
        ("at2", "36", "line 12: 37 values up to this line, but line 4 states 36"),
        ("esm", "38", "line 52: 37 values up to this line, but line 8 states 38"),
        ("knet", "0.38", "line 22: 37 values up to this line, but line 12 states 38"),
        ("smc", "30", "line 34: 37 values up to this line, but line 14 states 30"),
        ("smc", "-32768", "line 14: the number of values must be an integer of 2 or more"),
        ("cosmos", "40", "line 51: 37 values up to this line, but line 46 states 40"),
        ("cosmos", "30", "line 50: 32 values up to this line, but line 46 states 30"),
    ],
)
def test_a_wrong_count_is_an_error(tmp_path: Path, name: str, count: str, message: str) -> None:
    sentence = error_message(write(tmp_path, FORMATS[name](count=count)))
    assert message in sentence


@pytest.mark.parametrize("name", FORMATS)
def test_text_among_the_numbers_is_an_error(tmp_path: Path, name: str) -> None:
    word, lines = "NaN", FORMATS[name]().rstrip("\n").split("\n")
    place = 48 if name == "cosmos" else len(lines) - 2
    wide = {"knet": 9, "smc": 10, "cosmos": 10, "at2": 16}.get(name)
    keep = lines[place][wide:] if wide else ""
    lines[place] = f"{word:>{wide}s}{keep}" if wide else lines[place].split(",")[0] + f", {word}"
    if name == "esm":
        lines[place] = word
    assert f"line {place + 1}: {word!r} is not a finite number" in error_message(
        write(tmp_path, "\n".join(lines))
    )


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("at2", "CM/S/S", "line 3: must have 'UNITS OF G', got"),
        ("esm", "m", "line 10: 'm' is not a unit of acceleration; use one of m/s^2, cm/s^2"),
        ("knet", "kine", "line 14: 'kine' is not a unit"),
        ("cosmos", "5", "line 15: the unit code is 5; use 2 (g), 4 (cm/s^2), 10 (gal), 11 (mg)"),
        ("columns", "ft/s^2", "line 1: 'ft/s^2' is not a unit"),
    ],
)
def test_unknown_and_mixed_units_are_errors(
    tmp_path: Path, name: str, unit: str, message: str
) -> None:
    assert message in error_message(write(tmp_path, FORMATS[name](unit=unit)))


def test_a_unit_that_cannot_be_true_is_an_error(tmp_path: Path) -> None:
    # 25 cm/s^2 that are said to be g would be 25 times gravity.
    path = write(tmp_path, esm(unit="g"))
    place = int(np.argmax(np.abs(WAVE)))
    message = f"line {16 + place}: value {place + 1} is {WAVE[place]:g} g; the limit is 20 g"
    assert message in error_message(path)


@pytest.mark.parametrize("coding", ["latin-1", "utf-8", "utf-8-sig"])
def test_a_unit_is_read_in_any_coding(tmp_path: Path, coding: str) -> None:
    # Spreadsheets begin their UTF-8 with a byte order mark.
    path = write(tmp_path, columns(unit="cm/s²").encode(coding))
    (found,) = read_components(path)
    assert found.unit == "cm/s^2"


def test_junk_is_an_error(tmp_path: Path) -> None:
    for content, message in (
        (b" \n\n", " is empty."),
        (b"PEER" + b"\0" * 100, " is not a text file."),
        (
            b"Dear reader,\nno numbers here.\n",
            " has an unknown format (supported: K-NET, COSMOS, GeoNet, CSMIP, SMC, ESM/",
        ),
    ):
        assert error_message(write(tmp_path, content, "junk.AT2")).startswith(message)


def test_what_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    assert error_message(tmp_path / "none") == " cannot be read: No such file or directory."


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (esm(kind="VELOCITY"), "line 13: DATA_TYPE must be ACCELERATION, got 'VELOCITY'"),
        (esm().replace("NDATA", "COUNT"), ": the header of an ESM file must have the key NDATA"),
        (knet().replace("Scale Factor", "Scale  Factr"), "must have the line 'Scale Factor'"),
        (knet().replace("/2000000", ""), "Scale Factor must have the form 3920(gal)/6182761"),
        (knet().replace("100Hz", "fast"), "line 11: the sampling frequency 'fast' is not a finite"),
        (smc(kind="1 UNCORRECTED ACCELEROGRAM"), "line 1: must be '2 CORRECTED ACCELEROGRAM'"),
        (cosmos().replace("(10I8)", ""), "line 14: must state the number of header values"),
        (cosmos().replace("100 Int", "999 Int"), "100 header values, but line 14 states 999"),
        (cosmos().replace("acceleration pts", "sag pts"), "line 54: the channel ends here without"),
        (
            cosmos().replace(" 100 Real", "  60 Real").replace(" 17 lines", " 10 lines"),
            "60 header values, but line 25 states 60; 100 are needed",
        ),
        (cosmos().replace("(8F10.5)", "free"), "line 46: must state count and format of values"),
        (cosmos().replace("   2       1", "   0       2"), "line 15: the channel must have accel"),
        (
            smc().replace(f"{37:10d}{0:10d}", f"{37:10d}{1:10d}"),
            "line 14: the file flags a problem of the record (18th integer is 1)",
        ),
    ],
)
def test_headers_that_do_not_add_up_are_errors(tmp_path: Path, content: str, message: str) -> None:
    assert message in error_message(write(tmp_path, content))


@pytest.mark.parametrize(
    ("filler", "places", "refused"),
    [
        (-99.999, [20], True),  # far outside of 25 cm/s^2
        (-0.999, [5, 6, 30], True),  # within, but no other value comes three times
        (9.999, [20], False),  # one sample of the motion may have this value
    ],
)
@pytest.mark.parametrize("name", FORMATS)
def test_fillers_are_refused_in_every_format(
    tmp_path: Path, name: str, filler: float, places: list[int], refused: bool
) -> None:
    values = WAVE.copy()
    # Numbers of AT2 files are in g, those of SMC have five digits.
    values[places] = filler * (STANDARD_GRAVITY if name == "at2" and refused else 1.0)
    if name == "smc" and filler < -1.0:
        values[places] = -99.99
    path = write(tmp_path, FORMATS[name](values=values))
    if not refused:
        assert len(read_components(path)) == 1
        return
    sentence = error_message(path)
    assert "marks a missing sample" in sentence
    number = int(re.findall(r"line (\d+):", sentence)[0])
    assert "999" in path.read_text().splitlines()[number - 1].replace(".", "")


def test_the_unknown_value_of_a_cosmos_header_is_refused(tmp_path: Path) -> None:
    line = "Values used when parameter or data value is unknown/unspecified:  -999, -12.5"
    text = cosmos(values=[*WAVE[:36], -12.5]).replace("line\n", f"{line}\n", 1)
    assert "line 51: -12.5 marks a missing" in error_message(write(tmp_path, text))


def test_a_broken_file_does_not_hide_the_others(tmp_path: Path) -> None:
    write(tmp_path, knet(), "good.NS")
    write(tmp_path, knet().replace("Station Code", "Station  Cod"), "broken.NS")
    assert record_names(tmp_path) == ["ABC001_20000101_102000"]


def three(directory: Path, name: str) -> list[Path]:
    """Files of a record: north WAVE, east twice, up three times as large."""
    return [
        write(directory, maker(values=(1 + number) * WAVE), f"{name}{number}.txt")
        for number, maker in enumerate(DIRECTED[name])
    ]


DIRECTED: dict[str, list[Callable[..., str]]] = {
    "esm": [partial(esm, stream=s) for s in ("HNN", "HNE", "HNZ")],
    "knet": [partial(knet, direction=d) for d in ("N-S", "E-W", "U-D")],
    "kik": [partial(knet, direction=d) for d in ("4", "5", "6")],
    "smc": [partial(smc, tilt=t, azimuth=a) for t, a in ((90, 360), (90, 90), (0, 0))],
    "cosmos": [partial(cosmos, azimuth=a) for a in (360, 90, 400)],
    "columns": [partial(columns, direction=d) for d in ("N", "E", "UP")],
}
"""North, east and up in each format that holds the time of the first sample."""


def started(directory: Path, name: str, starts: Sequence[str]) -> list[Path]:
    """Files of a record whose components start so many seconds after 10:20:46."""
    made = zip(DIRECTED[name], starts, strict=True)
    return [
        write(directory, maker(start=f"10:20:{46 + float(s):06.3f}", values=WAVE), f"{name}{i}.txt")
        for i, (maker, s) in enumerate(made)
    ]


@pytest.mark.parametrize("name", DIRECTED)
def test_components_are_aligned_by_their_starts(tmp_path: Path, name: str) -> None:
    # All hold WAVE: one that starts 0.1 s later has its sample i at the time of sample i + 10 of
    # the others, and the last 10 samples of it are after their end. 1 ms is rounding of a header.
    files = started(tmp_path, name, ["0", "0.1", "0.001"])
    north, east, up = WAVE[10:], WAVE[:-10], WAVE[10:]
    motion = read_record(files)
    expected = np.stack([east, north, up], axis=1)
    np.testing.assert_allclose(100.0 * motion.acceleration, expected, atol=DIGITS["smc"])
    for starts, message in (
        (["0", "0.1", "0.004"], "not multiples of the step, 0.01 s: .* starts at 0.004 s"),
        (["0", "0.36", "0"], f"no common time interval: {name}1.txt .* starts at 0.36 s"),
    ):
        with pytest.raises(RecordError, match=message):
            read_record(started(tmp_path, name, starts))


def test_cosmos_components_are_aligned_by_the_numbers_of_their_headers(tmp_path: Path) -> None:
    # Lines of text write the time in several ways, as 2018/11/30 or 02:33:  .0; whole numbers 40
    # and 42 to 45 and the 30th real one have year, month, day, hour, minute, second. -999 is none.
    files = started(tmp_path, "cosmos", ["0"] * 3)
    for path, second in zip(files, (46.0, 46.1, 46.0), strict=True):
        lines = (
            path.read_text().replace("01/01/2000, 10:20:46.000", "2000/01/01 10:20:46").split("\n")
        )
        lines[17] = lines[17][:72] + f"{2000:8d}"
        lines[18] = "".join(f"{number:8d}" for number in (1, 1, 1, 10, 20)) + lines[18][40:]
        lines[29] = lines[29][:65] + f"{second:13.6f}"
        path.write_text("\n".join(lines))
    motion = read_record(files)
    np.testing.assert_allclose(100.0 * motion.acceleration[:, 0], WAVE[:-10], atol=1e-9)
    np.testing.assert_allclose(100.0 * motion.acceleration[:, 1], WAVE[10:], atol=1e-9)


def test_starts_across_midnight_and_starts_that_are_missing(tmp_path: Path) -> None:
    files = started(tmp_path, "esm", ["0", "0", "0"])
    day, stamp = "20000101", "DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS: "
    write(tmp_path, esm(start="23:59:59.900"), files[0].name)
    for path in files[1:]:
        text = path.read_text().replace(f"{stamp}{day}_102046.000", f"{stamp}20000102_000000.000")
        path.write_text(text)
    np.testing.assert_allclose(100.0 * read_record(files).acceleration[:, 1], WAVE[10:], atol=1e-9)
    files[1].write_text(esm(stream="HNE").replace(f"{stamp}{day}_102046.000", stamp))
    with pytest.raises(RecordError, match=r"only some .* esm1.txt .* starts at an unknown time"):
        read_record(files)
    files[1].write_text(esm(stream="HNE").replace(f"{stamp}{day}_", f"{stamp}20001301_"))
    with pytest.raises(RecordError, match="line 12: '20001301_.*' is not a valid date and time of"):
        read_record(files)


@pytest.mark.parametrize("name", ["at2", "columns"])
@pytest.mark.parametrize("kind", ["DISPLACEMENT", "VELOCITY"])
def test_displacements_and_velocities_are_no_accelerations(
    tmp_path: Path, name: str, kind: str
) -> None:
    written = at2().replace("ACCELERATION TIME", f"{kind} TIME")
    if name == "columns":
        written = f"# {kind} TIME SERIES\n" + columns()
    assert ": velocities or displacements, not" in error_message(write(tmp_path, written))
    said = columns().replace("# unit", "# baseline corrected to zero velocity\n# unit")
    assert len(read_components(write(tmp_path, said))) == 1
    for line in ("velocity: 350 m/s (Vs30)", "Displacement-compatible baseline correction"):
        said = columns().replace("# unit", f"# {line}\n# unit")
        assert len(read_components(write(tmp_path, said))) == 1
    for line in (f"Ground {kind.lower()} [m/s]", f"{kind[:5]}{kind[5:]} SERIES"):
        sentence = error_message(write(tmp_path, f"# {line}\n" + columns()))
        assert ": velocities or displacements, not" in sentence


def test_velocities_and_displacements_beside_an_at2_record_are_left_out(tmp_path: Path) -> None:
    for part in ("000", "090", "-UP"):
        header = at2().replace("Station, 0", f"Station, {part.strip('-')}")
        write(tmp_path, header, f"RSN1_A{part}.AT2")
        write(tmp_path, header.replace("ACCELERATION T", "DISPLACEMENT T"), f"RSN1_A{part}.DT2")
    assert read_record(tmp_path).name == "RSN1_A"


@pytest.mark.parametrize("name", ["esm", "knet", "kik", "smc", "cosmos"])
def test_three_files_make_a_record(tmp_path: Path, name: str) -> None:
    files = three(tmp_path, name)
    write(tmp_path, "Dear reader, these are records.\n", "README")
    motion = read_record(tmp_path)
    # East is x because north lies 90 degrees to its left, seen from above; up is z.
    expected = np.stack([2 * WAVE, WAVE, 3 * WAVE], axis=1)
    np.testing.assert_allclose(100.0 * motion.acceleration, expected, atol=4 * DIGITS["smc"])
    assert record_names(tmp_path) == [motion.name]
    one_by_one = read_record(files)
    np.testing.assert_array_equal(one_by_one.acceleration, motion.acceleration)
    # x turned from azimuth 90 to 135, clockwise by 45 degrees: x' = (x - y) / sqrt 2.
    turned = read_record(tmp_path, stream_azimuth_deg=135.0)
    np.testing.assert_allclose(100.0 * turned.acceleration[:, 0], WAVE / np.sqrt(2), atol=2e-3)
    south = read_record(tmp_path, stream_azimuth_deg=180.0)  # x' points south: minus north
    np.testing.assert_allclose(100.0 * south.acceleration[:, 0], -WAVE, atol=2e-3)
    np.testing.assert_allclose(100.0 * south.acceleration[:, 1], 2 * WAVE, atol=2e-3)


def test_the_two_levels_of_a_borehole_are_two_records(tmp_path: Path) -> None:
    for number in range(1, 7):
        write(tmp_path, knet(direction=str(number)), f"ABC.{number}")
    names = record_names(tmp_path)
    assert names == ["ABC001_20000101_102000_underground", "ABC001_20000101_102000"]
    assert read_record(tmp_path, name="underground").name == names[0]
    assert read_record(tmp_path, name=names[1]).name == names[1]  # also a part of the other name


def test_files_of_velocities_are_no_record_of_a_folder(tmp_path: Path) -> None:
    write(tmp_path, esm(), "acceleration.ASC")
    names = record_names(tmp_path)
    assert len(names) == 1
    write(tmp_path, esm(kind="VELOCITY").replace("STATION_CODE: ", "STATION_CODE: Z"), "speed.ASC")
    assert record_names(tmp_path) == names


def test_one_cosmos_file_holds_three_channels(tmp_path: Path) -> None:
    # Ends of channels are written in more than one way.
    end = "/&  ----------  End of data for channel  1  ----------"
    channels = [cosmos(values=k * WAVE, azimuth=a) for k, a in ((1, 40), (2, 310), (3, 401))]
    motion = read_record(write(tmp_path, f"\n{end}\n".join(channels)))
    expected = np.stack([WAVE, 2 * WAVE, -3 * WAVE], axis=1)  # the last one points down
    np.testing.assert_allclose(100.0 * motion.acceleration, expected, atol=1e-9)
    assert motion.name == "CE-ABC_01012000_102046.0"


@pytest.mark.parametrize(("way", "azimuth"), [("WE", 90.0), ("NS", 0.0), ("UP", "up")])
def test_headers_of_itaca_until_2010(tmp_path: Path, way: str, azimuth: float | str) -> None:
    # They have COMPONENT in place of STREAM, and the time of the first sample without its date.
    text = esm(kind="PROCESSED ACCELERATION").replace("STREAM: HNN", f"COMPONENT: {way}")
    text = text.replace("NETWORK: XX\n", "").replace(
        "DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS: 20000101_", "TIME_FIRST_SAMPLE_S: "
    )
    (part,) = read_components(write(tmp_path, text))
    assert (part.direction, part.record) == (azimuth, "ABC_20000101_102030")
    (today,) = read_components(write(tmp_path, esm()))
    assert part.start == today.start


def test_a_direction_that_the_file_does_not_know_can_be_given(tmp_path: Path) -> None:
    files = [write(tmp_path, esm(stream=f"HN{c}"), f"{c}.ASC") for c in "12Z"]
    with pytest.raises(
        RecordError, match=r"1.ASC \(unknown direction\).*give read_record directions= if"
    ):
        read_record(files)
    motion = read_record(files, directions=[122.0, 32, "up"])
    np.testing.assert_allclose(100.0 * motion.acceleration[:, 0], WAVE, atol=1e-9)
    with pytest.raises(RecordError, match="has the direction up, but 'DOWN' was given"):
        read_record(files, directions=[122, 32, "DOWN"])
    with pytest.raises(RecordError, match="directions must be N, E, S, W, UP, DOWN, azimuths"):
        read_record(files, directions=["H1", "H2", "UP"])
    with pytest.raises(RecordError, match="directions has 2 entries, but the files have 3"):
        read_record(files, directions=["N", "E"])
    with pytest.raises(RecordError, match="two horizontal components at right angles"):
        read_record(files, directions=[122, 31, "up"])


def test_components_in_different_units_are_converted(tmp_path: Path) -> None:
    files = three(tmp_path, "esm")
    write(tmp_path, esm(unit="m/s^2", values=0.01 * WAVE, stream="HNZ"), files[2].name)
    motion = read_record(files)
    np.testing.assert_allclose(100.0 * motion.acceleration[:, 2], WAVE, atol=1e-6)
    with pytest.raises(RecordError, match="is in cm/s.2, but unit='g' was given"):
        read_record(files, unit="g")


def test_units_are_known_by_many_names() -> None:
    names = {"cm/sec2": "cm/s^2", "cm/s/s": "cm/s^2", "M/S2": "m/s^2", "m/s**2": "m/s^2"}
    names |= {"G": "g", "gals": "gal", "cm/sec/sec": "cm/s^2", "mg": "mg", "mm/s²": "mm/s^2"}
    assert {text: unit_named(text, "here") for text in names} == names
    for text in ("", "m/s", "m", "g/10", "cm/s3", "kg"):
        with pytest.raises(RecordError, match="^here: .* is not a unit of acceleration"):
            unit_named(text, "here")


def test_directions_are_known_by_name_and_azimuth() -> None:
    names = {"N": 0.0, "e-w": 90.0, "360": 0.0, "37.5": 37.5, "UP": "up", "DWN": "down"}
    assert {text: direction_named(text) for text in names} == names
    assert {direction_named(text) for text in ("H1", "400", "-10", "", "nan")} == {None}
