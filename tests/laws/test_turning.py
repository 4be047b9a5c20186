# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slip that stops or turns within a step: energy, limit and tangent of random points."""

import math

import numpy as np
import pytest

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
    """States of closed points that slide, with free gaps, compliances: all slips of some mm."""
    rng = np.random.default_rng(seed)
    way = 1e-3 * rng.normal(size=(COUNT, 2))
    across = 0.3 * rng.normal(size=(COUNT, 2)) * rng.integers(0, 2, (COUNT, 1))
    change = -way * rng.uniform(0.5, 8.0, (COUNT, 1)) + 1e-3 * across
    put_by = rng.uniform(0, 2e3, COUNT) * rng.integers(0, 2, COUNT)
    before = np.zeros((COUNT, 3))
    before[:, 0] = 0.0 if law is LAWS["rigid"] else -1e7 / law.normal_stiffness
    state = JointState(
        gap=before,
        elastic_slip=np.zeros((COUNT, 2)),
        internal=np.zeros((COUNT, 3)),
        turning=put_by,
        course=np.column_stack([way, change]),
    )
    free = before + np.column_stack(
        [-C * 1e7 * rng.uniform(0.5, 2, COUNT), way + 0.5 * change + 1e-4 * across]
    )
    return state, free, np.full((COUNT, 2), C)


@pytest.mark.parametrize("name", LAWS)
def test_energy(name):
    """t . (change of the gap) = change of the energy + D, and D is never negative."""
    law = LAWS[name]
    state, free, compliance = random_turns(law, 1)
    answer = law.condensed_discrete_gradient(free, compliance, state)
    moved = answer.state.gap - state.gap
    work = np.sum(answer.traction * moved, axis=1)
    stored = law.stored_energy(answer.state) - law.stored_energy(state)
    scale = np.abs(answer.traction * free).sum(axis=1) + law.stored_energy(state)
    assert np.abs(work - stored - answer.dissipation).max() <= 1e-13 * scale.max()
    assert (answer.dissipation / scale).min() >= -1e-13
    assert answer.state.turning.min() >= 0.0
    assert answer.state.turning.max() > 0.0
    size = np.linalg.norm(answer.traction[:, 1:], axis=1)
    assert np.all(size <= -MU * answer.traction[:, 0] * (1 + 1e-14))


@pytest.mark.parametrize("name", LAWS)
def test_tangent(name):
    """Central differences of steps of 1e-9 m, which few points cross a kink in."""
    law = LAWS[name]
    state, free, compliance = random_turns(law, 2)
    answer = law.condensed_discrete_gradient(free, compliance, state)
    size = np.abs(answer.tangent).max(axis=(1, 2))
    off = np.zeros(COUNT)
    for k in range(3):
        ends = [free.copy(), free.copy()]
        for end, sign in zip(ends, (-1, 1), strict=True):
            end[:, k] += sign * 1e-9
        low, high = (
            law.condensed_discrete_gradient(end, compliance, state).traction for end in ends
        )
        slope = (high - low) / 2e-9
        off = np.maximum(off, np.abs(slope - answer.tangent[:, :, k]).max(axis=1) / size)
    assert np.mean(off < 1e-4) > 0.995


def test_a_turn_has_its_mean_friction():
    """Rigid point, F = 1, c = 1/2 (1 kg, 1 s): v0 = 3/4 of the deceleration 4 turns after 3/4.

    Its friction is F for 3/4 and -F for 1/4 of the step: 1/2. Pushed on by less it stops.
    """
    law = RigidJoint(friction_coefficient=1.0)
    state = JointState(
        gap=np.zeros((2, 3)),
        elastic_slip=np.zeros((2, 2)),
        internal=np.zeros((2, 3)),
        course=np.array([[3.0, 0, -4.0, 0], [3.0, 0, -4.0, 0]]),
    )
    # h = v0 + p / 2 with the loads p = -3 (it turns), and -2.2: T = 3 - 2.2 = 0.8 stops it.
    free = np.array([[-0.5, 1.5, 0.0], [-0.5, 1.9, 0.0]])
    answer = law.condensed_discrete_gradient(free, np.full((2, 2), 0.5), state)
    np.testing.assert_allclose(answer.traction[:, 0], -1.0, rtol=1e-14)
    np.testing.assert_allclose(answer.traction[:, 1], [0.5, 0.8], rtol=1e-14)
    ends = 2.0 * answer.state.gap[:, 1] - 3.0  # v1
    assert ends[0] == pytest.approx(3.0 - 3.0 - 0.5)
    assert math.isclose(ends[1], 0.0, abs_tol=1e-14)
