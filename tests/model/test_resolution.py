# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frequencies that mesh, joints and step resolve, against numbers worked out by hand."""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints as dj
from dolfinx_joints.materials.drucker_prager import DruckerPrager
from dolfinx_joints.materials.elastic import Elastic
from dolfinx_joints.model.resolution import resolution

# G = 12 and 3 GPa, lambda + 2 mu = 36 and 9 GPa: shear waves of 2000 and 1000 m/s.
STIFF = Elastic(young=30e9, poisson=0.25, density=3000.0)
SOFT = Elastic(young=7.5e9, poisson=0.25, density=3000.0)
K_N, K_S = 1e9, 4e8
LAW = dj.FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0)
SHEAR, PRESSURE = (6e6, 3e6), (math.sqrt(1.08e14), math.sqrt(2.7e13))  # rho c below, above


@pytest.fixture
def blocks(blocks_file, read):
    """Two cells of 1.5 x 1 x 2 m, one on the other."""
    return read(blocks_file(size=2.0, angle=0.0, length=1.5, lower_height=2.0, upper_height=2.0))


def resolved(jointed, *, material=None, joints=LAW, **options):
    material = {"lower": STIFF, "upper": SOFT} if material is None else material
    return resolution(
        dj.Model(
            jointed, material=material, joints=joints, supports=[dj.Fixed(group="base")], **options
        )
    )


@pytest.mark.mpi
def test_ten_nodes_to_the_shortest_shear_wave(blocks):
    # The longest edge has 2 m: waves of 1000 m/s of 20 m, half of that with quadratic elements.
    assert resolved(blocks).mesh == pytest.approx(50.0)
    assert resolved(blocks, body=dj.Body(degree=2)).mesh == pytest.approx(100.0)
    plastic = DruckerPrager(elastic=STIFF, cohesion=1e6, friction_angle_deg=45.0)
    assert resolved(blocks, material=plastic).mesh == pytest.approx(100.0)
    # Slowest along the third axis, 1200 m/s; massless cells below have no waves.
    layered = dj.Orthotropic(
        young=(9e9, 9e9, 6e9), poisson=(0.2, 0.1, 0.1), shear=(4.5e9, 4.5e9, 4.32e9), density=3000.0
    )
    massless = Elastic(young=1e6, poisson=0.25, density=0.0)
    found = resolved(blocks, material={"lower": massless, "upper": layered})
    assert found.mesh == pytest.approx(60.0)
    assert found.joints == math.inf


def passed(k, impedances, omega):
    """Share of a wave's energy beyond a spring: u1 = 1 + R, u2 = T, i omega Z (1 - R) = k (..)."""
    below, above = impedances
    # Stress from below, i omega Z1 (1 - R), from above, i omega Z2 T, and of the spring are one.
    equations = np.array(
        [[-1j * omega * below, -1j * omega * above], [1j * omega * below + k, -k]], dtype=complex
    )
    _, transmitted = np.linalg.solve(equations, [-1j * omega * below, 1j * omega * below - k])
    return above / below * abs(transmitted) ** 2


@pytest.mark.mpi
def test_half_of_a_waves_energy_passes_a_closed_joint(blocks):
    found = resolved(blocks).joints
    assert found == pytest.approx(K_S * (1 / 6e6 + 1 / 3e6) / (2 * np.pi))  # 31.8 Hz
    bare = dj.FrictionNoTension(normal_stiffness=K_N, shear_stiffness=0.0, friction_angle_deg=0.0)
    of_pressure = resolved(blocks, joints=bare).joints
    for frequency, k, impedances in ((found, K_S, SHEAR), (of_pressure, K_N, PRESSURE)):
        tied = passed(1e6 * k, impedances, 2 * np.pi * frequency)
        assert tied == pytest.approx(8 / 9)  # 4 Z1 Z2 / (Z1 + Z2)^2
        share = passed(k, impedances, 2 * np.pi * frequency) / tied
        assert share == pytest.approx(0.5, rel=1e-6)
    # k / (pi Z) between equal bodies; rigid joints limit nothing.
    assert resolved(blocks, material=STIFF).joints == pytest.approx(K_S / (np.pi * 6e6))
    assert resolved(blocks, joints=dj.RigidJoint(friction_angle_deg=30.0)).joints == math.inf
