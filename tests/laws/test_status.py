# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Status of points under every law: a closed one without shear resistance is frictionless.

All laws see the same three points: 1 um open, and closed by 1 um with a slip of 1 nm or 1 mm. With
k_n = k_s = 1e12 Pa/m and mu = 0.5 the pressure is 1 MPa and the limit of the shear traction 0.5
MPa; trial tractions of 1 kPa and 1 GPa lie below and beyond it.
"""

import numpy as np
import pytest

from dolfinx_joints.laws.friction import FrictionNoTension, frictionless
from dolfinx_joints.laws.keyed import KeyedJoint
from dolfinx_joints.laws.law import JointState, Status
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.rigid import RigidJoint
from dolfinx_joints.laws.shear_keys import ShearKeyJoint
from dolfinx_joints.laws.viscous import ViscousJoint

OPEN, STICK, SLIP, FREE = Status.OPEN, Status.STICK, Status.SLIP, Status.FRICTIONLESS
K = {"normal_stiffness": 1e12, "shear_stiffness": 1e12}
SMOOTH = {**K, "shear_stiffness": 0.0}
TEETH = {
    "depth": 0.05,
    "flank_angle_deg": 45.0,
    "spacing": 0.5,
    "tooth_cohesion": 1e9,
    "forward_play": 0.01,
    "backward_play": 0.01,
}
GAP = np.array([[1e-6, 0.0, 0.0], [-1e-6, 1e-9, 0.0], [-1e-6, 1e-3, 0.0]])

RUBS, NO_FRICTION = {"friction_coefficient": 0.5}, {"friction_coefficient": 0.0}
BOND = {"cohesion": 1e12, "tensile_strength": 1e7}  # [Pa], nothing here breaks it
# Law, and the status of the three points; an intact bond is closed in tension too.
LAWS = {
    "friction": (FrictionNoTension(**K, **RUBS), [OPEN, STICK, SLIP]),
    "no friction": (FrictionNoTension(**K, **NO_FRICTION), [OPEN, FREE, FREE]),
    "no shear stiffness": (FrictionNoTension(**SMOOTH, **RUBS), [OPEN, FREE, FREE]),
    "pressure only": (frictionless(normal_stiffness=1e12), [OPEN, FREE, FREE]),
    "rigid": (RigidJoint(**RUBS), [OPEN, STICK, SLIP]),
    "rigid without friction": (RigidJoint(**NO_FRICTION), [OPEN, FREE, FREE]),
    "rigid without rebound": (RigidJoint(**NO_FRICTION, restitution=0), [OPEN, FREE, FREE]),
    "keyed": (KeyedJoint(**K), [OPEN, STICK, STICK]),
    "keyed without shear": (KeyedJoint(**SMOOTH), [OPEN, FREE, FREE]),
    "Mohr-Coulomb": (MohrCoulombJoint(**K, **RUBS), [OPEN, STICK, SLIP]),
    "Mohr-Coulomb without friction": (MohrCoulombJoint(**K, **NO_FRICTION), [OPEN, FREE, FREE]),
    "Mohr-Coulomb without shear": (MohrCoulombJoint(**SMOOTH, **RUBS), [OPEN, FREE, FREE]),
    "cohesion alone": (
        MohrCoulombJoint(**K, **NO_FRICTION, **BOND),
        [STICK] * 3,
    ),
    "bond without shear": (
        MohrCoulombJoint(**SMOOTH, **NO_FRICTION, **BOND),
        [FREE] * 3,
    ),
    "shear keys": (ShearKeyJoint(**K, **RUBS, **TEETH), [OPEN, STICK, SLIP]),
    "shear keys without friction": (ShearKeyJoint(**K, **NO_FRICTION, **TEETH), [OPEN, FREE, FREE]),
    "dashpots": (ViscousJoint(law=FrictionNoTension(**K, **RUBS)), [OPEN, STICK, SLIP]),
    "dashpots without friction": (
        ViscousJoint(law=frictionless(normal_stiffness=1e12), shear_viscosity=1e9),
        [OPEN, FREE, FREE],
    ),
}


def at_rest(law):
    """State of the points, closed at rest and without slip."""
    gap = np.zeros_like(GAP)
    first = getattr(law, "initial_variables", lambda gap: np.zeros((len(gap), 0)))(gap)
    state = JointState.at_rest(gap, variables=first.shape[1])
    state.internal[:] = first
    return state


@pytest.mark.parametrize("name", LAWS)
def test_status_of_every_law(name):
    """At the end of a step and over a whole one, by the gap and on a compliance."""
    law, expected = LAWS[name]
    step, state, asked = law.for_step(0.01) if hasattr(law, "for_step") else law, at_rest(law), 0
    for rule in ("backward_euler", "discrete_gradient"):
        if hasattr(step, rule) and not isinstance(law, RigidJoint):
            assert getattr(step, rule)(GAP, state).status.tolist() == expected
            asked += 1
        condensed = getattr(law, f"condensed_{rule}", None)
        if condensed is not None:
            # On 1e-12 m/Pa the overlap is shared, and with it the tractions halved.
            answer = condensed(GAP, np.full((1, 2), 1e-12), state)
            assert answer.status.tolist() == expected
            asked += 1
    assert asked >= 1
