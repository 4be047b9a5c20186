# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress of long work, logged by the logger ``dolfinx_joints``."""

from __future__ import annotations

import logging
from time import perf_counter
from typing import Literal

LOGGER = logging.getLogger("dolfinx_joints")
INTERVAL = 5.0  # between two lines on the same work [s]

Level = Literal["DEBUG", "INFO", "WARNING", "ERROR"]


def set_log_level(level: Level) -> None:
    """Print log lines of at least this level to standard error.

    ``INFO`` reports compilation, the progress and remaining time of static stages, compliances,
    time steps, reports and films, the meshes written, and the finished cases of a study.
    ``WARNING`` is the default and suppresses these lines. A program that configures `logging` gets
    the lines of the logger ``dolfinx_joints`` without this function.
    """
    LOGGER.setLevel(level)
    if not LOGGER.hasHandlers():
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
        LOGGER.addHandler(handler)


class Progress:
    """Progress of work in parts of similar size; it logs the remaining time every few seconds.

    The estimate leaves out the first part, which may include compilation.

    Args:
        what: Name of the work.
        total: Number of parts.
        unit: Name of the parts, in the plural.
        rank: Rank of the process; only rank 0 logs.
        done: Number of parts that are already complete at the start.
    """

    def __init__(self, what: str, total: int, unit: str, rank: int = 0, done: int = 0) -> None:
        self._before = done
        self._what, self._total, self._unit, self._shows = what, total, unit, rank == 0
        self._done, self._began = done, perf_counter()
        self._first: tuple[int, float] | None = None
        self._last_line = self._began

    def advance(self, parts: int = 1) -> None:
        """Count finished parts, and log the progress from time to time."""
        self._done += parts
        if not self._shows or not LOGGER.isEnabledFor(logging.INFO):
            return
        now = perf_counter()
        if self._first is None:
            self._first = self._done, now
        done, since = self._first
        if now - self._last_line >= INTERVAL and done < self._done < self._total:
            self._last_line = now
            remaining = (self._total - self._done) * (now - since) / (self._done - done)
            text = "%s: %d of %d %s, %s left"
            LOGGER.info(text, self._what, self._done, self._total, self._unit, duration(remaining))

    def finish(self) -> None:
        """Log the duration of the work."""
        if self._shows:
            seconds = duration(perf_counter() - self._began)
            done = self._done - self._before
            LOGGER.info("%s: %d %s in %s", self._what, done, self._unit, seconds)


def duration(seconds: float) -> str:
    """Return a duration as text: ``4.2 s``, ``3 min 20 s``, ``2 h 5 min``."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, remainder = divmod(round(seconds), 60)
    return (
        f"{minutes} min {remainder} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
    )
