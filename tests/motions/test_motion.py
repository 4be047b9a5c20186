# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions: their arithmetic, the synthetic motion."""

from typing import Any

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.motion import Motion, synthetic_motion


def motion_of(columns: Any, dt: float = 0.01) -> Motion:
    """Make a motion of three columns."""
    return Motion(acceleration=np.stack(np.broadcast_arrays(*columns), axis=1), dt=dt, name="test")


def burst(time: np.ndarray, frequency: float = 8.0) -> np.ndarray:
    """Sine under a Gauss curve: limited in band and gone at both ends of 0 to 4 s."""
    wave: np.ndarray = np.sin(2 * np.pi * frequency * time) * np.exp(-(((time - 2.0) / 0.3) ** 2))
    return wave


def test_a_motion_is_linear_between_samples_and_zero_outside() -> None:
    motion = Motion(acceleration=np.array([[1.0, 2.0, -3.0], [3.0, 0.0, -5.0]]), dt=0.1)
    np.testing.assert_allclose(motion(0.05), [2.0, 1.0, -4.0])
    np.testing.assert_allclose(motion([[-0.01, 0.0], [0.1, 0.11]])[:, :, 0], [[0, 1], [3, 0]])
    np.testing.assert_allclose(motion.peak, [3.0, 2.0, 5.0])
    at_once = motion(times := [-0.01, 0.0, 0.03, 0.1, 0.11])
    np.testing.assert_allclose([motion(time) for time in times], at_once, rtol=1e-14)
    assert motion.duration == pytest.approx(0.1)
    np.testing.assert_allclose(motion.time, [0.0, 0.1])


def test_a_motion_keeps_its_own_read_only_copy() -> None:
    values = np.ones((4, 3))
    motion = Motion(acceleration=values, dt=0.1)
    values[:] = 7.0
    assert motion.peak[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        motion.acceleration[0, 0] = 2.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.ones((4, 2)), r"shape \(n >= 2, 3\), got \(4, 2\)"),
        (np.array([[0, 0, 0], [0, np.nan, 0]]), "finite, got .* at sample 1"),
    ],
)
def test_a_wrong_motion_is_an_error(values: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Motion(acceleration=values, dt=0.1)


def test_rotation_turns_the_axes_counterclockwise() -> None:
    motion = motion_of((np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.array([5.0, 6.0])))
    turned = motion.rotated(30.0)
    np.testing.assert_allclose(turned.acceleration[0], [np.sqrt(0.75), -0.5, 5.0])
    np.testing.assert_allclose(turned.acceleration[1], [0.5, np.sqrt(0.75), 6.0])
    np.testing.assert_allclose(turned.rotated(-30.0).acceleration, motion.acceleration, atol=1e-15)


def test_right_angles_swap_components_to_the_last_bit() -> None:
    x, y, z = np.random.default_rng(4).standard_normal((3, 50))
    motion = motion_of((x, y, z))
    for angle, expected in {90: (y, -x), 180: (-x, -y), -90: (-y, x), 450.0: (y, -x)}.items():
        turned = motion.rotated(angle).acceleration
        np.testing.assert_array_equal(turned, np.stack([*expected, z], axis=1))


@pytest.mark.parametrize("new_dt", [0.00488, 0.0025, 0.005, 0.0061803, 0.02])
def test_resampling_is_exact_for_what_both_steps_can_hold(new_dt: float) -> None:
    # 8 Hz +- 3 Hz lies below 80 % of every Nyquist frequency here, at least 20 Hz.
    time = np.arange(801) * 0.005
    motion = motion_of((burst(time), 2 * burst(time, 4.0), 0.0), dt=0.005).resampled(new_dt)
    assert motion.dt == new_dt
    assert 4.0 - new_dt < motion.duration <= 4.0 + 1e-9
    np.testing.assert_allclose(motion.acceleration[:, 0], burst(motion.time), atol=1e-9)
    np.testing.assert_allclose(motion.acceleration[:, 1], 2 * burst(motion.time, 4.0), atol=1e-9)


def test_resampling_lets_nothing_fold_back() -> None:
    time = np.arange(801) * 0.005
    coarse = motion_of((burst(time, 40.0), 0.0, 0.0), dt=0.005).resampled(0.02)  # Nyquist 25 Hz
    assert coarse.peak[0] < 1e-9


def test_resampling_refuses_a_step_longer_than_the_motion() -> None:
    with pytest.raises(RecordError, match=r"shape .n >= 2, 3., got .1, 3."):
        motion_of((np.ones(200), 0.0, 0.0)).resampled(9.0)


def test_trimming_starts_the_clock_again() -> None:
    motion = motion_of((np.arange(101.0), 0.0, 0.0))
    part = motion.trimmed(0.5, start=0.2)
    assert part.duration == pytest.approx(0.5)
    np.testing.assert_allclose(part.acceleration[[0, -1], 0], [20.0, 70.0])
    inwards = motion.trimmed(0.495, start=0.205)
    np.testing.assert_allclose(inwards.acceleration[[0, -1], 0], [21.0, 70.0])
    assert len(motion.trimmed(motion.duration).time) == 101
    for duration, start in ((1.1, 0.0), (0.6, 0.5)):
        with pytest.raises(RecordError, match="must lie within 0 to 1 s"):
            motion.trimmed(duration, start=start)


def test_long_steps_read_no_high_frequency_as_a_low_one() -> None:
    time = np.arange(1601) * 0.0025
    low, high = burst(time, 5.0), burst(time, 98.0)  # every 4th sample of 98 Hz is one of 2 Hz
    motion = motion_of((low + high, low, high), dt=0.0025)
    assert motion.for_steps(0.0025) is motion
    read = motion.for_steps(0.01).acceleration
    # Of 98 Hz is left 1 / (1 + (98 / 40)^8) = 8e-4, of 5 Hz all but 6e-8.
    np.testing.assert_allclose(read, np.stack([low, low, 0 * low], axis=1), atol=1e-3)
    np.testing.assert_allclose(read[:, 1], low, atol=1e-6)


def test_detrending_takes_off_a_line_and_nothing_else() -> None:
    time = np.arange(1000) * 0.01
    line = motion_of((3.0 - 0.5 * time, time, 1.0))
    np.testing.assert_allclose(line.detrended().acceleration, 0.0, atol=1e-13)
    once = motion_of((np.cos(time), np.sin(time), time**2)).detrended()
    np.testing.assert_allclose(once.detrended().acceleration, once.acceleration, atol=1e-12)


def test_tapering_brings_both_ends_to_zero() -> None:
    motion = motion_of((np.ones(101), 2.0, 3.0))
    tapered = motion.tapered(seconds=0.2)
    assert np.all(tapered.acceleration[[0, -1]] == 0.0)
    np.testing.assert_allclose(tapered.acceleration[20:-20], motion.acceleration[20:-20])
    np.testing.assert_allclose(tapered.acceleration[[10, -11], 0], 0.5)  # half-way up a cosine
    by_fraction = motion.tapered(fraction=0.2)
    np.testing.assert_allclose(by_fraction.acceleration, tapered.acceleration)
    for options in ({}, {"seconds": 0.1, "fraction": 0.1}):
        with pytest.raises(RecordError, match="either in seconds or as a fraction"):
            motion.tapered(**options)
    for seconds in (0.0, 0.6):
        with pytest.raises(RecordError, match="at most half the duration, 0.5 s"):
            motion.tapered(seconds=seconds)


def test_scaling_by_one_factor_or_three() -> None:
    motion = motion_of((np.ones(5), 1.0, 1.0))
    np.testing.assert_allclose(motion.scaled(2.0).peak, 2.0)
    np.testing.assert_allclose(motion.scaled([1.0, 2.0, 3.0]).peak, [1.0, 2.0, 3.0])
    with pytest.raises(RecordError, match="one number or three"):
        motion.scaled([1.0, 2.0])


def test_the_synthetic_motion_keeps_its_promises() -> None:
    motion = synthetic_motion(seed=3, peaks_g=(0.4, 0.35, 0.0))
    assert motion.duration == pytest.approx(11.165)
    np.testing.assert_allclose(motion.peak / STANDARD_GRAVITY, [0.4, 0.35, 0.0], rtol=1e-14)
    assert np.all(motion.acceleration[[0, -1]] == 0.0)
    dt, a = motion.dt, motion.acceleration
    velocity = np.zeros_like(a)
    velocity[1:] = np.cumsum(0.5 * dt * (a[1:] + a[:-1]), axis=0)
    displacement = np.sum(velocity[:-1] * dt + dt**2 / 6.0 * (2.0 * a[:-1] + a[1:]), axis=0)
    assert np.all(np.abs(velocity[-1]) < 1e-12)
    assert np.all(np.abs(displacement) < 1e-12)


def test_the_synthetic_motion_stays_in_its_band() -> None:
    motion = synthetic_motion(seed=3, band=(2.0, 8.0))
    power = np.abs(np.fft.rfft(motion.acceleration, axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(motion.time), motion.dt)
    outside = (frequency < 1.7) | (frequency > 8.3)  # the envelope smears by some 1/duration
    assert np.all(power[outside].sum(axis=0) < 1e-4 * power.sum(axis=0))


@pytest.mark.parametrize(("duration", "dt"), [(1.0, 0.005), (2.0, 0.1)])
def test_the_default_band_fits_a_short_motion(duration: float, dt: float) -> None:
    # From 1/duration instead of 0.5 Hz, and to 0.5/dt instead of 15 Hz.
    band = (max(0.5, 1.0 / duration), min(15.0, 0.5 / dt))
    short = synthetic_motion(duration=duration, dt=dt)
    expected = synthetic_motion(duration=duration, dt=dt, band=band)
    np.testing.assert_array_equal(short.acceleration, expected.acceleration)


def test_the_synthetic_motion_is_the_same_everywhere() -> None:
    first, second = synthetic_motion(seed=7), synthetic_motion(seed=7)
    np.testing.assert_array_equal(first.acceleration, second.acceleration)
    assert np.abs(first.acceleration - synthetic_motion(seed=8).acceleration).max() > 1.0
    # Values of the first run, NumPy 2.2: they guard the stream of phases.
    expected = [[0.30726026, 1.9456291, 0.43151722], [-0.8770566, 2.0739244, -0.57431473]]
    np.testing.assert_allclose(first.acceleration[[500, 1000]], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"band": (8.0, 2.0)}, "band must rise from"),
        ({"duration": 0.1}, r"The band \(10.0, 15.0\) Hz has no sine; increase band or duration"),
        ({"band": (1.0, 200.0)}, r"at most 100 Hz \(0.5/dt\), got \(1.0, 200.0\)"),
    ],
)
def test_wrong_synthetic_motions_are_errors(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        synthetic_motion(**options)
