# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's method on one unknown, where each of its choices is known by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints import (
    ConvergenceError,
    FrictionNoTension,
    MatrixSystem,
    SolverOptions,
    ViscousJoint,
)
from dolfinx_joints.laws.law import BACKWARD_EULER, DISCRETE_GRADIENT, JointState
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC
from dolfinx_joints.solvers.newton import NewtonSolver
from dolfinx_joints.solvers.newton_loop import newton
from dolfinx_joints.solvers.step_solver import SolveReport


def friction(**changes):
    given = {"normal_stiffness": 1.0, "shear_stiffness": 0.0, "friction_angle_deg": 0.0}
    return FrictionNoTension(**{**given, **changes})


def solve(solver, system, load, rule=BACKWARD_EULER):
    """Displacement and report of a static solve from rest."""
    b, x = system.stiffness.createVecLeft(), system.stiffness.createVecRight()
    b.setArray(load)
    state = JointState.at_rest(system.contact.gap(x))
    _, report = solver.solve(STATIC, b, x, state, rule)
    return x.array, report


class Backwards(FrictionNoTension):
    """A law whose tangent is wrong: Newton's correction goes away from the solution."""

    def backward_euler(self, gap, state):
        response = super().backward_euler(gap, state)
        return replace(response, tangent=-3.0 * response.tangent)


@pytest.mark.parametrize("cuts", [0, 1, 2])
def test_where_no_share_helps_the_best_is_taken(cuts):
    # u + min(u, 0) = -1 from u = 0, residual 1. The wrong tangent makes the matrix 1 - 3 and the
    # correction -1/2; at u = share / 2, open, the residual is 1 + share / 2. Shares are halved
    # `cuts` times, and the smallest is the best. Forces are 1, so that this is relative too.
    law = Backwards(normal_stiffness=1.0, shear_stiffness=0.0, friction_angle_deg=0.0)
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=[[1.0], [0.0], [0.0]], law=law)
    with pytest.raises(ConvergenceError) as failure:
        solve(NewtonSolver(system, SolverOptions(max_iterations=1, max_cuts=cuts)), system, [-1.0])
    assert failure.value.iteration == 1
    assert failure.value.residual == pytest.approx(1.0 + 0.5 ** (cuts + 1), rel=1e-14)


def test_without_joints_a_solve_is_linear():
    # 4 u = 2 in one back-substitution, the first of which factors.
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=4.0)
    solver = NewtonSolver(system)
    b, x = system.stiffness.createVecLeft(), system.stiffness.createVecRight()
    b.set(2.0)
    for factorizations in (1, 0):
        response, report = solver.solve(STATIC, b, x, None)
        assert response is None
        assert report == SolveReport(
            iterations=1,
            factorizations=factorizations,
            residual=0.0,
            counts=None,
            solver="linear",
        )
        assert x.array[0] == pytest.approx(0.5, rel=1e-15)


@pytest.mark.parametrize("load", [1.0, 1e-20, 1e20])
@pytest.mark.parametrize("kind", ["condensed", "monolithic"])
def test_loads_of_any_size_are_carried(kind, load):
    # [[3, -1], [-1, 3]] u = (load, 0): three springs in a row and two closed joints, of 1 N/m each.
    # Residuals are relative to the forces.
    gap = [[-1, 0], [0, 0], [0, 0], [0, -1], [0, 0], [0, 0]]
    stiffness = [[2.0, -1.0], [-1.0, 2.0]]
    system = MatrixSystem.from_arrays(mass=np.eye(2), stiffness=stiffness, gap=gap, law=friction())
    u, _ = solve(make_solver(system, kind=kind), system, [load, 0.0])
    np.testing.assert_allclose(u, [0.375 * load, 0.125 * load], rtol=1e-13)


@pytest.mark.parametrize("load", np.linspace(-30.0, -1.1, 20))
def test_a_step_ends_at_rounding(load):
    # A point 1 m open closes, and its mean traction over the step is no line in u. The iteration
    # ends with the residual below 1e-10 of the forces; one correction more leaves their rounding.
    law, gap = friction(normal_stiffness=7.0), [[1.0], [0.0], [0.0]]
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=gap, law=law, initial_gap=1.0)
    (u,), report = solve(NewtonSolver(system), system, [load], DISCRETE_GRADIENT)
    assert report.residual == report.residuals[-1] <= 4.0 * np.finfo(float).eps
    assert len(report.residuals) == report.iterations + 1
    # The energy that the joint stores, 7 J/m^2 (1 + u)^2 / 2, over the way u is its mean force.
    assert u + 3.5 * (1.0 + u) ** 2 / u == pytest.approx(load, rel=1e-14)


def test_the_whole_correction_is_tried_where_no_halving_is_allowed():
    # Bulk and closed joint of 1 N/m each: Newton's first correction solves this.
    gap = [[-1.0], [0.0], [0.0]]
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=gap, law=friction())
    solver = make_solver(system, SolverOptions(max_cuts=0), kind="condensed")
    solver.follows_path = False  # the elastic predictor would be the solution
    u, report = solve(solver, system, [3.0])
    assert u[0] == pytest.approx(1.5, rel=1e-14)
    assert report.iterations == 1


class Softer(FrictionNoTension):
    """Friction whose methods at a gap give half of the traction."""

    def backward_euler(self, gap, state):
        whole = super().backward_euler(gap, state)
        return replace(whole, traction=0.5 * whole.traction, tangent=0.5 * whole.tangent)


@pytest.mark.parametrize("kind", ["condensed", "monolithic"])
@pytest.mark.parametrize("viscous", [False, True])
def test_a_subclass_that_changes_methods_at_a_gap_is_asked(kind, viscous):
    # Bulk and closed joint of 1 N/m, half of which is left: u + u / 2 = 3.
    law = Softer(normal_stiffness=1.0, shear_stiffness=0.0, friction_angle_deg=0.0)
    if viscous:  # no dashpots in statics
        law = ViscousJoint(law=law, normal_viscosity=1.0, shear_viscosity=0.0)
    gap = [[-1.0], [0.0], [0.0]]
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=gap, law=law)
    b, x = system.stiffness.createVecLeft(), system.stiffness.createVecRight()
    b.set(3.0)
    state = JointState.at_rest(system.contact.operator.jump(x))
    make_solver(system, kind=kind).solve(STATIC, b, x, state)
    assert x.array[0] == pytest.approx(2.0, rel=1e-13)


class Creeping:
    """A problem whose residual falls by one per cent with halved corrections, and is 1 at first.

    Whole corrections double it, and the second one in a row leads to the solution.
    """

    def __init__(self):
        self.shares = []

    def start(self):
        return SimpleNamespace(norm=1.0, whole=0)

    def trial(self, at, correction, share):
        self.shares.append(share)
        whole = at.whole + 1 if share == 1.0 else 0
        return SimpleNamespace(norm=at.norm * (2.0 if whole else 0.99), whole=whole)

    def accepted(self, at):
        return at

    def solved(self, at, before, *, last):
        return at.whole == 2

    def correction(self, at, before):
        return 1.0

    def failure(self, at, before, iterations):
        return ConvergenceError(iteration=iterations, residual=at.norm)


def test_whole_corrections_leave_a_residual_that_hardly_falls():
    # The residuals 1, 0.99, ... 0.99^5 have fallen by 5 % in five iterations, less than a tenth.
    problem = Creeping()
    at, norms = newton(problem, SolverOptions())
    assert problem.shares == [1.0, 0.5] * 5 + [1.0, 1.0]
    assert norms == pytest.approx([*0.99 ** np.arange(6), 2 * 0.99**5, 4 * 0.99**5], rel=1e-14)
    assert at.norm == norms[-1]


@pytest.mark.parametrize("most", [3, 30])
def test_plastic_cells_take_no_whole_corrections(most):
    problem = Creeping()
    with pytest.raises(ConvergenceError) as failure:
        newton(problem, SolverOptions(max_iterations=most), leaps=False)
    assert problem.shares == [1.0, 0.5] * most
    assert failure.value.iteration == most
    assert failure.value.residual == pytest.approx(0.99**most, rel=1e-14)


class Logarithm(Creeping):
    """The equation log x = 0 from x = 3, where the whole correction leads to x < 0."""

    def start(self):
        return self.trial(SimpleNamespace(x=3.0), 0.0, 1.0)

    def trial(self, at, correction, share):
        x = at.x - share * correction
        return SimpleNamespace(x=x, norm=abs(math.log(x)) if x > 0.0 else math.nan)

    def solved(self, at, before, *, last):
        return at.norm < 1e-14

    def correction(self, at, before):
        return at.x * math.log(at.x)


def test_a_correction_beyond_what_is_defined_is_halved():
    at, norms = newton(Logarithm(), SolverOptions())
    assert at.x == pytest.approx(1.0, rel=1e-13)
    # x = 3 - 3 log 3 / 2 = 1.352 after half a correction.
    assert norms[:2] == pytest.approx(
        [math.log(3.0), math.log(3.0 - 1.5 * math.log(3.0))], rel=1e-14
    )


@pytest.mark.parametrize(
    ("points", "steps", "asked", "kept"),
    [
        (2001, 3, "auto", "matrix-free"),  # 6003 unknowns for 5250 products of three solves
        (2000, 3, "auto", "auto"),  # 6000, made at once
        (2001, 4, "auto", "auto"),
        (2001, 0, "auto", "auto"),  # dynamics
        (2001, 1, "dense", "dense"),
    ],
)
def test_few_static_solves_keep_no_compliance(points, steps, asked, kept):
    # A column costs a seventh of a back-substitution, and a static solve takes 250 products: what
    # is kept pays from m / 1750 solves on, and always up to 6000 unknowns, which are made at once.
    gap = np.eye(3 * points, 1)
    system = MatrixSystem.from_arrays(mass=1.0, stiffness=1.0, gap=gap, law=friction())
    options = SolverOptions(compliance=asked)
    assert make_solver(system, options, static_steps=steps).options.compliance == kept
