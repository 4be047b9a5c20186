# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writer of results files, on one process and from plain arrays; `reader` describes the format."""

import json
import os
import time as clock
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from dolfinx_joints.common.arrays import Dealt
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.files import FileLock, released
from dolfinx_joints.common.hdf5 import set_texts
from dolfinx_joints.common.parameters import PLAIN_NAMES, check_kind_of, is_plain_name, shown
from dolfinx_joints.results.reader import FORMAT, VERSION, Results
from dolfinx_joints.results.stream import EXPECTED_ROWS, Room, Stream, new_dataset, write_whole

_Row = Mapping[str, ArrayLike | Dealt]
Status = Literal["running", "complete", "stopped", "failed"]

_SUMMARY_BYTES = 65536  # preallocated size of the summary, which cannot grow in SWMR mode


class ResultsWriter:
    """Writer of one results file from plain arrays, on one process.

    Use it as a context manager. Call :meth:`static` and :meth:`series` to declare, :meth:`start`,
    :meth:`append` during the run, and :meth:`finish`. If the block ends with an exception, the
    status is "failed"; if it ends without :meth:`finish`, the status is "stopped".

    Args:
        path: The file to write.
        metadata: Facts of the run: values that JSON can represent, NumPy scalars and arrays.
        overwrite: True to replace an existing file.
        aside: Path to which an existing file is moved; by default the file is deleted.
        rows: Expected number of records by stream (256), to which chunks of the file are fitted.
        flush_interval: Longest processor time of rows in memory [s]; checked at each new row.
    """

    def __init__(
        self,
        path: str | Path,
        metadata: Mapping[str, Any],
        *,
        overwrite: bool = False,
        aside: Path | None = None,
        rows: Mapping[str, int] | None = None,
        flush_interval: float = 1.0,
    ) -> None:
        self.path, self._expected = Path(path), dict(rows or {})
        encoded = _encode_json(metadata, "metadata")
        self._lock = FileLock(self.path, ResultsError)
        with released(self._lock, at_end=False):
            self._create(overwrite, aside)
            try:
                self._lay_out(encoded)
            except BaseException:
                self._file.close()
                self._room.close()
                self.path.unlink()
                raise
        self._streams: dict[str, Stream] = {}
        self._finished = False
        self._flush_interval = flush_interval
        self._flushed_at = clock.process_time()  # a busy machine must not write more often

    def _create(self, overwrite: bool, aside: Path | None) -> None:
        if self.path.exists() and not overwrite:
            raise ResultsError(f"{self.path} exists; pass overwrite=True to replace it.")
        try:
            if self.path.exists() and aside is not None:
                self.path.replace(aside)
            elif self.path.exists():
                self.path.unlink()  # not truncated: another process may be reading the old file
            # Disable the chunk cache, which would keep the last MB of each series in memory.
            self._file = h5py.File(self.path, "x", libver="latest", rdcc_nbytes=0)
            self._room = Room(self.path, self._file)
        except OSError as error:
            raise ResultsError(f"{self.path} cannot be created: {error}.") from error

    def _lay_out(self, encoded: NDArray[np.uint8]) -> None:
        self._room.reserve(self.path, encoded.nbytes + _SUMMARY_BYTES)
        self._file.attrs["version"] = VERSION
        created = datetime.now(UTC).isoformat(timespec="seconds")
        set_texts(self._file, format=FORMAT, created=created)
        self._file.create_dataset("metadata", data=encoded)
        self._file.create_dataset("status", data=np.array([b"running"], dtype="S16"))
        self._file.create_dataset("summary", data=np.zeros(_SUMMARY_BYTES, dtype=np.uint8))
        self._static = self._file.create_group("static")
        self._file.create_group("streams")

    @classmethod
    def resume(
        cls, path: str | Path, rows: Mapping[str, int], metadata: Mapping[str, Any] | None = None
    ) -> Self:
        """Continue the file of an interrupted run, with any status.

        HDF5 does not open the file of a killed run for writing. Therefore the file is copied, and
        the complete copy replaces it.

        Args:
            path: The file.
            rows: Number of records to keep of each stream; later records are dropped.
            metadata: New facts of the run; by default the facts in the file are kept.
        """
        path = Path(path)
        lock = FileLock(path, ResultsError)
        with released(lock, at_end=False):
            writer = cls._replace_by_copy(path, rows, metadata)
        writer._lock.release()
        writer.path, writer._lock = path, lock
        return writer

    @classmethod
    def _replace_by_copy(
        cls, path: Path, rows: Mapping[str, int], metadata: Mapping[str, Any] | None
    ) -> Self:
        """Replace the file by a copy, and return the writer of the copy."""
        part = path.with_name(path.name + ".part")
        with Results(path) as old:
            if old.layout != VERSION:
                raise ResultsError(
                    f"{path} cannot be continued: it has version {old.layout} of the layout, new "
                    f"records have version {VERSION}."
                )
            counts = {stream: old.rows(stream) for stream in old.streams}
            if counts.keys() != rows.keys() or any(counts[s] < rows[s] for s in rows):
                raise ResultsError(
                    f"{path} cannot be continued: it contains {_record_counts(counts)}, it must "
                    f"contain at least {_record_counts(rows)}."
                )
            writer = cls(part, metadata or old.metadata, overwrite=True)
            try:
                writer._copy(old, rows)
                part.replace(path)
            except (OSError, ResultsError) as error:
                writer.close()
                part.unlink(missing_ok=True)
                raise ResultsError(f"{path} cannot be copied: {error}") from error
        return writer

    def _copy(self, old: Results, rows: Mapping[str, int]) -> None:
        """Make the declarations of another file, and copy its first rows."""
        del self._file.attrs["created"]
        set_texts(self._file, created=old.created)
        with old.datasets() as (statics, streams):
            for name in old.statics:
                self._room.reserve(self.path, statics[name].nbytes)
                statics.file.copy(statics[name], self._file["static"], name)
            for stream, names in old.streams.items():
                self._expected[stream] = streams[stream]["time"].chunks[0]
                for name in names:
                    shape, dtype = streams[stream][name].shape[1:], streams[stream][name].dtype
                    texts = old.unit(stream, name), old.description(stream, name)
                    self.series(stream, name, shape, *texts, dtype=dtype)
            self.start()
            for stream, names in old.streams.items():
                times, new = old.time(stream)[: rows[stream]], self._streams[stream]
                self._room.reserve(self.path, len(times) * new.row_bytes + new.chunks)
                new.copy(times, {name: streams[stream][name] for name in names})
        self._file.flush()

    @property
    def records(self) -> dict[str, int]:
        """Number of records of each stream, in the file and in memory."""
        return {name: stream.records for name, stream in self._streams.items()}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> None:
        """Write the buffered rows and the status, and close the file."""
        try:
            if kind is not None and not self._finished:
                status: Status = "failed" if issubclass(kind, Exception) else "stopped"
                self.finish(status, {"error": f"{kind.__name__}: {error}"[:2000]})
        finally:
            self.close()

    def static(
        self,
        name: str,
        array: ArrayLike | Dealt,
        unit: str,
        description: str,
        *,
        dtype: DTypeLike = None,
    ) -> None:
        """Write an array once; ``name`` is its path below ``static``."""
        values = array if isinstance(array, Dealt) else np.asarray(array)
        kind = values.dtype if dtype is None else dtype
        write_whole(self._new_dataset(name, values.shape, kind, unit, description), values)

    def static_rows(
        self, name: str, rows: Sequence[NDArray[Any] | Dealt], unit: str, description: str
    ) -> None:
        """Write an array once, given as a sequence of at least one row."""
        shape = (len(rows), *rows[0].shape)
        dataset = self._new_dataset(name, shape, rows[0].dtype, unit, description)
        for number, row in enumerate(rows):
            write_whole(dataset, row, number)

    def _new_dataset(
        self, name: str, shape: tuple[int, ...], dtype: DTypeLike, unit: str, description: str
    ) -> h5py.Dataset:
        """Create the dataset of an array that is written once."""
        self._check_declaration(name)
        self._room.reserve(self.path, int(np.prod(shape)) * np.dtype(dtype).itemsize)
        dataset = new_dataset(self._static, name, dtype, h5py.h5s.create_simple(shape))
        set_texts(dataset, unit=unit, description=description)
        return dataset

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
        """Declare a quantity of a stream: one array per record.

        Args:
            stream: Group of quantities recorded at the same times; created at its first use.
            name: Path below the stream, for example ``"joints/joint_1/gap"``.
            shape: Shape of one record; ``()`` for a number.
            unit: For example ``"m"``; ``"-"`` without a unit.
            description: One line that explains the quantity.
            dtype: Type of the stored numbers.
        """
        self._check_declaration(name)
        if stream not in self._streams:
            rows = self._expected.get(stream, EXPECTED_ROWS)
            self._streams[stream] = Stream(self._file["streams"], stream, rows)
        self._streams[stream].declare(name, tuple(shape), np.dtype(dtype), unit, description)

    def start(self) -> None:
        """End the declarations; from now on other processes can read the file while it grows."""
        self._room.reserve(self.path, 0)
        self._file.flush()
        self._file.swmr_mode = True

    def append(self, stream: str, time: float, values: _Row, *, flush: bool = True) -> None:
        """Add one record to a stream; readers see it after the next flush.

        Args:
            stream: Name of the stream.
            time: Time of the record [s], later than the previous one.
            values: Values by name; they are copied. Distributed arrays are written immediately.
            flush: Flush all streams if rows have been in memory for the flush interval.
        """
        self._streams[stream].append(float(time), values)
        if not self._streams[stream].room:
            self._write_values([self._streams[stream]])
        if flush and self.due:
            self.flush()

    def extend(self, times: Sequence[float], values: Mapping[str, Mapping[str, Any]]) -> None:
        """Add records of the same times: ``values`` are arrays by stream and name, (times, ...).

        Readers see them after the next flush.
        """
        for stream, rows in values.items():
            if self._streams[stream].room < len(times):
                self._write_values([self._streams[stream]])
            self._streams[stream].extend(times, rows)

    @property
    def due(self) -> bool:
        """True if rows have been in memory for the flush interval."""
        return clock.process_time() - self._flushed_at >= self._flush_interval

    def flush(self) -> None:
        """Write all rows to the file; readers see the same records of all streams."""
        self._flushed_at = clock.process_time()
        self._write_values(self._streams.values())
        complete = [stream for stream in self._streams.values() if stream.written]
        if not complete:
            return
        self._file.flush()
        for stream in complete:
            stream.write_times()
        self._file.flush()

    def to_disk(self) -> None:
        """Write all appended rows to the file, and wait until they are on the disk."""
        self.flush()
        with self.path.open("rb") as file:
            os.fsync(file.fileno())

    def finish(self, status: Status, summary: Mapping[str, Any]) -> None:
        """Write the buffered rows, then the summary, then the status."""
        encoded = _encode_json(summary, "summary")
        if encoded.size > _SUMMARY_BYTES:
            raise ResultsError(
                f"The summary must have at most {_SUMMARY_BYTES} bytes as JSON, got {encoded.size}."
            )
        self._finished = True
        self.flush()
        self._file["summary"][: encoded.size] = encoded
        self._file.flush()
        self._file["status"][0] = status.encode()
        self._file.flush()

    def close(self) -> None:
        """Close the file; without a call of `finish` the status becomes "stopped"."""
        if not self._file:
            return
        with ExitStack() as cleanup:
            cleanup.callback(self._lock.release)
            cleanup.callback(self._room.close)
            cleanup.callback(self._file.close)
            if not self._finished:
                self.finish("stopped", {})

    def _write_values(self, streams: Iterable[Stream]) -> None:
        """Write the values of all rows, without their times, which make them visible."""
        waiting = [stream for stream in streams if stream.waiting]
        if not waiting:
            return
        try:
            self._room.reserve(self.path, sum(stream.growth for stream in waiting))
        except ResultsError:
            for stream in waiting:
                stream.drop()
            raise
        for stream in waiting:
            stream.write_values()

    def _check_declaration(self, name: str) -> None:
        if not all(map(is_plain_name, name.split("/"))):
            raise ResultsError(f"Names must be {PLAIN_NAMES}, '/' between parts, got {name!r}.")


def _record_counts(rows: Mapping[str, int]) -> str:
    return ", ".join(f"{n} records of {name!r}" for name, n in rows.items()) or "nothing"


def check_storable(name: str, value: Any) -> None:
    """Raise an error if JSON cannot represent the facts of a run."""
    check_kind_of(name, value, isinstance(value, Mapping), "values by name")
    _encode_json(value, name)


def _encode_json(values: Mapping[str, Any], name: str) -> NDArray[np.uint8]:
    try:
        text = json.dumps(dict(values), default=_json_value, ensure_ascii=False)
    except (TypeError, ValueError, RecursionError) as error:
        reason = shown(error, str)
        raise ResultsError(f"JSON cannot represent the {name}: {reason}.") from error
    # File names from the command line may not be valid UTF-8.
    return np.frombuffer(text.encode(errors="replace"), dtype=np.uint8)


def _json_value(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} {shown(value)} is not JSON")


def contains_only_statics(path: Path) -> bool:
    """Return True if the file exists and contains only static stages."""
    try:
        with Results(path) as results:
            return list(results.streams) == ["statics"]
    except ResultsError:
        return False
