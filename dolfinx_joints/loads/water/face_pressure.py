# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads of water and silt on a face: hydrostatic and silt pressure, Westergaard's added mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.mpi import lasting, raised_together
from dolfinx_joints.common.parameters import check_each, shown
from dolfinx_joints.loads.load import LoadedBody, TimeFactor, always
from dolfinx_joints.loads.water.wetted_facets import wetted_facets
from dolfinx_joints.mesh.cells import Floats

Depth = float | Callable[[Floats], Any]


@dataclass(frozen=True, kw_only=True)
@checked
class HydrostaticPressure:
    """Hydrostatic pressure, rho g times the depth below the level; zero above the level.

    Attributes:
        group: Name of the facet group.
        level: Height of the water level, a coordinate along z (y in 2-D) [m].
        density: Density of the water [kg/m^3].
        gravity: g [m/s^2].
        factor: Function of time [s] that multiplies the pressure; 1 by default.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> loads = [dj.HydrostaticPressure(group="top", level=2.5)]  # 0.5 m above the top
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=loads)
        >>> state = dj.Simulation(model).statics()
        >>> round(float(model.resultant(state.reaction, "base")[2]), 1)  # 1000 * 9.80665 * 0.5 [N]
        4903.3
    """

    group: str
    level: Annotated[float, at.Unit("m")]
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")] = 1000.0
    gravity: Annotated[float, at.Ge(0), at.Unit("m/s^2")] = STANDARD_GRAVITY
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the consistent nodal forces (collective)."""
        weight = self.density * self.gravity
        return [(_pressure(model, self.group, self.level, weight), self.factor)]


@dataclass(frozen=True, kw_only=True)
@checked
class SiltPressure:
    """Earth pressure of submerged silt, K rho' g times the depth below the silt surface.

    Attributes:
        group: Name of the facet group.
        level: Height of the silt surface, a coordinate along z (y in 2-D) [m].
        density: Submerged (buoyant) density rho' [kg/m^3].
        coefficient: Earth-pressure coefficient K, such as 1 - sin(phi) at rest.
        gravity: g [m/s^2].
        factor: Function of time [s] that multiplies the pressure; 1 by default.
    """

    group: str
    level: Annotated[float, at.Unit("m")]
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")]
    coefficient: Annotated[float, at.Ge(0)]
    gravity: Annotated[float, at.Ge(0), at.Unit("m/s^2")] = STANDARD_GRAVITY
    factor: TimeFactor = always

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the consistent nodal forces (collective)."""
        weight = self.coefficient * self.density * self.gravity
        return [(_pressure(model, self.group, self.level, weight), self.factor)]


@dataclass(frozen=True, kw_only=True)
@checked
class WestergaardMass:
    """Generalised Westergaard added mass: 7/8 rho sqrt(H h) per area, along the normal.

    H is the depth of the reservoir and h the depth of the point below the level. The mass is zero
    above the level. The mass moves with the face and has no weight.

    Attributes:
        group: Name of the facet group.
        level: Height of the water level, a coordinate along z (y in 2-D) [m].
        depth: H [m], a number or a function of points (n, gdim) that returns (n,); the depth of the
            lowest vertex of the group by default.
        density: Density of the water [kg/m^3].
    """

    group: str
    level: Annotated[float, at.Unit("m")]
    depth: Depth | None = None
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")] = 1000.0

    def __post_init__(self) -> None:
        if isinstance(self.depth, float) and not self.depth > 0.0:
            raise ValueError(
                f"WestergaardMass: depth is {self.depth:g} m; it must be positive and finite."
            )

    def matrix(self, model: LoadedBody) -> PETSc.Mat:
        """Return the added mass in the layout of the model's matrices [kg] (collective)."""
        faces = wetted_facets(model.V, model.jointed, self.group, self.level)
        comm = model.jointed.mesh.comm
        lowest = min(comm.allgather(faces.lowest))
        blocks = model.V.dofmap.index_map
        owned = blocks.size_local * model.gdim
        matrix = PETSc.Mat().create(comm=lasting(comm))
        matrix.setSizes(((owned, None), (owned, None)), bsize=model.gdim)
        matrix.setType("aij")
        matrix.setUp()
        with raised_together(comm):
            for points in faces:
                reservoir_depth = self._depth_of_reservoir(points.positions, lowest)
                per_area = 0.875 * self.density * np.sqrt(reservoir_depth * points.depths)
                area = np.linalg.norm(points.areas, axis=2)
                # The area may vanish at a point near a sharp corner of a warped facet.
                scale = np.divide(per_area, area, out=np.zeros_like(area), where=area > 0.0)
                weighted_normals = points.shapes[..., None] * points.areas[:, :, None, :]
                weighted_normals = weighted_normals.reshape(*weighted_normals.shape[:2], -1)
                masses = np.einsum("np,npi,npj->nij", scale, weighted_normals, weighted_normals)
                rows = blocks.local_to_global(points.nodes.ravel().astype(np.int32))
                rows = rows.reshape(points.nodes.shape).astype(PETSc.IntType)
                for row, mass in zip(rows, masses, strict=True):
                    matrix.setValuesBlocked(row, row, mass, addv=True)
        matrix.assemble()
        return matrix

    def _depth_of_reservoir(self, positions: Floats, lowest: float) -> Any:
        """Return H at points (..., gdim)."""
        if not callable(self.depth):
            return self.level - lowest if self.depth is None else self.depth
        points = positions.reshape(-1, positions.shape[-1])
        name = f"WestergaardMass on {shown(self.group)}: depth"
        depths = check_each(name, self.depth(points), len(points), negative=False, one=False)
        return depths.reshape(positions.shape[:-1])


def _pressure(model: LoadedBody, group: str, level: float, weight: float) -> PETSc.Vec:
    """Return the nodal forces of a pressure of ``weight`` [N/m^3] times the depth (collective).

    Stages and models of a mesh share the forces, whose integration over wet facets is slow.
    """
    mesh = model.jointed.mesh
    nodes = mesh.comm.allreduce(hash(mesh.geometry.x.tobytes()) % 2**32)  # they may have moved
    key = ("pressure", group, level, weight, model.V.ufl_element().degree, nodes)
    if key in model.jointed.shared:
        kept: PETSc.Vec = model.jointed.shared[key]
        return kept.copy()
    faces = wetted_facets(model.V, model.jointed, group, level)
    force = model.mass.createVecRight()
    blocks = model.V.dofmap.index_map
    local = np.zeros((blocks.size_local + blocks.num_ghosts, model.gdim))
    for points in faces:
        forces = np.einsum("np,npi,npa->nai", -weight * points.depths, points.areas, points.shapes)
        np.add.at(local, points.nodes, forces)
    number = blocks.local_to_global(np.arange(len(local), dtype=np.int32))
    dofs = model.gdim * number[:, None] + np.arange(model.gdim)
    force.setValues(dofs.ravel().astype(PETSc.IntType), local.ravel(), addv=True)
    force.assemble()
    model.jointed.shared[key] = force
    return force.copy()
