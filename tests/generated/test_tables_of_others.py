# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of comma-separated values and rows of studies: junk and changed good files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_files import POINTS
from generated_input import answer, cheap
from hypothesis import given
from mutations import SEEDS, changed_text, junk

from dolfinx_joints.common.errors import StudyError, TemperatureError
from dolfinx_joints.study_table import OWN_COLUMNS, gather, read_row
from dolfinx_joints.loads.temperature.from_file import _interpolated, read_temperature_points
from geometry.section_table import read_sections

SPREAD = POINTS + "0.5,0.5,0.5,7\n0.25,0.75,0.5,-3.5e0\n# by hand\n\n2,2,2,1\n"
VALLEY = (
    "elevation, extrados_radius, crown_thickness, left_angle, right_angle\n"
    "200,50,4,40,35.5\n220,52,4,48,45\n# by hand\n240,54,3.5,56,52\n260,56,2.0e0,62,60\n"
)
ROW = json.dumps(
    {
        **dict(zip(OWN_COLUMNS, ("a", "complete", "", 1.5, 20.0), strict=True)),
        "parameters": {"x": 1, "name": "b", "list": [1, 2]},
        "values": {"y": 2.5, "said": "none"},
    },
    indent=1,
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tables") / "FILE.csv"


def given_to(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def temperatures(door: str, path: Path) -> None:
    found = answer(door, lambda: read_temperature_points(path), TemperatureError)
    if found is not None:
        points, values = found
        assert points.shape == (len(values), 3)
        assert np.isfinite(points).all()
        assert np.isfinite(values).all()
        inside = answer(
            "temperatures between points",
            lambda: _interpolated(path, points, values, points[:2], 1.0),
            TemperatureError,
        )
        assert inside is None or np.isfinite(inside).all()


@cheap()
@given(seed=SEEDS)
def test_changed_temperatures(path: Path, seed: int) -> None:
    temperatures("temperatures, changed", given_to(path, changed_text(seed, SPREAD)))


@cheap()
@given(seed=SEEDS)
def test_junk_temperatures(path: Path, seed: int) -> None:
    temperatures("temperatures, junk", given_to(path, junk(seed, SPREAD)))


def sections(door: str, path: Path) -> None:
    table = answer(door, lambda: read_sections(path))
    if table is not None:
        assert 0.0 < table.height <= 1000.0
        assert all(np.isfinite(column).all() for column in table.columns.values())
        for side in (1, -1):
            thickness = table.half(side).thickness(np.linspace(0, 1, 9)[:, None], [0.0, 1.0])
            assert (thickness > 0.0).all()


@cheap()
@given(seed=SEEDS)
def test_changed_sections(path: Path, seed: int) -> None:
    sections("sections, changed", given_to(path, changed_text(seed, VALLEY)))


@cheap()
@given(seed=SEEDS)
def test_junk_sections(path: Path, seed: int) -> None:
    sections("sections, junk", given_to(path, junk(seed, VALLEY)))


def row(door: str, path: Path) -> None:
    found: Any = answer(door, lambda: read_row(path), StudyError)
    if found is not None:
        assert all(len(column) == 1 for column in gather([found]).values())


@cheap()
@given(seed=SEEDS)
def test_changed_rows(path: Path, seed: int) -> None:
    row("rows of a study, changed", given_to(path, changed_text(seed, ROW)))


@cheap()
@given(seed=SEEDS)
def test_junk_rows(path: Path, seed: int) -> None:
    row("rows of a study, junk", given_to(path, junk(seed, ROW)))
