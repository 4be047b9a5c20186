# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bar that hits a wall.

A bar of 0.2 m, E = 2e11 Pa, nu = 0, 8000 kg/m^3 (c = 5000 m/s), moves with 100 m/s towards a wall
2 mm away. Contact begins after 20 us. A wave travels to the free end and back in 80 us; then the
bar leaves with its initial speed. The comparison has the displacements of both ends printed in
code_aster's test, the impulse and the rebound velocity. The bar has 40 cells of degree 1, a joint a
hundred times as stiff as a cell, redistributed mass and steps of 0.2 us.

The displacement of the striking end after 100 us is at the moment when the bar leaves. It does not
converge steadily: its deviation is 0.02 % with 40 cells, 2.3 % with 80 and 0.9 % with 160, with
steps of 0.2, 0.1 and 0.05 us. The other displacements are within 0.1 %.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record
from validation.atlas import Outcome, Row, estimate, new_figure

SOURCE = "code_aster's test SDNV100 (V5.03.100), exact values printed there"

LENGTH, YOUNG, DENSITY, VELOCITY, DISTANCE = 0.2, 2e11, 8000.0, 100.0, 2e-3
# Times [s] and displacements [mm] of the striking end and of the free end.
STRIKES = {4e-5: -2.0, 1e-4: -2.0}
FREE = {2e-5: -2.0, 8e-5: -4.0, 1.2e-4: 0.0}

# Relative errors with 40 cells. Those of impulse and rebound are the change from 20 to 40 cells.
# The bound of displacements is smaller than such an estimate: the bar moves 5 % of DISTANCE while
# a wave crosses a cell.
TURN, IMPULSE, REBOUND = 0.01, 0.005, 0.01


class _Ends(Monitor):
    """Monitor of both ends' displacements along the bar, and of the pressure on the wall."""

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Find the nodes."""
        self._nodes = [int(model.nodes(group)[0]) for group in ("joint_1+", "end")]
        self.rows: list[tuple[float, float, float, float]] = []
        self.record(first)

    def record(self, record: Record) -> None:
        """Store the step."""
        u = record.displacement.getArray(readonly=True).reshape(-1, 2)[self._nodes, 0]
        assert record.joints is not None
        self.rows.append((record.time, u[0], u[1], float(-record.joints.traction[:, 0].mean())))


def model(cells: int) -> dj.Model:
    """Return the bar along x and the wall, a fixed cell, with faces DISTANCE apart."""
    x = np.concatenate([[-DISTANCE - 0.01, -DISTANCE], np.linspace(0.0, LENGTH, cells + 1)])
    n, cell_starts = len(x), np.delete(np.arange(len(x) - 1), 1)
    upright = lambda k: np.array([[k, k + n]])  # noqa: E731
    along = np.column_stack([cell_starts, cell_starts + 1])
    jointed = dj.mesh_from_arrays(
        MPI.COMM_SELF,
        cell="quadrilateral",
        x=np.column_stack([np.tile(x, 2), np.repeat([0.0, 0.01], n)]),
        cells=np.column_stack([cell_starts, cell_starts + 1, cell_starts + n, cell_starts + n + 1]),
        facet_groups={
            "wall": upright(0),
            "joint_1-": upright(1),
            "joint_1+": upright(2),
            "end": upright(n - 1),
            "sides": np.vstack([along, along + n]),
        },
    )
    stiffness = 100.0 * YOUNG * cells / LENGTH
    return dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=DENSITY),
        joints=dj.FrictionNoTension(
            normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=10.0
        ),
        supports=[
            dj.Fixed(group="wall"),
            dj.Fixed(group="joint_1-"),
            dj.Fixed(group="sides", components="y"),
        ],
        body=dj.Body(redistribute_mass=True),
    )


def run(quick: bool) -> Outcome:
    """Run the impact; ``quick`` has steps twice as long."""
    ends = _Ends()
    bar = dj.Simulation(model(40), monitors=[ends])
    dt = 4e-7 if quick else 2e-7
    bar.dynamics(
        dt=dt,
        steps=round(1.4e-4 / dt),
        start=dj.InitialFields(
            velocity=lambda x: np.column_stack(
                [np.where(x[:, 0] > -1e-9, -VELOCITY, 0.0), 0.0 * x[:, 0]]
            )
        ),
    )
    time, struck, free, pressure = np.array(ends.rows).T
    rows = []
    for name, numbers, moved in (("end that strikes", STRIKES, struck), ("free end", FREE, free)):
        for t, theirs in numbers.items():
            rows.append(
                Row(
                    quantity=f"{name} after {1e6 * t:.0f} us [mm]",
                    ours=1e3 * float(np.interp(t, time, moved)),
                    theirs=theirs,
                    **estimate(cells=TURN),
                    scale=None if theirs else 1e3 * DISTANCE,
                )
            )
    impact = DENSITY * np.sqrt(YOUNG / DENSITY) * VELOCITY
    rows.append(
        Row(
            quantity="impulse on the wall / (2 m v)",
            ours=float(pressure[1:].sum() * dt / (2.0 * DENSITY * LENGTH * VELOCITY)),
            theirs=1.0,
            **estimate(cells=IMPULSE),
        )
    )
    late = time > 1.1e-4
    rows.append(
        Row(
            quantity="velocity of the rebound, mean of both ends [m/s]",
            ours=float(np.polyfit(time[late], (struck + free)[late] / 2.0, 1)[0]),
            theirs=VELOCITY,
            **estimate(cells=REBOUND),
        )
    )
    figure, (ends_axes, pressure_axes) = new_figure(2)
    for moved, name in ((struck, "end that strikes"), (free, "free end")):
        ends_axes.plot(1e6 * time, 1e3 * moved, label=name)
    for numbers in (STRIKES, FREE):
        ends_axes.plot([1e6 * t for t in numbers], list(numbers.values()), "ko", ms=4)
    ends_axes.set_xlabel("time [µs]")
    ends_axes.set_ylabel("displacement [mm]; dots: exact")
    ends_axes.legend()
    pressure_axes.plot(1e6 * time, pressure / impact)
    pressure_axes.plot([0, 20, 20, 100, 100, 140], [0, 0, 1, 1, 0, 0], "k:")
    pressure_axes.set_xlabel("time [µs]")
    pressure_axes.set_ylabel("pressure on the wall / (ρ c v); dotted: exact")
    return Outcome(rows=rows, figure=figure)
