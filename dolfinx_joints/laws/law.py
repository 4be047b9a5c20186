# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocols of joint laws, with their states and responses: arrays in, arrays out.

A law receives the gap vector of each joint point in the local frame (n, s1, s2), including the
initial gap. A point is open if ``gap[:, 0] > 0`` and closed otherwise; tractions are negative in
compression. A law never changes the state that it receives. It returns the new state, which the
caller keeps if the step is accepted.

A joint requires a `Law`; with the condensed solver a `CondensedLaw` suffices. Optional protocols:
`EnergyConsistentLaw`, `CondensedEnergyConsistentLaw`, `LawWithHistory`, `RateDependentLaw`,
`LawWithLosses`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cache
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Floats as Floats
from dolfinx_joints.common.parameters import shown

NO_COMPLIANCE: Floats = np.zeros((1, 2))


class Status(IntEnum):
    """Contact status of a joint point, with the numbers used in results files.

    Attributes:
        OPEN: The two sides do not touch.
        STICK: Closed, below the limit of the shear traction.
        SLIP: Closed, at the limit of the shear traction.
        FRICTIONLESS: Closed, without shear resistance: neither friction nor bond.
        TIED: At the end of a joint inside a body, where both sides share their nodes. Only
            `Contact.shown_status` sets this value, never a law.
    """

    OPEN = 0
    STICK = 1
    SLIP = 2
    FRICTIONLESS = 3
    TIED = 4


@dataclass(frozen=True, kw_only=True)
class StatusCounts:
    """Number of joint points of each `Status` on all ranks."""

    open: int
    stick: int
    slip: int
    frictionless: int = 0
    tied: int = 0

    @property
    def total(self) -> int:
        """Number of points that can open or slide, without tied points."""
        return self.open + self.stick + self.slip + self.frictionless


@dataclass(frozen=True, kw_only=True)
class Rule:
    """Rule by which a time scheme evaluates the laws.

    Attributes:
        name: Name of the law's method.
        weight: d traction / d gap of a sticking point divided by its stiffness k: 1 for the
            traction at the end of a step, 1/2 for the mean over a whole step.
        dt: Length of the step for rate-dependent joint laws [s], infinite in statics.
        elapsed: Length of the step for materials [s]: zero in load ramps, the time between the
            times of quasi-static stages.
    """

    name: str
    weight: float
    dt: float = math.inf
    elapsed: float = 0.0

    def over(self, dt: float) -> Rule:
        """Return the rule for a step of length dt [s]."""
        return replace(self, dt=dt, elapsed=dt)


# Traction at the end of the step, or its mean over the step with an exact energy balance.
BACKWARD_EULER = Rule(name="backward_euler", weight=1.0)
DISCRETE_GRADIENT = Rule(name="discrete_gradient", weight=0.5)


@dataclass(frozen=True, kw_only=True)
class JointState:
    """Committed state of ``n`` joint points.

    Attributes:
        gap: Gap vector (n, s1, s2) at the last accepted step, shape (n, 3), [m].
        elastic_slip: Elastic part of the tangential gap, shape (n, 2), [m].
        internal: Internal variables (history variables) of the laws, shape (n, m).
        slips: Plastic slips of the last two steps [m], latest first, scaled to the length of the
            next step, and half the last friction work [J/m^2]. Shape (n, 5), or empty if no law
            uses slips. They predict slip reversal within a step (`turning`).
        approach: Normal gap change of a step at its initial velocity, shape (n,), [m]. A scheme
            sets this array for laws whose points do not rebound; otherwise it is empty.
    """

    gap: Floats
    elastic_slip: Floats
    internal: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    slips: Floats = field(default_factory=lambda: np.zeros((0, 5)))
    approach: Floats = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def at_rest(cls, gap: Floats, *, variables: int = 0) -> JointState:
        """Return the state without shear traction at a given gap.

        Args:
            gap: Gap, shape (n, 3), [m].
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
    """Response of a law at ``n`` points.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d gap, shape (n, 3, 3), [Pa/m].
        state: New state, which becomes the committed state if the step is accepted.
        dissipation: Friction work of the step per area, shape (n,), [J/m^2]. For backward Euler it
            is the mean of the law's tractions at both ends times the plastic slip in contact
            (trapezoidal rule). It may be negative if slip reverses within a long step.
        status: `Status` of each point, shape (n,).
    """

    traction: Floats
    tangent: Floats
    state: JointState
    dissipation: Floats
    status: NDArray[np.int8]


@runtime_checkable
class Law(Protocol):
    """Joint law with a traction-gap relation; implement it for a user-defined law."""

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return traction and consistent tangent at the end of a step, gap (n, 3), [m]."""

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy per area, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Return normal and shear stiffness of a closed, sticking point, [Pa/m]."""


@runtime_checkable
class EnergyConsistentLaw(Law, Protocol):
    """Joint law that can also be evaluated over a whole step.

    For other laws, energy-consistent schemes use `Law.backward_euler`; its energy losses then count
    as numerical (`LawWithLosses`).
    """

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Return a traction whose work over the step equals stored plus dissipated energy."""


class Losses(NamedTuple):
    """Energy losses of a step at ``n`` points, each of shape (n,), [J/m^2].

    Attributes:
        friction: Dissipation of the law.
        numerical: Dissipation of the time scheme; an energy gain if negative.
        impact: Loss at points that close without rebound.
    """

    friction: Floats
    numerical: Floats
    impact: Floats | float = 0.0


@runtime_checkable
class LawWithLosses(Protocol):
    """Joint law with formulas for the losses of a step with `Law.backward_euler`.

    For other laws the numerical loss of such steps is obtained by difference, so the energy balance
    cannot detect errors in these laws.
    """

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the energy losses of a step on which a constant traction acts.

        Args:
            before: State at the start of the step.
            answer: Response of the law.
            traction: Traction at the end of the step, or mean of start and end, (n, 3), [Pa].
        """


@runtime_checkable
class CondensedLaw(Protocol):
    """Joint law with a method for its response on a compliance; others need `on_compliance`.

    A `CondensedLaw` that is not also a `Law` (a rigid joint) has no traction-gap relation.
    """

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return the response at the end of a step at gap = trial_gap - compliance * traction.

        Args:
            trial_gap: Gap without traction, shape (n, 3), [m].
            compliance: Normal and tangential compliance, shape (n or 1, 2), [m/Pa].
            state: State at the start of the step.

        Returns:
            The response; its tangent is d traction / d trial_gap.
        """

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy per area, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Return normal and shear stiffness when closed and sticking, infinite if rigid, [Pa/m]."""


@runtime_checkable
class CondensedEnergyConsistentLaw(CondensedLaw, Protocol):
    """Joint law that the condensed solver can evaluate over a whole step."""

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return the response over a step ending at gap = trial_gap - compliance * traction."""


@runtime_checkable
class LawWithHistory(Protocol):
    """Joint law with internal variables, one column of ``state.internal`` each.

    The law returns their new values in the state of its response.
    """

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Names of the internal variables."""

    def initial_variables(self, gap: Floats) -> Floats:
        """Return the values at rest at a gap (n, 3), shape (n, number of variables)."""


# States of a bond or shear key. During the solution of a step an intact bond is either locked
# (`HELD`: the bond cannot break) or `RELEASED` (the bond breaks in this step). A locked bond that
# is loaded beyond its strength has the value -load / strength, which is below `HELD`.
INTACT, BROKEN, HELD, RELEASED = 0.0, 1.0, -1.0, 0.5
LARGEST_OVERLOAD = 1e9  # load / strength of a loaded bond without strength

# Largest value of load / strength - 1 at which a bond does not break. Otherwise rounding error
# would decide whether a bond that is loaded exactly to its strength breaks, as in symmetric models.
# The error of computed loads is at most 1e-10.
OVERLOAD_ROUNDING = 1e-9


@runtime_checkable
class BrittleLaw(LawWithHistory, Protocol):
    """Joint law with bonds that break permanently; the first internal variable is the bond state.

    Solvers lock the bonds during a step and release the bonds that the converged solution
    overloads. Otherwise a bond broken by an intermediate iterate would stay broken. A locked bond
    is elastic; `bond_under` of `points.return_mapping` returns its new bond variable.
    """

    breaks: ClassVar[bool]


def has_bonds(law: Any) -> bool:
    """Return True if a law has bonds that can break."""
    return isinstance(law, BrittleLaw) and law.breaks


def with_bonds(internal: Floats, released: NDArray[np.bool_]) -> Floats:
    """Return internal variables (n, m) of a brittle law with intact bonds locked or released."""
    variables, bonds = internal.copy(), np.where(released, RELEASED, HELD)
    variables[:, 0] = np.where(internal[:, 0] == INTACT, bonds, internal[:, 0])
    return variables


@runtime_checkable
class RateDependentLaw(Law, Protocol):
    """Joint law that depends on the rate of the gap; statics use its other methods."""

    def for_step(self, dt: float) -> Law:
        """Return the law for a step of length dt [s], infinite in statics."""


AnyLaw: TypeAlias = Law | CondensedLaw


def check_law(name: str, law: Any) -> None:
    """Check that a value is an instance of a joint law.

    Raises:
        ValueError: The value is a class, or lacks methods of `Law` and `CondensedLaw`.
    """
    if isinstance(law, type) or not isinstance(law, Law | CondensedLaw):
        raise ValueError(f"{name} is {shown(law)}; it must be a joint law.")


@cache
def changes_gap_methods(cls: type) -> bool:
    """Return True if a subclass of a compiled or condensed law overrides the methods at a gap.

    The response on a compliance is then computed from these methods, not by inherited ones.
    """

    def depth(*names: str) -> int:
        levels = (i for i, c in enumerate(cls.__mro__) if not vars(c).keys().isdisjoint(names))
        return next(levels, len(cls.__mro__))

    inherited = "points", "loops", "condensed_backward_euler", "condensed_discrete_gradient"
    return depth("backward_euler", "discrete_gradient") < depth(*inherited)


def variables_of(law: Any) -> tuple[str, ...]:
    """Return the names of the internal variables of a law."""
    return law.internal_variables if isinstance(law, LawWithHistory) else ()


class Inactive:
    """Joint law with zero traction at any gap."""

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Return zero traction at a gap of shape (n, 3), [m]."""
        count = len(gap)
        return Response(
            traction=np.zeros((count, 3)),
            tangent=np.zeros((count, 3, 3)),
            state=JointState.at_rest(gap),
            dissipation=np.zeros(count),
            status=np.full(count, Status.OPEN, dtype=np.int8),
        )

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return zero traction, so that the gap equals the trial gap."""
        return self.backward_euler(trial_gap, state)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return zero losses."""
        return Losses(np.zeros(len(traction)), np.zeros(len(traction)))

    def stored_energy(self, state: JointState) -> Floats:
        """Return zero energies, shape (n,), [J/m^2]."""
        return np.zeros(len(state.gap))

    def closed_stiffness(self) -> tuple[float, float]:
        """Return zero stiffnesses, [Pa/m]."""
        return 0.0, 0.0
