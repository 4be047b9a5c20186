# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that the compiled iteration takes for one compliance, and what it keeps between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.dealt import Dealt
from dolfinx_joints.common.mpi import blocks_of, rank_of, sent_to
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import DISCRETE_GRADIENT, JointState, Response, Rule
from dolfinx_joints.laws.return_mapping import Answer, Start, empty_answer
from dolfinx_joints.solvers.interface.compiled.corrections import FINEST_SINGLE, Memory
from dolfinx_joints.solvers.interface.compiled.deflation import Deflation, deflation_of
from dolfinx_joints.solvers.interface.compiled.iteration import Iterates, Limits, Points, iterate
from dolfinx_joints.solvers.interface.compiled.krylov import space_of
from dolfinx_joints.solvers.interface.compiled.products import (
    Dense,
    LowRank,
    kept_of,
    take,
)
from dolfinx_joints.solvers.interface.compiled.ranks import lengths_of, ranks_of
from dolfinx_joints.solvers.interface.compliance import (
    LARGEST_WHOLE,
    ROUGH_TOLERANCE,
    Compliance,
    Compressed,
    Split,
)
from dolfinx_joints.solvers.interface.corrections import FINEST, MOST_PRODUCTS, Corrections
from dolfinx_joints.solvers.interface.ranked_low_rank import RankedLowRankMatrix
from dolfinx_joints.solvers.interface.row_matrix import Parts, RowMatrix

Floats = NDArray[np.float64]

# Error of products in single precision, relative to them.
SINGLE_ERROR = 1e-6


@dataclass(frozen=True, kw_only=True)
class Solved:
    """The joint forces of a step.

    Attributes:
        force: Scaled forces f - r, shape (m,).
        response: Of the points.
        iterations: Iterations.
        relative: Residual relative to the largest force.
    """

    force: Floats
    response: Response
    iterations: int
    relative: float


class CompiledSteps:
    """Solves steps with one compliance.

    Args:
        contact: The joints; all laws have loops.
        compliance: S and its scale.
        corrections: Of the same, for W and when it is made.
        areas: Area of the rank's points, three per point, shape (m,), [m^2].
    """

    def __init__(
        self, contact: Contact, compliance: Compliance, corrections: Corrections, areas: Floats
    ) -> None:
        """Set the room aside (collective)."""
        self._contact, self._compliance, self._corrections = contact, compliance, corrections
        self._comm = contact.operator.comm
        size, forms = len(areas), _forms_of(compliance, self._comm)
        self._split, self._inner, self._ranks = forms.split, forms.inner, forms.split.ranks
        self._blocks = blocks_of(self._comm, size // 3)
        points = int(self._blocks[-1])
        self._own, dead = np.ascontiguousarray(compliance.own), compliance.dead.ravel()
        self._scale = np.where(dead, 0.0, compliance.scale)
        self._root = areas * self._scale
        self._iterates: Iterates | None = None
        single = isinstance(self._inner, Dense)
        stuck = corrections.stuck
        self._rough = SINGLE_ERROR if single else ROUGH_TOLERANCE
        self._memory = Memory(
            active=kept_of(size // 3, points, self._inner),
            changed=kept_of(0, 0, self._inner),
            ties=False,
            tied=self._inner,
            has_stuck=stuck is not None,
            stuck=np.empty(0) if stuck is None else stuck.ravel(),
            missed=np.array([corrections.missed]),
            finest=FINEST_SINGLE if single else FINEST,
            space=space_of(size, min(MOST_PRODUCTS, 3 * points)),
            deflation=forms.deflation,
            none=deflation_of(None, self._comm),
            vectors=np.empty((6, size)),
            numbers=np.empty((2, size // 3), dtype=np.int64),
        )

    @staticmethod
    def serves(contact: Contact, compliance: Compliance) -> bool:
        """Whether it can: laws with loops, S kept."""
        return contact.has_loops and all(
            isinstance(s, RowMatrix) or (isinstance(s, Compressed) and s.matrix.symmetric)
            for s in _splits(compliance)
        )

    def solve(
        self,
        trial_gap: Floats,
        state: JointState,
        rule: Rule,
        starts: Sequence[tuple[Floats, Floats]],
        limits: Limits,
    ) -> Solved | None:
        """The joint forces of a step, None where the iteration does not converge (collective).

        Args:
            trial_gap: Gap without joint forces, shape (n, 3), [m].
            state: State of the joints at the start.
            rule: How laws are asked.
            starts: One or two starts, f and S f.
            limits: Limits.
        """
        self._memory.missed[0] = self._corrections.missed
        self._tie()
        start = self._contact.start_of_loops(rule, state)
        points = Points(
            ranks=self._ranks,
            first=int(self._blocks[self._comm.rank]),
            whole_step=rule.name == DISCRETE_GRADIENT.name,
            start=start,
            trial_gap=trial_gap,
            own=self._own,
            scale=self._scale,
            root=self._root,
        )
        iterates, limits = self._room(start), limits._replace(rough=self._rough)
        for i, (force, coupled) in enumerate(starts):
            iterates.force[i], iterates.coupled[i] = force, coupled
        converged, last, iterations, relative = iterate(
            points, self._split, self._inner, iterates, len(starts), limits, self._memory
        )
        self._corrections.missed = float(self._memory.missed[0])
        if not converged:
            return None
        answer = Answer._make(array[last].copy() for array in iterates.answer)
        return Solved(
            force=iterates.force[last] - iterates.residual[last],
            response=self._contact.answered_by_loops(rule, answer),
            iterations=iterations,
            relative=relative,
        )

    def _tie(self) -> None:
        """Take up W once it pays (collective)."""
        if self._memory.has_stuck and not self._memory.ties:
            columns = self._corrections.tied()
            if columns is not None:
                tied = (
                    _columns_of(columns, True, self._comm, np.float32)
                    if isinstance(self._inner, Dense)
                    else _blocks_of(self._compliance.roughly(columns), columns, self._comm)
                )
                changed = kept_of(len(self._own), int(self._blocks[-1]), tied)
                self._memory = self._memory._replace(ties=True, tied=tied, changed=changed)
            elif self._corrections.stuck is None:
                self._memory = self._memory._replace(has_stuck=False, stuck=np.empty(0))

    def _room(self, start: Start) -> Iterates:
        """Iterates for a history of this length."""
        known = self._iterates
        if known is None or known.answer.history.shape[1:] != start.history.shape:
            self._iterates = known = _iterates_of(start)
        return known

    def state_dict(self) -> dict[str, Any]:
        """Sets that later corrections depend on; the rest is in that of `Corrections`.

        (Collective.)
        """
        first = self._blocks[self._comm.rank]
        counts = {
            "kept": self._memory.active.number[0],
            "changed": self._memory.changed.number[0],
        }
        points = {"kept": self._memory.active.points, "changed": self._memory.changed.points}
        return {
            name: Dealt(self._comm, points[name][:count] + first)
            for name, count in counts.items()
            if count >= 0
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave (collective)."""
        self._tie()
        if "kept" in state_dict:
            kept = self._own_of(state_dict["kept"])
            take(self._inner, self._memory.active, kept, len(kept))
        if "changed" in state_dict and self._memory.ties:
            changed = self._own_of(state_dict["changed"])
            take(self._memory.tied, self._memory.changed, changed, len(changed))

    def _own_of(self, points: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of this rank among points that are dealt (collective)."""
        own = sent_to(self._comm, rank_of(self._blocks, points), points)
        return own - self._blocks[self._comm.rank]


class _Forms(NamedTuple):
    """S, S inside corrections, and its largest eigenvalues, as the compiled functions take them.

    Runs that share a compliance share these, room included: they iterate one after the other.
    """

    split: Dense | LowRank
    inner: Dense | LowRank
    deflation: Deflation


def _forms_of(compliance: Compliance, comm: Any) -> _Forms:
    """Those of a compliance, made once (collective)."""
    if compliance.forms is None:
        split, inner = _splits(compliance)
        # A run that waited for others here would hold the lock of what finds eigenvalues.
        alone = split.alone if isinstance(split, Compressed) else split
        few = compliance.keeps_rows and split.size <= LARGEST_WHOLE
        deflates = compliance.effective.symmetric and (few or comm.size == 1)
        known = deflation_of(alone if deflates else None, comm)
        if isinstance(split, RowMatrix) and isinstance(inner, RowMatrix):
            columns, symmetric = split.columns(), compliance.effective.symmetric
            single = _columns_of(columns, symmetric, comm, np.float32)
            forms = _Forms(_form_of(compliance, comm), single, known)
        else:
            assert isinstance(split, RowMatrix | Compressed)
            assert isinstance(inner, Compressed)
            beside = split.columns() if few else None
            rough = _blocks_of(inner, beside, comm)
            forms = _Forms(_form_of(compliance, comm), rough, known)
        compliance.forms = forms
    made: _Forms = compliance.forms
    return made


def _splits(compliance: Compliance) -> tuple[Split, Split]:
    """S, and S as it is inside corrections."""
    return compliance.split, compliance.rough or compliance.split


def _form_of(compliance: Compliance, comm: Any) -> Dense | LowRank:
    """S as the compiled functions take it (collective)."""
    split = compliance.split
    if isinstance(split, RowMatrix):
        return _columns_of(split.columns(), compliance.effective.symmetric, comm)
    assert isinstance(split, Compressed)
    return _blocks_of(split, None, comm)


def _columns_of(columns: Floats, symmetric: bool, comm: Any, dtype: type = np.float64) -> Dense:
    """The rank's columns of a dense S, shape (M, m) (collective)."""
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
    """A compressed S, beside the rank's columns of it if given (collective)."""
    matrix = split.matrix
    if isinstance(matrix, RankedLowRankMatrix):
        own, (table, shares, lengths) = matrix.own, matrix.joined()
    else:
        own, table, lengths = matrix, np.empty((0, 5), dtype=np.int64), [0]
        shares = np.empty(0, dtype=own.data.dtype)
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


def _iterates_of(start: Start) -> Iterates:
    points = len(start.gap)
    one = empty_answer(start.gap, start.history)
    force, coupled, residual = np.zeros((3, 3, 3 * points))
    return Iterates(
        force,
        coupled,
        residual,
        np.zeros((3, points, 3, 3)),
        Answer._make(np.zeros((3, *array.shape), array.dtype) for array in one),
        np.zeros((3, 5)),
    )
