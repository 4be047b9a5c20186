# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Principal stresses, directions in a surface and running extremes."""

import numpy as np
import pytest

from dolfinx_joints.postprocessing.envelopes import (
    Envelopes,
    face_directions,
    principal_extremes,
    stress_along,
)


def six(tensors: np.ndarray) -> np.ndarray:
    """Rows (xx, yy, zz, xy, yz, xz) of tensors, shape (n, 3, 3)."""
    return tensors[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]


def turns(count: int) -> np.ndarray:
    """Rotations, shape (n, 3, 3)."""
    q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(count, 3, 3)))
    return q * np.sign(np.linalg.det(q))[:, None, None]


def test_principal_stresses_do_not_turn() -> None:
    # R diag(5, -1, -7) R^T has the principal stresses it was made of.
    q = turns(50)
    tensors = q @ np.diag([-1.0, 5.0, -7.0]) @ q.transpose(0, 2, 1)
    largest, smallest = principal_extremes(six(tensors))
    np.testing.assert_allclose(largest, 5.0)
    np.testing.assert_allclose(smallest, -7.0)


def test_stress_along_a_direction_turns_with_it() -> None:
    q = turns(50)
    tensor = np.array([[1.0, 2.0, -3.0], [2.0, -4.0, 5.0], [-3.0, 5.0, 6.0]])
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    expected = direction @ tensor @ direction
    turned = stress_along(six(q @ tensor @ q.transpose(0, 2, 1)), q @ direction)
    np.testing.assert_allclose(turned, expected)


def strip(outline: np.ndarray, rise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and facets between an open outline (n, 3) and the same moved by ``rise``."""
    count = len(outline)
    low = np.arange(count - 1)
    facets = np.stack([low, low + 1, low + 1 + count, low + count], axis=1)
    return np.concatenate([outline, outline + rise]), facets


def test_directions_on_an_inclined_plane() -> None:
    # Through y and up a slope of 4 in 3: the arch runs along y, the cantilever up the slope.
    nodes, facets = strip(np.array([[0.0, y, 0.0] for y in (0, 1, 3)]), np.array([3.0, 0.0, 4.0]))
    facets[1] = facets[1, ::-1]  # listed from the other side
    arch, cantilever = face_directions(nodes, facets)
    np.testing.assert_allclose(arch, np.tile([0.0, 1.0, 0.0], (6, 1)), atol=1e-15)
    np.testing.assert_allclose(cantilever, np.tile([0.6, 0.0, 0.8], (6, 1)), atol=1e-15)


@pytest.mark.parametrize("split", [False, True])
def test_directions_on_a_cylinder(split: bool) -> None:
    # Arches run around it, cantilevers straight up; 20 facets over 100 degrees, in the middle of
    # which the mean of two normals is the radius.
    angle = np.deg2rad(np.linspace(-50.0, 50.0, 21))
    outline = np.stack([-np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    nodes, facets = strip(outline, np.array([0.0, 0.0, 0.3]))
    if split:
        facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
    arch, cantilever = face_directions(nodes, facets)
    tangent = np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    slack = np.deg2rad(2.6)  # half a facet, at the ends
    assert np.all(np.einsum("ij,ij->i", arch, np.tile(tangent, (2, 1))) > np.cos(slack))
    np.testing.assert_allclose(cantilever, np.tile([0.0, 0.0, 1.0], (42, 1)), atol=1e-12)
    if not split:
        np.testing.assert_allclose(arch[1:20], tangent[1:20], atol=1e-12)


def test_no_directions_on_top_and_at_vertical_edges() -> None:
    # A unit cube without its bottom: the corners are edges of side faces, the middle of the top has
    # nothing steep around it, and the middle of a side's upper rim has that side alone.
    nodes = [[x, y, z] for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    sides = [[0, 1, 5, 8, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    quads = [[0, 1, 5, 4], *sides[1:], [4, 8, 9, 9], [8, 5, 9, 9], [0, 1, 8, 8]]
    nodes += [[0.5, 0.0, 1.0], [0.5, 0.5, 1.0]]
    arch, cantilever = face_directions(nodes, quads)
    assert np.isnan(arch[:8]).all()
    assert np.isnan(arch[9]).all()
    np.testing.assert_allclose(arch[8], [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(cantilever[8], [0.0, 0.0, 1.0], atol=1e-15)
    assert np.isnan(stress_along(np.ones((10, 6)), arch)[9])


def test_envelopes_keep_the_extremes_of_each_point() -> None:
    along_y, up = np.array([[0.0, 1.0, 0.0]] * 2), np.array([[0.0, 0.0, 1.0]] * 2)
    up[1] = np.nan
    seen = Envelopes(along_y, up)
    rows = np.zeros((2, 2, 6))
    rows[0, :, :3] = [[1.0, 2.0, 3.0], [0.0, -5.0, 0.0]]
    rows[1, :, :3] = [[-4.0, 1.0, -2.0], [7.0, 6.0, 0.0]]
    for row in rows:
        seen.see(row)
    expected = [[3.0, -4.0, 2.0, 1.0, 3.0, -2.0], [7.0, -5.0, 6.0, -5.0, np.nan, np.nan]]
    np.testing.assert_allclose(seen.columns, expected)
