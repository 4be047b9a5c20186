# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sliding of a shaken block on one and on two planes, against a rigid block and limit equilibrium.

 ______
|   ___|   block, 30 degrees of friction
|__/ __|   plane at 20 degrees
|_/____|
////////   <- ground
"""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI

import gmsh
from boxes import box

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.exact import SlidingWedge, WedgePlane
from dolfinx_joints.geometry.from_step import from_step
from dolfinx_joints.geometry.meshing import gmsh_model
from dolfinx_joints.geometry.two_blocks import two_blocks
from dolfinx_joints.geometry.wedge import wedge
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants

# The slips are not small, as in the problem. The block has no accelerations above 20 Hz.
pytestmark = [
    pytest.mark.filterwarnings("ignore:Joint .* slip or opening"),
    pytest.mark.filterwarnings("ignore:.*accelerations are shown up to"),
]

GRAVITY = np.array([0.0, 0.0, -9.80665])
ROCK = dj.Elastic(young=30e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=4e9, friction_angle_deg=30.0)
MU = math.tan(math.radians(30.0))
DAMPING = dj.Rayleigh(stiffness_factor=2e-4)
DT = 5e-3
ANGLE = 20.0  # of the single plane [degrees]


def half_sine(time):
    """4 m/s^2 for half a second."""
    return (4.0 * math.sin(2.0 * math.pi * time) if time < 0.5 else 0.0), 0.0, 0.0


def along_valley(time):
    """2 m/s^2 across the stream."""
    return 0.0, 0.5 * half_sine(time)[0], 0.0


def half_sine_across(time):
    """8 m/s^2 across the stream."""
    return 0.0, 2.0 * half_sine(time)[0], 0.0


def rigid_slip(motion, normals, along, end, friction=MU):
    """Integrate a rigid block of unit mass in steps of 0.1 ms, with normal forces N(t) [m]."""
    dt, velocity, slip = 1e-4, 0.0, 0.0
    for k in range(round(end / dt)):
        force = GRAVITY - np.array(motion((k + 0.5) * dt))
        across = force - (force @ along) * along
        if len(normals) == 1:
            strength = friction * max(-across @ normals[0], 0.0)
        else:  # two unknowns in the plane across the line
            strength = (
                friction * np.maximum(np.linalg.lstsq(np.array(normals).T, -across)[0], 0.0).sum()
            )
        velocity = max(0.0, velocity + dt * (force @ along - strength))
        slip += dt * velocity
    return slip


def run(model, path, motion, end, names):
    """Self weight and motion; return the results."""
    facts = {"sliding": {"block": names}}
    points = {"lowest": min(model.jointed.mesh.geometry.x, key=lambda x: x[2])}
    options = {"resultants": True, "metadata": facts, "overwrite": True, "every": 20}
    simulation = dj.Simulation(model, monitors=[dj.ResultsMonitor(path, points=points, **options)])
    simulation.statics()
    simulation.dynamics(dt=DT, steps=round(end / DT), motion=motion)
    return dj.Results(path)


@pytest.fixture(scope="module")
def on_plane():
    sizes = {"length": 2.0, "lower_height": 0.6, "upper_height": 0.6, "size": 0.5, "angle": ANGLE}
    return dj.Model(
        mesh_of(two_blocks, **sizes),
        material=ROCK,
        joints=LAW,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        damping=DAMPING,
    )


def test_half_sine_on_a_plane(on_plane, tmp_path):
    results = run(on_plane, tmp_path / "plane.h5", half_sine, 1.5, ["joint_1"])
    block = dj.block_sliding(results, ["joint_1"])
    a = math.radians(ANGLE)
    along, normal = (
        np.array([-math.cos(a), 0, -math.sin(a)]),
        np.array([-math.sin(a), 0, math.cos(a)]),
    )
    np.testing.assert_allclose(block.direction, along, atol=1e-9)
    values = block.measures()
    assert values["safety_static"] == pytest.approx(MU / math.tan(a), rel=1e-9)
    peak = GRAVITY - np.array([4.0, 0.0, 0.0])
    # Records are means of steps.
    assert values["safety_min"] == pytest.approx(MU * -(peak @ normal) / (peak @ along), rel=1e-3)
    assert values["safety_time"] == pytest.approx(0.25, abs=DT)
    yield_acceleration = 9.80665 * (MU * math.cos(a) - math.sin(a))
    assert values["yield_acceleration"] == pytest.approx(yield_acceleration, rel=1e-9)
    exact = rigid_slip(half_sine, [normal], along, 1.5)
    assert values["newmark_residual"] == pytest.approx(exact, rel=1e-3)
    assert values["slip_residual"] == pytest.approx(exact, rel=0.01)
    # Friction at the angle of the plane is its limit.
    for angles in (20.0, [20.0]):
        weak = dj.block_sliding(results, ["joint_1"], friction_angle_deg=angles)
        assert weak.safety[0] == pytest.approx(1.0, rel=1e-9)
    check_output(results, values, tmp_path)
    check_errors(results)


def check_output(results, values, folder):
    """CSV and report have the numbers of `block_sliding`."""
    dj.write_csv(results, folder / "tables")
    rows = list(csv.DictReader((folder / "tables" / "sliding.csv").open()))
    assert {row["block"] for row in rows} == {"block"}
    least = min(rows, key=lambda row: float(row["factor of safety [-]"]))
    assert float(least["factor of safety [-]"]) == values["safety_min"]
    assert float(rows[-1]["slip of Newmark's block [m]"]) == values["newmark_residual"]
    html = dj.report.write([results.path], folder / "r.html", with_3d=False).read_text()
    assert "Sliding blocks (plane)" in html
    assert f'<td class="number">{1e3 * values["newmark_residual"]:.4g}</td>' in html


def check_errors(results):
    """Wrong names and directions are refused."""
    with pytest.raises(dj.ResultsError, match="No joint 'joint_2'"):
        dj.block_sliding(results, ["joint_2"])
    a = math.radians(ANGLE)
    upwards = (-math.sin(a), 0.0, math.cos(a))
    for direction in ((0, 0, 0), (0, 0, -1), (1, 0, 0), upwards):
        with pytest.raises(dj.ResultsError, match="must be along a plane of joint_1 and into none"):
            dj.block_sliding(results, ["joint_1"], direction=direction)
    with pytest.raises(
        ValueError, match="friction_angle_deg is .*; it must be one angle per plane"
    ):
        dj.block_sliding(results, ["joint_1"], friction_angle_deg=[20.0, 30.0])
    with pytest.raises(ValueError, match="friction_angle_deg is .*each zero or more and below 90"):
        dj.block_sliding(results, ["joint_1"], friction_angle_deg=[90.0])
    with pytest.raises(ValueError, match="planes is .*; it must be names of joints, each once"):
        dj.block_sliding(results, ["joint_1", "joint_1"])


@pytest.mark.filterwarnings("ignore:The estimated error of a single step")
def test_a_block_of_a_plane_model_slides_in_its_plane(tmp_path):
    mesh = box([1.0, 2.0], [2, 4], joints={"joint": (1, 1.0)}, groups={"base": (1, 0.0)})
    model = dj.Model(
        mesh, material=ROCK, joints=LAW, supports=[dj.Fixed(group="base")], loads=[dj.Gravity()]
    )
    results = run(model, tmp_path / "plane.h5", lambda t: (1.0, 0.0), 2 * DT, ["joint"])
    # Level: yield acceleration is mu g.
    values = dj.block_sliding(results, ["joint"], direction=(1, 0, 0)).measures()
    assert values["yield_acceleration"] == pytest.approx(MU * 9.80665, rel=1e-9)
    # Without friction the block slides under any force, but at rest there is none.
    options = {"direction": (-1, 0, 0), "friction_angle_deg": 0.0}
    smooth = dj.block_sliding(results, ["joint"], **options)
    np.testing.assert_array_equal(smooth.safety, [np.inf, 0.0, 0.0])
    for direction in ((0, 0, 1), None):
        with pytest.raises(dj.ResultsError, match=f"direction is .*{str(direction)[1:-1]}.*; it"):
            dj.block_sliding(results, ["joint"], direction=direction)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_records_on_a_plane(on_plane, tmp_path, seed):
    record = dj.synthetic_motion(duration=3.0, seed=seed, peaks_g=(0.8, 0.0, 0.3))
    results = run(on_plane, tmp_path / "plane.h5", record, 3.5, ["joint_1"])
    block = dj.block_sliding(results, ["joint_1"])
    a = math.radians(ANGLE)
    normal = np.array([-math.sin(a), 0.0, math.cos(a)])
    exact = rigid_slip(record, [normal], block.direction, 3.5)
    assert exact > 0.02
    assert block.newmark_slip[-1] == pytest.approx(exact, rel=0.01)
    assert block.slip[-1] == pytest.approx(exact, rel=0.01)  # of the elastic block


# Dip and dip direction of the two planes of a wedge, and of the slope in front of it.
PLANES, SLOPE, TOE = {"a": (45.0, 105.0), "b": (60.0, 235.0)}, (75.0, 185.0), (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def wedge_mesh():
    return mesh_of(
        wedge,
        planes={name: (*dips, *TOE) for name, dips in PLANES.items()},
        ground=[(*SLOPE, *TOE)],
        inside=(-1.0, 3.0, 5.0),
        lower=(-15.0, -5.0, -3.0),
        upper=(15.0, 22.0, 10.0),
        size=9.0,
        joint_size=5.0,
    )


@pytest.mark.filterwarnings("ignore:Joint .* chatters")
@pytest.mark.parametrize(("ratio", "error"), [(1.0, 0.01), (20.0, 0.04)])
def test_wedge_on_two_planes(wedge_mesh, tmp_path, ratio, error):
    """F in statics is that of limit equilibrium, whatever the ratio of the stiffnesses."""
    law = dj.FrictionNoTension(
        normal_stiffness=1e10, shear_stiffness=1e10 / ratio, friction_angle_deg=35.0
    )
    model = dj.Model(
        wedge_mesh,
        material={"wedge": ROCK, "rock": replace(ROCK, density=0.0)},  # rock without mass
        joints=law,
        supports=[dj.Fixed(group="outer")],
        loads=[dj.Gravity()],
        damping=DAMPING,
    )
    names = ["joint_a", "joint_b"]
    results = run(model, tmp_path / "wedge.h5", half_sine_across, 1.0, names)
    block = dj.block_sliding(results, names)
    planes = [
        WedgePlane(dip=dip, dip_direction=azimuth, friction_angle_deg=35.0)
        for dip, azimuth in PLANES.values()
    ]
    exact = SlidingWedge(planes=planes, force=block.mass * GRAVITY)
    np.testing.assert_allclose(block.direction, exact.direction, atol=1e-6)
    assert block.safety[0] == pytest.approx(exact.factor_of_safety, rel=1e-6)
    # All loads but the inertia are constant: the wedge slides as Newmark's block.
    normals = [plane.normal for plane in planes]
    slip = rigid_slip(half_sine_across, normals, block.direction, 1.0, math.tan(math.radians(35.0)))
    assert block.newmark_slip[-1] == pytest.approx(slip, rel=1e-3)
    assert block.slip[-1] == pytest.approx(slip, rel=error)


def test_thrust_of_a_pier_on_a_wedge(tmp_path):
    """On a wedge that sticks, the force on the rigid wedge is that of the run on its planes."""
    with gmsh_model.gmsh_session():
        for box in ((0, 0, 0, 4000, 2000, 3000), (1000, 0, 3000, 2000, 2000, 5000)):
            gmsh.model.occ.addBox(*box)  # rock and pier [mm]
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "pier.step"))
    planes = {"left": (45.0, 110.0, 0.7, 0.0, 2.0), "right": (45.0, 250.0, 0.7, 0.0, 2.0)}
    solids = {"rock": (2.0, 1.0, 1.0), "pier": (2.0, 1.0, 5.0)}
    options = {"solids": solids, "planes": planes, "wedge": (0.7, 0.3, 2.6), "size": 1.5}
    bottom = {"base": ("z", "min")}
    path = from_step(tmp_path / "p.msh", tmp_path / "pier.step", surfaces=bottom, **options)
    law = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=4e9, friction_angle_deg=50.0)
    model = dj.Model(
        dj.read_msh(path, MPI.COMM_SELF),
        material=ROCK,
        joints=law,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
        damping=dj.Rayleigh(stiffness_factor=1e-3),
    )
    names = ["joint_left", "joint_right"]
    results = run(model, tmp_path / "pier.h5", along_valley, 0.3, names)
    block = dj.block_sliding(results, names)
    on_planes = sum(joint_resultants(results, name).force for name in names) @ block.direction
    on_planes *= np.sign(on_planes[0])
    thrust = joint_resultants(results, "joint_pier_wedge").force @ block.direction
    assert np.ptp(thrust) > 3.0 * block.mass * 2.0  # the thrust changes more than the inertia
    np.testing.assert_allclose(block.driving, on_planes, atol=0.01 * np.ptp(on_planes))
