#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the time goes, and how it grows with the dofs and with the joint points.

Two series of the jointed wall: refined with fewer and fewer joints, so that the number of joint
points stays near one thousand (except with ``--large``, where a single joint has 2800), and one
mesh cut by more and more joints. Each case runs tied and with joints.

Beside the time of a step are those of one back-substitution with the bulk and of the compiled
iteration on the joints, medians over the steps but the first; of several ranks the slowest counts.
Growth is the exponent p of time ~ n^p, fitted over the series.

One rank uses CHOLMOD where PETSc has it, several use MUMPS, unless ``--linear mumps`` has one rank
use it too. What waits for memory is compared with the bandwidth of a triad, a = b + s c, on as many
ranks.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import bandwidth, load_average, march, print_disturbance
from benchmarks.shared.scenes import Scene, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.solvers.effective_matrix import LinearSolver
from dolfinx_joints.solvers.step_solver import ComplianceKind

SETUP = ("mesh", "assembly", "statics", "factor", "compliance")
STEPS = {
    "linear": "linear_ms",
    "jointed": "joints_ms",
    "linear, processor": "linear_cpu_ms",
    "jointed, processor": "joints_cpu_ms",
    "one back-substitution": "solve_ms",
    "iteration on the joints": "iteration_ms",
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A wall: cells along x, y, z and the number of joints."""

    divisions: tuple[int, int, int]
    joints: int

    def scene(self, name: str) -> Scene:
        """The scene."""
        return wall(name, divisions=self.divisions, joints=self.joints)


Series = dict[str, dict[str, Case]]

SERIES: Series = {
    "dofs": {
        "7k dofs": Case(divisions=(20, 4, 20), joints=9),
        "50k dofs": Case(divisions=(40, 8, 40), joints=3),
        "250k dofs": Case(divisions=(72, 14, 72), joints=1),
    },
    "points": {
        "0.4k points": Case(divisions=(56, 8, 40), joints=1),
        "1k points": Case(divisions=(56, 8, 40), joints=3),
        "3k points": Case(divisions=(56, 8, 40), joints=7),
    },
}
LARGE: Series = {
    "dofs": {"1M dofs": Case(divisions=(116, 23, 116), joints=1)},
    "points": {
        "7k points": Case(divisions=(40, 8, 40), joints=19),
        "10k points": Case(divisions=(56, 8, 40), joints=27),
    },
}
QUICK: Series = {
    "dofs": {
        "1k dofs": Case(divisions=(8, 2, 8), joints=3),
        "3k dofs": Case(divisions=(12, 3, 12), joints=2),
    },
    "points": {
        "27 points": Case(divisions=(8, 2, 8), joints=1),
        "81 points": Case(divisions=(8, 2, 8), joints=3),
    },
}
CASES = [name for table in (SERIES, LARGE, QUICK) for cases in table.values() for name in cases]


# ---------------------------------------------------------------- cases


def measure(name: str, case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """A case, tied and with joints (collective)."""
    scene, steps = case.scene(name), options.steps
    given = dj.SolverOptions(linear=options.linear, compliance=options.compliance)
    with scene.mesh_file() as mesh:
        linear = march(scene, mesh, steps, law=None, options=given)
        joints = march(scene, mesh, steps, law=scene.law(), options=given)
    return {
        "dofs": joints.dofs,
        "joint_points": joints.points,
        "steps": steps,
        "ranks": MPI.COMM_WORLD.size,
        "load_average": load_average(),
        "bandwidth": bandwidth(),
        "solver": joints.facts["solver"],
        "newton_mean": joints.facts["iterations"] / joints.facts["accepted"],
        "ledger": joints.facts["ledger"],
        "linear_ms": linear.step_ms,
        "joints_ms": joints.step_ms,
        "ratio": joints.step_ms / linear.step_ms,
        "ratio_cpu": joints.step_cpu_ms / linear.step_cpu_ms,
        "linear_cpu_ms": linear.step_cpu_ms,
        "joints_cpu_ms": joints.step_cpu_ms,
        "solve_ms": joints.solve_ms,
        "iteration_ms": joints.iteration_ms,
        "setup_s": joints.seconds,
        "linear_setup_s": linear.seconds,
        "peak_mb": joints.peak_mb,
        "linear_peak_mb": linear.peak_mb,
    }


def numbers(row: dict[str, Any]) -> dict[str, float]:
    """All times of a row under the names of the table."""
    return {
        **row["setup_s"],
        **{name: row[key] for name, key in STEPS.items()},
    }


def growth(rows: Sequence[dict[str, Any]], over: str) -> dict[str, float]:
    """Exponents p of time ~ n^p for every time above 0, n the dofs or the joint points."""
    size = np.log([row[over] for row in rows])
    found = {}
    for name in numbers(rows[0]):
        times = np.array([numbers(row)[name] for row in rows])
        if len(rows) > 1 and np.all(times > 0.0):
            found[name] = float(np.polyfit(size, np.log(times), 1)[0])
    return found


def run(options: argparse.Namespace) -> dict[str, Any]:
    """All series (collective)."""
    table: Series = QUICK if options.quick else SERIES
    found: dict[str, Any] = {}
    for series in options.series:
        cases = dict(table[series])
        if options.large:
            cases |= LARGE[series]
        rows = {
            name: measure(name, case, options)
            for name, case in cases.items()
            if options.cases is None or name in options.cases
        }
        over = "dofs" if series == "dofs" else "joint_points"
        if rows:
            found[series] = {"cases": rows, "growth": growth(list(rows.values()), over)}
    return found


# ---------------------------------------------------------------- tables


def print_series(name: str, found: dict[str, Any]) -> None:
    """A column for each case, a row for each time, the growth at the end."""
    rows, exponents = found["cases"], found["growth"]
    of = "dofs" if name == "dofs" else "joint points"
    first = next(iter(rows.values()))
    print(
        f"\nGrowth with the {of}; {first['ranks']} rank(s), {first['steps']} steps, load average "
        f"{first['load_average']:.1f} on {os.cpu_count()} processors\n"
    )

    def line(label: str, values: Sequence[str], last: str = "") -> None:
        print(f"{label:24}" + "".join(f"{value:>14}" for value in values) + f"{last:>10}")

    line("", list(rows), "growth")
    for label, key in (("dofs", "dofs"), ("joint points", "joint_points"), ("solver", "solver")):
        line(label, [str(row[key]) for row in rows.values()])
    line("Newton per step", [f"{row['newton_mean']:.2f}" for row in rows.values()])
    line("peak memory [MiB]", [f"{row['peak_mb']:.0f}" for row in rows.values()])
    line("triad, all ranks [GB/s]", [f"{row['bandwidth'] / 1e9:.1f}" for row in rows.values()])
    for title, labels in (
        ("set-up [s]", SETUP),
        ("step, median [ms]", tuple(STEPS)),
    ):
        print(title)
        for label in labels:
            values = [f"{numbers(row)[label]:.3g}" for row in rows.values()]
            exponent = f"n^{exponents[label]:.2f}" if label in exponents else "-"
            line(f"  {label}", values, exponent)
    for label, key in (("jointed / linear", "ratio"), ("  processor times", "ratio_cpu")):
        line(label, [f"{row[key]:.2f}" for row in rows.values()])
    print_disturbance(rows.values())


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    """Options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", nargs="+", default=list(SERIES), choices=list(SERIES))
    parser.add_argument("--steps", type=at_least(1), default=30)
    parser.add_argument(
        "--large", action="store_true", help="also 1M dofs, 7k and 10k joint points"
    )
    parser.add_argument("--quick", action="store_true", help="tiny walls")
    parser.add_argument("--cases", nargs="+", choices=CASES, help="some of the walls alone")
    parser.add_argument("--linear", choices=get_args(LinearSolver), default="auto")
    parser.add_argument("--compliance", choices=get_args(ComplianceKind), default="auto")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Print tables, or one JSON object as the last line."""
    options = parse_arguments(sys.argv[1:] if arguments is None else arguments)
    found = run(options)
    if MPI.COMM_WORLD.rank == 0:
        for name in found:
            print_series(name, found[name])
        if options.json:
            print(json.dumps(found))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    main()
