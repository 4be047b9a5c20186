#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a motion of a suite takes, against single runs of the same motions.

The wall's motion at scales from a third to the whole, so that joints open more and less. Single
runs are as a user makes them one after the other, each with its own factor and compliance; the
second ratio leaves these out on both sides and is what long runs come to. All start from one static
state and write results. Then the results of both are compared.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time as clock
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import load_average, progress
from benchmarks.shared.scenes import DIVISIONS, TIME_STEP, Scene, dam, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.study import MotionSuite

Row = dict[str, Any]


def measure(scene: Scene, *, motions: int, steps: int, singles: int) -> Row:
    """A suite, and some of its motions by themselves (collective)."""
    with scene.mesh_file() as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    simulation = dj.Simulation(model)
    simulation.statics(steps=scene.load_steps)
    shaking = scene.strong_shaking(steps * TIME_STEP)
    strong = np.array([shaking(TIME_STEP * i) for i in range(steps + 1)])
    chosen = {
        f"{k:.3f}": dj.Motion(acceleration=k * strong, dt=TIME_STEP)
        for k in np.linspace(1.0 / 3.0, 1.0, motions)
    }
    points = {"crest": scene.crest}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(MPI.COMM_WORLD.bcast(folder))
        suite = MotionSuite(place, simulation, chosen, points=points)
        began = clock.perf_counter()
        tally = suite.run(dt=TIME_STEP, at_once=motions)
        together = (clock.perf_counter() - began) / motions
        if tally.failed:
            raise SystemExit(str(tally))
        progress(f"{scene.name}: {motions} motions, {together:.2f} s each")
        alone, later, apart = [], [], 0.0
        for name in list(chosen)[:: max(1, motions // singles)][:singles]:
            path, watch = place / f"alone {name}.h5", Later()
            monitors = [dj.ResultsMonitor(path, points=points), watch]
            single = dj.Simulation(model, monitors=monitors)
            single.static, single.stages = simulation.static, list(simulation.stages)
            began = clock.perf_counter()
            single.dynamics(dt=TIME_STEP, steps=steps, motion=chosen[name])
            alone.append(clock.perf_counter() - began)
            later.append(watch.seconds)
            if MPI.COMM_WORLD.rank == 0:
                apart = max(apart, difference(path, suite.results(name)))
    set_up = float(np.mean(alone)) - float(np.mean(later))
    return {
        "scene": scene.name,
        "dofs": model.num_dofs,
        "motions": motions,
        "steps": steps,
        "together_s": together,
        "alone_s": float(np.mean(alone)),
        "ratio": together / float(np.mean(alone)),
        "ratio_of_steps": (together - set_up / motions) / float(np.mean(later)),
        "difference": apart,
        "load_average": load_average(),
    }


class Later(dj.Monitor):
    """Wall time of all steps but the first, which makes factor and compliance."""

    def record(self, record: Any) -> None:
        """Look at the clock."""
        if record.step == 1:
            self._first = clock.perf_counter()
        self.seconds = clock.perf_counter() - self._first if record.step else 0.0


def difference(one: Path, other: Path) -> float:
    """Largest difference of the last gaps and displacements, over the largest of each."""
    found = 0.0
    with dj.Results(one) as a, dj.Results(other) as b:
        names = [n for n in a.streams["states"] if n == "displacement" or n.endswith("/gap")]
        for name in names:
            u, v = (results.series("states", name, -1) for results in (a, b))
            found = max(found, float(np.abs(u - v).max() / np.abs(u).max()))
    return found


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", default="medium", choices=[*sorted(DIVISIONS), "dam"])
    parser.add_argument("--motions", type=at_least(2), default=16)
    parser.add_argument("--steps", type=at_least(2), default=200)
    parser.add_argument("--singles", type=at_least(1), default=3, help="motions also run alone")
    parser.add_argument("--quick", action="store_true", help="the tiny wall, 3 motions, 20 steps")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    options = parse_arguments(arguments)
    if options.quick:
        options.mesh, options.motions, options.steps, options.singles = "tiny", 3, 20, 2
    scene = dam() if options.mesh == "dam" else wall(options.mesh)
    row = measure(scene, motions=options.motions, steps=options.steps, singles=options.singles)
    if MPI.COMM_WORLD.rank == 0:
        print(
            f"{row['scene']}: {row['dofs']} dofs, {row['motions']} motions of {row['steps']} "
            f"steps\ntogether {row['together_s']:.2f} s per motion, alone {row['alone_s']:.2f} s: "
            f"ratio {row['ratio']:.2f}\nwithout factor and compliance: ratio "
            f"{row['ratio_of_steps']:.2f}\nlargest difference of gaps and displacements: "
            f"{row['difference']:.1e} of the largest"
        )
        if options.json:
            print(json.dumps([row]))


if __name__ == "__main__":
    main()
