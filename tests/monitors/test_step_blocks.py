# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of steps do not depend on how many steps a monitor collects before it writes them."""

import shutil

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import DT, POINTS, shaking, wall
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints.results.writer import ResultsWriter
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi

STEPS = 6
STREAMS = ("histories", "energy", "joints", "resultants")
LAW = dj.MohrCoulombJoint(
    normal_stiffness=1e11,
    shear_stiffness=1e11,
    friction_angle_deg=30.0,
    cohesion=5e4,
    tensile_strength=2e4,
)


class EachStep(dj.ResultsMonitor):
    """Monitor that writes every step at once."""

    def record(self, record):
        super().record(record)
        self._extend(self._series.take(), flush=True)


class Copier(Monitor):
    """Copy of a file at the end of a step, as a killed run leaves the file."""

    def __init__(self, path, copy, step):
        self._path, self._copy, self._step = path, copy, step

    def record(self, record):
        if record.step == self._step:
            on_root(MPI.COMM_WORLD, lambda: shutil.copy(self._path, self._copy))


def shake(jointed, monitors, motion=shaking):
    """Shake the wall with water in a joint and bonds that break."""
    water = dj.JointWater(joint="joint_1", level=15.0)
    run = dj.Simulation(wall(jointed, LAW, loads=[dj.Gravity(), water]), monitors=monitors)
    run.statics()
    return run.dynamics(dt=DT, steps=STEPS, motion=motion)


def rows_of(path, count=None):
    """Return times and series of the streams with a row for each step, at most ``count`` rows."""
    with dj.Results(path) as results:
        rows = {f"{stream}/time": results.time(stream)[:count] for stream in STREAMS}
        for stream in STREAMS:
            for name in results.streams[stream]:
                rows[f"{stream}/{name}"] = results.series(stream, name)[:count]
        return rows


def test_rows_of_a_block_equal_rows_of_single_steps(comm, wall_file, read, new_path, monkeypatch):
    # Both files are of the same run; the sums have the same order, so the bits are equal.
    monkeypatch.setattr(ResultsWriter, "due", False)  # one block of all steps, however slow
    paths = new_path("block.h5"), new_path("steps.h5")
    options = {"points": POINTS, "resultants": True}
    block = dj.ResultsMonitor(paths[0], **options)
    shake(read(wall_file()), [block, EachStep(paths[1], **options)])

    def look():
        whole, single = map(rows_of, paths)
        assert whole.keys() == single.keys()
        for name, values in whole.items():
            assert len(values) == STEPS + 1
            np.testing.assert_array_equal(values, single[name], err_msg=name)
        # The test is of bonds that break, joints that open and water that pushes.
        assert np.ptp([whole[f"joints/joint_{n}/bond"] for n in (1, 2, 3)], axis=1).max() > 0.0
        assert whole["joints/joint_2/opening"].max() > 0.0
        assert np.abs(whole["resultants/joints/joint_1/water_force"]).max() > 0.0

    on_root(comm, look)


def test_rows_of_blocks_do_not_depend_on_ranks(comm, wall_file, read, new_path, monkeypatch):
    monkeypatch.setattr(ResultsWriter, "due", False)
    paths = new_path("many.h5"), new_path(f"alone_{comm.rank}.h5")
    for path, group in zip(paths, (comm, MPI.COMM_SELF), strict=True):
        monitor = dj.ResultsMonitor(path, points=POINTS, resultants=True)
        shake(read(wall_file(), on=group), [monitor])

    def look():
        many, alone = map(rows_of, paths)
        assert many.keys() == alone.keys()
        # Rounding errors of a force are relative to the largest force, and of moments, energies.
        scales = {}
        for name, values in alone.items():
            kind = (name.split("/")[0], name.split("/")[-1])
            if name.startswith("energy/"):
                kind = ("energy", "")
            scales[kind] = max(scales.get(kind, 0.0), np.nanmax(np.abs(values), initial=0.0))
            scales[name] = kind
        for name, values in many.items():
            if name != "histories/iterations":
                size = scales[scales[name]]
                np.testing.assert_allclose(
                    values, alone[name], rtol=0, atol=1e-9 * size, err_msg=name
                )

    on_root(comm, look)


def test_a_run_that_fails_has_all_rows_before(comm, wall_file, read, new_path, monkeypatch):
    # All rows are still in memory when the fourth step fails: it ends at 4 DT.
    monkeypatch.setattr(ResultsWriter, "due", False)
    paths = new_path("whole.h5"), new_path("failed.h5")

    def failing(time):
        if time > 3.5 * DT:
            raise RuntimeError("the motion ends")
        return shaking(time)

    options = {"points": POINTS, "resultants": True}
    shake(read(wall_file()), [dj.ResultsMonitor(paths[0], **options)])
    with pytest.raises(RuntimeError, match="the motion ends"):
        shake(read(wall_file()), [dj.ResultsMonitor(paths[1], **options)], failing)

    def look():
        whole, failed = rows_of(paths[0], 4), rows_of(paths[1])
        for name, values in failed.items():
            assert len(values) == 4  # the start and three steps
            np.testing.assert_array_equal(values, whole[name], err_msg=name)
        with dj.Results(paths[1]) as results:
            assert results.status == "failed"

    on_root(comm, look)


@pytest.mark.parametrize(("due", "rows"), [(True, 4), (False, 1)])
def test_rows_are_in_the_file_when_they_are_due(
    comm, wall_file, read, new_path, monkeypatch, due, rows
):
    # Step 3 is the fourth row. The first row is written at the start of the run. The buffer of the
    # states is full in step 2; a reader must not see states without the steps up to them.
    monkeypatch.setattr(ResultsWriter, "due", due)
    monkeypatch.setattr("dolfinx_joints.results.stream._BUFFER_ROWS", 2)
    path, copy = new_path("run.h5"), new_path("killed.h5")
    monitor = dj.ResultsMonitor(path, points=POINTS, resultants=True, every=1)
    shake(read(wall_file()), [monitor, Copier(path, copy, 3)])

    def look():
        assert {len(values) for values in rows_of(copy).values()} == {rows}
        with dj.Results(copy) as results:
            assert results.rows("states") == rows
        assert {len(values) for values in rows_of(path).values()} == {STEPS + 1}

    on_root(comm, look)
