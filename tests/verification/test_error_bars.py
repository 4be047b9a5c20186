# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Estimated errors of `accuracy` over true ones, on scenes with exact solutions.

Scenes, all evaluated at one time (a largest value over the steps has no smooth error):

- a mass on a spring: u = v0 / omega sin(omega t);
- the same mass between impacts, `exact.ImpactOscillator`;
- the slip of Newmark's block, `exact.SlidingBlock`: its error is -A dt^2 / 4 (test_sliding_block);
- a clamped bar with the initial velocity V sin(k x), k = pi / (2 L). Of equal linear elements of
  length h it oscillates with w_h^2 = 6 c^2 / h^2 (1 - cos k h) / (2 + cos k h) [Hughes, The Finite
  Element Method, 9.3], and of the midpoint rule tan(w dt / 2) = w_h dt / 2: the errors of step and
  of cells are known one by one.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")
sys.path.insert(0, str(Path(__file__).parent))  # for the interpreters of the runs

from boxes import box
from test_sliding_block import EXACT, shake

import dolfinx_joints as dj
from benchmarks.shared.problems import impact, march, oscillator

GAP, RATIO = 0.03, 10.0
MASS = oscillator(RATIO, GAP)
LENGTH, SPEED = 20.0, 0.1  # m, m/s
CONCRETE = dj.Elastic(young=24e9, poisson=0.0, density=2400.0)
WAVE = math.sqrt(CONCRETE.young / CONCRETE.density)
NUMBER = math.pi / (2.0 * LENGTH)  # k [rad/m]
END = 0.8 * MASS.period  # in flight [s]
SIZE, DT = 1.0, MASS.free_period / 200.0
BAR_END = 0.7 * math.pi / (WAVE * NUMBER)  # after the first peak
BAR_STEPS = 120


def mass(gap, dt):
    problem = impact(RATIO, gap=gap, periods=END / MASS.free_period)
    steps = round(END / dt)
    return march(problem, dj.EnergyConsistent(), END / steps)


def bar(size, steps):
    """Displacement of the free end at `BAR_END` [m]."""
    mesh = box((LENGTH, 1.0), (round(LENGTH / size), 1), groups={"left": (0, 0.0)})
    model = dj.Model(dj.split_mesh(*mesh) if isinstance(mesh, tuple) else mesh,
        material=CONCRETE, supports=[dj.Fixed(group="left")])
    return model
