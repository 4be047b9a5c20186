#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Comparison with OpenSees on the wall of `jointed_wall`: crest motion and time per step.

`make bench-peers` installs OpenSees and runs this. Both programs have the same nodes, bricks with
full integration, consistent mass, damping and joint points. OpenSees has a
`zeroLengthContactASDimplex` at each pair of nodes, with stiffness times area. Self weight is
followed by the motion from its start.

Without joints the programs must agree to 1e-6: average acceleration and the midpoint rule give the
same displacements except for the averaging of the load. With joints they must agree to 1e-2: the
laws are the same, but OpenSees has contact at the end of a step and its tangent by differences. If
OpenSees extrapolates contact from the last steps, a step is one linear system and the joints lag
behind; only the time of that run is meaningful.

Processor times are medians of all steps except the first. The programs run alternately in separate
processes. OpenSees keeps the factor in linear steps; other solver options that were tried are in
docs/decisions/time_per_step.md.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mpi4py import MPI

import numpy as np

import dolfinx_joints as dj
from benchmarks.shared.measure import StepWatch, march, median_of
from benchmarks.shared.scenes import DIVISIONS, GRAVITY, TIME_STEP, Scene, wall
from benchmarks.shared.tables import table
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.simulation.record import Record

Row = dict[str, Any]

COLUMNS = (
    "| run | here [ms] | OpenSees [ms] | factor | iterations here | OpenSees |"
    " difference: static | crest | crest at the end here [um] | OpenSees [um] |\n"
    "| {kind} | {ours_cpu_ms:.2f} | {opensees_cpu_ms:.1f} | {factor:.0f} | {ours_iterations:.1f} |"
    " {opensees_iterations:.1f} | {static_difference:.0e} | {crest_difference:.0e} |"
    " {ours_crest_um[0]:.2f}, {ours_crest_um[1]:.2f}, {ours_crest_um[2]:.2f} |"
    " {opensees_crest_um[0]:.2f}, {opensees_crest_um[1]:.2f}, {opensees_crest_um[2]:.2f} |"
)
KINDS = ("linear", "jointed", "extrapolated")
BOUNDS = {"linear": 1e-6, "jointed": 1e-2, "extrapolated": np.inf}
TO_BRICK = [0, 1, 3, 2, 4, 5, 7, 6]  # from tensor order to bottom and top corners in turn


class SceneFile(StepWatch):
    """Monitor that also writes the model for OpenSees and stores displacements of all nodes.

    Args:
        scene: The scene.
        path: File for the model.
        steps: Number of steps of the run.
        overlap: Initial overlap of the joint faces in OpenSees [m]. Without it, contact has no
            stiffness there, and a block that is supported by it alone has no static state.
        dt: Time step [s].

    Attributes:
        top: Nodes at the crest point, two if it is on a joint.
        static: Displacements of the static state, shape (nodes, 3), [m].
        last: Displacements of the last step minus ``static``, shape (nodes, 3), [m].
    """

    def __init__(
        self, scene: Scene, path: Path, steps: int, overlap: float = 0.0, dt: float = TIME_STEP
    ) -> None:
        """Store the path and the motion."""
        super().__init__(scene)
        self._overlap, self._dt = overlap, dt
        self._path, self._motion = path, scene.shaking(steps * dt)
        self._steps = steps

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Write the arrays."""
        self.static = first.displacement.getArray(readonly=True).reshape(-1, 3).copy()
        ground = [self._motion(i * self._dt) for i in range(self._steps + 1)]
        given = arrays(self._scene, model)
        distance = np.linalg.norm(given["nodes"] - np.array(self._scene.crest), axis=1)
        self.top = np.flatnonzero(distance < distance.min() + 1e-9 * np.ptp(given["nodes"]))
        if len(given["pairs"]):
            given["nodes"][given["pairs"][:, 1]] -= self._overlap * given["normals"]
        given |= {"watched": self.top, "acceleration": np.array(ground), "dt": self._dt}
        np.savez(self._path, **given)
        super().start(model, stage, steps, first)

    def record(self, record: Record) -> None:
        """Store the displacements."""
        super().record(record)
        self.last = record.displacement.getArray(readonly=True).reshape(-1, 3) - self.static


def arrays(scene: Scene, model: dj.Model) -> dict[str, Any]:
    """Return the input of OpenSees for a wall on one rank: nodes, bricks, node pairs at joints."""
    nodes = model.V.tabulate_dof_coordinates().copy()
    model_arrays: dict[str, Any] = {
        "nodes": nodes,
        "cells": model.V.dofmap.list[:, TO_BRICK],
        "clamped": np.flatnonzero(nodes[:, 2] < 1e-9 * np.ptp(nodes[:, 2])),
        "material": [scene.material.young, scene.material.poisson, scene.material.density],
        "gravity": np.array([0.0, 0.0, -GRAVITY]),
        "damping": model.rayleigh.stiffness_factor,
        "pairs": np.zeros((0, 2), dtype=int),
        "areas": np.zeros(0),
        "normals": np.zeros((0, 3)),
        "law": np.zeros(3),
    }
    operator = model.operator
    if operator is None:
        return model_arrays
    law = scene.law()
    angle = np.radians(law.friction_angle_deg)
    model_arrays["law"] = [law.normal_stiffness, law.shear_stiffness, np.tan(angle)]
    model_arrays |= {"areas": operator.areas, "normals": operator.frames[:, 0]}
    # A row of the normal gap, n . (u+ - u-), is -n at one node and n at the other.
    pairs = []
    for point, normal in enumerate(model_arrays["normals"]):
        columns, values = operator.matrix.getRow(3 * point)
        along = np.argsort(values * normal[columns % 3])
        pairs.append(columns[along[[0, -1]]] // 3)
    return model_arrays | {"pairs": np.array(pairs)}


def missing() -> str:
    """Return why OpenSees cannot be imported, in one line; empty if it can."""
    code = "import openseespy.opensees"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def opensees(kind: str, scene: Path) -> dict[str, np.ndarray]:
    """Run OpenSees in a separate process; return its results.

    Raises:
        SystemExit: The run failed.
    """
    output = scene.with_name(f"{kind}_found.npz")
    command = [sys.executable, "-m", "benchmarks.shared.opensees", kind, str(scene), str(output)]
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root)
    if done.returncode:
        raise SystemExit(f"OpenSees, {kind}: {done.stderr.strip()[-2000:]}")
    with np.load(output) as numbers:
        return dict(numbers)


def compare(scene: Scene, steps: int, repeat: int) -> list[Row]:
    """Return a row for each kind of run."""
    ours: dict[str, list[Row]] = {"linear": [], "jointed": []}
    theirs: dict[str, list[dict[str, np.ndarray]]] = {kind: [] for kind in KINDS}
    with TemporaryDirectory() as name, scene.mesh_file() as mesh:
        for _ in range(repeat):
            for kind, runs in ours.items():
                law = scene.law() if kind == "jointed" else None
                path = Path(name) / f"{kind}.npz"
                watch = SceneFile(scene, path, steps)
                runs.append(march(scene, mesh, steps, law=law, watch=watch) | {"watch": watch})
                theirs[kind].append(opensees(kind, path))
            theirs["extrapolated"].append(opensees("extrapolated", path))
    same = {"linear": "linear", "jointed": "jointed", "extrapolated": "jointed"}
    return [row(kind, ours[same[kind]], theirs[kind], steps) for kind in KINDS]


def row(kind: str, ours: list[Row], theirs: list[dict[str, np.ndarray]], steps: int) -> Row:
    """Return times, iterations and displacements of one kind of run."""
    watch = ours[-1]["watch"]
    last, crest = theirs[-1], watch.top
    off = {name: last[name] - getattr(watch, name) for name in ("static", "last")}
    fast = median_of(ours, "cpu_ms")
    slow = statistics.median(float(np.median(run["cpu_ms"][1:])) for run in theirs)
    return {
        "kind": kind,
        "dofs": ours[-1]["dofs"],
        "joint_points": ours[-1]["joint_points"],
        "steps": steps,
        "ours_cpu_ms": fast,
        "opensees_cpu_ms": slow,
        "factor": slow / fast,
        "ours_iterations": float(np.mean(watch.iterations)),
        "opensees_iterations": max(1.0, float(np.mean(last["iterations"]))),
        "ours_crest_um": list(1e6 * watch.last[crest[0]]),
        "opensees_crest_um": list(1e6 * last["last"][crest[0]]),
        "static_difference": float(np.abs(off["static"]).max() / np.abs(watch.static).max()),
        "crest_difference": float(
            np.linalg.norm(off["last"][crest], axis=1).max()
            / np.linalg.norm(watch.last[crest], axis=1).max()
        ),
    }


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", default="coarse", choices=sorted(DIVISIONS))
    parser.add_argument("--steps", type=at_least(2), default=12)
    parser.add_argument("--repeat", type=at_least(1), default=3, help="runs for medians")
    parser.add_argument("--quick", action="store_true", help="the tiny wall, once")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Print a line for each kind of run; return 1 if the programs disagree."""
    options = parse_arguments(arguments)
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("opensees_wall: OpenSees runs on one rank; start this on one.")
    reason = missing()
    if reason:
        print(f"OpenSees is left out ({reason}); make bench-peers installs it.")
        return 0
    if options.quick:
        options.mesh, options.repeat = "tiny", 1
    rows = compare(wall(options.mesh), options.steps, options.repeat)
    print(
        f"{options.mesh} wall, {rows[0]['dofs']} dofs tied, {rows[1]['dofs']} with "
        f"{rows[1]['joint_points']} joint points, {options.steps} steps, {options.repeat} "
        f"repeat(s), load average {os.getloadavg()[0]:.1f}\n\n{table(COLUMNS, rows)}"
    )
    if options.json:
        print(json.dumps(rows))
    return int(any(line["crest_difference"] > BOUNDS[line["kind"]] for line in rows))


if __name__ == "__main__":
    sys.exit(main())
