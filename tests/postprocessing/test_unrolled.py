# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curved surfaces laid flat."""

import numpy as np
import pytest

from dolfinx_joints.postprocessing.joints.unrolled import unrolled

RADIUS, WIDTH, FACETS = 30.0, 6.0, 8


def valley(turn_deg: float, facets: int = FACETS) -> tuple[np.ndarray, np.ndarray]:
    """Quadrilaterals across a round valley along x, and their normals, which point to its axis."""
    angle = np.radians(np.linspace(-turn_deg, turn_deg, facets + 1))
    y, z = RADIUS * np.sin(angle), -RADIUS * np.cos(angle)
    near, far = (np.stack([x + 0 * y, y, z], axis=1) for x in (0.0, WIDTH))
    corners = np.stack([near[:-1], far[:-1], far[1:], near[1:]], axis=1)
    middle = 0.5 * (angle[1:] + angle[:-1])
    return corners, np.stack([0 * middle, -np.sin(middle), np.cos(middle)], axis=1)


def lengths(corners: np.ndarray) -> np.ndarray:
    """Of the edges and of one diagonal."""
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return np.column_stack([edges, np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1)])


@pytest.mark.parametrize("triangles", [False, True])
def test_a_valley_keeps_its_lengths(triangles: bool) -> None:
    corners, normals = valley(70.0)
    if triangles:
        corners = np.concatenate([corners[:, [0, 1, 2]], corners[:, [2, 3, 0]]])
        normals = np.tile(normals, (2, 1))
    laid = unrolled(corners, normals)
    assert laid is not None
    assert not laid.upright
    np.testing.assert_allclose(lengths(laid.corners), lengths(corners), rtol=1e-9)
    # From the right bank (-y) to the left one over eight chords, upstream (x = 0) above.
    chord = 2.0 * RADIUS * np.sin(np.radians(70.0) / FACETS)
    expected = np.stack(
        [(np.arcsin(corners[..., 1] / RADIUS) / np.radians(140.0) + 0.5) * FACETS * chord,
         WIDTH - corners[..., 0]],
        axis=-1,
    )  # fmt: skip
    np.testing.assert_allclose(laid.corners, expected, atol=1e-8)


def test_the_side_of_the_normals_does_not_matter() -> None:
    corners, normals = valley(70.0)
    one, other = unrolled(corners, normals), unrolled(corners, -normals)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.corners, other.corners, atol=1e-9)


def test_a_bent_wall_stands_upright() -> None:
    # The valley turned until its axis is upright: y downstream, x upwards.
    corners, normals = valley(40.0)
    turned = [corners[..., [1, 2, 0]], normals[:, [1, 2, 0]]]
    laid = unrolled(*turned)
    assert laid is not None
    assert laid.upright
    np.testing.assert_allclose(laid.corners[..., 1], turned[0][..., 2], atol=1e-8)
    assert np.all(np.diff(laid.corners[:, 0, 0]) > 0.0)  # downstream to the right


def test_what_cannot_be_laid_flat_is_none() -> None:
    ring = valley(180.0, 12)
    assert unrolled(*ring) is None
    parts = [np.concatenate(both) for both in zip(valley(20.0), valley(20.0), strict=True)]
    parts[0][FACETS:, :, 0] += 2.0 * WIDTH
    assert unrolled(*parts) is None
