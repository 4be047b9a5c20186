# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Envelopes of stresses at points of a surface: principal, arch and cantilever stresses.

Stresses are rows (xx, yy, zz, xy, yz, xz) [Pa], tension positive.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.results.layout import Array
from dolfinx_joints.results.writer import ResultsWriter

EnvelopeName = Literal[
    "principal_max", "principal_min", "arch_max", "arch_min", "cantilever_max", "cantilever_min"
]
ENVELOPE_NAMES: tuple[str, ...] = get_args(EnvelopeName)

# Series of the stream ``statics`` with the extreme stresses of a static stage, by envelope name.
STAGE_STRESSES = {
    name: f"stress/{name if name.startswith('principal') else name.split('_')[0]}"
    for name in ENVELOPE_NAMES
}

_STEEP = 0.9  # limit of |n_z|: facets within 26 degrees of the horizontal have no arch direction
_SMOOTH = 0.8  # least ratio of largest eigenvalue and sum; 0.8 for two facets at 53 degrees


def principal_extremes(stress: ArrayLike) -> Floats:
    """Return the largest and smallest principal stress, shape (2, n), of stresses (n, 6) [Pa]."""
    rows = np.asarray(stress, dtype=np.float64)
    tensors = rows[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)
    return np.asarray(np.linalg.eigvalsh(tensors)[:, [2, 0]].T)


def stress_along(stress: ArrayLike, direction: ArrayLike) -> Floats:
    """Return the normal stress along unit vectors (n, 3), which may be NaN; stress (n, 6) [Pa]."""
    x, y, z = np.asarray(direction, dtype=np.float64).T
    factors = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * y * z, 2 * x * z], axis=1)
    return np.einsum("ij,ij->i", np.asarray(stress, dtype=np.float64), factors)


def extreme_of(name: str, values: Floats) -> float:
    """Return the largest value of an envelope ``.._max``, or the smallest of ``.._min``, or NaN."""
    valid = values[~np.isnan(values)]
    return float(valid.max() if name.endswith("max") else valid.min()) if valid.size else np.nan


def face_directions(nodes: ArrayLike, facets: ArrayLike) -> tuple[Floats, Floats]:
    """Return arch and cantilever directions at the nodes of a surface.

    n is the area-weighted mean normal of the facets around a node, z points upwards. The arch
    direction z x n is horizontal in the surface. The cantilever direction n x (z x n) is the
    steepest upward direction in the surface. Facets within 26 degrees of the horizontal, such as a
    crest, are ignored. The directions are NaN if no facet remains, or if the facets form an edge at
    the node. The arch direction points to positive y, or to positive x if it is normal to y.

    Args:
        nodes: Shape (n, 3), [m].
        facets: Numbers of the vertices in cyclic order, shape (facets, 3 or 4).

    Returns:
        Unit vectors, both of shape (n, 3).
    """
    positions, vertices = np.asarray(nodes, dtype=np.float64), np.asarray(facets, dtype=np.int64)
    corners = positions[vertices]
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    size = np.linalg.norm(area, axis=1)
    steep = np.abs(area[:, 2]) <= _STEEP * size
    # Average n n^T, which does not depend on the orientation of the facets.
    tensors = np.einsum("fi,fj->fij", area[steep], area[steep]) / size[steep, None, None]
    mean = np.zeros((len(positions), 3, 3))
    for column in vertices[steep].T:
        np.add.at(mean, column, tensors)
    share, axes = np.linalg.eigh(mean)
    total = share.sum(axis=1)
    normal = np.where((share[:, 2] >= _SMOOTH * total) & (total > 0.0), axes[:, :, 2].T, np.nan).T
    arch = np.cross([0.0, 0.0, 1.0], normal)
    with np.errstate(invalid="ignore"):
        arch /= np.linalg.norm(arch, axis=1, keepdims=True)
        leading = np.where(np.abs(arch[:, 1]) > 1e-9, arch[:, 1], arch[:, 0])
    arch *= np.sign(leading)[:, None]
    cantilever = np.cross(normal, np.cross([0.0, 0.0, 1.0], normal))
    return arch, cantilever / np.linalg.norm(cantilever, axis=1, keepdims=True)


class Envelopes:
    """Largest and smallest stresses over time at points of a surface.

    Args:
        arch: Arch directions, shape (n, 3).
        cantilever: Cantilever directions, shape (n, 3).
    """

    def __init__(self, arch: Floats, cantilever: Floats) -> None:
        self._arch, self._cantilever = arch, cantilever
        self._largest: Floats = np.full((3, len(arch)), -np.inf)
        self._smallest: Floats = np.full((3, len(arch)), np.inf)

    def see(self, stress: Floats) -> None:
        """Update the envelopes with the stresses at one time, shape (n, 6), [Pa]."""
        largest, smallest = principal_extremes(stress)
        along = [stress_along(stress, d) for d in (self._arch, self._cantilever)]
        np.maximum(self._largest, [largest, *along], out=self._largest)
        np.minimum(self._smallest, [smallest, *along], out=self._smallest)

    @property
    def columns(self) -> Floats:
        """Envelopes in the order of ``ENVELOPE_NAMES``, shape (n, 6), [Pa]."""
        both: Floats = np.stack([self._largest, self._smallest], axis=1)
        return both.reshape(6, -1).T

    def load_state_dict(self, columns: Floats) -> None:
        """Restore the envelopes from ``columns``."""
        both = columns.T.reshape(3, 2, -1)
        self._largest, self._smallest = both[:, 0].copy(), both[:, 1].copy()


def declare_directions(writer: ResultsWriter, nodes: Array, arch: Array, cantilever: Array) -> None:
    """Write the nodes of envelopes, rows of ``mesh/nodes`` (n,), and directions (n, 3) or NaN."""
    writer.static("envelopes/nodes", nodes, "-", "nodes at which stresses are recorded")
    writer.static("envelopes/arch", arch, "-", "horizontal direction in the surface")
    writer.static("envelopes/cantilever", cantilever, "-", "steepest direction in the surface")


def stage_stresses(stress: Floats, arch: Floats, cantilever: Floats) -> Floats:
    """Return stresses in the order of the series in ``STAGE_STRESSES``, shape (n, 4), [Pa]."""
    along = [stress_along(stress, direction) for direction in (arch, cantilever)]
    return np.column_stack([*principal_extremes(stress), *along])
