# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files with one writer (a lock on ``PATH.lock``), and files written whole.

The system drops a lock when its process ends.
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
    """Right to write files."""

    def release(self) -> None:
        """Let others write them."""


class FileLock:
    """Right to write a file, kept until `release` or the end of the process.

    A killed process leaves an unlocked ``PATH.lock``, which the next one takes over. On a file
    system without locks a warning says that nothing is locked.

    Args:
        path: The file to be written; it need not exist.
        error: Raised where another run writes the file, or ``PATH.lock`` cannot be written.
    """

    def __init__(self, path: Path, error: type[Exception]) -> None:
        """Take the lock, or raise at once."""
        self._place = path.with_name(f"{path.name}.lock")
        self._file: IO[str] | None = None
        try:
            file = self._locked(path, error)
            while not self._is_in_place(file):  # its last owner deleted it before it was locked
                file.close()
                file = self._locked(path, error)
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
        except OSError as exc:
            raise error(
                f"{path} cannot be created: {exc.strerror} ({self._place.name} beside it)."
            ) from exc
        self._file = file

    def _locked(self, path: Path, error: type[Exception]) -> IO[str]:
        """File of the lock, open and locked; not locked where the file system has no locks."""
        file = self._place.open("a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            owner = file.read(200).strip() or "another process"
            file.close()
            raise error(
                f"{path} is being written by {owner}; wait for it, end it, or take another file."
            ) from None
        except OSError as exc:
            warn(
                f"{path} is on a file system without locks ({exc.strerror}): a second run that "
                "writes it would not be noticed."
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
        """Let others write the file."""
        if self._file is not None:
            self._place.unlink(missing_ok=True)
            self._file.close()
            self._file = None


@contextmanager
def released(lock: Lock | None, *, at_end: bool) -> Iterator[None]:
    """Let other runs write a file if the block fails, or at its end."""
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
    """A place beside a file to write another one, which takes its place once the block ends.

    What an error leaves there is removed, and the file is as it was.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        yield part
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise
