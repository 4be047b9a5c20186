# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load steps of a static stage, and their increments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.time_integration.substeps import located

# Number of shortest increments in a load step.
FINEST = 2**6


@dataclass(frozen=True, kw_only=True)
class Increment:
    """Position of an increment on the load path.

    Attributes:
        time: Time [s] at the end of the load step, None for a ramp at time zero.
        share: Load factor at the end of the increment: 0 for the loads before the step (before the
            first step of a ramp), 1 for the loads at ``time``.
        whole: Whether the load step ends with the increment.
        shortest: Whether the increment cannot be halved.
        step: Number of its load step, from 1.
        start: Load factor at the start of the increment.
    """

    time: float | None
    share: float
    whole: bool
    shortest: bool
    step: int
    start: float

    def located(self, failure: ConvergenceError, remedy: str | None) -> ConvergenceError:
        """Return a failure with the position of the increment and a possible remedy."""
        place = {"stage": "static", "step": self.step, "time": self.time, "reached": self.start}
        return located(failure, **place, remedy=remedy)


class LoadIncrements:
    """Increments of the load steps of a path: whole steps, and parts of them after a `cut`.

    An increment is a step divided by 2^k, k up to 6. Its length doubles again after two increments
    of one length. The loads change on a straight line over the step, regardless of the increments.
    The path has the time [s] of each step, None for a ramp at time zero, and its load factor. The
    attribute ``cuts`` is the number of halved increments.
    """

    def __init__(self, path: Sequence[tuple[float | None, float]]) -> None:
        """Start with whole steps."""
        self._path, self._level, self._again, self.cuts = path, 0, False, 0
        self._step, self._reached = 0, 0.0

    def __iter__(self) -> Iterator[Increment]:
        """Yield the increments; after a `cut` a shorter one from the same start."""
        for time, share in self._path:
            self._step += 1
            start = self._reached if time is None else 0.0
            done = 0
            while done < FINEST:
                reached = start + (share - start) * done / FINEST
                end = done + (FINEST >> self._level)
                whole = end == FINEST
                part = share if whole else start + (share - start) * end / FINEST
                yield Increment(
                    time=time,
                    share=part,
                    whole=whole,
                    shortest=FINEST >> self._level == 1,
                    step=self._step,
                    start=reached,
                )
                if self._again:
                    self._again = False
                    continue
                done, self._reached = end, part
                if self._level and done % (FINEST >> (self._level - 1)) == 0:
                    self._level -= 1

    def cut(self) -> None:
        """Repeat the increment from its start with half of its length."""
        self._level, self._again, self.cuts = self._level + 1, True, self.cuts + 1
