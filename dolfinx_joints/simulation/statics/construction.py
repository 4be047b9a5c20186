# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stages of construction: inactive joints, absent blocks, and grouting."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, Response, Status
from dolfinx_joints.loads.load import FollowsJoints, load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.plausibility import warn_of_grout
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.statics.ledger import with_stored
from dolfinx_joints.simulation.statics.stage_start import without_traction
from dolfinx_joints.simulation.statics.unfinished import (
    Rows,
    Unfinished,
    check_elastic,
    check_joints,
    find_unfinished,
    idle_points,
    points_of,
)

# Largest number of Newton iterations for the gap at which a joint has the grout pressure.
MOST_ITERATIONS = 50

# Tractions below this fraction of the normal stiffness times the opening count as zero.
SAME = 1e-9


def with_inactive(
    contact: Contact,
    response: Response | None,
    before: StaticState,
    u: PETSc.Vec,
    stage: Unfinished,
) -> Response:
    """Return the response of all joint points at a displacement u [m] (collective).

    Idle points (of inactive joints, and next to absent blocks) are open, without traction and
    history. All other points have the given ``response``, None if no joint is active. ``before`` is
    the state at the start of the stage. Points next to absent blocks have the initial gap of the
    model, because these blocks are cast later.
    """
    gap = contact.gap(u)
    if before.joints is not None:
        increment = u.copy()
        increment.axpy(-1.0, before.displacement)
        gap = before.joints.state.gap + contact.operator.jump(increment)
    gap[stage.uncast] = contact.initial_gap[stage.uncast]
    idle = without_traction(contact.resting(gap))
    return idle if response is None else _combine(stage.idle, idle, response)


def grout_joints(
    model: Model,
    before: StaticState,
    names: Sequence[str] | None,
    *,
    gap: float,
    pressure: float,
    press: Callable[..., StaticState],
) -> StaticState:
    """Return the static state after grouting; displacements change only if ``pressure`` > 0.

    See `Simulation.grout` for ``names``, ``gap`` and ``pressure`` (collective). ``before`` is the
    state before grouting. The function ``press`` returns the equilibrium under grout pressure: it
    runs `march` from ``before``, with its arguments ``stage`` (joints and blocks that do not act)
    and ``apart`` (tractions of the grout on the joint faces).
    """
    check_joints(model, names or ())
    check_elastic(model)
    contact, response = model.contact, before.joints
    if contact is None or response is None:
        return replace(before, inactive=())
    if gap and pressure:
        raise ValueError(
            f"gap is {gap:g} m and pressure {pressure:g} Pa; at least one must be zero."
        )
    warn_of_grout(model.jointed.mesh.comm, pressure)
    chosen = (before.inactive or model.jointed.joint_names) if names is None else names
    stage, missing = find_unfinished(model, before.inactive, before.absent), before.missing
    selected, inactive = points_of(model, chosen) & ~stage.uncast, points_of(model, before.inactive)
    earlier, filled = response, selected & _groutable_points(model, contact, response)
    if pressure:
        before, earlier, filled = _press(model, before, selected, stage, pressure, press)
        response = before.joints
        assert response is not None
    idle = idle_points(response)
    target = np.where(idle[:, None], response.state.gap, 0.0)
    target[filled] = [gap, 0.0, 0.0]
    if pressure:
        target[filled] = _gap_at_pressure(model, contact, filled, pressure)[filled]
    # Remove overlap of adjacent blocks: the later block was cast against the earlier block.
    unfilled = idle & ~filled
    target[unfilled, 0] = np.maximum(target[unfilled, 0], 0.0)
    slip = np.where((filled & ~idle_points(earlier))[:, None], earlier.state.elastic_slip, 0.0)
    reset = _with_pressure(contact, _at_rest(model, contact, target, slip), filled, pressure)
    if gap:
        _check_open(contact, (reset.traction - earlier.traction) * filled[:, None], gap)
    # If the law gives a traction at an open gap (a bond in UFL), the joint stays inactive until it
    # is grouted.
    pull = contact.integrals((unfilled & inactive & ~idle_points(reset)).astype(np.float64))
    areas = zip(model.jointed.joint_names, pull, strict=True)
    remaining = tuple(name for name, area in areas if name not in chosen and area > 0.0)
    activated = idle & inactive & ~points_of(model, remaining)
    joints = _combine(filled | activated, reset, response)
    # The water forces of a grouted joint are those of the opening before grouting. Count their load
    # as missing: a static stage must update it before a dynamic stage.
    named = zip(load_names(model.loads), model.loads, strict=True)
    wet = [n for n, load in named if isinstance(load, FollowsJoints) and load.joint in chosen]
    missing = tuple(sorted({*missing, *wet}))
    energy = with_stored(before.energy, contact.stored_energy(joints.state))
    return replace(
        before, joints=joints, inactive=remaining, missing=missing, energy=energy, jumps=[], cuts=0
    )


def _groutable_points(model: Model, contact: Contact, response: Response) -> Rows:
    """Return True for the joint points of this rank that grout can fill, shape (n,) (collective).

    Grout fills points without traction. It also fills open points whose keys transmit a traction,
    if this traction would be the same at a closed gap.
    """
    gap, slip = response.state.gap, response.state.elastic_slip
    closed, open_ = _at_rest(model, contact, np.zeros_like(gap), slip), gap[:, 0] > 0.0
    change = np.linalg.norm(closed.traction - response.traction, axis=1)
    limit = SAME * contact.closed_stiffness()[:, 0] * np.where(open_, gap[:, 0], 1.0)
    return idle_points(response) | (open_ & (change <= limit))


def _press(
    model: Model,
    before: StaticState,
    selected: Rows,
    stage: Unfinished,
    pressure: float,
    press: Callable[..., StaticState],
) -> tuple[StaticState, Response, Rows]:
    """Return the state under grout pressure, responses before filling, and filled points.

    Grout fills the selected open points, then selected points that the grout pressure opens. The
    response of each point is the last one before the grout fills the point (collective).
    """
    contact, joints = model.contact, before.joints
    assert contact is not None
    assert joints is not None
    earlier: Response = joints
    filled = selected & _groutable_points(model, contact, earlier)
    while True:
        traction = np.where(filled[:, None], earlier.traction, 0.0)
        traction[filled, 0] = -pressure
        state = press(stage=replace(stage, idle=stage.idle | filled), apart=traction)
        assert state.joints is not None
        opened = selected & _groutable_points(model, contact, state.joints) & ~filled
        if not contact.operator.comm.allreduce(int(opened.sum())):
            return state, earlier, filled
        earlier = _combine(opened, state.joints, earlier)
        filled |= opened


def _gap_at_pressure(model: Model, contact: Contact, filled: Rows, pressure: float) -> Floats:
    """Return the gaps at which the joint law gives a pressure [Pa], (n, 3), [m] (collective).

    The filled points have no shear displacement and no history.

    Raises:
        JointsError: A joint law gives this pressure at no gap, or gives it only together with a
            shear traction. The grout cannot balance shear.
    """
    stiffness = contact.closed_stiffness()[:, 0]
    gap, last_error = np.zeros((len(stiffness), 3)), math.inf
    gap[:, 0], follows = -pressure / stiffness, filled & np.isfinite(stiffness)
    for _ in range(MOST_ITERATIONS):
        response = _at_rest(model, contact, gap)
        excess = np.where(follows, response.traction[:, 0] + pressure, 0.0)
        errors = contact.operator.comm.allgather(float(np.abs(excess).max(initial=0.0)))
        if max(errors) <= 1e-6 * pressure and not max(errors) < 0.5 * last_error:
            _check_no_shear(contact, response.traction * filled[:, None], pressure)
            return gap
        last_error, slope = max(errors), response.tangent[:, 0, 0]
        gap[:, 0] -= np.divide(excess, slope, out=np.zeros_like(excess), where=slope != 0.0)
    raise JointsError(
        f"The joints do not reach the grout pressure of {pressure:g} Pa at any gap: the "
        f"last iteration differs by {last_error:.3g} Pa. Grout without pressure."
    )


def _check_no_shear(contact: Contact, traction: Floats, pressure: float) -> None:
    """Check that no joint has a shear traction under a grout pressure [Pa] (collective)."""
    shear = np.linalg.norm(traction[:, 1:], axis=1)
    joint = contact.worst_joint(np.where(shear > 1e-6 * pressure, shear, 0.0))
    if joint is not None:
        raise JointsError(
            f"The joint {joint!r} ({type(contact.laws[joint]).__name__}) has a shear traction "
            f"under {pressure:g} Pa of grout, for example because only one flank of its keys is in "
            "contact. Grout without pressure, or give the keys equal play on both flanks, or more "
            "play than their overlap divided by the tangent of the flank angle."
        )


def _check_open(contact: Contact, traction: Floats, gap: float) -> None:
    """Check that grouted joints have no traction at the gap after grouting [m] (collective)."""
    pull, scale = np.linalg.norm(traction, axis=1), gap * contact.closed_stiffness()[:, 0]
    joint = contact.worst_joint(np.where(pull > SAME * scale, pull, 0.0))
    if joint is not None:
        raise JointsError(
            f"The joint {joint!r} ({type(contact.laws[joint]).__name__}) would have a traction "
            f"at the remaining gap of {gap:g} m, and no force balances it. Grout without a gap."
        )


def _at_rest(model: Model, contact: Contact, gap: Floats, slip: Floats | float = 0.0) -> Response:
    """Return the response to gaps (n, 3) and elastic slips (n, 2) [m] (collective).

    The joint points have no other history.
    """
    zero = model.stiffness.createVecRight()
    zero.set(0.0)
    rest = contact.resting(gap)
    rest = replace(rest, elastic_slip=rest.elastic_slip + slip)
    return contact.respond(zero, rest, BACKWARD_EULER)


def _with_pressure(contact: Contact, response: Response, filled: Rows, pressure: float) -> Response:
    """Return the response with the grout pressure as traction at filled points of rigid joints."""
    rigid = filled & np.isinf(contact.closed_stiffness()[:, 0]) & (pressure > 0.0)
    traction = np.where(rigid[:, None], [-pressure, 0.0, 0.0], response.traction)
    status = np.where(rigid & (response.status == Status.OPEN), Status.STICK, response.status)
    return replace(response, traction=traction, status=status)


def _combine(rows: Rows, new: Any, old: Any) -> Any:
    """Return a response or array with the given rows of ``new`` and the other rows of ``old``."""
    if isinstance(new, np.ndarray):
        if not new.size and not old.size:
            return new
        # A field that a law does not use is empty.
        new, old = (a if a.size else np.zeros_like(b) for a, b in ((new, old), (old, new)))
        return np.where(rows.reshape((-1,) + (1,) * (new.ndim - 1)), new, old)
    parts = [f.name for f in fields(new)]
    return replace(new, **{n: _combine(rows, getattr(new, n), getattr(old, n)) for n in parts})
