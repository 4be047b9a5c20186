# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ground motions: their arithmetic, the file reader and its refusals, the synthetic motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dolfinx_joints.errors import RecordError
from dolfinx_joints.records import (
    STANDARD_GRAVITY,
    Motion,
    read_at2,
    read_record,
    synthetic_motion,
)

NEW_STYLE = "NPTS=   {count}, DT=   {dt} SEC,                  "


def at2_text(
    values: Sequence[float],
    *,
    component: str = "0",
    dt: str = ".0050",
    count: int | None = None,
    line4: str = NEW_STYLE,
    unit: str = "UNITS OF G",
) -> str:
    """Text of an AT2 file with five values on a line."""
    header = [
        "PEER STRONG MOTION",
        f"Somewhere, 1/1/2000, Station, {component}",
        f"SERIES IN {unit}",
    ]
    header.append(line4.format(count=len(values) if count is None else count, dt=dt))
    rows = [values[i : i + 5] for i in range(0, len(values), 5)]
    return "\r\n".join(header + ["".join(f" {v:14.7E}" for v in row) for row in rows]) + "\r\n"


def write_record(
    directory: Path,
    stem: str = "RSN1_ABC",
    parts: Sequence[str] = ("000", "270", "-UP"),
    **at2: Any,
) -> None:
    """Write components of 20, 21, 22, ... values that are 0.1, 0.2, 0.3, ... g throughout."""
    for number, part in enumerate(parts):
        text = at2_text([0.1 * (number + 1)] * (20 + number), component=part.strip("-"), **at2)
        (directory / f"{stem}{part}.AT2").write_text(text)


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
    ("values", "dt", "message"),
    [
        (np.ones((4, 2)), 0.1, r"shape \(n >= 2, 3\), got \(4, 2\)"),
        (np.ones((1, 3)), 0.1, r"got \(1, 3\)"),
        (np.array([[0, 0, 0], [0, np.nan, 0]]), 0.1, "finite, got .* at sample 1"),
        (np.ones((4, 3)), 0.0, "positive number of seconds, got 0.0"),
        (np.ones((4, 3)), np.nan, "got nan"),
    ],
)
def test_a_wrong_motion_is_refused(values: np.ndarray, dt: float, message: str) -> None:
    with pytest.raises(RecordError, match=message):
        Motion(acceleration=values, dt=dt)


def test_rotation_turns_the_axes_counterclockwise() -> None:
    motion = motion_of((np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.array([5.0, 6.0])))
    turned = motion.rotated(30.0)
    np.testing.assert_allclose(turned.acceleration[0], [np.sqrt(0.75), -0.5, 5.0])
    np.testing.assert_allclose(turned.acceleration[1], [0.5, np.sqrt(0.75), 6.0])
    np.testing.assert_allclose(turned.rotated(-30.0).acceleration, motion.acceleration, atol=1e-15)


def test_rotation_finds_the_largest_peak_of_a_polarised_motion() -> None:
    # All motion along the line 25 degrees to the left of x: turned by 25 it is on x alone.
    wave = np.sin(np.arange(200) * 0.1)
    angle = np.deg2rad(25.0)
    turned = motion_of((np.cos(angle) * wave, np.sin(angle) * wave, 0.0)).rotated(25.0)
    np.testing.assert_allclose(turned.acceleration[:, 0], wave, atol=1e-15)
    np.testing.assert_allclose(turned.acceleration[:, 1], 0.0, atol=1e-15)


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
    for dt in (0.0, -1.0, 9.0, np.nan):
        with pytest.raises(RecordError, match="dt must be positive and at most 1.99 s"):
            motion_of((np.ones(200), 0.0, 0.0)).resampled(dt)


def test_trimming_starts_the_clock_again() -> None:
    motion = motion_of((np.arange(101.0), 0.0, 0.0))
    part = motion.trimmed(0.5, start=0.2)
    assert part.duration == pytest.approx(0.5)
    np.testing.assert_allclose(part.acceleration[[0, -1], 0], [20.0, 70.0])
    inwards = motion.trimmed(0.495, start=0.205)
    np.testing.assert_allclose(inwards.acceleration[[0, -1], 0], [21.0, 70.0])
    assert len(motion.trimmed(motion.duration).time) == 101
    for duration, start in ((1.1, 0.0), (0.6, 0.5), (0.5, -0.1), (0.0, 0.0)):
        with pytest.raises(RecordError, match="must lie within 0 to 1 s"):
            motion.trimmed(duration, start=start)


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
    for seconds in (0.0, 0.6, np.nan):
        with pytest.raises(RecordError, match="at most half the duration, 0.5 s"):
            motion.tapered(seconds=seconds)


def test_scaling_by_one_factor_or_three() -> None:
    motion = motion_of((np.ones(5), 1.0, 1.0))
    np.testing.assert_allclose(motion.scaled(2.0).peak, 2.0)
    np.testing.assert_allclose(motion.scaled([1.0, 2.0, 3.0]).peak, [1.0, 2.0, 3.0])
    for factor in ([1.0, 2.0], np.inf):
        with pytest.raises(RecordError, match="one finite number or three"):
            motion.scaled(factor)


@pytest.mark.parametrize(
    "line4",
    [
        "NPTS=   {count}, DT=   {dt} SEC,     ",
        "NPTS= {count}, DT= {dt} SEC",
        "NPTS={count},DT={dt}SEC",
        "   {count}    {dt}    NPTS, DT",
    ],
)
def test_the_known_headers_are_read(tmp_path: Path, line4: str) -> None:
    path = tmp_path / "a.at2"
    path.write_text(at2_text([0.1, -0.2, 0.3, 0.4, 0.5, 0.6, 0.7], line4=line4))
    acceleration, dt, header = read_at2(path)
    expected = np.array([0.1, -0.2, 0.3, 0.4, 0.5, 0.6, 0.7]) * STANDARD_GRAVITY
    np.testing.assert_allclose(acceleration, expected, rtol=1e-12)
    assert dt == 0.005
    assert len(header) == 4
    assert header[1] == "Somewhere, 1/1/2000, Station, 0"


GOOD = at2_text(np.linspace(0.0, 0.22, 23).tolist())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has 0 lines"),
        (GOOD.replace("UNITS OF G", "UNITS OF CM/S/S"), "line 3: must say 'UNITS OF G', got"),
        (GOOD.replace("UNITS OF G", "UNITS OF G/10"), "line 3: must say 'UNITS OF G'"),
        (GOOD.replace("NPTS", "POINTS"), "line 4: must give 'NPTS= count, DT= step SEC'"),
        (GOOD.replace(".0050", ".0000"), "line 4: the time step must be positive"),
        (GOOD.replace(" 1.0000000E-01", " NaN"), "line 7: 'NaN' is not a finite number"),
        (GOOD.replace(" 1.0000000E-01", " 1_0"), "line 7: '1_0' is not a finite number"),
        (GOOD.replace(" 1.0000000E-01", " 1E999"), "line 7: '1E999' is not a finite number"),
        (GOOD.replace(" 1.0000000E-01", " ******"), "line 7: '[*]+' is not a finite number"),
        (GOOD.replace(" 1.0000000E-01", ""), "line 7: 4 values where the lines before have 5"),
        (GOOD.replace(" 1.0000000E-01", " 1 2"), "line 7: 6 values where the lines before have 5"),
        (GOOD[: GOOD.rindex(" 2.2")], "line 9: the file ends after 22 values, line 4 announces 23"),
        (GOOD[: GOOD.rindex(" 2.0")], "line 8: the file ends after 20 values, line 4 announces 23"),
        (
            at2_text([0.1] * 10, count=9),
            "line 6: the file ends after 10 values, line 4 announces 9",
        ),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.AT2"
    path.write_text(text)
    with pytest.raises(RecordError, match=message) as caught:
        read_at2(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).endswith(".")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="none.AT2 cannot be read: No such file"):
        read_at2(tmp_path / "none.AT2")


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (("000", "270", "-UP"), [0.1, 0.2, 0.3]),  # y lies 90 degrees to the left of x
        (("000", "090", "-UP"), [0.2, 0.1, 0.3]),
        (("164", "254", "DWN"), [0.2, 0.1, -0.3]),
        (("-V", "-N", "-E"), [0.3, 0.2, 0.1]),
        (("360", "270", "-UP"), [0.1, 0.2, 0.3]),
    ],
)
def test_components_find_their_axes(
    tmp_path: Path, parts: tuple[str, ...], expected: list[float]
) -> None:
    write_record(tmp_path, parts=parts)
    motion = read_record(tmp_path)
    assert motion.name == "RSN1_ABC"
    assert motion.acceleration.shape == (20, 3)  # the shortest of 20, 21, 22
    np.testing.assert_allclose(motion.acceleration[7] / STANDARD_GRAVITY, expected)


def test_one_of_several_records_is_chosen_by_name(tmp_path: Path) -> None:
    write_record(tmp_path, "RSN1_ABC")
    (tmp_path / "sub").mkdir()
    write_record(tmp_path / "sub", "RSN2_DEF")
    (tmp_path / "notes.txt").write_text("not a record")
    assert read_record(tmp_path).name == "RSN1_ABC"
    write_record(tmp_path, "RSN2_DEF")
    with pytest.raises(RecordError, match="choose by name=: RSN1_ABC, RSN2_DEF"):
        read_record(tmp_path)
    assert read_record(tmp_path, name="def").name == "RSN2_DEF"
    with pytest.raises(RecordError, match="no record with 'xyz' in its name; it has RSN1_ABC, RSN"):
        read_record(tmp_path, name="xyz")


def test_incomplete_records_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="There is no directory"):
        read_record(tmp_path / "none")
    with pytest.raises(RecordError, match="has no record; it has none"):
        read_record(tmp_path)
    for number, parts in enumerate((("000", "-UP"), ("000", "045", "-UP"), ("000", "090", "180"))):
        (tmp_path / str(number)).mkdir()
        write_record(tmp_path / str(number), parts=parts)
        with pytest.raises(RecordError, match="two horizontal ones at right angles, 'RSN1_ABC' is"):
            read_record(tmp_path / str(number))


def test_components_that_disagree_are_refused(tmp_path: Path) -> None:
    write_record(tmp_path)
    (tmp_path / "RSN1_ABC-UP.AT2").write_text(at2_text([0.1] * 20, component="UP", dt=".0100"))
    with pytest.raises(RecordError, match="different time steps"):
        read_record(tmp_path)
    (tmp_path / "RSN1_ABC-UP.AT2").write_text(at2_text([0.1] * 20, component="DWN"))
    with pytest.raises(RecordError, match="-UP.AT2, line 2: names another component"):
        read_record(tmp_path)


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
        ({"band": (8.0, 2.0)}, "band must rise within"),
        ({"band": (1.0, 200.0)}, r"0.08957 to 100 Hz, got \(1.0, 200.0\)"),
        ({"dt": 1.0}, "at most duration / 100"),
        ({"peaks_g": (0.4, 0.3)}, "three numbers"),
        ({"peaks_g": (0.4, -0.3, 0.1)}, "three numbers of at least 0"),
    ],
)
def test_wrong_synthetic_motions_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(RecordError, match=message):
        synthetic_motion(**options)
