# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A point of the cohesive law against closed forms: areas, unloading, energy, tangents."""

from dataclasses import replace

import numpy as np
import pytest
from tangent_errors import largest_error

import dolfinx_joints as dj
from dolfinx_joints.laws.law import JointState, Status

K_N, K_S, F_T, C, G_1, G_2 = 1e12, 4e11, 2e6, 3e6, 100.0, 1000.0
SOFTENING = ["linear", "exponential"]
MU = np.tan(np.radians(40.0))


def cohesive(softening="linear", **changes):
    values = {
        "normal_stiffness": K_N,
        "shear_stiffness": K_S,
        "friction_angle_deg": 40.0,
        "tensile_strength": F_T,
        "cohesion": C,
        "fracture_energy": G_1,
        "shear_fracture_energy": G_2,
        "softening": softening,
    }
    return dj.CohesiveJoint(**(values | changes))


def at_rest(law, gap):
    return replace(JointState.at_rest(gap), internal=law.initial_variables(gap))


def path(law, gaps, method="backward_euler"):
    """Responses along gaps (steps, 3), from rest."""
    state, answers = at_rest(law, np.zeros((1, 3))), []
    for gap in np.atleast_2d(gaps):
        answers.append(getattr(law, method)(gap[None], state))
        state = answers[-1].state
    return answers


def kinks(law, share):
    """Openings where linear softening starts and ends, with the share of mode I in r."""
    g_0, s_0 = F_T / K_N, C / K_S
    n, s = np.sqrt(share) * g_0, np.sqrt(1.0 - share) * s_0
    ends = [2.0 * G_1 * K_N / F_T**2, 2.0 * G_2 * K_S / C**2]
    return np.array([x * np.array([n, 0.6 * s, 0.8 * s]) for x in (1.0, *ends)])


@pytest.mark.parametrize("share", [1.0, 0.0, 0.5, 0.2])
def test_area_under_the_curve_is_the_fracture_energy(share):
    """G_I a + G_II (1 - a) with the share a of mode I at the onset: the sum of both modes is 1.

    Linear softening is a chain of straight lines, whose area the trapezoidal rule gives exactly.
    """
    law = cohesive()
    gaps = kinks(law, share)
    gaps = gaps[np.argsort(np.abs(gaps).sum(axis=1))]
    tractions = np.vstack([np.zeros(3), *(answer.traction for answer in path(law, gaps))])
    moved = np.diff(np.vstack([np.zeros(3), gaps]), axis=0)
    area = float((0.5 * (tractions[1:] + tractions[:-1]) * moved).sum())
    assert area == pytest.approx(share * G_1 + (1.0 - share) * G_2, rel=1e-13)
    np.testing.assert_allclose(tractions[-1], 0.0, atol=1e-3)


@pytest.mark.parametrize("softening", SOFTENING)
@pytest.mark.parametrize("share", [1.0, 0.0, 0.5])
@pytest.mark.parametrize("steps", [1, 7, 300])
def test_broken_energy_is_exact_for_any_number_of_steps(softening, share, steps):
    """On a straight path both rules dissipate G_I a + G_II (1 - a), whatever the steps."""
    law = cohesive(softening)
    end = 5e-3 * np.array([np.sqrt(share) * F_T / K_N, np.sqrt(1 - share) * C / K_S, 0.0]) / 1e-6
    gaps = np.arange(1, steps + 1)[:, None] / steps * end
    expected = pytest.approx(share * G_1 + (1.0 - share) * G_2, rel=1e-12)
    for method in ("backward_euler", "discrete_gradient"):
        answers = path(law, gaps, method)
        assert answers[-1].state.internal[0, 4] == expected
        assert sum(float(answer.dissipation[0]) for answer in answers) == expected
    work, before = 0.0, np.zeros(3)
    for answer, gap in zip(answers, gaps, strict=True):
        work, before = work + float(answer.traction[0] @ (gap - before)), gap
    assert work == expected


@pytest.mark.parametrize("softening", SOFTENING)
def test_peak_and_unloading_to_the_origin(softening):
    """The peaks are f_t and c; the line of unloading passes through the origin."""
    law = cohesive(softening)
    for direction, stiffness, strength in ((0, K_N, F_T), (2, K_S, C)):
        unit = np.eye(3)[direction]
        (peak,) = path(law, strength / stiffness * unit)
        assert peak.traction[0, direction] == pytest.approx(strength, rel=1e-12)
        far = 4.0 * strength / stiffness
        answers = path(law, np.array([far, 0.5 * far, 0.0, far])[:, None] * unit)
        loaded, half, zero, again = (float(a.traction[0, direction]) for a in answers)
        assert 0.0 < loaded < strength
        assert half == pytest.approx(0.5 * loaded, rel=1e-12)
        assert zero == pytest.approx(0.0, abs=1e-9 * strength)
        assert again == pytest.approx(loaded, rel=1e-12)
        assert [float(a.dissipation[0]) for a in answers[1:]] == [0.0] * 3


def test_pressure_acts_without_damage_and_friction_remains():
    """At constant pressure p a broken joint slides at mu p; before, c + mu p is not exceeded."""
    law, pressure = cohesive(), 2e6
    slip = np.linspace(0.0, 3e-3, 3001)
    gaps = np.column_stack([np.full_like(slip, -pressure / K_N), slip, 0.0 * slip])
    answers = path(law, gaps)
    shear = np.array([answer.traction[0, 1] for answer in answers])
    assert {float(answer.traction[0, 0]) for answer in answers} == {-pressure}
    assert shear[-1] == pytest.approx(MU * pressure, rel=1e-12)
    assert 0.9 * (C + MU * pressure) < shear.max() < C + MU * pressure
    assert answers[-1].status[0] == Status.SLIP
    assert answers[-1].state.internal[0, 4] == pytest.approx(G_2, rel=1e-12)


@pytest.mark.parametrize("method", ["backward_euler", "discrete_gradient"])
def test_broken_joint_equals_friction(method):
    law = cohesive()
    friction = dj.FrictionNoTension(
        normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=40.0
    )
    rng, gap = np.random.default_rng(3), np.full((200, 3), 1e-9)
    one, two = at_rest(law, gap), JointState.at_rest(gap)
    np.testing.assert_array_equal(one.internal[:, 0], 1.0)
    for _ in range(20):
        gap = gap + 1e-6 * rng.normal(size=gap.shape)
        first, second = getattr(law, method)(gap, one), getattr(friction, method)(gap, two)
        one, two = first.state, second.state
        np.testing.assert_allclose(first.traction, second.traction, rtol=0, atol=1e-6)
        np.testing.assert_allclose(first.tangent, second.tangent, rtol=0, atol=1e-3 * K_S * 1e-9)
        np.testing.assert_array_equal(first.status, second.status)


def random_walk(law, method, steps=30, count=4000):
    """Yield states and responses of points that open, close, slide and break."""
    rng, state = np.random.default_rng(0), at_rest(law, np.zeros((count, 3)))
    for _ in range(steps):
        size = 10.0 ** rng.uniform(-8.0, -4.5, (count, 1))
        gap = state.gap + size * rng.normal(size=(count, 3)) - [1e-7, 0.0, 0.0]
        answer = getattr(law, method)(gap, state)
        yield state, answer
        state = answer.state


@pytest.mark.parametrize("softening", SOFTENING)
def test_work_is_stored_or_dissipated(softening):
    """Discrete gradient: the work equals the change of (9c) plus friction plus broken bonds."""
    law, seen = cohesive(softening), 0
    for state, answer in random_walk(law, "discrete_gradient"):
        work = (answer.traction * (answer.state.gap - state.gap)).sum(axis=1)
        stored = law.stored_energy(answer.state), law.stored_energy(state)
        size = np.abs(work) + stored[0] + stored[1] + answer.dissipation
        assert (np.abs(stored[0] - stored[1] + answer.dissipation - work) <= 4e-15 * size).all()
        broken = answer.state.internal[:, 4] - state.internal[:, 4]
        assert (broken >= 0.0).all()
        assert (answer.state.internal[:, :2] >= state.internal[:, :2] - 1e-15).all()
        seen += np.count_nonzero(broken > 0.0)
    assert seen > 4000


@pytest.mark.parametrize("softening", SOFTENING)
def test_losses_of_backward_euler_are_complete(softening):
    """Friction and numerical loss plus stored energy are the work, for any traction that acts."""
    law, rng = cohesive(softening), np.random.default_rng(1)
    for state, answer in random_walk(law, "backward_euler", steps=8):
        traction = answer.traction + 1e5 * rng.normal(size=(len(answer.traction), 3))
        lost = law.losses(state, answer, traction)
        work = (traction * (answer.state.gap - state.gap)).sum(axis=1)
        stored = law.stored_energy(answer.state), law.stored_energy(state)
        size = np.abs(work) + stored[0] + stored[1] + np.abs(answer.dissipation)
        result = stored[0] - stored[1] + lost.friction + lost.numerical
        assert (np.abs(result - work) <= 1e-13 * size).all()


def piece_of(law, answer, state):
    """Number of the smooth piece of the law on which each point is."""
    grows = answer.state.internal[:, 1] > state.internal[:, 1]
    closed, gone = answer.state.gap[:, 0] <= 0.0, answer.state.internal[:, 0] == 1.0
    tension = answer.state.internal[:, 1] >= (2.0 * G_1 * K_N / F_T**2) ** 2
    return answer.status + 8 * grows + 16 * closed + 32 * gone + 64 * tension


@pytest.mark.parametrize("softening", SOFTENING)
@pytest.mark.parametrize("method", ["backward_euler", "discrete_gradient"])
def test_tangent_against_differences(softening, method):
    """Derivatives of the traction at a gap, also where the bond softens and friction grows.

    Steps of 1e-11 m leave differences of second order with an error of 1e-6 of the tangent.
    """
    law, softens = cohesive(softening), 0
    for state, _ in random_walk(law, "backward_euler", steps=6, count=1500):
        rng = np.random.default_rng(5)
        state = replace(state, slips=np.zeros((0, 5)))
        gap = state.gap + 3e-6 * rng.normal(size=state.gap.shape)

        def evaluate(at, state=state):
            answer = getattr(law, method)(at, state)
            return answer.traction, answer.tangent, piece_of(law, answer, state)

        worst, share = largest_error(evaluate, gap, np.full(len(gap), 1e-11), over=(1, 2))
        assert worst < 1e-5
        assert share > 0.99
        answer = getattr(law, method)(gap, state)
        softens += np.count_nonzero(answer.state.internal[:, 1] > state.internal[:, 1])
    assert softens > 1000


@pytest.mark.parametrize("softening", SOFTENING)
@pytest.mark.parametrize("method", ["backward_euler", "discrete_gradient"])
def test_point_on_a_compliance(softening, method):
    """The response is that of the law at the gap to which it leads; c times the softening is 0.9.

    Different starts, the order of magnitude of the trial gap, do not matter: it is unique.
    """
    law = cohesive(softening)
    weight = 1.0 if method == "backward_euler" else 0.5
    compliance = 0.9 / (weight * np.array([law.steepest_softening]))
    for state, _ in random_walk(law, "backward_euler", steps=6, count=2000):
        trial = state.gap + 1e-5 * np.random.default_rng(2).normal(size=state.gap.shape)
        answer = getattr(law, f"condensed_{method}")(trial, compliance, state)
        assert np.isfinite(answer.traction).all()
        gap = trial - np.repeat(compliance, (1, 2), axis=1) * answer.traction
        np.testing.assert_allclose(answer.state.gap, gap, rtol=0, atol=1e-15)
        there = getattr(law, method)(answer.state.gap, state).traction
        np.testing.assert_allclose(there, answer.traction, rtol=0, atol=1e-4 * F_T)


def test_bonds_that_break_at_once_are_the_limit():
    """With fracture energies of the elastic energy, the bond breaks as that of Mohr-Coulomb."""
    least = 0.5 * F_T**2 / K_N, 0.5 * C**2 / K_S
    law = cohesive(fracture_energy=least[0] * 1.0001, shear_fracture_energy=least[1] * 1.0001)
    brittle = dj.MohrCoulombJoint(
        normal_stiffness=K_N,
        shear_stiffness=K_S,
        friction_angle_deg=0.0,
        cohesion=C,
        tensile_strength=F_T,
    )
    for unit, strain in ((np.eye(3)[0], F_T / K_N), (np.eye(3)[1], C / K_S)):
        for size in (0.5, 0.999, 1.001, 3.0):
            gap = size * strain * unit[None]
            result = law.backward_euler(gap, at_rest(law, np.zeros((1, 3)))).traction
            state = JointState.at_rest(np.zeros((1, 3)), variables=2)
            np.testing.assert_allclose(
                result, brittle.backward_euler(gap, state).traction, rtol=0, atol=1e-3
            )


@pytest.mark.parametrize("name", ["fracture_energy", "shear_fracture_energy"])
def test_fracture_energy_below_the_elastic_energy_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} is 1 J/m.2; it must be above"):
        cohesive(**{name: 1.0})
