# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load steps of a static stage, and their increments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dolfinx_joints.common.errors import ConvergenceError
from dolfinx_joints.time_integration.substeps import locate

# Number of shortest increments in a load step.
FINEST = 2**6


@dataclass(frozen=True, kw_only=True)
class Increment:
    """Position of an increment on the load path.

    Attributes:
        time: Time [s] at the end of the load step, None for a ramp at time zero.
        share: Load factor at the end of the increment: 0 for the loads before the step (before the
            first step of a ramp), 1 for the loads at ``time``.
        whole: True if the load step ends with the increment.
        shortest: True if the increment cannot be halved.
        step: Number of the load step, from 1.
        start: Load factor at the start of the increment.
        elapsed: Time from the start of the increment to its end [s], zero in a ramp.
    """

    time: float | None
    share: float
    whole: bool
    shortest: bool
    step: int
    start: float
    elapsed: float = 0.0

    def locate(self, failure: ConvergenceError, remedy: str | None) -> ConvergenceError:
        """Return a failure with the position of the increment and a possible remedy."""
        place = {"stage": "static", "step": self.step, "time": self.time, "reached": self.start}
        return locate(failure, **place, remedy=remedy)


class LoadIncrements:
    """Increments of the load steps of a path: whole steps, or fractions of steps after a `cut`.

    An increment is a step divided by 2^k, k up to 6. The length doubles again after two increments
    of equal length. Loads vary linearly over a step, whatever its increments. The path contains
    time [s] and load factor of each step; the time is None for a ramp at time zero, which begins at
    the factor ``start``. With a controlled quantity, its values replace the factors. The path
    starts at ``time`` [s]. The attribute ``cuts`` is the number of halved increments.
    """

    def __init__(
        self, path: Sequence[tuple[float | None, float]], start: float = 0.0, time: float = 0.0
    ) -> None:
        self._path, self._level, self._repeats, self.cuts = path, 0, False, 0
        self._step, self._reached, self._before = 0, start, time

    def __iter__(self) -> Iterator[Increment]:
        """Yield the increments; after a `cut`, a shorter increment from the same start."""
        for time, share in self._path:
            self._step += 1
            start = self._reached if time is None else 0.0
            done, length = 0, 0.0 if time is None else time - self._before
            while done < FINEST:
                current = start + (share - start) * done / FINEST
                end = done + (FINEST >> self._level)
                whole = end == FINEST
                factor = share if whole else start + (share - start) * end / FINEST
                yield Increment(
                    time=time,
                    share=factor,
                    whole=whole,
                    shortest=FINEST >> self._level == 1,
                    step=self._step,
                    start=current,
                    elapsed=length * (end - done) / FINEST,
                )
                if self._repeats:
                    self._repeats = False
                    continue
                done, self._reached = end, factor
                if self._level and done % (FINEST >> (self._level - 1)) == 0:
                    self._level -= 1
            self._before += length

    def cut(self) -> None:
        """Halve the increment: the next one starts from the same load factor."""
        self._level, self._repeats, self.cuts = self._level + 1, True, self.cuts + 1
