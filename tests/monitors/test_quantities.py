# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series of results files and the rows of the table of quantities."""

import pytest

pytest.importorskip("dolfinx")

from shaken_wall import DT, POINTS, shaking, wall
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints.results.quantities import JOINT_SERIES, TABLE, row_of

pytestmark = pytest.mark.mpi


def test_every_series_of_a_file_is_a_row(comm, wall_file, read, new_path):
    path = new_path("rows.h5")
    monitor = dj.ResultsMonitor(path, points=POINTS, resultants=True, envelopes=True)
    simulation = dj.Simulation(wall(read(wall_file())), monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=DT, steps=1, motion=shaking)

    def look():
        with dj.Results(path) as results:
            for stream, names in results.streams.items():
                for name in names:
                    row, of = row_of(stream, name)
                    assert results.unit(stream, name) == row.unit
                    text = results.description(stream, name)
                    expected = (row.text or row.label).format(of, frame="relative to the ground")
                    assert text == expected != ""
            recorded = {name.split("/")[1] for name in results.streams["joints"]}
        assert {row.key for row in JOINT_SERIES} <= recorded

    on_root(comm, look)


def test_names_are_unique_in_each_stream():
    for rows in TABLE.values():
        assert len({row.name for row in rows}) == len(rows)
