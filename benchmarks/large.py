#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A million dofs from a .msh file: how long reading, assembly and a step take, and how much memory.

A wall of `geometry/jointed_wall.py` is written to a file and read from it, once as a body without
joints, for a linear step, and once with its joint, for a step in which that opens. Steps begin at
rest where the shaking is strong, without self weight, and nothing but the factor or the
preconditioner is kept, no compliance of the joints. Each run has a process of its own.

Exit status 1 if energies do not balance, or the joint does not open.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import time as clock
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import dolfinx_joints as dj
from benchmarks.shared.measure import (
    BACK_SUBSTITUTION,
    FACTOR,
    Phases,
    StepWatch,
    load_average,
    petsc_seconds,
    progress,
    run_alone,
)
from benchmarks.shared.scenes import TIME_STEP, wall
from dolfinx_joints.solvers.effective_matrix import LinearSolver

DIVISIONS, JOINTS = (116, 24, 116), 1
KINDS = ("linear", "joints")
LARGEST_LEDGER = 1e-9
GIGA = 2**30
# What a factor or a preconditioner takes to be made, and what solves with them take.
SET_UP, SOLVES = (*FACTOR, "PCSetUp"), ("KSPSolve", *BACK_SUBSTITUTION)


def write(mesh: Path, divisions: tuple[int, int, int], joints: int) -> None:
    """The file that is read."""
    wall("large", divisions=divisions, joints=joints).write(mesh)


def measure(kind: str, mesh: Path, options: argparse.Namespace) -> dict[str, Any]:
    """A run with joints or without."""
    warnings.filterwarnings("ignore", "Loads act suddenly")  # only the cost of steps is measured
    if options.memory:
        resource.setrlimit(resource.RLIMIT_AS, (int(options.memory * GIGA),) * 2)
    scene = wall("large", divisions=options.divisions, joints=options.joints)
    tied, phases, watch = kind == "linear", Phases(), StepWatch(scene)
    with phases.phase("mesh"):
        jointed = scene.read(mesh, tied=tied)
    progress(f"{kind}: the mesh is read, {phases.seconds['mesh']:.0f} s")
    with phases.phase("assembly"):
        model = scene.model(jointed, None if tied else scene.law())
    progress(f"{kind}: {model.num_dofs} dofs are assembled, {phases.seconds['assembly']:.0f} s")
    newton = dj.SolverOptions(linear=options.linear, compliance="matrix-free", max_iterations=100)
    simulation = dj.Simulation(model, monitors=[watch], options=newton)
    petsc_seconds(SET_UP)
    with phases.phase("steps"):
        motion = scene.strong_shaking(options.steps * TIME_STEP)
        end = simulation.dynamics(dt=TIME_STEP, steps=options.steps, motion=motion)
    return {
        "kind": kind,
        "linear": options.linear,
        "dofs": model.num_dofs,
        "cells": int(jointed.mesh.topology.index_map(3).size_global),
        "joint_points": model.operator.num_points if model.operator else 0,
        "seconds": phases.seconds,
        "peaks_mb": phases.peaks_mb,
        "set_up_s": petsc_seconds(SET_UP),
        "solves_s": petsc_seconds(SOLVES),
        "step_s": [ms / 1e3 for ms in watch.wall],
        "step_cpu_s": [ms / 1e3 for ms in watch.cpu],
        "newton": watch.iterations,
        "opened": max((share[0] for share in watch.shares), default=0.0),
        "ledger": end.imbalance,
    }


def run(kind: str, mesh: Path, options: argparse.Namespace) -> dict[str, Any]:
    """A run in a process of its own."""
    return run_alone(
        "large",
        *("--kinds", kind, "--mesh", str(mesh), "--divisions", *map(str, options.divisions)),
        *("--joints", str(options.joints), "--steps", str(options.steps)),
        *("--linear", options.linear, "--memory", str(options.memory)),
    )


def print_table(rows: list[dict[str, Any]]) -> None:
    """A line for each run, and its steps."""
    print(
        f"Bulk: {rows[0]['linear']}. Load average {load_average():.1f} on {os.cpu_count()} "
        "processors. Wall times [s]; set-up: of the factor or the\npreconditioner, inside the "
        "first step; peak: largest memory of reading, assembly and steps [MiB];\nopen: largest "
        "share of joint points.\n\n"
        "run         dofs  read  assembly  set-up  first step (processor)   peak: read  assembly"
        "   steps  Newton  open   ledger"
    )
    for row in rows:
        seconds, peaks = row["seconds"], row["peaks_mb"]
        print(
            f"{row['kind']:7} {row['dofs']:8d} {seconds['mesh']:5.0f} {seconds['assembly']:9.0f}"
            f" {row['set_up_s']:7.0f} {row['step_s'][0]:11.0f} {row['step_cpu_s'][0]:11.0f}"
            f" {peaks['mesh']:12.0f} {peaks['assembly']:9.0f} {peaks['steps']:7.0f}"
            f" {row['newton'][0]:7d} {row['opened']:5.2f} {row['ledger']:8.0e}"
        )
        for i, more in enumerate(zip(row["step_s"][1:], row["step_cpu_s"][1:], strict=True), 2):
            print(f"        step {i}: {more[0]:.0f} ({more[1]:.0f}), {row['newton'][i - 1]} Newton")


def passed(row: dict[str, Any]) -> bool:
    """Whether energies balance, and a joint has opened where there is one."""
    balanced = row["ledger"] is not None and row["ledger"] <= LARGEST_LEDGER
    return bool(balanced and (row["kind"] == "linear" or row["opened"] > 0.0))


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if a run is not sound."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--divisions", nargs=3, type=int, help="cells along x, y, z")
    parser.add_argument("--joints", type=int, default=JOINTS, help="number of joints")
    parser.add_argument(
        "--linear", default="iterative", choices=get_args(LinearSolver), help="solver of the bulk"
    )
    parser.add_argument("--steps", type=int, default=1)
    parser.add_argument("--memory", type=float, default=0.0, help="limit of each run [GiB]")
    parser.add_argument("--mesh", type=Path, help="the file, if it has been written already")
    parser.add_argument("--quick", action="store_true", help="a small wall")
    parser.add_argument("--json", action="store_true", help="a JSON array as the last line")
    options = parser.parse_args(sys.argv[1:] if arguments is None else arguments)
    options.divisions = options.divisions or ((16, 4, 16) if options.quick else DIVISIONS)
    with TemporaryDirectory() as folder:
        mesh = options.mesh or Path(folder) / "large.msh"
        if options.mesh is None:
            began = clock.perf_counter()
            # Gmsh would keep gigabytes beside the runs.
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as other:
                other.submit(write, mesh, tuple(options.divisions), options.joints).result()
            size = mesh.stat().st_size / 2**20
            progress(f"{size:.0f} MiB are written in {clock.perf_counter() - began:.0f} s")
        if len(options.kinds) == 1:
            rows = [measure(options.kinds[0], mesh, options)]
        else:
            rows = [run(kind, mesh, options) for kind in options.kinds]
    print_table(rows)
    if options.json:
        print(json.dumps(rows))
    return int(not all(map(passed, rows)))


if __name__ == "__main__":
    raise SystemExit(main())
