# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inactive joints and absent blocks of a static stage; check of the supports of blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import JointsError, MeshError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.loads.load import JointLoad, Load
from dolfinx_joints.mesh.blocks import block_of_nodes, blocks_of_pairs, connected
from dolfinx_joints.mesh.joint_pairs import no_such_joint
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.outcome import StaticState

Rows = NDArray[np.bool_]

# Smallest stiffness that restrains a rigid motion, divided by the total stiffness of the block.
FREE = 1e-12


@dataclass(frozen=True, kw_only=True)
class Unfinished:
    """Joints and blocks that do not act yet in a static stage.

    Attributes:
        inactive: Names of the inactive joints, which have no tractions.
        absent: Cell groups of the absent blocks.
        idle: True at local joint points of inactive joints or next to absent blocks, shape (n,).
        uncast: True at local joint points next to an absent block, shape (n,).
        dofs: Owned dofs of absent blocks, local numbers.
    """

    inactive: tuple[str, ...]
    absent: tuple[str, ...]
    idle: Rows
    uncast: Rows
    dofs: NDArray[np.int64]


def find_unfinished(model: Model, inactive: Sequence[str], absent: Sequence[str]) -> Unfinished:
    """Return the points and dofs of inactive joints and absent blocks (collective).

    Raises:
        MeshError: A cell group does not exist, or contains only a part of a block.
    """
    operator, owned = model.operator, model.V.dofmap.index_map.size_local
    of_joint = points_of(model, inactive)
    uncast = np.zeros_like(of_joint)
    dofs: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    if absent:
        blocks = _Blocks(model, absent)
        dofs = np.flatnonzero(np.repeat(blocks.absent[blocks.of_node[:owned]], model.gdim))
        if operator is not None:
            beside = blocks.beside_absent[:, None].astype(np.int64)
            uncast = operator.layout.from_facets(operator.comm, beside)[:, 0] > 0
    return Unfinished(
        inactive=tuple(inactive),
        absent=tuple(absent),
        idle=of_joint | uncast,
        uncast=uncast,
        dofs=dofs,
    )


def unfinished_stage(
    model: Model,
    before: StaticState,
    joints: str | Sequence[str],
    absent: Sequence[str],
    acting: Sequence[Load],
) -> Unfinished | None:
    """Return inactive joints and absent blocks of a stage, None if everything acts (collective).

    See `Simulation.statics` for the arguments. Also check that the stage can follow the last one.

    Raises:
        MeshError: A joint does not exist.
    """
    names = model.jointed.joint_names
    active = {"active": names, "inactive": ()}.get(joints) if isinstance(joints, str) else joints
    assert active is not None
    check_joints(model, active)
    inactive = tuple(name for name in names if name not in active)
    check_grouted(before, inactive)
    if not (inactive or absent or joints == "inactive"):
        return None
    stage = find_unfinished(model, inactive, absent)
    check_may_begin(model, before, acting, stage)
    return stage


class _Blocks:
    """Blocks of a model, some of which are absent (collective).

    Attributes:
        of_node: Block of each local node.
        of_pair: Blocks on the - and + side of each facet pair of this rank, shape (pairs, 2).
        absent: True for absent blocks.
        beside_absent: True for facet pairs with an absent block on one or both sides.
    """

    def __init__(self, model: Model, absent: Sequence[str]) -> None:
        comm, nodes = model.jointed.mesh.comm, NodeNumbering(model.V)
        self.of_node = block_of_nodes(nodes)
        self.of_pair = blocks_of_pairs(nodes, model.jointed.pairs, self.of_node)
        of_cell = self.of_node[model.V.dofmap.list[:, 0]]
        count = comm.allreduce(int(self.of_node.max(initial=-1)), MPI.MAX) + 1
        self.absent: Rows = np.zeros(count, dtype=bool)
        for name in absent:
            cells = model.jointed.cells(name)
            inside, outside = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
            inside[of_cell[cells]] = 1
            outside[np.delete(of_cell, cells)] = 1
            inside, outside = (sum(comm.allgather(counts)) for counts in (inside, outside))
            if (inside * outside).any():
                raise MeshError(
                    f"The cell group {name!r} contains only a part of a block: absent= needs whole "
                    "blocks, which joints separate from each other."
                )
            self.absent[np.flatnonzero(inside)] = True
        if self.absent.all():
            given = shown(list(absent))
            raise MeshError(f"absent is {given}, which are all blocks; at least one must exist.")
        minus, plus = self.of_pair.T
        self.beside_absent: Rows = self.absent[minus] | self.absent[plus]


def check_joints(model: Model, names: Sequence[str]) -> None:
    """Check that joints of these names exist."""
    joint_names = model.jointed.joint_names
    for name in names:
        if name not in joint_names:
            raise MeshError(no_such_joint(name, joint_names))


def points_of(model: Model, names: Sequence[str]) -> Rows:
    """Return a mask of the local joint points of the named joints, shape (n,)."""
    operator = model.operator
    if operator is None:
        return np.zeros(0, dtype=bool)
    return np.isin(operator.joint, [operator.names.index(name) for name in names])


def idle_points(response: Response) -> Rows:
    """Return a mask of the local points without traction, shape (n,)."""
    return np.all(response.traction == 0.0, axis=1)


def check_may_begin(
    model: Model, before: StaticState, acting: Sequence[Load], stage: Unfinished
) -> None:
    """Check that joints to be inactive have no tractions and blocks have supports (collective)."""
    check_elastic(model)
    removed = sorted(set(stage.absent) - set(before.absent))
    if removed and not before.unloaded:
        raise JointsError(
            f"The block {removed[0]!r} cannot be absent: it was present in the last stage."
        )
    for load in acting:
        if isinstance(load, JointLoad) and load.joint in stage.inactive:
            raise JointsError(
                f"{type(load).__name__} acts in the joint {load.joint!r}, which is inactive; omit "
                "it from statics(loads=...) until the joint is grouted."
            )
    if model.contact is not None and before.joints is not None:
        carrying = model.contact.integrals((~idle_points(before.joints)).astype(np.float64))
        for name, area in zip(model.jointed.joint_names, carrying, strict=True):
            if name in stage.inactive and area > 0.0:
                raise JointsError(
                    f"The joint {name!r} cannot become inactive: it has tractions at the end of "
                    "the last static stage."
                )
    check_blocks_restrained(model, stage)


def check_grouted(static: StaticState | None, inactive: Sequence[str] = ()) -> None:
    """Check that all joints are active, except the given joints."""
    ungrouted = [n for n in (static.inactive if static else ()) if n not in inactive]
    if ungrouted:
        raise JointsError(
            f"These joints are still inactive: {', '.join(ungrouted)}; call grout() to close them. "
            "grout([]) activates them with their present openings, unless their laws give "
            "tractions at an opening."
        )


def check_elastic(model: Model) -> None:
    """Check that no cells are nonlinear: stages of construction do not store their state."""
    if model.bulk is not None:
        raise JointsError(
            "A body with nonlinear cells cannot have inactive or grouted joints, or absent blocks."
        )


def check_blocks_restrained(model: Model, stage: Unfinished) -> None:
    """Check that supports and active joints restrain every block (collective).

    Blocks connected by active joints are treated as one.
    """
    blocks, names = _Blocks(model, stage.absent), model.jointed.joint_names
    acting = [i for i, name in enumerate(names) if name not in stage.inactive]
    acts = np.isin(model.jointed.pairs.joint, acting) & ~blocks.beside_absent
    local = np.unique(blocks.of_pair[acts], axis=0)
    joined = np.concatenate(model.jointed.mesh.comm.allgather(local))
    part = connected(joined[:, 0], joined[:, 1], len(blocks.absent))
    owned = model.V.dofmap.index_map.size_local
    stiffness, centres = _against_rigid_motions(
        model, part[blocks.of_node[:owned]], stage.dofs, int(part.max()) + 1
    )
    restraints = "supports and active joints" if len(joined) else "supports only"
    motions = stiffness.shape[1]
    for i in range(len(centres)):
        supported = int((np.linalg.eigvalsh(stiffness[i]) > FREE).sum())
        if supported < motions:
            place = ", ".join(f"{c:.4g}" for c in centres[i])
            raise JointsError(
                f"The block around ({place}) m is restrained by {restraints}, which prevent "
                f"{supported} of {motions} rigid motions. With inactive joints each block needs "
                "sufficient supports or active joints: add a support, activate a joint, or list "
                "the block in absent=."
            )


def _against_rigid_motions(
    model: Model, part: NDArray[np.int64], fixed_dofs: NDArray[np.int64], count: int
) -> tuple[Floats, Floats]:
    """Return the stiffness against rigid motions of parts, and their centres (collective).

    ``part`` is the part of each owned node; ``fixed_dofs`` are owned dofs constrained in addition
    to supported dofs. The stiffness of springs and supports, shape (parts, motions, motions), is
    divided by the stiffness of the part; the centres have shape (parts, gdim), [m].
    """
    comm, gdim = model.jointed.mesh.comm, model.gdim

    def total(values: Floats) -> Floats:
        """Return the sums over each part of values at the owned nodes."""
        sums = np.zeros((count, *values.shape[1:]))
        np.add.at(sums, part, values)
        return np.asarray(np.sum(comm.allgather(sums), axis=0))

    points = model.V.tabulate_dof_coordinates()[: len(part), :gdim]
    numbers = total(np.ones(len(part)))
    centres = total(points) / numbers[:, None]
    arms = points - centres[part]
    size = np.sqrt(total((arms**2).sum(axis=1)) / numbers)
    motions = _rigid_motions(arms / size[part][:, None])
    fixed = np.zeros(len(part) * gdim)
    fixed[model.constraints.static_dofs] = fixed[fixed_dofs] = 1.0
    fixed = fixed.reshape(-1, gdim)
    diagonal = model.stiffness.getDiagonal().getArray(readonly=True).reshape(-1, gdim)
    displacement, forces = model.stiffness.createVecRight(), []
    for motion in motions:
        displacement.setArray(motion.ravel())
        forces.append((model.stiffness * displacement).getArray().reshape(-1, gdim).copy())
    springs = np.einsum("anc,bnc->nab", motions, forces)
    supports = np.einsum("anc,bnc,nc->nab", motions, motions, fixed)
    weight = total(diagonal.sum(axis=1))[:, None, None]
    return total(springs) / weight + total(supports) / numbers[:, None, None], centres


def _rigid_motions(arms: Floats) -> Floats:
    """Return displacements of translations and rotations, shape (motions, n, gdim)."""
    count, gdim = arms.shape
    motions = [np.tile(np.eye(gdim)[axis], (count, 1)) for axis in range(gdim)]
    for a, b in ((0, 1), (1, 2), (0, 2))[: 1 if gdim == 2 else 3]:
        rotation = np.zeros((count, gdim))
        rotation[:, a], rotation[:, b] = -arms[:, b], arms[:, a]
        motions.append(rotation)
    return np.stack(motions)
