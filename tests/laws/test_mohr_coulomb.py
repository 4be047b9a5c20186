# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint with a brittle bond and dilatancy: paths by hand, energy, refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.law import JointState, Status
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint

# k_n 1e12, k_s 2e12 Pa/m, mu 0.5, c 0.3 MPa, f_t 0.2 MPa: 1 um of opening carries 1 MPa.
K_N, K_S, MU, COHESION, TENSION = 1e12, 2e12, 0.5, 0.3e6, 0.2e6
ANGLE = math.degrees(math.atan(MU))
UM, MPA = 1e-6, 1e6
OPEN, STICK, SLIP = Status.OPEN, Status.STICK, Status.SLIP


def law(**changes):
    parameters = {
        "normal_stiffness": K_N,
        "shear_stiffness": K_S,
        "friction_angle_deg": ANGLE,
        "cohesion": COHESION,
        "tensile_strength": TENSION,
    }
    return MohrCoulombJoint(**{**parameters, **changes})


def follow(joint, path):
    """Responses of one point along a path of gaps, from rest at zero."""
    state = JointState.at_rest(np.zeros((1, 3)), variables=2)
    answers = []
    for gap in np.atleast_2d(path):
        answers.append(joint.backward_euler(gap[None], state))
        state = answers[-1].state
    return answers


def tractions(joint, path):
    return np.array([answer.traction[0] for answer in follow(joint, path)])


def test_an_intact_bond_is_elastic_in_tension_and_shear():
    # |t_s| <= 0.3 MPa - 0.5 t_n: 0.19 MPa of tension and 0.2 MPa of shear hold.
    path = UM * np.array([[0.19, 0.1, 0.0], [-1.0, 0.0, 0.39], [0.0, 0.0, 0.0]])
    answers = follow(law(), path)
    expected = MPA * np.array([[0.19, 0.2, 0], [-1, 0, 0.78], [0, 0, 0]])
    np.testing.assert_allclose([a.traction[0] for a in answers], expected, rtol=1e-12, atol=1e-6)
    assert [a.status[0] for a in answers] == [STICK] * 3
    assert all(a.state.internal[0, 0] == 0 for a in answers)
    assert max(abs(a.dissipation[0]) for a in answers) < 1e-15


def test_tension_breaks_the_bond_for_good():
    # 0.21 um would be 0.21 MPa, above f_t: it opens; back at 0.1 um it carries nothing, and closed
    # under 1 MPa only friction is left: 0.5 MPa.
    path = UM * np.array([[0.21, 0, 0], [0.1, 0, 0], [-1.0, 0, 0], [-1.0, 1.0, 0]])
    answers = follow(law(), path)
    expected = MPA * np.array([[0, 0, 0], [0, 0, 0], [-1, 0, 0], [-1, 0.5, 0]])
    np.testing.assert_allclose([a.traction[0] for a in answers], expected, rtol=1e-12, atol=1e-6)
    assert [a.status[0] for a in answers] == [OPEN, OPEN, STICK, SLIP]
    assert [a.state.internal[0, 0] for a in answers] == [1.0] * 4


def test_without_shear_stiffness_nothing_rides_up():
    # No shear, so no slip of friction that could dilate: a point 0.1 um open carries nothing,
    # however far it has gone sideways.
    joint = law(shear_stiffness=0.0, cohesion=0.0, tensile_strength=0.0, dilatancy_angle_deg=20.0)
    answers = follow(joint, UM * np.array([[-1.0, 0.5, 0.0], [0.1, 2.0, 0.0]]))
    np.testing.assert_allclose(answers[0].traction, [[-MPA, 0, 0]], rtol=1e-12)
    np.testing.assert_array_equal(answers[1].traction, np.zeros((1, 3)))
    assert [a.status[0] for a in answers] == [Status.FRICTIONLESS, OPEN]
    assert answers[1].state.internal[0, 1] == 0.0


def test_shear_breaks_the_bond_for_good():
    # Under 1 MPa it holds 0.8 MPa (0.4 um); 0.41 um breaks it: 0.5 MPa, then unloads elastically.
    path = UM * np.array([[-1, 0.4, 0], [-1, 0.41, 0], [-1, 0.36, 0], [-1, 0.8, 0]])
    t = tractions(law(), path)
    np.testing.assert_allclose(t[:, 1], MPA * np.array([0.8, 0.5, 0.4, 0.5]), rtol=1e-12)


def test_a_broken_bond_sets_its_energy_free():
    # Broken at 0.21 um from the intact state at 0.2 um, f_t^2 / (2 k_n) = 0.02 J/m^2 stored there;
    # the trapezoidal work of the last step adds 0.2 MPa / 2 x 0.01 um = 0.001 J/m^2.
    answers = follow(law(), UM * np.array([[0.2, 0, 0], [0.21, 0, 0]]))
    assert law().stored_energy(answers[0].state)[0] == pytest.approx(0.02, rel=1e-12)
    assert law().stored_energy(answers[1].state)[0] == 0.0
    assert answers[1].dissipation[0] == pytest.approx(0.021, rel=1e-12)


def test_without_extensions_it_is_plain_friction():
    rng = np.random.default_rng(4)
    count = 1000
    plain = FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=ANGLE)
    joint = law(cohesion=0.0, tensile_strength=0.0)
    gap = np.zeros((count, 3))
    gap[::2, 0] = UM * np.abs(rng.normal(size=count // 2))  # half of the points start open
    one = JointState.at_rest(gap)
    two = replace(one, internal=joint.initial_variables(gap))
    for _ in range(50):
        gap = gap + UM * rng.normal(size=(count, 3)) * [0.5, 0.3, 0.3]
        a, b = plain.backward_euler(gap, one), joint.backward_euler(gap, two)
        np.testing.assert_allclose(b.traction, a.traction, rtol=0, atol=1e-9 * MPA)
        np.testing.assert_allclose(b.tangent, a.tangent, rtol=0, atol=1e-9 * K_S)
        np.testing.assert_allclose(b.dissipation, a.dissipation, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(b.status, a.status)
        one, two = a.state, b.state


def dilatant(angle_deg=10.0):
    return law(cohesion=0.0, tensile_strength=0.0, dilatancy_angle_deg=angle_deg)


def test_dilatancy_raises_the_pressure_under_a_held_normal_gap():
    # Gap held at -1 um, 1 um of slip: lambda = (k_s s - mu p) / (k_s + mu k_n tan psi).
    tan_psi = math.tan(math.radians(10.0))
    length = (2.0 - 0.5) / (2.0 + 0.5 * tan_psi) * UM
    answer = follow(dilatant(), UM * np.array([[-1, 1, 0]]))[0]
    t_n = K_N * (-UM - tan_psi * length)
    np.testing.assert_allclose(answer.traction[0], [t_n, -MU * t_n, 0], rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(answer.state.internal[0, 1], tan_psi * length, rtol=1e-12)


def test_dilatancy_opens_a_joint_under_a_held_pressure():
    # Where the normal gap follows so that t_n stays -1 MPa, it grows by tan(psi) per slip, also
    # when the slip reverses; the elastic slip, 0.25 um, comes off at each end.
    joint, tan_psi = dilatant(), math.tan(math.radians(10.0))
    dilation = 0.0
    state = JointState.at_rest(np.array([[-UM, 0, 0]]), variables=2)
    for slip, plastic in ((3.0, 2.75), (-1.0, 3.5)):
        dilation += tan_psi * plastic * UM
        answer = joint.backward_euler(np.array([[-UM + dilation, slip * UM, 0]]), state)
        np.testing.assert_allclose(answer.traction[0, 0], -MPA, rtol=1e-11)
        np.testing.assert_allclose(answer.state.internal[0, 1], dilation, rtol=1e-11)
        state = answer.state


def test_a_point_that_rides_up_stays_closed():
    # From -1 um, 10 um of slip: 9.75 um of it plastic lift the point by 1.72 um; held at 1 MPa it
    # ends there, in one step as in a thousand.
    joint, tan_psi = dilatant(), math.tan(math.radians(10.0))
    lift = tan_psi * 9.75 * UM
    for steps in (1, 10, 1000):
        state = JointState.at_rest(np.array([[-UM, 0, 0]]), variables=2)
        state = replace(state, internal=np.array([[1.0, 0.0]]))
        for share in np.arange(1, steps + 1) / steps:
            slid = max(share * 10.0 - 0.25, 0.0) * UM
            gap = np.array([[-UM + tan_psi * slid, share * 10.0 * UM, 0]])
            answer = joint.backward_euler(gap, state)
            state = answer.state
        np.testing.assert_allclose(answer.traction[0], [-MPA, 0.5 * MPA, 0], rtol=1e-9)
        np.testing.assert_allclose(state.internal[0, 1], lift, rtol=1e-9)


def test_a_point_that_leaves_has_ridden_up_until_then():
    # From -1 um to 3 um with 4 um of slip at psi = alpha, tan 0.5: it may rise by 2 um. It leaves
    # where -1 + 4 s = 2 s, at s = 1/2, and has ridden up by 1 um.
    joint = dilatant(ANGLE)
    state = JointState(
        gap=np.array([[-UM, 0, 0]]), elastic_slip=np.zeros((1, 2)), internal=np.array([[1.0, 0.0]])
    )
    answer = joint.backward_euler(UM * np.array([[3.0, 4.0, 0]]), state)
    assert answer.status[0] == OPEN
    np.testing.assert_array_equal(answer.traction, 0.0)
    np.testing.assert_allclose(answer.state.internal[0, 1], UM, rtol=1e-12)


def test_there_is_no_bond_across_an_initial_gap():
    gap = UM * np.array([[0.1, 0, 0], [0.0, 0, 0], [-0.1, 0, 0]])
    np.testing.assert_array_equal(law().initial_variables(gap)[:, 0], [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(dilatant().initial_variables(gap)[:, 0], 1.0)


def test_dilation_stays_on_opening():
    # 0.1 um of dilation: at a gap of 0.05 um it is still closed, under 0.05 MPa.
    state = JointState(
        gap=np.array([[UM, 0, 0]]),
        elastic_slip=np.zeros((1, 2)),
        internal=np.array([[1.0, 0.1 * UM]]),
    )
    answer = dilatant().backward_euler(np.array([[0.05 * UM, 0, 0]]), state)
    np.testing.assert_allclose(answer.traction[0], [-0.05 * MPA, 0, 0], rtol=1e-12)
    assert answer.status[0] == STICK


def wander(joint, count=2000, steps=30):
    """Random slip under 1 um of overlap: the last state and the answer that led to it."""
    rng = np.random.default_rng(5)
    state = JointState.at_rest(np.tile([-UM, 0, 0], (count, 1)), variables=2)
    for _ in range(steps):
        before, moved = state, UM * rng.normal(size=(count, 3)) * [0, 0.3, 0.3]
        answer = joint.backward_euler(before.gap + moved, before)
        state = answer.state
    return before, answer


@pytest.mark.parametrize("angle", [0.0, 10.0, ANGLE])
def test_plastic_slip_never_gains_energy(angle):
    # t . plastic = (|t_s| - tan(psi) |t_n|) lambda, zero at psi = alpha.
    before, answer = wander(dilatant(angle))
    after = answer.state
    plastic = after.gap - before.gap
    plastic[:, 0] = after.internal[:, 1] - before.internal[:, 1]
    plastic[:, 1:] -= after.elastic_slip - before.elastic_slip
    lost = np.einsum("ij,ij->i", answer.traction, plastic)
    assert lost.min() > -1e-12
    assert (lost.max() > 0.1) == (angle < ANGLE)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"tensile_strength": 0.7e6}, "at most cohesion / tan(friction angle), 600000 Pa."),
        ({"dilatancy_angle_deg": 30.0}, "at most the friction angle, 26.5651 degrees."),
    ],
)
def test_parameters_that_contradict_each_other(changes, text):
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        law(**changes)
    assert text in str(refused.value)
