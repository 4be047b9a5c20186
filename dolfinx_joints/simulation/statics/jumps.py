# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Jumps of a static stage: increments in which the structure leaves its equilibrium path."""

from __future__ import annotations

import numpy as np

from dolfinx_joints.common.errors import JumpError
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.static_energy import Jump, StaticEnergy
from dolfinx_joints.simulation.statics.ledger import StaticLedger
from dolfinx_joints.simulation.statics.load_increments import Increment

# Joints that release less than this share of a jump are not named.
NAMED_SHARE = 0.05


class Jumps:
    """Jumps of a stage: increments of the shortest length that release energy.

    Unless jumps are ``allowed``, the first jump raises an error; else ``recorded`` lists all jumps.
    """

    def __init__(self, ledger: StaticLedger, model: Model, allowed: bool) -> None:
        """Start without jumps."""
        self._ledger, self._allowed = ledger, allowed
        self._names = () if model.contact is None else model.contact.operator.names
        self.recorded: list[Jump] = []

    def add(self, energy: StaticEnergy, increment: Increment) -> None:
        """Record an increment if it is a jump; ``energy`` are the energies at its end.

        Raises:
            JumpError: The increment is a jump, and jumps are not allowed.
        """
        by_joint = energy.joint_released - self._ledger.energy.joint_released
        total = float(by_joint.sum())
        if total == 0.0:
            return
        order = [i for i in np.argsort(-by_joint) if by_joint[i] > NAMED_SHARE * total]
        names = tuple(self._names[i] for i in order)
        if not self._allowed:
            raise increment.locate(
                JumpError(released=total, joints=names),
                "The loads exceed what the joints can carry on this equilibrium path. "
                "In statics and quasi_statics allow_jumps=True accepts the state after the jump.",
            )
        self.recorded.append(
            Jump(
                step=increment.step,
                time=increment.time,
                start=increment.start,
                end=increment.share,
                energy=total,
                joints=names,
            )
        )

    def of_step(self, step: int) -> list[Jump]:
        """Return the jumps of a load step."""
        return [jump for jump in self.recorded if jump.step == step]
