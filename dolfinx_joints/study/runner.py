# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resumable studies: many cases of one function, each in a separate process.

The folder of a study contains::

    table.json       one row per complete or failed case, see `read_table`
    cases/CASE/      files that the case wrote, and its output in log.txt

The table is replaced atomically after each case. If the runner is killed, even by signal 9, only
the running cases are lost; the next run continues with them. Cases end with the process that
started them: the runner, or a worker of the executor.
"""

from __future__ import annotations

import json
import os
import pickle
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Annotated, Any

import annotated_types as at

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.files import FileLock
from dolfinx_joints.common.parameters import check_named, shown
from dolfinx_joints.common.progress import LOGGER
from dolfinx_joints.common.summary import Rows, Summarised, names
from dolfinx_joints.study.case import Function, end_cases, packed, run_case
from dolfinx_joints.study.case import reason_of as _reason
from dolfinx_joints.study.table import (
    OWN_COLUMNS,
    TABLE,
    Row,
    Table,
    columns,
    columns_of_values,
    read_rows,
    reason_of,
    replace,
)

MPIRUN = {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}  # variables of processes that mpirun started


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Outcome of a call of `Study.run`, by names of cases.

    Attributes:
        done: Cases that were completed.
        failed: Cases that failed, with their reasons.
        skipped: Cases that already had a row and were not run.
        failed_before: Skipped cases that had failed, with their reasons.
        remarks: Remarks on values of completed cases that are not in the table or are in another
            column, by case.
    """

    done: list[str]
    failed: dict[str, str]
    skipped: list[str]
    failed_before: dict[str, str]
    remarks: dict[str, str]

    def __str__(self) -> str:
        """Return the numbers of cases in one line, and a line per failure and remark."""
        kept = len(self.skipped) - len(self.failed_before)
        text = f"{len(self.done)} cases run, {kept} already complete, {len(self.failed)} failed"
        if self.failed_before:
            text += f", {len(self.failed_before)} failed before (retry with retry_failed=True)"
        details = (*self.failed.items(), *self.failed_before.items(), *self.remarks.items())
        return "\n".join([text, *(f"  {name}: {reason}" for name, reason in details)])


class Study(Summarised):
    """Study of one function for many named cases, with one table row per case.

    The function is called as ``function(folder, **parameters)`` and returns the values of the row,
    a mapping of names to numbers or texts. Every case runs in a new interpreter that imports the
    function from its module, so cases share nothing, in particular not MPI. A value whose name is
    already used is in the column "NAME (value)". A value that is neither number nor text is left
    out. In both cases the row has a remark.

    A case is identified by its name and parameters; changes of the function are not detected.

    Args:
        path: Folder of the study, created if missing.
        function: Function at the top level of a module. It may write files to its first argument,
            an empty folder.
        cases: Parameters by name of the case, with values that JSON can store. They determine the
            order of the table.

    Raises:
        ValueError: A name is not a file name, the function does not accept a parameter, or another
            process cannot import it.
    """

    def __init__(
        self, path: str | Path, function: Function, cases: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Check the cases; write nothing yet."""
        try:
            pickle.dumps(function)
        except (pickle.PicklingError, AttributeError):
            raise ValueError(
                f"Study: {shown(function)} must be at the top level of a module, so that other "
                "processes can import it."
            ) from None
        check_named("Study: cases", cases, "parameters by name of the case")
        for name, given in cases.items():
            check_named(f"Study: the case {name!r}", given, "values by name of the parameter")
        self.path = Path(path)
        self.cases = {n: _checked_case(function, n, given) for n, given in cases.items()}
        self._function = function

    def _summary(self) -> Rows:
        rows = self._rows()
        statuses = [rows[name]["status"] for name in self.cases if name in rows]
        yield "folder", self.path
        yield "function", self._function.__name__
        yield "cases", f"{len(self.cases)}: {names(self.cases)}"
        yield "finished", f"{statuses.count('complete')}, {statuses.count('failed')} failed"

    @checked
    def run(
        self,
        *,
        executor: Executor | None = None,
        workers: Annotated[int, at.Ge(1)] = 1,
        only: Sequence[str] | None = None,
        retry_failed: bool = False,
        rerun_changed: bool = False,
        progress: bool = True,
    ) -> Tally:
        """Run the cases that have no row yet.

        Args:
            executor: Executor of processes, MPI ranks (mpi4py.futures) or a cluster (dask). Without
                it, this process starts the cases.
            workers: Number of simultaneous cases without an executor.
            only: Names of the cases to run, all by default.
            retry_failed: Run failed cases again.
            rerun_changed: Run cases with changed parameters again; otherwise raise an error.
            progress: Show a progress bar.

        Raises:
            ValueError: ``only`` names an unknown case.
            StudyError: Another process runs the study, mpirun started this process, parameters
                have changed, or the table cannot be written.
        """
        if unknown := set(only or ()) - self.cases.keys():
            allowed = ", ".join(self.cases)
            raise ValueError(f"There is no case {min(unknown)!r}; there are {allowed}.")
        if executor is None and MPIRUN & os.environ.keys():
            raise StudyError(
                "A study starts separate processes: run it without mpirun, or give Study.run "
                "an MPIPoolExecutor and start it by mpirun -n N python3 -m mpi4py.futures."
            )
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with FileLock(self.path / TABLE, StudyError):
                rows = self._rows()
                chosen = [name for name in self.cases if only is None or name in only]
                waiting = self._waiting(rows, chosen, retry_failed, rerun_changed)
                if executor is not None:
                    self._work(rows, waiting, executor, progress)
                else:
                    with ThreadPoolExecutor(workers) as threads:
                        try:
                            self._work(rows, waiting, threads, progress)
                        finally:
                            end_cases()
        except OSError as error:
            raise StudyError(f"The study {self.path} cannot be written: {error}.") from error
        names = columns_of_values(list(rows.values()))
        failed = {n: reason_of(rows[n], names) for n in chosen if rows[n]["status"] == "failed"}
        done = [name for name in waiting if name not in failed]
        return Tally(
            done=done,
            failed={name: why for name, why in failed.items() if name in waiting},
            skipped=[name for name in chosen if name not in waiting],
            failed_before={name: why for name, why in failed.items() if name not in waiting},
            remarks={name: why for name in done if (why := reason_of(rows[name], names))},
        )

    def folder(self, name: str) -> Path:
        """Return the folder to which a case writes its files."""
        return self.path / "cases" / name

    def table(self) -> Table:
        """Return the rows of complete and failed cases in the cases' order; see `read_table`."""
        rows = self._rows()
        return columns([rows[name] for name in self.cases if name in rows])

    def _rows(self) -> dict[str, Row]:
        path = self.path / TABLE
        return {row["case"]: row for row in read_rows(path)} if path.exists() else {}

    def _waiting(
        self, rows: Mapping[str, Row], chosen: list[str], retry: bool, rerun: bool
    ) -> list[str]:
        """Return the cases to run now."""
        waiting = []
        for name in chosen:
            row = rows.get(name)
            changed = row is not None and row["parameters"] != self.cases[name]
            if row is not None and changed and not rerun:
                raise StudyError(
                    f"The case {name!r} in {self.path} was run with other parameters: "
                    f"{row['parameters']}, now {self.cases[name]}; give it another name, or pass "
                    "rerun_changed=True to run it again."
                )
            if row is None or changed or (retry and row["status"] == "failed"):
                waiting.append(name)
        return waiting

    def _work(
        self, rows: dict[str, Row], waiting: list[str], executor: Executor, progress: bool
    ) -> None:
        """Run cases; add each row to the table when its case ends."""
        from tqdm.auto import tqdm

        work = packed(self._function)
        futures: dict[Future[Row], str] = {}
        hidden = None if progress else True  # None hides the bar if there is no terminal
        try:
            for name in waiting:
                case = name, work, str(self.folder(name).resolve()), self.cases[name]
                futures[executor.submit(run_case, *case)] = name
            with tqdm(total=len(waiting), desc=self.path.name, unit="case", disable=hidden) as bar:
                for future in as_completed(futures):
                    name = futures[future]
                    rows[name] = self._row(name, future)
                    ordered = [rows[name] for name in self.cases if name in rows]
                    replace(self.path / TABLE, json.dumps(ordered, indent=1))
                    bar.update()
                    LOGGER.info("case %s: %s", name, rows[name]["status"])
        finally:
            for future in futures:
                future.cancel()

    def _row(self, name: str, future: Future[Row]) -> Row:
        """Return a case's row, even if its worker crashed or the row could not be received."""
        try:
            return future.result()
        except Exception as error:
            lost = {"status": "failed", "reason": f"its worker was lost: {_reason(error)}"}
            empty = {"values": {}, "wall_s": float("nan"), "peak_mb": float("nan")}
            return {"case": name, "parameters": self.cases[name], **lost, **empty}


def check_name(owner: str, name: str) -> None:
    """Raise a ValueError unless a name can be a file name."""
    if not re.fullmatch(r"\w[\w.=+-]{0,99}", name):
        raise ValueError(
            f"{owner} must have a name of letters, digits and any of _ . = + -, 100 at most."
        )


def _checked_case(function: Function, name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Check the parameters of a case; return them as JSON restores them."""
    check_name(f"The case {name!r}", name)
    if taken := parameters.keys() & set(OWN_COLUMNS):
        raise ValueError(f"The parameter {min(taken)!r} has the name of a column of the table.")
    try:
        signature(function).bind(Path(), **parameters)
        kept: dict[str, Any] = json.loads(json.dumps(dict(parameters), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"The parameters of the case {name!r} are wrong: {error}.") from None
    return kept
