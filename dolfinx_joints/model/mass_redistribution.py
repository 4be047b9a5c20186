# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass redistribution: joint nodes without mass, so that contact tractions do not oscillate.

A joint node with mass bounces on a stiff joint from step to step, even if the body moves smoothly.
Mass redistribution (Khenous, Laborde, Renard 2008) moves the mass of the joint nodes to the body
behind them. Here the inertia is computed from the velocity P v. P v equals v except at the joint
nodes, where it is extrapolated linearly from nodes behind them:

    M' = P^T M P.

M' is symmetric and positive semidefinite, with zero rows at the joint nodes. P reproduces linear
fields, so each body keeps its mass, centre of mass and moments of inertia to rounding. M' + K is
regular if M + K is: a motion without strain is rigid and keeps its inertia. Shear components are
treated like normal ones, as shear tractions of a sticking joint oscillate too.

The weights e_j of a node make sum sqrt(|e_j| d_j) small, where d_j is the distance of source j.
This selects few sources: on a regular mesh two nodes straight behind the joint node, the nearest
and the farthest one allowed. Farther sources make the joint region reflect waves less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike, NDArray
from petsc4py import PETSc

from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.body.matrices import from_rows
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import warn
from dolfinx_joints.common.mpi import rows_at
from dolfinx_joints.common.parameters import finite
from dolfinx_joints.joints.operator import GapOperator
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.model.system import MatrixSystem, as_aij, check_system

# Rings of neighbours searched for sources: with degree 1, sources are h and 4 h behind a node.
RINGS = 4

# Relative to the largest entry: smaller entries of B or K do not couple a node.
ROUNDING = 1e-12

# Least distance of a source from the joint plane, relative to its distance from the node.
AHEAD = 0.1

# Largest sum |e_j| allowed; two layers of nodes behind the joint give 3.
LARGEST_SUM = 6.0

# Number of iterations of reweighted least squares, which selects few sources.
REWEIGHTINGS = 30

# Number of nodes extrapolated at once; it limits the memory.
AT_ONCE = 500


@dataclass(frozen=True, kw_only=True)
class Redistribution:
    """Mass matrix without the mass of joint nodes.

    Attributes:
        mass: M' [kg].
        massless: Number of nodes without mass, on all ranks.
        kept: Number of joint nodes that keep their mass, on all ranks: all dofs are constrained,
            or fewer than two layers of other nodes are behind them.
    """

    mass: PETSc.Mat
    massless: int
    kept: int


@checked
def redistribute(
    system: MatrixSystem, coordinates: ArrayLike, *, rings: Annotated[int, at.Ge(1)] = RINGS
) -> MatrixSystem:
    """Return the system with redistributed mass; damping and loads do not change (collective).

    Args:
        system: A system with joints and one displacement component per space dimension. Its K
            defines which nodes are neighbours, so K must not couple nodes across joints.
        coordinates: Coordinates of the owned nodes, shape (n, components), [m].
        rings: Rings of neighbours that are searched for sources.
    """
    check_system(system)
    if system.contact is None:
        raise ValueError("The system has no joints; there is no mass to redistribute.")
    x = np.asarray(coordinates, dtype=np.float64)
    shape = (system.mass.getLocalSize()[0] // system.components, system.components)
    if x.shape != shape or not finite(x):
        raise ValueError(
            f"coordinates is an array of shape {x.shape}; it needs finite numbers of shape {shape}."
        )
    redistribution = redistributed_mass(
        system.mass, system.stiffness, system.contact.operator, x, system.constrained, rings
    )
    # Keep C: its mass-proportional part stays proportional to the original mass.
    return replace(system, mass=redistribution.mass, rayleigh=Rayleigh(), dashpots=system.damping)


def redistributed_mass(
    mass: PETSc.Mat,
    stiffness: PETSc.Mat,
    operator: GapOperator,
    coordinates: Floats,
    constrained: Ints,
    rings: int,
) -> Redistribution:
    """Return M' = P^T M P; the arguments are those of `redistribute` (collective).

    Warn if joint nodes keep their mass because too few nodes are behind them.
    """
    dim = coordinates.shape[1]
    comm = mass.comm.tompi4py()
    inward = _inward(operator, mass.createVecRight(), dim)
    size = np.linalg.norm(inward, axis=1)
    largest = max(comm.allgather(float(size.max(initial=0.0))))
    on_joint = size > ROUNDING * largest
    fixed = np.zeros(inward.size, dtype=bool)
    fixed[constrained] = True
    clamped = fixed.reshape(-1, dim).all(axis=1)
    wanted = on_joint & ~clamped
    pattern = as_aij(stiffness)
    sources = _Sources(pattern, coordinates, wanted, rings)
    pattern.destroy()
    exists = sources.extrapolate(inward[wanted])
    count = int(sum(comm.allgather(int((~exists).sum()))))
    if count and comm.rank == 0:
        warn(
            f"{count} joint nodes keep their mass: they have fewer than two layers of other nodes "
            "behind them. Refine the body there."
        )
    extrapolation = sources.matrix(mass, exists)
    result = mass.PtAP(extrapolation)
    extrapolation.destroy()
    return Redistribution(
        mass=result,
        massless=int(sum(comm.allgather(int(exists.sum())))),
        kept=int(sum(comm.allgather(int(on_joint.sum() - exists.sum())))),
    )


def _inward(operator: GapOperator, out: PETSc.Vec, dim: int) -> Floats:
    """Return the direction into the body at each node: the sum of w phi^3 n over its points.

    The sum of w phi n, the force of a unit pressure, is zero at vertices of 6-node triangles. With
    phi^3, the points near the node dominate, where phi is large and positive.
    """
    starts, columns, values = operator.matrix.getValuesCSR()
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    pairs = np.stack([row, columns // dim], axis=1)
    _, inverse = np.unique(pairs, axis=0, return_inverse=True)
    square = np.bincount(inverse.ravel(), values**2)[inverse.ravel()]  # phi^2, as |n| = 1
    cubes = operator.matrix.copy()
    cubes.setValuesCSR(starts, columns, values * square)
    cubes.assemble()
    pressure = cubes.createVecLeft()
    pressure.setArray((operator.areas[:, None] * [1.0, 0.0, 0.0]).ravel())
    cubes.multTranspose(pressure, out)
    cubes.destroy()
    return np.asarray(out.getArray()).reshape(-1, dim)


def joint_dofs(operator: GapOperator) -> NDArray[np.bool_]:
    """Return a mask of the owned dofs that the joints act on (collective)."""
    starts, columns, values = operator.matrix.getValuesCSR()
    sizes = operator.matrix.copy()
    sizes.setValuesCSR(starts, columns, np.abs(values))
    sizes.assemble()
    ones, acted = sizes.createVecLeft(), sizes.createVecRight()
    ones.set(1.0)
    sizes.multTranspose(ones, acted)
    sizes.destroy()
    return np.asarray(acted.getArray(readonly=True) > ROUNDING)


class _Sources:
    """Source nodes from which the massless nodes of this rank are extrapolated."""

    def __init__(
        self, stiffness: PETSc.Mat, coordinates: Floats, massless: NDArray[np.bool_], rings: int
    ) -> None:
        """Find the candidate sources of each massless node (collective)."""
        self._dim = coordinates.shape[1]
        self._wanted = wanted = np.flatnonzero(massless)
        self._first = stiffness.getOwnershipRange()[0] // self._dim
        self._origins = coordinates[wanted]
        reached = _rings(stiffness, wanted + self._first, self._dim, rings)
        nodes, place = np.unique(np.concatenate([*reached, wanted[:0]]), return_inverse=True)
        comm = stiffness.comm.tompi4py()
        has_mass, x = ~rows_at(comm, massless, nodes), rows_at(comm, coordinates, nodes)
        parts = np.split(place, np.cumsum([len(r) for r in reached])[:-1]) if reached else []
        self._nodes = [nodes[p[has_mass[p]]] for p in parts]
        self._x = [x[p[has_mass[p]]] for p in parts]
        self._weights: list[Floats] = []

    def extrapolate(self, inward: Floats) -> NDArray[np.bool_]:
        """Compute the weights for directions into the body (nodes, dim); return which exist."""
        exists = np.zeros(len(self._wanted), dtype=bool)
        for start in range(0, len(self._wanted), AT_ONCE):
            part = range(start, min(start + AT_ONCE, len(self._wanted)))
            count = max(1, *(len(self._x[i]) for i in part)) if part else 1
            offset = np.zeros((len(part), count, self._dim))
            valid = np.zeros((len(part), count), dtype=bool)
            for row, i in enumerate(part):
                candidate_offsets = self._x[i] - self._origins[i]
                offset[row, : len(candidate_offsets)] = candidate_offsets
                ahead = candidate_offsets @ inward[i] / np.linalg.norm(inward[i])
                valid[row, : len(candidate_offsets)] = ahead > AHEAD * np.linalg.norm(
                    candidate_offsets, axis=1
                )
            weights, exists[start : part.stop] = linear_extrapolation(offset, valid)
            for row, i in enumerate(part):
                self._weights.append(weights[row, : len(self._x[i])])
        return exists

    def matrix(self, mass: PETSc.Mat, exists: NDArray[np.bool_]) -> PETSc.Mat:
        """Return P in the layout of M; massless rows store a zero on the diagonal (collective)."""
        node_count = mass.getLocalSize()[0] // self._dim
        columns = [np.array([i + self._first]) for i in range(node_count)]
        values = [np.ones(1)] * node_count
        for i in np.flatnonzero(exists):
            used = self._weights[i] != 0.0
            node = self._wanted[i]
            columns[node] = np.append(self._nodes[i][used], node + self._first)
            values[node] = np.append(self._weights[i][used], 0.0)
        counts = np.repeat([len(c) for c in columns], self._dim)
        components = np.arange(self._dim)
        dof_columns = [(self._dim * c[None, :] + components[:, None]).ravel() for c in columns]
        csr = (
            np.append(0, np.cumsum(counts)),
            np.concatenate([*dof_columns, np.zeros(0, dtype=np.int64)]),
            np.concatenate([*(np.tile(v, self._dim) for v in values), np.zeros(0)]),
        )
        return from_rows(mass.getSizes(), csr, mass.comm)


def linear_extrapolation(
    offset: Floats, valid: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return weights e, sum e = 1, sum e x = 0, small sum sqrt(|e| |x|), and whether they exist.

    Reweighted least squares drive most weights to zero; equally good sources have equal weights.

    Args:
        offset: Sources x relative to the node, shape (n, k, dim), [m].
        valid: Mask of the sources that may be used, shape (n, k).
    """
    count, source_count, dim = offset.shape
    distance = np.where(valid, np.linalg.norm(offset, axis=2), np.inf)
    nearest = np.min(distance, axis=1, initial=np.inf)
    scale = np.where(np.isfinite(nearest), nearest, 1.0)[:, None]
    relative = distance / scale
    conditions = np.ones((count, 1 + dim, source_count))
    conditions[:, 1:] = np.swapaxes(offset, 1, 2) / scale[:, :, None]
    target = np.zeros((count, 1 + dim, 1))
    target[:, 0] = 1.0
    share = 1.0 / relative
    for _ in range(REWEIGHTINGS):
        # Of all e that satisfy the conditions, take the e with the least sum of e^2 / share.
        root = np.sqrt(share)[:, None, :]
        inverse = np.linalg.pinv(conditions * root, rcond=1e-10)
        weights: Floats = (inverse @ target)[:, :, 0] * root[:, 0]
        size = np.abs(weights)
        share = np.where(size > 1e-6, size**1.5, 0.0) / np.sqrt(relative)
    residual = np.abs(np.einsum("nck,nk->nc", conditions, weights) - target[:, :, 0]).max(axis=1)
    exists = (residual < 1e-9) & (np.abs(weights).sum(axis=1) < LARGEST_SUM)
    return weights, exists


def _rings(stiffness: PETSc.Mat, nodes: Ints, dim: int, count: int) -> list[Ints]:
    """Return the nodes in ``count`` rings around each node, global numbers (collective)."""
    reached = [np.array([node]) for node in nodes]
    neighbours: dict[int, Ints] = {}
    for _ in range(count):
        reached_nodes = np.unique(np.concatenate([*reached, nodes[:0]]))
        new = (
            reached_nodes[[int(n) not in neighbours for n in reached_nodes]]
            if len(reached_nodes)
            else reached_nodes
        )
        neighbours.update(zip(new.tolist(), _neighbours(stiffness, new, dim), strict=True))
        reached = [
            np.unique(np.concatenate([neighbours[int(n)] for n in part])) for part in reached
        ]
    return reached


def _neighbours(stiffness: PETSc.Mat, nodes: Ints, dim: int) -> list[Ints]:
    """Return the nodes that K couples with each given node, this node included (collective)."""
    rows = (dim * nodes[:, None] + np.arange(dim)).ravel().astype(PETSc.IntType)
    row_set = PETSc.IS().createGeneral(rows, comm=PETSc.COMM_SELF)
    all_columns = PETSc.IS().createStride(stiffness.getSize()[1], step=1, comm=PETSc.COMM_SELF)
    part = stiffness.createSubMatrices([row_set], [all_columns])[0]
    starts, columns, values = part.getValuesCSR()
    part.destroy()
    row_of = np.repeat(np.arange(len(rows)) // dim, np.diff(starts))
    largest = np.zeros(len(nodes))
    np.maximum.at(largest, row_of, np.abs(values))
    coupled = np.abs(values) > ROUNDING * largest[row_of]
    pairs = np.unique(np.stack([row_of[coupled], columns[coupled] // dim], axis=1), axis=0)
    neighbours = np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, len(nodes))))
    return [part.astype(np.int64) for part in neighbours[: len(nodes)]]
