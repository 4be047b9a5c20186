# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solver with joints by interior-facet integrals: what a run gives as the monolithic one does.

The two are one sum over joint points in another order, so they differ by rounding and by what is
left of the residual. Joint points change between open, stick and slip on the way.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import shaken_wall
from shaken_wall import CONCRETE, Killed, Killer, shaking

import dolfinx_joints as dj
from dolfinx_joints.laws.law import StatusCounts
from dolfinx_joints.simulation.monitor import Monitor

DT, STEPS, TOLERANCE = 0.004, 8, 1e-10
STIFF = {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 30.0}
FRICTION = dj.FrictionNoTension(**STIFF)
FLOWING = dj.DruckerPrager(
    elastic=CONCRETE, cohesion=2e5, friction_angle_deg=30.0, dilatancy_angle_deg=5.0
)
BONDED = dj.MohrCoulombJoint(**STIFF, cohesion=1e5, tensile_strength=5e4, dilatancy_angle_deg=5.0)
VISCOUS = dj.ViscousJoint(law=FRICTION, normal_viscosity=1e7, shear_viscosity=1e7)
WATER = [
    dj.HydrostaticPressure(group="y_min", level=16.0),
    dj.JointWater(joint="joint_1", level=16.0, reached_from="y_min"),
    dj.Uplift(joint="joint_2", pressure=5e4),
]
SWAYING = dj.Prescribed(group="crest", component="y", value=lambda t: 1e-3 * np.sin(60.0 * t))
GAPS = {"joint_1": 1e-4, "joint_3": lambda x: 1e-5 * (x[:, 2] - 10.0)}

# What is changed of a wall of three joints under its own weight.
MODELS = {
    "plain": {},
    "gaps": {"joints": dj.Joints(FRICTION, initial_gaps=GAPS)},
    "bonded": {"joints": BONDED},
    "viscous": {"joints": VISCOUS},
    "laws": {"joints": {"joint_1": BONDED, "joint_2": FRICTION, "joint_3": VISCOUS}},
    "plastic": {"material": FLOWING},
    "water": {"loads": [dj.Gravity(), *WATER]},
    "massless": {"body": dj.Body(redistribute_mass=True)},
    "gauss": {"joints": dj.Joints(FRICTION, quadrature=4)},
    "moved": {"supports": [dj.Fixed(group="base"), SWAYING]},
}
# How the dynamic stage is run.
STAGES = {
    "HHT": {"scheme": dj.HilberHughesTaylor()},
    "Newmark": {"scheme": dj.Newmark()},
    "alpha": {"scheme": dj.GeneralizedAlpha()},
    "implicit": {"scheme": dj.ImplicitContact()},
    "adaptive": {"control": dj.StepControl(tolerance=1e-3)},
    "landing": {"control": dj.StepControl(landing=True, max_halvings=3)},
}
CASES = [*((name, "") for name in MODELS), *(("plain", name) for name in STAGES)]
ON_RANKS = [("laws", ""), ("plastic", ""), ("water", ""), ("plain", "HHT")]


class Seen(Monitor):
    """Keeps the largest numbers of open, sticking and sliding points of all steps."""

    most = StatusCounts(open=0, stick=0, slip=0)

    def record(self, record):
        now = record.solve.counts
        self.most = StatusCounts(
            **{name: max(count, getattr(now, name)) for name, count in vars(self.most).items()}
        )


@pytest.fixture
def wall(wall_file, read):
    """Makes a simulation of the wall."""

    def make(solver, changes=None, monitors=()):
        given = {"material": CONCRETE, "joints": FRICTION, "loads": [dj.Gravity()]}
        given |= {"supports": [shaken_wall.BASE], "damping": shaken_wall.DAMPING}
        model = dj.Model(read(wall_file(divisions=(12, 1, 3))), **given | (changes or {}))
        options = dj.SolverOptions(relative_tolerance=1e-12)
        return dj.Simulation(model, options=options, solver=solver, monitors=list(monitors))

    return make


def same(simulation, found, expected):
    """Displacements, gaps, tractions and status of two states."""
    operator = simulation.model.operator

    def close(one, two):
        one, two = operator.comm.allgather(one), operator.comm.allgather(two)
        one, two = np.concatenate(one), np.concatenate(two)
        assert np.abs(one - two).max() <= TOLERANCE * np.abs(two).max()

    close(found.displacement.getArray(), expected.displacement.getArray())
    close(found.joints.state.gap, expected.joints.state.gap)
    close(found.joints.traction, expected.joints.traction)
    assert np.array_equal(found.joints.status, expected.joints.status)


@pytest.mark.parametrize(
    ("model", "stage"),
    [
        pytest.param(*each, id="-".join(each), marks=[pytest.mark.mpi] * (each in ON_RANKS))
        for each in CASES
    ],
)
def test_as_the_monolithic_solver(wall, model, stage):
    ends, counts, seen = [], [], Seen()
    for solver in ("forms", "monolithic"):
        simulation = wall(solver, MODELS[model], [seen])
        static = simulation.statics(steps=2)
        outcome = simulation.dynamics(dt=DT, steps=STEPS, motion=shaking, **STAGES.get(stage, {}))
        assert outcome.solver == solver
        ends.append((static, outcome.state))
        counts.append((outcome.counts, outcome.steps))
        if not stage:
            assert outcome.imbalance is None or outcome.imbalance <= 1e-10
    for found, expected in zip(*ends, strict=True):
        same(simulation, found, expected)
    assert counts[0] == counts[1]
    assert min(seen.most.open, seen.most.stick) > 0
    assert seen.most.slip > 0 or model == "bonded"
    assert model != "plastic" or simulation.model.bulk.yielding(outcome.state.joints) > 0
    assert f"{solver} solver" in simulation.report(outcome)


@pytest.mark.mpi
def test_stages_of_statics(wall):
    """Blocks that stand alone, grouted, loaded and moved."""
    changes = {
        "loads": [dj.Gravity(), dj.Traction(group="crest", value=(0.0, 2e5, 0.0))],
        "supports": [dj.Fixed(group="base"), SWAYING],
    }
    ends = []
    for solver in ("forms", "monolithic"):
        simulation = wall(solver, changes)
        simulation.statics(joints="inactive", loads=simulation.model.loads[:1])
        simulation.grout(["joint_1", "joint_2"])
        loaded = simulation.statics(steps=2)
        ends.append((loaded, simulation.quasi_statics([0.01, 0.02])))
    for found, expected in zip(*ends, strict=True):
        same(simulation, found, expected)


@pytest.mark.mpi
def test_goes_on_from_a_checkpoint(wall, new_path):
    """To the last digit on one rank, and the results file and its report name the solver."""
    kept, results = new_path("run.ckpt"), new_path("run.h5")

    def run(monitors, kept=None):
        simulation = wall("forms", monitors=monitors)
        if kept is None or not kept.resume:
            simulation.statics()
        return simulation, simulation.dynamics(dt=DT, steps=STEPS, motion=shaking, checkpoint=kept)

    checkpoint = dj.Checkpoints(kept, every=4)
    with pytest.raises(Killed):
        run([Killer(6)], checkpoint)
    _, again = run([Killer(None)], replace(checkpoint, resume=True))
    crest = dj.Probe((10.0, 0.0, 20.0), group="joint_2-")
    simulation, whole = run([dj.ResultsMonitor(results, points={"crest": crest})])
    same(simulation, again.state, whole.state)
    if simulation.model.jointed.mesh.comm.size == 1:  # MUMPS sums in any order
        one, two = (run.state.displacement.getArray() for run in (again, whole))
        assert np.array_equal(one, two)
    with dj.Results(results) as file:
        assert file.summary["solver"] == "forms"
