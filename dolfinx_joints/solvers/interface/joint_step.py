# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equation of the joint forces of one step: residual r(f) (23), tangent, and rounding errors.

f are the scaled forces s w t, S is the scaled compliance less the identity, s = sqrt(c / w) (22).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.condensed_step import PointAnswers
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import JointState, Response, Rule
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.springs import JointSprings

Floats = NDArray[np.float64]


class Iterate(NamedTuple):
    """Scaled forces of the rank's points, with their residual and tangent.

    Attributes:
        force: f, shape (m,).
        coupled: S f.
        error: Bound of the error of S f.
        residual: r.
        tangent: T = s w (dRes/dh) s (24), shape (points, 3, 3).
        answers: Response of the laws.
        largest: Largest scaled force of the laws, over all ranks.
        norm: 2-norm of r, over all ranks.
        max_residual: Largest |r|, over all ranks.
        reach: Largest scaled gap that affects the forces, over all ranks.
        size: Largest |f| plus largest |S f|, over all ranks.
    """

    force: Floats
    coupled: Floats
    error: float
    residual: Floats
    tangent: Floats
    answers: PointAnswers
    largest: float
    norm: float
    max_residual: float
    reach: float
    size: float

    @property
    def scale(self) -> float:
        """Force to which residuals are relative, usually the largest force."""
        return self.largest or self.max_residual or 1.0


class JointStep:
    """Residual r(f) of one step.

    Args:
        contact: The joints.
        condensed: The system condensed onto the joints.
        free_gap: Gap without joint forces, shape (n, 3), [m].
        state: State at the start of the step.
        rule: Rule by which the laws are evaluated.
    """

    def __init__(
        self,
        contact: Contact,
        condensed: Condensed,
        free_gap: Floats,
        state: JointState,
        rule: Rule,
    ) -> None:
        """Prepare the laws (collective)."""
        self.condensed, self.contact, self._comm = condensed, contact, contact.operator.comm
        self.free_gap, self.state, self.rule = free_gap, state, rule
        compliance, springs = condensed.compliance.own, condensed.springs
        if springs is not None:
            compliance = springs.compliance_without(compliance)
        self._laws = contact.condensed_step(compliance, state, rule)
        self._scale, self._root = condensed.scale, condensed.root
        gap_sizes = np.maximum(np.abs(free_gap), np.abs(state.gap)).ravel()
        self._gap_sizes = gap_sizes / condensed.compliance.scale
        self._largest_gap = float(self._gap_sizes.max(initial=0.0))

    def at_free_gap(self, free_gap: Floats) -> JointStep:
        """Return this step with another free gap, shape (n, 3), [m] (collective)."""
        return JointStep(self.contact, self.condensed, free_gap, self.state, self.rule)

    def response(self, at: Iterate) -> Response:
        """Return the response of the joints at an iterate."""
        return self._laws.response(at.answers)

    def judged(self, at: Iterate, tolerance: float) -> tuple[float, float]:
        """Return the residual and the largest accepted residual.

        All values, including the tolerance, are relative to the largest force.
        """
        scale = at.scale
        relative, rounding = at.max_residual / scale, self.rounding(at) / scale
        if self.condensed.springs is None:
            # The force of a point that closes as the step ends is mostly rounding error.
            largest = limits.LARGEST_ROUNDING if rounding < 1.0 else limits.LARGEST_CONTACT_ROUNDING
            return relative, max(tolerance, min(rounding, largest))
        accepted = max(tolerance, min(rounding, limits.LARGEST_SPRING_ROUNDING))
        # On a mechanism spring forces dominate: use their rounding error as the residual.
        return (max(relative, rounding) if rounding > accepted else relative), accepted

    def is_balanced(self, at: Iterate) -> bool:
        """Return True if the residual is rounding error and unsupported blocks hardly moved."""
        return max(at.max_residual, self.rounding(at)) <= limits.BALANCED * at.largest

    @staticmethod
    def rounding(at: Iterate) -> float:
        """Return the scaled force due to rounding errors of the gaps."""
        return limits.GAP_ROUNDING * (at.reach + at.size)

    def forces(self, traction: Floats) -> Floats:
        """Return the scaled forces of tractions (n, 3), zero in directions that cannot move."""
        return self._root * traction.ravel()

    def evaluate(self, force: Floats, coupled: Floats, error: float = 0.0) -> Iterate:
        """Return the iterate of f and S f: residual f - s w t, tangent and norms (collective)."""
        trial_gap = self.free_gap - (self._scale * coupled).reshape(-1, 3)
        springs = self.condensed.springs
        if springs is not None:
            trial_gap = springs.trial_gap_without(
                trial_gap, self.condensed.compliance.own, self.state.gap
            )
        answers = self._laws.answers(trial_gap)
        traction, tangent = answers.traction, answers.tangent
        if springs is not None:
            gap = self._laws.response(answers).state.gap
            traction, tangent = springs.traction_without(
                traction, tangent, gap, self.condensed.compliance.own, self.state.gap
            )
        residual, scaled, sizes = _residual(
            force, coupled, answers.traction, traction, tangent, self._scale, self._root
        )
        sizes[5] = self._largest_gap if springs is None else self._active_gap(scaled, springs)
        if self._comm.size > 1:
            by_rank = of_ranks(self._comm, sizes)
            sizes = by_rank.max(axis=0)
            sizes[4] = by_rank[:, 4].sum()
        largest, max_residual, forces, gaps, square, reach = sizes.tolist()
        return Iterate(
            force=force,
            coupled=coupled,
            error=error,
            residual=residual,
            tangent=scaled,
            answers=answers,
            largest=largest,
            norm=square**0.5,
            max_residual=max_residual,
            reach=reach,
            size=forces + gaps,
        )

    def _active_gap(self, tangent: Floats, springs: JointSprings) -> float:
        """Return the largest scaled gap that affects the forces.

        Soft joints of unsupported blocks may open far, but only a share of the gap causes a force.
        """
        share = np.repeat(springs.stiffness * self.condensed.compliance.own, (1, 2), axis=1)
        active_share = np.minimum(np.maximum(np.abs(tangent).max(axis=1), share), 1.0)
        return float((active_share.ravel() * self._gap_sizes).max(initial=0.0))


@njit(cache=True)
def _residual(
    force: Floats,
    coupled: Floats,
    carried: Floats,
    traction: Floats,
    tangent: Floats,
    scale: Floats,
    root: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Return the scaled residual and tangent, zero where a point cannot move, and six norms.

    The norms are the largest force of the laws, the largest |r|, |f| and |S f|, and the squared
    2-norm of r. They are NaN if r is NaN. The caller sets the last entry.
    """
    residual, scaled, sizes = np.zeros_like(force), np.empty_like(tangent), np.zeros(6)
    for i in range(len(tangent)):
        for a in range(3):
            k = 3 * i + a
            difference = force[k] - root[k] * traction[i, a] if root[k] > 0.0 else 0.0
            residual[k] = difference
            sizes[0] = max(sizes[0], abs(root[k] * carried[i, a]))
            sizes[1] = max(sizes[1], abs(difference))
            sizes[2], sizes[3] = max(sizes[2], abs(force[k])), max(sizes[3], abs(coupled[k]))
            sizes[4] += difference * difference
            for b in range(3):
                scaled[i, a, b] = root[k] * tangent[i, a, b] * scale[3 * i + b]
    if not sizes[4] >= 0.0:
        sizes[1] = np.nan
    return residual, scaled, sizes
