# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Jumps of a static stage: increments that leave the path of equilibria."""

from __future__ import annotations

import numpy as np

from dolfinx_joints.common.errors import JumpError
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.static_energy import Jump, StaticEnergy
from dolfinx_joints.simulation.statics.ledger import StaticLedger
from dolfinx_joints.simulation.statics.load_increments import Increment

# An increment that releases more than this share of its load work plus the stored energy is cut.
# Measured in docs/decisions/two_solvers.md.
RELEASED_SHARE = 0.05

# Joints that release less than this share of a jump are not named.
NAMED_SHARE = 0.05


class Jumps:
    """Find the increments of a stage that release energy.

    The shortest increments are compared with the energies at the end of their load step: a jump
    under next to no load, as of a block that finds its seat, is not one of the structure.

    Args:
        ledger: The ledger of the stage.
        model: The model.
        allowed: Whether jumps are kept rather than raised as errors.

    Attributes:
        found: Jumps of the load steps that have ended.
        of_step: Those of the last one.
    """

    def __init__(self, ledger: StaticLedger, model: Model, allowed: bool) -> None:
        """Start without any."""
        self._ledger, self._allowed = ledger, allowed
        self._names = () if model.contact is None else model.contact.operator.names
        self._suspects: list[tuple[Jump, Increment]] = []
        self._step_start = ledger.energy
        self.found: list[Jump] = []
        self.of_step: list[Jump] = []

    def suspected(self, energy: StaticEnergy, increment: Increment) -> bool:
        """Return True if the increment to these energies releases too much; keep its place."""
        by_joint = energy.joint_released - self._ledger.energy.joint_released
        released = float(by_joint.sum())
        if not released > max(RELEASED_SHARE * self._ledger.turned_over(energy), 0.0):
            return False
        if increment.shortest:
            order = np.argsort(-by_joint)
            named = [self._names[i] for i in order if by_joint[i] > NAMED_SHARE * released]
            jump = Jump(
                step=increment.step,
                time=increment.time,
                start=increment.start,
                end=increment.share,
                energy=released,
                joints=tuple(named),
            )
            self._suspects.append((jump, increment))
        return True

    def check(self, increment: Increment) -> None:
        """Compare the suspected jumps of a load step with the energies at its end.

        Raises:
            JumpError: One of them is a jump, and jumps are not allowed.
        """
        if not increment.whole:
            return
        energy, start, self.of_step = self._ledger.energy, self._step_start, []
        turned_over = abs(energy.input - start.input) + energy.stored
        for jump, place in self._suspects:
            if jump.energy > RELEASED_SHARE * turned_over:
                self.found.append(jump)
                self.of_step.append(jump)
                if not self._allowed:
                    raise place.located(
                        JumpError(released=jump.energy, joints=jump.joints),
                        "The loads are beyond what the joints can carry on this path. "
                        "allow_jumps=True accepts the state after the jump.",
                    )
        self._suspects, self._step_start = [], energy
