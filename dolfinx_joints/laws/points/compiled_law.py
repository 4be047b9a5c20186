# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base classes of laws with a compiled loop over the points, which the condensed solver calls."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    DISCRETE_GRADIENT,
    NO_COMPLIANCE,
    Floats,
    JointState,
    Response,
    Rule,
    changes_gap_methods,
)
from dolfinx_joints.laws.points.on_compliance import loop_of
from dolfinx_joints.laws.points.return_mapping import Answer, Start, solve_points


class CompiledLaw(ABC):
    """Base class of laws whose points are compiled; see `CondensedLaw`.

    ``point(i, start, answer)`` writes the answer of the point ``i`` at the gap ``answer.gap[i]``:
    all arrays of the `Answer`, its history included. It finds what `loop_start` gives, whose first
    two parameters are k_n and k_s. It is decorated by ``inline`` of `common.kernels`, or by numba's
    ``register_jitable`` if it makes arrays. Newton's method of `on_compliance` finds it on the
    compliance of the structure. `bonded_point` in `mohr_coulomb` is one.

    A law that is solved there in closed form has a ``loop(compliance, start, answer)`` as well,
    which writes the answer of all points and begins with the trial gap in ``answer.gap``.
    `closed_form_loop` makes it of the answer of one point, as that of `friction`.

    What is given for `BACKWARD_EULER` alone is used over whole steps as well. A law of finite
    stiffness also inherits `ElasticContact`, for statics and the monolithic solver.

    Attributes:
        points: Points by the name of the rule.
        loops: Loops by the name of the rule; those of the points unless given.
    """

    points: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    loops: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    @abstractmethod
    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return the state and the parameters at the start of a step, as the loop takes them."""

    @abstractmethod
    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the answer of the loop as a `Response`.

        Args:
            rule: Rule of the loop.
            answer: What the loop has written.
            state: State at the start of the step.
        """

    def rule_of_loop(self, rule: Rule) -> Rule:
        """Return the rule whose loop answers under a rule."""
        return rule if rule.name in {**self.points, **self.loops} else BACKWARD_EULER

    def loop(self, rule: Rule) -> Any:
        """Return the compiled loop of a rule."""
        given = self.loops.get(rule.name)
        return loop_of(self.points[rule.name]) if given is None else given

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return the answer at the end of a step on a compliance; see `CondensedLaw`."""
        return self._looped(BACKWARD_EULER, trial_gap, compliance, state)

    def _looped(
        self, rule: Rule, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        rule = self.rule_of_loop(rule)
        start = self.loop_start(rule, state)
        answer = solve_points(self.loop(rule), trial_gap, compliance, start)
        return self.loop_response(rule, answer, state)

    @classmethod
    def has_loops_alone(cls) -> bool:
        """Return True if the answers are those of the loops, and no subclass overrides that."""
        methods = ("condensed_backward_euler", "condensed_discrete_gradient")
        own = [getattr(cls, name) for name in methods if hasattr(cls, name)]
        return all(method.__module__ == __name__ for method in own) and not changes_gap_methods(cls)


class CompiledEnergyConsistentLaw(CompiledLaw):
    """Base class of laws with a compiled loop over whole steps as well."""

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return the answer over a whole step; see `CondensedEnergyConsistentLaw`."""
        return self._looped(DISCRETE_GRADIENT, trial_gap, compliance, state)


class ElasticContact:
    """Methods of a `CompiledLaw` of finite stiffness: at gaps, and by default without tension."""

    normal_stiffness: float
    shear_stiffness: float

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """k_n <-gap_n>^2 / 2 + k_s |e|^2 / 2 of each point, shape (n,), [J/m^2]."""
        closed = np.minimum(state.gap[:, 0], 0.0)
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        return 0.5 * self.normal_stiffness * closed**2 + 0.5 * self.shear_stiffness * slip

    def backward_euler(self: Any, gap: Floats, state: JointState) -> Response:
        """Return the answer at the end of a step to a gap of shape (n, 3), [m]."""
        response: Response = self.condensed_backward_euler(gap, NO_COMPLIANCE, state)
        return response


class EnergyConsistentContact(ElasticContact, CompiledEnergyConsistentLaw):
    """Base class of laws of finite stiffness with a compiled loop over whole steps."""

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Return the answer over a whole step to a gap of shape (n, 3), [m]."""
        return self.condensed_discrete_gradient(gap, NO_COMPLIANCE, state)
