# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""How often Newton's corrections may be halved, from how the residual has fallen so far."""

from __future__ import annotations

# Where the residual does not fall to this part in so many iterations, so many corrections are
# taken whole.
PATIENCE, FALL, WHOLE = 5, 0.9, 2


class LineSearch:
    """Halvings allowed to each correction of a solve.

    The residual has kinks where points open or slide. Corrections halved until it falls may creep
    towards a kink that is no solution; a few whole ones leave it.

    Args:
        max_cuts: Halvings allowed where the residual falls.
        leaps: Whether whole corrections may be taken. Beyond the limit of plastic cells they run
            away, until the residual is little beside the stiffness times the displacement.
    """

    def __init__(self, max_cuts: int, *, leaps: bool = True) -> None:
        """Begin a solve."""
        self._max_cuts, self._whole, self._leaps = max_cuts, 0, leaps
        self._norms: list[float] = []

    def cuts(self, norm: float) -> int:
        """Halvings allowed to the next correction, from a residual of this norm."""
        self._norms.append(norm)
        stalls = len(self._norms) > PATIENCE and norm > FALL * self._norms[-1 - PATIENCE]
        if self._leaps and stalls:
            self._whole = WHOLE
        if self._whole == 0:
            return self._max_cuts
        self._whole, self._norms = self._whole - 1, []
        return 0
