# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Many cases of one function, several at once, each in a process of its own; resumable.

A folder holds everything::

    rows/CASE.json   the row of a finished or failed case, written by the case itself
    cases/CASE/      what the case wrote, and log.txt with what it printed
    table.h5         the rows gathered, in the order of the cases; `read_table` reads it
    lock             held while a runner or one of its cases is alive

Killing the runner at any moment, also by signal 9, ends its cases and loses only those that were
under way; the next run does the rest.
"""

from __future__ import annotations

import fcntl
import inspect
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.parameters import (
    check_count,
    check_flag,
    check_kind_of,
    check_path,
    shown,
)
from dolfinx_joints.study_table import (
    OWN_COLUMNS,
    TABLE,
    Row,
    Table,
    gather,
    plain_text,
    read_row,
    read_table,
    write_csv,
    write_row,
    write_table,
)

__all__ = ["Study", "Tally", "read_table", "write_csv"]

Function = Callable[..., Mapping[str, Any]]

LOCK_SECONDS = 5.0  # for cases of a killed runner to end
_POLL_SECONDS = 0.05
_LOG_TAIL = 65536  # bytes at the end of a log that are looked at for its last line
_RANK_COUNTS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")
_OF_MPI = ("OMPI_COMM_WORLD_", "OMPI_UNIVERSE_", "PMIX_", "PMI_", "MPI_LOCAL")


@dataclass(frozen=True, kw_only=True)
class Tally:
    """What a call of `Study.run` did.

    Attributes:
        done: Cases that ran to their end.
        failed: Cases that failed, with their reasons.
        skipped: Cases that had a row already and were left alone.
    """

    done: list[str]
    failed: dict[str, str]
    skipped: list[str]

    def __str__(self) -> str:
        """A line, and one more per failure."""
        text = f"{len(self.done)} cases run, {len(self.skipped)} were there already, "
        text += f"{len(self.failed)} failed"
        return "\n".join([text, *(f"  {name}: {why}" for name, why in self.failed.items())])


class Study:
    """One function, many named cases, one row per case.

    The function is called as ``function(folder, **parameters)`` and returns the values of the row,
    a mapping of names to numbers or texts. It must be at the top level of a module, since every
    case runs in a fresh interpreter that imports it: nothing is shared, least of all MPI.

    A case is known by its name and parameters; that the function itself has changed goes unnoticed.

    Args:
        path: Folder of the study, made where missing.
        function: What to run; writes files into the folder that it is given, which is empty.
        cases: Parameters by name of the case, anything JSON can hold. The table has their order.

    Raises:
        ValueError: A name is no file name, the function does not take a parameter, or cannot be
            imported by another process.
    """

    def __init__(
        self, path: str | Path, function: Function, cases: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Nothing is written yet."""
        check_path("path", path)
        check_kind_of("cases", cases, isinstance(cases, Mapping), "parameters by name of a case")
        self.path = Path(path)
        self._module, self._function = _address(function)
        self.cases: dict[str, dict[str, Any]] = {}
        for name, parameters in cases.items():
            if not isinstance(name, str) or not re.fullmatch(r"\w[\w.=+-]{0,99}", name):
                raise ValueError(
                    f"The case {shown(name)} must have a name of letters, digits and any of "
                    "_ . = + -, 100 at most."
                )
            _check_parameters(function, name, parameters)
            self.cases[name] = json.loads(json.dumps(dict(parameters)))

    def run(
        self,
        *,
        workers: int = 1,
        only: Sequence[str] | None = None,
        retry_failed: bool = False,
        rerun_changed: bool = False,
        progress: bool = True,
    ) -> Tally:
        """Run the cases that have no row yet.

        Args:
            workers: Cases at once.
            only: Names of the cases to run, all unless given.
            retry_failed: Run failed cases again.
            rerun_changed: Run cases again whose parameters differ from those of their rows; they
                are refused otherwise.
            progress: Show a bar.

        Raises:
            ValueError: ``workers`` is not positive, or ``only`` names an unknown case.
            StudyError: Another runner is at work here, several MPI ranks called, parameters of
                a case have changed, or a row or the table cannot be written.
        """
        check_count("workers", workers, 1, "one or more cases may run at once")
        flags = {"retry_failed": retry_failed, "rerun_changed": rerun_changed, "progress": progress}
        for name, flag in flags.items():
            check_flag(name, flag)
        chosen = self._chosen(only)
        if any(int(os.environ.get(name, "1")) > 1 for name in _RANK_COUNTS):
            raise StudyError("A study starts processes of its own: run it without mpirun.")
        with self._locked() as lock:
            waiting = self._waiting(chosen, retry_failed, rerun_changed)
            self._write_table()
            done = self._work(list(waiting), workers, lock, progress)
        rows = {name: read_row(self._row(name)) for name in done}
        failed = {n: row["reason"] for n, row in rows.items() if row and row["status"] == "failed"}
        return Tally(
            done=[name for name in done if name not in failed],
            failed=failed,
            skipped=[name for name in chosen if name not in waiting],
        )

    def folder(self, name: str) -> Path:
        """Where a case writes its files."""
        return self.path / "cases" / name

    def table(self) -> Table:
        """The rows that there are, gathered; see `read_table`."""
        rows = (read_row(self._row(name)) for name in self.cases)
        return gather([row for row in rows if row is not None])

    def _row(self, name: str) -> Path:
        return self.path / "rows" / f"{name}.json"

    def _chosen(self, only: Sequence[str] | None) -> list[str]:
        if only is None:
            return list(self.cases)
        check_kind_of("only", only, isinstance(only, list | tuple), "a list of names of cases")
        for name in only:
            if not isinstance(name, str) or name not in self.cases:
                known = ", ".join(self.cases) or "none"
                raise ValueError(f"There is no case {shown(name)}; there are {known}.")
        return [name for name in self.cases if name in only]

    def _waiting(self, chosen: list[str], retry: bool, rerun: bool) -> list[str]:
        """Cases to run now."""
        waiting = []
        for name in chosen:
            row = read_row(self._row(name))
            changed = "" if row is None else _difference(row["parameters"], self.cases[name])
            if changed and not rerun:
                raise StudyError(
                    f"The case {name!r} in {self.path} was run with other parameters ({changed}): "
                    "give it another name, or ask for changed cases to be run again."
                )
            if row is None or changed or (retry and row["status"] == "failed"):
                waiting.append(name)
        return waiting

    def _write_table(self) -> None:
        write_table(self.path / TABLE, self.table())

    def _work(self, waiting: list[str], workers: int, lock: int, progress: bool) -> list[str]:
        """Run cases until none is left; their names in the order of the cases."""
        from tqdm import tqdm

        total, running = list(waiting), dict[str, subprocess.Popen[bytes]]()
        bar = tqdm(total=len(total), desc=self.path.name, unit="case", disable=not progress)
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    name = waiting.pop(0)
                    running[name] = self._start(name, lock)
                    bar.set_postfix_str(", ".join(running), refresh=False)
                ended = [name for name, process in running.items() if process.poll() is not None]
                for name in ended:
                    self._finish(name, running.pop(name))
                    bar.update(1)
                if ended:
                    self._write_table()
                else:
                    clock.sleep(_POLL_SECONDS)
        finally:
            for process in running.values():
                process.kill()
                process.wait()
            bar.close()
        return total

    def _start(self, name: str, lock: int) -> subprocess.Popen[bytes]:
        """Start a case in an empty folder."""
        folder, row = self.folder(name), self._row(name)
        job = {
            "case": name,
            "module": self._module,
            "function": self._function,
            "parameters": self.cases[name],
            "folder": str(folder.resolve()),
            "row": str(row.resolve()),
            "sys_path": sys.path,
        }
        environment = {k: v for k, v in os.environ.items() if not k.startswith(_OF_MPI)}
        try:
            row.unlink(missing_ok=True)  # first: a row without its files would be taken for whole
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            with (folder / "log.txt").open("wb") as log:
                process = subprocess.Popen(
                    [sys.executable, "-m", "dolfinx_joints.study_case"],
                    bufsize=0,
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    pass_fds=(lock,),
                )
        except OSError as error:
            raise StudyError(f"The case {name!r} cannot be started: {error}.") from error
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # it has ended already, which `_finish` tells
            process.stdin.write(json.dumps(job).encode() + b"\n")
        return process

    def _finish(self, name: str, process: subprocess.Popen[bytes]) -> None:
        """See to it that an ended case has a row."""
        assert process.stdin is not None
        process.stdin.close()
        if self._row(name).exists():
            return
        code = process.returncode
        end = f"exit code {code}" if code >= 0 else f"signal {-code}"
        if -code in set(signal.Signals):
            end += f" ({signal.Signals(-code).name})"
        reason = plain_text(": ".join([f"ended by {end}", *_last_line(self.folder(name))]))
        row: Row = {"case": name, "status": "failed", "wall_s": float("nan")}
        row |= {"reason": reason, "peak_mb": float("nan")}
        write_row(self._row(name), {**row, "parameters": self.cases[name], "values": {}})

    @contextmanager
    def _locked(self) -> Iterator[int]:
        """Hold the folder, together with the cases that are started."""
        try:
            (self.path / "rows").mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise StudyError(f"The study {self.path} cannot be written: {error}.") from error
        try:
            ends = clock.monotonic() + LOCK_SECONDS
            while not _lock(descriptor):
                if clock.monotonic() > ends:
                    raise StudyError(
                        f"Another runner is at work in {self.path}: wait until it is done."
                    )
                clock.sleep(_POLL_SECONDS)
            yield descriptor
        finally:
            os.close(descriptor)


def _last_line(folder: Path) -> list[str]:
    """The last line that a case printed, none if it printed nothing or took the file away."""
    with suppress(OSError), (folder / "log.txt").open("rb") as log:
        size = log.seek(0, os.SEEK_END)
        log.seek(max(0, size - _LOG_TAIL))
        return log.read().decode(errors="replace").strip().splitlines()[-1:]
    return []


def _lock(descriptor: int) -> bool:
    """Whether the lock could be taken."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _address(function: Function) -> tuple[str, str]:
    """Module and name by which another process finds a function."""
    check_kind_of("function", function, inspect.isfunction(function), "a function")
    module, name = function.__module__, function.__qualname__
    if module == "__main__":
        spec = getattr(sys.modules["__main__"], "__spec__", None)
        module = "" if spec is None else spec.name
    if not module or "." in name or name == "<lambda>":
        raise ValueError(
            f"The function {shown(name)} of a study must be at the top level of a module that can "
            "be imported: other processes run it."
        )
    return module, name


def _check_parameters(function: Function, case: str, parameters: Mapping[str, Any]) -> None:
    """Refuse what the function does not take or a file cannot hold."""
    named = isinstance(parameters, Mapping) and all(isinstance(name, str) for name in parameters)
    what = f"What the case {case!r} is run with"
    check_kind_of(what, parameters, named, "parameters by name")
    taken = next((name for name in parameters if name in OWN_COLUMNS), None)
    if taken is not None:
        raise ValueError(
            f"The parameter {taken!r} of the case {case!r} has the name of a column of the study: "
            f"{', '.join(OWN_COLUMNS)}."
        )
    try:
        inspect.signature(function).bind(Path(), **parameters)
    except TypeError as error:
        raise ValueError(
            f"The parameters of the case {case!r} do not fit: {shown(error, str)}."
        ) from None
    try:
        json.dumps(dict(parameters), allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        said = shown(error, str)
        raise ValueError(f"A parameter of the case {case!r} cannot be kept: {said}.") from None


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """What has changed between two sets of parameters, empty for nothing."""
    names = [n for n in {**before, **now} if before.get(n, "unset") != now.get(n, "unset")]
    parts = (f"{n}: {before.get(n, 'unset')!r}, now {now.get(n, 'unset')!r}" for n in names)
    return "; ".join(parts)
