# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where every joule goes: the energy balance of steps of any length, joints of any stiffness.

      |\\/\\/\\/[ m ]->| k_n          [ M, K, C ]=|k_n, k_s, mu|=         |  |  |  |  blocks on a
      spring         stop           loads F(t)  joints a and b          |__|__|__|  clamped base

With the forces at mid-step and the work-conjugate traction of the joints, each step satisfies

    change of (kinetic + strain + joint energy) = F_mid . x - x . C x / dt - friction,

x being the change of the displacement: an identity of the scheme, not an approximation. So the
expected imbalance is rounding, that is 1e-16 times the number of steps times what stiff joints
amplify. The condensed solver keeps 1e-11 at any stiffness. The monolithic one computes tractions
from gaps and loses their digits as joints get stiffer than the body: it is asked up to 1e4 times.
The terms are also computed anew from the states with NumPy, point by point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("petsc4py")

import dolfinx_joints as dj
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger, EnergyRow
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.scheme import StepReport
from dolfinx_joints.time_integration.states import DynamicState
from dolfinx_joints.time_integration.substeps import Stepper

SOLVERS = ["condensed", "monolithic"]
SHARES = (1e-4, 1e-2, 0.1, 1.0)  # step lengths over the longest period
CASES = [(ratio, "condensed") for ratio in (1.0, 1e4, 1e8, 1e12)]
CASES += [(ratio, "monolithic") for ratio in (1.0, 1e2, 1e4)]


@dataclass(frozen=True)
class Run:
    """A run: ledger, its rows, the states, and the reports of the steps between them."""

    ledger: EnergyLedger
    rows: list[EnergyRow]
    states: list[DynamicState]
    reports: list[StepReport]

    def line(self, name: str) -> np.ndarray:
        """One line of the ledger at all times, [J]."""
        return np.array([getattr(row, name) for row in self.rows])


def march(system, scheme, dt, steps, *, kind="auto", v0=None) -> Run:
    """Take equal steps, cut only where their solve fails."""
    solver = make_solver(system, dj.SolverOptions(relative_tolerance=1e-13), kind)
    velocity = None
    if v0 is not None:
        velocity = system.mass.createVecRight()
        velocity.setArray(np.atleast_1d(np.asarray(v0, float)))
    states = [initial_state(solver, velocity=velocity)]
    ledger = EnergyLedger(system)
    rows, reports = [ledger.start(states[0])], []
    stepper = Stepper(scheme, solver, ledger, dj.StepControl())
    for _ in range(steps):
        for state, report, row in stepper.substeps(states[-1], dt):
            rows.append(ledger.record(row))
            states.append(state)
            reports.append(report)
    return Run(ledger, rows, states, reports)


# Impact of a mass: 100 kg on 1e4 N/m at 1 m/s, its stop `ratio` times as stiff as the spring.

MASS, SPRING = 100.0, 1e4
PERIOD = 2.0 * math.pi * math.sqrt(MASS / SPRING)


def stop(law, gap) -> dj.MatrixSystem:
    return dj.MatrixSystem.from_arrays(
        mass=MASS, stiffness=SPRING, gap=[[-1.0], [0.0], [0.0]], law=law, initial_gap=gap
    )


@pytest.mark.parametrize(("ratio", "kind"), CASES)
@pytest.mark.parametrize("gap", [0.0, 0.03])
def test_impact(gap, ratio, kind):
    """All of the energy of the start, 50 J, is there at any time.

    Monolithic solves stop at 1e-13 of the forces, some 1e-12 of the energy in each of 60 steps.
    """
    bound = 1e-11 if kind == "condensed" else 1e-10
    for share in SHARES:
        system = stop(dj.frictionless(normal_stiffness=ratio * SPRING), gap)
        run = march(system, dj.EnergyConsistent(), share * PERIOD, 60, kind=kind, v0=1.0)
        np.testing.assert_allclose(run.line("stored"), 50.0, rtol=bound)
        assert run.ledger.relative_imbalance <= bound
        assert not run.line("friction").any()
        touched = run.line("joint").max() > 0.0
        assert touched or (gap > 0.0 and share == 1e-4)


@pytest.mark.parametrize("share", SHARES)
def test_impact_on_a_rigid_stop(share):
    law = dj.RigidJoint(friction_angle_deg=0.0)
    run = march(stop(law, 0.03), dj.EnergyConsistent(), share * PERIOD, 60, v0=1.0)
    np.testing.assert_allclose(run.line("stored"), 50.0, rtol=1e-12)
    place = np.array([state.displacement.array[0] for state in run.states])
    assert place.max() <= 0.03 + 1e-15


# The loss of the implicit scheme in one step from g0 to g1 is t1 (g1 - g0) - psi1 + psi0 with
# t1 = k <g1>: not negative since psi is convex. k (g1 - g0)^2 / 2 where closed before and after.


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("ratio", [1.0, 1e4, 1e8, 1e12])
def test_implicit_contact_never_gains(ratio, share):
    stiffness = ratio * SPRING
    system = stop(dj.frictionless(normal_stiffness=stiffness), 0.01)
    run = march(system, dj.ImplicitContact(), share * PERIOD, 60, v0=1.0)
    lost = np.diff(run.line("numerical"))
    assert lost.min() >= -1e-12 * 50.0
    gap = np.array([state.joints.state.gap[0, 0] for state in run.states])
    closed = np.minimum(gap, 0.0)
    energy = 0.5 * stiffness * closed**2
    by_hand = stiffness * closed[1:] * np.diff(gap) - np.diff(energy)
    np.testing.assert_allclose(lost, by_hand, rtol=0, atol=1e-11 * 50.0)
    both = (gap[1:] < 0) & (gap[:-1] < 0)
    square = 0.5 * stiffness * np.diff(gap) ** 2
    np.testing.assert_allclose(lost[both], square[both], rtol=0, atol=1e-11 * 50.0)
    assert run.ledger.relative_imbalance <= 1e-12
    if share >= 1e-2:
        assert run.rows[-1].stored < 50.0


# Random bodies with two joints of three points each.

SIZE = 24  # dofs


def friction(ratio, angle=30.0) -> dj.FrictionNoTension:
    """Friction of a joint ``ratio`` times as stiff as the bodies."""
    return dj.FrictionNoTension(
        normal_stiffness=1e4 * ratio, shear_stiffness=5e3 * ratio, friction_angle_deg=angle
    )


def body(seed, ratio, *, laws=None, damping=0.0, push=1.0) -> dj.MatrixSystem:
    """Loads make joints open, stick and slide; areas of the points are not alike.

    More dofs than joint unknowns: tractions would not be determined where all stick, rigidly.
    """
    rng = np.random.default_rng(seed)
    size = SIZE
    a, b = rng.normal(size=(2, size, size))
    mass, stiffness = a @ a.T + size * np.eye(size), 1e4 * (b @ b.T + np.eye(size))
    arm, rate = rng.normal(size=size), rng.uniform(20.0, 60.0, size)
    law = friction(ratio)
    system = dj.MatrixSystem.from_arrays(
        mass=mass,
        stiffness=stiffness,
        damping=damping * stiffness,
        load=lambda t: 1e3 * push * arm * np.sin(rate * t),
        gap=rng.normal(size=(18, size)) / math.sqrt(size),
        law=law,
        areas=rng.uniform(0.2, 2.0, 6),
    )
    return in_two(system, laws or law)


def in_two(system, laws) -> dj.MatrixSystem:
    """The same with points 0, 1, 2 in joint a and 3, 4, 5 in joint b."""
    from dolfinx_joints.joints.operator import GapOperator

    operator = system.contact.operator
    parted = GapOperator(operator.matrix, operator.areas, np.repeat([0, 1], 3), ("a", "b"))
    return replace(system, contact=Contact(parted, laws, {"a": 0.001}))


def dense(matrix) -> np.ndarray:
    rows, columns = matrix.getSize()
    return matrix.getValues(range(rows), range(columns))


def longest_period(system) -> float:
    squares = np.linalg.eigvals(np.linalg.solve(dense(system.mass), dense(system.stiffness)))
    return 2.0 * math.pi / math.sqrt(squares.real.min())


def by_hand(system, run, law) -> dict[str, Any]:
    """Energies and works of a run from matrices, states and the formulae, joint by joint."""
    m, c, k = (dense(x) for x in (system.mass, system.damping, system.stiffness))
    u = np.array([state.displacement.array for state in run.states])
    v = np.array([state.velocity.array for state in run.states])
    f = np.array([state.load.array for state in run.states])
    dt = np.array([report.dt for report in run.reports])
    gap = np.array([state.joints.state.gap for state in run.states])
    slip = np.array([state.joints.state.elastic_slip for state in run.states])
    traction = np.array([state.joints.traction for state in run.states[1:]])
    w = system.contact.operator.areas
    x = np.diff(u, axis=0)
    density = 0.5 * law.normal_stiffness * np.minimum(gap[:, :, 0], 0.0) ** 2
    density += 0.5 * law.shear_stiffness * np.sum(slip**2, axis=2)
    work = w * np.sum(traction * np.diff(gap, axis=0), axis=2)
    joint = (w * density).reshape(len(u), 2, 3).sum(axis=2)
    taken = work.reshape(len(x), 2, 3).sum(axis=2).cumsum(axis=0)
    return {
        "kinetic": 0.5 * np.einsum("ti,ij,tj->t", v, m, v),
        "strain": 0.5 * np.einsum("ti,ij,tj->t", u, k, u),
        "joint_elastic": joint,
        "input": np.append(0.0, np.cumsum(np.sum(0.5 * (f[1:] + f[:-1]) * x, axis=1))),
        "viscous": np.append(0.0, np.cumsum(np.einsum("ti,ij,tj->t", x, c, x) / dt)),
        "joint_friction": np.vstack([np.zeros(2), taken - (joint[1:] - joint[0])]),
    }


@pytest.mark.parametrize(("ratio", "kind"), CASES)
def test_lines_of_the_ledger(ratio, kind):
    """Each line, joint by joint, from the states; friction as what joints took and do not hold."""
    system = body(1, ratio, damping=1e-4)
    law = friction(ratio)
    run = march(system, dj.EnergyConsistent(), longest_period(system) / 50, 100, kind=kind)
    assert {int(s) for state in run.states for s in state.joints.status} == {0, 1, 2}
    scale = run.ledger.scale
    for name, expected in by_hand(system, run, law).items():
        # The scheme shortens 2/dt to 26 bits, so that its square is exact.
        close = 2e-8 if name == "viscous" else 0.0
        np.testing.assert_allclose(run.line(name), expected, rtol=close, atol=1e-10 * scale)
    last = run.rows[-1]
    assert last.friction == pytest.approx(last.joint_friction.sum(), rel=1e-14)
    assert last.joint == pytest.approx(last.joint_elastic.sum(), rel=1e-14)
    assert np.all(last.joint_friction > 0.01 * scale)
    stored, paid = last.kinetic + last.strain + last.joint, last.viscous + last.friction
    assert abs(stored - run.rows[0].stored - last.input + paid) <= 1e-10 * scale


@pytest.mark.parametrize(("ratio", "kind"), CASES)
def test_random_bodies(ratio, kind):
    """Any step, damped or not; friction takes and never gives."""
    largest = 0.0
    for seed, share in enumerate(SHARES):
        system = body(seed, ratio, damping=1e-4 * (seed % 2))
        rng = np.random.default_rng(seed)
        run = march(
            system,
            dj.EnergyConsistent(),
            share * longest_period(system),
            40,
            kind=kind,
            v0=rng.normal(size=SIZE),
        )
        largest = max(largest, run.ledger.relative_imbalance)
        rubbed = np.diff(run.line("joint_friction"), axis=0)
        assert rubbed.min() >= -1e-13 * run.ledger.scale
        assert np.abs(run.line("joint_numerical")).max() <= 1e-10 * run.ledger.scale
    assert largest <= 1e-10


@pytest.mark.parametrize("ratio", [1.0, 1e4, 1e8])
def test_keys_and_friction_in_one_body(ratio):
    """Two laws, one for each joint: the keyed joint takes nothing."""
    law = friction(ratio)
    keys = dj.KeyedJoint(normal_stiffness=2e4 * ratio, shear_stiffness=1e4 * ratio)
    system = body(2, ratio, laws={"a": law, "b": keys})
    run = march(system, dj.EnergyConsistent(), longest_period(system) / 20, 100)
    assert run.ledger.relative_imbalance <= 1e-11
    assert run.rows[-1].joint_friction[0] > 0.0
    assert run.rows[-1].joint_friction[1] == 0.0


@pytest.mark.parametrize(("ratio", "kind"), [(1.0, "monolithic"), (1e3, "condensed")])
def test_shear_keys(ratio, kind):
    """Flanks some mm high are met and ridden over in joint a, sheared off in joint b."""
    strong = dj.ShearKeyJoint(
        normal_stiffness=1e4 * ratio,
        shear_stiffness=5e3 * ratio,
        friction_angle_deg=30.0,
        depth=0.01,
        flank_angle_deg=35.0,
        spacing=0.1,
        tooth_cohesion=1e9,
        forward_play=1e-3,
        key_axis=(0.6, 0.8),
    )
    laws = {"a": strong, "b": replace(strong, tooth_cohesion=50.0)}
    system = body(4, ratio, laws=laws)
    run = march(system, dj.EnergyConsistent(), longest_period(system) / 200, 150, kind=kind)
    states = [state.joints for state in run.states]
    assert any(((j.state.gap[:3, 0] > 1e-3) & (j.traction[:3, 0] < 0.0)).any() for j in states)
    broken = states[-1].state.internal[:, 0].reshape(2, 3).sum(axis=1)
    assert broken[0] == 0.0
    assert broken[1] > 0.0
    assert run.ledger.relative_imbalance <= 1e-10
    assert np.abs(run.line("joint_numerical")).max() <= 1e-10 * run.ledger.scale
    assert run.rows[-1].friction > 0.0


@pytest.mark.parametrize("ratio", [1.0, 1e2, 1e4])
def test_both_solvers_take_the_same_step(ratio):
    """From the states of one run, so that nothing adds up over the steps."""
    system = body(3, ratio)
    scheme, dt = dj.EnergyConsistent(), longest_period(system) / 40
    run = march(system, scheme, dt, 80, v0=np.arange(SIZE) - 11.5)
    options = dj.SolverOptions(relative_tolerance=1e-13)
    solvers = [make_solver(system, options, kind) for kind in SOLVERS]
    largest = max(float(np.abs(s.displacement.array).max()) for s in run.states)
    worst = 0.0
    for state in run.states[:-1]:
        one, two = (scheme.advance(solver, state, dt)[0] for solver in solvers)
        change = np.abs(one.displacement.array - two.displacement.array).max()
        worst = max(worst, float(change) / largest)
        np.testing.assert_array_equal(one.joints.status, two.joints.status)
    assert worst <= 1e-9


@pytest.mark.parametrize("kind", SOLVERS)
@pytest.mark.parametrize("ratio", [1.0, 1e4])
def test_where_all_stick_it_is_newmark(ratio, kind):
    """Pressed together by 1 kN per point and shaken so gently that nothing opens or slides.

    Both are the trapezoidal rule then, written in other variables.
    """
    size = 6
    rng = np.random.default_rng(4)
    b = rng.normal(size=(size, size))
    stiffness = 1e4 * (b @ b.T + np.eye(size))
    gap = np.eye(size) + 0.2 * rng.normal(size=(size, size))
    pressed = np.zeros(size)
    pressed[::3] = -1e3 / (1e4 * ratio)
    law = friction(ratio, angle=60.0)
    rest = np.linalg.solve(gap, pressed)
    hold = stiffness @ rest + gap.T @ (1e4 * ratio * pressed)
    system = dj.MatrixSystem.from_arrays(
        mass=np.eye(size),
        stiffness=stiffness,
        damping=1e-4 * stiffness,
        load=lambda t: hold + 10.0 * np.sin(40.0 * t) * np.arange(1, size + 1),
        gap=gap,
        law=law,
    )
    start = system.mass.createVecRight()
    start.setArray(rest)
    paths = []
    for scheme in (dj.EnergyConsistent(), dj.Newmark()):
        solver = make_solver(system, dj.SolverOptions(relative_tolerance=1e-13), kind)
        state, path = initial_state(solver, displacement=start), []
        for _ in range(150):
            state, _ = scheme.advance(solver, state, 2e-3)
            assert np.all(state.joints.status == 1)
            path.append([state.displacement.array.copy(), state.velocity.array.copy()])
        paths.append(np.array(path))
    size_of = np.abs(paths[0] - [[rest, 0 * rest]]).max(axis=(0, 2), keepdims=True)
    difference = float((np.abs(paths[0] - paths[1]) / size_of).max())
    assert difference <= 1e-9


# A small wall of three blocks on a clamped base under its own weight, shaken by half of g.


def shaking(time):
    """Ground acceleration [m/s^2]."""
    return 5.0 * np.array([np.sin(40.0 * time), np.sin(25.0 * time), 0.6 * np.sin(55.0 * time)])


@pytest.mark.mpi
@pytest.mark.parametrize("dt", [0.001, 0.05])
@pytest.mark.parametrize(
    ("stiffness", "kind"),
    [(1e9, "condensed"), (1e11, "condensed"), (1e15, "condensed"), (1e11, "monolithic")],
)
def test_wall(wall_file, read, stiffness, kind, dt):
    """Solid, supports and friction: all lines add up, and the works of supports are one of them."""
    from boxes import Rows
    from shaken_wall import wall

    law = dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=0.4 * stiffness, friction_angle_deg=30.0
    )
    model = wall(read(wall_file(divisions=(6, 2, 3), joints=2)), law)
    seen = Rows(lambda record: (record.energy, record.solve and record.solve.counts))
    newton = dj.SolverOptions(relative_tolerance=1e-12)
    simulation = dj.Simulation(model, solver=kind, options=newton, monitors=[seen])
    simulation.statics()
    outcome = simulation.dynamics(dt=dt, steps=50, motion=shaking)
    assert outcome.solver == kind
    assert outcome.imbalance <= 1e-10
    assert outcome.energy_error <= 1e-10
    rows, (_, *counts) = zip(*seen.rows, strict=True)
    assert any(each.open for each in counts)
    assert any(each.slip for each in counts)
    rubbed = np.diff([row.joint_friction for row in rows], axis=0)
    scale = max(row.stored + row.viscous + row.friction for row in rows)
    assert rubbed.shape[1] == 2
    assert rubbed.min() >= -1e-12 * scale
    assert rows[-1].friction > 1e-4 * scale
