# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base classes of laws with a compiled loop over points, which the condensed solver calls."""

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
    """Base class of laws with compiled functions of a point; see `CondensedLaw`.

    ``point(i, start, answer)`` computes the response of point ``i`` at ``answer.gap[i]``. It writes
    all arrays of `Answer`, including the history. ``start`` is the result of `loop_start`, with k_n
    and k_s as first parameters. Decorate ``point`` with ``inline`` of `common.kernels`, or with
    numba's ``register_jitable`` if it allocates arrays. `on_compliance` solves the point on the
    structural compliance by Newton's method. Example: `mohr_coulomb.bonded_point`.

    A law with a closed form on the compliance also has a ``loop(compliance, start, answer)``. It
    computes the response of all points; on entry ``answer.gap`` is the trial gap.
    `closed_form_loop` builds the loop from a function of one point, for example in `friction`.

    Functions for `BACKWARD_EULER` are also used over whole steps if the law has no other functions.
    Laws of finite stiffness also inherit `ElasticContact`, for statics and the monolithic solver.

    Attributes:
        points: Functions of a point by the name of the rule.
        loops: Loops by the name of the rule; missing loops are built from ``points``.
    """

    points: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    loops: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    @abstractmethod
    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return state and parameters at the start of a step, in the form used by the loop."""

    @abstractmethod
    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the output of the loop as a `Response`.

        Args:
            rule: Rule of the loop.
            answer: Output of the loop.
            state: State at the start of the step.
        """

    def rule_of_loop(self, rule: Rule) -> Rule:
        """Return the rule whose loop is used: ``rule``, or `BACKWARD_EULER` if it has no loop."""
        return rule if rule.name in {**self.points, **self.loops} else BACKWARD_EULER

    def loop(self, rule: Rule) -> Any:
        """Return the compiled loop of a rule."""
        loop = self.loops.get(rule.name)
        return loop_of(self.points[rule.name]) if loop is None else loop

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return the response at the end of a step on a compliance; see `CondensedLaw`."""
        return self._run_loop(BACKWARD_EULER, trial_gap, compliance, state)

    def _run_loop(
        self, rule: Rule, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        rule = self.rule_of_loop(rule)
        start = self.loop_start(rule, state)
        answer = solve_points(self.loop(rule), trial_gap, compliance, start)
        return self.loop_response(rule, answer, state)

    @classmethod
    def uses_only_loops(cls) -> bool:
        """Return True if the loops compute all responses: no subclass overrides the methods."""
        methods = ("condensed_backward_euler", "condensed_discrete_gradient")
        used = [getattr(cls, name) for name in methods if hasattr(cls, name)]
        return all(m.__module__ == __name__ for m in used) and not changes_gap_methods(cls)


class CompiledEnergyConsistentLaw(CompiledLaw):
    """Base class of laws that also have a compiled loop over whole steps."""

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """Return the response over a whole step; see `CondensedEnergyConsistentLaw`."""
        return self._run_loop(DISCRETE_GRADIENT, trial_gap, compliance, state)


class ElasticContact:
    """Methods of a `CompiledLaw` of finite stiffness at a gap, by default without tension."""

    normal_stiffness: float
    shear_stiffness: float

    def closed_stiffness(self) -> tuple[float, float]:
        """Return k_n and k_s, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Return k_n min(gap_n, 0)^2 / 2 + k_s |e|^2 / 2, shape (n,), [J/m^2]."""
        closed = np.minimum(state.gap[:, 0], 0.0)
        slip = np.einsum("ij,ij->i", state.elastic_slip, state.elastic_slip)
        return 0.5 * self.normal_stiffness * closed**2 + 0.5 * self.shear_stiffness * slip

    def backward_euler(self: Any, gap: Floats, state: JointState) -> Response:
        """Return the response at the end of a step at a gap of shape (n, 3), [m]."""
        response: Response = self.condensed_backward_euler(gap, NO_COMPLIANCE, state)
        return response


class EnergyConsistentContact(ElasticContact, CompiledEnergyConsistentLaw):
    """Base class of laws of finite stiffness with a compiled loop over whole steps."""

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Return the response over a whole step at a gap of shape (n, 3), [m]."""
        return self.condensed_discrete_gradient(gap, NO_COMPLIANCE, state)
