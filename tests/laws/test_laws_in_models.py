# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Laws with a history or a rate of their own, mixed in one model and marched in time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints import (
    EnergyConsistent,
    FrictionNoTension,
    GeneralizedAlpha,
    HilberHughesTaylor,
    ImplicitContact,
    KeyedJoint,
    MatrixSystem,
    MohrCoulombJoint,
    Newmark,
    RigidJoint,
    ShearKeyJoint,
    SolverOptions,
    ViscousJoint,
)
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.solvers.effective_matrix import STATIC
from dolfinx_joints.time_integration.initial_state import initial_state

FRICTION = {"normal_stiffness": 1e10, "shear_stiffness": 4e9, "friction_angle_deg": 30.0}


def thrown(system, velocity):
    """Solver of a mass and its state at the start."""
    solver, v = make_solver(system), system.mass.createVecRight()
    v.setArray([velocity])
    return solver, initial_state(solver, velocity=v)


def drop(law, *, dt, end, velocity):
    """Displacement of 1 kg on one joint point of 1 m^2, thrown against it from a touching rest."""
    system = MatrixSystem.from_arrays(
        mass=[[1.0]], stiffness=[[1e-6]], gap=[[1.0], [0.0], [0.0]], law=law
    )
    solver, state = thrown(system, velocity)
    times, path = [0.0], [0.0]
    while state.time < end - 0.5 * dt:
        state, _ = Newmark().advance(solver, state, dt)
        times.append(state.time)
        path.append(float(state.displacement.array[0]))
    return np.array(times), np.array(path), state


def test_mass_on_a_dashpot_joint_converges_to_the_damped_oscillation():
    """Thrown at a joint with k 1e4 N/m and 5 % of critical damping, half a period long.

    x = -(v/w_d) exp(-z w t) sin(w_d t) until the sum of spring and dashpot would pull. The
    dashpot takes the mean rate of a step for that at its end: order one.
    """
    stiffness, ratio, v = 1e4, 0.05, 1.0
    w = math.sqrt(stiffness)
    damped = w * math.sqrt(1.0 - ratio**2)
    plain = FrictionNoTension(
        normal_stiffness=stiffness, shear_stiffness=0.0, friction_angle_deg=0.0
    )
    law = ViscousJoint(law=plain, normal_viscosity=2.0 * ratio * w)
    errors = []
    for steps in (200, 400, 800):
        end = 0.8 * math.pi / w
        times, path, _ = drop(law, dt=end / steps, end=end, velocity=-v)
        exact = -v / damped * np.exp(-ratio * w * times) * np.sin(damped * times)
        errors.append(np.abs(path - exact).max() / (v / w))
    assert errors[-1] < 1e-3
    assert errors[0] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_a_bond_breaks_once():
    """Pulled away at 1 m/s: the bond holds v^2 m k_n of 0.1^2 v^2, and breaks at 1 m/s."""
    bond = MohrCoulombJoint(
        normal_stiffness=1e4,
        shear_stiffness=0.0,
        friction_angle_deg=30.0,
        cohesion=1e4,
        tensile_strength=50.0,  # the swing at 0.1 m/s has v sqrt(k m) = 10 N, at 1 m/s 100 N
    )
    end = 2.0 * math.pi / 100.0
    _, path, state = drop(bond, dt=end / 400, end=end, velocity=0.1)
    assert path.max() == pytest.approx(1e-3, rel=1e-3)
    assert path.min() == pytest.approx(-1e-3, rel=1e-3)
    assert state.joints.state.internal[0, 0] == 0.0
    times, path, state = drop(bond, dt=end / 400, end=end, velocity=1.0)
    assert state.joints.state.internal[0, 0] == 1.0
    # It leaves with v^2 - (f_t^2 / k_n) / m = 1 - 0.25: a velocity of 0.866 m/s.
    speed = np.gradient(path, times)[-10:]
    assert speed == pytest.approx(math.sqrt(0.75), rel=0.01)


class NotHeld(MohrCoulombJoint):
    """Does not say that it breaks, as a law of a user's own: a guess must not break it."""

    breaks = False


@pytest.mark.parametrize(
    "scheme",
    [Newmark(), HilberHughesTaylor(), GeneralizedAlpha(), EnergyConsistent(), ImplicitContact()],
    ids=lambda scheme: type(scheme).__name__,
)
@pytest.mark.parametrize("law", [MohrCoulombJoint, NotHeld])
def test_a_bond_holds_what_is_below_its_strength(scheme, law):
    """A bonded mass struck at v shears its bond by v sqrt(k m) at most, a quarter of its strength.

    In steps of w dt = 500 the way dt v of a guess would break it, and sliding away is a solution
    of the step, too. The alpha methods, which begin with a damped mode, may double the swing.
    """
    stiffness, v = 1e10, 1.0
    most = v * math.sqrt(stiffness)
    bond = law(
        normal_stiffness=stiffness,
        shear_stiffness=stiffness,
        friction_angle_deg=30.0,
        cohesion=4.0 * most,
    )
    system = MatrixSystem.from_arrays(
        mass=[[1.0]], stiffness=[[1e-6]], gap=[[0.0], [1.0], [0.0]], law=bond
    )
    solver, state = thrown(system, v)
    for _ in range(50):
        state, _ = scheme.advance(solver, state, 0.005)
        assert state.joints.state.internal[0, 0] == 0.0
        assert abs(state.displacement.array[0]) <= 2.0 * most / stiffness


@pytest.mark.parametrize("steps", [1, 20])
def test_of_two_bonds_in_a_row_the_weaker_breaks(steps):
    """Springs and bonds of 1 GN/m in a row are pulled to 1.5 times the strength of the one bond.

    The other has a tenth more area, and nothing to carry once the first is gone.
    """
    stiffness, strength = 1e9, 2e5
    bond = MohrCoulombJoint(
        normal_stiffness=stiffness,
        shear_stiffness=stiffness,
        friction_angle_deg=30.0,
        cohesion=1e6,
        tensile_strength=strength,
    )
    rows = np.zeros((6, 2))
    rows[0, 0], rows[3] = 1.0, (-1.0, 1.0)
    system = MatrixSystem.from_arrays(
        mass=np.eye(2),
        stiffness=np.diag([1.0, stiffness]),  # a tied end, but for a whit that holds the middle
        gap=rows,
        areas=[1.0, 1.1],
        law=bond,
    )
    solver, pulled = make_solver(system), 1.5 * strength * (2.0 + 1.0 / 1.1) / stiffness
    b, x = system.mass.createVecRight(), system.mass.createVecRight()
    joints = system.contact.at_rest(x)
    total = np.zeros(2)
    for step in range(1, steps + 1):
        b.setArray(np.array([0.0, stiffness * pulled * step / steps]) - [1.0, stiffness] * total)
        x.set(0.0)
        response, _ = solver.solve(STATIC, b, x, joints)
        joints, total = response.state, total + x.getArray(readonly=True)
    assert joints.internal[:, 0].tolist() == [1.0, 0.0]
    np.testing.assert_allclose(response.traction, 0.0, atol=1e-6 * strength)


@pytest.mark.mpi
class TestMixed:
    """A wall of four blocks with three joints."""

    @pytest.fixture
    def jointed(self, wall_file, read):
        return read(wall_file())

    def run(self, jointed, laws, scheme=None, solver="auto"):
        from shaken_wall import wall

        from dolfinx_joints import Simulation, synthetic_motion

        model = wall(jointed, laws, damping=None)
        newton = SolverOptions(relative_tolerance=1e-12)
        simulation = Simulation(model, options=newton, solver=solver)
        simulation.statics()
        motion = synthetic_motion(duration=2.0)
        outcome = simulation.dynamics(dt=0.005, steps=20, motion=motion, scheme=scheme or Newmark())
        return model, simulation, outcome

    def test_equal_laws_of_different_kinds_give_the_same(self, jointed, comm):
        plain = FrictionNoTension(**FRICTION)
        laws = {
            "joint_1": plain,
            "joint_2": MohrCoulombJoint(**FRICTION),
            "joint_3": ViscousJoint(law=MohrCoulombJoint(**FRICTION)),
        }
        _, _, one = self.run(jointed, plain)
        model, simulation, two = self.run(jointed, laws)
        assert (one.solver, two.solver) == ("condensed", "condensed")
        assert "condensed solver" in simulation.report(two)
        first, second = one.state.displacement, two.state.displacement
        assert (first - second).norm() < 1e-8 * first.norm()
        assert two.energy.friction == pytest.approx(one.energy.friction, rel=1e-6)
        internal = model.contact.operator.gather(two.state.joints.state.internal)
        if comm.rank == 0:
            assert internal.shape == (model.operator.num_points, 2)
        joint = model.operator.gather(model.operator.joint)
        if comm.rank == 0:
            assert not internal[joint == 0].any()

    def test_a_law_without_a_step_is_named(self, jointed):
        laws = {
            "joint_1": FrictionNoTension(**FRICTION),
            "joint_2": MohrCoulombJoint(**FRICTION),
            "joint_3": ViscousJoint(law=FrictionNoTension(**FRICTION), shear_viscosity=1e6),
        }
        _, simulation, outcome = self.run(jointed, laws, EnergyConsistent())
        assert outcome.backward_euler_laws == ("MohrCoulombJoint",)
        assert "backward Euler in MohrCoulombJoint\n" in simulation.report(outcome)
        assert outcome.imbalance < 1e-10
        friction, mohr, _ = outcome.energy.joint_numerical
        assert abs(friction) < 1e-10 * outcome.energy.stored
        assert mohr > 1e-6 * outcome.energy.stored  # impacts lose energy, none is made

    @pytest.mark.parametrize(("first", "then"), [("rigid", None), ("soft", Newmark())])
    def test_a_stage_goes_on_from_another(self, jointed, comm, first, then):
        """With rigid joints, and from one scheme into another, the lines go on adding up."""
        from shaken_wall import wall

        from dolfinx_joints import Simulation, synthetic_motion

        law = RigidJoint(friction_angle_deg=30.0) if first == "rigid" else None
        model = wall(jointed, law or FrictionNoTension(**FRICTION), damping=None)
        model.loads.clear()
        simulation, motion = Simulation(model), synthetic_motion(duration=2.0)
        once = simulation.dynamics(dt=0.005, steps=30, motion=motion)
        again = simulation.dynamics(
            dt=0.005, steps=20, motion=motion, start=once.state, scheme=then
        )
        assert again.counts.rejected == 0
        assert again.imbalance < 1e-10
        assert again.state.time == pytest.approx(0.25)

    def test_keys_leave_no_slip(self, jointed, comm):
        stiff = {"normal_stiffness": 1e11, "shear_stiffness": 1e11}
        _, _, outcome = self.run(jointed, KeyedJoint(**stiff))
        assert outcome.solver == "condensed"
        response = outcome.state.joints
        expected = stiff["shear_stiffness"] * response.state.gap[:, 1:]
        largest = max(comm.allgather(float(np.abs(expected).max(initial=1.0))))
        assert np.abs(response.traction[:, 1:] - expected).max(initial=0.0) < 1e-9 * largest
        assert outcome.energy.friction == 0.0

    def test_shear_keys_by_both_solvers(self, jointed):
        """Loose by 1 um, so that flanks are met: the same path, and energies add up."""
        keys = ShearKeyJoint(
            **FRICTION,
            depth=0.1,
            flank_angle_deg=60.0,
            spacing=1.0,
            tooth_cohesion=1e6,
            forward_play=1e-6,
            backward_play=1e-6,
        )
        scheme = EnergyConsistent()
        (_, _, one), (_, _, two) = (
            self.run(jointed, keys, scheme, solver) for solver in ("condensed", "monolithic")
        )
        first, second = one.state.displacement, two.state.displacement
        assert (first - second).norm() < 1e-8 * first.norm()
        assert one.laws_without_losses == ()
        for outcome in (one, two):
            assert outcome.imbalance < 1e-10
            assert outcome.energy_error < 1e-10
        assert one.energy.friction > 0.0


class Forgetful(MohrCoulombJoint):
    """A law that gives back other variables than it has."""

    def backward_euler(self, gap, state):
        response = super().backward_euler(gap, state)
        return replace(response, state=replace(response.state, internal=np.zeros((len(gap), 7))))


def test_other_variables_than_the_law_has_are_refused():
    law = Forgetful(**FRICTION, cohesion=1e5)
    with pytest.raises(ValueError, match=r"Forgetful returned internal .* of shape \(1, 7\)"):
        drop(law, dt=1e-3, end=1e-3, velocity=-1.0)
