# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Extremes of each joint, and what its safety against sliding is made of, at every step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.dealt import Dealt
from dolfinx_joints.common.mpi import of_ranks
from dolfinx_joints.laws.law import Response
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.resultants import JointForces, broken_joints
from dolfinx_joints.postprocessing.joints.extremes import ALIKE
from dolfinx_joints.results.writer import ResultsWriter

Floats = NDArray[np.floating[Any]]

_PLACE = "where the {} is the largest, NaN where it is zero to rounding"
_SERIES = {
    "opening": ((), "m", "largest opening of the points"),
    "slip": ((), "m", "largest slip of the points"),
    "pressure": ((), "Pa", "largest pressure of the points"),
    "opening_at": ((3,), "m", _PLACE.format("opening")),
    "slip_at": ((3,), "m", _PLACE.format("slip")),
    "compression": ((), "N", "integral of the pressure, of tension too where a bond holds"),
    "shear_sum": ((), "N", "integral of the magnitude of the shear traction"),
    "bond": ((), "N", "cohesion times the area whose bond is intact"),
}


class JointExtremesStream:
    """The stream ``joints`` of a results file; on each rank the reductions of its own points.

    Args:
        model: The model, with joints.
        gap: Gaps of the local points from which slip counts, shape (n, 3), [m].
    """

    def __init__(self, model: Model, gap: Floats) -> None:
        """Find the joints (collective)."""
        assert model.operator is not None
        assert model.contact is not None
        self._operator, self._gap = model.operator, gap.copy()
        self._tied = model.contact.tied
        self._forces, self._bonded = JointForces(model), broken_joints(model.contact)
        self._recorded = np.ones((len(model.operator.names), 12), dtype=bool)
        self._recorded[:, -1] = [name in self._bonded for name in model.operator.names]
        self._order = np.argsort(model.operator.joint, kind="stable")
        self._here, self._starts = np.unique(model.operator.joint[self._order], return_index=True)
        # Ways below the rounding of coordinates are zero, though a sum left 1e-35 m of some.
        points = model.operator.points
        ends = np.array([points.min(initial=np.inf), -points.max(initial=-np.inf)])
        least, most = of_ranks(model.operator.comm, ends).min(axis=0)
        self._least = np.finfo(np.float64).eps * float(-most - least)

    def declare(self, writer: ResultsWriter) -> None:
        """Declare the stream; on the rank that writes."""
        for joint in self._operator.names:
            for name, (shape, unit, text) in _SERIES.items():
                if name != "bond" or joint in self._bonded:
                    writer.series("joints", f"{joint}/{name}", shape, unit, text)

    @property
    def names(self) -> list[str]:
        """Names of the numbers that `values` gives."""
        pairs = [(joint, name) for joint in self._operator.names for name in _SERIES]
        return [f"{j}/{name}" for j, name in pairs if name != "bond" or j in self._bonded]

    def values(self, joints: Response) -> Floats:
        """Numbers of a step in the order of `names` (collective)."""
        operator, gap = self._operator, joints.state.gap
        here = np.empty((len(gap), 3))
        np.maximum(gap[:, 0], 0.0, out=here[:, 0])
        slip = gap[:, 1:] - self._gap[:, 1:]
        np.sqrt(np.einsum("ij,ij->i", slip, slip), out=here[:, 1])
        np.maximum(-joints.traction[:, 0], 0.0, out=here[:, 2])
        here[self._tied] = 0.0
        own = np.zeros((2, len(operator.names), 3))
        if len(here):
            own[0, self._here] = np.maximum.reduceat(here[self._order], self._starts)
        for column, force in zip(own[1].T, self._forces.sliding(joints).T, strict=True):
            column[:] = np.bincount(operator.joint, force, len(operator.names))
        every = of_ranks(operator.comm, own)
        largest, sums = every[:, 0].max(axis=0), every[:, 1].sum(axis=0)
        places = self._places(here[:, :2], largest[:, :2])
        rows = np.concatenate([largest, places.reshape(-1, 6), sums], axis=1)
        return rows[self._recorded]

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
