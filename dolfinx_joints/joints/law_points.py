# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of one law: choice of the method for a rule, check of the results, brittle bonds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.arrays import Flags, Ints
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.laws.law import (
    BROKEN,
    DISCRETE_GRADIENT,
    HELD,
    NO_COMPLIANCE,
    AnyLaw,
    CondensedEnergyConsistentLaw,
    CondensedLaw,
    EnergyConsistentLaw,
    Floats,
    JointState,
    Law,
    LawWithHistory,
    LawWithLosses,
    Losses,
    RateDependentLaw,
    Response,
    Rule,
    changes_gap_methods,
    has_bonds,
    with_bonds,
)
from dolfinx_joints.laws.losses import losses_of
from dolfinx_joints.laws.points.compiled_law import CompiledLaw
from dolfinx_joints.laws.points.on_compliance import on_compliance

if TYPE_CHECKING:
    from dolfinx_joints.laws.rigid import RigidJoint

# Shapes of the arrays of a response, after the number of points.
_SHAPES: dict[str, tuple[int, ...]] = {
    "traction": (3,),
    "tangent": (3, 3),
    "dissipation": (),
    "status": (),
    "gap": (3,),
    "elastic_slip": (2,),
}


class LawPoints:
    """Points of one law.

    Attributes:
        law: The law.
        points: Local numbers of the points.
        kind: Class name of the law.
        variables: Number of internal variables.
        has_whole_steps: True if the law has an energy-consistent method for whole steps.
        has_losses: True if the law has formulas for its losses in backward Euler steps.
        brittle: True if the law has bonds that can break.
        stops: True if the points do not rebound.
        softening: Largest decrease of the tractions with opening and slip [Pa/m].
        fracture: Column of the internal variable ``fracture_energy``, None without it.

    Raises:
        ValueError: The internal variables do not conform to `LawWithHistory`, or the stiffness is
            not two numbers.
    """

    def __init__(self, law: AnyLaw, points: Ints) -> None:
        from dolfinx_joints.laws.rigid import RigidJoint
        from dolfinx_joints.laws.viscous import DashpotStep

        self.law, self.points, self.kind = law, points, type(law).__name__
        names = getattr(law, "internal_variables", ())
        valid = isinstance(names, tuple | list) and all(isinstance(n, str) for n in names)
        if not valid or (names and not isinstance(law, LawWithHistory)):
            raise ValueError(
                f"{self.kind}: internal_variables is {shown(names)}; it must be a tuple of names, "
                "and the law must have a method initial_variables(gap)."
            )
        stiffness: Any = law.closed_stiffness()
        if np.shape(stiffness) != (2,) or not all(k >= 0.0 for k in stiffness):
            raise ValueError(
                f"{self.kind}.closed_stiffness returned {shown(stiffness)}; it must return normal "
                "and shear stiffness, two numbers of at least 0 Pa/m."
            )
        self.variables = len(names)
        self.softening = getattr(getattr(law, "law", law), "steepest_softening", (0.0, 0.0))
        self.fracture = names.index("fracture_energy") if "fracture_energy" in names else None
        self._law_of_steps: Callable[[float], AnyLaw] = lambda dt: law
        if isinstance(law, RateDependentLaw):
            self._law_of_steps = law.for_step
        step = self._law_of_steps(math.inf)
        inner = step.law if isinstance(step, DashpotStep) else step
        self.has_whole_steps = isinstance(inner, EnergyConsistentLaw | CondensedEnergyConsistentLaw)
        self.has_losses = isinstance(inner, LawWithLosses)
        self.brittle = has_bonds(inner)
        self._rigid: RigidJoint | None = law if isinstance(law, RigidJoint) else None
        self.stops = self._rigid is not None and self._rigid.restitution == 0

    def subset(self, chosen: Flags) -> LawPoints:
        """Return a copy with a part of the points; ``chosen`` is a flag per local point, (n,)."""
        part = copy(self)
        part.points = self.points[chosen[self.points]]
        return part

    def state_of(self, state: JointState) -> JointState:
        """Return the state of these points from the state of all local points."""
        part = JointState(gap=state.gap[self.points], elastic_slip=state.elastic_slip[self.points])
        if self.variables:
            part = replace(part, internal=state.internal[self.points, : self.variables])
        if len(state.slips):
            part = replace(part, slips=state.slips[self.points])
        if len(state.approach):
            part = replace(part, approach=state.approach[self.points])
        return part

    def response_of(self, answer: Response) -> Response:
        """Return the response of these points from the response of all local points."""
        points = self.points
        return Response(
            traction=answer.traction[points],
            tangent=answer.tangent[points],
            state=self.state_of(answer.state),
            dissipation=answer.dissipation[points],
            status=answer.status[points],
        )

    def initial_variables(self, gap: Floats) -> Floats:
        """Return the internal variables at rest at a gap, shape (n, variables)."""
        if not isinstance(self.law, LawWithHistory):
            return np.zeros((len(gap), 0))
        first, wanted = numbers_of(self.law.initial_variables(gap)), (len(gap), self.variables)
        if first is None or first.shape != wanted:
            raise ValueError(
                f"{self.kind}.initial_variables must return numbers of shape {wanted}, one column "
                "for each internal variable."
            )
        return first

    def law_over(self, rule: Rule) -> AnyLaw:
        """Return the law for the step length of a rule."""
        return self._law_of_steps(rule.dt)

    def compiled_over(self, rule: Rule) -> CompiledLaw | None:
        """Return `law_over` if compiled loops compute all responses of the law, else None."""
        law = self.law_over(rule)
        return law if isinstance(law, CompiledLaw) and law.uses_only_loops() else None

    def evaluate(
        self, rule: Rule, gap: Floats, compliance: Floats | None, state: JointState
    ) -> Response:
        """Return the response of these points at a gap, or at a trial gap on a compliance.

        Raises:
            ValueError: The law returned an invalid response.
        """
        law = self.law_over(rule)

        def answer(at: Floats) -> Response:
            return self._check_response(_methods(law)[rule.name](at, state), len(gap))

        if compliance is None:
            return answer(gap)
        condensed = _condensed_methods(law).get(rule.name)
        if condensed is not None:
            return self._check_response(condensed(gap, compliance, state), len(gap))
        return on_compliance(answer, state.gap, gap, compliance, law.closed_stiffness())

    def write_to(self, part: Response, answer: Response) -> None:
        """Write the response of these points to the response of all local points."""
        points = self.points
        for name in ("traction", "tangent", "dissipation", "status"):
            getattr(answer, name)[points] = getattr(part, name)
        answer.state.gap[points] = part.state.gap
        answer.state.elastic_slip[points] = part.state.elastic_slip
        if len(part.state.slips):
            answer.state.slips[points] = part.state.slips
        if self.variables:
            answer.state.internal[points, : self.variables] = part.state.internal

    def states_losses(self, rule: Rule) -> bool:
        """Return True if the law computes its losses, so that the energy balance checks the law."""
        return self.has_losses or (rule.name == DISCRETE_GRADIENT.name and self.has_whole_steps)

    def losses(self, rule: Rule, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses of a step at these points; arguments as in `LawWithLosses`."""
        if rule.name == DISCRETE_GRADIENT.name and self.has_whole_steps:
            lost = Losses(answer.dissipation, np.zeros(len(traction)))
            if self._rigid is not None and self.stops:
                lost = lost._replace(impact=self._rigid.impact(before, answer))
            return lost
        return losses_of(self.law_over(rule), before, answer, traction)

    def _check_response(self, response: Response, count: int) -> Response:
        if not (isinstance(response, Response) and isinstance(response.state, JointState)):
            raise ValueError(f"{self.kind} returned {shown(response)}; it must be a Response.")
        for name, shape in _SHAPES.items():
            array = getattr(response.state if name in ("gap", "elastic_slip") else response, name)
            numeric = isinstance(array, np.ndarray) and array.dtype.kind in "iuf"
            if not numeric or array.shape != (count, *shape):
                raise ValueError(
                    f"{self.kind} returned {name} {shown(array)}; it must be an array of numbers "
                    f"of shape {(count, *shape)}."
                )
        wanted = (count, self.variables)
        if self.variables and response.state.internal.shape != wanted:
            raise ValueError(
                f"{self.kind} returned internal variables of shape {response.state.internal.shape};"
                f" for {count} points and {self.variables} names it must be {wanted}."
            )
        return response


def _methods(law: AnyLaw) -> dict[str, Callable[..., Response]]:
    """Return the methods at a gap by rule; without a whole-step method, use backward Euler."""
    end = law.backward_euler if isinstance(law, Law) else partial(_without_pressure, law)
    whole = law.discrete_gradient if isinstance(law, EnergyConsistentLaw) else end
    return {"backward_euler": end, "discrete_gradient": whole}


def _condensed_methods(law: AnyLaw) -> dict[str, Callable[..., Response]]:
    """Return the law's methods on a compliance by rule, none for most laws."""
    if not isinstance(law, CondensedLaw) or changes_gap_methods(type(law)):
        return {}
    methods = {"backward_euler": law.condensed_backward_euler}
    if isinstance(law, CondensedEnergyConsistentLaw):
        methods["discrete_gradient"] = law.condensed_discrete_gradient
    elif not isinstance(law, EnergyConsistentLaw):
        methods["discrete_gradient"] = law.condensed_backward_euler
    return methods


def _without_pressure(law: Any, gap: Floats, state: JointState) -> Response:
    """Return the response of a rigid joint without a compliance, at points without pressure.

    Raises:
        JointsError: A point overlaps, so the gap does not determine the traction.
    """
    if np.any(gap[:, 0] < 0.0):
        raise JointsError(
            f"A rigid joint has an initial overlap of {-gap[:, 0].min():.3g} m. Start without "
            "overlap or from a static stage, and use the condensed solver."
        )
    return law.condensed_backward_euler(gap, NO_COMPLIANCE, state)


def empty_response(count: int, variables: int) -> Response:
    """Return a zero response of ``count`` points with internal variables."""
    return Response(
        traction=np.zeros((count, 3)),
        tangent=np.zeros((count, 3, 3)),
        state=replace(
            JointState.at_rest(np.zeros((count, 3)), variables=variables),
            slips=np.zeros((count, 5)),
        ),
        dissipation=np.zeros(count),
        status=np.zeros(count, dtype=np.int8),
    )


# Bonds with at least this fraction of the largest overload are released together.
RELEASED_TOGETHER = 0.9


class Bonds:
    """Bonds in a step: locked until the converged solution overloads them, then released.

    The most overloaded bonds are released first, since their failure may unload other bonds, as in
    short steps. The result does not depend on the iterates of the solver.
    """

    def __init__(self, parts: Sequence[LawPoints], comm: Any, state: JointState) -> None:
        self._parts, self._comm, self._state = parts, comm, state
        self._released: Flags = np.zeros(len(state.gap), dtype=bool)

    def start(self) -> JointState:
        """Return the state at the start of the step, with bonds locked or released."""
        internal = self._state.internal.copy()
        for part in self._parts:
            if part.brittle:
                points = part.points
                internal[points] = with_bonds(internal[points], self._released[points])
        return replace(self._state, internal=internal)

    def release(self, state: JointState) -> bool:
        """Release overloaded bonds; return True if a bond is overloaded (collective)."""
        excess = np.zeros(len(self._released))
        for part in self._parts:
            if part.brittle:
                excess[part.points] = np.maximum(HELD - state.internal[part.points, 0], 0.0)
        largest = max(self._comm.allgather(float(excess.max(initial=0.0))))
        self._released |= (excess > 0.0) & (excess >= RELEASED_TOGETHER * largest)
        return largest > 0.0


def broken_points(parts: Sequence[LawPoints], before: JointState, after: JointState) -> Flags:
    """Return True for local points whose bond broke between two states, shape (n,)."""
    broken = np.zeros(len(before.gap), dtype=bool)
    for part in parts:
        if part.brittle:
            bond_before, bond = (state.internal[part.points, 0] for state in (before, after))
            broken[part.points] = (bond_before < BROKEN) & (bond == BROKEN)
    return broken
