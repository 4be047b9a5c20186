# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds of the joints that may break: which of them a step is solved with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.joints.law_points import LawPoints
from dolfinx_joints.laws.law import OVERLOADED, JointState, with_bonds


class Bonds:
    """Bonds that hold in a step until its solution overloads them, then all of these go.

    So what breaks does not depend on the way that a solver takes, nor on its rounding where
    several bonds are loaded alike.

    Args:
        parts: Points of the brittle laws.
        comm: Communicator of the joints.
        state: State at the start of the step.
    """

    def __init__(self, parts: Sequence[LawPoints], comm: Any, state: JointState) -> None:
        """Hold all."""
        self._parts, self._comm, self._state = parts, comm, state
        self._released: NDArray[np.bool_] = np.zeros(len(state.gap), dtype=bool)

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
        over = np.zeros_like(self._released)
        for part in self._parts:
            if part.brittle:
                over[part.points] = state.internal[part.points, 0] == OVERLOADED
        self._released |= over
        return any(self._comm.allgather(bool(over.any())))
