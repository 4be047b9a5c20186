# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses at the boundary from displacements whose stresses are known; any number of ranks."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

import basix
from dolfinx import mesh as dmesh
from shaken_wall import CONCRETE, LAW, shaking, wall
from whole_vectors import all_of

import dolfinx_joints as dj
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.monitors.surface_stress import StressEnvelopes, SurfaceStress
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES, principal_extremes

pytestmark = pytest.mark.mpi

LAMBDA, MU = CONCRETE.first_lame("strain"), CONCRETE.shear_modulus


def model_of(jointed):
    return wall(jointed, LAW if jointed.joint_names else None)


def displacement(model, field):
    """A displacement with ``field(x)`` (n, 3) at the owned nodes x (n, 3)."""
    u = model.stiffness.createVecRight()
    x = model.V.tabulate_dof_coordinates()[: u.getLocalSize() // 3]
    u.setArray(field(x).ravel())
    return u


def six(gradient):
    """Stress (xx, yy, zz, xy, yz, xz) of a displacement gradient, by Hooke's law."""
    strain = 0.5 * (gradient + gradient.T)
    stress = LAMBDA * np.trace(strain) * np.eye(3) + 2 * MU * strain
    return stress[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]


LOWER = 1e-4 * np.array([[1.0, 2.0, -1.0], [0.5, -2.0, 0.3], [0.7, -0.2, 3.0]])
UPPER = 1e-4 * np.array([[-2.0, 0.1, 0.6], [1.5, 1.0, -0.9], [0.2, 0.8, -1.0]])


def test_a_rank_without_cells_takes_part(comm, new_path):
    # One cube, so that all ranks but one have no cells, in uniform stress.
    mesh = dmesh.create_unit_cube(comm, 1, 1, 1, cell_type=dmesh.CellType.hexahedron)
    base = dmesh.locate_entities_boundary(mesh, 2, lambda x: np.isclose(x[2], 0.0))
    model = model_of(dj.split_mesh(mesh, groups={"base": base}))
    seen = StressEnvelopes(model, NodeNumbering(model.V))
    seen.see(displacement(model, lambda x: x @ LOWER.T), 0.0)
    columns = all_of(comm, seen.state_dict().mine)
    if comm.rank == 0:
        assert columns.shape == (8, 6)
        largest, smallest = principal_extremes(six(LOWER)[None])
        np.testing.assert_allclose(columns[:, 0], largest[0])
        np.testing.assert_allclose(columns[:, 1], smallest[0])
    path = new_path("alone.h5")
    monitor = dj.ResultsMonitor(path, points={"top": (0.0, 0.0, 1.0)}, envelopes=True)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=1e-3, steps=2)
    comm.barrier()
    with dj.Results(path) as results:
        assert results.complete
        assert results.static("mesh/surface").shape == (6, 4)


@pytest.mark.parametrize("cell", ["hex", "tet"])
@pytest.mark.parametrize("order", [1, 2])
def test_patch_on_each_side_of_a_joint(comm, blocks_file, read, cell, order):
    # Each block has a uniform stress of its own; the vertices on the joint keep them apart.
    model = model_of(read(blocks_file(cell=cell, order=order)))
    upper = np.unique(model.V.dofmap.list[model.jointed.cells("upper")])
    u = displacement(model, lambda x: x @ LOWER.T)
    x = model.V.tabulate_dof_coordinates()
    values = u.getArray().reshape(-1, 3)
    upper = upper[upper < len(values)]
    values[upper] = x[upper] @ UPPER.T
    u.setArray(values.ravel())
    nodes = NodeNumbering(model.V)
    stress = SurfaceStress(model, nodes)
    found = stress(u, 0.0)
    is_upper = np.isin(stress.nodes, all_of(comm, nodes.number[upper]))
    expected = np.where(is_upper[:, None], six(UPPER), six(LOWER))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    # Every vertex is one rank's; 2 on either side of the joint among them.
    every = all_of(comm, stress.nodes)
    assert (np.diff(every) > 0).all()
    assert 0 < comm.allreduce(int(is_upper.sum())) < len(every)


@pytest.mark.parametrize("cell", ["hex", "tet"])
def test_pure_bending(comm, wall_file, read, cell):
    # sigma_zz = E k x' with x' = x - 10 m and nothing else, a displacement of degree 2:
    # u_z = k x' z, u_x = -k (z^2 + nu (x'^2 - y^2)) / 2, u_y = -nu k x' y.
    model = model_of(read(wall_file(order=2, cell=cell), joints=[]))
    k, nu = 1e-5, CONCRETE.poisson

    def bent(x):
        a, y, z = x[:, 0] - 10.0, x[:, 1], x[:, 2]
        rows = [-0.5 * k * (z**2 + nu * (a**2 - y**2)), -nu * k * a * y, k * a * z]
        return np.stack(rows, axis=1)

    nodes = NodeNumbering(model.V)
    envelopes = StressEnvelopes(model, nodes)
    u = displacement(model, bent)
    envelopes.see(u, 0.0)
    u.scale(-2.0)
    envelopes.see(u, 0.0)
    columns = all_of(comm, envelopes.state_dict().mine)
    x, y = all_of(comm, nodes.positions)[all_of(comm, envelopes.nodes)].T[:2]
    once = CONCRETE.young * k * (x - 10.0)
    largest, smallest = np.maximum(once, -2 * once), np.minimum(once, -2 * once)
    tolerance = {"rtol": 0, "atol": 1e-9 * np.abs(once).max()}
    by_name = dict(zip(ENVELOPE_NAMES, columns.T, strict=True))
    np.testing.assert_allclose(by_name["principal_max"], largest, **tolerance)
    np.testing.assert_allclose(by_name["principal_min"], smallest, **tolerance)
    # Cantilevers carry all of it. Vertical edges have no directions, nor has the inside of the top;
    # there are no vertices but on edges of the wall in y, as it is one cell thick.
    edge = (np.abs(x - 10.0) > 9.99) & ((y < 0.01) | (y > 3.99))
    np.testing.assert_array_equal(np.isnan(by_name["arch_max"]), edge)
    face = ~edge
    np.testing.assert_allclose(by_name["cantilever_max"][face], largest[face], **tolerance)
    np.testing.assert_allclose(by_name["cantilever_min"][face], smallest[face], **tolerance)
    np.testing.assert_allclose(by_name["arch_max"][face], 0.0, **tolerance)


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_patch_in_the_plane(comm, two_rectangles_file, read, plane):
    # A uniform displacement gradient: Hooke's law gives the stress, zz included in plane strain.
    # It is recovered at the vertices of all cells, and yy is the stress of the cantilevers.
    model = wall(read(two_rectangles_file()), body=dj.Body(plane=plane))
    gradient = 1e-4 * np.array([[1.0, 2.0], [0.5, -2.0]])
    u = model.stiffness.createVecRight()
    x = model.V.tabulate_dof_coordinates()[: u.getLocalSize() // 2, :2]
    u.setArray((x @ gradient.T).ravel())
    nodes = NodeNumbering(model.V)
    envelopes = StressEnvelopes(model, nodes)
    envelopes.see(u, 0.0)
    columns = all_of(comm, envelopes.state_dict().mine)
    lame = CONCRETE.first_lame(plane)
    strain, trace = 0.5 * (gradient + gradient.T), np.trace(gradient)
    tensor = np.zeros((3, 3))
    tensor[:2, :2] = lame * trace * np.eye(2) + 2.0 * MU * strain
    tensor[2, 2] = lame * trace if plane == "strain" else 0.0
    values = np.linalg.eigvalsh(tensor)
    expected = [values[2], values[0], np.nan, np.nan, tensor[1, 1], tensor[1, 1]]
    size = np.abs(tensor).max()
    np.testing.assert_allclose(columns, np.tile(expected, (len(columns), 1)), atol=1e-10 * size)
    corners = model.V.dofmap.list[:, : len(basix.geometry(model.jointed.shape.type))]
    vertices = np.unique(np.concatenate(comm.allgather(nodes.number[corners].ravel())))
    np.testing.assert_array_equal(all_of(comm, envelopes.nodes), vertices)


def test_heat_in_the_plane(comm, two_rectangles_file, read):
    # A clamped body heated by 10 K: -(3 lambda + 2 mu) alpha dT in all directions in plane strain;
    # in plane stress -(2 lambda + 2 mu) alpha dT in the plane (lambda of plane stress), 0 across.
    for plane, axes in (("strain", 3), ("stress", 2)):
        heat = dj.Temperature(value=10.0, reference=0.0, expansion=1e-5)
        options = dj.Body(plane=plane)
        model = wall(read(two_rectangles_file()), body=options, loads=[heat])
        stress = SurfaceStress(model, NodeNumbering(model.V))(model.stiffness.createVecRight(), 0.0)
        pressure = (axes * CONCRETE.first_lame(plane) + 2.0 * MU) * 1e-5 * 10.0
        expected = -pressure * np.array([1.0, 1.0, 1.0 if axes == 3 else 0.0, 0.0, 0.0, 0.0])
        np.testing.assert_allclose(stress, np.tile(expected, (len(stress), 1)), rtol=1e-12)


def run(model, path, envelopes=True):
    points = {"crest": (0.0, 0.0, 20.0)}
    monitor = dj.ResultsMonitor(path, points=points, every=1, envelopes=envelopes)
    simulation = dj.Simulation(model, monitors=[monitor])
    simulation.statics()
    simulation.dynamics(dt=4e-3, steps=5, motion=shaking)


def test_envelopes_of_a_run_on_any_number_of_ranks(comm, wall_file, read, new_path):
    # The file of all ranks holds the extremes over the states of the run, recovered here by this
    # process alone, one state after the other.
    many = new_path("many.h5")
    run(model_of(read(wall_file())), many)
    if comm.rank != 0:
        return
    model = model_of(read(wall_file(), on=MPI.COMM_SELF))
    nodes = NodeNumbering(model.V)
    recovery = SurfaceStress(model, nodes)
    with dj.Results(many) as results:
        np.testing.assert_array_equal(results.static("envelopes/nodes"), recovery.nodes)
        np.testing.assert_array_equal(
            np.unique(results.static("mesh/surface")), results.static("envelopes/nodes")
        )
        assert results.time("envelopes") == pytest.approx([0.02])
        u, extremes = model.stiffness.createVecRight(), []
        for state in results.series("states", "displacement"):
            u.setArray(state[nodes.number].ravel())
            extremes.append(principal_extremes(recovery(u, 0.0)))
        assert len(extremes) == 6
        size = np.abs(extremes).max()
        for name, pick, row in (("max", np.max, 0), ("min", np.min, 1)):
            found = results.series("envelopes", f"principal_{name}", -1)
            expected = pick(np.array(extremes)[:, row], axis=0)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size)
        # Arch and cantilever stresses lie between the principal ones.
        for name in ("arch", "cantilever"):
            low, high = (results.series("envelopes", f"{name}_{end}", -1) for end in ("min", "max"))
            defined = ~np.isnan(low)
            assert defined.any()
            top = results.series("envelopes", "principal_max", -1)[defined]
            bottom = results.series("envelopes", "principal_min", -1)[defined]
            assert np.all(high[defined] <= top + 1e-9 * size)
            assert np.all(low[defined] >= bottom - 1e-9 * size)
        directions = [results.static(f"envelopes/{name}") for name in ("arch", "cantilever")]
        assert np.isnan(directions[0]).any(axis=1).sum() < len(recovery.nodes)
        np.testing.assert_allclose(np.nansum(directions[0] * directions[1], axis=1), 0, atol=1e-12)


def test_envelopes_on_chosen_faces(comm, wall_file, read, new_path):
    # The same numbers as those of the whole boundary at the vertices of the faces; directions are
    # those of the faces alone.
    whole, some = new_path("whole.h5"), new_path("some.h5")
    model = model_of(read(wall_file()))
    run(model, whole)
    run(model, some, envelopes=["joint_2-", "joint_2+"])
    if comm.rank != 0:
        return
    with dj.Results(whole) as one, dj.Results(some) as two:
        numbers = two.static("envelopes/nodes")
        nodes = two.static("mesh/nodes")[numbers]
        np.testing.assert_allclose(nodes[:, 0], 10.0)
        assert len(numbers) == 2 * 2 * 4  # both sides, 1 x 3 facets
        here = np.searchsorted(one.static("envelopes/nodes"), numbers)
        for name in ("principal_max", "principal_min"):
            wanted = one.series("envelopes", name, -1)[here]
            np.testing.assert_allclose(two.series("envelopes", name, -1), wanted, rtol=1e-12)
        # On a plane x = const the arch direction is y and the cantilever's z, at edges too.
        arch, up = two.static("envelopes/arch"), two.static("envelopes/cantilever")
        np.testing.assert_allclose(arch, np.tile([0.0, 1.0, 0.0], (16, 1)), atol=1e-12)
        np.testing.assert_allclose(np.abs(up), np.tile([0.0, 0.0, 1.0], (16, 1)), atol=1e-12)
        assert np.isfinite(two.series("envelopes", "arch_max", -1)).all()


def test_faces_of_envelopes_are_checked(wall_file, read, new_path):
    model = model_of(read(wall_file()))
    with pytest.raises(dj.MeshError, match="no facet group 'upstream'"):
        run(model, new_path("none.h5"), envelopes=["upstream"])
    whole = model_of(read(wall_file(), joints=[]))
    with pytest.raises(dj.MeshError, match="facet group 'joint_1' has no facets on the boundary"):
        run(whole, new_path("none.h5"), envelopes=["joint_1"])
