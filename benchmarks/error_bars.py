#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error bars of three dams against finer runs, and the cost of a call of `accuracy`.

The scenes are the jointed wall, the arch dam of demo 03 in its strong motion, and Koyna dam with a
reservoir by finite elements and joints at neck and base. `accuracy` estimates the errors from
coarser runs. The effectivity is the estimated error divided by the difference from a run with a
quarter of the step, or with finer cells. Runs are kept in ``--out`` and not repeated.

The cost is the processor time of all processes of the call, divided by that of a process that makes
the run alone. It is measured if the runs are new.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
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
from dolfinx_joints.study.accuracy import Accuracy

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
    "| scene | error of | with an order | median | bounds | median | below 0.5 | above 2 |\n"
    "| {scene} | {direction} | {ordered} | {order:.2g} | {bounded} | {bound:.2g} | {low} | {high} |"
)


def effectivities(
    estimate: Accuracy, finer: Mapping[str, float], direction: str
) -> Iterator[tuple[str, str, float, float]]:
    """Yield name, kind, and estimated and true relative error of each value."""
    names = ("value", "given", f"{direction}_error", f"{direction}_kind")
    for name, given, error, kind in zip(*(estimate.table[n] for n in names), strict=True):
        scale = abs(given) or 1.0
        yield name, kind, error / scale, abs(given - finer[name]) / scale


def measured(name: str, out: Path) -> Iterator[dict[str, Any]]:
    """Run a scene; print the effectivity of each value and yield the rows of the table."""
    scene, folder = SCENES[name], out / name
    at, before = {"size": scene.size, "dt": scene.dt}, _seconds()
    is_new = not (folder / "coarser").exists()
    estimate = dj.accuracy(folder / "coarser", scene.run, **at)
    print(f"\n{name}\n{estimate}")
    if is_new:
        spent, alone = _seconds() - before, folder / "alone"
        alone.mkdir(parents=True)
        run = f"{scene.run.__name__}(Path({str(alone)!r}), **{at})"
        code = f"from benchmarks.error_bars import *; {run}"
        subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)
        print(f"cost of the call: {spent / (_seconds() - before - spent):.1f} runs", flush=True)
    finer = dj.accuracy(
        folder / "finer", scene.run, **at, steps=(0.5, 0.25), cells=scene.finer, workers=1
    )
    print(f"with finer runs: {finer}", flush=True)
    cases = finer.runs["case"].tolist()
    for direction, case in (("step", "step_x0.25"), ("cell", f"cell_x{min(scene.finer):g}")):
        best = {title: column[cases.index(case)] for title, column in finer.runs.items()}
        ratios: dict[str, list[float]] = {"order": [], "no order": []}
        for value, kind, estimated, true in effectivities(estimate, best, direction):
            print(f"{value:44} {direction} {kind:9} {100 * estimated:9.2f} % {100 * true:9.2f} %")
            if kind in ratios and true > ROUNDING:
                ratios[kind].append(estimated / true)
        both = np.concatenate([*ratios.values()])
        yield {
            "scene": name,
            "direction": direction,
            "ordered": len(ratios["order"]),
            "order": np.median(ratios["order"] or np.nan),
            "bounded": len(ratios["no order"]),
            "bound": np.median(ratios["no order"] or np.nan),
            "low": int((both < 0.5).sum()),
            "high": int((both > 2.0).sum()),
        }


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
