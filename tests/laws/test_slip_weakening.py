# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A law of the user with a compiled point: exact on a point, and in models as any other law."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import shaken_wall
from shaken_wall import DT, Killed, Killer, swaying
from slip_weakening import SlipWeakening

import dolfinx_joints as dj
from dolfinx_joints.laws.law import JointState

LAW = SlipWeakening(
    normal_stiffness=1e11,
    shear_stiffness=4e10,
    static_friction=0.6,
    residual_friction=0.2,
    distance=2e-5,
)


def test_strength_falls_from_the_static_to_the_residual_one():
    """Pushed at constant pressure p: |t| = p (0.2 + 0.4 exp(-s/d)) with s of the steps before."""
    gap, pressure = np.array([[-1e-5, 0.0, 0.0]]), 1e6
    state = JointState.at_rest(gap, variables=1)
    for _ in range(60):
        gap = gap + np.array([0.0, 1.2e-6, 1.6e-6])  # along (0.6, 0.8)
        before = state.internal[0, 0]
        answer = LAW.backward_euler(gap, state)
        state = answer.state
        if answer.status[0] == 2:
            strength = pressure * (0.2 + 0.4 * np.exp(-before / 2e-5))
            np.testing.assert_allclose(answer.traction[0, 1:], strength * np.array([0.6, 0.8]))
    path = np.linalg.norm(gap[0, 1:])
    assert state.internal[0, 0] == pytest.approx(path - np.linalg.norm(state.elastic_slip))
    assert strength == pytest.approx(0.2 * pressure, rel=1e-2)


def blocks(comm):
    """Two blocks of 4 m x 1 m in a plane, one on the other."""
    nx, ny = 8, 4
    x, y = np.meshgrid(np.linspace(0.0, 4.0, nx + 1), np.linspace(0.0, 2.0, ny + 1))
    node = np.arange(x.size).reshape(ny + 1, nx + 1)
    cells = [node[j : j + 2, i : i + 2].ravel() for j in range(ny) for i in range(nx)]
    edges = {
        name: np.column_stack([node[j, :-1], node[j, 1:]])
        for name, j in (("base", 0), ("joint", ny // 2))
    }
    given = {"x": np.column_stack([x.ravel(), y.ravel()]), "cells": cells, "facet_groups": edges}
    return dj.mesh_from_arrays(comm, cell="quadrilateral", **given)


@pytest.fixture(params=["plane", "wall"])
def model(request, wall_file, read):
    """Makes a model of either."""

    def make(on=None):
        if request.param == "plane":
            return shaken_wall.wall(blocks(on or MPI.COMM_WORLD), LAW)
        return shaken_wall.wall(read(wall_file(divisions=(8, 2, 3)), on), LAW)

    return make


def march(model, steps=30, solver="auto", killed=None, **options):
    """Self weight and some steps."""
    accurate = dj.SolverOptions(relative_tolerance=1e-12)
    monitors = [Killer(killed)]
    simulation = dj.Simulation(model, options=accurate, solver=solver, monitors=monitors)
    if not ("checkpoint" in options and options["checkpoint"].resume):
        simulation.statics()
    return simulation.dynamics(dt=DT, steps=steps, motion=lambda t: 2.0 * swaying(t), **options)


def slips(outcome, model):
    """Slip of all points, on rank 0."""
    return model.operator.gather(outcome.state.joints.state.internal[:, 0])


@pytest.mark.mpi
def test_it_runs_on_the_condensed_solver_and_on_any_ranks(comm, model):
    spread, alone, held = model(), model(MPI.COMM_SELF), model(MPI.COMM_SELF)
    one, two = march(spread), march(alone)
    three = march(held, solver="monolithic")
    assert (one.solver, three.solver) == ("condensed", "monolithic")
    size = slips(two, alone).max()
    assert size > 5e-6  # some friction is lost
    np.testing.assert_allclose(slips(two, alone), slips(three, held), rtol=0, atol=1e-7 * size)
    found = slips(one, spread)
    if comm.rank == 0:
        assert found.max() == pytest.approx(size, rel=1e-7)


def test_a_continued_run_has_the_same_bits(model, tmp_path):
    path, steps = tmp_path / "run.ckpt", 20
    whole = march(model(), steps=steps)
    with pytest.raises(Killed):
        march(model(), steps=steps, killed=15, checkpoint=dj.Checkpoints(path, every=10))
    resumed = march(model(), steps=steps, checkpoint=dj.Checkpoints(path, resume=True))
    for name in ("gap", "elastic_slip", "internal"):
        expected, found = (getattr(o.state.joints.state, name) for o in (whole, resumed))
        np.testing.assert_array_equal(found, expected)
