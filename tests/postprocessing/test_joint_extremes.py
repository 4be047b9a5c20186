# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Openings, slips and safety of joints over time: curved joints by hand, from written files."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from declared import declare_states

from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.tables import tables_of, write_csv
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants, resultant_measures
from dolfinx_joints.postprocessing.joints.surface import map_value
from dolfinx_joints.results.layout import declare
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

MU, COHESION = math.tan(math.radians(40.0)), 2e5


def write_joint(
    path: Path, normals: Any, tractions: Any, *, broken: Any = None, angle: float = 40.0
) -> Path:
    """One state of points of 1 m^2 with horizontal s1 = y, as along the axis of a valley."""
    n = np.asarray(normals, dtype=float)
    along = np.broadcast_to([0.0, 1.0, 0.0], n.shape)
    frames = np.stack([n, along, np.cross(n, along)], axis=1)
    joint = {"points": n, "frames": frames, "areas": np.ones(len(n)), "facet": np.arange(len(n))}
    law = {"friction_angle_deg": angle, "cohesion": 0.0 if broken is None else COHESION}
    with ResultsWriter(path, {"laws": {"base": law}}) as writer:
        declare_states(writer, n, [[0, 1, 1]], {"base": joint})
        if broken is not None:
            writer.series("states", "joints/base/broken", (len(n),), "-", "", dtype=np.int8)
        writer.start()
        state = {
            "displacement": np.zeros_like(n),
            "joints/base/gap": np.zeros_like(n),
            "joints/base/traction": np.asarray(tractions, dtype=float),
        }
        writer.append(
            "states", 0.0, state if broken is None else state | {"joints/base/broken": broken}
        )
        writer.finish("complete", {})
    return path


def test_wedge(tmp_path):
    # A block in a symmetric V, whose faces of 1 m^2 are tilted by b, under the weight W and pulled
    # by H along the line where they meet: each face is pressed by N = W / (2 cos b) and sheared by
    # H / 2, so that the block slides where H = 2 mu N, the textbook's safety mu W / (H cos b). The
    # mean normal is vertical: its resultants make mu W / H of it, too little by cos b = 0.625.
    b, weight, pull = math.acos(0.625), 1e6, 0.92e6
    normals = [[math.sin(b), 0.0, math.cos(b)], [-math.sin(b), 0.0, math.cos(b)]]
    pressed = [-weight / (2.0 * math.cos(b)), -pull / 2.0, 0.0]
    with Results(write_joint(tmp_path / "r.h5", normals, [pressed, pressed])) as results:
        found = joint_resultants(results, "base")
        np.testing.assert_allclose(found.force[0], [0.0, pull, weight], rtol=1e-12)
        expected = MU * weight / (pull * math.cos(b))
        assert found.sliding_safety[0] == pytest.approx(expected, rel=1e-12)
        assert MU * found.normal_force / found.shear_force == pytest.approx(0.625 * expected)
        assert measures.joint_extremes(results, "base").safety == pytest.approx([expected])
        # What refers to the mean normal says so, or is not there: flatness is cos b.
        assert found.geometry.flatness == pytest.approx(0.625, rel=1e-12)
        assert "curved (flatness 0.62)" in found.geometry.warning
        assert np.isnan(found.plane_safety).all()
        assert np.isnan(found.line_of_action).all()
        assert resultant_measures(results)["base"]["flatness"] == pytest.approx(0.625)
        tables = {path.stem: path for path in write_csv(results, tmp_path)}
    with tables["resultants"].open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["flatness [-]"]) == pytest.approx(0.625)
    assert float(row["sliding safety [-]"]) == pytest.approx(expected)
    assert row["sliding safety of the resultants [-]"] == "nan"


def test_closed_cylinder(tmp_path):
    # A plug under the pressure p all around, turned about its axis and sheared by s everywhere: no
    # resultant force at all, and a safety of mu p / s.
    angle = np.arange(36) * 2.0 * np.pi / 36
    normals = np.stack([np.cos(angle), np.zeros(36), np.sin(angle)], axis=1)
    path = write_joint(tmp_path / "r.h5", normals, np.tile([-3e6, 0.0, 1e6], (36, 1)))
    with Results(path) as results:
        found = joint_resultants(results, "base")
        assert found.sliding_safety[0] == pytest.approx(3.0 * MU, rel=1e-12)
        assert found.geometry.flatness == pytest.approx(0.0, abs=1e-12)
        assert "curved" in found.geometry.warning


def test_plane_joint(tmp_path):
    # Sheared in one direction both safeties are one, (mu N + c A) / V: A two bonds of three, one of
    # them in tension, which takes its part off N. Sheared to and fro the resultants see nothing.
    level = np.tile([0.0, 0.0, 1.0], (3, 1))
    t = [[-4e6, 3e5, 4e5], [-1e6, 6e5, 8e5], [1e5, 0.0, 0.0]]
    path = write_joint(tmp_path / "r.h5", level, t, broken=[1, 0, 0])
    with Results(path) as results:
        found = joint_resultants(results, "base")
        expected = (MU * 4.9e6 + 2.0 * COHESION) / 1.5e6
        assert found.sliding_safety[0] == pytest.approx(expected, rel=1e-12)
        assert found.plane_safety[0] == pytest.approx(expected, rel=1e-12)
        assert not found.geometry.warning
        assert measures.joint_measures(results)["base"]["share_broken"] == pytest.approx(1 / 3)
        # By hand: 0.5 / (4 mu), 1 / (mu + c) and no shear; of the joint 1 / safety.
        used = [0.5e6 / (4e6 * MU), 1e6 / (1e6 * MU + COHESION), 0.0]
        np.testing.assert_allclose(map_value(results, "base", "mobilised", 0), used, rtol=1e-12)
        history = measures.joint_extremes(results, "base").mobilised
        assert history == pytest.approx([1.0 / expected], rel=1e-12)
    path = write_joint(tmp_path / "s.h5", level[:2], [[-1e6, 5e5, 0.0], [-1e6, -5e5, 0.0]])
    with Results(path) as results:
        found = joint_resultants(results, "base")
        assert found.sliding_safety[0] == pytest.approx(2.0 * MU, rel=1e-12)
        assert np.isinf(found.plane_safety).all()


@pytest.mark.parametrize("shear", [0.0, 3e5])
def test_without_friction_and_cohesion_nothing_is_mobilised(tmp_path, shear):
    """Shear of a frictionless joint is that of dashpots."""
    traction = [[-1e6, shear, 0.0]]
    path = write_joint(tmp_path / "r.h5", [[0.0, 0.0, 1.0]], traction, angle=0.0)
    with Results(path) as results:
        assert np.isnan(measures.joint_extremes(results, "base").mobilised).all()
        assert np.isnan(joint_resultants(results, "base").plane_safety).all()
        with pytest.raises(ResultsError, match="no friction of the joint 'base'"):
            map_value(results, "base", "mobilised", 0)


def test_dashpots_add_shear_beyond_friction(tmp_path):
    path = write_joint(tmp_path / "r.h5", [[0.0, 0.0, 1.0]], [[-1e6, 2e6 * MU, 0.0]])
    with Results(path) as results:
        assert map_value(results, "base", "mobilised", 0) == pytest.approx([2.0])
        assert measures.joint_extremes(results, "base").safety == pytest.approx([0.5])


def test_a_joint_that_is_safe_throughout_is_in_the_picture(tmp_path):
    path = write_joint(tmp_path / "r.h5", np.array([[0.0, 0.0, 1.0]]), [[-1e6, 1e6 * MU / 24.3, 0]])
    with Results(path) as results:
        ax = plots.joint_histories(results)[-1]
    assert ax.lines[1].get_ydata() == pytest.approx([1 / 24.3])
    assert ax.get_ylim() == pytest.approx((0.0, 1.02))


def test_an_older_file_may_hold_fewer_series(tmp_path):
    # The extremes that version 1 of the layout began with; the mean pressure is a later row.
    keys = ("opening", "slip", "pressure", "compression", "shear_sum")
    record = {f"base/{key}": 1.0 + number for number, key in enumerate(keys)}
    record |= {f"base/{name}_at": np.ones(3) for name in ("opening", "slip")}
    points = np.array([[0.0, 0.0, 0.0]])
    joint = {"points": points, "frames": np.eye(3)[None], "areas": [1.0], "facet": [0]}
    state = {"displacement": points, "joints/base/gap": points, "joints/base/traction": points}
    with ResultsWriter(tmp_path / "old.h5", {}) as writer:
        declare_states(writer, points, [[0, 0, 0]], {"base": joint})
        declare(writer, "joints", record)
        writer.start()
        writer.append("joints", 0.0, record)
        writer.append("states", 0.0, state)
        writer.finish("complete", {})
    with Results(tmp_path / "old.h5") as results:
        assert measures.joint_extremes(results, "base").slip == [2.0]
        found = measures.joint_measures(results)["base"]
        assert (found["pressure_max"], np.isnan(found["mean_pressure_max"])) == (3.0, True)
        assert len(plots.joint_histories(results)) == 4
        header = tables_of(results, "joint_extremes")["joint_extremes"].header
        assert "largest pressure [Pa]" in header
        assert "mean pressure [Pa]" not in header
        with pytest.raises(ResultsError, match="lacks the mean_pressure of joints"):
            plots.joint_panels(results, "mean_pressure")
