# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws written in UFL: a stored energy or a traction of the gap vector.

They see the gap (n, s1, s2) of a point: the normal gap, initial gap included, and the slip since
the state at rest. Derivatives are UFL's, the C code is FFCx's; a law then is as any other, arrays
in and arrays out, and runs on the monolithic solver.
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
    """A reversible joint with the traction t = d psi / d gap of a stored energy psi(gap).

    For instance::

        law = PotentialJoint(
            lambda g: 0.5 * k_n * ufl.min_value(g[0], 0.0) ** 2,
            normal_stiffness=k_n,
            shear_stiffness=0.0,
        )

    psi may have kinks in its traction, as here at g[0] = 0, but no jumps. The energy-consistent
    scheme takes the mean traction over the path of a step (`path_mean`).

    Attributes:
        energy: Gives psi [J/m^2] as a scalar UFL expression of the gap, a UFL vector (n, s1, s2).
        normal_stiffness: k_n of the closed joint, for modes and where a tangent is singular.
        shear_stiffness: k_s, for the same.

    Raises:
        ValueError: ``energy`` gives no scalar expression of the gap alone.
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
        """The energy as UFL shows it, and the stiffness."""
        return self._points.described(**_stiffness(self))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Psi of each point, shape (n,), [J/m^2]."""
        return self._points.evaluate("energy", _seen(state))[:, 0]

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Traction and tangent at a gap of shape (n, 3), [m]; they depend on no history."""
        after = _after(gap, state)
        return _response(after, *self._tractions(_seen(after)))

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Mean traction over a step, whose work is the change of psi; see `path_mean`."""
        after = _after(gap, state)
        return _response(after, *path_mean(self._tractions, _seen(state), _seen(after)))

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of an end-point step: work of what the traction has above the mean of the path."""
        start, end = _seen(before), _seen(answer.state)
        mean, _ = path_mean(self._tractions, start, end)
        return Losses(answer.dissipation, work(traction - mean, end - start))

    def _tractions(self, gap: Floats) -> tuple[Floats, Floats]:
        values = self._points.evaluate("traction", gap)
        return values[:, :3], values[:, 3:].reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False, repr=False)
@checked
class TractionJoint:
    """A joint with the traction t(gap, internal variables) of the end of a step.

    For instance::

        law = TractionJoint(
            lambda g, kappa: ufl.as_vector([k_n * ufl.exp(-kappa / length) * g[0], 0.0, 0.0]),
            internal={"kappa": (0.0, lambda g, kappa: ufl.max_value(kappa, g[0]))},
            normal_stiffness=k_n,
            shear_stiffness=0.0,
        )

    Internal variables are scalars. Updates are given the gap at the end of the step and the
    variables at its start; traction and energy the gap and variables of the same time. Within
    ``traction``, ``ufl.diff(psi(g, kappa), g)`` keeps the variables fixed.

    All schemes ask for the traction at the end of steps (backward Euler). Its dissipation is the
    work of the mean of the tractions at both ends of a step, less the change of the energy, and its
    numerical loss what is left: the energy balance says nothing of it (`LawWithLosses`). Without
    ``energy`` nothing counts as stored and all of that work as dissipated, what an elastic joint
    gives back with a negative sign.

    Attributes:
        traction: Gives t [Pa], a UFL vector of three, of the gap (n, s1, s2) and the internal
            variables in their order.
        internal: Initial value and update of each internal variable by name.
        energy: Gives the stored energy [J/m^2] of the same arguments, or None.
        normal_stiffness: k_n of the closed joint, for modes and where a tangent is singular.
        shear_stiffness: k_s, for the same.

    Raises:
        ValueError: A function gives no expression of the right shape of its arguments alone.
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
        points = UflPoints(owner, tuple(internal))
        traction = points.expression("traction", self.traction, size=3)
        psi = points.expression("energy", self.energy or (lambda *_: 0.0))
        updates = [
            points.expression(f"the update of {name}", update)
            for name, (_, update) in internal.items()
        ]
        points.compile("state", psi, traction)
        # Its own derivatives before the variables become functions of the gap.
        ended = apply_derivatives(apply_algebra_lowering(traction))
        ended = ufl.replace(ended, dict(zip(points.internal, updates, strict=True)))
        points.compile("end", ended, ufl.diff(ended, points.gap), *updates)
        object.__setattr__(self, "_points", points)

    def __repr__(self) -> str:
        """The expressions as UFL shows them, initial values and stiffness."""
        first = {name: float(value) for name, (value, _) in self.internal.items()}
        return self._points.described(**first, **_stiffness(self))

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables."""
        return tuple(self.internal)

    def initial_variables(self, gap: Floats) -> Floats:
        """Internal variables at rest, shape (n, number of variables)."""
        return np.tile([float(value) for value, _ in self.internal.values()], (len(gap), 1))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """The energy of each point, zero if none is given, shape (n,), [J/m^2]."""
        return self._points.evaluate("state", _seen(state), state.internal)[:, 0]

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Traction at the end of a step to a gap of shape (n, 3), [m], and new variables."""
        before, after = _seen(state), _after(gap, state)
        values = self._points.evaluate("end", _seen(after), state.internal)
        traction, tangent = values[:, :3], values[:, 3:12].reshape(-1, 3, 3)
        after = replace(after, internal=values[:, 12:])
        start = self._points.evaluate("state", before, state.internal)
        mean = 0.5 * (start[:, 1:] + traction)
        lost = np.einsum("ij,ij->i", mean, _seen(after) - before)
        lost -= self.stored_energy(after) - start[:, 0]
        return replace(_response(after, traction, tangent), dissipation=lost)


def _stiffness(law: PotentialJoint | TractionJoint) -> dict[str, float]:
    return {"normal_stiffness": law.normal_stiffness, "shear_stiffness": law.shear_stiffness}


def _check_internal(owner: str, internal: Any) -> None:
    wanted = 'it must be {"name": (initial value, function that updates it), ...}.'
    if not isinstance(internal, Mapping):
        raise ValueError(f"{owner}: internal is {shown(internal)}; {wanted}")
    for name, each in internal.items():
        good = isinstance(name, str) and bool(name.strip())
        good = good and isinstance(each, tuple) and len(each) == 2
        if not (good and math.isfinite(real(each[0])) and callable(each[1])):
            raise ValueError(f"{owner}: internal has {shown(name)}: {shown(each)}; {wanted}")


def _seen(state: JointState) -> Floats:
    """The gap that an expression sees: normal gap and slip since rest, shape (n, 3), [m].

    A gap of zero is closed; there UFL has no derivative of ``min_value(g[0], 0.0)``.
    """
    normal = np.where(state.gap[:, 0] == 0.0, -np.finfo(float).tiny, state.gap[:, 0])
    return np.column_stack([normal, state.elastic_slip])


def _after(gap: Floats, state: JointState) -> JointState:
    """State at a gap; all slip is elastic."""
    slip = state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]
    return JointState(gap=gap.copy(), elastic_slip=slip)


def _response(after: JointState, traction: Floats, tangent: Floats) -> Response:
    """The answer of a law that loses nothing; open and closed by the normal gap.

    A closed point without shear traction and without shear tangent is frictionless.
    """
    # What a gap of zero has because `_seen` takes it for closed.
    by_seen = 2.0 * np.finfo(float).tiny * np.abs(tangent).max(axis=(1, 2))
    traction = np.where(np.abs(traction) <= by_seen[:, None], 0.0, traction)
    sheared = (traction[:, 1:] != 0.0).any(axis=1) | (tangent[:, 1:] != 0.0).any(axis=(1, 2))
    closed = np.where(sheared, Status.STICK, Status.FRICTIONLESS)
    return Response(
        traction=np.ascontiguousarray(traction),
        tangent=np.ascontiguousarray(tangent),
        state=after,
        dissipation=np.zeros(len(after.gap)),
        status=np.where(after.gap[:, 0] > 0.0, Status.OPEN, closed).astype(np.int8),
    )
