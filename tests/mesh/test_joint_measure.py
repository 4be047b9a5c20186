# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The measure dS over joints: its signs, spaces, curved faces and gaps, by hand.

The signs are the table of docs/conventions.md. Two blocks on either side of a plane joint through
the middle of a sheared unit body move by linear fields u = a + G x of their own, so that integrals
are values at the joint's centroid c times its area.
"""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import basix.ufl
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from dolfinx.fem import petsc as fem_petsc
from dolfinx.mesh import CellType
from petsc4py import PETSc
from rings import HEIGHT, JOINT, quarter_ring
from whole_vectors import whole_layout

from dolfinx_joints import MeshError, mesh_from_arrays, split_mesh
from dolfinx_joints.joints.operator import JointOperator

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
KINDS = [CellType.triangle, CellType.quadrilateral, CellType.tetrahedron, CellType.hexahedron]
# x' = A x: the joint x = 1/2 is then inclined in every direction.
A = np.array([[1.0, 0.3, -0.2], [0.1, 1.2, 0.4], [-0.3, 0.2, 0.9]])


def points_of(jointed, V):
    """All joint points (collective)."""
    return whole_layout(COMM, JointOperator(jointed, V).layout)


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
    rows = points_of(jointed, u.function_space).frames[0][:dim, :dim]
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


LEVEL, UPRIGHT = np.roll(np.eye(3), 2, axis=0), np.roll(np.eye(3), 1, axis=0)
TURNS = {
    2: {
        "along y": np.eye(2),
        "along x": np.array([[0.0, -1.0], [1.0, 0.0]]),
        "inclined": A[:2, :2],
    },
    3: {"across x": np.eye(3), "across y": UPRIGHT, "level": LEVEL, "inclined": A},
}


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_frame_is_that_of_the_points(kind):
    # s1 and s2 follow other axes on level, upright and inclined joints, see docs/conventions.md.
    dim = 2 if kind in KINDS[:2] else 3
    for turn in TURNS[dim].values():
        jointed = split_body(kind, turn)
        V = fem.functionspace(jointed.mesh, ("Lagrange", 1, (dim,)))
        points = points_of(jointed, V)
        mean = integrals([jointed.frame("joint")], jointed.dS("joint")) / points.areas.sum()
        of_points = points.frames[:, :dim, :dim]
        np.testing.assert_allclose(of_points - mean.reshape(dim, dim), 0.0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_several_spaces_in_one_form(kind):
    # On the joint x = 1/2 of the unit square or cube: c = 3 on the + side, constant on cells;
    # p = y on the - side, discontinuous; [v] = y^2 along n; mixed (w, m): [w] = y along n, m = y on
    # the - side and 2 on the + side.
    jointed = split_body(kind, np.eye(3))
    mesh, dim, right = jointed.mesh, jointed.mesh.geometry.dim, jointed.cells("right")
    cell, left = mesh.topology.cell_name(), jointed.cells("left")
    scalar, vector = (basix.ufl.element("Lagrange", cell, 2, shape=s) for s in ((), (dim,)))
    spaces = [("DG", 0), ("DG", 1), vector, basix.ufl.mixed_element([vector, scalar])]
    c, p, v, mixed = (fem.Function(fem.functionspace(mesh, space)) for space in spaces)
    c.interpolate(lambda x: np.full(x.shape[1], 3.0), right)
    p.interpolate(lambda x: x[1], left)
    p.interpolate(lambda x: 1.0 + x[1], right)
    v.interpolate(lambda x: np.stack([x[1] ** 2, x[0], x[1]][:dim]), right)
    mixed.sub(0).interpolate(lambda x: np.stack([x[1], x[0], x[0]][:dim]), right)
    mixed.sub(1).interpolate(lambda x: x[1], left)
    mixed.sub(1).interpolate(lambda x: np.full(x.shape[1], 2.0), right)
    for function in (c, p, v, mixed):
        function.x.scatter_forward()
    n, dS = ufl.FacetNormal(mesh)("-"), jointed.dS("joint")

    def opening(u):
        return ufl.dot(ufl.jump(u), n)

    def work(w, m):
        return c("+") * p("-") * opening(w) * dS + ufl.avg(m) * opening(v) * dS

    # 3 y y + (y + 2)/2 y^2 from 0 to 1: 1 + 1/8 + 1/3, as a number and as a vector times (w, m).
    load = fem_petsc.assemble_vector(fem.form(work(*ufl.TestFunctions(mixed.function_space))))
    load.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    for found in (integral(work(*ufl.split(mixed))), load.dot(mixed.x.petsc_vec)):
        assert found == pytest.approx(35 / 24, rel=1e-13)
    # The second term as a matrix of two spaces.
    _, m = ufl.TestFunctions(mixed.function_space)
    coupling = fem_petsc.assemble_matrix(
        fem.form(ufl.avg(m) * opening(ufl.TrialFunction(v.function_space)) * dS)
    )
    coupling.assemble()
    coupling.mult(v.x.petsc_vec, load)
    assert load.dot(mixed.x.petsc_vec) == pytest.approx(11 / 24, rel=1e-13)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle", "hexahedron", "tetrahedron"])
def test_curved_joints(cell):
    # The quarter of a cylinder about z, by curved cells of degree 2: area as of one side in the
    # same rule, and of the cylinder with an error of order 4 in h. The integral of n depends on the
    # edge alone, (r, r) times the height.
    errors = []
    for boxes in (4, 8):
        jointed = mesh_from_arrays(COMM, **quarter_ring(cell, boxes))
        dim, one = jointed.mesh.geometry.dim, fem.Constant(jointed.mesh, 1.0)
        height = 1.0 if dim == 2 else HEIGHT
        dS = jointed.dS("joint", quadrature=6)
        area, *normal = integrals([one("-"), jointed.frame("joint")[0, :]], dS)
        assert area == pytest.approx(integral(one * jointed.ds("joint-")(degree=6)), rel=1e-13)
        assert normal == pytest.approx([JOINT * height, JOINT * height, 0.0][:dim], abs=1e-12)
        errors.append(area / (np.pi / 2 * JOINT * height) - 1.0)
    assert abs(errors[0]) < 5e-5
    assert np.log2(errors[0] / errors[1]) > 3.8


@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron"])
@pytest.mark.parametrize("degrees", [(1, 2), (2, 1)], ids=["quadratic on flat", "linear on curved"])
def test_displacements_of_another_degree_than_the_cells(cell, degrees):
    # |[u]|^2 over the joint as by B: the sum of w |B u|^2 over the points.
    jointed = mesh_from_arrays(COMM, **quarter_ring(cell, 4, degrees[0]))
    dim = jointed.mesh.geometry.dim
    u = fem.Function(fem.functionspace(jointed.mesh, ("Lagrange", degrees[1], (dim,))))
    u.interpolate(lambda x: np.sin([[2.0], [3.0], [5.0]] * x)[:dim], jointed.cells("core"))
    u.x.scatter_forward()
    B = JointOperator(jointed, u.function_space, quadrature="gauss")
    expected = COMM.allreduce(float(B.areas @ (B.jump(u.x.petsc_vec) ** 2).sum(axis=1)))
    dS = jointed.dS(quadrature="gauss", degree=degrees[1])
    assert expected > 0.1
    assert integral(ufl.inner(ufl.jump(u), ufl.jump(u)) * dS) == pytest.approx(expected, rel=1e-13)


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
    assert area / points_of(jointed, V).areas.sum() - 1 == pytest.approx(wedge)


@pytest.mark.parametrize("kind", [CellType.triangle, CellType.tetrahedron], ids=["2-D", "3-D"])
def test_functions_on_the_joint_fit_both_sides(kind):
    # Under dS, and under ds of the - side, whose codes dS leaves as they are: a function on the
    # joint is the polynomial of x that it interpolates.
    jointed = split_body(kind)
    surface, x = jointed.surface(), ufl.SpatialCoordinate(jointed.mesh)
    q = fem.Function(fem.functionspace(surface.mesh, ("Lagrange", 2)))
    q.interpolate(lambda x: x[0] + x[1] ** 2)
    wrong, dS = (q - x[0] - x[1] ** 2) ** 2, jointed.dS()
    for form in (wrong("+") * dS, wrong("-") * dS, wrong * jointed.ds("joint-")):
        found = COMM.allreduce(fem.assemble_scalar(jointed.form(form)))
        assert found == pytest.approx(0.0, abs=1e-28)


def test_no_ordinary_measure_has_joints():
    jointed = split_body(CellType.hexahedron)
    sides = np.concatenate([jointed.facets("joint-"), jointed.facets("joint+")])
    assert len(np.intersect1d(jointed.facet_tags.indices, sides)) == 0
    assert not any(name.startswith("joint") for name in jointed.facet_groups)
    for measure in (jointed.ds, jointed.facets):
        with pytest.raises(
            MeshError,
            match=r"'joint' is a joint, not a facet group; use dS\('joint'\) for integrals, or "
            r"its sides 'joint-' and 'joint\+'",
        ):
            measure("joint")
    for nothing in ([], (), 1):
        with pytest.raises(MeshError, match="give joint names, or None for all"):
            jointed.dS(nothing)
    with pytest.raises(ValueError, match=r"degree is 4 but quadrature is not.*\(degree=4\)"):
        jointed.dS(degree=4)


@pytest.mark.skipif(COMM.size > 1, reason="DOLFINx refuses ufl.dS where ranks have no ghosts")
def test_interior_facets_are_those_inside_the_blocks():
    # 4 x 3 x 2 cells in the unit cube: faces inside at x = 1/4, 3/4, y = 1/3, 2/3, z = 1/2
    # have the area 5, the joint at x = 1/2 has 1.
    jointed = split_body(CellType.hexahedron, np.eye(3))
    u, *_ = linear_fields(jointed)
    one, inside = fem.Constant(jointed.mesh, 1.0), ufl.dS(domain=jointed.mesh)
    assert integral(ufl.jump(u)[0] ** 2 * inside) == pytest.approx(0.0, abs=1e-25)
    assert integral(one("+") * inside) == pytest.approx(5.0, rel=1e-13)
    both = one("+") * jointed.dS()("everywhere") + 10.0 * one("+") * jointed.dS()
    assert integral(both) == pytest.approx(15.0, rel=1e-13)
