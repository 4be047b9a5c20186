# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of a plane run: two blocks, 1 m wide and 2 m high, with a joint at half of the height.

The lower block is fixed; the upper one is pulled sideways over its base.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("matplotlib")
pytest.importorskip("pyvista")

from mpi4py import MPI

from dolfinx import mesh as dm

import dolfinx_joints as dj
from dolfinx_joints.postprocessing import plots, rendering, views
from dolfinx_joints.postprocessing.joints.figures import PROFILES, along
from dolfinx_joints.postprocessing.joints.surface import map_value

COLUMNS = 4


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    path = tmp_path_factory.mktemp("plane") / "plane.h5"
    mesh = dm.create_rectangle(
        MPI.COMM_SELF, [[0.0, 0.0], [1.0, 2.0]], [COLUMNS, 8], cell_type=dm.CellType.quadrilateral
    )
    mesh.topology.create_connectivity(1, 2)
    facets = {
        name: dm.locate_entities(mesh, 1, lambda x, at=at: np.isclose(x[1], at))
        for name, at in (("base", 0.0), ("joint", 1.0))
    }
    body = dj.split_mesh(mesh, joints={"joint": facets["joint"]}, groups={"base": facets["base"]})
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=30.0)
    solid = dj.Elastic(young=1e9, poisson=0.2, density=2000.0)
    rock = dj.Fixed(group="base")
    model = dj.Model(body, material=solid, joints=law, supports=[rock], loads=[dj.Gravity()])
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 2.0)}, every=1, envelopes=True)
    run = dj.Simulation(model, monitors=[monitor])
    run.statics()
    run.dynamics(dt=5e-3, steps=20, motion=lambda t: (8.0 * np.sin(30.0 * t), 0.0, 0.0))
    return dj.Results(path)


@pytest.fixture
def scenes(monkeypatch):
    """The scenes that are rendered, with the camera of each."""
    seen = []
    render = rendering.Scene.render

    def kept(scene, camera, **options):
        seen.append((scene, camera))
        return render(scene, camera, **options)

    monkeypatch.setattr(rendering.Scene, "render", kept)
    return seen


def test_cells_fill_the_picture_with_y_upwards(results, scenes):
    figure = views.mesh(results)
    (scene, camera), nodes = scenes[0], results.static("mesh/nodes")
    np.testing.assert_allclose(camera.project(nodes), nodes[:, :2], atol=1e-15)
    cells = scene.layers[0][0]
    assert cells.n_cells == COLUMNS * 8
    assert cells.area == pytest.approx(2.0)
    assert "32 cells" in figure.get_suptitle()
    assert len(figure.axes) == 1  # one viewpoint, whatever the azimuths
    assert figure.axes[0].get_title() == ""  # not "from above"
    letters = {text.get_text() for text in figure.axes[0].texts}
    assert {"x", "y", "joint"} <= letters
    assert "z" not in letters


def test_deformed_cells_and_both_sides_of_the_joint(results, scenes):
    figure = views.deformed(results, index=7, scale=50.0)
    u = results.series("states", "displacement")
    layers, moved = scenes[0][0].layers, u[7]
    positions = results.static("mesh/nodes") + 50.0 * moved
    np.testing.assert_allclose(layers[0][0].points, positions)
    size = layers[0][0].point_data["value"]
    np.testing.assert_allclose(size, 1e3 * np.linalg.norm(moved, axis=1))
    lines = [data for data, style in layers if data.n_lines and style.get("line_width") == 5.0]
    assert lines[0].n_lines == 2 * COLUMNS
    assert "displacements x 50" in figure.get_suptitle()
    words = " ".join(figure.axes[-1].get_ylabel().split())
    assert words == "displacement [mm] from the unloaded body relative to the ground"
    since = views.deformed(results, index=7, scale=50.0, from_static=True)
    assert "from the static state" in since.axes[-1].get_ylabel()
    drawn = scenes[1][0].layers[0][0].points - results.static("mesh/nodes")
    np.testing.assert_allclose(drawn, 50.0 * (u[7] - u[0]), atol=1e-12)


def test_envelopes_are_drawn_in_the_whole_body(results, scenes):
    views.envelope(results, "cantilever_min")
    values = scenes[0][0].layers[0][0].point_data["value"]
    cells = results.static("mesh/cells")[:, :4]
    assert np.isfinite(values[np.unique(cells)]).all()
    stored = results.series("envelopes", "cantilever_min", -1)
    np.testing.assert_allclose(values[results.static("envelopes/nodes")], 1e-6 * stored)
    with pytest.raises(ValueError, match="all values are missing"):
        views.envelope(results, "arch_max")  # there is no arch direction in the plane


def test_profiles_are_the_values_of_the_file(results):
    figure = plots.joint_profiles(results, index=7)
    x = results.static("joints/joint/points")[:, 0]
    order = np.argsort(x)
    for ax, quantity in zip(figure.axes, PROFILES, strict=True):
        (line,) = ax.lines
        np.testing.assert_allclose(line.get_xdata(), x[order] - x.min(), atol=1e-12)
        expected = map_value(results, "joint", quantity, 7)[order]
        np.testing.assert_array_equal(line.get_ydata(), expected)
    units = [ax.get_ylabel().split("[")[1].split("]")[0] for ax in figure.axes]
    assert units == ["MPa", "MPa", "mm", "mm"]
    assert figure.axes[-1].get_xlabel() == "distance along the joint [m]"
    time = results.time("states")[7]
    assert figure.axes[0].get_title(loc="left") == f"values along the joints at t = {time:.3f} s"
    stage = plots.joint_profiles(results, stage=-1)
    weight = -1e-6 * 2000.0 * 9.80665  # 1 m^2 of the upper block per m of joint [MPa]
    x, normal = stage.axes[0].lines[0].get_data()
    assert np.trapezoid(normal, x) == pytest.approx(weight, rel=0.02)  # ends at the outer nodes


def test_distances_along_an_inclined_joint():
    # A line from (3, 4) to (0, 0), 5 m long, whose points are not sorted.
    share = np.array([0.2, 1.0, 0.6])
    points = np.stack([3.0 * share, 4.0 * share, 0.0 * share], axis=1)
    order, distance = along(points)
    np.testing.assert_array_equal(order, [0, 2, 1])
    np.testing.assert_allclose(distance, [0.0, 2.0, 4.0])


def test_distances_along_a_shear_key():
    # Down the wall of a key, 1 m wide and 1 m deep, along its bottom, and up: 3 m in all.
    places = [(0.0, 1.0), (0.0, 0.5), (0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0)]
    points = np.array([(x, y, 0.0) for x, y in places])
    mixed = [3, 6, 0, 5, 2, 4, 1]
    order, distance = along(points[mixed])
    assert sorted([np.array(mixed)[order].tolist(), np.arange(7).tolist()])[0] == [*range(7)]
    np.testing.assert_allclose(distance, 0.5 * np.arange(7))


def test_maps_and_profiles_name_each_other(results):
    with pytest.raises(ValueError, match="line of a plane model and has no map; plots.joint_prof"):
        plots.joint_maps(results)
