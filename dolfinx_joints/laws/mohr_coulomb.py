# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mohr-Coulomb joint with a brittle bond (cohesion, tensile strength) and dilatancy."""

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
from dolfinx_joints.laws.friction import coefficient_of, set_friction
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    BROKEN,
    HELD,
    INTACT,
    OVERLOAD_ROUNDING,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
)
from dolfinx_joints.laws.losses import GapChange, losses_on, work
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
    put_zeros,
    response_of,
)

# A point counts as touching, and its slip dilates the joint, if the opening at the start of a step
# divided by the slip of the step is below this value. The traction jumps between touching and open,
# and the gap of a touching point without pressure is rounding error (1e-16 of the displacements).
# Mesh and step do not resolve openings of 1e-9 of the slip.
TOUCHING = 1e-9


class Bonded(NamedTuple):
    """Parameters of a point in the order of `MohrCoulombJoint.loop_start`."""

    normal_stiffness: float
    shear_stiffness: float
    friction: float
    dilatancy: float
    cohesion: float
    tensile_strength: float


@inline
def bonded_point(i: int, start: Start, answer: Answer) -> None:
    """Compute the response of an intact or broken point at the end of a step."""
    put_zeros(i, answer)
    p = start.parameters
    law = Bonded(p[0], p[1], p[2], p[3], p[4], p[5])
    gap, before, bond = answer.gap[i], start.gap[i], start.history[i, 2]
    slip = (
        start.history[i, 0] + gap[1] - before[1],
        start.history[i, 1] + gap[2] - before[2],
    )
    ratio = _overload(gap[0], slip, law)
    if bond != HELD and not (bond == INTACT and ratio <= 1.0 + OVERLOAD_ROUNDING):
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
    """Return load / strength of a bond at a normal gap and an elastic slip [m]."""
    t_n = law.normal_stiffness * gap_n
    shear = law.shear_stiffness * np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
    # Ignore rounding error in t_n, which would break a bond without tensile strength.
    tension = t_n if t_n > OVERLOAD_ROUNDING * law.cohesion else 0.0
    strength = law.cohesion - law.friction * t_n
    return max(overload(tension, law.tensile_strength), overload(shear, strength))


@inline
def _slide(i: int, slip: Vector, law: Bonded, start: Start, answer: Answer) -> None:
    """Compute the response of a broken point; ``slip`` is its trial elastic slip [m]."""
    k_n, k_s, mu = law.normal_stiffness, law.shear_stiffness, law.friction
    tan_psi = law.dilatancy
    gap, before, dilation = answer.gap[i], start.gap[i], start.history[i, 3]
    start_gap = 0.0
    if start.history[i, 2] == BROKEN:
        start_gap = before[0] - dilation
        slip_size = np.sqrt((gap[1] - before[1]) ** 2 + (gap[2] - before[2]) ** 2)
        start_gap = min(start_gap, 0.0) if start_gap <= TOUCHING * slip_size else start_gap
    # A closed point stays closed if its gap is below the dilation due to the whole trial slip.
    stays, length = start_gap <= 0.0 and k_s > 0.0, np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
    rise = tan_psi * length if stays else 0.0
    elastic = gap[0] - dilation
    answer.history[i, 2], answer.history[i, 3] = BROKEN, dilation
    if elastic > rise:
        # The slip of a point before it opens, on a straight path, dilates the joint.
        if stays:
            answer.history[i, 3] += rise * (-start_gap / (elastic - rise - start_gap))
        return
    closes = start_gap > 0.0
    theta = -min(elastic, 0.0) / (start_gap - min(elastic, 0.0)) if closes else 1.0  # (8)
    trial, size = (k_s * theta * slip[0], k_s * theta * slip[1]), k_s * theta * length
    excess = size + mu * k_n * elastic
    hardening = k_s + mu * k_n * tan_psi
    slides = excess > 0.0
    plastic = excess / (hardening if hardening > 0.0 else 1.0) if slides else 0.0
    t_n = k_n * (elastic - tan_psi * plastic)
    safe = size if size > 0.0 else 1.0
    ratio = -mu * t_n / safe if slides else 1.0
    # Derivatives of the trial shear traction, of the slip length, then of the tractions.
    approach, derivative = start_gap - elastic, answer.tangent[i]
    rate = -(start_gap / approach) / approach if closes else 0.0
    direction = (trial[0] / safe, trial[1] / safe)
    derivative[0, 0] = k_n
    for b in range(3):
        across = (
            k_s * (rate * slip[0] if b == 0 else theta if b == 1 else 0.0),
            k_s * (rate * slip[1] if b == 0 else theta if b == 2 else 0.0),
        )
        stretch = direction[0] * across[0] + direction[1] * across[1]
        if slides:
            slope = stretch + (mu * k_n if b == 0 else 0.0)
            derivative[0, b] -= k_n * tan_psi * slope / (hardening if hardening > 0.0 else 1.0)
        for a in range(2):
            if slides:
                turning = across[a] - direction[a] * stretch
                derivative[1 + a, b] = ratio * turning - direction[a] * mu * derivative[0, b]
            else:
                derivative[1 + a, b] = ratio * across[a]
    has_friction = mu > 0.0 and k_s > 0.0
    answer.status[i] = (SLIP if slides else STICK) if has_friction else FRICTIONLESS
    answer.traction[i, 0] = t_n
    for a in range(2):
        answer.traction[i, 1 + a] = ratio * trial[a]
        answer.history[i, a] = ratio * trial[a] / k_s if k_s > 0.0 else 0.0
    answer.history[i, 3] += tan_psi * plastic


@dataclass(frozen=True, kw_only=True)
@checked
class MohrCoulombJoint(ElasticContact, CompiledLaw):
    """Mohr-Coulomb friction joint with a brittle bond and dilatancy.

    Intact: t_n = k_n gap_n, also in tension, and t_s = k_s e, as long as t_n <= f_t and
    |t_s| <= c - t_n tan(alpha). In the first step whose solution exceeds a limit, the bond breaks
    permanently (brittle failure, c = f_t = 0). The point then opens, or slides with

        |t_s| + t_n tan(alpha) <= 0,   plastic potential |t_s| + t_n tan(psi).

    Slip of length lambda dilates the joint by p = lambda tan(psi). If the joint is confined, the
    pressure increases: t_n = k_n (gap_n - p). The point is open if t_n would be positive. The
    dilation p never decreases, neither on slip reversal nor on opening. It has no upper limit, so
    use psi only for small slip. With c = f_t = psi = 0 the law equals `FrictionNoTension`. Points
    with an initial gap have no bond.

    Internal variables: ``broken`` (0 or 1) and ``dilation`` p [m].

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.
        friction_angle_deg: alpha; give either this or `friction_coefficient`.
        friction_coefficient: Mu = tan(alpha).
        cohesion: c.
        tensile_strength: f_t, at most c / tan(alpha).
        dilatancy_angle_deg: psi, at most alpha; otherwise friction would generate energy.

    Raises:
        ValueError: Parameters contradict each other.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.laws.law import JointState
        >>> law = dj.MohrCoulombJoint(
        ...     normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=45.0, cohesion=2e6,
        ...     tensile_strength=1e6,
        ... )
        >>> gap = np.array([[4e-6, 0.0, 0.0], [20e-6, 0.0, 0.0]])  # 0.4 and 2 times the strength
        >>> state = JointState.at_rest(np.zeros((2, 3)), variables=2)
        >>> law.backward_euler(gap, state).traction.round()  # the second bond breaks [Pa]
        array([[400000.,      0.,      0.],
               [     0.,      0.,      0.]])
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
        """Return the values at rest; points without cohesion or without contact have no bond.

        Args:
            gap: Gap at rest, shape (n, 3), [m].
        """
        bonded = (self.cohesion > 0.0) & (gap[:, 0] <= 0.0)
        return np.column_stack([np.where(bonded, INTACT, BROKEN), np.zeros(len(gap))])

    def stored_energy(self, state: JointState) -> Floats:
        """Return k_n g^2 / 2 + k_s |e|^2 / 2 with the elastic normal gap g, (n,), [J/m^2]."""
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        normal = self._elastic_gap(state)
        return 0.5 * self.normal_stiffness * normal**2 + 0.5 * self.shear_stiffness * slip

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return elastic slip, internal variables and parameters at the start of the step."""
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
        """Return the response; it dissipates energy by friction, dilatancy and breaking bonds.

        The status of an intact point is STICK, or FRICTIONLESS without shear stiffness.
        """
        slip, internal = answer.history[:, :2], answer.history[:, 2:]
        response = response_of(answer, elastic_slip=slip, internal=internal)
        mean = 0.5 * (self._tractions(state) + self._tractions(response.state))
        lost = work(mean, self._gap_change(state, response.state).plastic)
        return replace(response, dissipation=answer.dissipation + lost)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses (30) of a backward Euler step; energy of broken bonds is friction."""
        change = self._gap_change(before, answer.state)
        breaks = _breaks(before, answer.state)
        change.plastic[breaks] += change.elastic[breaks]
        change.elastic[breaks] = 0.0
        mean = 0.5 * (self._tractions(before) + self._tractions(answer.state))
        return losses_on(change, traction, mean, answer.dissipation)

    def _gap_change(self, before: JointState, after: JointState) -> GapChange:
        """Return the parts of the gap change; if a bond breaks, there is no flight part."""
        broken, breaks = before.internal[:, 0] == BROKEN, _breaks(before, after)
        dilation, change = before.internal[:, 1], after.gap - before.gap
        elastic = self._elastic(after) - self._elastic(before)
        # Slip while the point is open has no friction work.
        fraction = contact_fraction(
            np.where(broken, _start_gap(before, after.gap), 0.0),
            np.minimum(after.gap[:, 0] - dilation, 0.0),
        )
        plastic, flight = np.zeros_like(change), np.zeros_like(change)
        plastic[:, 0] = after.internal[:, 1] - dilation
        plastic[:, 1:] = fraction[:, None] * change[:, 1:] - elastic[:, 1:]
        flight[:, 0] = self._opening(after) - self._opening(before)
        flight[:, 1:] = (1.0 - fraction)[:, None] * change[:, 1:]
        plastic[breaks] += flight[breaks]
        flight[breaks] = 0.0
        return GapChange(elastic, plastic, flight)

    def _opening(self, state: JointState) -> Floats:
        """Return the opening of broken points, zero for others, shape (n,), [m]."""
        opening = np.maximum(state.gap[:, 0] - state.internal[:, 1], 0.0)
        return np.where(state.internal[:, 0] == BROKEN, opening, 0.0)

    def _elastic(self, state: JointState) -> Floats:
        """Return elastic normal gap and slip, shape (n, 3), [m]."""
        return np.column_stack([self._elastic_gap(state), state.elastic_slip])

    def _tractions(self, state: JointState) -> Floats:
        """Return the tractions of a state, shape (n, 3), [Pa]."""
        k_n, k_s = self.normal_stiffness, self.shear_stiffness
        return np.array([k_n, k_s, k_s]) * self._elastic(state)

    def _elastic_gap(self, state: JointState) -> Floats:
        """Return the elastic part of the normal gap, t_n / k_n, shape (n,), [m]."""
        bonded = state.internal[:, 0] < BROKEN
        return np.where(
            bonded, state.gap[:, 0], np.minimum(state.gap[:, 0] - state.internal[:, 1], 0.0)
        )


def _start_gap(state: JointState, gap: Floats) -> Floats:
    """Return normal gap minus dilation at the start of a step, shape (n,), [m].

    Openings below `TOUCHING` times the slip of the step are replaced by zero.

    Args:
        state: State at the start.
        gap: Gap at the end, shape (n, 3), [m].
    """
    start, slip = state.gap[:, 0] - state.internal[:, 1], gap[:, 1:] - state.gap[:, 1:]
    rounded: NDArray[np.bool_] = start <= TOUCHING * np.hypot(slip[:, 0], slip[:, 1])
    return np.where(rounded, np.minimum(start, 0.0), start)


def _breaks(before: JointState, after: JointState) -> NDArray[np.bool_]:
    """Return True for bonds that break in a step, shape (n,)."""
    broken: NDArray[np.bool_] = after.internal[:, 0] == BROKEN
    return broken & (before.internal[:, 0] < BROKEN)
