# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Temperatures in a body from those of its faces, and from files.

A wall [0, L] x [0, d] x [0, H], its faces y = 0 and y = d at given temperatures. Expected:

    steady          T0 + (T1 - T0) y / d, whatever the joints across x
    over the year   Re(e^{iwt} A cosh(q (y - d/2)) / cosh(q d/2)), q = sqrt(i w / kappa),
                    both faces at A cos(wt); far inside a thick wall exp(-y sqrt(w / 2 kappa))
    reservoir       Zhu (1997): at depth y the mean c + (m - c) e^{-0.04 y}, the amplitude
                    A e^{-0.018 y}, the lag 2.15 - 1.30 e^{-0.085 y} months
"""

import cmath
import math
from contextlib import nullcontext

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx import fem
from petsc4py import PETSc

import dolfinx_joints as dj
from dolfinx_joints.loads.temperature.fields import DAY, FREQUENCY, MONTH

pytestmark = pytest.mark.mpi

D = 4.0
FACES = ("y_min", "y_max")
LAW = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=30.0)


@pytest.fixture
def wall(wall_file, read):
    """``wall(cells, order)``: two blocks of 2 m, 4 m thick and 3 m high."""

    def make(cells=4, order=1):
        path = wall_file(
            length=4.0, thickness=D, height=3.0, divisions=(2, cells, 1), joints=1, order=order
        )
        return read(path)

    return make


def places(field):
    """Coordinates of the nodes of a field, shape (n, 3), ghosts included."""
    return field.function_space.tabulate_dof_coordinates()


def nodal(value, jointed):
    """A scalar UFL value at the nodes of the mesh."""
    space = fem.functionspace(jointed.mesh, ("Lagrange", jointed.shape.degree))
    f = fem.Function(space)
    points = space.element.interpolation_points
    points = points() if callable(points) else points
    f.interpolate(fem.Expression(value, points, comm=jointed.mesh.comm))
    return f.x.array, space.tabulate_dof_coordinates()


def test_linear_through_the_thickness(wall):
    jointed = wall()
    field = dj.steady_temperature(jointed, {"y_min": 4.0, "y_max": lambda x: 16.0 + 0.0 * x[:, 0]})
    np.testing.assert_allclose(field.x.array, 4.0 + 12.0 * places(field)[:, 1] / D, rtol=1e-12)


def test_uniform(wall):
    """Where all faces have it, and the mean of what swings."""
    faces = dict.fromkeys(FACES, dj.AnnualWave(mean=9.0, amplitude=7.0))
    field = dj.steady_temperature(wall(), faces)
    np.testing.assert_allclose(field.x.array, 9.0, rtol=1e-12)


def test_cold_that_is_linear_through_the_thickness(wall):
    """An open joint opens on average by alpha times the mean cooling times the length.

    By reciprocity (Maysel): a uniform pull on the joint's faces makes a uniform stress along x,
    whose trace times alpha dT, summed over the body, is the pull times the mean opening. Blocks
    are held in planes of symmetry and at x = 0 and 4 m along x.
    """
    jointed = wall(4)
    field = dj.steady_temperature(jointed, {"y_min": 4.0, "y_max": 10.0})
    cold = dj.Temperature(value=field, reference={"concrete": 12.0}, expansion=1e-5)
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=25e9, poisson=0.2, density=2400.0),
        joints=LAW,
        supports=[
            dj.Fixed(group="x_min", components="x"),
            dj.Fixed(group="x_max", components="x"),
            dj.Fixed(group="y_min", components="y"),
            dj.Fixed(group="base", components="z"),
        ],
        loads=[cold],
    )
    gap = dj.Simulation(model).statics().joints.state.gap[:, 0]
    mean = model.contact.integral(gap) / model.contact.integral(np.ones(len(gap)))
    assert mean == pytest.approx(1e-5 * 5.0 * 4.0, rel=1e-9)


def exact_wave(y, diffusivity):
    """Complex amplitude for a swing of 1 on both faces."""
    q = cmath.sqrt(1j * FREQUENCY / diffusivity)
    return np.cosh(q * (y - 0.5 * D)) / cmath.cosh(q * 0.5 * D)


def wave_error(jointed, diffusivity):
    """Largest error of a swing of 10 K, relative, and the three loads."""
    faces = dict.fromkeys(FACES, dj.AnnualWave(mean=9.0, amplitude=10.0, warmest_day=0.0))
    loads = dj.seasonal_temperatures(
        jointed, faces, reference=12.0, expansion=1e-5, diffusivity=diffusivity, day=0.0
    )
    cosine, x = nodal(loads[1].value, jointed)
    sine, _ = nodal(loads[2].value, jointed)
    exact = 10.0 * exact_wave(x[:, 1], diffusivity)
    # Re((a + ib) e^{iwt}) = a cos wt - b sin wt.
    error = max(
        np.abs(cosine - exact.real).max(initial=0.0), np.abs(sine + exact.imag).max(initial=0.0)
    )
    return max(jointed.mesh.comm.allgather(float(error))) / 10.0, loads


def test_season_inside_a_wall(wall):
    """The error falls with the square of the cells, and the middle hardly sees the season."""
    coarse, fine = (wave_error(wall(cells), 1e-7)[0] for cells in (8, 16))
    assert fine < 6e-3
    assert coarse / fine == pytest.approx(4.0, rel=0.15)
    assert abs(exact_wave(0.5 * D, 1e-7)) < 0.3


def total(parts, days):
    """Temperature so many days after t = 0."""
    mean, cosine, sine = parts
    phase = FREQUENCY * DAY * days
    return mean + cosine * math.cos(phase) + sine * math.sin(phase)


def test_waves_of_air_and_water():
    air = dj.AnnualWave(mean=10.0, amplitude=9.0, warmest_day=200.0)
    points = np.array([[0.0, 0.0, 60.0], [0.0, 0.0, 50.0], [1.0, 2.0, 30.0]])
    # t = 0 is day 50: the air is warmest 150 days later and coldest half a year after that.
    parts = air.parts(points, 50.0)
    np.testing.assert_allclose(total(parts, 150.0), 19.0, rtol=1e-14)
    np.testing.assert_allclose(total(parts, 150.0 + 365.25 / 2), 1.0, rtol=1e-13)
    water = dj.ReservoirTemperature(
        level=50.0, air=air, surface_mean=12.0, surface_amplitude=8.0, deep_mean=5.0
    )
    parts = water.parts(points, 50.0)
    assert total(parts, 150.0)[0] == pytest.approx(19.0, rel=1e-14)  # in the air
    mean, amplitude = 5.0 + 7.0 * math.exp(-0.8), 8.0 * math.exp(-0.36)  # 20 m deep
    assert parts[0][2] == pytest.approx(mean, rel=1e-14)
    lag = (2.15 - 1.30 * math.exp(-1.7)) * MONTH / DAY
    assert total(parts, 150.0 + lag)[2] == pytest.approx(mean + amplitude, rel=1e-13)
    assert np.hypot(parts[1][2], parts[2][2]) == pytest.approx(amplitude, rel=1e-14)


def written(comm, path, text):
    """The path of a file that rank 0 has written."""
    if comm.rank == 0:
        path.write_text(text, encoding="utf-8")
    comm.barrier()
    return path


CORNERS = [(x, y, z) for x in (0.0, 4.0) for y in (-1.0, 4.0) for z in (0.0, 3.0)]
TABLE = "x,y,z,T\n" + "".join(f"{x},{y},{z},{3 * x - y + 2 * z + 7}\n" for x, y, z in CORNERS)
# What lies at 9 m and above where it should be at 0 to 4 m.
IN_MM = "x,y,z,T\n" + "".join(f"{9e3 + x},{9e3 + y},{9e3 + z},5\n" for x, y, z in CORNERS)


@pytest.mark.parametrize(
    "text", ["# from the thermal model\n\n" + TABLE, TABLE.replace(",", ";").replace(".", ",")]
)
def test_points_of_a_file(comm, wall, new_path, text):
    """Linear data come back at every node, comments and empty lines do not count."""
    field = dj.temperature_from_file(written(comm, new_path("t.csv"), text), wall())
    x, y, z = places(field).T
    np.testing.assert_allclose(field.x.array, 3 * x - y + 2 * z + 7, rtol=1e-12, atol=1e-12)


def test_points_in_another_unit(comm, wall, new_path):
    rows = "".join(f"{1e3 * x},{1e3 * y},{1e3 * z},{x}\n" for x, y, z in CORNERS)
    path = written(comm, new_path("t.csv"), "x,y,z,T\n" + rows)
    text = "extend over 5000 m, the mesh over 4 m; check the unit of the points"
    with pytest.warns(dj.PlausibilityWarning, match=text) if comm.rank == 0 else nullcontext():
        dj.temperature_from_file(path, wall())


def test_nodes_outside_take_the_nearest_point(comm, wall, new_path):
    lower = "".join(f"{x},{y},{z},5\n" for x, y, _ in CORNERS for z in (0.0, 2.5))
    rows = sorted(set(lower.split()))
    path = written(comm, new_path("t.csv"), "x,y,z,T\n" + "\n".join(rows))
    with pytest.raises(
        dj.TemperatureError, match=r"no point within 0.2 m of the node at .*, 3\) m"
    ):
        dj.temperature_from_file(path, wall(), reach=0.2)
    field = dj.temperature_from_file(path, wall(), reach=3.0)
    np.testing.assert_allclose(field.x.array, 5.0, rtol=1e-12)


def test_too_little_memory_is_told(wall):
    """Of a factor that did not fit all temperatures would be infinite."""
    options = PETSc.Options()
    name = "dolfinx_joints_temperature_mat_mumps_icntl_14"
    options[name] = -99  # per cent of the memory that the factor needs
    try:
        with pytest.raises(dj.JointsError, match="does not fit into memory"):
            dj.steady_temperature(wall(), dict.fromkeys(FACES, 9.0))
    finally:
        options.delValue(name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# nothing\n\n", "the columns are missing; they must be x,y,z,T, in m"),
        ("x,y,T\n0,0,1\n", "the columns are x,y,T; they must be x,y,z,T, in m"),
        (TABLE + "1,2,3\n", "line 10 must have 4 finite numbers, .* got '1,2,3'"),
        (TABLE + "1,2,3,warm\n", "line 10 must have 4 finite numbers, .* got '1,2,3,warm'"),
        (TABLE + "\n1,2,,4\n", "line 11 must have 4 finite numbers, .* got '1,2,,4'"),
        (TABLE + "1,2,nan,4\n", "line 10 must have 4 finite numbers"),
        (
            TABLE + "1,2,3,-999.0\n",
            "line 10 must have .*, without a filler for a missing .*999",
        ),
        (TABLE + "0,-1,0,9\n", "has 1 points more than once"),
        ("x,y,z,T\n0,0,0,1\n1,0,0,1\n0,1,0,1\n1,1,0,1\n", "has 4 points that span 2 of 3"),
        (IN_MM, "no point within 1 m of the node"),
    ],
)
def test_malformed_files(comm, wall, new_path, text, message):
    path = written(comm, new_path("t.csv"), text)
    with pytest.raises(dj.TemperatureError, match=message):
        dj.temperature_from_file(path, wall())


def test_no_text(comm, wall, new_path):
    path = new_path("t.csv")
    with pytest.raises(dj.TemperatureError, match="cannot be read as text"):
        dj.temperature_from_file(path, wall())


def test_refusals(wall):
    """One sentence each, on all ranks."""
    jointed = wall()
    for faces, message in (
        ({}, "faces is {}; it must be a temperature per facet group"),
        ({"y_min": "cold"}, "The temperature of 'y_min' is 'cold'"),
        (
            {"y_min": lambda x: x},
            r"The temperature of 'y_min' is an array of shape \(\d+, 3\); it must be one",
        ),
        ({"x_min": 4.0}, "A block has no face with a given temperature, and no joint conducts"),
    ):
        with pytest.raises(ValueError, match=message):
            dj.steady_temperature(jointed, faces)
    good = {"reference": 12.0, "expansion": 1e-5}
    faces = {"y_min": dj.AnnualWave(mean=9.0, amplitude=5.0)}
    with pytest.raises(ValueError, match="day is 400 days; it must be"):
        dj.seasonal_temperatures(jointed, faces, **good, day=400)
