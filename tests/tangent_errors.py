# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tangents compared with finite differences of the tractions."""

from __future__ import annotations

import numpy as np


def central_differences(traction, gap, step):
    """Return derivatives of tractions (n, 3) with respect to gaps (n, 3), shape (n, 3, 3)."""
    moves = step * np.eye(3)
    columns = [(traction(gap + e) - traction(gap - e)) / (2 * step) for e in moves]
    return np.stack(columns, axis=2)


def largest_error(evaluate, gap, steps, *, over=2):
    """Return the largest error of the tangent, relative to its largest entry.

    Differences are of second order: central if both neighbours are on the same piece of the law,
    one-sided if only one is. Points where Newton's method fails are NaN and not compared.

    Args:
        evaluate: Function that returns traction, tangent and piece at gaps.
        gap: Gaps of the points, shape (n, 3), [m].
        steps: Step of each point, shape (n,), [m].
        over: Axes of the tangent over which the largest entry is taken, by default each row.

    Returns:
        The error, and the share of the points that could be compared.
    """
    traction, tangent, piece = evaluate(gap)
    size = np.abs(tangent).max(axis=over, keepdims=True)[..., 0]
    worst, compared = 0.0, np.zeros(len(gap), dtype=bool)
    for k in range(3):
        values, same = {}, {}
        for multiple in (-2, -1, 1, 2):
            moved = gap.copy()
            moved[:, k] += multiple * steps
            values[multiple], _, there = evaluate(moved)
            same[multiple] = there == piece
        central = same[1] & same[-1]
        slope = (values[1] - values[-1]) / (2 * steps)[:, None]
        usable = central.copy()
        for sign in (1, -1):
            one_sided = (4 * values[sign] - values[2 * sign] - 3 * traction) * sign
            alone = same[sign] & same[2 * sign] & ~central
            slope[alone] = (one_sided / (2 * steps)[:, None])[alone]
            usable |= alone
        error = np.abs(slope - tangent[:, :, k]) / np.where(size > 0, size, 1.0)
        usable &= np.isfinite(error).all(axis=1)
        worst = max(worst, float(error[usable].max()))
        compared |= usable
    return worst, compared.mean()
