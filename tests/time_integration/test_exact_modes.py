# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that are exact in the lowest modes."""

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("petsc4py")
pytest.importorskip("slepc4py")

from scipy.linalg import eigh, expm

import dolfinx_joints as dj
from dolfinx_joints.exact import ImpactOscillator
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.exact_steps import rescale
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.substeps import Stepper


def vector(system, values):
    v = system.mass.createVecRight()
    v.setArray(np.atleast_1d(np.asarray(values, float)))
    return v


def march(system, lengths, *, exact=0, u0=None, v0=None, kind="auto"):
    """All states of a run in steps of some lengths [s], and its ledger."""
    scheme = dj.EnergyConsistent(exact_modes=exact)
    solver = make_solver(system, None, kind)
    start = {"displacement": u0, "velocity": v0}
    given = {name: vector(system, x) for name, x in start.items() if x is not None}
    states, ledger = [initial_state(solver, dt=lengths[0], **given)], EnergyLedger(system)
    ledger.start(states[0])
    for dt in lengths:
        state, report = scheme.advance(solver, states[-1], dt)
        ledger.record(ledger.after(state, report))
        states.append(state)
    return states, ledger


def displacements(states):
    return np.array([state.displacement.getArray(readonly=True) for state in states])


MASS = np.diag([1.0, 2.0, 1.5])
STIFFNESS = np.array([[3.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 1.0]])
U0, V0 = [0.3, 0.0, 0.1], [0.0, 0.2, 0.0]
# 2 / dt has few bits, so that the scheme takes these steps and no others nearby.
LENGTHS = ([0.25] * 10 + [0.125] * 10) * 6


def push(time):
    return np.array([math.sin(0.7 * time), 0.3 * math.cos(2.0 * time), 0.0])


def exact(damping):
    """Displacements under loads that are linear in each step, by the matrix exponential."""
    inverse, one, none = np.linalg.inv(MASS), np.eye(3), np.zeros((3, 3))
    rows = [[none, one, none, none], [-inverse @ STIFFNESS, -inverse @ damping, inverse, none]]
    matrix = np.block([*rows, [none, none, none, one], [none, none, none, none]])
    y, time, found = np.array(U0 + V0), 0.0, [np.array(U0)]
    for dt in LENGTHS:
        slope = (push(time + dt) - push(time)) / dt
        y = (expm(matrix * dt) @ np.concatenate([y, push(time), slope]))[:6]
        found.append(y[:3])
        time += dt
    return np.array(found)


def driven(damping=None):
    return dj.MatrixSystem.from_arrays(mass=MASS, stiffness=STIFFNESS, damping=damping, load=push)


def test_all_modes_are_exact_under_loads_that_are_linear_in_each_step():
    expected = exact(np.zeros((3, 3)))
    size = np.abs(expected).max()
    plain, _ = march(driven(), LENGTHS, u0=U0, v0=V0)
    states, ledger = march(driven(), LENGTHS, exact=3, u0=U0, v0=V0)
    assert np.abs(displacements(plain) - expected).max() > 0.05 * size
    assert np.abs(displacements(states) - expected).max() < 1e-12 * size
    assert ledger.relative_imbalance < 1e-13


def test_damped_modes_vibrate_exactly_and_answer_to_loads_fifty_times_better():
    # What is left under a load that changes is of the order damping ratio times (omega dt)^2.
    damping = 0.05 * STIFFNESS + 0.02 * MASS
    expected = exact(damping)
    plain, _ = march(driven(damping), LENGTHS, u0=U0, v0=V0)
    states, ledger = march(driven(damping), LENGTHS, exact=3, u0=U0, v0=V0)
    errors = [np.abs(displacements(found) - expected).max() for found in (plain, states)]
    assert errors[1] < errors[0] / 50.0
    assert ledger.relative_imbalance < 1e-13
    # Freely: exp(-0.3 t) cos(wd t) from rest but for the velocity that goes with it.
    system = dj.MatrixSystem.from_arrays(mass=1.0, stiffness=4.0, damping=0.6)
    free, ledger = march(system, [0.25] * 40, exact=1, v0=1.0)
    times, w = 0.25 * np.arange(41), math.sqrt(4.0 - 0.09)
    motion = np.exp(-0.3 * times) * np.sin(w * times)
    found = displacements(free)[:, 0]
    # Its shape, from the first step on; its size by the velocity at the start within 1 %.
    np.testing.assert_allclose(found / found[1], motion / motion[1], atol=1e-11)
    assert found[1] == pytest.approx(math.exp(-0.075) * math.sin(0.25 * w) / w, rel=1e-2)
    assert ledger.relative_imbalance < 1e-14


def rods(joint_stiffness, cells=40):
    """Two rods of unit length and mass, held at their far ends, pressed together.

    Their stiffnesses are 1 and 3, so that the modes of one are not those of the other.

    Returns:
        The system, its static displacement, lowest mode as long as the joint is closed, and its
        circular frequency.
    """
    h, n = 1.0 / cells, cells + 1
    mass, stiffness = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    for i in (*range(cells), *range(n, n + cells)):
        part = slice(i, i + 2)
        mass[part, part] += h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        of_rod = 1.0 if i < n else 3.0
        stiffness[part, part] += of_rod / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
    mass, stiffness = mass[1:-1, 1:-1], stiffness[1:-1, 1:-1]
    gap, overlap = np.zeros((3, 2 * n - 2)), 1.0
    gap[0, cells - 1 : cells + 1] = -1.0, 1.0
    law = dj.FrictionNoTension(
        normal_stiffness=joint_stiffness, shear_stiffness=0.0, friction_angle_deg=0.0
    )
    system = dj.MatrixSystem.from_arrays(
        mass=mass, stiffness=stiffness, gap=gap, law=law, initial_gap=-overlap
    )
    tied = stiffness + joint_stiffness * np.outer(gap[0], gap[0])
    static = np.linalg.solve(tied, joint_stiffness * overlap * gap[0])
    squares, shapes = eigh(tied, mass)
    return system, static, shapes[:, 0] / np.abs(shapes[:, 0]).max(), math.sqrt(squares[0])


@pytest.mark.parametrize("joint_stiffness", [1.0, 1e6])
@pytest.mark.parametrize(("steps", "most", "least"), [(20, 0.10, 5.0), (80, 0.006, 5.0)])
def test_the_phase_of_closed_joints(joint_stiffness, steps, most, least):
    # Midpoint is off by 10 x 2 pi (omega dt)^2 / 12 after ten periods: 0.49 at 20 steps, 0.031 at
    # 80. Modes of the rods without each other make that 5 to 50 times less.
    system, static, shape, omega = rods(joint_stiffness)
    dt, errors = 2.0 * math.pi / omega / steps, []
    for exact_modes in (0, 4):
        states, ledger = march(
            system, [dt] * 10 * steps, exact=exact_modes, u0=static + 0.1 * shape
        )
        moved = (displacements(states) - static) / 0.1
        right = np.cos(omega * dt * np.arange(len(states)))[:, None] * shape
        errors.append(np.abs(moved - right).max())
        assert ledger.relative_imbalance < 1e-10
    velocities = np.array([state.velocity.getArray(readonly=True) for state in states])
    assert errors[0] == pytest.approx({20: 0.49, 80: 0.0315}[steps], rel=0.02)
    assert errors[1] < min(most, errors[0] / least)
    jump = velocities[:, 40] - velocities[:, 39]
    if joint_stiffness == 1e6:  # as good as stuck
        assert np.abs(jump).max() < 1e-3 * np.abs(velocities).max()


@pytest.mark.parametrize("gap", [0.0, 0.03])
def test_a_mass_that_strikes_a_stop(gap):
    # Steps of T/20 in flight and T/1500 near the stop: with midpoint the phase in flight is off by
    # (omega dt)^2 / 12 of the angle, 2 % of the displacement over two periods.
    problem = ImpactOscillator(
        mass=100.0, stiffness=1e4, stop_stiffness=1e6, initial_velocity=1.0, gap=gap
    )
    system = dj.MatrixSystem.from_arrays(
        mass=100.0,
        stiffness=1e4,
        gap=[[-1.0], [0.0], [0.0]],
        initial_gap=gap,
        law=dj.frictionless(normal_stiffness=1e6),
    )
    errors = []
    for scheme in (dj.EnergyConsistent(), dj.EnergyConsistent(exact_modes=1)):
        solver, ledger = make_solver(system), EnergyLedger(system)
        state = initial_state(solver, velocity=vector(system, 1.0))
        ledger.start(state)
        squares, before = 0.0, 0.0
        while state.time < 2.0 * problem.period:
            for part in (20, 1500):
                after, report = scheme.advance(solver, state, problem.free_period / part)
                if state.joints.state.gap[0, 0] > 0.0 and after.joints.state.gap[0, 0] > 0.0:
                    break
            ledger.record(ledger.after(after, report))
            error = after.displacement.array[0] - problem.displacement(after.time)
            squares += 0.5 * report.dt * (error**2 + before**2)
            state, before = after, error
        errors.append(math.sqrt(squares / state.time) / problem.amplitude)
        assert ledger.relative_imbalance < 1e-12
    assert errors[0] > 0.02
    assert errors[1] < 1e-4


def test_lengths_of_steps_keep_the_energy_of_the_body():
    # Velocities are scaled for each length, and back if a scheme without exact modes follows.
    system, _, shape, _ = rods(1e6)
    states, ledger = march(system, [0.1, 0.05, 0.2, 0.025] * 5, exact=4, v0=shape)
    assert ledger.relative_imbalance < 1e-12
    last = states[-1]
    back = rescale(system, last, 0, 0.0)
    assert back.velocity.norm() != pytest.approx(last.velocity.norm(), rel=1e-6)
    assert back.kinetic_energy == pytest.approx(last.kinetic_energy, rel=1e-13)
    np.testing.assert_allclose(back.momentum.array, (system.mass * back.velocity).array, rtol=1e-12)
    same = rescale(system, back, 4, last.rate)
    np.testing.assert_allclose(same.velocity.array, last.velocity.array, rtol=1e-12, atol=1e-13)


def test_steps_in_flight_are_as_long_as_allowed():
    # What the local error counts is what contact and loads leave: free vibration is exact.
    system = dj.MatrixSystem.from_arrays(mass=1.0, stiffness=1.0)
    counts = []
    for exact_modes in (0, 1):
        solver, ledger = make_solver(system), EnergyLedger(system)
        state = initial_state(solver, velocity=vector(system, 1.0))
        ledger.start(state)
        control = dj.StepControl(tolerance=1e-4)
        steps = Stepper(dj.EnergyConsistent(exact_modes=exact_modes), solver, ledger, control)
        for _ in range(30):
            for after, _, row in steps.substeps(state, 0.2):
                state = after
                ledger.record(row)
        counts.append(steps.counts.accepted)
        assert state.time == pytest.approx(6.0)
    assert counts[0] > 60
    assert counts[1] < 40


@pytest.mark.parametrize("kind", ["condensed", "monolithic"])
def test_the_balance_with_all_at_once(kind):
    # Moving supports, loads, damping that couples modes, friction, lengths of steps that change.
    rng = np.random.default_rng(8)
    a, b, c = rng.normal(size=(3, 6, 6))
    law = dj.FrictionNoTension(normal_stiffness=1e4, shear_stiffness=5e3, friction_angle_deg=30.0)
    system = dataclasses.replace(
        dj.MatrixSystem.from_arrays(
            mass=a @ a.T + 6.0 * np.eye(6),
            stiffness=100.0 * (b @ b.T + np.eye(6)),
            damping=0.3 * c @ c.T,
            load=lambda t: 300.0 * np.sin([30 * t, 20 * t, 25 * t, 40 * t, 10 * t, 5 * t]),
            gap=rng.normal(size=(6, 6)),
            law=law,
        ),
        constrained=np.array([0, 2]),
        values=lambda t: np.array([np.sin(7 * t) + t**3, abs(t - 0.31)]),
    )
    found = []
    for exact_modes in (0, 3):
        _, ledger = march(system, [0.01, 0.02, 0.005, 0.04] * 20, exact=exact_modes, kind=kind)
        assert ledger.relative_imbalance < 1e-11
        assert ledger.row.friction > 0.0
        found.append(ledger.row.viscous)
    assert found[0] != pytest.approx(found[1], rel=1e-6)


def test_equal_modes_are_taken_together():
    # Of two equal oscillators neither comes first; 2, 2 and 3 rad/s: two modes or all.
    system = dj.MatrixSystem.from_arrays(mass=np.eye(3), stiffness=np.diag([4.0, 4.0, 9.0]))
    with pytest.raises(
        ValueError, match="exact_modes is 1, but .* equal frequencies; give at least 2"
    ):
        march(system, [0.25], exact=1)
    for given, used in ((2, 2), (3, 3), (50, 3)):
        march(system, [0.25], exact=given)
        assert len(system.lowest_modes[given].frequencies) == used
    assert system.lowest_modes[3].step(8.0).used == 3  # 3 rad/s times 0.25 s
    assert system.lowest_modes[3].step(3.0).used == 2  # times 0.67 s, more than 1.5
    # Steps that take no mode are those of the plain scheme.
    plain, exact = (march(system, [2.0] * 3, exact=n, v0=[1.0, 2.0, 3.0])[0] for n in (0, 3))
    np.testing.assert_array_equal(displacements(plain), displacements(exact))


def test_equal_modes_that_damping_couples():
    # Masses that swing alike, a dashpot between them and on each: (1, 1) has c, (1, -1) c + 2 d.
    # Each vibrates exactly, q_2 = 2 exp(-c T/2) cos(w T) q_1 - exp(-c T) q_0, whatever modes of the
    # pair were found.
    c, d, length = 0.2, 0.3, 0.25
    damping = np.array([[c + d, -d], [-d, c + d]])
    system = dj.MatrixSystem.from_arrays(mass=np.eye(2), stiffness=4.0 * np.eye(2), damping=damping)
    states, _ = march(system, [length] * 8, exact=2, u0=[1.0, 0.2])
    np.testing.assert_allclose(system.lowest_modes[2].damping, [c, c + 2.0 * d], rtol=1e-12)
    amounts = displacements(states)[1:] @ np.array([[1.0, 1.0], [1.0, -1.0]])
    for q, rate in zip(amounts.T, (c, c + 2.0 * d), strict=True):
        w, decay = math.sqrt(4.0 - 0.25 * rate**2), math.exp(-0.5 * rate * length)
        expected = 2.0 * decay * math.cos(w * length) * q[1:-1] - decay**2 * q[:-2]
        np.testing.assert_allclose(q[2:], expected, rtol=0, atol=1e-12)


def test_a_loose_mass_under_a_growing_load():
    # u = t^3 / 6 beside a mass on a spring; midpoint is off by t dt^2 / 12.
    system = dj.MatrixSystem.from_arrays(
        mass=np.eye(2), stiffness=np.diag([0.0, 4.0]), load=lambda t: [t, 0.0]
    )
    for exact_modes, error in ((0, 0.25**2 / 12.0), (1, 0.0)):
        states, _ = march(system, [0.25] * 4, exact=exact_modes)
        assert displacements(states)[-1, 0] - 1.0 / 6.0 == pytest.approx(error, rel=1e-6, abs=1e-13)


def test_refusals():
    skew = dataclasses.replace(driven(), symmetric=False)
    with pytest.raises(dj.JointsError, match="exact_modes needs symmetric matrices"):
        march(skew, [0.25], exact=1)
    assert dj.EnergyConsistent(exact_modes=1).conserves(driven())


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["condensed", "monolithic", "moving base"])
def test_a_wall_on_any_number_of_ranks(comm, wall_file, read, solver):
    # Joints that open and slide, mass redistributed, steps cut: the same on one rank alone. On a
    # moving base modes carry momentum of it, whose nodes and whose joints are on several ranks.
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    from shaken_wall import DT, shaking, wall

    from dolfinx_joints import Body, Fixed, Prescribed, Simulation

    given, options = {"motion": shaking, "control": dj.StepControl(tolerance=1e-2)}, {}
    if solver == "moving base":
        path = lambda t: 0.03 * (1.0 - math.cos(20.0 * t))  # noqa: E731
        moves = Prescribed(group="base", component="x", value=path)
        solver, given = "auto", {}
        options = {"supports": [Fixed(group="base", components="yz"), moves]}
    found = []
    for on in (comm, MPI.COMM_SELF):
        model = wall(read(wall_file(), on), body=Body(redistribute_mass=True), **options)
        simulation = Simulation(model, solver=solver)
        simulation.statics()
        scheme = dj.EnergyConsistent(exact_modes=20)
        outcome = simulation.dynamics(dt=DT, steps=8, scheme=scheme, **given)
        assert outcome.counts.accepted > 8 or not given
        assert outcome.imbalance < 1e-12
        row = outcome.energy
        found.append([row.kinetic, row.strain, row.friction, row.viscous, row.input])
    assert found[0][2] > 0.0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)
