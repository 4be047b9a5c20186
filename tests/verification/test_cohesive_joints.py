# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cohesive joints in models: double cantilever beam, energy of breaking, ranks, refused meshes."""

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import box

import dolfinx_joints as dj
from dolfinx_joints.monitors.fields import energy_terms
from dolfinx_joints.simulation.monitor import Monitor

CONCRETE = dj.Elastic(young=24e9, poisson=0.0, density=2400.0)
G_1, G_2 = 50.0, 200.0


def cohesive(softening="linear", **changes):
    values = {
        "normal_stiffness": 1e11,
        "shear_stiffness": 4e10,
        "friction_angle_deg": 35.0,
        "tensile_strength": 2e5,
        "cohesion": 3e5,
        "fracture_energy": G_1,
        "shear_fracture_energy": G_2,
        "softening": softening,
    }
    return dj.CohesiveJoint(**(values | changes))


class Rows(Monitor):
    """Monitor that collects the rows of the ledger, and the stages."""

    def __init__(self):
        self.rows, self.stages = [], []

    def static_stage(self, model, stages):
        self.stages.append(stages[-1].state)

    def record(self, record):
        self.rows.append(record.energy)


def cantilever(law, young, height, moved, *, loads=(), cells=80):
    """Return two arms on a joint of 2 m, clamped at one end and cracked over 1 m at the other."""
    crack = {"joint": lambda x: np.where(x[:, 0] < 1.0 - 1e-9, 1e-9, 0.0)}
    groups = {
        "upper": lambda x: np.isclose(x[0], 0.0) & (x[1] > height - 1e-9),
        "lower": lambda x: np.isclose(x[0], 0.0) & (x[1] < height + 1e-9),
        "clamped": (0, 2.0),
    }
    return dj.Model(
        box(
            (2.0, 2.0 * height),
            (cells, 4),
            joints={"joint": (1, height)},
            groups=groups,
            comm=MPI.COMM_SELF,
        ),
        material=dj.Elastic(young=young, poisson=0.0, density=0.0),
        joints=dj.Joints(law, initial_gaps=crack),
        supports=[dj.Fixed(group="clamped"), *moved],
        loads=list(loads),
        body=dj.Body(degree=2, plane="stress"),
    )


def quasi_statics(model, times):
    """Return the states at given times, whose energies must balance to 1e-10."""
    monitor = Rows()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the opening at the ends is large for the cells
        dj.Simulation(model, monitors=[monitor]).quasi_statics(times)
    assert max(state.energy.relative_error for state in monitor.stages) < 1e-10
    return monitor.stages


def test_double_cantilever_beam():
    """Load against opening while the crack grows, within 1 %: beams with G_I = P^2 a^2 / (E I).

    Two arms of height h and length a open by d = 2 P a^3 / (3 E I), per metre of width. Without a,
    P = sqrt((2/3) G_I^(3/2) (E I)^(1/2) / d). A length added to a for the rotation at the crack tip
    does not change this curve.
    """
    young, height, energy, opening = 30e9, 0.1, 100.0, 8e-3
    law = cohesive(
        normal_stiffness=3e12,
        shear_stiffness=1e12,
        tensile_strength=1.5e6,
        cohesion=5e6,
        fracture_energy=energy,
        shear_fracture_energy=500.0,
    )

    def moved(name, sign):
        half = 0.5 * sign * opening
        return dj.Prescribed(group=name, component="y", value=lambda t: half * t)

    model = cantilever(law, young, height, [moved("upper", 1.0), moved("lower", -1.0)])
    times = np.array([0.4, 0.65, 0.75, 0.8, 0.9, 1.0])
    states = quasi_statics(model, times)[2:]
    bending = young * height**3 / 12.0
    loads = np.array([model.resultant(state.reaction, "upper")[1] for state in states])
    exact = np.sqrt(2.0 / 3.0 * energy**1.5 * np.sqrt(bending) / (opening * times[2:]))
    np.testing.assert_allclose(loads, exact, rtol=0.01)
    # The energy of broken bonds grows with the crack length (E I G)^(1/2) / P of the closed form.
    broken = [model.contact.fracture_energy(state.joints.state) for state in states]
    lengths = np.sqrt(bending * energy) / loads
    assert broken[-1] - broken[0] == pytest.approx(energy * (lengths[-1] - lengths[0]), rel=0.03)


def test_mixed_mode_bending():
    """Moment M on one arm of a double cantilever while the crack grows, within 1 %.

    The energy release rates M^2 / (4 E I) in mode I and 3 M^2 / (16 E I) in mode II (Williams 1988)
    do not depend on the crack length. Their sum, each divided by its fracture energy, is 1 if both
    modes grow in proportion at each point. With equal ductilities of both modes the actual path
    matters little.
    """
    young, height, turned = 30e9, 0.1, 0.019
    law = cohesive(
        "exponential",
        normal_stiffness=3e12,
        shear_stiffness=3e12,
        tensile_strength=1.5e6,
        cohesion=1.5e6 * np.sqrt(2.0),
        fracture_energy=100.0,
        shear_fracture_energy=200.0,
    )
    rotation = dj.Prescribed(
        group="upper",
        component="x",
        value=lambda x, t: turned * t * (x[:, 1] - 1.5 * height),
    )
    states = quasi_statics(cantilever(law, young, height, [rotation]), [0.6, 0.8, 0.9, 1.0])
    works = [state.energy.supports for state in states[1:]]
    moments = np.diff(works) / (0.1 * turned)
    exact = np.sqrt(young * height**3 / 12.0 / (0.25 / 100.0 + 0.1875 / 200.0))
    np.testing.assert_allclose(moments, exact, rtol=0.01)


def column(law, comm=MPI.COMM_WORLD):
    """Two blocks of 4 m by 10 m in a plane, the lower one of 2 m."""
    jointed = box(
        (4.0, 10.0), (4, 10), joints={"joint": (1, 2.0)}, groups={"base": (1, 0.0)}, comm=comm
    )
    supports, loads = [dj.Fixed(group="base")], [dj.Gravity()]
    return dj.Model(jointed, material=CONCRETE, joints=law, supports=supports, loads=loads)


def shake(model, motion, *, solver="auto", steps=40):
    """Statics, then a motion; the monitor, and the outcome."""
    monitor = Rows()
    simulation = dj.Simulation(
        model,
        solver=solver,
        monitors=[monitor],
        options=dj.SolverOptions(relative_tolerance=1e-12),
    )
    simulation.statics()
    return monitor, simulation.dynamics(dt=5e-3, steps=steps, motion=motion)


def rocking(time):
    return np.array([8.0 * np.sin(15.0 * time), 3.0 * np.sin(25.0 * time)])


@pytest.mark.parametrize("solver", ["condensed", "monolithic"])
@pytest.mark.parametrize("softening", ["linear", "exponential"])
def test_energy_balances_while_the_joint_breaks(softening, solver):
    """The ledger of the energy-consistent scheme closes to rounding; broken bonds are friction."""
    model = column(cohesive(softening), MPI.COMM_SELF)
    monitor, outcome = shake(model, rocking, solver=solver)
    largest = max(row.stored for row in monitor.rows)
    assert max(abs(row.imbalance) for row in monitor.rows) <= 1e-10 * largest
    assert max(abs(row.numerical) for row in monitor.rows) == 0.0
    broken = np.array([row.fracture for row in monitor.rows])
    assert (np.diff(broken) >= 0.0).all()
    assert broken[0] == 0.0
    assert 4.0 * G_1 < broken[-1] <= monitor.rows[-1].friction
    assert outcome.state.joints.state.internal[:, 0].min() > 0.5
    assert "fracture" in energy_terms(model)


def test_joint_torn_off_dissipates_fracture_energy_times_area():
    """A joint in tension alone: the line of the ledger is G_I times 4 m^2 per metre."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the joint opens far
        monitor, _ = shake(column(cohesive()), lambda t: np.array([0.0, -60.0 * (t < 0.1)]))
    assert monitor.rows[-1].fracture == pytest.approx(4.0 * G_1, rel=1e-12)


@pytest.mark.mpi
def test_ranks_do_not_matter(comm):
    spread, alone = column(cohesive(), comm), column(cohesive(), MPI.COMM_SELF)
    (one, first), (two, second) = shake(spread, rocking), shake(alone, rocking)
    assert one.rows[-1].fracture == pytest.approx(two.rows[-1].fracture, rel=1e-7)
    assert max(abs(row.imbalance) for row in one.rows) <= 1e-10 * one.rows[0].stored
    loads = spread.operator.gather(first.state.joints.state.internal[:, 1])
    if comm.rank == 0:
        expected = alone.operator.gather(second.state.joints.state.internal[:, 1])
        np.testing.assert_allclose(np.sort(loads), np.sort(expected), rtol=1e-6)


def test_softening_too_steep_for_the_cells_is_refused():
    """The compliance of a bar is h / E per area: statics need a softening below about E / h."""
    steep = cohesive(fracture_energy=0.2001, shear_fracture_energy=1.1251)
    with pytest.warns(dj.PlausibilityWarning, match="zone in shear"):
        model = column(steep)
    with pytest.raises(dj.JointsError, match=r"steepest softening .* Use cells of at most"):
        dj.Simulation(model).statics()


def test_warns_of_cells_longer_than_a_third_of_the_process_zone():
    """0.88 E G / f^2 is 0.1 m for E = 24 GPa, G = 20 J/m^2 and f = 2 MPa; the cells have 1 m."""
    law = cohesive(tensile_strength=2e6, fracture_energy=20.1, shear_fracture_energy=2e4)
    with pytest.warns(dj.PlausibilityWarning, match=r"zone in tension is 0.107 m .* mean facet 1"):
        column(law)
    assert column(cohesive()).doubts == []
