# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spectral radius of energy-consistent steps in all that they do not take exactly."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("petsc4py")
pytest.importorskip("slepc4py")

from scipy.linalg import eigh

from dolfinx_joints import EnergyConsistent, FrictionNoTension, MatrixSystem, RigidJoint
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state

MASS = np.diag([1.0, 2.0, 1.5])
STIFFNESS = np.array([[3.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 1.0]])


def march(system, lengths, *, u0=None, v0=None, kind="auto", **scheme):
    """All states of a run in steps of some lengths [s], the loss of each, and the ledger."""
    scheme = EnergyConsistent(**scheme)
    solver = make_solver(system, None, kind, scheme.rule)
    given = {}
    for name, values in (("displacement", u0), ("velocity", v0)):
        if values is not None:
            given[name] = system.mass.createVecRight()
            given[name].setArray(np.atleast_1d(np.asarray(values, float)))
    states, losses = [initial_state(solver, dt=lengths[0], **given)], []
    ledger = EnergyLedger(system)
    ledger.start(states[0])
    for dt in lengths:
        state, report = scheme.advance(solver, states[-1], dt)
        ledger.record(ledger.after(state, report))
        states.append(state)
        losses.append(report.work.dissipation)
    return states, np.array(losses), ledger


def arrays(states, name="displacement"):
    return np.array([getattr(state, name).array_r.copy() for state in states])


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8, 1.0])
def test_amplification_of_a_mode(radius):
    # v1 - v0 = -omega^2 dt u and u1 - u0 = dt v at the share theta = 1/(1 + radius) of the step:
    # eigenvalues (1 + i z (1 - theta))/(1 - i z theta), z = omega dt, and their conjugates.
    theta, dt = 1.0 / (1.0 + radius), 0.25
    for z in (0.1, 1.0, 10.0, 1e4):
        system = MatrixSystem.from_arrays(mass=1.0, stiffness=(z / dt) ** 2)
        columns = []
        for u0, v0 in ((1.0, 0.0), (0.0, z / dt)):
            states, losses, ledger = march(system, [dt], u0=u0, v0=v0, spectral_radius=radius)
            columns.append([states[1].displacement.array[0], states[1].velocity.array[0] * dt / z])
            assert losses[0] >= 0.0
            assert ledger.relative_imbalance < 1e-14
        found = np.linalg.eigvals(np.array(columns).T)
        expected = (1.0 + 1j * z * (1.0 - theta)) / (1.0 - 1j * z * theta)
        pair = [expected, expected.conjugate()]
        np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(pair), atol=1e-11)
    assert np.abs(found).max() == pytest.approx(radius, abs=1e-4)


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8])
def test_the_local_error_has_what_dissipation_takes(radius):
    """Released at u0, 20 steps per period: what the first step misses of that without dissipation.

    The other part of the error is that of `test_schemes`; it begins with the second step.
    """
    omega, dt = 2.0 * math.pi, 0.05
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=omega**2)
    ends = []
    for each in (radius, 1.0):
        scheme = EnergyConsistent(spectral_radius=each)
        solver = make_solver(system, rule=scheme.rule)
        u0 = system.mass.createVecRight()
        u0.setArray([1.0])
        after, report = scheme.advance(solver, initial_state(solver, displacement=u0), dt)
        ends.append((after.displacement.array[0], report.local_error))
    (damped, error), (kept, of_kept) = ends
    assert error - of_kept == pytest.approx(abs(damped - kept), rel=0.1)


def moving(*, supports):
    """Six coupled dofs with damping that couples modes, loads, two joint points that rub."""
    rng = np.random.default_rng(8)
    a, b, c = rng.normal(size=(3, 6, 6))
    m, k = a @ a.T + 6.0 * np.eye(6), 100.0 * (b @ b.T + np.eye(6))
    system = MatrixSystem.from_arrays(
        mass=m,
        stiffness=k,
        damping=0.3 * c @ c.T,
        load=lambda t: 300.0 * np.sin([30 * t, 20 * t, 25 * t, 40 * t, 10 * t, 5 * t]),
        gap=rng.normal(size=(6, 6)),
        law=FrictionNoTension(normal_stiffness=1e4, shear_stiffness=5e3, friction_angle_deg=30.0),
    )
    if supports:
        changes = {
            "constrained": np.array([0, 2]),
            "values": lambda t: np.array([np.sin(7 * t) + t**3, abs(t - 0.31)]),
        }
        system = dataclasses.replace(system, **changes)
    return system, m, k


@pytest.mark.parametrize("supports", [False, True])
@pytest.mark.parametrize(("kind", "modes"), [("condensed", 0), ("condensed", 3), ("monolithic", 3)])
def test_balance_and_loss_with_all_at_once(supports, kind, modes):
    # The loss by dense matrices: chi (c.M c + r.K r), c the change of the velocity without that of
    # the modes, r that of the displacement from where it would be had the modes followed the
    # supports at rest. Both are sums of squares.
    system, m, k = moving(supports=supports)
    held = system.constrained
    free = np.setdiff1d(np.arange(6), held)
    squares, shapes = eigh(k[np.ix_(free, free)], m[np.ix_(free, free)])
    phi = np.zeros((6, modes))
    phi[free] = shapes[:, :modes]
    for radius in (0.8, 0.0):
        states, losses, ledger = march(
            system,
            [0.01, 0.02, 0.005, 0.04] * 20,
            exact_modes=modes,
            spectral_radius=radius,
            kind=kind,
        )
        assert ledger.relative_imbalance < 1e-12
        assert ledger.row.friction > 0.0
        assert ledger.row.dissipation > 0.01 * ledger.scale
        x = np.diff(arrays(states), axis=0)
        dv = np.diff(arrays(states, "velocity"), axis=0)
        of_modes = (m @ phi)[free]
        c = dv - dv[:, free] @ of_modes @ phi.T
        r = x - (x @ k @ phi / squares[:modes]) @ phi.T
        chi = 0.5 * (1.0 - radius) / (1.0 + radius)
        wanted = chi * (np.einsum("ni,ij,nj->n", c, m, c) + np.einsum("ni,ij,nj->n", r, k, r))
        np.testing.assert_allclose(losses, wanted, rtol=1e-8, atol=1e-12 * ledger.scale)


def test_exact_modes_lose_nothing_and_keep_their_phase():
    # The modal amounts are those of the plain scheme, the rest decays.
    squares, shapes = eigh(STIFFNESS, MASS)
    system = MatrixSystem.from_arrays(mass=MASS, stiffness=STIFFNESS)
    u0 = shapes @ [0.3, 0.2, 0.1]
    found, losses = [], []
    for radius in (1.0, 0.5):
        states, lost, ledger = march(
            system, [0.5] * 60, u0=u0, exact_modes=2, spectral_radius=radius
        )
        found.append(arrays(states) @ MASS @ shapes)
        losses.append(lost)
        assert ledger.relative_imbalance < 1e-13
    times = 0.5 * np.arange(61)
    exact = np.cos(np.sqrt(squares[:2]) * times[:, None]) * [0.3, 0.2]
    np.testing.assert_allclose(found[1][:, :2], exact, atol=1e-11)
    assert np.abs(found[1][-5:, 2]).max() < 1e-2 * np.abs(found[0][-5:, 2]).max()
    # All that the third mode had is what was lost.
    assert losses[1].sum() == pytest.approx(0.5 * squares[2] * 0.1**2, rel=1e-3)
    states, losses, _ = march(
        system, [0.5] * 60, u0=shapes[:, :2] @ [0.3, 0.2], exact_modes=2, spectral_radius=0.0
    )
    assert np.abs(losses).max() < 1e-15


def test_order_in_the_rest_is_one():
    # Damped by omega^2 dt (1 - radius)/(1 + radius)/2 per time, of which dt is one power.
    errors = []
    for parts in (20, 40, 80):
        system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0)
        steps = [2.0 * math.pi / parts] * parts
        states, *_ = march(system, steps, u0=1.0, spectral_radius=0.8)
        errors.append(1.0 - states[-1].displacement.array[0])
    rates = np.diff(np.log2(errors))
    np.testing.assert_allclose(rates, -1.0, atol=0.1)
    decay = math.pi * (2.0 * math.pi / 80) * (0.2 / 1.8)
    assert errors[-1] == pytest.approx(decay, rel=0.1)


def test_a_point_that_sticks_comes_to_rest():
    # A rigid joint, pressed: x = 0, so v1 = -radius v0 instead of swinging for ever.
    system = MatrixSystem.from_arrays(
        mass=np.eye(2),
        stiffness=np.zeros((2, 2)),
        load=lambda t: [0.0, -100.0],
        gap=[[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        law=RigidJoint(friction_angle_deg=30.0),
    )
    for radius in (1.0, 0.5, 0.0):
        states, losses, _ = march(system, [0.125] * 6, v0=[0.01, 0.0], spectral_radius=radius)
        expected = 0.01 * (-radius) ** np.arange(7.0)
        np.testing.assert_allclose(arrays(states, "velocity")[:, 0], expected, atol=1e-14)
        assert losses.sum() == pytest.approx(0.5e-4 * (1.0 - radius**12), abs=1e-15)


@pytest.mark.parametrize("radius", [1.0, 0.8, 0.0])
def test_what_does_not_rebound_stays(radius):
    # Thrown at a rigid stop: its energy is lost in the impact and by the scheme, all of it by the
    # latter at a radius of 0; nothing bounces after it.
    system = MatrixSystem.from_arrays(
        mass=2.0,
        stiffness=0.0,
        load=lambda t: [-1.0],
        gap=[[1.0], [0.0], [0.0]],
        law=RigidJoint(friction_angle_deg=0.0, restitution=0),
        initial_gap=0.1,
    )
    states, losses, ledger = march(system, [0.0625] * 40, v0=-0.5, spectral_radius=radius)
    struck = int(np.argmax(arrays(states)[:, 0] <= -0.09))
    assert 0 < struck < 10
    np.testing.assert_allclose(arrays(states, "velocity")[struck + 2 :, 0], 0.0, atol=1e-12)
    row = ledger.row
    assert row.impact + row.dissipation == pytest.approx(0.25 + row.input, rel=1e-12)
    assert row.impact >= 0.2 * radius
    assert losses.min() >= 0.0
    assert ledger.relative_imbalance < 1e-12


def test_parts_without_mass():
    # A massless end on a spring follows its force; balance and signs as elsewhere.
    system = MatrixSystem.from_arrays(
        mass=np.diag([1.0, 0.0]),
        stiffness=[[30.0, -10.0], [-10.0, 10.0]],
        load=lambda t: [math.sin(3.0 * t), 2.0 * math.sin(5.0 * t)],
    )
    for modes in (0, 1):
        _, losses, ledger = march(
            system, [0.125, 0.0625] * 30, v0=[1.0, 0.5], exact_modes=modes, spectral_radius=0.5
        )
        assert ledger.relative_imbalance < 1e-13
        assert losses.min() > -1e-15 * ledger.scale
        assert ledger.row.dissipation > 0.0


@pytest.mark.mpi
@pytest.mark.parametrize("modes", [0, 20])
def test_a_wall_on_any_number_of_ranks(comm, wall_file, read, modes, new_path):
    # Joints that open and slide, mass redistributed, steps cut: the same on one rank alone, and
    # the line in the results file is that of the ledger.
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    from shaken_wall import DT, POINTS, shaking, wall

    from dolfinx_joints import Results, ResultsMonitor, Simulation, StepControl, plots
    from dolfinx_joints.postprocessing.energy_lines import energy_lines

    found, path = [], new_path("dissipating.h5")
    for on in (comm, MPI.COMM_SELF):
        monitors = [ResultsMonitor(path, points=POINTS)] if on is comm else []
        model = wall(read(wall_file(), on), redistribute_mass=True)
        simulation = Simulation(model, monitors=monitors)
        simulation.statics()
        outcome = simulation.dynamics(
            dt=DT,
            steps=8,
            motion=shaking,
            scheme=EnergyConsistent(exact_modes=modes, spectral_radius=0.8),
            control=StepControl(tolerance=1e-2),
        )
        assert outcome.counts.accepted > 8
        assert outcome.imbalance < 1e-12
        row = outcome.energy
        found.append([row.kinetic, row.strain, row.friction, row.dissipation, row.input])
        if monitors and comm.rank == 0:
            with Results(path) as results:
                line = energy_lines(results)["dissipation"]
                drawn = plots.energies(results)
            assert line[0] == 0.0
            assert line[-1] == row.dissipation
            assert np.all(np.diff(line) > 0.0)
            assert "dissipation" in [text.get_text() for text in drawn.get_legend().get_texts()]
    assert min(found[0][2:4]) > 0.0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)
