# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic predictor: start of a static increment on the branch of the accepted equilibrium.

The symbols are those of `joint_step`: scaled joint forces f, scaled compliance less the identity S.
"""

from __future__ import annotations

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import JointState
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.joint_step import JointStep


class AcceptedForces:
    """Scaled forces f and S f of the last two accepted static solves.

    Under proportional loading the next forces are often on the line through the last two forces.
    """

    def __init__(self) -> None:
        """Start without any forces."""
        self._traction: Floats | None = None
        self._solved: tuple[Floats, Floats, Floats] | None = None
        self._forces: list[tuple[Floats, Floats]] = []

    def solved(self, traction: Floats, force: Floats, coupled: Floats) -> None:
        """Store the tractions (n, 3) [Pa], f and S f of a solve that may be accepted."""
        self._solved = traction, force, coupled

    def start(self, step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
        """Return f and S f at which a step starts (collective).

        The start is on the line through the last two accepted forces if its residual is small.
        Otherwise it is the elastic predictor.

        Args:
            step: The static increment.
            traction: Tractions of the accepted state, shape (n, 3), [Pa].
        """
        if self._solved is not None and traction is self._solved[0]:
            self._forces = [*self._forces[-1:], self._solved[1:]]
        elif traction is not self._traction:
            self._forces = []
        self._traction, self._solved = traction, None
        if len(self._forces) == 2:
            (f0, s0), (f1, s1) = self._forces
            line = 2.0 * f1 - f0, 2.0 * s1 - s0
            at = step.evaluate(*line)
            if at.max_residual <= limits.ON_LINE * at.max_force:
                return line
        return elastic_predictor(step, traction)


def elastic_predictor(step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
    """Return the scaled forces f of the elastic predictor and S f (collective).

    The laws are linearised at the accepted state with forces f0, scaled trial gaps h0, tangent T:

        f = f0 + T (h(f) - h0)   with   h(f) = g_f - S f,                                   (28e)

    where g_f is the scaled gap without joint forces, see docs/theory for (28e). Newton's method
    from f stays on the branch.

    Args:
        step: The static increment.
        traction: Tractions of the accepted state, shape (n, 3), [Pa].
    """
    condensed, compliance = step.condensed, step.condensed.compliance
    force = step.forces(traction)
    coupled = condensed.corrections.product(force)
    c = np.repeat(compliance.own, (1, 2), axis=1)
    trial_gap = step.state.gap + c * traction + (compliance.scale * coupled).reshape(-1, 3)
    tangent = step.at_free_gap(trial_gap).evaluate(force, coupled).tangent
    change = ((step.free_gap - trial_gap).ravel() / compliance.scale).reshape(-1, 3)
    right_hand_side = -np.einsum("nij,nj->ni", tangent, change).ravel()
    tolerance = limits.STATIC_FORCING
    correction = condensed.corrections.solve(right_hand_side, tangent, 0.0, tolerance, couples=True)
    return force - correction.step, coupled - correction.coupled


def tractions_of(contact: Contact, state: JointState, given: Floats | None) -> Floats:
    """Return the tractions of a state, shape (n, 3), [Pa] (collective).

    Return ``given`` if it is not None. Otherwise the laws give the tractions at the gaps of the
    state; if a joint is rigid, all tractions are zero.
    """
    if given is not None:
        return given
    if contact.rigid:
        return np.zeros_like(state.gap)
    return contact.at_gap(state.gap, state).traction
