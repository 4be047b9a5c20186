# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Halves of M and K: products as PETSc's with all of both, and where there are none."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from petsc4py import PETSc

from dolfinx_joints import Body, Elastic, Fixed, FrictionNoTension, Model, Spring
from dolfinx_joints.body.halves import Halves

MATERIAL = Elastic(young=24e9, poisson=0.2, density=2400.0)
LAW = FrictionNoTension(normal_stiffness=1e11, shear_stiffness=1e11, friction_angle_deg=30.0)


@pytest.fixture
def jointed(blocks_file, read):
    return read(blocks_file())


def model(jointed, **more):
    held = [Fixed(group="base"), Spring(group="top", normal_stiffness=1e9)]
    return Model(jointed, material=MATERIAL, joints=LAW, supports=held, **more)


def sloping(jointed):
    """Added mass along a normal that is no axis: it couples components."""
    ds = jointed.ds("top")
    return lambda u, v: 500.0 * (u[0] + 2.0 * u[2]) * (v[0] + 2.0 * v[2]) * ds


@pytest.mark.mpi
@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("ulps", [0.0, 8.0])
def test_products_are_those_of_the_whole_matrices(jointed, coupled, ulps):
    """Assembly sums in another order on other processors and ranks: entries differ by some ulp.

    Each entry is changed by up to 8 ulp, so that neither K nor M is symmetric to the last bit and
    the three equal entries of a block of M differ.
    """
    system = model(jointed, body=Body(extra_mass=sloping(jointed) if coupled else None)).system()
    rng = np.random.default_rng(system.stiffness.comm.rank)
    for matrix in (system.mass, system.stiffness):
        rounded = matrix.convert("aij", PETSc.Mat())
        starts, columns, values = rounded.getValuesCSR()
        values = values * (1.0 + ulps * np.finfo(float).eps * rng.uniform(-1, 1, len(values)))
        rounded.setValuesCSR(starts, columns, values)
        rounded.assemble()
        rounded.copy(matrix)
    halves = Halves.of(system.mass, system.stiffness)
    assert halves is not None
    x, expected = system.mass.createVecs()
    start, end = x.getOwnershipRange()
    x.setArray(np.sin(np.arange(start, end)))
    mass, stiffness = x.duplicate(), x.duplicate()
    halves.multiply(x, mass, stiffness)
    for matrix, product in ((system.mass, mass), (system.stiffness, stiffness)):
        matrix.mult(x, expected)
        expected.axpy(-1.0, product)
        assert expected.norm() <= 1e-14 * product.norm()


@pytest.mark.mpi
def test_a_stiffness_that_is_not_symmetric_has_no_half(jointed):
    # Whatever the model says of itself: half of it would be another matrix.
    ds = jointed.ds("top")
    system = model(jointed, body=Body(extra_stiffness=lambda u, v: 1e6 * u[0] * v[2] * ds)).system()
    assert system.symmetric
    assert Halves.of(system.mass, system.stiffness) is None
