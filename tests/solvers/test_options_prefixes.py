# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Each linear solver takes PETSc options under the prefix that the guide names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("dolfinx")

from petsc4py import PETSc
from shaken_wall import DT, shaking, wall

import dolfinx_joints as dj
from dolfinx_joints.simulation.differing_ground import DifferingGround
from dolfinx_joints.solvers import limits

PREFIX = "dolfinx_joints_"
GUIDE = Path(__file__).parents[2] / "docs/guide/solvers.md"


def run(model, **options):
    """Statics and two steps."""
    solver = options.pop("solver", "auto")
    simulation = dj.Simulation(model, solver=solver, options=dj.SolverOptions(**options))
    simulation.statics()
    simulation.dynamics(dt=DT, steps=2, motion=shaking)


def moved_apart(model):
    """Solve for the static part of a ground motion in which a wave passes along the base."""
    passage = dj.Passage(speed=500.0, direction=(1.0, 0.0))
    motion = dj.DifferingMotion(motions=dj.synthetic_motion(duration=2.0), passage=passage)
    ground = DifferingGround(model, motion)
    ground.moving(model.system())
    ground.static_part(1.0)


# What solves with the solver of a prefix.
USES = {
    "bulk": lambda model: run(model, linear="mumps"),
    "bulk by iteration": lambda model: run(model, solver="condensed", linear="iterative"),
    "tangent": lambda model: run(model, solver="monolithic"),
    "tangent by iteration": lambda model: run(model, solver="monolithic", linear="iterative"),
    "tied": lambda model: run(model, solver="monolithic", linear="iterative"),
    "node_blocks": run,
    "acceleration": run,
    "compliance": run,
    "corrections": run,
    "ground": moved_apart,
    "modes_st": lambda model: dj.modes(model.system(), 2),
    "frequency": lambda model: dj.frequency_response(
        model, [1.0], points={"crest": (10.0, 0.0, 20.0)}
    ),
    "temperature": lambda model: dj.steady_temperature(model.jointed, {"base": 4.0, "crest": 8.0}),
}


@pytest.mark.parametrize("use", USES)
def test_the_user_sees_the_solver(use, wall_file, read, capfd, monkeypatch):
    monkeypatch.setattr(limits, "SMALLEST_AT_ONCE", 1)
    monkeypatch.setattr(limits, "NODE_BLOCK_ROWS", 10**6 if use == "node_blocks" else 0)
    name = use.partition(" ")[0]
    kind = "pc" if name in ("node_blocks", "tied", "compliance", "frequency") else "ksp"
    option = f"{PREFIX}{name}_{kind}_view"
    database = PETSc.Options()
    database.setValue(option, "")
    try:
        USES[use](wall(read(wall_file(divisions=(4, 1, 3)))))
        assert database.hasName(option)  # options of the user stay
    finally:
        database.delValue(option)
    assert f"({PREFIX}{name}_)" in capfd.readouterr().out


def test_the_user_sets_the_solver(wall_file, read):
    """An option of the user replaces that of the program."""
    option = f"{PREFIX}bulk_ksp_max_it"
    PETSc.Options().setValue(option, 1)
    try:
        with pytest.raises(dj.JointsError, match="did not converge in 1 iterations"):
            USES["bulk by iteration"](wall(read(wall_file(divisions=(4, 1, 3)))))
    finally:
        PETSc.Options().delValue(option)


def test_the_guide_names_all_prefixes():
    named = set(re.findall(rf"`{PREFIX}(\w+)_`", GUIDE.read_text("utf-8")))
    named = {name.removesuffix("_st") for name in named}
    assert named == {use.partition(" ")[0].removesuffix("_st") for use in USES}
