# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of joint laws by gap, state and parameters, from the laws' own functions of a point.

A step maps the gap g1 at its end, the state z0 at its start (gap, elastic slip, last slips) and the
parameters p to the traction t and the history y1 (elastic slip, last slips). The functions of one
point are evaluated with dual numbers, so the laws need no separate formulas for derivatives. Points
of several steps are evaluated together, in groups that take the same branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import fields
from typing import Any

import numpy as np

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.gradient.dual_numbers import Dual, evaluate_by_branch
from dolfinx_joints.laws.adhesive import AdhesiveJoint
from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.law import JointState, Rule
from dolfinx_joints.laws.points.return_mapping import empty_answer

# Laws whose functions of a point accept dual numbers.
SUPPORTED = (FrictionNoTension, AdhesiveJoint)

# Columns of a recorded state, (gap, elastic slip, slips): widths and their ends.
GAP, SLIP, SLIPS = slice(0, 3), slice(3, 5), slice(5, 10)

# Not a parameter: the angle follows from the coefficient.
DERIVED = "friction_angle_deg"


def parameters_of(law: Any) -> tuple[str, ...]:
    """Return the names of the parameters of a law, without a shear stiffness of zero."""
    without = {DERIVED} if law.shear_stiffness else {DERIVED, "shear_stiffness"}
    return tuple(field.name for field in fields(law) if field.name not in without)


def slopes_of(law: Any, rule: Rule, before: Floats, gap: Floats) -> tuple[Floats, Floats]:
    """Return the values of t and y1, and their derivatives by g1, z0 and p, at ``n`` points.

    Args:
        law: One of the `SUPPORTED` laws.
        rule: Rule of the steps.
        before: States z0 at the start, shape (steps, n, columns) with 5 or 10 columns.
        gap: Gaps g1 at the end, shape (steps, n, 3), [m].

    Returns:
        The values, shape (columns, steps, n), and the derivatives, shape
        (steps, columns, 3 + columns + parameters, n).
    """
    steps, count, columns = before.shape
    names, total = parameters_of(law), steps * count
    numbers: Any = np.hstack([gap.reshape(-1, 3), before.reshape(-1, columns)]).T
    inputs = len(numbers) + len(names)
    unit = np.eye(inputs)[:, :, None]
    answer = np.zeros((columns, total))
    slopes: Floats = np.zeros((columns, inputs, total))

    def evaluate(points: Ints) -> None:
        """Write the answer of points on one branch, and their derivatives."""
        given = [Dual(row[points], unit[i]) for i, row in enumerate(numbers)]
        differentiated = copy(law)
        for i, name in enumerate(names, len(numbers)):
            parameter = Dual(np.full(len(points), float(getattr(law, name))), unit[i])
            object.__setattr__(differentiated, name, parameter)  # without checks of a number
        outputs = _answer(differentiated, rule, given)
        for row, output in enumerate(outputs):
            if isinstance(output, Dual):
                answer[row, points], slopes[row, :, points] = output.value, output.slope.T
            else:
                answer[row, points] = output

    evaluate_by_branch(total, evaluate)
    by_step = slopes.reshape(columns, inputs, steps, count).transpose(2, 0, 1, 3)
    return answer.reshape(columns, steps, count), np.ascontiguousarray(by_step)


def _answer(law: Any, rule: Rule, numbers: Sequence[Dual]) -> list[Any]:
    """Return t and y1 of one point, from g1 and z0."""
    row = np.array(numbers, dtype=object)[None]
    gap, before = row[:, :3], row[:, 3:]
    history = {} if before.shape[1] == SLIP.stop else {"slips": before[:, SLIPS]}
    state = JointState(gap=before[:, GAP], elastic_slip=before[:, SLIP], **history)
    start = law.loop_start(rule, state)
    answer = empty_answer(gap, start.history)
    law.points[rule.name](0, start, answer)
    response = law.loop_response(rule, answer, state)
    after = response.state
    slips = after.slips[0] if history else ()
    return [*response.traction[0], *after.elastic_slip[0], *slips]
