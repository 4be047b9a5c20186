# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Body with joints in OpenSees: a program that reads and writes arrays.

    python3 -m benchmarks.shared.opensees KIND SCENE.npz RESULT.npz

It imports neither DOLFINx nor mpi4py, because their MPI conflicts with that of OpenSees.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Arrays = Mapping[str, Any]

# Norm of an increment relative to the first one in the step.
TOLERANCE, MOST_ITERATIONS = 1e-6, 60
LINE_SEARCH = ("NewtonLineSearch", "-type", "Bisection")


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Solution method of OpenSees.

    Attributes:
        system: Linear solver; SparseSYM needs symmetric tangents.
        static: Algorithm of the static state.
        repeats: Number of static steps, each with the full load.
        steps: Algorithms of a time step; the next one is used if one does not converge.
        extrapolated: Whether the contact state is extrapolated from the last steps (IMPL-EX), so
            that a step is one linear system. Otherwise it is the state at the end of the step.
    """

    system: str
    static: Sequence[str]
    repeats: int = 1
    steps: Sequence[Sequence[str]]
    extrapolated: bool = False


KINDS = {
    "linear": Kind(system="SparseSYM", static=["Linear"], steps=[("Linear", "-factorOnce")]),
    "jointed": Kind(system="SuperLU", static=LINE_SEARCH, steps=[("KrylovNewton",), LINE_SEARCH]),
    "extrapolated": Kind(
        system="SparseSYM",
        static=["Linear"],
        repeats=10,
        steps=[("Linear",)],
        extrapolated=True,
    ),
}


def build(ops: Any, scene: Arrays, kind: Kind) -> None:
    """Create nodes, bricks with their weight, and a contact element at each pair of nodes."""
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    for tag, place in enumerate(scene["nodes"].tolist(), 1):
        ops.node(tag, *place)
    for node in scene["clamped"].tolist():
        ops.fix(node + 1, 1, 1, 1)
    young, poisson, density = scene["material"].tolist()
    ops.nDMaterial("ElasticIsotropic", 1, young, poisson, density)
    weight = (density * scene["gravity"]).tolist()
    for tag, cell in enumerate((scene["cells"] + 1).tolist(), 1):
        ops.element("stdBrick", tag, *cell, 1, *weight)
    first = len(scene["cells"]) + 1
    normal, shear, friction = scene["law"].tolist()
    pairs = zip(scene["pairs"].tolist(), scene["areas"], scene["normals"].tolist(), strict=True)
    for tag, ((minus, plus), area, direction) in enumerate(pairs, first):
        ops.element(
            "zeroLengthContactASDimplex",
            *(tag, minus + 1, plus + 1),
            *(normal * area, shear * area, friction),
            *("-orient", *direction, "-intType", int(kind.extrapolated)),
        )


def prepare(ops: Any, kind: Kind) -> None:
    """Set the options common to static and time steps."""
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system(kind.system)
    ops.test("RelativeNormDispIncr", TOLERANCE, MOST_ITERATIONS, 0)


def displacements(ops: Any, count: int) -> np.ndarray:
    """Return the displacements of all nodes, shape (count, 3), [m]."""
    return np.array([ops.nodeDisp(tag) for tag in range(1, count + 1)])


def statics(ops: Any, kind: Kind) -> None:
    """Compute the static state; each step has the full weight of the bricks."""
    prepare(ops, kind)
    ops.algorithm(*kind.static)
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    if ops.analyze(kind.repeats):
        raise SystemExit("OpenSees did not converge in statics.")
    ops.loadConst("-time", 0.0)
    ops.wipeAnalysis()


def dynamics(
    ops: Any, scene: Arrays, kind: Kind
) -> tuple[list[float], list[int], list[list[list[float]]]]:
    """Compute the time steps by the average acceleration method.

    Returns:
        Processor time [ms], iterations, and displacements of the watched nodes [m] of each step.
    """
    dt, ground = float(scene["dt"]), scene["acceleration"]
    ops.rayleigh(0.0, 0.0, float(scene["damping"]), 0.0)  # proportional to the initial stiffness
    for axis in (1, 2, 3):
        ops.timeSeries(
            "Path", axis, "-dt", dt, "-values", *ground[:, axis - 1].tolist(), "-useLast"
        )
        ops.pattern("UniformExcitation", axis, axis, "-accel", axis)
    prepare(ops, kind)
    ops.algorithm(*kind.steps[0])
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    watched = (scene["watched"] + 1).tolist()
    spent, iterations, history = [], [], []
    for step in range(1, len(ground)):
        began = time.process_time()
        if ops.analyze(1, dt):
            for other in kind.steps[1:]:
                ops.algorithm(*other)
                if ops.analyze(1, dt) == 0:
                    break
            else:
                raise SystemExit(f"OpenSees did not converge in step {step}.")
            ops.algorithm(*kind.steps[0])
        spent.append(1e3 * (time.process_time() - began))
        iterations.append(ops.testIter())
        history.append([ops.nodeDisp(tag) for tag in watched])
    return spent, iterations, history


def main() -> None:
    """Read the scene, run it, write the results."""
    import openseespy.opensees as ops

    name, given, output = sys.argv[1:]
    kind = KINDS[name]
    with np.load(given) as scene:
        arrays = dict(scene)
    build(ops, arrays, kind)
    statics(ops, kind)
    count = len(arrays["nodes"])
    static = displacements(ops, count)
    spent, iterations, history = dynamics(ops, arrays, kind)
    last = displacements(ops, count) - static
    moved = np.array(history) - static[arrays["watched"]]
    np.savez(output, static=static, last=last, history=moved, cpu_ms=spent, iterations=iterations)


if __name__ == "__main__":
    main()
