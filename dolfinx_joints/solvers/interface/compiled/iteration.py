# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Semi-smooth Newton on the joint forces of one step, from starts to convergence.

Functions and their steps are those of `InterfaceSolver`, `JointStep` and `Corrections`. Each works
on arrays that it is given, of the points of this rank, and all ranks wait in it for each other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import njit, part
from dolfinx_joints.laws.discrete_gradient import discrete_gradient_points
from dolfinx_joints.laws.friction import backward_euler_points
from dolfinx_joints.laws.return_mapping import Answer, Start
from dolfinx_joints.solvers.interface.compiled.corrections import (
    COUPLED,
    FREE,
    STEP,
    Memory,
    correct,
)
from dolfinx_joints.solvers.interface.compiled.products import multiply
from dolfinx_joints.solvers.interface.compiled.ranks import Ranks, each_of_ranks, largest_of
from dolfinx_joints.solvers.line_search import FALL, PATIENCE, WHOLE

Floats = NDArray[np.float64]

EPSILON = float(np.finfo(np.float64).eps)

# Where the error of S f is more than this part of the residual, S f is computed anew; more than
# this part of the next residual, were convergence quadratic, the next S f is computed exactly.
# Neither where it is less than this part of the residual that is enough; with W the error has been
# up to eight times what is made of it here.
STALE, NEXT, LITTLE = 0.1, 0.3, 0.03

# Columns of the sizes of iterates.
SCALE, NORM, LARGEST, ERROR, REACH = 0, 1, 2, 3, 4


class Points(NamedTuple):
    """The joint points in a step.

    Attributes:
        ranks: The ranks.
        first: Number of the rank's first point among all.
        whole_step: Whether laws are asked over the whole step, or at its end.
        start: State and laws.
        trial_gap: Gap without joint forces, shape (n, 3), [m].
        own: Compliance of each point on its own area, shape (n, 2), [m/Pa].
        scale: s, zero where a point cannot move, shape (m,).
        root: s w, shape (m,).
        all_colours: 0 and 1: all points are of one colour.
    """

    ranks: Ranks
    first: int
    whole_step: bool
    start: Start
    trial_gap: Floats
    own: Floats
    scale: Floats
    root: Floats
    all_colours: tuple[int, int] = (0, 1)


class Iterates(NamedTuple):
    """Three sets of scaled forces with what follows from them; see `residual.Iterate`.

    Attributes:
        force: f, shape (3, m).
        coupled: S f, likewise.
        residual: r, likewise.
        tangent: T, shape (3, n, 3, 3).
        answer: Of the laws, its arrays one for each of the three.
        sizes: Largest force that the laws give; 2-norm and largest of r; error of S f; largest of
            f plus that of S f; all of all ranks, shape (3, 5).
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
        rough: Error of S inside corrections, relative to its products.
        poor: Residual above which points are swept, relative to the largest force; infinite for
            none.
        colours: In so many colours.
    """

    tolerance: float
    enough: float
    iterations: int
    cuts: int
    inner: float
    rough: float
    poor: float
    colours: int


@part
def _ask(points: Points, coupled: Floats, answer: Answer, colour: tuple[int, int]) -> None:
    """Answer of the laws at the points of a colour, its number and that of all colours."""
    scale, (first, colours) = points.scale, colour
    for i in range(first, len(points.own), colours):
        for a in range(3):
            k = 3 * i + a
            answer.gap[i, a] = points.trial_gap[i, a] - scale[k] * coupled[k]
    if points.whole_step:
        discrete_gradient_points(points.own, points.start, answer, first, colours)
    else:
        backward_euler_points(points.own, points.start, answer, first, colours)


@part
def answer_of(iterates: Iterates, at: int) -> Answer:
    """The answer of the laws to one of the iterates."""
    every = iterates.answer
    return Answer(
        every.traction[at],
        every.tangent[at],
        every.gap[at],
        every.history[at],
        every.dissipation[at],
        every.status[at],
    )


@part
def evaluate(points: Points, iterates: Iterates, at: int) -> None:
    """Residual f - s w t and tangent s w T s of the forces of an iterate (collective)."""
    answer, scale, root = answer_of(iterates, at), points.scale, points.root
    force, residual, tangent = iterates.force[at], iterates.residual[at], iterates.tangent[at]
    _ask(points, iterates.coupled[at], answer, points.all_colours)
    coupled, total, mine = iterates.coupled[at], 0.0, np.zeros(5)
    for i in range(len(points.own)):
        for a in range(3):
            k = 3 * i + a
            given = root[k] * answer.traction[i, a]
            left = force[k] - given if root[k] > 0.0 else 0.0
            residual[k] = left
            total += left * left
            mine[0] = max(mine[0], abs(given))
            mine[1] = max(mine[1], abs(left)) if left == left else np.nan
            mine[2], mine[3] = max(mine[2], abs(force[k])), max(mine[3], abs(coupled[k]))
            for b in range(3):
                tangent[i, a, b] = root[k] * answer.tangent[i, a, b] * scale[3 * i + b]
    mine[4] = total
    _gather_sizes(points.ranks, mine, iterates.sizes[at])


@part
def _reach(points: Points) -> float:
    """Largest scaled gap before and in the step."""
    largest, gap = 0.0, points.start.gap
    for i in range(len(points.own)):
        for a in range(3):
            scale = points.scale[3 * i + a]
            if scale > 0.0:
                largest = max(largest, max(abs(points.trial_gap[i, a]), abs(gap[i, a])) / scale)
    return largest


@part
def _gather_sizes(ranks: Ranks, mine: Floats, sizes: Floats) -> None:
    """Sizes of all ranks from the largest entries and the sum of each (collective)."""
    every = each_of_ranks(ranks, mine)
    for r in range(1, len(every)):
        every[0, 4] += every[r, 4]
        for k in range(4):
            if not every[0, k] >= every[r, k]:
                every[0, k] = every[r, k] if every[0, k] == every[0, k] else np.nan
    sizes[SCALE], sizes[LARGEST], sizes[NORM] = every[0, 0], every[0, 1], np.sqrt(every[0, 4])
    sizes[REACH] = every[0, 2] + every[0, 3]


@part
def _largest(values: Floats) -> float:
    largest = 0.0
    for k in range(len(values)):
        largest = max(largest, abs(values[k]))
    return largest


@part
def _sweep(
    points: Points,
    inner: Any,
    iterates: Iterates,
    at: int,
    out: int,
    limits: Limits,
    memory: Memory,
) -> None:
    """Each point solved with the others' forces fixed, one colour after the other."""
    change, moved = memory.vectors[STEP], memory.vectors[COUPLED]
    force, coupled, answer = iterates.force[out], iterates.coupled[out], answer_of(iterates, out)
    for k in range(len(force)):
        force[k], coupled[k] = iterates.force[at, k], iterates.coupled[at, k]
    colours, error = limits.colours, iterates.sizes[at, ERROR]
    for colour in range(colours):
        first = (colour - points.first) % colours
        _ask(points, coupled, answer, (first, colours))
        for k in range(len(force)):
            change[k] = 0.0
        for i in range(first, len(points.own), colours):
            for a in range(3):
                k = 3 * i + a
                change[k] = points.root[k] * answer.traction[i, a] - force[k]
                force[k] += change[k]
        multiply(inner, change, moved)
        for k in range(len(moved)):
            coupled[k] += moved[k]
        error += limits.rough * largest_of(points.ranks, _largest(moved))
    iterates.sizes[out, ERROR] = error
    evaluate(points, iterates, out)


@part
def _better(
    points: Points, inner: Any, iterates: Iterates, here: int, limits: Limits, memory: Memory
) -> int:
    """The iterate, or that after a sweep where it is poor and the sweep better."""
    sizes = iterates.sizes
    if not sizes[here, LARGEST] > limits.poor * sizes[here, SCALE]:
        return here
    swept = (here + 1) % 3
    _sweep(points, inner, iterates, here, swept, limits, memory)
    return swept if sizes[swept, NORM] < sizes[here, NORM] else here


@part
def _search(
    points: Points, iterates: Iterates, here: int, cuts: int, error: float, memory: Memory
) -> int:
    """Take the correction, halved while it does not make the residual smaller.

    S f has the given error where the whole correction is taken.
    """
    step, coupled, sizes = memory.vectors[STEP], memory.vectors[COUPLED], iterates.sizes
    best, trial, share = -1, (here + 1) % 3, 1.0
    for _ in range(cuts + 1):
        for k in range(len(step)):
            iterates.force[trial, k] = iterates.force[here, k] - share * step[k]
            iterates.coupled[trial, k] = iterates.coupled[here, k] - share * coupled[k]
        sizes[trial, ERROR] = (1.0 - share) * sizes[here, ERROR] + share * error
        evaluate(points, iterates, trial)
        if best < 0 or sizes[trial, NORM] < sizes[best, NORM]:
            best, trial = trial, (2 * here + 3 - trial) % 3 if best < 0 else best
        if sizes[best, NORM] < sizes[here, NORM]:
            break
        share *= 0.5
    return best


@part
def _couple_exactly(split: Any, iterates: Iterates, here: int, memory: Memory) -> None:
    """Replace S d by the difference of S f as it is and S (f - d)."""
    step, coupled, after = memory.vectors[STEP], memory.vectors[COUPLED], memory.vectors[FREE]
    for k in range(len(step)):
        after[k] = iterates.force[here, k] - step[k]
    multiply(split, after, coupled)
    for k in range(len(step)):
        coupled[k] = iterates.coupled[here, k] - coupled[k]


@part
def _renew(points: Points, split: Any, iterates: Iterates, at: int) -> None:
    """Compute S f anew."""
    multiply(split, iterates.force[at], iterates.coupled[at])
    iterates.sizes[at, ERROR] = 0.0
    evaluate(points, iterates, at)


@njit(cache=True, no_cfunc_wrapper=True)
def iterate(
    points: Points,
    split: Any,
    inner: Any,
    iterates: Iterates,
    starts: int,
    limits: Limits,
    memory: Memory,
) -> tuple[bool, int, int, float]:
    """Solve r(f) = 0 (collective).

    Args:
        points: The points in the step.
        split: S.
        inner: S inside corrections.
        iterates: To work with; the first, or the first two, hold starts.
        starts: Number of starts.
        limits: Limits.
        memory: What corrections keep, and room to work in.

    Returns:
        Whether it converged, which iterate is the last, iterations, and the residual relative to
        the largest force.
    """
    sizes, here = iterates.sizes, 0
    for at in range(starts):
        sizes[at, ERROR] = 0.0
        evaluate(points, iterates, at)
        here = at if sizes[at, NORM] < sizes[here, NORM] else here
    iteration, last, inner_tolerance = 0, np.inf, limits.inner
    norms, since, whole = np.empty(limits.iterations + 1), 0, 0
    passed = largest_of(points.ranks, _reach(points))
    while True:
        here = _better(points, inner, iterates, here, limits, memory)
        little = LITTLE * limits.enough * (sizes[here, SCALE] or sizes[here, LARGEST])
        if sizes[here, ERROR] > max(STALE * sizes[here, LARGEST], little):
            _renew(points, split, iterates, here)
        size = sizes[here, LARGEST]
        scale = sizes[here, SCALE] or size or 1.0
        reach = passed + sizes[here, REACH]  # what rounding of the gaps is relative to
        relative, rounding = size / scale, 64.0 * EPSILON * reach / scale
        # As in `InterfaceSolver._iterate`.
        accepted = max(limits.tolerance, min(rounding, 1e-6 if rounding < 1.0 else 1e-3))
        done = relative <= limits.enough or (relative <= accepted and size >= 0.5 * last)
        given_up = iteration == limits.iterations or not 0.0 < size < np.inf
        if done or given_up:
            return done or relative <= accepted, here, iteration, relative
        if iteration:
            inner_tolerance = min(limits.inner, (size / last) ** 2)
        last, least = size, 0.1 * limits.enough * scale
        tolerance = max(inner_tolerance, 0.3 * limits.enough / relative)
        residual, tangent = iterates.residual[here], iterates.tangent[here]
        error = sizes[here, ERROR] + limits.rough * size
        exactly = error > max(NEXT * relative * size, little)
        correct(inner, residual, tangent, least, tolerance, not exactly, memory)
        if exactly:
            _couple_exactly(split, iterates, here, memory)
        moved = largest_of(points.ranks, _largest(memory.vectors[COUPLED]))
        error = sizes[here, ERROR] + limits.rough * moved
        # As in `LineSearch`.
        norms[since], since, cuts = sizes[here, NORM], since + 1, limits.cuts
        if since > PATIENCE and norms[since - 1] > FALL * norms[since - 1 - PATIENCE]:
            whole = WHOLE
        if whole > 0:
            whole, since, cuts = whole - 1, 0, 0
        here = _search(points, iterates, here, cuts, 0.0 if exactly else error, memory)
        iteration += 1
