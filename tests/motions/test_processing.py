# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Baselines, filters and integrals of ground motions against what they must be exactly."""

from typing import Any

import numpy as np
import pytest

from dolfinx_joints.motions.motion import Motion

DT = 0.01
TIME = np.arange(2001) * DT


def motion_of(*columns: Any) -> Motion:
    """A motion of 20 s."""
    return Motion(acceleration=np.stack(np.broadcast_arrays(TIME, *columns)[1:], axis=1), dt=DT)


def burst(frequency: float, width: float = 1.0) -> np.ndarray:
    """Sine under a Gauss curve in the middle of the motion."""
    wave: np.ndarray = np.sin(2 * np.pi * frequency * (TIME - 10)) * np.exp(
        -(((TIME - 10) / width) ** 2)
    )
    return wave


def test_integrals_of_a_line_are_a_parabola_and_a_cubic() -> None:
    velocity, displacement = motion_of(2.0 - TIME, 1.0, 0.0).integrated()
    np.testing.assert_allclose(velocity[:, 0], 2 * TIME - TIME**2 / 2, atol=1e-10)
    np.testing.assert_allclose(displacement[:, 0], TIME**2 - TIME**3 / 6, atol=1e-9)
    np.testing.assert_allclose(displacement[:, 1], TIME**2 / 2, atol=1e-10)
    assert np.all(displacement[:, 2] == 0.0)


@pytest.mark.parametrize("degree", range(7))
def test_a_baseline_of_its_degree_goes_and_nothing_comes_back(degree: int) -> None:
    place = TIME / 10.0 - 1.0
    baseline = sum((k + 1) * (-1.0) ** k * place**k for k in range(degree + 1))
    wave = burst(3.0)
    plain = motion_of(wave, 2 * wave, 0.0).baseline_corrected(degree)
    shifted = motion_of(wave + baseline, 2 * wave - 5 * baseline, baseline)
    corrected = shifted.baseline_corrected(degree)
    np.testing.assert_allclose(corrected.acceleration, plain.acceleration, atol=1e-10)
    np.testing.assert_allclose(corrected.acceleration[:, 2], 0.0, atol=1e-11)
    twice = corrected.baseline_corrected(degree)
    np.testing.assert_allclose(twice.acceleration, corrected.acceleration, atol=1e-11)


def gain(frequency: np.ndarray, corner: float, order: int) -> np.ndarray:
    """Gain of both passes of a low pass, by the bilinear transform of Butterworth's."""
    ratio = np.tan(np.pi * frequency * DT) / np.tan(np.pi * corner * DT)
    found: np.ndarray = 1.0 / (1.0 + ratio ** (2 * order))
    return found


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("frequency", [2.0, 5.0, 8.0])
def test_the_filter_has_butterworths_gain_and_no_phase(order: int, frequency: float) -> None:
    # The burst and what the filter makes of it lie inside the motion, so the ratio of the
    # transforms is the gain itself: real, and squared as there are two passes.
    wave = burst(frequency)
    filtered = motion_of(wave, wave, 0.0).band_passed(high=5.0, order=order).acceleration[:, 0]
    spectrum = np.fft.rfft(wave)
    strong = np.abs(spectrum) > 0.1 * np.abs(spectrum).max()
    ratio = np.fft.rfft(filtered)[strong] / spectrum[strong]
    expected = gain(np.fft.rfftfreq(len(TIME), DT)[strong], 5.0, order)
    np.testing.assert_allclose(ratio, expected, atol=2e-9)


def test_low_and_high_pass_corners_halve_a_sine() -> None:
    for options in ({"low": 2.0}, {"high": 2.0}, {"low": 2.0, "high": 20.0}):
        sine = np.sin(2 * np.pi * 2.0 * TIME)
        middle = motion_of(sine, sine, sine).band_passed(**options).acceleration[800:1200]
        expected = 0.5 * np.stack([sine] * 3, axis=1)[800:1200]
        np.testing.assert_allclose(middle, expected, atol=2e-4)


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        (None, None, "or two with low < high, below 50 Hz, .* got low=None and high=None"),
        (5.0, 1.0, "got low=5.0 and high=1.0"),
        (0.1, 50.0, "below 50 Hz, half the sampling rate; got low=0.1 and high=50.0"),
        (0.01, 5.0, "0.01 Hz must be at least 0.05 Hz: one period in the 20 s of the motion"),
    ],
)
def test_wrong_filters_are_errors(low: Any, high: float | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        motion_of(1.0, 1.0, 1.0).band_passed(low, high)
