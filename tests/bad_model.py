# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad arguments of models and their stages, modes and temperatures, on two plane blocks."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from bad_input import (
    NO_CHOICE,
    NO_COUNT,
    NO_FLAG,
    NO_FUNCTION,
    NO_LIST,
    NO_NUMBER,
    Door,
    door,
    without,
)
from dolfinx.mesh import CellType, create_rectangle, locate_entities, meshtags
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.common.errors import CheckpointError, JointsError
from dolfinx_joints.laws.law import Response

POSITIVE = without(NO_NUMBER, negative="-1.0", zero="0.0")
AT_LEAST_ONE = without(NO_COUNT, zero="0", negative="-1")


@cache
def names() -> dict[str, Any]:
    """What the rows refer to: a block of two cells on another, its model, and what is odd."""
    mesh = create_rectangle(MPI.COMM_SELF, [[0.0, 0.0], [1.0, 2.0]], [1, 2], CellType.quadrilateral)
    places = ((1, 0.0), (2, 1.0), (3, 2.0))
    found = {tag: locate_entities(mesh, 1, lambda x, y=y: np.isclose(x[1], y)) for tag, y in places}
    facets = np.concatenate(list(found.values()))
    tags = np.repeat(list(found), [len(each) for each in found.values()]).astype(np.int32)
    order = np.argsort(facets)
    tagged = meshtags(mesh, 1, facets[order], tags[order])
    tagged_cells = meshtags(mesh, 2, np.array([0], np.int32), np.array([4], np.int32))
    groups = {"base": 1, "top": 3}
    jointed = dj.split_mesh(mesh, tagged, joints={"joint_1": 2}, groups=groups)
    whole = dj.split_mesh(mesh, tagged, joints={}, groups=groups)
    rock = dj.Elastic(young=1e10, poisson=0.2, density=2400.0)
    law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11)
    held = [dj.Fixed(group="base")]
    model = dj.Model(jointed, material=rock, joints=law, supports=held)
    run = dj.Simulation(model)
    run.statics()
    fresh = dj.Model(whole, material=rock, supports=held)
    return {
        **{"dj": dj, "math": math, "np": np, "Own": Own, "whole": whole},
        **{"jointed": jointed, "rock": rock, "law": law, "model": model, "run": run},
        **{"new": dj.Simulation(model), "other": fresh, "unknown": fresh.mass.createVecRight()},
        **{"mesh": mesh, "tagged": tagged, "cells": tagged_cells},
        **{"held": held, "system": model.system(), "modes": dj.modes(model.system(), 1)},
        "simulated": simulated,
        "grain": dj.Orthotropic(
            young=[1e10] * 3,
            poisson=[0.2] * 3,
            shear=[4e9] * 3,
            density=2400.0,
            axes=[[2, 0, 1], [0, 1, 0], [-1, 0, 2]],
        ),
    }


class Own:
    """A law of the user's own, with what it gives in the place of a response or a part of it."""

    def __init__(self, given: Any = None, **parts: Any) -> None:
        self.given, self.parts = given, parts
        self.law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=1e11)
        self.stored_energy, self.closed_stiffness = (
            self.law.stored_energy,
            self.law.closed_stiffness,
        )
        if "stiffness" in parts:
            stiffness = parts.pop("stiffness")
            self.closed_stiffness = lambda: stiffness
        if "internal_variables" in parts:
            self.internal_variables = parts.pop("internal_variables")

    def backward_euler(self, gap: Any, state: Any) -> Any:
        """See the class."""
        if not self.parts:
            return self.given
        answer = self.law.backward_euler(gap, state)
        every = {name: getattr(answer, name) for name in Response.__dataclass_fields__}
        return Response(**{**every, **self.parts})


def simulated(**changes: Any) -> Any:
    """Statics of the two blocks with something else in their model."""
    here = names()
    usual = {"material": here["rock"], "joints": here["law"], "supports": here["held"]}
    return dj.Simulation(dj.Model(here["jointed"], **{**usual, **changes})).statics()


MODEL = {"jointed": "jointed", "material": "rock", "joints": "law"}
NO_LAW = {
    "number": "1e11",
    "text": "'friction'",
    "class": "dj.KeyedJoint",
    "of another kind": "rock",
    "not of every joint": "{}",
    "unknown joint": "{'joint_1': law, 'joint_2': law}",
    "number among laws": "{'joint_1': 1e11}",
}
NO_LOAD = {**NO_LIST, "one load": "dj.Gravity()", "class": "[dj.Gravity]", "not one": "[rock]"}
NO_FORM = {
    **NO_FUNCTION,
    "gives nothing": "lambda u, v: None",
    "gives a number": "lambda u, v: 1.0",
}
GIVES = {
    "gives nothing": "lambda t: None",
    "gives text": "lambda t: 'one'",
    "gives no number": "lambda t: math.nan",
    "gives infinity": "lambda t: math.inf",
    "gives a complex number": "lambda t: 1j",
    "gives several numbers": "lambda t: [1.0, 2.0]",
}
AT_POINTS = {
    "gives nothing": "lambda x: None",
    "gives text": "lambda x: 'deep'",
    "gives too few numbers": "lambda x: np.ones(1)",
    "gives a table": "lambda x: x",
    "gives NaN": "lambda x: np.full(len(x), math.nan)",
}


def each(before: str, values: dict[str, str], after: str) -> dict[str, str]:
    """Bad values within good ones."""
    return {kind: f"{before}{value}{after}" for kind, value in values.items()}


DOORS: tuple[Door, ...] = (
    door(
        "dj.Model",
        MODEL,
        {
            "jointed": {"nothing": "None", "text": "'dam.msh'", "DOLFINx mesh": "jointed.mesh"},
            "material": {
                "nothing": "None",
                "number": "25e9",
                "class": "dj.Elastic",
                "of another kind": "law",
                "empty": "{}",
                "unknown cells": "{'rock': rock}",
                "number among materials": "{'rock': 1.0}",
                "axes out of the plane": "grain",
            },
            "joints": {**NO_LAW, "nothing": "None"},
            "supports": {**NO_LIST, "class": "[dj.Fixed]", "of another kind": "[rock]"},
            "loads": NO_LOAD,
            "damping": {"number": "0.05", "text": "'5 %'", "class": "dj.Rayleigh"},
            "initial_gaps": {
                "number": "1e-3",
                "unknown joint": "{'joint_2': 1e-3}",
                **each("{'joint_1': ", {**NO_NUMBER, **AT_POINTS}, "}"),
            },
            "degree": {
                "zero": "0",
                "too large": "3",
                "not whole": "1.5",
                "text": "'P2'",
                "list": "[1]",
            },
            "quadrature": {
                **without(NO_CHOICE, "number", "nothing"),
                "too small": "1",
                "too large": "21",
            },
            "plane": NO_CHOICE,
            "extra_stiffness": NO_FORM,
            "extra_mass": NO_FORM,
            "extra_damping": NO_FORM,
            "added_mass": {**NO_LIST, "class": "[dj.WestergaardMass]", "of another kind": "[rock]"},
            "symmetric": NO_FLAG,
            "redistribute_mass": NO_FLAG,
        },
        names,
        together={
            "laws without joints": "jointed=whole; joints={'joint_1': law}",
            "gaps without joints": "jointed=whole; joints=None; initial_gaps={'joint_1': 1e-3}",
        },
    ),
    door(
        "simulated",
        {},
        {
            "supports": {
                "unknown group": "[dj.Fixed(group='left')]",
                "not an axis of the plane": "[dj.Fixed(group='base', components='z')]",
                **each("[dj.Prescribed(group='base', component='x', value=", GIVES, ")]"),
            },
            "loads": {
                "an unknown group": "[dj.Pressure(group='left', value=1.0)]",
                "too long in the plane": "[dj.Gravity(acceleration=(0.0, 0.0, -9.81))]",
                "an unknown joint": "[dj.Uplift(joint='joint_2', pressure=1e5)]",
                "temperatures of unknown cells": "[dj.Temperature(value=1.0, reference=0.0, "
                "expansion=1e-5, cells='rock')]",
                "references of unknown cells": "[dj.Temperature(value=1.0, "
                "reference={'rock': 0.0}, expansion=1e-5)]",
                "a temperature that is none": "[dj.Temperature(value=lambda x: x, reference=0.0, "
                "expansion=1e-5)]",
                "no viscous boundary": "[dj.FreeField(groups=['base'], incident=lambda t: (0, 0), "
                "surface=2.0)]",
                "forces of another model": "[dj.SupportForces(reaction=unknown)]",
                **each("[dj.FormLoad(form=", {"gives nothing ": "lambda v: None"}, ")]"),
                **each("[dj.Pressure(group='top', value=1.0, factor=", GIVES, ")]"),
                **{
                    f"uplift {kind}": f"[dj.Uplift(joint='joint_1', pressure={text})]"
                    for kind, text in AT_POINTS.items()
                },
            },
            "added_mass": each(
                "[dj.WestergaardMass(group='top', level=9.0, depth=", AT_POINTS, ")]"
            ),
            "joints": {
                "no response": "Own()",
                "no traction": "Own(traction=None)",
                "traction of a wrong shape": "Own(traction=np.zeros(3))",
                "text for a tangent": "Own(tangent='stiff')",
                "complex dissipation": "Own(dissipation=1j)",
                "no state": "Own(state=None)",
                "stiffness that is none": "Own(stiffness='stiff')",
                "negative stiffness": "Own(stiffness=(-1.0, 1.0))",
                "internal variables without names": "Own(internal_variables=3)",
            },
        },
        names,
        title="Model, once it is simulated",
    ),
    door(
        "dj.Simulation",
        {"model": "model"},
        {
            "model": {
                "nothing": "None",
                "mesh": "jointed",
                "system": "system",
                "class": "dj.Model",
            },
            "monitors": {
                **NO_LIST,
                "class": "[dj.FieldMonitor]",
                "of another kind": "[rock]",
                "nothing in a list": "[None]",
            },
            "newton": {
                "number": "1e-10",
                "class": "dj.SolverOptions",
                "mapping": "{'linear': 'auto'}",
            },
            "solver": NO_CHOICE,
        },
        names,
    ),
    door(
        "new.statics",
        {},
        {
            "steps": AT_LEAST_ONE,
            "loads": {**without(NO_LOAD, "nothing"), "not the model's": "[dj.Gravity()]"},
            "joints": NO_CHOICE,
        },
        names,
        title="Simulation.statics",
    ),
    door(
        "run.statics",
        {},
        {"joints": {"too late": "'free'"}},
        names,
        error=JointsError,
        title="Simulation.statics, after a stage",
    ),
    door(
        "run.grout",
        {},
        {
            "joints": {
                **without(NO_LIST, "nothing"),
                "unknown": "['joint_2']",
                "number among names": "[1]",
            },
            "gap": without(NO_NUMBER, negative="-1e-3"),
        },
        names,
        title="Simulation.grout",
    ),
    door(
        "new.grout",
        {},
        {"joints": {"too early": "None"}},
        names,
        error=JointsError,
        title="Simulation.grout, before any stage",
    ),
    door(
        "new.quasi_statics",
        {},
        {
            "times": {
                "nothing": "None",
                "number": "1.0",
                "text": "'1 s'",
                "empty": "[]",
                "not a number": "[0.0, math.nan]",
                "infinite": "[math.inf]",
                "complex": "[1j]",
                "nested": "[[0.0, 1.0]]",
                "text among numbers": "[0.0, '1']",
            }
        },
        names,
        title="Simulation.quasi_statics",
    ),
    door(
        "run.save_static",
        {},
        {"path": {"nothing": "None", "number": "1", "empty": "''"}},
        names,
        title="Simulation.save_static",
    ),
    door(
        "new.save_static",
        {},
        {"path": {"too early": "'state.h5'"}},
        names,
        error=JointsError,
        title="Simulation.save_static, before any stage",
    ),
    door(
        "new.load_static",
        {},
        {"path": {"nothing": "None", "number": "1", "empty": "''"}},
        names,
        title="Simulation.load_static",
    ),
    door(
        "dj.Simulation(model).load_static",
        {},
        {"path": {"no such file": "'no_such_state.h5'"}},
        names,
        error=CheckpointError,
        title="Simulation.load_static, files",
    ),
    door(
        "new.dynamics",
        {"dt": "1e-3", "steps": "1"},
        {
            "dt": POSITIVE,
            "steps": AT_LEAST_ONE,
            "motion": {
                **NO_FUNCTION,
                **without(GIVES, "gives several numbers"),
                "gives too few numbers": "lambda t: [1.0]",
                "gives NaN": "lambda t: (0.0, math.nan)",
                "gives a table": "lambda t: [[0.0, 0.0]]",
                "fails later": "lambda t: None if t else (0.0, 0.0)",
            },
            "loads": {**NO_LOAD, "unknown group": "[dj.Pressure(group='left', value=1.0)]"},
            "scheme": {"text": "'newmark'", "number": "0.25", "class": "dj.Newmark"},
            "control": {"number": "6", "class": "dj.StepControl", "mapping": "{'landing': True}"},
            "velocity": {"number": "0.0", "array": "np.zeros(16)", "of another model": "unknown"},
            "start": {"number": "0.0", "static state": "run.static"},
            "checkpoint": {"text": "'run.ckpt'", "class": "dj.Checkpoints"},
            "resume": NO_FLAG,
        },
        names,
        together={
            "nothing to go on from": "resume=True",
            "a temperature in a stage": "loads=[dj.Temperature(value=1.0, reference=0.0, "
            "expansion=1e-5)]",
        },
        title="Simulation.dynamics",
    ),
)
