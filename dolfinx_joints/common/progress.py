# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress of work that takes long, as lines of the logger ``dolfinx_joints``."""

from __future__ import annotations

import logging
from time import perf_counter
from typing import Literal

LOGGER = logging.getLogger("dolfinx_joints")
INTERVAL = 5.0  # between two lines on the same work [s]

Level = Literal["DEBUG", "INFO", "WARNING", "ERROR"]


def set_log_level(level: Level) -> None:
    """Show what runs do on standard error, from a level on.

    ``INFO`` tells that loops are compiled, how far static stages, compliances, time steps, reports
    and films are and how long they will still take, which meshes were written and which cases of a
    study have ended; ``WARNING``, with which a program begins, tells nothing of that. A program
    that has set up `logging` itself gets the lines of the logger ``dolfinx_joints`` without this.
    """
    LOGGER.setLevel(level)
    if not LOGGER.hasHandlers():
        handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
        LOGGER.addHandler(handler)


class Progress:
    """Work in parts of about the same size: a line now and then, with the time left.

    The first part, in which functions may be compiled, does not count for the time left.

    Args:
        what: Name of the work.
        total: Number of parts.
        unit: What a part is called, in the plural.
        rank: Rank of the process; only rank 0 writes.
        done: Parts that were done before.
    """

    def __init__(self, what: str, total: int, unit: str, rank: int = 0, done: int = 0) -> None:
        self._before = done
        self._what, self._total, self._unit, self._shows = what, total, unit, rank == 0
        self._done, self._began = done, perf_counter()
        self._first: tuple[int, float] | None = None
        self._told = self._began

    def advance(self, parts: int = 1) -> None:
        """Count parts that are done."""
        self._done += parts
        if not self._shows or not LOGGER.isEnabledFor(logging.INFO):
            return
        now = perf_counter()
        if self._first is None:
            self._first = self._done, now
        done, since = self._first
        if now - self._told >= INTERVAL and done < self._done < self._total:
            self._told = now
            left = (self._total - self._done) * (now - since) / (self._done - done)
            text = "%s: %d of %d %s, %s left"
            LOGGER.info(text, self._what, self._done, self._total, self._unit, duration(left))

    def finish(self) -> None:
        """Tell how long it took."""
        if self._shows:
            seconds = duration(perf_counter() - self._began)
            done = self._done - self._before
            LOGGER.info("%s: %d %s in %s", self._what, done, self._unit, seconds)


def duration(seconds: float) -> str:
    """A time for people: ``4.2 s``, ``3 min 20 s``, ``2 h 5 min``."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
