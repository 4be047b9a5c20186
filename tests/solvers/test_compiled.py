# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled corrections of the joint forces in runs, against those of PETSc's GMRES."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from shaken_wall import JointPath, march, wall

from dolfinx_joints import (
    FrictionNoTension,
    JointsError,
    RigidJoint,
    frictionless,
)
from dolfinx_joints.common.kernels import njit
from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.interface import corrections
from dolfinx_joints.solvers.interface.compiled import products, ranks
from dolfinx_joints.solvers.interface.corrections import CompiledCorrections

STIFF = FrictionNoTension(normal_stiffness=1e13, shear_stiffness=1e13, friction_coefficient=0.3)
SOFT = FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
LAWS = {
    "one": SOFT,
    "one per joint": {
        "joint_1": STIFF,
        "joint_2": SOFT,
        "joint_3": frictionless(normal_stiffness=1e11),
    },
    "rigid": RigidJoint(friction_angle_deg=30.0),
    "rigid, no rebound, and elastic": {
        "joint_1": RigidJoint(friction_angle_deg=20.0, restitution=0),
        "joint_2": SOFT,
        "joint_3": RigidJoint(friction_angle_deg=30.0),
    },
}
# On one rank "auto" is one of the others.
COMPLIANCES = ["dense", "compressed"] + ["auto"] * (MPI.COMM_WORLD.size > 1)


def assert_same(found: JointPath, expected: JointPath) -> None:
    """Compare paths to the tolerance of the iteration."""
    for name in ("gaps", "tractions", "works"):
        one, other = (np.array(getattr(path, name)) for path in (found, expected))
        size = np.abs(other).max(axis=(0, 1))
        assert np.all(np.abs(one - other).max(axis=(0, 1)) <= 1e-8 * size)


@pytest.mark.mpi
@pytest.mark.parametrize("compliance", COMPLIANCES)
@pytest.mark.parametrize("laws", LAWS)
def test_as_with_petsc(comm, wall_file, read, monkeypatch, laws, compliance):
    """To the tolerance of the iteration; with and without W."""
    if compliance == "auto":  # compressed, beside whole rows of S
        monkeypatch.setattr(limits, "LARGEST_DENSE", 10)
    model = wall(read(wall_file(divisions=(8, 2, 3))), joints=LAWS[laws])
    runs = []
    for cost in (limits.COMPLEMENT_COST, 0.0):
        monkeypatch.setattr(limits, "COMPLEMENT_COST", cost)
        runs.append(march(model, compliance=compliance))
    monkeypatch.setattr(CompiledCorrections, "serves", lambda *_: False)
    expected, _, by_petsc = march(model, compliance=compliance)
    for found, _, outcome in runs:
        assert_same(found, expected)
        assert outcome.imbalance <= 1e-10
        assert outcome.iterations <= 1.2 * by_petsc.iterations + 10


@pytest.mark.parametrize("compliance", ["dense", "compressed"])
def test_with_w_from_the_first_step(wall_file, read, monkeypatch, compliance):
    """All compiled parts within a few steps of a few points."""
    model = wall(read(wall_file(divisions=(4, 1, 1))), joints=SOFT)
    monkeypatch.setattr(limits, "COMPLEMENT_COST", 0.0)
    found, _, _ = march(model, steps=3, compliance=compliance)
    monkeypatch.setattr(CompiledCorrections, "serves", lambda *_: False)
    expected, _, _ = march(model, steps=3, compliance=compliance)
    assert_same(found, expected)


def test_no_index_is_beyond_an_array():
    """Compiled loops read and write there without an error; Python does not."""
    case = f"{__file__}::{test_with_w_from_the_first_step.__name__}"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", case],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_points_that_do_not_stick_have_the_room_that_w_needs(wall_file, read, monkeypatch):
    """W may have more entries than S, and then sets of more points are kept whole."""
    made = []
    solve = CompiledCorrections.solve

    def watched(self: Any, *given: Any, **options: Any) -> Any:
        made.append(self)
        return solve(self, *given, **options)

    monkeypatch.setattr(CompiledCorrections, "solve", watched)
    monkeypatch.setattr(limits, "LARGEST_DENSE", 10)
    march(wall(read(wall_file(divisions=(8, 2, 3))), joints=SOFT))
    compiled = made[-1]
    beside = compiled._inner
    tied = beside._replace(entries=1.5 * beside.entries)
    monkeypatch.setattr(corrections, "_blocks_of", lambda *_: tied)
    compiled._memory.avoidable[0] = 1e30  # W pays
    compiled._make_complement()
    assert compiled._memory.has_complement
    changed = compiled._memory.changed
    most = min(len(changed.points), int(np.sqrt(tied.entries) / 3.0))
    assert 9.0 * most**2 > beside.entries
    products.store(tied, changed, np.arange(most), most)
    values = np.ones(3 * most, dtype=np.float32)
    found = np.empty_like(values)
    _called(products.multiply_part, tied, changed, values, found)
    expected = tied.whole[: 3 * most, : 3 * most] @ values
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * np.abs(expected).max())


def _called(function: Any, *arguments: Any) -> Any:
    """What a compiled function gives that only other compiled ones can call."""

    @njit
    def call(*arguments):  # type: ignore[no-untyped-def]
        return function(*arguments)

    return call(*arguments)


@pytest.mark.mpi
def test_errors_of_mpi_are_raised():
    """A negative length is one of MPI's own errors."""

    @njit
    def exchange(every: Any, gone: Any, lengths: Any, come: Any) -> None:
        ranks.exchange(every, gone, lengths, come)

    comm, numbers = MPI.COMM_WORLD, np.zeros(MPI.COMM_WORLD.size)
    wrong = ranks.lengths_of(np.full(comm.size, -8))
    with pytest.raises(JointsError, match="MPI failed"):
        exchange(ranks.ranks_of(comm), numbers, wrong, numbers.copy())
