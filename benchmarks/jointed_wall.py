#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What joints cost: time per step of a wall and a dam, tied and with joints, in one process.

The wall has 20 x 4 x 20 m in four blocks, base clamped, self weight, then three sines per axis
that reach 0.4, 0.4 and 0.3 g: severe enough that most of the joint points are open at once.
``--pressure`` presses its end faces as well, through the whole run, so that joints close and slide.
The crest peaks of the tied wall are compared with the values that independent programs gave for the
same scene. ``--dam`` is the arch dam of demo 03 from where its synthetic motion is strong.

Times are medians over ``--repeat`` runs, linear and jointed in turn. Of several ranks the slowest
counts; memory is their sum.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
from collections.abc import Callable, Sequence
from typing import Any, get_args

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import (
    March,
    disturbance,
    load_average,
    march,
    print_disturbance,
    supernodal_factors_alone,
)
from benchmarks.shared.scenes import DAM_STEPS, DIVISIONS, TIED_STEPS, Scene, dam, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.solvers.choice import SolverKind

Row = dict[str, Any]


def measure(
    scene: Scene, steps: int, solver: str = "auto", repeat: int = 1, supernodal: bool = False
) -> Row:
    """Both runs of a scene, ``repeat`` times in turn (collective).

    With ``supernodal`` also by CHOLMOD's factor alone.
    """
    pairs, others = [], []
    with scene.mesh_file() as mesh:
        for _ in range(repeat):
            linear = march(scene, mesh, steps, law=None)
            joints = march(scene, mesh, steps, law=scene.law(), solver=solver)
            if scene.tied_peaks_mm is not None and steps == TIED_STEPS:
                np.testing.assert_allclose(linear.peaks_mm, scene.tied_peaks_mm, rtol=1e-4)
            pairs.append((linear, joints))
            if supernodal:
                with supernodal_factors_alone():
                    linear = march(scene, mesh, steps, law=None)
                    joints = march(scene, mesh, steps, law=scene.law(), solver=solver)
                    others.append((linear, joints))
    row = summary(*zip(*pairs, strict=True), steps)
    for name, runs in zip(("linear", "joints"), zip(*others, strict=True), strict=False):
        row[f"{name}_supernodal_ms"] = median_of(runs, lambda run: run.step_ms)
        row[f"{name}_supernodal_solve_ms"] = median_of(runs, lambda run: run.solve_ms)
    return row


def summary(linear: Sequence[March], joints: Sequence[March], steps: int) -> Row:
    """One row of JSON: medians over the repeats, facts of the last jointed run."""
    last = joints[-1]
    ratios = [b.step_ms / a.step_ms for a, b in zip(linear, joints, strict=True)]
    row = {
        "dofs": last.dofs,
        "dofs_tied": linear[-1].dofs,
        "joint_points": last.points,
        "steps": steps,
        "ranks": MPI.COMM_WORLD.size,
        "repeats": len(joints),
        "load_average": load_average(),
        "ratio": statistics.median(ratios),
        "ratio_range": [min(ratios), max(ratios)],
        "newton_mean": last.facts["iterations"] / last.facts["accepted"],
        "newton_max": max(last.watch.iterations),
        **last.facts,
        **dict(zip(("open", "stick", "slip"), np.mean(last.watch.shares, axis=0), strict=True)),
        "tied_peaks_mm": linear[-1].peaks_mm,
        "joint_peaks_mm": last.peaks_mm,
        "peak_mb": median_of(joints, lambda run: run.peak_mb),
    }
    for name, runs in (("linear", linear), ("joints", joints)):
        row |= {
            f"{name}_ms": median_of(runs, lambda run: run.step_ms),
            f"{name}_cpu_ms": median_of(runs, lambda run: run.step_cpu_ms),
            f"{name}_mean_ms": median_of(runs, lambda run: run.mean_ms),
            f"{name}_solve_ms": median_of(runs, lambda run: run.solve_ms),
            f"{name}_over_solve": median_of(runs, lambda run: run.step_ms / run.solve_ms),
            f"{name}_total_s": median_of(runs, lambda run: run.total),
            f"{name}_total_cpu_s": median_of(runs, lambda run: run.total_cpu),
            f"{name}_setup_s": by_name(runs, lambda run: run.seconds),
            f"{name}_peaks_mb": by_name(runs, lambda run: run.peaks_mb),
        }
    iteration = median_of(joints, lambda run: run.iteration_ms)
    row["joints_iteration_ms"] = iteration
    row["ratio_least"] = 1.0 + (row["joints_solve_ms"] + iteration) / row["linear_ms"]
    row["wall_over_cpu"] = disturbance(row)
    for kind in ("cpu", "mean"):
        row[f"ratio_{kind}"] = row[f"joints_{kind}_ms"] / row[f"linear_{kind}_ms"]
    return row


def median_of(runs: Sequence[March], value: Callable[[March], float]) -> float:
    """Median of a number over runs."""
    return statistics.median(value(run) for run in runs)


def by_name(runs: Sequence[March], values: Callable[[March], dict[str, float]]) -> dict[str, float]:
    """Medians of several numbers over runs."""
    return {name: statistics.median(values(run)[name] for run in runs) for name in values(runs[0])}


def print_tables(rows: dict[str, Row]) -> None:
    """Three tables: steps, joints, and set-up with memory."""
    width = max(len(name) for name in rows)
    first = next(iter(rows.values()))
    print(
        f"{first['ranks']} rank(s), {first['repeats']} repeat(s), load average "
        f"{first['load_average']:.1f} on {os.cpu_count()} processors.\n\n"
        "Milliseconds per step, medians, the first step left out. Ratios are jointed over\n"
        "linear: of wall times, with their range over the repeats; of processor times, which\n"
        "others on the machine disturb less; of mean wall times, which rare expensive steps\n"
        "enter; least: were a jointed step the linear one, a second back-substitution and its\n"
        "iteration on the joints [ms] alone. solves: a step over one back-substitution of the\n"
        "same run, median wall times; 1 is the limit of a linear step, 2 of a jointed one.\n"
    )
    print(
        f"{'':{width}}                      linear ms              jointed ms             ratios\n"
        f"{'scene':{width}}    dofs points steps     wall    cpu  solves     wall    cpu  solves"
        "   wall (range)         cpu  means  least  iteration  solver"
    )
    for name, row in rows.items():
        low, high = row["ratio_range"]
        print(
            f"{name:{width}} {row['dofs']:7d} {row['joint_points']:6d} {row['steps']:5d}"
            f" {row['linear_ms']:8.2f} {row['linear_cpu_ms']:6.2f} {row['linear_over_solve']:7.2f}"
            f" {row['joints_ms']:8.2f} {row['joints_cpu_ms']:6.2f} {row['joints_over_solve']:7.2f}"
            f" {row['ratio']:6.2f} {f'({low:.2f} to {high:.2f})':16}"
            f" {row['ratio_cpu']:4.2f} {row['ratio_mean']:6.2f}"
            f" {row['ratio_least']:6.2f} {row['joints_iteration_ms']:10.2f}  {row['solver']}"
        )
    print_disturbance(rows.values())
    print(
        "\nNewton iterations per step; mean share of the joint points by state; rejected\n"
        "attempts; ledger: what all energy lines leave unexplained, over the largest energy;\n"
        "crest peaks.\n"
    )
    print(
        f"{'scene':{width}}  Newton mean  max   open  stick   slip   cut   ledger"
        "   crest peaks x, y, z [mm], tied -> jointed"
    )
    for name, row in rows.items():
        tied, jointed = (
            ", ".join(f"{p:.4g}" for p in row[key]) for key in ("tied_peaks_mm", "joint_peaks_mm")
        )
        shares = " ".join(f"{100 * row[key]:4.0f} %" for key in ("open", "stick", "slip"))
        print(
            f"{name:{width}} {row['newton_mean']:12.2f} {row['newton_max']:4d} {shares}"
            f" {row['cut']:5d}  {row['ledger']:.1e}   {tied} -> {jointed}"
        )
    print(
        "\nSeconds of the set-up and of the whole run, from reading the mesh to the last step;\n"
        "compliance is what the first step takes besides the factor. Peak memory [MiB] by phase,\n"
        "with what earlier phases still hold.\n"
    )
    print(
        f"{'scene':{width}} {'run':8}   mesh assembly statics factor compliance   whole run    cpu"
        "   MiB: model statics steps"
    )
    for name, row in rows.items():
        for run, label in (("linear", "linear"), ("joints", "jointed")):
            s, mb = row[f"{run}_setup_s"], row[f"{run}_peaks_mb"]
            print(
                f"{name:{width}} {label:8} {s['mesh']:6.2f} {s['assembly']:8.2f} "
                f"{s['statics']:7.2f} {s['factor']:6.2f} {s['compliance']:10.2f} "
                f"{row[f'{run}_total_s']:11.2f} {row[f'{run}_total_cpu_s']:6.2f} "
                f"{mb['model']:12.0f} {mb['statics']:7.0f} "
                f"{mb['steps']:5.0f}"
            )


def print_supernodal(rows: dict[str, Row]) -> None:
    """A table of steps beside those by CHOLMOD's factor alone."""
    width = max(len(name) for name in rows)
    print(
        "\nThe same runs by CHOLMOD's factor alone, in turn: steps and back-substitutions [ms];\n"
        "these steps and those above over one of these back-substitutions.\n"
    )
    print(f"{'scene':{width}} {'run':8}     step    solve   its step   step above")
    for name, row in rows.items():
        for run, label in (("linear", "linear"), ("joints", "jointed")):
            step, solve = (row[f"{run}_supernodal_{kind}"] for kind in ("ms", "solve_ms"))
            print(
                f"{name:{width}} {label:8} {step:8.2f} {solve:8.2f}"
                f" {step / solve:10.2f} {row[f'{run}_ms'] / solve:12.2f}"
            )


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", nargs="*", default=["coarse"], choices=sorted(DIVISIONS))
    parser.add_argument(
        "--pressure",
        nargs="*",
        type=float,
        default=[],
        metavar="MPA",
        help="run the walls with these pressures on their end faces as well",
    )
    parser.add_argument("--dam", action="store_true", help="also the dam of demo 03, 8k dofs")
    parser.add_argument("--dam-middle", action="store_true", help="also a finer one, 15k dofs")
    parser.add_argument("--dam-fine", action="store_true", help="also the finest, 43k dofs")
    parser.add_argument(
        "--steps",
        type=at_least(1),
        default=TIED_STEPS,
        help=f"time steps of 0.00488 s ({DAM_STEPS} are the whole motion of the dam)",
    )
    parser.add_argument(
        "--repeat", type=at_least(1), default=1, help="runs over which medians are taken"
    )
    parser.add_argument(
        "--supernodal",
        action="store_true",
        help="also the same runs by CHOLMOD's factor alone, in turn",
    )
    parser.add_argument("--solver", default="auto", choices=get_args(SolverKind))
    parser.add_argument("--quick", action="store_true", help="the tiny wall alone")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    return parser.parse_args(arguments)


def scenes(options: argparse.Namespace) -> list[Scene]:
    """What is to be run."""
    if options.quick:
        return [wall("tiny")]
    chosen = [wall(m, pressure=p) for m in options.mesh for p in (0.0, *options.pressure)]
    return [
        *chosen,
        *([dam("dam")] if options.dam else []),
        *([dam("dam middle")] if options.dam_middle else []),
        *([dam("dam fine")] if options.dam_fine else []),
    ]


def main(arguments: list[str] | None = None) -> dict[str, Row]:
    """Print tables, or one JSON object as the last line."""
    options = parse_arguments(arguments)
    rows = {
        scene.name: measure(
            scene, options.steps, options.solver, options.repeat, options.supernodal
        )
        for scene in scenes(options)
    }
    if MPI.COMM_WORLD.rank == 0:
        print_tables(rows)
        if options.supernodal:
            print_supernodal(rows)
        if options.json:
            print(json.dumps(rows))
    return rows


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    main()
