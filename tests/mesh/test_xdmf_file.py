# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""XDMF files: what is found without a name, and the mistakes of a user."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem

from dolfinx_joints import MeshError, read_xdmf

pytestmark = pytest.mark.mpi

X = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]


def grid(name, kind, cells, tags):
    """A grid as meshio writes it, its numbers in the text."""
    arrays = [np.array(each) for each in (X, cells, tags)]
    x, cells, tags = (
        f'<DataItem Dimensions="{" ".join(map(str, each.shape))}" Format="XML">'
        f"{' '.join(map(str, each.ravel()))}</DataItem>"
        for each in arrays
    )
    size = f'NumberOfElements="{len(arrays[1])}" NodesPerElement="{arrays[1].shape[1]}"'
    return (
        f'<Grid Name="{name}" GridType="Uniform"><Geometry GeometryType="XY">{x}</Geometry>'
        f'<Topology TopologyType="{kind}" {size}>{cells}</Topology>'
        f'<Attribute Name="tags" AttributeType="Scalar" Center="Cell">{tags}</Attribute></Grid>'
    )


SQUARES = grid("squares", "Quadrilateral", [[0, 1, 4, 3], [1, 2, 5, 4]], [[5], [6]])
EDGES = grid("edges", "Polyline", [[1, 4], [0, 1]], [[7], [8]])
OTHERS = grid("others", "Polyline", [[1, 2]], [[9]])


@pytest.fixture(scope="module")
def written(comm, new_path):
    """``written(grid, ...)``: the file of some grids (collective)."""

    def write(*grids):
        path = new_path("mesh.xdmf")
        if comm.rank == 0:
            path.write_text(f'<Xdmf Version="3.0"><Domain>{"".join(grids)}</Domain></Xdmf>')
        comm.barrier()
        return path

    return write


def test_facet_tags_in_a_file_of_their_own(comm, written):
    jointed = read_xdmf(
        written(SQUARES),
        comm,
        facet_file=written(EDGES),
        joints={"joint": 7},
        groups={"base": 8},
        cell_groups={"left": 5},
    )
    assert sorted(jointed.facet_groups) == ["base"]
    assert jointed.pairs.count == 1
    # The square from x = 0 to 1 has the static moment 1/2.
    moment = ufl.SpatialCoordinate(jointed.mesh)[0] * jointed.dx("left")
    assert comm.allreduce(fem.assemble_scalar(fem.form(moment))) == pytest.approx(0.5)


def test_one_of_several_is_chosen_by_name(comm, written):
    path = written(SQUARES, EDGES, OTHERS)
    message = r"has facet tags 'edges', 'others'; choose one by facet_tags=\.$"
    with pytest.raises(MeshError, match=message):
        read_xdmf(path, comm, joints={"joint": 7})
    assert read_xdmf(path, comm, facet_tags="edges", joints={"joint": 7}).joint_names == ("joint",)


def attributes(*named):
    """Tags of the two edges under several names: name, place, tags."""
    return "".join(
        f'<Attribute Name="{name}" AttributeType="Scalar" Center="{center}"><DataItem '
        f'Dimensions="2 1" Format="XML">{tags}</DataItem></Attribute>'
        for name, center, tags in named
    )


def with_attributes(*named):
    start = EDGES.index("<Attribute")
    return EDGES[:start] + attributes(*named) + "</Grid>"


GEOMETRICAL, PHYSICAL = ("gmsh:geometrical", "Cell", "8 7"), ("gmsh:physical", "Cell", "7 8")


@pytest.mark.parametrize(
    ("named", "name", "sentence"),
    [
        ([GEOMETRICAL, PHYSICAL], None, None),
        ([GEOMETRICAL, PHYSICAL], "edges", None),
        ([("heat", "Node", "8 7"), ("tags", "Cell", "7 8")], None, None),
        ([GEOMETRICAL, ("tags", "Cell", "7.0 8.0")], "tags", None),
        ([GEOMETRICAL, ("tags", "Cell", "7 8")], None, "'gmsh:geometrical', 'tags'; choose one by"),
        ([("heat", "Node", "7 8")], None, "has no facet tags"),
        ([("tags", "Cell", "7 8.5")], None, r"8\.5 in Attribute.* is not a whole number"),
    ],
)
def test_tags_are_chosen_among_attributes(comm, written, named, name, sentence):
    path = written(SQUARES, with_attributes(*named))
    given = {"joints": {"joint": 7}, "groups": {"base": 8}, "facet_tags": name}
    if sentence:
        with pytest.raises(MeshError, match=sentence):
            read_xdmf(path, comm, **given)
    else:  # the other way round the joint is on the boundary, which is refused
        assert read_xdmf(path, comm, **given).joint_names == ("joint",)


def test_a_plane_mesh_may_have_a_constant_third_coordinate(comm, written):
    flat, x = " ".join(f"{a} {b} 3" for a, b in X), " ".join(f"{a} {b}" for a, b in X)
    edges = EDGES.replace('"6 2"', '"6 3"').replace(x, flat)
    assert read_xdmf(written(SQUARES, edges), comm, joints={"joint": 7}).pairs.count == 1
    squares = SQUARES.replace('"6 2"', '"6 3"').replace(x, flat)
    assert read_xdmf(written(squares, EDGES), comm, joints={"joint": 7}).pairs.count == 1
    series = '<Grid GridType="Collection" CollectionType="Temporal"></Grid>'
    with pytest.raises(MeshError, match="no facet tags; grids in a Collection are not read"):
        read_xdmf(written(SQUARES, series), comm, joints={"joint": 7})


def test_what_is_not_there_is_said(comm, new_path, written):
    path = written(SQUARES, EDGES)
    joint = {"joints": {"joint": 7}}
    refused = [
        (new_path("nothing.xdmf"), joint, r"^Mesh file '.*nothing\.xdmf' does not exist\.$"),
        (path, {"facet_tags": "a", **joint}, r"mesh\.xdmf has no facet tags 'a'; it has: 'edges'"),
        (path, {"mesh": "a", **joint}, "has no mesh 'a'; it has: 'squares', 'edges'"),
        (path, {"joints": {"joint": 4}}, "No facet has the tag 4 of the group 'joint'; the"),
        (written(SQUARES), joint, r"mesh\.xdmf has no facet tags; grids in"),
        (written("<Grid>"), joint, r"mesh\.xdmf is not an XDMF file: mismatched tag"),
        (
            written(SQUARES.replace("XML", "HDF")),
            joint | {"facet_file": path},
            r"mesh\.xdmf cannot be read: .*No such file",
        ),
    ]
    for file, given, sentence in refused:
        with pytest.raises(MeshError, match=sentence):
            read_xdmf(file, comm, **given)
