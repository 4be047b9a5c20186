# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quantities that control a static stage: the gap of a joint or a displacement, linear in u."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.places import extent, nearest_nodes, nodes_of_group
from dolfinx_joints.body.supports import NO_NODE
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.common.parameters import check_vector, shown
from dolfinx_joints.laws.law import Floats
from dolfinx_joints.mesh.cells import Ints
from dolfinx_joints.model.model import Model
from dolfinx_joints.simulation.statics.unfinished import check_joints

Place = Annotated[Sequence[float] | str, at.Unit("m")]
COMPONENTS = ("opening", "s1", "s2")


@dataclass(frozen=True, kw_only=True)
@checked
class ControlledGap:
    """Mean opening or slip of a joint, or its value at a point of the joint.

    Attributes:
        joint: Name of the joint.
        component: ``opening``, or the tangential gap along the axis ``s1`` or ``s2``.
        point: Coordinates [m]; the nearest joint point is used. By default the mean over the area.
    """

    joint: str
    component: Literal["opening", "s1", "s2"] = "opening"
    point: Annotated[Sequence[float] | None, at.Unit("m")] = None

    def __str__(self) -> str:
        """Return the quantity as text."""
        place = "mean" if self.point is None else f"at {shown(tuple(self.point))} m"
        return f"{self.component} of the joint {self.joint!r}, {place}"

    def direction(self, model: Model) -> PETSc.Vec:
        """Return c, the derivative of the quantity by the displacement u (collective)."""
        density = self._density(model)
        assert model.operator is not None
        return model.operator.force(density, model.stiffness.createVecRight())

    def value(self, model: Model, u: PETSc.Vec, gap: Floats) -> float:
        """Return the quantity for gaps of shape (n, 3) [m] (collective)."""
        assert model.operator is not None
        integrand = np.einsum("i,ij,ij->", model.operator.areas, self._density(model), gap)
        return float(summed(model.operator.comm, np.array(integrand)))

    def _density(self, model: Model) -> Floats:
        """Return weights whose integral with the gap is the quantity, (n, 3), [1/m^2]."""
        check_joints(model, [self.joint])
        operator, axis = model.operator, COMPONENTS.index(self.component)
        assert operator is not None
        chosen = operator.joint == operator.names.index(self.joint)
        if self.point is not None:
            place = np.zeros(3)
            place[: model.gdim] = check_vector("point", self.point, (model.gdim,))
            distance = np.linalg.norm(operator.points - place, axis=1)
            distance = np.where(chosen, distance, np.inf)
            nearest = min(operator.comm.allgather(float(distance.min(initial=np.inf))))
            if not nearest <= max(operator.comm.allgather(float(operator.sizes.max(initial=0.0)))):
                raise MeshError(
                    f"The point {shown(tuple(self.point))} is {nearest:.3g} m from the joint "
                    f"{self.joint!r}; give a point on this joint."
                )
            chosen = distance <= nearest + NO_NODE * extent(model.V)
        density = np.zeros((len(chosen), 3))
        area = summed(operator.comm, np.array(operator.areas @ chosen))
        density[chosen, axis] = 1.0 / area
        return density


@dataclass(frozen=True, kw_only=True)
@checked
class ControlledDisplacement:
    """Displacement of a point or group along a direction, or its difference of two places.

    A crack mouth opening displacement (CMOD) is the difference of the
    points on both sides of a notch. At a joint, use `ControlledGap`.

    Attributes:
        along: Vector of the direction, of any length, (gdim,).
        place: Coordinates of a node [m], or the name of a group: the mean of its nodes.
        relative_to: Place whose displacement is subtracted; none by default.
    """

    along: Annotated[Sequence[float], at.Len(2, 3)]
    place: Place
    relative_to: Place | None = None

    def __str__(self) -> str:
        """Return the quantity as text."""
        relative = "" if self.relative_to is None else f" relative to {shown(self.relative_to)}"
        return f"displacement of {shown(self.place)}{relative} along {shown(self.along)}"

    def direction(self, model: Model) -> PETSc.Vec:
        """Return c, the derivative of the quantity by the displacement u (collective)."""
        vector = check_vector("along", self.along, (model.gdim,))
        if not (size := float(np.linalg.norm(vector))) > 0.0:
            raise ValueError("along is zero; give a vector of any length above zero.")
        total, sign = model.stiffness.createVecRight(), 1.0
        total.set(0.0)
        for place in (self.place, self.relative_to):
            if place is not None:
                nodes = _nodes_at(model, place)
                count = sum(model.jointed.mesh.comm.allgather(len(nodes)))
                total.getArray().reshape(-1, model.gdim)[nodes] += sign * vector / (size * count)
            sign = -1.0
        return total

    def value(self, model: Model, u: PETSc.Vec, gap: Floats) -> float:
        """Return the quantity for a displacement [m] (collective)."""
        return float(self.direction(model).dot(u))


ControlledQuantity = ControlledGap | ControlledDisplacement


def _nodes_at(model: Model, place: Sequence[float] | str) -> Ints:
    """Return the owned nodes of a group, or the owned node at a point (collective)."""
    if isinstance(place, str):
        return nodes_of_group(model.jointed, model.V, place)
    point = check_vector("place", place, (model.gdim,)).tolist()
    distance, nodes = nearest_nodes(model.jointed, model.V, point)
    count = sum(model.jointed.mesh.comm.allgather(len(nodes)))
    if count == 1 and distance <= NO_NODE * extent(model.V):
        return nodes
    where = f"{count} nodes, on both sides of a joint; use ControlledGap or the name of a group"
    if count == 1:
        where = f"no node; the nearest is {distance:.3g} m away"
    raise MeshError(f"The place {shown(tuple(point))} has {where}.")
