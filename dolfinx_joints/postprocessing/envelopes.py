# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Envelopes of stresses at points of a surface: principal, arch and cantilever stresses.

Stresses are rows (xx, yy, zz, xy, yz, xz) [Pa], tension positive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

import annotated_types as at
import numpy as np
from numpy.typing import ArrayLike

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.common.declared import checked
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

# Levels of the largest principal stress / dynamic tensile strength, for the time of overstress.
LEVELS = np.linspace(1.0, 2.0, 11)
STRENGTHS = ("tensile", "dynamic_tensile", "compressive")
DYNAMIC_TENSILE, FACETS = "envelopes/strength/dynamic_tensile", "envelopes/facets"

PLANE_STRESS = "stress/plane"  # series of ``states`` and ``statics`` of plane models

_STEEP = 0.9  # limit of |n_z|: facets within 26 degrees of the horizontal have no arch direction
_SMOOTH = 0.8  # least ratio of largest eigenvalue and sum; 0.8 for two facets at 53 degrees


def principal_extremes(stress: ArrayLike) -> Floats:
    """Return the largest and smallest principal stress, shape (2, n), of stresses (n, 6) [Pa]."""
    rows = np.asarray(stress, dtype=np.float64)
    tensors = rows[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)
    return np.asarray(np.linalg.eigvalsh(tensors)[:, [2, 0]].T)


def principal_directions(stress: Floats) -> tuple[Floats, Floats]:
    """Return largest and smallest in-plane stress, (2, n), and unit vectors of the largest, (n, 2).

    The stresses (n, 3) are rows (xx, yy, xy).
    """
    x, y, shear = stress.T
    mean, radius = 0.5 * (x + y), np.hypot(0.5 * (x - y), shear)
    angle = 0.5 * np.arctan2(2.0 * shear, x - y)
    return np.stack([mean + radius, mean - radius]), np.stack([np.cos(angle), np.sin(angle)], 1)


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


@dataclass(frozen=True, kw_only=True)
@checked
class Strength:
    """Strength of concrete, for `checks`; it does not affect a run.

    In USACE's linear criteria the limit of 2 refers to the static tensile strength: twice this
    strength is the apparent dynamic strength of J. M. Raphael, Tensile strength of concrete, ACI
    Journal 81 (1984), 158-165. Their dynamic factor is therefore 1, the default.

    Attributes:
        tensile: Static tensile strength.
        compressive: Compressive strength, in statics and dynamics.
        dynamic_factor: Dynamic / static tensile strength, for limits that refer to the dynamic one.
    """

    tensile: Annotated[float, at.Gt(0), at.Unit("Pa")]
    compressive: Annotated[float, at.Gt(0), at.Unit("Pa")]
    dynamic_factor: Annotated[float, at.Ge(1)] = 1.0

    @property
    def dynamic_tensile(self) -> float:
        """Dynamic tensile strength [Pa]."""
        return self.dynamic_factor * self.tensile


class Envelopes:
    """Largest and smallest stresses over time at points of a surface.

    Args:
        arch: Arch directions, shape (n, 3).
        cantilever: Cantilever directions, shape (n, 3).
        strength: Dynamic tensile strength, infinite at points without strength, shape (n,), [Pa].
            With it, the time is recorded for which the largest principal stress exceeds each of
            ``LEVELS`` times the strength. Between two times the stress varies linearly.
    """

    def __init__(self, arch: Floats, cantilever: Floats, strength: Floats | None = None) -> None:
        self._arch, self._cantilever, self._strength = arch, cantilever, strength
        # Times above the levels, and the last ratio of stress and strength, of ``self._time``.
        self._over: Floats = np.zeros((len(arch), 0 if strength is None else len(LEVELS) + 1))
        self._over[:, -1:], self._time = np.nan, 0.0
        self._largest: Floats = np.full((3, len(arch)), -np.inf)
        self._smallest: Floats = np.full((3, len(arch)), np.inf)

    def see(self, stress: Floats, time: float = 0.0) -> None:
        """Update the envelopes with the stresses at a time [s], shape (n, 6), [Pa]."""
        largest, smallest = principal_extremes(stress)
        along = [stress_along(stress, d) for d in (self._arch, self._cantilever)]
        np.maximum(self._largest, [largest, *along], out=self._largest)
        np.minimum(self._smallest, [smallest, *along], out=self._smallest)
        if self._strength is not None:
            self._add_time(largest / self._strength, time)

    def _add_time(self, ratio: Floats, time: float) -> None:
        low, high = np.minimum(self._over[:, -1], ratio), np.maximum(self._over[:, -1], ratio)
        rows = np.flatnonzero(high > LEVELS[0])  # False for NaN, at the first time
        width = np.maximum(high - low, np.finfo(np.float64).tiny)[rows, None]
        share = np.clip((high[rows, None] - LEVELS) / width, 0.0, 1.0)
        self._over[rows, :-1] += (time - self._time) * share
        self._over[:, -1], self._time = ratio, time

    @property
    def columns(self) -> Floats:
        """Envelopes in the order of ``ENVELOPE_NAMES``, shape (n, 6), [Pa].

        With a strength, the times above ``LEVELS`` and the last ratio to the strength follow.
        """
        both: Floats = np.stack([self._largest, self._smallest], axis=1)
        return np.column_stack([both.reshape(6, -1).T, self._over])

    def load_state_dict(self, columns: Floats, time: float) -> None:
        """Restore the envelopes from ``columns`` at a time [s]."""
        both = columns[:, :6].T.reshape(3, 2, -1)
        self._largest, self._smallest = both[:, 0].copy(), both[:, 1].copy()
        self._over, self._time = columns[:, 6:].copy(), time


def declare_directions(
    writer: ResultsWriter,
    facets: Array | None,
    nodes: Array,
    arch: Array,
    cantilever: Array,
    *strengths: Array,
) -> None:
    """Write the nodes of envelopes, rows of ``mesh/nodes`` (n,), and directions (n, 3) or NaN.

    Strengths (n,) are in the order of ``STRENGTHS``, infinite in cells without a strength. Facets
    (m, 2 to 4) are the vertices of facet groups; None if stresses are recorded everywhere.
    """
    if facets is not None:
        writer.static(FACETS, facets, "-", "vertices of the facets with recorded stresses")
    writer.static("envelopes/nodes", nodes, "-", "nodes at which stresses are recorded")
    writer.static("envelopes/arch", arch, "-", "horizontal direction in the surface")
    writer.static("envelopes/cantilever", cantilever, "-", "steepest direction in the surface")
    for name, strength in zip(STRENGTHS, strengths, strict=bool(strengths)):
        text = f"{name.replace('_', ' ')} strength"
        writer.static(f"envelopes/strength/{name}", strength, "Pa", text)


def stage_stresses(stress: Floats, arch: Floats, cantilever: Floats) -> dict[str, Floats]:
    """Return stresses by the series in ``STAGE_STRESSES``, shape (n,), [Pa]."""
    along = [stress_along(stress, direction) for direction in (arch, cantilever)]
    columns = [*principal_extremes(stress), *along]
    return dict(zip(dict.fromkeys(STAGE_STRESSES.values()), columns, strict=True))
