#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What time schemes survive: stiffness of the joint, friction, time step, gaps, damping.

Four small models from all corners of these parameters, the same for every scheme:

- bounce: a mass on a spring strikes a stop (1 dof);
- block: a mass on a spring rests or falls on a frictional joint and is pushed to and fro (2 dofs);
- face: an elastic block, held by nothing, falls flat on a joint and flies off again (98 dofs, 7
  joint points that close at once and all open);
- wall: two elastic columns on a clamped base with a joint between them, shaken (100 dofs).

A cell has failed where a step does not converge or does not balance however often it is halved,
where a number is not finite, or where there is more than twice the energy that was ever put in:
that of the start and the largest input. ``growth`` is what is there beyond that, over it;
``ledger`` what all energy lines leave unexplained, over the largest energy. The latter says nothing
of HHT and generalized-alpha, whose numerical damping has no line. Rigid joints are for the
energy-consistent schemes alone.

``--long STEPS`` marches the mass with the stop over so many steps and reports the drift of its
energy; ``--plot PATH`` draws the map.
"""

from __future__ import annotations

import json
import math
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.laws.law import Law
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.scheme import Scheme
from dolfinx_joints.time_integration.substeps import Stepper

SCHEMES: dict[str, Scheme] = {
    "ec": dj.EnergyConsistent(),
    "ec_exact": dj.EnergyConsistent(exact_modes=8),
    "ec_dissipating": dj.EnergyConsistent(exact_modes=8, spectral_radius=0.8),
    "implicit": dj.ImplicitContact(),
    "newmark": dj.Newmark(),
    "hht": dj.HilberHughesTaylor(alpha=0.1),
    "generalized_alpha": dj.GeneralizedAlpha(spectral_radius=0.8),
}
CONSISTENT = ("ec", "ec_exact", "ec_dissipating")
RIGID = math.inf
GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One case.

    Attributes:
        model: Name of the model.
        ratio: Joint stiffness over that of the bulk, infinite for a rigid joint.
        angle: Friction angle [degrees].
        dt: Time step over the longest period of the bulk.
        gap: Initial gap over the length that the model moves.
        damping: Ratio of critical damping at the longest period.
    """

    model: str
    ratio: float
    angle: float
    dt: float
    gap: float
    damping: float

    @property
    def law(self) -> Callable[[float], Law]:
        """The joint law, given the stiffness of the bulk per area of a joint point [Pa/m]."""
        if self.ratio == RIGID:
            return lambda _: dj.RigidJoint(friction_angle_deg=self.angle)
        return lambda bulk: dj.FrictionNoTension(
            normal_stiffness=self.ratio * bulk,
            shear_stiffness=0.5 * self.ratio * bulk,
            friction_angle_deg=self.angle,
        )


@dataclass(frozen=True, kw_only=True)
class Start:
    """A model ready to go.

    Attributes:
        system: The system.
        velocity: At the start, shape (n,), [m/s].
        period: Longest period of the bulk [s].
    """

    system: dj.MatrixSystem
    velocity: np.ndarray
    period: float


def bounce(cell: Cell) -> Start:
    """100 kg on 1e4 N/m at 1 m/s: it moves by 0.1 m."""
    mass, stiffness = 100.0, 1e4
    omega = math.sqrt(stiffness / mass)
    system = dj.MatrixSystem.from_arrays(
        mass=mass,
        stiffness=stiffness,
        damping=2.0 * cell.damping * omega * mass,
        gap=[[-1.0], [0.0], [0.0]],
        law=cell.law(stiffness),
        initial_gap=0.1 * cell.gap,
    )
    return Start(system=system, velocity=np.array([1.0]), period=2.0 * math.pi / omega)


def block(cell: Cell) -> Start:
    """100 kg on a spring of 1e4 N/m along a joint, pushed with its weight, from up to 1 cm."""
    mass, stiffness = 100.0, 1e4
    omega = math.sqrt(stiffness / mass)
    weight = mass * GRAVITY
    system = dj.MatrixSystem.from_arrays(
        mass=mass * np.eye(2),
        stiffness=np.diag([stiffness, 0.0]),
        damping=2.0 * cell.damping * omega * mass * np.eye(2),
        load=lambda t: [weight * math.sin(0.8 * omega * t), -weight],
        gap=[[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        law=cell.law(stiffness),
        initial_gap=0.01 * cell.gap,
    )
    velocity = np.array([0.5, 0.3 if cell.gap else 0.0])
    return Start(system=system, velocity=velocity, period=2.0 * math.pi / omega)


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Masses on a square grid with springs along its sides and diagonals: an elastic block.

    Attributes:
        columns: Masses along x.
        rows: Masses along z.
        mass: Of each [kg].
        stiffness: Of a side [N/m]; diagonals have half of it.
    """

    columns: int
    rows: int
    mass: float = 10.0
    stiffness: float = 1e7

    def node(self, i: int, j: int) -> int:
        """Number of the mass in column i and row j."""
        return i * self.rows + j

    def matrix(self) -> np.ndarray:
        """Stiffness for (x, z) of each mass."""
        size = 2 * self.columns * self.rows
        matrix = np.zeros((size, size))
        for i, j in product(range(self.columns), range(self.rows)):
            for di, dz, share in ((1, 0, 1.0), (0, 1, 1.0), (1, 1, 0.5), (1, -1, 0.5)):
                if not (0 <= i + di < self.columns and 0 <= j + dz < self.rows):
                    continue
                way = np.array([di, dz]) / math.hypot(di, dz)
                stretch = np.zeros(size)
                a, b = self.node(i, j), self.node(i + di, j + dz)
                stretch[2 * a : 2 * a + 2], stretch[2 * b : 2 * b + 2] = -way, way
                matrix += share * self.stiffness * np.outer(stretch, stretch)
        return matrix


def longest_period(mass: float, stiffness: np.ndarray) -> float:
    """Of all modes but those of a rigid body [s]."""
    squares = np.linalg.eigvalsh(stiffness) / mass
    return 2.0 * math.pi / math.sqrt(squares[squares > 1e-9 * squares[-1]][0])


def face(cell: Cell) -> Start:
    """A free block of 7 by 7 masses thrown at 1 m/s, flat and sideways, onto a joint."""
    lattice = Lattice(columns=7, rows=7)
    stiffness = lattice.matrix()
    size = len(stiffness)
    period = longest_period(lattice.mass, stiffness)
    gap = np.zeros((3 * lattice.columns, size))
    for i in range(lattice.columns):
        gap[3 * i, 2 * lattice.node(i, 0) + 1] = 1.0
        gap[3 * i + 1, 2 * lattice.node(i, 0)] = 1.0
    weight = np.tile([0.0, -lattice.mass * GRAVITY], size // 2)
    push = np.tile([1e3 * GRAVITY, 0.0], size // 2)
    system = dj.MatrixSystem.from_arrays(
        mass=lattice.mass * np.eye(size),
        stiffness=stiffness,
        damping=cell.damping * period / math.pi * stiffness,
        load=lambda t: weight + push * math.sin(2.0 * math.pi * t / period),
        gap=gap,
        law=cell.law(lattice.stiffness),
        initial_gap=0.1 * period * cell.gap,
    )
    return Start(system=system, velocity=np.tile([0.5, -1.0], size // 2), period=period)


def wall(cell: Cell) -> Start:
    """Two columns of 5 by 6 masses, the lowest row held, with a joint between them."""
    lattice = Lattice(columns=5, rows=6)
    free = [2 * n + k for n in range(30) if n % lattice.rows for k in (0, 1)]
    part = lattice.matrix()[np.ix_(free, free)]
    stiffness = np.kron(np.eye(2), part)
    size = len(stiffness)
    period = longest_period(lattice.mass, part)
    points = lattice.rows - 1
    gap = np.zeros((3 * points, size))
    for j in range(points):
        left = 2 * ((lattice.columns - 1) * points + j)
        right = size // 2 + 2 * j
        gap[3 * j, [right, left]] = 1.0, -1.0
        gap[3 * j + 1, [right + 1, left + 1]] = 1.0, -1.0
    omega = 2.0 * math.pi / period
    shaken = lattice.mass * 10.0 * GRAVITY
    along, up = np.tile([shaken, 0.0], size // 2), np.tile([0.0, shaken], size // 2)
    system = dj.MatrixSystem.from_arrays(
        mass=lattice.mass * np.eye(size),
        stiffness=stiffness,
        damping=2.0 * cell.damping / omega * stiffness,
        load=lambda t: along * math.sin(0.9 * omega * t) + up * math.sin(2.3 * omega * t),
        gap=gap,
        law=cell.law(lattice.stiffness),
        initial_gap=1e-3 * cell.gap,
    )
    half = np.tile([1.0, 0.0], size // 4)
    return Start(system=system, velocity=np.concatenate([half, -0.5 * half]), period=period)


MODELS: dict[str, Callable[[Cell], Start]] = {
    "bounce": bounce,
    "block": block,
    "face": face,
    "wall": wall,
}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a cell went.

    Attributes:
        failure: What ended it, empty if it went to its end.
        newton: Largest number of iterations of an accepted step.
        ledger: Largest imbalance of all energy lines over the largest energy.
        growth: Largest stored energy over what was put in, less one; at least zero.
        cut: Rejected attempts.
    """

    failure: str
    newton: int
    ledger: float
    growth: float
    cut: int


def march(cell: Cell, scheme: Scheme, steps: int) -> Outcome:
    """Take the steps of a cell."""
    start = MODELS[cell.model](cell)
    solver = make_solver(start.system, rule=scheme.rule)
    velocity = start.system.mass.createVecRight()
    velocity.setArray(start.velocity)
    state = initial_state(solver, velocity=velocity)
    ledger = EnergyLedger(start.system)
    stepper = Stepper(scheme, solver, ledger, dj.StepControl())
    given = first = ledger.start(state).stored
    failure, newton, growth = "", 0, 0.0
    try:
        for _ in range(steps):
            for after, report, row in stepper.substeps(state, cell.dt * start.period):
                state = after
                ledger.record(row)
                given = max(given, first + abs(row.input))
                newton = max(newton, report.solve.iterations)
                growth = max(growth, row.stored / given - 1.0)
            if not (growth <= 1.0 and math.isfinite(row.stored)):
                failure = "energy"
                break
    except dj.ConvergenceError:
        failure = "convergence"
    except dj.JointsError:
        failure = "balance"
    return Outcome(
        failure=failure,
        newton=newton,
        ledger=ledger.relative_imbalance,
        growth=growth,
        cut=stepper.counts.rejected,
    )


def cells(*, quick: bool) -> Iterator[Cell]:
    """All cells."""
    ratios = (1e-4, 1.0, 1e6, 1e12, RIGID) if quick else (1e-4, 1, 1e2, 1e4, 1e8, 1e12, RIGID)
    angles = (30.0, 89.9) if quick else (0.0, 30.0, 60.0, 89.9)
    lengths = (1e-3, 1e-1, 1.0) if quick else (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
    for model, ratio, dt in product(MODELS, ratios, lengths):
        sliding = (0.0,) if model == "bounce" else angles
        for angle, gap, damping in product(sliding, (0.0, 0.5), (0.0, 1.0)):
            if quick and (gap > 0) != (damping > 0):
                continue
            yield Cell(model=model, ratio=ratio, angle=angle, dt=dt, gap=gap, damping=damping)


Row = tuple[Cell, Outcome]


def run_all(names: list[str], *, quick: bool, steps: int) -> dict[str, list[Row]]:
    """All cells of all schemes."""
    rows: dict[str, list[Row]] = {}
    for name in names:
        began = clock.perf_counter()
        rows[name] = [
            (cell, march(cell, SCHEMES[name], steps))
            for cell in cells(quick=quick)
            if cell.ratio != RIGID or name in CONSISTENT
        ]
        print_scheme(name, rows[name], clock.perf_counter() - began)
    return rows


def summary(rows: list[Row]) -> dict[str, Any]:
    """Counts and largest values of some cells."""
    outcomes = [outcome for _, outcome in rows]
    return {
        "cells": len(outcomes),
        "failed": sum(bool(outcome.failure) for outcome in outcomes),
        **{
            f"failed_{why}": sum(outcome.failure == why for outcome in outcomes)
            for why in ("convergence", "balance", "energy")
        },
        "ledger_max": max(outcome.ledger for outcome in outcomes),
        "growth_max": max(outcome.growth for outcome in outcomes),
        "newton_max": max(outcome.newton for outcome in outcomes),
        "cut": sum(outcome.cut for outcome in outcomes),
    }


def print_scheme(name: str, rows: list[Row], seconds: float) -> None:
    """One line per model."""
    print(f"{name} ({seconds:.0f} s)")
    for model in MODELS:
        found = summary([row for row in rows if row[0].model == model])
        print(
            f"  {model:>7}: {found['failed']:>4} of {found['cells']:>4} failed "
            f"(convergence {found['failed_convergence']}, balance {found['failed_balance']}, "
            f"energy {found['failed_energy']}); Newton at most {found['newton_max']}, "
            f"ledger {found['ledger_max']:.1e}, growth {found['growth_max']:.1e}, "
            f"{found['cut']} attempts rejected",
            flush=True,
        )


def drift(steps: int) -> dict[str, Any]:
    """A mass with a stop 1e4 times as stiff, dt T/20, over very many steps: its energy."""
    cell = Cell(model="bounce", ratio=1e4, angle=0.0, dt=0.05, gap=0.5, damping=0.0)
    began = clock.perf_counter()
    outcome = march(cell, SCHEMES["ec"], steps)
    return {
        "steps": steps,
        "failure": outcome.failure,
        "ledger": outcome.ledger,
        "seconds": clock.perf_counter() - began,
    }


def draw(path: Path, rows: dict[str, list[Row]]) -> None:
    """Share of the cells that failed over stiffness and time step, for each scheme and model."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    titles = {
        "ec": "energy-consistent",
        "ec_exact": "the same, 8 modes exact",
        "ec_dissipating": "8 modes exact, ρ 0.8",
        "implicit": "implicit contact",
        "newmark": "Newmark 1/4, 1/2",
        "hht": "HHT 0.1",
        "generalized_alpha": "generalized-α 0.8",
    }
    known = [cell for cell, _ in rows[max(rows, key=lambda name: len(rows[name]))]]
    ratios, lengths = sorted({c.ratio for c in known}), sorted({c.dt for c in known})
    figure, axes = plt.subplots(
        len(MODELS),
        len(rows),
        figsize=(2.1 * len(rows) + 1.0, 8.4),
        squeeze=False,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for (i, model), (j, name) in product(enumerate(MODELS), enumerate(rows)):
        share = np.full((len(ratios), len(lengths)), np.nan)
        for (a, ratio), (b, length) in product(enumerate(ratios), enumerate(lengths)):
            found = [
                bool(outcome.failure)
                for cell, outcome in rows[name]
                if (cell.model, cell.ratio, cell.dt) == (model, ratio, length)
            ]
            if found:
                share[a, b] = np.mean(found)
        image = draw_share(axes[i, j], share)
        if i == 0:
            axes[i, j].set_title(titles[name], fontsize=10)
        if j == 0:
            axes[i, j].set_ylabel(f"{model}\njoint / bulk stiffness", fontsize=9)
        if i == len(MODELS) - 1:
            axes[i, j].set_xlabel("Δt / T", fontsize=9)
        axes[i, j].set_xticks(range(len(lengths)), [power(v) for v in lengths], fontsize=8)
        axes[i, j].set_yticks(range(len(ratios)), [power(v) for v in ratios], fontsize=8)
    bar = figure.colorbar(image, ax=axes, shrink=0.5, aspect=30)
    bar.set_label("share of the cases that fail (grey: not offered)")
    figure.savefig(path, dpi=150)


def draw_share(axis: Any, share: np.ndarray) -> Any:
    """One map; shares above zero are written into it as per cent."""
    axis.set_facecolor("0.85")
    image = axis.imshow(share, origin="lower", aspect="auto", cmap="RdYlGn_r", vmin=0, vmax=1)
    for a, b in np.argwhere(share > 0):
        axis.text(b, a, f"{100 * share[a, b]:.0f}", ha="center", va="center", fontsize=7)
    return image


def power(value: float) -> str:
    """A power of ten as text."""
    return "rigid" if value == RIGID else f"$10^{{{round(math.log10(value))}}}$"


def main() -> None:
    """Print the tables, or one JSON object as the last line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer cases, less than a minute")
    parser.add_argument("--schemes", nargs="+", default=list(SCHEMES), choices=list(SCHEMES))
    parser.add_argument("--steps", type=at_least(1), help="steps of each case, 30 (quick) or 80")
    parser.add_argument(
        "--long", type=at_least(1), metavar="STEPS", help="drift over so many steps"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    parser.add_argument("--plot", type=Path, help="write the map to this file")
    options = parser.parse_args()
    steps = options.steps or (30 if options.quick else 80)
    rows = run_all(options.schemes, quick=options.quick, steps=steps)
    answer: dict[str, Any] = {"schemes": {name: summary(found) for name, found in rows.items()}}
    for name, found in rows.items():
        for cell, outcome in found:
            if name in CONSISTENT and outcome.failure:
                print(f"ec failed ({outcome.failure}): {cell}")
    if options.long:
        answer["long"] = drift(options.long)
        print(
            f"{options.long} steps: ledger {answer['long']['ledger']:.1e} "
            f"in {answer['long']['seconds']:.0f} s"
        )
    if options.plot:
        draw(options.plot, rows)
    if options.json:
        print(json.dumps(answer))


if __name__ == "__main__":
    main()
