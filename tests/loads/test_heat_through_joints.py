# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Heat through a joint between two slabs of length L, a cold and a warm one.

With outer faces at T0 and T1 the flux is q = (T1 - T0) / (2 L / k + 1 / h), the same everywhere,
and the temperature jumps by q / h: exact with linear elements.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints.loads.temperature.fields import FREQUENCY, YEAR
from dolfinx_joints.mesh.dolfinx_versions import geometry_nodes

pytestmark = pytest.mark.mpi

LENGTH, K, CAPACITY = 2.0, 2.5, 2.5e6  # m, W/(m K), J/(m^3 K)
FACES = {"x_min": 4.0, "x_max": 16.0}
CONTACT = dj.JointConductance(closed=50.0)
AIR = dj.JointConductance(closed=50.0, film=0.025)


@pytest.fixture
def slabs(wall_file, read):
    """``slabs(cells)``: two slabs of 2 m along x, cells in each."""

    def make(cells=2, order=1):
        return read(
            wall_file(
                length=2.0 * LENGTH,
                thickness=1.0,
                height=1.0,
                divisions=(2 * cells, 1, 1),
                joints=1,
                order=order,
            )
        )

    return make


def nodes(field):
    """Coordinates along x of the nodes, and on which side of the joint these are, -1 and 1."""
    jointed, space = field.function_space.mesh, field.function_space
    side = np.zeros(len(field.x.array))
    x = jointed.geometry.x[:, 0]
    for corners, dofs in zip(geometry_nodes(jointed), space.dofmap.list, strict=True):
        middle = x[corners].mean()
        side[dofs] = np.sign(middle - LENGTH)
    return space.tabulate_dof_coordinates()[:, 0], side


def through(h):
    """The exact steady temperature at places on sides."""
    flux = 12.0 / (2.0 * LENGTH / K + 1.0 / h)
    return lambda x, side: 10.0 + flux / K * (x - LENGTH) + 0.5 * flux / h * side


@pytest.mark.parametrize(
    ("joint", "opening", "h"),
    [
        (CONTACT, None, 50.0),
        (CONTACT, -1e-4, 50.0),  # overlaps are closed
        (AIR, 2e-3, 1.0 / (1.0 / 50.0 + 2e-3 / 0.025)),
    ],
)
def test_two_slabs_in_contact(slabs, joint, opening, h):
    jointed = slabs()
    openings = None if opening is None else {"joint_1": opening}
    field = dj.steady_temperature(
        jointed, FACES, conductivity=K, joints={"joint_1": joint}, openings=openings
    )
    np.testing.assert_allclose(field.x.array, through(h)(*nodes(field)), rtol=1e-12)


def test_an_open_joint_insulates(slabs):
    jointed = slabs()
    options = {"joints": {"joint_1": CONTACT}, "openings": {"joint_1": 1e-9}}
    field = dj.steady_temperature(jointed, FACES, **options)
    _, side = nodes(field)
    np.testing.assert_allclose(field.x.array, 10.0 + 6.0 * side, rtol=1e-12)
    with pytest.raises(ValueError, match="A block has no face with a given temperature"):
        dj.steady_temperature(jointed, {"x_min": 4.0}, **options)
    alone = dj.steady_temperature(jointed, {"x_min": 4.0}, joints=options["joints"])
    np.testing.assert_allclose(alone.x.array, 4.0, rtol=1e-12)


def test_the_opening_of_a_displacement(slabs):
    """The block beyond the joint moves away by 2 mm: the gap is that of its form."""
    jointed = slabs()
    space = fem.functionspace(jointed.mesh, ("Lagrange", 1, (3,)))
    u = fem.Function(space)
    probe = dj.steady_temperature(jointed, FACES)
    _, side = nodes(probe)
    u.x.array[0::3] = np.where(side > 0.0, 2e-3, 0.0)
    gap = ufl.dot(jointed.frame("joint_1"), ufl.jump(u))[0]
    options = {"joints": {"joint_1": AIR}, "openings": {"joint_1": gap}, "conductivity": K}
    field = dj.steady_temperature(jointed, FACES, **options)
    np.testing.assert_allclose(
        field.x.array, through(1.0 / (0.02 + 2e-3 / 0.025))(*nodes(field)), rtol=1e-10
    )


def test_long_times_are_steady(slabs):
    """From any start, in steps of two lengths; and the mean of what swings, a year later."""
    jointed, joints = slabs(), {"joint_1": CONTACT}
    faces = {"x_min": dj.AnnualWave(mean=4.0, amplitude=0.0), "x_max": 16.0}
    times = [*(0.5 * YEAR * np.arange(1, 5)), *(4.0 * YEAR * np.arange(1, 7))]
    fields = dj.transient_temperatures(
        jointed, faces, times=times, initial=30.0, conductivity=K, joints=joints
    )
    assert len(fields) == len(times)
    np.testing.assert_allclose(fields[-1].x.array, through(50.0)(*nodes(fields[-1])), rtol=1e-6)


def test_refusals(slabs):
    jointed = slabs()
    good = {"times": [1.0], "initial": 9.0}
    for options, error, text in (
        ({"joints": {"north": CONTACT}}, dj.MeshError, "no joint 'north'; the joints are: joint_1"),
        ({"joints": {"joint_1": 50.0}}, ValueError, "it must be a JointConductance"),
        ({"openings": {"joint_1": 1.0}}, ValueError, "'joint_1', which has no conductance"),
        ({"times": [2.0, 1.0]}, ValueError, "it must be increasing, positive times"),
    ):
        with pytest.raises(error, match=text):
            dj.transient_temperatures(jointed, FACES, **{**good, **options})


def season_in_two_slabs(x, side, h):
    """Complex temperature of two slabs, 10 cos(w t) at x = 0 and 0 at 2 L; see the test."""
    p = np.sqrt(1j * FREQUENCY * CAPACITY / K)
    c, s = np.cosh(p * LENGTH), np.sinh(p * LENGTH)
    # Unknowns: T_1 = a cosh(p x) + b sinh(p x), T_2 = d sinh(p (2 L - x)), with a = 10;
    # k T_1' = k T_2' = h (T_2 - T_1) at x = L.
    matrix = np.array([[K * p * c + h * s, -h * s], [h * s, -K * p * c - h * s]])
    b, d = np.linalg.solve(matrix, [-10.0 * (K * p * s + h * c), -10.0 * h * c])
    first = 10.0 * np.cosh(p * x) + b * np.sinh(p * x)
    return np.where(side < 0.0, first, d * np.sinh(p * (2.0 * LENGTH - x)))


def test_a_season_in_two_slabs(slabs):
    """Waves exp(+-p x) with p^2 = i w rho c / k in each slab, and the flux h times the jump.

    The mean is steady, from 4 to 16.
    """
    jointed, h = slabs(16, 2), 2.0
    air = dj.AnnualWave(mean=FACES["x_min"], amplitude=10.0, warmest_day=0.0)
    loads = dj.seasonal_temperatures(
        jointed,
        {"x_min": air, "x_max": FACES["x_max"]},
        reference=0.0,
        expansion=1e-5,
        diffusivity=K / CAPACITY,
        day=0.0,
        conductivity=K,
        joints={"joint_1": dj.JointConductance(closed=h)},
    )
    swing = dj.transient_temperatures(jointed, {}, times=[1.0], initial=0.0)[0]
    exact = season_in_two_slabs(*nodes(swing), h)
    parts = (through(h)(*nodes(swing)), exact.real, -exact.imag)
    for load, part in zip(loads, parts, strict=True):
        np.testing.assert_allclose(at_nodes(load.value, swing), part, atol=1e-4)


def test_a_season_step_by_step(slabs):
    """From a day of the season on, faces that swing keep it: of second order in the step."""
    jointed, h = slabs(16, 2), 2.0
    air = dj.AnnualWave(mean=0.0, amplitude=10.0, warmest_day=0.0)
    start = dj.transient_temperatures(jointed, {}, times=[1.0], initial=0.0)[0]
    exact, end = season_in_two_slabs(*nodes(start), h), 0.5 * YEAR
    start.x.array[:] = exact.real
    errors = []
    for steps in (6, 12, 24):
        field = dj.transient_temperatures(
            jointed,
            {"x_min": air, "x_max": 0.0},
            times=np.linspace(0.0, end, steps + 1)[1:],
            initial=start,
            conductivity=K,
            heat_capacity=CAPACITY,
            joints={"joint_1": dj.JointConductance(closed=h)},
            day=0.0,
        )[-1]
        off = np.abs(field.x.array - (exact * np.exp(1j * FREQUENCY * end)).real)
        errors.append(max(jointed.mesh.comm.allgather(float(off.max(initial=0.0)))))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.3)


def at_nodes(value, like):
    """Values of a UFL scalar at the nodes of a field."""
    space = like.function_space
    points = space.element.interpolation_points
    points = points() if callable(points) else points
    field = fem.Function(space)
    field.interpolate(fem.Expression(value + 0.0, points, comm=space.mesh.comm))
    return field.x.array
