# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processor time of a step by joint law, compared with `FrictionNoTension` on the same scene."""

from __future__ import annotations

import argparse
import statistics
import warnings
from collections.abc import Mapping

import dolfinx_joints as dj
from benchmarks.shared.measure import march
from benchmarks.shared.scenes import Scene, dam, wall
from benchmarks.shared.tables import table
from dolfinx_joints.laws.law import Law

FORM = """| {scene} | ms per step | to friction | iterations per step | the ratio per iteration |
| {{law}} | {{ms:.2f}} | {{ratio:.2f}} | {{iterations:.1f}} | {{each:.2f}} |"""
SCENES = {"wall": lambda: wall("coarse"), "dam": dam}


def laws(scene: Scene) -> Mapping[str, Law]:
    """Return laws with the same elasticity and, if they slide, with the same friction."""
    elastic = {"normal_stiffness": 1e11, "shear_stiffness": scene.shear_ratio * 1e11}
    sliding = {**elastic, "friction_angle_deg": scene.friction_angle}
    friction = dj.FrictionNoTension(**sliding)
    return {
        "FrictionNoTension": friction,
        "bonds": dj.MohrCoulombJoint(**sliding, cohesion=5e5, tensile_strength=2e5),
        "CohesiveJoint": dj.CohesiveJoint(
            **sliding,
            cohesion=5e5,
            tensile_strength=2e5,
            fracture_energy=20.0,
            shear_fracture_energy=100.0,
            softening="linear",
        ),
        "dilatancy": dj.MohrCoulombJoint(**sliding, dilatancy_angle_deg=5.0),
        "ViscousJoint": dj.ViscousJoint(law=friction, normal_viscosity=1e7, shear_viscosity=1e7),
        "KeyedJoint": dj.KeyedJoint(**elastic),
        "ShearKeyJoint": dj.ShearKeyJoint(
            **sliding, depth=0.1, flank_angle_deg=60.0, spacing=0.6, tooth_cohesion=3e6
        ),
    }


def main() -> None:
    """Print a table for each scene; the laws run alternately under the same conditions."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=200, help="steps of a run (default 200)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of a law (default 3)")
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES))
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # warnings of inaccurate steps do not matter here
    for name in options.scene:
        scene = SCENES[name]()
        named = laws(scene)
        with scene.mesh_file() as mesh:
            for law in named.values():
                march(scene, mesh, 2, law=law)  # compiles code that is not cached
            runs = [
                {kind: march(scene, mesh, options.steps, law=law) for kind, law in named.items()}
                for _ in range(options.repeats)
            ]
        rows = []
        for kind in named:
            ratio = statistics.median(
                run[kind]["cpu_ms"] / run["FrictionNoTension"]["cpu_ms"] for run in runs
            )
            iterations, least = (
                runs[0][k]["newton_mean"] * runs[0][k]["accepted"] / options.steps
                for k in (kind, "FrictionNoTension")
            )
            rows.append(
                {
                    "law": kind,
                    "ms": statistics.median(run[kind]["cpu_ms"] for run in runs),
                    "ratio": ratio,
                    "iterations": iterations,
                    "each": ratio * least / iterations,
                }
            )
        print(f"\n{table(FORM.format(scene=name), rows)}")


if __name__ == "__main__":
    main()
