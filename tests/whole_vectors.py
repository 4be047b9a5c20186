# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint vectors gathered from all ranks, for comparison with dense matrices."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.arrays import Dealt

if TYPE_CHECKING:
    from dolfinx_joints.joints.points import JointPoints


def own_part(comm: Any, every: np.ndarray, count: int) -> np.ndarray:
    """Return this rank's ``count`` rows of an array in the order of the ranks (collective)."""
    stop = comm.scan(count)
    return every[stop - count : stop]


def all_of(comm: Any, part: np.ndarray) -> np.ndarray:
    """Concatenate the parts of all ranks on each rank (collective)."""
    return np.concatenate(comm.allgather(part))


def as_read(state_dict: dict[str, Any]) -> dict[str, Any]:
    """Return a ``state_dict`` as a checkpoint restores it on the same number of ranks."""
    return {k: v.mine if isinstance(v, Dealt) else v for k, v in state_dict.items()}


def whole_layout(comm: Any, layout: JointPoints) -> JointPoints:
    """Gather facets and points of all ranks on each rank (collective)."""
    order = np.argsort(all_of(comm, layout.facet))
    of_facets = {
        name: all_of(comm, getattr(layout, name))[order] for name in ("facet", "number", "share")
    }
    names = ("points", "frames", "areas", "joint", "sizes")
    of_points = {name: all_of(comm, getattr(layout, name)) for name in names}
    return replace(layout, **of_facets, **of_points)


def relative_difference(computed: Any, expected: Any) -> float:
    """Norm of the difference of two PETSc vectors, relative to the second one (collective)."""
    change = computed.copy()
    change.axpy(-1.0, expected)
    return change.norm() / expected.norm()


class Whole:
    """S of all ranks, through products with vectors of all unknowns."""

    def __init__(self, split: Any, comm: Any) -> None:
        self._split, self._comm = split, comm

    def product(self, values: np.ndarray) -> np.ndarray:
        mine = own_part(self._comm, values, self._split.local)
        return all_of(self._comm, self._split.product(mine, np.flatnonzero(mine)))

    def matrix(self) -> np.ndarray:
        """S, column by column."""
        return np.column_stack([self.product(unit) for unit in np.eye(self._split.size)])
