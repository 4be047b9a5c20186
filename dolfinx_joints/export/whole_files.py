# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Changes of HDF5 files that are made whole or not at all, also where the process is killed.

HDF5 changes a file in many places one after the other, so a process that is killed between them
leaves a file that cannot be read. Here new bytes go behind the end of the file, where nothing
refers to them yet; the few kilobytes inside it wait in memory, and are kept in ``NAME.redo``
before they are made, so that `finished` makes them after a kill.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from dolfinx_joints.common.files import replacing
from dolfinx_joints.common.hdf5 import new_file

Piece = tuple[int, bytes | memoryview]  # place in the file [bytes], what is written there


@contextmanager
def begun(path: Path, size: int) -> Iterator[h5py.File]:
    """An HDF5 file of so many bytes, to be written whole or not at all."""
    with replacing(path) as part, new_file(part, size) as file:
        yield file


@contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to be changed, once the block ends without an error.

    Raises:
        OSError: The disk is full; the file is as it was.
    """
    with path.open("r+b", buffering=0) as disk:
        waiting = _Waiting(disk)
        try:
            with h5py.File(waiting, "r+") as file:
                yield file
            if waiting.refused is not None:
                raise waiting.refused
        except Exception:
            disk.truncate(waiting.before)
            raise
        _make(path, disk, waiting)


def finished(path: Path) -> None:
    """Make what a killed process had begun to change."""
    redo = _redo(path)
    if redo.exists():
        with path.open("r+b", buffering=0) as disk, np.load(redo) as kept:
            content, ends = kept["content"].tobytes(), np.cumsum(kept["lengths"])
            begins = ends - kept["lengths"]
            pieces = [
                (int(place), content[begin:end])
                for place, begin, end in zip(kept["places"], begins, ends, strict=True)
            ]
            _write(disk, pieces)
            disk.truncate(int(kept["size"]))
        redo.unlink()


def forgotten(path: Path) -> None:
    """Remove what a killed process had begun, as its file is replaced."""
    _redo(path).unlink(missing_ok=True)


def _redo(path: Path) -> Path:
    return path.with_name(f"{path.name}.redo")


def _make(path: Path, disk: io.FileIO, waiting: _Waiting) -> None:
    """Write what waits, in HDF5's order."""
    before, size, inside = waiting.before, waiting.size, waiting.pieces
    try:
        if size > before:
            os.posix_fallocate(disk.fileno(), before, size - before)
        kept = io.BytesIO()
        np.savez(
            kept,
            size=size,
            places=np.array([place for place, _ in inside], dtype=np.int64),
            lengths=np.array([len(content) for _, content in inside], dtype=np.int64),
            content=np.frombuffer(b"".join(content for _, content in inside), dtype=np.uint8),
        )
        with replacing(_redo(path)) as part:
            part.write_bytes(kept.getvalue())
    except OSError:
        disk.truncate(before)
        raise
    _write(disk, inside)
    disk.truncate(size)
    forgotten(path)


def _write(disk: io.FileIO, pieces: list[Piece]) -> None:
    for place, content in pieces:
        rest = memoryview(content)
        while rest:
            count = os.pwrite(disk.fileno(), rest, place)
            place, rest = place + count, rest[count:]


class _Waiting:
    """A file as HDF5 sees it, whose changes inside wait in memory.

    Attributes:
        before: Size of the file before the changes [bytes].
        size: Size with them [bytes].
        pieces: The changes inside, the earliest first.
        refused: What kept the disk from taking more; HDF5 itself must not see an error.
    """

    def __init__(self, disk: io.FileIO) -> None:
        self._disk, self._place = disk, 0
        self.before = self.size = os.fstat(disk.fileno()).st_size
        self.pieces: list[Piece] = []
        self.refused: BaseException | None = None

    def read(self, size: int = -1) -> bytes:
        """Return what follows; h5py knows a file by this method."""
        found = bytearray(size if size >= 0 else self.size - self._place)
        return bytes(found[: self.readinto(found)])

    def readinto(self, buffer: bytearray | memoryview) -> int:
        """Read what the disk has and what was changed there."""
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
        """Let a change wait, or write it behind the end."""
        count = memoryview(content).nbytes
        if self._place < self.before or not self._written(content):
            self.pieces.append((self._place, bytes(content)))
        self._place += count
        self.size = max(self.size, self._place)
        return count

    def _written(self, content: bytes | memoryview) -> bool:
        """Write behind the end, unless the disk is full or the run was interrupted."""
        if self.refused is None:
            try:
                _write(self._disk, [(self._place, content)])
            except BaseException as error:
                self.refused = error
        return self.refused is None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + (0, self._place, self.size)[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def truncate(self, size: int) -> int:
        self.size = size
        return size

    def flush(self) -> None:
        """Do nothing: changes are made at once."""
