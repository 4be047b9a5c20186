# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files with a single writer, by a lock on ``PATH.lock``, and atomic replacement of files.

The operating system releases a lock when its process ends.
"""

from __future__ import annotations

import fcntl
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Protocol, Self

from dolfinx_joints.common.errors import warn


class Lock(Protocol):
    """Lock for writing files."""

    def release(self) -> None:
        """Release the lock, so that other processes can write the files."""


class FileLock:
    """Lock for writing a file, until `release` or the end of the process.

    A killed process leaves an unlocked ``PATH.lock``, which the next process reuses. On a file
    system without locks, a warning states that the file is not locked.

    Args:
        path: The file to be written; it need not exist.
        error: Type of the error if another run writes the file or ``PATH.lock`` cannot be written.
    """

    def __init__(self, path: Path, error: type[Exception]) -> None:
        """Acquire the lock, or raise at once."""
        self._place = path.with_name(f"{path.name}.lock")
        self._file: IO[str] | None = None
        try:
            file = self._locked(path, error)
            while not self._is_in_place(file):  # its previous owner deleted it meanwhile
                file.close()
                file = self._locked(path, error)
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
        except OSError as exc:
            raise error(
                f"{path} cannot be created: {exc.strerror} ({self._place.name} next to it)."
            ) from exc
        self._file = file

    def _locked(self, path: Path, error: type[Exception]) -> IO[str]:
        """Return the open lock file; warn if the file system cannot lock it."""
        file = self._place.open("a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            owner = file.read(200).strip() or "another process"
            file.close()
            raise error(
                f"{path} is being written by {owner}; wait until it ends, or use another file."
            ) from None
        except OSError as exc:
            warn(
                f"{path} is on a file system without locks ({exc.strerror}): a second run that "
                "writes it would not be detected."
            )
        return file

    def _is_in_place(self, file: IO[str]) -> bool:
        try:
            return os.path.samestat(os.fstat(file.fileno()), self._place.stat())
        except FileNotFoundError:
            return False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the lock, so that other processes can write the file."""
        if self._file is not None:
            self._place.unlink(missing_ok=True)
            self._file.close()
            self._file = None


@contextmanager
def released(lock: Lock | None, *, at_end: bool) -> Iterator[None]:
    """Release a lock if the block fails, or with ``at_end`` when the block ends."""
    try:
        yield
    except BaseException:
        at_end = True
        raise
    finally:
        if lock is not None and at_end:
            lock.release()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a path for a new file that replaces ``path`` when the block ends.

    If the block fails, the new file is deleted and ``path`` does not change.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")  # several ranks may write the file
    try:
        yield part
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise
