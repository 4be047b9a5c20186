# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limit equilibrium of rigid wedges against formulas, and strength reduction against it."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx import fem

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.exact import SlidingWedge, WedgePlane, plane_normal
from dolfinx_joints.geometry.wedge import wedge

WEIGHT = 1e6  # [N]
DOWN = (0.0, 0.0, -WEIGHT)


def test_normal_of_a_plane():
    # A plane that dips at 30 degrees to the east falls by tan(30) per metre of x.
    tan = math.tan(math.radians(30.0))
    np.testing.assert_allclose(plane_normal(30.0, 90.0) @ (1.0, 0.0, -tan), 0.0, atol=1e-15)
    assert plane_normal(30.0, 90.0)[0] == pytest.approx(0.5)


def test_block_on_a_plane_with_a_tension_crack_full_of_water():
    psi, phi, c, area = math.radians(35.0), math.radians(30.0), 40e3, 50.0
    uplift, thrust = 3e5, 1.5e5  # [N]
    block = SlidingWedge(
        planes=[
            WedgePlane(
                dip=35.0,
                dip_direction=120.0,
                friction_angle_deg=30.0,
                cohesion=c,
                area=area,
                pressure=uplift / area,
            ),
            WedgePlane(
                dip=90.0,
                dip_direction=120.0,
                friction_angle_deg=30.0,
                cohesion=c,
                area=10.0,
                pressure=thrust / 10.0,
            ),
        ],
        force=DOWN,
    )
    # Hoek and Bray: plane failure with water in the plane and in a vertical tension crack.
    normal = WEIGHT * math.cos(psi) - uplift - thrust * math.sin(psi)
    driving = WEIGHT * math.sin(psi) + thrust * math.cos(psi)
    assert block.normal_forces == pytest.approx([normal, 0.0], rel=1e-12)
    exact = (c * area + normal * math.tan(phi)) / driving
    assert block.factor_of_safety == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("plunge", [10.0, 35.0])
@pytest.mark.parametrize("opening", [60.0, 100.0])
def test_symmetric_wedge(plunge, opening):
    """F = sin(beta) / sin(xi/2) * tan(phi) / tan(psi), with beta = 90 degrees (Wyllie and Mah)."""
    psi, half = math.radians(plunge), math.radians(opening / 2)
    line = np.array([0.0, -math.cos(psi), -math.sin(psi)])  # south, downwards
    steep = np.array([0.0, -math.sin(psi), math.cos(psi)])  # normal to the line, upwards
    planes = []
    for side in (-1.0, 1.0):
        normal = math.sin(half) * steep + side * math.cos(half) * np.array([1.0, 0.0, 0.0])
        assert abs(normal @ line) < 1e-15
        dip, azimuth = math.acos(normal[2]), math.atan2(normal[0], normal[1])
        planes.append(
            WedgePlane(
                dip=math.degrees(dip), dip_direction=math.degrees(azimuth), friction_angle_deg=30.0
            )
        )
    block = SlidingWedge(planes=planes, force=DOWN)
    np.testing.assert_allclose(block.direction, line, atol=1e-12)
    exact = math.tan(math.radians(30.0)) / math.tan(psi) / math.sin(half)
    assert block.factor_of_safety == pytest.approx(exact, rel=1e-12)


def corner(*, above=True):
    """Return three planes that dip at 60 degrees to three sides."""
    return [
        WedgePlane(dip=60.0, dip_direction=a, friction_angle_deg=30.0, above=above)
        for a in (0.0, 120.0, 240.0)
    ]


def test_planes_that_block_or_release_every_motion():
    # In a corner that opens upwards the weight presses on three planes, 1 / (3 cos 60) each.
    block = SlidingWedge(planes=corner(), force=DOWN)
    assert block.normal_forces == pytest.approx(WEIGHT / 1.5, rel=1e-12)
    assert block.factor_of_safety == math.inf
    # A wedge in a roof falls; pushed upwards by twice its weight it is fixed again.
    assert SlidingWedge(planes=corner(above=False), force=DOWN).factor_of_safety == 0.0
    assert SlidingWedge(planes=corner(above=False), force=(0, 0, WEIGHT)).normal_forces.min() > 0


@pytest.mark.parametrize("pressure", [0.0, 8e3])
def test_strength_reduction_of_a_wedge_in_rock(pressure):
    """F of the mesh is that of the rigid wedge with its weight, to half the interval of F."""
    dips = {"a": (45.0, 105.0), "b": (60.0, 235.0)}
    mesh = mesh_of(
        wedge,
        planes={name: (*of, 0.0, 0.0, 0.0) for name, of in dips.items()},
        ground=[(75.0, 185.0, 0.0, 0.0, 0.0)],
        inside=(-1.0, 3.0, 5.0),
        lower=(-15.0, -5.0, -3.0),
        upper=(15.0, 22.0, 10.0),
        size=9.0,
        joint_size=5.0,
    )
    stiff = {"normal_stiffness": 1e10, "shear_stiffness": 4e9}
    model = dj.Model(
        mesh,
        material=dj.Elastic(young=30e9, poisson=0.2, density=2400.0),
        joints=dj.FrictionNoTension(**stiff, friction_angle_deg=35.0),
        supports=[dj.Fixed(group="outer")],
        loads=[dj.Gravity(), *(dj.Uplift(joint=f"joint_{n}", pressure=pressure) for n in dips)]
        if pressure
        else [dj.Gravity()],
    )
    simulation = dj.Simulation(model)
    simulation.statics()
    areas = [geometry.area for geometry in dj.JointForces(model).geometry]
    volume = fem.assemble_scalar(fem.form(1.0 * mesh.dx("wedge")))
    planes = [
        WedgePlane(dip=d, dip_direction=a, friction_angle_deg=35.0, area=area, pressure=pressure)
        for (d, a), area in zip(dips.values(), areas, strict=True)
    ]
    exact = SlidingWedge(planes=planes, force=(0.0, 0.0, -2400.0 * 9.80665 * volume))
    safety = dj.factor_of_safety(simulation, tolerance=1e-3)
    assert safety.factor <= exact.factor_of_safety * (1.0 + 1e-9)
    assert safety.factor == pytest.approx(exact.factor_of_safety, rel=1e-3)


@pytest.mark.parametrize(
    ("planes", "force", "message"),
    [([], DOWN, "planes is .*; it must be 1"), (corner(), (0, -1), "force is .* 3 finite numbers")],
)
def test_wedges_need_planes_and_a_force(planes, force, message):
    with pytest.raises(ValueError, match=message):
        SlidingWedge(planes=planes, force=force)
