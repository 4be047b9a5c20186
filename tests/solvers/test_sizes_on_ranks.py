# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a rank holds of the joints: its own points, whatever the number of all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from shaken_wall import DT, shaking, wall

import dolfinx_joints as dj
from dolfinx_joints.simulation import simulation as module

pytestmark = pytest.mark.mpi


# Entries of sparse matrices and blocks, which by chance are as many as there are unknowns.
ENTRIES = ("_rows", "_columns", "_sends", "_adds")


def arrays(thing: Any, seen: set[int], path: str) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays that can be reached from an object of this package, with the way to them."""
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        yield path, thing
    elif isinstance(thing, dict):
        for key, value in thing.items():
            yield from arrays(value, seen, f"{path}[{key!r}]")
    elif isinstance(thing, list | tuple | set):
        for i, value in enumerate(thing):
            yield from arrays(value, seen, f"{path}[{i}]")
    elif type(thing).__module__.startswith("dolfinx_joints"):
        for name, value in vars(thing).items() if hasattr(thing, "__dict__") else ():
            if name not in ENTRIES:
                yield from arrays(value, seen, f"{path}.{name}")


@pytest.mark.parametrize("compliance", ["compressed", "matrix-free"])
def test_no_array_of_all_points(comm, read, wall_file, monkeypatch, compliance):
    """After steps with open and sliding points nothing in the solver is as long as all of them."""
    solvers = []

    def made(*arguments: Any, **options: Any) -> Any:
        solvers.append(make_solver(*arguments, **options))
        return solvers[-1]

    make_solver = module.make_solver
    model = wall(read(wall_file()))
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
