# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Effectivity of `accuracy`, estimated over true errors, on scenes with exact solutions.

All are evaluated at one time, as the largest value over the steps has no smooth error:

- a mass on a spring in flight, u = v0 / omega sin(omega t), and after impacts,
  `exact.ImpactOscillator`;
- the slip of Newmark's block at rest, `exact.SlidingBlock`;
- the free end of a clamped bar with the initial velocity V sin(k x), k = pi / (2 L). On equal
  linear elements of length h it oscillates with w_h^2 = 6 (c / h)^2 (1 - cos k h) / (2 + cos k h)
  (consistent mass: Hughes, The Finite Element Method, section 9.1), and in steps with
  tan(w dt / 2) = w_h dt / 2, without loss of energy: u = V / w_h sin(w t). Its errors of step and
  cells have opposite signs, and are known one by one.
"""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

pytest.importorskip("gmsh")
from boxes import box
from test_sliding_block import EXACT, shake

import dolfinx_joints as dj
from benchmarks.shared.problems import impact, march, oscillator
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.geometry.jointed_wall import jointed_wall

pytestmark = pytest.mark.filterwarnings("ignore")

GAP, FAR = 0.03, 0.09  # of the stop [m]; of the other, it is not reached before `FLIGHT`
MASS, FLIGHT = oscillator(10.0, GAP), 0.1  # s
IMPACTS = (0.8, 1.3)  # periods, after one contact and after two
SIZE, DT = 1.0, 0.005  # of the bar [m], of the block [s]
LENGTH, SPEED = 20.0, 0.1  # m, m/s
CONCRETE = dj.Elastic(young=24e9, poisson=0.0, density=2400.0)
WAVE = math.sqrt(CONCRETE.young / CONCRETE.density)
NUMBER = math.pi / (2.0 * LENGTH)  # k [rad/m]
BAR_END = 0.7 * math.pi / (WAVE * NUMBER)  # s


def displacement(gap, end, steps):
    """Displacement of the mass at the end [m]."""
    problem = impact(10.0, gap=gap, periods=end / MASS.free_period)
    return float(march(problem, dj.EnergyConsistent(), end / steps).displacement[-1, 0])


def bar(path, size, steps):
    """Displacement of the free end of the bar at `BAR_END` [m]."""
    mesh = box((LENGTH, 1.0), (round(LENGTH / size), 1), groups={"left": (0, 0.0)})
    model = dj.Model(mesh, material=CONCRETE, supports=[dj.Fixed(group="left")])

    def velocity(x):
        return SPEED * np.sin(NUMBER * x[:, :1]) * [1.0, 0.0]

    monitor = dj.ResultsMonitor(path, points={"end": (LENGTH, 1.0, 0.0)})
    simulation = dj.Simulation(model, monitors=[monitor])
    start = dj.InitialFields(velocity=velocity)
    simulation.dynamics(dt=BAR_END / steps, steps=steps, start=start)
    with dj.Results(path) as results:
        return float(results.series("histories", "displacement", -1)[0, 0])


def exact_bar(size, steps):
    """Return the displacement of `bar`; None for a size or a number of steps is the limit."""
    w = WAVE * NUMBER
    if size is not None:
        turn = math.cos(NUMBER * size)
        w = WAVE / size * math.sqrt(6.0 * (1.0 - turn) / (2.0 + turn))
    dt = BAR_END / (steps or 1)
    in_steps = 2.0 / dt * math.atan(w * dt / 2.0) if steps else w
    return SPEED / w * math.sin(in_steps * BAR_END)


def scenes(folder, *, size, dt):
    """Run the scenes with as many times fewer steps as dt is longer."""
    longer = dt / DT
    values = {"flight [m]": displacement(FAR, FLIGHT, round(40 / longer))}
    for periods in IMPACTS:
        end = periods * MASS.period
        values[f"impact {periods} [m]"] = displacement(GAP, end, round(200 / longer))
    values["slip [m]"] = float(shake("hex", dt)[0].slip[-1])
    values["bar [m]"] = bar(folder / "bar.h5", size, round(40 / longer))
    return values


def effectivities(result):
    """Estimated over true error, of the step and, for the bar, of the cells."""
    rows = {name: i for i, name in enumerate(result.table["value"])}
    steps, cells = result.table["step_error"], result.table["cell_error"]
    exact = {"flight [m]": MASS.amplitude * math.sin(MASS.frequency * FLIGHT)}
    exact |= {f"impact {k} [m]": float(MASS.displacement(k * MASS.period)) for k in IMPACTS}
    exact["slip [m]"] = EXACT.final_slip
    exact["bar [m]"] = exact_bar(SIZE, None)
    given = result.table["given"]
    assert given[rows["bar [m]"]] == pytest.approx(exact_bar(SIZE, 40), rel=1e-7)
    shares = {n: steps[rows[n]] / abs(given[rows[n]] - value) for n, value in exact.items()}
    of_cells = abs(exact_bar(SIZE, 40) - exact_bar(None, 40))
    return shares | {"bar, cells": cells[rows["bar [m]"]] / of_cells}


def test_effectivity_of_smooth_scenes(tmp_path):
    """Between 0.5 and 2; measured: 1.00 to 1.02."""
    result = dj.accuracy(tmp_path / "a", scenes, size=SIZE, dt=DT, cells=(1.25, 5 / 3))
    shares = effectivities(result)
    assert len(shares) == 6
    assert all(0.5 < share < 2.0 for share in shares.values()), shares
    assert set(result.table["step_kind"]) == {"order"}
    assert result.table["cell_kind"].tolist() == [*["constant"] * 4, "order"]


def wall(folder, *, size, dt):
    """Push a clamped wall sideways by three times its weight."""
    sides = {"length": 4.0, "thickness": 2.0, "height": 4.0}
    model = dj.Model(
        mesh_of(jointed_wall, joints=0, size=size, **sides),
        material=dj.Elastic(young=24e9, poisson=0.2, density=2400.0),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(acceleration=(30.0, 0.0, -10.0))],
    )
    path = folder / "run.h5"
    points = {"crest": (0.0, 0.0, 4.0)}
    monitor = dj.ResultsMonitor(path, points=points, envelopes=True)
    dj.Simulation(model, monitors=[monitor]).statics()
    return path


def test_stresses_at_a_clamped_edge_grow(tmp_path):
    """Between a clamped and a free face at 90 degrees stresses are singular (Williams 1952)."""
    result = dj.accuracy(tmp_path / "a", wall, size=0.5, dt=1.0, steps=(), cells=(4 / 3, 2.0))
    kinds = dict(zip(result.table["value"], result.table["cell_kind"], strict=True))
    assert kinds["largest tension [Pa]"] == kinds["largest compression [Pa]"] == "growth"
    assert kinds["crest displacement [m]"] == kinds["strain energy [J]"] == "order"
