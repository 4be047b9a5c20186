# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The points of one law: which of its methods is asked under a rule, and what it may return."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dolfinx_joints.common.arrays import Flags, Ints
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.common.parameters import numbers_of, shown
from dolfinx_joints.laws.law import (
    DISCRETE_GRADIENT,
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
)
from dolfinx_joints.laws.losses import losses_of
from dolfinx_joints.laws.points.compiled_law import CompiledLaw
from dolfinx_joints.laws.points.on_compliance import on_compliance

if TYPE_CHECKING:
    from dolfinx_joints.laws.rigid import RigidJoint

# Of the arrays of a response, after the number of points.
_SHAPES: dict[str, tuple[int, ...]] = {
    "traction": (3,),
    "tangent": (3, 3),
    "dissipation": (),
    "status": (),
    "gap": (3,),
    "elastic_slip": (2,),
}


class LawPoints:
    """The points of one law.

    Attributes:
        law: The law.
        points: Its local points.
        kind: Name of its class.
        variables: Number of its internal variables.
        balances: Whether it has an answer over a whole step that balances energy.
        accounts: Whether it states its losses in steps that it answered at their end.
        brittle: Whether it has bonds that break for good.
        stops: Whether its points do not rebound.

    Raises:
        ValueError: Its internal variables are not what `LawWithHistory` says, or its stiffness is
            not two numbers.
    """

    def __init__(self, law: AnyLaw, points: Ints) -> None:
        from dolfinx_joints.laws.rigid import RigidJoint
        from dolfinx_joints.laws.viscous import DashpotStep

        self.law, self.points, self.kind = law, points, type(law).__name__
        names = getattr(law, "internal_variables", ())
        good = isinstance(names, tuple | list) and all(isinstance(n, str) for n in names)
        if not good or (names and not isinstance(law, LawWithHistory)):
            raise ValueError(
                f"{self.kind}: internal_variables is {shown(names)}; it must be a tuple of names, "
                "beside a method initial_variables(gap)."
            )
        stiffness: Any = law.closed_stiffness()
        if np.shape(stiffness) != (2,) or not all(k >= 0.0 for k in stiffness):
            raise ValueError(
                f"{self.kind}.closed_stiffness returned {shown(stiffness)}; it must give normal "
                "and shear stiffness, two numbers from 0 Pa/m on."
            )
        self.variables = len(names)
        self._law_of_steps: Callable[[float], AnyLaw] = lambda dt: law
        if isinstance(law, RateDependentLaw):
            self._law_of_steps = law.for_step
        step = self._law_of_steps(math.inf)
        alone = step.law if isinstance(step, DashpotStep) else step
        self.balances = isinstance(alone, EnergyConsistentLaw | CondensedEnergyConsistentLaw)
        self.accounts = isinstance(alone, LawWithLosses)
        self.brittle = has_bonds(alone)
        self._rigid: RigidJoint | None = law if isinstance(law, RigidJoint) else None
        self.stops = self._rigid is not None and self._rigid.restitution == 0

    def among(self, chosen: Flags) -> LawPoints:
        """Those of its points that are chosen of all local points."""
        part = copy(self)
        part.points = self.points[chosen[self.points]]
        return part

    def state_of(self, state: JointState) -> JointState:
        """The state of its points, of that of all local points."""
        part = JointState(gap=state.gap[self.points], elastic_slip=state.elastic_slip[self.points])
        if self.variables:
            part = replace(part, internal=state.internal[self.points, : self.variables])
        if len(state.slips):
            part = replace(part, slips=state.slips[self.points])
        if len(state.approach):
            part = replace(part, approach=state.approach[self.points])
        return part

    def response_of(self, answer: Response) -> Response:
        """The answer of its points, of that of all local points."""
        here = self.points
        return Response(
            traction=answer.traction[here],
            tangent=answer.tangent[here],
            state=self.state_of(answer.state),
            dissipation=answer.dissipation[here],
            status=answer.status[here],
        )

    def initial_variables(self, gap: Floats) -> Floats:
        """Internal variables at rest at a gap, shape (n, variables)."""
        if not isinstance(self.law, LawWithHistory):
            return np.zeros((len(gap), 0))
        first, wanted = numbers_of(self.law.initial_variables(gap)), (len(gap), self.variables)
        if first is None or first.shape != wanted:
            raise ValueError(
                f"{self.kind}.initial_variables must give numbers of shape {wanted}, one column "
                "for each internal variable."
            )
        return first

    def law_over(self, rule: Rule) -> AnyLaw:
        """Return the law of a step of the length of a rule."""
        return self._law_of_steps(rule.dt)

    def compiled_over(self, rule: Rule) -> CompiledLaw | None:
        """Return `law_over` if its answers are those of its compiled loops, else None."""
        law = self.law_over(rule)
        return law if isinstance(law, CompiledLaw) and law.has_loops_alone() else None

    def ask(
        self, rule: Rule, gap: Floats, compliance: Floats | None, state: JointState
    ) -> Response:
        """Answer at a gap, or at a trial gap on a compliance; all are those of the law's points.

        Raises:
            ValueError: The law returned something else.
        """
        law = self.law_over(rule)

        def answer(at: Floats) -> Response:
            return self._checked(_methods(law)[rule.name](at, state), len(gap))

        if compliance is None:
            return answer(gap)
        condensed = _condensed_methods(law).get(rule.name)
        if condensed is not None:
            return self._checked(condensed(gap, compliance, state), len(gap))
        return on_compliance(answer, state.gap, gap, compliance, law.closed_stiffness())

    def put(self, given: Response, answer: Response) -> None:
        """Write the answer of its points into that of all local points."""
        here = self.points
        for name in ("traction", "tangent", "dissipation", "status"):
            getattr(answer, name)[here] = getattr(given, name)
        answer.state.gap[here] = given.state.gap
        answer.state.elastic_slip[here] = given.state.elastic_slip
        if len(given.state.slips):
            answer.state.slips[here] = given.state.slips
        if self.variables:
            answer.state.internal[here, : self.variables] = given.state.internal

    def states_losses(self, rule: Rule) -> bool:
        """Whether it states its losses under a rule, so that its energies can be checked."""
        return self.accounts or (rule.name == DISCRETE_GRADIENT.name and self.balances)

    def losses(self, rule: Rule, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of a step of its points; arguments are those of `LawWithLosses.losses`."""
        if rule.name == DISCRETE_GRADIENT.name and self.balances:
            lost = Losses(answer.dissipation, np.zeros(len(traction)))
            if self._rigid is not None and self.stops:
                lost = lost._replace(impact=self._rigid.impact(before, answer))
            return lost
        return losses_of(self.law_over(rule), before, answer, traction)

    def _checked(self, response: Response, count: int) -> Response:
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
    """Methods that follow from a gap; at the end of steps where there is none for whole ones."""
    end = law.backward_euler if isinstance(law, Law) else partial(_without_pressure, law)
    whole = law.discrete_gradient if isinstance(law, EnergyConsistentLaw) else end
    return {"backward_euler": end, "discrete_gradient": whole}


def _condensed_methods(law: AnyLaw) -> dict[str, Callable[..., Response]]:
    """Return the law's own methods on the compliance of the structure; most laws have none."""
    if not isinstance(law, CondensedLaw) or changes_gap_methods(type(law)):
        return {}
    methods = {"backward_euler": law.condensed_backward_euler}
    if isinstance(law, CondensedEnergyConsistentLaw):
        methods["discrete_gradient"] = law.condensed_discrete_gradient
    elif not isinstance(law, EnergyConsistentLaw):
        methods["discrete_gradient"] = law.condensed_backward_euler
    return methods


def _without_pressure(law: Any, gap: Floats, state: JointState) -> Response:
    """Answer of a law that needs the compliance of the structure, at points that only touch.

    Raises:
        JointsError: A point overlaps: its traction does not follow from its gap.
    """
    if np.any(gap[:, 0] < 0.0):
        raise JointsError(
            f"A rigid joint overlaps by {-gap[:, 0].min():.3g} m: it must start without overlap, "
            "or from a static stage, and needs the condensed solver."
        )
    return law.condensed_backward_euler(gap, NO_COMPLIANCE, state)


def empty_response(count: int, variables: int) -> Response:
    """Room for the answer of points with internal variables."""
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
