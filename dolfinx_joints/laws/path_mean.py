# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mean traction over the straight path of a step: the discrete gradient of a potential.

With d = g1 - g0 and t = psi'(g),

    t_mean = integral of t(g0 + s d) over s from 0 to 1,      t_mean . d = psi(g1) - psi(g0),

where g0 and g1 are the gaps at start and end of the step and psi is the stored energy. The work of
the step equals the change of psi. The mean has second order and is symmetric in time. Its
derivative by g1, the integral of s psi''(g0 + s d), is a symmetric matrix. There is no division by
d and no difference of energies, so very short steps lose no digits.

The quadrature is exact to rounding even if the path crosses kinks of t. The path is split at the
point where the joint opens or closes, and bisected around any other kink.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.laws.law import Floats

# Six-point Gauss rule on (0, 1); both ends are added to detect kinks close to the ends.
_GAUSS = np.polynomial.legendre.leggauss(6)
_PLACES: Floats = np.concatenate([[0.0], 0.5 + 0.5 * _GAUSS[0], [1.0]])
_WEIGHTS: Floats = np.concatenate([[0.0], 0.5 * _GAUSS[1], [0.0]])

# `_REST` subtracts the best polynomial of degree 5 from the values at the eight points. If the
# remainder is below 1e-9 of the traction, the integral of a smooth traction is exact to rounding.
# Around a kink the interval is then so short that the error is 1e-9 of the small work in it.
_POLYNOMIALS = np.linalg.qr(np.vander(_PLACES - 0.5, 6))[0]
_REST = np.eye(8) - _POLYNOMIALS @ _POLYNOMIALS.T
_SMALL, _EPS = 1e-9, float(np.finfo(float).eps)

_MOST_PIECES = 64  # rough intervals per path; more are caused by rounding errors, not by kinks


def path_mean(
    tractions: Callable[[Floats], tuple[Floats, Floats]], before: Floats, after: Floats
) -> tuple[Floats, Floats]:
    """Return the mean traction over straight paths, and the derivative by the end gaps.

    Args:
        tractions: Function of gaps, shape (m, 3), [m], that returns the traction, shape (m, 3),
            [Pa], and its derivative, shape (m, 3, 3), [Pa/m]. The traction must be continuous.
        before: Gap at the start, shape (n, 3), [m].
        after: Gap at the end, shape (n, 3), [m].

    Returns:
        The mean, shape (n, 3), [Pa], and its derivative by ``after``, shape (n, 3, 3), [Pa/m].
    """
    path, count = after - before, len(before)
    mean, tangent, size = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count)
    point, start, end = _cut_at_contact(before[:, 0], after[:, 0])
    whole = True
    while len(point):
        length = end - start
        places = start[:, None] + length[:, None] * _PLACES
        gaps = before[point][:, None] + places[:, :, None] * path[point][:, None]
        t, by_gap = tractions(gaps.reshape(-1, 3))
        t, by_gap = t.reshape(-1, 8, 3), by_gap.reshape(-1, 8, 3, 3)
        if whole:
            np.add.at(size, point, length * np.linalg.norm(t, axis=2).mean(axis=1))
        residual = np.linalg.norm(_REST @ t, axis=(1, 2))
        # The second condition stops the bisection at a jump of the traction.
        rough = (residual > _SMALL * size[point]) & (length * residual > _EPS * size[point])
        rough &= (np.bincount(point[rough], minlength=count) <= _MOST_PIECES)[point]
        smooth = ~rough
        weights = length[smooth, None] * _WEIGHTS
        np.add.at(mean, point[smooth], np.einsum("pq,pqi->pi", weights, t[smooth]))
        weights *= places[smooth]
        np.add.at(tangent, point[smooth], np.einsum("pq,pqij->pij", weights, by_gap[smooth]))
        middle = 0.5 * (start + end)[rough]
        start, end = np.append(start[rough], middle), np.append(middle, end[rough])
        point, whole = np.tile(point[rough], 2), False
    return mean, tangent


def _cut_at_contact(before: Floats, after: Floats) -> tuple[NDArray[Any], Floats, Floats]:
    """Return point number, start and end (0 to 1) of each interval of the paths."""
    points = np.arange(len(before))
    crosses = np.flatnonzero((before > 0.0) != (after > 0.0))
    place = before[crosses] / (before[crosses] - after[crosses])
    end = np.ones(len(before))
    end[crosses] = place
    return (
        np.append(points, crosses),
        np.append(np.zeros(len(before)), place),
        np.append(end, np.ones(len(crosses))),
    )
