# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Extremes, integrals and means over each joint at every step, and maxima of its points."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Flags, Floats
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.resultants import JointForces
from dolfinx_joints.postprocessing.joints.extremes import ALIKE
from dolfinx_joints.results.quantities import TABLE, JointPoints, at_points, rows_by

# Rows of the table of quantities by kind, and columns of maxima whose positions are recorded.
_LARGEST, _PLACES = rows_by("largest"), rows_by("place")
_SUMS, _MEANS = rows_by("integral"), rows_by("mean")
_SLIP = [row.key for row in _LARGEST].index("slip")
_PLACED = [[row.key for row in _LARGEST].index(row.key.removesuffix("_at")) for row in _PLACES]


class JointExtremesStream:
    """Stream ``joints`` of a results file; each rank reduces its own points first.

    Attributes:
        forces: Sums over the points of each joint.
        maxima: Rows of the stream ``joint_maxima`` at the points of this rank, shape (rows, n).
    """

    def __init__(self, model: Model) -> None:
        """Determine the series of each joint (collective)."""
        assert model.operator is not None
        assert model.contact is not None
        self._operator, self._tied = model.operator, model.contact.tied
        self.forces = JointForces(model)
        self.maxima: Floats = np.zeros((len(TABLE["joint_maxima"]), len(model.operator.joint)))
        # The points of a joint are consecutive.
        self._joints, self._starts = np.unique(model.operator.joint, return_index=True)
        # Values below the rounding error of coordinates (1e-35 m for example) count as zero.
        points = model.operator.points
        ends = np.array([points.min(initial=np.inf), -points.max(initial=-np.inf)])
        lowest, highest = of_ranks(model.operator.comm, ends).min(axis=0)
        self._rounding = np.finfo(np.float64).eps * float(-highest - lowest)

    def values(self, points: JointPoints, sliding: Flags) -> dict[str, Floats]:
        """Return the series of consecutive steps by name, a row for each step (collective).

        ``sliding`` is True at sliding points, shape (steps, n).
        """
        count, operator = len(_LARGEST), self._operator
        # The first rows of the maxima are those of _LARGEST.
        local = np.maximum(at_points(TABLE["joint_maxima"], points), 0.0)
        local[..., self._tied] = 0.0
        slid = (sliding & (local[_SLIP] > 0.0)).any(axis=0)
        np.maximum(self.maxima, [*local.max(axis=1), slid], out=self.maxima)
        local = local[:count]
        largest = np.zeros((*local.shape[:-1], len(operator.names)))
        self._reduce(np.maximum, local, largest)
        integrands = at_points((*_SUMS, *_MEANS), points) * self.forces.areas
        by_rank = np.concatenate([largest, self.forces.local_sums(integrands)])
        by_rank = of_ranks(operator.comm, by_rank)
        largest, sums = by_rank[:, :count].max(axis=0), by_rank[:, count:].sum(axis=0)
        sums[len(_SUMS) :] /= self.forces.free_area
        columns = [*largest, *self._places(local[_PLACED], largest[_PLACED]), *sums]
        rows = (*_LARGEST, *_PLACES, *_SUMS, *_MEANS)
        return {
            row.name.replace("*", joint): values[:, number]
            for number, joint in enumerate(operator.names)
            for row, values in zip(rows, columns, strict=True)
            if not row.rare or joint in self.forces.bonded
        }

    def _places(self, local: Floats, largest: Floats) -> Floats:
        """Return positions of the largest values in each joint, shape (m, steps, joints, 3)."""
        operator, count = self._operator, local.shape[-1]
        least = np.maximum(ALIKE * largest, np.nextafter(self._rounding, np.inf))
        first = np.full(largest.shape, count)
        is_largest = local >= least.take(operator.joint, axis=-1)
        self._reduce(np.minimum, np.where(is_largest, np.arange(count), count), first)
        nowhere = np.full((1, 3), np.nan)
        by_rank = of_ranks(operator.comm, np.concatenate([operator.points, nowhere])[first])
        rank = (~np.isnan(by_rank[..., :1])).argmax(axis=0)  # The first rank has the first point.
        return np.asarray(np.take_along_axis(by_rank, rank[None], axis=0)[0])

    def _reduce(self, ufunc: np.ufunc, local: Any, by_joint: Any) -> None:
        """Reduce values (..., n) to joints (..., joints); joints without local points are kept."""
        if len(self._starts):
            by_joint[..., self._joints] = ufunc.reduceat(local, self._starts, axis=-1)
