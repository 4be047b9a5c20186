# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy that an increment of the loads releases because the structure jumps.

On the straight path g0 + s dg the internal forces, times the displacement x of the increment, are

    R(s) = (1 - s) R0 + s R1 + sum of w [t(g0 + s dg) - (1 - s) t0 - s t1] . dg.

At both ends they equal the loads and supports times x. While the loads grow, a structure that
follows its path of equilibria stays on loads between R0 and R1 that never decrease. If R decreases,
the loads are larger than the internal forces, and their work sets the structure in motion:

    D_rel = integral of [P(s) - R(s)] over s from 0 to 1,
    P(s) = largest R up to s, within R0 and R1.                                              (31b)

A joint that closes, opens or begins to slide lets R grow at another rate and releases nothing.
"""

from __future__ import annotations

import numpy as np

from dolfinx_joints.common.mpi import summed
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.laws.law import Floats, Response
from dolfinx_joints.laws.losses import work

# Gauss's rule on (0, 1): kinks of R leave errors of some 0.3 % of the energy of a jump.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
PLACES, WEIGHTS = 0.5 + 0.5 * _NODES, 0.5 * _WEIGHTS


def released(
    contact: Contact, before: Response, after: Response, start: float, end: float
) -> Floats:
    """Return the energy released in each joint (31b), shape (number of joints,), [J] (collective).

    The total is shared among the joints as the work that their tractions fall short of the chord.

    Args:
        contact: The joints.
        before: Response at the start of the increment.
        after: Response at its end.
        start: R0, loads and supports at the start times x [J].
        end: R1, the same at the end [J].
    """
    way = after.state.gap - before.state.gap
    broken = contact.broken(before.state, after.state)
    short = np.empty((len(PLACES), len(way)))
    for row, place in zip(short, PLACES, strict=True):
        chord = (1.0 - place) * before.traction + place * after.traction
        traction = _on_path(contact, before, after, place, chord)
        row[:] = np.where(broken, 0.0, work(chord - traction, way))
    sums = summed(contact.operator.comm, short @ contact.operator.areas)
    inner = (1.0 - PLACES) * start + PLACES * end - sums
    bounds = (start, max(start, end))
    loads = np.clip(np.maximum.accumulate(np.append(start, inner))[1:], *bounds)
    if end < start:
        loads = (1.0 - PLACES) * start + PLACES * end
    total = float(WEIGHTS @ (loads - inner))
    by_joint = np.maximum(contact.integrals(WEIGHTS @ short), 0.0)
    shares = by_joint / (by_joint.sum() or 1.0)
    return max(total, 0.0) * shares


def _on_path(
    contact: Contact, before: Response, after: Response, place: float, chord: Floats
) -> Floats:
    """Return the tractions at a place of the path, shape (n, 3), [Pa] (collective).

    Tractions of rigid points do not follow from their gaps: they are those of the chord while the
    point is closed, and zero while it is open.
    """
    start, end = before.state.gap, after.state.gap
    gap = start + place * (end - start)
    rigid = np.isinf(contact.closed_stiffness()[:, 0])
    gap[rigid, 0] = np.maximum(gap[rigid, 0], 0.0)
    traction = contact.at_gap(gap, before.state).traction
    closed = rigid & (np.maximum(start[:, 0], end[:, 0]) <= 0.0)
    return np.where(closed[:, None], chord, np.where(rigid[:, None], 0.0, traction))
