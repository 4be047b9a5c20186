# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions made of arrays, spectra and targets: any array, any parameter.

Whatever is taken gives finite numbers; a target that is taken is matched within the tolerance.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from generated_input import answer, cheap, one_of_many
from hypothesis import given, note
from hypothesis import strategies as st
from mutations import SEEDS, mostly

from dolfinx_joints.motions import spectra
from dolfinx_joints.motions.motion import Motion, synthetic_motion
from dolfinx_joints.motions.spectrum_matching import match_spectrum

MOTION = synthetic_motion(duration=2.0, dt=0.02, band=(1.0, 10.0))
WAVE = MOTION.acceleration[:, 0]
ODD = (
    *(np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e-320, 1e-200, 1e150, 1.7e308, 10**400, 2**63),
    *(
        "0.1",
        "x",
        "",
        b"1",
        None,
        True,
        1j,
        [],
        [1.0],
        {},
        np.array([0.1]),
        np.array(0.1),
        object(),
    ),
    *(np.float32(0.1), np.complex128(1), np.int8(1), np.bool_(True), Fraction(1, 10), len, 7, 1e9),
)
NUMBERS = st.sampled_from(ODD) | st.floats() | st.integers() | st.floats(0.001, 30.0)


def changed_array(seed: int, good: np.ndarray) -> Any:
    """An array with a value, its type or its shape changed, or none at all."""
    rng = random.Random(seed)
    array: Any = good.copy()
    match rng.randrange(7):
        case 0:
            array = array.astype(rng.choice(("c16", "U8", "S8", "f4", "i4", "?", "M8[s]", "O")))
        case 1:
            array = array.astype(object)
            array[(0,) * array.ndim] = rng.choice(ODD)
        case 2:
            array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, 1e308, 1e-320, -1))
        case 3:
            array = array * rng.choice((0.0, 1e-300, 1e-160, 1e3, 1e100, 1e160, -1.0))
        case 4:
            array = rng.choice((array.T, array[:1], array[:0], array[:2], array[None], array[::-1]))
        case 5:
            rows = array.tolist()
            array = rng.choice((rows, tuple(rows), [*rows, 1.0, []], iter(rows), np.ma.array(rows)))
        case _:
            array = rng.choice((*ODD, "text", np.zeros((3, 0)), np.zeros(5, dtype="f8,i4")))
    note(repr(array))
    return array


def finite(found: Any) -> None:
    """All numbers that were answered are finite."""
    if isinstance(found, Motion):
        found = (found.acceleration, found.dt, *found.integrated())
    for each in found if isinstance(found, tuple) else () if found is None else (found,):
        assert np.isfinite(np.asarray(each, dtype=np.float64)).all(), each


@cheap()
@given(seed=SEEDS, step=mostly((0.02, 0.005), NUMBERS), name=mostly(("a",), NUMBERS))
def test_motions_of_arrays(seed: int, step: Any, name: Any) -> None:
    array = changed_array(seed, MOTION.acceleration)
    finite(answer("motion of an array", lambda: Motion(acceleration=array, dt=step, name=name)))


SPECTRA: dict[str, Callable[..., Any]] = {
    "response_spectrum": lambda a, dt, one, two: spectra.response_spectrum(a, dt, one, two),
    "response_history": lambda a, dt, one, two: spectra.response_history(a, dt, one, two),
    "periods": lambda a, dt, one, two: spectra.response_spectrum(a, dt, [one, two], 0.05),
    "fourier_amplitude": lambda a, dt, *_: spectra.fourier_amplitude(a, dt),
    "arias_intensity": lambda a, dt, *_: spectra.arias_intensity(a, dt),
    "significant_duration": lambda a, dt, one, two: spectra.significant_duration(
        a, dt, lower=two, upper=one
    ),
    "spectrogram": lambda a, dt, one, two: spectra.spectrogram(a, dt, one, hop=two),
    "running_frequency": lambda a, dt, one, two: spectra.running_frequency(
        a, dt, 0.5, band=(one, two)
    )[0],
    "windows": lambda a, dt, one, two: spectra.windows(a, dt, one, two),
    "equally_spaced": lambda a, dt, one, two: spectra.equally_spaced(
        [0, 0.1, one, two], a[:4] if a is WAVE else a
    ),
}


@pytest.mark.parametrize("name", SPECTRA)
@one_of_many()
@given(
    seed=mostly((None,), SEEDS),
    dt=mostly((0.02,), NUMBERS),
    one=mostly((0.5, 1.0), NUMBERS),
    two=mostly((0.05, 0.7, None), NUMBERS),
)
def test_spectra(name: str, seed: int | None, dt: Any, one: Any, two: Any) -> None:
    array = WAVE if seed is None else changed_array(seed, WAVE)
    finite(answer(f"spectra, {name}", lambda: SPECTRA[name](array, dt, one, two)))


TARGET = np.array([[0.21, 0.3, 0.49], [4.0, 6.0, 5.0]])


@cheap()
@given(
    seeds=mostly(((None, None),), st.tuples(SEEDS, SEEDS)),
    components=mostly(("x", "y"), st.sampled_from(("xyz", "xx", "w", "", None, 1, ["x"]))),
    ratio=mostly((0.05,), NUMBERS),
    tolerance=mostly((0.5,), NUMBERS),
    rounds=mostly((1,), st.sampled_from((2, 0, -1, 1.0, np.nan, True, "1", None, 1j, np.int8(3)))),
)
def test_targets(seeds: Any, components: Any, ratio: Any, tolerance: Any, rounds: Any) -> None:
    target = tuple(
        values if seed is None else changed_array(seed, values)
        for seed, values in zip(seeds, TARGET, strict=True)
    )
    options = {"damping_ratio": ratio, "tolerance": tolerance, "rounds": rounds}
    found = answer(
        "matching targets", lambda: match_spectrum(MOTION, target, components=components, **options)
    )
    if found is not None:
        assert np.abs(found.misfit).max() <= 1.001 * found.tolerance
        assert np.isfinite(found.motion.acceleration).all()
