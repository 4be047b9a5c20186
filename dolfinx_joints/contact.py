# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with their laws: from displacements to tractions, tangents and stored energy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.checks import check_kind_of
from dolfinx_joints.errors import MeshError
from dolfinx_joints.joints import GapOperator
from dolfinx_joints.laws import Floats, JointState, Law, Response, Status
from dolfinx_joints.parallel import raised_together

InitialGap = float | Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True)
class StatusCounts:
    """Joint points by what they do, on all ranks."""

    open: int
    stick: int
    slip: int

    @property
    def total(self) -> int:
        """All points."""
        return self.open + self.stick + self.slip


class Contact:
    """The joints of a system: a gap operator, and a law for the points of each joint.

    Args:
        operator: The gap operator.
        laws: One law for all joints, or one per joint name.
        initial_gaps: Initial normal gap of each joint named, [m]: a number, or a function of the
            point coordinates (n, 3) that gives (n,); added to a gap in the mesh itself.

    Attributes:
        operator: The gap operator.
        initial_gap: Gap before any displacement, in the mesh and given, shape (n, 3), [m].

    Raises:
        MeshError: A name stands for no joint, or a joint has no law.
    """

    def __init__(
        self,
        operator: GapOperator,
        laws: Law | Mapping[str, Law],
        initial_gaps: Mapping[str, InitialGap] | None = None,
    ) -> None:
        """Sort the points by law."""
        self.operator = operator
        gaps = initial_gaps or {}
        check_kind_of("initial_gaps", gaps, isinstance(gaps, Mapping), "a gap per joint name")
        by_name = laws if isinstance(laws, Mapping) else dict.fromkeys(operator.names, laws)
        for name in (*by_name, *gaps):
            if name not in operator.names:
                known = ", ".join(operator.names) or "none"
                raise MeshError(f"There is no joint {name!r}; the joints are: {known}.")
        for law in by_name.values():
            check_kind_of("A joint law", law, hasattr(law, "end_point"), "a law")
        missing = [name for name in operator.names if name not in by_name]
        if missing:
            raise MeshError(f"The joint {missing[0]!r} has no law.")
        self._laws: list[tuple[Law, NDArray[np.int64]]] = []
        distinct: list[Law] = []
        for law in by_name.values():
            if not any(law is other for other in distinct):
                distinct.append(law)
        for law in distinct:
            members = [i for i, name in enumerate(operator.names) if by_name[name] is law]
            self._laws.append((law, np.flatnonzero(np.isin(operator.joint, members))))
        self._variables = max((_variables(law) for law in distinct), default=0)
        self.initial_gap: Floats = operator.initial_gap.copy()
        for name, gap in gaps.items():
            here = operator.joint == operator.names.index(name)
            places = getattr(operator, "points", np.zeros((len(here), 3)))[here]
            with raised_together(operator.comm):
                self.initial_gap[here, 0] += _checked_gap(name, gap, places)

    def gap(self, u: Any) -> Floats:
        """Gap with the initial gap included, shape (n, 3), [m] (collective)."""
        return self.operator.gap(u) + self.initial_gap

    def at_rest(self, u: Any) -> JointState:
        """State without shear traction at the displacement ``u`` (collective)."""
        return JointState.at_rest(self.gap(u), variables=self._variables)

    def trial(self, u: Any, state: JointState) -> Response:
        """Answer of the laws at the displacement ``u``, from ``state`` (collective)."""
        gap = self.gap(u)
        with raised_together(self.operator.comm):
            return self._end_point(gap, state)

    def _end_point(self, gap: Floats, state: JointState) -> Response:
        """Answer of the laws of the local points."""
        if len(self._laws) == 1:
            return self._laws[0][0].end_point(gap, state)
        answer = _empty_response(len(gap), self._variables)
        for law, points in self._laws:
            part = law.end_point(gap[points], _state_of(law, points, state))
            for name in ("traction", "tangent", "dissipation", "status"):
                getattr(answer, name)[points] = getattr(part, name)
            answer.state.gap[points] = part.state.gap
            answer.state.elastic_slip[points] = part.state.elastic_slip
            if columns := _variables(law):
                answer.state.internal[points, :columns] = part.state.internal
        return answer

    @property
    def solves_locally(self) -> bool:
        """Whether every law offers ``local_solve``."""
        return not self.without_local_solve

    @property
    def without_local_solve(self) -> tuple[str, ...]:
        """Kinds of the laws that offer no ``local_solve``."""
        kinds = {type(law).__name__ for law, _ in self._laws if not hasattr(law, "local_solve")}
        return tuple(sorted(kinds))

    def local_solve(
        self, free_gap: Floats, compliance: Floats, state: JointState
    ) -> tuple[Floats, Floats, NDArray[np.int8]]:
        """Tractions, tangent and status of the local points, each on its own compliance.

        Args:
            free_gap: Gap if the point carried no traction, shape (n, 3), [m].
            compliance: Normal and tangential compliance of the structure, shape (n, 2), [m/Pa].
            state: State at the start of the step.
        """
        with raised_together(self.operator.comm):
            return self._local_solve(free_gap, compliance, state)

    def _local_solve(
        self, free_gap: Floats, compliance: Floats, state: JointState
    ) -> tuple[Floats, Floats, NDArray[np.int8]]:
        """What `local_solve` gives, without waiting for other ranks."""
        if len(self._laws) == 1:
            return self._laws[0][0].local_solve(  # type: ignore[attr-defined]
                free_gap, compliance, state
            )
        count = len(free_gap)
        answer: tuple[NDArray[Any], ...] = (
            np.zeros((count, 3)),
            np.zeros((count, 3, 3)),
            np.zeros(count, dtype=np.int8),
        )
        for law, points in self._laws:
            part = law.local_solve(  # type: ignore[attr-defined]
                free_gap[points],
                compliance[points],
                _state_of(law, points, state),
            )
            for whole, values in zip(answer, part, strict=True):
                whole[points] = values
        traction, tangent, status = answer
        return traction, tangent, status

    def stored_energy(self, state: JointState) -> float:
        """Elastic energy of all joints, [J] (collective)."""
        density = np.empty(len(state.gap))
        for law, points in self._laws:
            density[points] = law.stored_energy(_state_of(law, points, state))
        return self.integral(density)

    def integral(self, density: Floats) -> float:
        """Sum of area times a value per point over all ranks (collective)."""
        return float(self.operator.comm.allreduce(float(self.operator.areas @ density)))

    def closed_tangent(self) -> Floats:
        """Tangent of every point while closed and sticking, shape (n, 3, 3), [Pa/m]."""
        tangent = np.zeros((len(self.operator.areas), 3, 3))
        for law, points in self._laws:
            k_n, k_s = law.closed_stiffness()
            tangent[points] = np.diag([k_n, k_s, k_s])
        return tangent

    def counts(self, status: NDArray[np.int8]) -> StatusCounts:
        """Open, sticking and sliding points on all ranks (collective)."""
        local = np.bincount(status, minlength=len(Status))
        total = np.sum(self.operator.comm.allgather(local), axis=0)
        return StatusCounts(
            open=int(total[Status.OPEN]),
            stick=int(total[Status.STICK]),
            slip=int(total[Status.SLIP]),
        )

    def worst_joint(self, change: NDArray[Any]) -> str | None:
        """Name of the joint with the largest sum of a value per point (collective)."""
        sums = np.bincount(self.operator.joint, change, minlength=len(self.operator.names))
        total = np.sum(self.operator.comm.allgather(sums), axis=0)
        return self.operator.names[int(np.argmax(total))] if total.any() else None


def _checked_gap(name: str, gap: InitialGap, places: Floats) -> Floats:
    """Values of an initial gap at the points of a joint."""
    values = np.asarray(gap(places) if callable(gap) else gap)
    if values.dtype.kind not in "if" or not np.all(np.isfinite(values)):
        raise ValueError(f"The initial gap of {name!r} must be finite, in m; it is {gap!r}.")
    if values.shape not in ((), (len(places),)):
        raise ValueError(
            f"The initial gap of {name!r} has shape {values.shape}; for {len(places)} points it "
            f"must be a number or have shape ({len(places)},)."
        )
    return np.broadcast_to(values, len(places)).astype(np.float64)


def _variables(law: Law) -> int:
    """Number of internal variables of a law."""
    return len(getattr(law, "internal_variables", ()))


def _state_of(law: Law, points: NDArray[np.int64], state: JointState) -> JointState:
    """The state of the points of one law."""
    part = JointState(gap=state.gap[points], elastic_slip=state.elastic_slip[points], dt=state.dt)
    columns = _variables(law)
    return replace(part, internal=state.internal[points, :columns]) if columns else part


def _empty_response(count: int, variables: int) -> Response:
    return Response(
        traction=np.zeros((count, 3)),
        tangent=np.zeros((count, 3, 3)),
        state=JointState.at_rest(np.zeros((count, 3)), variables=variables),
        dissipation=np.zeros(count),
        status=np.zeros(count, dtype=np.int8),
    )
