# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Principal directions of uniform stresses in a turned square, known by hand.

The square of 1 m is turned by ANGLE and fixed at its base; Poisson's ratio is zero. A pull at the
top gives uniaxial tension along its height. Shear at top and sides gives pure shear: tension at
45 degrees to the base, compression of equal size across it.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("pyvista")

from boxes import box
from matplotlib.colors import to_rgba

import dolfinx_joints as dj
from dolfinx_joints.postprocessing import views
from dolfinx_joints.postprocessing.envelopes import PLANE_STRESS, principal_directions
from dolfinx_joints.postprocessing.palette import BLUE, RED
from dolfinx_joints.report.writing import write

ANGLE = np.radians(25.0)
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
STRESS = 1.5e6
SIDES = {"base": (1, 0.0), "top": (1, 1.0), "left": (0, 0.0), "right": (0, 1.0)}
# Tractions by side, principal stresses [Pa], and direction of the largest one from the base.
SCENES = {
    "uniaxial": ({"top": (0.0, STRESS)}, (STRESS, 0.0), 90.0),
    "crushed": ({"top": (0.0, -STRESS)}, (0.0, -STRESS), 0.0),
    "shear": (
        {"top": (STRESS, 0.0), "left": (0.0, -STRESS), "right": (0.0, STRESS)},
        (STRESS, -STRESS),
        45.0,
    ),
}


@pytest.mark.parametrize("scene", SCENES)
def test_uniform_stresses_of_a_turned_square(tmp_path, scene):
    tractions, stresses, degrees = SCENES[scene]

    def place(x):
        return np.column_stack([x[:, :2] @ TURN.T, x[:, 2]])

    loads = [dj.Traction(group=n, value=tuple(TURN @ t)) for n, t in tractions.items()]
    model = dj.Model(
        box((1.0, 1.0), (4, 4), groups=SIDES, place=place),
        material=dj.Elastic(young=25e9, poisson=0.0, density=2400.0),
        supports=[dj.Fixed(group="base")],
        loads=loads,
        body=dj.Body(plane="stress"),
    )
    path = tmp_path / "run.h5"
    monitor = dj.ResultsMonitor(path, points={"top": tuple(TURN @ [0.5, 1.0])}, envelopes=True)
    dj.Simulation(model, monitors=[monitor]).statics(name="load")
    with dj.Results(path) as results:
        values, direction = principal_directions(results.series("statics", PLANE_STRESS, -1))
        for found, expected in zip(values, stresses, strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-9 * STRESS)
        axis = ANGLE + np.radians(degrees)
        along = direction @ [np.cos(axis), np.sin(axis)]
        np.testing.assert_allclose(np.abs(along), 1.0, rtol=1e-12)

        figure = views.principal_stresses(results, stage="load")
        largest, smallest = figure.axes[0].collections
        for lines, stress, turn in ((largest, stresses[0], 0.0), (smallest, stresses[1], 90.0)):
            ends = np.array(lines.get_segments())
            vectors = ends[:, 1] - ends[:, 0]
            # Lines are shorter than sqrt(1 m^2 / 25 vertices) = 0.2 m, thus 0.1 m per MPa.
            np.testing.assert_allclose(np.hypot(*vectors.T), 1e-7 * abs(stress), atol=1e-9)
            if stress:
                normal = axis + np.radians(turn + 90.0)
                np.testing.assert_allclose(vectors @ [np.cos(normal), np.sin(normal)], 0, atol=1e-9)
                colour = to_rgba(RED if stress > 0.0 else BLUE)
                np.testing.assert_allclose(lines.get_colors(), [colour] * 25)
        assert "0.1 m per MPa" in figure.get_suptitle()
        assert {t.get_text() for t in figure.axes[0].get_legend().get_texts()} == {
            "tension",
            "compression",
        }
    html = write([path], tmp_path / "report.html").read_text("utf-8")
    assert "Principal stresses in the plane after the last static stage" in html


def test_a_body_in_space_has_no_crosses(tmp_path):
    model = dj.Model(
        box((1.0, 1.0, 1.0), (1, 1, 1), groups={"base": (2, 0.0)}),
        material=dj.Elastic(young=25e9, poisson=0.2, density=2400.0),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    path = tmp_path / "run.h5"
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 0.0, 1.0)}, envelopes=True)
    dj.Simulation(model, monitors=[monitor]).statics()
    with dj.Results(path) as results:
        assert PLANE_STRESS not in results.streams["statics"]
        with pytest.raises(ValueError, match="is a 3-D run; principal directions are drawn in 2-D"):
            views.principal_stresses(results)
