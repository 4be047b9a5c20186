# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A point of a joint with shear keys: three faces with friction, and teeth that shear off.

Contact of the point is contact with three flat faces: the base, and of the tooth on either side the
flank or the crest. With the rows of R_i a face's normal and its two directions,

    g_i = R_i g + o_i,      t = sum R_i^T t_i(g_i).                                        (9a)

t_i is the traction of `friction` at the gap of the face. The faces are chosen at the start of a
step and do not change in it. The work of the faces is then the work of the joint, so that whole
steps balance the energy as those of `FrictionNoTension` do.

The axes of the keys are the normal, across the keys and along the keys. The axes of a flank are
these, turned about the third.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import inline, njit
from dolfinx_joints.laws.law import BORNE, BROKEN, INTACT, RELEASED, Floats
from dolfinx_joints.laws.points.on_compliance import search_of, solver_of
from dolfinx_joints.laws.points.return_mapping import (
    STICK,
    Answer,
    Start,
    bond_under,
    overload,
    put_nothing,
)

# Columns of the history of a point: elastic slip on the base, internal variables, `slips` of
# `JointState`.
KEYS, LIFT, TEETH, SLIPS = 2, 3, 4, 8
# Kinds of faces; the base and crests are flat.
ABSENT, FLANK, FLAT = 0, 1, 2


class Teeth(NamedTuple):
    """Parameters of the points.

    Attributes:
        normal_stiffness: k_n [Pa/m].
        shear_stiffness: k_s [Pa/m].
        cosine: Of the angle of the flanks.
        sine: Of the angle of the flanks.
        key_cosine: Of the angle between s2 and the keys.
        key_sine: Of the angle between s2 and the keys.
        depth: d [m].
        forward: Play before the flank of the tooth ahead, negative if there is no tooth [m].
        backward: Play before the flank of the tooth behind.
        cohesion: a c [Pa].
        friction: Tan(phi_t).
        whole: 1 if the faces are evaluated over whole steps, 0 if at the end of steps.
    """

    normal_stiffness: float
    shear_stiffness: float
    cosine: float
    sine: float
    key_cosine: float
    key_sine: float
    depth: float
    forward: float
    backward: float
    cohesion: float
    friction: float
    whole: float


class Faces(NamedTuple):
    """The three faces of a point at the start of a step.

    Attributes:
        kind: Kind of each face, shape (3,).
        plane: Cosine and sine of R_i, and o_i [m], shape (3, 3).
        gap: Gap in the axes of each face, shape (3, 3), [m].
        history: History of each face as its friction takes it, shape (3, 2 or 10).
    """

    kind: NDArray[np.int64]
    plane: Floats
    gap: Floats
    history: Floats


class KeyStart(NamedTuple):
    """A `Start` with the faces of the point that is being solved.

    Attributes:
        gap: See `Start`.
        history: See `Start`.
        laws: See `Start`.
        faces: Faces of the point at the start of the step.
        ends: Answer of the faces at the end of the step.
    """

    gap: Floats
    history: Floats
    laws: Floats
    faces: Faces
    ends: Answer


@inline
def teeth_of(laws: Floats) -> Teeth:
    """Return the parameters of all points; columns 2 to 6 are those of the friction of faces."""
    r, k_n, k_s = laws[0, 7:], laws[0, 0], laws[0, 1]
    return Teeth(k_n, k_s, r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9])


@inline
def _slip_columns(teeth: Teeth) -> tuple[int, float]:
    """Return the first column of the slip in the history of a face, and the factor of the slip."""
    return (1, np.sqrt(teeth.shear_stiffness)) if teeth.whole == 1.0 else (0, 1.0)


@inline
def turned(first: Any, second: Any, cosine: Any, sine: Any) -> tuple[Any, Any]:
    """Return two components of a vector in axes turned about the third, or back by -sine."""
    return cosine * first - sine * second, sine * first + cosine * second


@inline
def _turn_back(a: int, b: int, turn: Any, traction: Floats, tangent: Floats) -> None:
    """Write a traction and its tangent in the axes before a `turned`, in place."""
    c, s = turn[0], turn[1]
    traction[a], traction[b] = turned(traction[a], traction[b], c, -s)
    for k in range(3):
        tangent[k, a], tangent[k, b] = turned(tangent[k, a], tangent[k, b], c, -s)
    for k in range(3):
        tangent[a, k], tangent[b, k] = turned(tangent[a, k], tangent[b, k], c, -s)


@inline
def gap_on_faces(gap: Floats, plane: Floats, teeth: Teeth, local: Floats) -> None:
    """Write the gap of a point in the axes of its faces, shape (3, 3), [m]."""
    across, along = turned(gap[1], gap[2], teeth.key_cosine, teeth.key_sine)
    for f in range(3):
        normal, local[f, 1] = turned(gap[0], across, plane[f, 0], plane[f, 1])
        local[f, 0], local[f, 2] = normal + plane[f, 2], along


@inline
def _tooth(f: int, gap: Floats, teeth: Teeth) -> tuple[float, float, float]:
    """Return the sine of the tooth ``f``, and the normal gaps of its flank and its crest [m]."""
    sine, play = (teeth.sine, teeth.forward) if f == 1 else (-teeth.sine, teeth.backward)
    across, _ = turned(gap[1], gap[2], teeth.key_cosine, teeth.key_sine)
    return sine, teeth.cosine * gap[0] - sine * across + play * teeth.sine, gap[0] - teeth.depth


@inline
def choose_faces(gap: Floats, history: Floats, teeth: Teeth, faces: Faces) -> float:
    """Choose the faces of a point at the start of a step; return their elastic energy [J/m^2].

    Args:
        gap: Gap at the start, shape (3,), [m].
        history: History of the point.
        teeth: Parameters.
        faces: Written by this function.
    """
    k_n, k_s, plane = teeth.normal_stiffness, teeth.shear_stiffness, faces.plane
    plane[0, 0], plane[0, 1], plane[0, 2], faces.kind[0] = 1.0, 0.0, -history[LIFT], FLAT
    for f in range(1, 3):
        sine, flank, crest = _tooth(f, gap, teeth)
        play = teeth.forward if f == 1 else teeth.backward
        if play < 0.0 or history[KEYS] >= BROKEN:
            # The gap of a missing tooth is its depth wherever the point is.
            faces.kind[f], plane[f, 0], plane[f, 1], plane[f, 2] = ABSENT, 0.0, 0.0, teeth.depth
        elif crest > flank:  # the face that the point is nearest to, or beyond
            faces.kind[f], plane[f, 0], plane[f, 1], plane[f, 2] = FLAT, 1.0, 0.0, -teeth.depth
        else:
            faces.kind[f], plane[f, 0], plane[f, 1] = FLANK, teeth.cosine, sine
            plane[f, 2] = play * teeth.sine
    gap_on_faces(gap, plane, teeth, faces.gap)
    energy, (first, root) = 0.0, _slip_columns(teeth)
    if teeth.whole == 1.0:
        for k in range(5):
            faces.history[0, 3 + k] = history[SLIPS + k]
    for f in range(3):
        _, flank, crest = _tooth(f, gap, teeth)
        meets = f == 0 or (faces.kind[f] != ABSENT and max(flank, crest) <= 0.0)
        column = TEETH + 2 * (f - 1) if f > 0 else 0
        overlap = min(faces.gap[f, 0], 0.0)
        normal = 0.5 * k_n * overlap * overlap
        energy += normal
        for a in range(2):
            slip = history[column + a] if meets else 0.0
            faces.history[f, first + a] = root * slip
            energy += 0.5 * k_s * slip * slip
        if teeth.whole == 1.0:
            faces.history[f, 0] = normal
    return energy


@inline
def shear_off(gap: Floats, history: Floats, teeth: Teeth, faces: Faces, sheared: Floats) -> None:
    """Write the history of a point without its teeth; its base bears the largest pressure.

    Args:
        gap: Gap at the start of the step, shape (3,), [m].
        history: History of the point.
        teeth: Parameters.
        faces: Faces of the point with its teeth.
        sheared: Written by this function.
    """
    k_n, pressed, (first, root) = teeth.normal_stiffness, 0.0, _slip_columns(teeth)
    for f in range(3):
        normal = k_n * min(faces.gap[f, 0], 0.0)
        shear = teeth.shear_stiffness * faces.history[f, first] / root
        t_n, _ = turned(normal, shear, faces.plane[f, 0], -faces.plane[f, 1])
        # Not more than the overlap of the face itself: energy may be lost only.
        pressed = max(pressed, min(-t_n, -normal))
    for k in range(len(history)):
        sheared[k] = 0.0 if KEYS <= k < SLIPS else history[k]
    sheared[KEYS] = BROKEN
    if faces.gap[0, 0] <= 0.0 or pressed > 0.0:
        sheared[LIFT] = gap[0] + pressed / k_n


@inline
def finish(
    i: int, history: Floats, teeth: Teeth, faces: Faces, answer: Answer, ends: Answer
) -> None:
    """Write the history of a point at the end of a step; dissipate the energy of faces it leaves.

    Args:
        i: Number of the point.
        history: History of the point at the start, without the teeth if they shear off.
        teeth: Parameters.
        faces: Faces at the start. This function overwrites them.
        answer: Answer of all points.
        ends: Answer of the faces.
    """
    end, (first, root) = answer.history[i], _slip_columns(teeth)
    if teeth.whole == 1.0:
        for k in range(5):
            end[SLIPS + k] = ends.history[0, 3 + k]
    end[KEYS], end[LIFT] = history[KEYS], history[LIFT]
    stored, leaves = 0.0, False
    for f in range(3):
        _, flank, crest = _tooth(f, answer.gap[i], teeth)
        stays = max(flank, crest) <= 0.0 and (crest > flank) == (faces.kind[f] == FLAT)
        kept = f == 0 or (faces.kind[f] != ABSENT and stays)
        overlap = min(ends.gap[f, 0], 0.0)
        energy = 0.5 * teeth.normal_stiffness * overlap * overlap
        for a in range(2):
            slip = ends.history[f, first + a] / root
            end[(TEETH + 2 * (f - 1) if f > 0 else 0) + a] = slip if kept else 0.0
            energy += 0.5 * teeth.shear_stiffness * slip * slip
        stored += energy
        leaves = leaves or (not kept and energy > 0.0)
    if leaves:
        answer.dissipation[i] += stored - choose_faces(answer.gap[i], end, teeth, faces)


def keyed_loop(face_point: Callable[..., None]) -> Any:
    """Return the compiled loop of shear keys whose faces have this friction; see `CompiledLaw`."""

    @inline
    def point(i: int, start: KeyStart, answer: Answer) -> None:
        """Write the sum over the faces (9a); the load of the teeth (9b) is in the history."""
        teeth, faces, ends = teeth_of(start.laws), start.faces, start.ends
        traction, tangent = answer.traction[i], answer.tangent[i]
        put_nothing(i, answer)
        gap_on_faces(answer.gap[i], faces.plane, teeth, ends.gap)
        ratio, sticks = 0.0, False
        friction = Start(faces.gap, faces.history, start.laws[:, 2:7])
        for f in range(3):
            face_point(f, friction, ends)
            if faces.kind[f] == FLANK:
                _turn_back(0, 1, faces.plane[f], ends.traction[f], ends.tangent[f])
            for a in range(3):
                traction[a] += ends.traction[f, a]
                for b in range(3):
                    tangent[a, b] += ends.tangent[f, a, b]
            if f > 0:
                strength = teeth.cohesion - teeth.friction * ends.traction[f, 0]
                ratio = max(ratio, overload(abs(ends.traction[f, 1]), strength))
            answer.dissipation[i] += ends.dissipation[f]
            answer.status[i] = max(answer.status[i], ends.status[f])
            sticks = sticks or ends.status[f] == STICK
        _turn_back(1, 2, (teeth.key_cosine, teeth.key_sine), traction, tangent)
        answer.history[i, KEYS] = ratio
        if sticks:
            answer.status[i] = STICK

    solve = solver_of(point)

    @njit(cache=True, error_model="numpy")
    def loop(compliance: Floats, start: Start, answer: Answer, first: int, stride: int) -> None:
        """Solve the points with their teeth, and without them if these are overloaded."""
        kind, teeth = answer.gap.dtype, teeth_of(start.laws)
        columns = 10 if teeth.whole == 1.0 else 2
        faces = Faces(
            np.zeros(3, np.int64),
            np.zeros((3, 3), kind),
            np.zeros((3, 3), kind),
            np.zeros((3, columns), kind),
        )
        ends = Answer(
            np.zeros((3, 3), kind),
            np.zeros((3, 3, 3), kind),
            np.zeros((3, 3), kind),
            np.zeros((3, columns), kind),
            np.zeros(3, kind),
            np.zeros(3, np.int8),
        )
        begun = KeyStart(start.gap, start.history, start.laws, faces, ends)
        search, sheared = search_of(1, kind), np.zeros(SLIPS + 5, kind)
        for i in range(first, len(answer.gap), stride):
            c = compliance[i if len(compliance) > 1 else 0]
            gap, history, end = start.gap[i], start.history[i], answer.gap[i]
            trial_gap = (end[0], end[1], end[2])
            energy = first_energy = choose_faces(gap, history, teeth, faces)
            while True:
                solve(i, c[0], c[1], begun, answer, search)
                bond, ratio = history[KEYS], answer.history[i, KEYS]
                if bond != RELEASED and not (bond == INTACT and ratio > 1.0 + BORNE):
                    break
                shear_off(gap, history, teeth, faces, sheared)
                history = sheared
                energy = choose_faces(gap, history, teeth, faces)
                for a in range(3):
                    end[a] = trial_gap[a]
            finish(i, history, teeth, faces, answer, ends)
            answer.dissipation[i] += first_energy - energy
            if bond < BROKEN:
                answer.history[i, KEYS] = bond_under(bond, ratio)

    return loop


class FacesOfAll(NamedTuple):
    """The three faces of ``n`` points in a step.

    Attributes:
        plane: See `Faces`, shape (n, 3, 3).
        gap: Gap at the start, shape (n, 3, 3), [m].
        slip: Elastic slip at the start, shape (n, 3, 2), [m].
        end: Gap at the end, shape (n, 3, 3), [m].
        energy: Elastic energy at the start, shape (n,), [J/m^2].
    """

    plane: Floats
    gap: Floats
    slip: Floats
    end: Floats
    energy: Floats


@njit(cache=True, error_model="numpy")
def choose_all(start: Start, end: Floats, shears: NDArray[np.bool_], chosen: FacesOfAll) -> None:
    """Write the faces of all points, without teeth where they shear off.

    Args:
        start: `Start` of the rule for the end of steps.
        end: Gap at the end of the step, shape (n, 3), [m].
        shears: Points whose teeth shear off in the step, shape (n,).
        chosen: Written by this function.
    """
    teeth, kind, sheared = (
        teeth_of(start.laws),
        np.zeros(3, np.int64),
        np.zeros(SLIPS + 5, end.dtype),
    )
    for i in range(len(end)):
        faces = Faces(kind, chosen.plane[i], chosen.gap[i], chosen.slip[i])
        chosen.energy[i] = choose_faces(start.gap[i], start.history[i], teeth, faces)
        if shears[i]:
            shear_off(start.gap[i], start.history[i], teeth, faces, sheared)
            chosen.energy[i] = choose_faces(start.gap[i], sheared, teeth, faces)
        gap_on_faces(end[i], faces.plane, teeth, chosen.end[i])
