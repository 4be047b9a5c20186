# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws in UFL against the same by hand, energy, derivatives, a damage law, and errors.

The cohesive law is that of `cohesive`, to which the body in the impact test adds
k_n <n>^2 / 2 in pressure.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from cohesive import (
    COHESIVE,
    K_S,
    PHI,
    A,
    B,
    ByHand,
    cohesive,
    energy_lines,
    left_over,
    random_steps,
)
from dolfinx import fem
from dolfinx.mesh import create_unit_interval
from shaken_wall import DT, STEPS, shaking, wall
from tangent_errors import central_differences

from dolfinx_joints import (
    Elastic,
    EnergyConsistent,
    Fixed,
    Gravity,
    InitialFields,
    Joints,
    KeyedJoint,
    MatrixSystem,
    Model,
    Newmark,
    PotentialJoint,
    Pressure,
    Simulation,
    SolverOptions,
    TractionJoint,
    frictionless,
    mass_proportional,
)
from dolfinx_joints.laws.law import JointState, Status
from dolfinx_joints.simulation.monitor import Monitor
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.energy import EnergyLedger
from dolfinx_joints.time_integration.initial_state import initial_state


def assert_same(answer, expected, names=("traction", "tangent"), rtol=1e-12):
    for name in names:
        one, other = getattr(answer, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=rtol * np.abs(other).max())


@pytest.mark.parametrize("rule", ["backward_euler", "discrete_gradient"])
def test_a_cohesive_law_is_the_same_by_hand(rule):
    law, by_hand = PotentialJoint(cohesive, **COHESIVE), ByHand()
    gap, state = random_steps()
    answer, expected = getattr(law, rule)(gap, state), getattr(by_hand, rule)(gap, state)
    assert_same(answer, expected)
    np.testing.assert_array_equal(answer.status, expected.status)
    assert not answer.dissipation.any()
    stored = law.stored_energy(answer.state)
    np.testing.assert_allclose(stored, by_hand.stored_energy(answer.state), rtol=1e-12)


CONCRETE = Elastic(young=25e9, poisson=0.2, density=2400.0)


class Kept(Monitor):
    def __init__(self):
        self.records = []

    def start(self, model, stage, steps, first):
        self.records = [first]

    def record(self, record):
        assert record.substeps == 1
        self.records.append(record)


def blocks(jointed, law, **options):
    loads = [Gravity(), *options.pop("loads", ())]
    return Model(
        jointed,
        material=CONCRETE,
        joints=law,
        supports=[Fixed(group="base")],
        loads=loads,
        damping=mass_proportional(ratio=0.02, frequency=50.0),
        **options,
    )


def shaken(jointed, law, scheme):
    """States of two glued blocks that are pulled at, then shaken."""
    model, kept = blocks(jointed, law, loads=[Pressure(group="top", value=-2e5)]), Kept()
    run = Simulation(
        model, monitors=[kept], solver="monolithic", options=SolverOptions(relative_tolerance=1e-13)
    )
    static = run.statics(steps=2)
    run.dynamics(dt=1e-3, steps=6, motion=lambda t: (40.0 * t / 6e-3, 0.0, 60.0), scheme=scheme)
    last = kept.records[-1]
    return [static.displacement, last.displacement, last.velocity], [static.joints, last.joints]


@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
@pytest.mark.mpi
@pytest.mark.parametrize("scheme", [None, Newmark()], ids=["default", "Newmark"])
def test_statics_and_steps_are_the_same_by_hand(blocks_file, read, comm, scheme):
    jointed = read(blocks_file())
    vectors, joints = shaken(jointed, PotentialJoint(cohesive, **COHESIVE), scheme)
    others, expected = shaken(jointed, ByHand(), scheme)
    for one, other in zip(vectors, others, strict=True):
        assert (one - other).norm() < 1e-12 * other.norm()
    for one, other in zip(joints, expected, strict=True):
        error = np.abs(one.traction - other.traction).max(initial=0.0)
        largest = np.abs(other.traction).max(initial=0.0)
        assert max(comm.allgather(error)) < 1e-12 * max(comm.allgather(largest))
    # It was pulled beyond its linear range, or the test would say little.
    gap = max(comm.allgather(joints[1].state.gap[:, 0].max(initial=0.0)))
    assert gap > 0.1 * A


@pytest.mark.parametrize("rule", ["backward_euler", "discrete_gradient"])
def test_contact_without_tension_is_the_frictionless_law(rule):
    k = 1e11
    law = PotentialJoint(
        lambda g: 0.5 * k * ufl.min_value(g[0], 0.0) ** 2, normal_stiffness=k, shear_stiffness=0.0
    )
    gap, state = random_steps()
    gap[:20] = state.gap[10:30] = 0.0  # where the frictionless joint is closed and stiff
    answer, expected = (
        getattr(each, rule)(gap, state) for each in (law, frictionless(normal_stiffness=k))
    )
    assert_same(answer, expected)
    np.testing.assert_array_equal(answer.status == Status.OPEN, expected.status == Status.OPEN)
    np.testing.assert_allclose(
        law.stored_energy(answer.state), 0.5 * k * np.minimum(gap[:, 0], 0.0) ** 2, rtol=1e-14
    )


def test_keys_in_a_shaken_wall(wall_file, read):
    """`KeyedJoint` as a potential: joints open and close, at any opening shear is carried."""
    k = 1e11

    def keys(g):
        return 0.5 * k * (ufl.min_value(g[0], 0.0) ** 2 + g[1] ** 2 + g[2] ** 2)

    shape = {"normal_stiffness": k, "shear_stiffness": k}
    ends = []
    for law in (PotentialJoint(keys, **shape), KeyedJoint(**shape)):
        run = Simulation(wall(read(wall_file()), law), solver="monolithic")
        run.statics()
        ends.append(run.dynamics(dt=DT, steps=STEPS, motion=shaking).state.displacement)
    assert (ends[0] - ends[1]).norm() < 1e-12 * ends[1].norm()


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
@pytest.mark.mpi
def test_energy_of_an_impact(blocks_file, read, comm):
    """A block falls on another, sticks a little, and leaves: every line from its own formula.

    Each step of the default scheme is exact, so that only the rounding of 30 solves is left.
    """
    k = 1e10

    def adhesive(g):
        n, s = ufl.max_value(g[0], 0.0) / A, (g[1] ** 2 + g[2] ** 2) / B**2
        return 0.5 * k * ufl.min_value(g[0], 0.0) ** 2 + PHI * (1.0 - (1.0 + n) * ufl.exp(-n - s))

    def density(gap):
        n, s = np.maximum(gap[:, 0], 0.0) / A, (gap[:, 1:] ** 2).sum(axis=1) / B**2
        return 0.5 * k * np.minimum(gap[:, 0], 0.0) ** 2 + PHI * (1.0 - (1.0 + n) * np.exp(-n - s))

    law = PotentialJoint(adhesive, normal_stiffness=k, shear_stiffness=K_S)
    model = blocks(read(blocks_file(angle=0.0)), Joints(law, initial_gaps={"joint_1": 3.0 * A}))
    kept, dt = Kept(), 1.25e-4  # 2 / dt is a number that the scheme need not round
    velocity = thrown(model, "upper", -1.0)
    outcome = Simulation(model, monitors=[kept]).dynamics(
        dt=dt, steps=30, start=InitialFields(velocity=velocity)
    )

    records = kept.records
    lines = energy_lines(model.system(), records, lambda state: density(state.gap))
    scale = lines[0]["kinetic"]
    for record, line in zip(records, lines, strict=True):
        for name, value in line.items():
            assert abs(getattr(record.energy, name) - value) < 1e-10 * scale, name
        assert abs(left_over(lines[0], line)) < 1e-10 * scale
    shares = np.array([record.energy.joint for record in records]) / scale
    gaps = [max(comm.allgather(r.joints.state.gap[:, 0].max(initial=-1.0))) for r in records]
    assert min(gaps) < -A
    assert gaps[-1] > 3.0 * A
    assert shares.max() > 0.2
    assert outcome.imbalance < 1e-10
    assert not outcome.backward_euler_laws


def thrown(model, block, speed):
    """Upward velocity of a block [m/s] as a vector of the model's unknowns."""
    v = fem.Function(model.V)
    v.interpolate(lambda x: speed * np.eye(3)[:, [2]] + 0.0 * x, model.jointed.cells(block))
    vector = model.mass.createVecRight()
    vector.setArray(v.x.array[: vector.getLocalSize()])
    return vector


# A bond that softens: kappa is the largest opening so far, exp(-kappa / A) what is left of it. An
# opening that only grows follows t = k n exp(-n / A); pressure is carried undamaged.

K = 1e10


def stored(g, kappa):
    n, s = ufl.max_value(g[0], 0.0), g[1] ** 2 + g[2] ** 2
    return 0.5 * K * (ufl.min_value(g[0], 0.0) ** 2 + ufl.exp(-kappa / A) * (n**2 + s))


@pytest.fixture(scope="module")
def bond():
    return TractionJoint(
        lambda g, kappa: ufl.diff(stored(g, kappa), g),
        internal={"kappa": (0.0, lambda g, kappa: ufl.max_value(kappa, g[0]))},
        energy=stored,
        normal_stiffness=K,
        shear_stiffness=K,
    )


def opened(law, path, state):
    """Responses along a path of normal gaps from a state."""
    answers = []
    for n in path:
        answers.append(law.backward_euler(np.array([[n, 0.0, 0.0]]), state))
        state = answers[-1].state
    return answers


def test_a_damaged_bond_unloads_along_the_secant(bond):
    state = JointState.at_rest(np.zeros((1, 3)), variables=1)
    assert bond.internal_variables == ("kappa",)
    assert not bond.initial_variables(state.gap).any()
    up, down = np.linspace(0.0, 2.0 * A, 401), np.linspace(2.0 * A, -A, 31)
    loading = opened(bond, up, state)
    unloading = opened(bond, down, loading[-1].state)
    reloading = opened(bond, [A, 3.0 * A], unloading[-1].state)
    t, back, again = ([a.traction[0, 0] for a in each] for each in (loading, unloading, reloading))
    np.testing.assert_allclose(t, K * up * np.exp(-up / A), rtol=1e-14, atol=1e-200)
    secant = np.where(down > 0.0, np.exp(-2.0), 1.0)
    np.testing.assert_allclose(back, K * down * secant, rtol=1e-12, atol=1e-9 * K * A)
    np.testing.assert_allclose(
        again, [K * A * np.exp(-2.0), 3.0 * K * A * np.exp(-3.0)], rtol=1e-14
    )
    assert reloading[-1].state.internal[0, 0] == 3.0 * A
    # Work of the opening, the integral of t, less what is stored; trapezia of 400 steps.
    lost = np.array([a.dissipation[0] for a in loading])
    work = K * A**2 * (1.0 - 3.0 * np.exp(-2.0))
    assert lost.min() >= 0.0
    assert lost.sum() == pytest.approx(work - 0.5 * K * (2.0 * A) ** 2 * np.exp(-2.0), rel=1e-5)
    # No more on the way back, but in the step that passes the kink at zero by trapezia.
    assert np.abs([a.dissipation[0] for a in unloading]).max() < 1e-12 * work


def test_without_an_energy_all_work_counts_as_dissipated():
    law = TractionJoint(
        lambda g: [K * g[0], 0.0, K * g[2]], normal_stiffness=K, shear_stiffness=0.0
    )
    gap, state = random_steps(5)
    answer = law.backward_euler(gap, state)
    seen = np.column_stack([state.gap[:, 0], state.elastic_slip])
    moved = gap - state.gap
    expected = K * ((seen + 0.5 * moved) * moved)[:, [0, 2]].sum(axis=1)
    np.testing.assert_allclose(answer.dissipation, expected, rtol=1e-12)
    assert not law.stored_energy(answer.state).any()


def test_internal_variables_in_a_run(bond):
    """1 kg on a soft spring, pulled off a bond at 1 m/s: its largest opening is remembered.

    The default scheme takes the law at the end of steps; what that loses is numerical.
    """
    system = MatrixSystem.from_arrays(mass=1e3, stiffness=1e6, gap=[[1.0], [0.0], [0.0]], law=bond)
    solver = make_solver(system)
    v = system.mass.createVecRight()
    v.setArray([1.0])
    state, ledger = initial_state(solver, velocity=v), EnergyLedger(system)
    ledger.start(state)
    largest = 0.0
    for _ in range(200):
        state, report = EnergyConsistent().advance(solver, state, 2e-4)
        ledger.record(ledger.after(state, report))
        largest = max(largest, state.joints.state.gap[0, 0])
        assert state.joints.state.internal[0, 0] == largest
    assert largest > 10.0 * A
    assert ledger.relative_imbalance < 1e-10 < ledger.row.friction


# Derivatives, points, and errors.


LAWS = {
    "smooth": (lambda: PotentialJoint(cohesive, **COHESIVE), "backward_euler"),
    "smooth, mean": (lambda: PotentialJoint(cohesive, **COHESIVE), "discrete_gradient"),
    "kinks, mean": (
        lambda: PotentialJoint(lambda g: stored(g, g[0] ** 2 / A), **COHESIVE),
        "discrete_gradient",
    ),
}


def assert_consistent(ask, gap, state):
    """The tangent against central differences of the traction, of steps of 1e-5 of the gap."""
    answer, h = ask(gap, state), 1e-5 * A
    numeric = central_differences(lambda g: ask(g, state).traction, gap, h)
    kinked = np.abs(gap[:, 0]) < 2.0 * h  # within reach of the differences
    if state.internal.size:
        kinked |= np.abs(gap[:, 0] - state.internal[:, 0]) < 2.0 * h
    error = np.abs(numeric - answer.tangent)[~kinked].max()
    assert error < 1e-7 * np.abs(answer.tangent).max()
    assert kinked.mean() < 0.01
    return answer.tangent


@pytest.mark.parametrize("name", LAWS)
def test_tangent_of_a_potential(name):
    make, rule = LAWS[name]
    tangent = assert_consistent(getattr(make(), rule), *random_steps(2000))
    spread = np.abs(tangent).max()
    np.testing.assert_allclose(tangent, tangent.transpose(0, 2, 1), rtol=0, atol=1e-12 * spread)


def test_tangent_with_internal_variables(bond):
    gap, state = random_steps(2000)
    kappa = np.abs(np.random.default_rng(2).normal(size=(2000, 1))) * A
    assert_consistent(bond.backward_euler, gap, replace(state, internal=kappa))


@pytest.mark.parametrize("count", [0, 1, 1024, 2500])
def test_any_number_of_points(bond, count):
    """As one by one, whatever the blocks that points are evaluated in."""
    gap, state = random_steps(count)
    state = replace(state, internal=np.zeros((count, 1)))
    answer = bond.backward_euler(gap, state)
    assert answer.traction.shape == (count, 3)
    assert answer.tangent.shape == (count, 3, 3)
    for i in range(0, count, 500):
        one = JointState(
            gap=state.gap[[i]], elastic_slip=state.elastic_slip[[i]], internal=state.internal[[i]]
        )
        np.testing.assert_array_equal(
            bond.backward_euler(gap[[i]], one).traction, answer.traction[[i]]
        )


def test_laws_are_told_apart():
    """By what a checkpoint and a manifest keep of them: no addresses, no numbers of UFL's."""
    one, same, other = (
        PotentialJoint(lambda g, k=k: k * ufl.inner(g, g), **COHESIVE) for k in (1.0, 1.0, 2.0)
    )
    assert repr(one) == repr(same) != repr(other)
    assert repr(one).startswith("PotentialJoint(")
    assert "(energy=" in repr(one)
    law = TractionJoint(
        lambda g, k: [k * g[i] for i in range(3)],
        internal={"k": (2.0, lambda g, k: k)},
        normal_stiffness=1.0,
        shear_stiffness=0.0,
    )
    assert repr(law).startswith("TractionJoint(traction=[")
    assert ", energy=0, update of k=" in repr(law)
    assert repr(law).endswith("k=2.0, normal_stiffness=1.0, shear_stiffness=0.0)")


def test_bad_expressions_are_one_clear_error():
    """Wrong shapes, foreign terms, and functions that are none of UFL."""
    mesh = create_unit_interval(MPI.COMM_SELF, 1)
    test = ufl.TestFunction(fem.functionspace(mesh, ("Lagrange", 1)))
    constant = fem.Constant(mesh, 1.0)
    wrong = {
        "energy has shape (3,)": lambda g: g,
        "energy contains v_0": lambda g: g[0] * test,
        "energy contains c": lambda g: constant * g[0],
        "energy contains x": lambda g: g[0] * ufl.SpatialCoordinate(mesh)[0],
        "energy fails": lambda g: np.exp(g[0]),
        "energy fails, UFL conditions": lambda g: g[0] if g[0] > 0 else 0.0,
    }
    for message, energy in wrong.items():
        with pytest.raises(
            ValueError, match=f"^PotentialJoint: {re.escape(message)}.*; it must be"
        ):
            PotentialJoint(energy, **COHESIVE)
    wanted = r"^TractionJoint: traction has shape \(\); it must be a UFL expression of shape \(3,\)"
    with pytest.raises(ValueError, match=wanted):
        TractionJoint(lambda g: g[0], **COHESIVE)
    with pytest.raises(ValueError, match="^TractionJoint: the update of k fails"):
        TractionJoint(lambda g, k: k * g, internal={"k": (0.0, lambda g: g[0])}, **COHESIVE)
    with pytest.raises(ValueError, match="^TractionJoint: internal has 'k': 1.0; it must be"):
        TractionJoint(lambda g, k: k * g, internal={"k": 1.0}, **COHESIVE)
