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
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.checks import check_number

Floats = NDArray[np.float64]


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
    """

    gap: Floats
    elastic_slip: Floats

    @classmethod
    def at_rest(cls, gap: Floats) -> JointState:
        """State without shear traction at a given gap, shape (n, 3), [m]."""
        return cls(gap=gap.copy(), elastic_slip=np.zeros((len(gap), 2)))


@dataclass(frozen=True, kw_only=True)
class Response:
    """Answer of a law to a trial gap of ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d gap, shape (n, 3, 3), [Pa/m].
        state: State to keep if the step is accepted.
        dissipation: Friction work of the step per area, shape (n,), [J/m^2]: mean tangential
            traction of the step times its plastic slip.
        status: `Status` of each point, shape (n,).
    """

    traction: Floats
    tangent: Floats
    state: JointState
    dissipation: Floats
    status: NDArray[np.int8]


class Law(Protocol):
    """What a joint needs from a law; implement it to use a law of your own.

    A law may also offer ``local_solve(free_gap, compliance, state)``, as `FrictionNoTension` does;
    without it a model is solved on the monolithic path.
    """

    def end_point(self, gap: Floats, state: JointState) -> Response:
        """Traction and consistent tangent at the end of a step, gap of shape (n, 3), [m]."""

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy per area of a state, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Normal and shear stiffness while closed and sticking, [Pa/m]."""


@dataclass(frozen=True, kw_only=True)
class FrictionNoTension:
    """No tension, elastic contact, Coulomb friction without dilatancy (paper eqs. 3 to 5).

    Open (gap_n > 0): t = 0. Closed: t_n = k_n gap_n, t_s = k_s e with |t_s| <= -t_n tan(alpha);
    sliding changes t_s along itself only (plastic potential |t_s|), so the tangent is unsymmetric.
    On opening the elastic slip e becomes zero: what slip there is, is plastic.

    Departure from the paper: compression is negative here, so its yield function
    |t_s| - t_n tan(alpha) reads |t_s| + t_n tan(alpha).

    Attributes:
        normal_stiffness: k_n [Pa/m], positive.
        shear_stiffness: k_s [Pa/m], not negative.
        friction_angle_deg: alpha [degrees], at least 0 and below 90.

    Raises:
        ValueError: A parameter is out of its range.
    """

    normal_stiffness: float
    shear_stiffness: float
    friction_angle_deg: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        check_number(
            "normal_stiffness",
            self.normal_stiffness,
            lambda v: v > 0,
            "positive and finite",
            unit="Pa/m",
        )
        check_number(
            "shear_stiffness",
            self.shear_stiffness,
            lambda v: v >= 0,
            "zero or more and finite",
            unit="Pa/m",
        )
        check_number(
            "friction_angle_deg",
            self.friction_angle_deg,
            lambda v: 0 <= v < 90,
            "at least 0 and below 90 degrees",
        )

    @property
    def friction_coefficient(self) -> float:
        """Mu = tan(alpha)."""
        return math.tan(math.radians(self.friction_angle_deg))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """k_n <-gap_n>^2 / 2 + k_s |e|^2 / 2 of each point, shape (n,), [J/m^2]."""
        closed = np.minimum(state.gap[:, 0], 0.0)
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        return 0.5 * self.normal_stiffness * closed**2 + 0.5 * self.shear_stiffness * slip

    def end_point(self, gap: Floats, state: JointState) -> Response:
        """Return mapping at the end of a step (backward Euler, closed form).

        Args:
            gap: Trial gap, shape (n, 3), [m].
            state: State at the start of the step.

        Returns:
            Tractions, consistent tangent, trial state, friction work and status.
        """
        k_n = np.full(len(gap), self.normal_stiffness)
        k_s = np.full(len(gap), self.shear_stiffness)
        traction, tangent, status = self._project(gap, state, k_n, k_s)
        t_s = traction[:, 1:]
        elastic_slip: NDArray[Any] = np.zeros_like(t_s)
        if self.shear_stiffness > 0.0:
            elastic_slip = t_s / self.shear_stiffness
        plastic = gap[:, 1:] - state.gap[:, 1:] - (elastic_slip - state.elastic_slip)
        mean = 0.5 * (t_s + self.shear_stiffness * state.elastic_slip)
        return Response(
            traction=traction,
            tangent=tangent,
            state=JointState(gap=gap.copy(), elastic_slip=elastic_slip),
            dissipation=np.einsum("ij,ij->i", mean, plastic),
            status=status,
        )

    def local_solve(
        self, free_gap: Floats, compliance: Floats, state: JointState
    ) -> tuple[Floats, Floats, NDArray[np.int8]]:
        """Tractions that satisfy the law at gap = free_gap - compliance * t (closed form).

        With the compliance c of the structure at the point, the law's stiffness k becomes
        1 / (c + 1/k); nothing else changes.

        Args:
            free_gap: Gap if the point carried no traction, shape (n, 3), [m].
            compliance: Normal and tangential compliance, shape (n, 2), [m/Pa].
            state: State at the start of the step.

        Returns:
            Tractions (n, 3) [Pa], d traction / d free_gap (n, 3, 3) [Pa/m], and status (n,).
        """
        k_n: NDArray[Any] = 1.0 / (compliance[:, 0] + 1.0 / self.normal_stiffness)
        k_s: NDArray[Any] = np.zeros(len(free_gap))
        if self.shear_stiffness > 0.0:
            k_s = 1.0 / (compliance[:, 1] + 1.0 / self.shear_stiffness)
        return self._project(free_gap, state, k_n, k_s)

    def _project(
        self, gap: Floats, state: JointState, k_n: Floats, k_s: Floats
    ) -> tuple[Floats, Floats, NDArray[np.int8]]:
        """Traction, tangent and status with a stiffness for each point, shape (n,), [Pa/m]."""
        mu = self.friction_coefficient
        closed = gap[:, 0] <= 0.0
        t_n = np.where(closed, k_n * gap[:, 0], 0.0)
        limit = -mu * t_n
        trial = k_s[:, None] * (state.elastic_slip + gap[:, 1:] - state.gap[:, 1:])
        size = np.hypot(trial[:, 0], trial[:, 1])
        slides = closed & (size > limit)
        sticks = closed & ~slides
        safe = np.where(size > 0.0, size, 1.0)
        direction = trial / safe[:, None]
        ratio = np.where(sticks, 1.0, np.where(slides, limit / safe, 0.0))
        tangent = np.zeros((len(gap), 3, 3))
        tangent[:, 0, 0] = np.where(closed, k_n, 0.0)
        tangent[:, 1:, 0] = np.where(slides, -mu * k_n, 0.0)[:, None] * direction
        tangent[:, 1:, 1:] = (ratio * k_s)[:, None, None] * np.eye(2)
        tangent[:, 1:, 1:] -= np.where(slides, ratio * k_s, 0.0)[:, None, None] * (
            direction[:, :, None] * direction[:, None, :]
        )
        status = np.where(slides, Status.SLIP, np.where(sticks, Status.STICK, Status.OPEN))
        return np.column_stack([t_n, ratio[:, None] * trial]), tangent, status.astype(np.int8)
