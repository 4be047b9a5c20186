# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a results file of a free field says, against the exact wave in a column of rock.

An S wave of velocity v(t) rises from the base of a column and comes back from its free surface, H
above: z above the base the velocity is v(t - z/c) + v(t - (2H - z)/c), at the surface twice the
first. v is a pulse sin^4 of length T = H / (2 c), so that at the base the two never meet.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("matplotlib")

from dolfinx.mesh import CellType

import dolfinx_joints as dj
from dolfinx_joints.export.tables import tables_of
from dolfinx_joints.motions.spectra import response_spectrum, significant_duration
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.energy_lines import energy_lines, through_boundaries
from dolfinx_joints.postprocessing.frames import frame_name, nodal_displacement
from studies.summary import summary_row
from tests.verification.test_absorbing import HEIGHT, ROCK, SHEAR, ground, one_way

AMPLITUDE, WIDTH = 0.1, 5.0  # of the velocity [m/s], of the column [m]
LENGTH, TRAVEL = 0.5 * HEIGHT / SHEAR, HEIGHT / SHEAR
DT = LENGTH / 100.0
POINTS = {name: (0.0, z) for name, z in (("base", 0.0), ("middle", HEIGHT / 2), ("top", HEIGHT))}
# Displacement that the pulse leaves: the mean of sin^4 is 3/8, at the surface twice that.
LEFT = 2.0 * AMPLITUDE * LENGTH * 3.0 / 8.0
# rho c v^2 over time and area, the mean of sin^8 is 35/128.
ENERGY = WIDTH * ROCK.density * SHEAR * AMPLITUDE**2 * LENGTH * 35.0 / 128.0


def velocity(time):
    """That of the rising wave at the base."""
    time = np.asarray(time)
    pulse = AMPLITUDE * np.sin(np.pi * time / LENGTH) ** 4
    return np.where((time > 0.0) & (time < LENGTH), pulse, 0.0)


def displacement(time, z=0.0):
    """That of the rock z above the base."""
    a = np.pi / LENGTH

    def passed(t):
        t = np.clip(t, 0.0, LENGTH)
        left = 3.0 * t / 8.0 - np.sin(2 * a * t) / (4 * a) + np.sin(4 * a * t) / (32 * a)
        return AMPLITUDE * left

    speed = SHEAR
    return passed(time - z / speed) + passed(time - (2.0 * HEIGHT - z) / speed)


def acceleration(time):
    """That of the free surface over steps that end and begin DT / 2 from a time."""
    ends = np.stack([time - DT / 2, time + DT / 2])
    return 2.0 * np.diff(velocity(ends - TRAVEL), axis=0)[0] / DT


def incident(time):
    return np.array([velocity(time), 0.0])


def march(comm, path, *, steps=540, supports=(), damping=None, **dynamics):
    jointed = ground(comm, CellType.quadrilateral, [WIDTH, HEIGHT], [1, 20])
    supports = [dj.ViscousBoundary(group="base"), *one_way(jointed, 0), *supports]
    model = dj.Model(
        jointed, material=ROCK, supports=supports, body=dj.Body(degree=2), damping=damping
    )
    monitor = dj.ResultsMonitor(path, points=POINTS, every=100)
    dj.Simulation(model, monitors=[monitor]).dynamics(dt=DT, steps=steps, **dynamics)


@pytest.fixture(scope="module")
def path(comm, new_path):
    made = new_path("waves.h5")
    march(comm, made, loads=[dj.FreeField(groups=["base"], incident=incident, surface=HEIGHT)])
    return made


@pytest.fixture
def results(comm, path):
    """The file, which is read on one rank."""
    if comm.rank:
        pytest.skip("rank 0 reads the file")
    return dj.Results(path)


@pytest.mark.mpi
def test_displacements_are_absolute_and_relative_to_what_is_named(results):
    assert not results.relative
    assert results.description("histories", "displacement").endswith("absolute")
    for name, (_, z) in POINTS.items():
        time, u = measures.displacement_history(results, name, "x")
        np.testing.assert_allclose(u, displacement(time, z), atol=2e-3 * LEFT)
        _, u = measures.displacement_history(results, name, "x", relative_to="base")
        exact = displacement(time, z) - displacement(time)
        np.testing.assert_allclose(u, exact, atol=4e-3 * LEFT)
        _, u = measures.displacement_history(results, name, "x", relative_to="ground")
        exact = displacement(time, z) - displacement(time, HEIGHT)
        np.testing.assert_allclose(u, exact, atol=4e-3 * LEFT)


@pytest.mark.mpi
def test_a_continued_run_is_relative_to_the_ground_since_its_first_record(comm, new_path):
    """The top is the free surface, whose displacement before the second run is not in its file."""
    path = new_path("second.h5")
    jointed = ground(comm, CellType.quadrilateral, [WIDTH, HEIGHT], [1, 20])
    supports = [dj.ViscousBoundary(group="base"), *one_way(jointed, 0)]
    model = dj.Model(jointed, material=ROCK, supports=supports, body=dj.Body(degree=2))
    simulation = dj.Simulation(model)
    simulation.statics()
    loads = [dj.FreeField(groups=["base"], incident=incident, surface=HEIGHT)]
    state = simulation.dynamics(dt=DT, steps=260, loads=loads).state
    simulation.monitors.append(dj.ResultsMonitor(path, points=POINTS, every=40))
    simulation.dynamics(dt=DT, steps=80, loads=loads, start=state)
    if comm.rank:
        return
    with dj.Results(path) as results:
        time, u = measures.displacement_history(results, "top", "x", relative_to="ground")
        np.testing.assert_allclose(u, 0.0, atol=4e-3 * LEFT)
        assert np.ptp(displacement(time, HEIGHT)) > 0.2 * LEFT
        axis = plots.history(results, "top", "x", relative_to="ground").get_ylabel()
        assert axis.endswith("from the first record [mm]")
        assert (
            plots.history(results, "top", "x").get_ylabel().endswith("from the static state [mm]")
        )
        shape, what = nodal_displacement(results, -1, "ground", from_static=True)
        exact = [displacement(time, z)[[-1, 0]] for z in results.static("mesh/nodes")[:, 1]]
        surface = displacement(time, HEIGHT)
        exact = np.subtract(*np.transpose(exact)) - (surface[-1] - surface[0])
        np.testing.assert_allclose(shape[:, 0], exact, atol=8e-3 * LEFT)
        assert what == "from the first record, relative to the free surface"
        with pytest.raises(dj.ResultsError, match="has no displacement of the ground before"):
            measures.displacement_history(results, "top", "x", "ground", from_static=False)


@pytest.mark.mpi
def test_accelerations_are_absolute_once(results):
    time, a = measures.acceleration_history(results, "top", "x", band=None)
    exact = acceleration(time)
    largest = np.abs(exact).max()
    np.testing.assert_allclose(a, exact, atol=0.02 * largest)
    _, a = measures.acceleration_history(results, "top", "x", absolute=False, band=None)
    np.testing.assert_allclose(a, 0.0, atol=0.02 * largest)


@pytest.mark.mpi
def test_ground_is_the_free_surface(results):
    time = 0.5 * DT + DT * np.arange(540)
    exact = acceleration(time)
    _, end = significant_duration(exact, DT, lower=0.0, upper=0.95)
    assert measures.strong_motion_end(results) == pytest.approx(time[0] + end, abs=1e-6)
    periods = [0.02, 0.05, 0.2]
    ax = plots.response_spectra(results, "top", "x", periods=periods, band=None)
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    found = response_spectrum(exact, DT, periods, 0.05).pseudo_acceleration / 9.80665
    assert list(drawn) == ["linear", "free surface"]
    np.testing.assert_allclose(drawn["free surface"], found, rtol=1e-6)
    np.testing.assert_allclose(drawn["linear"], found, rtol=0.02)


@pytest.mark.mpi
def test_waves_are_apart_from_what_stays_in_the_body(results):
    time, lines = results.time("energy"), energy_lines(results)
    inside = (time > 1.1 * LENGTH) & (time < 1.9 * TRAVEL)
    np.testing.assert_allclose(lines["waves"][inside], ENERGY, rtol=2e-3)
    np.testing.assert_allclose((lines["kinetic"] + lines["strain"])[inside], ENERGY, rtol=2e-3)
    # Either way twice what the wave carries passes the dashpots: at 2 rho c v the base moves by v.
    brought, taken = (each[-1] for each in through_boundaries(results))
    assert brought == pytest.approx(2.0 * ENERGY, rel=2e-3)
    assert taken == pytest.approx(2.0 * ENERGY, rel=2e-3)
    for rest in (lines["input"], lines["viscous"], lines["waves"][-1]):
        np.testing.assert_allclose(rest, 0.0, atol=2e-3 * ENERGY)
    ax = plots.energies(results)
    labels = [line.get_label() for line in ax.get_lines()]
    assert labels[0] == f"waves, {brought / 1e3:.4g} kJ in minus {taken / 1e3:.4g} kJ out"
    largest = max(np.abs(line.get_ydata()).max() for line in ax.get_lines())
    assert largest == pytest.approx(ENERGY / 1e3, rel=0.01)


@pytest.mark.mpi
def test_what_boundaries_absorb_is_that_of_their_dashpots_alone(comm, new_path):
    """rho c v^2 of the base, step by step, beside Rayleigh damping and springs that do not damp."""
    path = new_path("damped.h5")
    march(
        comm,
        path,
        steps=150,
        supports=[dj.Spring(group="top", normal_stiffness=0.0, tangential_stiffness=1e6)],
        damping=dj.stiffness_proportional(ratio=0.05, frequency=10.0),
        loads=[dj.FreeField(groups=["base"], incident=incident, surface=HEIGHT)],
    )
    if comm.rank:
        return
    with dj.Results(path) as results:
        moved = np.diff(results.series("histories", "displacement")[:, 0, 0])
        expected = WIDTH * ROCK.density * SHEAR * np.cumsum(moved**2) / DT
        found = results.series("energy", "absorbed")[1:]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * expected[-1])
        assert energy_lines(results)["viscous"][-1] > 0.01 * ENERGY


@pytest.mark.mpi
def test_shapes_are_without_the_motion_of_the_base(results):
    heights = results.static("mesh/nodes")[:, 1]
    for number, time in enumerate(results.time("states")):
        shape, what = nodal_displacement(results, number)
        exact = displacement(time, heights) - displacement(time)
        np.testing.assert_allclose(shape[:, 0], exact, atol=4e-3 * LEFT)
        assert what == "from the unloaded body, relative to the mean of the base"


@pytest.mark.mpi
def test_figures_tables_and_rows_say_what_they_show(results):
    time, exact = results.time("histories"), {"base": 0.0, "middle": HEIGHT / 2}
    for relative_to, text in ((None, "absolute"), ("base", "relative to base")):
        ax = plots.history(results, "middle", "x", relative_to=relative_to)
        assert ax.get_title(loc="left") == f"middle: displacement x, {text}"
        taken = 0.0 if relative_to is None else displacement(time)
        shown = 1e3 * (displacement(time, exact["middle"]) - taken)
        np.testing.assert_allclose(ax.get_lines()[0].get_ydata(), shown, atol=4.0 * LEFT)
        title = plots.fourier(results, "middle", "x", relative_to=relative_to).get_title(loc="left")
        assert title.endswith(text)
    assert frame_name(results, "ground") == "relative to the free surface"
    table = tables_of(results)["histories"]
    column = table.header.index("absolute displacement of top from the first record x [m]")
    assert table.rows[-1][column] == pytest.approx(LEFT, rel=2e-3)
    assert "free_surface_velocity x [m/s]" in table.header
    row = summary_row(results, band=None)
    assert row["top/x/peak_strong"] < 4e-3 * LEFT  # it moves with the free surface, being it
    # The base is half of it ahead once the wave has passed, then half of it behind.
    assert row["base/x/peak_strong"] == pytest.approx(LEFT / 2, rel=4e-3)
    assert row["top/x/acceleration, raw"] == pytest.approx(
        np.abs(acceleration(time)).max(), rel=0.02
    )


@pytest.mark.mpi
def test_the_same_as_a_motion_of_the_outcrop(comm, new_path, path):
    """With dashpots on the bottom alone twice the incident motion of the frame is the same."""

    def outcrop(time):
        a = np.pi / LENGTH
        inside = 0.0 < time < LENGTH
        return [8.0 * AMPLITUDE * a * np.sin(a * time) ** 3 * np.cos(a * time) * inside, 0.0]

    other = new_path("outcrop.h5")
    march(comm, other, motion=outcrop)
    if comm.rank:
        return
    with dj.Results(other) as moved, dj.Results(path) as waves:
        assert moved.relative
        for name in POINTS:
            _, expected = measures.displacement_history(moved, name, "x", relative_to="base")
            _, u = measures.displacement_history(waves, name, "x", relative_to="base")
            np.testing.assert_allclose(u, expected, atol=2e-3 * LEFT)
            _, expected = measures.acceleration_history(moved, name, "x")
            _, a = measures.acceleration_history(waves, name, "x")
            np.testing.assert_allclose(a, expected, atol=0.01 * np.abs(expected).max())
