#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error bars of three dams against finer runs, and the cost of a call of `accuracy`.

The scenes are the jointed wall, the arch dam of demo 03 in its strong motion, and Koyna dam with a
reservoir by finite elements and joints at neck and base. `accuracy` estimates the errors from
coarser runs. The effectivity is the estimated error divided by the difference from a run with a
quarter of the step, or with finer cells. Runs are kept in ``--out`` and not repeated.

The cost is the processor time of all processes of the call, divided by that of the run in a
process of its own. It is measured if the runs are new.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.scenes import TIME_STEP, dam, wall
from benchmarks.shared.tables import table
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.geometry.gravity_dam import KOYNA, gravity_dam
from dolfinx_joints.geometry.jointed_wall import jointed_wall

WATER = 91.75  # level of Koyna's reservoir [m]
SEED, DURATION = 4, 2.0  # of Koyna's motion [s]
ROUNDING = 1e-6  # smaller relative errors have no effectivity


def run_wall(folder: Path, *, size: float, dt: float) -> Path:
    """Shake the jointed wall for 0.98 s."""
    scene, mesh = wall(), jointed_wall(folder / "wall.msh", size=size)
    model = scene.model(scene.read(mesh, comm=MPI.COMM_SELF), scene.law())
    return _shaken(folder, model, (10.0, 2.0, 20.0), dt, 200 * TIME_STEP, scene.shaking(0.0))


def run_arch(folder: Path, *, size: float, dt: float) -> Path:
    """Shake the arch dam of demo 03 for 0.98 s, from the strong part of the motion on."""
    scene, mesh, end = dam(), ambiesta(folder / "dam.msh", size=size), 200 * TIME_STEP
    model = scene.model(scene.read(mesh, comm=MPI.COMM_SELF), scene.law())
    return _shaken(folder, model, scene.crest, dt, end, scene.strong_shaking(end), 4)


def run_koyna(folder: Path, *, size: float, dt: float) -> Path:
    """Shake Koyna dam with joints at neck and base, and with compressible water."""
    heights = {"base": 0.0, "neck": 66.5}
    mesh = gravity_dam(folder / "koyna.msh", joints=heights, size=size, order=1)
    model = dj.Model(
        dj.read_msh(mesh, MPI.COMM_SELF),
        material=dj.Elastic(young=31.027e9, poisson=0.2, density=2643.0),
        joints=dj.FrictionNoTension(
            normal_stiffness=1e12, shear_stiffness=4e11, friction_angle_deg=45.0
        ),
        supports=[dj.Fixed(group="base"), dj.Fixed(group="foundation_ends")],
        loads=[dj.Gravity(), dj.HydrostaticPressure(group="upstream", level=WATER)],
        water=dj.ReservoirWaves(
            group="upstream", level=WATER, length=5.0 * WATER, bottom_reflection=0.75
        ),
        damping=dj.rayleigh(ratio=0.05, frequencies=(2.5, 10.0)),
        body=dj.Body(plane="strain"),
    )
    motion = dj.synthetic_motion(seed=SEED, duration=DURATION, peaks_g=(0.4, 0.0, 0.25))
    return _shaken(folder, model, (0.0, KOYNA.height, 0.0), dt, DURATION, motion, 4)


def _shaken(
    folder: Path,
    model: dj.Model,
    crest: Any,
    dt: float,
    end: float,
    motion: Any,
    load_steps: int = 1,
) -> Path:
    """Make a run with all results of the report; return its file."""
    path = folder / "run.h5"
    monitor = dj.ResultsMonitor(path, points={"crest": crest}, every=20, envelopes=True)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics(steps=load_steps)
    simulation.dynamics(dt=dt, steps=round(end / dt), motion=motion)
    return path


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Function that makes a run, cell size [m] and step [s], and factors of the finer cells."""

    run: Callable[..., Path]
    size: float
    dt: float
    finer: tuple[float, float]


SCENES = {
    "wall": Scene(run=run_wall, size=1.0, dt=TIME_STEP, finer=(0.8, 0.5)),
    "arch": Scene(run=run_arch, size=5.5, dt=TIME_STEP / 2.0, finer=(0.75, 0.5)),
    "koyna": Scene(run=run_koyna, size=4.0, dt=0.004, finer=(0.5, 0.25)),
}
FORM = (
    "| scene | error of | values | with an order: estimate / error | values | with a bound: "
    "bound / error | growth | cost |\n"
    "| {scene} | {direction} | {ordered} | {order} | {bounded} | {bound} | {growth} | {cost} |"
)


def effectivities(
    estimate: dj.study.Accuracy, finer: dict[str, float], direction: str
) -> Iterator[dict[str, Any]]:
    """Yield name, kind, estimated and true relative error, and effectivity of each value."""
    names = ("value", "given", f"{direction}_error", f"{direction}_kind")
    for name, given, error, kind in zip(*(estimate.table[n] for n in names), strict=True):
        true = abs(given - finer[name]) / (abs(given) or 1.0)
        share = error / (abs(given) or 1.0)
        ratio = share / true if true > ROUNDING else np.nan
        row = {"value": name, "kind": kind, "estimate": share, "true": true}
        yield row | {"effectivity": ratio}


def measured(name: str, out: Path) -> list[dict[str, Any]]:
    """Run a scene; print the effectivity of each value and return two rows of the table."""
    scene, folder = SCENES[name], out / name
    at = {"size": scene.size, "dt": scene.dt}
    is_new, before = not (folder / "coarser").exists(), _seconds()
    estimate = dj.accuracy(folder / "coarser", scene.run, **at)
    cost = np.nan
    if is_new:
        spent, alone = _seconds() - before, folder / "alone"
        alone.mkdir(parents=True)
        code = f"from benchmarks.error_bars import *; SCENES[{name!r}].run(Path({str(alone)!r}), **{at})"
        subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)
        (folder / "cost.txt").write_text(f"{spent / (_seconds() - before - spent)}\n")
    if (folder / "cost.txt").exists():
        cost = float((folder / "cost.txt").read_text())
    print(f"\n{name}\n{estimate}\ncost of the call: {cost:.2f} runs", flush=True)
    finer = dj.accuracy(
        folder / "finer", scene.run, **at, steps=(0.5, 0.25), cells=scene.finer, workers=1
    )
    print(f"\n{name}, with finer runs\n{finer}", flush=True)
    cases = finer.runs["case"].tolist()
    rows = []
    for direction, case in (("step", "step_x0.25"), ("cell", f"cell_x{min(scene.finer):g}")):
        best = {n: column[cases.index(case)] for n, column in finer.runs.items() if n != "case"}
        values = list(effectivities(estimate, best, direction))
        for v in values:
            print(
                f"{v['value']:44} {direction} {v['kind']:9} {100 * v['estimate']:8.2f} % "
                f"{100 * v['true']:8.2f} % {v['effectivity']:8.2f}"
            )
        row = {"scene": name, "direction": direction, "cost": f"{cost:.1f}"}
        for kind, number, ratios in (
            ("order", "ordered", "order"),
            ("no order", "bounded", "bound"),
        ):
            of_kind = [v["effectivity"] for v in values if v["kind"] == kind]
            row |= {number: len(of_kind), ratios: _range(of_kind)}
        row["growth"] = sum(v["kind"] == "growth" for v in values)
        rows.append(row)
    return rows


def _range(ratios: list[float]) -> str:
    """Return smallest, median and largest effectivity."""
    known = [ratio for ratio in ratios if np.isfinite(ratio)]
    if not known:
        return "–"
    return f"{np.min(known):.2g} to {np.max(known):.2g}, median {np.median(known):.2g}"


def _seconds() -> float:
    """Return the processor time of this process and of its ended children [s]."""
    both = [getrusage(of) for of in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def main(arguments: list[str] | None = None) -> None:
    """Run the scenes and print the table."""
    parser = Parser(description="Effectivity and cost of error bars.")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=[*SCENES])
    parser.add_argument("--out", type=Path, default=Path("output/error_bars"))
    options = parser.parse_args(arguments)
    rows = [row for name in options.scenes for row in measured(name, options.out)]
    print("\n" + table(FORM, rows))


if __name__ == "__main__":
    main()
