# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resultants of joints and of the blocks between them, computed during a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import Response, variables_of
from dolfinx_joints.mesh.blocks import block_of_nodes, blocks_of_pairs
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.joint_rows import JointRows
from dolfinx_joints.postprocessing.joints.resultants import (
    JointGeometry,
    JointResultants,
    forces_of,
)
from dolfinx_joints.results.quantities import JointPoints
from dolfinx_joints.results.writer import ResultsWriter

# Rows of the sums over the points of a joint, by attribute of `JointResultants`.
_COLUMNS: dict[str, Any] = {"force": slice(0, 3), "moment": slice(3, 6), "contact": 6}
_COLUMNS |= {"compression": 7, "shear_sum": 8, "bond": 9}
_WATER = {"water_force": slice(10, 13), "water_moment": slice(13, 16)}


def strengths(contact: Contact) -> dict[str, dict[str, Any]]:
    """Return kind, friction angle [degrees] and cohesion [Pa] of each joint's law, for metadata.

    For a law without these parameters the angle is None and the cohesion is zero. For an adhesion,
    which does not break, ``adheres`` is true.
    """
    parameters = {}
    for joint, law in contact.laws.items():
        inner = getattr(law, "law", law)  # A law with dashpots contains another law.
        parameters[joint] = {
            "kind": type(law).__name__,
            "friction_angle_deg": getattr(inner, "friction_angle_deg", None),
            "cohesion": getattr(inner, "cohesion", 0.0),
        }
        if adhesion := getattr(inner, "adhesion", 0.0):
            parameters[joint] |= {"cohesion": adhesion, "adheres": True}
    return parameters


def breakable_joints(contact: Contact) -> tuple[str, ...]:
    """Return the names of the joints with cohesion and breakable bonds."""
    laws = strengths(contact)
    return tuple(
        joint
        for joint, law in contact.laws.items()
        if laws[joint]["cohesion"] > 0.0 and "broken" in variables_of(law)
    )


def broken_shares(contact: Contact, joints: Response) -> Floats:
    """Return the lost share of the cohesion of local points, 1 at broken bonds, shape (n,)."""
    lost, names = np.zeros(len(joints.traction)), contact.operator.names
    for joint in breakable_joints(contact):
        law = contact.laws[joint]
        of_joint = contact.operator.joint == names.index(joint)
        internal = joints.state.internal[of_joint]
        broken = internal[:, variables_of(law).index("broken")] != 0.0
        share = getattr(getattr(law, "law", law), "cohesion_share", None)
        lost[of_joint] = broken if share is None else 1.0 - share(internal)
    return lost


class JointForces:
    """Resultants of the joints of a model, for any state of the joints.

    Attributes:
        names: Names of the joints.
        geometry: Centroid, mean normal, area and flatness of each joint.
        areas: Areas of the local points, zero at tied points, shape (n,), [m^2].
        free_area: Sum of the areas over each joint, shape (joints,), [m^2].
        local_sums: Function that sums values of local points (..., n) to (..., joints).
        bonded: Names of the joints with cohesion or adhesion that acts.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> state = dj.Simulation(model).statics()
        >>> forces = dj.JointForces(model)(state.joints)["joint_1"]
        >>> round(forces.normal_force)  # weight of the upper block, 1 m^3 * 2400 * 9.80665 [N]
        23536
    """

    def __init__(self, model: Model) -> None:
        """Compute the geometry of the joints (collective)."""
        if model.operator is None or model.contact is None:
            raise MeshError("The model has no joints, so there are no resultants of joints.")
        self._operator, self._contact = model.operator, model.contact
        self.names = model.operator.names
        normals, areas = model.operator.frames[:, 0], model.operator.areas[:, None]
        free = np.where(model.contact.tied, 0.0, model.operator.areas)
        self.local_sums = _sums_of_groups(model.operator.joint, len(self.names), np.ones(len(free)))
        geometry = [areas, areas * model.operator.points, areas * normals, free[:, None]]
        sums = summed(self._operator.comm, self.local_sums(np.hstack(geometry).T).T)
        self.geometry = [JointGeometry.from_sums(row[0], row[1:4], row[4:7]) for row in sums]
        self.areas, self.free_area = free, sums[:, 7]  # tied points have no traction
        centroids = np.array([g.centroid for g in self.geometry])
        self._arms = model.operator.points - centroids[model.operator.joint]
        self._laws = strengths(model.contact)
        breakable = breakable_joints(model.contact)
        self.bonded = {*breakable, *(name for name in self.names if "adheres" in self._laws[name])}
        cohesion = [self._laws[name]["cohesion"] * (name in self.bonded) for name in self.names]
        self._cohesion = np.array(cohesion)[self._operator.joint]
        self._bonds = bool(breakable)

    def __call__(
        self, joints: Response, pressure: Floats | None = None
    ) -> dict[str, JointResultants]:
        """Return the resultants by joint, equal on all ranks (collective).

        Args:
            joints: Response of the joints, such as ``StaticState.joints`` or ``Record.joints``.
            pressure: Water pressure at the local joint points, shape (n,), [Pa], such as
                ``simulation.stages[-1].pressure``; without it the water forces are None.
        """
        gap, resultants = joints.state.gap, {}
        points = JointPoints(gap, gap[:, 1:], joints.traction, self.cohesion(joints))
        values = self.values(points, pressure)
        for i, (name, geometry) in enumerate(zip(self.names, self.geometry, strict=True)):
            angle = self._laws[name]["friction_angle_deg"]
            friction = np.nan if angle is None else float(np.tan(np.deg2rad(angle)))
            parts = {part: of_joints[i] for part, of_joints in values.items()}
            resultants[name] = JointResultants(
                joint=name, time=None, geometry=geometry, friction=friction, **parts
            )
        return resultants

    def values(self, points: JointPoints, pressure: Floats | None) -> dict[str, Floats]:
        """Return the attributes of `JointResultants` by name, shape (joints, ...) (collective)."""
        parts = [*_with_moments(self.forces(points.traction), self._arms)]
        pressed = points.traction[..., 0] < 0.0
        for values in (pressed, points.compression, points.shear, points.cohesion):
            parts.append(values * self.areas)
        if pressure is not None:
            parts.extend(_with_moments(self.water_forces(pressure), self._arms))
        sums = summed(self._operator.comm, self.local_sums(np.stack(parts)))
        sums[6] /= self.free_area
        columns = _COLUMNS if pressure is None else _COLUMNS | _WATER
        return {name: sums[column].T for name, column in columns.items()}

    def forces(self, traction: Floats) -> Floats:
        """Return forces of the local points on the + side, shape (..., n, 3), [N]."""
        return forces_of(self._operator.frames, self.areas, traction)

    def water_forces(self, pressure: Floats) -> Floats:
        """Return forces of a water pressure (..., n) [Pa] on the + side, shape (..., n, 3), [N]."""
        return self._operator.frames[:, 0] * (self.areas * pressure)[..., None]

    def cohesion(self, joints: Response) -> Floats:
        """Return the cohesion that local points still have, zero if broken, shape (n,), [Pa]."""
        if not self._bonds:
            return self._cohesion
        return self._cohesion * (1.0 - broken_shares(self._contact, joints))


def _with_moments(force: Floats, arms: Floats) -> Floats:
    """Return forces (..., n, 3) and their moments on arms (n, 3), shape (6, ..., n)."""
    return np.moveaxis(np.concatenate([force, np.cross(arms, force)], axis=-1), -1, 0)


def _sums_of_groups(group: Ints, count: int, factors: Floats) -> Callable[[Floats], Floats]:
    """Return a function that multiplies values (..., n) and sums them by group, (..., count)."""
    matrix = csr_array((factors, (group, np.arange(len(group)))), shape=(count, len(group)))

    def sums(values: Floats) -> Floats:
        rows = values.reshape(math.prod(values.shape[:-1]), len(group))
        return np.asarray((matrix @ rows.T).T.reshape(*values.shape[:-1], count))

    return sums


class Blocks:
    """Blocks of a model, which joints separate from each other, and the joint forces on blocks.

    Blocks are numbered in the order of their first node in the input mesh.

    Attributes:
        mass: Shape (blocks,), [kg].
        centre: Centre of mass, shape (blocks, 3), [m]; mean of the nodes if a block has no mass.
        sides: Block on the - and on the + side of each local joint point, shape (n, 2).
    """

    def __init__(self, model: Model, nodes: NodeNumbering) -> None:
        """Find the connected cells (collective)."""
        assert model.operator is not None
        comm = model.jointed.mesh.comm
        self._operator = model.operator
        block = block_of_nodes(nodes)
        pair_blocks = blocks_of_pairs(nodes, model.jointed.pairs, block)
        self.sides: Ints = model.operator.layout.from_facets(comm, pair_blocks)
        owned = block[: model.V.dofmap.index_map.size_local]
        count = int(max(comm.allgather(int(owned.max(initial=-1))))) + 1
        self.mass, self.centre = _masses(model, owned, count)
        self._sides = []
        for side, sign in enumerate((-1.0, 1.0)):
            number = self.sides[:, side]
            sums = _sums_of_groups(number, count, np.full(len(number), sign))
            self._sides.append((sums, self._operator.points - self.centre[number]))

    def __call__(self, force: Floats) -> Floats:
        """Return forces and moments on each block, shape (..., blocks, 6), [N, N m] (collective).

        ``force`` acts on the + side of the local joint points, shape (..., n, 3), [N].
        """
        minus, plus = (sums(_with_moments(force, arms)) for sums, arms in self._sides)
        sums = summed(self._operator.comm, minus + plus)
        return np.moveaxis(sums, 0, -1)


def _masses(model: Model, block: Ints, count: int) -> tuple[Floats, Floats]:
    """Return masses (blocks,) [kg] and centres (blocks, 3) [m], given each owned node's block."""
    gdim, comm = model.gdim, model.jointed.mesh.comm
    points = model.V.tabulate_dof_coordinates()[: len(block)]
    u = model.body_mass.createVecRight()
    values = [np.ones((len(block), 1)), points]
    for field in (np.ones((len(block), gdim)), points[:, :gdim]):
        u.setArray(field.ravel())
        values.append((model.body_mass * u).getArray().reshape(-1, gdim).copy())
    sums = np.zeros((count, 4 + 2 * gdim))
    np.add.at(sums, block, np.hstack(values))
    total = summed(comm, sums)
    mass, mean = total[:, 4].copy(), total[:, 1:4] / total[:, :1]
    heavy = mass > 0.0
    mean[heavy, :gdim] = total[heavy, 4 + gdim :] / mass[heavy, None]
    return mass, mean


class ResultantsStream:
    """Resultants of joints and blocks as a stream of a results file, at every step.

    Attributes:
        sides: Blocks on the - and + side of each joint point by joint, facet by facet.
    """

    def __init__(
        self, model: Model, nodes: NodeNumbering, rows: JointRows, wet: tuple[str, ...]
    ) -> None:
        """Set up joints and blocks (collective)."""
        self._joints, self._blocks = JointForces(model), Blocks(model, nodes)
        self.sides = rows.across(rows(self._blocks.sides))
        self._wet = wet

    def declare(self, writer: ResultsWriter) -> None:
        """Write the data of the blocks on rank 0, while other ranks send `sides`."""
        blocks = self._blocks
        writer.static("blocks/mass", blocks.mass, "kg", "mass of each block")
        text = "centre of mass of each block, mean of the nodes if it has no mass"
        writer.static("blocks/centre", blocks.centre, "m", text)
        for name, sides in self.sides.items():
            text = "blocks on the - and + side of each point"
            writer.static(f"joints/{name}/blocks", sides, "-", text)

    def values(self, points: JointPoints, pressure: Floats | None) -> dict[str, Floats]:
        """Return the values of steps by name from arrays (steps, n, ...) of points (collective)."""
        of_joints, values = self._joints.values(points, pressure), dict[str, Floats]()
        for i, name in enumerate(self._joints.names):
            parts = ["force", "moment", "contact"]
            parts += ["water_force", "water_moment"] if name in self._wet else []
            values |= {f"joints/{name}/{part}": of_joints[part][i] for part in parts}
        sums = self._blocks(self._joints.forces(points.traction))
        values |= {"blocks/force": sums[..., :3], "blocks/moment": sums[..., 3:]}
        if pressure is not None:
            sums = self._blocks(self._joints.water_forces(pressure))
            values |= {"blocks/water_force": sums[..., :3], "blocks/water_moment": sums[..., 3:]}
        return values
