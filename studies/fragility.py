# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probability that a joint of the 1992 paper's dam opens by more than 5 mm.

    ./with-dolfinx python3 -m studies.fragility                  # 12 short motions, a minute
    ./with-dolfinx python3 -m studies.fragility --seeds 20 --scales 0.5 1 1.5 2 3 --steps 2288

One model is run under synthetic motions of several seeds and scales, from one static state. The
results are fragility curves for three intensity measures; the figure shows the curve for the
spectral acceleration. An interrupted study continues when it is started again.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.common.parameters import check_number
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.study import MotionSuite, Tally, fragility, write_csv
from dolfinx_joints.study.table import Table
from studies.ambiesta import ALL_STEPS, LOAD_STEPS, TIME_STEP, Case, build, make_mesh

LIMIT = 5e-3  # m
PERIOD = 0.2  # s, period of the monolithic dam
INTENSITIES = {"Sa(0.2 s)": "sa [m/s^2]", "PGA": "pga [m/s^2]", "Arias": "arias [m/s]"}
SHORTEST = 410  # steps: the synthetic motion has waves of 2 s
CREST = "mid-crest"


def motions(seeds: int, scales: list[float], steps: int) -> dict[str, dj.Motion]:
    """Return motions of seeds 1, 2, ... and scales; seed 1 with all steps is that of demo 03."""
    duration = round(steps * TIME_STEP, 3)
    of_seeds = {
        seed: dj.synthetic_motion(seed=seed, duration=duration).resampled(TIME_STEP)
        for seed in range(1, seeds + 1)
    }
    return {
        f"seed{seed}_x{scale:g}": motion.scaled(scale)
        for seed, motion in of_seeds.items()
        for scale in scales
    }


def suite_of(case: Case, chosen: dict[str, dj.Motion], folder: Path) -> MotionSuite:
    """Return the suite of motions on the dam under self weight (collective)."""
    model = build(case, "joints", make_mesh(case, folder))
    simulation = dj.Simulation(model)
    simulation.statics(steps=LOAD_STEPS)
    return MotionSuite(folder, simulation, chosen, points={CREST: case.points()[CREST]})


def show(table: Table, folder: Path, limit: float, failed: int) -> None:
    """Print the curves, write the runs and the curves as CSV, and the figure."""
    write_csv(table, folder / "fragility.csv")
    opening = table["opening [m]"]
    exceeded = opening > limit
    print(
        f"openings {1e3 * opening.min():.2f} to {1e3 * opening.max():.2f} mm, "
        f"{exceeded.sum()} of {len(opening)} above {1e3 * limit:g} mm"
    )
    rows = []
    for name, column in INTENSITIES.items():
        unit = column.partition("[")[2].rstrip("]").replace("^2", "²")
        names = {"response_name": "opening [m]", "intensity_name": f"{name} [{unit}]"}
        try:
            curve = fragility(table[column], opening, limit=limit, failed=failed, **names)
        except ValueError as error:
            print(f"{name}: no curve: {error}")
            continue
        print(curve)
        rows.append(curve.row())
        if column == "sa [m/s^2]":
            print(plots.save(curve.draw().figure, folder / "fragility.png"))
    curves = {column: np.array([row[column] for row in rows]) for column in (rows or [{}])[0]}
    write_csv(curves, folder / "fragility_curves.csv")


def main(arguments: list[str] | None = None) -> Tally:
    """Run the suite, print and draw the results (collective)."""
    parser = Parser(description="Fragility of a dam: probability of a joint opening.")
    parser.add_argument("--seeds", type=at_least(1), default=4, help="number of motions")
    parser.add_argument("--scales", type=float, nargs="+", default=[1.0, 1.5, 2.0])
    parser.add_argument(
        "--steps",
        type=at_least(SHORTEST),
        default=820,
        help=f"duration in time steps of {TIME_STEP} s; {ALL_STEPS} in demo 03",
    )
    parser.add_argument("--limit", type=float, default=LIMIT, help="limit of the opening [m]")
    parser.add_argument("--size", type=float, default=5.5, help="cell size [m]")
    parser.add_argument("--order", type=int, default=2, choices=(1, 2), help="element order")
    parser.add_argument("--at-once", type=at_least(1), default=16, help="concurrent runs")
    parser.add_argument("--out", type=Path, default=Path("output/fragility"))
    options = parser.parse_args(arguments)
    check_number("limit", options.limit, lambda v: v > 0, "positive", unit="m")
    for scale in options.scales:
        check_number("scale", scale, lambda v: v > 0, "positive")
    case = Case(size=options.size, order=options.order)
    # A suite does not detect changes of the model in complete runs; use a folder per mesh.
    folder = options.out / f"cells_{case.size:g}m_order_{case.order}"
    chosen = motions(options.seeds, options.scales, options.steps)
    longest = max(motion.duration for motion in chosen.values())
    suite = suite_of(case, chosen, folder)
    began = time.perf_counter(), time.process_time()
    tally = suite.run(dt=TIME_STEP, at_once=options.at_once, rerun_changed=True)
    wall, cpu = time.perf_counter() - began[0], time.process_time() - began[1]

    def conclude() -> None:
        print(
            f"{len(chosen)} motions of {longest:.2f} s: {len(tally.done)} run in {wall:.1f} s "
            f"({cpu:.1f} s of processor time), {len(tally.skipped)} kept, "
            f"{len(tally.failed)} failed"
        )
        for name, reason in tally.failed.items():
            print(f"  {name}: {reason}")
        show(suite.table(period=PERIOD), folder, options.limit, len(tally.failed))

    on_root(MPI.COMM_WORLD, conclude)
    return tally


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    try:
        main()
    except (dj.JointsError, ValueError) as error:
        if MPI.COMM_WORLD.rank == 0:
            print(f"studies.fragility: {error}", file=sys.stderr)
        raise SystemExit(2) from None
