# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models that depend on named parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from math import inf, isnan
from typing import Any
from weakref import WeakKeyDictionary

from dolfinx_joints.body.supports import Spring
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import check_kind_of, check_named, check_number, real, shown
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.loads.load import check_loads
from dolfinx_joints.loads.temperature.thermal_strain import check_temperatures
from dolfinx_joints.model.model import Model
from dolfinx_joints.model.parts import Joints, check_joints

# Distance of the two models of a difference quotient, on both sides of a value, relative to the
# standard deviation. Matrices and loads are mostly linear in a parameter, and their quotients
# exact; otherwise the relative error is of order 1e-6, far below that of any measurement.
DIFFERENCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Uncertain number of a model.

    Attributes:
        value: Mean before any measurement; runs begin with it.
        deviation: Standard deviation before any measurement.
        lower: Smallest value; minus infinity by default.
        upper: Largest value; infinity by default.
        unit: Unit, for tables.
    """

    value: float
    deviation: float
    lower: float = -inf
    upper: float = inf
    unit: str = ""

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_number("Parameter: deviation", self.deviation, lambda x: x > 0.0, "positive")
        for name in ("lower", "upper"):
            end = getattr(self, name)
            check_kind_of(f"Parameter: {name}", end, not isnan(real(end)), "a number or infinite")
        between = f"a number from lower, {self.lower}, to upper, {self.upper}"
        check_number("Parameter: value", self.value, self.allows, between)

    def allows(self, value: float) -> bool:
        """Return True if a value is between the bounds."""
        return self.lower <= value <= self.upper and self.lower < self.upper


class ParametricModel:
    """Function that builds a model from the values of named parameters.

    Args:
        build: Function that returns a new model for values by parameter name (collective).
            `changed_model` is faster than `Model` if little depends on the parameters.
        parameters: The parameters by name.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> base = [dj.Fixed(group="base")]
        >>> law = dj.frictionless(normal_stiffness=1e10)
        >>> def build(values):
        ...     concrete = dj.Elastic(young=values["E"], poisson=0.2, density=2400.0)
        ...     return dj.Model(mesh, material=concrete, joints=law, supports=base)
        >>> young = dj.Parameter(value=24e9, deviation=4e9, unit="Pa")
        >>> model = dj.ParametricModel(build, {"E": young}).model({"E": 30e9})
        >>> model.parameters["material"].young
        30000000000.0
    """

    def __init__(
        self, build: Callable[[Mapping[str, float]], Model], parameters: Mapping[str, Parameter]
    ) -> None:
        """Check the arguments."""
        check_kind_of("build", build, callable(build), "a function of values by name")
        check_named("parameters", parameters, "a Parameter by name")
        check_kind_of("parameters", parameters, bool(parameters), "at least one Parameter by name")
        for name, parameter in parameters.items():
            good = isinstance(parameter, Parameter)
            check_kind_of(f"The parameter {shown(name)}", parameter, good, "a Parameter")
        self.parameters = dict(parameters)
        self._build = build
        self._values: WeakKeyDictionary[Model, dict[str, float]] = WeakKeyDictionary()

    def model(self, values: Mapping[str, float] | None = None) -> Model:
        """Build the model for values by name; others have the means (collective).

        Raises:
            ValueError: A name is not a parameter, or a value is not between its bounds.
        """
        check_named("values", values or {}, "a number by parameter name")
        for name, value in (values or {}).items():
            if name not in self.parameters:
                names = ", ".join(self.parameters)
                raise ValueError(f"{shown(name)} is not a parameter; the parameters are {names}.")
            limits = self.parameters[name]
            between = f"a number from {limits.lower:g} to {limits.upper:g}"
            check_number(f"The parameter {name!r}", value, limits.allows, between)
        given = {name: parameter.value for name, parameter in self.parameters.items()}
        given |= {name: float(value) for name, value in (values or {}).items()}
        model = self._build(dict(given))
        check_kind_of("The result of build", model, isinstance(model, Model), "a Model")
        if self._values.setdefault(model, given) != given:
            raise JointsError(
                "build returned the same model for different values; it must return a new model, "
                "such as changed_model(model, joints=...)."
            )
        return model

    def values_of(self, model: Model) -> dict[str, float]:
        """Return the values of a model that `model` returned."""
        if model not in self._values:
            raise JointsError(
                "The run has another model; run ParametricModel.model(values) for derivatives by "
                "its parameters."
            )
        return self._values[model]

    def around(self, name: str, values: Mapping[str, float]) -> tuple[Model, Model, float]:
        """Return models with a smaller and a larger value, and the difference (collective)."""
        parameter, value = self.parameters[name], values[name]
        low = max(value - DIFFERENCE * parameter.deviation, parameter.lower)
        high = min(value + DIFFERENCE * parameter.deviation, parameter.upper)
        models = [self.model({**values, name: v}) for v in (low, high)]
        fixed = [[s for s in m.supports if not isinstance(s, Spring)] for m in models]
        if fixed[0] != fixed[1]:
            raise JointsError(
                f"The parameter {name!r} changes supports; gradients include Springs only."
            )
        return models[0], models[1], high - low


def changed_model(model: Model, **arguments: Any) -> Model:
    """Return a model with changed arguments (collective).

    Matrices are assembled again only if another argument than ``joints`` or ``loads`` changes.

    Args:
        model: The model, which does not change.
        arguments: Arguments of `Model` by name, such as ``joints``, ``material`` or ``loads``.
    """
    if unknown := arguments.keys() - model.parameters.keys():
        names = ", ".join(model.parameters)
        raise ValueError(f"Model has no argument {unknown.pop()!r}; the arguments are {names}.")
    given = model.parameters | arguments
    kept = {k for k, v in model.parameters.items() if given[k] is v}
    if given["material"] == model.parameters["material"]:
        kept.add("material")
    joints = given["joints"]
    joints = given["joints"] = joints if isinstance(joints, Joints) else Joints(joints)
    others = model.parameters.keys() - kept - {"joints", "loads"}
    others |= {"rule"} if joints.quadrature != model.parameters["joints"].quadrature else set()
    others |= {"laws"} if model.bulk is not None or model.damped_modes is not None else set()
    if others or joints.laws is None or model.operator is None:
        return Model(model.jointed, **given)
    check_joints(model.jointed, joints.laws, joints.initial_gaps)
    changed = copy(model)
    changed.parameters, changed.loads = given, list(given["loads"])
    material = given["material"]
    by_group = material if isinstance(material, Mapping) else {"": material}
    check_loads(model.jointed, changed.loads)
    check_temperatures(model.jointed, by_group, changed.loads)
    changed.contact = Contact(model.operator, joints.laws, joints.initial_gaps)
    return changed
