# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions in space on plane models: x and z act along x and y, nothing else.

Expected: the same with the two numbers (x, z) given by hand, and the mass times them.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx.mesh import CellType, create_rectangle, locate_entities_boundary

from dolfinx_joints import (
    BaseMotion,
    Elastic,
    Fixed,
    FreeField,
    Model,
    Simulation,
    ViscousBoundary,
    incident_wave,
    split_mesh,
    synthetic_motion,
)
from dolfinx_joints.loads.ground_motion import in_axes
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi

MOTION = synthetic_motion(duration=1.0, band=(2.0, 15.0), peaks_g=(0.3, 0.2, 0.1))
SOLID = Elastic(young=24e9, poisson=0.2, density=2400.0)


@pytest.fixture(scope="module")
def block(comm):
    """A plane block of 2 m by 3 m on its ``base``."""
    mesh = create_rectangle(comm, [[0.0, 0.0], [2.0, 3.0]], [2, 3], CellType.quadrilateral)
    return split_mesh(
        mesh, groups={"base": locate_entities_boundary(mesh, 1, lambda x: x[1] < 1e-9)}
    )


def test_components():
    assert list(in_axes(lambda t: (1.0, 2.0, 3.0), 2)(0.0)) == [1.0, 3.0]
    assert list(in_axes(lambda t: (1.0, 3.0), 2)(0.0)) == [1.0, 3.0]
    assert list(in_axes(MOTION, 3)(0.01)) == list(MOTION(0.01))


def test_ground_motion_of_a_plane_model(block):
    """F = -M iota a_g with the vertical component upwards; monitors see what acted."""

    class Seen(Monitor):
        def start(self, model, stage, steps, first):
            self.ground = []

        def record(self, record):
            self.ground.append(record.ground_acceleration)

    model = Model(block, material=SOLID, supports=[Fixed(group="base")])
    patterns = BaseMotion(acceleration=MOTION).patterns(model)
    mass = 2400.0 * 2.0 * 3.0
    for axis, component in ((0, 0), (1, 2)):
        pattern, factor = patterns[axis]
        along = pattern.duplicate()
        along.setArray(np.tile(np.eye(2)[axis], along.getLocalSize() // 2))
        force = pattern.dot(along) * factor(0.35)
        assert force == pytest.approx(-mass * MOTION(0.35)[component], rel=1e-12)
    ends = []
    for motion in (MOTION, lambda t: MOTION(t)[[0, 2]]):
        seen = Seen()
        run = Simulation(model, monitors=[seen]).dynamics(dt=0.01, steps=20, motion=motion)
        ends.append(run.state.displacement.copy())
        np.testing.assert_allclose(seen.ground[-1], [*MOTION(0.2)[[0, 2]], 0.0], rtol=1e-12)
    ends[0].axpy(-1.0, ends[1])
    assert ends[1].norm() > 0.0
    assert ends[0].norm() == 0.0


def test_waves_of_a_plane_model(block):
    """The same for waves that rise."""
    wave = incident_wave(MOTION)
    model = Model(block, material=SOLID, supports=[ViscousBoundary(group="base")])
    ends = []
    for incident in (wave, lambda t: wave(t)[[0, 2]]):
        field = FreeField(groups=["base"], incident=incident, surface=3.0)
        run = Simulation(model).dynamics(dt=0.01, steps=20, loads=[field])
        ends.append(run.state.displacement.copy())
    ends[0].axpy(-1.0, ends[1])
    assert ends[1].norm() > 0.0
    assert ends[0].norm() == 0.0


def test_motions_with_too_little(block):
    model = Model(block, material=SOLID, supports=[Fixed(group="base")])
    for wrong in (lambda t: 1.0, lambda t: [1.0], lambda t: "xy"):
        with pytest.raises(ValueError, match="motion.*; it must be .*at least 2 .*numbers"):
            Simulation(model).dynamics(dt=0.01, steps=1, motion=wrong)
