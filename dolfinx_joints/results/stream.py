# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Streams of a results file: quantities recorded at the same times, with a buffer of rows.

HDF5 cannot recover from a failed write: it treats the file as truncated and cannot close it.
Therefore disk space is reserved before HDF5 writes.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from dolfinx_joints.common.arrays import Dealt, Floats, blocks_in
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.common.hdf5 import set_texts
from dolfinx_joints.results.reader import listing

_METADATA_BYTES = 1 << 20  # upper bound of HDF5's own data between two flushes


class Room:
    """Disk space reserved after the end of an HDF5 file that is being written."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        """Open the file a second time, without reserving space."""
        self._file = file
        self._handle = os.open(path, os.O_RDWR)

    def reserve(self, path: Path, nbytes: int) -> None:
        """Reserve space for ``nbytes`` bytes of values and for the data that HDF5 adds."""
        size = os.fstat(self._handle).st_size
        end = self._file.id.get_filesize() + nbytes + _METADATA_BYTES
        if end <= size:
            return
        try:
            os.posix_fallocate(self._handle, size, end - size)
        except OSError as error:
            raise ResultsError(
                f"{path} cannot grow by {nbytes / 1e6:.3g} MB: {error.strerror}. The records "
                "written so far are complete."
            ) from error

    def close(self) -> None:
        """Release the unused space; call this after HDF5 has closed the file."""
        os.lseek(self._handle, 0, os.SEEK_SET)
        superblock = os.read(self._handle, 36)
        end = int.from_bytes(superblock[28:36], "little")
        if superblock[8:9] in (b"\2", b"\3") and end < os.fstat(self._handle).st_size:
            os.ftruncate(self._handle, end)
        os.close(self._handle)


_CHUNK_BYTES = 65536
EXPECTED_ROWS = 256  # expected number of rows if none is given
_BUFFER_ROWS, _BUFFER_BYTES = 1024, 1 << 24
_PLAIN = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
_PLAIN.set_obj_track_times(False)
_LINKS = h5py.h5p.create(h5py.h5p.LINK_CREATE)
_LINKS.set_create_intermediate_group(True)


class Stream:
    """Datasets of one stream, and the buffer of rows not written yet.

    Attributes:
        name: Name of the stream.
        waiting: Number of rows in the buffer.
        written: Times of rows whose values are in the file, but not their times.
        row_bytes: Size of one record with its time.
        chunks: Size of one chunk of all datasets together [bytes].
    """

    def __init__(self, parent: h5py.Group, name: str, rows: int) -> None:
        """Create the stream for an expected number of ``rows``; more are possible."""
        self.name, self.waiting, self._expected = name, 0, max(1, rows)
        self._last = -np.inf
        self._group = parent.create_group(name)
        self._datasets: dict[str, h5py.Dataset] = {}
        self._shapes: dict[str, tuple[int, ...]] = {}  # of one record
        # Buffers by name, shape (capacity, ...), or the row itself if it is distributed (`Dealt`).
        self._rows: dict[str, Any] = {}
        self._times: list[float] = []
        self.written: list[float] = []
        self._capacity = 0
        self._time = self._extendable("time", (), np.dtype(np.float64), np.nan)
        unit, text = (
            ("-", "number of the stage, from 1")
            if name == "statics"
            else ("s", "time of each record")
        )
        set_texts(self._time, unit=unit, description=text)
        self.row_bytes, self.chunks = 8, 8 * math.prod(self._time.chunks)

    @property
    def room(self) -> int:
        """Number of rows that the buffer can still take."""
        return self._capacity - self.waiting

    def declare(
        self, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], unit: str, text: str
    ) -> None:
        """Create the dataset of a quantity; ``shape`` is the shape of one record."""
        dataset = self._extendable(name, shape, dtype)
        set_texts(dataset, unit=unit, description=text)
        self._datasets[name], self._shapes[name] = dataset, shape
        self.row_bytes += math.prod(shape) * dtype.itemsize
        self.chunks += math.prod(dataset.chunks) * dtype.itemsize

    def _extendable(
        self, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], fill: float = 0.0
    ) -> h5py.Dataset:
        """Create an empty dataset that can grow; ``shape`` is the shape of one row.

        The expected rows fill chunks of equal size, at most 64 kB and 1024 rows each.
        """
        row_bytes = max(1, math.prod(shape) * dtype.itemsize)
        largest = min(1024, max(1, _CHUNK_BYTES // row_bytes))
        rows = -(-self._expected // -(-self._expected // largest))
        # Do not fill large chunks: HDF5 would keep a filled chunk in memory.
        large = row_bytes > _CHUNK_BYTES
        layout = _PLAIN.copy()
        layout.set_chunk((rows, *(max(1, length) for length in shape)))
        layout.set_fill_value(np.array(fill, dtype))
        layout.set_fill_time(h5py.h5d.FILL_TIME_NEVER if large else h5py.h5d.FILL_TIME_IFSET)
        space = h5py.h5s.create_simple((0, *shape), (h5py.h5s.UNLIMITED, *shape))
        return new_dataset(self._group, name, dtype, space, layout)

    def append(self, time: float, values: Mapping[str, Any]) -> None:
        """Add a row to the buffer; see `ResultsWriter.append`."""
        self._check([time], values)
        self._allocate(1, values)
        for name, value in values.items():
            if isinstance(value, Dealt):
                self._rows[name] = value
            else:
                self._rows[name][self.waiting] = value
        self._times.append(time)
        self.waiting += 1

    def extend(self, times: Sequence[float], values: Mapping[str, NDArray[Any]]) -> None:
        """Add rows to the buffer; see `ResultsWriter.extend`."""
        self._check(times, values, len(times))
        self._allocate(len(times), values)
        rows = slice(self.waiting, self.waiting + len(times))
        for name, value in values.items():
            self._rows[name][rows] = value
        self._times += times
        self.waiting += len(times)

    def _check(self, times: Sequence[float], values: Mapping[str, Any], *rows: int) -> None:
        """Check new times, and names and shapes of values with ``rows`` as leading axis."""
        for last, time in itertools.pairwise((self._last, *times)):
            if not (math.isfinite(time) and time > last):
                raise ResultsError(
                    f"Times of the stream {self.name!r} must be finite and increase, got {time} s "
                    f"after {last} s."
                )
        if values.keys() != self._datasets.keys():
            raise ResultsError(
                f"A record of the stream {self.name!r} must contain {listing(self._datasets)}, "
                f"got {listing(values)}."
            )
        for name, shape in self._shapes.items():
            value = values[name]
            given = value.shape if isinstance(value, np.ndarray) else np.shape(value)
            if given != (*rows, *shape):
                raise ResultsError(
                    f"{self.name}/{name} was declared with shape {shape}, got {given[len(rows) :]}."
                )
        self._last = times[-1]

    def _allocate(self, count: int, first: Mapping[str, Any]) -> None:
        """Allocate buffers for ``count`` rows or more, unless they exist or rows are in them.

        The capacity is one record if the ``first`` record has distributed arrays (`Dealt`). The
        operating system assigns memory when rows are filled.
        """
        if self._capacity >= count:
            return
        dealt = {name for name, value in first.items() if isinstance(value, Dealt)}
        capacity = 1 if dealt else min(_BUFFER_ROWS, _BUFFER_BYTES // self.row_bytes)
        self._capacity = max(count, capacity)
        for name, dataset in self._datasets.items():
            if name not in dealt:
                self._rows[name] = np.empty((self._capacity, *self._shapes[name]), dataset.dtype)

    @property
    def growth(self) -> int:
        """Upper bound of the bytes that the buffered rows add to the file, in whole chunks."""
        return self.waiting * self.row_bytes + self.chunks

    def drop(self) -> None:
        """Discard the buffered rows."""
        self._times = []
        self.waiting = 0

    @property
    def records(self) -> int:
        """Number of rows in the file and in the buffer."""
        return len(self._time) + len(self.written) + self.waiting

    def copy(self, times: Floats, values: Mapping[str, h5py.Dataset]) -> None:
        """Copy the first rows of datasets of another file, at most about 16 MB at once."""
        for name, dataset in self._datasets.items():
            dataset.resize(len(times), axis=0)
            copy_rows(values[name], dataset, len(times))
        add_rows(self._time, times)
        self._last = float(times[-1]) if len(times) else self._last

    def write_values(self) -> None:
        """Write the buffered values; their times are written later."""
        times, waiting = self._times, self.waiting
        self.drop()  # a failed write must not be repeated when the file is closed
        for name, dataset in self._datasets.items():
            rows = self._rows[name]
            if isinstance(rows, Dealt):
                _add_dealt(dataset, rows)
            else:
                add_rows(dataset, rows[:waiting])
        self.written += times

    def write_times(self) -> None:
        """Write the times of rows whose values are in the file."""
        times, self.written = self.written, []
        add_rows(self._time, times)


def new_dataset(
    group: h5py.Group, name: str, dtype: DTypeLike, space: h5py.h5s.SpaceID, layout: Any = _PLAIN
) -> h5py.Dataset:
    """Create a dataset; the low-level interface of h5py takes half the time of `create_dataset`."""
    kind = h5py.h5t.py_create(np.dtype(dtype), logical=True)
    return h5py.Dataset(h5py.h5d.create(group.id, name.encode(), kind, space, layout, _LINKS))


def add_rows(dataset: h5py.Dataset, rows: NDArray[Any] | Sequence[float]) -> None:
    """Append rows to a dataset; h5py's low-level interface is twice as fast."""
    values = np.ascontiguousarray(rows, dtype=dataset.id.dtype)
    start = dataset.id.shape[0]
    dataset.id.set_extent((start + len(values), *values.shape[1:]))
    _write(dataset, (start, *(0 for _ in values.shape[1:])), values)


def _add_dealt(dataset: h5py.Dataset, row: Dealt) -> None:
    """Append one row to a dataset, block by block."""
    start, first = dataset.id.shape[0], 0
    dataset.id.set_extent((start + 1, *row.shape))
    for block in row:
        _write(dataset, (start, first, *(0 for _ in row.shape[1:])), block[None])
        first += len(block)


def _write(dataset: h5py.Dataset, start: tuple[int, ...], values: NDArray[Any]) -> None:
    if not values.size:
        return
    place = dataset.id.get_space()
    place.select_hyperslab(start, values.shape)
    dataset.id.write(h5py.h5s.create_simple(values.shape), place, values)


def write_whole(dataset: h5py.Dataset, values: NDArray[Any] | Dealt, *row: int) -> None:
    """Write an array to a whole dataset, or to one row of a dataset."""
    if not np.shape(values):
        dataset[()] = values
        return
    first = 0
    for block in blocks_in(values):
        start = (*row, first, *(0 for _ in block.shape[1:]))
        _write(dataset, start, np.ascontiguousarray(block)[(None,) * len(row)])
        first += len(block)


def copy_rows(source: h5py.Dataset, target: h5py.Dataset, count: int) -> None:
    """Copy the first rows of a dataset into another, at most ``_BUFFER_BYTES`` at a time."""
    row_bytes = max(1, math.prod(source.shape[1:]) * source.dtype.itemsize)
    batch, parts = max(1, _BUFFER_BYTES // row_bytes), -(-row_bytes // _BUFFER_BYTES)
    ends = np.linspace(0, source.shape[1] if source.ndim > 1 else 0, parts + 1).astype(int)
    for first in range(0, count, batch):
        rows = slice(first, min(first + batch, count))
        if parts == 1:
            target[rows] = source[rows]
        else:
            for start, stop in itertools.pairwise(ends):
                target[rows, start:stop] = source[rows, start:stop]
