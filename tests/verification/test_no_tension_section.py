# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""An eccentric force on a section without tension, plane sections staying plane.

        e |  | N
          |<>|
      +---+--v--+
      |   |     |      The pressure is a triangle whose centre lies under the force, so that the
      +---------+      contact is 3 (h/2 - e) long and the edge stress 2 N / (3 (h/2 - e)) for a
           \\  ||||     unit width; within the core, e < h/6, the edge stress is (1 + 6 e/h) N/h.
            \\ ||||
             \\||||    h: the width of the drawing. Exact solution: `NoTensionSection`.
              \\|||

The joint is so soft against the blocks (E / (k_n h) = 1e5) that the blocks stay plane; what they
bend leaves some 1e-5 in the results. The rules then differ by how they integrate a pressure that
ends within a face:

- Nodal points of order 1 sum a linear pressure by trapezoids: an error of (cell size / contact
  length)^2.
- Nodal points of order 2, and Gauss points, are exact for a linear pressure. Only the kink in the
  face where the contact ends leaves an error, of order two as well but of a small factor that
  depends on where in the face that is.
- A force is carried only between the outermost points. Nodal points reach to the edge; Gauss points
  do not, so that under a force near the edge the block turns over.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx_joints import JointsError
from tests.verification.no_tension_section import NoTensionSection, move_force

SECTION = NoTensionSection()
HEIGHT = SECTION.height
PLANE = 2e-5  # what is left of the bending of the blocks


def solve(shares, **options):
    """Pairs of found and exact states for eccentricities over the height."""
    eccentricities = [share * HEIGHT for share in shares]
    found = move_force(SECTION, eccentricities, **options)
    return [(a, SECTION.exact(e)) for a, e in zip(found, eccentricities, strict=True)]


def edge_error(shares, **options):
    """Root mean square of the errors of the edge stress."""
    return np.sqrt(
        np.mean([(a.edge_stress / b.edge_stress - 1.0) ** 2 for a, b in solve(shares, **options)])
    )


def test_exact_solution_by_hand():
    """e = h/4: contact 3 (h/2 - h/4) = 0.75 h, edge stress 2/0.75 N/h; e = h/8: (1 + 6/8) N/h.

    The rotation is the edge stress over k_n and the contact length; in the core the two edge
    stresses, 1.75 and 0.25 N/h, differ by 1.5 N/h over the height.
    """
    mean, k_n = SECTION.force / HEIGHT, SECTION.stiffness
    quarter, core = SECTION.exact(HEIGHT / 4), SECTION.exact(HEIGHT / 8)
    assert quarter.contact_length == pytest.approx(0.75 * HEIGHT)
    assert quarter.edge_stress == pytest.approx(2.66667 * mean, rel=2e-6)
    assert quarter.rotation == pytest.approx(2.66667 * mean / k_n / (0.75 * HEIGHT), rel=2e-6)
    assert core.contact_length == HEIGHT
    assert core.edge_stress == pytest.approx(1.75 * mean)
    assert core.rotation == pytest.approx(1.5 * mean / k_n / HEIGHT)


@pytest.mark.mpi
@pytest.mark.parametrize("quadrature", ["nodal", "gauss", 4, 7])
@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_order_1(cell, quadrature):
    """Nodal: the error of trapezoids. Gauss: a tenth of that, from the face where contact ends."""
    cells = 16
    for found, exact in solve(
        (1 / 8, 1 / 5, 1 / 4, 1 / 3, 0.40, 0.45), cells=cells, cell=cell, quadrature=quadrature
    ):
        tolerance = (HEIGHT / cells / exact.contact_length) ** 2
        tolerance *= 1.0 if quadrature == "nodal" else 0.1
        assert found.bent < PLANE  # of the largest gap
        assert found.contact_length == pytest.approx(exact.contact_length, rel=tolerance)
        assert found.edge_stress == pytest.approx(exact.edge_stress, rel=tolerance)
        assert found.rotation == pytest.approx(exact.rotation, rel=2 * tolerance)


@pytest.mark.parametrize("quadrature", ["auto", "nodal", "gauss"])
@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_order_2(cell, quadrature):
    """In the core and where the contact ends between faces (e = h/4, h/3) nothing but bending.

    Elsewhere the error of the kink, (cell size / contact length)^2 times at most 0.15 for the nodal
    rules, whose points are half a cell apart, and 0.03 for Gauss points.
    """
    cells = 8
    shares = (1 / 8, 1 / 5, 1 / 4, 1 / 3, 0.40)
    states = solve(shares, cells=cells, cell=cell, order=2, quadrature=quadrature)
    for share, (found, exact) in zip(shares, states, strict=True):
        tolerance = PLANE
        if share in (1 / 5, 0.40):
            coefficient = 0.03 if quadrature == "gauss" else 0.15
            tolerance = coefficient * (HEIGHT / cells / exact.contact_length) ** 2
        assert found.contact_length == pytest.approx(exact.contact_length, rel=tolerance)
        assert found.edge_stress == pytest.approx(exact.edge_stress, rel=tolerance)


@pytest.mark.parametrize("cell", ["hex", pytest.param("tet", marks=pytest.mark.slow)])
@pytest.mark.parametrize("quadrature", ["nodal", "gauss"])
def test_errors_fall_with_order_two(cell, quadrature):
    """Over eccentricities that end the contact at many places within a face."""
    shares = np.linspace(0.20, 0.42, 13)
    coarse, fine = (edge_error(shares, cells=n, cell=cell, quadrature=quadrature) for n in (8, 32))
    assert 0.5 * np.log2(coarse / fine) == pytest.approx(2.0, abs=0.25)


def test_nodal_points_carry_a_force_near_the_edge():
    """Up to e = 0.49 h, where the contact is 0.03 h long, two cells; trapezoids as above."""
    cells = 64
    for found, exact in solve((0.3, 0.42, 0.45, 0.47, 0.48, 0.49), cells=cells):
        tolerance = (HEIGHT / cells / exact.contact_length) ** 2
        assert found.contact_length == pytest.approx(exact.contact_length, rel=tolerance)
        assert found.edge_stress == pytest.approx(exact.edge_stress, rel=tolerance)


@pytest.mark.mpi
def test_gauss_points_carry_none_beyond_the_outermost():
    """Two points per cell, the last 0.2113 cells from the edge: with 8 cells at 0.4736 h."""
    path, beyond = (0.3, 0.42, 0.45, 0.47), 0.475
    solve(path, cells=8, quadrature="gauss")
    solve((*path, beyond), cells=8, quadrature="nodal")
    with pytest.raises(JointsError):
        solve((*path, beyond), cells=8, quadrature="gauss")
