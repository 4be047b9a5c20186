# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""3-D pictures of a small wall of two blocks with one joint."""

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from declared import declare_states, write_states
from written_runs import WEIGHT, write_stages
from written_runs import write_run as written_run

from dolfinx_joints.common.errors import JointsError, ResultsError
from dolfinx_joints.postprocessing import plots, rendering, views
from dolfinx_joints.postprocessing.joints.surface import map_colours
from dolfinx_joints.postprocessing.palette import signed_colours
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")
pytest.importorskip("pyvista")

SIDE, HEIGHT, THICKNESS, ROWS = 5.0, 8.0, 2.0, 4
RED, BLACK, WHITE = [178, 24, 43], [0, 0, 0], [255, 255, 255]


def block(side: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and outer facets of the block between y = 0 and y = side, one element thick."""
    corners = [(0.0, 0.0), (THICKNESS, 0.0), (THICKNESS, side), (0.0, side)]
    nodes = np.array([[x, y, z] for z in np.linspace(0.0, HEIGHT, ROWS + 1) for x, y in corners])
    around = [[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    facets = [4 * row + np.array(around) for row in range(ROWS)]
    return nodes, np.concatenate([[[0, 1, 2, 3]], [4 * ROWS + np.arange(4)], *facets])


def joint_arrays() -> dict[str, np.ndarray]:
    """Joint in the plane y = 0 with a point in the middle of each of its four facets."""
    z = (np.arange(ROWS) + 0.5) * HEIGHT / ROWS
    frame = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    return {
        "points": np.stack([0 * z + THICKNESS / 2, 0 * z, z], axis=1),
        "frames": np.tile(frame, (ROWS, 1, 1)),
        "areas": np.full(ROWS, THICKNESS * HEIGHT / ROWS),
        "facet": np.arange(ROWS),
    }


LAW = {"friction_angle_deg": np.degrees(np.arctan(0.5)), "cohesion": 0.0}


def write_run(path: Path) -> Path:
    """Two states: at rest, and opened by 4 mm, the topmost facet of the joint without traction.

    The envelope of the principal stress is z MPa/m, missing at the top.
    """
    left, right = block(-SIDE), block(SIDE)
    nodes = np.concatenate([left[0], right[0]])
    surface = np.concatenate([left[1], right[1] + len(left[0])])
    side = np.repeat([-1.0, 1.0], len(left[0]))
    with ResultsWriter(path, {"cells": 8, "laws": {"joint_1": LAW}}) as writer:
        declare_states(writer, nodes, surface, {"joint_1": joint_arrays()})
        status = "joints/joint_1/status"
        writer.series("states", status, (ROWS,), "-", "0 open, 1 sticking, 2 sliding")
        writer.static("envelopes/nodes", np.arange(len(nodes)), "-", "nodes")
        writer.series("envelopes", "principal_max", (len(nodes),), "Pa", "largest")
        writer.start()
        for time in (0.0, 1.0):
            traction = np.array([[-3e6, 3e5, 4e5], [-2e6, 0, 0], [-1e6, 0, 0], [0, 0, 0]])
            gap = time * np.array([[-1e-5, 3e-4, 4e-4], [0, 0, 0], [0, 0, 0], [4e-3, 0, 0]])
            moved = np.stack([0 * side, 2e-3 * time * side, 0 * side], axis=1)
            joint = {"gap": gap, "traction": traction, "status": [2, 1, 1, 0]}
            record = {f"joints/joint_1/{name}": value for name, value in joint.items()}
            writer.append("states", time, {"displacement": moved} | record)
        stress = np.where(nodes[:, 2] < HEIGHT, 1e6 * nodes[:, 2], np.nan)
        writer.append("envelopes", 1.0, {"principal_max": stress})
        writer.finish("complete", {})
    return path


@pytest.fixture(scope="module")
def run_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("views") / "run.h5")


@pytest.fixture
def results(run_path: Path) -> Results:
    return Results(run_path)


@pytest.fixture
def scenes(monkeypatch: pytest.MonkeyPatch) -> list[rendering.Scene]:
    """What was rendered, in the order of the pictures."""
    seen: list[rendering.Scene] = []
    render = rendering.Scene.render

    def spy(scene: rendering.Scene, camera: rendering.Camera) -> np.ndarray:
        seen.append(scene)
        return render(scene, camera, pixels=400)

    monkeypatch.setattr(rendering.Scene, "render", spy)
    return seen


def picture(figure, number: int = 0) -> np.ndarray:
    """Pixels of a picture of a figure, shape (height, width, 3)."""
    return np.asarray(figure.axes[number].get_images()[0].get_array())


def share(image: np.ndarray, colour, within: float = 2.0) -> float:
    """Share of the pixels that have a colour, given as 0 to 255."""
    return float((np.abs(image.astype(float) - colour).max(axis=2) <= within).mean())


# ---------------------------------------------------------------- rendering


def test_a_camera_sees_right_and_up() -> None:
    # From downstream (x towards the eye) y is to the right, from upstream to the left.
    front = rendering.Camera(0.0, 0.0).project(np.eye(3))
    np.testing.assert_allclose(front, [[0, 0], [1, 0], [0, 1]], atol=1e-15)
    back = rendering.Camera(180.0, 0.0).project([0.0, 1.0, 0.0])
    np.testing.assert_allclose(back, [-1.0, 0.0], atol=1e-15)
    above = rendering.Camera(0.0, 90.0).project(np.eye(3))
    np.testing.assert_allclose(above, [[0, -1], [1, 0], [0, 0]], atol=1e-15)


def test_pictures_say_from_where_they_are_taken(results: Results, scenes) -> None:
    # x points downstream, y to the left bank.
    sides = [rendering.Camera(azimuth, 10.0).side for azimuth in (0.0, 90.0, 160.0, 270.0)]
    assert sides == ["downstream", "the left bank", "upstream", "the right bank"]
    assert [rendering.Camera(0.0, e).side for e in (90.0, -90.0)] == ["above", "below"]
    for figure in (views.mesh(results), views.deformed(results, azimuths_deg=(160.0, -25.0))):
        titles = [ax.get_title() for ax in figure.axes[:2]]
        assert titles == ["from upstream", "from downstream"]


def test_a_square_is_where_its_extent_says() -> None:
    scene = rendering.Scene()
    square = np.array([[0.0, 0, 0], [0, 2, 0], [0, 2, 1], [0, 0, 1]])
    scene.surface(square, [[0, 1, 2, 3]], color="#b2182b", lighting=False)
    camera = rendering.Camera(0.0, 0.0)
    left, right, bottom, top = scene.extent(camera)
    np.testing.assert_allclose([left, right, bottom, top], [-0.04, 2.04, -0.04, 1.04])
    image = scene.render(camera, pixels=208)
    assert image.shape == (108, 208, 3)
    rows, columns = np.nonzero(np.abs(image.astype(int) - RED).max(axis=2) <= 2)
    # 100 pixels per metre, a margin of 4; pixels on the edge may be mixed with white.
    found = [rows.min(), rows.max(), columns.min(), columns.max()]
    np.testing.assert_allclose(found, [4, 103, 4, 203], atol=1)
    assert share(image, RED) == pytest.approx(200 * 100 / image[..., 0].size, rel=0.02)


def test_scenes_do_not_show_each_other() -> None:
    """Render a square, another one to its right, and the first again, all in one window."""
    square = np.array([[0.0, 0, 0], [0, 2, 0], [0, 2, 1], [0, 0, 1]])
    second = square + np.array([0.0, 3.0, 0.0])
    pictures = []
    for colour, place in (("#b2182b", square), ("#000000", second), ("#b2182b", square)):
        scene = rendering.Scene(room=np.concatenate([square, second]))
        scene.surface(place, [[0, 1, 2, 3]], color=colour, lighting=False)
        pictures.append(scene.render(rendering.Camera(0.0, 0.0), pixels=200))
    assert share(pictures[0], BLACK) == share(pictures[1], RED) == 0.0
    assert share(pictures[0], RED) == pytest.approx(share(pictures[1], BLACK), rel=0.05)
    np.testing.assert_array_equal(pictures[0], pictures[2])


def test_coincident_points_are_no_outline() -> None:
    # Two unit squares with an edge in common, whose points differ by rounding: 6 edges are left.
    square = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    points = np.concatenate([square, square + np.array([1e-12, 1.0 + 1e-12, 0.0])])
    scene = rendering.Scene()
    scene.edges(points, [[0, 1, 2, 3], [4, 5, 6, 7]])
    assert scene.layers[0][0].n_cells == 6
    scene.edges(points, [])
    assert len(scene.layers) == 1  # no facets, nothing to draw


@pytest.mark.parametrize("lacking", ["pyvista", "vtkmodules"])
def test_without_the_packages_there_is_one_message(
    monkeypatch: pytest.MonkeyPatch, results: Results, lacking: str
) -> None:
    monkeypatch.setitem(sys.modules, lacking, None)
    with pytest.raises(JointsError, match="3-D pictures need pyvista and VTK 9.5 or later"):
        views.mesh(results)


def test_without_anything_to_draw_with_there_is_one_message(
    monkeypatch: pytest.MonkeyPatch, results: Results
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    monkeypatch.setattr(rendering, "_is_loadable", lambda library: False)
    with pytest.raises(JointsError, match="need the library EGL or OSMesa"):
        views.mesh(results)
    monkeypatch.setattr(sys.modules["vtkmodules"], "__version__", "9.3.0")
    with pytest.raises(JointsError, match="need VTK 9.5 or later, got 9.3"):
        views.mesh(results)


@pytest.mark.parametrize("module", ["plots", "views"])
def test_importing_loads_nothing_heavy(module: str) -> None:
    heavy = ("matplotlib", "pyvista", "vtkmodules", "dolfinx")
    code = (
        f"import sys, dolfinx_joints.postprocessing.{module}\n"
        f"print([m for m in {heavy} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# ---------------------------------------------------------------- the pictures


def test_mesh_shows_every_facet_and_the_joint(results: Results, scenes) -> None:
    figure = views.mesh(results)
    body = scenes[0].layers[0][0]
    assert len(results.static("mesh/surface")) == 2 * (2 + 4 * ROWS)
    assert body.n_cells == 2 * (2 + 3 * ROWS)  # those of the joint are inside
    assert body.n_points == len(results.static("mesh/nodes"))
    assert figure.get_suptitle() == "finite-element mesh: 8 cells, 40 nodes, 1 joints"
    assert len(scenes) == 2  # from upstream and from downstream
    for number in range(2):
        image = picture(figure, number)
        assert share(image, RED, within=40.0) > 0.002
        assert 0.1 < share(image, WHITE) < 0.8
    assert "joint_1" in [text.get_text() for text in figure.axes[0].texts]


def test_deformed_opens_the_joint(results: Results, scenes) -> None:
    figure = views.deformed(results, time=1.0, scale=250.0)
    title = figure.get_suptitle()
    assert title.startswith("deformed shape at t = 1.000 s, displacements x 250")
    assert "\nwidest opening 4 mm, joint_1" in title
    outer, lines, sides, _ = (data for data, _ in scenes[0].layers)
    assert (outer.n_cells, sides.n_cells) == (2 * (2 + 3 * ROWS), 2 * ROWS)
    # On the surface the joint of each side has two vertical edges of ROWS facets and two ends.
    assert lines.n_lines == 2 * (2 * ROWS + 2)
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["joints"]
    y = np.unique(np.round(outer.points[np.unique(outer.regular_faces), 1], 6))
    np.testing.assert_allclose(y, [-5.5, -0.5, 0.5, 5.5])  # 250 x 2 mm
    assert share(picture(figure), RED) > 0.005
    np.testing.assert_allclose(outer.point_data["value"], 2.0)  # mm


def test_absolute_displacements_are_drawn_without_those_of_the_base(tmp_path: Path, scenes) -> None:
    """A quarter of a metre is common to all nodes of the file."""
    with Results(written_run(tmp_path / "waves.h5", waves=True)) as waves:
        figure = views.deformed(waves, time=1.0)
        on_crest = views.deformed(waves, time=1.0, relative_to="mid-crest")
    outer = scenes[0].layers[0][0]
    np.testing.assert_allclose(np.unique(outer.point_data["value"]), [0.0, 2.0], atol=1e-9)
    words = figure.axes[-1].get_ylabel().split()
    relative = "relative to the mean of the base"
    assert " ".join(words) == f"displacement [mm] from the unloaded body {relative}"
    # 6 % of the diagonal of 4.9 m over 2 mm is 147, and 100 the round number below it.
    assert "displacements x 100\n" in figure.get_suptitle()
    # The crest is 1.3 mm x sin(2 pi 5.22) from the free surface at that time.
    crest = 1.3 * np.sin(2 * np.pi * 5.22) * np.array([1.0, 0.0, 1.0])
    crest[1:] = 0.4 * np.sin(2 * np.pi * 5.0), 1.3 * np.sin(2 * np.pi * 5.22)
    sizes = [np.linalg.norm(np.array([up, 0, 0]) - crest) for up in (0.0, 2.0)]
    found = np.unique(np.round(scenes[1].layers[0][0].point_data["value"], 6))
    np.testing.assert_allclose(found, sorted(sizes), atol=1e-5)
    assert on_crest.axes[-1].get_ylabel().endswith("relative to mid-crest")


def test_deformed_chooses_a_round_scale(results: Results, scenes) -> None:
    # 6 % of the diagonal sqrt(2^2 + 10^2 + 8^2) = 12.96 m over 2 mm is 389: 200 is below it.
    assert "displacements x 200\n" in views.deformed(results).get_suptitle()
    assert views.deformed(results, index=0).get_suptitle().endswith("displacements x 1")


@pytest.mark.parametrize(
    ("quantity", "expected", "limits", "unit"),
    [
        ("normal", [-3.0, -2.0, -1.0, np.nan], (-3.0, 0.0), "[MPa]"),
        ("tangential", [0.5, 0.0, 0.0, np.nan], (0.0, 0.5), "[MPa]"),
        ("mobilised", [0.5 / 1.5, 0.0, 0.0, np.nan], (0.0, 1.0), "[-]"),
        ("opening", [0.0, 0.0, 0.0, 4.0], (0.0, 4.0), "[mm]"),
        ("slip", [0.5, 0.0, 0.0, 0.0], (0.0, 0.5), "[mm]"),
    ],
)
def test_maps_hold_the_values_of_the_points(
    results: Results, scenes, quantity, expected, limits, unit
) -> None:
    figure = views.joint_map(results, quantity)
    (_, _), (patches, style) = scenes[0].layers
    np.testing.assert_allclose(patches.cell_data["value"], expected, atol=1e-12)
    assert style["clim"] == pytest.approx(limits)
    bar = figure.axes[-1]
    assert unit in bar.get_ylabel()
    assert bar.get_ylim() == pytest.approx(limits)
    # Each point has a quarter of the joint, which faces the eye.
    image = picture(figure)
    low, high = limits
    each = share(image, BLACK) if np.isnan(expected[3]) else 0.0
    cmap = map_colours(quantity, limits)
    for value in np.unique(np.array(expected)[np.isfinite(expected)]):
        colour = 255 * np.array(cmap((value - low) / (high - low))[:3])
        points = np.count_nonzero(np.isclose(expected, value))
        assert share(image, colour) > 0.02 * points
    assert (each > 0.02) == (quantity in ("normal", "tangential", "mobilised"))
    assert (figure.axes[0].get_legend() is not None) == np.isnan(expected[3])  # of what is open


def test_a_joint_turned_to_the_eye_shows_its_width(results: Results, scenes) -> None:
    for turned in (True, False):
        views.joint_map(results, turned=turned, elevation_deg=0.0)
    camera = rendering.Camera(0.0, 0.0)
    seen, edge = (np.ptp(camera.project(s.layers[1][0].points), axis=0) for s in scenes)
    np.testing.assert_allclose(seen, [THICKNESS, HEIGHT])
    np.testing.assert_allclose(edge, [0.0, HEIGHT], atol=1e-12)
    # Upstream, x = 0, is to the left.
    true, turned = scenes[1].layers[1][0].points, scenes[0].layers[1][0].points
    assert camera.project(turned)[true[:, 0] == 0.0][:, 0].max() == pytest.approx(-1.0)


def test_joints_have_the_ends_of_their_names_in_the_picture(tmp_path: Path, scenes) -> None:
    # The second is the level foot of the block: no axis is upright, and it is not turned.
    path, arrays = tmp_path / "two.h5", joint_arrays()
    level = {
        "points": np.array([[THICKNESS / 2, SIDE / 2, 0.0]]),
        "frames": np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]),
        "areas": np.array([THICKNESS * SIDE]),
        "facet": np.array([0]),
    }
    nodes, surface = block(SIDE)
    joints = {"joint_base": level, "joint_1": {**arrays, "facet": np.arange(2, 4 * ROWS, 4)}}
    with Results(write_states(path, nodes, surface, joints, (0.0, {}))) as results:
        figure = views.joint_map(results, "opening")
        views.joint_map(results, "opening", turned=False)
    assert {"1", "base"} <= {text.get_text() for text in figure.axes[0].texts}
    moved, still = ([data.points for data, _ in scene.layers[1:]] for scene in scenes)
    np.testing.assert_array_equal(moved[1], still[1])
    # A quarter turn about its middle, towards the eye on the x axis.
    np.testing.assert_allclose(np.ptp(still[0], axis=0), [THICKNESS, 0.0, HEIGHT])
    np.testing.assert_allclose(np.ptp(moved[0], axis=0), [0.0, THICKNESS, HEIGHT], atol=1e-12)


@pytest.mark.parametrize("quantity", ["normal", "opening"])
def test_pictures_of_slender_bodies_are_not_long(tmp_path: Path, scenes, quantity) -> None:
    """A column of 2 x 2 x 40 m with a level joint: 1.4 times as high as wide, words in place."""
    nodes, surface = block(SIDE)
    nodes *= [1.0, 0.4, 5.0]
    frame = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    arrays = {"points": [[1.0, 1.0, 0.0]], "frames": [frame], "areas": [4.0], "facet": [0]}
    path, opened = tmp_path / "column.h5", {"joints/lift/gap": np.array([[1e-3, 0.0, 0.0]])}
    with Results(write_states(path, nodes, surface, {"lift": arrays}, (0.0, opened))) as results:
        figure = views.joint_map(results, quantity)
    width, height = figure.get_size_inches()
    assert height == pytest.approx(1.4 * width)
    widest = "\nwidest opening 1 mm, lift" if quantity == "opening" else ""
    assert figure.get_suptitle() == f"joints at t = 0.000 s{widest}"  # nothing was turned
    plots.save(figure, tmp_path / "column.png", dpi=100)
    words = [text for text in figure.axes[0].texts if text.get_text()]  # an arrow has none
    legend = figure.axes[0].get_legend()
    boxes = [each.get_window_extent() for each in (*words, legend) if each]
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


def test_states_are_those_of_the_file(results: Results, scenes) -> None:
    figure = views.joint_map(results, "state", joint="joint_1")
    np.testing.assert_array_equal(scenes[0].layers[1][0].cell_data["value"], [2, 1, 1, 0])
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == ["open", "sticking", "sliding", "closed without friction"]
    shares = [share(picture(figure), c) for c in ([150, 150, 150], [158, 202, 225], [230, 85, 13])]
    assert shares[1] > 1.5 * shares[0] > 0.0
    assert shares[2] > 0.5 * shares[0]


def test_pictures_of_a_static_stage(tmp_path: Path, scenes) -> None:
    """By its name, with its values: the pressed joint, the cube that moved, the joint half open."""
    with Results(write_stages(tmp_path / "stages.h5")) as results:
        figure = views.joint_map(results, "normal", stage=WEIGHT)
        assert figure.get_suptitle().startswith(
            f"joints after {WEIGHT}\neach upright joint rotated"
        )
        np.testing.assert_allclose(scenes[-1].layers[1][0].cell_data["value"], -2.0)  # MPa
        figure = views.deformed(results, stage="winter", scale=100.0)
        assert figure.get_suptitle().startswith("deformed shape after winter, displacements x 100")
        body = scenes[-1].layers[0][0]
        assert body.points[:, 1].max() == pytest.approx(2.0 + 100.0 * 2e-3)
        np.testing.assert_allclose(np.unique(body.point_data["value"]), [0.0, 2.0])  # mm
        views.joint_map(results, "opening")  # the last stage, as there are no other states
        np.testing.assert_allclose(scenes[-1].layers[1][0].cell_data["value"], [0, 0, 3, 3])
        with pytest.raises(ValueError, match=r"a time or a stage, not both; got time=0.1, stage=0"):
            plots.joint_traction(results, "joint_1", stage=0, time=0.1)
        ax = plots.joint_traction(results, "joint_1", stage=0)
        assert ax.get_title() == f"joint_1 after {WEIGHT}"
        with pytest.raises(ResultsError, match="No static stage 'summer'"):
            views.deformed(results, stage="summer")


def test_envelope_has_the_range_of_its_data(results: Results, scenes) -> None:
    figure = views.envelope(results, "principal_max")
    data, style = scenes[0].layers[0]
    assert data.n_cells == 2 * (2 + 3 * ROWS)
    assert style["clim"] == pytest.approx((0.0, 6.0))  # the top, at 8 m, is missing
    assert np.isnan(data.point_data["value"]).sum() == 8
    assert figure.get_suptitle() == "largest principal stress: 0.00 to 6.00 MPa"
    lowest = 255 * np.array(signed_colours((0.0, 6.0))(0.0)[:3])
    for number in range(2):
        assert share(picture(figure, number), lowest, within=12.0) > 0.01
        assert share(picture(figure, number), WHITE) < 0.8


def test_wrong_requests_have_a_message(results: Results, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="groups is 'dam'; it must be a list of names"):
        views.mesh(results, groups="dam")
    with pytest.raises(ResultsError, match="No series 'arch_max'"):
        views.envelope(results, "arch_max")
    plane = write_states(tmp_path / "plane.h5", np.zeros((2, 3)), [[0, 1]], {})
    with pytest.raises(ResultsError, match="mesh/cell"):  # written without its cells
        views.mesh(Results(plane))
    with ResultsWriter(tmp_path / "whole.h5", {}) as writer:
        nodes, surface = block(SIDE)
        declare_states(writer, nodes, surface, {})
        writer.static("envelopes/nodes", np.arange(len(nodes)), "-", "nodes")
        writer.series("envelopes", "principal_max", (len(nodes),), "Pa", "largest")
        writer.start()
        writer.append("states", 0.0, {"displacement": np.zeros_like(nodes)})
        writer.append("envelopes", 0.0, {"principal_max": np.full(len(nodes), np.nan)})
    with pytest.raises(ValueError, match=r"whole\.h5 has no joints to draw"):
        views.joint_map(Results(tmp_path / "whole.h5"))
    with pytest.raises(ValueError, match="There is nothing to draw: all values are missing"):
        views.envelope(Results(tmp_path / "whole.h5"))
