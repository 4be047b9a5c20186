# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A shaken jointed wall, the guide's reservoir in front of it, a monitor that stops its run."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor

CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)

LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)

POINTS = {"crest": dj.Probe((10.0, 0.0, 20.0), group="joint_2-"), "corner": (0.0, 4.0, 20.0)}

BASE = dj.Fixed(group="base")

DAMPING = dj.stiffness_proportional(ratio=0.02, frequency=5.0)

STEPS, DT = 12, 4e-3


class Killed(BaseException):
    """Replacement of a kill signal; no code handles it."""


class Killer(Monitor):
    """A monitor that stops the run in a step."""

    def __init__(self, step=None):
        self.step = step

    def record(self, record):
        if record.step == self.step:
            raise Killed


def shaking(time):
    """Ground acceleration strong enough to open the joints, [m/s^2]."""
    return 12.0 * np.sin(2 * np.pi * np.array([2.3, 2.9, 3.1]) * time + [0.0, 0.7, 1.9])


def swaying(time):
    """Weaker and faster ground acceleration: some joint points open and slide, [m/s^2]."""
    return 4.0 * np.array([np.sin(40.0 * time), np.sin(25.0 * time), 0.5 * np.sin(55.0 * time)])


def wall(jointed, joints=LAW, **changes):
    given = {"material": CONCRETE, "supports": [BASE], "loads": [dj.Gravity()], "damping": DAMPING}
    return dj.Model(jointed, joints=joints, **(given | changes))


def valley():
    """Return the reservoir of the guide with a meshed bed, in front of the wall's face y_min."""
    guide = Path(__file__).parents[1] / "docs/guide/water.md"
    blocks = re.findall("```python\n(.*?)```", guide.read_text("utf-8"), re.S)
    (block,) = (text for text in blocks if "bed =" in text)
    names = {"dj": dj, "np": np, "MPI": MPI}
    exec(block, names)
    return replace(names["valley"], group="y_min")


class JointPath(Monitor):
    """Monitor that collects gaps, tractions, friction work and numbers of points at each step."""

    def __init__(self):
        self.gaps, self.tractions, self.works, self.counts = [], [], [], []

    def start(self, model, stage, steps, first):
        self._comm = model.operator.comm

    def record(self, record):
        joints = record.joints
        kept = (joints.state.gap, joints.traction, joints.dissipation)
        for path, values in zip((self.gaps, self.tractions, self.works), kept, strict=True):
            path.append(np.concatenate(self._comm.allgather(values)))
        self.counts.append(record.solve.counts)


def far(one, two):
    """Return the largest difference of two paths, relative to the largest value."""
    return float(np.abs(np.array(one) - two).max() / np.abs(two).max())


def march(model, steps=20, solver="auto", scheme=None, **options):
    """Run self weight and some steps; return the path, the static stage and the outcome."""
    path, newton = JointPath(), dj.SolverOptions(**{"relative_tolerance": 1e-12, **options})
    simulation = dj.Simulation(model, options=newton, solver=solver, monitors=[path])
    static = simulation.statics()
    return path, static, simulation.dynamics(dt=0.005, steps=steps, motion=swaying, scheme=scheme)
