#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time and memory of steps on a cluster, from constants measured on one machine.

It reads the rows that `large_bodies` prints, of walls of several sizes on one rank and on several,
in any number of files::

    python3 -m benchmarks.large_bodies --sizes 1e5 "1e4 points" --json > one.txt
    mpirun -n 8 python3 -m benchmarks.large_bodies --sizes 1e5 "1e4 points" --json > eight.txt
    python3 -m benchmarks.cluster_model one.txt eight.txt

A step takes I iterations of the linear solver and N of Newton's method. On one rank with n dofs and
m joint points its processor time is

    t = a I n + b N n + c N m + d I m,

a the products of the levels, b the residual, c tangent and levels of the joints, d their products;
its memory is bare + A n + B m. All but the bare process falls to each rank's share. Time waits for
memory: constants count as bytes at the bandwidth of one core here, and are slower where cores of a
node have less each. Messages per iteration are k for each neighbour, 26 at most, and their bytes go
with the surface of the share, (n / ranks)^(2/3); both are measured on several ranks. A sum over all
ranks is one message for each doubling of the ranks; nothing overlaps.

Constants are fitted with rows of one rank up to ``--fitted`` dofs; larger ones, which they have not
seen, come first in what is printed, measured beside predicted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from dolfinx_joints.common.command_line import Parser, at_least

NEIGHBOURS = 26
Row = dict[str, Any]


def rows_of(files: Sequence[Path]) -> list[Row]:
    """Rows of all files."""
    found: list[Row] = []
    for file in files:
        lines = [line for line in file.read_text().splitlines() if line.startswith("[{")]
        found += [row for line in lines for row in json.loads(line)]
    return found


def work(row: Row) -> list[float]:
    """What the constants of time are multiplied with."""
    newton, points = row["newton"][1], row["joint_points"]
    corrections = newton if points else 0.0
    n, its = row["dofs"], row["iterations"]
    return [its * n, corrections * n, corrections * points, its * points]


def fitted(table: Sequence[Sequence[float]], found: Sequence[float]) -> np.ndarray:
    """Constants, none below zero, with the least sum of squares of relative errors."""
    target = np.array(found)
    constants: np.ndarray = nnls(np.array(table) / target[:, None], np.ones(len(target)))[0]
    return constants


class Model:
    """Constants of the rows of one rank and of several.

    Attributes:
        time: a, b, c, d [s].
        memory: Of the bare process, a dof and a joint point [MiB].
        messages: Of an iteration to each neighbour.
        surface: Bytes of an iteration over (n / ranks)^(2/3) and neighbours.
    """

    def __init__(self, alone: Sequence[Row], together: Sequence[Row]) -> None:
        """Fit them."""
        if not alone or not together:
            raise SystemExit("cluster_model: it takes rows of one rank and of several.")
        self.time = fitted([work(row) for row in alone], [row["step_cpu_s"] for row in alone])
        self.memory = fitted([sizes(row) for row in alone], [row["peak_mb"] for row in alone])
        neighbours = np.array([min(row["ranks"] - 1, NEIGHBOURS) for row in together])
        its = np.array([row["iterations"] for row in together])
        share = np.array([row["dofs"] / row["ranks"] for row in together])
        messages, size = (
            np.array([row[name] for row in together]) / its / neighbours
            for name in ("messages", "bytes")
        )
        self.messages, self.surface = messages.max(), (size / share ** (2 / 3)).max()

    def step(self, row: Row, ranks: int, machine: argparse.Namespace) -> tuple[float, float]:
        """Seconds of a step in computing and in communication."""
        slower = machine.bandwidth / (machine.node_bandwidth / machine.node_ranks)
        computing = slower * float(self.time @ work(row)) / ranks
        around, its = min(ranks - 1, NEIGHBOURS), row["iterations"]
        size = around * self.surface * (row["dofs"] / ranks) ** (2 / 3)
        wire = size * machine.node_ranks / machine.network
        calls = around * self.messages + math.log2(max(ranks, 1))
        return computing, its * (calls * machine.latency + wire)

    def megabytes(self, row: Row, ranks: int) -> float:
        """Memory of a rank [MiB]."""
        bare, *others = self.memory * sizes(row)
        return float(bare + sum(others) / ranks)


def sizes(row: Row) -> list[float]:
    """What the constants of memory are multiplied with."""
    return [1.0, row["dofs"], row["joint_points"]]


def print_checks(model: Model, rows: Sequence[Row]) -> None:
    """Measured beside predicted, of rows of one rank that the constants have not seen."""
    print("not fitted:   dofs  points   step: s  predicted   MiB  predicted")
    for row in rows:
        seconds = float(model.time @ work(row))
        print(
            f"{row['dofs']:18d} {row['joint_points']:7d} {row['step_cpu_s']:9.2f} {seconds:10.2f}"
            f" {row['peak_mb']:5.0f} {model.megabytes(row, 1):10.0f}"
        )


def print_table(model: Model, options: argparse.Namespace) -> None:
    """The body asked for on all numbers of ranks."""
    a, b, c, d = 1e9 * model.time
    bare, dof, point = model.memory
    print(
        f"\na {a:.0f} ns, b {b:.0f} ns, c {c:.0f} ns, d {d:.0f} ns; {bare:.0f} MiB bare, "
        f"{1024 * dof:.1f} KiB a dof, {1024 * point:.1f} KiB a joint point; "
        f"{model.messages:.0f} messages a neighbour and iteration\n\n"
        f"{options.dofs:.0f} dofs, {options.points:.0f} joint points\n"
        "ranks  linear: s  waiting  jointed: s  waiting  MiB a rank  GiB in all"
    )
    tied = {"dofs": options.dofs, "joint_points": 0, "newton": [1, 1]}
    tied["iterations"] = options.linear_iterations
    cut = {**tied, "joint_points": options.points, "newton": [0, options.newton]}
    cut["iterations"] = options.joint_iterations
    for ranks in options.ranks:
        times = [model.step(row, ranks, options) for row in (tied, cut)]
        held = model.megabytes(cut, ranks)
        shown = "  ".join(f"{sum(t):9.3f}  {100 * t[1] / sum(t):5.0f} %" for t in times)
        print(f"{ranks:5d}  {shown}  {held:10.0f}  {held * ranks / 1024:10.0f}")


def main(arguments: list[str] | None = None) -> None:
    """Fit, check and print."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, help="what large_bodies --json printed")
    parser.add_argument("--ranks", nargs="+", type=at_least(1), default=[64, 128, 256, 512, 1024])
    for name, value, text in (
        ("dofs", 1e7, "of the body asked for"),
        ("points", 1e5, "joint points of it"),
        ("linear-iterations", 20, "of conjugate gradients in a linear step"),
        ("joint-iterations", 50, "of GMRES in a jointed step"),
        ("newton", 14, "iterations of Newton's method in a jointed step"),
        ("fitted", 4e5, "dofs up to which rows are fitted"),
        ("bandwidth", 17e9, "of memory for one core of this machine [B/s]"),
        ("node-bandwidth", 300e9, "of a node of the cluster [B/s]"),
        ("node-ranks", 32, "ranks on a node"),
        ("latency", 3e-6, "of a message [s]"),
        ("network", 12e9, "bandwidth of a node's network [B/s]"),
    ):
        parser.add_argument(f"--{name}", type=float, default=value, help=text)
    options = parser.parse_args(sys.argv[1:] if arguments is None else arguments)
    rows = rows_of(options.files)
    alone = [row for row in rows if row["ranks"] == 1]
    fits = [row["dofs"] <= options.fitted for row in alone]
    model = Model(
        [row for row, fit in zip(alone, fits, strict=True) if fit],
        [row for row in rows if row["ranks"] > 1],
    )
    print_checks(model, [row for row, fit in zip(alone, fits, strict=True) if not fit])
    print_table(model, options)


if __name__ == "__main__":
    main()
