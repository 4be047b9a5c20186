# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives by parameters of a model: second-order remainders, and closed forms."""

import math

from mpi4py import MPI

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from boxes import COMM, box
from recorded_blocks import LAW, recorded, shaken
from test_taylor import QUANTITIES, second_order

import dolfinx_joints as dj

PARAMETERS = {
    "E": dj.Parameter(value=24e9, deviation=2e9, unit="Pa"),
    "nu": dj.Parameter(value=0.2, deviation=0.02),
    "rho": dj.Parameter(value=2400.0, deviation=100.0),
    "damping": dj.Parameter(value=0.02, deviation=0.005),
    "k_n": dj.Parameter(value=5e9, deviation=1e9),
    "mu": dj.Parameter(value=0.5, deviation=0.05),
    "gap": dj.Parameter(value=2e-5, deviation=1e-6),
    "T_0": dj.Parameter(value=10.0, deviation=2.0),
    "push": dj.Parameter(value=1e4, deviation=1e3),
    "spring": dj.Parameter(value=1e7, deviation=1e6),
}
# Changes, relative to the standard deviations, without flips and with remainders above rounding.
CHANGE = 1e-3


def scene(comm=COMM):
    """Return a parametric model of two blocks; the lower one has a seasonal temperature."""
    mesh = box(
        (2.0, 2.0),
        (2, 4),
        joints={"j": (1, 1.0)},
        groups={"base": (1, 0.0), "left": (0, 0.0), "right": (0, 2.0)},
        comm=comm,
    )

    def build(values):
        concrete = dj.Elastic(young=values["E"], poisson=values["nu"], density=values["rho"])
        law = dj.FrictionNoTension(
            normal_stiffness=values["k_n"],
            shear_stiffness=3e9,
            friction_coefficient=values["mu"],
        )
        heat = dj.Temperature(value=12.0, reference=values["T_0"], expansion=1e-5)
        push = dj.Traction(group="right", value=(-values["push"], 0.0), factor=lambda t: 1.0 + t)
        return dj.Model(
            mesh,
            material=concrete,
            joints=dj.Joints(law, initial_gaps={"j": values["gap"]}),
            supports=[
                dj.Fixed(group="base"),
                dj.Spring(group="left", normal_stiffness=values["spring"]),
            ],
            loads=[dj.Gravity(), heat, push],
            damping=dj.rayleigh(ratio=values["damping"], frequencies=(10.0, 40.0)),
        )

    return dj.ParametricModel(build, PARAMETERS)


def seasons(model, tape):
    simulation = dj.Simulation(model, monitors=[tape])
    simulation.statics(steps=3)
    simulation.quasi_statics([0.5, 1.0, 0.2])


def from_rest(model, tape):
    """Shake without a static stage: Newmark's first acceleration depends on the density."""
    simulation = dj.Simulation(model, monitors=[tape])
    simulation.dynamics(
        dt=2e-3, steps=10, motion=lambda t: 5.0 * math.cos(20.0 * t) * np.ones(3), scheme=NEWMARK
    )


NEWMARK = dj.Newmark()
RUNS = {
    "seasons": seasons,
    "energy-consistent": shaken(steps=40),
    "Newmark": shaken(NEWMARK, steps=40),
    "from rest": from_rest,
}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_second_order(run):
    parametric, checked = scene(), 0
    tape = recorded(run, parametric.model(), body=True)
    quantity = QUANTITIES["squared displacement"]
    gradient = dj.gradient_of(tape, quantity, parametric)
    for name, given in PARAMETERS.items():
        change = {name: CHANGE * given.deviation}
        checked += second_order(run, tape, quantity, change, gradient)
    assert checked > 3


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_ranks():
    """Compare ranks with one process."""
    gradients = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        parametric = scene(comm)
        tape = recorded(shaken(NEWMARK, steps=20), parametric.model(), body=True)
        quantity = QUANTITIES["squared displacement"]
        gradients.append(dj.gradient_of(tape, quantity, parametric).by_parameter)
    for name, parameter in PARAMETERS.items():
        alone, together = (parameter.deviation * g[name] for g in gradients)
        assert together == pytest.approx(alone, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_frequencies():
    """Frequencies are proportional to the roots of all stiffnesses, and of 1 / density (Euler).

    The derivatives by single parameters are compared with difference quotients.
    """
    mesh = box((1.0, 3.0), (2, 6), joints={"j": (1, 1.0)}, groups={"base": (1, 0.0)})

    def build(values):
        law = dj.FrictionNoTension(
            normal_stiffness=values["k_n"],
            shear_stiffness=values["k_s"],
            friction_coefficient=0.5,
        )
        solid = dj.Elastic(young=values["E"], poisson=0.2, density=values["rho"])
        spring = dj.Spring(
            group="base", normal_stiffness=values["s"], tangential_stiffness=values["s"]
        )
        return dj.Model(mesh, material=solid, joints=law, supports=[spring])

    means = {"k_n": 5e9, "k_s": 2e9, "E": 20e9, "s": 1e10, "rho": 2400.0}
    parameters = {n: dj.Parameter(value=v, deviation=0.1 * v) for n, v in means.items()}
    parametric = dj.ParametricModel(build, parameters)
    f, derivatives = dj.frequencies(parametric, None, 4)
    relative = derivatives * np.array(list(means.values())) / f[:, None]
    assert relative[:, :4].sum(axis=1) == pytest.approx(0.5, rel=1e-8)
    assert relative[:, 4] == pytest.approx(-0.5, rel=1e-8)
    for j, (name, mean) in enumerate(means.items()):
        ends = [dj.frequencies(parametric, {name: mean * x}, 4)[0] for x in (0.999, 1.001)]
        assert relative[:, j] == pytest.approx(np.log(ends[1] / ends[0]) / 2e-3, abs=1e-6)


def test_changed_model():
    """Matrices are assembled again only if the material or the supports change."""
    parametric = scene()
    model = parametric.model()
    law = dj.frictionless(normal_stiffness=1e9)
    softer = dj.changed_model(model, joints=law, loads=[dj.Gravity()])
    assert softer.stiffness is model.stiffness
    assert softer.contact.laws == {"j": law}
    assert (softer.contact.initial_gap == 0.0).all()
    assert softer.parameters["loads"] == softer.loads == [dj.Gravity()]
    assert model.contact.laws == {"j": LAW}
    assert dj.changed_model(model, material=model.parameters["material"]).mass is model.mass
    solid = dj.Elastic(young=1e9, poisson=0.2, density=2400.0)
    assert dj.changed_model(model, material=solid).stiffness is not model.stiffness
    with pytest.raises(ValueError, match="Model has no argument 'laws'; the arguments are"):
        dj.changed_model(model, laws=law)


def test_refused():
    for given in (
        {"deviation": 0.0},
        {"value": math.nan},
        {"lower": 2.0},
        {"lower": 1.0, "upper": 1.0},
        {"upper": math.nan},
    ):
        with pytest.raises(ValueError, match=r"Parameter: (value|deviation|upper) is"):
            dj.Parameter(**({"value": 1.0, "deviation": 1.0} | given))
    with pytest.raises(ValueError, match="build is None"):
        dj.ParametricModel(None, PARAMETERS)
    with pytest.raises(ValueError, match="The parameter 'E' is 1.0; it must be a Parameter"):
        dj.ParametricModel(lambda values: None, {"E": 1.0})
    parametric = scene()
    with pytest.raises(ValueError, match="'F' is not a parameter; the parameters are E, nu"):
        parametric.model({"F": 1.0})
    with pytest.raises(ValueError, match="The parameter 'E' is 'soft'"):
        parametric.model({"E": "soft"})
    bounded = dj.Parameter(value=1.0, deviation=1.0, lower=0.0, upper=2.0)
    with pytest.raises(ValueError, match="The parameter 'a' is 3.0; it must be .* from 0 to 2"):
        dj.ParametricModel(lambda values: None, {"a": bounded}).model({"a": 3.0})
    with pytest.raises(ValueError, match="The result of build is None; it must be a Model"):
        dj.ParametricModel(lambda values: None, {"a": bounded}).model()
    model = parametric.model()
    same = dj.ParametricModel(lambda values: model, {"a": bounded})
    same.model()
    with pytest.raises(dj.JointsError, match="build returned the same model for different values"):
        same.model({"a": 2.0})
    quantity = QUANTITIES["residual slip"]
    with pytest.raises(dj.JointsError, match=r"need Tape\(..., body=True\)"):
        dj.gradient_of(recorded(seasons, model), quantity, parametric)
    tape = recorded(seasons, scene().model(), body=True)
    with pytest.raises(dj.JointsError, match="The run has another model"):
        dj.gradient_of(tape, quantity, parametric)
    with pytest.raises(ValueError, match="parametric is .* must be a ParametricModel"):
        dj.gradient_of(tape, quantity, model)


@pytest.mark.parametrize(
    ("change", "case"),
    [
        (
            {"joints": dj.KeyedJoint(normal_stiffness=1e9, shear_stiffness=1e9)},
            "'a' changes the type of a joint law",
        ),
        ({"supports": [dj.Fixed(group="left")]}, "'a' changes supports"),
        ({"loads": []}, "it may only change them: no load instead of Gravity, Temperature"),
    ],
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_changes_that_are_no_numbers(change, case):
    model = scene().model()

    def build(values):
        return dj.changed_model(model, **(change if values["a"] > 1.0 else {}))

    parametric = dj.ParametricModel(build, {"a": dj.Parameter(value=1.0, deviation=1.0)})
    tape = recorded(seasons, parametric.model(), body=True)
    with pytest.raises(dj.JointsError, match=case):
        dj.gradient_of(tape, QUANTITIES["residual slip"], parametric)
