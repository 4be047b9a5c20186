# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad arguments of modes, systems and temperatures of a body, on two plane blocks."""

from __future__ import annotations

from bad_input import NO_FLAG, NO_FUNCTION, NO_NUMBER, Door, door, without
from bad_model import AT_LEAST_ONE, AT_POINTS, POSITIVE, names

FACES = {
    "nothing": "None",
    "number": "10.0",
    "empty": "{}",
    "list": "['base']",
    "unknown group": "{'left': 10.0}",
    "text": "{'base': 'warm'}",
    "not a number": "{'base': math.nan}",
    "complex": "{'base': 1j}",
    "class": "{'base': dj.AnnualWave}",
    "not every block": "{'base': 10.0}",
    **{kind: f"{{'base': {text}, 'top': 10.0}}" for kind, text in AT_POINTS.items()},
}


NAMED = {
    "nothing": "None",
    "list": "['base']",
    "number as a name": "{1: 2}",
    "text as a tag": "{'a': '2'}",
    "not whole": "{'a': 2.5}",
    "negative": "{'a': -2}",
    "truth value": "{'a': True}",
}
NO_TAGS = {"text": "'facets'", "mesh": "mesh"}


DOORS: tuple[Door, ...] = (
    door(
        "dj.split_mesh",
        {"mesh": "mesh", "facet_tags": "tagged", "joints": "{'j': 2}", "groups": "{'base': 1}"},
        {
            "mesh": {"nothing": "None", "text": "'dam.msh'", "split already": "jointed"},
            "facet_tags": {**NO_TAGS, "nothing": "None", "of cells": "cells"},
            "joints": {**NAMED, "on no facet": "{'a': 9}", "on the boundary": "{'top': 3}"},
            "groups": {**NAMED, "on no facet": "{'a': 9}"},
            "cell_tags": {**NO_TAGS, "of facets": "tagged"},
            "cell_groups": {**without(NAMED, "nothing"), "on no cell": "{'a': 9}"},
        },
        names,
        together={
            "a name twice": "joints={'base': 2}",
            "a tag twice": "joints={'j': 1}",
            "a tag of two joints": "joints={'i': 2, 'j': 2}",
        },
    ),
    door(
        "dj.modes",
        {"system": "system", "count": "1"},
        {
            "system": {"nothing": "None", "model": "model"},
            "count": {**AT_LEAST_ONE, "more than there are": "1000"},
        },
        names,
    ),
    door(
        "dj.modal_damping",
        {"system": "system", "modes": "modes"},
        {
            "system": {"nothing": "None", "model": "model"},
            "modes": {"nothing": "None", "list": "modes.shapes", "number": "3"},
        },
        names,
    ),
    door(
        "dj.write_modes",
        {"modes": "modes", "model": "model", "path": "'modes.h5'"},
        {
            "modes": {"nothing": "None", "system": "system"},
            "model": {"nothing": "None", "of other unknowns": "other"},
            "path": {"number": "7", "nothing": "None", "empty": "''", "no folder": "'no/m.h5'"},
            "metadata": {"number": "0", "list": "['a']", "cannot be stored": "{'a': law}"},
            "overwrite": NO_FLAG,
        },
        names,
    ),
    door("dj.JointForces", {}, {"model": {"nothing": "None", "system": "system"}}, names),
    door(
        "other.resultant",
        {"force": "unknown", "group": "'base'"},
        {
            "force": {
                "nothing": "None",
                "array": "np.zeros(12)",
                "of another model": "run.static.reaction",
            },
            "group": {"nothing": "None", "number": "1", "list": "['base']", "unknown": "'left'"},
        },
        names,
        title="Model.resultant",
    ),
    door(
        "dj.redistribute",
        {"system": "system", "coordinates": "np.zeros((8, 2))"},
        {
            "system": {"nothing": "None", "model": "model", "without joints": "other.system()"},
            "coordinates": {
                "nothing": "None",
                "text": "'nodes'",
                "too short": "np.zeros((7, 2))",
                "wrong shape": "np.zeros((8, 3))",
                "not a number": "np.full((8, 2), math.nan)",
                "complex": "np.full((8, 2), 1j)",
            },
            "rings": AT_LEAST_ONE,
        },
        names,
    ),
    door(
        "dj.MatrixSystem.from_arrays",
        {"mass": "np.eye(3)", "stiffness": "np.eye(3)"},
        {
            "mass": {
                "nothing": "None",
                "text": "'heavy'",
                "empty": "[]",
                "not square": "np.ones((3, 2))",
                "not alike": "np.eye(2)",
                "not a number": "np.full((3, 3), math.nan)",
                "complex": "1j * np.eye(3)",
                "too deep": "np.ones((3, 3, 3))",
            },
            "damping": {"number": "0.05", "infinite": "np.full((3, 3), math.inf)"},
            "load": NO_FUNCTION,
        },
        names,
        together={
            "a law without a gap": "law=law",
            "a gap without a law": "gap=np.eye(3)",
            "a gap of a wrong shape": "gap=np.eye(2); law=law",
            "too many areas": "gap=np.eye(3); law=law; areas=[1.0, 1.0]",
            "no area": "gap=np.eye(3); law=law; areas=[0.0]",
            "a gap at rest that is none": "gap=np.eye(3); law=law; initial_gap=math.nan",
        },
    ),
    door("dj.steady_temperature", {"jointed": "jointed"}, {"faces": FACES}, names),
    door(
        "dj.seasonal_temperatures",
        {
            "jointed": "jointed",
            "faces": "{'base': 10.0, 'top': 10.0}",
            "reference": "5.0",
            "expansion": "1e-5",
        },
        {
            "reference": without(NO_NUMBER, group_without_a_number="{'rock': None}"),
            "expansion": without(NO_NUMBER, negative="-1e-5"),
            "diffusivity": POSITIVE,
            "day": without(NO_NUMBER, negative="-1.0", too_large="367.0"),
        },
        names,
    ),
)
