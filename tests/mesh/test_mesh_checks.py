# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Faults of meshes, the same by every way into the package."""

import warnings
from itertools import product

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from mpi4py import MPI

import basix.ufl
import h5py
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_rectangle, locate_entities

import dolfinx_joints as dj
from dolfinx_joints.mesh.dolfinx_versions import create_mesh

pytestmark = pytest.mark.mpi

# Two squares of two triangles each, side by side, and the edge between them.
X = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]
CELLS = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]
BASE, JOINT = [[0, 1], [1, 2]], [[1, 4]]
# The right square with nodes of its own: edges that coincide, and one edge against two.
APART = [*X, [1, 0], [1, 1]]
COINCIDENT = (APART, [*CELLS[:2], [6, 2, 5], [6, 5, 7]])
STAGGERED = ([*APART, [1, 0.5]], [*CELLS[:2], [6, 2, 8], [2, 5, 8], [8, 5, 7]])


def item(values):
    array = np.array(values)
    return (
        f'<DataItem Dimensions="{" ".join(map(str, array.shape))}" Format="XML">'
        f"{' '.join(map(str, array.ravel()))}</DataItem>"
    )


def xdmf(kind, x, cells, tags):
    """A file of one grid, as meshio writes it."""
    return (
        f'<Xdmf><Domain><Grid Name="Grid"><Geometry GeometryType="XY">{item(x)}</Geometry>'
        f'<Topology TopologyType="{kind}" NumberOfElements="{len(cells)}">{item(cells)}</Topology>'
        f'<Attribute Name="t">{item(tags)}</Attribute></Grid></Domain></Xdmf>'
    )


def msh(x, names, elements):
    """A file of format 2.2: lines of names, and (type, group, nodes) of the elements."""
    nodes = [f"{i + 1} {a} {b} 0" for i, (a, b) in enumerate(x)]
    rows = [
        f"{i + 1} {kind} 2 {group} {group} {' '.join(str(n + 1) for n in each)}"
        for i, (kind, group, each) in enumerate(elements)
    ]
    parts = ("PhysicalNames", names), ("Nodes", nodes), ("Elements", rows)
    text = "\n".join(f"${n}\n{len(p)}\n{chr(10).join(p)}\n$End{n}" for n, p in parts)
    return f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{text}\n"


@pytest.fixture
def put(comm, new_path):
    """``put(name, text)``: the path of a new file (collective)."""

    def write(name, text):
        path = new_path(name)
        if comm.rank == 0:
            path.write_text(text)
        comm.barrier()
        return path

    return write


@pytest.fixture
def doors(comm, put, new_path):
    """Ways to read points and triangles, with the lower edges as a group, by name."""

    def by_arrays(x, cells):
        groups = {"base": np.array(BASE[:1])}
        return dj.mesh_from_arrays(
            comm, cell="triangle", x=np.array(x), cells=np.array(cells), facet_groups=groups
        )

    def by_msh(x, cells):
        elements = [*((1, 2, e) for e in BASE[:1]), *((2, 1, c) for c in cells)]
        return dj.read_msh(put("a.msh", msh(x, ['2 1 "body"', '1 2 "base"'], elements)), comm)

    def by_xdmf(x, cells):
        cells = put("a.xdmf", xdmf("Triangle", x, cells, [0] * len(cells)))
        facets = put("f.xdmf", xdmf("Polyline", x, BASE[:1], [3]))
        return dj.read_xdmf(cells, comm, joints={}, groups={"base": 3}, facet_file=facets)

    def by_dolfinx(x, cells):
        element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
        whole = np.array(cells), np.array(x, dtype=float)
        return dj.split_mesh(create_mesh(MPI.COMM_SELF, *whole, element))

    def by_split(x, cells):
        path = new_path("a.h5")
        dj.write_split(path, by_arrays(X, CELLS))
        if comm.rank == 0:
            with h5py.File(path, "r+") as file:
                for name, rows in (("x", x), ("cells", cells)):
                    file[name][...] = np.array(rows)[: len(file[name])]
        comm.barrier()
        return dj.read_split(path, comm)

    return {f.__name__[3:]: f for f in (by_arrays, by_msh, by_xdmf, by_dolfinx, by_split)}


FLAT = [[0, 0], [1, 0], [2, 0], [0, 0], [1, 1], [2, 1]]  # a cell of which two nodes coincide
CROWDED = [*X[:5], [1.5, 0.5]]  # three cells at the edge from 1 to 4
FAULTS = {
    "have all vertices of another": (X, [CELLS[0], CELLS[1], CELLS[2], CELLS[0]]),
    "have no area": (FLAT, CELLS),
    "belongs to more than two": (CROWDED, [[0, 1, 4], [0, 4, 3], [1, 2, 4], [1, 4, 5]]),
}


READERS = ["arrays", "msh", "xdmf", "split"]


@pytest.mark.parametrize(
    ("door", "fault"),
    # DOLFINx makes no mesh of the other faults, so that `split_mesh` never gets one.
    [*product(READERS, FAULTS), ("dolfinx", "have no area")],
)
def test_wrong_cells_are_refused_with_their_place(doors, door, fault):
    with pytest.raises(dj.MeshError, match=rf"[123] cells .*{fault}.* is cell \d around \(.*\)\.$"):
        doors[door](*FAULTS[fault])


@pytest.mark.parametrize("door", ["arrays", "msh", "xdmf", "dolfinx"])
@pytest.mark.parametrize(("mesh", "count"), [(COINCIDENT, 2), (STAGGERED, 3)])
def test_faces_that_touch_and_are_not_connected_are_warned_of(comm, doors, door, mesh, count):
    """The centre of each edge lies on another: of two, or of one and its two halves."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        doors[door](*mesh)
    texts = [str(each.message) for each in caught]
    if comm.rank == 0 or door == "dolfinx":
        assert [text[: text.index(",")] for text in texts] == [
            f"{count} boundary facets touch others"
        ]
        assert caught[0].filename == __file__
    else:
        assert texts == []


def test_faces_of_a_joint_may_touch(comm):
    x, cells = (np.array(each) for each in COINCIDENT)
    sides = {"lift-": np.array([[1, 4]]), "lift+": np.array([[6, 7]])}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for joints in (["lift"], []):
            dj.mesh_from_arrays(
                comm, cell="triangle", x=x, cells=cells, facet_groups=sides, joints=joints
            )


def test_groups_of_one_name_are_one_group(comm, put):
    """Gmsh itself would keep the first: the base is 2 m long, the upper half of the joint lost."""
    x = [*X, [1, 0.5]]
    cells = [[0, 1, 6], [0, 6, 3], [3, 6, 4], [1, 2, 6], [2, 5, 6], [6, 5, 4]]
    names = ['2 1 "body"', '1 2 "base"', '1 3 "base"', '1 4 "joint_1"', '1 5 "joint_1"']
    edges = [(1, 2, [0, 1]), (1, 3, [1, 2]), (1, 4, [1, 6]), (1, 5, [6, 4])]
    path = put("twice.msh", msh(x, names, [*edges, *((2, 1, c) for c in cells)]))
    jointed = dj.read_msh(path, comm)
    for group, length in (("base", 2.0), ("joint_1-", 1.0)):
        found = fem.assemble_scalar(fem.form(1.0 * jointed.ds(group)))
        assert comm.allreduce(found) == pytest.approx(length)


def test_facets_of_groups_without_a_name_are_warned_of(comm, put):
    elements = [(1, 7, JOINT[0]), (1, 2, BASE[0]), *((2, 1, c) for c in CELLS)]
    path = put("unnamed.msh", msh(X, ['2 1 "body"', '1 2 "base"'], elements))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dj.read_msh(path, comm)
    sentence = "1 facets in the unnamed physical group 7 are not read, 1 of them inside"
    assert [sentence in str(each.message) for each in caught] == [True] * (comm.rank == 0)


@pytest.mark.parametrize(
    ("name", "warned"), [("jiont_2", True), ("Contraction_joint", True), ("lift", False)]
)
def test_misspelt_joints_are_warned_of(comm, name, warned):
    given = {"cell": "triangle", "x": np.array(X, dtype=float), "cells": np.array(CELLS)}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dj.mesh_from_arrays(comm, **given, facet_groups={name: np.array([JOINT[0]])})
        dj.mesh_from_arrays(comm, **given, facet_groups={name: np.array([JOINT[0]])}, joints=[])
        both = {"joint_1": np.array(JOINT), name: np.array([JOINT[0]])}
        dj.mesh_from_arrays(
            comm, **given, facet_groups=both
        )  # a part of a joint is no misspelt one
    text = f"Facets of {name!r} lie inside the body but are not a joint, because the name does"
    assert [text in str(each.message) for each in caught] == [True] * (warned and comm.rank == 0)


XDMF_FAULTS = [
    (BASE, [3, 3], X, None),
    ([[0, 1], [0, 5]], [3, 3], X, "Group 'base': 1 of its facets belong to no cell"),
    (BASE, [3, 3], X[::-1], "the 6 nodes of the facets are not the 6 nodes of the mesh"),
    (BASE, [3, 3], X[:3], "the 3 nodes of the facets are not the 6 nodes of the mesh"),
    ([[0, 1], [1, 9]], [3, 3], X, "'base' has numbers from 0 to 9; the nodes are numbered"),
    (BASE, [3], X, "2 facets have 1 tags"),
]


@pytest.mark.parametrize(("facets", "tags", "x", "sentence"), XDMF_FAULTS)
def test_tagged_facets_are_those_of_the_mesh(comm, put, facets, tags, x, sentence):
    cells = put("cells.xdmf", xdmf("Triangle", X, CELLS, [0] * 4))
    given = {"joints": {}, "groups": {"base": 3}}
    given["facet_file"] = put("facets.xdmf", xdmf("Polyline", x, facets, tags))
    if sentence is None:
        assert comm.allreduce(len(dj.read_xdmf(cells, comm, **given).facets("base"))) == 2
    else:
        with pytest.raises(dj.MeshError, match=sentence):
            dj.read_xdmf(cells, comm, **given)


def test_a_facet_with_two_tags_is_in_both_groups(comm, put):
    cells = put("cells.xdmf", xdmf("Triangle", X, CELLS, [0] * 4))
    facets = put("facets.xdmf", xdmf("Polyline", X, [*BASE, BASE[0]], [3, 3, 4]))
    jointed = dj.read_xdmf(cells, comm, joints={}, groups={"base": 3, "toe": 4}, facet_file=facets)
    for group, moment in (("base", 2.0), ("toe", 0.5)):  # of x from 0 to 2, and to 1
        form = fem.form(ufl.SpatialCoordinate(jointed.mesh)[0] * jointed.ds(group))
        assert comm.allreduce(fem.assemble_scalar(form)) == pytest.approx(moment)


def test_messages_lead_to_the_cause(comm, put):
    mixed = put("mixed.xdmf", xdmf("Mixed", X, CELLS, [0] * 4))
    with pytest.raises(dj.MeshError, match="mixes several kinds of cells; write cells and facets"):
        dj.read_xdmf(mixed, comm, joints={})
    both = msh(
        *COINCIDENT[:1],
        ['2 1 "body"', '1 2 "joint_1"'],
        [(1, 2, [1, 4]), (1, 2, [6, 7]), *((2, 1, c) for c in COINCIDENT[1])],
    )
    with pytest.raises(dj.MeshError, match="'joint_1' contains both of its faces, which Gmsh's"):
        dj.read_msh(put("crack.msh", both), comm)
    unnamed = put("all.msh", msh(X, ['2 1 "body"'], [(2, 0, c) for c in CELLS]))
    with pytest.raises(dj.MeshError, match="Mesh.SaveAll has dropped the groups in format 2.2"):
        dj.read_msh(unnamed, comm)


def test_integrals_over_ds_are_on_the_boundary(comm):
    mesh = create_rectangle(comm, [[0, 0], [1, 1]], [4, 4], CellType.quadrilateral)
    lift = locate_entities(mesh, 1, lambda x: np.isclose(x[1], 0.5))
    jointed = dj.split_mesh(mesh, groups={"lift": lift})
    with pytest.raises(
        dj.MeshError, match="^4 facets of 'lift' lie inside the body; loads, springs"
    ):
        jointed.ds("lift")
