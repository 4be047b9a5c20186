# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The same body by every way into the package: arrays, a DOLFINx mesh, XDMF."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import basix.ufl
from dolfinx import fem
from dolfinx.io import XDMFFile
from dolfinx.mesh import locate_entities, locate_entities_boundary, meshtags
from grids import SHAPES, name_of
from rings import INSIDE, JOINT, quarter_ring
from whole_vectors import whole_layout

from dolfinx_joints import mesh_from_arrays, read_xdmf, split_mesh
from dolfinx_joints.joints.points import joint_points
from dolfinx_joints.mesh.distribution.shares import share_of
from dolfinx_joints.mesh.dolfinx_versions import create_mesh
from dolfinx_joints.mesh.reading import dolfinx_mesh

pytestmark = pytest.mark.mpi


def whole_ring(comm, arrays, degree):
    """The ring of DOLFINx, not split, with its facets at the joint and inside, and its core."""
    x, cells = arrays["x"], arrays["cells"]
    if comm.rank > 0:
        x, cells = x[:0], cells[:0]
    element = basix.ufl.element("Lagrange", arrays["cell"], degree, shape=(x.shape[1],))
    mesh = create_mesh(comm, cells, x, element)
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    joint = locate_entities(mesh, dim - 1, lambda x: np.isclose(np.hypot(x[0], x[1]), JOINT))
    inside = locate_entities_boundary(
        mesh, dim - 1, lambda x: np.isclose(np.hypot(x[0], x[1]), INSIDE)
    )
    core = locate_entities(mesh, dim, lambda x: np.hypot(x[0], x[1]) < JOINT + 1e-9)
    return mesh, joint, inside, core


def tagged(mesh, dim, name, groups):
    """Tags by name."""
    entities = np.concatenate(list(groups.values()))
    values = np.repeat(np.array(list(groups), np.int32), [len(each) for each in groups.values()])
    order = np.argsort(entities)
    tags = meshtags(mesh, dim, entities[order], values[order])
    tags.name = name
    return tags


def measured(jointed):
    """Joint points in the order of their places, and sizes of two groups [m^2, m^3]."""
    comm = jointed.mesh.comm
    layout = joint_points(comm, jointed.pairs, jointed.shape, jointed.shape.degree, "gauss")
    layout = whole_layout(comm, layout)
    order = np.lexsort(np.round(layout.points, 9).T)
    forms = [fem.form(1.0 * jointed.ds("inside")), fem.form(1.0 * jointed.dx("core"))]
    sizes = [comm.allreduce(fem.assemble_scalar(form)) for form in forms]
    return [each[order] for each in (layout.points, layout.frames, layout.areas)] + [sizes]


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_a_mesh_split_where_it_is_is_that_of_rank_0(comm, shape, monkeypatch):
    """Nodes are duplicated, numbered and paired alike, and only cells at the joint travel."""
    arrays = quarter_ring(shape.name, 4, shape.degree)
    mesh, joint, inside, core = whole_ring(comm, arrays, shape.degree)
    seen = []
    split = dolfinx_mesh.prepare
    monkeypatch.setattr(dolfinx_mesh, "prepare", lambda raw, n: seen.append(raw) or split(raw, n))
    groups = {"joints": {"joint": joint}, "groups": {"inside": inside}}
    found = share_of(split_mesh(mesh, **groups, cell_groups={"core": core}))
    arrays["facet_groups"] = {name: arrays["facet_groups"][name] for name in ("inside", "joint")}
    wanted = share_of(mesh_from_arrays(comm, **arrays))
    for one, other in ((found, wanted), (found.pairs, wanted.pairs)):
        for name, rows in other.rows().items():
            np.testing.assert_array_equal(one.rows()[name], rows, name)
    assert (found.facet_groups, found.cell_groups) == (wanted.facet_groups, wanted.cell_groups)
    at_joint = np.isin(arrays["cells"], arrays["facet_groups"]["joint"]).any(axis=1)
    assert [len(raw.cells) for raw in seen] == ([at_joint.sum()] if comm.rank == 0 else [])
    assert at_joint.sum() < len(at_joint)


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_every_way_gives_the_same(comm, new_path, shape):
    arrays = quarter_ring(shape.name, 4, shape.degree)
    mesh, joint, inside, core = whole_ring(comm, arrays, shape.degree)
    facet_tags = tagged(mesh, shape.dim - 1, "facets", {3: inside, 7: joint})
    cell_tags = tagged(mesh, shape.dim, "cells", {5: core})
    by_tag = {"joints": {"joint": 7}, "groups": {"inside": 3}, "cell_groups": {"core": 5}}
    path = new_path("ring.xdmf")
    with XDMFFile(comm, path, "w") as file:
        file.write_mesh(mesh)
        for tags in facet_tags, cell_tags:
            file.write_meshtags(tags, mesh.geometry)
    comm.barrier()
    facets = {"joints": {"joint": joint}, "groups": {"inside": inside}}

    expected = measured(mesh_from_arrays(comm, **arrays))
    assert len(expected[0]) > 0
    for jointed in (
        split_mesh(mesh, facet_tags, cell_tags=cell_tags, **by_tag),
        split_mesh(mesh, **facets, cell_groups={"core": core}),
        read_xdmf(path, comm, **by_tag),
    ):
        assert jointed.shape == shape
        for found, wanted in zip(measured(jointed), expected, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)
