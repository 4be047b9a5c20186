# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions from files: grouping of files to records, and axes of the components.

The format of a file is identified by its content, not by its name. Units are converted: motions are
in m/s^2 and in right-handed axes with z up. Azimuths are clockwise from north, seen from above.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import PlausibilityWarning, RecordError, warn
from dolfinx_joints.common.parameters import shown
from dolfinx_joints.motions.columns import is_columns, read_columns, states_unit
from dolfinx_joints.motions.formats import FORMATS, at2_parts
from dolfinx_joints.motions.motion import Motion, Seconds
from dolfinx_joints.motions.record_text import (
    Component,
    Format,
    RecordText,
    Source,
    direction_named,
    unit_named,
)

WEAK_G, STRONG_G = 0.02, 5.0
"""Plausible peaks in units of g: up to 0.028 g shaking is light (intensity IV, Worden et al., Bull.
Seism. Soc. Am. 102, 2012, 204); the strongest record has 4 g (Aoi et al., Science 322, 2008)."""

LONGEST_STEP = 0.1
"""Longest plausible time between samples [s]; accelerographs record 50 to 200 samples a second."""

LEAST_COMMON = 0.9
"""Least common duration of components, relative to the longest; files of a record differ little."""

_HEAD = 20_000  # bytes, enough for the header of any format
_ANGLE = 1e-6  # tolerance of the right angle between horizontal components [degrees]
_ALIGNMENT = 0.25  # allowed offset of sample times of components, in steps; headers round to 1 ms


@checked
def read_components(
    path: str | Source,
    *,
    unit: str | None = None,
    dt: Seconds | None = None,
    columns: Sequence[str | float] | str | None = None,
) -> list[Component]:
    """Read the components in one file of any supported format.

    Args:
        path: file in the format PEER AT2, ESM/ITACA, K-NET or KiK-net, COSMOS V1 or V2, CSMIP V1
            or V2, GeoNet, AFAD, SMC (corrected), or in plain columns.
        unit: unit of plain columns that do not state it; must agree with a unit in the file.
        dt: time between rows of plain columns [s], if the file has no time column.
        columns: ``"time"``, directions or ``"skip"``, if the file does not name its columns;
            ``"wrapped"`` for one component that continues from line to line.
    """
    text = RecordText(path)
    file_format = format_of(text)
    if file_format is None and is_columns(text):
        return read_columns(text, unit, dt, columns)
    if file_format is None:
        names = ", ".join(candidate.name for candidate in FORMATS)
        raise RecordError(
            f"{text.path} has an unknown format (supported: {names}, plain columns); it begins "
            f"with {text.lines[0][:40]!r}. Convert it to plain columns, with the lines "
            "'# unit: cm/s^2', '# columns: time N' (N: north, E: east, UP: up), '0.00 1.25', "
            "'0.01 -3.50' and so on."
        )
    if columns is not None:
        raise RecordError(
            f"{text.path} has the format {file_format.name}; columns= is for plain columns only."
        )
    components = list(file_format.read(text))
    for part in components:
        if unit is not None and unit_named(unit, "unit") != part.unit:
            raise RecordError(f"{path} is in {part.unit}, but unit={shown(unit)} was given.")
        if dt is not None and abs(dt - part.dt) > 1e-6 * part.dt:
            raise RecordError(f"{path} has a time step of {part.dt:.6g} s, but dt={dt} was given.")
    return components


@checked
def read_record(
    source: str | Path | Iterable[str | Path],
    *,
    name: str | None = None,
    unit: str | None = None,
    dt: Seconds | None = None,
    columns: Sequence[str | float] | str | None = None,
    directions: Sequence[str | float] | None = None,
    stream_azimuth_deg: float | None = None,
) -> Motion:
    """Read the components of one record.

    Of the horizontal components, y is 90 degrees to the left of x, seen from above: azimuths 0 and
    270, or east and north. The sign of a downward component is changed. If ``stream_azimuth_deg``
    is given, the horizontal axes are rotated so that x points downstream. Without a vertical
    component z is zero, and a warning is given.

    Components are cut to their common time interval. The time of the first sample is read from the
    header (ESM, K-NET, COSMOS, SMC) or the time column; without it, components start together. An
    error is raised if only some components have such a time, if there is no common interval, or if
    samples of two components are more than a quarter of a step apart.

    Args:
        source: a directory, one file, or several files. Files of a directory are grouped to records
            by their headers; AT2 files by names that end in a component (``-UP``, ``DWN``,
            ``000``, ``EW2``). Subdirectories and plain columns without a unit are skipped.
        name: name of the record, or a unique part of the name; needed if there are several records.
        unit: unit of plain columns, see :func:`read_components`.
        dt: time step of plain columns [s].
        columns: contents of plain columns.
        directions: directions of the components in the order of files and columns: N, E, S, W, UP,
            DOWN, an azimuth [degrees], or x, y, z of the dam. They must agree with file headers.
        stream_azimuth_deg: azimuth of the dam's x axis, which points downstream [degrees].

    Example:
        >>> import numpy as np
        >>> import dolfinx_joints as dj
        >>> samples = [[0, 0, 0], [100, 0, 0], [0, 50, 0], [0, 0, -25]]  # N, E, up [cm/s^2]
        >>> np.savetxt("record.txt", samples)
        >>> motion = dj.read_record(
        ...     "record.txt", unit="cm/s^2", columns="N E UP", dt=0.01, stream_azimuth_deg=0.0
        ... )
        >>> motion.peak.round(6)  # x points north, downstream [m/s^2]
        array([1.  , 0.5 , 0.25])
    """
    files, title = _files(source, name, unit is not None)
    parts = [
        part for path in files for part in read_components(path, unit=unit, dt=dt, columns=columns)
    ]
    title = title or parts[0].record
    if directions is not None:
        parts = _set_directions(parts, directions)
    motion = motion_of(parts, title, stream_azimuth_deg)
    for remark in remarks_on(motion, parts):
        warn(f"The record {shown(motion.name)}: {remark}.", PlausibilityWarning)
    return motion


def motion_of(parts: list[Component], title: str, stream_azimuth_deg: float | None) -> Motion:
    """Return the motion of the components of a record, see `read_record`."""
    motion, azimuth = _assemble_motion(parts, title)
    if azimuth is None and stream_azimuth_deg is not None:
        raise RecordError("stream_azimuth_deg is not allowed for components along x and y.")
    if azimuth is None or stream_azimuth_deg is None:
        return motion
    return motion.rotated(azimuth - stream_azimuth_deg)


def record_names(directory: str | Path) -> list[str]:
    """Return the names of the records in a directory, without its subdirectories."""
    return list(records_in(sorted_in(Path(directory)), False)[0])


def format_of(text: RecordText) -> Format | None:
    """Return the format of a file, None for plain columns and unknown formats."""
    return next((candidate for candidate in FORMATS if candidate.matches(text)), None)


def _files(
    source: str | Path | Iterable[str | Path], name: str | None, any_columns: bool
) -> tuple[list[Source], str]:
    """Return the files to read and the name of their record, empty for given files."""
    if not isinstance(source, str | Path):
        files: list[Source] = [Path(path) for path in source]
        if not files:
            raise RecordError("At least one file is needed, got none.")
        return files, ""
    path = Path(source)
    if os.path.isfile(path):
        return [path], ""
    records, refused = records_in(sorted_in(path), any_columns)
    chosen = [stem for stem in records if name is None or name.lower() in stem.lower()]
    chosen = [stem for stem in chosen if stem == name] or chosen
    if not chosen:
        names = ", ".join(records) or "none"
        condition = "" if name is None else f" with {name!r} in its name"
        left_out = [f"{file.name} ({reason})" for file, reason in list(refused.items())[:5]]
        skipped = f"; skipped files: {', '.join(left_out)}" if left_out else ""
        raise RecordError(f"{path} has no record{condition}; its records: {names}{skipped}.")
    if len(chosen) > 1:
        raise RecordError(f"{path} has several records; choose by name=: {', '.join(chosen)}.")
    return records[chosen[0]], chosen[0]


def sorted_in(folder: Source) -> list[Source]:
    """Return the content of a folder, sorted by name."""
    try:
        return sorted(folder.iterdir(), key=lambda path: path.name)
    except NotADirectoryError:
        raise RecordError(f"{folder} is neither a folder nor a complete zip archive.") from None
    except OSError as error:
        text = f"The file or directory {folder} cannot be read: {error.strerror}."
        raise RecordError(text) from None


def records_in(
    paths: Iterable[Source], any_columns: bool
) -> tuple[dict[str, list[Source]], dict[Source, str]]:
    """Return the files of each record, and the reasons why other files belong to no record."""
    records: dict[str, list[Source]] = {}
    refused = {}
    for path in (path for path in paths if path.is_file()):
        try:
            records.setdefault(_record_of(path, any_columns), []).append(path)
        except RecordError as error:
            refused[path] = str(error).removeprefix(str(path)).strip(" ,:.")
    return records, refused


def _record_of(path: Source, any_columns: bool) -> str:
    """Return the record name of a file from its first lines; raise RecordError without a name."""
    try:
        text = RecordText(path, head=_HEAD)
        file_format = format_of(text)
        columns = file_format is None and is_columns(text) and (any_columns or states_unit(text))
        record = path.stem if columns else None if file_format is None else file_format.record(text)
        if record is None:
            raise RecordError("no accelerations, no unit, or no component in the file name")
        return record
    except RecordError:  # assign a damaged AT2 file by its name, so that reading it raises an error
        if path.suffix.upper() == ".AT2" and (record := at2_parts(path)[0]) is not None:
            return record
        raise


def _set_directions(parts: list[Component], directions: Sequence[str | float]) -> list[Component]:
    """Return the components with the directions given by the user, checked against the files."""
    if len(directions) != len(parts):
        raise RecordError(
            f"directions has {len(directions)} entries, but the files have {len(parts)} components."
        )
    directed = []
    for part, name in zip(parts, directions, strict=True):
        direction = direction_named(str(name))
        if direction is None:
            raise RecordError(
                "directions must be N, E, S, W, UP, DOWN, azimuths from 0 to 360, or x, y, z of "
                f"the dam, got {shown(name)}."
            )
        if part.stated not in (None, direction):
            raise RecordError(
                f"{part.path} has the direction {part.stated}, but {shown(name)} was given."
            )
        directed.append(replace(part, stated=direction, suggested=None))
    return directed


def remarks_on(motion: Motion, parts: list[Component]) -> list[str]:
    """Return remarks on an unusual record: peak, time step, lost time, no vertical component."""
    peak, remarks = float(motion.peak.max()) / STANDARD_GRAVITY, []
    if not WEAK_G <= peak <= STRONG_G:
        units = ", ".join(dict.fromkeys(part.unit for part in parts))
        expected = f"not {WEAK_G} to {STRONG_G} g; check the unit"
        remarks.append(f"its peak is {peak:.3g} g, read in {units}, {expected}")
    if motion.dt > LONGEST_STEP:
        remarks.append(f"its time step is {motion.dt:g} s, more than {LONGEST_STEP} s")
    longest = max((len(part.acceleration) - 1) * part.dt for part in parts)
    if motion.duration < LEAST_COMMON * longest:
        common = f"{motion.duration:g} s of up to {longest:g} s"
        remarks.append(f"its components have only {common} in common; the rest is cut off")
    if len(parts) == 2:
        remarks.append("it has no vertical component; z is zero")
    return remarks


def _assemble_motion(parts: list[Component], title: str) -> tuple[Motion, float | None]:
    """Return the motion along x, y, z and the azimuth of x [degrees], None for x of the dam."""
    for part in parts:
        if part.stated is not None and part.suggested not in (None, part.stated):
            raise RecordError(
                f"{part.path}, line 2: component and file name disagree; correct one."
            )
    contents = ", ".join(f"{part.path.name} ({direction_text(part)})" for part in parts)
    vertical = [part for part in parts if part.direction in ("up", "down")]
    flat = [(part, part.direction) for part in parts if isinstance(part.direction, float)]
    pairs: list[tuple[Component, Component, float | None]] = [
        (a, b, azimuth)
        for a, azimuth in flat
        for b, other in flat
        if abs((azimuth - other + 90.0) % 360.0 - 180.0) < _ANGLE  # b is 90 degrees to the left
    ]
    pairs += [
        (a, b, None) for a in parts for b in parts if (a.direction, b.direction) == ("x", "y")
    ]
    if len(parts) - len(vertical) != 2 or len(vertical) > 1 or len(pairs) != 1:
        raise RecordError(
            "A record must have two horizontal components at right angles, but "
            f"{shown(title)} has {contents}; give read_record directions= if the files do not "
            "state them."
        )
    ((x, y, azimuth),) = pairs
    columns = _common_interval((x, y, *vertical), title)
    if not vertical:
        columns = np.column_stack([columns, np.zeros(len(columns))])
    elif vertical[0].direction == "down":
        columns[:, 2] *= -1.0
    return Motion(acceleration=columns, dt=x.dt, name=title), azimuth


def direction_text(part: Component) -> str:
    """Return the direction of a component as text."""
    direction = part.direction
    return f"{direction:g}°" if isinstance(direction, float) else direction or "unknown direction"


def _common_interval(parts: Sequence[Component], title: str) -> Floats:
    """Return the accelerations in the common time interval, shape (n, components), [m/s^2]."""
    dt, shortest = parts[0].dt, min(len(part.acceleration) for part in parts)
    if max(abs(part.dt - dt) for part in parts) * shortest > _ALIGNMENT * dt:
        steps = ", ".join(f"{part.path.name} {part.dt:.6g} s" for part in parts)
        raise RecordError(f"The components of {shown(title)} have different time steps: {steps}.")
    shortened = [
        part.acceleration[skipped:]
        for part, skipped in zip(parts, _offsets(parts, dt, title), strict=True)
    ]
    length = min(map(len, shortened))
    if length < 2:
        raise RecordError(
            f"The components of {shown(title)} have no common time interval: {_starts(parts)}."
        )
    return np.stack([values[:length] for values in shortened], axis=1)


def _offsets(parts: Sequence[Component], dt: float, title: str) -> list[int]:
    """Count the samples of each component before the latest start of a component."""
    starts = [part.start for part in parts if part.start is not None]
    if not starts:
        return [0] * len(parts)
    if len(starts) < len(parts):
        raise RecordError(
            f"The components of {shown(title)} cannot be aligned: only some files have the time of "
            f"the first sample: {_starts(parts)}."
        )
    steps = (max(starts) - np.array(starts)) / dt
    if np.abs(steps - np.rint(steps)).max() > _ALIGNMENT:
        raise RecordError(
            f"The components of {shown(title)} cannot be aligned: the differences of their starts "
            f"are not multiples of the step, {dt:.6g} s: {_starts(parts)}."
        )
    return [int(step) for step in np.rint(steps)]


def _starts(parts: Sequence[Component]) -> str:
    """Return the start of each component relative to the earliest one, for messages."""
    first = min(part.start for part in parts if part.start is not None)
    return ", ".join(
        f"{part.path.name} ({direction_text(part)}) starts at "
        + ("an unknown time" if part.start is None else f"{part.start - first:.4g} s")
        for part in parts
    )
