# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time schemes on small systems, and the initial balance."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("petsc4py")

import dolfinx_joints as dj
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state

SOLVERS = ["condensed", "monolithic"]


def vector(system, values):
    v = system.mass.createVecRight()
    v.setArray(np.atleast_1d(np.asarray(values, float)))
    return v


def march(system, dt, steps, *, scheme=None, kind="auto", newton=None, u0=None, v0=None):
    """All states of a run with equal steps."""
    scheme = scheme or dj.Newmark()
    solver = make_solver(system, newton, kind)
    states = [
        initial_state(
            solver,
            displacement=None if u0 is None else vector(system, u0),
            velocity=None if v0 is None else vector(system, v0),
        )
    ]
    for _ in range(steps):
        states.append(scheme.advance(solver, states[-1], dt)[0])
    return states


def history(states, name="displacement"):
    return np.array([getattr(state, name).getArray(readonly=True) for state in states])


OMEGA, RATIO = 2 * np.pi, 0.05


def damped(t, u0=1.0, v0=0.5):
    """Free vibration of m u'' + c u' + k u = 0 with period 1 s and 5 % of critical damping."""
    w = OMEGA * np.sqrt(1 - RATIO**2)
    b = (v0 + RATIO * OMEGA * u0) / w
    return np.exp(-RATIO * OMEGA * t) * (u0 * np.cos(w * t) + b * np.sin(w * t))


@pytest.mark.parametrize(
    ("beta", "gamma", "order"), [(0.25, 0.5, 2), (1 / 6, 0.5, 2), (0.3025, 0.6, 1)]
)
def test_order_of_newmark(beta, gamma, order):
    # Closed form of the damped oscillator; halving dt divides the error at t = 1.3 s by 2^order.
    system = dj.MatrixSystem.from_arrays(
        mass=3.0, stiffness=3 * OMEGA**2, damping=3 * 2 * RATIO * OMEGA
    )
    errors = []
    for steps in (130, 260, 520):
        states = march(
            system, 1.3 / steps, steps, scheme=dj.Newmark(beta=beta, gamma=gamma), u0=1.0, v0=0.5
        )
        errors.append(abs(history(states)[-1, 0] - damped(1.3)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, order, atol=0.15)


@pytest.mark.parametrize(
    "scheme",
    [dj.EnergyConsistent(), dj.Newmark(), dj.Newmark(beta=0.3, gamma=0.5), dj.Newmark(beta=0.1)],
)
def test_local_error_is_that_of_the_second_step(scheme):
    # Against the motion u cos wt + v/w sin wt from where the step starts. Of the third order in
    # dt, and the next order is a hundredth of it at w dt = 0.02.
    dt = 0.02 / OMEGA
    system = dj.MatrixSystem.from_arrays(mass=3.0, stiffness=3 * OMEGA**2)
    solver = make_solver(system, None, "auto")
    start = initial_state(solver, velocity=vector(system, 1.0))
    first, _ = scheme.advance(solver, start, dt)
    second, report = scheme.advance(solver, first, dt)
    u, v = first.displacement.array[0], first.velocity.array[0]
    exact = u * np.cos(OMEGA * dt) + v / OMEGA * np.sin(OMEGA * dt)
    assert report.local_error == pytest.approx(abs(second.displacement.array[0] - exact), rel=0.05)


def test_velocity_without_mass_is_the_mean_of_the_step():
    # Two springs in a row, a mass at the end of the first and none at that of the second.
    dt = 0.1
    system = dj.MatrixSystem.from_arrays(
        mass=np.diag([1.0, 0.0]), stiffness=[[3.0, -1.0], [-1.0, 1.0]], load=lambda t: [0.0, t]
    )
    before, after = march(system, dt, 2, scheme=dj.EnergyConsistent(), v0=[1.0, 0.0])[1:]
    mean = (after.displacement.array - before.displacement.array) / dt
    assert after.velocity.array[1] == pytest.approx(mean[1], rel=1e-14)
    # With mass it is the mean of those at start and end.
    assert 0.5 * (before.velocity.array + after.velocity.array)[0] == pytest.approx(mean[0])


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
def test_a_start_on_a_moving_support(unit):
    # 3 t + 2 t^2 prescribed at the foot of a spring of 5 N/m with 2 kg on it and a dashpot of
    # 0.5 N s/m beside it: at the start 3 m/s and 4 m/s^2 at the foot, 0.5 3 / 2 m/s^2 at the mass.
    # A sine of circular frequency 1 on it is not exact: with 60 steps a period, t^3/6 at the
    # spacing of 1/64 step would be 1e-6 of the velocity. Times in s, in 1000 s and in ms.
    spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    system = dataclasses.replace(
        dj.MatrixSystem.from_arrays(
            mass=2.0 * np.eye(2), stiffness=5 * spring / unit**2, damping=0.5 * spring / unit
        ),
        constrained=np.array([0]),
        values=lambda t: np.array([2.0 * np.sin(t / unit) + t / unit + 2.0 * (t / unit) ** 2]),
    )
    state = initial_state(make_solver(system), dt=0.1 * unit)
    np.testing.assert_array_equal(state.displacement.array, [0.0, 0.0])
    np.testing.assert_allclose(unit * state.velocity.array, [3.0, 0.0], rtol=1e-6)
    np.testing.assert_allclose(unit**2 * state.acceleration.array, [4.0, 0.75], rtol=2e-3)
    with pytest.raises(ValueError, match="dt is missing; the first velocity of moving supports"):
        initial_state(make_solver(system))


def random_system(seed=0, size=4, damping=0.0):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, size, size))
    m, k = a @ a.T + size * np.eye(size), 1e3 * (b @ b.T + np.eye(size))
    return m, k, dj.MatrixSystem.from_arrays(mass=m, stiffness=k, damping=damping * k)


# By hand from the papers: beta = (1 + alpha)^2 / 4, gamma = 1/2 + alpha of HHT; of the other
# beta = (1 - alpha_m + alpha_f)^2 / 4 with alpha_m = 0 and alpha_f = 1/3.
@pytest.mark.parametrize(
    ("scheme", "beta", "gamma"),
    [
        (dj.HilberHughesTaylor(alpha=0.2), 0.36, 0.7),
        (dj.GeneralizedAlpha(spectral_radius=0.5), 4 / 9, 5 / 6),
    ],
)
def test_newmark_parameters_of_damped_schemes(scheme, beta, gamma):
    assert (scheme.beta, scheme.gamma) == pytest.approx((beta, gamma), rel=1e-14)


@pytest.mark.parametrize(
    "scheme", [dj.EnergyConsistent(), dj.Newmark(), dj.HilberHughesTaylor(), dj.GeneralizedAlpha()]
)
@pytest.mark.parametrize("factors", [(0.0, 1e-3), (2.0, 0.0), (2.0, 1e-3)])
def test_rayleigh_factors_are_the_matrix(scheme, factors):
    # C = a M + b K by its factors, as a matrix, and half of it either way: one and the same motion,
    # started with a velocity and pushed for a while; and the same loss by damping.
    a, b = factors
    m, k, plain = random_system()
    load = dj.MatrixSystem.from_arrays(
        mass=m, stiffness=k, load=lambda t: np.arange(4.0) * (t < 0.1)
    )
    c = a * m + b * k
    by = [
        (dj.Rayleigh(mass_factor=part * a, stiffness_factor=part * b), (1.0 - part) * c)
        for part in (1.0, 0.5, 0.0)
    ]
    found = []
    for rayleigh, rest in by:
        given = dj.MatrixSystem.from_arrays(mass=m, stiffness=k, damping=rest)
        dashpots = given.dashpots if rest.any() else None
        system = dataclasses.replace(
            plain, patterns=load.patterns, rayleigh=rayleigh, dashpots=dashpots
        )
        solver = make_solver(system)
        state = initial_state(solver, velocity=vector(system, np.ones(4)))
        ledger = EnergyLedger(system)
        ledger.start(state)
        for _ in range(50):
            state, report = scheme.advance(solver, state, 0.01)
            ledger.record(ledger.after(state, report))
        found.append([*state.displacement.array, *state.velocity.array, ledger.row.viscous])
        assert ledger.row.viscous > 0.0
        if scheme.conserves(system):
            assert ledger.relative_imbalance <= 1e-13
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=1e-10, atol=1e-13)


def test_other_refusals():
    with pytest.raises(ValueError, match="they must be square and of equal size"):
        dj.MatrixSystem.from_arrays(mass=np.eye(2), stiffness=1.0)
    with pytest.raises(ValueError, match="it needs 1 columns, three rows per joint point"):
        dj.MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=[[1.0]], law=STOP)


def test_a_moving_support_moves_as_prescribed():
    # Two masses on a spring, the first moved by 5 t^2 m: the relative motion r of the second obeys
    # r'' + w^2 r = -10, so r = -10 (1 - cos w t) / w^2, and the support pushes with m1 10 - k r.
    m1, m2, k = 3.0, 2.0, 800.0
    plain = dj.MatrixSystem.from_arrays(mass=np.diag([m1, m2]), stiffness=[[k, -k], [-k, k]])
    system = dataclasses.replace(
        plain, constrained=np.array([0]), values=lambda t: np.array([5.0 * t**2])
    )
    solver, w, dt = make_solver(system), np.sqrt(k / m2), 1e-3
    state = initial_state(solver, dt=dt)
    assert state.acceleration.getArray() == pytest.approx([10.0, 0.0], rel=1e-6)
    assert state.reaction.getArray() == pytest.approx([10.0 * m1, 0.0], rel=1e-6)
    for step in range(1, 501):
        state, _ = dj.Newmark().advance(solver, state, dt)
        r = -10.0 * (1.0 - np.cos(w * step * dt)) / w**2
        assert state.velocity.getArray()[0] == pytest.approx(10.0 * step * dt, rel=1e-8)
        assert state.reaction.getArray()[0] == pytest.approx(10.0 * m1 - k * r, abs=0.1)


EXACT = dj.EnergyConsistent(exact_modes=2)


@pytest.mark.parametrize(
    "scheme", [dj.EnergyConsistent(), EXACT, dj.ImplicitContact(), dj.Newmark()]
)
def test_a_support_that_stops_stays_at_rest(scheme):
    # Moved by 1 mm in 20 ms and then held: no velocity is left at the support, and the energy of
    # the damped mass behind it dies out.
    m1, m2, k, c = 3.0, 2.0, 800.0, 40.0
    plain = dj.MatrixSystem.from_arrays(
        mass=[[m1, 0.5], [0.5, m2]], stiffness=[[k, -k], [-k, k]], damping=[[c, -c], [-c, c]]
    )
    system = dataclasses.replace(
        plain, constrained=np.array([0]), values=lambda t: np.array([1e-3 * min(t / 0.02, 1.0)])
    )
    solver, dt = make_solver(system), 1e-3
    state = initial_state(solver, dt=dt)
    ledger = EnergyLedger(system)
    ledger.start(state)
    for _ in range(1500):
        state, report = scheme.advance(solver, state, dt)
        ledger.record(ledger.after(state, report))
    assert abs(state.velocity.getArray()[0]) < 1e-12
    assert state.kinetic_energy < 1e-10
    assert abs(state.reaction.getArray()[0]) < 1e-6
    if scheme.conserves(system):
        assert ledger.relative_imbalance < 1e-12


def test_a_balance_that_a_scheme_cannot_keep_is_not_asked_for():
    moved = dataclasses.replace(
        dj.MatrixSystem.from_arrays(mass=np.eye(2), stiffness=np.eye(2)),
        constrained=np.array([0]),
        values=lambda t: np.array([t**3]),
    )
    skew = dataclasses.replace(moved, values=None, symmetric=False)
    assert dj.EnergyConsistent().conserves(moved)
    assert not dj.Newmark().conserves(moved)
    assert not dj.EnergyConsistent().conserves(skew)
    assert not dj.Newmark(gamma=0.6, beta=0.3025).conserves(dataclasses.replace(moved, values=None))


# The initial state.


@pytest.mark.parametrize("kind", SOLVERS)
def test_initial_state_balances(kind):
    # M a + C v + K u + B^T w t = F with t by hand: gap -1e-3 m, k_n 1e6 Pa/m, area 2 m^2: 2 kN
    # of compression, which pushes the first dof with - B^T w t.
    rng = np.random.default_rng(3)
    m, k, _ = random_system(seed=3)
    c = 0.01 * k
    b = np.zeros((3, 4))
    b[0, 0], b[1, 1], b[2, 2] = 1.0, 1.0, 1.0
    system = dj.MatrixSystem.from_arrays(
        mass=m,
        stiffness=k,
        damping=c,
        load=lambda t: np.array([1.0, 2.0, 3.0, 4.0]) * (1 + t),
        gap=b,
        law=STOP,
        areas=[2.0],
    )
    u, v = rng.normal(size=4), rng.normal(size=4)
    u[0] = -1e-3
    state = initial_state(
        make_solver(system, kind=kind),
        time=0.5,
        displacement=vector(system, u),
        velocity=vector(system, v),
    )
    force = 1.5 * np.array([1.0, 2.0, 3.0, 4.0]) - c @ v - k @ u
    force[0] += 2.0 * 1e6 * 1e-3
    np.testing.assert_allclose(m @ state.acceleration.getArray(), force, rtol=1e-10, atol=1e-8)
    assert state.time == 0.5
    np.testing.assert_array_equal(state.reaction.getArray(), 0.0)
    np.testing.assert_allclose(state.joints.traction[0], [-1e3, 0, 0], rtol=1e-12)


def test_initial_acceleration_of_a_held_body():
    # Held dofs stay, and pass nothing on through the mass that they share with the others.
    rng = np.random.default_rng(4)
    m, k, _ = random_system(seed=4)
    system = dataclasses.replace(
        dj.MatrixSystem.from_arrays(mass=m, stiffness=k), constrained=np.array([1, 2])
    )
    free, u = [0, 3], np.where([1, 0, 0, 1], rng.normal(size=4), 0.0)
    state = initial_state(make_solver(system), displacement=vector(system, u))
    a = state.acceleration.array
    np.testing.assert_array_equal(a[[1, 2]], 0.0)
    np.testing.assert_allclose(m[np.ix_(free, free)] @ a[free], -(k @ u)[free], rtol=1e-10)


STOP = dj.FrictionNoTension(normal_stiffness=1e6, shear_stiffness=0.0, friction_angle_deg=0.0)


def test_a_step_does_not_change_its_state():
    system = random_system()[2]
    solver = make_solver(system)
    state = initial_state(solver, displacement=vector(system, [1, -1, 2, 0.5]))
    before = [getattr(state, n).getArray().copy() for n in ("displacement", "velocity", "load")]
    first, _ = dj.Newmark().advance(solver, state, 1e-2)
    again, _ = dj.Newmark().advance(solver, state, 1e-2)
    for name, kept in zip(("displacement", "velocity", "load"), before, strict=True):
        np.testing.assert_array_equal(getattr(state, name).getArray(), kept)
    np.testing.assert_array_equal(first.displacement.getArray(), again.displacement.getArray())
