# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A mass on a spring strikes a stop (paper section 3 and Fig. 2): exact solution, energy, order.

The steps and the march are those of the demo, which is run here as well.
"""

import math
import os
import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dolfinx_joints.exact import ImpactOscillator

DEMO = Path(__file__).resolve().parents[2] / "demos" / "01_impact.py"

# m 100 kg, k 1e4 N/m, k_stop 1e6 N/m, v0 1 m/s. Without a gap the mass meets the stop in its
# position of rest and makes half an oscillation on both springs: pi sqrt(m / (k + k_stop)) s,
# k_stop v0 sqrt(m / (k + k_stop)) N and 2 k_stop v0 m / (k + k_stop) N s. The numbers for the gap
# are those of the same formulae about the shifted equilibrium, checked against a fine numerical
# integration below.
STATED = {
    0.0: {"impact_time": 0.0, "contact_duration": 0.031260, "max_force": 9950.37},
    0.03: {"impact_time": 0.030469, "contact_duration": 0.030637, "max_force": 9199.67},
}


def oscillator(gap):
    return ImpactOscillator(
        mass=100.0, stiffness=1e4, stop_stiffness=1e6, initial_velocity=1.0, gap=gap
    )


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Names of the demo after a run of it, its own verification included."""
    pytest.importorskip("petsc4py")
    here = Path.cwd()
    os.chdir(tmp_path_factory.mktemp("demo"))
    try:
        names = runpy.run_path(str(DEMO))
        assert Path("output/01_impact.png").stat().st_size > 0
    finally:
        os.chdir(here)
    return names


@pytest.mark.parametrize("gap", STATED)
def test_exact_solution_has_the_stated_values(gap):
    for name, value in STATED[gap].items():
        assert getattr(oscillator(gap), name) == pytest.approx(value, rel=2e-5)


def test_exact_solution_without_a_gap_by_hand():
    problem = oscillator(0.0)
    w = math.sqrt((1e4 + 1e6) / 100.0)
    assert problem.contact_duration == pytest.approx(math.pi / w, rel=1e-13)
    assert problem.max_force == pytest.approx(1e6 / w, rel=1e-13)
    assert problem.impulse == pytest.approx(2e6 / w**2, rel=1e-13)
    assert problem.period == pytest.approx(math.pi / 10.0 + math.pi / w, rel=1e-13)
    assert problem.period < problem.free_period


@pytest.mark.parametrize("gap", [0.0, 0.03, 0.09])
def test_exact_solution_against_numerical_integration(gap):
    problem = oscillator(gap)

    def rate(_, y):
        u, v, _impulse = y
        force = 1e6 * max(u - gap, 0.0)
        return v, -(1e4 * u + force) / 100.0, force

    times = np.linspace(0.0, problem.impact_time + 1.5 * problem.period, 2000)
    answer = solve_ivp(
        rate, times[[0, -1]], (0.0, 1.0, 0.0), t_eval=times, rtol=1e-11, atol=1e-13, max_step=1e-3
    )
    assert np.abs(answer.y[0] - problem.displacement(times)).max() < 1e-8
    assert np.abs(answer.y[1] - problem.velocity(times)).max() < 1e-6
    one = solve_ivp(
        rate, (0.0, 0.8 * problem.period), (0.0, 1.0, 0.0), rtol=1e-11, atol=1e-13, max_step=1e-3
    )
    assert one.y[2, -1] == pytest.approx(problem.impulse, rel=1e-8)


def test_exact_solution_keeps_its_energy_and_repeats():
    problem = oscillator(0.03)
    t = np.linspace(0.0, 2.0, 20001)
    u, v = problem.displacement(t), problem.velocity(t)
    energy = 50.0 * v**2 + 5e3 * u**2 + 0.5e6 * np.maximum(u - 0.03, 0.0) ** 2
    assert np.abs(energy / problem.energy - 1.0).max() < 1e-12
    assert problem.displacement(t + problem.period) == pytest.approx(u, abs=1e-12)


def test_a_gap_that_never_closes_is_an_error():
    with pytest.raises(ValueError, match="gap is 0.1 m; it must be below 0.1 m"):
        oscillator(0.1)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "gap", [*(pytest.param(g, marks=SLOW) for g in (0.0, 0.03, 0.09)), 0.012, 0.054]
)
def test_energy_error_with_the_steps_of_the_paper(demo, gap):
    """At most 0.1 % (the paper: below 0.6 %), wherever in a step the contact begins.

    A step that closes or opens part-way errs by at most k_stop dt^2 / (4 m) of the energy, 0.044 %
    at dt = T/1500; closing loses what opening gains, so that it hardly adds up.
    """
    problem = oscillator(gap)
    run = demo["march"](problem)
    assert run.time[-1] >= 2.0 * problem.period
    lengths = np.diff(run.time)
    kinds = [problem.free_period / 20, problem.free_period / 1500]
    assert np.all(np.isclose(lengths[:, None], kinds, rtol=1e-9).any(axis=1))
    assert run.energy_error < 1e-3


@pytest.mark.parametrize("gap", [0.0, 0.03])
def test_contact_with_the_steps_of_the_paper(demo, gap):
    """Duration, force and impulse: the contact is 75 short steps long, (1/75)^2 is 2e-4."""
    problem = oscillator(gap)
    duration, force, impulse = demo["first_contact"](problem, demo["march"](problem))
    assert duration == pytest.approx(problem.contact_duration, rel=5e-4)
    assert force == pytest.approx(problem.max_force, rel=5e-4)
    assert impulse == pytest.approx(problem.impulse, rel=5e-4)


@pytest.mark.parametrize("gap", [pytest.param(0.0, marks=SLOW), 0.03])
def test_displacement_converges_with_order_two(demo, gap):
    """Both steps divided by 1, 2, 4 and 8; fitted order, and the error of the coarsest.

    The average-acceleration rule makes a free period longer by (omega dt)^2 / 12, 0.82 % at T/20.
    Two flights of half a period and more are late by 5 to 6 ms, where the mass moves with 1 m/s
    and the amplitude is 0.1 m: 5 to 6 %.
    """
    problem = oscillator(gap)
    errors = [
        demo["displacement_error"](problem, demo["march"](problem, refinement=level))
        for level in demo["LEVELS"]
    ]
    assert errors[0] < 0.065
    assert demo["observed_order"](errors) == pytest.approx(2.0, abs=0.05)


@SLOW
def test_energy_error_falls_with_order_two_or_faster_in_the_worst_case(demo):
    """Over many gaps, that is many places in a step where the contact begins and ends."""
    gaps = np.linspace(0.0, 0.06, 7)
    worst = [
        max(demo["march"](oscillator(gap), refinement=level).energy_error for gap in gaps)
        for level in (1, 4)
    ]
    assert worst[1] < worst[0] / 8.0
