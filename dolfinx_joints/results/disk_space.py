# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reservation of disk space for a results file before HDF5 writes into it.

HDF5 cannot recover from a failed write: it treats the file as truncated and cannot close it.
Therefore the space is reserved first.
"""

import os
from pathlib import Path

import h5py

from dolfinx_joints.common.errors import ResultsError

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
