# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modules, time and memory of six small scenes to the end of their first step."""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time as clock
import warnings
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("numba", "scipy", "slepc4py", "h5py", "gmsh", "matplotlib", "pyvista")
PARTS_OF_SCIPY = ("scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate")
SCENES = ("linear 2-D", "friction 3-D", "bonds", "water", "free field", "motion suite")
FRICTION = {"normal_stiffness": 1e11, "shear_stiffness": 4e10, "friction_angle_deg": 30.0}


def body(dj: Any, dim: int, *, jointed: bool) -> Any:
    """Return a square or a cube, with a joint at half of the height or without joints."""
    from mpi4py import MPI

    from dolfinx import mesh as dm

    create = dm.create_rectangle if dim == 2 else dm.create_box
    mesh = create(MPI.COMM_WORLD, [[0] * dim, [2] * dim], [8] * dim)
    mesh.topology.create_connectivity(dim - 1, dim)
    facets = {
        name: dm.locate_entities(mesh, dim - 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for name, i, at in (("base", dim - 1, 0.0), ("upstream", 0, 0.0), ("joint", dim - 1, 1.0))
    }
    joint = {"joint": facets.pop("joint")}
    return dj.split_mesh(mesh, joints=joint if jointed else {}, groups=facets)


def first_step(scene: str) -> Any:
    """Return the outcome of a scene at the end of its first time step."""
    import dolfinx_joints as dj

    law, water, supports = None, None, [dj.Fixed(group="base")]
    run: dict[str, Any] = {"motion": dj.synthetic_motion(duration=2.0).resampled(1e-3)}
    if scene == "bonds":
        law = dj.MohrCoulombJoint(**FRICTION, cohesion=1e6, tensile_strength=1e6)
    if scene in ("friction 3-D", "motion suite"):
        law = dj.FrictionNoTension(**FRICTION)
    if scene == "water":
        water = dj.ReservoirWaves(group="upstream", level=2.0, length=6.0)
    if scene == "free field":
        supports = [dj.ViscousBoundary(group="base")]
        run = {"loads": [dj.FreeField(groups=["base"], incident=lambda t: [t, 0, 0], surface=2.0)]}
    model = dj.Model(
        body(dj, 2 if scene == "linear 2-D" else 3, jointed=law is not None),
        material=dj.Elastic(young=30e9, poisson=0.2, density=2400.0),
        joints=law,
        supports=supports,
        loads=[dj.Gravity()],
        water=water,
    )
    simulation = dj.Simulation(model)
    simulation.statics()
    if scene != "motion suite":
        return simulation.dynamics(dt=1e-3, steps=1, **run)
    motions = {n: dj.Motion(acceleration=np.full((2, 3), float(n)), dt=1e-3) for n in "12"}
    with tempfile.TemporaryDirectory() as folder:
        suite = dj.study.MotionSuite(folder, simulation, motions, points={"base": (0.0, 0.0, 0.0)})
        return suite.run(dt=1e-3)


def measure(scene: str) -> dict[str, Any]:
    """Return modules, seconds and memory of a scene, run in a separate process."""
    command = [sys.executable, "-m", "benchmarks.lean", scene]
    return json.loads(subprocess.check_output(command, cwd=ROOT, text=True).splitlines()[-1])


def main() -> None:
    """Print the table of all scenes, or run one scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", choices=SCENES, help="run only this scene")
    parser.add_argument("--quick", action="store_true", help="run each scene once")
    options = parser.parse_args()
    if options.scene:
        warnings.simplefilter("ignore")  # warnings of an inaccurate step do not matter here
        began = clock.perf_counter()
        first_step(options.scene)
        row: dict[str, Any] = {"seconds": clock.perf_counter() - began}
        row["mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        row["modules"] = [name for name in sys.modules if name.startswith("dolfinx_joints.")]
        row["libraries"] = [n for n in (*LIBRARIES, *PARTS_OF_SCIPY) if n in sys.modules]
        print(json.dumps(row))
        return
    total = len(list((ROOT / "dolfinx_joints").rglob("*.py"))) - 1  # less the package itself
    print(f"| scene | modules of {total} | libraries | seconds | MB |\n|---|---|---|---|---|")
    for scene in SCENES:  # the first run may compile kernels
        rows = [measure(scene) for _ in range(2 - options.quick)]
        row = min(rows, key=lambda row: row["seconds"])
        numbers = f"{row['seconds']:.1f} | {row['mb']:.0f}"
        print(f"| {scene} | {len(row['modules'])} | {', '.join(row['libraries'])} | {numbers} |")


if __name__ == "__main__":
    main()
