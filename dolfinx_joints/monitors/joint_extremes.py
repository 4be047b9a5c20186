# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Extremes, integrals and means over each joint at every step, with terms of sliding safety."""

from __future__ import annotations

import numpy as np

from dolfinx_joints.common.arrays import Dealt, Floats
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.laws.law import Response
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.resultants import JointForces, breakable_joints
from dolfinx_joints.postprocessing.joints.extremes import ALIKE
from dolfinx_joints.results.quantities import at_points, rows_by

# Rows of the table of quantities by kind, and columns of maxima whose positions are recorded.
_LARGEST, _PLACES = rows_by("largest"), rows_by("place")
_SUMS, _MEANS = rows_by("integral"), rows_by("mean")
_PLACED = [[row.key for row in _LARGEST].index(row.key.removesuffix("_at")) for row in _PLACES]


class JointExtremesStream:
    """Stream ``joints`` of a results file; each rank reduces its own points first.

    Args:
        model: The model, with joints.
        gap: Gaps of the local points from which slip is measured, shape (n, 3), [m].

    Attributes:
        shapes: Empty array of the shape of each series, by name in the order of the values.
    """

    def __init__(self, model: Model, gap: Floats) -> None:
        """Determine the series of each joint (collective)."""
        assert model.operator is not None
        assert model.contact is not None
        self._operator, self._gap = model.operator, gap.copy()
        self._tied, self._forces = model.contact.tied, JointForces(model)
        rows, bonded = (*_LARGEST, *_PLACES, *_SUMS, *_MEANS), breakable_joints(model.contact)
        has = [[not r.rare or joint in bonded for r in rows] for joint in model.operator.names]
        sizes = [3 if row.by == "place" else 1 for row in rows]
        self._recorded = np.repeat(has, sizes, axis=1)
        self.shapes = {
            row.name.replace("*", joint): np.empty(3 if row.by == "place" else ())
            for joint, has_row in zip(model.operator.names, has, strict=True)
            for row, recorded in zip(rows, has_row, strict=True)
            if recorded
        }
        self._order = np.argsort(model.operator.joint, kind="stable")
        self._joints, self._starts = np.unique(model.operator.joint[self._order], return_index=True)
        # Values below the rounding error of coordinates (1e-35 m for example) count as zero.
        points = model.operator.points
        ends = np.array([points.min(initial=np.inf), -points.max(initial=-np.inf)])
        lowest, highest = of_ranks(model.operator.comm, ends).min(axis=0)
        self._rounding = np.finfo(np.float64).eps * float(-highest - lowest)

    def values(self, joints: Response) -> Floats:
        """Return the values of a step in the order of `shapes` (collective)."""
        operator, points = self._operator, self._forces.points(joints, self._gap)
        local = np.maximum(at_points(_LARGEST, points), 0.0)
        local[self._tied] = 0.0
        names, count = operator.names, len(_LARGEST)
        reduced = np.zeros((len(names), count + len(_SUMS) + len(_MEANS)))
        if len(local):
            reduced[self._joints, :count] = np.maximum.reduceat(local[self._order], self._starts)
        integrands = at_points((*_SUMS, *_MEANS), points) * self._forces.areas[:, None]
        for column, integrand in enumerate(integrands.T, start=count):
            reduced[:, column] = np.bincount(operator.joint, integrand, len(names))
        by_rank = of_ranks(operator.comm, reduced)
        largest, sums = by_rank[..., :count].max(axis=0), by_rank[..., count:].sum(axis=0)
        sums[:, len(_SUMS) :] /= self._forces.free_area[:, None]
        places = self._places(local[:, _PLACED], largest[:, _PLACED])
        rows = np.concatenate([largest, places.reshape(len(places), -1), sums], axis=1)
        return np.asarray(rows[self._recorded])

    def _places(self, local: Floats, largest: Floats) -> Floats:
        """Return positions of the largest values in each joint, shape (joints, m, 3)."""
        operator = self._operator
        first = np.full(largest.shape, len(local))
        is_largest = (local > self._rounding) & (local >= ALIKE * largest[operator.joint])
        point, column = np.nonzero(is_largest)
        np.minimum.at(first, (operator.joint[point], column), point)
        nowhere = np.full((1, 3), np.nan)
        by_rank = of_ranks(operator.comm, np.concatenate([operator.points, nowhere])[first])
        rank = (~np.isnan(by_rank[..., :1])).argmax(axis=0)  # The first rank has the first point.
        return np.asarray(np.take_along_axis(by_rank, rank[None], axis=0)[0])

    def state_dict(self) -> Dealt:
        """Return the gaps from which slip is measured (collective)."""
        return Dealt(self._operator.comm, self._gap)

    def load_state_dict(self, gap: Floats) -> None:
        """Restore the gaps of this rank's points from ``state_dict``."""
        self._gap = gap.copy()
