#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Print the README's table of features, each with files, test and a measured number.

``--write`` writes the table to the README.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.problems import SCHEMES, errors, impact, march
from benchmarks.shared.scenes import TIME_STEP, wall
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.geometry.ambiesta import ambiesta
from dolfinx_joints.geometry.jointed_wall import jointed_wall

PROJECT = Path(__file__).resolve().parents[1]
STEPS = 40


class Row(NamedTuple):
    """Feature of the package.

    Attributes:
        feature: Description of the feature.
        files: Files that implement it, separated by spaces.
        test: Test that shows it.
        number: Function that returns the number of the table.
    """

    feature: str
    files: str
    test: str
    number: Callable[[], str]


def distance_of_meshes() -> str:
    """Compare the nodes of a dam with duplicated faces with those of the split dam."""
    with TemporaryDirectory() as folder:
        points = []
        for duplicated in (False, True):
            path = ambiesta(Path(folder) / "dam.msh", size=12.0, order=1, duplicated=duplicated)
            nodes = dj.read_msh(path, MPI.COMM_SELF).mesh.geometry.x
            points.append(nodes[np.lexsort(np.round(nodes, 6).T)])
    off = np.abs(np.subtract(*points)).max()
    return f"{len(points[0])} nodes as in the split mesh, difference {off:.1g} m"


def elongation() -> str:
    """Compare the shortening of a jointed bar with p L / E + p / k_n."""
    pressure, young, stiffness = 1e6, 24e9, 1e11
    with TemporaryDirectory() as folder:
        path = jointed_wall(Path(folder) / "bar.msh", divisions=(4, 1, 1), joints=1)
        model = dj.Model(
            dj.read_msh(path, MPI.COMM_SELF),
            material=dj.Elastic(young=young, poisson=0.0, density=2400.0),
            joints=dj.frictionless(normal_stiffness=stiffness),
            supports=[dj.Fixed(group="x_min"), dj.Fixed(group="base", components="z")],
            loads=[dj.Pressure(group="x_max", value=pressure)],
        )
    moved = -dj.Simulation(model).statics().displacement.getArray().min()
    expected = pressure * 20.0 / young + pressure / stiffness
    return f"bar and joint in series: error {abs(moved / expected - 1.0):.0e}"


def shaken(solver: str, comm: MPI.Comm) -> np.ndarray:
    """Return the crest displacement of a small shaken wall [m] (collective)."""
    from benchmarks.shared.measure import StepWatch

    scene = wall("tiny")
    with scene.mesh_file() as path:
        model, watch = scene.model(scene.read(path, comm=comm), scene.law()), StepWatch(scene)
        run = dj.Simulation(model, monitors=[watch], solver=solver)
        run.statics()
        run.dynamics(dt=TIME_STEP, steps=STEPS, motion=scene.strong_shaking(STEPS * TIME_STEP))
    return np.array(watch.crest)


def forms() -> str:
    """Compare joints by interior-facet integrals with the condensed default."""
    one, other = (shaken(solver, MPI.COMM_WORLD) for solver in ("forms", "auto"))
    return f"difference from the default solver {np.abs(one - other).max() / np.abs(one).max():.0e}"


def order() -> str:
    """Measure the order of Newmark's scheme on a mass that strikes a soft stop."""
    problem = impact(1.0)
    off = [
        errors(problem, march(problem, SCHEMES["newmark"], problem.period / n), midpoint=False)
        for n in (200, 400)
    ]
    return f"Newmark: order {np.log2(off[0]['displacement'] / off[1]['displacement']):.2f}"


def demos() -> str:
    """Count the demos."""
    return f"{len(list((PROJECT / 'demos').glob('[0-9]*.py')))} scripts"


def ranks() -> str:
    """Compare the shaken wall on 2 ranks with 1 rank."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "crest.npy"
        command = [sys.executable, "-m", "benchmarks.brief", "--crest", str(path)]
        subprocess.run(["mpirun", "-n", "2", "--oversubscribe", *command], check=True, cwd=PROJECT)
        two, one = np.load(path), shaken("auto", MPI.COMM_WORLD)
    return f"2 ranks and 1 differ by {np.abs(two - one).max() / np.abs(one).max():.0e}"


def impact_error() -> str:
    """Measure the error of the paper's impact, a stop 100 times as stiff, with adaptive steps."""
    problem, control = impact(100.0), dj.StepControl(tolerance=3e-5, max_halvings=8)
    run = march(problem, SCHEMES["ec"], problem.period / 120.0, control)
    off = errors(problem, run, midpoint=True)["displacement"]
    return f"default scheme: error {100 * off:.2g} % in {run.steps} adaptive steps"


def stated(page: str, pattern: str, text: str) -> Callable[[], str]:
    """Return a reader of numbers that another benchmark wrote on a page."""

    def read() -> str:
        match = re.search(pattern, (PROJECT / page).read_text("utf-8"))
        assert match is not None, f"{page} has no {pattern}"
        return text.format(*match.groups())

    return read


ROWS = (
    Row(
        "Gmsh builds the dam with duplicated joint faces",
        "geometry/ambiesta.py",
        "tests/geometry/test_duplicated_joints.py",
        distance_of_meshes,
    ),
    Row(
        "UFL forms cover the elastic continuum",
        "dolfinx_joints/body/elasticity.py",
        "tests/verification/test_series_bar.py",
        elongation,
    ),
    Row(
        "Interior-facet integrals of the friction law by return mapping",
        "dolfinx_joints/joints/form_operator.py dolfinx_joints/laws/points/return_mapping.py",
        "tests/solvers/test_forms_solver.py",
        forms,
    ),
    Row(
        "Newmark, Newton, PETSc solvers",
        "dolfinx_joints/time_integration/newmark.py dolfinx_joints/solvers/newton.py",
        "tests/time_integration/test_schemes.py",
        order,
    ),
    Row("Python demo scripts", "demos/00_first_steps.py", "make demo", demos),
    Row("MPI runs", "dolfinx_joints/common/mpi.py", "tests/verification/test_many_ranks.py", ranks),
    Row(
        "Validation against the analytical impact",
        "dolfinx_joints/exact.py",
        "tests/verification/test_impact.py",
        impact_error,
    ),
    Row(
        "Error against run time",
        "benchmarks/error_against_time.py",
        "docs/accuracy.md",
        stated(
            "docs/accuracy.md", r"Default scheme: ([\d.]+ s)", "time step: 1 % at the crest in {}"
        ),
    ),
    Row(
        "Stability on stiff and extreme cases",
        "benchmarks/stability.py",
        "docs/stability.md",
        stated(
            "docs/stability.md",
            r"energy-consistent scheme \| (\d+) \| (\d+)",
            "default scheme: {1} of {0} extreme runs fail",
        ),
    ),
    Row(
        "Light imports",
        "benchmarks/lean.py",
        "tests/test_imports.py",
        stated(
            "docs/design.md",
            r"modules of (\d+)[^\n]*\n[^\n]*\n\| linear 2-D \| (\d+)",
            "a linear 2-D run imports {1} of {0} modules",
        ),
    ),
)


def table() -> str:
    """Return the table in Markdown."""
    lines = ["| feature | where | shown by | number |", "|---|---|---|---|"]
    for row in ROWS:
        test = row.test if " " in row.test else f"[{Path(row.test).name}]({row.test})"
        where = ", ".join(f"[{Path(file).name}]({file})" for file in row.files.split())
        lines.append(f"| {row.feature} | {where} | {test} | {row.number()} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Print the table; write it to the README with ``--write``."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the table to the README")
    parser.add_argument("--crest", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.crest:
        crest = shaken("auto", MPI.COMM_WORLD)
        if MPI.COMM_WORLD.rank == 0:
            np.save(options.crest, crest)
        return
    text = table()
    print(text)
    if options.write:
        readme = PROJECT / "README.md"
        head, _, remainder = readme.read_text("utf-8").partition("| feature |")
        tail = remainder.partition("\n\n")[2]
        readme.write_text(f"{head}{text}\n\n{tail}", "utf-8")


if __name__ == "__main__":
    main()
