# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Types of arrays, and arrays that are whole on no rank, as those see them who write them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Of messages that ask for a block of an array, and bring it.
TAG = 4101


class Dealt:
    """A dealt array, which rank 0 can read block by block within `mpi.handing_out`.

    Blocks, the first row of each rank and the number of all, are found out unless given
    (collective); shape and dtype are those of the whole array.
    """

    def __init__(self, comm: Any, mine: NDArray[Any], blocks: Ints | None = None) -> None:
        self.mine = np.ascontiguousarray(mine)
        self._blocks = np.cumsum([0, *comm.allgather(len(mine))]) if blocks is None else blocks
        self.shape = (int(self._blocks[-1]), *mine.shape[1:])
        self.dtype = mine.dtype
        self.asked_by: tuple[Any, int] | None = None  # `handing_out`: communicator and number

    def __len__(self) -> int:
        """Rows of all ranks."""
        return self.shape[0]

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Blocks of rows that follow each other, on rank 0: never more than one is held there."""
        yield self.mine
        for rank, count in enumerate(np.diff(self._blocks)):
            if rank > 0 and count > 0:
                assert self.asked_by is not None
                comm, number = self.asked_by
                block = np.empty((count, *self.shape[1:]), self.dtype)
                comm.send(number, rank, TAG)
                comm.Recv(block, rank, TAG)
                yield block


def blocks_in(array: NDArray[Any] | Dealt) -> Iterator[NDArray[Any]]:
    """Blocks of rows that follow each other, the whole of an ordinary array."""
    yield from array if isinstance(array, Dealt) else (array,)
