# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes with named groups whose nodes are duplicated across the joints.

After splitting, the two sides of a joint are ordinary exterior facets of an ordinary DOLFINx mesh:
any function space, form or writer works on it. `JointedMesh.dS` is the measure of integrals over
joints. What ties the sides together is `JointPairs`, of which each rank has its part.
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
from dolfinx_joints.mesh.joint_facets import IntegratedPairs, integrated_pairs
from dolfinx_joints.mesh.joint_frames import ufl_frame
from dolfinx_joints.mesh.joint_pairs import JointPairs, no_such_joint
from dolfinx_joints.mesh.joint_surface import JointSurface, compiled


@dataclass(frozen=True, kw_only=True, repr=False)
class JointedMesh(Summarised):
    """A DOLFINx mesh split at its joints, with its groups by name.

    For integrals over a joint take `dS`, over one side of it ``ds("NAME-")`` or ``ds("NAME+")``:
    both sides are exterior facets, so that ``ufl.dS`` has none of them and gives zero there.
    Functions on a joint live on `surface` and go under `dS`, restricted to either side, or under
    ``ds("NAME-")``; under ``ds("NAME+")`` functions on any submesh of facets may be wrong, without
    an error, once `dS` is in use.

    Attributes:
        mesh: The mesh.
        shape: Reference cell and degree of the geometry.
        cell_tags: Tags of the cells.
        cell_groups: Tags that make up each named cell group.
        pairs: The facet pairs of the joints whose - cell this rank owns.
        _facet_tags: Tags of the facets, those of the joints' sides among them.
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
        yield "nodes", f"{number(nodes)} in {geometry.dim} dimensions, those on joints twice"
        yield "joints", names(self.joint_names) or "none"
        yield "joint facets", number(self.pairs.count) if self.joint_names else ""
        yield "cell groups", names(self.cell_groups)
        yield "facet groups", names(self.facet_groups)
        yield "ranks", ranks if ranks > 1 else ""

    @cached_property
    def facet_groups(self) -> dict[str, tuple[int, ...]]:
        """Tags that make up each named facet group, none of a joint's side."""
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
        """Tags of the facets, none on a joint."""
        tags, every = self._facet_tags, self.facet_groups.values()
        kept = np.isin(tags.values, [tag for tags_of_group in every for tag in tags_of_group])
        return mesh_tags(self.mesh, tags.dim, tags.indices[kept], tags.values[kept])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.pairs.names

    def facets(self, name: str) -> NDArray[np.int32]:
        """Local facets of a named group, or of a side ``NAME-`` or ``NAME+`` of a joint.

        Raises:
            MeshError: There is no such group.
        """
        tags = self._tags_of_facets(name)
        return self._facet_tags.indices[np.isin(self._facet_tags.values, tags)]

    def boundary_facets(self, name: str) -> NDArray[np.int32]:
        """Owned facets of such a group, all on the boundary of the body (collective).

        Raises:
            MeshError: There is no such group, or some of its facets lie inside the body.
        """
        facets, topology = self.facets(name), self.mesh.topology
        facet_map, outer = topology.index_map(topology.dim - 1), exterior_facet_indices(topology)
        marked = la.vector(facet_map)
        marked.array[facets] = 1.0  # where two ranks meet, one alone may know of the group
        marked.scatter_reverse(la.InsertMode.add)
        marked.array[outer] = 0.0
        inside = self.mesh.comm.allreduce(np.count_nonzero(marked.array[: facet_map.size_local]))
        if inside:
            raise MeshError(
                f"{inside} facets of {name!r} lie inside the body; loads, springs, viscous "
                "boundaries, water and integrals over ds act on its boundary only."
            )
        return np.intersect1d(facets, outer)

    def corners(self, name: str) -> Floats:
        """Vertices of the facets of such a group, shape (n, vertices per facet, gdim), [m]."""
        x, facets = self.mesh.geometry.x[:, : self.mesh.geometry.dim], self.facets(name)
        if not len(facets):  # DOLFINx divides by their number
            return np.empty((0, self.shape.facet_vertices.shape[1], x.shape[1]))
        return x[entities_to_geometry(self.mesh, self.mesh.topology.dim - 1, facets)]

    def cells(self, name: str) -> NDArray[np.int32]:
        """Local cells of a named group.

        Raises:
            MeshError: There is no such group.
        """
        tags = _tags_of(self.cell_groups, name, "cell")
        return self.cell_tags.indices[np.isin(self.cell_tags.values, tags)]

    def ds(self, name: str) -> ufl.Measure:
        """Surface measure of a named group, or of a side ``NAME-`` or ``NAME+`` of a joint.

        Raises:
            MeshError: There is no such group, or some of its facets lie inside the body.
        """
        self.boundary_facets(name)
        tags = self._tags_of_facets(name)
        return ufl.Measure("ds", domain=self.mesh, subdomain_data=self._facet_tags)(tags)

    def _tags_of_facets(self, name: str) -> tuple[int, ...]:
        if name in self.joint_names:
            raise MeshError(
                f"{name!r} is a joint; integrals over it take dS({name!r}), one side of it is the "
                f"facet group '{name}-' or '{name}+'."
            )
        return _tags_of(self._facet_groups, name, "facet")

    def dS(
        self,
        joints: str | Sequence[str] | None = None,
        *,
        quadrature: str | int | None = None,
        degree: int | None = None,
    ) -> ufl.Measure:
        """Interior-facet measure of joints, for forms on any function spaces of `mesh`.

        The sides are those of the conventions: ``jump(u)`` is u+ - u- and
        ``FacetNormal(mesh)("-")`` the normal n, see also `frame`; ``jump(u + x)`` with the mesh's
        own ``SpatialCoordinate`` x includes gaps in the geometry. Where faces that are apart have
        other areas, that of the + face counts. Restrict every function: one of a Lagrange space
        without ``("+")`` or ``("-")`` UFL takes for continuous, on its + side.

        ``ufl.dS`` has the facets inside the body only; a form that has both takes
        ``jointed.dS()("everywhere")`` for it. On several ranks DOLFINx refuses ``ufl.dS``, as no
        other cells than those across joints are ghosts.

        Args:
            joints: A joint, several, or all.
            quadrature: ``nodal``, ``gauss`` or a degree, see `facet_rule`; UFL's choice for the
                integrand unless given, or what ``dS(...)(degree=4)`` says.
            degree: Degree of the displacement, 1 unless given, that ``nodal`` or ``gauss`` is for.

        Raises:
            MeshError: There is no such joint.
            ValueError: The rule does not exist, or a degree was given without one.
        """
        if quadrature is None and degree is not None:
            raise ValueError(
                f"degree is {shown(degree)} without quadrature='nodal' or 'gauss': it is that of "
                "the displacement; the degree of UFL's own rule is dS(...)(degree=4)."
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
        """The local axes of a joint as a UFL matrix, rows n, s1 and in space s2, to use under `dS`.

        ``dot(jointed.frame("joint_1"), jump(u))`` is the change of the gap in local axes. On curved
        joints the frame follows the - face of each facet; a nodal rule has the mean of the facets
        around a node.

        Raises:
            MeshError: There is no such joint.
        """
        (position,) = self._positions(joint)
        normal = ufl.FacetNormal(self.mesh)("-")
        return ufl_frame(normal, self.pairs.axes[position])

    def surface(self, joints: str | Sequence[str] | None = None) -> JointSurface:
        """Mesh of the - faces of joints, for functions on them; made once and kept (collective).

        Args:
            joints: A joint, several, or all.

        Raises:
            MeshError: There is no such joint.
        """
        chosen = self._positions(joints)
        if chosen not in self._surfaces:
            made = JointSurface(self.mesh, self.pairs, self.integrated_pairs, chosen)
            self._surfaces[chosen] = made
        return self._surfaces[chosen]

    def form(self, form: Any) -> Any:
        """A form or nested lists of them, compiled by `dolfinx.fem.form` (collective).

        Arguments and coefficients may live on joint surfaces: it finds the entity maps.

        Raises:
            MeshError: Functions on a surface stand under another measure than `dS` of its joints,
                or `ds` of - sides.
        """
        if isinstance(form, list | tuple):
            return [self.form(each) for each in form]
        if not self._surfaces or not isinstance(form, ufl.Form):
            return fem.form(form)
        minus = {tag for name in self.joint_names for tag in self._facet_groups[f"{name}-"]}
        return compiled(form, self._surfaces.values(), self.joints_of, minus)

    def joints_of(self, integral: Any) -> set[int] | None:
        """Positions of the joints of an integral over `dS`, None for other integrals."""
        numbers = integral.subdomain_id()
        if integral.subdomain_data() is not self._joint_entities or isinstance(numbers, str):
            return None
        chosen = {int(number) - 1 for number in np.atleast_1d(numbers)}
        return set(range(len(self.joint_names))) if -1 in chosen else chosen

    def _positions(self, joints: str | Sequence[str] | None) -> tuple[int, ...]:
        """Positions of joints among their names, ascending."""
        given = self.joint_names if joints is None else joints
        names = [given] if isinstance(given, str) else given
        if not isinstance(names, list | tuple) or (joints is not None and not names):
            raise MeshError(f"joints is {shown(joints)}; it must name joints, or be None for all.")
        for name in names:
            if name not in self.joint_names:
                raise MeshError(no_such_joint(name, self.joint_names))
        return tuple(sorted({self.joint_names.index(name) for name in names}))

    @cached_property
    def _surfaces(self) -> dict[tuple[int, ...], JointSurface]:
        """Surfaces made so far, by `_positions`."""
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
        """Integration entities of all joints as 0, and of each by its number from 1 on."""
        found = self.integrated_pairs
        joint = self.pairs.joint
        each = [found.entities[joint == i] for i in range(len(self.joint_names))]
        return [(i, entities.ravel()) for i, entities in enumerate([found.entities, *each])]

    def dx(self, name: str) -> ufl.Measure:
        """Volume measure of a named cell group."""
        tags = _tags_of(self.cell_groups, name, "cell")
        return ufl.Measure("dx", domain=self.mesh, subdomain_data=self.cell_tags)(tags)


def _tags_of(groups: Mapping[str, tuple[int, ...]], name: str, kind: str) -> tuple[int, ...]:
    if not isinstance(name, str) or name not in groups:
        known = ", ".join(sorted(groups)) or "none"
        raise MeshError(
            f"The mesh has no {kind} group {shown(name)}; its {kind} groups are: {known}."
        )
    return groups[name]


def mesh_tags(mesh: dolfinx.mesh.Mesh, dim: int, entities: Any, values: Any) -> Any:
    """Tags of some entities in ascending order."""
    return dolfinx.mesh.meshtags(mesh, dim, entities.astype(np.int32), values.astype(np.int32))


def local_cells(mesh: dolfinx.mesh.Mesh, cells: Ints) -> NDArray[np.int32]:
    """Local numbers of input cells, -1 where this rank does not hold one."""
    original = np.asarray(mesh.topology.original_cell_index)
    order = np.append(np.argsort(original), -1).astype(np.int32)
    place = np.searchsorted(original, cells, sorter=order[:-1])
    known = np.append(original, -1)[order]
    return np.where(known[place] == cells, order[place], -1).astype(np.int32)
