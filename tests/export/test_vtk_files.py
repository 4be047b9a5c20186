# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView whose process was killed, whose disk was full, that another run left."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from vtk_files import read_vtk

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.grids import Grid, uniform_grid
from dolfinx_joints.export.vtk_files import VtkFile

LINE = 3  # VTK's number
TIMES = [0.0, 0.5, 1.0]


class Killed(BaseException):
    """In the place of a signal: nobody handles it."""


def lines(count: int = 40) -> Grid:
    points = np.random.default_rng(3).uniform(size=(count + 1, 3))
    cells = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    return uniform_grid(points, cells, LINE, {"first": np.arange(5)})


def append(file: VtkFile, time: float) -> None:
    u = time + np.arange(123.0).reshape(41, 3)
    file.append(time, {"displacement [m]": u}, {"stress [Pa]": time + np.arange(40.0)})


def check(path: Path) -> list[float]:
    """Times [s] of a file whose values are those of `append`, as VTK reads it."""
    found = read_vtk(path)
    for time, grid in found:
        u = time + np.arange(123.0).reshape(41, 3)
        np.testing.assert_array_equal(grid.point_data["displacement [m]"], u)
        np.testing.assert_array_equal(grid.cell_data["stress [Pa]"], time + np.arange(40.0))
        np.testing.assert_array_equal(grid.cell_data["in first [-]"], np.arange(40) < 5)
    return [time for time, _ in found]


def test_a_kill_loses_no_more_than_the_last_time(tmp_path, monkeypatch):
    """Killed in the midst of each write in turn until none is left."""
    path, pwrite, ended = tmp_path / "run.vtkhdf", os.pwrite, False
    for stop in range(1000):
        file = VtkFile(path, lines())
        append(file, TIMES[0])
        append(file, TIMES[1])
        left = iter(range(stop))

        def write(handle, content, place, left=left):
            if next(left, None) is None:
                pwrite(handle, content[: len(content) // 2], place)
                raise Killed
            return pwrite(handle, content, place)

        monkeypatch.setattr(os, "pwrite", write)
        try:
            append(file, TIMES[2])
            ended = True
        except Killed:
            pass
        monkeypatch.setattr(os, "pwrite", pwrite)
        begun = (tmp_path / "run.vtkhdf.redo").exists()
        if not begun:
            assert check(path) == TIMES[: 3 if ended else 2]
        file = VtkFile.resume(path, lines(), TIMES[1])
        assert check(path) == TIMES[:2]
        append(file, TIMES[2])
        assert check(path) == TIMES
        if ended:
            break
    assert ended
    assert stop > 10
    assert [each.name for each in tmp_path.iterdir()] == ["run.vtkhdf"]


def test_what_stays_is_stored_once(tmp_path):
    file = VtkFile(tmp_path / "run.vtkhdf", lines())
    for time in TIMES:
        append(file, time)
    assert check(file.path) == TIMES
    with h5py.File(file.path) as opened:
        assert opened["VTKHDF/CellData/in first [-]"].shape == (40,)


def test_a_full_disk_leaves_what_is_there(tmp_path, monkeypatch):
    file = VtkFile(tmp_path / "run.vtkhdf", lines())
    append(file, TIMES[0])

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "posix_fallocate", full)
        with pytest.raises(ResultsError, match=r"run\.vtkhdf cannot grow: No space left"):
            append(file, TIMES[1])
    assert check(file.path) == TIMES[:1]
    append(file, TIMES[1])
    assert check(file.path) == TIMES[:2]


def test_a_file_of_another_grid_is_not_continued(tmp_path):
    path, grid = tmp_path / "run.vtkhdf", lines()
    append(VtkFile(path, grid), TIMES[0])
    VtkFile.resume(path, replace(grid, points=grid.points + 1e-14), TIMES[0])
    for other in (replace(grid, points=grid.points[::-1]), lines(39)):
        with pytest.raises(ResultsError, match="its grid is not that of this model"):
            VtkFile.resume(path, other, TIMES[0])
    assert check(path) == TIMES[:1]


def test_a_damaged_file_is_put_aside(tmp_path):
    path = tmp_path / "run.vtkhdf"
    append(VtkFile(path, lines()), TIMES[0])
    damaged = path.read_bytes()[:3000]
    path.write_bytes(damaged)
    with pytest.warns(UserWarning, match=r"it is run\.damaged\.vtkhdf now, and a new file begins"):
        file = VtkFile.resume(path, lines(), TIMES[0])
    append(file, TIMES[1])
    assert check(path) == [TIMES[1]]
    assert path.with_name("run.damaged.vtkhdf").read_bytes() == damaged
