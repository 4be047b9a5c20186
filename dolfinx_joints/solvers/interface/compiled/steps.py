# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that the compiled iteration takes for one compliance, and what it keeps between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from dolfinx_joints.solvers.interface.compliance import (
    ROUGH_TOLERANCE,
    Compliance,
    Compressed,
    Split,
)
from dolfinx_joints.solvers.interface.corrections import FINEST, MOST_PRODUCTS, Corrections
from dolfinx_joints.solvers.interface.low_rank import LowRankMatrix
from dolfinx_joints.solvers.interface.row_matrix import RowMatrix

Floats = NDArray[np.float64]

# The whole of S is kept in single precision beside a compressed one up to so many unknowns: 0.15 GB
LARGEST_WHOLE = 6000

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
    """Solves steps with one compliance on one rank.

    Args:
        contact: The joints; all laws have loops.
        compliance: S and its scale.
        corrections: Of the same, for W and when it is made.
        areas: Area of the points, three per point, shape (m,), [m^2].
    """

    def __init__(
        self, contact: Contact, compliance: Compliance, corrections: Corrections, areas: Floats
    ) -> None:
        """Set the room aside."""
        self._contact, self._compliance, self._corrections = contact, compliance, corrections
        size, forms = len(areas), _forms_of(compliance)
        self._split, self._inner = forms.split, forms.inner
        self._own, dead = np.ascontiguousarray(compliance.own), compliance.dead.ravel()
        self._scale = np.where(dead, 0.0, compliance.scale)
        self._root = areas * self._scale
        self._iterates: Iterates | None = None
        single = isinstance(self._inner, Dense)
        stuck = corrections.stuck
        self._rough = SINGLE_ERROR if single else ROUGH_TOLERANCE
        self._memory = Memory(
            active=kept_of(size // 3, self._inner),
            changed=kept_of(0 if stuck is None else size // 3, self._inner),
            ties=False,
            tied=self._inner,
            stuck=np.empty(0) if stuck is None else stuck.ravel(),
            missed=np.array([corrections.missed]),
            finest=FINEST_SINGLE if single else FINEST,
            space=space_of(size, min(MOST_PRODUCTS, size)),
            deflation=forms.deflation,
            none=deflation_of(None),
            vectors=np.empty((6, size)),
            numbers=np.empty((3, size), dtype=np.int64),
        )

    @staticmethod
    def serves(contact: Contact, compliance: Compliance) -> bool:
        """Whether it can: one rank, laws with loops, S kept."""
        if contact.operator.comm.size > 1 or not contact.has_loops:
            return False
        return all(
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
        """The joint forces of a step, None where the iteration does not converge.

        Args:
            trial_gap: Gap without joint forces, shape (n, 3), [m].
            state: State of the joints at the start.
            rule: How laws are asked.
            starts: One or two starts, f and S f.
            limits: Limits.
        """
        self._memory.missed[0] = self._corrections.missed
        self._tie()
        start, live = self._contact.start_of_loops(rule, state), self._scale > 0.0
        passed = np.maximum(np.abs(trial_gap), np.abs(state.gap)).ravel()[live]
        points = Points(
            whole_step=rule.name == DISCRETE_GRADIENT.name,
            start=start,
            trial_gap=trial_gap,
            own=self._own,
            scale=self._scale,
            root=self._root,
            reach=float((passed / self._scale[live]).max(initial=0.0)),
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
        """Take up W once it pays."""
        if len(self._memory.stuck) and not self._memory.ties:
            whole = self._corrections.tied()
            if whole is not None:
                dense = isinstance(self._inner, Dense)
                tied = (
                    _rows_of(whole, np.float32)
                    if dense
                    else _blocks_of(self._compliance.roughly(whole), whole)
                )
                self._memory = self._memory._replace(ties=True, tied=tied)
            elif self._corrections.stuck is None:
                self._memory = self._memory._replace(stuck=np.empty(0))

    def _room(self, start: Start) -> Iterates:
        """Iterates for a history of this length."""
        known = self._iterates
        if known is None or known.answer.history.shape[1:] != start.history.shape:
            self._iterates = known = _iterates_of(start)
        return known

    def state_dict(self) -> dict[str, Any]:
        """Sets that later corrections depend on; the rest is in that of `Corrections`."""
        kept = {"kept": self._memory.active, "changed": self._memory.changed}
        return {
            name: each.points[: each.number[0]].copy()
            for name, each in kept.items()
            if each.number[0] >= 0
        }

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take up what another's ``state_dict`` gave."""
        self._tie()
        if "kept" in state_dict:
            kept = state_dict["kept"]
            take(self._inner, self._memory.active, kept, len(kept))
        if "changed" in state_dict and self._memory.ties:
            changed = state_dict["changed"]
            take(self._memory.tied, self._memory.changed, changed, len(changed))


class _Forms(NamedTuple):
    """S, S inside corrections, and its largest eigenvalues, as the compiled functions take them.

    Runs that share a compliance share these, room included: they iterate one after the other.
    """

    split: Dense | LowRank
    inner: Dense | LowRank
    deflation: Deflation


def _forms_of(compliance: Compliance) -> _Forms:
    if compliance.forms is None:
        split, inner = _splits(compliance)
        # A run that waited for others here would hold the lock of what finds eigenvalues.
        alone = split.alone if isinstance(split, Compressed) else split
        known = deflation_of(alone if compliance.effective.symmetric else None)
        beside = split.whole() if split.size <= LARGEST_WHOLE else None
        compliance.forms = _Forms(_form_of(split, None), _form_of(inner, beside, np.float32), known)
    forms: _Forms = compliance.forms
    return forms


def _splits(compliance: Compliance) -> tuple[Split, Split]:
    """S, and S as it is inside corrections."""
    return compliance.split, compliance.rough or compliance.split


def _form_of(split: Split, whole: Floats | None, dtype: type = np.float64) -> Dense | LowRank:
    """S as the compiled functions take it, a compressed one beside its whole if that is given."""
    if isinstance(split, RowMatrix):
        return _rows_of(split.whole(), dtype)
    assert isinstance(split, Compressed)
    return _blocks_of(split, whole)


def _rows_of(whole: Floats, dtype: type = np.float64) -> Dense:
    return Dense(whole.astype(dtype, copy=False), np.empty(len(whole), dtype))


def _blocks_of(split: Compressed, whole: Floats | None) -> LowRank:
    matrix = split.matrix
    assert isinstance(matrix, LowRankMatrix)  # of one rank
    return LowRank(
        matrix.blocks,
        matrix.data,
        matrix.order,
        split.live,
        np.empty((2, matrix.size), dtype=matrix.data.dtype),
        np.empty((0, 0), dtype=np.float32) if whole is None else whole.astype(np.float32),
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
        np.zeros((3, 4)),
    )
