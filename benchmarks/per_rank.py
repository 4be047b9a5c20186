#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a rank has to hold and to send: memory, messages and bytes of jointed steps.

The wall of the other benchmarks, cut by ``--joints``, runs on each number of ranks under mpirun, as
many processes as there are, whether they have a processor each or not. Memory is the largest of a
rank above what the bare process takes once everything is imported. Messages and bytes are those
that a rank sends in a step, the first left out: products of PETSc, its sums, and what the joint
solver sends itself; a collective one counts as one, with what the rank gives. Those inside MUMPS
are not counted. Results are compared with those of the first number of ranks.
"""

from __future__ import annotations

import argparse
import ctypes
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
from benchmarks.shared.measure import progress
from benchmarks.shared.scenes import TIME_STEP, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.mpi import gathered, of_ranks
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.solvers.interface.ranked_low_rank import RankedLowRankMatrix
from dolfinx_joints.solvers.interface.row_matrix import Parts


class Watch(Monitor):
    """Gaps of all points after the last step, on rank 0, and what was sent in steps but the first.

    Args:
        sent: Counts it.
    """

    def __init__(self, sent: Sent) -> None:
        """Nothing is seen yet."""
        self._sent, self.at_first = sent, (0.0, 0.0)

    def record(self, record: Any) -> None:
        """Take note of a step (collective)."""
        if record.step == 1:
            self.at_first = self._sent.total()
        self.at_last = self._sent.total()
        gaps = gathered(MPI.COMM_WORLD, record.joints.state.gap)
        self.gaps = None if gaps is None else gaps.tolist()


def largest_mb() -> float:
    """Largest memory of this process so far [MiB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024.0


def run(options: argparse.Namespace) -> dict[str, Any] | None:
    """Some steps on the ranks of this program; what they took, on rank 0 (collective)."""
    scene, watch = wall("wall", divisions=options.divisions, joints=options.joints), Watch(Sent())
    bare, length = largest_mb(), options.steps * TIME_STEP
    with scene.mesh_file() as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    simulation = dj.Simulation(
        model,
        options=dj.SolverOptions(linear=options.linear, compliance=options.compliance),
        monitors=[watch],
    )
    simulation.statics(steps=scene.load_steps)
    simulation.dynamics(dt=TIME_STEP, steps=options.steps, motion=scene.strong_shaking(length))
    sent = np.subtract(watch.at_last, watch.at_first) / (options.steps - 1)
    rows = MPI.COMM_WORLD.gather((largest_mb() - bare, *sent))
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
        "gaps": watch.gaps,
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
        library = ctypes.CDLL(None)
        of_petsc = [
            ctypes.c_double.in_dll(library, f"petsc_{name}").value
            for name in ("isend_ct", "send_ct", "allreduce_ct", "isend_len", "send_len")
        ]
        return self.messages + sum(of_petsc[:3]), self.bytes + sum(of_petsc[3:])


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


def print_table(rows: Sequence[dict[str, Any]]) -> None:
    """One line for each number of ranks."""
    first = rows[0]
    print(
        f"{first['dofs']} dofs, {first['points']} joint points, bare {first['bare_mb']:.0f} MiB\n"
    )
    print("ranks  MiB per rank  of the first  messages  kB sent  largest difference of gaps")
    for row in rows:
        gaps, expected = np.array(row["gaps"]), np.array(first["gaps"])
        error = np.abs(gaps - expected).max() / np.abs(expected).max()
        print(
            f"{row['ranks']:5d}  {row['memory_mb']:12.0f}  "
            f"{row['memory_mb'] / first['memory_mb']:12.2f}  {row['messages']:8.0f}  "
            f"{row['bytes'] / 1e3:7.1f}  {error:.1e}"
        )
    print("\nMessages and bytes are per step and rank.")


def main(arguments: list[str] | None = None) -> None:
    """Run the comparison, or one of its runs under mpirun."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranks", nargs="+", type=at_least(1), default=[1, 2, 4, 8])
    parser.add_argument("--divisions", nargs=3, type=at_least(1), default=[40, 8, 40])
    parser.add_argument("--joints", type=at_least(1), default=3)
    parser.add_argument("--steps", type=at_least(2), default=5)
    parser.add_argument(
        "--linear", choices=("auto", "direct", "mumps", "iterative"), default="auto"
    )
    parser.add_argument("--compliance", default="auto")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child:
        found = run(options)
        if found is not None:
            print(json.dumps(found), flush=True)
        return
    given = sys.argv[1:] if arguments is None else arguments
    print_table([on_ranks(ranks, given) for ranks in options.ranks])


if __name__ == "__main__":
    main()
