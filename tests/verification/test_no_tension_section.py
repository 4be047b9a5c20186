# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""An eccentric force on a section without tension, plane sections staying plane.

A force N acts at e from the middle of a section of height h. Beyond the core (e > h/6) only a part
of it is in contact: the pressure is a triangle whose centre lies under the force, so the contact
length is 3 (h/2 - e) and the edge stress 2 N / (3 (h/2 - e)) for a unit width; at e = h/4 that is
0.75 h and 2.66667 N/h. Within the core the edge stress is (1 + 6 e/h) N/h.

The joint is so soft against the blocks (E / (k_n h) = 1e5) that the blocks stay plane.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from mpi4py import MPI

from dolfinx_joints import (
    Elastic,
    Fixed,
    FormLoad,
    FrictionNoTension,
    Model,
    Simulation,
    read_msh,
)
from dolfinx_joints.parallel import on_root
from geometry.two_blocks import two_blocks

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
HEIGHT, FORCE = 2.0, 1e3  # h of the section, along x [m]; N for a unit width [N/m]
K_N = 1.5e5  # Pa/m
YOUNG = 1e5 * K_N * HEIGHT  # Pa


def solve(eccentricity, *, cells=16, cell="hex", quadrature="auto"):
    """Contact length [m], edge stress [Pa], and deviation of the gap from a plane, relative.

    The gap is fitted by a plane (on tetrahedra the section tilts a little across its width, as the
    nodal areas are not symmetric): where it vanishes at mid-width the contact ends.
    """
    size = HEIGHT / cells
    with TemporaryDirectory() as folder:
        path = Path(folder) / "section.msh"
        sizes = {"length": HEIGHT, "width": size, "size": size, "cell": cell}
        on_root(COMM, lambda: two_blocks(path, **sizes, lower_height=0.5, upper_height=0.5))
        jointed = read_msh(path, COMM)
    x = ufl.SpatialCoordinate(jointed.mesh)[0] - HEIGHT / 2
    pressure = FORCE / HEIGHT * (1.0 + 12.0 * eccentricity / HEIGHT**2 * x)  # force N, moment N e
    model = Model(
        jointed,
        material=Elastic(young=YOUNG, poisson=0.0, density=0.0),
        joints=FrictionNoTension(
            normal_stiffness=K_N, shear_stiffness=K_N, friction_angle_deg=30.0
        ),
        supports=[Fixed(group="base")],
        loads=[FormLoad(form=lambda v: -pressure * v[2] * jointed.ds("top"))],
        quadrature=quadrature,
    )
    joints = Simulation(model).statics().joints
    operator = model.contact.operator
    points = operator.gather(operator.points[:, :2] - [HEIGHT / 2, size / 2])
    gap = operator.gather(joints.state.gap[:, 0])

    def evaluate():
        columns = np.column_stack([points, np.ones(len(points))])
        plane = np.linalg.lstsq(columns, gap, rcond=None)[0]
        slope, _, middle = plane
        bent = np.abs(gap - columns @ plane).max() / np.abs(gap).max()
        edge = -K_N * (middle + slope * HEIGHT / 2)
        length = min(HEIGHT, HEIGHT / 2 + middle / slope)
        return float(length), float(edge), float(bent)

    return on_root(COMM, evaluate)


def exact(eccentricity):
    """Contact length [m] and edge stress [Pa]."""
    if eccentricity <= HEIGHT / 6:
        return HEIGHT, FORCE / HEIGHT * (1.0 + 6.0 * eccentricity / HEIGHT)
    length = 3.0 * (HEIGHT / 2 - eccentricity)
    return length, 2.0 * FORCE / length


def test_exact_at_a_quarter():
    length, edge = exact(HEIGHT / 4)
    assert length == pytest.approx(0.75 * HEIGHT)
    assert edge * HEIGHT / FORCE == pytest.approx(2.66667, abs=5e-6)


@pytest.mark.parametrize("quadrature", ["nodal", "gauss"])
@pytest.mark.parametrize("cell", ["hex", "tet"])
@pytest.mark.parametrize("share", [1 / 8, 1 / 5, 1 / 4, 1 / 3])
def test_contact_length_and_edge_stress(share, cell, quadrature):
    """Within (cell size / contact length)^2, the error of a trapezoidal sum over the triangle.

    Gauss points sample a linear pressure exactly; only a contact that ends within a cell, as at
    e = h/5, leaves an error.
    """
    cells = 16
    length, edge = exact(share * HEIGHT)
    found_length, found_edge, bent = solve(
        share * HEIGHT, cells=cells, cell=cell, quadrature=quadrature
    )
    tolerance = (HEIGHT / cells / length) ** 2 * (0.1 if quadrature == "gauss" else 1.0)
    assert bent < 2e-5  # of the largest gap
    assert found_length == pytest.approx(length, rel=tolerance)
    assert found_edge == pytest.approx(edge, rel=tolerance)


def test_nodal_rule_converges_with_order_two():
    cells = (8, 16, 32)
    _, edge = exact(HEIGHT / 4)
    errors = [abs(solve(HEIGHT / 4, cells=n, quadrature="nodal")[1] / edge - 1.0) for n in cells]
    assert errors[-1] < 2e-3
    assert -np.polyfit(np.log(cells), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.2)
