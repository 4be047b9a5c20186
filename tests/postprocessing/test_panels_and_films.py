# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Panels of joints and films, against the file: numbers, axes, pictures and their times."""

import re

import numpy as np
import pytest
from declared import declare_states, write_states
from PIL import Image
from reading_back import UNITS
from written_runs import JOINT, NODES, SURFACE, write_run

from dolfinx_joints import animate, plots, views
from dolfinx_joints.common.errors import JointsError, ResultsError
from dolfinx_joints.postprocessing.body import Body, jointed_groups
from dolfinx_joints.postprocessing.measures import joint_extremes
from dolfinx_joints.postprocessing.palette import PERIMETRAL, RED
from dolfinx_joints.results.layout import Cells
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter


@pytest.mark.parametrize("quantity", ["opening", "slip", "pressure", "mean_pressure"])
def test_a_panel_for_each_joint_with_the_same_axes(tmp_path, quantity):
    with Results(write_run(tmp_path / "r.h5")) as results:
        figure = plots.joint_panels(results, quantity)
        unit = UNITS[re.search(r"\[(.*)\]", figure.get_supylabel())[1]]
        words = "mean pressure" if quantity == "mean_pressure" else f"largest {quantity}"
        words += " from the first record" if quantity == "slip" else ""
        assert figure.get_supylabel().startswith(f"{words} [")
        shown = [ax for ax in figure.axes if ax.get_visible()]
        assert len(shown) == len(results.joints)
        assert len({ax.get_ylim() for ax in shown}) == 1
        for ax, joint in zip(shown, results.joints, strict=True):
            found = joint_extremes(results, joint)
            (line,) = ax.get_lines()
            np.testing.assert_array_equal(line.get_xdata(), found.time)
            held = getattr(found, quantity)
            np.testing.assert_allclose(unit * line.get_ydata(), held, rtol=1e-14)
            name, largest, _ = re.split(r": | ", ax.get_title(loc="left"))
            assert name == joint
            assert unit * float(largest) == pytest.approx(held.max(), rel=5e-3, abs=1e-12)
            assert ax.get_ylim()[1] >= line.get_ydata().max()


def test_a_film_has_the_states_between_two_times(tmp_path):
    pytest.importorskip("pyvista")
    with Results(write_run(tmp_path / "r.h5")) as results:
        path = animate(results, tmp_path / "film.gif", per_second=10)
        with Image.open(path) as film:
            assert film.n_frames == results.rows("states") == 3
            assert film.info["duration"] == 100  # ms
            pictures = []
            for k in range(3):
                film.seek(k)
                pictures.append(np.asarray(film.convert("RGB")).astype(int))
        # At rest in the first state, moved by half and by all of it in the others.
        changed = [np.abs(each - pictures[0]).sum() for each in pictures]
        assert changed[0] == 0 < changed[1] < changed[2]
        with pytest.raises(JointsError, match="has 1 states from 0.9 to 1 s; a film needs two"):
            animate(results, tmp_path / "film.gif", start=0.9)
        with pytest.raises(JointsError, match=r"must end in .gif or .mp4, got .*film.avi"):
            animate(results, tmp_path / "film.avi")


def test_chosen_cell_groups_fill_the_picture(tmp_path):
    """Of two cubes of 2 m side by side, one: half as wide; the other is beyond the edge."""
    pytest.importorskip("pyvista")
    cells = Cells(12, [[0, 1, 3, 2, 4, 5, 7, 6], [8, 9, 11, 10, 12, 13, 15, 14]], {"one": [0]})
    path = write_states(tmp_path / "r.h5", NODES, SURFACE, {}, (0.0, {}), cells=cells)
    widths = []
    with Results(path) as results:
        for groups in (None, ["one"]):
            figure = views.deformed(results, groups=groups, azimuths_deg=[0.0], elevation_deg=0.0)
            left, right, _, _ = figure.axes[0].get_images()[0].get_extent()
            widths.append(right - left)
        with pytest.raises(ResultsError, match="No cell group 'two' in .*r.h5; it has one"):
            views.deformed(results, groups=["two"])
    # 4 m and 2 m of body, and a margin of 2 % of the larger side on both sides.
    np.testing.assert_allclose(widths, [4.0 * 1.04, 2.0 * 1.04], rtol=1e-6)


def test_a_joint_to_another_group_is_perimetral(tmp_path):
    """The face of the drawn cube at the joint is concrete with four purple edges, not red."""
    pytest.importorskip("pyvista")
    hexahedra = [[0, 1, 3, 2, 4, 5, 7, 6], [8, 9, 11, 10, 12, 13, 15, 14]]
    cells = Cells(12, hexahedra, {"one": [0], "two": [1]})
    path = tmp_path / "r.h5"
    write_states(path, NODES, SURFACE, {"joint_1": JOINT}, (0.0, {}), cells=cells)
    with Results(path) as results:
        body = Body(results, ["one"])
        assert (len(body.free), len(body.shown), len(body.translucent)) == (5, 6, 5)
        ((edges, colour),) = body._layers
        assert colour == PERIMETRAL
        around = np.stack([body.shown[5], np.roll(body.shown[5], 1)], axis=1)
        np.testing.assert_array_equal(edges, np.unique(np.sort(around, axis=1), axis=0))
        for azimuth in (0.0, 90.0, 180.0, 270.0):
            figure = views.deformed(results, groups=["one"], azimuths_deg=[azimuth])
            image = np.asarray(figure.axes[0].get_images()[0].get_array(), dtype=float)
            assert not (np.abs(image - [178, 24, 43]).max(axis=2) < 30.0).any()
        texts = figure.axes[0].get_legend().get_texts()
        assert [text.get_text() for text in texts] == ["perimetral joints"]
        assert Body(results).legend == {"joints": RED}


def test_a_report_shows_the_groups_that_joints_cut(tmp_path):
    """A joint between two groups cuts none of them, but one to which both of its faces belong."""
    pytest.importorskip("pyvista")
    hexahedra = [[0, 1, 3, 2, 4, 5, 7, 6], [8, 9, 11, 10, 12, 13, 15, 14]]
    found = []
    for number, more in enumerate(({}, {"both": [0, 1]})):
        cells = Cells(12, hexahedra, {"one": [0], "two": [1], **more})
        with ResultsWriter(tmp_path / f"{number}.h5", {}) as writer:
            declare_states(writer, NODES, SURFACE, {"joint_1": JOINT}, cells)
            writer.static("envelopes/nodes", np.arange(16), "-", "nodes")
            writer.series("envelopes", "principal_max", (16,), "Pa", "largest")
            writer.start()
            writer.append("envelopes", 1.0, {"principal_max": 1e6 * np.arange(16)})
            writer.finish("complete", {})
        with Results(tmp_path / f"{number}.h5") as results:
            found.append(jointed_groups(results))
            title = views.envelope(results, "principal_max", groups=["two"]).get_suptitle()
    assert found == [None, ["both"]]
    assert title == "largest principal stress of two: 8.00 to 15.00 MPa"  # of its nodes alone
