# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass redistributed from joint nodes: what is kept, and where it goes."""

import itertools
import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from dolfinx import la
from dolfinx.mesh import CellType, create_box, create_rectangle, locate_entities, meshtags
from petsc4py import PETSc

import dolfinx_joints as dj
from dolfinx_joints.model.mass_redistribution import joint_dofs, redistribute
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.initial_state import initial_state

pytestmark = pytest.mark.mpi

STONE = dj.Elastic(young=30e9, poisson=0.2, density=2400.0)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=5e10, friction_angle_deg=30.0)
MESHES = [
    {"cell": cell, "order": order, "size": size}
    for cell, order, size in (("hex", 1, 0.25), ("tet", 1, 0.25), ("hex", 2, 0.5), ("tet", 2, 0.5))
]


def product(matrix, u, v):
    """u.M v of arrays of owned values (collective)."""
    left, right = matrix.createVecRight(), matrix.createVecRight()
    right.setArray(np.asarray(v, float).ravel())
    matrix.mult(right, left)
    local = float(np.dot(left.getArray(readonly=True), np.asarray(u, float).ravel()))
    return sum(matrix.comm.tompi4py().allgather(local))


def nodes_of(model):
    owned = model.V.dofmap.index_map.size_local
    return model.V.tabulate_dof_coordinates()[:owned]


def rigid_motions(model, group):
    """Six motions of the nodes of a cell group, at rest elsewhere, shape (6, nodes, 3)."""
    x = nodes_of(model)
    mark = la.vector(model.V.dofmap.index_map)
    mark.array[model.V.dofmap.list[model.jointed.cells(group)].ravel()] = 1.0
    mark.scatter_reverse(la.InsertMode.add)
    inside = np.where(mark.array[: len(x)] > 0.0, 1.0, 0.0)
    axes = np.eye(3)
    motions = [np.broadcast_to(axis, x.shape) for axis in axes]
    motions += [np.cross(axis, x) for axis in axes]
    return inside[None, :, None] * np.array(motions)


@pytest.fixture
def blocks(blocks_file, read):
    def make(parameters, **options):
        options = {"body": dj.Body(redistribute_mass=True)} | options
        return dj.Model(read(blocks_file(**parameters)), material=STONE, joints=LAW, **options)

    return make


@pytest.mark.parametrize("parameters", MESHES, ids=lambda p: f"{p['cell']}{p['order']}")
def test_each_body_keeps_its_inertia(blocks, parameters):
    """Mass, centre of mass and moments of inertia of both blocks: u.M v of any two rigid motions.

    They agree to the rounding of some thousand products.
    """
    plain, model = blocks(parameters, body=None), blocks(parameters)
    assert model.redistribution.massless > 0
    assert model.redistribution.kept == 0
    for group in ("lower", "upper"):
        motions = rigid_motions(model, group)
        scale = product(plain.mass, motions[0], motions[0])
        for u, v in itertools.combinations_with_replacement(motions, 2):
            before, after = product(plain.mass, u, v), product(model.mass, u, v)
            assert after == pytest.approx(before, rel=1e-11, abs=1e-11 * scale)


@pytest.mark.parametrize("parameters", MESHES, ids=lambda p: f"{p['cell']}{p['order']}")
def test_joint_nodes_have_no_mass(blocks, parameters):
    """A pair of nodes at each joint point but the centres; the other dofs have mass."""
    model = blocks(parameters)
    # Nodes of 4 x 4 or 2 x 2 squares, for which 10-node tetrahedra have 8 centres of triangles.
    assert model.redistribution.massless == 2 * 25
    assert model.operator.num_points == 25 + 8 * (parameters == MESHES[3])
    massless = joint_dofs(model.operator)
    diagonal = model.mass.getDiagonal().getArray(readonly=True)
    np.testing.assert_array_equal(diagonal[massless], 0.0)
    assert np.all(diagonal[~massless] > 0.0)
    velocity = np.where(massless, 1.0, 0.0)
    assert product(model.mass, velocity, velocity) == 0.0


@pytest.mark.parametrize("parameters", MESHES, ids=lambda p: f"{p['cell']}{p['order']}")
def test_any_number_of_ranks_gives_the_same(blocks, blocks_file, read, comm, parameters):
    """Kinetic energy of a curved velocity field, by one rank and by all."""

    def energy(model):
        x = nodes_of(model)
        v = np.stack([x[:, 1] * x[:, 2], np.sin(3 * x[:, 0]), x[:, 2] ** 2], axis=1)
        return product(model.mass, v, v)

    from mpi4py import MPI

    alone = dj.Model(
        read(blocks_file(**parameters), on=MPI.COMM_SELF),
        material=STONE,
        joints=LAW,
        body=dj.Body(redistribute_mass=True),
    )
    assert energy(blocks(parameters)) == pytest.approx(energy(alone), rel=1e-11)


def test_loads_of_the_ground_and_of_gravity(blocks):
    """Both act on all of the mass, 2400 kg/m^3 in 2 m^3, and alike: free fall makes no strain."""
    model = blocks(MESHES[0], loads=[dj.Gravity()])
    for axis in np.eye(3):
        total = model.inertia_pattern(axis).getArray(readonly=True).reshape(-1, 3).sum(axis=0)
        total = np.sum(model.jointed.mesh.comm.allgather(total), axis=0)
        np.testing.assert_allclose(total, 4800.0 * axis, rtol=0, atol=1e-8)
    weight = model.loads[0].patterns(model)[0][0].getArray()
    inertia = model.inertia_pattern(np.array([0.0, 0.0, -9.80665])).getArray()
    np.testing.assert_allclose(weight, inertia, rtol=1e-14, atol=1e-10)


def test_damping_by_mass_follows(blocks):
    """C = a M' with a from ratio = a / (4 pi f), so a = 4 pi 0.05 * 5 = pi [1/s]."""
    model = blocks(MESHES[0], damping=dj.mass_proportional(ratio=0.05, frequency=5.0))
    rest = model.system().damping.copy()
    rest.axpy(-np.pi, model.mass)
    assert rest.norm() <= 1e-12 * model.system().damping.norm()


def test_nothing_happens_unless_asked_for(blocks):
    model = blocks(MESHES[0], body=None)
    assert model.redistribution is None
    assert model.mass is model.body_mass
    assert np.all(model.mass.getDiagonal().getArray(readonly=True) > 0.0)


def test_nodes_held_by_supports_keep_their_mass(blocks):
    """All nodes of one side are held: it loses nothing, the other all."""
    model = blocks(MESHES[0], supports=[dj.Fixed(group="joint_1-")])
    assert model.redistribution.massless == model.redistribution.kept == model.operator.num_points
    part = blocks(MESHES[0], supports=[dj.Fixed(group="joint_1-", components="x")])
    assert part.redistribution.kept == 0


def layered(comm, cells, *, joints):
    """A column of cubes of 1 m, two by two, with level joints."""
    mesh = create_box(comm, [[0, 0, 0], [2, 2, cells]], [2, 2, cells], CellType.hexahedron)
    facets = [locate_entities(mesh, 2, lambda x, z=z: np.isclose(x[2], z)) for z in joints]
    return dj.split_mesh(mesh, joints={f"joint_{i + 1}": each for i, each in enumerate(facets)})


@pytest.mark.parametrize(("cells", "kept"), [(1, 18), (2, 18), (3, 0)])
def test_thin_layers_keep_their_mass(comm, cells, kept):
    """Between two joints: nodes on both, or one layer of others, which has no inertia to turn.

    Two layers of nodes inside suffice; u = 2 u1 - u2.
    """
    jointed = layered(comm, 6 + cells, joints=(3, 3 + cells))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = dj.Model(jointed, material=STONE, joints=LAW, body=dj.Body(redistribute_mass=True))
    texts = comm.bcast([str(w.message) for w in caught], root=0)
    assert any("18 joint nodes keep their mass" in text for text in texts) == bool(kept)
    assert (model.redistribution.massless, model.redistribution.kept) == (36 - kept, kept)


def test_sources_lie_on_the_own_side_of_a_joint_that_ends(comm):
    """Round the front of a crack, nodes above and below its plane stay uncoupled, as in M."""
    mesh = create_rectangle(comm, [[0, -1], [2, 1]], [8, 8], CellType.quadrilateral)
    crack = locate_entities(mesh, 1, lambda x: np.isclose(x[1], 0.0) & (x[0] < 1.01))
    tags = meshtags(mesh, 1, np.sort(crack), np.ones(len(crack), dtype=np.int32))
    jointed = dj.split_mesh(mesh, tags, joints={"joint": 1}, groups={})
    model = dj.Model(jointed, material=STONE, joints=LAW, body=dj.Body(redistribute_mass=True))
    assert model.redistribution.massless == 8
    y = np.repeat(nodes_of(model)[:, 1], 2)
    above, below = np.where(y > 1e-9, 1.0, 0.0), np.where(y < -1e-9, 1.0, 0.0)
    assert product(model.mass, above, above) > 0.0
    assert product(model.mass, above, below) == 0.0


# Plain matrices.


def bar(cells, *, length=1.0):
    """A bar of unit section, E and density, with a stop at its first node."""
    h = length / cells
    mass, stiffness = np.zeros((2, cells + 1, cells + 1))
    for i in range(cells):
        here = np.ix_([i, i + 1], [i, i + 1])
        mass[here] += h / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
        stiffness[here] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / h
    gap = np.zeros((3, cells + 1))
    gap[0, 0] = 1.0
    system = dj.MatrixSystem.from_arrays(
        mass=mass, stiffness=stiffness, gap=gap, law=dj.frictionless(normal_stiffness=1e3)
    )
    return system, mass, np.linspace(0.0, length, cells + 1)[:, None]


def dense(matrix):
    full = matrix.copy()
    full.convert(PETSc.Mat.Type.DENSE)
    return full.getDenseArray().copy()


@pytest.mark.parametrize(("rings", "near"), [(2, 2.0), (3, 3 / 2), (4, 4 / 3)])
def test_bar_by_hand(rings, near):
    """u0 = (1 + 1/m) u1 - u(1+m)/m with m = rings - 1, so M' = P^T M P with that first row."""
    system, mass, x = bar(8)
    p = np.eye(9)
    p[0] = 0.0
    p[0, [1, rings]] = near, 1.0 - near
    expected = p.T @ mass @ p
    found = dense(redistribute(system, x, rings=rings).mass)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


def test_refusals():
    system, mass, x = bar(4)
    with pytest.raises(ValueError, match="coordinates is an array of shape"):
        redistribute(system, x[:-1])
    with pytest.raises(ValueError, match="has no joints"):
        redistribute(dj.MatrixSystem.from_arrays(mass=mass, stiffness=mass), x)


def test_first_acceleration_without_mass():
    """M' a = f at the dofs with mass and zero at the joint; the joint pushes with 1e3 * 0.01 N."""
    system, _, x = bar(8)
    moved = redistribute(system, x)
    u = moved.mass.createVecRight()
    u.setArray(np.r_[-0.01, np.linspace(0.0, 0.02, 8)])
    state = initial_state(make_solver(moved), displacement=u)
    a = state.acceleration.getArray()
    force = -dense(moved.stiffness) @ u.getArray()
    assert a[0] == 0.0
    np.testing.assert_allclose(dense(moved.mass)[1:] @ a, force[1:], rtol=0, atol=1e-10)
    np.testing.assert_allclose(state.joints.traction[0], [-10.0, 0.0, 0.0], rtol=1e-12)


def test_force_on_missing_mass_is_refused():
    """At the start the joint's dof, without mass, may be out of balance, the last one not."""
    system, mass, _ = bar(4)
    mass[-1] = mass[:, -1] = 0.0
    wrong = dj.MatrixSystem.from_arrays(
        mass=mass,
        stiffness=dense(system.stiffness),
        gap=[[1.0, 0, 0, 0, 0], [0] * 5, [0] * 5],
        law=dj.frictionless(normal_stiffness=1e3),
        load=lambda t: [0, 0, 0, 0, 1.0],
    )
    with pytest.raises(
        dj.JointsError, match="without mass is not in balance .* nodal force is 1 N"
    ):
        initial_state(make_solver(wrong))


def test_a_free_body_is_stepped_as_rigid():
    """Nothing holds the bar, and it flies without strain: u = v t at all nodes."""
    system, _, x = bar(8)
    moved = redistribute(system, x)
    scheme = dj.EnergyConsistent()
    solver = make_solver(moved)
    v = moved.mass.createVecRight()
    v.set(2.0)
    state = initial_state(solver, velocity=v)
    for _ in range(10):
        state, _ = scheme.advance(solver, state, 0.1)
    np.testing.assert_allclose(state.displacement.getArray(), 2.0, rtol=0, atol=1e-12)
