# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections d of the joint forces, (I + T S) d = r (24).

S is the scaled compliance less the identity (22), T the scaled tangent and r the scaled residual,
see `joint_step`. T0 is T if all points stick, W = S (I + T0 S)^-1. Equation numbers are those of
docs/theory. Of M unknowns on all ranks, this rank has m.

`CompiledCorrections` uses compiled functions. Inside corrections S is in single precision or
compressed; Newton's iteration removes the error. The module `compiled.corrections` solves on one of
two sets of points; this module keeps the data.

`KrylovCorrections` uses PETSc's GMRES: in statics, where corrections must be accurate; if S is not
stored, or compressed and not symmetric; and if rigid joints meet, because their sticking points tie
each other. With a controlled load, S also has the change of rank one of (28g).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import cholesky, solve_triangular

from dolfinx_joints.common.arrays import Dealt, Floats, Ints
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.common.mpi import blocks_of, rank_of, sent_to, summed
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.compliance import Compliance, Compressed, Split
from dolfinx_joints.solvers.compliance.row_matrix import Parts, RowMatrix
from dolfinx_joints.solvers.interface.compiled.corrections import COUPLED, STEP, Memory, correct
from dolfinx_joints.solvers.interface.compiled.krylov import space_of
from dolfinx_joints.solvers.interface.compiled.products import (
    Dense,
    LowRank,
    kept_of,
    multiply_whole,
    store,
)
from dolfinx_joints.solvers.interface.compiled.ranks import lengths_of, ranks_of

# Sets of points whose parts of S or W are kept: name in checkpoints, name in `Memory`.
SETS = {"kept": "active", "changed": "changed"}


class Correction(NamedTuple):
    """Correction of the scaled forces.

    Attributes:
        step: d, local unknowns, shape (m,).
        coupled: S d, shape (m,).
        error: Upper bound of the error of S d.
    """

    step: Floats
    coupled: Floats
    error: float


class CompiledCorrections:
    """Solver of the corrections for one compliance, with data that later corrections can reuse.

    Args:
        compliance: S and its scale.
        stuck: T0, the diagonal tangent of the local points if they stick, shape (points, 3); None
            if W cannot be used.
        comm: Communicator of the ranks.

    Attributes:
        rough: Relative error of products with S inside corrections.
    """

    def __init__(self, compliance: Compliance, stuck: Floats | None, comm: Any) -> None:
        """Allocate the memory (collective)."""
        self._compliance, self._comm = compliance, comm
        size, forms = compliance.split.local, _forms_of(compliance, comm)
        self._split, self._inner = forms
        self._blocks = blocks_of(comm, size // 3)
        points = int(self._blocks[-1])
        single = isinstance(self._inner, Dense)
        possible = compliance.split.size <= limits.LARGEST_WHOLE and (
            isinstance(compliance.split, RowMatrix) or compliance.keeps_rows
        )
        self._stuck = stuck if possible else None
        self.rough = limits.SINGLE_ROUNDING if single else limits.ROUGH_COMPRESSION
        self._memory = Memory(
            active=kept_of(size // 3, points, self._inner),
            changed=kept_of(0, 0, self._inner),
            has_complement=False,
            complement=self._inner,
            may_have_complement=self._stuck is not None,
            stuck=np.empty(0) if self._stuck is None else self._stuck.ravel(),
            avoidable=np.zeros(1),
            finest=limits.FINEST_SINGLE if single else limits.FINEST_COMPRESSED,
            space=space_of(size, min(limits.MOST_PRODUCTS, 3 * points)),
            vectors=np.empty((6, size)),
            numbers=np.empty((2, size // 3), dtype=np.int64),
        )

    @staticmethod
    def serves(compliance: Compliance) -> bool:
        """Return True if S is stored in a form that the compiled products can read."""
        return all(
            isinstance(s, RowMatrix) or (isinstance(s, Compressed) and s.matrix.symmetric)
            for s in (compliance.split, compliance.rough or compliance.split)
        )

    def solve(
        self, residual: Floats, tangent: Floats, smallest: float, tolerance: float, *, couples: bool
    ) -> Correction:
        """Solve (I + T S) d = r; the vectors are overwritten by the next call (collective).

        Args:
            residual: r, local unknowns, shape (m,).
            tangent: T of the local points, shape (points, 3, 3).
            smallest: Entries of r up to this size are treated as zero.
            tolerance: Largest residual of the correction, relative to r.
            couples: False if S d is not needed.
        """
        self._make_complement()
        correct(self._inner, residual, tangent, smallest, tolerance, couples, self._memory)
        step, coupled = self._memory.vectors[STEP], self._memory.vectors[COUPLED]
        largest = float(np.abs(coupled).max(initial=0.0)) if couples else 0.0
        if couples and self._comm.size > 1:
            largest = self._comm.allreduce(largest, MPI.MAX)
        return Correction(step, coupled, self.rough * largest)

    def product(self, values: Floats) -> Floats:
        """Return S times a vector, in double precision, shape (m,) (collective)."""
        out = np.empty_like(values)
        multiply_whole(self._split, values, out)
        return out

    def _make_complement(self) -> None:
        """Compute W (25) if it would already have saved a quarter of its cost (collective)."""
        memory, split = self._memory, self._compliance.split
        cost = limits.COMPLEMENT_COST * float(split.size) ** 3
        if memory.has_complement or self._stuck is None or memory.avoidable[0] <= cost:
            return
        whole = split.whole()
        columns = None if whole is None else _complement_of(whole, self._stuck.ravel(), self._comm)
        if columns is None:
            self._stuck = None
            self._memory = memory._replace(may_have_complement=False, stuck=np.empty(0))
            return
        complement = (
            _columns_of(columns, True, self._comm, np.float32)
            if isinstance(self._inner, Dense)
            else _blocks_of(self._compliance.compressed_roughly(columns), columns, self._comm)
        )
        changed = kept_of(split.local // 3, int(self._blocks[-1]), complement)
        self._memory = memory._replace(has_complement=True, complement=complement, changed=changed)

    def state_dict(self) -> dict[str, Any]:
        """Return the state that affects later corrections (collective)."""
        return {"avoidable": float(self._memory.avoidable[0])} | {
            name: Dealt(self._comm, self._numbers(name))
            for name in SETS
            if getattr(self._memory, SETS[name]).number[0] >= 0
        }

    def _numbers(self, name: str) -> NDArray[np.int64]:
        """Return the global numbers of the local points in a set."""
        last = getattr(self._memory, SETS[name]).number[0]
        own: NDArray[np.int64] = getattr(self._memory, SETS[name]).points[:last]
        return own + self._blocks[self._comm.rank]

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the ``state_dict`` of another object (collective)."""
        self._memory.avoidable[0] = state_dict["avoidable"]
        self._make_complement()
        if "kept" in state_dict:
            kept = self._points_of_rank(state_dict["kept"])
            store(self._inner, self._memory.active, kept, len(kept))
        if "changed" in state_dict and self._memory.has_complement:
            changed = self._points_of_rank(state_dict["changed"])
            store(self._memory.complement, self._memory.changed, changed, len(changed))

    def _points_of_rank(self, points: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the local numbers of this rank's points among distributed points (collective)."""
        own = sent_to(self._comm, rank_of(self._blocks, points), points)
        return own - self._blocks[self._comm.rank]


def _complement_of(whole: Floats, stuck: Floats, comm: Any) -> Floats | None:
    """Return the columns of W = S (I + T0 S)^-1 at local unknowns, shape (M, m) (collective).

    Return None if I + T0 S is nearly singular, as with stiff joints that meet and have more points
    than dofs. Each rank passes all of S, but T0 only for the local unknowns.
    """
    root = np.sqrt(Parts(len(stuck), comm).all_of(stuck))
    inner = root[:, None] * whole * root
    inner[np.diag_indices(len(inner))] += 1.0
    try:
        lower = cholesky(inner, lower=True, overwrite_a=True, check_finite=False)
        regular = float(np.diag(lower).min()) ** 2 > limits.COMPLEMENT_PIVOT
    except np.linalg.LinAlgError:
        regular = False
    del inner
    if not comm.allreduce(regular, op=MPI.LAND):
        return None
    half = solve_triangular(
        lower, root[:, None] * whole, lower=True, overwrite_b=True, check_finite=False
    )
    return RowMatrix.of(whole - half.T @ half, comm, len(stuck)).columns()


def _forms_of(compliance: Compliance, comm: Any) -> tuple[Dense | LowRank, Dense | LowRank]:
    """Return S, and S inside corrections, in the form of the compiled functions (collective).

    Runs that share a compliance share these forms and their work arrays, because only one run
    iterates at a time.
    """
    if compliance.forms is None:
        split, rough = compliance.split, compliance.rough
        symmetric = compliance.effective.symmetric
        inner: Dense | LowRank
        if isinstance(split, RowMatrix):
            columns = split.columns()
            form: Dense | LowRank = _columns_of(columns, symmetric, comm)
        else:
            assert isinstance(split, Compressed)
            form = _blocks_of(split, None, comm)
        if rough is None:
            assert isinstance(split, RowMatrix)
            inner = _columns_of(columns, symmetric, comm, np.float32)
        else:
            assert isinstance(rough, Compressed)
            assert isinstance(split, RowMatrix | Compressed)
            keeps_columns = compliance.keeps_rows and split.size <= limits.LARGEST_WHOLE
            inner = _blocks_of(rough, split.columns() if keeps_columns else None, comm)
        compliance.forms = form, inner
    made: tuple[Dense | LowRank, Dense | LowRank] = compliance.forms
    return made


def _columns_of(columns: Floats, symmetric: bool, comm: Any, dtype: type = np.float64) -> Dense:
    """Return the compiled form of the local columns of a dense S, shape (M, m) (collective)."""
    size, local = columns.shape
    return Dense(
        ranks_of(comm),
        np.ascontiguousarray(columns, dtype),
        symmetric and comm.size == 1,
        np.empty((2, local), dtype),
        np.empty(size, dtype=np.int64),
        lengths_of(8 * np.array(Parts(local, comm).counts)),
        np.empty(size if comm.size > 1 else 0),
    )


def _blocks_of(split: Compressed, columns: Floats | None, comm: Any) -> LowRank:
    """Return the compiled form of a compressed S, with the local columns if given (collective)."""
    own, (table, shares, lengths) = split.matrix.own, split.matrix.joined()
    return LowRank(
        ranks_of(comm),
        own.blocks,
        own.data,
        table,
        shares,
        lengths_of(own.data.itemsize * np.array(lengths)),
        np.empty((2, sum(lengths)), dtype=own.data.dtype),
        own.order,
        np.argsort(own.order),
        split.live,
        np.empty((2, own.size), dtype=own.data.dtype),
        float(comm.allreduce(len(own.data) + len(shares))),
        np.empty((0, 0), dtype=np.float32) if columns is None else columns.astype(np.float32),
    )


class KrylovCorrections:
    """Solver of the corrections by products with S.

    Args:
        compliance: S and its scale.
        rigid: True if some joint is rigid.
        comm: Communicator of the ranks.

    Attributes:
        controlled: Vectors of `ControlledMatrix.gaps`, None without a controlled load.
    """

    rough = 0.0  # relative error of S d
    controlled: tuple[Floats, Floats] | None = None

    def __init__(self, compliance: Compliance, rigid: bool, comm: Any) -> None:
        """Set up the solver (collective)."""
        self._split, self._comm = compliance.split, comm
        self._inner, self._finest = compliance.split, 0.0
        if compliance.rough is not None and not isinstance(compliance.split, RowMatrix):
            self._inner, self._finest = compliance.rough, limits.FINEST_COMPRESSED
        self._diagonal = 1.0 + limits.RIGID_DAMPING * rigid
        self._all_rows = np.arange(self._split.local)
        sizes = (self._split.local, self._split.size)
        self._matrix = PETSc.Mat().createPython((sizes, sizes), self, comm=comm)
        self._solver = PETSc.KSP().create(comm)
        self._solver.setOptionsPrefix("dolfinx_joints_corrections_")
        self._solver.setOperators(self._matrix)
        self._solver.setType(PETSc.KSP.Type.GMRES)
        self._solver.setGMRESRestart(limits.MOST_PRODUCTS)
        self._solver.getPC().setType(PETSc.PC.Type.NONE)
        self._solver.setFromOptions()
        self._right_hand_side, self._solution = self._matrix.createVecs()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write (I + T S) x to y (collective)."""
        values = x.getArray(readonly=True)
        coupled = self._times(self._inner, values, self._all_rows)
        y.setArray(self._diagonal * values + _times_blocks(self._tangent, coupled))

    def solve(
        self, residual: Floats, tangent: Floats, smallest: float, tolerance: float, *, couples: bool
    ) -> Correction:
        """Solve (I + T S) d = r; see `CompiledCorrections.solve` (collective)."""
        self._tangent = tangent
        self._right_hand_side.setArray(np.where(np.abs(residual) > smallest, residual, 0.0))
        largest_count = min(limits.MOST_PRODUCTS, self._split.size)
        rtol = max(tolerance, self._finest)
        self._solver.setTolerances(rtol=rtol, atol=0.0, divtol=np.inf, max_it=largest_count)
        self._solver.solve(self._right_hand_side, self._solution)
        step = self._solution.getArray().copy()
        return Correction(step, self.product(step), 0.0)

    def product(self, values: Floats) -> Floats:
        """Return S times a vector, shape (m,) (collective)."""
        return self._times(self._split, values, np.flatnonzero(values))

    def _times(self, split: Split, values: Floats, rows: Ints) -> Floats:
        """Return S times a vector; ``split`` is S without the controlled load (collective)."""
        coupled = split.product(values, rows)
        if self.controlled is None:
            return coupled
        column, row = self.controlled
        return coupled - column * summed(self._comm, np.array(row @ values))

    def state_dict(self) -> dict[str, Any]:
        """Return an empty state: corrections do not depend on earlier ones."""
        return {}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Do nothing: there is no state."""

    def free(self) -> None:
        """Free the solver (collective)."""
        for owned in (self._solver, self._matrix, self._right_hand_side, self._solution):
            owned.destroy()


@njit(cache=True)
def _times_blocks(tangent: Floats, values: Floats) -> Floats:
    """Return blocks (n, 3, 3) times a vector (3 n,)."""
    out = np.empty_like(values)
    for i in range(len(tangent)):
        t, a, b, c = tangent[i], values[3 * i], values[3 * i + 1], values[3 * i + 2]
        out[3 * i] = t[0, 0] * a + t[0, 1] * b + t[0, 2] * c
        out[3 * i + 1] = t[1, 0] * a + t[1, 1] * b + t[1, 2] * c
        out[3 * i + 2] = t[2, 0] * a + t[2, 1] * b + t[2, 2] * c
    return out
