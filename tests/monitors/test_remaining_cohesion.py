# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cohesion in results: adhesion that stays, bonds that soften, and gaps that adhesion would cross.

A block of 4 m by 1 m (1 m thick) rests on a plane joint. Its weight is W = 4 m^2 * 2400 kg/m^3 * g.
"""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import Rows, box

import dolfinx_joints as dj
from dolfinx_joints.postprocessing.joints.extremes import joint_extremes
from dolfinx_joints.postprocessing.joints.resultants import joint_resultants, stage_resultants
from dolfinx_joints.postprocessing.joints.surface import map_value
from dolfinx_joints.postprocessing.measures import joint_measures

STIFF = {"normal_stiffness": 1e10, "shear_stiffness": 5e9, "friction_angle_deg": 40.0}
MU, AREA, WEIGHT = math.tan(math.radians(40.0)), 4.0, 4.0 * 2400.0 * 9.80665
POINT = {"foot": (0.5, 0.5)}
C, G_2 = 2e4, 20.0
DUCTILITY = 2.0 * G_2 * STIFF["shear_stiffness"] / C**2


def model(law, *, slope=0.0, joints=None, comm=MPI.COMM_WORLD, supports=()):
    cosine, sine = math.cos(math.radians(slope)), math.sin(math.radians(slope))

    def turned(x):
        return np.column_stack([x[:, :2] @ [[cosine, -sine], [sine, cosine]], x[:, 2]])

    def on_block(x):
        return (x[1] > 2.0 - 1e-9) | ((x[1] > 1.0 - 1e-9) & np.isin(x[0], [0.0, 4.0]))

    jointed = box(
        (4.0, 2.0),
        (8, 4),
        joints={"joint": (1, 1.0)},
        groups={"base": (1, 0.0), "block": on_block},
        place=turned,
        comm=comm,
    )
    return dj.Model(
        jointed,
        material=dj.Elastic(young=20e9, poisson=0.2, density=2400.0),
        joints=joints or law,
        supports=[dj.Fixed(group="base"), *supports],
        loads=[dj.Gravity()],
    )


def cohesive(softening="linear"):
    return dj.CohesiveJoint(
        **STIFF,
        tensile_strength=1e4,
        cohesion=C,
        fracture_energy=5.0,
        shear_fracture_energy=G_2,
        softening=softening,
    )


@pytest.mark.mpi
def test_files_contain_the_adhesion(comm, new_path):
    """The safety of a block at rest on a slope is (c A + W cos(a) tan(phi)) / (W sin(a))."""
    law, path, slope = dj.AdhesiveJoint(**STIFF, adhesion=5e3), new_path("a.h5"), 30.0
    monitor = dj.ResultsMonitor(path, points=POINT, resultants=True)
    run = dj.Simulation(model(law, slope=slope, comm=comm), monitors=[monitor])
    run.statics()
    run.dynamics(dt=2e-3, steps=2, motion=lambda t: (0.0, 0.0))
    angle = math.radians(slope)
    expected = (5e3 * AREA + WEIGHT * math.cos(angle) * MU) / (WEIGHT * math.sin(angle))
    if comm.rank == 0:
        with dj.Results(path) as results:
            forces = joint_resultants(results, "joint")
            extremes = joint_extremes(results, "joint")
            sliding = dj.block_sliding(results, ["joint"])
        np.testing.assert_allclose(forces.plane_safety, expected, rtol=1e-6)
        np.testing.assert_allclose(extremes.mobilised, 1.0 / expected, rtol=1e-6)
        np.testing.assert_allclose(forces.bond, 5e3 * AREA, rtol=1e-12)
        assert sliding.safety[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("softening", ["linear", "exponential"])
def test_a_softening_joint_has_the_rest_of_its_cohesion(softening, new_path):
    """A point with the slip x c / k_s, pushed further and further, keeps the strength c x f_s.

    That is c (G - x) / (G - 1) or c exp(-2 (x - 1) / (G - 1)) with the ductility G, c for x < 1. It
    is the shear that the bond carries for x > 1, to which friction d mu p comes with d = 1 - f_s.
    """
    slips = np.array([0.5, 3.0, 0.25 * DUCTILITY, 1.5 * DUCTILITY]) * C / STIFF["shear_stiffness"]
    moved = dj.Prescribed(group="block", component="x", value=lambda t: t)
    path = new_path("s.h5")
    run = dj.Simulation(
        model(cohesive(softening), comm=MPI.COMM_SELF, supports=[moved]),
        monitors=[dj.ResultsMonitor(path, points=POINT)],
    )
    run.quasi_statics([*slips])
    with dj.Results(path) as results:
        forces, areas = stage_resultants(results, "joint"), results.static("joints/joint/areas")
        gap, traction, lost = (
            results.series("statics", f"joints/joint/{name}")
            for name in ("gap", "traction", "broken")
        )
    x = np.maximum(np.abs(gap[..., 1]) * STIFF["shear_stiffness"] / C, 1.0)
    left = np.maximum((DUCTILITY - x) / (DUCTILITY - 1.0), 0.0)
    if softening == "exponential":
        left = np.exp(-2.0 * (x - 1.0) / (DUCTILITY - 1.0))
    assert x[0].max() == 1.0 < x[1].min()
    assert gap[..., 0].max() < 0.0
    np.testing.assert_allclose(lost, 1.0 - left, atol=1e-12)
    np.testing.assert_allclose(forces.bond, C * left @ areas, rtol=1e-12, atol=1e-6)
    shear = C * left - MU * traction[..., 0] * (1.0 - left / x)
    np.testing.assert_allclose(np.abs(traction[1:, :, 1]), shear[1:], rtol=1e-9)
    safety = (MU * WEIGHT + C * left @ areas)[1:] / (shear @ areas)[1:]
    np.testing.assert_allclose(forces.sliding_safety[1:], safety, rtol=1e-9)
    assert (forces.sliding_safety > 1.0 - 1e-12).all()
    if softening == "linear":
        assert forces.sliding_safety[-1] == pytest.approx(1.0, rel=1e-9)
    now = dj.JointForces(run.model)(run.static.joints)["joint"]
    assert float(now.sliding_safety) == pytest.approx(forces.sliding_safety[-1], rel=1e-12)


def test_a_shaken_joint_mobilises_at_most_its_strength(new_path):
    """All points are half broken. The line of the ledger counts from 0 in both parts of a run."""
    path, fracture = new_path("d.h5"), Rows(lambda record: record.energy.fracture)
    file = dj.ResultsMonitor(path, points=POINT, overwrite=True)
    run = dj.Simulation(model(cohesive(), comm=MPI.COMM_SELF), monitors=[file, fracture])
    run.statics()

    def motion(t):
        return 16.0 * math.sin(80.0 * t), 5.0 * math.sin(50.0 * t)

    broken, state = [], None
    for steps in (15, 25):
        state = run.dynamics(dt=1e-3, steps=steps, motion=motion, start=state).state
        broken.append(fracture.rows)
    total = run.model.contact.fracture_energy(state.joints.state)
    assert broken[0][0] == broken[1][0] == 0.0 < broken[0][-1]
    assert broken[0][-1] + broken[1][-1] == pytest.approx(total, rel=1e-12)
    with dj.Results(path) as results:
        last = results.rows("states") - 1
        used = map_value(results, "joint", "mobilised", last)
        lost = results.series("states", "joints/joint/broken", last)
        areas = results.static("joints/joint/areas")
        share = joint_measures(results)["joint"]["share_broken"]
    assert 0.0 < lost.min() < lost.max() < 1.0
    assert 0.4 < np.nanmax(used) < 1.0
    assert share == pytest.approx(lost @ areas / AREA, rel=1e-12)


@pytest.mark.mpi
def test_adhesion_across_an_open_joint_is_refused(comm):
    law = dj.AdhesiveJoint(**STIFF, adhesion=5e3)
    gaps = {"joint": lambda x: np.where(x[:, 0] > 3.0, 1e-3, 0.0)}
    with pytest.raises(dj.JointsError, match=r"'joint': the initial gap is 0.001 m; it must"):
        model(law, joints=dj.Joints(law, initial_gaps=gaps), comm=comm)
    model(law, joints=dj.Joints(law, initial_gaps={"joint": -1e-6}), comm=MPI.COMM_SELF)
