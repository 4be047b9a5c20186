# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What pandas, xarray, PyVista and VTK read is what the results file holds, units with it."""

import warnings

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import POINTS, shaking, wall
from vtk_files import read_vtk

import dolfinx_joints as dj
from dolfinx_joints import export
from dolfinx_joints.cli import main
from dolfinx_joints.export import paraview
from dolfinx_joints.export.grids import joint_grid
from dolfinx_joints.geometry.jointed_wall import jointed_wall

# Steps too long for accelerations up to 25 Hz.
STEPS, DT = 4, 5e-3
pytestmark = pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Results files of walls by shape and degree of their cells, written when asked for."""
    found: dict[tuple[str, int], dj.Results] = {}
    folder = tmp_path_factory.mktemp("runs")

    def run(shape: str = "hex", order: int = 1) -> dj.Results:
        if (shape, order) not in found:
            name = f"{shape}{order}"
            msh = jointed_wall(folder / f"{name}.msh", cell=shape, order=order, divisions=(4, 1, 4))
            model = wall(dj.read_msh(msh, MPI.COMM_SELF))
            monitors = [
                dj.ResultsMonitor(folder / f"{name}.h5", points=POINTS, every=2),
                dj.FieldMonitor(folder / f"{name}.vtkhdf", every=2),
            ]
            simulation = dj.Simulation(model, monitors=monitors)
            simulation.statics(name="own weight")
            simulation.dynamics(dt=DT, steps=STEPS, motion=shaking)
            found[shape, order] = dj.Results(folder / f"{name}.h5")
        return found[shape, order]

    yield run
    for results in found.values():
        results.close()


def test_pandas(runs):
    pytest.importorskip("pandas")
    results = runs()
    frame = export.to_pandas(results)
    assert frame.index.name == "time [s]"
    np.testing.assert_array_equal(frame.index, results.time("histories"))
    u = results.series("histories", "displacement")
    assert results.unit("histories", "displacement") == "m"
    moved = frame["displacement of corner from the static state y [m]"]
    np.testing.assert_array_equal(moved, u[:, 1, 1] - u[0, 1, 1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # those of bands are of other tables
        energy = export.to_pandas(results, "energy")
    friction = results.series("energy", "joints/joint_1/friction")
    np.testing.assert_array_equal(energy["joints/joint_1/friction [J]"], friction)
    peaks = export.to_pandas(results, "peaks").set_index("peak")
    moved = np.abs(u[:, 1] - u[0, 1]).max()
    assert abs(peaks.loc["displacement of corner from the static state", "value"]) == moved
    opening = results.series("joints", "joint_2/opening")
    row = peaks.loc["opening of joint_2"]
    assert (row["value"], row["unit"]) == (opening.max(), "m")
    assert row["time [s]"] == results.time("joints")[opening.argmax()]
    with pytest.raises(dj.ResultsError, match="no table 'modes'; it has stages, stage_joints"):
        export.to_pandas(results, "modes")


def test_xarray(runs):
    pytest.importorskip("xarray")
    results = runs()
    histories = export.to_xarray(results)
    u = histories["displacement"]
    assert u.attrs["units"] == results.unit("histories", "displacement")
    np.testing.assert_array_equal(
        u.sel(point="corner", component="z"), results.series("histories", "displacement")[:, 1, 2]
    )
    np.testing.assert_array_equal(histories["x"], results.static("histories/points")[:, 0])
    states = export.to_xarray(results, "states")
    assert states["traction"].dims == ("time", "joint_point", "axis")
    assert states["traction"].attrs["units"] == "Pa"
    mine = states["traction"].sel(joint_point=states["joint"] == "joint_2", axis="n")
    held = results.series("states", "joints/joint_2/traction")[:, :, 0]
    np.testing.assert_array_equal(mine, held)
    np.testing.assert_array_equal(states["time"], results.time("states"))
    np.testing.assert_array_equal(states["displacement"], results.series("states", "displacement"))


def test_plane_run(two_rectangles_file, read, new_path):
    """Forces on supports have no z, points and nodes have: both in one data set, table likewise."""
    pytest.importorskip("xarray")
    model = wall(read(two_rectangles_file(), on=MPI.COMM_SELF))
    path = new_path("plane.h5")
    simulation = dj.Simulation(model, monitors=[dj.ResultsMonitor(path, points={"top": (0, 2)})])
    simulation.statics()
    simulation.dynamics(dt=1e-4, steps=STEPS)
    with dj.Results(path) as results:
        histories, frame = export.to_xarray(results), export.to_pandas(results)
        force = results.series("histories", "reaction/base")
    assert force.shape == (STEPS + 1, 2)
    reaction = histories["reaction/base"]
    np.testing.assert_array_equal(reaction.sel(component=["x", "y"]), force)
    assert reaction.sel(component="z").isnull().all()
    assert histories["displacement"].sel(component="z").notnull().all()
    np.testing.assert_array_equal(frame["reaction/base y [N]"], force[:, 1])
    assert "reaction/base z [N]" not in frame


@pytest.mark.parametrize("states", [1, 2, 3])
def test_blocks_of_states(runs, monkeypatch, tmp_path, states):
    """Three states in blocks: all numbers are those of the results file, under its units."""
    results = runs()
    monkeypatch.setattr(paraview, "_BLOCK_BYTES", states * results.static("mesh/nodes").nbytes)
    files = export.write_vtk(results, tmp_path / "blocks")
    body, joints = (h5py.File(path)["VTKHDF"] for path in files[:2])
    times, u = results.time("states"), results.series("states", "displacement")
    assert len(times) == 3
    for file in (body, joints):
        np.testing.assert_array_equal(file["Steps/Values"], times)
        assert file["Steps"].attrs["NSteps"] == 3
    np.testing.assert_array_equal(body["PointData/displacement [m]"], np.concatenate(u))
    for name, series in (
        ("gap [m]", "gap"),
        ("traction [Pa]", "traction"),
        ("status [-]", "status"),
    ):
        parts = [f"joints/{joint}/{series}" for joint in results.joints]
        assert {results.unit("states", part) for part in parts} == {name.split("[")[1][:-1]}
        held = np.concatenate([results.series("states", part) for part in parts], axis=1)
        np.testing.assert_array_equal(joints[f"CellData/{name}"], np.concatenate(held))
        offsets = joints[f"Steps/CellDataOffsets/{name}"]
        np.testing.assert_array_equal(offsets, held.shape[1] * np.arange(3))


def check_order_of_nodes(body, order):
    """VTK interpolates a polynomial of the cells' degree exactly wherever it is asked.

    The cells are straight: with nodes in another order places or values would come out wrong.
    """
    from vtkmodules.vtkCommonCore import mutable

    def polynomial(x):
        first = 2.0 + x @ [0.3, -0.7, 0.2]
        return first if order == 1 else first + (x @ [0.5, 0.1, -0.4]) ** 2

    random = np.random.default_rng(5)
    for cell in map(body.GetCell, range(body.n_cells)):
        nodes = body.points[[cell.GetPointId(i) for i in range(cell.GetNumberOfPoints())]]
        place, weights = np.zeros(3), np.zeros(len(nodes))
        cell.EvaluateLocation(mutable(0), random.uniform(0.0, 0.33, 3), place, weights)
        low, high = nodes.min(axis=0), nodes.max(axis=0)
        assert np.all((low < place) & (place < high))
        assert weights @ polynomial(nodes) == pytest.approx(polynomial(place), rel=1e-12)


def check_that_joints_move_with_the_body(results, blocks):
    """As the mean of what their nodes on both faces do, linearly between them."""
    nodes, u = results.static("mesh/nodes"), blocks["body"].point_data["displacement [m]"]
    for name in results.joints:
        moved = blocks["joints"][name].point_data["displacement [m]"]
        points, met = blocks["joints"][name].points, 0
        for point, own in zip(points, moved, strict=True):
            (same,) = np.nonzero(np.linalg.norm(nodes - point, axis=1) < 1e-9)
            if len(same):
                met += 1
                np.testing.assert_allclose(own, u[same].mean(axis=0), atol=1e-12)
        assert met >= 4
        grid, slope = joint_grid(results, name), np.array([[1, 2, 3], [4, 5, 6], [7, 8, 1.0]])
        linear = grid.motion @ (nodes @ slope + [1.0, 2.0, 3.0])
        np.testing.assert_allclose(linear, points @ slope + [1.0, 2.0, 3.0], rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("shape", ["tet", "hex"])
def test_vtk_and_pyvista(runs, shape, order, tmp_path):
    pytest.importorskip("pyvista")
    results = runs(shape, order)
    blocks = export.to_pyvista(results, index=-1)
    body = blocks["body"]
    np.testing.assert_allclose(np.ptp(body.points, axis=0), [20.0, 4.0, 20.0])
    assert abs(body.linear_copy().volume - 1600.0) < 1e-9 * 1600.0
    check_order_of_nodes(body, order)
    check_that_joints_move_with_the_body(results, blocks)
    area = sum(joint.compute_cell_sizes()["Area"].sum() for joint in blocks["joints"])
    shares = [results.static(f"joints/{joint}/areas").sum() for joint in results.joints]
    assert area == pytest.approx(sum(shares), rel=1e-12)
    main(["vtk", str(results.path), "--out", str(tmp_path / "later")])
    for path in (results.path.with_suffix(".vtkhdf"), tmp_path / "later.vtkhdf"):
        body, joints = read_vtk(path), read_vtk(path.with_name(f"{path.stem}_joints.vtkhdf"))
        assert [time for time, _ in body] == [time for time, _ in joints]
        assert [time for time, _ in body] == results.time("states").tolist()
        for number, ((_, grid), (_, of_joints)) in enumerate(zip(body, joints, strict=True)):
            u = results.series("states", "displacement", number)
            np.testing.assert_array_equal(grid.point_data["displacement [m]"], u)
            np.testing.assert_array_equal(grid.points, results.static("mesh/nodes"))
            rows = results.static("mesh/groups/concrete")
            np.testing.assert_array_equal(np.flatnonzero(grid.cell_data["in concrete [-]"]), rows)
            if number == len(body) - 1:
                moved = of_joints.point_data["displacement [m]"]
                shown = [joint.point_data["displacement [m]"] for joint in blocks["joints"]]
                np.testing.assert_array_equal(moved, np.concatenate(shown))
            for name in ("gap [m]", "traction [Pa]", "status [-]"):
                series, unit = name.removesuffix("]").split(" [")
                of_all = [f"joints/{joint}/{series}" for joint in results.joints]
                assert {results.unit("states", each) for each in of_all} == {unit}
                held = [results.series("states", each, number) for each in of_all]
                np.testing.assert_array_equal(of_joints.cell_data[name], np.concatenate(held))
            wide = np.maximum(of_joints.cell_data["gap [m]"][:, 0], 0.0)
            np.testing.assert_array_equal(of_joints.cell_data["opening [m]"], wide)
            for i, joint in enumerate(results.joints):
                inside = of_joints.cell_data["joint [-]"] == i
                np.testing.assert_array_equal(of_joints.cell_data[f"in {joint} [-]"], inside)
                mean = results.series("joints", f"{joint}/mean_pressure", 2 * number)
                found = of_joints.cell_data["mean pressure [Pa]"][inside]
                np.testing.assert_allclose(found, mean, rtol=1e-12)
        stages = path.with_name(f"{path.stem}_stages.vtkhdf")
        ((number, grid),) = read_vtk(stages)
        assert number == 1.0
        u = results.series("statics", "displacement", 0)
        np.testing.assert_array_equal(grid.point_data["displacement [m]"], u)
        ((_, of_joints),) = read_vtk(stages.with_name(f"{stages.stem}_joints.vtkhdf"))
        held = [results.series("statics", f"joints/{j}/traction", 0) for j in results.joints]
        np.testing.assert_array_equal(of_joints.cell_data["traction [Pa]"], np.concatenate(held))
    with pytest.raises(dj.ResultsError, match="file exists; --force"):
        export.write_vtk(results, tmp_path / "later")
