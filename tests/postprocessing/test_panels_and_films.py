# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Panels of joints and films, against the file: numbers, axes, pictures and their times."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image
from reading_back import UNITS
from written_runs import write_run

from dolfinx_joints import animate, plots
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.postprocessing.measures import joint_extremes
from dolfinx_joints.results.reader import Results


@pytest.mark.parametrize("quantity", ["opening", "slip", "pressure"])
def test_a_panel_for_each_joint_with_the_same_axes(tmp_path, quantity):
    with Results(write_run(tmp_path / "r.h5")) as results:
        figure = plots.joint_panels(results, quantity)
        unit = UNITS[re.search(r"\[(.*)\]", figure.get_supylabel())[1]]
        assert figure.get_supylabel().startswith(f"largest {quantity} [")
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
        with pytest.raises(JointsError, match="has 1 states from 0.9 to inf s; a film needs two"):
            animate(results, tmp_path / "film.gif", start=0.9)
        with pytest.raises(JointsError, match=r"ending in .gif or .mp4, got .*film.avi"):
            animate(results, tmp_path / "film.avi")
