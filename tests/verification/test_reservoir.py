# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Reservoirs of incompressible water against exact pressures.

Water of depth H before a rigid vertical face that accelerates by a (Westergaard 1933, for slow
motions), with l_n = (2n - 1) pi / 2H:

    p = rho a sum 2 (-1)^(n+1) / (H l_n^2) cos(l_n z),  per width int p dz = 0.5428 rho H^2 a.

A motion cos(l_n z) meets p = rho / l_n cos(l_n z), coth(l_n L) times that with a wall at the
distance L, so that such motions share no added mass. On faces of any shape: p = cos(k y) cos(l z)
exp(m x) with m^2 = k^2 + l^2 solves Laplace's equation, is zero at the level, has no flux through
the floor z = 0 and banks k y = 0, pi; it is the pressure on a face that moves by -grad p / rho,
whatever the face is, and M u are its nodal forces.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import nodal_fields
import ufl
from boxes import box
from dolfinx.mesh import (
    CellType,
    create_rectangle,
    exterior_facet_indices,
    locate_entities_boundary,
)
from nodal_fields import energy, field

import dolfinx_joints as dj
from dolfinx_joints.loads.water import reservoir

pytestmark = pytest.mark.mpi

CONCRETE = dj.Elastic(young=24e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)
RHO, DEPTH, WIDTH = 1000.0, 10.0, 12.0
WALL = [4.0, 12.0]  # 2 m above the level


def model_of(jointed, degree=1):
    laws = LAW if jointed.joint_names else None
    return dj.Model(jointed, material=CONCRETE, joints=laws, body=dj.Body(degree=degree))


def plane(comm, cells, degree=1, *, joint=None, place=None):
    """A model whose face x = 0 is ``up``, with a joint at a height if given."""
    joints, groups = {} if joint is None else {"joint": (1, joint)}, {"up": (0, 0.0)}
    jointed = box(WALL, [1, cells], joints=joints, groups=groups, place=place, comm=comm)
    return model_of(jointed, degree)


def solid(comm, cells, cell, degree=1, place=None):
    """The same in space."""
    size, counts = [4.0, WIDTH, 12.0], [1, cells, cells]
    return model_of(
        box(size, counts, cell, groups={"up": (0, 0.0)}, place=place, comm=comm), degree
    )


along = partial(nodal_fields.along, gdim=2)


def rate(n):
    return (2 * n - 1) * np.pi / (2 * DEPTH)


def wave(n):
    """Motion of a plane face along x, cos(l_n z) below the level."""
    return along(0, lambda x: np.where(x[:, 1] < DEPTH, np.cos(rate(n) * x[:, 1]), 0.0))


def observed(errors):
    return np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))


@pytest.mark.parametrize("length", [None, 5.0])
@pytest.mark.parametrize("degree", [1, 2])
def test_rigid_vertical_face(comm, degree, length):
    """The resultant of the series, and order 2 (p behaves as y^2 log y at the level)."""
    n = np.arange(1, 100000)
    ends = 1.0 if length is None else 1.0 / np.tanh(rate(n) * length)
    exact = RHO * DEPTH**2 * np.sum(16.0 / ((2 * n - 1) * np.pi) ** 3 * ends)
    if length is None:
        assert exact == pytest.approx(0.5428 * RHO * DEPTH**2, rel=1e-4)
    found = []
    for cells in (6, 12, 24):
        model = plane(comm, cells, degree)
        mass = dj.ReservoirMass(group="up", level=DEPTH, length=length).matrix(model)
        found.append(energy(model, mass, along(0), along(0)))
        # Water does not feel what moves along it.
        assert energy(model, mass, along(1), along(1)) == 0.0
    errors = np.array(found) / exact - 1.0
    assert (np.abs(errors) < np.array([1.2e-2, 4e-3, 1e-3])).all()
    np.testing.assert_allclose(observed(errors), 2.0, atol=0.25)


@pytest.mark.parametrize("level", [12.0, 9.81, 9.5 + 1e-9, 0.31, 0.0, -1.0])
def test_levels_in_cells(comm, level):
    """The mass goes with the square of the depth wherever the level cuts a cell."""
    model = plane(comm, 24, 2)
    mass = dj.ReservoirMass(group="up", level=level).matrix(model)
    wet = max(level, 0.0)
    # Near the floor there is less than a cell of water.
    assert energy(model, mass, along(0), along(0)) == pytest.approx(
        0.5428 * RHO * wet**2, rel=1e-3 if wet > 1.0 else 0.1
    )


def test_waves_share_no_mass(comm):
    """The distribution of the pressure, by each motion's own mass and that between two of them."""
    model = plane(comm, 48)
    mass = dj.ReservoirMass(group="up", level=DEPTH).matrix(model)
    found = [[energy(model, mass, wave(i), wave(j)) for j in (1, 2, 3)] for i in (1, 2, 3)]
    expected = np.diag([RHO * DEPTH / 2.0 / rate(n) for n in (1, 2, 3)])
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=2e-3 * expected[0, 0])


def shapely(x, bend=0.0):
    """A face with a batter below, and if wanted curved across the valley."""
    moved = x.copy()
    z = x[:, -1] if bend else x[:, 1]
    moved[:, 0] += np.where(z < 6.0, 0.3 * (z - 6.0), 0.0)
    if bend:
        moved[:, 0] += bend * (x[:, 1] - WIDTH / 2.0) ** 2
    return moved


def error_of_forces(model, k, level=DEPTH):
    """Of M u against the nodal forces of the exact pressure, in the norm of the latter."""
    gdim = model.gdim
    rise = np.pi / (2.0 * level)
    m = np.hypot(k, rise)

    def moves(x):
        y, z, grows = x[:, 1], x[:, gdim - 1], np.exp(m * x[:, 0])
        across = np.cos(k * y) if gdim == 3 else 1.0
        slope = np.zeros((len(x), gdim))
        slope[:, 1] = -k * np.sin(k * y) * np.cos(rise * z) * grows
        slope[:, 0] = m * across * np.cos(rise * z) * grows
        slope[:, -1] = -rise * across * np.sin(rise * z) * grows
        return -slope / RHO

    mass = dj.ReservoirMass(group="up", level=level, upstream=-np.eye(gdim)[0]).matrix(model)
    found = mass.createVecLeft()
    mass.mult(field(model, moves), found)
    x, n = ufl.SpatialCoordinate(model.jointed.mesh), ufl.FacetNormal(model.jointed.mesh)
    exact = ufl.cos(rise * x[gdim - 1]) * ufl.exp(m * x[0])
    if gdim == 3:
        exact *= ufl.cos(k * x[1])
    ds = model.jointed.ds("up")(metadata={"quadrature_degree": 8})
    expected = model.assemble(exact * ufl.inner(n, ufl.TestFunction(model.V)) * ds)
    size = expected.norm()
    found.axpy(-1.0, expected)
    return found.norm() / size


def test_battered_face(comm):
    """Forces on a face with a bend, level at the crest."""
    found = [
        error_of_forces(plane(comm, cells, place=shapely), 0.0, level=12.0) for cells in (8, 16, 32)
    ]
    assert found[-1] < 2e-3
    assert (observed(np.array(found)) > 1.6).all()


def canyon(comm, cells, cell, degree=1):
    return solid(comm, cells, cell, degree, place=lambda x: shapely(x, bend=0.02))


@pytest.mark.parametrize("cell", [CellType.hexahedron, CellType.tetrahedron])
def test_curved_face(comm, cell):
    """The same in space, a wave across the valley."""
    found = [
        error_of_forces(canyon(comm, cells, cell), np.pi / WIDTH, level=12.0) for cells in (6, 12)
    ]
    assert found[-1] < 0.012
    assert observed(np.array(found))[0] > 1.8


@pytest.mark.parametrize("cell", [CellType.hexahedron, CellType.tetrahedron])
def test_quadratic_faces(comm, cell):
    """Faces of degree 2 have pressures at their middle nodes: as linear ones of half the size."""
    error = error_of_forces(canyon(comm, 3, cell, 2), np.pi / WIDTH, level=12.0)
    assert error < error_of_forces(canyon(comm, 3, cell), np.pi / WIDTH, level=12.0) / 2.0


@pytest.mark.parametrize("cell", [CellType.hexahedron, CellType.tetrahedron])
def test_canyon(comm, cell):
    """Without change across the valley the mass of the plane, times the width."""
    model = solid(comm, 12, cell)
    mass = dj.ReservoirMass(group="up", level=DEPTH).matrix(model)
    expected = WIDTH * 0.5428 * RHO * DEPTH**2
    found = energy(model, mass, along(0, gdim=3), along(0, gdim=3))
    assert found == pytest.approx(expected, rel=4e-3)
    for axis in (1, 2):
        assert energy(model, mass, along(axis, gdim=3), along(axis, gdim=3)) == 0.0


def test_symmetric_without_negative_energy(comm):
    """M = Y^T Y; a face that slides along itself meets no water."""
    model = canyon(comm, 6, CellType.hexahedron)
    mass = dj.ReservoirMass(group="up", level=7.3).matrix(model)
    u, product, other = (mass.createVecRight() for _ in range(3))
    scale = mass.norm()
    rng = np.random.default_rng(1 + comm.rank)
    for _ in range(5):
        u.setArray(rng.standard_normal(u.getLocalSize()))
        mass.mult(u, product)
        mass.multTranspose(u, other)
        other.axpy(-1.0, product)
        assert other.norm() < 1e-14 * scale * u.norm()
        assert product.dot(u) > 0.0
    leans = plane(comm, 12, place=lambda x: x + 0.25 * x[:, 1:2] * np.eye(3)[0])
    mass = dj.ReservoirMass(group="up", level=DEPTH).matrix(leans)
    sliding = energy(leans, mass, *[lambda x: np.array([0.25, 1.0])] * 2)
    assert abs(sliding) < 1e-14 * energy(leans, mass, along(0), along(0))


def test_joints_let_no_water_through(comm):
    """A joint in the face changes nothing; a block that moves alone takes the other's water along.

    The same nodes move, so the two agree to rounding.
    """
    whole, split = (plane(comm, 12, joint=joint) for joint in (None, 5.0))
    one, other = (dj.ReservoirMass(group="up", level=9.7).matrix(model) for model in (whole, split))
    expected = energy(whole, one, along(0), along(0))
    assert energy(split, other, along(0), along(0)) == pytest.approx(expected, rel=1e-12)
    assert energy(split, other, wave(2), wave(1)) == pytest.approx(
        energy(whole, one, wave(2), wave(1)), rel=1e-9
    )


def test_ranks_do_not_matter(comm):
    """Against the same on one rank."""
    profile = along(0, lambda x: np.sin(x[:, 1]) + x[:, 2] ** 2, gdim=3)
    found = []
    for on in (comm, MPI.COMM_SELF):
        model = canyon(on, 4, CellType.hexahedron)
        mass = dj.ReservoirMass(group="up", level=8.9).matrix(model)
        found.append(energy(model, mass, profile, profile))
    assert found[0] == pytest.approx(found[1], rel=1e-11)


def test_part_of_the_model(comm):
    """It has inertia and no weight."""
    bare = plane(comm, 6)
    added = dj.ReservoirMass(group="up", level=DEPTH)
    wet = dj.Model(bare.jointed, material=CONCRETE, water=added)
    a = np.array([1.0, 0.0])
    every = field(bare, along(0))
    water = energy(bare, added.matrix(bare), along(0), along(0))
    dry = bare.inertia_pattern(a).dot(every)
    assert wet.inertia_pattern(a).dot(every) == pytest.approx(dry + water, rel=1e-12)
    assert wet.inertia_pattern(a, body_only=True).dot(every) == pytest.approx(dry, rel=1e-12)


def test_bad_input(comm, monkeypatch):
    model = plane(comm, 6)

    def refused(match, **options):
        with pytest.raises(ValueError, match=match):
            dj.ReservoirMass(**{"group": "up", "level": 5.0, **options}).matrix(model)

    refused("the level is 13 m, but the face ends at 12 m", level=13.0)
    refused("upstream is .*; it must be a horizontal vector", upstream=(1.0, 1.0))
    refused("100 % of the wet face does not face upstream", upstream=(1.0, 0.0))
    with pytest.raises(ValueError, match="water is 3; it must be a reservoir, an added mass"):
        dj.Model(model.jointed, material=CONCRETE, water=3)
    monkeypatch.setattr(reservoir, "available_bytes", lambda comm: 1e3)
    refused("the dense matrix of 3 wet nodes needs .* GB")


def skin(comm):
    """A model whose whole boundary is the group ``up``."""
    mesh = create_rectangle(comm, [[0.0, 0.0], WALL], [1, 6], CellType.quadrilateral)
    mesh.topology.create_connectivity(1, 2)
    facets = exterior_facet_indices(mesh.topology)
    return dj.Model(dj.split_mesh(mesh, groups={"up": facets}), material=CONCRETE)


def test_bad_faces(comm):
    """A closed surface has no side that is upstream, a face below a roof no surface of water."""
    with pytest.raises(ValueError, match="mean normal of the wet face has no horizontal part"):
        dj.ReservoirMass(group="up", level=5.0).matrix(skin(comm))
    mesh = create_rectangle(comm, [[0.0, 0.0], WALL], [1, 6], CellType.quadrilateral)
    mesh.topology.create_connectivity(1, 2)
    face = locate_entities_boundary(mesh, 1, lambda x: x[0] < 1e-9)
    middle = locate_entities_boundary(mesh, 1, lambda x: (x[0] < 1e-9) & (abs(x[1] - 5.0) < 1.01))
    split = dj.split_mesh(mesh, groups={"up": np.setdiff1d(face, middle)})
    with pytest.raises(ValueError, match="1 separate regions of the face do not reach"):
        dj.ReservoirMass(group="up", level=11.0).matrix(dj.Model(split, material=CONCRETE))


@pytest.mark.parametrize("length", [None, 6.0])
def test_compressible_water(comm, length):
    """With sound l_n^2 becomes l_n^2 - (w/c)^2; from c/4H on the endless reservoir resonates."""
    model = plane(comm, 48)
    lowest = 1000.0 / (4.0 * DEPTH)
    for share in (0.5, 0.9):
        water = {"group": "up", "level": DEPTH, "sound_speed": 1000.0, "length": length}
        mass = dj.ReservoirMass(**water, frequency=share * lowest).matrix(model)
        m = np.sqrt(rate(1) ** 2 - (2.0 * np.pi * share * lowest / 1000.0) ** 2)
        ends = 1.0 if length is None else 1.0 / np.tanh(m * length)
        expected = RHO * DEPTH / 2.0 / m * ends
        assert energy(model, mass, wave(1), wave(1)) == pytest.approx(expected, rel=5e-3)
    with pytest.raises(ValueError, match="it must be below the lowest natural frequency"):
        dj.ReservoirMass(**water, frequency=1.05 * lowest).matrix(model)


def test_not_far_from_westergaard(comm):
    """His parabola has 7/12 rho H^2 of mass where the exact pressure has 0.5428."""
    model = plane(comm, 24)
    parabola = dj.WestergaardMass(group="up", level=DEPTH).matrix(model)
    exact = dj.ReservoirMass(group="up", level=DEPTH).matrix(model)
    ratio = energy(model, exact, along(0), along(0)) / energy(model, parabola, along(0), along(0))
    assert ratio == pytest.approx(0.5428 * 12.0 / 7.0, rel=1e-3)
