# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Array types, and distributed arrays that rank 0 can write to a file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

TAG = 4101  # of MPI messages that request and send a block of an array


class Dealt:
    """Distributed array that rank 0 can read block by block within `mpi.handing_out`.

    ``blocks`` has the first row of each rank and the total number of rows; it is computed unless
    given (collective). Shape and dtype are those of the whole array.
    """

    def __init__(self, comm: Any, mine: NDArray[Any], blocks: Ints | None = None) -> None:
        self.mine = np.ascontiguousarray(mine)
        self._blocks = np.cumsum([0, *comm.allgather(len(mine))]) if blocks is None else blocks
        self.shape = (int(self._blocks[-1]), *mine.shape[1:])
        self.dtype = mine.dtype
        self.requests: tuple[Any, int] | None = None  # set by `handing_out`: communicator, number

    def __len__(self) -> int:
        """Return the number of rows on all ranks."""
        return self.shape[0]

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Yield consecutive blocks of rows on rank 0, which stores only one at a time."""
        yield self.mine
        for rank, count in enumerate(np.diff(self._blocks)):
            if rank > 0 and count > 0:
                assert self.requests is not None
                comm, number = self.requests
                block = np.empty((count, *self.shape[1:]), self.dtype)
                comm.send(number, rank, TAG)
                comm.Recv(block, rank, TAG)
                yield block


def blocks_in(array: NDArray[Any] | Dealt) -> Iterator[NDArray[Any]]:
    """Yield consecutive blocks of rows; an ordinary array is one block."""
    yield from array if isinstance(array, Dealt) else (array,)
