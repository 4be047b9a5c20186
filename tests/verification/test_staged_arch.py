# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""An arch dam on rock, built in cantilevers on its perimetral joint, then grouted and filled."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx_joints as dj

pytestmark = pytest.mark.mpi

STIFFNESS = {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 45.0}
# The banks rise at some 60 degrees: separate blocks stand on them by their bond.
BOND = {"cohesion": 2e6, "tensile_strength": 1.5e6}


def symmetric_dam(out: Path) -> None:
    """Three sections, 40 m, with five joints on rock; symmetric about y = 0."""
    from dolfinx_joints.geometry.section_table import SectionTable
    from dolfinx_joints.geometry.sections_dam import sections_dam

    columns = {
        "elevation": [200.0, 220.0, 240.0],
        "extrados_radius": [70.0, 72.0, 74.0],
        "centre_x": [70.0, 72.0, 74.0],
        "crown_thickness": [12.0, 8.0, 5.0],
        "left_angle": [25.0, 40.0, 55.0],
        "right_angle": [25.0, 40.0, 55.0],
    }
    table = SectionTable({name: np.array(values) for name, values in columns.items()})
    sections_dam(
        out, table, size=8.0, order=1, joints=5, foundation=30.0, spread=20.0, perimetral=True
    )


def test_weight_without_arches_then_water_with_them(mesh_file, read):
    jointed = read(mesh_file(symmetric_dam))
    contraction = [name for name in jointed.joint_names if name != "joint_perimetral"]
    assert len(contraction) == 5
    weight, water = dj.Gravity(), dj.HydrostaticPressure(group="upstream", level=236.0)
    rock = dj.Elastic(young=20e9, poisson=0.2, density=0.0)
    concrete = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
    model = dj.Model(
        jointed,
        material={"foundation": rock, "concrete": concrete},
        joints={
            **dict.fromkeys(contraction, dj.FrictionNoTension(**STIFFNESS)),
            "joint_perimetral": dj.MohrCoulombJoint(**STIFFNESS, **BOND),
        },
        supports=[dj.Fixed(group="foundation_outer")],
        loads=[weight, water],
    )
    run = dj.Simulation(model)
    run.statics(joints=["joint_perimetral"], loads=[weight])
    forces = dj.JointForces(model)(run.static.joints)
    ((pattern, _),) = weight.patterns(model)
    total = -pattern.sum()  # the rock has none
    np.testing.assert_allclose(
        forces["joint_perimetral"].force, [0.0, 0.0, total], atol=1e-9 * total
    )
    assert all(forces[name].normal_force == 0.0 for name in contraction)
    run.grout()
    run.statics(steps=2)
    forces = dj.JointForces(model)(run.static.joints)
    normal = np.array([forces[name].normal_force for name in contraction])
    np.testing.assert_allclose(normal, normal[::-1], rtol=1e-6)  # as the dam is symmetric
    # Rings alone would bear p R over the 36 m of water, 457 MN; cantilevers take some to the rock.
    assert 457e6 > normal[2] > normal[1] > normal[0] > 30e6
