# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The laws over a whole step: by hand, energy, limits, tangents, on a compliance, and rigid.

The random states are of all kinds: open, closed, opening, closing, with and without elastic slip;
of ten, four lie on a kink of the law or next to one. `reference` writes the rule down in gaps as
the docstring of `midpoint_law` has it, in extended precision and with none of its formulae for the
compliance; the tangents are compared with its second-order differences.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from tangent_errors import largest_error

from dolfinx_joints import FrictionNoTension, KeyedJoint, RigidJoint
from dolfinx_joints.laws.law import JointState, Status

MPA, UM = 1e6, 1e-6
K_N, K_S = 1e12, 2e12  # Pa/m
COUNT = 100_000
STIFFNESS = [1e5, 1e12, 1e16]
WIDE = np.longdouble

extended = pytest.mark.skipif(np.finfo(WIDE).eps > 1e-18, reason="needs an extended precision type")


def friction(k_n=K_N, k_s=K_S, mu=0.5):
    return FrictionNoTension(
        normal_stiffness=k_n,
        shear_stiffness=k_s,
        friction_angle_deg=math.degrees(math.atan(mu)),
    )


LAW = friction()
LAWS = {
    **{f"k_n {k:g}": friction(k, 0.4 * k) for k in STIFFNESS},
    "stiff in shear": friction(1e9, 1e13),
    "soft in shear": friction(1e16, 1e9),
    "no shear stiffness": friction(k_s=0.0),
    "no friction": friction(mu=0.0),
    "89.9 degrees": friction(mu=math.tan(math.radians(89.9))),
}


# By hand: k_n 1e12 and k_s 2e12 Pa/m, mu 0.5; gaps in um.


def one_step(before, after, slip=(0.0, 0.0), law=LAW):
    """Answer to a step between two gaps [um] from an elastic slip [um]."""
    state = JointState(gap=UM * np.array([before]), elastic_slip=UM * np.array([slip]))
    return law.discrete_gradient(UM * np.array([after]), state)


@dataclass(frozen=True)
class ByHand:
    """A step: gaps and elastic slip [um]; tractions [MPa], slip [um] and loss [J/m^2] after it."""

    before: tuple[float, float, float]
    after: tuple[float, float, float]
    slip: tuple[float, float]
    traction: tuple[float, float, float]
    slip_after: tuple[float, float]
    loss: float
    status: Status


BY_HAND = {
    # Closed all the time: the mean of 1 and 3 MPa; 2 MPa/um (0.1 + 0.2/2) um of shear.
    "sticks": ByHand((-1, 0, 0), (-3, 0.2, 0), (0.1, 0), (-2, 0.4, 0), (0.3, 0), 0.0, Status.STICK),
    # 2 MPa/um (0.2 + 0.8/2) um = 1.2 MPa is above mu times 2 MPa: 1 MPa; z = 2 0.5 - 0.2 = 0.8 um,
    # and mu 3 MPa / k_s = 0.75 um of it can stay. Loss 1 MPa (0.8 - 0.6) um + 1 MPa/um
    # (0.8^2 - 0.75^2) um^2 = 0.2 + 0.0775 J/m^2.
    "slides": ByHand(
        (-1, 0, 0), (-3, 0.8, 0), (0.2, 0), (-2, 1, 0), (0.75, 0), 0.2775, Status.SLIP
    ),
    # Half of the step in contact: k_n (b/2) theta = 0.25 MPa, over 2 um the 0.5 J/m^2 that are
    # stored. Half of the slip counts: 2 MPa/um (0.4/2)/2 um = 0.2 MPa, for half of the time.
    "closes half-way": ByHand(
        (1, 0, 0), (-1, 0.4, 0), (0, 0), (-0.25, 0.1, 0), (0.2, 0), 0.0, Status.STICK
    ),
    # 2 MPa/um (1/2)/2 um = 0.5 MPa is above mu 0.5 MPa: 0.25 MPa for half of the time. Loss
    # 0.25 MPa (0.5 - 0.25) um.
    "closes sliding": ByHand(
        (1, 0, 0), (-1, 1, 0), (0, 0), (-0.25, 0.125, 0), (0.25, 0), 0.0625, Status.SLIP
    ),
    # 2 MPa/um 0.2 um = 0.4 MPa is above 0.25 MPa. No slip in this step: the joint does no work in
    # shear, and loses all of the 1 MPa/um (0.2 um)^2 that it had.
    "opens half-way": ByHand(
        (-1, 0, 0), (1, 0, 0), (0.2, 0), (-0.25, 0.125, 0), (0, 0), 0.04, Status.OPEN
    ),
    # A quarter of the step in contact: 1 MPa/2/4; (0, 0.02) um stay below the limit. The pull of
    # 0.04 MPa for a quarter of the step acts on no slip: the 4e-4 J/m^2 of the start are lost.
    "opens sticking": ByHand(
        (-1, 0, 0), (3, 0, 0), (0, 0.02), (-0.125, 0, 0.01), (0, 0), 4e-4, Status.OPEN
    ),
    "stays open": ByHand((1, 0, 0), (2, 5, 5), (0, 0), (0, 0, 0), (0, 0), 0.0, Status.OPEN),
    # A gap of zero is closed; reaching and leaving it takes nothing.
    "touches": ByHand((1, 0, 0), (0, 1, 0), (0, 0), (0, 0, 0), (0, 0), 0.0, Status.STICK),
    "leaves zero": ByHand((0, 0, 0), (1, 1, 0), (0, 0), (0, 0, 0), (0, 0), 0.0, Status.OPEN),
    "closes from zero": ByHand(
        (0, 0, 0), (-2, 0.2, 0), (0, 0), (-1, 0.2, 0), (0.2, 0), 0.0, Status.STICK
    ),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_by_hand(name):
    case = BY_HAND[name]
    answer = one_step(case.before, case.after, case.slip)
    np.testing.assert_allclose(answer.traction[0] / MPA, case.traction, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(answer.state.gap[0] / UM, case.after, rtol=1e-13)
    slip = answer.state.elastic_slip[0] / UM
    np.testing.assert_allclose(slip, case.slip_after, rtol=1e-13, atol=1e-15)
    assert answer.dissipation[0] == pytest.approx(case.loss, rel=1e-13, abs=1e-15)
    assert answer.status[0] == case.status


def test_a_gap_of_zero_is_closed_and_stiff():
    # Pressed in by g from there the mean traction of the step is k_n g / 2; shear needs pressure.
    answer = one_step((0, 0, 0), (0, 0, 0))
    np.testing.assert_allclose(answer.tangent, [np.diag([0.5 * K_N, 0.0, 0.0])], rtol=1e-14)
    assert answer.status[0] == Status.STICK


def test_keys_hold_at_any_opening():
    # Half of the step in contact, and keys that carry the mean of 0.1 and 0.5 um all the time.
    law = KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S)
    answer = one_step((1, 0.1, 0), (-1, 0.5, 0), (0.1, 0), law)
    np.testing.assert_allclose(answer.traction[0] / MPA, [-0.25, 0.6, 0], rtol=1e-13)
    np.testing.assert_allclose(answer.state.elastic_slip[0] / UM, [0.5, 0], rtol=1e-13)
    assert answer.dissipation[0] == 0.0


def test_a_rigid_joint_by_hand():
    # Rigid, on a compliance of 2 um/MPa, k_n/k_s 1. A point 1 um open that would go 3 um the other
    # way stops at zero with 1 MPa, and keeps that over its way of 1 um, 1 J/m^2. Pulled up by 1 um
    # from there it goes y with t = -1/y and y = 1 + 2/y, 2 um, in which it gives all of it back.
    law = RigidJoint(friction_angle_deg=0.0)
    compliance = UM / MPA * np.array([[2.0, 2.0]])
    state = JointState.at_rest(UM * np.array([[1.0, 0, 0]]), variables=3)
    closed = law.condensed_discrete_gradient(UM * np.array([[-2.0, 0, 0]]), compliance, state)
    np.testing.assert_allclose(closed.traction[0] / MPA, [-1, 0, 0], rtol=1e-13)
    assert closed.state.gap[0, 0] == 0.0
    assert law.stored_energy(closed.state)[0] == pytest.approx(1.0, rel=1e-13)
    left = law.condensed_discrete_gradient(UM * np.array([[1.0, 0, 0]]), compliance, closed.state)
    np.testing.assert_allclose(left.traction[0] / MPA, [-0.5, 0, 0], rtol=1e-13)
    assert left.state.gap[0, 0] == pytest.approx(2 * UM, rel=1e-13)
    assert law.stored_energy(left.state)[0] == 0.0


# Random states.


@dataclass(frozen=True)
class Steps:
    """Steps of random points: state at the start, gap at the end, and the law's scale of each.

    Attributes:
        state: At the start.
        gap: At the end, shape (n, 3), [m].
        size: Of the tractions that may come of it, shape (n,), [Pa].
    """

    state: JointState
    gap: np.ndarray
    size: np.ndarray


def random_steps(law, count=COUNT, seed=1):
    """Steps under some kPa to 10 MPa, opening gaps from far below to far above the overlaps.

    Elastic slips are within the limit of friction at the start.
    """
    rng = np.random.default_rng(seed)
    k_n, k_s, mu = (
        law.normal_stiffness,
        law.shear_stiffness,
        getattr(law, "friction_coefficient", 1),
    )
    pressure = MPA * 10.0 ** rng.uniform(-3, 1, (count, 2))
    both = -pressure / k_n
    is_open = rng.random((count, 2)) < 0.4
    wide = np.abs(both[:, ::-1]) * 10.0 ** rng.uniform(-3, 3, (count, 2))
    both = np.where(is_open, wide, both)
    kind = rng.integers(0, 10, count)
    both[kind == 0, 0] = 0.0
    both[(kind == 1) & ~is_open[:, 0], 1] = 0.0
    both[kind == 2, 1] *= 1e-4
    g0, g1 = both.T
    limit = mu * k_n * np.maximum(-g0, 0.0) / (k_s or k_n)
    turn = rng.uniform(0, 2 * math.pi, (count, 2))
    ways = np.stack([np.cos(turn), np.sin(turn)], axis=2)
    e0 = (limit * np.sqrt(rng.random(count)))[:, None] * ways[:, 0]
    theta = fraction(g0, g1)
    mean = mu * k_n * np.abs(np.minimum(g0, 0) + np.minimum(g1, 0)) / 2 / (k_s or k_n)
    slip = (mean * 10.0 ** rng.uniform(-2, 2, count))[:, None] * ways[:, 1]
    at_limit = (kind == 3) & (theta > 1e-3) & (mean > 0)
    beside = 1.0 + rng.choice([-1e-5, 1e-5], count)
    aimed = (mean * beside)[:, None] * ways[:, 1] - e0
    slip[at_limit] = (2 * aimed / np.where(theta > 0, theta, 1.0)[:, None])[at_limit]
    slip[kind == 4] = 0.0
    e0[(kind == 4) | (kind == 5)] = 0.0
    start = mean[:, None] * rng.normal(size=(count, 2))
    state = JointState(gap=np.column_stack([g0, start]), elastic_slip=e0 if k_s else 0.0 * e0)
    gap = np.column_stack([g1, start + slip])
    overlap = np.maximum(np.maximum(-g0, -g1), 0.0)
    moved = np.linalg.norm(gap[:, 1:] - state.gap[:, 1:], axis=1) + np.linalg.norm(e0, axis=1)
    return Steps(state=state, gap=gap, size=max(1.0, mu) * k_n * overlap + k_s * moved)


def fraction(g0, g1):
    """Part of a straight step from g0 to g1 that is spent at gaps of zero or less."""
    a, b = np.minimum(g0, 0), np.minimum(g1, 0)
    way = g1 - g0
    safe = np.where(way == 0, 1, way)
    return np.where((g0 <= 0) & (g1 <= 0), 1, np.where((g0 <= 0) | (g1 <= 0), (b - a) / safe, 0))


def reference(law, gap, state):
    """Traction, elastic slip after, dissipation and piece of a step, from the rule in gaps."""
    k_n, k_s, mu = WIDE(law.normal_stiffness), WIDE(law.shear_stiffness), law.friction_coefficient
    gap, before = gap.astype(WIDE), state.gap.astype(WIDE)
    g0, g1 = before[:, 0], gap[:, 0]
    a, b = np.minimum(g0, 0), np.minimum(g1, 0)
    theta = fraction(g0, g1)
    pressure = -k_n * (a + b) / 2
    moved = theta[:, None] * (gap[:, 1:] - before[:, 1:])
    e0 = state.elastic_slip.astype(WIDE)
    trial = k_s * (e0 + moved / 2)
    size, limit = np.hypot(trial[:, 0], trial[:, 1]), mu * pressure
    slides = (size > limit) & (theta > 0)
    shear = trial * np.where(slides, limit / np.where(size > 0, size, 1), 1)[:, None]
    shear[(theta == 0) | (pressure == 0)] = 0
    z = 2 * shear / (k_s or 1) - e0
    most = mu * k_n * -b / (k_s or 1)
    reached = np.hypot(z[:, 0], z[:, 1])
    e1 = z * np.where(reached > most, most / np.where(reached > 0, reached, 1), 1)[:, None]
    loss = np.sum(shear * (moved - (z - e0)), axis=1)
    loss += k_s / 2 * np.sum(z**2 - e1**2, axis=1)
    piece = slides + 2 * (g1 > 0) + 4 * (theta > 0)
    return np.column_stack([-theta * pressure, theta[:, None] * shear]), e1, loss, piece


def test_random_steps_are_of_all_kinds():
    steps = random_steps(LAW)
    answer = LAW.discrete_gradient(steps.gap, steps.state)
    was, now = steps.state.gap[:, 0] > 0, steps.gap[:, 0] > 0
    for before in (False, True):
        for status in (Status.OPEN, Status.STICK, Status.SLIP):
            share = np.mean((was == before) & (answer.status == status))
            assert share > 0.03, (before, status)
    assert np.mean(was & now) > 0.1


@extended
@pytest.mark.parametrize("name", LAWS)
def test_step_is_the_rule_written_in_gaps(name):
    """To 2e-15 of stiffness times gaps, which is what the rounding of the gaps leaves open.

    The loss is a small difference of energies where friction is high or shear soft: 1e-13.
    """
    law = LAWS[name]
    steps = random_steps(law)
    answer = law.discrete_gradient(steps.gap, steps.state)
    traction, slip, loss, _ = reference(law, steps.gap, steps.state)
    scale = np.where(steps.size > 0, steps.size, 1.0)
    worst = float((np.abs(answer.traction - traction).max(axis=1) / scale).max())
    drift = law.shear_stiffness * np.abs(answer.state.elastic_slip - slip).max(axis=1)
    lost = np.abs(answer.dissipation - loss) / energy_scale(law, steps.state, answer)
    print(
        f"\n{name}: traction {worst:.1e}, slip {(drift / scale).max():.1e}, loss {lost.max():.1e}"
    )
    assert worst <= 2e-15
    assert (drift / scale).max() <= 2e-15
    assert lost.max() <= 1e-13


ENERGY_LAWS = {
    **LAWS,
    **{f"keyed {k:g}": KeyedJoint(normal_stiffness=k, shear_stiffness=k / 3) for k in STIFFNESS},
}


@pytest.mark.parametrize("name", ENERGY_LAWS)
def test_energy_of_a_step_adds_up(name):
    """t . (change of the gap) = change of stored energy + dissipation, to a few roundings."""
    law = ENERGY_LAWS[name]
    steps = random_steps(law, seed=2)
    answer = law.discrete_gradient(steps.gap, steps.state)
    worst, least = balance(law, steps.state, answer)
    print(f"\n{name}: balance {worst:.1e}, least dissipation {least:.1e}")
    assert worst <= 2e-15
    assert least >= -2e-15


def energy_scale(law, before, answer, free=None):
    """Sum of the sizes of the works and energies of a step, shape (n,), [J/m^2].

    Where a gap is what is left of a free gap, its rounding is that of the free gap.
    """
    moved = answer.state.gap - before.gap if free is None else np.abs(free) + np.abs(before.gap)
    works = np.abs(answer.traction * moved).sum(axis=1)
    total = works + law.stored_energy(before) + law.stored_energy(answer.state)
    return np.where(total > 0, total, 1.0)


def balance(law, before, answer, free=None):
    """Largest imbalance and least dissipation relative to the works and energies of the point."""
    work = np.sum(answer.traction * (answer.state.gap - before.gap), axis=1)
    stored = law.stored_energy(answer.state) - law.stored_energy(before)
    scale = energy_scale(law, before, answer, free)
    missing = np.abs(work - stored - answer.dissipation) / scale
    return float(missing.max()), float((answer.dissipation / scale).min())


@pytest.mark.parametrize("name", LAWS)
def test_admissible(name):
    """No tension, friction within its limit over the contact and at the end, nothing while open.

    |t_s| <= mu |t_n| holds for the step as for its part in contact, as both carry theta.
    """
    law = LAWS[name]
    steps = random_steps(law, seed=3)
    answer = law.discrete_gradient(steps.gap, steps.state)
    mu, k_s = law.friction_coefficient, law.shear_stiffness
    t_n, t_s = answer.traction[:, 0], np.linalg.norm(answer.traction[:, 1:], axis=1)
    assert t_n.max() <= 0.0
    assert np.all(t_s <= -mu * t_n * (1 + 1e-14))
    apart = (steps.state.gap[:, 0] > 0) & (steps.gap[:, 0] > 0)
    assert not answer.traction[apart].any()
    assert not answer.tangent[apart].any()
    overlap = np.maximum(-steps.gap[:, 0], 0.0)
    held = k_s * np.linalg.norm(answer.state.elastic_slip, axis=1)
    # The gap at the end has the rounding of that at the start.
    rounded = (1 + 4e-15) * overlap + 1e-15 * np.abs(steps.state.gap[:, 0])
    allowed = mu * law.normal_stiffness * rounded
    assert np.all(held <= allowed)
    assert np.array_equal(answer.status == Status.OPEN, steps.gap[:, 0] > 0)
    assert not answer.state.elastic_slip[steps.gap[:, 0] > 0].any()


# Tangents.


def lengths(law, steps):
    """Lengths over which the rule curves, normal and tangential, shape (n, 3), [m].

    That is the way of the normal gap where contact begins or ends, and the slip that gives sliding
    its direction.
    """
    g0, g1 = steps.state.gap[:, 0], steps.gap[:, 0]
    theta = fraction(g0, g1)
    moved = theta[:, None] * (steps.gap[:, 1:] - steps.state.gap[:, 1:])
    trial = np.linalg.norm(steps.state.elastic_slip + moved / 2, axis=1)
    most = np.maximum(np.linalg.norm(moved, axis=1), trial)
    share = np.where(trial > 0, trial / np.where(most > 0, most, 1.0), 1.0)
    way = np.where(g1 < 0, np.minimum(np.abs(g1 - g0), -g1), np.abs(g1 - g0))
    overlap = np.maximum(np.abs(g0), np.abs(g1))
    normal = np.where((theta > 0) & (theta < 1), way * share, overlap)
    tangential = np.where(trial > 0, trial, overlap) / np.where(theta > 0, theta, 1.0)
    return np.column_stack([normal, tangential, tangential])


@extended
@pytest.mark.parametrize("name", LAWS)
def test_tangent(name):
    """Against differences of the rule in gaps, in units of these lengths, to 1e-8 of the largest.

    Steps of 3e-6 leave 1e-11 of truncation, and the rounding of gaps that are some 1e5 times
    longer than the overlaps that they lead to some 1e-9.
    """
    law = LAWS[name]
    steps = random_steps(law, seed=5)
    unit = lengths(law, steps)

    tangent = law.discrete_gradient(steps.gap, steps.state).tangent * unit[:, None, :]

    def evaluate(way):
        traction, _, _, piece = reference(law, steps.gap + way * unit, steps.state)
        return traction, tangent, piece

    start, step = np.zeros((COUNT, 3), WIDE), np.full(COUNT, WIDE(3e-6))
    worst, share = largest_error(evaluate, start, step, over=(1, 2))
    print(f"\n{name}: tangent {worst:.1e}, {share:.2%} compared")
    assert worst <= 1e-8
    assert share > 0.999


# On the compliance of a structure, and rigid.


def compliances(law, count=COUNT, seed=6):
    """Compliances from 1e-3 to 1e3 times those of the joint, shape (count, 2), [m/Pa]."""
    rng = np.random.default_rng(seed)
    own = 1.0 / np.array([law.normal_stiffness, law.shear_stiffness or law.normal_stiffness])
    return own * 10.0 ** rng.uniform(-3, 3, (count, 1)) * rng.uniform(0.3, 3.0, (count, 2))


def on(compliance, traction):
    """Compliance times traction, shape (n, 3), [m]."""
    return np.repeat(compliance, (1, 2), axis=1) * traction


@pytest.mark.parametrize("name", LAWS)
def test_local_step_meets_step_where_it_leads(name):
    """Its definition: free gap = gap + c t with t = step(gap).

    From a free gap made so the traction must come back: gap + c t is stored to a rounding of its
    size, which the joint's stiffness on the compliance, 1/(c + 1/k), turns into a traction. Where
    normal and shear differ in stiffness, or friction is high, an error of one is one of the other.
    """
    law = LAWS[name]
    steps = random_steps(law, seed=7)
    compliance = compliances(law)
    there = law.discrete_gradient(steps.gap, steps.state)
    free = steps.gap + on(compliance, there.traction)
    back = law.condensed_discrete_gradient(free, compliance, steps.state)
    size = np.abs(free).max(axis=1) + np.abs(steps.state.gap).max(axis=1)
    soft = 1.0 / (compliance + 1.0 / np.array([law.normal_stiffness, law.shear_stiffness or 1.0]))
    error = np.abs(back.traction - there.traction).max(axis=1)
    scale = steps.size + soft.max(axis=1) * size
    print(f"\n{name}: traction {(error / scale).max():.1e}")
    assert (error / scale).max() <= 1e-13
    reached = np.abs(back.state.gap - steps.gap).max(axis=1)
    assert (reached / size).max() <= 1e-13


@pytest.mark.parametrize("name", LAWS)
def test_energy_on_a_compliance_adds_up(name):
    law = LAWS[name]
    steps = random_steps(law, seed=8)
    answer = law.condensed_discrete_gradient(steps.gap, compliances(law), steps.state)
    worst, least = balance(law, steps.state, answer, free=steps.gap)
    print(f"\n{name}: balance {worst:.1e}, least dissipation {least:.1e}")
    assert worst <= 1e-13
    assert least >= -1e-13


def at_limit(law, answer):
    """Where friction is at its limit over the step, also if the point is open after it."""
    size = np.linalg.norm(answer.traction[:, 1:], axis=1)
    return size >= -law.friction_coefficient * answer.traction[:, 0] * (1 - 1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_tangent_on_a_compliance(name):
    """d t/d h = D (1 + c D)^-1 with the tangent D of `step` at the gap that is reached.

    In units of the lengths over which the rule curves.
    """
    law = LAWS[name]
    steps = random_steps(law, seed=9)
    compliance = compliances(law)
    there = law.discrete_gradient(steps.gap, steps.state)
    free = steps.gap + on(compliance, there.traction)
    back = law.condensed_discrete_gradient(free, compliance, steps.state)
    # On the kink at a gap of zero either tangent is right.
    same = (at_limit(law, back) == at_limit(law, there)) & (steps.gap[:, 0] != 0.0)
    unit = lengths(law, steps)
    own = there.tangent * unit[:, None, :]
    structure = np.eye(3) + (np.repeat(compliance, (1, 2), axis=1) / unit)[:, :, None] * own
    expected = own @ np.linalg.inv(structure)
    error = np.abs(back.tangent * unit[:, None, :] - expected).max(axis=(1, 2))
    size = np.abs(expected).max(axis=(1, 2))
    relative = error[same] / np.where(size > 0, size, 1.0)[same]
    print(f"\n{name}: {relative.max():.1e}, {same.mean():.2%}")
    assert relative.max() <= 1e-8
    assert same.mean() > 0.9


def rigid_steps(law, seed=10):
    """A rigid joint, states and free gaps that a joint of finite stiffness has as well.

    Returns:
        States of the rigid joint, free gaps and compliances, for points that start open, or closed
        with what a last step left stored.
    """
    steps = random_steps(friction(1e10, 1e10), seed=seed)
    compliance = compliances(friction(1e10, 1e10))
    before = steps.state.gap.copy()
    closed = before[:, 0] <= 0.0
    stored = np.where(closed, 0.5e10 * before[:, 0] ** 2, 0.0)
    before[closed, 0] = 0.0
    limit = law.friction_coefficient * np.sqrt(2.0 * law.stiffness_ratio * stored)
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, 2 * math.pi, COUNT)
    root = (limit * np.sqrt(rng.random(COUNT)))[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)
    state = JointState(
        gap=before,
        elastic_slip=np.zeros((COUNT, 2)),
        internal=np.column_stack([stored, root]),
    )
    return state, steps.gap, compliance


RIGID = [
    RigidJoint(friction_angle_deg=a, stiffness_ratio=r)
    for a in (0.0, 30.0, 89.9)
    for r in (0.4, 2.5)
]


@pytest.mark.parametrize("law", RIGID)
def test_a_rigid_point_that_cannot_slide_has_no_shear(law):
    # 2 um/MPa across, none along: pressed by -2 um it takes 1 MPa, what would slide is held.
    state = JointState.at_rest(np.zeros((1, 3)), variables=3)
    answer = law.condensed_discrete_gradient(
        UM * np.array([[-2.0, 0, 0]]), UM / MPA * np.array([[2.0, 0.0]]), state
    )
    np.testing.assert_allclose(answer.traction[0] / MPA, [-1, 0, 0], rtol=1e-13)
    np.testing.assert_allclose(answer.tangent[0], np.diag([0.5 * MPA / UM, 0, 0]), rtol=1e-13)
    np.testing.assert_array_equal(answer.state.gap, 0.0)
    free = law.friction_coefficient == 0.0
    assert answer.status[0] == (Status.FRICTIONLESS if free else Status.STICK)


@pytest.mark.parametrize("law", RIGID)
def test_energy_of_a_rigid_joint_adds_up(law):
    state, free, compliance = rigid_steps(law)
    answer = law.condensed_discrete_gradient(free, compliance, state)
    worst, least = balance(law, state, answer, free=free)
    print(f"\nbalance {worst:.1e}, least dissipation {least:.1e}")
    assert worst <= 2e-15
    assert least >= -2e-15
    assert answer.state.gap[:, 0].min() >= 0.0
    size = np.linalg.norm(answer.traction[:, 1:], axis=1)
    assert np.all(size <= -law.friction_coefficient * answer.traction[:, 0] * (1 + 1e-14))


@pytest.mark.parametrize("law", RIGID)
def test_a_rigid_joint_is_the_limit_of_stiff_ones(law):
    """Where a point closes: stiffer 100 times, 10 times nearer, tractions and tangents.

    A joint of compliance d overlaps by y, from c y^2 = 2 d g0 |h + g0| where d is small against c:
    the root of d. The traction of a rigid joint has no y in it. (Points that open have the same
    formula in their stored energy, rigid or not.) Tangents only where the point is far enough from
    touching and friction from its limit, which both move.
    """
    state, free, compliance = rigid_steps(law)
    opened = state.gap[:, 0] > 0.0
    state = JointState.at_rest(state.gap[opened], variables=3)
    free, c = free[opened], 1e-10
    compliance = np.full((len(free), 2), c)
    rigid = law.condensed_discrete_gradient(free, compliance, state)
    moved = np.linalg.norm(free - state.gap, axis=1) + state.gap[:, 0]
    scale = (1.0 + law.friction_coefficient) * moved / c
    tractions, tangents = [], []
    for ratio in (1e4, 1e6, 1e8):
        stiff = FrictionNoTension(
            normal_stiffness=ratio / c,
            shear_stiffness=ratio / c / law.stiffness_ratio,
            friction_angle_deg=law.friction_angle_deg,
        )
        found = stiff.condensed_discrete_gradient(free, compliance, state)
        difference = np.abs(found.traction - rigid.traction).max(axis=1)
        tractions.append(float((difference / scale).max()))
        far = -free[:, 0] > 0.1 * moved
        far &= at_limit(law, found) == at_limit(law, rigid)
        size = np.abs(rigid.tangent).max(axis=(1, 2))
        difference = np.abs(found.tangent - rigid.tangent).max(axis=(1, 2))
        tangents.append(float((difference[far] / size[far]).max()))
    print(f"\n{law}: tractions {tractions}, tangents {tangents}")
    np.testing.assert_allclose(tractions[1:], np.array(tractions[:-1]) / 10, rtol=0.2)
    assert tractions[-1] < 1e-4
    assert tangents[-1] < 1e-3
    np.testing.assert_allclose(tangents[1:], np.array(tangents[:-1]) / 10, rtol=0.5)


def test_bounces_below_rounding_end():
    """The energy of a bounce that goes on under pressure may come down to 1e-309: no division."""
    law = RigidJoint(friction_angle_deg=30.0)
    state = JointState(
        gap=np.zeros((1, 3)),
        elastic_slip=np.zeros((1, 2)),
        internal=np.array([[1.5e-309, 2.7e-155, 0.0]]),
    )
    answer = law.condensed_discrete_gradient(
        np.array([[-2e-11, 0.0, 0.0]]), np.full((1, 2), 8e-16), state
    )
    assert answer.traction[0, 0] == pytest.approx(-2e-11 / 8e-16, rel=1e-12)
    assert np.isfinite(answer.tangent).all()
    assert answer.status[0] == Status.STICK


def test_point_that_stops():
    """Restitution 0: the end velocity 2 x / dt - v0 of a point that strikes is zero.

    dt v0 = -4 um from a gap of 1 um: x = -2 um. A compliance of 1e-12 m/Pa that would let it go
    5 um further carries 3e-6 / 1e-12 = 3 MPa, and all of its work, 3 MPa times 2 um, is lost.
    """
    law = RigidJoint(friction_angle_deg=30.0, restitution=0)
    state = JointState(
        gap=UM * np.array([[1.0, 0.0, 0.0]]),
        elastic_slip=np.zeros((1, 2)),
        internal=np.zeros((1, 1)),
        approach=UM * np.array([-4.0]),
    )
    answer = law.condensed_discrete_gradient(
        UM * np.array([[-4.0, 0.0, 0.0]]), np.full((1, 2), 1e-12), state
    )
    np.testing.assert_allclose(answer.traction, [[-3e6, 0.0, 0.0]], rtol=1e-12)
    np.testing.assert_allclose(answer.state.gap, [[-1e-6, 0.0, 0.0]], rtol=1e-12)
    np.testing.assert_allclose(law.impact(state, answer), [6.0], rtol=1e-12)
    assert answer.state.internal.tolist() == [[1.0]]
    # Of slower points: not there by the middle of the step, or leaving.
    for way, gap in ((-1.5, 1.0), (4.0, -1.0)):
        slow = replace(
            state,
            gap=UM * np.array([[gap, 0.0, 0.0]]),
            approach=UM * np.array([way]),
        )
        answer = law.condensed_discrete_gradient(
            UM * np.array([[-4.0, 0.0, 0.0]]), np.full((1, 2), 1e-12), slow
        )
        assert not answer.traction.any()
