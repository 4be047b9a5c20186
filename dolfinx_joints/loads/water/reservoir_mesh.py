# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Waves in a reservoir with a separate mesh, for any bathymetry and length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import annotated_types as at
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import locate_entities_boundary, meshtags
from scipy.sparse import coo_array, csr_array

from dolfinx_joints.body.quadrature import matrix_measure
from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_kind_of, shown
from dolfinx_joints.loads.load import LoadedBody
from dolfinx_joints.loads.water.water import (
    Water,
    WaterCells,
    WaterRows,
    reflected,
    surface_inertia,
)
from dolfinx_joints.loads.water.wet_face import ON_LEVEL
from dolfinx_joints.loads.water.wetted_facets import WettedPoints, wetted_facets
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import Floats, Ints, facet_slots, vtk_layout
from dolfinx_joints.mesh.closest_points import ClosestPoints, FacetSurface
from dolfinx_joints.mesh.jointed_mesh import JointedMesh

# Largest distance between the faces of dam and water, relative to the longest side of the larger
# facet. Chords of 30 degrees deviate from their circle by 0.066 of their length.
OUTSIDE = 0.07


@dataclass(frozen=True, kw_only=True, eq=False)
@checked
class MeshedReservoir:
    """Compressible water on a separate mesh, for time integration.

    The top of the mesh is the water level. The meshes of water and dam need not match. Boundaries
    without a group are rigid and at rest, like planes of symmetry.

    Attributes:
        group: Name of the wet facet group of the dam.
        mesh: Mesh of the water, complete on every rank: read it with ``MPI.COMM_SELF``.
        face: Facet group of the water in front of the dam.
        bottom: Facet groups of floor and banks, which absorb waves and move with the ground.
        far_end: Facet group that absorbs waves along its normal; no group by default.
        density: Density of the water [kg/m^3].
        sound_speed: Speed of sound in the water [m/s].
        bottom_reflection: Reflection coefficient alpha of floor and banks, the ratio of reflected
            to incident pressure at normal incidence.
        gravity_waves: True for p = rho g times the elevation of the surface instead of p = 0.
    """

    group: str
    mesh: JointedMesh = field(repr=False)
    face: str
    bottom: Sequence[str] = ()
    far_end: str | None = None
    density: Annotated[float, at.Gt(0), at.Unit("kg/m^3")] = 1000.0
    sound_speed: Annotated[float, at.Gt(0), at.Unit("m/s")] = 1440.0
    bottom_reflection: Annotated[float, at.Ge(0), at.Le(1)] = 1.0
    gravity_waves: bool = False

    def __post_init__(self) -> None:
        valid = isinstance(self.mesh, JointedMesh)
        check_kind_of(f"{self}: mesh", self.mesh, valid, "a mesh, as from read_msh")
        if self.mesh.mesh.comm.size > 1:
            raise MeshError(
                f"{self}: its mesh is distributed over {self.mesh.mesh.comm.size} ranks; read it "
                "with MPI.COMM_SELF, so that each rank has the complete mesh."
            )
        for name in (self.face, *self.bottom, *([self.far_end] if self.far_end else [])):
            self.mesh.facets(name)

    def __str__(self) -> str:
        return f"MeshedReservoir on {shown(self.group)}"

    def water(self, model: LoadedBody) -> Water:
        """Return the matrices, ordered independently of the number of ranks (collective).

        Raises:
            MeshError: The distance between the faces of dam and water exceeds `OUTSIDE` times the
                side of a facet, or the search for a closest point did not converge.
        """
        matrices = _Meshed(self)
        coupling = matrices.coupling(model)
        uniform = np.tile(np.eye(model.gdim), (coupling.shape[1] // model.gdim, 1))
        return Water(
            size=matrices.size,
            impedance=self.density * self.sound_speed,
            rows=matrices.rows,
            coupling=coupling,
            driven=matrices.driven - coupling @ uniform,
            places=matrices.places,
            face=np.flatnonzero(np.diff(coupling.indptr)),
            cells=matrices.cells,
        )


class _Meshed:
    """Matrices of the water below the level, complete on every rank.

    Attributes:
        size: Number of unknowns.
        driven: Integrals of shape functions times the outward normal of bottom and surface [m^2].
        places: Coordinates of the unknowns [m].
        level: Height of the water level [m].
    """

    def __init__(self, reservoir: MeshedReservoir) -> None:
        self._reservoir, self._jointed = reservoir, reservoir.mesh
        mesh, degree = reservoir.mesh.mesh, reservoir.mesh.shape.degree
        self._gdim = mesh.geometry.dim
        self._space = fem.functionspace(mesh, ("Lagrange", degree))
        x = self._space.tabulate_dof_coordinates()[:, : self._gdim]
        self.level = float(x[:, -1].max())
        self._tolerance = ON_LEVEL * float(np.ptp(x[:, -1]))
        dry = (x[:, -1] > self.level - self._tolerance) & (not reservoir.gravity_waves)
        self._unknown_dofs = np.flatnonzero(~dry)
        self._number = np.full(len(x), -1)
        self._number[self._unknown_dofs] = np.arange(len(self._unknown_dofs))
        self.size, self.places = len(self._unknown_dofs), x[self._unknown_dofs]
        self._face, self._of_face = self._water_face()
        self._assemble()

    def _water_face(self) -> tuple[FacetSurface, Ints]:
        """Return the face in front of the dam, and the unknowns at its nodes, -1 at the level.

        The pressure and the geometry have the same Lagrange element.
        """
        mesh, shape = self._jointed.mesh, self._jointed.shape
        cells, local = facet_slots(mesh, self._jointed.facets(self._reservoir.face))
        slots = shape.facet_nodes[local]
        nodes = np.take_along_axis(dolfinx_versions.geometry_nodes(mesh)[cells], slots, axis=1)
        dofs = np.take_along_axis(self._space.dofmap.list[cells], slots, axis=1)
        x = mesh.geometry.x[nodes][:, :, : self._gdim]
        return FacetSurface(x, shape.facet_vertices.shape[1], shape.degree), self._number[dofs]

    def _assemble(self) -> None:
        reservoir, ds, surface = self._reservoir, self._jointed.ds, self._surface()
        u, v = ufl.TrialFunction(self._space), ufl.TestFunction(self._space)
        n, rho, c = ufl.FacetNormal(self._jointed.mesh), reservoir.density, reservoir.sound_speed
        dx = matrix_measure(self._jointed.shape)
        mass = rho * u * v * dx + surface_inertia(rho, c) * u * v * surface
        zero = fem.Constant(self._jointed.mesh, 0.0)
        losses = zero * u * v * dx
        share = rho * c * reflected(reservoir.bottom_reflection)
        for name in reservoir.bottom:
            losses += share * u * v * ds(name)
        if reservoir.far_end is not None:
            losses += rho * c * u * v * ds(reservoir.far_end)
        stiffness = rho * c**2 * ufl.inner(ufl.grad(u), ufl.grad(v)) * dx
        self._matrices = [self._matrix(form) for form in (mass, stiffness, losses)]
        self.driven = np.zeros((self.size, self._gdim))
        for bound in (*(ds(name) for name in reservoir.bottom), surface):
            for axis in range(self._gdim):
                flux = fem.assemble_vector(fem.form(n[axis] * v * bound)).array
                self.driven[:, axis] += flux[self._unknown_dofs]

    def _matrix(self, form: Any) -> csr_array:
        matrix = fem.assemble_matrix(fem.form(form)).to_scipy()
        return csr_array(matrix)[self._unknown_dofs][:, self._unknown_dofs]

    def _surface(self) -> ufl.Measure:
        """Return the measure of the water surface; all or none of its nodes are unknowns."""
        mesh = self._jointed.mesh
        up, fdim = self._gdim - 1, mesh.topology.dim - 1
        top = np.sort(
            locate_entities_boundary(mesh, fdim, lambda x: x[up] > self.level - self._tolerance)
        )
        tags = meshtags(mesh, fdim, top, np.ones(len(top), dtype=np.int32))
        return ufl.Measure("ds", domain=mesh, subdomain_data=tags)(1)

    def cells(self) -> WaterCells:
        """Return the cells of the mesh; nodes at the level without an unknown are numbered last."""
        table = self._space.dofmap.list
        kind, order = vtk_layout(self._jointed.shape, table.shape[1])
        dry = np.flatnonzero(self._number < 0)
        number = self._number.copy()
        number[dry] = self.size + np.arange(len(dry))
        x = self._space.tabulate_dof_coordinates()[:, : self._gdim]
        return WaterCells(surface=x[dry], nodes=number[table][:, order], kind=kind)

    def rows(self, first: int, end: int) -> WaterRows:
        mass, stiffness, losses = (matrix[first:end] for matrix in self._matrices)
        return WaterRows(mass=mass, stiffness=stiffness, losses=losses)

    def coupling(self, model: LoadedBody) -> csr_array:
        """Return the coupling matrix, unknowns times dofs of the body, [m^2] (collective)."""
        comm, blocks = model.jointed.mesh.comm, model.V.dofmap.index_map
        shape = (self.size, blocks.size_global * model.gdim)
        local_coupling, worst_gap = csr_array(shape), _Gap()
        facet_points = wetted_facets(model.V, model.jointed, self._reservoir.group, self.level)
        with raised_together(comm):
            for points in facet_points:
                # On a facet that the level cuts, only the points below the level have an area.
                acts = np.any(points.areas != 0.0, axis=2)
                if not acts.any():
                    continue
                sizes = np.broadcast_to(points.sizes[:, None], acts.shape)
                closest, gap = self._closest(points.positions[acts], sizes[acts])
                worst_gap = max(worst_gap, gap)
                if worst_gap.allowed:
                    entries = self._entries(points, acts, closest, model)
                    local_coupling = local_coupling + csr_array(coo_array(entries, shape=shape))
        self._check(max(comm.allgather(worst_gap)))
        first, *remaining = comm.allgather(local_coupling)
        return sum(remaining, start=first)

    def _closest(self, places: Floats, sizes: Floats) -> tuple[ClosestPoints, _Gap]:
        """Return the closest points on the water's face to places on the dam, and the worst gap.

        ``sizes`` are the longest sides of the dam's facets at these places [m]. The farthest place
        is checked first; if its gap is too large, only its closest point is returned. The search is
        slow for distant places, because all facets have about the same distance.
        """
        for chosen in ([int(self._face.sample_distances(places).argmax())], slice(None)):
            closest = self._face.closest(places[chosen])
            gap = self._gap(places[chosen], sizes[chosen], closest)
            if not gap.allowed:
                break
        return closest, gap

    def _gap(self, places: Floats, sizes: Floats, closest: ClosestPoints) -> _Gap:
        """Return the worst gap at places on the dam; see `_closest` for ``sizes``."""
        sizes = np.maximum(sizes, self._face.sizes[closest.facet])
        ratios = np.where(closest.converged, closest.distance / sizes, np.inf)
        index = int(ratios.argmax())
        return _Gap(
            part=float(ratios[index]),
            distance=float(closest.distance[index]),
            size=float(sizes[index]),
            place=tuple(places[index].tolist()),
        )

    def _check(self, gap: _Gap) -> None:
        if gap.allowed:
            return
        place = ", ".join(f"{value:.4g}" for value in gap.place)
        face = f"the water's face {shown(self._reservoir.face)}"
        if np.isinf(gap.part):
            raise MeshError(
                f"{self._reservoir}: the search for the point on {face} closest to ({place}) m on "
                f"the dam's wet face did not converge; the best point is {gap.distance:.3g} m "
                "away. Check this part of the water's mesh for folded facets."
            )
        raise MeshError(
            f"{self._reservoir}: the dam's wet face at ({place}) m is {gap.distance:.3g} m away "
            f"from {face}; the limit is {OUTSIDE * gap.size:.3g} m, {100 * OUTSIDE:g} % of a "
            "facet's side. Both faces must be the same surface."
        )

    def _entries(
        self, points: WettedPoints, acts: Flags, closest: ClosestPoints, model: LoadedBody
    ) -> tuple[Floats, tuple[Ints, Ints]]:
        """Return values, rows and columns of the coupling.

        The flags ``acts`` are True at quadrature points with an area, shape (pieces, points).
        """
        basis, dofs = self._face.shape_functions(closest.local), self._of_face[closest.facet]
        blocks = model.V.dofmap.index_map.local_to_global(points.nodes.ravel().astype(np.int32))
        blocks = blocks.reshape(points.nodes.shape)[np.nonzero(acts)[0]]
        forces = (points.shapes[..., None] * points.areas[:, :, None, :])[acts]
        values = np.einsum("pw,pni->pwni", basis, forces)
        columns = model.gdim * blocks[:, None, :, None] + np.arange(model.gdim)
        rows, columns = np.broadcast_arrays(dofs[:, :, None, None], columns)
        is_unknown = rows >= 0
        return values[is_unknown], (rows[is_unknown], columns[is_unknown])


@dataclass(frozen=True, kw_only=True, order=True)
class _Gap:
    """Distance between a place on the dam's face and the water's face, ordered by ``part``.

    Attributes:
        part: Distance divided by ``size``; infinite if the search did not converge.
        distance: Distance [m].
        size: Longest side of the larger of the two facets [m].
        place: Coordinates on the dam's face [m].
    """

    part: float = 0.0
    distance: float = 0.0
    size: float = 0.0
    place: tuple[float, ...] = ()

    @property
    def allowed(self) -> bool:
        return self.part <= OUTSIDE
