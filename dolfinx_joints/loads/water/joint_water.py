# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water pressure in joints: prescribed uplift, and pressures that depend on the joint opening.

A pressure p pushes the two faces of a joint apart. Its nodal forces are B^T (w p e_n): B maps
displacements to gaps, w are the areas of the joint points, and e_n = (1, 0, 0) is the normal
direction of a gap. The normal traction of a joint is then effective: total = effective - p.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, Literal

import annotated_types as at
import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Flags, Floats
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.declared import checked
from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_each, number_at, shown
from dolfinx_joints.laws.law import Response
from dolfinx_joints.loads.load import Codes, JointLoad, LoadedBody, TimeFactor, Vector, always
from dolfinx_joints.loads.water.open_paths import OpenPaths

PorePressure = float | Callable[[Floats], Any]

# Negative pressures up to this share of the largest pressure in the joint are set to zero.
ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
@checked
class SeepageLine:
    """Pore pressure for a water level that falls along a line, with or without a drain.

    The level falls linearly from ``upstream`` at ``start`` to ``downstream`` at ``end``; with a
    drain it is linear on both sides of the drain. It is constant before the start and beyond the
    end. The pressure is zero at points above the level.

    Attributes:
        start: Coordinates of the upstream end, (gdim,) [m].
        end: Coordinates of the downstream end, (gdim,) [m].
        upstream: Level at the start, a height along z (y in 2-D) [m].
        downstream: Level at the end [m].
        drain: Distance of the drain from the start, divided by the length of the line, and the
            fraction of the level difference that remains at the drain, such as (0.15, 1/3); no
            drain by default.
        density: Density of the water [kg/m^3].
        gravity: g [m/s^2].
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
                f"{self.start}, with the same number of coordinates."
            )
        place, remaining = self.drain or (0.5, 0.5)
        if not (0.0 < place < 1.0 and 0.0 <= remaining <= 1.0):
            raise ValueError(
                f"SeepageLine: drain is {self.drain}; its position must be between 0 and 1 "
                "(exclusive) and the remaining share from 0 to 1."
            )

    def __call__(self, points: Floats) -> Floats:
        """Return the pressure at points (n, 3), shape (n,), [Pa]."""
        start, end = np.asarray(self.start, dtype=float), np.asarray(self.end, dtype=float)
        line = end - start
        place = (points[:, : len(line)] - start) @ line / (line @ line)
        drains = [] if self.drain is None else [self.drain]
        at, remaining = np.transpose([(0.0, 1.0), *drains, (1.0, 0.0)])
        level = self.downstream + (self.upstream - self.downstream) * np.interp(
            place, at, remaining
        )
        depth = np.maximum(level - points[:, len(line) - 1], 0.0)
        return self.density * self.gravity * depth


@dataclass(frozen=True, kw_only=True)
@checked
class Uplift:
    """Prescribed pore pressure on both faces of a joint, independent of its opening.

    Attributes:
        joint: Name of the joint.
        pressure: Number, at least 0, or function of points (n, 3), such as `SeepageLine` [Pa].
        factor: Function of time [s] that multiplies the pressure; 1 by default.

    Example:
        >>> from mpi4py import MPI
        >>> import dolfinx_joints as dj
        >>> from dolfinx_joints.geometry.two_blocks import two_blocks
        >>> mesh = dj.read_msh(two_blocks("blocks.msh", size=0.5), MPI.COMM_WORLD)
        >>> solid = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
        >>> law = dj.RigidJoint(friction_angle_deg=45.0)
        >>> base = [dj.Fixed(group="base")]
        >>> loads = [dj.Gravity(), dj.Uplift(joint="joint_1", pressure=10e3)]
        >>> model = dj.Model(mesh, material=solid, joints=law, supports=base, loads=loads)
        >>> joints = dj.Simulation(model).statics().joints
        >>> round(dj.JointForces(model)(joints)["joint_1"].normal_force)  # 23536 N - 10 kPa * 1 m^2
        13536
    """

    joint: str
    pressure: PorePressure
    factor: TimeFactor = always

    def __post_init__(self) -> None:
        _check_pressure("Uplift: pressure", self.pressure)

    def patterns(self, model: LoadedBody) -> list[tuple[PETSc.Vec, TimeFactor]]:
        """Return the nodal forces that push the faces apart (collective)."""
        return [(opening_force(model, self.at_points(model)), self.factor)]

    def at_points(self, model: LoadedBody) -> Floats:
        """Return the pressure at the joint points of this rank, shape (n,), [Pa] (collective).

        The pressure is zero in all other joints.
        """
        return given_pressure(model, self, "pressure", joint_points(model, self))


@dataclass(frozen=True, kw_only=True)
@checked
class JointWater:
    """Reservoir water in a joint, with full hydrostatic pressure at open points.

    In statics, openings and pressures are iterated until they agree. In dynamics with ``follows``,
    the openings at the start of a step determine the pressure at its end. During the step the mean
    of the pressures at the start and at the end of the step acts in the joint.

    Attributes:
        joint: Name of the joint.
        level: Height of the water level, a coordinate along z (y in 2-D) [m].
        aperture: Gap above which a point is open [m].
        closed: Pressure at all points without full pressure [Pa], a number or a function as in
            `Uplift.pressure`.
        reached_from: Name of a facet group. If given, only open points that are connected with the
            group by open points have the full pressure; by default all open points.
        in_dynamics: ``follows``: the pressure follows the openings, step by step. ``frozen``: the
            pressure stays as at the start of the stage. ``drained``: like ``frozen``, but the
            pressure is zero at open points that did not have full pressure at the start.
        density: Density of the water [kg/m^3].
        gravity: g [m/s^2].
        factor: Function of time [s] that multiplies the pressure; 1 by default.
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
        """Return no constant force patterns, since the pressure depends on the openings."""
        return []

    def in_joint(self, name: str, model: LoadedBody) -> WaterInJoint:
        """Return the object that computes the pressures in a model's joint (collective)."""
        return WaterInJoint(name, self, model)

    def at_points(self, model: LoadedBody, joints: Response) -> Floats:
        """Return the pressure at the joint points of this rank, shape (n,), [Pa] (collective).

        The openings are those of the response ``joints``, for example `StaticState.joints`. The
        response may be of a dynamic stage only if ``in_dynamics`` is ``follows``. The pressure is
        not multiplied by ``factor``, and is zero in all other joints.
        """
        water = self.in_joint(label(self), model)
        return water.pressure(water.by_opening(joints.state.gap))


class Wetness(IntEnum):
    """State of the water at a joint point."""

    CLOSED = 0  # pressure of a closed point; also the code of points in joints without water
    FULL = 1  # pressure of the reservoir
    DRAINED = 2  # zero pressure


class WaterInJoint:
    """Pressures of a `JointWater` in a model; see `JointPressure` for the methods.

    Codes are the values of `Wetness` at the joint points of this rank, shape (n,).
    """

    def __init__(self, name: str, load: JointWater, model: LoadedBody) -> None:
        """Compute the pressure of each point in the closed and in the full state (collective)."""
        self.name, self._load, self._in_joint = name, load, joint_points(model, load)
        assert model.operator is not None
        depth = np.maximum(load.level - model.operator.points[:, model.gdim - 1], 0.0)
        full = np.where(self._in_joint, load.density * load.gravity * depth, 0.0)
        closed = given_pressure(model, load, "closed", self._in_joint)
        self._pressures = np.stack([closed, full, np.zeros(len(full))])
        self._paths: OpenPaths | None = None
        if load.reached_from is not None:
            self._paths = OpenPaths(model, load.joint, load.reached_from)

    def pressure(self, codes: Codes) -> Floats:
        """Return the pressure of each point [Pa] for its code."""
        return np.take_along_axis(self._pressures, codes[None].astype(np.int64), 0)[0]

    def factor(self, time: float) -> float:
        """Return the multiplier at a time."""
        return number_at(f"{self.name}: factor", self._load.factor, time)

    def by_opening(self, gap: Floats) -> Codes:
        """Return the codes: FULL at open points that water reaches, else CLOSED (collective)."""
        is_full = self._open(gap)
        if self._paths is not None:
            is_full = self._paths.reached(is_full)
        return np.where(is_full, Wetness.FULL, Wetness.CLOSED).astype(np.int8)

    def in_step(self, codes: Codes, gap: Floats) -> Codes:
        """Return the codes after a time step, according to ``in_dynamics`` (collective)."""
        if self._load.in_dynamics == "follows":
            return self.by_opening(gap)
        new_codes = np.where(self._in_joint, codes, Wetness.CLOSED).astype(np.int8)
        if self._load.in_dynamics == "drained":
            drained = np.where(self._open(gap), Wetness.DRAINED, Wetness.CLOSED)
            new_codes = np.where(new_codes == Wetness.FULL, new_codes, drained).astype(np.int8)
        return new_codes

    def _open(self, gap: Floats) -> Flags:
        return np.asarray(self._in_joint & (gap[:, 0] > self._load.aperture))


def joint_points(model: LoadedBody, load: JointLoad) -> Flags:
    """Return True for the joint points of this rank in the joint of a load, shape (n,)."""
    names = () if model.operator is None else model.operator.names
    if model.operator is None or load.joint not in names:
        joints = ", ".join(names) or "none"
        raise MeshError(f"{label(load)}: this joint does not exist; the joints are: {joints}.")
    return np.asarray(model.operator.joint == names.index(load.joint))


def given_pressure(model: LoadedBody, load: JointLoad, attribute: str, in_joint: Flags) -> Floats:
    """Evaluate the attribute of a load that is a pressure at the joint points (collective).

    The result is zero at points of other joints, shape (n,), [Pa].
    """
    assert model.operator is not None
    value, points = getattr(load, attribute), model.operator.points[in_joint]
    name, comm = f"{label(load)}: {attribute}", model.operator.comm
    with raised_together(comm):
        pressure = check_each(name, value(points) if callable(value) else value, len(points))
    slack = ROUNDING * max(comm.allgather(float(pressure.max(initial=0.0))))
    pressure = np.where((pressure < 0.0) & (pressure >= -slack), 0.0, pressure)
    all_pressures = np.zeros(len(in_joint))
    with raised_together(comm):
        all_pressures[in_joint] = check_each(name, pressure, len(points), negative=False)
    return all_pressures


def opening_force(model: LoadedBody, pressure: Floats) -> PETSc.Vec:
    """Return the nodal forces B^T (w p e_n) [N] of pressures p, shape (n,), [Pa] (collective)."""
    assert model.operator is not None
    traction = np.zeros((len(pressure), 3))
    traction[:, 0] = pressure
    return model.operator.force(traction, model.mass.createVecRight())


def label(load: JointLoad) -> str:
    """Return the name of a load for error messages."""
    return f"{type(load).__name__} in {shown(load.joint)}"


def _check_pressure(name: str, value: PorePressure) -> None:
    if isinstance(value, float) and value < 0.0:
        raise ValueError(f"{name} is {value:g} Pa; it must be zero or more.")
