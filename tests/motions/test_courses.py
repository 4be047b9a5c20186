# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions from velocities and displacements, against a pulse with closed derivatives."""

import numpy as np
import pytest

from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.courses import (
    displacement_of,
    motion_from_displacement,
    motion_from_velocity,
)
from dolfinx_joints.motions.differing import DifferingMotion, Passage
from dolfinx_joints.motions.motion import Motion, synthetic_motion


def pulse(time: np.ndarray, derivative: int) -> np.ndarray:
    """sin^6 over one second in three sizes, or a derivative of it; three of them are smooth."""
    # sin^6 a = (10 - 15 cos 2a + 6 cos 4a - cos 6a) / 32
    found = np.full(len(time), 10.0 / 32.0) if derivative == 0 else np.zeros(len(time))
    for factor, times in ((-15.0, 2.0), (6.0, 4.0), (-1.0, 6.0)):
        rate = times * np.pi
        shift = 0.5 * np.pi * derivative
        found += factor / 32.0 * rate**derivative * np.cos(rate * time + shift)
    return found[:, None] * np.array([1.0, -2.0, 0.5])


def test_displacements_come_back_and_between_them_to_fourth_order() -> None:
    errors = []
    for count in (41, 81):
        time, between = np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, 997)
        samples = pulse(time, 0)
        motion = motion_from_displacement(samples + 3.0, dt=time[1])  # counts from the first
        np.testing.assert_allclose(motion.integrated()[1], samples, atol=1e-13)
        errors.append(np.abs(displacement_of(motion)(between) - pulse(between, 0)).max())
    assert np.log2(errors[0] / errors[1]) > 3.8


def test_velocities_come_back_to_fourth_order() -> None:
    errors = []
    for count in (41, 81):
        time = np.linspace(0.0, 1.0, count)
        motion = motion_from_velocity(pulse(time, 1), dt=time[1])
        velocity, displacement = motion.integrated()
        errors.append(np.abs(velocity - pulse(time, 1)).max())
        np.testing.assert_allclose(displacement, pulse(time, 0), atol=errors[-1])
    assert np.log2(errors[0] / errors[1]) > 3.7


def test_the_displacement_of_a_motion_rests_before_it_and_goes_on_after_it() -> None:
    motion = Motion(acceleration=np.array([[0.0, 1, 2], [3, 1, 2], [3, 1, 2]]), dt=0.5)
    # x: 6 t to 0.5 s, then 3, so that t^3 and 0.125 + 0.75 s + 1.5 s^2; v is 2.25 at 1 s.
    times = np.array([-1.0, 0.25, 0.75, 1.0, 3.0])
    found, rates = displacement_of(motion)(times), displacement_of(motion, rate=True)(times)
    at_end = 0.125 + 0.75 * 0.5 + 1.5 * 0.25
    x = [0.0, 0.25**3, 0.125 + 0.75 * 0.25 + 1.5 * 0.0625, at_end, at_end + 2.0 * 2.25]
    np.testing.assert_allclose(found[:, 0], x, rtol=1e-14)
    np.testing.assert_allclose(found[:, 2], [0.0, 0.0625, 0.5625, 1.0, 5.0], rtol=1e-14)
    np.testing.assert_allclose(rates[:, 0], [0.0, 0.1875, 1.5, 2.25, 2.25], rtol=1e-14)
    np.testing.assert_allclose(rates[:, 2], [0.0, 0.5, 1.5, 2.0, 2.0], rtol=1e-14)


def test_stations_share_the_ground_between_them_and_waves_are_late() -> None:
    one, two = synthetic_motion(seed=1, duration=4.0), synthetic_motion(seed=2, duration=4.0)
    differing = DifferingMotion(
        motions={"one": one, "two": two},
        positions={"two": (30.0, 40.0, 7.0), "one": (0.0, 0.0, 7.0)},
        passage=Passage(speed=500.0, direction=(0.0, 2.0, 0.0)),
        reference="two",
    )
    x = np.array([[-9.0, 0, 0], [6.0, 8.0, 0.0], [24.0, 32.0, 99.0], [60.0, 50.0, 0.0]])
    late = x[:, 1] / 500.0
    moved, time = differing.relative_to_reference(x, {}, 0.0), 2.1
    share = np.array([0.0, 0.2, 0.8, 1.0])[:, None]
    u = (1 - share) * displacement_of(one)(time - late) + share * displacement_of(two)(time - late)
    np.testing.assert_allclose(moved(time), u - displacement_of(two)(np.array([time])), atol=1e-15)
    np.testing.assert_array_equal(differing(time), two(time))


def test_stations_of_both_banks_and_two_heights() -> None:
    """At the stations their own, at the middle a quarter each, between two of them linear."""
    high, wide = 40.0, 60.0
    places = {"a": (0, 0, 0), "b": (wide, 0, 0), "c": (0, 0, high), "d": (wide, 0, high)}
    motions = {name: synthetic_motion(seed=i, duration=4.0) for i, name in enumerate(places)}
    time = 2.1
    u = np.array([displacement_of(each)(np.array([time]))[0] for each in motions.values()])

    def moved(x, *names):
        differing = DifferingMotion(
            motions={name: motions[name] for name in names},
            positions={name: places[name] for name in names},
            between="places",
        )
        return differing.relative_to_reference(np.array(x, dtype=float), {}, 0.0)(time) + u[0]

    scale = np.abs(u).max()
    np.testing.assert_allclose(moved(list(places.values()), *"abcd"), u, atol=1e-12 * scale)
    middle = [[wide / 2, 0, high / 2], [wide / 2, 9.0, high / 2]]
    np.testing.assert_allclose(moved(middle, *"abcd"), [u.mean(axis=0)] * 2, atol=1e-12 * scale)
    third = moved([[wide / 3, 0, 0], [-wide, 0, 0]], *"ab")
    np.testing.assert_allclose(third, [(2 * u[0] + u[1]) / 3, u[0]], atol=1e-12 * scale)


def test_wrong_ground_is_an_error() -> None:
    motion, rising = synthetic_motion(duration=4.0), np.ones((9, 3))
    for make, message in (
        (lambda: motion_from_velocity(rising, dt=0.1), "must start at rest; taper the record"),
        (lambda: motion_from_displacement(rising[:3], dt=0.1), r"n >= 4, 3\), got \(3, 3\)"),
        (lambda: motion_from_displacement(np.nan * rising, dt=0.1), "must be finite"),
        (lambda: Passage(speed=1.0, direction=(0.0, 0.0)), "direction is .* must not be zero"),
        (lambda: DifferingMotion(motions={}), "motions is"),
        (lambda: DifferingMotion(motions={"a": 1.0}), "motion of 'a' is 1.0"),
        (lambda: DifferingMotion(motions=motion, reference="b"), "reference is 'b'; it must be"),
        (
            lambda: DifferingMotion(motions={"a": motion, "b": motion}, positions={"a": (0, 0)}),
            "positions has a; it must have the names of all motions, at least two: a, b",
        ),
        (
            lambda: DifferingMotion(
                motions=dict.fromkeys("abc", motion),
                positions={"a": (0, 0), "b": (0, 3), "c": (1, 0)},
            ),
            'two of the positions are at the same distance .*; use between="places"',
        ),
        (
            lambda: DifferingMotion(
                motions=dict.fromkeys("ab", motion), positions={"a": (0, 1), "b": (0, 1)}
            ),
            "two of the positions are the same",
        ),
    ):
        with pytest.raises((ValueError, RecordError), match=message):
            make()
