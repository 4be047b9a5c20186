# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A panel for each joint: an upright one and one around a valley."""

from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pytest
from declared import write_states
from test_unrolled import FACETS, RADIUS, WIDTH, valley
from written_runs import JOINT, NODES, SURFACE, write_run, write_stages

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.postprocessing.axes import pixels
from dolfinx_joints.postprocessing.joints.figures import JointMaps
from dolfinx_joints.postprocessing.palette import signed_colours
from dolfinx_joints.results.reader import Results

pytest.importorskip("matplotlib")

PRESSED = np.array([-4e6, -2e6, 0.0, 1e6])  # of the upright joint; the third point is open


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """Cubes of 2 m with a joint between them, and a round joint with a point on each facet."""
    corners, normals = valley(70.0)
    frames = np.stack([normals, np.cross(normals, [1.0, 0.0, 0.0]), 0 * normals], axis=1)
    frames[:, 2] = [1.0, 0.0, 0.0]
    chord = 2.0 * RADIUS * np.sin(np.radians(70.0) / FACETS)
    around = {
        "points": corners.mean(axis=1),
        "frames": frames,
        "areas": np.full(FACETS, chord * WIDTH),
        "facet": np.arange(FACETS),
    }
    nodes = np.concatenate([NODES + np.array([0.0, 0.0, 100.0]), corners.reshape(-1, 3)])
    nodes = np.concatenate([nodes, corners.reshape(-1, 3)])  # both sides
    first = len(NODES) + np.arange(4 * FACETS).reshape(-1, 4)
    surface = np.concatenate([SURFACE, first, first + 4 * FACETS])
    upright = JOINT | {"points": JOINT["points"] + np.array([0.0, 0.0, 100.0])}
    record = {
        "joints/joint_1/gap": np.array([[0, 0, 0], [0, 3e-3, 4e-3], [2e-3, 0, 0], [0, 0, 0]]),
        "joints/joint_1/traction": PRESSED[:, None] * [1.0, 0.0, 0.0],
        "joints/joint_around/traction": np.tile([-8e6, 0.0, 0.0], (FACETS, 1)),
    }
    joints = {"joint_1": upright, "joint_around": around}
    path = write_states(tmp_path / "run.h5", nodes, surface, joints, (0.5, record), point_names=[])
    return Results(path)


def test_words_of_six_joints_in_a_row_do_not_meet(tmp_path: Path) -> None:
    names = [f"joint_{i}" for i in range(6)]
    joints = dict.fromkeys(names, JOINT)
    with Results(write_states(tmp_path / "six.h5", NODES, SURFACE, joints, (0.0, {}))) as results:
        figure = plots.joint_maps(results, "opening")
    plots.save(figure, tmp_path / "six.png", dpi=100)
    words = [text for ax in figure.axes for text in ax.texts if text.get_text()]
    assert [word.get_text() for word in words] == 6 * ["upstream", "downstream"]
    boxes = [word.get_window_extent() for word in words]
    assert all(one.x1 < other.x0 for one, other in pairwise(boxes))


def test_each_joint_has_a_panel_with_the_values_of_the_file(results: Results) -> None:
    figure = plots.joint_maps(results, "normal")
    upright, around, bar = figure.axes
    assert [ax.get_title(loc="left") for ax in (upright, around)] == results.joints
    shown = np.ma.filled(upright.collections[0].get_array(), np.nan)
    np.testing.assert_allclose(shown, [-4.0, -2.0, np.nan, 1.0])  # MPa
    np.testing.assert_allclose(around.collections[0].get_array(), -8.0)
    assert bar.get_xlabel() == "normal traction $t_n$ [MPa], tension $> 0$"
    assert bar.get_xlim() == pytest.approx((-8.0, 1.0))
    assert [text.get_text() for text in bar.get_legend().get_texts()] == ["open"]
    assert figure.get_suptitle() == "normal traction at t = 0.500 s"
    cmap = upright.collections[0].get_cmap()
    pressed, pulled = cmap(0.0), cmap(1.0)
    assert pressed[2] > pressed[0]  # blue
    assert pulled[0] > pulled[2]  # red
    assert min(signed_colours((-8.0, 1.0))(8.0 / 9.0)[:3]) > 0.9  # zero is nearly white
    slip = plots.joint_maps(results, "slip")
    np.testing.assert_allclose(slip.axes[0].collections[0].get_array(), [0.0, 5.0, 0.0, 0.0])
    assert slip.axes[2].get_legend() is None  # nothing is open


def test_maps_one_after_the_other_are_those_drawn_alone(results: Results) -> None:
    """Compare the pixels with those of a new figure; each panel is made once."""
    maps = JointMaps(results)
    for quantity, index in (("normal", 0), ("slip", 0), ("opening", 0), ("normal", 0)):
        figure = maps.draw(quantity, None, index)
        alone = plots.joint_maps(results, quantity, index=index)
        assert [len(ax.collections) for ax in figure.axes[:2]] == [2, 2]
        np.testing.assert_array_equal(pixels(figure, 60.0), pixels(alone, 60.0))


def test_upstream_and_downstream_are_named(results: Results) -> None:
    upright, around, _ = plots.joint_maps(results, "opening").axes
    ends = [{t.get_text(): t.xy for t in ax.texts if t.get_text()} for ax in (upright, around)]
    assert ends[0] == {"upstream": (0.0, 0.0), "downstream": (1.0, 0.0)}
    assert ends[1]["upstream"] == (0.5, 1.0)
    assert ends[1]["right bank"] == (0.0, 0.0)
    # The joint in its plane keeps its elevations, the round one has its length along the valley.
    patches = np.concatenate([p.vertices for p in upright.collections[0].get_paths()])
    assert (patches[:, 1].min(), patches[:, 1].max()) == pytest.approx((100.0, 102.0))
    patches = np.concatenate([p.vertices for p in around.collections[0].get_paths()])
    length = FACETS * 2.0 * RADIUS * np.sin(np.radians(70.0) / FACETS)
    np.testing.assert_allclose(np.ptp(patches, axis=0), [length, WIDTH])


def test_a_level_joint_alone_has_its_panel(tmp_path: Path) -> None:
    """The cubes on top of each other; no joint is upright."""
    turn = [0, 2, 1]
    level = JOINT | {"points": JOINT["points"][:, turn], "frames": JOINT["frames"][..., turn]}
    record = {"joints/joint_lift/traction": np.tile([-2e6, 0.0, 0.0], (4, 1))}
    given = (NODES[:, turn], SURFACE, {"joint_lift": level}, (0.0, record))
    with Results(write_states(tmp_path / "level.h5", *given, point_names=[])) as results:
        panel, _ = plots.joint_maps(results, "normal").axes
    assert panel.get_title(loc="left") == "joint_lift"
    np.testing.assert_allclose(panel.collections[0].get_array(), -2.0)  # MPa


def test_a_joint_that_is_a_line_has_no_map(tmp_path: Path) -> None:
    # Two triangles with the side from (0, 0) to (1, 0) in common.
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [0, -1, 0]])
    sides = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3]])
    line = {"points": nodes[:2], "areas": np.full(2, 0.5), "facet": np.zeros(2, dtype=int)}
    line["frames"] = np.tile([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]], (2, 1, 1))
    given = (nodes, sides, {"joint_base": line}, (0.0, {}))
    plane = Results(write_states(tmp_path / "plane.h5", *given, point_names=[]))
    with plane, pytest.raises(ValueError, match="'joint_base' is a line of a plane model"):
        plots.joint_maps(plane)


def test_largest_values_of_files_without_them(tmp_path):
    files = [write_run(tmp_path / f"{n}.h5") for n in ("old", "begun")]
    with h5py.File(files[1], "r+") as file:  # as in a run that is killed
        file["status"][0] = b"running"
        file["streams/joint_maxima/time"] = np.zeros(0)
        file["streams/joint_maxima/joint_1/opening"] = np.zeros((0, 4))
    files.append(write_stages(tmp_path / "stages.h5"))
    for path, status in zip(files, ("complete", "running", "complete"), strict=True):
        text = f"dynamic stage of this version records at its end; the file is {status}"
        with Results(path) as results, pytest.raises(ResultsError, match=text):
            plots.joint_maps(results, "largest_opening")
