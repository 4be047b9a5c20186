# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures, pictures in space and reports that cannot be drawn as they are asked for."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_input import answer, costly
from hypothesis import given
from hypothesis import strategies as st
from junk import JUNK, arguments, passed_on
from sentences import one_sentence
from test_given_requests import Options, bands, components, joints, points, times

pytest.importorskip("matplotlib")

import dolfinx_joints as dj
from dolfinx_joints.postprocessing import motion_plots
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.postprocessing import rendering
from dolfinx_joints.report import report
from dolfinx_joints.postprocessing import response_plots
from dolfinx_joints.results.reader import Results

REFUSALS = (ValueError, dj.JointsError)

axes = st.none() | st.builds(plots.new_axes)
labels = st.just(("one", "other")) | st.tuples(st.text(max_size=3), st.text(max_size=3))
damping = st.floats(0.0, 0.3) | st.floats(-0.1, 1.1)
periods = st.none() | st.lists(st.floats(0.01, 4.0), max_size=4)
windows = st.floats(0.05, 0.18) | st.floats(0.0, 0.3)
maxima = st.floats(1.0, 100.0) | st.floats(-1.0, 1e3)
chosen: Options = {"time": st.none() | times, "index": st.integers(-10, 10)}
of_point: Options = {"point": points, "component": components, "ax": axes}
two_runs: Options = {**of_point, "labels": labels}
kinds = st.sampled_from(("normal", "tangential", "ratio")) | st.sampled_from(("tractions", "state"))

FIGURES: dict[Callable[..., Any], Options] = {
    plots.history: two_runs,
    plots.fourier: {**two_runs, "max_frequency": maxima},
    plots.joint_traction: {"joint": joints, "quantity": kinds, "ax": axes, **chosen},
    plots.traction_profile: {
        "joint": joints,
        "quantity": st.sampled_from(("tractions", "ratio")) | kinds,
        "position": st.floats(0.0, 1.0) | st.floats(-1.0, 2.0),
        "ax": axes,
        **chosen,
    },
    plots.energies: {"ax": axes},
    plots.joint_states: {"ax": axes},
    response_plots.response_spectra: {**two_runs, "damping_ratio": damping, "periods": periods},
    response_plots.displacement_spectrogram: {
        **of_point,
        "window": windows,
        "max_frequency": maxima,
        "label": st.text(max_size=3),
    },
    response_plots.effective_frequency: {
        **two_runs,
        "quantity": st.sampled_from(("frequency", "damping")),
        "window": windows,
        "band": bands,
    },
    response_plots.joint_motion: {
        "quantity": st.sampled_from(("opening", "slip")),
        "joints": st.none() | st.lists(joints, max_size=2),
        "ax": axes,
    },
}

MOTION = dj.synthetic_motion(duration=2.0, dt=0.01)
MOTIONS: dict[Callable[..., Any], Options] = {
    motion_plots.history: {
        "component": components,
        "quantity": st.sampled_from(("acceleration", "velocity", "displacement")),
        "ax": axes,
        "reference": st.none() | st.just(MOTION),
        "labels": labels,
    },
    motion_plots.response_spectra: {
        "components": st.sampled_from(("xyz", "x", "zy")) | st.text(max_size=3),
        "damping_ratio": damping,
        "periods": periods,
        "target": st.none()
        | st.just(([0.1, 1.0], [1.0, 2.0]))
        | st.tuples(
            st.lists(st.floats(0.01, 4.0), max_size=2), st.lists(st.floats(0, 9), max_size=2)
        ),
        "ax": axes,
        "reference": st.none() | st.just(MOTION),
        "reference_label": st.text(max_size=3),
    },
}

angles = st.floats(-720.0, 720.0)
elevations = st.floats(-90.0, 90.0) | st.floats(-200.0, 200.0)
eyes: Options = {"azimuths_deg": st.lists(angles, max_size=3), "elevation_deg": elevations}
eye: Options = {"azimuth_deg": angles, "elevation_deg": elevations}
VIEWS: dict[str, Options] = {
    "mesh": eyes,
    "deformed": {**chosen, **eye, "scale": st.none() | st.floats(-100.0, 100.0)},
    "joint_map": {
        "quantity": kinds | st.sampled_from(("opening", "slip", "state")),
        "joint": st.none() | joints,
        "turned": st.booleans(),
        **chosen,
        **eye,
    },
    "envelope": {"name": st.sampled_from(("principal_max", "arch_min", "arch")), **eyes},
}


def draw(function: Callable[..., Any], first: Any, options: dict[str, Any]) -> None:
    door = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
    answer(door, one_sentence(passed_on(lambda: function(first, **options)), REFUSALS), REFUSALS)


@pytest.mark.parametrize("function", FIGURES, ids=lambda function: function.__name__)
@costly()
@given(data=st.data())
def test_figures(function: Callable[..., Any], results: Results, data: st.DataObject) -> None:
    draw(function, results, data.draw(arguments(FIGURES[function])))


@pytest.mark.parametrize("function", MOTIONS, ids=lambda function: function.__name__)
@costly()
@given(data=st.data())
def test_figures_of_motions(function: Callable[..., Any], data: st.DataObject) -> None:
    draw(function, MOTION, data.draw(arguments(MOTIONS[function])))


@pytest.mark.parametrize("name", VIEWS)
@costly()
@given(data=st.data())
def test_views(
    name: str, results: Results, monkeypatch: pytest.MonkeyPatch, data: st.DataObject
) -> None:
    pytest.importorskip("pyvista")
    from dolfinx_joints.postprocessing import views

    # VTK itself is not asked: it takes long, and gets what was checked.
    blank = np.zeros((2, 2, 3), dtype=np.uint8)
    monkeypatch.setattr(rendering.Scene, "render", lambda *_, **__: blank)
    draw(getattr(views, name), results, data.draw(arguments(VIEWS[name])))


FIRST_ARGUMENT = (
    (plots.history, {"point": 0, "component": "x"}),
    (plots.fourier, {"point": 0, "component": "x"}),
    (plots.joint_traction, {"joint": "joint_1"}),
    (plots.traction_profile, {"joint": "joint_1"}),
    (plots.energies, {}),
    (plots.joint_states, {}),
    (response_plots.response_spectra, {"point": 0, "component": "x"}),
    (response_plots.displacement_spectrogram, {"point": 0, "component": "x"}),
    (response_plots.effective_frequency, {"point": 0, "component": "x"}),
    (response_plots.joint_motion, {}),
    (motion_plots.history, {"component": "x"}),
    (motion_plots.response_spectra, {}),
    (motion_plots.spectrum_match, {}),
)


@costly()
@given(junk=JUNK, which=st.sampled_from(FIRST_ARGUMENT))
def test_figures_of_nothing(junk: Any, which: tuple[Callable[..., Any], Any]) -> None:
    function, options = which
    call = one_sentence(passed_on(lambda: function(junk, **options)), REFUSALS)
    assert answer("figures of nothing", call, REFUSALS) is None


ENDINGS = (
    "a.png",
    "a.pdf",
    "A.SVG",
    "a.xyz",
    "a",
    ".png",
    "no/a.png",
    "/proc/a.png",
    "a" * 300 + ".png",
)


@costly()
@given(options=arguments({"path": st.sampled_from(ENDINGS), "dpi": st.integers(5, 60)}))
def test_figures_saved(folder: Path, options: dict[str, Any]) -> None:
    figure = plots.new_axes(width=1.0, height=1.0).figure
    call = one_sentence(passed_on(lambda: plots.save(figure, **options)), REFUSALS)
    made = answer("plots.save", call, REFUSALS)
    assert [path.name for path in folder.iterdir()] == ([] if made is None else [made.name])
    for path in folder.iterdir():
        path.unlink()


@costly()
@given(
    options=arguments(
        {
            "results": st.just(["RUN"])
            | st.lists(st.sampled_from(("RUN", "none.h5", "text.h5", "")), max_size=2),
            "out": st.sampled_from(("r.html", "r.htm", "r.txt", "", "no/r.html", "/proc/r.html")),
            "with_3d": st.just(False),
        },
        junk=JUNK.filter(lambda value: value is not True),
    )
)
def test_reports(folder: Path, results: Results, options: dict[str, Any]) -> None:
    (folder / "text.h5").write_text("no HDF5")
    files = options.pop("results")
    if isinstance(files, list):
        files = [results.path if name == "RUN" else name for name in files]
    call = one_sentence(passed_on(lambda: report.write(files, **options)), REFUSALS)
    made = answer("report.write", call, REFUSALS)
    left = {path.name for path in folder.rglob("*") if path.is_file()} - {"text.h5"}
    assert made is not None or left == set(), left
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
