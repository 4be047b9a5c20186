# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Many cases of one function, several at once, each in a process of its own; resumable.

A folder holds everything::

    table.json       a row per finished or failed case; `read_table` reads it
    cases/CASE/      what the case wrote, and log.txt with what it printed

The table is replaced as a whole after each case. Killing the runner at any moment, also by signal
9, ends its cases and loses only those that were under way; the next run does the rest.
"""

from __future__ import annotations

import csv
import io
import json
import multiprocessing as mp
import os
import pickle
import re
import shutil
import threading
import time as clock
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from multiprocessing.connection import Connection
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.file_lock import FileLock
from dolfinx_joints.common.memory import peak_mb

__all__ = ["Study", "Table", "Tally", "read_table", "write_csv"]

Function = Callable[..., Mapping[str, Any]]
Row = dict[str, Any]
Table = dict[str, NDArray[Any]]

OWN_COLUMNS = ("case", "status", "reason", "wall_s", "peak_mb")
_TABLE = "table.json"
_LONGEST_REASON = 2000  # characters


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Names of cases after a call of `Study.run`.

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
    a mapping of names to numbers or texts. Every case runs in a new interpreter that imports the
    function from its module: cases share nothing, least of all MPI.

    A case is known by its name and parameters; a change of the function goes unnoticed.

    Args:
        path: Folder of the study, made where missing.
        function: Function at the top level of a module; writes files into the folder that it is
            given, which is empty.
        cases: Parameters by name of the case, anything JSON can hold. The table has their order.

    Raises:
        ValueError: A name is no file name, the function does not take a parameter, or cannot be
            imported by another process.
    """

    def __init__(
        self, path: str | Path, function: Function, cases: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Check the cases; nothing is written yet."""
        try:
            pickle.dumps(function)
        except (pickle.PicklingError, AttributeError):
            raise ValueError(
                f"Study: {function!r} is not at the top level of a module; other processes import "
                "it from there."
            ) from None
        self.path = Path(path)
        self.cases = {n: _checked_case(function, n, given) for n, given in cases.items()}
        self._function = function

    @checked
    def run(
        self,
        *,
        workers: Annotated[int, at.Ge(1)] = 1,
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
            rerun_changed: Run cases again whose parameters differ from those of their rows; an
                error otherwise.
            progress: Show a bar.

        Raises:
            ValueError: ``only`` names an unknown case.
            StudyError: Another process runs it, mpirun started this process, parameters of
                a case have changed, or the table cannot be written.
        """
        if unknown := set(only or ()) - self.cases.keys():
            raise ValueError(
                f"There is no case {min(unknown)!r}; there are {', '.join(self.cases)}."
            )
        if {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"} & os.environ.keys():
            raise StudyError("A study starts processes of its own: run it without mpirun.")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with FileLock(self.path / _TABLE, StudyError):
                rows = self._rows()
                chosen = [name for name in self.cases if only is None or name in only]
                waiting = self._waiting(rows, chosen, retry_failed, rerun_changed)
                self._work(rows, waiting, workers, progress)
        except OSError as error:
            raise StudyError(f"The study {self.path} cannot be written: {error}.") from error
        failed = {n: rows[n]["reason"] for n in waiting if rows[n]["status"] == "failed"}
        return Tally(
            done=[name for name in waiting if name not in failed],
            failed=failed,
            skipped=[name for name in chosen if name not in waiting],
        )

    def folder(self, name: str) -> Path:
        """Folder to which a case writes its files."""
        return self.path / "cases" / name

    def table(self) -> Table:
        """The rows that there are, in the order of the cases; see `read_table`."""
        rows = self._rows()
        return _columns([rows[name] for name in self.cases if name in rows])

    def _rows(self) -> dict[str, Row]:
        path = self.path / _TABLE
        return {row["case"]: row for row in _read_rows(path)} if path.exists() else {}

    def _waiting(
        self, rows: Mapping[str, Row], chosen: list[str], retry: bool, rerun: bool
    ) -> list[str]:
        """Cases to run now."""
        waiting = []
        for name in chosen:
            row = rows.get(name)
            changed = row is not None and row["parameters"] != self.cases[name]
            if row is not None and changed and not rerun:
                raise StudyError(
                    f"The case {name!r} in {self.path} was run with other parameters: "
                    f"{row['parameters']}, now {self.cases[name]}; give it another name, or ask "
                    "for changed cases to be run again."
                )
            if row is None or changed or (retry and row["status"] == "failed"):
                waiting.append(name)
        return waiting

    def _work(self, rows: dict[str, Row], waiting: list[str], workers: int, progress: bool) -> None:
        """Run cases; put each row into the table when its case ends."""
        from tqdm import tqdm

        running: list[mp.process.BaseProcess] = []
        bar = tqdm(total=len(waiting), desc=self.path.name, unit="case", disable=not progress)
        with bar, ThreadPoolExecutor(workers) as pool:
            futures = [pool.submit(self._run_case, name, running) for name in waiting]
            try:
                for future in as_completed(futures):
                    row = future.result()
                    rows[row["case"]] = row
                    ordered = [rows[name] for name in self.cases if name in rows]
                    _replace(self.path / _TABLE, json.dumps(ordered, indent=1))
                    bar.update()
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                for process in running:
                    process.kill()

    def _run_case(self, name: str, running: list[mp.process.BaseProcess]) -> Row:
        """Run a case in an empty folder and a new interpreter; its row."""
        folder = self.folder(name).resolve()
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        context = mp.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        began = clock.perf_counter()
        work = (sender, self._function, folder, self.cases[name])
        process = context.Process(target=_case, args=work, daemon=True)
        process.start()
        running.append(process)
        sender.close()
        try:
            reason, values, peak = receiver.recv()
        except EOFError:
            process.join()
            code = process.exitcode or 0
            end = f"exit code {code}" if code >= 0 else f"signal {-code}"
            reason, values, peak = f"ended by {end}; see {folder / 'log.txt'}", {}, float("nan")
        row = {"case": name, "status": "failed" if reason else "complete", "reason": reason}
        row |= {"wall_s": clock.perf_counter() - began, "peak_mb": peak}
        return row | {"parameters": self.cases[name], "values": values}


def _case(
    sender: Connection, function: Function, folder: Path, parameters: Mapping[str, Any]
) -> None:
    """Run a case here, output to log.txt; send why it failed or "", its values, its peak memory."""
    threading.Thread(target=_end_with_the_runner, daemon=True).start()
    with (folder / "log.txt").open("wb") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    try:
        values = _plain_values(function(folder, **parameters), parameters)
        sender.send(("", values, peak_mb()))
    except Exception as error:
        traceback.print_exc()
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:_LONGEST_REASON]
        sender.send((reason, {}, peak_mb()))


def _end_with_the_runner() -> None:
    """Wait for the end of the process that started this one, then end as well."""
    runner = mp.parent_process()
    assert runner is not None
    runner.join()
    os._exit(1)


def _checked_case(function: Function, name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a case as a file gives them back."""
    if not re.fullmatch(r"\w[\w.=+-]{0,99}", name):
        raise ValueError(
            f"The case {name!r} must have a name of letters, digits and any of _ . = + -, 100 at "
            "most."
        )
    if taken := parameters.keys() & set(OWN_COLUMNS):
        raise ValueError(f"The parameter {min(taken)!r} has the name of a column of the study.")
    try:
        signature(function).bind(Path(), **parameters)
        kept: dict[str, Any] = json.loads(json.dumps(dict(parameters), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"The parameters of the case {name!r} do not fit: {error}.") from None
    return kept


def _plain_values(values: Any, parameters: Mapping[str, Any]) -> dict[str, float | str]:
    """Values that a case returned as numbers and texts."""
    if not isinstance(values, Mapping):
        raise StudyError(f"The function must return a mapping of values, not {values!r:.80}.")
    if taken := values.keys() & {*OWN_COLUMNS, *parameters}:
        raise StudyError(f"The value {min(taken)!r} has the name of a parameter or of the study.")
    for name, value in values.items():
        if not isinstance(value, Real | str | np.bool_):
            raise StudyError(f"The value {name!r} must be a number or a text, not {value!r:.80}.")
    return {str(n): v if isinstance(v, str) else float(v) for n, v in values.items()}


@checked
def read_table(path: str | PathLike[str]) -> Table:
    """The table of a study, one row per finished or failed case, in the order of the cases.

    Args:
        path: Folder of the study.

    Returns:
        Arrays of shape (rows,) by column: ``case``, ``status`` ("complete" or "failed"),
        ``reason`` of a failure, ``wall_s`` [s], ``peak_mb`` [MiB], the parameters, the values.

    Raises:
        StudyError: There is no such table.
    """
    place = Path(path) / _TABLE
    if not place.is_file():
        raise StudyError(f"There is no table {place}; run the study first.")
    return _columns(_read_rows(place))


def _read_rows(path: Path) -> list[Row]:
    try:
        rows: list[Row] = json.loads(path.read_text(encoding="utf-8"))
        _columns(rows)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise StudyError(f"{path} is no table of a study, or a damaged one: {error!r}.") from None
    return rows


def _columns(rows: Sequence[Row]) -> Table:
    """Columns of rows: own ones, parameters, values, in the order in which they first appear.

    A column whose entries are all numbers is of floats, NaN where a row has none; any other is of
    texts, empty where a row has none.
    """
    flat = [{k: row[k] for k in OWN_COLUMNS} | row["parameters"] | row["values"] for row in rows]
    names = dict.fromkeys(OWN_COLUMNS)
    for part in ("parameters", "values"):
        for row in rows:
            names |= dict.fromkeys(row[part])
    return {name: _column([row.get(name) for row in flat]) for name in names}


def _column(entries: list[Any]) -> NDArray[Any]:
    given = [entry for entry in entries if entry is not None]
    if given and all(isinstance(entry, Real) for entry in given):
        return np.array([np.nan if entry is None else float(entry) for entry in entries])
    texts = [e if isinstance(e, str) else "" if e is None else json.dumps(e) for e in entries]
    return np.array(texts, dtype=object)


@checked
def write_csv(table: Table, path: str | PathLike[str]) -> Path:
    """Write a table as CSV: a line of names, then a line per row, numbers in full.

    Raises:
        StudyError: It cannot be written.
    """
    place, text = Path(path), io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    _replace(place, text.getvalue())
    return place


def _replace(path: Path, text: str) -> None:
    """Write a file so that it is whole or as it was."""
    part = path.with_name(f".{path.name}.partial")
    try:
        part.write_bytes(text.encode(errors="backslashreplace"))
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise StudyError(f"{path} cannot be written: {error.strerror}.") from error
