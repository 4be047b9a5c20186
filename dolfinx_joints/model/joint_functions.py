# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint results as DOLFINx Functions on the joint surface, for forms and for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import basix
import numpy as np
from dolfinx import fem

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.parameters import check_kind_of
from dolfinx_joints.joints.form_operator import PointExchange
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.mesh.facet_quadrature import facet_cell_type
from dolfinx_joints.model.model import Model


class JointFunctions:
    """Gap, traction, slip and status of joints as Functions at the joint points of the model.

    They are zero until `update`. Use them in forms with `dS`, for example ``traction("-")``, and
    compile the forms with `JointedMesh.form`. Components are along the local axes (n, s1, s2) as in
    results files, except that ``traction_vector`` has global components: the joint exerts the force
    - int traction_vector dS on its + side and + int traction_vector dS on its - side.

    Args:
        model: The model, with joints.
        joints: Name of a joint, several names, or None for all joints.

    Attributes:
        surface: The `JointSurface` on which the Functions are defined.
        dS: Measure of the joints with the model's quadrature rule.
        gap: Gap, initial gap included, 3 components, [m].
        traction: Traction, 3 components, [Pa].
        traction_vector: Traction in global axes, gdim components, [Pa].
        slip: Tangential gap minus its elastic part; the first component is 0, [m].
        status: 0 open, 1 sticking, 2 sliding, 3 closed without friction, 4 tied, as `Status`.

    Raises:
        MeshError: The model has no joint with a law, or no joint of this name.
    """

    def __init__(self, model: Model, joints: str | Sequence[str] | None = None) -> None:
        """Create the Functions (collective)."""
        if model.operator is None or model.contact is None:
            raise MeshError(
                "The model has no joint with a law, so there are no functions on joints."
            )
        self._operator, jointed = model.operator, model.jointed
        self._shown_status = model.contact.shown_status
        rule = model.operator.quadrature, model.V.ufl_element().degree
        self.surface = jointed.surface(joints)
        self.dS = jointed.dS(joints, quadrature=rule[0], degree=rule[1])
        self._exchange = PointExchange(
            self.surface, model.operator.layout, len(model.operator.areas)
        )
        self._fit = _fit(model.operator.layout.rule, self.surface.vertex_order.shape[1])
        sizes = {"gap": 3, "traction": 3, "traction_vector": model.gdim, "slip": 3, "status": 0}
        self._shapes = {name: (size,) if size else () for name, size in sizes.items()}
        made = [
            fem.Function(self.surface.quadrature_space(*rule, shape), name=name)
            for name, shape in self._shapes.items()
        ]
        self.gap, self.traction, self.traction_vector, self.slip, self.status = self._at_points = (
            made
        )

    @cached_property
    def fields(self) -> dict[str, fem.Function]:
        """Discontinuous Lagrange Functions for ParaView, by name (collective).

        `update` sets them after the first access. With the rules ``nodal`` and ``gauss`` they equal
        the values at the points. With ``auto`` on 6-node triangles and with other Gauss rules on
        triangles, they are a least-squares fit: the rule has more points than coefficients.
        """
        degree, _ = self._fit
        made = {
            name: fem.Function(
                fem.functionspace(self.surface.mesh, ("Discontinuous Lagrange", degree, shape)),
                name=name,
            )
            for name, shape in self._shapes.items()
        }
        self._fill(made)
        return made

    def update(self, state: Any) -> None:
        """Set the Functions to a state (collective).

        Args:
            state: The `Response` of the joints, or an object with this attribute ``joints``: the
                result of ``Simulation.statics``, ``outcome.state`` of a dynamic stage, or the
                ``Record`` of a monitor.
        """
        response = getattr(state, "joints", state)
        wanted = "a StaticState, DynamicState, Record or Response of joints"
        check_kind_of("state", response, isinstance(response, Response), wanted)
        given, expected = len(response.traction), len(self._operator.areas)
        if given != expected:
            raise ValueError(f"The state has {given} points on this rank, the model {expected}.")
        axes = self._operator.frames[:, :, : self.surface.mesh.geometry.dim]
        values = (
            response.state.gap,
            response.traction,
            np.einsum("nki,nk->ni", axes, response.traction),
            np.pad(response.state.gap[:, 1:] - response.state.elastic_slip, ((0, 0), (1, 0))),
            self._shown_status(response.status)[:, None].astype(np.float64),
        )
        for function, point_values in zip(self._at_points, values, strict=True):
            self._exchange.set_function(function, point_values)
        if "fields" in self.__dict__:
            self._fill(self.fields)

    def _fill(self, fields: dict[str, fem.Function]) -> None:
        """Set the fields from the values at the points."""
        _, fit = self._fit
        for source, field in zip(self._at_points, fields.values(), strict=True):
            at_points, nodes = (f.function_space.dofmap.list for f in (source, field))
            size = field.function_space.dofmap.index_map_bs
            values = source.x.array.reshape(-1, size)[at_points]
            field.x.array.reshape(-1, size)[nodes] = np.einsum("aq,fqk->fak", fit, values)


def _fit(rule: Floats, corners: int) -> tuple[int, Floats]:
    """Return the largest polynomial degree that a facet's points determine, and a matrix.

    The matrix, shape (nodes, q), maps values at the points to values at the Lagrange nodes.
    ``rule`` has the points, shape (q, facet dimension); ``corners`` is the number of vertices.
    """
    kind, degree, matrix = facet_cell_type(corners), 0, np.full((1, len(rule)), 1.0 / len(rule))
    while True:
        element = basix.create_element(
            basix.ElementFamily.P,
            kind,
            degree + 1,
            basix.LagrangeVariant.gll_warped,
            discontinuous=True,
        )
        table = element.tabulate(0, rule)[0, :, :, 0]
        if np.linalg.matrix_rank(table) < element.dim:
            return degree, matrix
        degree, matrix = degree + 1, np.linalg.pinv(table)
