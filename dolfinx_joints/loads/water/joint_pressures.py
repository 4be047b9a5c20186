# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Water pressures at joint points, given or by the opening, and the forces they make."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.common.mpi import raised_together
from dolfinx_joints.common.parameters import check_each, number_at, shown

if TYPE_CHECKING:
    from petsc4py import PETSc

    from dolfinx_joints.loads.water.joint_water import JointWater, Uplift
    from dolfinx_joints.loads.water.open_paths import OpenPaths
    from dolfinx_joints.model.model import Model

Floats = NDArray[np.float64]
Codes = NDArray[np.int8]


class Wetness(IntEnum):
    """What the water does at a joint point."""

    CLOSED = 0  # the pressure of the closed joint; also points of joints without water
    FULL = 1  # the pressure of the reservoir
    DRAINED = 2  # none


class WaterInJoint:
    """One `JointWater` at the local joint points.

    Args:
        name: Name of the load.
        load: The load.
        model: The model.

    Attributes:
        name: Name of the load.
        load: The load.
        here: Points of its joint, shape (n,).
    """

    def __init__(self, name: str, load: JointWater, model: Model) -> None:
        """Find both pressures of each point (collective)."""
        self.name, self.load, self.here = name, load, joint_points(model, load)
        assert model.operator is not None
        depth = np.maximum(load.level - model.operator.points[:, model.gdim - 1], 0.0)
        full = np.where(self.here, load.density * load.gravity * depth, 0.0)
        closed = given_pressure(model, load, "closed", self.here)
        self._pressures = np.stack([closed, full, np.zeros(len(full))])
        self._paths: OpenPaths | None = None
        if load.reached_from is not None:
            from dolfinx_joints.loads.water.open_paths import OpenPaths

            self._paths = OpenPaths(model, load.joint, load.reached_from)

    def pressure(self, codes: Codes) -> Floats:
        """Pressure at the local points, zero in other joints, shape (n,), [Pa]."""
        pressure: Floats = np.take_along_axis(self._pressures, codes[None].astype(np.int64), 0)[0]
        return pressure

    def factor(self, time: float) -> float:
        """Multiplier of the pressures at a time [s]."""
        return number_at(f"{self.name}: factor", self.load.factor, time)

    def by_opening(self, gap: Floats) -> Codes:
        """What a gap (n, 3) [m] leads to, CLOSED in other joints (collective)."""
        wet = self._open(gap)
        if self._paths is not None:
            wet = self._paths.reached(wet)
        return np.where(wet, Wetness.FULL, Wetness.CLOSED).astype(np.int8)

    def in_step(self, codes: Codes, gap: Floats) -> Codes:
        """What a time step from a state leads to, CLOSED in other joints (collective)."""
        if self.load.in_dynamics == "follows":
            return self.by_opening(gap)
        own = np.where(self.here, codes, Wetness.CLOSED).astype(np.int8)
        if self.load.in_dynamics == "drained":
            now = np.where(self._open(gap), Wetness.DRAINED, Wetness.CLOSED)
            own = np.where(own == Wetness.FULL, own, now).astype(np.int8)
        return own

    def _open(self, gap: Floats) -> NDArray[np.bool_]:
        return np.asarray(self.here & (gap[:, 0] > self.load.aperture))


def joint_points(model: Model, load: Uplift | JointWater) -> NDArray[np.bool_]:
    """Which of the local joint points belong to the joint of a load, shape (n,).

    Raises:
        MeshError: There is no such joint.
    """
    names = () if model.operator is None else model.operator.names
    if model.operator is None or load.joint not in names:
        known = ", ".join(names) or "none"
        raise MeshError(f"{label(load)}: there is no such joint; the joints are: {known}.")
    return np.asarray(model.operator.joint == names.index(load.joint))


def given_pressure(
    model: Model, load: Uplift | JointWater, what: str, here: NDArray[np.bool_]
) -> Floats:
    """A pressure that is a number or a function, at the points ``here``, zero elsewhere [Pa].

    Collective.

    Raises:
        ValueError: The function gives something else than one pressure per point.
    """
    assert model.operator is not None
    value, places = getattr(load, what), model.operator.points[here]
    everywhere = np.zeros(len(here))
    with raised_together(model.operator.comm):
        found = value(places) if callable(value) else value
        name = f"{label(load)}: {what}"
        everywhere[here] = check_each(name, found, len(places), negative=False)
    return everywhere


def opening_force(model: Model, pressure: Floats) -> PETSc.Vec:
    """B^T (w p e_n), [N] (collective).

    Args:
        model: The model.
        pressure: P at the local joint points, shape (n,), [Pa].
    """
    assert model.operator is not None
    traction = np.zeros((len(pressure), 3))
    traction[:, 0] = pressure
    return model.operator.force(traction, model.mass.createVecRight())


def label(load: Uplift | JointWater) -> str:
    """What messages call a load."""
    return f"{type(load).__name__} in {shown(load.joint)}"
