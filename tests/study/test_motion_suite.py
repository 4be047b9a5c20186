# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Suites of ground motions against single runs, interrupted ones, and their tables."""

import re
import warnings

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx.mesh import CellType, create_rectangle, locate_entities, locate_entities_boundary
from shaken_wall import DT, POINTS, Killed, shaking, wall
from vtk_files import on_root

import dolfinx_joints as dj
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.joints import small_displacements
from dolfinx_joints.monitors.results_monitor import ResultsMonitor
from dolfinx_joints.postprocessing.peaks import crest_points, displacement_peak, joint_peaks
from dolfinx_joints.study import MotionSuite

pytestmark = pytest.mark.mpi

STEPS = 8


def motions(*factors):
    times = DT * np.arange(STEPS + 1)
    strong = np.array([shaking(time) for time in times])
    return {f"x{f:g}": dj.Motion(acceleration=f * strong, dt=DT) for f in factors}


def test_each_file_has_the_warnings_of_its_run(comm, simulation, new_path, monkeypatch):
    """Runs take turns in threads of one process, and Python shows a warning of a line once."""
    monkeypatch.setattr(small_displacements, "LARGEST_JUMP", 6e-5)  # one goes 2e-5, one 2e-4
    shown, files = warnings.showwarning, []
    for folder in ("once", "again"):
        suite = MotionSuite(new_path(folder), simulation(), motions(0.01, 1.0), points=POINTS)
        with warnings.catch_warnings(action="ignore"):
            suite.run(dt=DT, at_once=2)
        files.append([suite.results(name) for name in ("x0.01", "x1")])
    assert warnings.showwarning is shown

    def look():
        for weak, strong in files:
            with dj.Results(weak) as one, dj.Results(strong) as other:
                said = [str(run.summary.get("warnings")) for run in (one, other)]
            assert ["slip or opening reached" in text for text in said] == [False, True]

    on_root(comm, look)


@pytest.fixture
def simulation(wall_file, read):
    """At rest under its own weight; the compressed compliance is the one whose products merge."""

    def make(compliance="compressed"):
        model = wall(read(wall_file()))
        found = dj.Simulation(model, options=dj.SolverOptions(compliance=compliance))
        found.statics()
        return found

    return make


@pytest.mark.parametrize("compliance", ["dense", "compressed", "matrix-free"])
def test_a_run_gives_what_it_gives_alone(comm, simulation, new_path, compliance):
    given, chosen = simulation(compliance), motions(0.3, 1.0, 1.5)
    folder = new_path("suite")
    suite = MotionSuite(folder, given, chosen, points=POINTS, every=2)
    tally = suite.run(dt=DT, at_once=2)
    assert tally.done == list(chosen)
    for name, motion in chosen.items():
        path = new_path(f"{name}.h5")
        alone = dj.Simulation(
            given.model,
            monitors=[ResultsMonitor(path, points=POINTS, every=2)],
            options=given.options,
        )
        alone.static, alone.stages = given.static, list(given.stages)
        alone.dynamics(dt=DT, steps=STEPS, motion=motion)

        def look(name=name, path=path):
            comparison = dj.compare(path, suite.results(name), tolerance=1e-9)
            assert comparison.within, comparison
            with dj.Results(path) as wanted, dj.Results(suite.results(name)) as found:
                assert found.summary["imbalance"] < 1e-11
                assert found.summary.get("warnings") == wanted.summary.get("warnings")

        on_root(comm, look)


def test_a_suite_names_its_motions(simulation, new_path):
    suite = MotionSuite(new_path("named"), simulation(), motions(0.5, 1.0, 2.0), points=POINTS)
    assert "3: x0.5, x1, x2" in repr(suite)


def test_an_interrupted_suite_goes_on(comm, simulation, new_path, monkeypatch):
    given, chosen, folder = simulation(), motions(0.3, 1.0, 1.5), new_path("suite")
    whole = MotionSuite(new_path("whole"), given, chosen, points=POINTS)
    whole.run(dt=DT)
    suite = MotionSuite(folder, given, chosen, points=POINTS)
    record = ResultsMonitor.record

    def killing(monitor, each):
        record(monitor, each)
        if each.step == 5 and monitor._path.stem == "x1":
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(ResultsMonitor, "record", killing)
        with pytest.raises(Killed):
            suite.run(dt=DT, checkpoint_every=3)
    assert suite.run(dt=DT, at_once=1).done == list(chosen)
    assert suite.run(dt=DT).skipped == list(chosen)
    comm.barrier()

    def look():
        assert not list(folder.glob("*.checkpoint"))
        for name, column in whole.table().items():
            if column.dtype == float and name != "imbalance [-]":
                np.testing.assert_allclose(suite.table()[name], column, rtol=1e-9)

    on_root(comm, look)


def test_a_suite_that_was_killed_while_a_run_was_set_up_goes_on(comm, simulation, new_path):
    chosen, folder = motions(0.3, 1.0), new_path("suite")
    suite = MotionSuite(folder, simulation(), chosen, points=POINTS)

    def leave():
        """What signal 9 leaves of a file that is being made."""
        folder.mkdir()
        with h5py.File(folder / "open.h5", "w", libver="latest") as file:
            file.flush()
            suite.results("x1").write_bytes((folder / "open.h5").read_bytes())
        assert not len(suite.table()["case"])

    on_root(comm, leave)
    assert suite.run(dt=DT).done == list(chosen)


def test_the_table_is_that_of_files_and_motions(comm, simulation, new_path):
    chosen = motions(0.3, 1.0)
    suite = MotionSuite(new_path("suite"), simulation(), chosen, points=POINTS)
    suite.run(dt=DT)

    def look():
        table = suite.table(period=0.4)
        assert table["case"].tolist() == ["x0.3", "x1"]
        for i, (name, motion) in enumerate(chosen.items()):
            assert table["pga [m/s^2]"][i] == motion.peak.max()
            with dj.Results(suite.results(name)) as results:
                each = [joint_peaks(results, joint) for joint in results.joints]
                assert table["opening [m]"][i] == max(p["opening"].value for p in each)
                assert table["safety [-]"][i] == min(p["safety"].value for p in each)
                u = results.series("histories", "displacement")
                assert table["displacement [m]"][i] == pytest.approx(np.abs(u - u[0]).max())
        # Linear in the motion: intensities scale with it, that of Arias with its square.
        for what, power in (("pga [m/s^2]", 1), ("sa [m/s^2]", 1), ("arias [m/s]", 2)):
            small, large = table[what]
            assert small / large == pytest.approx(0.3**power, rel=1e-12)

    on_root(comm, look)


def test_intensities_in_2d_are_of_what_moves_the_model(comm, new_path):
    mesh = create_rectangle(comm, [(0.0, 0.0), (1.0, 2.0)], [1, 4], CellType.quadrilateral)
    base = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], 0.0))
    middle = locate_entities(mesh, 1, lambda x: np.isclose(x[1], 1.0))
    jointed = dj.split_mesh(mesh, joints={"middle": middle}, groups={"base": base})
    simulation = dj.Simulation(wall(jointed))
    simulation.statics()
    shaken = np.array([shaking(DT * step) for step in range(STEPS + 1)])
    chosen = {
        name: dj.Motion(acceleration=shaken * factors, dt=DT)
        for name, factors in {"along": [1.0, 0.0, 1.0], "across": [1.0, 9.0, 1.0]}.items()
    }
    suite = MotionSuite(new_path("suite"), simulation, chosen, points={"top": (0.0, 2.0)})
    suite.run(dt=DT)

    def look():
        table = suite.table(period=0.4)
        for what in ("pga [m/s^2]", "sa [m/s^2]", "arias [m/s]"):
            assert table[what][0] == table[what][1] > 0.0

    on_root(comm, look)


def test_what_has_changed_is_not_taken_for_done(comm, simulation, new_path):
    given, folder = simulation(), new_path("suite")
    MotionSuite(folder, given, {"a": motions(1.0)["x1"]}, points=POINTS).run(dt=DT)
    other = MotionSuite(folder, given, {"a": motions(0.5)["x0.5"]}, points=POINTS)
    with pytest.raises(
        StudyError,
        match=r"a\.h5 was .* another motion, free field, time step or version for 'a'",
    ):
        other.run(dt=DT)
    assert other.run(dt=DT, rerun_changed=True).done == ["a"]
    with pytest.raises(ValueError, match="The motion 'a' is .*; it must be a Motion"):
        MotionSuite(folder, given, {"a": shaking}, points=POINTS)


def test_a_motion_that_does_not_converge_is_told_and_a_wrong_point_stops(
    comm, simulation, new_path, monkeypatch
):
    given, chosen = simulation(), motions(0.3, 1.0)
    record = ResultsMonitor.record

    def failing(monitor, each):
        record(monitor, each)
        if each.step == 5 and monitor._path.stem == "x1":
            raise dj.ConvergenceError(iteration=30, residual=1.0)

    monkeypatch.setattr(ResultsMonitor, "record", failing)
    suite = MotionSuite(new_path("suite"), given, chosen, points=POINTS)
    tally = suite.run(dt=DT)
    assert tally.done == ["x0.3"]
    assert "did not converge" in tally.failed["x1"]
    comm.barrier()
    on_root(comm, lambda: np.testing.assert_array_equal(suite.table()["case"], ["x0.3"]))
    elsewhere = MotionSuite(suite.path, given, chosen, points={"here": (0.0, 0.0, 0.0)}).run(dt=DT)
    told = r"x1\.h5 cannot be continued: .* recorded with points=.* Pass rerun_changed=True to"
    assert re.search(told, elsewhere.failed["x1"])
    other = {"dt": DT, "control": dj.StepControl(max_halvings=0)}
    again = suite.run(**other)
    assert again.skipped == ["x0.3"]
    assert "0 in this run. Pass rerun_changed=True to restart it" in again.failed["x1"]
    monkeypatch.undo()
    assert suite.run(**other, rerun_changed=True).done == ["x1"]
    wrong = MotionSuite(new_path("far"), given, chosen, points={"far": (900.0, 0.0, 0.0)})
    with pytest.raises(dj.JointsError, match="is .* m from the nearest node"):
        wrong.run(dt=DT)


def test_motions_are_waves_of_a_free_field(comm, wall_file, read, new_path, monkeypatch):
    """Runs equal single runs under the free field, also after an interruption."""
    model = wall(read(wall_file()), supports=[dj.ViscousBoundary(group="base")])
    given = dj.Simulation(model)
    given.statics()
    chosen, folder = motions(0.1, 0.3), new_path("waves")

    def free_field(motion):
        incident = dj.incident_wave(motion)
        return [dj.FreeField(groups=["base"], incident=incident, surface=1.0)]

    suite = MotionSuite(folder, given, chosen, points=POINTS, every=2)
    record = ResultsMonitor.record

    def killing(monitor, state):
        record(monitor, state)
        if state.step == 5 and monitor._path.stem == "x0.3":
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(ResultsMonitor, "record", killing)
        with pytest.raises(Killed):
            suite.run(dt=DT, free_field=free_field, checkpoint_every=3)
    tally = suite.run(dt=DT, free_field=free_field)
    assert tally.done + tally.skipped == list(chosen)
    path = new_path("wave.h5")
    alone = dj.Simulation(model, monitors=[ResultsMonitor(path, points=POINTS, every=2)])
    alone.static, alone.stages = given.static, list(given.stages)
    alone.dynamics(dt=DT, steps=STEPS, loads=free_field(chosen["x0.3"]))

    def look():
        comparison = dj.compare(path, suite.results("x0.3"), tolerance=1e-9)
        assert comparison.within, comparison

    on_root(comm, look)

    def look_at_table():
        table = suite.table()
        peaks = [np.abs(motion.acceleration).max() for motion in chosen.values()]
        np.testing.assert_allclose(table["pga [m/s^2]"], peaks)
        with dj.Results(suite.results("x0.3")) as run:
            assert not run.relative
            crest = displacement_peak(run, crest_points(run), "ground")
            absolute = displacement_peak(run, crest_points(run))
        stored = table["displacement [m]"][1]
        assert stored == pytest.approx(abs(crest.value))
        assert stored != pytest.approx(abs(absolute.value))

    on_root(comm, look_at_table)


def test_a_free_field_without_waves_or_with_a_motion_is_an_error(simulation, new_path):
    suite = MotionSuite(new_path("none"), simulation(), motions(0.5), points=POINTS)
    for wrong in ([], dj.Gravity(), [dj.Gravity()], None):
        with pytest.raises(ValueError, match=r"free_field of 'x0.5' is .*; it must be a list with"):
            suite.run(dt=DT, free_field=lambda motion, wrong=wrong: wrong)
    field = dj.FreeField(groups=["base"], incident=lambda t: np.zeros(3), surface=1.0)
    with pytest.raises(ValueError, match="Both motion and a FreeField are given"):
        suite.run(dt=DT, loads=[field])


def test_a_run_lasts_as_long_as_the_outcrop_of_its_wave(comm, wall_file, read, new_path):
    """A deconvolved motion begins before the record and ends after it."""
    model = wall(read(wall_file()), supports=[dj.ViscousBoundary(group="base")])
    given = dj.Simulation(model)
    given.statics()
    chosen = motions(0.1)

    def free_field(motion, lead):
        padded = np.pad(motion.acceleration, ((lead, lead), (0, 0)))
        outcrop = dj.Motion(acceleration=padded, dt=DT)
        incident = dj.incident_wave(outcrop)
        return [dj.FreeField(groups=["base"], incident=incident, surface=1.0)]

    suite = MotionSuite(new_path("longer"), given, chosen, points=POINTS)
    suite.run(dt=DT, free_field=lambda motion: free_field(motion, 0))
    plain = suite.table()["displacement [m]"]
    for changed in (lambda motion: free_field(motion, STEPS), None):
        with pytest.raises(StudyError, match="another motion, free field, time step"):
            suite.run(dt=DT, free_field=changed)
    suite.run(dt=DT, free_field=lambda motion: free_field(motion, STEPS), rerun_changed=True)

    def look():
        with dj.Results(suite.results("x0.1")) as run:
            assert run.time("histories")[-1] == pytest.approx(3 * STEPS * DT)
        # The wave is the same, only later, and the wall moves on after it.
        assert suite.table()["displacement [m]"] >= plain * (1.0 - 1e-9)

    on_root(comm, look)


def test_a_motion_is_not_the_velocity_of_a_wave():
    (motion,) = motions(1.0).values()
    with pytest.raises(ValueError, match=r"must be a velocity; use incident_wave\(motion\)"):
        dj.FreeField(groups=["base"], incident=motion, surface=1.0)
