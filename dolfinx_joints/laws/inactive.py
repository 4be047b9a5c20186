# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint points that carry nothing, as before a joint is grouted."""

from __future__ import annotations

import numpy as np

from dolfinx_joints.laws.law import Floats, JointState, Losses, Response, Status


class Inactive:
    """A law without traction whatever the gap."""

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """No traction at a gap, shape (n, 3), [m]."""
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
        """The same: without traction the trial gap is the gap."""
        return self.backward_euler(trial_gap, state)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """None."""
        return Losses(np.zeros(len(traction)), np.zeros(len(traction)))

    def stored_energy(self, state: JointState) -> Floats:
        """None, shape (n,), [J/m^2]."""
        return np.zeros(len(state.gap))

    def closed_stiffness(self) -> tuple[float, float]:
        """None, [Pa/m]."""
        return 0.0, 0.0
