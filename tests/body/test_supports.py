# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Supports at points and displacements that vary in space, against statics by hand."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints as dj

pytestmark = pytest.mark.mpi

SOLID = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
WEIGHT = 2400.0 * 9.80665 * 2.0  # of 1 m x 2 m, 1 m thick [N]


def test_a_block_on_two_points_by_statics(comm, two_rectangles_file, read, new_path):
    # Weight W at x = 1/2, a push of 1 kN/m^2 along x over the top (y = 2): moments about (0, 0)
    # give W / 2 + 2 H at (1, 0), and W / 2 - 2 H is left at (0, 0), which holds H = 1 kN as well.
    push = 1e3
    path = new_path("points.h5")
    model = dj.Model(
        read(two_rectangles_file(angle=0.0), joints=[]),
        material=SOLID,
        supports=[dj.Fixed(point=(0.0, 0.0)), dj.Fixed(point=(1.0, 0.0), components="y")],
        loads=[dj.Gravity(), dj.Traction(group="top", value=(push, 0.0))],
    )
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 2.0)})
    simulation = dj.Simulation(model, monitors=[monitor])
    state = simulation.statics()
    expected = {
        "point (0 0)": (-push, 0.5 * WEIGHT - 2.0 * push),
        "point (1 0)": (0.0, 0.5 * WEIGHT + 2.0 * push),
    }
    for name, force in expected.items():
        found = model.resultant(state.reaction, name)
        np.testing.assert_allclose(found, force, rtol=0, atol=1e-9 * WEIGHT)
    simulation.dynamics(dt=1e-3, steps=1)
    if comm.rank == 0:
        with dj.Results(path) as results:
            for name, force in expected.items():
                found = results.series("histories", f"reaction/{name}")
                np.testing.assert_allclose(found[-1], force, rtol=0, atol=1e-6 * WEIGHT)


def test_a_point_on_a_joint_names_its_side(two_rectangles_file, read):
    # A lid that hangs on two points of the upper side of a level joint carries its weight alone.
    jointed = read(two_rectangles_file(angle=0.0))
    held = [dj.Fixed(group="base"), dj.Fixed(group="joint_1+", point=(0.0, 1.0))]
    held.append(dj.Fixed(group="upper", point=(1.0, 1.0)))
    model = dj.Model(jointed, material=SOLID, joints=LAW, supports=held, loads=[dj.Gravity()])
    state = dj.Simulation(model).statics()
    names = ("point (0 1) of joint_1+", "point (1 1) of upper")
    assert tuple(model.constraints.points) == names
    total = sum(model.resultant(state.reaction, name) for name in (*names, "base"))
    np.testing.assert_allclose(total, (0.0, WEIGHT), rtol=0, atol=1e-9 * WEIGHT)
    assert model.resultant(state.reaction, "base")[1] < 0.9 * WEIGHT


def test_reactions_of_supports_with_common_nodes_sum_to_the_weight(
    comm, two_rectangles_file, read, new_path
):
    # The corners (0, 0) and (1, 0) are in "base" and "sides". The base constrains y first, so the
    # rollers of the sides carry no weight; the sides constrain x of the corners before the base.
    path = new_path("corners.h5")
    supports = [
        dj.Fixed(group="base", components="y"),
        dj.Fixed(group="sides", components="x"),
        dj.Fixed(group="base", components="x"),
        dj.Fixed(point=(1.0, 0.0)),
    ]
    jointed = read(two_rectangles_file(angle=0.0), joints=[])
    model = dj.Model(jointed, material=SOLID, supports=supports, loads=[dj.Gravity()])
    simulation = dj.Simulation(model, monitors=[dj.ResultsMonitor(path, points={"top": (0, 2)})])
    state = simulation.statics()
    base, sides, point = (
        model.resultant(state.reaction, name) for name in ("base", "sides", "point (1 0)")
    )
    small = dict(rtol=0, atol=1e-9 * WEIGHT)
    np.testing.assert_allclose(base + sides + point, (0.0, WEIGHT), **small)
    np.testing.assert_allclose(base[1], WEIGHT, **small)
    np.testing.assert_array_equal(point, 0.0)
    simulation.dynamics(dt=1e-3, steps=1)
    comm.barrier()
    with dj.Results(path) as results:
        for stream, tolerance in (("statics", 1e-9), ("histories", 1e-6)):
            for name, force in (("base", base), ("sides", sides), ("point (1 0)", point)):
                recorded = results.series(stream, f"reaction/{name}")[-1]
                np.testing.assert_allclose(recorded, force, rtol=0, atol=tolerance * WEIGHT)


def test_a_linear_displacement_of_the_boundary_is_that_of_the_body(two_rectangles_file, read):
    # Patch test: u = A x t on the whole boundary of distorted cells.
    gradient = np.array([[1e-3, 4e-4], [-2e-4, 5e-4]])
    supports = [
        dj.Prescribed(group=group, component=axis, value=lambda x, t, g=row: t * x[:, :2] @ g)
        for group in ("base", "sides", "top")
        for axis, row in zip("xy", gradient, strict=True)
    ]
    model = dj.Model(read(two_rectangles_file(), joints=[]), material=SOLID, supports=supports)
    for time in (0.5, 1.0):
        u = dj.Simulation(model).quasi_statics([time]).displacement
        owned = u.getLocalSize() // 2
        expected = time * model.V.tabulate_dof_coordinates()[:owned, :2] @ gradient.T
        assert np.abs(u.array - expected.ravel()).max(initial=0.0) < 1e-12 * 2e-3


@pytest.mark.parametrize(
    ("support", "text"),
    [
        (lambda: dj.Fixed(), "Fixed: group and point are both None; give one"),
        (
            lambda: dj.Fixed(point=(0.1, 0.0)),
            r"point \(0.1 0\) has no node there; the nearest is \(0, 0",
        ),
        (
            lambda: dj.Fixed(point=(0.0, 1.0)),
            "2 nodes there, on both sides of a joint; also give a side",
        ),
        (
            lambda: dj.Prescribed(group="sides", component="y", value=float),
            "displacement y on 'sides' is both Fixed and Prescribed; give one of them",
        ),
        (
            lambda: dj.Prescribed(group="top", component="x", value=lambda x, t: x[:, :2]),
            "prescribed on 'top' at t = 0 s is an array of shape",
        ),
    ],
)
def test_places_that_do_not_fit_are_refused(two_rectangles_file, read, support, text):
    jointed = read(two_rectangles_file(angle=0.0))

    def run():
        supports = [dj.Fixed(group="base"), dj.Fixed(group="sides", components="y"), support()]
        dj.Simulation(dj.Model(jointed, material=SOLID, joints=LAW, supports=supports)).statics()

    with pytest.raises((ValueError, dj.MeshError), match=text):
        run()


def test_two_prescribed_values_of_one_dof_must_be_equal(comm, two_rectangles_file, read):
    """The corner (1, 2) is in two groups: one value wins nowhere, and both are named on all ranks.

    Values that differ by rounding are equal, and so are two fixed ones.
    """
    jointed = read(two_rectangles_file(angle=0.0), joints=[])

    def moved(*supports):
        fixed = [dj.Fixed(group="base"), dj.Fixed(group="sides", components="y")]
        model = dj.Model(jointed, material=SOLID, supports=[*fixed, *supports])
        return dj.Simulation(model).quasi_statics([0.5]).displacement.norm()

    def of_top(value):
        return dj.Prescribed(group="top", component="x", value=value)

    corner = dj.Prescribed(point=(1.0, 2.0), component="x", value=lambda t: 0.1 * t * 0.3)
    alike = of_top(lambda x, t: t * 0.3 * (0.1 * x[:, 0]))
    text = (
        r"The supports on 'top' and 'point \(1 2\)' both prescribe the displacement x at \(1, 2\), "
        r"which is 0.02 m and 0.015 m at t = 0.5 s; make the values equal there"
    )
    with pytest.raises(ValueError, match=text) as failed:
        moved(of_top(lambda t: 0.04 * t), corner)
    assert len(set(comm.allgather(str(failed.value)))) == 1
    assert moved(alike, corner) == pytest.approx(moved(alike), rel=1e-12)
    assert moved(of_top(lambda t: 0.03 * t), corner) > 0.0
    crossed = dj.Prescribed(point=(1.0, 2.0), component="y", value=lambda t: 0.1 * t)
    assert moved(alike, crossed) > moved(alike)
