# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matching to a response spectrum: what must stay, what must be reached, what is refused."""

import re
from typing import Any

import numpy as np
import pytest

from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.motion import Motion, synthetic_motion
from dolfinx_joints.motions.spectra import response_history, response_spectrum
from dolfinx_joints.motions.spectrum_matching import match_spectrum

RECORD = synthetic_motion(seed=2, duration=12.0, dt=0.005, band=(0.3, 8.0))
STEPS = np.geomspace(0.05, 2.0, 372)  # neighbours 1 % apart: nothing is filled in between


def eurocode(periods: np.ndarray) -> np.ndarray:
    """Elastic spectrum of EN 1998-1, 3.2.2.2, type 1 on ground B, 5 % damping, a_g 2.5 m/s^2."""
    shape = np.select(
        [periods <= 0.15, periods <= 0.5], [1 + 1.5 * periods / 0.15, 2.5], 2.5 * 0.5 / periods
    )
    return np.asarray(2.5 * 1.2 * shape)


def spectrum(motion: Motion, periods: np.ndarray, column: int) -> np.ndarray:
    """Pseudo-acceleration of one component [m/s^2]."""
    values = motion.acceleration[:, column]
    return np.asarray(response_spectrum(values, motion.dt, periods, 0.05).pseudo_acceleration)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_its_own_spectrum_only_scales_a_record(factor: float) -> None:
    # The whole motion is linear: a spectrum k times its own asks for k times the motion.
    own = spectrum(RECORD, STEPS, 1)
    match = match_spectrum(RECORD, (STEPS, factor * own), components="y")
    expected = RECORD.acceleration * [1.0, factor, 1.0]
    np.testing.assert_allclose(match.motion.acceleration, expected, rtol=1e-12)
    assert match.rounds.tolist() == [0]
    assert match.factors == pytest.approx([factor], rel=1e-12)
    assert np.abs(match.misfit).max() < 1e-12
    np.testing.assert_allclose(match.misfit_before[:, 0], 1.0 / factor - 1.0, atol=1e-12)


@pytest.mark.slow
def test_a_smooth_spectrum_is_matched_between_its_periods_too() -> None:
    match = match_spectrum(RECORD, (STEPS, eurocode(STEPS)), components="x", tolerance=0.05)
    assert np.abs(match.misfit_before).max() > 0.5  # it is far from it before
    assert np.abs(match.misfit).max() <= 0.05
    fine = np.geomspace(0.05, 2.0, 1500)
    # Between periods 1 % apart, a tenth of the bandwidth of 5 % damping: 0.5 % more.
    assert np.abs(spectrum(match.motion, fine, 0) / eurocode(fine) - 1.0).max() <= 0.055
    np.testing.assert_array_equal(match.motion.acceleration[:, 1:], RECORD.acceleration[:, 1:])
    # Wavelets end at rest where they began: the motion does where the scaled record does.
    before, after = RECORD.scaled([match.factors[0], 1.0, 1.0]).integrated(), match.motion
    for old, new in zip(before, after.integrated(), strict=True):
        np.testing.assert_allclose(new[-1], old[-1], atol=1e-12)
    assert np.corrcoef(after.acceleration[:, 0], RECORD.acceleration[:, 0])[0, 1] > 0.4


def test_a_target_of_a_few_points_lies_on_straight_lines_in_logarithms() -> None:
    # The spectrum falls as 1 / T from 0.5 s on: its chords are the spectrum itself.
    corners = np.array([0.5, 0.8, 2.0])
    match = match_spectrum(RECORD.resampled(0.02), (corners, eurocode(corners)), components="xy")
    np.testing.assert_allclose(match.target, eurocode(match.periods), rtol=1e-12)
    assert np.diff(np.log(match.periods)).max() <= np.log(1.01) * (1 + 1e-9)
    assert np.abs(match.misfit).max() <= 0.1
    lines = match.report().splitlines()
    assert lines[1].split()[:2] == ["misfit", "%"]
    assert [line[:10].strip() for line in lines[2:]] == [
        *("x as given", "x matched", "x: scaled"),
        *("y as given", "y matched", "y: scaled"),
    ]
    words = lines[3].split()
    assert float(words[2]) == pytest.approx(
        100 * match.misfit[np.argmax(np.abs(match.misfit[:, 0])), 0], abs=0.05
    )
    assert float(words[4]) == pytest.approx(match.motion.peak[0] / 9.80665, abs=5e-4)


def test_a_run_that_goes_on_after_the_motion_has_its_spectrum_too() -> None:
    # A motion followed by rest has the free vibration of its oscillators in its spectrum.
    record = synthetic_motion().resampled(0.02)
    target = (np.array([0.2, 0.5, 2.0]), np.array([5.0, 5.0, 1.25]))
    match = match_spectrum(record, target, components="y")
    values = match.motion.acceleration[:, 1]
    rest = np.append(values, np.zeros(500))
    found = response_spectrum(rest, record.dt, match.periods, 0.05).pseudo_acceleration
    np.testing.assert_allclose(found / match.target - 1.0, match.misfit[:, 0], atol=1e-12)
    assert np.abs(match.misfit).max() <= 0.1
    # Corrections are zero in the last sample.
    assert values[-1] == pytest.approx(match.factors[0] * record.acceleration[-1, 1], abs=1e-12)


@pytest.mark.parametrize("seed", [2, 8])
def test_motions_far_from_the_target_are_matched_in_few_rounds(seed: int) -> None:
    # Scaled, they are 7 to 10 times the target at short periods and a tenth of it at long ones.
    record = synthetic_motion(seed=seed)
    target = ([0.1, 0.15, 0.5, 2.0], [3.9, 5.0, 5.0, 1.25])
    match = match_spectrum(record, target, tolerance=0.1)
    assert match.rounds.max() <= 10
    assert f"amplitudes changed in {match.passes[1]} passes" in match.report().splitlines()[-1]
    rest = np.pad(match.motion.acceleration[:, :2], ((0, 400), (0, 0)))
    found = response_spectrum(rest, record.dt, match.periods, 0.05).pseudo_acceleration
    assert np.abs(found / match.target[:, None] - 1.0).max() <= 0.1
    # Nothing is cut at the ends, nothing drifts.
    scaled = record.scaled([*match.factors, 1.0])
    np.testing.assert_array_equal(match.motion.acceleration[[0, -1]], scaled.acceleration[[0, -1]])
    for old, new in zip(scaled.integrated(), match.motion.integrated(), strict=True):
        np.testing.assert_allclose(new[-1], old[-1], atol=1e-12)


def test_histories_of_oscillators_have_the_peaks_of_the_spectrum() -> None:
    periods = np.array([0.1, 0.7])
    history = response_history(RECORD.acceleration, RECORD.dt, periods, 0.05)
    found = response_spectrum(RECORD.acceleration, RECORD.dt, periods, 0.05).displacement
    # Peaks are between samples, at 0.1 s of 20 in a period: at most 1 - cos(pi / 20) higher.
    shares = np.abs(history).max(axis=0) / found
    assert np.cos(np.pi / 20) <= shares.min() <= shares.max() <= 1.0 + 1e-12
    assert history.shape == (len(RECORD.acceleration), 2, 3)
    # An undamped oscillator under a step a rests at -a / omega^2 (1 - cos omega t).
    time = 0.01 * np.arange(300)
    exact = -2.0 / (2 * np.pi / 0.7) ** 2 * (1 - np.cos(2 * np.pi * time / 0.7))
    step = response_history(np.full(300, 2.0), 0.01, [0.7], 0.0)[:, 0]
    np.testing.assert_allclose(step, exact, atol=1e-13)


def test_points_on_the_lines_of_a_target_change_no_factor() -> None:
    # Their steps of 1 ms are up to twenty times as dense at long periods as those in between.
    periods, wanted = np.array([0.1, 0.5, 2.0]), np.array([5.0, 5.0, 1.25])
    more = np.union1d(periods, np.arange(0.1, 2.0, 1e-3))
    dense = np.exp(np.interp(np.log(more), np.log(periods), np.log(wanted)))
    few, many = (
        match_spectrum(synthetic_motion(seed=2), target, components="x")
        for target in ((periods, wanted), (more, dense))
    )
    assert many.factors == pytest.approx(few.factors, rel=1e-3)
    assert many.passes == few.passes
    assert many.motion.peak[0] == pytest.approx(few.motion.peak[0], rel=0.1)


def test_what_cannot_be_reached_is_an_error_with_the_worst_period() -> None:
    narrow = (np.array([0.5, 0.505, 0.51]), np.array([1.0, 50.0, 1.0]))
    with pytest.raises(RecordError, match=r"within 3 rounds: .* at 0\.5\d* s, the toleran"):
        match_spectrum(RECORD, narrow, components="x", rounds=3)
    nearest = []
    for rounds in (1, 3, 8):
        with pytest.raises(RecordError) as raised:
            match_spectrum(RECORD, narrow, components="x", rounds=rounds)
        nearest.append(float(re.search(r"misfit is [+-]([\d.]+)% at", str(raised.value))[1]))
    assert nearest[0] >= nearest[1] >= nearest[2]  # the best round counts, not the last
    still = RECORD.scaled([1.0, 0.0, 1.0])
    with pytest.raises(RecordError, match="Component y of 'synthetic motion 2' is zero through"):
        match_spectrum(still, (STEPS, eurocode(STEPS)), components="y")


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (([0.1, 1.0], [1.0]), "target must be a pair: 2 or more increasing"),
        (([0.1, 1.0], [1.0, -2.0]), "all positive and finite"),
        (([0.1, 1.0], [1.0, np.nan]), "all positive and finite"),
        (([0.1, 1.0, 0.5], [1.0, 1.0, 1.0]), "increasing periods .s."),
        (([0.04, 1.0], [1.0, 1.0]), "begins at 0.04 s; with samples every 0.005 s the limit is"),
        (([0.1, 3.1], [1.0, 1.0]), "ends at 3.1 s; for a motion of 12 s the limit is 3 s"),
    ],
)
def test_targets_that_are_none_are_errors(target: Any, message: str) -> None:
    with pytest.raises(RecordError, match=message):
        match_spectrum(RECORD, target)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"components": "xw"}, "components is 'xw'; it must be different letters of xyz"),
        ({"components": "xx"}, "components is 'xx'"),
    ],
)
def test_other_wrong_arguments_are_errors(options: dict[str, Any], message: str) -> None:
    arguments = {"motion": RECORD, "target": (STEPS, eurocode(STEPS)), **options}
    with pytest.raises(ValueError, match=message):
        match_spectrum(**arguments)
