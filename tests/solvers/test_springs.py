# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Artificial springs across the joints, and the law without their tractions."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints import FrictionNoTension, MatrixSystem, RigidJoint
from dolfinx_joints.laws.law import JointState, variables_of
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.springs import JointSprings

COUNT = 300
K_N, K_S = 1e10, 4e9  # Pa/m
AREAS = np.array([0.5, 2.0])


def chain(law):
    """Two unsupported masses, 4 N/m among them, each on the ground by a point of 0.5 or 2 m^2."""
    gap = np.zeros((6, 6))
    gap[:3, :3] = gap[3:, 3:] = np.eye(3)
    block = 4.0 * np.eye(3)
    stiffness = np.block([[block, -block], [-block, block]])
    return MatrixSystem.from_arrays(
        mass=np.eye(6), stiffness=stiffness, gap=gap, law=law, areas=AREAS
    )


def friction(k_n=K_N, k_s=K_S):
    return FrictionNoTension(normal_stiffness=k_n, shear_stiffness=k_s, friction_angle_deg=30.0)


def test_the_end_of_a_joint_has_no_spring():
    """Both sides are one node there: no gap, and no stiffness of elements to compare with."""
    gap = np.vstack([np.eye(3), np.zeros((3, 3))])
    system = MatrixSystem.from_arrays(
        mass=np.eye(3),
        stiffness=np.diag([4.0, 4.0, 4.0]),
        gap=gap,
        law=RigidJoint(friction_angle_deg=30.0),
        areas=AREAS,
    )
    springs = JointSprings(system)
    np.testing.assert_allclose(springs.stiffness, [[8.0, 8.0], [0.0, 0.0]], rtol=1e-14)


def test_stiffness_by_hand():
    """In series with the joint: the elements' 4 N/m on the area of the point, 8 and 2 Pa/m."""
    springs = JointSprings(chain(friction(2.0, 1.0)))
    expected = [[8 * 2 / 10, 8 * 1 / 9], [2 * 2 / 4, 2 * 1 / 3]]
    np.testing.assert_allclose(springs.stiffness, expected, rtol=1e-14)
    np.testing.assert_allclose(
        springs.largest_compliance, limits.SPRING_COMPLIANCE / springs.stiffness
    )
    found = springs.matrix.getValues(range(6), range(6))
    wide = np.repeat(springs.stiffness, (1, 2), axis=1)
    np.testing.assert_allclose(found, np.diag((AREAS[:, None] * wide).ravel()), rtol=1e-14)


def test_stiffness_of_rigid_and_of_frictionless_joints():
    # Rigid: the elements alone. Without shear stiffness: as if it were the normal one.
    rigid = JointSprings(chain(RigidJoint(friction_angle_deg=30.0)))
    np.testing.assert_allclose(rigid.stiffness, [[8.0, 8.0], [2.0, 2.0]], rtol=1e-14)
    smooth = JointSprings(chain(friction(2.0, 0.0)))
    np.testing.assert_allclose(smooth.stiffness, [[1.6, 1.6], [1.0, 1.0]], rtol=1e-14)


@pytest.fixture
def springs():
    """Springs of random stiffness at many points, without a body."""
    made = JointSprings.__new__(JointSprings)
    made.stiffness = 10.0 ** np.random.default_rng(1).uniform(8, 12, (COUNT, 2))
    return made


def random_points(springs):
    """Free gaps, own compliances with shares c s of 0.01 to 0.9, and gaps before."""
    rng = np.random.default_rng(2)
    own = rng.uniform(0.01, limits.SPRING_COMPLIANCE, (COUNT, 2)) / springs.stiffness
    before = 1e-6 * rng.normal(size=(COUNT, 3))
    return 1e-5 * rng.normal(size=(COUNT, 3)), own, before


def without(springs, trial_gap, own, before):
    """Return the trial gap and compliance of the law."""
    law_trial_gap = springs.trial_gap_without_springs(trial_gap, own, before)
    return law_trial_gap, springs.compliance_without_springs(own)


def traction_without_springs(springs, response, own, before):
    """Return the traction and tangent of a response without the springs."""
    traction, tangent, gap = response.traction, response.tangent, response.state.gap
    return springs.traction_without_springs(traction, tangent, gap, own, before)


@pytest.mark.parametrize("law", [friction(), RigidJoint(friction_angle_deg=30.0)])
def test_the_law_is_met_without_the_springs(springs, law):
    """Its t at the gap, gap = h - c t', and t' = t - s (gap - g0): by their definitions."""
    free, own, before = random_points(springs)
    before[:, 0] = np.abs(before[:, 0])  # no overlap, which a rigid joint cannot have
    state = JointState.at_rest(before, variables=len(variables_of(law)))
    response = law.condensed_backward_euler(*without(springs, free, own, before), state)
    traction, _ = traction_without_springs(springs, response, own, before)
    gap, wide = response.state.gap, np.repeat(own, (1, 2), axis=1)
    s = np.repeat(springs.stiffness, (1, 2), axis=1)
    np.testing.assert_allclose(gap, free - wide * traction, rtol=0, atol=1e-18)
    np.testing.assert_allclose(
        traction,
        response.traction - s * (gap - before),
        rtol=0,
        atol=1e-12 * np.abs(traction).max(),
    )
    if isinstance(law, FrictionNoTension):
        again = law.backward_euler(gap, state)
        size = np.abs(response.traction).max()
        np.testing.assert_allclose(again.traction, response.traction, rtol=0, atol=1e-9 * size)
    assert set(response.status.tolist()) == {0, 1, 2}


def test_tangent_by_differences(springs):
    """dt'/dh by central differences over steps of 1e-4 of the gaps, where no kink is passed."""
    free, own, before = random_points(springs)
    law, state = friction(), JointState.at_rest(before)

    def evaluate(h):
        response = law.condensed_backward_euler(*without(springs, h, own, before), state)
        return response, *traction_without_springs(springs, response, own, before)

    response, _, tangent = evaluate(free)
    size = np.abs(tangent).max(axis=(1, 2))
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-9
        (up, above, _), (down, below, _) = evaluate(free + step), evaluate(free - step)
        same = (up.status == response.status) & (down.status == response.status)
        slope = (above - below) / 2e-9
        error = np.abs(slope - tangent[:, :, k]).max(axis=1) / size
        assert same.mean() > 0.95
        assert error[same].max() < 1e-4
