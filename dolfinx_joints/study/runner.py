# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Many cases of one function on an executor, each in a process of its own; resumable.

A folder holds everything::

    table.json       a row per finished or failed case; `read_table` reads it
    cases/CASE/      what the case wrote, and log.txt with what it printed

The table is replaced as a whole after each case. Killing the runner at any moment, also by signal
9, loses only the cases that were under way; the next run does the rest. Cases that the runner
itself has started end with it, those of an executor with their workers.
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


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Names of cases after a call of `Study.run`.

    Attributes:
        done: Cases that ran to their end.
        failed: Cases that failed, with their reasons.
        skipped: Cases that had a row already and were left alone.
        failed_before: Those of them that had failed, with their reasons.
        remarks: What of the values of finished cases is not in the table as the function
            returned it, by case.
    """

    done: list[str]
    failed: dict[str, str]
    skipped: list[str]
    failed_before: dict[str, str]
    remarks: dict[str, str]

    def __str__(self) -> str:
        """A line, and one more per failure and remark."""
        there = len(self.skipped) - len(self.failed_before)
        text = f"{len(self.done)} cases run, {there} were there already, {len(self.failed)} failed"
        if self.failed_before:
            text += f", {len(self.failed_before)} had failed before (again by retry_failed=True)"
        more = (*self.failed.items(), *self.failed_before.items(), *self.remarks.items())
        return "\n".join([text, *(f"  {name}: {why}" for name, why in more)])


class Study(Summarised):
    """One function, many named cases, one row per case.

    The function is called as ``function(folder, **parameters)`` and returns the values of the row,
    a mapping of names to numbers or texts. Every case runs in a new interpreter that imports the
    function from its module: cases share nothing, least of all MPI. A case that came to its end is
    kept whatever it returned: a value with the name of a parameter or of another column stands in
    the column "NAME (value)", one that is no number or text is left out, and the row says so.

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
                f"Study: {shown(function)} is not at the top level of a module; other processes "
                "import it from there."
            ) from None
        check_named("Study: cases", cases, "parameters by name of the case")
        for name, given in cases.items():
            check_named(f"Study: the case {name!r}", given, "values by name of the parameter")
        self.path = Path(path)
        self.cases = {n: _checked_case(function, n, given) for n, given in cases.items()}
        self._function = function

    def _summary(self) -> Rows:
        rows = self._rows()
        known = [rows[name]["status"] for name in self.cases if name in rows]
        yield "folder", self.path
        yield "function", self._function.__name__
        yield "cases", f"{len(self.cases)}: {names(self.cases)}"
        yield "finished", f"{known.count('complete')}, {known.count('failed')} failed"

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
            executor: Runs the cases: of processes, of MPI ranks (mpi4py.futures), of a cluster
                (dask); unless given, this process starts them.
            workers: Cases at once, where there is no executor.
            only: Names of the cases to run, all unless given.
            retry_failed: Run failed cases again.
            rerun_changed: Run cases again whose parameters have changed, an error otherwise.
            progress: Show a bar.

        Raises:
            ValueError: ``only`` names an unknown case.
            StudyError: Another process runs it, mpirun started this process, parameters have
                changed, or the table cannot be written.
        """
        if unknown := set(only or ()) - self.cases.keys():
            known = ", ".join(self.cases)
            raise ValueError(f"There is no case {min(unknown)!r}; there are {known}.")
        if executor is None and {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"} & os.environ.keys():
            raise StudyError(
                "A study starts processes of its own: run it without mpirun, or give it an "
                "MPIPoolExecutor and start it by mpirun -n N python3 -m mpi4py.futures."
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
        """Folder to which a case writes its files."""
        return self.path / "cases" / name

    def table(self) -> Table:
        """The rows that there are, in the order of the cases; see `read_table`."""
        rows = self._rows()
        return columns([rows[name] for name in self.cases if name in rows])

    def _rows(self) -> dict[str, Row]:
        path = self.path / TABLE
        return {row["case"]: row for row in read_rows(path)} if path.exists() else {}

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

    def _work(
        self, rows: dict[str, Row], waiting: list[str], executor: Executor, progress: bool
    ) -> None:
        """Run cases; put each row into the table when its case ends."""
        from tqdm.auto import tqdm

        work = packed(self._function)
        futures: dict[Future[Row], str] = {}
        hidden = None if progress else True  # None: where there is no terminal
        try:
            for name in waiting:
                folder = str(self.folder(name).resolve())
                futures[executor.submit(run_case, name, work, folder, self.cases[name])] = name
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
        """Row of a case, also of one whose worker died or could not be given it."""
        try:
            return future.result()
        except Exception as error:
            lost = {"status": "failed", "reason": f"its worker was lost: {_reason(error)}"}
            empty = {"values": {}, "wall_s": float("nan"), "peak_mb": float("nan")}
            return {"case": name, "parameters": self.cases[name], **lost, **empty}


def check_name(what: str, name: str) -> None:
    """Check that a name is one of files as well.

    Raises:
        ValueError: It is not.
    """
    if not re.fullmatch(r"\w[\w.=+-]{0,99}", name):
        raise ValueError(
            f"{what} must have a name of letters, digits and any of _ . = + -, 100 at most."
        )


def _checked_case(function: Function, name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a case as a file gives them back."""
    check_name(f"The case {name!r}", name)
    if taken := parameters.keys() & set(OWN_COLUMNS):
        raise ValueError(f"The parameter {min(taken)!r} has the name of a column of the study.")
    try:
        signature(function).bind(Path(), **parameters)
        kept: dict[str, Any] = json.loads(json.dumps(dict(parameters), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"The parameters of the case {name!r} do not fit: {error}.") from None
    return kept
