#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stability in stiff and extreme cases: number of failed runs, and imbalance of the energies.

Scenes:

- blocks: an elastic block on another one, without damping. The upper block is thrown at 0.25 m/s,
  down and sideways, after self weight or from above a gap that closes in five steps. The base is
  shaken by 2 g.
- wall, dam: the small scenes of `benchmarks.shared.scenes`, with strong motion from the first step.
- mass: a mass on a spring that bounces on a stop.

A run fails if its static stage fails, if a step fails after all halvings, or if the stored energy
exceeds twice the energy supplied so far. The imbalance is the unexplained energy of completed runs
over the largest energy; schemes with numerical damping have none. ``--page`` replaces the table of
docs/stability.md.
"""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.problems import Problem, Run, impact, march, of_model
from benchmarks.shared.scenes import GRAVITY, TIME_STEP, Scene, dam, wall
from benchmarks.shared.tables import table
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.time_integration.scheme import Scheme

DOCS = Path(__file__).resolve().parents[1] / "docs"
MARKS = "<!-- table of benchmarks/stability.py -->\n", "<!-- end of the table -->\n"
COLUMNS = "| case | runs | failed | largest imbalance |\n| {row} | {runs} | {failed} | {shown} |"
RIGID = math.inf
SCHEMES: dict[str, Scheme] = {
    "energy-consistent scheme": dj.EnergyConsistent(),
    "8 modes exact": dj.EnergyConsistent(exact_modes=8),
    "implicit contact": dj.ImplicitContact(),
    "Newmark": dj.Newmark(),
    "HHT, 0.1": dj.HilberHughesTaylor(alpha=0.1),
    "generalized-alpha, 0.8": dj.GeneralizedAlpha(spectral_radius=0.8),
}
CONSISTENT = list(SCHEMES)[:2]  # schemes that accept rigid joints


@dataclass(frozen=True, kw_only=True)
class Case:
    """Parameters of a run.

    Attributes:
        scene: ``blocks``, ``wall``, ``dam`` or ``mass``.
        stiffness: k_n [Pa/m], infinite for rigid joints.
        angle: Friction angle [degrees].
        dt: Time step [s].
        aspect: Width over height of the cells of the blocks.
        gap: Whether the blocks start above a gap.
        reach: Largest displacement of the base of the blocks [m].
        scheme: Name in `SCHEMES`.
        steps: Number of steps.
    """

    scene: str = "blocks"
    stiffness: float = 1e11
    angle: float = 30.0
    dt: float = 1e-3
    aspect: float = 1.0
    gap: bool = False
    reach: float = 1.0
    scheme: str = "energy-consistent scheme"
    steps: int = 30


JOINTS = (1e8, 1e11, 1e14, RIGID)
ANGLES = (0.0, 30.0, 60.0, 89.9)
STEPS = [10.0**n for n in range(-7, 1)]
SHORT = (1e-5, 1e-3)


def cases(**values: Sequence[Any]) -> list[Case]:
    """Return the cases of all combinations of values, with all `JOINTS` by default."""
    values = {"stiffness": JOINTS} | values
    return [Case(**dict(zip(values, items, strict=True))) for items in product(*values.values())]


def of_scene(name: str) -> list[Case]:
    """Return the cases of the wall or of the dam."""
    steps = [factor * TIME_STEP for factor in (0.1, 1.0, 10.0)]
    return cases(scene=(name,), stiffness=(1e9, 1e11, 1e13, 1e15, RIGID), angle=ANGLES, dt=steps)


def extremes(*aspect: float) -> list[Case]:
    """Return the cases of all extremes together."""
    stiffness, gap = (1e6, 1e16, RIGID), (False, True)
    return cases(stiffness=stiffness, angle=(0.0, 89.9), dt=(1e-7, 0.1), gap=gap, aspect=aspect)


def of_scheme(name: str) -> list[Case]:
    """Return the cases of a time scheme."""
    stiffness = [*(10.0**n for n in range(6, 17, 2)), *[RIGID] * (name in CONSISTENT)]
    return cases(stiffness=stiffness, angle=ANGLES, dt=STEPS[2:], gap=(False, True), scheme=(name,))


ROWS: dict[str, list[Case]] = {
    "joint stiffness 1e6 to 1e16 Pa/m, rigid": cases(
        stiffness=[*(10.0**n for n in range(6, 17)), RIGID], dt=(1e-5, 1e-3, 1e-1)
    ),
    "time step 1e-7 to 0.1 s": cases(dt=STEPS[:-1]),
    "time step 1 s, base moves by 1 m": cases(angle=ANGLES, dt=(1.0,)),
    "time step 1 s, base shaken by 2 g": cases(angle=ANGLES, dt=(1.0,), reach=(math.inf,)),
    "friction angle 0 to 89.9 degrees": cases(
        angle=(0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 89.0, 89.9), dt=SHORT
    ),
    "flat cells, aspect ratio 10 to 1e3": cases(aspect=(1e1, 1e2, 1e3), dt=SHORT),
    "flat cells, aspect ratio 1e4 to 1e6": cases(aspect=(1e4, 1e5, 1e6), dt=SHORT),
    "slender cells, aspect ratio 10 to 1e3": cases(aspect=(1e-1, 1e-2, 1e-3), dt=SHORT),
    "slender cells, aspect ratio 1e4 to 1e6": cases(aspect=(1e-4, 1e-5, 1e-6), dt=SHORT),
    "blocks that meet after a gap": cases(angle=ANGLES, dt=STEPS[:-1], gap=(True,)),
    "blocks that meet after a gap, time step 1 s": cases(angle=ANGLES, dt=(1.0,), gap=(True,)),
    "extremes together": extremes(1.0),
    "extremes together, aspect ratio 1e6": extremes(1e-6, 1e6),
    "wall of four blocks": of_scene("wall"),
    "arch dam": of_scene("dam"),
    "a bouncing mass, 1e5 steps": [
        Case(scene="mass", stiffness=1e8, dt=math.pi / 500.0, steps=100_000)
    ],
} | {name: of_scheme(name) for name in SCHEMES}


def shaken(time: float, *, end: float, reach: float) -> np.ndarray:
    """Return the acceleration of the base of the blocks, shape (3,), [m/s^2]."""
    omega = np.array([9.0, 7.0, 11.0]) / end
    return np.minimum(2.0 * GRAVITY, reach * omega**2) * np.sin(omega * time)


@lru_cache
def jointed_scene(name: str, aspect: float, reach: float) -> tuple[Scene, dj.JointedMesh]:
    """Return a scene with its mesh."""
    if name == "blocks":
        width, height = (1.0 if x >= 1.0 else 0.5 * x for x in (aspect, 1.0 / aspect))
        size = {"length": width, "width": width, "lower_height": height, "upper_height": height}
        scene = Scene(
            name=name,
            write=partial(two_blocks, size=0.5, **size),
            material=dj.Elastic(young=30e9, poisson=0.2, density=2400.0),
            fixed=["base"],
            loads=[dj.Gravity()],
            shear_ratio=0.5,
            load_steps=1,
            shaking=lambda end: partial(shaken, end=end, reach=reach),
            crest=(0.0, 0.0, 2.0 * height),
        )
    else:
        scene = wall("tiny") if name == "wall" else dam("dam tiny")
    with scene.mesh_file() as path:
        return scene, scene.read(path)


def problem(case: Case) -> Problem:
    """Return the system of a case with its initial state.

    Raises:
        JointsError: The static stage fails.
    """
    if case.scene == "mass":
        return impact(case.stiffness / 1e4, periods=case.steps / 100)
    scene, jointed = jointed_scene(case.scene, case.aspect, case.reach)
    thrown = np.array([0.15, 0.05, -0.2])
    options: dict[str, Any] = {"damping": None} if case.scene == "blocks" else {}
    gaps = {"joint_1": -5.0 * case.dt * thrown[2]} if case.gap else {}
    joints = dj.Joints(scene.law(case.stiffness, case.angle), initial_gaps=gaps)
    model = scene.model(jointed, joints, **options)
    end = case.steps * case.dt
    return of_model(
        model,
        period=case.dt,
        end=end,
        static=None if case.gap else dj.Simulation(model).statics(steps=scene.load_steps),
        upper=thrown if case.scene == "blocks" else None,
        motion=scene.strong_shaking(end),
    )


def run(case: Case) -> tuple[str, Run | None]:
    """Run a case; return the reason of failure (empty without failure) and the completed run."""
    try:
        end = march(problem(case), SCHEMES[case.scheme], case.dt)
    except dj.JointsError as error:
        return str(error), None
    return ("" if end.growth <= 2.0 else "the stored energy grows"), end


def measure(name: str, chosen: list[Case]) -> dict[str, Any]:
    """Run the cases of a table row and return it; print the failed runs."""
    failed, ledgers = 0, []
    for case in chosen:
        failure, end = run(case)
        if failure:
            failed += 1
            print(f"failed: {case}: {failure}", file=sys.stderr, flush=True)
        if end is not None and end.ledger is not None:
            ledgers.append(end.ledger)
    imbalance = max(ledgers, default=None)
    shown = "-" if imbalance is None else f"{imbalance:.0e}"
    runs = {"row": name, "runs": len(chosen), "failed": failed}
    return runs | {"imbalance": imbalance, "shown": shown}


def main(arguments: list[str] | None = None) -> None:
    """Print the table; write the page with ``--page``."""
    # Ignore warnings of large slip and inaccurate steps, which are expected here.
    warnings.simplefilter("ignore")
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="every 7th run of each row")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    parser.add_argument("--page", action="store_true", help="write docs/stability.md")
    options = parser.parse_args(arguments)
    if options.quick and options.page:
        parser.error("--page needs all runs; omit --quick")
    lines = []
    for name, chosen in ROWS.items():
        part = [replace(case, steps=min(case.steps, 100)) for case in chosen[::7]]
        lines.append(measure(name, part if options.quick else chosen))
    text = table(COLUMNS, lines)
    print(text)
    if options.page:
        page, (start, end) = DOCS / "stability.md", MARKS
        before, after = page.read_text(encoding="utf-8").split(start)
        after = after.split(end)[1]
        page.write_text(f"{before}{start}\n{text}\n\n{end}{after}", encoding="utf-8")
    if options.json:
        print(json.dumps(lines))


if __name__ == "__main__":
    main()
