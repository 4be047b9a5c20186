# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A frictional crack in a large body under compression, inclined by psi to the load.

             sigma
          | | | | | |
          v v v v v v
      +-----------------+
      |        |   /    |
      |    psi |  /     |        The faces stay closed and slide. The normal traction on them is
      |        | / 2 b  |        uniform, t_n = -sigma sin^2(psi), and the slip is half an ellipse,
      |        |/       |        s = 4 (1 - nu^2)/E tau_eff sqrt(b^2 - x^2),
      |        /        |        tau_eff = sigma sin(psi) (cos(psi) - sin(psi) tan(alpha)).
      +-----------------+
          ^ ^ ^ ^ ^ ^            Derivation and sources: `InclinedCrack`.
          | | | | | |

The joint ends inside the body. Two errors are not those of the joint: the body is finite, 40 b
from the middle to its sides, which makes the slip larger by about 0.0005 (the error falls with the
square of the size, checked below), and the slip has the gradient of a square root at the tips, so
that its L2 error on equal cells is of order one for elements of any degree.

Columns of cells lean by 25 degrees: on a mesh that is its own mirror image about the crack the slip
would not act on the normal tractions at all.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from tests.verification.inclined_crack import InclinedCrack, solve_crack

CRACK = InclinedCrack()
REACH = 0.9 * CRACK.half_length  # the tips are left out


def solve(ratio=1e6, crack=CRACK, **options):
    """The crack with k_n h/E = ratio, cells of 0.2 b by default."""
    options = {"size": 0.2, "cell": "quad", **options}
    stiffness = ratio * crack.young / options["size"]
    return solve_crack(crack, normal_stiffness=stiffness, **options)


def test_exact_solution_by_hand():
    """psi = 45 degrees, sigma = 1 MPa, E = 1 GPa, nu = 0.3, alpha = 30 degrees, b = 1 m.

    t_n = -0.5 MPa; tau_eff = 0.5 (1 - 0.57735) = 0.211325 MPa; largest slip
    4 * 0.91/1000 * 0.211325 = 7.69223e-4 m.
    """
    assert CRACK.normal_traction == pytest.approx(-0.5e6)
    assert CRACK.slip(np.array([0.0, 0.6, 1.0])) == pytest.approx(
        [7.69223e-4, 0.8 * 7.69223e-4, 0.0], rel=1e-6
    )


def test_elastic_contact_has_the_right_limits():
    """Stiff: the rigid contact. Soft: the crack closes by the half-ellipse of mode I."""
    x = np.linspace(-0.9, 0.9, 7)
    stiff = 1e3 * CRACK.modulus
    traction, slip = CRACK.elastic(x, stiff, stiff)
    # A constant overlap sigma/k is a pair of dislocations at the tips, whose stress over sigma is
    # E'/(2 pi k b) / (1 - (x/b)^2), at most 8.4e-4 here; the rest is of second order.
    np.testing.assert_allclose(
        1.0 - traction / CRACK.normal_traction, 1e-3 / (2 * np.pi * (1 - x**2)), rtol=0.05
    )
    np.testing.assert_allclose(slip, CRACK.slip(x), rtol=2e-3)
    soft = 1e-4 * CRACK.modulus
    traction, slip = CRACK.elastic(x, soft, soft)
    ellipse = 4 / CRACK.modulus * np.sqrt(1 - x**2)
    np.testing.assert_allclose(traction, soft * CRACK.normal_traction * ellipse, rtol=1e-3)
    np.testing.assert_allclose(slip, CRACK.remote_shear * ellipse, rtol=1e-3)


@pytest.mark.parametrize(("order", "quadrature"), [(1, "nodal"), (1, "gauss"), (2, "nodal")])
@pytest.mark.parametrize("cell", ["quad", "tri"])
def test_slip_converges_with_order_one(cell, order, quadrature):
    """Cells grow less from one to the next where they are smaller, or the far field would not."""
    errors = []
    for size in (0.2, 0.1):
        found = solve(
            cell=cell, order=order, size=size, growth=1.0 + 3.0 * size, quadrature=quadrature
        )
        errors.append(found.slip_error(CRACK.slip(found.x)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.13)  # from below
    assert errors[1] < {1: 0.16, 2: 0.052}[order]


def test_error_of_the_finite_body_falls_with_the_square_of_its_size():
    """Between bodies of 10, 20 and 40 b the slip changes by amounts in the ratio 4."""
    middles = []
    for extent in (10.0, 20.0, 40.0):
        found = solve(extent=extent, order=2)
        middles.append(found.slip[np.argmin(np.abs(found.x))])
    first, second = -np.diff(middles)
    assert first / second == pytest.approx(4.0, rel=0.1)


# Largest deviation and oscillation of the default rule's normal tractions on these meshes. They
# come from the tips, whose singular field a leaning mesh does not separate from the pressure.
MEASURED = {
    ("quad", 1): (0.14, 0.006),
    ("quad", 2): (0.09, 0.011),
    ("tri", 1): (0.13, 0.035),
    ("tri", 2): (0.05, 0.011),
    ("hex", 1): (0.14, 0.006),
    ("tet", 1): (0.17, 0.037),
    ("hex", 2): (0.09, 0.011),
    ("tet", 2): (0.10, 0.016),  # vertices are tied as well, which ``nodal``, 0.06, leaves out
}
SOLID_OF_ORDER_2 = [("hex", 2), ("tet", 2)]


@pytest.mark.parametrize(
    ("cell", "order"),
    [pytest.param(*k, marks=[pytest.mark.slow] * (k in SOLID_OF_ORDER_2)) for k in MEASURED],
)
def test_default_rule_does_not_oscillate(cell, order):
    """Nor does it where the joint is a million times stiffer; Gauss points are worse by far."""
    deviation, oscillation = MEASURED[cell, order]
    mesh = {"cell": cell, "order": order, "size": 0.1}
    if cell in ("hex", "tet"):
        mesh["growth"] = 2.0
    for ratio in (1.0, 1e6):
        found = solve(ratio, **mesh)
        stiffness = ratio * CRACK.young / 0.1
        traction, _ = CRACK.elastic(found.x, stiffness, stiffness)
        assert found.deviation(traction, REACH) < deviation
        assert found.oscillation(traction, REACH) < oscillation
    gauss = solve(1e6, quadrature="gauss", **mesh)
    exact = CRACK.normal_traction
    assert gauss.deviation(exact, REACH) > 2.0 * found.deviation(exact, REACH)


@pytest.mark.mpi
@pytest.mark.parametrize(("cell", "order"), [("quad", 1), ("quad", 2), ("hex", 1)])
def test_tractions_are_uniform_on_a_mirrored_mesh(cell, order):
    """There slip and pressure separate, and uniform compression is the solution of the elements.

    Only the compliance of the joint is left, E/(k_n h) = 1e-6 over the cell next to the tip. At
    Gauss points the pressure does not come out uniform: the gap, zero at the tip and E/(k_n h)
    elsewhere, is interpolated, and the consistent forces make it overshoot from node to node.
    """
    mesh = {"cell": cell, "order": order, "size": 0.1, "lean": 0.0}
    assert solve(**mesh).deviation(CRACK.normal_traction, REACH) < 1e-5
    assert solve(quadrature="gauss", **mesh).deviation(CRACK.normal_traction, REACH) > 0.1


@pytest.mark.parametrize("ratio", [1.0, 10.0, 100.0])
def test_elastic_contact(ratio):
    """Normal tractions of a soft joint, in the middle half, away from the tips.

    At k_n h/E = 1 they are 2 % below those of the rigid contact.
    """
    found = solve(ratio, order=2, size=0.1)
    stiffness = ratio * CRACK.young / 0.1
    traction, _ = CRACK.elastic(found.x, stiffness, stiffness)
    assert found.deviation(traction, 0.5) < 3e-4


@pytest.mark.parametrize("angle", [30.0, 55.0])
def test_other_inclinations(angle):
    crack = InclinedCrack(angle_deg=angle)
    found = solve(crack=crack, order=2, size=0.1)
    assert found.slip_error(crack.slip(found.x)) < 0.04
    assert found.deviation(crack.normal_traction, 0.5) < 3e-4


@pytest.mark.mpi
def test_friction_holds_a_flat_crack():
    """Beyond psi = 90 - alpha = 60 degrees friction carries all of the shear.

    The tractions are then those of the body without a crack, t_n and tau, and the jump is
    elastic: tau / k_s.
    """
    crack = InclinedCrack(angle_deg=65.0)
    found = solve(1e6, crack=crack)
    inner = np.abs(found.x) < REACH
    elastic = crack.remote_shear / (1e6 * crack.young / 0.2)
    np.testing.assert_allclose(found.slip[inner], elastic, rtol=1e-4)
    assert found.deviation(crack.normal_traction, REACH) < 1e-4
