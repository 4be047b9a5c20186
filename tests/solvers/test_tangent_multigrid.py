# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies with joints solved as a whole by iteration.

Expected: solutions of the direct solver, energies that balance, as many iterations on a finer mesh.
"""

import gc
import resource
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import shaken_wall
from shaken_wall import march, swaying

import dolfinx_joints as dj
from dolfinx_joints.common.errors import JointsError
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.effective_matrix import (
    STATIC,
    EffectiveMatrix,
    MatrixCoefficients,
    unconstrained_dofs,
)
from dolfinx_joints.solvers.multigrid.tangent import TangentMultigrid
from dolfinx_joints.solvers.tangent import Tangent

pytestmark = pytest.mark.mpi

DT = 0.005
STEP = MatrixCoefficients(mass=2.0 / DT**2, damping=1.0 / DT, stiffness=0.5)
STIFFNESS = 1e10


def friction(stiffness: float = STIFFNESS) -> dj.FrictionNoTension:
    return dj.FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=stiffness, friction_angle_deg=30.0
    )


@pytest.fixture(scope="module")
def wall(wall_file, read):
    """Makes walls of one joint, 8 x 2 x 8 m, on a clamped base."""

    def make(divisions: tuple[int, int, int] = (8, 2, 8), stiffness: float = STIFFNESS) -> Any:
        size = {"length": 8.0, "thickness": 2.0, "height": 8.0, "joints": 1}
        jointed = read(wall_file(divisions=divisions, **size))
        return shaken_wall.wall(jointed, friction(stiffness))

    return make


def tangents(points: np.ndarray, kind: str, stiffness: float) -> np.ndarray:
    """Point tangents of a joint: closed, open above half its height, or sliding down the joint."""
    tangent = stiffness * np.tile(np.eye(3), (len(points), 1, 1))
    if kind == "half open":
        tangent[points[:, 2] > 4.0] = 0.0
    if kind == "sliding":
        tangent[:, 1:, 1:] = 0.0
        tangent[:, 2, 0] = 0.6 * stiffness
    return tangent


def solved(
    model: Any,
    effective: MatrixCoefficients,
    kind: str,
    linear: Any,
    stiffness: float = STIFFNESS,
) -> tuple[Any, Any]:
    """Solution of A + B^T (w D) B, and its solver."""
    system = model.system()
    free = unconstrained_dofs(system)
    tangent = Tangent(
        EffectiveMatrix(system, effective, linear=linear),
        system.internal_forces.tangent_matrix(free),
        None,
    )
    b, x = free.duplicate(), free.duplicate()
    system.load(0.0, b)
    b.pointwiseMult(b, free)
    # Other tangents before: nothing of them may stay.
    tangent.update(tangents(model.operator.points, "closed", stiffness))
    solver = tangent.update(tangents(model.operator.points, kind, stiffness))
    solver.solve(b, x, 1e-12)
    return x, solver


@pytest.mark.parametrize("effective", [STEP, STATIC], ids=["step", "statics"])
@pytest.mark.parametrize("kind", ["closed", "half open", "sliding"])
def test_solutions_are_those_of_the_direct_solver(wall, effective, kind):
    model = wall()
    direct, _ = solved(model, effective, kind, "direct")
    found, solver = solved(model, effective, kind, "iterative")
    assert isinstance(solver, TangentMultigrid)
    assert (found - direct).norm() <= 1e-9 * direct.norm()


def test_iterations_hardly_grow_with_the_mesh(wall):
    counts = []
    for divisions in ((8, 2, 8), (16, 4, 16)):
        counts.append(solved(wall(divisions), STEP, "half open", "iterative")[1].iterations)
    assert 5 <= counts[1] <= 1.2 * counts[0] + 1, counts


@pytest.mark.parametrize("kind", ["closed", "half open", "sliding"])
def test_iterations_hardly_grow_with_the_stiffness_of_the_joint(wall, kind):
    # A closed joint of 1e10 Pa/m is as stiff as the elements beside it, the other a thousand times.
    soft, stiff = (
        solved(wall(), STEP, kind, "iterative", stiffness)[1].iterations
        for stiffness in (1e10, 1e13)
    )
    assert stiff <= 2 * soft, (soft, stiff)


@pytest.mark.parametrize(("modes", "stiffness"), [(0, STIFFNESS), (4, STIFFNESS), (0, 5e12)])
def test_runs_are_those_of_the_direct_solver(wall, modes, stiffness):
    scheme, ends = dj.EnergyConsistent(exact_modes=modes), {}
    for linear, solver in (("direct", "condensed"), ("iterative", "monolithic")):
        given = {"linear": linear, "relative_tolerance": dj.SolverOptions().relative_tolerance}
        path, _, outcome = march(wall(stiffness=stiffness), steps=12, scheme=scheme, **given)
        assert outcome.solver == solver
        assert outcome.imbalance <= 1e-10
        ends[linear] = np.array(path.gaps)
    opened = ends["direct"][..., 0].max()
    assert opened > 1e-5
    assert np.abs(ends["iterative"] - ends["direct"]).max() <= 1e-8 * np.abs(ends["direct"]).max()


@pytest.mark.parametrize(("stiffness", "name"), [(STIFFNESS, "monolithic"), (1e15, "condensed")])
def test_stiff_joints_are_condensed(wall, stiffness, name):
    options = dj.SolverOptions(linear="iterative")
    assert make_solver(wall(stiffness=stiffness).system(), options).name == name
    assert make_solver(wall(stiffness=stiffness).system()).name == "condensed"


def test_matrices_of_two_time_steps_are_kept(wall, monkeypatch):
    # A step cut again and again would else fill the memory that a factor did not fit into.
    gone = []
    monkeypatch.setattr(Tangent, "destroy", lambda tangent: gone.append(tangent.effective))
    system = wall().system()
    solver = make_solver(system, dj.SolverOptions(linear="iterative"))
    rest = unconstrained_dofs(system)
    rest.set(0.0)
    state = system.contact.at_rest(rest)
    for cut in (1.0, 2.0, 1.0, 4.0):
        step = MatrixCoefficients(mass=2.0 * (cut / DT) ** 2, damping=cut / DT, stiffness=0.5)
        b, x = unconstrained_dofs(system), unconstrained_dofs(system)
        system.load(0.0, b)
        rest.copy(x)
        solver.solve(step, b, x, state)
        assert len(gone) == (cut == 4.0)


def test_memory_does_not_grow_with_the_simulations(wall):
    # On several ranks PETSc frees what goes, and must find the matrices behind products as well.
    def resident() -> int:
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    model, sizes, passes = wall((16, 4, 16)), [], 5
    for _ in range(2 + passes):
        dj.Simulation(model, options=dj.SolverOptions(linear="iterative")).statics()
        sizes.append(resident())
    matrix = 8.0 * model.stiffness.getInfo(model.stiffness.InfoType.LOCAL)["nz_used"]
    assert sizes[-1] - sizes[1] <= passes * matrix, (np.diff(sizes) / matrix).round(2)


def test_linear_steps_do_not_see_the_tolerance(wall_file, read):
    ends = {}
    for linear in ("direct", "iterative"):
        jointed = read(wall_file(divisions=(8, 2, 8), joints=1), joints=[])
        model = shaken_wall.wall(jointed, None, damping=None)
        simulation = dj.Simulation(model, options=dj.SolverOptions(linear=linear))
        outcome = simulation.dynamics(dt=DT, steps=40, motion=swaying)
        assert outcome.imbalance <= 1e-10
        ends[linear] = outcome.state.displacement
    assert (ends["iterative"] - ends["direct"]).norm() <= 1e-9 * ends["direct"].norm()


def test_what_nothing_holds_is_said(wall):
    # Two walls without supports and an open joint between them.
    free = shaken_wall.wall(wall().jointed, friction(), supports=[], damping=None)
    with pytest.raises(JointsError):
        solved(free, STATIC, "sliding", "iterative")
