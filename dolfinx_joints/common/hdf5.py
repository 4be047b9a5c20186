# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Safe reading of HDF5 files that are damaged, unfinished or of another program.

A few wrong bytes can make HDF5 read forever. Files that are written at once therefore end with a
checksum, which is compared before HDF5 opens the file. Other files are opened only if HDF5 itself
checks their metadata.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dolfinx_joints.common.errors import JointsError

DIGEST_BYTES = 32
"""Length of the checksum at the end of a file; HDF5 ignores it."""

# Exceptions that occurred in reading damaged or foreign files.
DAMAGE = (OSError, RuntimeError, LookupError, TypeError, AttributeError, ValueError, MemoryError)

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SCALAR = h5py.h5s.create(h5py.h5s.SCALAR)
_SUPERBLOCK = 36  # bytes up to and including the file's length
_GROWING_SECONDS = 1.0  # longer than a writer needs to extend a file
# While a run writes, HDF5 rereads metadata with a wrong checksum after 1, 2, 4, ... ns: 0.1 s in
# all. HDF5's default of 100 attempts would take forever.
_ATTEMPTS = 26


class OldLayoutError(ValueError):
    """Error for a complete file whose layout is no longer supported."""


@contextmanager
def damage_reported(
    path: Path, error: type[Exception], verdict: str = "is damaged"
) -> Iterator[None]:
    """Convert exceptions from reading a damaged file to one ``error``."""
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
    """Create an HDF5 file for writing, replacing an existing one.

    HDF5 handles a full disk badly, so fail at once unless ``size`` bytes are free.
    """
    with path.open("w+b") as disk:
        os.posix_fallocate(disk.fileno(), 0, max(size, 1))
        disk.truncate(0)  # HDF5 creates a file only if it is empty
        with h5py.File(disk, "w", **options) as file:
            yield file


def set_texts(item: h5py.Dataset | h5py.Group, **texts: str) -> None:
    """Create text attributes of a dataset or group, readable by `attribute`."""
    for name, text in texts.items():
        encoded = np.array(text.encode())
        kind = _text_type(encoded.itemsize)
        # The low-level interface of h5py takes a third of the time of `attrs.create`.
        h5py.h5a.create(item.id, name.encode(), kind, _SCALAR).write(encoded, kind)


@lru_cache
def _text_type(length: int) -> h5py.h5t.TypeID:
    return h5py.h5t.py_create(h5py.string_dtype("utf-8", length), logical=True)


def attribute(item: h5py.Dataset | h5py.Group, name: str) -> str | int | None:
    """Return a text or integer attribute of a dataset or group, None if it does not exist.

    Texts of variable length raise an error: HDF5 stores them in a heap without checksum, and wrong
    bytes there can make it read forever.
    """
    if name not in item.attrs:
        return None
    stored = h5py.h5a.open(item.id, name.encode())
    kind, wrong = stored.get_type(), stored.shape != ()
    if isinstance(kind, h5py.h5t.TypeStringID) and not kind.is_variable_str() and not wrong:
        return bytes(item.attrs[name]).decode()
    if isinstance(kind, h5py.h5t.TypeIntegerID) and not wrong:
        return int(item.attrs[name])
    raise OldLayoutError(f"the attribute {name!r} is neither a text of fixed length nor an integer")


def check_version(version: str | int | None, read: int) -> None:
    """Raise an OldLayoutError if a layout is older than the version ``read``."""
    if not isinstance(version, int) or version < read:
        raise OldLayoutError(f"version {version} of the layout, {read} is needed")


def seal(path: Path) -> bytes:
    """Return the checksum to be appended to a file."""
    return _checksum(path, path.stat().st_size)


def check_seal(path: Path) -> None:
    """Raise a ValueError if the checksum at the end of a file does not match its content."""
    size = path.stat().st_size - DIGEST_BYTES
    with path.open("rb") as file:
        file.seek(max(size, 0))
        if file.read() != _checksum(path, size):
            raise ValueError("its checksum does not match its content")


def _checksum(path: Path, remaining: int) -> bytes:
    checksum = hashlib.sha256()
    with path.open("rb") as file:
        while remaining > 0 and (block := file.read(min(remaining, 1 << 20))):
            checksum.update(block)
            remaining -= len(block)
    return checksum.digest()


def open_growing(path: Path, error: type[Exception]) -> h5py.File:
    """Open a file for reading while a run writes it, or after the run was killed."""
    being_written = check_superblock(path, error)
    try:
        if not being_written:
            return h5py.File(path, "r")
        access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
        # h5py does not wrap this function. PyDLL keeps the GIL, as h5py does for HDF5 calls.
        limit = ctypes.PyDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        limit.argtypes = [ctypes.c_int64, ctypes.c_uint]
        limit(access.id, _ATTEMPTS)
        shared = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
        return h5py.File(h5py.h5f.open(os.fsencode(path), shared, fapl=access))
    except (OSError, RuntimeError) as failure:
        reason = " ".join(str(failure).split())[:300]
        raise error(
            f"{path} cannot be read: its run did not start, or ended before writing it ({reason})."
        ) from failure


def check_superblock(path: Path, error: type[Exception]) -> bool:
    """Return True if a writer has the file open, or was killed while the file was open.

    Raise an error if the file is shorter than its superblock states. HDF5 does not detect this
    while the file is being written; the file may then be too short for a moment.
    """
    deadline = clock.monotonic() + _GROWING_SECONDS
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
                    f"{path} is a file for ParaView; give the .h5 file of ResultsMonitor instead."
                )
            raise error(
                f"{path} is an HDF5 file of another program: its superblock has version "
                f"{version[0]}, but this program writes version 3."
            )
        whole, end = len(superblock) == _SUPERBLOCK, int.from_bytes(superblock[28:36], "little")
        if whole and size >= end:
            return being_written
        if not being_written or clock.monotonic() > deadline:
            expected = f" of {end}" if whole else ""
            raise error(f"{path} is truncated: it has {size}{expected} bytes.")
        clock.sleep(0.01)
