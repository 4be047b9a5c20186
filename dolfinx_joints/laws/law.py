# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Protocols of joint laws, with their states and responses: arrays in, arrays out.

A law sees the gap vector of each joint point in the local frame (n, s1, s2), with the initial gap
already included: ``gap[:, 0] > 0`` is open, ``gap[:, 0] <= 0`` closed, tractions are negative in
compression. A trial never changes the state it starts from; whoever accepts a step keeps the state
that the trial returned.

A joint takes a `Law`, or a `CondensedLaw` with the condensed solver alone. A law may give more:
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

from dolfinx_joints.common.parameters import shown

Floats = NDArray[np.float64]

NO_COMPLIANCE: Floats = np.zeros((1, 2))


class Status(IntEnum):
    """What a joint point does, as files number it.

    Attributes:
        OPEN: The two sides do not touch.
        STICK: Closed, below the limit of the shear traction.
        SLIP: Closed, at the limit.
        FRICTIONLESS: Closed, by a law without shear resistance: neither friction nor bond.
        TIED: At the end of a joint inside a body, where both sides share their nodes. Laws never
            return it; `Contact.shown_status` sets it.
    """

    OPEN = 0
    STICK = 1
    SLIP = 2
    FRICTIONLESS = 3
    TIED = 4


@dataclass(frozen=True, kw_only=True)
class StatusCounts:
    """Joint points by what they do, as `Status` says, on all ranks."""

    open: int
    stick: int
    slip: int
    frictionless: int = 0
    tied: int = 0

    @property
    def total(self) -> int:
        """Number of points that can open or slide: all but tied ones."""
        return self.open + self.stick + self.slip + self.frictionless


@dataclass(frozen=True, kw_only=True)
class Rule:
    """How a time scheme asks the laws.

    Attributes:
        name: The method asked.
        weight: d traction / d gap of a sticking point over its stiffness k: 1 at the end of a step,
            1/2 over a whole step.
        dt: Length of the step [s], infinite in statics.
    """

    name: str
    weight: float
    dt: float = math.inf

    def over(self, dt: float) -> Rule:
        """The rule for a step of length dt [s]."""
        return replace(self, dt=dt)


# At the end of a step, and by the mean of a step, in which energy balances.
BACKWARD_EULER = Rule(name="backward_euler", weight=1.0)
DISCRETE_GRADIENT = Rule(name="discrete_gradient", weight=0.5)


@dataclass(frozen=True, kw_only=True)
class JointState:
    """Committed state of ``n`` joint points.

    Attributes:
        gap: Gap vector (n, s1, s2) at the last accepted step, shape (n, 3), [m].
        elastic_slip: Part of the tangential gap that holds shear traction, shape (n, 2), [m].
        internal: Further variables of the laws that have some, shape (n, m).
        slips: Plastic slips of the last step and of the one before it [m], as if these had been as
            long as the next, and half the work of friction in the last [J/m^2], shape (n, 5); empty
            where no law keeps them. By these slip turns within a step (`turning`).
        approach: Normal way that a step would make with the velocity at its start, shape (n,), [m];
            a scheme adds it before it asks laws whose points do not rebound, else empty.
    """

    gap: Floats
    elastic_slip: Floats
    internal: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    slips: Floats = field(default_factory=lambda: np.zeros((0, 5)))
    approach: Floats = field(default_factory=lambda: np.zeros(0))

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
        dissipation: Friction work of the step per area, shape (n,), [J/m^2]; at the end point that
            of the mean of the law's tractions at both ends on the plastic slip in contact, which is
            what the trapezoidal rule sees, and may be negative where slip reverses within a long
            step.
        status: `Status` of each point, shape (n,).
    """

    traction: Floats
    tangent: Floats
    state: JointState
    dissipation: Floats
    status: NDArray[np.int8]


@runtime_checkable
class Law(Protocol):
    """A joint law that follows from gaps; implement it for a user-defined law."""

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Traction and consistent tangent at the end of a step, gap of shape (n, 3), [m]."""

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy per area of a state, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Normal and shear stiffness while closed and sticking, [Pa/m]."""


@runtime_checkable
class EnergyConsistentLaw(Law, Protocol):
    """A law with an answer over a whole step.

    Energy-consistent schemes ask other laws for `Law.backward_euler`; what that loses is counted as
    numerical (`LawWithLosses`).
    """

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Traction whose work from ``state.gap`` to ``gap`` is what is stored and dissipated."""


class Losses(NamedTuple):
    """What is lost of the work of a step on ``n`` points, each of shape (n,), [J/m^2].

    Attributes:
        friction: Dissipated by the law.
        numerical: By the time scheme; gained if negative.
        impact: Where points strike and do not rebound.
    """

    friction: Floats
    numerical: Floats
    impact: Floats | float = 0.0


@runtime_checkable
class LawWithLosses(Protocol):
    """A law with formulas of its own for what a step loses that `Law.backward_euler` answered.

    Of another law the numerical loss in such steps is the rest of the work on its points, so that
    the energy balance says nothing of these.
    """

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """What is lost of the work of a traction that acts over a step.

        Args:
            before: State at the start of the step.
            answer: What the law answered.
            traction: That of the end, or the mean of both ends, shape (n, 3), [Pa].
        """


@runtime_checkable
class CondensedLaw(Protocol):
    """A law with its own answer on a compliance; of others `on_compliance` finds it.

    A law that is not a `Law` besides, as a rigid joint, carries nothing that follows from its gap.
    """

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Answer at the end of a step at gap = trial_gap - compliance * traction.

        Args:
            trial_gap: Gap if the point carried no traction, shape (n, 3), [m].
            compliance: Normal and tangential compliance, shape (n or 1, 2), [m/Pa].
            state: State at the start of the step.

        Returns:
            The answer at that gap, its tangent being d traction / d trial_gap.
        """

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy per area of a state, shape (n,), [J/m^2]."""

    def closed_stiffness(self) -> tuple[float, float]:
        """Normal and shear stiffness while closed and sticking, infinite if rigid, [Pa/m]."""


@runtime_checkable
class CondensedEnergyConsistentLaw(CondensedLaw, Protocol):
    """A law that the condensed solver can ask over a whole step."""

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Answer over a step that ends at gap = trial_gap - compliance * traction."""


@runtime_checkable
class LawWithHistory(Protocol):
    """A law with internal variables: it finds a column of ``state.internal`` for each.

    It returns the new ones in the state of its response.
    """

    @property
    def internal_variables(self) -> tuple[str, ...]:
        """Their names."""

    def initial_variables(self, gap: Floats) -> Floats:
        """Their values at rest at a gap of shape (n, 3), shape (n, number of variables)."""


# What bonds, or keys, are. While a step is solved intact ones are held, or released: they break in
# it. A bond that was held and bears more than its strength is minus the ratio of both, below HELD.
INTACT, BROKEN, HELD, RELEASED = 0.0, 1.0, -1.0, 0.5
LARGEST_OVERLOAD = 1e9  # of bonds without the strength that is asked for

# Relative excess of load over strength that a bond bears. A bond that is loaded to just its
# strength, as in tests and symmetric models, would break or not by the last bit. Solved loads err
# by 1e-10 at most.
BORNE = 1e-9


@runtime_checkable
class BrittleLaw(LawWithHistory, Protocol):
    """A law with bonds that break for good, the first of its internal variables saying which.

    Solvers hold the bonds in a step, and release those that its solution overloads: one that an
    iterate on the way breaks would stay broken. A bond that is held answers as if it could not
    break; in the state of the response it is what `bond_under` of
    `points.return_mapping` gives.
    """

    breaks: ClassVar[bool]


def has_bonds(law: Any) -> bool:
    """Whether a law has bonds that break for good."""
    return isinstance(law, BrittleLaw) and law.breaks


def with_bonds(internal: Floats, released: NDArray[np.bool_]) -> Floats:
    """Internal variables of a brittle law with intact bonds held, or released, shape (n, m)."""
    given, bonds = internal.copy(), np.where(released, RELEASED, HELD)
    given[:, 0] = np.where(internal[:, 0] == INTACT, bonds, internal[:, 0])
    return given


@runtime_checkable
class RateDependentLaw(Law, Protocol):
    """A law that depends on the rate of the gap; its own methods are those of statics."""

    def for_step(self, dt: float) -> Law:
        """The law of a step of length dt [s], infinite in statics."""


AnyLaw: TypeAlias = Law | CondensedLaw


def check_law(name: str, law: Any) -> None:
    """Check that a value is a joint law; a class in the place of an object is none.

    Raises:
        ValueError: It does not give what one gives.
    """
    if isinstance(law, type) or not isinstance(law, Law | CondensedLaw):
        raise ValueError(f"{name} is {shown(law)}; it must be a joint law.")


@cache
def changes_gap_methods(cls: type) -> bool:
    """Return True if a class changes the methods at a gap of a compiled or condensed law.

    Its answers on a compliance then follow from these methods, not from the inherited ones.
    """

    def depth(*names: str) -> int:
        found = (i for i, each in enumerate(cls.__mro__) if not vars(each).keys().isdisjoint(names))
        return next(found, len(cls.__mro__))

    inherited = "points", "loops", "condensed_backward_euler", "condensed_discrete_gradient"
    return depth("backward_euler", "discrete_gradient") < depth(*inherited)


def variables_of(law: Any) -> tuple[str, ...]:
    """Names of the internal variables of a law."""
    return law.internal_variables if isinstance(law, LawWithHistory) else ()
