# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes given as arrays: the order of nodes, shapes and numbers are checked."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from rings import quarter_ring

from dolfinx_joints import MeshError, mesh_from_arrays

pytestmark = pytest.mark.mpi

# Two squares side by side; the last node belongs to no cell.
X = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [9, 9]]
AROUND = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
SQUARES = {
    "cell": "quadrilateral",
    "x": X,
    "cells": AROUND[:, [0, 1, 3, 2]],
    "facet_groups": {"joint_1": [[4, 1]], "base": [[0, 1], [1, 2]]},
}


def test_nodes_without_a_cell_are_left_out(comm):
    jointed = mesh_from_arrays(comm, **SQUARES)
    assert jointed.joint_names == ("joint_1",)
    # 6 nodes and the 2 of the joint once more.
    assert jointed.mesh.topology.index_map(0).size_global == 8
    assert mesh_from_arrays(comm, **SQUARES, joints=[]).joint_names == ()


def test_nodes_in_another_order_are_refused(comm):
    message = r"^2 cells are partly inside out, the first is cell 0; nodes must be in the order"
    with pytest.raises(MeshError, match=message):
        mesh_from_arrays(comm, **{**SQUARES, "cells": AROUND})
    for cell in ("triangle", "tetrahedron"):
        arrays = quarter_ring(cell, 2)
        cells = arrays["cells"].copy()
        cells[3, [-2, -1]] = cells[3, [-1, -2]]  # two nodes of edges
        with pytest.raises(MeshError, match="^1 cells are partly inside out, the first is cell 3"):
            mesh_from_arrays(comm, **{**arrays, "cells": cells})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"cell": "prism"}, "cell is 'prism'; it must be one of triangle, quadrilateral, tet"),
        ({"x": np.zeros((7, 3))}, r"x is an array of shape \(7, 3\); a quadrilateral mesh needs"),
        ({"cells": [[0, 1, 3]]}, r"cells is an array of .* of shape \(n, 4 or 9\) are needed"),
        ({"cells": AROUND + 3}, "cells has numbers from 3 to 8; the nodes are numbered from 0"),
        ({"facet_groups": {"a": [[4, 1, 0]]}}, r"The facet group 'a' is an array of shape \(1, 3"),
        ({"facet_groups": {"a": [[3, 1]]}}, "Group 'a': 1 of its facets belong to no cell"),
        ({"facet_groups": [[4, 1]]}, "facet_groups is .*; it must be an array by name"),
        ({"cell_groups": {"a": [2]}}, "The cell group 'a' has numbers from 2 to 2; the cells"),
        ({"joints": ["side"]}, "The mesh has no joint 'side'"),
    ],
)
def test_what_does_not_fit_is_refused(comm, changes, sentence):
    with pytest.raises(ValueError, match=f"^{sentence}"):
        mesh_from_arrays(comm, **{**SQUARES, **changes})
