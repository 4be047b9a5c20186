# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors raised on all ranks together, so that no rank waits for a stopped one; distributed rows.

The rows of a distributed array are split into consecutive blocks, one per rank. Rank 0 writes such
an array block by block (`Dealt`), while the other ranks send their blocks (`handing_out`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import monotonic, sleep
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import TAG, Dealt, Flags, Ints

T = TypeVar("T")

# If an error occurs on all ranks, all of them raise it within this time [s].
APART = 20.0


def abort_on_error(comm: Any) -> None:
    """End all ranks if one rank raises an error, so that the others do not wait for it.

    ``sys.exit`` within a stage of a simulation has the same effect; elsewhere it is not detected.
    Call it at the start of a program that runs under ``mpirun``, not in a library.
    """
    if comm.size > 1:
        sys.excepthook = _EndsAll(comm)


class _EndsAll:
    """Exception hook that prints the error and ends all ranks."""

    def __init__(self, comm: Any) -> None:
        self._comm = comm

    def __call__(self, *error: Any) -> None:
        sys.__excepthook__(*error)
        sys.stderr.flush()
        self._comm.Abort(1)


def free_petsc_garbage(comm: Any) -> None:
    """Free PETSc objects without references in Python (collective).

    On several ranks petsc4py does not free them automatically, because freeing is collective.
    """
    if comm.size > 1:
        from petsc4py import PETSc

        PETSc.garbage_cleanup(lasting(comm))


_LASTING: list[Any] = []
OF_ERRORS: list[Any] = []


def lasting(comm: Any, kept: list[Any] = _LASTING) -> Any:
    """Return a communicator of the same ranks that is never freed (collective).

    A DOLFINx mesh frees its communicator when it is deleted; PETSc objects that still use it would
    crash. One communicator is kept per group of ranks.
    """
    from mpi4py import MPI

    for candidate in kept:
        if MPI.Comm.Compare(candidate, comm) in (MPI.IDENT, MPI.CONGRUENT):
            return candidate
    kept.append(comm.Dup())
    return kept[-1]


def all_fail(comm: Any, error: BaseException) -> bool:
    """Return True if all ranks call this within `APART` seconds, so that they can continue.

    Error handlers use it, because an error may occur only on this rank. ``comm`` is
    ``lasting(comm, OF_ERRORS)``, created beforehand and used only here.
    """
    arrival, end = comm.Ibarrier(), monotonic() + APART
    while not arrival.Test():
        if monotonic() > end:
            hook = sys.excepthook
            if isinstance(error, SystemExit) and isinstance(hook, _EndsAll):
                hook(type(error), error, error.__traceback__)  # Python does not call it
            return False
        sleep(0.01)
    return True


def of_ranks(comm: Any, values: NDArray[Any]) -> NDArray[Any]:
    """Stack equally shaped arrays of all ranks to an array of shape (ranks, ...) (collective)."""
    mine = np.ascontiguousarray(values)
    if comm.size == 1:
        return mine[None]
    stacked = np.empty((comm.size, *mine.shape), mine.dtype)
    comm.Allgather(mine, stacked)
    return stacked


def summed(comm: Any, values: NDArray[Any]) -> NDArray[Any]:
    """Return the sum of the arrays of all ranks, bitwise equal on each rank (collective)."""
    return values if comm.size == 1 else np.asarray(of_ranks(comm, values).sum(axis=0))


def gathered(comm: Any, values: NDArray[Any]) -> NDArray[Any] | None:
    """Concatenate the arrays of all ranks on rank 0; return None elsewhere (collective)."""
    parts = comm.gather(values, root=0)
    return None if parts is None else np.concatenate(parts)


def equal_blocks(count: int, ranks: int) -> Ints:
    """Return each rank's first row of evenly split rows, and their number, (ranks + 1,)."""
    return np.linspace(0, count, ranks + 1).astype(np.int64)


def blocks_of(comm: Any, count: int) -> Ints:
    """Return the first row of each rank for given local counts, and the total (collective)."""
    return np.concatenate([[0], np.cumsum(comm.allgather(count), dtype=np.int64)])


def rank_of(blocks: Ints, number: Ints) -> Ints:
    """Return the rank that stores each row, by global row number."""
    return np.searchsorted(blocks, number, side="right") - 1


def sent_to(comm: Any, rank: Ints, rows: NDArray[Any]) -> NDArray[Any]:
    """Send each row to a rank; return the received rows in the order of ranks (collective)."""
    order = np.argsort(rank, kind="stable")
    ends = np.searchsorted(rank[order], np.arange(1, comm.size))
    return np.concatenate(comm.alltoall(np.split(rows[order], ends)))


def rows_at(comm: Any, rows: NDArray[Any], number: Ints) -> NDArray[Any]:
    """Return rows of a distributed array by global number; repeats are allowed (collective)."""
    return RowsAt(comm, len(rows), number)(rows)


class RowsAt:
    """Rows by global number, as in `rows_at`, of several arrays with the same distribution.

    ``count`` is the number of rows on this rank.
    """

    def __init__(self, comm: Any, count: int, number: Ints) -> None:
        """Send each rank the row numbers that others need from it (collective)."""
        self._comm, self._number = comm, number
        if comm.size == 1:
            return
        blocks = blocks_of(comm, count)
        wanted, place = np.unique(number, return_inverse=True)
        self._place, self._ends = place.ravel(), np.searchsorted(wanted, blocks[1:-1])
        requested = comm.alltoall(np.split(wanted, self._ends))
        self._sent = [numbers - blocks[comm.rank] for numbers in requested]
        self._wanted = len(wanted)

    def __call__(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return the rows with these numbers, shape (n, ...) (collective)."""
        if self._comm.size == 1:
            return rows[self._number]
        received = np.concatenate(self._comm.alltoall([rows[local] for local in self._sent]))
        return received[self._place]

    def mark(self, marks: Flags, rows: Flags) -> None:
        """Set the flags in ``rows`` for this rank's rows that any rank has marked (collective)."""
        if self._comm.size == 1:
            rows[self._number[marks]] = True
            return
        is_marked = np.zeros(self._wanted, dtype=bool)
        is_marked[self._place[marks]] = True
        parts = self._comm.alltoall(np.split(is_marked, self._ends))
        for sent, part in zip(self._sent, parts, strict=True):
            rows[sent[part]] = True


def dealt(comm: Any, count: int, number: Ints, rows: NDArray[Any]) -> NDArray[Any]:
    """Distribute rows evenly by global number; missing rows are zero (collective)."""
    start, stop = equal_blocks(count, comm.size)[comm.rank :][:2]
    block = np.zeros((stop - start, *rows.shape[1:]), rows.dtype)
    set_rows(comm, block, number, rows)
    return block


def set_rows(comm: Any, array: NDArray[Any], number: Ints, rows: NDArray[Any]) -> None:
    """Set rows of a distributed array by global number, on any rank (collective)."""
    blocks = blocks_of(comm, len(array))
    rank = rank_of(blocks, number)
    array[sent_to(comm, rank, number) - blocks[comm.rank]] = sent_to(comm, rank, rows)


def added(comm: Any, blocks: Ints, number: Ints, values: NDArray[Any]) -> NDArray[Any]:
    """Sum values (n,) by global row number; return the sums of this rank's rows (collective)."""
    rank = rank_of(blocks, number)
    received, first = sent_to(comm, rank, number), blocks[comm.rank]
    size = int(blocks[comm.rank + 1] - first)
    return np.bincount(received - first, weights=sent_to(comm, rank, values), minlength=size)


def positions(comm: Any, numbers: Ints, count: int) -> Ints:
    """Return positions among the sorted numbers, all below ``count``, of all ranks (collective)."""
    blocks = equal_blocks(count, comm.size)
    start, stop = blocks[comm.rank :][:2]
    received = np.sort(sent_to(comm, rank_of(blocks, numbers), numbers)) - start
    position = np.zeros(stop - start, dtype=np.int64)
    position[received] = blocks_of(comm, len(received))[comm.rank] + np.arange(len(received))
    return rows_at(comm, position, numbers)


def sorted_rows(comm: Any, blocks: Ints, rows: Ints) -> Ints:
    """Sort integer rows (n, m) of all ranks in ascending order (collective).

    ``blocks`` assigns the rows to ranks by their first entry.
    """
    received = sent_to(comm, rank_of(blocks, rows[:, 0]), rows)
    return received[np.lexsort(received.T[::-1])]


def across(comm: Any, mine: NDArray[Any], blocks: Ints | None = None) -> NDArray[Any] | Dealt:
    """Return the rows of all ranks: ``mine`` itself on one rank, else `Dealt` (collective)."""
    return mine if comm.size == 1 else Dealt(comm, mine, blocks)


@contextmanager
def handing_out(comm: Any, *things: Any) -> Iterator[None]:
    """Let rank 0 read distributed arrays in the block; errors are raised on all ranks (collective).

    The block must not contain collective calls. The other ranks run it first and then send their
    blocks of the arrays in ``things``, which may be nested in dictionaries and sequences.
    """
    parts = [] if comm.size == 1 else list(_dealt_in(things))
    for number, part in enumerate(parts):
        part.requests = comm, number
    with raised_together(comm):
        try:
            yield
        finally:
            for part in parts:
                part.requests = None
            if comm.rank == 0:
                for rank in range(1, comm.size if parts else 1):
                    comm.send(None, rank, TAG)
            elif parts:
                while (number := comm.recv(source=0, tag=TAG)) is not None:
                    comm.Send(parts[number].mine, 0, TAG)


def _dealt_in(thing: Any) -> Iterator[Dealt]:
    """Yield the distributed arrays in a nested structure, in the same order on all ranks."""
    if isinstance(thing, Dealt):
        yield thing
    elif isinstance(thing, Mapping):
        for each in thing.values():
            yield from _dealt_in(each)
    elif isinstance(thing, list | tuple):
        for each in thing:
            yield from _dealt_in(each)


def on_root(comm: Any, work: Callable[[], T]) -> T:
    """Run ``work`` on rank 0; return its result or raise its error on every rank (collective)."""
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
    """Raise an exception on all ranks if the block fails on some of them (collective).

    The block must not contain collective calls. All ranks raise a copy of the exception of the
    lowest failing rank.
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
