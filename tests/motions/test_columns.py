# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plain columns: what the file says, what the user says, and where they disagree."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_joints.common.errors import PlausibilityWarning, RecordError
from dolfinx_joints.motions.reading import read_components, read_record, record_names

VALUES = np.round(np.cos(np.outer(np.arange(12), [0.3, 0.5, 0.7])), 4)
TIMES = 0.02 * np.arange(12)


def write(directory: Path, header: str, *columns: np.ndarray, name: str = "motion.txt") -> Path:
    """A file with a header and columns of four decimals."""
    path = directory / name
    lines = [" ".join(f"{value:.4f}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text(header + "\n".join(lines) + "\n")
    return path


def test_three_components_in_one_file_that_says_all(tmp_path: Path) -> None:
    header = "# made by hand\n# unit: m/s^2\n# columns: time E N UP\n"
    motion = read_record(write(tmp_path, header, TIMES + 5.0, *VALUES.T))
    np.testing.assert_array_equal(motion.acceleration, VALUES)  # east is x, north y: see above
    assert motion.dt == pytest.approx(0.02, rel=1e-9)
    assert motion.name == "motion"
    assert record_names(tmp_path) == ["motion"]
    assert read_record(tmp_path).name == "motion"


def test_what_the_file_does_not_say_the_user_does(tmp_path: Path) -> None:
    path = write(tmp_path, "", *VALUES.T)
    said: dict[str, Any] = {"unit": "gal", "dt": 0.01, "columns": ["UP", 10.0, 100]}
    motion = read_record(path, **said)
    np.testing.assert_allclose(motion.acceleration, 0.01 * VALUES[:, [2, 1, 0]], rtol=1e-15)
    assert motion.dt == 0.01
    assert record_names(tmp_path) == []  # numbers without a unit are no record
    with pytest.raises(RecordError, match="has no record"):
        read_record(tmp_path)
    by_unit = read_record(tmp_path, **said)
    np.testing.assert_array_equal(by_unit.acceleration, motion.acceleration)


def test_one_component_in_each_file(tmp_path: Path) -> None:
    files = [
        write(tmp_path, "# unit: g\n", TIMES, 0.1 * column, name=f"{number}.csv")
        for number, column in enumerate(VALUES.T)
    ]
    motion = read_record(files, directions=["N", "W", "UP"])
    expected = 9.80665 * np.round(0.1 * VALUES, 4)
    np.testing.assert_allclose(motion.acceleration, expected, rtol=1e-12)


def test_rounded_times_are_taken_as_equal_steps(tmp_path: Path) -> None:
    # 1/128 s to four decimals misses by up to 5e-5 s, 0.6 % of a step.
    (found,) = read_components(write(tmp_path, "# unit: g\n", np.arange(12) / 128, VALUES[:, 0]))
    assert found.dt == pytest.approx(1 / 128, rel=1e-3)
    (exact,) = read_components(found.path, dt=1 / 128)
    assert exact.dt == 1 / 128


@pytest.mark.parametrize(
    ("header", "options", "message"),
    [
        ("", {}, "does not state the unit of its columns; pass unit=, or write '# unit: cm/s"),
        ("# unit: g\n", {"unit": "gal"}, "line 1: unit is g in the file, but gal"),
        ("", {"unit": "kN"}, "unit: 'kN' is not a unit of acceleration; use one of m/s"),
        ("# unit: g\n# dt: 0.02\n", {"dt": 0.01}, "line 2: dt is 0.02 in the file, but 0.01"),
        ("# unit: g\n# dt: -1\n", {}, "line 2: dt must be positive, got -1"),
        ("# unit: g\n# dt: 0.03\n# columns: time N\n", {}, "line 5: the times must increase by"),
        ("# unit: g\n", {"columns": ["N", "E"]}, "has no time column; pass dt="),
        ("# unit: g\n", {"columns": ["time", "H1"]}, "columns must be different directions"),
        ("# unit: g\n", {"columns": ["N"], "dt": 1.0}, "line 2: 2 values; the file has 1 columns"),
        ("# unit: g\ntime N\n", {"columns": "time E"}, "line 2: column 'N' is 'e' in columns="),
        ("# unit: g\ntime N\n", {"columns": "N time"}, "column 'time' is 'n' in columns="),
        (
            "# unit: g\n# columns: time N\n",
            {"columns": ["time", "E"]},
            "line 2: columns is ['time', 'n'] in the file, but ['time', 'e'] was given",
        ),
    ],
)
def test_what_is_missing_or_contradicts_is_an_error(
    tmp_path: Path, header: str, options: dict[str, Any], message: str
) -> None:
    path = write(tmp_path, header, TIMES, VALUES[:, 0])
    with pytest.raises(ValueError) as caught:  # noqa: PT011 the message is compared below
        read_components(path, **options)
    assert message in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# unit: g\n", "has an unknown format"),
        (
            "# unit: g\ntime,a\ns,g\nx,y\n0,1\n1,2\n",
            "unknown format (supported: K-NET, COSMOS, GeoNet",
        ),
        ("# unit: g\ntime,a\ns,g\n0,1\n1,2\n", "line 3: 's' is not a finite number"),
        ("# unit: g\ntime,vel\n0,1\n1,2\n", "line 2: must name time [s] and accelerations, got"),
        ("# unit: g\ntime (ms),a\n0,1\n1,2\n", "line 2: must name time [s] and accelerations"),
        ("# unit: g\na,b\n0,1\n1,2\n", "has 2 columns without names; pass columns="),
        ("# unit: g\n# dt: 1\n# columns: skip\n1\n2\n", "'skip' for any other column, got skip"),
        ("# unit: g\n# columns: wrapped\n1 2 3\n4 5\n", "has no time column; pass dt="),
        (
            "# unit: g\n# dt: 0.01\n# columns: wrapped\n0 .2 .3\n1 .1 .4\n2 .1 .2\n3 .1 .2\n",
            "line 4: 0 is a time or line number, which increases by equal steps",
        ),
        ("# unit: g\n0.00\t0,1\n0.01\t0,2\n", "has 3 columns without names"),
        ("# time(sec) N-S(cm/s)\n# unit: g\n0 1\n1 1\n", "line 1: velocities or displ"),
        ("t (s),up (m)\n0,1\n1,1\n", "line 1: velocities or displacements"),
        ("# Units of cm/s\n# unit: g\n0 1\n1 1\n", "line 1: velocities or displacements"),
        ("# unit: g\nTime Vx Vy Vz\n0 1 2 3\n1 2 3 4\n", "line 2: must name time [s] and accel"),
        ("N (gal),E (gal),UP (g)\n0,1,2\n1,2,3\n", "the unit is g, but in line 1 it is gal"),
        ("# unit: g\n# gal (cm/s2)\n0 1\n1 2\n", "the unit is cm/s^2, but in line 1 it is g"),
        ("# unit: g\n0.0 1.0\n", "line 2: the file has 1 row of numbers; at least 2"),
        ("# unit: gal\n0 1\n1 2\n2 -99\n3 1\n4 2\n", "line 4: -99 marks a missing sample"),
        ("# unit: g\n0.0 1.0\n0.1 2.0 3.0\n", "line 3: 3 values; the file has 2 columns"),
        ("# unit: g\n0.0 1.0\n0.1 2.0\n0.3 2.0\n", "line 4: the times must increase by equal"),
        ("# unit: g\n0,1\n1,2\n3,2\n", "line 4: the times must increase"),  # no decimal commas
        (
            "# Units = g\n0.2 1.0\n0.1 2.0\n",
            "line 3: the times must increase by equal steps, of -0.1 s",
        ),
        ("# unit: g\n0 1 2 3\n1 1 2 3\n", "columns='wrapped' for one component"),
    ],
)
def test_malformed_columns_are_errors(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "motion.txt"
    path.write_text(text)
    with pytest.raises(RecordError) as caught:
        read_components(path)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("comment", "message"),
    [
        ("vel. (cm/s)", "velocities or displacements"),
        ("vel in cm/sec", "velocities or displacements"),
        ("displacements [cm]", "velocities or displacements"),
        ("Geschwindigkeit [cm/s]", "velocities or displacements"),
        ("acceleration (m/s2)", "unit is m/s^2 in the file, but gal was given"),
        ("acceleration in cm/sec/sec", None),
        ("Vs30 (m/s): 760, PGV 12.3 cm/s, PGD = 3 (cm)", None),
        ("elevation (m)", None),
        ("NPTS 400, DT 0.01", None),
    ],
)
def test_units_in_comments_are_those_of_the_samples(
    tmp_path: Path, comment: str, message: str | None
) -> None:
    path = write(tmp_path, f"# {comment}\n", TIMES, VALUES[:, 0])
    if message is None:
        assert read_components(path, unit="gal")[0].dt == pytest.approx(0.02)
        return
    with pytest.raises(RecordError, match=f"line 1: {re.escape(message)}"):
        read_components(path, unit="gal")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{row} {number}", "1 is a time or line number, which increases by equal steps"),
        ("{time:.2f} {row}", "0.00 is a time or line number, which increases by equal steps"),
        ("{row} {word}", "'x' is not a finite number"),
    ],
)
def test_wrapped_lines_hold_samples_alone(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "motion.txt"
    rows = [" ".join(map(str, VALUES[i])) for i in range(8)]
    path.write_text(
        "\n".join(
            line.format(row=row, number=i + 1, time=0.015 * i, word="x" if i == 5 else i % 3)
            for i, row in enumerate(rows)
        )
    )
    with pytest.raises(RecordError, match=f"line [16]: {re.escape(message)}"):
        read_components(path, unit="gal", dt=0.005, columns="wrapped")


POINTS = "\n".join(f"{t:.2f} {v:.3f}" for t, v in zip(TIMES, VALUES[:, 0], strict=True))
WRAPPED = "\n".join("".join(f"{v:9.3f}" for v in VALUES[i : i + 5, 0]) for i in (0, 5, 10))


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("time,acc\n" + POINTS.replace(" ", ","), {"unit": "m/s^2"}),
        ('"time (s)";"acc (m/s^2)"\n' + POINTS.replace(" ", ";").replace(".", ","), {}),
        (POINTS.replace(" ", "\t").replace(".", ","), {"unit": "m/s^2"}),
        (re.sub(r"\S+ ", "", POINTS).replace(".", ","), {"unit": "m/s^2", "dt": 0.02}),
        ("# columns: wrapped\n" + WRAPPED, {"unit": "m/s^2", "dt": 0.02, "columns": "wrapped"}),
        (POINTS.replace("0 ", "0D+00 "), {"unit": "m/s^2"}),
        ("t [s] acc [m/s2]\n" + POINTS, {}),
        ("Zeit (s);acc_x (m/s2)\n" + POINTS.replace(" ", ";"), {}),
        (POINTS.replace("\n", " 7\n") + " 7", {"unit": "m/s^2", "columns": "time N skip"}),
    ],
)
def test_columns_of_many_programs_are_read(tmp_path: Path, text: str, options: Any) -> None:
    path = tmp_path / "motion.txt"
    path.write_text(text, encoding="utf-16" if text.startswith("t") else "utf-8")
    (found,) = read_components(path, **options)
    np.testing.assert_allclose(found.acceleration, np.round(VALUES[:, 0], 3), rtol=1e-12)
    assert found.dt == pytest.approx(0.02, rel=1e-9)


@pytest.mark.parametrize(("dt", "digits"), [(1 / 200, 2), (1 / 128, 3)])
def test_a_given_step_wins_over_rounded_times(tmp_path: Path, dt: float, digits: int) -> None:
    path = tmp_path / "motion.txt"
    path.write_text("\n".join(f"{i * dt:.{digits}f} {i % 5}" for i in range(40)))
    assert read_components(path, unit="gal", dt=dt)[0].dt == dt
    with pytest.raises(RecordError, match=r"increase by equal steps, of .*; pass dt= if rounded"):
        read_components(path, unit="gal", dt=1.1 * dt)


@pytest.mark.parametrize(
    ("step", "dt", "line"), [(0.01, None, 21), (0.01, 0.01, 21), (0.008, 0.008, 21)]
)
def test_a_missing_row_is_found(tmp_path: Path, step: float, dt: float | None, line: int) -> None:
    path = tmp_path / "motion.txt"
    path.write_text("\n".join(f"{i * step:.2f} {i % 5}" for i in range(40) if i != 20))
    with pytest.raises(RecordError, match=f"line {line}: .* after 0"):
        read_components(path, unit="gal", dt=dt)


@pytest.mark.parametrize(
    ("peak", "dt", "doubt"),
    [
        (0.019, 0.01, "peak is 0.019 g, read in g, not 0.02 to 5.0 g"),
        (5.1, 0.01, "peak is 5.1 g"),
        (0.021, 0.1, None),
        (0.3, 0.11, "time step is 0.11 s, more than 0.1 s"),
    ],
)
def test_peaks_and_steps_of_no_record_are_warned_of(
    tmp_path: Path, recwarn: Any, peak: float, dt: float, doubt: str | None
) -> None:
    path = write(tmp_path, "", *(np.array([0.0, peak, 0.0, -peak / 2]) for _ in range(3)))
    read_record(path, unit="g", dt=dt, columns="N E UP")
    assert [w.category for w in recwarn] == [PlausibilityWarning] * bool(doubt)
    assert all(doubt in str(w.message) and w.filename == __file__ for w in recwarn)


def test_columns_of_a_file_with_its_own_format_are_errors(tmp_path: Path) -> None:
    path = tmp_path / "a.AT2"
    path.write_text("PEER\na, 0\nUNITS OF G\nNPTS= 2, DT= .01 SEC\n 0.1 0.2\n")
    with pytest.raises(RecordError, match="has the format PEER AT2; columns= is for plain columns"):
        read_components(path, columns=["N"])
    with pytest.raises(RecordError, match="has a time step of 0.01 s, but dt=0.02 was given"):
        read_components(path, dt=0.02)
