# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscous dashpots in parallel with a joint law."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.kernels import inline, njit
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.laws.law import (
    EnergyConsistentLaw,
    Floats,
    JointState,
    Law,
    LawWithHistory,
    Losses,
    Response,
    Rule,
    Status,
    has_bonds,
    variables_of,
    with_bonds,
)
from dolfinx_joints.laws.losses import losses_of, work
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.laws.points.compiled_law import CompiledEnergyConsistentLaw, CompiledLaw
from dolfinx_joints.laws.points.return_mapping import Answer, Start, empty_answer
from dolfinx_joints.laws.shear_keys import ShearKeyJoint

OPEN = int(Status.OPEN)


@dataclass(frozen=True, kw_only=True)
@checked
class ViscousJoint:
    """Joint law with dashpots that act while the joint is closed.

    In a step of length dt the dashpots add to the tractions of ``law``

        t_n = eta_n (<gap_n1> - <gap_n0>) / dt   with <g> = min(g, 0), no tension in the sum,
        t_s = eta_s gap_s' dt_c / dt             with the time dt_c in contact.

    |t_s| is limited to the pressure, so that t_s does not jump to zero when the joint opens. In
    statics the dashpots have no traction.

    Attributes:
        law: Law of finite stiffness without dashpots, dilatancy, adhesion or shear keys.
        normal_viscosity: eta_n.
        shear_viscosity: eta_s.

    Raises:
        ValueError: ``law`` is not a `Law`, or has dashpots, dilatancy, adhesion or shear keys.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.laws.law import JointState
        >>> contact = dj.frictionless(normal_stiffness=1e9)
        >>> joint = dj.ViscousJoint(law=contact, normal_viscosity=1e6)
        >>> gap = np.array([[-0.001, 0.0, 0.0]])  # overlap 1 mm after a step of 10 ms
        >>> law = joint.for_step(0.01)
        >>> law.backward_euler(gap, JointState.at_rest(np.zeros((1, 3)))).traction.round()  # [Pa]
        array([[-1100000.,        0.,        0.]])
    """

    law: Law
    normal_viscosity: Annotated[float, at.Ge(0), at.Unit("Pa s/m")] = 0.0
    shear_viscosity: Annotated[float, at.Ge(0), at.Unit("Pa s/m")] = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.law, type) or not isinstance(self.law, Law):
            raise ValueError(
                f"ViscousJoint: law is {shown(self.law)}; it must be a joint law of finite "
                "stiffness."
            )
        if isinstance(self.law, ViscousJoint):
            raise ValueError("ViscousJoint: law already has dashpots; change their viscosities.")
        dilates = isinstance(self.law, MohrCoulombJoint) and self.law.dilatancy_angle_deg
        adheres = getattr(self.law, "adhesion", 0.0)
        if dilates or adheres or isinstance(self.law, ShearKeyJoint):
            feature = "a dilatancy angle" if dilates else "adhesion" if adheres else "shear keys"
            raise ValueError(
                f"ViscousJoint: law has {feature}; dashpots need a law that closes at a gap "
                "of zero."
            )

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables of the law."""
        return variables_of(self.law)

    def initial_variables(self, gap: Floats) -> Floats:
        """Return the internal variables of the law at rest."""
        if isinstance(self.law, LawWithHistory):
            return self.law.initial_variables(gap)
        return np.zeros((len(gap), 0))

    def closed_stiffness(self) -> tuple[float, float]:
        """Return k_n and k_s of the law, [Pa/m]."""
        return self.law.closed_stiffness()

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy of the law, shape (n,), [J/m^2]."""
        return self.law.stored_energy(state)

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return the response of the law in statics."""
        return self.for_step(math.inf).backward_euler(gap, state)

    def for_step(self, dt: float) -> EnergyConsistentLaw:
        """Return the law for a step of length dt [s], infinite in statics."""
        law, normal, shear = self.law, self.normal_viscosity / dt, self.shear_viscosity / dt
        if isinstance(law, CompiledLaw) and law.uses_only_loops():
            return CompiledDashpotStep(law=law, normal=normal, shear=shear)
        return DashpotStep(law=law, normal=normal, shear=shear)


@dataclass(frozen=True, kw_only=True)
class DashpotStep:
    """Joint law with dashpots for one step length; viscosities are divided by dt [Pa/m]."""

    law: Law
    normal: float
    shear: float

    def closed_stiffness(self) -> tuple[float, float]:
        """Return k_n and k_s of the law, [Pa/m]."""
        return self.law.closed_stiffness()

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy of the law, shape (n,), [J/m^2]."""
        return self.law.stored_energy(state)

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return the response with dashpot tractions, whose work counts as dissipation."""
        return self._with_dashpots(self.law.backward_euler(gap, state), gap, state)

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Return the response over a whole step, or at its end if the law has no other rule."""
        if not isinstance(self.law, EnergyConsistentLaw):
            return self.backward_euler(gap, state)
        return self._with_dashpots(self.law.discrete_gradient(gap, state), gap, state)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses of the law without dashpot tractions, plus the work of the dashpots."""
        start = before
        if has_bonds(self.law):
            breaks = answer.state.internal[:, 0] > before.internal[:, 0]
            start = replace(before, internal=with_bonds(before.internal, breaks))
        alone = self.law.backward_euler(answer.state.gap, start)
        dash = answer.traction - alone.traction
        lost = losses_of(self.law, before, alone, traction - dash)
        return lost._replace(friction=lost.friction + work(dash, answer.state.gap - before.gap))

    def _with_dashpots(self, response: Response, gap: Floats, state: JointState) -> Response:
        """Return the response of a law evaluated in Python plus the dashpot tractions."""
        answer = empty_answer(gap, np.empty((len(gap), 0)))
        arrays = {name: getattr(response, name).astype(gap.dtype) for name in _CHANGED}
        answer = answer._replace(status=response.status.astype(np.int8), **arrays)
        loop = dashpot_points if gap.dtype == np.float64 else dashpot_points.py_func
        loop(self.normal, self.shear, state.gap.astype(gap.dtype), answer)
        return replace(response, **{name: getattr(answer, name) for name in _CHANGED})


@dataclass(frozen=True, kw_only=True)
class CompiledDashpotStep(DashpotStep, CompiledEnergyConsistentLaw):
    """`DashpotStep` of a compiled law, with compiled functions of a point."""

    law: CompiledLaw  # type: ignore[assignment]

    @property
    def points(self) -> Mapping[str, Any]:  # type: ignore[override]
        """Compiled points of the law with dashpots."""
        return {name: with_dashpots(point) for name, point in self.law.points.items()}

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return the start of the law, with stiffnesses and viscosities as first parameters."""
        inner = self.law.loop_start(rule, state)
        parameters = (*self.closed_stiffness(), self.normal, self.shear)
        return inner._replace(parameters=np.append(parameters, inner.parameters))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the response of the law."""
        return self.law.loop_response(rule, answer, state)


_CHANGED = ("traction", "tangent", "dissipation")


@functools.cache
def with_dashpots(point: Any) -> Any:
    """Return the compiled point with dashpots for the compiled point of a law."""

    @inline
    def point_with_dashpots(i: int, start: Start, answer: Answer) -> None:
        parameters = start.parameters
        point(i, Start(start.gap, start.history, parameters[4:]), answer)
        add_dashpots(i, parameters[2], parameters[3], start.gap[i], answer)

    return point_with_dashpots


@njit(cache=True, error_model="numpy")
def dashpot_points(normal: float, shear: float, before: Floats, answer: Answer) -> None:
    """Add the dashpot tractions to the responses of all points."""
    for i in range(len(before)):
        add_dashpots(i, normal, shear, before[i], answer)


@inline
def add_dashpots(i: int, normal: float, shear: float, before: Floats, answer: Answer) -> None:
    """Add the dashpot tractions to the response of a point.

    Args:
        i: Number of the point.
        normal: eta_n / dt [Pa/m].
        shear: eta_s / dt [Pa/m].
        before: Gap at the start, shape (3,), [m].
        answer: Response of the law; modified.
    """
    gap, traction, tangent = answer.gap[i], answer.traction[i], answer.tangent[i]
    end = min(gap[0], 0.0)
    pressed = normal * (end - min(before[0], 0.0))
    # Limit the dashpot traction so that the total normal traction stays compressive.
    dash_n, acts = pressed, True
    if pressed > max(-traction[0], 0.0):
        dash_n, acts = max(-traction[0], 0.0), False
    if not acts and traction[0] <= 0.0:
        for b in range(3):
            tangent[0, b] = 0.0
    if acts and gap[0] <= 0.0:
        tangent[0, 0] += normal
    opening = max(before[0], 0.0)
    theta, rate = 1.0, 0.0
    if opening > 0.0:  # (8)
        theta = -end / (opening - end)
        if gap[0] <= 0.0:
            rate = -(opening / (opening - end)) / (opening - end)
    elif answer.status[i] == OPEN and gap[0] > 0.0:
        theta = -before[0] / (gap[0] - before[0])
        rate = -theta / (gap[0] - before[0])
    slip = (gap[1] - before[1], gap[2] - before[2])
    shear_1, shear_2, t_n = shear * theta * slip[0], shear * theta * slip[1], traction[0] + dash_n
    size, limit = np.sqrt(shear_1 * shear_1 + shear_2 * shear_2), max(-t_n, 0.0)
    bound, safe = size >= limit, size if size > 0.0 else 1.0
    direction, share = (shear_1 / safe, shear_2 / safe), limit / safe if size >= limit else 1.0
    for b in range(3):
        rates = (
            shear * (rate * slip[0] if b == 0 else theta if b == 1 else 0.0),
            shear * (rate * slip[1] if b == 0 else theta if b == 2 else 0.0),
        )
        parallel = direction[0] * rates[0] + direction[1] * rates[1]
        falls = -tangent[0, b] if t_n < 0.0 else 0.0
        for a in range(2):
            if bound:  # limit the shear to the pressure
                turning = rates[a] - direction[a] * parallel
                tangent[1 + a, b] += direction[a] * falls + share * turning
            else:
                tangent[1 + a, b] += rates[a]
    dash = (dash_n, share * shear_1, share * shear_2)
    for a in range(3):
        traction[a] += dash[a]
        answer.dissipation[i] += dash[a] * (gap[a] - before[a])
