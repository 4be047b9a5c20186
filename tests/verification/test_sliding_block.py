# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newmark's block: an elastic block slides on a base that is shaken by one rectangular pulse.

            ____________________
           |  block, mu g = 2   |  -> slip
           |____________________|
           |____________________|
           //////////////////////  <- ground, 4 m/s^2 for 0.5 s

The block gains 4 - 2 m/s^2 for 0.5 s and loses 2 m/s^2 for as long: slip 0.25 + 0.25 = 0.5 m, and
it stops at 1 s.
"""

import csv
import math
from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import Rows
from vtk_files import on_root

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.exact import SlidingBlock
from dolfinx_joints.geometry.two_blocks import two_blocks

# Slips of half a metre are those of the problem; that they are not small is said on purpose.
pytestmark = [
    pytest.mark.mpi,
    pytest.mark.filterwarnings("ignore:Joint 'joint_1'. slip or opening reached"),
]

LENGTH, WIDTH, HEIGHT = 2.0, 1.0, 0.2  # of the block [m]
CONCRETE = dj.Elastic(young=30e9, poisson=0.2, density=2400.0)
MASS = CONCRETE.density * LENGTH * WIDTH * HEIGHT
K_N, K_S = 1e10, 4e9  # Pa/m
EXACT = SlidingBlock(pulse=4.0, yield_acceleration=2.0, duration=0.5)
LEVEL_GRAVITY = 10.0  # m/s^2, so that mu is 0.2
LEVEL_MU = EXACT.yield_acceleration / LEVEL_GRAVITY


def blocks(cell, scale):
    """The mesh."""
    sizes = {"length": LENGTH, "width": WIDTH, "size": 0.5}
    sizes |= {"lower_height": 0.1, "upper_height": HEIGHT}
    return mesh_of(two_blocks, cell=cell, **{name: scale * size for name, size in sizes.items()})


def model(cell, mu, gravity, scale=1.0):
    """The block, all sizes times a scale, under gravity (3,) [m/s^2]."""
    return dj.Model(
        blocks(cell, scale),
        material=CONCRETE,
        joints=dj.FrictionNoTension(
            normal_stiffness=K_N,
            shear_stiffness=K_S,
            friction_angle_deg=math.degrees(math.atan(mu)),
        ),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=gravity)],
    )


def mean_slip(block, joints):
    """Mean tangential gap (s1, s2) = (x, y), [m] (collective)."""
    slip = joints.state.gap[:, 1:]
    area = block.contact.integral(np.ones(len(slip)))
    return np.array([block.contact.integral(slip[:, axis]) for axis in (0, 1)]) / area


class History(NamedTuple):
    """At all steps: time [s], mean slips [m] and friction work [J]."""

    time: np.ndarray
    slip: np.ndarray
    across: np.ndarray
    friction: np.ndarray


def ground(time):
    """Towards -x; the mean value where the pulse ends, so that its impulse is right."""
    left = EXACT.duration - time
    return -EXACT.pulse * (0.5 if abs(left) < 1e-9 else float(left > 0.0)), 0.0, 0.0


def shake(cell, dt, scale=1.0):
    """Self weight, then the pulse."""
    block = model(cell, LEVEL_MU, (0.0, 0.0, -LEVEL_GRAVITY), scale)
    seen = Rows(lambda r: (r.time, *mean_slip(block, r.joints), r.energy.friction))
    simulation = dj.Simulation(block, monitors=[seen])
    simulation.statics()
    outcome = simulation.dynamics(dt=dt, steps=round(1.2 / dt), motion=ground)
    return History(*np.array(seen.rows).T), outcome


def expected_error(dt):
    """Of the final slip [m]: a step's load is the mean of its ends, which smears the pulse's end.

    In the two steps beside it the ground accelerates with 3/4 and 1/4 of A instead of A and 0. The
    block is slower by A dt / 4 where they meet, and lags by A dt^2 / 4 ever after.
    """
    return -0.25 * EXACT.pulse * dt**2


def test_exact_solution():
    assert EXACT.final_slip == pytest.approx(0.5)
    assert EXACT.stop_time == pytest.approx(1.0)
    assert EXACT.slip([0.5, 1.0, 2.0]) == pytest.approx([0.25, 0.5, 0.5])
    t = np.linspace(0.0, 1.5, 1501)
    velocity = EXACT.velocity(t)
    travelled = np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * 1e-3
    assert travelled == pytest.approx(EXACT.slip(t[1:]), abs=1e-9)
    held = SlidingBlock(pulse=1.9, yield_acceleration=2.0, duration=0.5)
    assert held.final_slip == held.stop_time == 0.0
    assert not held.slip(t).any()


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_newmark_block(cell):
    dt = 0.01
    history, outcome = shake(cell, dt)
    error = history.slip[-1] - EXACT.final_slip
    assert error == pytest.approx(expected_error(dt), rel=0.05)
    assert np.abs(history.slip - EXACT.slip(history.time)).max() < 1.1 * abs(expected_error(dt))
    assert np.abs(history.across).max() < 1e-4 * EXACT.final_slip
    rest = history.slip[history.time > EXACT.stop_time + 3 * dt]
    assert np.ptp(rest) < 1e-3 * EXACT.final_slip
    work = LEVEL_MU * MASS * LEVEL_GRAVITY * history.slip[-1]  # mu N slip
    assert history.friction[-1] == pytest.approx(work, rel=1e-3)
    # Rounding of K u, the body being moved by half a metre: 1e-7 N, of a work of 960 J.
    assert outcome.energy_error < 1e-9


def test_a_small_block_slides_as_far():
    """2 cm long, it moves by 25 times that: K u is rounding beside the terms of its sum.

    That is not taken for a solve that went wrong. Rounding of K holds the block by some 2e-4 of g.
    """
    dt = 0.02
    history, outcome = shake("hex", dt, scale=0.01)
    assert outcome.counts.unbalanced == 0
    assert abs(history.slip[-1] - EXACT.final_slip - expected_error(dt)) < 5e-4 * EXACT.final_slip


def test_error_of_the_slip_falls_with_the_step():
    """Second order: 5e-5 of the slip at dt = 5 ms.

    The step in which the block stops, slowed by a = 2 m/s^2, goes on to v0 dt / 2 instead of
    v0^2 / (2 a): at most a dt^2 / 8 further.
    """
    steps = (0.02, 0.01, 0.005)
    errors = [shake("hex", dt)[0].slip[-1] - EXACT.final_slip for dt in steps]
    assert abs(errors[-1]) < 1e-4 * EXACT.final_slip
    for error, dt in zip(errors, steps, strict=True):
        assert abs(error - expected_error(dt)) < EXACT.yield_acceleration * dt**2 / 8.0


@pytest.mark.parametrize("share", [1.0, 0.2])
def test_checks_of_the_joint(comm, new_path, share):
    """Check that the whole joint slides by 0.5 m, or, under a fifth of the pulse, nowhere.

    The safety is then the ratio of yield acceleration and pulse, except for vibrations. The elastic
    slip mu g rho HEIGHT / K_S is below a micrometre. The block stops at 1 s, so that the residual
    slip, the mean over the last second, is the whole slip.
    """
    path, dt = new_path("block.h5"), 0.01
    block = model("hex", LEVEL_MU, (0.0, 0.0, -LEVEL_GRAVITY))
    points = {"top": (1.0, 0.5, 0.1 + HEIGHT)}
    simulation = dj.Simulation(block, monitors=[dj.ResultsMonitor(path, points=points)])
    simulation.statics()

    def pulse(time):
        return share * np.array(ground(time))

    simulation.dynamics(dt=dt, steps=round(2.05 / dt), motion=pulse)

    def look():
        with dj.Results(path) as results:
            limits = {"mean_slip": 0.6, "slid_area": 0.5, "sliding_safety": 1.1, "drift": 1.0}
            table = dj.checks(results, "gravity", crest="top", **limits)
            rows = {row.criterion: row for row in table}
            slid = rows["share of the area that slid"]
            mean = rows["mean of the largest slip of each point"]
            safety, residual = (
                rows["least sliding safety (1: slides at some instant)"],
                rows["residual slip, mean of the last second"],
            )
            assert residual.met == "no limit"
            assert rows["overstressed share of the area"].met == "not recorded"
            assert mean.met == "yes"
            if share == 1.0:
                slip = EXACT.final_slip + expected_error(dt)
                assert (slid.value, slid.met) == (pytest.approx(1.0), "no")
                assert mean.value == pytest.approx(slip, rel=1e-3)
                assert residual.value == pytest.approx(slip, rel=1e-3)
                assert (safety.value, safety.met) == (pytest.approx(1.0), "no")
                drift = rows["crest displacement / height"]
                assert (drift.value, drift.met) == (pytest.approx(slip / 0.3, rel=1e-3), "no")
                assert drift.where == "top, height 0.3 m, from the static state"
            else:
                assert (slid.value, slid.met) == (0.0, "yes")
                assert mean.value < 1e-5
                assert (safety.value, safety.met) == (pytest.approx(2.5, rel=0.2), "yes")
            table.write_csv(path.with_suffix(".csv"))
            with path.with_suffix(".csv").open() as file:
                cells = {row["criterion"]: row for row in csv.DictReader(file)}
            assert float(cells["residual slip, mean of the last second"]["value"]) == residual.value
            assert cells["share of the area that slid"]["met"] == slid.met
            assert "least sliding safety" in str(table)

    on_root(comm, look)
