# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The energy ledger: exact where the scheme is, and friction by a closed form."""

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("petsc4py")

import dolfinx_joints as dj
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state

SOLVERS = ["condensed", "monolithic"]


def run(system, dt, steps, *, kind="auto", u0=None, v0=None, scheme=None):
    """The ledger after a run, its rows, and the displacements."""

    def vector(values):
        if values is None:
            return None
        v = system.mass.createVecRight()
        v.setArray(np.atleast_1d(np.asarray(values, float)))
        return v

    scheme = scheme or dj.Newmark()
    solver = make_solver(system, dj.SolverOptions(relative_tolerance=1e-13), kind)
    state = initial_state(solver, dt=dt, displacement=vector(u0), velocity=vector(v0))
    ledger = EnergyLedger(system)
    rows, path = [ledger.start(state)], [state.displacement.getArray().copy()]
    for _ in range(steps):
        state, report = scheme.advance(solver, state, dt)
        rows.append(ledger.record(ledger.after(state, report)))
        path.append(state.displacement.getArray().copy())
    return ledger, rows, np.array(path)


def test_linear_damped_driven_system():
    # With average acceleration the balance is an identity: trapezoidal work of the loads less
    # du.C du/dt is the change of kinetic and strain energy, at any dt.
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 4, 4))
    m, k = a @ a.T + 4 * np.eye(4), 1e3 * (b @ b.T + np.eye(4))
    system = dj.MatrixSystem.from_arrays(
        mass=m,
        stiffness=k,
        damping=0.2 * m + 1e-3 * k,
        load=lambda t: 100 * np.sin([9 * t, 11 * t, 13 * t, 17 * t]),
    )
    for dt in (2e-3, 5e-2, 0.5):
        ledger, rows, path = run(system, dt, 400, u0=[0.1, 0, -0.1, 0.2], v0=[1, 2, 0, -1])
        assert ledger.relative_error <= 1e-12
        last = rows[-1]
        # The lines by hand from the matrices.
        assert last.strain == pytest.approx(0.5 * path[-1] @ k @ path[-1], rel=1e-12)
        moved = np.diff(path, axis=0)
        viscous = np.einsum("ti,ij,tj->", moved, 0.2 * m + 1e-3 * k, moved) / dt
        assert last.viscous == pytest.approx(viscous, rel=1e-10)
        assert last.viscous > 0
        assert last.joint == last.friction == 0.0
        assert last.stored == last.kinetic + last.strain + last.joint
        start = rows[0].stored
        balance = last.stored - start - last.input + last.viscous + last.friction
        assert last.error == pytest.approx(balance, abs=1e-12 * abs(last.input))


def test_works_of_loads_by_name():
    # Two loads and a moving support: the works of all three are the input.
    plain = dj.MatrixSystem.from_arrays(
        mass=np.eye(2), stiffness=[[3.0, -1.0], [-1.0, 2.0]], load=lambda t: [np.sin(5 * t), 1.0]
    )
    assert run(plain, 0.01, 5)[1][-1].input_by_load.keys() == {"load"}
    named = dataclasses.replace(
        plain,
        load_names=["shaking", "weight"],
        constrained=np.array([0]),
        values=lambda t: np.array([t**2]),
    )
    _, rows, path = run(named, 0.01, 50, scheme=dj.EnergyConsistent(), u0=[0.0, 0.0])
    last = rows[-1]
    assert last.input_by_load["weight"] == pytest.approx(path[-1, 1], rel=1e-12)
    t, moved = 0.01 * np.arange(51), np.diff(path[:, 0])
    shaken = np.sin(5 * t)
    by_hand = np.sum(0.5 * (shaken[1:] + shaken[:-1]) * moved)
    assert last.input_by_load["shaking"] == pytest.approx(by_hand, rel=1e-12)
    assert abs(last.input - sum(last.input_by_load.values())) > 0.1 * abs(last.input)


def test_nothing_moves_nothing_counts():
    system = dj.MatrixSystem.from_arrays(mass=1.0, stiffness=1.0)
    ledger, rows, _ = run(system, 0.1, 3)
    assert ledger.relative_error == 0.0
    assert rows[-1].stored == rows[-1].input == rows[-1].error == 0.0


# Coulomb oscillator: m 1 kg, k 1e4 N/m, pressed with 10 N, mu 0.1, released at 0.85 mm. Each half
# period pi/100 s takes 2 mu N / k = 0.2 mm off the amplitude: 0.85, -0.65, 0.45, -0.25, 0.05 mm,
# where k x = 0.5 N is below mu N = 1 N and the mass rests. The path of 3.6 mm times 1 N is the
# energy lost, 3.6 mJ, also from k (0.85^2 - 0.05^2) / 2. In the model the joint is stiff, not
# rigid: it yields by mu N / k_s = 1e-8 m.


@pytest.mark.parametrize("kind", SOLVERS)
@pytest.mark.parametrize("angle", [0.0, 35.0])
def test_coulomb_oscillator(kind, angle):
    k_n, k_s = 1e6, 1e8
    law = dj.FrictionNoTension(
        normal_stiffness=k_n,
        shear_stiffness=k_s,
        friction_angle_deg=math.degrees(math.atan(0.1)),
    )
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    system = dj.MatrixSystem.from_arrays(
        mass=np.eye(2),
        stiffness=np.diag([1e4, 0.0]),
        load=lambda t: [0.0, -10.0],
        gap=[[0, 1], [c, 0], [s, 0]],  # dof 0 slides along a line in the joint, dof 1 is normal
        law=law,
    )
    half, pieces = np.pi / 100, 400
    ledger, rows, path = run(system, half / pieces, 5 * pieces, kind=kind, u0=[0.85e-3, -10 / k_n])
    x = path[::pieces, 0]
    np.testing.assert_allclose(1e3 * x[:5], [0.85, -0.65, 0.45, -0.25, 0.05], atol=2e-3)
    assert x[5] == pytest.approx(x[4], abs=1e-7)  # at rest
    assert path[:, 1] == pytest.approx(-10 / k_n, rel=1e-9)  # the normal force does not change
    last = rows[-1]
    assert last.friction == pytest.approx(3.6e-3, rel=5e-3)
    lost = rows[0].stored - last.stored
    assert last.friction - last.input == pytest.approx(lost, rel=1e-9)
    # Closed all the time: trapezoidal work and mean shear are consistent, the ledger is exact.
    assert ledger.relative_error <= 1e-10
    friction = np.array([row.friction for row in rows])
    assert np.min(np.diff(friction)) >= -1e-15


def test_sticking_joint_is_a_spring():
    # Without sliding the joint's energy takes part in an exact balance.
    law = dj.FrictionNoTension(normal_stiffness=1e5, shear_stiffness=5e4, friction_angle_deg=80.0)
    system = dj.MatrixSystem.from_arrays(
        mass=np.eye(2),
        stiffness=np.diag([1e4, 0.0]),
        load=lambda t: [np.sin(40 * t), -100.0],
        gap=[[0, 1], [1, 0], [0, 0]],
        law=law,
    )
    ledger, rows, path = run(system, 1e-3, 300, u0=[0.0, -1e-3])
    assert ledger.relative_error <= 1e-12
    assert rows[-1].friction == pytest.approx(0.0, abs=1e-14)
    # k_n g^2 / 2 + k_s s^2 / 2 from the displacements.
    joint = 0.5 * 1e5 * path[-1, 1] ** 2 + 0.5 * 5e4 * path[-1, 0] ** 2
    assert rows[-1].joint == pytest.approx(joint, rel=1e-9)


def test_impact_shows_in_the_ledger():
    # Newmark's method creates or destroys energy where a stiff joint opens or closes within a
    # step: the ledger must say so, and less of it with shorter steps.
    law = dj.FrictionNoTension(normal_stiffness=1e6, shear_stiffness=0.0, friction_angle_deg=0.0)
    system = dj.MatrixSystem.from_arrays(
        mass=100.0, stiffness=1e4, gap=[[-1], [0], [0]], law=law, initial_gap=0.03
    )
    errors = [run(system, dt, round(0.12 / dt), v0=1.0)[0].relative_error for dt in (4e-3, 1e-4)]
    assert errors[0] > 1e-3
    assert errors[1] < 0.1 * errors[0]


def test_what_only_passes_through_does_not_hide_an_error():
    # Of 1000 J that waves bring dashpots take 990; 2 J are missing of the 8 that are left.
    system = dj.MatrixSystem.from_arrays(mass=[[1.0]], stiffness=[[1.0]])
    ledger, (row, *_), _ = run(system, 0.1, 0)
    passing = dataclasses.replace(row, input=1000.0, viscous=990.0, absorbed=990.0, kinetic=8.0)
    ledger.record(dataclasses.replace(passing, error=-2.0))
    assert ledger.relative_error == pytest.approx(2.0 / 10.0)
    assert ledger.relative_imbalance == pytest.approx(2.0 / 1000.0)
