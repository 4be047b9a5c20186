#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether memory grows in a long run: 100 000 steps of a small wall whose joints open and slide.

Resident memory of the process is read at every thousandth step, without files and with a results
file and checkpoints, each in a process of its own. Exit status 1 if it grows by 1 MiB or more after
the first thousand steps, or if nothing opens or slides any more.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time as clock
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import dolfinx_joints as dj
from benchmarks._measure import load_average, run_alone
from benchmarks._scenes import TIME_STEP, wall
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.records import Record

EVERY = 1000  # steps between two readings of the memory
LARGEST_GROWTH = 1.0  # [MiB]
DIVISIONS, JOINTS = (4, 1, 2), 3
WRITING = ("nothing", "files")


def resident_mb() -> float:
    """Memory of this process that is in use now [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class MemoryWatch(Monitor):
    """Monitor that reads the memory now and then.

    Attributes:
        resident: Memory after each `EVERY` steps [MiB].
        opened: Joint points that were open, summed over these intervals' steps.
        sliding: The same of points that slid.
    """

    def __init__(self) -> None:
        """Nothing is read yet; the list is as long as it will be."""
        self.resident: list[float] = []
        self.opened: list[int] = []
        self.sliding: list[int] = []
        self._opened = self._sliding = 0

    def record(self, record: Record) -> None:
        """Count states of the joints, and read the memory where it is time."""
        assert record.solve is not None
        assert record.solve.counts is not None
        self._opened += record.solve.counts.open
        self._sliding += record.solve.counts.slip
        if record.step % EVERY == 0:
            self.resident.append(resident_mb())
            self.opened.append(self._opened)
            self.sliding.append(self._sliding)
            self._opened = self._sliding = 0


def measure(writing: str, steps: int) -> dict[str, Any]:
    """A run, with files or without."""
    scene = wall("long", divisions=DIVISIONS, joints=JOINTS)
    with scene.mesh_file() as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    watch = MemoryWatch()
    with TemporaryDirectory() as folder:
        files = Path(folder)
        monitors: list[Any] = [watch]
        if writing == "files":
            points = {"crest": scene.crest}
            monitors.append(dj.ResultsMonitor(files / "run.h5", points=points, every=100))
        simulation = dj.Simulation(model, monitors=monitors)
        simulation.statics()
        began = clock.perf_counter()
        kept = dj.Checkpoints(files / "run.ckpt", every=500) if writing == "files" else None
        end = simulation.dynamics(
            dt=TIME_STEP, steps=steps, motion=scene.strong_shaking(0.0), checkpoint=kept
        )
        seconds = clock.perf_counter() - began
        written = sum(path.stat().st_size for path in files.iterdir()) / 2**20
    assert model.operator is not None
    return {
        "writing": writing,
        "dofs": model.num_dofs,
        "joint_points": model.operator.num_points,
        "steps": steps,
        "seconds": seconds,
        "resident_mb": watch.resident,
        "growth_mb": max(watch.resident[1:]) - watch.resident[0],
        "growth_at_end_mb": watch.resident[-1] - watch.resident[0],
        "least_opened": min(watch.opened) / (EVERY * model.operator.num_points),
        "least_sliding": min(watch.sliding) / (EVERY * model.operator.num_points),
        "written_mb": written,
        "ledger": end.imbalance,
        "newton_mean": end.iterations / end.counts.accepted,
    }


def run(writing: str, steps: int) -> dict[str, Any]:
    """A run in a process of its own."""
    return run_alone("long_run", "--writing", writing, "--steps", str(steps))


def print_table(rows: list[dict[str, Any]]) -> None:
    """A line for each run, and the memory on the way."""
    first = rows[0]
    print(
        f"{first['dofs']} dofs, {first['joint_points']} joint points, {first['steps']} steps. "
        f"Load average {load_average():.1f} on {os.cpu_count()} processors.\ngrowth: resident "
        f"memory above that after {EVERY} steps [MiB], the largest of all readings and the last;\n"
        f"open, sliding: share of the points, the least of all intervals of {EVERY} steps.\n\n"
        "writes     seconds  after first  growth  at end  open  sliding  ledger  files MiB"
    )
    for row in rows:
        print(
            f"{row['writing']:9} {row['seconds']:8.0f} {row['resident_mb'][0]:12.1f}"
            f" {row['growth_mb']:7.2f} {row['growth_at_end_mb']:7.2f}"
            f" {row['least_opened']:5.2f} {row['least_sliding']:8.2f} {row['ledger']:7.0e}"
            f" {row['written_mb']:10.1f}"
        )


def passed(row: dict[str, Any]) -> bool:
    """Whether a run stayed as small as it was, and its joints were at work to the end."""
    at_work = row["least_opened"] > 0.05 and row["least_sliding"] > 0.05
    return bool(row["growth_mb"] < LARGEST_GROWTH and at_work)


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if memory grows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000, help=f"{2 * EVERY} or more")
    parser.add_argument("--writing", nargs="+", default=list(WRITING), choices=WRITING)
    parser.add_argument("--quick", action="store_true", help="3000 steps that write files")
    parser.add_argument("--json", action="store_true", help="a JSON array as the last line")
    options = parser.parse_args(sys.argv[1:] if arguments is None else arguments)
    if options.quick:
        options.steps, options.writing = 3 * EVERY, ["files"]
    if options.steps < 2 * EVERY:
        parser.error(f"--steps is {options.steps}; memory is compared after {EVERY}, take more.")
    if len(options.writing) == 1:
        rows = [measure(options.writing[0], options.steps)]
    else:
        rows = [run(writing, options.steps) for writing in options.writing]
    print_table(rows)
    if options.json:
        print(json.dumps(rows))
    return int(not all(map(passed, rows)))


if __name__ == "__main__":
    raise SystemExit(main())
