# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Atomic changes of HDF5 files: complete or absent, even if the process is killed.

HDF5 changes a file at many places in turn, so a kill in between leaves an unreadable file. Here
new bytes are written after the end of the file, to which nothing refers yet. The changes of
existing bytes, a few kilobytes, are buffered in memory. They are saved in ``NAME.redo`` before they
are written, so that `repair` can repeat them after a kill.
"""

from __future__ import annotations

import io
import os
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dolfinx_joints.common.files import replacing

Piece = tuple[int, bytes | memoryview]  # position in the file [bytes], content


class ChangingFile:
    """Existing HDF5 file that stays open between changes; opening takes longer than a change."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._opened: tuple[io.FileIO, _BufferedFile, h5py.File, Callable[[], Any]] | None = None
        self._datasets: dict[str, h5py.Dataset] = {}

    @contextmanager
    def changes(self) -> Iterator[h5py.File]:
        """Return the file for changes, which are applied if the block ends without an error.

        Raises:
            OSError: The disk is full; the file is unchanged.
        """
        if self._opened is None:
            disk = self._path.open("r+b", buffering=0)
            buffered = _BufferedFile(disk)
            # HDF5 must not keep chunks in memory, because it would do so for each dataset.
            file = h5py.File(buffered, "r+", rdcc_nbytes=0)
            # Close the file before the interpreter ends; HDF5 would crash if it did so later.
            self._opened = disk, buffered, file, weakref.finalize(self, file.close)
        disk, buffered, file, _ = self._opened
        size: int | None = buffered.before
        try:
            yield file
            file.flush()
            if buffered.error is not None:
                raise buffered.error
            size = None
            _apply(self._path, disk, buffered)
        except BaseException as error:
            # Drop the changes that HDF5 has in memory.
            self.close(size if isinstance(error, Exception) else None)
            raise

    def dataset(self, name: str) -> Any:
        """Return a dataset of the open file, None if it does not exist."""
        assert self._opened is not None
        if name not in self._datasets and (dataset := self._opened[2].get(name)) is not None:
            self._datasets[name] = dataset  # HDF5 takes longer to find a dataset than to write it
        return self._datasets.get(name)

    def close(self, size: int | None = None) -> None:
        """Close the file, cut to ``size`` bytes if given; the next change opens it again."""
        if self._opened is not None:
            (disk, _, _, close), self._opened = self._opened, None
            self._datasets.clear()
            with disk:
                close()
                if size is not None:
                    disk.truncate(size)


def repair(path: Path) -> None:
    """Repeat the changes that a killed process had begun to apply."""
    redo = _redo(path)
    if redo.exists():
        with path.open("r+b", buffering=0) as disk, np.load(redo) as saved:
            content, ends = saved["content"].tobytes(), np.cumsum(saved["lengths"])
            begins = ends - saved["lengths"]
            pieces = [
                (int(place), content[begin:end])
                for place, begin, end in zip(saved["places"], begins, ends, strict=True)
            ]
            _write(disk, pieces)
            disk.truncate(int(saved["size"]))
        redo.unlink()


def discard_redo(path: Path) -> None:
    """Delete the saved changes of a file, if there are any."""
    _redo(path).unlink(missing_ok=True)


def _redo(path: Path) -> Path:
    return path.with_name(f"{path.name}.redo")


def _apply(path: Path, disk: io.FileIO, buffered: _BufferedFile) -> None:
    """Write the buffered changes to the disk, in the order in which HDF5 made them."""
    before, size, changes = buffered.before, buffered.size, buffered.pieces
    try:
        if size > before:
            os.posix_fallocate(disk.fileno(), before, size - before)
        saved = io.BytesIO()
        np.savez(
            saved,
            size=size,
            places=np.array([place for place, _ in changes], dtype=np.int64),
            lengths=np.array([len(content) for _, content in changes], dtype=np.int64),
            content=np.frombuffer(b"".join(content for _, content in changes), dtype=np.uint8),
        )
        with replacing(_redo(path)) as part:
            part.write_bytes(saved.getvalue())
    except OSError:
        disk.truncate(before)
        raise
    _write(disk, changes)
    disk.truncate(size)
    discard_redo(path)
    buffered.before, buffered.pieces = size, []


def _write(disk: io.FileIO, pieces: list[Piece]) -> None:
    for place, content in pieces:
        remaining = memoryview(content)
        while remaining:
            count = os.pwrite(disk.fileno(), remaining, place)
            place, remaining = place + count, remaining[count:]


class _BufferedFile:
    """File object for HDF5 that buffers the changes of existing bytes in memory.

    Attributes:
        before: Size of the file before the changes [bytes].
        size: Size of the file with the changes [bytes].
        pieces: Changes of existing bytes, the earliest first.
        error: First error of a write to the disk; stored, because exceptions must not reach HDF5.
    """

    def __init__(self, disk: io.FileIO) -> None:
        self._disk, self._place = disk, 0
        self.before = self.size = os.fstat(disk.fileno()).st_size
        self.pieces: list[Piece] = []
        self.error: BaseException | None = None

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes; h5py recognises a file object by this method."""
        content = bytearray(size if size >= 0 else self.size - self._place)
        return bytes(content[: self.readinto(content)])

    def readinto(self, buffer: bytearray | memoryview) -> int:
        """Read from the disk, with the buffered changes."""
        target = memoryview(buffer).cast("B")
        begin, end = self._place, self._place + len(target)
        target[:] = os.pread(self._disk.fileno(), len(target), begin).ljust(len(target), b"\0")
        for place, content in self.pieces:
            first, last = max(begin, place), min(end, place + len(content))
            if first < last:
                target[first - begin : last - begin] = content[first - place : last - place]
        self._place = end
        return len(target)

    def write(self, content: bytes | memoryview) -> int:
        """Buffer a change of existing bytes, or append new bytes to the disk."""
        count = memoryview(content).nbytes
        if self._place < self.before or not self._append(content):
            self.pieces.append((self._place, bytes(content)))
        self._place += count
        self.size = max(self.size, self._place)
        return count

    def _append(self, content: bytes | memoryview) -> bool:
        """Append new bytes to the disk; return False after an error or an interrupt."""
        if self.error is None:
            try:
                _write(self._disk, [(self._place, content)])
            except BaseException as error:
                self.error = error
        return self.error is None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + (0, self._place, self.size)[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def truncate(self, size: int) -> int:
        self.size = size
        return size

    def flush(self) -> None:
        """Do nothing: `changing` applies the changes."""
