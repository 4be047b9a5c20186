# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws in UFL: a stored energy or a traction as a function of the gap vector.

The gap (n, s1, s2) consists of the normal gap, including the initial gap, and the slip relative to
the state at rest. UFL computes the derivatives, FFCx generates the C code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np
import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.parameters import real, shown
from dolfinx_joints.joints.ufl_points import UflPoints
from dolfinx_joints.laws.law import Floats, JointState, Losses, Response, Status
from dolfinx_joints.laws.losses import work
from dolfinx_joints.laws.path_mean import path_mean


@dataclass(frozen=True, eq=False, repr=False)
@checked
class PotentialJoint:
    """Reversible joint law with the traction t = d psi / d gap of a stored energy psi(gap).

    Example::

        law = PotentialJoint(
            lambda g: 0.5 * k_n * ufl.min_value(g[0], 0.0) ** 2,
            normal_stiffness=k_n,
            shear_stiffness=0.0,
        )

    The traction may have kinks, as here at g[0] = 0, but no jumps. The energy-consistent scheme
    uses the mean traction over the path of a step (`path_mean`).

    Attributes:
        energy: Function of the gap (a UFL vector) that returns psi [J/m^2] (a UFL scalar).
        normal_stiffness: k_n of the closed joint, for modes and singular tangents.
        shear_stiffness: k_s of the closed joint, for modes and singular tangents.

    Raises:
        ValueError: ``energy`` does not return a scalar expression that depends only on the gap.
    """

    energy: Callable[[Any], Any]
    _: KW_ONLY
    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]
    _points: UflPoints = field(init=False)

    def __post_init__(self) -> None:
        points = UflPoints(type(self).__name__)
        psi = points.expression("energy", self.energy)
        traction = ufl.diff(psi, points.gap)
        points.compile("energy", psi)
        points.compile("traction", traction, ufl.diff(traction, points.gap))
        object.__setattr__(self, "_points", points)

    def __repr__(self) -> str:
        """Return the energy as UFL text, and the stiffness."""
        return self._points.as_text(**_stiffness(self))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Return psi of each point, shape (n,), [J/m^2]."""
        return self._points.evaluate("energy", _gap_of(state))[:, 0]

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return the response at a gap of shape (n, 3), [m], which does not depend on history."""
        after = _after(gap, state)
        return _response(after, *self._tractions(_gap_of(after)))

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Return the mean traction of a step; its work equals the change of psi (`path_mean`)."""
        after = _after(gap, state)
        return _response(after, *path_mean(self._tractions, _gap_of(state), _gap_of(after)))

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses: work of (traction - mean traction over the path)."""
        start, end = _gap_of(before), _gap_of(answer.state)
        mean, _ = path_mean(self._tractions, start, end)
        return Losses(answer.dissipation, work(traction - mean, end - start))

    def _tractions(self, gap: Floats) -> tuple[Floats, Floats]:
        values = self._points.evaluate("traction", gap)
        return values[:, :3], values[:, 3:].reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False, repr=False)
@checked
class TractionJoint:
    """Joint law with a traction t(gap, internal variables) at the end of a step.

    Example::

        law = TractionJoint(
            lambda g, kappa: ufl.as_vector([k_n * ufl.exp(-kappa / length) * g[0], 0.0, 0.0]),
            internal={"kappa": (0.0, lambda g, kappa: ufl.max_value(kappa, g[0]))},
            normal_stiffness=k_n,
            shear_stiffness=0.0,
        )

    Internal variables are scalars. Update functions receive the gap at the end of the step and the
    variables at the start of the step. Traction and energy receive gap and variables of the same
    time. In ``traction``, ``ufl.diff(psi(g, kappa), g)`` keeps the variables fixed.

    All schemes use the traction at the end of the step (backward Euler). The dissipation is the
    work of the mean of start and end traction minus the change of the stored energy. The numerical
    loss is obtained by difference, so the energy balance does not check the law (`LawWithLosses`).
    Without ``energy`` all work counts as dissipation, so an elastic joint that returns energy has
    negative dissipation.

    Attributes:
        traction: Function of the gap (n, s1, s2) and the internal variables in their order that
            returns t [Pa], a UFL vector of three components.
        internal: Initial value and update function of each internal variable by name.
        energy: Function of the same arguments that returns the stored energy [J/m^2], or None.
        normal_stiffness: k_n of the closed joint, for modes and singular tangents.
        shear_stiffness: k_s of the closed joint, for modes and singular tangents.

    Raises:
        ValueError: A function does not return a UFL expression of its arguments of correct shape.
    """

    traction: Callable[..., Any]
    _: KW_ONLY
    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]
    internal: Mapping[str, tuple[float, Callable[..., Any]]] = field(default_factory=dict)
    energy: Callable[..., Any] | None = None
    _points: UflPoints = field(init=False)

    def __post_init__(self) -> None:
        owner, internal = type(self).__name__, self.internal
        _check_internal(owner, internal)
        points = UflPoints(owner, dict.fromkeys(internal, ()))
        traction = points.expression("traction", self.traction, (3,))
        psi = points.expression("energy", self.energy or (lambda *_: 0.0))
        updates = [
            points.expression(f"the update of {name}", update)
            for name, (_, update) in internal.items()
        ]
        points.compile("state", psi, traction)
        # Evaluate derivatives in the traction before the variables become functions of the gap.
        ended = apply_derivatives(apply_algebra_lowering(traction))
        ended = ufl.replace(ended, dict(zip(points.internal, updates, strict=True)))
        points.compile("end", ended, ufl.diff(ended, points.gap), *updates)
        object.__setattr__(self, "_points", points)

    def __repr__(self) -> str:
        """Return the expressions as UFL text, initial values and stiffness."""
        first = {name: float(value) for name, (value, _) in self.internal.items()}
        return self._points.as_text(**first, **_stiffness(self))

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables."""
        return tuple(self.internal)

    def initial_variables(self, gap: Floats) -> Floats:
        """Return the internal variables at rest, shape (n, number of variables)."""
        return np.tile([float(value) for value, _ in self.internal.values()], (len(gap), 1))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Return the energy of each point, zero without ``energy``, shape (n,), [J/m^2]."""
        return self._points.evaluate("state", _gap_of(state), state.internal)[:, 0]

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return traction and new variables at the end of a step at a gap (n, 3), [m]."""
        before, after = _gap_of(state), _after(gap, state)
        values = self._points.evaluate("end", _gap_of(after), state.internal)
        traction, tangent = values[:, :3], values[:, 3:12].reshape(-1, 3, 3)
        after = replace(after, internal=values[:, 12:])
        start = self._points.evaluate("state", before, state.internal)
        mean = 0.5 * (start[:, 1:] + traction)
        lost = np.einsum("ij,ij->i", mean, _gap_of(after) - before)
        lost -= self.stored_energy(after) - start[:, 0]
        return replace(_response(after, traction, tangent), dissipation=lost)


def _stiffness(law: PotentialJoint | TractionJoint) -> dict[str, float]:
    return {"normal_stiffness": law.normal_stiffness, "shear_stiffness": law.shear_stiffness}


def _check_internal(owner: str, internal: Any) -> None:
    wanted = 'it must be {"name": (initial value, update function), ...}.'
    if not isinstance(internal, Mapping):
        raise ValueError(f"{owner}: internal is {shown(internal)}; {wanted}")
    for name, item in internal.items():
        valid = isinstance(name, str) and bool(name.strip())
        valid = valid and isinstance(item, tuple) and len(item) == 2
        if not (valid and math.isfinite(real(item[0])) and callable(item[1])):
            raise ValueError(f"{owner}: internal has {shown(name)}: {shown(item)}; {wanted}")


def _gap_of(state: JointState) -> Floats:
    """Return the gap passed to expressions: normal gap and slip since rest, (n, 3), [m].

    A tiny negative value replaces a zero normal gap, which counts as closed: UFL has no derivative
    of ``min_value(g[0], 0.0)`` at zero.
    """
    normal = np.where(state.gap[:, 0] == 0.0, -np.finfo(float).tiny, state.gap[:, 0])
    return np.column_stack([normal, state.elastic_slip])


def _after(gap: Floats, state: JointState) -> JointState:
    """Return the state at a gap; all slip is elastic."""
    slip = state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]
    return JointState(gap=gap.copy(), elastic_slip=slip)


def _response(after: JointState, traction: Floats, tangent: Floats) -> Response:
    """Return the response of a law without dissipation; the normal gap determines the status.

    Closed points without shear traction and shear tangent are frictionless.
    """
    # Remove the traction due to the tiny negative gap of `_gap_of`.
    threshold = 2.0 * np.finfo(float).tiny * np.abs(tangent).max(axis=(1, 2))
    traction = np.where(np.abs(traction) <= threshold[:, None], 0.0, traction)
    sheared = (traction[:, 1:] != 0.0).any(axis=1) | (tangent[:, 1:] != 0.0).any(axis=(1, 2))
    closed = np.where(sheared, Status.STICK, Status.FRICTIONLESS)
    return Response(
        traction=np.ascontiguousarray(traction),
        tangent=np.ascontiguousarray(tangent),
        state=after,
        dissipation=np.zeros(len(after.gap)),
        status=np.where(after.gap[:, 0] > 0.0, Status.OPEN, closed).astype(np.int8),
    )
