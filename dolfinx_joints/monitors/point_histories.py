# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of monitor points, support reactions and reservoir force: the stream ``histories``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from petsc4py import PETSc

from dolfinx_joints.common.arrays import Floats
from dolfinx_joints.model.model import Model
from dolfinx_joints.monitors.probes import PointProbe
from dolfinx_joints.simulation.record import Record

STATIC_PART = "static_displacement"


class PointHistories:
    """Computes the values of the stream ``histories`` from records."""

    def __init__(self, model: Model, probe: PointProbe) -> None:
        self._model, self._probe = model, probe
        self._supports = (*model.constraints.groups, *model.constraints.points)
        self._before: tuple[float, Floats] | None = None

    def values(self, record: Record, static: PETSc.Vec | None) -> dict[str, Any]:
        """Return values of a record by name; ``static`` is the static part [m] (collective)."""
        values: dict[str, Any] = self._motion(record)
        for group in self._supports:
            values[f"reaction/{group}"] = self._model.resultant(record.reaction, group)
        if record.reservoir_force is not None:
            values["reservoir_force"] = record.reservoir_force
        if static is not None:
            values[STATIC_PART] = self._probe.read(static)
        return values

    def state_dict(self) -> dict[str, Any]:
        """Return time and velocity of the last record, for a restart."""
        assert self._before is not None
        time, velocity = self._before
        return {"time": time, "velocity": velocity}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore time and velocity of the last record from ``state_dict``."""
        self._before = state_dict["time"], state_dict["velocity"]

    def _motion(self, record: Record) -> dict[str, Floats]:
        """Return displacement and acceleration of the points, and the ground motion.

        The acceleration is the mean since the last record: change of velocity divided by time. This
        mean is defined for every scheme and any number of substeps.
        """
        displacement = self._probe.read(record.displacement)
        velocity = self._probe.read(record.velocity)
        acceleration: Floats = np.zeros_like(velocity)
        if self._before is not None:
            time, previous = self._before
            acceleration = np.asarray((velocity - previous) / (record.time - time))
        self._before = record.time, velocity
        ground = {"ground_acceleration": record.ground_acceleration}
        if record.free_surface is not None:
            ground = {"free_surface_velocity": record.free_surface(record.time)}
        return {"displacement": displacement, "acceleration": acceleration, **ground}
