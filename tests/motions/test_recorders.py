# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files with all channels of a recorder: CSMIP volumes 1 and 2, GeoNet V1A and V2A, AFAD text.

The files are made here after the published layouts. Channel k has k + 1 times the values of
``WAVE`` [cm/s^2]; the headers state these peaks.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.reading import read_components, read_record

WAVE = np.round(25.0 * np.sin(0.7 * np.arange(37)), 2)
PEAK = np.abs(WAVE).max()


def rows(values: Sequence[float], per_line: int, form: str) -> list[str]:
    """Values in lines of a fixed format."""
    cells = [form.format(value) for value in values]
    return ["".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]


def csmip(volume: int, ways: Sequence[str] = ("360 Deg", "Up", "90 Deg"), block: str = "") -> str:
    """CSMIP: 13 or 25 lines of text, 7 of integers, 7 or 13 of real numbers, values, an end."""
    lines = []
    for channel, way in enumerate(ways, start=1):
        values = channel * WAVE
        head = ["Uncorrected Accelerogram Data     Processed: 01/01/00", "Record of Somewhere"]
        head += ["Processing", "12345-A1-00001.01      Start time:  1/01/00, 10:20:46.0 UTC"]
        head += ["Station No. 12345", "Town", f"Chan  {channel}: {way}"] + ["line"] * 6
        start = (
            f" 37 Accelerogram points at 100 pts/sec in units of {block or 'g'}. Format: (8f9.6)"
        )
        if volume == 2:
            head = [f"Corrected accelerogram   12345-A1-00001.01   Chan {channel}  from", *head[:7]]
            head += ["line"] * 9 + [f"Peak acceleration = {channel * PEAK:9.3f} cm/sec/sec  at"]
            head += ["line"] * 7
            start = (
                f" 37 points of accel data equally spaced at  .010 sec, {block}in cm/sec2. (8f10.6)"
            )
        lines += [*head, *["    1" * 16] * 6, "    1" * 4, *["      .000" * 8] * 6]
        lines += ["      .000" * 8] * (1 if volume == 1 else 7) + [start]
        lines += rows(values / (100.0 * STANDARD_GRAVITY), 8, "{:9.6f}") if volume == 1 else []
        if volume == 2:
            lines += rows(values, 8, "{:10.5f}")
            for kind in ("veloc data equally spaced at  .010 sec, in cm/sec. ", "displ"):
                lines += [f" 37 points of {kind}", *rows(9.0 * values, 8, "{:10.4f}")]
        lines += [f"/&  ----------  End of data for channel  {channel}  ----------"]
    return "\n".join(lines) + "\n"


def geonet(volume: int, ways: Sequence[str] = ("N28W", "S62W", "Up"), count: str = "37") -> str:
    """GeoNet: 16 lines of text, 40 integers, 60 real numbers, values in mm/s^2, all 8 wide."""
    lines = []
    for channel, way in enumerate(ways, start=1):
        kind = "Corrected" if volume == 2 else "Uncorrected"
        lines += [f"{kind} accelerogram 20000101_102030_ABCD_20 GNS Science", *["line"] * 11]
        lines += [f"Component {way}  Axis", f"Acceleration: Peak {10 * channel * PEAK:.1f} mm/s/s"]
        lines += ["line"] * 2 + ["       1" * 10] * 3
        others = 37 if volume == 2 else 0
        lines += [f"      37       0       0{count:>8s}{others:8d}{others:8d}" + "       0" * 4]
        lines += ["     0.0" * 10] * 2 + ["     0.0" * 5 + "  0.0100" + "     0.0" * 4]
        lines += ["     0.0" * 10] * 3
        for factor in (10.0, 30.0, 40.0)[: 1 if volume == 1 else 3]:
            lines += rows(factor * channel * WAVE, 10, "{:8.1f}")
    return "\n".join(lines) + "\n"


def afad(count: str = "37", names: str = "N-S          E-W          U-D") -> str:
    """AFAD: lines of key and value, a line of names, three columns in gal."""
    peaks = " ".join(f"({w}) {k * PEAK:.6f}" for k, w in ((1, "N-S"), (2, "E-W"), (3, "U-D")))
    lines = ["STRONG GROUND MOTION RECORDS OF TURKIYE", "PLACE                   : KÜTAHYA"]
    lines += ["STATION ID              : 4304", "STATION ALTITUDE (m)    : 735"]
    lines += ["RECORD TIME             : 20/07/2000 22:31:14.000000 (GMT)"]
    lines += [f"NUMBER OF DATA          : {count}", "SAMPLING INTERVAL (sec) : 0.01"]
    lines += [f"RAW PGA VALUES (gal)    : {peaks}", "Copyright", f"       {names}"]
    lines += ["".join(f"{k * value:13.6f}" for k in (1, 2, 3)) for value in WAVE]
    return "\r\n".join(lines) + "\r\n"


FILES: dict[str, tuple[Callable[[], str], list[float | str], str]] = {
    "CSMIP V1": (lambda: csmip(1), [0.0, "up", 90.0], "12345-A1-00001.01_uncorrected"),
    "CSMIP V2": (lambda: csmip(2), [0.0, "up", 90.0], "12345-A1-00001.01"),
    "CDMG V2": (lambda: csmip(2).upper(), [0.0, "up", 90.0], "12345-A1-00001.01"),
    "GeoNet V1A": (
        lambda: geonet(1),
        [332.0, 242.0, "up"],
        "20000101_102030_ABCD_20_uncorrected",
    ),
    "GeoNet V2A": (lambda: geonet(2), [332.0, 242.0, "up"], "20000101_102030_ABCD_20"),
    "AFAD": (afad, [0.0, 90.0, "up"], "file"),
}


def write(directory: Path, content: str) -> Path:
    """Write a file whose name says nothing."""
    path = directory / "file"
    path.write_bytes(content.encode("latin-1"))
    return path


@pytest.mark.parametrize("name", FILES)
def test_channels_have_the_peaks_steps_and_directions_of_their_headers(
    tmp_path: Path, name: str
) -> None:
    make, directions, record = FILES[name]
    path = write(tmp_path, make())
    parts = read_components(path)
    assert [part.direction for part in parts] == directions
    for number, part in enumerate(parts, start=1):
        assert part.record == record
        assert part.dt == pytest.approx(0.01, rel=1e-12)
        # Half of the last digit of each layout; 1e-6 g in CSMIP volume 1.
        atol = 5.1e-4 if name == "CSMIP V1" else 1e-9
        np.testing.assert_allclose(100.0 * part.acceleration, number * WAVE, rtol=0.0, atol=atol)
    motion = read_record(path)
    # Azimuths 0 and 332 are x; y is 90 degrees to the left, so east is -y.
    assert motion.name == record
    assert len(motion.acceleration) == len(WAVE)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (csmip(1).replace(" 37 Acc", " .000  .016 Acc"), "line 28: must state number, time step"),
        (csmip(2, block="cm/s "), "line 46: must state number, time step and unit"),
        (csmip(1, block="furlongs"), "line 28: 'furlongs' is not a unit of acceleration"),
        (csmip(2)[:900], "ends after line"),
        (
            "Acc /&".join(csmip(1).rsplit("Uncorrected Acc", 1)),
            "line 96: accelerations of a channel",
        ),
        (csmip(2).replace(" 37 points of accel", " 39 points of accel"), "but line 46 states 39"),
        (geonet(2, count="47"), "line 30: 7 values; the lines before have 10"),
        (geonet(1, count="-7"), "line 20: the number of values must be an integer of 2 or more"),
        (geonet(2).replace("37      37      37", "37     -37      37"), "missing or negative"),
        (geonet(1)[:900], "must have the first values"),
        (geonet(1) + "rest", "line 91: a channel must begin here, got 'rest'"),
        (afad(count="38"), "line 47: 37 rows, but the header states 38"),
        (afad(names="a b c"), "(gal) and N-S E-W U-D, in this order"),
        (afad().replace("(gal)", "(cm)"), "unit: 'cm' is not a unit of acceleration"),
        (afad().replace("SAMPLING", "STEP"), "must have NUMBER OF DATA, SAMPLING INTERVAL (sec)"),
    ],
    ids=lambda text: text.strip()[:20],
)
def test_malformed_files_are_errors(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(RecordError, match=".*") as caught:
        read_components(write(tmp_path, content))
    assert message in str(caught.value)


def test_channels_of_unknown_direction_need_directions(tmp_path: Path) -> None:
    path = write(tmp_path, csmip(2, ways=("H1", "Up", "H2")))
    with pytest.raises(RecordError, match=r"unknown direction.*give read_record directions= if"):
        read_record(path)
    motion = read_record(path, directions=[0, "UP", 270])
    np.testing.assert_allclose(motion.acceleration[:, 1], 0.03 * WAVE, atol=1e-9)


@pytest.mark.parametrize(
    ("way", "azimuth"), [("N 28 W", 332.0), ("S 16.5 E", 163.5), ("E 10 N", None), ("90 Deg", 90.0)]
)
def test_bearings_with_blanks_are_not_cut_short(
    tmp_path: Path, way: str, azimuth: float | None
) -> None:
    for content in (csmip(2, ways=(way,)), geonet(2, ways=(way,))):
        (part,) = read_components(write(tmp_path, content))
        assert part.direction == azimuth
