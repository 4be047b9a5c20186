# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes and tags of the user's own: what cannot be split or opens in part is said on all ranks."""

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import basix.ufl
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    create_interval,
    create_rectangle,
    create_submesh,
    create_unit_cube,
    exterior_facet_indices,
    locate_entities,
    meshtags,
)

from dolfinx_joints import MeshError, mesh_from_arrays, split_mesh
from dolfinx_joints.mesh import dolfinx_versions

pytestmark = pytest.mark.mpi


@pytest.fixture(scope="module")
def square(comm):
    """A square of 4 x 4 cells with its edges and cells numbered."""
    mesh = create_rectangle(comm, [[0, 0], [1, 1]], [4, 4], CellType.quadrilateral)
    return mesh, all_tagged(mesh, 1, 5), all_tagged(mesh, 2, 8)


def all_tagged(mesh, dim, tag):
    """A tag on all entities of a dimension."""
    mesh.topology.create_entities(dim)
    index_map = mesh.topology.index_map(dim)
    entities = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    return meshtags(mesh, dim, entities, np.full(len(entities), tag, dtype=np.int32))


def test_tags_that_stand_on_nothing_are_refused(square):
    mesh, edges, cells = square
    with pytest.raises(
        MeshError,
        match=r"No facet has the tag 6 of the group 'base'; the tags of .* are: 5\.$",
    ):
        split_mesh(mesh, edges, joints={}, groups={"base": 6})
    groups = {"joints": {}, "groups": {"base": 5}, "cell_groups": {"rock": 9}}
    with pytest.raises(
        MeshError,
        match=r"No cell has the tag 9 of the group 'rock'; the tags of .* are: 8\.$",
    ):
        split_mesh(mesh, edges, cell_tags=cells, **groups)
    wanted = "it must be an array of local cells, or a tag if cell_tags is given"
    with pytest.raises(ValueError, match=f"The cell group 'rock' is 9; {wanted}"):
        split_mesh(mesh, edges, **groups)


def test_facets_in_place_of_tags_are_checked(square):
    mesh, edges, _ = square
    with pytest.raises(MeshError, match=r"^The facet group 'base' is empty on all ranks\.$"):
        split_mesh(mesh, groups={"base": edges.indices[:0]})
    with pytest.raises(MeshError, match=r"^The facet group 'base' has numbers from -1 to 0; the"):
        split_mesh(mesh, groups={"base": np.array([0, -1])})
    mask = np.zeros(9, dtype=bool)
    with pytest.raises(ValueError, match=r"must be numbers of local facets; use np\.flatnonzero"):
        split_mesh(mesh, groups={"base": mask})
    with pytest.raises(ValueError, match=r"^The tag of 'base' is array\(.*; it must be a whole"):
        split_mesh(mesh, edges, groups={"base": edges.indices})


def test_tags_of_something_else_are_refused(square, comm):
    mesh, edges, cells = square
    with pytest.raises(
        MeshError, match=r"facet_tags has tags of dimension 2; dimension 1 is needed\.$"
    ):
        split_mesh(mesh, cells, joints={}, groups={})
    with pytest.raises(
        MeshError, match=r"cell_tags has tags of dimension 1; dimension 2 is needed\.$"
    ):
        split_mesh(mesh, edges, joints={}, groups={}, cell_tags=edges)
    finer = create_rectangle(comm, [[0, 0], [1, 1]], [9, 9], CellType.quadrilateral)
    with pytest.raises(MeshError, match="facet_tags belongs to another mesh: its entities"):
        split_mesh(mesh, all_tagged(finer, 1, 5), joints={}, groups={"base": 5})


def test_meshes_that_say_too_little_are_refused(square):
    mesh = square[0]
    part = create_submesh(mesh, 2, np.arange(mesh.topology.index_map(2).size_local))[0]
    with pytest.raises(MeshError, match="does not store the original order of its cells, as after"):
        split_mesh(part, all_tagged(part, 1, 5), joints={}, groups={"base": 5})


def test_a_name_or_tag_is_of_a_joint_or_a_group(square):
    mesh, edges, _ = square
    with pytest.raises(MeshError, match="The name 'a' is given for a joint and for a group; use"):
        split_mesh(mesh, edges, joints={"a": 5}, groups={"a": 6})
    with pytest.raises(MeshError, match="The tag 5 is given for a joint and for a group; use"):
        split_mesh(mesh, edges, joints={"a": 5}, groups={"b": 5})


def test_other_cells_are_refused(comm):
    prisms = create_unit_cube(comm, 2, 2, 2, CellType.prism)
    message = (
        "A mesh of prisms of degree 1 cannot be split; cells must be one of triangle, "
        "quadrilateral, tetrahedron, hexahedron, of degree 1 or 2"
    )
    with pytest.raises(MeshError, match=message):
        split_mesh(prisms, None, joints={}, groups={})
    line = create_interval(comm, 4, [0.0, 1.0])
    with pytest.raises(MeshError, match="A mesh of intervals of degree 1 cannot be split"):
        split_mesh(line, None, joints={}, groups={})


def test_a_surface_in_space_is_refused(comm):
    first = comm.rank == 0
    cells = np.array([[0, 1, 2], [1, 3, 2]] if first else np.empty((0, 3)), dtype=np.int64)
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]] if first else np.empty((0, 3)))
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
    shell = dolfinx_versions.create_mesh(comm, cells, x.astype(np.float64), element)
    message = (
        "A mesh of dimension 2 in 3-D space cannot be split; use a solid mesh in 3-D or a plane"
    )
    with pytest.raises(MeshError, match=message):
        split_mesh(shell, None, joints={}, groups={})


def test_a_curved_cell_turned_inside_out_is_refused(comm):
    """The middle of an edge has gone past the vertex opposite to it."""
    first = comm.rank == 0
    cells = np.array([[0, 1, 2, 3, 4, 5]] if first else np.empty((0, 6)), dtype=np.int64)
    nodes = [[0, 0], [1, 0], [0, 1], [-0.2, -0.2], [0, 0.5], [0.5, 0]]
    x = np.array(nodes if first else np.empty((0, 2)), dtype=np.float64)
    element = basix.ufl.element("Lagrange", "triangle", 2, shape=(2,))
    with pytest.raises(MeshError, match="^The mesh: 1 cells are partly inside out"):
        split_mesh(dolfinx_versions.create_mesh(comm, cells, x, element))


def test_a_straight_cell_with_a_dented_corner_is_refused(comm):
    """At the corner (0.3, 0.3) the volume is 1 - 2 * 0.7; no edge is curved."""
    first = comm.rank == 0
    cells = np.array([[0, 1, 2, 3]] if first else np.empty((0, 4)), dtype=np.int64)
    nodes = [[0, 0], [1, 0], [0, 1], [0.3, 0.3]]
    x = np.array(nodes if first else np.empty((0, 2)), dtype=np.float64)
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    with pytest.raises(MeshError, match=r"around \(0.325, 0.325\); such cells have a re-entrant"):
        split_mesh(dolfinx_versions.create_mesh(comm, cells, x, element))


def edges_at(mesh, **places):
    """Tags 1, 2, ... on the edges of the places, in turn."""
    mesh.topology.create_connectivity(1, 2)
    found = [locate_entities(mesh, 1, place) for place in places.values()]
    edges, first = np.unique(np.concatenate(found), return_index=True)
    values = np.repeat(np.arange(1, len(found) + 1), [len(each) for each in found])[first]
    return meshtags(mesh, 1, edges.astype(np.int32), values.astype(np.int32))


def test_joints_are_all_split_here_or_all_split_already(square):
    mesh = square[0]
    at = {f"y{i}": (lambda x, y=0.25 * i: np.isclose(x[1], y)) for i in range(4)}
    groups = {"a-": 3, "a+": 4}
    message = r"The mesh has joints with duplicated faces \(a\) and joints to be split; define all"
    with pytest.raises(MeshError, match=message):
        split_mesh(mesh, edges_at(mesh, **at), joints={"a": 1, "b": 2}, groups=groups)


@pytest.mark.parametrize("by", ["mesh", "arrays"])
def test_a_group_on_a_joint_holds_both_of_its_faces(comm, by):
    """Areas of a unit cube, cut at half its height: 6 outside, 1 on each face of the joint."""
    half = lambda x: np.isclose(x[2], 0.5)  # noqa: E731
    if by == "mesh":
        mesh = create_unit_cube(comm, 2, 2, 2)
        mesh.topology.create_connectivity(2, 3)
        cut, outside = locate_entities(mesh, 2, half), exterior_facet_indices(mesh.topology)
        groups = {"cut": cut, "every": np.append(cut, outside)}
        cube = split_mesh(mesh, joints={"joint": cut}, groups=groups)
    else:
        z, y, x = np.meshgrid([0, 0.5, 1], [0, 1], [0, 1], indexing="ij")
        node = np.arange(12).reshape(3, 2, 2)
        walls = [node[i : i + 2, j, :] for i in (0, 1) for j in (0, 1)]
        walls += [node[i : i + 2, :, j] for i in (0, 1) for j in (0, 1)]
        cut, outside = [node[1].ravel()], [wall.ravel() for wall in (node[0], node[2], *walls)]
        cube = mesh_from_arrays(
            comm,
            cell="hexahedron",
            x=np.column_stack([x.ravel(), y.ravel(), z.ravel()]),
            cells=[node[:2].ravel(), node[1:].ravel()],
            facet_groups={"joint": cut, "cut": cut, "every": cut + outside},
        )
    n = ufl.FacetNormal(cube.mesh)
    total = lambda form: comm.allreduce(fem.assemble_scalar(fem.form(form)))  # noqa: E731
    assert total(ufl.dot(n, n) * cube.ds("every")) == pytest.approx(8.0, rel=1e-12)
    assert total(ufl.dot(n, n) * cube.ds("cut")) == pytest.approx(2.0, rel=1e-12)
    assert total(n[2] * cube.ds("cut")) == pytest.approx(0.0, abs=1e-12)


def test_facets_that_stay_closed_are_reported(square, comm):
    # Of an edge apart from the others both ends are inside the body, on the front of the joint.
    mesh = square[0]
    row = lambda x, y, low, high: (  # noqa: E731
        np.isclose(x[1], y) & (x[0] > low - 1e-9) & (x[0] < high + 1e-9)
    )
    tags = edges_at(mesh, a=lambda x: row(x, 0.75, 0.25, 0.75) | row(x, 0.25, 0.25, 0.5))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        jointed = split_mesh(mesh, tags, joints={"a": 1}, groups={})
    assert jointed.pairs.bonded.tolist() == [1]
    assert jointed.pairs.count == 2
    found = [str(w.message) for w in caught if "cannot open" in str(w.message)]
    expected = ["Joint 'a': 1 facets cannot open because all their vertices lie on the"]
    assert [text[: len(expected[0])] for text in found] == (expected if comm.rank == 0 else [])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"joints": ["a"]}, r"joints is \['a'\]; it must be a tag by name\."),
        ({"groups": {"a": [5]}}, r"The tag of 'a' is \[5\]; it must be a whole number\."),
    ],
)
def test_what_is_no_tag_by_name_is_refused(square, given, sentence):
    mesh, edges, _ = square
    with pytest.raises(ValueError, match=f"^{sentence}$"):
        split_mesh(mesh, edges, **{"joints": {}, "groups": {}, **given})
