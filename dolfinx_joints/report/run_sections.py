# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Report sections on the computation: energies, cost, iterations, files."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from dolfinx_joints import __version__
from dolfinx_joints.postprocessing import measures, plots
from dolfinx_joints.postprocessing.energy_lines import energy_lines, waves_at_end
from dolfinx_joints.report.page import Cell, Section, paragraph, plain, table
from dolfinx_joints.report.panels import Curve, panels
from dolfinx_joints.report.runs import Content, nothing
from dolfinx_joints.results.quantities import ENERGY_TERMS

_COUNTS = {
    "accepted": "accepted substeps",
    "failed": "rejected substeps",
    "iterations": "total iterations",
    "solver": "solver",
    "peak_mb": "peak memory [MB]",
}
_ERRORS = {
    "energy_error": "energy error / largest energy [%]",
    "imbalance": "unexplained energy / largest energy [%]",
    "local_error": "largest error of a single step / largest displacement [%]",
}


def cost(content: Content) -> Section:
    """Return the section on time, steps, iterations and memory."""
    summaries = [run.results.summary for run in content.runs]
    steps = [r.results.rows("histories") - 1 if r.has("histories") else None for r in content.runs]
    rows: list[list[Cell]] = [["time steps", *steps]]
    rows += [[text, *(s.get(key) for s in summaries)] for key, text in _COUNTS.items()]
    per_substep = [
        s["iterations"] / s["accepted"] if s.get("accepted") and "iterations" in s else None
        for s in summaries
    ]
    rows.append(["iterations per substep", *per_substep])
    stages = [s.get("seconds", {}) for s in summaries]
    names = dict.fromkeys(name for stage in stages for name in stage)
    rows += [[f"{name} [s]", *(stage.get(name) for stage in stages)] for name in names]
    rows.append(["total [s]", *(run.seconds for run in content.runs)])
    note = paragraph("Times are wall-clock times of the computation.", "note")
    return Section("cost", "Cost", [table("Work of each run", _head("", content), rows), note])


def energies(content: Content) -> Section:
    """Return the section on the energy balance, with plots of the energies."""
    summaries = [run.results.summary for run in content.runs]
    rows: list[list[Cell]] = [
        [text, *(100.0 * s[key] if s.get(key) is not None else None for s in summaries)]
        for key, text in _ERRORS.items()
    ]
    unstated = [", ".join(s.get("laws_without_losses") or ()) or None for s in summaries]
    if any(unstated):
        rows.append(["the balance excludes joints with the laws", *unstated])
    pieces = [
        table("Energy balance", _head("", content), rows),
        paragraph(
            "The energy error is stored energy − stored energy at the start − input + energy "
            "dissipated by damping and friction. With an energy-consistent scheme only rounding, "
            "about 1e-12 %, remains. The error of a single step is an "
            "estimate, and not the error of the run; dj.accuracy estimates that one.",
            "note",
        ),
    ]
    for number, run in enumerate(content.runs):
        if not run.has("energy", *ENERGY_TERMS):
            pieces.append(paragraph(f"The file of {run.label} has no energies."))
            continue
        time, values = run.results.time("energy"), energy_lines(run.results)
        largest = max(float(np.abs(v).max(initial=0.0)) for v in values.values())
        joule, unit = plots.energy_unit(largest)
        curves = [[(term, time, v / joule) for term, v in values.items() if term != "error"]]
        curves.append([("error", time, values["error"])])
        titles = [f"energy [{unit}]", "error [J]"]
        spec = panels(curves, titles, "time [s]", shown=len(values))
        caption = f"Energies of {run.label} against time, and the energy error."
        through = waves_at_end(run.results)
        if through is not None:
            joule, unit = plots.energy_unit(max(map(abs, through)))
            incoming, outgoing = (plain(energy / joule) for energy in through)
            caption += (
                " The curve waves is the energy that entered through absorbing boundaries of rock "
                f"or water minus the energy that left: {incoming} minus {outgoing} {unit} at the "
                "end. The curves input and viscous do not include these boundaries."
            )
        pieces.append(content.drawings.plot(f"energies-{number + 1}", spec, caption))
    return Section("energies", "Energies", pieces)


def convergence(content: Content) -> Section:
    """Return the section on the iterations and joint states of each step."""
    runs = [run for run in content.runs if run.has("histories", "iterations", "joint_open")]
    if not runs:
        return nothing("iterations", "Iterations and joint states", "histories")
    rows = measures.joint_shares(*(run.results for run in runs))
    titles = ["iterations [-]", *(row.heading for row in rows)]
    curves: list[list[Curve]] = [[] for _ in titles]
    for run in runs:
        time = run.results.time("histories")
        curves[0].append((run.label, time, run.results.series("histories", "iterations")))
        for panel, row in zip(curves[1:], rows if run.results.joints else (), strict=False):
            if run.has("histories", row.name):
                share = row.factor * run.results.series("histories", row.name)
                panel.append((run.label, time, share))
    drawn = [(panel, title) for panel, title in zip(curves, titles, strict=True) if panel]
    spec = panels([p for p, _ in drawn], [t for _, t in drawn], "time [s]")
    states = ", ".join(row.label for row in rows)
    caption = f"Iterations of each step, and shares of joint points without tied ones: {states}."
    plotted = content.drawings.plot("iterations-plot", spec, caption)
    return Section("iterations", "Iterations and joint states", [plotted])


def versions(content: Content) -> Section:
    """Return the section on the results files and on the programs that wrote the report."""
    rows = [
        [run.label, str(run.results.path), run.results.created, run.results.status]
        for run in content.runs
    ]
    packages = ["numpy", "scipy", "h5py", "matplotlib", "pyvista"]
    packages.append("weasyprint" if content.drawings.printed else "plotly")
    own = [["dolfinx_joints", __version__], ["Python", sys.version.split()[0]]]
    used = [*own, *([package, _version(package)] for package in packages)]
    pieces = [
        table("Results files", ["run", "file", "created (UTC)", "status"], rows),
        table("This report was written with", ["package", "version"], used),
    ]
    return Section("versions", "Files and versions", pieces)


def _head(first: str, content: Content) -> list[str]:
    return [first, *(run.label for run in content.runs)]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"
