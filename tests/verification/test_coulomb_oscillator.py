# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A mass on a spring with dry friction: loses 4 mu N / k per cycle, stops within mu N / k of zero.

m 1 kg, k 1e4 N/m, N 10 N, mu 0.1, released at 0.85 mm. Each half cycle, pi/100 s, is a cosine about
+-0.1 mm and turns 0.2 mm nearer to zero: 0.85, -0.65, 0.45, -0.25, 0.05 mm, and there it stays from
4 pi/100 = 0.125664 s on, as k 0.05 mm = 0.5 N is below mu N = 1 N.

Two equal degrees of freedom lie in the friction plane, its axes turned against them. The normal
force is that of an initial gap of -N / k_n. Sticking is elastic: friction reverses over
2 mu N / k_s, which takes sqrt(4 mu N / (k_s a)) from rest at an acceleration a of some m/s^2. So
k_s must be large: 1e11 N/m makes some 1e-6 s of it, 1e9 N/m some 1e-5 s.
"""

import math
from collections import namedtuple
from functools import cache

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints import FrictionNoTension, MatrixSystem, Newmark, NewtonOptions
from dolfinx_joints.energy import EnergyLedger
from dolfinx_joints.exact import CoulombOscillator
from dolfinx_joints.interface import make_solver
from dolfinx_joints.laws import JointState
from dolfinx_joints.states import initial_state

NORMAL_FORCE, MU = 10.0, 0.1
K_N, K_S = 1e9, 1e11
EXACT = CoulombOscillator(mass=1.0, stiffness=1e4, friction=MU * NORMAL_FORCE, start=0.85e-3)
PERIOD = 2.0 * EXACT.half_period
END = EXACT.rest_time + 0.3 * PERIOD

Run = namedtuple("Run", "time displacement friction_work path energy_error")


@cache
def march(angle_deg, *, steps_per_period=1000, direction_deg=0.0, k_s=K_S, solver="condensed"):
    """Release at rest in a direction of the dofs, friction axes turned by an angle [degrees]."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    system = MatrixSystem.from_arrays(
        mass=np.eye(2),
        stiffness=1e4 * np.eye(2),
        gap=[[0.0, 0.0], [c, s], [-s, c]],
        initial_gap=-NORMAL_FORCE / K_N,
        law=FrictionNoTension(
            normal_stiffness=K_N,
            shear_stiffness=k_s,
            friction_angle_deg=math.degrees(math.atan(MU)),
        ),
    )
    direction = math.radians(direction_deg)
    towards = np.array([math.cos(direction), math.sin(direction)])
    u = system.mass.createVecRight()
    u.setArray(EXACT.start * towards)
    gap = system.contact.gap(u)
    # Friction is there from the start: the mass is about to move back, against ``towards``.
    against = -gap[:, 1:] / np.linalg.norm(gap[:, 1:])
    slip = (1.0 - 1e-12) * MU * NORMAL_FORCE / k_s * against
    step_solver = make_solver(system, NewtonOptions(relative_tolerance=1e-12), solver)
    state = initial_state(
        step_solver, displacement=u, joints=JointState(gap=gap, elastic_slip=slip)
    )
    ledger = EnergyLedger(system)
    ledger.start(state)
    dt = PERIOD / steps_per_period
    times, path = [0.0], [state.displacement.array.copy()]
    while state.time < END:
        state, report = Newmark().advance(step_solver, state, dt)
        ledger.record(ledger.after(state, report))
        times.append(state.time)
        path.append(state.displacement.array.copy())
    path = np.array(path)
    return Run(np.array(times), path @ towards, ledger.row.friction, path, ledger.relative_error)


def error(run):
    """Largest displacement error relative to the start."""
    difference = run.displacement - EXACT.displacement(run.time)
    return np.abs(difference).max() / EXACT.start


def test_exact_solution_has_the_stated_values():
    assert 1e3 * EXACT.turning_points == pytest.approx([0.85, -0.65, 0.45, -0.25, 0.05], abs=1e-12)
    assert EXACT.rest_time == pytest.approx(0.125664, abs=5e-7)
    times = np.arange(6) * math.pi / 100
    expected = [0.85, -0.65, 0.45, -0.25, 0.05, 0.05]
    assert 1e3 * EXACT.displacement(times) == pytest.approx(expected, abs=1e-9)


def test_exact_solution_solves_its_equation():
    h, t = 1e-5, np.linspace(0.001, 0.124, 400)
    away = np.abs(np.mod(t / EXACT.half_period + 0.5, 1.0) - 0.5) * EXACT.half_period > 2 * h
    x, before, after = (EXACT.displacement(t[away] + s * h) for s in (0, -1, 1))
    acceleration = (after - 2.0 * x + before) / h**2
    residual = acceleration + 1e4 * x + np.sign(after - before)
    assert np.abs(residual).max() < 1e-3  # of k x0 = 8.5 N


def test_exact_solution_within_the_band_rests():
    still = CoulombOscillator(mass=1.0, stiffness=1e4, friction=1.0, start=-0.9e-4)
    assert still.rest_time == 0.0
    assert still.displacement([0.0, 0.1]) == pytest.approx([-0.9e-4, -0.9e-4])


@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0, 73.0])
def test_displacement_in_a_turned_friction_plane(angle):
    """T/1000: friction reverses within a step, which errs in velocity by mu N dt / m at most.

    That is 6.3e-5 m/s, or 6.3e-7 m = 7.4e-4 of the start; four reversals stay below three of them.
    """
    run = march(angle)
    assert error(run) < 2e-3
    turns = np.interp(np.arange(1, 5) * EXACT.half_period, run.time, run.displacement)
    assert turns == pytest.approx(EXACT.turning_points[1:], abs=2e-3 * EXACT.start)
    across = run.path @ [0.0, 1.0]
    assert np.abs(across).max() < 1e-9 * EXACT.start


def test_error_falls_with_the_step():
    """Order one, the reversals being within a step."""
    steps = (250, 500, 1000, 2000)
    errors = [error(march(17.0, steps_per_period=n)) for n in steps]
    assert 0.9 < -np.polyfit(np.log(steps), np.log(errors), 1)[0] < 1.3


def test_both_solvers_agree():
    """At k_s = 1e9 N/m; reversals at much stiffer joints are beyond the monolithic Newton."""
    condensed, monolithic = (march(17.0, k_s=1e9, solver=s) for s in ("condensed", "monolithic"))
    assert condensed.path == pytest.approx(monolithic.path, abs=1e-8 * EXACT.start)
    assert error(monolithic) < 2.5e-3


def test_rest_stays_at_rest():
    """At 0.05 mm, within one error of the displacement."""
    run = march(45.0)
    rest = run.displacement[run.time > EXACT.rest_time + PERIOD / 50]
    assert np.ptp(rest) < 1e-3 * EXACT.start
    assert rest.mean() == pytest.approx(0.05e-3, abs=2e-3 * EXACT.start)


@pytest.mark.parametrize("direction", [30.0, 90.0, 200.0])
def test_any_direction_of_motion(direction):
    """At rest the sticking mass trembles about one place, within 1e-4 of the start."""
    straight, turned = march(17.0), march(17.0, direction_deg=direction)
    moves = straight.time < EXACT.rest_time - PERIOD / 50
    difference = np.abs(turned.displacement - straight.displacement) / EXACT.start
    assert difference[moves].max() < 1e-7
    assert difference.max() < 1e-4


def test_friction_work_is_force_times_path():
    """mu N (0.85 + 2 (0.65 + 0.45 + 0.25) + 0.05) mm = 3.6e-3 J = k (0.85^2 - 0.05^2) mm^2 / 2."""
    run = march(45.0)
    assert run.friction_work == pytest.approx(3.6e-3, rel=1e-3)
    assert run.energy_error < 1e-9
