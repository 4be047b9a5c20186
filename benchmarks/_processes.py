# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes with all below them, and their end by signal 9."""

from __future__ import annotations

import os
import signal
import subprocess
import time as clock
from contextlib import suppress
from pathlib import Path

POLL = 0.0002  # seconds between two looks at a process


def _family(process: int) -> list[int]:
    """A process and all below it, the youngest first."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        for child in task.read_text().split():
            found += _family(int(child))
    return [*found, process]


def kill(process: subprocess.Popen[bytes]) -> None:
    """Signal 9 to a run, to each of its processes, and wait until all are gone."""
    members = _family(process.pid)
    for member in members:
        with suppress(ProcessLookupError):  # it has ended
            os.kill(member, signal.SIGKILL)
    process.wait()
    while any(_lives(member) for member in members):
        clock.sleep(POLL)


def _lives(process: int) -> bool:
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return status.rpartition(")")[2].split()[0] not in ("Z", "X")
