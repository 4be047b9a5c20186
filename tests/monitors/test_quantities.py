# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A row of the table of quantities is in results files, tables, reports, figures and ParaView."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from shaken_wall import DT, POINTS, shaking, wall
from vtk_files import on_root, read_vtk

import dolfinx_joints as dj
from dolfinx_joints import export, plots, report
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants
from dolfinx_joints.results.quantities import JOINT_SERIES, TABLE, row_of

pytestmark = pytest.mark.mpi

STEPS = 4


def test_mean_pressure_is_normal_force_over_area(comm, wall_file, read, new_path):
    """Everywhere, by name and unit: the joints are plane and bear no tension."""
    pytest.importorskip("pandas")
    folder = new_path("mean")
    on_root(comm, folder.mkdir)
    monitors = [
        dj.ResultsMonitor(folder / "r.h5", points=POINTS, every=2, resultants=True),
        dj.FieldMonitor(folder / "run.vtkhdf", every=2),
    ]
    simulation = dj.Simulation(wall(read(wall_file())), monitors=monitors)
    simulation.statics()
    simulation.dynamics(dt=DT, steps=STEPS, motion=shaking)

    def look():
        with dj.Results(folder / "r.h5") as results:
            wanted = {}
            for joint in results.joints:
                force = joint_resultants(results, joint).normal_force
                wanted[joint] = force / results.static(f"joints/{joint}/areas").sum()
                assert np.ptp(wanted[joint]) > 1e-3 * wanted[joint].max() > 0.0
                found = results.series("joints", f"{joint}/mean_pressure")
                np.testing.assert_allclose(found, wanted[joint], rtol=1e-12)
                assert results.unit("joints", f"{joint}/mean_pressure") == "Pa"
                assert results.description("joints", f"{joint}/mean_pressure") == "mean pressure"
            every = np.concatenate(list(wanted.values()))
            frame = export.to_pandas(results, "joint_extremes")
            np.testing.assert_allclose(frame["mean pressure [Pa]"], every, rtol=1e-12)
            drawn = plots.joint_panels(results, "mean_pressure")
            line = drawn.axes[0].lines[0].get_ydata()
            np.testing.assert_allclose(line, 1e-6 * wanted[results.joints[0]], rtol=1e-12)
            assert "mean pressure [MPa]" in [text.get_text() for text in drawn.texts]
            export.write_vtk(results, folder / "again.vtkhdf")
            for name in ("again_joints.vtkhdf", "run_joints.vtkhdf"):
                for number, (_, grid) in enumerate(read_vtk(folder / name)):
                    for joint in results.joints:
                        here = grid.cell_data[f"in {joint} [-]"] == 1
                        values = grid.cell_data["mean pressure [Pa]"][here]
                        np.testing.assert_allclose(values, wanted[joint][2 * number], rtol=1e-12)
        html = report.write([folder / "r.h5"], folder / "r.html", with_3d=False).read_text()
        assert "largest mean pressure [MPa]" in html
        assert "Largest opening, largest slip, largest pressure, mean pressure, sliding" in html

    on_root(comm, look)


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
