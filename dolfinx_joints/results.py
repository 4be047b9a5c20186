# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Results files: HDF5, versioned, readable while they grow and after a run was killed.

Layout, version 1::

    /                     attributes ``format``, ``version``, ``created``
    /metadata             JSON text (UTF-8 bytes)
    /status               "running", "complete", "stopped" or "failed"
    /summary              JSON text (UTF-8 bytes, fixed size, padded with zeros)
    /static/NAME          arrays written once; attributes ``unit``, ``description``
    /streams/STREAM/time  one row per record; only increasing
    /streams/STREAM/NAME  first axis grows with ``time``; attributes ``unit``, ``description``

A run declares all names first and then calls :meth:`ResultsWriter.start`, from where on the file
is in HDF5's single-writer-multiple-reader (SWMR) mode: nothing may be created any more, which is
why status and summary are preallocated datasets. The values of a record reach the file before
its ``time`` does, hence a row whose time can be read is a whole row.

A file whose status is still "running" belongs to a live run or to one that was killed.

A simulation writes the contents named in :func:`declare_histories`, :func:`declare_energy` and
:func:`declare_states`; any other name may be added.
"""

import json
import re
import time as clock
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, get_args

import h5py
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from dolfinx_joints.errors import ResultsError

FORMAT = "dolfinx_joints results"
VERSION = 1
ENERGY_TERMS = ("kinetic", "strain", "joint", "input", "viscous", "friction", "error")

Status = Literal["running", "complete", "stopped", "failed"]
Index = int | slice

_SUMMARY_BYTES = 65536  # room preallocated for the summary, which SWMR does not let grow
_CHUNK_BYTES = 65536
_BUFFER_ROWS = 64
_BUFFER_BYTES = 1 << 24
_NAME = re.compile(r"[A-Za-z0-9_.+-]+(/[A-Za-z0-9_.+-]+)*")


class ResultsWriter:
    """Writes one results file from plain arrays, on one process.

    Use as a context manager: declare with :meth:`static` and :meth:`series`, :meth:`start`,
    :meth:`append` as the run goes, :meth:`finish`. Leaving the block by an exception marks the
    file "failed"; leaving it without :meth:`finish` marks it "stopped".

    Args:
        path: the file to write.
        metadata: what the run was; anything JSON can hold, NumPy scalars and arrays included.
        overwrite: replace an existing file instead of refusing it.
        flush_interval: longest time that appended rows stay in memory [s], counted when the
            next row comes.

    Raises:
        ResultsError: the file exists, or cannot be created, or the metadata are not JSON.
    """

    def __init__(
        self,
        path: str | Path,
        metadata: Mapping[str, Any],
        *,
        overwrite: bool = False,
        flush_interval: float = 2.0,
    ) -> None:
        """Create the file and write the metadata."""
        self.path = Path(path)
        if not flush_interval >= 0.0:
            raise ResultsError(f"flush_interval must be 0 s or more, got {flush_interval} s.")
        encoded = _encode_json(metadata, "metadata")
        if self.path.exists() and not overwrite:
            raise ResultsError(f"{self.path} exists; pass overwrite=True to replace it.")
        try:
            if self.path.exists():
                self.path.unlink()  # not truncated: whoever reads the old file keeps it
            self._file = h5py.File(self.path, "x", libver="latest")
        except OSError as error:
            raise ResultsError(f"{self.path} cannot be created: {error}.") from error
        self._file.attrs.update(
            format=FORMAT, version=VERSION, created=datetime.now(UTC).isoformat(timespec="seconds")
        )
        self._file.create_dataset("metadata", data=encoded)
        self._file.create_dataset("status", data=np.array([b"running"], dtype="S16"))
        self._file.create_dataset("summary", data=np.zeros(_SUMMARY_BYTES, dtype=np.uint8))
        self._file.create_group("static")
        self._file.create_group("streams")
        self._streams: dict[str, _Stream] = {}
        self._started = False
        self._finished = False
        self._flush_interval = flush_interval
        self._flushed_at = clock.monotonic()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what is buffered, settle the status and close the file."""
        try:
            if kind is not None and not self._finished:
                status: Status = "failed" if issubclass(kind, Exception) else "stopped"
                self.finish(status, {"error": f"{kind.__name__}: {error}"[:2000]})
        finally:
            self.close()

    def static(self, name: str, array: ArrayLike, unit: str, description: str) -> None:
        """Write an array once.

        Args:
            name: path below ``static``, for example ``"mesh/nodes"``.
            array: numbers of any shape.
            unit: for example ``"m"``; ``"-"`` where there is none.
            description: one line for a reader of the file.
        """
        self._check_declaration(name)
        values = np.asarray(array)
        if values.dtype.kind not in "biuf":
            raise ResultsError(f"The static {name!r} must hold real numbers, got {values.dtype}.")
        dataset = _create(self._file["static"], name, data=values)
        dataset.attrs.update(unit=unit, description=description)

    def series(
        self,
        stream: str,
        name: str,
        shape: Sequence[int],
        unit: str,
        description: str,
        *,
        dtype: DTypeLike = np.float64,
    ) -> None:
        """Declare a quantity of which every record of a stream holds one array.

        Args:
            stream: the group of quantities recorded at the same times; made when first named.
            name: path below the stream, for example ``"joints/joint_1/gap"``.
            shape: shape of one record; ``()`` for a number.
            unit: for example ``"m"``; ``"-"`` where there is none.
            description: one line for a reader of the file.
            dtype: type stored, real or integer.
        """
        self._check_declaration(name)
        self._check_declaration(stream)
        if "/" in stream or name == "time":
            raise ResultsError(
                f"A stream's name has no '/' and no series is called 'time', got {stream!r} "
                f"and {name!r}."
            )
        if stream not in self._streams:
            self._streams[stream] = _Stream(self._file["streams"], stream)
        self._streams[stream].declare(name, tuple(shape), np.dtype(dtype), unit, description)

    def start(self) -> None:
        """End the declarations; from here on others may read the file while it grows."""
        if self._started:
            raise ResultsError(f"{self.path} has been started already.")
        self._file.flush()
        self._file.swmr_mode = True
        self._started = True

    def append(self, stream: str, time: float, values: Mapping[str, ArrayLike]) -> None:
        """Add one record to a stream.

        Args:
            stream: a declared stream.
            time: time of the record [s], later than the one before.
            values: an array for every quantity declared in the stream; copied.
        """
        if not self._started or self._finished:
            state = "finished already" if self._finished else "not started"
            raise ResultsError(f"No record can be appended: {self.path} is {state}.")
        if stream not in self._streams:
            raise ResultsError(f"No stream {stream!r}; declared are {_listing(self._streams)}.")
        self._streams[stream].append(float(time), values)
        due = clock.monotonic() - self._flushed_at >= self._flush_interval
        if due:
            self.flush()
        elif self._streams[stream].full:
            self._flush_streams([self._streams[stream]])

    def flush(self) -> None:
        """Bring every appended row into the file."""
        self._flush_streams(self._streams.values())
        self._flushed_at = clock.monotonic()

    def finish(self, status: Status, summary: Mapping[str, Any]) -> None:
        """Write the buffered rows, the summary and, last, the status.

        Args:
            status: ``"complete"``, ``"stopped"`` or ``"failed"``.
            summary: closing facts of the run; anything JSON can hold.
        """
        if status not in get_args(Status) or status == "running":
            raise ResultsError(f"status must be 'complete', 'stopped' or 'failed', got {status!r}.")
        encoded = _encode_json(summary, "summary")
        if encoded.size > _SUMMARY_BYTES:
            raise ResultsError(
                f"The summary may take {_SUMMARY_BYTES} bytes as JSON, got {encoded.size}."
            )
        if self._finished:
            raise ResultsError(f"{self.path} is finished already.")
        self._finished = True
        self.flush()
        self._file["summary"][: encoded.size] = encoded
        self._file.flush()
        self._file["status"][0] = status.encode()
        self._file.flush()

    def close(self) -> None:
        """Close the file; a run that was not finished is marked "stopped"."""
        if not self._file:
            return
        try:
            if not self._finished:
                self.finish("stopped", {})
        finally:
            self._file.close()

    def _flush_streams(self, streams: Iterable["_Stream"]) -> None:
        pending = [(stream, stream.write_values()) for stream in streams if stream.rows]
        if pending:
            self._file.flush()
            for stream, times in pending:
                stream.write_time(times)
            self._file.flush()

    def _check_declaration(self, name: str) -> None:
        if self._started:
            raise ResultsError(f"{name!r} must be declared before start.")
        if not _NAME.fullmatch(name):
            raise ResultsError(
                f"Names are letters, digits and _ . + - with '/' between parts, got {name!r}."
            )


class _Stream:
    """Datasets of one stream and the rows that wait to be written."""

    def __init__(self, parent: h5py.Group, name: str) -> None:
        self.name = name
        self.rows: list[tuple[float, dict[str, NDArray[Any]]]] = []
        self._last = -np.inf
        self._bytes = 0
        self._group = parent.create_group(name)
        self._datasets: dict[str, h5py.Dataset] = {}
        self._time = _extendable(self._group, "time", (), np.dtype(np.float64), fill=np.nan)
        self._time.attrs.update(unit="s", description="time of each record")

    @property
    def full(self) -> bool:
        return len(self.rows) >= _BUFFER_ROWS or self._bytes >= _BUFFER_BYTES

    def declare(
        self, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], unit: str, text: str
    ) -> None:
        if dtype.kind not in "iuf":
            raise ResultsError(f"The series {name!r} must hold real numbers, got {dtype}.")
        dataset = _extendable(self._group, name, shape, dtype)
        dataset.attrs.update(unit=unit, description=text)
        self._datasets[name] = dataset

    def append(self, time: float, values: Mapping[str, ArrayLike]) -> None:
        if not (np.isfinite(time) and time > self._last):
            raise ResultsError(
                f"Times of the stream {self.name!r} must be finite and increase, got {time} s "
                f"after {self._last} s."
            )
        if values.keys() != self._datasets.keys():
            raise ResultsError(
                f"A record of {self.name!r} holds {_listing(self._datasets)}, "
                f"got {_listing(values)}."
            )
        row = {}
        for name, dataset in self._datasets.items():
            row[name] = np.array(values[name], dtype=dataset.dtype)
            if row[name].shape != dataset.shape[1:]:
                raise ResultsError(
                    f"{self.name}/{name} was declared with shape {dataset.shape[1:]}, "
                    f"got {row[name].shape}."
                )
        self._last = time
        self._bytes += sum(array.nbytes for array in row.values())
        self.rows.append((time, row))

    def write_values(self) -> list[float]:
        """Write the waiting values and return their times, still to be written."""
        times = [time for time, _ in self.rows]
        start = self._time.shape[0]
        for name, dataset in self._datasets.items():
            dataset.resize(start + len(times), axis=0)
            dataset[start:] = np.stack([row[name] for _, row in self.rows])
        self.rows.clear()
        self._bytes = 0
        return times

    def write_time(self, times: Sequence[float]) -> None:
        start = self._time.shape[0]
        self._time.resize(start + len(times), axis=0)
        self._time[start:] = times


class Results:
    """Reads a results file; arrays are read only when asked for.

    A file that a run is still writing can be opened; :meth:`refresh` shows the rows added since.

    Args:
        path: the file to read.

    Raises:
        ResultsError: no such file, not HDF5, not a results file, or written by a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the file."""
        self.path = Path(path)
        self._file = _open(self.path)

    def __enter__(self) -> Self:
        """Return the reader."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def refresh(self) -> None:
        """Look at the file again, for a run that is still writing."""
        self._file.close()
        self._file = _open(self.path)

    @property
    def metadata(self) -> dict[str, Any]:
        """What the run was, as its writer said."""
        return _decode_json(self._file["metadata"])

    @property
    def summary(self) -> dict[str, Any]:
        """Closing facts of the run; empty while the status is "running"."""
        return _decode_json(self._file["summary"])

    @property
    def status(self) -> str:
        """The run's status; "running" also when it was killed."""
        return str(self._file["status"][0].decode())

    @property
    def complete(self) -> bool:
        """Whether the run reached its end."""
        return self.status == "complete"

    @property
    def created(self) -> str:
        """When the file was created, ISO 8601, UTC."""
        return str(self._file.attrs["created"])

    @property
    def statics(self) -> list[str]:
        """Names of the arrays written once."""
        return _dataset_names(self._file["static"])

    @property
    def streams(self) -> dict[str, list[str]]:
        """Names of the series of each stream, ``time`` left out."""
        groups = self._file["streams"]
        return {key: [n for n in _dataset_names(groups[key]) if n != "time"] for key in groups}

    @property
    def joints(self) -> list[str]:
        """Names of the joints of which points are stored."""
        names = (name.split("/") for name in self.statics)
        return [part[1] for part in names if part[0] == "joints" and part[2:] == ["points"]]

    @property
    def point_names(self) -> list[str]:
        """Names of the monitor points, from ``metadata["point_names"]`` or numbered."""
        if "point_names" in self.metadata:
            return [str(name) for name in self.metadata["point_names"]]
        return [f"point {i}" for i in range(len(self.static("histories/points")))]

    def point_index(self, point: int | str) -> int:
        """Row of a monitor point given by its name or number."""
        names = self.point_names
        if isinstance(point, str) and point in names:
            return names.index(point)
        if not isinstance(point, str) and 0 <= point < len(names):
            return int(point)
        raise ResultsError(f"No monitor point {point!r}; the file has {_listing(names)}.")

    def static(self, name: str) -> NDArray[Any]:
        """Return an array written once."""
        values: NDArray[Any] = self._static(name)[()]
        return values

    def time(self, stream: str) -> NDArray[np.float64]:
        """Times of the whole records of a stream, shape (rows,), [s]."""
        times: NDArray[np.float64] = self._stream(stream)["time"][: self.rows(stream)]
        return times

    def rows(self, stream: str) -> int:
        """Number of whole records of a stream: those that all its datasets and its time hold."""
        group = self._stream(stream)
        rows = min(len(group[name]) for name in _dataset_names(group))
        while rows and np.isnan(group["time"][rows - 1]):  # extended, but not yet filled
            rows -= 1
        return rows

    def series(self, stream: str, name: str, index: Index = slice(None)) -> NDArray[Any]:
        """Values of one quantity of a stream.

        Args:
            stream: name of the stream.
            name: name of the quantity.
            index: a record's number (negative from the end) or a slice of them; only these are
                read.

        Returns:
            Shape (rows, ...), or that of one record if ``index`` is a number.
        """
        dataset, rows = self._series(stream, name), self.rows(stream)
        if isinstance(index, slice):
            start, stop, step = index.indices(rows)
            if step < 1:
                raise ResultsError(f"A slice of records must go forward, got step {step}.")
            values: NDArray[Any] = dataset[start : max(start, stop) : step]
            return values
        if not -rows <= index < rows:
            raise ResultsError(f"The stream {stream!r} has {rows} records, got number {index}.")
        row: NDArray[Any] = np.asarray(dataset[index % rows])
        return row

    def nearest(self, stream: str, time: float) -> int:
        """Number of the record whose time is nearest to ``time`` [s]."""
        times = self.time(stream)
        if not times.size:
            raise ResultsError(f"The stream {stream!r} has no records.")
        return int(np.argmin(np.abs(times - time)))

    def unit(self, *where: str) -> str:
        """Unit of an array given by its name, or of a series given by stream and name."""
        return str(self._dataset(*where).attrs["unit"])

    def description(self, *where: str) -> str:
        """Description of an array given by its name, or of a series by stream and name."""
        return str(self._dataset(*where).attrs["description"])

    def _dataset(self, *where: str) -> h5py.Dataset:
        return self._static(*where) if len(where) == 1 else self._series(*where)

    def _static(self, name: str) -> h5py.Dataset:
        if name not in self.statics:
            raise ResultsError(
                f"No array {name!r} in {self.path}; it has {_listing(self.statics)}."
            )
        return self._file["static"][name]

    def _stream(self, stream: str) -> h5py.Group:
        if stream not in self._file["streams"]:
            raise ResultsError(
                f"No stream {stream!r} in {self.path}; it has {_listing(self._file['streams'])}."
            )
        return self._file["streams"][stream]

    def _series(self, stream: str, name: str) -> h5py.Dataset:
        group = self._stream(stream)
        if name not in _dataset_names(group):
            raise ResultsError(
                f"No series {name!r} in the stream {stream!r} of {self.path}; "
                f"it has {_listing(self.streams[stream])}."
            )
        return group[name]


def declare_histories(writer: ResultsWriter, points: ArrayLike) -> None:
    """Declare the stream ``histories``, one record per step.

    The names of the points belong in the metadata as ``point_names``.

    Args:
        writer: a writer not started yet.
        points: monitor points, shape (num_points, 3), [m].
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    writer.static("histories/points", points, "m", "monitor points")
    writer.series("histories", "displacement", points.shape, "m", "displacement of monitor points")
    for state in ("open", "stick", "slip"):
        text = f"share of the joint points that {state if state != 'open' else 'are open'}"
        writer.series("histories", f"joint_{state}", (), "-", text)
    text = "iterations of the step's solve"
    writer.series("histories", "iterations", (), "-", text, dtype=np.int64)


def declare_energy(writer: ResultsWriter) -> None:
    """Declare the stream ``energy``, one record per step, a number [J] per ledger line."""
    for term in ENERGY_TERMS:
        writer.series("energy", term, (), "J", f"{term} energy" if term != "error" else "residual")


def declare_states(
    writer: ResultsWriter,
    nodes: ArrayLike,
    surface: ArrayLike,
    joints: Mapping[str, Mapping[str, ArrayLike]],
) -> None:
    """Declare the stream ``states``, recorded at chosen times.

    Args:
        writer: a writer not started yet.
        nodes: shape (num_nodes, 3), [m]; the two sides of a joint have their own.
        surface: vertices of the boundary facets in cyclic order, shape (num_facets, 3 or 4); the
            sides of the joints belong to them.
        joints: by joint name, the arrays ``points`` (n, 3) [m], ``frames`` (n, 3, 3) with rows n,
            s1, s2, ``areas`` (n,) [m^2] and ``facet`` (n,), the facet number of each point.
    """
    nodes = np.asarray(nodes, dtype=np.float64)
    writer.static("mesh/nodes", nodes, "m", "nodes")
    writer.static("mesh/surface", surface, "-", "vertices of the boundary facets")
    writer.series("states", "displacement", nodes.shape, "m", "displacement of the nodes")
    for name, joint in joints.items():
        where = f"joints/{name}"
        writer.static(f"{where}/points", joint["points"], "m", "joint points")
        writer.static(f"{where}/frames", joint["frames"], "-", "local axes, rows n, s1, s2")
        writer.static(f"{where}/areas", joint["areas"], "m^2", "area of each point")
        writer.static(f"{where}/facet", joint["facet"], "-", "facet number of each point")
        shape = np.asarray(joint["points"]).shape
        writer.series("states", f"{where}/gap", shape, "m", "gap (n, s1, s2), open if n > 0")
        text = "traction (n, s1, s2), compression if n < 0"
        writer.series("states", f"{where}/traction", shape, "Pa", text)


def describe(path: str | Path) -> str:
    """Return a table of what a results file holds."""
    with Results(path) as results:
        lines = [f"{results.path}: {results.status}, created {results.created}"]
        lines += [f"  {key}: {value}" for key, value in results.metadata.items()]
        lines += [f"  {key}: {value}" for key, value in results.summary.items()]
        rows = [("static", name, results._static(name)) for name in results.statics]
        for stream, names in results.streams.items():
            times = results.time(stream)
            span = f", {times[0]:.6g} to {times[-1]:.6g} s" if times.size else ""
            lines.append(f"  stream {stream}: {times.size} records{span}")
            rows += [(stream, name, results._series(stream, name)) for name in names]
        width = max((len(name) for _, name, _ in rows), default=0)
        for group, name, dataset in rows:
            shape = dataset.shape if group == "static" else dataset.shape[1:]
            unit, text = dataset.attrs["unit"], dataset.attrs["description"]
            lines.append(f"  {group:<10} {name:<{width}} {shape!s:<16} {unit:<4} {text}")
    return "\n".join(lines)


def _create(group: h5py.Group, name: str, **options: Any) -> h5py.Dataset:
    try:
        return group.create_dataset(name, **options)
    except (OSError, ValueError) as error:
        raise ResultsError(f"{name!r} is declared already, or is the path of another.") from error


def _extendable(
    group: h5py.Group,
    name: str,
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    *,
    fill: float = 0.0,
) -> h5py.Dataset:
    if any(length < 0 for length in shape):
        raise ResultsError(f"The shape of {name!r} must have no negative length, got {shape}.")
    row_bytes = max(1, int(np.prod(shape)) * dtype.itemsize)
    chunks = (min(1024, max(1, _CHUNK_BYTES // row_bytes)), *(max(1, length) for length in shape))
    empty, unlimited = (0, *shape), (None, *shape)
    options = {"maxshape": unlimited, "chunks": chunks, "dtype": dtype, "fillvalue": fill}
    return _create(group, name, shape=empty, **options)


def _open(path: Path) -> h5py.File:
    if not path.is_file():
        raise ResultsError(f"There is no results file {path}.")
    if not h5py.is_hdf5(path):
        raise ResultsError(f"{path} is not an HDF5 file.")
    try:
        file = _open_shared(path)
    except OSError as error:
        raise ResultsError(
            f"{path} cannot be read; its run has not started yet or ended before it did ({error})."
        ) from error
    found, version = file.attrs.get("format"), file.attrs.get("version")
    whole = all(key in file for key in ("metadata", "status", "summary", "static", "streams"))
    if found == FORMAT and version is not None and version <= VERSION and whole:
        return file
    file.close()
    if found != FORMAT or version is None:
        raise ResultsError(f"{path} is HDF5 but not a file of {FORMAT!r}.")
    if version > VERSION:
        raise ResultsError(
            f"{path} has version {version} of the layout, this program reads up to {VERSION}."
        )
    raise ResultsError(f"{path} was left incomplete before its run started.")


def _open_shared(path: Path) -> h5py.File:
    try:
        return h5py.File(path, "r", libver="latest", swmr=True)
    except OSError:  # a file that was not written in SWMR mode
        return h5py.File(path, "r")


def _dataset_names(group: h5py.Group) -> list[str]:
    names: list[str] = []

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            names.append(name)

    group.visititems(visit)
    return names


def _listing(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _encode_json(values: Mapping[str, Any], what: str) -> NDArray[np.uint8]:
    try:
        text = json.dumps(dict(values), default=_plain, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise ResultsError(f"The {what} must be what JSON can hold: {error}.") from error
    return np.frombuffer(text.encode(), dtype=np.uint8)


def _decode_json(dataset: h5py.Dataset) -> dict[str, Any]:
    text = bytes(dataset[:]).rstrip(b"\0").decode()
    decoded: dict[str, Any] = json.loads(text) if text else {}
    return decoded


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} {value!r} is not JSON")
