# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One malformed file of each kind for each format that is read, and the page that lists them.

./with-dolfinx python3 tests/bad_files.py docs/bad_files.md
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mpi4py import MPI
from test_step import write_step
from test_formats import WAVE, at2, columns, cosmos, esm, knet, smc

import dolfinx_joints as dj
from dolfinx_joints.common.errors import MeshError, RecordError, TemperatureError
from dolfinx_joints.motions.reading import read_components
from dolfinx_joints.loads.temperature.from_file import LARGEST_FILE, read_temperature_points
from geometry.from_step import from_step
from geometry.section_table import read_sections

KINDS = (
    "empty",
    "binary junk",
    "truncated",
    "wrong count",
    "text in numbers",
    "not a number",
    "wrong unit",
    "no unit",
    "huge",
)
JUNK = b"\x89HDF\r\n\x1a\n" + bytes(range(256))
HUGE = "9999999999"


class Bad(NamedTuple):
    """A malformed file.

    Attributes:
        what: what is wrong with it, for the page.
        content: what it holds; a number stands for that many bytes of nothing.
    """

    what: str
    content: str | bytes | int


class Door(NamedTuple):
    """A format and what reads it.

    Attributes:
        title: name of the format.
        suffix: end of the name of a file.
        error: type of the refusal.
        read: reads a file.
        good: a file that is read.
        bad: a malformed file of each kind, or why the format has none.
        kinds: kinds of malformed files.
    """

    title: str
    suffix: str
    error: type[ValueError]
    read: Callable[[Path], object]
    good: str | bytes
    bad: dict[str, Bad | str]
    kinds: tuple[str, ...] = KINDS


def swapped(text: str, old: str, new: str) -> str:
    """A text with one part replaced, which it must have."""
    assert old in text, old
    return text.replace(old, new, 1)


def record_doors() -> Iterator[Door]:
    """Formats of ground motions: in all of them the values are of 25 cm/s^2 at most."""
    last = f"{WAVE[36]:.6f}"
    written = f"{WAVE[36] / 980.665:15.9E}"
    counts, ten = f"{1000 * WAVE[36]:9.0f}", f"{WAVE[36]:10.4E}".replace("E+0", "E+")
    form = f"{WAVE[36]:10.5f}"
    yield record("PEER AT2", at2, written, "no unit on line 3")
    yield record("ESM/ITACA", esm, last, "`UNITS` without a value")
    for title, direction in (("K-NET", "N-S"), ("KiK-net", "4")):

        def writer(direction: str = direction, **options: Any) -> str:
            return knet(**options, direction=direction)

        door = record(title, writer, counts, "`Scale Factor` without a unit")
        door.bad["wrong count"] = Bad("38 values announced, 37 there", writer(count="0.38"))
        yield door
    yield cosmos_door("COSMOS V1", "Uncorrected", form)
    yield cosmos_door("COSMOS V2", "Corrected", form)
    door = record("SMC, corrected", smc, ten, "")
    kind = "2 CORRECTED ACCELEROGRAM"
    door.bad["wrong unit"] = Bad("the first line says velocity", smc(kind="3 VELOCITY"))
    door.bad["no unit"] = Bad(
        "without the first line, which the unit cm/s² goes with", swapped(smc(), kind + "\n", "")
    )
    yield door
    door = record("plain columns", columns, f"{WAVE[36]:.3f}", "")
    door.bad["truncated"] = Bad("cut within the last row", columns().rpartition(",")[0])
    door.bad["wrong count"] = "no number of rows is announced; a time that is left out is refused"
    door.bad["no unit"] = Bad("no unit above", swapped(columns(), "# unit: cm/s^2\n", ""))
    door.bad["huge"] = Bad("51 MB", 51_000_000)
    yield door


def record(title: str, write: Callable[..., str], last: str, no_unit: str) -> Door:
    """A format of one component; ``last`` is how its last value is written."""
    good = write()
    assert last in good, (last, good[-200:])
    return Door(
        title,
        ".txt",
        RecordError,
        read_components,
        good,
        {
            "empty": Bad("no bytes", b""),
            "binary junk": Bad("junk after the first line", good.split("\n")[0].encode() + JUNK),
            "truncated": Bad("cut within the header", good[: good.index("\n", 20)]),
            "wrong count": Bad("38 values announced, 37 there", write(count="38")),
            "text in numbers": Bad(
                "the last value is `abc`", swapped(good, last, "abc".rjust(len(last)))
            ),
            "not a number": Bad(
                "the last value is `nan`", swapped(good, last, "nan".rjust(len(last)))
            ),
            "wrong unit": Bad("another unit: `ft/s^2`", write(unit="ft/s^2")),
            "no unit": Bad(no_unit, write(unit="")),
            "huge": Bad(f"{HUGE} values announced", write(count=HUGE)),
        },
    )


def cosmos_door(title: str, first: str, last: str) -> Door:
    """A COSMOS file of one channel, whose first line begins with its kind."""

    def write(**options: Any) -> str:
        return cosmos(**options).replace("Corrected", first, 1)

    door = record(title, write, last, "the code of the unit is -999")
    door.bad["wrong unit"] = Bad("the code of the unit is that of cm/s", write(unit="5"))
    door.bad["no unit"] = Bad("the code of the unit is -999", write(unit="-999"))
    return door


CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
POINTS = "x,y,z,T\n" + "".join(f"{x},{y},{z},{5 + z}\n" for x, y, z in CORNERS)
SECTIONS = (
    "elevation,extrados_radius,crown_thickness,left_angle,right_angle\n"
    "200,50,4,40,60\n230,50,4,40,60\n"
)


def table_doors() -> Iterator[Door]:
    """Tables of comma-separated values."""
    good = POINTS
    yield Door(
        "temperatures at points",
        ".csv",
        TemperatureError,
        read_temperature_points,
        good,
        {
            "empty": Bad("no bytes", b""),
            "binary junk": Bad("junk after the first line", good[:8].encode() + JUNK),
            "truncated": Bad("cut within the last row", good.rpartition(",")[0]),
            "wrong count": Bad("a fifth value in a row", good + "1,2,3,4,5\n"),
            "text in numbers": Bad("a temperature is `warm`", good + "1,2,3,warm\n"),
            "not a number": Bad("a coordinate is `nan`", good + "1,2,nan,4\n"),
            "wrong unit": Bad("a column `x [mm]`", swapped(good, "x,", "x [mm],")),
            "no unit": "coordinates are in m; points in mm lie far from the nodes, see `reach`",
            "huge": Bad("501 MB", LARGEST_FILE + 1_000_000),
        },
    )
    yield Door(
        "horizontal sections of an arch dam",
        ".csv",
        ValueError,
        read_sections,
        SECTIONS,
        {
            "empty": Bad("no bytes", b""),
            "binary junk": Bad("junk after the first line", SECTIONS[:65].encode() + JUNK),
            "truncated": Bad("cut within the last row", SECTIONS.rpartition(",")[0]),
            "wrong count": Bad("a sixth value in a row", SECTIONS + "240,50,4,40,60,1\n"),
            "text in numbers": Bad("a radius is `fifty`", SECTIONS + "240,fifty,4,40,60\n"),
            "not a number": Bad("a radius is `nan`", SECTIONS + "240,nan,4,40,60\n"),
            "wrong unit": Bad("elevations in mm", swapped(SECTIONS, "230", "230000")),
            "no unit": "a table says no units: m and degrees; angles in radians are refused",
            "huge": Bad("2 MB", 2_000_000),
        },
    )


def mesh_door() -> Door:
    """A Gmsh file of one tetrahedron."""
    good = "\n".join(
        [
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat",
            '$PhysicalNames\n2\n2 2 "base"\n3 1 "rock"\n$EndPhysicalNames',
            "$Entities\n0 0 1 1\n1 0 0 0 1 1 0 1 2 0\n1 0 0 0 1 1 1 1 1 0\n$EndEntities",
            "$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes",
            "$Elements\n2 2 1 2\n2 1 2 1\n1 1 2 3\n3 1 4 1\n2 1 2 3 4\n$EndElements\n",
        ]
    )
    return Door(
        "Gmsh `.msh`",
        ".msh",
        MeshError,
        lambda path: dj.read_msh(path, MPI.COMM_SELF),
        good,
        {
            "empty": Bad("no bytes", b""),
            "binary junk": Bad("junk", JUNK),
            "truncated": Bad("cut before the cells", good[: good.index("$Elements")]),
            "wrong count": Bad(
                "two cells announced, one there", swapped(good, "3 1 4 1\n2", "3 1 4 2\n2")
            ),
            "text in numbers": Bad(
                "a coordinate is `abc`", swapped(good, "0 1 0\n0", "0 abc 0\n0")
            ),
            "not a number": Bad("a coordinate is `nan`", swapped(good, "0 1 0\n0", "0 nan 0\n0")),
            "wrong unit": "a mesh says no unit; coordinates are in m",
            "no unit": "a mesh says no unit; coordinates are in m",
            "huge": Bad("10^12 nodes announced", swapped(good, "1 4 1 4", "1 999999999999 1 4")),
        },
    )


def step_door() -> Door:
    """A STEP file of two boxes that touch."""
    with tempfile.TemporaryDirectory() as folder:
        boxes = {"rock": (0, 0, 0, 4000, 2000, 3000), "pier": (1000, 0, 3000, 2000, 2000, 5000)}
        good = write_step(Path(folder) / "good.step", boxes).read_text()
    start = re.search(r"CARTESIAN_POINT\('',\([^,]+,[^,]+,[^)]+", good)
    assert start is not None
    point = "CARTESIAN_POINT('',("
    return Door(
        "STEP",
        ".step",
        ValueError,
        lambda path: from_step(path.with_suffix(".msh"), path, size=1.0),
        good,
        {
            "empty": Bad("no bytes", b""),
            "binary junk": Bad("junk", JUNK),
            "truncated": Bad("cut in the middle", good[: len(good) // 2]),
            "wrong count": "no number of entities is announced",
            "text in numbers": Bad(
                "a coordinate is `abc`", swapped(good, start[0], f"{point}abc,0.,0.")
            ),
            "not a number": Bad(
                "a coordinate is `nan`", swapped(good, start[0], f"{point}nan,0.,0.")
            ),
            "wrong unit": Bad("lengths in seconds", good.replace(".METRE.", ".SECOND.")),
            "no unit": Bad("no unit of length", good.replace("LENGTH_UNIT", "MASS_UNIT")),
            "huge": Bad("a coordinate is 1e300", swapped(good, start[0], f"{point}1.E300,0.,0.")),
        },
    )


def doors() -> list[Door]:
    """Every format."""
    from bad_hdf5_files import hdf5_doors

    return [*record_doors(), *table_doors(), mesh_door(), step_door(), *hdf5_doors()]


def put(directory: Path, door: Door, content: str | bytes | int) -> Path:
    """Write a file of a door."""
    path = directory / f"FILE{door.suffix}"
    with path.open("wb") as file:
        if isinstance(content, int):
            file.truncate(content)  # a hole: it takes no space on the disk
        else:
            file.write(content.encode() if isinstance(content, str) else content)
    return path


def refusal(directory: Path, door: Door, bad: Bad) -> tuple[str, str]:
    """Type and sentence that a malformed file is refused with; two empty ones where it is read."""
    path = put(directory, door, bad.content)
    try:
        door.read(path)
    except Exception as error:
        return type(error).__name__, str(error)
    finally:
        path.unlink()
    return "", ""


def page() -> str:
    """The page of all refusals, in Markdown; what Gmsh and HDF5 themselves say is left out."""
    lines = ["# Malformed files", ""]
    lines += [
        "What each reader says of a malformed file of each kind: one sentence, in an exception of "
        "the type named. In records, counts are compared with the size of the file, "
        "and files with a largest size, before anything is allocated for what they announce. "
        "This page is written by "
        "`./with-dolfinx python3 tests/bad_files.py docs/bad_files.md`, and "
        "`tests/test_bad_files.py` compares it with what the readers say.",
        "",
        "Target spectra are arrays, not files. "
        "A `.msh` and a STEP file are gone through before Gmsh or Open CASCADE read them, which "
        "crash or never end at some wrong numbers. "
        "An SMC file has no field for a unit: the format "
        "fixes cm/s² for what its first line calls an accelerogram.",
        "",
        "Of HDF5 nothing is followed that leads out of a file, nothing is unpacked, and nothing is "
        "made room for that is larger than the file can hold. HDF5 itself reads some damaged files "
        "for ever: checkpoints and study tables end with a checksum of all before it, which is "
        "looked at first, and results files are of the kind whose metadata HDF5 compares with "
        "checksums. `tests/generated/` gives all these readers thousands of changed files "
        "(`make fuzz`).",
    ]
    with tempfile.TemporaryDirectory() as folder:
        for door in doors():
            lines += ["", f"## {door.title}", "", f"`{door.error.__name__}`", ""]
            lines += ["| kind | the file | what is said |", "|---|---|---|"]
            for kind in door.kinds:
                bad = door.bad[kind]
                if isinstance(bad, str):
                    lines.append(f"| {kind} | - | {bad} |")
                    continue
                said = refusal(Path(folder), door, bad)[1].replace(f"{folder}/", "")
                said = re.sub(r"(Gmsh cannot read 'FILE\.\w+': ).*", r"\1...", said)
                said = re.sub(r"'Unable to .*", "...", said)
                said = re.sub(r"it has \d+ of \d+ bytes", "it has N of M bytes", said)
                lines.append(f"| {kind} | {bad.what} | `{said}` |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    # Not to the standard output: Open CASCADE prints there what it writes.
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
