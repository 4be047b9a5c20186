# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint with cohesion, tensile strength and dilatancy, all lost or gained in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.angle import coefficient_of, set_friction
from dolfinx_joints.laws.law import (
    BORNE,
    BROKEN,
    HELD,
    INTACT,
    Floats,
    JointState,
    Losses,
    Response,
    Status,
    bond_under,
    overload,
)
from dolfinx_joints.laws.losses import Way, losses_on, work
from dolfinx_joints.laws.points.return_mapping import contact_fraction

# Opening at the start of a step, relative to the slip of the step, that counts as rounding error:
# the point touches and may ride up on its slip. The traction jumps between touching and open. The
# gap of a point that touches without pressure is a difference of displacements, with an error of
# 1e-16 of these. Mesh and step do not resolve openings of 1e-9 of a slip.
TOUCHING = 1e-9


@dataclass(frozen=True, kw_only=True)
@checked
class MohrCoulombJoint:
    """Friction joint with a brittle bond and with dilatancy, a Mohr-Coulomb joint.

    Intact: t_n = k_n gap_n in tension too and t_s = k_s e, as long as t_n <= f_t and
    |t_s| <= c - t_n tan(alpha). At the first step whose solution leaves this range the bond is gone
    for good, c = f_t = 0 (brittle loss): the point opens, or slides by

        |t_s| + t_n tan(alpha) <= 0,   plastic potential |t_s| + t_n tan(psi),

    so that slip over a length lambda opens the joint by p = lambda tan(psi), and while confined
    raises its pressure: t_n = k_n (gap_n - p). A point is open where that would be positive. p only
    grows, also where slip reverses, and stays on opening; there is no limit to it, so psi is meant
    for small slip. With c = f_t = psi = 0 this is `FrictionNoTension`. Points with an initial gap
    have no bond. It is no `CondensedLaw`: models take the monolithic solver.

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

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """k_n g^2 / 2 + k_s |e|^2 / 2 with the elastic normal gap g, shape (n,), [J/m^2]."""
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        normal = self._elastic_gap(state)
        return 0.5 * self.normal_stiffness * normal**2 + 0.5 * self.shear_stiffness * slip

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return mapping at the end of a step (backward Euler, closed form).

        Args:
            gap: Trial gap, shape (n, 3), [m].
            state: State at the start of the step.

        Returns:
            Tractions, consistent tangent, trial state, dissipation (friction, dilatancy and what
            breaking bonds set free) and status; an intact point counts as sticking, without shear
            stiffness as frictionless.
        """
        k_n, k_s = self.normal_stiffness, self.shear_stiffness
        slip = state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]
        bond = state.internal[:, 0]
        bonded, held = bond < BROKEN, bond == HELD
        ratio = self._overload(gap[:, 0], slip)
        holds = held | ((bond == INTACT) & (ratio <= 1.0 + BORNE))
        traction = np.column_stack([k_n * gap[:, :1], k_s * slip])
        tangent = np.zeros((len(gap), 3, 3))
        tangent[:] = np.diag([k_n, k_s, k_s])
        bond = np.where(held, bond_under(ratio), np.where(holds, INTACT, BROKEN))
        internal = np.column_stack([bond, state.internal[:, 1]])
        bonded_status = Status.STICK if k_s > 0.0 else Status.FRICTIONLESS
        status = np.full(len(gap), bonded_status, dtype=np.int8)
        loose = np.flatnonzero(~holds)
        if len(loose):
            was = np.where(bonded, 0.0, _start_gap(state, gap))[loose]
            answer = self._slide(gap[loose, 0], slip[loose], was, state.internal[loose, 1])
            traction[loose], tangent[loose], internal[loose, 1], status[loose] = answer
        elastic_slip: NDArray[Any] = traction[:, 1:] / (k_s or 1.0)
        after = JointState(gap=gap.copy(), elastic_slip=elastic_slip, internal=internal)
        way = self._way(state, after)
        return Response(
            traction=traction,
            tangent=tangent,
            state=after,
            dissipation=work(0.5 * (self._tractions(state) + traction), way.plastic),
            status=status,
        )

    def _overload(self, gap_n: Floats, slip: Floats) -> Floats:
        """Load of a bond over its strength at a normal gap (n,) and an elastic slip (n, 2), [m]."""
        t_n, mu = self.normal_stiffness * gap_n, coefficient_of(self)
        shear = self.shear_stiffness * np.hypot(slip[:, 0], slip[:, 1])
        pulled = np.where(t_n > BORNE * self.cohesion, t_n, 0.0)  # a bond may have no strength here
        tensile = overload(pulled, np.full_like(t_n, self.tensile_strength))
        return np.maximum(tensile, overload(shear, self.cohesion - mu * t_n))

    def _slide(
        self, gap_n: Floats, slip: Floats, was: Floats, dilation: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Traction, tangent, dilation and status of points without a bond.

        Args:
            gap_n: Normal gap, shape (n,), [m].
            slip: Elastic slip at the start plus slip of the step, shape (n, 2), [m].
            was: Normal gap less dilation at the start, shape (n,), [m].
            dilation: At the start, shape (n,), [m].
        """
        k_n, k_s, mu = self.normal_stiffness, self.shear_stiffness, coefficient_of(self)
        tan_psi = self.dilatancy_coefficient
        # Riding up on its whole slip a point may stay closed: where t_n < 0 comes out below.
        stays = (was <= 0.0) & (k_s > 0.0)
        rise = np.where(stays, tan_psi * np.hypot(slip[:, 0], slip[:, 1]), 0.0)
        closed = gap_n - dilation <= rise
        elastic = np.where(closed, gap_n - dilation, 0.0)
        fraction = contact_fraction(was, np.minimum(elastic, 0.0))
        trial = np.where(closed, k_s * fraction, 0.0)[:, None] * slip
        size = np.hypot(trial[:, 0], trial[:, 1])
        excess = np.where(closed, size + mu * k_n * elastic, 0.0)
        slides = excess > 0.0
        hardening = (k_s + mu * k_n * tan_psi) or 1.0
        length = np.where(slides, excess / hardening, 0.0)
        t_n = k_n * (elastic - tan_psi * length)
        safe = np.where(size > 0.0, size, 1.0)
        direction = trial / safe[:, None]
        ratio = np.where(slides, -mu * t_n / safe, closed)
        # Derivatives of the trial shear traction, then of the slip length, then of the tractions.
        turned = np.zeros((len(gap_n), 2, 3))
        landing = closed & (was > 0.0)
        way = np.where(landing, was - elastic, 1.0)
        rate = np.where(landing, -(was / way) / way, 0.0)
        turned[:, :, 0] = (k_s * rate)[:, None] * slip
        turned[:, 0, 1] = turned[:, 1, 2] = np.where(closed, k_s * fraction, 0.0)
        stretch = np.einsum("ni,nij->nj", direction, turned)
        longer = stretch / hardening
        longer[:, 0] += mu * k_n / hardening
        longer *= slides[:, None]
        tangent = np.zeros((len(gap_n), 3, 3))
        tangent[:, 0, 0] = np.where(closed, k_n, 0.0)
        tangent[:, 0] -= k_n * tan_psi * longer
        normal = np.where(slides[:, None], -mu * tangent[:, 0], 0.0)
        across = turned - np.where(slides, 1.0, 0.0)[:, None, None] * (
            direction[:, :, None] * stretch[:, None, :]
        )
        tangent[:, 1:] = direction[:, :, None] * normal[:, None, :] + ratio[:, None, None] * across
        rubs = mu > 0.0 and k_s > 0.0
        closed_status = np.where(slides, Status.SLIP, Status.STICK) if rubs else Status.FRICTIONLESS
        status = np.where(closed, closed_status, Status.OPEN)
        traction = np.column_stack([t_n, ratio[:, None] * trial])
        # A point that leaves has ridden up on its slip until then, on a straight path.
        leaving = stays & ~closed
        way = np.where(leaving, gap_n - dilation - rise - was, 1.0)
        rise = np.where(leaving, rise * (-was / way), tan_psi * length)
        return traction, tangent, dilation + rise, status

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
