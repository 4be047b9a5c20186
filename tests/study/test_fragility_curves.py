# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fragility curves from shares and runs of which the right one is known."""

import re

import numpy as np
import pytest
from scipy.stats import binom, norm

from dolfinx_joints.study import fragility, write_csv


def test_exact_shares_give_the_curve_back():
    # The likelihood is largest where every share is the probability: k of ten runs at intensity k.
    shares = np.arange(1, 10) / 10
    intensity = np.repeat(3.0 * np.exp(0.4 * norm.ppf(shares)), 10)
    curve = fragility(intensity, [i < k for k in range(1, 10) for i in range(10)])
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
        ([0, 0, 1], "positive intensities and as many responses; got "),
        # Openings in metres are no fractions of runs.
        (
            [0.001, 0.002, 0.003, 0.004],
            "Without limit, each response must be True or False. Pass limit= for responses.$",
        ),
    ],
)
def test_runs_that_do_not_tell(exceeded, message):
    with pytest.raises(ValueError, match=message):
        fragility([1.0, 2.0, 3.0, 4.0], exceeded)


@pytest.mark.parametrize("response", [[0.001, 0.002, 0.003, 0.004], [0.006, 0.007, 0.008, 0.009]])
def test_limits_that_no_run_or_every_run_exceeds(response):
    which = "no run" if max(response) < 5e-3 else "every run"
    with pytest.raises(ValueError, match=rf"exceeded in {which} \(4 runs\)"):
        fragility([1.0, 2.0, 3.0, 4.0], response, limit=5e-3)


@pytest.mark.parametrize("response", [0.0, 1.0, np.nan])
def test_one_motion_gives_no_curve(response):
    with pytest.raises(ValueError, match="A curve needs runs with and without exceedance"):
        fragility([1.0], [response], limit=0.5)


def test_one_motion_at_many_scales_gives_no_curve():
    with pytest.raises(ValueError, match="in every run above 2 and in no run below"):
        fragility([0.5, 1.0, 2.0, 4.0], [1.0, 2.0, 4.0, 8.0], limit=5.0)


def synthetic(rng, runs):
    """Return intensities and responses that exceed 5 mm with median 3 and dispersion 0.4."""
    intensity = rng.uniform(0.5, 8.0, runs)
    return intensity, 5e-3 * intensity / (3.0 * np.exp(0.4 * rng.standard_normal(runs)))


NAMES = {"response_name": "opening [m]", "intensity_name": "PGA [m/s²]"}


def test_intervals_contain_the_exact_values_as_often_as_they_say():
    """95 % of the bands and intervals of 400 studies of 100 runs contain the exact values.

    The number of hits is binomial; the tolerance is what it exceeds once in 1000 tests, and one
    percent more, because the level is exact for many runs only.
    """
    rng, studies = np.random.default_rng(1992), 400
    at = np.array([2.0, 3.0, 4.5])  # probabilities of 0.16, 0.5 and 0.84
    exact = norm.cdf(np.log(at / 3.0) / 0.4)
    hits = np.zeros(5)
    for _ in range(studies):
        curve = fragility(*synthetic(rng, 100), limit=5e-3)
        (low, high), row = curve.band(at), curve.row()
        median = row["median_low"] <= 3.0 <= row["median_high"]
        dispersion = row["dispersion_low"] <= 0.4 <= row["dispersion_high"]
        hits += [*((low <= exact) & (exact <= high)), median, dispersion]
    lowest, highest = binom.ppf([0.0005, 0.9995], studies, [0.94, 0.96])
    assert np.all((hits >= lowest) & (hits <= highest)), hits


def test_the_band_from_the_information_of_two_shares():
    # Two intensities of n runs: z = norm.ppf(share) has the variance share (1 - share)/(n phi^2).
    intensity = np.repeat([1.0, 2.0], 50)
    curve = fragility(intensity, np.concatenate([np.arange(50) < 10, np.arange(50) < 40]))
    z = norm.ppf(0.2)
    error = np.sqrt(0.16 / 50) / norm.pdf(z)
    low, high = curve.band([1.0])
    assert (low[0], high[0]) == pytest.approx(norm.cdf(z + 1.959964 * error * np.array([-1, 1])))
    # Both medians at which the band contains 0.5 are in the row.
    row = curve.row()
    assert curve.band(row["median_low"])[1] == pytest.approx(0.5, abs=1e-9)
    assert curve.band(row["median_high"])[0] == pytest.approx(0.5, abs=1e-9)
    # ln L of each half is 50 (0.2 ln 0.2 + 0.8 ln 0.8), of a constant 50 ln 0.5.
    entropy = 0.2 * np.log(0.2) + 0.8 * np.log(0.8)
    assert row["pseudo_r2"] == pytest.approx(1.0 - entropy / np.log(0.5), rel=1e-6)


def test_a_median_without_limits():
    # The slope is not significant: the band contains 0.5 at all intensities.
    curve = fragility([1.0, 2.0, 3.0, 4.0], [0, 1, 0, 1])
    row = curve.row()
    assert (row["median_low"], row["median_high"]) == (0.0, np.inf)
    low, high = curve.band(np.geomspace(1e-3, 1e3, 7))
    assert np.all((low < 0.5) & (high > 0.5))


def test_runs_are_counted_and_the_limit_is_stated(tmp_path):
    intensity, response = synthetic(np.random.default_rng(7), 60)
    exceeded = int(np.sum(response > 5e-3))
    response = np.append(response, [np.nan, np.nan])
    curve = fragility([*intensity, 1.0, 2.0], response, limit=5e-3, **NAMES, failed=3)
    row = curve.row()
    assert (row["response"], row["limit"]) == ("opening [m]", 5e-3)
    counts = [row[name] for name in ("runs", "exceeded", "failed", "left_out")]
    assert counts == [60, exceeded, 3, 2]
    # Print and CSV have the same numbers.
    text = repr(curve)
    write_csv({name: np.array([value]) for name, value in row.items()}, tmp_path / "row.csv")
    header, values = (tmp_path / "row.csv").read_text().splitlines()
    assert header.split(",") == list(row)
    assert float(values.split(",")[list(row).index("median")]) == curve.median
    for name, value in row.items():
        number = f"{value:.4g}" if isinstance(value, float) else str(value)
        assert re.search(rf"\n  {name} +{re.escape(number)}(\n|$)", text)
    ax = curve.draw()
    assert ax.get_xlabel() == "PGA [m/s²]"
    assert ax.get_ylabel() == "P(opening > 0.005 m) [-]"
    labels = [entry.get_text() for entry in ax.get_legend().get_texts()]
    fit = f"median {curve.median:.3g}, dispersion {curve.dispersion:.2f}"
    assert labels == [fit, "95 % confidence", f"60 runs, {exceeded} exceeded"]
    (band,) = ax.collections
    x, y = band.get_paths()[0].vertices.T
    assert y[np.isclose(x, x.max())].max() == pytest.approx(float(curve.band(x.max())[1]))


def test_the_figure_says_what_it_is():
    curve = fragility([1.0, 2.0, 3.0, 4.0], [0, 1, 0, 1])
    ax = curve.draw("PGA [m/s²]")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("PGA [m/s²]", "probability of exceedance [-]")
    line, runs = ax.get_lines()
    np.testing.assert_allclose(line.get_ydata(), curve(line.get_xdata()))
    np.testing.assert_array_equal(runs.get_ydata(), [0, 1, 0, 1])
    assert line.get_label() == f"median {curve.median:.3g}, dispersion {curve.dispersion:.2f}"
