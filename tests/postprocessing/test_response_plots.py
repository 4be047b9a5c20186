# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of the response: what stands on the axes of a crest in free vibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.postprocessing import response_plots
from dolfinx_joints.results.layout import declare_histories, declare_states
from dolfinx_joints.results.reader import Results
from dolfinx_joints.results.writer import ResultsWriter

pytest.importorskip("matplotlib")

DT, RATIO = 0.005, 0.02
AREAS, OPENING = [1.0, 3.0], 1e-3 * np.array([[0.0, 1.0], [4.0, 2.0], [0.0, 3.0]])


def write_run(path: Path, *, frequency: float = 5.0, joints: int = 2) -> Results:
    """4 s: a crest that decays at a frequency [Hz], on ground with 0.1 g throughout in x."""
    time = DT * np.arange(801)
    omega = 2 * np.pi * frequency
    u = 0.01 * np.exp(-RATIO * omega * time) * np.cos(omega * time)
    arrays = {
        "points": [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]],
        "frames": np.tile(np.eye(3), (2, 1, 1)),
        "areas": AREAS,
        "facet": [0, 1],
    }
    names = [f"joint_{i + 1}" for i in range(joints)]
    with ResultsWriter(path, {"point_names": ["crest"]}) as writer:
        declare_histories(writer, [[0.0, 0.0, 8.0]], accelerations=True)
        declare_states(writer, np.zeros((3, 3)), [[0, 1, 2]], dict.fromkeys(names, arrays))
        writer.start()
        for t, x in zip(time, u, strict=True):
            values = {"displacement": [[x, 0, 0]], "acceleration": [[0, 0, 0]], "iterations": 1}
            values["ground_acceleration"] = [0.1 * STANDARD_GRAVITY, 0, 0]
            writer.append(
                "histories", t, values | {f"joint_{s}": 0 for s in ("open", "stick", "slip")}
            )
        for row, opened in enumerate(OPENING):
            values = {"displacement": np.zeros((3, 3))}
            for i, name in enumerate(names):
                gap = np.zeros((2, 3))
                gap[:, 0], gap[:, 1] = (i + 1) * opened, row * 1e-3
                values |= {f"joints/{name}/gap": gap, f"joints/{name}/traction": 0 * gap}
            writer.append("states", 2.0 * row, values)
    return Results(path)


@pytest.fixture
def results(tmp_path: Path) -> Results:
    return write_run(tmp_path / "run.h5")


def test_response_spectra(results: Results, tmp_path: Path) -> None:
    # A step of 0.1 g throws an undamped oscillator to twice its static deflection. The point moves
    # with the ground as far as its acceleration is concerned, but for the first half step.
    ax = response_plots.response_spectra(
        results,
        "crest",
        "x",
        damping_ratio=0.0,
        periods=[0.5, 1.0],
        reference=write_run(tmp_path / "linear.h5"),
    )
    lines = {str(line.get_label()): np.asarray(line.get_ydata()) for line in ax.get_lines()}
    assert list(lines) == ["linear", "with joints", "ground"]
    for values in lines.values():
        np.testing.assert_allclose(values, 0.2, rtol=1e-3)
    assert ax.get_xlabel() == "period [s]"
    assert ax.get_ylabel() == "pseudo-acceleration x [g]"
    assert ax.get_title(loc="left") == "crest: response spectra in x, 0% damping"


def test_spectrogram_is_followed_by_a_line(results: Results) -> None:
    ax = response_plots.displacement_spectrogram(results, 0, "x", window=2.0, label="with joints")
    (line,) = ax.get_lines()
    frequency = np.asarray(line.get_ydata())
    np.testing.assert_allclose(frequency[np.isfinite(frequency)], 5.0, rtol=1e-3)
    assert np.asarray(line.get_xdata())[[0, -1]] == pytest.approx([1.0, 3.0], abs=0.05)
    # Once a window starts, the mean amplitude in it lies between its ends'.
    most = ax.collections[0].get_array().max(axis=0)[0]
    assert 10.0 * np.exp(-RATIO * 2 * np.pi * 5.0 * 2.0) < most < 10.0
    assert ax.get_title(loc="left") == "crest, with joints: displacement x, window 2 s"
    assert ax.get_ylim() == (0.0, 12.0)
    assert ax.figure.axes[-1].get_ylabel() == "amplitude [$10^{-3}$ m]"


@pytest.mark.parametrize(("quantity", "values"), [("frequency", (4.0, 5.0)), ("damping", (2, 2))])
def test_effective_frequency_and_damping(
    results: Results, tmp_path: Path, quantity: str, values: tuple[float, float]
) -> None:
    other = write_run(tmp_path / "slow.h5", frequency=4.0)
    ax = response_plots.effective_frequency(
        results, "crest", "x", quantity=quantity, reference=other
    )
    lines = [line for line in ax.get_lines() if len(np.asarray(line.get_xdata())) > 2]
    assert [line.get_label() for line in lines] == ["linear", "with joints"]
    for line, value in zip(lines, values, strict=True):
        np.testing.assert_allclose(np.asarray(line.get_ydata()), value, rtol=0.01)
    unit = "[Hz]" if quantity == "frequency" else "[%]"
    assert ax.get_ylabel().endswith(unit)
    alone = response_plots.effective_frequency(results, "crest", "x", quantity=quantity)
    assert alone.get_legend() is None
    (line,) = (line for line in alone.get_lines() if len(np.asarray(line.get_xdata())) > 2)
    np.testing.assert_allclose(np.asarray(line.get_ydata()), values[1], rtol=0.01)


def test_joint_motion_shows_the_largest_of_each_joint(results: Results) -> None:
    ax = response_plots.joint_motion(results)
    first, second = ax.get_lines()
    np.testing.assert_allclose(np.asarray(first.get_ydata()), [1.0, 4.0, 3.0])
    np.testing.assert_allclose(np.asarray(second.get_ydata()), [2.0, 8.0, 6.0])
    assert [line.get_label() for line in (first, second)] == ["1: 4", "2: 8"]
    assert ax.get_ylabel() == "largest opening [$10^{-3}$ m]"
    (slip,) = response_plots.joint_motion(results, "slip", joints=["joint_2"]).get_lines()
    np.testing.assert_allclose(np.asarray(slip.get_ydata()), [0.0, 1.0, 2.0])


def test_wrong_requests_are_refused(results: Results, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="quantity is 'gap'; it must be one of opening, slip"):
        response_plots.joint_motion(results, "gap")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'period'; it must be one of frequency, damping"):
        response_plots.effective_frequency(results, 0, "x", quantity="period")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="holds no joints to draw"):
        response_plots.joint_motion(write_run(tmp_path / "whole.h5", joints=0))
