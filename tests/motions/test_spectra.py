# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spectra against closed forms."""

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.motions.spectra import (
    arias_intensity,
    equally_spaced,
    fourier_amplitude,
    response_history,
    response_spectrum,
    significant_duration,
)


def test_fourier_amplitude_of_a_gauss_curve() -> None:
    # The transform of exp(-t^2 / (2 s^2)) is s sqrt(2 pi) exp(-2 (pi s f)^2).
    time, width = np.arange(1000) * 0.01, 0.2
    frequency, amplitude = fourier_amplitude(np.exp(-0.5 * ((time - 5.0) / width) ** 2), 0.01)
    exact = width * np.sqrt(2 * np.pi) * np.exp(-2.0 * (np.pi * width * frequency) ** 2)
    np.testing.assert_allclose(amplitude, exact, atol=1e-12)


def test_fourier_amplitude_keeps_components_and_energy() -> None:
    signal = np.random.default_rng(1).normal(size=(501, 3))
    frequency, amplitude = fourier_amplitude(signal, 0.02)
    assert amplitude.shape == (251, 3)
    doubled = np.r_[1.0, np.full(250, 2.0)] @ amplitude**2 * frequency[1]  # Parseval
    np.testing.assert_allclose(doubled, 0.02 * (signal**2).sum(axis=0))


def test_response_to_a_step() -> None:
    # u_max omega^2 / a = 1 + exp(-pi zeta / sqrt(1 - zeta^2)), reached after half a damped period.
    periods = np.array([0.5, 1.0, 2.0])
    for zeta in (0.0, 0.05, 0.6):
        spectrum = response_spectrum(np.full(40001, 3.0), 0.0005, periods, zeta)
        overshoot = 1.0 + np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
        np.testing.assert_allclose(spectrum.pseudo_acceleration, 3.0 * overshoot, rtol=1e-5)


def test_response_to_a_ramp_is_exact_at_any_step() -> None:
    # a = r t from rest, undamped: u = -r (t / omega^2 - sin(omega t) / omega^3), which grows. After
    # the end u is a free vibration of the amplitude sqrt(u^2 + (u' / omega)^2).
    for dt in (0.001, 0.1, 0.7):
        time = np.arange(int(7.0 / dt) + 1) * dt
        omega = 2.0 * np.pi / 1.3
        last = 2.0 * (time[-1] / omega**2 - np.sin(omega * time[-1]) / omega**3)
        speed = 2.0 * (1.0 - np.cos(omega * time[-1])) / omega**2
        exact = np.hypot(last, speed / omega)
        spectrum = response_spectrum(2.0 * time, dt, [1.3], 0.0)
        assert spectrum.displacement[0] == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("zeta", [0.0, 0.05, 0.3])
def test_peaks_between_samples_and_after_the_motion_count(zeta: float) -> None:
    # The same piecewise linear motion in 200 times as many samples, followed by rest.
    motion, periods = np.random.default_rng(3).normal(size=80), np.geomspace(0.008, 0.4, 25)
    motion[-1] = 0.0
    fine = np.interp(np.arange(79 * 200 + 1) / 200, np.arange(80), motion)
    peaks = response_spectrum(motion, 0.02, periods, zeta).displacement
    history = response_history(np.append(fine, np.zeros(4000)), 0.02 / 200, periods, zeta)
    np.testing.assert_allclose(peaks, np.abs(history).max(axis=0), rtol=1e-3)


def test_response_limits_and_ratios() -> None:
    time = np.arange(4001) * 0.005
    motion = np.sin(2 * np.pi * time) * np.sin(np.pi * time / 20.0) ** 2
    spectrum = response_spectrum(motion, 0.005, [0.01, 0.5, 200.0], 0.05)
    # A stiff oscillator follows the ground, a soft one stays where it was.
    assert spectrum.pseudo_acceleration[0] == pytest.approx(np.abs(motion).max(), rel=1e-3)
    velocity = np.cumsum(motion) * 0.005
    ground = np.abs(np.cumsum(velocity)).max() * 0.005
    assert spectrum.displacement[2] == pytest.approx(ground, rel=0.1)
    omega = 2 * np.pi / spectrum.periods
    np.testing.assert_allclose(spectrum.pseudo_velocity, omega * spectrum.displacement)
    np.testing.assert_allclose(spectrum.pseudo_acceleration, omega**2 * spectrum.displacement)


def test_response_of_several_components_at_once() -> None:
    motion = np.random.default_rng(2).normal(size=(300, 3))
    together = response_spectrum(motion, 0.01, [0.2, 0.4], 0.05)
    assert together.displacement.shape == together.pseudo_acceleration.shape == (2, 3)
    alone = response_spectrum(motion[:, 1], 0.01, [0.2, 0.4], 0.05)
    np.testing.assert_allclose(together.pseudo_velocity[:, 1], alone.pseudo_velocity)


def test_arias_intensity_of_a_sine() -> None:
    # Over whole periods the integral of A^2 sin^2 is A^2 T / 2.
    time = np.arange(2001) * 0.005
    intensity = arias_intensity(3.0 * np.sin(2 * np.pi * time), 0.005)
    assert intensity[0] == 0.0
    assert intensity[-1] == pytest.approx(np.pi / (2 * STANDARD_GRAVITY) * 9.0 * 10.0 / 2.0)
    assert np.all(np.diff(intensity) >= 0.0)


def test_significant_duration() -> None:
    # A constant acceleration gathers intensity at a constant rate.
    start, end = significant_duration(np.full(1001, 2.0), 0.01)
    assert (start, end) == pytest.approx((0.5, 9.5))
    # Quiet before and after does not count, and components add up.
    quiet = np.r_[np.zeros(500), np.full(1001, 2.0), np.zeros(500)]
    both = np.stack([quiet, 0.5 * quiet], axis=1)
    assert significant_duration(both, 0.01) == pytest.approx((5.5, 14.5), abs=0.02)
    whole = significant_duration(quiet, 0.01, lower=0.0, upper=1.0)
    assert whole == pytest.approx((0.0, 15.01), abs=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fourier_amplitude([1.0], 0.1), "at least 2 samples, finite numbers, got"),
        (lambda: significant_duration(np.ones((3, 4)), 0.1), r"got \(3, 4\), .*; transpose it"),
        (lambda: response_spectrum([1.0, 2.0], 0.1, [0.0], 0.05), "periods must be positive"),
        (lambda: significant_duration([1.0, 2.0], 0.1, lower=0.9, upper=0.1), "lower is 0.9; it"),
        (lambda: significant_duration([0.0, 0.0], 0.1), "zero throughout"),
        (lambda: equally_spaced([0.0, 2.0, 1.0], [0, 0, 0]), "at 2 or more increasing times"),
    ],
)
def test_wrong_arguments_have_a_message(call, message) -> None:
    with pytest.raises(ValueError, match=message):
        call()
