# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Communication between ranks inside compiled loops, by functions of the MPI library.

All ranks sum in the same order, so that their decisions based on sums or maxima agree.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
from llvmlite import binding
from numba import types
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.kernels import part
from dolfinx_joints.solvers import limits


def _mpi_function(name: str, arguments: str) -> Any:
    """Return a function of mpi4py's MPI library; ``arguments``: p pointer, i int, h handle."""
    library = ctypes.CDLL(MPI.__file__)
    address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    binding.add_symbol(name, address)
    kinds = {"p": types.uintp, "i": types.int32, "h": types.intp}
    return types.ExternalFunction(name, types.int32(*(kinds[kind] for kind in arguments)))


_allgather = _mpi_function("MPI_Allgather", "pihpihh")
_allgatherv = _mpi_function("MPI_Allgatherv", "pihppphh")
_alltoallv = _mpi_function("MPI_Alltoallv", "ppphppphh")


class Ranks(NamedTuple):
    """Ranks of a communicator.

    Attributes:
        comm: MPI's handle of the communicator.
        byte: MPI's handle of the type of one byte.
        rank: Number of this rank.
        size: Number of ranks.
        buffer: Buffer for values of all ranks, shape (size, products of GMRES + 1).
    """

    comm: int
    byte: int
    rank: int
    size: int
    buffer: Floats


class Lengths(NamedTuple):
    """Lengths in bytes of the ranks' parts of a distributed array.

    Attributes:
        counts: Length of each rank's part, shape (ranks,).
        starts: Total length of the parts of lower ranks, shape (ranks,).
    """

    counts: NDArray[np.int32]
    starts: NDArray[np.int32]


def ranks_of(comm: Any) -> Ranks:
    """Return the ranks of an mpi4py communicator, which must exist as long as the result."""
    buffer = np.empty((comm.size, limits.MOST_PRODUCTS + 1))
    # The handle is an address or, with MPICH, a 32-bit number, passed in the same register.
    return Ranks(MPI._handleof(comm), MPI._handleof(MPI.BYTE), comm.rank, comm.size, buffer)


def lengths_of(counts: Any) -> Lengths:
    """Return the lengths for the number of bytes of each rank."""
    lengths = np.array(counts, dtype=np.int32)
    return Lengths(lengths, (np.cumsum(lengths) - lengths).astype(np.int32))


@part
def _check(code: int) -> None:
    """Raise an error if a function of MPI returns an error code, as mpi4py does."""
    if code != 0:
        raise JointsError("MPI failed in the exchange between ranks in the joint iteration.")


@part
def allgather_values(ranks: Ranks, values: Floats) -> Floats:
    """Return the values of all ranks, shape (ranks, n), valid until the next call (collective)."""
    count = len(values)
    by_rank = ranks.buffer.reshape(-1)[: ranks.size * count]
    if ranks.size == 1:
        by_rank[:] = values
    else:
        _check(
            _allgather(
                values.ctypes.data,
                np.int32(8 * count),
                ranks.byte,
                by_rank.ctypes.data,
                np.int32(8 * count),
                ranks.byte,
                ranks.comm,
            )
        )
    return by_rank.reshape((ranks.size, count))


@part
def sum_over(ranks: Ranks, values: Floats) -> None:
    """Replace values by their sums over the ranks; the buffer limits their number (collective)."""
    if ranks.size == 1:
        return
    by_rank = allgather_values(ranks, values)
    for k in range(len(values)):
        values[k] = 0.0
        for r in range(ranks.size):
            values[k] += by_rank[r, k]


@part
def largest_of(ranks: Ranks, value: float) -> float:
    """Return the largest value of all ranks, NaN if one of them is NaN (collective)."""
    if ranks.size == 1:
        return value
    values = np.array([value])
    by_rank = allgather_values(ranks, values)
    for r in range(ranks.size):
        if value == value and not by_rank[r, 0] <= value:
            value = by_rank[r, 0]
    return value


@part
def allgather_parts(
    ranks: Ranks, part: NDArray[Any], lengths: Lengths, gathered: NDArray[Any]
) -> NDArray[Any]:
    """Return the parts of all ranks, written to ``gathered``; on one rank ``part`` (collective)."""
    if ranks.size == 1:
        return part
    _check(
        _allgatherv(
            part.ctypes.data,
            lengths.counts[ranks.rank],
            ranks.byte,
            gathered.ctypes.data,
            lengths.counts.ctypes.data,
            lengths.starts.ctypes.data,
            ranks.byte,
            ranks.comm,
        )
    )
    return gathered


@part
def exchange(ranks: Ranks, sent: NDArray[Any], lengths: Lengths, received: NDArray[Any]) -> None:
    """Send each rank its part of an array, and receive a part of equal length (collective)."""
    counts, starts = lengths.counts.ctypes.data, lengths.starts.ctypes.data
    _check(
        _alltoallv(
            sent.ctypes.data,
            counts,
            starts,
            ranks.byte,
            received.ctypes.data,
            counts,
            starts,
            ranks.byte,
            ranks.comm,
        )
    )
