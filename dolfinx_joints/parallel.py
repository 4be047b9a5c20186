# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors that every rank raises alike, so that no rank waits for one that stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")


def on_root(comm: Any, work: Callable[[], T]) -> T:
    """Run ``work`` on rank 0 and give its result, or its exception, to every rank (collective).

    Args:
        comm: MPI communicator.
        work: Called on rank 0 only; its result must be picklable.

    Raises:
        Exception: What ``work`` raised, on every rank.
    """
    result: T | None = None
    error: Exception | None = None
    if comm.rank == 0:
        try:
            result = work()
        except Exception as exc:
            error = exc
    result, error = comm.bcast((result, error), root=0)
    if error is not None:
        raise error
    return result  # type: ignore[return-value]


@contextmanager
def raised_together(comm: Any) -> Iterator[None]:
    """Let an exception raised on some ranks inside the block reach all of them (collective).

    The block itself must hold no collective call. Ranks without an error of their own raise a
    copy of the one of the lowest failing rank.
    """
    if comm.size == 1:
        yield
        return
    error: Exception | None = None
    try:
        yield
    except Exception as exc:
        error = exc
    errors = [exc for exc in comm.allgather(error) if exc is not None]
    if errors:
        raise errors[0]
