#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accuracy and cost of `EnergyConsistent(exact_modes=...)`, compared with the plain scheme.

- Two rods tied by a closed joint: error of the lowest mode over ten periods, and the jump of the
  velocity across the joint over the largest velocity.
- A mass that strikes a stop, over two periods of the motion: error with steps of T/20 in flight and
  T/1500 near the stop, and the smallest number of such steps for an error.
- A bar of 40 cells, fixed at one end, that strikes a stop with the other end: error by number of
  steps, relative to the motion of the same cells without error in time.
- ``--cost``: processor time per step of a wall or dam.

Errors are root mean squares in time over that of the exact motion; for the rods they are the
largest error over the amplitude.
"""

from __future__ import annotations

import math
import warnings
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh
from scipy.optimize import brentq

import dolfinx_joints as dj
from benchmarks.shared.measure import Marching
from benchmarks.shared.problems import (
    Problem,
    bar_matrices,
    first_state,
    impact,
    march,
    oscillator,
)
from benchmarks.shared.scenes import DAM_SIZES, DIVISIONS, TIME_STEP, dam, wall
from benchmarks.shared.tables import table
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.exact import ImpactOscillator
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger

Floats = NDArray[np.float64]

CELLS = 40
# Bar: stiffness of its stop over its own, end of the run [s], and number of compared times.
STOP, END, SHOWN = 10.0, 16.0, 50


RODS = (
    "| stiffness | steps | error, plain | jump | 4 modes exact | jump | ledger |\n"
    "| {stiffness:.0e} | {steps} | {plain[0]:.4f} | {plain[1]:.0e} | {exact[0]:.4f} |"
    " {exact[1]:.0e} | {exact[2]:.0e} |"
)
COST = (
    "| exact | step [ms] | over plain | first step [ms] |\n"
    "| {exact} | {step:.1f} | {ratio:.3f} | {first:.0f} |"
)


def scheme(modes: int) -> dj.EnergyConsistent:
    """Return the scheme that is exact in the given number of modes."""
    return dj.EnergyConsistent(exact_modes=modes)


def bars(*stiffnesses: float) -> tuple[Floats, Floats]:
    """Return M and K of separate bars of unit length and density."""
    parts = [bar_matrices(CELLS, young=young) for young in stiffnesses]
    return tuple(block_diag(*matrices) for matrices in zip(*parts, strict=True))


# ---------------------------------------------------------------- closed joints


def tied(joint_stiffness: float, steps: int, modes: int) -> tuple[float, float, float]:
    """Return error, velocity jump and energy imbalance of two rods pressed together."""
    mass, stiffness = (whole[1:-1, 1:-1] for whole in bars(1.0, 3.0))
    gap = np.zeros((3, len(mass)))
    gap[0, CELLS - 1 : CELLS + 1] = -1.0, 1.0
    law = dj.frictionless(normal_stiffness=joint_stiffness)
    system = dj.MatrixSystem.from_arrays(
        mass=mass, stiffness=stiffness, gap=gap, law=law, initial_gap=-1.0
    )
    closed = stiffness + joint_stiffness * np.outer(gap[0], gap[0])
    static = np.linalg.solve(closed, joint_stiffness * gap[0])
    squares, shapes = eigh(closed, mass)
    shape, omega = 0.1 * shapes[:, 0] / np.abs(shapes[:, 0]).max(), math.sqrt(squares[0])
    period = 2.0 * math.pi / omega
    problem = Problem(
        system=system,
        period=period,
        end=10.0 * period,
        displacement=static + shape,
        velocity=np.zeros(len(mass)),
    )
    run = march(problem, scheme(modes), period / steps)
    reference = static + np.cos(omega * run.time)[:, None] * shape
    off = float(np.abs(run.displacement - reference).max()) / 0.1
    jump = np.abs(run.velocity @ gap[0]).max() / np.abs(run.velocity).max()
    return off, float(jump), run.ledger or 0.0


def closed_joints() -> None:
    """Print the table of the rods."""
    rows = []
    for stiffness, steps in product((1.0, 1e2, 1e6), (20, 80)):
        plain, exact = (tied(stiffness, steps, modes) for modes in (0, 4))
        rows.append({"stiffness": stiffness, "steps": steps, "plain": plain, "exact": exact})
    print(f"Closed joint\n{table(RODS, rows)}")


# ---------------------------------------------------------------- impacts


def struck(
    problem: Problem, exact: ImpactOscillator, modes: int, away: float, near: float
) -> tuple[int, float]:
    """Return steps and error of the mass, with long steps if the stop is open before and after."""
    solver, ledger = make_solver(problem.system), EnergyLedger(problem.system)
    state = first_state(problem, solver)
    ledger.start(state)
    steps, squares, before = 0, 0.0, 0.0
    while state.time < problem.end:
        for part in (away, near):
            after, report = scheme(modes).advance(solver, state, problem.period / part)
            if state.joints.state.gap[0, 0] > 0.0 and after.joints.state.gap[0, 0] > 0.0:
                break
        ledger.record(ledger.after(after, report))
        off = float(after.displacement.array[0] - exact.displacement(after.time))
        squares += 0.5 * report.dt * (off**2 + before**2)
        state, before, steps = after, off, steps + 1
    assert ledger.relative_imbalance < 1e-10
    return steps, math.sqrt(squares / state.time) / exact.amplitude


def impacts() -> None:
    """Print the table of the impact oscillator."""
    print("\nImpact          error with T/20, T/1500   fewest steps for 1e-2, 1e-3, 1e-4")
    grid = [
        (a, n) for a in (8, 12, 16, 40, 160, 320) for n in (160, 320, 480, 800, 1200, 3000) if n > a
    ]
    for gap in (0.0, 0.03):
        exact = oscillator(100.0, gap)
        problem = impact(100.0, gap=gap, periods=2.0 * exact.period / exact.free_period)
        for modes in (0, 1):
            _, paper = struck(problem, exact, modes, 20, 1500)
            runs = [struck(problem, exact, modes, *parts) for parts in grid]
            fewest = [min((n for n, e in runs if e <= t), default=0) for t in (1e-2, 1e-3, 1e-4)]
            text = " ".join(f"{n:5d}" if n else " more" for n in fewest)
            print(f"gap {gap:4.2f} m, {modes} exact {paper:16.2e}             {text}")


def bar_and_start() -> tuple[Floats, Floats, Floats]:
    """Return M and K of a bar that is fixed at its far end, and its initial velocity."""
    mass, stiffness = (whole[:-1, :-1] for whole in bars(1.0))
    shape = eigh(stiffness, mass)[1][:, 0]
    return mass, stiffness, -shape / shape[0]


def striking_bar(modes: int, steps: int) -> Floats:
    """Return the bar's displacements at `SHOWN` times of a run, shape (`SHOWN`, dofs)."""
    mass, stiffness, velocity = bar_and_start()
    gap = np.zeros((3, len(mass)))
    gap[0, 0] = 1.0
    law = dj.frictionless(normal_stiffness=STOP)
    problem = Problem(
        system=dj.MatrixSystem.from_arrays(mass=mass, stiffness=stiffness, gap=gap, law=law),
        period=4.0,
        end=END,
        displacement=np.zeros(len(mass)),
        velocity=velocity,
    )
    run = march(problem, scheme(modes), END / steps)
    assert run.ledger is not None
    assert run.ledger < 1e-10
    return run.displacement[steps // SHOWN - 1 :: steps // SHOWN]


def right_bar(scan: float = 2e-4) -> tuple[Floats, int]:
    """Return the bar's displacements without error in time, and the number of impacts.

    The bar is linear between impact and release. These times are found by sign changes of the gap
    in steps of ``scan`` [s] and then as roots.
    """
    mass, stiffness, velocity = bar_and_start()
    touched = stiffness.copy()
    touched[0, 0] += STOP
    forms = [eigh(matrix, mass) for matrix in (stiffness, touched)]
    displacement, begin, closed, strikes = np.zeros(len(mass)), 0.0, True, 1
    times = END / SHOWN * np.arange(1, SHOWN + 1)
    displacements = np.empty((SHOWN, len(mass)))
    while begin < END:
        squares, shapes = forms[closed]
        omega = np.sqrt(squares)
        cosine, sine = shapes.T @ mass @ displacement, shapes.T @ mass @ velocity / omega

        def moved(after: Any, w=omega, a=cosine, b=sine, phi=shapes) -> Floats:
            angle = np.multiply.outer(after, w)
            return (np.cos(angle) * a + np.sin(angle) * b) @ phi.T

        after = scan * np.arange(1, math.ceil((END - begin) / scan) + 2)
        turned = np.flatnonzero((moved(after)[:, 0] < 0.0) != closed)
        last = float(after[turned[0]]) if len(turned) else float(after[-1])
        if len(turned):
            last = brentq(lambda s, of=moved: of(s)[0], max(last - scan, 1e-9), last, xtol=1e-15)
        in_interval = (times > begin) & (times <= begin + last)
        displacements[in_interval] = moved(times[in_interval] - begin)
        displacement = moved(last)
        angle = omega * last
        velocity = shapes @ (omega * (sine * np.cos(angle) - cosine * np.sin(angle)))
        begin, closed = begin + last, not closed
        strikes += closed and begin < END
    return displacements, strikes


def bar() -> None:
    """Print the table of the bar."""
    reference, strikes = right_bar()
    counts = [SHOWN * 2**power for power in range(1, 9)]
    print(f"\nBar of {CELLS} cells, {strikes} impacts: error by the number of steps")
    print("steps    " + "".join(f"{steps:9d}" for steps in counts) + "   for 1e-2, 1e-3")
    for modes in (0, 5, 10, 40):
        off = [float(np.linalg.norm(striking_bar(modes, n) - reference)) for n in counts]
        off = [error / float(np.linalg.norm(reference)) for error in off]
        needed = " ".join(f"{steps_for(goal, counts, off):7.0f}" for goal in (1e-2, 1e-3))
        print(f"{modes:2d} exact " + "".join(f"{e:9.1e}" for e in off) + f"  {needed}", flush=True)


def steps_for(goal: float, steps: list[int], off: list[float]) -> float:
    """Return the number of steps for an error, interpolated between two runs.

    The interpolation is linear in the logarithms. The result is infinite if the finest run does not
    reach the goal.
    """
    if off[-1] > goal:
        return math.inf
    last = max((i for i, error in enumerate(off) if error > goal), default=-1)
    if last < 0:
        return float(steps[0])
    share = math.log(off[last] / goal) / math.log(off[last] / off[last + 1])
    return float(steps[last] * (steps[last + 1] / steps[last]) ** share)


def cost(name: str, counts: list[int], steps: int) -> None:
    """Print the processor time of steps of a wall or a dam, plain and exact in turn."""
    scene, dt = (dam(name) if name in DAM_SIZES else wall(name)), 0.4 * TIME_STEP
    with scene.mesh_file() as path:
        model = scene.model(scene.read(path), scene.law())
    static = dj.Simulation(model).statics(steps=scene.load_steps)
    motion = dj.BaseMotion(acceleration=scene.strong_shaking(steps * dt))
    runs = [Marching(model.system([motion]), dt, static, scheme(n)) for n in (0, *counts)]
    for _ in range(steps):
        for run in runs:
            run.step()
    rows = [
        {
            "exact": exact,
            "step": np.median(run.ms[1:]),
            "ratio": np.median(np.divide(run.ms, runs[0].ms)[1:]),
            "first": run.ms[0],
        }
        for exact, run in zip((0, *counts), runs, strict=True)
    ]
    print(f"{name}, {model.num_dofs} dofs, {dt * 1e3:.2f} ms: processor time per step")
    print(table(COST, rows))


def main(arguments: list[str] | None = None) -> None:
    """Print tables."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--modes", type=int, nargs="+", default=[20], help="exact ones")
    parser.add_argument(
        "--cost", choices=(*DIVISIONS, *DAM_SIZES), help="time per step of this wall or dam instead"
    )
    parser.add_argument("--steps", type=int, default=60, help="of --cost")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    if options.cost:
        cost(options.cost, options.modes, options.steps)
    else:
        closed_joints()
        impacts()
        bar()


if __name__ == "__main__":
    main()
