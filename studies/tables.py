# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Printed comparison of a run with joints with a run without joints and with the paper."""

from __future__ import annotations

from typing import Any

from dolfinx_joints import Results
from dolfinx_joints.postprocessing import measures
from dolfinx_joints.report import Run
from studies.paper_statements import Pair, count, judged

POINT = "mid-crest"

Numbers = dict[str, list[float]]


def comparison(linear: Results, joints: Results) -> Numbers:
    """Return numbers of both runs by name: linear, with joints, and their ratio.

    Peaks are displacements relative to the base, minus the self-weight state [mm]. The strong phase
    ends at 95 % of the Arias intensity.
    """
    until = measures.strong_motion_end(linear)
    numbers: Numbers = {}
    for axis in measures.COMPONENTS:
        values = [_of_run(run, axis, until) for run in (linear, joints)]
        for name in values[0]:
            pair = [run[name] for run in values]
            numbers[f"{name} {axis}"] = [*pair, pair[1] / pair[0] if pair[0] else float("nan")]
    return numbers


def _of_run(run: Results, axis: measures.Component, until: float) -> dict[str, float]:
    largest = measures.peaks(run, POINT, strong_until=until)[axis]
    spectrum = measures.fourier_peaks(run, POINT, axis)
    return {
        "peak in the strong phase [mm]": 1e3 * largest["strong"],
        "peak after it [mm]": 1e3 * largest["later"],
        "Fourier peak at [Hz]": spectrum.frequency,
        "Fourier peak [mm s]": 1e3 * spectrum.amplitude,
    }


def joint_rows(joints: Results) -> Numbers:
    """Return the largest opening [mm], slip [mm] and pressure [MPa] of each joint."""
    return {
        name: [1e3 * m["opening_max"], 1e3 * m["slip_max"], 1e-6 * m["pressure_max"]]
        for name, m in measures.joint_measures(joints).items()
    }


def print_tables(linear: Results, joints: Results) -> dict[str, Any]:
    """Print both tables and return their numbers."""
    rows, by_joint = comparison(linear, joints), joint_rows(joints)
    until = measures.strong_motion_end(linear)
    print(f"mid-crest, strong phase until {until:.2f} s     linear   with joints   ratio")
    for name, (one, other, ratio) in rows.items():
        print(f"{name:<40} {one:8.3f}     {other:8.3f}  {ratio:6.2f}")
    width = measures.fourier_peaks(linear, POINT, "x").bin_width
    print(f"Fourier peaks are at multiples of {width:.2g} Hz, one over the duration of the run.")
    print("joint      largest opening [mm]   largest slip [mm]   largest pressure [MPa]")
    for name, (opening, slip, pressure) in by_joint.items():
        print(f"{name:<10} {opening:20.3f} {slip:19.3f} {pressure:24.3f}")
    return {**rows, **by_joint}


def print_statements(linear: Results, joints: Results) -> None:
    """Print the paper's statements, the numbers behind them, and whether they agree."""
    judgements = judged(Pair(Run(linear, "linear"), Run(joints, "joints")))
    statement = ""
    for judgement in judgements:
        check = judgement.check
        if check.statement != statement:
            statement = check.statement
            print(f"\n{statement}")
        verdict = judgement.verdict + (f": {judgement.reason}" if judgement.reason else "")
        print(f"  {check.quantity:<76} {judgement.value:9.3g}   {verdict} ({check.rule})")
    print(f"\n{count(judgements)}")
