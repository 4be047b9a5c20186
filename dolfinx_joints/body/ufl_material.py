# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials in UFL: a stored energy or a stress as a function of the strain tensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import ufl
from ufl.algorithms import strip_variables
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.joints.ufl_points import UflPoints
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.materials.numpy_material import EndPointMaterial, PointResponse, check_internal
from dolfinx_joints.materials.orthotropic import Orthotropic

# Positions in the stress tensor of the components xx, yy, zz, yz, xz, xy.
_COMPONENTS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))

# Largest difference of s_ij and s_ji, divided by the largest stress or tangent times strain; a
# relaxed stress is a difference of larger terms with their rounding errors.
_ASYMMETRY = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
@checked
class UflMaterial(EndPointMaterial):
    """Material with a stored energy psi(strain, variables) or a stress in UFL; small strains.

    Example::

        material = UflMaterial(
            energy=lambda e, kappa: (1 - damage(kappa)) * psi(e),
            internal={"kappa": (1e-4, lambda e, kappa, dt: ufl.max_value(kappa, ufl.tr(e)))},
            elastic=elastic,
        )

    ``energy`` and ``stress`` receive the strain tensor, shape (3, 3) also in plane models, and the
    internal variables of the same time in their order. An update receives the strain at the end of
    the step, the variables at its start, and the step length dt [s]: zero in the ramps of
    ``statics``, the time between its times in ``quasi_statics``. UFL computes the derivatives.

    Without internal variables and with ``energy`` alone the material is reversible, and the
    default scheme conserves its energy exactly. Otherwise the mean of start and end stress acts
    over a step. Its work minus the change of ``energy`` (all work without ``energy``) counts as
    loss, so the energy balance does not check the law.

    Attributes:
        energy: Function that returns psi [J/m^3], a UFL scalar.
        stress: Function that returns the stress [Pa], shape (3, 3); by default the derivative of
            ``energy`` by the strain at constant variables.
        internal: Initial value and update of each internal variable by name. An initial value is
            a number, an array, or a function of the sizes of the cells, shape (n,), [m].
        elastic: Elastic material for the density, the matrix K, modes and damping.

    Raises:
        ValueError: A function does not return a UFL expression of its arguments of correct shape,
            returns NaN, or stress and energy are not zero at zero strain.
    """

    energy: Callable[..., Any] | None = None
    stress: Callable[..., Any] | None = None
    internal: Mapping[str, tuple[Any, Callable[..., Any]]] = field(default_factory=dict)
    elastic: Elastic | Orthotropic
    _points: UflPoints = field(init=False)

    def __post_init__(self) -> None:
        owner, internal = type(self).__name__, self.internal
        wanted = '{"name": (initial value, update function), ...}'
        fits = lambda item: isinstance(item, tuple) and len(item) == 2 and callable(item[1])  # noqa: E731
        check_internal(owner, internal, wanted, fits)
        if self.energy is None and self.stress is None:
            raise ValueError(f"{owner}: energy and stress are missing; give one of them or both.")
        initials = {name: initial for name, (initial, _) in internal.items()}
        object.__setattr__(self, "initials", initials)
        object.__setattr__(self, "reversible", self.stress is None and not internal)
        shapes = self.internal_variables
        points = UflPoints(owner, {**shapes, " dt": ()}, "strain", 6)
        object.__setattr__(self, "_points", points)
        *old, dt = points.internal
        strain = ufl.variable(_tensor(points.gap))
        psi = points.expression("energy", self.energy or (lambda *_: 0.0), (), (strain, *old))
        if self.stress is None:
            stress, skew = ufl.diff(psi, points.gap), []
        else:
            tensor = points.expression("stress", self.stress, (3, 3), (strain, *old))
            stress = ufl.as_vector([tensor[i, j] for i, j in _COMPONENTS])
            skew = [tensor[i, j] - tensor[j, i] for i, j in _COMPONENTS[3:]]
        updates = {
            variable: points.expression(
                f"the update of {name}", internal[name][1], shape, (strain, *old, dt)
            )
            for variable, (name, shape) in zip(old, shapes.items(), strict=True)
        }
        # Evaluate derivatives in the stress before the variables become functions of the strain.
        ended = [
            ufl.replace(apply_derivatives(apply_algebra_lowering(part)), updates)
            for part in (stress, psi, *skew)
        ]
        tangent = ufl.diff(ended[0], points.gap)
        points.compile("end", ended[0], tangent, ended[1], *updates.values(), *ended[2:])
        self._check()

    def __repr__(self) -> str:
        """Return the expressions as UFL text, and the elastic part."""
        tensor = str(_tensor(strip_variables(self._points.gap)))
        return self._points.as_text(elastic=self.elastic).replace(tensor, "strain")

    def function(self, strain: Floats, internal: Floats, dt: float) -> PointResponse:
        """Return the response at the end of a step; see `EndPointMaterial`."""
        steps = np.full((len(strain), 1), dt)
        values = self._points.evaluate("end", strain, internal, steps)
        stress, count = np.ascontiguousarray(values[:, :6]), 43 + internal.shape[1]
        skew = np.abs(values[:, count:]).max(initial=0.0)
        tangent = np.ascontiguousarray(values[:, 6:42]).reshape(-1, 6, 6)
        stiffness, *sizes = (np.abs(a).max(initial=0.0) for a in (tangent, strain, stress))
        if skew > _ASYMMETRY * max(stiffness * sizes[0], sizes[1]):
            raise ValueError(
                f"{type(self).__name__}: stress is not symmetric: components differ by "
                f"{skew:.3g} Pa. Write it with the strain tensor, which is symmetric."
            )
        return PointResponse(stress, tangent, values[:, 42].copy(), values[:, 43:count].copy())


def _tensor(strain: Any) -> Any:
    """Return the strain tensor (UFL) of a vector (xx, yy, zz, 2 yz, 2 xz, 2 xy)."""
    xx, yy, zz, yz, xz, xy = (strain[i] * (1.0 if i < 3 else 0.5) for i in range(6))
    return ufl.as_tensor([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
