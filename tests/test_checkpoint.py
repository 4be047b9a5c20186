# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs interrupted and continued from checkpoints end as runs that were not."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import (
    Checkpoints,
    Elastic,
    Fixed,
    FrictionNoTension,
    Gravity,
    Model,
    MohrCoulombJoint,
    Newmark,
    Results,
    ResultsMonitor,
    RigidJoint,
    Simulation,
    StepControl,
    stiffness_proportional,
)

CONCRETE = Elastic(young=24e9, poisson=0.2, density=2400.0)
LAW = FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)
POINTS = {"crest": (10.0, 0.0, 20.0), "corner": (0.0, 4.0, 20.0)}
STEPS, DT = 12, 4e-3


class Killed(BaseException):
    """In the place of a signal: nobody handles it."""


class Killer:
    """A monitor that stops the run in a step."""

    def __init__(self, step=None):
        self.step = step

    def start(self, model, stage, steps, first):
        """Nothing to prepare."""

    def record(self, record):
        if record.step == self.step:
            raise Killed

    def finish(self, status, summary):
        """Nothing to close."""

    def memory(self):
        return {}

    def resume(self, model, stage, steps, last, memory):
        """Nothing to take up."""


def shaking(time):
    """A ground acceleration strong enough to open the joints, [m/s^2]."""
    return 12.0 * np.sin(2 * np.pi * np.array([2.3, 2.9, 3.1]) * time + [0.0, 0.7, 1.9])


def wall(jointed, joints=LAW):
    return Model(
        jointed,
        material=CONCRETE,
        joints=joints,
        supports=[Fixed(group="base")],
        loads=[Gravity()],
        damping=stiffness_proportional(ratio=0.02, frequency=5.0),
    )


def content(path):
    """Everything in a results file but times of day and seconds."""
    with Results(path) as results:
        assert results.status == "complete"
        found = {name: results.static(name) for name in results.statics}
        for stream, names in results.streams.items():
            found[f"{stream}/time"] = results.time(stream)
            for name in names:
                found[f"{stream}/{name}"] = results.series(stream, name)
        summary = {k: v for k, v in results.summary.items() if k not in ("seconds", "peak_mb")}
        metadata = {k: v for k, v in results.metadata.items() if k != "ranks"}
        return found, summary, metadata


def interrupted(make, folder, kill_at, *, every=2, solver="auto", envelopes=True, **options):
    """Outcomes and results files of a whole run, and of one killed in some steps and resumed."""

    def run(name, kill, **more):
        monitors = [
            ResultsMonitor(folder / name, points=POINTS, every=3, envelopes=envelopes),
            Killer(kill),
        ]
        simulation = Simulation(make(), monitors=monitors, solver=solver)
        if not more.get("resume"):
            simulation.statics(steps=2)
        return simulation, simulation.dynamics(
            dt=DT, steps=STEPS, motion=shaking, **options, **more
        )

    whole = run("whole.h5", None)
    kept = Checkpoints(folder / "run.ckpt", every=every)
    resume = False
    for step in kill_at:
        with pytest.raises(Killed):
            run("resumed.h5", step, checkpoint=kept, resume=resume)
        resume = True
    return whole, run("resumed.h5", None, checkpoint=kept, resume=True)


def identical(whole, resumed, folder):
    """Fail unless all arrays have the same bits."""
    one, other = content(folder / "whole.h5"), content(folder / "resumed.h5")
    assert one[0].keys() == other[0].keys()
    for name in one[0]:
        np.testing.assert_array_equal(one[0][name], other[0][name], err_msg=name)
    assert one[1:] == other[1:]
    (simulation, outcome), (again, after) = whole, resumed
    for name in ("displacement", "velocity", "acceleration", "momentum", "elastic_force"):
        expected, found = getattr(outcome.state, name), getattr(after.state, name)
        np.testing.assert_array_equal(found.array, expected.array, err_msg=name)
    joints, found = outcome.state.joints, after.state.joints
    for name in ("gap", "elastic_slip", "internal"):
        np.testing.assert_array_equal(getattr(found.state, name), getattr(joints.state, name))
    np.testing.assert_array_equal(found.traction, joints.traction)
    assert after.counts == outcome.counts
    assert after.energy.error == outcome.energy.error
    before, known = simulation.static, again.static
    np.testing.assert_array_equal(known.displacement.array, before.displacement.array)
    assert known.reports == before.reports


BOND = MohrCoulombJoint(
    normal_stiffness=1e11,
    shear_stiffness=1e11,
    friction_angle_deg=30.0,
    cohesion=1e5,
    tensile_strength=5e4,
    dilatancy_angle_deg=5.0,
)
CUT = StepControl(max_halvings=3, tolerance=2e-3)
CASES = {
    "condensed": {"solver": "condensed"},
    "condensed, steps cut": {"solver": "condensed", "control": CUT},
    "monolithic": {"solver": "monolithic"},
    "monolithic, steps cut": {"solver": "monolithic", "control": CUT},
    "Newmark": {"scheme": Newmark()},
    "rigid joints": {"joints": RigidJoint(friction_angle_deg=30.0)},
    "internal variables": {"joints": BOND},
}


@pytest.mark.parametrize("case", CASES)
def test_continued_run_has_the_same_bits(case, wall_file, read, tmp_path):
    options = dict(CASES[case])
    law = options.pop("joints", LAW)
    whole, resumed = interrupted(
        lambda: wall(read(wall_file()), law), tmp_path, (3, 7, 10), **options
    )
    identical(whole, resumed, tmp_path)
