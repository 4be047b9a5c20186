# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""All records of a folder or zip archive, with a table of what was read and what was refused."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError, warn
from dolfinx_joints.common.parameters import printable
from dolfinx_joints.motions.motion import Motion, Seconds
from dolfinx_joints.motions.reading import (
    archive_in,
    direction_text,
    files_below,
    format_of,
    motion_of,
    read_components,
    records_in,
    remarks_on,
)
from dolfinx_joints.motions.record_text import Component, RecordText, Source, record_named

Row = dict[str, str]
FACTS = "format", "components", "dt [s]", "duration [s]", "peaks [g]"
COLUMNS = (
    "file",
    "motion",
    "format",
    "components",
    "dt [s]",
    "duration [s]",
    "peaks [g]",
    "remark",
)


@dataclass(frozen=True, eq=False, repr=False)
class Records:
    """Motions of a folder by name, and a row for each file.

    Attributes:
        motions: Motions by name, in the order of the files.
        rows: Texts by column of each file; the motion is empty for files that are not used.
    """

    motions: dict[str, Motion]
    rows: list[Row]

    @property
    def table(self) -> dict[str, NDArray[np.object_]]:
        """Columns of texts, one row per file; `study.write_csv` writes them."""
        return {c: np.array([row.get(c, "") for row in self.rows], dtype=object) for c in COLUMNS}

    def __repr__(self) -> str:
        columns = [[name, *map(printable, values)] for name, values in self.table.items()]
        widths = [max(map(len, column)) for column in columns]
        lines = zip(*columns, strict=True)
        return "\n".join(
            "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
            for line in lines
        )

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"


@checked
def read_motions(
    source: str | Path,
    *,
    unit: str | None = None,
    dt: Seconds | None = None,
    columns: Sequence[str | float] | str | None = None,
    stream_azimuth_deg: float | None = None,
) -> Records:
    """Read all records of a folder or zip archive, with subfolders and archives in them.

    Files are grouped to records in each folder, and read as by `read_record`. A record with an
    error is not used, and its error is in the table; so are files that are no accelerograms. A
    warning gives their number.

    Args:
        source: Folder or zip archive.
        unit: Unit of files in plain columns, see `read_components`.
        dt: Time step of plain columns [s].
        columns: Contents of plain columns.
        stream_azimuth_deg: Azimuth of the dam's x axis, which points downstream [degrees].

    Raises:
        RecordError: The source cannot be read, or has no record without an error.
    """
    place = Path(source)
    paths = list(files_below(archive_in(place) or place))
    folders: dict[str, list[Source]] = {}
    for path in paths:
        folders.setdefault(str(path.parent), []).append(path)
    motions: dict[str, Motion] = {}
    rows: dict[str, Row] = {str(path): {"file": _below(path, place)} for path in paths}
    for files in folders.values():
        records, refused = records_in(files, unit is not None)
        for path, reason in refused.items():
            rows[str(path)]["remark"] = f"not read: {reason}"
        for record, members in records.items():
            name, texts = record_named(record)[:100], [rows[str(path)] for path in members]
            parts: list[Component] = []
            try:
                for path, row in zip(members, texts, strict=True):
                    found = read_components(path, unit=unit, dt=dt, columns=columns)
                    row |= _facts(path, found)
                    parts += found
                if name in motions:
                    raise RecordError(f"a motion of another folder has the name {name}")
                motions[name] = motion_of(parts, name, stream_azimuth_deg)
            except RecordError as error:
                remark = f"not read: {str(error).removeprefix(str(path.parent)).strip('/.')}"
            else:
                remark = "; ".join(remarks_on(motions[name], parts))
                texts = [row | {"motion": name} for row in texts]
            for path, row in zip(members, texts, strict=True):
                rows[str(path)] = row | {"remark": remark}
    result = Records(motions, list(rows.values()))
    unused = sum("motion" not in row for row in result.rows)
    if not motions:
        raise RecordError(f"{place} has no record that can be read.\n{result}")
    if unused:
        text = f"{unused} of {len(paths)} files of {place} were not used; print the records."
        warn(text, PlausibilityWarning)
    return result


def _below(path: Source, place: Path) -> str:
    """Return the name of a file, relative to the folder or archive."""
    return str(path).removeprefix(str(place)).lstrip("/")


def _facts(path: Source, parts: list[Component]) -> Row:
    """Return what a file has: format, directions of its components, step, duration, peaks."""
    file_format = format_of(RecordText(path))
    peaks = [np.abs(part.acceleration).max() / STANDARD_GRAVITY for part in parts]
    longest = max(len(part.acceleration) for part in parts) - 1
    facts = (
        "columns" if file_format is None else file_format.name,
        ", ".join(map(direction_text, parts)),
        f"{parts[0].dt:.6g}",
        f"{longest * parts[0].dt:.6g}",
        ", ".join(f"{peak:.3g}" for peak in peaks),
    )
    return dict(zip(FACTS, facts, strict=True))
