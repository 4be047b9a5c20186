# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results files as data frames of pandas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from dolfinx_joints.common.declared import checked
from dolfinx_joints.export.optional import imported
from dolfinx_joints.export.tables import TABLES, tables_of
from dolfinx_joints.results.reader import Results

if TYPE_CHECKING:
    from pandas import DataFrame

    TableName = str
else:
    TableName = Literal[tuple(TABLES)]


@checked
def to_pandas(results: Results, table: TableName = "histories") -> DataFrame:
    """A table of a results file, those of `csv_files.write_csv`.

    Columns are named with their units, ``displacement of crest x [m]``; a table of one row per time
    is indexed by it. ``frame.attrs`` holds the ``file``.

    Args:
        results: The run.
        table: Name of the table.

    Raises:
        ResultsError: The file holds nothing for that table.
        ImportError: pandas is missing.
    """
    pandas = imported("pandas")
    found = tables_of(results, table)[table]
    frame = pandas.DataFrame(found.rows, columns=found.header)
    if found.header[0] == "time [s]":
        frame = frame.set_index("time [s]")
    frame.attrs["file"] = str(results.path)
    return frame
