#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Error against work of every time scheme on problems with contact and friction.

Displacement, velocity and joint force are compared with exact motions, or for the solids with a
run of much finer steps; `shared.problems.errors` defines the norms. The energy error is the
paper's. Runs have equal steps unless they are labelled adaptive.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.problems import (
    BOUNCING,
    MIDPOINT,
    ON_WALL,
    SCHEMES,
    Problem,
    bar,
    blocks,
    coulomb,
    errors,
    impact,
    march,
    of_model,
    sliding,
    with_fine_motion,
)
from benchmarks.shared.scenes import wall
from benchmarks.shared.tables import head, line
from dolfinx_joints import JointsError
from dolfinx_joints.common.command_line import Parser

Row = dict[str, Any]

# (steps per period, tolerance, halvings) of the adaptive runs, coarse to fine.
IMPACT_CONTROL = ((60, 1e-4, 8), (120, 3e-5, 8), (300, 2e-6, 9), (800, 1e-7, 9))
FRICTION_CONTROL = ((125, 1e-5, 8), (250, 1e-6, 9), (1000, 1e-7, 9))
WALL_STEP = 0.005  # [s]
CONSISTENT = ("ec", "ec_exact")


@dataclass(frozen=True, kw_only=True)
class Case:
    """Problem with the runs to make.

    Attributes:
        title: Title in the figures.
        problem: Function that returns the problem.
        steps: Steps per period of the runs with equal steps, coarse to fine.
        schemes: Names in `SCHEMES`.
        control: (steps per period, tolerance, halvings) of the adaptive runs.
        adaptive: Schemes that run adaptively as well.
    """

    title: str
    problem: Callable[[], Problem]
    steps: tuple[float, ...]
    schemes: tuple[str, ...] = tuple(SCHEMES)
    control: tuple[tuple[int, float, int], ...] = ()
    adaptive: tuple[str, ...] = ("ec", "ec_exact", "newmark")


def cases(*, quick: bool) -> dict[str, Case]:
    """Return all problems by name."""
    impact_steps = (20, 200) if quick else (20, 60, 200, 700)
    friction_steps = (60, 250) if quick else (60, 250, 1000)
    courant = (0.5,) if quick else (0.25, 0.5, 1, 2)
    elements = 50 if quick else 100
    by_name = {}
    for power in (0, 2, 4, 8, 12):
        by_name[f"impact_1e{power}"] = Case(
            title=f"impact, $k_{{stop}}/k = 10^{{{power}}}$",
            problem=lambda ratio=10.0**power: impact(ratio),
            steps=impact_steps,
            control=IMPACT_CONTROL[1:2] if quick else IMPACT_CONTROL,
        )
    for name, title, exact, end in (
        ("bar_on_wall", "fast bar on a wall", ON_WALL, 1.4e-4),
        ("bouncing_bar", "bouncing bar", BOUNCING, 5.0),
    ):
        for massless in (False, True):
            by_name[name + "_massless" * massless] = Case(
                title=title + ", mass redistributed" * massless,
                problem=lambda exact=exact, end=end, massless=massless: bar(
                    exact, elements=elements, end=end, massless=massless
                ),
                steps=courant,
            )
    for name, title, ratio in (
        ("coulomb_1e4", "Coulomb oscillator, $k_s/k = 10^4$", 1e4),
        ("coulomb_1e8", "Coulomb oscillator, $k_s/k = 10^8$", 1e8),
        ("coulomb_rigid", "Coulomb oscillator, rigid joint", math.inf),
    ):
        by_name[name] = Case(
            title=title,
            problem=lambda ratio=ratio: coulomb(ratio),
            steps=friction_steps,
            schemes=tuple(SCHEMES) if math.isfinite(ratio) else CONSISTENT,
            control=() if quick else FRICTION_CONTROL,
            adaptive=Case.adaptive if math.isfinite(ratio) else CONSISTENT,
        )
    for name, title, stiffness in (
        ("sliding_block", "sliding block, $k_s = 10^8$ N/m", 1e8),
        ("sliding_block_rigid", "sliding block, rigid joint", math.inf),
    ):
        by_name[name] = Case(
            title=title,
            problem=lambda stiffness=stiffness: sliding(stiffness),
            steps=(50, 200) if quick else (20, 50, 200, 1000),
            schemes=tuple(SCHEMES) if math.isfinite(stiffness) else CONSISTENT,
        )
    by_name["blocks"] = Case(
        title="two blocks, impact and friction",
        problem=lambda: with_fine_motion(blocks(), 2e-6 if quick else 5e-7, 1e-4),
        steps=(20, 80) if quick else (10, 20, 40, 80, 160, 320),
    )
    refinement = 16 if quick else 64
    by_name["jointed_wall"] = Case(
        title="jointed wall, shaken",
        problem=lambda: with_fine_motion(
            shaken_wall(quick=quick), WALL_STEP / refinement, WALL_STEP
        ),
        steps=(1, 4) if quick else (1, 2, 4, 8),
    )
    return by_name


def ground(time: float) -> np.ndarray:
    """Return the ground acceleration along the three axes, with a smooth onset [m/s^2]."""
    onset = math.sin(math.pi * time / 0.2) ** 2 if time < 0.1 else 1.0
    phases = 2.0 * math.pi * time * np.array([4.1, 5.2, 7.9]) + np.array([0.0, 0.7, 1.9])
    return onset * np.array([2.0, 2.0, 1.0]) * np.sin(phases)


def shaken_wall(*, quick: bool) -> Problem:
    """Return a free-standing wall in four blocks, after self weight, on a shaken base."""
    scene = replace(wall(divisions=(4, 1, 4) if quick else (8, 2, 8)), loads=[dj.Gravity()])
    with scene.mesh_file() as path:
        model = scene.model(scene.read(path), scene.law())
    static = dj.Simulation(model).statics()
    end = 0.2 if quick else 0.4
    return of_model(model, period=WALL_STEP, end=end, static=static, motion=ground)


# ---------------------------------------------------------------- runs


def take(
    problem: Problem, name: str, steps: float, control: tuple[float, int] | None = None
) -> Row:
    """Make a run and return it as a row; a failed run has no errors."""
    tolerance, halvings = control or (None, None)
    row: Row = {
        "scheme": name,
        "tolerance": tolerance,
        "max_halvings": halvings,
        "dt_max": problem.period / steps,
    }
    step_control = dj.StepControl(tolerance=tolerance, max_halvings=halvings) if control else None
    try:
        run = march(problem, SCHEMES[name], problem.period / steps, step_control)
    except JointsError as failure:
        return row | {"failure": str(failure)}
    relative_errors = errors(problem, run, midpoint=name in MIDPOINT)
    return row | {
        "steps": run.steps,
        "solves": run.solves,
        "iterations": run.iterations,
        "seconds": run.seconds,
        **{f"error_{key}": value for key, value in relative_errors.items()},
        "error_energy": run.energy_error,
        "ledger": run.ledger,
    }


def rows_of(case: Case) -> Iterator[Row]:
    """Yield all runs of a case."""
    problem = case.problem()
    for name in case.schemes:
        for steps in case.steps:
            yield take(problem, name, steps)
    for name in case.adaptive:
        for steps, *control in case.control:
            yield take(problem, name, steps, tuple(control))


# ---------------------------------------------------------------- output


COLUMNS = (
    "| problem | scheme | dt [s] | tolerance / halvings | steps | solves | Newton | s |"
    " displacement | velocity | force | energy | ledger |\n"
    "| {problem} | {scheme} | {dt_max:.2e} | {adaptive} | {steps} | {solves} | {iterations} |"
    " {seconds:.2f} | {error_displacement:.2e} | {error_velocity:.2e} | {error_force:.2e} |"
    " {error_energy:.2e} | {ledger} |"
)


def shown(problem: str, row: Row) -> str:
    """Return the line of a run."""
    adaptive = "" if row["tolerance"] is None else f"{row['tolerance']:.0e} / {row['max_halvings']}"
    if "failure" in row:
        return (
            f"| {problem} | {row['scheme']} | {row['dt_max']:.2e} | {adaptive} {row['failure']} |"
        )
    return line(COLUMNS, row | {"problem": problem, "adaptive": adaptive})


# Marker, colour and label of a scheme in figures.
STYLES = {
    "ec": ("o", "tab:blue", "energy-consistent"),
    "ec_exact": ("s", "black", "the same, 10 modes exact"),
    "implicit": ("v", "tab:green", "implicit contact"),
    "newmark": ("x", "tab:red", "Newmark"),
    "hht": ("+", "tab:orange", "HHT, $\\alpha = 0.1$"),
    "generalized_alpha": ("^", "tab:purple", "generalized-$\\alpha$, 0.8"),
}
# Name of the figure: error, its label and range.
FIGURES = {
    "displacement": ("error_displacement", "displacement error", (1e-5, 10)),
    "velocity": ("error_velocity", "velocity error", (1e-5, 10)),
    "force": ("error_force", "force error", (1e-4, 2)),
    "energy": ("error_energy", "energy error", (1e-16, 1)),
}


def draw(folder: Path, problems: dict[str, list[Row]], titles: dict[str, str]) -> None:
    """Draw one figure per error, with one panel per problem."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    columns = 4
    count = math.ceil(len(problems) / columns)
    for name, (error, label, limits) in FIGURES.items():
        figure, axes = plt.subplots(
            count,
            columns,
            figsize=(13.0, 2.9 * count),
            sharey=True,
            squeeze=False,
            layout="constrained",
        )
        for axis, (problem, rows) in zip(axes.flat, problems.items(), strict=False):
            draw_panel(axis, rows, error, limits)
            axis.set_title(titles[problem], fontsize=10)
        for axis in axes.flat[len(problems) :]:
            axis.set_axis_off()
        for axis in axes[:, 0]:
            axis.set_ylabel(f"{label} [-]")
        figure.supxlabel("steps solved, rejected ones included", fontsize=10)
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=9)
        figure.savefig(folder / f"work_precision_{name}.png", dpi=110)
        plt.close(figure)


def draw_panel(axis: Any, rows: list[Row], error: str, limits: tuple[float, float]) -> None:
    """Draw a line per scheme, dashed if adaptive; clip values to the range of the axis."""
    from matplotlib.ticker import LogLocator, NullFormatter

    for adaptive in (False, True):
        for scheme, (marker, colour, label) in STYLES.items():
            kept = [
                row
                for row in rows
                if row["scheme"] == scheme
                and (row["tolerance"] is not None) == adaptive
                and "failure" not in row
            ]
            if kept:
                kept.sort(key=lambda row: row["solves"])
                axis.plot(
                    [row["solves"] for row in kept],
                    np.clip([row[error] for row in kept], *limits),
                    linestyle="--" if adaptive else "-",
                    marker=marker,
                    color=colour,
                    markersize=5,
                    linewidth=1.2,
                    markerfacecolor="none" if adaptive else colour,
                    label=label + ", adaptive" * adaptive,
                )
    axis.set(xscale="log", yscale="log", ylim=(0.6 * limits[0], 1.6 * limits[1]))
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.grid(which="major", linewidth=0.4, alpha=0.6)


def main() -> None:
    """Print a table, or one JSON object as the last line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few runs, less than a minute")
    parser.add_argument(
        "--only", nargs="+", default=[], help="problems whose names begin with one of these"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    parser.add_argument("--plot", type=Path, help="write figures to this folder")
    options = parser.parse_args()
    chosen = {
        name: case
        for name, case in cases(quick=options.quick).items()
        if not options.only or name.startswith(tuple(options.only))
    }
    print(head(COLUMNS))
    problems: dict[str, list[Row]] = {}
    for name, case in chosen.items():
        problems[name] = []
        for row in rows_of(case):
            problems[name].append(row)
            print(shown(name, row), flush=True)
    ec = [row for rows in problems.values() for row in rows if row["scheme"] in CONSISTENT]
    ledger = max((row["ledger"] for row in ec if "failure" not in row), default=None)
    failed = sum("failure" in row for row in ec)
    result = {"ledger_max": ledger, "ec_failed": failed, "problems": problems}
    if ledger is not None:
        print(f"largest imbalance of the energy lines, energy-consistent: {ledger:.1e}")
    print(f"energy-consistent runs that failed: {failed} of {len(ec)}")
    if options.plot:
        draw(options.plot, problems, {name: case.title for name, case in chosen.items()})
    if options.json:
        print(json.dumps(result))


if __name__ == "__main__":
    main()
