# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The least thickness, and the least friction, with which a semicircular arch stands.

             . - o - .            joints radial, no tension, Coulomb friction; self weight
          .'   _____   `.         R radius of the centre line, t thickness
         /   .'     `.   \\        o  hinges at the limit: crown at the extrados, haunches at
        /   o         o   \\          the intrados, springings at the extrados
       o___|           |___o

Exact limits, of rigid blocks without crushing, by the static theorem: the arch stands if and only
if some thrust line in equilibrium with the weights lies within the thickness at every joint.

- Continuous arch: the thrust H at the crown's extrados that closes the springing's extrados,
  H_s = W(pi/2) - S/r_o, must reach what every joint angle b asks for at its intrados,
  H(b) = (W(b) r_i sin b - S (1 - cos b)) / (r_o - r_i cos b), with W(b) = (r_o^2 - r_i^2) b/2 and
  S = (r_o^3 - r_i^3)/3. The least t/R is Milankovitch's, 0.1075 with the hinge at 54.5 degrees
  (1907; Heyman's 0.106 takes the weight along the centre line and the hinge at its tangent).
- n voussoirs: the same theorem as a linear program in N, V, M of each joint, |M| <= N t_e/2 and
  |V| <= mu N, with the exact weights and centroids; t is then found by bisection. t_e is the
  distance of the outermost joint points, t for a nodal rule. Gauss points are inside: of c cells
  through the thickness, the outermost is (1 - 1/sqrt(3)) t/2c from the edge for two points in a
  facet, (1 - sqrt(3/5)) t/2c for three, so t_e = t (1 - 0.42265/c) and t (1 - 0.22540/c).

The forces of a no-tension material are proportional to the loads, and blocks on elastic joints
reach equilibrium if rigid ones can: the limits depend on no stiffness.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from boxes import COMM
from scipy.optimize import brentq, linprog, minimize_scalar

import dolfinx_joints as dj
from benchmarks.shared.scenes import mesh_of
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.geometry.voussoir_arch import voussoir_arch

RADIUS, DENSITY, GRAVITY = 10.0, 2400.0, 9.80665  # m, kg/m^3, m/s^2
GAUSS = {1: 1.0 - 1.0 / math.sqrt(3.0), 2: 1.0 - math.sqrt(0.6)}  # by order of the elements
K_N = 1e10  # Pa/m
# Relative distance from the limit at which the computed arch must stand and fall. Newton accepts
# residuals of up to 1e-6 of the forces where rounding leaves no less, and next to the limit the
# thickness answers them by some ten times as much; nodes of order 2 are off the arcs by 1e-5.
BAND = 1e-4


@dataclass(frozen=True, kw_only=True)
class Semicircle:
    """A semicircular arch of rigid voussoirs, R = 1 and unit weight per area.

    Attributes:
        voussoirs: n.
        thickness: t/R.
        chords: Straight edges that bound a voussoir along its arcs, None for true arcs.
        friction: mu.
        effective: t_e/t.
        lateral: Horizontal load as a share of the weight.
    """

    voussoirs: int
    thickness: float
    chords: int | None = None
    friction: float = 1.0
    effective: float = 1.0
    lateral: float = 0.0

    @property
    def joint_angles(self):
        """From the crown, positive to the right, shape (n + 1,)."""
        return np.pi * (np.arange(self.voussoirs + 1) / self.voussoirs - 0.5)

    @property
    def weight(self):
        """Weight of a voussoir: its area, of a sector or of the trapezoids between chords."""
        outer, inner = 1.0 + self.thickness / 2, 1.0 - self.thickness / 2
        angle = np.pi / self.voussoirs
        if self.chords is not None:
            angle = self.chords * math.sin(angle / self.chords)
        return (outer**2 - inner**2) / 2 * angle

    @property
    def centroids(self):
        """Centroids (x, y) of the voussoirs, shape (n, 2).

        A triangle at the centre has its own at 2/3 of its height r cos(d/2), d the angle of a
        chord; a ring of them, and a sector, follow by differences.
        """
        outer, inner = 1.0 + self.thickness / 2, 1.0 - self.thickness / 2
        half = np.pi / self.voussoirs / 2
        if self.chords is None:
            along = 2 * math.sin(half) / self.weight
        else:
            part = half / self.chords
            shares = part * (2 * np.arange(self.chords) + 1) - half
            along = self.chords * math.sin(2 * part) * math.cos(part) / self.weight
            along *= np.cos(shares).mean()
        distance = (outer**3 - inner**3) / 3 * along
        middle = (self.joint_angles[1:] + self.joint_angles[:-1]) / 2
        return distance * np.column_stack([np.sin(middle), np.cos(middle)])

    def equilibrium(self):
        """A, b of A x = b for x = (N, V, M of every joint), three rows for each voussoir."""
        sin, cos = np.sin(self.joint_angles), np.cos(self.joint_angles)
        along, radial = np.column_stack([cos, -sin]), np.column_stack([sin, cos])
        rows = np.zeros((self.voussoirs, 3, self.voussoirs + 1, 3))
        for side, sign in ((0, 1.0), (1, -1.0)):
            for k in range(self.voussoirs):
                joint = k + side
                arm = radial[joint] - self.centroids[k]
                for column, force in enumerate((along[joint], radial[joint])):
                    moment = arm[0] * force[1] - arm[1] * force[0]
                    rows[k, :, joint, column] = sign * np.array([*force, moment])
                rows[k, 2, joint, 2] = sign
        right = np.tile([-self.lateral * self.weight, self.weight, 0.0], self.voussoirs)
        return rows.reshape(3 * self.voussoirs, -1), right

    def margin(self):
        """Largest s with |M| <= N t_e/2 - s W and |V| <= mu N - s W; it stands where s >= 0."""
        matrix, right = self.equilibrium()
        joints = self.voussoirs + 1
        half = self.effective * self.thickness / 2
        cone = [[-half, 0, 1], [-half, 0, -1], [-self.friction, 1, 0], [-self.friction, -1, 0]]
        bounds = np.kron(np.eye(joints), np.array(cone))
        solution = linprog(
            np.append(np.zeros(3 * joints), -1.0),
            A_ub=np.column_stack([bounds, np.full(4 * joints, self.weight)]),
            b_ub=np.zeros(4 * joints),
            A_eq=np.column_stack([matrix, np.zeros(len(matrix))]),
            b_eq=right,
            bounds=(None, None),
            method="highs",
        )
        assert solution.status == 0, solution.message
        return -solution.fun


def limit_thickness(voussoirs, **more):
    """The least t/R with which the arch stands, to 1e-10."""
    return brentq(
        lambda t: Semicircle(voussoirs=voussoirs, thickness=t, **more).margin(),
        0.05,
        0.5,
        xtol=1e-11,
    )


def limit_friction(voussoirs, thickness, **more):
    """The least mu with which the arch stands, to 1e-10."""

    def margin(mu):
        arch = Semicircle(voussoirs=voussoirs, thickness=thickness, friction=mu, **more)
        return arch.margin()

    return brentq(margin, 0.1, 0.9, xtol=1e-11)


def milankovitch():
    """Limit t/R of the continuous arch, and the angle of its haunch hinge [degrees]."""

    def asked(b, t):
        outer, inner = 1.0 + t / 2, 1.0 - t / 2
        weight, static = (outer**2 - inner**2) / 2 * b, (outer**3 - inner**3) / 3
        lever = outer - inner * math.cos(b)
        return (weight * inner * math.sin(b) - static * (1.0 - math.cos(b))) / lever

    def worst(t):
        options = {"xatol": 1e-12}
        return minimize_scalar(lambda b: -asked(b, t), bounds=(0.2, 1.5), options=options)

    def excess(t):
        outer, inner = 1.0 + t / 2, 1.0 - t / 2
        springing = (outer**2 - inner**2) * np.pi / 4 - (outer**3 - inner**3) / 3 / outer
        return springing + worst(t).fun

    limit = brentq(excess, 0.05, 0.3, xtol=1e-14)
    return limit, math.degrees(worst(limit).x)


def simulation(
    thickness,
    voussoirs,
    *,
    divisions=(1, 1, 1),
    order=1,
    cell="hex",
    width=None,
    quadrature="nodal",
    friction=1.0,
    shear=1.0,
    rigidity=1e4,
    law=dj.FrictionNoTension,
    lateral=None,
):
    """The arch under self weight, t/R given, k_s = shear k_n and E = rigidity k_n t."""
    angle = math.degrees(math.atan(friction))
    t = thickness * RADIUS
    stiffness = {"normal_stiffness": K_N, "shear_stiffness": shear * K_N}
    if law is dj.RigidJoint:
        stiffness = {}
    shape = {"radius": RADIUS, "thickness": t, "voussoirs": voussoirs, "width": width}
    model = dj.Model(
        mesh_of(voussoir_arch, divisions=divisions, order=order, cell=cell, **shape),
        material=dj.Elastic(young=rigidity * K_N * t, poisson=0.2, density=DENSITY),
        joints=dj.Joints(law(friction_angle_deg=angle, **stiffness), quadrature=quadrature),
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity(), *(lateral or ())],
    )
    return dj.Simulation(model)


def stands(*args, **more):
    """Whether a static equilibrium is found; on a mechanism Newton does not converge."""
    try:
        simulation(*args, **more).statics()
    except dj.ConvergenceError:
        return False
    return True


def resultants(model, joints):
    """(N, V, M) of each joint about the centre line, shape (n + 1, 3), R = 1 and unit weights.

    N is positive in compression, and V the radial force of the left on the right side.
    """
    operator = model.contact.operator
    force = np.einsum("nij,ni,n->nj", operator.frames, -joints.traction, operator.areas)
    gathered = [operator.gather(a) for a in (operator.points, operator.frames, force)]
    number = operator.gather(operator.joint)

    def add():
        points, frames, on_plus = (a[..., [0, model.gdim - 1]] for a in gathered)
        angle = Semicircle(voussoirs=len(operator.names) - 1, thickness=1).joint_angles[number]
        along = np.column_stack([np.cos(angle), -np.sin(angle)])
        radial = np.column_stack([np.sin(angle), np.cos(angle)])
        on_right = np.sign((frames[:, 0] * along).sum(axis=1))[:, None] * on_plus
        thrust, shear = (on_right * along).sum(axis=1), (on_right * radial).sum(axis=1)
        height = np.linalg.norm(points, axis=1) / RADIUS - 1.0
        unit = DENSITY * GRAVITY * RADIUS**2
        # Anticlockwise: along x radial is +1, so a thrust above the centre line turns clockwise.
        parts = np.column_stack([thrust, shear, -height * thrust]) / unit
        return np.array([np.bincount(number, column) for column in parts.T]).T

    return on_root(COMM, add)


def test_continuous_arch():
    """Published: t/R = 0.1075 and 54.5 degrees."""
    limit, hinge = milankovitch()
    assert limit == pytest.approx(0.1075, abs=5e-5)
    assert hinge == pytest.approx(54.5, abs=0.05)


@pytest.mark.parametrize("family", [(5, 10, 20, 40), (9, 27, 81)])
def test_the_limit_of_n_voussoirs_tends_to_the_continuous_one(family):
    """From below, as fewer joints bound the thrust line, and not farther than 0.6/n^2 from it.

    A hinge is at most half a joint spacing off its best place, where its demand is stationary.
    """
    continuous, _ = milankovitch()
    limits = [limit_thickness(n) for n in family]
    assert np.diff(limits).min() > -1e-9
    for n, limit in zip(family, limits, strict=True):
        assert -1e-9 < continuous - limit < 0.6 / n**2


@pytest.mark.parametrize("voussoirs", [8, 9])
def test_least_friction_of_a_thick_arch(voussoirs):
    """The linear program against the closed form for sliding alone.

    With the weight W(a) from the crown to the joint at a, the thrust H must not push the springing
    out, H <= mu W(pi/2), and must hold every block, W cos a - H sin a <= mu (H cos a + W sin a).
    """
    angles = np.pi * (0.5 - np.arange((voussoirs + 1) // 2) / voussoirs)

    def excess(mu):
        needed = angles * (np.cos(angles) - mu * np.sin(angles))
        return mu * np.pi / 2 - (needed / (np.sin(angles) + mu * np.cos(angles))).max()

    expected = brentq(excess, 0.1, 0.9, xtol=1e-12)
    assert limit_friction(voussoirs, 0.6) == pytest.approx(expected, abs=1e-9)


# Rule of the joint points, mesh, number of voussoirs. An even number has a joint at the crown, an
# odd one a block; either occurs with both rules, so each mesh is tried with one number.
CASES = [
    ("nodal", {"divisions": (2, 3, 1)}, 9),
    ("nodal", {"divisions": (1, 2, 1), "cell": "tet"}, 10),
    ("nodal", {"divisions": (1, 2, 1), "order": 2}, 9),
    ("nodal", {"divisions": (1, 1, 1), "width": 1.0}, 10),
    ("gauss", {"cell": "tet"}, 9),
    pytest.param("gauss", {"divisions": (2, 4, 1)}, 10, marks=pytest.mark.mpi),
    ("gauss", {"divisions": (1, 2, 1), "order": 2}, 9),
    ("gauss", {"divisions": (1, 1, 1), "width": 1.0}, 10),
]


def case_limit(voussoirs, quadrature, divisions=(1, 1, 1), order=1, **_):
    """The limit t/R for the shape of the mesh and the places of its joint points."""
    lost = 0.0 if quadrature == "nodal" else GAUSS[order] / divisions[1]
    chords = divisions[0] if order == 1 else None
    return limit_thickness(voussoirs, chords=chords, effective=1.0 - lost)


@pytest.mark.parametrize(("quadrature", "mesh", "voussoirs"), CASES)
def test_least_thickness(quadrature, mesh, voussoirs):
    """The computed arch stands 1e-4 above the limit of the linear program and not 1e-4 below it."""
    limit = case_limit(voussoirs, quadrature, **mesh)
    more = {"quadrature": quadrature, **mesh}
    assert stands(limit * (1.0 + BAND), voussoirs, **more)
    assert not stands(limit * (1.0 - BAND), voussoirs, **more)


def test_least_thickness_with_gauss_points_by_hand():
    """Two points at 1/sqrt(3) of a joint with one cell: the arch must be 1.73 times as thick.

    That is not far from t_e/R = 0.1016, as the weights change little: 0.1760/sqrt(3).
    """
    limit = case_limit(9, "gauss")
    assert limit / math.sqrt(3.0) == pytest.approx(case_limit(9, "nodal"), rel=2e-3)


@pytest.mark.parametrize(
    ("law", "shear", "rigidity"),
    [
        (dj.FrictionNoTension, 0.1, 1.0),
        (dj.FrictionNoTension, 10.0, 1e6),
        (dj.MohrCoulombJoint, 10.0, 1.0),
    ],
)
def test_the_limit_depends_on_no_stiffness(law, shear, rigidity):
    """At both ends of the ratios k_s/k_n and E/(k_n t); k_n itself only scales the displacements.

    A Mohr-Coulomb joint without strength is the same joint, by the monolithic solver alone.
    """
    limit = limit_thickness(9, chords=1)
    more = {"divisions": (1, 2, 1), "shear": shear, "rigidity": rigidity, "law": law}
    for above in (1.0, 2.0, 5.0):  # soft blocks: Newton's method alone finds one or the other
        assert stands(limit * (1.0 + above * BAND), 9, **more)
    assert not stands(limit * (1.0 - BAND), 9, **more)


@pytest.mark.mpi
def test_arches_of_rigid_joints():
    """The same limit, and equilibrium: Newton's method alone goes round in circles."""
    voussoirs, divisions = 9, (1, 2, 1)
    limit = limit_thickness(voussoirs, chords=1)
    for thickness in (1.0 + BAND, 1.1):
        more = {"divisions": divisions, "rigidity": 1.0, "law": dj.RigidJoint}
        run = simulation(thickness * limit, voussoirs, **more)
        joints = run.statics().joints
        shape = Semicircle(voussoirs=voussoirs, thickness=thickness * limit, chords=1)
        matrix, right = shape.equilibrium()
        found = resultants(run.model, joints)
        assert np.abs(matrix @ found.ravel() - right).max() < 1e-8 * right.max()
    assert not stands(limit * (1.0 - BAND), voussoirs, **more)


@pytest.mark.parametrize("quadrature", ["nodal", "gauss"])
@pytest.mark.parametrize("width", [None, pytest.param(1.0, marks=pytest.mark.mpi)])
def test_equilibrium_of_every_voussoir(width, quadrature):
    """N, V, M of the joints balance the weights to what Newton leaves, and keep in their bounds."""
    thickness = 0.2
    more = {"divisions": (2, 3, 1), "width": width, "quadrature": quadrature}
    run = simulation(thickness, 10, **more)
    joints = run.statics().joints
    matrix, right = Semicircle(voussoirs=10, thickness=thickness, chords=2).equilibrium()
    found = resultants(run.model, joints)
    assert np.abs(matrix @ found.ravel() - right).max() < 1e-8 * right.max()
    lost = 0.0 if quadrature == "nodal" else GAUSS[1] / 3
    assert (np.abs(found[:, 2]) <= (1.0 - lost) * thickness / 2 * found[:, 0] * (1 + 1e-9)).all()
    assert (np.abs(found[:, 1]) <= found[:, 0] * (1 + 1e-9)).all()


@pytest.mark.mpi
def test_hinges_near_the_limit():
    """The thrust line at 1e-4 above the limit, n = 10: where it reaches the edges.

    By symmetry of the load five hinges form; the haunches' are at the joints next to 54.5 degrees,
    54 degrees.
    """
    thickness = limit_thickness(10, chords=1) * (1.0 + BAND)
    run = simulation(thickness, 10, divisions=(1, 2, 1))
    thrust, _, moment = resultants(run.model, run.statics().joints).T
    eccentricity = -moment / thrust / (thickness / 2)
    crown, haunches, springings = [5], [2, 8], [0, 10]
    assert eccentricity[crown + springings] == pytest.approx(1.0, abs=0.02)
    assert eccentricity[haunches] == pytest.approx(-1.0, abs=0.02)
    others = np.delete(eccentricity, crown + haunches + springings)
    assert np.abs(others).max() < 0.95


@pytest.mark.parametrize(("voussoirs", "thickness"), [(9, 0.12), (8, 0.3)])
def test_least_friction(voussoirs, thickness):
    """Hinges and sliding together at t/R = 0.12, sliding alone at 0.3.

    The theorem holds for flow normal to the friction cone; without dilatancy an arch might fall
    earlier, but this one does not.
    """
    limit = limit_friction(voussoirs, thickness, chords=1)
    assert stands(thickness, voussoirs, friction=limit * (1.0 + 1e-3))
    assert not stands(thickness, voussoirs, friction=limit * (1.0 - 1e-3))


@pytest.mark.parametrize("thickness", [0.13, 0.2])
def test_factors_of_safety(thickness):
    """An arch thicker than Milankovitch's limit has the factors of the exact limit analysis.

    It carries its weight and a horizontal load. A linear program gives the largest horizontal load,
    at which hinges form, and the least friction under a given horizontal load.
    """
    given, shape = 0.03, {"chords": 2, "friction": 1.0}

    def margin(lateral, **changes):
        options = {"thickness": thickness, **shape, **changes}
        return Semicircle(voussoirs=9, lateral=lateral, **options).margin()

    load = brentq(margin, 0.0, 2.0, xtol=1e-11) / given
    strength = 1.0 / brentq(lambda mu: margin(given, friction=mu), 0.2, 1.0, xtol=1e-11)
    push = dj.Gravity(acceleration=(given * GRAVITY, 0.0))
    run = simulation(thickness, 9, divisions=(2, 3, 1), lateral=[push])
    run.statics()
    by_load = dj.factor_of_safety(run, method="load", multiplied=[push])
    by_strength = dj.factor_of_safety(run)
    assert by_load.factor == pytest.approx(load, rel=1.2e-3)
    assert by_strength.factor == pytest.approx(strength, rel=1.2e-3)


def test_springs_that_blocks_move_on_without_end_are_no_equilibrium():
    """Below the limit: 200 km away the residual was 5e-15, of forces that rounding had eaten."""
    falling = dj.Simulation(simulation(0.1, 16).model, solver="condensed")
    with pytest.raises(dj.ConvergenceError):
        falling.statics()
