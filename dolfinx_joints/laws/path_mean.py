# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mean of a traction over the straight path of a step: the discrete gradient of a potential.

With d = g1 - g0 and t = psi'(g),

    t_mean = integral of t(g0 + s d) over s from 0 to 1,      t_mean . d = psi(g1) - psi(g0),

so that the work of the step is the change of the stored energy. Nothing is divided by d and no
energies are subtracted: in steps that hardly move the mean loses no digits, as projections of the
missing energy onto d do. It is of second order, the same for the step taken backwards, and its
derivative by g1, the integral of s psi''(g0 + s d), is symmetric.

The quadrature makes this exact to rounding also where the path crosses kinks of t: it is cut where
the joint opens or closes, and halved around any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.laws.law import Floats

# Gauss's rule of six points on (0, 1), and the ends, to see kinks next to them.
_GAUSS = np.polynomial.legendre.leggauss(6)
_PLACES: Floats = np.concatenate([[0.0], 0.5 + 0.5 * _GAUSS[0], [1.0]])
_WEIGHTS: Floats = np.concatenate([[0.0], 0.5 * _GAUSS[1], [0.0]])

# Takes the best polynomial of degree 5 off values at these eight. Where what is left is 1e-9 of the
# traction, a smooth one is integrated to rounding; around a kink the piece is then so short that
# 1e-9 of its own small work is missed.
_POLYNOMIALS = np.linalg.qr(np.vander(_PLACES - 0.5, 6))[0]
_REST = np.eye(8) - _POLYNOMIALS @ _POLYNOMIALS.T
_SMALL, _EPS = 1e-9, float(np.finfo(float).eps)

_MOST_PIECES = 64  # of a path at a time: more come of rounding errors, not of kinks


def path_mean(
    tractions: Callable[[Floats], tuple[Floats, Floats]], before: Floats, after: Floats
) -> tuple[Floats, Floats]:
    """Mean of a traction over straight paths, and its derivative by their ends.

    Args:
        tractions: Gives the traction, shape (m, 3), [Pa], and its derivative, shape (m, 3, 3),
            [Pa/m], of gaps of shape (m, 3), [m]; the traction is continuous.
        before: Gap at the start, shape (n, 3), [m].
        after: Gap at the end, shape (n, 3), [m].

    Returns:
        The mean, shape (n, 3), [Pa], and its derivative by ``after``, shape (n, 3, 3), [Pa/m].
    """
    way, count = after - before, len(before)
    mean, tangent, size = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count)
    point, start, end = _cut_at_contact(before[:, 0], after[:, 0])
    whole = True
    while len(point):
        length = end - start
        places = start[:, None] + length[:, None] * _PLACES
        gaps = before[point][:, None] + places[:, :, None] * way[point][:, None]
        t, by_gap = tractions(gaps.reshape(-1, 3))
        t, by_gap = t.reshape(-1, 8, 3), by_gap.reshape(-1, 8, 3, 3)
        if whole:
            np.add.at(size, point, length * np.linalg.norm(t, axis=2).mean(axis=1))
        left = np.linalg.norm(_REST @ t, axis=(1, 2))
        # The second condition ends the search where the traction jumps.
        rough = (left > _SMALL * size[point]) & (length * left > _EPS * size[point])
        rough &= (np.bincount(point[rough], minlength=count) <= _MOST_PIECES)[point]
        good = ~rough
        weights = length[good, None] * _WEIGHTS
        np.add.at(mean, point[good], np.einsum("pq,pqi->pi", weights, t[good]))
        weights *= places[good]
        np.add.at(tangent, point[good], np.einsum("pq,pqij->pij", weights, by_gap[good]))
        middle = 0.5 * (start + end)[rough]
        start, end = np.append(start[rough], middle), np.append(middle, end[rough])
        point, whole = np.tile(point[rough], 2), False
    return mean, tangent


def _cut_at_contact(before: Floats, after: Floats) -> tuple[NDArray[Any], Floats, Floats]:
    """Points of the pieces of their paths, and where these start and end, as parts of the path."""
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
