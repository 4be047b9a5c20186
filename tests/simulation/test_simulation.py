# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stages: one run in two parts, and the monolithic path against the condensed one."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import shaken_wall
from shaken_wall import swaying

import dolfinx_joints as dj
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi
DT = 0.005


@pytest.fixture
def wall(wall_file, read):
    """A wall of two joints on a clamped base, under its own weight."""
    return shaken_wall.wall(read(wall_file(divisions=(6, 2, 3), joints=2)))


def difference(one, two):
    """Largest difference of the displacements relative to the largest displacement."""
    change = one.displacement.copy()
    change.axpy(-1.0, two.displacement)
    return change.norm(3) / two.displacement.norm(3)


def test_a_run_in_two_parts_is_the_run(wall):
    # The second part begins with the state that the first ended with: nothing differs but the
    # rounding of the balance from which its first acceleration follows.
    whole = dj.Simulation(wall)
    whole.statics()
    end = whole.dynamics(dt=DT, steps=24, motion=swaying)
    parts = dj.Simulation(wall)
    parts.statics()
    middle = parts.dynamics(dt=DT, steps=11, motion=swaying)
    last = parts.dynamics(dt=DT, steps=13, motion=swaying, start=middle.state)
    assert last.state.time == pytest.approx(24 * DT, rel=1e-12)
    assert end.state.joints.status.tolist() == last.state.joints.status.tolist()
    assert difference(last.state, end.state) < 1e-8


def test_a_body_at_rest_stays_at_rest_and_nothing_warns(wall, recwarn):
    # What moves is rounding, of which an error relative to the motion would say nothing.
    simulation = dj.Simulation(wall)
    simulation.statics()
    outcome = simulation.dynamics(dt=0.005, steps=3)
    assert outcome.local_error == 0.0
    assert not [w for w in recwarn if "error of a single step" in str(w.message)]


def sudden(recorded):
    """Warnings of loads that are applied suddenly."""
    return [str(w.message) for w in recorded if "applied suddenly" in str(w.message)]


def test_loads_of_another_time_are_warned_of(wall, recwarn):
    """Quasi-statics ends with loads of its last time, a dynamic stage starts with those of t = 0.

    A sine of 2 pi is zero but for rounding.
    """
    push = dj.Traction(group="crest", value=(1e4, 0.0, 0.0), factor=lambda t: np.sin(2 * np.pi * t))
    wall.loads = [dj.Gravity(), push]
    simulation = dj.Simulation(wall)
    simulation.quasi_statics([0.25, 1.0])
    simulation.dynamics(dt=DT, steps=1, motion=swaying)
    simulation.quasi_statics([0.25], name="pushed")
    assert not sudden(recwarn)
    middle = simulation.dynamics(dt=DT, steps=1)
    simulation.dynamics(dt=DT, steps=1, start=middle.state)
    said = sudden(recwarn)
    assert len(said) == (wall.jointed.mesh.comm.rank == 0)  # one rank says it
    text = "t = 0 s: Traction_crest; the last static stage, 'pushed' at t = 0.25 s, ended"
    assert all(text in one for one in said)


class Summary(Monitor):
    """Keeps the summary of the run."""

    def finish(self, status, summary):
        self.summary = summary


def test_loads_without_a_static_stage_are_warned_of(wall_file, read, recwarn):
    """Once, on one rank, by name. Results keep the warning.

    There is none of a load whose factor starts at zero, of a ground motion or of an initial
    displacement without loads.
    """
    file = wall_file(divisions=(2, 1, 2), joints=1)
    ramp = dj.Traction(group="crest", value=(1e4, 0.0, 0.0), factor=lambda t: t)
    push = dj.Traction(group="crest", value=(1e4, 0.0, 0.0))

    def started(own, **options):
        model = shaken_wall.wall(read(file), loads=own, damping=None)
        monitor = Summary()
        simulation = dj.Simulation(model, monitors=[monitor])
        if options.pop("static", False):
            simulation.statics()
        recwarn.clear()
        simulation.dynamics(dt=DT, steps=1, **options)
        comm = model.jointed.mesh.comm
        said = comm.allgather(sudden(recwarn))
        assert not any(said[1:])
        kept = [text for text in monitor.summary.get("warnings", []) if "applied suddenly" in text]
        if comm.rank == 0:
            assert kept == said[0]
        return said[0]

    (said,) = started([dj.Gravity(), ramp])
    assert "t = 0 s: Gravity; no static stage was run. To start at rest, run statics()" in said
    (said,) = started([dj.Gravity(), ramp], static=True, loads=[push])
    assert ": Traction_crest_2; they are not part of the static state." in said
    assert not started([dj.Gravity(), push], static=True, loads=[ramp], motion=swaying)
    assert not started([ramp])
    assert not started([], motion=lambda t: np.array([1.0, 0.0, 0.0]))
    assert not started(
        [], start=dj.InitialFields(displacement=lambda x: 1e-6 * x[:, [2, 1, 1]] * [1.0, 0.0, 0.0])
    )


def test_loads_in_balance_with_an_initial_displacement_are_not_warned_of(wall, recwarn):
    """The displacement and the loads are those of a static stage of the same model."""
    before = dj.Simulation(wall)
    standing = before.statics().displacement
    tied = dj.Simulation(wall)
    tied.dynamics(dt=DT, steps=1, start=dj.InitialFields(displacement=standing))
    assert not sudden(recwarn)
    tied.dynamics(dt=DT, steps=1)
    assert len(sudden(recwarn)) == (wall.jointed.mesh.comm.rank == 0)


def test_both_solvers_march_alike(wall):
    # The same equations, solved for all dofs and for the joint forces alone.
    ends = []
    for solver in ("condensed", "monolithic"):
        simulation = dj.Simulation(
            wall, solver=solver, options=dj.SolverOptions(relative_tolerance=1e-12)
        )
        simulation.statics()
        outcome = simulation.dynamics(dt=DT, steps=40, motion=swaying)
        assert outcome.solver == solver
        counts = wall.contact.counts(outcome.state.joints.status)
        ends.append((outcome.state, counts))
    assert ends[0][1] == ends[1][1]
    assert ends[0][1].open > 0
    assert difference(ends[0][0], ends[1][0]) < 1e-8


@pytest.mark.parametrize("name", ["control", "start", "checkpoint", "scheme"])
def test_other_kinds_are_reported_before_anything_is_solved(wall, name):
    with pytest.raises(ValueError, match=f"{name} is 'run'; it must be "):
        dj.Simulation(wall).dynamics(dt=DT, steps=1, **{name: "run"})


def test_monitors_and_options_are_reported_when_they_are_given(wall):
    with pytest.raises(ValueError, match=r"A monitor is 'r.h5'; it must be a Monitor"):
        dj.Simulation(wall, monitors=["r.h5"])
    with pytest.raises(ValueError, match="options is {}; it must be a SolverOptions"):
        dj.Simulation(wall, options={})


def of_upper_block(model, vector):
    """Sum of a nodal vector over the nodes of the upper block, shape (3,)."""
    nodes = np.unique(model.V.dofmap.list[model.jointed.cells("upper")])
    owned = vector.getArray(readonly=True).reshape(-1, 3)
    return model.jointed.mesh.comm.allreduce(owned[nodes[nodes < len(owned)]].sum(axis=0))


class Impulses(Monitor):
    """Sums up the force of the joint and counts steps that were cut, from the records."""

    def __init__(self):
        self.joint, self.cut = np.zeros(3), 0

    def start(self, model, stage, steps, first):
        self.forces = dj.JointForces(model)

    def record(self, record):
        self.joint += DT * self.forces(record.joints)["joint_1"].force
        self.cut += record.substeps > 1

    def finish(self, status, summary):
        """Nothing is left to do."""


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
@pytest.mark.parametrize(
    "control", [None, dj.StepControl(tolerance=1e-4), dj.StepControl(landing=True)]
)
def test_forces_of_records_have_the_impulse_of_their_steps(blocks_file, read, control):
    """A block that falls on another: weight and recorded forces make up its change of momentum.

    The scheme keeps momentum to rounding; forces of a step that is cut are the means over it.
    """
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=4e9, friction_angle_deg=30.0)
    joints = dj.Joints(law, initial_gaps={"joint_1": 0.01})
    model = shaken_wall.wall(read(blocks_file(angle=0.0)), joints, damping=None)
    seen, steps = Impulses(), 24
    outcome = dj.Simulation(model, monitors=[seen]).dynamics(dt=DT, steps=steps, control=control)
    assert (seen.cut > 0) == (control is not None)
    momentum = outcome.state.momentum
    weight = of_upper_block(model, model.system().load(0.0, momentum.duplicate()))
    gained = of_upper_block(model, momentum)
    largest = np.abs(weight).max() * DT * steps
    assert np.abs(seen.joint[2]) > 0.1 * largest  # it has landed
    np.testing.assert_allclose(seen.joint + DT * steps * weight, gained, atol=1e-9 * largest)
