# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Finds joints whose points chatter: touch and lift every few steps, on and on.

Sliding with friction feeds the shortest waves of a body without damping, until points of a stiff
joint hardly touch any more, slip back and forth, and friction in the mean is less than its limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Dealt, Floats
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import Response

# Steps of a contact or a flight that a run resolves; shorter contacts per point that are more than
# impacts; their share of the normal impulse.
RESOLVED, REPEATED, LARGE_SHARE = 10, 20, 0.2


class Chatter:
    """Keeps how much of the pressure of each joint comes in short contacts that slide.

    Short is below `RESOLVED` steps, or below the step that was cut. A contact counts if the flight
    before it was as short: a body that bounces does not chatter.

    Args:
        contact: The joints, None without.
    """

    def __init__(self, contact: Contact | None) -> None:
        self._contact = contact
        points = 0 if contact is None else len(contact.operator.joint)
        # By point: time of its contact, impulse, friction work; time of the last flight.
        self._lasts, self._impulse, self._rubbed = np.zeros((3, points))
        self._flight: Floats = np.full(points, np.inf)
        # By joint: short contacts, their impulse, all impulse; on this rank.
        self._sums: Floats = np.zeros((3, 0 if contact is None else len(contact.operator.names)))
        self._found: dict[str, float] = {}

    def see(self, joints: Response, dt: float, whole: float) -> None:
        """Take note of a substep of length dt [s] of a step of length ``whole`` [s]."""
        if self._contact is None:
            return
        operator = self._contact.operator
        resolved = max((RESOLVED - 0.5) * dt, whole)
        points = self._lasts, self._impulse, self._rubbed, self._flight
        given = operator.areas, joints.traction, joints.dissipation
        _see(*given, operator.joint, dt, resolved, points, self._sums)

    def _total(self) -> Floats:
        """Sums over all ranks (collective)."""
        assert self._contact is not None
        return np.sum(self._contact.operator.comm.allgather(self._sums), axis=0)

    def joints(self) -> dict[str, float]:
        """Share of normal impulse in short contacts, of joints found to chatter (collective).

        Of the newest time that this was asked and they did.
        """
        if self._contact is None:
            return {}
        operator, (short, brief, all_of) = self._contact.operator, self._total()
        count = len(operator.names)
        points = sum(operator.comm.allgather(np.bincount(operator.joint, minlength=count)))
        share = brief / np.where(all_of > 0.0, all_of, 1.0)
        chatters = (short > REPEATED * points) & (share > LARGE_SHARE)
        self._found |= {operator.names[i]: float(share[i]) for i in np.flatnonzero(chatters)}
        return self._found

    def state_dict(self) -> dict[str, Any]:
        """What has been seen so far (collective)."""
        if self._contact is None:
            return {}
        points = np.column_stack([self._lasts, self._impulse, self._rubbed, self._flight])
        every = Dealt(self._contact.operator.comm, points)
        return {"found": dict(self._found), "sums": self._total(), "points": every}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave, of this rank's points."""
        if self._contact is None:
            return
        self._lasts, self._impulse, self._rubbed, self._flight = state_dict["points"].T.copy()
        self._found = dict(state_dict["found"])
        if self._contact.operator.comm.rank == 0:
            self._sums[:] = state_dict["sums"]


@njit(cache=True)
def _see(
    areas: Floats,
    traction: Floats,
    dissipation: Floats,
    joint: NDArray[Any],
    dt: float,
    resolved: float,
    points: tuple[Floats, Floats, Floats, Floats],
    sums: Floats,
) -> None:
    """Take note of a substep; the last two are those of `Chatter`."""
    lasts, impulse, rubbed, flight = points
    for i in range(len(areas)):
        pressure = -areas[i] * traction[i, 0] * dt
        if pressure > 0.0:
            sums[2, joint[i]] += pressure
            lasts[i] += dt
            impulse[i] += pressure
            rubbed[i] += abs(dissipation[i])
            continue
        if lasts[i] > 0.0:
            if max(lasts[i], flight[i]) < resolved and rubbed[i] > 0.0:
                sums[0, joint[i]] += 1.0
                sums[1, joint[i]] += impulse[i]
            flight[i] = 0.0
        flight[i] += dt
        lasts[i], impulse[i], rubbed[i] = 0.0, 0.0, 0.0
