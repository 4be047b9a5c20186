# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cases of a study, which a worker runs in a separate Python interpreter.

The interpreter shares nothing with the worker, in particular not MPI. If a case crashes, the worker
continues. If the worker ends, the case's standard input closes and the case ends too. A shared
interpreter waits for the next case.
"""

from __future__ import annotations

import fcntl
import gc
import json
import multiprocessing
import os
import pickle
import queue
import shutil
import subprocess
import sys
import threading
import time as clock
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import spawn
from multiprocessing.process import BaseProcess
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.memory import peak_mb
from dolfinx_joints.study.table import Row

Function = Callable[..., Mapping[str, Any]]
_LONGEST_REASON = 2000  # characters
# Environment variables of MPI launchers. They are removed: a case is not part of the MPI job.
_MPI = ("OMPI_", "PMI_", "PMIX_", "PRTE_", "HYDRA_", "HYDI_", "MPI_LOCAL")
_running: set[subprocess.Popen[bytes]] = set()
_shared: dict[bytes, list[subprocess.Popen[bytes]]] = {}  # that wait for a case, by its function


def packed(function: Function) -> bytes:
    """Pickle a function with the data that another interpreter needs to import its module."""
    preparation = spawn.get_preparation_data("case")
    del preparation["authkey"]  # valid in this process only
    return pickle.dumps((preparation, pickle.dumps(function)))


def run_case(
    name: str, work: bytes, folder: str, parameters: Mapping[str, Any], share: bool = False
) -> Row:
    """Run a case in an empty folder and a new interpreter; return its row.

    ``work`` is the `packed` function. With ``share`` the interpreter can be that of an earlier
    case. If a killed runner left this case running, wait for its end.
    """
    if parent := multiprocessing.parent_process():
        threading.Thread(target=_end_with_the_runner, args=(parent,), daemon=True).start()
    place, began = Path(folder), clock.perf_counter()
    place.parent.mkdir(parents=True, exist_ok=True)
    with place.with_name(f".{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        outcome = _outcome(work, place, parameters, share)
        row = {"case": name, "parameters": dict(parameters)} | outcome
    return row | {"wall_s": clock.perf_counter() - began}


def _end_with_the_runner(parent: BaseProcess) -> None:
    """End this pool worker and its case when the process that owns the pool ends."""
    parent.join()
    end_cases()
    os._exit(1)


def end_cases() -> None:
    """Kill the interpreters that this process has started."""
    _shared.clear()
    for process in list(_running):
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill an interpreter unless it has ended."""
    process.kill()
    process.wait()
    _running.discard(process)


def _outcome(work: bytes, folder: Path, parameters: Mapping[str, Any], share: bool) -> Row:
    """Run a case; return its status, reason, values and peak memory."""
    waiting = _shared.setdefault(work, []) if share else []
    process = waiting.pop() if waiting else _interpreter()
    assert process.stdin is not None
    assert process.stdout is not None
    outcome: Row = {"status": "failed", "values": {}, "peak_mb": float("nan")}
    try:
        with suppress(BrokenPipeError):
            pickle.dump((work, folder, dict(parameters)), process.stdin)
            process.stdin.flush()
        if answer := process.stdout.readline():  # empty if the interpreter has ended
            outcome = json.loads(answer)
        else:
            code = process.wait()
            end = f"exit code {code}" if code >= 0 else f"signal {-code}"
            outcome["reason"] = f"ended by {end}; see {folder / 'log.txt'}"
    finally:
        if share and outcome["status"] == "complete":
            waiting.append(process)
        else:
            _end(process)
    return outcome


def _interpreter() -> subprocess.Popen[bytes]:
    """Start an interpreter that runs cases."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(_MPI)}
    process = subprocess.Popen(
        [sys.executable, "-c", "from dolfinx_joints.study.case import main; main()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    _running.add(process)
    return process


def main() -> None:
    """Run the cases read from standard input; write each result to standard output as JSON."""
    cases: queue.SimpleQueue[tuple[bytes, Path, dict[str, Any]]] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(cases,), daemon=True).start()
    answers, function = os.fdopen(os.dup(1), "wb"), None
    while True:
        work, folder, parameters = cases.get()
        with (folder / "log.txt").open("wb") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        outcome: dict[str, Any]
        try:
            if function is None:
                preparation, of_module = pickle.loads(work)
                spawn.prepare(preparation)
                function = pickle.loads(of_module)
            values, remarks = _plain_values(function(folder, **parameters))
            reason = in_one_line(" ".join(remarks))
            outcome = {"status": "complete", "reason": reason, "values": values}
        except Exception as error:
            traceback.print_exc()
            outcome = {"status": "failed", "reason": reason_of(error), "values": {}}
        sys.stdout.flush()
        answers.write(json.dumps(outcome | {"peak_mb": peak_mb()}).encode() + b"\n")
        answers.flush()
        gc.collect()  # frees the memory of the case before the next one


def _receive(cases: queue.SimpleQueue[tuple[bytes, Path, dict[str, Any]]]) -> None:
    """Receive cases; end this process when standard input closes, as the worker ends."""
    with suppress(EOFError), os.fdopen(os.dup(0), "rb") as messages:  # sys.stdin locks at the exit
        while True:
            cases.put(pickle.load(messages))
    os._exit(1)


def reason_of(error: BaseException) -> str:
    """Return the reason why a case failed, in one line."""
    return in_one_line(f"{type(error).__name__}: {error}")


def in_one_line(text: str) -> str:
    """Return a text without line breaks, cut to `_LONGEST_REASON` characters."""
    return " ".join(text.split())[:_LONGEST_REASON]


def _plain_values(values: Any) -> tuple[dict[str, float | str], list[str]]:
    """Return the numbers and texts that a case returned, and remarks on its other values."""
    if not isinstance(values, Mapping):
        raise StudyError(f"The function must return a mapping of values, not {values!r:.80}.")
    kept: dict[str, float | str] = {}
    remarks = []
    for given, value in values.items():
        name, plain = str(given), _plain(value)
        if plain is None:
            print(f"{name!r}: {value!r}", flush=True)
            remarks.append(
                f"The value {name!r} must be a number or a text, not {value!r:.80}; it is only "
                "in log.txt."
            )
        else:
            kept[name] = plain
    return kept, remarks


def _plain(value: Any) -> float | str | None:
    """Return a text, or a number as float; None for any other value."""
    if isinstance(value, str):
        return value
    return float(value) if isinstance(value, Real | np.bool_) else None
