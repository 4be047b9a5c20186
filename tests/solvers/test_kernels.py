# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What numba makes of the kernels is what their text says: the interpreter gets the same numbers.

Compiled sums may be in another order, so that the two differ by rounding: some 1e-16 of the largest
number for each of at most some hundred terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mpi4py")
pytest.importorskip("numba")

from mpi4py import MPI

from plates import compressed, kernel, plates

from dolfinx_joints.laws.friction import LOOPS
from dolfinx_joints.laws.law import BACKWARD_EULER, DISCRETE_GRADIENT, JointState, Rule
from dolfinx_joints.laws.points.discrete_gradient import stored_by, whole_step_from
from dolfinx_joints.laws.points.return_mapping import Coulomb, Start, empty_answer
from dolfinx_joints.solvers.compliance import blocks_between_ranks
from dolfinx_joints.solvers.compliance import low_rank as lowrank
from dolfinx_joints.solvers.compliance import row_matrix as row_matrices
from dolfinx_joints.solvers.compliance.blocks_between_ranks import DENSE, FACTOR, PLACE
from dolfinx_joints.solvers.compliance.ranked_low_rank import Shares
from dolfinx_joints.solvers.interface import joint_step, krylov_corrections

RANDOM = np.random.default_rng(20)
ROUNDING = 1e-13


@contextmanager
def interpreted(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> Iterator[None]:
    """Let the interpreter run the kernels of a module; compiled ones divide by zero in silence."""
    kernels = {name: k for name, k in vars(module).items() if hasattr(k, "py_func")}
    assert kernels
    with monkeypatch.context() as patch, np.errstate(all="ignore"):
        for name, compiled in kernels.items():
            patch.setattr(module, name, compiled.py_func)
        yield


def check_same(compiled: Any, written: Any) -> None:
    """Compare arrays to rounding of the largest finite number in them; the others are equal."""
    compiled, written = np.asarray(compiled), np.asarray(written)
    assert compiled.dtype == written.dtype
    size = np.abs(compiled[np.isfinite(compiled)]).max(initial=0.0)
    np.testing.assert_allclose(compiled, written, rtol=ROUNDING, atol=ROUNDING * size)


def check(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, work: Callable[[], tuple[Any, ...]]
) -> tuple[Any, ...]:
    """The arrays that ``work`` gives, which both ways are the same."""
    compiled = work()
    with interpreted(monkeypatch, module):
        written = work()
    for one, other in zip(compiled, written, strict=True):
        check_same(one, other)
    return compiled


@pytest.mark.parametrize("symmetric", [True, False])
def test_low_rank_products(monkeypatch, symmetric):
    # Of a block and its mirror image one is kept, or each for itself.
    points, joint = plates(across=6)
    matrix = kernel(points, joint, symmetric=symmetric)
    small = compressed(matrix, points, leaf=6, tolerance=1e-3, symmetric=symmetric)
    vector = RANDOM.normal(size=3 * len(points))
    ranks = small.blocks[:, 4]
    assert ranks.min() < 0 < ranks.max()  # blocks of both kinds
    assert small.blocks[:, 5].any() == symmetric
    vectors = [vector, np.ones_like(vector)]
    one, *several = check(
        monkeypatch, lowrank, lambda: (small.product(vector), *small.products(vectors))
    )
    check_same(several[0], one)
    check_same(several[1], small.product(vectors[1]))


def test_products_between_ranks(monkeypatch):
    # 12 unknowns: a factor of the first six, two dense blocks of one panel, the places of three.
    factor, dense = RANDOM.normal(size=(2, 6)), RANDOM.normal(size=(2, 3, 6))
    shares = Shares(np.float64)
    shares.add(0, 6, factor, FACTOR, 0)
    shares.add(3, 6, dense[0], DENSE, 0)
    shares.add(0, 6, dense[1], DENSE, 0)
    shares.add(9, 3, None, PLACE, 1)
    matrix = np.zeros((8, 12))
    matrix[:2, :6], matrix[2:5, 3:9], matrix[5:, 9:] = factor, dense[0], np.eye(3)
    matrix[2:5, :6] += dense[1]
    x, values = RANDOM.normal(size=12), RANDOM.normal(size=8)

    def work():
        reduced, expanded = np.zeros(shares.length), np.ones(12)
        blocks_between_ranks.reduce(*shares.arrays, x, reduced, True)
        blocks_between_ranks.expand(*shares.arrays, values, expanded)
        return reduced, expanded

    def in_one_pass():
        """As `reduce` and `expand`, dense blocks read once."""
        gone, once, back = np.zeros(shares.length), np.ones(12), np.zeros(shares.length)
        blocks_between_ranks.reduce(*shares.arrays, x, gone, False)
        blocks_between_ranks.expand_and_return(*shares.arrays, values, x, once, back)
        blocks_between_ranks.add_at_places(shares.arrays[0], values, once)
        return gone + back, once

    for kernels in (work, in_one_pass):
        reduced, expanded = check(monkeypatch, blocks_between_ranks, kernels)
        np.testing.assert_allclose(reduced, matrix @ x, atol=1e-14)
        np.testing.assert_allclose(expanded, 1.0 + matrix.T @ values, atol=1e-14)


@pytest.mark.parametrize("count", [0, 1, 4, 7])
def test_products_with_few_rows(monkeypatch, count):
    whole = RANDOM.normal(size=(9, 9))
    matrix = row_matrices.RowMatrix.of(whole + whole.T, MPI.COMM_SELF, 9)
    rows = np.sort(RANDOM.permutation(9)[:count])
    values = np.zeros(9)
    values[rows] = RANDOM.normal(size=count)

    def work():
        return matrix.product(values, rows), matrix.block(rows).product(values[rows])

    product, part = check(monkeypatch, row_matrices, work)
    np.testing.assert_allclose(product, (whole + whole.T) @ values, atol=1e-12)
    np.testing.assert_allclose(part, product[rows], atol=1e-12)


def test_blocks_of_points(monkeypatch):
    tangent, values = RANDOM.normal(size=(5, 3, 3)), RANDOM.normal(size=15)
    module = krylov_corrections
    (turned,) = check(monkeypatch, module, lambda: (module._turned(tangent, values),))
    np.testing.assert_allclose(
        turned, np.einsum("nij,nj->ni", tangent, values.reshape(5, 3)).ravel()
    )


def test_scaled_residuals(monkeypatch):
    force, coupled, scale, areas = RANDOM.normal(size=12), *RANDOM.random((3, 12))
    carried, tangent = RANDOM.normal(size=(4, 3)), RANDOM.normal(size=(4, 3, 3))
    root = np.where(np.isin(np.arange(12), [5, 9, 10, 11]), 0.0, areas * scale)  # dead directions
    scale[root == 0.0] = 0.0
    given = (force, coupled, 2.0 * carried, carried, tangent, scale, root)
    residual, scaled, sizes = check(monkeypatch, joint_step, lambda: joint_step._residual(*given))
    assert not residual[root == 0.0].any()
    assert not scaled[3].any()
    assert residual[0] == pytest.approx(force[0] - root[0] * carried[0, 0])
    assert scaled[1, 0, 1] == pytest.approx(root[3] * tangent[1, 0, 1] * scale[4])
    largest = np.abs(2.0 * root * carried.ravel()).max()
    expected = [largest, *(np.abs(each).max() for each in (residual, force, coupled))]
    np.testing.assert_allclose(sizes[:4], expected)
    assert sizes[4] == pytest.approx(residual @ residual)


# Gaps of the points before a step and after it if nothing were carried, of every kind: they stay
# open or closed, open, close, touch, and start and end at zero.
STARTS = np.array([-1.0, -1.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, -1.0, -1.0])
ENDS = np.array([-3.0, 1.0, 0.0, -2.0, 1.0, 0.0, 2.0, -2.0, 0.0, -1.2, 5.0])


def gaps() -> tuple[np.ndarray, np.ndarray]:
    """Gaps before and free gaps after, with little slip and with much, shape (22, 3), [um]."""
    slip = np.outer(np.repeat([0.01, 3.0], len(STARTS)), [1.0, -0.5])
    before = np.column_stack([np.tile(STARTS, 2), 0.0 * slip])
    after = np.column_stack([np.tile(ENDS, 2), slip])
    return before, after


def check_loop(rule: Rule, trial_gap: np.ndarray, compliance: Any, start: Start) -> None:
    """Compare the answers of the compiled loop and of its text."""
    loop = LOOPS[rule.name]
    compiled, written = (empty_answer(trial_gap, start.history) for _ in range(2))
    loop(np.array(compliance), start, compiled)
    with np.errstate(all="ignore"):  # compiled loops divide by zero in silence
        loop.py_func(np.array(compliance), start, written)
    for one, other in zip(compiled, written, strict=True):
        check_same(one, other)


@pytest.mark.parametrize("compliance", [[[0.0, 0.0]], [[0.7, 0.4]], [[1.0, 0.0]]])
@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("rigid", [False, True])
def test_whole_steps(compliance, mu, rigid):
    before, after = gaps()
    normal, shear = (0.0, 0.0) if rigid else (1.0, 2.5)
    if rigid:
        before[:, 0] = np.abs(before[:, 0])  # what is rigid does not overlap
    state = JointState(gap=before, elastic_slip=np.full((len(before), 2), 0.1))
    stored = stored_by(state, 1.0, 0.4)
    start = whole_step_from(state, stored, Coulomb(normal, shear, 2.5, mu))
    check_loop(DISCRETE_GRADIENT, after, compliance, start)


@pytest.mark.parametrize("compliance", [[[0.0, 0.0]], [[0.7, 0.4]], [[1.0, 0.0]]])
@pytest.mark.parametrize(("normal", "shear"), [(1.0, 2.5), (0.0, 0.0), (1.0, np.inf)])
def test_ends_of_steps(compliance, normal, shear):
    before, after = gaps()
    slip, laws = np.full((len(before), 2), 0.1), np.array([Coulomb(normal, shear, 2.5, 0.6)])
    check_loop(BACKWARD_EULER, after, compliance, Start(before, slip, laws))
