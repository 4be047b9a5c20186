# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints that carry nothing until they are grouted, blocks that stand without, and grout."""

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
from dolfinx_joints.simulation.statics.stage_start import carrying_nothing
from dolfinx_joints.simulation.statics.unfinished import (
    Rows,
    Unfinished,
    check_elastic,
    check_joints,
    idle_points,
    points_of,
    unfinished,
)

# Newton iterations that a law may take to the pressure of the grout.
MOST_ITERATIONS = 50

# Traction over k_n times the opening, that is taken for none.
SAME = 1e-9


def with_inactive(
    contact: Contact,
    response: Response | None,
    before: StaticState,
    u: PETSc.Vec,
    stage: Unfinished,
) -> Response:
    """Return the response at a displacement [m], points that carry nothing at rest (collective).

    Of all joints ``response`` has the points that act, None where none does; ``before`` is the
    start of the stage. Absent blocks will be cast against what is there.
    """
    gap = contact.gap(u)
    if before.joints is not None:
        moved = u.copy()
        moved.axpy(-1.0, before.displacement)
        gap = before.joints.state.gap + contact.operator.jump(moved)
    gap[stage.uncast] = contact.initial_gap[stage.uncast]
    rest = carrying_nothing(contact.resting(gap))
    return rest if response is None else _chosen(stage.idle, rest, response)


def grouted(
    model: Model,
    before: StaticState,
    names: Sequence[str] | None,
    *,
    gap: float,
    pressure: float,
    pressed: Callable[..., StaticState],
) -> StaticState:
    """Return a static state with joints grouted; without pressure nothing moves (collective).

    Arguments are those of `Simulation.grout`. ``pressed`` returns the state from ``before`` on,
    given what does not act as ``stage`` and the tractions that push faces apart as ``apart``, see
    `march`.
    """
    check_joints(model, names or ())
    check_elastic(model)
    contact, response = model.contact, before.joints
    if contact is None or response is None:
        return replace(before, inactive=())
    if gap and pressure:
        raise ValueError(
            f"gap is {gap:g} m and pressure {pressure:g} Pa; grout under pressure leaves no gap."
        )
    warn_of_grout(model.jointed.mesh.comm, pressure)
    chosen = (before.inactive or model.jointed.joint_names) if names is None else names
    stage, missing = unfinished(model, before.inactive, before.absent), before.missing
    here, inactive = points_of(model, chosen) & ~stage.uncast, points_of(model, before.inactive)
    held, filled = response, here & _open_points(model, contact, response)
    if pressure:
        before, held, filled = _filled(model, before, here, stage, pressure, pressed)
        response = before.joints
        assert response is not None
    idle = idle_points(response)
    target = np.where(idle[:, None], response.state.gap, 0.0)
    target[filled] = [gap, 0.0, 0.0]
    if pressure:
        target[filled] = _gap_under(model, contact, filled, pressure)[filled]
    # Where cantilevers have moved into each other, one was cast against the other.
    left = idle & ~filled
    target[left, 0] = np.maximum(target[left, 0], 0.0)
    slip = np.where((filled & ~idle_points(held))[:, None], held.state.elastic_slip, 0.0)
    fresh = _bearing(contact, _at_rest(model, contact, target, slip), filled, pressure)
    if gap:
        _check_open(contact, (fresh.traction - held.traction) * filled[:, None], gap)
    # Laws that pull across a gap, such as bonds in UFL: nothing holds there before the grout.
    pull = contact.integrals((left & inactive & ~idle_points(fresh)).astype(np.float64))
    areas = zip(model.jointed.joint_names, pull, strict=True)
    waiting = tuple(name for name, area in areas if name not in chosen and area > 0.0)
    woken = idle & inactive & ~points_of(model, waiting)
    joints = _chosen(filled | woken, fresh, response)
    # Water in a joint that was open is that of an open one until a static stage looks again.
    named = zip(load_names(model.loads), model.loads, strict=True)
    wet = [n for n, load in named if isinstance(load, FollowsJoints) and load.joint in chosen]
    missing = tuple(sorted({*missing, *wet}))
    energy = with_stored(before.energy, contact.stored_energy(joints.state))
    return replace(
        before, joints=joints, inactive=waiting, missing=missing, energy=energy, jumps=[], cuts=0
    )


def _open_points(model: Model, contact: Contact, response: Response) -> Rows:
    """Which local points grout reaches (collective).

    They carry nothing, or keys that hold them open bear the same when the joint is closed.
    """
    gap, slip = response.state.gap, response.state.elastic_slip
    closed, open_ = _at_rest(model, contact, np.zeros_like(gap), slip), gap[:, 0] > 0.0
    off = np.linalg.norm(closed.traction - response.traction, axis=1)
    least = SAME * contact.closed_stiffness()[:, 0] * np.where(open_, gap[:, 0], 1.0)
    return idle_points(response) | (open_ & (off <= least))


def _filled(
    model: Model,
    before: StaticState,
    here: Rows,
    stage: Unfinished,
    pressure: float,
    pressed: Callable[..., StaticState],
) -> tuple[StaticState, Response, Rows]:
    """The state under the pressure, what points bore before, those it acts in (collective).

    It reaches points that are open, then those that it opens.
    """
    contact, joints = model.contact, before.joints
    assert contact is not None
    assert joints is not None
    held: Response = joints
    filled = here & _open_points(model, contact, held)
    while True:
        traction = np.where(filled[:, None], held.traction, 0.0)
        traction[filled, 0] = -pressure
        state = pressed(stage=replace(stage, idle=stage.idle | filled), apart=traction)
        assert state.joints is not None
        more = here & _open_points(model, contact, state.joints) & ~filled
        if not contact.operator.comm.allreduce(int(more.sum())):
            return state, held, filled
        held = _chosen(more, state.joints, held)
        filled |= more


def _gap_under(model: Model, contact: Contact, filled: Rows, pressure: float) -> Floats:
    """Gap at which filled points at rest bear a pressure [Pa], shape (n, 3), [m] (collective).

    Raises:
        JointsError: A law does not come to bear it, or bears it with shear, which would be out of
            balance.
    """
    stiffness = contact.closed_stiffness()[:, 0]
    gap, least = np.zeros((len(stiffness), 3)), math.inf
    gap[:, 0], follows = -pressure / stiffness, filled & np.isfinite(stiffness)
    for _ in range(MOST_ITERATIONS):
        answer = _at_rest(model, contact, gap)
        rest = np.where(follows, answer.traction[:, 0] + pressure, 0.0)
        each = contact.operator.comm.allgather(float(np.abs(rest).max(initial=0.0)))
        if max(each) <= 1e-6 * pressure and not max(each) < 0.5 * least:
            _check_no_shear(contact, answer.traction * filled[:, None], pressure)
            return gap
        least, slope = max(each), answer.tangent[:, 0, 0]
        gap[:, 0] -= np.divide(rest, slope, out=np.zeros_like(rest), where=slope != 0.0)
    raise JointsError(
        f"The joint laws do not come to bear {pressure:g} Pa of grout at any gap: "
        f"{least:.3g} Pa are left; grout without pressure."
    )


def _check_no_shear(contact: Contact, traction: Floats, pressure: float) -> None:
    """Check that no law answers with shear to a pressure [Pa] (collective)."""
    shear = np.linalg.norm(traction[:, 1:], axis=1)
    joint = contact.worst_joint(np.where(shear > 1e-6 * pressure, shear, 0.0))
    if joint is not None:
        raise JointsError(
            f"The {type(contact.laws[joint]).__name__} of {joint!r} answers to {pressure:g} Pa of "
            "grout with shear, as keys whose flanks touch on one side do: grout without pressure, "
            "or give both flanks the same play, or each more than the overlap / tan(alpha)."
        )


def _check_open(contact: Contact, traction: Floats, gap: float) -> None:
    """Check that no law pulls across the gap that grout leaves [m] (collective)."""
    pull, most = np.linalg.norm(traction, axis=1), gap * contact.closed_stiffness()[:, 0]
    joint = contact.worst_joint(np.where(pull > SAME * most, pull, 0.0))
    if joint is not None:
        raise JointsError(
            f"The {type(contact.laws[joint]).__name__} of {joint!r} pulls across the gap of "
            f"{gap:g} m that the grout would leave, out of balance; grout without a gap."
        )


def _at_rest(model: Model, contact: Contact, gap: Floats, slip: Floats | float = 0.0) -> Response:
    """Return the response to a gap (n, 3) and an elastic slip (n, 2), [m], without other history.

    (Collective.)
    """
    still = model.stiffness.createVecRight()
    still.set(0.0)
    rest = contact.resting(gap)
    rest = replace(rest, elastic_slip=rest.elastic_slip + slip)
    return contact.respond(still, rest, BACKWARD_EULER)


def _bearing(contact: Contact, answer: Response, filled: Rows, pressure: float) -> Response:
    """Return the response with the pressure in rigid points, whose gap does not determine it."""
    rigid = filled & np.isinf(contact.closed_stiffness()[:, 0]) & (pressure > 0.0)
    traction = np.where(rigid[:, None], [-pressure, 0.0, 0.0], answer.traction)
    status = np.where(rigid & (answer.status == Status.OPEN), Status.STICK, answer.status)
    return replace(answer, traction=traction, status=status)


def _chosen(rows: Rows, one: Any, other: Any) -> Any:
    """Rows of one response, state or array, the others of another."""
    if isinstance(one, np.ndarray):
        if not one.size and not other.size:
            return one
        # A field that a law does not keep is empty.
        one, other = (a if a.size else np.zeros_like(b) for a, b in ((one, other), (other, one)))
        return np.where(rows.reshape((-1,) + (1,) * (one.ndim - 1)), one, other)
    parts = [f.name for f in fields(one)]
    return replace(one, **{n: _chosen(rows, getattr(one, n), getattr(other, n)) for n in parts})
