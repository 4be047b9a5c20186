# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points between two branches of a law: a change of the last bits changes answers by rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.keyed import KeyedJoint
from dolfinx_joints.laws.law import HELD, JointState
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.shear_keys import ShearKeyJoint
from dolfinx_joints.laws.viscous import ViscousJoint

K, MU, EPS = 1e11, 0.6, float(np.finfo(float).eps)
STIFF = {"normal_stiffness": K, "shear_stiffness": K}
FRICTION = FrictionNoTension(**STIFF, friction_coefficient=MU)
TEETH = {"depth": 0.2, "flank_angle_deg": 45.0, "spacing": 1.0, "tooth_cohesion": 1e9}
LAWS = {
    "friction": FRICTION,
    "keyed": KeyedJoint(**STIFF),
    "keys": ShearKeyJoint(**STIFF, **TEETH, friction_coefficient=MU),
    "Mohr-Coulomb": MohrCoulombJoint(**STIFF, friction_coefficient=MU, dilatancy_angle_deg=10.0),
    # Sheared by 1e-6 m, bond and teeth bear their strength, half of one times half of the other.
    "bonded": MohrCoulombJoint(**STIFF, friction_coefficient=MU, cohesion=K * 1e-6),
    "strong keys": ShearKeyJoint(
        **STIFF,
        **{**TEETH, "flank_angle_deg": 90.0, "tooth_cohesion": K * 2e-6, "tooth_width": 0.5},
        friction_coefficient=0.0,
    ),
    "viscous": ViscousJoint(law=FRICTION, shear_viscosity=1e8).for_step(0.01),
}
PRESSED = -1e-6  # normal gap [m]

# Normal gap and elastic slip at the start, and change of the gap [m]: on the friction cone, loaded
# along the slip, against it, across it, or not at all; touching without pressure, and pushed,
# pulled or sheared from there.
BETWEEN = {
    "on the cone, on": (PRESSED, MU * 1e-6, (0.0, 1e-6, 0.0)),
    "on the cone, back": (PRESSED, MU * 1e-6, (0.0, -1e-7, 0.0)),
    "on the cone, across": (PRESSED, MU * 1e-6, (-1e-7, 0.0, 1e-6)),
    "on the cone, at rest": (PRESSED, MU * 1e-6, (0.0, 0.0, 0.0)),
    "touching, pushed": (0.0, 0.0, (-1e-6, 1e-6, 0.0)),
    "touching, pulled": (0.0, 0.0, (1e-6, 1e-6, 0.0)),
    "touching, sheared": (0.0, 0.0, (0.0, 1e-6, 0.0)),
}


def changed(numbers, rng, scale):
    """Numbers with errors of some ulp of a scale, as sums in other orders have."""
    return numbers + 8.0 * EPS * scale * rng.uniform(-1.0, 1.0, numbers.shape)


RULES = ["backward_euler", "discrete_gradient"]


@pytest.mark.parametrize("case", BETWEEN)
@pytest.mark.parametrize(
    ("name", "rule"), [(n, rule) for n, law in LAWS.items() for rule in RULES if hasattr(law, rule)]
)
def test_last_bits_change_answers_by_rounding(name, case, rule):
    """Gaps are differences of displacements, here of 1e-4 m, and have rounding errors of these.

    Tractions then differ by the stiffness times such errors, and energies by these times the slip:
    they are compared to 1000 times as much.
    """
    law, (normal, elastic, change), rng = LAWS[name], BETWEEN[case], np.random.default_rng(3)
    count = 200
    gap = np.tile([normal, 0.0, 0.0], (count, 1))
    state = replace(JointState.at_rest(gap), elastic_slip=np.tile([elastic, 0.0], (count, 1)))
    if hasattr(law, "initial_variables"):
        state = replace(state, internal=law.initial_variables(gap))
    state = replace(
        state,
        gap=changed(gap, rng, 1e-4),
        elastic_slip=changed(state.elastic_slip, rng, elastic),
    )
    answer = getattr(law, rule)(changed(gap + change, rng, 1e-4), state)
    error = 1000.0 * 8.0 * EPS * 1e-4
    np.testing.assert_allclose(np.ptp(answer.traction, axis=0), 0.0, atol=K * error)
    assert np.ptp(answer.dissipation) < K * error * 1e-6
    assert np.ptp(law.stored_energy(answer.state)) < K * error * 1e-6


# Shear keys pressed on base and both flanks and on the limit of friction on all three, in a block
# whose compliance is 50 times that of the joint, pushed on along the keys [m, J/m^2].
ON_THE_CONE = JointState(
    gap=np.array([
        [-2.762177e-07, 1.538481e-08, -3.562904e-06],
        [-2.452842e-07, 1.897100e-08, -1.431634e-05],
    ]),
    elastic_slip=np.array([[2.789461e-09, -1.594500e-07], [2.023122e-09, -1.416004e-07]]),
    internal=np.array([
        [HELD, 0.0, 3.754922e-08, -1.129693e-07, -3.763836e-08, -9.961084e-08],
        [HELD, 0.0, 2.431588e-08, -1.051057e-07, -2.387641e-08, -8.925354e-08],
    ]),
    slips=np.array([
        [1.051257e-08, -2.079292e-06, 6.307541e-09, -1.247575e-06, 2.339154e-02],
        [4.352823e-09, -1.077121e-05, 5.670467e-08, -1.107121e-06, 4.362856e-02],
    ]),
)  # fmt: skip
PUSHED = np.array([
    [-2.780896e-05, 4.084939e-07, -3.247065e-05],
    [-2.517878e-05, 1.144381e-06, -4.550901e-05],
])  # fmt: skip


@pytest.mark.parametrize("rule", RULES)
def test_keys_on_the_friction_cone_slide_on_a_compliance(rule):
    """The gap is the trial gap less compliance times traction, whatever the last bits are.

    From the start of the step no part of Newton's step makes the residual smaller: there are kinks
    next to it. Across these the solution is found; tractions change by errors of the trial gap
    over the compliance.
    """
    law = ShearKeyJoint(**STIFF, **{**TEETH, "tooth_cohesion": 2e5}, friction_angle_deg=30.0)
    rng, copies = np.random.default_rng(4), 50
    parts = ("gap", "elastic_slip", "internal", "slips")
    many = {part: np.repeat(getattr(ON_THE_CONE, part), copies, axis=0) for part in parts}
    state = JointState(**{part: changed(each, rng, np.abs(each)) for part, each in many.items()})
    state.internal[:, 0] = HELD
    trial = changed(np.repeat(PUSHED, copies, axis=0), rng, 1e-4)
    compliance = np.array([[5.515718e-10, 5.291974e-10]])
    answer = getattr(law, f"condensed_{rule}")(trial, compliance, state)
    met = trial - np.repeat(compliance, (1, 2), axis=1) * answer.traction
    np.testing.assert_allclose(answer.state.gap, met, rtol=0, atol=1e-18)
    error = 1000.0 * 8.0 * EPS * 1e-4 / compliance.min()
    spread = np.ptp(answer.traction.reshape(2, copies, 3), axis=1)
    np.testing.assert_allclose(spread, 0.0, atol=error)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(("flank", "friction"), [(45.0, 30.0), (60.0, 30.0), (90.0, 45.0)])
def test_keys_are_found_on_any_compliance(flank, friction, rule):
    """Random steps are solved on compliances of 0.1 to 10 000 times that of the joint."""
    teeth = {**TEETH, "flank_angle_deg": flank}
    law = ShearKeyJoint(**STIFF, **teeth, friction_angle_deg=friction)
    rng, count = np.random.default_rng(5), 400
    gap = np.tile([-2e-7, 0.0, 0.0], (count, 1))
    state = replace(JointState.at_rest(gap), internal=law.initial_variables(gap))
    compliance = 10.0 ** rng.uniform(-1, 4, (count, 1)) / K * rng.uniform(0.5, 2.0, (count, 2))
    c = np.repeat(compliance, (1, 2), axis=1)
    held = np.zeros((count, 3))
    for _ in range(6):
        size = 10.0 ** rng.uniform(-8.0, -4.3, (count, 1)) * np.array([0.3, 1.0, 1.0])
        trial = state.gap + c * held + size * rng.normal(size=(count, 3))
        answer = getattr(law, f"condensed_{rule}")(trial, compliance, state)
        state, held = answer.state, answer.traction
        np.testing.assert_allclose(state.gap, trial - c * held, rtol=0, atol=1e-14)
