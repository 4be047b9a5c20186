#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What `ReducedBulk` gains and misses: time per step and errors over numbers of modes.

The jointed wall or the arch dam from self weight on, every run beside that of the whole body: error
of the openings at all joint points and steps (largest and root mean square, over the largest
opening) and of the crest (over its largest displacement), processor time of a step and of what
comes before the first. The large wall of the decisions:

    benchmarks/reduced_bulk.py --divisions 72 14 72 --joints 1 --modes 200 --steps 80
"""

from __future__ import annotations

import json
import statistics
import time as clock
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import StepWatch, free_memory, load_average, peak_mb, progress
from benchmarks.shared.scenes import DAM_SIZES, DIVISIONS, TIME_STEP, Scene, dam, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.simulation.outcome import StaticState
from dolfinx_joints.simulation.record import Record

Row = dict[str, Any]


class Watch(StepWatch):
    """Also keeps the opening of each of the rank's joint points after each step [m]."""

    def __init__(self, scene: Scene) -> None:
        """Nothing is seen yet."""
        super().__init__(scene)
        self.opening: list[np.ndarray] = []

    def record(self, record: Record) -> None:
        """Keep them."""
        super().record(record)
        assert record.joints is not None
        self.opening.append(record.joints.state.gap[:, 0].copy())


def march(
    scene: Scene, model: dj.Model, static: StaticState, steps: int, reduced: dj.ReducedBulk | None
) -> tuple[Watch, Row]:
    """A run, and what it took (collective)."""
    free_memory()
    watch = Watch(scene)
    simulation = dj.Simulation(model, monitors=[watch])
    simulation.static = static
    began = clock.process_time()
    outcome = simulation.dynamics(
        dt=TIME_STEP,
        steps=steps,
        motion=scene.strong_shaking(steps * TIME_STEP),
        reduced=reduced,
    )
    total = clock.process_time() - began
    counts = outcome.reduced
    step = statistics.median(watch.cpu[1:])
    assert outcome.imbalance is not None
    return watch, {
        "modes": 0 if reduced is None else reduced.modes,
        "shapes": 0 if counts is None else counts.shapes,
        "whole_steps": steps if counts is None else counts.whole,
        "estimate": 0.0 if counts is None else counts.largest_error,
        "step_cpu_ms": step,
        "mean_cpu_ms": statistics.mean(watch.cpu[1:]),
        "set_up_cpu_s": total - 1e-3 * sum(watch.cpu[1:]),
        "iterations": outcome.iterations / steps,
        "ledger": outcome.imbalance,
        "peak_mb": peak_mb(),
    }


def errors(found: Watch, right: Watch) -> Row:
    """Errors of openings and crest (collective)."""
    comm = MPI.COMM_WORLD
    mine, of = np.array(found.opening), np.array(right.opening)
    largest = comm.allreduce(float(of.max(initial=0.0)), MPI.MAX)
    off = comm.allreduce(float(np.abs(mine - of).max(initial=0.0)), MPI.MAX)
    squares, number = comm.allreduce(float(((mine - of) ** 2).sum())), comm.allreduce(of.size)
    crest, of_crest = np.array(found.crest), np.array(right.crest)
    return {
        "opening_error": off / largest,
        "opening_rms": float(np.sqrt(squares / number)) / largest,
        "crest_error": float(np.abs(crest - of_crest).max() / np.abs(of_crest).max()),
    }


def measure(scene: Scene, steps: int, modes: list[int], tolerance: float) -> list[Row]:
    """The run of the whole body and reduced ones (collective)."""
    with scene.mesh_file() as path:
        model = scene.model(scene.read(path), scene.law())
    simulation = dj.Simulation(model)
    static = simulation.statics(steps=scene.load_steps)
    del simulation
    assert model.operator is not None
    facts = {"scene": scene.name, "dofs": model.num_dofs, "points": model.operator.num_points}
    facts |= {"steps": steps, "tolerance": tolerance, "ranks": MPI.COMM_WORLD.size}
    right, row = march(scene, model, static, steps, None)
    progress(f"{scene.name}, {model.num_dofs} dofs, whole body: {row['step_cpu_ms']:.1f} ms")
    rows = [facts | row | errors(right, right)]
    for count in modes:
        reduced = dj.ReducedBulk(modes=count, tolerance=tolerance)
        watch, row = march(scene, model, static, steps, reduced)
        rows.append(facts | row | errors(watch, right))
        progress(f"{scene.name}, {count} modes: {row['step_cpu_ms']:.1f} ms")
    return rows


def show(rows: list[Row]) -> None:
    """The table, on rank 0."""
    whole = rows[0]
    print(
        f"{whole['scene']}: {whole['dofs']} dofs, {whole['points']} joint points, "
        f"{whole['steps']} steps, tolerance {whole['tolerance']:g}, {whole['ranks']} ranks, "
        f"load average {load_average():.1f}"
    )
    print("modes shapes whole  step [ms] faster set-up [s]  opening: max      rms    crest  ledger")
    for row in rows:
        name = f"{row['modes']:5d}" if row["modes"] else "whole"
        print(
            f"{name} {row['shapes']:6d} {row['whole_steps']:5d} {row['step_cpu_ms']:10.1f} "
            f"{whole['step_cpu_ms'] / row['step_cpu_ms']:6.1f} {row['set_up_cpu_s']:10.1f} "
            f"{row['opening_error']:13.1e} {row['opening_rms']:8.1e} {row['crest_error']:8.1e} "
            f"{row['ledger']:7.0e}"
        )


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = Parser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--mesh", choices=[*DIVISIONS, *DAM_SIZES], default="coarse")
    parser.add_argument("--divisions", type=at_least(1), nargs=3, help="cells of the wall instead")
    parser.add_argument("--joints", type=at_least(1), default=3, help="of the wall")
    parser.add_argument("--pressure", type=float, default=0.0, help="on the wall's ends [MPa]")
    parser.add_argument("--modes", type=at_least(1), nargs="+", default=[50, 100, 200])
    parser.add_argument("--tolerance", type=float, default=1e-2)
    parser.add_argument("--steps", type=at_least(2), default=50)
    parser.add_argument("--quick", action="store_true", help="20 steps, 20 and 100 modes")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    given = parser.parse_args(arguments)
    if given.quick:
        given.steps, given.modes = 20, [20, 100]
    if given.mesh in DAM_SIZES:
        scene = dam(given.mesh)
    else:
        scene = wall(
            given.mesh,
            pressure=given.pressure,
            divisions=given.divisions,
            joints=given.joints,
        )
    rows = measure(scene, given.steps, given.modes, given.tolerance)
    if MPI.COMM_WORLD.rank == 0:
        show(rows)
        if given.json:
            print(json.dumps(rows))


if __name__ == "__main__":
    main()
