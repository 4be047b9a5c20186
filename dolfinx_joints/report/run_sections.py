# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections of a report on the runs themselves: parameters, cost, energies, iterations, doubts."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from dolfinx_joints import __version__
from dolfinx_joints.common.constants import LARGE_ENERGY_ERROR, LARGE_LOCAL_ERROR
from dolfinx_joints.postprocessing import plots
from dolfinx_joints.postprocessing.energy_lines import energy_lines, through_boundaries
from dolfinx_joints.report.page import Curve, Section, bullets, panels, paragraph, plain, table
from dolfinx_joints.report.runs import Content, Run, nothing
from dolfinx_joints.results.reader import ENERGY_TERMS

_PARAMETERS = {
    "time_step": "time step [s]",
    "size": "cell size [m]",
    "order": "degree of the elements",
    "active_height": "joints active below this share of the height",
    "friction_angle_deg": "friction angle [°]",
    "normal_stiffness": "joint stiffness k_n [Pa/m]",
    "shear_ratio": "k_s / k_n",
    "gap": "initial gap [m]",
    "scale": "factor on the motion",
    "rotate": "turn of the horizontal axes [°]",
    "stage": "stage",
    "displacements": "displacements in the file",
}
_MESH = {"dofs": "degrees of freedom", "cells": "cells", "joint_points": "joint points"}
_COUNTS = {
    "steps": "time steps",
    "accepted": "substeps that the steps were solved in",
    "failed": "rejected attempts",
    "iterations": "iterations in all",
    "solver": "solver",
    "peak_mb": "peak memory [MB]",
}
_ERRORS = {
    "energy_error": "energy error / largest energy",
    "imbalance": "energy error / sum of all lines",
    "local_error": "largest error of one step / largest displacement",
}


def parameters(content: Content) -> Section:
    """Parameters and mesh numbers from the files."""
    facts = [run.results.metadata for run in content.runs]
    hidden = {"point_names", "points", "units", *_MESH}
    keys = [key for key in dict.fromkeys(k for f in facts for k in f) if key not in hidden]
    rows = [[_PARAMETERS.get(key, key), *(_fact(f, key) for f in facts)] for key in keys]
    mesh = [[text, *(f.get(key) for f in facts)] for key, text in _MESH.items()]
    mesh += [
        ["nodes in the file", *(_length(run, "mesh/nodes") for run in content.runs)],
        ["boundary facets", *(_length(run, "mesh/surface") for run in content.runs)],
        ["joints", *(len(run.results.joints) for run in content.runs)],
    ]
    return Section(
        "parameters",
        "Parameters and mesh",
        [
            table("Parameters, as the files name them", _head("parameter", content), rows),
            table("Mesh", _head("", content), mesh),
        ],
    )


def cost(content: Content) -> Section:
    """Seconds, steps, iterations, memory."""
    summaries = [run.results.summary for run in content.runs]
    rows = [[text, *(s.get(key) for s in summaries)] for key, text in _COUNTS.items()]
    each = [
        s["iterations"] / s["accepted"] if s.get("accepted") and "iterations" in s else None
        for s in summaries
    ]
    rows.append(["iterations per substep", *each])
    stages = [s.get("seconds", {}) for s in summaries]
    names = dict.fromkeys(name for stage in stages for name in stage)
    rows += [[f"seconds: {name}", *(stage.get(name) for stage in stages)] for name in names]
    rows.append(["seconds in all", *(run.seconds for run in content.runs)])
    return Section(
        "cost",
        "Cost",
        [
            table("Work of each run", _head("", content), rows),
            paragraph("Seconds are those of a clock on the machine that ran it.", "note"),
        ],
    )


def energies(content: Content) -> Section:
    """Closure of the energies, and their plots."""
    summaries = [run.results.summary for run in content.runs]
    rows = [[text, *(s.get(key) for s in summaries)] for key, text in _ERRORS.items()]
    pieces = [
        table("How well the energies balance", _head("", content), rows),
        paragraph(
            "The error is stored energy − stored at the start − input + what damping and friction "
            "took; a scheme that balances energies leaves rounding, about 1e-14. The local error "
            "estimates what one step does wrong.",
            "note",
        ),
    ]
    for number, run in enumerate(content.runs):
        if not run.has("energy", *ENERGY_TERMS):
            pieces.append(paragraph(f"The file of {run.label} has no energies."))
            continue
        time, values = run.results.time("energy"), energy_lines(run.results)
        curves = [[(term, time, 1e-3 * v) for term, v in values.items() if term != "error"]]
        curves.append([("error", time, values["error"])])
        spec = panels(curves, ["energy [kJ]", "error [J]"], "time [s]", shown=len(values))
        picture = content.save(f"energies_{number + 1}", plots.energies(run.results))
        caption = f"Energies of {run.label} over time, and their error."
        through = through_boundaries(run.results)
        if through is not None:
            brought, taken = (plain(1e-9 * float(each[-1])) for each in through)
            caption += (
                f" Waves: what came in through viscous boundaries less what went out, {brought} "
                f"less {taken} GJ at the end; input and viscous are those of all else."
            )
        pieces.append(content.drawings.plot(f"energies-{number + 1}", spec, caption, [picture]))
    return Section("energies", "Energies", pieces)


def convergence(content: Content) -> Section:
    """Iterations and states of the joints over time."""
    names = ("joint_open", "joint_stick", "joint_slip")
    runs = [run for run in content.runs if run.has("histories", "iterations", *names)]
    if not runs:
        return nothing("iterations", "Iterations and joint states", "histories")
    curves: list[list[Curve]] = [[] for _ in range(4)]
    for run in runs:
        time = run.results.time("histories")
        curves[0].append((run.label, time, run.results.series("histories", "iterations")))
        for panel, name in zip(curves[1:], names if run.results.joints else (), strict=False):
            panel.append((run.label, time, 100.0 * run.results.series("histories", name)))
    titles = ["iterations", "open [%]", "sticking [%]", "sliding [%]"]
    drawn = [(panel, title) for panel, title in zip(curves, titles, strict=True) if panel]
    spec = panels([p for p, _ in drawn], [t for _, t in drawn], "time [s]")
    pictures = []
    if content.main in runs and content.main.results.joints:
        pictures.append(content.save("joint_states", plots.joint_states(content.main.results)))
    caption = (
        "Iterations of each step, and shares of the joint points that are open, stick and slide."
    )
    return Section(
        "iterations",
        "Iterations and joint states",
        [content.drawings.plot("iterations-plot", spec, caption, pictures)],
    )


def warnings(content: Content) -> Section:
    """Doubts about the runs, by their own numbers."""
    found = [sentence for run in content.runs for sentence in doubts(run)]
    if not found:
        found = ["None: all runs are complete, and their errors are within the bounds below."]
    return Section(
        "warnings",
        "Warnings",
        [
            bullets(found),
            paragraph(
                f"A run is doubtful where its energy error is above {LARGE_ENERGY_ERROR:.0%} of "
                f"the largest energy or the local error of one step above "
                f"{LARGE_LOCAL_ERROR:.0%} of the largest displacement, and where it did not reach "
                "its end.",
                "note",
            ),
        ],
    )


def versions(content: Content) -> Section:
    """Files of the runs, and programs that wrote the report."""
    rows = [
        [run.label, str(run.results.path), run.results.created, run.results.status]
        for run in content.runs
    ]
    packages = ["numpy", "scipy", "h5py", "matplotlib", "plotly", "pyvista"]
    return Section(
        "versions",
        "Files and versions",
        [
            table("Results files", ["run", "file", "created (UTC)", "status"], rows),
            table(
                "This report was written with",
                ["package", "version"],
                [
                    ["dolfinx_joints", __version__],
                    ["Python", sys.version.split()[0]],
                    *([p, _version(p)] for p in packages),
                ],
            ),
        ],
    )


def doubts(run: Run) -> list[str]:
    """Sentences on the doubts about a run."""
    found = [] if run.results.complete else [ending(run)]
    summary = run.results.summary
    energy, local = (float(summary.get(k) or 0.0) for k in ("energy_error", "local_error"))
    if energy > LARGE_ENERGY_ERROR:
        found.append(f"{run.label}: the energy error is {energy:.2%} of the largest energy.")
    if local > LARGE_LOCAL_ERROR:
        found.append(f"{run.label}: a step errs by {local:.2%} of the largest displacement.")
    recorded = summary.get("warnings", [])
    return found + [f"{run.label}: {text}" for text in recorded]


def ending(run: Run) -> str:
    """How a run that is not complete ended."""
    steps = run.results.metadata.get("steps")
    done = f"at t = {run.end:.4g} s"
    if steps is not None and run.has("histories"):
        done += f", after {run.results.rows('histories') - 1} of {steps} steps"
    words = {
        "running": f"still runs, or was killed; its last record is {done}",
        "stopped": f"was stopped {done}",
        "failed": f"failed {done}",
    }
    reason = run.results.summary.get("error")
    return f"{run.label} {words[run.results.status]}{f' ({reason})' if reason else ''}."


def _head(first: str, content: Content) -> list[str]:
    return [first, *(run.label for run in content.runs)]


def _fact(facts: dict[str, Any], key: str) -> Any:
    value = facts.get(key)
    return value if isinstance(value, int | float | None) else plain(value)


def _length(run: Run, name: str) -> int | None:
    return len(run.results.static(name)) if name in run.results.statics else None


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"
