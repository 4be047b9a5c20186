# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A small run whose results file generated requests are made to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

STEPS = 40


def write_run(folder: Path, comm: Any) -> Path:
    """Two blocks, one on the other, in 40 steps of an earthquake; everything is recorded."""
    import dolfinx_joints as dj
    from geometry.two_blocks import two_blocks

    mesh = dj.read_msh(two_blocks(folder / "blocks.msh", size=0.5), comm)
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=4e9, friction_angle_deg=30.0)
    model = dj.Model(
        mesh,
        material=dj.Elastic(young=25e9, poisson=0.2, density=2400.0),
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    path = folder / "run.h5"
    monitor = dj.ResultsMonitor(
        path,
        points={"top": (0.5, 0.5, 2.0), "middle": (0.0, 0.0, 1.0)},
        every=5,
        envelopes=True,
        resultants=True,
    )
    run = dj.Simulation(model, monitors=[monitor])
    run.statics()
    motion = dj.synthetic_motion(duration=2.0)
    run.dynamics(dt=0.005, steps=STEPS, motion=motion)
    return path
