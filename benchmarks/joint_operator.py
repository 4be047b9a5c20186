#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time of what the joints add to an iteration, and how it grows with the number of points.

A plate of two layers of 8-node hexahedra with one joint between the layers, inclined so that no
local axis is a global one; a third each of the points is open, sticks and slides. Times are medians
of several calls, by the slowest rank. A growth of n^1 is linear cost; products with B grow
faster, about n^1.3, between sizes that fit and do not fit the processor's cache.
"""

from __future__ import annotations

import json
import math
import statistics
import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, locate_entities, meshtags
from mpi4py import MPI

import dolfinx_joints as dj
from dolfinx_joints.common.command_line import Parser, at_least
from dolfinx_joints.joints.operator import JointOperator, JointTangent
from dolfinx_joints.laws.law import JointState, Status

COMM = MPI.COMM_WORLD
SIDES = {"quick": (31, 99), "full": (99, 316)}  # cells along x and y: n^2 facets
TURNS = np.radians([20.0, 30.0])  # about x and y
LAW = dj.FrictionNoTension(normal_stiffness=1e11, shear_stiffness=4e10, friction_angle_deg=45.0)


def plate(side: int) -> dj.JointedMesh:
    """``side`` x ``side`` x 2 cubes, 1 m long and wide, turned about y by 30, x by 20 degrees."""
    height = 1.0 / side
    mesh = create_box(COMM, [[0, 0, 0], [1, 1, 2 * height]], [side, side, 2], CellType.hexahedron)
    facet_dim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(facet_dim, facet_dim + 1)
    facets = locate_entities(mesh, facet_dim, lambda x: np.isclose(x[2], height))
    tags = meshtags(mesh, facet_dim, np.sort(facets), np.ones(len(facets), dtype=np.int32))
    (cx, cy), (sx, sy) = np.cos(TURNS), np.sin(TURNS)
    turn = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]) @ [[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]
    mesh.geometry.x[:] = mesh.geometry.x @ turn.T
    return dj.split_mesh(mesh, tags, joints={"joint_1": 1}, groups={})


def seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median time of a collective call, by the slowest rank [s]."""
    times = []
    for _ in range(repeats):
        COMM.barrier()
        start = clock.perf_counter()
        call()
        times.append(COMM.allreduce(clock.perf_counter() - start, op=MPI.MAX))
    return statistics.median(times)


def mixed_state(count: int) -> tuple[np.ndarray, JointState]:
    """A gap of ``count`` points and a state to start from: open, sticking and sliding in turn."""
    kind = np.arange(count) % 3
    rng = np.random.default_rng(COMM.rank)
    gap = np.zeros((count, 3))
    gap[:, 0] = np.where(kind == 0, 1e-4, -1e-4)
    # At 45 degrees a point slides where k_s |slip| > k_n |gap_n|, beyond a slip of 2.5e-4 m.
    size, angle = np.where(kind == 2, 5e-4, 5e-5), 2 * np.pi * rng.random(count)
    gap[:, 1:] = size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return gap, JointState.at_rest(np.tile([-1e-5, 0.0, 0.0], (count, 1)))


def measure(side: int, repeats: int) -> dict[str, Any]:
    """Times at one size, [ms]."""
    start = clock.perf_counter()
    jointed = plate(side)
    mesh_time = clock.perf_counter() - start
    space = fem.functionspace(jointed.mesh, ("Lagrange", 1, (3,)))
    setup = seconds(lambda: JointOperator(jointed, space), 1)
    operator = JointOperator(jointed, space)
    gap, state = mixed_state(len(operator.areas))
    response = LAW.backward_euler(gap, state)
    shares = np.bincount(response.status, minlength=len(Status)) / max(len(gap), 1)
    if len(gap) and shares.min() < 0.3:
        raise RuntimeError(f"The state is not mixed: shares {shares} are open, stick, slide.")
    u, force = operator.matrix.createVecRight(), operator.matrix.createVecRight()
    u.setRandom()
    free = u.duplicate()
    free.set(1.0)
    tangent = JointTangent(operator, free)
    first = seconds(lambda: tangent.assemble(response.tangent), 1)
    times = {
        "gap": seconds(lambda: operator.gap(u), repeats),
        "law": seconds(lambda: LAW.backward_euler(gap, state), repeats),
        "residual": seconds(lambda: operator.force(response.traction, force), repeats),
        "tangent": seconds(lambda: tangent.assemble(response.tangent), repeats),
        "first tangent": first,
        "operator set-up": setup,
        "mesh and splitting": mesh_time,
    }
    return {"points": operator.num_points} | {name: 1e3 * t for name, t in times.items()}


def main() -> None:
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="1e3 and 1e4 points, not 1e4 and 1e5")
    parser.add_argument(
        "--repeats", type=at_least(1), default=9, help="calls of each part [%(default)s]"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    options = parser.parse_args()
    small, large = (
        measure(side, options.repeats) for side in SIDES["quick" if options.quick else "full"]
    )
    names = [name for name in small if name != "points"]
    ratio = math.log(large["points"] / small["points"])
    growth = {name: math.log(large[name] / small[name]) / ratio for name in names}
    if COMM.rank:
        return
    print(f"{'time [ms] at points':20}{small['points']:>12}{large['points']:>12}      growth")
    for name in names:
        print(f"{name:20}{small[name]:12.2f}{large[name]:12.2f}  n^{growth[name]:.2f}")
    if options.json:
        print(json.dumps({"ranks": COMM.size, "sizes": [small, large], "growth": growth}))


if __name__ == "__main__":
    main()
