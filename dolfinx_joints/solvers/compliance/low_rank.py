# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliances of joint points in blocks, spread over the ranks that own the points.

A rank keeps the blocks of its own points. Of a block L^T R between two ranks the owner of the rows
keeps L and that of the columns R, so that what passes between them in a product are the few numbers
R x, and L x for the mirror image. Of a dense block the owner of the rows keeps all; the dense ones
of a panel share its unknowns, which pass once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(eq=False)
class Shares:
    """A rank's parts of its blocks with the points of one other rank.

    Args:
        dtype: Type of the factors.

    Attributes:
        table: First unknown, number of unknowns, rows of the factor, kind and panel of each block.
        factors: Their factors, empty for `PLACE`.
    """

    dtype: Any
    table: list[tuple[int, int, int, int, int]] = field(default_factory=list)
    factors: list[NDArray[Any]] = field(default_factory=list)

    def add(
        self, first: int, unknowns: int, factor: NDArray[Any] | None, kind: int, panel: int
    ) -> None:
        """Take up a part, before any product."""
        rows = unknowns if factor is None else len(factor)
        self.table.append((first, unknowns, rows, kind, panel))
        kept = np.empty((0, unknowns)) if factor is None else factor
        self.factors.append(np.ascontiguousarray(kept, self.dtype))

    def replaced(self, parts: Sequence[tuple[NDArray[Any] | None, int]], dtype: Any) -> Shares:
        """Return shares of the same blocks with other factors and kinds."""
        shares = Shares(dtype)
        for (first, unknowns, _, _, panel), part in zip(self.table, parts, strict=True):
            shares.add(first, unknowns, *part, panel)
        return shares

    @cached_property
    def arrays(self) -> tuple[Ints, NDArray[Any]]:
        """Table and entries as the loops take them; the factors become views of the latter.

        In the place of a block's panel is where its numbers are among those that pass.
        """
        data = np.concatenate([f.ravel() for f in self.factors])
        self._view(data)
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

    def _view(self, data: NDArray[Any]) -> None:
        """Let the factors be views of these entries."""
        at = 0
        for i, factor in enumerate(self.factors):
            self.factors[i] = data[at : at + factor.size].reshape(factor.shape)
            at += factor.size

    def move(self, data: NDArray[Any]) -> None:
        """Keep the entries here, where they have been copied to."""
        self.__dict__["arrays"] = (self.arrays[0], data)
        self._view(data)

    @cached_property
    def length(self) -> int:
        """Numbers that go to the other rank, and come from it, in a product."""
        return int((self.arrays[0][:, 2] + self.arrays[0][:, 4]).max())


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """Columns that are taken at once, as other ranks need to know them."""

    numbers: Ints
    cluster: Cluster
    scale: Floats


class LowRankMatrix:
    """A compliance matrix in blocks, scaled to a unit diagonal; see `OwnBlocks`.

    Args:
        columns: Gives the rank's rows of some columns, shape (3 n, k), for the columns' numbers
            among all ranks' unknowns, shape (k,); called in the same order on all ranks.
        points: Coordinates of the rank's points, shape (n, 3), [m].
        comm: Communicator of the ranks.
        scale: Square roots of the diagonal or an estimate of them, shape (3 n,).
        joint: Number of the joint of each point, shape (n,).
        tolerance: Largest error of a block relative to the unit diagonal.
        dtype: Type that blocks are kept in and multiplied with, float64 or float32.
        leaf: Largest number of points in a cluster that is not cut.
        symmetric: Whether the matrix is.

    Attributes:
        comm: Communicator of the ranks.
        symmetric: Whether the matrix is.
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
        """Take the columns panel by panel, those of rank 0 first (collective)."""
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
                self._take(root, number, columns)
        self.own.close()
        self._close()

    def _take(self, root: int, number: int, columns: Callable[[Ints], Floats]) -> None:
        """Take a panel of a rank (collective)."""
        comm, own = self.comm, self.own
        panel: _Panel = comm.bcast(self._panel(number) if comm.rank == root else None, root=root)
        found, others = columns(panel.numbers), []
        if comm.rank == root:
            own.take(own.panels[number], found)
        elif comm.rank > root or not self.symmetric:
            shares = self._rows.setdefault(root, Shares(own.dtype))
            for rows, *parts in own.pieces(panel.cluster, panel.scale, found):
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
        """One of the rank's panels."""
        cluster = self.own.panels[number]
        return _Panel(
            numbers=self.own.order[cluster.unknowns] + self._first,
            cluster=Cluster(cluster.start, cluster.stop, cluster.low, cluster.high),
            scale=self.own.scale[cluster.unknowns],
        )

    def _close(self) -> None:
        """Settle what goes to which rank and comes from where."""
        self._rows = {rank: shares for rank, shares in self._rows.items() if shares.table}
        self._sends, self._adds = dict(self._columns), dict(self._rows)
        if self.symmetric:
            self._sends |= self._rows
            self._adds |= self._columns
        both = list(self._rows.values()) + list(self._columns.values())
        self.nbytes = self.own.nbytes + sum(shares.arrays[1].nbytes for shares in both)

    @property
    def sent(self) -> int:
        """Numbers that the rank sends in a product."""
        return sum(shares.length for shares in self._sends.values())

    def rougher(self, tolerance: float, dtype: Any = np.float32) -> LowRankMatrix:
        """Return the matrix to a larger tolerance, from the blocks of this one (collective)."""
        rough = copy(self)
        rough.own = self.own.rougher(tolerance, dtype)
        rough._rows, rough._columns = {}, {}
        # Message to the owners of the columns, for each block: the number of rows of R that stay; R
        # of a block that was dense; None for a block that stays dense.
        told: list[list[Any]] = [[] for _ in range(self.comm.size)]
        for rank, shares in self._rows.items():
            kept: list[tuple[NDArray[Any] | None, int]] = []
            for (*_, kind, _), factor in zip(shares.table, shares.factors, strict=True):
                factors = factors_if_worth(factor.T, tolerance) if kind == DENSE else None
                if kind == FACTOR:
                    told[rank].append(rank_of(factor, tolerance))
                    kept.append((factor[: told[rank][-1]], FACTOR))
                else:
                    told[rank].append(None if factors is None else factors[1])
                    kept.append((factor, DENSE) if factors is None else (factors[0], FACTOR))
            rough._rows[rank] = shares.replaced(kept, dtype)
        for rank, news in enumerate(self.comm.alltoall(told)):
            if news:
                shares, kept = self._columns[rank], []
                for factor, new in zip(shares.factors, news, strict=True):
                    known = factor[:new] if isinstance(new, int) else new
                    kept.append((known, PLACE if known is None else FACTOR))
                rough._columns[rank] = shares.replaced(kept, dtype)
        rough._close()
        return rough

    def product(self, vector: Floats) -> Floats:
        """The matrix times a vector, the rank's part of both, shape (3 n,) (collective)."""
        comm, own = self.comm, self.own
        x = (own.scale * vector[own.order]).astype(own.dtype)
        y = np.zeros(own.size, dtype=own.dtype)
        come = {rank: np.empty(shares.length, own.dtype) for rank, shares in self._adds.items()}
        waiting = [comm.Irecv(values, source=rank) for rank, values in come.items()]
        gone = []
        for rank, shares in self._sends.items():
            gone.append(np.zeros(shares.length, own.dtype))
            reduce(*shares.arrays, x, gone[-1], True)
            waiting.append(comm.Isend(gone[-1], dest=rank))
        multiply_blocks(own.blocks, own.data, x, y)
        for request in waiting:
            request.Wait()
        for rank, shares in self._adds.items():
            expand(*shares.arrays, come[rank], y)
        out = np.empty(own.size)
        out[own.order] = own.scale * y
        return out

    def joined(self) -> tuple[Ints, NDArray[Any], list[int]]:
        """Return the blocks of a symmetric matrix with other ranks: table, entries, lengths.

        Lengths are the numbers exchanged with each rank in a product, in the order of the ranks.
        """
        both = [self._sends.get(rank) for rank in range(self.comm.size)]
        lengths = [0 if shares is None else shares.length for shares in both]
        tables: list[Ints] = [np.empty((0, 5), dtype=np.int64)]
        known = [shares for shares in both if shares is not None]
        entries, at = np.empty(sum(len(s.arrays[1]) for s in known), dtype=self.own.dtype), 0
        for shares, before in zip(both, np.cumsum(lengths) - lengths, strict=True):
            if shares is not None:
                table, data = shares.arrays
                tables.append(table + np.array([0, 0, 0, 0, before]))
                here = entries[at : at + len(data)]
                here[:] = data
                shares.move(here)
                at += len(data)
        return np.concatenate(tables), entries, lengths

    def columns(self) -> Floats:
        """All columns of the rank's rows, one after the other, shape (all rows, own) (collective).

        The matrix is symmetric.
        """
        comm, own = self.comm, self.own
        sizes = comm.allgather(own.size)
        firsts = np.cumsum(sizes) - sizes
        out = np.zeros((sum(sizes), own.size))
        out[firsts[comm.rank] : firsts[comm.rank] + own.size] = own.whole()
        told: list[Any] = [None] * comm.size
        for rank, shares in self._sends.items():
            told[rank] = shares.table, shares.factors, own.order, own.scale
        for rank, theirs in enumerate(comm.alltoall(told)):
            if theirs is None:
                continue
            mine, (table, factors, order, scale) = self._sends[rank], theirs
            for i, factor in enumerate(mine.factors):
                (first, unknowns, _, kind, _), (at, others, *_) = mine.table[i], table[i]
                here, there = slice(first, first + unknowns), slice(at, at + others)
                block = factors[i].T @ factor if kind == FACTOR else factor
                if kind == PLACE:
                    block = factors[i].T
                rows = firsts[rank] + order[there]
                scaled = scale[there, None] * block * own.scale[here]
                out[np.ix_(rows, own.order[here])] = scaled
        return out

    def products(self, vectors: list[Floats]) -> list[Floats]:
        """Return `product` of several vectors (collective)."""
        if self.comm.size == 1 and len(vectors) > 1:
            return self.own.products(vectors)
        return [self.product(vector) for vector in vectors]
