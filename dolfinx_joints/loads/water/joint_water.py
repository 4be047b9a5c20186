# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water in joints: given uplift, and pressures that follow the opening of the joint.

A pressure p pushes both faces apart, so it is the load B^T (w p e_n), positive where gaps open.
Tractions of the joints are then effective ones: total = effective - p.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Flags
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_each, number_at, shown
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.load import Codes, JointLoad, TimeFactor, Vector, always
from dolfinx_joints.loads.loaded_body import LoadedBody
from dolfinx_joints.loads.water.open_paths import OpenPaths
from dolfinx_joints.mesh.cells import Floats

PorePressure = float | Callable[[Floats], Any]

# Negative pressures relative to the largest of the joint that are taken for zero.
ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
@checked
class SeepageLine:
    """Pore pressure under heads that fall along a line, with a drain on the way if there is one.

    The water level falls linearly from ``upstream`` at ``start`` to ``downstream`` at ``end``; with
    a drain linearly to the drain and from there to the end. Before the start and beyond the end it
    is level. Where the level lies below a point there is no pressure.

    Attributes:
        start: Coordinates of the upstream end, (gdim,) [m].
        end: Coordinates of the downstream end, (gdim,) [m].
        upstream: Level at the start, a height along z (y in 2-D) [m].
        downstream: Level at the end [m].
        drain: Share of the way from start to end, and share of the difference of the levels that is
            left there, such as (0.15, 1/3); no drain unless given.
        density: Of the water [kg/m^3].
        gravity: G [m/s^2].
    """

    start: Vector
    end: Vector
    upstream: Annotated[float, at.Unit("m")]
    downstream: Annotated[float, at.Unit("m")]
    drain: tuple[float, float] | None = None
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")] = 1000.0
    gravity: Annotated[float, at.Ge(0), at.Unit("m/s^2")] = STANDARD_GRAVITY

    def __post_init__(self) -> None:
        if len(self.start) != len(self.end) or np.array_equal(self.start, self.end):
            raise ValueError(
                f"SeepageLine: end is {self.end}; it must be another point than start "
                f"{self.start}, with as many coordinates."
            )
        way, left = self.drain or (0.5, 0.5)
        if not (0.0 < way < 1.0 and 0.0 <= left <= 1.0):
            raise ValueError(
                f"SeepageLine: drain is {self.drain}; its share of the way must be inside 0 to 1, "
                "the share that is left from 0 to 1."
            )

    def __call__(self, points: Floats) -> Floats:
        """Pressure at points (n, 3), shape (n,), [Pa]."""
        start, end = np.asarray(self.start, dtype=float), np.asarray(self.end, dtype=float)
        line = end - start
        way = (points[:, : len(line)] - start) @ line / (line @ line)
        drains = [] if self.drain is None else [self.drain]
        at, left = np.transpose([(0.0, 1.0), *drains, (1.0, 0.0)])
        level = self.downstream + (self.upstream - self.downstream) * np.interp(way, at, left)
        depth = np.maximum(level - points[:, len(line) - 1], 0.0)
        return self.density * self.gravity * depth


@dataclass(frozen=True, kw_only=True)
@checked
class Uplift:
    """Given pore pressure in a joint, on both of its faces, whatever the joint does.

    Attributes:
        joint: Name of the joint.
        pressure: Zero or more: a number, or a function of points (n, 3) that gives (n,), such as
            `SeepageLine` [Pa].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    joint: str
    pressure: PorePressure
    factor: TimeFactor = always

    def __post_init__(self) -> None:
        _check_pressure("Uplift: pressure", self.pressure)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Forces that push the faces apart (collective)."""
        return [(opening_force(model, self.at_points(model)), self.factor)]

    def at_points(self, model: LoadedBody) -> Floats:
        """Pressure at the local joint points, shape (n,), [Pa], 0 in other joints (collective)."""
        return given_pressure(model, self, "pressure", joint_points(model, self))


@dataclass(frozen=True, kw_only=True)
@checked
class JointWater:
    """Water of a reservoir in a joint: its full pressure where the joint is open.

    Statics look for openings and pressures that agree. In dynamics, pressures at the end of a step
    are those of the openings at its start; like every load they act with the mean of both ends.

    Attributes:
        joint: Name of the joint.
        level: Height of the water, a coordinate along z (y in 2-D) [m].
        aperture: A point is open where its gap is larger than this [m].
        closed: Pressure where the joint is not open or not reached, like `Uplift.pressure` [Pa].
        reached_from: Name of a facet group; only points that open points connect with it, within
            this joint, bear the full pressure. All open points unless given.
        in_dynamics: ``follows``: by the openings in each step. ``frozen``: as at the start of the
            stage. ``drained``: as at the start, but points that open in the stage bear none while
            they are open.
        density: Of the water [kg/m^3].
        gravity: G [m/s^2].
        factor: Multiplier at a time [s]; 1 unless given.
    """

    joint: str
    level: Annotated[float, at.Unit("m")]
    aperture: Annotated[float, at.Ge(0), at.Unit("m")] = 0.0
    closed: PorePressure = 0.0
    reached_from: str | None = None
    in_dynamics: Literal["follows", "frozen", "drained"] = "follows"
    density: Annotated[float, at.Ge(0), at.Unit("kg/m^3")] = 1000.0
    gravity: Annotated[float, at.Ge(0), at.Unit("m/s^2")] = STANDARD_GRAVITY
    factor: TimeFactor = always

    def __post_init__(self) -> None:
        _check_pressure("JointWater: closed", self.closed)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """None that is fixed."""
        return []

    def in_joint(self, name: str, model: LoadedBody) -> WaterInJoint:
        """Its pressures in a model (collective)."""
        return WaterInJoint(name, self, model)

    def at_points(self, model: LoadedBody, joints: Response) -> Floats:
        """Pressure that openings lead to, ``factor`` left out, shape (n,), [Pa] (collective).

        At the local joint points, zero in other joints. ``joints`` is a response such as
        ``StaticState.joints``; of a dynamic stage only where the water ``follows``.
        """
        water = self.in_joint(label(self), model)
        return water.pressure(water.by_opening(joints.state.gap))


class Wetness(IntEnum):
    """State of the water at a joint point."""

    CLOSED = 0  # the pressure of the closed joint; also points of joints without water
    FULL = 1  # the pressure of the reservoir
    DRAINED = 2  # none


class WaterInJoint:
    """Pressures of a `JointWater`; `JointPressure` says what the methods give."""

    def __init__(self, name: str, load: JointWater, model: LoadedBody) -> None:
        """Find both pressures of each point (collective)."""
        self.name, self._load, self._here = name, load, joint_points(model, load)
        assert model.operator is not None
        depth = np.maximum(load.level - model.operator.points[:, model.gdim - 1], 0.0)
        full = np.where(self._here, load.density * load.gravity * depth, 0.0)
        closed = given_pressure(model, load, "closed", self._here)
        self._pressures = np.stack([closed, full, np.zeros(len(full))])
        self._paths: OpenPaths | None = None
        if load.reached_from is not None:
            self._paths = OpenPaths(model, load.joint, load.reached_from)

    def pressure(self, codes: Codes) -> Floats:
        """Pressure of each point."""
        return np.take_along_axis(self._pressures, codes[None].astype(np.int64), 0)[0]

    def factor(self, time: float) -> float:
        """Multiplier at a time."""
        return number_at(f"{self.name}: factor", self._load.factor, time)

    def by_opening(self, gap: Floats) -> Codes:
        """FULL where open and reached (collective)."""
        wet = self._open(gap)
        if self._paths is not None:
            wet = self._paths.reached(wet)
        return np.where(wet, Wetness.FULL, Wetness.CLOSED).astype(np.int8)

    def in_step(self, codes: Codes, gap: Floats) -> Codes:
        """Codes after a time step, by ``in_dynamics`` (collective)."""
        if self._load.in_dynamics == "follows":
            return self.by_opening(gap)
        own = np.where(self._here, codes, Wetness.CLOSED).astype(np.int8)
        if self._load.in_dynamics == "drained":
            now = np.where(self._open(gap), Wetness.DRAINED, Wetness.CLOSED)
            own = np.where(own == Wetness.FULL, own, now).astype(np.int8)
        return own

    def _open(self, gap: Floats) -> Flags:
        return np.asarray(self._here & (gap[:, 0] > self._load.aperture))


def joint_points(model: LoadedBody, load: JointLoad) -> Flags:
    """Which of the local joint points belong to the joint of a load, shape (n,)."""
    names = () if model.operator is None else model.operator.names
    if model.operator is None or load.joint not in names:
        known = ", ".join(names) or "none"
        raise MeshError(f"{label(load)}: there is no such joint; the joints are: {known}.")
    return np.asarray(model.operator.joint == names.index(load.joint))


def given_pressure(model: LoadedBody, load: JointLoad, what: str, here: Flags) -> Floats:
    """A pressure that is a number or a function, at the points ``here``, zero elsewhere [Pa].

    Collective.
    """
    assert model.operator is not None
    value, places = getattr(load, what), model.operator.points[here]
    name, comm = f"{label(load)}: {what}", model.operator.comm
    with raised_together(comm):
        found = check_each(name, value(places) if callable(value) else value, len(places))
    slack = ROUNDING * max(comm.allgather(float(found.max(initial=0.0))))
    found = np.where((found < 0.0) & (found >= -slack), 0.0, found)
    everywhere = np.zeros(len(here))
    with raised_together(comm):
        everywhere[here] = check_each(name, found, len(places), negative=False)
    return everywhere


def opening_force(model: LoadedBody, pressure: Floats) -> PETSc.Vec:
    """B^T (w p e_n) of pressures p at the local joint points, (n,) [Pa]; [N] (collective)."""
    assert model.operator is not None
    traction = np.zeros((len(pressure), 3))
    traction[:, 0] = pressure
    return model.operator.force(traction, model.mass.createVecRight())


def label(load: JointLoad) -> str:
    """Name of a load in error messages."""
    return f"{type(load).__name__} in {shown(load.joint)}"


def _check_pressure(name: str, value: PorePressure) -> None:
    if isinstance(value, float) and value < 0.0:
        raise ValueError(f"{name} is {value:g} Pa; it must be zero or more.")
