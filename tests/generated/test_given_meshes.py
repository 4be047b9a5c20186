# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options with which a mesh file is read, and with which a mesh is split."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_input import answer, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, numbers, passed_on
from sentences import one_sentence

pytest.importorskip("dolfinx")

import dolfinx.mesh as meshes

from dolfinx_joints import read_msh, split_mesh

groups = st.sampled_from(("joint_1", "base", "top", "sides", "joint_9", "joint_1+", ""))


@pytest.mark.mpi
@costly()
@given(joints=st.lists(groups, max_size=3) | JUNK)
def test_joints_of_a_mesh_file(blocks_file: Callable[..., Path], comm: Any, joints: Any) -> None:
    path = blocks_file(size=1.0)
    call = one_sentence(passed_on(lambda: read_msh(path, comm, joints=joints)))
    answer("read_msh, joints", call, comm=comm)


@pytest.mark.mpi
@costly()
@given(path=JUNK | st.sampled_from(("no.msh", "/", "/proc", "/dev/null", "/proc/self/mem")))
def test_paths_of_mesh_files(comm: Any, path: Any) -> None:
    call = one_sentence(passed_on(lambda: read_msh(path, comm)))
    assert answer("read_msh, path", call, comm=comm) is None


@pytest.fixture(scope="module")
def square(comm: Any) -> tuple[Any, Any, Any]:
    """Two by two squares, and tags: base 1, the lines between the squares 2 and 3, cells 4."""
    mesh = meshes.create_unit_square(comm, 2, 2, meshes.CellType.quadrilateral)

    def tagged(dim: int, **where: tuple[int, Callable[[Any], Any]]) -> Any:
        found = [(meshes.locate_entities(mesh, dim, at), tag) for tag, at in where.values()]
        places = np.concatenate([entities for entities, _ in found])
        tags = np.concatenate([np.full(len(entities), tag) for entities, tag in found])
        order = np.argsort(places)
        return meshes.meshtags(mesh, dim, places[order], tags[order].astype(np.int32))

    facets = tagged(
        1,
        base=(1, lambda x: x[1] < 1e-9),
        upright=(2, lambda x: abs(x[0] - 0.5) < 1e-9),
        level=(3, lambda x: abs(x[1] - 0.5) < 1e-9),
    )
    return mesh, facets, tagged(2, cells=(4, lambda x: x[0] < 0.6))


TAGS = st.integers(1, 4) | numbers(1.0)
NAMED = st.dictionaries(st.sampled_from(("joint_1", "j", "base", "")), TAGS, max_size=2)


@pytest.mark.mpi
@costly()
@given(data=st.data())
def test_split_mesh(square: tuple[Any, Any, Any], comm: Any, data: st.DataObject) -> None:
    mesh, facets, cells = square
    good = st.just({"joint_1": 2}) | st.just({"joint_1": 2, "joint_2": 3})
    needed = {
        "facet_tags": st.just(facets) | st.sampled_from((facets, cells, mesh)),
        "joints": good | NAMED,
        "groups": st.just({"base": 1}) | NAMED,
    }
    optional = {
        "cell_tags": st.sampled_from((cells, cells, facets, None)),
        "cell_groups": st.none() | st.just({"rock": 4}) | NAMED,
    }
    given = data.draw(arguments(needed, optional))
    whole = data.draw(st.sampled_from((mesh, mesh, mesh, mesh, facets)) | JUNK)
    call = one_sentence(passed_on(lambda: split_mesh(whole, **given)))
    made = answer("split_mesh", call, comm=comm)
    if made is not None:
        assert made.mesh.topology.index_map(2).size_global == 4
        assert set(made.joint_names) == set(given["joints"])
