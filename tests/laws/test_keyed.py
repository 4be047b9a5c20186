# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictionless, keyed and viscous joints: paths by hand, and in a model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dolfinx_joints.laws.friction import FrictionNoTension, frictionless
from dolfinx_joints.laws.keyed import KeyedJoint
from dolfinx_joints.laws.law import JointState, Status, variables_of
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.viscous import ViscousJoint

# 1 um of gap carries 1 MPa, 1 um of slip 2 MPa; mu 0.5.
K_N, K_S = 1e12, 2e12
UM, MPA = 1e-6, 1e6
FRICTION = FrictionNoTension(
    normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=math.degrees(math.atan(0.5))
)
DILATANT = MohrCoulombJoint(
    normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0, dilatancy_angle_deg=5.0
)


def tractions(law, path, dt=math.inf):
    state = JointState.at_rest(np.zeros((1, 3)), variables=len(variables_of(law)))
    answers, step = [], law.for_step(dt) if isinstance(law, ViscousJoint) else law
    for gap in UM * np.atleast_2d(path):
        answers.append(step.backward_euler(gap[None], state))
        state = answers[-1].state
    return np.array([a.traction[0] for a in answers]) / MPA, answers


def test_frictionless_carries_pressure_only():
    t, _ = tractions(frictionless(normal_stiffness=K_N), [[-1, 5, 5], [1, 0, 0], [-2, 1, 0]])
    np.testing.assert_allclose(t, [[-1, 0, 0], [0, 0, 0], [-2, 0, 0]], rtol=1e-12)


def test_keys_hold_shear_whatever_the_opening():
    law = KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S)
    t, answers = tractions(law, [[-1, 5, 0], [3, 5, 1], [-1, 0, 0]])
    np.testing.assert_allclose(t, [[-1, 10, 0], [0, 10, 2], [-1, 0, 0]], rtol=1e-12, atol=1e-12)
    assert [a.status[0] for a in answers] == [Status.STICK, Status.OPEN, Status.STICK]
    # 1/2 k_s |g_s|^2 = 26 J/m^2 at (3, 5, 1) um, nothing dissipated.
    assert law.stored_energy(answers[1].state)[0] == pytest.approx(26.0)
    assert not any(a.dissipation[0] for a in answers)


def test_local_solution_of_keys():
    # c = 1e-12 m/Pa in both directions: k_n 0.5e12, k_s 2/3 e12 Pa/m.
    law = KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S)
    state = JointState.at_rest(np.zeros((1, 3)))
    answer = law.condensed_backward_euler(
        UM * np.array([[-1.0, 3.0, 0.0]]), np.full((1, 2), 1e-12), state
    )
    np.testing.assert_allclose(answer.traction, MPA * np.array([[-0.5, 2.0, 0.0]]), rtol=1e-12)


@pytest.mark.parametrize("compliance", [0.0, 1e-12])
def test_the_work_of_keys_over_a_step_is_what_they_store(compliance):
    """Traction times slip is the change of the energy: the traction is that of the mean slip."""
    law = KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S)
    state = law.backward_euler(
        UM * np.array([[-1.0, 2.0, 1.0]]), JointState.at_rest(np.zeros((1, 3)))
    )
    trial = UM * np.array([[-3.0, 7.0, -2.0]])
    answer = law.condensed_discrete_gradient(trial, np.full((1, 2), compliance), state.state)
    np.testing.assert_allclose(answer.state.gap, trial - compliance * answer.traction, rtol=1e-12)
    work = np.sum(answer.traction * (answer.state.gap - state.state.gap))
    stored = law.stored_energy(answer.state)[0] - law.stored_energy(state.state)[0]
    assert work == pytest.approx(stored, rel=1e-12)


def test_dashpots_rest_in_statics():
    law = ViscousJoint(law=FRICTION, normal_viscosity=1e9, shear_viscosity=1e9)
    path = [[-1, 0.1, 0], [-2, 0.3, 0.1], [1, 0, 0], [-1, 0, 0]]
    np.testing.assert_array_equal(tractions(law, path)[0], tractions(FRICTION, path)[0])


def test_dashpots_add_their_rate():
    # eta / dt = 1e9 / 1e-3 = 1e12 Pa/m: 1 um in a step adds 1 MPa, 0.2 um of slip 0.2 MPa.
    law = ViscousJoint(law=FRICTION, normal_viscosity=1e9, shear_viscosity=1e9)
    t, answers = tractions(law, [[-1, 0, 0], [-2, 0.2, 0], [-2, 0.2, 0]], dt=1e-3)
    np.testing.assert_allclose(t, [[-2, 0, 0], [-3, 0.6, 0], [-2, 0.4, 0]], rtol=1e-12)
    # Dissipated: 1 MPa x 1 um; 1 MPa x 1 um + 0.2 MPa x 0.2 um; nothing at rest.
    lost = [a.dissipation[0] for a in answers]
    np.testing.assert_allclose(lost, [1.0, 1.04, 0.0], rtol=1e-12, atol=1e-15)


def test_dashpots_on_a_keyed_joint_on_a_compliance():
    # Trial gap -3 um on 1 um/MPa, from -1 um: -3 = g + t with t = g + (g + 1); 0.5 = e + 2 e.
    keyed = KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S)
    law = ViscousJoint(law=keyed, normal_viscosity=1e9).for_step(1e-3)
    state, trial_gap = JointState.at_rest(np.array([[-UM, 0, 0]])), UM * np.array([[-3, 0.5, 0]])
    answer = law.condensed_backward_euler(trial_gap, np.full((1, 2), UM / MPA), state)
    np.testing.assert_allclose(answer.traction[0] / MPA, [-5 / 3, 1 / 3, 0], rtol=1e-12)


def test_dashpots_do_not_pull():
    # Back from -1 to -0.2 um: 0.2 MPa of pressure, 0.8 MPa of dashpot against it: nothing is left.
    law = ViscousJoint(law=FRICTION, normal_viscosity=1e9)
    t, _ = tractions(law, [[-1, 0, 0], [-0.2, 0, 0], [0.5, 0, 0]], dt=1e-3)
    np.testing.assert_allclose(t, [[-2, 0, 0], [0, 0, 0], [0, 0, 0]], rtol=1e-12, atol=1e-12)


def test_dashpots_start_at_touching():
    # From 1 um open to 1 um closed with 0.4 um of slip: half of the slip is in contact, 0.2 um:
    # 0.4 MPa of friction joint, 0.2 MPa of dashpot, 1 + 1 MPa normal.
    law = ViscousJoint(law=FRICTION, normal_viscosity=1e9, shear_viscosity=1e9)
    t, _ = tractions(law, [[1, 0, 0], [-1, 0.4, 0]], dt=1e-3)
    np.testing.assert_allclose(t[1], [-2, 0.6, 0], rtol=1e-12)


def test_dashpot_on_a_bond_leaves_tension_alone():
    bond = MohrCoulombJoint(
        normal_stiffness=K_N,
        shear_stiffness=K_S,
        friction_angle_deg=26.0,
        cohesion=1e6,
        tensile_strength=1e6,
    )
    law = ViscousJoint(law=bond, normal_viscosity=1e9)
    t, _ = tractions(law, [[0.5, 0, 0], [0.4, 0, 0]], dt=1e-3)
    np.testing.assert_allclose(t[:, 0], [0.5, 0.4], rtol=1e-12)


def test_the_shear_dashpot_is_bounded_by_the_pressure():
    # 1e9 Pa s/m at 5 um in 1 ms would be 5 MPa beside 1 MPa of pressure; friction holds 0.5 MPa.
    law = ViscousJoint(law=FRICTION, shear_viscosity=1e9)
    t, answers = tractions(law, [[-1, 0, 0], [-1, 3, 4]], dt=1e-3)
    np.testing.assert_allclose(t[1], [-1, 1.5 * 0.6, 1.5 * 0.8], rtol=1e-12)
    # Dissipated: 1 MPa of dashpot over 5 um, and friction's mean 0.25 MPa over 4.75 um.
    assert answers[1].dissipation[0] == pytest.approx(5.0 + 0.25 * 4.75, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: ViscousJoint(law=1.0), "law is 1.0; it must be a joint law of"),
        (
            lambda: ViscousJoint(law=DILATANT),
            "law has a dilatancy angle; dashpots need a law that closes",
        ),
        (lambda: ViscousJoint(law=ViscousJoint(law=FRICTION)), "law already has dashpots; change"),
    ],
)
def test_laws_without_dashpots(make, text):
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        make()
    assert text in str(refused.value)


@pytest.mark.parametrize("given", [1e9, (1e9,), (1e9, -1.0), (1e9, math.nan), None])
def test_a_stiffness_that_is_not_two_numbers(given):
    pytest.importorskip("petsc4py")
    from dolfinx_joints import MatrixSystem

    class Own(FrictionNoTension):
        def closed_stiffness(self):
            return given

    law = Own(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0)
    with pytest.raises(ValueError, match="Own.closed_stiffness returned .*; it must return normal"):
        MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=[[1.0], [0.0], [0.0]], law=law)


@pytest.mark.parametrize("end", [1e-13, 1e-6, 4e-5])
@pytest.mark.parametrize("viscosity", [1e6, 1e8])
def test_dashpots_act_until_a_joint_opens(end, viscosity):
    # From g0 < 0 to g1 > 0 the mean pressure of the law is k_n g0^2 / 2 over g1 - g0, less what the
    # dashpot pulls, eta (0 - g0) / dt, and never tension. Both are continuous at g1 = 0.
    start, dt, k_n = -1e-5, 2e-3, 1e10
    law = ViscousJoint(
        law=KeyedJoint(normal_stiffness=k_n, shear_stiffness=0.0),
        normal_viscosity=viscosity,
        shear_viscosity=0.0,
    ).for_step(dt)
    state = JointState.at_rest(np.array([[start, 0.0, 0.0]]))
    pressure = k_n * start**2 / 2.0 / (end - start) - viscosity * -start / dt
    found = law.discrete_gradient(np.array([[end, 0.0, 0.0]]), state)
    assert found.traction[0, 0] == pytest.approx(-max(pressure, 0.0), rel=1e-12, abs=1e-9)
    closed = law.discrete_gradient(np.array([[-1e-13, 0.0, 0.0]]), state)
    opened = law.discrete_gradient(np.array([[1e-13, 0.0, 0.0]]), state)
    assert closed.traction[0, 0] == pytest.approx(opened.traction[0, 0], rel=1e-6, abs=0.1)
