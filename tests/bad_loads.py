# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad parameters of supports, loads, water, added masses, temperatures and free fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bad_input import (
    NO_CHOICE,
    NO_FUNCTION,
    NO_NAME,
    NO_NUMBER,
    NO_VECTOR,
    Door,
    door,
    without,
)

import dolfinx_joints as dj

POSITIVE = without(NO_NUMBER, negative="-1.0", zero="0.0")
NOT_NEGATIVE = without(NO_NUMBER, negative="-1.0")
NO_FACTOR = {**NO_FUNCTION, "nothing": "None"}
NO_PLACE = without(NO_VECTOR, "text", "number", text="'origin'", number="0.0")
NO_GROUPS = {
    "text": "'base'",
    "nothing": "None",
    "empty": "[]",
    "twice": "['base', 'base']",
    "number among names": "['base', 1]",
}
LETTERS = {"unknown": "'xw'", "twice": "'xx'", "empty": "''", "number": "0", "list": "['x']"}


def names() -> dict[str, Any]:
    """What the rows refer to."""
    motion = dj.Motion(acceleration=np.zeros((2, 3)), dt=0.01)
    air = dj.AnnualWave(mean=10.0, amplitude=5.0)
    return {"dj": dj, "math": math, "np": np, "motion": motion, "air": air}


GROUP, NO_GROUP = {"group": "'base'"}, {"group": NO_NAME}
LEVEL = {"group": "'base'", "level": "10.0"}
NO_LEVEL = {"group": NO_NAME, "level": NO_NUMBER}

DOORS: tuple[Door, ...] = (
    door("dj.Fixed", GROUP, {"group": NO_NAME, "components": LETTERS}, names),
    door(
        "dj.Prescribed",
        {"group": "'base'", "component": "'x'", "value": "math.sin"},
        {"group": NO_NAME, "component": NO_CHOICE, "value": NO_FACTOR},
        names,
    ),
    door(
        "dj.Spring",
        {"group": "'base'", "normal_stiffness": "1e9"},
        {
            "group": NO_NAME,
            "normal_stiffness": NOT_NEGATIVE,
            "tangential_stiffness": NOT_NEGATIVE,
        },
        names,
    ),
    door("dj.ViscousBoundary", GROUP, NO_GROUP, names),
    door("dj.Gravity", {}, {"acceleration": NO_VECTOR}, names),
    door(
        "dj.Traction",
        {"group": "'top'", "value": "(0.0, 0.0, 1e5)"},
        {"group": NO_NAME, "value": {**NO_VECTOR, "nothing": "None"}, "factor": NO_FACTOR},
        names,
    ),
    door(
        "dj.Pressure",
        {"group": "'top'", "value": "1e5"},
        {"group": NO_NAME, "value": NO_NUMBER, "factor": NO_FACTOR},
        names,
    ),
    door(
        "dj.FormLoad",
        {"form": "lambda v: None"},
        {"form": NO_FACTOR, "factor": NO_FACTOR},
        names,
    ),
    door("dj.BaseMotion", {"acceleration": "motion"}, {"acceleration": NO_FACTOR}, names),
    door("dj.SupportForces", {"reaction": "None"}, {"reaction": {"nothing": "None"}}, names),
    door(
        "dj.HydrostaticPressure",
        LEVEL,
        {**NO_LEVEL, "density": NOT_NEGATIVE, "gravity": NOT_NEGATIVE, "factor": NO_FACTOR},
        names,
    ),
    door(
        "dj.SiltPressure",
        {**LEVEL, "density": "900.0", "coefficient": "0.5"},
        {
            **NO_LEVEL,
            "density": NOT_NEGATIVE,
            "coefficient": NOT_NEGATIVE,
            "gravity": NOT_NEGATIVE,
            "factor": NO_FACTOR,
        },
        names,
    ),
    door(
        "dj.WestergaardMass",
        LEVEL,
        {**NO_LEVEL, "depth": without(POSITIVE, "nothing"), "density": NOT_NEGATIVE},
        names,
    ),
    door(
        "dj.ReservoirMass",
        LEVEL,
        {
            **NO_LEVEL,
            "length": without(POSITIVE, "nothing"),
            "upstream": {**NO_VECTOR, "not horizontal": "(1.0, 0.0, 0.5)", "zero": "(0, 0, 0)"},
            "density": NOT_NEGATIVE,
            "frequency": NOT_NEGATIVE,
            "sound_speed": POSITIVE,
        },
        names,
    ),
    door(
        "dj.SeepageLine",
        {
            "start": "(0.0, 0.0)",
            "end": "(50.0, 0.0)",
            "upstream": "80.0",
            "downstream": "5.0",
        },
        {
            "start": NO_PLACE,
            "end": NO_PLACE,
            "upstream": NO_NUMBER,
            "downstream": NO_NUMBER,
            "drain": {
                "number": "0.2",
                "too short": "(0.2,)",
                "way too large": "(1.0, 0.3)",
                "way zero": "(0.0, 0.3)",
                "share too large": "(0.2, 1.1)",
                "share negative": "(0.2, -0.1)",
                "not a number": "(math.nan, 0.3)",
                "text": "('0.2', 0.3)",
            },
            "density": NOT_NEGATIVE,
            "gravity": NOT_NEGATIVE,
        },
        names,
        together={
            "one place": "end=(0.0, 0.0)",
            "unlike lengths": "end=(50.0, 0.0, 0.0)",
        },
    ),
    door(
        "dj.Uplift",
        {"joint": "'joint_1'", "pressure": "1e5"},
        {"joint": NO_NAME, "pressure": NOT_NEGATIVE, "factor": NO_FACTOR},
        names,
    ),
    door(
        "dj.JointWater",
        {"joint": "'joint_1'", "level": "10.0"},
        {
            "joint": NO_NAME,
            "level": NO_NUMBER,
            "aperture": NOT_NEGATIVE,
            "closed": NOT_NEGATIVE,
            "reached_from": without(NO_NAME, "nothing"),
            "in_dynamics": NO_CHOICE,
            "density": NOT_NEGATIVE,
            "gravity": NOT_NEGATIVE,
            "factor": NO_FACTOR,
        },
        names,
    ),
    door(
        "dj.Temperature",
        {"value": "10.0", "reference": "5.0", "expansion": "1e-5"},
        {
            "value": NO_NUMBER,
            "reference": {
                **NO_NUMBER,
                "not a number in a group": "{'rock': math.nan}",
                "a group without a name": "{1: 5.0}",
            },
            "expansion": NOT_NEGATIVE,
            "cells": without(NO_NAME, "nothing"),
            "factor": NO_FACTOR,
        },
        names,
    ),
    door(
        "dj.AnnualWave",
        {"mean": "10.0", "amplitude": "8.0"},
        {
            "mean": NO_NUMBER,
            "amplitude": NOT_NEGATIVE,
            "warmest_day": without(NOT_NEGATIVE, too_large="367.0"),
        },
        names,
    ),
    door(
        "dj.ReservoirTemperature",
        {
            "level": "100.0",
            "air": "air",
            "surface_mean": "12.0",
            "surface_amplitude": "7.0",
            "deep_mean": "5.0",
        },
        {
            "level": NO_NUMBER,
            "air": {"number": "10.0", "nothing": "None", "class": "dj.AnnualWave"},
            "surface_mean": NO_NUMBER,
            "surface_amplitude": NOT_NEGATIVE,
            "deep_mean": NO_NUMBER,
        },
        names,
    ),
    door(
        "dj.FreeField",
        {"groups": "['base']", "incident": "motion", "surface": "100.0"},
        {
            "groups": NO_GROUPS,
            "incident": NO_FACTOR,
            "surface": NO_NUMBER,
            "base": without(NO_NUMBER, "nothing", above_the_surface="101.0"),
            "components": LETTERS,
            "highest_frequency": POSITIVE,
        },
        names,
    ),
    door(
        "dj.incident_wave",
        {"outcrop": "motion"},
        {
            "outcrop": {
                "number": "1.0",
                "nothing": "None",
                "function": "math.sin",
                "class": "dj.Motion",
            }
        },
        names,
    ),
)
