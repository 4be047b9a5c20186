# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""A thick ring under inner pressure, with a joint around it, on curved cells.

    p ->| a    c|    b|        radii; inner pressure p, the joint at c with k_n, plane strain,
        |=======|=====|        a quarter between planes of symmetry

Lame: u = A r + B/r and sigma_r = 2 (lambda + mu) A - 2 mu B/r^2 in the ring inside and in the one
outside of the joint; with q the pressure on the joint

    sigma_r(a) = -p,  sigma_r(c) = -q on both sides,  sigma_r(b) = 0,  k_n (u_out - u_in)(c) = -q

There is no shear. A stiff joint ties the two rings to one.

Cells of order 2 follow a circle to h^3, its length to h^4: the quarter of it between (c, 0) and
(0, c) is n times its length, integrated c (1, 1) whatever the curve, and the mean pressure on the
joint converges as h^4 like an energy. Orders of 3.6 to 3.8 were measured from 4 to 8 cells and
errors of up to 3.4e-5 on 8; straight cells have 3.4e-3 there, and order 2.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from rings import HEIGHT, INSIDE, JOINT, OUTSIDE, quarter_ring

import dolfinx_joints as dj

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=10e9, poisson=0.2, density=2400.0)
PRESSURE = 1e6
LENGTH = 0.5 * np.pi * JOINT
CELLS = ["quadrilateral", "triangle", "hexahedron", "tetrahedron"]


def joint_pressure(stiffness):
    """Lame's q [Pa], from A and B of both rings."""
    mu = CONCRETE.shear_modulus
    bulk = CONCRETE.first_lame("strain") + mu

    def stress(r):
        return np.array([2.0 * bulk, -2.0 * mu / r**2])

    def displacement(r):
        return np.array([r, 1.0 / r])

    none, q, opening = np.zeros(2), -stress(JOINT), stiffness * displacement(JOINT)
    equations = [
        [*stress(INSIDE), *none],
        [*none, *stress(OUTSIDE)],
        [*q, *-q],
        [*q - opening, *opening],
    ]
    inside = np.linalg.solve(equations, [-PRESSURE, 0.0, 0.0, 0.0])[:2]
    return q @ inside


def ring(comm, cell, boxes, *, stiffness=2e10, degree=2, quadrature="auto"):
    """The ring under pressure, on cells of a degree, with displacements of order 2."""
    jointed = dj.mesh_from_arrays(comm, **quarter_ring(cell, boxes, degree))
    planes = {"flat": "y", "upright": "x", "bottom": "z", "top": "z"}
    here = [name for name in planes if name in jointed.facet_groups]
    return dj.Model(
        jointed,
        material=CONCRETE,
        joints=dj.Joints(
            dj.FrictionNoTension(
                normal_stiffness=stiffness, shear_stiffness=0.5 * stiffness, friction_angle_deg=30.0
            ),
            quadrature=quadrature,
        ),
        supports=[dj.Fixed(group=name, components=planes[name]) for name in here],
        loads=[dj.Pressure(group="inside", value=PRESSURE)],
        body=dj.Body(degree=2),
    )


def over_joint(model, values):
    """Integral of what points of the joint have, over its height [m]."""
    total = model.V.mesh.comm.allreduce(model.operator.areas @ values)
    return total / (HEIGHT if model.gdim == 3 else 1.0)


def pressure_error(model, stiffness):
    """Relative error of the normal force of the joint."""
    traction = dj.Simulation(model).statics().joints.traction
    exact = joint_pressure(stiffness) * LENGTH
    return abs(over_joint(model, traction[:, 0]) / exact + 1.0)


@pytest.mark.parametrize("stiffness", [2e10, 1e14], ids=["soft", "tied"])
@pytest.mark.parametrize("cell", CELLS)
def test_curved_cells_carry_the_pressure_to_order_four(comm, cell, stiffness):
    models = (ring(comm, cell, boxes, stiffness=stiffness) for boxes in (4, 8))
    coarse, fine = (pressure_error(model, stiffness) for model in models)
    assert fine <= 5e-5
    assert np.log2(coarse / fine) >= 3.5


def test_straight_cells_carry_it_to_order_two(comm):
    models = (ring(comm, "quadrilateral", boxes, degree=1) for boxes in (4, 8))
    coarse, fine = (pressure_error(model, 2e10) for model in models)
    assert fine >= 2e-3
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("cell", CELLS)
def test_length_and_normals_of_a_curved_joint(comm, cell):
    models = [ring(comm, cell, boxes, quadrature="gauss") for boxes in (4, 8)]
    coarse, fine = (
        abs(over_joint(model, np.ones(len(model.operator.areas))) / LENGTH - 1.0)
        for model in models
    )
    assert fine <= 4e-6
    assert np.log2(coarse / fine) >= 3.9
    normal = over_joint(models[0], models[0].operator.frames[:, 0])
    np.testing.assert_allclose(normal, [JOINT, JOINT, 0.0], atol=1e-13)
