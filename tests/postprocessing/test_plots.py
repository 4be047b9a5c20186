# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures: what stands on the axes, of two cubes with a joint between them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from declared import write_states
from written_runs import JOINT, NODES, POINTS, SURFACE, write_run, write_stages

from dolfinx_joints.common.errors import JointsError, ResultsError
from dolfinx_joints.postprocessing import palette, plots
from dolfinx_joints.postprocessing.joints import surface as joint_surface
from dolfinx_joints.results.quantities import ENERGY_TERMS
from dolfinx_joints.results.reader import Results

pytest.importorskip("matplotlib")

from matplotlib.colors import to_rgba
from matplotlib.text import Text

OPEN = POINTS[:, 2] > 1.0  # in the last state


LAW = {"friction_angle_deg": 30.0, "cohesion": 0.0}


@pytest.fixture(scope="module")
def run_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plots") / "run.h5"
    return write_run(path, facts={"laws": {"joint_1": LAW}})


@pytest.fixture
def results(run_path: Path) -> Results:
    return Results(run_path)


def test_history_says_what_it_shows(results: Results, tmp_path: Path) -> None:
    reference = Results(write_run(tmp_path / "behind.h5"))
    ax = plots.history(results, "mid-crest", "x", reference=reference)
    assert ax.get_xlabel() == "time [s]"
    assert ax.get_ylabel() == "displacement x\nfrom the first record [mm]"
    assert ax.get_title(loc="left") == "mid-crest: displacement x, relative to the ground"
    names = [line.get_label() for line in ax.get_lines()]
    assert names == ["behind", "run"]  # names of files
    assert ax.get_xlim() == pytest.approx((0.0, 1.0))
    assert ax.get_legend() is not None
    total = plots.history(results, 0, "z", from_static=False)
    assert total.get_legend() is None
    assert total.get_ylabel() == "displacement z\nfrom the unloaded body [mm]"


@pytest.mark.parametrize("draw", [plots.history, plots.fourier])
def test_titles_are_whole_and_in_front_of_nothing(draw: Any, results: Results) -> None:
    ax = draw(results, "mid-crest", "x", reference=results)
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
        ax = plots.history(own, "mid-crest", "x", reference=behind[0] if behind else None)
        return [str(line.get_label()) for line in ax.get_lines()]

    whole = Results(write_run(tmp_path / "whole.h5", "linear"))
    assert labels(results, whole) == ["linear", "with joints"]
    assert labels(whole, results) == ["with joints", "linear"]
    assert (labels(results), labels(whole)) == (["with joints"], ["linear"])
    # Of two with joints neither is the linear one.
    (tmp_path / "again").mkdir()
    same = Results(write_run(tmp_path / "again" / "run.h5"))
    other = Results(write_run(tmp_path / "other.h5"))
    assert labels(results, other) == ["other", "run"]
    assert labels(results, same) == ["run, reference", "run"]


@pytest.mark.parametrize("quantity", ["normal", "tangential", "mobilised"])
def test_traction_maps_are_grey_where_open(results: Results, quantity: plots.Quantity) -> None:
    ax = plots.joint_traction(results, "joint_1", quantity, time=1.1)
    patches = ax.collections[0]
    patches.update_scalarmappable()
    grey = np.all(patches.get_facecolor() == to_rgba(palette.OPEN), axis=1)
    np.testing.assert_array_equal(grey, OPEN)
    assert ax.get_title() == "joint_1 at t = 1.000 s"
    assert ax.get_legend().get_texts()[0].get_text() == "open, 50% of the area"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("horizontal distance [m]", "elevation [m]")
    colour_bar = ax.figure.axes[-1].get_ylabel()
    assert ("[-]" if quantity == "mobilised" else "[MPa]") in colour_bar
    assert ("tension" in colour_bar) == (quantity == "normal")


def test_patches_tile_the_joint(results: Results) -> None:
    patches = plots.joint_traction(results, "joint_1").collections[0].get_paths()
    corners = [path.vertices[:-1] for path in patches]
    areas = [
        abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2 for x, y in (c.T for c in corners)
    ]
    np.testing.assert_allclose(areas, 1.0)  # 2 m x 2 m over 4 points
    everything = np.concatenate(corners)
    np.testing.assert_allclose(everything.min(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(everything.max(axis=0), 2.0)


def test_a_joint_that_was_never_loaded_is_drawn(tmp_path: Path) -> None:
    path, of = tmp_path / "r.h5", (NODES, SURFACE, {"joint_1": JOINT})
    write_states(path, *of, (0.0, {}), laws={"joint_1": LAW})
    ax = plots.joint_traction(Results(path), "joint_1", "mobilised")
    assert ax.get_legend().get_texts()[0].get_text() == "open, 0% of the area"  # a closed gap of 0


def test_mobilised_friction_needs_friction(tmp_path: Path) -> None:
    path = write_states(tmp_path / "r.h5", NODES, SURFACE, {"joint_1": JOINT}, (0.0, {}))
    with pytest.raises(ResultsError, match="has no friction of the joint 'joint_1'"):
        plots.joint_maps(Results(path), "mobilised")


def test_energies_of_static_stages_alone_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match=r"No stream 'energy' in .*; it has statics"):
        plots.energies(Results(write_stages(tmp_path / "static.h5")))


def test_energies_have_a_unit_that_fits(results: Results) -> None:
    ax = plots.energies(results)
    assert ax.get_ylabel() == "energy [kJ]"
    labels = [str(line.get_label()) for line in ax.get_lines()]
    assert labels[:-1] == list(ENERGY_TERMS[:-1])
    assert labels[-1] == "error, within 1.0e+00 of the largest"


def test_axes_given_are_drawn_on_and_saved(results: Results, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 6.0))
    upper, lower = figure.subplots(2)
    assert plots.history(results, 0, "x", ax=upper) is upper
    assert plots.joint_states(results, ax=lower) is lower
    path = plots.save(figure, tmp_path / "figure.png", dpi=50)
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(JointsError, match=r"figure\.png cannot be written: No such file"):
        plots.save(figure, tmp_path / "nowhere" / "figure.png")
    with pytest.raises(ValueError, match=r"figure is \[.*it must be a figure, as panels"):
        plots.save([upper], tmp_path / "figure.png")
    plots.save(upper.figure, tmp_path / "figure.pdf")
    assert (tmp_path / "figure.pdf").stat().st_size > 1000
    with pytest.raises(ValueError, match="Format '' is not supported"):  # there is no ending
        plots.save(figure, tmp_path / "figure")
    assert {path.name for path in tmp_path.iterdir()} == {"figure.png", "figure.pdf"}


@pytest.mark.parametrize("colour", ["white", "none"])
def test_a_picture_is_drawn_once_with_the_pixels_of_matplotlib(
    results: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, colour: str
) -> None:
    """Compare with ``savefig``, which draws twice; a figure without background stays so."""
    from PIL import Image

    drawn = []
    ax = plots.history(results, "mid-crest", "x")
    ax.figure.set_facecolor(colour)
    draw = ax.draw
    monkeypatch.setattr(ax, "draw", lambda renderer: drawn.append(draw(renderer)))
    own = np.asarray(Image.open(plots.save(ax.figure, tmp_path / "own.png", dpi=70)))
    assert (len(drawn), own.shape[2]) == (1, 3 if colour == "white" else 4)
    assert ax.figure.dpi == 100.0  # as before
    ax.figure.savefig(tmp_path / "other.png", dpi=70)
    other = np.asarray(Image.open(tmp_path / "other.png"))
    np.testing.assert_array_equal(own, other[..., : own.shape[2]])


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
    with pytest.raises(ValueError, match="index must be from -3 to 2 .* got 3"):
        plots.joint_traction(results, "joint_1", index=3)
    with pytest.raises(ResultsError, match="No joint 'joint_9' in .*; it has joint_1"):
        plots.joint_traction(results, "joint_9")
