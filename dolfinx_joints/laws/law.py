# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws and their return mapping: arrays in, arrays out.

A law sees the gap vector of each joint point in the local frame (n, s1, s2), with the initial gap
already included: ``gap[:, 0] > 0`` is open, ``gap[:, 0] <= 0`` closed, tractions are negative in
compression. A trial never changes the state it starts from; whoever accepts a step keeps the state
that the trial returned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.parameters import (
    check_kind_of,
    numbers_of,
    offers,
    shown,
)

Floats = NDArray[np.float64]

NO_COMPLIANCE: Floats = np.zeros((1, 2))


class Status(IntEnum):
    """What a joint point does."""

    OPEN = 0
    STICK = 1
    SLIP = 2


@dataclass(frozen=True, kw_only=True)
class JointState:
    """Committed state of ``n`` joint points.

    Attributes:
        gap: Gap vector (n, s1, s2) at the last accepted step, shape (n, 3), [m].
        elastic_slip: Part of the tangential gap that holds shear traction, shape (n, 2), [m].
        internal: Further variables of the laws that have some, shape (n, m); zero at first.
        dt: Length of the step that starts here, infinite in statics [s].
    """

    gap: Floats
    elastic_slip: Floats
    internal: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    dt: float = math.inf

    @classmethod
    def at_rest(cls, gap: Floats, *, variables: int = 0) -> JointState:
        """State without shear traction at a given gap, shape (n, 3), [m].

        Args:
            gap: The gap, shape (n, 3), [m].
            variables: Number m of internal variables.
        """
        count = len(gap)
        return cls(
            gap=gap.copy(),
            elastic_slip=np.zeros((count, 2)),
            internal=np.zeros((count, variables)),
        )


@dataclass(frozen=True, kw_only=True)
class Response:
    """Answer of a law to a trial gap of ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d gap, shape (n, 3, 3), [Pa/m].
        state: State to keep if the step is accepted.
        dissipation: Friction work of the step per area, shape (n,), [J/m^2]; at the end point the
            mean tangential traction times the plastic slip in contact, which is what the
            trapezoidal rule sees, and may be negative where slip reverses within a long step.
        status: `Status` of each point, shape (n,).
    """

    traction: Floats
    tangent: Floats
    state: JointState
    dissipation: Floats
    status: NDArray[np.int8]


class Law(Protocol):
    """What a joint needs from a law; implement it to use a law of your own.

    A law may also offer

    - ``discrete_gradient(gap, state)``, its answer over a whole step from ``state.gap`` to ``gap``
      such that the work of the traction over the step is what the joint stores and dissipates;
      without it energy-consistent schemes use ``backward_euler`` for this law, and what that loses
      is counted as numerical;
    - ``condensed_backward_euler(trial_gap, compliance, state)`` and
      ``condensed_discrete_gradient`` with the same arguments, as `FrictionNoTension` does; without
      them a model is solved on the monolithic path.

    A law with a history of its own names it in ``internal_variables``, a tuple of strings: it then
    finds one column for each in ``state.internal``, zero at first unless the law has a method
    ``initial_variables(gap)``, and returns the new ones in the state of its response.
    """

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Traction and consistent tangent at the end of a step, gap of shape (n, 3), [m]."""

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy per area of a state, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Normal and shear stiffness while closed and sticking, [Pa/m]."""


def gap_under(trial_gap: Floats, compliance: Floats, traction: Floats) -> Floats:
    """The gap that a traction leaves of a free gap, shape (n, 3), [m]."""
    gap = trial_gap.copy()
    gap[:, 0] -= compliance[:, 0] * traction[:, 0]
    gap[:, 1:] -= compliance[:, 1:] * traction[:, 1:]
    return gap


def check_law(name: str, law: Any) -> None:
    """Refuse what is no joint law.

    Raises:
        ValueError: It has not the methods of one, or its stiffness is none.
    """
    good = offers(law, "backward_euler", "stored_energy", "closed_stiffness")
    check_kind_of(name, law, good, "a joint law")
    stiffness = numbers_of(law.closed_stiffness())
    if stiffness is None or stiffness.shape != (2,) or not (stiffness >= 0.0).all():
        raise ValueError(
            f"{type(law).__name__}.closed_stiffness() gives {shown(law.closed_stiffness())}; it "
            "must be two numbers of zero or more, k_n and k_s."
        )
