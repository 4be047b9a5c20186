# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interior-facet integrals over joints against the joint operator B, and their signs.

Expected: the same sums over points, so differences of rounding only, 1e-13 of the largest value.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx import fem
from grids import CASES, SHAPES, case, name_of
from mpi4py import MPI

from dolfinx_joints import mesh_from_arrays
from dolfinx_joints.joints.form_operator import FormOperator
from dolfinx_joints.joints.operator import JointOperator

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
TOLERANCE = 1e-13


def distorted(shape, scene):
    """A grid with joints, its nodes moved, its cells and nodes in another order."""
    cells, x, joints, _ = case(scene, shape)
    rng = np.random.default_rng(3)
    new_node, new_cell = rng.permutation(len(x)), rng.permutation(len(cells))
    moved = np.empty_like(x)
    moved[new_node] = x + 0.1 * np.sin(x @ rng.normal(size=(shape.dim, shape.dim)))
    groups = {name: new_node[facets] for name, facets in joints}
    return mesh_from_arrays(
        COMM,
        cell=shape.name,
        x=moved,
        cells=new_node[cells][new_cell],
        facet_groups=groups,
        joints=list(groups),
    )


def largest(values):
    return COMM.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


@pytest.mark.parametrize("scene", CASES)
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_forms_are_the_operator(shape, scene):
    """Jump, force and tangent, in general position, with a law that knows no symmetry."""
    jointed = distorted(shape, scene)
    V = fem.functionspace(jointed.mesh, ("Lagrange", shape.degree, (shape.dim,)))
    rule = "nodal" if shape.degree == 1 else "gauss"
    B = JointOperator(jointed, V, quadrature=rule)
    forms = FormOperator(B)
    rng = np.random.default_rng(COMM.rank)
    u = fem.Function(V)
    u.x.petsc_vec.setRandom()
    u.x.scatter_forward()
    traction, tangent = rng.normal(size=(len(B.areas), 3)), rng.normal(size=(len(B.areas), 3, 3))
    vectors = [u.x.petsc_vec.duplicate() for _ in range(4)]
    free = u.x.petsc_vec.duplicate()
    free.set(1.0)
    pairs = [(B.jump(u.x.petsc_vec), forms.jump(u.x.petsc_vec))]
    pairs.append(
        [o.force(traction, v).getArray() for o, v in zip((B, forms), vectors[:2], strict=True)]
    )
    for operator, product in zip((B, forms), vectors[2:], strict=True):
        operator.tangent_matrix(free).assemble(tangent).mult(u.x.petsc_vec, product)
    pairs.append([product.getArray() for product in vectors[2:]])
    for expected, found in pairs:
        assert largest(found - expected) <= TOLERANCE * largest(expected)
