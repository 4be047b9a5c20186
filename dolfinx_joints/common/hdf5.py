# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""HDF5 files that may be damaged, unfinished or of another program: an error, and never a wait.

A few wrong bytes were seen to let HDF5 read for ever. Files that are written at once therefore end
with a checksum, compared before HDF5 is asked; of others only those are opened whose metadata HDF5
itself checks.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dolfinx_joints.common.errors import JointsError

DIGEST_BYTES = 32
"""Length of the checksum that follows HDF5's part of a file, which does not mind."""

# Exceptions that reading a damaged or foreign file was seen to raise.
DAMAGE = (OSError, RuntimeError, LookupError, TypeError, AttributeError, ValueError, MemoryError)

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SUPERBLOCK = 36  # bytes up to the file's length
_GROWING_SECONDS = 1.0  # longer than a writer takes to lengthen a file
# HDF5 reads again what fails its checksum while a run writes, and waits for 1, 2, 4, ... ns in
# between: 0.1 s in all, where 100 attempts of its own would outlast the reader.
_ATTEMPTS = 26


class OldLayoutError(ValueError):
    """A file that is whole, but of a layout that is no longer read."""


@contextmanager
def damage_reported(
    path: Path, error: type[Exception], verdict: str = "is damaged"
) -> Iterator[None]:
    """Turn exceptions that reading a damaged file raises into one ``error``."""
    try:
        yield
    except JointsError:
        raise
    except OldLayoutError as old:
        raise error(
            f"{path} is of an older version of this program ({old}); run it again, or read it with "
            "the version that wrote it."
        ) from None
    except DAMAGE as raised:
        reason = " ".join(str(raised).split()) or type(raised).__name__
        raise error(f"{path} {verdict}: {reason[:300]}.") from raised


@contextmanager
def new_file(path: Path, size: int, **options: Any) -> Iterator[h5py.File]:
    """An HDF5 file to be written, replaced if it is there.

    HDF5 does not take a full disk well, so there must be room for ``size`` bytes before it begins.
    """
    with path.open("w+b") as disk:
        os.posix_fallocate(disk.fileno(), 0, max(size, 1))
        disk.truncate(0)  # it takes no other file for a new one
        with h5py.File(disk, "w", **options) as file:
            yield file


def set_texts(item: h5py.Dataset | h5py.Group, **texts: str) -> None:
    """Give a dataset or group attributes that `attribute` reads."""
    for name, text in texts.items():
        encoded = text.encode()
        kind = h5py.string_dtype("utf-8", max(len(encoded), 1))
        item.attrs.create(name, np.bytes_(encoded), dtype=kind)


def attribute(item: h5py.Dataset | h5py.Group, name: str) -> str | int | None:
    """A text or whole number among the attributes of a dataset or group; None without it.

    Texts of variable length are errors: they lie in a heap for which HDF5 has no checksum, and some
    wrong bytes in it are read for ever.
    """
    if name not in item.attrs:
        return None
    found = h5py.h5a.open(item.id, name.encode())
    kind, wrong = found.get_type(), found.shape != ()
    if isinstance(kind, h5py.h5t.TypeStringID) and not kind.is_variable_str() and not wrong:
        return bytes(item.attrs[name]).decode()
    if isinstance(kind, h5py.h5t.TypeIntegerID) and not wrong:
        return int(item.attrs[name])
    raise OldLayoutError(f"the attribute {name!r} is no text of fixed length and no whole number")


def check_version(version: str | int | None, read: int) -> None:
    """Compare the version of a layout with the one that is read."""
    if not isinstance(version, int) or version < read:
        raise OldLayoutError(f"version {version} of the layout, {read} is read")


def seal(path: Path) -> bytes:
    """Checksum to be written behind the content of a file."""
    return _checksum(path, path.stat().st_size)


def check_seal(path: Path) -> None:
    """Compare the checksum at the end of a file with its content; a ValueError if they differ."""
    size = path.stat().st_size - DIGEST_BYTES
    with path.open("rb") as file:
        file.seek(max(size, 0))
        if file.read() != _checksum(path, size):
            raise ValueError("its checksum is not that of its content")


def _checksum(path: Path, left: int) -> bytes:
    checksum = hashlib.sha256()
    with path.open("rb") as file:
        while left > 0 and (block := file.read(min(left, 1 << 20))):
            checksum.update(block)
            left -= len(block)
    return checksum.digest()


def open_growing(path: Path, error: type[Exception]) -> h5py.File:
    """Open a file for reading that a run may still write, or was killed while it did."""
    being_written = check_superblock(path, error)
    try:
        if not being_written:
            return h5py.File(path, "r")
        access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
        # h5py has no name for it; the GIL is kept, as h5py does while HDF5 is at work.
        limit = ctypes.PyDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        limit.argtypes = [ctypes.c_int64, ctypes.c_uint]
        limit(access.id, _ATTEMPTS)
        shared = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
        return h5py.File(h5py.h5f.open(os.fsencode(path), shared, fapl=access))
    except (OSError, RuntimeError) as failure:
        reason = " ".join(str(failure).split())[:300]
        raise error(
            f"{path} cannot be read; its run has not started yet or ended before it did ({reason})."
        ) from failure


def check_superblock(path: Path, error: type[Exception]) -> bool:
    """Whether a writer has, or had, the file open.

    A file that is shorter than its superblock says is an error; HDF5 finds that itself, but not
    while the file is being written, when it may be so for the moment in which it grows.
    """
    gives_up = clock.monotonic() + _GROWING_SECONDS
    while True:
        with path.open("rb") as file:
            superblock = file.read(_SUPERBLOCK)
            size = os.fstat(file.fileno()).st_size
        if not superblock.startswith(_SIGNATURE):
            raise error(f"{path} is not an HDF5 file.")
        version, being_written = superblock[8:9], any(superblock[11:12])
        if version not in (b"", b"\2", b"\3"):
            if path.suffix == ".vtkhdf":
                raise error(
                    f"{path} is a file for ParaView; results are in the .h5 file of ResultsMonitor."
                )
            raise error(
                f"{path} is HDF5 but not a file of this program, which writes version 3 of the "
                f"superblock, where all metadata have checksums; this is version {version[0]}."
            )
        whole, end = len(superblock) == _SUPERBLOCK, int.from_bytes(superblock[28:36], "little")
        if whole and size >= end:
            return being_written
        if not being_written or clock.monotonic() > gives_up:
            there = f" of {end}" if whole else ""
            raise error(f"{path} is truncated: it has {size}{there} bytes.")
        clock.sleep(0.01)
