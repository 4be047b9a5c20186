# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy that an increment of the loads releases because the structure jumps.

The gaps vary from g0 to g0 + dg on a straight path, 0 <= s <= 1, with tractions t0 and t1 at its
ends and areas w. The product of internal forces and displacement increment x is

    R(s) = (1 - s) R0 + s R1 + sum of w [t(g0 + s dg) - (1 - s) t0 - s t1] . dg.

R0 and R1 are the loads and support forces at the ends, times x. On an equilibrium path under
growing loads R(s) increases from R0 to R1; joints that close, open or begin to slide only change
the slope. If R decreases, the loads exceed the internal forces and accelerate the structure:

    D_rel = integral of [P(s) - R(s)] over s from 0 to 1,
    P(s) = largest R up to s, within R0 and R1.                                              (31b)

If the loads fall, R1 < R0, as reactions or controlled loads do while joints soften, R decreases on
the equilibrium path too. Then P(s) is the load (1 - s) R0 + s R1.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dolfinx_joints.common.mpi import summed
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.laws.losses import work

# Positions s, dense near 0: if a jump is long compared with the elastic path, R decreases there.
PLACES = np.concatenate([[0.0], 0.5 ** np.arange(16.0, 4.0, -0.25), np.arange(1.0, 17.0) / 16.0])


def released(
    contact: Contact,
    before: Response,
    after: Response,
    start: float,
    end: float,
    at_place: Callable[[float], None] | None = None,
) -> tuple[Floats, float]:
    """Return the energy released in each joint, and the load work during the release (collective).

    The share of a joint is proportional to the drop of its traction work below the previous
    maximum. ``start`` and ``end`` are R0 and R1 [J]. ``at_place`` is as in `StaticLedger`. The
    result is (31b), shape (number of joints,), and the integral of |P| where P > R, both [J].
    """
    opening = after.state.gap - before.state.gap
    broken = contact.broken(before.state, after.state)
    density = np.empty((len(PLACES), len(opening)))
    for row, place in zip(density, PLACES, strict=True):
        if at_place is not None:
            at_place(float(place))
        chord = (1.0 - place) * before.traction + place * after.traction
        traction = _on_path(contact, before, after, place, chord)
        row[:] = work(np.where(broken[:, None], chord, traction), opening)
    joints = summed(contact.operator.comm, density @ contact.operator.areas)
    chord = (1.0 - PLACES) * joints[0] + PLACES * joints[-1]
    loads = (1.0 - PLACES) * start + PLACES * end
    inner = loads + joints - chord
    if end >= start:
        loads = np.clip(np.maximum.accumulate(inner), start, end)
    total = float(np.trapezoid(loads - inner, PLACES))
    meanwhile = float(np.trapezoid(np.where(loads > inner, np.abs(loads), 0.0), PLACES))
    drop = np.trapezoid(np.maximum.accumulate(density) - density, PLACES, axis=0)
    by_joint = contact.integrals(drop)
    return max(total, 0.0) * by_joint / (by_joint.sum() or 1.0), meanwhile


def _on_path(
    contact: Contact, before: Response, after: Response, place: float, chord: Floats
) -> Floats:
    """Return the tractions at a position of the path, shape (n, 3), [Pa] (collective).

    Rigid points have no traction-gap relation: their tractions are interpolated if the point is
    closed at both ends, and zero otherwise.
    """
    if place in (0.0, 1.0):
        return chord
    start, end = before.state.gap, after.state.gap
    gap = start + place * (end - start)
    rigid = np.isinf(contact.closed_stiffness()[:, 0])
    gap[rigid, 0] = np.maximum(gap[rigid, 0], 0.0)
    traction = contact.at_gap(gap, before.state).traction
    closed = rigid & (np.maximum(start[:, 0], end[:, 0]) <= 0.0)
    return np.where(closed[:, None], chord, np.where(rigid[:, None], 0.0, traction))
