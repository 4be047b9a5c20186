# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps in few shapes of a wall beside steps of the whole wall, which are what is expected."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import DT, POINTS, shaking, wall

from dolfinx_joints import (
    Checkpoints,
    EnergyConsistent,
    JointsError,
    Newmark,
    Prescribed,
    ReducedBulk,
    Results,
    ResultsMonitor,
    RigidJoint,
    Simulation,
    StepControl,
    Traction,
)
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.probes import PointProbe
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.reduced_steps import ReducedSteps

STEPS = 20
# Of the wall of 4 x 1 x 3 cells: 24 nodes above the base and 9 more at its joints, 3 dofs each.
ALL_MODES = 3 * (5 * 2 * 3 + 3 * 2 * 3)


class Gaps(Monitor):
    """Keeps the gaps after each step, and how far values at a point are from the vectors'."""

    def __init__(self, compare=False):
        self.gaps, self.off, self._compare = [], [], compare

    def start(self, model, stage, steps, first):
        self._model = model
        if self._compare:
            self._probe = PointProbe(model, [(20.0, 4.0, 20.0)], NodeNumbering(model.V))

    def record(self, record):
        operator = self._model.operator
        found = operator.gather(record.joints.state.gap)
        self.gaps.append(operator.comm.bcast(found))
        if self._compare:
            u, v = record.read(self._probe)
            pairs = [
                (u, self._probe.read(record.displacement)),
                (v, self._probe.read(record.velocity)),
                (
                    record.resultant(self._model, "base"),
                    self._model.resultant(record.reaction, "base"),
                ),
            ]
            self.off.append([np.abs(a - b).max() / np.abs(b).max() for a, b in pairs])


def run(model, monitor, steps=STEPS, **options):
    simulation = Simulation(model, monitors=[monitor])
    simulation.statics()
    outcome = simulation.dynamics(dt=DT, steps=steps, motion=shaking, **options)
    return np.array(monitor.gaps), outcome


def stepping(model, reduced):
    """Steps of a model at rest whose weight acts at once, and the solver of the whole body."""
    solver = make_solver(model.system(), rule=EnergyConsistent().rule)
    state = initial_state(solver, displacement=None)
    return solver, ReducedSteps(reduced, EnergyConsistent(), solver, state, DT)


def error(gaps, right):
    """Largest error of the gaps over the largest of them."""
    return np.abs(gaps - right).max() / np.abs(right).max()


@pytest.fixture(scope="module")
def model(read, wall_file):
    return wall(read(wall_file()))


@pytest.fixture(scope="module")
def whole(model):
    """Gaps of the whole body."""
    return run(model, Gaps())[0]


@pytest.mark.mpi
def test_all_modes_give_the_steps_of_the_whole_body(model, whole):
    gaps, outcome = run(model, Gaps(), reduced=ReducedBulk(modes=ALL_MODES, tolerance=1e-3))
    assert outcome.reduced.whole == 0
    assert outcome.reduced.shapes == ALL_MODES
    assert outcome.reduced.largest_error < 1e-6  # root of the rounding of an energy
    assert error(gaps, whole) < 1e-9
    assert outcome.imbalance < 1e-12


@pytest.mark.mpi
def test_more_joint_points_than_nodes(read, wall_file):
    """Nodes and centres of facets of 10-node tetrahedra: gaps depend on each other."""
    parameters = {"cell": "tet", "order": 2, "joints": 1, "divisions": (2, 1, 1)}
    tets = wall(read(wall_file(**parameters)))
    right, _ = run(tets, Gaps())
    gaps, outcome = run(tets, Gaps(), reduced=ReducedBulk(modes=1000))
    assert outcome.reduced.whole == 0
    assert error(gaps, right) < 1e-8
    assert outcome.imbalance < 1e-12


@pytest.mark.mpi
def test_rigid_joints(read, wall_file):
    """Their tractions are known by the compliance alone, which is that of the whole body."""
    rigid = wall(read(wall_file()), joints=RigidJoint(friction_angle_deg=30.0))
    right, _ = run(rigid, Gaps())
    gaps, outcome = run(rigid, Gaps(), reduced=ReducedBulk(modes=ALL_MODES))
    assert outcome.reduced.whole == 0
    assert error(gaps, right) < 1e-8
    assert outcome.imbalance < 1e-12


@pytest.mark.mpi
def test_errors_fall_with_the_number_of_modes_and_are_seen(model, whole):
    found = []
    for modes in (4, 20, 60):
        gaps, outcome = run(model, Gaps(), reduced=ReducedBulk(modes=modes, tolerance=0.999))
        assert outcome.reduced.whole == 0
        assert outcome.imbalance < 1e-12
        found.append((error(gaps, whole), outcome.reduced.largest_error))
    errors, estimates = np.array(found).T
    assert np.all(errors[1:] < 0.5 * errors[:-1])
    assert np.all(estimates[1:] < 0.5 * estimates[:-1])


@pytest.mark.mpi
def test_error_of_a_step_is_the_energy_by_which_the_whole_body_differs(model):
    """With the joint forces of the reduced step; A of the whole body is solved for it."""
    solver, steps = stepping(model, ReducedBulk(modes=8, tolerance=0.999))
    before = steps.start
    for _ in range(3):
        after, _ = steps.advance(solver, before, DT)
        whole, system = steps.whole(before), solver.system
        bulk = solver.condensed(steps._effective, steps.rule).matrix
        known = system.load(after.time, whole.load.duplicate())
        known.axpby(0.5, 0.5, whole.load)
        known.axpy(after.rate, whole.momentum)
        known.axpy(-1.0, whole.elastic_force)
        force = system.contact.operator.force(after.joints.traction, known.duplicate())
        known.axpy(-1.0, force)
        known.getArray()[system.constrained] = 0.0
        x = known.duplicate()
        bulk.solve(known, x)
        found = steps.whole(after).displacement - whole.displacement
        off, image = x - found, x.duplicate()
        bulk.multiply(off, image)
        assert steps._missed(before, after) == pytest.approx(off.dot(image), rel=1e-6)
        before = after


@pytest.mark.mpi
def test_what_the_basis_cannot_hold_is_taken_by_the_whole_body(model, whole):
    """Four modes hold little of the motion: nearly all steps are the whole body's at first."""
    few = ReducedBulk(modes=4, tolerance=1e-4)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        gaps, outcome = run(model, Gaps(), reduced=few)
    told = [each for each in said if "by the whole body" in str(each.message)]
    assert len(told) == (MPI.COMM_WORLD.rank == 0)
    assert outcome.reduced.whole + outcome.reduced.reduced == STEPS
    assert outcome.reduced.whole > STEPS // 2
    assert error(gaps, whole) < 1e-4
    assert outcome.imbalance < 1e-11


@pytest.mark.mpi
def test_blow_that_the_basis_does_not_know(model):
    """A sudden push on an end of the wall sends waves that slow modes lack."""

    def push(time):
        return 1.0 if time > 10.5 * DT else 0.0

    blow = [Traction(group="x_max", value=(-2e6, 0.0, 0.0), factor=push)]
    right, _ = run(model, Gaps(), loads=blow)
    blind, _ = run(model, Gaps(), loads=blow, reduced=ReducedBulk(modes=20, tolerance=0.999))
    seen, outcome = run(model, Gaps(), loads=blow, reduced=ReducedBulk(modes=20, tolerance=3e-4))
    assert outcome.reduced.whole > 0
    assert error(seen, right) < 0.1 * error(blind, right)
    assert outcome.imbalance < 1e-11


@pytest.mark.mpi
def test_shorter_steps_are_taken_by_the_whole_body(model):
    control = StepControl(landing=True, max_halvings=1)
    right, plain = run(model, Gaps(), control=control)
    reduced = ReducedBulk(modes=ALL_MODES)
    gaps, outcome = run(model, Gaps(), control=control, reduced=reduced)
    assert plain.counts.accepted == outcome.counts.accepted > STEPS
    assert outcome.counts.rejected > 0
    assert outcome.reduced.whole + outcome.reduced.reduced == outcome.counts.accepted
    assert outcome.reduced.whole > 0
    assert outcome.reduced.reduced > 0
    assert error(gaps, right) < 1e-9
    assert outcome.imbalance < 1e-11


@pytest.mark.mpi
def test_rejected_attempts_do_not_loosen_the_tolerance(model):
    """The wall falls longer in a long step, tried first, and has more energy at its end."""
    largest = []
    for tried in ((DT,), (4 * DT, DT), (4 * DT,)):
        solver, steps = stepping(model, ReducedBulk(modes=ALL_MODES))
        for dt in tried:
            steps.advance(solver, steps.start, dt)
        largest.append(steps._largest)
    assert largest[1] == pytest.approx(largest[0], rel=1e-6)
    assert largest[2] > 2.0 * largest[0]


@pytest.mark.mpi
def test_missing_energy_is_a_failed_solve(model, monkeypatch):
    """1e-6 of the momentum is lost in each step, and so much of the kinetic energy."""
    advance = ReducedSteps.advance

    def leaky(*given):
        after, report = advance(*given)
        return replace(after, momentum=(1.0 - 1e-6) * after.momentum), report

    monkeypatch.setattr(ReducedSteps, "advance", leaky)
    with pytest.raises(JointsError, match="the largest energy is missing"):
        run(model, Gaps(), reduced=ReducedBulk(modes=ALL_MODES))


@pytest.mark.mpi
@pytest.mark.parametrize("tolerance", [0.999, 1e-3])
def test_points_and_resultants_are_those_of_the_vectors(model, tolerance):
    gaps = Gaps(compare=True)
    _, outcome = run(model, gaps, reduced=ReducedBulk(modes=20, tolerance=tolerance))
    assert (outcome.reduced.whole > 0) == (tolerance < 0.5)
    assert np.max(gaps.off[1:]) < 1e-9


@pytest.mark.mpi
def test_results_do_not_depend_on_ranks(model, read, wall_file):
    reduced = ReducedBulk(modes=20, tolerance=1e-3)
    gaps, outcome = run(model, Gaps(), reduced=reduced)
    alone = wall(read(wall_file(), on=MPI.COMM_SELF))
    expected, single = run(alone, Gaps(), reduced=reduced)
    assert outcome.reduced.whole == single.reduced.whole
    assert error(gaps, expected) < 1e-9


@pytest.mark.mpi
def test_run_goes_on_from_its_last_state(model):
    """The state of the outcome is the whole body's; all modes are exact before and after."""
    _, outcome = run(model, Gaps(), steps=10, reduced=ReducedBulk(modes=ALL_MODES))
    _, right = run(model, Gaps(), steps=10)
    u, v = outcome.state.displacement, right.state.displacement
    assert (u - v).norm() < 1e-9 * v.norm()
    after = Gaps()
    simulation = Simulation(model, monitors=[after])
    simulation.dynamics(dt=DT, steps=3, motion=shaking, start=outcome.state)
    plain = Gaps()
    simulation = Simulation(model, monitors=[plain])
    simulation.dynamics(dt=DT, steps=3, motion=shaking, start=right.state)
    assert error(np.array(after.gaps), np.array(plain.gaps)) < 1e-8


@pytest.mark.mpi
def test_results_file_and_report_tell_of_it(model, new_path):
    path = new_path("reduced.h5")
    simulation = Simulation(model, monitors=[ResultsMonitor(path, points=POINTS)])
    simulation.statics()
    outcome = simulation.dynamics(
        dt=DT, steps=3, motion=shaking, reduced=ReducedBulk(modes=20, tolerance=1e-3)
    )
    counts = outcome.reduced
    assert f"{counts.whole} of 3 steps by the whole body" in simulation.report(outcome)
    if MPI.COMM_WORLD.rank == 0:
        with Results(path) as results:
            assert results.summary["reduced bulk"]["whole"] == counts.whole


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"scheme": Newmark()}, "a scheme other than"),
        ({"scheme": EnergyConsistent(exact_modes=4)}, "a scheme other than"),
    ],
)
def test_schemes_that_it_cannot_take(model, options, what):
    with pytest.raises(JointsError, match=what):
        run(model, Gaps(), reduced=ReducedBulk(modes=8), **options)


@pytest.mark.filterwarnings("ignore:Loads act suddenly")
@pytest.mark.mpi
def test_models_that_it_cannot_take(read, wall_file):
    jointed = read(wall_file())
    held = [Prescribed(group="base", component=axis, value=lambda _: 0.0) for axis in "yz"]
    moving = Prescribed(group="base", component="x", value=lambda time: 1e-3 * math.sin(time))
    model = wall(jointed, supports=[moving, *held])
    with pytest.raises(JointsError, match="the run has moving supports"):
        Simulation(model).dynamics(dt=DT, steps=1, reduced=ReducedBulk(modes=8))


def test_checkpoints_are_refused(model, tmp_path):
    with pytest.raises(ValueError, match="basis is kept in memory alone"):
        Simulation(model).dynamics(
            dt=DT,
            steps=1,
            reduced=ReducedBulk(modes=8),
            checkpoint=Checkpoints(tmp_path / "run.checkpoint"),
        )
