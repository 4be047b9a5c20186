# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint with cohesion, tensile strength and dilatancy, all lost or gained in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.angle import coefficient_of, set_friction
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    BORNE,
    BROKEN,
    HELD,
    INTACT,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
)
from dolfinx_joints.laws.losses import Way, losses_on, work
from dolfinx_joints.laws.points.compiled_law import CompiledLaw, ElasticContact
from dolfinx_joints.laws.points.return_mapping import (
    FRICTIONLESS,
    SLIP,
    STICK,
    Answer,
    Start,
    Vector,
    bond_under,
    contact_fraction,
    overload,
    put_nothing,
    response_of,
)

# Opening at the start of a step, relative to the slip of the step, that counts as rounding error:
# the point touches and may ride up on its slip. The traction jumps between touching and open. The
# gap of a point that touches without pressure is a difference of displacements, with an error of
# 1e-16 of these. Mesh and step do not resolve openings of 1e-9 of a slip.
TOUCHING = 1e-9


class Bonded(NamedTuple):
    """Parameters of a point, as `MohrCoulombJoint.loop_start` puts them."""

    normal_stiffness: float
    shear_stiffness: float
    friction: float
    dilatancy: float
    cohesion: float
    tensile_strength: float


@inline
def bonded_point(i: int, start: Start, answer: Answer) -> None:
    """Answer of a point at the end of a step, at its gap: with its bond, or without."""
    put_nothing(i, answer)
    p = start.parameters
    law = Bonded(p[0], p[1], p[2], p[3], p[4], p[5])
    gap, before, bond = answer.gap[i], start.gap[i], start.history[i, 2]
    slip = (
        start.history[i, 0] + gap[1] - before[1],
        start.history[i, 1] + gap[2] - before[2],
    )
    ratio = _overload(gap[0], slip, law)
    if bond != HELD and not (bond == INTACT and ratio <= 1.0 + BORNE):
        _slide(i, slip, law, start, answer)
        return
    k_n, k_s = law.normal_stiffness, law.shear_stiffness
    answer.tangent[i, 0, 0], answer.tangent[i, 1, 1], answer.tangent[i, 2, 2] = k_n, k_s, k_s
    answer.traction[i, 0] = k_n * gap[0]
    answer.status[i] = STICK if k_s > 0.0 else FRICTIONLESS
    for a in range(2):
        answer.traction[i, 1 + a] = k_s * slip[a]
        answer.history[i, a] = slip[a] if k_s > 0.0 else 0.0
    answer.history[i, 2] = bond_under(bond, ratio)
    answer.history[i, 3] = start.history[i, 3]


@inline
def _overload(gap_n: float, slip: Vector, law: Bonded) -> float:
    """Return the load of a bond over its strength at a normal gap and an elastic slip [m]."""
    t_n = law.normal_stiffness * gap_n
    shear = law.shear_stiffness * np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
    pulled = t_n if t_n > BORNE * law.cohesion else 0.0  # a bond may have no strength here
    strength = law.cohesion - law.friction * t_n
    return max(overload(pulled, law.tensile_strength), overload(shear, strength))


@inline
def _slide(i: int, slip: Vector, law: Bonded, start: Start, answer: Answer) -> None:
    """Write the answer of a point without a bond; ``slip`` is the elastic one of a stuck point."""
    k_n, k_s, mu = law.normal_stiffness, law.shear_stiffness, law.friction
    tan_psi = law.dilatancy
    gap, before, dilation = answer.gap[i], start.gap[i], start.history[i, 3]
    was = 0.0
    if start.history[i, 2] == BROKEN:
        was = before[0] - dilation
        moved = np.sqrt((gap[1] - before[1]) ** 2 + (gap[2] - before[2]) ** 2)
        was = min(was, 0.0) if was <= TOUCHING * moved else was
    # Riding up on its whole slip a point may stay closed: where t_n < 0 comes out below.
    stays, length = was <= 0.0 and k_s > 0.0, np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
    rise = tan_psi * length if stays else 0.0
    elastic = gap[0] - dilation
    answer.history[i, 2], answer.history[i, 3] = BROKEN, dilation
    if elastic > rise:
        # A point that leaves has ridden up on its slip until then, on a straight path.
        if stays:
            answer.history[i, 3] += rise * (-was / (elastic - rise - was))
        return
    landing = was > 0.0
    theta = -min(elastic, 0.0) / (was - min(elastic, 0.0)) if landing else 1.0  # (8)
    trial, size = (k_s * theta * slip[0], k_s * theta * slip[1]), k_s * theta * length
    excess = size + mu * k_n * elastic
    hardening = k_s + mu * k_n * tan_psi
    slides = excess > 0.0
    plastic = excess / (hardening if hardening > 0.0 else 1.0) if slides else 0.0
    t_n = k_n * (elastic - tan_psi * plastic)
    safe = size if size > 0.0 else 1.0
    ratio = -mu * t_n / safe if slides else 1.0
    # Derivatives: of the trial shear traction, of the slip length, then of the tractions.
    way, along = was - elastic, answer.tangent[i]
    rate = -(was / way) / way if landing else 0.0
    direction = (trial[0] / safe, trial[1] / safe)
    along[0, 0] = k_n
    for b in range(3):
        across = (
            k_s * (rate * slip[0] if b == 0 else theta if b == 1 else 0.0),
            k_s * (rate * slip[1] if b == 0 else theta if b == 2 else 0.0),
        )
        stretch = direction[0] * across[0] + direction[1] * across[1]
        if slides:
            longer = stretch + (mu * k_n if b == 0 else 0.0)
            along[0, b] -= k_n * tan_psi * longer / (hardening if hardening > 0.0 else 1.0)
        for a in range(2):
            if slides:
                turned = across[a] - direction[a] * stretch
                along[1 + a, b] = ratio * turned - direction[a] * mu * along[0, b]
            else:
                along[1 + a, b] = ratio * across[a]
    rubs = mu > 0.0 and k_s > 0.0
    answer.status[i] = (SLIP if slides else STICK) if rubs else FRICTIONLESS
    answer.traction[i, 0] = t_n
    for a in range(2):
        answer.traction[i, 1 + a] = ratio * trial[a]
        answer.history[i, a] = ratio * trial[a] / k_s if k_s > 0.0 else 0.0
    answer.history[i, 3] += tan_psi * plastic


@dataclass(frozen=True, kw_only=True)
@checked
class MohrCoulombJoint(ElasticContact, CompiledLaw):
    """Friction joint with a brittle bond and with dilatancy, a Mohr-Coulomb joint.

    Intact: t_n = k_n gap_n in tension too and t_s = k_s e, as long as t_n <= f_t and
    |t_s| <= c - t_n tan(alpha). At the first step whose solution leaves this range the bond is gone
    for good, c = f_t = 0 (brittle loss): the point opens, or slides by

        |t_s| + t_n tan(alpha) <= 0,   plastic potential |t_s| + t_n tan(psi),

    so that slip over a length lambda opens the joint by p = lambda tan(psi), and while confined
    raises its pressure: t_n = k_n (gap_n - p). A point is open where that would be positive. p only
    grows, also where slip reverses, and stays on opening; there is no limit to it, so psi is meant
    for small slip. With c = f_t = psi = 0 this is `FrictionNoTension`. Points with an initial gap
    have no bond.

    Internal variables: ``broken`` (0 or 1) and ``dilation`` p [m].

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.
        friction_angle_deg: alpha; exactly one of this and the next is given.
        friction_coefficient: Mu = tan(alpha).
        cohesion: c.
        tensile_strength: f_t, at most c / tan(alpha).
        dilatancy_angle_deg: psi, at most alpha (beyond it friction would give energy away).

    Raises:
        ValueError: Two parameters contradict each other.
    """

    points: ClassVar[Mapping[str, Any]] = {BACKWARD_EULER.name: bonded_point}
    internal_variables: ClassVar[tuple[str, ...]] = ("broken", "dilation")
    breaks: ClassVar[bool] = True

    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Ge(0), at.Unit("Pa/m")]
    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None
    cohesion: Annotated[float, at.Ge(0), at.Unit("Pa")] = 0.0
    tensile_strength: Annotated[float, at.Ge(0), at.Unit("Pa")] = 0.0
    dilatancy_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] = 0.0

    def __post_init__(self) -> None:
        """Take the friction; check strengths and angles against each other."""
        mu, alpha = set_friction(self)
        if mu * self.tensile_strength > self.cohesion * (1.0 + 1e-12):
            raise ValueError(
                f"MohrCoulombJoint: tensile_strength is {self.tensile_strength:g} Pa; it must be "
                f"at most cohesion / tan(friction angle), {self.cohesion / mu:g} Pa."
            )
        if self.dilatancy_angle_deg > alpha:
            raise ValueError(
                f"MohrCoulombJoint: dilatancy_angle_deg is {self.dilatancy_angle_deg:g} degrees; "
                f"it must be at most the friction angle, {alpha:g} degrees."
            )

    @property
    def dilatancy_coefficient(self) -> float:
        """Tan(psi)."""
        return math.tan(math.radians(self.dilatancy_angle_deg))

    def initial_variables(self, gap: Floats) -> Floats:
        """Internal variables at rest: no bond where there is none to break, or no contact.

        Args:
            gap: Gap at rest, shape (n, 3), [m].
        """
        bonded = (self.cohesion > 0.0) & (gap[:, 0] <= 0.0)
        return np.column_stack([np.where(bonded, INTACT, BROKEN), np.zeros(len(gap))])

    def stored_energy(self, state: JointState) -> Floats:
        """k_n g^2 / 2 + k_s |e|^2 / 2 with the elastic normal gap g, shape (n,), [J/m^2]."""
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        normal = self._elastic_gap(state)
        return 0.5 * self.normal_stiffness * normal**2 + 0.5 * self.shear_stiffness * slip

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Elastic slip and internal variables at the start."""
        parameters = (
            self.normal_stiffness,
            self.shear_stiffness,
            coefficient_of(self),
            self.dilatancy_coefficient,
            self.cohesion,
            self.tensile_strength,
        )
        history = np.column_stack([state.elastic_slip, state.internal])
        return Start(state.gap, history, np.array(parameters))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the answer with the work of friction and dilatancy, and of bonds that break.

        An intact point counts as sticking, without shear stiffness as frictionless.
        """
        slip, internal = answer.history[:, :2], answer.history[:, 2:]
        found = response_of(answer, elastic_slip=slip, internal=internal)
        mean = 0.5 * (self._tractions(state) + self._tractions(found.state))
        lost = work(mean, self._way(state, found.state).plastic)
        return replace(found, dissipation=answer.dissipation + lost)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of an end-point step (30); what breaking bonds set free counts as friction."""
        way = self._way(before, answer.state)
        breaks = _breaks(before, answer.state)
        way.plastic[breaks] += way.elastic[breaks]
        way.elastic[breaks] = 0.0
        mean = 0.5 * (self._tractions(before) + self._tractions(answer.state))
        return losses_on(way, traction, mean, answer.dissipation)

    def _way(self, before: JointState, after: JointState) -> Way:
        """The way of a step; where a bond breaks in it, all that is not elastic is plastic."""
        broken, breaks = before.internal[:, 0] == BROKEN, _breaks(before, after)
        dilation, moved = before.internal[:, 1], after.gap - before.gap
        elastic = self._elastic(after) - self._elastic(before)
        # Slip in flight, before a point touches, meets no friction.
        fraction = contact_fraction(
            np.where(broken, _start_gap(before, after.gap), 0.0),
            np.minimum(after.gap[:, 0] - dilation, 0.0),
        )
        plastic, flight = np.zeros_like(moved), np.zeros_like(moved)
        plastic[:, 0] = after.internal[:, 1] - dilation
        plastic[:, 1:] = fraction[:, None] * moved[:, 1:] - elastic[:, 1:]
        flight[:, 0] = self._opening(after) - self._opening(before)
        flight[:, 1:] = (1.0 - fraction)[:, None] * moved[:, 1:]
        plastic[breaks] += flight[breaks]
        flight[breaks] = 0.0
        return Way(elastic, plastic, flight)

    def _opening(self, state: JointState) -> Floats:
        """How far points without a bond are open, shape (n,), [m]."""
        opening = np.maximum(state.gap[:, 0] - state.internal[:, 1], 0.0)
        return np.where(state.internal[:, 0] == BROKEN, opening, 0.0)

    def _elastic(self, state: JointState) -> Floats:
        """Elastic normal gap and slip, shape (n, 3), [m]."""
        return np.column_stack([self._elastic_gap(state), state.elastic_slip])

    def _tractions(self, state: JointState) -> Floats:
        """Tractions that a state holds, shape (n, 3), [Pa]."""
        k_n, k_s = self.normal_stiffness, self.shear_stiffness
        return np.array([k_n, k_s, k_s]) * self._elastic(state)

    def _elastic_gap(self, state: JointState) -> Floats:
        """Elastic part of the normal gap, t_n / k_n, shape (n,), [m]."""
        bonded = state.internal[:, 0] < BROKEN
        return np.where(
            bonded, state.gap[:, 0], np.minimum(state.gap[:, 0] - state.internal[:, 1], 0.0)
        )


def _start_gap(state: JointState, gap: Floats) -> Floats:
    """Return the normal gap less dilation at the start of a step, shape (n,), [m].

    An opening below `TOUCHING` of the slip of the step is zero.

    Args:
        state: State at the start.
        gap: Gap at the end, shape (n, 3), [m].
    """
    start, slip = state.gap[:, 0] - state.internal[:, 1], gap[:, 1:] - state.gap[:, 1:]
    rounded: NDArray[np.bool_] = start <= TOUCHING * np.hypot(slip[:, 0], slip[:, 1])
    return np.where(rounded, np.minimum(start, 0.0), start)


def _breaks(before: JointState, after: JointState) -> NDArray[np.bool_]:
    """Bonds that break in a step, shape (n,)."""
    broken: NDArray[np.bool_] = after.internal[:, 0] == BROKEN
    return broken & (before.internal[:, 0] < BROKEN)
