# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The warning that slip or opening is no longer small against the elements."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import (
    Elastic,
    Fixed,
    FrictionNoTension,
    Joints,
    MatrixSystem,
    Model,
    Prescribed,
    Simulation,
)
from dolfinx_joints.joints.small_displacements import SmallDisplacements

pytestmark = pytest.mark.mpi

EDGE = 0.5  # of the cubes around a level joint [m]


def messages(comm, act):
    """What a rank 0 is warned of while ``act`` runs, on all ranks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        act()
    return comm.bcast([str(w.message) for w in caught], root=0)


@pytest.fixture
def sheared(blocks_file, read):
    """Two blocks, the upper driven along x by 1 m per unit of time, or lifted."""

    def make(component, gap=0.0):
        jointed = read(blocks_file(angle=0.0, size=EDGE))
        rest = "xyz".replace(component, "")
        return Model(
            jointed,
            material=Elastic(young=1e9, poisson=0.0, density=2400.0),
            joints=Joints(
                FrictionNoTension(
                    normal_stiffness=1e9, shear_stiffness=1e9, friction_angle_deg=0.0
                ),
                initial_gaps={"joint_1": gap},
            ),
            supports=[
                Fixed(group="base"),
                Fixed(group="top", components=rest),
                Prescribed(group="top", component=component, value=lambda time: time),
            ],
        )

    return make


@pytest.mark.parametrize(("component", "what"), [("x", "slip"), ("z", "opening")])
def test_statics_warn_once_of_each_joint(sheared, comm, component, what):
    """The edge is 0.5 m: 0.04 m are 8 %, 0.06 m are 12 % (0.12 % of it are the blocks' shear)."""
    simulation = Simulation(sheared(component, gap=1e-9))
    assert messages(comm, lambda: simulation.quasi_statics([0.02, 0.04])) == []
    (text,) = messages(comm, lambda: simulation.quasi_statics([0.06]))
    assert text.startswith(
        "Joint 'joint_1': slip or opening reached 12 % of the element size in a "
    )
    assert messages(comm, lambda: simulation.quasi_statics([0.08])) == [], what


def test_an_initial_gap_is_no_displacement(sheared, comm):
    simulation = Simulation(sheared("x", gap=1.0))
    assert messages(comm, lambda: simulation.quasi_statics([0.01])) == []


def test_dynamics_say_when(sheared, comm):
    """The upper block moves off at 1 m/s and has gone 0.1 m, 20 %, in ten steps of 0.01 s."""
    simulation = Simulation(sheared("x", gap=1e-9))
    (text,) = messages(comm, lambda: simulation.dynamics(dt=0.01, steps=12))
    assert "of the element size by t = 0.1 s. Joint points keep their initial partners" in text


def test_sizes_are_the_shortest_edges(sheared, comm):
    operator = sheared("x").operator
    sizes = operator.gather(operator.sizes)
    if comm.rank == 0:
        np.testing.assert_allclose(sizes, EDGE, rtol=1e-12)


def test_plain_matrices_are_not_watched(comm):
    law = FrictionNoTension(normal_stiffness=1.0, shear_stiffness=1.0, friction_angle_deg=0.0)
    system = MatrixSystem.from_arrays(
        mass=[[1.0]], stiffness=[[1.0]], gap=[[1.0], [0.0], [0.0]], law=law
    )
    watch = SmallDisplacements(system.contact)
    watch.record(np.full((1, 3), 1e3))
    assert messages(comm, lambda: watch.warn("now")) == []
