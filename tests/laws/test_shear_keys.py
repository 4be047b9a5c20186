# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shear keys from closed forms: a point under a pressure N, pushed across the keys in steps.

On a flank at alpha the shear is N tan(alpha + phi) and the opening slip times tan(alpha), both of
two rigid wedges; stiffness only shifts where they begin. Teeth shear off where the first exceeds
a c + N tan(phi_t) (Patton's two lines).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tangent_errors import central_differences

from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.law import JointState, LawWithLosses, Status
from dolfinx_joints.laws.shear_keys import ShearKeyJoint
from dolfinx_joints.laws.viscous import ViscousJoint

K_N, K_S, N = 1e11, 4e10, 1e6  # Pa/m, Pa
PHI, ALPHA, DEPTH, PLAY = 30.0, 40.0, 0.1, 0.01
STIFF = {"normal_stiffness": K_N, "shear_stiffness": K_S, "friction_angle_deg": PHI}
RULES = ["backward_euler", "discrete_gradient"]


def tan(angle):
    return math.tan(math.radians(angle))


def keys(**changes):
    given = {
        "depth": DEPTH,
        "flank_angle_deg": ALPHA,
        "spacing": 1.0,
        "tooth_cohesion": 50e6,
        "forward_play": PLAY,
        "backward_play": PLAY,
    }
    return ShearKeyJoint(**STIFF, **{**given, **changes})


def at_rest(law, gap):
    return replace(JointState.at_rest(gap), internal=law.initial_variables(gap))


def push(law, slips, *, pressure=N, direction=(1.0, 0.0), rule="backward_euler"):
    """Gaps, tractions and answers of a point at given slips, the opening free under a pressure.

    A tangential compliance of 1e-20 m/Pa gives the slip, a normal one of 1e-6 m/Pa and a trial gap
    of its product with the pressure the pressure, once it is corrected for the opening.
    """
    state, answers = at_rest(law, np.array([[-pressure / K_N, 0.0, 0.0]])), []
    compliance, trial = np.array([[1e-6, 1e-20]]), -pressure * (1e-6 + 1.0 / K_N)
    for slip in slips:
        for _ in range(6):
            gap = np.array([[trial, slip * direction[0], slip * direction[1]]])
            answer = getattr(law, f"condensed_{rule}")(gap, compliance, state)
            missing = pressure + answer.traction[0, 0]
            if abs(missing) < 1e-9 * pressure:
                break
            trial -= 1e-6 * missing
        state = answer.state
        answers.append(answer)
    gaps = np.array([answer.state.gap[0] for answer in answers])
    return gaps, np.array([answer.traction[0] for answer in answers]), answers


def steps(end, count=20):
    return np.linspace(0.0, end, count + 1)[1:]


def test_within_the_play_and_along_the_keys_it_is_plain_friction():
    for direction, end in (((1.0, 0.0), 0.9 * PLAY), ((0.0, -1.0), 0.2)):
        gaps, tractions, _ = push(keys(), steps(end), direction=direction)
        np.testing.assert_allclose(tractions[-1, 0], -N, rtol=1e-9)
        expected = N * tan(PHI) * np.array(direction)
        np.testing.assert_allclose(tractions[-1, 1:], expected, rtol=1e-9, atol=1e-3)
        np.testing.assert_allclose(gaps[:, 0], -N / K_N, rtol=1e-9)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("axis", [(0.0, 1.0), (3.0, 4.0)])
def test_riding_up_a_flank(way, axis):
    """Shear N tan(alpha + phi) across the keys, opening (slip - play) tan(alpha)."""
    across = way * np.array([axis[1], -axis[0]]) / math.hypot(*axis)
    gaps, tractions, answers = push(keys(key_axis=axis), steps(0.1, 80), direction=across)
    rising = slice(20, None)
    slip = gaps[rising, 1:] @ across
    # The flank's own overlap, of N cos(phi) / (k_n cos(alpha + phi)), is across the flank.
    force = N / math.cos(math.radians(ALPHA + PHI))
    overlap = force * math.cos(math.radians(PHI)) / K_N / math.cos(math.radians(ALPHA))
    np.testing.assert_allclose(gaps[rising, 0], (slip - PLAY) * tan(ALPHA) - overlap, rtol=1e-6)
    expected = np.array([-N, *(N * tan(ALPHA + PHI) * across)])
    np.testing.assert_allclose(tractions[rising], np.tile(expected, (60, 1)), rtol=1e-6, atol=10.0)
    assert {answer.status[0] for answer in answers[20:]} == {Status.SLIP}


def test_over_the_crest():
    """Beyond depth / tan(alpha) the point slides on the crests, at the depth."""
    top = PLAY + DEPTH / tan(ALPHA)
    gaps, tractions, answers = push(keys(), steps(top + 0.05, 120))
    np.testing.assert_allclose(gaps[-1, 0], DEPTH - N / K_N, rtol=1e-12)
    np.testing.assert_allclose(tractions[-1], [-N, N * tan(PHI), 0.0], rtol=1e-9, atol=1e-3)
    # It reached the depth where the flank ends, give or take a step.
    risen = gaps[gaps[:, 0] < DEPTH - 2.0 * N / K_N, 1].max()
    assert risen == pytest.approx(top, abs=2.0 * (top + 0.05) / 120)
    assert not answers[-1].state.internal[0, 0]


def test_disengaged_keys_pass_over_each_other():
    """At an opening above the depth nothing is met, just below it a flank is."""
    law = keys(tooth_cohesion=1e12)
    for opening, met in ((1.01 * DEPTH, False), (0.99 * DEPTH, True)):
        state = at_rest(law, np.array([[opening, 0.0, 0.0]]))
        found = []
        for slip in steps(0.3, 100):
            answer = law.backward_euler(np.array([[opening, slip, 0.0]]), state)
            state = answer.state
            found.append(answer.traction[0, 1])
        assert (max(found) > 0.0) == met


@pytest.mark.parametrize("rule", RULES)
def test_teeth_shear_off(rule):
    """A rectangular key without friction bears a c, in the slip play + a c / k_n; then it is gone.

    a is half, the width of the teeth being that of the recesses.
    """
    law = ShearKeyJoint(
        normal_stiffness=K_N,
        shear_stiffness=K_S,
        friction_coefficient=0.0,
        depth=DEPTH,
        flank_angle_deg=90.0,
        spacing=1.0,
        tooth_cohesion=2e6,
        forward_play=PLAY,
    )
    assert law.cohesion == pytest.approx(1e6, rel=1e-14)
    shares = np.array([0.0, 0.5, 0.9, 0.99, 0.999, 1.001, 1.01, 2.0])
    slips = PLAY + shares * 1e6 / K_N
    gaps, tractions, answers = push(law, slips, rule=rule)
    ends = K_N * (gaps[:, 1] - PLAY)
    mean = 0.5 * (ends + np.concatenate([[0.0], ends[:-1]]))
    expected = ends if rule == "backward_euler" else mean
    held = expected < 1e6
    np.testing.assert_allclose(tractions[held, 1], expected[held], rtol=1e-6, atol=10.0)
    np.testing.assert_allclose(tractions[~held, 1], 0.0, atol=1e-6)
    assert [a.state.internal[0, 0] for a in answers] == [*(~held).astype(float)]
    assert 0 < (~held).sum() < 4
    # What it held, (a c)^2 / (2 k_n) or nearly, is dissipated at once.
    first = int(np.argmax(~held))
    assert answers[first].dissipation[0] == pytest.approx(1e12 / (2.0 * K_N), rel=0.05)


def test_sheared_teeth_leave_friction_at_the_opening_reached():
    """From half the height of a flank, torn off by a pressure that grows fivefold."""
    law = keys(tooth_cohesion=1e6)
    _, _, answers = push(law, steps(0.05, 50), pressure=0.2 * N)
    state = answers[-1].state
    assert not state.internal[0, 0]
    height = state.gap[0, 0]
    assert height == pytest.approx(0.04 * tan(ALPHA), rel=1e-3)
    for slip in (1e-4, -1e-4, -1e-2, -0.1):
        gap = np.array([[height - N * 1e-6, state.gap[0, 1] + slip, 0.0]])
        answer = law.condensed_backward_euler(gap, np.array([[1e-6, 1e-20]]), state)
        state = answer.state
    assert state.internal[0, 0] == 1.0
    np.testing.assert_allclose(answer.traction[0, 0], -N, rtol=1e-3)
    np.testing.assert_allclose(answer.traction[0, 1], -N * tan(PHI), rtol=1e-3)
    assert state.gap[0, 0] == pytest.approx(height, abs=2e-5)


def test_strong_teeth_are_ridden_over_where_weak_ones_shear():
    """Patton: N (tan(alpha + phi) - tan(phi_t)) = a c parts them."""
    law = keys(tooth_cohesion=1e6)
    parting = law.cohesion / (tan(ALPHA + PHI) - tan(PHI))
    for pressure, sheared in ((0.95 * parting, 0.0), (1.05 * parting, 1.0)):  # [Pa], broken
        _, _, answers = push(law, steps(0.05, 100), pressure=pressure)
        assert answers[-1].state.internal[0, 0] == sheared


def test_keys_of_one_side():
    """Free one way, and stopped the other way by a flank that nothing can ride up."""
    law = keys(flank_angle_deg=90.0, forward_play=None, backward_play=2e-3)
    _, tractions, _ = push(law, steps(0.2))
    np.testing.assert_allclose(tractions[-1, 1], N * tan(PHI), rtol=1e-9)
    gaps, tractions, _ = push(law, steps(-2.1e-3))
    # Beyond the play of 2 mm, 0.1 mm of overlap of the flank and the friction of the base.
    expected = -K_N * 1e-4 - N * tan(PHI)
    assert gaps[-1, 0] < 0.0
    assert tractions[-1, 1] == pytest.approx(expected, rel=0.1)


def walk(law, rule, count=1000, number=10):
    """Steps of random histories along base, flanks and crests: before, answer, change of gap."""
    rng = np.random.default_rng(7)
    flank, (along_1, along_2) = DEPTH / tan(law.flank_angle_deg), law.key_axis
    across = np.array([along_2, -along_1]) / math.hypot(along_1, along_2)
    slip = rng.uniform(-2.0, 2.0, count) * (PLAY + flank)
    slip[::2] = rng.choice([-1.0, 1.0], (count + 1) // 2) * PLAY
    height = np.clip((np.abs(slip) - PLAY) / max(flank, 1e-12) * DEPTH, 0.0, DEPTH)
    gap = np.column_stack([height, slip[:, None] * across])
    state = at_rest(law, gap + 2e-5 * rng.normal(size=gap.shape))
    for _ in range(number):
        moved = 2e-5 * rng.normal(size=gap.shape)
        answer = getattr(law, rule)(state.gap + moved, state)
        yield state, answer, moved
        state = answer.state


LAWS = {
    "strong": keys(),
    "weak": keys(tooth_cohesion=3e5),
    "one side": keys(backward_play=None),
    "steep": keys(flank_angle_deg=90.0),
    "turned": keys(key_axis=(1.0, 2.0)),
}


@pytest.mark.parametrize("name", LAWS)
def test_whole_steps_balance_energy(name):
    """Work = stored + dissipated, and friction takes from every point on the way."""
    law, taken = LAWS[name], 0.0
    for before, answer, moved in walk(law, "discrete_gradient"):
        work = np.einsum("ij,ij->i", answer.traction, moved)
        stored = law.stored_energy(answer.state) - law.stored_energy(before)
        scale = np.abs(work).max()
        np.testing.assert_allclose(answer.dissipation, work - stored, rtol=0, atol=1e-12 * scale)
        assert law.stored_energy(answer.state).min() >= 0.0
        taken = taken + answer.dissipation
        # A turn within a step gives back up to half the friction work of the step before.
        assert taken.min() >= -1e-12 * scale
    assert taken.max() > 0.0
    assert bool(answer.state.internal[:, 0].any()) == (name == "weak")


@pytest.mark.parametrize("name", LAWS)
def test_losses_of_end_point_steps(name):
    """With what is stored they are the work of any traction; of that of the end no gain."""
    law, last = LAWS[name], None
    assert isinstance(law, LawWithLosses)
    for before, answer, moved in walk(law, "backward_euler"):
        stored = law.stored_energy(answer.state) - law.stored_energy(before)
        lost = law.losses(before, answer, answer.traction)
        scale = np.abs(np.einsum("ij,ij->i", answer.traction, moved)).max()
        assert min(lost.friction.min(), lost.numerical.min()) >= -1e-12 * scale
        start = answer.traction if last is None else last.traction
        for traction in (answer.traction, 0.5 * (answer.traction + start), start):
            lost = law.losses(before, answer, traction)
            work = np.einsum("ij,ij->i", traction, moved)
            np.testing.assert_allclose(sum(lost[:2]), work - stored, rtol=0, atol=1e-12 * scale)
        last = answer


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("name", LAWS)
def test_tangents(name, rule):
    """Against central differences, also on a compliance, whose equation is met.

    Differences of 1e-10 m on tractions of gaps of 0.1 m leave 1e-16 * 0.1 * k / 1e-10, 1e-7 k; a
    point within a step of a kink may show more: one in a hundred is let go.
    """
    law = LAWS[name]
    before, answer, moved = list(walk(law, rule, number=6))[-1]
    rng, gap = np.random.default_rng(8), before.gap + moved
    c = 10.0 ** rng.uniform(-13, -10, (len(gap), 1)) * rng.uniform(0.5, 2.0, (len(gap), 2))
    condensed = getattr(law, f"condensed_{rule}")

    def on_compliance(trial):
        return condensed(trial, c, before)

    found = on_compliance(gap)
    met = gap - np.repeat(c, (1, 2), axis=1) * found.traction
    np.testing.assert_allclose(found.state.gap, met, rtol=0, atol=1e-14)
    whole = getattr(law, rule)(found.state.gap, before)
    np.testing.assert_allclose(whole.traction, found.traction, rtol=0, atol=1e-6 * N)
    for evaluate, given in ((lambda g: getattr(law, rule)(g, before), answer),
                            (on_compliance, found)):  # fmt: skip
        slopes = central_differences(lambda g, e=evaluate: e(g).traction, gap, 1e-10)
        error = np.abs(slopes - given.tangent).max(axis=(1, 2)) / K_N
        assert np.quantile(error, 0.99) < 3e-6


def test_open_or_without_teeth_it_is_the_friction_joint():
    """Under random steps far from the flanks: the same tractions, tangents, states."""
    plain, law = FrictionNoTension(**STIFF), keys(forward_play=None, backward_play=None)
    rng = np.random.default_rng(9)
    gap = 1e-5 * rng.normal(size=(500, 3))
    one, two = JointState.at_rest(gap), at_rest(law, gap)
    for _ in range(5):
        gap = gap + 1e-5 * rng.normal(size=gap.shape)
        a, b = plain.discrete_gradient(gap, one), law.discrete_gradient(gap, two)
        for first, second in ((a.traction, b.traction), (a.tangent, b.tangent)):
            np.testing.assert_allclose(second, first, rtol=1e-12, atol=1e-6)
        np.testing.assert_array_equal(b.status, a.status)
        one, two = a.state, b.state


def test_parameters_that_contradict_each_other():
    for changes, text in (
        ({"spacing": 0.2}, "spacing is 0.2 m; it must be at least the width of two flanks"),
        (
            {"tooth_width": 0.1},
            "tooth_width is 0.1 m; it must be between the width of two flanks, 0.238351 m",
        ),
        ({"key_axis": (0.0, 0.0)}, "key_axis is .0, 0.; it must be a direction"),
    ):
        with pytest.raises(ValueError, match=text):
            keys(**changes)
    with pytest.raises(ValueError, match="dashpots need a law that closes at a gap of zero"):
        ViscousJoint(law=keys())
