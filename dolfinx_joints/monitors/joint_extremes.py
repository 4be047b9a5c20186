# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Extremes and means of each joint, and what its safety is made of, at every step."""

from __future__ import annotations

import numpy as np

from dolfinx_joints.common.arrays import Dealt, Floats
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.laws.law import Response
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.resultants import JointForces, broken_joints
from dolfinx_joints.postprocessing.joints.extremes import ALIKE
from dolfinx_joints.results.quantities import at_points, rows_by

# Rows of the table in the order of their numbers, and columns of the values whose places are known.
_LARGEST, _PLACES = rows_by("largest"), rows_by("place")
_SUMS, _MEANS = rows_by("integral"), rows_by("mean")
_PLACED = [[row.key for row in _LARGEST].index(row.key.removesuffix("_at")) for row in _PLACES]


class JointExtremesStream:
    """The stream ``joints`` of a results file; on each rank the reductions of its own points.

    Args:
        model: The model, with joints.
        gap: Gaps of the local points from which slip counts, shape (n, 3), [m].

    Attributes:
        shapes: Arrays of the shapes of the series by name, in the order of the numbers.
    """

    def __init__(self, model: Model, gap: Floats) -> None:
        """Find the joints (collective)."""
        assert model.operator is not None
        assert model.contact is not None
        self._operator, self._gap = model.operator, gap.copy()
        self._tied, self._forces = model.contact.tied, JointForces(model)
        rows, bonded = (*_LARGEST, *_PLACES, *_SUMS, *_MEANS), broken_joints(model.contact)
        there = [[not r.rare or joint in bonded for r in rows] for joint in model.operator.names]
        sizes = [3 if row.by == "place" else 1 for row in rows]
        self._recorded = np.repeat(there, sizes, axis=1)
        self.shapes = {
            row.name.replace("*", joint): np.empty(3 if row.by == "place" else ())
            for joint, each in zip(model.operator.names, there, strict=True)
            for row, is_there in zip(rows, each, strict=True)
            if is_there
        }
        self._order = np.argsort(model.operator.joint, kind="stable")
        self._here, self._starts = np.unique(model.operator.joint[self._order], return_index=True)
        # Ways below the rounding of coordinates are zero, though a sum left 1e-35 m of some.
        points = model.operator.points
        ends = np.array([points.min(initial=np.inf), -points.max(initial=-np.inf)])
        least, most = of_ranks(model.operator.comm, ends).min(axis=0)
        self._least = np.finfo(np.float64).eps * float(-most - least)

    def values(self, joints: Response) -> Floats:
        """Numbers of a step in the order of `shapes` (collective)."""
        operator, points = self._operator, self._forces.points(joints, self._gap)
        here = np.maximum(at_points(_LARGEST, points), 0.0)
        here[self._tied] = 0.0
        names, count = operator.names, len(_LARGEST)
        own = np.zeros((len(names), count + len(_SUMS) + len(_MEANS)))
        if len(here):
            own[self._here, :count] = np.maximum.reduceat(here[self._order], self._starts)
        integrands = at_points((*_SUMS, *_MEANS), points) * self._forces.areas[:, None]
        for column, each in enumerate(integrands.T, start=count):
            own[:, column] = np.bincount(operator.joint, each, len(names))
        every = of_ranks(operator.comm, own)
        largest, sums = every[..., :count].max(axis=0), every[..., count:].sum(axis=0)
        sums[:, len(_SUMS) :] /= self._forces.free_area[:, None]
        places = self._places(here[:, _PLACED], largest[:, _PLACED])
        rows = np.concatenate([largest, places.reshape(len(places), -1), sums], axis=1)
        return np.asarray(rows[self._recorded])

    def _places(self, here: Floats, largest: Floats) -> Floats:
        """Where values (n, m) of the points are the largest of their joint, (joints, m, 3)."""
        operator = self._operator
        first = np.full(largest.shape, len(here))
        reached = (here > self._least) & (here >= ALIKE * largest[operator.joint])
        point, column = np.nonzero(reached)
        np.minimum.at(first, (operator.joint[point], column), point)
        nowhere = np.full((1, 3), np.nan)
        every = of_ranks(operator.comm, np.concatenate([operator.points, nowhere])[first])
        rank = (~np.isnan(every[..., :1])).argmax(axis=0)  # points are dealt in their order
        return np.asarray(np.take_along_axis(every, rank[None], axis=0)[0])

    def state_dict(self) -> Dealt:
        """Gaps from which slip counts (collective)."""
        return Dealt(self._operator.comm, self._gap)

    def load_state_dict(self, gap: Floats) -> None:
        """Take up those of this rank's points that another's ``state_dict`` gave."""
        self._gap = gap.copy()
