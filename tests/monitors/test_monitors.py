# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results, fields and progress of short jointed runs, on any number of ranks."""

import warnings
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import CONCRETE, DT, POINTS, shaking, wall
from vtk_files import on_root, read_vtk
from whole_vectors import all_of

import dolfinx_joints as dj
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest
from dolfinx_joints.laws.law import BACKWARD_EULER, Rule
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.mesh.orientation import facet_normals
from dolfinx_joints.monitors import results_monitor as monitors
from dolfinx_joints.monitors.field_monitor import FieldMonitor
from dolfinx_joints.monitors.probes import boundary_facets
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants
from dolfinx_joints.postprocessing.joints.surface import map_value
from dolfinx_joints.postprocessing.measures import joint_extremes, joint_measures
from dolfinx_joints.results.overview import overview
from dolfinx_joints.results.quantities import ENERGY_TERMS

pytestmark = pytest.mark.mpi

MU = np.tan(np.deg2rad(30.0))  # of the wall's law
STEPS = 6


def shake(model, monitors, steps=STEPS, **options):
    simulation = dj.Simulation(model, monitors=monitors)
    simulation.statics()
    return simulation.dynamics(dt=DT, steps=steps, motion=shaking, **options)


def content(path):
    """Everything in a results file."""
    with dj.Results(path) as results:
        found = {name: results.static(name) for name in results.statics}
        for stream, names in results.streams.items():
            found[f"{stream}/time"] = results.time(stream)
            for name in names:
                found[f"{stream}/{name}"] = results.series(stream, name)
        return found


def test_states_in_single_precision(comm, wall_file, read, new_path):
    """IEEE's single precision rounds to 24 bits: an error of at most 2**-24 of each number."""
    model, paths = (
        wall(read(wall_file())),
        [new_path(f"{name}.h5") for name in ("double", "single")],
    )
    for path, single in zip(paths, (False, True), strict=True):
        shake(model, [dj.ResultsMonitor(path, points=POINTS, every=2, single_precision=single)])

    def look():
        double, single = map(content, paths)
        assert double.keys() == single.keys()
        rounded = 0
        for name, exact in double.items():
            stored, is_state = single[name], name.startswith("states/") and name != "states/time"
            assert stored.dtype == exact.dtype
            if is_state and exact.dtype == np.float64:
                assert np.all(np.abs(stored - exact) <= 2.0**-24 * np.abs(exact))
                rounded += bool(np.any(stored != exact))
            else:
                np.testing.assert_array_equal(stored, exact)
        assert rounded == 1 + 2 * len(model.operator.names)  # displacement, gaps and tractions
        with h5py.File(paths[0]) as first, h5py.File(paths[1]) as second:
            name = "streams/states/displacement"
            assert second[name].id.get_storage_size() * 2 == first[name].id.get_storage_size()

    on_root(comm, look)


def test_files_of_short_runs_are_small(comm, mesh_file, read, new_path):
    """Write 40 steps of the first demo's dam: no chunk has room left, the file is below 1 MB."""
    path, model = new_path("dam.h5"), wall(read(mesh_file(ambiesta, size=8.0, order=1)))
    shake(model, [dj.ResultsMonitor(path, points={"crest": mid_crest()})], steps=40)

    def look():
        with h5py.File(path) as file:
            names = []
            file["streams"].visit(names.append)
            for series in (file["streams"][name] for name in names):
                if isinstance(series, h5py.Dataset):
                    assert series.id.get_storage_size() == series.nbytes, series.name
        assert path.stat().st_size < 1e6

    on_root(comm, look)


def test_results_of_a_run(comm, wall_file, read, new_path):
    path = new_path("run.h5")
    model = wall(read(wall_file()))
    monitor = dj.ResultsMonitor(path, points=POINTS, every=2, metadata={"who": "test"})
    outcome = shake(model, [monitor], scheme=dj.Newmark())

    def look():
        with dj.Results(path) as results:
            assert results.complete
            assert results.status == "complete"
            assert results.metadata["who"] == "test"
            assert results.metadata["stage"] == "dynamic"
            assert results.metadata["ranks"] == comm.size
            assert results.metadata["dofs"] == model.num_dofs
            assert results.point_names == list(POINTS)
            assert results.summary["steps"] == STEPS
            assert results.summary["accepted"] == outcome.counts.accepted
            assert results.summary["energy_error"] == pytest.approx(outcome.energy_error)
            assert results.joints == ["joint_1", "joint_2", "joint_3"]
            assert not any("envelopes" in name for name in (*results.streams, *results.statics))
            steps = DT * np.arange(STEPS + 1)
            np.testing.assert_allclose(results.time("histories"), steps, atol=1e-15)
            np.testing.assert_allclose(results.time("energy"), steps, atol=1e-15)
            np.testing.assert_allclose(results.time("states"), steps[::2], atol=1e-15)
            assert set(ENERGY_TERMS) <= set(results.streams["energy"])
            lines = [results.series("energy", f"joints/{j}/friction") for j in results.joints]
            total = results.series("energy", "friction")
            np.testing.assert_allclose(np.sum(lines, axis=0), total, rtol=1e-12)
            works = [results.series("energy", f"loads/{n}") for n in ("Gravity", "BaseMotion")]
            total = results.series("energy", "input")
            scale = np.abs(works).max()
            np.testing.assert_allclose(np.sum(works, axis=0), total, rtol=0, atol=1e-12 * scale)
            shares = [results.series("histories", f"joint_{s}") for s in ("open", "stick", "slip")]
            np.testing.assert_allclose(np.sum(shares, axis=0), 1.0, atol=1e-12)
            assert max(shares[0]) > 0
            # Points were found exactly: both are nodes.
            where = results.static("histories/points")
            np.testing.assert_allclose(where, [POINTS["crest"].place, POINTS["corner"]], atol=1e-12)
            # The areas of a joint, facet by facet, add up to 4 m x 20 m.
            for joint in results.joints:
                assert results.static(f"joints/{joint}/areas").sum() == pytest.approx(80.0)
            # 5 x 2 x 4 nodes, those of three joints twice: 40 + 3 x 8.
            assert results.static("mesh/nodes").shape == (64, 3)
            # Faces of 4 x 1 x 3 cells: 2 (4 + 12 + 3), and both sides of 3 joints of 3 facets.
            assert results.static("mesh/surface").shape == (2 * 19 + 2 * 9, 4)
            history = results.series("histories", "displacement")
            nodes, u = results.static("mesh/nodes"), results.series("states", "displacement")
            corner = np.argmin(np.linalg.norm(nodes - POINTS["corner"], axis=1))
            np.testing.assert_array_equal(u[:, corner], history[::2, 1])
            # Open points carry nothing, closed ones k_n times their gap.
            gap = results.series("states", "joints/joint_2/gap")[..., 0]
            t = results.series("states", "joints/joint_2/traction")[..., 0]
            np.testing.assert_allclose(t, 1e11 * np.minimum(gap, 0), rtol=1e-12, atol=1e-6)

    on_root(comm, look)


def test_extremes_of_joints_are_of_every_step(comm, wall_file, read, new_path):
    # Against a second file of the same run that keeps all points at every step.
    paths = new_path("thin.h5"), new_path("dense.h5")
    monitors = [
        dj.ResultsMonitor(path, points=POINTS, every=every, resultants=every == 1)
        for path, every in zip(paths, (100, 1), strict=True)
    ]
    shake(wall(read(wall_file())), monitors)

    def look():
        with dj.Results(paths[0]) as thin, dj.Results(paths[1]) as dense:
            assert thin.rows("states") == 1
            every = joint_measures(dense)
            for joint in thin.joints:
                where = f"joints/{joint}"
                points = dense.static(f"{where}/points")
                areas = dense.static(f"{where}/areas")
                gap = dense.series("states", f"{where}/gap")
                t = dense.series("states", f"{where}/traction")
                found = joint_extremes(thin, joint)
                # Times as they are read: 0.012, where 3 x 0.004 is 0.012 but for the last digit.
                assert found.time.tolist() == [0.0, 0.004, 0.008, 0.012, 0.016, 0.02, 0.024]
                slip = np.linalg.norm(gap[..., 1:] - gap[0, :, 1:], axis=-1)
                for name, values in (("opening", np.maximum(gap[..., 0], 0.0)), ("slip", slip)):
                    largest = values.max(axis=1)
                    np.testing.assert_allclose(getattr(found, name), largest, rtol=1e-12)
                    for row, place in enumerate(getattr(found, f"{name}_at")):
                        if largest[row] == 0.0:
                            assert np.isnan(place).all()
                            continue
                        here = np.linalg.norm(points - place, axis=1) < 1e-9
                        assert values[row, here].max() == pytest.approx(largest[row], rel=1e-8)
                    assert (
                        joint_measures(thin)[joint][f"{name}_time"] == every[joint][f"{name}_time"]
                    )
                np.testing.assert_allclose(found.pressure, -t[..., 0].min(axis=1), rtol=1e-12)
                # Maxima of each point; their largest values are those of the table.
                slides = dense.series("states", f"{where}/status") == 2
                maxima = {
                    "opening": np.maximum(gap[..., 0], 0.0),
                    "slip": slip,
                    "pressure": -t[..., 0],
                    "tension": np.maximum(t[..., 0], 0.0),
                    "shear": np.linalg.norm(t[..., 1:], axis=-1),
                    "slid": slides & (slip > 0.0),
                }
                for name, values in maxima.items():
                    at_points = thin.series("joint_maxima", f"{joint}/{name}", -1)
                    size = values.max()
                    np.testing.assert_allclose(at_points, values.max(axis=0), atol=1e-12 * size)
                for name in ("opening", "slip"):
                    drawn = map_value(thin, joint, f"largest_{name}", -1)
                    largest = every[joint][f"{name}_max"]
                    assert drawn.max() == pytest.approx(1e3 * largest, rel=1e-12)
                mean = -t[..., 0] @ areas / areas.sum()
                np.testing.assert_allclose(found.mean_pressure, mean, rtol=1e-12)
                safety = MU * (-t[..., 0] @ areas) / (np.linalg.norm(t[..., 1:], axis=-1) @ areas)
                again = joint_resultants(dense, joint).sliding_safety
                for each in (found.safety, again):
                    # Infinite where the shear is that of rounding, as by symmetry at rest.
                    np.testing.assert_allclose(np.minimum(each, 1e6), np.minimum(safety, 1e6))
            assert max(m["opening_max"] for m in every.values()) > 0.0
            title = plots.joint_maps(thin, "largest_opening").get_suptitle()
            assert title == "largest opening over the run"
            with pytest.raises(ValueError, match="'largest_slip' is of all steps"):
                plots.joint_maps(thin, "largest_slip", time=0.01)

    on_root(comm, look)


def test_accelerations_are_those_of_the_steps(comm, wall_file, read, new_path):
    # The midpoint rule has v1 = 2 (u1 - u0) / dt - v0 from rest, so the displacements tell the
    # velocities, and these the mean acceleration of each step.
    path = new_path("moving.h5")
    points = {"base": (20.0, 0.0, 0.0), **POINTS}
    shake(wall(read(wall_file())), [dj.ResultsMonitor(path, points=points)])

    def look():
        with dj.Results(path) as results:
            u = results.series("histories", "displacement")
            found = results.series("histories", "acceleration")
            ground = results.series("histories", "ground_acceleration")
            np.testing.assert_array_equal(ground, [shaking(t) for t in results.time("histories")])
        velocity, expected = np.zeros_like(u[0]), [np.zeros_like(u[0])]
        for step in np.diff(u, axis=0):
            after = 2.0 * step / DT - velocity
            expected.append((after - velocity) / DT)
            velocity = after
        size = np.abs(expected).max()
        assert size > 1.0
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * size)
        assert np.all(found[:, 0] == 0.0)  # the base moves with the ground

    on_root(comm, look)


def test_status_of_the_joint_points(comm, wall_file, read, new_path):
    # At the end of a step open points carry nothing, and sliding ones are at the limit of friction.
    # Histories count points once, states once for each facet around them: none is none in both.
    path = new_path("status.h5")
    monitor = dj.ResultsMonitor(path, points=POINTS, every=1)
    shake(wall(read(wall_file())), [monitor], scheme=dj.Newmark())

    def look():
        with dj.Results(path) as results:
            share = results.series("histories", "joint_slip")
            slid = np.zeros(STEPS + 1)
            for joint in results.joints:
                status = results.series("states", f"joints/{joint}/status")
                traction = results.series("states", f"joints/{joint}/traction")
                assert status.shape == traction.shape[:2]
                assert np.all(traction[status == 0] == 0.0)
                shear, limit = np.hypot(*traction.T[1:]).T, -MU * traction[..., 0]
                np.testing.assert_allclose(shear[status == 2], limit[status == 2], rtol=1e-9)
                assert np.all(shear[status == 1] <= limit[status == 1])
                slid += (status == 2).sum(axis=1)
            np.testing.assert_array_equal(slid > 0, share > 0)
            assert slid.any()

    on_root(comm, look)


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_the_file_does_not_depend_on_ranks(comm, cell, wall_file, read, new_path):
    # The same run on all ranks and on a communicator of this process alone.
    many, alone = new_path("many.h5"), new_path(f"alone_{comm.rank}.h5")
    mesh = wall_file(cell=cell)
    shake(wall(read(mesh)), [dj.ResultsMonitor(many, points=POINTS, every=3)])
    shake(wall(read(mesh, on=MPI.COMM_SELF)), [dj.ResultsMonitor(alone, points=POINTS, every=3)])

    def look():
        # Of 1e-9 of the largest value of a joint; no joint has less than a tenth of all joints.
        comparison = dj.compare(many, alone, tolerance=1e-10)
        assert (comparison.within, comparison.notes) == (True, []), comparison
        for row in comparison.rows:
            if row.quantity.endswith(("/status", "_at", "/jumps")):
                assert row.relative <= 1e-10, row

    on_root(comm, look)


@dataclass(frozen=True)
class GivesUp:
    """Newmark's method up to a time, and never beyond it."""

    time: float
    rule: Rule = BACKWARD_EULER
    forces_over_steps: bool = False

    def conserves(self, system: Any) -> bool:
        return True

    def advance(self, solver: Any, state: Any, dt: float, end: float | None = None) -> Any:
        if state.time + dt > self.time * (1 + 1e-9):
            raise dj.ConvergenceError(iteration=30, residual=1.0, tolerance=1e-10)
        return dj.Newmark().advance(solver, state, dt, end)


def test_a_long_error_leaves_room_for_the_summary(comm, wall_file, read, new_path):
    def loud(time: float) -> np.ndarray:
        if time > 2.5 * DT:
            raise RuntimeError("x" * 100_000)
        return np.zeros(3)

    path = new_path("loud.h5")
    run = dj.Simulation(wall(read(wall_file())), monitors=[dj.ResultsMonitor(path, points=POINTS)])
    run.statics()
    with pytest.raises(RuntimeError):
        run.dynamics(dt=DT, steps=5, motion=loud)

    def look():
        with dj.Results(path) as results:
            assert results.status == "failed"
            assert results.summary["error"].startswith("RuntimeError: xxx")
            assert len(results.summary["error"]) == 2000
            assert results.summary["solver"]

    on_root(comm, look)


def test_a_run_that_fails_keeps_what_was_computed(comm, wall_file, read, new_path):
    path, fields = new_path("failed.h5"), new_path("failed.vtkhdf")
    monitors = [dj.ResultsMonitor(path, points=POINTS, every=1), FieldMonitor(fields, every=1)]
    with pytest.raises(dj.ConvergenceError) as failure:
        shake(
            wall(read(wall_file())),
            monitors,
            scheme=GivesUp(3 * DT),
            control=dj.StepControl(max_halvings=2),
        )
    assert (failure.value.stage, failure.value.step) == ("dynamic", 4)
    assert failure.value.time == pytest.approx(3.25 * DT)
    assert len(set(comm.allgather(str(failure.value)))) == 1

    def look():
        with dj.Results(path) as results:
            assert results.status == "failed"
            assert not results.complete
            assert results.rows("histories") == results.rows("states") == 4
            assert "ConvergenceError" in results.summary["error"]
            assert "step 4" in results.summary["error"]
            assert np.all(np.isfinite(results.series("states", "displacement")))
        assert len(read_vtk(fields)) == 4

    on_root(comm, look)


def test_run_without_joints(comm, wall_file, read, new_path):
    path = new_path("whole.h5")
    model = dj.Model(
        read(wall_file(), joints=[]), material=CONCRETE, supports=[dj.Fixed(group="base")]
    )
    points = {"corner": POINTS["corner"]}
    simulation = dj.Simulation(model, monitors=[dj.ResultsMonitor(path, points=points, every=1)])
    outcome = simulation.dynamics(dt=DT, steps=2, motion=shaking)
    assert outcome.energy_error <= 1e-10  # linear: Newmark's balance is exact

    def look():
        with dj.Results(path) as results:
            assert results.complete
            assert results.joints == []
            assert np.all(results.series("histories", "joint_open") == 0)

    on_root(comm, look)


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_the_written_surface_is_closed_and_faces_outward(comm, wall_file, read, cell):
    """Each edge is run through once either way, and the flux of x is three times the volume."""
    model = wall(read(wall_file(cell=cell)))
    nodes = NodeNumbering(model.V)
    surface = all_of(comm, boundary_facets(model, nodes))
    edges = np.stack([surface, np.roll(surface, -1, axis=1)], axis=-1).reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)
    np.testing.assert_array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))
    corners = all_of(comm, nodes.positions)[surface]
    flux = np.einsum("fi,fi->", corners.mean(axis=1), facet_normals(corners))
    assert flux == pytest.approx(3 * 1600.0)  # 20 x 4 x 20 m


def test_point_far_from_the_body_is_refused(comm, wall_file, read, new_path):
    model = wall(read(wall_file()))
    monitor = dj.ResultsMonitor(new_path("far.h5"), points={"moon": (0.0, 0.0, 384e6)})
    with pytest.raises(dj.MeshError) as failure:
        shake(model, [monitor], steps=1)
    assert str(failure.value).startswith("Monitor point (0, 0, 3.84e+08) is 3.84e+08 m")
    assert len(set(comm.allgather(str(failure.value)))) == 1


def test_points_are_checked():
    message = "points is {}; it must be coordinates by name of one or more"
    with pytest.raises(ValueError, match=message):
        dj.ResultsMonitor("x.h5", points={})


def test_a_file_that_cannot_be_begun_is_closed(comm, wall_file, read, new_path, monkeypatch):
    # What goes wrong on rank 0, after the file is made, is raised on all; the file says so.
    declare = monitors.declare

    def fail(writer, stream, values, **options):
        if stream == "energy":
            raise RuntimeError("no energies today")
        declare(writer, stream, values, **options)

    monkeypatch.setattr(monitors, "declare", fail)
    path = new_path("begun.h5")
    with pytest.raises(RuntimeError, match="no energies today"):
        shake(wall(read(wall_file())), [dj.ResultsMonitor(path, points=POINTS)], steps=1)
    comm.barrier()

    def look():
        assert not path.with_name("begun.h5.lock").exists()
        with dj.Results(path) as results:
            assert results.status == "failed"
            assert results.summary == {"error": "RuntimeError: no energies today"}

    on_root(comm, look)


def test_fields_that_cannot_be_written_are_reported(comm, wall_file, read, new_path):
    there = new_path("file")
    on_root(comm, there.touch)
    with pytest.raises(
        dj.ResultsError, match="fields.*vtkhdf cannot be written: .*(Not a directory|File exists)"
    ) as got:
        shake(wall(read(wall_file())), [FieldMonitor(there / "fields")], steps=1)
    assert len(set(comm.allgather(str(got.value)))) == 1


def test_progress(comm, wall_file, read, capsys):
    outcome = shake(wall(read(wall_file())), [dj.ProgressMonitor("wall")], steps=3)
    assert outcome.steps == 3
    shown = capsys.readouterr().err
    texts = comm.allgather(shown)
    assert "wall" in texts[0]
    assert "3/3" in texts[0]
    assert all(text == "" for text in texts[1:])
    assert "% open" in texts[0]


def test_progress_without_joints_tells_no_shares(comm, wall_file, read, capsys):
    model = dj.Model(
        read(wall_file(), joints=[]), material=CONCRETE, supports=[dj.Fixed(group="base")]
    )
    shake(model, [dj.ProgressMonitor("whole")], steps=2)
    texts = comm.allgather(capsys.readouterr().err)
    assert "2/2" in texts[0]
    assert " it" in texts[0]
    assert "open" not in texts[0]


def test_where_points_went_is_told(comm, wall_file, read, new_path):
    # Joint_2 is the plane x = 10 of a wall of 20 x 4 x 20 m, in cells of 5 x 4 x 6.7 m.
    joint, above = (10.0, 0.0, 20.0), (-1.0, -0.5, 21.0)
    points = {
        "corner": (0.0, 4.0, 20.0),
        "above": above,
        "joint": joint,
        "left": dj.Probe(joint, group="joint_2-"),
        "right": dj.Probe(joint, group="joint_2+"),
        "between": (0.0, 2.0, 20.0),
    }
    path = new_path("probes.h5")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        shake(wall(read(wall_file())), [dj.ResultsMonitor(path, points=points)])
    told = [str(w.message) for w in caught if "Monitored points" in str(w.message)]
    if comm.rank == 0:
        # The nearest node of (-1, -0.5, 21) is (5, 0, 20): 1.5 m away.
        assert len(told) == 1
        assert told[0].startswith(
            "Monitored points: above (-1, -0.5, 21) is read at the node (0, 0, 20), 1.5 m away"
        )
        assert "; joint (10, 0, 20) is read on the side joint_2" in told[0]
        assert told[0].count("on the side") == 1  # two nodes are as near to "between": no sides
        assert not any(name in told[0] for name in ("corner", "left", "right"))
    else:
        assert not told

    def look():
        with dj.Results(path) as results:
            where = results.static("histories/points")
            known = results.metadata["points"]
            u = results.series("histories", "displacement")
        np.testing.assert_allclose(where[1], (0.0, 0.0, 20.0), atol=1e-12)
        np.testing.assert_allclose(where[3:5], [joint, joint], atol=1e-12)
        assert known["above"]["place"] == list(above)
        assert known["corner"]["sides"] == []
        assert known["left"]["sides"] == ["joint_2-"]
        assert known["right"]["sides"] == ["joint_2+"]
        # n points along x: the shaken joint opens and slips, so its sides move apart.
        assert np.abs(u[:, 4] - u[:, 3]).max() > 0
        assert any(np.array_equal(u[:, 2], u[:, i]) for i in (3, 4))
        text = " ".join(overview(path).split())
        assert "above at (0 0 20) m 1.5 m from the place given" in text
        assert "right at (10 0 20) m on joint_2+" in text

    on_root(comm, look)


@pytest.mark.parametrize(
    ("checks", "message"),
    [
        ({"slidng_safety": 1.1}, "slidng_safety is 1.1; it must be a limit of .*, sliding_safety"),
        ({"drift": -1.0}, "drift is -1.0; it must be a limit of zero or more"),
        ({"crest": "crst"}, "checks: crest is 'crst'; it must be one of crest, foot"),
        ({"kind": "dam"}, "checks: kind is 'dam'; it must be one of gravity, arch"),
    ],
)
def test_wrong_arguments_of_checks_are_errors_before_the_run(checks, message):
    points = {"crest": (0, 0, 1), "foot": (0, 0, 0)}
    with pytest.raises(ValueError, match=message):
        dj.ResultsMonitor("never.h5", points=points, metadata={"checks": checks})


@pytest.mark.parametrize(
    ("sliding", "message"),
    [
        (3, "metadata 'sliding' is 3; it must be planes"),
        (["joint"], "metadata 'sliding' is .'joint'.; it must be planes"),
        ({"b": 3}, "block 'b': planes is 3; it must be 1 or more values"),
        ({"b": "joint"}, "block 'b': planes is 'joint'; it must be 1 or more values"),
        (
            {"b": ["joint", "joint"]},
            "planes is .*; it must be names of joints, each once",
        ),
        ({"b": {"plane": ["joint"]}}, "block 'b' is .*; it must be planes, or planes, direction, "),
        ({"b": {"planes": ["joint"], "direction": [1, 0]}}, "direction is .* it must be 3 finite"),
    ],
)
def test_wrong_blocks_are_errors_before_the_run(sliding, message):
    with pytest.raises(ValueError, match=message):
        dj.ResultsMonitor("never.h5", points={"p": (0, 0, 0)}, metadata={"sliding": sliding})
    both = {"a": ["left", "right"], "b": {"planes": ["joint"], "direction": (1, 0, 0)}}
    options = {"points": {"p": (0, 0, 0)}, "metadata": {"sliding": both}}
    dj.ResultsMonitor("never.h5", resultants=True, **options)
    with pytest.raises(ValueError, match="'sliding' needs the forces on blocks: set resultants=Tr"):
        dj.ResultsMonitor("never.h5", **options)
