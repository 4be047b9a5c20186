# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ordinary function spaces on the surfaces of joints, in forms over ``jointed.dS``."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from grids import SHAPES, case, facets_on, grid, name_of
from petsc4py import PETSc

from dolfinx_joints import MeshError, mesh_from_arrays

pytestmark = pytest.mark.mpi

PLANE = [shape for shape in SHAPES if shape.dim == 2]
SOME = [SHAPES[k] for k in (0, 3, 5, 6)]  # one of each kind of cell, two of each degree


def crossing(comm, shape):
    """Four blocks between the joints a and b, which cross; the plane joints not along the axes."""
    cells, x, joints, _ = case("X", shape)
    rng = np.random.default_rng(3)
    new_node, new_cell = rng.permutation(len(x)), rng.permutation(len(cells))
    moved = np.empty_like(x)
    moved[new_node] = x @ (np.eye(shape.dim) + 0.2 * rng.normal(size=(shape.dim, shape.dim)))
    middle = x[cells].mean(axis=1)[new_cell]
    block = (middle[:, 0] > 2) + 2 * (middle[:, 1] > 2)
    return mesh_from_arrays(
        comm,
        cell=shape.name,
        x=moved,
        cells=new_node[cells][new_cell],
        facet_groups={name: new_node[facets] for name, facets in joints},
        cell_groups={f"block_{k}": np.flatnonzero(block == k) for k in range(4)},
        joints=[name for name, _ in joints],
    )


def blockwise_linear(jointed):
    """A displacement that is another linear function of the place in each block."""
    dim = jointed.mesh.geometry.dim
    u = fem.Function(fem.functionspace(jointed.mesh, ("Lagrange", jointed.shape.degree, (dim,))))
    rng = np.random.default_rng(5)
    for k in range(4):
        a, b = rng.normal(size=(dim, dim)), rng.normal(size=(dim, 1))
        u.interpolate(lambda x, a=a, b=b: a @ x[:dim] + b, jointed.cells(f"block_{k}"))
    u.x.scatter_forward()
    return u


def total(comm, form):
    return comm.allreduce(fem.assemble_scalar(form))


def assembled(form):
    vector = fem_petsc.assemble_vector(form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_projection_of_a_linear_jump_is_exact(comm, shape):
    """On the Lagrange space of a joint, which has every linear jump between two blocks."""
    jointed = crossing(comm, shape)
    u, surface, dS = blockwise_linear(jointed), jointed.surface("a"), jointed.dS("a")
    P = fem.functionspace(surface.mesh, ("Lagrange", 1, (shape.dim,)))
    p, q, found = ufl.TrialFunction(P), ufl.TestFunction(P), fem.Function(P)
    mass = fem_petsc.assemble_matrix(jointed.form(ufl.inner(p, q) * ufl.dx))
    mass.assemble()
    over_joint = fem_petsc.assemble_matrix(jointed.form(ufl.inner(p("-"), q("+")) * dS))
    over_joint.assemble()
    over_joint.axpy(-1.0, mass)
    assert over_joint.norm() <= 1e-14 * mass.norm()
    load = assembled(jointed.form(ufl.inner(ufl.jump(u), q("-")) * dS))
    solver = PETSc.KSP().create(comm)
    solver.setOperators(mass)
    solver.setType("cg")
    solver.getPC().setType("jacobi")
    solver.setTolerances(rtol=1e-15, atol=1e-50)
    solver.solve(load, found.x.petsc_vec)
    found.x.scatter_forward()
    left = found("-") - ufl.jump(u)
    form = jointed.form(ufl.inner(left, left) * dS)
    assert total(comm, form) <= 1e-26 * total(
        comm, jointed.form(ufl.inner(ufl.jump(u), ufl.jump(u)) * dS)
    )


@pytest.mark.parametrize("shape", SOME, ids=name_of)
def test_multipliers(comm, shape):
    """int m . [v] dS as blocks of a system is what it is of functions, and its own transpose."""
    jointed = crossing(comm, shape)
    u, surface, dS = blockwise_linear(jointed), jointed.surface(), jointed.dS()
    multiplier = fem.Function(
        fem.functionspace(surface.mesh, ("Lagrange", shape.degree, (shape.dim,)))
    )
    multiplier.interpolate(lambda x: np.sin(x[: shape.dim]) + 0.5)
    V, M = u.function_space, multiplier.function_space
    v, m = ufl.TestFunction(V), ufl.TrialFunction(M)
    w, n = ufl.TrialFunction(V), ufl.TestFunction(M)
    blocks = jointed.form(
        [
            [None, ufl.inner(m("-"), ufl.jump(v)) * dS],
            [ufl.inner(ufl.jump(w), n("-")) * dS, None],
        ]
    )
    expected = total(comm, jointed.form(ufl.inner(multiplier("-"), ufl.jump(u)) * dS))
    vectors = u.x.petsc_vec, multiplier.x.petsc_vec
    for i, j in ((0, 1), (1, 0)):
        block = fem_petsc.assemble_matrix(blocks[i][j])
        block.assemble()
        product = block.createVecLeft()
        block.mult(vectors[j], product)
        assert product.dot(vectors[i]) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shape", PLANE, ids=name_of)
def test_ranks_without_a_facet(comm, shape):
    """A joint of one facet, 1 m long: int y ds = 1/2, half of its length for each of two nodes."""
    cells, x = grid(shape, (4, 4))
    joint = facets_on(shape, cells, x, lambda x, y, z: x == 2 and y <= 1)
    jointed = mesh_from_arrays(
        comm, cell=shape.name, x=x, cells=cells, facet_groups={"joint": joint}
    )
    surface, dS = jointed.surface(), jointed.dS(quadrature=2)
    assert surface is jointed.surface("joint")
    assert sorted(comm.allgather(len(surface.number))) == [0] * (comm.size - 1) + [1]
    y = fem.Function(fem.functionspace(surface.mesh, ("Lagrange", 1)))
    y.interpolate(lambda x: x[1])
    two = fem.Function(surface.quadrature_space(2, 1))
    two.x.array[:] = 2.0
    assert total(comm, jointed.form(y("-") * two("+") * dS)) == pytest.approx(1.0, rel=1e-14)
    q = ufl.TestFunction(y.function_space)
    shares = assembled(jointed.form(q("-") * dS))
    assert shares.getSize() == 2
    np.testing.assert_allclose(shares.getArray(), 0.5, rtol=1e-14)


def test_tags_are_those_of_the_joints(comm):
    """Joints a and b of 4 facets each; their surface has a tag for each by its position."""
    jointed = crossing(comm, PLANE[0])
    surface = jointed.surface(["b", "a"])
    assert surface is jointed.surface()
    assert jointed.surface("b") is jointed.surface(["b"])
    dx = ufl.Measure("dx", domain=surface.mesh, subdomain_data=surface.cell_tags)
    for k, name in enumerate(jointed.joint_names):
        by_tag = total(comm, jointed.form(fem.Constant(surface.mesh, 1.0) * dx(k + 1)))
        assert by_tag == pytest.approx(total(comm, fem.form(1.0 * jointed.dS(name))), rel=1e-14)
        assert comm.allreduce(int(np.sum(surface.cell_tags.values == k + 1))) == 4


def test_forms_that_a_surface_cannot_serve(comm):
    jointed = crossing(comm, PLANE[0])
    with pytest.raises(MeshError, match=r"There is no joint 'c'; the joints are: a, b\."):
        jointed.surface("c")
    k = fem.Function(fem.functionspace(jointed.surface("a").mesh, ("DG", 0)))
    for dS in jointed.dS(), jointed.dS("b"), jointed.dS(["a", "b"]):
        with pytest.raises(MeshError, match="integrates a function over joints that are not in"):
            jointed.form(k("-") * dS)
    outside = "another measure than jointed.dS, or ds of a - side"
    for form in (
        k * jointed.ds("a+"),
        k * ufl.dx(domain=jointed.mesh),
        k("-") * jointed.dS()("everywhere"),
    ):
        with pytest.raises(MeshError, match=outside):
            jointed.form(form)
    whole = jointed.form(k("-") * jointed.dS("a") + 1.0 * jointed.dS())
    length = total(comm, fem.form(1.0 * jointed.dS()))
    assert total(comm, whole) == pytest.approx(length, rel=1e-14)
