# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""A pad on an incline, below and beyond the limit of friction, held by springs along its top.

             springs k_t          z
          ~~\/\/\~~~~~~~~~~~      | g, turned by theta
         |  pad, H          |     |/
         |__________________|     '--> x
         |  slab, h         |
         ////////////////////

The plane stays level and the load is turned. Every point of a level plane does the same: the bodies
have no lateral contraction (nu = 0), and the complementary shear is applied to their sides, so that
no edge disturbs it. Balance of forces with the shear traction tau, positive as it drags the slab
downhill, gives along the slope

    tau(z) = shear load above z - k_t u(top),
    u(top) = integral of tau/G over slab and pad + slip,
    slip = tau_j/k_s (sticks), or tau_j = mu p (slides),

linear equations for u(top), solved in `Incline`. With a dead load on the top of a weightless pad
the displacement is linear in z and all elements hold it; with self weight it is quadratic, and
those of order 2 do. What is left is rounding, and the tolerance of Newton's method.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import ufl

pytest.importorskip("dolfinx")


from boxes import COMM, largest

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.geometry.two_blocks import two_blocks

LENGTH, WIDTH = 2.0, 1.0  # of the pad [m]
MU = math.tan(math.radians(30.0))


@dataclass(frozen=True, kw_only=True)
class Incline:
    """The exact solution, for tan(theta) = ``share`` mu.

    Attributes:
        share: 1 at the limit of the pad without springs.
        spring: k_t of the springs along the top [Pa/m].
        dead_load: Weight per area on the top of a weightless pad; 0 for self weight [Pa].
        density: Of pad and slab [kg/m^3].
        young: E; nu is zero [Pa].
        pad: H [m].
        slab: h [m].
        shear_stiffness: k_s of the joint [Pa/m].
        hardening: k_h, by which the shear strength grows with the slip; should be zero [Pa/m].
    """

    share: float
    spring: float
    dead_load: float = 0.0
    density: float = 0.0
    young: float = 30e9
    pad: float = 0.2
    slab: float = 0.1
    shear_stiffness: float = 4e9
    hardening: float = 0.0
    gravity: float = 9.81

    @property
    def theta(self):
        """Slope [rad]."""
        return math.atan(self.share * MU)

    @property
    def shear_modulus(self):
        """G at nu = 0, [Pa]."""
        return 0.5 * self.young

    def weight(self, z):
        """Weight per area above a level z [Pa]."""
        return self.dead_load + self.density * self.gravity * (self.pad + self.slab - z)

    @property
    def pressure(self):
        """P on the joint [Pa]."""
        return self.weight(self.slab) * math.cos(self.theta)

    @property
    def bulk_compliance(self):
        """Of slab and pad in shear, per traction along the top [m/Pa]."""
        return (self.pad + self.slab) / self.shear_modulus

    @property
    def bulk_shift(self):
        """Displacement of the top by the shear of slab and pad under the load alone [m]."""
        height = self.pad + self.slab
        mean = self.dead_load + 0.5 * self.density * self.gravity * height
        return mean * height * math.sin(self.theta) / self.shear_modulus

    @property
    def _sticking_top(self):
        load = self.weight(self.slab) * math.sin(self.theta)
        shift = self.bulk_shift + load / self.shear_stiffness
        compliance = self.bulk_compliance + 1.0 / self.shear_stiffness
        return shift / (1.0 + self.spring * compliance)

    @property
    def _sliding_top(self):
        # load - k_t top = mu p + k_h slip, slip = top (1 + C k_t) - shift
        load, k_h = self.weight(self.slab) * math.sin(self.theta), self.hardening
        right = load - MU * self.pressure + k_h * self.bulk_shift
        return right / (self.spring + k_h * (1.0 + self.bulk_compliance * self.spring))

    @property
    def slides(self):
        """Whether the shear of the sticking joint is beyond mu p."""
        load = self.weight(self.slab) * math.sin(self.theta)
        return load - self.spring * self._sticking_top > MU * self.pressure

    @property
    def top(self):
        """Displacement of the top down the slope [m]."""
        return self._sliding_top if self.slides else self._sticking_top

    def shear(self, z):
        """Tau at a level, a number or UFL's, [Pa]."""
        return self.weight(z) * math.sin(self.theta) - self.spring * self.top

    @property
    def slip(self):
        """Tangential gap of the joint, elastic part included [m]."""
        bulk = self.bulk_shift - self.bulk_compliance * self.spring * self.top
        return self.top - bulk


def holding(incline, *, slip):
    """The incline with springs that stop a sliding pad after a slip [m] (rigid bodies)."""
    load = incline.weight(incline.slab) * math.sin(incline.theta)
    return replace(incline, spring=(load - MU * incline.pressure) / slip)


@cache
def blocks(cell, order):
    """The mesh."""
    sizes = {"length": LENGTH, "width": WIDTH, "size": 0.5, "cell": cell, "order": order}
    return mesh_of(two_blocks, lower_height=Incline.slab, upper_height=Incline.pad, **sizes)


def side_shear(jointed, down, tau, factor=lambda _: 1.0):
    """The complementary shear tau(z), a function of UFL's z, on the sides."""

    def form(v):
        z = ufl.SpatialCoordinate(jointed.mesh)[2]
        n = ufl.FacetNormal(jointed.mesh)
        outwards = down[0] * n[0] + down[1] * n[1]
        return tau(z) * outwards * v[2] * jointed.ds("sides")

    return dj.FormLoad(form=form, factor=factor)


def friction(incline):
    """The law of the joint."""
    return dj.FrictionNoTension(
        normal_stiffness=1e10,
        shear_stiffness=incline.shear_stiffness,
        friction_angle_deg=30.0,
    )


def simulation(incline, loads, *, cell="hex", order=1, rule="auto", law=None):
    """Slab, joint, pad and springs, under loads that are made from the mesh."""
    jointed = blocks(cell, order)
    springs = dj.Spring(group="top", normal_stiffness=0.0, tangential_stiffness=incline.spring)
    model = dj.Model(
        jointed,
        material=dj.Elastic(young=incline.young, poisson=0.0, density=incline.density),
        joints=dj.Joints(law or friction(incline), quadrature=rule),
        supports=[dj.Fixed(group="base"), springs],
        loads=[load(jointed) for load in loads],
    )
    return dj.Simulation(model)


def axes_of(direction_deg):
    """Unit vectors downhill and across in the plane, as rows."""
    c, s = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
    return np.array([[c, s], [-s, c]])


def settle(incline, direction_deg=0.0, **options):
    """Slip of each point of the rank (downhill, across), shape (n, 2), [m], and the points."""
    axes = axes_of(direction_deg)
    pull = np.array([*(math.sin(incline.theta) * axes[0]), -math.cos(incline.theta)])
    loads = [
        lambda _: dj.Gravity(acceleration=incline.gravity * pull),
        lambda _: dj.Traction(group="top", value=incline.dead_load * pull),
        lambda jointed: side_shear(jointed, axes[0], incline.shear),
    ]
    run = simulation(incline, loads, **options)
    joints = run.statics().joints
    return joints.state.gap[:, 1:] @ axes.T, run.model.contact.counts(joints.status)


def mean_of_all(values):
    """Mean over the points of all ranks."""
    total = COMM.allreduce(np.array([values.sum(), len(values)]))
    return total[0] / total[1]


def check(incline, slip, counts, tolerance):
    """The exact slip at every point, none across, and all points of one kind."""
    assert largest(slip - [incline.slip, 0.0]) < tolerance * incline.slip
    assert counts.total == (counts.slip if incline.slides else counts.stick)


ELEMENTS = [
    *itertools.product(["hex"], [1, 2], ["nodal", "gauss"]),
    *[("tet", 1, "nodal"), ("tet", 1, "gauss"), ("tet", 2, "gauss")],
]
# Springs that stop a rigid pad after 10 mm at 101 % of the limit.
DEAD_LOAD = holding(Incline(share=1.01, spring=0.0, dead_load=1e6), slip=0.01)
SELF_WEIGHT = holding(Incline(share=1.01, spring=0.0, density=2400.0), slip=0.01)


def test_limit_by_hand():
    """1 MPa at tan(theta) = 1.01 tan(30 deg) = 0.583124.

    cos(theta) = 0.863863, sin(theta) = 0.503739, mu p = 0.498752 MPa: 4987.5 Pa are left for the
    springs, which take them at 10 mm with 498 753 Pa/m. Bulk and joint, C + 1/k_s = 0.3/15e9 +
    1/4e9 = 2.7e-10 m/Pa, are 1e-4 of that soft. At 99 %, sin(theta) = 0.49624, they take 0.135 mm
    of shear, 0.124 mm of it in the joint.
    """
    assert DEAD_LOAD.spring == pytest.approx(498753.0, rel=1e-5)
    assert DEAD_LOAD.slides
    assert DEAD_LOAD.slip == pytest.approx(0.01, rel=2e-3)
    below = replace(DEAD_LOAD, share=0.99)
    assert not below.slides
    assert below.slip == pytest.approx(0.124e-3, rel=2e-3)


@pytest.mark.parametrize(
    ("element", "share"),
    [*itertools.product(ELEMENTS, [0.99, 1.01]), (ELEMENTS[0], 0.5), (ELEMENTS[0], 1.04)],
)
def test_below_and_beyond_the_limit(element, share):
    """Sticking: rounding. Sliding: the springs are 1e6 times softer than the cells, E/h.

    Rounding of the forces between the cells, 1e-16 of E/h per metre of displacement, is 1e-10 of
    theirs.
    """
    incline = replace(DEAD_LOAD, share=share)
    cell, order, rule = element
    slip, counts = settle(incline, 35.0, cell=cell, order=order, rule=rule)
    assert incline.slides == (share > 1.0)
    check(incline, slip, counts, 2e-9 if incline.slides else 1e-12)


@pytest.mark.parametrize("direction", [0.0, 90.0, 145.0, 200.0, 330.0])
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_every_direction_down_the_plane(share, direction):
    incline = replace(DEAD_LOAD, share=share)
    check(incline, *settle(incline, direction, cell="tet"), 2e-9 if incline.slides else 1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("share", [0.99, 1.01])
@pytest.mark.parametrize(("cell", "rule"), [("hex", "nodal"), ("hex", "gauss"), ("tet", "gauss")])
def test_self_weight(cell, rule, share):
    """Elements of order 2 hold its quadratic displacements. The springs are 1e8 times softer."""
    incline = replace(SELF_WEIGHT, share=share)
    slip, counts = settle(incline, 35.0, cell=cell, order=2, rule=rule)
    check(incline, slip, counts, 3e-7 if incline.slides else 1e-12)


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_self_weight_on_elements_of_order_1(cell):
    """They miss some of the shear of the bodies, which is 3e-6 of the slip."""
    slip, counts = settle(SELF_WEIGHT, 35.0, cell=cell)
    check(SELF_WEIGHT, slip, counts, 1e-6)


@pytest.mark.mpi
def test_load_taken_away_and_reversed():
    """The pad slides, stays where it is as the shear goes to 30 %, and slides back as far.

    The pressure stays. From the slip the load leaves elastically, as in the sticking state of
    `Incline`; the sliding state does not depend on the way there.
    """
    incline, axes = DEAD_LOAD, axes_of(35.0)
    load = incline.dead_load * math.sin(incline.theta)
    compliance = incline.bulk_compliance + 1.0 / incline.shear_stiffness
    back = -0.7 * load
    top_back = back * compliance / (1.0 + incline.spring * compliance)
    slip_back = (back - incline.spring * top_back) / incline.shear_stiffness
    tops = {1.0: incline.top, 0.3: incline.top + top_back, -1.0: -incline.top}
    slips = {1.0: incline.slip, 0.3: incline.slip + slip_back, -1.0: -incline.slip}

    def along_sides(share):
        return share * load - incline.spring * tops[share]

    loads = [
        lambda _: dj.Traction(group="top", value=(0.0, 0.0, -incline.pressure)),
        lambda _: dj.Traction(group="top", value=(*(load * axes[0]), 0.0), factor=lambda t: t),
        lambda jointed: side_shear(jointed, axes[0], lambda _: 1.0, along_sides),
    ]
    run = simulation(incline, loads)
    for share in (1.0, 0.3, -1.0):
        joints = run.quasi_statics([share]).joints
        slip = joints.state.gap[:, 1:] @ axes.T
        assert largest(slip - [slips[share], 0.0]) < 2e-9 * incline.slip
        counts = run.model.contact.counts(joints.status)
        assert counts.total == (counts.stick if share == 0.3 else counts.slip)


@dataclass(frozen=True)
class HardeningFriction:
    """Friction whose strength grows with the slip, to see what that would do."""

    friction: dj.FrictionNoTension
    hardening: float  # Pa/m

    def backward_euler(self, gap, state):
        answer = self.friction.backward_euler(gap, state)
        traction, tangent = answer.traction.copy(), answer.tangent.copy()
        traction[:, 1:] += self.hardening * gap[:, 1:]
        tangent[:, 1:, 1:] += self.hardening * np.eye(2)
        return replace(answer, traction=traction, tangent=tangent)

    def stored_energy(self, state):
        return self.friction.stored_energy(state)

    def closed_stiffness(self):
        return self.friction.closed_stiffness()


def test_there_is_no_hardening():
    """Twice the springs' stiffness of it would leave a third of the slip, and would be noticed.

    The slip of the law as it is gives back a hardening k_h = (tau_j - mu p) / slip of zero, to the
    tolerance of the slip.
    """
    hardened = replace(DEAD_LOAD, hardening=2.0 * DEAD_LOAD.spring)
    assert hardened.slip == pytest.approx(DEAD_LOAD.slip / 3.0, rel=1e-3)
    law = HardeningFriction(friction(DEAD_LOAD), hardened.hardening)
    slip, counts = settle(hardened, law=law)
    check(hardened, slip, counts, 2e-9)
    slip = mean_of_all(settle(DEAD_LOAD)[0][:, 0])
    top = (slip + DEAD_LOAD.bulk_shift) / (1.0 + DEAD_LOAD.bulk_compliance * DEAD_LOAD.spring)
    shear = DEAD_LOAD.dead_load * math.sin(DEAD_LOAD.theta) - DEAD_LOAD.spring * top
    found = (shear - MU * DEAD_LOAD.pressure) / slip
    assert abs(found) < 2e-9 * DEAD_LOAD.spring
