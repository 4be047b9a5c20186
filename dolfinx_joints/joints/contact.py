# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with their laws: tractions, tangents and stored energy of given displacements."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.errors import JointsError, MeshError
from dolfinx_joints.common.mpi import raised_together, summed
from dolfinx_joints.common.parameters import check_each, check_kind_of, check_number
from dolfinx_joints.joints.condensed_step import ContactStep
from dolfinx_joints.joints.form_operator import FormOperator
from dolfinx_joints.joints.law_points import Bonds, LawPoints, broken_points, empty_response
from dolfinx_joints.joints.operator import GapOperator, JointOperator
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    AnyLaw,
    Floats,
    Inactive,
    JointState,
    Losses,
    Response,
    Rule,
    Status,
    StatusCounts,
    check_law,
)
from dolfinx_joints.mesh.joint_pairs import no_such_joint

InitialGap = float | Callable[[Floats], Floats]


class Contact:
    """Joints of a model: a gap operator, and a law for the points of each joint.

    Args:
        operator: The gap operator.
        laws: One law for all joints, or one per joint name.
        initial_gaps: Initial normal gaps by joint name, [m]: a number, or a function that maps
            point coordinates (n, 3) to gaps (n,). These gaps are added to gaps of the mesh.

    Attributes:
        laws: Law of each joint by name.
        initial_gap: Gap before any displacement, mesh gap plus given gap, shape (n, 3), [m].
        acting: True for local points that are active (can have tractions), shape (n,).
        tied: True for local points that can neither open nor slide, shape (n,).
        overlaps: Smallest given gap [m] by joint name, for joints with negative given gaps.

    Raises:
        MeshError: A name is not the name of a joint, or a joint has no law.
        JointsError: A joint with adhesion has a positive initial gap.
    """

    def __init__(
        self,
        operator: GapOperator,
        laws: AnyLaw | Mapping[str, AnyLaw],
        initial_gaps: Mapping[str, InitialGap] | None = None,
    ) -> None:
        self.operator = operator
        gaps = initial_gaps or {}
        check_kind_of("initial_gaps", gaps, isinstance(gaps, Mapping), "a gap per joint name")
        by_name = laws if isinstance(laws, Mapping) else dict.fromkeys(operator.names, laws)
        for name in (*by_name, *gaps):
            if name not in operator.names:
                raise MeshError(no_such_joint(name, operator.names))
        for law in by_name.values():
            check_law("A joint law", law)
        missing = [name for name in operator.names if name not in by_name]
        if missing:
            raise MeshError(f"The joint {missing[0]!r} has no law.")
        self._laws: list[LawPoints] = []
        self.set_laws(by_name)
        self._variables = max((part.variables for part in self._laws), default=0)
        self.acting: Flags = np.ones(len(operator.joint), dtype=bool)
        self.tied = operator.tied
        self.initial_gap: Floats = operator.initial_gap.copy()
        points = np.zeros_like(self.initial_gap) if operator.points is None else operator.points
        self.overlaps: dict[str, float] = {}
        for name, gap in gaps.items():
            in_joint = operator.joint == operator.names.index(name)
            with raised_together(operator.comm):
                normal_gap = _check_gap(name, gap, points[in_joint])
            self.initial_gap[in_joint, 0] += normal_gap
            smallest = operator.comm.allreduce(float(normal_gap.min(initial=0.0)), min)
            self.overlaps |= {name: smallest} if smallest < 0.0 else {}
        for name, law in self.laws.items():
            if getattr(law, "adhesion", 0.0) > 0.0:
                of_joint = operator.joint == operator.names.index(name)
                widest = float(self.initial_gap[of_joint, 0].max(initial=0.0))
                if (widest := operator.comm.allreduce(widest, max)) > 0.0:
                    raise JointsError(
                        f"Joint {name!r}: the initial gap is {widest:.3g} m; it must not be "
                        "positive, as the adhesion would act across the open joint."
                    )

    @cached_property
    def by_forms(self) -> Contact:
        """Copy of the contact that uses interior-facet integrals instead of B (collective).

        Raises:
            JointsError: The operator was built from a matrix, without a mesh.
        """
        if not isinstance(self.operator, JointOperator):
            raise JointsError("Interior-facet integrals need joints of a mesh, not of a matrix.")
        return self.with_operator(FormOperator(self.operator))

    def set_laws(self, laws: Mapping[str, AnyLaw]) -> None:
        """Set the law of each joint, without a change of states that other objects store."""
        operator = self.operator
        self.laws = {name: laws[name] for name in operator.names}
        self._laws.clear()
        for law in {id(law): law for law in laws.values()}.values():
            members = [i for i, name in enumerate(operator.names) if laws[name] is law]
            self._laws.append(LawPoints(law, np.flatnonzero(np.isin(operator.joint, members))))

    def with_own_laws(self) -> Contact:
        """Return a copy whose laws can be set without a change of this object."""
        other = self.with_operator(self.operator)
        other._laws = [*self._laws]
        return other

    def with_operator(self, operator: GapOperator) -> Contact:
        """Return a copy with these laws and points on another operator."""
        other = copy(self)
        other.__dict__.pop("by_forms", None)
        other.operator = operator
        return other

    def without(self, idle: Flags) -> Contact | None:
        """Return a copy with inactive points, or None if no point is active (collective).

        Laws without an active point are dropped, so that they do not affect the choice of solver.

        Args:
            idle: True for local points without traction, shape (n,).
        """
        acting = [part.subset(~idle) for part in self._laws]
        numbers = summed(self.operator.comm, np.array([len(p.points) for p in acting]))
        acting = [part for part, number in zip(acting, numbers, strict=True) if number]
        if not acting:
            return None
        other = copy(self)
        other.__dict__.pop("by_forms", None)
        other._laws = [*acting, LawPoints(Inactive(), np.flatnonzero(idle))]
        other.acting = ~idle
        return other

    def gap(self, u: Any) -> Floats:
        """Return the gap including the initial gap, shape (n, 3), [m] (collective)."""
        return self.operator.jump(u) + self.initial_gap

    def at_rest(self, u: Any) -> JointState:
        """Return the state without shear traction at the displacement ``u`` (collective)."""
        return self.resting(self.gap(u))

    def resting(self, gap: Floats) -> JointState:
        """Return the state without shear traction and history at a gap (n, 3), [m] (collective)."""
        state = JointState.at_rest(gap, variables=self._variables)
        with raised_together(self.operator.comm):
            for part in self._laws:
                first = part.initial_variables(state.gap[part.points])
                state.internal[part.points, : part.variables] = first
        return state

    def trial(self, u: Any, state: JointState) -> Response:
        """Return the backward Euler response at a displacement, from ``state`` (collective)."""
        return self.at_gap(self.gap(u), state)

    def at_gap(self, gap: Floats, state: JointState) -> Response:
        """Return the backward Euler response at a gap (n, 3) [m], from ``state`` (collective)."""
        return self._evaluate(BACKWARD_EULER, gap, None, state)

    def respond(self, change: Any, state: JointState, rule: Rule) -> Response:
        """Return the response to a change of the displacement, relative to ``state`` (collective).

        Args:
            change: Displacement minus the displacement at ``state``, [m].
            state: State at the start of the step.
            rule: Rule by which the laws are evaluated.
        """
        return self._evaluate(rule, state.gap + self.operator.jump(change), None, state)

    def respond_condensed(
        self, trial_gap: Floats, compliance: Floats, state: JointState, rule: Rule
    ) -> Response:
        """Return the response of the local points on a diagonal compliance (collective).

        Args:
            trial_gap: Gap without traction, shape (n, 3), [m].
            compliance: Normal and tangential structural compliance, shape (n, 2), [m/Pa].
            state: State at the start of the step.
            rule: Rule by which the laws are evaluated.
        """
        return self._evaluate(rule, trial_gap, compliance, state)

    def condensed_step(self, compliance: Floats, state: JointState, rule: Rule) -> ContactStep:
        """Return the local points in a step, for evaluation at many trial gaps.

        The arguments are those of `respond_condensed`.
        """
        return ContactStep(self._laws, self.operator.comm, compliance, state, rule)

    def _evaluate(
        self, rule: Rule, gap: Floats, compliance: Floats | None, state: JointState
    ) -> Response:
        """Return the response of the local points (collective)."""
        with raised_together(self.operator.comm):
            if len(self._laws) == 1:
                return self._laws[0].evaluate(rule, gap, compliance, state)
            answer = empty_response(len(gap), self._variables)
            for part in self._laws:
                points = part.points
                c = None if compliance is None else compliance[points]
                part.write_to(part.evaluate(rule, gap[points], c, part.state_of(state)), answer)
            return answer

    @property
    def parts(self) -> Sequence[LawPoints]:
        """Points of each law."""
        return self._laws

    def set_parts(self, parts: Sequence[LawPoints]) -> None:
        """Set laws of groups of points, instead of one law for each joint."""
        self._laws = [*parts]

    @property
    def brittle(self) -> bool:
        """True, on all ranks, if a law has bonds that can break."""
        return any(part.brittle for part in self._laws)

    def bonds(self, state: JointState) -> Bonds:
        """Return the bonds that may break in a step from a state."""
        return Bonds(self._laws, self.operator.comm, state)

    def without_losses(self, rule: Rule) -> tuple[str, ...]:
        """Return the class names of laws whose numerical loss is obtained by difference."""
        return tuple(sorted({part.kind for part in self._laws if not part.states_losses(rule)}))

    def broken(self, before: JointState, after: JointState) -> Flags:
        """Return True for local points whose bond broke between two states, shape (n,)."""
        return broken_points(self._laws, before, after)

    @property
    def stops(self) -> bool:
        """True, on all ranks, if a law has points without rebound."""
        return any(part.stops for part in self._laws)

    @property
    def without_balance(self) -> tuple[str, ...]:
        """Class names of the laws without a method for whole steps."""
        return tuple(sorted({part.kind for part in self._laws if not part.has_whole_steps}))

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy of each joint, shape (number of joints,), [J] (collective)."""
        if len(self._laws) == 1:
            return self.integrals(self._laws[0].law.stored_energy(state))
        density = np.empty(len(state.gap))
        for part in self._laws:
            density[part.points] = part.law.stored_energy(part.state_of(state))
        return self.integrals(density)

    def fracture_energy(self, state: JointState) -> float:
        """Return the energy of broken cohesive bonds since the state at rest [J] (collective)."""
        density = np.zeros(len(state.gap))
        for part in self._laws:
            if part.fracture is not None:
                density[part.points] = state.internal[part.points, part.fracture]
        return self.integral(density)

    @property
    def softens(self) -> bool:
        """True, on all ranks, if a law has a fracture energy."""
        return any(part.fracture is not None for part in self._laws)

    def losses(self, rule: Rule, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses of a step at all local points, each of shape (n,), [J/m^2].

        The arguments are those of `LawWithLosses.losses`.
        """
        friction, numerical, impact = np.empty((3, len(traction)))
        if len(self._laws) == 1:
            lost = self._laws[0].losses(rule, before, answer, traction)
            friction[:], numerical[:], impact[:] = lost
            return Losses(friction, numerical, impact)
        for part in self._laws:
            points = part.points
            lost = part.losses(
                rule, part.state_of(before), part.response_of(answer), traction[points]
            )
            friction[points], numerical[points], impact[points] = lost
        return Losses(friction, numerical, impact)

    def integrals(self, density: Floats) -> Floats:
        """Return the integral over each joint of values per point (collective).

        Values (n,) or (k, n) give integrals of shape (number of joints,) or (k, number of joints).
        """
        operator = self.operator
        values = np.atleast_2d(operator.areas * density)
        sums = np.empty((len(values), len(operator.names)))
        for row, of_joints in zip(values, sums, strict=True):
            of_joints[:] = np.bincount(operator.joint, row, len(operator.names))
        total = summed(operator.comm, sums)
        return total if density.ndim > 1 else total[0]

    def integral(self, density: Floats) -> float:
        """Return the integral over all joints of a value per point (collective)."""
        return float(self.operator.comm.allreduce(float(self.operator.areas @ density)))

    def closed_stiffness(self) -> Floats:
        """Return k_n and k_s of each closed, sticking point, shape (n, 2), [Pa/m]."""
        stiffness = np.zeros((len(self.operator.areas), 2))
        for part in self._laws:
            stiffness[part.points] = part.law.closed_stiffness()
        return stiffness

    def steepest_softening(self) -> Floats:
        """Return the largest softening of each point in tension and shear, shape (n, 2), [Pa/m]."""
        softening = np.zeros((len(self.operator.areas), 2))
        for part in self._laws:
            softening[part.points] = part.softening
        return softening

    @property
    def rigid(self) -> bool:
        """True, on all ranks, if a law has infinite stiffness."""
        return any(math.isinf(k) for part in self._laws for k in part.law.closed_stiffness())

    def firm_stiffness(self) -> Floats:
        """Return the closed stiffness, with k_n in place of a zero k_s, shape (n, 2), [Pa/m]."""
        stiffness = self.closed_stiffness()
        stiffness[:, 1] = np.where(stiffness[:, 1] > 0.0, stiffness[:, 1], stiffness[:, 0])
        return stiffness

    def closed_tangent(self, *, firm: bool = False) -> Floats:
        """Return the tangent of each closed, sticking point, shape (n, 3, 3), [Pa/m].

        ``firm`` selects `firm_stiffness` instead of `closed_stiffness`.

        Raises:
            JointsError: A law is rigid.
        """
        if self.rigid:
            raise JointsError(
                "A rigid joint has no finite stiffness, which modes and the solvers 'monolithic' "
                "and 'forms' need; use the solver 'condensed' or a joint of finite stiffness."
            )
        stiffness = self.firm_stiffness() if firm else self.closed_stiffness()
        diagonal: Floats = np.repeat(stiffness, (1, 2), axis=1)
        return diagonal[:, :, None] * np.eye(3)

    def shown_status(self, status: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return the status of the local points, with TIED for tied points, shape (n,)."""
        return np.where(self.tied, np.int8(Status.TIED), status)

    def counts(self, status: NDArray[np.int8]) -> StatusCounts:
        """Return the number of points of each status on all ranks (collective)."""
        numbers = np.bincount(self.shown_status(status), minlength=len(Status))
        totals = summed(self.operator.comm, numbers)
        return StatusCounts(**{status.name.lower(): int(totals[status]) for status in Status})

    def worst_joint(self, change: NDArray[Any]) -> str | None:
        """Return the name of the joint with the largest sum over active points (collective)."""
        acting = change * self.acting
        sums = np.bincount(self.operator.joint, acting, minlength=len(self.operator.names))
        total = summed(self.operator.comm, sums)
        return self.operator.names[int(np.argmax(total))] if total.any() else None

    def not_finite(self, response: Response) -> tuple[str, str] | None:
        """Return joint and law class of NaN responses at a finite gap, or None (collective)."""
        answers = (response.traction, response.tangent.reshape(-1, 9))
        wrong = ~np.all([np.isfinite(values).all(axis=1) for values in answers], axis=0)
        wrong &= np.isfinite(response.state.gap).all(axis=1)
        joint = self.worst_joint(wrong.astype(np.float64))
        return None if joint is None else (joint, type(self.laws[joint]).__name__)


def _check_gap(name: str, gap: InitialGap, coordinates: Floats) -> Floats:
    label = f"The initial gap of {name!r}"
    if not callable(gap):
        check_number(label, gap, lambda _: True, "finite", unit="m")
    return check_each(label, gap(coordinates) if callable(gap) else gap, len(coordinates))
