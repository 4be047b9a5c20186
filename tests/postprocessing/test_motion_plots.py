# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures of ground motions: what stands on the axes."""

import numpy as np
import pytest

from dolfinx_joints.common.constants import STANDARD_GRAVITY
from dolfinx_joints.motions.motion import Motion
from dolfinx_joints.motions.spectra import response_spectrum
from dolfinx_joints.motions.spectrum_matching import match_spectrum
from dolfinx_joints.postprocessing import motion_plots

pytest.importorskip("matplotlib")

TIME = 0.005 * np.arange(4001)
# 0.1 g in x at 2 Hz, an offset of 0.01 g in y, nothing in z.
MOTION = Motion(
    acceleration=STANDARD_GRAVITY
    * np.stack([0.1 * np.sin(4 * np.pi * TIME), 0.01 + 0 * TIME, 0 * TIME], axis=1),
    dt=0.005,
    name="shaking",
)


def test_response_spectra_say_what_they_are() -> None:
    ax = motion_plots.response_spectra(MOTION, periods=[0.03, 0.5, 3.0], components="xy")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "x, stream",
        "y, cross-valley",
    ]
    assert "5% damping" in ax.get_title(loc="left")
    ax = motion_plots.response_spectra(MOTION, periods=[0.5], damping_ratio=0.025)
    assert ax.get_title(loc="left").endswith("spectra, 2.5% damping")


def test_a_target_and_a_reference_stand_beside_them() -> None:
    target = ([0.1, 1.0], [STANDARD_GRAVITY, 2 * STANDARD_GRAVITY])
    ax = motion_plots.response_spectra(
        MOTION, components="x", target=target, reference=MOTION.scaled(2.0), periods=[0.1, 0.5]
    )
    doubled, single, wanted = (np.asarray(line.get_ydata()) for line in ax.get_lines())
    np.testing.assert_allclose(doubled, 2 * single, rtol=1e-12)
    np.testing.assert_allclose(wanted, [1.0, 2.0])


def test_a_match_is_drawn_with_the_band_of_its_tolerance() -> None:
    # Its own spectrum as a target: given, matched and target are one line, 10 % inside the band.
    periods = np.geomspace(0.4, 0.6, 42)
    then = np.append(MOTION.acceleration[:, 0], np.zeros(200))  # spectra are those with rest after
    own = response_spectrum(then, MOTION.dt, periods, 0.05)
    match = match_spectrum(MOTION, (periods, own.pseudo_acceleration), components="x")
    ax = motion_plots.spectrum_match(match)
    expected = own.pseudo_acceleration / STANDARD_GRAVITY
    for line in ax.get_lines():
        np.testing.assert_allclose(line.get_ydata(), expected, rtol=1e-9)
    (band,) = ax.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert [heights.min(), heights.max()] == pytest.approx(
        [0.9 * min(expected), 1.1 * max(expected)]
    )
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["x, as given", "x, stream", "target", "target ± 10%"]


def test_responses_over_frequency_are_sizes_over_a_first_one() -> None:
    given = {"empty": np.array([1.0, 3.0 + 4.0j]), "full": np.array([-1.0j, 2.0])}
    ax = motion_plots.frequency_response([1.0, 3.0], given, first=2.0)
    empty, full = ax.get_lines()
    np.testing.assert_allclose(empty.get_xdata(), [0.5, 1.5])
    np.testing.assert_allclose(empty.get_ydata(), [1.0, 5.0])
    np.testing.assert_allclose(full.get_ydata(), [1.0, 2.0])
    assert [text.get_text() for text in ax.get_legend().get_texts()] == list(given)
    assert ax.get_xlabel() == "f / f₁"
