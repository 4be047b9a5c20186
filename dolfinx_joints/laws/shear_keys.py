# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Joint with shear keys: the teeth block slip, the joint rides up on them, and they shear off.

    crest                ______
                        /      \          flanks at the angle alpha, depth d
    base   ____________/        \________
            play | play                   across the keys ->

A point is in contact with the base and, on each side, with the flank or crest of a tooth.
`key_faces` computes the sum of their tractions (9a).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.declared import checked
from dolfinx_joints.laws.friction import (
    POINTS,
    FrictionNoTension,
    coefficient_of,
    cosine_and_sine,
    set_friction,
)
from dolfinx_joints.laws.law import (
    BACKWARD_EULER,
    BROKEN,
    DISCRETE_GRADIENT,
    Floats,
    JointState,
    Losses,
    Response,
    Rule,
)
from dolfinx_joints.laws.losses import friction_gap_change, losses_on, overlap_and_slip, work
from dolfinx_joints.laws.points.compiled_law import EnergyConsistentContact
from dolfinx_joints.laws.points.key_faces import (
    COLUMNS,
    KEYS,
    SLIPS,
    Faces,
    Teeth,
    choose_all,
    keyed_loop,
    rotated,
)
from dolfinx_joints.laws.points.return_mapping import Answer, Coulomb, Start, response_of


@dataclass(frozen=True, kw_only=True)
@checked
class ShearKeyJoint(EnergyConsistentContact):
    """Friction joint with shear keys, teeth of trapezoidal or triangular section.

    Friction on the base resists slip along the keys, and slip across the keys within the play.
    Beyond the play a flank closes and the joint rides up on the flank. The joint then opens by slip
    times tan(alpha), and its shear is p tan(alpha + phi) under a pressure p, with the friction
    angle phi. At the depth of the teeth the point slides on the crests. All teeth of a point shear
    off if the shear T and the pressure P on one tooth satisfy

        T > a c + P tan(phi_t),                                                            (9b)

    where a is the area ratio of the tooth bases. Afterwards only friction acts, at the opening at
    that moment. On each face the stiffness is per area of the joint. If the play is below
    overlap / tan(alpha), the flanks share the pressure of a closed joint; friction along the keys
    then acts as on a wedge.

    The faces in contact do not change within a step, so the slip of a step must be small compared
    with the depth. Contact with the next tooth, after a slip above half a spacing, is not modelled.

    Internal variables: ``broken`` (0 or 1), ``lift`` [m] of the base after the teeth sheared off,
    and the elastic slips on the faces of the teeth, upward and along the keys, [m].

    Attributes:
        normal_stiffness: k_n.
        shear_stiffness: k_s.
        friction_angle_deg: phi; give either this or `friction_coefficient`.
        friction_coefficient: Mu = tan(phi).
        depth: d.
        flank_angle_deg: alpha, between flanks and joint, 90 degrees for rectangular keys.
        spacing: Distance of the tooth axes on one side.
        tooth_width: Width of a tooth at the base (default: width of the recesses), spacing times a.
        tooth_cohesion: c, cohesion of the tooth material.
        tooth_friction_angle_deg: phi_t of the tooth material (default: phi).
        forward_play: Slip of the + side along (axis_2, -axis_1) before a flank closes; None for no
            flank in this direction.
        backward_play: Slip in the opposite direction before a flank closes, or None.
        key_axis: Direction of the keys in the joint's axes (s1, s2), of any length. The default is
            the steepest direction in joints that are not level; in 2-D the out-of-plane direction.

    Raises:
        ValueError: Parameters contradict each other.
    """

    loops: ClassVar[Mapping[str, Any]] = {name: keyed_loop(point) for name, point in POINTS.items()}
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
        """Set friction angle and coefficient; check the shape of the teeth."""
        set_friction(self)
        if not math.hypot(*self.key_axis) > 0.0:
            raise ValueError("ShearKeyJoint: key_axis is (0, 0); it must be a direction (s1, s2).")
        flanks = 2.0 * self.depth / math.tan(math.radians(self.flank_angle_deg))
        if flanks + (self.forward_play or 0.0) + (self.backward_play or 0.0) > self.spacing:
            raise ValueError(
                f"ShearKeyJoint: spacing is {self.spacing:g} m; it must be at least the width "
                f"of two flanks, 2 depth / tan(flank_angle_deg) = {flanks:g} m, plus the plays."
            )
        width = self.tooth_width
        if width is not None and not flanks <= width <= self.spacing:
            raise ValueError(
                f"ShearKeyJoint: tooth_width is {width:g} m; it must be between the width "
                f"of two flanks, {flanks:g} m, and the spacing, {self.spacing:g} m."
            )

    @property
    def cohesion(self) -> float:
        """Cohesion a c per area of the joint [Pa]."""
        width = self.tooth_width
        if width is None:
            width = 0.5 * self.spacing + self.depth / math.tan(math.radians(self.flank_angle_deg))
        return self.tooth_cohesion * width / self.spacing

    def initial_variables(self, gap: Floats) -> Floats:
        """Return zeros, the values at rest: intact teeth without elastic slip.

        Args:
            gap: Gap at rest, shape (n, 3), [m].
        """
        return np.zeros((len(gap), len(self.internal_variables)))

    def stored_energy(self, state: JointState) -> Floats:
        """Return the elastic energy of the faces in contact, shape (n,), [J/m^2]."""
        return self._faces(state, state.gap, np.zeros(len(state.gap), dtype=np.bool_))[2]

    def loop_start(self, rule: Rule, state: JointState) -> Start:
        """Return elastic slip, internal variables, plastic slips and parameters at the start."""
        k_n, k_s = self.normal_stiffness, self.shear_stiffness
        friction = Coulomb(1.0 / k_n, 1.0 / k_s, k_n / k_s, coefficient_of(self))
        whole = float(rule.name == DISCRETE_GRADIENT.name)
        row = (k_n, k_s, *friction, *self._teeth._replace(whole=whole)[2:])
        history = np.zeros((len(state.gap), COLUMNS), state.gap.dtype)
        history[:, :KEYS], history[:, KEYS:SLIPS] = state.elastic_slip, state.internal
        if len(state.slips):
            history[:, SLIPS:] = state.slips
        return Start(state.gap, history, np.array(row))

    def loop_response(self, rule: Rule, answer: Answer, state: JointState) -> Response:
        """Return the response with elastic slip, internal variables and plastic slips."""
        slip, internal, slips = np.split(answer.history, [KEYS, SLIPS], axis=1)
        if rule.name == BACKWARD_EULER.name:
            slips = slips[:0]
        return response_of(answer, elastic_slip=slip, internal=internal, slips=slips)

    def losses(self, before: JointState, answer: Response, traction: Floats) -> Losses:
        """Return the losses (30) of a backward Euler step, summed over the faces.

        The energy of faces that lose contact counts as friction. The faces share only the component
        of the traction between the mean of both ends and the end of the step. The work of the
        remainder is numerical.
        """
        after = answer.state
        shears = (after.internal[:, 0] == BROKEN) & (before.internal[:, 0] < BROKEN)
        faces, end_gap, _ = self._faces(before, after.gap, shears)
        start = JointState(gap=faces.gap.reshape(-1, 3), elastic_slip=faces.history.reshape(-1, 2))
        single = self._friction.backward_euler(end_gap.reshape(-1, 3), start)
        k = np.array([self.normal_stiffness, self.shear_stiffness, self.shear_stiffness])
        mean = 0.5 * (k * overlap_and_slip(start) + single.traction)
        ends, middle = (self._sum(faces, local) for local in (single.traction, mean))
        span, size = ends - middle, work(ends - middle, ends - middle)
        share = work(traction - middle, span) / np.where(size > 0.0, size, 1.0)
        share = np.clip(np.where(size > 0.0, share, 0.0), 0.0, 1.0)
        acting = mean + np.repeat(share, 3)[:, None] * (single.traction - mean)
        change = friction_gap_change(start, single.state)
        lost = losses_on(change, acting, mean, np.zeros(len(mean)))
        remainder = traction - middle - share[:, None] * span
        return Losses(
            friction=answer.dissipation + lost.friction.reshape(-1, 3).sum(axis=1),
            numerical=lost.numerical.reshape(-1, 3).sum(axis=1)
            + work(remainder, after.gap - before.gap),
        )

    @cached_property
    def _friction(self) -> FrictionNoTension:
        return FrictionNoTension(
            normal_stiffness=self.normal_stiffness,
            shear_stiffness=self.shear_stiffness,
            friction_coefficient=coefficient_of(self),
        )

    @cached_property
    def _teeth(self) -> Teeth:
        length, angle = math.hypot(*self.key_axis), self.tooth_friction_angle_deg
        cosine, sine = cosine_and_sine(self.flank_angle_deg)
        return Teeth(
            normal_stiffness=self.normal_stiffness,
            shear_stiffness=self.shear_stiffness,
            cosine=cosine,
            sine=sine,
            key_cosine=self.key_axis[1] / length,
            key_sine=self.key_axis[0] / length,
            depth=self.depth,
            forward=-1.0 if self.forward_play is None else self.forward_play * sine,
            backward=-1.0 if self.backward_play is None else self.backward_play * sine,
            cohesion=self.cohesion,
            friction=coefficient_of(self) if angle is None else math.tan(math.radians(angle)),
            whole=0.0,
        )

    def _faces(
        self, state: JointState, end: Floats, shears: NDArray[np.bool_]
    ) -> tuple[Faces, Floats, Floats]:
        """Return the faces of a step, their end gaps and their elastic energy (`choose_all`)."""
        kinds = np.zeros((len(end), 3), dtype=np.int64)
        plane, gap, end_gap = np.zeros((3, len(end), 3, 3), end.dtype)
        faces = Faces(kinds, plane, gap, np.zeros((len(end), 3, 2), end.dtype))
        loop = choose_all if end.dtype == np.float64 else choose_all.py_func
        energy = loop(self.loop_start(BACKWARD_EULER, state), end, shears, faces, end_gap)
        return faces, end_gap, energy

    def _sum(self, faces: Faces, local: Floats) -> Floats:
        """Return the sum over the faces of vectors (3 n, 3) in face axes, shape (n, 3)."""
        normal, across, along = np.moveaxis(local.reshape(-1, 3, 3), 2, 0)
        normal, across = rotated(normal, across, faces.plane[:, :, 0], -faces.plane[:, :, 1])
        teeth, sums = self._teeth, [part.sum(axis=1) for part in (normal, across, along)]
        return np.column_stack([sums[0], *rotated(*sums[1:], teeth.key_cosine, -teeth.key_sine)])
