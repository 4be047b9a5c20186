# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record files of every format: junk, changed good files, and what is asked of their readers.

Whatever is read is a motion: finite, within the largest acceleration that is believed, at equal
positive steps. All else is a RecordError.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_input import answer, cheap
from hypothesis import given
from hypothesis import strategies as st
from mutations import SEEDS, TOKENS, changed_text, junk, mostly
from test_formats import at2, columns, cosmos, esm, knet, smc

from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.reading import read_components, read_record, record_names
from dolfinx_joints.motions.record_text import MAX_PEAK_G, UNITS, Component
from dolfinx_joints.motions.motion import STANDARD_GRAVITY, Motion

GOOD: dict[str, str] = {
    "PEER AT2": at2(),
    "ESM/ITACA": esm(),
    "K-NET": knet(),
    "KiK-net": knet(direction="4"),
    "COSMOS V1": cosmos().replace("Corrected", "Uncorrected", 1),
    "COSMOS V2": cosmos(),
    "SMC": smc(),
    "plain columns": columns(),
}
OTHERS = tuple(GOOD.values())
NUMBERS = st.one_of(
    st.floats(), st.integers(-3, 10**30), st.just(0.01), st.sampled_from(("0.01", None, True, 1j))
)
WORDS = st.sampled_from((*UNITS, "N", "E", "UP", "down", "time", "35", "360", "-1", "", *TOKENS))


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("records")


def put(place: Path, content: bytes, name: str = "file.txt") -> Path:
    path = place / name
    path.write_bytes(content)
    return path


def check(found: list[Component] | None) -> None:
    """What a reader has taken is what it says."""
    for each in found or []:
        assert np.isfinite(each.acceleration).all()
        assert each.acceleration.ndim == 1
        assert len(each.acceleration) >= 2
        assert np.abs(each.acceleration).max() <= MAX_PEAK_G * STANDARD_GRAVITY
        assert 0.0 < each.dt < np.inf
        assert each.direction in (None, "up", "down") or 0.0 <= each.direction < 360.0


@pytest.mark.parametrize("kind", GOOD)
@cheap()
@given(seed=SEEDS)
def test_changed_files(place: Path, kind: str, seed: int) -> None:
    path = put(place, changed_text(seed, GOOD[kind], OTHERS))
    check(answer(f"record, changed {kind}", lambda: read_components(path), RecordError))


@pytest.mark.parametrize("kind", GOOD)
@cheap()
@given(seed=SEEDS)
def test_junk(place: Path, kind: str, seed: int) -> None:
    # At times after as much of a good file as makes a reader believe that it is one of its own.
    path = put(place, junk(seed, GOOD[kind]))
    check(answer(f"record, junk {kind}", lambda: read_components(path), RecordError))


@cheap()
@given(
    kind=mostly(("plain columns",), st.sampled_from(sorted(GOOD))),
    unit=mostly((None, "cm/s^2", "gal", "G", "M/S/S", "cmsec2"), WORDS | NUMBERS),
    dt=mostly((None, 0.01), NUMBERS),
    columns=mostly(
        (None, ("time", "N"), ("time", 35.0), (0, 90)),
        st.lists(WORDS | NUMBERS, max_size=4) | WORDS,
    ),
)
def test_options(place: Path, kind: str, unit: Any, dt: Any, columns: Any) -> None:
    path = put(place, GOOD[kind].replace("# unit: cm/s^2\n# columns: time N\n", "").encode())

    def read() -> list[Component]:
        return read_components(path, unit=unit, dt=dt, columns=columns)

    check(answer("record, options", read))


@cheap()
@given(
    kinds=mostly(
        (("N-S", "E-W", "U-D"), ("4", "5", "6"), ("1", "2", "3"), ("x", "y", "z")),
        st.lists(st.sampled_from(("N-S", "E-W", "U-D", "x")), max_size=4),
    ),
    seeds=mostly(((0, 0, 0, 0),), st.lists(SEEDS, min_size=4, max_size=4)),
    directions=mostly(
        (None, ("N", "E", "UP"), (35, 305, "down")),
        st.lists(WORDS | NUMBERS, max_size=4) | WORDS,
    ),
    azimuth=mostly((None, 0, 20.0, -720), NUMBERS),
)
def test_records_of_several_files(
    place: Path, kinds: Sequence[str], seeds: Sequence[int], directions: Any, azimuth: Any
) -> None:
    paths = []
    for kind, seed, name in zip(kinds, seeds, "abcd", strict=False):
        good = knet(direction=kind)
        paths.append(put(place, changed_text(seed, good) if seed else good.encode(), name))

    def read() -> Motion:
        return read_record(paths, directions=directions, stream_azimuth_deg=azimuth)

    motion = answer("record of several files", read)
    assert motion is None or np.isfinite(motion.acceleration).all()


@cheap()
@given(seed=SEEDS, kind=st.sampled_from(sorted(GOOD)))
def test_names_of_records(place: Path, seed: int, kind: str) -> None:
    # A file that is none, or is broken, must not keep the others from being listed.
    folder = place / "folder"
    folder.mkdir(exist_ok=True)
    put(folder, GOOD["K-NET"].encode(), "good")
    put(folder, changed_text(seed, GOOD[kind]), "other.AT2" if seed % 2 else "other")
    names = answer("names of records", lambda: record_names(folder), RecordError)
    assert "ABC001_20000101_102000" in names
