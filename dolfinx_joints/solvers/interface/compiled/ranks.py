# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks tell each other inside compiled loops, by MPI's own functions.

All ranks sum in the same order, so that a decision taken on sums or maxima is the same on all.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
from llvmlite import binding
from numba import types
from numpy.typing import NDArray

from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.kernels import part
from dolfinx_joints.solvers import limits

Floats = NDArray[np.float64]


def _function(name: str, arguments: str) -> Any:
    """A function of the MPI that mpi4py has loaded: p pointers, i int, h handles."""
    library = ctypes.CDLL(MPI.__file__)
    address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    binding.add_symbol(name, address)
    kinds = {"p": types.uintp, "i": types.int32, "h": types.intp}
    return types.ExternalFunction(name, types.int32(*(kinds[each] for each in arguments)))


_allgather = _function("MPI_Allgather", "pihpihh")
_allgatherv = _function("MPI_Allgatherv", "pihppphh")
_alltoallv = _function("MPI_Alltoallv", "ppphppphh")


class Ranks(NamedTuple):
    """The ranks of a communicator.

    Attributes:
        comm: MPI's handle of the communicator.
        byte: MPI's handle of the type of one byte.
        rank: This one.
        size: Their number.
        room: For what the ranks sum, shape (size, products of GMRES + 1).
    """

    comm: int
    byte: int
    rank: int
    size: int
    room: Floats


class Lengths(NamedTuple):
    """Bytes that each rank has of an array that is dealt.

    Attributes:
        counts: Of each rank, shape (ranks,).
        starts: Of the ranks before, shape (ranks,).
    """

    counts: NDArray[np.int32]
    starts: NDArray[np.int32]


def ranks_of(comm: Any) -> Ranks:
    """Those of an mpi4py communicator, which has to live as long."""
    room = np.empty((comm.size, limits.MOST_PRODUCTS + 1))
    # An address or, with MPICH, a number of 32 bits, which is passed in the same register.
    return Ranks(MPI._handleof(comm), MPI._handleof(MPI.BYTE), comm.rank, comm.size, room)


def lengths_of(counts: Any) -> Lengths:
    """From the bytes of each rank."""
    found = np.array(counts, dtype=np.int32)
    return Lengths(found, (np.cumsum(found) - found).astype(np.int32))


@part
def _check(code: int) -> None:
    """Raise where a function of MPI returns an error, as those of mpi4py do."""
    if code != 0:
        raise JointsError("MPI has failed between the ranks of the joint iteration.")


@part
def each_of_ranks(ranks: Ranks, mine: Floats) -> Floats:
    """Values of all ranks, shape (ranks, n), in room that the next call takes (collective)."""
    count = len(mine)
    every = ranks.room.reshape(-1)[: ranks.size * count]
    if ranks.size == 1:
        every[:] = mine
    else:
        _check(
            _allgather(
                mine.ctypes.data,
                np.int32(8 * count),
                ranks.byte,
                every.ctypes.data,
                np.int32(8 * count),
                ranks.byte,
                ranks.comm,
            )
        )
    return every.reshape((ranks.size, count))


@part
def sum_over(ranks: Ranks, values: Floats) -> None:
    """Replace values, as many as `Ranks.room` takes, by their sums over the ranks (collective)."""
    if ranks.size == 1:
        return
    every = each_of_ranks(ranks, values)
    for k in range(len(values)):
        values[k] = 0.0
        for r in range(ranks.size):
            values[k] += every[r, k]


@part
def largest_of(ranks: Ranks, value: float) -> float:
    """Largest value of all ranks, not a number if one is not (collective)."""
    if ranks.size == 1:
        return value
    mine = np.array([value])
    every = each_of_ranks(ranks, mine)
    for r in range(ranks.size):
        if value == value and not every[r, 0] <= value:
            value = every[r, 0]
    return value


@part
def put_together(
    ranks: Ranks, mine: NDArray[Any], lengths: Lengths, every: NDArray[Any]
) -> NDArray[Any]:
    """Parts of all ranks one after the other, in the room given; of one rank its own (collective).

    Of several ranks the room begins with them.
    """
    if ranks.size == 1:
        return mine
    _check(
        _allgatherv(
            mine.ctypes.data,
            lengths.counts[ranks.rank],
            ranks.byte,
            every.ctypes.data,
            lengths.counts.ctypes.data,
            lengths.starts.ctypes.data,
            ranks.byte,
            ranks.comm,
        )
    )
    return every


@part
def exchange(ranks: Ranks, gone: NDArray[Any], lengths: Lengths, come: NDArray[Any]) -> None:
    """Send each rank its part of an array, and get as much from it (collective)."""
    counts, starts = lengths.counts.ctypes.data, lengths.starts.ctypes.data
    _check(
        _alltoallv(
            gone.ctypes.data,
            counts,
            starts,
            ranks.byte,
            come.ctypes.data,
            counts,
            starts,
            ranks.byte,
            ranks.comm,
        )
    )
