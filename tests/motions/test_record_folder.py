# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""All records of a folder or archive: motions by name, and a row for each file."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from test_reading import at2_text, write_record

import dolfinx_joints as dj
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError
from dolfinx_joints.study import write_csv


def archive(path: Path) -> Path:
    """Write a zip archive with the files of a folder, like a download."""
    made = path.with_suffix(".zip")
    with zipfile.ZipFile(made, "w") as file:
        for inner in sorted(path.rglob("*")):
            file.write(inner, inner.relative_to(path.parent))
    return made


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Write whole, incomplete and damaged records, an archive and notes."""
    place = tmp_path / "records"
    (place / "inner").mkdir(parents=True)
    write_record(place, "RSN1_A")
    write_record(place, "RSN2_B", parts=("000", "090"))
    write_record(place, "RSN3_C")
    (place / "RSN3_C270.AT2").write_text(at2_text([0.1] * 20, component="270", unit="CM"))
    write_record(place / "inner", "RSN4_D", parts=("NS2", "EW2", "UD2"))
    archive(place / "inner").rename(place / "more.zip")
    for path in (place / "inner").iterdir():
        path.unlink()
    (place / "notes.txt").write_text("downloaded today")
    return place


@pytest.mark.parametrize("zipped", [False, True])
def test_every_file_has_a_row_and_every_record_a_motion(folder: Path, zipped: bool) -> None:
    source = archive(folder) if zipped else folder
    with pytest.warns(PlausibilityWarning, match=r"4 of 12 files of .* were not used"):
        records = dj.read_motions(source)
    assert list(records.motions) == ["RSN1_A", "RSN2_B", "RSN4_D"]
    for name, motion in records.motions.items():
        assert motion.name == name
        # write_record writes 0.1, 0.2 and 0.3 g; azimuths 0, 270 or 0, 90 become (x, y), (y, x).
        swapped = name != "RSN1_A"
        peaks = [0.2, 0.1] if swapped else [0.1, 0.2]
        vertical = 0.0 if name == "RSN2_B" else 0.3
        np.testing.assert_allclose(motion.peak / 9.80665, [*peaks, vertical], rtol=1e-6)
    table = records.table
    assert len(table["file"]) == 12
    row = {name: column[list(table["motion"]).index("RSN1_A")] for name, column in table.items()}
    assert row["format"] == "PEER AT2"
    assert row["components"] == "up"
    assert (row["dt [s]"], row["duration [s]"], row["peaks [g]"]) == ("0.005", "0.105", "0.3")
    remarks = dict(zip(table["file"], table["remark"], strict=True))
    ends = {name.rpartition("/")[2]: text for name, text in remarks.items()}
    assert ends["RSN1_A000.AT2"] == ""
    assert ends["RSN2_B000.AT2"] == "it has no vertical component; z is zero"
    # The whole record is refused for one component, and each of its files has the reason.
    assert ends["RSN3_C000.AT2"] == ends["RSN3_C270.AT2"]
    assert ends["RSN3_C000.AT2"].startswith("not read: RSN3_C270.AT2, line 3: velocities")
    assert ends["notes.txt"].startswith("not read: ")
    printed = repr(records).splitlines()
    assert len(printed) == 13
    assert printed[0].split()[:3] == ["file", "motion", "format"]


def test_the_table_is_written_as_csv(folder: Path, tmp_path: Path) -> None:
    with pytest.warns(PlausibilityWarning):
        records = dj.read_motions(folder)
    lines = write_csv(records.table, tmp_path / "records.csv").read_text().splitlines()
    assert lines[0].startswith("file,motion,format,components,dt [s]")
    assert len(lines) == 13


def test_equal_names_in_two_folders_are_refused(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_record(tmp_path / name)
    with pytest.warns(PlausibilityWarning, match="3 of 6 files"):
        records = dj.read_motions(tmp_path)
    assert list(records.motions) == ["RSN1_ABC"]
    assert "Another folder has a motion with the name RSN1_ABC" in records.table["remark"][5]


def test_the_azimuth_holds_for_all_records(tmp_path: Path) -> None:
    header = "unit: cm/s^2\ncolumns: N E UP\ndt: 0.01"
    for name in ("one", "two"):
        samples = [[0, 0, 0], [100, 0, 0], [0, 50, 0], [0, 0, -25]]
        np.savetxt(tmp_path / f"{name}.txt", samples, header=header)
    records = dj.read_motions(tmp_path, stream_azimuth_deg=0.0)
    assert list(records.motions) == ["one", "two"]
    assert list(records.table["format"]) == ["columns", "columns"]
    for motion in records.motions.values():
        np.testing.assert_allclose(motion.peak, [1.0, 0.5, 0.25])


def test_sources_without_a_record_are_errors(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="cannot be read: No such file"):
        dj.read_motions(tmp_path / "none")
    (tmp_path / "broken.zip").write_bytes(b"PK\3\4 not an archive")
    (tmp_path / "notes.txt").write_text("no numbers")
    with pytest.raises(RecordError, match=r"no record that can be read.\nfile .*\nbroken.zip .*"):
        dj.read_motions(tmp_path)
    with pytest.raises(RecordError, match="is neither a folder nor a complete zip archive"):
        dj.read_motions(tmp_path / "notes.txt")


@pytest.mark.parametrize(
    ("packing", "reason"),
    [
        (zipfile.ZIP_DEFLATED, "Error -3 while decompressing"),
        (zipfile.ZIP_LZMA, "Corrupt input data"),
        (None, "encrypted"),
    ],
)
def test_a_damaged_archive_does_not_stop_the_others(
    tmp_path: Path, packing: int | None, reason: str
) -> None:
    write_record(tmp_path)
    inner = archive(tmp_path)
    with zipfile.ZipFile(tmp_path / "outer.zip", "w", packing or zipfile.ZIP_STORED) as file:
        file.write(inner, "inner.zip")
    data = bytearray((tmp_path / "outer.zip").read_bytes())
    if packing is None:  # set the flag of encryption in both headers
        data[6] |= 1
        data[data.rindex(b"PK\1\2") + 8] |= 1
    else:
        data[100:160] = bytes(range(60))
    (tmp_path / "outer.zip").write_bytes(data)
    with pytest.warns(PlausibilityWarning, match="1 of 4 files"):
        records = dj.read_motions(tmp_path)
    assert list(records.motions) == ["RSN1_ABC"]
    remarks = dict(zip(records.table["file"], records.table["remark"], strict=True))
    assert reason in remarks["outer.zip/inner.zip"]


def test_archives_may_be_many_but_not_nested_without_end(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    write_record(tmp_path)
    one = archive(tmp_path)
    data = one.read_bytes()
    for number in range(60):
        path = tmp_path / f"station_{number}.zip"
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("notes.txt", "no record")
    for _ in range(5):
        outer = io.BytesIO()
        with zipfile.ZipFile(outer, "w") as file:
            file.writestr("inner.zip", data)
        data = outer.getvalue()
    (tmp_path / "deep.zip").write_bytes(data)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = len(list(Path("/proc/self/fd").iterdir()))
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 20, limits[1]))
    try:
        with pytest.warns(PlausibilityWarning, match="61 of 64 files"):
            records = dj.read_motions(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    remarks = dict(zip(records.table["file"], records.table["remark"], strict=True))
    assert "no accelerations" in remarks["station_59.zip/notes.txt"]
    assert "not a text file" in remarks["deep.zip/inner.zip/inner.zip/inner.zip"]


def test_a_link_to_a_folder_above_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    write_record(tmp_path / "inner")
    (tmp_path / "inner" / "up").symlink_to("..")
    assert len(dj.read_motions(tmp_path).table["file"]) == 3


def test_a_record_that_loses_time_has_a_remark(tmp_path: Path) -> None:
    write_record(tmp_path)
    (tmp_path / "RSN1_ABC-UP.AT2").write_text(at2_text([0.1] * 11, component="UP"))
    records = dj.read_motions(tmp_path)
    # Components of 20, 21 and 11 samples every 5 ms.
    (remark,) = set(records.table["remark"])
    assert remark == "its components have only 0.05 s of up to 0.1 s in common; the rest is cut off"
