# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Point of a joint with shear keys: three faces with friction, and teeth that shear off.

A point has three flat contact faces: the base and, for the tooth on each side, its flank or crest.
The rows of R_i are the normal and the two tangents of face i, and o_i is its offset:

    g_i = R_i g + o_i,      t = sum R_i^T t_i(g_i).                                        (9a)

g is the gap and t the traction of the point; `friction` gives t_i at the gap of the face. The faces
are chosen at the start of a step and do not change within the step. The work of the faces therefore
equals the work of the joint, so whole steps balance the energy as with `FrictionNoTension`.

The key axes are: normal to the joint, across the keys, along the keys. The axes of a flank are the
key axes, rotated about the direction along the keys.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.kernels import inline, njit
from dolfinx_joints.laws.law import BROKEN, INTACT, OVERLOAD_ROUNDING, RELEASED, Floats
from dolfinx_joints.laws.points.on_compliance import search_of, solver_of
from dolfinx_joints.laws.points.return_mapping import (
    STICK,
    Answer,
    Start,
    bond_under,
    overload,
    put_zeros,
)

# First columns of a point's history: elastic slip on the base (0), bond, lift, elastic slips on the
# teeth, `slips` of `JointState`; and number of columns.
KEYS, LIFT, TEETH, SLIPS, COLUMNS = 2, 3, 4, 8, 13
# Kinds of faces; the base and crests are flat.
ABSENT, FLANK, FLAT = 0, 1, 2


class Teeth(NamedTuple):
    """Parameters of the law; the key angle is the angle from s2 to the direction of the keys."""

    normal_stiffness: float  # k_n [Pa/m]
    shear_stiffness: float  # k_s [Pa/m]
    cosine: float  # of the flanks
    sine: float
    key_cosine: float
    key_sine: float
    depth: float  # d [m]
    forward: float  # offset o of the flank [m], negative without flank
    backward: float
    cohesion: float  # a c [Pa]
    friction: float  # tan(phi_t)
    whole: float  # 1 for the rule over whole steps, 0 for backward Euler


class Faces(NamedTuple):
    """Three faces of a point; for n points the arrays have an additional first axis.

    Attributes:
        kind: Kind of each face, shape (3,).
        plane: Cosine and sine of R_i, and o_i [m], shape (3, 3).
        gap: Gap in the axes of each face at the start of the step, shape (3, 3), [m].
        history: History of each face for its friction rule, shape (3, 2 or 10); for backward
            Euler the elastic slip [m].
    """

    kind: NDArray[np.int64]
    plane: Floats
    gap: Floats
    history: Floats


class KeyStart(NamedTuple):
    """`Start` with the faces of the current point and their response."""

    gap: Floats
    history: Floats
    parameters: Floats
    faces: Faces
    ends: Answer


@inline
def _teeth_of(row: Floats) -> Teeth:
    """Return the parameters in an array as `Teeth`; entries 2 to 6 are the fields of `Coulomb`."""
    r, k_n, k_s = row[7:], row[0], row[1]
    return Teeth(k_n, k_s, r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9])


@inline
def _slip_columns(teeth: Teeth) -> tuple[int, float]:
    """Return the first slip column in the history of a face, and the scale of the slip."""
    return (1, np.sqrt(teeth.shear_stiffness)) if teeth.whole == 1.0 else (0, 1.0)


@inline
def rotated(first: Any, second: Any, cosine: Any, sine: Any) -> tuple[Any, Any]:
    """Return two components of a vector in rotated axes; pass -sine to rotate back."""
    return cosine * first - sine * second, sine * first + cosine * second


@inline
def _rotate_back(a: int, b: int, turn: Any, traction: Floats, tangent: Floats) -> None:
    """Rotate a traction and its tangent in place by the inverse of `rotated`."""
    c, s = turn[0], turn[1]
    traction[a], traction[b] = rotated(traction[a], traction[b], c, -s)
    for k in range(3):
        tangent[k, a], tangent[k, b] = rotated(tangent[k, a], tangent[k, b], c, -s)
    for k in range(3):
        tangent[a, k], tangent[b, k] = rotated(tangent[a, k], tangent[b, k], c, -s)


@inline
def _put_gaps(gap: Floats, plane: Floats, teeth: Teeth, local: Floats) -> None:
    """Write the gap of a point in the axes of its faces to ``local``, shape (3, 3), [m]."""
    across, along = rotated(gap[1], gap[2], teeth.key_cosine, teeth.key_sine)
    for f in range(3):
        normal, local[f, 1] = rotated(gap[0], across, plane[f, 0], plane[f, 1])
        local[f, 0], local[f, 2] = normal + plane[f, 2], along


@inline
def _nearest(f: int, gap: Floats, teeth: Teeth) -> tuple[int, bool]:
    """Return the kind of the nearest face of a tooth, and True if it is in contact."""
    if f == 0:
        return FLAT, True
    sine, offset = (teeth.sine, teeth.forward) if f == 1 else (-teeth.sine, teeth.backward)
    across, _ = rotated(gap[1], gap[2], teeth.key_cosine, teeth.key_sine)
    flank = teeth.cosine * gap[0] - sine * across + offset
    crest = gap[0] - teeth.depth
    return FLAT if crest > flank else FLANK, max(flank, crest) <= 0.0


@inline
def _choose(gap: Floats, history: Floats, teeth: Teeth, faces: Faces) -> float:
    """Set the faces of a point at the start of a step; return their elastic energy [J/m^2]."""
    plane, energy, (first, root) = faces.plane, 0.0, _slip_columns(teeth)
    for f in range(3):
        kind, meets = _nearest(f, gap, teeth)
        sine, offset = (teeth.sine, teeth.forward) if f == 1 else (-teeth.sine, teeth.backward)
        if f > 0 and (offset < 0.0 or history[KEYS] >= BROKEN):
            # The gap to a missing tooth is the depth, regardless of the position of the point.
            kind, meets = ABSENT, False
            plane[f, 0], plane[f, 1], plane[f, 2] = 0.0, 0.0, teeth.depth
        elif kind == FLANK:
            plane[f, 0], plane[f, 1], plane[f, 2] = teeth.cosine, sine, offset
        else:
            plane[f, 0], plane[f, 1] = 1.0, 0.0
            plane[f, 2] = -history[LIFT] if f == 0 else -teeth.depth
        faces.kind[f] = kind
        for a in range(2):
            slip = history[(2 * f + 2 if f > 0 else 0) + a] if meets else 0.0
            faces.history[f, first + a] = root * slip
            energy += 0.5 * teeth.shear_stiffness * slip * slip
    _put_gaps(gap, plane, teeth, faces.gap)
    for f in range(3):
        overlap = min(faces.gap[f, 0], 0.0)
        normal = 0.5 * teeth.normal_stiffness * overlap * overlap
        energy += normal
        if teeth.whole == 1.0:
            faces.history[f, 0] = normal
    if teeth.whole == 1.0:
        for k in range(5):
            faces.history[0, 3 + k] = history[SLIPS + k]
    return energy


@inline
def _shear_off(gap: Floats, history: Floats, teeth: Teeth, faces: Faces, sheared: Floats) -> None:
    """Write the history after the teeth shear off; the largest face pressure acts on the base."""
    k_n, pressed, (first, root) = teeth.normal_stiffness, 0.0, _slip_columns(teeth)
    for f in range(3):
        normal = k_n * min(faces.gap[f, 0], 0.0)
        shear = teeth.shear_stiffness * faces.history[f, first] / root
        t_n, _ = rotated(normal, shear, faces.plane[f, 0], -faces.plane[f, 1])
        # Limit the pressure to the pressure on the face, so that no energy is generated.
        pressed = max(pressed, min(-t_n, -normal))
    for k in range(COLUMNS):
        sheared[k] = 0.0 if KEYS <= k < SLIPS else history[k]
    sheared[KEYS] = BROKEN
    if faces.gap[0, 0] <= 0.0 or pressed > 0.0:
        sheared[LIFT] = gap[0] + pressed / k_n


@inline
def _finish(i: int, history: Floats, teeth: Teeth, start: KeyStart, answer: Answer) -> None:
    """Write the history at the end of a step; faces that lose contact dissipate their energy.

    ``history`` is the history at the start of the step; the faces in ``start`` are overwritten.
    """
    end, ends, (first, root) = answer.history[i], start.ends, _slip_columns(teeth)
    stored, leaves = 0.0, False
    for f in range(3):
        kind, meets = _nearest(f, answer.gap[i], teeth)
        stays, overlap = meets and kind == start.faces.kind[f], min(ends.gap[f, 0], 0.0)
        energy = 0.5 * teeth.normal_stiffness * overlap * overlap
        for a in range(2):
            slip = ends.history[f, first + a] / root
            end[(2 * f + 2 if f > 0 else 0) + a] = slip if stays else 0.0
            energy += 0.5 * teeth.shear_stiffness * slip * slip
        stored += energy
        leaves = leaves or (not stays and energy > 0.0)
    end[KEYS], end[LIFT] = history[KEYS], history[LIFT]
    if teeth.whole == 1.0:
        for k in range(5):
            end[SLIPS + k] = ends.history[0, 3 + k]
    if leaves:
        answer.dissipation[i] += stored - _choose(answer.gap[i], end, teeth, start.faces)


def keyed_loop(face_point: Callable[..., None]) -> Any:
    """Return the compiled loop of shear keys with a friction rule for the faces."""

    @inline
    def point(i: int, start: KeyStart, answer: Answer) -> None:
        """Sum the tractions of the faces (9a); write load / strength of the teeth (9b)."""
        teeth, faces, ends = _teeth_of(start.parameters), start.faces, start.ends
        traction, tangent = answer.traction[i], answer.tangent[i]
        put_zeros(i, answer)
        _put_gaps(answer.gap[i], faces.plane, teeth, ends.gap)
        ratio, sticks = 0.0, False
        friction = Start(faces.gap, faces.history, start.parameters[2:7])
        for f in range(3):
            face_point(f, friction, ends)
            if faces.kind[f] == FLANK:
                _rotate_back(0, 1, faces.plane[f], ends.traction[f], ends.tangent[f])
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
        _rotate_back(1, 2, (teeth.key_cosine, teeth.key_sine), traction, tangent)
        answer.history[i, KEYS] = ratio
        if sticks:
            answer.status[i] = STICK

    solve = solver_of(point)

    @njit(cache=True, error_model="numpy")
    def loop(compliance: Floats, start: Start, answer: Answer) -> None:
        """Solve the points; solve a point with overloaded teeth again without teeth."""
        kind, teeth = answer.gap.dtype, _teeth_of(start.parameters)
        before = np.zeros((3, 10 if teeth.whole == 1.0 else 2), kind)
        gaps, planes, tractions, end_gaps = np.zeros((4, 3, 3), kind)
        ends = Answer(
            tractions, np.zeros((3, 3, 3), kind), end_gaps, np.zeros(before.shape, kind),
            np.zeros(3, kind), np.zeros(3, np.int8),
        )  # fmt: skip
        faces = Faces(np.zeros(3, np.int64), planes, gaps, before)
        key_start = KeyStart(start.gap, start.history, start.parameters, faces, ends)
        search, sheared = search_of(1, kind), np.zeros(COLUMNS, kind)
        for i in range(len(answer.gap)):
            c = compliance[i if len(compliance) > 1 else 0]
            gap, history, end = start.gap[i], start.history[i], answer.gap[i]
            trial_gap = (end[0], end[1], end[2])
            energy = first_energy = _choose(gap, history, teeth, faces)
            while True:
                solve(i, c[0], c[1], key_start, answer, search)
                bond, ratio = history[KEYS], answer.history[i, KEYS]
                if bond != RELEASED and not (bond == INTACT and ratio > 1.0 + OVERLOAD_ROUNDING):
                    break
                _shear_off(gap, history, teeth, faces, sheared)
                history, (end[0], end[1], end[2]) = sheared, trial_gap
                energy = _choose(gap, history, teeth, faces)
            _finish(i, history, teeth, key_start, answer)
            answer.dissipation[i] += first_energy - energy
            if bond < BROKEN:
                answer.history[i, KEYS] = bond_under(bond, ratio)

    return loop


@njit(cache=True, error_model="numpy")
def choose_all(
    start: Start, end: Floats, shears: NDArray[np.bool_], faces: Faces, end_gap: Floats
) -> Floats:
    """Set the faces of all points; return their elastic energy at the start, (n,), [J/m^2].

    Args:
        start: Start of a backward Euler step.
        end: Gap at the end of the step, shape (n, 3), [m].
        shears: True for points whose teeth shear off in the step, shape (n,).
        faces: Faces of the points, without sheared teeth; output.
        end_gap: Gap at the end in the axes of the faces, shape (n, 3, 3), [m]; output.
    """
    teeth, energy = _teeth_of(start.parameters), np.zeros(len(end), end.dtype)
    sheared = np.zeros(COLUMNS, end.dtype)
    for i in range(len(end)):
        point_faces = Faces(faces.kind[i], faces.plane[i], faces.gap[i], faces.history[i])
        energy[i] = _choose(start.gap[i], start.history[i], teeth, point_faces)
        if shears[i]:
            _shear_off(start.gap[i], start.history[i], teeth, point_faces, sheared)
            energy[i] = _choose(start.gap[i], sheared, teeth, point_faces)
        _put_gaps(end[i], point_faces.plane, teeth, end_gap[i])
    return energy
