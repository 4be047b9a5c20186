# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of matrices, loads and joints by parameters of a model; derivatives of frequencies.

The derivatives are differences of two models, see `ParametricModel.around`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.body.matrices import without_zeros
from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.mpi import summed
from dolfinx_joints.gradient.law_slopes import parameters_of
from dolfinx_joints.gradient.parametric import ParametricModel
from dolfinx_joints.gradient.tape import LoadsAt, Step
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.loads.load import load_names
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.modes import SAME_FREQUENCY, modes, number_of_modes
from dolfinx_joints.model.system import MatrixSystem, as_aij


class ModelSlopes:
    """Derivatives by one parameter.

    Args:
        parametric: The parametric model.
        name: Name of the parameter.
        model: Model of the run.
        steps: Steps of the run, for derivatives of their loads and of C.

    Attributes:
        stiffness, mass, damping: Derivatives of K, M and C, None if zero.
        tangent: Derivative of the tangents of closed, sticking points, shape (n, 3, 3).
        joints: Derivatives of the parameters of the joint points by name, shape (n,).
    """

    def __init__(
        self,
        parametric: ParametricModel,
        name: str,
        model: Model,
        steps: Sequence[Step] = (),
    ) -> None:
        """Compute the differences (collective)."""
        low, high, difference = parametric.around(name, parametric.values_of(model))
        self._pair, self._difference = (low, high), difference
        self.stiffness = self._slope(low.stiffness, high.stiffness)
        self.mass = self._slope(low.mass, high.mass)
        self.damping: PETSc.Mat | None = None
        if any(step.scheme is not None for step in steps):
            self.damping = self._slope(*(m.system(only=()).damping for m in self._pair))
        contacts = [m.contact for m in self._pair]
        values = [_joint_values(name, c, model.contact) for c in contacts]
        self.joints = {n: (values[1][n] - v) / difference for n, v in values[0].items()}
        tangents = [0.0 if c is None else c.closed_tangent() for c in contacts]
        self.tangent: Any = (tangents[1] - tangents[0]) / difference
        systems = {id(at.system): at.system for step in steps for at in step.loads}
        self._loads = {key: self._patterns(s, model) for key, s in systems.items()}
        del self._pair

    def _slope(self, low: PETSc.Mat, high: PETSc.Mat) -> PETSc.Mat | None:
        """Return the derivative of a matrix without its zeros, None if all are zero."""
        if low is high:
            return None
        change = as_aij(high)
        change.axpy(-1.0, as_aij(low), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        change.scale(1.0 / self._difference)
        return without_zeros(change) if change.norm() else None

    def _patterns(self, system: MatrixSystem, model: Model) -> list[list[tuple[Any, Any]]]:
        """Return the patterns of the loads in both models, without those that are equal."""
        added = [load for load in system.loads.values() if all(load is not m for m in model.loads)]
        expected, pair = load_names([*model.loads, *added]), []
        for changed in self._pair:
            loads = [*changed.loads, *added]
            by_name = dict(zip(load_names(loads), loads, strict=True))
            if list(by_name) != expected:
                raise JointsError(
                    "A parameter adds or removes loads; it may only change them: "
                    f"{', '.join(by_name) or 'no load'} instead of {', '.join(expected)}."
                )
            pair.append([by_name[n] for n in system.loads])
        low, high = self._pair
        same_body = low.stiffness is high.stiffness
        patterns: list[list[tuple[Any, Any]]] = [[], []]
        for load, other in zip(*pair, strict=True):
            if load is other and same_body:
                continue
            for i, (changed, its_load) in enumerate(((low, load), (high, other))):
                patterns[i] += its_load.patterns(changed)
        return patterns

    def of_loads(self, loads: Sequence[LoadsAt], z: PETSc.Vec) -> float:
        """Return the derivative of the product of loads and a vector z (collective)."""
        total = 0.0
        for system, time, weight in loads:
            for patterns, sign in zip(self._loads[id(system)], (-1.0, 1.0), strict=True):
                if patterns:
                    products = z.mDot([vector for vector, _ in patterns])
                    factors = [factor(time) for _, factor in patterns]
                    total += sign * weight * float(np.dot(factors, products))
        return total / self._difference

    def of_forces(self, fields: Sequence[PETSc.Vec], z: PETSc.Vec, work: PETSc.Vec) -> float:
        """Return the derivative of z.(K u + C v + M a) for given u, or u, v and a (collective)."""
        total, matrices = 0.0, (self.stiffness, self.damping, self.mass)
        for matrix, vector in zip(matrices, fields, strict=False):
            if matrix is not None:
                matrix.mult(vector, work)
                total += float(z.dot(work))
        return total


def _joint_values(name: str, contact: Contact | None, recorded: Contact | None) -> dict[str, Any]:
    """Return the parameters of the joint points by name, shape (n,)."""
    if contact is None or recorded is None:
        return {}
    kinds = [{n: type(law) for n, law in c.laws.items()} for c in (contact, recorded)]
    if kinds[0] != kinds[1]:
        raise JointsError(f"The parameter {name!r} changes the type of a joint law.")
    values: dict[str, Floats] = {}
    for part in contact.parts:
        for parameter in parameters_of(part.law):
            at = values.setdefault(parameter, np.zeros(len(contact.operator.joint)))
            at[part.points] = getattr(part.law, parameter)
    return values | {"initial_gap": contact.initial_gap[:, 0]}


def frequencies(
    parametric: ParametricModel, values: Mapping[str, float] | None, count: int
) -> tuple[Floats, Floats]:
    """Return natural frequencies with closed joints, and their derivatives (collective).

    The derivative of omega^2 is phi.(K' - omega^2 M') phi for phi.M phi = 1 (46).

    Args:
        parametric: The parametric model.
        values: Values of the parameters by name; others have their means.
        count: Number of the lowest modes.

    Returns:
        The frequencies [Hz], shape (count,), and derivatives, shape (count, parameters).

    Raises:
        JointsError: Two frequencies are equal, so that they have no derivatives.
    """
    model = parametric.model(values)
    system = model.system(only=())
    next_too = min(count + 1, number_of_modes(system))
    lowest = modes(system, max(count, next_too))
    f = lowest.frequencies
    if (np.diff(f) < SAME_FREQUENCY * f[1:]).any():
        raise JointsError(f"Equal frequencies have no derivatives: {f.round(6).tolist()} Hz.")
    f, shapes = f[:count], lowest.shapes[:count]
    derivatives = np.zeros((count, len(parametric.parameters)))
    work = shapes[0].duplicate()
    for j, name in enumerate(parametric.parameters):
        slopes = ModelSlopes(parametric, name, model)
        for i, shape in enumerate(shapes):
            omega = 2.0 * math.pi * f[i]
            change = slopes.of_forces([shape], shape, work)
            if slopes.mass is not None:
                slopes.mass.mult(shape, work)
                change -= omega**2 * float(shape.dot(work))
            if model.operator is not None:
                gaps, areas = model.operator.jump(shape), model.operator.areas
                local = np.einsum("n,ni,nij,nj->", areas, gaps, slopes.tangent, gaps)
                change += float(summed(model.operator.comm, np.array([local]))[0])
            derivatives[i, j] = change / (4.0 * math.pi * omega)
    return f, derivatives
