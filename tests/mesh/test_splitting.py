# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Duplicating nodes across joints: counts by hand, sides, refusals.

`test_fracture_networks` counts every node and checks that the two sides coincide.
"""

import numpy as np
import pytest

pytest.importorskip("basix")

import basix
from grids import (
    CASES,
    SHAPES,
    already_split,
    case,
    facets_on,
    grid,
    name_of,
    through,
)

from dolfinx_joints.common.errors import MeshError
from dolfinx_joints.mesh.cells import CellShape
from dolfinx_joints.mesh.splitting import pair_coincident, split_cells


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_node_counts(shape, name):
    cells, x, joints, extra = case(name, shape)
    split = split_cells(shape, cells, x, joints)
    corners = len(basix.topology(shape.type)[0])
    before, after = (len(np.unique(c[:, :corners])) for c in (cells, split.cells))
    assert after - before == extra
    assert len(np.unique(split.cells)) == len(split.parent) == split.cells.max() + 1
    np.testing.assert_array_equal(split.parent[: len(x)], np.arange(len(x)))
    assert np.all(split.bonded == 0)
    assert len(split.joint) == sum(len(f) for _, f in joints)


def vertices_of(shape, cells, slots):
    return cells[slots[:, :1], shape.facet_vertices[slots[:, 1]]]


def centres(cells, x, corners):
    return x[cells[:, :corners]].mean(axis=1)


def normals(shape, cells, x, split):
    """From the centre of the - cell to that of the + cell, along the axis of the joint facet."""
    corners = len(basix.topology(shape.type)[0])
    middle = centres(cells, x, corners)
    across = middle[split.plus[:, 0]] - middle[split.minus[:, 0]]
    spread = np.ptp(x[vertices_of(shape, cells, split.minus)], axis=1)  # zero along the normal
    return np.where(spread == 0, np.sign(across), 0)


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_normals_of_planes_follow_the_axes(shape):
    cells, x, joints, _ = case("X", shape)
    split = split_cells(shape, cells, x, joints)
    n = normals(shape, cells, x, split)
    # Joint 0 is x = 2 and joint 1 is y = 2: normals +x and +y by convention.
    np.testing.assert_array_equal(n, np.eye(shape.dim)[split.joint])


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_normals_of_a_bent_joint_agree(shape):
    # The U of the perimetral joint: its mean normal is along y, so that n is +y at the bottom and
    # points into the U on both arms. The joint within has +x.
    cells, x, joints, _ = case("perimetral", shape)
    split = split_cells(shape, cells, x, joints)
    n = normals(shape, cells, x, split)
    place = x[vertices_of(shape, cells, split.minus)].mean(axis=1)
    u = split.joint == 0
    for here, wanted in (
        (u & (place[:, 1] == 1), (1, 1)),
        (u & (place[:, 0] == 1), (0, 1)),
        (u & (place[:, 0] == 3), (0, -1)),
        (~u, (0, 1)),
    ):
        assert np.any(here)
        np.testing.assert_array_equal(
            n[here], np.tile(wanted[1] * np.eye(shape.dim)[wanted[0]], (here.sum(), 1))
        )


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_normals_of_a_ring_point_outwards(shape):
    cells, x, joints, _ = case("ring", shape)
    split = split_cells(shape, cells, x, joints)
    n = normals(shape, cells, x, split)
    place = x[vertices_of(shape, cells, split.minus)].mean(axis=1) - [2, 2, 1][: shape.dim]
    assert np.all(np.einsum("ij,ij->i", n, place) > 0)


def pair_set(shape, cells, x, split):
    """Joint, centre of the facet, centres of the cells on the two sides: numbered by nothing."""
    corners = len(basix.topology(shape.type)[0])
    middle = centres(cells, x, corners)
    rows = np.column_stack(
        [
            split.joint,
            x[vertices_of(shape, cells, split.minus)].mean(axis=1),
            middle[split.minus[:, 0]],
            middle[split.plus[:, 0]],
        ]
    ).round(9)
    return rows[np.lexsort(rows.T[::-1])]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_sides_do_not_depend_on_the_numbering(shape, name):
    cells, x, joints, _ = case(name, shape)
    reference = split_cells(shape, cells, x, joints)
    rng = np.random.default_rng(7)
    for _ in range(3):
        number = rng.permutation(len(x))
        moved = np.empty_like(x)
        moved[number] = x
        shuffled = number[cells][rng.permutation(len(cells))]
        if shape.degree == 1 and shape.name in ("triangle", "tetrahedron"):
            shuffled = rng.permuted(shuffled, axis=1)  # any order of a simplex's vertices will do
        turned = [
            (n, rng.permuted(number[facets], axis=1)[rng.permutation(len(facets))])
            for n, facets in joints
        ]
        split = split_cells(shape, shuffled, moved, turned)
        assert len(split.parent) == len(reference.parent)
        np.testing.assert_array_equal(
            pair_set(shape, shuffled, moved, split), pair_set(shape, cells, x, reference)
        )


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_sides_turn_with_a_scaled_and_shifted_body(shape):
    # The convention is geometric: neither units nor a distant origin change it.
    cells, x, joints, _ = case("perimetral", shape)
    one = split_cells(shape, cells, x, joints)
    two = split_cells(shape, cells, 1e3 * x + 5e4, joints)
    np.testing.assert_array_equal(one.minus, two.minus)
    np.testing.assert_array_equal(one.plus, two.plus)


def test_facets_within_the_front_are_bonded():
    # A square of 2 x 2 cells in the middle of a 4^3 body opens at its centre only. Of its 8
    # triangles, the two cut off at the corners (3, 1) and (1, 3) do not touch the centre.
    shape = CellShape(name="tetrahedron", degree=1)
    cells, x = grid(shape, (4, 4, 4))
    facets = facets_on(shape, cells, x, lambda x, y, z: z == 2 and 1 <= x <= 3 and 1 <= y <= 3)
    with pytest.warns(UserWarning, match="2 facets cannot open because all their vertices"):
        split = split_cells(shape, cells, x, [("a", facets)])
    assert len(facets) == 8
    assert split.bonded.tolist() == [2]
    assert len(split.joint) == 6
    assert len(split.parent) == len(x) + 1


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_facet_on_the_boundary_is_refused(shape):
    cells, x = grid(shape, (4, 4, 2))
    outer = np.sort(cells[:, shape.facet_vertices].reshape(-1, shape.facet_vertices.shape[1]))
    outer = np.unique(outer[np.all(x[outer][:, :, 0] == 0, axis=1)], axis=0)
    with pytest.raises(MeshError) as failure:
        split_cells(shape, cells, x, [("wing", outer[:1])])
    text = str(failure.value)
    assert text.startswith("Joint 'wing': 1 of its facets do not have one cell on each side")
    assert "has 1)" in text
    assert text.endswith("a joint must lie inside the body, between two cells.")


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_facet_in_two_joints_is_refused(shape):
    cells, x = grid(shape, (4, 4, 2))
    facets = facets_on(shape, cells, x, through)
    with pytest.raises(MeshError) as failure:
        split_cells(shape, cells, x, [("a", facets), ("b", facets[:1, ::-1])])
    assert str(failure.value) == "1 facets of the joints 'a' and 'b' are given twice."


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_joint_that_cannot_open_is_refused(shape):
    # One cell side in the middle of a 3 x 3 (x 3) body: all its vertices are on the front.
    cells, x = grid(shape, (3, 3, 3))
    middle = facets_on(
        shape, cells, x, lambda x, y, z: x == 1 and 1 <= y <= 2 and (shape.dim == 2 or 1 <= z <= 2)
    )
    with pytest.raises(MeshError) as failure:
        split_cells(shape, cells, x, [("short", middle)])
    assert str(failure.value) == (
        f"Joint 'short' cannot open: all vertices of its {len(middle)} facets lie on its edge "
        "inside the body; refine the mesh."
    )


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
@pytest.mark.parametrize("distance", [0.0, 0.05])
def test_pairs_of_a_mesh_that_is_split_already(shape, distance):
    split, x = already_split(shape, distance)
    shuffled = np.random.default_rng(1).permutation(len(split.plus))
    slots = {"a-": split.minus, "a+": split.plus[shuffled]}
    found = pair_coincident(shape, split.cells, x, ["a"], slots)
    np.testing.assert_array_equal(found.minus, split.minus)
    np.testing.assert_array_equal(found.plus, split.plus)
    np.testing.assert_array_equal(found.match, split.match)
    np.testing.assert_array_equal(found.cells, split.cells)


def test_faces_that_do_not_match_are_refused():
    shape = CellShape(name="hexahedron", degree=1)
    split, x = already_split(shape)
    with pytest.raises(MeshError, match="Joint 'a': 8 facets on its - face and 7 on its [+] face"):
        pair_coincident(shape, split.cells, x, ["a"], {"a-": split.minus, "a+": split.plus[1:]})
    split, x = already_split(shape, distance=0.5)
    with pytest.raises(MeshError, match="faces do not match one to one"):
        pair_coincident(shape, split.cells, x, ["a"], {"a-": split.minus, "a+": split.plus})
