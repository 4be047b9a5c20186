# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interior-facet integrals over joints against the joint operator B, and their signs.

Expected: the same sums over points, so differences of rounding only, 1e-13 of the largest value.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import ufl
from dolfinx import fem
from grids import CASES, SHAPES, distorted, name_of
from petsc4py import PETSc

from dolfinx_joints.joints.form_operator import FormOperator
from dolfinx_joints.joints.operator import JointOperator

pytestmark = pytest.mark.mpi
COMM = MPI.COMM_WORLD


def relative(found, expected):
    """Largest difference relative to the largest value, over all ranks."""
    difference, scale = (
        COMM.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)
        for values in (found - expected, expected)
    )
    return difference / scale


@pytest.mark.parametrize("scene", [*CASES, "gap"])
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_forms_are_the_operator(shape, scene):
    """Integral of the squared jump, jump, force and tangent; the tangent has no symmetry."""
    rule = "auto" if shape.degree == 1 or shape.name == "tetrahedron" else "gauss"
    jointed = distorted(COMM, shape, scene)
    mesh, degree = jointed.mesh, jointed.shape.degree
    V = fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))
    B = JointOperator(jointed, V, quadrature=rule)
    forms, rng = FormOperator(B), np.random.default_rng(COMM.rank)
    u = fem.Function(V)
    vector = u.x.petsc_vec
    vector.setRandom()
    u.x.scatter_forward()

    jump = ufl.jump(u + ufl.SpatialCoordinate(mesh))
    square = fem.form(ufl.inner(jump, jump) * jointed.dS(quadrature=rule, degree=degree))
    gap = B.jump(vector) + B.initial_gap
    by_points = COMM.allreduce(B.areas @ np.einsum("ni,ni->n", gap, gap))
    assert COMM.allreduce(fem.assemble_scalar(square)) == pytest.approx(by_points, rel=1e-13)
    assert relative(forms.jump(vector), B.jump(vector)) <= 1e-13

    count = len(B.areas)
    traction, tangent = rng.normal(size=(count, 3)), rng.normal(size=(count, 3, 3))
    assert (
        relative(*(o.force(traction, vector.duplicate()).getArray() for o in (forms, B))) <= 1e-13
    )
    free = vector.duplicate()
    free.set(1.0)
    by_form, by_matrix = (o.tangent_matrix(free).assemble(tangent) for o in (forms, B))
    scale = by_matrix.norm(PETSc.NormType.NORM_INFINITY)
    by_form.axpy(-1.0, by_matrix, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    assert by_form.norm(PETSc.NormType.NORM_INFINITY) <= 1e-13 * scale
