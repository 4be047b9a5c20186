# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds of the joints that may break: which of them a step is solved with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.law import BROKEN, HELD, JointState, with_bonds

# Bonds with this part of the largest overload go with it.
ALIKE = 0.9


class Bonds:
    """Bonds that hold in a step until its solution overloads them; those with most of it go first.

    So what breaks does not depend on the way that a solver takes, and what lets go may unload
    others, as it does in steps that are short.
    """

    def __init__(self, parts: Sequence[LawPoints], comm: Any, state: JointState) -> None:
        self._parts, self._comm, self._state = parts, comm, state
        self._released: Flags = np.zeros(len(state.gap), dtype=bool)

    def start(self) -> JointState:
        """State at the start of the step, as laws are to take it."""
        internal = self._state.internal.copy()
        for part in self._parts:
            if part.brittle:
                here = part.points
                internal[here] = with_bonds(internal[here], self._released[here])
        return replace(self._state, internal=internal)

    def release(self, state: JointState) -> bool:
        """Whether bonds are overloaded in a solution, which are released then (collective)."""
        excess = np.zeros(len(self._released))
        for part in self._parts:
            if part.brittle:
                excess[part.points] = np.maximum(HELD - state.internal[part.points, 0], 0.0)
        most = max(self._comm.allgather(float(excess.max(initial=0.0))))
        self._released |= (excess > 0.0) & (excess >= ALIKE * most)
        return most > 0.0


def broken_points(parts: Sequence[LawPoints], before: JointState, after: JointState) -> Flags:
    """Return at which local points bonds have broken between two states, shape (n,)."""
    found = np.zeros(len(before.gap), dtype=bool)
    for part in parts:
        if part.brittle:
            was, bond = (state.internal[part.points, 0] for state in (before, after))
            found[part.points] = (was < BROKEN) & (bond == BROKEN)
    return found
