# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two blocks under their weight, the joint between them grouted under pressure.

The problem of code_aster's test SSNP143: blocks of 5 m by 10 m in plane strain on a fixed base, E =
3e12 Pa, nu = 0.25, 2400 kg/m^3, k = 1e12 Pa/m, grout of 50 kPa. Its reference openings, by another
program (GEFDYN), are met there within 6 to 7 %.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import (
    Elastic,
    Fixed,
    FrictionNoTension,
    Gravity,
    Model,
    Simulation,
    mesh_from_arrays,
)

pytestmark = pytest.mark.mpi

WIDTH, HEIGHT, GROUT = 5.0, 10.0, 5e4
OPENING = {2.0: 6.38e-7, 5.0: 2.14e-6, 8.0: 3.88e-6}  # by height [m]


def two_blocks(comm, size):
    """Squares of a size [m], the joint at x = 0."""
    across, high = round(WIDTH / size), round(HEIGHT / size)
    grid = np.arange((2 * across + 1) * (high + 1)).reshape(high + 1, 2 * across + 1)
    y, x = np.indices(grid.shape)
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    return mesh_from_arrays(
        comm,
        cell="quadrilateral",
        x=size * np.column_stack([x.ravel() - across, y.ravel()]),
        cells=np.column_stack([corner.ravel() for corner in corners]),
        facet_groups={
            "base": np.column_stack([grid[0, :-1], grid[0, 1:]]),
            "joint_1": np.column_stack([grid[:-1, across], grid[1:, across]]),
        },
    )


def test_openings_under_the_grout(comm):
    model = Model(
        two_blocks(comm, 0.5),
        material=Elastic(young=3e12, poisson=0.25, density=2400.0),
        joints=FrictionNoTension(
            normal_stiffness=1e12, shear_stiffness=1e12, friction_angle_deg=40.0
        ),
        supports=[Fixed(group="base")],
        loads=[Gravity(acceleration=(0.0, -9.81))],
        quadrature="nodal",
    )
    run = Simulation(model)
    run.statics(joints="inactive")
    state = run.grout(pressure=GROUT)
    np.testing.assert_allclose(state.joints.traction[:, 0], -GROUT, rtol=1e-9)
    # The gap counts from the grout; the opening of the blocks is in their displacement.
    np.testing.assert_allclose(state.joints.state.gap[:, 0], -GROUT / 1e12, rtol=1e-9)
    opening = model.contact.gap(state.displacement)[:, 0]
    points = np.column_stack([model.operator.points[:, 1], opening])
    height, opening = np.concatenate(comm.allgather(points)).T
    order = np.argsort(height)
    found = np.interp(list(OPENING), height[order], opening[order])
    np.testing.assert_allclose(found, list(OPENING.values()), rtol=0.05)
