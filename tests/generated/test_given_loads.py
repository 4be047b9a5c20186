# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated parameters of supports, loads, water and temperatures, as far as they need no mesh."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from generated_input import answer, cheap
from hypothesis import given
from hypothesis import strategies as st
from junk import arguments, numbers, passed_on, shared

import dolfinx_joints as dj

GROUP = {"group": st.sampled_from(["base", "top"])}
FACTOR = {"factor": st.sampled_from([math.cos, np.sin])}
LEVEL = {"level": numbers(1.0, -2.0)}
WATER = {"density": numbers(1000.0), "gravity": numbers(9.81)}
MOTION = dj.Motion(acceleration=np.eye(3), dt=0.01)
AIR = dj.AnnualWave(mean=10.0, amplitude=5.0)


def vectors(*sizes: int) -> Any:
    """Vectors of as many numbers as one of the sizes says."""
    lists = [st.lists(numbers(1.0, 0.0), min_size=n, max_size=n) for n in sizes]
    return st.one_of(*lists, *(lists[-1].map(tuple),), st.just(np.ones(sizes[0])))


def head(points: Any) -> Any:
    """A depth at points."""
    return np.ones(len(points))


DOORS: dict[str, tuple[Any, Any, Any]] = {
    "Fixed": (dj.Fixed, GROUP, {"components": st.sampled_from([None, "x", "xy", "zx"])}),
    "Prescribed": (
        dj.Prescribed,
        {
            **GROUP,
            "component": st.sampled_from("xyz"),
            "value": st.sampled_from([math.sin]),
        },
        {},
    ),
    "Spring": (
        dj.Spring,
        {**GROUP, "normal_stiffness": numbers(1e9)},
        {"tangential_stiffness": numbers(1e9)},
    ),
    "ViscousBoundary": (dj.ViscousBoundary, GROUP, {}),
    "Gravity": (dj.Gravity, {}, {"acceleration": st.none() | vectors(2, 3)}),
    "Traction": (dj.Traction, {**GROUP, "value": vectors(2, 3)}, FACTOR),
    "Pressure": (dj.Pressure, {**GROUP, "value": numbers(1e6)}, FACTOR),
    "FormLoad": (dj.FormLoad, {"form": st.sampled_from([math.sin])}, FACTOR),
    "BaseMotion": (dj.BaseMotion, {"acceleration": st.just(MOTION)}, {}),
    "HydrostaticPressure": (dj.HydrostaticPressure, {**GROUP, **LEVEL}, {**WATER, **FACTOR}),
    "SiltPressure": (
        dj.SiltPressure,
        {**GROUP, **LEVEL, "density": numbers(900.0), "coefficient": numbers(0.5)},
        {"gravity": numbers(9.81), **FACTOR},
    ),
    "WestergaardMass": (
        dj.WestergaardMass,
        {**GROUP, **LEVEL},
        {"depth": st.none() | numbers(20.0) | st.just(head), "density": numbers(1000.0)},
    ),
    "ReservoirMass": (
        dj.ReservoirMass,
        {**GROUP, **LEVEL},
        {
            "length": st.none() | numbers(50.0),
            "upstream": st.none() | vectors(2, 3),
            "density": numbers(1000.0),
            "frequency": numbers(0.0, 1.0),
            "sound_speed": numbers(1440.0),
        },
    ),
    "Uplift": (
        dj.Uplift,
        {"joint": st.just("joint_1"), "pressure": numbers(1e5) | st.just(head)},
        FACTOR,
    ),
    "JointWater": (
        dj.JointWater,
        {"joint": st.just("joint_1"), **LEVEL},
        {
            "aperture": numbers(0.0, 1e-4),
            "closed": numbers(0.0, 1e5) | st.just(head),
            "reached_from": st.sampled_from([None, "top"]),
            "in_dynamics": st.sampled_from(["follows", "frozen", "drained"]),
            **WATER,
            **FACTOR,
        },
    ),
    "Temperature": (
        dj.Temperature,
        {
            "value": numbers(10.0, -5.0) | st.just(lambda x: x[0]),
            "reference": numbers(5.0) | st.dictionaries(st.text(max_size=3), numbers(5.0)),
            "expansion": numbers(1e-5),
        },
        {"cells": st.sampled_from([None, "lower"]), **FACTOR},
    ),
    "AnnualWave": (
        dj.AnnualWave,
        {"mean": numbers(10.0, -3.0), "amplitude": numbers(8.0)},
        {"warmest_day": numbers(201.0, 366.0)},
    ),
    "ReservoirTemperature": (
        dj.ReservoirTemperature,
        {
            **LEVEL,
            "air": st.just(AIR),
            "surface_mean": numbers(12.0),
            "surface_amplitude": numbers(7.0),
            "deep_mean": numbers(5.0),
        },
        {},
    ),
    "FreeField": (
        dj.FreeField,
        {
            "groups": st.sampled_from([["base"], ("base", "sides")]),
            "incident": st.just(MOTION),
            "surface": numbers(100.0),
        },
        {
            "base": st.none() | numbers(0.0, -50.0),
            "components": st.sampled_from([None, "x", "xz"]),
            "highest_frequency": numbers(25.0),
        },
    ),
    "SupportForces": (dj.SupportForces, {"reaction": st.none()}, {}),
    "incident_wave": (dj.incident_wave, {"outcrop": st.just(MOTION)}, {}),
}


@pytest.mark.parametrize("name", DOORS)
@shared(cheap(), len(DOORS))
@given(data=st.data())
def test_loads(name: str, data: Any) -> None:
    kind, needed, optional = DOORS[name]
    given = data.draw(arguments(needed, optional))
    answer(name, passed_on(lambda: kind(**given)))


LINE = {
    "start": vectors(2, 3),
    "end": vectors(2, 3),
    "upstream": numbers(50.0),
    "downstream": numbers(10.0),
}
DRAIN = st.none() | st.tuples(numbers(0.2), numbers(0.3))


@shared(cheap(), 4)
@given(arguments(LINE, {"drain": DRAIN, **WATER}))
def test_seepage_line(given: dict[str, Any]) -> None:
    made = answer("SeepageLine", passed_on(lambda: dj.SeepageLine(**given)))
    if made is not None:
        pressures = made(np.array([[0.0, 0.0, 0.0], [0.5, 0.2, 0.1]]))
        assert (np.isfinite(pressures) & (pressures >= 0.0)).all()
