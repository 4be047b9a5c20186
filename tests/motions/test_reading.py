# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records from files: PEER AT2 files, which files belong together, axes, refusals."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError
from dolfinx_joints.motions.reading import read_components, read_record, record_names
from dolfinx_joints.motions.record_text import direction_named

NEW_STYLE = "NPTS=   {count}, DT=   {dt} SEC,                  "


def at2_text(
    values: Sequence[float],
    *,
    component: str = "0",
    dt: str = ".0050",
    line4: str = NEW_STYLE,
    unit: str = "UNITS OF G",
) -> str:
    """Text of an AT2 file with five values on a line."""
    header = [
        "PEER STRONG MOTION",
        f"Somewhere, 1/1/2000, Station, {component}",
        f"SERIES IN {unit}",
    ]
    header.append(line4.format(count=len(values), dt=dt))
    rows = [values[i : i + 5] for i in range(0, len(values), 5)]
    return "\r\n".join(header + ["".join(f" {v:14.7E}" for v in row) for row in rows]) + "\r\n"


def write_record(
    directory: Path,
    stem: str = "RSN1_ABC",
    parts: Sequence[str] = ("000", "270", "-UP"),
    **at2: Any,
) -> None:
    """Write components of 20, 21, 22, ... values that are 0.1, 0.2, 0.3, ... g throughout."""
    for number, part in enumerate(parts):
        text = at2_text([0.1 * (number + 1)] * (20 + number), component=part.strip("-"), **at2)
        (directory / f"{stem}{part}.AT2").write_text(text)


@pytest.mark.parametrize(
    "line4",
    [
        "NPTS=   {count}, DT=   {dt} SEC,     ",
        "NPTS= {count}, DT= {dt} SEC",
        "NPTS={count},DT={dt}SEC",
        "NPTS= {count}, DT= 5. MSEC",
        "   {count}    {dt}    NPTS, DT",
    ],
)
def test_the_known_headers_are_read(tmp_path: Path, line4: str) -> None:
    path = tmp_path / "a.at2"
    path.write_text(at2_text([0.1, -0.2, 0.3, 0.4, 0.5, 0.6, 0.7], line4=line4))
    (found,) = read_components(path)
    expected = np.array([0.1, -0.2, 0.3, 0.4, 0.5, 0.6, 0.7]) * STANDARD_GRAVITY
    np.testing.assert_allclose(found.acceleration, expected, rtol=1e-12)
    assert found.dt == 0.005


GOOD = at2_text(np.linspace(0.0, 0.22, 23).tolist())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD.replace("UNITS OF G", "UNITS OF G/10"), "line 3: must have 'UNITS OF G'"),
        (GOOD.replace("NPTS", "POINTS"), "line 4: must have 'NPTS= count, DT= step SEC'"),
        (GOOD.replace(" SEC", " MIN"), "line 4: the unit of DT must be SEC or MSEC, got 'MIN'"),
        (GOOD.replace(".0050", ".0000"), "line 4: the time step must be positive"),
        (GOOD.replace(" 1.0000000E-01", ""), "line 7: 4 values; the lines before"),
    ],
)
def test_a_wrong_file_is_an_error(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.AT2"
    path.write_text(text)
    with pytest.raises(RecordError, match=message) as caught:
        read_components(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (("000", "270", "-UP"), [0.1, 0.2, 0.3]),  # y lies 90 degrees to the left of x
        (("000", "090", "-UP"), [0.2, 0.1, 0.3]),
        (("164", "254", "DWN"), [0.2, 0.1, -0.3]),
        (("-V", "-N", "-E"), [0.3, 0.2, 0.1]),
        (("360", "270", "-UP"), [0.1, 0.2, 0.3]),
        (("NS2", "EW2", "UD2"), [0.2, 0.1, 0.3]),  # east is x, north is y
        (("N55W", "S35W", "UP"), [0.1, 0.2, 0.3]),  # azimuths 305 and 215
    ],
)
def test_components_find_their_axes(
    tmp_path: Path, parts: tuple[str, ...], expected: list[float]
) -> None:
    write_record(tmp_path, parts=parts)
    motion = read_record(tmp_path)
    assert motion.name == "RSN1_ABC"
    assert motion.acceleration.shape == (20, 3)  # the shortest of 20, 21, 22
    np.testing.assert_allclose(motion.acceleration[7] / STANDARD_GRAVITY, expected)


def test_components_of_unknown_azimuth_need_directions(tmp_path: Path) -> None:
    write_record(tmp_path, parts=("-L1", "-T1", "-V1"))
    assert record_names(tmp_path) == ["RSN1_ABC"]
    with pytest.raises(RecordError, match=r"-L1.AT2 \(unknown direction\)"):
        read_record(tmp_path)
    motion = read_record(tmp_path, directions=["N", "W", "UP"])
    np.testing.assert_allclose(motion.acceleration[7] / STANDARD_GRAVITY, [0.1, 0.2, 0.3])


def test_a_letter_after_the_number_of_a_station_is_a_direction(tmp_path: Path) -> None:
    write_record(tmp_path, "RSN1_TCU078", parts=("N", "E", "V"))
    motion = read_record(tmp_path)
    assert motion.name == "RSN1_TCU078"
    np.testing.assert_allclose(motion.acceleration[7] / STANDARD_GRAVITY, [0.2, 0.1, 0.3])


def test_sensors_in_a_borehole_are_another_record(tmp_path: Path) -> None:
    write_record(tmp_path, parts=("NS2", "EW2", "UD2"))
    write_record(tmp_path, parts=("NS1", "EW1", "UD1"))
    assert record_names(tmp_path) == ["RSN1_ABC_underground", "RSN1_ABC"]


@pytest.mark.parametrize(
    ("name", "azimuth"),
    [("N55W", 305.0), ("S35W", 215.0), ("N80E", 80.0), ("S16E", 164.0), ("N00E", 0.0)],
)
def test_bearings_are_counted_from_north_or_south(name: str, azimuth: float) -> None:
    assert direction_named(name) == azimuth


def test_two_horizontal_components_are_read_with_a_warning(tmp_path: Path) -> None:
    write_record(tmp_path, parts=("000", "270"))
    with pytest.warns(PlausibilityWarning, match="no vertical component; z is zero"):
        motion = read_record(tmp_path)
    np.testing.assert_allclose(motion.acceleration[7] / STANDARD_GRAVITY, [0.1, 0.2, 0.0])


def test_sensors_of_networks_have_places_not_azimuths(tmp_path: Path) -> None:
    # Names of NGA-East: network, station, channel, place of the sensor. 1 and 2 are unknown ways.
    stem = "RSN1_Town_IU.CCM"
    write_record(tmp_path, stem, (".BHN.00", ".BHE.00", ".BHZ.00"))
    np.testing.assert_allclose(
        read_record(tmp_path).acceleration[7], STANDARD_GRAVITY * np.array([0.2, 0.1, 0.3])
    )
    write_record(tmp_path, stem, (".BH1.10", ".BH2.10"))
    files = [tmp_path / f"{stem}.{part}.AT2" for part in ("BH1.10", "BH2.10", "BHZ.00")]
    motion = read_record(files, directions=[0.0, 90.0, "UP"])
    np.testing.assert_allclose(motion.acceleration[7], STANDARD_GRAVITY * np.array([0.2, 0.1, 0.3]))


@pytest.mark.parametrize(
    ("stated", "directions", "message"),
    [
        (("", "", ""), ["E", "N", "UP"], ""),  # gm001.AT2 is no azimuth of 1 degree
        (("", "", ""), ["x", "y", "z"], ""),
        (("090", "000", "UP"), ["E", "N", "UP"], ""),
        (("090", "000", "UP"), ["N", "E", "UP"], "gm001.AT2 has the direction 90.0, but 'N' was"),
        (("090", "000", "UP"), None, "gm001.AT2, line 2: component and file name"),
    ],
)
def test_given_directions_overrule_file_names_not_headers(
    tmp_path: Path, stated: Sequence[str], directions: Any, message: str
) -> None:
    files = [tmp_path / f"gm00{number}.AT2" for number in (1, 2, 3)]
    for number, (path, component) in enumerate(zip(files, stated, strict=True)):
        path.write_text(at2_text([0.1 * (number + 1)] * 20, component=component))
    if message:
        with pytest.raises(RecordError, match=message):
            read_record(files, directions=directions)
        return
    motion = read_record(files, directions=directions)
    np.testing.assert_allclose(motion.acceleration[7] / STANDARD_GRAVITY, [0.1, 0.2, 0.3])
    if "x" in directions:
        with pytest.raises(RecordError, match="stream_azimuth_deg is not allowed"):
            read_record(files, directions=directions, stream_azimuth_deg=10.0)


def test_one_of_several_records_is_chosen_by_name(tmp_path: Path) -> None:
    write_record(tmp_path, "RSN1_ABC")
    (tmp_path / "sub").mkdir()
    write_record(tmp_path / "sub", "RSN2_DEF")
    (tmp_path / "notes.txt").write_text("not a record")
    assert read_record(tmp_path).name == "RSN1_ABC"
    write_record(tmp_path, "RSN2_DEF")
    assert record_names(tmp_path) == ["RSN1_ABC", "RSN2_DEF"]
    with pytest.raises(RecordError, match="choose by name=: RSN1_ABC, RSN2_DEF"):
        read_record(tmp_path)
    assert read_record(tmp_path, name="def").name == "RSN2_DEF"
    with pytest.raises(RecordError, match="no record with 'xyz' in its name; its records: RSN1_A"):
        read_record(tmp_path, name="xyz")


def test_incomplete_records_are_errors(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="The file or directory .* cannot be read"):
        read_record(tmp_path / "none")
    (tmp_path / "b.txt").write_text("# in cm/s\n1 2\n")
    (tmp_path / "c.txt").write_text("0 1\n1 2\n")
    left = r"b.txt \(line 1: velocities.*\), c.txt \(no accelerations, no unit.*\)\.$"
    with pytest.raises(RecordError, match=f"no record; its records: none; skipped files: {left}"):
        read_record(tmp_path)
    for number, parts in enumerate((("000", "-UP"), ("000", "045", "-UP"), ("000", "090", "180"))):
        (tmp_path / str(number)).mkdir()
        write_record(tmp_path / str(number), parts=parts)
        with pytest.raises(
            RecordError, match="horizontal components at right angles, but 'RSN1_ABC' has"
        ):
            read_record(tmp_path / str(number))


def test_components_that_disagree_are_errors(tmp_path: Path) -> None:
    write_record(tmp_path)
    (tmp_path / "RSN1_ABC-UP.AT2").write_text(at2_text([0.1] * 20, component="UP", dt=".0100"))
    with pytest.raises(RecordError, match=r"different time steps: .*-UP.AT2 0.01 s"):
        read_record(tmp_path)
    (tmp_path / "RSN1_ABC-UP.AT2").write_text(at2_text([0.1] * 20, component="DWN"))
    with pytest.raises(RecordError, match="-UP.AT2, line 2: component and file name"):
        read_record(tmp_path)


def test_a_damaged_component_is_an_error_not_left_out(tmp_path: Path) -> None:
    # By its name the file belongs to the record, whatever it holds.
    write_record(tmp_path)
    for content, message in ((b"", "-UP.AT2 is empty"), (b"\0\1\2", "-UP.AT2 is not a text file")):
        (tmp_path / "RSN1_ABC-UP.AT2").write_bytes(content)
        with pytest.raises(RecordError, match=message):
            read_record(tmp_path)


def test_no_files_are_errors() -> None:
    with pytest.raises(RecordError, match="At least one file is needed, got none"):
        read_record([])
