# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Response measures of files whose histories and joints can be worked out by hand."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from declared import declare_envelopes, declare_histories, declare_states, declare_static_stages
from written_runs import SHARES

from dolfinx_joints.common.constants import ACCELERATION_BAND
from dolfinx_joints.common.errors import PlausibilityWarning, ResultsError
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing.criteria.checks import checks
from dolfinx_joints.postprocessing.envelopes import ENVELOPE_NAMES
from dolfinx_joints.results.layout import stage_bytes
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

DT = 0.005
TIME = DT * np.arange(2001)  # 10 s
OFFSET = np.array([1e-3, -2e-3, -5e-3])  # static displacement

Vector = Callable[[np.ndarray], np.ndarray]


def nothing(time: np.ndarray) -> np.ndarray:
    return np.zeros((*np.shape(time), 3))


def write(
    path: Path,
    motion: Vector,
    *,
    ground: Vector = nothing,
    acceleration: Vector = nothing,
    start: float = 0.0,
) -> Results:
    """A run whose crest moves by ``motion`` from its static displacement."""
    u, a, g = OFFSET + motion(TIME), acceleration(TIME), ground(TIME)
    with ResultsWriter(path, {"point_names": ["base", "crest"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 0.0], [0.0, 0.0, 8.0]], accelerations=True)
        writer.start()
        for row, time in enumerate(TIME):
            values = dict.fromkeys(("iterations", *SHARES), 1)
            values["displacement"] = [np.zeros(3), u[row]]
            values["acceleration"] = [np.zeros(3), a[row]]
            writer.append("histories", start + time, values | {"ground_acceleration": g[row]})
        writer.finish("complete", {"steps": 2000, "seconds": {"statics": 1.0, "steps": 3.0}})
    return Results(path)


def along_x(wave: Callable[[np.ndarray], np.ndarray]) -> Vector:
    return lambda time: np.stack([wave(time), 0 * time, 0 * time], axis=-1)


def test_displacement_counts_from_the_static_state(tmp_path: Path) -> None:
    results = write(tmp_path / "r.h5", along_x(lambda t: 0.02 * np.sin(2 * np.pi * t)))
    time, u = measures.displacement_history(results, "crest", "x")
    np.testing.assert_array_equal(time, TIME)
    np.testing.assert_allclose(u, 0.02 * np.sin(2 * np.pi * TIME), atol=1e-15)
    np.testing.assert_array_equal(measures.displacement_history(results, 1, "z")[1], 0.0)


def test_acceleration_lies_in_the_middle_of_the_steps(tmp_path: Path) -> None:
    # A straight line has its mean over a step in the middle: 7 - 4 t relative, 1 + t the ground.
    relative = along_x(lambda t: 7.0 - 4.0 * (t - DT / 2))
    ground = along_x(lambda t: 1.0 + t)
    results = write(tmp_path / "r.h5", nothing, ground=ground, acceleration=relative)
    time, a = measures.acceleration_history(results, "crest", "x", absolute=False, band=None)
    np.testing.assert_allclose(time, TIME[1:] - DT / 2)
    np.testing.assert_allclose(a, 7.0 - 4.0 * time, rtol=1e-12, atol=1e-12)
    _, a = measures.acceleration_history(results, "crest", "x", band=None)
    np.testing.assert_allclose(a, 8.0 - 3.0 * time, rtol=1e-12, atol=1e-12)


def test_acceleration_of_a_band_keeps_what_lies_in_it(tmp_path: Path) -> None:
    # Sines below the band, at it and far above it keep 1 / (1 + (f / band)^8).
    band, sizes = 10.0, {2.0: 3.0, 10.0: 2.0, 80.0: 50.0}
    results = write(
        tmp_path / "r.h5",
        nothing,
        acceleration=along_x(
            lambda t: sum(s * np.sin(2 * np.pi * f * (t - DT / 2)) for f, s in sizes.items())
        ),
    )
    time, a = measures.acceleration_history(results, "crest", "x", absolute=False, band=band)
    np.testing.assert_allclose(time, TIME[1:] - DT / 2)
    parts = [
        size / (1 + (f / band) ** 8) * np.sin(2 * np.pi * f * time) for f, size in sizes.items()
    ]
    inner = (time > 5 / band) & (time < time[-1] - 5 / band)
    np.testing.assert_allclose(a[inner], sum(parts)[inner], atol=1e-3)
    *_, raw = measures.acceleration_history(results, "crest", "x", absolute=False, band=None)
    assert abs(raw).max() > 40.0  # the file's own


def test_band_ends_where_the_records_end(tmp_path: Path) -> None:
    results = write(tmp_path / "r.h5", nothing, acceleration=along_x(np.ones_like))
    assert measures.common_band(results) == ACCELERATION_BAND
    assert measures.common_band(results, band=300.0) == pytest.approx(0.5 / DT)
    assert measures.band_name(measures.common_band(results, band=300.0)) == "low-passed at 100 Hz"


def test_a_constant_passes_the_band_up_to_the_ends(tmp_path: Path) -> None:
    results = write(tmp_path / "r.h5", nothing, acceleration=along_x(lambda t: 0 * t + 4.0))
    _, a = measures.acceleration_history(results, "crest", "x", absolute=False)
    np.testing.assert_allclose(a, 4.0, rtol=1e-9)


def test_what_changes_sign_every_step_leaves_no_peak_at_the_end(tmp_path: Path) -> None:
    # As mass beside stiff joints does: 40 m/s^2 at the Nyquist frequency, none of it in the band.
    swing = along_x(lambda t: 40.0 * np.cos(np.pi * t / DT))
    results = write(tmp_path / "r.h5", nothing, acceleration=swing)
    _, a = measures.acceleration_history(results, "crest", "x", absolute=False, band=20.0)
    assert np.abs(a).max() < 1e-3 * 40.0


def test_a_band_keeps_the_impulse_of_a_short_step(tmp_path: Path) -> None:
    # A blow of 3 m/s within the one step of 1 ms among steps of 10 ms: low-passed it still brings
    # 3 m/s, as the gain at 0 Hz is one.
    time = np.concatenate([0.01 * np.arange(101), 1.001 + 0.01 * np.arange(101)])
    with ResultsWriter(tmp_path / "r.h5", {"point_names": ["crest"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 8.0]], accelerations=True)
        writer.start()
        for row, t in enumerate(time):
            values = dict.fromkeys(("iterations", *SHARES), 1)
            values |= {"displacement": np.zeros((1, 3)), "ground_acceleration": np.zeros(3)}
            values["acceleration"] = np.full((1, 3), 3000.0 * (row == 101))
            writer.append("histories", t, values)
        writer.finish("complete", {})
    with Results(tmp_path / "r.h5") as results:
        at, a = measures.acceleration_history(results, "crest", "x")
        assert np.diff(at) == pytest.approx(1e-3)
        assert a.sum() * 1e-3 == pytest.approx(3.0, rel=1e-9)
        # The filter's own pulse: 3 m/s times the integral of its gain over all frequencies,
        # 2 band (pi / 8) / sin(pi / 8).
        pulse = 3.0 * 2.0 * ACCELERATION_BAND * (np.pi / 8) / np.sin(np.pi / 8)
        assert a.max() == pytest.approx(pulse, rel=0.01)


def test_absolute_motions_without_a_ground_have_none_to_be_relative_to(tmp_path: Path) -> None:
    # As on supports that move: the base by 3 t, the tip by 5 t.
    with ResultsWriter(tmp_path / "r.h5", {"displacements": "absolute"}) as writer:
        declare_histories(writer, np.zeros((2, 3)), accelerations=True)
        writer.start()
        for time in (0.0, 1.0, 2.0):
            values = dict.fromkeys(("iterations", *SHARES), 0)
            values |= {"acceleration": np.ones((2, 3)), "ground_acceleration": np.zeros(3)}
            moved = [[3.0 * time, 0.0, 0.0], [5.0 * time, 0.0, 0.0]]
            writer.append("histories", time, values | {"displacement": moved})
    results = Results(tmp_path / "r.h5")
    assert not results.relative
    _, u = measures.displacement_history(results, 1, "x", relative_to="point 0")
    np.testing.assert_allclose(u, [0.0, 2.0, 4.0])
    _, a = measures.acceleration_history(results, 1, "x", band=None)
    np.testing.assert_array_equal(a, 1.0)
    assert measures.strong_phase_end(results) == 2.0
    for ask in (
        lambda: measures.displacement_history(results, 1, "x", relative_to="ground"),
        lambda: measures.acceleration_history(results, 1, "x", absolute=False),
    ):
        with pytest.raises(ResultsError, match="has absolute motions and no motion of the ground"):
            ask()


def test_peaks_before_and_after_a_time(tmp_path: Path) -> None:
    # 20 mm down to 4 s, 5 mm after it.
    def motion(time: np.ndarray) -> np.ndarray:
        wave = np.where(time <= 4.0, -0.020, 0.005) * np.abs(np.sin(2 * np.pi * time))
        return np.stack([wave, 0 * time, wave / 2], axis=-1)

    results = write(tmp_path / "r.h5", motion)
    found = measures.peaks(results, "crest", strong_until=4.0)
    assert found["x"] == pytest.approx({"strong": 0.020, "later": 0.005})
    assert found["z"] == pytest.approx({"strong": 0.010, "later": 0.0025})
    assert found["y"] == {"strong": 0.0, "later": 0.0}
    assert np.isnan(measures.peaks(results, "crest", strong_until=10.0)["x"]["later"])


def test_end_of_strong_motion(tmp_path: Path) -> None:
    # Constant acceleration up to 4 s: the intensity grows evenly, 95 % of it is there at 3.8 s. The
    # motion falls to zero within one step, of which a third of a step counts.
    ground = along_x(lambda t: np.where(t <= 4.0, 3.0, 0.0))
    results = write(tmp_path / "r.h5", nothing, ground=ground)
    assert measures.strong_motion_end(results) == pytest.approx(3.8, abs=DT)
    assert measures.strong_motion_end(results, 0.5) == pytest.approx(2.0, abs=DT)
    motion = Motion(acceleration=ground(TIME), dt=DT)
    assert measures.strong_motion_end(motion) == measures.strong_motion_end(results)
    continued = write(tmp_path / "c.h5", nothing, ground=ground, start=2.0)
    assert measures.strong_motion_end(continued) == pytest.approx(5.8, abs=DT)
    with pytest.raises(ValueError, match="zero throughout"):
        measures.strong_motion_end(write(tmp_path / "still.h5", nothing))


def test_fourier_peaks(tmp_path: Path) -> None:
    # 2001 samples: bins of 1 / 10.005 s. Amplitudes A T / 2 of two sines, within the leakage.
    def wave(time: np.ndarray) -> np.ndarray:
        return 0.010 * np.sin(2 * np.pi * 5.2 * time) + 0.004 * np.sin(2 * np.pi * 2.0 * time)

    results = write(tmp_path / "r.h5", along_x(wave))
    found = measures.fourier_peaks(results, "crest", "x", below=5.0)
    assert found.bin_width == pytest.approx(1.0 / 10.005)
    assert found.frequency == pytest.approx(5.2, abs=0.5 * found.bin_width)
    assert found.amplitude == pytest.approx(0.010 * 10.005 / 2, rel=0.02)
    assert found.frequency_below == pytest.approx(2.0, abs=0.5 * found.bin_width)
    assert found.amplitude_below == pytest.approx(0.004 * 10.005 / 2, rel=0.02)
    # Just below the main peak its flank is higher than the peak at 2 Hz, but is no peak.
    near = measures.fourier_peaks(results, "crest", "x", below=5.15)
    assert near.frequency_below == found.frequency_below
    assert np.isnan(measures.fourier_peaks(results, "crest", "x").frequency_below)


def test_a_residual_displacement_is_no_peak(tmp_path: Path) -> None:
    # The same sine about 0 and, from 2 s on, about 10 mm: the mean, A T = 0.08 m s, and its flank
    # exceed the peak A T / 2 = 0.05 m s, which stays where it is.
    def wave(time: np.ndarray) -> np.ndarray:
        return 0.010 * np.sin(2 * np.pi * 5.2 * time)

    about_zero = write(tmp_path / "r.h5", along_x(wave))
    moved = write(tmp_path / "m.h5", along_x(lambda time: wave(time) + 0.010 * (time > 2.0)))
    whole, found = (measures.fourier_peaks(run, "crest", "x") for run in (about_zero, moved))
    assert found.frequency == whole.frequency
    assert found.amplitude == pytest.approx(whole.amplitude, rel=0.02)
    nowhere = measures.fourier_peaks(about_zero, "base", "x", below=5.0)
    assert np.isnan(nowhere[:2]).all()
    assert np.isnan(nowhere[3:]).all()


# A joint of three points of 1, 2 and 5 m2, recorded every second from 0 to 4 s.
AREAS = np.array([1.0, 2.0, 5.0])
OPENING = 1e-3 * np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [1, 0, 0], [1, 0, 0]])
SLIP = 1e-3 * np.array([[1, 0, 0], [1, 2, 0], [1, 5, 0], [1, 3, 0], [1, 1, 0]])
# At 3 s the first point opens: it bore pressure within the step.
CLOSED = -2e6 * np.array([[1, 1, 1], [0, 1, 4], [0, 0, 1], [1, 1, 1], [0, 1, 1]])
STATUS = np.array([[1, 1, 1], [0, 2, 1], [0, 0, 2], [0, 1, 1], [0, 2, 1]])


def write_joint(path: Path, *, status: bool = True, ajar: float = 0.0) -> Results:
    """A run of joint_1 as above, and of joint_2 of twice the area, which never moves."""
    points = np.array([[0.0, 0.0, z] for z in (1.0, 2.0, 3.0)])
    arrays = {"points": points, "frames": np.tile(np.eye(3), (3, 1, 1)), "facet": np.zeros(3)}
    joints = {"joint_1": arrays | {"areas": AREAS}, "joint_2": arrays | {"areas": 2 * AREAS}}
    with ResultsWriter(path, {}) as writer:
        declare_states(writer, np.zeros((4, 3)), [[0, 1, 2, 3]], joints, status=status)
        writer.start()
        for row in range(5):
            gap, traction = np.zeros((3, 3)), np.zeros((3, 3))
            gap[:, 0], gap[:, 2] = OPENING[row] + ajar, -SLIP[row]
            traction[:, 0] = CLOSED[row]
            values = {"displacement": np.zeros((4, 3))}
            values |= {"joints/joint_1/gap": gap, "joints/joint_1/traction": traction}
            still = np.full((3, 3), -1e5)
            values |= {"joints/joint_2/gap": 0 * gap, "joints/joint_2/traction": still}
            if status:
                values |= {"joints/joint_1/status": STATUS[row], "joints/joint_2/status": [1, 1, 1]}
            writer.append("states", float(row), values)
    return Results(path)


def test_joint_measures(tmp_path: Path) -> None:
    found = measures.joint_measures(write_joint(tmp_path / "r.h5"), tail=1.0)
    assert list(found) == ["joint_1", "joint_2"]
    # Open areas of 8 m2: 0, 1, 3, 1 and 1; sliding ones: 0, 2, 5, 0 and 2. The slip of the first
    # point, 1 mm, was there in the static state. The last second holds two records, 3 and 4 s.
    assert found["joint_1"] == pytest.approx(
        {
            "opening_max": 3e-3,
            "opening_time": 2.0,
            "opening_static": 0.0,
            "opening_residual": 1e-3,
            "slip_max": 5e-3,
            "slip_time": 2.0,
            "slip_residual": 2e-3,
            "pressure_max": 8e6,
            "pressure_time": 1.0,
            "mean_pressure_max": 2e6 * (2.0 + 4.0 * 5.0) / 8.0,
            "mean_pressure_time": 1.0,
            "share_open": 6 / (5 * 8),
            "share_sliding": 9 / (5 * 8),
            "share_frictionless": 0.0,
            "share_broken": 0.0,
        }
    )
    assert found["joint_2"]["opening_max"] == found["joint_2"]["slip_max"] == 0.0
    assert found["joint_2"]["share_open"] == found["joint_2"]["share_sliding"] == 0.0
    last = measures.joint_measures(write_joint(tmp_path / "last.h5"), tail=0.0)
    assert last["joint_1"]["slip_residual"] == pytest.approx(1e-3)


def test_a_slip_that_varies_at_the_end_is_not_residual(tmp_path: Path) -> None:
    # The third point has 3 mm at 3 s and 1 mm at 4 s: mean 2 mm, distance from the mean 1 mm.
    results = write_joint(tmp_path / "r.h5")
    assert measures.slip_in_tail(results, "joint_1") == pytest.approx((2e-3, 1e-3))
    assert measures.slip_in_tail(results, "joint_1", tail=0.0) == pytest.approx((1e-3, 0.0))
    with pytest.warns(PlausibilityWarning, match="not ended.*joint_1.*run longer, or use to_rest"):
        rows = checks(results, "gravity", residual_slip=5e-3)
    moving, still = (row for row in rows if row.criterion.startswith("residual slip"))
    assert moving.where == "joint_1 from the first record, varies by 1 mm in the last second"
    assert (still.where, still.value) == ("joint_2 from the first record", 0.0)
    with warnings.catch_warnings():  # no limit, no verdict
        warnings.simplefilter("error")
        checks(results, "gravity")


def test_what_was_open_in_the_static_state_is_no_residual(tmp_path: Path) -> None:
    # Own weight opens the joint by 0.5 mm everywhere, the motion by as much more as before.
    found = measures.joint_measures(write_joint(tmp_path / "r.h5", ajar=5e-4))["joint_1"]
    assert found["opening_static"] == pytest.approx(5e-4)
    assert found["opening_max"] == pytest.approx(3.5e-3)
    assert found["opening_residual"] == pytest.approx(1e-3)


def test_sliding_is_unknown_without_status(tmp_path: Path) -> None:
    found = measures.joint_measures(write_joint(tmp_path / "r.h5", status=False))["joint_1"]
    assert np.isnan(found["share_sliding"])
    assert found["share_open"] == pytest.approx(5 / 40)  # by tractions


def test_stress_extremes(tmp_path: Path) -> None:
    columns = np.array([[3e6, -1e6, 2e6, -2e6, 1e6, -3e6], [5e6, -4e6, *[np.nan] * 4]])
    with ResultsWriter(tmp_path / "r.h5", {}) as writer:
        declare_envelopes(writer, [0, 1], np.zeros((2, 3)), np.zeros((2, 3)))
        writer.start()
        writer.append("envelopes", 1.0, dict(zip(ENVELOPE_NAMES, columns.T, strict=True)))
    assert measures.stress_extremes(Results(tmp_path / "r.h5")) == {
        "principal_max": 5e6,
        "principal_min": -4e6,
        "arch_max": 2e6,
        "arch_min": -2e6,
        "cantilever_max": 1e6,
        "cantilever_min": -3e6,
    }


def test_what_a_file_does_not_hold_is_named(tmp_path: Path) -> None:
    with ResultsWriter(tmp_path / "old.h5", {}) as writer:
        declare_histories(writer, [[0.0, 0.0, 0.0]])
        writer.start()
    results = Results(tmp_path / "old.h5")
    with pytest.raises(ResultsError, match="No series 'acceleration'"):
        measures.acceleration_history(results, 0, "x")
    with pytest.raises(ResultsError, match="No series 'ground_acceleration'"):
        measures.strong_motion_end(results)
    with pytest.raises(ValueError, match="at 2 or more increasing times are needed"):
        measures.fourier_peaks(results, 0, "x")


def test_a_continued_run_counts_from_its_static_state(tmp_path: Path) -> None:
    # 2 mm in the static state; the run goes on from 5 mm, where another one had ended.
    points = [[0.0, 0.0, 1.0]]
    with ResultsWriter(tmp_path / "r.h5", {"point_names": ["crest"]}) as writer:
        declare_histories(writer, points)
        declare_static_stages(writer, points, np.zeros((1, 3)), {})
        writer.start()
        stage = {"name": stage_bytes("weight"), "load_time": 0.0, "displacement": np.zeros((1, 3))}
        writer.append("statics", 1, stage | {"point_displacement": [[2e-3, 0.0, 0.0]]})
        for row, u in enumerate((5e-3, 6e-3)):
            shares = dict.fromkeys(SHARES, 0.0)
            record = {"displacement": [[u, 0.0, 0.0]], "iterations": 1}
            writer.append("histories", float(row), record | shares)
    with Results(tmp_path / "r.h5") as results:
        _, u = measures.displacement_history(results, "crest", "x")
    np.testing.assert_allclose(u, [3e-3, 4e-3], rtol=1e-12)
