# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the joints of a midpoint step know of its start besides their own state."""

from __future__ import annotations

from dataclasses import replace

from petsc4py import PETSc

from dolfinx_joints.laws.law import Floats, JointState
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.time_integration.states import DynamicState


def joints_before(
    system: MatrixSystem, state: DynamicState, turn: PETSc.Vec | None, rate: float
) -> JointState | None:
    """Return the state of the joints, slips for the length of the step, approach without rebound.

    ``turn`` is v1 - (2 x / dt - v0), None where it is zero [m/s]; ``rate`` is 2 / dt [1/s].
    """
    if state.joints is None:
        return None
    joints = state.joints.state
    if len(joints.slips) and state.rate not in (0.0, rate):
        joints = replace(joints, slips=_of_length(joints.slips, state.rate / rate))
    if system.contact is None or not system.contact.stops:
        return joints
    velocity = state.velocity.copy()
    if turn is not None:
        velocity.axpy(-1.0, turn)  # where nothing rebounds, 0 = v1 = 2 x / dt - (v0 - turn)
    if len(system.massless):
        # Theirs is that in the middle of the last step.
        late = system.massless
        velocity.getArray()[late] += state.acceleration.array[late] / rate
    approach = 2.0 / rate * system.contact.operator.jump(velocity)[:, 0]
    return replace(joints, approach=approach)


def _of_length(slips: Floats, times: float) -> Floats:
    """Slips of steps so many times as long as those before, on the same parabola."""
    slips = slips.copy()
    last, before = slips[:, :2], slips[:, 2:4]
    change = times**2 * (last - before)
    end = times * (1.5 * last - 0.5 * before)
    slips[:, :2], slips[:, 2:4] = end - 0.5 * change, end - 1.5 * change
    return slips
