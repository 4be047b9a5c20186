# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water pressures in joints: loads that depend on the openings (`JointWaters`), and all pressures.

The state of the water is one code per joint point (`Wetness`), which determines all pressures. The
codes are fixed within a static solve. In a time step, codes at its start and end are fixed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats, Ints
from dolfinx_joints.loads.load import Codes, FollowsJoints, Load, LoadedBody
from dolfinx_joints.loads.water.joint_water import Uplift, label, opening_force


@dataclass(frozen=True)
class _End:
    """Water at the start or end of a step: codes of the rank's points, unscaled forces [N]."""

    codes: Codes
    forces: list[PETSc.Vec]


class JointWaters:
    """Loads of a system that depend on the joint openings; ``joints`` names all joints."""

    def __init__(
        self, model: LoadedBody, loads: Mapping[str, FollowsJoints], *, waves: bool = False
    ) -> None:
        """Start with closed joints; with ``waves``, force vectors include water (collective)."""
        joints = [load.joint for load in loads.values()]
        for joint in joints:
            if joints.count(joint) > 1:
                raise ValueError(
                    f"{joints.count(joint)} loads depend on the gap of joint {joint!r}; give one."
                )
        self.names = list(loads)
        self._model, self._waves = model, waves
        self._parts = [load.in_joint(name, model) for name, load in loads.items()]
        self._cache: list[_End] = []
        operator = model.operator
        assert operator is not None
        self.joints, self._operator = operator.names, operator
        self._time_and_scale = (0.0, 1.0)
        self.enter(np.full((len(operator.areas), 3), -np.inf))

    @property
    def codes(self) -> Codes:
        """Wetness of the points of this rank at the end of the step."""
        return self._end.codes

    @property
    def entered(self) -> Codes:
        """Wetness of the points of this rank at the start of the static solve or of the step."""
        return self._entered.codes

    def enter(self, gap: Floats, codes: Codes | None = None) -> Codes:
        """Begin a stage at a gap (n, 3) [m]; by default it determines the codes (collective)."""
        self._start = self._end = self._forces_for(self.by_opening(gap) if codes is None else codes)
        self._entered = self._start
        return self._end.codes

    def by_opening(self, gap: Floats) -> Codes:
        """Return the codes for a gap (n, 3) [m] (collective)."""
        return np.max([part.by_opening(gap) for part in self._parts], axis=0)

    def begin_step(self, codes: Codes, gap: Floats) -> None:
        """Set the water at start and end of a step from the state at its start (collective)."""
        self._start = self._forces_for(codes)
        self._end = self._forces_for(
            np.max([part.in_step(codes, gap) for part in self._parts], axis=0)
        )

    def add(self, out: PETSc.Vec, time: float, scale: float = 1.0) -> None:
        """Add the forces at the end of the step, times ``scale``, [N]."""
        for force in self.by_load(time, scale).values():
            out.axpy(1.0, force)

    def by_load(self, time: float, scale: float) -> dict[str, PETSc.Vec]:
        """Return the forces of each load at the end of the step, times ``scale``, [N]."""
        self._time_and_scale = time, scale
        ends = zip(self._parts, self._end.forces, strict=True)
        return {part.name: scale * part.factor(time) * force for part, force in ends}

    def change(self, codes: Codes, out: PETSc.Vec) -> None:
        """Set new codes, and replace the forces last added to ``out`` (collective)."""
        time, scale = self._time_and_scale
        self.add(out, time, -scale)
        self._start = self._end = self._forces_for(codes)
        self.add(out, time, scale)

    def work(self, x: PETSc.Vec, start: float, end: float) -> dict[str, float]:
        """Return the work of the mean of start and end force of each load (collective)."""
        ends = zip(self._parts, self._start.forces, self._end.forces, strict=True)
        return {
            part.name: 0.5
            * float(part.factor(start) * before.dot(x) + part.factor(end) * after.dot(x))
            for part, before, after in ends
        }

    def toggled(self, codes: Codes, other_codes: Codes) -> Ints:
        """Return the number of points of each joint with different codes (collective)."""
        differ = np.bincount(
            self._operator.joint, codes != other_codes, minlength=len(self._operator.names)
        )
        total = np.sum(self._operator.comm.allgather(differ), axis=0)
        return np.asarray(total).astype(np.int64)

    def _forces_for(self, codes: Codes) -> _End:
        """Return the forces for codes; the last few results are cached (collective)."""
        for cached in self._cache:
            if not self.toggled(codes, cached.codes).any():
                return cached
        forces = [opening_force(self._model, part.pressure(codes)) for part in self._parts]
        if self._waves:
            forces = [self._model.joined(force) for force in forces]
        end = _End(codes.copy(), forces)
        self._cache = [end, *self._cache[:2]]
        return end


def water_in_joints(loads: Iterable[Load]) -> list[Uplift | FollowsJoints]:
    """Return the loads that are pressures in joints."""
    return [load for load in loads if isinstance(load, Uplift | FollowsJoints)]


class WaterPressures:
    """Total water pressure in the joints of a stage."""

    def __init__(self, model: LoadedBody, loads: Sequence[Uplift | FollowsJoints]) -> None:
        """Compute the pressures of each point (collective)."""
        uplifts = [load for load in loads if isinstance(load, Uplift)]
        self._uplifts = [(load.at_points(model), load.factor) for load in uplifts]
        following = [load for load in loads if not isinstance(load, Uplift)]
        self._parts = [load.in_joint(label(load), model) for load in following]
        assert model.operator is not None
        self._size = len(model.operator.areas)

    def by_opening(self, gap: Floats) -> Codes | None:
        """Return the codes for a gap (n, 3) [m]; None if no load depends on them (collective)."""
        codes = [part.by_opening(gap) for part in self._parts]
        return np.max(codes, axis=0) if codes else None

    def __call__(self, time: float, codes: Codes | None) -> Floats:
        """Return the pressure at the joint points of this rank, shape (n,), [Pa].

        The codes are `DynamicState.water`, None if no load depends on the openings.
        """
        total = np.zeros(self._size)
        for pressure, factor in self._uplifts:
            total += float(factor(time)) * pressure
        for part in self._parts:
            assert codes is not None
            total += part.factor(time) * part.pressure(codes)
        return total
