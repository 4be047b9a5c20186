# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plain columns: what the file says, what the user says, and where they disagree."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_joints.common.errors import RecordError
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
        ("", {}, "does not give the unit of its columns; pass unit=, or write '# unit: cm/s"),
        ("# unit: g\n", {"unit": "gal"}, "line 1: unit is g here, but gal was given"),
        ("", {"unit": "kN"}, "unit: 'kN' is no known unit of acceleration; known are m/s"),
        ("# unit: g\n# dt: 0.02\n", {"dt": 0.01}, "line 2: dt is 0.02 here, but 0.01 was given"),
        ("# unit: g\n# dt: -1\n", {}, "line 2: dt must be positive, got -1"),
        ("# unit: g\n# dt: 0.03\n# columns: time N\n", {}, "line 5: the times must rise by equal"),
        ("# unit: g\n", {"columns": ["N", "E"]}, "has no column of time; pass dt="),
        ("# unit: g\n", {"columns": ["time", "H1"]}, "columns must be 'time' once at most and"),
        ("# unit: g\n", {"columns": ["N"], "dt": 1.0}, "line 2: 2 values where the columns are 1"),
        (
            "# unit: g\n# columns: time N\n",
            {"columns": ["time", "E"]},
            "line 2: columns is ['time', 'n'] here, but ['time', 'e'] was given",
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
        ("# unit: g\n", "is in no known format"),
        (
            "# unit: g\n# columns: time N\ntime,n\n0,1\n1,2\n",
            "line 3: numbers must follow",
        ),
        ("# unit: g\n0.0 1.0\n", "line 2: the file has 1 row of numbers; a record has 2"),
        ("# unit: g\n0.0 1.0\n0.1 2.0 3.0\n", "line 3: 3 values where the columns are 2"),
        ("# unit: g\n0.0 1.0\n0.1 2.0\n0.3 2.0\n", "line 3: the times must rise by equal steps"),
        ("# Units = g\n0.2 1.0\n0.1 2.0\n", "line 2: the times must rise by equal steps of -0.1 s"),
        ("# unit: g\n0 1 2 3\n1 1 2 3\n", "has 4 columns and does not name them"),
    ],
)
def test_malformed_columns_are_errors(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "motion.txt"
    path.write_text(text)
    with pytest.raises(RecordError) as caught:
        read_components(path)
    assert message in str(caught.value)


def test_columns_of_a_file_with_its_own_format_are_errors(tmp_path: Path) -> None:
    path = tmp_path / "a.AT2"
    path.write_text("PEER\na, 0\nUNITS OF G\nNPTS= 2, DT= .01 SEC\n 0.1 0.2\n")
    with pytest.raises(RecordError, match="is a file of PEER AT2, which has no columns to name"):
        read_components(path, columns=["N"])
    with pytest.raises(RecordError, match="has a time step of 0.01 s, but dt=0.02 was given"):
        read_components(path, dt=0.02)
