# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The measure dS over joints: its signs, spaces, curved faces and gaps, by hand.

The signs are the table of docs/conventions.md. Two blocks on either side of a plane joint through
the middle of a sheared unit body move by linear fields u = a + G x of their own, so that integrals
are values at the joint's centroid c times its area.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from dolfinx.mesh import CellType
from mpi4py import MPI
from rings import JOINT, quarter_ring

from dolfinx_joints import MeshError, mesh_from_arrays, split_mesh
from dolfinx_joints.joints.operator import JointOperator

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
KINDS = [CellType.triangle, CellType.quadrilateral, CellType.tetrahedron, CellType.hexahedron]
# x' = A x: the joint x = 1/2 is then inclined in every direction.
A = np.array([[1.0, 0.3, -0.2], [0.1, 1.2, 0.4], [-0.3, 0.2, 0.9]])


def split_body(kind, shear=A):
    """The body, split at x = 1/2."""
    dim = 2 if kind in KINDS[:2] else 3
    create = dolfinx_mesh.create_rectangle if dim == 2 else dolfinx_mesh.create_box
    mesh = create(COMM, [np.zeros(dim), np.ones(dim)], [4, 3, 2][:dim], kind)
    mesh.topology.create_connectivity(dim - 1, dim)
    cut = dolfinx_mesh.locate_entities(mesh, dim - 1, lambda x: np.isclose(x[0], 0.5))
    right = dolfinx_mesh.locate_entities(mesh, dim, lambda x: x[0] > 0.5 - 1e-9)
    left = dolfinx_mesh.locate_entities(mesh, dim, lambda x: x[0] < 0.5 + 1e-9)
    mesh.geometry.x[:, :dim] = mesh.geometry.x[:, :dim] @ shear[:dim, :dim].T
    return split_mesh(mesh, joints={"joint": cut}, cell_groups={"left": left, "right": right})


def linear_fields(jointed):
    """A displacement that is linear on each side, and its (a, G) on the + and the - side."""
    dim = jointed.mesh.geometry.dim
    u = fem.Function(fem.functionspace(jointed.mesh, ("Lagrange", 1, (dim,))))
    rng = np.random.default_rng(7)
    sides = [(rng.normal(size=dim), rng.normal(size=(dim, dim))) for _ in "+-"]
    # n points along A^-T e_x, whose largest component is x: the + side is to the right.
    for name, (a, G) in zip(("right", "left"), sides, strict=True):
        u.interpolate(lambda x, a=a, G=G: a[:, None] + G @ x[:dim], jointed.cells(name))
    u.x.scatter_forward()
    return u, *sides


def integral(form):
    return COMM.allreduce(fem.assemble_scalar(fem.form(form)), op=MPI.SUM)


def integrals(expressions, dS):
    """Of all components of some expressions, by one form."""
    parts = [e[i] if i else e for e in expressions for i in np.ndindex(e.ufl_shape)]
    chosen = fem.Constant(dS.ufl_domain(), np.zeros(len(parts)))
    form = fem.form(sum(chosen[k] * part for k, part in enumerate(parts)) * dS)
    found = []
    for unit in np.eye(len(parts)):
        chosen.value[:] = unit
        found.append(COMM.allreduce(fem.assemble_scalar(form), op=MPI.SUM))
    return np.array(found)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_signs(kind):
    jointed = split_body(kind)
    mesh, dim, dS = jointed.mesh, jointed.mesh.geometry.dim, jointed.dS("joint")
    u, (a, G), (b, H) = linear_fields(jointed)
    covector = np.linalg.inv(A[:dim, :dim]).T[:, 0]
    n = covector / np.linalg.norm(covector)
    area = np.linalg.norm(covector) * np.linalg.det(A[:dim, :dim])  # Nanson's formula
    c = A[:dim, :dim] @ np.full(dim, 0.5)
    plus, minus = a + G @ c, b + H @ c

    def sigma(v):
        return 3.0 * ufl.sym(ufl.grad(v)) + 2.0 * ufl.div(v) * ufl.Identity(dim)

    def stress(F):
        return 1.5 * (F + F.T) + 2.0 * np.trace(F) * np.eye(dim)

    normal, frame = ufl.FacetNormal(mesh), jointed.frame("joint")
    rows = JointOperator(jointed, u.function_space).layout.frames[0][:dim, :dim]
    jump, avg = ufl.jump(u), ufl.avg(u)
    rows_of_table = [
        (ufl.as_ufl(1.0), 1.0),
        (jump, plus - minus),
        (ufl.jump(u, normal), -(plus - minus) @ n),
        (normal("-"), n),
        (normal("+"), -n),
        (avg, (plus + minus) / 2),
        (frame[0, :], n),
        (ufl.dot(frame, jump), rows @ (plus - minus)),
        (ufl.jump(u + ufl.SpatialCoordinate(mesh)), plus - minus),
        (ufl.grad(u)("+"), G),
        (ufl.grad(u)("-"), H),
        (ufl.dot(ufl.avg(sigma(u)), normal("-")), (stress(G) + stress(H)) / 2 @ n),
    ]
    found = integrals([expression for expression, _ in rows_of_table], dS)
    expected = area * np.concatenate([np.ravel(value) for _, value in rows_of_table])
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


def test_the_frame_is_that_of_the_points():
    # Level, upright and inclined joints: s1 and s2 follow other axes, see docs/conventions.md.
    for turn in (np.eye(3), np.roll(np.eye(3), 1, axis=0), np.roll(np.eye(3), 2, axis=0), A):
        jointed = split_body(CellType.hexahedron, turn)
        V = fem.functionspace(jointed.mesh, ("Lagrange", 1, (3,)))
        expected = JointOperator(jointed, V).layout
        found = integrals([jointed.frame("joint")], jointed.dS("joint"))
        area = expected.areas.sum()
        np.testing.assert_allclose(found, area * expected.frames[0].ravel(), atol=1e-14 * area)


def test_several_spaces_in_one_form():
    # 3 on the + side (constant on cells) times y (continuous) times the jump y^2 of a quadratic
    # along x: the integral of 3 y^3 over the square is 3/4.
    jointed = split_body(CellType.tetrahedron, np.eye(3))
    spaces = [("DG", 0), ("Lagrange", 1), ("Lagrange", 2, (3,))]
    c, p, v = (fem.Function(fem.functionspace(jointed.mesh, space)) for space in spaces)
    right = jointed.cells("right")
    c.interpolate(lambda x: np.full(x.shape[1], 3.0), right)
    p.interpolate(lambda x: x[1])
    v.interpolate(lambda x: np.stack([x[1] ** 2, x[0], x[2]]), right)
    for function in (c, p, v):
        function.x.scatter_forward()
    n, dS = ufl.FacetNormal(jointed.mesh)("-"), jointed.dS("joint")
    form = c("+") * p("-") * ufl.dot(ufl.jump(v), n) * dS
    assert integral(form) == pytest.approx(0.75, rel=1e-13)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle", "hexahedron", "tetrahedron"])
def test_curved_joints(cell):
    # That of one side in the same rule, and of the quarter of a cylinder.
    jointed = mesh_from_arrays(COMM, **quarter_ring(cell, 4))
    dim, one = jointed.mesh.geometry.dim, fem.Constant(jointed.mesh, 1.0)
    area = integral(one("-") * jointed.dS("joint", quadrature=6))
    side = integral(one * jointed.ds("joint-")(degree=6))
    assert area == pytest.approx(side, rel=1e-13)
    height = 1.0 if dim == 2 else 0.5
    assert area == pytest.approx(np.pi / 2 * JOINT * height, rel=5e-5)  # order 4 in h


@pytest.mark.parametrize("wedge", [0.0, 1e-2, 1e-4])
def test_gaps_in_the_geometry(wedge):
    # Two columns of cells with faces of their own, the right one 1e-3 away and longer by the
    # factor 1 + wedge: x+ - x- = (1e-3, wedge y) at matching points.
    y = np.linspace(0.0, 1.0, 7)
    columns = [(0.0, 1.0), (1.0, 1.0), (1.001, 1.0 + wedge), (2.0, 1.0 + wedge)]
    x = np.vstack([np.column_stack([np.full(7, at), stretch * y]) for at, stretch in columns])
    first = np.concatenate([np.arange(6), 14 + np.arange(6)])
    cells = np.column_stack([first, first + 7, first + 1, first + 8])
    edges = np.column_stack([np.arange(6), np.arange(1, 7)])
    groups = {"joint-": 7 + edges, "joint+": 14 + edges}
    jointed = mesh_from_arrays(COMM, cell="quadrilateral", x=x, cells=cells, facet_groups=groups)
    gap = ufl.jump(ufl.SpatialCoordinate(jointed.mesh))
    area, opening = 1.0 + wedge, 1e-3  # the + face counts
    found = integrals([gap], jointed.dS())
    assert found == pytest.approx([area * opening, area * wedge / 2], rel=1e-12, abs=1e-15)
    # B has the areas of the - face: both are one but for an error of the order of gap / size.
    V = fem.functionspace(jointed.mesh, ("Lagrange", 1, (2,)))
    assert area / JointOperator(jointed, V).layout.areas.sum() - 1 == pytest.approx(wedge)


def test_no_ordinary_measure_has_joints():
    jointed = split_body(CellType.hexahedron)
    u, *_ = linear_fields(jointed)
    assert integral(ufl.jump(u)[0] ** 2 * ufl.dS) == pytest.approx(0.0, abs=1e-25)
    sides = np.concatenate([jointed.facets("joint-"), jointed.facets("joint+")])
    assert len(np.intersect1d(jointed.facet_tags.indices, sides)) == 0
    assert not any(name.startswith("joint") for name in jointed.facet_groups)
    with pytest.raises(
        MeshError, match=r"'joint' is a joint; integrals over it take dS\('joint'\)"
    ):
        jointed.ds("joint")
