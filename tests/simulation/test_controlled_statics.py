# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static stages controlled by a gap or a displacement: softening bar, snap-back, results, input."""

import dataclasses
import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import box

import dolfinx_joints as dj

YOUNG, STRENGTH, ENERGY, STIFFNESS, PULL = 30e9, 3e6, 100.0, 1e13, 1e6
WIDEST = 2.0 * ENERGY / STRENGTH  # opening at which linear softening ends, 67 um
GAP = dj.ControlledGap(joint="joint")
END = dj.ControlledDisplacement(along=(2.0, 0.0), place="pulled")
# Openings before the peak (g_0 = 0.3 um), on the falling branch, and beyond its end.
OPENINGS = np.array([0.2, 0.3, 1.0, 10.0, 30.0, 60.0, 70.0, 100.0]) * 1e-6


def bar(length=1.0, softening="linear", comm=MPI.COMM_SELF, **changes):
    """Return a bar of 0.1 m2 between rollers, with a joint at its middle and a pull of 1 MPa."""
    law = dj.CohesiveJoint(
        normal_stiffness=STIFFNESS,
        shear_stiffness=STIFFNESS,
        friction_angle_deg=35.0,
        tensile_strength=STRENGTH,
        cohesion=2.0 * STRENGTH,
        fracture_energy=ENERGY,
        shear_fracture_energy=10.0 * ENERGY,
        softening=softening,
    )
    sides = {"rollers": lambda x: np.isclose(x[1], 0.0) | np.isclose(x[1], 0.1)}
    values = {
        "material": dj.Elastic(young=YOUNG, poisson=0.0, density=0.0),
        "joints": law,
        "supports": [dj.Fixed(group="fixed"), dj.Fixed(group="rollers", components="y")],
        "loads": [dj.Traction(group="pulled", value=(PULL, 0.0))],
        "body": dj.Body(plane="stress"),
    }
    jointed = box(
        (length, 0.1),
        (int(16 * length), 2),
        joints={"joint": (0, 0.5 * length)},
        groups={"fixed": (0, 0.0), "pulled": (0, length)} | sides,
        comm=comm,
    )
    return dj.Model(jointed, **(values | changes))


def traction(opening, softening):
    """Return the traction of the law in pure tension (9d)."""
    x, ductility = opening * STIFFNESS / STRENGTH, 2.0 * ENERGY * STIFFNESS / STRENGTH**2
    share = np.exp(-2.0 * (x - 1.0) / (ductility - 1.0)) / x
    if softening == "linear":
        share = np.maximum(ductility / x - 1.0, 0.0) / (ductility - 1.0)
    return STIFFNESS * opening * np.where(x <= 1.0, 1.0, share)


def follow(model, values, quantity=GAP, **options):
    """Return the simulation and its load factors; energies must balance to 1e-10."""
    simulation = dj.Simulation(model, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dj.PlausibilityWarning)
        dj.controlled_statics(simulation, values, loads=model.loads, quantity=quantity)
    states = [stage.state for stage in simulation.stages]
    assert max(state.energy.relative_error for state in states) < 1e-10
    assert [state.controlled for state in states] == list(values)
    return simulation, np.array([state.load_factor for state in states])


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
@pytest.mark.parametrize("length", [0.5, 4.0])
@pytest.mark.parametrize("softening", ["linear", "exponential"])
def test_whole_falling_branch(softening, length):
    """The load is the traction of the law at each opening, for bars that snap back or not.

    At the end of the linear branch the bar is in two parts, and the bond has lost G_I on 0.1 m2.
    """
    simulation, factors = follow(bar(length, softening), OPENINGS)
    exact = traction(OPENINGS, softening) / PULL
    np.testing.assert_allclose(factors, exact, rtol=1e-9, atol=1e-10)
    if softening == "linear":
        assert simulation.static.energy.joint_friction[0] == pytest.approx(0.1 * ENERGY, rel=1e-9)


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_displacement_control_of_a_short_bar_and_snap_back_of_a_long_one():
    """A bar of length L snaps back if f L / E, its elongation at the peak, exceeds 2 G_I / f."""
    openings = OPENINGS[1:6]
    short, long = 0.5, 4.0
    assert STRENGTH / YOUNG * short < WIDEST < STRENGTH / YOUNG * long
    exact = traction(openings, "linear")
    _, factors = follow(bar(short), openings + exact * short / YOUNG, END)
    np.testing.assert_allclose(factors, exact / PULL, rtol=1e-8)
    model = bar(long)
    simulation, peak = dj.Simulation(model), STRENGTH * long / YOUNG + STRENGTH / STIFFNESS
    values = peak * np.array([0.5, 0.99, 1.1])
    with pytest.raises(dj.ConvergenceError, match="snap-back.* the opening of") as error:
        dj.controlled_statics(simulation, values, loads=model.loads, quantity=END)
    assert error.value.step == 3
    assert error.value.reached == pytest.approx(STRENGTH / PULL, rel=0.01)
    assert f"is {peak:.3g}"[:6] in str(error.value)  # the value at the last equilibrium
    assert len(simulation.stages) == 2


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_unloading_and_constant_loads():
    """Unloading returns to the origin; a load of an earlier stage stays and adds to the factor."""
    back = np.array([10e-6, 5e-6, 10e-6, 30e-6])
    exact = traction(back, "linear")
    exact[1] = 0.5 * exact[0]
    _, factors = follow(bar(), back)
    np.testing.assert_allclose(factors, exact / PULL, rtol=1e-9)
    pull = dj.Traction(group="pulled", value=(0.2 * PULL, 0.0))
    model = bar(loads=[pull, dj.Traction(group="pulled", value=(PULL, 0.0))])
    simulation = dj.Simulation(model)
    simulation.statics(loads=[pull])
    state = dj.controlled_statics(simulation, [30e-6], loads=model.loads[1:], quantity=GAP)
    assert state.load_factor == pytest.approx(traction(30e-6, "linear") / PULL - 0.2, rel=1e-9)
    assert state.missing == ()
    assert [stage.name for stage in simulation.stages] == ["statics 1", "controlled statics 1, 1"]


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
@pytest.mark.parametrize("kind", ["compressed", "matrix-free"])
def test_other_forms_of_the_compliance(kind):
    """Compressed and matrix-free compliances give the same branch; names of stages are unique."""
    model, options = bar(), dj.SolverOptions(compliance=kind)
    simulation, factors = follow(model, OPENINGS, options=options)
    np.testing.assert_allclose(factors, traction(OPENINGS, "linear") / PULL, rtol=1e-9, atol=1e-10)
    with pytest.raises(dj.JointsError, match="in use"):
        dj.controlled_statics(
            simulation, [1e-4], loads=model.loads, quantity=GAP, name="controlled statics 1"
        )


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_ranks_and_results_file(comm, tmp_path):
    """Factors and values in the file; a gap at a point and a difference of points, on all ranks."""
    path = comm.bcast(tmp_path) / "bar.h5"
    monitor = dj.ResultsMonitor(path, points={"end": (1.0, 0.0)})
    _, factors = follow(bar(comm=comm), OPENINGS, monitors=[monitor])
    np.testing.assert_allclose(factors, traction(OPENINGS, "linear") / PULL, rtol=1e-9, atol=1e-10)
    at_point = dj.ControlledGap(joint="joint", point=(0.5, 0.05))
    _, factors = follow(bar(comm=comm), OPENINGS[:5], at_point)
    np.testing.assert_allclose(factors, traction(OPENINGS[:5], "linear") / PULL, rtol=1e-9)
    ends = dj.ControlledDisplacement(along=(1.0, 0.0), place=(1.0, 0.1), relative_to=(0.0, 0.1))
    _, factors = follow(bar(comm=comm, softening="linear", length=1.0), [1e-5, 2e-5], ends)
    stretch = 1.0 / YOUNG + 1.0 / STIFFNESS
    np.testing.assert_allclose(factors, np.array([1e-5, 2e-5]) / stretch / PULL, rtol=1e-9)
    if comm.rank == 0:
        with dj.Results(path) as results:
            np.testing.assert_allclose(results.series("statics", "controlled"), OPENINGS)
            stored = results.series("statics", "load_factor")
        np.testing.assert_allclose(stored, traction(OPENINGS, "linear") / PULL, atol=1e-8)
        page = dj.report.write([path], path.with_suffix(".html")).read_text(encoding="utf-8")
        assert "Controlled static stages" in page


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_constant_uplift_at_the_time_of_the_last_stage():
    """An uplift of t times 0.1 MPa stays at its value at 2 s, in the equilibrium and in results."""
    uplift = dj.Uplift(joint="joint", pressure=1e5, factor=lambda t: t)
    pull = dj.Traction(group="pulled", value=(PULL, 0.0), factor=lambda t: 0.1 * t)
    model = bar(loads=[uplift, pull])
    simulation = dj.Simulation(model)
    simulation.quasi_statics([2.0])
    state = dj.controlled_statics(simulation, [30e-6], loads=[pull], quantity=GAP)
    exact = (traction(30e-6, "linear") - 2e5) / (0.2 * PULL)
    assert state.load_factor == pytest.approx(exact, rel=1e-9)
    assert simulation.stages[-1].time == 2.0
    np.testing.assert_allclose(simulation.stages[-1].pressure, 2e5)
    # Results would have its pressure without the load factor.
    with pytest.raises(ValueError, match="other than Temperature and water"):
        dj.controlled_statics(simulation, [40e-6], loads=[uplift], quantity=GAP)


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_intact_branch_beside_a_weaker_joint():
    """Below the strength of both joints, each opens by t / k_n.

    A second equilibrium has the same opening of the stronger joint and a softened weaker joint.
    """
    law = bar().contact.laws["joint"]
    laws = {"joint": law, "weak": dataclasses.replace(law, tensile_strength=0.5 * STRENGTH)}
    jointed = box(
        (1.0, 0.1),
        (16, 2),
        joints={"joint": (0, 0.25), "weak": (0, 0.75)},
        groups={"fixed": (0, 0.0), "pulled": (0, 1.0), "base": (1, 0.0), "top": (1, 0.1)},
        comm=MPI.COMM_SELF,
    )
    rollers = [dj.Fixed(group=group, components="y") for group in ("base", "top")]
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=0.0),
        joints=laws,
        supports=[dj.Fixed(group="fixed"), *rollers],
        loads=[dj.Traction(group="pulled", value=(PULL, 0.0))],
    )
    simulation, factors = follow(model, [1e-7, 1.4e-7])
    np.testing.assert_allclose(factors, [1.0, 1.4], rtol=1e-9)
    np.testing.assert_allclose(simulation.static.joints.state.gap[:, 0], 1.4e-7, rtol=1e-9)


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_an_absent_block_is_refused():
    """The weight of the block is not among the constant loads."""
    jointed = box(
        (1.0, 1.0),
        (2, 2),
        joints={"joint": (1, 0.5)},
        groups={"base": (1, 0.0), "top": (1, 1.0)},
        cells={"lower": (0.0, 0.5), "upper": (0.5, 1.0)},
        comm=MPI.COMM_SELF,
    )
    weight, pull = dj.Gravity(), dj.Traction(group="top", value=(0.0, PULL))
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=YOUNG, poisson=0.0, density=2400.0),
        joints=bar().contact.laws["joint"],
        supports=[dj.Fixed(group="base")],
        loads=[weight, pull],
    )
    simulation = dj.Simulation(model)
    simulation.statics(loads=[weight], absent=["upper"])
    with pytest.raises(dj.JointsError, match="upper is absent"):
        dj.controlled_statics(simulation, [1e-6], loads=[pull], quantity=GAP)


@pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning")
def test_bad_input():
    """Each wrong argument raises one error; nothing is recorded."""
    model = bar()
    cases = [
        (dict(quantity=dj.ControlledGap(joint="lift")), {}, "lift"),
        (dict(quantity=dj.ControlledGap(joint="joint", point=(0.1, 0.0))), {}, "0.4 m from the"),
        (dict(quantity=dj.ControlledGap(joint="joint", point=(0.5, 0.0, 0.0))), {}, "2 finite"),
        (dict(quantity=dj.ControlledDisplacement(along=(0, 0), place="pulled")), {}, "above zero"),
        (dict(quantity=dj.ControlledDisplacement(along=(1, 0), place="top")), {}, "top"),
        (dict(quantity=dj.ControlledDisplacement(along=(1, 0), place=(0.51, 0.0))), {}, "nearest"),
        (
            dict(quantity=dj.ControlledDisplacement(along=(1, 0), place="fixed")),
            {},
            "do not change",
        ),
        (dict(quantity=dj.ControlledGap(joint="joint", component="s2")), {}, "do not change"),
        (dict(quantity=GAP), dict(solver="monolithic"), "condensed solver"),
        (dict(quantity=dj.ControlledDisplacement(along=(1, 0), place=(0.5, 0.0))), {}, "2 nodes"),
        (dict(loads=[]), {}, "loads is"),
        (dict(loads=[dj.Gravity()]), {}, "not a load of the model"),
        (dict(values=[]), {}, "values"),
        (dict(values=[np.nan]), {}, "finite"),
        (dict(quantity="opening"), {}, "a controlled quantity"),
    ]
    for changes, options, text in cases:
        simulation = dj.Simulation(model, **options)
        given = dict(values=[1e-6], loads=model.loads, quantity=GAP) | changes
        with pytest.raises((ValueError, dj.JointsError), match=text):
            dj.controlled_statics(simulation, given.pop("values"), **given)
        assert simulation.stages == []
