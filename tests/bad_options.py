# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bad options of schemes, steps, solvers, monitors, checkpoints and studies, and bad motions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from bad_input import NO_CHOICE, NO_COUNT, NO_FLAG, NO_NUMBER, Door, door, without

import dolfinx_joints as dj
from dolfinx_joints.motions import spectra
from dolfinx_joints.common.errors import RecordError
from dolfinx_joints.motions.spectra import response_spectrum
from dolfinx_joints.motions.spectrum_matching import match_spectrum
from dolfinx_joints.study import Study

AT_LEAST_ONE = without(NO_COUNT, zero="0", negative="-1")
NO_PATH = {"number": "7", "nothing": "None", "empty": "''", "bytes": "b'x'", "list": "['x.h5']"}


def case(folder: Path, *, a: float = 0.0) -> dict[str, Any]:
    """What a study runs."""
    return {}


def names() -> dict[str, Any]:
    """What the rows refer to."""
    here: dict[str, Any] = {"dj": dj, "math": math, "np": np, "case": case, "Study": Study}
    here["motion"] = dj.Motion(acceleration=np.eye(3)[np.arange(100) % 3], dt=0.01)
    here |= {"spectra": spectra, "signal": np.sin(np.arange(100.0))}
    here |= {"match_spectrum": match_spectrum, "response_spectrum": response_spectrum}
    return here


PLACES = {
    "nothing": "None",
    "empty": "{}",
    "list": "[(0.0, 0.0, 0.0)]",
    "a point without a name": "{'': (0.0, 0.0)}",
    "a number in the place of a point": "{'crest': 1.0}",
    "not a number": "{'crest': (0.0, math.nan)}",
    "too short": "{'crest': (0.0,)}",
    "text": "{'crest': 'top'}",
    "complex": "{'crest': (0.0, 1j)}",
}
MOTION = {
    "wrong shape": "np.zeros((3, 2))",
    "one sample": "np.zeros((1, 3))",
    "empty": "[]",
    "text": "'record.at2'",
    "nothing": "None",
    "not a number": "[(0, 0, 0), (0, math.nan, 0)]",
    "infinite": "[(0, 0, 0), (0, math.inf, 0)]",
    "of no size": "[(0, 0, 0), (0, 1e300, 0)]",
    "complex": "np.full((2, 3), 1j)",
    "unlike rows": "[(0, 0, 0), (0, 0)]",
}
BAND = {
    "text": "'low'",
    "number": "5.0",
    "too short": "(5.0,)",
    "not a number": "(math.nan, 9.0)",
    "complex": "(1.0, 1j)",
    "falling": "(9.0, 1.0)",
    "beyond all frequencies": "(60.0, 90.0)",
}
STEP = without(NO_NUMBER, negative="-0.01", zero="0.0")
TARGET = "([0.1, 0.2], [3.0, 2.0])"

DOORS: tuple[Door, ...] = (
    door(
        "dj.Newmark",
        {},
        {
            "beta": without(NO_NUMBER, zero="0.0", too_large="0.6"),
            "gamma": without(NO_NUMBER, too_small="0.4", too_large="1.1"),
        },
        names,
    ),
    door(
        "dj.HilberHughesTaylor",
        {},
        {"alpha": without(NO_NUMBER, negative="-0.1", too_large="0.4")},
        names,
    ),
    door(
        "dj.GeneralizedAlpha",
        {},
        {"spectral_radius": without(NO_NUMBER, negative="-0.1", too_large="1.1")},
        names,
    ),
    door(
        "dj.StepControl",
        {},
        {
            "max_halvings": without(NO_COUNT, negative="-1", too_large="31"),
            "tolerance": without(NO_NUMBER, "nothing", zero="0.0", too_large="1.0"),
            "landing": NO_FLAG,
        },
        names,
    ),
    door(
        "dj.SolverOptions",
        {},
        {
            "relative_tolerance": without(NO_NUMBER, zero="0.0", negative="-1e-9", too_large="1.0"),
            "max_iterations": AT_LEAST_ONE,
            "max_cuts": without(NO_COUNT, negative="-1", too_large="51"),
            "linear": {**NO_CHOICE, "misspelt": "'Direct'"},
            "compliance": NO_CHOICE,
            "linear_options": {
                "text": "'-ksp_type cg'",
                "list": "['ksp_type', 'cg']",
                "with a dash": "{'-ksp_type': 'cg'}",
                "a name that is none": "{1: 2}",
                "a value that is none": "{'ksp_type': ['cg']}",
            },
        },
        names,
    ),
    door(
        "dj.ResultsMonitor",
        {"path": "'run.h5'", "points": "{'crest': (0.0, 0.0, 0.0)}"},
        {
            "path": NO_PATH,
            "points": PLACES,
            "every": AT_LEAST_ONE,
            "metadata": {
                "text": "'a run'",
                "list": "[1, 2]",
                "what JSON cannot hold": "{'law': object}",
            },
            "overwrite": NO_FLAG,
            "envelopes": {
                "text": "'base'",
                "number": "1",
                "nothing": "None",
                "empty": "[]",
                "number among names": "['base', 1]",
            },
            "resultants": NO_FLAG,
        },
        names,
    ),
    door("dj.FieldMonitor", {"path": "'run.bp'"}, {"path": NO_PATH, "every": AT_LEAST_ONE}, names),
    door("dj.ProgressMonitor", {}, {"label": {"number": "1", "nothing": "None"}}, names),
    door(
        "dj.Checkpoints",
        {"path": "'run.ckpt'"},
        {"path": NO_PATH, "every": AT_LEAST_ONE, "overwrite": NO_FLAG},
        names,
    ),
    door(
        "Study",
        {"path": "'study'", "function": "case", "cases": "{'one': {'a': 1.0}}"},
        {
            "path": NO_PATH,
            "function": {"nothing": "None", "text": "'case'", "without a name": "lambda f: {}"},
            "cases": {
                "nothing": "None",
                "list": "['one']",
                "a name that is none": "{1: {}}",
                "a name that is no file's": "{'a/b': {}}",
                "an empty name": "{'': {}}",
                "a number in the place of parameters": "{'one': 1.0}",
                "an unknown parameter": "{'one': {'b': 1.0}}",
                "a column of the table": "{'one': {'status': 1.0}}",
                "not a number": "{'one': {'a': math.nan}}",
                "what JSON cannot hold": "{'one': {'a': 1j}}",
            },
        },
        names,
    ),
    door(
        "Study('study', case, {}).run",
        {},
        {
            "workers": AT_LEAST_ONE,
            "only": {"text": "'one'", "number": "1", "unknown": "['two']", "list": "[['one']]"},
            "retry_failed": NO_FLAG,
            "rerun_changed": NO_FLAG,
            "progress": NO_FLAG,
        },
        names,
        title="Study.run",
    ),
    door(
        "dj.Motion",
        {"acceleration": "np.zeros((2, 3))", "dt": "0.01"},
        {"acceleration": MOTION, "dt": STEP, "name": {"number": "1", "nothing": "None"}},
        names,
        error=RecordError,
    ),
    door(
        "dj.synthetic_motion",
        {},
        {
            "seed": without(NO_COUNT, negative="-1"),
            "duration": STEP,
            "dt": without(STEP, too_large="1.0", too_small="1e-7"),
            "peaks_g": {
                "number": "0.4",
                "too short": "(0.4, 0.4)",
                "negative": "(0.4, 0.4, -0.3)",
                "not a number": "(0.4, 0.4, math.nan)",
                "text": "'0.4'",
                "nothing": "None",
            },
            "band": {
                "number": "5.0",
                "falling": "(15.0, 0.5)",
                "beyond the samples": "(0.5, 200.0)",
                "below the duration": "(0.01, 15.0)",
                "not a number": "(math.nan, 15.0)",
                "too long": "(0.5, 1.0, 15.0)",
                "nothing": "None",
            },
        },
        names,
    ),
    door("motion.rotated", {}, {"angle_deg": NO_NUMBER}, names, error=RecordError),
    door("motion.resampled", {}, {"dt": without(STEP, too_large="2.0")}, names, error=RecordError),
    door(
        "motion.trimmed",
        {"duration": "0.5"},
        {
            "duration": without(STEP, beyond_the_end="2.0"),
            "start": without(NO_NUMBER, negative="-0.1", beyond_the_end="0.9"),
        },
        names,
        error=RecordError,
    ),
    door(
        "motion.baseline_corrected",
        {},
        {"degree": without(NO_COUNT, negative="-1", too_large="7")},
        names,
        error=RecordError,
    ),
    door(
        "motion.band_passed",
        {"low": "2.0", "high": "20.0"},
        {
            "low": without(STEP, "nothing", above_the_other="30.0"),
            "high": without(STEP, "nothing", beyond_the_samples="50.0"),
            "order": without(NO_COUNT, zero="0", too_large="9"),
        },
        names,
        together={"no corner": "low=None; high=None"},
    ),
    door(
        "motion.tapered",
        {},
        {"seconds": without(STEP, too_large="0.6"), "fraction": without(STEP, too_large="0.6")},
        names,
        together={"both": "seconds=0.1; fraction=0.1"},
        error=RecordError,
    ),
    door(
        "motion.scaled",
        {},
        {"factor": {**NO_NUMBER, "too short": "(1.0, 1.0)", "text among numbers": "(1, 1, '1')"}},
        names,
        error=RecordError,
    ),
    door(
        "match_spectrum",
        {"motion": "motion", "target": TARGET},
        {
            "motion": {"nothing": "None", "array": "np.zeros((10, 3))"},
            "target": {
                "nothing": "None",
                "text": "'ec8'",
                "one row": "([0.1, 0.2],)",
                "unlike lengths": "([0.1, 0.2], [3.0])",
                "one period": "([0.1], [3.0])",
                "falling": "([0.2, 0.1], [3.0, 2.0])",
                "negative": "([0.1, 0.2], [3.0, -2.0])",
                "not a number": "([0.1, math.nan], [3.0, 2.0])",
                "complex": "([0.1, 0.2], [3.0, 1j])",
                "too short for the samples": "([0.01, 0.2], [3.0, 2.0])",
                "too long for the motion": "([0.1, 1.0], [3.0, 2.0])",
            },
            "components": {**NO_CHOICE, "twice": "'xx'"},
            "damping_ratio": without(NO_NUMBER, too_small="0.004", too_large="0.31"),
            "tolerance": without(NO_NUMBER, too_small="0.01", too_large="0.6"),
            "rounds": AT_LEAST_ONE,
        },
        names,
    ),
    door(
        "response_spectrum",
        {
            "acceleration": "np.zeros((10, 3))",
            "dt": "0.01",
            "periods": "[0.1, 0.2]",
            "damping_ratio": "0.05",
        },
        {
            "acceleration": without(MOTION, "wrong shape"),
            "dt": STEP,
            "periods": {
                "text": "'0.1'",
                "nothing": "None",
                "zero": "[0.0, 0.1]",
                "negative": "[-0.1]",
                "not a number": "[math.nan]",
                "nested": "[[0.1]]",
            },
            "damping_ratio": without(NO_NUMBER, negative="-0.1", too_large="1.0"),
        },
        names,
    ),
    *(
        door(
            f"spectra.{name}",
            {"signal": "signal", "dt": "0.01", "window": "0.5", "hop": "None", **more},
            {
                "signal": {**without(MOTION, "wrong shape"), "several columns": "np.ones((99, 3))"},
                "dt": STEP,
                "window": without(STEP, too_short="0.05", too_long="2.0"),
                "hop": without(STEP, "nothing"),
                **{each: BAND for each in more},
            },
            names,
        )
        for name, more in (
            ("windows", {}),
            ("spectrogram", {}),
            ("running_frequency", {"band": "None"}),
        )
    ),
)
