# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Export of results files to pandas data frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.export.optional import import_optional
from dolfinx_joints.export.tables import TABLES, tables_of
from dolfinx_joints.results.reader import Results, listing

if TYPE_CHECKING:
    from pandas import DataFrame

    TableName = str
else:
    TableName = Literal[tuple(TABLES)]


@checked
def to_pandas(results: Results, table: TableName = "histories") -> DataFrame:
    """Return a table of a results file, with the contents of `csv_files.write_csv`.

    Column names include the unit: ``displacement of crest from the static state x [m]``. A table
    with one row per time is indexed by the time. ``frame.attrs["file"]`` is the path of the results
    file.

    Args:
        results: The run.
        table: Name of the table.

    Raises:
        ResultsError: The file has no data for the table.
        ImportError: pandas is missing.
    """
    pandas = import_optional("pandas")
    tables = tables_of(results, table)
    if not tables:
        available = listing(tables_of(results))
        raise ResultsError(f"{results.path} has no table {table!r}; it has {available}.")
    columns = tables[table]
    frame = pandas.DataFrame(columns.rows, columns=columns.header)
    if columns.header[0] == "time [s]":
        frame = frame.set_index("time [s]")
    frame.attrs["file"] = str(results.path)
    return frame
