# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Water on faces against integrals done by hand, levels anywhere in a cell.

On a plane face of width b that leans by theta from the horizontal and is wet down to a depth H,
with ds = dd / sin(theta) along the slope and n the normal:

    pressure      int rho g d ds           = rho g H^2 / (2 sin)            along -n
    its moment    int rho g d (H - d) dd   = rho g H^3 / 6                  vertical face, foot
    added mass    int 7/8 rho (H d)^.5 ds  = 7/12 rho H^2 / sin             times n n^T
    on z e_x      int 7/8 rho (H d)^.5 (H - d)^2 dd = 2/15 rho H^4          vertical face

each times b. On a closed surface the pressure resultant is the weight of the water displaced.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from dolfinx.mesh import CellType, create_box, exterior_facet_indices
from nodal_fields import along, energy, field
from petsc4py import PETSc
from scipy.integrate import quad

import dolfinx_joints as dj
from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.loads.water import wetted_facets as wetted

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)
RHO = 1000.0
WIDTH, LENGTH = 4.0, 20.0  # of the wall's x faces, and between them [m]
LEVELS = [20.0, 40.0 / 3.0, 11.3, 0.7, 25.0, -1.0]  # of 3 cells in height: top, node, inside, out


def model_of(jointed, **options):
    laws = LAW if jointed.joint_names else None
    return dj.Model(jointed, material=CONCRETE, joints=laws, **options)


def force_of(model, load):
    """Pattern of a load with a single one."""
    ((pattern, _),) = load.patterns(model)
    return pattern


def turning(x):
    """The displacement z e_x."""
    return x[:, 2:] * np.eye(3)[0]


def total(model, pattern):
    """Resultant of a nodal vector."""
    return np.array(
        [pattern.dot(field(model, along(i, gdim=model.gdim))) for i in range(model.gdim)]
    )


def skin(comm, cell, place):
    """A unit cube of 2 x 2 x 2 cells, its nodes moved, its whole boundary the group ``skin``."""
    mesh = create_box(comm, [[0, 0, 0], [1, 1, 1]], [2, 2, 2], cell)
    mesh.geometry.x[:] = place(mesh.geometry.x)
    mesh.topology.create_connectivity(2, 3)
    facets = exterior_facet_indices(mesh.topology)
    return dj.split_mesh(mesh, groups={"skin": facets})


# What ranks can change, the partition, is the same for both orders.
CELLS = [("hex", 1), ("tet", 2), ("tet", 1), ("hex", 2)][: 4 if MPI.COMM_WORLD.size == 1 else 2]


@pytest.fixture(scope="module", params=CELLS)
def wall(request, read, wall_file):
    """A monolithic wall, cells 20/3 m high."""
    cell, order = request.param
    return model_of(read(wall_file(cell=cell, order=order), joints=[]))


@pytest.mark.parametrize("level", LEVELS)
def test_pressure_on_a_vertical_face(wall, level):
    """Force and moment; silt is the same with K rho'."""
    wet = min(max(level, 0.0), 20.0)
    top = max(level - 20.0, 0.0)  # depth of the crest
    force = RHO * STANDARD_GRAVITY * WIDTH * (top * wet + wet**2 / 2.0)
    moment = RHO * STANDARD_GRAVITY * WIDTH * (top * wet**2 / 2.0 + wet**3 / 6.0)
    found = force_of(wall, dj.HydrostaticPressure(group="x_min", level=level))
    scale = RHO * STANDARD_GRAVITY * WIDTH * 200.0
    np.testing.assert_allclose(total(wall, found), [force, 0, 0], rtol=1e-11, atol=1e-11 * scale)
    assert found.dot(field(wall, turning)) == pytest.approx(moment, rel=1e-10, abs=1e-9)
    silt = dj.SiltPressure(group="x_max", level=level, density=900.0, coefficient=0.4)
    expected = [-force * 0.36, 0, 0]
    np.testing.assert_allclose(
        total(wall, force_of(wall, silt)), expected, rtol=1e-11, atol=1e-11 * scale
    )


@pytest.mark.parametrize("level", [20.0, 40.0 / 3.0, 11.3, 0.7, -1.0])
def test_added_mass_on_a_vertical_face(wall, level):
    """Total along the normal, none across it, and that of a turning face."""
    wet = max(level, 0.0)
    mass = dj.WestergaardMass(group="x_min", level=level).matrix(wall)
    scale = RHO * WIDTH * 400.0
    found = [[energy(wall, mass, along(i), along(j)) for j in range(3)] for i in range(3)]
    expected = np.zeros((3, 3))
    expected[0, 0] = 7.0 / 12.0 * RHO * wet**2 * WIDTH
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * scale)
    found = energy(wall, mass, turning, turning)
    assert found == pytest.approx(2.0 / 15.0 * RHO * wet**4 * WIDTH, rel=1e-10, abs=1e-12 * scale)


def check_entries(model, group, level):
    """Nodal forces and masses against UFL forms of high degree, all under 4 m of water or more."""
    x, n = ufl.SpatialCoordinate(model.jointed.mesh), ufl.FacetNormal(model.jointed.mesh)
    u, v = ufl.TrialFunction(model.V), ufl.TestFunction(model.V)
    depth, ds = level - x[2], model.jointed.ds(group)(metadata={"quadrature_degree": 24})
    load = dj.HydrostaticPressure(group=group, level=level, density=2.0, gravity=3.0)
    expected = model.assemble(-6.0 * depth * ufl.dot(n, v) * ds)
    scale = expected.norm()
    expected.axpy(-1.0, force_of(model, load))
    assert expected.norm() < 1e-12 * scale
    per_area = 0.875 * RHO * ufl.sqrt(24.0 * depth)
    expected = model._matrix(per_area * ufl.dot(u, n) * ufl.dot(v, n) * ds)
    scale = expected.norm()
    mass = dj.WestergaardMass(group=group, level=level, depth=24.0).matrix(model)
    expected.axpy(-1.0, mass, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    assert expected.norm() < 1e-11 * scale


def test_entries_of_a_vertical_face(wall):
    check_entries(wall, "x_min", 24.0)


@pytest.mark.parametrize("degree", [1, 2])
def test_entries_of_a_leaning_cube(comm, degree):
    """No edge is horizontal, so that slices run across the shape functions."""

    def lean(x):
        a, b = np.array([0.6, 0.8, 0.0]), np.array([0.64, -0.48, 0.6])
        return x @ np.array([a, b, np.cross(a, b)])

    check_entries(
        model_of(skin(comm, CellType.hexahedron, lean), body=dj.Body(degree=degree)), "skin", 5.0
    )


def test_depth_of_the_reservoir(wall):
    """H enters by its root, as a number or as a function of the points."""
    base = energy(
        wall, dj.WestergaardMass(group="x_min", level=9.0).matrix(wall), along(0), along(0)
    )
    for deep in (36.0, lambda x: np.full(len(x), 36.0)):
        mass = dj.WestergaardMass(group="x_min", level=9.0, depth=deep).matrix(wall)
        assert energy(wall, mass, along(0), along(0)) == pytest.approx(2.0 * base, rel=1e-11)


@pytest.mark.parametrize("level", [20.0, 8.9, 3.0])
def test_buoyancy_of_the_wall(wall, level):
    """All faces wet, horizontal ones too: nothing sideways, the weight of the water upwards."""
    faces = ["base", "crest", "x_min", "x_max", "y_min", "y_max"]
    parts = [force_of(wall, dj.HydrostaticPressure(group=face, level=level)) for face in faces]
    found = sum(total(wall, part) for part in parts)
    weight = RHO * STANDARD_GRAVITY * LENGTH * WIDTH * level
    np.testing.assert_allclose(found, [0.0, 0.0, weight], rtol=1e-11, atol=1e-11 * weight)


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("level", [1.05, 0.95])
def test_sloping_face(read, blocks_file, two_rectangles_file, plane, order, level):
    """The lower block's side of the joint, which rises with x by 20 degrees from 0.818 m."""
    jointed = read((two_rectangles_file if plane else blocks_file)(order=order))
    model = model_of(jointed)
    lean = math.radians(20.0)
    deep = level - (1.0 - 0.5 * math.tan(lean))
    up = np.array(
        [-math.sin(lean), math.cos(lean)] if plane else [-math.sin(lean), 0, math.cos(lean)]
    )
    # The name of the lower side depends on the mesh; its pressure points down.
    for side in ("joint_1-", "joint_1+"):
        found = total(model, force_of(model, dj.HydrostaticPressure(group=side, level=level)))
        sign = -1.0 if found[-1] < 0.0 else 1.0
        size = RHO * STANDARD_GRAVITY * deep**2 / (2.0 * math.sin(lean))
        np.testing.assert_allclose(found, sign * size * up, rtol=1e-11, atol=1e-11 * size)
        mass = dj.WestergaardMass(group=side, level=level).matrix(model)
        axes = [along(i, gdim=model.gdim) for i in range(model.gdim)]
        masses = [[energy(model, mass, one, other) for one in axes] for other in axes]
        size = 7.0 / 12.0 * RHO * deep**2 / math.sin(lean)
        np.testing.assert_allclose(masses, size * np.outer(up, up), rtol=1e-10, atol=1e-11 * size)


def warp(x):
    """Places of nodes x (n, 3) that leave no facet flat."""
    a, b, c = x.T
    return x + 0.15 * np.stack([np.sin(3 * b * c), a**2 * c, np.sin(4 * a * b + c)], axis=1)


def test_buoyancy_of_a_warped_body(comm):
    """Under water to rounding, as the resultant is an integral of polynomials.

    Tetrahedra have flat facets: there is nothing sideways wherever the level is.
    """
    weight = RHO * STANDARD_GRAVITY
    model = model_of(skin(comm, CellType.hexahedron, warp))
    volume = model.body_mass.createVecRight()
    model.body_mass.mult(field(model, along(2)), volume)
    volume = volume.dot(field(model, along(2))) / CONCRETE.density
    found = total(model, force_of(model, dj.HydrostaticPressure(group="skin", level=2.0)))
    np.testing.assert_allclose(found, [0, 0, weight * volume], atol=1e-11 * weight)
    flat = model_of(skin(comm, CellType.tetrahedron, warp))
    found = total(flat, force_of(flat, dj.HydrostaticPressure(group="skin", level=0.63)))
    np.testing.assert_allclose(found[:2], 0.0, atol=1e-11 * weight)


def test_level_through_warped_facets(comm, monkeypatch):
    """What is left sideways falls at least with the third power of the divisions."""
    left = []
    for divisions in (2, 4, 8):
        monkeypatch.setattr(wetted, "DIVISIONS", divisions)
        model = model_of(skin(comm, CellType.hexahedron, warp))
        found = total(model, force_of(model, dj.HydrostaticPressure(group="skin", level=0.63)))
        left.append(np.linalg.norm(found[:2]) / found[2])
    assert left[2] < 1e-5
    assert left[2] < left[0] / 64.0


def test_models_of_a_mesh_share_the_forces_until_its_nodes_move(comm):
    """A mesh of twice the size has twice the depth and four times the area."""
    jointed = skin(comm, CellType.hexahedron, warp)
    load = dj.HydrostaticPressure(group="skin", level=0.63)
    first, second = (force_of(model_of(jointed), load) for _ in range(2))
    assert (first.array_r == second.array_r).all()
    jointed.mesh.geometry.x[:] *= 2.0
    doubled = force_of(model_of(jointed), dj.HydrostaticPressure(group="skin", level=1.26))
    assert doubled.norm() == pytest.approx(8.0 * first.norm(), rel=1e-12)
    jointed.mesh.geometry.x[:] *= 2.0
    assert force_of(model_of(jointed), load).norm() != pytest.approx(first.norm(), rel=1e-3)


def test_first_frequency_of_a_full_reservoir(read, wall_file):
    """Rayleigh's quotient with the dry shape is an upper bound, and close; a beam's shape agrees.

    A cantilever 2 x 2 x 20 m; its ratio of frequencies by hand is that of
    1 + int m_a b phi^2 / (rho A int phi^2) with the first shape of an Euler-Bernoulli beam.
    """
    sizes = {"length": 2.0, "thickness": 2.0, "height": 20.0, "divisions": (1, 1, 8)}
    jointed = read(wall_file(joints=0, order=2, **sizes))
    held = {"supports": [dj.Fixed(group="base"), dj.Fixed(group="y_min", components="y")]}
    water = dj.WestergaardMass(group="x_min", level=20.0)
    dry, wet = model_of(jointed, **held), model_of(jointed, water=water, **held)
    without, full = dj.modes(dry.system(), 1), dj.modes(wet.system(), 1)
    shape = without.shapes[0]
    moved = water.matrix(dry).createVecLeft()
    water.matrix(dry).mult(shape, moved)
    quotient = without.frequencies[0] ** 2 / (1.0 + moved.dot(shape))
    assert full.frequencies[0] ** 2 <= quotient * (1.0 + 1e-10)
    assert full.frequencies[0] ** 2 >= quotient * 0.98

    k = 1.8751040687119611 / 20.0
    sigma = 0.7340955137589128

    def beam(z):
        return (math.cosh(k * z) - math.cos(k * z)) - sigma * (math.sinh(k * z) - math.sin(k * z))

    square = quad(lambda z: beam(z) ** 2, 0.0, 20.0)[0]
    added = quad(lambda z: 0.875 * RHO * math.sqrt(20.0 * (20.0 - z)) * beam(z) ** 2, 0.0, 20.0)[0]
    ratio = 1.0 + added * 2.0 / (CONCRETE.density * 4.0 * square)
    found = (without.frequencies[0] / full.frequencies[0]) ** 2
    assert found == pytest.approx(ratio, rel=0.01)
    assert ratio > 1.2  # no small effect


def test_ground_motion_moves_the_water_too(read, wall_file):
    """F = -(M + M_a) iota a_g; self weight is that of the body alone."""
    jointed = read(wall_file())
    water = dj.WestergaardMass(group="x_min", level=15.0)
    model = model_of(jointed, water=water)
    patterns = dj.BaseMotion(acceleration=lambda t: (1.0, 0.0, 0.0)).patterns(model)
    body = CONCRETE.density * 20.0 * 4.0 * 20.0
    expected = -body - 7.0 / 12.0 * RHO * 15.0**2 * 4.0
    assert total(model, patterns[0][0])[0] == pytest.approx(expected, rel=1e-11)
    assert total(model, patterns[1][0])[1] == pytest.approx(-body, rel=1e-11)
    weight = total(model, force_of(model, dj.Gravity()))
    np.testing.assert_allclose(weight, [0, 0, -STANDARD_GRAVITY * body], atol=1e-9 * body)


def test_added_mass_feels_the_absolute_acceleration(read, wall_file):
    """Shaken in a frame that moves with the ground, or by its base in a frame at rest: the same.

    The ground moves by a t^2 / 2, which the scheme follows exactly; so the two differ by rounding.
    """
    jointed = read(wall_file(), joints=[])
    water = dj.WestergaardMass(group="x_min", level=15.0)
    a, dt, steps = 3.0, 0.005, 10
    still = model_of(jointed, supports=[dj.Fixed(group="base")], water=water)
    relative = dj.Simulation(still).dynamics(dt=dt, steps=steps, motion=lambda t: (a, 0.0, 0.0))
    pushed = dj.Prescribed(group="base", component="x", value=lambda t: 0.5 * a * t**2)
    supports = [dj.Fixed(group="base", components="yz"), pushed]
    moving = model_of(jointed, supports=supports, water=water)
    absolute = dj.Simulation(moving).dynamics(dt=dt, steps=steps)
    ground = 0.5 * a * (steps * dt) ** 2
    difference = absolute.state.displacement.copy()
    difference.axpy(-ground, field(moving, along(0)))
    difference.axpy(-1.0, relative.state.displacement)
    assert difference.norm() < 1e-9 * relative.state.displacement.norm()


@pytest.mark.parametrize("redistribute", [False, True])
def test_energies_balance(read, wall_file, redistribute):
    """With water at rest and moving, joints that open, and damping by mass and stiffness."""
    model = model_of(
        read(wall_file(divisions=(16, 1, 3))),
        supports=[dj.Fixed(group="base")],
        damping=dj.rayleigh(ratio=0.05, frequencies=(5.0, 25.0)),
        loads=[dj.Gravity(), dj.HydrostaticPressure(group="y_min", level=17.0)],
        water=dj.WestergaardMass(group="y_min", level=17.0),
        body=dj.Body(redistribute_mass=redistribute),
    )
    simulation = dj.Simulation(model)
    simulation.statics()
    outcome = simulation.dynamics(dt=0.01, steps=30, motion=dj.synthetic_motion(duration=2.0))
    assert outcome.imbalance < 1e-12
    assert outcome.energy.joint > 0.0
    assert outcome.energy.viscous > 0.0


def test_refusals(wall, read, wall_file):
    """One sentence each, on all ranks."""
    with pytest.raises(ValueError, match="depth is 0 m; it must be positive"):
        dj.WestergaardMass(group="x_min", level=1.0, depth=0)
    with pytest.raises(ValueError, match="it must be one finite number of zero or more"):
        dj.WestergaardMass(group="x_min", level=5.0, depth=lambda x: -x[:, 2]).matrix(wall)
    # 4 x 1 x 3 cells: a plane across them has 3 facets, each with a cell on both sides.
    whole, within = read(wall_file(), joints=[]), dj.HydrostaticPressure(group="joint_1", level=5.0)
    with pytest.raises(dj.MeshError, match="^3 facets of 'joint_1' lie inside the body; loads"):
        model_of(whole, loads=[within]).system()
