# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of the monitor points, forces of supports and reservoir: the stream ``histories``."""

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
    """The values of a record that go into the stream ``histories``."""

    def __init__(self, model: Model, probe: PointProbe) -> None:
        self._model, self._probe = model, probe
        self._supports = (*model.constraints.groups, *model.constraints.points)
        self._before: tuple[float, Floats] | None = None

    def values(self, record: Record, static: PETSc.Vec | None) -> dict[str, Any]:
        """Values of a record by name, with the static part of its displacement [m] (collective)."""
        found: dict[str, Any] = self._motion(record)
        for group in self._supports:
            found[f"reaction/{group}"] = self._model.resultant(record.reaction, group)
        if record.reservoir_force is not None:
            found["reservoir_force"] = record.reservoir_force
        if static is not None:
            found[STATIC_PART] = self._probe.read(static)
        return found

    def state_dict(self) -> dict[str, Any]:
        """What the next record needs of the last one."""
        assert self._before is not None
        time, velocity = self._before
        return {"time": time, "velocity": velocity}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Go on from what ``state_dict`` gave."""
        self._before = state_dict["time"], state_dict["velocity"]

    def _motion(self, record: Record) -> dict[str, Floats]:
        """Displacement and acceleration of the points, motion of the ground.

        The acceleration is the change of velocity since the last record over the time between: the
        mean of the step, which every scheme knows, however many substeps it was cut into.
        """
        displacement = self._probe.read(record.displacement)
        velocity = self._probe.read(record.velocity)
        acceleration: Floats = np.zeros_like(velocity)
        if self._before is not None:
            time, before = self._before
            acceleration = np.asarray((velocity - before) / (record.time - time))
        self._before = record.time, velocity
        ground = {"ground_acceleration": record.ground_acceleration}
        if record.free_surface is not None:
            ground = {"free_surface_velocity": record.free_surface(record.time)}
        return {"displacement": displacement, "acceleration": acceleration, **ground}
