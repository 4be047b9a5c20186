# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The joint forces of one step: their residual, its tangent, and sweeps over the points."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.law import JointState, Response, Rule
from dolfinx_joints.solvers.interface.condensed import Condensed

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

# Local points of each colour by law, and the unknowns of all points of the colour.
Colours = list[tuple[list[LawPoints], Rows]]


@dataclass(frozen=True, kw_only=True)
class Iterate:
    """Scaled forces with what follows from them.

    Attributes:
        force: f, shape (m,), the same on every rank.
        coupled: S f.
        residual: r.
        tangent: T, shape (points, 3, 3).
        largest: Largest scaled force that the law gives.
        response: Of the rank's points.
    """

    force: Floats
    coupled: Floats
    residual: Floats
    tangent: Floats
    largest: float
    response: Response


class JointStep:
    """The residual r(f) of one step."""

    def __init__(
        self,
        contact: Contact,
        condensed: Condensed,
        areas: Floats,
        mine: slice,
        trial_gap: Floats,
        state: JointState,
        rule: Rule,
    ) -> None:
        self.condensed, self._contact, self._mine = condensed, contact, mine
        self._compliance, self._areas = condensed.compliance, areas
        self._trial_gap, self.state, self._rule = trial_gap, state, rule
        passed = np.maximum(np.abs(trial_gap), np.abs(state.gap)).ravel()
        reach = float((passed / self._compliance.scale[mine]).max(initial=0.0))
        self._reach = contact.operator.comm.allreduce(reach, MPI.MAX)

    def rounding(self, at: Iterate) -> float:
        """Scaled force that rounding of the gaps may leave."""
        parts = self._reach, *(np.abs(v).max(initial=0.0) for v in (at.force, at.coupled))
        return 64.0 * float(np.finfo(float).eps) * float(sum(parts))

    def evaluate(self, force: Floats, coupled: Floats) -> Iterate:
        """Residual and tangent of all points, response of the rank's (collective)."""
        scale, comm = self._compliance.scale, self._contact.operator.comm
        gap = self._trial_gap - (scale * coupled)[self._mine].reshape(-1, 3)
        own, springs = self._compliance.own, self.condensed.springs
        if springs is None:
            response = self._contact.respond_condensed(gap, own, self.state, self._rule)
            traction, tangent = response.traction, response.tangent
        else:
            response = self._contact.respond_condensed(
                *springs.without(gap, own, self.state.gap), self.state, self._rule
            )
            traction, tangent = springs.taken_off(response, own, self.state.gap)
        forces = self._areas[self._mine] * scale[self._mine] * response.traction.ravel()
        # Where nothing can move, the scale has no meaning.
        forces[self._compliance.dead.ravel()[self._mine]] = 0.0
        largest = float(np.abs(forces).max(initial=0.0))
        if comm.size > 1:
            largest = comm.allreduce(largest, MPI.MAX)
            traction = np.concatenate(comm.allgather(traction))
            tangent = np.concatenate(comm.allgather(tangent))
        residual, scaled = _scaled(
            force, traction, tangent, scale, self._areas, self._compliance.dead
        )
        return Iterate(
            force=force,
            coupled=coupled,
            residual=residual,
            tangent=scaled,
            largest=largest,
            response=response,
        )

    def sweep(self, at: Iterate, colours: Colours) -> Iterate:
        """Each point solved with the others' forces fixed, one colour after the other (collective).

        Near points, which open and close together, see what their neighbours have just done.
        """
        compliance, comm = self._compliance, self._contact.operator.comm
        areas, mine = self._areas[self._mine], self._mine
        scale, dead = compliance.scale[mine], compliance.dead.ravel()[mine]
        forces, coupled = at.force[mine].copy(), at.coupled
        for colour, rows in colours:
            gap = self._trial_gap - (scale * coupled[mine]).reshape(-1, 3)
            change = np.zeros_like(forces)
            for points, traction in self._contact.condensed_tractions(
                colour, gap, compliance.own, self.state, self._rule
            ):
                here = (3 * points[:, None] + np.arange(3)).ravel()
                wanted = areas[here] * scale[here] * traction.ravel()
                change[here] = np.where(dead[here], 0.0, wanted) - forces[here]
            forces += change
            every = change if comm.size == 1 else np.concatenate(comm.allgather(change))
            coupled = coupled + compliance.split.product(every, rows)
        force = forces if comm.size == 1 else np.concatenate(comm.allgather(forces))
        return self.evaluate(force, coupled)


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
