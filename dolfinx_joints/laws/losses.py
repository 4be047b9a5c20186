# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a step loses in a joint, from the parts of its way: elastic, plastic, in flight.

With m the mean of the law's own tractions at both ends, m . elastic is the change of a quadratic
stored energy and m . plastic the friction work that the law states. Of the work of a traction t

    friction D_f = m . plastic + (t - m) . plastic,
    numerical D_num = t . flight + (t - m) . elastic                                        (30)

are lost. For t of the end of the step the latter is t . flight + change . k change / 2, never
negative.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dolfinx_joints.laws.law import AnyLaw, Floats, JointState, LawWithLosses, Losses, Response
from dolfinx_joints.laws.points.return_mapping import contact_fraction


class Way(NamedTuple):
    """Change of the gap in a step, in parts of shape (n, 3), [m].

    Attributes:
        elastic: Change of what holds the traction.
        plastic: Slip against friction, and dilation.
        flight: Change of the opening, and slip before a point touches.
    """

    elastic: Floats
    plastic: Floats
    flight: Floats


def overlap_and_slip(state: JointState) -> Floats:
    """Elastic gap of points without tension: overlap and elastic slip, shape (n, 3), [m]."""
    return np.column_stack([np.minimum(state.gap[:, 0], 0.0), state.elastic_slip])


def way_with_friction(before: JointState, after: JointState) -> Way:
    """The way of a step of points without tension that stick and slide in contact."""
    moved = after.gap - before.gap
    elastic = overlap_and_slip(after) - overlap_and_slip(before)
    plastic, flight = np.zeros_like(moved), np.zeros_like(moved)
    fraction = contact_fraction(before.gap[:, 0], np.minimum(after.gap[:, 0], 0.0))[:, None]  # (8)
    plastic[:, 1:] = fraction * moved[:, 1:] - elastic[:, 1:]
    flight[:, 0] = np.maximum(after.gap[:, 0], 0.0) - np.maximum(before.gap[:, 0], 0.0)
    flight[:, 1:] = (1.0 - fraction) * moved[:, 1:]
    return Way(elastic, plastic, flight)


def losses_on(way: Way, traction: Floats, mean: Floats, dissipation: Floats) -> Losses:
    """(30) of a way.

    Args:
        way: The way.
        traction: That acts, shape (n, 3), [Pa].
        mean: Of the law's tractions at both ends, shape (n, 3), [Pa].
        dissipation: That the law states, mean . plastic, shape (n,), [J/m^2].
    """
    above = traction - mean
    return Losses(
        friction=dissipation + work(above, way.plastic),
        numerical=work(traction, way.flight) + work(above, way.elastic),
    )


def losses_of(law: AnyLaw, before: JointState, answer: Response, traction: Floats) -> Losses:
    """Losses of a step as the law states them, or else the numerical one by difference.

    Arguments are those of `LawWithLosses.losses`.
    """
    if isinstance(law, LawWithLosses):
        return law.losses(before, answer, traction)
    taken = work(traction, answer.state.gap - before.gap) - answer.dissipation
    kept = law.stored_energy(answer.state) - law.stored_energy(before)
    return Losses(friction=answer.dissipation, numerical=taken - kept)


def work(traction: Floats, way: Floats) -> Floats:
    """Work of tractions (n, 3) on ways (n, 3), shape (n,), [J/m^2]."""
    done: Floats = np.einsum("ij,ij->i", traction, way)
    return done
