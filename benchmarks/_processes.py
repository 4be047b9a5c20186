# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of `_killed_job` started, and ended by signal 9 with all their processes."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from benchmarks._killed_job import Trace

POLL = 0.0002  # seconds between two looks at a process


class Process(Protocol):
    """What can be killed: a `subprocess.Popen`, or a process that `Server` has forked."""

    pid: int
    returncode: int | None

    def poll(self) -> int | None:
        """Exit status, None while it runs."""

    def wait(self) -> int:
        """Exit status, once it has ended."""


class Server:
    """A process that has loaded everything already and forks a new one for each line it gets.

    Args:
        command: It prints the number of each process and, later, the exit status.
        environment: Of the processes.
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        """Start it."""
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment)

    def start(self, line: str) -> Forked:
        """A new process; the one before it has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{line}\n".encode())
        self._process.stdin.flush()
        return Forked(self._process.stdout.fileno())

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


class Forked:
    """A process that a `Server` has forked.

    Args:
        told: Where the server prints.

    Attributes:
        pid: Its number.
        returncode: Its exit status, minus the signal that ended it; None while it runs.
    """

    def __init__(self, told: int) -> None:
        """It has just been started."""
        self._told = told
        self.pid = self._number()
        self.returncode: int | None = None

    def _number(self) -> int:
        """The next line."""
        line = b""
        while not line.endswith(b"\n"):
            read = os.read(self._told, 1)
            if not read:
                raise SystemExit("The process that forks others has ended.")
            line += read
        return int(line)

    def poll(self) -> int | None:
        """Exit status, None while it runs."""
        if self.returncode is None and select.select([self._told], [], [], 0.0)[0]:
            self.wait()
        return self.returncode

    def wait(self) -> int:
        """Exit status, once it has ended."""
        if self.returncode is None:
            self.returncode = self._number()
        return self.returncode


def _family(process: int) -> list[int]:
    """A process and all below it, the youngest first."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        for child in task.read_text().split():
            found += _family(int(child))
    return [*found, process]


def kill(process: Process) -> None:
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


class Starter:
    """Starts runs: on one rank as forks of a process that has loaded everything.

    Args:
        ranks: Processes of a run.
        steps: Its steps.
    """

    def __init__(self, ranks: int, steps: int) -> None:
        """On one rank, load everything."""
        self.ranks, self.steps = ranks, steps
        root = str(Path(__file__).resolve().parents[1])
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        # A rank that waits lets others work.
        more = {"PYTHONPATH": os.pathsep.join(paths), "OMPI_MCA_mpi_yield_when_idle": "1"}
        self._environment = {**os.environ, **more}
        self._command = [sys.executable, "-m", "benchmarks._killed_job"]
        self._server = None
        if ranks == 1:
            self._server = Server([*self._command, "serve"], self._environment)

    def start(self, folder: Path) -> Process:
        """Start a run, or go on with it."""
        for trace in folder.glob("trace*"):
            trace.unlink()
        Trace(folder / "trace")
        if self._server is not None:
            return self._server.start(f"{folder} {self.steps}")
        return subprocess.Popen(
            ["mpirun", "-n", str(self.ranks), *self._command, str(folder), str(self.steps)],
            stdout=subprocess.DEVNULL,
            stderr=(folder / "said").open("wb"),
            # What mpirun leaves when it is killed goes with the folder.
            env={**self._environment, "TMPDIR": str(folder)},
        )

    def close(self) -> None:
        """End what was loaded."""
        if self._server is not None:
            self._server.close()
