#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of joints: time per step of a wall and a dam, tied and with joints, in one process.

The wall is 20 x 4 x 20 m in four blocks with a fixed base. After self weight it is shaken by three
sines per axis up to 0.4, 0.4 and 0.3 g, so that most joint points are open at the same time.
``--pressure`` also loads its end faces during the whole run, so that joints close and slide. The
crest peaks of the tied wall are compared with values of independent programs. ``--dam`` is the arch
dam of demo 03, starting at the strong part of its synthetic motion.

Times are medians over ``--repeat`` alternating linear and jointed runs, of the slowest rank. Memory
is the sum over the ranks.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import (
    march,
    median_of,
    print_disturbance,
    supernodal_factors_alone,
)
from benchmarks.shared.scenes import DAM_STEPS, DIVISIONS, TIED_STEPS, Scene, dam, wall
from benchmarks.shared.tables import table
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.solvers.choice import SolverKind

Row = dict[str, Any]

DAMS = {
    "dam": "also run the dam of demo 03, 8k dofs",
    "dam middle": "also run a finer dam, 15k dofs",
    "dam fine": "also run the finest dam, 43k dofs",
}

# Numbers of `march` whose medians over the repeats are reported, for linear and jointed runs.
TIMES = ("ms", "cpu_ms", "solve_ms", "iteration_ms", "over_solve")
TIMES += ("total_s", "total_cpu_s", "setup_s", "peaks_mb", "peak_mb")
FACTS = ("dofs", "joint_points", "solver", "newton_mean", "newton_max", "accepted", "cut")
FACTS += ("ledger", "energy_error")


def measure(
    scene: Scene,
    steps: int,
    *,
    solver: str = "auto",
    options: dj.SolverOptions | None = None,
    repeat: int = 1,
    supernodal: bool = False,
) -> Row:
    """Return the row of a scene's linear and jointed runs, repeated alternately (collective).

    With ``supernodal`` the runs are repeated with CHOLMOD's factor alone.
    """

    def both(mesh: Path) -> tuple[Row, Row]:
        linear = march(scene, mesh, steps, law=None, options=options)
        return linear, march(scene, mesh, steps, law=scene.law(), solver=solver, options=options)

    pairs, others = [], []
    with scene.mesh_file() as mesh:
        for _ in range(repeat):
            pairs.append(both(mesh))
            if scene.tied_peaks_mm is not None and steps == TIED_STEPS:
                peaks = pairs[-1][0]["peaks_mm"]
                np.testing.assert_allclose(peaks, scene.tied_peaks_mm, rtol=1e-4)
            if supernodal:
                with supernodal_factors_alone():
                    others.append(both(mesh))
    row = summary(pairs, steps)
    for name, runs in zip(("linear", "joints"), zip(*others, strict=True), strict=False):
        row |= {f"{name}_supernodal_{key}": median_of(runs, key) for key in ("ms", "solve_ms")}
    return row


def summary(pairs: Sequence[tuple[Row, Row]], steps: int) -> Row:
    """Return the row: medians over the repeats, and facts of the last jointed run."""
    linear, last = pairs[-1]
    ratios = [jointed["ms"] / tied["ms"] for tied, jointed in pairs]
    row = {
        "dofs_tied": linear["dofs"],
        "steps": steps,
        "ranks": MPI.COMM_WORLD.size,
        "repeats": len(pairs),
        "load_average": os.getloadavg()[0],
        "ratio": statistics.median(ratios),
        "ratio_range": [min(ratios), max(ratios)],
        **{name: last[name] for name in FACTS},
        **dict(zip(("open", "stick", "slip"), last["shares"], strict=True)),
        "tied_peaks_mm": linear["peaks_mm"],
        "joint_peaks_mm": last["peaks_mm"],
    }
    for name, runs in zip(("linear", "joints"), zip(*pairs, strict=True), strict=True):
        row |= {f"{name}_{key}": median_of(runs, key) for key in TIMES}
    row["ratio_least"] = (
        1.0 + (row["joints_solve_ms"] + row["joints_iteration_ms"]) / row["linear_ms"]
    )
    row["wall_over_cpu"] = max(row[f"{n}_ms"] / row[f"{n}_cpu_ms"] for n in ("linear", "joints"))
    row["ratio_cpu"] = row["joints_cpu_ms"] / row["linear_cpu_ms"]
    return row


STEPS = (
    "| scene | dofs | points | steps | linear | cpu | over solve | jointed | cpu | over solve |"
    " ratio (range) | of cpu | least | iteration | solver |\n"
    "| {name} | {dofs} | {joint_points} | {steps} | {linear_ms:.2f} | {linear_cpu_ms:.2f} |"
    " {linear_over_solve:.2f} | {joints_ms:.2f} | {joints_cpu_ms:.2f} | {joints_over_solve:.2f} |"
    " {ratio:.2f} ({ratio_range[0]:.2f} to {ratio_range[1]:.2f}) | {ratio_cpu:.2f} |"
    " {ratio_least:.2f} | {joints_iteration_ms:.2f} | {solver} |"
)
JOINTS = (
    "| scene | Newton mean | most | open | stick | slip | cut | ledger | tied peaks x, y, z |"
    " jointed |\n"
    "| {name} | {newton_mean:.2f} | {newton_max} | {open:.0%} | {stick:.0%} | {slip:.0%} | {cut} |"
    " {ledger:.1e} | {tied_peaks_mm[0]:.4g}, {tied_peaks_mm[1]:.4g}, {tied_peaks_mm[2]:.4g} |"
    " {joint_peaks_mm[0]:.4g}, {joint_peaks_mm[1]:.4g}, {joint_peaks_mm[2]:.4g} |"
)
PHASES = ("mesh", "assembly", "statics", "factor", "compliance")
SETUP = (
    "| scene | run | mesh | assembly | statics | factor | compliance | whole run | cpu |"
    " MiB: model | MiB: statics | MiB: steps |\n"
    "| {name} | {run} | {setup_s[mesh]:.2f} | {setup_s[assembly]:.2f} | {setup_s[statics]:.2f} |"
    " {setup_s[factor]:.2f} | {setup_s[compliance]:.2f} | {total_s:.2f} | {total_cpu_s:.2f} |"
    " {peaks_mb[model]:.0f} | {peaks_mb[statics]:.0f} | {peaks_mb[steps]:.0f} |"
)
SUPERNODAL = (
    "| scene | run | step | solve | step over solve | step above over solve |\n"
    "| {name} | {run} | {supernodal_ms:.2f} | {supernodal_solve_ms:.2f} | {over:.2f} |"
    " {above_over:.2f} |"
)


def runs_of(rows: dict[str, Row]) -> list[Row]:
    """Return a row for the linear and one for the jointed runs of each scene."""
    lines = []
    for name, row in rows.items():
        for kind, label in (("linear_", "linear"), ("joints_", "jointed")):
            own = {key.removeprefix(kind): row[key] for key in row if key.startswith(kind)}
            if "supernodal_ms" in own:
                solve = own["supernodal_solve_ms"]
                own |= {"over": own["supernodal_ms"] / solve, "above_over": own["ms"] / solve}
            lines.append({"name": name, "run": label, **own})
    return lines


def print_tables(rows: dict[str, Row], *, supernodal: bool) -> None:
    """Print the tables: steps, joints, set-up with memory, and steps by CHOLMOD's factor alone."""
    named = [{"name": name, **row} for name, row in rows.items()]
    first = named[0]
    print(
        f"{first['ranks']} rank(s), {first['repeats']} repeat(s), load average "
        f"{first['load_average']:.1f} on {os.cpu_count()} processors.\n\n"
        "Milliseconds per step, medians without the first step. Ratios are jointed over linear:\n"
        "of wall times, with their range over the repeats, and of processor times, which depend\n"
        "less on other processes. Least is the ratio if a jointed step took only a linear step,\n"
        "a second back-substitution and the iteration on the joints [ms]. Over solve is a step\n"
        "over one back-substitution of the same run, median wall times; its lower limit is 1 for\n"
        "a linear step and 2 for a jointed step.\n"
    )
    print(table(STEPS, named))
    print_disturbance(named)
    print(
        "\nNewton iterations per step; mean fraction of joint points by state; rejected steps;\n"
        "ledger: unexplained energy over the largest energy; peaks of the crest [mm].\n"
    )
    print(table(JOINTS, named))
    print(
        "\nSeconds of the set-up and of the whole run, from reading the mesh to the last step;\n"
        "compliance is the additional time of the first step without the factor. Peak memory\n"
        "[MiB] by phase, including memory of earlier phases.\n"
    )
    print(table(SETUP, runs_of(rows)))
    if supernodal:
        print(
            "\nAlternating runs with CHOLMOD's factor alone: steps and back-substitutions [ms];\n"
            "these steps, and the steps above, over one of these back-substitutions.\n"
        )
        print(table(SUPERNODAL, runs_of(rows)))


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", nargs="*", default=["coarse"], choices=sorted(DIVISIONS))
    parser.add_argument(
        "--pressure",
        nargs="*",
        type=float,
        default=[],
        metavar="MPA",
        help="also run the walls with these pressures on their end faces",
    )
    for name, text in DAMS.items():
        parser.add_argument(f"--{name.replace(' ', '-')}", action="store_true", help=text)
    parser.add_argument(
        "--steps",
        type=at_least(1),
        default=TIED_STEPS,
        help=f"time steps of 0.00488 s ({DAM_STEPS} for the whole motion of the dam)",
    )
    parser.add_argument("--repeat", type=at_least(1), default=1, help="number of runs for medians")
    parser.add_argument(
        "--supernodal",
        action="store_true",
        help="also run with CHOLMOD's factor alone",
    )
    parser.add_argument("--solver", default="auto", choices=get_args(SolverKind))
    parser.add_argument("--quick", action="store_true", help="only the tiny wall")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    return parser.parse_args(arguments)


def scenes(options: argparse.Namespace) -> list[Scene]:
    """Return the scenes to run."""
    if options.quick:
        return [wall("tiny")]
    walls = [wall(m, pressure=p) for m in options.mesh for p in (0.0, *options.pressure)]
    return walls + [dam(name) for name in DAMS if getattr(options, name.replace(" ", "_"))]


def main(arguments: list[str] | None = None) -> None:
    """Print tables, or one JSON object as the last line."""
    options = parse_arguments(arguments)
    given = {"solver": options.solver, "repeat": options.repeat, "supernodal": options.supernodal}
    rows = {scene.name: measure(scene, options.steps, **given) for scene in scenes(options)}
    if MPI.COMM_WORLD.rank == 0:
        print_tables(rows, supernodal=options.supernodal)
        if options.json:
            print(json.dumps(rows))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    main()
