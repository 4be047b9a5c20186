# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic predictor: where the iteration of a static increment starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import JointState
from dolfinx_joints.solvers.interface.residual import JointStep

Floats = NDArray[np.float64]

# Residual of the linear systems of static solves at first, relative to their right-hand sides: few
# solves are made, and each correction is to use the whole of its linearisation.
STATIC_TOLERANCE = 3e-4


def elastic_predictor(step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
    """Return the scaled forces f of the elastic predictor and S f (collective).

    The laws are linearised at the accepted state, where the joints carry f0 and their gap is that
    of the state. With h0 the trial gaps of the laws there and T the tangent,

        f = f0 + T (h(f) - h0)   with   h(f) = h_trial - S f.                               (28c)

    Newton's method from f stays on the branch of equilibria that the state is on.

    Args:
        step: The static increment.
        traction: Tractions of the accepted state, shape (n, 3), [Pa].
    """
    condensed, compliance = step.condensed, step.condensed.compliance
    force = step.forces(traction)
    coupled = compliance.split.product(force, np.flatnonzero(force))
    own = np.repeat(compliance.own, (1, 2), axis=1)
    here = step.state.gap + own * traction + (compliance.scale * coupled).reshape(-1, 3)
    tangent = step.at_trial_gap(here).evaluate(force, coupled).tangent
    change = ((step.trial_gap - here).ravel() / compliance.scale).reshape(-1, 3)
    right = -np.einsum("nij,nj->ni", tangent, change).ravel()
    correction = condensed.corrections.solve(right, tangent, STATIC_TOLERANCE)
    return force - correction.step, coupled - correction.coupled


def tractions_of(contact: Contact, state: JointState) -> Floats:
    """Return the tractions that follow from a state, shape (n, 3), [Pa] (collective).

    Those of rigid joints do not follow from their gaps; they are taken as zero.
    """
    if contact.rigid:
        return np.zeros_like(state.gap)
    return contact.at_gap(state.gap, state).traction
