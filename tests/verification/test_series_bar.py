# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A joint in series with an elastic bar: sigma = -(dx - gap) / (1/k_n + L/E) once the gap is shut.

The bar, two blocks of half its length each, is held at its base and driven at its top. Without
lateral strain (nu = 0) the stress is uniform and linear elements hold the solution exactly: what is
left is rounding.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from dolfinx_joints import (
    Elastic,
    Fixed,
    FrictionNoTension,
    Model,
    Prescribed,
    Simulation,
    read_msh,
)
from dolfinx_joints.parallel import on_root
from geometry.two_blocks import two_blocks

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
LENGTH, SIDE, YOUNG = 2.0, 0.5, 30e9  # m, m, Pa
PUSH = 1e-3  # m of shortening at time 1
ELEMENTS = [("hex", 1), ("hex", 2), ("tet", 1), ("tet", 2)]


def bar(cell, order):
    """The mesh; rank 0 alone writes and reads the file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bar.msh"
        sizes = {"length": SIDE, "width": SIDE, "size": SIDE / 2}
        heights = {"lower_height": LENGTH / 2, "upper_height": LENGTH / 2}
        on_root(COMM, lambda: two_blocks(path, **sizes, **heights, order=order, cell=cell))
        return read_msh(path, COMM)


def simulation(cell, order, k_n, gap):
    """The top goes down by ``PUSH`` per unit of time."""
    model = Model(
        bar(cell, order),
        material=Elastic(young=YOUNG, poisson=0.0, density=0.0),
        joints=FrictionNoTension(
            normal_stiffness=k_n, shear_stiffness=0.4 * k_n, friction_angle_deg=30.0
        ),
        initial_gaps={"joint_1": gap},
        supports=[
            Fixed(group="base"),
            Fixed(group="top", components="xy"),
            Prescribed(group="top", component="z", value=lambda time: -PUSH * time),
        ],
    )
    return Simulation(model)


def stress(k_n, gap, time):
    """The exact stress [Pa]."""
    return -max(PUSH * time - gap, 0.0) / (1.0 / k_n + LENGTH / YOUNG)


def largest(values):
    """Largest absolute value on all ranks."""
    return COMM.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


def check(state, expected, scale):
    """Tractions of every point and the forces of the supports, relative to a stress [Pa]."""
    expected_traction = np.array([expected, 0.0, 0.0])
    assert largest(state.joints.traction - expected_traction) < 1e-9 * scale
    vertical = state.reaction.getArray(readonly=True)[2::3]
    area = SIDE**2
    pushed = COMM.allreduce(float(np.abs(vertical).sum()))  # base and top push against each other
    assert pushed == pytest.approx(2.0 * area * abs(expected), rel=1e-8, abs=1e-8 * area * scale)


@pytest.mark.parametrize("k_n", [1e8, 1e11, 1e14])
@pytest.mark.parametrize(("cell", "order"), ELEMENTS)
def test_stress_without_a_gap(cell, order, k_n):
    state = simulation(cell, order, k_n, 0.0).quasi_statics([1.0])
    expected = stress(k_n, 0.0, 1.0)
    check(state, expected, abs(expected))


@pytest.mark.parametrize(("cell", "order"), ELEMENTS)
def test_stress_with_an_initial_gap(cell, order):
    """Pushed until it touches, beyond, back until it opens, and pulled."""
    k_n, gap = 1e11, 4e-4
    run = simulation(cell, order, k_n, gap)
    for time in (0.3, 0.5, 1.0, 0.7, 0.2, -0.5):
        expected = stress(k_n, gap, time)
        assert (expected < 0.0) == (PUSH * time > gap)
        check(run.quasi_statics([time]), expected, abs(stress(k_n, gap, 1.0)))


def test_numbers_by_hand():
    """1 mm on 1/k_n + L/E = 1e-11 + 2/30e9 = 7.6667e-11 m/Pa: 13.0435 MPa; with 0.4 mm, 7.82609."""
    assert stress(1e11, 0.0, 1.0) == pytest.approx(-13.0435e6, rel=1e-5)
    assert stress(1e11, 4e-4, 1.0) == pytest.approx(-7.82609e6, rel=1e-5)
