# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Reader of results files: HDF5, versioned, readable during a run and after it was killed.

Layout, version 2::

    /                     attributes ``format``, ``version``, ``created``
    /metadata             JSON text (UTF-8 bytes)
    /status               "running", "complete", "stopped" or "failed"
    /summary              JSON text (UTF-8 bytes, fixed size, padded with zeros)
    /static/NAME          arrays written once; attributes ``unit``, ``description``
    /streams/STREAM/time  one row per record; only increasing
    /streams/STREAM/NAME  first axis grows with ``time``; attributes ``unit``, ``description``

A run declares all names and then calls ``ResultsWriter.start``, which switches the file to HDF5's
single-writer-multiple-reader (SWMR) mode. No dataset can be created in this mode, so status and
summary are preallocated. The values of a record are written before its ``time``, so a row whose
time can be read is complete.

Any name may be declared; the names of a simulation are in `quantities` and `layout`.
Version 1, written by 0.2.0, has the same places, but two quantities differ (`Results.layout`).
"""

import json
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.hdf5 import attribute, check_version, damage_reported, open_growing
from dolfinx_joints.common.parameters import check_file, shown
from dolfinx_joints.common.summary import Rows, Summarised, names, number

FORMAT = "dolfinx_joints results"
VERSION = 2
OLDEST = 1  # lowest version of the layout that is read
STAGE_NAME_BYTES = 120  # longest name of a static stage
RELATIVE, ABSOLUTE = "relative to the ground", "absolute"  # "displacements" in the metadata

Index = int | slice


class Results(Summarised):
    """Open results file, which a run may still be writing; arrays are read on request.

    Args:
        path: The file to read.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=[dj.Gravity()])
        >>> monitor = dj.ResultsMonitor("blocks.h5", points={"top": (0.5, 0.5, 2.0)})
        >>> state = dj.Simulation(model, monitors=[monitor]).statics(name="weight")
        >>> with dj.Results("blocks.h5") as results:
        ...     results.stage_names, results.unit("statics", "reaction/base")
        (['weight'], 'N')
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._opened = _open(self.path)
        self._names: dict[str, list[str]] = {}  # by group
        self._rows: dict[str, int] = {}  # by group, only after the run has ended

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._opened.close()

    @property
    def _file(self) -> h5py.File:
        if not self._opened:
            raise ResultsError(f"{self.path} is closed.")
        return self._opened

    def _summary(self) -> Rows:
        if not self._opened:
            yield "file", f"{self.path}, closed"
            return
        facts = self.metadata
        yield "file", f"{self.path}, {self.status}"
        yield "run", ", ".join(f"{facts[k]} {k}" for k in ("steps", "dofs") if k in facts)
        yield "joints", names(self.joints)
        for stream in self.streams:
            rows = self.rows(stream)
            if rows:
                time = self.time(stream)[[0, -1]]
                span = "" if stream == "statics" else f", {time[0]:g} to {time[1]:g} s"
                series = dict.fromkeys(n.rpartition("/")[2] for n in self.streams[stream])
                yield stream, f"{number(rows)} records{span}: {names(series)}"
        has_points = "histories/points" in self.statics
        yield "points", names(self.point_names) if has_points else ""
        yield "arrays", names(n for n in self.statics if not n.startswith("joints/"))

    @property
    def layout(self) -> int:
        """Version of the layout: 2, or 1 in files of 0.2.0.

        In version 1 slips count from the first record, also after static stages. A reaction at a
        node of several supports is included in each of them.
        """
        return int(self._file.attrs["version"])

    @property
    def metadata(self) -> dict[str, Any]:
        """Facts of the run, as given to its writer."""
        with self._reading():
            return _decode_json(self._file["metadata"])

    @property
    def relative(self) -> bool:
        """True if displacements are relative to the ground; absolute with a `FreeField`."""
        return self.metadata.get("displacements") != ABSOLUTE

    @property
    def summary(self) -> dict[str, Any]:
        """Final facts of the run; empty while the status is "running"."""
        with self._reading():
            return _decode_json(self._file["summary"])

    @property
    def status(self) -> str:
        """Status of the run; still "running" after it was killed."""
        with self._reading():
            return str(self._file["status"][0].decode())

    @property
    def complete(self) -> bool:
        """True if the run reached its end."""
        return self.status == "complete"

    @property
    def created(self) -> str:
        """Time at which the file was created, ISO 8601, UTC."""
        with self._reading():
            return str(attribute(self._file, "created"))

    @property
    def statics(self) -> list[str]:
        """Names of the arrays written once."""
        return self._names_in(self._file["static"])

    @property
    def streams(self) -> dict[str, list[str]]:
        """Names of the series of each stream, without ``time``."""
        groups = self._file["streams"]
        with self._reading():
            return {key: [n for n in self._names_in(groups[key]) if n != "time"] for key in groups}

    @property
    def joints(self) -> list[str]:
        """Names of the joints whose points are stored."""
        names = (name.split("/") for name in self.statics)
        joints = [part[1] for part in names if part[0] == "joints" and part[2:] == ["points"]]
        return sorted(joints, key=lambda name: (len(name), name))

    def check_joint(self, joint: str) -> None:
        """Raise a ResultsError if the file has no joint of this name."""
        if joint not in self.joints:
            raise ResultsError(
                f"No joint {shown(joint)} in {self.path}; it has {listing(self.joints)}."
            )

    def law(self, joint: str) -> dict[str, Any]:
        """Return ``kind``, ``friction_angle_deg`` [degrees] and ``cohesion`` [Pa] of a joint law.

        The angle is None if the law has no friction angle. The result is empty for older files.
        """
        self.check_joint(joint)
        return dict(self.metadata.get("laws", {}).get(joint, {}))

    @property
    def point_names(self) -> list[str]:
        """Names of the monitor points in ``metadata["point_names"]``, otherwise numbered names."""
        names = self.metadata.get("point_names")
        if isinstance(names, list):
            return [str(name) for name in names]
        count = len(self.static("histories/points")) if "histories/points" in self.statics else 0
        return [f"point {i}" for i in range(count)]

    @checked
    def point_index(self, point: int | str) -> int:
        """Return the row of a monitor point given by its name or number."""
        names = self.point_names
        if isinstance(point, str) and point in names:
            return names.index(point)
        if not isinstance(point, str) and 0 <= point < len(names):
            return point
        raise ResultsError(f"No monitor point {shown(point)}; the file has {listing(names)}.")

    @property
    def stage_names(self) -> list[str]:
        """Names of the static stages, in the order of the records of the stream ``statics``."""
        if "statics" not in self.streams:
            return []
        return [bytes(n).rstrip(b"\0").decode() for n in self.series("statics", "name")]

    @checked
    def stage_index(self, stage: int | str) -> int:
        """Return the record in the stream ``statics`` of a stage given by its name or number.

        Numbers start at 0, negative ones at the end. The last stage of several of one name counts.
        """
        names = self.stage_names
        if isinstance(stage, str) and stage in names:
            return len(names) - 1 - names[::-1].index(stage)
        if not isinstance(stage, str) and -len(names) <= stage < len(names):
            return stage % len(names)
        raise ResultsError(
            f"No static stage {shown(stage)} in {self.path}; it has "
            f"{listing(f'{number} ({name})' for number, name in enumerate(names))}."
        )

    def static(self, name: str) -> NDArray[Any]:
        """Return an array that was written once, by its name below ``/static``."""
        dataset = self._static(name)
        with self._reading():
            values: NDArray[Any] = dataset[()]
        return values

    @contextmanager
    def datasets(self) -> Iterator[tuple[h5py.Group, h5py.Group]]:
        """Return the HDF5 groups ``static`` and ``streams``, for reading parts of datasets."""
        with self._reading():
            yield self._file["static"], self._file["streams"]

    def time(self, stream: str) -> Floats:
        """Return the times of the complete records of a stream, shape (rows,), [s]."""
        group, rows = self._stream(stream), self.rows(stream)
        with self._reading():
            times: Floats = group["time"][:rows]
        if not (np.diff(times, prepend=-np.inf) > 0.0).all():
            raise ResultsError(
                f"{self.path} is damaged: the times of the stream {stream!r} do not increase."
            )
        return times

    def rows(self, stream: str) -> int:
        """Return the number of complete records of a stream, with all values and a time."""
        group = self._stream(stream)
        if group.name in self._rows:
            return self._rows[group.name]
        ended = self.status != "running"  # read first: the run may end while rows are counted
        rows = self._count(group)
        if ended:
            self._rows[group.name] = rows
        return rows

    def _count(self, group: h5py.Group) -> int:
        block = 1
        with self._reading():
            rows = min(len(group[name]) for name in self._names_in(group))
            while rows:  # the last rows may exist without a time
                first = max(0, rows - block)
                complete = np.flatnonzero(~np.isnan(group["time"][first:rows]))
                if complete.size:
                    return first + int(complete[-1]) + 1
                rows, block = first, 8 * block
        return 0

    @checked
    def series(self, stream: str, name: str, index: Index = slice(None)) -> NDArray[Any]:
        """Return the values of one quantity of a stream.

        Args:
            stream: Name of the stream.
            name: Name of the quantity.
            index: Number of a record (negative from the end) or a slice; only these are read.

        Returns:
            Shape (rows, ...), or the shape of one record if ``index`` is a number. Numbers stored
            in single precision are returned in double precision.
        """
        dataset, rows = self._series(stream, name), self.rows(stream)
        if not isinstance(index, slice):
            if not -rows <= index < rows:
                raise ResultsError(f"The stream {stream!r} has {rows} records, got number {index}.")
            index %= rows
        else:
            start, stop, step = index.indices(rows)
            if step < 1:
                raise ResultsError(f"A slice of records must have a positive step, got {step}.")
            index = slice(start, max(start, stop), step)
        with self._reading():
            values = np.asarray(dataset[index])
        return values.astype(np.float64) if values.dtype == np.float32 else values

    @checked
    def nearest(self, stream: str, time: float) -> int:
        """Return the number of the record whose time is nearest to ``time`` [s]."""
        times = self.time(stream)
        if not times.size:
            raise ResultsError(f"The stream {stream!r} has no records.")
        return int(np.argmin(np.abs(times - time)))

    def unit(self, *where: str) -> str:
        """Return the unit of an array given by its name, or of a series by stream and name."""
        return self._text("unit", where)

    def description(self, *where: str) -> str:
        """Return the description of an array (name) or of a series (stream and name)."""
        return self._text("description", where)

    def _names_in(self, group: h5py.Group) -> list[str]:
        """Return the names of the datasets in a group; they are fixed once the run has started."""
        if group.name not in self._names:
            paths: list[str] = []
            group.visititems(
                lambda name, item: paths.append(name) if isinstance(item, h5py.Dataset) else None
            )
            self._names[group.name] = paths
        return self._names[group.name]

    def _reading(self) -> AbstractContextManager[None]:
        return damage_reported(self.path, ResultsError)

    def _text(self, key: str, where: tuple[str, ...]) -> str:
        dataset = self._static(*where) if len(where) == 1 else self._series(*where)
        with self._reading():
            return str(attribute(dataset, key))

    def _static(self, name: str) -> h5py.Dataset:
        if name not in self.statics:
            raise ResultsError(
                f"No array {shown(name)} in {self.path}; it has {listing(self.statics)}."
            )
        return self._file["static"][name]

    def _stream(self, stream: str) -> h5py.Group:
        if stream not in list(self._file["streams"]):
            streams = listing(self._file["streams"])
            raise ResultsError(f"No stream {shown(stream)} in {self.path}; it has {streams}.")
        return self._file["streams"][stream]

    def _series(self, stream: str, name: str) -> h5py.Dataset:
        group = self._stream(stream)
        if name not in self._names_in(group):
            raise ResultsError(
                f"No series {shown(name)} in the stream {stream!r} of {self.path}; "
                f"it has {listing(self.streams[stream])}."
            )
        return group[name]


def _open(path: Path) -> h5py.File:
    check_file(path, f"There is no results file {path}.", ResultsError)
    file = open_growing(path, ResultsError)
    try:
        with damage_reported(path, ResultsError):
            _check(file, path)
    except BaseException:
        file.close()
        raise
    return file


def _check(file: h5py.File, path: Path) -> None:
    """Raise an error if the file is no results file of a supported version, or is incomplete."""
    file_format, version = attribute(file, "format"), attribute(file, "version")
    if file_format != FORMAT or not isinstance(version, int):
        raise ResultsError(f"{path} is HDF5 but not a file of {FORMAT!r}.")
    check_version(version, OLDEST)
    if version > VERSION:
        raise ResultsError(
            f"{path} has version {version} of the layout; the highest supported is {VERSION}. "
            "Update dolfinx_joints."
        )
    if not all(key in file for key in ("metadata", "status", "summary", "static", "streams")):
        raise ResultsError(f"{path} was left incomplete before its run started.")


def listing(items: Iterable[str]) -> str:
    """Return names in one line for messages; of many names, only the first."""
    return names(items) or "none"


def _decode_json(dataset: h5py.Dataset) -> dict[str, Any]:
    text = bytes(dataset[:]).rstrip(b"\0").decode()
    decoded = json.loads(text) if text else {}
    if not isinstance(decoded, dict):
        raise ValueError(f"{dataset.name!r} is not a JSON object")
    return decoded
