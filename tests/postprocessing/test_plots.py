# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures: what stands on the axes of a small wall of two blocks with one joint."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from declared import declare_energy, declare_histories, declare_states, write_states
from written_runs import SHARES

from dolfinx_joints.common.errors import JointsError, ResultsError
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.postprocessing.joints import surface as joint_surface
from dolfinx_joints.results.quantities import ENERGY_TERMS
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")

from matplotlib.text import Text

MU = np.tan(np.deg2rad(30.0))
HEIGHT, THICKNESS, ROWS = 8.0, 2.0, 4
FREQUENCY = 5.0


def block(side: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and outer facets of the block between y = 0 and y = side, one element thick."""
    corners = np.array([[0.0, 0.0], [THICKNESS, 0.0], [THICKNESS, side], [0.0, side]])
    z = np.linspace(0.0, HEIGHT, ROWS + 1)
    nodes = np.array([[x, y, height] for height in z for x, y in corners])
    facets = [[0, 1, 2, 3], [4 * ROWS + i for i in range(4)]]
    for row in range(ROWS):
        for i in range(4):
            j = (i + 1) % 4
            facets.append([4 * row + i, 4 * row + j, 4 * row + 4 + j, 4 * row + 4 + i])
    return nodes, np.array(facets)


def joint_arrays() -> dict[str, np.ndarray]:
    """Joint in the plane y = 0 with 2 x 2 Gauss points on each of its facets."""
    gauss = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    points = [
        [u * THICKNESS, 0.0, (row + v) * HEIGHT / ROWS]
        for row in range(ROWS)
        for v in gauss
        for u in gauss
    ]
    frame = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    return {
        "points": np.array(points),
        "frames": np.tile(frame, (len(points), 1, 1)),
        "areas": np.full(len(points), THICKNESS * HEIGHT / len(points)),
        "facet": np.repeat(np.arange(ROWS) * 7 + 3, 4),  # any integers will do
    }


def tractions(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gap and traction: open above z = 6, sliding from 4 to 6, sticking below."""
    z = points[:, 2]
    normal = np.where(z > 6.0, 0.0, -1e6 * (7.0 - z))
    shear = np.where(z > 4.0, MU, 0.1) * -normal
    gap = np.stack([np.where(z > 6.0, 1e-3, normal / 1e11), 0 * z, 0 * z], axis=1)
    return gap, np.stack([normal, 0.6 * shear, -0.8 * shear], axis=1)


def write_run(path: Path, amplitude: float = 0.02) -> Path:
    """Write a run of 4 s whose crest moves in a sine of 5 Hz around -1 mm."""
    left, right = block(-5.0), block(5.0)
    nodes = np.concatenate([left[0], right[0]])
    surface = np.concatenate([left[1], right[1] + len(left[0])])
    joint = joint_arrays()
    gap, traction = tractions(joint["points"])
    time = np.arange(800) * 0.005
    with ResultsWriter(path, {"point_names": ["base", "crest"]}) as writer:
        declare_histories(writer, [[1.0, 0.0, 0.0], [1.0, 0.0, HEIGHT]])
        declare_energy(writer)
        declare_states(writer, nodes, surface, {"joint_1": joint})
        writer.start()
        for t in time:
            wave = amplitude * np.sin(2 * np.pi * FREQUENCY * t)
            record = {"displacement": [[0, 0, 0], [wave - 1e-3, 0.0, -1e-3]], "iterations": 3}
            shares = dict(zip(SHARES, (0.25, 0.5, 0.25, 0.0), strict=True))
            writer.append("histories", t, record | shares)
            energy = dict.fromkeys(ENERGY_TERMS, 2e6 * wave / amplitude) | {"error": 2e-3}
            writer.append("energy", t, energy)
        for t in (0.0, 2.0):
            shift = np.where(nodes[:, 1:2] + np.repeat([-1, 1], len(left[0]))[:, None] > 0, 1, -1)
            moved = np.hstack([0 * shift, 1e-3 * t * shift, 0 * shift])
            values = {"joints/joint_1/gap": gap, "joints/joint_1/traction": (1 + t) * traction}
            writer.append("states", t, {"displacement": moved} | values)
        writer.finish("complete", {})
    return path


@pytest.fixture(scope="module")
def run_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("plots") / "run.h5")


@pytest.fixture
def results(run_path: Path) -> Results:
    return Results(run_path)


def test_history_is_in_millimetres_with_its_reference(results: Results, tmp_path: Path) -> None:
    reference = Results(write_run(tmp_path / "linear.h5", amplitude=0.01))
    ax = plots.history(results, "crest", "x", reference=reference)
    assert ax.get_xlabel() == "time [s]"
    assert ax.get_ylabel() == "displacement x [mm]"
    assert ax.get_title(loc="left") == "crest: displacement x, relative to the ground"
    behind, own = ax.get_lines()
    assert [line.get_label() for line in (behind, own)] == ["linear", "run"]  # names of files
    assert np.max(own.get_ydata()) == pytest.approx(19.0)
    assert np.max(behind.get_ydata()) == pytest.approx(9.0)
    assert ax.get_xlim() == pytest.approx((0.0, 3.995))
    assert ax.get_legend() is not None
    assert plots.history(results, 0, "z").get_legend() is None


@pytest.mark.parametrize("draw", [plots.history, plots.fourier])
def test_titles_are_whole_and_in_front_of_nothing(draw: Any, results: Results) -> None:
    ax = draw(results, "crest", "x", reference=results)
    ax.figure.draw_without_rendering()
    (title,) = (
        child
        for child in ax.get_children()
        if isinstance(child, Text) and child.get_text() == ax.get_title(loc="left")
    )
    place = title.get_window_extent()
    assert 0.0 < place.x0 < place.x1 < ax.figure.bbox.x1
    assert place.y1 < ax.figure.bbox.y1
    assert not place.overlaps(ax.get_legend().get_window_extent())


def test_runs_are_called_by_what_they_are(results: Results, tmp_path: Path) -> None:
    def labels(*runs: Results) -> list[str]:
        own, *behind = runs
        ax = plots.history(own, "crest", "x", reference=behind[0] if behind else None)
        return [str(line.get_label()) for line in ax.get_lines()]

    with ResultsWriter(tmp_path / "whole.h5", {"point_names": ["crest"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 8.0]])
        writer.start()
        for t in (0.0, 1.0):
            shares = dict.fromkeys(SHARES, 0)
            writer.append(
                "histories", t, {"displacement": np.zeros((1, 3)), "iterations": 1} | shares
            )
    whole = Results(tmp_path / "whole.h5")
    assert labels(results, whole) == ["linear", "with joints"]
    assert labels(whole, results) == ["with joints", "linear"]
    assert (labels(results), labels(whole)) == (["with joints"], ["linear"])
    # Of two with joints neither is the linear one.
    (tmp_path / "again").mkdir()
    same = Results(write_run(tmp_path / "again" / "run.h5"))
    other = Results(write_run(tmp_path / "other.h5"))
    assert labels(results, other) == ["other", "run"]
    assert labels(results, same) == ["run, reference", "run"]


@pytest.mark.parametrize("quantity", ["normal", "tangential", "ratio"])
def test_traction_maps_show_values_and_black_where_open(
    results: Results, quantity: plots.Quantity
) -> None:
    ax = plots.joint_traction(results, "joint_1", quantity, time=2.1)
    patches = ax.collections[0]
    z = joint_arrays()["points"][:, 2]
    patches.update_scalarmappable()
    black = np.all(patches.get_facecolor()[:, :3] == 0.0, axis=1)
    np.testing.assert_array_equal(black, z > 6.0)
    normal = -3.0 * (7.0 - z)  # MPa; the record at 2 s has three times the traction
    shear = np.where(z > 4.0, MU, 0.1) * -normal
    expected = {"normal": normal, "tangential": shear, "ratio": -np.where(z > 4.0, MU, 0.1)}
    shown = np.ma.filled(patches.get_array(), np.nan)
    np.testing.assert_allclose(shown[z < 6.0], expected[quantity][z < 6.0])
    assert ax.get_title() == "joint_1 at t = 2.000 s"
    assert ax.get_legend().get_texts()[0].get_text() == "open, 25% of the area"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("horizontal distance [m]", "elevation [m]")
    colour_bar = ax.figure.axes[-1].get_ylabel()
    assert ("[-]" if quantity == "ratio" else "[MPa]") in colour_bar
    assert ("tension" in colour_bar) == (quantity == "normal")


def test_patches_tile_the_joint(results: Results) -> None:
    patches = plots.joint_traction(results, "joint_1").collections[0].get_paths()
    corners = [path.vertices[:-1] for path in patches]
    areas = [
        abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 for x, y in (c.T for c in corners)
    ]
    np.testing.assert_allclose(areas, 1.0)  # 2 m x 8 m over 16 points
    everything = np.concatenate(corners)
    np.testing.assert_allclose(everything.min(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(everything.max(axis=0), [THICKNESS, HEIGHT])


def test_a_joint_that_was_never_loaded_is_drawn(tmp_path: Path) -> None:
    joint = joint_arrays()
    nodes, surface = block(5.0)
    path = write_states(tmp_path / "r.h5", nodes, surface, {"joint_1": joint}, (0.0, {}))
    results = Results(path)
    ax = plots.joint_traction(results, "joint_1", "ratio")
    assert ax.get_legend().get_texts()[0].get_text() == "open, 0% of the area"  # a closed gap of 0


def test_energies_have_a_unit_that_fits(results: Results) -> None:
    ax = plots.energies(results)
    assert ax.get_ylabel() == "energy [MJ]"
    labels = [str(line.get_label()) for line in ax.get_lines()]
    assert labels[:-1] == list(ENERGY_TERMS[:-1])
    assert labels[-1] == "error, within 1.0e-09 of the largest"
    assert np.max(ax.get_lines()[0].get_ydata()) == pytest.approx(2.0)


def test_axes_given_are_drawn_on_and_saved(results: Results, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 6.0))
    upper, lower = figure.subplots(2)
    assert plots.history(results, 1, "x", ax=upper) is upper
    assert plots.joint_states(results, ax=lower) is lower
    path = plots.save(figure, tmp_path / "figure.png", dpi=50)
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(JointsError, match=r"figure\.png cannot be written: No such file"):
        plots.save(figure, tmp_path / "nowhere" / "figure.png")
    plots.save(upper.figure, tmp_path / "figure.pdf")
    assert (tmp_path / "figure.pdf").stat().st_size > 1000
    with pytest.raises(ValueError, match="Format '' is not supported"):  # there is no ending
        plots.save(figure, tmp_path / "figure")
    assert {path.name for path in tmp_path.iterdir()} == {"figure.png", "figure.pdf"}


@pytest.mark.parametrize(
    ("normal", "across", "up", "label"),
    [
        ([0, 1, 0], [1, 0, 0], [0, 0, 1], "elevation [m]"),
        ([0, -1, 0], [1, 0, 0], [0, 0, 1], "elevation [m]"),
        ([1, 0, 0], [0, 1, 0], [0, 0, 1], "elevation [m]"),
        ([0, 0.6, 0.8], [1, 0, 0], [0, -0.8, 0.6], "distance up the joint [m]"),
        ([0, 0, 1], [1, 0, 0], [0, 1, 0], "distance across the valley [m]"),
        ([0, 0, -1], [1, 0, 0], [0, 1, 0], "distance across the valley [m]"),
    ],
)
def test_axes_in_the_plane(
    normal: list[float], across: list[float], up: list[float], label: str
) -> None:
    axes, labels = joint_surface._plane_axes(np.array(normal, dtype=float))
    np.testing.assert_allclose(axes, [across, up], atol=1e-12)
    assert labels[1] == label


def test_wrong_requests_have_a_message(results: Results) -> None:
    with pytest.raises(ValueError, match="one of 2 recorded states, got 2"):
        plots.joint_traction(results, "joint_1", index=2)
    with pytest.raises(ResultsError, match="No joint 'joint_9' in .*; it has joint_1"):
        plots.joint_traction(results, "joint_9")
