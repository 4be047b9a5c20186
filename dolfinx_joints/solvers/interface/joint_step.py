# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equation of the joint forces in one step: residual r, tangent T, rounding errors, predictor.

    r(f) = f - s w Res(h),   h = g_f - s S f,   T = s w (dRes/dh) s.                (22) to (24)

The unknowns f are the scaled forces s w t of the tractions t, with the areas w of the points, their
own compliances c and s = sqrt(c / w). S is the scaled compliance matrix less the identity, g_f the
gap without joint forces, h the trial gap: the gap without the point's own traction. Res(h) is the
traction of the law at h. Equation numbers are those of docs/theory.

The elastic predictor is the start of a static increment on the branch of the accepted equilibrium.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.condensed_step import PointResponses
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import JointState, Response, Rule
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.springs import JointSprings


class Iterate(NamedTuple):
    """Scaled forces of the points of this rank, with their residual and tangent.

    Attributes:
        force: f, shape (m,).
        coupled: S f, shape (m,).
        error: Upper bound of the error of S f.
        residual: r, shape (m,).
        tangent: T, shape (points, 3, 3).
        point_responses: Tractions and tangents of the laws.
        max_force: Largest scaled force s w Res of the laws, over all ranks, or a larger bound.
        norm: 2-norm of r, over all ranks.
        max_residual: Largest |r|, over all ranks.
        max_gap: Largest gap divided by s, over all ranks: of the free gap and the gap at the start
            of the step. With artificial springs, weighted by the part that causes forces.
        magnitude: Largest |f| plus largest |S f|, over all ranks.
    """

    force: Floats
    coupled: Floats
    error: float
    residual: Floats
    tangent: Floats
    point_responses: PointResponses
    max_force: float
    norm: float
    max_residual: float
    max_gap: float
    magnitude: float

    @property
    def reference_force(self) -> float:
        """Largest force of the laws; without force the largest residual; without both 1."""
        return self.max_force or self.max_residual or 1.0


class JointStep:
    """Residual r(f) of one step.

    Args:
        contact: The joints.
        condensed: The system condensed onto the joints.
        free_gap: Gap without joint forces, shape (n, 3), [m].
        state: State at the start of the step.
        rule: Integration rule of the laws.
        least_force: Lower bound of the largest force to which residuals are relative.
    """

    def __init__(
        self,
        contact: Contact,
        condensed: Condensed,
        free_gap: Floats,
        state: JointState,
        rule: Rule,
        least_force: float = 0.0,
    ) -> None:
        """Prepare the laws (collective)."""
        self._least_force = least_force
        self.condensed, self.contact, self._comm = condensed, contact, contact.operator.comm
        self.free_gap, self.state, self.rule = free_gap, state, rule
        compliance, springs = condensed.compliance.own, condensed.springs
        if springs is not None:
            compliance = springs.compliance_without_springs(compliance)
        self._laws = contact.condensed_step(compliance, state, rule)
        self._scale, self._force_scale = condensed.scale, condensed.force_scale
        gap_sizes = np.maximum(np.abs(free_gap), np.abs(state.gap)).ravel()
        self._gap_sizes = gap_sizes / condensed.compliance.scale
        self._largest_gap = float(self._gap_sizes.max(initial=0.0))

    def response(self, at: Iterate) -> Response:
        """Return the response of the joints at an iterate."""
        return self._laws.response(at.point_responses)

    def residual_and_limit(self, at: Iterate, tolerance: float) -> tuple[float, float]:
        """Return the residual and the largest accepted residual.

        Both values and the tolerance are relative to `Iterate.reference_force`.
        """
        scale = at.reference_force
        relative, rounding = at.max_residual / scale, self.rounding(at) / scale
        if self.condensed.springs is None:
            # If all closed points have only just closed, rounding errors exceed their forces.
            largest = limits.LARGEST_ROUNDING if rounding < 1.0 else limits.LARGEST_CONTACT_ROUNDING
            return relative, max(tolerance, min(rounding, largest))
        accepted = max(tolerance, min(rounding, limits.LARGEST_SPRING_ROUNDING))
        # In a mechanism, spring forces exceed joint forces: the rounding error is the residual.
        return (max(relative, rounding) if rounding > accepted else relative), accepted

    def is_balanced(self, at: Iterate) -> bool:
        """Return True if residual and rounding error are negligible relative to the forces.

        If unsupported blocks have moved far, the rounding error is not negligible.
        """
        return max(at.max_residual, self.rounding(at)) <= limits.BALANCED * at.max_force

    @staticmethod
    def rounding(at: Iterate) -> float:
        """Return the scaled force due to rounding errors of the gaps."""
        return limits.GAP_ROUNDING * (at.max_gap + at.magnitude)

    def forces(self, traction: Floats) -> Floats:
        """Return the scaled forces of tractions (n, 3), zero in constrained directions."""
        return self._force_scale * traction.ravel()

    def evaluate(self, force: Floats, coupled: Floats, error: float = 0.0) -> Iterate:
        """Return the iterate of f and S f, with its residual, tangent and norms (collective).

        ``error`` is the upper bound of the error of S f.
        """
        trial_gap = self.free_gap - (self._scale * coupled).reshape(-1, 3)
        springs = self.condensed.springs
        if springs is not None:
            trial_gap = springs.trial_gap_without_springs(
                trial_gap, self.condensed.compliance.own, self.state.gap
            )
        point_responses = self._laws.point_responses(trial_gap)
        traction, tangent = point_responses.traction, point_responses.tangent
        if springs is not None:
            gap = self._laws.response(point_responses).state.gap
            traction, tangent = springs.traction_without_springs(
                traction, tangent, gap, self.condensed.compliance.own, self.state.gap
            )
        residual, scaled, norms = np.empty_like(force), np.empty_like(tangent), np.zeros(6)
        _residual(
            force,
            coupled,
            point_responses.traction,
            traction,
            tangent,
            self._scale,
            self._force_scale,
            residual,
            scaled,
            norms,
        )
        norms[5] = self._largest_gap if springs is None else self._active_gap(scaled, springs)
        if self._comm.size > 1:
            by_rank = of_ranks(self._comm, norms)
            norms = by_rank.max(axis=0)
            norms[4] = by_rank[:, 4].sum()
        max_force, max_residual, max_f, max_coupled, square, max_gap = norms.tolist()
        return Iterate(
            force=force,
            coupled=coupled,
            error=error,
            residual=residual,
            tangent=scaled,
            point_responses=point_responses,
            max_force=max(max_force, self._least_force),
            norm=square**0.5,
            max_residual=max_residual,
            max_gap=max_gap,
            magnitude=max_f + max_coupled,
        )

    def _active_gap(self, tangent: Floats, springs: JointSprings) -> float:
        """Return the largest gap divided by s, each gap times the share that causes forces.

        Soft joints of unsupported blocks may open far with a small force.
        """
        share = np.repeat(springs.stiffness * self.condensed.compliance.own, (1, 2), axis=1)
        active_share = np.minimum(np.maximum(np.abs(tangent).max(axis=1), share), 1.0)
        return float((active_share.ravel() * self._gap_sizes).max(initial=0.0))


@njit(cache=True)
def _residual(
    force: Floats,
    coupled: Floats,
    law_traction: Floats,
    traction: Floats,
    tangent: Floats,
    scale: Floats,
    force_scale: Floats,
    residual: Floats,
    scaled: Floats,
    norms: Floats,
) -> None:
    """Write r and T, both zero in constrained directions, and five norms to arrays.

    ``norms`` is zero on entry. Then it has the largest scaled force of the laws, the largest |r|,
    |f| and |S f|, the squared 2-norm of r; its last entry is for the largest gap. If an entry of r
    is NaN, both norms of r are NaN. ``law_traction`` is Res; ``traction`` and ``tangent`` exclude
    springs. ``force_scale`` is s w, zero in constrained directions.
    """
    for i in range(len(tangent)):
        for a in range(3):
            k = 3 * i + a
            difference = force[k] - force_scale[k] * traction[i, a] if force_scale[k] > 0.0 else 0.0
            residual[k] = difference
            norms[0] = max(norms[0], abs(force_scale[k] * law_traction[i, a]))
            norms[1] = max(norms[1], abs(difference))
            norms[2], norms[3] = max(norms[2], abs(force[k])), max(norms[3], abs(coupled[k]))
            norms[4] += difference * difference
            for b in range(3):
                scaled[i, a, b] = force_scale[k] * tangent[i, a, b] * scale[3 * i + b]
    if not norms[4] >= 0.0:
        norms[1] = np.nan


class AcceptedForces:
    """Scaled forces f and S f of the last two accepted static solves.

    Under proportional loading the next forces are often on the line through the last two forces.
    """

    def __init__(self) -> None:
        self._traction: Floats | None = None
        self._solved: tuple[Floats, Floats, Floats] | None = None
        self._forces: list[tuple[Floats, Floats]] = []

    def solved(self, traction: Floats, force: Floats, coupled: Floats) -> None:
        """Store the tractions (n, 3) [Pa], f and S f of a solve that may be accepted."""
        self._solved = traction, force, coupled

    def start(self, step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
        """Return f and S f at which a step starts (collective).

        The start is on the line through the last two accepted forces if its residual is small.
        Otherwise it is the elastic predictor.

        Args:
            step: The static increment.
            traction: Tractions of the accepted state, shape (n, 3), [Pa].
        """
        if self._solved is not None and traction is self._solved[0]:
            self._forces = [*self._forces[-1:], self._solved[1:]]
        elif traction is not self._traction:
            self._forces = []
        self._traction, self._solved = traction, None
        if len(self._forces) == 2:
            (f0, s0), (f1, s1) = self._forces
            line = 2.0 * f1 - f0, 2.0 * s1 - s0
            at = step.evaluate(*line)
            if at.max_residual <= limits.ON_LINE * at.max_force:
                return line
        return elastic_predictor(step, traction)


def elastic_predictor(step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
    """Return the scaled forces f of the elastic predictor and S f (collective).

    The laws are linearised at the accepted state with forces f0, scaled trial gaps h0, tangent T:

        f = f0 + T (h(f) - h0)   with   h(f) = g_f - S f,                                   (28e)

    where g_f is the scaled gap without joint forces, see docs/theory for (28e). Newton's method
    from f stays on the branch.

    Args:
        step: The static increment.
        traction: Tractions of the accepted state, shape (n, 3), [Pa].
    """
    condensed, compliance = step.condensed, step.condensed.compliance
    force = step.forces(traction)
    coupled = condensed.corrections.product(force)
    c = np.repeat(compliance.own, (1, 2), axis=1)
    trial_gap = step.state.gap + c * traction + (compliance.scale * coupled).reshape(-1, 3)
    trial = JointStep(step.contact, condensed, trial_gap, step.state, step.rule)
    tangent = trial.evaluate(force, coupled).tangent
    change = ((step.free_gap - trial_gap).ravel() / compliance.scale).reshape(-1, 3)
    right_hand_side = -np.einsum("nij,nj->ni", tangent, change).ravel()
    tolerance = limits.STATIC_FORCING
    correction = condensed.corrections.solve(right_hand_side, tangent, 0.0, tolerance, couples=True)
    return force - correction.step, coupled - correction.coupled


def tractions_of(contact: Contact, state: JointState, given: Floats | None) -> Floats:
    """Return the tractions of a state, shape (n, 3), [Pa] (collective).

    Return ``given`` if it is not None. Otherwise the laws give the tractions at the gaps of the
    state; if a joint is rigid, all tractions are zero.
    """
    if given is not None:
        return given
    if contact.rigid:
        return np.zeros_like(state.gap)
    return contact.at_gap(state.gap, state).traction
