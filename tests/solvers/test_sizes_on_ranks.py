# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a rank holds of the joints: its own points, whatever the number of all."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("dolfinx")

from array_sizes import arrays
from shaken_wall import DT, shaking, wall

import dolfinx_joints as dj
from dolfinx_joints.simulation import simulation as module

pytestmark = pytest.mark.mpi


@pytest.mark.parametrize("compliance", ["compressed", "matrix-free"])
def test_no_array_of_all_points(comm, read, wall_file, monkeypatch, compliance):
    """After steps with open and sliding points nothing in the solver is as long as all of them."""
    solvers = []

    def made(*arguments: Any, **options: Any) -> Any:
        solvers.append(make_solver(*arguments, **options))
        return solvers[-1]

    make_solver = module.make_solver
    model = wall(read(wall_file(divisions=(4, 1, 4))))
    simulation = dj.Simulation(model, options=dj.SolverOptions(compliance=compliance))
    simulation.statics()
    monkeypatch.setattr(module, "make_solver", made)
    simulation.dynamics(dt=DT, steps=4, motion=shaking)
    points = model.contact.operator.num_points
    found = list(arrays(solvers[-1], set(), "solver"))
    assert len(found) > 20
    if comm.size > 1:
        # Of vectors (on three ranks a rank's unknowns are as many as all points), and by points.
        lengths = {path: a.shape for path, a in found if 3 * points in a.shape}
        by_points = {p: a.shape for p, a in found if a.shape in ((points, 2), (points, 3))}
        assert not lengths | by_points
