# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass on a spring with friction on a plane.

A mass of 1 kg on a spring of 1e4 N/m is pressed onto a plane with 10 N and friction coefficient
0.1. It is released 0.85 mm from the unstressed position of the spring. Each half cycle reduces the
amplitude by 0.2 mm; at the fourth turning point the mass stays at rest. The turning points printed
in code_aster's test and the energy lost are compared. Our mass is an elastic block of 0.1 m on a
joint of 1e9 Pa/m, and the spring acts on its side. A period has 200 steps.
"""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record
from validation.atlas import Outcome, Row, estimate, new_figure
from validation.grids import line, quads

SOURCE = "code_aster's test SDND100 (V5.01.100), exact values printed there"

SIDE, MASS, SPRING, PRESS, FRICTION, START = 0.1, 1.0, 1e4, 10.0, 0.1, 0.85e-3
STEPS = 0.002  # relative error, twice the change by halving the steps
TURNS = (-0.65, 0.45, -0.25, 0.05)  # displacement after each half period [mm]


class _Block(Monitor):
    """Monitor of the block's displacement along x at all steps."""

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Find a node."""
        self._node = int(model.nodes("top")[0])
        self.rows: list[tuple[float, float]] = []
        self.record(first)

    def record(self, record: Record) -> None:
        """Store the step."""
        u = record.displacement.getArray(readonly=True).reshape(-1, 2)
        self.rows.append((record.time, float(u[self._node, 0])))


def model() -> dj.Model:
    """Return a block on a fixed plate."""
    grid = np.arange(9).reshape(3, 3)
    y, x = np.indices(grid.shape)
    jointed = dj.mesh_from_arrays(
        MPI.COMM_SELF,
        cell="quadrilateral",
        x=SIDE * np.column_stack([x.ravel() / 2.0, y.ravel() - 1.0]),
        cells=quads(grid),
        facet_groups={
            "plate": line(grid[0]),
            "joint_1": line(grid[1]),
            "top": line(grid[2]),
            "side": line(grid[1:, 2]),
        },
    )
    return dj.Model(
        jointed,
        material=dj.Elastic(young=1e10, poisson=0.0, density=MASS / SIDE**2),
        joints=dj.FrictionNoTension(
            normal_stiffness=1e9,
            shear_stiffness=1e9,
            friction_angle_deg=math.degrees(math.atan(FRICTION)),
        ),
        supports=[
            dj.Fixed(group="plate"),
            dj.Fixed(group="joint_1-"),
            dj.Spring(group="side", normal_stiffness=SPRING / SIDE),
        ],
        loads=[dj.Pressure(group="top", value=PRESS / SIDE)],
    )


def run(quick: bool) -> Outcome:
    """Release the mass; ``quick`` has steps twice as long."""
    body, watch = model(), _Block()
    simulation = dj.Simulation(body, monitors=[watch])
    simulation.statics()
    displacement = body.stiffness.createVecRight()
    upper = np.append(
        np.flatnonzero(body.V.tabulate_dof_coordinates()[:, 1] > 1e-9), body.nodes("joint_1+")
    )
    displacement.getArray().reshape(-1, 2)[upper, 0] = START
    half = math.pi / math.sqrt(SPRING / MASS)
    parts = 50 if quick else 100
    outcome = simulation.dynamics(
        dt=half / parts, steps=5 * parts, start=dj.InitialFields(displacement=displacement)
    )
    time, x = np.array(watch.rows).T
    rows = [
        Row(
            quantity=f"turn {i} [mm]",
            ours=1e3 * x[i * parts],
            theirs=theirs,
            **estimate(steps=STEPS),
        )
        for i, theirs in enumerate(TURNS, 1)
    ]
    path_length = START + 1e-3 * (2.0 * 0.65 + 2.0 * 0.45 + 2.0 * 0.25 + 0.05)
    rows.append(
        Row(
            quantity="energy lost [mJ]",
            ours=1e3 * outcome.energy.friction,
            theirs=1e3 * FRICTION * PRESS * path_length,
            **estimate(steps=STEPS),
        )
    )
    figure, ax = new_figure()
    ax.plot(1e3 * time, 1e3 * x, label="ours")
    ax.plot(1e3 * half * np.arange(1, 5), TURNS, "ko", ms=4, label="exact turns")
    ax.set_xlabel("time [ms]")
    ax.set_ylabel("displacement [mm]")
    ax.legend()
    return Outcome(rows=rows, figure=figure)
