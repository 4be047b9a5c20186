# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a monitor sees of each step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from dolfinx_joints.laws.law import Response
from dolfinx_joints.solvers.step_solver import SolveReport
from dolfinx_joints.time_integration.energy import EnergyRow


@dataclass(frozen=True, kw_only=True)
class Record:
    """Step as a monitor sees it.

    Attributes:
        stage: ``dynamic``; static stages are not monitored.
        step: Number of the step, 0 for the start of the stage.
        time: Time [s].
        displacement: u [m].
        velocity: v [m/s].
        reaction: Forces of the supports on the body at constrained dofs, zero elsewhere [N].
        joints: Response of the joints, None without joints.
        motion: Acceleration of the ground at a time [s], [m/s^2], None where it rests.
        free_surface: Velocity of the level free surface under the waves of all `FreeField` alone,
            (3,) at a time [s], [m/s]; None without any. Displacements are absolute then.
        solve: How the solve went, None at step 0 of a dynamic stage.
        energy: Energies.
        substeps: Substeps that this step was cut into: 1 for a whole step, 0 at the start.
        wet_joints: Names of the joints with water.
        pressure: Gives the pressure of the water at the local joint points at the time of the
            record, shape (n,), [Pa]; None without water in joints (collective).
        settings: How the stage is run, by name; of the record that monitors start with.
    """

    stage: str
    step: int
    time: float
    displacement: PETSc.Vec
    velocity: PETSc.Vec
    reaction: PETSc.Vec
    joints: Response | None
    motion: Callable[[float], Any] | None
    solve: SolveReport | None
    energy: EnergyRow
    substeps: int
    free_surface: Callable[[float], NDArray[np.float64]] | None = None
    wet_joints: tuple[str, ...] = ()
    pressure: Callable[[], NDArray[np.float64]] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ground_acceleration(self) -> NDArray[np.float64]:
        """Acceleration of the ground at the time of the record, shape (3,), [m/s^2]."""
        ground = np.zeros(3)
        if self.motion is not None:
            known = np.asarray(self.motion(self.time), dtype=np.float64)[:3]
            ground[: len(known)] = known
        return ground
