# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The condensed solver: whatever it keeps and however the bulk is solved, the run is the same.

Statics of blocks that joints alone hold, rigid joints among them, are in
`verification/test_loose_blocks.py`.
"""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest
import ufl

pytest.importorskip("dolfinx")

from mpi4py import MPI

import shaken_wall
from shaken_wall import far, swaying

from dolfinx_joints import (
    Body,
    ConvergenceError,
    Elastic,
    EnergyConsistent,
    Fixed,
    FrictionNoTension,
    GeneralizedAlpha,
    Gravity,
    Joints,
    JointsError,
    KeyedJoint,
    Model,
    RigidJoint,
    Simulation,
    SolverOptions,
    StepControl,
    mesh_from_arrays,
    stiffness_proportional,
)
from dolfinx_joints.model.modes import modes
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC, MatrixCoefficients
from dolfinx_joints.solvers.interface.solver import InterfaceSolver
from dolfinx_joints.solvers.newton import NewtonSolver
from dolfinx_joints.time_integration.initial_state import initial_state

COMPLIANCES = ("dense", "compressed", "matrix-free")
LINEAR = ("direct", "iterative")
DT = 0.005
march = partial(shaken_wall.march, solver="condensed")


def friction(**changes: float) -> FrictionNoTension:
    given = {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 30.0}
    return FrictionNoTension(**{**given, **changes})


@pytest.fixture
def wall(wall_file, read) -> Callable[..., Any]:
    """Makes a wall of three joints on a clamped base under its own weight."""

    def make(law: Any = None, *, on: Any = None, **changes: Any) -> Any:
        jointed = read(wall_file(divisions=(8, 2, 3)), on)
        return shaken_wall.wall(jointed, law or friction(), **changes)

    return make


def difference(one: Any, two: Any) -> float:
    """Of two displacements, relative to the largest."""
    return float((one - two).norm(3) / two.norm(3))


def test_what_is_kept_and_how_the_bulk_is_solved_do_not_matter(wall):
    """All six, against the dense one with a direct solver, which the monolithic one checks.

    Of a closed joint the traction is some k_n h/E = 4 times what gaps of a given size make of it.
    """
    model = wall()
    path, static, outcome = march(model, compliance="dense", linear="direct")
    seen = path.counts
    assert any(c.open for c in seen)
    assert any(c.slip for c in seen)
    assert any(c.stick for c in seen)
    for compliance, linear in product(COMPLIANCES, LINEAR):
        other, at_rest, end = march(model, compliance=compliance, linear=linear)
        assert end.solver == "condensed"
        assert end.imbalance <= 1e-10
        assert difference(at_rest.displacement, static.displacement) <= 1e-9
        assert difference(end.state.displacement, outcome.state.displacement) <= 1e-9
        assert far(other.gaps, path.gaps) <= 1e-9
        assert far(other.tractions, path.tractions) <= 1e-8
        assert other.counts == seen
    _, _, reference = march(model, solver="monolithic")
    assert difference(outcome.state.displacement, reference.state.displacement) <= 1e-9


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("compliance", "linear"), [*product(COMPLIANCES, ["direct"]), ("dense", "iterative")]
)
def test_ranks_do_not_matter(wall, compliance, linear):
    spread, _, outcome = march(wall(), compliance=compliance, linear=linear)
    alone, _, expected = march(wall(on=MPI.COMM_SELF), compliance=compliance, linear=linear)
    assert far(spread.gaps, alone.gaps) <= 1e-9
    assert far(spread.tractions, alone.tractions) <= 1e-8
    assert spread.counts == alone.counts
    assert outcome.energy.friction == pytest.approx(expected.energy.friction, rel=1e-8)
    assert max(outcome.imbalance, expected.imbalance) <= 1e-10


@pytest.mark.parametrize(
    "law",
    [
        friction(friction_angle_deg=0.0),
        friction(shear_stiffness=0.0),
        friction(normal_stiffness=1e15, shear_stiffness=1e15),
        KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11),
        RigidJoint(friction_angle_deg=30.0),
    ],
    ids=["frictionless", "no shear", "stiff", "keyed", "rigid"],
)
def test_other_laws_with_every_compliance(wall, law):
    model = wall(law)
    path, _, outcome = march(model, compliance="dense")
    for compliance in ("compressed", "matrix-free"):
        other, _, end = march(model, compliance=compliance)
        assert end.imbalance <= 1e-10
        assert far(other.gaps, path.gaps) <= 1e-9
        assert difference(end.state.displacement, outcome.state.displacement) <= 1e-9


def test_gauss_points_and_a_mass_without_joint_nodes(wall):
    # More joint unknowns than dofs at the joint (G is singular), and nodes without mass.
    massless = Body(redistribute_mass=True)
    for model in (wall(Joints(friction(), quadrature="gauss")), wall(body=massless)):
        path, _, outcome = march(model)
        assert outcome.imbalance <= 1e-10
        for compliance in ("compressed", "matrix-free"):
            other, _, end = march(model, compliance=compliance)
            assert far(other.gaps, path.gaps) <= 1e-9
            assert end.imbalance <= 1e-10
        _, _, reference = march(model, solver="monolithic")
        assert difference(outcome.state.displacement, reference.state.displacement) <= 1e-8


def test_end_point_schemes(wall):
    # The weight of 1/k in the law is another one there.
    model = wall()
    scheme = GeneralizedAlpha(spectral_radius=0.8)
    _, _, reference = march(model, solver="monolithic", scheme=scheme)
    for compliance in COMPLIANCES:
        _, _, end = march(model, compliance=compliance, scheme=scheme)
        assert difference(end.state.displacement, reference.state.displacement) <= 1e-8


def test_steps_of_changing_length(wall):
    """Two lengths in turn, each with a factor and a compliance of its own, from known forces."""
    system, scheme = wall().system(), EnergyConsistent()
    states = []
    for kind in ("condensed", "monolithic"):
        solver = make_solver(system, SolverOptions(relative_tolerance=1e-12), kind)
        state = initial_state(solver)
        for dt in (DT, DT, 0.3 * DT, DT, 0.3 * DT, 0.3 * DT, 0.1 * DT, DT, DT):
            state, report = scheme.advance(solver, state, dt)
            assert report.dt == dt
        states.append(state)
    assert difference(states[0].displacement, states[1].displacement) <= 1e-9


@pytest.mark.mpi
def test_a_step_too_hard_is_cut(wall):
    # Four iterations are too few for some of the steps from a sudden self weight; halves pass.
    model = wall()
    simulation = Simulation(model, options=SolverOptions(max_iterations=4))
    outcome = simulation.dynamics(dt=4 * DT, steps=10, motion=swaying)
    assert outcome.counts.rejected > 0
    assert outcome.imbalance <= 1e-10
    with pytest.raises(ConvergenceError, match="dynamic stage.* did not converge in 1 iteration:"):
        Simulation(model, options=SolverOptions(max_iterations=1)).dynamics(
            dt=4 * DT, steps=10, motion=swaying, control=StepControl(max_halvings=0)
        )


@pytest.mark.mpi
def test_a_solve_that_failed_leaves_no_trace(wall):
    """The next solve starts from zero forces and gives what a new solver gives."""
    model = wall()
    options = SolverOptions(relative_tolerance=1e-12)
    system = model.system()
    b = system.stiffness.createVecRight()
    system.load(0.0, b)
    expected, _ = solved(InterfaceSolver(system, options), STATIC, b, system)
    solver = InterfaceSolver(system, replace(options, max_iterations=1))
    with pytest.raises(ConvergenceError, match="in 1 iteration:"):
        solved(solver, STATIC, b, system)
    solver.options = options
    again, _ = solved(solver, STATIC, b, system)
    assert difference(again, expected) <= 1e-10


def solved(solver: Any, effective: MatrixCoefficients, b: Any, system: Any) -> Any:
    x = b.duplicate()
    x.set(0.0)
    _, report = solver.solve(effective, b, x, system.contact.at_rest(x))
    return x, report


@pytest.mark.mpi
def test_the_same_solve_again_starts_from_its_solution(wall):
    # Statics go to rounding, which may be a last iteration away.
    system = wall().system()
    b = system.stiffness.createVecRight()
    system.load(0.0, b)
    solver = InterfaceSolver(system, SolverOptions())
    first, report = solved(solver, STATIC, b, system)
    assert report.iterations > 3
    solver.follows_path = False  # start from the last forces instead of the accepted state
    second, report = solved(solver, STATIC, b, system)
    assert report.iterations <= 1
    assert difference(second, first) <= 1e-12


class Plain:
    """A law of the user with the three methods of `Law` alone, those of another."""

    def __init__(self, law: Any) -> None:
        self.backward_euler = law.backward_euler
        self.stored_energy = law.stored_energy
        self.closed_stiffness = law.closed_stiffness


def test_a_law_with_three_methods_marches_as_the_law_that_it_is(wall):
    """Also beside rigid joints; by backward Euler, as `Plain` says nothing of whole steps."""
    scheme = GeneralizedAlpha(spectral_radius=0.8)
    path, _, outcome = march(wall(friction()), scheme=scheme)
    other, _, found = march(wall(Plain(friction())), scheme=scheme)
    assert found.solver == outcome.solver == "condensed"
    assert far(other.gaps, path.gaps) <= 1e-9
    assert far(other.tractions, path.tractions) <= 1e-8
    rigid = RigidJoint(friction_angle_deg=30.0)
    laws = {"joint_1": friction(), "joint_2": rigid, "joint_3": rigid}
    path, _, _ = march(wall(laws), steps=5, scheme=scheme)
    other, _, _ = march(wall({**laws, "joint_1": Plain(friction())}), steps=5, scheme=scheme)
    assert far(other.gaps, path.gaps) <= 1e-9
    with pytest.raises(JointsError, match="no finite stiffness, which modes and the solvers 'mono"):
        modes(wall(laws).system(), 1)


@pytest.mark.parametrize("compliance", COMPLIANCES)
def test_an_unsymmetric_body(wall, compliance):
    """Compressed, half of an unsymmetric matrix must not stand for the other half."""

    def skew(u: Any, v: Any) -> Any:
        return 1e9 * (u[0] * v[2] - u[2] * v[0]) * ufl.dx

    model = wall(body=Body(extra_stiffness=skew, symmetric=False))
    _, at_rest, end = march(model, compliance=compliance)
    _, expected_at_rest, expected = march(model, solver="monolithic")
    assert difference(at_rest.displacement, expected_at_rest.displacement) <= 1e-9
    assert difference(end.state.displacement, expected.state.displacement) <= 1e-9


@pytest.mark.mpi
def test_clamped_points_that_carry_load_do_not_loosen_tolerances(wall):
    """A joint pressed 10 um together on its clamped base: some 1e4 N there, which nothing moves."""
    model = wall(Joints(friction(), initial_gaps={"joint_2": -1e-5}))
    outcome = Simulation(model).dynamics(dt=DT, steps=10, motion=swaying)
    assert outcome.counts.rejected == 0
    assert outcome.imbalance <= 1e-12


@pytest.mark.parametrize("kind", [InterfaceSolver, NewtonSolver])
def test_solvers_go_when_nothing_uses_them(wall, kind):
    """Without waiting for Python's search for cycles: a factor may hold gigabytes."""
    solver = kind(wall().system())
    watched = weakref.ref(solver)
    gc.disable()
    try:
        del solver
        assert watched() is None
    finally:
        gc.enable()


def test_energies_of_a_shaken_block_on_keys_balance():
    """To the 1e-11 of stiff joints; to a tenth of the tolerance the iteration left 2e-11."""
    at = np.indices((3, 3, 5)).reshape(3, -1).T  # corners of cells of 1 m
    number = np.arange(len(at)).reshape(3, 3, 5)
    faces = [number[i : i + 2, j : j + 2].transpose(2, 1, 0) for i in (0, 1) for j in (0, 1)]
    jointed = mesh_from_arrays(
        MPI.COMM_SELF,
        cell="hexahedron",
        x=at.astype(float),
        cells=[
            number[i : i + 2, j : j + 2, k : k + 2].transpose(2, 1, 0).ravel()
            for i, j, k in product((0, 1), (0, 1), range(4))
        ],
        facet_groups={
            name: [face[k].ravel() for face in faces] for name, k in (("base", 0), ("joint", 2))
        },
    )
    model = Model(
        jointed,
        material=Elastic(young=25e9, poisson=0.2, density=2400.0),
        joints=KeyedJoint(normal_stiffness=1e11, shear_stiffness=4e10),
        supports=[Fixed(group="base")],
        loads=[Gravity()],
        damping=stiffness_proportional(ratio=0.05, frequency=10.0),
    )
    simulation = Simulation(model)
    simulation.statics()
    amplitude, rate = np.array([6.0, 2.0, 3.0]), np.array([20.0, 13.0, 40.0])
    outcome = simulation.dynamics(dt=DT, steps=200, motion=lambda t: amplitude * np.sin(rate * t))
    assert outcome.imbalance <= 1e-11
