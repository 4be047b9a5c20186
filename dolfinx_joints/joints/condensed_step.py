# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Evaluation of the joint laws at all local points in one step of the condensed solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.joints.law_points import LawPoints, empty_response
from dolfinx_joints.laws.law import Floats, JointState, Response, Rule
from dolfinx_joints.laws.points.return_mapping import Answer, solve_points


class PointResponses(NamedTuple):
    """Responses of all local points at one trial gap.

    Attributes:
        traction: (n, s1, s2) components, shape (n, 3), [Pa].
        tangent: d traction / d trial_gap, shape (n, 3, 3), [Pa/m].
        by_law: Response of each law.
    """

    traction: Floats
    tangent: Floats
    by_law: Sequence[Any]


class ContactStep:
    """Local points in one step, for evaluation at many trial gaps.

    Args:
        laws: Points of each law.
        comm: Communicator of the ranks.
        compliance: Normal and tangential compliance of the structure, shape (n, 2), [m/Pa].
        state: State at the start of the step.
        rule: Integration rule of the laws.
    """

    def __init__(
        self,
        laws: Sequence[LawPoints],
        comm: Any,
        compliance: Floats,
        state: JointState,
        rule: Rule,
    ) -> None:
        """Prepare the data shared by all evaluations (collective)."""
        self._laws, self._comm, self._state = laws, comm, state
        # Compiled loops raise no errors, so the ranks exchange none.
        self._may_fail = any(part.compiled_over(rule) is None for part in laws)
        with raised_together(comm):
            if len(laws) == 1:
                self._steps = [PointStep(laws[0], rule, compliance, state)]
            else:
                self._steps = [
                    PointStep(part, rule, compliance[part.points], part.state_of(state))
                    for part in laws
                ]

    def point_responses(self, trial_gap: Floats) -> PointResponses:
        """Return the responses at a trial gap of shape (n, 3), [m] (collective)."""
        if not self._may_fail:
            return self._point_responses(trial_gap)
        with raised_together(self._comm):
            return self._point_responses(trial_gap)

    def _point_responses(self, trial_gap: Floats) -> PointResponses:
        if len(self._steps) == 1:
            (one,) = by_law = [self._steps[0].answer(trial_gap)]
            return PointResponses(one.traction, one.tangent, by_law)
        traction, tangent = np.zeros((len(trial_gap), 3)), np.zeros((len(trial_gap), 3, 3))
        by_law = []
        for part, step in zip(self._laws, self._steps, strict=True):
            by_law.append(answer := step.answer(trial_gap[part.points]))
            traction[part.points], tangent[part.points] = answer.traction, answer.tangent
        return PointResponses(traction, tangent, by_law)

    def response(self, point_responses: PointResponses) -> Response:
        """Return the responses of all points as one `Response`."""
        parts = [
            step.response(answer)
            for step, answer in zip(self._steps, point_responses.by_law, strict=True)
        ]
        if len(parts) == 1:
            return parts[0]
        response = empty_response(len(point_responses.traction), self._state.internal.shape[1])
        for part, own_response in zip(self._laws, parts, strict=True):
            part.write_to(own_response, response)
        return response


class PointStep:
    """Points of one law in one step of the condensed solver, for many trial gaps.

    ``compliance`` is the normal and tangential compliance of the structure, shape (n, 2), [m/Pa].
    """

    def __init__(self, part: LawPoints, rule: Rule, compliance: Floats, state: JointState) -> None:
        self._part, self._rule, self._compliance, self._state = part, rule, compliance, state
        self._law = law = part.compiled_over(rule)
        if law is not None:
            if part.variables < state.internal.shape[1]:
                self._state = replace(state, internal=state.internal[:, : part.variables])
            self._rule = law.rule_of_loop(rule)
            self._loop = law.loop(self._rule)
            self._start = law.loop_start(self._rule, self._state)

    def answer(self, trial_gap: Floats) -> Answer | Response:
        """Return the response of the law at a trial gap (n, 3), [m]."""
        if self._law is None:
            return self._part.evaluate(self._rule, trial_gap, self._compliance, self._state)
        return solve_points(self._loop, trial_gap, self._compliance, self._start)

    def response(self, answer: Answer | Response) -> Response:
        """Return the result of `answer` as a `Response`."""
        if self._law is None or isinstance(answer, Response):
            assert isinstance(answer, Response)
            return answer
        return self._law.loop_response(self._rule, answer, self._state)
