# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load steps of a static stage, cut into increments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.time_integration.substeps import located

# Shortest increments in a load step.
FINEST = 2**6


@dataclass(frozen=True, kw_only=True)
class Increment:
    """Place of an increment of the loads.

    Attributes:
        time: Time [s] of the loads, None for a ramp at time zero.
        share: Of the way from the loads before to those at this time.
        whole: Whether the load step ends here.
        shortest: Whether it cannot be cut.
        step: Number of its load step, from 1.
        start: Load factor at its start, as ``share`` of a ramp and of each step in time.
    """

    time: float | None
    share: float
    whole: bool
    shortest: bool
    step: int
    start: float

    def located(self, failure: ConvergenceError, remedy: str | None) -> ConvergenceError:
        """Return a failure with the place of the increment and one sentence on what may help."""
        place = {"stage": "static", "step": self.step, "time": self.time, "reached": self.start}
        return located(failure, **place, remedy=remedy)


class LoadIncrements:
    """Increments of the load steps of a path: whole steps, and halves of them after a `cut`.

    They stay on the levels step / 2^k, k up to 6, and are longer again as soon as they fit. All of
    them lie on the straight line between the loads at the ends of the step, whatever was cut.

    Args:
        path: Time [s] of each step, None for a ramp at time zero, and its share of the way from the
            loads before to those at this time. Of a ramp they are those before its first step.

    Attributes:
        cuts: Increments that were cut.
    """

    def __init__(self, path: Sequence[tuple[float | None, float]]) -> None:
        """Begin with whole steps."""
        self._path, self._level, self._again, self.cuts = path, 0, False, 0
        self._step, self._reached = 0, 0.0

    def __iter__(self) -> Iterator[Increment]:
        """Each increment; after a `cut` a shorter one from the same start."""
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
