# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quadrature of K and M: exact on straight cells, and what holds on curved hexahedra."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from petsc4py import PETSc
from rings import quarter_ring

import dolfinx_joints as dj
from dolfinx_joints.body import quadrature
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.mesh.cells import CellShape

SOLID = dj.Elastic(young=25.92e9, poisson=0.2, density=2400.0)
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def ring(comm):
    """Return the model of a quarter of a thick ring: 4 x 4 cells, each curved by 22.5 degrees."""
    jointed = dj.mesh_from_arrays(comm, **quarter_ring("hexahedron", 4), joints=[])
    return dj.Model(jointed, material=SOLID)


def vector(model, field):
    """Vector of a displacement field, given at nodes (n, 3)."""
    made = model.mass.createVecRight()
    nodes = model.V.tabulate_dof_coordinates()[: made.getLocalSize() // 3]
    made.setArray(field(nodes).ravel())
    return made


def times(matrix, u):
    product = u.duplicate()
    matrix.mult(u, product)
    return product


def rigid_motions(model):
    turns = [np.array(axis) for axis in np.eye(3)]
    moves = [lambda x, a=axis: np.tile(a, (len(x), 1)) for axis in turns]
    return [vector(model, f) for f in [*moves, *(lambda x, a=a: np.cross(a, x) for a in turns)]]


def test_constant_strain_is_exact_on_curved_hexahedra(ring):
    """Forces of a constant stress are polynomials of degree 5 along each axis of the cell.

    So they vanish inside, and the energy is stress : strain / 2 times the volume of the cells,
    which M of a translation gives exactly too.
    """
    strain = 1e-3 * np.array([[1.0, 0.4, -0.2], [0.4, -0.7, 0.3], [-0.2, 0.3, 0.5]])
    u = vector(ring, lambda x: x @ strain)
    force = times(ring.stiffness, u)
    nodes = ring.V.tabulate_dof_coordinates()[: u.getLocalSize() // 3]
    radius, largest = np.hypot(nodes[:, 0], nodes[:, 1]), force.norm(3)
    inside = (radius > 1.01) & (radius < 2.99) & (nodes[:, :2] > 1e-6).all(axis=1)
    inside &= (nodes[:, 2] > 1e-6) & (nodes[:, 2] < 0.5 - 1e-6)
    assert inside.any()
    assert np.abs(force.getArray().reshape(-1, 3)[inside]).max() < ROUNDING * largest
    along_x = rigid_motions(ring)[0]
    volume = along_x.dot(times(ring.mass, along_x)) / SOLID.density
    stress = SOLID.first_lame("strain") * np.trace(strain) * np.eye(3)
    stress += 2.0 * SOLID.shear_modulus * strain
    assert u.dot(force) == pytest.approx(np.sum(stress * strain) * volume, rel=ROUNDING)


def test_stiffness_is_symmetric_with_six_rigid_motions(ring):
    dense = ring.stiffness.convert("dense", PETSc.Mat())
    K = dense.getDenseArray().copy()
    assert np.abs(K - K.T).max() < ROUNDING * np.abs(K).max()
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:6]).max() < 10 * ROUNDING * values[-1]
    assert values[6] > 1e-6 * values[-1]
    for u in rigid_motions(ring):
        assert times(ring.stiffness, u).norm() < ROUNDING * ring.stiffness.norm() * u.norm()


def test_frequencies_of_the_dam_are_those_of_degree_10(comm, tmp_path, monkeypatch):
    jointed = dj.read_msh(ambiesta(tmp_path / "dam.msh", size=8.0), comm)
    law = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=30.0)
    rock = [dj.Fixed(group="base"), dj.Fixed(group="abutments")]

    def frequencies():
        model = dj.Model(jointed, material=SOLID, joints=law, supports=rock)
        return np.array(dj.modes(model.system(), 6).frequencies)

    at_degree_7 = frequencies()
    monkeypatch.setattr(quadrature, "CURVED_HEXAHEDRA", 10)
    at_degree_10 = frequencies()
    assert at_degree_7 == pytest.approx(at_degree_10, rel=1e-6)
    assert not np.array_equal(at_degree_7, at_degree_10)


@pytest.mark.parametrize("name", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_other_cells_keep_the_estimate_of_ufl(name, degree):
    measure = quadrature.matrix_measure(CellShape(name=name, degree=degree))
    curved = name == "hexahedron" and degree == 2
    assert measure.metadata() == ({"quadrature_degree": 7} if curved else {})
    assert (measure == ufl.dx) is not curved
