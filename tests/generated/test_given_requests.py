# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Requests to a results file: names, times, quantities and windows that it may not hold."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from generated_input import answer, costly, one_of_many
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, passed_on
from runs import STEPS
from sentences import one_sentence

pytest.importorskip("dolfinx")

from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing import resultants
from dolfinx_joints import study_table
from dolfinx_joints.postprocessing import csv_tables as tables
from dolfinx_joints.results.reader import Results, describe
from dolfinx_joints.results.overview import overview

Options = dict[str, st.SearchStrategy[Any]]

names = st.sampled_from(
    ("top", "middle", "joint_1", "joint_9", "", "/", ".", "..", "histories/..", "states")
)
joints = st.just("joint_1") | names
streams = st.sampled_from(("histories", "states", "energy", "envelopes", "resultants")) | names
series = st.sampled_from(("displacement", "acceleration", "iterations")) | names
points = st.sampled_from(("top", "middle", 0, 1)) | st.sampled_from((2, -1, "third"))
components = st.sampled_from(("x", "y", "z")) | st.sampled_from(("w", "xy", "X", ""))
times = st.floats(-1.0, 1.0)
whole = st.none() | st.integers(-STEPS, STEPS)
rows = whole.filter(lambda n: n is not None) | st.builds(slice, whole, whole, whole)
windows = st.floats(0.05, 0.18) | st.floats(0.0, 0.3)
bands = st.none() | st.tuples(st.floats(0, 50), st.floats(0, 150))

# Every function is handed the results first.
CHEAP: dict[Callable[..., Any], Options] = {
    Results.series: {"stream": streams, "name": series, "index": rows},
    Results.time: {"stream": streams},
    Results.static: {"name": st.sampled_from(("mesh/nodes", "joints/joint_1/areas")) | names},
    Results.nearest: {"stream": streams, "time": times},
    Results.point_index: {"point": points},
    Results.law: {"joint": joints},
    measures.displacement_history: {
        "point": points,
        "component": components,
        "absolute": st.booleans(),
    },
    measures.acceleration_history: {
        "point": points,
        "component": components,
        "absolute": st.booleans(),
    },
    measures.joint_history: {"joint": joints},
    resultants.joint_resultants: {
        "joint": joints,
        "friction_angle_deg": st.none() | st.floats(-5.0, 95.0),
    },
}
COSTLY: dict[Callable[..., Any], Options] = {
    measures.fourier_peaks: {
        "point": points,
        "component": components,
        "below": st.none() | st.floats(-1.0, 200.0),
    },
    measures.effective_period: {
        "point": points,
        "component": components,
        "window": windows,
        "band": bands,
        "hop": st.none() | windows,
    },
    measures.peaks: {"point": points, "strong_until": times},
    measures.joint_measures: {"tail": times},
    measures.summary_row: {"strong_until": st.none() | times},
}


def ask(function: Callable[..., Any], results: Any, options: dict[str, Any]) -> None:
    door = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"
    answer(door, one_sentence(passed_on(lambda: function(results, **options))))


@pytest.mark.parametrize("function", CHEAP, ids=lambda function: function.__qualname__)
@one_of_many()
@given(data=st.data())
def test_requests(function: Callable[..., Any], results: Results, data: st.DataObject) -> None:
    ask(function, results, data.draw(arguments(CHEAP[function])))


@pytest.mark.parametrize("function", COSTLY, ids=lambda function: function.__name__)
@costly()
@given(data=st.data())
def test_larger_requests(
    function: Callable[..., Any], results: Results, data: st.DataObject
) -> None:
    ask(function, results, data.draw(arguments(COSTLY[function])))


NO_RESULTS = JUNK | st.sampled_from(("run.h5", Path("run.h5")))
ANY_RUN: list[tuple[Callable[..., Any], dict[str, Any]]] = [
    (measures.displacement_history, {"point": 0, "component": "x"}),
    (measures.acceleration_history, {"point": 0, "component": "x"}),
    (measures.fourier_peaks, {"point": 0, "component": "x"}),
    (measures.effective_period, {"point": 0, "component": "x"}),
    (measures.peaks, {"point": 0, "strong_until": 1.0}),
    (measures.strong_motion_end, {}),
    (measures.joint_history, {"joint": "joint_1"}),
    (measures.joint_measures, {}),
    (measures.all_joints, {}),
    (measures.stress_extremes, {}),
    (measures.summary_row, {}),
    (resultants.joint_resultants, {"joint": "joint_1"}),
    (resultants.block_resultants, {}),
    (resultants.resultant_measures, {}),
    (tables.tables_of, {}),
]


@one_of_many()
@given(junk=NO_RESULTS, which=st.sampled_from(ANY_RUN))
def test_what_is_no_results_file(junk: Any, which: tuple[Callable[..., Any], Any]) -> None:
    function, options = which
    door = "measures of what is no results file"
    made = answer(door, one_sentence(passed_on(lambda: function(junk, **options))))
    assert made is None


@one_of_many()
@given(path=JUNK, which=st.sampled_from((Results, describe, overview, study_table.read_table)))
def test_paths(folder: Path, path: Any, which: Callable[[Any], Any]) -> None:
    assert answer("paths to read", one_sentence(passed_on(lambda: which(path)))) is None


def is_inside(path: Any) -> bool:
    """Whether what is written to a path stays in the working folder."""
    text = os.fspath(path) if isinstance(path, os.PathLike) else path
    return not isinstance(text, str) or not text.startswith(("/", "..", "~"))


@costly()
@given(
    out=st.sampled_from(("a", "a/b", "", ".", "\n", "a" * 300, "file")) | JUNK.filter(is_inside),
    overwrite=st.booleans() | JUNK,
)
def test_folders_of_tables(folder: Path, results: Results, out: Any, overwrite: Any) -> None:
    (folder / "file").touch()
    call = one_sentence(passed_on(lambda: tables.write_csv(results, out, overwrite=overwrite)))
    answer("tables.write_csv", call)
    whole = {path.name for path in folder.rglob("*") if path.is_file()} - {"file"}
    assert whole == set() or "histories.csv" in whole
    assert not any(name.endswith(".part") for name in whole)
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
