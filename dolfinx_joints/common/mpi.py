# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors that every rank raises alike, so that no rank waits for one that stopped; rows of arrays.

The rows of an array that is whole on no rank are dealt: each rank has a block, those of rank 0 come
first. Rank 0 writes such an array block by block, as `Dealt`, while others are `handing_out`.
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

# An error that all ranks raise, they raise within so many seconds.
APART = 20.0


def abort_on_error(comm: Any) -> None:
    """Let an error that only one rank raises end all ranks instead of leaving the others waiting.

    Also ``sys.exit`` within a stage of a simulation; of one elsewhere Python tells nobody.
    For the start of a program that runs under ``mpirun``; a library does not call it.
    """
    if comm.size > 1:
        sys.excepthook = _EndsAll(comm)


class _EndsAll:
    """Shows an error and ends all ranks."""

    def __init__(self, comm: Any) -> None:
        self._comm = comm

    def __call__(self, *error: Any) -> None:
        sys.__excepthook__(*error)
        sys.stderr.flush()
        self._comm.Abort(1)


def free_petsc_garbage(comm: Any) -> None:
    """Free the PETSc objects that Python has dropped (collective).

    On several ranks petsc4py cannot free them by itself, since that is collective.
    """
    if comm.size > 1:
        from petsc4py import PETSc

        PETSc.garbage_cleanup(lasting(comm))


_LASTING: list[Any] = []
OF_ERRORS: list[Any] = []


def lasting(comm: Any, kept: list[Any] = _LASTING) -> Any:
    """A communicator of the same ranks that is never freed (collective).

    A DOLFINx mesh frees its communicator when it goes; what PETSc still holds on it would then
    crash. One is kept for each group of ranks.
    """
    from mpi4py import MPI

    for known in kept:
        if MPI.Comm.Compare(known, comm) in (MPI.IDENT, MPI.CONGRUENT):
            return known
    kept.append(comm.Dup())
    return kept[-1]


def all_fail(comm: Any, error: BaseException) -> bool:
    """Whether all ranks get here within `APART` seconds, so that they may go on together.

    For handlers of errors, as others do not know of an error of this rank alone; ``comm`` is
    ``lasting(comm, OF_ERRORS)``, made before and used for nothing else.
    """
    arrival, end = comm.Ibarrier(), monotonic() + APART
    while not arrival.Test():
        if monotonic() > end:
            hook = sys.excepthook
            if isinstance(error, SystemExit) and isinstance(hook, _EndsAll):
                hook(type(error), error, error.__traceback__)  # which Python does not tell it
            return False
        sleep(0.01)
    return True


def of_ranks(comm: Any, values: NDArray[Any]) -> NDArray[Any]:
    """Arrays of all ranks, alike in shape and type, as one of shape (ranks, ...) (collective)."""
    mine = np.ascontiguousarray(values)
    if comm.size == 1:
        return mine[None]
    found = np.empty((comm.size, *mine.shape), mine.dtype)
    comm.Allgather(mine, found)
    return found


def summed(comm: Any, values: NDArray[Any]) -> NDArray[Any]:
    """Sum of the arrays of all ranks, the same on each (collective); on one rank its own."""
    return values if comm.size == 1 else np.asarray(of_ranks(comm, values).sum(axis=0))


def gathered(comm: Any, values: NDArray[Any]) -> NDArray[Any] | None:
    """Arrays of all ranks one after the other on rank 0, None elsewhere (collective)."""
    parts = comm.gather(values, root=0)
    return None if parts is None else np.concatenate(parts)


def equal_blocks(count: int, ranks: int) -> Ints:
    """First row of each rank's share of some rows, and their number, shape (ranks + 1,)."""
    return np.linspace(0, count, ranks + 1).astype(np.int64)


def blocks_of(comm: Any, count: int) -> Ints:
    """The same where each rank has a number of rows of its own (collective)."""
    return np.concatenate([[0], np.cumsum(comm.allgather(count), dtype=np.int64)])


def rank_of(blocks: Ints, number: Ints) -> Ints:
    """Rank that has each row, by its number among all."""
    return np.searchsorted(blocks, number, side="right") - 1


def sent_to(comm: Any, rank: Ints, rows: NDArray[Any]) -> NDArray[Any]:
    """Send each row to a rank; what this one gets, from rank 0 first (collective)."""
    order = np.argsort(rank, kind="stable")
    ends = np.searchsorted(rank[order], np.arange(1, comm.size))
    return np.concatenate(comm.alltoall(np.split(rows[order], ends)))


def rows_at(comm: Any, rows: NDArray[Any], number: Ints) -> NDArray[Any]:
    """Rows of a dealt array by their number among all, in any order and repeated (collective)."""
    return RowsAt(comm, len(rows), number)(rows)


class RowsAt:
    """Rows by number, as `rows_at` gives them, of several arrays that are dealt in the same way.

    ``count`` is the number of rows on this rank; rows are numbered over all ranks.
    """

    def __init__(self, comm: Any, count: int, number: Ints) -> None:
        """Tell each rank what is asked for (collective)."""
        self._comm, self._number = comm, number
        if comm.size == 1:
            return
        blocks = blocks_of(comm, count)
        wanted, place = np.unique(number, return_inverse=True)
        self._place, self._ends = place.ravel(), np.searchsorted(wanted, blocks[1:-1])
        asked = comm.alltoall(np.split(wanted, self._ends))
        self._sent = [each - blocks[comm.rank] for each in asked]
        self._wanted = len(wanted)

    def __call__(self, rows: NDArray[Any]) -> NDArray[Any]:
        """The rows asked for, shape (n, ...) (collective)."""
        if self._comm.size == 1:
            return rows[self._number]
        found = np.concatenate(self._comm.alltoall([rows[each] for each in self._sent]))
        return found[self._place]

    def mark(self, marks: Flags, rows: Flags) -> None:
        """Set those of this rank's rows that any rank marks where it has asked (collective)."""
        if self._comm.size == 1:
            rows[self._number[marks]] = True
            return
        each = np.zeros(self._wanted, dtype=bool)
        each[self._place[marks]] = True
        parts = self._comm.alltoall(np.split(each, self._ends))
        for sent, part in zip(self._sent, parts, strict=True):
            rows[sent[part]] = True


def dealt(comm: Any, count: int, number: Ints, rows: NDArray[Any]) -> NDArray[Any]:
    """Deal rows in equal blocks by their number; what no rank has, is zero (collective)."""
    start, stop = equal_blocks(count, comm.size)[comm.rank :][:2]
    found = np.zeros((stop - start, *rows.shape[1:]), rows.dtype)
    set_rows(comm, found, number, rows)
    return found


def set_rows(comm: Any, array: NDArray[Any], number: Ints, rows: NDArray[Any]) -> None:
    """Set rows of a dealt array by their number among all, wherever they are (collective)."""
    blocks = blocks_of(comm, len(array))
    rank = rank_of(blocks, number)
    array[sent_to(comm, rank, number) - blocks[comm.rank]] = sent_to(comm, rank, rows)


def added(comm: Any, blocks: Ints, number: Ints, values: NDArray[Any]) -> NDArray[Any]:
    """Sums of values (n,) over the rows that they belong to; this rank's rows (collective)."""
    rank = rank_of(blocks, number)
    here, first = sent_to(comm, rank, number), blocks[comm.rank]
    size = int(blocks[comm.rank + 1] - first)
    return np.bincount(here - first, weights=sent_to(comm, rank, values), minlength=size)


def positions(comm: Any, numbers: Ints, count: int) -> Ints:
    """Position of each number, of 0 to ``count``, among those of all ranks (collective)."""
    blocks = equal_blocks(count, comm.size)
    start, stop = blocks[comm.rank :][:2]
    there = np.sort(sent_to(comm, rank_of(blocks, numbers), numbers)) - start
    position = np.zeros(stop - start, dtype=np.int64)
    position[there] = blocks_of(comm, len(there))[comm.rank] + np.arange(len(there))
    return rows_at(comm, position, numbers)


def sorted_rows(comm: Any, blocks: Ints, rows: Ints) -> Ints:
    """Rows of whole numbers (n, m) of all ranks in rising order (collective).

    They are dealt by their first number, of which each rank has a block.
    """
    here = sent_to(comm, rank_of(blocks, rows[:, 0]), rows)
    return here[np.lexsort(here.T[::-1])]


def across(comm: Any, mine: NDArray[Any], blocks: Ints | None = None) -> NDArray[Any] | Dealt:
    """The array of the rows of all ranks: on one rank itself, else `Dealt` (collective)."""
    return mine if comm.size == 1 else Dealt(comm, mine, blocks)


@contextmanager
def handing_out(comm: Any, *things: Any) -> Iterator[None]:
    """Let rank 0 read dealt arrays inside the block; an error is raised on all ranks (collective).

    The block must hold no collective call. Other ranks run it first, then hand out what is in the
    things: arrays, and dictionaries and sequences of them.
    """
    parts = [] if comm.size == 1 else list(_dealt_in(things))
    for number, part in enumerate(parts):
        part.asked_by = comm, number
    with raised_together(comm):
        try:
            yield
        finally:
            for part in parts:
                part.asked_by = None
            if comm.rank == 0:
                for rank in range(1, comm.size if parts else 1):
                    comm.send(None, rank, TAG)
            elif parts:
                while (number := comm.recv(source=0, tag=TAG)) is not None:
                    comm.Send(parts[number].mine, 0, TAG)


def _dealt_in(thing: Any) -> Iterator[Dealt]:
    """Dealt arrays in a tree, in the same order on all ranks."""
    if isinstance(thing, Dealt):
        yield thing
    elif isinstance(thing, Mapping):
        for each in thing.values():
            yield from _dealt_in(each)
    elif isinstance(thing, list | tuple):
        for each in thing:
            yield from _dealt_in(each)


def on_root(comm: Any, work: Callable[[], T]) -> T:
    """Run ``work`` on rank 0 and give its result, or its exception, to every rank (collective)."""
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
