# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Waves in a reservoir that keeps its cross-section, by finite elements and in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at
import numpy as np
from scipy.sparse import coo_array, csr_array, kron

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.loads.load import Vector
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.loads.water.far_field import Section
from dolfinx_joints.loads.water.reservoir_slabs import WaterFace, face_matrices
from dolfinx_joints.loads.water.water import (
    Water,
    WaterCells,
    WaterRows,
    reflected,
    surface_inertia,
)
from dolfinx_joints.loads.water.wet_face import (
    WetFace,
    check_reaches_level,
    check_upstream,
    wet_face,
)
from dolfinx_joints.mesh.cells import Floats, Ints
from dolfinx_joints.mesh.node_numbering import NodeNumbering

# Of the mean edge on the face: length of an element along the reservoir.
LAYER = 2.0

QUADRILATERAL, WEDGE = 9, 13  # VTK's numbers


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirWaves:
    """Compressible water in a reservoir with the cross-section of the wet face, for time steps.

    The face is moved horizontally upstream, its edges make floor and banks. All of it moves with
    the ground where that is given as the motion of a stage.

    Attributes:
        group: Name of the facet group, which reaches up to the level or higher.
        level: Height of the water, a coordinate along z (y in 2-D) [m].
        length: Of the reservoir [m].
        upstream: Horizontal vector along which it extends; the mean normal of the wet face, without
            its vertical part, unless given.
        density: Of the water [kg/m^3].
        sound_speed: In the water [m/s].
        bottom_reflection: What floor and banks reflect of a wave's pressure that meets them along
            the normal, alpha.
        gravity_waves: Whether the surface moves: p = rho g times its height instead of zero.
        far_end: ``radiating``: plane waves along the reservoir leave it; or ``rigid``: a wall.
        absorbing_length: Of the part before the far end in which waves are damped more and more,
            which takes the slow ones near the frequencies of the cross-section as well; zero or at
            least two elements [m].
        layers: Number of elements along the reservoir; twice as long as the edges on the face are
            in the mean unless given.
    """

    group: str
    level: Annotated[float, at.Unit("m")]
    length: Annotated[float, at.Gt(0), at.Unit("m")]
    upstream: Vector | None = None
    density: Annotated[float, at.Gt(0), at.Unit("kg/m^3")] = 1000.0
    sound_speed: Annotated[float, at.Gt(0), at.Unit("m/s")] = 1440.0
    bottom_reflection: Annotated[float, at.Ge(0), at.Le(1)] = 1.0
    gravity_waves: bool = False
    far_end: Literal["radiating", "rigid"] = "radiating"
    absorbing_length: Annotated[float, at.Ge(0), at.Unit("m")] = 0.0
    layers: Annotated[int, at.Ge(1)] | None = None

    def __post_init__(self) -> None:
        check_upstream(self)
        if self.absorbing_length > self.length:
            raise ValueError(
                f"{self}: absorbing_length is {self.absorbing_length:g} m; it must not exceed "
                f"length, {self.length:g} m."
            )

    def __str__(self) -> str:
        return f"ReservoirWaves on {shown(self.group)}"

    def water(self, model: LoadedBody) -> Water:
        """Its matrices, in the same order on any number of ranks (collective).

        Raises:
            ValueError: The face ends below the level, a region of it does not reach the level, or
                a part of it does not look upstream.
            MeshError: There is no such group, or some of its facets lie inside the body.
        """
        comm = model.jointed.mesh.comm
        order = NodeNumbering(model.V)
        wet = wet_face(model, self, order, surface_moves=self.gravity_waves)

        def whole() -> WetFace:
            if not wet.face.count:
                raise ValueError(f"{self}: no part of the face is below the level.")
            check_reaches_level(self, wet.face)
            return wet

        return _Moved(self, on_root(comm, whole), model).water()


class _Moved:
    """The water of a face moved upstream, in layers: its matrices are Kronecker products."""

    def __init__(self, waves: ReservoirWaves, wet: WetFace, model: LoadedBody) -> None:
        self._waves, self._wet, self._gdim = waves, wet, model.gdim
        self._dofs = model.V.dofmap.index_map.size_global * model.gdim
        face = wet.face
        sides = np.linalg.norm(face.corners - np.roll(face.corners, 1, axis=1), axis=2)
        count = waves.layers or max(1, round(waves.length / (LAYER * float(sides.mean()))))
        layer = waves.length / count
        if 0.0 < waves.absorbing_length < 1.99 * layer:  # 2 to the digits that are shown
            raise ValueError(
                f"{waves}: absorbing_length is {waves.absorbing_length:g} m; it must be zero or at "
                f"least two elements along the reservoir, {2.0 * layer:.3g} m."
            )
        self._s: Floats = np.linspace(0.0, waves.length, count + 1).astype(np.float64)
        self._face_matrices = [m.tocsr() for m in face_matrices(face, wet.upstream)]
        self._bottom, floor = _moved(face, _outer(face), wet.upstream)
        self._surface, surface = _moved(face, _on_level(face), wet.upstream)
        self._driven = floor + surface

    def water(self) -> Water:
        waves, count = self._waves, self._wet.face.count
        size = count * len(self._s)
        rows, dofs, values = self._wet.coupling
        coupling = coo_array((values, (rows, dofs)), shape=(size, self._dofs)).tocsr()
        driven = np.multiply.outer(_lengths(self._s), self._driven)
        if waves.far_end == "rigid":
            wall = self._face_matrices[3] @ np.ones(count)
            driven[-1] += np.multiply.outer(wall, self._wet.upstream)
        driven = driven.reshape(size, self._gdim)
        uniform = np.tile(np.eye(self._gdim), (self._dofs // self._gdim, 1))
        return Water(
            size=size,
            impedance=waves.density * waves.sound_speed,
            rows=self._rows,
            coupling=coupling,
            driven=driven - coupling @ uniform,
            places=self._along(self._places()[:count]),
            face=np.arange(count),
            cells=self._cells,
            section=self._section(),
        )

    def _places(self) -> Floats:
        """Of the nodes of the face, shape (n, gdim), [m]."""
        face = self._wet.face
        places = np.zeros((int(face.nodes.max()) + 1, self._gdim))
        places[face.nodes] = face.corners
        return places

    def _along(self, places: Floats) -> Floats:
        """Places of the face in all layers, shape (layers n, gdim), [m]."""
        moved = np.multiply.outer(self._s, self._wet.upstream)[:, None]
        return (places + moved).reshape(-1, self._gdim)

    def _cells(self) -> WaterCells:
        """Quadrilaterals or wedges between the layers."""
        face, upstream, count = self._wet.face, self._wet.upstream, self._wet.face.count
        surface = self._places()[count:]
        layer = np.arange(len(self._s))[:, None, None]
        dry = len(self._s) * count + layer * len(surface) + face.nodes - count
        nodes = np.where(face.nodes < count, layer * count + face.nodes, dry)
        near, far = nodes[:-1], nodes[1:]
        if self._gdim == 2:
            far = far[:, :, ::-1]
        else:  # VTK's wedge looks out of its first triangle
            sides = face.corners[:, 1:] - face.corners[:, :1]
            inward = np.cross(sides[:, 0], sides[:, 1]) @ upstream > 0.0
            near, far = (np.where(inward[:, None], each[..., ::-1], each) for each in (near, far))
        return WaterCells(
            surface=self._along(surface),
            nodes=np.concatenate([near, far], axis=2).reshape(-1, 2 * self._gdim),
            kind=QUADRILATERAL if self._gdim == 2 else WEDGE,
        )

    def _section(self) -> Section | None:
        """The cross-section, and what its wave exerts on what absorbs at the far end."""
        waves, end = self._waves, len(self._s) - 1
        if waves.far_end == "rigid" and not waves.absorbing_length:
            return None
        rho, c = waves.density, waves.sound_speed
        in_face, mixed, _, volume = self._face_matrices
        whole = csr_array(np.ones((end + 1, 1)))
        last = csr_array(([1.0], ([end], [0])), shape=(end + 1, 1))
        return Section(
            mass=self._mass(),
            stiffness=rho * c**2 * in_face,
            losses=rho * c * reflected(waves.bottom_reflection) * self._bottom,
            driven=rho * c * self._driven,
            by_rate=rho * c * kron(self._absorbing() @ whole, volume, format="csr"),
            by_place=rho * c**2 * kron(last, mixed.T, format="csr"),
        )

    def _mass(self) -> csr_array:
        """Of water and surface per length, (12u), [kg/m]."""
        rho, c = self._waves.density, self._waves.sound_speed
        return rho * self._face_matrices[3] + surface_inertia(rho, c) * self._surface

    def _absorbing(self) -> csr_array:
        """Dashpots of the far end and before it along the reservoir, over rho c times D."""
        end = len(self._s) - 1
        found = csr_array((end + 1, end + 1))
        if self._waves.far_end == "radiating":
            found = found + csr_array(([1.0], ([end], [end])), shape=found.shape)
        if self._waves.absorbing_length:
            found = found + _line(self._s, self._damping)[0]
        return found

    def _rows(self, first: int, last: int) -> WaterRows:
        """Rows of the unknowns from one up to another, those of a layer behind each other."""
        waves, count = self._waves, self._wet.face.count
        rho, c = waves.density, waves.sound_speed
        layers = slice(first // count, -(-last // count))
        rows = slice(first - layers.start * count, last - layers.start * count)
        in_face, mixed, across, volume = self._face_matrices

        def along(matrix: csr_array, of_face: csr_array) -> csr_array:
            return kron(matrix[layers], of_face, format="csr")

        whole, stretch, slope = _line(self._s)
        stiffness = along(whole, in_face) + along(slope, mixed) + along(slope.T.tocsr(), mixed.T)
        stiffness = stiffness + along(stretch, across)
        losses = reflected(waves.bottom_reflection) * along(whole, self._bottom)
        losses = losses + along(self._absorbing(), volume)
        return WaterRows(
            mass=along(whole, self._mass())[rows],
            stiffness=(rho * c**2 * stiffness)[rows],
            losses=(rho * c * losses)[rows],
        )

    def _damping(self, s: Floats) -> Floats:
        """Damping over c before the far end, (12x), [1/m]."""
        length = self._waves.absorbing_length
        way = np.maximum(s - self._waves.length + length, 0.0) / length
        return 6.0 / length * way**2


def _lengths(s: Floats) -> Floats:
    """Integrals of the shape functions of a line's nodes [m]."""
    half = np.diff(s) / 2.0
    return np.append(half, 0.0) + np.append(0.0, half)


def _line(s: Floats, weight: Callable[[Floats], Floats] | None = None) -> list[csr_array]:
    """Integrals of N N, N' N' and N N' of the linear shape functions of a line's nodes.

    Nodes are at s, shape (n,), [m]; the weight is a factor of N N, taken in the middle of elements.
    """
    size, h = len(s), np.diff(s)
    factor = np.ones_like(h) if weight is None else weight(s[:-1] + h / 2.0)
    elements = (
        np.multiply.outer(factor * h / 6.0, [[2.0, 1.0], [1.0, 2.0]]),
        np.multiply.outer(1.0 / h, [[1.0, -1.0], [-1.0, 1.0]]),
        np.multiply.outer(np.full_like(h, 0.5), [[-1.0, 1.0], [-1.0, 1.0]]),
    )
    nodes = np.arange(size - 1)[:, None] + [0, 1]
    rows, columns = np.repeat(nodes, 2, axis=1).ravel(), np.tile(nodes, (1, 2)).ravel()
    return [
        csr_array(coo_array((each.ravel(), (rows, columns)), shape=(size, size)))
        for each in elements
    ]


@dataclass(frozen=True, kw_only=True)
class _Edges:
    """Edges of a face, ends of lines in the plane.

    Attributes:
        nodes: Shape (n, gdim - 1).
        ends: Coordinates of these, shape (n, gdim - 1, gdim), [m].
        apex: Coordinates of the corner across, on the inner side, shape (n, gdim), [m].
    """

    nodes: Ints
    ends: Floats
    apex: Floats

    def __getitem__(self, chosen: Ints) -> _Edges:
        return _Edges(nodes=self.nodes[chosen], ends=self.ends[chosen], apex=self.apex[chosen])


def _edges(face: WaterFace) -> _Edges:
    axes = face.corners.shape[2]
    others = [[j for j in range(axes) if j != i] for i in range(axes)]
    return _Edges(
        nodes=np.concatenate([face.nodes[:, other] for other in others]),
        ends=np.concatenate([face.corners[:, other] for other in others]),
        apex=np.concatenate([face.corners[:, i] for i in range(axes)]),
    )


def _on_level(face: WaterFace) -> _Edges:
    edges = _edges(face)
    return edges[np.flatnonzero((edges.nodes >= face.below).all(axis=1))]


def _outer(face: WaterFace) -> _Edges:
    """Edges below the level that belong to one part of the face only."""
    edges = _edges(face)
    edges = edges[np.flatnonzero((edges.nodes < face.below).any(axis=1))]
    _, place, times = np.unique(
        np.sort(edges.nodes, axis=1), axis=0, return_index=True, return_counts=True
    )
    return edges[place[times == 1]]


def _moved(face: WaterFace, edges: _Edges, upstream: Floats) -> tuple[csr_array, Floats]:
    """Of edges moved upstream, per length: mass matrix, and integrals of outward normals."""
    nodes, ends, axes = edges.nodes, edges.ends, len(upstream)
    if axes == 2:
        normal = np.tile([-upstream[1], upstream[0]], (len(ends), 1))
    else:
        normal = np.cross(ends[:, 1] - ends[:, 0], upstream)
    inward = np.einsum("nd,nd->n", edges.apex - ends[:, 0], normal) > 0.0
    normal[inward] *= -1.0
    area = np.linalg.norm(normal, axis=1)
    same = (np.ones((axes - 1, axes - 1)) + np.eye(axes - 1)) / (axes * (axes - 1))
    driven = np.zeros((face.count, axes))
    for end in range(axes - 1):
        there = nodes[:, end] < face.count
        np.add.at(driven, nodes[there, end], normal[there] / (axes - 1))
    return csr_array(face.matrix(nodes, area[:, None, None] * same)), driven
