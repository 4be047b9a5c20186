#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error against run time of an arch dam in an earthquake: time schemes, steps and meshes.

The dam of demo 03 is shaken from its static state by the strong part of the motion. Run time is the
processor time of one thread for everything after the imports: mesh, assembly, statics and all
steps. It is the median of several runs after a first one that is not counted.

Errors of the crest's displacement, the largest opening and the largest slip are the largest errors
in time over the largest value of the reference. The peak acceleration of the crest is low-passed at
25 Hz. The reference of time schemes is the default scheme on the same mesh with steps 32 times
shorter than the demo's; the reference of meshes is the finest mesh. Runs are kept in ``--out`` and
not repeated.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy is imported: one thread is timed

import argparse
import math
import time as clock
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dolfinx_joints as dj
from benchmarks.exact_modes import steps_for
from benchmarks.shared.central_differences import SAFETY, CentralDifferences
from benchmarks.shared.measure import StepWatch, progress
from benchmarks.shared.scenes import TIME_STEP, Scene, dam
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.common.constants import ACCELERATION_BAND
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.motions.processing import low_pass
from dolfinx_joints.simulation.record import Record

Run = Mapping[str, NDArray[np.float64]]

PARTS = (0.5, 1.0, 2.0, 4.0)  # number of steps per step of demo 03
REFERENCE = 32.0
GOAL = 0.01
SIZE = 5.5  # of the cells of the demo's mesh [m]
SIZES = (11.0, 7.8, SIZE, 3.9)
FINEST = 2.75
QUANTITIES = {
    "crest": "crest displacement",
    "opening": "largest opening",
    "slip": "largest slip",
    "peak": "peak acceleration",
}
PAGE = Path(__file__).resolve().parents[1] / "docs/accuracy.md"
HISTORIES = ("crest", "velocity", "opening", "slip")
BETA = 2.0 * 0.02 / (2.0 * math.pi * 5.0)  # damping of the scene: 2 % at 5 Hz, as stiffness [s]


@dataclass(frozen=True, kw_only=True)
class Method:
    """A time scheme with its solver.

    Attributes:
        options: Arguments of `dynamics`.
        solver: Solver of the steps; ``explicit`` for `CentralDifferences`.
        tolerances: Tolerance of the local error for each of `PARTS`; equal steps if empty.
        style: Line style of figures.
        single: Whether it is slow and run only once, with the demo's step or its own.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    solver: str = "auto"
    tolerances: tuple[float, ...] = ()
    style: str = "-o"
    single: bool = False

    def label(self, part: float, dt: float) -> str:
        """Return the label of a run among the runs of the method."""
        if self.tolerances:
            return f"tol. {self.tolerances[PARTS.index(part)]:g}"
        return f"{1e3 * dt:.3g} ms"


METHODS = {
    "energy-consistent (default)": Method(),
    "the same, 10 modes exact": Method(options={"scheme": dj.EnergyConsistent(exact_modes=10)}),
    "the same, adaptive steps": Method(tolerances=(1e-2, 1e-3, 3e-4, 1e-4), style="--o"),
    "implicit contact": Method(options={"scheme": dj.ImplicitContact()}, style="-v"),
    "Newmark": Method(options={"scheme": dj.Newmark()}, style="-x"),
    "HHT": Method(options={"scheme": dj.HilberHughesTaylor()}, style="-+"),
    "generalized-alpha": Method(options={"scheme": dj.GeneralizedAlpha()}, style="-^"),
    "Newmark, joints by forms": Method(
        options={"scheme": dj.Newmark()}, solver="forms", style="s", single=True
    ),
    "central differences": Method(solver="explicit", style="*", single=True),
}
DEFAULT = next(iter(METHODS))


class Histories(StepWatch):
    """Monitor that also records velocity, largest opening and largest slip of each step.

    Attributes:
        velocity: Velocity of the crest, (3,) each [m/s].
        opening: Largest opening [m].
        slip: Largest slip since the start [m].
    """

    def __init__(self, scene: Scene) -> None:
        """Create empty records."""
        super().__init__(scene)
        self.velocity: list[NDArray[np.float64]] = []
        self.opening: list[float] = []
        self.slip: list[float] = []

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Store the initial gap."""
        super().start(model, stage, steps, first)
        assert first.joints is not None
        self._first = first.joints.state.gap.copy()

    def record(self, record: Record) -> None:
        """Store the histories of a step."""
        super().record(record)
        assert record.joints is not None
        gap = record.joints.state.gap
        self.velocity.append(self._probe.read(record.velocity)[0].copy())
        self.opening.append(float(gap[:, 0].max()))
        self.slip.append(_largest_slip(gap - self._first))


def _largest_slip(change: NDArray[np.float64]) -> float:
    """Return the largest tangential part of a change of gaps, shape (n, 3), [m]."""
    return float(np.hypot(change[:, 1], change[:, 2]).max())


class Runs:
    """Runs of the dam, made on first use.

    Args:
        seconds: Duration of the motion [s].
        repeats: Number of runs for the median time.
        folder: Folder of the results of runs.
    """

    def __init__(self, seconds: float, repeats: int, folder: Path) -> None:
        """Create the folder."""
        self._intervals = round(seconds / (2.0 * TIME_STEP))
        self._repeats, self._folder = repeats, folder
        folder.mkdir(parents=True, exist_ok=True)

    def take(self, name: str, part: float, size: float = SIZE) -> Run:
        """Return histories, and the processor time of the run [s].

        Args:
            name: Name in `METHODS`.
            part: Number of steps per step of demo 03.
            size: Cell size [m].
        """
        label = f"{name}_{part:g}_{size:g}m_{self._intervals}".replace(" ", "_").replace(",", "")
        path = self._folder / f"{label}.npz"
        if not path.exists():
            once = METHODS[name].single or part > max(PARTS) or size == FINEST
            runs = [
                self._run(METHODS[name], part, size) for _ in range(1 if once else self._repeats)
            ]
            np.savez(path, **{**runs[0], "cpu": np.median([run["cpu"] for run in runs])})
            progress(f"{label}: {np.median([run['cpu'] for run in runs]):.1f} s")
        with np.load(path) as kept:
            return dict(kept)

    def warm_up(self) -> None:
        """Run once to compile forms and loops."""
        intervals, self._intervals = self._intervals, 1
        for method in METHODS.values():
            self._run(method, 1.0, SIZES[0])
        self._intervals = intervals

    def _run(self, method: Method, part: float, size: float) -> dict[str, Any]:
        """Return the histories and the processor time of one run."""
        scene = replace(dam(), write=lambda path: ambiesta(path, size=size))
        dt, steps = TIME_STEP / part, round(2 * part * self._intervals)
        options = dict(method.options)
        if method.tolerances:
            tolerance = method.tolerances[PARTS.index(part)]
            dt, steps = 2.0 * TIME_STEP, self._intervals
            options["control"] = dj.StepControl(tolerance=tolerance, max_halvings=4)
        with scene.mesh_file() as path:
            began = clock.process_time()
            model, watch = scene.model(scene.read(path), scene.law()), Histories(scene)
            explicit, own_dt = method.solver == "explicit", dt
            solver = "auto" if explicit else method.solver
            simulation = dj.Simulation(model, monitors=[watch], solver=solver)
            static = simulation.statics(steps=scene.load_steps)
            motion = scene.strong_shaking(steps * dt)
            if explicit:
                histories, own_dt = _explicitly(scene, model, static, motion, steps)
            else:
                simulation.dynamics(dt=dt, steps=steps, motion=motion, **options)
                histories = {name: np.array(getattr(watch, name)) for name in HISTORIES}
            spent = clock.process_time() - began
        times = dt * np.arange(steps + 1)
        ground = np.array([motion(0.5 * sum(ends)) for ends in pairwise(times)])
        mean = np.diff(histories.pop("velocity"), axis=0, prepend=0.0) / dt + ground
        return {**histories, "acceleration": mean, "cpu": spent, "interval": dt, "dt": own_dt}


def _explicitly(
    scene: Scene, model: dj.Model, static: Any, motion: Any, records: int
) -> tuple[dict[str, NDArray[np.float64]], float]:
    """Return histories by central differences at the demo's steps, and the step used [s]."""
    from dolfinx_joints.mesh.node_numbering import NodeNumbering
    from dolfinx_joints.monitors.probes import PointProbe

    body = CentralDifferences(model, scene.law(), BETA, static)
    every = math.ceil(TIME_STEP / (SAFETY * body.limit))
    dt = TIME_STEP / every
    probe = PointProbe(model, [scene.crest], NodeNumbering(model.V))
    vector = static.displacement.copy()
    first, rows = probe.read(vector)[0].copy(), []
    for u, v, gap in body.march(dt, motion, every, records):
        vector.setArray(u)
        moved = probe.read(vector)[0] - first
        vector.setArray(v)
        slip = _largest_slip(gap - static.joints.state.gap)
        rows.append((moved, probe.read(vector)[0].copy(), gap[:, 0].max(), slip))
    return dict(zip(HISTORIES, map(np.array, zip(*rows, strict=True)), strict=True)), dt


def errors(run: Run, reference: Run) -> dict[str, float]:
    """Return the errors of `QUANTITIES`; each step of the run has whole steps of the reference."""
    by_name = {}
    for name in ("crest", "opening", "slip"):
        mine, of = (r[name].reshape(len(r[name]), -1) for r in (run, reference))
        count = min(len(mine), len(of))
        mine, of = (rows[len(rows) // count - 1 :: len(rows) // count] for rows in (mine, of))
        off = np.linalg.norm(mine - of, axis=1).max()
        by_name[name] = float(
            off / np.linalg.norm(reference[name].reshape(-1, of.shape[1]), axis=1).max()
        )
    by_name["peak"] = abs(_peak(run) / _peak(reference) - 1.0)
    return by_name


def _peak(run: Run) -> float:
    """Return the largest acceleration of the crest in the band [m/s^2]."""
    a, dt = run["acceleration"], float(run["interval"])
    columns = [low_pass(a[:, k], dt, ACCELERATION_BAND) for k in range(3)]
    return float(np.linalg.norm(columns, axis=0).max())


@dataclass(frozen=True, kw_only=True)
class Line:
    """Errors of runs of one kind, coarse to fine.

    Attributes:
        labels: Step or cell size of each run.
        seconds: Processor time of each run [s].
        errors: Errors by quantity, shape (runs,).
    """

    labels: list[str]
    seconds: NDArray[np.float64]
    errors: dict[str, NDArray[np.float64]]

    def time_for(self, goal: float, quantity: str) -> float:
        """Return the processor time for an error [s], interpolated in the logarithms."""
        return steps_for(goal, list(self.seconds), list(self.errors[quantity]))


def lines(
    runs: Runs, parts: tuple[float, ...], sizes: tuple[float, ...]
) -> Iterator[tuple[str, Line]]:
    """Yield the lines of all methods, then the line of the meshes."""
    reference = runs.take(DEFAULT, REFERENCE)
    for name, method in METHODS.items():
        chosen = (1.0,) if method.single else parts
        method_runs = [runs.take(name, part) for part in chosen]
        labels = [method.label(p, run["dt"]) for p, run in zip(chosen, method_runs, strict=True)]
        yield name, _line(labels, method_runs, reference)
    finest = runs.take(DEFAULT, parts[-1], FINEST)
    meshes = [runs.take(DEFAULT, parts[-1], size) for size in sizes]
    yield "cell size, default scheme", _line([f"{size:g} m" for size in sizes], meshes, finest)


def _line(labels: list[str], runs: list[Run], reference: Run) -> Line:
    """Return the line of some runs."""
    off = [errors(run, reference) for run in runs]
    return Line(
        labels=labels,
        seconds=np.array([float(run["cpu"]) for run in runs]),
        errors={name: np.array([each[name] for each in off]) for name in QUANTITIES},
    )


HEAD = "".join(f" {name} |" for name in QUANTITIES.values())
RULE = "|---" * len(QUANTITIES)


def times(by_method: Mapping[str, Line]) -> str:
    """Return the time that each kind of run takes for 1 %, as a table in Markdown."""
    seconds, goal = by_method[DEFAULT].time_for(GOAL, "crest"), f"{100 * GOAL:g} %"
    rows = [
        f"Default scheme: {seconds:.1f} s for an error of the step of {goal} at the crest.\n",
        f"| processor time [s] for an error of the step of {goal} |{HEAD}",
        f"|---{RULE}|",
    ]
    for name, line in by_method.items():
        needed = " | ".join(_seconds(line.time_for(GOAL, q)) for q in QUANTITIES)
        rows.append(f"| {name} | {needed} |")
    return "\n".join(rows)


def error_table(by_method: Mapping[str, Line]) -> str:
    """Return the errors of all runs as a table in Markdown."""
    rows = [f"| errors [%] | step or cell | time [s] |{HEAD}", f"|---|---|---{RULE}|"]
    for name, line in by_method.items():
        for i, label in enumerate(line.labels):
            errors_of_run = " | ".join(f"{100 * line.errors[q][i]:.2g}" for q in QUANTITIES)
            rows.append(f"| {name} | {label} | {line.seconds[i]:.1f} | {errors_of_run} |")
    return "\n".join(rows)


def _seconds(value: float) -> str:
    """Return a time for the table; a dash if no run is accurate enough."""
    return f"{value:.1f}" if math.isfinite(value) else "–"


def draw(by_method: Mapping[str, Line], path: Path, quantities: tuple[str, ...]) -> Path:
    """Draw error against time, a panel for each quantity, with the goal as a line."""
    from matplotlib.figure import Figure

    from dolfinx_joints import plots

    figure = Figure(figsize=(1.0 + 4.6 * len(quantities), 5.4), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(quantities), sharey=True))
    styles = {name: method.style for name, method in METHODS.items()}
    for ax, quantity in zip(axes, quantities, strict=True):
        for name, line in by_method.items():
            off, style = 100.0 * line.errors[quantity], styles.get(name, "-s")
            colour = {"color": "black", "linewidth": 2.0} if name == DEFAULT else {}
            ax.loglog(line.seconds, off, style, label=name, markersize=5, **colour)
        ax.axhline(100.0 * GOAL, color="0.4", linewidth=4.0, alpha=0.4)
        needed = by_method[DEFAULT].time_for(GOAL, quantity)
        if math.isfinite(needed):
            text = f"time step, default scheme: {100 * GOAL:g} % in {needed:.1f} s"
            ax.text(0.98, 100.0 * GOAL, text, transform=ax.get_yaxis_transform(), ha="right")
        ax.set(title=QUANTITIES[quantity], xlabel="processor time, set-up included [s]")
        ax.xaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_major_formatter("{x:g}")
        ax.grid(which="both", linewidth=0.3)
    axes[0].set_ylabel("error [%]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 if len(axes) == 1 else 5)
    return plots.save(figure, path, dpi=110)


def main(arguments: list[str] | None = None) -> None:
    """Run, print the tables, draw."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=0.976, help="duration of the motion")
    parser.add_argument("--repeats", type=at_least(1), default=3, help="runs of each kind")
    parser.add_argument("--quick", action="store_true", help="two steps and two meshes")
    parser.add_argument("--plot", type=Path, help="write figures to this folder")
    parser.add_argument("--write", action="store_true", help="write the table to docs/accuracy.md")
    parser.add_argument(
        "--out", type=Path, default=Path("output/error_against_time"), help="folder of the runs"
    )
    options: argparse.Namespace = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    runs = Runs(options.seconds, options.repeats, options.out)
    runs.warm_up()
    chosen = (PARTS[:2], SIZES[:2]) if options.quick else (PARTS, SIZES)
    by_method = dict(lines(runs, *chosen))
    print(times(by_method), error_table(by_method), sep="\n\n")
    if options.write:
        head, _, _ = PAGE.read_text("utf-8").partition("Default scheme: ")
        PAGE.write_text(f"{head}{times(by_method)}\n", "utf-8")
    if options.plot:
        for name, quantities in (("crest", ("crest",)), ("all", tuple(QUANTITIES))):
            path = options.plot / f"error_against_time_{name}.png"
            print(f"figure: {draw(by_method, path, quantities)}")


if __name__ == "__main__":
    main()
