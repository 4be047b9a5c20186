# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""XDMF files: what is found without a name, and the mistakes of a user."""

from __future__ import annotations

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


def test_what_is_not_there_is_said(comm, new_path, written):
    path = written(SQUARES, EDGES)
    joint = {"joints": {"joint": 7}}
    refused = [
        (new_path("nothing.xdmf"), joint, r"^Mesh file '.*nothing\.xdmf' does not exist\.$"),
        (path, {"facet_tags": "a", **joint}, r"mesh\.xdmf has no facet tags 'a'; it has: 'edges'"),
        (path, {"mesh": "a", **joint}, "has no mesh 'a'; it has: 'squares', 'edges'"),
        (path, {"joints": {"joint": 4}}, "No facet carries the tag 4 of the group 'joint'; the"),
        (written(SQUARES), joint, r"mesh\.xdmf has no facet tags\.$"),
        (written("<Grid>"), joint, r"mesh\.xdmf is no XDMF file: mismatched tag"),
        (
            written(SQUARES.replace("XML", "HDF")),
            joint | {"facet_file": path},
            r"mesh\.xdmf cannot be read: .*No such file",
        ),
    ]
    for file, given, sentence in refused:
        with pytest.raises(MeshError, match=sentence):
            read_xdmf(file, comm, **given)
