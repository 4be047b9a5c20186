# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resultants of joints and blocks against statics by hand, and balances that must hold exactly."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from rings import quarter_ring

import dolfinx_joints as dj
from dolfinx_joints.monitors.resultants import JointForces
from dolfinx_joints.postprocessing.joints.resultants import (
    block_resultants,
    joint_resultants,
    resultant_measures,
)
from dolfinx_joints.simulation.monitor import Monitor

pytestmark = pytest.mark.mpi

G, RHO = 9.80665, 2400.0
SOLID = dj.Elastic(young=24e9, poisson=0.2, density=RHO)
MU = math.tan(math.radians(30.0))
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
WEIGHT = RHO * G  # of the upper block of 1 m x 1 m, 1 m high on average


def blocks(jointed, *, law=LAW, loads=(), **options):
    parts = {"material": SOLID, "joints": law, "supports": [dj.Fixed(group="base")]}
    return dj.Model(jointed, loads=[dj.Gravity(), *loads], **parts, **options)


def at_rest(model):
    """Resultants of the only joint under the loads of a model."""
    state = dj.Simulation(model).statics()
    return JointForces(model)(state.joints)["joint_1"]


def file_of(model, path, *, steps=3, motion=None, **options):
    monitor = dj.ResultsMonitor(path, points={"top": (0.5, 0.5, 2.0)}, overwrite=True, **options)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=1e-3, steps=steps, motion=motion)
    model.jointed.mesh.comm.barrier()
    return path


@pytest.mark.parametrize(
    ("cell", "order", "quadrature"), [("hex", 1, "nodal"), ("hex", 1, 4), ("tet", 2, "auto")]
)
def test_block_on_an_incline(blocks_file, read, cell, order, quadrature):
    # N = W cos a, V = W sin a, safety mu / tan a; W acts through the centroid of the upper block,
    # whose moments about the joint's centroid its weight makes: r x W, r from there to the centre.
    # Upper block: 1 m x 1 m, its lower face z = 1 + (x - 1/2) tan a, its top z = 2.
    angle = math.radians(20.0)
    jointed = read(blocks_file(angle=20.0, cell=cell, order=order))
    found = at_rest(blocks(jointed, law=dj.Joints(LAW, quadrature=quadrature)))
    geometry = found.geometry
    assert geometry.area == pytest.approx(1.0 / math.cos(angle), rel=1e-12)
    normal = np.array([-math.sin(angle), 0.0, math.cos(angle)])
    np.testing.assert_allclose(geometry.normal, normal, atol=1e-12)
    np.testing.assert_allclose(geometry.centroid, [0.5, 0.5, 1.0], atol=1e-12)
    size = dict(rel=1e-9)
    np.testing.assert_allclose(found.force, [0.0, 0.0, WEIGHT], atol=1e-8 * WEIGHT)
    assert found.normal_force == pytest.approx(WEIGHT * math.cos(angle), **size)
    assert found.shear_force == pytest.approx(WEIGHT * math.sin(angle), **size)
    assert found.plane_safety == pytest.approx(MU / math.tan(angle), **size)
    # Point by point: less, by the shear that Poisson's ratio makes across the slope.
    assert 0.99 < found.sliding_safety / found.plane_safety < 1.0
    # Height of the upper block over x: 1 - s t, with s = x - 1/2 and t = tan a. Its centre is at
    # s = integral of s (1 - s t) = -t / 12; the joint's force must pass below it.
    lever = -math.tan(angle) / 12.0
    moment = [0.0, -lever * WEIGHT, 0.0]  # that of the joint against r x (0, 0, -W)
    np.testing.assert_allclose(found.moment, moment, atol=1e-8 * WEIGHT)
    # The line of action of N alone: V acts in the plane of the joint and has no moment about y,
    # so N at the distance e along (cos a, 0, sin a) has e N = lever W.
    along = np.array([math.cos(angle), 0.0, math.sin(angle)])
    place = geometry.centroid + lever / math.cos(angle) * along
    np.testing.assert_allclose(found.line_of_action, place, atol=1e-8)


def test_block_on_an_incline_in_the_plane(two_rectangles_file, read):
    # As in space, per metre; moments turn about z, and s2 of the frames is z.
    angle = math.radians(20.0)
    found = at_rest(blocks(read(two_rectangles_file(angle=20.0))))
    np.testing.assert_allclose(found.geometry.centroid, [0.5, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.force, [0.0, WEIGHT, 0.0], atol=1e-8 * WEIGHT)
    assert found.plane_safety == pytest.approx(MU / math.tan(angle), rel=1e-9)
    lever = -math.tan(angle) / 12.0
    np.testing.assert_allclose(found.moment, [0.0, 0.0, lever * WEIGHT], atol=1e-8 * WEIGHT)
    place = np.array([0.5, 1.0, 0.0]) + lever * np.array([1.0, math.tan(angle), 0.0])
    np.testing.assert_allclose(found.line_of_action, place, atol=1e-8)


def test_eccentric_block(blocks_file, read):
    # A level joint and a shear q along x on the top, h = 1 m above it: N = W, V = q A, and the
    # moment q A h about y moves the normal force to x = 1/2 + q A h / W.
    q = 0.1 * WEIGHT
    loads = [dj.Traction(group="top", value=(q, 0.0, 0.0))]
    found = at_rest(blocks(read(blocks_file(angle=0.0)), loads=loads))
    np.testing.assert_allclose(found.force, [-q, 0.0, WEIGHT], atol=1e-8 * WEIGHT)
    np.testing.assert_allclose(found.line_of_action, [0.6, 0.5, 1.0], atol=1e-8)
    assert found.plane_safety == pytest.approx(MU * WEIGHT / q, rel=1e-8)
    assert found.contact == pytest.approx(1.0)  # inside the kern, 1/6 m


def test_cohesion_counts_while_the_bond_is_whole(blocks_file, read, new_path, comm):
    # (mu W + c A) / (q A) on a level joint; the same from the file, with and without its stream.
    q, c = 0.1 * WEIGHT, 2e4
    law = dj.MohrCoulombJoint(
        normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0, cohesion=c
    )
    loads = [dj.Traction(group="top", value=(q, 0.0, 0.0))]
    model = blocks(read(blocks_file(angle=0.0)), law=law, loads=loads)
    expected = (MU * WEIGHT + c) / q
    state = dj.Simulation(model).statics().joints
    forces = JointForces(model)
    whole = forces(state)["joint_1"]
    assert whole.plane_safety == pytest.approx(expected, rel=1e-8)
    state.state.internal[:, 0] = model.operator.points[:, 0] < 0.499  # broken on the left
    half = forces(state)["joint_1"]
    assert half.bond == pytest.approx(0.75 * c, rel=1e-12)  # nodes at x = 0, 1/2, 1 of 1 m
    assert half.plane_safety == pytest.approx((MU * WEIGHT + 0.75 * c) / q, rel=1e-8)
    for resultants in (False, True):
        path = file_of(model, new_path("bond.h5"), resultants=resultants, every=1)
        if comm.rank == 0:
            with dj.Results(path) as results:
                found = joint_resultants(results, "joint_1")
                assert found.bond == pytest.approx(np.full(4, c), rel=1e-12)
                assert found.plane_safety[0] == pytest.approx(expected, rel=1e-8)
                assert found.sliding_safety[0] == pytest.approx(whole.sliding_safety, rel=1e-8)


def test_a_law_without_limit_has_no_safety(blocks_file, read, new_path, comm):
    law = dj.KeyedJoint(normal_stiffness=1e11, shear_stiffness=4e10)
    path = file_of(blocks(read(blocks_file(angle=20.0)), law=law), new_path("keyed.h5"))
    if comm.rank == 0:
        with dj.Results(path) as results:
            assert np.isnan(joint_resultants(results, "joint_1").sliding_safety).all()
            measures = resultant_measures(results)["joint_1"]
            assert math.isnan(measures["safety_min"])
            assert math.isnan(measures["safety_time"])
            given = joint_resultants(results, "joint_1", friction_angle_deg=30.0)
            expected = MU / math.tan(math.radians(20.0))
            assert given.plane_safety[0] == pytest.approx(expected, rel=1e-8)


def test_effective_and_total_forces_with_uplift(blocks_file, read, new_path, comm):
    # A uniform pore pressure p on the whole joint: water p A along n, effective N = W - p A, and
    # both together W, as without water.
    p = 0.4 * WEIGHT
    model = blocks(read(blocks_file(angle=0.0)), loads=[dj.Uplift(joint="joint_1", pressure=p)])
    path = file_of(model, new_path("uplift.h5"), every=1, resultants=True)
    plain = file_of(model, new_path("states.h5"), every=1)
    if comm.rank != 0:
        return
    for file in (path, plain):
        with dj.Results(file) as results:
            found = joint_resultants(results, "joint_1")
        assert len(found.time) == 4
        up = np.array([0.0, 0.0, WEIGHT])
        tolerance = {"atol": 1e-7 * WEIGHT}
        for record in range(4):
            np.testing.assert_allclose(found.water_force[record], 0.4 * up, **tolerance)
            np.testing.assert_allclose(found.force[record], 0.6 * up, **tolerance)
            np.testing.assert_allclose(found.total_force[record], up, **tolerance)
            np.testing.assert_allclose(found.total_moment[record], 0.0, **tolerance)
    with dj.Results(path) as results:
        each = block_resultants(results)
    assert each.mass == pytest.approx([RHO, RHO])
    np.testing.assert_allclose(each.total_force[0], [-up, up], **tolerance)


@pytest.mark.filterwarnings("ignore:Loads are applied suddenly")
@pytest.mark.filterwarnings("ignore:The estimated error of a single step")  # hardly anything moves
def test_water_that_comes_in_the_stage(blocks_file, read, new_path, comm):
    # Uplift among the loads of the stage, p t / 3 ms: the water's force grows with it. Water by the
    # opening has its closed pressure where nothing opens.
    p = 0.1 * WEIGHT
    water = dj.JointWater(joint="joint_1", level=50.0, closed=p)
    uplift = dj.Uplift(joint="joint_1", pressure=p, factor=lambda t: t / 3e-3)
    path = new_path("stage.h5")
    model = blocks(read(blocks_file(angle=0.0)))
    monitor = dj.ResultsMonitor(path, points={"top": (0.5, 0.5, 2.0)}, resultants=True, every=1)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=1e-3, steps=3, loads=[uplift, water])
    comm.barrier()
    if comm.rank == 0:
        with dj.Results(path) as results:
            found = joint_resultants(results, "joint_1")
            stored = results.series("states", "joints/joint_1/pressure")
        expected = p * (1.0 + np.arange(4) / 3.0)
        np.testing.assert_allclose(found.water_force[:, 2], expected, rtol=1e-12)
        np.testing.assert_allclose(stored, np.tile(expected[:, None], stored.shape[1]), rtol=1e-12)


def shaking(time):
    """A ground acceleration that slides the blocks and opens joints, [m/s^2]."""
    return 12.0 * np.sin(2 * np.pi * np.array([23.0, 29.0, 31.0]) * time + [0.0, 0.7, 1.9])


class Momenta(Monitor):
    """Momentum of the nodes above a level in each record."""

    def __init__(self, place):
        self.place, self.found = place, []

    def start(self, model, stage, steps, first):
        owned = first.velocity.getLocalSize() // 3
        points = model.V.tabulate_dof_coordinates()[:owned]
        self.here, self.model = self.place(points), model
        self.record(first)

    def record(self, record):
        moved = (self.model.mass * record.velocity).getArray().reshape(-1, 3)
        comm = self.model.jointed.mesh.comm
        self.found.append(np.sum(comm.allgather(moved[self.here].sum(axis=0)), axis=0))


def test_blocks_are_in_balance_at_every_step(wall_file, read, new_path, comm):
    # Cantilevers between vertical joints, base held: of the whole wall, the joints' forces cancel.
    # A free block: joint forces + weight - M a_ground = d(M v)/dt, each over the step; forces of
    # the default scheme and of the record are those of the step, loads the mean of its ends.
    model = blocks(read(wall_file()))
    path = new_path("wall.h5")
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 0.0, 20.0)}, resultants=True, every=2)
    seen = Momenta(lambda x: np.ones(len(x), dtype=bool))
    simulation = dj.Simulation(model, monitors=[monitor, seen])
    simulation.statics()
    simulation.dynamics(dt=4e-3, steps=6, motion=lambda t: shaking(t / 10))
    comm.barrier()
    if comm.rank != 0:
        return
    with dj.Results(path) as results:
        found = block_resultants(results)
        joints = {name: joint_resultants(results, name) for name in results.joints}
        reaction = results.series("histories", "reaction/base")
        ground = results.series("histories", "ground_acceleration")
        sides = [results.static(f"joints/{name}/blocks") for name in results.joints]
        traction = results.series("states", "joints/joint_2/traction")
        areas = results.static("joints/joint_2/areas")
        frames = results.static("joints/joint_2/frames")
    at = [np.unique(side, axis=0) for side in sides]
    mass = RHO * 20.0 * 4.0 * 20.0
    assert found.mass.sum() == pytest.approx(mass)
    assert len(found.mass) == 4
    assert [len(each) for each in at] == [1, 1, 1]
    size = np.abs(found.force).max()
    np.testing.assert_allclose(found.force.sum(axis=1), 0.0, atol=1e-12 * size)
    # Each inner block has a joint on either side.
    total = np.zeros_like(found.force)
    for (row,), one in zip(at, joints.values(), strict=True):
        total[:, row[0]] -= one.force
        total[:, row[1]] += one.force
    np.testing.assert_allclose(found.force, total, atol=1e-12 * size)
    # Moments about each block's centre: those about the joints' centroids, moved.
    turned = np.zeros_like(found.moment)
    for (row,), one in zip(at, joints.values(), strict=True):
        for block, sign in ((row[0], -1.0), (row[1], 1.0)):
            arm = one.geometry.centroid - found.centre[block]
            turned[:, block] += sign * (one.moment + np.cross(arm, one.force))
    np.testing.assert_allclose(found.moment, turned, atol=1e-10 * np.abs(turned).max())
    # The whole body.
    rate = np.diff(seen.found, axis=0) / 4e-3
    drive = reaction[1:] - mass * (np.array([0.0, 0.0, G]) + 0.5 * (ground[1:] + ground[:-1]))
    np.testing.assert_allclose(rate, drive, atol=1e-8 * mass * G)
    # The tractions stored every other step have the same sums, written out here.
    other = -sum(
        w * t @ axes for w, t, axes in zip(areas, traction.swapaxes(0, 1), frames, strict=True)
    )
    np.testing.assert_allclose(joints["joint_2"].force[::2], other, atol=1e-12 * size)


def test_a_free_block_accelerates_by_its_joint_alone(blocks_file, read, new_path, comm):
    # The upper block touches nothing but the joint and water in it: joint + water + weight - M a_g
    # is the rate of its momentum in each step, also while it slides.
    jointed = read(blocks_file(angle=20.0))
    model = blocks(jointed, loads=[dj.Uplift(joint="joint_1", pressure=0.2 * WEIGHT)])
    path = new_path("free.h5")
    monitor = dj.ResultsMonitor(path, points={"top": (0.5, 0.5, 2.0)}, resultants=True)
    seen = Momenta(lambda x: _upper(model, len(x)))
    simulation = dj.Simulation(model, monitors=[monitor, seen])
    simulation.statics()
    outcome = simulation.dynamics(dt=1e-3, steps=20, motion=shaking)
    comm.barrier()
    assert outcome.energy_error < 1e-10
    if comm.rank != 0:
        return
    with dj.Results(path) as results:
        found = block_resultants(results)
        ground = results.series("histories", "ground_acceleration")
        slip = results.series("histories", "joint_slip")
    assert slip.max() > 0.0
    number = int(np.argmax(found.centre[:, 2]))
    assert found.mass[number] == pytest.approx(RHO, rel=1e-12)
    lean = math.tan(math.radians(20.0)) / 12.0
    assert found.centre[number, 0] == pytest.approx(0.5 - lean, rel=1e-12)
    rate = np.diff(seen.found, axis=0) / 1e-3
    drive = found.total_force[1:, number] - RHO * (
        np.array([0.0, 0.0, G]) + 0.5 * (ground[1:] + ground[:-1])
    )
    assert np.abs(rate).max() > WEIGHT / 10
    np.testing.assert_allclose(rate, drive, atol=1e-8 * WEIGHT)


def _upper(model, owned):
    """Which owned nodes belong to cells of the upper block."""
    nodes = np.unique(model.V.dofmap.list[model.jointed.cells("upper")])
    return nodes[nodes < owned]


def test_a_body_without_joints_has_no_resultants(blocks_file, read, new_path):
    jointed = read(blocks_file(angle=20.0), joints=[])
    model = dj.Model(jointed, material=SOLID, supports=[dj.Fixed(group="base")])
    monitor = dj.ResultsMonitor(
        new_path("whole.h5"), points={"top": (0.5, 0.5, 2.0)}, resultants=True
    )
    with pytest.raises(
        dj.MeshError, match="resultants=True records forces of joints; the model has"
    ):
        dj.Simulation(model, monitors=[monitor])  # before anything is solved
    with pytest.raises(dj.MeshError, match="no resultants of joints"):
        JointForces(model)


def test_a_curved_joint_is_safe_point_by_point(comm):
    # A quarter of a cylinder pressed by p and sheared by s to and fro around it. Safety: mu p / s.
    # The mean of the normal over a right angle is 2 sqrt(2) / pi of 1, 0.90: no plane joint.
    jointed = dj.mesh_from_arrays(comm, **quarter_ring("hexahedron", 2))
    fixed = [dj.Fixed(group="outside")]
    model = dj.Model(
        jointed, material=SOLID, joints=dj.Joints(LAW, quadrature="gauss"), supports=fixed
    )
    joints = dj.Simulation(model).statics().joints
    shear = 1e6 * np.sign(model.operator.points[:, 0] - 1.0)
    traction = np.column_stack([np.full(len(shear), -3e6), shear, np.zeros_like(shear)])
    found = JointForces(model)(replace(joints, traction=traction))["joint"]
    assert found.sliding_safety == pytest.approx(3.0 * MU, rel=1e-12)
    assert found.geometry.flatness == pytest.approx(2.0 * math.sqrt(2.0) / math.pi, rel=1e-3)
    assert "curved (flatness 0.90)" in found.geometry.warning
    assert np.isnan(found.plane_safety)
