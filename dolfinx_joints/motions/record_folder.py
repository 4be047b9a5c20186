# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""All records of a folder or zip archive, with a table of what was read and what was refused."""

import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import compress, groupby
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError, warn
from dolfinx_joints.common.parameters import printable
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.reading import (
    direction_text,
    format_of,
    motion_of,
    read_components,
    records_in,
    remarks_on,
    sorted_in,
)
from dolfinx_joints.motions.record_text import (
    UNREADABLE,
    Component,
    RecordText,
    Source,
    record_named,
)

NESTED = 3  # levels of archives in archives; some archives contain themselves
FACTS = "format", "components", "dt [s]", "duration [s]", "peaks [g]"


@dataclass(frozen=True, eq=False, repr=False)
class Records:
    """Motions of a folder by name, and a table with a row for each file; print it.

    The column ``motion`` is empty for files that are not used, and ``remark`` has the reason.
    `study.write_csv` writes the table.
    """

    motions: dict[str, Motion]
    table: dict[str, Any]

    def __repr__(self) -> str:
        columns = [[name, *map(printable, column)] for name, column in self.table.items()]
        padded = [[cell.ljust(max(map(len, column))) for cell in column] for column in columns]
        return "\n".join("  ".join(line).rstrip() for line in zip(*padded, strict=True))


@checked
def read_motions(source: str | Path, *, stream_azimuth_deg: float | None = None) -> Records:
    """Read all records of a folder or zip archive, with folders and archives in them.

    The files of each folder are grouped to records and read as by `read_record`, which explains
    ``stream_azimuth_deg``. Records with an error and other files are not used; a warning gives the
    number of these files. A source without a record that can be read is an error.
    """
    place, motions, rows = Path(source), dict[str, Motion](), dict[str, dict[str, str]]()
    for folder, group in groupby(_files_below(place), lambda path: str(path.parent)):
        records, refused = records_in(group, False)
        rows |= {str(path): {"remark": f"not read: {text}"} for path, text in refused.items()}
        for record, paths in records.items():
            name, parts = record_named(record), list[Component]()
            row = {"motion": name}
            try:
                for path in paths:
                    channels = read_components(path)
                    rows[str(path)] = _facts(path, channels)
                    parts += channels
                if name in motions:
                    raise RecordError(f"Another folder has a motion with the name {name}")
                motions[name] = motion_of(parts, name, stream_azimuth_deg)
                row["remark"] = "; ".join(remarks_on(motions[name], parts))
            except RecordError as error:
                text = str(error).removeprefix(folder).removeprefix("/").removesuffix(".")
                row = {"remark": f"not read: {text}"}
            for path in paths:
                rows[str(path)] = rows.get(str(path), {}) | row
    names = ("file", "motion", *FACTS, "remark")
    texts = [{"file": path.removeprefix(f"{place}/")} | row for path, row in sorted(rows.items())]
    table = {name: np.array([row.get(name, "") for row in texts]) for name in names}
    result, unused = Records(motions, table), sum("motion" not in row for row in texts)
    if not motions:
        raise RecordError(f"{place} has no record that can be read.\n{result}")
    if unused:
        text = f"{unused} of {len(texts)} files of {place} were not used; print the result."
        warn(text, PlausibilityWarning)
    return result


def _files_below(place: Source) -> Iterator[Source]:
    """Yield the files of a folder or archive, then those of folders and archives in it."""
    content = [path for path in sorted_in(_opened(place)) if not _is_above(path)]
    folders = [_opened(path).is_dir() for path in content]  # without leaving archives open
    yield from (path for path, is_folder in zip(content, folders, strict=True) if not is_folder)
    for path in compress(content, folders):
        yield from _files_below(path)


def _is_above(path: Source) -> bool:
    """Return True for a link to a folder above it, whose files would be found again."""
    return isinstance(path, Path) and path.parent.resolve().is_relative_to(path.resolve())


def _opened(path: Source) -> Source:
    """Return the content of a zip archive; other files and folders unchanged.

    Archives within NESTED others are not opened.
    """
    with suppress(*UNREADABLE):  # refused later like any other unknown file
        nested = str(path.parent).lower().count(".zip")
        if nested < NESTED and path.is_file() and path.name.lower().endswith(".zip"):
            archive = zipfile.ZipFile(path if isinstance(path, Path) else path.open("rb"))
            archive.filename = str(path)  # for the names of its files
            return zipfile.Path(archive)
    return path


def _facts(path: Source, parts: list[Component]) -> dict[str, str]:
    """Return the contents of a file: format, directions, time step, longest duration, peaks."""
    file_format, dt = format_of(RecordText(path)), parts[0].dt
    series = [part.acceleration / STANDARD_GRAVITY for part in parts]
    peaks = [f"{np.abs(values).max():.3g}" for values in series]
    name, longest = file_format.name if file_format else "columns", max(map(len, series)) - 1
    directions, sizes = (", ".join(texts) for texts in (map(direction_text, parts), peaks))
    facts = (name, directions, f"{dt:.6g}", f"{longest * dt:.6g}", sizes)
    return dict(zip(FACTS, facts, strict=True))
