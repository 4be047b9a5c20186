#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parts of the run time, and their growth with the dofs and with the joint points.

There are two series of the jointed wall. One is refined with fewer joints, so that the number of
joint points remains near one thousand (with ``--large``, a single joint has 2800). The other is one
mesh with more and more joints. Each case runs tied and with joints.

The table also has the times of one back-substitution with the bulk and of the compiled iteration on
the joints. Times are medians over all steps except the first, of the slowest rank. Growth is the
exponent p of time ~ n^p, fitted over the series.

One rank uses CHOLMOD if PETSc has it, or MUMPS with ``--linear mumps``; several ranks use MUMPS.
For parts limited by memory, the table has the bandwidth of a triad, a = b + s c, on the same ranks.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, get_args

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.jointed_wall import PHASES, measure
from benchmarks.shared.measure import bandwidth, print_disturbance
from benchmarks.shared.scenes import Wall, wall
from benchmarks.shared.tables import head
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.solvers.effective_matrix import LinearSolver
from dolfinx_joints.solvers.step_solver import ComplianceKind

STEPS = {
    "linear": "linear_ms",
    "jointed": "joints_ms",
    "linear, processor": "linear_cpu_ms",
    "jointed, processor": "joints_cpu_ms",
    "one back-substitution": "joints_solve_ms",
    "iteration on the joints": "joints_iteration_ms",
}
Series = dict[str, dict[str, Wall]]

SERIES: Series = {
    "dofs": {
        "7k dofs": ((20, 4, 20), 9),
        "50k dofs": ((40, 8, 40), 3),
        "250k dofs": ((72, 14, 72), 1),
    },
    "points": {
        "0.4k points": ((56, 8, 40), 1),
        "1k points": ((56, 8, 40), 3),
        "3k points": ((56, 8, 40), 7),
    },
}
LARGE: Series = {
    "dofs": {"1M dofs": ((116, 23, 116), 1)},
    "points": {"7k points": ((40, 8, 40), 19), "10k points": ((56, 8, 40), 27)},
}
QUICK: Series = {
    "dofs": {"1k dofs": ((8, 2, 8), 3), "3k dofs": ((12, 3, 12), 2)},
    "points": {"27 points": ((8, 2, 8), 1), "81 points": ((8, 2, 8), 3)},
}
CASES = [name for series in (SERIES, LARGE, QUICK) for cases in series.values() for name in cases]


# ---------------------------------------------------------------- cases


def measure_case(name: str, case: Wall, options: argparse.Namespace) -> dict[str, Any]:
    """Return the row of a wall, tied and with joints (collective)."""
    divisions, joints = case
    scene = wall(name, divisions=divisions, joints=joints)
    given = dj.SolverOptions(linear=options.linear, compliance=options.compliance)
    return measure(scene, options.steps, options=given) | {"bandwidth_gb_s": bandwidth() / 1e9}


def times(row: dict[str, Any]) -> dict[str, float]:
    """Return the times of a row under the names of the table."""
    return row["joints_setup_s"] | {name: row[key] for name, key in STEPS.items()}


def growth(rows: Sequence[dict[str, Any]], over: str) -> dict[str, float]:
    """Return exponents p of time ~ n^p for all times above 0, with n dofs or joint points."""
    size = np.log([row[over] for row in rows])
    exponents = {}
    for name in times(rows[0]):
        values = np.array([times(row)[name] for row in rows])
        if len(rows) > 1 and np.all(values > 0.0):
            exponents[name] = float(np.polyfit(size, np.log(values), 1)[0])
    return exponents


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Run all series (collective)."""
    table: Series = QUICK if options.quick else SERIES
    by_series: dict[str, Any] = {}
    for series in options.series:
        cases = dict(table[series])
        if options.large:
            cases |= LARGE[series]
        rows = {
            name: measure_case(name, case, options)
            for name, case in cases.items()
            if options.cases is None or name in options.cases
        }
        over = "dofs" if series == "dofs" else "joint_points"
        if rows:
            by_series[series] = {"cases": rows, "growth": growth(list(rows.values()), over)}
    return by_series


# ---------------------------------------------------------------- tables


def print_series(name: str, series: dict[str, Any]) -> None:
    """Print a column for each case, a row for each number, the growth in the last column."""
    rows = series["cases"]
    of = "dofs" if name == "dofs" else "joint points"
    first = next(iter(rows.values()))
    print(
        f"\nGrowth with the {of}; {first['ranks']} rank(s), {first['steps']} steps, load average "
        f"{first['load_average']:.1f} on {os.cpu_count()} processors\n"
    )
    lines = {
        "dofs": "{dofs}",
        "joint points": "{joint_points}",
        "solver": "{solver}",
        "Newton per step": "{newton_mean:.2f}",
        "peak memory [MiB]": "{joints_peak_mb:.0f}",
        "triad, all ranks [GB/s]": "{bandwidth_gb_s:.1f}",
        **{f"{phase} [s]": f"{{joints_setup_s[{phase}]:.3g}}" for phase in PHASES},
        **{f"step: {label} [ms]": f"{{{key}:.3g}}" for label, key in STEPS.items()},
        "jointed / linear": "{ratio:.2f}",
        "processor times": "{ratio_cpu:.2f}",
    }
    exponents = {
        f"{time} [s]" if time in PHASES else f"step: {time} [ms]": exponent
        for time, exponent in series["growth"].items()
    }
    print(head(f"| | {' | '.join(rows)} | growth |"))
    for label, form in lines.items():
        cells = " | ".join(form.format_map(row) for row in rows.values())
        growth = f"n^{exponents[label]:.2f}" if label in exponents else "-"
        print(f"| {label} | {cells} | {growth} |")
    print_disturbance(rows.values())


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", nargs="+", default=list(SERIES), choices=list(SERIES))
    parser.add_argument("--steps", type=at_least(1), default=30)
    parser.add_argument(
        "--large", action="store_true", help="also 1M dofs, 7k and 10k joint points"
    )
    parser.add_argument("--quick", action="store_true", help="tiny walls")
    parser.add_argument("--cases", nargs="+", choices=CASES, help="run only these walls")
    parser.add_argument("--linear", choices=get_args(LinearSolver), default="auto")
    parser.add_argument("--compliance", choices=get_args(ComplianceKind), default="auto")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Print tables, or one JSON object as the last line."""
    options = parse_arguments(sys.argv[1:] if arguments is None else arguments)
    by_series = run(options)
    if MPI.COMM_WORLD.rank == 0:
        for name in by_series:
            print_series(name, by_series[name])
        if options.json:
            print(json.dumps(by_series))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    main()
