# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated ground motions and parameters of what is done with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from generated_input import answer, cheap, costly
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from junk import JUNK, arguments, numbers, passed_on, shared

import dolfinx_joints as dj
from dolfinx_joints.motions.spectrum_matching import match_spectrum

MOTION = dj.synthetic_motion(duration=4.0, dt=0.02, band=(0.5, 10.0))
SAMPLES = npst.arrays("f8", st.tuples(st.integers(1, 5), st.sampled_from([3, 3, 2])))


@shared(cheap(), 4)
@given(arguments({"acceleration": SAMPLES, "dt": numbers(0.01)}, {"name": st.text(max_size=3)}))
def test_motion(given: dict[str, Any]) -> None:
    made = answer("Motion", passed_on(lambda: dj.Motion(**given)))
    if made is not None:
        assert np.isfinite(made.acceleration).all()
        assert made(0.5 * made.duration).shape == (3,)


@shared(cheap(), 4)
@given(
    arguments(
        {},
        {
            "seed": st.integers(0, 5),
            "duration": st.sampled_from([4.0, 2.5, 1e-30, 1e30, 1e300]),
            "dt": st.sampled_from([0.02, 0.025, 1e-30, 1e30, 1e-300]),
            "peaks_g": st.sampled_from([(0.1, 0.2, 0.3), [0.0, 0.0, 1.0]]),
            "band": st.sampled_from([(1.0, 10.0), [0.5, 20.0], (5.0, 2.0)]),
        },
    )
)
def test_synthetic_motion(given: dict[str, Any]) -> None:
    made = answer("synthetic_motion", passed_on(lambda: dj.synthetic_motion(**given)))
    if made is not None:
        assert np.isfinite(made.acceleration).all()


METHODS: dict[str, tuple[Any, Any]] = {
    "rotated": ({"angle_deg": numbers(30.0, 90.0)}, {}),
    "resampled": ({"dt": st.sampled_from([0.01, 0.03, 0.02, 1e-9, 1e9])}, {}),
    "trimmed": ({"duration": numbers(1.0)}, {"start": numbers(0.0, 0.5)}),
    "baseline_corrected": ({}, {"degree": st.integers(-1, 8)}),
    "band_passed": (
        {"low": st.none() | numbers(0.5)},
        {"high": st.none() | numbers(10.0), "order": st.integers(-1, 10)},
    ),
    "tapered": ({"seconds": st.none() | numbers(0.5)}, {"fraction": st.none() | numbers(0.1)}),
    "scaled": ({"factor": numbers(2.0) | st.tuples(*[numbers(1.0)] * 3)}, {}),
    "__call__": ({"time": numbers(0.5)}, {}),
}


@pytest.mark.parametrize("name", METHODS)
@shared(cheap(), len(METHODS))
@given(data=st.data())
def test_methods_of_motions(name: str, data: Any) -> None:
    given = data.draw(arguments(*METHODS[name]))
    method = getattr(MOTION, name)
    made = answer(f"Motion.{name}", passed_on(lambda: method(**given)))
    if isinstance(made, dj.Motion):
        assert np.isfinite(made.acceleration).all()


TARGET = st.sampled_from([([0.2, 0.5], [3.0, 2.0]), (np.array([0.25, 0.8]), np.array([4.0, 1.0]))])


@shared(costly(), 3)
@given(
    arguments(
        {"motion": st.just(MOTION), "target": TARGET | st.tuples(JUNK, JUNK)},
        {
            "components": st.sampled_from(["x", "xy"]),
            "damping_ratio": numbers(0.05),
            "tolerance": numbers(0.3),
        },
    ).filter(lambda given: len(given) > 2 or given["motion"] is not MOTION)
)
def test_match_spectrum(given: dict[str, Any]) -> None:
    # One round shows that a target is taken; to reach it takes long.
    answer("match_spectrum", passed_on(lambda: match_spectrum(**given, rounds=1)))
