# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints that carry nothing until they are grouted, blocks that stand without, and grout."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.errors import JointsError, MeshError
from dolfinx_joints.joints.contact import Contact, no_such_joint
from dolfinx_joints.laws.law import BACKWARD_EULER, Floats, Response, Status
from dolfinx_joints.loads.load import FollowsJoints, JointLoad, Load
from dolfinx_joints.mesh.blocks import block_of_nodes, blocks_of_pairs, connected
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.outcome import StaticState

Rows = NDArray[np.bool_]

# Stiffness against a rigid motion, relative to the sum of the block's own, taken for none.
LOOSE = 1e-12

# Newton iterations that a law may take to the pressure of the grout.
MOST_ITERATIONS = 50


def inactive_joints(model: Model, joints: str | Sequence[str]) -> tuple[str, ...]:
    """Names of the joints that do not act, of those that do: ``active``, ``inactive``, or names.

    Raises:
        MeshError: There is no such joint.
    """
    known = model.jointed.joint_names
    acting = {"active": known, "inactive": ()}.get(joints) if isinstance(joints, str) else joints
    assert acting is not None
    check_joints(model, acting)
    return tuple(name for name in known if name not in acting)


def check_joints(model: Model, names: Sequence[str]) -> None:
    """Check that there are joints of these names."""
    known = model.jointed.joint_names
    for name in names:
        if name not in known:
            raise MeshError(no_such_joint(name, known))


def points_of(contact: Contact, names: Sequence[str]) -> Rows:
    """Which of the local points belong to some joints."""
    numbers = [contact.operator.names.index(name) for name in names]
    return np.isin(contact.operator.joint, numbers)


def idle_points(response: Response) -> Rows:
    """Which of the local points carry nothing."""
    return np.all(response.traction == 0.0, axis=1)


def with_inactive(
    contact: Contact,
    response: Response | None,
    before: StaticState | None,
    u: PETSc.Vec,
    idle: Rows,
) -> Response:
    """The response at a displacement, points that carry nothing being at rest (collective).

    Args:
        contact: All joints.
        response: Of the points that act, None where none does.
        before: The static state that the stage began with, None for zero.
        u: Displacement at its end [m].
        idle: Local points that carried nothing.
    """
    gap = contact.gap(u)
    if before is not None and before.joints is not None:
        moved = u.copy()
        moved.axpy(-1.0, before.displacement)
        gap = before.joints.state.gap + contact.operator.jump(moved)
    count = len(gap)
    rest = Response(
        traction=np.zeros((count, 3)),
        tangent=np.zeros((count, 3, 3)),
        state=contact.resting(gap),
        dissipation=np.zeros(count),
        status=np.full(count, Status.OPEN, dtype=np.int8),
    )
    return rest if response is None else _chosen(idle, rest, response)


def grouted(
    model: Model,
    before: StaticState,
    names: Sequence[str] | None,
    *,
    gap: float = 0.0,
    pressure: float = 0.0,
    pressed: Callable[..., StaticState],
) -> StaticState:
    """A static state with joints grouted; without pressure nothing moves (collective).

    Args:
        model: The model.
        before: The state.
        names: Joints to be grouted; unless given those that are inactive, all if none is.
        gap: Opening that the grout leaves [m].
        pressure: Of the grout, where it finds a point that carries nothing [Pa].
        pressed: The state from ``before`` on, given as ``idle`` the points that carry nothing and as
            ``apart`` tractions that push faces apart, shape (n, 3), [Pa]; see `march`.
    """
    check_joints(model, names or ())
    _check_elastic(model)
    contact, response = model.contact, before.joints
    if contact is None or response is None:
        return replace(before, inactive=())
    if gap and pressure:
        raise ValueError(
            f"gap is {gap:g} m and pressure {pressure:g} Pa; grout under pressure leaves no gap."
        )
    chosen = (before.inactive or model.jointed.joint_names) if names is None else names
    here, inactive = points_of(contact, chosen), points_of(contact, before.inactive)
    filled, missing = here & idle_points(response), before.missing
    if pressure:
        before, filled = _filled(contact, before, here, inactive, pressure, pressed)
        response = before.joints
        assert response is not None
    idle = idle_points(response)
    target = np.where(idle[:, None], response.state.gap, 0.0)
    target[filled] = (
        _gap_under(model, contact, filled, pressure)[filled] if pressure else [gap, 0.0, 0.0]
    )
    # Where cantilevers have moved into each other, one was cast against the other.
    left = idle & ~filled
    target[left, 0] = np.maximum(target[left, 0], 0.0)
    fresh = _bearing(contact, _at_rest(model, contact, target), filled, pressure)
    joints = _chosen(filled | (idle & inactive), fresh, response)
    # Water in a joint that was open is that of an open one until a static stage looks again.
    wet = {
        type(load).__name__
        for load in model.loads
        if isinstance(load, FollowsJoints) and load.joint in chosen
    }
    missing = tuple(sorted({*missing, *wet}))
    return replace(before, joints=joints, inactive=(), missing=missing)


def _filled(
    contact: Contact,
    before: StaticState,
    here: Rows,
    inactive: Rows,
    pressure: float,
    pressed: Callable[..., StaticState],
) -> tuple[StaticState, Rows]:
    """The state under the pressure, and the points it acts in (collective).

    It reaches points that carry nothing, then those that it opens.
    """
    assert before.joints is not None
    filled = here & idle_points(before.joints)
    while True:
        traction = np.zeros((len(here), 3))
        traction[filled, 0] = -pressure
        state = pressed(idle=inactive | filled, apart=traction)
        assert state.joints is not None
        more = here & idle_points(state.joints) & ~filled
        if not contact.operator.comm.allreduce(int(more.sum())):
            return state, filled
        filled |= more


def _gap_under(model: Model, contact: Contact, filled: Rows, pressure: float) -> Floats:
    """Gap at which filled points at rest bear a pressure [Pa], shape (n, 3), [m] (collective).

    Raises:
        JointsError: A law does not come to bear it.
    """
    stiffness = contact.closed_stiffness()[:, 0]
    gap, least = np.zeros((len(stiffness), 3)), math.inf
    gap[:, 0], follows = -pressure / stiffness, filled & np.isfinite(stiffness)
    for _ in range(MOST_ITERATIONS):
        answer = _at_rest(model, contact, gap)
        rest = np.where(follows, answer.traction[:, 0] + pressure, 0.0)
        each = contact.operator.comm.allgather(float(np.abs(rest).max(initial=0.0)))
        if max(each) <= 1e-6 * pressure and not max(each) < 0.5 * least:
            return gap
        least, slope = max(each), answer.tangent[:, 0, 0]
        gap[:, 0] -= np.divide(rest, slope, out=np.zeros_like(rest), where=slope != 0.0)
    raise JointsError(
        f"The joint laws do not come to bear {pressure:g} Pa of grout at any gap: "
        f"{least:.3g} Pa are left; grout without pressure."
    )


def _at_rest(model: Model, contact: Contact, gap: Floats) -> Response:
    """Answer of the laws to a gap, shape (n, 3), [m], without any history (collective)."""
    still = model.stiffness.createVecRight()
    still.set(0.0)
    return contact.respond(still, contact.resting(gap), BACKWARD_EULER)


def _bearing(contact: Contact, answer: Response, filled: Rows, pressure: float) -> Response:
    """The answer with the pressure in rigid points, where it does not follow from the gap."""
    rigid = filled & np.isinf(contact.closed_stiffness()[:, 0]) & (pressure > 0.0)
    traction = np.where(rigid[:, None], [-pressure, 0.0, 0.0], answer.traction)
    status = np.where(rigid, np.int8(Status.STICK), answer.status)
    return replace(answer, traction=traction, status=status)


def _chosen(rows: Rows, one: Any, other: Any) -> Any:
    """Rows of one response, state or array, the others of another."""
    if isinstance(one, np.ndarray):
        shape = (-1,) + (1,) * (one.ndim - 1)
        return np.where(rows.reshape(shape), one, other) if one.size else one
    parts = [f.name for f in fields(one)]
    return replace(one, **{n: _chosen(rows, getattr(one, n), getattr(other, n)) for n in parts})


def check_may_be_inactive(
    model: Model, before: StaticState | None, acting: Sequence[Load], names: Sequence[str]
) -> None:
    """Check that joints may be inactive: idle, and blocks stand without them (collective)."""
    _check_elastic(model)
    for load in acting:
        if isinstance(load, JointLoad) and load.joint in names:
            raise JointsError(
                f"{type(load).__name__} acts in the joint {load.joint!r}, which is inactive; leave "
                "it out of statics(loads=...) until the joint is grouted."
            )
    if model.contact is not None and before is not None and before.joints is not None:
        carrying = model.contact.integrals(1.0 - idle_points(before.joints))
        for name, area in zip(model.jointed.joint_names, carrying, strict=True):
            if name in names and area > 0.0:
                raise JointsError(
                    f"The joint {name!r} cannot become inactive: the last static stage left "
                    "tractions in it."
                )
    check_blocks_stand(model, names)


def check_grouted(static: StaticState | None, inactive: Sequence[str] = ()) -> None:
    """Check that joints act that are not to be inactive any more."""
    waking = [n for n in (static.inactive if static else ()) if n not in inactive]
    if waking:
        raise JointsError(
            f"The joints are still inactive: {', '.join(waking)}; call grout() to close them, "
            "grout([]) to leave all of them open by what their blocks have moved apart."
        )


def _check_elastic(model: Model) -> None:
    """Check for plastic cells, whose state the joints' responses would have to hold."""
    if model.bulk is not None:
        raise JointsError("Joints of a body with plastic cells cannot be inactive, nor grouted.")


def check_blocks_stand(model: Model, inactive: Sequence[str]) -> None:
    """Check that no block would move if some joints carried nothing (collective).

    Joints that act are taken to hold what they join.
    """
    comm, nodes = model.jointed.mesh.comm, NodeNumbering(model.V)
    block = block_of_nodes(nodes)
    count = comm.allreduce(int(block.max(initial=-1)), MPI.MAX) + 1
    pairs, names = model.jointed.pairs, model.jointed.joint_names
    acts = np.isin(pairs.joint, [i for i, name in enumerate(names) if name not in inactive])
    held = blocks_of_pairs(nodes, pairs, block)[acts]
    part = connected(held[:, 0], held[:, 1], count)
    owned = model.V.dofmap.index_map.size_local
    points = model.V.tabulate_dof_coordinates()[:owned, : model.gdim]
    stiffness, centres = _against_rigid_motions(
        model, part[block[:owned]], points, int(part.max()) + 1
    )
    by = "supports and the joints that act" if acts.any() else "supports alone"
    for each, centre in zip(stiffness, centres, strict=True):
        motions = each.shape[0]
        supported = int((np.linalg.eigvalsh(each) > LOOSE).sum())
        if supported < motions:
            place = ", ".join(f"{c:.4g}" for c in centre)
            raise JointsError(
                f"The block around ({place}) m is restrained by its {by} against "
                f"{supported} of {motions} rigid motions; while joints are inactive each block "
                "must stand by itself: give it a support, or let a joint act that it rests on."
            )


def _against_rigid_motions(
    model: Model, block: NDArray[np.int64], points: Floats, count: int
) -> tuple[Floats, Floats]:
    """Stiffness of springs and supports against rigid motions of blocks, and centres (collective).

    Returns:
        Matrices over the rigid motions, shape (blocks, motions, motions), relative to the
        stiffness of the block; centres, shape (blocks, gdim), [m].
    """
    comm, gdim = model.jointed.mesh.comm, model.gdim

    def total(values: Floats) -> Floats:
        """Sum of values of the owned nodes over each block."""
        sums = np.zeros((count, *values.shape[1:]))
        np.add.at(sums, block, values)
        return np.asarray(np.sum(comm.allgather(sums), axis=0))

    numbers = total(np.ones(len(block)))
    centres = total(points) / numbers[:, None]
    arms = points - centres[block]
    size = np.sqrt(total((arms**2).sum(axis=1)) / numbers)
    motions = _rigid_motions(arms / size[block][:, None])
    fixed = np.zeros(len(block) * gdim)
    fixed[model.constraints.static_dofs] = 1.0
    fixed = fixed.reshape(-1, gdim)
    diagonal = model.stiffness.getDiagonal().getArray(readonly=True).reshape(-1, gdim)
    moved, forces = model.stiffness.createVecRight(), []
    for motion in motions:
        moved.setArray(motion.ravel())
        forces.append((model.stiffness * moved).getArray().reshape(-1, gdim).copy())
    springs = np.einsum("anc,bnc->nab", motions, forces)
    supports = np.einsum("anc,bnc,nc->nab", motions, motions, fixed)
    weight = total(diagonal.sum(axis=1))[:, None, None]
    return total(springs) / weight + total(supports) / numbers[:, None, None], centres


def _rigid_motions(arms: Floats) -> Floats:
    """Displacements of translations and rotations, shape (motions, n, gdim)."""
    count, gdim = arms.shape
    motions = [np.tile(np.eye(gdim)[axis], (count, 1)) for axis in range(gdim)]
    for a, b in ((0, 1), (1, 2), (0, 2))[: 1 if gdim == 2 else 3]:
        turned = np.zeros((count, gdim))
        turned[:, a], turned[:, b] = -arms[:, b], arms[:, a]
        motions.append(turned)
    return np.stack(motions)
