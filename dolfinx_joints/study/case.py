# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""One case of a study, which a worker runs in a separate Python interpreter.

The interpreter shares nothing with the worker, in particular not MPI. If a case crashes, the worker
continues. If the worker ends, the case's standard input closes and the case ends too.
"""

from __future__ import annotations

import fcntl
import json
import multiprocessing
import os
import pickle
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


def packed(function: Function) -> bytes:
    """Pickle a function with the data that another interpreter needs to import its module."""
    preparation = spawn.get_preparation_data("case")
    del preparation["authkey"]  # valid in this process only
    return pickle.dumps((preparation, pickle.dumps(function)))


def run_case(name: str, work: bytes, folder: str, parameters: Mapping[str, Any]) -> Row:
    """Run a case in an empty folder and a new interpreter; return its row.

    ``work`` is the `packed` function. If a killed runner left this case running, wait for its end.
    """
    if parent := multiprocessing.parent_process():
        threading.Thread(target=_end_with_the_runner, args=(parent,), daemon=True).start()
    place, began = Path(folder), clock.perf_counter()
    place.parent.mkdir(parents=True, exist_ok=True)
    with place.with_name(f".{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        row = {"case": name, "parameters": dict(parameters)} | _outcome(work, place, parameters)
    return row | {"wall_s": clock.perf_counter() - began}


def _end_with_the_runner(parent: BaseProcess) -> None:
    """End this pool worker and its case when the process that owns the pool ends."""
    parent.join()
    end_cases()
    os._exit(1)


def end_cases() -> None:
    """Kill the cases that this process has started."""
    for process in list(_running):
        process.kill()


def _outcome(work: bytes, folder: Path, parameters: Mapping[str, Any]) -> Row:
    """Run a case; return its status, reason, values and peak memory."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(_MPI)}
    process = subprocess.Popen(
        [sys.executable, "-c", "from dolfinx_joints.study.case import main; main()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    _running.add(process)
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        with suppress(BrokenPipeError):
            pickle.dump((work, folder, dict(parameters)), process.stdin)
            process.stdin.flush()
        answer = process.stdout.readline()  # empty if the case ends without a result
        code = process.wait()
    finally:
        process.kill()
        process.wait()
        _running.discard(process)
    if answer:
        return dict(json.loads(answer))
    end = f"exit code {code}" if code >= 0 else f"signal {-code}"
    reason = f"ended by {end}; see {folder / 'log.txt'}"
    return {"status": "failed", "reason": reason, "values": {}, "peak_mb": float("nan")}


def main() -> None:
    """Run the case read from standard input and write its result to standard output as JSON."""
    work, folder, parameters = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_the_worker, args=(os.dup(0),), daemon=True).start()
    answer = os.dup(1)
    with open(os.devnull, "rb") as empty, (folder / "log.txt").open("wb") as log:
        for number, file in enumerate((empty, log, log)):
            os.dup2(file.fileno(), number)  # the case and its child processes read no input
    outcome: dict[str, Any]
    try:
        preparation, function = pickle.loads(work)
        spawn.prepare(preparation)
        values, remarks = _plain_values(pickle.loads(function)(folder, **parameters))
        outcome = {"status": "complete", "reason": in_one_line(" ".join(remarks)), "values": values}
    except Exception as error:
        traceback.print_exc()
        outcome = {"status": "failed", "reason": reason_of(error), "values": {}}
    sys.stdout.flush()
    with os.fdopen(answer, "wb") as to_worker:
        to_worker.write(json.dumps(outcome | {"peak_mb": peak_mb()}).encode() + b"\n")
    os._exit(0)


def _end_with_the_worker(pipe: int) -> None:
    """End this process when the process that started it ends."""
    os.read(pipe, 1)  # returns only when the pipe closes
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
