#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a rank has to hold and to send, and whether all numbers of ranks give the same.

The wall of the other benchmarks, cut by ``--joints``, runs on each number of ranks under mpirun, as
many processes as there are, whether they have a processor each or not. Memory is the largest of a
rank above what the process takes once a tiny wall has gone the same way, so that all code that a
run needs is loaded. Messages and bytes are those
that a rank sends in a step, the first left out: products of PETSc, its sums, and what the joint
solver sends itself; a collective one counts as one, with what the rank gives. Those inside MUMPS
are not counted. Results are compared with those of the first number of ranks.

``--paths`` compares solvers instead: gaps and tractions of all joint points in all steps with those
of the first path on the first number of ranks, relative to the largest of the run::

    python3 -m benchmarks.per_rank --paths --ranks 1 2 3 4 --steps 20 --divisions 12 3 12

Exit status 1 if they differ by more than 1e-10.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import petsc_sent, progress
from benchmarks.shared.scenes import TIME_STEP, wall, wall_file
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.mpi import gathered, of_ranks
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.solvers.interface.ranked_low_rank import RankedLowRankMatrix
from dolfinx_joints.solvers.interface.row_matrix import Parts

PATHS = {
    "dense": ["--linear", "mumps", "--compliance", "dense"],
    "compressed": ["--linear", "mumps", "--compliance", "compressed"],
    "matrix-free": ["--linear", "mumps", "--compliance", "matrix-free"],
    "iterated": ["--linear", "iterative", "--solver", "condensed"],
    "multigrid": ["--linear", "iterative", "--solver", "monolithic", "--tolerance", "1e-13"],
}
BOUND = 1e-10
QUICK = (8, 2, 8)


class Watch(Monitor):
    """Gaps and tractions after each step, on rank 0, and what was sent in steps but the first.

    Args:
        sent: Counts it.
    """

    def __init__(self, sent: Sent) -> None:
        """Nothing is seen yet."""
        self._sent, self.at_first = sent, (0.0, 0.0)
        self.gaps: list[Any] = []
        self.tractions: list[Any] = []

    def record(self, record: Any) -> None:
        """Take note of a step (collective)."""
        if record.step == 1:
            self.at_first = self._sent.total()
        self.at_last = self._sent.total()
        self.gaps.append(gathered(MPI.COMM_WORLD, record.joints.state.gap))
        self.tractions.append(gathered(MPI.COMM_WORLD, record.joints.traction))


def largest_mb() -> float:
    """Largest memory of this process so far [MiB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024.0


def march(
    divisions: Sequence[int], joints: int, options: argparse.Namespace, watch: Watch
) -> tuple[dj.Model, dj.Outcome]:
    """Weight and some steps of a wall (collective)."""
    scene, length = wall("wall", divisions=divisions, joints=joints), options.steps * TIME_STEP
    with wall_file(divisions, joints) as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    simulation = dj.Simulation(
        model,
        solver=options.solver,
        options=dj.SolverOptions(
            linear=options.linear,
            compliance=options.compliance,
            relative_tolerance=options.tolerance,
        ),
        monitors=[watch],
    )
    simulation.statics(steps=scene.load_steps)
    motion = scene.strong_shaking(length)
    return model, simulation.dynamics(dt=TIME_STEP, steps=options.steps, motion=motion)


def run(options: argparse.Namespace) -> dict[str, Any] | None:
    """Some steps on the ranks of this program; what they took, on rank 0 (collective)."""
    sent = Sent()
    march(QUICK, 1, options, Watch(sent))
    bare, watch = largest_mb(), Watch(sent)
    model, outcome = march(options.divisions, options.joints, options, watch)
    by_step = np.subtract(watch.at_last, watch.at_first) / (options.steps - 1)
    rows = MPI.COMM_WORLD.gather((largest_mb() - bare, *by_step))
    if rows is None:
        return None
    memory, messages, size = np.array(rows).T
    return {
        "ranks": MPI.COMM_WORLD.size,
        "dofs": model.num_dofs,
        "points": model.contact.operator.num_points,
        "bare_mb": bare,
        "memory_mb": memory.max(),
        "messages": messages.mean(),
        "bytes": size.mean(),
        "solver": outcome.solver,
        "gaps": np.array(watch.gaps).tolist(),
        "tractions": np.array(watch.tractions).tolist(),
    }


class Sent:
    """Counts what this rank sends: what PETSc counts itself, and what the joint solver sends."""

    def __init__(self) -> None:
        """Watch the ways by which joint vectors go from rank to rank."""
        self.messages, self.bytes = 0.0, 0.0
        all_of, product = Parts.all_of, RankedLowRankMatrix.product

        def sums(comm: Any, values: Any) -> Any:
            self._add(comm.size > 1, np.asarray(values).nbytes)
            return of_ranks(comm, values)

        def parts(these: Parts, mine: Any) -> Any:
            self._add(len(these.counts) > 1, mine.nbytes)
            return all_of(these, mine)

        def blocks(matrix: RankedLowRankMatrix, vector: Any) -> Any:
            self._add(matrix.comm.size - 1, matrix.sent * matrix.own.dtype.itemsize)
            return product(matrix, vector)

        for module in list(sys.modules.values()):
            if getattr(module, "of_ranks", None) is of_ranks and module.__name__ != __name__:
                vars(module)["of_ranks"] = sums
        Parts.all_of, RankedLowRankMatrix.product = parts, blocks  # type: ignore[method-assign]

    def _add(self, messages: int, size: int) -> None:
        self.messages += messages
        self.bytes += size if messages else 0

    def total(self) -> tuple[float, float]:
        """Messages and bytes so far."""
        messages, size = petsc_sent()
        return self.messages + messages, self.bytes + size


def on_ranks(ranks: int, arguments: list[str]) -> dict[str, Any]:
    """A run in its own processes."""
    command = ["mpirun", "--map-by", ":OVERSUBSCRIBE", "-n", str(ranks), sys.executable]
    command += ["-m", "benchmarks.per_rank", *arguments, "--child"]
    progress(f"{ranks} rank(s)")
    done = subprocess.run(command, env=dict(os.environ), stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise SystemExit(f"per_rank: the run on {ranks} ranks failed.")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def difference(row: dict[str, Any], first: dict[str, Any], name: str) -> float:
    """Largest difference of a quantity in all steps, relative to its largest entry."""
    found, expected = np.array(row[name]), np.array(first[name])
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def print_table(rows: Sequence[dict[str, Any]]) -> None:
    """One line for each number of ranks."""
    first = rows[0]
    print(
        f"{first['dofs']} dofs, {first['points']} joint points, bare {first['bare_mb']:.0f} MiB\n"
    )
    print("ranks  MiB per rank  of the first  messages  kB sent  largest difference of gaps")
    for row in rows:
        print(
            f"{row['ranks']:5d}  {row['memory_mb']:12.0f}  "
            f"{row['memory_mb'] / first['memory_mb']:12.2f}  {row['messages']:8.0f}  "
            f"{row['bytes'] / 1e3:7.1f}  {difference(row, first, 'gaps'):.1e}"
        )
    print("\nMessages and bytes are per step and rank.")


def compare_paths(ranks: Sequence[int], arguments: list[str]) -> int:
    """A line for each path and number of ranks; 1 if two differ."""
    first, largest = None, 0.0
    print(f"{'path':12} {'solver':11} ranks  gaps differ by  tractions differ by")
    for path, options in PATHS.items():
        for number in ranks:
            row = on_ranks(number, [*arguments, *options])
            first = first or row
            found = [difference(row, first, name) for name in ("gaps", "tractions")]
            print(f"{path:12} {row['solver']:11} {number:5d}  {found[0]:14.1e}  {found[1]:.1e}")
            largest = max(largest, *found)
    print(f"\n{first['dofs']} dofs, {first['points']} joint points")
    return int(largest > BOUND)


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison, or one of its runs under mpirun; 1 if paths differ."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranks", nargs="+", type=at_least(1), default=[1, 2, 4, 8])
    parser.add_argument("--divisions", nargs=3, type=at_least(1), default=[40, 8, 40])
    parser.add_argument("--joints", type=at_least(1), default=3)
    parser.add_argument("--steps", type=at_least(2), default=5)
    parser.add_argument(
        "--linear", choices=("auto", "direct", "mumps", "iterative"), default="auto"
    )
    parser.add_argument("--compliance", default="auto")
    parser.add_argument("--solver", choices=("auto", "condensed", "monolithic"), default="auto")
    parser.add_argument("--tolerance", type=float, default=1e-10, help="of Newton's method")
    parser.add_argument("--paths", action="store_true", help="compare all solvers")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child:
        found = run(options)
        if found is not None:
            print(json.dumps(found), flush=True)
        return 0
    given = sys.argv[1:] if arguments is None else arguments
    if options.paths:
        return compare_paths(options.ranks, given)
    print_table([on_ranks(ranks, given) for ranks in options.ranks])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
