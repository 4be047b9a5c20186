# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures, tables and checks of a report that state the same quantity agree to their last digit.

Expected numbers are other numbers of the same page, and values of the results file that this module
computes with NumPy alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from reading_back import Tables, captions, curves, number

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")
pytest.importorskip("plotly")
pytest.importorskip("pyvista")
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.geometry.ambiesta import ambiesta, mid_crest
from dolfinx_joints.geometry.gravity_dam import gravity_dam
from dolfinx_joints.results.reader import Results

STRENGTH = dj.Strength(tensile=2e6, compressive=25e6, dynamic_factor=1.5)
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=40.0)


class Report(NamedTuple):
    """Page of a run, its tables, and its file."""

    html: str
    tables: Tables
    results: Results


def run_of(path: Path, mesh: Path, crest: Any, bottom: list[str], **options: Any) -> Path:
    """Compute weight and 1 s of an earthquake that opens and slides the joints."""
    solid = dj.Elastic(young=25e9, poisson=0.2, density=2400.0)
    model = dj.Model(
        dj.read_msh(mesh, MPI.COMM_SELF),
        material=solid,
        joints=LAW,
        supports=[dj.Fixed(group=group) for group in bottom],
        damping=dj.stiffness_proportional(ratio=0.02, frequency=5.0),
        **options,
    )
    checks = {"kind": "gravity", "crest": "crest", "residual_slip": 0.1}
    monitor = dj.ResultsMonitor(
        path,
        points={"crest": crest},
        every=5,
        envelopes=True,
        strength=STRENGTH,
        metadata={"checks": checks},
    )
    run = dj.Simulation(model, monitors=[monitor])
    run.statics()
    motion = dj.synthetic_motion(duration=1.0, band=(1.0, 15.0))
    run.dynamics(dt=0.004, steps=250, motion=motion)
    return path


def arch(folder: Path) -> Path:
    mesh = ambiesta(folder / "arch.msh", size=14.0, order=1, joints=3, active_height=1.0)
    return run_of(
        folder / "arch.h5",
        mesh,
        dj.Probe(mid_crest(), group="joint_2+"),
        ["base", "abutments"],
        loads=[dj.Gravity()],
    )


def plane(folder: Path) -> Path:
    mesh = gravity_dam(folder / "plane.msh", joints={"base": 0.0, "neck": 66.5}, size=8.0, order=1)
    water = dj.HydrostaticPressure(group="upstream", level=91.75)
    return run_of(
        folder / "plane.h5",
        mesh,
        (0.0, 103.0),
        ["base", "foundation_ends"],
        loads=[dj.Gravity(), water],
        water=dj.WestergaardMass(group="upstream", level=91.75),
    )


@pytest.fixture(scope="module", params=[arch, plane], ids=["arch", "plane"])
def report(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Report]:
    """Report of an arch dam or of a gravity dam in plane strain, with strengths and checks."""
    make: Callable[[Path], Path] = request.param
    path = make(tmp_path_factory.mktemp("agreement"))
    html = dj.report.write([path], path.with_suffix(".html")).read_text(encoding="utf-8")
    with Results(path) as results:
        yield Report(html, Tables(html), results)


def agree(shown: float, other: float, factor: float = 1.0) -> None:
    """Assert that two numbers of four digits, one times a factor, differ by rounding."""
    units = (10.0 ** (np.floor(np.log10(abs(value))) - 3) for value in (shown, other))
    unit, other_unit = units
    assert abs(shown - factor * other) <= 0.501 * (unit + abs(factor) * other_unit)


def main_result(report: Report, words: str) -> tuple[float, str]:
    """Return a number of the table of main results in SI, and the small print below it."""
    (table,) = report.tables.having(report.results.path.stem).tables[:1]
    ((name, cell),) = [row for row in table if row[0].startswith(words)]
    return report.tables.value(name, report.results.path.stem), cell.split(" ", 1)[1]


def rows_of(report: Report, head: str) -> dict[str, list[str]]:
    """Return the rows of the one table whose head has a word."""
    (table,) = report.tables.having(head).tables
    return {row[0]: row[1:] for row in table[1:] if len(row) > 1}


def test_crest_displacement(report: Report) -> None:
    value, where = main_result(report, "crest displacement")
    _, component, time = re.findall(r"(\S+) ([xyz]), ([\d.]+) s", where)[0]
    panel = "xyz".index(component)
    label = report.results.path.stem
    found = curves(report.html, "history-1")
    time_drawn, drawn = found[label, panel]
    at = int(np.argmax(np.abs(drawn)))
    agree(value, drawn[at])
    agree(float(time), time_drawn[at])
    peaks = Tables(report.html).having("strong phase")
    row = f"crest, {component}, {label}"
    agree(abs(value), max(peaks.value(row, "largest", when) for when in ("before", "after")))
    u = report.results.series("histories", "displacement")[:, 0]
    agree(value, (u - u[0])[at, panel])
    # The drift of the checks is the largest horizontal displacement over the height.
    drift, height = (
        next(row for row in rows_of(report, "criterion").items() if row[0].startswith("crest"))[1][
            i
        ]
        for i in (1, 0)
    )
    horizontal = [drawn for (_, axis), (_, drawn) in found.items() if axis < max(found)[1]]
    largest = np.linalg.norm(horizontal, axis=0).max()
    agree(number(drift), largest, 1.0 / float(height.split("height ")[1].split(" m")[0]))


def test_accelerations(report: Report) -> None:
    value, where = main_result(report, "crest acceleration")
    component = where.split(",")[0][-1]
    label = f"crest, {report.results.path.stem}"
    (table,) = report.tables.having("[m/s²]", "point, run").tables
    agree(abs(value), float(table[1][1 + "xyz".index(component)]))
    assert table[1][0] == label


def test_joints(report: Report) -> None:
    largest = report.tables.having("smallest safety")
    motion = report.tables.having("residual slip")
    found = curves(report.html, "joint-histories")
    panels = dict(enumerate(("opening", "slip", "pressure", "mean pressure", "mobilised")))
    assert report.results.joints
    for joint in report.results.joints:
        series = {name: found[joint, panel] for panel, name in panels.items()}
        for name in ("opening", "slip"):
            time, drawn = series[name]
            value = largest.value(joint, f"largest {name}")
            assert value > 1e-4  # the joints open and slide [m]
            agree(value, drawn.max())
            agree(value, motion.value(joint, f"largest {name} ["))
            maxima = report.results.series("joint_maxima", f"{joint}/{name}", -1)
            agree(value, maxima.max())  # of the map
            ((when),) = re.findall(
                r" ([\d.]+) s at ", rows_of(report, "smallest safety")[joint][name == "slip"]
            )
            agree(float(when), time[np.argmax(drawn)])
            agree(float(when), motion.value(joint, f"largest {name} at"))
        for name in ("pressure", "mean pressure"):
            agree(motion.value(joint, f"largest {name} ["), series[name][1].max())
        safety = 1.0 / np.nanmax(series["mobilised"][1])
        agree(largest.value(joint, "smallest safety"), safety)
        checked = rows_of_checks(report, "least sliding safety")
        agree(next(v for where, v in checked.items() if where.startswith(joint)), safety)
        checked = rows_of_checks(report, "residual slip")
        residual = next(v for where, v in checked.items() if where.startswith(joint))
        agree(residual, motion.value(joint, "residual slip"))
        stage = report.tables.having("normal force").value(joint, "largest opening")
        np.testing.assert_allclose(stage, motion.value(joint, "opening in the"), rtol=1e-3)


def rows_of_checks(report: Report, criterion: str) -> dict[str, float]:
    """Return values of a criterion by place."""
    (table,) = report.tables.having("criterion").tables
    return {row[1]: number(row[2]) for row in table[1:] if row[0].startswith(criterion)}


def test_stresses(report: Report) -> None:
    label = report.results.path.stem
    capacity = {"tension": 3e6, "compression": -25e6}  # dynamic tensile, compressive [Pa]
    for name, words in (("max", "tension"), ("min", "compression")):
        value, _ = main_result(report, f"largest {words}")
        agree(value, report.tables.value(f"principal, {name}", label))
        recorded = report.results.series("envelopes", f"principal_{name}", -1)
        agree(value, getattr(np, f"nan{name}")(recorded))
        (ratio,) = rows_of_checks(report, f"{words} / ").values()
        agree(ratio, value, 1.0 / capacity[words])
        # The checks are those of the dam, the table that of the body with its foundation.
        stage, extreme = (
            report.results.series("statics", f"stress/principal_{name}", -1),
            getattr(np, f"nan{name}"),
        )
        stages = report.tables.having(f"principal, {name} [MPa]")
        agree(stages.value("statics 1", f"principal, {name}"), extreme(stage))
        cells = report.results.static("mesh/cells")[report.results.static("mesh/groups/concrete")]
        dam = np.isin(report.results.static("envelopes/nodes"), cells)
        (static,) = rows_of_checks(report, f"static {words}").values()
        agree(static, extreme(stage[dam]), 1.0 / (2e6 if words == "tension" else -25e6))


def test_energies(report: Report) -> None:
    percent, _ = main_result(report, "energy error")  # a share of one, from [%]
    agree(
        percent, report.tables.value("energy error / largest energy [%]", report.results.path.stem)
    )
    agree(percent, report.results.summary["energy_error"])
    for term, panel in (key for key in curves(report.html, "energies-1")):
        _, drawn = curves(report.html, "energies-1")[term, panel]
        recorded = report.results.series("energy", term)
        np.testing.assert_allclose(drawn, recorded, rtol=1e-6, atol=1e-7 * np.abs(recorded).max())
    work = report.tables.having("balance error").value("statics 1", "work of Gravity")
    agree(work, report.results.series("statics", "energy/loads/Gravity", -1))


def test_captions_state_one_time(report: Report) -> None:
    """The dam and the maps of the largest displacement are drawn at the same record."""
    stated = [text for text in captions(report.html) if "among the recorded states" in text]
    times = {time for text in stated for time in re.findall(r"t = ([\d.]+) s", text)}
    assert len(stated) >= 2
    assert len(times) == 1
    u = report.results.series("states", "displacement")
    (time,) = times
    assert np.abs(report.results.time("states") - float(time)).min() < 1e-3
    assert len(u)
