# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance matrix of the joint points in blocks, distributed to the ranks of the points.

A rank stores the blocks between its own points. For a low-rank block L^T R between two ranks, the
owner of the rows stores L and the owner of the columns stores R. In a product they exchange only
the few values R x, and L x for the mirrored block. The owner of the rows stores a dense block. The
dense blocks of a panel have the same columns; the unknowns of these columns are sent once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.blocks_between_ranks import (
    DENSE,
    FACTOR,
    PLACE,
    expand,
    reduce,
)
from dolfinx_joints.solvers.compliance.own_blocks import (
    Cluster,
    OwnBlocks,
    factors_if_worth,
    multiply_blocks,
    rank_of,
)


@dataclass(eq=False)
class Shares:
    """Data of one rank for its blocks with the points of another rank.

    Args:
        dtype: Type of the factors.

    Attributes:
        table: First unknown, number of unknowns, rows of the factor, kind and panel of each block.
        factors: Factors of the blocks, empty for `PLACE`.
    """

    dtype: Any
    table: list[tuple[int, int, int, int, int]] = field(default_factory=list)
    factors: list[NDArray[Any]] = field(default_factory=list)

    def add(
        self, first: int, unknowns: int, factor: NDArray[Any] | None, kind: int, panel: int
    ) -> None:
        """Add the data of a block; not allowed after the first product."""
        rows = unknowns if factor is None else len(factor)
        self.table.append((first, unknowns, rows, kind, panel))
        kept = np.empty((0, unknowns)) if factor is None else factor
        self.factors.append(np.ascontiguousarray(kept, self.dtype))

    def replaced(self, parts: Sequence[tuple[NDArray[Any] | None, int]], dtype: Any) -> Shares:
        """Return the data of these blocks with other factors and kinds."""
        shares = Shares(dtype)
        for (first, unknowns, _, _, panel), part in zip(self.table, parts, strict=True):
            shares.add(first, unknowns, *part, panel)
        return shares

    @cached_property
    def arrays(self) -> tuple[Ints, NDArray[Any]]:
        """Table and entries for the compiled loops; the factors become views of the entries.

        The last column of this table is the position of a block's values in the exchanged array,
        instead of the panel.
        """
        data = np.concatenate([f.ravel() for f in self.factors])
        self._set_views(data)
        table, places, end = [], {}, 0
        for *block, rows, kind, panel in self.table:
            if kind == FACTOR or panel not in places:
                place, end = end, end + rows
                if kind != FACTOR:
                    places[panel] = place
            elif kind == PLACE:
                continue
            else:
                place = places[panel]
            table.append((*block, rows, kind, place))
        return np.array(table, dtype=np.int64), data

    def _set_views(self, data: NDArray[Any]) -> None:
        """Replace the factors by views of ``data``."""
        at = 0
        for i, factor in enumerate(self.factors):
            self.factors[i] = data[at : at + factor.size].reshape(factor.shape)
            at += factor.size

    def move(self, data: NDArray[Any]) -> None:
        """Use ``data``, a copy of the entries, in all later products."""
        self.__dict__["arrays"] = (self.arrays[0], data)
        self._set_views(data)

    @cached_property
    def length(self) -> int:
        """Number of values sent to, and received from, the other rank in a product."""
        return int((self.arrays[0][:, 2] + self.arrays[0][:, 4]).max())


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """Columns that are computed together, with the data that other ranks need."""

    numbers: Ints
    cluster: Cluster
    scale: Floats


class LowRankMatrix:
    """Compliance matrix in blocks, scaled to a unit diagonal; see `OwnBlocks`.

    Args:
        columns: Function that returns the rank's rows of some columns, shape (3 n, k), for the
            global numbers of the columns, shape (k,); it is called in the same order on all ranks.
        points: Coordinates of the rank's points, shape (n, 3), [m].
        comm: Communicator of the ranks.
        scale: Square roots of the diagonal or an estimate of them, shape (3 n,).
        joint: Number of the joint of each point, shape (n,).
        tolerance: Largest error of a block relative to the unit diagonal.
        dtype: Type of the blocks and products, float64 or float32.
        leaf: Largest number of points in a cluster that is not bisected.
        symmetric: True if the matrix is symmetric.

    Attributes:
        comm: Communicator of the ranks.
        symmetric: True if the matrix is symmetric.
        own: Blocks of the rank's points among themselves.
    """

    def __init__(
        self,
        columns: Callable[[Ints], Floats],
        points: Floats,
        comm: Any,
        *,
        scale: Floats,
        joint: NDArray[Any] | None = None,
        tolerance: float = limits.COMPRESSION,
        dtype: Any = np.float64,
        leaf: int = limits.CLUSTER_POINTS,
        symmetric: bool = True,
    ) -> None:
        """Compute the columns panel by panel, starting with rank 0 (collective)."""
        self.comm, self.symmetric = comm, symmetric
        self.own = OwnBlocks(
            points,
            scale=scale,
            joint=joint,
            tolerance=tolerance,
            dtype=dtype,
            leaf=leaf,
            symmetric=symmetric,
        )
        self._first = comm.scan(self.own.size) - self.own.size
        self._rows: dict[int, Shares] = {}
        self._columns: dict[int, Shares] = {}
        for root, count in enumerate(comm.allgather(len(self.own.panels))):
            for number in range(count):
                self._add_panel(root, number, columns)
        self.own.finish()
        self._finish()

    def _add_panel(self, root: int, number: int, columns: Callable[[Ints], Floats]) -> None:
        """Compute the columns of a panel of a rank, and store their blocks (collective)."""
        comm, own = self.comm, self.own
        panel: _Panel = comm.bcast(self._panel(number) if comm.rank == root else None, root=root)
        panel_columns, others = columns(panel.numbers), []
        if comm.rank == root:
            own.add_panel(own.panels[number], panel_columns)
        elif comm.rank > root or not self.symmetric:
            shares = self._rows.setdefault(root, Shares(own.dtype))
            for rows, *parts in own.row_blocks(panel.cluster, panel.scale, panel_columns):
                first, unknowns = 3 * rows.start, 3 * (rows.stop - rows.start)
                dense = len(parts) == 1
                factor = parts[0].T if dense else parts[0]
                shares.add(first, unknowns, factor, DENSE if dense else FACTOR, number)
                others.append(None if dense else parts[1].astype(own.dtype))
        for rank, factors in enumerate(comm.gather(others, root=root) or ()):
            at = own.panels[number].unknowns
            for factor in factors:
                shares = self._columns.setdefault(rank, Shares(own.dtype))
                kind = PLACE if factor is None else FACTOR
                shares.add(at.start, at.stop - at.start, factor, kind, number)

    def _panel(self, number: int) -> _Panel:
        """Return a panel of this rank."""
        cluster = self.own.panels[number]
        return _Panel(
            numbers=self.own.order[cluster.unknowns] + self._first,
            cluster=Cluster(cluster.start, cluster.stop, cluster.low, cluster.high),
            scale=self.own.scale[cluster.unknowns],
        )

    def _finish(self) -> None:
        """Set up the exchange with other ranks."""
        self._rows = {rank: shares for rank, shares in self._rows.items() if shares.table}
        self._sends, self._adds = dict(self._columns), dict(self._rows)
        if self.symmetric:
            self._sends |= self._rows
            self._adds |= self._columns
        both = list(self._rows.values()) + list(self._columns.values())
        self.nbytes = self.own.nbytes + sum(shares.arrays[1].nbytes for shares in both)

    @property
    def sent(self) -> int:
        """Number of values that the rank sends in a product."""
        return sum(shares.length for shares in self._sends.values())

    def rougher(self, tolerance: float, dtype: Any = np.float32) -> LowRankMatrix:
        """Return this matrix with a larger tolerance, computed from its blocks (collective)."""
        rough = copy(self)
        rough.own = self.own.rougher(tolerance, dtype)
        rough._rows, rough._columns = {}, {}
        # A message to the owner of the columns has an entry per block: the number of rows of R that
        # are kept, R of a block that was dense, or None for a block that stays dense.
        messages: list[list[Any]] = [[] for _ in range(self.comm.size)]
        for rank, shares in self._rows.items():
            kept: list[tuple[NDArray[Any] | None, int]] = []
            for (*_, kind, _), factor in zip(shares.table, shares.factors, strict=True):
                factors = factors_if_worth(factor.T, tolerance) if kind == DENSE else None
                if kind == FACTOR:
                    messages[rank].append(rank_of(factor, tolerance))
                    kept.append((factor[: messages[rank][-1]], FACTOR))
                else:
                    messages[rank].append(None if factors is None else factors[1])
                    kept.append((factor, DENSE) if factors is None else (factors[0], FACTOR))
            rough._rows[rank] = shares.replaced(kept, dtype)
        for rank, entries in enumerate(self.comm.alltoall(messages)):
            if entries:
                shares, kept = self._columns[rank], []
                for factor, entry in zip(shares.factors, entries, strict=True):
                    replacement = factor[:entry] if isinstance(entry, int) else entry
                    kept.append((replacement, PLACE if replacement is None else FACTOR))
                rough._columns[rank] = shares.replaced(kept, dtype)
        rough._finish()
        return rough

    def product(self, vector: Floats) -> Floats:
        """Return the matrix times a vector, with the rank's entries, shape (3 n,) (collective)."""
        comm, own = self.comm, self.own
        x = (own.scale * vector[own.order]).astype(own.dtype)
        y = np.zeros(own.size, dtype=own.dtype)
        received = {rank: np.empty(shares.length, own.dtype) for rank, shares in self._adds.items()}
        waiting = [comm.Irecv(values, source=rank) for rank, values in received.items()]
        sent = []
        for rank, shares in self._sends.items():
            sent.append(np.zeros(shares.length, own.dtype))
            reduce(*shares.arrays, x, sent[-1], True)
            waiting.append(comm.Isend(sent[-1], dest=rank))
        multiply_blocks(own.blocks, own.data, x, y)
        for request in waiting:
            request.Wait()
        for rank, shares in self._adds.items():
            expand(*shares.arrays, received[rank], y)
        out = np.empty(own.size)
        out[own.order] = own.scale * y
        return out

    def joined(self) -> tuple[Ints, NDArray[Any], list[int]]:
        """Return table, entries and lengths of the blocks with other ranks (symmetric matrix).

        The lengths are the numbers of values exchanged with each rank in a product.
        """
        both = [self._sends.get(rank) for rank in range(self.comm.size)]
        lengths = [0 if shares is None else shares.length for shares in both]
        tables: list[Ints] = [np.empty((0, 5), dtype=np.int64)]
        present = [shares for shares in both if shares is not None]
        entries, at = np.empty(sum(len(s.arrays[1]) for s in present), dtype=self.own.dtype), 0
        for shares, before in zip(both, np.cumsum(lengths) - lengths, strict=True):
            if shares is not None:
                table, data = shares.arrays
                tables.append(table + np.array([0, 0, 0, 0, before]))
                target = entries[at : at + len(data)]
                target[:] = data
                shares.move(target)
                at += len(data)
        return np.concatenate(tables), entries, lengths

    def columns(self) -> Floats:
        """Return the rank's columns of a symmetric matrix, shape (all rows, own) (collective).

        Row i of the array is column i of the rank's rows.
        """
        comm, own = self.comm, self.own
        sizes = comm.allgather(own.size)
        firsts = np.cumsum(sizes) - sizes
        out = np.zeros((sum(sizes), own.size))
        out[firsts[comm.rank] : firsts[comm.rank] + own.size] = own.whole()
        messages: list[Any] = [None] * comm.size
        for rank, shares in self._sends.items():
            messages[rank] = shares.table, shares.factors, own.order, own.scale
        for rank, message in enumerate(comm.alltoall(messages)):
            if message is None:
                continue
            shares, (table, factors, order, scale) = self._sends[rank], message
            for i, factor in enumerate(shares.factors):
                (first, unknowns, _, kind, _), (at, others, *_) = shares.table[i], table[i]
                own_slice, other_slice = slice(first, first + unknowns), slice(at, at + others)
                block = factors[i].T @ factor if kind == FACTOR else factor
                if kind == PLACE:
                    block = factors[i].T
                rows = firsts[rank] + order[other_slice]
                scaled = scale[other_slice, None] * block * own.scale[own_slice]
                out[np.ix_(rows, own.order[own_slice])] = scaled
        return out

    def products(self, vectors: list[Floats]) -> list[Floats]:
        """Return the matrix times several vectors (collective)."""
        if self.comm.size == 1 and len(vectors) > 1:
            return self.own.products(vectors)
        return [self.product(vector) for vector in vectors]
