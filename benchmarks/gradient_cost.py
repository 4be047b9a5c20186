#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of a gradient by all joint parameters, divided by the cost of the recorded run.

The scene is the jointed wall of `benchmarks.shared.scenes` in strong motion. The quantity is the
sum of the squared crest displacements. Times are the processor times of all ranks.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.scenes import TIME_STEP, wall
from dolfinx_joints.common.command_line import Parser

CREST = dj.Quantity(
    value=lambda h: float(np.sum(h.values["crest"] ** 2)),
    derivative=lambda h: {"crest": 2.0 * h.values["crest"]},
)


def cost(model: dj.Model, scene: Any, scheme: Any, steps: int) -> dict[str, float]:
    """Return processor times of static stage, motion and gradients [s], and parameters."""
    clock = time.process_time
    shaking = scene.strong_shaking(TIME_STEP * steps)

    def seconds(work: Any) -> float:
        begin = clock()
        work()
        return float(model.jointed.mesh.comm.allreduce(clock() - begin))

    static, whole = dj.Tape({"crest": scene.crest}), dj.Tape({"crest": scene.crest})
    alone = dj.Simulation(model, monitors=[static])
    row = {"statics": seconds(lambda: alone.statics(steps=scene.load_steps))}
    row["gradient of statics"] = seconds(lambda: dj.gradient_of(static, CREST))
    run = dj.Simulation(model, monitors=[whole])
    run.statics(steps=scene.load_steps)
    facts = {"dt": TIME_STEP, "steps": steps, "motion": shaking, "scheme": scheme}
    row["motion"] = seconds(lambda: run.dynamics(**facts))
    row["gradient"] = seconds(lambda: dj.gradient_of(whole, CREST))
    row["parameters"] = 4 * model.contact.operator.num_points
    return row


def main(argv: list[str] | None = None) -> None:
    """Print a table."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=200, help="time steps (default: %(default)s)")
    parser.add_argument("--mesh", default="coarse", help="tiny, coarse or medium")
    parser.add_argument("--quick", action="store_true", help="tiny mesh, 10 steps")
    given = parser.parse_args(argv)
    mesh, steps = ("tiny", 10) if given.quick else (given.mesh, given.steps)
    scene = wall(mesh)
    with scene.mesh_file() as path:
        jointed = scene.read(path)
    model = scene.model(jointed, scene.law())
    for scheme in (dj.EnergyConsistent(), dj.Newmark()):
        cost(model, scene, scheme, 2)  # compiles
        row = cost(model, scene, scheme, steps)
        if jointed.mesh.comm.rank == 0:
            print(
                f"{type(scheme).__name__:17s} {row['parameters']} parameters: statics "
                f"{row['statics']:.3f} s, gradient {row['gradient of statics']:.3f} s; motion "
                f"{row['motion']:.3f} s, gradient of both {row['gradient']:.3f} s, ratio "
                f"{row['gradient'] / (row['motion'] + row['statics']):.2f}"
            )


if __name__ == "__main__":
    main()
