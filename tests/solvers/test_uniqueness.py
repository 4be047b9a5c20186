# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bound of the friction coefficient for unique joint forces, from dense matrices."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.geometry.jointed_wall import jointed_wall
from dolfinx_joints.geometry.two_blocks import two_blocks

STEEL = dj.Elastic(young=30e9, poisson=0.2, density=2400.0)
K_N, K_S = 1e10, 4e9


LAW = dj.FrictionNoTension(normal_stiffness=K_N, shear_stiffness=K_S, friction_angle_deg=30.0)


def model(mesh, law=LAW):
    base = [dj.Fixed(group="base")]
    return dj.Model(mesh, material=STEEL, joints=law, supports=base, loads=[dj.Gravity()])


@pytest.fixture(scope="module")
def wall():
    return model(mesh_of(jointed_wall, size=5.0))


def dense_compliance(wall, dt):
    """Return G + 1/(k w), scaled to a unit diagonal of G, and the largest c_s / c_n."""
    system = wall.system(static=dt is None)
    matrix = system.stiffness[:, :]
    if dt is not None:
        matrix = 2.0 / dt**2 * system.mass[:, :] + 0.5 * matrix
    free = np.setdiff1d(np.arange(len(matrix)), system.constrained)
    gaps = system.contact.operator.matrix[:, :][:, free]
    compliance = gaps @ np.linalg.solve(matrix[np.ix_(free, free)], gaps.T)
    diagonal, areas = np.diag(compliance).reshape(-1, 3), wall.operator.areas
    moving = np.abs(diagonal).min(axis=1) > 0.0
    own = np.column_stack([diagonal[:, 0], *2 * [diagonal[:, 1:].mean(axis=1)]])
    law = 1.0 / (np.array([K_N, K_S, K_S]) * areas[:, None])
    rows = np.repeat(moving, 3)
    scale = np.sqrt(own.ravel()[rows])
    total = compliance + np.diag(law.ravel())
    return total[np.ix_(rows, rows)] / np.outer(scale, scale), (
        own[moving, 1] / own[moving, 0]
    ).max()


@pytest.mark.parametrize("dt", [None, 1e-3])
def test_bound_is_that_of_the_dense_matrix(wall, dt):
    compliance, ratio = dense_compliance(wall, dt)
    kappa = np.linalg.cond(compliance)
    bound = dj.critical_friction(wall, dt=dt)
    assert bound == pytest.approx(2.0 / (kappa + 1.0) / ratio**0.5, rel=1e-6)


def test_below_the_bound_all_starts_lead_to_one_solution(wall):
    """Projections of the scaled forces contract with (kappa - 1) / (kappa + 1) + mu'."""
    dt = 1e-3
    compliance, ratio = dense_compliance(wall, dt)
    mu = 0.9 * dj.critical_friction(wall, dt=dt) * ratio**0.5
    smallest, *_, largest = np.linalg.eigvalsh(compliance)
    rng = np.random.default_rng(1)
    gap = rng.normal(size=len(compliance))
    gap[::3] -= 2.0  # most points close
    ends = []
    for _ in range(3):
        force = 5.0 * rng.normal(size=len(compliance))
        for _ in range(2000):
            force -= 2.0 / (largest + smallest) * (compliance @ force + gap)
            points = force.reshape(-1, 3)
            points[:, 0] = np.maximum(points[:, 0], 0.0)
            limit, shear = mu * points[:, 0], np.linalg.norm(points[:, 1:], axis=1)
            points[:, 1:] *= np.minimum(1.0, limit / np.maximum(shear, 1e-300))[:, None]
        ends.append(force)
    assert np.abs(ends[0]).max() > 0.1
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, atol=1e-9)


def test_no_bound_without_supports_and_joints(tmp_path):
    path = two_blocks(tmp_path / "b.msh", size=0.5)
    assert dj.critical_friction(model(dj.read_msh(path, MPI.COMM_SELF))) == 0.0
    whole = dj.read_msh(path, MPI.COMM_SELF, joints=[])
    body = dj.Model(whole, material=STEEL, supports=[dj.Fixed(group="base")])
    with pytest.raises(dj.JointsError, match="The model has no joints"):
        dj.critical_friction(body)


@pytest.mark.parametrize(("dt", "expected"), [(5e-3, 0.003), (2e-4, 0.59)])
def test_bounds_of_two_blocks(dt, expected):
    """The bounds equal those that section 6.4 of docs/theory/solvers.md states."""
    law = replace(LAW, normal_stiffness=10 * K_N, shear_stiffness=10 * K_S)
    blocks = model(mesh_of(two_blocks, size=0.25), law)
    digits = 3 if expected < 0.01 else 2
    assert round(dj.critical_friction(blocks, dt=dt), digits) == expected


STIFF = {"normal_stiffness": K_N, "shear_stiffness": K_S, "friction_angle_deg": 30.0}
BOND = {"tensile_strength": 1e6, "cohesion": 1e6}
ENERGIES = {"fracture_energy": 200.0, "shear_fracture_energy": 400.0}


@pytest.mark.parametrize(
    "law",
    [
        dj.AdhesiveJoint(**STIFF, adhesion=1e4),
        dj.CohesiveJoint(**STIFF, **BOND, **ENERGIES),
        dj.KeyedJoint(normal_stiffness=K_N, shear_stiffness=K_S),
        dj.MohrCoulombJoint(**STIFF, dilatancy_angle_deg=5.0),
        dj.ViscousJoint(law=LAW, normal_viscosity=1e5),
    ],
    ids=lambda law: type(law).__name__,
)
def test_other_laws_have_no_bound(law):
    blocks = model(mesh_of(two_blocks, size=0.5), law)
    with pytest.raises(dj.JointsError, match=f"is {type(law).__name__}; it must be FrictionNo"):
        dj.critical_friction(blocks, dt=1e-3)


def test_any_friction_is_unique_without_shear_stiffness():
    smooth = dj.frictionless(normal_stiffness=K_N)
    blocks = model(mesh_of(two_blocks, size=0.5), smooth)
    assert dj.critical_friction(blocks, dt=1e-3) == np.inf
