# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Selection of the brittle bonds that are locked or released in a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.law import BROKEN, HELD, JointState, with_bonds

# Bonds with at least this fraction of the largest overload are released together.
RELEASED_TOGETHER = 0.9


class Bonds:
    """Bonds in a step: locked until the converged solution overloads them, then released.

    The most overloaded bonds are released first, since their failure may unload other bonds, as in
    short steps. The result does not depend on the iterates of the solver.
    """

    def __init__(self, parts: Sequence[LawPoints], comm: Any, state: JointState) -> None:
        self._parts, self._comm, self._state = parts, comm, state
        self._released: Flags = np.zeros(len(state.gap), dtype=bool)

    def start(self) -> JointState:
        """Return the state at the start of the step, with bonds locked or released."""
        internal = self._state.internal.copy()
        for part in self._parts:
            if part.brittle:
                points = part.points
                internal[points] = with_bonds(internal[points], self._released[points])
        return replace(self._state, internal=internal)

    def release(self, state: JointState) -> bool:
        """Release overloaded bonds; return True if a bond is overloaded (collective)."""
        excess = np.zeros(len(self._released))
        for part in self._parts:
            if part.brittle:
                excess[part.points] = np.maximum(HELD - state.internal[part.points, 0], 0.0)
        largest = max(self._comm.allgather(float(excess.max(initial=0.0))))
        self._released |= (excess > 0.0) & (excess >= RELEASED_TOGETHER * largest)
        return largest > 0.0


def broken_points(parts: Sequence[LawPoints], before: JointState, after: JointState) -> Flags:
    """Return True for local points whose bond broke between two states, shape (n,)."""
    broken = np.zeros(len(before.gap), dtype=bool)
    for part in parts:
        if part.brittle:
            bond_before, bond = (state.internal[part.points, 0] for state in (before, after))
            broken[part.points] = (bond_before < BROKEN) & (bond == BROKEN)
    return broken
