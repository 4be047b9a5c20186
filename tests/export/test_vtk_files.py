# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files for ParaView that grow, and the polygons of joint points in them."""

import errno
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from vtk_files import read_vtk

from dolfinx_joints import ResultsError
from dolfinx_joints.export.grids import Grid, StaticArrays, joined, joint_grid, uniform_grid
from dolfinx_joints.export.paraview import DamagedFileError, VtkFile

TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]])


def halves(rounding: float = 0.0, seed: int = 0):
    """A joint of one triangle with three points, whose parts meet in one place."""
    noise = rounding * np.random.default_rng(seed).standard_normal((3, 3)) * [0.0, 1.0, 1.0]
    shares = (np.full((3, 3), 1.0) + 3.0 * np.eye(3)) / 6.0
    points = shares @ TRIANGLE + noise
    return StaticArrays(
        {
            "mesh/nodes": np.concatenate([TRIANGLE, TRIANGLE]),
            "mesh/surface": np.array([[0, 1, 2], [5, 4, 3]]),
            "joints/lift/points": points,
            "joints/lift/frames": np.tile(np.eye(3), (3, 1, 1)),
            "joints/lift/areas": np.full(3, 2.0 / 3.0),
            "joints/lift/facet": np.zeros(3, dtype=np.int64),
        }
    )


def test_polygons_do_not_depend_on_rounding():
    # Its three parts have four corners each, whatever side rounding has put the common one on, and
    # together the area of the triangle.
    exact = joint_grid(halves(), "lift")
    assert exact.offsets.tolist() == [0, 4, 8, 12]
    corners = exact.points.reshape(3, 4, 3)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert 0.5 * np.linalg.norm(across, axis=1).sum() == pytest.approx(2.0, rel=1e-12)
    for seed in range(20):
        other = joint_grid(halves(1e-15, seed), "lift")
        np.testing.assert_array_equal(other.offsets, exact.offsets)
        np.testing.assert_allclose(other.points, exact.points, atol=1e-13)


@pytest.fixture
def grid():
    return joined({"lift": joint_grid(halves(), "lift"), "fault": joint_grid(halves(), "lift")})


def test_what_stays_is_stored_once(grid, tmp_path):
    file = VtkFile(tmp_path / "a.vtkhdf", grid)
    for time in (0.0, 0.5, 1.0):
        file.append([time], {}, {"opening [m]": time + np.arange(6.0)})
    VtkFile.resume(tmp_path / "a.vtkhdf", grid, 0.5).append([0.75], {}, {"opening [m]": np.ones(6)})
    found = read_vtk(tmp_path / "a.vtkhdf")
    assert [time for time, _ in found] == [0.0, 0.5, 0.75]
    for _, each in found:
        np.testing.assert_array_equal(each.cell_data["in fault [-]"], [0, 0, 0, 1, 1, 1])
        np.testing.assert_array_equal(each.cell_data["area [m^2]"], np.full(6, 2.0 / 3.0))
    np.testing.assert_array_equal(found[1][1].cell_data["opening [m]"], 0.5 + np.arange(6.0))
    np.testing.assert_array_equal(found[2][1].cell_data["opening [m]"], np.ones(6))
    with h5py.File(tmp_path / "a.vtkhdf") as opened:
        assert len(opened["VTKHDF/CellData/area [m^2]"]) == 6
        assert len(opened["VTKHDF/CellData/opening [m]"]) == 18


def test_files_of_other_grids_and_damaged_ones_are_not_continued(grid, tmp_path):
    path = tmp_path / "a.vtkhdf"
    VtkFile(path, grid).append([0.0], {}, {})
    for other in (
        replace(grid, points=grid.points + 1e-3),
        uniform_grid(TRIANGLE, np.array([[0, 1, 2]]), 5, {}),
    ):
        with pytest.raises(ResultsError, match="cannot be continued: its mesh differs"):
            VtkFile.resume(path, other, 0.0)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DamagedFileError, match="cannot be continued: "):
        VtkFile.resume(path, grid, 0.0)


@pytest.mark.parametrize("call", ["posix_fallocate", "pwrite"])
def test_a_full_disk_leaves_the_file_whole(grid, tmp_path, monkeypatch, call):
    file = VtkFile(tmp_path / "a.vtkhdf", grid)
    opening = {"opening [m]": np.arange(6.0)}
    file.append([0.0], {}, opening)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        with pytest.raises(ResultsError, match=r"a\.vtkhdf cannot grow: No space left on device"):
            file.append([1.0], {}, opening)
    assert [time for time, _ in read_vtk(tmp_path / "a.vtkhdf")] == [0.0]


def test_a_file_is_opened_once_and_closed_before_the_interpreter(tmp_path):
    """HDF5 would crash a process if it closed the file after the interpreter."""
    code = (
        "import ctypes, sys, h5py; sys.path[:0] = sys.argv[2:]; import test_vtk_files as t\n"
        "opened, of_h5py = [], h5py.File\n"
        "h5py.File = lambda *args, **kw: opened.append(args) or of_h5py(*args, **kw)\n"
        "file = t.VtkFile(t.Path(sys.argv[1]), t.lines())\n"
        "for time in t.TIMES: t.append(file, time)\n"
        "ctypes.pythonapi.Py_IncRef(ctypes.py_object(file))  # as by objects of PETSc\n"
        "print(len(opened))"
    )
    path, folder = tmp_path / "run.vtkhdf", Path(__file__).parent
    command = [sys.executable, "-c", code, str(path), str(folder), str(folder.parent)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, "2\n")  # to create it and to append
    assert check(path) == TIMES


def test_times_may_be_appended_together(tmp_path):
    """One append of two times writes the file of two appends."""
    one_by_one, together = (VtkFile(tmp_path / f"{n}.vtkhdf", lines()) for n in (1, 2))
    for time in TIMES:
        append(one_by_one, time)
    append(together, *TIMES[:2])
    append(together, TIMES[2])
    assert check(together.path) == TIMES
    with h5py.File(one_by_one.path) as one, h5py.File(together.path) as other:
        names = []
        one.visit(names.append)
        for name in names:
            if isinstance(one[name], h5py.Dataset):
                assert one[name].dtype == other[name].dtype
                np.testing.assert_array_equal(one[name][()], other[name][()])
    assert {"VTKHDF/CellData/stress [Pa]", "VTKHDF/Steps/CellDataOffsets/in first [-]"} < {*names}


LINE = 3  # VTK's number
TIMES = [0.0, 0.5, 1.0]


class Killed(BaseException):
    """In the place of a signal: nobody handles it."""


def lines(count: int = 40) -> Grid:
    points = np.random.default_rng(3).uniform(size=(count + 1, 3))
    cells = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    return uniform_grid(points, cells, LINE, {"first": np.arange(5)})


def append(file: VtkFile, *times: float) -> None:
    u = np.concatenate([time + np.arange(123.0).reshape(41, 3) for time in times])
    stress = np.concatenate([time + np.arange(40.0) for time in times])
    file.append(np.array(times), {"displacement [m]": u}, {"stress [Pa]": stress})


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
