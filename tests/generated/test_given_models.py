# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated arguments of models, and of what acts on them, on two plane blocks with a joint."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from generated_input import answer, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, numbers, passed_on, raising, returning, shared

import dolfinx_joints as dj
from dolfinx_joints.loads.load import Load

pytestmark = pytest.mark.mpi

REFUSALS = (ValueError, dj.JointsError)
SOLID = dj.Elastic(young=1e10, poisson=0.2, density=2400.0)
SOFT = dj.DruckerPrager(elastic=SOLID, cohesion=1e6, friction_angle_deg=30.0)
GRAIN = dj.Orthotropic(young=[1e10] * 3, poisson=[0.2] * 3, shear=[4e9] * 3, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
FREE = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e10)
HELD = [dj.Fixed(group="base")]
SPRUNG = [dj.Spring(group="base", normal_stiffness=1e10), dj.ViscousBoundary(group="sides")]
GROUPS = st.sampled_from(["base", "top", "sides", "top", "sides", "joint_1+", "nowhere"])
CELLS = st.sampled_from([None, "lower", "upper", "nowhere"])


@pytest.fixture(scope="session")
def blocks(read: Callable[..., Any], two_rectangles_file: Callable[..., Any]) -> Any:
    """Two cells with a joint between them."""
    return read(two_rectangles_file(divisions=1))


@pytest.fixture(scope="session")
def model(blocks: Any) -> dj.Model:
    """The blocks on their base."""
    return dj.Model(blocks, material=SOLID, joints=LAW, supports=HELD)


def value(*typical: float) -> Any:
    """Typical values, functions of places, and functions that give or do what they should not."""
    odd = st.sampled_from([raising, np.ones_like, lambda x: x[:, 0], lambda x: np.abs(x[:, 1])])
    return numbers(*typical) | odd | JUNK.map(returning)


MODEL = {
    "material": st.sampled_from(
        [SOLID, {"lower": SOLID, "upper": GRAIN}, GRAIN, SOFT, {"lower": SOLID}, dj.Elastic]
    ),
    "joints": st.sampled_from([LAW, {"joint_1": FREE}, dj.ViscousJoint(law=LAW), SOFT, {}]),
}
OPTIONS = {
    "supports": st.sampled_from([HELD, SPRUNG, (), [dj.Fixed(group="nowhere")], [dj.Fixed]]),
    "loads": st.sampled_from(
        [[dj.Gravity()], (), [dj.Gravity], [dj.Gravity(acceleration=[1] * 3)]]
    ),
    "damping": st.sampled_from([None, dj.Rayleigh(mass_factor=0.1, stiffness_factor=1e-3)]),
    "initial_gaps": st.none() | st.dictionaries(st.sampled_from(["joint_1", "j"]), value(1e-3)),
    "degree": st.sampled_from([None, 1]),
    "quadrature": st.sampled_from(["auto", "nodal", "gauss", 3]),
    "plane": st.sampled_from(["strain", "stress"]),
    "extra_mass": st.none() | JUNK.map(returning),
    "added_mass": st.sampled_from([(), [dj.WestergaardMass(group="sides", level=1.0)], [LAW]]),
    "symmetric": st.booleans(),
    "redistribute_mass": st.booleans(),
}


@shared(costly(), 3)
@given(given=arguments(MODEL, OPTIONS), jointed=st.sampled_from([None, None, None, None]) | JUNK)
def test_model(blocks: Any, comm: Any, given: dict[str, Any], jointed: Any) -> None:
    jointed = blocks if jointed is None else jointed
    answer("Model", passed_on(lambda: dj.Model(jointed, **given)), REFUSALS, comm)


FACTOR = st.sampled_from([math.cos, math.exp, raising]) | JUNK.map(returning)
MOTION = st.sampled_from([lambda t: (t, 1.0), lambda t: [1.0, t, 2]]) | JUNK.map(returning)
GROUP, LEVEL = {"group": GROUPS}, {"level": numbers(1.0, -2.0)}
PAIR = st.sampled_from([2, 2, 2, 3]).flatmap(lambda n: st.tuples(*[numbers(1.0, 0.0)] * n))
LOADS: dict[str, tuple[Any, Any, Any]] = {
    "Gravity": (dj.Gravity, {}, {"acceleration": PAIR}),
    "Traction": (dj.Traction, {**GROUP, "value": PAIR}, {"factor": FACTOR}),
    "Pressure": (dj.Pressure, {**GROUP, "value": numbers(1e6)}, {"factor": FACTOR}),
    "FormLoad": (dj.FormLoad, {"form": JUNK.map(returning)}, {"factor": FACTOR}),
    "BaseMotion": (dj.BaseMotion, {"acceleration": MOTION}, {}),
    "HydrostaticPressure": (dj.HydrostaticPressure, {**GROUP, **LEVEL}, {"factor": FACTOR}),
    "Uplift": (
        dj.Uplift,
        {"joint": st.sampled_from(["joint_1", "j"]), "pressure": value(1e5)},
        {"factor": FACTOR},
    ),
    "JointWater": (
        dj.JointWater,
        {"joint": st.sampled_from(["joint_1", "j"]), **LEVEL},
        {"closed": value(0.0, 1e5), "reached_from": st.none() | GROUPS, "factor": FACTOR},
    ),
    "Temperature": (
        dj.Temperature,
        {
            "value": numbers(10.0) | JUNK.map(returning),
            "reference": numbers(5.0) | st.dictionaries(CELLS, numbers(5.0)),
            "expansion": numbers(1e-5),
        },
        {"cells": CELLS, "factor": FACTOR},
    ),
    "FreeField": (
        dj.FreeField,
        {
            "groups": st.sampled_from([["sides"], ("sides",), ["base"], ["sides", "nowhere"]]),
            "incident": MOTION,
            "surface": numbers(2.0, 2.5),
        },
        {
            "base": numbers(-1.0, 0.0),
            "components": st.sampled_from(["x", "y", "xy", "z"]),
            "highest_frequency": numbers(25.0),
        },
    ),
    "SupportForces": (dj.SupportForces, {"reaction": st.none()}, {}),
}


@pytest.mark.parametrize("name", LOADS)
@shared(costly(), len(LOADS))
@given(data=st.data(), time=numbers(0.0, 1.0))
def test_loads_of_a_model(blocks: Any, comm: Any, name: str, data: Any, time: float) -> None:
    kind, needed, optional = LOADS[name]
    given = data.draw(arguments(needed, optional))

    def act() -> None:
        load: Load = kind(**given)
        absorbing = [*HELD, dj.ViscousBoundary(group="sides")]
        model = dj.Model(blocks, material=SOLID, joints=LAW, supports=absorbing, loads=[load])
        system = model.system()
        system.load(0.0, system.mass.createVecRight())

    answer(f"{name} on a model", passed_on(act), REFUSALS, comm)


ADDED: dict[str, tuple[Any, Any, Any]] = {
    "WestergaardMass": (
        dj.WestergaardMass,
        {**GROUP, **LEVEL},
        {"depth": value(20.0), "density": numbers(1000.0)},
    ),
    "ReservoirMass": (
        dj.ReservoirMass,
        {"group": st.sampled_from(["sides", "upstream", "top"]), **LEVEL},
        {
            "length": numbers(5.0),
            "upstream": PAIR,
            "frequency": numbers(0.0, 1.0),
            "sound_speed": numbers(1440.0),
        },
    ),
}


@pytest.mark.parametrize("name", ADDED)
@shared(costly(), len(ADDED))
@given(data=st.data())
def test_added_masses(model: dj.Model, comm: Any, name: str, data: Any) -> None:
    kind, needed, optional = ADDED[name]
    given = data.draw(arguments(needed, optional))
    answer(f"{name} on a model", passed_on(lambda: kind(**given).matrix(model)), REFUSALS, comm)


SUPPORTS: dict[str, tuple[Any, Any, Any]] = {
    "Fixed": (dj.Fixed, GROUP, {"components": st.sampled_from(["x", "xy", "yx", "z"])}),
    "Prescribed": (
        dj.Prescribed,
        {**GROUP, "component": st.sampled_from("xyz"), "value": FACTOR},
        {},
    ),
    "Spring": (dj.Spring, {**GROUP, "normal_stiffness": numbers(1e9)}, {}),
    "ViscousBoundary": (dj.ViscousBoundary, GROUP, {}),
}


@pytest.mark.parametrize("name", SUPPORTS)
@shared(costly(), len(SUPPORTS))
@given(data=st.data())
def test_supports(blocks: Any, comm: Any, name: str, data: Any) -> None:
    kind, needed, optional = SUPPORTS[name]
    given = data.draw(arguments(needed, optional))

    def hold() -> None:
        model = dj.Model(blocks, material=SOLID, joints=LAW, supports=[kind(**given)])
        model.system().prescribed(0.0)

    answer(f"{name} on a model", passed_on(hold), REFUSALS, comm)
