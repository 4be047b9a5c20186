# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy losses of a step in a joint, from the elastic, plastic and flight parts of the gap change.

Let m be the mean of the law's tractions at start and end of a step. Then m . elastic is the change
of a quadratic stored energy, and m . plastic is the friction work of the law. The losses of a
traction t that acts during the step are

    friction D_f = m . plastic + (t - m) . plastic,
    numerical D_num = t . flight + (t - m) . elastic.                                       (30)

If t is the traction at the end, D_num = t . flight + elastic . k elastic / 2 >= 0, stiffness k.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.laws.law import AnyLaw, Floats, JointState, LawWithLosses, Losses, Response
from dolfinx_joints.laws.points.return_mapping import contact_fraction


class GapChange(NamedTuple):
    """Parts of the gap change in a step, each of shape (n, 3), [m].

    Attributes:
        elastic: Change of the elastic gap, which determines the traction.
        plastic: Slip against friction, and dilation.
        flight: Change of the opening, and slip while the point is open.
    """

    elastic: Floats
    plastic: Floats
    flight: Floats


def overlap_and_slip(state: JointState) -> Floats:
    """Return the elastic gap without tension: overlap and elastic slip, shape (n, 3), [m]."""
    return np.column_stack([np.minimum(state.gap[:, 0], 0.0), state.elastic_slip])


def friction_gap_change(before: JointState, after: JointState) -> GapChange:
    """Return the gap change of a step at points with friction and without tension."""
    change = after.gap - before.gap
    elastic = overlap_and_slip(after) - overlap_and_slip(before)
    plastic, flight = np.zeros_like(change), np.zeros_like(change)
    fraction = contact_fraction(before.gap[:, 0], np.minimum(after.gap[:, 0], 0.0))[:, None]  # (8)
    plastic[:, 1:] = fraction * change[:, 1:] - elastic[:, 1:]
    flight[:, 0] = np.maximum(after.gap[:, 0], 0.0) - np.maximum(before.gap[:, 0], 0.0)
    flight[:, 1:] = (1.0 - fraction) * change[:, 1:]
    return GapChange(elastic, plastic, flight)


def losses_on(change: GapChange, traction: Floats, mean: Floats, dissipation: Floats) -> Losses:
    """Return the losses (30).

    Args:
        change: Parts of the gap change.
        traction: Traction that acts over the step, shape (n, 3), [Pa].
        mean: Mean of the law's tractions at start and end, shape (n, 3), [Pa].
        dissipation: Friction work of the law, mean . plastic, shape (n,), [J/m^2].
    """
    excess = traction - mean
    return Losses(
        friction=dissipation + work(excess, change.plastic),
        numerical=work(traction, change.flight) + work(excess, change.elastic),
    )


def losses_of(law: AnyLaw, before: JointState, answer: Response, traction: Floats) -> Losses:
    """Return the losses of a step by the law's method, or with the numerical loss by difference.

    The arguments are those of `LawWithLosses.losses`.
    """
    if isinstance(law, LawWithLosses):
        return law.losses(before, answer, traction)
    net_work = work(traction, answer.state.gap - before.gap) - answer.dissipation
    stored = law.stored_energy(answer.state) - law.stored_energy(before)
    return Losses(friction=answer.dissipation, numerical=net_work - stored)


def work(traction: Floats, path: Floats) -> Floats:
    """Return the work of tractions (n, 3) on gap changes (n, 3), shape (n,), [J/m^2]."""
    result: Floats = np.einsum("ij,ij->i", traction, path)
    return result
