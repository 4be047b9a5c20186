# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint nodes without mass, so that contact tractions do not ring.

A joint node with mass of its own bounces on a stiff joint from step to step, whatever the body
does. Mass redistribution (Khenous, Laborde, Renard 2008) takes that mass from the joint nodes and
gives it to the body behind them. Here inertia sees a velocity P v that is v itself but at the joint
nodes, where it is extrapolated linearly from nodes behind them:

    M' = P^T M P.

This is symmetric and positive semidefinite for any P, has zero rows at the joint nodes, and as P
reproduces linear fields, each body keeps its mass, centre of mass and moments of inertia to
rounding. M' + K is regular where M + K is: a motion without strain is rigid, and that has all its
inertia. All components are treated alike: shear tractions of a sticking joint ring as normal ones.

The extrapolation of a node makes sum sqrt(|e_j| d_j) small, d_j being the distance of its source j.
So it takes few sources, on a regular mesh two straight behind it: the nearest and the farthest
allowed. The farther that is, the less the inertia near the joint differs from its neighbours',
which waves would be reflected from.
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

# Rings of neighbours that sources are taken from: sources h and 4 h behind a node of degree 1.
RINGS = 4

# Of the largest entry, below which a joint does not act on a node, or a node on another.
ROUNDING = 1e-12

# Sources lie ahead of a node by this share of their distance: not in the joint or across it.
AHEAD = 0.1

# Largest sum |e_j|; two layers of nodes behind the joint make 3.
LARGEST_SUM = 6.0

# Least-squares problems that lead to few sources.
REWEIGHTINGS = 30

# Nodes extrapolated at once, which bounds the memory.
AT_ONCE = 500


@dataclass(frozen=True, kw_only=True)
class Redistribution:
    """A mass matrix without the mass of joint nodes.

    Attributes:
        mass: M' [kg].
        massless: Nodes without mass, on all ranks.
        kept: Joint nodes that keep their mass, on all ranks: those whose dofs are all constrained,
            and those with fewer than two layers of other nodes behind them.
    """

    mass: PETSc.Mat
    massless: int
    kept: int


@checked
def redistribute(
    system: MatrixSystem, coordinates: ArrayLike, *, rings: Annotated[int, at.Ge(1)] = RINGS
) -> MatrixSystem:
    """The system with mass redistributed (collective); its damping and loads stay as they are.

    Args:
        system: A system with joints and as many components per node as space has dimensions; its
            K tells neighbours, so it must couple no nodes across joints.
        coordinates: Owned nodes, shape (n, components), [m].
        rings: Rings of neighbours that sources are taken from.
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
    done = redistributed_mass(
        system.mass, system.stiffness, system.contact.operator, x, system.constrained, rings
    )
    # C is left as it was, though the mass that a part of it may follow is another now.
    return replace(system, mass=done.mass, rayleigh=Rayleigh(), dashpots=system.damping)


def redistributed_mass(
    mass: PETSc.Mat,
    stiffness: PETSc.Mat,
    operator: GapOperator,
    coordinates: Floats,
    constrained: Ints,
    rings: int,
) -> Redistribution:
    """Return M' = P^T M P; arguments are those of `redistribute` (collective).

    K tells the neighbours of a node. A warning is given if joint nodes keep their mass for want of
    nodes behind them.
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
    found = _Sources(pattern, coordinates, wanted, rings)
    pattern.destroy()
    exists = found.extrapolate(inward[wanted])
    short = int(sum(comm.allgather(int((~exists).sum()))))
    if short and comm.rank == 0:
        warn(
            f"{short} joint nodes keep their mass: they have fewer than two layers of other nodes "
            "behind them. Refine the body there."
        )
    extrapolation = found.matrix(mass, exists)
    result = mass.PtAP(extrapolation)
    extrapolation.destroy()
    return Redistribution(
        mass=result,
        massless=int(sum(comm.allgather(int(exists.sum())))),
        kept=int(sum(comm.allgather(int(on_joint.sum() - exists.sum())))),
    )


def _inward(operator: GapOperator, out: PETSc.Vec, dim: int) -> Floats:
    """Sum of w phi^3 n of the points that act on each node, into the body, zero off the joints.

    That of w phi n, the force of a unit pressure, is zero at vertices of 6-node triangles. The
    cube is as good as alone in the points near a node, where phi is large and positive.
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
    """Which owned dofs the joints act on (collective)."""
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
    """Nodes that the nodes of this rank that are to lose their mass are extrapolated from."""

    def __init__(
        self, stiffness: PETSc.Mat, coordinates: Floats, massless: NDArray[np.bool_], rings: int
    ) -> None:
        """Find the candidates of each such node (collective)."""
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
        """Find the weights by directions into the body (wanted, dim); return which exist."""
        exists = np.zeros(len(self._wanted), dtype=bool)
        for start in range(0, len(self._wanted), AT_ONCE):
            part = range(start, min(start + AT_ONCE, len(self._wanted)))
            count = max(1, *(len(self._x[i]) for i in part)) if part else 1
            offset = np.zeros((len(part), count, self._dim))
            valid = np.zeros((len(part), count), dtype=bool)
            for row, i in enumerate(part):
                here = self._x[i] - self._origins[i]
                offset[row, : len(here)] = here
                ahead = here @ inward[i] / np.linalg.norm(inward[i])
                valid[row, : len(here)] = ahead > AHEAD * np.linalg.norm(here, axis=1)
            weights, exists[start : part.stop] = linear_extrapolation(offset, valid)
            for row, i in enumerate(part):
                self._weights.append(weights[row, : len(self._x[i])])
        return exists

    def matrix(self, mass: PETSc.Mat, exists: NDArray[np.bool_]) -> PETSc.Mat:
        """P in the layout of M, with zeros stored on the diagonal of massless rows (collective)."""
        own = mass.getLocalSize()[0] // self._dim
        columns = [np.array([i + self._first]) for i in range(own)]
        values = [np.ones(1)] * own
        for i in np.flatnonzero(exists):
            used = self._weights[i] != 0.0
            node = self._wanted[i]
            columns[node] = np.append(self._nodes[i][used], node + self._first)
            values[node] = np.append(self._weights[i][used], 0.0)
        counts = np.repeat([len(c) for c in columns], self._dim)
        components = np.arange(self._dim)
        every = [(self._dim * c[None, :] + components[:, None]).ravel() for c in columns]
        csr = (
            np.append(0, np.cumsum(counts)),
            np.concatenate([*every, np.zeros(0, dtype=np.int64)]),
            np.concatenate([*(np.tile(v, self._dim) for v in values), np.zeros(0)]),
        )
        return from_rows(mass.getSizes(), csr, mass.comm)


def linear_extrapolation(
    offset: Floats, valid: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Weights e with sum e = 1, sum e x = 0 and small sum sqrt(|e| |x|), and whether there are any.

    By least squares weighted with the solution before, which tends to zero everywhere but at few
    sources, and to equal shares where sources are equally good.

    Args:
        offset: Sources x relative to the node, shape (n, k, dim), [m].
        valid: Which of them may be used, shape (n, k).
    """
    count, most, dim = offset.shape
    distance = np.where(valid, np.linalg.norm(offset, axis=2), np.inf)
    nearest = np.min(distance, axis=1, initial=np.inf)
    scale = np.where(np.isfinite(nearest), nearest, 1.0)[:, None]
    relative = distance / scale
    conditions = np.ones((count, 1 + dim, most))
    conditions[:, 1:] = np.swapaxes(offset, 1, 2) / scale[:, :, None]
    target = np.zeros((count, 1 + dim, 1))
    target[:, 0] = 1.0
    share = 1.0 / relative
    for _ in range(REWEIGHTINGS):
        # The solution of the conditions with the least sum of e^2 / share.
        root = np.sqrt(share)[:, None, :]
        inverse = np.linalg.pinv(conditions * root, rcond=1e-10)
        weights: Floats = (inverse @ target)[:, :, 0] * root[:, 0]
        size = np.abs(weights)
        share = np.where(size > 1e-6, size**1.5, 0.0) / np.sqrt(relative)
    left = np.abs(np.einsum("nck,nk->nc", conditions, weights) - target[:, :, 0]).max(axis=1)
    exists = (left < 1e-9) & (np.abs(weights).sum(axis=1) < LARGEST_SUM)
    return weights, exists


def _rings(stiffness: PETSc.Mat, nodes: Ints, dim: int, count: int) -> list[Ints]:
    """Nodes within some rings of neighbours of each node, global numbers (collective)."""
    reached = [np.array([node]) for node in nodes]
    known: dict[int, Ints] = {}
    for _ in range(count):
        every = np.unique(np.concatenate([*reached, nodes[:0]]))
        new = every[[int(n) not in known for n in every]] if len(every) else every
        known.update(zip(new.tolist(), _neighbours(stiffness, new, dim), strict=True))
        reached = [np.unique(np.concatenate([known[int(n)] for n in part])) for part in reached]
    return reached


def _neighbours(stiffness: PETSc.Mat, nodes: Ints, dim: int) -> list[Ints]:
    """Nodes that K couples with each of some nodes of any rank, and itself (collective)."""
    rows = (dim * nodes[:, None] + np.arange(dim)).ravel().astype(PETSc.IntType)
    wanted = PETSc.IS().createGeneral(rows, comm=PETSc.COMM_SELF)
    every = PETSc.IS().createStride(stiffness.getSize()[1], step=1, comm=PETSc.COMM_SELF)
    part = stiffness.createSubMatrices([wanted], [every])[0]
    starts, columns, values = part.getValuesCSR()
    part.destroy()
    row_of = np.repeat(np.arange(len(rows)) // dim, np.diff(starts))
    largest = np.zeros(len(nodes))
    np.maximum.at(largest, row_of, np.abs(values))
    coupled = np.abs(values) > ROUNDING * largest[row_of]
    pairs = np.unique(np.stack([row_of[coupled], columns[coupled] // dim], axis=1), axis=0)
    found = np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, len(nodes))))
    return [part.astype(np.int64) for part in found[: len(nodes)]]
