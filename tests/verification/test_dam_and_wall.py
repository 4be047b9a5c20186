# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The models of the demos and benchmarks at full size; minutes, hence slow.

    dam                      wall
    ___________________      | | | | |   20 m
    \\  | | | | | | |  /      | | | | |
     \\ | | | | | | | /       |_|_|_|_|
      \\|_|_|_|_|_|_|/        base clamped, shaken along all axes

Expected: the published frequencies that the dam's shape was fitted to (5.00 Hz antisymmetric, 5.23
Hz symmetric); crest peaks of the wall without joints that independent programs gave; equality of
the condensed solver and the monolithic Newton, which solve the same equations.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import dolfinx_joints as dj
from benchmarks.jointed_wall import measure
from benchmarks.shared.scenes import wall
from dolfinx_joints.geometry.ambiesta import ambiesta

pytestmark = pytest.mark.slow


def dam(mesh, joints=None):
    """The dam of demo 03."""
    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30)
    return dj.Model(
        dj.read_msh(mesh, MPI.COMM_WORLD, joints=joints),
        material=dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0),
        joints=law if joints is None else None,
        supports=[dj.Fixed(group="base"), dj.Fixed(group="abutments")],
        loads=[dj.Gravity()],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
    )


@pytest.mark.parametrize(
    ("cell", "size", "layers"), [("hex", 8, 1), ("hex", 5.5, 1), ("hex", 4, 2), ("tet", 4, 1)]
)
def test_frequencies_of_the_dam(tmp_path, cell, size, layers):
    mesh = ambiesta(tmp_path / "dam.msh", size=size, cell=cell, layers=layers)
    frequencies = dj.modes(dam(mesh, joints=[]).system(), 2).frequencies
    assert frequencies == pytest.approx([5.00, 5.23], rel=0.01)


def test_both_solvers_on_the_dam(tmp_path):
    # From the same static state over 50 steps of the strong part of the motion.
    mesh = ambiesta(tmp_path / "dam.msh", size=5.5)
    motion = dj.synthetic_motion().trimmed(1.0, start=3.0)
    model, ends = dam(mesh), []
    for solver in ("condensed", "monolithic"):
        run = dj.Simulation(
            model, solver=solver, options=dj.SolverOptions(relative_tolerance=1e-12)
        )
        run.statics(steps=4)
        ends.append(run.dynamics(dt=0.00488, steps=50, motion=motion).state.displacement)
    change = ends[0].copy()
    change.axpy(-1.0, ends[1])
    assert change.norm(3) < 1e-8 * ends[1].norm(3)


def test_the_jointed_wall_completes_on_both_paths():
    # `measure` compares the tied peaks with those of independent programs itself.
    rows = [measure(wall("coarse"), 200, solver=solver) for solver in ("condensed", "monolithic")]
    assert [row["accepted"] for row in rows] == [200, 200]
    np.testing.assert_allclose(rows[0]["joint_peaks_mm"], rows[1]["joint_peaks_mm"], rtol=1e-6)
    assert max(row["energy_error"] for row in rows) < 0.04
