# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Detection of chatter: joint points that close and open again every few steps.

Frictional sliding excites the shortest waves of an undamped body. Points of a stiff joint then
close only briefly and slip back and forth, and the mean friction stays below the limit.
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

# Number of steps that resolve a contact or an open phase. A joint chatters if it has more than
# REPEATED shorter contacts per point, with more than LARGE_SHARE of the normal impulse.
RESOLVED, REPEATED, LARGE_SHARE = 10, 20, 0.2


class Chatter:
    """Share of the normal impulse of each joint that acts in short sliding contacts.

    A contact is short if it is shorter than `RESOLVED` steps or than a subdivided step. It counts
    if the open phase before it was also short; rebounds of a block are not chatter.

    Args:
        contact: The joints, or None.
    """

    def __init__(self, contact: Contact | None) -> None:
        self._contact = contact
        points = 0 if contact is None else len(contact.operator.joint)
        # Per point: time, impulse, friction work of the contact; time of the last open phase.
        self._duration, self._impulse, self._friction = np.zeros((3, points))
        self._open_time: Floats = np.full(points, np.inf)
        # Per joint on this rank: short contacts, their impulse, total impulse.
        self._sums: Floats = np.zeros((3, 0 if contact is None else len(contact.operator.names)))
        self._shares: dict[str, float] = {}

    def record(self, joints: Response, dt: float, whole: float) -> None:
        """Record a substep of length dt [s] of a step of length ``whole`` [s]."""
        if self._contact is None:
            return
        operator = self._contact.operator
        resolved = max((RESOLVED - 0.5) * dt, whole)
        points = self._duration, self._impulse, self._friction, self._open_time
        fields = operator.areas, joints.traction, joints.dissipation
        _record(*fields, operator.joint, dt, resolved, points, self._sums)

    def _total(self) -> Floats:
        """Return the sums over all ranks (collective)."""
        assert self._contact is not None
        return np.sum(self._contact.operator.comm.allgather(self._sums), axis=0)

    def joints(self) -> dict[str, float]:
        """Return the impulse share of short contacts by name of chattering joint (collective).

        A joint that no longer chatters keeps the value of the last call at which it chattered.
        """
        if self._contact is None:
            return {}
        operator, (contacts, short_impulse, impulse) = self._contact.operator, self._total()
        count = len(operator.names)
        points = sum(operator.comm.allgather(np.bincount(operator.joint, minlength=count)))
        share = short_impulse / np.where(impulse > 0.0, impulse, 1.0)
        chatters = (contacts > REPEATED * points) & (share > LARGE_SHARE)
        self._shares |= {operator.names[i]: float(share[i]) for i in np.flatnonzero(chatters)}
        return self._shares

    def state_dict(self) -> dict[str, Any]:
        """Return the recorded data for a restart (collective)."""
        if self._contact is None:
            return {}
        points = np.column_stack([self._duration, self._impulse, self._friction, self._open_time])
        own_points = Dealt(self._contact.operator.comm, points)
        return {"found": dict(self._shares), "sums": self._total(), "points": own_points}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the data of ``state_dict``, which contains the points of this rank."""
        if self._contact is None:
            return
        self._duration, self._impulse, self._friction, self._open_time = state_dict[
            "points"
        ].T.copy()
        self._shares = dict(state_dict["found"])
        if self._contact.operator.comm.rank == 0:
            self._sums[:] = state_dict["sums"]


@njit(cache=True)
def _record(
    areas: Floats,
    traction: Floats,
    dissipation: Floats,
    joint: NDArray[Any],
    dt: float,
    resolved: float,
    points: tuple[Floats, Floats, Floats, Floats],
    sums: Floats,
) -> None:
    """Record a substep; ``points`` and ``sums`` are the arrays of `Chatter`."""
    contact_time, impulse, friction_work, open_time = points
    for i in range(len(areas)):
        pressure = -areas[i] * traction[i, 0] * dt
        if pressure > 0.0:
            sums[2, joint[i]] += pressure
            contact_time[i] += dt
            impulse[i] += pressure
            friction_work[i] += abs(dissipation[i])
            continue
        if contact_time[i] > 0.0:
            if max(contact_time[i], open_time[i]) < resolved and friction_work[i] > 0.0:
                sums[0, joint[i]] += 1.0
                sums[1, joint[i]] += impulse[i]
            open_time[i] = 0.0
        open_time[i] += dt
        contact_time[i], impulse[i], friction_work[i] = 0.0, 0.0, 0.0
