# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of the faces of joints, for functions that live there, and forms that have some."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import basix.ufl
import dolfinx.mesh
import numpy as np
from dolfinx import fem
from ufl.domain import extract_domains

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.cells import Ints
from dolfinx_joints.mesh.facet_quadrature import facet_rule
from dolfinx_joints.mesh.joint_facets import IntegratedPairs
from dolfinx_joints.mesh.joint_pairs import JointPairs


class JointSurface:
    """The - faces of joints as a mesh of their own, from `JointedMesh.surface`.

    Functions and arguments on it stand for the joint: a form over `JointedMesh.dS` takes them with
    either restriction, ``k("-")``, and `JointedMesh.form` compiles it. Continuous functions are so
    along the nodes of the - faces, on a surface of several joints also where these meet.

    Attributes:
        mesh: The mesh; each cell is on the rank that integrates over its pair, some ranks may have
            none.
        joints: Positions of the joints among their names, ascending.
        cell_tags: Position of the joint of each cell, plus one.
        number: Position of the facet pair of each cell among those of this rank, shape (n,).
        turned: `IntegratedPairs.turned` of each cell.
        entity_maps: What `dolfinx.fem.form` needs to find the cells.
    """

    def __init__(
        self,
        body: dolfinx.mesh.Mesh,
        pairs: JointPairs,
        here: IntegratedPairs,
        joints: tuple[int, ...],
    ) -> None:
        """Make the mesh (collective)."""
        self.joints = joints
        chosen = np.flatnonzero(np.isin(pairs.joint, joints))
        tdim = body.topology.dim
        of_cell, first = (
            getattr(body.topology.connectivity(tdim, tdim - 1), name)
            for name in ("array", "offsets")
        )
        entities = here.entities[chosen]
        plus, minus = (of_cell[first[entities[:, k]] + entities[:, k + 1]] for k in (0, 2))
        self.mesh, facets = dolfinx_versions.create_submesh(body, tdim - 1, np.sort(minus))
        order = np.argsort(minus)
        position: Ints = order[np.searchsorted(minus[order], facets)]
        self.number = chosen[position]
        self.turned = here.turned[chosen[position]]
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
        """Space with values of a shape at quadrature points, as `JointedMesh.dS` takes these."""
        points, weights = facet_rule(self.turned.shape[1], degree, quadrature)
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
    """A form compiled with the entity maps of the joint surfaces that occur in it.

    Args:
        form: A UFL form.
        surfaces: The surfaces to look among.
        joints_of: Gives the positions of the joints of an integral over `JointedMesh.dS`, None for
            others.
        minus: Tags of the - sides.

    Raises:
        MeshError: Functions on a surface stand under another measure than that of its joints, or of
            - sides.
    """
    by_domain = {surface.mesh.ufl_domain(): surface for surface in surfaces}
    needed: dict[Any, JointSurface] = {}
    for integral in form.integrals():
        domains = extract_domains(integral.integrand())
        found = {each: by_domain[each] for each in domains if each in by_domain}
        if not found or integral.ufl_domain() in by_domain:  # the latter on the surface itself
            continue
        needed |= found
        joints = joints_of(integral)
        if joints is None:
            tags = set(np.atleast_1d(integral.subdomain_id()).tolist())
            if integral.integral_type() != "exterior_facet" or not tags <= minus:
                raise MeshError(
                    "The form has a function on a joint surface under another measure than "
                    "jointed.dS, or ds of a - side."
                )
        elif any(joints - set(surface.joints) for surface in found.values()):
            raise MeshError(
                "The form goes over joints that the surface of a function in it leaves out; let dS "
                "and surface have the same joints."
            )
    maps = [surface.entity_maps for surface in needed.values()]
    return fem.form(form, entity_maps=dolfinx_versions.merged_entity_maps(maps))
