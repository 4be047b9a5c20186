# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Space on the disk for a results file, taken before HDF5 writes into it.

HDF5 cannot go back once a write has failed: its file then counts as truncated, and closing it fails
as well. So the disk is asked first.
"""

import os
from pathlib import Path

import h5py

from dolfinx_joints.common.errors import ResultsError

_METADATA_BYTES = 1 << 20  # more than HDF5 writes besides the values between two flushes


class Room:
    """Keeps room behind the end of an HDF5 file that is being written."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        """Open the file a second time; no space is reserved yet."""
        self._file = file
        self._handle = os.open(path, os.O_RDWR)

    def reserve(self, path: Path, nbytes: int) -> None:
        """Make sure that so many bytes of values, and what HDF5 adds to them, can be written."""
        there = os.fstat(self._handle).st_size
        end = self._file.id.get_filesize() + nbytes + _METADATA_BYTES
        if end <= there:
            return
        try:
            os.posix_fallocate(self._handle, there, end - there)
        except OSError as error:
            raise ResultsError(
                f"{path} cannot grow by {nbytes / 1e6:.3g} MB: {error.strerror}; what it holds "
                "so far is whole."
            ) from error

    def close(self) -> None:
        """Give back what was not used, once the file is closed."""
        os.lseek(self._handle, 0, os.SEEK_SET)
        superblock = os.read(self._handle, 36)
        end = int.from_bytes(superblock[28:36], "little")
        if superblock[8:9] in (b"\2", b"\3") and end < os.fstat(self._handle).st_size:
            os.ftruncate(self._handle, end)
        os.close(self._handle)
