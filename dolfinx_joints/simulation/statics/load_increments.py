# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load steps of a static stage, cut where they do not converge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.time_integration.substeps import located

# Shortest increments in a load step.
FINEST = 2**6


@dataclass(frozen=True, kw_only=True)
class Increment:
    """Where an increment of the loads ends.

    Attributes:
        time: Time [s] of the loads, None for a ramp at time zero.
        share: Of the way from the loads before to those at this time.
        whole: Whether the load step ends here.
        last_resort: Whether it is the shortest increment, for which all solvers are tried.
    """

    time: float | None
    share: float
    whole: bool
    last_resort: bool


class LoadIncrements:
    """Increments of the load steps of a path: whole steps, and halves of them after a `cut`.

    They stay on the levels step / 2^k, k up to 6, and are longer again as soon as they fit. All of
    them lie on the straight line between the loads at the ends of the step, whatever was cut.

    Args:
        path: Time [s] of each step, None for a ramp at time zero, and its share of the way from the
            loads before to those at this time. Of a ramp they are those before its first step.

    Attributes:
        cuts: Increments that were cut.
        reached: Share of the way that is in equilibrium.
    """

    def __init__(self, path: Sequence[tuple[float | None, float]]) -> None:
        """Begin with whole steps."""
        self._path, self._level, self._again, self.cuts = path, 0, False, 0
        self._step, self.reached = 0, 0.0

    def __iter__(self) -> Iterator[Increment]:
        """Each increment; after a `cut` a shorter one from the same start."""
        for time, share in self._path:
            self._step += 1
            start = self.reached if time is None else 0.0
            done = 0
            while done < FINEST:
                self.reached = start + (share - start) * done / FINEST
                end = done + (FINEST >> self._level)
                whole = end == FINEST
                part = share if whole else start + (share - start) * end / FINEST
                last = FINEST >> self._level == 1
                yield Increment(time=time, share=part, whole=whole, last_resort=last)
                if self._again:
                    self._again = False
                    continue
                done, self.reached = end, part
                if self._level and done % (FINEST >> (self._level - 1)) == 0:
                    self._level -= 1

    def cut(self, failure: ConvergenceError, remedy: str | None) -> None:
        """Go back to the start of the increment, to take half of it; the shortest one raises.

        Args:
            failure: Of the increment.
            remedy: What may help, one sentence.

        Raises:
            ConvergenceError: The failure, where it happened and the remedy.
        """
        if FINEST >> self._level == 1:
            time = self._path[self._step - 1][0]
            place = {"stage": "static", "step": self._step, "time": time, "reached": self.reached}
            raise located(failure, **place, remedy=remedy) from None
        self._level, self._again, self.cuts = self._level + 1, True, self.cuts + 1
