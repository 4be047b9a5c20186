# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""State of a system at a time: start and result of a step of a time scheme."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.summary import Rows, Summarised, number
from dolfinx_joints.laws.law import Response


@dataclass(frozen=True, kw_only=True, repr=False)
class DynamicState(Summarised):
    """State of a system at one time; immutable.

    Attributes:
        time: Time [s].
        displacement: u [m].
        velocity: v [m/s].
        acceleration: a, or its mean over the last step with midpoint schemes [m/s^2].
        load: Nodal loads F [N].
        reaction: Forces of the supports on the body at constrained dofs, zero elsewhere [N]. With
            midpoint schemes they are means over the last step.
        momentum: M v [N s].
        elastic_force: K u [N].
        joints: Response of the joints and of nonlinear cells, None if the model has neither.
        remainder: Rounding residual of the last step at the unconstrained dofs, None at the start
            [N]. The next step subtracts this residual, so that residuals do not accumulate.
        water: State of the water in ``load`` at the local joint points (`Wetness`), shape (n,),
            None if no load depends on the joints.
        exact_modes: Number of modes that the step integrates exactly; their velocities are scaled
            (`exact_steps`).
        rate: 2 / dt of the last step, used to scale modal velocities and slips; 0 at start [1/s].
    """

    time: float
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    acceleration: PETSc.Vec
    load: PETSc.Vec
    reaction: PETSc.Vec
    momentum: PETSc.Vec
    elastic_force: PETSc.Vec
    joints: Response | None
    remainder: PETSc.Vec | None = None
    water: NDArray[np.int8] | None = None
    exact_modes: int = 0
    rate: float = 0.0

    def _summary(self) -> Rows:
        yield "time", f"{self.time:g} s"
        yield "unknowns", number(self.displacement.getSize())
        yield "joints", "none" if self.joints is None else ""

    @property
    def kinetic_energy(self) -> float:
        """v.M v / 2 [J] (collective)."""
        return 0.5 * float(self.velocity.dot(self.momentum))

    @property
    def strain_energy(self) -> float:
        """u.K u / 2 of bulk and springs, elastic also in nonlinear cells [J] (collective)."""
        return 0.5 * float(self.displacement.dot(self.elastic_force))


def with_means(previous: DynamicState | None, after: DynamicState, share: float) -> DynamicState:
    """Return the state after a substep, with tractions and reactions summed for step means.

    Each substep is weighted with ``share``, its fraction of the step, so the sums are means at the
    end of the step. ``previous`` is the result for the previous substep, None at the first.
    """
    reaction, joints = after.reaction.copy(), after.joints
    reaction.scale(share)
    if previous is not None:
        reaction.axpy(1.0, previous.reaction)
    if joints is not None:
        traction = share * joints.traction
        if previous is not None and previous.joints is not None:
            traction += previous.joints.traction
        joints = replace(joints, traction=traction)
    return replace(after, reaction=reaction, joints=joints)
