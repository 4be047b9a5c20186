# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacements and slips of a run that continues another one count from the static state.

A block slides without friction on another one, which is fixed. The ground accelerates by 1 m/s^2
for 0.1 s, and then by -3 m/s^2. Relative to the ground the block has then moved by
-0.005 - 0.1 s + 1.5 s^2 metres at s seconds of the second run: at most by 6.65 mm at 0.03 s, while
from the start of the second run it moves at most by 5 mm, at its end. The scheme is exact for
constant accelerations.
"""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("matplotlib")

from shaken_wall import Killed, Killer
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints.export.tables import tables_of
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.frames import nodal_displacement
from dolfinx_joints.postprocessing.peaks import joint_peaks
from dolfinx_joints.report.runs import largest_moment, opened

pytestmark = pytest.mark.mpi

MOST, AT = 6.65e-3, 0.13  # largest distance from the static state [m], and its time [s]
FROM_START, END = 5e-3, 0.2  # largest distance from the start of the second run [m], and its time
ELASTIC = 1e-5  # largest displacement by the vibration of the blocks [m]


def sliding(comm, jointed, new_path, *, keep=True, kill=None):
    """Make both runs; return the file of the second. With ``keep`` it has the static stages."""
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        joints=dj.frictionless(normal_stiffness=1e11),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    first, path = dj.Simulation(model), new_path("second.h5")
    first.statics()
    state = first.dynamics(dt=0.01, steps=10, motion=lambda t: (1.0, 0.0, 0.0)).state

    def second(kill, **checkpoint):
        monitor = dj.ResultsMonitor(path, points={"top": (0.5, 0.5, 2.0)}, every=1)
        simulation = dj.Simulation(model, monitors=[monitor, Killer(kill)])
        simulation.static, simulation.stages = first.static, first.stages if keep else []
        motion = {"motion": lambda t: (-3.0, 0.0, 0.0), "start": state}
        simulation.dynamics(dt=0.01, steps=10, **motion, **checkpoint)

    if kill is None:
        second(None)
        return path
    checkpoint = dj.Checkpoints(new_path("run.ckpt"), every=4)
    with pytest.raises(Killed):
        second(kill, checkpoint=checkpoint)
    second(None, checkpoint=replace(checkpoint, resume=True))
    return path


@pytest.mark.parametrize(
    ("options", "zero", "most", "at"),
    [
        ({}, "static state", MOST, AT),
        ({"kill": 6}, "static state", MOST, AT),
        ({"keep": False}, "first record", FROM_START, END),
    ],
    ids=["continued", "restarted", "without stages"],
)
def test_all_values_count_from_the_zero_that_they_name(
    comm, mesh_file, read, new_path, options, zero, most, at
):
    path = sliding(comm, read(mesh_file(two_blocks, size=0.5)), new_path, **options)

    def look():
        with dj.Results(path) as results:
            time, u = measures.displacement_history(results, "top", "x")
            s = time - 0.1
            exact = -0.1 * s + 1.5 * s**2 - (0.005 if zero == "static state" else 0.0)
            np.testing.assert_allclose(u, exact, atol=ELASTIC)
            np.testing.assert_allclose(
                measures.joint_history(results, "joint_1")[2].max(axis=1), np.abs(u), atol=ELASTIC
            )
            extremes = measures.joint_extremes(results, "joint_1")
            np.testing.assert_allclose(extremes.slip, np.abs(u), atol=ELASTIC)
            slip = joint_peaks(results, "joint_1")["slip"]
            assert (slip.value, slip.time) == (pytest.approx(most, abs=ELASTIC), pytest.approx(at))
            of_points = results.series("joint_maxima", "joint_1/slip", -1)
            np.testing.assert_allclose(of_points, most, atol=ELASTIC)
            of_joint = measures.joint_measures(results, tail=0.0)["joint_1"]
            assert of_joint["slip_max"] == pytest.approx(most, abs=ELASTIC)
            assert of_joint["slip_residual"] == pytest.approx(abs(exact[-1]), abs=ELASTIC)
            since, words = nodal_displacement(results, -1, from_static=True)
            assert np.abs(since[:, 0]).max() == pytest.approx(abs(exact[-1]), abs=ELASTIC)
            assert words.startswith(f"from the {zero}")
            label = plots.history(results, "top", "x").get_ylabel()
            assert label == f"displacement x\nfrom the {zero} [mm]"
            header = tables_of(results)["histories"].header
            assert f"displacement of top from the {zero} x [m]" in header
            peaks = [row[0] for row in tables_of(results)["peaks"].rows]
            assert f"slip of joint_1 from the {zero}" in peaks
        with opened([path]) as (run,):
            moment, words = largest_moment(run)
            assert moment == pytest.approx(at)
            assert f"largest displacement of top from the {zero} among" in words
        html = dj.report.write([path], path.with_suffix(".html")).read_text(encoding="utf-8")
        assert f"Normal traction in the {zero}, " in html
        assert f"opening in the {zero} [mm]" in html
        assert f"displacement of the two sides from the {zero}. Safety" in html
        other = {"static state", "first record"} - {zero}
        assert f"from the {other.pop()}" not in html

    on_root(comm, look)
