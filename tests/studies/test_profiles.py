# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tractions up a joint: the points met and the values drawn."""

from pathlib import Path

import numpy as np
import pytest

from dolfinx_joints.postprocessing.joints import surface
from dolfinx_joints.results.reader import Results
from studies.profiles import points_along, traction_profile
from tests.postprocessing.test_plots import MU, joint_arrays, write_run


@pytest.fixture
def results(tmp_path: Path) -> Results:
    return Results(write_run(tmp_path / "run.h5"))


def test_profile_runs_up_one_column_of_points(results: Results) -> None:
    ax = traction_profile(results, "joint_1", position=0.0)
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    normal = lines["normal traction $t_n$, tension $> 0$"]
    height = np.asarray(normal.get_ydata())
    column = joint_arrays()["points"][::2]
    np.testing.assert_allclose(height, column[:, 2])
    expected = np.where(height > 6.0, 0.0, -3.0 * (7.0 - height))
    np.testing.assert_allclose(np.asarray(normal.get_xdata()), expected)
    shear = lines["tangential traction $|t_s|$"]
    assert np.all(np.asarray(shear.get_xdata()) >= 0.0)
    assert "open" in lines
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("traction [MPa]", "elevation [m]")
    assert "0% of width" in ax.get_title()


def test_profile_of_the_ratio_is_one_where_open(results: Results) -> None:
    ax = traction_profile(results, "joint_1", "ratio", index=0)
    line, opened = ax.get_lines()[:2]
    height, ratio = np.asarray(line.get_ydata()), np.asarray(line.get_xdata())
    np.testing.assert_allclose(ratio[height > 6.0], 1.0)
    np.testing.assert_allclose(ratio[(height > 4.0) & (height < 6.0)], -MU)
    np.testing.assert_allclose(ratio[height < 4.0], -0.1)
    assert opened.get_color() == "black"
    np.testing.assert_allclose(np.asarray(opened.get_ydata()), height[height > 6.0])
    assert ax.get_xlabel() == "ratio [-], 1: open"


def test_a_line_up_a_joint_between_inclined_sides_meets_its_column() -> None:
    # Two rows of two facets between x = y and x = 4, each row cut half-way, with a point each: at
    # a tenth and four tenths of the width at any height the line is in the left column.
    def across(share: float, y: float) -> tuple[float, float]:
        return (y + share * (4.0 - y), y)

    plane = surface.JointSurface.__new__(surface.JointSurface)
    plane.facets = np.array(
        [
            [across(a, y), across(a + 0.5, y), across(a + 0.5, y + 1.0), across(a, y + 1.0)]
            for y in (1.0, 0.0)
            for a in (0.0, 0.5)
        ]
    )
    plane.corners, plane.points = plane.facets, plane.facets.mean(axis=1)
    plane.facet_of_point, plane._local = np.arange(4), np.full((4, 2), 0.5)
    for share, expected in ((0.1, [2, 0]), (0.4, [2, 0]), (0.6, [3, 1]), (0.9, [3, 1])):
        assert points_along(plane, share).tolist() == expected
