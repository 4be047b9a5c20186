# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction without tension and rigid: points by hand, limits, refusals.

Paths with exact solutions are in `verification/test_law_paths.py`, tangents in `test_tangents`,
work and energy in `test_losses`.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.law import BACKWARD_EULER, JointState, Status
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.rigid import RigidJoint

# k_n 1e12, k_s 2e12 Pa/m, mu 0.5: a gap of -1 um carries -1 MPa, and slides beyond 0.5 MPa,
# that is beyond an elastic slip of 0.25 um.
K_N, K_S, MU = 1e12, 2e12, 0.5
LAW = FrictionNoTension(
    normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=math.degrees(math.atan(MU))
)
BONDED = MohrCoulombJoint(
    normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0, cohesion=1e6
)
UM = 1e-6
MPA = 1e6


def rest(n=1):
    return JointState.at_rest(np.zeros((n, 3)))


def follow(law, path, state=None):
    """Responses along a path of gaps of one point."""
    state = rest() if state is None else state
    answers = []
    for gap in np.atleast_2d(path):
        answers.append(law.backward_euler(gap[None], state))
        state = answers[-1].state
    return answers


def tractions(law, path, state=None):
    return np.array([answer.traction[0] for answer in follow(law, path, state)])


def statuses(law, path):
    return [Status(int(answer.status[0])) for answer in follow(law, path)]


def test_normal_is_linear_in_compression_and_zero_in_tension():
    path = UM * np.array([[-1.0, 0, 0], [-2.0, 0, 0], [3.0, 0, 0], [-0.5, 0, 0]])
    t = tractions(LAW, path)
    np.testing.assert_allclose(t[:, 0], MPA * np.array([-1, -2, 0, -0.5]), rtol=1e-14, atol=0)
    assert statuses(LAW, path) == [Status.STICK, Status.STICK, Status.OPEN, Status.STICK]


def test_gap_of_zero_is_closed_and_stiff():
    answer = LAW.backward_euler(np.zeros((1, 3)), rest())
    assert answer.status[0] == Status.STICK
    np.testing.assert_array_equal(answer.traction, 0.0)
    np.testing.assert_allclose(answer.tangent[0], np.diag([K_N, K_S, K_S]), rtol=1e-15)


def test_load_slide_unload_reverse():
    # Under -1 MPa: elastic to 0.2 um (0.4 MPa); sliding at 1 um (0.5 MPa, elastic slip 0.25 um);
    # back to 0.8 um: elastic slip 0.05 um, 0.1 MPa; back to 0: -0.75 um of trial, slides at -0.5.
    path = UM * np.array([[-1, 0.2, 0], [-1, 1.0, 0], [-1, 0.8, 0], [-1, 0.0, 0]])
    t = tractions(LAW, path)
    np.testing.assert_allclose(t[:, 1], MPA * np.array([0.4, 0.5, 0.1, -0.5]), rtol=1e-12)
    np.testing.assert_array_equal(t[:, 2], 0.0)
    slip, stick = Status.SLIP, Status.STICK
    assert statuses(LAW, path) == [stick, slip, stick, slip]
    elastic = [answer.state.elastic_slip[0, 0] / UM for answer in follow(LAW, path)]
    np.testing.assert_allclose(elastic, [0.2, 0.25, 0.05, -0.25], rtol=1e-12)


def random_states(law, n, seed):
    """Gaps and states: open, sticking and sliding, at kinks with probability zero."""
    rng = np.random.default_rng(seed)
    gap = UM * rng.normal(size=(n, 3)) * [1.0, 0.3, 0.3] - [0.5 * UM, 0, 0]
    state = JointState(
        gap=UM * rng.normal(size=(n, 3)) * [1.0, 0.3, 0.3],
        elastic_slip=UM * 0.1 * rng.normal(size=(n, 2)),
    )
    return gap, state


@pytest.mark.parametrize(("angle", "k_s"), [(0.0, K_S), (30.0, K_S), (89.9, K_S), (30.0, 0.0)])
def test_tractions_are_admissible(angle, k_s):
    law = FrictionNoTension(normal_stiffness=K_N, shear_stiffness=k_s, friction_angle_deg=angle)
    gap, state = random_states(law, 10_000, seed=2)
    answer = law.backward_euler(gap, state)
    t_n, size = answer.traction[:, 0], np.linalg.norm(answer.traction[:, 1:], axis=1)
    assert np.all(t_n <= 0)
    assert np.all(size <= law.friction_coefficient * np.abs(t_n) * (1 + 1e-12))
    opened = gap[:, 0] > 0
    np.testing.assert_array_equal(answer.traction[opened], 0.0)
    np.testing.assert_array_equal(answer.status == Status.OPEN, opened)
    np.testing.assert_array_equal(answer.state.gap, gap)
    # k_s e is the shear traction, in every state.
    np.testing.assert_allclose(
        k_s * answer.state.elastic_slip, answer.traction[:, 1:], rtol=1e-12, atol=1e-6
    )
    assert np.all(np.isfinite(answer.tangent))
    if angle == 0.0 or k_s == 0.0:
        assert set(answer.status.tolist()) == {Status.OPEN, Status.FRICTIONLESS}
        assert not answer.state.elastic_slip.any()


def test_friction_never_gains_energy():
    # A step dissipates (t0 + t1)/2 . (plastic slip); with backward Euler that is not negative
    # for steps that start and end closed.
    gap, state = random_states(LAW, 10_000, seed=3)
    start = LAW.backward_euler(
        state.gap, JointState(gap=state.gap, elastic_slip=state.elastic_slip)
    )
    closed = (gap[:, 0] <= 0) & (state.gap[:, 0] <= 0)
    # From an admissible start, at constant normal gap.
    gap[:, 0] = state.gap[:, 0]
    answer = LAW.backward_euler(gap, start.state)
    assert np.min(answer.dissipation[closed]) >= -1e-12 * np.max(answer.dissipation)


def test_trial_leaves_its_state_alone():
    gap, state = random_states(LAW, 1000, seed=4)
    before = (state.gap.copy(), state.elastic_slip.copy(), gap.copy())
    one = LAW.backward_euler(gap, state)
    one.state.gap[:] = np.nan
    one.state.elastic_slip[:] = np.nan
    two = LAW.backward_euler(gap, state)
    for kept, now in zip(before, (state.gap, state.elastic_slip, gap), strict=True):
        np.testing.assert_array_equal(kept, now)
    np.testing.assert_array_equal(one.traction, two.traction)
    at_rest = JointState.at_rest(gap)
    at_rest.gap[:] = 0.0
    np.testing.assert_array_equal(gap, before[2])


def test_stored_energy_by_hand():
    # k_n g^2 / 2 = 0.5 J/m^2 at -1 um; k_s |e|^2 / 2 with e = (0.06, 0.08) um is 0.01 J/m^2.
    state = JointState(
        gap=UM * np.array([[-1, 5, 5], [2, 5, 5.0]]),
        elastic_slip=UM * np.array([[0.06, 0.08], [0.0, 0.0]]),
    )
    np.testing.assert_allclose(LAW.stored_energy(state), [0.51, 0.0], rtol=1e-12)


def test_law_cannot_be_changed_and_takes_keywords_only():
    with pytest.raises(AttributeError):
        LAW.normal_stiffness = 1.0
    with pytest.raises(TypeError):
        FrictionNoTension(1e11, 1e11, 30.0)
    assert pytest.approx(math.tan(math.atan(MU))) == LAW.friction_coefficient
    assert LAW.closed_stiffness() == (K_N, K_S)


@pytest.mark.parametrize("law", [LAW, RigidJoint(friction_angle_deg=30.0), BONDED])
def test_friction_is_given_as_an_angle_or_as_a_coefficient(law):
    angle = law.friction_angle_deg
    assert law.friction_coefficient == pytest.approx(math.tan(math.radians(angle)), rel=1e-15)
    given = {f.name: getattr(law, f.name) for f in fields(law)} | {"friction_angle_deg": None}
    same = type(law)(**given)
    assert same.friction_coefficient == law.friction_coefficient
    assert same.friction_angle_deg == pytest.approx(angle, rel=1e-15)
    assert replace(same) == same
    with pytest.raises(ValueError, match="are both None; give one of them"):
        type(law)(**given | {"friction_coefficient": None})
    with pytest.raises(ValueError, match="is 40 degrees and friction_coefficient is 0.5"):
        replace(law, friction_angle_deg=40.0)


def test_no_points():
    # A rank may hold no joint point at all.
    answer = LAW.backward_euler(np.zeros((0, 3)), rest(0))
    assert answer.traction.shape == (0, 3)
    assert answer.tangent.shape == (0, 3, 3)
    assert LAW.stored_energy(answer.state).shape == (0,)


# A joint without compliance, on the compliance of the structure.

OWN = np.array([[2e-11, 1e-11]])  # c_n, c_s [m/Pa]


def rigid(angle=30.0):
    return RigidJoint(friction_angle_deg=angle)


def solve_rigid(free, before=(0.0, 0.0, 0.0), angle=30.0):
    state = JointState.at_rest(np.array([before]), variables=3)
    return rigid(angle).condensed_backward_euler(np.array([free]), OWN, state)


def test_rigid_joint_by_hand():
    """Closed: t_n = h_n/c_n = -2e-5/2e-11 = -1 MPa; t_s = h_s/c_s = 3e-6/1e-11 = 0.3 MPa."""
    answer = solve_rigid([-2e-5, 3e-6, 0.0])
    np.testing.assert_allclose(answer.traction, [[-1e6, 3e5, 0.0]], rtol=1e-14)
    np.testing.assert_allclose(answer.state.gap, np.zeros((1, 3)), atol=1e-20)
    np.testing.assert_array_equal(answer.state.elastic_slip, np.zeros((1, 2)))
    np.testing.assert_array_equal(answer.state.internal, np.zeros((1, 3)))
    np.testing.assert_allclose(answer.tangent[0], np.diag([5e10, 1e11, 1e11]), rtol=1e-14)
    assert answer.status.tolist() == [Status.STICK]
    # 8 um ask for 0.8 MPa; mu p = 0.57735 MPa are there, and the rest is slip: 8 - 5.7735 um.
    answer = solve_rigid([-2e-5, 8e-6, 0.0])
    np.testing.assert_allclose(answer.traction, [[-1e6, 577350.269, 0.0]], rtol=1e-9)
    np.testing.assert_allclose(answer.state.gap, [[0.0, 2.22649731e-6, 0.0]], rtol=1e-8)
    assert answer.dissipation[0] == pytest.approx(577350.269 * 2.22649731e-6, rel=1e-8)
    assert answer.status.tolist() == [Status.SLIP]
    # Pulled: it opens and carries nothing.
    answer = solve_rigid([1e-6, 3e-6, 0.0])
    np.testing.assert_array_equal(answer.traction, np.zeros((1, 3)))
    np.testing.assert_array_equal(answer.state.gap, [[1e-6, 3e-6, 0.0]])
    assert answer.status.tolist() == [Status.OPEN]


def test_a_rigid_point_held_on_both_sides_carries_nothing():
    # Neither the joint nor the structure gives way: no traction follows from its gap.
    state = JointState.at_rest(np.zeros((1, 3)), variables=3)
    answer = rigid().condensed_backward_euler(
        np.array([[-1e-9, 2e-9, 1e-9]]), np.zeros((1, 2)), state
    )
    np.testing.assert_array_equal(answer.traction, np.zeros((1, 3)))
    np.testing.assert_array_equal(answer.tangent, np.zeros((1, 3, 3)))
    np.testing.assert_array_equal(answer.dissipation, [0.0])


def test_rigid_joint_is_the_limit_of_stiff_ones():
    """At k_n = k_s = 1e30 the joint's compliance is below rounding of the structure's."""
    rng = np.random.default_rng(6)
    count = 2000
    free = 1e-5 * rng.normal(size=(count, 3))
    before = np.column_stack([1e-5 * rng.uniform(-1, 1, count).clip(0.0), np.zeros((count, 2))])
    compliance = 10.0 ** rng.uniform(-14, -9, (count, 2))
    stiff = FrictionNoTension(normal_stiffness=1e30, shear_stiffness=1e30, friction_angle_deg=30.0)
    one = rigid().condensed_backward_euler(
        free, compliance, JointState.at_rest(before, variables=3)
    )
    two = stiff.condensed_backward_euler(free, compliance, JointState.at_rest(before))
    assert set(one.status.tolist()) == {0, 1, 2}
    np.testing.assert_array_equal(one.status, two.status)
    for name in ("traction", "tangent"):
        a, b = getattr(one, name), getattr(two, name)
        size = np.abs(b).reshape(count, -1).max(axis=1).reshape(-1, *[1] * (b.ndim - 1))
        assert np.all(np.abs(a - b) <= 1e-12 * size)
    np.testing.assert_allclose(one.state.gap, two.state.gap, rtol=0, atol=1e-19)


def test_rigid_points_have_no_answer_of_their_own():
    # Where a motion starts they carry nothing; what an overlap carries does not follow from it.
    law, state = LawPoints(rigid(), np.arange(2)), JointState.at_rest(np.zeros((2, 3)), variables=3)
    gap = np.array([[0.0, 1e-3, 0.0], [2e-3, 0.0, 0.0]])
    answer = law.evaluate(BACKWARD_EULER, gap, None, state)
    np.testing.assert_array_equal(answer.traction, 0.0)
    assert answer.status.tolist() == [Status.STICK, Status.OPEN]
    with pytest.raises(
        JointsError, match=r"rigid joint has an initial overlap of 0\.001 m\. Start"
    ):
        law.evaluate(BACKWARD_EULER, gap - [1e-3, 0.0, 0.0], None, state)
