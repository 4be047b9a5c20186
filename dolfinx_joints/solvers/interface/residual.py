# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint forces of one step: residual, tangent, elastic predictor, and sweeps over the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.law import JointState, Response, Rule
from dolfinx_joints.solvers.interface.condensed import Condensed
from dolfinx_joints.solvers.interface.low_rank import unknowns_of

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

# Residual of the linear systems of static solves at first, relative to their right-hand sides: few
# solves are made, and each correction is to use the whole of its linearisation.
STATIC_TOLERANCE = 3e-4

# Residual over the largest force below which forces on the line through the last two accepted
# states are close to a solution on the same path.
ON_LINE = 1e-3

# Residual of unsupported blocks over the largest force that is left to rounding: to correct it
# would move blocks that can rest anywhere.
BALANCED = 1e-12

# Largest share of the joint forces of unsupported blocks that may be rounding error of the forces
# of the artificial springs. It is reached where a block falls far before it is in contact.
LOOSE_ROUNDING = 1e-8

# Local points of each colour by law, and their unknowns.
Colours = list[tuple[list[LawPoints], Rows]]


@dataclass(frozen=True, kw_only=True)
class Iterate:
    """Scaled forces of the rank's points with what follows from them.

    Attributes:
        force: f, shape (m,).
        coupled: S f.
        residual: r.
        tangent: T, shape (points, 3, 3).
        response: Of the points.
        largest: Largest scaled force that the law gives, of all ranks.
        norm: 2-norm of r, of all ranks.
        worst: Largest |r|, of all ranks.
        reach: Largest scaled gap that forces follow from, of all ranks.
        size: Largest |f| plus the largest |S f| of all ranks.
    """

    force: Floats
    coupled: Floats
    residual: Floats
    tangent: Floats
    response: Response
    largest: float
    norm: float
    worst: float
    reach: float
    size: float


class JointStep:
    """The residual r(f) of one step."""

    def __init__(
        self,
        contact: Contact,
        condensed: Condensed,
        trial_gap: Floats,
        state: JointState,
        rule: Rule,
    ) -> None:
        self.condensed, self._contact = condensed, contact
        self._compliance, self._comm = condensed.compliance, contact.operator.comm
        self._areas = np.repeat(contact.operator.areas, 3)
        self.trial_gap, self.state, self.rule = trial_gap, state, rule
        passed = np.maximum(np.abs(trial_gap), np.abs(state.gap)).ravel()
        self._passed = passed / self._compliance.scale

    def at_trial_gap(self, trial_gap: Floats) -> JointStep:
        """Return the same step from another trial gap, shape (n, 3), [m]."""
        return JointStep(self._contact, self.condensed, trial_gap, self.state, self.rule)

    def judged(
        self, at: Iterate, relative: float, scale: float, tolerance: float
    ) -> tuple[float, float]:
        """Return the residual to be judged and the largest that is accepted.

        Args:
            at: The iterate.
            relative: Its residual over the largest force.
            scale: The largest force.
            tolerance: Residual asked for, relative to it.
        """
        rounding = self.rounding(at) / scale
        if self.condensed.springs is None:
            # A point that closes just at the end of the step carries a force dominated by rounding.
            return relative, max(tolerance, min(rounding, 1e-6 if rounding < 1.0 else 1e-3))
        accepted = max(tolerance, min(rounding, LOOSE_ROUNDING))
        # The artificial spring forces on a mechanism dominate the joint forces.
        return (max(relative, rounding) if rounding > accepted else relative), accepted

    @property
    def enough(self) -> float:
        """Residual over the largest force at which a static iteration ends: rounding."""
        return 1e-14 if self.condensed.springs is None else BALANCED

    def is_balanced(self, at: Iterate) -> bool:
        """Return True if rounding alone is left, and unsupported blocks have not moved far."""
        return max(at.worst, self.rounding(at)) <= BALANCED * at.largest

    @staticmethod
    def rounding(at: Iterate) -> float:
        """Scaled force that rounding of the gaps may leave."""
        return 64.0 * float(np.finfo(float).eps) * (at.reach + at.size)

    def forces(self, traction: Floats) -> Floats:
        """Return the scaled forces of tractions of shape (n, 3), zero where no point can move."""
        scale, dead = self._compliance.scale, self._compliance.dead
        return np.where(dead.ravel(), 0.0, self._areas * scale * traction.ravel())

    def evaluate(self, force: Floats, coupled: Floats) -> Iterate:
        """Residual, tangent and response (collective)."""
        scale, dead = self._compliance.scale, self._compliance.dead
        gap = self.trial_gap - (scale * coupled).reshape(-1, 3)
        own, springs = self._compliance.own, self.condensed.springs
        reach = self._passed
        if springs is None:
            response = self._contact.respond_condensed(gap, own, self.state, self.rule)
            traction, tangent = response.traction, response.tangent
        else:
            response = self._contact.respond_condensed(
                *springs.without(gap, own, self.state.gap), self.state, self.rule
            )
            traction, tangent = springs.taken_off(response, own, self.state.gap)
        given = self.forces(response.traction)
        residual, scaled = _scaled(force, traction, tangent, scale, self._areas, dead)
        if springs is not None:
            # Soft joints may move far, but make little of it.
            share = np.repeat(springs.stiffness * own, (1, 2), axis=1)
            felt = np.minimum(np.maximum(np.abs(scaled).max(axis=1), share), 1.0)
            reach = felt.ravel() * reach
        sizes = [np.abs(v).max(initial=0.0) for v in (given, residual, force, coupled, reach)]
        every = of_ranks(self._comm, np.array([*sizes, residual @ residual]))
        largest, worst, forces, gaps, far = (float(v) for v in every[:, :5].max(axis=0))
        return Iterate(
            force=force,
            coupled=coupled,
            residual=residual,
            tangent=scaled,
            response=response,
            largest=largest,
            norm=float(np.sqrt(every[:, 5].sum())),
            worst=worst,
            reach=far,
            size=forces + gaps,
        )

    def sweep(self, at: Iterate, colours: Colours) -> Iterate:
        """Each point solved with the others' forces fixed, one colour after the other (collective).

        Near points, which open and close together, see what their neighbours have just done.
        """
        compliance = self._compliance
        scale, dead = compliance.scale, compliance.dead.ravel()
        forces, coupled = at.force.copy(), at.coupled
        for colour, rows in colours:
            gap = self.trial_gap - (scale * coupled).reshape(-1, 3)
            change = np.zeros_like(forces)
            for points, traction in self._contact.condensed_tractions(
                colour, gap, compliance.own, self.state, self.rule
            ):
                here = unknowns_of(points)
                wanted = self._areas[here] * scale[here] * traction.ravel()
                change[here] = np.where(dead[here], 0.0, wanted) - forces[here]
            forces += change
            coupled = coupled + compliance.split.product(change, rows)
        return self.evaluate(forces, coupled)


class AcceptedForces:
    """Scaled forces f and S f of the last two accepted static solves.

    Under loads that grow in proportion, the next forces are on the line through them.
    """

    def __init__(self) -> None:
        """Start without any."""
        self._traction: Floats | None = None
        self._solved: tuple[Floats, Floats, Floats] | None = None
        self._forces: list[tuple[Floats, Floats]] = []

    def solved(self, traction: Floats, force: Floats, coupled: Floats) -> None:
        """Keep the tractions (n, 3) [Pa], f and S f of a solve that may be accepted."""
        self._solved = traction, force, coupled

    def start(self, step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
        """Return forces f and S f to start a step with (collective).

        They are on the line through the last two accepted forces if these are close to a solution,
        else those of the elastic predictor.

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
            if at.worst <= ON_LINE * at.largest:
                return line
        return elastic_predictor(step, traction)


def elastic_predictor(step: JointStep, traction: Floats) -> tuple[Floats, Floats]:
    """Return the scaled forces f of the elastic predictor and S f (collective).

    The laws are linearised at the accepted state, where the joints carry f0 and their gap is that
    of the state. With h0 the trial gaps of the laws there and T the tangent,

        f = f0 + T (h(f) - h0)   with   h(f) = h_trial - S f.                               (28e)

    Newton's method from f stays on the branch of equilibria that the state is on.

    Args:
        step: The static increment.
        traction: Tractions of the accepted state, shape (n, 3), [Pa].
    """
    condensed, compliance = step.condensed, step.condensed.compliance
    force = step.forces(traction)
    coupled = compliance.split.product(force, np.flatnonzero(force))
    own = np.repeat(compliance.own, (1, 2), axis=1)
    here = step.state.gap + own * traction + (compliance.scale * coupled).reshape(-1, 3)
    tangent = step.at_trial_gap(here).evaluate(force, coupled).tangent
    change = ((step.trial_gap - here).ravel() / compliance.scale).reshape(-1, 3)
    right = -np.einsum("nij,nj->ni", tangent, change).ravel()
    correction = condensed.corrections.solve(right, tangent, STATIC_TOLERANCE)
    return force - correction.step, coupled - correction.coupled


def tractions_of(contact: Contact, state: JointState, given: Floats | None) -> Floats:
    """Return the tractions of a state, shape (n, 3), [Pa] (collective).

    They follow from its gaps unless given; those of rigid joints are then zero.
    """
    if given is not None:
        return given
    if contact.rigid:
        return np.zeros_like(state.gap)
    return contact.at_gap(state.gap, state).traction


@njit(cache=True)
def _scaled(
    force: Floats,
    traction: Floats,
    tangent: Floats,
    scale: Floats,
    areas: Floats,
    dead: NDArray[np.bool_],
) -> tuple[Floats, Floats]:
    """Scaled residual f - s w t and tangent s w T s, which is zero where a point cannot move."""
    residual, scaled = force.copy(), np.zeros_like(tangent)
    for i in range(len(tangent)):
        for a in range(3):
            k = 3 * i + a
            root = scale[k] * areas[k]
            residual[k] = 0.0 if dead[i, a] else residual[k] - root * traction[i, a]
            for b in range(3):
                if not (dead[i, a] or dead[i, b]):
                    scaled[i, a, b] = root * tangent[i, a, b] * scale[3 * i + b]
    return residual, scaled
