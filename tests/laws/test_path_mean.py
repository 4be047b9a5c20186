# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mean traction over the path of a step: work, kinks, short steps, derivative, order."""

from __future__ import annotations

import numpy as np
import pytest
from tangent_errors import central_differences

from dolfinx_joints.laws.path_mean import path_mean

SHIFT = 0.3  # a second kink, of the shear traction


def energy(gap):
    """Contact that is 100 times stiffer in pressure, exponential in tension; keys with play."""
    n, s, play = gap[:, 0], gap[:, 1], np.maximum(gap[:, 2] - SHIFT, 0.0)
    adhesive = 1.0 - (1.0 + n) * np.exp(-n - s**2)
    return np.where(n < 0.0, 1.0 - np.exp(-(s**2)) + 50.0 * n**2, adhesive) + 0.5 * play**2


def tractions(gap):
    n, s, play = gap[:, 0], gap[:, 1], np.maximum(gap[:, 2] - SHIFT, 0.0)
    open_ = np.maximum(n, 0.0)
    bell = np.exp(-open_ - s**2)
    t = np.column_stack(
        [np.where(n < 0.0, 100.0 * n, open_ * bell), 2.0 * s * (1.0 + open_) * bell, play]
    )
    d = np.zeros((len(gap), 3, 3))
    d[:, 0, 0] = np.where(n < 0.0, 100.0, (1.0 - open_) * bell)
    d[:, 0, 1] = d[:, 1, 0] = -2.0 * s * open_ * bell
    d[:, 1, 1] = (2.0 - 4.0 * s**2) * (1.0 + open_) * bell
    d[:, 2, 2] = play > 0.0
    return t, d


def paths(length, count=2000):
    rng = np.random.default_rng(3)
    before = rng.normal(size=(count, 3))
    return before, before + length * rng.normal(size=(count, 3))


@pytest.mark.parametrize("length", [1.0, 0.1, 1e-3])
def test_work_is_the_change_of_the_energy(length):
    """Whatever kinks are crossed; energies are up to 1e3, and what is subtracted rounds."""
    before, after = paths(length)
    mean, _ = path_mean(tractions, before, after)
    work = np.einsum("ij,ij->i", mean, after - before)
    missing = np.abs(work - (energy(after) - energy(before)))
    scale = np.abs(mean).sum(axis=1) * np.abs(after - before).sum(axis=1)
    assert np.all(missing < 1e-12 * (energy(before) + energy(after) + scale))


def test_short_steps_lose_no_digits():
    """The mean of a step of 1e-9 is the traction in its middle to (1e-9)^2, but across kinks."""
    before, after = paths(1e-9)
    crosses = (before > [0.0, np.inf, SHIFT]) != (after > [0.0, np.inf, SHIFT])
    assert not crosses.any()
    mean, _ = path_mean(tractions, before, after)
    middle, _ = tractions(0.5 * (before + after))
    np.testing.assert_allclose(mean, middle, rtol=0, atol=1e-15 * np.abs(middle).max())


def test_a_step_taken_backwards_has_the_same_mean():
    before, after = paths(1.0)
    forth, back = path_mean(tractions, before, after)[0], path_mean(tractions, after, before)[0]
    np.testing.assert_allclose(forth, back, rtol=0, atol=1e-12)


@pytest.mark.parametrize("length", [1.0, 1e-3])
def test_derivative(length):
    """Against central differences, h^2 / 6 times third derivatives and rounding over h."""
    before, after = paths(length)
    _, tangent = path_mean(tractions, before, after)
    h = 1e-5 * length
    slopes = central_differences(lambda end: path_mean(tractions, before, end)[0], after, h)
    error = np.abs(slopes - tangent).max(axis=(1, 2))
    # At ends within h of a kink differences see it.
    away = np.minimum(np.abs(after[:, 0]), np.abs(after[:, 2] - SHIFT)) > 2.0 * h
    assert away.mean() > 0.99
    assert error[away].max() < 1e-7 * np.abs(tangent).max() / min(length, 0.1)
    np.testing.assert_allclose(tangent, tangent.transpose(0, 2, 1), rtol=0, atol=1e-12)


def test_no_step_gives_the_traction():
    before, _ = paths(1.0)
    mean, tangent = path_mean(tractions, before, before)
    t, d = tractions(before)
    np.testing.assert_allclose(mean, t, rtol=1e-14)
    np.testing.assert_allclose(tangent, 0.5 * d, rtol=1e-14)


def test_rounding_errors_of_the_traction_are_no_kinks():
    """Traction with noise of a thousandth: the search around it ends."""
    rng = np.random.default_rng(0)
    calls = []

    def noisy(gap):
        calls.append(len(gap))
        t, d = tractions(gap)
        return t * (1.0 + 1e-3 * rng.normal(size=t.shape)), d

    before, after = paths(1.0, count=10)
    assert np.isfinite(path_mean(noisy, before, after)[0]).all()
    assert sum(calls) < 10 * 8 * 64 * 40
