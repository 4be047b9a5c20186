# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints in DOLFINx's forms: meshes of joint faces, and facet pairs as interior facets.

An interior-facet integral uses two cells and one facet of each cell. DOLFINx does not require that
the two facets are identical; only the order of their quadrature points must agree. DOLFINx orders
the points of each facet by a permutation code, which it derives from the global vertex numbers. The
two faces of a joint have different vertices, so their codes differ. This module replaces the code
of the + facet by the code that gives the points the same order as on the - facet. The new code also
affects ``ds`` integrals over the + side with functions on a submesh of facets. Use interior-facet
integrals for these functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import basix
import basix.ufl
import dolfinx.mesh
import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from ufl.domain import extract_domains

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import CellShape, Ints
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type, facet_rule
from dolfinx_joints.mesh.joint_pairs import JointPairs


@dataclass(frozen=True, kw_only=True)
class IntegratedPairs:
    """Facet pairs over which this rank integrates.

    Attributes:
        entities: Local cell and facet on the + side, then on the - side, shape (n, 4). The first
            side of an interior-facet integral is ``+`` in UFL.
        vertex_order: Vertices of the - facet in the order in which integrals use them, shape
            (n, vertices per facet).
    """

    entities: Ints
    vertex_order: Ints


def integrated_pairs(
    mesh: dolfinx.mesh.Mesh,
    shape: CellShape,
    pairs: JointPairs,
    minus_cells: NDArray[np.int32],
    plus_cells: NDArray[np.int32],
) -> IntegratedPairs:
    """Return this rank's facet pairs; give both facets the same order of quadrature points.

    ``minus_cells`` and ``plus_cells`` are the local numbers of the cells of each pair. The + cells
    may be ghosts.
    """
    entities = np.column_stack([plus_cells, pairs.plus[:, 1], minus_cells, pairs.minus[:, 1]])
    codes = dolfinx_versions.facet_permutations(mesh)
    facets = len(shape.facet_vertices) * entities[:, [0, 2]] + entities[:, [1, 3]]
    permutations = vertex_permutations(shape.facet_vertices.shape[1])
    vertex_order = permutations[codes[facets[:, 1]]]
    plus_order = np.take_along_axis(pairs.match, vertex_order, axis=1)
    fits = (permutations == plus_order[:, None]).all(axis=2)
    codes[facets[:, 0]] = fits.argmax(axis=1)
    return IntegratedPairs(entities=entities.astype(np.int32), vertex_order=vertex_order)


def vertex_permutations(num_vertices: int) -> Ints:
    """Return the vertex permutation of each DOLFINx facet code, shape (codes, num_vertices)."""
    corners = basix.cell.geometry(facet_cell_type(num_vertices))
    permuted = [
        dolfinx_versions.permuted_points(num_vertices, corners, code)
        for code in range(2 if num_vertices == 2 else 2 * num_vertices)
    ]
    distances = np.linalg.norm(np.array(permuted)[:, :, None] - corners, axis=3)
    return distances.argmin(axis=2)


class JointSurface:
    """Mesh of the - faces of joints, made by `JointedMesh.surface`.

    Use functions and arguments on this mesh in forms over `JointedMesh.dS`, restricted to either
    side, for example ``k("-")``, and compile the form by `JointedMesh.form`. Lagrange functions are
    continuous along the - faces, also where several joints of one surface meet.

    Attributes:
        mesh: The mesh. A cell is on the rank that integrates over its facet pair; a rank may have
            no cell.
        joints: Positions of the joints in the list of joint names, ascending.
        cell_tags: Position of each cell's joint, plus one.
        number: Position of the facet pair of each cell on this rank, shape (n,).
        vertex_order: `IntegratedPairs.vertex_order` of each cell.
        entity_maps: Entity maps for `dolfinx.fem.form`.
    """

    def __init__(
        self,
        body: dolfinx.mesh.Mesh,
        pairs: JointPairs,
        integrated: IntegratedPairs,
        joints: tuple[int, ...],
    ) -> None:
        """Create the mesh (collective)."""
        self.joints = joints
        chosen = np.flatnonzero(np.isin(pairs.joint, joints))
        tdim = body.topology.dim
        of_cell, first = (
            getattr(body.topology.connectivity(tdim, tdim - 1), name)
            for name in ("array", "offsets")
        )
        entities = integrated.entities[chosen]
        plus, minus = (of_cell[first[entities[:, k]] + entities[:, k + 1]] for k in (0, 2))
        self.mesh, facets = dolfinx_versions.create_submesh(body, tdim - 1, np.sort(minus))
        order = np.argsort(minus)
        position: Ints = order[np.searchsorted(minus[order], facets)]
        self.number = chosen[position]
        self.vertex_order = integrated.vertex_order[chosen[position]]
        cells = np.arange(len(facets), dtype=np.int32)
        tags = (pairs.joint[self.number] + 1).astype(np.int32)
        self.cell_tags = dolfinx.mesh.meshtags(self.mesh, tdim - 1, cells, tags)
        cell = np.empty_like(minus)
        cell[position] = cells
        self.entity_maps = dolfinx_versions.surface_entity_maps(
            body, self.mesh, np.concatenate([plus, minus]), np.concatenate([cell, cell])
        )

    def quadrature_space(
        self, quadrature: str | int, degree: int, shape: tuple[int, ...] = ()
    ) -> fem.FunctionSpace:
        """Return the space of values (``shape``) at the quadrature points of `JointedMesh.dS`."""
        points, weights = facet_rule(self.vertex_order.shape[1], degree, quadrature)
        element = basix.ufl.quadrature_element(
            self.mesh.topology.cell_name(), value_shape=shape, points=points.copy(), weights=weights
        )
        return fem.functionspace(self.mesh, element)


def compiled(
    form: Any,
    surfaces: Iterable[JointSurface],
    joints_of: Callable[[Any], set[int] | None],
    minus: set[int],
) -> fem.Form:
    """Compile a form with the entity maps of the joint surfaces that occur in it.

    Args:
        form: A UFL form.
        surfaces: All surfaces that may occur.
        joints_of: Returns the positions of the joints of an integral over `JointedMesh.dS`, and
            None for other integrals.
        minus: Tags of the - sides.

    Raises:
        MeshError: A function on a surface is integrated over anything other than its joints or
            - sides.
    """
    by_domain = {surface.mesh.ufl_domain(): surface for surface in surfaces}
    needed: dict[Any, JointSurface] = {}
    for integral in form.integrals():
        domains = extract_domains(integral.integrand())
        used = {domain: by_domain[domain] for domain in domains if domain in by_domain}
        if not used or integral.ufl_domain() in by_domain:  # integral over the surface itself
            continue
        needed |= used
        joints = joints_of(integral)
        if joints is None:
            tags = set(np.atleast_1d(integral.subdomain_id()).tolist())
            if integral.integral_type() != "exterior_facet" or not tags <= minus:
                raise MeshError(
                    "The form integrates a function on a joint surface over another measure than "
                    "jointed.dS, or ds of a - side."
                )
        elif any(joints - set(surface.joints) for surface in used.values()):
            raise MeshError(
                "The form integrates a function over joints that are not in its surface; use the "
                "same joints in dS and surface."
            )
    maps = [surface.entity_maps for surface in needed.values()]
    return fem.form(form, entity_maps=dolfinx_versions.merged_entity_maps(maps))
