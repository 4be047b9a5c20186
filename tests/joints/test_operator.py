# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The joint operator: patch tests, adjointness, tangent, areas, frames, independence of ranks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import basix
import basix.ufl
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    compute_midpoints,
    create_box,
    create_rectangle,
    locate_entities,
    meshtags,
)
from grids import CASES, SHAPES, case, name_of
from petsc4py import PETSc
from whole_vectors import whole_layout

from dolfinx_joints import (
    Elastic,
    Fixed,
    FormLoad,
    FrictionNoTension,
    Joints,
    JointsError,
    Model,
    Simulation,
    mesh_from_arrays,
    read_msh,
    split_mesh,
)
from dolfinx_joints.joints.contact import Contact
from dolfinx_joints.joints.operator import JointOperator, JointTangent
from dolfinx_joints.joints.points import joint_points
from dolfinx_joints.laws.law import JointState, Status
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.dolfinx_versions import gmsh_permutation
from dolfinx_joints.mesh.joint_pairs import fixed_axis, frames
from dolfinx_joints.mesh.reading.gmsh_file import load_msh
from dolfinx_joints.mesh.splitting import split_cells

pytestmark = pytest.mark.mpi

CONCRETE = Elastic(young=25e9, poisson=0.2, density=2400.0)
LAW = FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=45.0)
ANGLE = 20.0

# (cell, order of the mesh, quadrature)
ALL = [
    *itertools.product(("hex", "tet", "tri", "quad"), (1, 2), ("nodal", "gauss")),
    ("tet", 2, "auto"),
]

of_every_kind = pytest.mark.parametrize(
    ("jointed", "rule"), [((c, o), r) for c, o, r in ALL], indirect=["jointed"], ids=str
)


@pytest.fixture
def jointed(request, blocks_file, two_rectangles_file, read):
    """Two blocks, one on the other, with a joint inclined by 20 degrees."""
    cell, order = request.param[:2]
    make = blocks_file if cell in ("hex", "tet") else two_rectangles_file
    return read(make(cell=cell, order=order, angle=ANGLE))


def held_at_base(jointed, rule="auto", **options):
    supports = [Fixed(group="base")]
    return Model(
        jointed,
        material=CONCRETE,
        joints=Joints(LAW, quadrature=rule),
        supports=supports,
        **options,
    )


def random_vector(model, seed=0, size=1.0):
    u = model.mass.createVecRight()
    rng = np.random.default_rng((seed, u.comm.rank))
    u.setArray(size * rng.standard_normal(u.getLocalSize()))
    return u


def displaced(model, **motions):
    """Vector of a displacement, a function of the coordinates for each group or the whole body."""
    moved = fem.Function(model.V)
    for group, motion in motions.items():
        cells = () if group == "body" else (model.jointed.cells(group),)
        moved.interpolate(motion, *cells)
    u = model.mass.createVecRight()
    u.setArray(moved.x.array[: u.getLocalSize()])
    return u


def total(comm, value):
    return comm.allreduce(float(value))


def largest(comm, values):
    return comm.allreduce(float(np.max(np.abs(values), initial=0.0)), op=MPI.MAX)


# Patch test. Both blocks carry the uniform stress of u = a h, h being the height above the base:
# the strain is sym(a x e) with e upwards, the base does not move, and the joint, of normal n,
# opens by t/k in its local frame with t = sigma n (penalty joint, compressed and sticking).


def patch(model, gradient):
    """Stress of u = gradient h, [Pa]."""
    gdim = model.gdim
    up = np.eye(gdim)[-1]
    strain = 0.5 * (np.outer(gradient, up) + np.outer(up, gradient))
    first = (
        CONCRETE.young * CONCRETE.poisson / ((1 + CONCRETE.poisson) * (1 - 2 * CONCRETE.poisson))
    )
    shear = CONCRETE.young / (2 * (1 + CONCRETE.poisson))
    return first * np.trace(strain) * np.eye(gdim) + 2 * shear * strain


def joint_axes(gdim):
    """Normal (upwards) of the joint plane."""
    slope = np.radians(ANGLE)
    n = np.zeros(gdim)
    n[0], n[-1] = -np.sin(slope), np.cos(slope)
    return n


def report(comm, what, error):
    """Print a measured number, shown by ``pytest -s``."""
    if comm.rank == 0:
        print(f"{what}: {error:.2e} on {comm.size} ranks")


@of_every_kind
def test_patch(jointed, rule, comm):
    gdim = jointed.mesh.geometry.dim
    gradient = np.array([2e-5, -1e-5, -2e-4])[[0, 2] if gdim == 2 else [0, 1, 2]]
    model = held_at_base(jointed, rule)
    stress = patch(model, gradient)
    outward = ufl.FacetNormal(jointed.mesh)
    pull = ufl.dot(ufl.as_matrix(stress.tolist()), outward)
    for group in ("top", "sides"):
        ds = jointed.ds(group)
        model.loads.append(FormLoad(form=lambda v, ds=ds: ufl.inner(pull, v) * ds))
    static = Simulation(model).statics()

    n = joint_axes(gdim)
    traction = stress @ n
    normal = n * (n @ traction)
    jump = normal / LAW.normal_stiffness + (traction - normal) / LAW.shear_stiffness
    assert n @ traction < 0  # compressed, and inside the friction cone by the choice of gradient
    assert np.linalg.norm(traction - normal) < 0.9 * abs(n @ traction)
    exact = displaced(
        model,
        lower=lambda x: np.outer(gradient, x[gdim - 1]),
        upper=lambda x: np.outer(gradient, x[gdim - 1]) + jump[:, None],
    )
    error = largest(comm, (static.displacement - exact).array) / largest(comm, exact.array)
    report(comm, "patch error", error)
    assert error <= 1e-12

    # The tractions in the local frame are frame . sigma n, up to the sign of the side convention.
    operator = model.operator
    local = operator.frames[:, :, :gdim] @ traction * np.sign(operator.frames[:, :1, :gdim] @ n)
    size = np.linalg.norm(traction)
    assert largest(comm, static.joints.traction - local) <= 1e-9 * size
    assert model.contact.counts(static.joints.status).stick == operator.num_points


@of_every_kind
def test_force_is_the_adjoint_of_gap(jointed, rule, comm):
    # <w t, B u> = <u, B^T (w t)> by definition, for any u and t.
    model = held_at_base(jointed, rule)
    operator = model.operator
    u = random_vector(model)
    traction = np.random.default_rng((1, comm.rank)).standard_normal((len(operator.areas), 3))
    gap = operator.jump(u)
    force = operator.force(traction, u.duplicate())
    one = total(comm, np.sum(operator.areas[:, None] * traction * gap))
    size = np.sqrt(total(comm, np.sum(gap**2)) * total(comm, np.sum(traction**2)))
    size *= largest(comm, operator.areas)
    error = abs(one - u.dot(force)) / size
    report(comm, "adjointness", error)
    assert error <= 1e-13


@of_every_kind
def test_rigid_motion_makes_no_gap(jointed, rule, comm):
    model = held_at_base(jointed, rule)
    gdim = model.gdim
    u = displaced(model, body=lambda x: block_motion(0, x[:gdim].T).T)
    assert largest(comm, model.operator.jump(u)) <= 1e-13 * u.norm(PETSc.NormType.INFINITY)


@of_every_kind
def test_gap_of_a_jump_and_area(jointed, rule, comm):
    # The upper block moves by d as a whole: every gap is frame . d, whatever side is +.
    model = held_at_base(jointed, rule)
    operator, gdim = model.operator, model.gdim
    d = np.array([0.3, -0.2, 0.7])[[0, 2] if gdim == 2 else [0, 1, 2]]
    u = displaced(model, upper=lambda x: np.tile(d[:, None], x.shape[1]))
    side = np.sign(operator.frames[:, 0, :gdim] @ joint_axes(gdim))  # 1 where + is above
    expected = side[:, None] * (operator.frames[:, :, :gdim] @ d)
    assert largest(comm, operator.jump(u) - expected) <= 1e-13
    # A joint across a unit square (or length) inclined by 20 degrees: 1 / cos 20.
    area = total(comm, operator.areas.sum())
    assert area == pytest.approx(1 / np.cos(np.radians(ANGLE)), rel=1e-13)


@of_every_kind
def test_points_and_frames(jointed, rule, comm):
    model = held_at_base(jointed, rule)
    operator, gdim = model.operator, model.gdim
    frames = operator.frames
    identity = frames @ np.swapaxes(frames, 1, 2)
    assert largest(comm, identity - np.eye(3)) <= 1e-14
    assert largest(comm, np.linalg.det(frames) - 1) <= 1e-14
    # The points lie on the plane h = 1 + (x - 1/2) tan 20, and the normal is that plane's.
    points = operator.points
    height = 1 + (points[:, 0] - 0.5) * np.tan(np.radians(ANGLE))
    assert largest(comm, points[:, gdim - 1] - height) <= 1e-13
    assert largest(comm, np.abs(frames[:, 0, :gdim] @ joint_axes(gdim)) - 1) <= 1e-13
    # On a plane joint all frames are one.
    first = comm.bcast(frames[0] if comm.rank == 0 else None, root=0)
    assert largest(comm, frames - first) <= 1e-13


X, Y, Z = np.eye(3)


@pytest.mark.parametrize(
    ("normals", "along", "up"),
    [
        # docs/conventions.md: s2 steepest upwards, s1 = s2 x n horizontal; in a level joint s1 is
        # along x, in one that is level here and upright across x there, along y.
        ([X], [Y], [Z]),
        ([Y], [-X], [Z]),
        ([[0.8, 0.0, 0.6]], [Y], [[-0.6, 0.0, 0.8]]),
        ([Z], [X], [Y]),
        ([Z, X], [Y, Y], [-X, Z]),
        ([[0.6, 0.0, 0.8], Z], [[0.8, 0.0, -0.6], X], [Y, Y]),
    ],
)
def test_axes_of_joints(normals, along, up):
    normal = np.array(normals)
    found = frames(normal, fixed_axis(normal), plane=False)
    expected = np.stack([normal, np.array(along), np.array(up)], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("normal", "along"), [(Y, -X), (X, Y), ([0.6, 0.8, 0.0], [-0.8, 0.6, 0.0])]
)
def test_axes_of_joints_in_the_plane(normal, along):
    # docs/guide/joints.md: s1 is n turned by 90 degrees counterclockwise, s2 is out of the plane.
    found = frames(np.array([normal]), 0, plane=True)
    np.testing.assert_allclose(found[0], [normal, along, Z], atol=1e-15)


@pytest.mark.parametrize(("name", "sign"), [("two_rectangles_file", -1.0), ("blocks_file", 1.0)])
def test_slip_of_a_level_joint_along_x(request, read, name, sign):
    # The upper block moved by 1 mm along x: that is along -s1 in 2-D, along s1 in space.
    jointed = read(request.getfixturevalue(name)(angle=0.0))
    gdim = jointed.mesh.geometry.dim
    model = Model(jointed, material=CONCRETE, joints=LAW)
    u = displaced(model, upper=lambda x: np.outer(1e-3 * np.eye(gdim)[0], np.ones(x.shape[1])))
    expected = np.tile([0.0, sign * 1e-3, 0.0], (len(model.operator.areas), 1))
    np.testing.assert_allclose(model.contact.gap(u), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("jointed", "rule", "count"),
    [
        # 2 x 2 squares: 9 nodes, at order 2 25; 2 x 2 x 2 triangles: 9 corners.
        (("hex", 1), "nodal", 9),
        (("hex", 2), "nodal", 25),
        (("tet", 1), "nodal", 9),
        # Order 2: on the edges only, of which 8 triangles have 16.
        (("tet", 2), "nodal", 16),
        (("tet", 2), "auto", 33),  # 25 nodes and 8 centres
        # 3 edges: 4 nodes, 7 at order 2.
        (("quad", 1), "nodal", 4),
        (("tri", 2), "nodal", 7),
    ],
    indirect=["jointed"],
    ids=str,
)
def test_points_at_nodes_are_one_per_pair(jointed, rule, count):
    assert held_at_base(jointed, rule).operator.num_points == count


@of_every_kind
def test_tangent_against_finite_differences(jointed, rule, comm):
    # Central differences of B^T (w t(B u)) along a random direction, at a random state with open,
    # sticking and sliding points.
    model = held_at_base(jointed, rule)
    operator = model.operator
    rng = np.random.default_rng((2, comm.rank))
    u = random_vector(model, seed=3, size=1e-3)
    count = len(operator.areas)
    # Initial gaps by the global number of the point: every fourth is open.
    number = sum(comm.allgather(count)[: comm.rank]) + np.arange(count)
    wanted = np.where(number % 4 == 3, 1e-4, -2e-3) * (1 + 0.3 * rng.random(count))
    offset = wanted - operator.jump(u)[:, 0]
    contact = Contact(operator, LAW, {"joint_1": lambda points: offset})
    slip = np.where((number % 4 == 1)[:, None], 1e-6, 3e-2) * rng.standard_normal((count, 2))
    state = JointState(gap=contact.gap(u), elastic_slip=slip)
    if model.gdim == 2:
        state.elastic_slip[:, 1] = 0.0
    response = contact.trial(u, state)
    counts = contact.counts(response.status)
    assert min(counts.open, counts.stick, counts.slip) > 0

    free = u.duplicate()
    free.set(1.0)
    direction = random_vector(model, seed=4)
    predicted = u.duplicate()
    JointTangent(operator, free).assemble(response.tangent).mult(direction, predicted)
    step = 1e-8
    ends = []
    for sign in (1.0, -1.0):
        moved = u.copy()
        moved.axpy(sign * step, direction)
        ends.append(operator.force(contact.trial(moved, state).traction, u.duplicate()))
    difference = ends[0]
    difference.axpy(-1.0, ends[1])
    difference.scale(0.5 / step)
    difference.axpy(-1.0, predicted)
    error = difference.norm() / predicted.norm()
    report(comm, "tangent against differences", error)
    assert error <= 1e-7


def test_tangent_leaves_constrained_dofs_alone(blocks_file, read, comm):
    # Rows and columns of constrained dofs are zero: T x does not change where x changes there.
    model = held_at_base(read(blocks_file()))
    free = model.mass.createVecRight()
    rng = np.random.default_rng((5, comm.rank))
    free.setArray(rng.integers(0, 2, free.getLocalSize()).astype(float))
    tangent = JointTangent(model.operator, free).assemble(model.contact.closed_tangent())
    x = random_vector(model, seed=6)
    held = x.copy()
    held.pointwiseMult(x, free)
    one, two = x.duplicate(), x.duplicate()
    tangent.mult(x, one)
    tangent.mult(held, two)
    assert largest(comm, one.getArray() - two.getArray()) <= 1e-14 * one.norm()
    two.pointwiseMult(one, free)
    assert largest(comm, one.getArray() - two.getArray()) == 0.0


def node_orders(shape):
    """Orders of a cell's nodes that describe the same cell, seen from another side."""
    points = shape.element().points
    if shape.name == "tetrahedron":  # every order of its vertices will do
        corners = basix.cell.geometry(shape.type)[list(itertools.permutations(range(4)))]
        weights = np.column_stack([1 - points.sum(axis=1), points])
        turned = np.einsum("qv,tvi->tqi", weights, corners)
    else:  # the 24 rotations of a cube
        signs = itertools.product((1, -1), repeat=3)
        axes = itertools.permutations(range(3))
        turns = [np.diag(s) @ np.eye(3)[list(a)] for s, a in itertools.product(signs, axes)]
        turned = np.array([(points - 0.5) @ t.T + 0.5 for t in turns if np.linalg.det(t) > 0])
    return np.linalg.norm(turned[:, :, None] - points, axis=3).argmin(axis=2)


@pytest.mark.parametrize(
    ("cell", "order", "rule"), [*itertools.product(["hex", "tet"], [1, 2], ["nodal", "gauss"])]
)
def test_sides_whose_cells_are_turned(comm, blocks_file, cell, order, rule):
    # The nodes of every cell in a random admissible order, so that the facets of the two sides
    # start at different vertices. Points must meet nevertheless: a rigid rotation makes no gap,
    # and where the upper block alone moves by H x, the gap at x is frame . H x.
    path = blocks_file(cell=cell, order=order, angle=0.0)
    raw = load_msh(path)
    orders = node_orders(raw.shape)
    chosen = orders[np.random.default_rng(11).integers(0, len(orders), len(raw.cells))]
    jointed = mesh_from_arrays(
        comm,
        cell=raw.shape.name,
        x=raw.x,
        cells=np.take_along_axis(raw.cells, chosen, axis=1),
        facet_groups=raw.facet_groups,
    )
    match = jointed.pairs.gathered(comm).match
    assert np.any(match != np.arange(match.shape[1]))

    model = held_at_base(jointed, rule)
    operator = model.operator
    count = jointed.mesh.topology.index_map(3).size_local
    count += jointed.mesh.topology.index_map(3).num_ghosts
    every = np.arange(count, dtype=np.int32)
    upper = every[compute_midpoints(jointed.mesh, 3, every)[:, 2] > 1.0]
    gradient = np.array([[1.0, 2.0, -1.0], [0.5, -1.0, 3.0], [2.0, 1.0, 0.3]])
    moved = fem.Function(model.V)
    moved.interpolate(lambda x: gradient @ x, upper)
    u = model.mass.createVecRight()
    u.setArray(moved.x.array[: u.getLocalSize()])
    expected = np.einsum("nij,jk,nk->ni", operator.frames, gradient, operator.points)
    assert np.all(operator.frames[:, 0, 2] > 0.99)
    assert largest(comm, operator.jump(u) - expected) <= 1e-12
    assert total(comm, operator.areas.sum()) == pytest.approx(1.0, rel=1e-13)


def test_wall_areas_and_normals(wall_file, read, comm):
    # Joints are planes x = 5, 10, 15 of 4 m x 20 m; normals follow +x by convention.
    operator = held_at_base(read(wall_file(cell="tet"))).operator
    assert operator.names == ("joint_1", "joint_2", "joint_3")
    for i, x in enumerate((5.0, 10.0, 15.0)):
        here = operator.joint == i
        assert total(comm, operator.areas[here].sum()) == pytest.approx(80.0, rel=1e-13)
        assert largest(comm, operator.points[here, 0] - x) <= 1e-12
    assert largest(comm, operator.frames[:, 0] - [1.0, 0.0, 0.0]) <= 1e-13


def curved_body(comm, cell):
    """A box whose mid-plane x = 1/2, bent to a paraboloid, is the joint ``joint_1``."""
    mesh = create_box(comm, [[0, 0, 0], [1, 1, 1]], [2, 6, 6], cell)
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    inside = locate_entities(mesh, tdim - 1, lambda x: np.isclose(x[0], 0.5))
    base = locate_entities(mesh, tdim - 1, lambda x: np.isclose(x[2], 0.0))
    facets = np.concatenate([inside, base])
    values = np.concatenate([np.full(len(inside), 7), np.full(len(base), 3)]).astype(np.int32)
    order = np.argsort(facets)
    tags = meshtags(mesh, tdim - 1, facets[order], values[order])
    x = mesh.geometry.x
    x[:, 0] += 0.3 * ((x[:, 1] - 0.5) ** 2 + x[:, 2] ** 2)
    return split_mesh(mesh, tags, joints={"joint_1": 7}, groups={"base": 3})


@pytest.mark.parametrize("rule", ["nodal", "gauss"])
@pytest.mark.parametrize("cell", [CellType.hexahedron, CellType.tetrahedron])
def test_frames_are_continuous_on_a_curved_joint(comm, cell, rule):
    # x = 1/2 + 0.3 ((y - 1/2)^2 + z^2): curvatures are at most 0.6 / m, so that over a distance d
    # the exact frame turns by about 0.6 d; facets of 1/6 m and the choice of the steepest
    # direction add to that. A frame that jumps would turn by more than 1.
    operator = held_at_base(curved_body(comm, cell), rule).operator
    layout = whole_layout(comm, operator.layout)
    separation = np.linalg.norm(layout.points[:, None] - layout.points[None], axis=2)
    turn = np.abs(layout.frames[:, None] - layout.frames[None]).max(axis=(2, 3))
    assert np.all(turn <= 0.25 + 1.0 * separation)
    assert np.allclose(np.linalg.det(layout.frames), 1.0, atol=1e-13)
    # The normal of the surface by hand: (1, -0.6 (y - 1/2), -0.6 z), made a unit vector.
    y, z = layout.points[:, 1], layout.points[:, 2]
    normal = np.column_stack([np.ones_like(y), -0.6 * (y - 0.5), -0.6 * z])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert np.max(np.linalg.norm(layout.frames[:, 0] - normal, axis=1)) <= 0.15
    # s1 is horizontal, s2 points upwards in the joint (module docstring of joint_frames).
    assert np.max(np.abs(layout.frames[:, 1, 2])) <= 1e-13
    assert np.min(layout.frames[:, 2, 2]) > 0.7


@pytest.mark.parametrize(
    ("jointed", "rule"),
    [(("hex", 1), "nodal"), (("hex", 2), "gauss"), (("tet", 2), "gauss"), (("tri", 1), "nodal")],
    indirect=["jointed"],
    ids=str,
)
def test_every_rank_count_gives_the_same_points(
    request, jointed, rule, comm, blocks_file, two_rectangles_file, read
):
    # Reference: the same file read on a communicator of this process alone.
    cell, order = request.node.callspec.params["jointed"]
    make = blocks_file if cell in ("hex", "tet") else two_rectangles_file
    alone = held_at_base(read(make(cell=cell, order=order, angle=ANGLE), on=MPI.COMM_SELF), rule)
    model = held_at_base(jointed, rule)

    def field(x):
        waves = [np.sin(3 * x[0] + x[1]), np.cos(2 * x[1] - x[2]), np.exp(x[0] * x[1])]
        return np.array(waves[: model.gdim])

    def sheared(x):
        return field(x) + (x[0] + 2 * x[-1 if model.gdim == 3 else 1])

    gaps = []
    for one in (model, alone):
        gaps.append(one.operator.jump(displaced(one, lower=field, upper=sheared)))
    layout = whole_layout(comm, model.operator.layout)
    for name in ("points", "frames", "areas", "joint", "number", "share", "sizes", "facet"):
        here, there = getattr(layout, name), getattr(alone.operator.layout, name)
        np.testing.assert_allclose(here, there, rtol=0, atol=1e-13)
    together = np.concatenate(comm.allgather(gaps[0]))
    np.testing.assert_allclose(together, gaps[1], rtol=0, atol=1e-13)
    assert model.operator.matrix.norm() == pytest.approx(alone.operator.matrix.norm(), rel=1e-13)


@pytest.mark.parametrize(
    ("rule", "sixteenths"),
    [("nodal", [1, 1, 3, 5, 7]), ("gauss", [1, 1, 3, 3, 5, 5, 7, 7])],
)
def test_sizes_are_those_of_the_smallest_facet_around_a_point(comm, rule, sixteenths):
    # Vertices of the joint at y = 0, 1, 4, 9, 16 sixteenths: edges of 1, 3, 5 and 7; a vertex has
    # the smaller of its two, a Gauss point its own.
    mesh = create_rectangle(comm, [[0, 0], [1, 1]], [2, 4], CellType.quadrilateral)
    mesh.topology.create_connectivity(1, 2)
    cut = locate_entities(mesh, 1, lambda x: np.isclose(x[0], 0.5))
    base = locate_entities(mesh, 1, lambda x: np.isclose(x[1], 0.0))
    mesh.geometry.x[:, 1] **= 2
    jointed = split_mesh(mesh, joints={"joint_1": cut}, groups={"base": base})
    operator = held_at_base(jointed, rule).operator
    found = np.concatenate(comm.allgather(np.column_stack([operator.points[:, 1], operator.sizes])))
    found = found[np.argsort(found[:, 0]), 1]
    np.testing.assert_allclose(16 * found, sixteenths, rtol=1e-14)


def test_fewer_cells_than_ranks(comm):
    # Two squares of 1 m with a joint between them: on three ranks and more some have no cells.
    mesh = create_rectangle(comm, [[0, 0], [2, 1]], [2, 1], CellType.quadrilateral)
    mesh.topology.create_connectivity(1, 2)
    middle = locate_entities(mesh, 1, lambda x: np.isclose(x[0], 1.0))
    jointed = split_mesh(mesh, joints={"joint_1": middle})
    assert jointed.mesh.topology.index_map(2).size_global == 2
    assert jointed.pairs.count == 1
    assert jointed.mesh.geometry.index_map().size_global == 8
    operator = JointOperator(jointed, fem.functionspace(jointed.mesh, ("Lagrange", 1, (2,))))
    assert total(comm, operator.areas.sum()) == pytest.approx(1.0, rel=1e-14)  # the edge
    assert not operator.initial_gap.any()


@pytest.mark.parametrize(
    ("jointed", "entries"),
    # A nodal point has one node on each side. In the inclined joint n and s2 have two components,
    # s1, horizontal, has one; in the level one n, s1 and s2 are axes.
    [(("hex", 1, 20.0), 2 * 5), (("hex", 1, 0.0), 2 * 3), (("hex", 2, 0.0), 2 * 3)],
    ids=str,
)
def test_nodal_operator_holds_no_entries_of_rounding(comm, blocks_file, read, jointed, entries):
    cell, order, angle = jointed
    operator = held_at_base(read(blocks_file(cell=cell, order=order, angle=angle))).operator
    held = total(comm, operator.matrix.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"])
    assert held == entries * operator.num_points


def test_gather_keeps_the_global_order(wall_file, read, comm):
    operator = held_at_base(read(wall_file())).operator
    points, layout = operator.gather(operator.points), whole_layout(comm, operator.layout)
    if comm.rank == 0:
        np.testing.assert_array_equal(points, layout.points)
    assert (points is None) == (comm.rank > 0)


def test_statuses_of_a_pressed_and_a_lifted_joint(blocks_file, read, comm):
    # Gaps by hand: the upper block is lowered, then lifted along the joint's normal.
    jointed = read(blocks_file(angle=0.0))
    model = held_at_base(jointed)
    for lift, status in ((-1e-4, Status.STICK), (1e-4, Status.OPEN)):
        u = displaced(
            model, upper=lambda x, lift=lift: np.outer([0.0, 0.0, lift], np.ones_like(x[0]))
        )
        rest = model.contact.at_rest(model.mass.createVecRight())
        response = model.contact.trial(u, rest)
        assert comm.allreduce(int(np.sum(response.status != status))) == 0
        # t_n = k_n g where closed; w t summed is the force on the 1 m^2 joint.
        force = total(comm, model.operator.areas @ response.traction[:, 0])
        assert force == pytest.approx(min(1e11 * lift, 0.0), rel=1e-12)


def apart(comm, distance):
    """Two unit squares, one above the other, ``distance`` apart; faces joint_1- and joint_1+."""
    side = np.linspace(0.0, 1.0, 4)
    x, y = np.meshgrid(side, np.concatenate([side, 1.0 + distance + side]))
    node = np.arange(x.size).reshape(x.shape)
    rows = {"base": 0, "joint_1-": 3, "joint_1+": 4, "top": 7}
    return mesh_from_arrays(
        comm,
        cell="quadrilateral",
        x=np.column_stack([x.ravel(), y.ravel()]),
        cells=[node[j : j + 2, i : i + 2].ravel() for j in (0, 1, 2, 4, 5, 6) for i in range(3)],
        facet_groups={n: np.column_stack([node[j, :-1], node[j, 1:]]) for n, j in rows.items()},
    )


@pytest.mark.parametrize("distance", [0.0, 0.02])
@pytest.mark.parametrize("rule", ["nodal", "gauss"])
def test_faces_apart_in_the_mesh_are_an_initial_gap(comm, distance, rule):
    # The normal points from the - face, below, to the + face: a gap of the distance, open.
    model = held_at_base(apart(comm, distance), rule)
    operator = model.operator
    expected = np.tile([distance, 0.0, 0.0], (len(operator.areas), 1))
    assert largest(comm, operator.initial_gap - expected) <= 1e-14
    assert largest(comm, operator.frames[:, 0] - [0.0, 1.0, 0.0]) <= 1e-14
    assert total(comm, operator.areas.sum()) == pytest.approx(1.0, rel=1e-14)
    u = model.mass.createVecRight()
    assert largest(comm, model.contact.gap(u) - expected) <= 1e-14


# Networks of `test_splitting` as .msh files: with joints to be split, and split already. The blocks
# between the joints, by a number for each place, are moved as rigid bodies.

BLOCKS = {
    "through": lambda x, y: x > 2,
    "T": lambda x, y: (x > 2) * (1 + (y > 2)),
    "X": lambda x, y: (x > 2) + 2 * (y > 2),
    "perimetral": lambda x, y: (abs(x - 2) < 1) * (y > 1) * (1 + (x > 2)),
    "ring": lambda x, y: (abs(x - 2) < 1) * (abs(y - 2) < 1),
    "front": lambda x, y: 0 * x,  # one body: its joint ends inside
}


def _network(out, *, name, cell, order, doubled):
    """Write a network; with ``doubled`` faces, JOINT- and JOINT+ are boundary groups."""
    import gmsh

    shape = CellShape(name=cell, degree=1)
    cells, x, joints, _ = case(name, shape)
    groups = dict(joints)
    if doubled:
        split = split_cells(shape, cells, x, joints)
        cells, x, groups = split.cells, x[split.parent], {}
        for side, slots in (("-", split.minus), ("+", split.plus)):
            facets = cells[slots[:, :1], shape.facet_vertices[slots[:, 1]]]
            groups |= {f"{n}{side}": facets[split.joint == i] for i, (n, _) in enumerate(joints)}
    kind = {"triangle": 2, "quadrilateral": 3, "tetrahedron": 4, "hexahedron": 5}[cell]
    facet_kind = {2: 1, 3: 2, 4: 3}[shape.facet_vertices.shape[1]]
    to_gmsh = np.argsort(gmsh_permutation(shape.name, cells.shape[1]))
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
        dim, model = shape.dim, gmsh.model
        model.addDiscreteEntity(dim, 1)
        tags = np.arange(1, len(x) + 1)
        model.mesh.addNodes(dim, 1, tags, np.pad(x, ((0, 0), (0, 3 - dim))).astype(float).ravel())
        model.mesh.addElementsByType(1, kind, [], tags[cells[:, to_gmsh]].ravel())
        model.addPhysicalGroup(dim, [1], name="body")
        for number, (group, facets) in enumerate(groups.items(), start=1):
            model.addDiscreteEntity(dim - 1, number)
            cyclic = facets[:, shape.facet_cycle]
            model.mesh.addElementsByType(number, facet_kind, [], tags[cyclic].ravel())
            model.addPhysicalGroup(dim - 1, [number], name=group)
        model.mesh.setOrder(order)
        gmsh.write(str(out))
    finally:
        gmsh.finalize()


def block_motion(number, points):
    """Displacement of the points of a block: a shift and a spin that depend on its number."""
    shift = np.array([0.3, -0.2, 0.7]) * (1 + number) ** 2
    spin = np.array([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]) * np.sin(1.0 + number)
    gdim = points.shape[-1]
    return shift[:gdim] + points @ spin[:gdim, :gdim].T


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("doubled", [False, True], ids=["split here", "split in the file"])
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_networks_from_files(mesh_file, comm, shape, doubled, name):
    path = mesh_file(_network, name=name, cell=shape.name, order=shape.degree, doubled=doubled)
    jointed = read_msh(path, comm, joints=sorted(CASES[name][0]))
    mesh, gdim = jointed.mesh, shape.dim
    V = fem.functionspace(mesh, ("Lagrange", shape.degree, (gdim,)))
    # Vertices of a grid of 4 x 4 (x 2) cells and those that splitting adds, by hand (`CASES`).
    layers = 3 if gdim == 3 else 1
    mesh.topology.create_connectivity(0, gdim)
    vertices = mesh.topology.index_map(0).size_global
    assert vertices == (25 + CASES[name][1]) * layers

    operator = JointOperator(jointed, V)
    assert operator.names == tuple(sorted(CASES[name][0]))
    assert total(comm, operator.areas.sum()) == pytest.approx(
        jointed.pairs.count * (0.5 if shape.name == "tetrahedron" else 1.0), rel=1e-12
    )
    assert np.all(jointed.pairs.bonded == 0)
    # Faces at one place touch; along the joint they are at one place but for rounding.
    assert not operator.initial_gap[:, 0].any()
    assert largest(comm, operator.initial_gap) <= 1e-14
    # The edges of the facets are 1 m long, the diagonals of triangles longer.
    assert largest(comm, operator.sizes - 1.0) <= 1e-12

    moved = fem.Function(V)
    every = np.arange(
        mesh.topology.index_map(gdim).size_local + mesh.topology.index_map(gdim).num_ghosts,
        dtype=np.int32,
    )
    middle = compute_midpoints(mesh, gdim, every)
    block = np.asarray(BLOCKS[name](middle[:, 0], middle[:, 1])).astype(int)
    for number in range(4):
        moved.interpolate(
            lambda x, number=number: block_motion(number, x[:gdim].T).T, every[block == number]
        )
    u = operator.matrix.createVecRight()
    u.setArray(moved.x.array[: u.getLocalSize()])

    # By hand: frame . (motion of the block beyond the facet less that of the block before it).
    layout = whole_layout(comm, operator.layout)
    pairs = jointed.pairs.gathered(comm)
    expected = np.zeros((len(layout.areas), 3))
    for facet, points in enumerate(layout.number):
        corners = pairs.nodes[facet, : shape.facet_vertices.shape[1]]
        beyond = np.sign(layout.frames[points, 0, :gdim].mean(axis=0))
        beyond[np.ptp(corners, axis=0) > 0] = 0.0  # the facet is normal to the axis left
        plus, minus = (
            int(BLOCKS[name](*(corners.mean(axis=0) + side * beyond)[:2])) for side in (0.25, -0.25)
        )
        place, frame = layout.points[points, :gdim], layout.frames[points][..., :gdim]
        jump = block_motion(plus, place) - block_motion(minus, place)
        expected[points] = np.einsum("qij,qj->qi", frame, jump)
    gaps = np.concatenate(comm.allgather(operator.jump(u)))
    np.testing.assert_allclose(gaps, expected, rtol=0, atol=1e-12 * np.abs(moved.x.array).max())


def test_failed_solve_names_the_cause(blocks_file, read):
    # Two blocks that nothing holds: a singular matrix, an error on every rank.
    model = Model(read(blocks_file()), material=CONCRETE, joints=LAW)
    model.loads.append(
        FormLoad(form=lambda v: ufl.inner(ufl.as_vector((1e6, 0.0, 0.0)), v) * ufl.dx)
    )
    with pytest.raises(JointsError):
        Simulation(model).statics()


def test_a_mesh_without_joints_has_no_points(comm, two_rectangles_file, read):
    jointed = read(two_rectangles_file(cell="quad"), joints=[])
    layout = joint_points(comm, jointed.pairs, jointed.shape, 1, "auto")
    for values in (layout.areas, layout.points, layout.sizes, layout.joint, layout.number):
        assert len(values) == 0
