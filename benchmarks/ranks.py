#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether several ranks give what one gives, step by step from equal states.

Run it under mpirun. Rank 0 marches the scene by itself; from each of its states all ranks together
take the same step on the distributed mesh. Compared are displacements, velocities and joint
forces, largest differences relative to the largest entry that the run has had so far; the bound is
1e-9. Exit status 1 if it is missed.
"""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_joints as dj
from benchmarks._scenes import TIME_STEP, Scene, dam, wall
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.laws.law import JointState, Response
from dolfinx_joints.mesh.node_numbering import NodeNumbering
from dolfinx_joints.solvers.choice import make_solver
from dolfinx_joints.time_integration.initial_state import initial_state
from dolfinx_joints.time_integration.states import DynamicState

SCHEME = dj.EnergyConsistent()
BOUND = 1e-9
QUANTITIES = ("displacement", "velocity", "joint_force")


class Side:
    """The scene on some ranks, and its states as whole arrays that no partition changes.

    Args:
        scene: The scene.
        mesh: Its mesh file.
        comm: Whose ranks share it.
        motion: Motion of its base.
    """

    def __init__(self, scene: Scene, mesh: Any, comm: MPI.Comm, motion: dj.BaseMotion) -> None:
        """Assemble (collective)."""
        self.comm = comm
        self.model = scene.model(scene.read(mesh, comm=comm), scene.law())
        self._nodes = NodeNumbering(self.model.V)
        self._motion = motion
        operator = self.model.operator
        stop = comm.scan(len(operator.areas))
        self._mine = slice(stop - len(operator.areas), stop)

    def solver(self) -> Any:
        """The solver of the dynamic stage (collective)."""
        return make_solver(self.model.system([self._motion]), rule=SCHEME.rule)

    def whole(self, thing: Any) -> Any:
        """A state as a tree of arrays, whole on rank 0 (collective)."""
        if isinstance(thing, PETSc.Vec):
            return self._nodes.gather(thing)
        if isinstance(thing, np.ndarray):
            return self.model.operator.gather(thing)
        if isinstance(thing, DynamicState | Response | JointState):
            return {f.name: self.whole(getattr(thing, f.name)) for f in fields(thing)}
        return thing

    def state(self, tree: dict[str, Any]) -> DynamicState:
        """The rank's part of a state of all."""
        joints = {name: self._points(value) for name, value in tree["joints"].items()}
        local = {name: self._points(value) for name, value in joints.pop("state").items()}
        vectors = {
            name: self._vector(value)
            for name, value in tree.items()
            if name not in ("time", "joints") and value is not None
        }
        response = Response(**joints, state=JointState(**local))
        return DynamicState(time=tree["time"], joints=response, **vectors)

    def _points(self, values: Any) -> Any:
        # Without internal variables there are no rows to hand out.
        handed = isinstance(values, np.ndarray) and len(values) > 0
        return values[self._mine] if handed else values

    def _vector(self, values: np.ndarray) -> PETSc.Vec:
        vector = self.model.stiffness.createVecRight()
        owned = self.model.V.dofmap.index_map.size_local
        vector.setArray(values[self._nodes.number[:owned], : self.model.gdim].ravel())
        return vector

    def compared(self, state: DynamicState) -> dict[str, np.ndarray | None]:
        """Quantities of a state, whole on rank 0 (collective)."""
        forces = self.model.operator.areas[:, None] * state.joints.traction
        return {
            "displacement": self.whole(state.displacement),
            "velocity": self.whole(state.velocity),
            "joint_force": self.whole(forces),
        }


def alone(scene: Scene, mesh: Any, motion: dj.BaseMotion) -> tuple[Side, Any, DynamicState]:
    """The scene on one rank after its static stage, with the solver of its dynamic stage."""
    side = Side(scene, mesh, MPI.COMM_SELF, motion)
    static = dj.Simulation(side.model).statics(steps=scene.load_steps)
    solver = side.solver()
    start = initial_state(solver, displacement=static.displacement, joints=static.joints)
    return side, solver, start


def compare(scene: Scene, steps: int) -> dict[str, Any]:
    """The same steps on one rank and on all (collective)."""
    world = MPI.COMM_WORLD
    motion = dj.BaseMotion(acceleration=scene.shaking(steps * TIME_STEP))
    with scene.mesh_file() as mesh:
        together = Side(scene, mesh, world, motion)
        # On the first rank by itself.
        side, one, state = alone(scene, mesh, motion) if world.rank == 0 else (None, None, None)
    solver = together.solver()
    largest, scale = dict.fromkeys(QUANTITIES, 0.0), dict.fromkeys(QUANTITIES, 0.0)
    for _ in range(steps):
        tree = side.whole(state) if side else None
        found, _ = SCHEME.advance(solver, together.state(world.bcast(tree)), TIME_STEP)
        many = together.compared(found)
        if side is None:
            continue
        state, _ = SCHEME.advance(one, state, TIME_STEP)
        for name, expected in side.compared(state).items():
            scale[name] = max(scale[name], float(np.abs(expected).max()))
            off = float(np.abs(many[name] - expected).max())
            largest[name] = max(largest[name], off / scale[name])
    largest = world.bcast(largest)
    return {
        "dofs": together.model.num_dofs,
        "joint_points": together.model.operator.num_points,
        "ranks": world.size,
        "steps": steps,
        **largest,
        "passed": max(largest.values()) <= BOUND,
    }


def main(arguments: list[str] | None = None) -> int:
    """Print the table; 1 if the bound is missed."""
    names = ("tiny", "coarse", "dam")
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=list(names), choices=names)
    parser.add_argument("--steps", type=at_least(1), default=200)
    parser.add_argument("--quick", action="store_true", help="the tiny wall, 10 steps")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    options = parser.parse_args(arguments)
    if options.quick:
        options.scenes, options.steps = ["tiny"], 10
    root, rows = MPI.COMM_WORLD.rank == 0, {}
    if root:
        print(
            f"Largest relative differences of {MPI.COMM_WORLD.size} ranks from one, step by step "
            f"from equal states; bound {BOUND:g}.\n\n"
            "scene      dofs points steps  displacement  velocity  joint force"
        )
    for name in options.scenes:
        row = rows[name] = compare(dam() if name == "dam" else wall(name), options.steps)
        if root:
            verdict = "agree" if row["passed"] else "MISSED"
            print(
                f"{name:8} {row['dofs']:6d} {row['joint_points']:6d} {row['steps']:5d}"
                f" {row['displacement']:13.1e} {row['velocity']:9.1e}"
                f" {row['joint_force']:12.1e}  {verdict}",
                flush=True,
            )
    if root and options.json:
        print(json.dumps(rows))
    return int(not all(row["passed"] for row in rows.values()))


if __name__ == "__main__":
    dj.abort_on_error(MPI.COMM_WORLD)
    raise SystemExit(main())
