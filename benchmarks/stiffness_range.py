#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the wall and the dam run to their end at any stiffness, friction and time step.

Joints from soft to rigid (k_s follows k_n), friction from none to almost 90 degrees, steps from a
tenth to ten times the usual: each case is loaded statically and then shaken for ``--steps`` steps,
strongly from the first one on. A case passes if it completes and its energy lines leave less than
1e-9 of the largest energy unexplained. Exit status 1 if one did not.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, get_args

from mpi4py import MPI

import dolfinx_joints as dj
from benchmarks.shared.measure import free_memory
from benchmarks.shared.scenes import TIME_STEP, Scene, dam, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.simulation.record import Record
from dolfinx_joints.solvers.choice import SolverKind

STIFFNESSES = (1e9, 1e11, 1e13, 1e15, math.inf)
ANGLES = (0.0, 30.0, 60.0, 89.9)
STEP_FACTORS = (0.1, 1.0, 10.0)
QUICK = {"stiffness": (1e11, math.inf), "angle": (30.0, 89.9), "factor": (1.0, 10.0)}
LARGEST_LEDGER = 1e-9
NEWTON = dj.SolverOptions()


@dataclass(frozen=True, kw_only=True)
class Result:
    """How a case went.

    Attributes:
        scene: Its name.
        stiffness: k_n [Pa/m], infinite for rigid joints.
        angle: Friction angle [degrees].
        dt: Time step [s].
        failure: What ended it, empty if it completed.
        static_newton: Newton iterations of the static stage.
        newton_mean: Per substep.
        newton_max: Of a step's last substep.
        open: Largest share of the joint points that were open at once.
        slip: The same, sliding.
        halved: Rejected attempts.
        ledger: Largest imbalance of all energy lines over the largest energy.
    """

    scene: str
    stiffness: float
    angle: float
    dt: float
    failure: str = ""
    static_newton: int = 0
    newton_mean: float = math.nan
    newton_max: int = 0
    open: float = 0.0
    slip: float = 0.0
    halved: int = 0
    ledger: float = math.nan

    @property
    def passed(self) -> bool:
        """Whether it completed with its energies in balance."""
        return not self.failure and self.ledger <= LARGEST_LEDGER


class _Extremes(Monitor):
    """Monitor that keeps the most Newton iterations, and the most points open and sliding."""

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """A new stage."""
        self.newton, self.open, self.slip = 0, 0.0, 0.0

    def record(self, record: Record) -> None:
        """Look at a step."""
        assert record.solve is not None
        assert record.solve.counts is not None
        counts = record.solve.counts
        self.newton = max(self.newton, record.solve.iterations)
        self.open = max(self.open, counts.open / counts.total)
        self.slip = max(self.slip, counts.slip / counts.total)


def run_scene(scene: Scene, options: argparse.Namespace) -> Iterator[Result]:
    """All cases of a scene; each static state serves all time steps (collective)."""
    with scene.mesh_file() as mesh:
        jointed = scene.read(mesh)
    for stiffness in options.stiffness:
        for angle in options.angle:
            free_memory()
            yield from run_law(scene, jointed, stiffness, angle, options)


def run_law(
    scene: Scene,
    jointed: dj.JointedMesh,
    stiffness: float,
    angle: float,
    options: argparse.Namespace,
) -> Iterator[Result]:
    """The cases of one law (collective)."""
    extremes = _Extremes()
    model = scene.model(jointed, scene.law(stiffness, angle))
    simulation = dj.Simulation(model, monitors=[extremes], options=NEWTON, solver=options.solver)
    case: dict[str, Any] = {"scene": scene.name, "stiffness": stiffness, "angle": angle}
    steps = [factor * TIME_STEP for factor in options.factor]
    try:
        static = simulation.statics(steps=scene.load_steps)
    except dj.JointsError as error:
        yield from (Result(**case, dt=dt, failure=f"statics: {error}") for dt in steps)
        return
    case["static_newton"] = sum(report.iterations for report in static.reports)
    for dt in steps:
        motion = scene.strong_shaking(options.steps * dt)
        try:
            end = simulation.dynamics(dt=dt, steps=options.steps, motion=motion)
        except dj.JointsError as error:
            yield Result(**case, dt=dt, failure=f"dynamics: {error}")
            continue
        yield Result(
            **case,
            dt=dt,
            newton_mean=end.iterations / end.counts.accepted,
            newton_max=extremes.newton,
            open=extremes.open,
            slip=extremes.slip,
            halved=end.counts.rejected,
            ledger=end.imbalance if end.imbalance is not None else math.nan,
        )


def text_of(result: Result) -> str:
    """A line of the table."""
    stiffness = "rigid" if math.isinf(result.stiffness) else f"{result.stiffness:.0e}"
    start = (
        f"{result.scene:8} {stiffness:>6} {result.angle:8.1f} {1e3 * result.dt:7.3f}"
        f" {result.static_newton:8d}"
    )
    if result.failure:
        return f"{start}  FAILED: {result.failure}"
    verdict = "yes" if result.passed else "yes, but energies do not balance"
    return (
        f"{start} {result.newton_mean:6.2f} {result.newton_max:4d} {result.halved:6d}"
        f" {100 * result.open:4.0f} % {100 * result.slip:4.0f} %  {result.ledger:.1e}  {verdict}"
    )


HEAD = """\
Newton iterations of the static stage, and per step of the motion; halved: rejected attempts; open
and slip: most joint points that were at once; ledger: what all energy lines leave unexplained, over
the largest energy.

            k_n friction    step   static   Newton
scene      Pa/m  degrees      ms   Newton   mean  max halved   open   slip   ledger  completed"""


def as_json(results: Sequence[Result]) -> dict[str, Any]:
    """Counts, extremes and all cases; infinite stiffness as the text ``rigid``."""
    done = [r for r in results if not r.failure]
    return {
        "cases": len(results),
        "passed": sum(r.passed for r in results),
        "largest_ledger": max((r.ledger for r in done), default=None),
        "newton_max": max((r.newton_max for r in done), default=None),
        "halved": sum(r.halved for r in done),
        "results": [
            {
                **{k: None if v != v else v for k, v in asdict(r).items()},
                "stiffness": "rigid" if math.isinf(r.stiffness) else r.stiffness,
                "passed": r.passed,
            }
            for r in results
        ],
    }


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--scenes", nargs="+", default=["coarse", "dam"], choices=("tiny", "coarse", "dam")
    )
    parser.add_argument("--stiffness", nargs="+", type=float, help="k_n [Pa/m]; inf is rigid")
    parser.add_argument("--angle", nargs="+", type=float, help="friction angles [degrees]")
    parser.add_argument("--factor", nargs="+", type=float, help=f"of the time step {TIME_STEP} s")
    parser.add_argument("--steps", type=at_least(1), default=50)
    parser.add_argument("--solver", default="auto", choices=get_args(SolverKind))
    parser.add_argument("--quick", action="store_true", help="a few cases of the wall alone")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args(arguments)
    whole = {"stiffness": STIFFNESSES, "angle": ANGLES, "factor": STEP_FACTORS}
    for name, values in (QUICK if options.quick else whole).items():
        setattr(options, name, getattr(options, name) or values)
    if options.quick:
        options.scenes = ["coarse"]
    return options


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if a case did not pass."""
    # Steps ten times too long are inaccurate, and soft joints slip far: that is not the question.
    warnings.simplefilter("ignore")
    options = parse_arguments(arguments)
    root, results = MPI.COMM_WORLD.rank == 0, []
    if root:
        print(HEAD, flush=True)
    for name in options.scenes:
        for result in run_scene(dam() if name == "dam" else wall(name), options):
            results.append(result)
            if root:
                print(text_of(result), flush=True)
    passed = sum(result.passed for result in results)
    if root:
        print(f"\n{passed} of {len(results)} cases completed with ledger <= {LARGEST_LEDGER:g}")
        if options.json:
            print(json.dumps(as_json(results)))
    return int(passed < len(results))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    raise SystemExit(main())
