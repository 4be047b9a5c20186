# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inactive joint points without traction, for example before a joint is grouted."""

from __future__ import annotations

import numpy as np

from dolfinx_joints.laws.law import Floats, JointState, Losses, Response, Status


class Inactive:
    """Joint law with zero traction at any gap."""

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return zero traction at a gap of shape (n, 3), [m]."""
        count = len(gap)
        return Response(
            traction=np.zeros((count, 3)),
            tangent=np.zeros((count, 3, 3)),
            state=JointState.at_rest(gap),
            dissipation=np.zeros(count),
            status=np.full(count, Status.OPEN, dtype=np.int8),
        )

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return zero traction, so that the gap equals the trial gap."""
        return self.backward_euler(trial_gap, state)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return zero losses."""
        return Losses(np.zeros(len(traction)), np.zeros(len(traction)))

    def stored_energy(self, state: JointState) -> Floats:
        """Return zero energies, shape (n,), [J/m^2]."""
        return np.zeros(len(state.gap))

    def closed_stiffness(self) -> tuple[float, float]:
        """Return zero stiffnesses, [Pa/m]."""
        return 0.0, 0.0
