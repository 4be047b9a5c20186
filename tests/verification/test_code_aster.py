# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint laws against values printed in validation tests of code_aster.

top, moved   A unit cube on a joint; the other face of the joint is fixed. Sources are the command
 ______      files astest/ssnp162a.comm (JOINT_MECA_RUPT), ssnp162d.comm and ssnp162e.comm
| cube |     (JOINT_MECA_FROT), and ssnp118a.comm (CZM_EXP_REG) of code_aster, EDF R&D. The
|______|     meshes of the tests are turned by 30 degrees; the values are in axes of the joint.
////////  <- joint
"""

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import box

import dolfinx_joints as dj
from dolfinx_joints.laws.law import JointState

pytestmark = [
    pytest.mark.filterwarnings("ignore:Joint .* slip or opening"),
    pytest.mark.filterwarnings("ignore::dolfinx_joints.PlausibilityWarning"),
]


def forces(law, young, moved, times, path, *, cells=1):
    """Return the forces [N] on the moved face at some times; ``path`` gives its place [m]."""
    gdim = len(path(0.0))
    size, counts = [1.0] * (gdim - 1) + [2.0], [1] * (gdim - 1) + [2 * cells]
    mesh = box(size, counts, joints={"joint": (gdim - 1, 1.0)}, groups={"top": (gdim - 1, 2.0)})
    supports = [dj.Fixed(group="joint-")]
    for axis in range(gdim):

        def value(t, axis=axis):
            return path(t)[axis]

        supports.append(dj.Prescribed(group=moved, component="xyz"[axis], value=value))
    solid = dj.Elastic(young=young, poisson=0.0, density=0.0)
    model = dj.Model(mesh, material=solid, joints=law, supports=supports)
    simulation, reactions = dj.Simulation(model), []
    for time in times:
        state = simulation.quasi_statics([time])
        reactions.append(model.resultant(state.reaction, moved)[:gdim])
    return np.array(reactions)


def along(times, *values):
    """Return a path through values at times, linear between them."""
    table = np.array(values, dtype=float)
    return lambda t: [float(np.interp(t, times, column)) for column in table.T]


ADHESION, MU, KN, YOUNG = 1e5, 0.5, 1e12, 3e10
TENSION = ADHESION / MU
ELASTIC = TENSION / KN + TENSION / YOUNG  # elongation of joint and cube at the tension c / mu
FRICTION = dj.AdhesiveJoint(
    normal_stiffness=KN, shear_stiffness=2 * KN, friction_coefficient=MU, adhesion=ADHESION
)


def test_tension_of_an_adhesive_joint():
    """SSNP162D, mode I: printed 200000, 200000, -66666.6667 and 0 N."""
    moves = (0.0, ELASTIC, 2.0 * ELASTIC, -ELASTIC / 3.0, 0.0)
    path = along(range(5), *((0.0, move) for move in moves))
    normal = forces(FRICTION, YOUNG, "top", [1, 2, 3, 4], path)[:, 1]
    np.testing.assert_allclose(normal, [2e5, 2e5, -66666.6666667, 0.0], rtol=1e-9, atol=1e-3)


def test_slip_of_an_adhesive_joint():
    """SSNP162D, mode II: reference 1e5, -1.24444e6, 1.24444e6 N; printed 1 to 4e-4 more.

    code_aster needs a hardening of 1e-6 k_t in the direction of slip; `AdhesiveJoint` has none.
    """
    closed, slip = -ELASTIC / 3.0, 3.0 * ELASTIC
    places = ((0.0, 0.0), (slip, 0.0), (slip, closed), (-slip, closed), (slip, closed))
    shear = forces(FRICTION, YOUNG, "joint+", [1, 2, 3, 4], along(range(5), *places))[:, 0]
    limit = -KN * closed * MU + ADHESION
    np.testing.assert_allclose(shear[[0, 2, 3]], [ADHESION, -limit, limit], rtol=1e-9)
    np.testing.assert_allclose(
        shear[[0, 2, 3]], [100041.099959, -1244566.5998, 1244646.51058], rtol=5e-4
    )


def test_slip_in_two_directions():
    """SSNP162E: printed 0.97381768, -1.007477 and 1.007510 N in 45 increments.

    The hardening of 1e-7 N/m^3 in code_aster adds 1e-7 times the path of about 100 m.
    """
    law = dj.AdhesiveJoint(
        normal_stiffness=0.1, shear_stiffness=0.15, friction_coefficient=0.2, adhesion=0.1
    )
    closed, shear = -50.0, 20.0  # sigma / (mu k_n) and 2 sigma / k_n, sigma = 1 Pa

    def path(time):
        across = 0.0 if time <= 15.0 else np.interp(time, [0, 30, 60], [0, -closed / 3, -closed])
        slip = np.interp(time, [15, 30, 45, 60], [0.0, shear, -shear, shear])
        return [slip, float(across), float(np.interp(time, [0, 15], [0.0, closed]))]

    shears = forces(law, 2000.0, "top", range(1, 61), path)[[29, 44, 59], 0]
    np.testing.assert_allclose(shears, [0.97381768, -1.007477, 1.007510], rtol=1e-4)


def test_linear_softening():
    """SSNP162A, mode I: printed 1e5, 2e4, -2e5 and 0.009 N; unloading goes to the origin.

    JOINT_MECA_RUPT has a contact stiffness of 3 k_n, `CohesiveJoint` of k_n: under pressure the
    expected force is that of the formula in the file for a factor of 1, -1e5 N.
    """
    young, strength, softening = 3e12, 1e5, 0.5
    elastic, last = strength / KN + strength / young, (1.0 + softening) * strength / KN
    law = dj.CohesiveJoint(
        normal_stiffness=KN,
        shear_stiffness=2 * KN,
        friction_angle_deg=0.0,
        tensile_strength=strength,
        cohesion=strength,
        fracture_energy=0.5 * strength * last,
        shear_fracture_energy=strength * last,
        softening="linear",
    )
    moves = (0.0, elastic, 0.2 * elastic + 0.8 * last, -elastic, 0.99999999 * last)
    path = along(range(5), *((0.0, move) for move in moves))
    normal = forces(law, young, "top", [1, 2, 3, 4], path, cells=2)[:, 1]
    np.testing.assert_allclose(normal, [1e5, 2e4, -1e5, 9e-3], rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize(
    ("softening", "moved", "stress"),
    [("exponential", 2.5, 0.044991140), ("linear", 2.5 * 0.679895551, 0.092762954)],
)
def test_softening_behind_a_stiff_start(softening, moved, stress):
    """SSNP118A and D, mode I: the printed stress along x is 3/4 of the traction at 30 degrees.

    A bar of 1 m with E = 0.5 Pa is drawn by 2.5 m times a printed factor. CZM_EXP_REG and
    CZM_LIN_REG have a stiff start, as `CohesiveJoint` with a large stiffness. The bar snaps back on
    the way, hence only the law is evaluated, at the opening that the traction leaves.
    """
    traction = stress / math.cos(math.radians(30.0)) ** 2
    law = dj.CohesiveJoint(
        normal_stiffness=1e6,
        shear_stiffness=1e6,
        friction_angle_deg=0.0,
        tensile_strength=1.1,
        cohesion=1.1,
        fracture_energy=0.9,
        shear_fracture_energy=0.9,
        softening=softening,
    )
    gap = np.array([[moved - traction / 0.5, 0.0, 0.0]])
    at_rest = JointState.at_rest(np.zeros((1, 3)), variables=5)
    answer = law.backward_euler(gap, at_rest)
    assert answer.traction[0, 0] == pytest.approx(traction, rel=1e-5)
