# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mean friction of a sliding elastic block, by damping, joint and time step.

A block of 1 x 0.1 x 0.5 m on a base of 0.2 m, with cells of 0.1 m, slides at 0.02 m/s under its
weight with mu = 0.5. The driving force equals the friction, so in 0.02 s the speed should not
change and friction should be mu times the weight. Sliding friction excites short waves. Their
damping is given in units of h/c, the travel time of sound along a cell.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.problems import Problem, march, of_model
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.laws.law import CondensedLaw

FRICTION, SPEED, END, SIZE = 0.5, 0.02, 0.02, 0.1  # -, m/s, s, m
CONCRETE = dj.Elastic(young=30e9, poisson=0.2, density=2400.0)
TRANSIT = SIZE / math.sqrt(CONCRETE.young / CONCRETE.density)  # h/c [s]


class Slide(NamedTuple):
    """Mean friction over its limit in the second half, number of steps, chattering joints."""

    late: float
    steps: int
    chatter: dict[str, float]


def slide(
    law: CondensedLaw,
    steps: int,
    damping: float = 0.0,
    control: dj.StepControl | None = None,
    end: float = END,
) -> Slide:
    """Run the sliding block with equal steps, or with step control.

    Args:
        law: Law of the joint, with mu = `FRICTION`.
        steps: Number of steps.
        damping: Factor of K over `TRANSIT`.
        control: Step control, equal steps by default.
        end: End of the run [s].
    """
    problem = replace(_block(law, damping), end=end)
    areas = problem.system.contact.operator.areas
    limit = FRICTION * float(areas @ problem.joints.traction[:, 0])
    run = march(problem, dj.EnergyConsistent(), end / steps, control)
    late = np.cumsum(run.dt) > 0.5 * end
    mean = run.dt[late] @ run.force[late] / run.dt[late].sum()
    return Slide(abs(mean / limit), run.steps, run.chatter)


def _block(law: CondensedLaw, damping: float) -> Problem:
    """Return the block after self weight, at its initial speed."""
    sizes = {"length": 1.0, "width": SIZE, "size": SIZE, "lower_height": 0.2, "upper_height": 0.5}
    model = dj.Model(
        mesh_of(two_blocks, cell="hex", **sizes),
        material=CONCRETE,
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=(0.0, 0.0, -10.0))],
        damping=dj.Rayleigh(stiffness_factor=damping * TRANSIT),
    )
    drive = np.array([-10.0 * FRICTION, 0.0, 0.0])
    return of_model(
        model,
        period=END,
        end=END,
        static=dj.Simulation(model).statics(),
        upper=(SPEED, 0.0, 0.0),
        motion=lambda _: drive,
        component=1,
    )


def stiff(stiffness: float) -> dj.FrictionNoTension:
    """Return a joint with k_n [Pa/m] and k_s = 0.4 k_n."""
    return dj.FrictionNoTension(
        normal_stiffness=stiffness,
        shear_stiffness=0.4 * stiffness,
        friction_coefficient=FRICTION,
    )


JOINTS: dict[str, CondensedLaw] = {
    "k = 1e11 Pa/m": stiff(1e11),
    "k = 1e13 Pa/m": stiff(1e13),
    "rigid": dj.RigidJoint(friction_coefficient=FRICTION),
    "rigid, restitution 0": dj.RigidJoint(friction_coefficient=FRICTION, restitution=0),
}


def _cut(tolerance: float | None) -> dj.StepControl:
    return dj.StepControl(tolerance=tolerance, max_halvings=8)


def main() -> None:
    """Print a table."""
    Parser(description=__doc__.splitlines()[0]).parse_args()
    print("friction over its limit in the second half; * chatters; -: no convergence")
    runs = [(20, None), (200, None), (2000, None)]
    runs += [(20, _cut(1e-3))]
    print(f"{'damping [h/c]':34s}" + "".join(f"{n:7d}{'t' if c else ' '} " for n, c in runs))
    for name, law in JOINTS.items():
        for damping in (0.0, 0.2, 1.0):
            cells = []
            for steps, control in runs:
                try:
                    end = slide(law, steps, damping, control)
                    cells.append(f"{end.late:7.3f}{'*' if end.chatter else ' '}")
                except dj.JointsError:
                    cells.append("      - ")
            print(f"{name:24s} {damping:8.1f} {' '.join(cells)}", flush=True)
    tolerances = None, 1e-3, 1e-4
    print("the same without damping over 0.1 s, 100 steps cut by tolerances: friction (steps)")
    print(f"{'':24s}" + "".join(f"{'none' if t is None else t:>15}" for t in tolerances))
    for name, law in JOINTS.items():
        ends = [slide(law, 100, control=_cut(tolerance), end=0.1) for tolerance in tolerances]
        cells = [f"{end.late:7.3f}{'*' if end.chatter else ' '} ({end.steps:4d})" for end in ends]
        print(f"{name:24s} {' '.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
