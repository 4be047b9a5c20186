# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of a study, one small file each, and the table gathered from them (HDF5, CSV).

A file is written beside its place and renamed, so whoever reads it finds it whole or not at all,
whenever the writer was killed.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from numbers import Real
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import StudyError
from dolfinx_joints.common.hdf5 import (
    DamageTold,
    attribute,
    check_contents,
    check_seal,
    seal,
    set_texts,
)
from dolfinx_joints.common.parameters import check_file, check_kind_of, check_path

FORMAT = "dolfinx_joints study table"
TABLE = "table.h5"
OWN_COLUMNS = ("case", "status", "reason", "wall_s", "peak_mb")

LONGEST_TEXT = 2000  # characters of a text in a row

Row = dict[str, Any]
Table = dict[str, NDArray[Any]]


def write_row(path: Path, row: Mapping[str, Any]) -> None:
    """Put a row in its place: the keys of `OWN_COLUMNS`, ``parameters`` and ``values``.

    Raises:
        StudyError: It cannot be written.
    """
    _replace(path, json.dumps(row, indent=1).encode())


def read_row(path: Path) -> Row | None:
    """A row, None if there is none yet.

    Raises:
        StudyError: The file is not a row.
    """
    if not path.exists():
        return None
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{path} is not a row of a study: {error}.") from None
    if not isinstance(row, dict) or not {*OWN_COLUMNS, "parameters", "values"} <= row.keys():
        raise StudyError(f"{path} is not a row of a study.")
    try:
        gather([row])
    except (TypeError, AttributeError, ValueError, OverflowError, RecursionError) as error:
        raise StudyError(f"{path} is a row of a study that fits no table: {error}.") from None
    return row


def plain_values(values: Any, parameters: Iterable[str]) -> dict[str, float | str]:
    """What a case returned as numbers and texts.

    Args:
        values: What the function of the study returned.
        parameters: Names that are taken.

    Raises:
        StudyError: It is no mapping of names to numbers or texts, or a name is taken.
    """
    if not isinstance(values, Mapping):
        raise StudyError(f"The function must return a mapping of values, not {values!r:.80}.")
    taken = {*OWN_COLUMNS, *parameters}
    plain: dict[str, float | str] = {}
    for name, value in values.items():
        if not isinstance(name, str) or not name.isprintable() or name in ("", ".") or "|" in name:
            raise StudyError(f"A value may not be named {name!r}: a printable text without '|'.")
        if name in taken:
            raise StudyError(f"The value {name!r} has the name of a parameter or of the study.")
        if not isinstance(value, Real | str | np.bool_):
            raise StudyError(f"The value {name!r} must be a number or a text, not {value!r:.80}.")
        plain[name] = plain_text(value) if isinstance(value, str) else float(value)
    return plain


def plain_text(text: str) -> str:
    """A text as a table can hold it: without NUL, in UTF-8, long ones without their middle."""
    clean = text.replace("\0", "\\0").encode(errors="backslashreplace").decode()
    if len(clean) <= LONGEST_TEXT:
        return clean
    half = LONGEST_TEXT // 2
    return f"{clean[:half]} ... {clean[-half:]}"


def gather(rows: Sequence[Row]) -> Table:
    """Columns of rows: own ones, parameters, values, in the order in which they first appear.

    A column whose entries are all numbers is of floats, NaN where a row has none; any other is of
    texts, empty where a row has none.
    """
    flat = [
        {
            **{key: row[key] for key in OWN_COLUMNS},
            **row["parameters"],
            **row["values"],
        }
        for row in rows
    ]
    names = dict.fromkeys(OWN_COLUMNS)
    for part in ("parameters", "values"):
        for row in rows:
            names.update(dict.fromkeys(row[part]))
    return {name: _column([row.get(name) for row in flat]) for name in names}


def _column(entries: list[Any]) -> NDArray[Any]:
    given = [entry for entry in entries if entry is not None]
    if given and all(isinstance(entry, Real) for entry in given):
        return np.array([np.nan if entry is None else float(entry) for entry in entries])
    texts = ["" if entry is None else _text(entry) for entry in entries]
    return np.array(texts, dtype=object)


def _text(entry: Any) -> str:
    return entry if isinstance(entry, str) else json.dumps(entry)


def write_table(path: Path, table: Table) -> None:
    """Write a table as HDF5, one dataset per column.

    Raises:
        StudyError: It cannot be written.
    """
    content = _image(table)
    _replace(path, content + seal(content))


def _image(table: Table) -> bytes:
    """An HDF5 file of a table, made in memory: HDF5 does not take a full disk well."""
    image = io.BytesIO()
    with h5py.File(image, "w", libver="latest") as file:
        set_texts(file, format=FORMAT)
        names = json.dumps(list(table)).encode()
        file.create_dataset("names", data=np.frombuffer(names, dtype=np.uint8))
        group = file.create_group("columns")
        for name, column in table.items():
            text = column.dtype == object
            data = np.array([entry.encode() for entry in column], dtype="S") if text else column
            group.create_dataset(name.replace("/", "|"), data=data)
    return image.getvalue()


def read_table(path: str | Path) -> Table:
    """The table of a study, one row per finished or failed case, in the order of the cases.

    Args:
        path: Folder of the study, or the table itself.

    Returns:
        Arrays of shape (rows,) by column: ``case``, ``status`` ("complete" or "failed"),
        ``reason`` of a failure, ``wall_s`` [s], ``peak_mb`` [MiB], the parameters, the values.

    Raises:
        StudyError: There is no such table.
    """
    check_path("path", path)
    place = Path(path)
    place = place / TABLE if os.path.isdir(place) else place
    check_file(place, f"There is no table {place}; run the study first.", StudyError)
    if not h5py.is_hdf5(place):
        raise StudyError(f"{place} is not an HDF5 file.")
    with DamageTold(place, StudyError, "is no table of a study, or a damaged one"):
        check_seal(place)
        with h5py.File(place, "r") as file:
            return _columns(file, place)


def _columns(file: h5py.File, place: Path) -> Table:
    """Columns of an open file."""
    if attribute(file, "format") != FORMAT:
        raise StudyError(f"{place} is not a table of a study.")
    check_contents(file, place, StudyError)
    table: Table = {}
    for name in json.loads(bytes(file["names"][()]).decode()):
        where = f"columns/{name.replace('/', '|')}"
        if where not in file:
            raise ValueError(f"the column {name!r} is missing")
        values = file[where][()]
        if values.dtype.kind == "S":
            values = np.array([entry.decode() for entry in values], dtype=object)
        table[name] = values
    if len({column.shape for column in table.values()}) > 1:
        raise ValueError("its columns are not of one length")
    return table


def write_csv(table: Table, path: str | Path) -> Path:
    """Write a table as CSV: a line of names, then a line per row, numbers in full.

    Raises:
        StudyError: It cannot be written.
        ValueError: An argument is of another kind.
    """
    check_path("path", path)
    columns = [] if not isinstance(table, Mapping) else list(table.values())
    good = all(isinstance(column, np.ndarray) and column.ndim == 1 for column in columns)
    same = len({len(column) for column in columns}) == 1 if good else False
    check_kind_of("table", table, same, "columns of one length by name, as read_table gives")
    place, text = Path(path), io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in columns), strict=True))
    _replace(place, text.getvalue().encode())
    return place


def _replace(path: Path, content: bytes) -> None:
    """Write a file so that it is whole or not there."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(content)
        fresh.replace(path)
    except OSError as error:
        with suppress(OSError):
            fresh.unlink()
        kept = "; the one before it is kept" if path.exists() else ""
        raise StudyError(f"{path} cannot be written: {error.strerror}{kept}.") from error
