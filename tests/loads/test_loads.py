# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions in space on plane models: x and z act along x and y, nothing else.

Expected: the same with the two numbers (x, z) given by hand, and the mass times them.
"""

import warnings
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx.mesh import CellType, create_rectangle, locate_entities_boundary

import dolfinx_joints as dj
from dolfinx_joints.loads.ground_motion import for_steps, in_axes
from dolfinx_joints.loads.wave_levels import warn_of_sides
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi

MOTION = dj.synthetic_motion(duration=1.0, band=(2.0, 15.0), peaks_g=(0.3, 0.2, 0.1))
SOLID = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)


@pytest.fixture(scope="module")
def block(comm):
    """A plane block of 2 m by 3 m on its ``base``."""
    mesh = create_rectangle(comm, [[0.0, 0.0], [2.0, 3.0]], [2, 3], CellType.quadrilateral)
    return dj.split_mesh(
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

    model = dj.Model(block, material=SOLID, supports=[dj.Fixed(group="base")])
    patterns = dj.BaseMotion(acceleration=MOTION).patterns(model)
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
        run = dj.Simulation(model, monitors=[seen]).dynamics(dt=0.005, steps=40, motion=motion)
        ends.append(run.state.displacement.copy())
        np.testing.assert_allclose(seen.ground[-1], [*MOTION(0.2)[[0, 2]], 0.0], rtol=1e-12)
    ends[0].axpy(-1.0, ends[1])
    assert ends[1].norm() > 0.0
    assert ends[0].norm() == 0.0


@pytest.mark.parametrize("door", ["motion", "differing motion", "load"])
@pytest.mark.parametrize("dt", [0.01, 0.0025])
def test_long_steps_read_no_high_frequency_as_a_low_one(block, recwarn, door, dt):
    """Every 4th sample of a sine of 98 Hz, at 400 samples a second, is one of 2 Hz."""
    time = np.arange(401) / 400
    wave = np.sin(2 * np.pi * 98.0 * time) * np.sin(np.pi * time) ** 2
    motion = dj.Motion(acceleration=np.outer(wave, [1.0, 0.0, 0.0]), dt=1 / 400)
    doors = {"motion": motion, "differing motion": dj.DifferingMotion(motions=motion)}
    given = {"motion": doors.get(door), "loads": [dj.BaseMotion(acceleration=motion)]}
    del given["loads" if door in doors else "motion"]
    model = dj.Model(block, material=SOLID, supports=[dj.Fixed(group="base")])
    none = dj.Motion(acceleration=0.0 * motion.acceleration, dt=motion.dt)
    assert for_steps([none], dt, model.jointed.mesh.comm)[1] == []
    run = dj.Simulation(model).dynamics(dt=dt, steps=60, **given)
    samples = dj.Simulation(model).dynamics(dt=dt, steps=60, motion=lambda t: motion(t))
    sizes = [each.state.displacement.norm() for each in (run, samples)]
    texts = [str(w.message) for w in recwarn if w.category is dj.PlausibilityWarning]
    if dt > motion.dt:
        assert sizes[0] < 1e-3 * sizes[1]
        assert model.jointed.mesh.comm.rank or "'motion' are removed: 100 % of the" in texts[0]
    else:
        assert (sizes[0], texts) == (sizes[1], [])


def test_rising_waves_lose_what_long_steps_do_not_resolve(comm):
    time = np.arange(401) / 400
    low, high = (np.sin(2 * np.pi * f * time) * np.sin(np.pi * time) ** 2 for f in (5.0, 98.0))
    outcrop = dj.Motion(acceleration=np.outer(low + high, [1.0, 0.0, 0.0]), dt=1 / 400)
    field = dj.FreeField(groups=["base"], incident=dj.incident_wave(outcrop), surface=1.0)
    half = pytest.warns(dj.PlausibilityWarning, match="'motion' are removed: 50 % of the")
    with half if comm.rank == 0 else nullcontext():
        ((found,), _) = for_steps([field], 0.01, comm)
    slow = dj.incident_wave(replace(outcrop, acceleration=np.outer(low, [1.0, 0.0, 0.0])))
    # Filtered are 8e-4 of the acceleration at 98 Hz, see test_motion.py: of its velocity as much.
    for t in (0.2, 0.5, 0.53):
        assert found.incident(t)[0] == pytest.approx(slow(t)[0], abs=1e-6)
        assert abs(field.incident(t)[0] - slow(t)[0]) < 1.0 / (2 * np.pi * 98.0)
    assert for_steps([field], 1 / 400, comm)[0][0].incident.outcrop is outcrop


def test_waves_of_a_plane_model(block):
    """The same for waves that rise."""
    wave = dj.incident_wave(MOTION)
    model = dj.Model(block, material=SOLID, supports=[dj.ViscousBoundary(group="base")])
    ends = []
    for incident in (wave, lambda t: wave(t)[[0, 2]]):
        field = dj.FreeField(groups=["base"], incident=incident, surface=3.0)
        run = dj.Simulation(model).dynamics(dt=MOTION.dt, steps=40, loads=[field])
        ends.append(run.state.displacement.copy())
    ends[0].axpy(-1.0, ends[1])
    assert ends[1].norm() > 0.0
    assert ends[0].norm() == 0.0


@pytest.mark.parametrize(("slope", "warned"), [(0.45, False), (0.55, True)])
def test_dashpots_at_the_sides_of_rock(comm, slope, warned):
    """The bottom ends where the horizontal part of a normal exceeds half of the vertical one."""
    mesh = create_rectangle(comm, [[0.0, 0.0], [2.0, 3.0]], [2, 3], CellType.quadrilateral)
    bottom = locate_entities_boundary(mesh, 1, lambda x: x[1] < 1e-9)
    mesh.geometry.x[:, 1] += slope * mesh.geometry.x[:, 0]
    rock = dj.split_mesh(mesh, groups={"bottom": bottom})
    model = dj.Model(rock, material=SOLID, supports=[dj.ViscousBoundary(group="bottom")])
    with warnings.catch_warnings(action="ignore"):
        texts = warn_of_sides(model)
    assert bool(comm.bcast(texts)) == warned


def test_motions_with_too_little(block):
    model = dj.Model(block, material=SOLID, supports=[dj.Fixed(group="base")])
    for wrong in (lambda t: 1.0, lambda t: [1.0], lambda t: "xy"):
        with pytest.raises(ValueError, match="motion.*; it must be .*at least 2 .*numbers"):
            dj.Simulation(model).dynamics(dt=0.01, steps=1, motion=wrong)


def test_an_outcrop_that_ends_in_motion_has_a_warning():
    # A constant acceleration of 0.1 m/s^2 for 2 s ends at its largest velocity, 0.2 m/s.
    offset = dj.Motion(acceleration=np.full((21, 3), 0.1), dt=0.1, name="raw")
    message = r"'raw' ends with a velocity of 0.2 m/s \(100 % of its peak\).*Correct its baseline"
    with pytest.warns(dj.PlausibilityWarning, match=message):
        dj.incident_wave(offset)
    with warnings.catch_warnings(action="error"):
        dj.incident_wave(MOTION)
    with pytest.raises(ValueError, match="outcrop is .* it must be a Motion"):
        dj.incident_wave(lambda t: t)
