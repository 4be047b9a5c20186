# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The balance sees a fault in any line: none of them is what the others leave.

Two masses on a spring, damped, pushed to and fro, strike and rub a joint; the spring's other end is
a support that moves. Each line is falsified by 1 % in turn, and the lines must no longer add up.
"""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("petsc4py")

from dolfinx_joints import (
    EnergyConsistent,
    FrictionNoTension,
    ImplicitContact,
    JointsError,
    MatrixSystem,
    Newmark,
    SolverOptions,
)
from dolfinx_joints.body.damping import Rayleigh
from dolfinx_joints.laws.law import Losses
from dolfinx_joints.laws.mohr_coulomb import MohrCoulombJoint
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration import midpoint, newmark
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state

SCHEMES = {
    "energy-consistent": EnergyConsistent(),
    "implicit": ImplicitContact(),
    "newmark": Newmark(),
}
FRICTION = {"normal_stiffness": 2e5, "shear_stiffness": 1e5, "friction_angle_deg": 30.0}
BODY = ["loads", "viscous", "absorbed", "damping of the equation", "friction", "stored"]
CASES = [
    *((name, fault) for name in SCHEMES for fault in BODY),
    *((name, "supports") for name in ("energy-consistent", "implicit")),
    *((name, "numerical") for name in ("implicit", "newmark")),
]


def scene(law, *, moving):
    """Dofs: support along the joint, mass along it, mass across it, pressed by 100 N."""
    k, m = 1e4, 10.0
    plain = MatrixSystem.from_arrays(
        mass=m * np.eye(3),
        stiffness=[[k, -k, 0.0], [-k, k, 0.0], [0.0, 0.0, k]],
        damping=30.0 * np.eye(3),
        load=lambda t: [0.0, 150.0 * np.sin(25.0 * t), -100.0 + 400.0 * np.sin(40.0 * t)],
        gap=[[0, 0, 1], [0, 1, 0], [0, 0, 0]],
        law=law,
        initial_gap=1e-4,
    )
    support = {"constrained": np.array([0])}
    if moving:
        support["values"] = lambda t: np.array([2e-3 * np.sin(30.0 * t)])
    rayleigh = Rayleigh(mass_factor=1.0, stiffness_factor=1e-4)
    waves = MatrixSystem.from_arrays(mass=np.eye(3), stiffness=10.0 * np.eye(3)).stiffness
    return dataclasses.replace(plain, rayleigh=rayleigh, absorption=waves, **support)


def run(scheme, law=None, *, moving=None, steps=400):
    """The ledger, the statuses seen, and the largest imbalance of the joint over the scale."""
    moving = scheme != Newmark() if moving is None else moving
    system = scene(law or FrictionNoTension(**FRICTION), moving=moving)
    assert scheme.conserves(system)
    solver = make_solver(system, SolverOptions(relative_tolerance=1e-13))
    state, ledger = initial_state(solver, dt=1e-3), EnergyLedger(system)
    ledger.start(state)
    seen, of_joint = set(), 0.0
    for _ in range(steps):
        state, report = scheme.advance(solver, state, 1e-3)
        row = ledger.record(ledger.after(state, report))
        seen |= {int(s) for s in state.joints.status}
        of_joint = max(of_joint, abs(row.joint_imbalance[0]))
    return ledger, seen, of_joint / ledger.scale, state


def falsified(function):
    """The function with 1 % more of the numbers it gives."""
    return lambda *args, **more: 1.01 * function(*args, **more)


def plant(monkeypatch, fault):
    if fault == "loads":
        works = MatrixSystem.work_of_loads
        more = lambda *args: {name: 1.01 * each for name, each in works(*args).items()}  # noqa: E731
        monkeypatch.setattr(MatrixSystem, "work_of_loads", more)
    if fault in FalseProducts:
        for module in (midpoint, newmark):
            monkeypatch.setattr(module, "Products", FalseProducts[fault])
    if fault == "damping of the equation":
        right = MatrixSystem.coefficients
        monkeypatch.setattr(
            MatrixSystem, "coefficients", lambda s, m, c, k: right(s, m, 1.01 * c, k)
        )
    if fault == "stored":
        stored = falsified(FrictionNoTension.stored_energy)
        monkeypatch.setattr(FrictionNoTension, "stored_energy", stored)
    if fault == "friction":
        for name in ("condensed_backward_euler", "condensed_discrete_gradient"):
            monkeypatch.setattr(FrictionNoTension, name, rubbing(getattr(FrictionNoTension, name)))
    if fault == "numerical":
        losses = FrictionNoTension.losses
        monkeypatch.setattr(
            FrictionNoTension,
            "losses",
            lambda *args: Losses(losses(*args).friction, 1.01 * losses(*args).numerical),
        )


def rubbing(method):
    def more(*args):
        answer = method(*args)
        return dataclasses.replace(answer, dissipation=1.01 * answer.dissipation)

    return more


class FalseViscous(midpoint.Products):
    def __init__(self, *args):
        super().__init__(*args)
        self.viscous *= 1.01


class FalseAbsorbed(midpoint.Products):
    def __init__(self, *args):
        super().__init__(*args)
        self.absorbed *= 1.01


class FalseReaction(midpoint.Products):
    def __init__(self, *args):
        super().__init__(*args)
        self.reaction.scale(1.01)


FalseProducts = {"viscous": FalseViscous, "absorbed": FalseAbsorbed, "supports": FalseReaction}


@pytest.mark.parametrize("name", SCHEMES)
def test_without_a_fault_the_lines_add_up(name):
    ledger, seen, of_joint, _ = run(SCHEMES[name])
    row = ledger.row
    assert seen == {0, 1, 2}
    assert ledger.relative_imbalance <= 1e-11
    assert of_joint <= 1e-11
    assert min(row.viscous, row.friction, abs(row.input)) > 0.01 * ledger.scale
    assert 0.1 * row.viscous < row.absorbed < row.viscous
    if name == "energy-consistent":
        assert row.numerical == 0.0
    else:
        assert abs(row.numerical) > 1e-4 * ledger.scale


@pytest.mark.parametrize(("name", "fault"), CASES)
def test_a_fault_in_any_line_shows(monkeypatch, name, fault):
    plant(monkeypatch, fault)
    ledger, _, of_joint, _ = run(SCHEMES[name])
    assert ledger.relative_imbalance > 1e-6
    # The joint's own share says whose line is false; the body's balance judges the solve.
    assert (of_joint > 1e-6) == (fault in ("friction", "stored", "numerical"))


@pytest.mark.parametrize("name", SCHEMES)
def test_bonds_that_break_are_accounted_for(name):
    """Law without an answer over whole steps; broken on the way, with cohesion and dilatancy."""
    law = MohrCoulombJoint(
        **FRICTION, cohesion=40.0, tensile_strength=20.0, dilatancy_angle_deg=5.0
    )
    ledger, _, _, state = run(SCHEMES[name], law, moving=False)
    assert state.joints.state.internal[0, 0] == 1.0
    assert ledger.relative_imbalance <= 1e-11
    assert abs(ledger.row.numerical) > 1e-4 * ledger.scale


@pytest.mark.parametrize("name", SCHEMES)
def test_a_law_that_states_no_losses_is_left_out(name):
    """Its numerical loss is the rest: a false friction of it cannot show, and it is named."""

    class Plain:
        """The end-point answer of another law, 1 % of friction too much."""

        law = FrictionNoTension(**FRICTION)

        def backward_euler(self, gap, state):
            answer = self.law.backward_euler(gap, state)
            return dataclasses.replace(answer, dissipation=1.01 * answer.dissipation)

        def stored_energy(self, state):
            return self.law.stored_energy(state)

        def closed_stiffness(self):
            return self.law.closed_stiffness()

    scheme, law = SCHEMES[name], Plain()
    ledger, *_ = run(scheme, law)
    assert ledger.relative_imbalance <= 1e-11
    contact = scene(law, moving=False).contact
    assert contact.without_losses(scheme.rule) == ("Plain",)
    assert scene(Plain.law, moving=False).contact.without_losses(scheme.rule) == ()


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
def test_a_fault_in_plastic_work_shows(monkeypatch):
    # A square of plastic cells, pressed by its weight and a shaken base.
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    from dolfinx import mesh

    from dolfinx_joints import DruckerPrager, Elastic, Fixed, Gravity, Model, Simulation, split_mesh
    from dolfinx_joints.body.nonlinear_cells import NonlinearBulk

    square = mesh.create_unit_square(MPI.COMM_SELF, 2, 2, mesh.CellType.quadrilateral)
    square.topology.create_connectivity(1, 2)
    base = mesh.locate_entities_boundary(square, 1, lambda x: np.isclose(x[1], 0.0))
    rock = DruckerPrager(
        elastic=Elastic(young=1e9, poisson=0.3, density=2000.0),
        cohesion=1e4,
        friction_angle_deg=30.0,
        fit="plane strain",
    )
    model = Model(
        split_mesh(square, groups={"base": base}),
        material=rock,
        supports=[Fixed(group="base")],
        loads=[Gravity()],
    )

    def run_model():
        return Simulation(model).dynamics(
            dt=1e-3,
            steps=20,
            motion=lambda t: [20.0 * np.sin(300.0 * t), 0.0, 0.0],
        )

    outcome = run_model()
    assert outcome.imbalance < 1e-12
    assert outcome.energy.plastic > 0.01 * outcome.energy.stored
    losses = NonlinearBulk.losses
    false_losses = lambda self, joints: (1.01 * losses(self, joints)[0], 0.0)  # noqa: E731
    monkeypatch.setattr(NonlinearBulk, "losses", false_losses)
    with pytest.raises(JointsError, match="does not close"):
        run_model()
