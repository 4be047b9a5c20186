# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of a study: the file of its rows, its columns, CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.parameters import cell

Row = dict[str, Any]
Table = dict[str, NDArray[Any]]

OWN_COLUMNS = ("case", "status", "reason", "wall_s", "peak_mb")
TABLE = "table.json"
SUFFIX = " (value)"  # of a value that has the name of another column


@checked
def read_table(path: str | PathLike[str]) -> Table:
    """The table of a study in a folder, one row per finished or failed case, in their order.

    Returns:
        Arrays of shape (rows,) by column: ``case``, ``status`` ("complete" or "failed"),
        ``reason`` of a failure or remarks on the values, ``wall_s`` [s], ``peak_mb`` [MiB], the
        parameters, the values. A value with the name of another column is in "NAME (value)".

    Raises:
        StudyError: There is no such table.
    """
    place = Path(path) / TABLE
    if not place.is_file():
        raise StudyError(f"There is no table {place}; run the study first.")
    return columns(read_rows(place))


def read_rows(path: Path) -> list[Row]:
    """The rows as the file has them; raises a StudyError for a damaged one."""
    try:
        rows: list[Row] = json.loads(path.read_text(encoding="utf-8"))
        columns(rows)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise StudyError(f"{path} is no table of a study, or a damaged one: {error!r}.") from None
    return rows


def columns(rows: Sequence[Row]) -> Table:
    """Columns of rows: own ones, parameters, values, in the order in which they first appear.

    A column whose entries are all numbers is of floats, NaN where a row has none; any other is of
    texts, empty where a row has none.
    """
    values = columns_of_values(rows)
    flat = [
        {k: row[k] for k in OWN_COLUMNS}
        | {"reason": reason_of(row, values)}
        | row["parameters"]
        | {values[name]: value for name, value in row["values"].items()}
        for row in rows
    ]
    names = dict.fromkeys(OWN_COLUMNS)
    for row in rows:
        names |= dict.fromkeys(row["parameters"])
    return {n: _column([row.get(n) for row in flat]) for n in (*names, *values.values())}


def columns_of_values(rows: Sequence[Row]) -> dict[str, str]:
    """Column of each value: its name, with a suffix where another column has that name."""
    taken = set(OWN_COLUMNS).union(*(row["parameters"] for row in rows))
    found: dict[str, str] = {}
    for name in dict.fromkeys(name for row in rows for name in row["values"]):
        column = name
        while column in taken:
            column += SUFFIX
        taken.add(column)
        found[name] = column
    return found


def reason_of(row: Row, names: Mapping[str, str]) -> str:
    """Why a case failed, or what of its values is not in the table as it returned them."""
    moved = [name for name in row["values"] if names[name] != name]
    texts = [
        f"The value {name!r} has the name of a parameter or of the study; it is in the column "
        f"{names[name]!r}."
        for name in moved
    ]
    return " ".join([*([row["reason"]] if row["reason"] else []), *texts])


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
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    writer.writerows(map(cell, row) for row in (table, *rows))
    replace(place, text.getvalue())
    return place


def replace(path: Path, text: str) -> None:
    """Write a file so that it is whole or as it was."""
    try:
        with replacing(path) as part:
            part.write_bytes(text.encode())
    except OSError as error:
        raise StudyError(f"{path} cannot be written: {error.strerror}.") from error
