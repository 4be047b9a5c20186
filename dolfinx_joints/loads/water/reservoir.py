# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Added mass of a reservoir by finite elements, of incompressible water by default.

The reservoir is the wet face moved horizontally upstream: its floor and banks are the traces of the
face's edges, so the valley has the same cross-section all along. It matches the face by
construction and needs no mesh of its own; see `slabs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import basix
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.memory import SHARE, available_bytes
from dolfinx_joints.common.mpi import lasting, on_root
from dolfinx_joints.common.parameters import check_vector, shown
from dolfinx_joints.loads.load import Vector
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.loads.water.reservoir_slabs import (
    SURFACE,
    WaterFace,
    clipped,
    half_of_inverse,
    lidded,
    resistance,
)
from dolfinx_joints.loads.water.wetted_facets import WettedFacets, WettedPoints, wetted_facets
from dolfinx_joints.mesh.blocks import same_places
from dolfinx_joints.mesh.cells import Floats, Ints

# Of the height of the face: nodes nearer to the level are taken as lying on it.
ON_LEVEL = 1e-6

# Of the shortest edge: nodes of two blocks that are nearer are one node of the water.
SAME_NODE = 0.01

# Least cosine of the angle between the face's normal and upstream.
STEEPEST = 0.05

# Quadrature on a part of a facet: quadratic shapes in two directions, normals and pressures.
DEGREE = 8

# Of the largest coupling, below which a direction of a node feels no pressure.
UNFELT = 1e-12

# Square matrices over the water's nodes while slabs are doubled; copies of the added mass with
# their indices, in M, in its copies and in the factor of a step.
SLAB_MATRICES, MASS_BYTES = 8, 64

# Lines or triangles of a facet by its number of nodes, in 2-D and in space.
_RING = (0, 4, 1, 6, 3, 7, 2, 5)
PARTS: dict[tuple[int, int], list[list[int]]] = {
    (2, 2): [[0, 1]],
    (2, 3): [[0, 2], [2, 1]],
    (3, 3): [[0, 1, 2]],
    (3, 4): [[0, 1, 2], [3, 2, 1]],
    (3, 6): [[0, 5, 4], [1, 3, 5], [2, 4, 3], [3, 4, 5]],
    (3, 9): [[8, _RING[i - 1], _RING[i]] for i in range(8)],
}


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirMass:
    """Added mass of water in a reservoir with the cross-section of the wet face.

    The water is incompressible unless a frequency is given: Laplace's equation for the pressure,
    p = 0 at the level, dp/dn = -rho a_n on the face, zero on floor and banks. The mass couples all
    nodes of the wet face, moves with it and has no weight.

    Attributes:
        group: Name of the facet group, which reaches up to the level or higher.
        level: Height of the water, a coordinate along z (y in 2-D) [m].
        length: Of the reservoir, up to a rigid end [m]; endless unless given.
        upstream: Horizontal vector along which it extends; the mean normal of the wet face, without
            its vertical part, unless given.
        density: Of the water [kg/m^3].
        frequency: Of the motion [Hz]: above zero the mass is that of compressible water in a
            steady vibration at this frequency, which must be below those of the reservoir itself.
        sound_speed: Of compressible water [m/s].
    """

    group: str
    level: Annotated[float, at.Unit("m")]
    length: Annotated[float, at.Gt(0), at.Unit("m")] | None = None
    upstream: Vector | None = None
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")] = 1000.0
    frequency: Annotated[float, at.Ge(0), at.Unit("Hz")] = 0.0
    sound_speed: Annotated[float, at.Gt(0), at.Unit("m/s")] = 1440.0

    def __post_init__(self) -> None:
        """Check the direction."""
        if self.upstream is not None and not (self.upstream[-1] == 0.0 and np.any(self.upstream)):
            raise ValueError(
                f"{self}: upstream is {shown(self.upstream)}; it must be a horizontal vector, its "
                "last number zero."
            )

    def __str__(self) -> str:
        """Its name in error messages."""
        return f"ReservoirMass on {shown(self.group)}"

    def matrix(self, model: LoadedBody) -> PETSc.Mat:
        """The added mass in the layout of the model's matrices [kg] (collective).

        Raises:
            ValueError: The face ends below the level, a region of it does not reach the level, a
                part of it does not look upstream, or the matrix does not fit into memory.
            MeshError: There is no such group, or some of its facets lie inside the body.
        """
        comm = model.jointed.mesh.comm
        face = _Face(wetted_facets(model.V, model.jointed, self.group, float(self.level)))
        numbers, count = face.numbers(comm, self)
        parts = face.wet_parts(numbers)
        areas = parts.points.areas.sum(axis=1)
        upstream = self._direction(np.sum(comm.allgather(areas.sum(axis=0)), axis=0))
        self._check_looks(comm, areas, upstream)
        nodes, corners = _gathered(comm, parts.nodes), _gathered(comm, parts.corners)
        entries = [_gathered(comm, part) for part in parts.coupling(model)]
        free = available_bytes(comm)

        def solve() -> tuple[Ints, Floats]:
            rows, dofs, values = entries
            used, columns = np.unique(dofs, return_inverse=True)
            self._check_size(count, len(used), free)
            water = WaterFace(count=count, nodes=nodes, corners=corners)
            if lids := lidded(water):
                raise ValueError(
                    f"{self}: {lids} separate regions of the face do not reach up to the level, "
                    f"{self.level:g} m; each must, since the reservoir has its cross-section."
                )
            coupling = np.zeros((count, len(used)))
            np.add.at(coupling, (rows, columns.ravel()), values)
            largest = np.abs(coupling).max(axis=0, initial=0.0)
            felt = largest > UNFELT * largest.max(initial=0.0)
            if not count:
                return used[felt], coupling[:, felt]
            return used[felt], self._half(water, upstream, coupling[:, felt])

        dofs, half = on_root(comm, solve)
        return _assembled(model, dofs, np.sqrt(self.density) * half)

    def _half(self, water: WaterFace, upstream: Floats, coupling: Floats) -> Floats:
        """Y, Y^T Y being the added mass per density."""
        wavenumber = 2.0 * np.pi * self.frequency / self.sound_speed
        try:
            resists = resistance(water, upstream, self.length, wavenumber)
            return half_of_inverse(resists, coupling)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"{self}: frequency is {self.frequency:g} Hz; it must be below the lowest one at "
                f"which the reservoir itself resonates (c/4H, with c = {self.sound_speed:g} m/s, "
                "in a long one with a level floor)."
            ) from None

    def _direction(self, area: Floats) -> Floats:
        """The unit vector upstream; ``area`` is the wet face's, along its normal [m^2]."""
        vector = np.append(area[:-1], 0.0)
        if self.upstream is not None:
            vector = check_vector(f"{self}: upstream", self.upstream, (len(area),))
        size = float(np.linalg.norm(vector))
        if self.upstream is None and size <= STEEPEST * float(np.linalg.norm(area)):
            if not area.any():
                return np.eye(len(area))[0]
            raise ValueError(
                f"{self}: the wet face has no horizontal normal in the mean, so where it looks is "
                "not known; give upstream=, or a group that is one face."
            )
        return np.asarray(vector / size)

    def _check_top(self, highest: float, lowest: float) -> None:
        """Check that the face reaches up to the level."""
        if lowest < self.level and highest < self.level - ON_LEVEL * (highest - lowest):
            raise ValueError(
                f"{self}: the level is {self.level:g} m, but the face ends at {highest:g} m; it "
                "must reach up to the level, since the reservoir has its cross-section."
            )

    def _check_looks(self, comm: Any, areas: Floats, upstream: Floats) -> None:
        """Check that all parts look upstream (collective)."""
        size = np.linalg.norm(areas, axis=1)
        off = areas @ upstream < STEEPEST * size
        sums = np.sum(comm.allgather((float(size[off].sum()), float(size.sum()))), axis=0)
        if sums[0] > 0.0:
            shown = ", ".join(f"{x:.3g}" for x in upstream)
            raise ValueError(
                f"{self}: {100 * sums[0] / sums[1]:.3g} % of the wet face do not look along "
                f"upstream, ({shown}), but away from it or within 3 degrees of aside; leave these "
                "facets out of the group, give another upstream=, or take a WestergaardMass."
            )

    def _check_size(self, nodes: int, dofs: int, free: float) -> None:
        """Check that the matrix fits into memory."""
        needed = 8.0 * SLAB_MATRICES * nodes**2 + MASS_BYTES * dofs**2
        if needed > SHARE * free:
            raise ValueError(
                f"{self}: its {nodes} wet nodes make a full matrix, which may take "
                f"{needed / 1e9:.2g} GB here and in the solver, more than the half of the "
                f"{free / 1e9:.2g} GB that are free; take larger cells on the face, or a "
                "WestergaardMass."
            )


class _Face:
    """Facets of this rank as lines or triangles, along their middle nodes where they have some."""

    def __init__(self, facets: WettedFacets) -> None:
        """Divide the facets."""
        self._facets = facets
        count, nodes = facets.nodes.shape
        gdim = facets.places.shape[2]
        parts = np.array(PARTS[gdim, nodes])
        self._of = np.tile(np.arange(count), len(parts))
        local = np.repeat(parts, count, axis=0)
        self._nodes = np.take_along_axis(facets.nodes[self._of], local, axis=1)
        self._places = np.take_along_axis(facets.places[self._of], local[:, :, None], axis=1)
        at = facets.at(self._of, self._places, np.zeros(self._nodes.shape))
        self._corners = at.positions

    def numbers(self, comm: Any, mass: ReservoirMass) -> tuple[Ints, int]:
        """Number of the water's node at each corner here, and of all such nodes (collective).

        `SURFACE` where a corner is not below the level.
        """
        level = float(mass.level)
        own, first = np.unique(self._nodes, return_index=True)
        points = self._corners.reshape(-1, self._corners.shape[2])[first]
        sides = self._corners - np.roll(self._corners, 1, axis=1)
        shortest = float(np.linalg.norm(sides, axis=2).min(initial=np.inf))
        shortest = min(comm.allgather(shortest))
        lowest = min(comm.allgather(points[:, -1].min(initial=np.inf)))
        highest = max(comm.allgather(points[:, -1].max(initial=-np.inf)))
        mass._check_top(highest, lowest)
        self._on_level = ON_LEVEL * max(highest - lowest, 0.0)
        self._level = level
        every = comm.gather(points, root=0)

        def work() -> tuple[list[Ints], int]:
            wet = level - np.concatenate(every)[:, -1] > self._on_level
            found = np.full(len(wet), SURFACE)
            _, found[wet] = np.unique(
                same_places(np.concatenate(every)[wet], SAME_NODE * shortest), return_inverse=True
            )
            splits = np.cumsum([len(p) for p in every])[:-1]
            return np.split(found, splits), int(found.max(initial=SURFACE)) + 1

        each, count = on_root(comm, work)
        return each[comm.rank][np.searchsorted(own, self._nodes)], count

    def wet_parts(self, numbers: Ints) -> _WetParts:
        """The parts below the level."""
        depths = self._level - self._corners[:, :, -1]
        depths = np.where(numbers == SURFACE, np.minimum(depths, 0.0), depths)
        depths[np.abs(depths) <= self._on_level] = 0.0
        whole, shares, which = clipped(depths)
        corners = np.einsum("pab,pbi->pai", shares, self._corners[whole])
        places = np.einsum("pab,pbi->pai", shares, self._places[whole])
        size = np.sqrt(np.linalg.det(_gram(places)))
        kept = size > 1e-12
        whole, corners, places, which = whole[kept], corners[kept], places[kept], which[kept]
        nodes = np.take_along_axis(numbers[whole], np.maximum(which, 0), axis=1)
        nodes[which == SURFACE] = SURFACE
        cell = (basix.CellType.interval, basix.CellType.triangle)[places.shape[1] - 2]
        points, weights = basix.make_quadrature(cell, DEGREE)
        pressures = np.column_stack([1.0 - points.sum(axis=1), points])
        return _WetParts(
            nodes=nodes,
            corners=corners,
            pressures=pressures,
            points=self._facets.at(
                self._of[whole],
                np.einsum("qa,pai->pqi", pressures, places),
                size[kept][:, None] * weights,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class _WetParts:
    """Lines or triangles of this rank below the level.

    Attributes:
        nodes: Nodes of the water at their corners, or `SURFACE`, shape (parts, gdim).
        corners: Coordinates, shape (parts, gdim, gdim), [m].
        pressures: Shape functions of the corners at the points, shape (points, gdim).
        points: Quadrature points of the body.
    """

    nodes: Ints
    corners: Floats
    pressures: Floats
    points: WettedPoints

    def coupling(self, model: LoadedBody) -> tuple[Ints, Ints, Floats]:
        """Forces of unit pressures at the water's nodes: these nodes, dofs, values [m^2]."""
        gdim = model.gdim
        nodes = self.points.nodes
        blocks = model.V.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
        dofs = gdim * blocks.reshape(nodes.shape)[:, :, None] + np.arange(gdim)
        values = np.einsum(
            "qc,pqn,pqi->pcni", self.pressures, self.points.shapes, self.points.areas
        )
        rows = np.broadcast_to(self.nodes[:, :, None, None], values.shape)
        columns = np.broadcast_to(dofs[:, None], values.shape)
        wet = rows != SURFACE
        return rows[wet], columns[wet], values[wet]


def _gram(simplices: Floats) -> Floats:
    """Gram matrices of the edges of lines or triangles (n, corners, dim)."""
    edges = simplices[:, 1:] - simplices[:, :1]
    return np.einsum("nid,njd->nij", edges, edges)


def _gathered(comm: Any, part: NDArray[Any]) -> NDArray[Any]:
    """The rows of all ranks, on rank 0; elsewhere nothing (collective)."""
    every = comm.gather(part, root=0)
    return part[:0] if every is None else np.concatenate(every)


def _assembled(model: LoadedBody, dofs: Ints, half: Floats) -> PETSc.Mat:
    """Y^T Y over given dofs in the layout of the model's matrices (collective)."""
    blocks = model.V.dofmap.index_map
    first, owned = (model.gdim * n for n in (blocks.local_range[0], blocks.size_local))
    mine = np.flatnonzero((dofs >= first) & (dofs < first + owned))
    rows = half[:, mine].T @ half
    starts = np.zeros(owned + 1, dtype=PETSc.IntType)
    starts[dofs[mine] - first + 1] = len(dofs)
    csr = (
        np.cumsum(starts, dtype=PETSc.IntType),
        np.tile(dofs.astype(PETSc.IntType), len(mine)),
        rows.ravel(),
    )
    sizes = ((owned, None), (owned, None))
    matrix = PETSc.Mat().createAIJ(
        sizes, bsize=model.gdim, csr=csr, comm=lasting(model.jointed.mesh.comm)
    )
    matrix.assemble()
    return matrix
