#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the condensed solver gives what the monolithic Newton method gives.

steps: from each state of a condensed run the same step is taken with both solvers. Compared are
displacements, velocities and joint forces, largest entries, relative to the largest entry that the
run has had so far; the bound is 1e-9.

histories: two whole runs, one with each solver, over the first ``--history`` steps. Compared is the
displacement from the static state, relative to the largest one so far; the bound is 1e-8. Over many
more steps this cannot be bounded: impacts make neighbouring motions part.

The condensed solver runs with the tolerance that users get, the reference with one of 1e-13. A step
that the reference does not solve cannot be compared; it counts as a miss. Exit status 1 if a bound
is missed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from petsc4py import PETSc

import dolfinx_joints as dj
from benchmarks.shared.scenes import TIME_STEP, Scene, dam, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.step_solver import StepSolver
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.states import DynamicState

SCHEME = dj.EnergyConsistent()
REFERENCE = dj.SolverOptions(relative_tolerance=1e-13)
BOUNDS = {"steps": 1e-9, "histories": 1e-8}

Vector = Callable[[DynamicState], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Both solvers of a scene's dynamic stage and the state it begins with.

    Attributes:
        condensed: The solver in question.
        monolithic: The reference.
        start: The static state.
        areas: Of the local joint points [m^2].
    """

    condensed: StepSolver
    monolithic: StepSolver
    start: DynamicState
    areas: np.ndarray


def prepare(scene: Scene, steps: int) -> Pair:
    """Static state and solvers (collective)."""
    with scene.mesh_file() as mesh:
        model = scene.model(scene.read(mesh), scene.law())
    static = dj.Simulation(model).statics(steps=scene.load_steps)
    motion = dj.BaseMotion(acceleration=scene.shaking(steps * TIME_STEP))
    system = model.system([motion])
    condensed = make_solver(system, kind="condensed", rule=SCHEME.rule)
    return Pair(
        condensed=condensed,
        monolithic=make_solver(system, REFERENCE, "monolithic", SCHEME.rule),
        start=initial_state(condensed, displacement=static.displacement, joints=static.joints),
        areas=model.operator.areas,
    )


class _Difference:
    """The largest difference of a quantity, relative to its largest entry so far."""

    def __init__(self, quantity: Vector, start: DynamicState) -> None:
        self._quantity = quantity
        self._scale = _largest(quantity(start))
        self.largest = 0.0

    def see(self, state: DynamicState, reference: DynamicState) -> None:
        """Compare two states (collective)."""
        a, b = self._quantity(state), self._quantity(reference)
        self._scale = max(self._scale, _largest(b))
        off = _largest(a - b)
        self.largest = max(self.largest, off / self._scale if off else 0.0)


def _largest(values: np.ndarray) -> float:
    """Largest entry of all ranks (collective)."""
    return MPI.COMM_WORLD.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


def _array(vector: PETSc.Vec) -> np.ndarray:
    return vector.getArray(readonly=True)


def compare_steps(pair: Pair, steps: int) -> dict[str, Any]:
    """The same steps with both solvers (collective)."""
    quantities: dict[str, Vector] = {
        "displacement": lambda state: _array(state.displacement),
        "velocity": lambda state: _array(state.velocity),
        "joint_force": lambda state: pair.areas[:, None] * state.joints.traction,
    }
    state, unsolved = pair.start, 0
    differences = {name: _Difference(q, state) for name, q in quantities.items()}
    for _ in range(steps):
        after, _ = SCHEME.advance(pair.condensed, state, TIME_STEP)
        try:
            reference, _ = SCHEME.advance(pair.monolithic, state, TIME_STEP)
        except dj.ConvergenceError:
            unsolved += 1
        else:
            for difference in differences.values():
                difference.see(after, reference)
        state = after
    return {
        "steps": steps,
        "unsolved": unsolved,
        **{name: difference.largest for name, difference in differences.items()},
    }


def compare_histories(pair: Pair, steps: int) -> dict[str, Any]:
    """Two whole runs (collective)."""
    origin = _array(pair.start.displacement).copy()
    difference = _Difference(lambda state: _array(state.displacement) - origin, pair.start)
    state = reference = pair.start
    for _ in range(steps):
        state, _ = SCHEME.advance(pair.condensed, state, TIME_STEP)
        reference, _ = SCHEME.advance(pair.monolithic, reference, TIME_STEP)
        difference.see(state, reference)
    return {"steps": steps, "displacement": difference.largest}


def compare(scene: Scene, steps: int, history: int) -> dict[str, Any]:
    """Both comparisons of a scene, and whether they keep the bounds (collective)."""
    pair = prepare(scene, max(steps, history))
    found = {
        "dofs": pair.start.displacement.getSize(),
        "joint_points": MPI.COMM_WORLD.allreduce(len(pair.areas)),
        "by_step": compare_steps(pair, steps),
        "history": compare_histories(pair, history),
    }
    each = [found["by_step"][name] for name in ("displacement", "velocity", "joint_force")]
    found["passed"] = bool(
        found["by_step"]["unsolved"] == 0
        and max(each) <= BOUNDS["steps"]
        and found["history"]["displacement"] <= BOUNDS["histories"]
    )
    return found


HEAD = f"""\
Largest relative differences of the condensed from the monolithic solver. Bounds:
{BOUNDS["steps"]:g} step by step from equal states, {BOUNDS["histories"]:g} over a history.
unsolved: steps that the reference did not solve.

                      | step by step                                        | history
scene      dofs points| steps unsolved  displacement  velocity  joint force | steps  displacement"""


def text_of(name: str, found: dict[str, Any]) -> str:
    """A line of the table."""
    by_step, history = found["by_step"], found["history"]
    return (
        f"{name:8} {found['dofs']:6d} {found['joint_points']:6d}| {by_step['steps']:5d}"
        f" {by_step['unsolved']:8d} {by_step['displacement']:13.1e} {by_step['velocity']:9.1e}"
        f" {by_step['joint_force']:12.1e} | {history['steps']:5d} {history['displacement']:13.1e}"
        f"  {'agree' if found['passed'] else 'MISSED'}"
    )


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Options of the command line."""
    names = ("tiny", "coarse", "dam")
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=list(names), choices=names)
    parser.add_argument("--steps", type=at_least(1), default=200, help="steps compared one by one")
    parser.add_argument(
        "--history", type=at_least(1), default=50, help="steps of the two whole runs"
    )
    parser.add_argument("--quick", action="store_true", help="the tiny wall alone")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args(arguments)
    if options.quick:
        options.scenes = ["tiny"]
    return options


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if a bound is missed."""
    options = parse_arguments(arguments)
    root, rows = MPI.COMM_WORLD.rank == 0, {}
    if root:
        print(HEAD, flush=True)
    for name in options.scenes:
        scene = dam() if name == "dam" else wall(name)
        rows[name] = compare(scene, options.steps, options.history)
        if root:
            print(text_of(name, rows[name]), flush=True)
    if root and options.json:
        print(json.dumps(rows))
    return int(not all(row["passed"] for row in rows.values()))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    raise SystemExit(main())
