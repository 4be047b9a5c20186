# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tractions up a joint: the points met and the values drawn."""

from pathlib import Path

import numpy as np
import pytest
from declared import write_states
from written_runs import JOINT, NODES, POINTS, SURFACE

from dolfinx_joints.postprocessing.joints import surface
from dolfinx_joints.results.reader import Results
from studies.profiles import points_along, traction_profile


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """The joint is pressed and sheared in its lower half, and open above."""
    opened = POINTS[:, 2:] > 1.0
    state = {
        "joints/joint_1/gap": np.where(opened, [3e-3, 0.0, 0.0], [-1e-5, 0.0, 0.0]),
        "joints/joint_1/traction": np.where(opened, 0.0, [-2e6, 1.2e5, -1.6e5]),
    }
    path, laws = tmp_path / "run.h5", {"joint_1": {"friction_angle_deg": 30.0}}
    return Results(write_states(path, NODES, SURFACE, {"joint_1": JOINT}, (0.0, state), laws=laws))


def test_profile_runs_up_one_column_of_points(results: Results) -> None:
    ax = traction_profile(results, "joint_1", position=0.0)
    lines = {str(line.get_label()): line for line in ax.get_lines()}
    normal = lines["normal traction $t_n$, tension $> 0$"]
    np.testing.assert_allclose(normal.get_ydata(), [0.5, 1.5])
    np.testing.assert_allclose(normal.get_xdata(), [-2.0, 0.0])
    shear = lines["tangential traction $|t_s|$"]
    np.testing.assert_allclose(shear.get_xdata(), [0.2, 0.0])
    assert "open" in lines
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("traction [MPa]", "elevation [m]")
    assert "0% of width" in ax.get_title()


def test_profile_of_the_mobilised_friction(results: Results) -> None:
    ax = traction_profile(results, "joint_1", "mobilised", index=0)
    line, opened = ax.get_lines()[:2]
    np.testing.assert_allclose(line.get_ydata(), [0.5, 1.5])
    np.testing.assert_allclose(line.get_xdata(), [0.1 / np.tan(np.radians(30.0)), 0.0])
    assert opened.get_color() == "black"
    np.testing.assert_allclose(opened.get_ydata(), [1.5])
    assert ax.get_xlabel() == "mobilised friction [-]"


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
