# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generated options of solvers, schemes, steps, monitors, checkpoints and studies."""

from __future__ import annotations

from typing import Any

import pytest
from generated_input import answer, cheap, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, numbers, passed_on, shared

import dolfinx_joints as dj
from dolfinx_joints.study import Study

PATH = st.sampled_from(["out.h5", "folder/out.h5"])
COUNT, FLAG = st.integers(-1, 20), st.booleans()
NAMED = st.dictionaries(st.text(max_size=4), JUNK, max_size=2)
PLACES = st.dictionaries(
    st.sampled_from(["crest", "foot"]),
    st.lists(numbers(1.0, -3.0), min_size=2, max_size=3),
    min_size=1,
)


def case(folder: Any, *, a: Any = 0.0, b: Any = 1.0) -> dict[str, Any]:
    """What a study runs."""
    return {}


CASES = st.dictionaries(
    st.sampled_from(["one", "two=2"]), st.dictionaries(st.sampled_from("ab"), numbers(1.0))
)
DOORS: dict[str, tuple[Any, Any, Any]] = {
    "Newmark": (dj.Newmark, {}, {"beta": numbers(0.25), "gamma": numbers(0.5)}),
    "HilberHughesTaylor": (dj.HilberHughesTaylor, {}, {"alpha": numbers(0.1)}),
    "GeneralizedAlpha": (dj.GeneralizedAlpha, {}, {"spectral_radius": numbers(0.8)}),
    "StepControl": (
        dj.StepControl,
        {},
        {"max_halvings": COUNT, "tolerance": st.none() | numbers(0.01), "landing": FLAG},
    ),
    "SolverOptions": (
        dj.SolverOptions,
        {},
        {
            "relative_tolerance": numbers(1e-10),
            "max_iterations": COUNT,
            "max_cuts": COUNT,
            "linear": st.sampled_from(["auto", "direct", "mumps", "iterative"]),
            "compliance": st.sampled_from(["auto", "dense", "compressed", "free"]),
            "linear_options": st.none() | st.just({"mat_mumps_icntl_14": 50}) | NAMED,
        },
    ),
    "ResultsMonitor": (
        dj.ResultsMonitor,
        {"path": PATH, "points": PLACES},
        {
            "every": COUNT,
            "metadata": st.none() | NAMED,
            "overwrite": FLAG,
            "envelopes": FLAG | st.just(["base"]),
            "resultants": FLAG,
        },
    ),
    "FieldMonitor": (dj.FieldMonitor, {"path": PATH}, {"every": COUNT}),
    "ProgressMonitor": (dj.ProgressMonitor, {}, {"label": st.text()}),
    "Checkpoints": (dj.Checkpoints, {"path": PATH}, {"every": COUNT, "overwrite": FLAG}),
    "Study": (
        Study,
        {
            "path": PATH,
            "function": st.just(case),
            "cases": CASES | st.dictionaries(st.text(max_size=3), NAMED, max_size=2),
        },
        {},
    ),
}


@pytest.mark.parametrize("name", DOORS)
@shared(cheap(), len(DOORS))
@given(data=st.data())
def test_options(name: str, data: Any) -> None:
    kind, needed, optional = DOORS[name]
    given = data.draw(arguments(needed, optional))
    answer(name, passed_on(lambda: kind(**given)))


@shared(costly(), 3)
@given(
    arguments(
        {},
        {
            "workers": st.just(1),
            "only": st.none() | st.just([]),
            "retry_failed": FLAG,
            "rerun_changed": FLAG,
            "progress": st.just(False),
        },
    )
)
def test_study_run(tmp_path_factory: pytest.TempPathFactory, given: dict[str, Any]) -> None:
    study = Study(tmp_path_factory.getbasetemp() / "study", case, {})
    answer("Study.run", passed_on(lambda: study.run(**given)))
