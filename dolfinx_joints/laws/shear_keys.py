# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A joint with shear keys: teeth that block slip across them, are ridden over, and shear off.

    crest                ______
                        /      \          flanks at the angle alpha, depth d
    base   ____________/        \________
            play | play                   across the keys ->

Contact of a point is that with flat faces, each a `FrictionNoTension` in the axes of the face: the
base, and of the tooth on either side one face, flank or crest. With the rows of R_i a face's normal
and its two directions,

    g_i = R_i g + o_i,      t = sum R_i^T t_i(g_i).                                        (9a)

R_i and o_i do not change in a step, so that the work of the faces is that of the joint and answers
over whole steps balance its energy as those of `FrictionNoTension` do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.angle import coefficient_of, cosine_and_sine, set_friction
from dolfinx_joints.laws.friction import FrictionNoTension
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    BORNE,
    BROKEN,
    DISCRETE_GRADIENT,
    HELD,
    INTACT,
    RELEASED,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
    Status,
    bond_under,
    overload,
)
from dolfinx_joints.laws.losses import losses_on, overlap_and_slip, way_with_friction, work
from dolfinx_joints.laws.points.on_compliance import on_compliance

# Faces, in the order of the axes and offsets.
BASE, FORWARD, CREST, BACKWARD = range(4)

# Columns of the internal variables; then the elastic slips on the teeth's faces.
KEYS, LIFT, TEETH = 0, 1, slice(2, 6)


def _summed(values: Floats) -> Floats:
    return np.asarray(values.reshape(-1, 3).sum(axis=1))


class Faces(NamedTuple):
    """What a step of ``n`` points has to do with their three faces.

    Attributes:
        axes: R_i, shape (n, 3, 3, 3).
        before: Gap of the faces at the start and what slip they hold, of 3 n points.
        gap: Gap at the end, shape (3 n, 3), [m].
        kept: Of the teeth, whether the face is that of the end too, shape (n, 2).
    """

    axes: Floats
    before: JointState
    gap: Floats
    kept: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
@checked
class ShearKeyJoint:
    """Friction joint with shear keys, teeth of trapezoidal or triangular section.

    Slip along the keys, and across them within the play, meets the friction of the base. Beyond the
    play a flank closes: slip across rides up, with an opening of slip times tan(alpha) and, under a
    pressure p, a shear of p tan(alpha + phi), phi being the angle of friction. At the depth of the
    teeth the point slides on their crests. A tooth that bears the shear T and the pressure P shears
    off, and all of the point's teeth with it, where

        T > a c + P tan(phi_t),                                                            (9b)

    a being the share of the area at the teeth's bases. From that step on there is friction only, at
    the opening that was reached. Stiffness is per area of the joint on every face. A play below
    overlap / tan(alpha) lets flanks share the pressure of a closed joint: friction along the keys
    then is that of a wedge.

    A face that a point is in contact with is its face for the whole of a step, so that slips of a
    step must be short against the depth. Slip of more than half a spacing meets no next tooth.

    Internal variables: ``broken`` (0 or 1), ``lift`` [m] of the base of teeth sheared off, and the
    elastic slips on the faces of the teeth, up and along, [m].

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.
        friction_angle_deg: phi; exactly one of this and the next is given.
        friction_coefficient: Mu = tan(phi).
        depth: d.
        flank_angle_deg: alpha, between flanks and joint, 90 degrees for rectangular keys.
        spacing: Of the teeth of one side, from middle to middle.
        tooth_width: At the base; as wide as the recesses unless given. a = tooth_width / spacing.
        tooth_cohesion: c of what the teeth are made of.
        tooth_friction_angle_deg: phi_t of the same, phi unless given.
        forward_play: Slip of the + side along (axis_2, -axis_1) before a flank closes; None for no
            flank in this direction.
        backward_play: The same the other way.
        key_axis: Direction of the keys in the joint's axes (s1, s2), of any length; steepest upward
            in joints that are not level, out of the plane in 2-D.

    Raises:
        ValueError: Parameters contradict each other.
    """

    internal_variables: ClassVar[tuple[str, ...]] = (
        "broken",
        "lift",
        "forward_up",
        "forward_along",
        "backward_up",
        "backward_along",
    )
    breaks: ClassVar[bool] = True

    normal_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    shear_stiffness: Annotated[float, at.Gt(0), at.Unit("Pa/m")]
    friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = None
    friction_coefficient: Annotated[float, at.Ge(0)] | None = None
    depth: Annotated[float, at.Gt(0), at.Unit("m")]
    flank_angle_deg: Annotated[float, at.Gt(0), at.Le(90), at.Unit("degrees")]
    spacing: Annotated[float, at.Gt(0), at.Unit("m")]
    tooth_width: Annotated[float, at.Gt(0), at.Unit("m")] | None = None
    tooth_cohesion: Annotated[float, at.Gt(0), at.Unit("Pa")]
    tooth_friction_angle_deg: Annotated[float, at.Ge(0), at.Lt(90), at.Unit("degrees")] | None = (
        None
    )
    forward_play: Annotated[float, at.Ge(0), at.Unit("m")] | None = 0.0
    backward_play: Annotated[float, at.Ge(0), at.Unit("m")] | None = 0.0
    key_axis: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        """Take the friction; check the shape of the teeth."""
        set_friction(self)
        if not math.hypot(*self.key_axis) > 0.0:
            raise ValueError("ShearKeyJoint: key_axis is (0, 0); it must be a direction (s1, s2).")
        flanks = 2.0 * self.depth / math.tan(math.radians(self.flank_angle_deg))
        if flanks + (self.forward_play or 0.0) + (self.backward_play or 0.0) > self.spacing:
            raise ValueError(
                f"ShearKeyJoint: spacing is {self.spacing:g} m; it must be at least two flanks of "
                f"depth / tan(flank_angle_deg) and the plays, {flanks:g} m and more."
            )
        width = self.tooth_width
        if width is not None and not flanks <= width <= self.spacing:
            raise ValueError(
                f"ShearKeyJoint: tooth_width is {width:g} m; it must be from two flanks, "
                f"{flanks:g} m, to spacing, {self.spacing:g} m."
            )

    @property
    def cohesion(self) -> float:
        """Cohesion a c per area of the joint [Pa]."""
        width = self.tooth_width
        if width is None:
            width = 0.5 * self.spacing + self.depth / math.tan(math.radians(self.flank_angle_deg))
        return self.tooth_cohesion * width / self.spacing

    def initial_variables(self, gap: Floats) -> Floats:
        """Internal variables at rest, zeros: the teeth are there and hold no slip.

        Args:
            gap: Gap at rest, shape (n, 3), [m].
        """
        return np.zeros((len(gap), len(self.internal_variables)))

    def closed_stiffness(self) -> tuple[float, float]:
        """k_n and k_s of the base, [Pa/m]."""
        return self.normal_stiffness, self.shear_stiffness

    def stored_energy(self, state: JointState) -> Floats:
        """Elastic energy of the faces that are in contact, shape (n,), [J/m^2]."""
        return _summed(self._friction.stored_energy(self._faces(state.gap, state).before))

    def backward_euler(self, gap: Floats, state: JointState) -> Response:
        """Tractions at the end of a step to a gap of shape (n, 3), [m], with their tangent."""
        return self._or_sheared(BACKWARD_EULER, gap, state)

    def discrete_gradient(self, gap: Floats, state: JointState) -> Response:
        """Tractions over a step that balance the energy; see `FrictionNoTension`."""
        return self._or_sheared(DISCRETE_GRADIENT, gap, state)

    def condensed_backward_euler(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """`backward_euler` at gap = trial_gap - compliance * t; see `CondensedLaw`."""
        return self._or_sheared(BACKWARD_EULER, trial_gap, state, compliance)

    def condensed_discrete_gradient(
        self, trial_gap: Floats, compliance: Floats, state: JointState
    ) -> Response:
        """`discrete_gradient` at gap = trial_gap - compliance * t; see `CondensedLaw`."""
        return self._or_sheared(DISCRETE_GRADIENT, trial_gap, state, compliance)

    @cached_property
    def _friction(self) -> FrictionNoTension:
        return FrictionNoTension(
            normal_stiffness=self.normal_stiffness,
            shear_stiffness=self.shear_stiffness,
            friction_coefficient=coefficient_of(self),
        )

    @cached_property
    def _axes(self) -> Floats:
        """R of each face, shape (4, 3, 3)."""
        c, s = cosine_and_sine(self.flank_angle_deg)
        faces = np.tile(np.eye(3), (4, 1, 1))
        faces[FORWARD, :2, :2] = [[c, -s], [s, c]]
        faces[BACKWARD, :2, :2] = [[c, s], [-s, c]]
        along = np.array(self.key_axis) / math.hypot(*self.key_axis)
        keys = np.eye(3)
        keys[1, 1:], keys[2, 1:] = (along[1], -along[0]), along
        return faces @ keys

    @cached_property
    def _offsets(self) -> Floats:
        """Offset o of each face along its normal, shape (4,), [m]."""
        _, s = cosine_and_sine(self.flank_angle_deg)
        plays = ((self.forward_play or 0.0) * s, (self.backward_play or 0.0) * s)
        return np.array([0.0, plays[0], -self.depth, plays[1]])

    @cached_property
    def _flanks(self) -> tuple[tuple[int, bool], ...]:
        """Flank of either tooth, and whether there is one."""
        return (FORWARD, self.forward_play is not None), (BACKWARD, self.backward_play is not None)

    def _faces(self, gap: Floats, state: JointState) -> Faces:
        """Choose faces at the start of a step; of a tooth that is gone they are far away."""
        axes, count = self._axes, len(gap)
        before = np.einsum("fij,nj->nfi", axes, state.gap)
        after = np.einsum("fij,nj->nfi", axes, gap)
        for local in (before, after):
            local[:, :, 0] += self._offsets
            local[:, BASE, 0] -= state.internal[:, LIFT]
        chosen = np.zeros((count, 3), dtype=np.int64)
        kept = np.zeros((count, 2), dtype=bool)
        held = np.zeros((count, 3, 2), dtype=gap.dtype)
        held[:, 0] = state.elastic_slip
        far = np.zeros((count, 3), dtype=bool)
        for i, (flank, exists) in enumerate(self._flanks, start=1):
            start, end = before[:, [flank, CREST], 0], after[:, [flank, CREST], 0]
            crest = start[:, 1] > start[:, 0]  # the face that a point is nearest to, or beyond
            there = (state.internal[:, KEYS] < BROKEN) & exists
            chosen[:, i], far[:, i] = np.where(crest, CREST, flank), ~there
            kept[:, i - 1] = there & (end <= 0.0).all(axis=1) & ((end[:, 1] > end[:, 0]) == crest)
            inside = there & (start <= 0.0).all(axis=1)
            slip = state.internal[:, 2 * i : 2 * i + 2]
            held[:, i] = np.where(inside[:, None], slip, 0.0)
        rows = np.arange(count)[:, None], chosen
        before, after = before[rows], after[rows]
        before[far] = after[far] = self.depth
        slips = np.zeros((3 * count, 5), dtype=gap.dtype)
        if len(state.slips):
            slips[::3] = state.slips
        at_start = JointState(
            gap=before.reshape(-1, 3), elastic_slip=held.reshape(-1, 2), slips=slips
        )
        return Faces(axes[chosen], at_start, after.reshape(-1, 3), kept)

    def _or_sheared(
        self, rule: Rule, gap: Floats, state: JointState, compliance: Floats | None = None
    ) -> Response:
        """Answer with the teeth, without them where that would be too much for them."""
        answer, ratio = self._solved(rule, gap, state, compliance)
        keys = state.internal[:, KEYS]
        gone, held = ((ratio > 1.0 + BORNE) & (keys == INTACT)) | (keys == RELEASED), keys == HELD
        if gone.any():
            sheared = self._sheared(state, gone)
            answer, _ = self._solved(rule, gap, sheared, compliance)
            released = self.stored_energy(state) - self.stored_energy(sheared)
            answer = replace(answer, dissipation=answer.dissipation + released)
        answer.state.internal[held, KEYS] = bond_under(ratio[held])
        return answer

    def _sheared(self, state: JointState, here: NDArray[np.bool_]) -> JointState:
        """The state without the teeth of some points, whose base bears the larger pressure."""
        faces = self._faces(state.gap, state)
        local = self._tractions(faces.before)
        pressed = -self._in_joint_axes(faces.axes, local)[:, :, 0]
        # No more than a face's own overlap: energy may be lost only.
        pressed = np.minimum(pressed, -local.reshape(-1, 3, 3)[:, :, 0]).max(axis=1)
        closed = (faces.before.gap[::3, 0] <= 0.0) | (pressed > 0.0)
        lift = np.where(closed, state.gap[:, 0] + pressed / self.normal_stiffness, 0.0)
        internal = state.internal.copy()
        internal[here] = 0.0
        internal[here, KEYS], internal[here, LIFT] = BROKEN, lift[here]
        return replace(state, internal=internal)

    def _solved(
        self, rule: Rule, gap: Floats, state: JointState, compliance: Floats | None
    ) -> tuple[Response, Floats]:
        """Answer at a gap, or on a compliance, and the load of the teeth over their strength."""
        if compliance is None:
            return self._answer(rule, gap, state)
        ratio = np.zeros(len(gap))

        def answer(end: Floats) -> Response:
            found, ratio[:] = self._answer(rule, end, state)
            return found

        return on_compliance(answer, state.gap, gap, compliance, self.closed_stiffness()), ratio

    def _answer(self, rule: Rule, gap: Floats, state: JointState) -> tuple[Response, Floats]:
        """The sum over the faces (9a), and the load of the teeth over their strength (9b)."""
        faces = self._faces(gap, state)
        axes, count = faces.axes, len(gap)
        single = getattr(self._friction, rule.name)(faces.gap, faces.before)
        traction = self._in_joint_axes(axes, single.traction)
        tangent = single.tangent.reshape(count, 3, 3, 3)
        across = self._axes[BASE, 1]
        shear, pressure = np.abs(traction[:, 1:] @ across), -traction[:, 1:, 0]
        strength = self.cohesion + self._tooth_friction * pressure
        ratio = overload(shear, strength).max(axis=1)
        ends = single.state.elastic_slip.reshape(count, 3, 2)
        internal = state.internal.astype(gap.dtype)
        internal[:, TEETH] = np.where(faces.kept[:, :, None], ends[:, 1:], 0.0).reshape(count, 4)
        after = JointState(gap=gap.copy(), elastic_slip=ends[:, 0].copy(), internal=internal)
        if rule.name == DISCRETE_GRADIENT.name:
            after = replace(after, slips=single.state.slips[::3])
        status = single.status.reshape(count, 3)
        sticks = (status == Status.STICK).any(axis=1)
        return Response(
            traction=traction.sum(axis=1),
            tangent=np.einsum("nfki,nfkl,nflj->nij", axes, tangent, axes, optimize=True),
            state=after,
            dissipation=_summed(single.dissipation) + self._let_go(faces, single.state, after),
            status=np.where(sticks, np.int8(Status.STICK), status.max(axis=1)),
        ), ratio

    def _let_go(self, faces: Faces, ends: JointState, after: JointState) -> Floats:
        """Energy of faces that are no longer a point's own at the end of a step, shape (n,)."""
        stored = self._friction.stored_energy(ends).reshape(-1, 3)
        leaves = (~faces.kept & (stored[:, 1:] > 0.0)).any(axis=1)
        if not leaves.any():
            return np.zeros_like(stored[:, 0])
        return np.where(leaves, stored.sum(axis=1) - self.stored_energy(after), 0.0)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Losses of an end-point step (30), face by face; what faces let go counts as friction.

        Of a traction that is neither that of the end nor the mean of both ends the faces take as
        much as lies between these; the rest is numerical.
        """
        after = answer.state
        breaks = after.internal[:, KEYS] > before.internal[:, KEYS]
        state = self._sheared(before, breaks) if breaks.any() else before
        faces = self._faces(after.gap, state)
        single = self._friction.backward_euler(faces.gap, faces.before)
        mean = 0.5 * (self._tractions(faces.before) + single.traction)
        ends = self._in_joint_axes(faces.axes, single.traction).sum(axis=1)
        middle = self._in_joint_axes(faces.axes, mean).sum(axis=1)
        above, size = ends - middle, work(ends - middle, ends - middle)
        share = work(traction - middle, above) / np.where(size > 0.0, size, 1.0)
        share = np.clip(np.where(size > 0.0, share, 0.0), 0.0, 1.0)
        acting = mean + np.repeat(share, 3)[:, None] * (single.traction - mean)
        way = way_with_friction(faces.before, single.state)
        friction, numerical, _ = losses_on(way, acting, mean, single.dissipation)
        rest = traction - middle - share[:, None] * above
        released = self.stored_energy(before) - self.stored_energy(state)
        released += self._let_go(faces, single.state, after)
        return Losses(
            friction=_summed(friction) + released,
            numerical=_summed(numerical) + work(rest, after.gap - before.gap),
        )

    @cached_property
    def _tooth_friction(self) -> float:
        """Tan(phi_t)."""
        angle = self.tooth_friction_angle_deg
        return coefficient_of(self) if angle is None else math.tan(math.radians(angle))

    def _tractions(self, held: JointState) -> Floats:
        """Tractions that faces hold in their axes, shape (3 n, 3), [Pa]."""
        k_n, k_s = self.normal_stiffness, self.shear_stiffness
        return np.array([k_n, k_s, k_s]) * overlap_and_slip(held)

    @staticmethod
    def _in_joint_axes(axes: Floats, local: Floats) -> Floats:
        """Vectors of faces (3 n, 3) in the axes of the joint, shape (n, 3, 3)."""
        turned: Floats = np.einsum("nfij,nfi->nfj", axes, local.reshape(-1, 3, 3))
        return turned
