#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies too large for a factor: iterations, time and memory of linear and jointed steps.

Walls with one joint and about 1e5, 3e5 and 1e6 dofs are shaken from rest, tied and with the joint,
which opens in the first step. The bulk is solved iteratively. Two further walls, selected by
``--sizes``, are cut into so many blocks that 1e4 and 1e5 joint points are at most of the nodes. Run
it on any number of ranks::

    mpirun -n 2 python3 -m benchmarks.large_bodies

Times are wall and processor times of the slowest rank: of the first step with its preparation, and
the median of the other steps. Iterations of the linear solver are per step: the largest number of
the linear steps, the mean of the jointed steps. Newton iterations are those of the first step and
the mean of the others. Set-up is reading and assembly. Peak memory is the sum over the ranks.

The exit status is 1 if energies do not balance, the joint does not open, or a linear step needs a
fifth more iterations than on the next smaller wall.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import statistics
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import dolfinx_joints as dj
from benchmarks.shared.measure import Phases, StepWatch, free_memory, slowest
from benchmarks.shared.scenes import TIME_STEP, Wall, wall, wall_file
from benchmarks.shared.tables import head, line
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.simulation.record import Record
from dolfinx_joints.solvers.multigrid.bulk import IterativeSolver
from dolfinx_joints.solvers.multigrid.tangent import TangentMultigrid

COLUMNS = (
    "| wall | run | dofs | points | solver | first: s | cpu | its | others: s | cpu | its |"
    " solves | Newton | open | ledger | set-up | peak MiB |\n"
    "| {name} | {kind} | {dofs} | {joint_points} | {solver} | {first_s:.1f} | {first_cpu_s:.1f} |"
    " {first_iterations} | {step_s:.2f} | {step_cpu_s:.2f} | {iterations:.0f} | {solves:.1f} |"
    " {newton[0]}, {newton[1]:.1f} | {opened:.2f} | {ledger:.0e} | {setup_s:.1f} | {peak_mb:.0f} |"
)
BODIES: dict[str, Wall] = {
    "1e5": ((54, 10, 54), 1),
    "3e5": ((78, 15, 80), 1),
    "1e6": ((116, 25, 116), 1),
}
POINTS: dict[str, Wall] = {
    "1e4 points": ((32, 12, 62), 15),
    "1e5 points": ((64, 25, 126), 31),
}
QUICK: dict[str, Wall] = {"quick": ((8, 2, 8), 1), "quicker": ((12, 3, 12), 1)}
KINDS = ("linear", "joints")
LARGEST_LEDGER, LARGEST_GROWTH = 1e-10, 1.2


class IterationWatch(StepWatch):
    """Monitor that also records the iterations of the linear solver in each step.

    Attributes:
        counts: Iterations of each solve, a list for each step.
    """

    def __init__(self, scene: Any, solves: list[int]) -> None:
        """Create empty records."""
        super().__init__(scene)
        self._solves = solves
        self.counts: list[list[int]] = []

    def record(self, record: Record) -> None:
        """Store the iterations since the last step."""
        super().record(record)
        self.counts.append(self._solves.copy())
        self._solves.clear()


@contextmanager
def counted() -> Iterator[list[int]]:
    """Collect the iterations of each solve of an iterative solver within the context."""
    iterations: list[int] = []
    one, whole = IterativeSolver.solve, TangentMultigrid.solve

    def counting(original: Any) -> Any:
        def solve(solver: Any, *arguments: Any, **named: Any) -> Any:
            answer = original(solver, *arguments, **named)
            iterations.append(solver.iterations)
            return answer

        return solve

    IterativeSolver.solve, TangentMultigrid.solve = counting(one), counting(whole)
    try:
        yield iterations
    finally:
        IterativeSolver.solve, TangentMultigrid.solve = one, whole


def measure(kind: str, body: Wall, mesh: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Run a wall, tied or with the joint; return its row (collective)."""
    # the accuracy does not matter here
    warnings.filterwarnings("ignore", "Loads are applied suddenly")
    free_memory()
    divisions, joints = body
    scene = wall("large", divisions=divisions, joints=joints)
    phases, tied = Phases(), kind == "linear"
    with phases.phase("set-up"):
        model = scene.model(
            scene.read(mesh, tied=tied), None if tied else scene.law(options.stiffness)
        )
    with counted() as solves, phases.phase("steps"):
        watch = IterationWatch(scene, solves)
        simulation = dj.Simulation(
            model,
            monitors=[watch],
            solver=options.solver,
            options=dj.SolverOptions(linear="iterative", max_iterations=options.iterations),
        )
        end = simulation.dynamics(
            dt=TIME_STEP,
            steps=options.steps,
            motion=scene.strong_shaking(options.steps * TIME_STEP),
        )
    first, *others = watch.wall
    totals = [sum(step) for step in watch.counts[1:]]
    return {
        "kind": kind,
        "ranks": MPI.COMM_WORLD.size,
        "dofs": model.num_dofs,
        "joint_points": model.operator.num_points if model.operator else 0,
        "solver": end.solver,
        "first_s": slowest(first) / 1e3,
        "first_cpu_s": slowest(watch.cpu[0]) / 1e3,
        "step_s": slowest(statistics.median(others)) / 1e3,
        "step_cpu_s": slowest(statistics.median(watch.cpu[1:])) / 1e3,
        "first_iterations": sum(watch.counts[0]),
        "iterations": max(totals) if tied else statistics.mean(totals),
        "solves": statistics.mean(len(step) for step in watch.counts[1:]),
        "newton": [watch.iterations[0], statistics.mean(watch.iterations[1:])],
        "opened": max((share[0] for share in watch.shares), default=0.0),
        "ledger": end.imbalance,
        "setup_s": phases.seconds["set-up"],
        "peak_mb": max(phases.peaks_mb.values()),
    }


def passed(rows: list[dict[str, Any]]) -> bool:
    """Return True if energies balance, joints open, and iterations hardly grow with the size."""
    sound = all(
        row["ledger"] <= LARGEST_LEDGER and (row["kind"] == "linear" or row["opened"] > 0.0)
        for row in rows
    )
    linear = [row for row in rows if row["kind"] == "linear"]
    grown = (
        a["joints"] == b["joints"] and b["iterations"] > LARGEST_GROWTH * a["iterations"]
        for a, b in itertools.pairwise(linear)
    )
    return sound and not any(grown)


def main(arguments: list[str] | None = None) -> int:
    """Print the table; return 1 if a run did not pass."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", choices=[*BODIES, *POINTS], default=list(BODIES))
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--solver", default="auto", choices=("auto", "condensed", "monolithic"))
    parser.add_argument("--stiffness", type=float, default=1e11, help="k_n of the joint [Pa/m]")
    parser.add_argument("--steps", type=at_least(2), default=5)
    parser.add_argument(
        "--iterations",
        type=at_least(1),
        default=60,
        help="Newton iterations before a step is halved",
    )
    parser.add_argument("--quick", action="store_true", help="tiny walls")
    parser.add_argument("--json", action="store_true", help="a JSON array as the last line")
    options = parser.parse_args(sys.argv[1:] if arguments is None else arguments)
    comm, rows = MPI.COMM_WORLD, []
    if comm.rank == 0:
        print(f"{comm.size} rank(s), load average {os.getloadavg()[0]:.1f}\n\n{head(COLUMNS)}")
    every = BODIES | POINTS
    sizes = QUICK if options.quick else {name: every[name] for name in options.sizes}
    for name, body in sizes.items():
        with wall_file(body) as mesh:
            for kind in options.kinds:
                row = {"name": name, "joints": body[1], **measure(kind, body, mesh, options)}
                rows.append(row)
                if comm.rank == 0:
                    print(line(COLUMNS, row), flush=True)
    if options.json and comm.rank == 0:
        print(json.dumps(rows))
    return int(not passed(rows))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    raise SystemExit(main())
