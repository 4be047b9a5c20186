# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Adhesion that stays while the joint slides: points by hand, energies, the law without adhesion.

Tangents are in `test_tangents`, losses of end-point steps in `test_losses`.
"""

import numpy as np
import pytest

from dolfinx_joints import AdhesiveJoint, FrictionNoTension, ViscousJoint
from dolfinx_joints.laws.law import JointState, Status

# c = 1 MPa and mu = 0.5 give a tension of 2 MPa at the apex of the cone, reached at 2 um.
MPA, UM = 1e6, 1e-6
STIFF = {"normal_stiffness": 1e12, "shear_stiffness": 2e12, "friction_coefficient": 0.5}
LAW = AdhesiveJoint(**STIFF, adhesion=1e6)
COUNT = 50_000


def states(law, seed=1):
    """Random gaps, and admissible states that are open, stick and slide."""
    rng = np.random.default_rng(seed)
    gap, before = 3 * UM * rng.normal(size=(2, COUNT, 3))
    state = JointState(gap=before, elastic_slip=UM * rng.normal(size=(COUNT, 2)))
    return gap, law.backward_euler(before, state).state


def test_path_by_hand():
    """Opened to the tensile strength and beyond, pressed, slid back and forth, and opened.

    The normal path is that of code_aster's test SSNP162 D, of its law JOINT_MECA_FROT.
    """
    path = [[2, 0, 0], [4, 0, 0], [-0.5, 0, 0], [-0.5, 3, 0], [-0.5, 9, 0], [-0.5, 0, 0]]
    path += [[1, 9, 0], [4, 9, 0], [-1, 9, 0], [-1, 9.5, 0]]
    # Limits c - mu t_n: 1.25 MPa at -0.5 MPa, 0.5 MPa at 1 MPa. From 4 to -1 um there is no slip.
    expected = [[2, 0], [2, 0], [-0.5, 0], [-0.5, 1.25], [-0.5, 1.25], [-0.5, -1.25]]
    expected += [[1, 0.5], [2, 0], [-1, 0], [-1, 1]]
    state, tractions = JointState.at_rest(np.zeros((1, 3))), []
    for gap in path:
        answer = LAW.backward_euler(UM * np.array([gap]), state)
        state = answer.state
        tractions.append(answer.traction[0, :2] / MPA)
    np.testing.assert_allclose(tractions, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rule", ["backward_euler", "discrete_gradient"])
def test_without_adhesion_it_is_friction(rule):
    law, friction = AdhesiveJoint(**STIFF, adhesion=0.0), FrictionNoTension(**STIFF)
    gap, state = states(friction)
    one, other = (getattr(each, rule)(gap, state) for each in (law, friction))
    for name in ("traction", "tangent", "dissipation", "status"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_whole_step_balances_its_energy_and_does_not_gain():
    gap, state = states(LAW)
    answer = LAW.discrete_gradient(gap, state)
    work = np.einsum("ij,ij->i", answer.traction, gap - state.gap)
    stored = LAW.stored_energy(answer.state) - LAW.stored_energy(state)
    np.testing.assert_allclose(stored + answer.dissipation, work, rtol=0, atol=1e-14 * work.max())
    assert answer.dissipation.min() >= 0.0
    assert set(answer.status.tolist()) == {Status.OPEN, Status.STICK, Status.SLIP}


@pytest.mark.parametrize("rule", ["backward_euler", "discrete_gradient"])
def test_on_a_compliance_it_is_the_law_at_its_gap(rule):
    compliance = np.array([[1e-12, 3e-12]])
    gap, state = states(LAW)
    answer = getattr(LAW, f"condensed_{rule}")(gap, compliance, state)
    reached = gap - np.repeat(compliance, (1, 2), axis=1) * answer.traction
    law = getattr(LAW, rule)(reached, state)
    np.testing.assert_allclose(answer.traction, law.traction, rtol=0, atol=1e-7)
    np.testing.assert_allclose(answer.state.gap, reached, rtol=0, atol=1e-20)


def test_sliding_points_are_on_the_cone():
    gap, state = states(LAW)
    answer = LAW.backward_euler(gap, state)
    limit = LAW.adhesion - LAW.friction_coefficient * answer.traction[:, 0]
    size = np.linalg.norm(answer.traction[:, 1:], axis=1)
    slides = answer.status == Status.SLIP
    np.testing.assert_allclose(size[slides], limit[slides], rtol=0, atol=1e-8)
    assert np.all(size <= limit * (1 + 1e-12) + 1e-6)


def test_refusals():
    with pytest.raises(ValueError, match="friction_angle_deg is 0 degrees; it must be positive"):
        AdhesiveJoint(**STIFF | {"friction_coefficient": 0.0}, adhesion=1e6)
    with pytest.raises(ValueError, match="law has adhesion; dashpots need"):
        ViscousJoint(law=LAW, normal_viscosity=1e6)
