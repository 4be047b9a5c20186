# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slip that stops or turns within a step: energy, limit, tangent, continuity of random points."""

from dataclasses import replace

import numpy as np
import pytest
from tangent_errors import central_differences

from dolfinx_joints import FrictionNoTension, RigidJoint
from dolfinx_joints.laws.law import JointState

COUNT, MU = 20_000, 0.5
C = 1e-10  # compliance of the structure [m/Pa]
LAWS = {
    "rigid": RigidJoint(friction_coefficient=MU),
    "stiff": FrictionNoTension(
        normal_stiffness=1e13, shear_stiffness=1e13, friction_coefficient=MU
    ),
    "soft": FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_coefficient=MU),
}


def random_turns(law, seed):
    """States of closed points that slid some mm and are braked, with free gaps, compliances."""
    rng = np.random.default_rng(seed)
    last = 1e-3 * rng.normal(size=(COUNT, 2))
    across = 0.3e-3 * rng.normal(size=(COUNT, 2)) * rng.integers(0, 2, (COUNT, 1))
    change = -last * rng.uniform(0.0, 2.5, (COUNT, 1)) + across
    reserve = rng.uniform(0, 2e3, COUNT) * rng.integers(0, 2, COUNT)
    before = np.zeros((COUNT, 3))
    before[:, 0] = 0.0 if law is LAWS["rigid"] else -1e7 / law.normal_stiffness
    state = JointState(
        gap=before,
        elastic_slip=np.zeros((COUNT, 2)),
        internal=np.zeros((COUNT, 3)),
        slips=np.column_stack([last, last - change, reserve]),
    )
    free = before + np.column_stack(
        [
            -C * 1e7 * rng.uniform(0.5, 2, COUNT),
            last + change + 0.3 * across + 1e-4 * rng.normal(size=(COUNT, 2)),
        ]
    )
    return state, free, np.full((COUNT, 2), C)


@pytest.mark.parametrize("name", LAWS)
def test_energy(name):
    """t . (change of the gap) = change of the energy + D, and D gives back R at most."""
    law = LAWS[name]
    state, free, compliance = random_turns(law, 1)
    answer = law.condensed_discrete_gradient(free, compliance, state)
    moved = answer.state.gap - state.gap
    work = np.sum(answer.traction * moved, axis=1)
    stored = law.stored_energy(answer.state) - law.stored_energy(state)
    scale = np.abs(answer.traction * free).sum(axis=1) + law.stored_energy(state)
    assert np.abs(work - stored - answer.dissipation).max() <= 1e-13 * scale.max()
    assert np.all(answer.dissipation >= -state.slips[:, 4] - 1e-13 * scale)
    given_back = answer.dissipation < -1e-3 * scale
    assert 0.001 < given_back.mean() < 0.2
    size = np.linalg.norm(answer.traction[:, 1:], axis=1)
    assert np.all(size <= -MU * answer.traction[:, 0] * (1 + 1e-14))
    # What it keeps: this slip, the last one, half of what it lost.
    slips = answer.state.slips
    np.testing.assert_array_equal(slips[:, 2:4], state.slips[:, :2])
    half = 0.5 * np.maximum(answer.dissipation, 0.0)
    assert np.all(slips[:, 4] <= half + 1e-13 * scale)
    if name == "rigid":  # without an elastic slip that the falling limit lets go
        np.testing.assert_allclose(slips[:, 4], half, atol=1e-13 * scale.max())
        np.testing.assert_allclose(slips[:, :2], moved[:, 1:], atol=1e-15)


@pytest.mark.parametrize("name", LAWS)
def test_tangent(name):
    """Central differences of steps of 1e-9 m, which few points cross a kink in."""
    law = LAWS[name]
    state, free, compliance = random_turns(law, 2)
    answer = law.condensed_discrete_gradient(free, compliance, state)
    size = np.abs(answer.tangent).max(axis=(1, 2))
    slopes = central_differences(
        lambda h: law.condensed_discrete_gradient(h, compliance, state).traction, free, 1e-9
    )
    off = np.abs(slopes - answer.tangent).max(axis=(1, 2)) / size
    assert np.mean(off < 1e-4) > 0.995


@pytest.mark.parametrize("name", LAWS)
def test_slips_of_rounding_size_change_nothing(name):
    """Whether points that stick have slid by 1e-15 m or not must not decide what follows."""
    law = LAWS[name]
    state, free, compliance = random_turns(law, 3)
    without, tiny = (
        law.condensed_discrete_gradient(
            free, compliance, replace(state, slips=state.slips * factor)
        )
        for factor in (0.0, 1e-12)
    )
    off = np.abs(tiny.state.gap - without.state.gap).max()
    assert off < 2e-15  # of slips of 1e-3 * 1e-12


def test_it_is_a_function_of_the_slip():
    """The same gap on another compliance has the same traction: c is no part of the law."""
    law = LAWS["soft"]
    state, free, compliance = random_turns(law, 4)
    answer = law.condensed_discrete_gradient(free, compliance, state)
    other = 3.0 * compliance
    again = law.condensed_discrete_gradient(
        free + (other - compliance)[:, [0, 1, 1]] * answer.traction, other, state
    )
    np.testing.assert_allclose(again.traction, answer.traction, rtol=1e-8, atol=1e-3)


def test_a_turn_has_its_mean_friction():
    """Rigid point, F = 1, compliance 1/2.

    Slips of 9/2 and 5/2 leave a speed of 5/2 - 2/2 = 3/2, braked by 2: it turns after 3/4 of the
    step, in which friction is F for 3/4 and -F for 1/4, 1/2. Pushed on by more it stops at a slip
    of 3/4. Slips of 5 and 1 leave no speed, and what goes on sliding slides against F.
    """
    law = RigidJoint(friction_coefficient=1.0)
    slips = np.array([[2.5, 0, 4.5, 0, 0.0], [2.5, 0, 4.5, 0, 0.0], [1.0, 0, 5.0, 0, 0.0]])
    state = JointState(
        gap=np.zeros((3, 3)),
        elastic_slip=np.zeros((3, 2)),
        internal=np.zeros((3, 3)),
        slips=slips,
    )
    # p = h - t / 2: 0.6 = 0.85 - 0.25 turns, 0.75 = 1.15 - 0.4 stops; the last one slides.
    free = np.array([[-0.5, 0.85, 0.0], [-0.5, 1.15, 0.0], [-0.5, 0.85, 0.0]])
    answer = law.condensed_discrete_gradient(free, np.full((3, 2), 0.5), state)
    np.testing.assert_allclose(answer.traction[:, 0], -1.0, rtol=1e-14)
    np.testing.assert_allclose(answer.traction[:, 1], [0.5, 0.8, 1.0], rtol=1e-14)
    np.testing.assert_allclose(answer.state.gap[:, 1], [0.6, 0.75, 0.35], rtol=1e-14)
