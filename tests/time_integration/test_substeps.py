# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that are cut: where a solve fails, where energy is missing, for accuracy, at contact."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints import (
    ConvergenceError,
    EnergyConsistent,
    FrictionNoTension,
    GeneralizedAlpha,
    ImplicitContact,
    JointsError,
    MatrixSystem,
    StepControl,
)
from dolfinx_joints.exact import ImpactOscillator
from dolfinx_joints.laws.law import DISCRETE_GRADIENT
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import StepCounts, Stepper, ends_of_steps, locate


class Reluctant:
    """A scheme that fails at steps longer than ``limit(time)`` and keeps count."""

    rule, forces_over_steps = DISCRETE_GRADIENT, True

    def conserves(self, system: Any) -> bool:
        return self.scheme.conserves(system)

    def __init__(self, limit, error=None, scheme=None):
        self.limit, self.taken, self.scheme = limit, [], scheme or EnergyConsistent()
        self.error = ConvergenceError(iteration=3, residual=1.0) if error is None else error

    def advance(self, solver: Any, state: DynamicState, dt: float, end: float):
        if dt > self.limit(state.time) * (1 + 1e-12):
            raise self.error
        self.taken.append((state.time, dt))
        return self.scheme.advance(solver, state, dt, end)


def vector(system, values):
    v = system.mass.createVecRight()
    v.setArray(np.atleast_1d(np.asarray(values, float)))
    return v


def stepper(scheme, system=None, control=None, *, time=0.0, v0=1.0):
    """A stepper of a mass on a spring (or of a system), its ledger, and its first state."""
    system = system or MatrixSystem.from_arrays(mass=1.0, stiffness=1.0)
    solver = make_solver(system)
    state = initial_state(solver, time=time, velocity=vector(system, v0))
    ledger = EnergyLedger(system)
    ledger.start(state)
    return Stepper(scheme, solver, ledger, control or StepControl()), ledger, state


def take(work, dt):
    """The states of one step; ``work`` is what `stepper` gave, its state is not replaced."""
    steps, ledger, start = work
    states = []
    for state, _, row in steps.substeps(start, dt):
        ledger.record(row)
        states.append(state)
    return states


def test_times_of_steps_have_no_digits_of_rounding():
    # 900 sums of 0.005 are 4.499999999999926, and 3 * 0.1 is 0.30000000000000004.
    assert ends_of_steps(0.0, 0.005, 900)[-1] == 4.5
    assert ends_of_steps(0.0, 0.1, 3).tolist() == [0.0, 0.1, 0.2, 0.3]
    assert ends_of_steps(4.5, 0.005, 20)[-1] == 4.6


@pytest.mark.parametrize(("limit", "count"), [(1.0, 1), (0.1, 1), (0.06, 2), (0.02, 8)])
def test_halving_carries_through_and_ends_on_time(limit, count):
    scheme = Reluctant(lambda time: limit)
    states = take(stepper(scheme, time=0.3), 0.1)
    assert len(states) == count
    assert states[-1].time == 0.3 + 0.1  # to the last bit, however it was divided
    levels = np.log2(0.1 / np.array([dt for _, dt in scheme.taken]))
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-9)
    assert sum(dt for _, dt in scheme.taken) == pytest.approx(0.1, rel=1e-12)


def test_halving_grows_back():
    # Short steps are needed in the first eighth only; afterwards the substeps double again:
    # 1/8, 1/8, 1/4, 1/2.
    scheme = Reluctant(lambda time: 0.125 if time < 0.1 else 1.0)
    take(stepper(scheme, control=StepControl(max_halvings=3)), 1.0)
    assert [dt for _, dt in scheme.taken] == [0.125, 0.125, 0.25, 0.5]


def test_many_steps_keep_the_clock():
    steps, ledger, state = stepper(Reluctant(lambda time: 0.003))
    for _ in range(100):
        state = take((steps, ledger, state), 0.01)[-1]
    assert state.time == pytest.approx(1.0, rel=1e-13)
    assert steps.counts.accepted == 400
    assert steps.counts.failed == steps.counts.rejected > 0


@pytest.mark.parametrize("scheme", [EnergyConsistent(), ImplicitContact(), GeneralizedAlpha()])
@pytest.mark.parametrize("limit", [1.0, 0.006])
def test_whoever_asks_for_a_time_gets_the_same_number(scheme, limit):
    """Loads may jump at the end of a step: 0.07 and the sum of seven steps are not to be both."""
    asked = set()

    def load(time):
        asked.add(time)
        return [1.0 if time < 0.07 else 0.0]

    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, load=load)
    steps, ledger, state = stepper(Reluctant(lambda time: limit, scheme=scheme), system)
    for end in ends_of_steps(0.0, 0.01, 750)[1:]:
        for after, _, row in steps.substeps(state, 0.01, float(end)):
            ledger.record(row)
            state = after
    assert np.diff(sorted(asked)).min() > 1e-3


def test_exhausted_halving_says_when():
    scheme = Reluctant(lambda time: 1e-9 if time > 0.49 else 1.0)
    with pytest.raises(ConvergenceError) as failure:
        take(stepper(scheme, control=StepControl(max_halvings=2), time=0.5), 0.1)
    assert failure.value.time == pytest.approx(0.525)  # the end of the shortest step
    assert failure.value.iteration == 3
    whole = locate(failure.value, stage="dynamic", step=7)
    assert (whole.stage, whole.step, whole.time) == ("dynamic", 7, failure.value.time)
    assert str(whole).startswith("The dynamic stage, step 7, at t = 0.525 s did not converge in 3")
    assert len(scheme.taken) == 0


@pytest.mark.parametrize("error", [JointsError("The matrix is singular."), ZeroDivisionError()])
def test_what_no_shorter_step_mends_is_raised_at_once(error):
    with pytest.raises(type(error)):
        take(stepper(Reluctant(lambda time: 0.05, error=error)), 0.1)


class Leaky(Reluctant):
    """A scheme that loses some kinetic energy in steps longer than its limit."""

    def advance(self, solver: Any, state: DynamicState, dt: float, end: float):
        after, report = EnergyConsistent().advance(solver, state, dt, end)
        if dt > self.limit(state.time) * (1 + 1e-12):
            momentum = after.momentum.copy()
            momentum.scale(1.0 - 1e-8)
            after = replace(after, momentum=momentum)
        return after, report


def test_missing_energy_is_a_failed_solve():
    work = stepper(Leaky(lambda time: 0.03))
    assert len(take(work, 0.1)) == 4
    assert work[0].counts.unbalanced == 3  # 0.1 s, 0.05 s, and 0.05 s again at half time
    # 1e-8 of the momentum is as much of the kinetic energy, momentum times velocity, which a
    # twentieth of a second after the start is nearly all there is.
    said = "t = 0.05 s does not close: the imbalance is 1.0e-08 of the largest energy; the limit"
    with pytest.raises(JointsError, match=said):
        take(stepper(Leaky(lambda time: 0.0), control=StepControl(max_halvings=1)), 0.1)


def test_missing_energy_names_the_joint_that_did_most():
    law = FrictionNoTension(normal_stiffness=1e3, shear_stiffness=0.0, friction_angle_deg=0.0)
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=[[1.0], [0.0], [0.0]], law=law)
    name = system.contact.operator.names[0]
    leaky = Leaky(lambda time: 0.0)
    with pytest.raises(JointsError, match=rf"close \(joint '{name}' has the largest"):
        take(stepper(leaky, system, StepControl(max_halvings=0), v0=-1.0), 0.01)


def test_nothing_lands_without_joints():
    work = stepper(Reluctant(lambda time: 1.0), control=StepControl(max_halvings=3, landing=True))
    assert len(take(work, 0.1)) == 1
    assert (work[0].counts.crossed, work[0].counts.landed) == (0, 0)


OSCILLATOR = ImpactOscillator(
    mass=100.0, stiffness=1e4, stop_stiffness=1e8, initial_velocity=1.0, gap=0.03
)


def bounce(dt, periods, control, scheme=None):
    """A mass that strikes a stop again and again: largest displacement error, counts, ledger."""
    law = FrictionNoTension(normal_stiffness=1e8, shear_stiffness=0.0, friction_angle_deg=0.0)
    system = MatrixSystem.from_arrays(
        mass=100.0, stiffness=1e4, gap=[[-1.0], [0.0], [0.0]], law=law, initial_gap=0.03
    )
    steps, ledger, state = stepper(scheme or EnergyConsistent(), system, control)
    error = 0.0
    for _ in range(round(periods * OSCILLATOR.period / dt)):
        substeps = take((steps, ledger, state), dt)
        for substep in substeps:
            exact = OSCILLATOR.displacement(substep.time)
            error = max(error, abs(substep.displacement.array[0] - exact) / OSCILLATOR.amplitude)
        state = substeps[-1]
    return error, steps.counts, ledger


def test_landing_and_tolerance_make_an_impact_accurate():
    """A fixed step errs by its share of a bounce; cut at contact, by the phase of its length.

    The phase of the trapezoidal rule grows by (w dt)^2 / 12 of an angle: over 2 periods of w dt =
    2 pi / 100 by 4.1e-3 of the amplitude.
    """
    dt = OSCILLATOR.free_period / 100
    plain, _, ledger = bounce(dt, 2, StepControl())
    cut, counts, other = bounce(dt, 2, StepControl(max_halvings=8, tolerance=1e-4, landing=True))
    assert plain > 0.05
    assert cut < 6e-3
    assert counts.landed >= 4
    assert counts.accepted < 400
    assert ledger.relative_error < 1e-11
    assert other.relative_error < 1e-11


def test_the_shortest_step_is_taken_as_it_is():
    """However small the tolerance, and at contact too: no endless halving. Every try is counted."""
    dt, tried = OSCILLATOR.free_period / 50, Reluctant(lambda time: np.inf)
    control = StepControl(max_halvings=2, tolerance=1e-12, landing=True)
    _, counts, _ = bounce(dt, 1, control, tried)
    assert counts.accepted <= 4 * round(OSCILLATOR.period / dt)
    assert counts.inaccurate > 0
    assert counts.accepted + counts.inaccurate + counts.crossed == len(tried.taken)


def test_a_point_that_stays_at_zero_has_not_landed():
    # Nothing moves: the gap is zero, closed, before and after.
    law = FrictionNoTension(normal_stiffness=1e8, shear_stiffness=0.0, friction_angle_deg=0.0)
    gap = [[-1.0], [0.0], [0.0]]
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=gap, law=law)
    work = stepper(EnergyConsistent(), system, StepControl(landing=True), v0=0.0)
    take(work, 0.1)
    assert work[0].counts == StepCounts(accepted=1)


def test_rejected_attempts_are_of_four_kinds():
    counts = StepCounts(accepted=50, landed=9, failed=1, unbalanced=2, inaccurate=3, crossed=4)
    assert counts.rejected == 1 + 2 + 3 + 4
