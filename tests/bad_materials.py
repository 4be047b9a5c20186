# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad parameters of materials, joint laws, joint stiffness and damping."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bad_input import NO_CHOICE, NO_NUMBER, Door, door, without

import dolfinx_joints as dj

POSITIVE = without(NO_NUMBER, negative="-1.0", zero="0.0")
NOT_NEGATIVE = without(NO_NUMBER, negative="-1.0")
POISSON = without(NO_NUMBER, too_large="0.5", too_small="-1.0")
ANGLE = without(NO_NUMBER, negative="-1.0", too_large="90.0")
THREE = {
    "text": "'25e9'",
    "number": "25e9",
    "nothing": "None",
    "empty": "()",
    "too short": "(1.0, 2.0)",
    "too long": "(1.0, 1.0, 1.0, 1.0)",
    "not a number": "(1.0, 1.0, math.nan)",
    "infinite": "(1.0, 1.0, math.inf)",
    "complex": "(1.0, 1.0, 1j)",
    "text among numbers": "(1.0, 1.0, '1')",
    "wrong shape": "np.eye(3)",
}


def names() -> dict[str, Any]:
    """What the rows refer to."""
    rock = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
    law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=4e10)
    return {"dj": dj, "math": math, "np": np, "rock": rock, "law": law}


STIFFNESS = {"normal_stiffness": POSITIVE, "shear_stiffness": NOT_NEGATIVE}
JOINT = {"normal_stiffness": "1e11", "shear_stiffness": "4e10"}
FRICTION = {**JOINT, "friction_angle_deg": "30.0"}
BODY = {"young": "25e9", "poisson": "0.2", "block_size": "10.0", "pressure": "1e6"}
NO_BODY = {
    "young": POSITIVE,
    "poisson": POISSON,
    "block_size": POSITIVE,
    "pressure": NOT_NEGATIVE,
    "friction_angle_deg": without(ANGLE, "nothing"),
    "element_size": without(POSITIVE, "nothing"),
}
NO_RATIO = without(NO_NUMBER, negative="-0.01", too_large="1.0")
DAMPING = {"ratio": "0.02", "frequency": "5.0"}
NO_DAMPING = {"ratio": NO_RATIO, "frequency": POSITIVE}

DOORS: tuple[Door, ...] = (
    door(
        "dj.Elastic",
        {"young": "25e9", "poisson": "0.2", "density": "2400.0"},
        {"young": POSITIVE, "poisson": POISSON, "density": NOT_NEGATIVE},
        names,
    ),
    door(
        "dj.Orthotropic",
        {
            "young": "(25e9, 25e9, 20e9)",
            "poisson": "(0.2, 0.2, 0.2)",
            "shear": "(1e10, 8e9, 8e9)",
            "density": "2400.0",
        },
        {
            "young": without(THREE, negative="(1e9, 1e9, -1e9)", zero="(1e9, 1e9, 0.0)"),
            "poisson": THREE,
            "shear": without(THREE, negative="(1e9, 1e9, -1e9)", zero="(1e9, 1e9, 0.0)"),
            "density": NOT_NEGATIVE,
            "axes": {
                "text": "'xyz'",
                "nothing": "None",
                "empty": "()",
                "wrong shape": "np.eye(2)",
                "zero": "np.zeros((3, 3))",
                "not a number": "np.full((3, 3), math.nan)",
                "not orthogonal": "[(1, 0, 0), (1, 1, 0), (0, 0, 1)]",
            },
        },
        names,
        together={
            "without energy": "poisson=(0.9, 0.9, 0.9)",
            "contradiction": "young=(1e9, 1e11, 1e9); poisson=(0.2, 0.3, 1.2)",
        },
    ),
    door(
        "dj.DruckerPrager",
        {"elastic": "rock", "cohesion": "1e6", "friction_angle_deg": "30.0"},
        {
            "elastic": {
                "number": "25e9",
                "nothing": "None",
                "class": "dj.Elastic",
                "of another kind": "law",
            },
            "cohesion": NOT_NEGATIVE,
            "friction_angle_deg": ANGLE,
            "dilatancy_angle_deg": without(
                NO_NUMBER, "nothing", negative="-1.0", above_the_friction_angle="31.0"
            ),
            "fit": NO_CHOICE,
        },
        names,
        together={"no strength": "cohesion=0.0; friction_angle_deg=0.0"},
    ),
    door(
        "dj.FrictionNoTension",
        FRICTION,
        {**STIFFNESS, "friction_angle_deg": ANGLE},
        names,
    ),
    door("dj.frictionless", {"normal_stiffness": "1e11"}, {"normal_stiffness": POSITIVE}, names),
    door("dj.KeyedJoint", JOINT, STIFFNESS, names),
    door(
        "dj.RigidJoint",
        {"friction_angle_deg": "30.0"},
        {"friction_angle_deg": ANGLE, "stiffness_ratio": POSITIVE},
        names,
    ),
    door(
        "dj.ViscousJoint",
        {"law": "law"},
        {
            "law": {
                "nothing": "None",
                "number": "1e6",
                "class": "dj.KeyedJoint",
                "of another kind": "rock",
            },
            "normal_viscosity": NOT_NEGATIVE,
            "shear_viscosity": NOT_NEGATIVE,
        },
        names,
    ),
    door(
        "dj.MohrCoulombJoint",
        FRICTION,
        {
            **STIFFNESS,
            "friction_angle_deg": ANGLE,
            "cohesion": NOT_NEGATIVE,
            "tensile_strength": NOT_NEGATIVE,
            "dilatancy_angle_deg": NOT_NEGATIVE,
        },
        names,
        together={
            "stronger in tension": "cohesion=1e6; tensile_strength=2e6",
            "dilates more than it slides": "friction_angle_deg=30.0; dilatancy_angle_deg=31.0",
        },
    ),
    door(
        "dj.propose_stiffness",
        BODY,
        {**NO_BODY, "added_compliance": POSITIVE, "overlap": POSITIVE},
        names,
    ),
    door(
        "dj.StiffnessProposal",
        {**JOINT, **BODY},
        {"normal_stiffness": POSITIVE, "shear_stiffness": POSITIVE, **NO_BODY},
        names,
    ),
    door("dj.Rayleigh", {}, {"mass_factor": NOT_NEGATIVE, "stiffness_factor": NOT_NEGATIVE}, names),
    door("dj.stiffness_proportional", DAMPING, NO_DAMPING, names),
    door("dj.mass_proportional", DAMPING, NO_DAMPING, names),
    door(
        "dj.rayleigh",
        {"ratio": "0.02", "frequencies": "(1.0, 5.0)"},
        {
            "ratio": without(NO_RATIO, "list", too_long="(0.02, 0.02, 0.02)", empty="()"),
            "frequencies": {
                "number": "5.0",
                "nothing": "None",
                "too short": "(5.0,)",
                "zero": "(0.0, 5.0)",
                "negative": "(-1.0, 5.0)",
                "not a number": "(1.0, math.nan)",
                "text": "('1', '5')",
            },
        },
        names,
        together={
            "alike": "frequencies=(5.0, 5.0)",
            "contradiction": "ratio=(0.01, 0.5); frequencies=(1.0, 5.0)",
        },
    ),
    door(
        "dj.Rayleigh().ratio",
        {"frequency": "5.0"},
        {"frequency": POSITIVE},
        names,
        title="Rayleigh.ratio",
    ),
)
