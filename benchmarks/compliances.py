#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the compliance of many joint points takes: dense, in blocks of low rank, or not kept at all.

The jointed wall of the medium mesh cut at every second plane of cells has 21 033 joint unknowns;
each way of keeping the compliance runs it in a process of its own, so that peaks of memory do not
mix. Compared are the memory that is kept, the peak that making it adds, the time of a step, and the
motion, which must be the same. Exit status 1 if it is not, or if energies do not balance.

``--linear iterative --kinds matrix-free`` is the way of bodies whose factor does not fit into
memory: nothing is factored and nothing kept. ``--at-rest`` leaves out the self weight, which takes
hundreds of products there.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time as clock
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import (
    StepWatch,
    free_memory,
    load_average,
    peak_mb,
    progress,
    reset_peak,
)
from benchmarks.shared.scenes import TIME_STEP, Scene, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.solvers.effective_matrix import LinearSolver
from dolfinx_joints.solvers.interface import condensed
from dolfinx_joints.solvers.interface.compliance import Compliance
from dolfinx_joints.solvers.step_solver import ComplianceKind

LARGEST_LEDGER = 1e-9
LARGEST_DIFFERENCE = 1e-8


@dataclass(frozen=True, kw_only=True)
class Row:
    """A run with one way of keeping the compliance.

    Attributes:
        kind: Of the compliance.
        linear: Whether the bulk was solved ``direct`` or by iteration.
        dofs: Displacement dofs.
        unknowns: Joint unknowns m.
        dense_mb: 8 m^2 bytes [MiB].
        kept_mb: What S and its rough form take [MiB].
        making_s: Wall time of making them [s].
        above_mb: Peak above what the model takes, factor and static stage included [MiB].
        peak_mb: Peak of the whole process [MiB].
        step_ms: Median wall time of a step but the first [ms].
        step_cpu_ms: The same in processor time [ms].
        newton_mean: Iterations per step.
        ledger: What all energy lines leave unexplained, over the largest energy.
        crest: Displacement of the crest after each step, (steps, 3) [m].
    """

    kind: str
    linear: str
    dofs: int
    unknowns: int
    dense_mb: float
    kept_mb: float
    making_s: float
    above_mb: float
    peak_mb: float
    step_ms: float
    step_cpu_ms: float
    newton_mean: float
    ledger: float
    crest: list[list[float]]


class _Making:
    """What making the compliance of the time steps took."""

    def __init__(self) -> None:
        self.seconds = self.kept_mb = 0.0
        self.kind = ""

    def watch(self) -> None:
        """From now on, the class that makes compliances tells."""
        making = self

        class Watched(Compliance):
            def __init__(self, *arguments: Any, **named: Any) -> None:
                began = clock.perf_counter()
                super().__init__(*arguments, **named)
                making.seconds = clock.perf_counter() - began
                making.kept_mb = self.kept_bytes / 2**20
                making.kind = self.kind

        condensed.Compliance = Watched  # type: ignore[misc]


def measure(scene: Scene, kind: str, options: argparse.Namespace) -> Row:
    """A run from the moment on when the shaking is strong."""
    making, watch = _Making(), StepWatch(scene)
    with scene.mesh_file() as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    simulation = dj.Simulation(
        model,
        monitors=[watch],
        options=dj.SolverOptions(compliance=kind, linear=options.linear, max_iterations=100),
        solver="condensed",
    )
    free_memory()
    reset_peak()
    with_model = peak_mb()
    progress(f"{kind}: {model.num_dofs} dofs, {3 * model.operator.num_points} joint unknowns")
    if not options.at_rest:
        simulation.statics()
        progress(f"{kind}: self weight is carried")
    making.watch()
    end = simulation.dynamics(
        dt=TIME_STEP,
        steps=options.steps,
        motion=scene.strong_shaking(options.steps * TIME_STEP),
    )
    size = 3 * model.operator.num_points
    return Row(
        kind=making.kind,
        linear=options.linear,
        dofs=model.num_dofs,
        unknowns=size,
        dense_mb=8 * size**2 / 2**20,
        kept_mb=making.kept_mb,
        making_s=making.seconds,
        above_mb=peak_mb() - with_model,
        peak_mb=peak_mb(),
        step_ms=float(np.median(watch.wall[1:])),
        step_cpu_ms=float(np.median(watch.cpu[1:])),
        newton_mean=end.iterations / end.counts.accepted,
        ledger=end.imbalance if end.imbalance is not None else np.inf,
        crest=np.array(watch.crest).tolist(),
    )


def difference(one: Row, other: Row) -> float:
    """Of the crest's motions, relative to the largest displacement."""
    a, b = np.array(one.crest), np.array(other.crest)
    return float(np.abs(a - b).max() / np.abs(a).max())


def print_table(rows: list[Row]) -> None:
    """A line for each way."""
    first = rows[0]
    print(
        f"{first.dofs} dofs, {first.unknowns} joint unknowns: a dense S would take "
        f"{first.dense_mb:.0f} MiB. Bulk: {first.linear}. Load average {load_average():.1f} on "
        f"{os.cpu_count()} processors.\nkept: MiB, in brackets as a share of the dense S; s: "
        "seconds of making it; above, peak: largest memory [MiB],\nabove that of the model, and of "
        "the whole process; step: median wall and processor time [ms];\nsame: difference of the "
        "crest's motion from that of the first line, relative.\n"
    )
    print(
        f"{'kept as':<11} {'kept':>13} {'s':>7} {'above':>6} {'peak':>6} {'step':>8} {'cpu':>8} "
        f"{'Newton':>6} {'ledger':>8} {'same':>8}"
    )
    for row in rows:
        print(
            f"{row.kind:<11} {row.kept_mb:5.0f} ({row.kept_mb / row.dense_mb:.3f}) "
            f"{row.making_s:7.1f} {row.above_mb:6.0f} {row.peak_mb:6.0f} "
            f"{row.step_ms:8.1f} {row.step_cpu_ms:8.1f} "
            f"{row.newton_mean:6.2f} {row.ledger:8.1e} {difference(first, row):8.1e}"
        )


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    """Options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=get_args(ComplianceKind))
    parser.add_argument("--divisions", nargs=3, type=at_least(1), help="cells along x, y, z")
    parser.add_argument("--joints", type=at_least(1), help="number of joints")
    parser.add_argument("--steps", type=at_least(1), default=12)
    parser.add_argument(
        "--linear", default="direct", choices=get_args(LinearSolver), help="solver of the bulk"
    )
    parser.add_argument("--at-rest", action="store_true", help="leave out the self weight")
    parser.add_argument("--quick", action="store_true", help="a small wall, 3 steps")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args(arguments)
    divisions, joints = ([16, 4, 16], 7) if options.quick else ([40, 8, 40], 19)
    options.divisions = options.divisions or divisions
    options.joints = options.joints or joints
    options.kinds = options.kinds or ["dense", "compressed"]
    options.steps = 3 if options.quick else options.steps
    return options


def run(kind: str, options: argparse.Namespace) -> Row:
    """A way in a process of its own."""
    command = [sys.executable, str(Path(__file__).resolve()), "--kinds", kind, "--json"]
    command += ["--divisions", *map(str, options.divisions), "--joints", str(options.joints)]
    command += ["--steps", str(options.steps), "--linear", options.linear]
    command += ["--at-rest"] if options.at_rest else []
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"compliances: the run with {kind!r} failed.")
    return Row(**json.loads(done.stdout.rstrip("\n").split("\n")[-1])[0])


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if the motions differ or energies do not balance."""
    options = parse_arguments(sys.argv[1:] if arguments is None else arguments)
    if len(options.kinds) == 1:
        scene = wall("many joints", divisions=options.divisions, joints=options.joints)
        rows = [measure(scene, options.kinds[0], options)]
    else:
        rows = [run(kind, options) for kind in options.kinds]
    print_table(rows)
    if options.json:
        print(json.dumps([asdict(row) for row in rows]))
    wrong = any(difference(rows[0], row) > LARGEST_DIFFERENCE for row in rows)
    return int(wrong or any(row.ledger > LARGEST_LEDGER for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
