#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether interior-facet integrals over joints give what the operator B and laws by hand give.

operator: mass int |[u + x]|^2 dS, jump, force and tangent by forms over ``dS`` against B, on grids
of all shapes, orders and scenes, distorted, their cells and nodes in random order, with random
tractions and tangents. Largest differences relative to the largest value; the bound is 1e-13.

wall: statics and the shaking of the wall of benchmarks/jointed_wall.py by each solver. Largest
difference of the displacement from the monolithic one's at any step, relative to the largest; the
bound is 1e-10. Newton's residuals, relative to the forces, of the step that took most iterations.

law: a cohesive law in UFL against the same by hand, of a wall that is shaken: tractions, tangents
and displacements to 1e-12, and its energies, each from its own formula, to 1e-10 of the largest.

`make bench-forms`: the first part on 1 to 3 ranks, both DOLFINx. Status 1: a bound is missed.
"""

from __future__ import annotations

import gc
import json
import statistics
from typing import Any

from mpi4py import MPI

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

import dolfinx_joints as dj
from benchmarks.shared.cohesive import (
    COHESIVE,
    ByHand,
    cohesive,
    energy_lines,
    left_over,
    random_steps,
)
from benchmarks.shared.grids import CASES, SHAPES, distorted, name_of
from benchmarks.shared.measure import StepWatch, free_memory, slowest
from benchmarks.shared.scenes import TIME_STEP, Scene, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.joints.form_operator import FormOperator
from dolfinx_joints.joints.operator import JointOperator
from dolfinx_joints.simulation.record import Record

COMM = MPI.COMM_WORLD
SCENES = [*CASES, "gap"]
BOUNDS = {"operator": 1e-13, "wall": 1e-10, "law": 1e-12, "energy": 1e-10}
NEWTON = dj.SolverOptions(relative_tolerance=1e-13)
# A power of two: the scheme need not round 2/dt, nor the benchmark the difference of two times.
DT = 2.0**-8

Found = dict[str, Any]


def largest(values: Any) -> float:
    """Largest entry of all ranks (collective)."""
    return COMM.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)


def relative(found: Any, expected: Any) -> float:
    """Largest difference relative to the largest value (collective)."""
    return largest(found - expected) / largest(expected)


def say(text: str = "") -> None:
    """Print on rank 0."""
    if COMM.rank == 0:
        print(text, flush=True)


def against_operator(jointed: dj.JointedMesh, rule: str) -> dict[str, float]:
    """Relative differences of forms over ``dS`` from B, with a rule, by name (collective)."""
    mesh, degree = jointed.mesh, jointed.shape.degree
    V = fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))
    B = JointOperator(jointed, V, quadrature=rule)
    forms, rng = FormOperator(B), np.random.default_rng(COMM.rank)
    u = fem.Function(V)
    vector = u.x.petsc_vec
    vector.setRandom()
    u.x.scatter_forward()
    count = len(B.areas)
    traction, tangent = rng.normal(size=(count, 3)), rng.normal(size=(count, 3, 3))
    free = vector.duplicate()
    free.set(1.0)
    jump = ufl.jump(u + ufl.SpatialCoordinate(mesh))
    square = fem.form(ufl.inner(jump, jump) * jointed.dS(quadrature=rule, degree=degree))
    gap = B.jump(vector) + B.initial_gap
    mass = COMM.allreduce(B.areas @ np.einsum("ni,ni->n", gap, gap))
    by_matrix, by_form = (o.tangent_matrix(free).assemble(tangent) for o in (B, forms))
    scale = by_matrix.norm(PETSc.NormType.NORM_INFINITY)
    by_form.axpy(-1.0, by_matrix, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    forces = [o.force(traction, vector.duplicate()).getArray() for o in (forms, B)]
    return {
        "mass": abs(COMM.allreduce(fem.assemble_scalar(square)) / mass - 1.0),
        "jump": relative(forms.jump(vector), B.jump(vector)),
        "force": relative(*forces),
        "tangent": by_form.norm(PETSc.NormType.NORM_INFINITY) / scale,
    }


def operator(quick: bool, _: int) -> Found:
    """Tables by rule: of each shape and scene the largest of the differences (collective)."""
    rows, worst = {}, dict.fromkeys(("mass", "jump", "force", "tangent"), 0.0)
    for rule in ("nodal",) if quick else ("nodal", "gauss"):
        say(f"\n{rule + ' rule':16}" + "".join(f"{scene:>11}" for scene in SCENES))
        for shape in SHAPES[:3] if quick else SHAPES:
            row = {}
            for scene in SCENES:
                free_memory()
                found = against_operator(distorted(COMM, shape, scene), rule)
                worst = {name: max(value, found[name]) for name, value in worst.items()}
                row[scene] = max(found.values())
            rows[f"{name_of(shape)} {rule}"] = row
            say(f"{name_of(shape):16}" + "".join(f"{row[scene]:11.1e}" for scene in SCENES))
    say("\nLargest of all: " + ", ".join(f"{name} {value:.1e}" for name, value in worst.items()))
    return {"scenes": rows, **worst, "passed": max(worst.values()) <= BOUNDS["operator"]}


class Kept(StepWatch):
    """Monitor that keeps all records, that of the static state included."""

    def start(self, model: dj.Model, stage: str, steps: int, first: Record) -> None:
        """Keep the static state."""
        super().start(model, stage, steps, first)
        self.records = [first]

    def record(self, record: Record) -> None:
        """Keep a step."""
        self.records.append(record)
        super().record(record)


def read(scene: Scene) -> dj.JointedMesh:
    """The mesh, once for all runs: ranks may part it in another way each time (collective)."""
    with scene.mesh_file() as path:
        return scene.read(path)


def run(scene: Scene, model: dj.Model, solver: str, steps: int, dt: float) -> Kept:
    """Static loads, then the shaking (collective)."""
    kept = Kept(scene)
    simulation = dj.Simulation(model, monitors=[kept], solver=solver, options=NEWTON)
    simulation.statics(steps=scene.load_steps)
    simulation.dynamics(dt=dt, steps=steps, motion=scene.shaking(steps * dt))
    return kept


def apart(kept: Kept, reference: Kept) -> list[float]:
    """Differences of displacements at all records, relative to the largest (collective)."""
    expected = [record.displacement.getArray() for record in reference.records]
    scale = max(largest(u) for u in expected)
    found = [record.displacement.getArray() for record in kept.records]
    return [largest(u - v) / scale for u, v in zip(found, expected, strict=True)]


def walls(quick: bool, steps: int) -> Found:
    """Differences, times and Newton's residuals of the solvers (collective)."""
    scene = wall("tiny" if quick else "coarse")
    model = scene.model(read(scene), scene.law())
    runs = {
        kind: run(scene, model, kind, steps, TIME_STEP)
        for kind in ("monolithic", "forms", "condensed")
    }
    reference = runs["monolithic"]
    hardest = max(reference.records[1:], key=lambda r: r.solve.iterations).step
    say(f"\n{scene.name} wall, {steps} steps; differences of displacements from monolithic\n")
    say("solver         statics   dynamics   ms per step (processor)   iterations")
    found: Found = {"step": hardest}
    for kind, kept in runs.items():
        off, ms = apart(kept, reference), slowest(statistics.median(kept.cpu[1:]))
        residuals = kept.records[hardest].solve.residuals
        row = {"statics": off[0], "dynamics": max(off), "cpu_ms": ms, "residuals": residuals}
        row["iterations"] = statistics.mean(kept.iterations)
        found[kind] = row
        say(f"{kind:12}{off[0]:10.1e}{max(off):11.1e}{ms:26.1f}{row['iterations']:13.1f}")
    say(f"\nNewton's residuals of step {hardest}")
    for kind in ("monolithic", "forms"):
        say(f"{kind:12}" + " ".join(f"{r:.1e}" for r in found[kind]["residuals"]))
    found["passed"] = max(found[kind]["dynamics"] for kind in runs) <= BOUNDS["wall"]
    return found


def law(_: bool, steps: int) -> Found:
    """A law in UFL against the same by hand, and its energies (collective)."""
    by_ufl, by_hand = dj.PotentialJoint(cohesive, **COHESIVE), ByHand()
    gap, state = random_steps()
    off = {}
    for rule in ("backward_euler", "discrete_gradient"):
        one, other = (getattr(each, rule)(gap, state) for each in (by_ufl, by_hand))
        for name in ("traction", "tangent"):
            off[f"{name}, {rule}"] = relative(getattr(one, name), getattr(other, name))
    scene = wall("tiny")
    jointed = read(scene)
    model, reference = (scene.model(jointed, each) for each in (by_ufl, by_hand))
    kept, expected = (run(scene, each, "monolithic", steps, DT) for each in (model, reference))
    off[f"displacement of {steps} steps"] = max(apart(kept, expected))
    opened = largest(np.maximum(kept.records[-1].joints.state.gap[:, 0], 0.0))
    say(f"\nCohesive law in UFL against the same by hand; opened by {opened:.1e} m at the end")
    for name, value in off.items():
        say(f"{name:32}{value:9.1e}")
    system = model.system([dj.BaseMotion(acceleration=scene.shaking(steps * DT))])
    lines = energy_lines(system, kept.records, by_hand.stored_energy)
    scale = max(abs(value) for line in lines for value in line.values())
    left = max(abs(left_over(lines[0], line)) for line in lines) / scale
    say(f"\nEnergies [J] at the end of {steps} steps, by formula and as the run's ledger has them")
    for name, value in lines[-1].items():
        say(f"{name:12}{value:24.15e}{getattr(kept.records[-1].energy, name):24.15e}")
    say(f"left over at any step, relative to the largest: {left:.1e}")
    passed = max(off.values()) <= BOUNDS["law"] and left <= BOUNDS["energy"]
    return {"differences": off, "energies": lines[-1], "left": left, "passed": bool(passed)}


def main(arguments: list[str] | None = None) -> int:
    """Print the tables; 1 if a bound is missed."""
    parser = Parser(description=__doc__.splitlines()[0])
    parts = ["operator", "wall", "law"]
    parser.add_argument("--parts", nargs="+", default=parts, choices=parts)
    parser.add_argument("--steps", type=at_least(2), default=200, help="steps of the walls")
    parser.add_argument("--quick", action="store_true", help="few shapes, the tiny wall, 10 steps")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args(arguments)
    steps = 10 if options.quick else options.steps
    if COMM.size > 1:
        gc.disable()  # ranks free meshes together, by `free_memory`
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    say(f"DOLFINx {dolfinx.__version__}, PETSc {petsc}, {COMM.size} rank(s)")
    tables = {"operator": operator, "wall": walls, "law": law}
    found = {part: tables[part](options.quick, steps) for part in options.parts}
    if options.json:
        say(json.dumps(found))
    return int(not all(table["passed"] for table in found.values()))


if __name__ == "__main__":
    dj.abort_on_error(COMM)
    raise SystemExit(main())
