# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""State of the joints at the start of a midpoint step, prepared for the joint laws."""

from __future__ import annotations

from dataclasses import replace

from petsc4py import PETSc

from dolfinx_joints.laws.law import Floats, JointState
from dolfinx_joints.model.system import MatrixSystem
from dolfinx_joints.time_integration.states import DynamicState


def joints_before(
    system: MatrixSystem, state: DynamicState, correction: PETSc.Vec | None, rate: float
) -> JointState | None:
    """Return the joint state with slips scaled to the step length, and approaches without rebound.

    ``correction`` is v1 - (2 x / dt - v0), None if zero [m/s]; ``rate`` is 2 / dt [1/s].
    """
    if state.joints is None:
        return None
    joints = state.joints.state
    if len(joints.slips) and state.rate not in (0.0, rate):
        joints = replace(joints, slips=rescaled_slips(joints.slips, state.rate / rate))
    if system.contact is None or not system.contact.stops:
        return joints
    velocity = state.velocity.copy()
    if correction is not None:
        velocity.axpy(-1.0, correction)  # Without rebound, 0 = v1 = 2 x / dt - (v0 - correction).
    if len(system.massless):
        # Velocities of massless dofs are means of the last step: extrapolate them to its end.
        massless = system.massless
        velocity.getArray()[massless] += state.acceleration.array[massless] / rate
    approach = 2.0 / rate * system.contact.operator.jump(velocity)[:, 0]
    return replace(joints, approach=approach)


def rescaled_slips(slips: Floats, times: float) -> Floats:
    """Return the last two slips for steps ``times`` as long; slip is a parabola in time."""
    slips = slips.copy()
    last, before = slips[:, :2], slips[:, 2:4]
    change = times**2 * (last - before)
    end = times * (1.5 * last - 0.5 * before)
    slips[:, :2], slips[:, 2:4] = end - 0.5 * change, end - 1.5 * change
    return slips
