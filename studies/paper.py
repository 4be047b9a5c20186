# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Analysis of the 1992 paper in one command: runs, figures 3 to 19, report.

    ./with-dolfinx python3 -m studies.paper --record DIRECTORY   # three AT2 files of one record
    ./with-dolfinx python3 -m studies.paper --quick              # a coarse mesh, two seconds

The linear and the jointed dam are run at the paper's step with the energy-consistent scheme and
with Newmark's scheme, which is closer to the paper's. Runs on a finer mesh and at half the step
give an error estimate. Existing runs with the same parameters are kept.
"""

from __future__ import annotations

import sys
import time as clock
from dataclasses import replace
from pathlib import Path

import numpy as np

from dolfinx_joints import JointsError, Results, report
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.study import Study, Table
from studies.ambiesta import Case, Which, parameters, study_row
from studies.figures import paper_figures
from studies.paper_statements import add_statements
from studies.tables import print_statements, print_tables

FINER = np.sqrt(0.5)
QUICK = {"size": 8.0, "steps": 410}


def grid(base: Case) -> dict[str, tuple[Case, Which]]:
    """Return the cases by name: the paper's, in both schemes, on a finer mesh, at half the step."""
    variants = {
        "paper": base,
        "newmark": replace(base, scheme="newmark"),
        "finer_mesh": replace(base, size=round(float(FINER * base.size), 2)),
        "half_step": replace(base, time_step=base.time_step / 2, steps=2 * base.steps),
    }
    kinds: tuple[Which, ...] = ("joints", "linear")
    return {f"{name}_{kind}": (case, kind) for name, case in variants.items() for kind in kinds}


def make_study(base: Case, out: Path) -> Study:
    """Return the runs as a study in a folder."""
    cases = {name: parameters(c, kind, envelopes=True) for name, (c, kind) in grid(base).items()}
    return Study(out / "runs", study_row, cases)


def result(study: Study, name: str) -> Path:
    """Return the results file of a case."""
    return study.folder(name) / f"{name.rsplit('_', 1)[1]}.h5"


def print_costs(table: Table) -> None:
    """Print dofs, energy error, iterations, seconds and memory of each run."""
    print("run                   dofs   energy error   iterations/step   run [s]   peak [MB]")
    for row in zip(
        *(table[n] for n in ("case", "dofs", "energy_error", "iterations", "steps")),
        *(table[n] for n in ("seconds", "peak_mb")),
        strict=True,
    ):
        name, dofs, error, iterations, steps, seconds, peak = row
        per_step = iterations / steps
        print(f"{name:<18} {dofs:7.0f} {error:14.1e} {per_step:17.2f} {seconds:9.1f} {peak:11.0f}")


def main(arguments: list[str] | None = None) -> None:
    """Run the cases, draw the figures, write the report."""
    parser = Parser(description="The analysis of the 1992 paper.")
    parser.add_argument("--record", help="folder with three AT2 files (default: synthetic motion)")
    parser.add_argument("--out", type=Path, default=Path("output/paper"), help="output folder")
    parser.add_argument(
        "--active-height",
        type=float,
        default=Case().active_height,
        help="relative height up to which the joints are active (default %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="a coarse mesh and two seconds")
    parser.add_argument("--workers", type=at_least(1), default=2, help="parallel runs (default 2)")
    parser.add_argument(
        "--again", action="store_true", help="repeat runs whose parameters have changed"
    )
    options = parser.parse_args(arguments)
    began = clock.perf_counter()
    base = Case(
        record_folder=options.record,
        active_height=options.active_height,
        **(QUICK if options.quick else {}),
    )
    study = make_study(base, options.out)
    tally = study.run(workers=options.workers, retry_failed=True, rerun_changed=options.again)
    if tally.skipped:
        print(f"kept from earlier runs in {study.path}: {', '.join(tally.skipped)}")
    if tally.failed:
        raise JointsError(f"Runs in {study.path} have failed: {tally}")
    print_costs(study.table())
    print()
    with (
        Results(result(study, "paper_linear")) as linear,
        Results(result(study, "paper_joints")) as joints,
    ):
        print_tables(linear, joints)
        print_statements(linear, joints)
        figures = paper_figures(linear, joints, options.out)
    print(f"\n{len(figures)} figures in {options.out}")
    files = [result(study, name) for name in study.cases]
    written = report.write(files, options.out / "report.html", add=add_statements)
    print(f"report: {written}\n{clock.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    try:
        main()
    except (JointsError, ValueError) as error:
        print(f"studies.paper: {error}", file=sys.stderr)
        raise SystemExit(2) from None
