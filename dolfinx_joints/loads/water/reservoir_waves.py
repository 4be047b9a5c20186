# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Waves in a reservoir of constant cross-section, by finite elements in the time domain."""

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
from dolfinx_joints.loads.load import LoadedBody, Vector
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

# Default length of an element along the reservoir, relative to the mean edge on the face.
LAYER = 2.0

QUADRILATERAL, WEDGE = 9, 13  # VTK cell types


@dataclass(frozen=True, kw_only=True)
@checked
class ReservoirWaves:
    """Compressible water in a reservoir with the cross-section of the wet face.

    The face is extruded horizontally upstream; its edges form floor and banks. Under a uniform
    ground motion, the whole boundary of the reservoir moves with the ground.

    Attributes:
        group: Name of the facet group, which must reach up to the level or higher.
        level: Height of the water level, a coordinate along z (y in 2-D) [m].
        length: Length of the reservoir [m].
        upstream: Horizontal vector along which the reservoir extends; by default the horizontal
            part of the mean normal of the wet face.
        density: Density of the water [kg/m^3].
        sound_speed: Speed of sound in the water [m/s].
        bottom_reflection: Reflection coefficient alpha of floor and banks, the ratio of reflected
            to incident pressure at normal incidence.
        gravity_waves: True for p = rho g times the elevation of the surface instead of p = 0.
        far_end: ``radiating``: absorbs plane waves along the reservoir; ``rigid``: a wall.
        absorbing_length: Length of a part with increasing damping before the far end, zero or at
            least two elements [m]. It also absorbs slow waves, which are near the natural
            frequencies of the cross-section.
        layers: Number of elements along the reservoir. By default an element is twice as long as
            the mean edge on the face.
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
        """Return the matrices, ordered independently of the number of ranks (collective).

        Raises:
            ValueError: A region of the face does not reach the level, or a part of the face does
                not face upstream.
            MeshError: The group does not exist, or some of its facets are inside the body.
        """
        comm = model.jointed.mesh.comm
        order = NodeNumbering(model.V)
        wet = wet_face(model, self, order, surface_moves=self.gravity_waves)

        def whole() -> WetFace:
            if not wet.face.count:
                raise ValueError(f"{self}: no part of the face is below the level; check level.")
            check_reaches_level(self, wet.face)
            return wet

        return _Extruded(self, on_root(comm, whole), model).water()


class _Extruded:
    """Water of a face extruded upstream in layers; its matrices are Kronecker products."""

    def __init__(self, waves: ReservoirWaves, wet: WetFace, model: LoadedBody) -> None:
        self._waves, self._wet, self._gdim = waves, wet, model.gdim
        self._dofs = model.V.dofmap.index_map.size_global * model.gdim
        face = wet.face
        sides = np.linalg.norm(face.corners - np.roll(face.corners, 1, axis=1), axis=2)
        count = waves.layers or max(1, round(waves.length / (LAYER * float(sides.mean()))))
        layer = waves.length / count
        if 0.0 < waves.absorbing_length < 1.99 * layer:  # accepts the rounded value of the message
            raise ValueError(
                f"{waves}: absorbing_length is {waves.absorbing_length:g} m; it must be zero or at "
                f"least two elements along the reservoir, {2.0 * layer:.3g} m."
            )
        self._s: Floats = np.linspace(0.0, waves.length, count + 1).astype(np.float64)
        self._face_matrices = [m.tocsr() for m in face_matrices(face, wet.upstream)]
        self._bottom, floor = _extrude(face, _outer(face), wet.upstream)
        self._surface, surface = _extrude(face, _on_level(face), wet.upstream)
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
        """Return the coordinates of the nodes of the face, shape (n, gdim), [m]."""
        face = self._wet.face
        places = np.zeros((int(face.nodes.max()) + 1, self._gdim))
        places[face.nodes] = face.corners
        return places

    def _along(self, places: Floats) -> Floats:
        """Return places of the face, moved to each layer, shape (layers n, gdim), [m]."""
        offsets = np.multiply.outer(self._s, self._wet.upstream)[:, None]
        return (places + offsets).reshape(-1, self._gdim)

    def _cells(self) -> WaterCells:
        """Return the quadrilaterals or wedges between the layers."""
        face, upstream, count = self._wet.face, self._wet.upstream, self._wet.face.count
        surface = self._places()[count:]
        layer = np.arange(len(self._s))[:, None, None]
        dry = len(self._s) * count + layer * len(surface) + face.nodes - count
        nodes = np.where(face.nodes < count, layer * count + face.nodes, dry)
        near, far = nodes[:-1], nodes[1:]
        if self._gdim == 2:
            far = far[:, :, ::-1]
        else:  # the normal of the first triangle of a VTK wedge points outwards
            sides = face.corners[:, 1:] - face.corners[:, :1]
            inward = np.cross(sides[:, 0], sides[:, 1]) @ upstream > 0.0
            near, far = (np.where(inward[:, None], side[..., ::-1], side) for side in (near, far))
        return WaterCells(
            surface=self._along(surface),
            nodes=np.concatenate([near, far], axis=2).reshape(-1, 2 * self._gdim),
            kind=QUADRILATERAL if self._gdim == 2 else WEDGE,
        )

    def _section(self) -> Section | None:
        """Return the cross-section for `FarField`; None without an absorbing far end."""
        waves, end = self._waves, len(self._s) - 1
        if waves.far_end == "rigid" and not waves.absorbing_length:
            return None
        rho, c = waves.density, waves.sound_speed
        in_face, mixed, _, volume = self._face_matrices
        all_layers = csr_array(np.ones((end + 1, 1)))
        last_layer = csr_array(([1.0], ([end], [0])), shape=(end + 1, 1))
        return Section(
            mass=self._mass(),
            stiffness=rho * c**2 * in_face,
            losses=rho * c * reflected(waves.bottom_reflection) * self._bottom,
            driven=rho * c * self._driven,
            by_rate=rho * c * kron(self._absorbing() @ all_layers, volume, format="csr"),
            by_place=rho * c**2 * kron(last_layer, mixed.T, format="csr"),
        )

    def _mass(self) -> csr_array:
        """Return the mass matrix of water and surface per length, (12u), [kg/m]."""
        rho, c = self._waves.density, self._waves.sound_speed
        return rho * self._face_matrices[3] + surface_inertia(rho, c) * self._surface

    def _absorbing(self) -> csr_array:
        """Return the dashpots of far end and absorbing part along s, without the factor rho c D."""
        end = len(self._s) - 1
        dashpots = csr_array((end + 1, end + 1))
        if self._waves.far_end == "radiating":
            dashpots = dashpots + csr_array(([1.0], ([end], [end])), shape=dashpots.shape)
        if self._waves.absorbing_length:
            dashpots = dashpots + _line(self._s, self._damping)[0]
        return dashpots

    def _rows(self, first: int, end: int) -> WaterRows:
        """Return the rows of the unknowns from ``first`` up to ``end``, ordered by layer."""
        waves, count = self._waves, self._wet.face.count
        rho, c = waves.density, waves.sound_speed
        layers = slice(first // count, -(-end // count))
        rows = slice(first - layers.start * count, end - layers.start * count)
        in_face, mixed, across, volume = self._face_matrices

        def along(matrix: csr_array, of_face: csr_array) -> csr_array:
            return kron(matrix[layers], of_face, format="csr")

        n_n, dn_dn, n_dn = _line(self._s)
        stiffness = along(n_n, in_face) + along(n_dn, mixed) + along(n_dn.T.tocsr(), mixed.T)
        stiffness = stiffness + along(dn_dn, across)
        losses = reflected(waves.bottom_reflection) * along(n_n, self._bottom)
        losses = losses + along(self._absorbing(), volume)
        return WaterRows(
            mass=along(n_n, self._mass())[rows],
            stiffness=(rho * c**2 * stiffness)[rows],
            losses=(rho * c * losses)[rows],
        )

    def _damping(self, s: Floats) -> Floats:
        """Return the damping of the absorbing part divided by c, (12x), [1/m]."""
        length = self._waves.absorbing_length
        share = np.maximum(s - self._waves.length + length, 0.0) / length
        return 6.0 / length * share**2


def _lengths(s: Floats) -> Floats:
    """Return the integrals of the shape functions of the nodes of a line [m]."""
    half = np.diff(s) / 2.0
    return np.append(half, 0.0) + np.append(0.0, half)


def _line(s: Floats, weight: Callable[[Floats], Floats] | None = None) -> list[csr_array]:
    """Return the integrals of N N, N' N' and N N' for linear elements with nodes at s (n,) [m].

    The weight is a factor of N N, evaluated at the centre of each element.
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
        csr_array(coo_array((values.ravel(), (rows, columns)), shape=(size, size)))
        for values in elements
    ]


@dataclass(frozen=True, kw_only=True)
class _Edges:
    """Edges of a face; in 2-D the ends of lines.

    Attributes:
        nodes: Nodes, shape (n, gdim - 1).
        ends: Coordinates of the nodes, shape (n, gdim - 1, gdim), [m].
        apex: Coordinates of the corner opposite the edge, shape (n, gdim), [m].
    """

    nodes: Ints
    ends: Floats
    apex: Floats

    def __getitem__(self, chosen: Ints) -> _Edges:
        return _Edges(nodes=self.nodes[chosen], ends=self.ends[chosen], apex=self.apex[chosen])


def _edges(face: WaterFace) -> _Edges:
    axes = face.corners.shape[2]
    corner_sets = [[j for j in range(axes) if j != i] for i in range(axes)]
    return _Edges(
        nodes=np.concatenate([face.nodes[:, corners] for corners in corner_sets]),
        ends=np.concatenate([face.corners[:, corners] for corners in corner_sets]),
        apex=np.concatenate([face.corners[:, i] for i in range(axes)]),
    )


def _on_level(face: WaterFace) -> _Edges:
    edges = _edges(face)
    return edges[np.flatnonzero((edges.nodes >= face.below).all(axis=1))]


def _outer(face: WaterFace) -> _Edges:
    """Return the boundary edges below the level, which belong to one part of the face only."""
    edges = _edges(face)
    edges = edges[np.flatnonzero((edges.nodes < face.below).any(axis=1))]
    _, place, counts = np.unique(
        np.sort(edges.nodes, axis=1), axis=0, return_index=True, return_counts=True
    )
    return edges[place[counts == 1]]


def _extrude(face: WaterFace, edges: _Edges, upstream: Floats) -> tuple[csr_array, Floats]:
    """Return the mass matrix and the outward normal integrals of extruded edges, per length."""
    nodes, ends, axes = edges.nodes, edges.ends, len(upstream)
    if axes == 2:
        normal = np.tile([-upstream[1], upstream[0]], (len(ends), 1))
    else:
        normal = np.cross(ends[:, 1] - ends[:, 0], upstream)
    inward = np.einsum("nd,nd->n", edges.apex - ends[:, 0], normal) > 0.0
    normal[inward] *= -1.0
    area = np.linalg.norm(normal, axis=1)
    mass_pattern = (np.ones((axes - 1, axes - 1)) + np.eye(axes - 1)) / (axes * (axes - 1))
    driven = np.zeros((face.count, axes))
    for end in range(axes - 1):
        has_pressure = nodes[:, end] < face.count
        np.add.at(driven, nodes[has_pressure, end], normal[has_pressure] / (axes - 1))
    return csr_array(face.matrix(nodes, area[:, None, None] * mass_pattern)), driven
