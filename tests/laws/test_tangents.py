# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Consistent tangents of all laws against differences, over random states with the corners.

2500 states of each law, and 10^5 where time does not matter: the compiled laws leave extended
precision to the interpreter.

The differences are taken in extended precision (64 bits of mantissa), with a step that is small
against the distance to the nearest kink; where a state sits exactly on a kink, towards the side
that the law counts it to. What remains of truncation and rounding is below 1e-9 of the tangent.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from tangent_errors import largest_error

from dolfinx_joints import (
    AdhesiveJoint,
    FrictionNoTension,
    KeyedJoint,
    MohrCoulombJoint,
    ViscousJoint,
)
from dolfinx_joints.laws.law import (
    BROKEN,
    JointState,
    Status,
    has_bonds,
    variables_of,
    with_bonds,
)
from dolfinx_joints.laws.points.compiled_law import CompiledLaw
from dolfinx_joints.laws.viscous import DashpotStep

K_N, K_S = 1e12, 2e12  # Pa/m
UM = 1e-6
COUNTS = [2_500, pytest.param(100_000, marks=pytest.mark.slow)]


def number_for(law, count):
    """Return fewer states for laws whose points the interpreter solves one by one."""
    slow = isinstance(law, CompiledLaw) and not law.loops
    return min(count // 5, 5_000) if slow else count


TOLERANCE = 1e-8

pytestmark = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="needs an extended precision type"
)


def friction(**changes):
    return FrictionNoTension(
        **{
            "normal_stiffness": K_N,
            "shear_stiffness": K_S,
            "friction_angle_deg": 30.0,
            **changes,
        }
    )


def bond(**changes):
    return MohrCoulombJoint(
        **{
            "normal_stiffness": K_N,
            "shear_stiffness": K_S,
            "friction_angle_deg": 35.0,
            "cohesion": 0.5e6,
            "tensile_strength": 0.3e6,
            "dilatancy_angle_deg": 10.0,
            **changes,
        }
    )


DT = 1e-3

LAWS = {
    "friction": friction(),
    "no friction": friction(friction_angle_deg=0.0),
    "high friction": friction(friction_angle_deg=89.0),
    "no shear stiffness": friction(shear_stiffness=0.0),
    "stiff": friction(normal_stiffness=1e16, shear_stiffness=1e9),
    "adhesive": AdhesiveJoint(
        normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0, adhesion=2e5
    ),
    "keyed": KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S),
    "bond": bond(),
    "bond without dilatancy": bond(dilatancy_angle_deg=0.0),
    "dilatant": bond(cohesion=0.0, tensile_strength=0.0, dilatancy_angle_deg=35.0),
    "frictionless bond": bond(friction_angle_deg=0.0, dilatancy_angle_deg=0.0),
    "dashpot": ViscousJoint(law=friction(), normal_viscosity=1e9, shear_viscosity=3e8).for_step(DT),
    "dashpot on a bond": ViscousJoint(
        law=bond(dilatancy_angle_deg=0.0), normal_viscosity=1e9, shear_viscosity=3e8
    ).for_step(DT),
}


def random_states(law, count, seed):
    """Gaps and states of all kinds; of ten points two lie on a kink and two next to one."""
    rng = np.random.default_rng(seed)
    wide = np.longdouble
    gap = UM * rng.normal(size=(count, 3)) * [1.0, 0.3, 0.3] - [0.5 * UM, 0, 0]
    before = UM * rng.normal(size=(count, 3)) * [1.0, 0.3, 0.3]
    slip = 0.1 * UM * rng.normal(size=(count, 2))
    internal = np.column_stack(
        [rng.integers(0, 2, count), 0.2 * UM * np.abs(rng.normal(size=count))]
    )
    internal[internal[:, 0] == 0, 1] = 0.0  # an intact bond has not dilated
    slip[(before[:, 0] > internal[:, 1]) & (internal[:, 0] == 1)] = 0.0
    if not variables_of(getattr(law, "law", law)):
        slip[before[:, 0] > 0] = 0.0
    gap, before, slip = gap.astype(wide), before.astype(wide), slip.astype(wide)
    kind = rng.integers(0, 10, count)
    near = np.where(kind == 1, 0.0, np.where(kind == 2, 1e-6, -1e-6)) * UM
    touching = (kind >= 1) & (kind <= 3)
    gap[touching, 0] = near[touching]
    before[kind == 4, 0] = 0.0
    # On the limit of friction: a trial of the size mu p, or a part in 1e5 beside it.
    mu = getattr(getattr(law, "law", law), "friction_coefficient", 0.0)
    k_s = getattr(law, "law", law).shear_stiffness
    limit = (kind == 5) | (kind == 6)
    limit &= (gap[:, 0] < -0.1 * UM) & (before[:, 0] <= 0) & (k_s > 0) & (mu > 0)
    length = -mu * getattr(law, "law", law).normal_stiffness * gap[:, 0] / (k_s or 1.0)
    length *= np.where(kind == 5, 1 + 1e-5, 1 - 1e-5)
    angle = rng.uniform(0, 2 * math.pi, count)
    towards = np.column_stack([np.cos(angle), np.sin(angle)])
    gap[limit, 1:] = (before[:, 1:] - slip + length[:, None] * towards)[limit]
    still = kind == 7  # no slip at all in the step
    gap[still, 1:] = before[still, 1:]
    slip[still] = 0.0
    state = JointState(gap=before, elastic_slip=slip, internal=internal.astype(wide))
    return gap, state


def piece_of(answer):
    """Status; without friction a trial traction of zero has the tangent of sticking."""
    still = (answer.status == Status.FRICTIONLESS) & answer.tangent[:, 1:].any(axis=(1, 2))
    return answer.status.astype(int) + 64 * still


def branch(law, gap, state):
    """Which smooth piece of the law a state is on."""
    answer = law.backward_euler(gap, state)
    piece = piece_of(answer)
    if answer.state.internal.size:
        piece = piece + 4 * (answer.state.internal[:, 0] == BROKEN)
    if isinstance(law, DashpotStep):
        piece = piece + 8 * (answer.traction[:, 0] < 0) + 16 * (gap[:, 0] <= 0)
        dash = (answer.traction - law.law.backward_euler(gap, state).traction)[:, 1:]
        bound = np.hypot(dash[:, 0], dash[:, 1]) >= -answer.traction[:, 0] * (1 - 1e-14)
        piece = piece + 32 * bound
    return answer.traction, answer.tangent, piece


def small_steps(gap, state, answer):
    """Steps small against what makes the law curved, but not against rounding, shape (n,), [m].

    That is the slip that gives sliding its direction, and the way of a landing point. A point with
    an intact bond does not land.
    """
    sliding = np.isin(answer.status, (Status.SLIP, Status.FRICTIONLESS))
    trial = np.hypot(*(state.elastic_slip + gap[:, 1:] - state.gap[:, 1:]).T)
    opening = state.gap[:, 0]
    lands = opening > 0
    if answer.state.internal.size:
        lands &= answer.state.internal[:, 0] == BROKEN
    way = np.where(lands, opening + np.maximum(-gap[:, 0], 0.0), UM)
    scale = np.minimum(np.where(sliding & (trial > 0), trial, UM), way)
    return 3e-7 * np.maximum(np.minimum(scale, UM), 1e-3 * trial)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", LAWS)
def test_tangent_of_the_law(name, count):
    law = LAWS[name]
    count = number_for(law, count)
    gap, state = random_states(law, count, seed=1)
    steps = small_steps(gap, state, law.backward_euler(gap, state))
    if isinstance(law, DashpotStep):
        slip = np.hypot(*(gap[:, 1:] - state.gap[:, 1:]).T)
        steps = np.where(slip > 0, np.minimum(steps, 3e-7 * slip), steps)
    worst, share = largest_error(lambda g: branch(law, g, state), gap, steps)
    print(f"\n{name}: largest relative error of the tangent {worst:.1e} over {count} states")
    assert worst <= TOLERANCE
    assert share > 0.999
    rubs = law.closed_stiffness()[1] > 0 and getattr(law, "friction_coefficient", 1.0) > 0
    expected = {Status.OPEN}
    expected |= {Status.STICK} if rubs or "bond" in name else set()
    expected |= {Status.SLIP} if rubs and "key" not in name else set()
    expected |= set() if rubs else {Status.FRICTIONLESS}
    assert set(law.backward_euler(gap, state).status.tolist()) == expected


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", [n for n in LAWS if hasattr(LAWS[n], "condensed_backward_euler")])
def test_tangent_of_the_local_solution(name, count):
    """Also, the traction is that of the law at the gap it leads to."""
    law = LAWS[name]
    count = number_for(law, count)
    gap, state = random_states(law, count, seed=2)
    rng = np.random.default_rng(3)
    compliance = 10.0 ** rng.uniform(-14, -9, (count, 1)) * rng.uniform(0.3, 3.0, (count, 2))
    if has_bonds(getattr(law, "law", law)):
        # As solvers do: a bond that breaks at a gap may leave no solution on a compliance.
        state = replace(state, internal=with_bonds(state.internal, rng.random(count) < 0.5))

    def evaluate(free):
        answer = law.condensed_backward_euler(free, compliance.astype(np.longdouble), state)
        points = isinstance(law, CompiledLaw) and not law.loops
        piece = branch(law, answer.state.gap, state)[2] if points else piece_of(answer)
        return answer.traction, answer.tangent, piece

    at_start = law.condensed_backward_euler(gap, compliance.astype(np.longdouble), state)
    found = np.isfinite(at_start.traction).all(axis=1)
    there, traction = law.backward_euler(at_start.state.gap, state).traction, at_start.traction
    size = np.maximum(np.abs(traction).max(axis=1, keepdims=True), 1.0)
    assert np.abs((there - traction) / size)[found].max() <= 1e-6
    moved = np.repeat(compliance, (1, 2), axis=1) * traction
    np.testing.assert_allclose(at_start.state.gap[found], (gap - moved)[found], rtol=0, atol=1e-16)
    # Newton's method leaves 16 roundings of the stiffest part, a formula leaves one or two. An
    # adhesion shifts the gap, which adds roundings: with steps of 3, 9 and 30 times the small ones
    # the error falls from 4e-8 to 1e-8 and 2e-9, so it is not an error of the tangent.
    steps = (30.0 if name == "adhesive" else 3.0) * small_steps(gap, state, at_start)
    worst, share = largest_error(evaluate, gap, steps)
    print(f"\n{name}, local: largest relative error {worst:.1e} over {count} states")
    assert worst <= TOLERANCE
    assert share > 0.999


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", LAWS)
def test_tractions_are_continuous(name, count):
    """Between random gaps: what is left of a jump after 45 bisections towards its place.

    Halving a way of some um 45 times leaves 1e-19 m: below 1e-9 of the tractions, of about a MPa,
    also where a slip of some nm gives the direction. Where an intact bond breaks, and only there,
    the traction jumps.
    """
    law = LAWS[name]
    gap, state = random_states(law, count, seed=4)
    gap, other = gap.astype(float), random_states(law, count, seed=5)[0].astype(float)
    state = JointState(
        gap=state.gap.astype(float),
        elastic_slip=state.elastic_slip.astype(float),
        internal=state.internal.astype(float),
    )
    if variables_of(getattr(law, "law", law)):
        state.internal[:, 0] = 1.0
    ends, values = [gap, other], [law.backward_euler(g, state).traction for g in (gap, other)]
    for _ in range(45):
        middle = 0.5 * (ends[0] + ends[1])
        there = law.backward_euler(middle, state).traction
        jumps = [np.abs(there - value).max(axis=1) for value in values]
        for end, side in ((0, jumps[0] < jumps[1]), (1, jumps[0] >= jumps[1])):
            ends[end][side], values[end][side] = middle[side], there[side]
    stiffness = max(getattr(law, "law", law).closed_stiffness())
    assert np.abs(values[0] - values[1]).max() < 1e-15 * stiffness
