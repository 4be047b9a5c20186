# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Losses of end-point steps: with what is stored they are the work, and of end tractions no gain.

Joints of 1 MPa/um, gaps and slips of some um, so that works are in J/m^2; random histories that
open, close, stick, slide and break.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dolfinx_joints.laws.adhesive import AdhesiveJoint
from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.keyed import KeyedJoint
from dolfinx_joints.laws.law import JointState, LawWithHistory, LawWithLosses, Status
from dolfinx_joints.laws.losses import losses_of
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.rigid import RigidJoint
from dolfinx_joints.laws.viscous import ViscousJoint

UM = 1e-6
STIFF = {"normal_stiffness": 1e12, "shear_stiffness": 0.5e12}
FRICTION = FrictionNoTension(**STIFF, friction_angle_deg=35.0)
BOND = MohrCoulombJoint(
    **STIFF,
    friction_angle_deg=35.0,
    cohesion=2e6,
    tensile_strength=1e6,
    dilatancy_angle_deg=10.0,
)
LAWS = {
    "friction": FRICTION,
    "adhesive": AdhesiveJoint(**STIFF, friction_angle_deg=35.0, adhesion=3e5),
    "no shear": FrictionNoTension(normal_stiffness=1e12, shear_stiffness=0, friction_angle_deg=0),
    "keyed": KeyedJoint(**STIFF),
    "bond": BOND,
    "rigid": RigidJoint(friction_angle_deg=35.0),
    "dashpots": ViscousJoint(law=FRICTION, normal_viscosity=1e8, shear_viscosity=1e8),
}
DT = 1e-3


def steps(law, count=2000, number=8):
    """Steps of random histories: the state before, the answer, the answer before it."""
    rng = np.random.default_rng(3)
    gap = UM * rng.normal(size=(count, 3))
    if isinstance(law, RigidJoint):
        gap[:, 0] = np.abs(gap[:, 0])
    state = JointState.at_rest(gap)
    if isinstance(law, LawWithHistory):
        state = replace(state, internal=law.initial_variables(gap))
    if isinstance(law, ViscousJoint):
        law, state = law.for_step(DT), replace(state, internal=np.zeros((0, 0)))
    answer = None
    for _ in range(number):
        moved = state.gap + UM * rng.normal(size=(count, 3))
        before, last = state, answer
        if isinstance(law, RigidJoint):
            answer = law.condensed_backward_euler(moved, np.full((1, 2), 1e-12), state)
        else:
            answer = law.backward_euler(moved, state)
        state = answer.state
        if last is not None:
            yield law, before, answer, last


@pytest.mark.parametrize("name", LAWS)
def test_losses_and_what_is_stored_are_the_work(name):
    """Of the end traction, of the mean of both ends, and of any other."""
    assert isinstance(LAWS[name], LawWithLosses) or name == "dashpots"
    seen = set()
    for law, before, answer, last in steps(LAWS[name]):
        seen |= set(answer.status.tolist())
        moved = answer.state.gap - before.gap
        stored = law.stored_energy(answer.state) - law.stored_energy(before)
        for traction in (answer.traction, 0.5 * (answer.traction + last.traction), last.traction):
            lost = law.losses(before, answer, traction)
            work = np.einsum("ij,ij->i", traction, moved)
            np.testing.assert_allclose(sum(lost), work - stored, rtol=0, atol=1e-12)
    assert {Status.OPEN, Status.FRICTIONLESS if name == "no shear" else Status.STICK} <= seen


@pytest.mark.parametrize("name", LAWS)
def test_a_traction_of_the_end_gains_nothing(name):
    """Friction takes t . (plastic slip), the scheme change . k change / 2 and what flight meets."""
    for law, before, answer, _ in steps(LAWS[name]):
        lost = law.losses(before, answer, answer.traction)
        assert lost.friction.min() >= -1e-12
        assert lost.numerical.min() >= -1e-12


def test_by_hand():
    """From 1 um of overlap to 3 um: 1e12 (2 um)^2 / 2 = 2 J/m^2; from 1 um open to 1 um overlap the
    traction of 1 MPa acts on 1 um of flight, 1 J/m^2, and 0.5 J/m^2 as before; open to open none.
    """
    before = JointState.at_rest(UM * np.array([[-1.0, 0, 0], [1, 0, 0], [1, 0, 0]]))
    answer = FRICTION.backward_euler(UM * np.array([[-3.0, 0, 0], [-1, 0, 0], [2, 5, 0]]), before)
    lost = FRICTION.losses(before, answer, answer.traction)
    np.testing.assert_allclose(lost.numerical, [2.0, 1.5, 0.0], rtol=1e-12)
    assert not lost.friction.any()


def test_what_a_rigid_joint_stored_is_let_go():
    law = RigidJoint(friction_angle_deg=35.0)
    before = JointState(
        gap=np.zeros((1, 3)), elastic_slip=np.zeros((1, 2)), internal=np.array([[2.0, 1.0, 2.0]])
    )
    compliance = np.full((1, 2), 1e-12)
    answer = law.condensed_backward_euler(UM * np.array([[1.0, 0, 0]]), compliance, before)
    # 2 J/m^2 of pressure and (1 + 4) / 2 of shear.
    assert law.losses(before, answer, answer.traction).numerical == pytest.approx([4.5])


def test_a_law_that_states_none_has_the_rest():
    class Plain:
        backward_euler = FRICTION.backward_euler
        stored_energy = FRICTION.stored_energy
        closed_stiffness = FRICTION.closed_stiffness

    for law, before, answer, _ in steps(FRICTION, number=3):
        plain = losses_of(Plain(), before, answer, answer.traction)
        own = law.losses(before, answer, answer.traction)
        np.testing.assert_allclose(sum(plain), sum(own), rtol=0, atol=1e-12)
        np.testing.assert_array_equal(plain.friction, answer.dissipation)
