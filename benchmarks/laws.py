# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processor time of a step by joint law, beside that of `FrictionNoTension` on the same scene."""

from __future__ import annotations

import argparse
import statistics
import warnings
from collections.abc import Mapping

import dolfinx_joints as dj
from benchmarks.shared.measure import march
from benchmarks.shared.scenes import Scene, dam, wall
from dolfinx_joints.laws.law import Law

SCENES = {"wall": lambda: wall("coarse"), "dam": dam}


def laws(scene: Scene) -> Mapping[str, Law]:
    """Return laws of the same elasticity and, those that slide, of the same friction."""
    elastic = {"normal_stiffness": 1e11, "shear_stiffness": scene.shear_ratio * 1e11}
    sliding = {**elastic, "friction_angle_deg": scene.friction_angle}
    friction = dj.FrictionNoTension(**sliding)
    return {
        "FrictionNoTension": friction,
        "bonds": dj.MohrCoulombJoint(**sliding, cohesion=5e5, tensile_strength=2e5),
        "dilatancy": dj.MohrCoulombJoint(**sliding, dilatancy_angle_deg=5.0),
        "ViscousJoint": dj.ViscousJoint(law=friction, normal_viscosity=1e7, shear_viscosity=1e7),
        "KeyedJoint": dj.KeyedJoint(**elastic),
        "ShearKeyJoint": dj.ShearKeyJoint(
            **sliding, depth=0.1, flank_angle_deg=60.0, spacing=0.6, tooth_cohesion=3e6
        ),
    }


def main() -> None:
    """Print a table for each scene; the laws take turns, so that all see the same machine."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=200, help="steps of a run (default 200)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of a law (default 3)")
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES))
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of steps whose error does not matter here
    for name in options.scene:
        scene = SCENES[name]()
        named = laws(scene)
        with scene.mesh_file() as mesh:
            for law in named.values():
                march(scene, mesh, 2, law=law)  # compiles what is not in the cache
            runs = [
                {kind: march(scene, mesh, options.steps, law=law) for kind, law in named.items()}
                for _ in range(options.repeats)
            ]
        print(f"\n| {name} | ms per step | to friction | iterations per step | per iteration |")
        print("|---|---|---|---|---|")
        for kind in named:
            ratio = statistics.median(
                run[kind].step_cpu_ms / run["FrictionNoTension"].step_cpu_ms for run in runs
            )
            time = statistics.median(run[kind].step_cpu_ms for run in runs)
            each, base = (runs[0][k].facts["iterations"] for k in (kind, "FrictionNoTension"))
            print(
                f"| {kind} | {time:.2f} | {ratio:.2f} | {each / options.steps:.1f} "
                f"| {ratio * base / each:.2f} |"
            )


if __name__ == "__main__":
    main()
