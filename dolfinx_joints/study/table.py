# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Table of a study: file of the rows, columns, CSV."""

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
SUFFIX = " (value)"  # added to a value's name that another column already has


@checked
def read_table(path: str | PathLike[str]) -> Table:
    """Read the table of a study in a folder, one row per complete or failed case, in order.

    Returns:
        Arrays of shape (rows,) by column: ``case``, ``status`` ("complete" or "failed"),
        ``reason`` (of a failure, or remarks on the values), ``wall_s`` [s], ``peak_mb`` [MiB], the
        parameters, the values. A value whose name is already used is in "NAME (value)".

    Raises:
        StudyError: The folder has no table.
    """
    place = Path(path) / TABLE
    if not place.is_file():
        raise StudyError(f"There is no table {place}; run the study first.")
    return columns(read_rows(place))


def read_rows(path: Path) -> list[Row]:
    """Read the rows of a table's file; raise a StudyError if it is damaged."""
    try:
        rows: list[Row] = json.loads(path.read_text(encoding="utf-8"))
        columns(rows)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise StudyError(f"{path} is damaged or not the table of a study: {error!r}.") from None
    return rows


def columns(rows: Sequence[Row]) -> Table:
    """Return the columns: `OWN_COLUMNS`, parameters, values, in the order of first appearance.

    If all entries are numbers, the column has floats, with NaN for missing entries. Otherwise it
    has texts, empty for missing entries.
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
    """Return the column of each value: its name, with a suffix if the name is already used."""
    used = set(OWN_COLUMNS).union(*(row["parameters"] for row in rows))
    by_value: dict[str, str] = {}
    for name in dict.fromkeys(name for row in rows for name in row["values"]):
        column = name
        while column in used:
            column += SUFFIX
        used.add(column)
        by_value[name] = column
    return by_value


def reason_of(row: Row, names: Mapping[str, str]) -> str:
    """Return the reason of a failure, or remarks on values that are in other columns."""
    moved = [name for name in row["values"] if names[name] != name]
    texts = [
        f"The name of the value {name!r} is already used by another column; the value is in "
        f"the column {names[name]!r}."
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
    """Write a table as CSV: a header line, then one line per row with all digits of numbers.

    Raises:
        StudyError: The file cannot be written.
    """
    place, text = Path(path), io.StringIO(newline="")
    writer = csv.writer(text)
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    writer.writerows(map(cell, row) for row in (table, *rows))
    replace(place, text.getvalue())
    return place


def replace(path: Path, text: str) -> None:
    """Replace a file atomically."""
    try:
        with replacing(path) as part:
            part.write_bytes(text.encode())
    except OSError as error:
        raise StudyError(f"{path} cannot be written: {error.strerror}.") from error
