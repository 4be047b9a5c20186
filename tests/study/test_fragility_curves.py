# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fragility curves from shares and runs of which the right one is known."""

import numpy as np
import pytest
from scipy.stats import norm

from dolfinx_joints.study import fragility


def test_exact_shares_give_the_curve_back():
    # The likelihood is largest where every share is the probability.
    intensity = np.linspace(0.5, 8.0, 12)
    curve = fragility(intensity, norm.cdf(np.log(intensity / 3.0) / 0.4))
    assert curve.median == pytest.approx(3.0, rel=1e-6)
    assert curve.dispersion == pytest.approx(0.4, rel=1e-5)
    np.testing.assert_allclose(curve(3.0), 0.5, atol=1e-6)


def test_many_runs_come_near_it_whatever_the_unit():
    rng = np.random.default_rng(1992)
    intensity = rng.uniform(0.5, 8.0, 4000)
    exceeded = rng.uniform(size=4000) < norm.cdf(np.log(intensity / 3.0) / 0.4)
    curve, other = (fragility(f * intensity, exceeded) for f in (1.0, 981.0))
    assert curve.median == pytest.approx(3.0, rel=0.02)
    assert curve.dispersion == pytest.approx(0.4, rel=0.1)
    assert other.median == pytest.approx(981.0 * curve.median, rel=1e-6)
    assert other.dispersion == pytest.approx(curve.dispersion, rel=1e-6)


@pytest.mark.parametrize("counts", [(3, 5, 2, 3), (2, 3, 5, 7), (2, 4, 3, 4), (49, 100, 50, 100)])
def test_two_intensities_have_the_shares_of_their_runs(counts):
    # As many parameters as shares: the curve goes through both, however flat it is.
    yes, runs, more, others = counts
    intensity = np.repeat([1.0, 2.0], [runs, others])
    exceeded = np.concatenate([np.arange(runs) < yes, np.arange(others) < more])
    z = norm.ppf([yes / runs, more / others])
    curve = fragility(intensity, exceeded)
    assert curve.dispersion == pytest.approx(np.log(2.0) / (z[1] - z[0]), rel=1e-5)
    np.testing.assert_allclose(curve(np.array([1.0, 2.0])), norm.cdf(z), atol=1e-6)


@pytest.mark.parametrize(
    ("exceeded", "message"),
    [
        ([0, 0, 0, 0], "in no run"),
        ([1, 1, 1, 1], "in every run"),
        ([0, 0, 1, 1], "in every run above 2 and in no run below"),
        # The mean logarithm where it is exceeded is lower: ln 4 / 2 and ln 6 / 2.
        ([1, 0, 0, 1], "not exceeded more often at higher intensities"),
        ([0, 0, 1], "as many fractions from 0 to 1"),
    ],
)
def test_runs_that_do_not_tell(exceeded, message):
    with pytest.raises(ValueError, match=message):
        fragility([1.0, 2.0, 3.0, 4.0], exceeded)


def test_the_figure_says_what_it_is():
    curve = fragility([1.0, 2.0, 3.0, 4.0], [0, 1, 0, 1])
    ax = curve.draw("PGA [m/s²]")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("PGA [m/s²]", "probability of exceedance [-]")
    line, runs = ax.get_lines()
    np.testing.assert_allclose(line.get_ydata(), curve(line.get_xdata()))
    np.testing.assert_array_equal(runs.get_ydata(), [0, 1, 0, 1])
    assert line.get_label() == f"median {curve.median:.3g}, dispersion {curve.dispersion:.2f}"
