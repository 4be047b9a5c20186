# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""HDF5 files of others: what may be in them, checked before any of it is read.

HDF5 can point out of a file (external links, virtual datasets, raw data elsewhere), ask for plugins
to unpack data, and declare arrays of any size in a few bytes. None of that is written here, so none
of it is followed. A few wrong bytes were seen to let HDF5 read for ever: files that are written at
once end with a checksum, looked at before HDF5 is asked, and of others only those are opened whose
metadata HDF5 itself checks.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import time as clock
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import h5py
import numpy as np

from dolfinx_joints.common.errors import JointsError

DIGEST_BYTES = 32
"""Length of the checksum that follows HDF5's part of a file, which does not mind."""

# What reading a damaged or foreign file was seen to raise.
DAMAGE = (
    OSError,
    RuntimeError,
    LookupError,
    TypeError,
    AttributeError,
    ValueError,
    OverflowError,
    MemoryError,
    RecursionError,
)

OTHER = "holds something else than a run writes"
"""What `DamageTold` says of a file that is whole, but not of a run."""

_DEPTH = 8
_NAMES = 100_000
# Room for rows that a killed run had declared and not yet written.
_SLACK = 1 << 26
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SUPERBLOCK = 36  # bytes up to the file's length
_GROWING_SECONDS = 1.0  # longer than a writer takes to lengthen a file
# HDF5 reads again what fails its checksum while a run writes, and waits for 1, 2, 4, ... ns in
# between: 0.1 s in all, where 100 attempts of its own would outlast the reader.
_ATTEMPTS = 26


class DamageTold:
    """A block in which what reading a damaged file raises becomes one sentence.

    Args:
        path: The file.
        error: What to raise instead.
        verdict: What to say of the file, after its name.
    """

    def __init__(self, path: Path, error: type[Exception], verdict: str = "is damaged") -> None:
        """Nothing is read yet."""
        self._path, self._error, self._verdict = path, error, verdict

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        raised: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Raise the sentence."""
        if isinstance(raised, DAMAGE) and not isinstance(raised, JointsError):
            told = " ".join(str(raised).split()) or type(raised).__name__
            raise self._error(f"{self._path} {self._verdict}: {told[:300]}.") from raised


def check_contents(file: h5py.File, path: Path, error: type[Exception]) -> None:
    """Refuse what points elsewhere, is no plain array, or is larger than the file can hold.

    Args:
        file: The open file.
        path: Its name, for messages and its size.
        error: What to raise.

    Raises:
        Exception: ``error``.
    """
    limit = 2 * path.stat().st_size + _SLACK
    for count, (name, item) in enumerate(_items(file, "", 0, path, error)):
        if count > _NAMES:
            raise error(f"{path} is refused: it has more than {_NAMES} names.")
        if isinstance(item, h5py.Dataset):
            wrong = _fault(item, limit)
            if wrong:
                raise error(f"{path} is refused: {name!r} {wrong}.")


def _items(
    group: h5py.Group, above: str, depth: int, path: Path, error: type[Exception]
) -> Iterator[tuple[str, Any]]:
    """All that is in a group, by full name; links are looked at before they are opened."""
    if depth > _DEPTH:
        raise error(f"{path} is refused: groups are nested more than {_DEPTH} deep at {above!r}.")
    for key in group:
        name = f"{above}{key}"
        link = group.get(key, getlink=True)
        if not isinstance(link, h5py.HardLink):
            raise error(f"{path} is refused: {name!r} is a link that could lead elsewhere.")
        item = group[key]
        yield name, item
        if isinstance(item, h5py.Group):
            yield from _items(item, f"{name}/", depth + 1, path, error)


def _fault(dataset: h5py.Dataset, limit: int) -> str | None:
    """What is wrong with an array, in words that follow its name."""
    creation = dataset.id.get_create_plist()
    if dataset.is_virtual or creation.get_external_count():
        return "takes its values from other files"
    if creation.get_nfilters():
        return "is packed by a filter"
    if dataset.dtype.kind not in "biufS":
        return f"holds {dataset.dtype}, not plain numbers"
    if dataset.shape is None:
        return "is empty"
    size = dataset.dtype.itemsize
    for length in dataset.shape:
        size *= int(length)
    chunk = dataset.dtype.itemsize
    for length in dataset.chunks or ():
        chunk *= int(length)
    if max(size, chunk) > limit:
        return f"claims {max(size, chunk):.3g} bytes, more than the file can hold"
    return None


def set_texts(item: h5py.Dataset | h5py.Group, **texts: str) -> None:
    """Give a dataset or group attributes that `attribute` reads."""
    for name, text in texts.items():
        encoded = text.encode()
        kind = h5py.string_dtype("utf-8", max(len(encoded), 1))
        item.attrs.create(name, np.bytes_(encoded), dtype=kind)


def attribute(item: h5py.Dataset | h5py.Group, name: str) -> str | int | None:
    """A text or whole number among the attributes of a dataset or group; None without it.

    Raises:
        ValueError: It is something else. Texts of variable length lie in a heap for which HDF5 has
            no checksum, and some wrong bytes in it are read for ever.
    """
    if name not in item.attrs:
        return None
    found = h5py.h5a.open(item.id, name.encode())
    kind, wrong = found.get_type(), found.shape != ()
    if isinstance(kind, h5py.h5t.TypeStringID) and not kind.is_variable_str() and not wrong:
        return bytes(item.attrs[name]).decode()
    if isinstance(kind, h5py.h5t.TypeIntegerID) and not wrong:
        return int(item.attrs[name])
    raise ValueError(
        f"the attribute {name!r} is no text of fixed length and no whole number; files of earlier "
        "versions must be written anew"
    )


def seal(content: bytes | memoryview) -> bytes:
    """Checksum to be written behind the content of a file."""
    return hashlib.sha256(content).digest()


def check_seal(path: Path) -> None:
    """Refuse a file that is not as it was written.

    Raises:
        ValueError: Its checksum is not that of what it holds.
    """
    with path.open("rb") as sealed:
        digest = _digest(sealed, path.stat().st_size - DIGEST_BYTES)
        if sealed.read() != digest:
            raise ValueError("its checksum is not that of what it holds")


def _digest(file: BinaryIO, size: int) -> bytes:
    """Checksum of the first bytes of a file, which is left behind them."""
    checksum = hashlib.sha256()
    while size > 0 and (block := file.read(min(size, 1 << 20))):
        checksum.update(block)
        size -= len(block)
    return checksum.digest()


def open_growing(path: Path, error: type[Exception]) -> h5py.File:
    """Open a file for reading that a run may still write, or was killed while it did.

    Args:
        path: The file.
        error: What to raise.

    Raises:
        Exception: ``error``, where it is no HDF5 of the kind that this package writes, is
            truncated, or cannot be opened.
    """
    being_written = _check_superblock(path, error)
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
        told = " ".join(str(failure).split())[:300]
        raise error(
            f"{path} cannot be read; its run has not started yet or ended before it did ({told})."
        ) from failure


def _check_superblock(path: Path, error: type[Exception]) -> bool:
    """Whether a writer has, or had, the file open.

    A file that is shorter than its superblock says is refused: HDF5 does so itself, but not while
    the file is being written, when it may be so for the moment in which it grows.
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
