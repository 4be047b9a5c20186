# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes with named groups whose nodes are duplicated across the joints.

After splitting, the two sides of a joint are ordinary exterior facets of an ordinary DOLFINx mesh,
which supports any function space, form or writer. `JointedMesh.dS` is the measure for integrals
over joints. `JointPairs` connects the two sides; each rank has a part of the pairs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import dolfinx.mesh
import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import entities_to_geometry, exterior_facet_indices
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.common.summary import Rows, Summarised, names, number
from dolfinx_joints.mesh.cells import CellShape, Floats, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_rule
from dolfinx_joints.mesh.joint_pairs import JointPairs, no_such_joint, ufl_frame
from dolfinx_joints.mesh.joint_surface import (
    IntegratedPairs,
    JointSurface,
    compiled,
    integrated_pairs,
)


@dataclass(frozen=True, kw_only=True, repr=False)
class JointedMesh(Summarised):
    """DOLFINx mesh split at its joints, with named groups.

    Integrate over a joint with `dS`, and over one side with ``ds("NAME-")`` or ``ds("NAME+")``.
    Both sides are exterior facets, so ``ufl.dS`` does not include them and gives zero there.

    Functions on a joint are defined on `surface`. Integrate them with `dS`, restricted to either
    side, or with ``ds("NAME-")``. Do not use ``ds("NAME+")`` for functions on a submesh of facets:
    once `dS` has been used, the result may be wrong without an error.

    Attributes:
        mesh: The mesh.
        shape: Reference cell and degree of the geometry.
        cell_tags: Tags of the cells.
        cell_groups: Tags that make up each named cell group.
        pairs: Facet pairs of the joints whose - cell this rank owns.
        _facet_tags: Tags of the facets, including the sides of the joints.
        _facet_groups: Tags that make up each named facet group and each side.
    """

    mesh: dolfinx.mesh.Mesh
    shape: CellShape
    cell_tags: dolfinx.mesh.MeshTags
    cell_groups: Mapping[str, tuple[int, ...]]
    pairs: JointPairs
    _facet_tags: dolfinx.mesh.MeshTags
    _facet_groups: Mapping[str, tuple[int, ...]]

    def _summary(self) -> Rows:
        topology, geometry = self.mesh.topology, self.mesh.geometry
        cells = topology.index_map(topology.dim).size_global
        nodes, ranks = geometry.index_map().size_global, self.mesh.comm.size
        yield "cells", f"{number(cells)}, {self.shape.name}, degree {self.shape.degree}"
        yield "nodes", f"{number(nodes)} in {geometry.dim} dimensions, duplicated on joints"
        yield "joints", names(self.joint_names) or "none"
        yield "joint facets", number(self.pairs.count) if self.joint_names else ""
        yield "cell groups", names(self.cell_groups)
        yield "facet groups", names(self.facet_groups)
        yield "ranks", ranks if ranks > 1 else ""

    @cached_property
    def facet_groups(self) -> dict[str, tuple[int, ...]]:
        """Tags that make up each named facet group, without the sides of joints."""
        groups, names = self._facet_groups, self.joint_names
        sides = {side: groups[side] for name in names for side in (f"{name}-", f"{name}+")}
        of_sides = {tag for tags in sides.values() for tag in tags}
        return {
            name: tuple(tag for tag in tags if tag not in of_sides)
            for name, tags in groups.items()
            if name not in sides
        }

    @cached_property
    def facet_tags(self) -> dolfinx.mesh.MeshTags:
        """Tags of the facets, without the sides of joints."""
        tags, groups = self._facet_tags, self.facet_groups.values()
        kept = np.isin(tags.values, [tag for tags_of_group in groups for tag in tags_of_group])
        return mesh_tags(self.mesh, tags.dim, tags.indices[kept], tags.values[kept])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.pairs.names

    def facets(self, name: str) -> NDArray[np.int32]:
        """Return the local facets of a group, or of a side ``NAME-`` or ``NAME+`` of a joint.

        Raises:
            MeshError: The group does not exist.
        """
        tags = self._tags_of_facets(name)
        return self._facet_tags.indices[np.isin(self._facet_tags.values, tags)]

    def boundary_facets(self, name: str) -> NDArray[np.int32]:
        """Return the owned facets of a group on the boundary of the body (collective).

        Raises:
            MeshError: The group does not exist, or some of its facets lie inside the body.
        """
        facets, topology = self.facets(name), self.mesh.topology
        facet_map, outer = topology.index_map(topology.dim - 1), exterior_facet_indices(topology)
        marked = la.vector(facet_map)
        marked.array[facets] = 1.0  # only one of the ranks that share a facet may have its tag
        marked.scatter_reverse(la.InsertMode.add)
        marked.array[outer] = 0.0
        inside = self.mesh.comm.allreduce(np.count_nonzero(marked.array[: facet_map.size_local]))
        if inside:
            raise MeshError(
                f"{inside} facets of {name!r} lie inside the body; loads, springs, viscous "
                "boundaries, water and integrals over ds need facets on its boundary."
            )
        return np.intersect1d(facets, outer)

    def corners(self, name: str) -> Floats:
        """Return the vertices of the facets of a group, (n, vertices per facet, gdim), [m]."""
        x, facets = self.mesh.geometry.x[:, : self.mesh.geometry.dim], self.facets(name)
        if not len(facets):  # DOLFINx divides by the number of facets
            return np.empty((0, self.shape.facet_vertices.shape[1], x.shape[1]))
        return x[entities_to_geometry(self.mesh, self.mesh.topology.dim - 1, facets)]

    def cells(self, name: str) -> NDArray[np.int32]:
        """Return the local cells of a named group.

        Raises:
            MeshError: The group does not exist.
        """
        tags = _tags_of(self.cell_groups, name, "cell")
        return self.cell_tags.indices[np.isin(self.cell_tags.values, tags)]

    def ds(self, name: str) -> ufl.Measure:
        """Return the surface measure of a group, or of a side ``NAME-`` or ``NAME+`` of a joint.

        Raises:
            MeshError: The group does not exist, or some of its facets lie inside the body.
        """
        self.boundary_facets(name)
        tags = self._tags_of_facets(name)
        return ufl.Measure("ds", domain=self.mesh, subdomain_data=self._facet_tags)(tags)

    def _tags_of_facets(self, name: str) -> tuple[int, ...]:
        if name in self.joint_names:
            raise MeshError(
                f"{name!r} is a joint, not a facet group; use dS({name!r}) for integrals, or "
                f"its sides '{name}-' and '{name}+'."
            )
        return _tags_of(self._facet_groups, name, "facet")

    def dS(
        self,
        joints: str | Sequence[str] | None = None,
        *,
        quadrature: str | int | None = None,
        degree: int | None = None,
    ) -> ufl.Measure:
        """Return the interior-facet measure of joints, for forms on function spaces of `mesh`.

        ``jump(u)`` is u+ - u-, and ``FacetNormal(mesh)("-")`` is the normal n, see also `frame`.
        ``jump(u + x)`` with ``x = SpatialCoordinate(mesh)`` includes gaps in the geometry. If the
        two faces differ in area, the area of the + face is used. Restrict every function by
        ``("+")`` or ``("-")``: UFL treats an unrestricted function of a Lagrange space as
        continuous and evaluates it on the + side.

        ``ufl.dS`` covers only facets inside the body. In a form with both measures, use
        ``jointed.dS()("everywhere")`` instead of ``ufl.dS``. On several ranks DOLFINx rejects
        ``ufl.dS``, because only the cells across joints are ghosts.

        Args:
            joints: A joint name or several; all joints by default.
            quadrature: ``nodal``, ``gauss`` or a degree, see `facet_rule`. By default UFL chooses
                the degree, unless you set it by ``dS(...)(degree=4)``.
            degree: Degree of the displacement for ``nodal`` or ``gauss``, 1 by default.

        Raises:
            MeshError: A joint does not exist.
            ValueError: The rule does not exist, or a degree was given without a rule.
        """
        if quadrature is None and degree is not None:
            raise ValueError(
                f"degree is {shown(degree)} but quadrature is not given; degree is the degree of "
                "the displacement for 'nodal' and 'gauss'. Set UFL's degree by dS(...)(degree=4)."
            )
        numbers = 0 if joints is None else tuple(k + 1 for k in self._positions(joints))
        measure = ufl.Measure("dS", domain=self.mesh, subdomain_data=self._joint_entities)(numbers)
        if quadrature is None:
            return measure
        points, weights = facet_rule(self.pairs.match.shape[1], degree or 1, quadrature)
        return measure(
            metadata={
                "quadrature_rule": "custom",
                "quadrature_points": points.tolist(),
                "quadrature_weights": weights.tolist(),
            }
        )

    def frame(self, joint: str) -> Any:
        """Return the local axes of a joint as a UFL matrix for `dS`: rows n, s1 and, in 3-D, s2.

        ``dot(jointed.frame("joint_1"), jump(u))`` is the change of the gap in local axes. On curved
        joints the frame belongs to the - facet. With a nodal rule, the model instead uses the mean
        of the facets around a node.

        Raises:
            MeshError: The joint does not exist.
        """
        (position,) = self._positions(joint)
        normal = ufl.FacetNormal(self.mesh)("-")
        return ufl_frame(normal, self.pairs.axes[position])

    def surface(self, joints: str | Sequence[str] | None = None) -> JointSurface:
        """Return the mesh of the - faces of joints, created on the first call (collective).

        Args:
            joints: A joint name or several; all joints by default.

        Raises:
            MeshError: A joint does not exist.
        """
        chosen = self._positions(joints)
        if chosen not in self._surfaces:
            made = JointSurface(self.mesh, self.pairs, self.integrated_pairs, chosen)
            self._surfaces[chosen] = made
        return self._surfaces[chosen]

    def form(self, form: Any) -> Any:
        """Compile a form, or nested lists of forms, by `dolfinx.fem.form` (collective).

        Arguments and coefficients may be functions on joint surfaces; their entity maps are added.

        Raises:
            MeshError: A function on a surface is integrated over anything other than its joints
                (`dS`) or - sides (`ds`).
        """
        if isinstance(form, list | tuple):
            return [self.form(part) for part in form]
        if not self._surfaces or not isinstance(form, ufl.Form):
            return fem.form(form)
        minus = {tag for name in self.joint_names for tag in self._facet_groups[f"{name}-"]}
        return compiled(form, self._surfaces.values(), self.joints_of, minus)

    def joints_of(self, integral: Any) -> set[int] | None:
        """Return the positions of the joints of an integral over `dS`, None for other integrals."""
        numbers = integral.subdomain_id()
        if integral.subdomain_data() is not self._joint_entities or isinstance(numbers, str):
            return None
        chosen = {int(number) - 1 for number in np.atleast_1d(numbers)}
        return set(range(len(self.joint_names))) if -1 in chosen else chosen

    def _positions(self, joints: str | Sequence[str] | None) -> tuple[int, ...]:
        """Return the positions of joints in the list of joint names, ascending."""
        given = self.joint_names if joints is None else joints
        names = [given] if isinstance(given, str) else given
        if not isinstance(names, list | tuple) or (joints is not None and not names):
            raise MeshError(f"joints is {shown(joints)}; give joint names, or None for all joints.")
        for name in names:
            if name not in self.joint_names:
                raise MeshError(no_such_joint(name, self.joint_names))
        return tuple(sorted({self.joint_names.index(name) for name in names}))

    @cached_property
    def shared(self) -> dict[Any, Any]:
        """Data of the mesh that models of it share, by key; see their users."""
        return {}

    @cached_property
    def _surfaces(self) -> dict[tuple[int, ...], JointSurface]:
        """Existing surfaces, by the positions of their joints."""
        return {}

    @cached_property
    def integrated_pairs(self) -> IntegratedPairs:
        """Facet pairs that this rank integrates over (collective)."""
        minus, plus = (
            local_cells(self.mesh, side[:, 0]) for side in (self.pairs.minus, self.pairs.plus)
        )
        return integrated_pairs(self.mesh, self.shape, self.pairs, minus, plus)

    @cached_property
    def _joint_entities(self) -> list[tuple[int, NDArray[np.int32]]]:
        """Integration entities of all joints (tag 0) and of each joint (tags 1, 2, ...)."""
        pairs = self.integrated_pairs
        joint = self.pairs.joint
        of_joints = [pairs.entities[joint == i] for i in range(len(self.joint_names))]
        return [(i, entities.ravel()) for i, entities in enumerate([pairs.entities, *of_joints])]

    def dx(self, name: str) -> ufl.Measure:
        """Return the volume measure of a named cell group."""
        tags = _tags_of(self.cell_groups, name, "cell")
        return ufl.Measure("dx", domain=self.mesh, subdomain_data=self.cell_tags)(tags)


def _tags_of(groups: Mapping[str, tuple[int, ...]], name: str, kind: str) -> tuple[int, ...]:
    if not isinstance(name, str) or name not in groups:
        available = ", ".join(sorted(groups)) or "none"
        raise MeshError(
            f"The mesh has no {kind} group {shown(name)}; its {kind} groups are: {available}."
        )
    return groups[name]


def mesh_tags(mesh: dolfinx.mesh.Mesh, dim: int, entities: Any, values: Any) -> Any:
    """Return the MeshTags of entities in ascending order."""
    return dolfinx.mesh.meshtags(mesh, dim, entities.astype(np.int32), values.astype(np.int32))


def local_cells(mesh: dolfinx.mesh.Mesh, cells: Ints) -> NDArray[np.int32]:
    """Return the local numbers of input cells, -1 for cells that are not on this rank."""
    original = np.asarray(mesh.topology.original_cell_index)
    order = np.append(np.argsort(original), -1).astype(np.int32)
    place = np.searchsorted(original, cells, sorter=order[:-1])
    numbers = np.append(original, -1)[order]
    return np.where(numbers[place] == cells, order[place], -1).astype(np.int32)
