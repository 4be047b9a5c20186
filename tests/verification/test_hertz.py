# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hertz's contact: two flat elastic bodies that meet on a joint with a parabolic initial gap.

          | | | P | | |                 half of it (2-D, plane strain), a quarter (3-D, on a
         _v_v_v_v_v_v_v_                nearly rigid floor); lateral sides free
        |    upper      |
    y=0 |_______________|  joint, gap x^2/(2 R) - c, in 3-D r^2/(2 R) - c
        |    lower      |
        |_______________|  base: vertical rollers

Exact for half-spaces and small a/R (Hertz 1881; Johnson, *Contact Mechanics*, 1985, sections 4.2
and 4.3), with 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2:

    line    a = sqrt(4 P R/(pi E*)),      p = p_0 sqrt(1 - x^2/a^2),  p_0 = 2 P/(pi a)
    point   a = (3 P R/(4 E*))^(1/3),     p = p_0 sqrt(1 - r^2/a^2),  p_0 = 3 P/(2 pi a^2)

The load is chosen for a = 1 m. The overlap c only moves the upper body up by c, and gives the first
iteration points that hold it. Half-widths are measured by the second moment of the pressure,
a^2 = 4 <x^2> and 5/2 <r^2>, which does not depend on where single points close.

What else is in the results than the mesh:
- finite bodies: +0.30 (a/L)^2 of a in 2-D (measured by doubling L), 1.9e-4 at L = 40 a;
- the joint's own compliance eps = E*/(k_n a): +0.47 eps of a (measured), eps 1e-4 at nodes and 1e-3
  at Gauss points.

Expected orders: p has a square-root edge, so that its error in L2 falls with h, whatever the order.
Gauss points are more than there are node pairs, and their tractions oscillate the more, the stiffer
the joint: on the coarse 3-D mesh p is off by 23 % in L2 at eps = 1e-2 and by 31 % at 1e-3, against
4 % at nodes. Resultants and half-widths do not suffer.
"""

from dataclasses import dataclass

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from boxes import COMM, box, largest
from dolfinx.mesh import DiagonalType

import dolfinx_joints as dj

RADIUS = 1e3  # R [m]; a/R = 1e-3
SOFT = dj.Elastic(young=10e9, poisson=0.3, density=0.0)
HARD = dj.Elastic(young=30e9, poisson=0.2, density=0.0)
FLOOR = dj.Elastic(young=30e13, poisson=0.2, density=0.0)
CELLS = ["quad", "tri"]
COMPLIANCE = {"nodal": 1e-4, "gauss": 1e-3}  # E*/(k_n a)


@dataclass(frozen=True, kw_only=True)
class Hertz:
    """Line contact per metre, or point contact, of the half-width a = 1 m.

    Attributes:
        bodies: Materials of the lower and the upper body.
        point: Whether it is a point contact.
    """

    bodies: tuple[dj.Elastic, dj.Elastic]
    point: bool = False

    @property
    def modulus(self):
        """E* [Pa]."""
        return 1.0 / sum((1.0 - body.poisson**2) / body.young for body in self.bodies)

    @property
    def load(self):
        """P [N/m] or [N]."""
        share = 4.0 / 3.0 if self.point else np.pi / 4.0
        return share * self.modulus / RADIUS

    @property
    def peak(self):
        """p_0 [Pa]."""
        return self.load * (1.5 if self.point else 2.0) / np.pi

    def pressure(self, r):
        """P at a distance from the middle [Pa]."""
        return self.peak * np.sqrt(np.maximum(1.0 - np.square(r), 0.0))


def lines(h, fine, length, growth):
    """Grid lines h apart up to about ``fine``, then ever farther apart, up to ``length``."""
    near = h * np.arange(round(fine / h) + 1)
    rest = length - near[-1]
    count = int(np.ceil(np.log1p(rest * (growth - 1.0) / (h * growth)) / np.log(growth)))
    widths = growth ** np.arange(1.0, count + 1)
    return np.concatenate([near, near[-1] + rest * np.cumsum(widths) / widths.sum()])


def stretched(corners, lines_of, cell, planes, **options):
    """Cells of whole numbers moved to grid lines, cut at height 0 into ``lower`` and ``upper``.

    ``lines_of`` has the lines of each direction, ``planes`` the direction and the number of each
    group.
    """
    low, high = corners
    counts = [b - a for a, b in zip(low, high, strict=True)]

    def place(x):
        moved = x.copy()
        for direction, positions in enumerate(lines_of):
            numbers = low[direction] + np.arange(len(positions))
            moved[:, direction] = np.interp(x[:, direction], numbers, positions)
        return moved

    up = len(low) - 1
    return box(
        corners,
        counts,
        cell,
        joints={"joint_1": (up, 0)},
        groups=planes,
        cells={"lower": (low[up], 0), "upper": (0, high[up])},
        place=place,
        **options,
    )


def strip(cell, h, length):
    """Half of two bodies, length x length each, the axis at x = 0."""
    across, up = lines(h, 1.4, length, 1.3), lines(h, 0.4, length, 1.3)
    n, m = len(across) - 1, len(up) - 1
    grid, planes = [across, np.concatenate([-up[:0:-1], up])], {"axis": (0, 0), "base": (1, -m)}
    kind = {"quad": "quadrilateral", "tri": "triangle"}[cell]
    # Crossed triangles have no direction of their own, and mirror each other at the joint.
    crossed = DiagonalType.crossed
    return stretched([[0, -m], [n, m]], grid, kind, planes | {"top": (1, m)}, diagonal=crossed)


def block(h, length):
    """A quarter of a body, length x length x length, on one layer of floor."""
    across, up = lines(h, 1.25, length, 1.5), lines(h, 0.5, length, 1.5)
    n, m = len(across) - 1, len(up) - 1
    grid = [across, across, np.concatenate([[-h], up])]
    planes = {"axis": (0, 0), "axis_y": (1, 0), "base": (2, -1), "top": (2, m)}
    return stretched([[0, 0, -1], [n, n, m]], grid, "hexahedron", planes)


@dataclass(frozen=True, kw_only=True)
class Found:
    """Computed contact, relative to the exact one.

    Attributes:
        load: P found over P applied, less 1.
        width: Half-width by the second moment, less 1.
        middle: Pressure next to the middle over the exact one there, less 1.
        profile: Error of the pressure in L2.
        closed: Distance of the farthest closed point over a.
    """

    load: float
    width: float
    middle: float
    profile: float
    closed: float


def measure(exact, model, joints):
    """What was computed (collective)."""
    operator, integral = model.contact.operator, model.contact.integral
    share = 4 if exact.point else 2
    pressure = -joints.traction[:, 0]
    r = np.linalg.norm(operator.points[:, : model.gdim - 1], axis=1)
    load, expected = integral(pressure), exact.pressure(r)
    moment = 2.5 if exact.point else 4.0
    nearest = np.argsort(r)[:1]
    near = min(
        p
        for part in COMM.allgather([*zip(r[nearest], pressure[nearest], strict=True)])
        for p in part
    )
    distance = integral((pressure - expected) ** 2) / integral(expected**2)
    return Found(
        load=load / (exact.load / share) - 1.0,
        width=np.sqrt(moment * integral(pressure * r**2) / load) - 1.0,
        middle=near[1] / exact.pressure(near[0]) - 1.0,
        profile=np.sqrt(distance),
        closed=COMM.allreduce(float(r[pressure > 0].max(initial=0.0)), op=MPI.MAX),
    )


def parabola(point):
    """The initial gap, with the overlap c = a^2/R [m]."""
    return lambda x: (x[:, 0] ** 2 + point * x[:, 1] ** 2) / (2 * RADIUS) - 1.0 / RADIUS


def line_contact(cell="quad", order=1, *, quadrature="nodal", cells=9.5, length=40.0, eps=None):
    """``cells`` of them in a half-width a, so that the edge of the contact is within one."""
    exact = Hertz(bodies=(HARD, SOFT))
    model = dj.Model(
        strip(cell, 1.0 / cells, length),
        material=dict(zip(("lower", "upper"), exact.bodies, strict=True)),
        joints=dj.Joints(
            joint(exact, eps or COMPLIANCE[quadrature]),
            initial_gaps={"joint_1": parabola(False)},
            quadrature=quadrature,
        ),
        body=dj.Body(degree=order),
        supports=[dj.Fixed(group="axis", components="x"), dj.Fixed(group="base", components="y")],
        loads=[dj.Pressure(group="top", value=exact.load / 2 / length)],
    )
    return measure(exact, model, dj.Simulation(model).statics().joints)


def point_contact(quadrature, *, eps, cells=4.5, length=8.0):
    """A quarter of a body on the floor, hexahedra of order 1."""
    exact = Hertz(bodies=(FLOOR, HARD), point=True)
    model = dj.Model(
        block(1.0 / cells, length),
        material=dict(zip(("lower", "upper"), exact.bodies, strict=True)),
        joints=dj.Joints(
            joint(exact, eps),
            initial_gaps={"joint_1": parabola(True)},
            quadrature=quadrature,
        ),
        supports=[
            dj.Fixed(group="axis", components="x"),
            dj.Fixed(group="axis_y", components="y"),
            dj.Fixed(group="base"),
        ],
        loads=[dj.Pressure(group="top", value=exact.load / 4 / length**2)],
    )
    return measure(exact, model, dj.Simulation(model).statics().joints)


def joint(exact, eps):
    """The joint with E*/(k_n a) = eps."""
    return dj.frictionless(normal_stiffness=exact.modulus / eps)


def test_exact_solution():
    """By hand: E* = 1/(0.96/30 + 0.91/10) = 8.1301 GPa; the pressure integrates to the load."""
    line, point = Hertz(bodies=(HARD, SOFT)), Hertz(bodies=(HARD, SOFT), point=True)
    assert line.modulus == pytest.approx(8.130081e9, rel=1e-6)
    assert np.sqrt(4 * line.load * RADIUS / (np.pi * line.modulus)) == pytest.approx(1.0)
    assert (3 * point.load * RADIUS / (4 * line.modulus)) ** (1 / 3) == pytest.approx(1.0)
    angle = np.pi * (np.arange(2000) + 0.5) / 2000 / 2  # x = sin(angle)
    x, weight = np.sin(angle), np.cos(angle) * np.pi / 4000
    assert 2 * weight @ line.pressure(x) == pytest.approx(line.load, rel=1e-6)
    assert 2 * np.pi * (weight * x) @ point.pressure(x) == pytest.approx(point.load, rel=1e-6)
    moment = 2 * weight @ (line.pressure(x) * x**2) / line.load
    assert 4 * moment == pytest.approx(1.0, rel=1e-6)
    moment = 2 * np.pi * (weight * x) @ (point.pressure(x) * x**2) / point.load
    assert 2.5 * moment == pytest.approx(1.0, rel=1e-6)


# Measured errors, rounded up: of half-width and pressure in the middle over (h/a)^2, of the profile
# over h/a.
BOUNDS = {
    (1, "nodal"): (0.15, 0.12),
    (1, "gauss"): (0.4, 1.0),
    (2, "nodal"): (0.06, 0.25),
    (2, "gauss"): (0.08, 1.1),
}
CASES = [(cell, *key) for cell in CELLS for key in BOUNDS]
ON_RANKS = [("quad", 1, "nodal"), ("tri", 2, "gauss")]


@pytest.mark.parametrize(
    ("cell", "order", "quadrature"),
    [pytest.param(*case, marks=[pytest.mark.mpi] * (case in ON_RANKS)) for case in CASES],
)
def test_line_contact(cell, order, quadrature):
    h = 1 / 9.5
    found = line_contact(cell, order, quadrature=quadrature)
    square, profile = BOUNDS[order, quadrature]
    rest = 2e-4 + 0.5 * COMPLIANCE[quadrature]  # finite bodies and joint, see above
    assert abs(found.load) < 1e-10
    assert abs(found.width) < square * h**2 + rest
    assert abs(found.middle) < square * h**2 + rest
    assert found.profile < profile * h
    assert abs(found.closed - 1.0) < h


@pytest.mark.parametrize(("cell", "order", "quadrature"), CASES)
def test_line_contact_converges_with_the_mesh(cell, order, quadrature):
    cells = np.array([4.5, 6.5, 9.5])
    found = [line_contact(cell, order, quadrature=quadrature, cells=n) for n in cells]
    profile = [f.profile for f in found]
    rate = -np.polyfit(np.log(cells), np.log(profile), 1)[0]
    assert rate == pytest.approx(1.0, abs=0.15)
    assert max(abs(f.load) for f in found) < 1e-10


def test_effect_of_finite_bodies():
    """It falls with (a/L)^2 as the strain at the contact from the far sides does."""
    widths = [line_contact(order=2, length=length).width for length in (10.0, 20.0, 40.0)]
    first, second = -np.diff(widths)
    assert first / second == pytest.approx(4.0, rel=0.1)
    assert 0.0 < second / 3 < 2e-4


def test_effect_of_the_joint_compliance():
    """A soft joint spreads the contact, by an amount that vanishes with 1/k_n."""
    sizes = (1e-2, 1e-3, 1e-5)
    soft, medium, stiff = (line_contact(order=2, eps=eps).width for eps in sizes)
    assert soft - stiff == pytest.approx(0.47e-2, rel=0.1)
    assert medium - stiff == pytest.approx(0.47e-3, rel=0.1)


@pytest.mark.parametrize("quadrature", ["nodal", "gauss"])
@pytest.mark.parametrize(("cell", "order"), [("quad", 1), ("tri", 2)])
def test_friction_does_not_matter_between_equal_bodies(cell, order, quadrature):
    """The bodies mirror each other when pressed together, so nothing slides on the joint."""
    exact = Hertz(bodies=(HARD, HARD))
    normal = exact.modulus / COMPLIANCE[quadrature]
    jointed = strip(cell, 1 / 4.5, 10.0)

    def press(shear, angle):
        law = dj.FrictionNoTension(
            normal_stiffness=normal, shear_stiffness=shear, friction_angle_deg=angle
        )
        supports = [
            dj.Fixed(group="axis", components="x"),
            dj.Fixed(group="base", components="y"),
            dj.Prescribed(group="top", component="y", value=lambda _: -3.0 / RADIUS),
        ]
        model = dj.Model(
            jointed,
            material=HARD,
            joints=dj.Joints(law, initial_gaps={"joint_1": parabola(False)}, quadrature=quadrature),
            body=dj.Body(degree=order),
            supports=supports,
        )
        state = dj.Simulation(model).statics()
        load = model.contact.integral(-state.joints.traction[:, 0])
        assert -model.resultant(state.reaction, "top")[1] == pytest.approx(load, rel=1e-10)
        return model, state.joints.traction

    _, smooth = press(0.0, 0.0)
    model, rough = press(normal, 30.0)
    assert largest(rough - smooth) < 1e-9 * largest(smooth[:, 0])
    assert model.contact.integral(rough[:, 0] < 0) > 0.5


@pytest.mark.mpi
def test_point_contact():
    """The finite body adds some 1e-3 of a (measured by doubling L), the joint 0.5e-3."""
    h = 1 / 4.5
    found = point_contact("nodal", eps=1e-3)
    assert abs(found.load) < 1e-10
    assert abs(found.width) < 0.25 * h**2 + 2e-3
    assert abs(found.middle) < 0.1 * h**2 + 2e-3
    assert found.profile < 0.25 * h
    assert abs(found.closed - 1.0) < h


def test_point_contact_with_gauss_points():
    """Point values oscillate, see above, so the profile is not compared."""
    h = 1 / 4.5
    found = point_contact("gauss", eps=1e-2)
    assert abs(found.load) < 1e-10
    assert abs(found.width) < 0.35 * h**2 + 5e-3
    assert abs(found.middle) < 0.1 * h**2 + 5e-3
    assert abs(found.closed - 1.0) < h
