# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Semi-smooth Newton on the joint forces of one step, from starts to convergence.

Functions and their steps are those of `InterfaceSolver`, `JointStep` and `Corrections`. Each works
on arrays that it is given, of the points of this rank.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit
from dolfinx_joints.laws.discrete_gradient import discrete_gradient_points
from dolfinx_joints.laws.friction import backward_euler_points
from dolfinx_joints.laws.return_mapping import Answer, Start
from dolfinx_joints.solvers.interface.compiled.corrections import Memory, correct
from dolfinx_joints.solvers.interface.compiled.products import multiply
from dolfinx_joints.solvers.line_search import FALL, PATIENCE, WHOLE

Floats = NDArray[np.float64]

EPSILON = float(np.finfo(np.float64).eps)


class Points(NamedTuple):
    """The joint points in a step.

    Attributes:
        whole_step: Whether laws are asked over the whole step, or at its end.
        start: State and laws.
        trial_gap: Gap without joint forces, shape (n, 3), [m].
        own: Compliance of each point on its own area, shape (n, 2), [m/Pa].
        scale: s, zero where a point cannot move, shape (m,).
        root: s w, shape (m,).
        reach: Largest scaled gap, before and in the step.
    """

    whole_step: bool
    start: Start
    trial_gap: Floats
    own: Floats
    scale: Floats
    root: Floats
    reach: float


class Iterate(NamedTuple):
    """Scaled forces with what follows from them; see `residual.Iterate`.

    Attributes:
        force: f, shape (m,).
        coupled: S f.
        residual: r.
        tangent: T, shape (n, 3, 3).
        answer: Of the laws.
        sizes: Largest force that the laws give; 2-norm and largest of r, shape (3,).
    """

    force: Floats
    coupled: Floats
    residual: Floats
    tangent: Floats
    answer: Answer
    sizes: Floats


class Limits(NamedTuple):
    """Limits of the iteration.

    Attributes:
        tolerance: Largest residual accepted, relative to the largest force.
        enough: Residual beyond which nothing is gained, relative likewise.
        iterations: Most iterations.
        cuts: Most halvings of a correction.
        inner: Residual of corrections, relative to their right-hand sides, at first.
        poor: Residual above which points are swept, relative to the largest force; infinite for
            none.
        colours: In so many colours.
    """

    tolerance: float
    enough: float
    iterations: int
    cuts: int
    inner: float
    poor: float
    colours: int


@njit(cache=True)
def _ask(points: Points, answer: Answer, first: int, stride: int) -> None:
    if points.whole_step:
        discrete_gradient_points(points.own, points.start, answer, first, stride)
    else:
        backward_euler_points(points.own, points.start, answer, first, stride)


@njit(cache=True)
def evaluate(points: Points, at: Iterate) -> None:
    """Residual f - s w t and tangent s w T s of the forces of an iterate."""
    answer, scale, root = at.answer, points.scale, points.root
    for i in range(len(points.own)):
        for a in range(3):
            k = 3 * i + a
            answer.gap[i, a] = points.trial_gap[i, a] - scale[k] * at.coupled[k]
    _ask(points, answer, 0, 1)
    largest, total, worst = 0.0, 0.0, 0.0
    for i in range(len(points.own)):
        for a in range(3):
            k = 3 * i + a
            force = root[k] * answer.traction[i, a]
            left = at.force[k] - force if root[k] > 0.0 else 0.0
            at.residual[k] = left
            largest, total = max(largest, abs(force)), total + left * left
            worst = max(worst, abs(left)) if left == left else np.nan
            for b in range(3):
                at.tangent[i, a, b] = root[k] * answer.tangent[i, a, b] * scale[3 * i + b]
    at.sizes[0], at.sizes[1], at.sizes[2] = largest, np.sqrt(total), worst


@njit(cache=True)
def _sweep(
    points: Points, split: Any, at: Iterate, out: Iterate, colours: int, memory: Memory
) -> None:
    """Each point solved with the others' forces fixed, one colour after the other."""
    change, moved = memory.step, memory.coupled
    scale, root, answer = points.scale, points.root, out.answer
    out.force[:], out.coupled[:] = at.force, at.coupled
    for colour in range(min(colours, len(points.own))):
        change[:] = 0.0
        for i in range(colour, len(points.own), colours):
            for a in range(3):
                k = 3 * i + a
                answer.gap[i, a] = points.trial_gap[i, a] - scale[k] * out.coupled[k]
        _ask(points, answer, colour, colours)
        for i in range(colour, len(points.own), colours):
            for a in range(3):
                k = 3 * i + a
                change[k] = root[k] * answer.traction[i, a] - out.force[k]
                out.force[k] += change[k]
        multiply(split, change, memory.numbers, moved)
        for k in range(len(moved)):
            out.coupled[k] += moved[k]
    evaluate(points, out)


@njit(cache=True)
def _better(
    points: Points,
    split: Any,
    iterates: tuple[Iterate, ...],
    here: int,
    limits: Limits,
    memory: Memory,
) -> int:
    """The iterate, or that after a sweep where it is poor and the sweep better."""
    at = iterates[here]
    if not at.sizes[2] > limits.poor * at.sizes[0]:
        return here
    swept = (here + 1) % 3
    _sweep(points, split, at, iterates[swept], limits.colours, memory)
    return swept if iterates[swept].sizes[1] < at.sizes[1] else here


@njit(cache=True)
def _search(
    points: Points, iterates: tuple[Iterate, ...], here: int, cuts: int, memory: Memory
) -> int:
    """Take the correction, halved while it does not make the residual smaller."""
    at, best, share = iterates[here], -1, 1.0
    for _ in range(cuts + 1):
        number = (here + 1) % 3
        if number == best:
            number = (here + 2) % 3
        trial = iterates[number]
        for k in range(len(at.force)):
            trial.force[k] = at.force[k] - share * memory.step[k]
            trial.coupled[k] = at.coupled[k] - share * memory.coupled[k]
        evaluate(points, trial)
        if best < 0 or trial.sizes[1] < iterates[best].sizes[1]:
            best = number
        if trial.sizes[1] < at.sizes[1]:
            break
        share *= 0.5
    return best


@njit(cache=True)
def _first(points: Points, iterates: tuple[Iterate, ...], ahead: bool) -> int:
    """The better of the starts."""
    evaluate(points, iterates[0])
    if not ahead:
        return 0
    evaluate(points, iterates[1])
    return 1 if iterates[1].sizes[1] < iterates[0].sizes[1] else 0


@njit(cache=True)
def _rounding(points: Points, at: Iterate) -> float:
    """Scaled force that rounding of the gaps may leave."""
    force, coupled = 0.0, 0.0
    for k in range(len(at.force)):
        force, coupled = max(force, abs(at.force[k])), max(coupled, abs(at.coupled[k]))
    return 64.0 * EPSILON * (points.reach + force + coupled)


@njit(cache=True)
def iterate(
    points: Points,
    split: Any,
    inner_split: Any,
    iterates: tuple[Iterate, ...],
    ahead: bool,
    limits: Limits,
    memory: Memory,
) -> tuple[bool, int, int, float]:
    """Solve r(f) = 0.

    Args:
        points: The points in the step.
        split: S.
        inner_split: S inside corrections.
        iterates: Three to work with; the first, with ``ahead`` the second too, holds a start.
        ahead: Whether there are two starts.
        limits: Limits.
        memory: What corrections keep, and room to work in.

    Returns:
        Whether it converged, which iterate is the last, iterations, and the residual relative to
        the largest force.
    """
    here = _better(points, split, iterates, _first(points, iterates, ahead), limits, memory)
    iteration, last, inner = 0, np.inf, limits.inner
    norms, since, whole = np.empty(limits.iterations + 1), 0, 0
    while True:
        at = iterates[here]
        size = at.sizes[2]
        scale = at.sizes[0] or size or 1.0
        relative, rounding = size / scale, _rounding(points, at) / scale
        # As in `InterfaceSolver._iterate`.
        accepted = max(limits.tolerance, min(rounding, 1e-6 if rounding < 1.0 else 1e-3))
        done = relative <= limits.enough or (relative <= accepted and size >= 0.5 * last)
        given_up = iteration == limits.iterations or not 0.0 < size < np.inf
        if done or given_up:
            return done or relative <= accepted, here, iteration, relative
        if iteration:
            inner = min(limits.inner, (size / last) ** 2)
        last = size
        tolerance = max(inner, 0.3 * limits.enough / relative)
        correct(
            split, inner_split, at.residual, at.tangent, 0.1 * limits.enough * scale,
            tolerance, memory,
        )
        # As in `LineSearch`.
        norms[since], since, cuts = at.sizes[1], since + 1, limits.cuts
        if since > PATIENCE and norms[since - 1] > FALL * norms[since - 1 - PATIENCE]:
            whole = WHOLE
        if whole > 0:
            whole, since, cuts = whole - 1, 0, 0
        here = _search(points, iterates, here, cuts, memory)
        here = _better(points, split, iterates, here, limits, memory)
        iteration += 1
