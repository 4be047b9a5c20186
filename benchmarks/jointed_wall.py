#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time per step of the jointed wall, tied and with joints, in one process.

A wall of 20 x 4 x 20 m in four blocks, base clamped, self weight, then three sines per axis that
reach 0.4, 0.4 and 0.3 g: severe enough that most of the joint points are open at once. The tied
crest peaks are compared with the values that independent programs gave for the same scene.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import tempfile
import time as clock
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.interface import KINDS
from dolfinx_joints.parallel import on_root
from dolfinx_joints.stages import Record
from geometry.jointed_wall import jointed_wall

TIME_STEP, GRAVITY = 0.00488, 9.81
DIVISIONS = {"tiny": (8, 2, 8), "coarse": (20, 4, 20), "medium": (40, 8, 40)}
# Crest peaks (x, y, z) of the tied wall [mm], node at x = 10, mid thickness, top.
TIED_PEAKS = {"coarse": (0.48662, 28.5432, 0.060020), "medium": (0.48805, 29.3562, 0.060061)}
FREQUENCIES = np.array([[2.3, 4.1, 6.7], [2.9, 5.2, 7.4], [3.1, 5.9, 7.9]])
PHASES = np.array([[0.0, 1.1, 2.3], [0.7, 2.0, 0.4], [1.9, 0.3, 2.8]])
PEAKS = np.array([0.4, 0.4, 0.3]) * GRAVITY


def shape_of_motion(time: float) -> np.ndarray:
    """Sum of the sines of each axis with its onset, not yet scaled."""
    onset = np.sin(np.pi * time / 0.4) ** 2 if time < 0.2 else 1.0
    return onset * np.sin(2 * np.pi * FREQUENCIES * time + PHASES).sum(axis=1)


SCALE = PEAKS / np.abs([shape_of_motion(i * TIME_STEP) for i in range(201)]).max(axis=0)


def ground_acceleration(time: float) -> np.ndarray:
    """Acceleration (x, y, z) [m/s^2]."""
    return SCALE * shape_of_motion(time)


class StepTimes:
    """Monitor that keeps the wall time, iterations and crest displacement of each step."""

    def __init__(self) -> None:
        self.milliseconds: list[float] = []
        self.iterations: list[int] = []
        self.open: list[float] = []
        self.slip: list[float] = []
        self.crest: list[np.ndarray] = []

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Find the crest node and start the clock."""
        from dolfinx_joints.monitors import NodeGather, PointProbe

        self._probe = PointProbe(model, [(10.0, 2.0, 20.0)], NodeGather(model))
        self._static = self._probe.read(first.displacement)[0]
        self._last = clock.perf_counter()

    def record(self, record: Record) -> None:
        """Stop and restart the clock."""
        self.milliseconds.append(1e3 * (clock.perf_counter() - self._last))
        assert record.solve is not None
        self.iterations.append(record.solve.iterations)
        counts = record.solve.counts
        if counts is not None:
            self.open.append(counts.open / counts.total)
            self.slip.append(counts.slip / counts.total)
        self.crest.append(self._probe.read(record.displacement)[0] - self._static)
        self._last = clock.perf_counter()

    def finish(self, status: str, summary: dict[str, Any]) -> None:
        """Nothing to close."""


def march(mesh: Path, steps: int, *, tied: bool, solver: str) -> tuple[StepTimes, dict[str, Any]]:
    """Self weight and the motion."""
    jointed = dj.read_msh(mesh, MPI.COMM_WORLD, joints=[] if tied else None)
    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30)
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400),
        joints=None if tied else law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=(0.0, 0.0, -GRAVITY))],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
    )
    times = StepTimes()
    simulation = dj.Simulation(model, monitors=[times], solver=solver)
    simulation.statics(steps=1)
    outcome = simulation.dynamics(dt=TIME_STEP, steps=steps, motion=ground_acceleration)
    facts = {
        "dofs": model.num_dofs,
        "joint_points": model.operator.num_points if model.operator else 0,
        "ledger": outcome.imbalance,
        "energy_error": outcome.energy_error,
        "accepted": outcome.counts.accepted,
    }
    return times, facts


def measure(name: str, steps: int, solver: str) -> dict[str, Any]:
    """Both runs on one mesh."""
    comm = MPI.COMM_WORLD
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(comm.bcast(folder)) / "wall.msh"
        on_root(comm, lambda: jointed_wall(mesh, divisions=DIVISIONS[name]))
        linear, _ = march(mesh, steps, tied=True, solver=solver)
        joints, facts = march(mesh, steps, tied=False, solver=solver)
        comm.barrier()
    row = {
        **facts,
        "steps": steps,
        "linear_ms": statistics.median(linear.milliseconds),
        "joints_ms": statistics.median(joints.milliseconds),
        "newton_mean": statistics.mean(joints.iterations),
        "newton_max": max(joints.iterations),
        "open_mean": statistics.mean(joints.open),
        "slip_mean": statistics.mean(joints.slip),
        "tied_peaks_mm": list(1e3 * np.abs(linear.crest).max(axis=0)),
        "joint_peaks_mm": list(1e3 * np.abs(joints.crest).max(axis=0)),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    row["ratio"] = row["joints_ms"] / row["linear_ms"]
    if name in TIED_PEAKS and steps == 200:
        row["tied_peaks_expected_mm"] = list(TIED_PEAKS[name])
        np.testing.assert_allclose(row["tied_peaks_mm"], TIED_PEAKS[name], rtol=1e-4)
    return row


def main() -> None:
    """Print a table, or one JSON object as the last line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", nargs="+", default=["coarse"], choices=sorted(DIVISIONS))
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--solver", default="auto", choices=KINDS)
    parser.add_argument("--quick", action="store_true", help="the tiny mesh alone")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args()
    meshes = ["tiny"] if options.quick else options.mesh
    rows = {name: measure(name, options.steps, options.solver) for name in meshes}
    if MPI.COMM_WORLD.rank != 0:
        return
    for name, row in rows.items():
        print(
            f"{name}: {row['dofs']} dofs, {row['joint_points']} joint points, {row['steps']} steps "
            f"(medians per step): linear {row['linear_ms']:.2f} ms, with joints "
            f"{row['joints_ms']:.2f} ms, ratio {row['ratio']:.2f}; Newton {row['newton_mean']:.2f} "
            f"on average, at most {row['newton_max']}; ledger {row['ledger']:.1e}; "
            f"{row['peak_mb']:.0f} MB"
        )
    if options.json:
        print(json.dumps(rows))


if __name__ == "__main__":
    main()
