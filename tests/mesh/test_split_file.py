# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Split meshes in files: what was split is read, by shares, and damage is told on all ranks."""

import json
import re

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from mpi4py import MPI

from dolfinx import fem

import dolfinx_joints as dj
from dolfinx_joints.common.mpi import on_root
from dolfinx_joints.mesh import dolfinx_versions
from dolfinx_joints.mesh.joint_pairs import PAIR_ROWS
from dolfinx_joints.mesh.node_numbering import NodeNumbering

pytestmark = pytest.mark.mpi

MESHES = {
    "wall of hexahedra": ("wall_file", {}),
    "27-node hexahedra": ("blocks_file", {"order": 2}),
    "10-node tetrahedra": ("blocks_file", {"cell": "tet", "order": 2}),
    "triangles": ("two_rectangles_file", {"cell": "tri"}),
    "9-node quadrilaterals": ("two_rectangles_file", {"order": 2}),
}
LAW = dj.FrictionNoTension(normal_stiffness=1e10, shear_stiffness=1e10, friction_angle_deg=40.0)


def doubled(comm):
    """Two squares of 1 m, one 1 mm above the other, and a cell group over both."""
    x = [[0, 0], [1, 0], [0, 1], [1, 1], [0, 1.001], [1, 1.001], [0, 2], [1, 2]]
    return dj.mesh_from_arrays(
        comm,
        cell="quadrilateral",
        x=x,
        cells=[[0, 1, 2, 3], [4, 5, 6, 7]],
        facet_groups={"joint-": [[2, 3]], "joint+": [[4, 5]], "base": [[0, 1]]},
        cell_groups={"all of it/them": [0, 1], "upper": [1]},
    )


def content(path):
    """The arrays of a file, its facts as they are read."""
    with h5py.File(path, "r") as file:
        found = {name: each[()] for name, each in file.items()}
    return found | {"facts": json.loads(found["facts"].tobytes())}


def group_sizes(jointed):
    """Volume and area of each named group and side, [m^3] and [m^2]."""
    measures = {name: jointed.dx(name) for name in jointed.cell_groups}
    measures |= {
        f"surface {name}": jointed.ds(name)
        for name in jointed._facet_groups
        if jointed.joint_names or not name.startswith("joint")
    }
    return {
        name: jointed.mesh.comm.allreduce(fem.assemble_scalar(fem.form(1.0 * measure)))
        for name, measure in measures.items()
    }


def under_its_weight(jointed):
    """Joint points with their gaps and tractions, and the displacement, on rank 0."""
    group = next(iter(jointed.cell_groups))
    material = dict.fromkeys(
        jointed.cell_groups, dj.Elastic(young=1e10, poisson=0.2, density=2400.0)
    )
    model = dj.Model(
        jointed,
        material=material if len(material) > 1 else material[group],
        joints=LAW,
        supports=[dj.Fixed(group="base")],
        loads=[dj.Gravity()],
    )
    state, operator = dj.Simulation(model).statics(), model.operator
    values = {
        "points": operator.points,
        "frames": operator.frames,
        "areas": operator.areas,
        "initial gap": operator.initial_gap,
        "traction": state.joints.traction,
    }
    gathered = {name: operator.gather(each) for name, each in values.items()}
    return gathered | {"displacement": NodeNumbering(model.V).gather(state.displacement)}


@pytest.mark.parametrize("name", MESHES)
def test_what_was_split_is_read(comm, request, new_path, name):
    fixture, parameters = MESHES[name]
    source, path = request.getfixturevalue(fixture)(**parameters), new_path("split.h5")
    split = dj.read_msh(source, comm)
    dj.write_split(path, split)
    # The file is that of one rank: its order is the one of the input.
    alone = on_root(comm, lambda: new_alone(source, path))
    written = content(path)
    for each, wanted in content(alone).items():
        np.testing.assert_equal(written[each], wanted, each)

    read = dj.read_split(path, comm)
    assert (read.shape, read.facet_groups, read.cell_groups) == (
        split.shape,
        split.facet_groups,
        split.cell_groups,
    )
    pairs, wanted = read.pairs.gathered(comm), split.pairs.gathered(comm)
    for each in (*PAIR_ROWS, "names", "count", "axes", "gaps_in_geometry", "bonded"):
        np.testing.assert_array_equal(getattr(pairs, each), getattr(wanted, each), each)
    assert group_sizes(read) == pytest.approx(group_sizes(split), rel=1e-13)
    found, wanted = under_its_weight(read), under_its_weight(split)
    if comm.rank == 0:
        for each in wanted:
            scale = np.abs(wanted[each]).max(initial=0.0)
            np.testing.assert_allclose(found[each], wanted[each], 0, 1e-10 * scale, err_msg=each)
        assert wanted["traction"].any()


def new_alone(source, path):
    """The file that one rank writes."""
    alone = path.with_suffix(".alone.h5")
    dj.write_split(alone, dj.read_msh(source, MPI.COMM_SELF))
    return alone


def test_gaps_in_the_geometry_are_kept(comm, new_path):
    path = new_path("doubled.h5")
    dj.write_split(path, doubled(comm))
    read = dj.read_split(path, comm)
    assert read.cell_groups.keys() == {"all of it/them", "upper"}
    gap = dj.Model(read, material=dj.Elastic(young=1e10, poisson=0.2, density=0.0), joints=LAW)
    gap = gap.operator.gather(gap.operator.initial_gap)
    if comm.rank == 0:
        np.testing.assert_allclose(gap, [[1e-3, 0, 0]] * 2, atol=1e-15)


def centres(jointed, name):
    """Centres of the facets of a group on all ranks; a facet between ranks may be on both."""
    here = np.round(jointed.corners(name).mean(axis=1), 9)
    return {tuple(x) for rows in jointed.mesh.comm.allgather(here.tolist()) for x in rows}


def test_a_mesh_without_joints_is_read(comm, wall_file, new_path):
    path, whole = new_path("whole.h5"), dj.read_msh(wall_file(), comm, joints=[])
    dj.write_split(path, whole)
    read = dj.read_split(path, comm)
    assert read.joint_names == ()
    assert group_sizes(read) == pytest.approx(group_sizes(whole), rel=1e-13)
    for name in ("joint_1", "joint_2", "joint_3"):
        one, other = (centres(jointed, name) for jointed in (read, whole))
        assert one == other != set()


def test_no_rank_reads_more_than_its_share(comm, wall_file, new_path, monkeypatch):
    """Of every array at most one row more than the mean of the ranks; so in the mesh's making."""
    path, taken = new_path("wall.h5"), {}
    dj.write_split(path, dj.read_msh(wall_file(divisions=(8, 2, 6)), comm))
    counts = {name: len(each) for name, each in content(path).items() if name != "facts"}
    read, create = h5py.Dataset.__getitem__, dolfinx_versions.create_mesh

    def watched(dataset, key, *rest):
        found = read(dataset, key, *rest)
        name = dataset.name.strip("/")
        taken[name] = taken.get(name, 0) + len(found)
        return found

    def created(comm, cells, x, *rest):
        taken["cells given"], taken["x given"] = len(cells), len(x)
        return create(comm, cells, x, *rest)

    monkeypatch.setattr(h5py.Dataset, "__getitem__", watched)
    monkeypatch.setattr(dolfinx_versions, "create_mesh", created)
    pairs = dj.read_split(path, comm).pairs
    for name, count in {**counts, "cells given": counts["cells"], "x given": counts["x"]}.items():
        assert comm.allreduce(taken[name]) == count
        assert taken[name] <= count / comm.size + 1
    # Each pair is with its cells, and with no other rank.
    assert sorted(np.concatenate(comm.allgather(pairs.number))) == list(range(counts["joint"]))


def refused(comm, path, reason):
    """Check that every rank gets one clear sentence."""
    with pytest.raises(dj.MeshError, match=reason) as raised:
        dj.read_split(path, comm)
    message = str(raised.value)
    assert str(path) in message
    assert message.count("\n") == 0
    comm.barrier()  # before the next damage


def test_wrong_files_are_one_error_on_all_ranks(comm, wall_file, new_path):
    path = new_path("wall.h5")
    refused(comm, path, "does not exist")
    dj.write_split(path, dj.read_msh(wall_file(), comm))
    whole = on_root(comm, path.read_bytes)
    x = on_root(comm, lambda: content(path)["x"].tobytes())
    place = whole.index(x) + len(x) // 2
    for damaged, reason in (
        (b"$MeshFormat\n4.1 0 8\n", "is not an HDF5 file"),
        (whole[:-100], "is truncated"),
        (whole[:place] + b"\7" + whole[place + 1 :], "is not a split mesh, or is damaged"),
    ):
        on_root(comm, lambda damaged=damaged: path.write_bytes(damaged))
        refused(comm, path, reason)
    for change, reason in (
        (lambda file: file.attrs.modify("version", 7), "has version 7 of the layout; this program"),
        (
            lambda file: file["cells"].write_direct(file["cells"][()] + 1),
            "cells has values out of range",
        ),
        (
            lambda file: file["joint"].write_direct(file["joint"][()] + 9),
            "joint has values out of range",
        ),
        (lambda file: file.pop("match"), "is not a split mesh, or is damaged: .*match"),
        (lambda file: file.attrs.pop("format"), "is an HDF5 file but not a 'dolfinx_joints split"),
    ):
        on_root(comm, lambda change=change: changed(path, whole, change))
        refused(comm, path, reason)


def changed(path, whole, change):
    """Write a file with a change that HDF5 does not notice."""
    path.write_bytes(whole)
    with h5py.File(path, "r+", libver="latest") as file:
        change(file)


def test_files_are_replaced_only_if_asked(comm, new_path):
    path, mesh = new_path("doubled.h5"), doubled(comm)
    on_root(comm, lambda: path.write_text("of somebody"))
    with pytest.raises(
        dj.MeshError, match=r"^.* exists already; replace it by --force \(overwrite=True\)"
    ):
        dj.write_split(path, mesh)
    dj.write_split(path, mesh, overwrite=True)
    assert dj.read_split(path, comm).joint_names == ("joint",)
    with pytest.raises(dj.MeshError, match=f"^{re.escape(str(path / 'sub'))} cannot be written: "):
        dj.write_split(path / "sub", mesh)
