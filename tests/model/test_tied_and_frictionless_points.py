# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points that are tied, at the end of a joint inside a body, and points without friction.

Counts, shares, files, tables and reports say what they do. The body is 4 m x 1 m x 2 m of cells of
0.5 m with a level joint at half its height.
"""

import shutil

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")


from dolfinx.mesh import CellType, create_box, locate_entities, locate_entities_boundary

import dolfinx_joints as dj
from dolfinx_joints.export import to_xarray, write_csv
from dolfinx_joints.export.grids import joint_grid
from dolfinx_joints.laws.law import Status
from dolfinx_joints.monitors.resultants import JointForces
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants
from dolfinx_joints.results.joint_points import free_areas, joint_area, tied_points
from dolfinx_joints.results.overview import overview
from dolfinx_joints.simulation.outcome import shares

pytestmark = pytest.mark.mpi

STONE = dj.Elastic(young=20e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)
BASE = dj.Fixed(group="base")
END = 2.5  # where the joint ends inside the body [m]


def body(comm, end):
    """The body with its joint from x = 0 to ``end``."""
    mesh = create_box(comm, [[0, 0, 0], [4, 1, 2]], [8, 2, 4], CellType.hexahedron)
    mesh.topology.create_connectivity(2, 3)
    cut = locate_entities(mesh, 2, lambda x: np.isclose(x[2], 1.0) & (x[0] < end + 1e-9))
    groups = {
        "base": locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0.0)),
        "top": locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 2.0)),
    }
    return dj.split_mesh(mesh, joints={"joint_1": cut}, groups=groups)


def with_joint(comm, end, joints, **options):
    return dj.Model(body(comm, end), material=STONE, joints=joints, supports=[BASE], **options)


@pytest.mark.parametrize(
    ("degree", "quadrature", "points", "tied", "area"),
    [
        # Trapezoidal rule: points at the 6 x 3 vertices, half a cell's length at the end.
        (1, "auto", 18, 3, 0.25),
        # Simpson's rule: 11 x 5 nodes, a sixth of a cell's length at the end.
        (2, "nodal", 55, 5, 0.5 / 6.0),
        # Gauss's points lie within the ten facets, four on each: none is tied.
        (1, "gauss", 40, 0, 0.0),
    ],
)
def test_number_and_area_of_tied_points(comm, degree, quadrature, points, tied, area):
    model = with_joint(
        comm, END, dj.Joints(LAW, quadrature=quadrature), body=dj.Body(degree=degree)
    )
    operator = model.operator
    assert operator.num_points == points
    counts = model.contact.counts(np.full(len(operator.areas), Status.STICK, dtype=np.int8))
    assert (counts.tied, counts.total) == (tied, points - tied)
    assert (counts.open, counts.stick, counts.slip, counts.frictionless) == (0, counts.total, 0, 0)
    assert comm.allreduce(float(operator.areas @ operator.tied)) == pytest.approx(area, rel=1e-12)
    assert np.all(np.isclose(operator.points[operator.tied, 0], END))
    # All displacements of size one: what a tied point sees of them is no gap.
    moved = model.stiffness.createVecRight()
    moved.setRandom()
    gap = model.contact.gap(moved)
    assert np.abs(gap[operator.tied]).max(initial=0.0) == 0.0
    assert np.abs(gap[~operator.tied]).max(axis=1).min(initial=1.0) > 0.0


def test_tied_points_have_no_part_in_forces(comm):
    """An overlap of 1 um given to the whole joint: 0.1 MPa on the 2.25 m2 that are not tied.

    The cohesion of the bond, 1 MPa, acts there, too.
    """
    law = dj.MohrCoulombJoint(
        normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0, cohesion=1e6
    )
    model = with_joint(comm, END, dj.Joints(law, initial_gaps={"joint_1": -1e-6}))
    still = model.stiffness.createVecRight()
    answer = model.contact.trial(still, model.contact.at_rest(still))
    found = JointForces(model)(answer)["joint_1"]
    assert found.geometry.area == pytest.approx(2.5, rel=1e-12)
    assert found.normal_force == pytest.approx(1e5 * 2.25, rel=1e-9)
    assert found.compression == pytest.approx(1e5 * 2.25, rel=1e-9)
    assert found.bond == pytest.approx(1e6 * 2.25, rel=1e-12)
    assert found.contact == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("lift", [True, False], ids=["lifted", "pressed"])
def test_tied_points_in_files_and_reports(comm, new_path, tmp_path, lift):
    """All points but the tied ones are open under 0.1 MPa upwards, closed under as much downwards.

    Of the area of 2.5 m2 a tenth is tied, half of the last cell's length.
    """
    path = new_path("tied.h5")
    load = dj.Traction(group="top", value=(0.0, 0.0, 1e5 if lift else -1e5))
    model = with_joint(comm, END, LAW, loads=[load])
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 0.0, 2.0)}, every=1, resultants=True)
    run = dj.Simulation(model, monitors=[monitor])
    static = run.statics()
    counts = static.reports[-1].counts
    assert (counts.total, counts.tied) == (15, 3)
    assert (counts.open, counts.stick + counts.slip) == ((15, 0) if lift else (0, 15))
    assert shares(counts).startswith(f"15: {100.0 if lift else 0.0:.1f} % open")
    assert shares(counts).endswith("; 3 more tied")
    run.dynamics(dt=0.01, steps=2)
    if comm.rank:
        return
    with dj.Results(path) as results:
        _check_tied(results, lift)
        if lift:
            _check_pages(results, tmp_path)
    old = tmp_path / "old.h5"
    shutil.copy(path, old)
    with h5py.File(old, "r+") as file:
        del file["static/joints/joint_1/tied"], file["streams/histories/joint_frictionless"]
        for stream in ("states", "statics"):
            status = file[f"streams/{stream}/joints/joint_1/status"]
            status[status[()] == Status.TIED] = Status.STICK
    with dj.Results(old) as results:  # as files of earlier versions: tied points count as sticking
        assert not tied_points(results, "joint_1").any()
        found = measures.joint_measures(results)["joint_1"]
        assert found["share_open"] == pytest.approx(0.9 if lift else 0.0, abs=1e-12)
        assert joint_area(results) == "2.5 m^2"
        plots.joint_maps(results, "state")
        plots.joint_states(results)
        dj.report.write([old], tmp_path / "old.html")


def _check_tied(results, lift):
    """Arrays, series and measures of a file."""
    tied, areas = tied_points(results, "joint_1"), results.static("joints/joint_1/areas")
    # Four corners of two facets lie at the end, each with a quarter of its facet's 0.25 m2.
    assert tied.sum() == 4
    assert areas[tied].sum() == pytest.approx(0.25, rel=1e-12)
    assert free_areas(results, "joint_1").sum() == pytest.approx(2.25, rel=1e-12)
    for stream in ("states", "statics"):
        status = results.series(stream, "joints/joint_1/status")
        np.testing.assert_array_equal(status == Status.TIED, np.broadcast_to(tied, status.shape))
        traction = results.series(stream, "joints/joint_1/traction")
        np.testing.assert_array_equal(traction[:, tied], 0.0)
    np.testing.assert_array_equal(results.series("histories", "joint_open"), float(lift))
    found = measures.joint_measures(results)["joint_1"]
    assert found["share_open"] == pytest.approx(float(lift), abs=1e-12)
    assert found["share_sliding"] + found["share_frictionless"] == pytest.approx(0.0, abs=1e-12)
    forces = joint_resultants(results, "joint_1")
    np.testing.assert_allclose(forces.contact, 0.0 if lift else 1.0, atol=1e-12)
    stage = measures.static_stages(results)[0].joints["joint_1"]
    assert stage.contact == pytest.approx(0.0 if lift else 1.0, abs=1e-12)
    assert joint_area(results) == "2.5 m^2, 10 % of it tied"
    assert "joint area    2.5 m^2, 10 % of it tied" in overview(results.path)


def _check_pages(results, folder):
    """Exports, maps and the report of a file."""
    tied = tied_points(results, "joint_1")
    np.testing.assert_array_equal(joint_grid(results, "joint_1").cell_data["tied [-]"], tied)
    pytest.importorskip("matplotlib")
    figure = plots.joint_maps(results, "state")
    free, apart = (figure.axes[0].collections[i] for i in (0, 1))
    assert (len(free.get_paths()), len(apart.get_paths())) == (36, 4)
    np.testing.assert_array_equal(free.get_array(), Status.OPEN)
    legend = [text.get_text() for text in figure.axes[-1].get_legend().get_texts()]
    assert legend[-1] == "tied"
    # Tied points do not count as open; here all others are open.
    values = plots.joint_traction(results, "joint_1")
    assert values.get_legend().get_texts()[0].get_text() == "open, 100% of the area"
    page = dj.report.write([results.path], folder / "page.html").read_text(encoding="utf-8")
    assert "2.5 m², 10 % of it tied: at tied points the joint ends inside the body" in page
    write_csv(results, folder / "csv")
    head, row = (folder / "csv" / "joints.csv").read_text(encoding="utf-8").splitlines()[:2]
    values = dict(zip(head.split(","), row.split(","), strict=True))
    assert float(values["share_open [-]"]) == pytest.approx(1.0, rel=1e-12)
    if pytest.importorskip("xarray"):
        states = to_xarray(results, "states")
        np.testing.assert_array_equal(states["tied"].values, tied)


@pytest.mark.parametrize("solver", ["condensed", "monolithic"])
def test_a_block_that_slides_without_friction(comm, new_path, tmp_path, solver):
    """On ground that accelerates by 1 m/s2 for 0.6 s the upper block stays behind by 0.18 m.

    The midpoint rule is exact for the constant acceleration of its centre; the joint follows that
    but for the strain of the block, below rho a L / E times L = 2 um.
    """
    path = new_path("slides.h5")
    model = with_joint(comm, 4.0, dj.frictionless(normal_stiffness=1e11), loads=[dj.Gravity()])
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 0.0, 2.0)}, every=5)
    run = dj.Simulation(model, monitors=[monitor], solver=solver)
    static = run.statics()
    outcome = run.dynamics(dt=0.02, steps=30, motion=lambda _: (-1.0, 0.0, 0.0))
    for joints in (static.joints, outcome.state.joints):
        counts = model.contact.counts(joints.status)
        assert (counts.frictionless, counts.total, counts.tied) == (27, 27, 0)
        assert shares(counts).endswith("0.0 % sliding, 100.0 % closed without friction")
    if comm.rank:
        return
    with dj.Results(path) as results:
        np.testing.assert_array_equal(results.series("histories", "joint_frictionless"), 1.0)
        np.testing.assert_array_equal(results.series("histories", "joint_stick"), 0.0)
        found = measures.joint_measures(results)["joint_1"]
        assert found["slip_max"] == pytest.approx(0.18, abs=1e-5)
        assert found["share_frictionless"] == pytest.approx(1.0, rel=1e-12)
        assert (found["share_sliding"], found["share_open"]) == (0.0, 0.0)
        status = results.series("states", "joints/joint_1/status")
        assert set(np.unique(status)) == {Status.FRICTIONLESS}
        write_csv(results, tmp_path / "csv")
        head, row = (tmp_path / "csv" / "joints.csv").read_text(encoding="utf-8").splitlines()[:2]
        values = dict(zip(head.split(","), row.split(","), strict=True))
        assert float(values["share_frictionless [-]"]) == pytest.approx(1.0, rel=1e-12)
        pytest.importorskip("matplotlib")
        lines = {line.get_label(): line for line in plots.joint_states(results).get_lines()}
        np.testing.assert_array_equal(lines["closed without friction"].get_ydata(), 100.0)
        page = dj.report.write([path], tmp_path / "page.html")
        text = page.read_text(encoding="utf-8")
        assert ">closed without friction [%]</th>" in text
        assert "tied" not in joint_area(results)
