# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint with a bond that softens (fracture energy in modes I and II) and with friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import annotated_types as at
import numpy as np

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.kernels import inline
from dolfinx_joints.laws.friction import coefficient_of, friction_at_end, set_friction
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    NO_COMPLIANCE,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
)
from dolfinx_joints.laws.losses import friction_gap_change, losses_on
from dolfinx_joints.laws.points.compiled_law import EnergyConsistentContact
from dolfinx_joints.laws.points.discrete_gradient import (
    friction_over_step,
    stored_by,
    whole_step_from,
)
from dolfinx_joints.laws.points.on_compliance import loop_of
from dolfinx_joints.laws.points.return_mapping import (
    STICK,
    Answer,
    Coulomb,
    Start,
    put_zeros,
    response_of,
    solve_points,
)
from dolfinx_joints.laws.points.softening import (
    Bond,
    Softening,
    broken_energy,
    intact_share,
    mean_opening,
    mean_over,
    unchanged,
)

# Load of points without a bond: no share of the stiffness is left.
NO_BOND = 1e30

# Friction above this part of its limit grows with the broken share.
AT_LIMIT = 1.0 - 1e-9

# Columns of ``internal``: largest load R, and bond slip s.
LOAD, BOND_SLIP = 1, slice(2, 4)


def _point(friction: Callable[..., None], whole: bool) -> Callable[..., None]:
    """Return the function of a point, from that of its friction; see `CompiledLaw`."""

    @inline
    def point(i: int, start: Start, answer: Answer) -> None:
        p = start.parameters
        bond = Bond(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7])
        k_n, k_s, first = p[0], p[1], start.history.shape[1] - 6
        old, before, gap = start.history[i, first:], start.gap[i, 0], answer.gap[i]
        s_1, s_2, end = old[1], old[2], gap[0]
        e_1, e_2 = s_1 + gap[1] - start.gap[i, 1], s_2 + gap[2] - start.gap[i, 2]
        area_n, area_s = bond.opening * bond.opening, bond.slip * bond.slip
        n_0, n_1 = max(before, 0.0) ** 2 / area_n, max(end, 0.0) ** 2 / area_n
        q_0, q_1 = (s_1 * s_1 + s_2 * s_2) / area_s, (e_1 * e_1 + e_2 * e_2) / area_s
        load, r_1 = max(old[0], 1.0), n_1 + q_1
        grows, lost = r_1 > load, 0.0 * k_n
        mean_n, mean_s = unchanged(old[4]), unchanged(old[5])
        if grows:
            r_0 = min(n_0 + q_0, load)  # rounding error may exceed the largest load
            normal = Softening(bond.normal, bond.exponential > 0.0)
            shear = Softening(bond.shear, bond.exponential > 0.0)
            mean_n = mean_over((r_0, load, r_1), old[4], normal, whole)
            mean_s = mean_over((r_0, load, r_1), old[5], shear, whole)
            elastic, change, load = load - r_0, r_1 - r_0, r_1
            lost += 0.5 * k_n * area_n * broken_energy(n_0, n_1, elastic, change, mean_n)
            lost += 0.5 * k_s * area_s * broken_energy(q_0, q_1, elastic, change, mean_s)
        opening, opening_slope = mean_opening(before, end, whole)
        half, broken = 0.5 if whole else 1.0, 1.0 - mean_s.end
        traction, tangent, new = answer.traction[i], answer.tangent[i], answer.history[i, first:]
        friction_growth = 0.0 * k_n
        if broken > 0.0:  # (9e)
            law = Coulomb(1.0 / k_n, 1.0 / k_s, k_n / k_s, broken * bond.friction, True)
            friction(i, (0.0, 0.0), law, start, answer)
            size = np.sqrt(traction[1] * traction[1] + traction[2] * traction[2])
            if size > AT_LIMIT * -law.friction * traction[0]:
                friction_growth = -mean_s.end_slope / broken
        else:
            put_zeros(i, answer)
            # Contact has the rest of the slope: a gap of exactly zero counts as open, not as both.
            traction[0] = -k_n * mean_opening(-before, -end, whole)[0]
            tangent[0, 0] = k_n * (half - opening_slope)
            answer.status[i] = STICK
        b_1 = k_s * (half * e_1 + (1.0 - half) * s_1)
        b_2 = k_s * (half * e_2 + (1.0 - half) * s_2)
        if grows:
            by_gap = (2.0 * max(end, 0.0) / area_n, 2.0 * e_1 / area_s, 2.0 * e_2 / area_s)
            by_load = (
                k_n * opening * mean_n.slope,
                b_1 * mean_s.slope + friction_growth * traction[1],
                b_2 * mean_s.slope + friction_growth * traction[2],
            )
            for a in range(3):
                for j in range(3):
                    tangent[a, j] += by_load[a] * by_gap[j]
        traction[0] += k_n * opening * mean_n.share
        traction[1] += b_1 * mean_s.share
        traction[2] += b_2 * mean_s.share
        tangent[0, 0] += k_n * opening_slope * mean_n.share
        tangent[1, 1] += half * k_s * mean_s.share
        tangent[2, 2] += half * k_s * mean_s.share
        new[0], new[1], new[2], new[3] = load, e_1, e_2, old[3] + lost
        new[4], new[5] = mean_n.end, mean_s.end
        answer.dissipation[i] += lost

    return point


def _guess(friction: Callable[..., None], whole: bool) -> Callable[..., None]:
    """Return the function that solves a point on a compliance unless it softens or opens."""

    @inline
    def guess(i: int, c_n: float, c_s: float, start: Start, answer: Answer) -> None:
        k_n, k_s, mu = start.parameters[0], start.parameters[1], start.parameters[2]
        first, half = start.history.shape[1] - 6, 0.5 if whole else 1.0
        before, gap, old, last = start.gap[i], answer.gap[i], start.history[i], first + 5
        spring = c_s * k_s * old[last]  # in shear the bond changes compliance and gap of friction
        share = 1.0 / (1.0 + half * spring)
        for a in range(1, 3):
            gap[a] = before[a] + share * (gap[a] - before[a] - spring * old[first + a])
        broken = 1.0 - old[last]
        if broken > 0.0 and gap[0] <= 0.0:
            law = Coulomb(1.0 / k_n, 1.0 / k_s, k_n / k_s, broken * mu, True)
            friction(i, (c_n, share * c_s), law, start, answer)
        else:
            spring = c_n * k_n * old[first + 4]
            opening = before[0] if broken == 0.0 else max(before[0], 0.0)
            gap[0] = (gap[0] - (1.0 - half) * spring * opening) / (1.0 + half * spring)

    return guess


_RULES = {BACKWARD_EULER.name: (friction_at_end, False)}
_RULES[DISCRETE_GRADIENT.name] = friction_over_step, True
_POINTS = {name: _point(*rule) for name, rule in _RULES.items()}
_LOOPS = {name: loop_of(_POINTS[name], _guess(*rule)) for name, rule in _RULES.items()}


@dataclass(frozen=True, kw_only=True)
@checked
class CohesiveJoint(EnergyConsistentContact):
    """Joint with a bond that softens in modes I and II, and friction on its broken part.

    The bond has the stiffnesses k_n in tension and k_s in shear. It starts to soften where

        (<t_n> / f_t)^2 + (|t_s| / c)^2 = 1,

    and dissipates G_I in tension, G_II in shear, and in between G_I a + G_II (1 - a) with the share
    a of mode I in this sum. It unloads to the origin. Pressure is carried without damage. Friction,
    |t_s| <= d tan(alpha) k_n <-gap_n>, is added to the bond and grows with the broken share d, so
    that a broken joint equals `FrictionNoTension`. Points with an initial gap have no bond.

    Internal variables: ``broken`` d (0 to 1), ``load`` R, ``bond_slip_1`` and ``bond_slip_2`` [m],
    and ``fracture_energy``, the energy of the broken bond [J/m^2].

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.
        friction_angle_deg: alpha; give either this or `friction_coefficient`.
        friction_coefficient: Mu = tan(alpha).
        tensile_strength: f_t.
        cohesion: c, shear strength of the bond without pressure.
        fracture_energy: G_I, above the elastic energy f_t^2 / (2 k_n).
        shear_fracture_energy: G_II, above the elastic energy c^2 / (2 k_s).
        softening: ``"exponential"`` or ``"linear"``.

    Raises:
        ValueError: A fracture energy is not above the elastic energy.

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.laws.law import JointState
        >>> law = dj.CohesiveJoint(
        ...     normal_stiffness=1e12, shear_stiffness=4e11, friction_angle_deg=45.0,
        ...     tensile_strength=2e6, cohesion=3e6, fracture_energy=100.0,
        ...     shear_fracture_energy=1000.0, softening="linear",
        ... )
        >>> gap = np.array([[1e-6, 0.0, 0.0], [51e-6, 0.0, 0.0], [200e-6, 0.0, 0.0]])  # [m]
        >>> state = JointState.at_rest(np.zeros((3, 3)), variables=5)
        >>> law.backward_euler(gap, state).traction[:, 0].round()  # intact, half, broken [Pa]
        array([1000000., 1000000.,       0.])
    """

    loops: ClassVar[Mapping[str, Any]] = _LOOPS
    points: ClassVar[Mapping[str, Any]] = _POINTS
    internal_variables: ClassVar[tuple[str, ...]] = (
        "broken",
        "load",
        "bond_slip_1",
        "bond_slip_2",
        "fracture_energy",
    )

    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None
    tensile_strength: Annotated[float, at.Gt(0), at.Unit("Pa")]
    cohesion: Annotated[float, at.Gt(0), at.Unit("Pa")]
    fracture_energy: Annotated[float, at.Gt(0), at.Unit("J/m^2")]
    shear_fracture_energy: Annotated[float, at.Gt(0), at.Unit("J/m^2")]
    softening: Literal["exponential", "linear"] = "exponential"

    def __post_init__(self) -> None:
        set_friction(self)
        for name, strength, stiffness in (
            ("fracture_energy", "tensile_strength", self.normal_stiffness),
            ("shear_fracture_energy", "cohesion", self.shear_stiffness),
        ):
            given, least = getattr(self, name), 0.5 * getattr(self, strength) ** 2 / stiffness
            if given <= least:
                raise ValueError(
                    f"CohesiveJoint: {name} is {given:g} J/m^2; it must be above the elastic "
                    f"energy at the strength, {strength}^2 / (2 stiffness) = {least:g} J/m^2."
                )

    @property
    def _bond(self) -> Bond:
        k_n, k_s = self.normal_stiffness, self.shear_stiffness
        f_t, c = self.tensile_strength, self.cohesion
        normal = 2.0 * self.fracture_energy * k_n / f_t**2
        shear = 2.0 * self.shear_fracture_energy * k_s / c**2
        exponential = float(self.softening == "exponential")
        return Bond(k_n, k_s, coefficient_of(self), f_t / k_n, c / k_s, normal, shear, exponential)

    @property
    def curves(self) -> tuple[Softening, Softening]:
        """Softening in modes I and II."""
        bond, exponential = self._bond, self.softening == "exponential"
        return Softening(bond.normal, exponential), Softening(bond.shear, exponential)

    @property
    def steepest_softening(self) -> tuple[float, float]:
        """Largest decrease of the traction with the gap in modes I and II, (9g) [Pa/m]."""
        bond, factor = self._bond, 2.0 if self.softening == "exponential" else 1.0
        shear = factor * bond.shear_stiffness / (bond.shear - 1.0)
        return factor * bond.normal_stiffness / (bond.normal - 1.0), shear

    def cohesion_share(self, internal: Floats) -> Floats:
        """Return x f_s of (9d), shape (n,): in pure shear the bond carries at most c x f_s."""
        load = internal[:, LOAD]
        return np.sqrt(np.maximum(load, 1.0)) * intact_share(load, self.curves[1])

    def initial_variables(self, gap: Floats) -> Floats:
        """Return the values at rest, shape (n, 5); points without contact have no bond."""
        values, unbonded = np.zeros((len(gap), 5)), gap[:, 0] > 0.0
        values[unbonded, :2] = 1.0, NO_BOND
        return values

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy (9c) of bond, contact and friction, shape (n,), [J/m^2]."""
        normal, shear = (intact_share(state.internal[:, LOAD], curve) for curve in self.curves)
        opening, slip = np.maximum(state.gap[:, 0], 0.0), state.internal[:, BOND_SLIP]
        bond = 0.5 * self.normal_stiffness * normal * opening**2
        bond += 0.5 * self.shear_stiffness * shear * (slip**2).sum(axis=1)
        return bond + super().stored_energy(self._friction_state(state))

    def _friction_state(self, state: JointState) -> JointState:
        """Return the state with the elastic slip of friction alone."""
        share = intact_share(state.internal[:, LOAD], self.curves[1])
        bond = share[:, None] * state.internal[:, BOND_SLIP]
        return replace(state, elastic_slip=state.elastic_slip - bond)

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return the history of friction, load, slip and energy of the bond, and parameters."""
        friction, bond = self._friction_state(state), self._bond
        history = friction.elastic_slip
        if rule.name == DISCRETE_GRADIENT.name:
            stored = stored_by(friction, bond.normal_stiffness, bond.shear_stiffness)
            history = whole_step_from(friction, stored, Coulomb(0.0, 0.0, 0.0, 0.0)).history[:, :8]
        shares = [intact_share(state.internal[:, LOAD], curve) for curve in self.curves]
        history = np.column_stack([history, state.internal[:, LOAD:], *shares])
        return Start(state.gap, history, np.array(bond))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the response; the elastic slip of the state is the shear traction over k_s."""
        history, slips = answer.history, {}
        slip = history[:, :2]
        if rule.name == DISCRETE_GRADIENT.name:
            slip = history[:, 1:3] / np.sqrt(self.shear_stiffness)
            slips = {"slips": history[:, 3:8]}
        internal = np.column_stack([1.0 - history[:, -1], history[:, -6:-2]])
        slip = slip + history[:, -1:] * history[:, -5:-3]
        return response_of(answer, elastic_slip=slip, internal=internal, **slips)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses of a backward Euler step; see `LawWithLosses`.

        The work of contact and bond over the step is exact; (30) applies to the remaining traction.
        """
        start = self.loop_start(DISCRETE_GRADIENT, before)
        start.history[:, 1:8], start.parameters[2] = 0.0, 0.0  # no friction
        bond = solve_points(self.loop(DISCRETE_GRADIENT), answer.state.gap, NO_COMPLIANCE, start)
        first, last = self._friction_state(before), self._friction_state(answer.state)
        change = friction_gap_change(first, last)
        change.elastic[:, 0] = 0.0
        change.flight[:, 0] = answer.state.gap[:, 0] - before.gap[:, 0]
        mean = np.zeros_like(traction)
        mean[:, 1:] = 0.5 * self.shear_stiffness * (first.elastic_slip + last.elastic_slip)
        return losses_on(change, traction - bond.traction, mean, answer.dissipation)
