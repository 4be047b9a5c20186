# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections of the joint forces: (I + T S) d = r, on the smaller of two sets.

S is the compliance less its diagonal, T the tangent of the points, a block of 3 x 3 each.

- *Active*: T vanishes at open points. Few points closed: a system of the closed ones alone.
- *Complement*: T is T0, a diagonal, at points that stick. Few points open or sliding: with
  W = S (I + T0 S)^-1, made once, a system of the others alone. With T = T0 + E,

      q = r - E y,   (I + W E) y = W r,   d = q - T0 W q,   S d = W q.

Both are solved by GMRES; they differ from the identity by little however stiff joints are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from dolfinx_joints.common.dealt import Dealt
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import blocks_of, of_ranks, rank_of, sent_to, summed
from dolfinx_joints.solvers.interface.compliance import Part, Split
from dolfinx_joints.solvers.interface.gmres import gmres
from dolfinx_joints.solvers.interface.low_rank import unknowns_of
from dolfinx_joints.solvers.interface.row_matrix import Parts, RowMatrix

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

# Products that GMRES may spend on one correction; what it has then is taken.
MOST_PRODUCTS = 100

# Systems with the rough S are solved to this tolerance at most.
FINEST = 1e-3

# W is not made for more unknowns: it takes 0.3 GB for so many, all ranks together.
LARGEST_TIED = 6000

# What a correction takes as a rule.
PRODUCTS = 15

# W costs 2.3 m^3 operations, of which ten fit into the time of one entry of a product. It is made
# when a quarter of that has been spent without it: most runs go on for long.
OPERATIONS_PER_ENTRY = 40.0

# A pivot of I + T0 S, whose diagonal is one, below which W is so large that what corrections leave
# of their systems, times W, is no longer small: where points that stick tie each other.
SINGULAR = 0.03

# A change of T (between 0 and 1) that is none.
SAME = 1e-12

# Added to the diagonal of I + T S where joints are rigid: it is singular where points that stick
# tie each other, and corrections would chase what rounding leaves there.
DAMPING = 1e-8


@dataclass(frozen=True, kw_only=True)
class Correction:
    """A correction of the scaled forces.

    Attributes:
        step: d, of the rank's unknowns, shape (m,).
        coupled: S d, likewise.
        products: Products with the matrix of the set.
    """

    step: Floats
    coupled: Floats
    products: int


class Corrections:
    """Solves for corrections with one compliance, keeping what steps have in common.

    Args:
        split: S.
        rough: S to some 1e-4, for systems of many points, or None.
        stuck: T0, the diagonal of the tangent of the rank's points where they stick, shape
            (points, 3); None where the second set is of no use.
        comm: Communicator of the ranks.
        keeps_rows: Whether a rank may have whole rows, and for a moment all, of S.
        rigid: Whether joints are rigid.

    Attributes:
        stuck: T0, None where there is no second set.
        missed: Entries that W would have saved to be read before it was made.
    """

    def __init__(
        self,
        split: Split,
        rough: Split | None,
        stuck: Floats | None,
        comm: Any,
        *,
        keeps_rows: bool = True,
        rigid: bool = False,
    ) -> None:
        """Keep S; the second set is made when it pays."""
        self._diagonal = 1.0 + DAMPING * rigid
        self._split, self._rough, self._comm = split, rough, comm
        self._exact = isinstance(split, RowMatrix)
        ties = split.size <= LARGEST_TIED and (self._exact or keeps_rows)
        self.stuck = stuck if ties else None
        self._kept: Rows = np.empty(0, dtype=np.int64)
        self._points = split.local // 3
        self._block: Part | None = None
        self._tied: _Tied | None = None
        self.missed, self._finest = 0.0, 0.0

    def solve(self, residual: Floats, tangent: Floats, tolerance: float) -> Correction:
        """Solve (I + T S) d = r (collective).

        Args:
            residual: r, of the rank's unknowns, shape (m,).
            tangent: T, of the rank's points, shape (points, 3, 3).
            tolerance: Of the residual, relative to r.
        """
        active = _where(tangent, np.zeros((1, 3)), 0.0)
        changed = active if self.stuck is None else _where(tangent, self.stuck, SAME)
        held = self._holds(active)
        counts = np.array([len(active), len(changed), np.count_nonzero(residual), held])
        every = of_ranks(self._comm, counts)
        actives, changes, loaded = (int(n) for n in every[:, :3].sum(axis=0))
        if self.stuck is not None:
            tied = self._tied_if_cheaper(3 * actives, 3 * changes, loaded)
            if tied is not None:
                return tied.solve(residual, tangent, changed, changes, tolerance)
        if self._block is None or not every[:, 3].all():
            self._block = self._hold(active)
        return self._solve_active(residual, tangent, tolerance)

    def _tied_if_cheaper(self, active: int, changed: int, loaded: int) -> _Tied | None:
        """The second way, made once what it would have saved so far is what it costs.

        None where the first is cheaper, or there is no second. Numbers are of unknowns.
        """
        assert self.stuck is not None
        inner = float(active) ** 2
        if self._rough is not None:
            inner = min(inner, self._rough.cost(active))
        first = PRODUCTS * inner + self._split.cost(active)
        second = PRODUCTS * float(changed) ** 2 + float(loaded + changed) * self._split.size
        if second >= first:
            return None
        self._tie()
        if self._tied is None:
            self.missed += first - second
            self._tie()
        return self._tied

    def _tie(self) -> None:
        """Make W once what it would have saved is what it costs: a run may go on for as long."""
        if self._tied is not None or self.stuck is None:
            return
        if self.missed * OPERATIONS_PER_ENTRY > 2.3 * float(self._split.size) ** 3:
            whole = self._split.whole()
            if whole is not None:
                self._tied = _tied(whole, self.stuck.ravel(), self._comm)
            if self._tied is None:
                self.stuck = None

    def tied(self) -> Floats | None:
        """The rank's columns of W, shape (M, m), once it pays; it is then not kept (collective)."""
        self._tie()
        tied, self._tied = self._tied, None
        return None if tied is None else tied.matrix.columns()

    def _solve_active(self, residual: Floats, tangent: Floats, tolerance: float) -> Correction:
        rows, block = unknowns_of(self._kept), self._block
        assert block is not None
        step = residual.copy()
        step[rows] = 0.0
        here, others = tangent[self._kept], np.flatnonzero(step)
        right = residual[rows]
        if of_ranks(self._comm, np.array([len(others)])).any():
            right = right - _turned(here, self._split.product(step, others)[rows])
        step[rows], products = gmres(
            lambda v: self._diagonal * v + _turned(here, block.product(v)),
            right,
            tolerance=max(tolerance, self._finest),
            most=MOST_PRODUCTS,
            comm=self._comm,
        )
        coupled = self._split.product(step, np.flatnonzero(step))
        return Correction(step=step, coupled=coupled, products=products)

    def _holds(self, active: Rows) -> bool:
        """Whether the rank's part of the set that is kept will do for the active points."""
        if self._block is None or len(self._kept) > 2 * len(active) + 20:
            return False
        return bool(np.isin(active, self._kept, assume_unique=True).all())

    def _hold(self, points: Rows) -> Part:
        """The part of S of a set to be kept, of the rank's points these (collective)."""
        self._kept = points
        size = 3 * int(of_ranks(self._comm, np.array([len(points)])).sum())
        rough = self._rough
        if rough is not None and float(size) ** 2 <= rough.cost(size) and self._exact:
            rough = None
        self._finest = 0.0 if rough is None else FINEST
        return (rough or self._split).block(unknowns_of(points))

    def state_dict(self) -> dict[str, Any]:
        """State that later corrections depend on beyond their arguments (collective)."""
        if self._block is None:
            return {"missed": self.missed}
        first = self._comm.scan(self._points) - self._points
        return {"missed": self.missed, "kept": Dealt(self._comm, self._kept + first)}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave (collective)."""
        self.missed = state_dict["missed"]
        if "kept" in state_dict:
            blocks, kept = blocks_of(self._comm, self._points), state_dict["kept"]
            own = sent_to(self._comm, rank_of(blocks, kept), kept)
            self._block = self._hold(own - blocks[self._comm.rank])


def _tied(whole: Floats, stuck: Floats, comm: Any) -> _Tied | None:
    """W, or None where I + T0 S is nearly singular: stiff joints that meet, more points than dofs.

    All of S is on every rank, T0 of the rank's unknowns.
    """
    root = np.sqrt(Parts(len(stuck), comm).all_of(stuck))
    inner = root[:, None] * whole * root
    inner[np.diag_indices(len(inner))] += 1.0
    try:
        lower = cholesky(inner, lower=True, overwrite_a=True, check_finite=False)
        regular = float(np.diag(lower).min()) ** 2 > SINGULAR
    except np.linalg.LinAlgError:
        regular = False
    del inner
    if not comm.allreduce(regular, op=MPI.LAND):
        return None
    half = solve_triangular(
        lower, root[:, None] * whole, lower=True, overwrite_b=True, check_finite=False
    )
    return _Tied(RowMatrix.of(whole - half.T @ half, comm, len(stuck)), stuck, comm)


class _Tied:
    """W = S (I + T0 S)^-1, symmetric, and the system of the points that do not stick."""

    def __init__(self, matrix: RowMatrix, stuck: Floats, comm: Any) -> None:
        """Keep W and T0."""
        self.matrix, self._stuck, self._comm = matrix, stuck, comm

    def solve(
        self, residual: Floats, tangent: Floats, changed: Rows, changes: int, tolerance: float
    ) -> Correction:
        """See `Corrections.solve`; ``changed`` are the rank's points where T is not T0.

        There are so many ``changes`` on all ranks.
        """
        known = self.matrix.product(residual, np.flatnonzero(residual))
        coupled, turned, products = known, residual, 0
        if changes:
            rows = unknowns_of(changed)
            block = self.matrix.block(rows)
            change = tangent[changed].copy()
            change[:, [0, 1, 2], [0, 1, 2]] -= self._stuck[rows].reshape(-1, 3)
            # What is left is to be small beside r, and W r may be larger.
            squares = np.array([residual @ residual, known[rows] @ known[rows]])
            of_residual, of_system = summed(self._comm, squares)
            y, products = gmres(
                lambda v: v + block.product(_turned(change, v)),
                known[rows],
                tolerance=tolerance * min(1.0, (of_residual / (of_system or 1.0)) ** 0.5),
                most=MOST_PRODUCTS,
                comm=self._comm,
            )
            taken = np.zeros_like(residual)
            taken[rows] = _turned(change, y)
            turned = residual - taken
            coupled = known - self.matrix.product(taken, rows)
        return Correction(step=turned - self._stuck * coupled, coupled=coupled, products=products)


@njit(cache=True)
def _turned(tangent: Floats, values: Floats) -> Floats:
    """Blocks (n, 3, 3) times a vector (3 n,)."""
    out = np.empty_like(values)
    for i in range(len(tangent)):
        t, a, b, c = tangent[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c
    return out


@njit(cache=True)
def _where(tangent: Floats, diagonal: Floats, same: float) -> Rows:
    """Points whose block differs from a diagonal, given for each or for all."""
    found, count = np.empty(len(tangent), np.int64), 0
    for i in range(len(tangent)):
        expected, differs = diagonal[i % len(diagonal)], False
        for a in range(3):
            for b in range(3):
                value = tangent[i, a, b] - (expected[a] if a == b else 0.0)
                differs = differs or not abs(value) <= same
        if differs:
            found[count] = i
            count += 1
    return found[:count]
