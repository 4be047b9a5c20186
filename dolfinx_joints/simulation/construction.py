# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks that stand alone before their joints are grouted, and what grout leaves."""

from __future__ import annotations

from collections.abc import Sequence
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
from dolfinx_joints.mesh.blocks import block_of_nodes
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.outcome import StaticState

Rows = NDArray[np.bool_]

# Stiffness against a rigid motion, relative to the sum of the block's own, taken for none.
LOOSE = 1e-12


def inactive_response(contact: Contact, u: PETSc.Vec) -> Response:
    """Joints that carry nothing at the displacement ``u`` (collective)."""
    state = contact.at_rest(u)
    count = len(state.gap)
    return Response(
        traction=np.zeros((count, 3)),
        tangent=np.zeros((count, 3, 3)),
        state=state,
        dissipation=np.zeros(count),
        status=np.full(count, Status.OPEN, dtype=np.int8),
    )


def grouted(
    model: Model, before: StaticState, names: Sequence[str] | None, gap: float
) -> StaticState:
    """A static state with its joints grouted; displacements and forces stay (collective).

    All joints are grouted unless ``names`` are given; the grout leaves the opening ``gap`` [m].
    """
    known = model.jointed.joint_names
    for name in names or ():
        if name not in known:
            raise MeshError(no_such_joint(name, known))
    _check_elastic(model)
    contact, response = model.contact, before.joints
    if contact is None or response is None:
        return replace(before, joints_inactive=False)
    chosen = known if names is None else names
    here = np.isin(contact.operator.joint, [known.index(name) for name in chosen])
    idle: Rows = np.all(response.traction == 0.0, axis=1)
    target = np.where(idle[:, None], response.state.gap, 0.0)
    target[idle & here] = [gap, 0.0, 0.0]
    # Where cantilevers have moved into each other, one was cast against the other.
    target[idle & ~here, 0] = np.maximum(target[idle & ~here, 0], 0.0)
    still = before.displacement.duplicate()
    still.set(0.0)
    fresh = contact.respond(still, contact.resting(target), BACKWARD_EULER)
    joints = _chosen(idle if before.joints_inactive else idle & here, fresh, response)
    # Water in a joint that was open is that of an open one until a static stage looks again.
    wet = {
        type(load).__name__
        for load in model.loads
        if isinstance(load, FollowsJoints) and load.joint in chosen
    }
    missing = tuple(sorted({*before.missing, *wet}))
    return replace(before, joints=joints, joints_inactive=False, missing=missing)


def _chosen(rows: Rows, one: Any, other: Any) -> Any:
    """Rows of one response, state or array, the others of another."""
    if isinstance(one, np.ndarray):
        shape = (-1,) + (1,) * (one.ndim - 1)
        return np.where(rows.reshape(shape), one, other) if one.size else one
    parts = [f.name for f in fields(one)]
    return replace(one, **{n: _chosen(rows, getattr(one, n), getattr(other, n)) for n in parts})


def check_may_be_inactive(model: Model, before: StaticState | None, acting: Sequence[Load]) -> None:
    """Check that joints may be inactive: new, and blocks stand without them (collective)."""
    _check_elastic(model)
    for load in acting:
        if isinstance(load, JointLoad):
            raise JointsError(
                f"{type(load).__name__} acts in the joint {load.joint!r}, which is inactive; leave "
                "it out of statics(loads=...) until the joints are grouted."
            )
    if before is not None and not before.joints_inactive:
        raise JointsError(
            "Joints cannot become inactive again: the last static stage left them active."
        )
    if before is None:
        check_blocks_stand(model)


def _check_elastic(model: Model) -> None:
    """Check for plastic cells, whose state the joints' responses would have to hold."""
    if model.bulk is not None:
        raise JointsError("Joints of a body with plastic cells cannot be inactive, nor grouted.")


def check_blocks_stand(model: Model) -> None:
    """Check that no block would move if its joints carried nothing (collective)."""
    comm, block = model.jointed.mesh.comm, block_of_nodes(NodeNumbering(model.V))
    owned = model.V.dofmap.index_map.size_local
    points = model.V.tabulate_dof_coordinates()[:owned, : model.gdim]
    count = comm.allreduce(int(block.max(initial=-1)), MPI.MAX) + 1
    stiffness, centres = _against_rigid_motions(model, block[:owned], points, count)
    for i in range(count):
        motions = stiffness.shape[1]
        supported = int((np.linalg.eigvalsh(stiffness[i]) > LOOSE).sum())
        if supported < motions:
            place = ", ".join(f"{c:.4g}" for c in centres[i])
            raise JointsError(
                f"The block around ({place}) m is restrained by its supports alone against "
                f"{supported} of {motions} rigid motions; while joints are inactive each block "
                "must stand by itself: give it a support, or keep the joints active."
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
