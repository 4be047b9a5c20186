#!/usr/bin/env python3
# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later
"""What `EnergyConsistent(spectral_radius=...)` gains and loses.

- Two rods tied by a stuck joint, ten periods of their lowest mode: error and jump of the velocity
  across the joint over the largest velocity, with and without exact modes.
- ``--dam``: the README's dam, at its crest on a joint: largest accelerations across the valley with
  dt and dt/2, raw and low-passed, the change of the low-passed one, error of the displacements
  (root mean square in time over that of the right ones; largest of x, y, z) against plain steps of
  dt/8, and what the scheme dissipated over the largest energy.
"""

from __future__ import annotations

import warnings
from itertools import product
from pathlib import Path

import numpy as np

import dolfinx_joints as dj
from benchmarks.acceleration_bands import Run, readme
from benchmarks.exact_modes import scheme, tied
from dolfinx_joints import measures
from dolfinx_joints.common.command_line import Parser
from dolfinx_joints.postprocessing.energy_lines import energy_lines

FINEST = 8  # parts of a step of the right motion


def rods(stiffnesses: tuple[float, ...] = (1.0, 1e6), counts: tuple[int, ...] = (20, 80)) -> None:
    """Table of the rods."""
    print("k_j      steps  exact  radius      error   jump of v   ledger")
    for stiffness, steps, modes, radius in product(stiffnesses, counts, (0, 4), (1.0, 0.8, 0.5)):
        off, jump, ledger = tied(stiffness, steps, modes, radius)
        print(f"{stiffness:.0e} {steps:6d} {modes:6d} {radius:7.1f} ", end="")
        print(f"{off:10.4f} {jump:11.1e} {ledger:8.0e}")


def dam(folder: Path, dt: float, seconds: float, variants: list[tuple[int, float]]) -> None:
    """Table of the dam."""
    folder.mkdir(parents=True, exist_ok=True)
    finest = folder / "finest.h5"
    if not finest.exists():
        readme(finest, Run(dt=dt / FINEST, seconds=seconds, scheme=dj.EnergyConsistent()))
    right = displacements(finest, FINEST)
    band = measures.band_name(measures.ACCELERATION_BAND)
    print(f"dt {dt} s; {band}; peaks in m/s^2")
    print("exact radius    raw dt    dt/2   band dt    dt/2  change  off dt   dt/2   dissipated")
    for modes, radius in variants:
        raw, low, off, lost = [], [], [], []
        for parts in (1, 2):
            path = folder / f"{modes}_{radius}_{parts}.h5"
            if not path.exists():
                readme(path, Run(dt=dt / parts, seconds=seconds, scheme=scheme(modes, radius)))
            with dj.Results(path) as results:
                for found, each in ((raw, None), (low, measures.ACCELERATION_BAND)):
                    a = measures.acceleration_history(results, "joint", "y", band=each)[1]
                    found.append(np.abs(a).max())
                lines = energy_lines(results)
                largest = max(float(np.abs(line).max()) for line in lines.values())
                lost.append(float(lines.get("dissipation", np.zeros(1))[-1]) / largest)
            error = np.linalg.norm(displacements(path, parts) - right, axis=0)
            off.append(float((error / np.linalg.norm(right, axis=0)).max()))
        print(f"{modes:5d} {radius:6.2f} {raw[0]:9.4g} {raw[1]:7.4g} ", end="")
        print(f"{low[0]:9.4g} {low[1]:7.4g} {low[0] / low[1] - 1.0:+7.1%} ", end="")
        print(f"{off[0]:7.2%} {off[1]:6.2%} {lost[0]:7.2%} {lost[1]:6.2%}", flush=True)


def displacements(path: Path, every: int) -> np.ndarray:
    """Displacements of the crest from its static ones, every so many steps, shape (n, 3), [m]."""
    with dj.Results(path) as results:
        moved = results.series("histories", "displacement")[:, results.point_index("joint")]
    return moved[every::every] - moved[0]


def main(arguments: list[str] | None = None) -> None:
    """Print tables."""
    parser = Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--dam", action="store_true", help="the README's dam instead")
    parser.add_argument("--dt", type=float, default=0.001, help="the longer step of the dam [s]")
    parser.add_argument("--seconds", type=float, default=2.0, help="of its motion")
    parser.add_argument("--modes", type=int, nargs="+", default=[0, 10, 20], help="exact ones")
    parser.add_argument("--radii", type=float, nargs="+", default=[1.0, 0.8, 0.5])
    parser.add_argument("--out", type=Path, default=Path("output/dissipation"))
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    if options.dam:
        variants = list(product(options.modes, options.radii))
        dam(options.out, options.dt, options.seconds, variants)
    else:
        rods()


if __name__ == "__main__":
    main()
