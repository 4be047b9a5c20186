# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's corrections of the joint forces against dense solves of (I + T S) d = r."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")
pytest.importorskip("scipy")

from joint_tangents import (
    POINTS,
    WholeCorrections,
    right_side,
    row_matrix,
    scaled_compliance,
    states,
    stuck_tangent,
    tangents,
)

from dolfinx_joints.solvers import limits
from dolfinx_joints.solvers.compliance.row_matrix import RowMatrix
from dolfinx_joints.solvers.interface import corrections

pytestmark = pytest.mark.mpi

EXACT = 1e-13  # asked for where solutions are compared to rounding


def whole(blocks: np.ndarray) -> np.ndarray:
    """The block diagonal as a matrix."""
    matrix = np.zeros((3 * POINTS, 3 * POINTS))
    for i, block in enumerate(blocks):
        matrix[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    return matrix


KINDS = ("open", "one closed", "mostly open", "mixed", "mostly stuck", "stuck", "sliding")


@dataclass
class Unwanted:
    """S of which a route must not take blocks or the whole."""

    matrix: RowMatrix

    @property
    def size(self) -> int:
        return self.matrix.size

    @property
    def local(self) -> int:
        return self.matrix.local

    def product(self, values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return self.matrix.product(values, rows)


@pytest.fixture(params=["active", "complement", "krylov"])
def route(request, monkeypatch):
    """Which of the two sets, or PETSc's GMRES; the second set is made at once."""
    monkeypatch.setattr(limits, "COMPLEMENT_COST", 0.0)
    return request.param


def solver(comm, s, stuck, route):
    known = stuck if route == "complement" else None
    return WholeCorrections(row_matrix(s, comm), known, comm, krylov=route == "krylov")


def check(found, s, blocks, r, route, *, tolerance=0.0):
    """Compare with (I + T S) d = r and S d; compiled corrections are in single precision.

    The complement's tolerance is relative to W r at its points; |E| and |W| are of the order one.
    """
    finest = 1e-12 if route == "krylov" else limits.FINEST_SINGLE
    left = r - found.step - whole(blocks) @ (s @ found.step)
    factor = 3.0 if route == "complement" else 1.1
    assert np.linalg.norm(left) <= factor * max(tolerance, finest) * np.linalg.norm(r)
    size = np.abs(found.step).max(initial=0.0)
    error = np.abs(found.coupled - s @ found.step).max()
    assert error <= found.error + 1e-12 * size


@pytest.mark.parametrize("which", ["all", "few"])
@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e6, np.inf])
@pytest.mark.parametrize("kind", KINDS)
def test_the_dense_solution(comm, route, kind, stiffness, which):
    s, stuck = scaled_compliance(), stuck_tangent(stiffness)
    blocks, r = tangents(states(kind), stuck), right_side(which)
    found = solver(comm, s, stuck, route).solve(r, blocks, EXACT)
    check(found, s, blocks, r, route)


@pytest.mark.parametrize("kind", KINDS)
def test_frictionless_joints(comm, route, kind):
    # T0 and T are zero along the joint: nothing slides there, all of it is "free".
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    stuck[:, 1:] = 0.0
    status = np.minimum(states(kind), 1)
    blocks, r = tangents(status, stuck), right_side()
    check(solver(comm, s, stuck, route).solve(r, blocks, EXACT), s, blocks, r, route)


@pytest.mark.parametrize("kind", KINDS)
def test_dead_directions(comm, route, kind):
    # The third of all points, as in a plane, and all of some points, as at a clamped edge.
    dead = np.zeros((POINTS, 3), dtype=bool)
    dead[:, 2] = dead[::7] = True
    s, stuck = scaled_compliance(dead=dead), stuck_tangent(1e3)
    stuck[dead] = 0.0
    blocks = tangents(states(kind), stuck_tangent(1e3))
    blocks[dead] = 0.0
    blocks.transpose(0, 2, 1)[dead] = 0.0
    r = np.where(dead.ravel(), 0.0, right_side())
    found = solver(comm, s, stuck, route).solve(r, blocks, EXACT)
    check(found, s, blocks, r, route)
    assert not found.step[dead.ravel()].any()


def test_points_that_are_all_open_are_corrected_exactly(comm):
    s, stuck = scaled_compliance(), stuck_tangent(1e6)
    blocks, r = np.zeros((POINTS, 3, 3)), right_side()
    found = solver(comm, s, stuck, "active").solve(r, blocks, EXACT)
    np.testing.assert_array_equal(found.step, r)


def test_nothing_to_correct(comm, route):
    s, stuck = scaled_compliance(), stuck_tangent(1.0)
    blocks = tangents(states("mixed"), stuck)
    found = solver(comm, s, stuck, route).solve(np.zeros(3 * POINTS), blocks, EXACT)
    np.testing.assert_array_equal(found.step, np.zeros(3 * POINTS))
    np.testing.assert_array_equal(found.coupled, np.zeros(3 * POINTS))


def test_what_is_kept_between_solves_does_not_matter(comm, route):
    # Sets grow, shrink, move to the other half and vanish; each solve against its dense one.
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    one = solver(comm, s, stuck, route)
    rng = np.random.default_rng(9)
    kinds = ("mostly open", "mixed", "mostly open", "one closed", "stuck", "open", "sliding")
    for turn, kind in enumerate(3 * kinds):
        status = rng.permutation(states(kind, seed=turn))
        blocks, r = tangents(status, stuck, seed=turn), right_side(seed=turn)
        if turn % 2:
            r[60:] = 0.0
        check(one.solve(r, blocks, EXACT), s, blocks, r, route)


def test_the_complement_is_made_once_it_pays(comm, monkeypatch):
    # All points stick: 15 products of 120^2 each time, against 2.3 x 120^3 operations. The answer
    # is the same before and after.
    made, tied = [], corrections._complement_of
    monkeypatch.setattr(
        corrections, "_complement_of", lambda *given: (made.append(1), tied(*given))[1]
    )
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    one = WholeCorrections(row_matrix(s, comm), stuck, comm)
    blocks, r = tangents(states("stuck"), stuck), right_side()
    seen = []
    for _ in range(4):
        check(one.solve(r, blocks, EXACT), s, blocks, r, "complement")
        seen.append(len(made))
    assert (seen[0], seen[-1]) == (0, 1)


def test_the_complement_is_not_made_for_open_joints(comm, monkeypatch):
    # One point of forty is closed: the small system is far cheaper, however much W would save.
    monkeypatch.setattr(limits, "COMPLEMENT_COST", 0.0)
    monkeypatch.setattr(corrections, "_complement_of", None)
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    one = WholeCorrections(row_matrix(s, comm), stuck, comm)
    blocks, r = tangents(states("one closed"), stuck), right_side("few")
    check(one.solve(r, blocks, EXACT), s, blocks, r, "active")


@pytest.mark.parametrize("krylov", [True, False])
def test_rigid_points_that_cannot_move_apart_from_each_other(comm, monkeypatch, krylov):
    """I + T0 S = G with two rows alike, as where three rigid joints meet: no W, yet an answer.

    It is one to every right-hand side in the range of G, to the damping of 1e-8 and what single
    precision leaves.
    """
    monkeypatch.setattr(limits, "COMPLEMENT_COST", 0.0)
    s, stuck = scaled_compliance(), np.ones((POINTS, 3))
    g = s + np.eye(3 * POINTS)
    g[3:6], g[:, 3:6] = g[:3], g[:, :3]
    g[3:6, 3:6] = g[:3, :3]
    split = row_matrix(g - np.eye(3 * POINTS), comm)
    one = WholeCorrections(split, stuck, comm, krylov=krylov, rigid=True)
    blocks, r = tangents(states("stuck"), stuck), g @ right_side()
    for _ in range(3):
        found = one.solve(r, blocks, EXACT)
        error = 1e-6 if krylov else 1e-4
        np.testing.assert_allclose(g @ found.step, r, rtol=0, atol=error * np.abs(r).max())


@pytest.mark.parametrize("tolerance", [0.03, 1e-4, 1e-8])
@pytest.mark.parametrize("kind", ["mixed", "sliding"])
def test_the_residual_is_within_the_tolerance(comm, route, kind, tolerance):
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    blocks, r = tangents(states(kind), stuck), right_side()
    found = solver(comm, s, stuck, route).solve(r, blocks, tolerance)
    check(found, s, blocks, r, route, tolerance=tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_a_rough_matrix_inside(comm, kind):
    """Errors of 1e-4 in S and 1e-3 of the iteration: what is left is of that size, S d is exact.

    The fine S is not kept in rows here, and gives products only.
    """
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    noise = np.random.default_rng(7).normal(size=s.shape)
    noise += noise.T
    rough = s + 1e-4 / np.linalg.norm(noise, 2) * noise
    blocks, r = tangents(states(kind), stuck), right_side()
    fine = Unwanted(row_matrix(s, comm))
    one = WholeCorrections(fine, None, comm, krylov=True, rough=row_matrix(rough, comm))
    found = one.solve(r, blocks, EXACT)
    left = r - found.step - whole(blocks) @ (s @ found.step)
    assert np.linalg.norm(left) <= 1.2e-3 * np.linalg.norm(r)
    np.testing.assert_allclose(found.coupled, s @ found.step, rtol=0, atol=1e-12)


def test_corrections_with_a_rough_matrix_converge(comm):
    # Each leaves a thousandth: four of them solve to 1e-11.
    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    noise = np.random.default_rng(7).normal(size=s.shape)
    noise += noise.T
    rough = s + 1e-4 / np.linalg.norm(noise, 2) * noise
    blocks, r = tangents(states("mixed"), stuck), right_side()
    one = WholeCorrections(
        Unwanted(row_matrix(s, comm)), None, comm, krylov=True, rough=row_matrix(rough, comm)
    )
    total, left = np.zeros_like(r), r
    for _ in range(4):
        total = total + one.solve(left, blocks, EXACT).step
        left = r - total - whole(blocks) @ (s @ total)
    assert np.linalg.norm(left) <= 1e-11 * np.linalg.norm(r)


@pytest.mark.parametrize("owner", [None, 0, -1])
def test_results_do_not_depend_on_the_ranks(comm, route, owner):
    """Points in equal parts, or all on the first or the last rank."""
    from mpi4py import MPI

    s, stuck = scaled_compliance(), stuck_tangent(1e3)
    blocks, r = tangents(states("mixed"), stuck), right_side()
    local = None if owner is None else len(s) * (comm.rank == owner % comm.size)
    known = stuck if route == "complement" else None
    krylov = route == "krylov"
    spread = WholeCorrections(row_matrix(s, comm, local), known, comm, krylov=krylov)
    alone = solver(MPI.COMM_SELF, s, stuck, route)
    found, expected = (one.solve(r, blocks, EXACT) for one in (spread, alone))
    error = (1e-11 if krylov else 1e-4) * np.abs(expected.step).max()
    np.testing.assert_allclose(found.step, expected.step, rtol=0, atol=error)
    np.testing.assert_allclose(found.coupled, expected.coupled, rtol=0, atol=error)
