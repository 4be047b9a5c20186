# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad requests to results files, figures, views, reports and tables, and to mesh files."""

from __future__ import annotations

import atexit
import math
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from bad_input import NO_CHOICE, NO_FLAG, NO_NUMBER, Door, door, without
from generated.runs import write_run
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.postprocessing import motion_plots
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.report import report
from dolfinx_joints.postprocessing import response_plots
from dolfinx_joints import study_table
from dolfinx_joints.postprocessing import views
from dolfinx_joints.common.errors import ResultsError
from dolfinx_joints.postprocessing.resultants import block_resultants, joint_resultants, resultant_measures
from dolfinx_joints.results.reader import Results, describe
from dolfinx_joints.results.overview import overview

NO_PATH = {"number": "7", "nothing": "None", "empty": "''", "bytes": "b'x'", "list": "['run.h5']"}
NO_FILE = {**NO_PATH, "no such file": "'none.h5'"}
NO_RESULTS = {"path": "'run.h5'", "nothing": "None", "number": "7"}
NO_TEXT = {"number": "7", "nothing": "None", "list": "['a']"}
POINT = {
    "unknown": "'heel'",
    "beyond the last": "2",
    "negative": "-1",
    "not whole": "0.5",
    "nothing": "None",
    "list": "[0]",
}
JOINT = {"unknown": "'joint_9'", "empty": "''", "number": "1", "nothing": "None", "list": "['a']"}
NAME = {"unknown": "'speed'", "a path": "'../states'", "number": "1", "nothing": "None"}
TIME = without(NO_NUMBER, "nothing")
POSITIVE = without(NO_NUMBER, zero="0.0", negative="-1.0")
OPTIONAL = without(POSITIVE, "nothing")
INDEX = {"beyond the last": "99", "before the first": "-99", "not whole": "0.5", "text": "'last'"}
WINDOW = {**POSITIVE, "shorter than 8 steps": "0.01", "longer than the run": "10.0"}
BAND = {"number": "5.0", "too short": "(5.0,)", "falling": "(9.0, 1.0)", "negative": "(-1.0, 9.0)"}
BAND |= {"text": "'low'", "not a number": "(math.nan, 9.0)", "complex": "(1.0, 1j)"}
LABELS = {"text": "'run'", "too short": "('run',)", "numbers": "(1, 2)", "nothing": "None"}
AXES = {"text": "'left'", "number": "1", "a figure": "figure"}
DAMPING = without(NO_NUMBER, one="1.0", negative="-0.1")
PERIODS = {"number": "1.0", "empty": "[]", "zero": "[0.0]", "negative": "[-1.0]", "text": "'1 2'"}
PERIODS |= {"not a number": "[math.nan]", "nested": "[[1.0]]", "complex": "[1j]"}
ANGLE = without(NO_NUMBER, out_of_range="1e4")
ELEVATION = without(NO_NUMBER, out_of_range="91.0")
ANGLES = {"number": "0.0", "empty": "[]", "text": "'up'", "texts": "['up']", "too many": "[0] * 9"}


@cache
def names() -> dict[str, Any]:
    """What the rows refer to; the file of results is called by its name alone."""
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    results = Results(write_run(folder, MPI.COMM_SELF))
    results.path = Path("run.h5")
    found: dict[str, Any] = {"dj": dj, "math": math, "np": np, "results": results}
    found |= {"measures": measures, "plots": plots, "response_plots": response_plots}
    found |= {"motion_plots": motion_plots, "views": views, "report": report}
    found |= {"Results": Results, "describe": describe, "overview": overview}
    found |= {"study_table": study_table, "COMM": MPI.COMM_SELF}
    found |= {"joint_resultants": joint_resultants, "block_resultants": block_resultants}
    found |= {"resultant_measures": resultant_measures, "figure": plots.new_axes().figure}
    found |= {"blocks": folder / "blocks.msh", "motion": dj.synthetic_motion(duration=2.0)}
    return found


def readers() -> list[Door]:
    """Methods of results, and what reads whole files."""

    def of(call: str, good: dict[str, str], bad: dict[str, dict[str, str]]) -> Door:
        return door(f"results.{call}", good, bad, names, error=ResultsError)

    steps = {"not whole": "slice(0.5, 2)", "backwards": "slice(None, None, -1)"}
    steps |= {"no step": "slice(None, None, 0)"}
    series = {"stream": "'histories'", "name": "'displacement'"}
    return [
        *(door(call, {}, {"path": NO_FILE}, names) for call in ("Results", "describe", "overview")),
        of("static", {}, {"name": NAME}),
        of("time", {}, {"stream": NAME}),
        of("rows", {}, {"stream": NAME}),
        of("series", series, {"stream": NAME, "name": NAME, "index": INDEX | steps}),
        of("nearest", {"stream": "'states'", "time": "0.1"}, {"stream": NAME, "time": NO_NUMBER}),
        of("point_index", {}, {"point": POINT}),
        of("law", {}, {"joint": JOINT}),
        door("study_table.read_table", {}, {"path": NO_FILE}, names),
        door(
            "study_table.write_csv",
            {"table": "{'a': np.ones(2)}", "path": "'table.csv'"},
            {
                "table": {
                    "nothing": "None",
                    "empty": "{}",
                    "list": "[1.0]",
                    "unlike columns": "{'a': np.ones(2), 'b': np.ones(3)}",
                },
                "path": {**NO_PATH, "no folder": "'nowhere/table.csv'"},
            },
            names,
        ),
        door(
            "dj.write_csv",
            {"results": "results", "folder": "'tables'"},
            {"results": NO_RESULTS, "folder": NO_PATH, "overwrite": NO_FLAG},
            names,
        ),
        door(
            "dj.read_msh",
            {"path": "blocks", "comm": "COMM"},
            {
                "path": {**NO_PATH, "no such file": "'none.msh'", "wrong suffix": "'run.h5'"},
                "joints": {
                    "text": "'joint_1'",
                    "number": "1",
                    "unknown": "['joint_9']",
                    "number in a list": "[1]",
                    "nested": "[['joint_1']]",
                    "twice": "['joint_1', 'joint_1']",
                    "not inside": "['base']",
                },
            },
            names,
        ),
    ]


def measured() -> list[Door]:
    """Measures and resultants."""
    of_point = {"results": NO_RESULTS, "point": POINT, "component": NO_CHOICE}
    good = {"results": "results", "point": "'top'", "component": "'x'"}
    both = {"absolute": NO_FLAG}
    angle = without(NO_NUMBER, "nothing", out_of_range="90.0", negative="-1.0")
    run, own = {"results": "results"}, {"results": NO_RESULTS}
    return [
        door("measures.displacement_history", good, of_point | both, names),
        door("measures.acceleration_history", good, of_point | both, names),
        door("measures.fourier_peaks", good, of_point | {"below": OPTIONAL}, names),
        door(
            "measures.effective_period",
            good,
            of_point | {"window": WINDOW, "band": BAND, "hop": OPTIONAL},
            names,
        ),
        door(
            "measures.peaks",
            {**run, "point": "0", "strong_until": "1.0"},
            own | {"point": POINT, "strong_until": NO_NUMBER},
            names,
        ),
        door(
            "measures.strong_motion_end",
            {"source": "results"},
            {"source": NO_RESULTS, "share": without(NO_NUMBER, zero="0.0", above_one="1.5")},
            names,
        ),
        door(
            "measures.joint_history", {**run, "joint": "'joint_1'"}, own | {"joint": JOINT}, names
        ),
        door("measures.joint_measures", run, own | {"tail": {**TIME, "negative": "-1.0"}}, names),
        door("measures.summary_row", run, own | {"strong_until": TIME}, names),
        door("measures.stress_extremes", {}, own, names),
        door(
            "joint_resultants",
            {**run, "joint": "'joint_1'"},
            own | {"joint": JOINT, "friction_angle_deg": angle},
            names,
        ),
        door("block_resultants", {}, own, names),
        door("resultant_measures", {}, own, names),
    ]


def drawn() -> list[Door]:
    """Figures."""
    good = {"results": "results", "point": "'top'", "component": "'x'"}
    one = {"results": NO_RESULTS, "point": POINT, "component": NO_CHOICE, "ax": AXES}
    two = one | {"labels": LABELS, "reference": {"path": "'run.h5'", "number": "7"}}
    run = {"results": "results"}
    joint = {"results": NO_RESULTS, "joint": JOINT, "quantity": NO_CHOICE, "ax": AXES}
    joint |= {"time": TIME, "index": INDEX}
    on_joint = {**run, "joint": "'joint_1'"}
    share = without(NO_NUMBER, above_one="1.5", negative="-0.5")
    paper = {**POSITIVE, "out of range": "1000.0"}
    return [
        door("plots.new_axes", {}, {"width": paper, "height": paper}, names),
        door(
            "plots.save",
            {"figure": "figure", "path": "'a.png'"},
            {
                "figure": {"text": "'a.png'", "nothing": "None"},
                "path": {**NO_PATH, "no format": "'a.xyz'", "no ending": "'a'"},
                "dpi": {**POSITIVE, "out of range": "1e6"},
            },
            names,
            together={"no folder": "path='nowhere/a.png'"},
            error=Exception,
        ),
        door("plots.history", good, two, names),
        door("plots.fourier", good, two | {"max_frequency": POSITIVE}, names),
        door("plots.joint_traction", on_joint, joint, names),
        door("plots.traction_profile", on_joint, joint | {"position": share}, names),
        door("plots.energies", run, {"results": NO_RESULTS, "ax": AXES}, names),
        door("plots.joint_states", run, {"results": NO_RESULTS, "ax": AXES}, names),
        door(
            "response_plots.response_spectra",
            good,
            two | {"damping_ratio": DAMPING, "periods": PERIODS},
            names,
        ),
        door(
            "response_plots.displacement_spectrogram",
            {**good, "window": "0.1"},
            one | {"window": WINDOW, "max_frequency": POSITIVE, "label": NO_TEXT},
            names,
        ),
        door(
            "response_plots.effective_frequency",
            {**good, "window": "0.1"},
            two | {"quantity": NO_CHOICE, "window": WINDOW, "band": BAND},
            names,
        ),
        door(
            "response_plots.joint_motion",
            run,
            {
                "results": NO_RESULTS,
                "quantity": NO_CHOICE,
                "joints": {"text": "'joint_1'", "unknown": "['joint_9']", "empty": "[]"},
                "ax": AXES,
            },
            names,
        ),
        *of_motions(),
    ]


def of_motions() -> list[Door]:
    """Figures of motions."""
    others = {"ax": AXES, "reference": {"text": "'raw'", "number": "7"}}
    first = {"motion": {"nothing": "None", "text": "'record.at2'", "results": "results"}}
    target = {"number": "1.0", "too short": "([1.0],)", "unlike": "([1.0], [1.0, 2.0])"}
    target |= {"not a number": "([1.0], [math.nan])", "texts": "(['1'], ['2'])"}
    letters = {"unknown": "'xw'", "twice": "'xx'", "empty": "''", "number": "1", "nothing": "None"}
    return [
        door(
            "motion_plots.history",
            {"motion": "motion", "component": "'x'"},
            first | {"component": NO_CHOICE, "quantity": NO_CHOICE, "labels": LABELS} | others,
            names,
        ),
        door(
            "motion_plots.response_spectra",
            {"motion": "motion"},
            first
            | {"components": letters, "damping_ratio": DAMPING, "periods": PERIODS}
            | {"target": target, "reference_label": NO_TEXT}
            | others,
            names,
        ),
        door(
            "motion_plots.spectrum_match",
            {},
            {"match": {"nothing": "None", "a motion": "motion"}},
            names,
        ),
    ]


def seen() -> list[Door]:
    """Views and reports."""
    run: dict[str, str] = {"results": "results"}
    state = {"results": NO_RESULTS, "time": TIME, "index": INDEX}
    eye = {"azimuth_deg": ANGLE, "elevation_deg": ELEVATION}
    eyes = {"results": NO_RESULTS, "azimuths_deg": ANGLES, "elevation_deg": ELEVATION}
    size = without(NO_NUMBER, "nothing")
    joint = without(JOINT, "nothing")
    files = {"text": "'run.h5'", "nothing": "None", "empty": "[]", "number in a list": "[7]"}
    files |= {"no such file": "['none.h5']"}
    return [
        door("views.mesh", run, eyes, names),
        door("views.deformed", run, state | eye | {"scale": size}, names),
        door(
            "views.joint_map",
            run,
            state | eye | {"quantity": NO_CHOICE, "joint": joint, "turned": NO_FLAG},
            names,
        ),
        door("views.envelope", run, eyes | {"name": NO_CHOICE}, names),
        door(
            "report.write",
            {"results": "['none.h5']"},
            {
                "results": files,
                "out": {**NO_PATH, "wrong suffix": "'report.pdf'"},
                "with_3d": NO_FLAG,
            },
            names,
        ),
    ]


DOORS = (*readers(), *measured(), *drawn(), *seen())
